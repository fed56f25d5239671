// Planes that cut the model or that distances count from: axes, directions, and where a plane lies.

/** @import { Plane, Viewer } from "./types/page.js" */

/** @type {Record<string, number[]>} */
export const AXES = { up: [0, 0, 1], north: [0, 1, 0], east: [1, 0, 0] };

/** @typedef {number[]} V a vector or a place, three numbers */

/** @param {V} a @param {V} b */
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @param {V} a @param {V} b */
export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @param {V} a @param {V} b */
const sub = (a, b) => a.map((v, i) => v - b[i]);
/** Numbers for links: a tenth of a millimetre, a ten-thousandth of a direction. @param {number} v */
export const short = (v) => Number(v.toFixed(4));

/**
 * From the model to the eye, a unit vector.
 * @param {Viewer} viewer
 */
export function towardsEye(viewer) {
  const { azimuth, elevation } = viewer.camera();
  return [Math.cos(elevation) * Math.sin(azimuth), Math.cos(elevation) * Math.cos(azimuth), Math.sin(elevation)].map(short);
}

/**
 * The middle of the model, and how far it reaches along a direction: `[low, high]` of `normal · p`.
 * @param {Viewer} viewer
 * @param {V} normal
 */
export function reach(viewer, normal) {
  const [a, b, c, u, v, w] = viewer.bounds();
  const center = [(a + u) / 2, (b + v) / 2, (c + w) / 2];
  const half = (Math.abs(normal[0]) * (u - a) + Math.abs(normal[1]) * (v - b) + Math.abs(normal[2]) * (w - c)) / 2;
  return { center, low: dot(normal, center) - half, high: dot(normal, center) + half };
}

/**
 * The plane through three places, its normal towards the eye; null where they lie on a line.
 * @param {V[]} places
 * @param {Viewer} viewer
 */
export function planeOfPoints([a, b, c], viewer) {
  const n = cross(sub(b, a), sub(c, a));
  const length = Math.hypot(...n);
  if (!(length > 1e-12)) return null;
  const sign = dot(n, towardsEye(viewer)) < 0 ? -1 : 1;
  return { normal: n.map((v) => Number(((v * sign) / length).toFixed(6))), point: a.map(short) };
}

/**
 * The name of an axis that a plane looks along.
 * @param {V} normal
 */
export function axisName(normal) {
  const found = Object.entries(AXES).find(([, axis]) => Math.abs(Math.abs(dot(axis, normal)) - 1) < 1e-6);
  return found?.[0] ?? "other";
}

/**
 * Where a plane lies along its normal: the coordinate for an axis, else metres from the middle of the model.
 * @param {Plane} plane
 * @param {Viewer} viewer
 */
export function position({ normal, point }, viewer) {
  const name = axisName(normal);
  if (name !== "other") return dot(AXES[name], point);
  return dot(normal, sub(point, reach(viewer, normal).center));
}

/**
 * The plane at another position.
 * @param {Plane} plane
 * @param {number} value
 * @param {Viewer} viewer
 */
export function moved({ normal, point }, value, viewer) {
  const name = axisName(normal);
  const by = value - position({ normal, point }, viewer);
  const along = name === "other" ? normal : AXES[name];
  return { normal, point: point.map((v, i) => short(v + along[i] * by)) };
}
