"use strict";
// The panel beside the image: what is selected, the controls, and the layers with a pixel's values. Texts from files get into
// the page as text only.

/** Create an element. properties: set on it; children: elements and texts. */
function create(tag, properties = {}, ...children) {
  const element = document.createElement(tag);
  const { dataset, ...others } = properties;
  Object.assign(element, others);
  Object.assign(element.dataset, dataset ?? {});
  element.append(...children);
  return element;
}

/** Create a small square of a color, [r, g, b]. */
function createSwatch(color) {
  const swatch = create("i", { className: "swatch" });
  swatch.style.backgroundColor = `rgb(${color.join(" ")})`;
  return swatch;
}

/** Create a button. */
function createButton(textContent, onclick, properties = {}) {
  const button = create("button", { type: "button", textContent, ...properties });
  button.addEventListener("click", onclick);
  return button;
}

/** A row of buttons, one of which is on. choices: [{value, label, title}]. */
class Choice {
  constructor(parent, onchoose) {
    this.box = create("div", { className: "choice", role: "group" });
    this.onchoose = onchoose;
    this.key = "";
    parent.append(this.box);
  }

  update(choices, chosen) {
    const key = JSON.stringify(choices);
    if (key !== this.key) {
      this.key = key;
      this.box.replaceChildren(...choices.map(({ value, label, title = "" }) =>
        createButton(label, () => this.onchoose(value), { title, dataset: { value: String(value) } })));
    }
    choices.forEach(({ value }, k) => this.box.children[k].setAttribute("aria-pressed", String(value === chosen)));
    this.box.hidden = choices.length < 2;
  }
}

/** A box to tick, with its key. */
function createSwitch(label, key, onchange) {
  const input = create("input", { type: "checkbox" });
  input.addEventListener("change", () => onchange(input.checked));
  const texts = [create("span", { textContent: label }), create("kbd", { textContent: key })];
  const box = create("label", { className: "switch" }, input, ...texts);
  return { box, input };
}

/** A number to type; `onchange` gets it when it is finite. */
function createNumber(label, step, onchange) {
  const input = create("input", { type: "number", step, ariaLabel: label });
  input.addEventListener("change", () => input.value !== "" && onchange(Number(input.value)));
  return input;
}

/** Set a number's text unless it is being typed. */
function setNumber(input, value) {
  if (document.activeElement !== input) input.value = String(value);
}

const MAX_NUMBERS = 10; // whose names are listed
const MEANINGS = {
  [KIND.direction]: "Colors are (n + 1) / 2 of X, Y and Z.",
  [KIND.numbers]: "Each number has a color of its own; 0 is black.",
  [KIND.position]: "Colors span each component’s range.",
  [KIND.coordinates]: "Colors are the fractions of the coordinates.",
};

/** The panel's sections follow the viewer's events. */
class Panels {
  constructor(viewer, title) {
    this.viewer = viewer;
    Object.assign(document.querySelector("#panel h1"), { textContent: title, title });
    this.modes = new Choice(document.querySelector("#images .modes"), (mode) => viewer.setMode(mode));
    this.metrics = new Choice(document.querySelector("#images .metrics"), (metric) => viewer.choose({ metric }));
    this.rows = new Map();
    this.buildAdjust();
    viewer.addEventListener("change", () => this.update());
    viewer.addEventListener("drawn", () => {
      this.updateAdjust();
      this.updateHistogram();
      this.updateLegend();
      this.updateTags();
    });
    viewer.addEventListener("statistics", () => this.updateHistogram());
    viewer.addEventListener("notice", (event) => this.notice(event.detail));
    new ResizeObserver(() => this.updateHistogram()).observe(document.querySelector("#histogram"));
    this.update();
  }

  notice(text) {
    Object.assign(document.getElementById("notice"), { textContent: text, hidden: !text });
  }

  // Images

  updateImages() {
    const { viewer } = this;
    const names = [...viewer.images.keys()];
    document.getElementById("images").hidden = names.length < 2;
    const key = JSON.stringify(names);
    if (key !== this.namesKey) {
      this.namesKey = key;
      this.rows = new Map(names.map((name, k) => [name, this.createRow(name, k)]));
      document.querySelector("#images .list").replaceChildren(...[...this.rows.values()].map((row) => row.box));
    }
    for (const [name, { box, reference }] of this.rows) {
      box.classList.toggle("selected", name === viewer.selected);
      reference.setAttribute("aria-pressed", String(name === viewer.reference && viewer.mode !== "single"));
    }
    this.modes.update(MODES, viewer.mode);
    this.metrics.update(viewer.mode === "difference" ? MEASURES : [], viewer.metric);
    this.updateFigures();
  }

