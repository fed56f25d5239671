// The lines of a drawing, and the paper it is saved on: what the cursor finds is on a line, and the drawing stays true to scale on a sheet.

import assert from "node:assert/strict";
import { test } from "node:test";
import { Linework } from "../../www/measure/linework.js";
import { PAPERS, nameOf, onSheet, sheetOf, sizeIn } from "../../www/measure/paper.js";

/** Upright lines: a closed square of 10 m and an open one, far from the origin. */
const FAR = [372_000, 9_011_000, 40];
const upright = (flat, closed) => ({
  closed,
  flat: flat.map(([x, y]) => [x, FAR[2] + y]),
  world: flat.map(([x, y]) => [FAR[0] + x * 0.6, FAR[1] + x * 0.8, FAR[2] + y]),
});
const SQUARE = upright(
  [
    [0, 0],
    [10, 0],
    [10, 10],
    [0, 10],
  ],
  true,
);
const ZIGZAG = upright(
  [
    [20, 0],
    [23, 4],
    [26, 0],
  ],
  false,
);
const near = (a, b, within = 1e-9) => assert.ok(Math.hypot(...a.map((v, i) => v - b[i])) <= within, `${a} is not ${b}`);

test("the nearest place is on a line, in the drawing and in the world, and nothing is found far from all lines", () => {
  const work = new Linework([SQUARE, ZIGZAG]);
  const right = work.nearest([9, 45], 2);
  near(right.flat, [10, 45]);
  near(right.world, [FAR[0] + 6, FAR[1] + 8, 45]);
  // Its last side joins the last point to the first.
  near(work.nearest([0.5, 45], 1).flat, [0, 45]);
  assert.equal(work.nearest([5, 45], 2), null);
  // Against places all along the lines, 10 mm apart.
  const dense = [SQUARE, ZIGZAG].flatMap(({ flat, closed }) =>
    flat.slice(closed ? 0 : 1).flatMap((point, k) => {
      const before = flat[closed ? (k + flat.length - 1) % flat.length : k];
      return Array.from({ length: 1001 }, (_, i) => point.map((v, axis) => before[axis] + ((v - before[axis]) * i) / 1000));
    }),
  );
  const distance = ([x, y], [u, v]) => Math.hypot(x - u, y - v);
  for (let k = 0; k < 60; k += 1) {
    const place = [((k * 37) % 300) / 10 - 1, 39 + ((k * 53) % 120) / 10];
    const { flat } = work.nearest(place, 100);
    const least = Math.min(...dense.map((point) => distance(point, place)));
    assert.ok(Math.abs(distance(flat, place) - least) < 0.01, `${place}: ${distance(flat, place)} instead of ${least}`);
    assert.ok(Math.min(...dense.map((point) => distance(point, flat))) < 0.01, `${flat} is on a line`);
  }
  // More segments than share a box.
  const round = Array.from({ length: 3000 }, (_, k) => [Math.cos((k * Math.PI) / 1500), Math.sin((k * Math.PI) / 1500)]);
  const circle = new Linework([{ closed: true, flat: round, world: round.map(([x, y]) => [x, 0, y]) }]);
  for (let k = 0; k < 100; k += 1) {
    const [x, y] = [Math.cos(k), Math.sin(k)];
    near(circle.nearest([1.5 * x, 1.5 * y], 1).flat, [x, y], 1e-3);
  }
});

