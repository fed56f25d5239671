// Numbers for people, in the language of the page. Digits stay those of the coordinates (0 to 9) in every language.

const ENGLISH = "en-u-nu-latn";
let locale = ENGLISH;
let isolates = false;

/**
 * @param {string} language
 * @param {boolean} rightToLeft
 */
export function setLocale(language, rightToLeft = false) {
  locale = `${language}-u-nu-latn`;
  isolates = rightToLeft;
}

/**
 * A figure with its unit keeps its order inside text from right to left.
 * @param {string} text
 */
export const isolate = (text) => (isolates ? `\u2066${text}\u2069` : text);

/** The decimal separator. */
export const separator = () => new Intl.NumberFormat(locale).formatToParts(0.5).find((p) => p.type === "decimal")?.value ?? ".";

/**
 * @param {number} value
 * @param {number} digits
 */
const fixed = (value, digits) => new Intl.NumberFormat(locale, { minimumFractionDigits: digits, maximumFractionDigits: digits }).format(value);

/**
 * @param {number} value
 * @param {string} name
 * @param {number} digits
 */
const unit = (value, name, digits) =>
  new Intl.NumberFormat(locale, {
    style: "unit",
    unit: name,
    unitDisplay: "short",
    minimumFractionDigits: digits,
    maximumFractionDigits: digits,
  }).format(value);

/**
 * A day as the language says it: 24 November 2026. What is no day stays as it is.
 * @param {string} iso
 */
export function day(iso) {
  const date = /^\d{4}-\d\d-\d\d$/.test(iso) ? new Date(`${iso}T00:00:00Z`) : null;
  if (!date || Number.isNaN(date.getTime())) return iso;
  const words = new Intl.DateTimeFormat(locale === ENGLISH ? "en-GB" : locale, { dateStyle: "long", timeZone: "UTC" });
  return words.format(date);
}

/** @param {number} n */
export const count = (n) => new Intl.NumberFormat(locale).format(n);

/** @param {number} n */
export function bytes(n) {
  if (n < 1e3) return unit(n, "byte", 0);
  if (n < 1e6) return unit(n / 1e3, "kilobyte", 0);
  if (n < 1e9) return unit(n / 1e6, "megabyte", n < 1e8 ? 1 : 0);
  return unit(n / 1e9, "gigabyte", 2);
}

/**
 * Factor, unit and decimals that leave two to four digits of a length. The symbols are the same in every language.
 * @param {number} metres
 * @returns {[factor: number, name: string, digits: number]}
 */
function scaleOf(metres) {
  const a = Math.abs(metres);
  if (a === 0) return [1e3, "mm", 0];
  if (a < 0.1) return [1e3, "mm", a < 1e-4 ? 3 : a < 1e-3 ? 2 : 1];
  if (a < 1) return [1e2, "cm", 1];
  if (a < 1e3) return [1, "m", a < 10 ? 2 : 1];
  return [1e-3, "km", 2];
}

/**
 * A length in metres.
 * @param {number} metres
 */
export function length(metres) {
  if (!Number.isFinite(metres)) return "–";
  const [factor, name, digits] = scaleOf(metres);
  return isolate(`${fixed(metres * factor, digits)} ${name}`);
}

/**
 * A bound on a length.
 * @param {number} metres
 */
export function bound(metres) {
  const [factor, name, digits] = scaleOf(metres);
  return isolate(`±${fixed(metres * factor, digits)} ${name}`);
}

/**
 * Width, depth and height in one unit.
 * @param {number[]} metres
 */
export function extent(metres) {
  const [factor, name, digits] = scaleOf(Math.max(...metres));
  return isolate(`${metres.map((v) => fixed(v * factor, digits)).join(" × ")} ${name}`);
}

/**
 * A round length without superfluous digits, for the scale bar.
 * @param {number} metres
 */
export function round(metres) {
  /** @type {[number, string]} */
  const [value, name] = metres < 0.01 ? [metres * 1e3, "mm"] : metres < 1 ? [metres * 1e2, "cm"] : metres < 1e3 ? [metres, "m"] : [metres / 1e3, "km"];
  return isolate(`${new Intl.NumberFormat(locale, { maximumSignificantDigits: 3 }).format(value)} ${name}`);
}

/**
 * A coordinate to the millimetre.
 * @param {number} metres
 */
export const coordinate = (metres) => fixed(metres, 3);

/** @param {number} n */
export const pixels = (n) => new Intl.NumberFormat(locale, { maximumFractionDigits: n < 10 ? 2 : 0 }).format(n);

/**
 * 1, 2 or 5 times a power of ten, the largest that is at most `value`.
 * @param {number} value
 */
export function niceBelow(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  const lead = value / power;
  return (lead >= 5 ? 5 : lead >= 2 ? 2 : 1) * power;
}
