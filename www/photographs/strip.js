// The strip of photographs below the picture, and above it the bar of the one that is shown.

import { html, nothing } from "lit-html";
import { bytes } from "../format.js";
import { t } from "../i18n.js";
import { icon, iconButton, show } from "../view.js";

/** @import { Photograph } from "./pose.js" */

/**
 * @typedef {object} StripActions
 * @property {(photo: Photograph) => void} open
 * @property {(photo: Photograph | null) => void} point at a photograph, or none
 * @property {() => void} close the one that is shown
 * @property {(isWhole: boolean) => void} load its picture, with all its pixels or those of the preview
 * @property {(share: number) => void} blend
 * @property {(path: string) => string} address of a file of the report
 */

/**
 * @typedef {object} Shown
 * @property {Photograph} photo
 * @property {number} share of the photograph over the model, 0 to 1
 * @property {"none" | "loading" | "failed" | "preview" | "whole"} state of its picture
 */

/** Bytes of a photograph that is small enough for the strip. */
const SMALL = 200_000;

export class Strip {
  #element = Object.assign(document.createElement("section"), { className: "photo-strip", id: "photo-strip" });
  #roving = 0;
  #shown = /** @type {Shown | null} */ (null);

  /**
   * @param {Photograph[]} photographs
   * @param {string} credit
   * @param {StripActions} on
   */
  constructor(photographs, credit, on) {
    this.photographs = photographs;
    this.credit = credit;
    this.on = on;
    this.#element.addEventListener("keydown", (event) => this.#key(event));
  }

  /** @param {Element} before */
  attach(before) {
    before.before(this.#element);
  }

  remove() {
    this.#element.remove();
  }

  /**
   * How much of the lower part of a picture it covers, CSS pixels.
   * @param {HTMLElement} picture
   */
  covers(picture) {
    const { bottom, height } = picture.getBoundingClientRect();
    const box = this.#element.getBoundingClientRect();
    return box.height > 0 ? Math.max(0, Math.min(height / 2, bottom - box.top)) : 0;
  }

  /**
   * @param {boolean} isOn
   * @param {Shown | null} shown
   */
  show(isOn, shown) {
    const { activeElement } = document;
    const hadFocus = this.#element.contains(activeElement);
    const isOther = shown?.photo !== this.#shown?.photo;
    this.#shown = shown;
    this.#element.hidden = !isOn;
    this.#element.ariaLabel = t("photographs");
    if (shown) this.#roving = this.photographs.indexOf(shown.photo);
    show(
      isOn ? html`${shown ? this.#bar(shown) : nothing}<ol class="thumbs">${this.photographs.map((photo, at) => this.#thumb(photo, at))}</ol>` : nothing,
      this.#element,
    );
    if (!isOn) return;
    const current = this.#buttons[this.#roving];
    if (shown && isOther) current?.scrollIntoView({ block: "nearest", inline: "center" });
    // A button that had the focus is gone, or cannot be pressed any more. On a phone the bar takes the place of the pictures.
    const isLost = hadFocus && (!document.contains(activeElement) || /** @type {HTMLButtonElement} */ (activeElement).disabled);
    const close = /** @type {HTMLButtonElement | null} */ (this.#element.querySelector(".photo-bar > [data-label=close]"));
    if (isLost) (current?.offsetParent ? current : close)?.focus();
  }

  get #buttons() {
    return /** @type {HTMLButtonElement[]} */ ([...this.#element.querySelectorAll(".thumbs button")]);
  }

  /**
   * @param {Photograph} photo
   * @param {number} at
   */
  #thumb(photo, at) {
    // A photograph without smaller copies may have many megabytes.
    const path = photo.thumbnail ?? (photo.bytes <= SMALL ? photo.path : null);
    const picture = path ? html`<img src=${this.on.address(path)} alt="" loading="lazy" decoding="async">` : icon("camera");
    const isCurrent = photo === this.#shown?.photo ? "true" : nothing;
    const point = (/** @type {Photograph | null} */ which) => () => this.on.point(which);
    return html`<li><button type="button" aria-label=${photo.name} title=${photo.name} aria-current=${isCurrent} tabindex=${at === this.#roving ? 0 : -1} @click=${() => this.on.open(photo)} @pointerenter=${point(photo)} @pointerleave=${point(null)} @focus=${point(photo)} @blur=${point(null)}>${picture}</button></li>`;
  }

  /** @param {Shown} shown */
  #bar({ photo, share, state }) {
    const at = this.photographs.indexOf(photo);
    const step = (/** @type {number} */ by) => () => this.on.open(this.photographs[at + by]);
    const isLast = at === this.photographs.length - 1;
    const previous = iconButton("previous", { key: "photographPrevious", disabled: at === 0, click: step(-1) });
    const next = iconButton("next", { key: "photographNext", disabled: isLast, click: step(1) });
    const close = iconButton("close", { key: "close", click: () => this.on.close() });
    const slide = (/** @type {Event} */ event) => this.on.blend(Number(/** @type {HTMLInputElement} */ (event.target).value) / 100);
    const blend = html`<label class="photo-blend"><span>${t("photographBlend")}</span><input type="range" min="0" max="100" step="1" .value=${String(Math.round(share * 100))} ?disabled=${state === "loading" || state === "failed"} @input=${slide}></label>`;
    const size = bytes(photo.bytes);
    const whole = html`<button type="button" class="button outlined" @click=${() => this.on.load(true)}>${t("photographWhole", { size })}</button>`;
    const file = html`<a class="button icon" data-label="photographFile" aria-label=${t("photographFile")} href=${photo.path ? this.on.address(photo.path) : nothing} target="_blank" rel="noopener">${icon("external")}</a>`;
    const words = { none: "photographNone", loading: "photographLoading", failed: "photographBroken", preview: "photographHelp", whole: "photographHelp" }[
      state
    ];
    const again = html`<button type="button" class="button outlined" @click=${() => this.on.load(false)}>${t("tryAgain")}</button>`;
    const hasMore = state === "preview" && photo.preview;
    return html`<div class="photo-bar" data-state=${state}>${previous}<div class="photo-name"><strong dir="auto">${photo.name}</strong><span class="quiet" dir="auto">${this.credit}</span></div>${next}${photo.path ? blend : nothing}${hasMore ? whole : nothing}${state === "failed" ? again : nothing}${photo.path ? file : nothing}${close}<p class="quiet" role="status">${t(words)}</p></div>`;
  }

  /**
   * One thumbnail is in the tab order, arrows go to the others.
   * @param {KeyboardEvent} event
   */
  #key(event) {
    const buttons = this.#buttons;
    const at = buttons.indexOf(/** @type {HTMLButtonElement} */ (event.target));
    const way = document.documentElement.dir === "rtl" ? -1 : 1;
    const to = { ArrowRight: at + way, ArrowLeft: at - way, Home: 0, End: buttons.length - 1 }[event.key];
    if (at < 0 || to === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    const chosen = buttons[Math.max(0, Math.min(buttons.length - 1, to))];
    buttons[at].tabIndex = -1;
    this.#roving = buttons.indexOf(chosen);
    chosen.tabIndex = 0;
    chosen.focus();
  }
}