test("a closed line is walked around and around, an open one from end to end, in both directions", () => {
  const work = new Linework([SQUARE, ZIGZAG]);
  let spot = work.spot(0, 0, 0);
  for (let k = 0; k < 16; k += 1) spot = work.along(spot, 2.5);
  near(spot.flat, [0, 40]);
  near(work.along(work.spot(0, 0, 0), 13).flat, [10, 43]);
  near(work.along(work.spot(0, 0, 0), -13).flat, [3, 50]);
  const end = work.along(work.spot(1, 0, 0.2), 100);
  near(end.flat, [26, 40]);
  near(end.world, ZIGZAG.world[2]);
  near(work.along(end, -7.5).flat, work.along(work.spot(1, 0, 0), 2.5).flat);
  near(work.along(end, -100).flat, [20, 40]);
  // Many times around a short ring, as with Shift and an arrow on a small contour.
  near(work.along(work.spot(0, 0, 0), 413).flat, [10, 43]);
  near(work.along(work.spot(0, 0, 0.2), -402).flat, [0, 40]);
  assert.equal(work.other(end, 1).line, 0);
  assert.equal(work.other(work.spot(0, 2, 0.5), -1).line, 1);
  // An open line begins at its left end.
  const turned = new Linework([{ closed: false, flat: [...ZIGZAG.flat].reverse(), world: [...ZIGZAG.world].reverse() }]);
  near(turned.along(turned.spot(0, 0, 0), 2.5).world, work.along(work.spot(1, 0, 0), 2.5).world);
  // Points that lie on each other have no length to walk.
  const still = new Linework([
    {
      closed: true,
      flat: [
        [1, 1],
        [1, 1],
      ],
      world: [
        [1, 1, 1],
        [1, 1, 1],
      ],
    },
  ]);
  near(still.along(still.spot(0, 0, 0), 1).flat, [1, 1]);
});

test("what the axes of a drawing are follows from its lines", () => {
  assert.equal(new Linework([SQUARE]).axes, "upright");
  const plan = { closed: false, flat: [FAR.slice(0, 2), [FAR[0] + 5, FAR[1]]], world: [FAR, [FAR[0] + 5, FAR[1], 40]] };
  assert.equal(new Linework([plan]).axes, "plan");
  assert.equal(
    new Linework([
      {
        ...plan,
        flat: [
          [0, 0],
          [5, 0],
        ],
      },
    ]).axes,
    "oblique",
  );
  assert.deepEqual(new Linework([SQUARE, ZIGZAG]).size, [26, 10]);
});

test("a drawing gets the smallest sheet that holds it, turned as it needs; one that is too large for the chosen sheet is reported", () => {
  assert.deepEqual(sheetOf([250, 200], "auto").on, [297, 210]);
  assert.deepEqual(sheetOf([200, 250], "auto").on, [210, 297]);
  assert.equal(nameOf(sheetOf([298, 100], "auto").on), "A3");
  assert.deepEqual(sheetOf([250, 200], "A1").on, [841, 594]);
  assert.deepEqual(sheetOf([600, 200], "A3"), { on: null, isTooLarge: true });
  assert.deepEqual(sheetOf([600, 200], "fit"), { on: null, isTooLarge: false });
  assert.ok(sheetOf([2000, 2000], "auto").isTooLarge);
  for (const [name, [w, h]] of PAPERS) assert.equal(nameOf(sheetOf([w, h], "auto").on), name);
});

test("on a sheet, a drawing keeps its millimetres and lies in the middle", () => {
  const svg = `<?xml version="1.0" encoding="UTF-8"?>\n<svg xmlns="http://www.w3.org/2000/svg" width="200.5mm" height="100mm" viewBox="0 0 200.5 100">\n<title>A &lt;svg width="1mm"&gt; $1</title>\n<rect width="100%" height="100%" fill="#fff"/>\n<g><polyline points="1,2 3,4"/></g>\n</svg>\n`;
  assert.deepEqual(sizeIn(svg), [200.5, 100]);
  const on = onSheet(svg, [297, 210]);
  assert.match(
    on,
    /<svg [^>]*width="297mm" height="210mm" viewBox="0 0 297 210">\n<title>A &lt;svg width="1mm"&gt; \$1<\/title>\n<rect width="100%" height="100%" fill="#fff"\/>\n<g transform="translate\(48.25 55\)">/,
  );
  assert.ok(on.includes('<g><polyline points="1,2 3,4"/></g>\n</g>\n</svg>'));
  assert.throws(() => sizeIn("<svg>"), /no size/);
  assert.equal(on.match(/<g[ >]/g).length, on.match(/<\/g>/g).length);
});
