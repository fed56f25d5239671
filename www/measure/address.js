// Measurements in the address: enough to measure them again, to the last bit. One after the other, separated by `!`; the parts of one by `~`:
//
//   tool  points  name  options
//
// Points are local metres (core/measure, space.rs) as little-endian doubles in base64url. Options: `p` plane (point and normal as points),
// `r` reach, `i` interval (metres), `u` uncertainties of pointing (metres, one for each point), `c` colour (six digits), `h` hidden; separated by `.`, which is none of base64url's signs.

import { RECORDED } from "./tools.js";

/** @import { MeasureRecord } from "../types/page.js" */

/** Longer ones are left out of the address; the page offers a file. */
export const LONGEST = 6000;

/** @param {number[]} numbers */
export function pack(numbers) {
  const bytes = new Uint8Array(numbers.length * 8);
  const view = new DataView(bytes.buffer);
  for (const [at, value] of numbers.entries()) view.setFloat64(at * 8, value, true);
  return btoa(String.fromCharCode(...bytes))
    .replaceAll("+", "-")
    .replaceAll("/", "_")
    .replace(/=+$/, "");
}

/**
 * The numbers again; null where they are none, or not finite.
 * @param {string} text
 */
export function unpack(text) {
  if (!/^[\w-]*$/.test(text)) return null;
  let raw;
  try {
    raw = atob(text.replaceAll("-", "+").replaceAll("_", "/"));
  } catch {
    return null;
  }
  if (raw.length % 8 !== 0) return null;
  const view = new DataView(Uint8Array.from(raw, (c) => c.charCodeAt(0)).buffer);
  const numbers = Array.from({ length: raw.length / 8 }, (_, at) => view.getFloat64(at * 8, true));
  return numbers.every(Number.isFinite) ? numbers : null;
}

/** @param {string} name */
const escaped = (name) => encodeURIComponent(name.slice(0, 80)).replaceAll("~", "%7E").replaceAll("!", "%21");

/** @param {(MeasureRecord & {name: string})[]} records measurements as in files (saved.rs) */
export function write(records) {
  const each = records.map(({ tool, local = [], pointing, plane, reach, interval, color, hidden, name }) => {
    const options = [];
    if (plane) options.push(`p${pack([...plane.point, ...plane.normal])}`);
    // Doubles, not decimals: a dot separates options.
    if (reach) options.push(`r${pack([reach])}`);
    if (interval) options.push(`i${pack([interval])}`);
    if (pointing) options.push(`u${pack(pointing)}`);
    if (color) options.push(`c${color.slice(1)}`);
    if (hidden) options.push("h");
    return [tool, pack(/** @type {number[]} */ (local.flat())), escaped(name), ...(options.length > 0 ? [options.join(".")] : [])].join("~");
  });
  return each.join("!");
}

/**
 * The measurements of an address; what is no measurement is left out and counted.
 * @param {string} text
 */
export function read(text) {
  const found = [];
  let left = 0;
  for (const part of text
    .slice(0, 4 * LONGEST)
    .split("!")
    .filter(Boolean)) {
    const one = readOne(part.split("~"));
    if (one) found.push(one);
    else left += 1;
  }
  return { found, left };
}

/** @param {number[]} numbers */
const triples = (numbers) => Array.from({ length: numbers.length / 3 }, (_, at) => numbers.slice(at * 3, at * 3 + 3));

/**
 * @param {string[]} parts
 * @returns {MeasureRecord | null}
 */
function readOne([tool, points, name = "", options = ""]) {
  const numbers = unpack(points ?? "");
  if (!RECORDED.has(tool) || !numbers || numbers.length % 3 !== 0) return null;
  /** @type {MeasureRecord} */
  const one = { tool, local: triples(numbers), name: "", hidden: false, note: "", readings: [] };
  try {
    one.name = decodeURIComponent(name);
  } catch {
    // Cut off: the measurement counts all the same.
  }
  for (const option of options.split(".").filter(Boolean)) {
    const value = option.slice(1);
    const given = ["p", "r", "i", "u"].includes(option[0]) ? unpack(value) : null;
    if (option[0] === "p" && given?.length === 6) one.plane = { point: given.slice(0, 3), normal: given.slice(3) };
    else if (option[0] === "r" && given && given[0] > 0) [one.reach] = given;
    else if (option[0] === "i" && given && given[0] > 0) [one.interval] = given;
    else if (option[0] === "u" && given?.length === one.local?.length && given?.every((u) => u >= 0)) one.pointing = given;
    else if (option[0] === "c" && /^[0-9a-f]{6}$/.test(value)) one.color = `#${value}`;
    else if (option === "h") one.hidden = true;
  }
  return one;
}
