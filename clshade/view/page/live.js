"use strict";
// A live view: the viewer shows what the server draws, and the server hears what the viewer's user does.

const RATE_SECONDS = 1; // over which frames per second are counted
const NOTICE_MS = 8000;
const COMMAND_MS = 200; // that a view has to rest before its command is requested
const RESIZE_MS = 150; // that a window has to keep its size
const PICTURE_ARRAYS = { uint8: Uint8ClampedArray, uint32: Uint32Array, float32: Float32Array };
const WAITS = { loading: "Loading the scene", compiling: "Compiling kernels, once per machine", drawing: "Drawing", idle: "Drawing" };

/** The WebSocket. onmessage: a function of a message's object; onpicture: of a picture's header and arrays; onclosed. */
class Connection {
  constructor(address, { onmessage, onpicture, onclosed }) {
    this.waiting = []; // pictures that are not shown yet
    this.onpicture = onpicture;
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.addEventListener("message", ({ data }) => {
      if (typeof data === "string") return onmessage(JSON.parse(data));
      this.waiting.push(data);
      this.frame ??= requestAnimationFrame(() => this.show());
    });
    this.socket.addEventListener("close", onclosed);
  }

  send(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  /** Show the latest picture, skip those before it, and tell the server that all of them are done with. */
  show() {
    this.frame = null;
    const pictures = this.waiting.splice(0);
    try {
      const { header, arrays } = unpackPicture(pictures.at(-1));
      this.onpicture(header, arrays);
    } finally { // the view would stop for ever
      pictures.forEach(() => this.send({ type: "shown" }));
    }
  }
}

/** Return a binary message's header and its arrays by name, views of its memory: see live_session.py. */
function unpackPicture(buffer) {
  const length = new DataView(buffer).getUint32(0, true);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, length)));
  const { width, height } = header;
  const arrays = {};
  for (const { name, type, offset } of header.arrays) {
    arrays[name] = new PICTURE_ARRAYS[type](buffer, 8 + length + offset, width * height * (name === "rgba" ? 4 : 1));
  }
  return { header, arrays };
}

/** What the page waits for: until the first picture, and whenever kernels are compiled. */
class Waiting {
  constructor() {
    this.box = create("div", { id: "waiting", role: "status" });
    document.getElementById("stage").append(this.box);
    this.isFirst = true; // whether no picture was shown yet
    this.set({ state: "loading", seconds: 0 });
    this.timer = setInterval(() => this.update(), 250);
  }

  /** Take over a message on the server's state. */
  set({ state, seconds }) {
    this.state = state;
    this.since = performance.now() - 1000 * seconds;
    this.update();
  }

  shown() {
    if (!this.isFirst) return;
    this.isFirst = false;
    this.update();
  }

  end() {
    clearInterval(this.timer);
    this.box.hidden = true;
  }

  update() {
    const seconds = Math.floor((performance.now() - this.since) / 1000);
    this.box.hidden = !this.isFirst && this.state !== "compiling";
    this.box.textContent = `${WAITS[this.state]}${seconds < 1 ? " …" : `: ${seconds} s`}`;
  }
}

/** Pictures in motion: 8 bits a channel, tone-mapped by the server, over the viewer's canvas where its image is. */
class MotionPicture {
  constructor(viewer) {
    this.viewer = viewer;
    this.canvas = create("canvas", { id: "motion", hidden: true });
    this.context = this.canvas.getContext("2d", { alpha: false });
    viewer.canvas.after(this.canvas);
    viewer.addEventListener("drawn", () => this.place());
  }

  /** Show a picture of any number of pixels where an image of the size `full` is. */
  show({ width, height, full }, codes) {
    const { canvas } = this;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    this.context.putImageData(new ImageData(codes, width, height), 0, 0);
    this.full = full;
    this.leaving = false;
    canvas.hidden = false;
    this.place();
  }

  place() {
    const { canvas, viewer } = this;
    if (this.leaving) canvas.hidden = true;
    if (canvas.hidden) return;
    const { view: { x, y, zoom }, ratio } = viewer;
    const [width, height] = this.full.map((side) => (side * zoom) / ratio);
    Object.assign(canvas.style, { left: `${x / ratio}px`, top: `${y / ratio}px`, width: `${width}px`, height: `${height}px` });
    canvas.classList.toggle("sharp", zoom / ratio >= 2 && canvas.width === this.full[0]);
  }
}

