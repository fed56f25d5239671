// Undo and redo of edits (notes and saved views; moves of the camera have a history of their own in flight.js).

const KEPT = 100;

/** @typedef {{undo: () => void, redo: () => void}} Edit */

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
    this.undone = [];
    this.onChange();
  }

  undo() {
    const edit = this.done.pop();
    if (!edit) return false;
    edit.undo();
    this.undone.push(edit);
    this.onChange();
    return true;
  }

  redo() {
    const edit = this.undone.pop();
    if (!edit) return false;
    edit.redo();
    this.done.push(edit);
    this.onChange();
    return true;
  }
}
