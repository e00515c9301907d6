"use strict";
// Figures of a layer: range, histogram, and how many values are NaN, infinite or negative.

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
