// The page inside another page: `?embed=1` shows the model with few controls, and messages let the page around it use the
// API (api.js).
//
// Who may: a page of the same origin, and the origins that whoever keeps this page names in
// `<meta name="kilwa-origins" content="https://museum.example https://…">` (`*` for all). Every message is looked at for
// its origin and its window; answers go to that origin only.
//
//   ← {kilwa: 1, event: "listening"} once, when the page can be spoken to
//   → {kilwa: 1, hello: 1}                     ← {kilwa: 1, event: "hello", detail: {version, ready}}
//   → {kilwa: 1, id, call: "name", args: […]}  ← {kilwa: 1, id, result} or {kilwa: 1, id, error}
//   → {kilwa: 1, listen: ["frame"]}            ← {kilwa: 1, event, detail}

import { $ } from "./dom.js";
import { credit } from "./facts.js";

/** Origins that may talk to this page. */
export function allowedOrigins() {
  const named = /** @type {HTMLMetaElement | null} */ (document.querySelector("meta[name=kilwa-origins]"))?.content.trim().split(/\s+/).filter(Boolean) ?? [];
  return new Set([location.origin, ...named]);
}

/**
 * @param {import("./api.js").Api} api
 * @param {Set<string>} calls what may be called of it
 */
export function serve(api, calls, { origins = allowedOrigins(), host = parent } = {}) {
  if (host === window) return;
  const listening = new Set(["ready", "trouble"]);
  /** Origin of the page around this one, once it spoke and is allowed. @type {string | null} */
  let to = null;
  const send = (/** @type {object} */ message) => to && host.postMessage({ kilwa: 1, ...message }, to);
  addEventListener("message", async (event) => {
    const { data } = event;
    if (event.source !== host || data?.kilwa !== 1) return;
    if (!origins.has(event.origin) && !origins.has("*")) return;
    to = event.origin;
    if (data.hello) send({ event: "hello", detail: { version: 1, ready: api.isReady } });
    if (Array.isArray(data.listen)) for (const name of data.listen) listening.add(String(name));
    if (data.call === undefined) return;
    const { id, call, args = [] } = data;
    try {
      if (!calls.has(call) || !Array.isArray(args)) throw new TypeError(`no such call: ${String(call)}`);
      send({ id, result: await /** @type {any} */ (api)[call](...args) });
    } catch (error) {
      send({ id, error: String(error?.message ?? error) });
    }
  });
  // The page around may have spoken before this one listened. This message reveals nothing, so it may go to anyone.
  host.postMessage({ kilwa: 1, event: "listening" }, "*");
  api.on("*", (detail, event) => listening.has(event) && send({ event, detail }));
}

/**
 * The line in the frame that names the model, who made it and its licence, as licences ask for; its title leads to the whole page.
 * @param {HTMLAnchorElement} title
 */
function creditLine(title) {
  const { creators, rights, rightsUri } = credit();
  const line = Object.assign(document.createElement("p"), { className: "credit" });
  line.append(title);
  for (const text of [creators, rights]) {
    if (!text) continue;
    const part =
      text === rights && rightsUri
        ? Object.assign(document.createElement("a"), { href: rightsUri, rel: "license noopener", target: "_blank" })
        : document.createElement("span");
    part.textContent = text;
    part.dir = "auto";
    line.append(part);
  }
  return line;
}

/**
 * Few controls, or none (`bare`); a link to the whole page, and the credit.
 * @param {boolean} isBare
 * @param {import("./api.js").Api} api
 */
export function reduce(isBare, api) {
  document.body.dataset.embed = isBare ? "bare" : "yes";
  document.body.dataset.panel = "closed";
  const link = $("open-whole");
  link.hidden = false;
  const title = Object.assign(document.createElement("a"), { target: "_blank", rel: "noopener", dir: "auto" });
  const line = creditLine(title);
  link.before(line);
  const follow = () => {
    const url = new URL(location.href);
    url.searchParams.delete("embed");
    link.href = title.href = url.href;
  };
  // The title of a pack that nobody published is known once it is open.
  const name = () => {
    title.textContent = $("title").textContent?.trim() ?? "";
    line.hidden = !title.textContent;
  };
  for (const one of [link, title]) {
    one.addEventListener("pointerdown", follow);
    one.addEventListener("focus", follow);
  }
  follow();
  name();
  api.on("ready", name);
}
