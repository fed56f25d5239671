// Drawings to scale: plans and elevations as PNG or PDF, drawn part by part, so that memory does not grow with the sheet's picture. How large it is,
// what stands on it and what each part looks at is core/measure/src/sheet's, as for `kilwa render --scale`; here it is painted and written.

import { PngWriter } from "./png.js";
import { detail } from "./screenshot.js";

/** Largest side that browsers draw letters on. */
export const SHEET_SIDE_MAX = 16384;
const POINTS = 72 / 25.4;

/**
 * @param {{viewer: object, session: import("./session.js").Session}} page
 * @param {object} engine of measure/engine.js
 * @param {{view: string, scale: number, dpi: number, paper?: string, bare?: boolean, title: string}} asked
 * @param {{format: "png" | "pdf", onProgress?: (part: number) => void, signal?: AbortSignal, texts?: object}} how
 * @returns {Promise<{blob: Blob, sheet: object, isFull: boolean}>} `isFull`: all of it is as fine as its pixels
 */
export async function drawSheet({ viewer, session }, engine, asked, { format, onProgress = () => {}, signal, texts = {} }) {
  const sheet = await engine.sheet({ ...asked, widest: viewer.maxTile() });
  const [width, height] = sheet.size;
  if (Math.max(width, height) > SHEET_SIDE_MAX) throw new RangeError(`${width} × ${height} > ${SHEET_SIDE_MAX}`);
  const camera = new Float64Array(viewer.camera());
  const display = viewer.displayState();
  const out = format === "pdf" ? new PdfWriter(sheet, asked) : new PngWriter(width, height, { texts, dotsPerMetre: asked.dpi / 0.0254 });
  let isFull = true;
  try {
    viewer.setDisplayState(JSON.stringify({ ...JSON.parse(display), background: "white" }));
    for (const { top, rows, parts } of sheet.bands) {
      const band = new Uint8ClampedArray(width * rows * 4).fill(255);
      for (const [k, part] of parts.entries()) {
        viewer.aimSheet(asked.view, ...part.target, part.halfHeight);
        viewer.setPicture(part.width, part.height);
        await detail(session, () => {}, signal);
        isFull &&= session.stats.targetReached;
        const { pixels } = await viewer.renderTile(part.width, part.height, 0, 0, part.width, part.height);
        for (let row = 0; row < part.height; row += 1) {
          band.set(pixels.subarray(row * part.width * 4, (row + 1) * part.width * 4), ((part.y - top + row) * width + part.x) * 4);
        }
        onProgress((top + (rows * (k + 1)) / parts.length) / height);
      }
      signal?.throwIfAborted();
      // The page of a PDF has its lines and letters as such.
      await out.rows(format === "pdf" ? band : painted(sheet, band, { width, top, rows }));
      onProgress((top + rows) / height);
    }
    return { blob: await out.end(), sheet, isFull };
  } finally {
    if (!session.closed) {
      viewer.setPicture(0, 0);
      viewer.setCamera(camera);
      viewer.setDisplayState(display);
      session.wake();
    }
  }
}

/** The marks of the sheet over some rows. Edges of boxes fall on whole pixels, so that a bar is as long as it says. */
function painted({ marks, pixelsPerMm: k }, band, { width, top, rows }) {
  const canvas = new OffscreenCanvas(width, rows);
  const draw = canvas.getContext("2d", { willReadFrequently: true });
  draw.putImageData(new ImageData(band, width, rows), 0, 0);
  const grey = (g) => `rgb(${Array(3).fill(Math.round(g * 255)).join(" ")})`;
  for (const mark of marks) {
    if (mark.is === "box") {
      const [x, y] = mark.at.map((v) => Math.round(v * k));
      const [w, h] = mark.size.map((v) => Math.max(1, Math.round(v * k)));
      draw.fillStyle = grey(mark.grey);
      draw.fillRect(x, y - top, w, h);
    } else if (mark.is === "triangle") {
      draw.fillStyle = grey(mark.grey);
      draw.beginPath();
      for (const [x, y] of mark.corners) draw.lineTo(x * k, y * k - top);
      draw.fill();
    } else {
      // Capitals are this high.
      draw.font = `${(mark.height * k) / 0.716}px Helvetica, Arial, system-ui, sans-serif`;
      draw.textAlign = { start: "left", middle: "center", end: "right" }[mark.anchor];
      draw.fillStyle = grey(0);
      draw.fillText(mark.words, mark.at[0] * k, mark.at[1] * k - top);
    }
  }
  return new Uint8Array(draw.getImageData(0, 0, width, rows).data.buffer);
}

