// The view cube: it turns with the camera, and each of its faces is a button that looks at the model from there. One
// face is in the tab order; arrows go to the others. Up is the sky, the ring lies on the ground, its arrow points north.

import { $ } from "./dom.js";

/** @import { Camera } from "./types/page.js" */

/** From each face, the face that an arrow leads to. @type {Record<string, Record<string, string>>} */
const NEXT = {
  plan: { ArrowUp: "north", ArrowDown: "south", ArrowLeft: "west", ArrowRight: "east" },
  below: { ArrowUp: "south", ArrowDown: "north", ArrowLeft: "west", ArrowRight: "east" },
  south: { ArrowLeft: "west", ArrowRight: "east", ArrowUp: "plan", ArrowDown: "below" },
  east: { ArrowLeft: "south", ArrowRight: "north", ArrowUp: "plan", ArrowDown: "below" },
  north: { ArrowLeft: "east", ArrowRight: "west", ArrowUp: "plan", ArrowDown: "below" },
  west: { ArrowLeft: "north", ArrowRight: "south", ArrowUp: "plan", ArrowDown: "below" },
};

/**
 * The axes of the picture in the world: right, up, and backward (towards the eye).
 * @param {Camera} camera
 */
export function axes({ azimuth, elevation, roll }) {
  const [sa, ca, se, ce, sr, cr] = [Math.sin(azimuth), Math.cos(azimuth), Math.sin(elevation), Math.cos(elevation), Math.sin(roll), Math.cos(roll)];
  const level = [-ca, sa, 0];
  const upright = [-se * sa, -se * ca, ce];
  const right = level.map((v, i) => v * cr + upright[i] * sr);
  const up = level.map((v, i) => upright[i] * cr - v * sr);
  return { right, up, backward: [ce * sa, ce * ca, se] };
}

export class Cube {
  /** @param {(view: string) => void} choose */
  constructor(choose) {
    this.faces = new Map([.../** @type {NodeListOf<HTMLElement>} */ ($("cube").querySelectorAll(".face"))].map((face) => [face.dataset.view ?? "", face]));
    this.turn = "";
    for (const [view, face] of this.faces) {
      face.addEventListener("click", () => choose(view));
      face.addEventListener("focus", () => this.#enter(view));
      face.addEventListener("keydown", (event) => {
        const to = NEXT[view][event.key];
        if (!to) return;
        event.preventDefault();
        event.stopPropagation();
        this.faces.get(to)?.focus();
      });
    }
  }

  /** @param {string} view */
  #enter(view) {
    for (const [name, face] of this.faces) face.tabIndex = name === view ? 0 : -1;
  }

  /**
   * After each frame.
   * @param {Camera} camera
   */
  show(camera) {
    const { right: r, up: u, backward: b } = axes(camera);
    // Columns: where east, south (y down, as on the screen) and the sky go.
    const m = [r[0], -u[0], b[0], 0, -r[1], u[1], -b[1], 0, r[2], -u[2], b[2], 0, 0, 0, 0, 1];
    const turn = `matrix3d(${m.map((v) => v.toFixed(4)).join(",")})`;
    if (turn === this.turn) return;
    this.turn = turn;
    $("cube-turn").style.transform = turn;
    /** @type {Record<string, number>} */
    const facing = { plan: b[2], below: -b[2], north: b[1], south: -b[1], east: b[0], west: -b[0] };
    for (const [view, face] of this.faces) {
      const away = facing[view] < 0.02;
      face.classList.toggle("away", away && document.activeElement !== face);
    }
  }
}
