// A frame over an image, in the proportions that the network reads: dragged, resized at its corner, or moved by keys.

import { by } from "./svg.js";

const LEAST = 16;  // pixels
const LARGEST = 1024;  // of the crop that is sent

/** Whether the server takes an image as it is: its proportions are right to within a pixel. */
export const fits = (image, [width, height]) =>
  Math.abs(image.naturalWidth * height - image.naturalHeight * width) <= Math.max(image.naturalWidth, image.naturalHeight, width, height);

/** The frame of `image`; `picture` makes a PNG of what is in it. */
export function cropFrame(image, [width, height]) {
  const frame = by("frame");
  let x = 0, y = 0, w = 0;  // of the frame [pixels of the image]
  const h = () => Math.round((w * height) / width);

  function place(left, top, wide) {
    const { naturalWidth: columns, naturalHeight: rows } = image;
    const within = (value, low, high) => Math.round(Math.max(low, Math.min(high, value)));
    w = within(wide, Math.min(LEAST, columns), Math.floor(Math.min(columns, (rows * width) / height)));
    x = within(left, 0, columns - w);
    y = within(top, 0, rows - h());
    const share = (value, whole) => `${(100 * value) / whole}%`;
    Object.assign(frame.style, { left: share(x, columns), top: share(y, rows), width: share(w, columns), height: share(h(), rows) });
    frame.setAttribute("aria-label", `Crop of ${w} by ${h()} pixels, ${x} from the left, ${y} from the top`);
  }

  frame.addEventListener("pointerdown", (down) => {
    down.preventDefault();  // the browser would drag or select what lies under the frame
    frame.focus();
    const scale = image.naturalWidth / image.clientWidth, [x0, y0, w0] = [x, y, w];
    const resizing = down.target !== frame;
    frame.setPointerCapture(down.pointerId);
    frame.onpointermove = (event) => {
      const dx = (event.clientX - down.clientX) * scale, dy = (event.clientY - down.clientY) * scale;
      if (!resizing) place(x0 + dx, y0 + dy, w0);
      else place(x0, y0, Math.min(w0 + Math.max(dx, (dy * width) / height), image.naturalWidth - x0, ((image.naturalHeight - y0) * width) / height));
    };
  });
  for (const name of ["pointerup", "pointercancel"]) frame.addEventListener(name, () => { frame.onpointermove = null; });
  frame.addEventListener("keydown", (event) => {
    const step = (event.shiftKey ? 0.1 : 0.01) * image.naturalWidth;
    const [right, down, wider] = {
      ArrowLeft: [-1, 0, 0], ArrowRight: [1, 0, 0], ArrowUp: [0, -1, 0], ArrowDown: [0, 1, 0],
      "+": [0, 0, 1], "=": [0, 0, 1], "-": [0, 0, -1], _: [0, 0, -1],
    }[event.key] ?? [0, 0, 0];
    if (!right && !down && !wider) return;
    event.preventDefault();
    place(x + right * step, y + down * step, w + wider * step);
  });

  /** The largest frame, in the middle. */
  function reset() {
    const wide = Math.min(image.naturalWidth, (image.naturalHeight * width) / height);
    place((image.naturalWidth - wide) / 2, (image.naturalHeight - (wide * height) / width) / 2, wide);
  }

  async function picture() {
    const scale = Math.min(1, LARGEST / Math.max(w, h()));
    const canvas = Object.assign(document.createElement("canvas"), { width: Math.round(w * scale), height: Math.round(h() * scale) });
    const context = canvas.getContext("2d");
    context.imageSmoothingQuality = "high";
    context.drawImage(image, x, y, w, h(), 0, 0, canvas.width, canvas.height);
    return new Promise((done) => canvas.toBlob(done, "image/png"));
  }

  return { reset, picture };
}
