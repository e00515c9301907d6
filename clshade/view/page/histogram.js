"use strict";
// The histogram of the layer that is shown.

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
