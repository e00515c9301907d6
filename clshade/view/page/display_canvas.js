"use strict";
// The display without WebGL 2: 8 bits, by the processor, each pixel of the canvas from the nearest of the image.

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

  replaceChannel() {}

  dropChannel() {}
}

/** Return a color as the bytes R, G, B, 255 of a little-endian number. */
function packed([r, g, b]) {
  return (0xff000000 | (b << 16) | (g << 8) | r) >>> 0;
}
