"use strict";
// Channels: values as stored, decoded from the page's blocks when they are first needed.

const ARRAYS = { half: Uint16Array, float: Float32Array, uint: Uint32Array, u8: Uint8Array, u16: Uint16Array };
const TYPE_NAMES = { half: "half", float: "float", uint: "uint", u8: "8-bit", u16: "16-bit" };

/** Decode base64 to bytes. */
function bytesOf(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const letters = atob(text);
  const bytes = new Uint8Array(letters.length);
  for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
  return bytes;
}

/** Inflate zlib data. */
async function inflated(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Write into `values`, unsigned integers, from `start` on what byte planes of consecutive differences say. */
function sumDifferences(planes, values, start) {
  const size = values.BYTES_PER_ELEMENT;
  const count = planes.length / size;
  let sum = 0;
  if (size === 4) {
    for (let i = 0, j = count, k = 2 * count, l = 3 * count; i < count; i++, j++, k++, l++) {
      sum = (sum + (planes[i] | (planes[j] << 8) | (planes[k] << 16) | (planes[l] << 24))) | 0;
      values[start + i] = sum;
    }
  } else if (size === 2) {
    for (let i = 0; i < count; i++) values[start + i] = sum = (sum + (planes[i] | (planes[count + i] << 8))) & 0xffff;
  } else {
    for (let i = 0; i < count; i++) values[start + i] = sum = (sum + planes[i]) & 0xff;
  }
}

/** Return a block of the page's data. Those that are not drawn at first stand behind the scripts. */
async function blockOf(number) {
  const find = () => document.getElementById(`chunk-${number}`);
  // The parser may be in the middle of a block until another follows it.
  if (document.readyState === "loading" && !find()?.nextElementSibling)
    await new Promise((resolve) => document.addEventListener("DOMContentLoaded", resolve, { once: true }));
  return find();
}

/** Decode the page's blocks of these numbers to an array of a type, and remove them from the page. */
async function decodeBlocks(type, numbers, count) {
  const data = new ARRAYS[type](count);
  const codes = data instanceof Float32Array ? new Uint32Array(data.buffer) : data;
  let start = 0;
  for (const number of numbers) {
    const element = await blockOf(number);
    const planes = await inflated(bytesOf(element.textContent));
    sumDifferences(planes, codes, start);
    start += planes.length / codes.BYTES_PER_ELEMENT;
    element.remove();
  }
  return data;
}

/** Return the value of a half float's bits. */
function halfValue(bits) {
  const exponent = (bits >> 10) & 31;
  const mantissa = bits & 1023;
  let value = exponent ? (1 + mantissa / 1024) * 2 ** (exponent - 15) : mantissa * 2 ** -24;
  if (exponent === 31) value = mantissa ? NaN : Infinity;
  return bits >> 15 ? -value : value;
}

/** Decode sRGB in [0, 1] to linear light, as IEC 61966-2-1 says. */
function srgbToLinear(value) {
  return value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4;
}

const tables = new Map();

/** Return the values of stored half floats or codes; null for types that store values. linear: of sRGB-encoded colors. */
function valueTable(type, linear) {
  const largest = { half: 65535, u8: 255, u16: 65535 }[type];
  if (!largest) return null;
  const key = `${type} ${linear}`;
  if (!tables.has(key)) {
    const decoded = (code) => (linear ? srgbToLinear(code / largest) : code / largest);
    const value = type === "half" ? halfValue : decoded;
    tables.set(key, Float32Array.from({ length: largest + 1 }, (_, code) => value(code)));
  }
  return tables.get(key);
}

/**
 * One channel. type: half (bits in a Uint16Array), float, uint, or u8 and u16 for the codes of a PNG.
 * data: values as stored, row by row from the top; null until `load` has decoded them.
 */
class Channel {
  /** given: a typed array (Float32Array, Uint32Array, Uint16Array of half floats, Uint8Array), or {type, load}. */
  constructor(name, given) {
    this.name = name;
    this.type = given.type ?? { Float32Array: "float", Uint32Array: "uint", Uint16Array: "half", Uint8Array: "u8" }[
      given.constructor.name];
    if (!ARRAYS[this.type]) throw new TypeError(`channel ${name}: expected a Float32Array, Uint32Array, Uint16Array ` +
      `or Uint8Array, found ${given.constructor.name}`);
    this.data = given.load ? null : given.data ?? given;
    this.decode = given.load;
    this.texture = null; // the display's
  }

  get isWhole() {
    return this.type === "uint";
  }

  async load() {
    if (this.data) return;
    this.pending ??= this.decode();
    this.data = await this.pending;
  }

  /** Return a function from a pixel's index to its value; `linear`: of codes of colors the linear light. */
  reader(linear = false) {
    const data = this.data;
    const table = valueTable(this.type, linear && this.type !== "half");
    return table ? (index) => table[data[index]] : (index) => data[index];
  }
}
