// The note that is open: a card over the picture, and the steps from one note to the next.

import { $ } from "./dom.js";
import { count } from "./format.js";
import { t } from "./i18n.js";

/** @import { Note } from "./types/page.js" */
/** @import { Ids } from "./types/ids.js" */

export class Tour {
  /** @param {{signal: AbortSignal, notes: () => Note[], go: (note: Note) => void, onClose: () => void, edit: (note: Note) => void, share: (note: Note) => void}} on */
  constructor(on) {
    this.on = on;
    /** @type {Note | null} */
    this.note = null;
    /** Where the keyboard was before the card. @type {Element | null} */
    this.returnTo = null;
    const { signal } = on;
    const click = (/** @type {keyof Ids} */ id, /** @type {() => void} */ run) => $(id).addEventListener("click", run, { signal });
    click("note-close", () => this.close());
    click("note-previous", () => this.step(-1));
    click("note-next", () => this.step(1));
    click("note-edit", () => this.note && on.edit(this.note));
    click("note-share", () => this.note && on.share(this.note));
    $("note-card").addEventListener(
      "keydown",
      (event) => {
        if (event.key !== "Escape") return;
        event.stopPropagation();
        this.close();
      },
      { signal },
    );
  }

  /**
   * Show a note's card; `focus` puts the keyboard on its title.
   * @param {Note} note
   * @param {{focus?: boolean}} how
   */
  show(note, { focus = false } = {}) {
    const notes = this.on.notes();
    const at = notes.findIndex((n) => n.id === note.id);
    if (at < 0) return this.close();
    if (!this.note) this.returnTo = document.activeElement;
    this.note = notes[at];
    $("note-number").textContent = String(at + 1);
    $("note-title").textContent = note.title || t("noteUnnamed");
    $("note-text").textContent = note.text;
    $("note-text").hidden = !note.text;
    $("note-link").hidden = !note.link;
    if (note.link) {
      $("note-link").href = note.link;
      $("note-link").textContent = `${t("noteFollow")} (${new URL(note.link).hostname})`;
    }
    $("note-count").textContent = t("tourCount", { number: count(at + 1), count: count(notes.length) });
    $("note-previous").disabled = at === 0;
    $("note-next").disabled = at === notes.length - 1;
    $("note-card").hidden = false;
    if (focus) $("note-title").focus();
    return undefined;
  }

  /** @param {number} by */
  step(by) {
    const notes = this.on.notes();
    const at = notes.findIndex((n) => n.id === this.note?.id);
    const next = notes[at + by];
    if (!next) return;
    const from = document.activeElement;
    this.on.go(next);
    // The button that was pressed may be at its end now.
    if (from instanceof HTMLButtonElement && from.disabled) $(by > 0 ? "note-previous" : "note-next").focus();
  }

  close() {
    if (!this.note) return;
    this.note = null;
    const had = $("note-card").contains(document.activeElement);
    $("note-card").hidden = true;
    if (had) (this.returnTo instanceof HTMLElement && this.returnTo.isConnected ? this.returnTo : $("canvas")).focus();
    this.on.onClose();
  }
}
