// Where a camera of a colour report sees a direction: the other way round than the page computes it (www/photographs/lens.js).

/** A direction in the axes of a camera to its pixel: the formulas of OpenCV, the other way round than the page uses them. */
export function projected({ kind, size: [width, height], focal, center, skew = 0, distortion }, [x, y, z]) {
  if (kind === "equirectangular")
    return [width / 2 + (Math.atan2(x, z) * width) / (2 * Math.PI), height / 2 + (Math.atan2(y, Math.hypot(x, z)) * height) / Math.PI];
  if (kind === "cylindrical") return [center[0] + focalOf(focal) * Math.atan2(x, z), center[1] + (focalOf(focal) * y) / Math.hypot(x, z)];
  const { kind: model, k, p } = distortion;
  const away = Math.hypot(x, y);
  const fold = model === "fisheye" ? Math.atan2(away, z) / away : 1 / z;
  const [u, v] = [x * fold, y * fold];
  const r2 = u * u + v * v;
  const powers = [1, r2, r2 ** 2, r2 ** 3, r2 ** 4];
  const sum = (coefficients) => coefficients.reduce((total, c, n) => total + c * powers[n + 1], 1);
  const radial = model === "rational" ? sum(k.slice(0, 3)) / sum(k.slice(3)) : sum(k);
  const [p1 = 0, p2 = 0] = p;
  const [a, b] = [u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u), v * radial + p1 * (r2 + 2 * v * v) + 2 * p2 * u * v];
  return [focal[0] * a + skew * b + center[0], focal[1] * b + center[1]];
}
const focalOf = (focal) => focal[0];
