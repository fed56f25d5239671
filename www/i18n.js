// The messages of the page, from i18n/LANGUAGE/page.ftl. Elements name theirs: data-text (content), data-label (name and tooltip), data-aria (name only).

import { count, day, setLocale } from "./format.js";

const RIGHT_TO_LEFT = new Set(["ar"]);

/** @type {Record<string, any>} */
let messages = {};
/** @type {Intl.PluralRules} */
let plural;
/** @type {Set<() => void>} */
const listeners = new Set();

/**
 * The message of a key with its values; numbers are written as the language does. A key without a message shows itself: a test keeps that from happening.
 * @param {string} key
 * @param {Record<string, any>} values
 * @returns {string}
 */
export function t(key, values = {}) {
  return fill(messages[key] ?? key, values);
}

/**
 * A message is a text, plural forms of the number that `$` names, or a list of these (i18n/src/message.rs).
 * @param {any} message
 * @param {Record<string, any>} values
 * @returns {string}
 */
function fill(message, values) {
  if (Array.isArray(message)) return message.map((part) => fill(part, values)).join("");
  if (message.$) return fill(message[plural.select(values[message.$])] ?? message.other, values);
  return message.replace(/\{(\w+)\}/g, (/** @type {string} */ _, /** @type {string} */ name) =>
    typeof values[name] === "number" ? count(values[name]) : (values[name] ?? ""),
  );
}

/** @param {string} language */
export function remember(language) {
  try {
    localStorage.setItem("kilwa.language", language);
  } catch {
    // Storage is switched off: the choice then lasts as long as the page.
  }
}

/**
 * @param {string} language
 * @param {Promise<Response>} asked the request for its messages, where it is under way
 */
export async function use(language, asked = fetch(new URL(`i18n/${language}.json`, import.meta.url))) {
  const response = await asked;
  if (!response.ok) throw new Error(`i18n/${language}.json: ${response.status}`);
  messages = await response.json();
  plural = new Intl.PluralRules(language);
  setLocale(language, RIGHT_TO_LEFT.has(language));
  document.documentElement.lang = language;
  document.documentElement.dir = RIGHT_TO_LEFT.has(language) ? "rtl" : "ltr";
  apply(document);
  for (const listener of listeners) listener();
}

/**
 * Messages of a part that is loaded later, in the language of the page.
 * @param {Record<string, any>} more
 */
export const add = (more) => Object.assign(messages, more);

/** @param {() => void} listener */
export function onChange(listener) {
  listeners.add(listener);
}

/**
 * Write the messages into everything below `root`.
 * @param {ParentNode} root
 */
export function apply(root) {
  const all = (/** @type {string} */ name) => /** @type {NodeListOf<HTMLElement>} */ (root.querySelectorAll(`[data-${name}]`));
  for (const e of all("text")) e.textContent = t(e.dataset.text ?? "");
  for (const e of all("label")) e.setAttribute("aria-label", t(e.dataset.label ?? ""));
  for (const e of all("aria")) e.setAttribute("aria-label", t(e.dataset.aria ?? ""));
  // Days that were published with a model.
  for (const e of root.querySelectorAll("time")) e.textContent = day(e.dateTime);
}
