"use strict";
// Elements of the panel. Texts from files get into the page as text only.

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

/** A row of buttons, one of which is on. choices: [{value, label, title}]. */
class Choice {
  constructor(parent, onchoose, className = "choice") {
    this.box = create("div", { className, role: "group" });
    this.onchoose = onchoose;
    this.key = "";
    parent.append(this.box);
  }

  update(choices, chosen) {
    const key = JSON.stringify(choices);
    if (key !== this.key) {
      this.key = key;
      this.box.replaceChildren(...choices.map(({ value, label, title = "" }) => {
        const button = create("button", { type: "button", textContent: label, title, dataset: { value: String(value) } });
        button.addEventListener("click", () => this.onchoose(value));
        return button;
      }));
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
