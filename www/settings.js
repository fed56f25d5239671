// How much memory and detail the model may take, and its projection: the sliders of the Display tab. What the address asks for counts first.

import { $, input } from "./dom.js";
import * as format from "./format.js";
import { t } from "./i18n.js";
import { isSmall } from "./screen-size.js";

/** @import { Scene } from "./scene.js" */

/** What the sliders choose among: megabytes on the graphics card, and pixels of error. */
const MEMORY = [64, 128, 256, 512, 1024, 2048];
const DETAIL = [0.5, 1, 2, 4, 8];
/** Gigabytes of a device that is treated as a small one. */
const SMALL = 4;

export class Settings {
  /**
   * @param {URLSearchParams} parameters
   * @param {() => Scene | null} scene
   */
  constructor(parameters, scene) {
    const { deviceMemory = 8 } = /** @type {{deviceMemory?: number}} */ (navigator);
    const hasLittle = isSmall() || deviceMemory <= SMALL;
    const asked = (/** @type {string} */ name) => Number(parameters.get(name) ?? NaN);
    this.memory = asked("memory") > 0 ? asked("memory") : MEMORY[hasLittle ? 2 : 3];
    this.detail = asked("error") > 0 ? asked("error") : 1;
    this.scene = scene;
    this.#listen();
    this.apply();
  }

  #listen() {
    $("memory").value = String(nearest(MEMORY, this.memory));
    $("detail").value = String(nearest(DETAIL, this.detail));
    $("memory").addEventListener("input", () => {
      this.memory = MEMORY[Number($("memory").value)];
      this.apply();
    });
    $("detail").addEventListener("input", () => {
      this.detail = DETAIL[Number($("detail").value)];
      this.apply();
    });
    $("display").addEventListener("change", (event) => {
      const field = /** @type {HTMLInputElement} */ (event.target);
      if (field.name === "projection") this.scene()?.setOrthographic(field.value === "orthographic");
    });
  }

  /** Hand them to the viewer, and show them. */
  apply() {
    const { memory, detail } = this;
    $("memory-value").textContent = format.bytes(memory * 1e6);
    $("detail-value").textContent = t("pixels", { n: format.pixels(detail) });
    const scene = this.scene();
    if (!scene?.isOpen) return;
    scene.viewer.setMemory(memory * 1e6, memory * 2e6);
    scene.viewer.setTargetPixels(detail);
    showProjection(scene.viewer.camera().orthographic);
    scene.session.wake();
  }
}

/** @param {boolean} isParallel */
export function showProjection(isParallel) {
  input(`input[name=projection][value=${isParallel ? "orthographic" : "perspective"}]`).checked = true;
}

/**
 * The place of the value in a list that is nearest to this one.
 * @param {number[]} list
 * @param {number} value
 */
const nearest = (list, value) => list.reduce((best, v, at) => (Math.abs(v - value) < Math.abs(list[best] - value) ? at : best), 0);
