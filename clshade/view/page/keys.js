"use strict";
// The keyboard, with the keys of the viewer tev where both do alike; and the help that lists them.

const cycle = (list, current, step) => list[(list.indexOf(current) + step + list.length) % list.length];
const moveImage = (viewer, x, y) => viewer.pan(64 * x * viewer.ratio, 64 * y * viewer.ratio);
const zoomIn = (viewer) => viewer.zoomBy(2 ** 0.5);
const zoomOut = (viewer) => viewer.zoomBy(2 ** -0.5);

// Groups of [label, what it does, key -> function of the viewer and the event]; `attachKeys` has the keys without one.
const HELP = [
  ["Image", [
    ["1 … 9", "show the n-th image"],
    ["↑ ↓  or  W S", "previous, next image"],
    ["→ ←  or  D A", "next, previous layer"],
    ["X", "next component of the layer", { x: nextComponent }],
  ]],
  ["Compare", [
    ["Shift 1 … 9", "compare with the n-th image"],
    ["Shift ↑ ↓", "previous, next image to compare with"],
    ["Shift (hold)", "show B alone"],
    ["Ctrl (hold)", "show A alone"],
    ["C", "image, wipe, difference in turn",
      { c: (viewer) => viewer.setMode(cycle(["single", "wipe", "difference"], viewer.mode, 1)) }],
    ["Space", "flicker", { " ": (viewer) => viewer.setMode(viewer.mode === "flicker" ? "single" : "flicker") }],
    ["Ctrl → ←", "measure of the difference"],
  ]],
  ["Exposure and color", [
    ["E, Shift E", "exposure up, down by half a stop",
      { e: (viewer, { shiftKey }) => viewer.set({ exposure: viewer.settings.exposure + (shiftKey ? -0.5 : 0.5) }) }],
    ["N", "exposure at which the brightest value is 1", { n: (viewer) => viewer.normalize() }],
    ["Shift → ←", "next, previous tone map"],
    ["V", "false color in stops", { v: (viewer) => viewer.set({ inStops: !viewer.settings.inStops }) }],
    ["M", "mark NaN, infinite and negative values", { m: (viewer) => viewer.set({ marking: !viewer.settings.marking }) }],
    ["R", "reset exposure, tone map and ranges", { r: (viewer) => viewer.reset() }],
  ]],
  ["View", [
    ["Drag, H J K L", "move the image", {
      h: (viewer) => moveImage(viewer, 1, 0),
      l: (viewer) => moveImage(viewer, -1, 0),
      j: (viewer) => moveImage(viewer, 0, -1),
      k: (viewer) => moveImage(viewer, 0, 1),
    }],
    ["Wheel, + −", "zoom; values are printed in large pixels", { "+": zoomIn, "=": zoomIn, "-": zoomOut, "_": zoomOut }],
    ["0, double click", "one pixel for one; again: fit", { 0: (viewer) => viewer.toggleActualSize() }],
    ["F", "fit", { f: (viewer) => viewer.fit() }],
    ["B (hold)", "border around the image", { b: (viewer) => viewer.choose({ border: true }) }],
    ["Click, Esc", "pin a pixel, release it", { Escape: (viewer) => viewer.pin(null) }],
    ["Ctrl B", "hide or show the panel"],
    ["I", "the file’s header", { i: toggleInfo }],
    ["?", "this list", { "?": toggleHelp }],
  ]],
];

/** Attach the keyboard to a viewer. */
function attachKeys(viewer) {
  const actions = Object.assign({}, ...HELP.flatMap(([, keys]) => keys.map(([, , handlers]) => handlers)));
  const steps = { ArrowUp: -1, w: -1, ArrowDown: 1, s: 1, ArrowLeft: -1, a: -1, ArrowRight: 1, d: 1 };
  const images = () => [...viewer.images.keys()];

  const move = (key, { shiftKey, ctrlKey, metaKey }) => {
    const step = steps[key];
    if (["ArrowUp", "ArrowDown", "w", "s"].includes(key)) {
      if (shiftKey) viewer.setReference(cycle(images(), viewer.reference, step));
      else viewer.select(cycle(images(), viewer.selected, step));
    } else if (ctrlKey || metaKey) {
      if (viewer.mode === "difference") viewer.choose({ metric: cycle(MEASURES.map(({ value }) => value), viewer.metric, step) });
    } else if (shiftKey) {
      viewer.set({ operator: cycle(OPERATORS, viewer.settings.operator, step) });
    } else {
      const names = viewer.image?.layers.map((layer) => layer.name) ?? [];
      if (names.length) viewer.setLayer(cycle(names, viewer.layerOf(viewer.image).name, step));
    }
  };

  document.addEventListener("keydown", (event) => {
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (key === "Shift") viewer.hold("B");
    if (key === "Control") viewer.hold("A");
    const typing = event.target instanceof HTMLInputElement && event.target.type === "number";
    const sliding = event.target instanceof HTMLInputElement && event.target.type === "range" && key.startsWith("Arrow");
    const pressing = key === " " && event.target.matches?.("button, input, summary");
    if (event.altKey || typing || sliding || pressing || document.getElementById("help").open) return;
    const commanded = event.ctrlKey || event.metaKey;
    const digit = /^Digit([1-9])$/.exec(event.code);
    if (digit && !commanded) {
      const name = images()[Number(digit[1]) - 1];
      if (event.shiftKey) viewer.setReference(name);
      else viewer.select(name);
    } else if (commanded && key === "b") document.body.classList.toggle("bare");
    else if (key in steps && !(commanded && key.length === 1)) move(key, event);
    else if (!commanded && Object.hasOwn(actions, key)) actions[key](viewer, event);
    else return;
    if (event.shiftKey || commanded) viewer.hold(null); // the key was part of a shortcut
    event.preventDefault();
  });
  document.addEventListener("keyup", (event) => {
    if (event.key === "Shift" || event.key === "Control") viewer.hold(null);
    if (event.key.toLowerCase() === "b") viewer.choose({ border: false });
  });
  window.addEventListener("blur", () => viewer.hold(null));
  document.getElementById("help-button").addEventListener("click", toggleHelp);
}

function nextComponent(viewer) {
  const layer = viewer.layerOf(viewer.image);
  const choices = [null, ...(layer?.channels.length > 1 ? layer.channels.keys() : [])];
  viewer.choose({ component: cycle(choices, viewer.component, 1) });
}

function toggleInfo() {
  const info = document.getElementById("info");
  info.open = !info.open;
  if (info.open) info.scrollIntoView();
}

function toggleHelp() {
  const dialog = document.getElementById("help");
  if (dialog.open) return dialog.close();
  if (!dialog.childElementCount) {
    const groups = HELP.map(([title, keys]) => create("section", {}, create("h2", { textContent: title }), create("dl", {},
      ...keys.flatMap(([key, what]) => [create("dt", { textContent: key }), create("dd", { textContent: what })]))));
    const close = createButton("×", () => dialog.close(), { className: "close", title: "Close (Esc)", ariaLabel: "Close" });
    dialog.append(close, create("div", { className: "groups" }, ...groups));
    dialog.addEventListener("click", (event) => event.target === dialog && dialog.close());
    dialog.addEventListener("keydown", (event) => event.key === "?" && dialog.close());
  }
  dialog.showModal();
}
