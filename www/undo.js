// Undo and redo of edits: of notes, of saved views and of measurements, each list by itself. Each edit has a name, so that a button and a message say
// what is taken back. (Moves of the camera have a history of their own in flight.js.)

import { t } from "./i18n.js";

const KEPT = 100;

/** The list that an edit changes. @typedef {"notes" | "views" | "measurements"} Scope */
/**
 * @typedef {object} Edit
 * @property {Scope} scope
 * @property {string} name key of the message that names it
 * @property {() => void} undo
 * @property {() => void} redo
 */

/**
 * What a button that takes back an edit, or does it again, is called.
 * @param {"undo" | "redo"} way
 * @param {Edit | null} edit
 */
export const stepName = (way, edit) => (edit ? t(way === "undo" ? "undoNamed" : "redoNamed", { what: t(edit.name) }) : t(way));

export class Undo {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
    /** @type {Edit[]} */
    this.done = [];
    /** @type {Edit[]} */
    this.undone = [];
  }

  /** Another pack: what was done to the last one cannot be taken back. */
  clear() {
    this.done = [];
    this.undone = [];
    this.onChange();
  }

  /** Do something that can be taken back. @param {Edit} edit */
  do(edit) {
    edit.redo();
    this.done.push(edit);
    if (this.done.length > KEPT) this.done.shift();
    // The lists do not depend on each other: what was taken back of another one can still be done again.
    this.undone = this.undone.filter(({ scope }) => scope !== edit.scope);
    this.onChange();
  }

  /**
   * What `undo` would take back, and `redo` do again; null where there is nothing.
   * @param {Scope | null} scope only edits of this list
   */
  next(scope = null) {
    const last = (/** @type {Edit[]} */ edits) => edits.findLast((edit) => !scope || edit.scope === scope) ?? null;
    return { undo: last(this.done), redo: last(this.undone) };
  }

  /**
   * Take back the newest edit; returns it, or null where there is none.
   * @param {Scope | null} scope only an edit of this list
   */
  undo(scope = null) {
    const { undo: edit } = this.next(scope);
    if (!edit) return null;
    edit.undo();
    this.done = this.done.filter((other) => other !== edit);
    this.undone.push(edit);
    this.onChange();
    return edit;
  }

  /**
   * Do the edit again that was taken back last; returns it, or null where there is none.
   * @param {Scope | null} scope only an edit of this list
   */
  redo(scope = null) {
    const { redo: edit } = this.next(scope);
    if (!edit) return null;
    edit.redo();
    this.undone = this.undone.filter((other) => other !== edit);
    this.done.push(edit);
    this.onChange();
    return edit;
  }
}
