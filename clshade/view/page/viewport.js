"use strict";
// Where the image lies on the canvas: fit, pan and zoom, by mouse, pen and touch.

const MAX_ZOOM = 256; // CSS pixels per pixel of the image
const CLICK_DISTANCE = 4; // CSS pixels; a longer way is a drag

/** Call a function whenever a CSS pixel gets another number of pixels, as when the window moves to another screen. */
function onRatioChange(changed) {
  const query = matchMedia(`(resolution: ${window.devicePixelRatio}dppx)`);
  query.addEventListener("change", () => {
    onRatioChange(changed);
    changed();
  }, { once: true });
}

/** The part of the viewer that places the image. view: x and y of its top left corner, and zoom, in pixels of the canvas. */
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
    this.view.x = Math.round((width - image.width * this.view.zoom) / 2);
    this.view.y = Math.round((height - image.height * this.view.zoom) / 2);
    this.fitted = true;
    this.changed();
  }

  toggleActualSize(point) {
    if (this.view.zoom === 1) this.fit();
    else this.zoomBy(1 / this.view.zoom, point);
  }

  zoomBy(factor, point = { x: this.canvas.width / 2, y: this.canvas.height / 2 }) {
    const minZoom = 1 / Math.max(this.image?.width ?? 1, this.image?.height ?? 1);
    let zoom = Math.max(minZoom, Math.min(MAX_ZOOM * this.ratio, this.view.zoom * factor));
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

/** Return how far the wheel of a mouse was turned, at most 240 pixels. */
function wheelPixels(event) {
  return Math.max(-240, Math.min(240, event.deltaY * [1, 20, 200][event.deltaMode]));
}

/** Attach mouse, pen and touch to a viewer. */
function attachNavigation(viewer) {
  const { canvas } = viewer;
  const touches = new Map();
  let drag = null;

  const taken = (event) => viewer.onpointer?.(event, viewer.pixelAt(event)) === true;
  const isOnLine = (event) => {
    const x = viewer.wipeX();
    return x !== null && Math.abs(viewer.canvasPoint(event).x - x) < 12 * viewer.ratio;
  };

  canvas.addEventListener("pointerdown", (event) => {
    canvas.focus({ preventScroll: true });
    if (taken(event) || event.button > 1) return;
    canvas.setPointerCapture(event.pointerId);
    touches.set(event.pointerId, event);
    const { clientX: x, clientY: y } = event;
    drag = { onLine: isOnLine(event), startX: x, startY: y, x, y, click: touches.size === 1 };
  });
  canvas.addEventListener("pointermove", (event) => {
    if (taken(event)) return;
    viewer.hover(viewer.pixelAt(event), event);
    if (!drag || !touches.has(event.pointerId)) {
      canvas.style.cursor = isOnLine(event) ? "ew-resize" : "";
      return;
    }
    if (Math.hypot(event.clientX - drag.startX, event.clientY - drag.startY) > CLICK_DISTANCE) drag.click = false;
    if (touches.size === 2) pinch(event);
    else if (drag.onLine) viewer.setWipe(viewer.canvasPoint(event).x / canvas.width);
    else if (!drag.click) viewer.pan((event.clientX - drag.x) * viewer.ratio, (event.clientY - drag.y) * viewer.ratio);
    touches.set(event.pointerId, event);
    if (!drag.click) Object.assign(drag, { x: event.clientX, y: event.clientY });
  });
  const end = (event) => {
    touches.delete(event.pointerId);
    if (taken(event)) return;
    if (event.type === "pointerup" && drag?.click && !drag.onLine) viewer.pin(viewer.pixelAt(event));
    drag = null;
  };
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("pointercancel", end);
  canvas.addEventListener("pointerleave", () => viewer.hover(null));
  canvas.addEventListener("dblclick", (event) => viewer.toggleActualSize(viewer.canvasPoint(event)));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    if (taken(event)) return;
    viewer.zoomBy(2 ** (-wheelPixels(event) / 240), viewer.canvasPoint(event));
  }, { passive: false });

  /** Zoom by two fingers, one of which has moved. */
  function pinch(event) {
    const other = [...touches.values()].find((touch) => touch.pointerId !== event.pointerId);
    const before = touches.get(event.pointerId);
    const distance = (touch) => Math.hypot(touch.clientX - other.clientX, touch.clientY - other.clientY);
    const middle = { clientX: (event.clientX + other.clientX) / 2, clientY: (event.clientY + other.clientY) / 2 };
    viewer.pan((event.clientX - before.clientX) * viewer.ratio / 2, (event.clientY - before.clientY) * viewer.ratio / 2);
    if (distance(before) > 1) viewer.zoomBy(distance(event) / distance(before), viewer.canvasPoint(middle));
  }
}
