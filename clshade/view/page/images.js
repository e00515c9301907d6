"use strict";
// Images: channels, whose values are decoded from the page's blocks when they are first needed, and their layers.

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

/** Write into `values`, unsigned integers, from `start` on what byte planes of consecutive differences say. */
function sumDifferences(planes, values, start) {
  const size = values.BYTES_PER_ELEMENT;
  const count = planes.length / size;
  for (let i = 0, sum = 0; i < count; i++) {
    for (let k = 0; k < size; k++) sum += planes[k * count + i] << (8 * k);
    sum |= 0;
    values[start + i] = sum; // modulo 2^bits
  }
}

/** Decode the page's blocks of these numbers to an array of a type, and remove them from the page. */
async function decodeBlocks(type, numbers, count) {
  const data = new ARRAYS[type](count);
  const codes = data instanceof Float32Array ? new Uint32Array(data.buffer) : data;
  let start = 0;
  for (const number of numbers) {
    const find = () => document.getElementById(`chunk-${number}`);
    // Those that are not drawn at first stand behind the scripts. The parser may be in the middle of a block until another
    // follows it.
    if (document.readyState === "loading" && !find()?.nextElementSibling)
      await new Promise((resolve) => document.addEventListener("DOMContentLoaded", resolve, { once: true }));
    const element = find();
    const inflating = new Blob([bytesOf(element.textContent)]).stream().pipeThrough(new DecompressionStream("deflate"));
    const planes = new Uint8Array(await new Response(inflating).arrayBuffer());
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

const FAMILIES = ["RGB", "XYZ", "UVW"]; // components that belong together, by the last part of a channel's name
const KIND = { color: 0, quantity: 1, direction: 2, numbers: 3, position: 4, coordinates: 5 };

/** Group channel names into layers, as clshade.images.image_file does: [{name, family, channels}]. */
function groupChannels(names) {
  const groups = new Map(); // prefix and family -> letter -> name
  for (const name of names) {
    const dot = name.lastIndexOf(".");
    const prefix = dot < 0 ? "" : name.slice(0, dot);
    const letter = name.slice(dot + 1).toUpperCase();
    const family = letter.length === 1 ? FAMILIES.find((candidate) => candidate.includes(letter)) ?? "" : "";
    const key = JSON.stringify(family ? [prefix, family] : [name, ""]);
    if (!groups.has(key)) groups.set(key, { prefix, family, members: new Map() });
    const { members } = groups.get(key);
    members.set(family && !members.has(letter) ? letter : name, name);
  }
  const all = new Set(names);
  const layers = new Map();
  const add = (title, family, channels) => {
    while (layers.has(title)) title += "'";
    layers.set(title, { name: title, family, channels });
  };
  for (const { prefix, family, members } of groups.values()) {
    const letters = [...family].filter((letter) => members.has(letter));
    const together = letters.length > 1 ? letters.map((letter) => members.get(letter)) : [];
    if (together.length) {
      const title = prefix || letters.join("");
      add(all.has(title) ? `${title}.${letters.join("")}` : title, family, together);
    }
    for (const name of members.values()) if (!together.includes(name)) add(name, "", [name]);
  }
  return [...layers.values()];
}

/** Return the layer that is the image, as clshade.images.image_file.color_group does; null without one. */
function colorLayer(layers) {
  const colors = layers.filter((layer) => layer.family === "RGB" && layer.channels.length === 3);
  const gray = (name) => layers.find((layer) => layer.name === name && layer.channels.length === 1);
  return colors.find((layer) => layer.name === "RGB") ?? gray("Y") ?? gray("L") ?? colors[0] ?? null;
}

/** An image: its channels, layers and what is known about it. */
class HdrImage {
  /** given: {width, height, channels: name -> typed array or {type, load}, info: {encoded, header, names}}. */
  constructor(name, { width, height, channels, info = {} }) {
    this.name = name;
    this.width = width;
    this.height = height;
    this.info = { encoded: false, header: {}, names: {}, ...info };
    this.channels = new Map(Object.entries(channels).map(([channel, given]) => [channel, new Channel(channel, given)]));
    for (const channel of this.channels.values()) {
      if (channel.data && channel.data.length !== width * height)
        throw new RangeError(`channel ${channel.name}: expected ${width * height} values, found ${channel.data.length}`);
    }
    this.layers = groupChannels([...this.channels.keys()]);
    this.color = colorLayer(this.layers);
    for (const layer of this.layers) {
      const planes = layer.channels.map((channel) => this.channels.get(channel));
      Object.assign(layer, { image: this, planes, statistics: null });
    }
  }

  layer(name) {
    return this.layers.find((layer) => layer.name === name) ?? null;
  }

  /** Return whether a layer's values are sRGB-encoded colors. */
  isEncoded(layer) {
    return this.info.encoded && (layer === this.color || layer.family === "RGB");
  }

  contains(x, y) {
    return x >= 0 && y >= 0 && x < this.width && y < this.height;
  }

  /** Return the name that a number of a layer has, or "". */
  nameOf(layer, number) {
    const names = this.info.names[layer.name];
    return names && Object.hasOwn(names, number) ? names[number] : "";
  }
}

/** Return whether the channels of a layer are decoded. */
function isLoaded(layer) {
  return layer.planes.every((plane) => plane.data);
}

/** Return how a layer is shown. Its channels are loaded; X, Y, Z of length 1 are directions, others positions. */
function kindOf(layer) {
  if (layer.planes.some((plane) => plane.isWhole)) return KIND.numbers;
  if (layer.family === "RGB" || layer === layer.image.color) return KIND.color;
  if (layer.planes.length === 1) return KIND.quantity;
  if (layer.family === "UVW") return KIND.coordinates;
  return layer.planes.length === 3 && areDirections(layer.planes) ? KIND.direction : KIND.position;
}

/** Return whether vectors have length 1 within 0.01, but for any number of zeros; not if all are 0. */
function areDirections(planes) {
  const [x, y, z] = planes.map((plane) => plane.reader());
  const count = planes[0].data.length;
  const step = Math.max(1, Math.floor(count / SAMPLED));
  let some = false;
  for (let i = 0; i < count; i += step) {
    const length = Math.hypot(x(i), y(i), z(i));
    if (length === 0) continue;
    if (!(Math.abs(length - 1) <= 0.01)) return false;
    some = true;
  }
  return some;
}
