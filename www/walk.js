// Walking: the eye at a person's height over the ground. Keys and the pad say which way; the viewer finds the ground and
// the walls among the parts that are loaded.

import { $ } from "./dom.js";
import { length } from "./format.js";
import { t } from "./i18n.js";

/** @import { Camera, FrameStats, Viewer } from "./types/page.js" */
/** @import { Session } from "./session.js" */

const HEIGHT = 1.6;
const HEIGHTS = [0.2, 20];
/** Eye heights per second: 1.6 m gives a brisk walk. Shift runs. */
const SPEED = 1.4;
const RUN = 3;
const KEY_STEP = 0.1;
/** Vertical opening angle, radians: a room needs more than a model on a table. */
const WIDE = 1.1;
const USUAL = 0.7;

/** @type {Record<string, string>} */
export const WALK_KEYS = {
  w: "forward",
  s: "back",
  a: "left",
  d: "right",
  arrowup: "forward",
  arrowdown: "back",
  arrowleft: "turnLeft",
  arrowright: "turnRight",
};
const TURN = 1.4;

export class Walk {
  /** @param {{viewer: Viewer, session: Session, flight: import("./flight.js").Flight, onChange: (on: boolean) => void}} parts */
  constructor({ viewer, session, flight, onChange }) {
    this.viewer = viewer;
    this.session = session;
    this.flight = flight;
    this.onChange = onChange;
    this.on = false;
    this.height = HEIGHT;
    /** What is pressed. @type {Set<string>} */
    this.held = new Set();
    this.running = false;
    /** When the last step was made, milliseconds; null after a pause. @type {number | null} */
    this.last = null;
    this.triangles = -1; // of the last frame
    this.scheduled = false;
    this.abort = new AbortController();
    const options = { signal: this.abort.signal };
    for (const button of /** @type {NodeListOf<HTMLElement>} */ ($("walk-pad").querySelectorAll("[data-walk]"))) {
      const way = button.dataset.walk ?? "";
      button.addEventListener(
        "pointerdown",
        (event) => {
          button.setPointerCapture(event.pointerId);
          this.press(way);
        },
        options,
      );
      for (const type of ["pointerup", "pointercancel", "lostpointercapture"]) button.addEventListener(type, () => this.release(way), options);
      // Enter and Space on a button, and a reader's click: one step.
      button.addEventListener("click", (event) => event.detail === 0 && this.step(way), options);
      button.addEventListener("contextmenu", (event) => event.preventDefault(), options);
    }
    $("eye-lower").addEventListener("click", () => this.raise(-1), options);
    $("eye-higher").addEventListener("click", () => this.raise(1), options);
    addEventListener("blur", () => this.held.clear(), options);
  }

  close() {
    this.abort.abort();
    this.held.clear();
    this.on = false;
    $("walk-pad").hidden = true;
  }

  /** Stand where the eye is, if there is ground below it inside the model; else on what the middle of the picture shows. */
  enter() {
    if (this.on) return;
    this.flight.mark();
    this.on = true;
    this.stand(this.place(), { mark: false });
    this.onChange(true);
    this.show();
  }

  /** The ground to stand on. */
  place() {
    const camera = this.viewer.camera();
    const [x, y, z] = this.viewer.eye();
    const below = camera.orthographic ? NaN : this.viewer.groundBelow(x, y, z);
    const isInside = z - below < 3 * this.height;
    const { width, height } = this.session.canvas;
    const seen = isInside ? [] : this.viewer.pick(width / 2, height / 2);
    return isInside ? [x, y, below] : seen.length > 0 ? this.#before([...seen].slice(0, 3), 4) : this.#under(camera);
  }

