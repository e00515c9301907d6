"use strict";
// The controls of a live view: the camera by mouse, touch and keys, all input between two animation frames in one message;
// and the panel: shader, samples, shadows and so on, layers, lights, snapshot, times.

const TURN_PER_HEIGHT = 360; // degrees for a drag over the canvas's height
const DOLLY_PER_PIXEL = 1.0015; // of the wheel
const FLY_PER_SECOND = 0.8; // of the distance to the point looked at
const FAST = 3; // with Shift
const MIN_MS = 30; // that a key counts as held
const TURN_PER_SECOND = 30; // degrees, while the view turns by itself
const FLY_KEYS = { w: [0, 0, 1], s: [0, 0, -1], a: [-1, 0, 0], d: [1, 0, 0], e: [0, 1, 0], q: [0, -1, 0] };

/** Moves the camera of a viewer. send: a function of a message. */
class CameraControls {
  constructor(viewer, send) {
    this.viewer = viewer;
    this.send = send;
    this.pointers = new Map(); // id -> the latest event of a button or finger that is down
    this.keys = new Set();
    this.fast = false;
    this.turning = false;
    this.onturn = null; // called when the view begins or ends to turn by itself
    this.clear();
    viewer.onpointer = (event, pixel) => this.pointer(event, pixel);
    viewer.canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    // Before the viewer's own keys, some of which these are.
    document.addEventListener("keydown", (event) => this.key(event, true), true);
    document.addEventListener("keyup", (event) => this.key(event, false), true);
    window.addEventListener("blur", () => this.keys.clear());
  }

  clear() {
    this.change = { turn: [0, 0], shift: [0, 0], factor: 1 };
  }

  /** Return true for an event that moves the camera; with Ctrl it is about the image, as without a live view. */
  pointer(event, pixel) {
    if (!this.viewer.image) return false; // the scene is not there yet
    if (event.type === "pointerdown") this.turn(false);
    if (event.type === "wheel") {
      if (event.ctrlKey) return false;
      this.change.factor *= DOLLY_PER_PIXEL ** wheelPixels(event);
      this.request();
      return true;
    }
    if (event.type === "pointerdown") {
      if (event.ctrlKey && !this.pointers.size) return false;
      this.viewer.canvas.setPointerCapture(event.pointerId);
      if (!this.pointers.size) this.start = { x: event.clientX, y: event.clientY, isClick: event.button === 0 };
      else this.start.isClick = false;
      this.pointers.set(event.pointerId, event);
      return true;
    }
    const before = this.pointers.get(event.pointerId);
    if (!before) return false;
    if (event.type === "pointermove") {
      if (Math.hypot(event.clientX - this.start.x, event.clientY - this.start.y) > CLICK_DISTANCE) this.start.isClick = false;
      if (!this.start.isClick) this.drag(before, event);
      if (!this.start.isClick) this.pointers.set(event.pointerId, event);
      return true;
    }
    this.pointers.delete(event.pointerId);
    if (event.type === "pointerup" && this.start.isClick) this.viewer.pin(pixel);
    return true;
  }

  drag(before, event) {
    const [x, y] = [event.clientX - before.clientX, event.clientY - before.clientY];
    const other = [...this.pointers.values()].find((pointer) => pointer.pointerId !== event.pointerId);
    if (other) {
      const distance = (pointer) => Math.hypot(pointer.clientX - other.clientX, pointer.clientY - other.clientY);
      if (distance(event) > 1) this.change.factor *= distance(before) / distance(event);
      this.shift(x / 2, y / 2);
    } else if (event.shiftKey || (event.buttons & 6) !== 0) {
      this.shift(x, y);
    } else {
      const degrees = TURN_PER_HEIGHT / this.viewer.canvas.clientHeight;
      this.change.turn[0] -= x * degrees;
      this.change.turn[1] += y * degrees;
    }
    this.request();
  }

  /** Let what is looked at follow the pointer. */
  shift(x, y) {
    const height = (this.viewer.image.height * this.viewer.view.zoom) / this.viewer.ratio;
    this.change.shift[0] -= x / height;
    this.change.shift[1] += y / height;
  }

  key(event, isDown) {
    const key = event.key.toLowerCase();
    this.fast = event.shiftKey;
    if (!Object.hasOwn(FLY_KEYS, key) && key !== "t") return;
    if (!isDown) {
      requestAnimationFrame(() => this.keys.delete(key)); // after it has moved the camera at least once
      return;
    }
    const typing = event.target.matches?.("select, input[type=number], input[type=text]");
    if (event.ctrlKey || event.altKey || event.metaKey || typing || document.getElementById("help").open) return;
    event.preventDefault();
    event.stopPropagation();
    if (key === "t") {
      if (!event.repeat) this.turn(!this.turning);
      return;
    }
    if (!this.keys.size) this.movedAt = performance.now() - MIN_MS;
    this.keys.add(key);
    this.request();
  }

  /** Let the view turn by itself, or stop it. */
  turn(turning) {
    if (turning === this.turning) return;
    this.turning = turning;
    this.movedAt = performance.now();
    this.onturn?.(turning);
    this.request();
  }

  request() {
    this.frame ??= requestAnimationFrame((now) => {
      this.frame = null;
      this.flush(now);
    });
  }

  flush(now) {
    const { turn, shift, factor } = this.change;
    this.clear();
    if (turn[0] || turn[1]) this.send({ type: "orbit", right: turn[0], up: turn[1] });
    if (shift[0] || shift[1]) this.send({ type: "pan", right: shift[0], up: shift[1] });
    if (factor !== 1) this.send({ type: "dolly", factor });
    if (!this.keys.size && !this.turning) return;
    const seconds = Math.min(0.1, Math.max(0, now - this.movedAt) / 1000);
    this.movedAt = now;
    if (this.turning) this.send({ type: "orbit", right: TURN_PER_SECOND * seconds, up: 0 });
    const way = FLY_PER_SECOND * (this.fast ? FAST : 1) * seconds;
    const [right, up, forward] = [0, 1, 2].map((axis) => way * [...this.keys].reduce((sum, key) => sum + FLY_KEYS[key][axis], 0));
    if (right || up || forward) this.send({ type: "fly", right, up, forward });
    this.request();
  }
}

// The help of a live view: without what is about several images, and with the keys above instead of those they take.
const CAMERA_HELP = ["Camera", [
  ["Drag", "orbit"],
  ["Right drag", "pan; also Shift drag, two fingers"],
  ["Wheel", "zoom; also pinch"],
  ["W A S D, Q E", "fly; faster with Shift"],
  ["T", "turn by itself"],
  ["Ctrl drag, wheel", "move and zoom the image instead"],
]];
const OTHER_KEYS = { "→ ←  or  D A": "→ ←", "Drag, H J K L": "H J K L", "Wheel, + −": "+ −" };
const TAKEN_KEYS = ["1 … 9", "↑ ↓  or  W S", "E, Shift E"];

HELP.splice(0, HELP.length, CAMERA_HELP, ...HELP.filter(([title]) => title !== "Compare").map(([title, keys]) => [
  title, keys.filter(([key]) => !TAKEN_KEYS.includes(key)).map(([key, what]) => [OTHER_KEYS[key] ?? key, what])]));

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
