"use strict";
// The values of the pixel below the pointer, or of the one that is pinned, in all layers.

class Probe {
  constructor(viewer) {
    this.viewer = viewer;
    this.label = document.getElementById("hover");
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
    const pixel = viewer.probed;
    const place = document.querySelector("#probe .place");
    const state = viewer.pinned ? "pinned; Esc releases it" : "click to pin";
    place.replaceChildren(...(pixel && viewer.image
      ? [create("b", { textContent: `${pixel.x}, ${pixel.y}` }), create("span", { textContent: state })]
      : [create("span", { textContent: "Point at the image." })]));
    document.querySelector("#probe tbody").replaceChildren(...(pixel && viewer.image ? this.rows(pixel) : []));
    this.updateLabel();
  }

  rows(pixel) {
    const { viewer } = this;
    const { image } = viewer;
    const other = viewer.mode !== "single" && viewer.referenceImage !== image ? viewer.referenceImage : null;
    const rows = [];
    for (const layer of image.layers) {
      rows.push(this.row(layer.name, valuesAt(image, layer, pixel)));
      const same = other?.layer(layer.name);
      if (same && other.contains(pixel.x, pixel.y)) rows.push(this.row("B", valuesAt(other, same, pixel), "other"));
    }
    const color = image.contains(pixel.x, pixel.y) && image.color;
    if (color && color.planes.every((plane) => plane.data)) {
      const { operator, exposure } = viewer.settings;
      const index = pixel.y * image.width + pixel.x;
      const codes = new Shown({ ...color, statistics: { kind: KIND.color, ranges: [] } }, null, null).readers()
        .map((read) => toneMappedCode(read(index), operator, exposure));
      rows.push(this.row("display", { texts: codes.map(String), exact: "8-bit codes with this exposure and tone map", name: "" }, "codes"));
    }
    return rows;
  }

  row(title, { texts, exact, name, color }, className = "") {
    const cells = texts.map((textContent) => create("span", { textContent }));
    if (color) {
      const swatch = create("i", { className: "swatch" });
      swatch.style.backgroundColor = `rgb(${color.join(" ")})`;
      cells.unshift(swatch);
    }
    if (name) cells.push(create("em", { textContent: name }));
    return create("tr", { className, dataset: { layer: title } }, create("th", { textContent: title, title, scope: "row" }),
      create("td", { title: exact }, create("div", {}, ...cells)));
  }

  /** Show a number's name beside the pointer. */
  updateLabel() {
    const { viewer, label } = this;
    const pixel = viewer.hovered;
    const layer = viewer.layerOf(viewer.image);
    const isNumber = pixel && layer?.statistics?.kind === KIND.numbers && layer.planes.every((plane) => plane.data);
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

/** Return a layer's values at a pixel: texts to show, and exact ones; a number's name and color. */
function valuesAt(image, layer, { x, y }) {
  if (!image.contains(x, y)) return { texts: ["outside"], exact: "", name: "" };
  if (!layer.planes.every((plane) => plane.data)) return { texts: ["…"], exact: "still decoding", name: "" };
  const values = layer.planes.map((plane) => plane.reader()(y * image.width + x));
  const isNumber = layer.planes.some((plane) => plane.isWhole);
  return {
    texts: values.map((value) => (isNumber ? String(value) : formatted(value))),
    exact: layer.channels.map((channel, k) => `${channel} ${isNumber ? values[k] : exactText(layer.planes[k], values[k], y * image.width + x)}`).join("\n"),
    name: isNumber && values.length === 1 ? image.nameOf(layer, values[0]) : "",
    color: isNumber ? numberColor(values) : null,
  };
}

function exactText(plane, value, index) {
  return plane.type[0] === "u" ? `${shortest(value)} (code ${plane.data[index]})` : shortest(value);
}
