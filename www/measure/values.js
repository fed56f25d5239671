// Values for people: the digits that `kilwa measure` prints (core/measure, quantity.rs and unit.rs), in the unit that the person chose. What
// is stored are metres and radians, always.

import { isolate, separator } from "../format.js";
import { t } from "../i18n.js";

/** @import { Reading, Uncertainty } from "../types/page.js" */

/** Units of length; one of it is `numerator / denominator` metres, both exact. */
/** @type {Record<string, [numerator: number, denominator: number]>} */
const METRES = { m: [1, 1], cm: [1, 100], mm: [1, 1000], km: [1000, 1], ft: [3048, 10_000], "us-ft": [1200, 3937], in: [254, 10_000] };
export const UNITS = Object.keys(METRES);
const DEGREES = 57.29577951308232;
/** @type {Record<string, number>} */
const POWERS = { length: 1, area: 2, volume: 3 };

/** What a reading is called. @type {Record<string, string>} */
const NAMES = {
  straight: "rStraight",
  horizontal: "rHorizontal",
  vertical: "rVertical",
  ends: "rEnds",
  perimeter: "rPerimeter",
  "along the surface": "rAlong",
  angle: "rAngle",
  "first slope": "rSlope1",
  "second slope": "rSlope2",
  height: "rHeight",
  "fitted plane": "rFitted",
  plan: "rPlan",
  "out of plane": "rOut",
  surface: "rSurface",
  radius: "rRadius",
  diameter: "rDiameter",
  circumference: "rCircumference",
  residual: "rResidual",
  volume: "rVolume",
  cut: "rCut",
  fill: "rFill",
  net: "rNet",
  base: "rBase",
  "above the plane": "rAbove",
  "below the plane": "rBelow",
  length: "rLength",
  "area of the material": "rMaterial",
  "way in plan": "rWay",
  "length on the surface": "rOnSurface",
  lowest: "rLowest",
  highest: "rHighest",
  "length of all": "rAll",
  mean: "rMean",
  "root mean square": "rRms",
  "standard deviation": "rDeviation",
  area: "rArea",
};

/** @param {string} name */
export const readingName = (name) => (NAMES[name] ? t(NAMES[name]) : name);

/**
 * Exactly so many decimals, ties to even, as Rust prints them; JavaScript alone would round ties away from zero.
 * @param {number} value
 * @param {number} digits
 */
export function fixed(value, digits) {
  if (Object.is(value, -0)) return `-${(0).toFixed(digits)}`;
  const near = value.toFixed(digits);
  const exact = Math.abs(value) < 1e21 ? value.toFixed(100) : near;
  const rest = exact.slice(exact.indexOf(".") + 1 + digits);
  if (!/^50*$/.test(rest)) return near;
  const whole = exact.slice(0, exact.length - rest.length).replace(/\.$/, "");
  return /[02468]$/.test(whole) ? whole : near;
}

/** @param {number} uncertainty */
const decimals = (uncertainty) => (uncertainty > 0 ? Math.min(12, Math.max(0, 1 - Math.floor(Math.log10(uncertainty)))) : 6);

/**
 * Decimals that the spacing of the mesh supports; all where the accuracy of the survey is known.
 * @param {number | undefined} resolution
 */
const supported = (resolution) => (resolution ? Math.min(12, Math.max(0, -Math.floor(Math.log10(resolution)))) : 12);

/**
 * A stored reading in a unit: value, uncertainty, symbol, and the decimals of both.
 * @param {{value: number, uncertainty: number, dimension: string, resolution?: number}} reading
 * @param {string} unit
 */
export function shown(reading, unit) {
  const { resolution = 0, ...rest } = reading;
  const one = inUnit(rest, unit);
  const own = one.uncertainty === 0 ? 6 : decimals(one.uncertainty);
  return { ...one, own, digits: Math.min(own, supported(inUnit({ ...rest, value: resolution }, unit).value)) };
}

/**
 * @param {{value: number, uncertainty: number, dimension: string}} reading
 * @param {string} unit
 */
function inUnit({ value, uncertainty, dimension }, unit) {
  if (dimension === "angle") return { value: value * DEGREES, uncertainty: uncertainty * DEGREES, symbol: "°" };
  if (dimension === "ratio") return { value: value * 100, uncertainty: uncertainty * 100, symbol: "%" };
  const [numerator, denominator] = METRES[unit];
  const power = POWERS[dimension] ?? 1;
  const each = (/** @type {number} */ x) => {
    for (let k = 0; k < power; k += 1) x = (x * denominator) / numerator;
    return x;
  };
  const raised = ["", "", "²", "³"][power];
  const symbol = `${unit}${raised}`;
  return { value: each(value), uncertainty: each(uncertainty), symbol };
}

/**
 * As `kilwa measure` prints it.
 * @param {Reading} reading
 * @param {string} unit
 */
export function text(reading, unit) {
  const { value, uncertainty, symbol, own, digits } = shown(reading, unit);
  if (uncertainty === 0) return `${fixed(value, 6)} ${symbol}`;
  if (reading.resolution) return `${fixed(value, digits)} ${symbol} (± ${fixed(uncertainty, own)} ${symbol})`;
  return `${fixed(value, digits)} ± ${fixed(uncertainty, digits)} ${symbol}`;
}

/** @param {string} digits */
const local = (digits) => digits.replace(".", separator()).replace("-", "−");

