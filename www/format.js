// Numbers for people, in the language of the page. Digits stay those of the coordinates (0 to 9) in every language.

let locale = "en-u-nu-latn";

export function setLocale(language) {
  locale = `${language}-u-nu-latn`;
}

const fixed = (value, digits) =>
  new Intl.NumberFormat(locale, { minimumFractionDigits: digits, maximumFractionDigits: digits }).format(value);

const unit = (value, name, digits) =>
  new Intl.NumberFormat(locale, {
    style: "unit", unit: name, unitDisplay: "short", minimumFractionDigits: digits, maximumFractionDigits: digits,
  }).format(value);

export const count = (n) => new Intl.NumberFormat(locale).format(n);

export function bytes(n) {
  if (n < 1e3) return unit(n, "byte", 0);
  if (n < 1e6) return unit(n / 1e3, "kilobyte", 0);
  if (n < 1e9) return unit(n / 1e6, "megabyte", n < 1e8 ? 1 : 0);
  return unit(n / 1e9, "gigabyte", 2);
}

/** A length in metres with a unit that leaves two to four digits. The symbols are the same in every language. */
export function length(metres) {
  if (!Number.isFinite(metres)) return "–";
  const a = Math.abs(metres);
  if (a === 0) return "0 mm";
  if (a < 1e-3) return `${fixed(metres * 1e3, a < 1e-4 ? 3 : 2)} mm`;
  if (a < 0.1) return `${fixed(metres * 1e3, 1)} mm`;
  if (a < 1) return `${fixed(metres * 1e2, 1)} cm`;
  if (a < 1000) return `${fixed(metres, a < 10 ? 2 : 1)} m`;
  return `${fixed(metres / 1e3, 2)} km`;
}

/** A round length without superfluous digits, for the scale bar. */
export function round(metres) {
  const [value, name] = metres < 0.01 ? [metres * 1e3, "mm"] : metres < 1 ? [metres * 1e2, "cm"] : metres < 1e3 ? [metres, "m"] : [metres / 1e3, "km"];
  return `${new Intl.NumberFormat(locale, { maximumSignificantDigits: 3 }).format(value)} ${name}`;
}

/** A coordinate to the millimetre. */
export const coordinate = (metres) => fixed(metres, 3);

export const pixels = (n) => new Intl.NumberFormat(locale, { maximumFractionDigits: n < 10 ? 2 : 0 }).format(n);

/** 1, 2 or 5 times a power of ten, the largest that is at most `value`. */
export function niceBelow(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  const lead = value / power;
  return (lead >= 5 ? 5 : lead >= 2 ? 2 : 1) * power;
}
