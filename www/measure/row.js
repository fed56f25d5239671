// A measurement in the table of the Measurements tab: a row with its value, and below it, when it is open, everything about it.

import { html, nothing } from "lit-html";
import { length, bytes as sizeOf } from "../format.js";
import { t } from "../i18n.js";
import { sentence } from "../messages.js";
import { icon, iconButton, rowsOf } from "../view.js";
import { COLOR } from "./items.js";
import "./paper-form.js";
import "./plot.js";
import { kindName } from "./tools.js";
import { readingName, text } from "./values.js";

/** @import { MeasureItem } from "../types/page.js" */
/** @import { PanelParts } from "./panel.js" */
/** @import { Task } from "./task.js" */

/** Where an uncertainty comes from. @type {Record<string, string>} */
const PARTS = { lattice: "partLattice", level: "partLevel", capture: "partCapture", pointing: "partPointing" };
/** Why there is no value. @type {Record<string, string>} */
const STATES = { missed: "stateMissed", failed: "stateFailed", refused: "stateRefused" };

/** @param {Event} event */
const textOf = ({ target }) => /** @type {HTMLInputElement | HTMLTextAreaElement} */ (target).value;

/**
 * A button with a text.
 * @param {string} label
 * @param {string} act
 * @param {() => void} click
 */
const button = (label, act, click) => html`<button type="button" class="button outlined" data-act=${act} @click=${click}>${label}</button>`;

/** @param {unknown} buttons */
const actions = (buttons) => html`<p class="actions">${buttons}</p>`;

export class Rows {
  #parts;

  /** @param {PanelParts} parts */
  constructor(parts) {
    this.#parts = parts;
    /** Citations, by id. @type {Map<string, {words: string, address: string | null}>} */
    this.sentences = new Map();
  }

  /**
   * @param {MeasureItem} item
   * @param {number} at
   */
  row(item, at) {
    const { items, choose } = this.#parts;
    const isOpen = items.chosen === item.id;
    const key = (/** @type {KeyboardEvent} */ event) => {
      const by = event.altKey ? { ArrowUp: -1, ArrowDown: 1 }[event.key] : undefined;
      if (by) items.move(item, by);
      else if (event.key === "Delete") items.remove(item);
      else return;
      event.preventDefault();
    };
    // Rows wrap where a value is wide, which takes the roles of a table away: they are stated.
    // The colour may come from a file that somebody sent: nothing but a colour gets into the style.
    const color = CSS.supports("color", item.color) ? item.color : COLOR;
    const name = html`<span class="swatch" aria-hidden="true" .style=${`--mark: ${color}`}></span><span class="name" dir="auto">${item.name}</span>${item.hidden ? icon("hide") : nothing}`;
    return html`<tr role="row" data-id=${item.id} class=${isOpen ? "open" : ""}><th scope="row" role="rowheader"><button type="button" class="go" data-act="go" aria-expanded=${isOpen} @click=${() => choose(item.id)} @keydown=${key}>${name}</button></th><td role="cell">${this.#value(item)}</td></tr>${isOpen ? html`<tr role="row" class="detail" data-id=${item.id}><td role="cell" colspan="2">${this.#detail(item, at)}</td></tr>` : nothing}`;
  }

  /** The value: a press explains it, the text can be selected. @param {MeasureItem} item */
  #value(item) {
    const { items, choose, lines } = this.#parts;
    const { task } = item;
    const state = STATES[task.state];
    if (state) return html`<span class="quiet">${t(state)}</span>`;
    const press = () => {
      if (getSelection()?.isCollapsed && items.chosen !== item.id) choose(item.id);
    };
    return html`<div class=${task.isFinal ? "value" : "value dashed"} @click=${press}>${lines(item).map((line) => html`<span dir="auto">${line}</span>`)}${task.state === "measuring" ? progress(task) : nothing}</div>`;
  }

