// The Measurements tab: the tools, their options, and the table (row.js). Values are text that can be selected and copied; a row opens to show everything
// of its measurement.

import { html } from "lit-html";
import { $ } from "../dom.js";
import { niceBelow } from "../format.js";
import { t } from "../i18n.js";
import { stepName } from "../undo.js";
import { forget, icon, keepingFocus, show } from "../view.js";
import { FORMATS } from "./files.js";
import { Rows } from "./row.js";
import { GROUPS, SNAPS, TOOLS, toolOf } from "./tools.js";
import { UNITS } from "./values.js";

/** @import { MeasureItem, MeasureTool } from "../types/page.js" */
/** @import { Draft } from "./draft.js" */
/** @import { Files } from "./files.js" */
/** @import { Items } from "./items.js" */
/** @import { Runner } from "./runner.js" */
/** @import { Sharing } from "./sharing.js" */
/** @import { PlaneChoice } from "./task.js" */

/** What cut and fill and deviation count from. */
const PLANES = { fitted: "planeFitted", lowest: "planeLowest", height: "planeAtHeight" };

/**
 * @typedef {object} PanelParts
 * @property {Items} items
 * @property {Draft} draft
 * @property {Runner} runner
 * @property {Files} files
 * @property {Sharing} sharing
 * @property {import("../undo.js").Undo} undo
 * @property {{bounds_min: number[], bounds_max: number[], median_edge: number}} bounds of the model, and the spacing of its mesh
 * @property {() => {unit: string, snap: string, isLong: boolean, setUnit: (unit: string) => void, setSnap: (snap: string) => void}} settings
 * @property {(item: MeasureItem) => string[]} lines the value of a measurement, as its label has it
 * @property {(id: string) => void} choose open a measurement
 * @property {(item: MeasureItem, world: number[] | null) => void} pointed a place on its drawing is under the pointer, or none any more
 */

/** The field that an event happened to. @param {Event} event */
const fieldOf = ({ target }) => /** @type {HTMLInputElement} */ (target);

export class Panel {
  #parts;

  /** @param {PanelParts} parts */
  constructor(parts) {
    this.#parts = parts;
    this.rows = new Rows(parts);
    this.planeBy = "fitted";
    this.height = "0";
    this.interval_ = usualInterval(parts.bounds);
    this.format = FORMATS[0][0];
  }

  close() {
    show(html`<p class="quiet">${t("measureLoading")}</p>`, $("measure"));
  }

  /** All of the tab, in another language. */
  build() {
    forget($("measure"));
    this.show();
  }

  /** The tool in use, and its options. */
  showTools() {
    this.show();
  }

  /** What cut and fill and deviation count from. @returns {PlaneChoice} */
  planeChoice() {
    return this.planeBy === "height" ? { name: this.planeBy, height: Number(this.height) } : { name: this.planeBy };
  }

  interval() {
    return Number(this.interval_);
  }

  show() {
    const tab = $("measure");
    keepingFocus(tab, () => show(this.#tab(), tab));
  }

  /**
   * How far a measurement is.
   * @param {MeasureItem | null} item
   */
  progress(item) {
    if (item) this.show();
  }

  /** @param {string} id */
  focus(id) {
    const button = /** @type {HTMLElement | null} */ ($("measure").querySelector(`[data-id="${CSS.escape(id)}"] .go`));
    button?.focus();
    button?.scrollIntoView({ block: "nearest" });
  }

  /**
   * The sentence that cites a measurement, below it, and the address that leads back to it.
   * @param {string} id
   * @param {string} words
   * @param {string | null} address
   */
  cited(id, words, address) {
    this.rows.sentences.set(id, { words, address });
    this.show();
  }

  #tab() {
    const { items, files, undo } = this.#parts;
    const { isLong } = this.#parts.settings();
    const isEmpty = items.all.length === 0;
    const button = (/** @type {string} */ key, /** @type {() => void} */ click, disabled = false) =>
      html`<button type="button" class="button outlined" ?disabled=${disabled} @click=${click}><span>${t(key)}</span></button>`;
    const next = undo.next("measurements");
    const step = (/** @type {"undo" | "redo"} */ way) =>
      html`<button type="button" class="button outlined" ?disabled=${!next[way]} @click=${() => undo[way]("measurements")}>${icon(way)}<span>${stepName(way, next[way])}</span></button>`;
    const read = (/** @type {Event} */ event) => {
      const field = fieldOf(event);
      const [file] = field.files ?? [];
      field.value = "";
      if (file) files.read(file);
    };
    return html`${this.#tools()}${this.#options()}
<h2>${t("measurements")}</h2>
<p class="quiet" ?hidden=${!isEmpty}>${t("measureNone")}</p>
<table class="measure-table" role="table" ?hidden=${isEmpty}>
<caption class="hidden">${t("measurements")}</caption>
<thead class="hidden" role="rowgroup"><tr role="row"><th role="columnheader">${t("name")}</th><th role="columnheader">${t("channel")}</th></tr></thead>
<tbody role="rowgroup">${items.all.map((item, at) => this.rows.row(item, at))}</tbody>
</table>
<p class="quiet" ?hidden=${!isLong}>${t("measureLinkLong")}</p>
<p class="actions">${step("undo")}${step("redo")}${button("measureDeleteAll", () => items.removeAll(), isEmpty)}</p>
<p class="actions">
<select data-label="measureFormat" aria-label=${t("measureFormat")} @change=${(/** @type {Event} */ event) => {
      this.format = fieldOf(event).value;
    }}>${FORMATS.map(([value, key]) => html`<option value=${value} ?selected=${value === this.format}>${t(key)}</option>`)}</select>
${button("exportFile", () => files.save(this.format), isEmpty)}
<label class="button outlined" for="measure-import"><span>${t("importFile")}</span></label>
<input class="hidden" type="file" id="measure-import" accept=".json,application/json" aria-label=${t("importFile")} @change=${read}>
</p>`;
  }

  /** The tools: those that are used often, and all of them in a list that opens. */
  #tools() {
    const { drawn, kind } = this.#parts.draft;
    const tool = (/** @type {MeasureTool | undefined} */ one) =>
      one &&
      html`<button type="button" class="tool" data-tool=${one.id} aria-pressed=${Boolean(drawn) && one === kind} @click=${() => this.#use(one)}>${icon(one.id, "measure")}<span>${t(one.key)}</span></button>`;
    const group = ([key, ids] = GROUPS[0]) => html`<section><h3>${t(key)}</h3><div class="tools">${ids.map((id) => tool(toolOf(id)))}</div></section>`;
    const every = (/** @type {Event} */ event) => {
      this.interval_ = fieldOf(event).value;
    };
    // The interval is beside the tool that it is for.
    return html`<div class="tools often">${TOOLS.filter((one) => one.often).map(tool)}</div>
<details class="more-tools">
<summary>${icon("more", "measure")}<span>${t("measureMore")}</span><strong>${drawn && !kind.often ? t(kind.key) : ""}</strong></summary>
${GROUPS.slice(0, -1).map(group)}
${this.#lastGroup(tool, every)}
</details>`;
  }

