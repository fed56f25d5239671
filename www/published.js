// Notes that a host publishes beside a pack.

import { t } from "./i18n.js";

/** Characters of the document at most. */
const FILE_LIMIT = 16e6;

/**
 * Fetch what a host publishes; only from where the page or the pack comes from. The `cause` of an error is the status of the answer, where there was one.
 * @param {string} address
 * @param {string | URL | null} pack
 */
export async function fetchPublished(address, pack) {
  const url = new URL(address, pack ?? location.href);
  const allowed = [location.origin, pack ? new URL(pack, location.href).origin : null];
  if (!allowed.includes(url.origin)) throw new Error(t("annotationsOrigin", { origin: url.origin }));
  const response = await fetch(url, { credentials: "same-origin" });
  if (!response.ok) throw new Error(`${url.pathname}: ${response.status}`, { cause: response.status });
  const text = await response.text();
  if (text.length > FILE_LIMIT) throw new Error(`${url.pathname}: ${text.length} > ${FILE_LIMIT}`);
  return JSON.parse(text);
}
