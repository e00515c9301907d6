"use strict";
// The panel of a live view: shader, samples, shadows and so on, layers, lights, snapshot, times.

const SAMPLE_COUNTS = [1, 4, 16, 64];
const BRIGHTEST_LIGHT = 4; // intensity at the end of a slider: a factor, as the environment's is
const OCCLUSION_RAYS = [0, 16, 64];
const BACKGROUND_NAMES = { scene: "Scene", environment: "Environment", color: "Color" }; // null: none
const SHADER_NAMES = { phong: "Phong", gouraud: "Gouraud", nolight: "No light", pbr: "Metallic-roughness" };

const numbered = (usual, used) => // usual numbers, and the one in use
  [...new Set([...usual, used])].sort((a, b) => a - b).map((value) => ({ value, label: String(value || "Off") }));
const capitalized = (name) => name[0].toUpperCase() + name.slice(1);

// Rows of choices: field of `set`, title, hint, and a function of what is allowed and of the state to the choices.
const CHOICES = [
  ["shader", "Shader", "Where the scene is lit",
    ({ shader }) => shader.map((value) => ({ value, label: SHADER_NAMES[value] ?? value }))],
  ["samples", "Samples", "Per pixel, once the view is still", (_, { samples }) => numbered(SAMPLE_COUNTS, samples)],
  ["ambient_occlusion", "Occlusion", "Rays that look for what keeps ambient light away",
    (allowed, state) => (allowed.ambient_occlusion ? numbered(OCCLUSION_RAYS, state.ambient_occlusion) : [])],
  ["environment", "Environment", "What lights the scene from all around",
    ({ environment }) => environment.map(([value, name]) => ({ value, label: capitalized(name) }))],
  ["background", "Background", "What is seen behind the surfaces",
    ({ background }) => background.map((value) => ({ value, label: BACKGROUND_NAMES[value] ?? "None" }))],
];

class LivePanel {
  /** send: a function of a message. */
  constructor(send) {
    this.send = send;
    this.section = create("section", { id: "live", hidden: true }); // until the scene is there
    document.querySelector("#panel header").after(this.section);
    const reset = createButton("Reset", () => send({ type: "reset" }), { title: "Back to the first camera" });
    this.turning = createButton("Turn", () => this.onturn?.(), { title: "Go round the scene (T)", ariaPressed: "false" });
    const help = "Drag: orbit · right drag: pan · wheel: zoom · WASD QE: fly";
    this.section.append(create("h2", {}, "Camera", create("span", { className: "buttons" }, this.turning, reset)),
      create("p", { className: "meaning", textContent: help }));
    this.choices = CHOICES.map(([field, title, hint, choicesOf]) => {
      const row = create("div", { className: "choose", title: hint }, create("h2", { textContent: title }));
      this.section.append(row);
      const choice = new Choice(row, (value) => this.set({ [field]: value === "color" ? this.color.value : value }));
      return { field, row, choice, choicesOf };
    });
    this.color = create("input", { type: "color", value: "#808080", ariaLabel: "Color of the background" });
    this.color.addEventListener("input", () => this.set({ background: this.color.value }));
    this.choices.at(-1).row.append(this.color);
    this.switches = ["shadows", "ground"].map((field) =>
      ({ field, ...createSwitch(capitalized(field), "", (on) => this.set({ [field]: on })) }));
    this.layers = create("div", { className: "toggles", title: "Render with the picture" });
    document.querySelector("#layers h2").after(this.layers);
    this.lightsTitle = create("h2", { textContent: "Lights" });
    this.lights = create("div");
    this.brightness = this.intensityControls("Intensity of the environment", (value) => this.set({ environment_intensity: value }));
    const { slider, number } = this.brightness;
    this.surroundings = create("div", { className: "light" }, create("label", {}, "Environment"), slider, number);
    const snapshot = createButton("Snapshot", () => {
      this.result.replaceChildren("Rendering …");
      send({ type: "snapshot" });
    }, { id: "snapshot", title: "Write the EXR and PNG that `clshade render` writes for this view" });
    this.result = create("div", { id: "written" });
    this.commandText = create("div");
    const summary = create("summary", { textContent: "The command that draws this" });
    this.command = create("details", { id: "command", hidden: true }, summary, this.commandText);
    this.figures = create("p", { className: "figures", id: "times" });
    this.section.append(create("div", { className: "switches" }, ...this.switches.map(({ box }) => box)), this.lightsTitle,
      this.lights, this.surroundings, create("h2", {}, "Picture", snapshot), this.result, this.figures, this.command);
  }