  /**
   * The lines, and from contour to contour.
   * @param {(one: MeasureTool | undefined) => unknown} tool
   * @param {(event: Event) => void} every
   */
  #lastGroup(tool, every) {
    const [key, ids] = GROUPS[GROUPS.length - 1];
    return html`<section><h3>${t(key)}</h3><div class="tools">${ids.map((id) => tool(toolOf(id)))}</div><label class="field"><span>${t("contoursEvery")}</span><input type="number" min="0" step="any" inputmode="decimal" .value=${this.interval_} @input=${every}></label></section>`;
  }

  /** What the tool in use needs to know, what points snap to, and the unit. */
  #options() {
    const { drawn, kind } = this.#parts.draft;
    const { unit, snap, setUnit, setSnap } = this.#parts.settings();
    const hasPlane = Boolean(drawn) && Boolean(kind.plane);
    const choices = (/** @type {[string, string][]} */ all, /** @type {string} */ chosen) =>
      all.map(([value, text]) => html`<option value=${value} ?selected=${value === chosen}>${text}</option>`);
    const named = (/** @type {Record<string, string>} */ keys) => Object.entries(keys).map(([value, key]) => /** @type {[string, string]} */ ([value, t(key)]));
    const setPlane = (/** @type {Event} */ event) => {
      this.planeBy = fieldOf(event).value;
      this.show();
    };
    const setHeight = (/** @type {Event} */ event) => {
      this.height = fieldOf(event).value;
    };
    return html`<label class="field" ?hidden=${!hasPlane}><span>${t("planeBy")}</span><select .value=${this.planeBy} @change=${setPlane}>${choices(named(PLANES), this.planeBy)}</select></label>
<label class="field" ?hidden=${!hasPlane || this.planeBy !== "height"}><span>${t("planeHeight")}</span><input type="number" step="any" inputmode="decimal" .value=${this.height} @input=${setHeight}></label>
<label class="field"><span>${t("measureSnap")}</span><select .value=${snap} @change=${(/** @type {Event} */ event) => setSnap(fieldOf(event).value)}>${choices(named(SNAPS), snap)}</select></label>
<label class="field"><span>${t("measureUnit")}</span><select .value=${unit} @change=${(/** @type {Event} */ event) => setUnit(fieldOf(event).value)}>${choices(
      UNITS.map((u) => [u, u]),
      unit,
    )}</select></label>`;
  }

  /**
   * The list of all tools gives its space to the table again.
   * @param {MeasureTool} tool
   */
  #use(tool) {
    const more = $("measure").querySelector("details");
    if (more) more.open = false;
    this.#parts.draft.use(tool.id);
  }
}

/**
 * From contour to contour: a twentieth of the height, as a round number.
 * @param {{bounds_min: number[], bounds_max: number[]}} bounds
 */
function usualInterval({ bounds_min: low, bounds_max: high }) {
  return String(Number(niceBelow(Math.max((high[2] - low[2]) / 20, 1e-4)).toPrecision(2)));
}
