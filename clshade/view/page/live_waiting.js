"use strict";
// What the page waits for: until the first picture, and whenever kernels are compiled.

const WAITS = { loading: "Loading the scene", compiling: "Compiling kernels, once per machine", drawing: "Drawing", idle: "Drawing" };

class Waiting {
  constructor() {
    this.box = create("div", { id: "waiting", role: "status" });
    document.getElementById("stage").append(this.box);
    this.isFirst = true; // whether no picture was shown yet
    this.set({ state: "loading", seconds: 0 });
    this.timer = setInterval(() => this.update(), 250);
  }

  /** Take over what the server said. */
  set({ state, seconds }) {
    this.state = state;
    this.since = performance.now() - 1000 * seconds;
    this.update();
  }

  /** A picture is shown. */
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