/** PDF 1.4 (ISO 32000-1): one page of the paper's size, the picture as deflated strips, lines and letters as such. */
class PdfWriter {
  constructor(sheet, asked) {
    Object.assign(this, { sheet, asked, parts: [], at: 0, offsets: [], row: 0, images: "", content: "" });
    this.#put(new Uint8Array([...new TextEncoder().encode("%PDF-1.4\n%"), 0xe2, 0xe3, 0xcf, 0xd3, 10]));
    this.page = sheet.paper.map((mm) => mm * POINTS);
  }

  #put(bytes) {
    const data = typeof bytes === "string" ? new TextEncoder().encode(bytes) : bytes;
    this.parts.push(data);
    this.at += data.length;
  }

  /** A new object; its number. */
  #object(...body) {
    this.offsets.push(this.at);
    const number = this.offsets.length;
    for (const part of [`${number} 0 obj\n`, ...body, "\nendobj\n"]) this.#put(part);
    return number;
  }

  async #stream(entries, bytes) {
    const packed = await new Response(new Blob([bytes]).stream().pipeThrough(new CompressionStream("deflate"))).arrayBuffer();
    return this.#object(`<< ${entries} /Filter /FlateDecode /Length ${packed.byteLength} >>\nstream\n`, new Uint8Array(packed), "\nendstream");
  }

  /** The next rows: four bytes per pixel. */
  async rows(pixels) {
    const [width] = this.sheet.size;
    const count = pixels.length / (width * 4);
    const rgb = new Uint8Array(width * count * 3);
    for (let from = 0, to = 0; from < pixels.length; from += 4, to += 3) {
      rgb[to] = pixels[from];
      rgb[to + 1] = pixels[from + 1];
      rgb[to + 2] = pixels[from + 2];
    }
    const number = await this.#stream(`/Type /XObject /Subtype /Image /Width ${width} /Height ${count} /ColorSpace /DeviceRGB /BitsPerComponent 8`, rgb);
    const dot = 72 / this.asked.dpi;
    this.images += `/B${this.row} ${number} 0 R `;
    const bottom = this.page[1] - (this.row + count) * dot;
    this.content += `q ${(width * dot).toFixed(5)} 0 0 ${(count * dot).toFixed(5)} 0 ${bottom.toFixed(5)} cm /B${this.row} Do Q\n`;
    this.row += count;
  }

  async end() {
    const content = await this.#stream("", new TextEncoder().encode(this.content + this.sheet.pdf));
    const font = this.#object("<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>");
    const parent = this.offsets.length + 2;
    const [w, h] = this.page.map((v) => v.toFixed(4));
    const page = this.#object(
      `<< /Type /Page /Parent ${parent} 0 R /MediaBox [0 0 ${w} ${h}] /Contents ${content} 0 R /Resources << /Font << /F ${font} 0 R >> /XObject << ${this.images}>> >> >>`,
    );
    const pages = this.#object(`<< /Type /Pages /Kids [${page} 0 R] /Count 1 >>`);
    const catalog = this.#object(`<< /Type /Catalog /Pages ${pages} 0 R >>`);
    // A title in UTF-16 holds every script.
    const title = [...Array(this.asked.title.length).keys()].map((i) => this.asked.title.charCodeAt(i).toString(16).padStart(4, "0")).join("");
    const info = this.#object(`<< /Title <FEFF${title}> /Producer (Kilwa) >>`);
    const table = this.at;
    const entries = this.offsets.map((offset) => `${String(offset).padStart(10, "0")} 00000 n \n`).join("");
    const size = this.offsets.length + 1;
    this.#put(`xref\n0 ${size}\n0000000000 65535 f \n${entries}`);
    this.#put(`trailer\n<< /Size ${size} /Root ${catalog} 0 R /Info ${info} 0 R >>\nstartxref\n${table}\n%%EOF\n`);
    return new Blob(this.parts, { type: "application/pdf" });
  }
}
