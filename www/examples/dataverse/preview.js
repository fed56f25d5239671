// The external tool of Dataverse that shows packs (docs/hosting/dataverse.md). Dataverse opens this page with
//
//   ?callback=BASE64       from 5.13 on, for a manifest with `allowedApiCalls`: the address, signed for five minutes if the file is not public, of
//                          {"data": {"queryParameters": {…}, "signedUrls": [{"name": "retrieveFileContents", "signedUrl": "https://…"}]}}
//   ?siteUrl=…&fileid=…    otherwise; then only public files can be read
//   &locale=…&preview=true
//
// The start of the file is read first, because a file that cannot be shown has a reason that only this page can explain: the viewer does not know of Dataverse.

import "../../kilwa-viewer.js";
import { WORDS } from "./words.js";

const MAGIC = "KILWAPCK";
/** What the viewer reads as a whole, if the server ignores Range. */
const WHOLE_LIMIT = 64 * 1024 * 1024;
const parameters = new URLSearchParams(location.search);
const language = [parameters.get("locale"), ...navigator.languages].map((l) => l?.toLowerCase().split(/[-_]/)[0]).find((l) => l && l in WORDS) ?? "en";

/** Why the file cannot be shown: a key of WORDS. */
class Refusal extends Error {
  /**
   * @param {string} why
   * @param {Record<string, string>} values
   */
  constructor(why, values = {}) {
    super(why);
    this.values = values;
  }
}

/**
 * @param {string} key
 * @param {Record<string, string>} values
 */
const text = (key, values = {}) => WORDS[language][key].replace(/\{(\w+)\}/g, (_, name) => values[name] ?? "");

/**
 * An address with http or https; anything else names no file.
 * @param {unknown} address
 */
function web(address) {
  const url = typeof address === "string" && URL.canParse(address) ? new URL(address) : null;
  if (!url || !["http:", "https:"].includes(url.protocol)) throw new Refusal("noFile");
  return url;
}

/** Dataverse does not escape the plus signs of Base64. */
function callbackAddress() {
  try {
    const bytes = Uint8Array.from(atob((parameters.get("callback") ?? "").replaceAll(" ", "+")), (c) => c.charCodeAt(0));
    return web(new TextDecoder().decode(bytes));
  } catch {
    throw new Refusal("noFile");
  }
}

/**
 * @param {URL} url
 * @param {RequestInit} options
 */
async function ask(url, options = {}) {
  try {
    // No cookie is needed: a signed address carries what it allows.
    return await fetch(url, { credentials: "omit", ...options });
  } catch {
    throw new Refusal("unreachable", { host: url.host });
  }
}

/** The address of the file's contents. */
async function fileAddress() {
  if (!parameters.has("callback")) {
    const id = parameters.get("fileid") ?? "";
    if (!/^\d+$/.test(id)) throw new Refusal("noFile");
    // `gbrecs` keeps Dataverse from counting each of the many requests as a download.
    return web(`${web(parameters.get("siteUrl")).href.replace(/\/$/, "")}/api/access/datafile/${id}?gbrecs=true`);
  }
  const callback = callbackAddress();
  const { host } = callback;
  const response = await ask(callback);
  if ([401, 403, 404].includes(response.status)) throw new Refusal("expired", { host });
  if (!response.ok) throw new Refusal("server", { host, status: String(response.status) });
  const { data } = await response.json().catch(() => ({}));
  const calls = Array.isArray(data?.signedUrls) ? data.signedUrls : [];
  const found = calls.find((/** @type {any} */ call) => call?.name === "retrieveFileContents");
  if (typeof found?.signedUrl !== "string") throw new Refusal("noCall", { host });
  return web(found.signedUrl);
}

/**
 * The first bytes, and no more of the answer.
 * @param {Response} response
 */
async function start(response) {
  const reader = response.body?.getReader();
  let bytes = "";
  while (reader && bytes.length < MAGIC.length) {
    const { done, value } = await reader.read();
    if (done) break;
    bytes += String.fromCharCode(...value.subarray(0, MAGIC.length));
  }
  await reader?.cancel().catch(() => {});
  return bytes.slice(0, MAGIC.length);
}

/**
 * Refuses what the viewer could not show.
 * @param {URL} file
 */
async function check(file) {
  const { host } = file;
  // Not stored: when the viewer asks for more, a browser that has these bytes would first compare them with the server, in another request.
  const response = await ask(file, { headers: { Range: `bytes=0-${MAGIC.length - 1}` }, cache: "no-store" });
  const { status } = response;
  if (status === 401 || status === 403) throw new Refusal("restricted", { host });
  if (status === 404 || status === 410) throw new Refusal("missing", { host });
  // Not even one byte: an empty file.
  if (status === 416) throw new Refusal("notPack");
  if (status === 429 || status === 503) return; // The viewer waits.
  if (status !== 200 && status !== 206) throw new Refusal("server", { host, status: String(status) });
  const bytes = await start(response).catch(() => {
    throw new Refusal("unreachable", { host });
  });
  if (bytes !== MAGIC) throw new Refusal("notPack");
  const length = Number(response.headers.get("content-length"));
  if (status === 200 && length > WHOLE_LIMIT) throw new Refusal("noRange", { host, size: String(Math.ceil(length / 2 ** 20)) });
}

document.documentElement.lang = language;
document.documentElement.dir = language === "ar" ? "rtl" : "ltr";
const message = /** @type {HTMLElement} */ (document.getElementById("message"));
message.textContent = text("reading");
try {
  const file = await fileAddress();
  await check(file);
  const viewer = document.createElement("kilwa-viewer");
  viewer.setAttribute("lang", language);
  viewer.setAttribute("src", file.href);
  message.textContent = "";
  document.body.append(viewer);
} catch (error) {
  if (!(error instanceof Refusal)) throw error;
  message.setAttribute("role", "alert");
  message.textContent = text(error.message, { here: location.origin, ...error.values });
}
