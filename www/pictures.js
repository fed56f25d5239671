// The dialog of pictures and drawings (screenshot.js): its code comes when it is first opened, so that the first picture of the model costs less.

import { notice } from "./chrome.js";
import { t } from "./i18n.js";

/** @import { Pictured, PictureDialog } from "./screenshot.js" */

export class Pictures {
  /** @type {PictureDialog | null} */
  #dialog = null;
  #source;

  /** @param {() => Pictured} source what PictureDialog is given */
  constructor(source) {
    this.#source = source;
  }

  async open() {
    try {
      const { PictureDialog } = await import("./screenshot.js");
      this.#dialog ??= new PictureDialog(this.#source);
      this.#dialog.open();
    } catch (error) {
      notice(t("pictureFailed", { why: error.message }));
    }
  }
}
