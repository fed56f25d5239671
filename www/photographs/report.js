// Reading a colour report (archive/src/colour_report.rs): its photographs that colour the model.

import { t } from "../i18n.js";
import { axesOfPose } from "./pose.js";

/** @import { Lens } from "./lens.js" */
/** @import { Photograph, Vector } from "./pose.js" */

const FORM = 1;
/** A path as `kilwa publish` gives it: in the folder of the report. */
const PATH = /^photographs\/(?:[\w-][\w.-]*\/)*[\w-][\w.-]*\.(?:jpg|png)$/;
const KINDS = ["pinhole", "equirectangular", "cylindrical"];

/** @param {unknown} value @param {number} length @returns {value is number[]} */
const isNumbers = (value, length) => Array.isArray(value) && value.length === length && value.every(Number.isFinite);

/** @param {unknown} path @returns {string | null} */
function safe(path) {
  if (path === undefined || path === null) return null;
  if (typeof path !== "string" || !PATH.test(path)) throw 0;
  return path;
}

/**
 * @param {any} lens
 * @returns {Lens}
 */
function lensOf(lens) {
  const pairs = [lens.focal, lens.center, lens.scale].filter((pair) => pair !== undefined);
  const isRight =
    KINDS.includes(lens.kind) &&
    isNumbers(lens.size, 2) &&
    lens.size.every((/** @type {number} */ side) => side >= 1) &&
    pairs.every((pair) => isNumbers(pair, 2)) &&
    (lens.kind !== "pinhole" || isNumbers(lens.focal, 2)) &&
    Number.isFinite(lens.max_angle_degrees) &&
    Number.isFinite(lens.skew ?? 0);
  const bends = lens.distortion;
  if (!isRight || (bends && ![bends.k, bends.p].every((list) => isNumbers(list, list.length)))) throw 0;
  return lens;
}

/**
 * @param {any} json
 * @returns {Photograph[]} in the order of the report
 */
export function photographsOf(json) {
  try {
    if (json.kilwa_colour_report !== FORM) throw 0;
    return json.photographs
      .filter((/** @type {any} */ { seen }) => seen > 0)
      .map((/** @type {any} */ photo) => {
        const { rotation_wxyz: rotation } = photo.camera_from_world;
        if (!isNumbers(rotation, 4) || !isNumbers(photo.position, 3) || typeof photo.name !== "string") throw 0;
        return {
          name: photo.name,
          bytes: Number(photo.bytes),
          camera: lensOf(photo.camera),
          axes: axesOfPose(rotation),
          position: /** @type {Vector} */ (photo.position),
          path: safe(photo.path),
          preview: safe(photo.preview?.path),
          thumbnail: safe(photo.thumbnail?.path),
        };
      });
  } catch {
    throw new Error(t("photographsForm"));
  }
}
