// What the browser keeps for the person: small JSON values in localStorage. Where storage is switched off or full, they
// last as long as the page, and `put` returns false.

/** @type {Map<string, string | null>} */
const memory = new Map();

/**
 * A value, or `otherwise` where there is none that can be read.
 * @param {string} key
 * @param {any} [otherwise]
 */
export function get(key, otherwise = null) {
  try {
    const text = memory.get(key) ?? localStorage.getItem(`kilwa.${key}`);
    return text === null || text === undefined ? otherwise : JSON.parse(text);
  } catch {
    return otherwise;
  }
}

/**
 * Keep a value, null forgets it; false where it will not outlive the page.
 * @param {string} key
 * @param {unknown} value
 */
export function put(key, value) {
  const text = value === null ? null : JSON.stringify(value);
  try {
    if (text === null) localStorage.removeItem(`kilwa.${key}`);
    else localStorage.setItem(`kilwa.${key}`, text);
    memory.delete(key);
    return true;
  } catch {
    memory.set(key, text);
    return false;
  }
}

/** A new name that no other thing has. `crypto.randomUUID` exists only at secure addresses. */
export function unique() {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  bytes[6] = (bytes[6] & 15) | 64;
  bytes[8] = (bytes[8] & 63) | 128;
  const hex = [...bytes].map((b) => b.toString(16).padStart(2, "0")).join("");
  return [hex.slice(0, 8), hex.slice(8, 12), hex.slice(12, 16), hex.slice(16, 20), hex.slice(20)].join("-");
}

/**
 * Offer a file to the person.
 * @param {string} name
 * @param {Blob} blob
 */
export function download(name, blob) {
  const url = URL.createObjectURL(blob);
  const link = Object.assign(document.createElement("a"), { href: url, download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(url), 60_000);
}

/**
 * A file name made of a title.
 * @param {string} title
 * @param {string} ending
 */
export const fileName = (title, ending) =>
  `${
    title
      .trim()
      .replace(/[^\p{L}\p{N}]+/gu, "-")
      .replace(/^-|-$/g, "")
      .slice(0, 80) || "kilwa"
  }${ending}`;

/**
 * The JSON of a file the person chose; errors say what is wrong with it.
 * @param {File} file
 * @param {number} limit bytes
 */
export async function readJson(file, limit = 16e6) {
  if (file.size > limit) throw new Error(`${file.name}: ${file.size} > ${limit} bytes`);
  const text = await file.text();
  try {
    return JSON.parse(text);
  } catch (error) {
    throw new Error(`${file.name}: ${error.message}`);
  }
}
