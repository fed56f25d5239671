// What is drawn of a measurement (marks.js), and the lines of its label.

import { t } from "../i18n.js";
import { about, mainLines } from "./values.js";

/** @import { Task } from "./task.js" */

/**
 * What is drawn for one measurement; places are world metres.
 * @typedef {object} Shape
 * @property {string} id
 * @property {string} name
 * @property {string} color
 * @property {boolean} dashed it is not final
 * @property {boolean} closed its points enclose something
 * @property {number[][][]} paths
 * @property {number[][]} dots
 * @property {string[]} label
 * @property {number[] | null} anchor the place of the label
 * @property {boolean} chosen
 * @property {boolean} canMove its points have handles
 * @property {boolean} straight its paths are straight between their points
 */

/** A stretch of a shape's path, from point to point, and the number of the point in its middle. @typedef {{from: number, to: number, middle: number, hidden: boolean}} Piece */

/** A straight line between two points is looked at in so many pieces. */
const PIECES = 12;
/** Pieces of a long line. */
const MAX_PIECES = 240;
/** Tools whose points no line joins. */
const APART = ["coordinate", "height", "circle", "plane-angle"];

/**
 * The lines of a label: the value, or what is known of it.
 * @param {Task} task
 * @param {string} unit
 * @param {{isDraft?: boolean}} how
 */
export function linesOf(task, unit, { isDraft = false } = {}) {
  const { provisional, guess } = task;
  const length = provisional ? about(provisional.value, provisional.half, unit) : null;
  if (isDraft) return length ? [length] : [];
  switch (task.state) {
    case "final":
      return mainLines(task.tool, task.readings, unit, task.uncertainty);
    case "refused":
    case "failed":
    case "missed":
      return [];
    default:
      if (guess.length > 0) {
        const lines = mainLines(task.tool, guess, unit).map((line) => `≈ ${line}`);
        return [...lines.slice(0, -1), t("refining", { value: lines[lines.length - 1] })];
      }
      return [length ? t("refining", { value: length }) : t("refiningNoValue")];
  }
}

/**
 * @param {{id: string, name: string, color: string, task: Task}} item
 * @param {{label: string[], chosen: boolean, canMove: boolean}} how
 * @returns {Shape}
 */
export function shapeOf({ id, name, color, task }, { label, chosen, canMove }) {
  const dots = task.points.flatMap((p) => (p.world ? [p.world] : []));
  const drawn = task.lines.length > 0;
  const joins = !APART.includes(task.tool) && !(task.tool === "section" && drawn);
  const closed = joins && !drawn && Boolean(task.kind.closed) && dots.length > 2;
  const paths = drawn ? task.lines : joins ? (dots.length > 1 ? [dots] : []) : planesOf(task, dots);
  return { id, name, color, closed, paths, dots, dashed: !task.isFinal, straight: !drawn, chosen, canMove, label, anchor: anchorOf(task, dots, drawn) };
}

/**
 * The triangles that planes are given by.
 * @param {Task} task
 * @param {number[][]} dots
 */
function planesOf(task, dots) {
  const planes = task.tool === "plane-angle" ? [dots.slice(0, 3), dots.slice(3)] : task.tool === "height" ? [dots.slice(0, 3)] : [];
  return planes.filter((p) => p.length > 1).map((p) => (p.length > 2 ? [...p, p[0]] : p));
}

/**
 * The place of the label.
 * @param {Task} task
 * @param {number[][]} dots
 * @param {boolean} drawn
 */
function anchorOf(task, dots, drawn) {
  if (drawn) {
    const all = task.lines.flat();
    return all.reduce((best, p) => (p[2] > best[2] ? p : best), all[0]);
  }
  if (dots.length === 0) return null;
  if (task.tool === "angle" && dots.length > 1) return dots[1];
  const isAtEnd = task.tool === "height" || (task.tool === "distance" && dots.length > 2);
  if (isAtEnd) return dots[dots.length - 1];
  return [0, 1, 2].map((i) => dots.reduce((sum, p) => sum + p[i], 0) / dots.length);
}

/**
 * Whether the lines are those that they were; long ones are the same only as objects.
 * @param {Shape} a
 * @param {Shape} b
 */
export function isSame(a, b) {
  if (a.paths.length !== b.paths.length || a.closed !== b.closed) return false;
  return a.paths.every((path, k) => path === b.paths[k] || (path.length < 64 && JSON.stringify(path) === JSON.stringify(b.paths[k])));
}

/**
 * The lines of a shape as places one behind the other, and pieces of them that are hidden or not.
 * @param {Shape} shape
 */
export function pieces({ paths, closed, straight }) {
  /** @type {number[]} */
  const places = [];
  /** @type {Piece[]} */
  const all = [];
  for (const path of paths) {
    const points = closed && path.length > 2 ? [...path, path[0]] : path;
    const start = places.length / 3;
    if (straight) {
      for (const [k, p] of points.entries()) {
        const before = points[k - 1];
        if (!before) places.push(...p);
        else for (let n = 1; n <= PIECES; n += 1) places.push(...before.map((v, i) => v + ((p[i] - v) * n) / PIECES));
      }
    } else {
      for (const p of points) places.push(...p);
    }
    const count = places.length / 3 - start;
    const each = straight ? 1 : Math.max(1, Math.ceil(count / MAX_PIECES));
    for (let from = start; from < start + count - 1; from += each) {
      const to = Math.min(from + each, start + count - 1);
      all.push({ from, to, middle: (from + to) >> 1, hidden: false });
    }
  }
  return { places, pieces: all };
}
