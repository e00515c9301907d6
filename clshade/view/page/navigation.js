"use strict";
// Panning, zooming, the wipe's line and the pixel below the pointer.

const CLICK_DISTANCE = 4; // CSS pixels; a longer way is a drag

/** Attach mouse, pen and touch to a viewer. */
function attachNavigation(viewer) {
  const { canvas } = viewer;
  const touches = new Map();
  let drag = null;

  const taken = (event) => viewer.onpointer?.(event, viewer.pixelAt(event)) === true;
  const moved = (event) => drag && Math.hypot(event.clientX - drag.startX, event.clientY - drag.startY) > CLICK_DISTANCE;

  canvas.addEventListener("pointerdown", (event) => {
    canvas.focus({ preventScroll: true });
    if (taken(event) || event.button > 1) return;
    canvas.setPointerCapture(event.pointerId);
    touches.set(event.pointerId, event);
    const onLine = viewer.wipeX() !== null && Math.abs(viewer.canvasPoint(event).x - viewer.wipeX()) < 12 * viewer.ratio;
    const { clientX: x, clientY: y } = event;
    drag = { onLine, startX: x, startY: y, x, y, click: touches.size === 1 };
  });
  canvas.addEventListener("pointermove", (event) => {
    if (taken(event)) return;
    viewer.hover(viewer.pixelAt(event), event);
    if (!drag || !touches.has(event.pointerId)) {
      const x = viewer.wipeX();
      canvas.style.cursor = x !== null && Math.abs(viewer.canvasPoint(event).x - x) < 12 * viewer.ratio ? "ew-resize" : "";
      return;
    }
    if (moved(event)) drag.click = false;
    if (touches.size === 2) pinch(event);
    else if (drag.onLine) viewer.setWipe(viewer.canvasPoint(event).x / canvas.width);
    else if (!drag.click) viewer.pan((event.clientX - drag.x) * viewer.ratio, (event.clientY - drag.y) * viewer.ratio);
    touches.set(event.pointerId, event);
    if (!drag.click) Object.assign(drag, { x: event.clientX, y: event.clientY });
  });
  const end = (event) => {
    touches.delete(event.pointerId);
    if (taken(event)) return;
    if (event.type === "pointerup" && drag?.click && !drag.onLine) viewer.pin(viewer.pixelAt(event));
    drag = null;
  };
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("pointercancel", end);
  canvas.addEventListener("pointerleave", () => viewer.hover(null));
  canvas.addEventListener("dblclick", (event) => viewer.toggleActualSize(viewer.canvasPoint(event)));
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    if (taken(event)) return;
    const pixels = event.deltaY * [1, 20, 200][event.deltaMode];
    viewer.zoomBy(2 ** (-Math.max(-240, Math.min(240, pixels)) / 240), viewer.canvasPoint(event));
  }, { passive: false });

  /** Zoom by two fingers, one of which has moved. */
  function pinch(event) {
    const other = [...touches.values()].find((each) => each.pointerId !== event.pointerId);
    const before = touches.get(event.pointerId);
    const distance = (touch) => Math.hypot(touch.clientX - other.clientX, touch.clientY - other.clientY);
    const middle = { clientX: (event.clientX + other.clientX) / 2, clientY: (event.clientY + other.clientY) / 2 };
    viewer.pan((event.clientX - before.clientX) * viewer.ratio / 2, (event.clientY - before.clientY) * viewer.ratio / 2);
    if (distance(before) > 1) viewer.zoomBy(distance(event) / distance(before), viewer.canvasPoint(middle));
  }
}