  /**
   * @param {MeasureItem} item
   * @param {number} at
   */
  #detail(item, at) {
    const { runner, settings, files, bounds, pointed } = this.#parts;
    const { task, foreign } = item;
    const { unit } = settings();
    const cited = this.sentences.get(item.id);
    const mark = (/** @type {CustomEvent<number[] | null>} */ { detail }) => pointed(item, detail);
    return html`<div class="explain">
${foreign ? html`<p class="warn">${t("measureForeign", { title: foreign.title, identity: foreign.identity.slice(0, 12) })}</p>` : nothing}
${task.refusal ? html`<p class="error">${task.refusal()}</p>` : nothing}
${task.state === "missed" ? html`<p class="error">${t("measureMissed")}</p>` : nothing}
${task.state === "missed" || task.state === "failed" ? button(t("tryAgain"), "again", () => runner.again(item)) : nothing}
${task.answer ? html`<kilwa-plot .spacing=${bounds.median_edge} .unit=${unit} .item=${item} @point=${mark}></kilwa-plot><kilwa-paper .files=${files} .item=${item}></kilwa-paper>` : nothing}
${task.readings.length > 0 ? [html`<p class="quiet">${kindName(task.kind)}</p><dl class="facts">${task.readings.map((r) => fact(readingName(r.name), text(r, unit)))}</dl>`, parts(task)] : nothing}
${this.#moving(item)}
${this.#words(item)}
${cited ? html`<p class="cited" dir="auto">${cited.words}</p>` : nothing}
${cited?.address ? html`<p class="cited-address"><a href=${cited.address} dir="ltr">${cited.address}</a></p>` : nothing}
${this.#drawings(item)}
${this.#strip(item, at)}
</div>`;
  }

  /** Its points can be moved while this is pressed, and only then: a drag beside a point turns the model. @param {MeasureItem} item */
  #moving({ id, hidden, name, task }) {
    const { draft } = this.#parts;
    if (hidden || task.points.length === 0) return nothing;
    const isMoving = draft.editing === id;
    return actions(
      html`<button type="button" class="button outlined" data-act="move" aria-pressed=${isMoving} aria-label="${t("measureEdit")}: ${name}" @click=${() => draft.edit(isMoving ? null : id)}>${icon("move", "measure")}<span>${t("measureEdit")}</span></button>`,
    );
  }

  /** What a measurement becomes beside its value. @param {MeasureItem} item */
  #drawings(item) {
    const { sharing } = this.#parts;
    const { task } = item;
    const map = () => actions(button(t("measureMap"), "map", () => sharing.map(item)));
    const colours = () => actions(button(t("deviationShow"), "colours", () => sharing.colour(item)));
    return [task.fitted && task.kind.plane && task.isFinal ? map() : nothing, task.tool === "deviation" && task.isFinal ? colours() : nothing];
  }

  /**
   * @param {MeasureItem} item
   * @param {number} at
   */
  #strip(item, at) {
    const { items, sharing } = this.#parts;
    const { id, hidden, name: about, task } = item;
    const own = (/** @type {string} */ act, /** @type {string} */ key, /** @type {() => void} */ click, disabled = false) =>
      iconButton(act, { key, click, about, act, disabled, sheet: "measure" });
    const page = (/** @type {string} */ name, /** @type {string} */ key, /** @type {() => void} */ click, { act = name, disabled = false } = {}) =>
      iconButton(name, { key, click, about, act, disabled });
    const recolor = (/** @type {Event} */ event) => items.update("editColor", id, { color: textOf(event) });
    const hide = page(
      hidden ? "show" : "hide",
      hidden ? "measureShow" : "measureHide",
      () => items.update(hidden ? "editShow" : "editHide", id, { hidden: !hidden }),
      { act: "hide" },
    );
    return html`<div class="strip">
${own("look", "measureLook", () => sharing.look(item))}
${own("copy", "measureCopy", () => sharing.copyValues(item), !task.isFinal)}
${own("cite", "measureCite", () => sharing.cite(item), !task.isFinal)}
<input type="color" data-act="color" aria-label="${t("measureColor")}: ${about}" .value=${item.color} @change=${recolor}>
${hide}
${page("up", "moveUp", () => items.move(item, -1), { disabled: at === 0 })}
${page("down", "moveDown", () => items.move(item, 1), { disabled: at === items.all.length - 1 })}
${page("delete", "delete", () => items.remove(item))}
</div>`;
  }

  /** Its name, and a note. @param {MeasureItem} item */
  #words({ id, name, note }) {
    const { items } = this.#parts;
    const rename = (/** @type {Event} */ event) => {
      const given = textOf(event).trim();
      if (given && given !== name) items.update("editRename", id, { name: given });
    };
    const leave = (/** @type {KeyboardEvent} */ event) => {
      if (event.key === "Enter") /** @type {HTMLElement} */ (event.target).blur();
    };
    // The note is kept with every letter, so that a reload loses nothing; one edit to undo when the field is left.
    return html`<div class="editor"><label><span>${t("name")}</span><input maxlength="200" dir="auto" autocomplete="off" data-act="name" .value=${name} @change=${rename} @keydown=${leave}></label><label><span>${t("note")}</span><textarea rows="2" maxlength="20000" dir="auto" data-act="note" .value=${note} @input=${(/** @type {Event} */ event) => items.type(id, textOf(event))} @change=${() => items.typed()}></textarea></label></div>`;
  }
}

/** @param {Task} task */
function progress({ progress: part, waiting }) {
  const title = waiting ? t("offline", { seconds: Math.ceil(waiting) }) : "";
  return html`<progress max="1" value=${part ?? nothing} title=${title} aria-label=${t("refiningNoValue")}></progress>`;
}

/**
 * @param {string} name
 * @param {string} value
 */
const fact = (name, value) => html`<div><dt>${name}</dt><dd dir="ltr">${value}</dd></div>`;

/** What an uncertainty is made of, and what was read for the value. @param {Task} task */
function parts({ uncertainty, parts: more, read, remarks }) {
  const value = (/** @type {number | string | null | undefined} */ v) =>
    v === null || v === undefined ? t("unknownCapture") : v === 0 ? "0" : typeof v === "number" ? length(v) : v;
  const names = /** @type {const} */ (["lattice", "level", "pointing", "capture"]);
  const own = uncertainty ? names.map((name) => /** @type {const} */ ([name, name === "pointing" ? (uncertainty[name] ?? 0) : uncertainty[name]])) : [];
  const rows = [
    ...own.map(([name, v]) => html`<div><dt>${t(PARTS[name])}</dt><dd dir=${v === null ? "auto" : "ltr"}>${value(v)}</dd></div>`),
    ...rowsOf(more.filter((p) => !(p.what in PARTS)).map((p) => [p.what, value(p.value)])),
    ...rowsOf(read ? [[t("measureRead"), t("measureReadOf", { bytes: sizeOf(read.bytes), all: sizeOf(read.of_bytes) })]] : []),
  ];
  if (rows.length === 0) return nothing;
  return html`<h3>${t("measureUncertainty")}</h3><dl class="facts">${rows}</dl>${remarks.map((remark) => html`<p class="quiet" dir="auto">${sentence(remark)}</p>`)}`;
}
