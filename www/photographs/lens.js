// Which direction a place of a photograph sees: the cameras of colour reports, as core/scan/src/camera describes them. Axes of a camera: x right, y down,
// z forward. Pixels: x right, y down; (0, 0) is the corner of the first one.

/**
 * A camera of a colour report (archive/src/colour_report.rs).
 * @typedef {object} Lens
 * @property {"pinhole" | "equirectangular" | "cylindrical"} kind
 * @property {[number, number]} size pixels
 * @property {[number, number]} [focal] pixels
 * @property {[number, number]} [center] pixels
 * @property {number} [skew] pixels
 * @property {[number, number]} [scale] pixels per radian of a panorama
 * @property {{kind: string, k: number[], p: number[]}} [distortion]
 * @property {number} max_angle_degrees largest angle from the axis at which the distortion is valid
 */
/** @typedef {[number, number, number]} Direction */

/** Steps of Newton's method; where it does not converge, nothing is seen. */
const STEPS = 25;
/** Largest difference of what it finds, at distance 1 from the camera. */
const ENOUGH = 1e-9;

/**
 * Where the lens bends a ray, and the derivative, which is symmetric (Brown; OpenCV's rational and fisheye models).
 * @param {number} x
 * @param {number} y
 * @param {{kind: string, k: number[], p: number[]}} distortion
 */
function bent(x, y, { kind, k, p }) {
  const [k1 = 0, k2 = 0, k3 = 0, k4 = 0, k5 = 0, k6 = 0] = k;
  const [p1 = 0, p2 = 0] = p;
  const r2 = x * x + y * y;
  let radial = 1 + r2 * (k1 + r2 * (k2 + r2 * (k3 + r2 * k4)));
  let slope = k1 + r2 * (2 * k2 + r2 * (3 * k3 + r2 * 4 * k4));
  if (kind === "rational") {
    const [above, below] = [1 + r2 * (k1 + r2 * (k2 + r2 * k3)), 1 + r2 * (k4 + r2 * (k5 + r2 * k6))];
    const [dAbove, dBelow] = [k1 + r2 * (2 * k2 + r2 * 3 * k3), k4 + r2 * (2 * k5 + r2 * 3 * k6)];
    radial = above / below;
    slope = (dAbove * below - above * dBelow) / (below * below);
  }
  return {
    x: x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
    y: y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    xx: radial + 2 * (x * x * slope + p1 * y + 3 * p2 * x),
    xy: 2 * (x * y * slope + p1 * x + p2 * y),
    yy: radial + 2 * (y * y * slope + 3 * p1 * y + p2 * x),
  };
}

/**
 * What the lens bends to (x, y); null beyond `limit`, where it is not one-to-one.
 * @param {number} x
 * @param {number} y
 * @param {{kind: string, k: number[], p: number[]}} distortion
 * @param {number} limit
 */
function straight(x, y, distortion, limit) {
  const within = (/** @type {number} */ a, /** @type {number} */ b) => {
    const far = Math.max(1, Math.hypot(a, b) / limit);
    return [a / far, b / far];
  };
  let [u, v] = within(x, y);
  let at = bent(u, v, distortion);
  for (let step = 0; step < STEPS; step += 1) {
    const [dx, dy] = [x - at.x, y - at.y];
    const left = Math.hypot(dx, dy);
    if (left < ENOUGH) return [u, v];
    const determinant = at.xx * at.yy - at.xy * at.xy;
    const [du, dv] = [(at.yy * dx - at.xy * dy) / determinant, (at.xx * dy - at.xy * dx) / determinant];
    // A shorter step where a whole one would lead away from the solution.
    for (let part = 1; part > 1e-3; part /= 2) {
      const next = within(u + part * du, v + part * dv);
      const then = bent(next[0], next[1], distortion);
      if (!(Math.hypot(x - then.x, y - then.y) < left)) continue;
      [[u, v], at] = [next, then];
      break;
    }
  }
  return null;
}

