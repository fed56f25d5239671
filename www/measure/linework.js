// The lines of a section, a profile or contours as a drawing has them: the nearest place on them, and the next one along a line. Flat coordinates are
// those of the drawing, metres, x to the right and y up; each point has its place in world coordinates beside it (core/measure/src/lines.rs).

/** @import { Line } from "../types/page.js" */
/** A place on a line: between point `at` and the next one, `part` of the way. @typedef {{line: number, at: number, part: number, flat: number[], world: number[]}} Spot */
/**
 * A line. `flat`: x and y of its points, the first one again at the end where it is closed. `boxes`: left, bottom, right and top of every {@link BOX} segments.
 * @typedef {{flat: Float64Array, world: number[][], closed: boolean, length: number, boxes: Float64Array}} Path
 */

/** How far a flat coordinate may be off a world coordinate and still be the same, metres: both are sums of doubles of up to ten million metres. */
const SAME = 1e-5;
/** Segments that share a box, so that those far from a place need not be looked at one by one. */
const BOX = 256;

/** @param {number[]} a @param {number[]} b @param {number} part */
const between = (a, b, part) => a.map((v, i) => v + (b[i] - v) * part);

export class Linework {
  /** @param {Line[]} lines */
  constructor(lines) {
    this.paths = lines.filter(({ flat }) => flat.length > 1).map((line) => pathOf(fromLeft(line)));
    this.low = [Infinity, Infinity];
    this.high = [-Infinity, -Infinity];
    for (const { boxes } of this.paths) {
      for (let k = 0; k < boxes.length; k += 4) {
        for (const i of [0, 1]) {
          this.low[i] = Math.min(this.low[i], boxes[k + i]);
          this.high[i] = Math.max(this.high[i], boxes[k + 2 + i]);
        }
      }
    }
    const every = (/** @type {(x: number, y: number, world: number[]) => boolean} */ test) =>
      this.paths.every(({ flat, world }) => world.every((place, k) => test(flat[2 * k], flat[2 * k + 1], place)));
    /** What its axes are: up is the world's height (`upright`), or x and y are the world's (`plan`). @type {"upright" | "plan" | "oblique"} */
    this.axes = every((_, y, [, , z]) => Math.abs(y - z) < SAME)
      ? "upright"
      : every((x, y, [east, north]) => Math.hypot(x - east, y - north) < SAME)
        ? "plan"
        : "oblique";
  }

  /** Width and height, metres. */
  get size() {
    return this.high.map((v, i) => v - this.low[i]);
  }

  /**
   * The place on a line that is nearest to a flat place, at most `within` metres away.
   * @param {number[]} place
   * @param {number} within
   * @returns {Spot | null}
   */
  nearest([x, y], within) {
    let best = within * within;
    let found = null;
    for (const [line, { flat, boxes }] of this.paths.entries()) {
      for (let box = 0; box < boxes.length / 4; box += 1) {
        const [left, bottom, right, top] = boxes.subarray(4 * box, 4 * box + 4);
        if (Math.max(left - x, x - right, 0) ** 2 + Math.max(bottom - y, y - top, 0) ** 2 > best) continue;
        for (let at = box * BOX; at < Math.min((box + 1) * BOX, flat.length / 2 - 1); at += 1) {
          const [ax, ay] = [flat[2 * at], flat[2 * at + 1]];
          const [dx, dy] = [flat[2 * at + 2] - ax, flat[2 * at + 3] - ay];
          const all = dx * dx + dy * dy;
          const part = all > 0 ? Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / all)) : 0;
          const [ex, ey] = [ax + dx * part - x, ay + dy * part - y];
          const distance = ex * ex + ey * ey;
          if (distance > best) continue;
          best = distance;
          found = { line, at, part };
        }
      }
    }
    return found && this.spot(found.line, found.at, found.part);
  }

  /**
   * @param {number} line
   * @param {number} at
   * @param {number} part
   * @returns {Spot}
   */
  spot(line, at, part) {
    const { flat, world } = this.paths[line];
    const [from, to] = [at, at + 1].map((k) => [...flat.subarray(2 * k, 2 * k + 2)]);
    return { line, at, part, flat: between(from, to, part), world: between(world[at], world[at + 1], part) };
  }

  /**
   * So many metres farther along the line, backwards where they are negative; a line that is not closed has ends.
   * @param {Spot} spot
   * @param {number} metres
   */
  along({ line, at, part }, metres) {
    const { flat, closed, length: whole } = this.paths[line];
    const last = flat.length / 2 - 2;
    let left = (closed && whole > 0 ? metres % whole : metres) + part * segment(flat, at);
    // Once around is enough, or a closed line without a length would not end.
    for (let steps = 0; steps <= last + 1; steps += 1) {
      const length = segment(flat, at);
      if (left >= 0 && left <= length) return this.spot(line, at, length > 0 ? left / length : 0);
      const next = at + Math.sign(left);
      if (!closed && (next < 0 || next > last)) break;
      if (left > 0) left -= length;
      at = (next + last + 1) % (last + 1);
      if (left < 0) left += segment(flat, at);
    }
    return this.spot(line, at, metres > 0 ? 1 : 0);
  }

  /**
   * The beginning of the next line, or of the one before.
   * @param {Spot} spot
   * @param {number} by
   */
  other({ line }, by) {
    const count = this.paths.length;
    return this.spot((line + by + count) % count, 0, 0);
  }
}

/** The length of a segment, metres. @param {Float64Array} flat @param {number} at */
const segment = (flat, at) => Math.hypot(flat[2 * at + 2] - flat[2 * at], flat[2 * at + 3] - flat[2 * at + 1]);

/**
 * @param {Line} line
 * @returns {Path}
 */
function pathOf(line) {
  const { closed } = line;
  const flat = Float64Array.from(ended(line.flat, closed).flat());
  const count = flat.length / 2 - 1;
  const boxes = new Float64Array(4 * Math.ceil(count / BOX));
  let length = 0;
  for (let k = 0; k < count; k += 1) length += segment(flat, k);
  for (let box = 0; box < boxes.length / 4; box += 1) {
    boxes.set([Infinity, Infinity, -Infinity, -Infinity], 4 * box);
    for (let k = box * BOX; k <= Math.min((box + 1) * BOX, count); k += 1) {
      for (const i of [0, 1]) {
        boxes[4 * box + i] = Math.min(boxes[4 * box + i], flat[2 * k + i]);
        boxes[4 * box + 2 + i] = Math.max(boxes[4 * box + 2 + i], flat[2 * k + i]);
      }
    }
  }
  return { flat, world: ended(line.world, closed), closed, length, boxes };
}

/** An open line begins at its left end, so that the key Right leads to the right. @param {Line} line */
function fromLeft(line) {
  const { closed, flat, world } = line;
  const isTurned = !closed && flat[0][0] > flat[flat.length - 1][0];
  return isTurned ? { ...line, flat: [...flat].reverse(), world: [...world].reverse() } : line;
}

/**
 * The points of a line, the first one again at the end where it is closed.
 * @param {number[][]} points
 * @param {boolean} closed
 */
function ended(points, closed) {
  const [first, last] = [points[0], points[points.length - 1]];
  return closed && first.some((v, i) => v !== last[i]) ? [...points, first] : points;
}
