// The buttons of the tool in use, over the picture: what Enter, Backspace, Esc and Shift do, for pointers and fingers.

import { html } from "lit-html";
import { $ } from "../dom.js";
import { t } from "../i18n.js";
import { icon, show } from "../view.js";
import { SNAPS } from "./tools.js";

/** @import { Draft } from "./draft.js" */

/** Pixels between the hint and the bar below it. */
const GAP = 8;

export class Bar {
  /** @param {{draft: Draft, leave: () => void, snap: () => string, setSnap: (snap: string) => void}} parts */
  constructor({ draft, leave, snap, setSnap }) {
    this.draft = draft;
    this.leave = leave;
    this.snap = snap;
    this.setSnap = setSnap;
    $("measure-bar").addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      event.stopPropagation();
      leave();
    });
  }

  /**
   * A button that went with its press leaves the keyboard on the picture.
   * @param {() => void} run
   */
  #then(run) {
    run();
    const active = document.activeElement;
    if (active === document.body || (active instanceof HTMLButtonElement && active.disabled)) $("canvas").focus({ preventScroll: true });
  }

  show() {
    const { kind, drawn, moving, editing, canFinish } = this.draft;
    const bar = $("measure-bar");
    bar.hidden = !moving && !editing && (!drawn || kind.max === 0);
    if (bar.hidden) return;
    // Below the hint, which may need two lines.
    bar.style.setProperty("--below", `${$("hint").offsetTop + $("hint").offsetHeight + GAP}px`);
    const snap = this.snap();
    const isOn = snap !== "none";
    const back = () => this.#then(() => this.draft.undoPoint(false));
    const finish = () => this.#then(() => this.draft.finish());
    const snapName = `${t("measureSnap")}: ${t(SNAPS[snap])}`;
    const isDrawing = Boolean(drawn);
    const leaveKey = editing ? "measureEditDone" : "measureLeave";
    show(
      html`<button type="button" class="button icon" data-label="measureSnap" data-key="⇧" aria-label=${snapName} aria-pressed=${isOn} @click=${() => this.setSnap(isOn ? "none" : "vertex")}>${icon("magnet", "measure")}</button>
<button type="button" class="button icon" data-label="measureBack" data-key="⌫" aria-label=${t("measureBack")} ?hidden=${!isDrawing} ?disabled=${!drawn || drawn.points.length === 0} @click=${back}>${icon("undo")}</button>
<button type="button" class="button icon" data-label="measureFinish" data-key="⏎" aria-label=${t("measureFinish")} ?hidden=${!isDrawing || kind.max !== Infinity} ?disabled=${!canFinish} @click=${finish}>${icon("check")}</button>
<button type="button" class="button icon" data-label=${leaveKey} data-key="Esc" aria-label=${t(leaveKey)} @click=${this.leave}>${icon(editing ? "check" : "close")}</button>`,
      bar,
    );
  }
}
