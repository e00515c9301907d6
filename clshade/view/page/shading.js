"use strict";
// What is drawn of a layer, and its colors by the processor, tone maps as in clshade.images.tonemap: the texts on pixels, the
// probe, and the display without WebGL.

const OPERATOR_NAMES = { // in the order of tonemap.glsl's numbers
  none: "None", srgb: "sRGB", reinhard: "Reinhard", hable: "Hable", aces: "ACES", neutral: "Neutral", agx: "AgX",
};
const OPERATORS = Object.keys(OPERATOR_NAMES);

function srgbCurve(x) {
  return x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055;
}

function hablePartial(x) {
  return (x * (0.15 * x + 0.05) + 0.004) / (x * (0.15 * x + 0.5) + 0.06) - 0.02 / 0.3;
}

const CURVES = { // of those without one, the identity
  reinhard: (x) => x / (1 + x),
  hable: (x) => hablePartial(2 * x) / hablePartial(11.2),
  aces: (x) => (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14),
};

const JOINT_CURVES = { neutral, agx }; // of the three channels of a color together

function neutral(x) {
  const lowest = Math.min(...x);
  const colors = x.map((value) => value - (lowest <= 0.08 ? lowest - (lowest * lowest) / 0.16 : 0.04));
  const peak = Math.max(...colors);
  if (peak <= 0.76) return colors;
  const mapped = 1 - 0.0576 / (peak - 0.52);
  const kept = 1 / (0.15 * (peak - mapped) + 1);
  return colors.map((value) => value * (mapped / peak) * kept + mapped * (1 - kept));
}

function agx(x) {
  const mean = (color) => 0.21199465 * color[0] + 0.39215085 * color[1] + 0.3958545 * color[2];
  const gray = mean(x);
  const curved = x.map((value) => {
    const away = Math.min(Math.log2(Math.max(0.8 * value + 0.2 * gray, 0.18 / 1024) / 0.18), 6.5) / 16.5;
    const [power, span] = away < 0 ? [3, 10 / 16.5] : [3.25, 6.5 / 16.5];
    const bend = ((4 * span) ** power - 1) / span ** power;
    return 0.5 + 2 * away * (1 + bend * Math.abs(away) ** power) ** (-1 / power);
  });
  const whole = mean(curved);
  return curved.map((value) => Math.max(0, Math.min(1, (value - 0.2 * whole) / 0.8)) ** 2.2);
}

/** Return the 8-bit codes of a linear color. */
function toneMappedCodes(color, operator, exposure) {
  const x = color.map((value) => (value > 0 ? Math.min(value * 2 ** exposure, 1e30) : 0));
  const curved = JOINT_CURVES[operator] ? JOINT_CURVES[operator](x) : x.map(CURVES[operator] ?? ((value) => value));
  return curved.map((value, k) => {
    const y = Number.isNaN(color[k]) ? 0 : Math.min(1, value);
    return Math.floor(255 * (operator === "none" ? y : srgbCurve(y)) + 0.5);
  });
}

const toneTable = { key: "", codes: null };
const floatBits = new Float32Array(1);
const bitsOfFloat = new Uint32Array(floatBits.buffer);

/** Return codes by the upper 16 bits below the sign of a positive float32: 1/512 of a value's size, 1/2 code, off. */
function toneCodes(operator, exposure) {
  const key = `${operator} ${exposure}`;
  if (toneTable.key === key) return toneTable.codes;
  const codes = new Uint8Array(65536);
  for (let upper = 0; upper < 0xff00; upper++) {
    bitsOfFloat[0] = (upper << 15) | 0x4000;
    [codes[upper]] = toneMappedCodes([floatBits[0]], operator, exposure);
  }
  codes[0xff00] = 255; // infinity; the NaNs above it stay 0
  Object.assign(toneTable, { key, codes });
  return codes;
}

/** Return a function from the channels of a linear color to its codes, the fast way where there is one. */
function toneMapper(operator, exposure) {
  if (JOINT_CURVES[operator]) return (...color) => toneMappedCodes(color, operator, exposure);
  const codes = toneCodes(operator, exposure);
  const code = (value) => {
    if (!(value > 0)) return 0;
    floatBits[0] = value;
    return codes[bitsOfFloat[0] >>> 15];
  };
  return (r, g, b) => [code(r), code(g), code(b)];
}

