// A picture of the view as a PNG, of any size up to 16384 pixels a side: rendered in strips that fit the graphics card and
// written row by row (png.js), with the scale bar drawn in where it is wanted.

import { notice } from "./chrome.js";
import { $, input } from "./dom.js";
import { count, isolate, niceBelow, round } from "./format.js";
import { t } from "./i18n.js";
import { why } from "./messages.js";
import { PngWriter } from "./png.js";
import { openSink } from "./sink.js";
import { download, fileName } from "./store.js";

/** @import { Pixels, Viewer } from "./types/page.js" */
/** @import { Session } from "./session.js" */

/**
 * What pictures and drawings are made of.
 * @typedef {object} Pictured
 * @property {Viewer} viewer
 * @property {Session} session
 * @property {string} title
 * @property {() => Promise<import("./measure/engine.js").Engine>} engine
 */

export const SIDE_MAX = 16384;
/** Rows that are rendered at once: a strip of the widest picture is 64 MB. */
const STRIP = 1024;

/**
 * @param {{viewer: Viewer, session: Session}} scene
 * @param {{width: number, height: number, scaleBar?: boolean, transparent?: boolean, texts?: Record<string, string>, onProgress?: (part: number) => void, signal?: AbortSignal}} options
 * @returns {Promise<Blob>} a PNG
 */
export async function takePicture({ viewer, session }, { width, height, scaleBar = true, transparent = false, texts = {}, onProgress = () => {}, signal }) {
  for (const side of [width, height]) {
    if (!Number.isInteger(side) || side < 16 || side > SIDE_MAX) throw new RangeError(t("pictureLimits", { most: count(SIDE_MAX) }));
  }
  const display = viewer.displayState();
  try {
    if (transparent) viewer.setDisplayState(JSON.stringify({ ...JSON.parse(display), background: "transparent" }));
    viewer.setPicture(width, height);
    await detail(session, (part) => onProgress(part * 0.5), signal);
    const png = new PngWriter(width, height, { alpha: transparent, texts });
    const bar = scaleBar ? drawBar(viewer, width, height) : null;
    const tall = Math.min(STRIP, viewer.maxTile());
    for (let y = 0; y < height; y += tall) {
      const rows = Math.min(tall, height - y);
      const pixels = await strip(viewer, { width, height, y, rows });
      signal?.throwIfAborted();
      if (bar) blend(bar, pixels, { width, y, rows });
      await png.rows(pixels);
      onProgress(0.5 + (0.5 * (y + rows)) / height);
    }
    // Into a Blob, since no other sink was given.
    return /** @type {Blob} */ (await png.end());
  } finally {
    if (!session.closed) {
      viewer.setPicture(0, 0);
      viewer.setDisplayState(display);
      session.wake();
    }
  }
}

/**
 * Until the detail that a picture of this size shows is loaded.
 * @param {Session} session
 * @param {(part: number) => void} onProgress
 * @param {AbortSignal} [signal]
 * @returns {Promise<void>}
 */
export function detail(session, onProgress, signal) {
  return new Promise((resolve, reject) => {
    const look = () => {
      const { stats, closed, isSettled } = session;
      if (stats && stats.bytesWanted > 0) onProgress(1 - stats.bytesMissing / stats.bytesWanted);
      if (signal?.aborted) reject(signal.reason);
      else if (closed) reject(new Error(t("brokenTitle")));
      else if (isSettled) resolve();
      else return;
      session.watchers.delete(look);
      signal?.removeEventListener("abort", look);
    };
    session.watchers.add(look);
    signal?.addEventListener("abort", look);
    session.wake(); // for the frame in which the picture's new size takes effect
    if (signal?.aborted || session.closed) look();
  });
}

/**
 * Rows `y .. y + rows` of the whole picture, from tiles side by side.
 * @param {Viewer} viewer
 * @param {{width: number, height: number, y: number, rows: number}} part
 */
