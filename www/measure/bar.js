// The buttons of the tool in use, over the picture: what Enter, Backspace, Esc and Shift do, for pointers and fingers.

import { t } from "../i18n.js";
import { iconButton } from "./dom.js";
import { SNAPS } from "./tools.js";

const $ = (id) => document.getElementById(id);

export class Bar {
  /** @param {import("./measure.js").Measure} measure */
  constructor(measure) {
    this.measure = measure;
    const { page } = measure;
    const button = (options) => iconButton({ sheet: "sprite", ...options });
    this.leave = button({ name: "close", key: "measureLeave", onclick: () => page.tool("orbit") });
    this.snap = button({
      name: "magnet",
      sheet: "measure",
      key: "measureSnap",
      "aria-pressed": "false",
      onclick: () => measure.setSnap(measure.snap === "none" ? "vertex" : "none"),
    });
    this.back = button({ name: "undo", key: "measureBack", onclick: () => this.#then(() => measure.undoPoint(false)) });
    this.finish = button({ name: "check", key: "measureFinish", onclick: () => this.#then(() => measure.finish()) });
    for (const [element, key] of [
      [this.leave, "Esc"],
      [this.snap, "⇧"],
      [this.back, "⌫"],
      [this.finish, "⏎"],
    ])
      element.dataset.key = key;
    $("measure-bar").replaceChildren(this.snap, this.back, this.finish, this.leave);
    $("measure-bar").addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      event.stopPropagation();
      page.tool("orbit");
    });
  }

  /** A button that went with its press leaves the keyboard on the picture. */
  #then(run) {
    run();
    if (document.activeElement?.disabled || document.activeElement === document.body) $("canvas").focus({ preventScroll: true });
  }

  show() {
    const { draft, moving, kind, snap } = this.measure;
    const isOn = Boolean(moving) || (Boolean(draft) && kind.most > 0);
    $("measure-bar").hidden = !isOn;
    if (!isOn) return;
    // Below the hint, which may need two lines.
    $("measure-bar").style.setProperty("--below", `${$("hint").offsetTop + $("hint").offsetHeight + 8}px`);
    this.snap.setAttribute("aria-pressed", String(snap !== "none"));
    this.snap.setAttribute("aria-label", `${t("measureSnap")}: ${t(SNAPS[snap])}`);
    this.back.disabled = !draft || draft.points.length === 0;
    this.finish.disabled = !this.measure.canFinish;
    this.finish.hidden = kind.most !== Infinity;
  }

  hide() {
    $("measure-bar").hidden = true;
  }
}