const GROUND = [42, 42, 42];
const NOTHING = [96, 96, 96]; // infinity where colors stand for numbers
const NAN_MARK = [255, 0, 255];
const INFINITE_MARK = [255, 176, 0];
const NEGATIVE_MARK = [0, 181, 255];
const FALSE_COLOR_STOPS = [-8, 4]; // relative to 1 at the exposure chosen

/** One image as it is drawn. planes: channels, one or three of them repeated; ranges: [low, high] of each. */
class Shown {
  /** component: index of a plane, "luminance", or null for all. range: [low, high] instead of the layer's. */
  constructor(layer, component, range) {
    this.layer = layer;
    this.image = layer.image;
    this.isEncoded = layer.image.isEncoded(layer);
    const { kind, ranges } = layer.statistics;
    this.kind = kind;
    this.asLuminance = component === "luminance";
    const single = typeof component === "number" && component < layer.planes.length ? component : null;
    this.planes = single === null ? layer.planes : [layer.planes[single]];
    this.ranges = single === null ? ranges : [ranges[single]];
    if (single !== null && kind !== KIND.color && kind !== KIND.numbers) this.kind = KIND.quantity;
    if (single !== null && kind === KIND.direction) this.ranges = [[-1, 1]];
    if (range && this.kind === KIND.quantity) this.ranges = [range];
    this.count = this.planes.length;
  }

  /** Return three planes, the first repeated for gray; the third is null where there are two. */
  three() {
    return this.count === 1 ? [0, 0, 0].map(() => this.planes[0]) : [0, 1, 2].map((k) => this.planes[k] ?? null);
  }

  readers() {
    return this.three().map((plane) => (plane ? plane.reader(this.isEncoded) : () => 0));
  }
}

/** Return the color of a tuple of numbers, as clshade.images.figures does. */
function numberColor(numbers) {
  let state = 0;
  if (numbers.every((number) => number === 0)) return [0, 0, 0];
  for (const number of numbers) {
    state = Math.imul(state ^ wholeOf(number), 0x9e3779b1);
    state = Math.imul(state ^ (state >>> 15), 0x85ebca6b);
    state ^= state >>> 13;
  }
  return [0, 8, 16].map((shift) => (((state >>> shift) & 255) >> 2) * 3 + 64);
}

function wholeOf(value) {
  return Number.isFinite(value) ? value % 2 ** 32 >>> 0 : 0;
}

function difference(a, b, metric) {
  if (a === b || (a !== a && b !== b)) return 0;
  const error = Math.abs(a - b);
  return metric === "squared" ? error * error : metric === "relative" ? error / (Math.abs(b) + 0.01) : error;
}

/** Return a function from x, y of a pixel to its display color, [r, g, b] in 0 to 255; null outside of the image. */
function shader(shown, reference, settings, colormaps) {
  const { image } = shown;
  const { metric } = settings;
  const light = lightShader(shown, settings, colormaps.stops);
  const reads = shown.readers();
  if (!metric) {
    const colored = shown.kind === KIND.color ? light : valueShader(shown, settings, colormaps.quantity);
    return (x, y) => {
      if (!image.contains(x, y)) return null;
      const index = y * image.width + x;
      return colored(reads[0](index), reads[1](index), reads[2](index));
    };
  }
  const others = reference.readers();
  const numbers = shown.kind === KIND.numbers;
  return (x, y) => {
    if (!image.contains(x, y) || !reference.image.contains(x, y)) return null;
    const [i, j] = [y * image.width + x, y * reference.image.width + x];
    const errors = reads.map((read, k) => difference(read(i), others[k](j), metric));
    return numbers ? (errors.some((error) => error) ? [255, 255, 255] : [0, 0, 0]) : light(...errors);
  };
}

