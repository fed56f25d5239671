// The JavaScript side of a drawing to scale, in the measuring worker. The loop is in Rust (core/measure/src/sheet/draw.rs); the page renders the parts
// and keeps the bytes (sheet.js), both on request; the marks are painted and the bytes deflated here.

/** @import { Mark, SheetAsked } from "../types/page.js" */

/** Widest canvas that letters are painted on, pixels. */
const CANVAS = 4096;
const ALIGN = /** @type {const} */ ({ start: "left", middle: "center", end: "right" });

/**
 * `SheetHost` of viewer/measure/src/sheet.rs. Arrays that it is given may lie in the memory of the module: they are read before anything is awaited.
 * @param {SheetAsked} asked
 * @param {(method: string, args: unknown[], transfer?: Transferable[]) => Promise<any>} ask the page
 * @param {(rows: number, all: number) => void} progress
 */
export function sheetHost({ direction }, ask, progress) {
  /** @type {{size: [number, number], pixelsPerMm: number, marks: Mark[]}} */
  let sheet;
  return {
    progress,
    part: (/** @type {number[]} */ ...place) => ask("part", place),
    /**
     * @param {string} action
     * @param {Uint8Array<ArrayBuffer>} bytes
     */
    act(action, bytes) {
      if (action === "deflate") return new Response(new Blob([bytes]).stream().pipeThrough(new CompressionStream(action))).arrayBuffer();
      if (action === "open") {
        sheet = JSON.parse(new TextDecoder().decode(bytes));
        return ask(action, [sheet.size]);
      }
      const copy = bytes.slice();
      return ask(action, [copy], [copy.buffer]);
    },
    /**
     * @param {Uint8Array} rgb
     * @param {number} top
     */
    paint(rgb, top) {
      paint(sheet.marks, rgb, { k: sheet.pixelsPerMm, width: sheet.size[0], top, direction });
    },
  };
}

/**
 * Paint the marks of the sheet over some RGB rows, one piece at a time: a sheet may be wider than any canvas.
 * @param {Mark[]} marks
 * @param {Uint8Array} rgb
 * @param {{k: number, width: number, top: number, direction: CanvasDirection}} band `k`: pixels per millimetre
 */
function paint(marks, rgb, { k, width, top, direction }) {
  const rows = rgb.length / (width * 3);
  for (let left = 0; left < width; left += CANVAS) {
    const wide = Math.min(CANVAS, width - left);
    const canvas = new OffscreenCanvas(wide, rows);
    const draw = /** @type {OffscreenCanvasRenderingContext2D} */ (canvas.getContext("2d", { willReadFrequently: true }));
    const image = new ImageData(wide, rows);
    const pixels = image.data.fill(255);
    for (let row = 0; row < rows; row += 1) {
      for (let x = 0, from = (row * width + left) * 3, to = row * wide * 4; x < wide; x += 1, from += 3, to += 4) {
        pixels[to] = rgb[from];
        pixels[to + 1] = rgb[from + 1];
        pixels[to + 2] = rgb[from + 2];
      }
    }
    draw.putImageData(image, 0, 0);
    draw.direction = direction;
    for (const mark of marks) paintMark(draw, mark, { k, left, top });
    const { data } = draw.getImageData(0, 0, wide, rows);
    for (let row = 0; row < rows; row += 1) {
      for (let x = 0, from = row * wide * 4, to = (row * width + left) * 3; x < wide; x += 1, from += 4, to += 3) {
        rgb[to] = data[from];
        rgb[to + 1] = data[from + 1];
        rgb[to + 2] = data[from + 2];
      }
    }
  }
}

/**
 * Edges of boxes fall on whole pixels, so that a bar is as long as its words state.
 * @param {OffscreenCanvasRenderingContext2D} draw
 * @param {Mark} mark
 * @param {{k: number, left: number, top: number}} at `k`: pixels per millimetre
 */
function paintMark(draw, mark, { k, left, top }) {
  const grey = (/** @type {number} */ g) =>
    `rgb(${Array(3)
      .fill(Math.round(g * 255))
      .join(" ")})`;
  if (mark.is === "box") {
    const [x, y] = mark.at.map((v) => Math.round(v * k));
    const [w, h] = mark.size.map((v) => Math.max(1, Math.round(v * k)));
    draw.fillStyle = grey(mark.grey);
    draw.fillRect(x - left, y - top, w, h);
  } else if (mark.is === "triangle") {
    draw.fillStyle = grey(mark.grey);
    draw.beginPath();
    for (const [x, y] of mark.corners) draw.lineTo(x * k - left, y * k - top);
    draw.fill();
  } else {
    // Capitals are this high.
    draw.font = `${(mark.height * k) / 0.716}px Helvetica, Arial, system-ui, sans-serif`;
    draw.textAlign = ALIGN[mark.anchor];
    draw.fillStyle = grey(0);
    draw.fillText(mark.words, mark.at[0] * k - left, mark.at[1] * k - top);
  }
}
