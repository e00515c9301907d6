"use strict";
// A live view: the viewer shows what the server draws, and the server hears what the viewer's user does.

const RATE_SECONDS = 1; // over which frames per second are counted
const NOTICE_MS = 8000;
const COMMAND_MS = 200; // that a view has to rest before its command is asked for
const RESIZE_MS = 150; // that a window has to keep its size

class Live {
  constructor(viewer) {
    this.viewer = viewer;
    viewer.resized();
    const { width, height } = viewer.canvas;
    this.connection = new Connection(`ws://${location.host}${location.pathname}live?columns=${width}&rows=${height}`);
    const send = (message) => this.connection.send(message);
    this.send = send;
    this.motion = new MotionPicture(viewer);
    this.waiting = new Waiting();
    this.panel = new LivePanel(send);
    this.controls = new CameraControls(viewer, send);
    this.panel.turning.addEventListener("click", () => this.controls.turn(!this.controls.turning));
    this.controls.onturn = (turning) => this.panel.turning.setAttribute("aria-pressed", String(turning));
    this.shownAt = []; // times of the latest pictures in motion, ms
    this.counts = { moving: 0, all: 0 };
    this.header = null;
    this.bar = create("div", { id: "changed", hidden: true });
    const reload = create("button", { type: "button", textContent: "Reload" });
    reload.addEventListener("click", () => send({ type: "reload" }));
    this.bar.append("The scene’s file has changed.", reload);
    this.others = create("tbody");
    document.querySelector("#layers table").after(create("table", { id: "all-layers" }, this.others));
    document.getElementById("stage").append(this.bar);
    this.connection.onpicture = (header, arrays) => this.picture(header, arrays);
    this.connection.addEventListener("message", ({ detail }) => this.message(detail));
    this.connection.addEventListener("closed", () => this.ended());
    viewer.addEventListener("resized", () => {
      clearTimeout(this.resizeTimer);
      this.resizeTimer = setTimeout(() => this.tellSize(), RESIZE_MS);
    });
    viewer.addEventListener("change", () => this.tellDisplay());
    viewer.addEventListener("hover", () => this.probe());
    this.noticeTimer = setTimeout(() => this.notice("", 0), NOTICE_MS); // the viewer may have said something
  }

  message(message) {
    const { type } = message;
    if (type === "scene") this.describe(message);
    else if (type === "state") this.waiting.set(message);
    else if (type === "options") this.panel.follow(message);
    else if (type === "command") this.panel.showCommand(message.command);
    else if (type === "snapshot") this.panel.written(message);
    else if (type === "probe") this.probed(message);
    else if (type === "changed") this.bar.hidden = !message.changed;
    else if (type === "error") this.failed(message.text);
    else if (type === "failed") this.reason = message.text;
  }

  failed(text) {
    this.panel.failed();
    this.notice(text);
  }

  notice(text, ms = NOTICE_MS) {
    clearTimeout(this.noticeTimer);
    this.viewer.dispatchEvent(new CustomEvent("notice", { detail: text }));
    if (ms) this.noticeTimer = setTimeout(() => this.notice("", 0), ms);
  }

  ended() {
    document.body.classList.add("ended");
    this.waiting.end();
    this.notice(this.reason ?? "The view has ended. Start it again for another.", 0);
  }

  /** Pictures are as large as the canvas, in its own pixels. */
  tellSize() {
    const { width, height } = this.viewer.canvas;
    this.send({ type: "size", columns: width, rows: height });
  }

  /** Until a whole picture of this size is there, the viewer has a black image. */
  clear([width, height]) {
    if (this.viewer.image?.width === width && this.viewer.image.height === height) return;
    const black = new Float32Array(width * height);
    this.viewer.pin(null);
    this.viewer.setImage(this.name, { width, height, channels: { R: black, G: black, B: black }, info: {} });
  }

