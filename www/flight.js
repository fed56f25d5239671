// Moves of the camera that are not drags: eased from one view to the next, and the views that were left, to return to.
// A camera here is what `Viewer.camera()` gives: azimuth, elevation, distance, x, y, z, parallel, roll, opening angle.

const MILLISECONDS = 650;
const KEPT = 100;
const stillness = matchMedia("(prefers-reduced-motion: reduce)");

/** Whether two cameras show the same picture. */
export function isSame(a, b) {
  const reach = Math.max(a[2], b[2]);
  return a.length === b.length && a.every((v, i) => Math.abs(v - b[i]) <= (i > 1 && i < 6 ? reach * 1e-6 : 1e-6));
}

/** The camera at `part` (0 to 1) of the way: the short way round, and nearer by equal factors. */
export function between(a, b, part) {
  const turn = (i) => {
    const way = Math.atan2(Math.sin(b[i] - a[i]), Math.cos(b[i] - a[i]));
    return a[i] + way * part;
  };
  const line = (i) => a[i] + (b[i] - a[i]) * part;
  const distance = a[2] * (b[2] / a[2]) ** part;
  // The eye comes near as the distance shrinks: the target keeps step with it, or the place would be overshot.
  const near = Math.abs(b[2] - a[2]) > 1e-9 * a[2] ? (distance - a[2]) / (b[2] - a[2]) : part;
  const target = [3, 4, 5].map((i) => a[i] + (b[i] - a[i]) * near);
  // The projection changes at the end of the way into parallel, and at the start of the way out of it.
  const parallel = part < 1 ? Math.min(a[6], b[6]) : b[6];
  return new Float64Array([turn(0), line(1), distance, ...target, parallel, turn(7), line(8)]);
}

export class Flight {
  /** @param {{viewer: object, session: object, onHistory: () => void}} parts */
  constructor({ viewer, session, onHistory }) {
    Object.assign(this, { viewer, session, onHistory });
    this.past = [];
    this.future = [];
    this.flying = null;
    this.held = 0;
  }

  /** Remember the view that is about to be left; moves that follow each other at once count as one. */
  mark(isGesture = false) {
    const now = performance.now();
    const goesOn = isGesture && now - this.held < 800;
    this.held = isGesture ? now : 0;
    if (goesOn) return;
    const camera = this.goal ?? [...this.viewer.camera()];
    if (this.past.length > 0 && isSame(this.past.at(-1), camera)) return;
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

  #swap(from, to) {
    const here = this.goal ?? [...this.viewer.camera()];
    while (from.length > 0 && isSame(from.at(-1), here)) from.pop();
    const camera = from.pop();
    if (camera) to.push(here);
    this.held = 0;
    this.onHistory();
    if (!camera) return false;
    this.to(camera, { mark: false });
    return true;
  }

  /** Where the camera is going, or null at rest. */
  get goal() {
    return this.flying?.goal ?? null;
  }

  /**
   * Move to a camera; eased, unless the person asked for less motion.
   * @returns {Promise<boolean>} true on arrival, false when something else took over
   */
  to(camera, { mark = true, ease = true } = {}) {
    if (mark) this.mark();
    this.stop();
    const from = [...this.viewer.camera()];
    // Only a camera that the viewer takes is flown to; it may bring the distance into its range.
    if (!this.viewer.setCamera(new Float64Array(camera))) return Promise.resolve(false);
    const goal = [...this.viewer.camera()];
    this.session.wake();
    if (!ease || stillness.matches || isSame(from, goal)) return Promise.resolve(true);
    this.viewer.setCamera(new Float64Array(from));
    return new Promise((resolve) => {
      const flying = { goal, resolve, frame: 0 };
      this.flying = flying;
      let start = null;
      const step = (now) => {
        if (this.flying !== flying) return;
        start ??= now;
        const part = Math.min(1, (now - start) / MILLISECONDS);
        this.viewer.setCamera(part < 1 ? between(from, goal, part * part * (3 - 2 * part)) : new Float64Array(goal));
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
