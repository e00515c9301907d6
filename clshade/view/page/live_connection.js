"use strict";
// The WebSocket of a live view: text messages as events, pictures in the order in which they come.

/** Events: `message` with a text message's object as detail, `closed`. onpicture: a function of a header and its arrays. */
class Connection extends EventTarget {
  constructor(address) {
    super();
    this.onpicture = null;
    this.waiting = []; // pictures that are not shown yet
    this.socket = new WebSocket(address);
    this.socket.binaryType = "arraybuffer";
    this.socket.addEventListener("message", ({ data }) => this.received(data));
    this.socket.addEventListener("close", () => this.dispatchEvent(new Event("closed")));
  }

  send(message) {
    if (this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  received(data) {
    if (typeof data === "string") {
      this.dispatchEvent(new CustomEvent("message", { detail: JSON.parse(data) }));
      return;
    }
    this.waiting.push(data);
    this.frame ??= requestAnimationFrame(() => this.show());
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

const PICTURE_ARRAYS = { uint8: Uint8ClampedArray, uint32: Uint32Array, float32: Float32Array };

/** Return a binary message's header and its arrays by name, views of its memory: see live_message.py. */
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