class Live {
  constructor(viewer) {
    this.viewer = viewer;
    viewer.resized();
    const { width, height } = viewer.canvas;
    const send = this.send = (message) => this.connection.send(message);
    this.motion = new MotionPicture(viewer);
    this.waiting = new Waiting();
    this.panel = new LivePanel(send);
    this.controls = new CameraControls(viewer, send);
    this.panel.onturn = () => this.controls.turn(!this.controls.turning);
    this.controls.onturn = (turning) => this.panel.turning.setAttribute("aria-pressed", String(turning));
    this.shownAt = []; // times of the latest pictures in motion, ms
    this.counts = { moving: 0, all: 0 };
    this.header = null;
    this.bar = create("div", { id: "changed", hidden: true }, "The scene’s file has changed.",
      createButton("Reload", () => send({ type: "reload" })));
    this.others = create("tbody");
    document.querySelector("#layers table").after(create("table", { id: "all-layers" }, this.others));
    document.getElementById("stage").append(this.bar);
    const handlers = this.handlers(); // message's type -> function
    this.connection = new Connection(`ws://${location.host}${location.pathname}live?columns=${width}&rows=${height}`, {
      onmessage: (message) => handlers[message.type](message),
      onpicture: (header, arrays) => this.picture(header, arrays),
      onclosed: () => this.ended(),
    });
    viewer.addEventListener("resized", () => {
      clearTimeout(this.resizeTimer);
      this.resizeTimer = setTimeout(() => { // pictures are as large as the canvas, in its pixels
        const { width: columns, height: rows } = viewer.canvas;
        send({ type: "size", columns, rows });
      }, RESIZE_MS);
    });
    viewer.addEventListener("change", () => this.tellDisplay());
    viewer.addEventListener("hover", () => this.probe());
    this.noticeTimer = setTimeout(() => this.notice("", 0), NOTICE_MS); // the viewer may have said something
  }

  /** Return what is done with the server's messages, by their type. */
  handlers() {
    return {
      state: (message) => this.waiting.set(message),
      scene: (message) => this.describe(message),
      options: (message) => this.panel.follow(message),
      changed: ({ changed }) => { this.bar.hidden = !changed; },
      probe: (message) => this.probed(message),
      snapshot: (message) => this.panel.written(message),
      command: ({ command }) => this.panel.showCommand(command),
      error: ({ text }) => {
        this.panel.result.replaceChildren(); // of a snapshot that was requested
        this.notice(text);
      },
      failed: ({ text }) => { this.reason = text; },
    };
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

  /** Until a complete picture of this size is there, the viewer has a black image. */
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
    if (this.header?.last) this.requestCommand();
  }

  requestCommand() {
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
      this.motion.leaving = true; // once the viewer has drawn the image
      const { width, height } = header;
      const vector = (values) => values.map((value) => value.toPrecision(6)).join(", ");
      const facts = Object.entries(header.camera).map(([name, values]) => [name, vector(values)]);
      const info = { header: Object.fromEntries([...facts, ["samples", String(header.samples)]]) };
      this.viewer.setImage(this.name, { width, height, channels: arrays, info });
    }
    document.body.classList.toggle("unfinished", !header.last);
    document.documentElement.dataset.version = String(header.version);
    if (header.last) {
      this.probe();
      this.requestCommand();
    }
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

  /** Request the pinned pixel's values in all layers, once the picture is complete. */
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
    const number = (channel) => Number(String(values[channel]).replace("inf", "Infinity"));
    this.others.replaceChildren(...rows.map(({ name, channels }) => {
      const cells = channels.map((channel) => create("span", { textContent: formatted(number(channel), 5) }));
      const title = channels.map((channel) => `${channel} ${values[channel]}`).join("\n");
      return create("tr", { className: "codes" }, create("th", { textContent: name, scope: "row" }), create("td", { title }, ...cells));
    }));
  }
}

const live = new Live(viewer);
if (location.hash === "#turn") live.controls.turn(true);
