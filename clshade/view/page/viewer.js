"use strict";
// The viewer: images, what is selected, where they lie on the canvas, and drawing when something has changed.

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

const MODES = [
  { value: "single", label: "Image", title: "The image alone" },
  { value: "wipe", label: "Wipe", title: "The image left of a line, the reference right of it (C)" },
  { value: "flicker", label: "Flicker", title: "Both in turn (Space)" },
  { value: "difference", label: "Difference", title: "How far the image is from the reference (Ctrl ← →: which measure)" },
];
const MEASURES = [
  { value: "absolute", label: "|A−B|" },
  { value: "squared", label: "(A−B)²" },
  { value: "relative", label: "|A−B| / |B|", title: "|A−B| / (|B| + 0.01)" },
];
const FLICKER_MS = 500;
const SETTINGS = { exposure: 0, operator: "srgb", marking: true, inStops: false };
const MAX_EXPOSURE = 100; // stops

/**
 * Shows images. Events: `change` after any of its state, `hover` when the probed pixel changes, `statistics` when those
 * of the layer are there.
 *
 * canvas: what takes pointer events. onpointer: a function of a pointer or wheel event and {x, y} of the pixel below it,
 * which may lie outside of the image; where it returns true, the viewer itself does nothing.
 */
class Viewer extends Viewport {
  /** settings: exposure and operator at first. */
  constructor(canvas, overlay, display, settings) {
    super(canvas);
    this.overlay = new Overlay(overlay);
    this.display = display;
    this.display.onrestored = () => this.requestDraw();
    this.onpointer = null;
    this.images = new Map();
    this.selected = null; // names of images
    this.reference = null;
    this.layerName = null; // null: the image's color
    this.component = null; // index, "luminance" or null for all
    this.initial = { ...SETTINGS, ...settings };
    this.settings = { ...this.initial };
    this.ranges = new Map(); // layer's name and component -> [low, high] chosen
    this.mode = "single";
    this.metric = "absolute";
    this.wipeAt = 0.5; // of the canvas's width
    this.hovered = null;
    this.pinned = null;
    this.held = null; // "A" or "B" while a key is held
    this.flickered = false;
    this.border = false;
    this.statisticsTime = 0; // when they were computed last
    new ResizeObserver(() => this.resized()).observe(canvas.parentElement);
    onRatioChange(() => this.resized());
    attachNavigation(this);
  }

  // Images

  /** Add an image, or replace the one of this name in place; selection, zoom and exposure stay. Returns it. */
  setImage(name, description) {
    const image = new HdrImage(name, description);
    const before = this.images.get(name);
    for (const layer of before ? image.layers : []) {
      const earlier = before.layer(layer.name);
      if (earlier?.channels.join("\0") !== layer.channels.join("\0")) continue;
      Object.assign(layer, { statistics: earlier.statistics, full: earlier.full, stale: true });
      layer.planes.forEach((plane, k) => this.display.replaceChannel?.(earlier.planes[k], plane));
    }
    for (const channel of before?.channels.values() ?? []) this.display.dropChannel?.(channel);
    this.images.set(name, image);
    this.selected ??= name;
    if (name !== this.selected) this.reference ??= name;
    if (this.fitted && !before && this.images.size === 1) this.fit();
    const resized = before && (before.width !== image.width || before.height !== image.height);
    if (resized && name === this.selected && this.fitted) this.fit();
    this.changed();
    if (this.probed) this.dispatchEvent(new Event("hover"));
    return image;
  }

  get image() {
    return this.images.get(this.selected) ?? null;
  }

  get referenceImage() {
    return this.images.get(this.reference) ?? null;
  }

  /** Change part of the state, such as { metric } or { component }. */
  choose(changes) {
    Object.assign(this, changes);
    this.changed();
  }

  select(name) {
    if (this.images.has(name)) this.choose({ selected: name });
  }

  setReference(name) {
    if (this.images.has(name)) this.choose({ reference: name, mode: this.mode === "single" ? "wipe" : this.mode });
  }

  setMode(mode) {
    this.mode = mode !== "single" && !this.referenceImage ? "single" : mode;
    clearInterval(this.timer);
    this.flickered = false;
    if (this.mode === "flicker") {
      this.timer = setInterval(() => {
        this.choose({ flickered: !this.flickered });
      }, FLICKER_MS);
    }
    this.changed();
  }

  /** Show the image or its reference alone while a key is held: "A", "B" or null. */
  hold(which) {
    if (which !== this.held && (!which || this.referenceImage)) this.choose({ held: which });
  }

  // Layers

  /** Return the selected layer of an image, or its color, or its first layer where it has none of this name. */
  layerOf(image) {
    return image ? (image.layer(this.layerName) ?? image.color ?? image.layers[0] ?? null) : null;
  }

  setLayer(name) {
    this.choose({ layerName: name, component: null });
  }

  rangeKey() {
    return `${this.component ?? ""} ${this.layerOf(this.image)?.name}`;
  }

  /** Set the range of the layer's colors; null: that of its values. */
  setRange(range) {
    if (range) this.ranges.set(this.rangeKey(), range);
    else this.ranges.delete(this.rangeKey());
    this.changed();
  }

  // Settings

  set(changes) {
    Object.assign(this.settings, changes);
    this.settings.exposure = Math.max(-MAX_EXPOSURE, Math.min(MAX_EXPOSURE, Number(this.settings.exposure) || 0));
    this.changed();
  }