async function strip(viewer, { width, height, y, rows }) {
  const widest = viewer.maxTile();
  const out = new Uint8Array(width * rows * 4);
  for (let x = 0; x < width; x += widest) {
    const part = Math.min(widest, width - x);
    /** @type {Pixels} */
    const { pixels } = await viewer.renderTile(width, height, x, y, part, rows);
    for (let row = 0; row < rows; row += 1) out.set(pixels.subarray(row * part * 4, (row + 1) * part * 4), (row * width + x) * 4);
  }
  return out;
}

/**
 * The scale bar on its plate, for the lower right corner: its pixels and where they go; null where it has no room.
 * @param {Viewer} viewer
 * @param {number} width
 * @param {number} height
 */
function drawBar(viewer, width, height) {
  const unit = Math.max(1, Math.min(width, height) / 600);
  // The picture's height shows what the canvas's height shows.
  const metresPerPixel = (viewer.metresPerPixel() * $("canvas").height) / height;
  const metres = niceBelow(metresPerPixel * 110 * unit);
  const long = metres / metresPerPixel;
  const canvas = document.createElement("canvas");
  canvas.width = Math.ceil(long + 32 * unit);
  canvas.height = Math.ceil(44 * unit);
  if (canvas.width > width || canvas.height > height) return null;
  const draw = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  draw.fillStyle = "rgb(255 252 245 / 88%)";
  draw.beginPath();
  draw.roundRect(0, 0, canvas.width, canvas.height, 6 * unit);
  draw.fill();
  draw.strokeStyle = draw.fillStyle = "#2b2620";
  draw.lineWidth = 1.5 * unit;
  draw.beginPath();
  draw.moveTo(16 * unit, 26 * unit);
  draw.lineTo(16 * unit, 34 * unit);
  draw.lineTo(16 * unit + long, 34 * unit);
  draw.lineTo(16 * unit + long, 26 * unit);
  draw.stroke();
  draw.font = `${13 * unit}px system-ui, sans-serif`;
  draw.textAlign = "center";
  draw.fillText(round(metres), canvas.width / 2, 20 * unit);
  const margin = Math.round(12 * unit);
  return { data: draw.getImageData(0, 0, canvas.width, canvas.height), x: width - canvas.width - margin, y: height - canvas.height - margin };
}

/**
 * Put the part of the bar that lies in these rows over them.
 * @param {{data: ImageData, x: number, y: number}} bar
 * @param {Uint8Array} pixels
 * @param {{width: number, y: number, rows: number}} part
 */
function blend({ data: { data, width: w, height: h }, x, y: top }, pixels, { width, y, rows }) {
  if (x < 0 || top < 0) return;
  for (let row = Math.max(top, y); row < Math.min(top + h, y + rows); row += 1) {
    for (let column = 0; column < w; column += 1) {
      const from = ((row - top) * w + column) * 4;
      const to = ((row - y) * width + x + column) * 4;
      const [over, under] = [data[from + 3] / 255, pixels[to + 3] / 255];
      const alpha = over + under * (1 - over);
      for (let c = 0; c < 3 && alpha > 0; c += 1) {
        pixels[to + c] = Math.round((data[from + c] * over + pixels[to + c] * under * (1 - over)) / alpha);
      }
      pixels[to + 3] = Math.round(alpha * 255);
    }
  }
}

/** The dialog. */
export class PictureDialog {
  /** @param {() => Pictured} source */
  constructor(source) {
    this.source = source;
    /** While a picture is made. @type {AbortController | null} */
    this.abort = null;
    $("picture").addEventListener("close", () => this.abort?.abort());
    $("picture-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#make();
    });
    $("picture-form").addEventListener("change", () => this.#show());
  }

  open() {
    const { canvas } = this.source().session;
    if (!$("picture-width").value) {
      $("picture-width").value = String(canvas.width);
      $("picture-height").value = String(canvas.height);
    }
    $("picture-error").hidden = true;
    this.#show();
    $("picture").showModal();
  }

