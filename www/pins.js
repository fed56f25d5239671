// Notes as numbered pins over the picture. They follow the camera with every frame; a pin behind the surface is faded,
// which is found out for a few pins per frame, so that many notes do not slow the picture down.

import { cameraKey } from "./camera.js";
import { $ } from "./dom.js";
import { t } from "./i18n.js";

/** @import { FrameStats, Note, Viewer } from "./types/page.js" */
/** @import { Session } from "./session.js" */
/** @typedef {{note: Note, depth: number, x: number, y: number, button: HTMLButtonElement, hidden: boolean}} Pin */

const PER_FRAME = 4;
/** Part of its distance that a note may lie behind the surface shown and still be on it. */
const SLACK = 0.004;
/** Half of a pin, CSS pixels: what no label of a measurement may lie under. */
const HALF = 18;

export class Pins {
  /** @param {{viewer: Viewer, session: Session, open: (note: Note) => void}} parts */
  constructor({ viewer, session, open }) {
    this.viewer = viewer;
    this.session = session;
    this.open = open;
    /** @type {Pin[]} */
    this.pins = [];
    this.error = 0; // of the surface on screen, metres
    this.shown = true;
    this.camera = "";
    /** Of which it is not known whether they are hidden. @type {Pin[]} */
    this.unsure = [];
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    this.roving = 0;
    this.abort = new AbortController();
    // One pin is in the tab order, arrows go to the others.
    $("pins").addEventListener(
      "keydown",
      (event) => {
        const by = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
        const at = this.pins.findIndex((p) => p.button === event.target);
        if (!by || at < 0) return;
        event.preventDefault();
        event.stopPropagation();
        this.roving = (at + by + this.pins.length) % this.pins.length;
        this.#order();
        this.pins[this.roving].button.focus();
      },
      { signal: this.abort.signal },
    );
  }

  close() {
    this.abort.abort();
    clearTimeout(this.timer);
    $("pins").replaceChildren();
    this.pins = [];
  }

  /** @param {Note[]} notes */
  set(notes) {
    const had = new Map(this.pins.map((p) => [p.note.id, p]));
    this.pins = notes.map((note, at) => {
      const pin = had.get(note.id) ?? this.#make(note);
      pin.note = note;
      pin.button.textContent = String(at + 1);
      pin.button.dataset.id = note.id;
      pin.button.setAttribute("aria-label", `${t("note")} ${at + 1}: ${note.title || t("noteUnnamed")}`);
      return pin;
    });
    $("pins").replaceChildren(...this.pins.map((p) => p.button));
    this.roving = Math.min(this.roving, Math.max(0, this.pins.length - 1));
    this.#order();
    this.camera = "";
    this.place();
    this.session.wake();
  }

  /** @param {Note} note */
  #make(note) {
    const pin = { note, depth: 0, x: 0, y: 0, button: Object.assign(document.createElement("button"), { className: "pin", type: "button" }), hidden: false };
    pin.button.addEventListener("click", () => this.open(pin.note));
    return pin;
  }

  #order() {
    for (const [at, pin] of this.pins.entries()) pin.button.tabIndex = at === this.roving ? 0 : -1;
  }

  /** @param {boolean} shown */
  show(shown) {
    this.shown = shown;
    $("pins").hidden = !shown;
    this.camera = "";
    this.place();
    this.session.wake(); // The labels of measurements keep clear of pins.
  }

  /** Boxes of the pins in the picture: left, top, right, bottom, CSS pixels from its corner. */
  boxes() {
    if (!this.shown) return [];
    return this.pins.filter((p) => !p.button.hidden).map(({ x, y }) => [x - HALF, y - HALF, x + HALF, y + HALF]);
  }

  /** @param {string | null} id */
  current(id) {
    for (const pin of this.pins) {
      if (pin.note.id === id) pin.button.setAttribute("aria-current", "true");
      else pin.button.removeAttribute("aria-current");
    }
  }

  /**
   * After each frame of the viewer.
   * @param {FrameStats} stats
   */
  frame(stats) {
    this.error = Number.isFinite(stats.worstErrorMetres) ? stats.worstErrorMetres : 0;
    // The surface changes while detail arrives, and with it what hides a pin.
    this.place(`${stats.trianglesDrawn}`);
  }

  place(picture = "") {
    if (!this.shown || this.pins.length === 0 || this.session.closed) return;
    const { width, height } = this.session.canvas;
    const state = `${cameraKey(this.viewer.camera())} ${width} ${height} ${picture}`;
    if (state === this.camera) return;
    this.camera = state;
    const pixels = this.viewer.project(new Float64Array(this.pins.flatMap((p) => p.note.place)));
    for (const [at, pin] of this.pins.entries()) {
      const [x, y, depth] = pixels.subarray(at * 3, at * 3 + 3);
      pin.depth = depth;
      const isOn = Number.isFinite(x) && x > -40 && y > -40 && x < width + 40 && y < height + 40;
      pin.button.hidden = !isOn;
      if (!isOn) continue;
      [pin.x, pin.y] = [x / this.session.ratio, y / this.session.ratio];
      pin.button.style.transform = `translate(${pin.x.toFixed(1)}px, ${pin.y.toFixed(1)}px)`;
    }
    this.unsure = this.pins.filter((p) => !p.button.hidden);
    this.#look();
  }

  #look() {
    clearTimeout(this.timer);
    if (this.session.closed) return;
    for (const pin of this.unsure.splice(0, PER_FRAME)) {
      const slack = 2 * this.error + SLACK * Math.abs(pin.depth);
      const [x, y, z] = pin.note.place;
      pin.hidden = this.viewer.isHidden(x, y, z, slack);
      pin.button.classList.toggle("behind", pin.hidden);
    }
    if (this.unsure.length > 0) this.timer = setTimeout(() => this.#look(), 16);
  }
}