/** Return a function from x, y of a pixel and a number of digits to its values, or to the differences, as texts. */
function pixelTexts(shown, reference, metric) {
  const linear = Boolean(metric);
  const reads = shown.planes.map((plane) => plane.reader(linear && shown.isEncoded));
  const others = metric ? reference.planes.map((plane) => plane.reader(reference.isEncoded)) : [];
  return (x, y, digits) => reads.map((read, k) => {
    const value = read(y * shown.image.width + x);
    if (!metric) return formatted(value, digits);
    return others[k] ? formatted(difference(value, others[k](y * reference.image.width + x), metric), digits) : "";
  });
}

function lightShader(shown, { exposure, operator, marking, inStops }, colormap) {
  const toneMapped = toneMapper(operator, exposure);
  const gain = 2 ** exposure;
  const [first, last] = FALSE_COLOR_STOPS;
  return (r, g, b) => {
    const sum = r + g + b;
    if (marking && sum - sum !== 0) return sum !== sum && [r, g, b].some(Number.isNaN) ? NAN_MARK : INFINITE_MARK;
    if (marking && (r < 0 || g < 0 || b < 0)) return NEGATIVE_MARK;
    if (shown.asLuminance || inStops) r = g = b = LUMINANCE[0] * r + LUMINANCE[1] * g + LUMINANCE[2] * b;
    if (!inStops) return toneMapped(r, g, b);
    return r > 0 ? mapped(colormap, (Math.log2(r * gain) - first) / (last - first)) : [0, 0, 0];
  };
}

function valueShader(shown, { marking }, colormap) {
  const { kind, count, ranges } = shown;
  if (kind === KIND.numbers) return (...values) => numberColor(values.slice(0, count));
  const spread = (value, k) => {
    const [low, high] = ranges[Math.min(k, ranges.length - 1)];
    return high === low ? 0.5 : (value - low) / (high - low);
  };
  const code = (value) => Math.floor(255 * Math.max(0, Math.min(1, value)) + 0.5);
  return (...values) => {
    if (marking && values.some(Number.isNaN)) return NAN_MARK;
    if (!values.every(Number.isFinite)) return NOTHING;
    if (kind === KIND.quantity) return mapped(colormap, spread(values[0], 0));
    if (kind === KIND.direction) return values.every((v) => v === 0) ? [0, 0, 0] : values.map((v) => code(v / 2 + 0.5));
    const shares = kind === KIND.coordinates ? values.map((v) => v - Math.floor(v)) : values.map(spread);
    return shares.map((v, k) => (k < count ? code(v) : 0));
  };
}

/** Return the color of a colormap, 256 RGB bytes, at a position in [0, 1]. */
function mapped(colormap, position) {
  const entry = 3 * Math.floor(256 * Math.max(0, Math.min(0.999, position)));
  return [colormap[entry], colormap[entry + 1], colormap[entry + 2]];
}

/** The display without WebGL 2: 8 bits, by the processor, each pixel of the canvas from the nearest of the image. */
class CanvasDisplay {
  constructor(canvas, colormaps) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
    this.colormaps = colormaps;
  }

  draw(shown, reference, view, settings) {
    const { width, height } = this.canvas;
    if (!width || !height) return;
    const picture = this.context.createImageData(width, height);
    const pixels = new Uint32Array(picture.data.buffer);
    pixels.fill(packed(GROUND));
    if (shown) {
      const wipe = Math.min(width, Math.ceil((settings.wipe ?? width) - 0.5));
      this.part(pixels, 0, wipe, shader(shown, reference, settings, this.colormaps), view);
      if (wipe < width && reference) this.part(pixels, wipe, width, shader(reference, null, settings, this.colormaps), view);
    }
    this.context.putImageData(picture, 0, 0);
  }

  /** Draw columns from first to last. */
  part(pixels, first, last, colorAt, view) {
    const { width, height } = this.canvas;
    const columns = Array.from({ length: width }, (_, column) => Math.floor((column + 0.5 - view.x) / view.zoom));
    for (let row = 0; row < height; row++) {
      const y = Math.floor((row + 0.5 - view.y) / view.zoom);
      for (let column = first; column < last; column++) {
        const color = colorAt(columns[column], y);
        if (color) pixels[row * width + column] = packed(color);
      }
    }
  }
}

/** Return a color as the bytes R, G, B, 255 of a little-endian number. */
function packed([r, g, b]) {
  return (0xff000000 | (b << 16) | (g << 8) | r) >>> 0;
}
