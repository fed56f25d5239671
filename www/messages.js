// Messages of the measuring engine and of the network in the language of the page. The engine reports a code and values (core/measure/src/message.rs): the code
// `refuse-few` is the string `refuseFew`. Its English is for scripts, and for whoever reads the console.

import { count, isolate, length } from "./format.js";
import { t } from "./i18n.js";

/** @import { Failure, Message } from "./types/page.js" */

/** How a value is given to a message, by its kind. @type {Record<string, (value: any) => string | number>} */
const KINDS = {
  count: Number,
  metres: length,
  share: (part) => isolate(`${count(Number((part * 100).toFixed(1)))} %`),
  number: count,
  word: (text) => isolate(text),
};

/** Failures that have a title of their own (trouble.js). */
const NETWORK = new Set(["missing", "damaged", "noRange", "noCors", "changed", "closed", "broken", "cutOff"]);

/** @param {Message} message as `ToMessage::as_json` gives it */
export function sentence({ code, values = {} }) {
  const texts = Object.entries(values).map(([name, value]) => {
    const [[kind, amount]] = Object.entries(value);
    return [name, KINDS[kind](amount)];
  });
  return t(
    code.replace(/-(\w)/g, (_, letter) => letter.toUpperCase()),
    Object.fromEntries(texts),
  );
}

/**
 * Why something failed: in the engine, in the network (loader.js), or in the page itself, which has only its own text.
 * @param {any} error
 */
export function why(error) {
  const { said, kind, message } = /** @type {Failure} */ (error ?? {});
  if (said) return sentence(said);
  if (kind) return t(NETWORK.has(kind) ? `${kind}Title` : "sourceFailed");
  return String(message ?? error);
}
