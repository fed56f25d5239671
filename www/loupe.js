// A loupe above the finger: the part of the picture that it covers, enlarged, while it aims at a place.

import { $ } from "./dom.js";

const SIZE = 128; // CSS pixels across
const ENLARGED = 3;
/** From the finger to the loupe's edge, CSS pixels. */
const ABOVE = 28;

/** @import { Session } from "./session.js" */

export class Loupe {
  /** @param {Session} session */
  constructor(session) {
    this.session = session;
    /** @type {number[] | null} */
    this.at = null;
    Object.assign($("loupe-picture"), { width: SIZE * session.ratio, height: SIZE * session.ratio });
  }

  /**
   * At a pixel of the picture, or away with it.
   * @param {number[] | null} at
   */
  show(at) {
    this.at = at;
    $("loupe").hidden = !at;
    if (!at) return;
    const { ratio, canvas } = this.session;
    const [x, y] = at.map((v) => v / ratio);
    const wide = canvas.width / ratio;
    const left = Math.max(4, Math.min(wide - SIZE - 4, x - SIZE / 2));
    const above = y - ABOVE - SIZE;
    // At the upper edge there is no space above: beside it, on the side with more space.
    const beside = above < 4;
    const side = x > wide / 2 ? x - SIZE - 2 * ABOVE : x + 2 * ABOVE;
    $("loupe").style.transform = `translate(${(beside ? side : left).toFixed(1)}px, ${Math.max(4, above).toFixed(1)}px)`;
    // The picture can be read only while it is being drawn.
    this.session.wake();
  }

  /** Right after a frame was drawn. */
  frame() {
    if (!this.at) return;
    const { canvas, ratio } = this.session;
    const { width } = $("loupe-picture");
    const part = (SIZE * ratio) / ENLARGED;
    const context = /** @type {CanvasRenderingContext2D} */ ($("loupe-picture").getContext("2d"));
    context.clearRect(0, 0, width, width);
    for (const layer of [canvas, $("marks")]) {
      const scale = layer.width / canvas.width;
      if (!(scale > 0)) continue;
      context.drawImage(layer, (this.at[0] - part / 2) * scale, (this.at[1] - part / 2) * scale, part * scale, part * scale, 0, 0, width, width);
    }
  }
}
