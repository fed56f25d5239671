// The names of countries and territories in the page's languages: `node xtask/npm/countries.mjs > server/assets/countries.json`.
// Source: Unicode CLDR (https://cldr.unicode.org, Unicode License V3), as Node's own Intl has it. One row for each code of ISO 3166-1.
const LANGUAGES = ["en", "fr", "pt", "sw", "ar"];
const names = LANGUAGES.map((language) => new Intl.DisplayNames(language, { type: "region", fallback: "none" }));
const letters = [..."ABCDEFGHIJKLMNOPQRSTUVWXYZ"];
// Not countries: unions, worlds of their own, and codes that ISO took back or never gave.
const NOT = new Set([
  "AC",
  "AN",
  "BU",
  "CP",
  "CQ",
  "CS",
  "DD",
  "DG",
  "DY",
  "EA",
  "EU",
  "EZ",
  "FQ",
  "FX",
  "HV",
  "IC",
  "JT",
  "MI",
  "NH",
  "NQ",
  "NT",
  "PC",
  "PU",
  "PZ",
  "QO",
  "RH",
  "SU",
  "TA",
  "TP",
  "UK",
  "UN",
  "VD",
  "WK",
  "XA",
  "XB",
  "YD",
  "YU",
  "ZR",
  "ZZ",
]);
const rows = letters
  .flatMap((a) => letters.map((b) => a + b))
  .filter((code) => !NOT.has(code) && names[0].of(code))
  .map((code) => `  "${code}": ${JSON.stringify(names.map((n) => n.of(code)))}`);
console.log(`{\n  "source": ["Unicode CLDR ${process.versions.cldr}, Unicode License V3"],\n${rows.join(",\n")}\n}`);
