"use strict";
// Tone maps of clshade.images.tonemap, for the display without WebGL and for the pixel probe.

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
