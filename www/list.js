// An ordered list that can be edited: each row goes somewhere when pressed, and opens to be renamed, moved or deleted.

import { html, nothing } from "lit-html";
import { t } from "./i18n.js";
import { forget, iconButton, keepingFocus, show } from "./view.js";

/**
 * What the rows of a list do.
 * @template T
 * @typedef {object} RowActions
 * @property {(item: T) => string} name
 * @property {(item: T) => void} go
 * @property {((item: T, name: string) => void) | null} rename
 * @property {((item: T) => void) | null} edit
 * @property {(item: T, by: number) => void} move
 * @property {(item: T) => void} remove
 */

/** @template {{id: string}} T */
export class EditList {
  /**
   * @param {HTMLElement} element
   * @param {RowActions<T>} on
   */
  constructor(element, on) {
    this.element = element;
    this.on = on;
    /** @type {T[]} */
    this.items = [];
    /** Id of the row that is open for editing. @type {string | null} */
    this.open = null;
    /** Id of the row that is shown. @type {string | null} */
    this.current = null;
    this.language = "";
  }

  /** @param {T[]} items */
  show(items) {
    this.items = items;
    const { lang } = document.documentElement;
    const rows = () => this.items.map((item, at) => this.#row(item, at));
    keepingFocus(this.element, () => {
      if (this.language !== lang) forget(this.element);
      this.language = lang;
      show(rows(), this.element);
    });
  }

  /**
   * Open a row and focus its name.
   * @param {string} id
   */
  edit(id) {
    this.#toggle(id);
    const name = /** @type {HTMLInputElement | null} */ (this.#find(id, "input"));
    name?.focus();
    name?.select();
  }

  /** @param {string | null} id */
  #toggle(id) {
    this.open = id;
    this.show(this.items);
  }

  /**
   * @param {string} id
   * @param {string} selector
   * @returns {HTMLElement | null}
   */
  #find(id, selector) {
    return this.element.querySelector(`[data-id="${CSS.escape(id)}"] ${selector}`);
  }

  /**
   * @param {T} item
   * @param {number} at
   */
  #row(item, at) {
    const about = this.on.name(item);
    const isOpen = this.open === item.id;
    const more = iconButton("edit", { key: "edit", about, act: "more", expanded: isOpen, click: () => this.#toggle(isOpen ? null : item.id) });
    const isCurrent = item.id === this.current ? "true" : nothing;
    return html`<li data-id=${item.id}><div class="row"><button type="button" class="go" data-act="go" aria-current=${isCurrent} @click=${() => this.on.go(item)}><span class="pin-number">${at + 1}</span><span class="name" dir="auto">${about}</span></button>${more}</div>${isOpen ? this.#strip(item, at, about) : nothing}</li>`;
  }

  /**
   * @param {T} item
   * @param {number} at
   * @param {string} about
   */
  #strip(item, at, about) {
    const { rename, edit, move, remove } = this.on;
    const up = iconButton("up", { key: "moveUp", about, act: "up", disabled: at === 0, click: () => move(item, -1) });
    const down = iconButton("down", { key: "moveDown", about, act: "down", disabled: at === this.items.length - 1, click: () => move(item, 1) });
    const away = iconButton("delete", { key: "delete", about, act: "delete", click: () => remove(item) });
    const editor = html`<button type="button" class="button outlined" data-act="edit" @click=${() => edit?.(item)}>${t("noteEdit")}</button>`;
    return html`<div class="strip">${rename ? this.#name(item, about, rename) : nothing}${edit ? editor : nothing}${up}${down}${away}</div>`;
  }

  /**
   * @param {T} item
   * @param {string} name
   * @param {(item: T, name: string) => void} rename
   */
  #name(item, name, rename) {
    const take = (/** @type {Event} */ { target }) => {
      const given = /** @type {HTMLInputElement} */ (target).value.trim();
      // A field that is removed while it has the focus can fire another change event.
      if (this.open === item.id && given && given !== name) rename(item, given);
    };
    const key = (/** @type {KeyboardEvent} */ event) => {
      if (event.key !== "Enter" && event.key !== "Escape") return;
      event.preventDefault();
      if (event.key === "Enter") take(event);
      this.#toggle(null);
      this.#find(item.id, ".go")?.focus();
    };
    return html`<input data-act="name" maxlength="200" dir="auto" autocomplete="off" aria-label=${t("name")} .value=${name} @change=${take} @keydown=${key}>`;
  }
}

/**
 * A list with one thing moved by some places.
 * @template T
 * @param {T[]} list
 * @param {T} item
 * @param {number} by
 */
export function moved(list, item, by) {
  const at = list.indexOf(item);
  const to = Math.max(0, Math.min(list.length - 1, at + by));
  const rest = list.filter((other) => other !== item);
  rest.splice(to, 0, item);
  return rest;
}
