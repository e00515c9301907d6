"use strict";
// The layers, one a row: to choose one, and with the values of the pixel below the pointer, or of the pinned one.

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
  const exact = (k) => (isNumber ? values[k] : exactText(layer.planes[k], values[k], y * image.width + x));
  return {
    texts: values.map((value) => (isNumber ? String(value) : formatted(value, 5))),
    exact: layer.channels.map((channel, k) => `${channel} ${exact(k)}`).join("\n"),
    name: isNumber && values.length === 1 ? image.nameOf(layer, values[0]) : "",
    color: isNumber ? numberColor(values) : null,
  };
}

function exactText(plane, value, index) {
  return plane.type[0] === "u" ? `${shortest(value)} (code ${plane.data[index]})` : shortest(value);
}
