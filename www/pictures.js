// The dialog of pictures and drawings (screenshot.js): its code comes when it is first opened, so that the first picture of the model costs less.

import { notice } from "./chrome.js";
import { t } from "./i18n.js";

export class Pictures {
  #dialog = null;
  #page;

  /** @param {() => object} page what PictureDialog is given */
  constructor(page) {
    this.#page = page;
  }

  async open() {
    try {
      const { PictureDialog } = await import("./screenshot.js");
      this.#dialog ??= new PictureDialog(this.#page);
      this.#dialog.open();
    } catch (error) {
      notice(t("pictureFailed", { why: error.message }));
    }
  }
}