/**
 * The direction that a place of a photograph sees, in the axes of its camera and of any length; null where it sees nothing. Between two places of a lens without
 * distortion, directions lie on a straight line.
 * @param {Lens} lens
 * @param {number} x
 * @param {number} y
 * @returns {Direction | null}
 */
export function ray({ kind, focal, center, skew = 0, scale, distortion, max_angle_degrees: widest, size }, x, y) {
  const [cx, cy] = center ?? [size[0] / 2, size[1] / 2];
  if (kind !== "pinhole") {
    const [sx, sy] = scale ?? [size[0] / (2 * Math.PI), size[1] / Math.PI];
    const [longitude, height] = [(x - cx) / sx, (y - cy) / sy];
    if (Math.abs(longitude) > Math.PI + 1e-9) return null;
    const [sine, cosine] = [Math.sin(longitude), Math.cos(longitude)];
    if (kind === "cylindrical") return [sine, height, cosine];
    if (Math.abs(height) > Math.PI / 2 + 1e-9) return null;
    const level = Math.cos(height);
    return [level * sine, Math.sin(height), level * cosine];
  }
  const [fx, fy] = focal ?? [1, 1];
  const v = (y - cy) / fy;
  const u = (x - cx - skew * v) / fx;
  if (!distortion || distortion.kind === "none") return [u, v, 1];
  const isFisheye = distortion.kind === "fisheye";
  const angle = (widest * Math.PI) / 180;
  const found = straight(u, v, distortion, isFisheye ? angle : Math.tan(angle));
  if (!found) return null;
  const [a, b] = found;
  if (!isFisheye) return [a, b, 1];
  const away = Math.hypot(a, b);
  const sine = away > 0 ? Math.sin(away) / away : 1;
  return [a * sine, b * sine, Math.cos(away)];
}

/**
 * The directions that the border of a photograph sees, from the upper left corner clockwise.
 * @param {Lens} lens
 * @param {number} sides parts of each side
 */
export function border(lens, sides) {
  const [width, height] = lens.size;
  const along = Array.from({ length: sides }, (_, k) => k / sides);
  const places = [
    ...along.map((s) => [s * width, 0]),
    ...along.map((s) => [width, s * height]),
    ...along.map((s) => [(1 - s) * width, height]),
    ...along.map((s) => [0, (1 - s) * height]),
  ];
  return places.map(([x, y]) => ray(lens, x, y));
}

/**
 * A photograph as a net of triangles round its camera: directions in the camera's axes, places in the picture (0 to 1, y down), and corners of triangles.
 * Between its points it is drawn straight, which shifts pixels by a fraction of their size (docs/decisions/0087-photographs-over-the-model.md).
 * @param {Lens} lens
 */
export function net(lens) {
  const [columns, rows] = lens.kind === "pinhole" ? [128, 96] : [256, 128];
  const [width, height] = lens.size;
  const directions = new Float32Array(3 * (columns + 1) * (rows + 1));
  const places = new Float32Array(2 * (columns + 1) * (rows + 1));
  /** @type {boolean[]} */
  const isSeen = [];
  for (let row = 0; row <= rows; row += 1) {
    for (let column = 0; column <= columns; column += 1) {
      const at = isSeen.length;
      const seen = ray(lens, (column / columns) * width, (row / rows) * height);
      isSeen.push(seen !== null);
      directions.set(seen ?? [0, 0, 0], 3 * at);
      places.set([column / columns, row / rows], 2 * at);
    }
  }
  /** @type {number[]} */
  const corners = [];
  for (let row = 0; row < rows; row += 1) {
    for (let column = 0; column < columns; column += 1) {
      const a = row * (columns + 1) + column;
      const cell = [a, a + 1, a + columns + 1, a + columns + 2];
      if (cell.every((k) => isSeen[k])) corners.push(cell[0], cell[1], cell[2], cell[1], cell[3], cell[2]);
    }
  }
  return { directions, places, corners: new Uint16Array(corners) };
}
