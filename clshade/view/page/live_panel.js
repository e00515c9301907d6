"use strict";
// The panel of a live view: shader, samples, shadows and so on, layers, lights, snapshot, times.

const SAMPLE_COUNTS = [1, 4, 16, 64];
const BRIGHTEST_LIGHT = 4; // intensity at the end of a slider: a factor, as the environment's is
const OCCLUSION_RAYS = [0, 16, 64];
const BACKGROUND_NAMES = { scene: "Scene", environment: "Environment", color: "Color" }; // null: none
const SHADER_NAMES = { phong: "Phong", gouraud: "Gouraud", nolight: "No light", pbr: "Metallic-roughness" };

class LivePanel {
  /** send: a function of a message. */
  constructor(send) {
    this.send = send;
    this.section = create("section", { id: "live", hidden: true }); // until the scene is there
    document.querySelector("#panel header").after(this.section);
    const reset = create("button", { type: "button", textContent: "Reset", title: "Back to the first camera" });
    reset.addEventListener("click", () => send({ type: "reset" }));
    const title = (text, ...others) => create("h2", {}, text, ...others);
    this.turning = create("button", { type: "button", textContent: "Turn", title: "Go round the scene (T)", ariaPressed: "false" });
    this.section.append(title("Camera", create("span", { className: "buttons" }, this.turning, reset)), create("p", { className: "meaning", textContent: "Drag: orbit · right drag: pan · wheel: zoom · WASD QE: fly" }));
    const row = (text, hint) => create("div", { className: "choose", title: hint }, create("h2", { textContent: text }));
    const choose = (name, hint, onchoose) => {
      const box = row(name, hint);
      this.section.append(box);
      const choice = new Choice(box, onchoose);
      return { choice, update: (choices, chosen) => {
        choice.update(choices, chosen);
        box.hidden = choices.length < 2;
      } };
    };
    this.shaders = choose("Shader", "Where the scene is lit", (shader) => this.set({ shader }));
    this.samples = choose("Samples", "Per pixel, once the view is still", (count) => this.set({ samples: count }));
    this.occlusion = choose("Occlusion", "Rays that look for what keeps ambient light away", (rays) => this.set({ ambient_occlusion: rays }));
    this.environment = choose("Environment", "What lights the scene from all around", (name) => this.set({ environment: name }));
    this.background = choose("Background", "What is seen behind the surfaces", (value) => this.set({ background: value === "color" ? this.color.value : value }));
    this.color = create("input", { type: "color", value: "#808080", ariaLabel: "Color of the background" });
    this.color.addEventListener("input", () => this.set({ background: this.color.value }));
    this.background.choice.box.after(this.color);
    this.shadows = createSwitch("Shadows", "", (shadows) => this.set({ shadows }));
    this.ground = createSwitch("Ground", "", (ground) => this.set({ ground }));
    this.layers = create("div", { className: "toggles", title: "Render with the picture" });
    document.querySelector("#layers h2").after(this.layers);
    const switches = create("div", { className: "switches" }, this.shadows.box, this.ground.box);
    this.section.append(switches, this.lightsTitle = title("Lights"), this.lights = create("div"));
    this.brightness = this.intensityControls("Intensity of the environment", (value) => this.set({ environment_intensity: value }));
    this.surroundings = create("div", { className: "light" }, create("label", {}, "Environment"), this.brightness.slider, this.brightness.number);
    this.section.append(this.surroundings);
    const snapshot = create("button", { type: "button", id: "snapshot", textContent: "Snapshot",
      title: "Write the EXR and PNG that `clshade render` writes for this view" });
    snapshot.addEventListener("click", () => {
      this.result.replaceChildren("Rendering …");
      send({ type: "snapshot" });
    });
    this.result = create("div", { id: "written" });
    this.commandText = create("div");
    this.command = create("details", { id: "command", hidden: true }, create("summary", { textContent: "The command that draws this" }), this.commandText);
    this.figures = create("p", { className: "figures", id: "times" });
    this.section.append(title("Picture", snapshot), this.result, this.figures, this.command);
  }

  set(changes) {
    Object.assign(this.state, changes);
    this.send({ type: "set", ...changes });
    this.update();
  }

  /** Take over what the server said about the scene. */
  describe({ settings, lights, lightNames, choices }) {
    this.section.hidden = false;
    this.choices = choices;
    this.state = { ...settings, lights };
    this.lightNames = lightNames;
    this.offLights = lights.map((factor) => factor || 1);
    this.update();
    this.buildLights();
  }

  /** Take over what became of settings, and which others are allowed. */
  follow({ settings, choices }) {
    this.choices = choices;
    Object.assign(this.state, settings);
    this.update();
  }

