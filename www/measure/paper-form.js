// Scale and paper of the drawing of a measurement, and the buttons that save it.

import { html, render } from "lit-html";
import { t } from "../i18n.js";
import { why } from "../messages.js";
import { Linework } from "./linework.js";
import { nameOf, PAPERS, SCALES, sheetOf } from "./paper.js";

/** @import { MeasureAnswer, MeasureItem } from "../types/page.js" */
/** @import { Files } from "./files.js" */

/** What a drawing is saved with: 50 for 1:50; millimetres of the drawing, and of the sheet under it (null: as large as the drawing). @typedef {{scale: number, size: number[], on: number[] | null}} Ready */

/** Smallest and largest scale (core/measure and the dialog for pictures have the same). */
const [FINE, COARSE] = [0.01, 1e6];

export class PaperForm extends HTMLElement {
  /** @type {Files | null} */
  files = null;
  /** @type {MeasureItem | null} */
  #item = null;
  /** @type {MeasureAnswer | null} */
  #answer = null;
  #work = new Linework([]);
  /** What is chosen. */
  #scale = "";
  #paper = "auto";
  /** Null while it is worked out, or if it cannot be drawn. @type {Ready | null} */
  #ready = null;
  #isTooLarge = false;
  /** Why it cannot be saved, in the language of the page. @type {(() => string) | null} */
  #error = null;
  #asked = 0;

  /** @param {MeasureItem} item */
  set item(item) {
    this.#item = item;
    if (this.#answer !== item.task.answer) {
      this.#answer = item.task.answer;
      this.#work = new Linework(this.#answer?.lines ?? []);
      this.#propose();
    }
    this.#show();
  }

  /** Nothing that was asked for counts any more. */
  disconnectedCallback() {
    this.#asked += 1;
  }

  /** The largest usual scale at which the drawing fits A3. */
  async #propose() {
    await this.#try(async (size) => {
      for (const scale of SCALES) if (sheetOf(await size(scale), "A3").on) return scale;
      return SCALES[SCALES.length - 1];
    });
  }

  /** @param {"scale" | "paper"} what @param {Event} event */
  async #change(what, { target }) {
    const { value } = /** @type {HTMLInputElement} */ (target);
    if (what === "scale") this.#scale = value;
    else this.#paper = value;
    const scale = Number(this.#scale.replace(",", "."));
    if (scale >= FINE && scale <= COARSE) return this.#try(async () => scale);
    this.#asked += 1;
    this.#ready = null;
    this.#error = () => t("sheetNoScale");
    this.#show();
  }

  /**
   * Find a scale, and what the drawing is at it; the last call counts.
   * @param {(size: (scale: number) => Promise<number[]>) => Promise<number>} find
   */
  async #try(find) {
    this.#asked += 1;
    const asked = this.#asked;
    this.#ready = null;
    this.#error = null;
    const size = (/** @type {number} */ scale) => {
      if (!this.files) throw new Error("there is nothing to save with");
      return this.files.sizeOf(this.#work, scale);
    };
    this.#show();
    try {
      const scale = await find(size);
      const mm = await size(scale);
      if (asked !== this.#asked) return;
      const { on, isTooLarge } = sheetOf(mm, this.#paper);
      this.#scale = String(scale);
      this.#isTooLarge = isTooLarge;
      this.#ready = { scale, size: mm, on };
    } catch (error) {
      if (asked !== this.#asked) return;
      this.#error = () => why(error);
    }
    this.#show();
  }

  #words() {
    if (!this.#ready) return this.#error?.() ?? "";
    const { scale, size, on } = this.#ready;
    const [width, height] = (on ?? size).map((mm) => String(this.#isTooLarge ? Math.ceil(mm) : Math.round(mm)));
    if (this.#isTooLarge) return t("plotTooLarge", { scale: String(scale), width, height });
    return `${on ? `${nameOf(on)}: ` : ""}${t("plotSize", { width, height })}`;
  }

  #show() {
    const item = this.#item;
    if (!item) return;
    const change = (/** @type {"scale" | "paper"} */ what) => (/** @type {Event} */ event) => this.#change(what, event);
    const papers = [["auto", t("paperAuto")], ["fit", t("paperFit")], ...PAPERS.map(([name]) => [name, name])];
    const save = (/** @type {string} */ format, /** @type {boolean} */ isReady) =>
      html`<button type="button" class="button outlined" data-act=${format} ?disabled=${!isReady} @click=${() => this.#ready && this.files?.draw(format, item, this.#ready)}>${t("measureDrawing", { format: format.toUpperCase() })}</button>`;
    // A DXF is in metres: the paper does not count.
    render(
      html`<div class="plot-sheet"><label class="field"><span>${t("sheetScale")}</span><input type="text" inputmode="decimal" dir="ltr" data-act="scale" .value=${this.#scale} @change=${change("scale")}></label><label class="field"><span>${t("sheetPaper")}</span><select data-act="paper" @change=${change("paper")}>${papers.map(([value, text]) => html`<option value=${value} ?selected=${value === this.#paper}>${text}</option>`)}</select></label></div>
<p class=${this.#error || this.#isTooLarge ? "error" : "quiet"} role="status">${this.#words()}</p>
<p class="actions">${save("svg", Boolean(this.#ready) && !this.#isTooLarge)}${save("dxf", Boolean(this.#ready))}</p>`,
      this,
    );
  }
}

customElements.define("kilwa-paper", PaperForm);
