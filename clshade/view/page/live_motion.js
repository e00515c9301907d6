"use strict";
// Pictures in motion: 8 bits a channel, tone-mapped by the server, over the viewer's canvas where its image is.

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

  /** Go once the viewer has drawn the image that follows. */
  hide() {
    this.leaving = true;
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