  /**
   * The size of a choice, in pixels; 4K keeps the shape of the view.
   * @param {string} choice
   */
  #size(choice) {
    const { canvas } = this.source().session;
    const scaled = (/** @type {number} */ factor) =>
      [Math.round(canvas.width * factor), Math.round(canvas.height * factor)].map((v) => Math.min(SIDE_MAX, Math.max(16, v)));
    if (choice === "double") return scaled(2);
    if (choice === "4k") return scaled(3840 / Math.max(canvas.width, canvas.height));
    if (choice === "custom") return [Number($("picture-width").value), Number($("picture-height").value)];
    return scaled(1);
  }

  #chosen() {
    return input("input[name=picture-size]:checked").value;
  }

  #show() {
    $("picture-custom").hidden = this.#chosen() !== "custom";
    const isSheet = this.#chosen() === "sheet";
    $("picture-sheet").hidden = !isSheet;
    $("sheet-size").hidden = $("sheet-paper").value !== "custom";
    // A sheet has its own scale bar, on white.
    for (const id of /** @type {const} */ (["picture-scale", "picture-clear"])) $(id).disabled = isSheet;
    for (const choice of /** @type {const} */ (["canvas", "double", "4k"])) $(`picture-${choice}`).textContent = isolate(this.#size(choice).join(" × "));
  }

  /**
   * A drawing to scale.
   * @param {Pictured} page
   * @param {{onProgress: (part: number) => void, signal: AbortSignal, texts: Record<string, string>}} how
   */
  async #sheet(page, { onProgress, signal, texts }) {
    const [{ drawSheet, TYPES }, engine] = await Promise.all([import("./sheet.js"), page.engine()]);
    const paper = $("sheet-paper").value === "custom" ? $("sheet-custom").value : $("sheet-paper").value;
    const asked = {
      view: $("sheet-view").value,
      scale: Number($("sheet-scale").value),
      dpi: Number($("sheet-dpi").value),
      paper: paper || undefined,
      title: page.title,
      bare: $("sheet-bare").checked,
      format: /** @type {keyof typeof TYPES} */ ($("sheet-format").value),
    };
    const { format } = asked;
    const name = `.${asked.view}-1-${asked.scale}`;
    const open = (/** @type {number} */ bytes) => openSink({ name: fileName(page.title, `${name}.${format}`), type: TYPES[format], bytes });
    const { blob, isFull, ...sheet } = await drawSheet(page, engine, asked, { open, onProgress, signal, texts });
    if (blob) download(fileName(page.title, `${name}.${format}`), blob);
    const [width, height] = sheet.paper.map((mm) => count(Math.round(mm)));
    const words = t(isFull ? "sheetDone" : "sheetCoarse", { scale: count(asked.scale), width, height });
    // Browsers let one press save one file: the world file has a press of its own.
    const world = format === "png" && sheet.world;
    const save = { label: t("sheetWorld"), run: () => download(fileName(page.title, `${name}.pgw`), new Blob([sheet.world ?? ""], { type: "text/plain" })) };
    notice(words, world ? 60_000 : isFull ? 6000 : 15000, world ? save : null);
  }

  async #make() {
    const page = this.source();
    const { title } = page;
    this.abort = new AbortController();
    const isSheet = this.#chosen() === "sheet";
    const [width, height] = this.#size(this.#chosen());
    const options = {
      width,
      height,
      scaleBar: $("picture-scale").checked,
      transparent: $("picture-clear").checked,
      texts: { Title: title, Software: "Kilwa", Source: location.href },
      onProgress: (/** @type {number} */ part) => {
        $("picture-bar").value = part;
      },
      signal: this.abort.signal,
    };
    $("picture-error").hidden = true;
    $("picture-bar").hidden = false;
    $("picture-bar").value = 0;
    $("picture-make").disabled = true;
    try {
      if (isSheet) await this.#sheet(page, options);
      else download(fileName(title, ".png"), await takePicture(page, options));
      this.abort = null;
      $("picture").close();
      if (!isSheet) notice(t("pictureDone", { width: count(width), height: count(height) }));
    } catch (error) {
      if (error.name === "AbortError") return; // The dialog was closed.
      $("picture-error").textContent = error instanceof RangeError ? error.message : isSheet ? why(error) : t("pictureFailed", { why: why(error) });
      $("picture-error").hidden = false;
    } finally {
      $("picture-bar").hidden = true;
      $("picture-make").disabled = false;
    }
  }
}
