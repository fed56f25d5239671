// Where the floor of the headset's space lies in the model, at 1:1: whoever wears it stands on the model's ground, walks over it, turns in steps and jumps to
// places. The headset's space has y up and z to the viewer, the model z up; both are in metres.

import { minus, plus, times, vector } from "./vectors.js";

/** @import { Vector } from "./vectors.js" */
/** @typedef {import("../viewer-gl.js").Viewer} HeadsetViewer */

/** The eye is never counted as lower above the floor than this, metres: whoever lies on it cannot walk. */
const LOWEST = 0.3;
/** Metres that a person walks in a second with the thumbstick pushed to its end. */
const SPEED = 1.6;
/** Whoever moves in the room without the thumbstick leans over ground that is higher or lower than the floor by more than this share of the eye's height. */
const LEANING = 0.4;
/** Metres that nobody sees. */
const STILL = 2e-4;
/** A pause between two frames is no long stride, seconds. */
const LONGEST = 0.1;

export class Rig {
  /** The floor below the middle of the headset's space. @type {Vector} */
  #origin = [0, 0, 0];
  /** Radians that the headset's space is turned by to the left, seen from above. */
  #turn = 0;

  /** A direction of the headset's space in the model. @param {Vector} way @returns {Vector} */
  way([x, y, z]) {
    const [sin, cos] = [Math.sin(this.#turn), Math.cos(this.#turn)];
    return [cos * x + sin * z, sin * x - cos * z, y];
  }

  /** A place of the headset's space in the model. @param {Vector} place */
  place(place) {
    return plus(this.#origin, this.way(place));
  }

  /**
   * Stand on a place.
   * @param {Vector} head in the headset's space
   * @param {Vector} ground in the model
   */
  stand(head, ground) {
    const below = this.way([head[0], 0, head[2]]);
    this.#origin = minus(ground, below);
  }

  /**
   * Turn so that whoever looks along `forward` looks the way a camera does.
   * @param {Vector} forward in the headset's space
   * @param {number} azimuth of that camera: where its eye stands, clockwise from north
   */
  face([x, , z], azimuth) {
    this.#turn = Math.PI - azimuth - Math.atan2(-x, -z);
  }

  /**
   * Turn where one stands.
   * @param {Vector} head in the headset's space
   * @param {number} angle radians to the left
   */
  turnBy(head, angle) {
    const before = this.place(head);
    this.#turn += angle;
    this.#origin = plus(this.#origin, minus(before, this.place(head)));
  }

  /**
   * Walk, or stand still: the floor follows the ground below the head, also where the person walks in the room.
   * @param {HeadsetViewer} viewer
   * @param {{position: Vector, forward: Vector}} head in the headset's space
   * @param {[right: number, forward: number]} stick -1 to 1
   * @param {number} seconds
   */
  walk(viewer, { position, forward }, [right, ahead], seconds) {
    const eye = this.place(position);
    const height = Math.max(LOWEST, position[1]);
    const isStill = right === 0 && ahead === 0;
    if (isStill && Math.abs(viewer.groundBelow(...eye) - (eye[2] - position[1])) > LEANING * height) return;
    const [x, , z] = forward;
    const level = Math.hypot(x, z) || 1;
    const [east, north] = times(this.way([(x * ahead - z * right) / level, 0, (z * ahead + x * right) / level]), SPEED * Math.min(LONGEST, seconds));
    const there = viewer.stepFrom(...eye, east, north, Math.min(LONGEST, seconds), height);
    const moved = minus(vector(there), eye);
    // Movements too small to be seen are skipped: whoever stands still keeps the same picture, which is then drawn at its finest.
    if (Math.hypot(...moved) > STILL) this.#origin = plus(this.#origin, moved);
  }
}

/**
 * The ground that someone can stand on where a ray meets the model, or before a wall that it meets; null where there is none.
 * @param {HeadsetViewer} viewer
 * @param {Vector} place
 * @param {Vector} way of the ray
 * @param {number} height of the eye
 * @returns {Vector | null}
 */
export function standing(viewer, place, way, height) {
  const level = Math.hypot(way[0], way[1]) || 1;
  const before = (/** @type {number} */ metres) => {
    const [x, y] = [place[0] - (way[0] / level) * metres, place[1] - (way[1] / level) * metres];
    return /** @type {Vector} */ ([x, y, viewer.groundBelow(x, y, place[2] + height / 2)]);
  };
  const there = before(0.3 * height);
  if (Math.abs(there[2] - place[2]) < 0.4 * height) return place;
  return Number.isFinite(there[2]) ? there : null;
}
