const ws = new WebSocket(`ws://${location.host}${location.pathname}live`);
ws.binaryType = "arraybuffer";
const canvas = document.getElementById("c"), ctx = canvas.getContext("2d");
window.shown = 0; window.last = null;
ws.onmessage = e => {
  if (typeof e.data === "string") { console.log(e.data.slice(0, 200)); return; }
  const n = new DataView(e.data).getUint32(0, true);
  const h = JSON.parse(new TextDecoder().decode(new Uint8Array(e.data, 8, n)));
  requestAnimationFrame(() => {
    ws.send('{"type":"shown"}'); window.last = h;
    if (h.type === "picture") {
      ctx.putImageData(new ImageData(new Uint8ClampedArray(e.data, 8 + n, h.width * h.height * 4), h.width, h.height), 0, 0);
      if (h.moving) window.shown++;
    }
  });
};
