// Drawings to scale: plans and elevations as PNG, PDF or TIFF (of plans GeoTIFF) of any size, drawn part by part and written band by band, so that memory does
// not grow with the sheet. How large it is, what stands on it, what each part looks at and what stands between the bands in the file is core/measure/src/sheet's,
// as for `kilwa render --scale`; here it is drawn, painted and deflated.

import { PngWriter } from "./png.js";
import { detail } from "./screenshot.js";

/** Widest canvas that letters are painted on, pixels. */
const CANVAS = 4096;
/** @import { Mark, Pixels, SheetPlan, Sink, Viewer } from "./types/page.js" */
/** @import { Engine } from "./measure/engine.js" */
/** @import { Session } from "./session.js" */

const ALIGN = /** @type {const} */ ({ start: "left", middle: "center", end: "right" });
export const TYPES = { png: "image/png", pdf: "application/pdf", tif: "image/tiff" };

/**
 * @param {{viewer: Viewer, session: Session}} scene
 * @param {Engine} engine
 * @param {{view: string, scale: number, dpi: number, paper?: string, bare?: boolean, title: string}} asked
 * @param {{format: "png" | "pdf" | "tif", open: (bytes: number) => Promise<Sink>, onProgress?: (part: number) => void, signal?: AbortSignal, texts?: Record<string, string>}} how
 *   `open` gives the place (sink.js) for a file of at most about so many bytes
 * @returns {Promise<{blob: Blob | null, sheet: SheetPlan, isFull: boolean}>} `isFull`: all of it is as fine as its pixels; `sheet.world` is the text of the
 *   world file of a plan; no blob where the file is where the person wanted it
 */
export async function drawSheet({ viewer, session }, engine, asked, { format, open, onProgress = () => {}, signal, texts = {} }) {
  const sheet = await engine.drawing({ ...asked, format, widest: viewer.maxTile() });
  const [width, height] = sheet.size;
  const sink = await open(width * height * 3);
  const camera = viewer.camera();
  const display = viewer.displayState();
  const out = format === "png" ? new PngWriter(width, height, { texts, dotsPerMetre: asked.dpi / 0.0254, sink }) : new StripWriter(sheet, sink);
  let isFull = true;
  try {
    viewer.setDisplayState(JSON.stringify({ ...JSON.parse(display), background: "white" }));
    for (let number = 0; number < sheet.bands; number += 1) {
      const { top, rows, parts } = await sheet.band(number);
      const band = new Uint8ClampedArray(width * rows * 4).fill(255);
      for (const [k, part] of parts.entries()) {
        viewer.aimSheet(asked.view, ...part.target, part.halfHeight);
        viewer.setPicture(part.width, part.height);
        await detail(session, () => {}, signal);
        isFull &&= session.stats?.targetReached ?? false;
        /** @type {Pixels} */
        const { pixels } = await viewer.renderTile(part.width, part.height, 0, 0, part.width, part.height);
        for (let row = 0; row < part.height; row += 1) {
          band.set(pixels.subarray(row * part.width * 4, (row + 1) * part.width * 4), ((part.y - top + row) * width + part.x) * 4);
        }
        onProgress((top + (rows * (k + 1)) / parts.length) / height);
      }
      signal?.throwIfAborted();
      // The page of a PDF has its lines and letters as such.
      if (format !== "pdf") paint(sheet, band, { width, top, rows });
      await out.rows(band);
      onProgress((top + rows) / height);
    }
    return { blob: await out.end(), sheet, isFull };
  } catch (error) {
    await sink.abort();
    throw error;
  } finally {
    if (!session.closed) {
      viewer.setPicture(0, 0);
      viewer.setCamera(camera);
      viewer.setDisplayState(display);
      session.wake();
    }
  }
}

/**
 * The marks of the sheet over some rows, a piece of them at a time: no canvas is as wide as a sheet may be.
 * @param {SheetPlan} sheet
 * @param {Uint8ClampedArray<ArrayBuffer>} band
 * @param {{width: number, top: number, rows: number}} part
 */
function paint({ marks, pixelsPerMm: k }, band, { width, top, rows }) {
  for (let left = 0; left < width; left += CANVAS) {
    const wide = Math.min(CANVAS, width - left);
    const canvas = new OffscreenCanvas(wide, rows);
    const draw = /** @type {OffscreenCanvasRenderingContext2D} */ (canvas.getContext("2d", { willReadFrequently: true }));
    const image = new ImageData(wide, rows);
    for (let row = 0; row < rows; row += 1) image.data.set(band.subarray((row * width + left) * 4, (row * width + left + wide) * 4), row * wide * 4);
    draw.putImageData(image, 0, 0);
    for (const mark of marks) paintMark(draw, mark, { k, left, top });
    const { data } = draw.getImageData(0, 0, wide, rows);
    for (let row = 0; row < rows; row += 1) band.set(data.subarray(row * wide * 4, (row + 1) * wide * 4), (row * width + left) * 4);
  }
}

/**
 * Edges of boxes fall on whole pixels, so that a bar is as long as its words state.
 * @param {OffscreenCanvasRenderingContext2D} draw
 * @param {Mark} mark
 * @param {{k: number, left: number, top: number}} at `k`: pixels of a millimetre
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

/** A file of deflated strips: what stands between them comes from the engine. */
class StripWriter {
  /**
   * @param {SheetPlan} sheet
   * @param {Sink} sink
   */
  constructor(sheet, sink) {
    this.sheet = sheet;
    this.sink = sink;
  }

  /**
   * The next rows: four bytes per pixel.
   * @param {Uint8ClampedArray} pixels
   */
  async rows(pixels) {
    const count = pixels.length / (this.sheet.size[0] * 4);
    const rgb = new Uint8Array((pixels.length / 4) * 3);
    for (let from = 0, to = 0; from < pixels.length; from += 4, to += 3) {
      rgb[to] = pixels[from];
      rgb[to + 1] = pixels[from + 1];
      rgb[to + 2] = pixels[from + 2];
    }
    const packed = new Uint8Array(await new Response(new Blob([rgb]).stream().pipeThrough(new CompressionStream("deflate"))).arrayBuffer());
    await this.sink.write(await this.sheet.strip(count, packed.length));
    await this.sink.write(packed);
  }

  async end() {
    const [tail, head] = await this.sheet.end();
    await this.sink.write(tail);
    if (head.length > 0) await this.sink.head(head);
    return this.sink.end();
  }
}
