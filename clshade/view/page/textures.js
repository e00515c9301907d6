"use strict";
// Channels as WebGL textures, in their own type: one value a texel.

const MOST_TEXTURES = 48; // of an image's size; the least recently used go first

/** Textures of channels, made when they are drawn, kept for the next time. */
class Textures {
  constructor(gl) {
    this.gl = gl;
    this.held = new Set(); // channels, least recently used first
    const [plane, number] = [this.make("float", 1, 1, new Float32Array(1)), this.make("uint", 1, 1, new Uint32Array(1))];
    this.empty = { plane, number };
  }

  format(type) {
    const { gl } = this;
    if (type === "half") return [gl.R16F, gl.RED, gl.HALF_FLOAT];
    if (type === "uint") return [gl.R32UI, gl.RED_INTEGER, gl.UNSIGNED_INT];
    return [gl.R32F, gl.RED, gl.FLOAT];
  }

  make(type, width, height, data) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    const [inner, format, component] = this.format(type);
    gl.texStorage2D(gl.TEXTURE_2D, 1, inner, width, height);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, format, component, data);
    return texture;
  }

  /** Return the texture of a channel; asNumbers: as whole numbers. */
  of(channel, shown) {
    const asNumbers = shown.kind === KIND.numbers;
    const type = asNumbers ? "uint" : channel.type === "half" ? "half" : "float";
    const { width, height } = shown.image;
    const key = `${type} ${width} ${height} ${shown.isEncoded}`;
    let made = channel.texture;
    if (made && (made.owner !== this || (made.key !== key && !this.drop(channel)))) made = null;
    if (!made || made.key !== key) {
      made = { owner: this, key, handle: this.make(type, width, height, texels(channel, shown, type)), data: channel.data };
    } else if (made.data !== channel.data) {
      const [, format, component] = this.format(type);
      this.gl.bindTexture(this.gl.TEXTURE_2D, made.handle);
      this.gl.texSubImage2D(this.gl.TEXTURE_2D, 0, 0, 0, width, height, format, component, texels(channel, shown, type));
      made.data = channel.data;
    }
    channel.texture = made;
    this.held.delete(channel);
    this.held.add(channel);
    return made.handle;
  }

  /** Give the texture of a channel that is replaced to its successor. */
  pass(channel, successor) {
    if (!channel.texture || channel.texture.owner !== this) return;
    successor.texture = channel.texture;
    channel.texture = null;
    this.held.delete(channel);
    this.held.add(successor);
  }

  drop(channel) {
    if (channel.texture?.owner === this) this.gl.deleteTexture(channel.texture.handle);
    channel.texture = null;
    this.held.delete(channel);
  }

  dropOldest() {
    for (const channel of this.held) {
      if (this.held.size <= MOST_TEXTURES) return;
      this.drop(channel);
    }
  }
}

/** Return a channel's values as a texture of this type takes them. */
function texels(channel, shown, type) {
  if (channel.type === type) return channel.data;
  const read = channel.reader(shown.isEncoded);
  const found = new (type === "uint" ? Uint32Array : Float32Array)(channel.data.length);
  for (let i = 0; i < found.length; i++) found[i] = type === "uint" ? wholeOf(read(i)) : read(i);
  return found;
}
