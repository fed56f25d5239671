// What the engine and the network say, in the language of the page. The engine gives a code and values (core/measure, said.rs): the code `refuse-few` is the
// string `refuseFew`. Its English is for scripts, and for whoever reads the console.

import { count, isolate, length } from "./format.js";
import { t } from "./i18n.js";

const KINDS = {
  count: Number,
  metres: length,
  share: (part) => isolate(`${count(Number((part * 100).toFixed(1)))} %`),
  number: count,
  word: (text) => isolate(text),
};

/** Troubles that have a title of their own (trouble.js). */
const NETWORK = new Set(["missing", "damaged", "noRange", "changed", "closed", "broken"]);

/** @param {{code: string, values?: object}} said as `Say::as_json` gives it */
export function sentence({ code, values = {} }) {
  const words = Object.entries(values).map(([name, worth]) => {
    const [[kind, value]] = Object.entries(worth);
    return [name, KINDS[kind](value)];
  });
  return t(code.replace(/-(\w)/g, (_, letter) => letter.toUpperCase()), Object.fromEntries(words));
}

/** Why something failed: of the engine, of the network (loader.js), or of the program itself, which has only its own words. */
export function why(error) {
  if (error?.said) return sentence(error.said);
  if (error?.kind) return t(NETWORK.has(error.kind) ? `${error.kind}Title` : "sourceFailed");
  return String(error?.message ?? error);
}
