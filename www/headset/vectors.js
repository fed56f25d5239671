// Vectors of three numbers, and the axes of poses.

/** @typedef {[number, number, number]} Vector */

/** @param {ArrayLike<number>} v @returns {Vector} */
export const vector = (v) => [v[0], v[1], v[2]];

/** @param {Vector} a @param {Vector} b @returns {Vector} */
export const plus = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];

/** @param {Vector} a @param {Vector} b @returns {Vector} */
export const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];

/** @param {Vector} a @param {number} by @returns {Vector} */
export const times = (a, by) => [a[0] * by, a[1] * by, a[2] * by];

/** @param {Vector} a @param {Vector} b */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];

/** @param {Vector} a @param {Vector} b @returns {Vector} */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** A vector of length 1; one without a length stays. @param {Vector} a @returns {Vector} */
export const unit = (a) => times(a, 1 / (Math.hypot(...a) || 1));

/**
 * A pose's place and the axes of its picture, in the headset's space: x right, y up, z to the viewer.
 * @param {XRRigidTransform} transform
 */
export function axesOf({ matrix: m }) {
  const column = (/** @type {number} */ k) => vector(m.subarray(4 * k, 4 * k + 3));
  return { position: column(3), right: column(0), up: column(1), forward: times(column(2), -1) };
}

/** The right and the top of a plate that faces a viewer and stands upright; `way` goes from the viewer to it. @param {Vector} way */
export function facing(way) {
  const across = cross(way, [0, 0, 1]);
  // Straight above or below there is no upright.
  const right = Math.hypot(...across) > 1e-3 * Math.hypot(...way) ? unit(across) : vector([1, 0, 0]);
  return { right, up: unit(cross(right, way)) };
}
