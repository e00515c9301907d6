"use strict";
// Images and their layers: which channels belong together, and how a layer is shown.

const FAMILIES = ["RGB", "XYZ", "UVW"]; // components that belong together, by the last part of a channel's name
const KIND = { color: 0, quantity: 1, direction: 2, numbers: 3, position: 4, coordinates: 5 };

/** Group channel names into layers, as clshade.images.channels does: [{name, family, channels}]. */
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

/** Return the layer that is the image, as clshade.images.channels.color_group does; null without one. */
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
