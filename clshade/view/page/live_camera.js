"use strict";
// The camera by mouse, touch and keys: orbit, pan, dolly, fly. All input between two animation frames is one message.

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