  describe(scene) {
    this.name = scene.name;
    this.bar.hidden = true;
    this.viewer.fill = scene.fills ? 1 : this.viewer.fill;
    if (!this.viewer.images.size) {
      this.clear(scene.resolution);
      Object.assign(this.viewer.initial, { exposure: scene.exposure, operator: scene.tonemap });
      this.viewer.reset();
    }
    this.panel.describe(scene);
    this.tellDisplay();
  }

  /** Tell the server how the viewer shows pictures; where 8 bits of the color would not do, it sends all values. */
  tellDisplay() {
    const { viewer } = this;
    if (!viewer.image) return;
    const { exposure, operator, inStops } = viewer.settings;
    const isColor = viewer.layerOf(viewer.image) === viewer.image.color && viewer.component === null;
    const display = { exposure, tonemap: operator, as_floats: !isColor || inStops || viewer.mode !== "single" };
    const text = JSON.stringify(display);
    if (text === this.display) return;
    this.display = text;
    this.send({ type: "set", ...display });
    if (this.header?.last) this.askForCommand();
  }

  askForCommand() {
    clearTimeout(this.commandTimer);
    this.commandTimer = setTimeout(() => this.send({ type: "command" }), COMMAND_MS);
  }

  picture(header, arrays) {
    this.header = header;
    this.counts.all++;
    this.waiting.shown();
    if (header.moving) this.counts.moving++;
    if (header.type === "picture") {
      this.clear(header.full);
      this.motion.show(header, arrays.rgba);
    } else {
      this.motion.hide();
      const { width, height } = header;
      this.viewer.setImage(this.name, { width, height, channels: arrays, info: { header: this.info(header) } });
    }
    document.body.classList.toggle("unfinished", !header.last);
    document.documentElement.dataset.version = String(header.version);
    if (header.last) this.probe();
    if (header.last) this.askForCommand();
    this.panel.times(header, this.panel.state.samples, this.rate(header));
  }

  /** Return the frames per second in motion, or null where there is no motion. */
  rate({ moving }) {
    const now = performance.now();
    if (!moving) {
      this.shownAt = [];
      return null;
    }
    this.shownAt = [...this.shownAt.filter((at) => now - at < 1000 * RATE_SECONDS), now];
    return this.shownAt.length < 2 ? null : (1000 * (this.shownAt.length - 1)) / (now - this.shownAt[0]);
  }

  info({ camera, samples }) {
    const vectors = Object.entries(camera).map(([name, values]) => [name, values.map((value) => value.toPrecision(6)).join(", ")]);
    return Object.fromEntries([...vectors, ["samples", String(samples)]]);
  }

  /** Ask for the pinned pixel's values in all layers, once the picture is whole. */
  probe() {
    const { pinned } = this.viewer;
    const key = pinned && this.header?.last ? `${this.header.version} ${pinned.x} ${pinned.y}` : null;
    if (key === this.probedKey) return;
    this.probedKey = key;
    if (key) this.send({ type: "probe", column: pinned.x, row: pinned.y });
    else this.others.replaceChildren();
  }

  /** Show the values of the layers that the viewer's image lacks. */
  probed({ version, column, row, values }) {
    const { pinned, image } = this.viewer;
    if (pinned?.x !== column || pinned?.y !== row || version !== this.header.version) return;
    this.probedValues = values;
    const rows = groupChannels(Object.keys(values)).filter(({ channels }) => !channels.every((name) => image.channels.has(name)));
    const number = (each) => Number(String(values[each]).replace("inf", "Infinity"));
    this.others.replaceChildren(...rows.map(({ name, channels }) => {
      const cells = channels.map((each) => create("span", { textContent: formatted(number(each), 5) }));
      const title = channels.map((each) => `${each} ${values[each]}`).join("\n");
      return create("tr", { className: "codes" }, create("th", { textContent: name, scope: "row" }), create("td", { title }, ...cells));
    }));
  }
}

const live = new Live(viewer);
if (location.hash === "#turn") live.controls.turn(true);
