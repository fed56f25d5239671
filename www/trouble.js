// Shows what cannot be displayed, why, and what to do: one panel over the empty picture area, never over a model.

import { notice } from "./chrome.js";
import { $ } from "./dom.js";
import { bytes } from "./format.js";
import { t } from "./i18n.js";

/** @import { Failure } from "./types/page.js" */

/** @type {Record<string, string>} */
const ICONS = { noGpu: "noscreen", gpuGone: "noscreen", closed: "lock", offline: "offline", server: "offline" };
/** @type {Record<string, string>} */
const TEXTS = {
  empty: "damaged",
  truncated: "damaged",
  missing: "missing",
  damaged: "damaged",
  noRange: "noRange",
  noCors: "noCors",
  changed: "changed",
  closed: "closed",
  gpuGone: "gpuGone",
};
/** Trying the same again helps with these. */
const RETRY = new Set(["broken", "gpuGone", "changed", "missing", "damaged", "server", "noRange", "noCors"]);

export class Trouble {
  constructor() {
    /** @type {{kind: string, error: Failure | null, reason?: string} | null} */
    this.current = null;
    /** @type {(kind: string) => void} */
    this.onShow = () => {};
  }

  /**
   * @param {string} kind `PackError.kind`, or noGpu, gpuGone, damaged, broken
   * @param {Failure | null | undefined} error
   * @param {{reason?: string}} more `reason`: string that explains noGpu
   */
  show(kind, error = null, { reason } = {}) {
    this.current = { kind, error, reason };
    this.onShow(kind);
    // With a picture on screen the sentence is below it: errors never cover the model. A device that is gone left none.
    if (document.body.dataset.state === "ready" && kind !== "gpuGone") {
      const { title, text } = words(this.current);
      notice(`${title}. ${text}`, 60000);
      return;
    }
    document.body.dataset.state = "trouble";
    $("loading").hidden = true;
    $("trouble").hidden = false;
    this.translate();
  }

  translate() {
    if (!this.current) return;
    const { kind, error } = this.current;
    const { title, text } = words(this.current);
    const key = TEXTS[kind] ?? kind;
    $("trouble-title").textContent = title;
    $("trouble-text").textContent = text;
    // The machine's own words, for whoever looks after the server.
    $("trouble-detail").textContent = kind === "noGpu" ? "" : String(error?.message ?? "");
    $("trouble-icon").setAttribute("href", `icons/sprite.svg#${ICONS[kind] ?? "warning"}`);
    $("trouble-retry").hidden = !RETRY.has(key) && kind !== "broken";
    $("trouble-download").hidden = ["missing", "empty", "closed"].includes(kind);
    const signIn = $("trouble-sign-in");
    signIn.hidden = !error?.signIn;
    if (error?.signIn) signIn.href = signInAddress(error.signIn);
  }
}

/**
 * @param {{kind: string, error?: Failure | null, reason?: string}} trouble
 */
function words({ kind, error, reason }) {
  if (kind === "noGpu") return { title: t("noGpuTitle"), text: t(reason ?? "noGpuAdapter") };
  const key = TEXTS[kind] ?? "broken";
  const size = error?.bytes !== undefined && Number.isFinite(error.bytes) ? bytes(error.bytes) : "…";
  return { title: t(`${key}Title`), text: t(`${key}Text`, { size, host: error?.host }) };
}

/** Longest way back that the form takes (server/src/auth/routes.rs). */
const LONGEST_NEXT = 4000;

/** The form, in the language of the page, and from there back to what was to be seen: the view and the measurements of a link are in the address. @param {string} form */
function signInAddress(form) {
  const address = new URL(form);
  const { pathname, search, hash } = location;
  const ways = [pathname + search + hash, pathname + search];
  const next = ways.find((way) => way.length <= LONGEST_NEXT);
  if (next) address.searchParams.set("next", next);
  address.searchParams.set("lang", document.documentElement.lang);
  return address.href;
}
