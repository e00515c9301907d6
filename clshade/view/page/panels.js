"use strict";
// The panel beside the image: what is selected, and the knobs.

const MOST_NUMBERS = 10; // whose names are listed
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
    document.querySelector("#panel h1").textContent = title;
    document.querySelector("#panel h1").title = title;
    this.buildImages();
    this.buildAdjust();
    viewer.addEventListener("change", () => this.update());
    viewer.addEventListener("drawn", () => this.drawn());
    viewer.addEventListener("statistics", () => this.updateHistogram());
    viewer.addEventListener("notice", (event) => this.notice(event.detail));
    new ResizeObserver(() => this.updateHistogram()).observe(document.querySelector("#histogram"));
    this.update();
  }

  notice(text) {
    const box = document.getElementById("notice");
    box.textContent = text;
    box.hidden = !text;
  }

  // Images

  buildImages() {
    const { viewer } = this;
    const modes = document.querySelector("#images .modes");
    this.modes = new Choice(modes, (mode) => viewer.setMode(mode));
    this.metrics = new Choice(document.querySelector("#images .metrics"), (metric) => viewer.setMetric(metric));
    this.rows = new Map();
  }

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
    const labels = { single: "Image", wipe: "Wipe", flicker: "Flicker", difference: "Difference" };
    const titles = { single: "The image alone", wipe: "The image left of a line, the reference right of it (C)",
      flicker: "Both in turn (Space)", difference: "How far the image is from the reference (Ctrl ← →: which measure)" };
    this.modes.update(MODES.map((value) => ({ value, label: labels[value], title: titles[value] })), viewer.mode);
    const measures = { absolute: "|A−B|", squared: "(A−B)²", relative: "|A−B| / |B|" };
    const wanted = viewer.mode === "difference" ? Object.entries(measures).map(([value, label]) => ({ value, label,
      title: value === "relative" ? "|A−B| / (|B| + 0.01)" : "" })) : [];
    this.metrics.update(wanted, viewer.metric);
    this.updateFigures();
  }

  createRow(name, k) {
    const { viewer } = this;
    const select = create("button", { type: "button", className: "name", title: name },
      create("span", { className: "number", textContent: String(k + 1) }), create("span", { textContent: name }));
    const reference = create("button", { type: "button", className: "reference", textContent: "B",
      title: `Compare with this image (Shift ${k + 1})` });
    select.addEventListener("click", () => viewer.select(name));
    reference.addEventListener("click", () => viewer.setReference(name));
    return { box: create("div", { className: "row" }, select, reference), reference };
  }

  /** Print how far the layer of one image is from the other's. */
  updateFigures() {
    const { viewer } = this;
    const box = document.querySelector("#images .figures");
    const [layer, other] = [viewer.layerOf(viewer.image), viewer.layerOf(viewer.referenceImage)];
    const ready = viewer.mode === "difference" && [layer, other].every((each) => each?.planes.every((plane) => plane.data));
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
    this.auto = create("button", { type: "button", textContent: "Fit", title: "From the 1 % to the 99 % percentile" });
    this.auto.addEventListener("click", () => viewer.setRange(null));
    this.whole = create("button", { type: "button", textContent: "All", title: "From the least to the largest value" });
    this.whole.addEventListener("click", () => {
      const full = viewer.layerOf(viewer.image)?.full;
      if (full && full.low <= full.high) viewer.setRange([full.low, full.high]);
    });
    this.range = create("div", {}, create("h2", { textContent: "Range" }),
      create("div", { className: "range" }, this.low, create("span", { textContent: "to" }), this.high, this.auto, this.whole));
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
    const differs = viewer.mode === "difference";
    const kind = viewer.drawn && !differs ? viewer.drawn.kind : KIND.color;
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
    const labels = numbers.slice(0, MOST_NUMBERS).map(([number]) => create("span", {}, createSwatch(numberColor([number])),
      `${number} ${layer.image.nameOf(layer, number)}`));
    const more = numbers.length - labels.length;
    return more > 0 ? [...labels, create("span", { textContent: `and ${more.toLocaleString("en")} more` })] : labels;
  }

  /** Update what depends on the image that was drawn. */
  drawn() {
    this.updateAdjust();
    this.updateHistogram();
    this.updateLegend();
    this.updateTags();
  }

  updateLegend() {
    const { viewer } = this;
    const legend = document.getElementById("legend");
    const { drawn, settings } = viewer;
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
    document.getElementById("tags").replaceChildren(...tags.filter((each) => each));
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
    const own = [["image", image.name], ["size", `${image.width} × ${image.height}`], ["channels", channels]];
    box.querySelector("dl").replaceChildren(...[...own, ...Object.entries(image.info.header)].flatMap(([name, text]) => [
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