  reset() {
    this.ranges.clear();
    this.set({ ...this.initial });
  }

  /** Set the exposure at which the brightest finite value of the layer is 1. */
  normalize() {
    const high = this.layerOf(this.image)?.full?.high;
    if (high > 0 && Number.isFinite(high)) this.set({ exposure: Math.round(-Math.log2(high) * 100) / 100 });
  }

  // Comparison

  setWipe(fraction) {
    this.choose({ wipeAt: Math.max(0, Math.min(1, fraction)) });
  }

  /** Return x of the wipe's line in pixels of the canvas, or null. */
  wipeX() {
    return this.mode === "wipe" && !this.held && this.referenceImage ? this.wipeAt * this.canvas.width : null;
  }

  // Probe

  /** Return the pixel that is probed: the pinned one, else the one below the pointer; null outside of the image. */
  get probed() {
    return this.pinned ?? this.hovered;
  }

  hover(pixel, event = null) {
    this.pointer = event;
    this.hovered = pixel && this.image?.contains(pixel.x, pixel.y) ? pixel : null;
    this.dispatchEvent(new Event("hover"));
  }

  /** Pin a pixel, or release the pinned one: null, the same again, or one outside of the image. */
  pin(pixel) {
    const same = pixel && this.pinned && pixel.x === this.pinned.x && pixel.y === this.pinned.y;
    this.pinned = pixel && !same && this.image?.contains(pixel.x, pixel.y) ? pixel : null;
    this.changed();
    this.dispatchEvent(new Event("hover"));
  }

  // Drawing

  changed() {
    this.requestDraw();
    this.dispatchEvent(new Event("change"));
  }

  resized() {
    const box = this.canvas.parentElement.getBoundingClientRect();
    this.ratio = window.devicePixelRatio;
    const [width, height] = [box.width, box.height].map((side) => Math.max(1, Math.round(side * this.ratio)));
    for (const canvas of [this.canvas, this.overlay.canvas]) Object.assign(canvas, { width, height });
    if (this.fitted) this.fit();
    this.draw(); // at once: a resized canvas is blank
    this.dispatchEvent(new Event("resized"));
  }

  requestDraw() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = null;
      this.draw();
    });
  }

  /** Return what is drawn of an image, or null until it is decoded, after which it is drawn again. */
  shownOf(image) {
    const layer = this.layerOf(image);
    if (!layer) return null;
    if (!isLoaded(layer)) {
      Promise.all(layer.planes.map((plane) => plane.load())).then(() => this.changed(), (error) => this.failed(error));
      return null;
    }
    layer.statistics ??= quickStatistics(layer);
    if (!layer.full || layer.stale) this.scheduleStatistics();
    return new Shown(layer, this.component, this.ranges.get(this.rangeKey()));
  }

  failed(error) {
    this.dispatchEvent(new CustomEvent("notice", { detail: `The page's data is damaged: ${error.message}` }));
  }

  /** Return the image that is visible alone now, or null where two are. */
  get soleImage() {
    if (this.held === "B" || (this.flickered && !this.held)) return this.referenceImage;
    const isSole = this.held === "A" || this.mode === "single" || this.mode === "flicker" || !this.referenceImage;
    return isSole ? this.image : null;
  }

  draw() {
    const { canvas, view, settings } = this;
    const sole = this.soleImage;
    const shown = this.shownOf(sole ?? this.image);
    const reference = sole ? null : this.shownOf(this.referenceImage);
    if (this.image && (!shown || (!sole && !reference))) return; // what is drawn stays until the data is there
    const wipe = this.wipeX();
    const metric = !sole && this.mode === "difference" ? this.metric : null;
    const all = { ...settings, wipe, metric };
    this.display.draw(shown, reference, view, all);
    const part = (image, reference, from, to) => ({ shown: image, from, to,
      texts: () => pixelTexts(image, reference, metric), colors: () => shader(image, reference, all, this.display.colormaps) });
    const parts = shown ? [part(shown, reference, 0, wipe ?? canvas.width)] : [];
    if (wipe !== null && shown) parts.push(part(reference, null, wipe, canvas.width));
    this.overlay.draw(parts, view, { wipe, pinned: this.pinned, ratio: this.ratio, border: this.border });
    this.drawn = shown;
    this.dispatchEvent(new Event("drawn"));
  }

  /** Compute the layer's statistics soon: of images that follow each other when they pause, or every two seconds. */
  scheduleStatistics() {
    const follows = this.layerOf(this.image)?.stale;
    if (this.statisticsTimer && !(follows && performance.now() - this.statisticsTime < 2000)) return;
    clearTimeout(this.statisticsTimer);
    this.statisticsTimer = setTimeout(() => {
      this.statisticsTimer = null;
      for (const image of [this.image, this.referenceImage]) {
        const layer = this.layerOf(image);
        if (!layer?.statistics || (layer.full && !layer.stale) || !isLoaded(layer)) continue;
        const live = layer.stale;
        layer.statistics = live ? { ...layer.statistics, ...quickStatistics(layer) } : layer.statistics;
        layer.full = fullStatistics(layer);
        layer.stale = false;
        if (live) this.requestDraw();
      }
      this.statisticsTime = performance.now();
      this.dispatchEvent(new Event("statistics"));
    }, follows ? 300 : 50);
  }
}
