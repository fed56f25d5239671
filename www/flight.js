// Moves of the camera that are not drags: eased from one view to the next, and the views that were left, to return to.

/** @import { Camera, Viewer } from "./types/page.js" */
/** @import { Session } from "./session.js" */

const MILLISECONDS = 650;
const KEPT = 100;
const stillness = matchMedia("(prefers-reduced-motion: reduce)");

/**
 * Whether two cameras show the same picture.
 * @param {Camera} a
 * @param {Camera} b
 */
export function isSame(a, b) {
  const slack = Math.max(a.distance, b.distance) * 1e-6;
  const isNear = (/** @type {"azimuth" | "elevation" | "roll" | "fieldOfView"} */ name) => Math.abs(a[name] - b[name]) <= 1e-6;
  return (
    isNear("azimuth") &&
    isNear("elevation") &&
    isNear("roll") &&
    isNear("fieldOfView") &&
    a.orthographic === b.orthographic &&
    Math.abs(a.distance - b.distance) <= slack &&
    a.target.every((v, i) => Math.abs(v - b.target[i]) <= slack)
  );
}

/**
 * The camera at `part` (0 to 1) of the way: the short way round, and nearer by equal factors.
 * @param {Camera} a
 * @param {Camera} b
 * @param {number} part
 * @returns {Camera}
 */
export function between(a, b, part) {
  const line = (/** @type {number} */ from, /** @type {number} */ to, share = part) => from + (to - from) * share;
  const turn = (/** @type {number} */ from, /** @type {number} */ to) => from + Math.atan2(Math.sin(to - from), Math.cos(to - from)) * part;
  const distance = a.distance * (b.distance / a.distance) ** part;
  // The eye comes near as the distance shrinks: the target keeps step with it, or the place would be overshot.
  const way = b.distance - a.distance;
  const near = Math.abs(way) > 1e-9 * a.distance ? (distance - a.distance) / way : part;
  const [x, y, z] = a.target.map((v, i) => line(v, b.target[i], near));
  return {
    azimuth: turn(a.azimuth, b.azimuth),
    elevation: line(a.elevation, b.elevation),
    distance,
    target: [x, y, z],
    // The projection changes at the end of the way into parallel, and at the start of the way out of it.
    orthographic: part < 1 ? a.orthographic && b.orthographic : b.orthographic,
    roll: turn(a.roll, b.roll),
    fieldOfView: line(a.fieldOfView, b.fieldOfView),
  };
}

export class Flight {
  /** @param {{viewer: Viewer, session: Session, onHistory: () => void}} parts */
  constructor({ viewer, session, onHistory }) {
    this.viewer = viewer;
    this.session = session;
    this.onHistory = onHistory;
    /** @type {Camera[]} */
    this.past = [];
    /** @type {Camera[]} */
    this.future = [];
    /** @type {{goal: Camera, resolve: (isThere: boolean) => void, frame: number} | null} */
    this.flying = null;
    /** When the last step of a gesture was. The page's clock starts at zero, so zero cannot stand for never. */
    this.held = Number.NEGATIVE_INFINITY;
  }

  /** Remember the view that is about to be left; moves that follow each other at once count as one. */
  mark(isGesture = false) {
    const now = performance.now();
    const goesOn = isGesture && now - this.held < 800;
    this.held = isGesture ? now : Number.NEGATIVE_INFINITY;
    if (goesOn) return;
    const camera = this.there;
    const last = this.past.at(-1);
    if (last && isSame(last, camera)) return;
    this.past.push(camera);
    if (this.past.length > KEPT) this.past.shift();
    this.future = [];
    this.onHistory();
  }

  get canGoBack() {
    return this.past.length > 0;
  }

  get canGoForward() {
    return this.future.length > 0;
  }

  /** The view before the last move; false where there is none. */
  back() {
    return this.#swap(this.past, this.future);
  }

  forward() {
    return this.#swap(this.future, this.past);
  }

  /**
   * @param {Camera[]} from
   * @param {Camera[]} to
   */
  #swap(from, to) {
    const here = this.there;
    let camera = from.pop();
    while (camera && isSame(camera, here)) camera = from.pop();
    if (camera) to.push(here);
    this.held = Number.NEGATIVE_INFINITY;
    this.onHistory();
    if (!camera) return false;
    this.to(camera, { mark: false });
    return true;
  }

  /** Where the camera is going, or null at rest. */
  get goal() {
    return this.flying?.goal ?? null;
  }

  /** Where the camera will be: its goal, or where it is at rest. */
  get there() {
    return this.goal ?? this.viewer.camera();
  }

  /**
   * Move to a camera; eased, unless the person asked for less motion.
   * @param {Camera} camera
   * @returns {Promise<boolean>} true on arrival, false when something else took over
   */
  to(camera, { mark = true, ease = true } = {}) {
    if (mark) this.mark();
    this.stop();
    const from = this.viewer.camera();
    // Only a camera that the viewer takes is flown to; it may bring the distance into its range.
    if (!this.viewer.setCamera(camera)) return Promise.resolve(false);
    const goal = this.viewer.camera();
    this.session.wake();
    if (!ease || stillness.matches || isSame(from, goal)) return Promise.resolve(true);
    this.viewer.setCamera(from);
    return new Promise((resolve) => {
      const flying = { goal, resolve, frame: 0 };
      this.flying = flying;
      /** @type {number | null} */
      let start = null;
      const step = (/** @type {number} */ now) => {
        if (this.flying !== flying) return;
        start ??= now;
        const part = Math.min(1, (now - start) / MILLISECONDS);
        this.viewer.setCamera(part < 1 ? between(from, goal, part * part * (3 - 2 * part)) : goal);
        this.session.wake();
        if (part < 1) {
          flying.frame = requestAnimationFrame(step);
        } else {
          this.flying = null;
          resolve(true);
        }
      };
      flying.frame = requestAnimationFrame(step);
    });
  }

  /** The person took the camera. */
  stop() {
    if (!this.flying) return;
    cancelAnimationFrame(this.flying.frame);
    this.flying.resolve(false);
    this.flying = null;
  }
}
