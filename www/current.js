// What is open: the one place that the parts of the page ask. A pack comes first, then what it holds and what the person keeps for it, then the picture.

/** @import { Holes } from "./holes.js" */
/** @import { Model } from "./model.js" */
/** @import { Notes } from "./notes.js" */
/** @import { Photographs } from "./photographs/photographs.js" */
/** @import { Saved } from "./saved.js" */
/** @import { Scene } from "./scene.js" */
/** @import { PackSource } from "./types/page.js" */

export class Current {
  /** @param {PackSource | null} pack */
  constructor(pack) {
    /** @type {PackSource | null} */
    this.pack = pack;
    /** @type {Model | null} */
    this.model = null;
    /** @type {Saved | null} */
    this.saved = null;
    /** @type {Notes | null} */
    this.notes = null;
    /** Where a list of them was given. @type {Holes | null} */
    this.holes = null;
    /** Where a colour report was named. @type {Photographs | null} */
    this.photographs = null;
    /** @type {Scene | null} */
    this.scene = null;
  }

  /** Whether there is a picture that can be moved. */
  get isOpen() {
    return this.scene?.isOpen ?? false;
  }

  /** Something of it that must be there: an error where nothing is open. */
  get opened() {
    const { model, notes, scene } = this;
    if (!model || !notes || !scene) throw new Error("the model is not open");
    return { model, notes, scene };
  }
}
