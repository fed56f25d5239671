// Which language the page is in: known before anything else is loaded, so that its messages come at the same time. Part of boot.js alone: a file
// that it shared with the page would cost a request.

export const LANGUAGES = ["en", "fr", "pt", "sw", "ar"];

/**
 * `?lang=`, else what was chosen before, else what the browser asks for, else English.
 * @param {URLSearchParams} parameters
 */
export function preferred(parameters) {
  const chosen = [parameters.get("lang"), stored(), ...navigator.languages];
  const found = chosen.map((l) => l?.toLowerCase().split("-")[0]).find((l) => l && LANGUAGES.includes(l));
  return found ?? "en";
}

function stored() {
  try {
    return localStorage.getItem("kilwa.language");
  } catch {
    return null; // Storage is switched off: the choice then lasts as long as the page.
  }
}

/**
 * The answer with the messages of a language.
 * @param {string} language
 */
export const ask = (language) => fetch(new URL(`i18n/${language}.json`, import.meta.url));
