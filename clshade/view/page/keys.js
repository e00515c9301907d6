"use strict";
// The keyboard, with the keys of the viewer tev where this one does the same; and the help that lists them.

const HELP = [
  ["Image", [
    ["1 … 9", "show the n-th image"],
    ["↑ ↓  or  W S", "previous, next image"],
    ["→ ←  or  D A", "next, previous layer"],
    ["X", "next component of the layer"],
  ]],
  ["Compare", [
    ["Shift 1 … 9", "compare with the n-th image"],
    ["Shift ↑ ↓", "previous, next image to compare with"],
    ["Shift (hold)", "show B alone"],
    ["Ctrl (hold)", "show A alone"],
    ["C", "image, wipe, difference in turn"],
    ["Space", "flicker"],
    ["Ctrl → ←", "measure of the difference"],
  ]],
  ["Exposure and color", [
    ["E, Shift E", "exposure up, down by half a stop"],
    ["N", "exposure at which the brightest value is 1"],
    ["Shift → ←", "next, previous tone map"],
    ["V", "false color in stops"],
    ["M", "mark NaN, infinite and negative values"],
    ["R", "reset exposure, tone map and ranges"],
  ]],
  ["View", [
    ["Drag, H J K L", "move the image"],
    ["Wheel, + −", "zoom; values are printed in large pixels"],
    ["0, double click", "one pixel for one; again: fit"],
    ["F", "fit"],
    ["B (hold)", "border around the image"],
    ["Click, Esc", "pin a pixel, release it"],
    ["Ctrl B", "hide or show the panel"],
    ["I", "the file’s header"],
    ["?", "this list"],
  ]],
];

/** Attach the keyboard to a viewer. */
function attachKeys(viewer) {
  const cycle = (list, current, step) => list[(list.indexOf(current) + step + list.length) % list.length];
  const images = () => [...viewer.images.keys()];
  const toStep = { ArrowUp: -1, w: -1, ArrowDown: 1, s: 1, ArrowLeft: -1, a: -1, ArrowRight: 1, d: 1 };

  const move = (key, { shiftKey, ctrlKey, metaKey }) => {
    const step = toStep[key];
    if (["ArrowUp", "ArrowDown", "w", "s"].includes(key)) {
      if (shiftKey) viewer.setReference(cycle(images(), viewer.reference, step));
      else viewer.select(cycle(images(), viewer.selected, step));
    } else if (ctrlKey || metaKey) {
      if (viewer.mode === "difference") viewer.setMetric(cycle(Object.keys(METRICS), viewer.metric, step));
    } else if (shiftKey) {
      viewer.set({ operator: cycle(OPERATORS, viewer.settings.operator, step) });
    } else {
      const names = viewer.image?.layers.map((layer) => layer.name) ?? [];
      if (names.length) viewer.setLayer(cycle(names, viewer.layerOf(viewer.image).name, step));
    }
  };
  const nextComponent = () => {
    const layer = viewer.layerOf(viewer.image);
    const choices = [null, ...(layer?.channels.length > 1 ? layer.channels.keys() : [])];
    viewer.setComponent(cycle(choices, viewer.component, 1));
  };
  const info = document.getElementById("info");
  const pan = (x, y) => viewer.pan(64 * x * viewer.ratio, 64 * y * viewer.ratio);
  const single = {
    e: (event) => viewer.set({ exposure: viewer.settings.exposure + (event.shiftKey ? -0.5 : 0.5) }),
    x: nextComponent,
    c: () => viewer.setMode(cycle(["single", "wipe", "difference"], viewer.mode, 1)),
    " ": () => viewer.setMode(viewer.mode === "flicker" ? "single" : "flicker"),
    n: () => viewer.normalize(),
    v: () => viewer.set({ inStops: !viewer.settings.inStops }),
    m: () => viewer.set({ marking: !viewer.settings.marking }),
    r: () => viewer.reset(),
    f: () => viewer.fit(),
    b: () => viewer.setBorder(true),
    h: () => pan(1, 0),
    l: () => pan(-1, 0),
    j: () => pan(0, -1),
    k: () => pan(0, 1),
    i: () => { info.open = !info.open; if (info.open) info.scrollIntoView(); },
    0: () => viewer.toggleActualSize(),
    "+": () => viewer.zoomBy(2 ** 0.5),
    "=": () => viewer.zoomBy(2 ** 0.5),
    "-": () => viewer.zoomBy(2 ** -0.5),
    "_": () => viewer.zoomBy(2 ** -0.5),
    "?": () => toggleHelp(),
    Escape: () => viewer.pin(null),
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
    } else if (commanded && key === "b") togglePanel();
    else if (key in toStep && !(commanded && key.length === 1)) move(key, event);
    else if (!commanded && Object.hasOwn(single, key)) single[key](event);
    else return;
    if (event.shiftKey || commanded) viewer.hold(null); // the key was part of a shortcut
    event.preventDefault();
  });
  document.addEventListener("keyup", (event) => {
    if (event.key === "Shift" || event.key === "Control") viewer.hold(null);
    if (event.key.toLowerCase() === "b") viewer.setBorder(false);
  });
  window.addEventListener("blur", () => viewer.hold(null));
  document.getElementById("help-button").addEventListener("click", toggleHelp);
}

function togglePanel() {
  document.body.classList.toggle("bare");
}

function toggleHelp() {
  const dialog = document.getElementById("help");
  if (dialog.open) return dialog.close();
  if (!dialog.childElementCount) {
    const groups = HELP.map(([title, keys]) => create("section", {}, create("h2", { textContent: title }), create("dl", {},
      ...keys.flatMap(([key, what]) => [create("dt", { textContent: key }), create("dd", { textContent: what })]))));
    const close = create("button", { type: "button", className: "close", textContent: "×", title: "Close (Esc)" });
    close.ariaLabel = "Close";
    close.addEventListener("click", () => dialog.close());
    dialog.append(close, create("div", { className: "groups" }, ...groups));
    dialog.addEventListener("click", (event) => event.target === dialog && dialog.close());
    dialog.addEventListener("keydown", (event) => event.key === "?" && dialog.close());
  }
  dialog.showModal();
}