  createRow(name, k) {
    const { viewer } = this;
    const select = createButton("", () => viewer.select(name), { className: "name", title: name });
    select.append(create("span", { className: "number", textContent: String(k + 1) }), create("span", { textContent: name }));
    const title = `Compare with this image (Shift ${k + 1})`;
    const reference = createButton("B", () => viewer.setReference(name), { className: "reference", title });
    return { box: create("div", { className: "row" }, select, reference), reference };
  }

  /** Print how far the layer of one image is from the other's. */
  updateFigures() {
    const { viewer } = this;
    const box = document.querySelector("#images .figures");
    const [layer, other] = [viewer.layerOf(viewer.image), viewer.layerOf(viewer.referenceImage)];
    const ready = viewer.mode === "difference" && [layer, other].every((each) => each && isLoaded(each));
    box.hidden = !ready;
    if (!ready) return;
    if (this.compared?.layer !== layer || this.compared.other !== other) {
      this.compared = { layer, other, text: compareLayers(layer, other) };
    }
    box.textContent = this.compared.text;
  }

  // Exposure, tone map, range

  buildAdjust() {
    const { viewer } = this;
    const section = document.getElementById("adjust");
    this.slider = create("input", { type: "range", min: -10, max: 10, step: 0.05, ariaLabel: "Exposure in stops" });
    this.slider.addEventListener("input", () => viewer.set({ exposure: Number(this.slider.value) }));
    this.slider.addEventListener("dblclick", () => viewer.set({ exposure: 0 }));
    this.stops = createNumber("Exposure in stops", 0.5, (exposure) => viewer.set({ exposure }));
    const field = create("span", { className: "field" }, this.stops, " stops");
    this.light = create("div", {}, create("h2", {}, "Exposure", field), this.slider, create("h2", { textContent: "Tone map" }));
    this.operators = new Choice(this.light, (operator) => viewer.set({ operator }));
    this.inStops = createSwitch("False color in stops", "V", (inStops) => viewer.set({ inStops }));
    this.light.append(this.inStops.box);
    this.low = createNumber("Least value", "any", (low) => viewer.setRange([low, this.shownRange()[1]]));
    this.high = createNumber("Largest value", "any", (high) => viewer.setRange([this.shownRange()[0], high]));
    const fit = createButton("Fit", () => viewer.setRange(null), { title: "From the 1 % to the 99 % percentile" });
    const all = createButton("All", () => {
      const full = viewer.layerOf(viewer.image)?.full;
      if (full && full.low <= full.high) viewer.setRange([full.low, full.high]);
    }, { title: "From the least to the largest value" });
    this.range = create("div", {}, create("h2", { textContent: "Range" }),
      create("div", { className: "range" }, this.low, create("span", { textContent: "to" }), this.high, fit, all));
    this.meaning = create("p", { className: "meaning" });
    this.marking = createSwitch("Mark NaN, infinite, negative", "M", (marking) => viewer.set({ marking }));
    section.append(this.light, this.range, this.meaning, this.marking.box);
  }

  shownRange() {
    return this.viewer.drawn?.ranges[0] ?? [0, 1];
  }

  updateAdjust() {
    const { viewer } = this;
    const { exposure, operator, marking, inStops } = viewer.settings;
    const kind = viewer.drawn && viewer.mode !== "difference" ? viewer.drawn.kind : KIND.color;
    this.light.hidden = kind !== KIND.color;
    this.range.hidden = kind !== KIND.quantity;
    this.meaning.textContent = MEANINGS[kind] ?? "";
    this.meaning.hidden = !this.meaning.textContent;
    this.slider.value = String(exposure);
    setNumber(this.stops, Math.round(exposure * 100) / 100);
    this.operators.update(OPERATORS.map((value) => ({ value, label: OPERATOR_NAMES[value] })), inStops ? null : operator);
    this.inStops.input.checked = inStops;
    this.marking.input.checked = marking;
    this.marking.box.hidden = kind === KIND.numbers;
    const [low, high] = this.shownRange();
    setNumber(this.low, Number(low.toPrecision(6)));
    setNumber(this.high, Number(high.toPrecision(6)));
  }

