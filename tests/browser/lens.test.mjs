// The directions that places of photographs see (www/photographs/lens.js), and the net of them that the page draws.

import assert from "node:assert/strict";
import { test } from "node:test";
import { net, ray } from "../../www/photographs/lens.js";
import { projected } from "./projection.mjs";

const pinhole = (size, focal, angle, distortion) => ({
  kind: "pinhole",
  size,
  focal: [focal, focal],
  center: size.map((side) => side / 2 + 3),
  max_angle_degrees: angle,
  distortion,
});
const LENSES = {
  "without distortion": [pinhole([4000, 3000], 2700, 89, { kind: "none", k: [], p: [] }), 1e-3],
  "24 mm": [pinhole([4000, 3000], 2700, 60, { kind: "brown", k: [-0.1, 0.05, 0], p: [0.001, 0.001] }), 0.05],
  "14 mm": [pinhole([4000, 3000], 1600, 54, { kind: "brown", k: [-0.3, 0.12, -0.02], p: [0.002, 0.002] }), 0.25],
  rational: [pinhole([4000, 3000], 2700, 60, { kind: "rational", k: [0.4, 0.1, 0.01, 0.5, 0.2, 0.02], p: [0, 0] }), 0.15],
  fisheye: [pinhole([4000, 4000], 1270, 100, { kind: "fisheye", k: [0.02, -0.005, 0, 0], p: [] }), 0.25],
  panorama: [{ kind: "equirectangular", size: [8192, 4096], max_angle_degrees: 180 }, 0.25],
  cylinder: [{ kind: "cylindrical", size: [8192, 2000], focal: [1303.8, 1303.8], scale: [1303.8, 1303.8], center: [4096, 1000], max_angle_degrees: 180 }, 0.25],
};

const unit = (v) => v.map((c) => c / Math.hypot(...v));
const apart = (a, b) => Math.hypot(...unit(a).map((v, k) => v - unit(b)[k]));

for (const [name, [lens, most]] of Object.entries(LENSES)) {
  const [width, height] = lens.size;
  const perRadian = lens.kind === "pinhole" ? lens.focal[0] : width / (2 * Math.PI);

  test(`${name}: a place of the picture is seen where the direction of its ray is projected`, () => {
    let count = 0;
    for (let y = 0.5; y < height; y += height / 37) {
      for (let x = 0.5; x < width; x += width / 41) {
        const direction = ray(lens, x, y);
        if (!direction) continue;
        count += 1;
        const [u, v] = projected(
          { skew: 0, ...lens, distortion: lens.distortion?.kind === "none" ? { kind: "brown", k: [], p: [] } : lens.distortion },
          direction,
        );
        assert.ok(Math.hypot(u - x, v - y) < 1e-3, `${x} ${y}: ${u} ${v}`);
      }
    }
    assert.ok(count > 900, `${count} places`);
  });

  test(`${name}: between its points, the net is less than ${most} pixels off`, () => {
    const { directions, places, corners } = net(lens);
    assert.ok(corners.length > 10_000 && corners.every((corner) => corner < directions.length / 3));
    let worst = 0;
    for (let k = 0; k < corners.length; k += 3) {
      // The middle of each side of the triangle.
      for (const [i, j] of [
        [0, 1],
        [1, 2],
        [2, 0],
      ]) {
        const [a, b] = [corners[k + i], corners[k + j]];
        const drawn = [0, 1, 2].map((n) => directions[3 * a + n] + directions[3 * b + n]);
        const [x, y] = [0, 1].map((n) => ((places[2 * a + n] + places[2 * b + n]) / 2) * lens.size[n]);
        const seen = ray(lens, x, y);
        if (seen) worst = Math.max(worst, apart(drawn, seen) * perRadian);
      }
    }
    assert.ok(worst < most, `${worst} pixels`);
  });
}

test("what a lens cannot see has no direction", () => {
  const [fisheye] = LENSES.fisheye;
  assert.equal(ray(fisheye, 0, 0), null, "beyond 100 degrees");
  assert.ok(ray(fisheye, 2000, 2000));
  assert.equal(ray({ kind: "equirectangular", size: [360, 180], max_angle_degrees: 180 }, 400, 90), null);
});
