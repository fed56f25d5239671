// The outline of the land for the map of the catalogue: `npm install --no-save world-atlas@2.0.2 topojson-client@3.1.0 topojson-simplify@3.0.3 &&
// node xtask/npm/land.mjs > server/assets/land.txt`.
//
// Source: Natural Earth 1:50m (https://www.naturalearthdata.com, public domain), from npm's world-atlas. Islands too small to see and points
// that move no line are left out (Visvalingam's weights) until what is left is small. One ring a line, in the polyline encoding that maps use:
// differences of latitude and longitude in hundredths of a degree, zigzag, five bits a sign from `?` on.
import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { feature } from "topojson-client";
import { presimplify, simplify } from "topojson-simplify";

const MOST_BYTES = 58_000;
const file = createRequire(import.meta.url).resolve("world-atlas/land-50m.json");
const topology = presimplify(JSON.parse(await readFile(file, "utf8")));

/**
 * The parts of a ring between the meridians of 180 degrees. In the source, what lies on both sides of that line is one ring that jumps from one end
 * of the map to the other, and the ring of Antarctica goes round the pole.
 */
function parts(ring) {
  const open = ring.slice(0, -1);
  let turn = 0;
  const unrolled = open.map(([lon, lat], at) => {
    const step = at > 0 ? lon - open[at - 1][0] : 0;
    if (Math.abs(step) > 180) turn -= Math.sign(step) * 360;
    return [lon + turn, lat];
  });
  const closing = open[0][0] + (Math.abs(open[0][0] - open.at(-1)[0]) > 180 ? turn - Math.sign(open[0][0] - open.at(-1)[0]) * 360 : turn);
  if (Math.abs(closing - unrolled[0][0]) > 180) unrolled.push([closing, open[0][1]], [closing, -90], [unrolled[0][0], -90]);
  return [-360, 0, 360]
    .map((shift) => unrolled.map(([lon, lat]) => [lon + shift, lat]))
    .map((r) =>
      cut(
        cut(r, (v) => v >= -180, -180),
        (v) => v <= 180,
        180,
      ),
    )
    .filter((r) => r.length > 2);
}

/** The part of a ring on one side of a meridian, after Sutherland and Hodgman. */
function cut(ring, isInside, limit) {
  return ring.flatMap((point, at) => {
    const last = ring.at(at - 1);
    const kept = [];
    if (isInside(point[0]) !== isInside(last[0])) kept.push([limit, last[1] + ((point[1] - last[1]) * (limit - last[0])) / (point[0] - last[0])]);
    if (isInside(point[0])) kept.push(point);
    return kept;
  });
}

function encoded(ring) {
  let out = "";
  let last = [0, 0];
  let points = 0;
  for (const [lon, lat] of ring) {
    const at = [Math.round(lat * 100), Math.round(lon * 100)];
    const step = at.map((v, k) => v - last[k]);
    if (points > 0 && step.every((v) => v === 0)) continue;
    for (const v of step) {
      let rest = v < 0 ? ~(v << 1) : v << 1;
      for (; rest >= 32; rest >>= 5) out += String.fromCharCode((32 | (rest & 31)) + 63);
      out += String.fromCharCode(rest + 63);
    }
    last = at;
    points += 1;
  }
  return points > 2 ? out : null;
}

function lines(weight) {
  const land = feature(simplify(topology, weight), topology.objects.land);
  const polygons = (land.features ?? [land]).flatMap(({ geometry: g }) => (g.type === "Polygon" ? [g.coordinates] : g.coordinates));
  return polygons.flat().flatMap(parts).map(encoded).filter(Boolean);
}

let [low, high] = [0, 10];
for (let step = 0; step < 40; step += 1) {
  const middle = (low + high) / 2;
  if (lines(middle).join("\n").length > MOST_BYTES) low = middle;
  else high = middle;
}
console.log(lines(high).join("\n"));