  /**
   * The ground some eye heights before a place, so that one looks at it; with 0 on it, unless it is a wall.
   * @param {number[]} place
   * @param {number} steps
   */
  #before([x, y, z], steps) {
    const { azimuth } = this.viewer.camera();
    const back = (/** @type {number} */ by) => {
      const [px, py] = [x + Math.sin(azimuth) * by * this.height, y + Math.cos(azimuth) * by * this.height];
      return [px, py, this.viewer.groundBelow(px, py, z + 0.5 * this.height)];
    };
    const isLevel = Math.abs(back(0.3)[2] - z) < 0.4 * this.height;
    const place = steps === 0 && isLevel ? [x, y, z] : back(steps || 2.5);
    return Number.isFinite(place[2]) ? place : [x, y, z];
  }

  /**
   * Walk to the place that a pixel shows.
   * @param {number} x
   * @param {number} y
   */
  standAt(x, y) {
    const place = this.viewer.pick(x, y);
    if (place.length > 0) this.stand(this.#before([...place].slice(0, 3), 0));
  }

  /**
   * The ground below what the view turns about, where nothing is in the middle of the picture.
   * @param {Camera} camera
   */
  #under({ distance, target: [x, y, z] }) {
    const below = this.viewer.groundBelow(x, y, z + distance);
    return [x, y, Number.isFinite(below) ? below : z];
  }

  leave() {
    if (!this.on) return;
    this.on = false;
    this.held.clear();
    this.flight.to({ ...this.viewer.camera(), fieldOfView: USUAL }, { mark: false, ease: false });
    this.onChange(false);
    this.show();
  }

  show() {
    $("walk-pad").hidden = !this.on;
    $("eye-height").textContent = t("eyeHeight", { height: length(this.height) });
  }

  /**
   * Stand on a place, looking level the same way.
   * @param {number[]} place
   * @param {{mark?: boolean}} how
   */
  stand([x, y, z], { mark = true } = {}) {
    const { azimuth } = this.viewer.camera();
    const distance = 2 * this.height;
    // The target is in front of the eye, and the eye is at its height.
    this.flight.to(
      {
        azimuth,
        elevation: 0,
        distance,
        target: [x - Math.sin(azimuth) * distance, y - Math.cos(azimuth) * distance, z + this.height],
        orthographic: false,
        roll: 0,
        fieldOfView: WIDE,
      },
      { mark },
    );
  }

  /**
   * After each frame: where detail arrived, the ground may lie higher or lower.
   * @param {FrameStats} stats
   */
  frame(stats) {
    if (!this.on || this.flight.goal || this.triangles === stats.trianglesDrawn) return;
    this.triangles = stats.trianglesDrawn;
    // A coarser or finer form of the same ground is no reason to move.
    const [x, y, z] = this.viewer.eye();
    if (Math.abs(z - this.height - this.viewer.groundBelow(x, y, z)) > 0.1 * this.height) this.#soon();
  }

  /** @param {string} way */
  press(way) {
    this.flight.mark(true);
    this.flight.stop();
    this.held.add(way);
    this.#soon();
  }

  /** @param {string} way */
  release(way) {
    this.held.delete(way);
  }

  /**
   * One step, for a press that is no holding.
   * @param {string} way
   */
  step(way) {
    this.flight.mark(true);
    this.flight.stop();
    this.#go(new Set([way]), KEY_STEP * 4);
    this.session.wake();
  }

  /**
   * Forward or back by some eye heights, for the wheel.
   * @param {number} amount
   */
  roll(amount) {
    this.flight.stop();
    this.viewer.walk(amount * this.height, 0, 0.05, this.height);
    this.#soon();
  }

  /** @param {number} direction */
  raise(direction) {
    const factor = direction > 0 ? 1.25 : 0.8;
    this.height = Math.min(HEIGHTS[1], Math.max(HEIGHTS[0], this.height * factor));
    this.show();
    this.#soon();
  }

  #soon() {
    if (this.scheduled || !this.on) return;
    this.scheduled = true;
    this.last = null;
    requestAnimationFrame((now) => this.#tick(now));
  }

  /** @param {number} now */
  #tick(now) {
    this.scheduled = false;
    if (!this.on || this.session.closed) return;
    // A hidden tab gives no frames: a long pause is no long stride.
    const seconds = this.last === null ? 1 / 60 : Math.min(0.1, (now - this.last) / 1000);
    this.last = now;
    const moved = this.#go(this.held, seconds);
    if (moved) this.session.wake();
    if (moved || this.held.size > 0) {
      this.scheduled = true;
      requestAnimationFrame((next) => this.#tick(next));
    }
  }

  /**
   * @param {Set<string>} held
   * @param {number} seconds
   */
  #go(held, seconds) {
    const sign = (/** @type {string} */ plus, /** @type {string} */ minus) => (held.has(plus) ? 1 : 0) - (held.has(minus) ? 1 : 0);
    const stride = SPEED * this.height * seconds * (this.running ? RUN : 1);
    const turn = sign("turnLeft", "turnRight") * TURN * seconds;
    if (turn !== 0) this.viewer.look(-turn, 0);
    const moved = this.viewer.walk(sign("forward", "back") * stride, sign("right", "left") * stride, seconds, this.height);
    return moved || turn !== 0;
  }
}
