// A picture of the view as a PNG, of any size up to 16384 pixels a side: rendered in strips that fit the graphics card and
// written row by row (png.js), with the scale bar drawn in where it is wanted.

import { notice } from "./chrome.js";
import { count, niceBelow, round } from "./format.js";
import { t } from "./i18n.js";
import { PngWriter } from "./png.js";
import { download, fileName } from "./store.js";

const $ = (id) => document.getElementById(id);
export const SIDE_MAX = 16384;
/** Rows that are rendered at once: a strip of the widest picture is 64 MB. */
const STRIP = 1024;

/**
 * @param {object} viewer
 * @param {{width: number, height: number, scaleBar?: boolean, transparent?: boolean, onProgress?: (part: number) => void}} options
 * @returns {Promise<Blob>} a PNG
 */
export async function takePicture(viewer, { width, height, scaleBar = true, transparent = false, texts = {}, onProgress = () => {} }) {
  for (const side of [width, height]) {
    if (!Number.isInteger(side) || side < 16 || side > SIDE_MAX) throw new RangeError(t("pictureLimits", { most: count(SIDE_MAX) }));
  }
  const png = new PngWriter(width, height, { alpha: transparent, texts });
  const bar = scaleBar ? drawBar(viewer, width, height) : null;
  for (let y = 0; y < height; y += STRIP) {
    const rows = Math.min(STRIP, height - y);
    const pixels = await strip(viewer, { width, height, y, rows, transparent });
    if (bar) blend(bar, pixels, { width, y, rows });
    await png.rows(pixels);
    onProgress((y + rows) / height);
  }
  return png.end();
}

/** Rows `y .. y + rows` of the whole picture. */
async function strip(viewer, { width, height, y, rows, transparent }) {
  const { pixels } = await viewer.readTile(width, height, 0, y, width, rows, transparent);
  return pixels;
}

/** The scale bar on its plate, for the lower right corner: its pixels and where they go. */
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
  const draw = canvas.getContext("2d");
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

/** Put the part of the bar that lies in these rows over them. */
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
  /** @param {() => {viewer: object, canvas: HTMLCanvasElement, title: string}} page */
  constructor(page) {
    this.page = page;
    $("picture-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.#make();
    });
    $("picture-form").addEventListener("change", () => this.#show());
  }

  open() {
    const { canvas } = this.page();
    if (!$("picture-width").value) [$("picture-width").value, $("picture-height").value] = [canvas.width, canvas.height];
    $("picture-error").hidden = true;
    this.#show();
    $("picture").showModal();
  }

  /** The size of a choice, in pixels; 4K keeps the shape of the view. */
  #size(choice) {
    const { canvas } = this.page();
    const scaled = (factor) => [Math.round(canvas.width * factor), Math.round(canvas.height * factor)].map((v) => Math.min(SIDE_MAX, Math.max(16, v)));
    if (choice === "double") return scaled(2);
    if (choice === "4k") return scaled(3840 / Math.max(canvas.width, canvas.height));
    if (choice === "custom") return [Number($("picture-width").value), Number($("picture-height").value)];
    return scaled(1);
  }

  #chosen() {
    return document.querySelector("input[name=picture-size]:checked").value;
  }

  #show() {
    $("picture-custom").hidden = this.#chosen() !== "custom";
    for (const choice of ["canvas", "double", "4k"]) $(`picture-${choice}`).textContent = this.#size(choice).map((n) => String(n)).join(" × ");
  }

  async #make() {
    const { viewer, title } = this.page();
    const [width, height] = this.#size(this.#chosen());
    const options = {
      width, height, scaleBar: $("picture-scale").checked, transparent: $("picture-clear").checked,
      texts: { Title: title, Software: "Kilwa", Source: location.href },
      onProgress: (part) => ($("picture-bar").value = part),
    };
    $("picture-error").hidden = true;
    $("picture-bar").hidden = false;
    $("picture-bar").value = 0;
    $("picture-make").disabled = true;
    try {
      const blob = await takePicture(viewer, options);
      download(fileName(title, ".png"), blob);
      $("picture").close();
      notice(t("pictureDone", { width: count(width), height: count(height) }));
    } catch (error) {
      $("picture-error").textContent = error instanceof RangeError ? error.message : t("pictureFailed", { why: error.message });
      $("picture-error").hidden = false;
    } finally {
      $("picture-bar").hidden = true;
      $("picture-make").disabled = false;
    }
  }
}
