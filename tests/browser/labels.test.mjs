// Labels of measurements: none lies on another, on the page's controls or outside of the picture, whatever is measured.

import assert from "node:assert/strict";
import { test } from "node:test";
import { SMALL, arrange } from "../../www/measure/labels.js";

const PHONE = {
  room: [4, 4, 386, 640],
  taken: [
    [290, 10, 380, 100],
    [14, 590, 376, 640],
  ],
  rings: 1,
};
const DESK = {
  room: [4, 4, 1076, 826],
  taken: [
    [12, 10, 56, 420],
    [970, 716, 1070, 816],
  ],
  rings: 4,
};

function random(seed) {
  let s = seed;
  return () => {
    s = (Math.imul(s, 1103515245) + 12345) & 0x7fffffff;
    return s / 0x7fffffff;
  };
}

/** So many labels of one to four lines somewhere in the picture. */
function some(count, { room }, seed) {
  const next = random(seed);
  return Array.from({ length: count }, (_, k) => ({
    id: String(k),
    at: [room[0] + next() * (room[2] - room[0]), room[1] + next() * (room[3] - room[1])],
    dots: Array.from({ length: 2 }, () => [next() * room[2], next() * room[3]]),
    size: [80 + next() * 150, 24 + 18 * Math.floor(next() * 4)],
  }));
}

const boxes = (wanted, spots) =>
  wanted.flatMap(({ id, size }) => {
    const spot = spots.get(id);
    const [w, h] = spot?.isSmall ? SMALL : size;
    return spot ? [[spot.left, spot.top, spot.left + w, spot.top + h]] : [];
  });
const meet = (a, b) => a[0] < b[2] && b[0] < a[2] && a[1] < b[3] && b[1] < a[3];

test("no label lies on another, on what is over the picture, or outside of it, and a line ends at its label", () => {
  for (const where of [PHONE, DESK]) {
    for (const count of [1, 5, 20, 200]) {
      for (let seed = 1; seed <= 20; seed += 1) {
        const wanted = some(count, where, seed * 7919);
        const spots = arrange(wanted, where);
        const all = boxes(wanted, spots);
        for (const [i, a] of all.entries()) {
          assert.ok(a[0] >= where.room[0] && a[1] >= where.room[1] && a[2] <= where.room[2] && a[3] <= where.room[3], `${a}`);
          assert.ok(![...where.taken, ...all.slice(i + 1)].some((b) => meet(a, b)), `${count} labels, seed ${seed}`);
        }
        for (const { id, size } of wanted) {
          const spot = spots.get(id);
          if (!spot?.line) continue;
          const [w, h] = spot.isSmall ? SMALL : size;
          assert.ok(spot.line[0] >= spot.left && spot.line[0] <= spot.left + w && spot.line[1] >= spot.top && spot.line[1] <= spot.top + h);
        }
      }
    }
  }
});

test("the most important label is always shown in full; if there are few labels, almost all are", () => {
  let [full, all] = [0, 0];
  for (let seed = 1; seed <= 40; seed += 1) {
    for (const [count, where] of [
      [20, PHONE],
      [20, DESK],
      [5, DESK],
    ]) {
      const wanted = some(count, where, seed * 104729).filter(({ at }) => !where.taken.some((b) => meet([...at, ...at], b)));
      const spots = arrange(wanted, where);
      assert.ok(spots.get(wanted[0].id) && !spots.get(wanted[0].id).isSmall, `seed ${seed}`);
      if (count > 5) continue;
      all += wanted.length;
      full += wanted.filter(({ id }) => spots.get(id) && !spots.get(id).isSmall).length;
    }
  }
  assert.ok(full > 0.99 * all, `${full} of ${all}`);
});

test("labels stay where they are while nothing moves, and on their side when the camera moves a little", () => {
  let [same, all] = [0, 0];
  for (let seed = 1; seed <= 20; seed += 1) {
    const wanted = some(12, DESK, seed * 31337);
    const first = arrange(wanted, DESK);
    const held = wanted.map((w) => ({ ...w, before: first.get(w.id)?.choice }));
    assert.deepEqual([...arrange(held, DESK)], [...first], `seed ${seed}`);
    const moved = held.map((w) => ({ ...w, at: [w.at[0] + 1.5, w.at[1] - 1], dots: w.dots.map(([x, y]) => [x + 1.5, y - 1]) }));
    const second = arrange(moved, DESK);
    for (const { id } of wanted) {
      all += 1;
      same += second.get(id)?.choice === first.get(id)?.choice ? 1 : 0;
    }
  }
  assert.ok(same > 0.95 * all, `${same} of ${all} stayed`);
});
