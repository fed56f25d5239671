// Messages of parts of the page that are loaded when they are first used.

import { add } from "./i18n.js";

/**
 * The part's messages in the page's language, added to those of the page. Rejects where they cannot be had.
 * @param {string} part as in the names of their files
 * @returns {Promise<void>}
 */
export async function partMessages(part) {
  const { lang } = document.documentElement;
  const name = `i18n/${part}-${lang}.json`;
  const response = await fetch(new URL(name, import.meta.url));
  if (!response.ok) throw new Error(`${name}: ${response.status}`);
  const messages = await response.json();
  // Another language was chosen meanwhile.
  if (lang !== document.documentElement.lang) return partMessages(part);
  add(messages);
}
