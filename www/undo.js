// Undo and redo of edits (notes and saved views; moves of the camera have a history of their own in flight.js).

const KEPT = 100;

export class Undo {
  /** @param {() => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
    this.done = [];
    this.undone = [];
  }

  /** Do something that can be taken back. @param {{undo: () => void, redo: () => void}} edit */
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