  // Histogram, legend, labels

  updateHistogram() {
    const { viewer } = this;
    const layer = viewer.layerOf(viewer.image);
    const full = layer?.full;
    document.getElementById("histogram").hidden = !full;
    if (!full) return;
    const title = full.inStops ? "Histogram in stops" : "Histogram";
    document.querySelector("#histogram h2").textContent = full.histograms.length ? title : "Numbers";
    document.querySelector("#histogram .numbers").replaceChildren(...this.numberLabels(layer, full.numbers ?? []));
    const canvas = document.querySelector("#histogram canvas");
    canvas.hidden = !full.histograms.length;
    if (!canvas.hidden) drawHistogram(canvas, full, -viewer.settings.exposure);
    const negative = full.inStops ? full.negative : 0; // of light alone it is worth a word
    const parts = [["nan", "NaN", full.nan], ["infinite", "infinite", full.infinite], ["negative", "negative", negative]];
    const range = full.low <= full.high ? `${formatted(full.low, 5)} to ${formatted(full.high, 5)}` : "none is finite";
    document.querySelector("#histogram .counts").replaceChildren(create("span", { textContent: range }), ...parts
      .filter(([, , count]) => count)
      .map(([name, label, count]) => create("span", {}, create("i", { className: name }), `${count.toLocaleString("en")} ${label}`)));
  }

  /** Return the most frequent numbers with their colors and names. */
  numberLabels(layer, numbers) {
    const labels = numbers.slice(0, MAX_NUMBERS).map(([number]) => create("span", {}, createSwatch(numberColor([number])),
      `${number} ${layer.image.nameOf(layer, number)}`));
    const more = numbers.length - labels.length;
    return more > 0 ? [...labels, create("span", { textContent: `and ${more.toLocaleString("en")} more` })] : labels;
  }

  updateLegend() {
    const { viewer, viewer: { drawn, settings } } = this;
    const legend = document.getElementById("legend");
    const isLight = drawn?.kind === KIND.color || (viewer.mode === "difference" && drawn?.kind !== KIND.numbers);
    legend.hidden = !drawn || !((isLight && settings.inStops) || (!isLight && drawn.kind === KIND.quantity));
    if (legend.hidden) return;
    const name = isLight ? "stops" : "quantity";
    if (this.legendName !== name) {
      this.legendName = name;
      const context = legend.querySelector("canvas").getContext("2d");
      const strip = context.createImageData(256, 1);
      const colors = viewer.display.colormaps[name];
      for (let k = 0; k < 256; k++) strip.data.set([...colors.subarray(3 * k, 3 * k + 3), 255], 4 * k);
      context.putImageData(strip, 0, 0);
    }
    const [low, high] = drawn.ranges[0];
    const stops = [-8, -4, 0, 4].map((stop) => (stop ? minus(stop > 0 ? `+${stop}` : String(stop)) : "0 stops"));
    const labels = isLight ? stops : [low, (low + high) / 2, high].map((value) => formatted(value, 4));
    legend.querySelector(".scale").replaceChildren(...labels.map((textContent) => create("span", { textContent })));
  }

  updateTags() {
    const { viewer } = this;
    const sole = viewer.soleImage;
    const tag = (image, letter) => {
      const layer = viewer.layerOf(image);
      const isOther = viewer.layerName && layer && layer.name !== viewer.layerName;
      const missing = isOther ? `, no ${viewer.layerName}: ${layer.name}` : "";
      return create("span", {}, create("b", { textContent: letter }), `${image.name}${missing}`);
    };
    const one = viewer.images.size > 1 && sole ? [tag(sole, sole === viewer.image ? "" : "B")] : [];
    const tags = sole || !viewer.image ? one : [tag(viewer.image, "A"), tag(viewer.referenceImage, "B")];
    document.getElementById("tags").replaceChildren(...tags);
    const { image, view } = viewer;
    const zoom = formatted(Math.round((view.zoom / viewer.ratio) * 1000) / 10, 4);
    document.getElementById("status").textContent = image ? `${image.width} × ${image.height}  ·  ${zoom} %` : "";
  }