  set(changes) {
    Object.assign(this.state, changes);
    this.send({ type: "set", ...changes });
    this.update();
  }

  /** Take over the server's description of the scene. */
  describe({ settings, lights, lightNames, choices }) {
    this.section.hidden = false;
    this.state = { lights };
    this.offLights = lights.map((factor) => factor || 1);
    this.follow({ settings, choices });
    this.lights.replaceChildren(...lights.map((factor, k) => this.light(factor, k, lightNames[k])));
  }

  /** Take over what became of settings, and which others are allowed. */
  follow({ settings, choices }) {
    this.allowed = choices;
    Object.assign(this.state, settings);
    this.update();
  }

  update() {
    const { allowed, state, state: { background } } = this;
    const isColor = background !== null && !Object.hasOwn(BACKGROUND_NAMES, background);
    for (const { field, row, choice, choicesOf } of this.choices) {
      const choices = choicesOf(allowed, state);
      choice.update(choices, field === "background" && isColor ? "color" : state[field]);
      row.hidden = choices.length < 2;
    }
    this.color.hidden = !isColor;
    this.lights.hidden = !allowed.lights;
    this.surroundings.hidden = !allowed.environment_intensity;
    this.lightsTitle.hidden = this.lights.hidden && this.surroundings.hidden;
    if (allowed.environment_intensity) this.brightness.show(state.environment_intensity);
    for (const { field, box, input } of this.switches) {
      box.hidden = !allowed[field];
      input.checked = state[field];
    }
    this.layers.replaceChildren(...allowed.layers.map((name) => createButton(name, () => {
      this.set({ layers: allowed.layers.filter((layer) => this.state.layers.includes(layer) !== (layer === name)) });
    }, { ariaPressed: String(state.layers.includes(name)) })));
  }

  /** A light: on or off, and its intensity as a factor of the scene's. */
  light(factor, k, description) {
    const name = `Light ${k + 1}`;
    const title = `${name} on or off: ${description}`;
    const on = create("input", { type: "checkbox", checked: factor > 0, title, ariaLabel: name });
    const set = (value) => this.set({ lights: this.state.lights.map((before, index) => (index === k ? value : before)) });
    const { slider, number, show } = this.intensityControls(`Intensity of light ${k + 1}`, (value) => {
      this.offLights[k] = value || 1;
      on.checked = value > 0;
      set(value);
    });
    on.addEventListener("change", () => {
      show(this.offLights[k]);
      set(on.checked ? this.offLights[k] : 0);
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

  /** Show the command that draws what is seen. */
  showCommand(text) {
    this.command.hidden = false;
    this.commandText.replaceChildren(...commandElements(text));
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
    const progress = `${samples === wanted ? "" : `${samples} of `}${wanted} ${wanted === 1 ? "sample" : "samples"}`;
    const lines = [
      `${size}, ${progress}${rate === null ? "" : `, ${rate.toFixed(0)} frames/s`}`,
      `frame ${frame.toFixed(1)} ms (${listed}), sent after ${convert.toFixed(1)} ms`,
    ];
    this.figures.replaceChildren(...lines.map((textContent) => create("div", { textContent })));
  }
}

/** Return a command's text, and a button that copies it. */
function commandElements(command) {
  const copy = createButton("Copy", async () => {
    await navigator.clipboard.writeText(command);
    copy.textContent = "Copied";
  });
  return [create("code", { textContent: command }), copy];
}
