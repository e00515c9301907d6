"use strict";
// The panel of a live view: shader, samples, layers, lights, snapshot, times.

const SAMPLE_COUNTS = [1, 4, 16, 64];
const BRIGHTEST_LIGHT = 4; // factor of a light's intensity at the end of its slider
const SHADER_NAMES = { phong: "Phong", gouraud: "Gouraud", nolight: "No light", pbr: "Metallic-roughness" };

class LivePanel {
  /** send: a function of a message. */
  constructor(send) {
    this.send = send;
    this.section = create("section", { id: "live" });
    document.querySelector("#panel header").after(this.section);
    const reset = create("button", { type: "button", textContent: "Reset", title: "Back to the first camera" });
    reset.addEventListener("click", () => send({ type: "reset" }));
    const title = (text, ...others) => create("h2", {}, text, ...others);
    this.turning = create("button", { type: "button", textContent: "Turn", title: "Go round the scene (T)", ariaPressed: "false" });
    this.section.append(title("Camera", create("span", { className: "buttons" }, this.turning, reset)), create("p", { className: "meaning", textContent: "Drag: orbit · right drag: pan · wheel: zoom · WASD QE: fly" }));
    const row = (text, hint) => create("div", { className: "choose", title: hint }, create("h2", { textContent: text }));
    const [shader, samples, layers] = [row("Shader", "Where the scene is lit"), row("Samples", "Per pixel, once the view is still"),
      row("Layers", "To render with the picture: they can be shown below")];
    this.shaders = new Choice(shader, (value) => this.set({ shader: value }));
    this.samples = new Choice(samples, (value) => this.set({ samples: value }));
    this.layers = create("div", { className: "toggles" });
    layers.append(this.layers);
    this.section.append(shader, samples, layers, this.lightsTitle = title("Lights"), this.lights = create("div"));
    const snapshot = create("button", { type: "button", id: "snapshot", textContent: "Snapshot",
      title: "Write the EXR and PNG that `clshade render` writes for this view" });
    snapshot.addEventListener("click", () => {
      this.result.replaceChildren("Rendering …");
      send({ type: "snapshot" });
    });
    this.result = create("div", { id: "written" });
    this.figures = create("p", { className: "figures", id: "times" });
    this.section.append(title("Picture", snapshot), this.result, this.figures);
  }

  set(changes) {
    Object.assign(this.state, changes);
    this.send({ type: "set", ...changes });
    this.update();
  }

  /** Take over what the server said about the scene. */
  describe({ settings, layers, lights, lightNames, choices }) {
    this.choices = choices;
    this.state = { ...settings, layers, lights };
    this.lightNames = lightNames;
    this.offLights = lights.map((factor) => factor || 1);
    this.update();
    this.buildLights();
  }

  update() {
    const { shader, samples, layers } = this.state;
    this.shaders.update(this.choices.shader.map((value) => ({ value, label: SHADER_NAMES[value] ?? value })), shader);
    const counts = SAMPLE_COUNTS.includes(samples) ? SAMPLE_COUNTS : [...SAMPLE_COUNTS, samples].sort((a, b) => a - b);
    this.samples.update(counts.map((value) => ({ value, label: String(value) })), samples);
    this.layers.replaceChildren(...this.choices.layers.map((name) => {
      const button = create("button", { type: "button", textContent: name, ariaPressed: String(layers.includes(name)) });
      button.addEventListener("click", () => {
        this.set({ layers: this.choices.layers.filter((each) => this.state.layers.includes(each) !== (each === name)) });
      });
      return button;
    }));
  }

  buildLights() {
    this.lightsTitle.hidden = !this.state.lights.length;
    this.lights.replaceChildren(...this.state.lights.map((factor, k) => this.light(factor, k)));
  }

  /** A light: on or off, and its intensity as a factor of the scene's. */
  light(factor, k) {
    const name = `Light ${k + 1}`;
    const on = create("input", { type: "checkbox", checked: factor > 0, title: `${name} on or off: ${this.lightNames[k]}`, ariaLabel: name });
    const most = Math.max(BRIGHTEST_LIGHT, factor);
    const slider = create("input", { type: "range", min: 0, max: most, step: 0.01, value: this.offLights[k], ariaLabel: `Intensity of light ${k + 1}` });
    const number = createNumber(`Intensity of light ${k + 1}`, 0.1, (value) => change(Math.max(0, value)));
    const show = (value) => {
      slider.value = String(value);
      number.value = String(Math.round(value * 100) / 100);
    };
    const change = (value) => {
      this.offLights[k] = value || 1;
      on.checked = value > 0;
      show(value);
      this.setLight(k, value);
    };
    slider.addEventListener("input", () => change(Number(slider.value)));
    slider.addEventListener("dblclick", () => change(1));
    on.addEventListener("change", () => {
      show(this.offLights[k]);
      this.setLight(k, on.checked ? this.offLights[k] : 0);
    });
    show(factor || this.offLights[k]);
    return create("div", { className: "light" }, create("label", {}, on, String(k + 1)), slider, number);
  }

  setLight(k, factor) {
    this.set({ lights: this.state.lights.map((each, index) => (index === k ? factor : each)) });
  }

  /** Forget the snapshot that was asked for. */
  failed() {
    this.result.replaceChildren();
  }

  /** Show a snapshot's files, and the command that makes them. */
  written({ files, command, warnings }) {
    const copy = create("button", { type: "button", textContent: "Copy" });
    copy.addEventListener("click", async () => {
      await navigator.clipboard.writeText(command);
      copy.textContent = "Copied";
    });
    const lines = [...files, ...warnings].map((textContent) => create("div", { textContent }));
    this.result.replaceChildren(...lines, create("code", { textContent: command }), copy);
  }

  /** Show what a picture took. rate: frames per second, or null at rest. */
  times({ samples, full, drawn, times_ms: times }, wanted, rate) {
    const size = drawn[0] === full[0] ? full.join(" × ") : `${drawn.join(" × ")}, enlarged`;
    const { frame, convert, total, ...stages } = times;
    const listed = Object.entries(stages).filter(([, ms]) => ms >= 0.05).sort(([, a], [, b]) => b - a)
      .map(([name, ms]) => `${name} ${ms.toFixed(1)}`).join(", ");
    const lines = [
      `${size}, ${samples === wanted ? "" : `${samples} of `}${wanted} ${wanted === 1 ? "sample" : "samples"}${rate === null ? "" : `, ${rate.toFixed(0)} frames/s`}`,
      `frame ${frame.toFixed(1)} ms (${listed}), sent after ${convert.toFixed(1)} ms`,
    ];
    this.figures.replaceChildren(...lines.map((textContent) => create("div", { textContent })));
  }
}