  update() {
    const { shader, samples, layers } = this.state;
    this.updateSwitches();
    this.shaders.update(this.choices.shader.map((value) => ({ value, label: SHADER_NAMES[value] ?? value })), shader);
    this.samples.update(numbered(SAMPLE_COUNTS, samples), samples);
    this.layers.replaceChildren(...this.choices.layers.map((name) => {
      const button = create("button", { type: "button", textContent: name, ariaPressed: String(layers.includes(name)) });
      button.addEventListener("click", () => {
        this.set({ layers: this.choices.layers.filter((each) => this.state.layers.includes(each) !== (each === name)) });
      });
      return button;
    }));
  }

  /** Show what of the light and the surroundings this scene can have. */
  updateSwitches() {
    const { state: { background, environment, ambient_occlusion: rays, shadows, ground }, choices } = this;
    this.occlusion.update(choices.ambient_occlusion ? numbered(OCCLUSION_RAYS, rays) : [], rays);
    this.environment.update(choices.environment.map(([value, name]) => ({ value, label: name[0].toUpperCase() + name.slice(1) })), environment);
    const isNamed = background === null || Object.hasOwn(BACKGROUND_NAMES, background);
    const kind = isNamed ? background : "color";
    this.background.update(choices.background.map((value) => ({ value, label: BACKGROUND_NAMES[value] ?? "None" })), kind);
    this.color.hidden = kind !== "color";
    this.lights.hidden = !choices.lights;
    this.surroundings.hidden = !choices.environment_intensity;
    this.lightsTitle.hidden = this.lights.hidden && this.surroundings.hidden;
    if (choices.environment_intensity) {
      this.brightness.show(this.state.environment_intensity);
    }
    for (const [{ box, input }, allowed, on] of [[this.shadows, choices.shadows, shadows], [this.ground, choices.ground, ground]]) {
      box.hidden = !allowed;
      input.checked = on;
    }
  }

  buildLights() {
    this.lights.replaceChildren(...this.state.lights.map((factor, k) => this.light(factor, k)));
  }

  /** A light: on or off, and its intensity as a factor of the scene's. */
  light(factor, k) {
    const name = `Light ${k + 1}`;
    const on = create("input", { type: "checkbox", checked: factor > 0, title: `${name} on or off: ${this.lightNames[k]}`, ariaLabel: name });
    const { slider, number, show } = this.intensityControls(`Intensity of light ${k + 1}`, (value) => {
      this.offLights[k] = value || 1;
      on.checked = value > 0;
      this.setLight(k, value);
    });
    on.addEventListener("change", () => {
      show(this.offLights[k]);
      this.setLight(k, on.checked ? this.offLights[k] : 0);
    });
    show(factor || this.offLights[k]);
    return create("div", { className: "light" }, create("label", {}, on, String(k + 1)), slider, number);
  }

  /** Controls of an intensity: a slider and a number. */
  intensityControls(ariaLabel, onchange) {
    const slider = create("input", { type: "range", min: 0, max: BRIGHTEST_LIGHT, step: 0.01, ariaLabel });
    const number = createNumber(ariaLabel, 0.1, (value) => change(Math.max(0, value)));
    const show = (value) => {
      slider.max = String(Math.max(Number(slider.max), value));
      slider.value = String(value);
      number.value = String(Math.round(value * 100) / 100);
    };
    const change = (value) => {
      show(value);
      onchange(value);
    };
    slider.addEventListener("input", () => change(Number(slider.value)));
    slider.addEventListener("dblclick", () => change(1));
    return { slider, number, show };
  }

  setLight(k, factor) {
    this.set({ lights: this.state.lights.map((each, index) => (index === k ? factor : each)) });
  }

  /** Show the command that draws what is seen. */
  showCommand(text) {
    this.command.hidden = false;
    this.commandText.replaceChildren(...commandElements(text));
  }

  /** Forget the snapshot that was asked for. */
  failed() {
    this.result.replaceChildren();
  }

  /** Show a snapshot's files, and the command that makes them. */
  written({ files, command, warnings }) {
    const lines = [...files, ...warnings].map((textContent) => create("div", { textContent }));
    this.result.replaceChildren(...lines, ...commandElements(command));
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

/** Return choices of usual numbers, and of the one in use. */
function numbered(usual, used) {
  return [...new Set([...usual, used])].sort((a, b) => a - b).map((value) => ({ value, label: String(value || "Off") }));
}

/** Return a command's text, and a button that copies it. */
function commandElements(command) {
  const copy = create("button", { type: "button", textContent: "Copy" });
  copy.addEventListener("click", async () => {
    await navigator.clipboard.writeText(command);
    copy.textContent = "Copied";
  });
  return [create("code", { textContent: command }), copy];
}
