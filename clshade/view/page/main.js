"use strict";
// Puts the page together, and shows the images that it holds.

const MOST_DECODED = 2 ** 30; // bytes that are decoded before they are needed

function startViewer(manifest) {
  const colormaps = Object.fromEntries(Object.entries(manifest.colormaps).map(([name, text]) => [name, bytesOf(text)]));
  const longest = Math.max(1, ...manifest.images.flatMap(({ width, height }) => [width, height]));
  let canvas = document.getElementById("picture");
  let display = WebGlDisplay.create(canvas, colormaps, longest);
  if (!display) {
    const fresh = canvas.cloneNode(); // a canvas keeps its first kind of context
    canvas.replaceWith(fresh);
    canvas = fresh;
    display = new CanvasDisplay(canvas, colormaps);
  }
  const started = new Viewer(canvas, document.getElementById("overlay"), display, manifest.settings);
  const panels = new Panels(started, manifest.title);
  new LayerTable(started);
  attachKeys(started);
  if (display instanceof CanvasDisplay) {
    const size = longest > 1 ? ` for images of ${longest} pixels a side` : "";
    panels.notice(`No WebGL 2${size} in this browser: drawn without it, in 8 bits.`);
  }
  return started;
}

/** Add the images of the page; their channels are decoded when they are drawn. */
function addImages(viewer, manifest) {
  for (const { name, width, height, channels, info } of manifest.images) {
    viewer.setImage(name, { width, height, info, channels: Object.fromEntries(channels.map(({ name: channel, type, chunks }) => [
      channel, { type, load: () => decodeBlocks(type, chunks, width * height) }])) });
  }
}

/** Decode the channels that are not drawn yet, for the probe, one after another. */
async function decodeOthers(viewer) {
  let bytes = 0;
  for (const image of [...viewer.images.values()]) {
    for (const channel of image.channels.values()) {
      bytes += image.width * image.height * ARRAYS[channel.type].BYTES_PER_ELEMENT;
      if (bytes > MOST_DECODED) return;
      await channel.load();
      viewer.dispatchEvent(new Event("hover"));
    }
  }
}

const manifest = JSON.parse(document.getElementById("manifest").textContent);
const viewer = startViewer(manifest);
addImages(viewer, manifest);
viewer.addEventListener("drawn", function first() {
  if (!viewer.drawn) return;
  viewer.removeEventListener("drawn", first);
  document.documentElement.dataset.ready = "true";
  setTimeout(() => decodeOthers(viewer).catch((error) => viewer.failed(error)), 100);
});
viewer.canvas.focus({ preventScroll: true });
