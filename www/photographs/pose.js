// Where a photograph was taken from, and how the page's camera stands there. The world's z is up; axes of a photograph: x right, y down, z forward.

import { border } from "./lens.js";

/** @import { Camera } from "../types/page.js" */
/** @import { Lens } from "./lens.js" */
/** @typedef {[number, number, number]} Vector */
/** @typedef {{right: Vector, up: Vector, forward: Vector}} Axes */

/**
 * A photograph of a colour report that colours the model.
 * @typedef {object} Photograph
 * @property {string} name
 * @property {number} bytes of the file
 * @property {Lens} camera
 * @property {Axes} axes in the world
 * @property {Vector} position metres
 * @property {string | null} path of the file, relative to the report; null where it was not published
 * @property {string | null} preview path of a copy with fewer pixels
 * @property {string | null} thumbnail path of a copy for lists
 */

/** Vertical opening angle in a panorama, radians. */
const WIDE = 1.2;
/** Smallest and largest opening angle, radians. */
const [NARROWEST, WIDEST] = [0.02, 2.4];
/** Margin round a photograph, as a factor. */
const MARGIN = 1.03;
/** Rounds until the photograph is in the middle. */
const ROUNDS = 8;

/** @param {Vector} a @param {Vector} b */
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @param {Vector} v @param {number} f @returns {Vector} */
const times = ([x, y, z], f) => [x * f, y * f, z * f];
/** @param {Vector} a @param {Vector} b @returns {Vector} */
export const plus = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];

/**
 * The axes of a camera in the world, from the rotation that leads from the world to it.
 * @param {number[]} quaternion w, x, y, z
 * @returns {Axes}
 */
export function axesOfPose([w, x, y, z]) {
  return {
    right: [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
    up: [-2 * (x * y + w * z), -1 + 2 * (x * x + z * z), -2 * (y * z - w * x)],
    forward: [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
  };
}

/**
 * A direction in the axes of a photograph, in the world.
 * @param {Axes} axes
 * @param {Vector} direction
 */
export const inWorld = ({ right, up, forward }, [x, y, z]) => plus(plus(times(right, x), times(up, -y)), times(forward, z));

/**
 * The axes of the page's camera (viewer/src/camera.rs).
 * @param {Pick<Camera, "azimuth" | "elevation" | "roll">} camera
 * @returns {Axes}
 */
export function axesOfCamera({ azimuth, elevation, roll }) {
  const [sa, ca, se, ce] = [Math.sin(azimuth), Math.cos(azimuth), Math.sin(elevation), Math.cos(elevation)];
  /** @type {Vector} */
  const level = [-ca, sa, 0];
  /** @type {Vector} */
  const upright = [-se * sa, -se * ca, ce];
  const [sr, cr] = [Math.sin(roll), Math.cos(roll)];
  return {
    right: plus(times(level, cr), times(upright, sr)),
    up: plus(times(upright, cr), times(level, -sr)),
    forward: [-ce * sa, -ce * ca, -se],
  };
}

/**
 * The axes of the page's camera in those of a photograph.
 * @param {Axes} camera
 * @param {Axes} photograph
 * @returns {Axes}
 */
export function seenFrom(camera, { right, up, forward }) {
  const of = (/** @type {Vector} */ v) => /** @type {Vector} */ ([dot(v, right), -dot(v, up), dot(v, forward)]);
  return { right: of(camera.right), up: of(camera.up), forward: of(camera.forward) };
}

/**
 * The direction and roll of a camera of the page that looks along `forward`, the top of its picture towards `up`.
 * @param {Vector} forward
 * @param {Vector} up
 */
function directionOf(forward, up) {
  const elevation = Math.asin(Math.max(-1, Math.min(1, -forward[2])));
  const azimuth = Math.hypot(forward[0], forward[1]) > 1e-9 ? Math.atan2(-forward[0], -forward[1]) : 0;
  const level = axesOfCamera({ azimuth, elevation, roll: 0 });
  return { azimuth, elevation, roll: Math.atan2(-dot(up, level.right), dot(up, level.up)) };
}

/**
 * The camera of the page that stands where a photograph was taken and shows all of it; of a panorama, a part ahead. A photograph that was taken with the
 * camera on its side or upside down stands upright, unless it looks up or down.
 * @param {Photograph} photograph
 * @param {{width: number, height: number, covered: number}} picture pixels; `covered` of them are below something else, from the lower edge
 * @param {number} distance to what the camera turns about later, metres
 * @returns {Camera}
 */
export function cameraAt({ camera: lens, axes, position }, { width, height, covered }, distance) {
  const stands = (/** @type {Vector} */ forward) => ({ distance, target: plus(position, times(forward, distance)), orthographic: false });
  const straight = directionOf(axes.forward, axes.up);
  if (lens.kind !== "pinhole") return { ...stands(axes.forward), ...straight, roll: 0, fieldOfView: WIDE };
  const quarter = Math.PI / 2;
  const turns = Math.abs(straight.elevation) < Math.PI / 3 ? Math.round(straight.roll / quarter) : 0;
  const own = axesOfCamera({ ...straight, roll: straight.roll - turns * quarter });
  const seen = border(lens, 8).map((direction) => direction && inWorld(axes, direction));
  const share = covered / height;
  // The middle of the photograph comes into the middle of what is free, so the camera looks lower. Its borders are not parallel then: a few rounds.
  let lower = 0;
  let view = own;
  let tangent = 0;
  for (let round = 0; round < ROUNDS; round += 1) {
    const mix = (/** @type {Vector} */ a, /** @type {Vector} */ b, angle = lower) => plus(times(a, Math.cos(angle)), times(b, Math.sin(angle)));
    view = { right: own.right, up: mix(own.up, own.forward), forward: mix(own.forward, own.up, -lower) };
    const places = seen.map((direction) => direction && placeOf(direction, view));
    if (!places.every((place) => place !== null)) return { ...stands(own.forward), ...directionOf(own.forward, own.up), fieldOfView: WIDEST };
    const [across, upward] = [places.map(([x]) => Math.abs(x)), places.map(([, y]) => y)];
    const [low, high] = [Math.min(...upward), Math.max(...upward)];
    tangent = MARGIN * Math.max((high - low) / 2 / (1 - share), (Math.max(...across) * height) / width);
    lower += Math.atan(tangent * share) - Math.atan((high + low) / 2);
  }
  return { ...stands(view.forward), ...directionOf(view.forward, view.up), fieldOfView: Math.max(NARROWEST, Math.min(WIDEST, 2 * Math.atan(tangent))) };
}

/**
 * Where a direction is seen, as tangents to the right and upward; null beside and behind the camera, as a fisheye sees.
 * @param {Vector} direction
 * @param {Axes} view
 */
function placeOf(direction, { right, up, forward }) {
  const ahead = dot(direction, forward);
  return ahead < 0.1 * Math.hypot(...direction) ? null : [dot(direction, right) / ahead, dot(direction, up) / ahead];
}
