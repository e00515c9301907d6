"use strict";
// The display by WebGL 2, with channels as textures in their type: one value a texel.

const MAX_TEXTURES = 48; // as large as an image; the least recently used go first

class WebGlDisplay {
  /** Return the display, or null without WebGL 2 or where its textures have less than `longest` pixels a side. */
  static create(canvas, colormaps, longest) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false, preserveDrawingBuffer: true });
    if (!gl) return null;
    if (gl.getParameter(gl.MAX_TEXTURE_SIZE) >= longest) return new WebGlDisplay(gl, canvas, colormaps);
    gl.getExtension("WEBGL_lose_context")?.loseContext();
    return null;
  }

  constructor(gl, canvas, colormaps) {
    this.gl = gl;
    this.canvas = canvas;
    this.colormaps = colormaps;
    this.prepare();
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.prepare();
      this.onrestored?.();
    });
  }

  prepare() {
    const { gl } = this;
    const source = ["tonemap.glsl", "display.glsl"].map((name) => document.getElementById(name).textContent).join("\n");
    const precision = ["float", "int", "sampler2D", "usampler2D"].map((type) => `precision highp ${type};\n`).join("");
    const corners = "void main() { gl_Position = vec4(gl_VertexID == 1 ? 3 : -1, gl_VertexID == 2 ? 3 : -1, 0, 1); }";
    this.program = gl.createProgram();
    for (const [type, text] of [[gl.VERTEX_SHADER, corners], [gl.FRAGMENT_SHADER, precision + source]]) {
      const shader = gl.createShader(type);
      gl.shaderSource(shader, `#version 300 es\n${text}`);
      gl.compileShader(shader);
      const failed = !gl.getShaderParameter(shader, gl.COMPILE_STATUS);
      if (failed && !gl.isContextLost()) throw new Error(gl.getShaderInfoLog(shader));
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    gl.useProgram(this.program);
    gl.bindVertexArray(gl.createVertexArray());
    this.places = new Map();
    this.formats = { // internal format, format and type
      half: [gl.R16F, gl.RED, gl.HALF_FLOAT],
      float: [gl.R32F, gl.RED, gl.FLOAT],
      uint: [gl.R32UI, gl.RED_INTEGER, gl.UNSIGNED_INT],
      colors: [gl.RGB8, gl.RGB, gl.UNSIGNED_BYTE],
    };
    this.held = new Set(); // channels with a texture of this context, least recently used first
    this.empty = this.texture("float", 1, 1, new Float32Array(1));
    this.emptyNumber = this.texture("uint", 1, 1, new Uint32Array(1));
    const maps = Object.entries(this.colormaps);
    this.maps = Object.fromEntries(maps.map(([name, bytes]) => [name, this.texture("colors", 256, 1, bytes)]));
    ["planesA", "planesB", "numbersA", "numbersB"].forEach((name, k) => {
      gl.uniform1iv(this.place(name), [3 * k, 3 * k + 1, 3 * k + 2]);
    });
    gl.uniform1i(this.place("colormap"), 12);
  }

  place(name) {
    if (!this.places.has(name)) this.places.set(name, this.gl.getUniformLocation(this.program, name));
    return this.places.get(name);
  }

  texture(type, width, height, data) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texStorage2D(gl.TEXTURE_2D, 1, this.formats[type][0], width, height);
    this.upload(type, width, height, data);
    return texture;
  }

  upload(type, width, height, data) {
    const [, format, component] = this.formats[type];
    this.gl.texSubImage2D(this.gl.TEXTURE_2D, 0, 0, 0, width, height, format, component, data);
  }

  /** Return the texture of a channel, made when it is drawn, kept for the next time. */
  channelTexture(channel, shown) {
    const type = shown.kind === KIND.numbers ? "uint" : channel.type === "half" ? "half" : "float";
    const { width, height } = shown.image;
    const key = `${type} ${width} ${height} ${shown.isEncoded}`;
    if (channel.texture?.owner !== this.held || channel.texture.key !== key) {
      this.dropChannel(channel);
      const handle = this.texture(type, width, height, texels(channel, shown, type));
      channel.texture = { owner: this.held, key, handle, data: channel.data };
    } else if (channel.texture.data !== channel.data) {
      this.gl.bindTexture(this.gl.TEXTURE_2D, channel.texture.handle);
      this.upload(type, width, height, texels(channel, shown, type));
      channel.texture.data = channel.data;
    }
    this.held.delete(channel);
    this.held.add(channel);
    return channel.texture.handle;
  }

  bind(unit, texture) {
    this.gl.activeTexture(this.gl.TEXTURE0 + unit);
    this.gl.bindTexture(this.gl.TEXTURE_2D, texture);
  }

  bindImage(letter, unit, shown) {
    const { gl } = this;
    const planes = shown ? shown.three() : [null, null, null];
    const numbers = shown?.kind === KIND.numbers;
    planes.forEach((plane, k) => {
      gl.activeTexture(gl.TEXTURE0 + unit + k); // an upload binds its texture here
      const texture = plane && this.channelTexture(plane, shown);
      this.bind(unit + k, !numbers && texture ? texture : this.empty);
      this.bind(unit + 6 + k, numbers && texture ? texture : this.emptyNumber);
    });
    gl.uniform2i(this.place(`size${letter}`), shown?.image.width ?? 0, shown?.image.height ?? 0);
    gl.uniform1i(this.place(`kind${letter}`), shown?.kind ?? 0);
    gl.uniform1i(this.place(`count${letter}`), shown?.count ?? 0);
    const ranges = [0, 1, 2].map((k) => shown?.ranges[Math.min(k, shown.ranges.length - 1)] ?? [0, 1]);
    gl.uniform3fv(this.place(`low${letter}`), ranges.map(([low]) => low));
    gl.uniform3fv(this.place(`high${letter}`), ranges.map(([, high]) => high));
  }

  /** Draw an image and, where it is given, a reference. view: {x, y, zoom} in pixels of the canvas. */
  draw(shown, reference, view, settings) {
    const { gl, canvas } = this;
    if (gl.isContextLost()) return;
    gl.viewport(0, 0, canvas.width, canvas.height);
    if (!shown) {
      gl.clearColor(...GROUND.map((code) => code / 255), 1);
      gl.clear(gl.COLOR_BUFFER_BIT);
      return;
    }
    this.bindImage("A", 0, shown);
    this.bindImage("B", 3, reference);
    this.bind(12, this.maps[settings.inStops && (shown.kind === KIND.color || settings.metric) ? "stops" : "quantity"]);
    gl.uniform2f(this.place("origin"), view.x, view.y);
    gl.uniform1f(this.place("zoom"), view.zoom);
    gl.uniform1f(this.place("height"), canvas.height);
    gl.uniform1f(this.place("wipe"), settings.wipe ?? canvas.width);
    gl.uniform1i(this.place("metric"), 1 + MEASURES.findIndex(({ value }) => value === settings.metric));
    gl.uniform1i(this.place("operator"), OPERATORS.indexOf(settings.operator));
    gl.uniform1f(this.place("gain"), 2 ** settings.exposure);
    gl.uniform1i(this.place("marking"), settings.marking);
    gl.uniform1i(this.place("inStops"), settings.inStops);
    gl.uniform1i(this.place("asLuminance"), shown.asLuminance);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    for (const channel of this.held) if (this.held.size > MAX_TEXTURES) this.dropChannel(channel);
  }

  /** Give the texture of a channel that is replaced to its successor. */
  replaceChannel(channel, successor) {
    if (channel.texture?.owner !== this.held) return;
    successor.texture = channel.texture;
    channel.texture = null;
    this.held.delete(channel);
    this.held.add(successor);
  }

  dropChannel(channel) {
    if (channel.texture?.owner === this.held) this.gl.deleteTexture(channel.texture.handle);
    channel.texture = null;
    this.held.delete(channel);
  }
}

/** Return a channel's values as a texture of this type takes them. */
function texels(channel, shown, type) {
  if (channel.type === type) return channel.data;
  const read = channel.reader(shown.isEncoded);
  const values = new (type === "uint" ? Uint32Array : Float32Array)(channel.data.length);
  for (let i = 0; i < values.length; i++) values[i] = type === "uint" ? wholeOf(read(i)) : read(i);
  return values;
}
