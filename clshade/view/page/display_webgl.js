"use strict";
// The display by WebGL 2.

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
    this.textures = new Textures(gl);
    this.maps = {};
    for (const [name, bytes] of Object.entries(this.colormaps)) this.maps[name] = this.colormapTexture(bytes);
    ["planesA", "planesB", "numbersA", "numbersB"].forEach((name, k) => {
      gl.uniform1iv(this.place(name), [3 * k, 3 * k + 1, 3 * k + 2]);
    });
    gl.uniform1i(this.place("colormap"), 12);
  }

  place(name) {
    if (!this.places.has(name)) this.places.set(name, this.gl.getUniformLocation(this.program, name));
    return this.places.get(name);
  }

  colormapTexture(bytes) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, 256, 1, 0, gl.RGB, gl.UNSIGNED_BYTE, bytes);
    return texture;
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
      const texture = plane && this.textures.of(plane, shown);
      this.bind(unit + k, !numbers && texture ? texture : this.textures.empty.plane);
      this.bind(unit + 6 + k, numbers && texture ? texture : this.textures.empty.number);
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
    gl.uniform1i(this.place("metric"), METRICS[settings.metric] ?? 0);
    gl.uniform1i(this.place("operator"), OPERATORS.indexOf(settings.operator));
    gl.uniform1f(this.place("gain"), 2 ** settings.exposure);
    gl.uniform1i(this.place("marking"), settings.marking);
    gl.uniform1i(this.place("inStops"), settings.inStops);
    gl.uniform1i(this.place("asLuminance"), shown.asLuminance);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    this.textures.dropOldest();
  }

  replaceChannel(channel, successor) {
    this.textures.pass(channel, successor);
  }

  dropChannel(channel) {
    this.textures.drop(channel);
  }
}
