"use strict";
// Where the image lies on the canvas: fit, pan and zoom.

const MOST_ZOOM = 256; // CSS pixels per pixel of the image

/** Call a function whenever a CSS pixel gets another number of pixels, as when the window moves to another screen. */
function onRatioChange(changed) {
  const query = matchMedia(`(resolution: ${window.devicePixelRatio}dppx)`);
  query.addEventListener("change", () => {
    onRatioChange(changed);
    changed();
  }, { once: true });
}

/** The part of the viewer that knows the place of the image. view: {x, y} of its top left corner, and zoom, in pixels of
 * the canvas. */
class Viewport extends EventTarget {
  constructor(canvas) {
    super();
    this.canvas = canvas;
    this.view = { x: 0, y: 0, zoom: 1 };
    this.fitted = true;
    this.fill = 0.96; // of the canvas, by an image that is fitted
    this.ratio = window.devicePixelRatio; // pixels of the canvas per CSS pixel, as it was sized last
  }

  /** Return a mouse event's place in pixels of the canvas. */
  canvasPoint(event) {
    const box = this.canvas.getBoundingClientRect();
    return { x: (event.clientX - box.left) * this.ratio, y: (event.clientY - box.top) * this.ratio };
  }

  /** Return the image's pixel at a mouse event, which may lie outside of the image. */
  pixelAt(event) {
    const { x, y } = this.canvasPoint(event);
    return { x: Math.floor((x - this.view.x) / this.view.zoom), y: Math.floor((y - this.view.y) / this.view.zoom) };
  }

  /** Show the whole image, at most at 16 times its size. */
  fit() {
    const { width, height } = this.canvas;
    const image = this.image ?? { width: 1, height: 1 };
    const zoom = Math.min(width / image.width, height / image.height) * this.fill;
    this.view.zoom = zoom > 2 ? Math.min(Math.floor(zoom), 16 * this.ratio) : zoom; // pixels of equal size
    this.center();
    this.fitted = true;
    this.changed();
  }

  center() {
    const image = this.image ?? { width: 1, height: 1 };
    const { zoom } = this.view;
    this.view.x = Math.round((this.canvas.width - image.width * zoom) / 2);
    this.view.y = Math.round((this.canvas.height - image.height * zoom) / 2);
  }

  actualSize(point) {
    this.zoomBy(1 / this.view.zoom, point);
  }

  toggleActualSize(point) {
    if (this.view.zoom === 1) this.fit();
    else this.actualSize(point);
  }

  zoomBy(factor, point = { x: this.canvas.width / 2, y: this.canvas.height / 2 }) {
    const least = 1 / Math.max(this.image?.width ?? 1, this.image?.height ?? 1);
    let zoom = Math.max(least, Math.min(MOST_ZOOM * this.ratio, this.view.zoom * factor));
    if (Math.abs(zoom - 1) < 1e-3) zoom = 1;
    const { x, y, zoom: before } = this.view;
    this.view = { x: point.x - ((point.x - x) / before) * zoom, y: point.y - ((point.y - y) / before) * zoom, zoom };
    if (zoom >= 1) [this.view.x, this.view.y] = [Math.round(this.view.x), Math.round(this.view.y)];
    this.fitted = false;
    this.changed();
  }

  pan(x, y) {
    this.view.x += x;
    this.view.y += y;
    this.fitted = false;
    this.changed();
  }
}