/** How many metres a unit is. @param {string} unit */
export const metresIn = (unit) => METRES[unit][0] / METRES[unit][1];

/**
 * A coordinate in a unit, without the unit's name, as far as the first digit of `finest`; both in metres. So the spacing of a mesh limits digits elsewhere too.
 * @param {number} value
 * @param {string} unit
 * @param {number} finest
 */
export function coordinate(value, unit, finest) {
  const length = { uncertainty: 0, dimension: "length" };
  const step = inUnit({ ...length, value: finest }, unit).value;
  const digits = step > 0 ? Math.min(6, Math.max(0, Math.ceil(-Math.log10(step) - 1e-9))) : 6;
  const text = fixed(inUnit({ ...length, value }, unit).value, digits);
  return isolate(local(Number(text) === 0 ? text.replace("-", "") : text));
}

/**
 * The same digits to be read at a glance: an uncertainty below a centimetre in millimetres.
 * @param {Reading} reading
 * @param {string} unit
 */
export function short(reading, unit) {
  const { value, uncertainty, symbol, digits } = shown(reading, unit);
  const number = local(fixed(value, digits));
  const spread = `± ${spreadOf(reading, unit)}`;
  if (uncertainty === 0) return isolate(`${number} ${symbol}`);
  if (reading.resolution) return isolate(`${number} ${symbol} (${spread})`);
  return isolate(isInMillimetres(reading, unit) ? `${number} ${symbol} ${spread}` : `${number} ${spread}`);
}

/**
 * @param {Reading} reading
 * @param {string} unit
 */
function spreadOf(reading, unit) {
  const { uncertainty, symbol, own } = shown(reading, unit);
  const mm = reading.uncertainty * 1000;
  if (isInMillimetres(reading, unit)) return `${local(fixed(mm, decimals(mm)))} mm`;
  return `${local(fixed(uncertainty, own))}${symbol === "°" ? "" : " "}${symbol}`;
}

/**
 * @param {Reading} reading
 * @param {string} unit
 */
const isInMillimetres = (reading, unit) => dimensionIsLength(reading) && ["m", "cm", "km"].includes(unit) && reading.uncertainty < 0.01;

/** @param {Reading} reading */
const dimensionIsLength = ({ dimension }) => dimension === "length";

/**
 * A value that is not final: a length that lies within `half` of `value`, both in metres.
 * @param {number} value
 * @param {number} half
 * @param {string} unit
 */
export function about(value, half, unit) {
  const { value: v, uncertainty: u, symbol } = shown({ value, uncertainty: half, dimension: "length" }, unit);
  const digits = u > 0 ? Math.min(9, Math.max(0, -Math.floor(Math.log10(u)))) : 3;
  const metric = ["m", "cm", "km"].includes(unit) && half < 1;
  const [spread, name] = metric ? (half < 0.1 ? [half * 1000, "mm"] : [half * 100, "cm"]) : [u, symbol];
  const one = spread > 0 ? Math.min(9, Math.max(0, -Math.floor(Math.log10(spread)))) : 0;
  return isolate(`≈ ${local(v.toFixed(digits))} ${symbol} ± ${local(spread.toFixed(one))} ${name}`);
}

/** Readings that represent a measurement where only few fit. @type {Record<string, string[]>} */
const MAIN = {
  coordinate: ["x", "y", "z"],
  distance: ["straight"],
  perimeter: ["perimeter"],
  along: ["along the surface"],
  angle: ["angle"],
  "plane-angle": ["angle"],
  height: ["height"],
  circle: ["diameter"],
  area: ["surface", "fitted plane", "plan"],
  volume: ["volume"],
  "cut-fill": ["cut", "fill", "net", "above the plane", "below the plane"],
  section: ["length", "area of the material"],
  profile: ["length on the surface"],
  contours: ["length of all"],
  deviation: ["root mean square", "lowest", "highest"],
};

/**
 * @param {string} tool
 * @param {Reading[]} readings
 */
export function mainReadings(tool, readings) {
  const found = (MAIN[tool] ?? []).flatMap((name) => readings.find((r) => r.name === name) ?? []);
  return found.length > 0 ? found : readings.slice(0, 1);
}

/**
 * The lines of a label. Where all of them are equally uncertain, the uncertainty has a line of its own. The last one says what the uncertainty lacks.
 * @param {string} tool
 * @param {Reading[]} readings
 * @param {string} unit
 * @param {Uncertainty | null} [of] what the uncertainty of a coordinate is made of
 */
export function mainLines(tool, readings, unit, of = null) {
  const found = mainReadings(tool, readings);
  const lacking = found.some((r) => r.resolution) ? [t(of?.pointing ? "gridPointingOnly" : "gridOnly")] : [];
  if (found.length === 1) return [short(found[0], unit), ...lacking];
  const [first] = found;
  const alike = found.length > 2 && found.every((r) => r.uncertainty === first.uncertainty && r.dimension === first.dimension);
  if (!alike) return [...found.map((r) => `${readingName(r.name)} ${short(r, unit)}`), ...lacking];
  const each = found.map((r) => {
    const { value, symbol, digits } = shown(r, unit);
    return `${readingName(r.name)} ${isolate(`${local(fixed(value, digits))} ${symbol}`)}`;
  });
  return [...each, isolate(`± ${spreadOf(first, unit)}`), ...lacking];
}