  updateInfo() {
    const { image } = this.viewer;
    const box = document.getElementById("info");
    box.hidden = !image;
    if (!image || this.infoOf === image.info) return;
    this.infoOf = image.info;
    const channels = [...image.channels.values()].map((channel) => `${channel.name} ${TYPE_NAMES[channel.type]}`).join(", ");
    const facts = [["image", image.name], ["size", `${image.width} × ${image.height}`], ["channels", channels]];
    box.querySelector("dl").replaceChildren(...[...facts, ...Object.entries(image.info.header)].flatMap(([name, text]) => [
      create("dt", { textContent: name }), create("dd", { textContent: String(text) })]));
  }

  update() {
    this.updateImages();
    this.updateAdjust();
    this.updateInfo();
  }
}

/** Return a line on how far a layer is from a reference, over the pixels that both have. */
function compareLayers(layer, reference) {
  const [a, b] = [layer.image, reference.image];
  const [width, height] = [Math.min(a.width, b.width), Math.min(a.height, b.height)];
  const planes = Math.min(layer.planes.length, reference.planes.length);
  const pairs = Array.from({ length: planes }, (_, k) => [
    layer.planes[k].reader(a.isEncoded(layer)), reference.planes[k].reader(b.isEncoded(reference))]);
  let [unequal, largest, squares, finite, where] = [0, 0, 0, 0, ""];
  for (let y = 0; y < height; y++) {
    for (let x = 0; x < width; x++) {
      let differs = false;
      for (const [read, other] of pairs) {
        const error = difference(read(y * a.width + x), other(y * b.width + x), "absolute");
        if (error !== 0) differs = true;
        if (error - error !== 0) continue;
        finite++;
        squares += error * error;
        if (error > largest) [largest, where] = [error, ` at ${x}, ${y}`];
      }
      if (differs) unequal++;
    }
  }
  const shares = `${unequal.toLocaleString("en")} of ${(width * height).toLocaleString("en")} pixels differ`;
  if (layer.statistics?.kind === KIND.numbers) return shares;
  const rmse = finite ? Math.sqrt(squares / finite) : 0;
  return `${shares}; largest ${formatted(largest, 4)}${where}; RMSE ${formatted(rmse, 4)}`;
}

class LayerTable {
  constructor(viewer) {
    this.viewer = viewer;
    this.label = document.getElementById("hover");
    this.body = document.querySelector("#layers tbody");
    const components = document.querySelector("#layers .components");
    this.components = new Choice(components, (component) => viewer.choose({ component }));
    this.key = "";
    viewer.addEventListener("hover", () => this.schedule());
    viewer.addEventListener("change", () => this.schedule());
    this.update();
  }

  schedule() {
    this.frame ??= requestAnimationFrame(() => {
      this.frame = null;
      this.update();
    });
  }

  update() {
    const { viewer } = this;
    const layers = viewer.image?.layers ?? [];
    const key = JSON.stringify(layers.map(({ name, channels }) => [name, channels]));
    if (key !== this.key) {
      this.key = key;
      this.rows = layers.map((layer) => this.createRow(layer));
      this.codes = this.createValues("codes", "Display");
      this.codes.title = "8-bit codes with this exposure and tone map";
      this.body.replaceChildren(...this.rows.flatMap(({ row, other }) => [row, other]), this.codes);
    }
    this.updateComponents(viewer.layerOf(viewer.image));
    this.updateValues(viewer.image && viewer.probed);
    this.updateLabel();
  }

  createRow({ name, channels }) {
    const button = createButton(name, () => this.viewer.setLayer(name), { title: channels.join(", ") });
    const row = create("tr", { dataset: { layer: name } }, create("th", { scope: "row" }, button), create("td"));
    return { name, row, button, other: this.createValues("other", "B") };
  }

  createValues(className, title) {
    return create("tr", { className }, create("th", { textContent: title, scope: "row" }), create("td"));
  }

  updateComponents(layer) {
    const letter = (channel) => [...layer.family].find((component) => channel.toUpperCase().endsWith(component)) ?? channel;
    const choices = layer && layer.channels.length > 1 ? [{ value: null, label: "All", title: "(X: next)" },
      ...layer.channels.map((channel, k) => ({ value: k, label: letter(channel), title: channel }))] : [];
    if (choices.length === 4 && layer.family === "RGB") {
      choices.push({ value: "luminance", label: "Luminance", title: "Of linear Rec. 709" });
    }
    this.components.update(choices, this.viewer.component);
  }

