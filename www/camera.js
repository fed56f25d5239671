// The camera as links, saved views and notes hold it: azimuth, elevation, distance, target x, y, z, 1 where parallel, roll, vertical opening angle;
// the last two may be missing. Everywhere else it is an object (`Camera` in kilwa-viewer.d.ts).

/** @import { Camera } from "./types/page.js" */

/** Roll and opening angle where they are not named. */
export const DEFAULTS = [0, 0.7];

/**
 * Whether something read from a file is a camera: 7 to 9 finite numbers, the distance above 0.
 * @param {unknown} numbers
 * @returns {numbers is number[]}
 */
export const isCamera = (numbers) =>
  Array.isArray(numbers) && numbers.length >= 7 && numbers.length <= 9 && numbers.every((n) => Number.isFinite(n)) && numbers[2] > 0;

/**
 * @param {ArrayLike<number>} numbers
 * @returns {Camera}
 */
export function cameraOf(numbers) {
  const [azimuth, elevation, distance, x, y, z, parallel, roll = DEFAULTS[0], fieldOfView = DEFAULTS[1]] = Array.from(numbers);
  return { azimuth, elevation, distance, target: [x, y, z], orthographic: parallel !== 0, roll, fieldOfView };
}

/** @param {Camera} camera */
export function numbersOf({ azimuth, elevation, distance, target, orthographic, roll, fieldOfView }) {
  return [azimuth, elevation, distance, ...target, orthographic ? 1 : 0, roll, fieldOfView];
}

/**
 * A text that differs wherever two cameras do.
 * @param {Camera} camera
 */
export const cameraKey = (camera) => numbersOf(camera).join();
