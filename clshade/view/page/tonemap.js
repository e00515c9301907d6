"use strict";
// Tone maps of clshade.images.tonemap, for the display without WebGL and for the pixel probe.

const OPERATORS = ["none", "srgb", "reinhard", "hable", "aces"]; // in the order of tonemap.glsl's numbers
const OPERATOR_NAMES = { none: "None", srgb: "sRGB", reinhard: "Reinhard", hable: "Hable", aces: "ACES" };

function srgbCurve(x) {
  return x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055;
}

function hablePartial(x) {
  return (x * (0.15 * x + 0.05) + 0.004) / (x * (0.15 * x + 0.5) + 0.06) - 0.02 / 0.3;
}

const CURVES = {
  none: (x) => x,
  srgb: (x) => x,
  reinhard: (x) => x / (1 + x),
  hable: (x) => hablePartial(2 * x) / hablePartial(11.2),
  aces: (x) => (x * (2.51 * x + 0.03)) / (x * (2.43 * x + 0.59) + 0.14),
};

/** Return the 8-bit code of a linear value. */
function toneMappedCode(value, operator, exposure) {
  if (!(value > 0)) return 0;
  const y = Math.min(1, CURVES[operator](Math.min(value * 2 ** exposure, 1e30)));
  return Math.floor(255 * (operator === "none" ? y : srgbCurve(y)) + 0.5);
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
    codes[upper] = toneMappedCode(floatBits[0], operator, exposure);
  }
  codes[0xff00] = 255; // infinity; the NaNs above it stay 0
  Object.assign(toneTable, { key, codes });
  return codes;
}

/** Return a value's code by the table. */
function tableCode(value, codes) {
  if (!(value > 0)) return 0;
  floatBits[0] = value;
  return codes[bitsOfFloat[0] >>> 15];
}
