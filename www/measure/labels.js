// Places the labels of measurements, so that none lies on another or under the page's own controls: each near its place where there is room, farther away with a
// line to it where there is none, and as a small sign (a press opens it) where even that does not go. Those that matter more choose first. A label
// stays where it was as long as it can, so that nothing jumps while the camera moves. Pixels are CSS pixels from the canvas's corner.

/** Between a place and its label. */
const GAP = 12;
/** Between labels. */
const AIR = 4;
/** A label that does not fit. */
export const SMALL = [28, 22];
/** Half of the size of the area around other measurements' places that a label should not cover. */
const DOT = 7;

/**
 * Left upper corners for a label, the best first.
 * @param {number[]} at
 * @param {number[]} size
 * @param {number} rings
 */
function* candidates([x, y], [w, h], rings) {
  const side = [-w / 2, -w - GAP, GAP];
  yield [x - w / 2, y - GAP - h];
  yield [x - w / 2, y + GAP];
  yield [x + GAP, y - h / 2];
  yield [x - GAP - w, y - h / 2];
  for (let ring = 0; ring <= rings; ring += 1) {
    const by = ring * (h * 0.6 + AIR);
    for (const dx of side) {
      yield [x + dx, y - GAP - h - by];
      yield [x + dx, y + GAP + by];
    }
    for (const more of [w * 0.5, w]) {
      for (const dx of [-w / 2 - more, -w / 2 + more]) {
        yield [x + dx, y - GAP - h - by];
        yield [x + dx, y + GAP + by];
      }
    }
  }
}

/**
 * Whether two boxes come nearer than `air`.
 * @param {number[]} a
 * @param {number[]} b
 * @param {number} air
 */
const meet = (a, b, air) => a[0] < b[2] + air && b[0] < a[2] + air && a[1] < b[3] + air && b[1] < a[3] + air;

/**
 * A label that would stick out at a side is moved in, as long as it stays beside its place.
 * @param {number[]} corner
 * @param {number[]} size
 * @param {number[]} room
 */
function inside([left, top], [w, h], [low, high, right, bottom]) {
  return [Math.min(Math.max(left, low), right - w), Math.min(Math.max(top, high), bottom - h)];
}

/**
 * @param {{id: string, at: number[], size: number[], dots?: number[][], before?: number}[]} wanted those that matter most first; `before` is the `choice` of the last time
 * @param {{room: number[], taken: number[][], rings: number}} where boxes are left, top, right, bottom; `rings`: how far away a label may go
 * @returns {Map<string, {left: number, top: number, isSmall: boolean, choice: number, line: number[] | null}>} what has no entry has no room at all; `line` is
 *   where a line from the place meets the label
 */
export function arrange(wanted, { room, taken, rings }) {
  const boxes = [...taken];
  const dots = wanted.flatMap(({ id, at, dots = [] }) => [at, ...dots].map(([x, y]) => ({ id, box: [x - DOT, y - DOT, x + DOT, y + DOT] })));
  const out = new Map();
  for (const { id, at, size, before = -1 } of wanted) {
    const fits = (/** @type {number[]} */ corner, /** @type {number[]} */ [w, h], /** @type {boolean} */ isKind) => {
      const [left, top] = inside(corner, [w, h], room);
      const box = [left, top, left + w, top + h];
      if (w > room[2] - room[0] || boxes.some((other) => meet(box, other, AIR))) return null;
      // The place itself stays free, also where the label was moved in from the side.
      if (meet(box, [at[0] - 3, at[1] - 3, at[0] + 3, at[1] + 3], 0)) return null;
      if (isKind && dots.some((dot) => dot.id !== id && meet(box, dot.box, 0))) return null;
      return box;
    };
    const all = [...candidates(at, size, rings)].map((corner, choice) => ({ corner, choice }));
    const order = before >= 0 && all[before] ? [all[before], ...all] : all;
    const near = [...candidates(at, SMALL, 0)].map((corner) => ({ corner, choice: -1 }));
    /** @type {[list: {corner: number[], choice: number}[], extent: number[], isKind: boolean][]} */
    const tries = [
      [order, size, true],
      [order, size, false],
      [near, SMALL, false],
    ];
    /** @type {{box: number[], choice: number, isSmall: boolean} | null} */
    let found = null;
    for (const [list, extent, isKind] of tries) {
      for (const { corner, choice } of list) {
        const box = fits(corner, extent, isKind);
        if (box) found = { box, choice, isSmall: extent === SMALL };
        if (box) break;
      }
      if (found) break;
    }
    if (!found) continue;
    const { box, choice, isSmall } = found;
    boxes.push(box);
    const end = [Math.min(Math.max(at[0], box[0]), box[2]), Math.min(Math.max(at[1], box[1]), box[3])];
    const isFar = Math.hypot(end[0] - at[0], end[1] - at[1]) > GAP + 4;
    out.set(id, { left: box[0], top: box[1], isSmall, choice, line: isFar ? end : null });
  }
  return out;
}
