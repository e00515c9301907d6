"use strict";
// Figures of a layer: range, how many values are NaN, infinite or negative; and its histogram.

const SAMPLED = 1 << 16; // values of which percentiles are taken, evenly spread
const BINS_PER_STOP = 8;
const LOWEST_STOP = -32; // the histogram's; 64 stops in all
const BIN_COUNT = 64 * BINS_PER_STOP;
const LUMINANCE = [0.2126, 0.7152, 0.0722]; // of linear Rec. 709, ITU-R BT.709

/** Return the 1 % and 99 % percentiles of the finite values of a plane, or [0, 0] if there are none. */
function percentileRange(read, count) {
  const step = Math.max(1, Math.floor(count / SAMPLED));
  const values = [];
  for (let i = 0; i < count; i += step) {
    const value = read(i);
    if (Number.isFinite(value)) values.push(value);
  }
  if (!values.length) return [0, 0];
  const sorted = Float64Array.from(values).sort();
  const rank = (percent) => sorted[Math.round(percent * (sorted.length - 1))];
  return [rank(0.01), rank(0.99)];
}

/** Count the NaN, infinite and negative values of a plane; and its smallest and largest finite values. */
function countSpecial(read, count, total) {
  let { low, high } = total;
  for (let i = 0; i < count; i++) {
    const value = read(i);
    if (value - value !== 0) {
      if (value !== value) total.nan++;
      else total.infinite++;
    } else {
      if (value < 0) total.negative++;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  total.low = low;
  total.high = high;
}

/** Return counts of the values of a plane in bins. binOf: a value's bin, beyond the last for that one; -1: not counted. */
function histogram(read, count, binCount, binOf) {
  const bins = new Uint32Array(binCount);
  for (let i = 0; i < count; i++) {
    const bin = binOf(read(i));
    if (bin >= 0) bins[Math.min(binCount - 1, bin)]++;
  }
  return bins;
}

/** Return [number, pixels] of each number but 0, the most frequent first. */
function countNumbers(read, count) {
  const counts = new Map();
  for (let i = 0; i < count; i++) {
    const number = read(i);
    if (number) counts.set(number, (counts.get(number) ?? 0) + 1);
  }
  return [...counts].sort(([, a], [, b]) => b - a);
}

/** Return what is needed to draw a loaded layer: its kind, and the range of each of its planes. */
function quickStatistics(layer) {
  const kind = kindOf(layer);
  const ranged = kind === KIND.quantity || kind === KIND.position || kind === KIND.coordinates;
  const linear = layer.image.isEncoded(layer);
  const ranges = layer.planes.map((plane) => ranged ? percentileRange(plane.reader(linear), plane.data.length) : [0, 1]);
  return { kind, ranges };
}

/** Return a layer's counts of special values and its histograms: of R, G, B and luminance, or of one quantity. */
function fullStatistics(layer) {
  const linear = layer.image.isEncoded(layer);
  const reads = layer.planes.map((plane) => plane.reader(linear));
  const count = layer.planes[0].data.length;
  const total = { nan: 0, infinite: 0, negative: 0, low: Infinity, high: -Infinity };
  for (const read of reads) countSpecial(read, count, total);
  const { kind } = layer.statistics;
  if (kind === KIND.color) {
    const [r, g, b] = reads.length === 3 ? reads : [reads[0], reads[0], reads[0]];
    const luminance = (i) => LUMINANCE[0] * r(i) + LUMINANCE[1] * g(i) + LUMINANCE[2] * b(i);
    // At the ends what lies beyond.
    const bin = (value) => (value > 0 && value !== Infinity
      ? Math.max(0, Math.floor((Math.log2(value) - LOWEST_STOP) * BINS_PER_STOP)) : -1);
    const planes = reads.length === 3 ? [luminance, ...reads] : reads;
    const histograms = planes.map((read) => histogram(read, count, BIN_COUNT, bin));
    return { ...total, inStops: true, histograms };
  }
  if (kind === KIND.numbers) {
    const numbers = reads.length === 1 ? countNumbers(reads[0], count) : [];
    return { ...total, inStops: false, histograms: [], numbers };
  }
  const { low, high } = total;
  const bin = (value) => (value >= low && value <= high ? Math.floor((value - low) * (256 / (high - low || 1))) : -1);
  const histograms = reads.map((read) => histogram(read, count, 256, bin));
  return { ...total, inStops: false, histograms };
}

const PLANE_COLORS = ["#d96a6a", "#67b567", "#6f9bea"];

/** Draw histograms of fullStatistics. white: the stop that is shown as 1. */
function drawHistogram(canvas, full, white) {
  const ratio = window.devicePixelRatio;
  canvas.width = Math.round(canvas.clientWidth * ratio);
  canvas.height = Math.round(canvas.clientHeight * ratio);
  const context = canvas.getContext("2d");
  const { histograms, inStops } = full ?? { histograms: [] };
  if (!histograms.length) return;
  const base = canvas.height - 15 * ratio;
  const [first, last] = inStops ? filledBins(histograms) : [0, 255];
  const bins = last - first + 1;
  // A background may fill one bin; the fifth largest or so leaves the others in sight.
  const heights = histograms.flatMap((counts) => [...counts.subarray(first, last + 1)]).sort((a, b) => b - a);
  const typical = heights[Math.min(heights.length - 1, 4 * histograms.length)] || heights[0];
  const tallest = Math.max(1, Math.min(heights[0], 1.5 * typical));
  const gray = `rgba(210, 210, 210, ${histograms.length === 1 ? 0.6 : 0.35})`; // of light, the luminance's
  const colors = inStops || histograms.length === 1 ? [gray, ...PLANE_COLORS] : PLANE_COLORS;
  histograms.forEach((counts, k) => {
    context.beginPath();
    for (let bin = 0; bin < bins; bin++) {
      const y = base - Math.min(1, counts[first + bin] / tallest) * (base - 2 * ratio);
      context.lineTo((bin / bins) * canvas.width, y);
      context.lineTo(((bin + 1) / bins) * canvas.width, y);
    }
    const filled = histograms.length === 1 || (inStops && k === 0);
    if (filled) {
      context.lineTo(canvas.width, base);
      context.lineTo(0, base);
      context.fillStyle = colors[k];
      context.fill();
    } else {
      Object.assign(context, { strokeStyle: colors[k], lineWidth: ratio });
      context.stroke();
    }
  });
  Object.assign(context, { fillStyle: "#9a9a9a", font: `${10 * ratio}px system-ui, sans-serif`, textBaseline: "bottom" });
  context.fillRect(0, base, canvas.width, ratio);
  if (inStops) drawStops(context, canvas, first, bins, base, white, ratio);
  else if (full.low <= full.high) {
    context.fillText(formatted(full.low, 4), 0, canvas.height);
    context.textAlign = "right";
    context.fillText(formatted(full.high, 4), canvas.width, canvas.height);
  }
}

/** Return the first and last bins that matter, at whole stops, at least four stops wide; of no light, those of the false
 * color. */
function filledBins(histograms) {
  const total = histograms.reduce((sum, counts) => sum + counts.reduce((a, b) => a + b, 0), 0);
  if (!total) return FALSE_COLOR_STOPS.map((stop, k) => (stop - LOWEST_STOP) * BINS_PER_STOP - k);
  const enough = total * 2e-5;
  const matters = (bin) => histograms.reduce((sum, counts) => sum + counts[bin], 0) > enough;
  let first = 0;
  let last = BIN_COUNT - 1;
  while (first < last && !matters(first)) first++;
  while (last > first && !matters(last)) last--;
  first = Math.floor(first / BINS_PER_STOP) * BINS_PER_STOP;
  const end = Math.max(Math.ceil((last + 1) / BINS_PER_STOP), first / BINS_PER_STOP + 4);
  last = Math.min(BIN_COUNT, end * BINS_PER_STOP) - 1;
  return [Math.max(0, Math.min(first, BIN_COUNT - 4 * BINS_PER_STOP)), last];
}

function drawStops(context, canvas, first, bins, base, white, ratio) {
  const stops = bins / BINS_PER_STOP;
  const step = [1, 2, 4, 8, 16].find((size) => stops / size <= 9) ?? 16;
  const at = (stop) => (((stop - LOWEST_STOP) * BINS_PER_STOP - first) / bins) * canvas.width;
  const lowest = first / BINS_PER_STOP + LOWEST_STOP;
  context.textAlign = "center";
  for (let stop = Math.ceil(lowest / step) * step; stop <= lowest + stops; stop += step) {
    context.fillRect(at(stop), base, ratio, 3 * ratio);
    const place = Math.max(10 * ratio, Math.min(canvas.width - 12 * ratio, at(stop)));
    context.fillText(minus(stop > 0 ? `+${stop}` : String(stop)), place, canvas.height);
  }
  context.fillStyle = "#fff";
  context.fillRect(Math.round(at(white)), 0, ratio, base);
}
