// The common parts of the templates of panels and lists. Texts are only ever put in as text: lit-html makes text nodes of them.

import { html, nothing, render } from "lit-html";
import { t } from "./i18n.js";

/** @import { TemplateResult } from "lit-html" */

/** Pictures that point the other way where text runs from right to left. */
const MIRRORED = ["undo", "redo"];

/**
 * A picture of the page's sheet, or of the one of the measuring tools.
 * @param {string} name
 * @param {"sprite" | "measure"} sheet
 */
export const icon = (name, sheet = "sprite") =>
  html`<svg class=${MIRRORED.includes(name) ? "icon mirror" : "icon"} aria-hidden="true"><use href="icons/${sheet}.svg#${name}"></use></svg>`;

/**
 * A button that is a picture.
 * @param {string} name of the picture
 * @param {object} button
 * @param {string} button.key its string: its tooltip, and its name for screen readers
 * @param {() => void} button.click
 * @param {string} [button.about] what it is about, for screen readers
 * @param {string} [button.act] which of a row's buttons it is
 * @param {"sprite" | "measure"} [button.sheet]
 * @param {boolean} [button.disabled]
 * @param {boolean} [button.expanded] it has opened something
 */
export function iconButton(name, { key, click, about = "", act, sheet, disabled = false, expanded }) {
  const label = about ? `${t(key)}: ${about}` : t(key);
  return html`<button type="button" class="button icon" data-label=${key} aria-label=${label} data-act=${act ?? nothing} aria-expanded=${expanded ?? nothing} ?disabled=${disabled} @click=${click}>${icon(name, sheet)}</button>`;
}

/**
 * Rows of names and values, in a `dl`.
 * @param {Iterable<string[]>} rows
 */
export const rowsOf = (rows) => [...rows].map(([name, value]) => html`<div><dt>${name}</dt><dd>${value}</dd></div>`);

/**
 * Render into an element of index.html, in place of what stood there.
 * @param {unknown} content
 * @param {HTMLElement} element
 */
export function show(content, element) {
  if (!("_$litPart$" in element)) element.replaceChildren();
  render(content, element);
}

/**
 * Render anew from nothing: in another language even what reads the same must lose what i18n.js wrote over it.
 * @param {HTMLElement} element
 */
export function forget(element) {
  if ("_$litPart$" in element) render(nothing, element);
}

/**
 * Change rows and keep the keyboard in the one where it was: on the same button, or on another one of its row where that went or cannot be pressed any more.
 * Rows have `data-id`, what can be focused in them `data-act`.
 * @param {HTMLElement} root
 * @param {() => void} draw
 */
export function keepingFocus(root, draw) {
  const active = /** @type {HTMLElement & {disabled?: boolean} | null} */ (root.contains(document.activeElement) ? document.activeElement : null);
  const row = /** @type {HTMLElement | null | undefined} */ (active?.closest("[data-id]"));
  const { id } = row?.dataset ?? {};
  const act = active?.dataset.act;
  draw();
  const isThere = document.activeElement === active && row?.dataset.id === id && !active?.disabled;
  if (!active || id === undefined || isThere) return;
  const rows = `[data-id="${CSS.escape(id)}"]`;
  const again = root.querySelector(`${rows} [data-act="${act}"]:not(:disabled)`) ?? root.querySelector(`${rows} button`) ?? root.querySelector("button");
  /** @type {HTMLElement | null} */ (again)?.focus();
}
