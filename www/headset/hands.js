// The controllers: where they point, and what their thumbsticks and buttons ask for. What points may also be a hand or a look (`targetRaySpace`); only
// controllers have thumbsticks.

import { axesOf, minus } from "./vectors.js";

/** @import { Vector } from "./vectors.js" */

/** A thumbstick that is pushed less is at rest; one that is pushed more asks for a turn or a jump. */
const [REST, PUSHED] = [0.2, 0.7];
/** A push is over when the thumbstick is back so far. */
const BACK = 0.4;
/** Radians of a turn. */
const TURN = Math.PI / 6;
/** Directions are remembered for so long, to see how steadily a hand points, milliseconds: the way to the place should not count. */
const REMEMBERED = 120;
/** Of fewer directions nothing is concluded; then a hand is taken to waver by so much, radians. */
const [FEWEST, UNKNOWN] = [4, 0.005];
/** Of a controller's buttons (xr-standard): the lower one beside the thumbstick. */
const HELP = 4;

/**
 * What is asked for in a frame.
 * @typedef {object} Asked
 * @property {[right: number, forward: number]} walk
 * @property {number} turn radians to the left
 * @property {boolean} isAiming at a place to jump to
 * @property {boolean} jumps to the place that was aimed at
 * @property {boolean} help
 */

export class Hands {
  /** The one that points: the last one whose trigger was pulled. @type {XRInputSource | null} */
  pointer = null;
  #hasTurned = false;
  #isAiming = false;
  #isHelpHeld = false;
  /** By what points. @type {WeakMap<XRInputSource, {at: number, way: Vector}[]>} */
  #ways = new WeakMap();

  /**
   * A ray of the headset's space.
   * @param {XRInputSource} source
   * @param {XRFrame} frame
   * @param {XRReferenceSpace} space
   * @returns {{origin: Vector, direction: Vector} | null} null where it is not tracked
   */
  ray(source, frame, space) {
    const pose = frame.getPose(source.targetRaySpace, space);
    if (!pose) return null;
    const { position, forward } = axesOf(pose.transform);
    return { origin: position, direction: forward };
  }

  /**
   * Where the left hand is, in the headset's space.
   * @param {Iterable<XRInputSource>} sources
   * @param {XRFrame} frame
   * @param {XRReferenceSpace} space
   * @returns {Vector | null}
   */
  left(sources, frame, space) {
    const grip = [...sources].find(({ handedness }) => handedness === "left")?.gripSpace;
    const pose = grip && frame.getPose(grip, space);
    return pose ? axesOf(pose.transform).position : null;
  }

  /**
   * What points now, with its ray. Where the others point is remembered too: any trigger may be pulled next.
   * @param {Iterable<XRInputSource>} sources
   * @param {XRFrame} frame
   * @param {XRReferenceSpace} space
   * @param {number} time of the frame, milliseconds
   */
  pointing(sources, frame, space, time) {
    const all = [...sources];
    if (!this.pointer || !all.includes(this.pointer)) this.pointer = all.find(({ handedness }) => handedness !== "left") ?? all[0] ?? null;
    let pointed = null;
    for (const source of all) {
      const ray = this.ray(source, frame, space);
      const recent = (this.#ways.get(source) ?? []).filter(({ at }) => time - at < REMEMBERED);
      this.#ways.set(source, ray ? [...recent, { at: time, way: ray.direction }] : recent);
      if (source === this.pointer) pointed = ray;
    }
    return pointed;
  }

  /** How much a hand has just wavered: standard deviation of its direction, radians. @param {XRInputSource} source */
  wavering(source) {
    const ways = (this.#ways.get(source) ?? []).map(({ way }) => way);
    if (ways.length < FEWEST) return UNKNOWN;
    const mean = /** @type {Vector} */ ([0, 1, 2].map((k) => ways.reduce((sum, way) => sum + way[k], 0) / ways.length));
    return Math.sqrt(ways.reduce((sum, way) => sum + Math.hypot(...minus(way, mean)) ** 2, 0) / ways.length);
  }

  /**
   * @param {Iterable<XRInputSource>} sources
   * @returns {Asked}
   */
  asked(sources) {
    /** @type {Asked} */
    const asked = { walk: [0, 0], turn: 0, isAiming: false, jumps: false, help: false };
    let isHelpHeld = false;
    for (const { handedness, gamepad } of sources) {
      if (!gamepad) continue;
      // The first two axes are those of a touchpad, the others those of a thumbstick.
      const [x, y] = gamepad.axes.slice(gamepad.axes.length > 3 ? 2 : 0);
      if (handedness === "left") asked.walk = [past(x), -past(y)];
      else this.#stick(x ?? 0, y ?? 0, asked);
      isHelpHeld ||= gamepad.buttons[HELP]?.pressed ?? false;
    }
    asked.help = isHelpHeld && !this.#isHelpHeld;
    this.#isHelpHeld = isHelpHeld;
    return asked;
  }

  /**
   * To a side it turns, once for each push; forward it aims, and jumps when it is let go.
   * @param {number} x
   * @param {number} y
   * @param {Asked} asked
   */
  #stick(x, y, asked) {
    const isAside = Math.abs(x) > PUSHED && Math.abs(x) > Math.abs(y);
    if (isAside && !this.#hasTurned && !this.#isAiming) asked.turn = -Math.sign(x) * TURN;
    this.#hasTurned = isAside || (this.#hasTurned && Math.abs(x) > BACK);
    const wasAiming = this.#isAiming;
    this.#isAiming = wasAiming ? y < -BACK : y < -PUSHED && Math.abs(y) > Math.abs(x);
    asked.isAiming = this.#isAiming;
    asked.jumps = wasAiming && !this.#isAiming;
  }
}

/** How far a thumbstick is pushed beyond its rest, -1 to 1. @param {number | undefined} x */
const past = (x = 0) => (Math.abs(x) < REST ? 0 : Math.sign(x) * ((Math.abs(x) - REST) / (1 - REST)));