  updateValues(pixel) {
    const { viewer } = this;
    const { image } = viewer;
    const selected = viewer.layerOf(image);
    const place = document.querySelector("#layers .place");
    place.textContent = pixel ? `${pixel.x}, ${pixel.y}` : "";
    place.title = "Column and row, from the top left";
    const state = viewer.pinned ? "pinned, Esc releases it" : "click to pin";
    document.querySelector("#layers .state").textContent = pixel ? state : "point at a pixel for its values";
    const reference = viewer.mode !== "single" && viewer.referenceImage !== image ? viewer.referenceImage : null;
    (this.rows ?? []).forEach(({ name, row, button, other }, k) => {
      const layer = image?.layers[k];
      row.classList.toggle("selected", layer === selected);
      button.setAttribute("aria-pressed", String(layer === selected));
      const values = pixel && layer ? valuesAt(image, layer, pixel) : null;
      const same = values && reference?.layer(name);
      const others = same ? valuesAt(reference, same, pixel) : null;
      setValues(row, values);
      setValues(other, others);
      other.hidden = !others || others.exact === values.exact; // equal values are printed once
    });
    if (this.codes) this.updateCodes(pixel);
  }

  updateCodes(pixel) {
    const color = this.viewer.image?.color;
    this.codes.hidden = !color;
    if (!color || !pixel || !isLoaded(color)) return setValues(this.codes, null);
    const { operator, exposure } = this.viewer.settings;
    const index = pixel.y * color.image.width + pixel.x;
    const linear = color.image.isEncoded(color);
    const values = [0, 1, 2].map((k) => (color.planes[k] ?? color.planes[0]).reader(linear)(index));
    setValues(this.codes, { texts: toneMappedCodes(values, operator, exposure).map(String), exact: "" });
  }

  /** Show a number's name beside the pointer. */
  updateLabel() {
    const { viewer, label } = this;
    const pixel = viewer.hovered;
    const layer = viewer.layerOf(viewer.image);
    const isNumber = pixel && layer?.statistics?.kind === KIND.numbers && isLoaded(layer);
    label.hidden = !isNumber || !viewer.pointer;
    if (label.hidden) return;
    const { texts, name } = valuesAt(viewer.image, layer, pixel);
    label.textContent = name ? `${texts[0]}  ${name}` : texts.join(", ");
    const box = viewer.canvas.getBoundingClientRect();
    const [x, y] = [viewer.pointer.clientX - box.left, viewer.pointer.clientY - box.top];
    label.style.left = `${Math.max(0, x + 16 + label.offsetWidth > box.width ? x - 10 - label.offsetWidth : x + 14)}px`;
    label.style.top = `${Math.max(0, Math.min(box.height - label.offsetHeight, y + 14))}px`;
  }
}

/** Set the values of a row; null: none. */
function setValues(row, values) {
  const { texts = [], exact = "", name = "", color = null } = values ?? {};
  const cells = texts.map((textContent) => create("span", { textContent }));
  if (color) cells.unshift(createSwatch(color));
  if (name) cells.push(create("em", { textContent: name }));
  row.lastChild.title = exact;
  row.lastChild.className = texts.length > 1 ? "three" : "";
  row.lastChild.replaceChildren(...cells);
}

/** Return a layer's values at a pixel: texts to show, and exact ones; a number's name and color. */
function valuesAt(image, layer, { x, y }) {
  if (!image.contains(x, y)) return { texts: ["outside"], exact: "", name: "" };
  if (!isLoaded(layer)) return { texts: ["…"], exact: "still decoding", name: "" };
  const values = layer.planes.map((plane) => plane.reader()(y * image.width + x));
  const isNumber = layer.planes.some((plane) => plane.isWhole);
  const exact = (value, { type, data }) => // of a code of a PNG, the code as well
    isNumber ? value : shortest(value) + (type[0] === "u" ? ` (code ${data[y * image.width + x]})` : "");
  return {
    texts: values.map((value) => (isNumber ? String(value) : formatted(value, 5))),
    exact: layer.channels.map((channel, k) => `${channel} ${exact(values[k], layer.planes[k])}`).join("\n"),
    name: isNumber && values.length === 1 ? image.nameOf(layer, values[0]) : "",
    color: isNumber ? numberColor(values) : null,
  };
}
