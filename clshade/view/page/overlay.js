"use strict";
// What lies over the picture: values printed in large pixels, the grid, the line of the wipe, the pinned pixel.

const GRID_ZOOM = 12; // least zoom, in CSS pixels per pixel of the image, at which the grid is drawn
const VALUES_ZOOM = 44; // at which values are printed

/** Return a number with so many significant digits, without trailing zeros. */
function formatted(value, digits = 6) {
  if (value === Infinity) return "∞";
  if (value === -Infinity) return "−∞";
  if (Number.isNaN(value)) return "NaN";
  if (Number.isInteger(value) && Math.abs(value) < 1e6) return minus(String(value));
  const size = Math.abs(value);
  const text = size >= 10 ** digits || size < 1e-4 ? value.toExponential(digits - 2) : value.toPrecision(digits);
  return minus(text.includes(".") ? text.replace(/\.?0+(e|$)/, "$1") : text).replace("e+", "e");
}

function minus(text) {
  return text.replace("-", "−");
}

/** Return the shortest decimal number that rounds to this float32. */
function shortest(value) {
  if (!Number.isFinite(value)) return formatted(value);
  for (let digits = 1; digits < 9; digits++) {
    const text = value.toPrecision(digits);
    if (Math.fround(Number(text)) === value) return String(Number(text));
  }
  return String(Number(value.toPrecision(9)));
}

/** Draws over the picture on a canvas of the same size. */
class Overlay {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
  }

  /**
   * parts: [{shown, from, to, texts, colors}], columns of the canvas that each image takes, and what returns functions of
   * a pixel: to the texts in it, and to its display color. wipe: x of the line, or null.
   */
  draw(parts, view, { wipe, pinned, ratio, border }) {
    const { context, canvas } = this;
    context.clearRect(0, 0, canvas.width, canvas.height);
    for (const part of parts) {
      context.save();
      context.beginPath();
      context.rect(part.from, 0, part.to - part.from, canvas.height);
      context.clip();
      if (view.zoom >= GRID_ZOOM * ratio) this.grid(part, view);
      if (view.zoom >= VALUES_ZOOM * ratio) this.values(part, view, ratio);
      if (border) {
        const { width, height } = part.shown.image;
        Object.assign(context, { strokeStyle: "#d8d8d8", lineWidth: ratio });
        context.strokeRect(view.x, view.y, width * view.zoom, height * view.zoom);
      }
      context.restore();
    }
    if (pinned) this.pin(pinned, view, ratio);
    if (wipe !== null) this.line(wipe, ratio);
  }

  /** Return the visible pixels of an image: first and last columns and rows. */
  visible({ shown, from, to }, view) {
    const { width, height } = shown.image;
    const within = (value, count) => Math.max(0, Math.min(count - 1, Math.floor(value)));
    return {
      left: within((from - view.x) / view.zoom, width),
      right: within((to - view.x) / view.zoom, width),
      top: within(-view.y / view.zoom, height),
      bottom: within((this.canvas.height - view.y) / view.zoom, height),
    };
  }

  grid(part, view) {
    const { left, right, top, bottom } = this.visible(part, view);
    const { context } = this;
    Object.assign(context, { strokeStyle: "rgba(128, 128, 128, 0.35)", lineWidth: 1 });
    context.beginPath();
    const at = (start, k) => Math.round(start + k * view.zoom) + 0.5;
    for (let x = left; x <= right + 1; x++) {
      context.moveTo(at(view.x, x), at(view.y, top));
      context.lineTo(at(view.x, x), at(view.y, bottom + 1));
    }
    for (let y = top; y <= bottom + 1; y++) {
      context.moveTo(at(view.x, left), at(view.y, y));
      context.lineTo(at(view.x, right + 1), at(view.y, y));
    }
    context.stroke();
  }

  values(part, view, ratio) {
    const { shown } = part;
    const [texts, colorAt] = [part.texts(), part.colors()];
    const { left, right, top, bottom } = this.visible(part, view);
    const size = Math.min(13 * ratio, view.zoom / Math.max(4.8, shown.count + 1));
    const digits = view.zoom >= 80 * ratio ? 5 : 3;
    const { context } = this;
    const font = `${size}px ui-monospace, "DejaVu Sans Mono", Menlo, Consolas, monospace`;
    Object.assign(context, { font, textAlign: "center", textBaseline: "middle" });
    for (let y = top; y <= bottom; y++) {
      for (let x = left; x <= right; x++) {
        const color = colorAt(x, y);
        if (!color) continue;
        context.fillStyle = color[0] * 0.3 + color[1] * 0.6 + color[2] * 0.1 > 110 ? "#000" : "#fff";
        texts(x, y, digits).forEach((text, k, all) => {
          const line = view.y + (y + 0.5) * view.zoom + (k - (all.length - 1) / 2) * size * 1.2;
          context.fillText(text, view.x + (x + 0.5) * view.zoom, line, view.zoom * 0.94);
        });
      }
    }
  }

  pin({ x, y }, view, ratio) {
    const half = Math.max(view.zoom / 2, 4 * ratio);
    const [left, top] = [view.x + (x + 0.5) * view.zoom - half, view.y + (y + 0.5) * view.zoom - half];
    this.edged("rgba(0, 0, 0, 0.8)", ratio, () => this.context.strokeRect(left, top, 2 * half, 2 * half));
  }

  /** Call a function that strokes a shape, in a dark color and then, thinner, in white. */
  edged(dark, ratio, stroke) {
    for (const [strokeStyle, lineWidth] of [[dark, 3 * ratio], ["#fff", ratio]]) {
      Object.assign(this.context, { strokeStyle, lineWidth });
      stroke();
    }
  }

  line(x, ratio) {
    const { context, canvas } = this;
    context.beginPath();
    context.moveTo(x, 0);
    context.lineTo(x, canvas.height);
    this.edged("rgba(0, 0, 0, 0.6)", ratio, () => context.stroke());
    context.fillStyle = "#fff";
    context.beginPath();
    context.arc(x, canvas.height / 2, 6 * ratio, 0, 2 * Math.PI);
    context.fill();
  }
}
