// The points of the measurement that is chosen, as handles over the picture: dragged, or taken up by the keyboard.

import { $ } from "../dom.js";
import { t } from "../i18n.js";

/** @import { Scene } from "../scene.js" */
/** @import { Drawn } from "./marks.js" */
/** @typedef {{button: HTMLButtonElement, shape: Drawn, index: number}} PointHandle */

/** CSS pixels that a press may move without being a drag. */
const SLACK = 4;

/**
 * What the person does with marks.
 * @typedef {object} MarkActions
 * @property {(id: string) => void} open a label was pressed
 * @property {(id: string, index: number, x: number, y: number, isFinger: boolean) => void} drag a handle is dragged, to a pixel
 * @property {(id: string, index: number, x: number, y: number, snap: boolean) => void} drop it was let go
 * @property {() => void} cancel it was taken from the person
 * @property {(id: string, index: number) => void} take it was chosen by keyboard
 * @property {() => number[][]} pins boxes of the pins of notes, which labels keep clear of
 */

export class Handles {
  /** @param {MarkActions} on */
  constructor(on) {
    this.on = on;
    /** @type {Scene | null} */
    this.scene = null;
    /** @type {PointHandle[]} */
    this.all = [];
  }

  /**
   * Those of a shape; none where there is none.
   * @param {Drawn | null} shape
   */
  show(shape) {
    const count = shape?.source.dots.length ?? 0;
    while (this.all.length > count) this.all.pop()?.button.remove();
    if (!shape) return;
    for (let index = 0; index < count; index += 1) {
      this.all[index] ??= this.#handle(shape);
      const handle = this.all[index];
      Object.assign(handle, { shape, index });
      handle.button.setAttribute("aria-label", t("measurePoint", { number: index + 1, name: shape.source.name }));
      handle.button.style.setProperty("--mark", shape.source.color);
    }
  }

  /** @param {Drawn} shape */
  #handle(shape) {
    const button = Object.assign(document.createElement("button"), { type: "button", className: "mark-point" });
    const handle = { button, shape, index: 0 };
    const at = (/** @type {PointerEvent} */ event) => /** @type {[number, number]} */ (this.scene?.input.at(event) ?? [0, 0]);
    /** @type {{x: number, y: number, id: string, index: number, moved: boolean} | null} */
    let from = null;
    button.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      button.setPointerCapture(event.pointerId);
      from = { x: event.clientX, y: event.clientY, id: handle.shape.source.id, index: handle.index, moved: false };
      event.stopPropagation();
    });
    button.addEventListener("pointermove", (event) => {
      if (!from) return;
      from.moved ||= Math.hypot(event.clientX - from.x, event.clientY - from.y) > SLACK;
      if (from.moved) this.on.drag(from.id, from.index, ...at(event), event.pointerType === "touch");
    });
    button.addEventListener("pointerup", (event) => {
      const pressed = from;
      from = null;
      if (pressed?.moved) this.on.drop(pressed.id, pressed.index, ...at(event), event.shiftKey);
    });
    button.addEventListener("pointercancel", () => {
      if (from?.moved) this.on.cancel();
      from = null;
    });
    // By keyboard (and a reader's press) the point is taken up, and the crosshair chooses its new place.
    button.addEventListener("click", (event) => event.detail === 0 && this.on.take(handle.shape.source.id, handle.index));
    $("mark-labels").append(button);
    return handle;
  }
}
