// Standing in the model with a headset (WebXR): the button, and what it starts. Loaded only where the browser has a headset. The stay itself is in visit.js; the
// messages are in a file of their own.

import { html } from "lit-html";
import { announce, notice } from "../chrome.js";
import { $ } from "../dom.js";
import { onChange, t } from "../i18n.js";
import { why } from "../messages.js";
import { partMessages } from "../part-messages.js";
import { show } from "../view.js";
import { Visit } from "./visit.js";

/** @import { Program } from "../types/page.js" */
/** @typedef {typeof import("../viewer-gl.js")} HeadsetProgram */

/**
 * What it needs of the page.
 * @typedef {object} HeadsetPage
 * @property {import("../current.js").Current} current
 * @property {import("../measuring.js").Measuring} measuring
 * @property {import("../settings.js").Settings} settings
 * @property {() => import("../decode-pool.js").DecodePool} newPool
 */

/** The eye of someone who stands, where the headset knows no floor, metres. */
const STANDING = 1.6;

/** @type {Promise<HeadsetProgram> | null} */
let loading = null;

/**
 * The program for WebGL 2: the only pictures that browsers show in a headset. The page may run it already.
 * @param {Program} running
 * @returns {Promise<HeadsetProgram>}
 */
function program(running) {
  if ("frameOfEyes" in running.Viewer.prototype) return Promise.resolve(/** @type {HeadsetProgram} */ (/** @type {unknown} */ (running)));
  loading ??= (async () => {
    const address = (/** @type {string} */ name) => new URL(name, import.meta.url).href;
    const [script, wasm] = [import(address("viewer-gl.js")), fetch(address("viewer-gl_bg.wasm"))];
    wasm.catch(() => {}); // the program reports it
    const module = await script;
    await module.default({ module_or_path: wasm });
    return module;
  })().catch((error) => {
    loading = null; // The next press tries again.
    throw error;
  });
  return loading;
}

class Headset {
  #button = Object.assign(document.createElement("button"), { type: "button", id: "headset", className: "button icon" });
  /** @type {Visit | null} */
  #visit = null;
  /** A session is asked for, or being prepared. */
  #isBusy = false;

  /** @param {HeadsetPage} page */
  constructor(page) {
    this.page = page;
    this.#button.addEventListener("click", () => (this.#visit ? this.#visit.end() : this.#enter()));
    $("fullscreen").before(this.#button);
    onChange(() => {
      partMessages("headset").then(
        () => this.#show(),
        () => {}, // the messages of before stay
      );
    });
    this.#show();
  }

  #show() {
    const key = this.#visit ? "headsetLeave" : "headsetEnter";
    this.#button.dataset.label = key;
    this.#button.setAttribute("aria-label", t(key));
    // Goggles, after an icon of Lucide (icons/LICENSE-lucide.txt).
    const path = "M20 6a2 2 0 0 1 2 2v8a2 2 0 0 1-2 2h-4a2 2 0 0 1-1.6-.8l-1.6-2.13a1 1 0 0 0-1.6 0L9.6 17.2A2 2 0 0 1 8 18H4a2 2 0 0 1-2-2V8a2 2 0 0 1 2-2z";
    const drawn = html`<svg class="icon" aria-hidden="true" viewBox="0 0 24 24" fill="none" stroke="currentColor" stroke-width="2" stroke-linecap="round" stroke-linejoin="round"><path d=${path} /></svg>`;
    show(drawn, this.#button);
  }

  async #enter() {
    const { current } = this.page;
    if (this.#isBusy || !current.isOpen || !navigator.xr) return;
    this.#isBusy = true;
    /** @type {XRSession | null} */
    let session = null;
    /** @type {WebGL2RenderingContext | null} */
    let gl = null;
    try {
      const { model, scene } = current.opened;
      const running = program(model.module);
      running.catch(() => {}); // awaited below
      session = await navigator.xr.requestSession("immersive-vr", { optionalFeatures: ["local-floor"] });
      let hasEnded = false;
      session.addEventListener("end", () => (hasEnded = true), { once: true });
      announce(t("headsetLoading"));
      const canvas = document.createElement("canvas");
      // The program takes this context when it asks the canvas for one.
      const settings = { xrCompatible: true, alpha: true, antialias: false, depth: false, stencil: false };
      gl = /** @type {WebGL2RenderingContext | null} */ (canvas.getContext("webgl2", settings));
      if (!gl) throw new Error(t("headsetNoWebgl"));
      const [{ Viewer }, space] = await Promise.all([running, floor(session)]);
      const viewer = await Viewer.create(canvas, model.head);
      if (hasEnded || !scene.isOpen || current.scene !== scene) {
        viewer.free();
        release(gl);
        if (!hasEnded) await session.end();
        return;
      }
      // For whoever waits for the whole picture from outside the headset.
      const shown = (/** @type {boolean} */ isWhole) => (this.#button.dataset.picture = isWhole ? "whole" : "coming");
      this.#visit = new Visit({ session, space, gl, viewer, page: this.page, shown, ended: (reason) => this.#ended(reason) });
      this.#show();
      announce(t("headsetInside"));
    } catch (error) {
      notice(t("headsetFailed", { why: error.kind === "noGpu" ? t("headsetNoWebgl") : why(error) }), 12000);
      release(gl);
      session?.end().catch(() => {});
    } finally {
      this.#isBusy = false;
    }
  }

  /** @param {string | null} reason */
  #ended(reason) {
    this.#visit = null;
    delete this.#button.dataset.picture;
    this.#show();
    if (reason) notice(reason, 12000);
    else announce(t("headsetEnded"));
    this.#button.focus({ preventScroll: true });
    this.page.current.scene?.session.wake();
  }
}

/** Browsers allow few contexts: one that nobody needs goes at once. @param {WebGL2RenderingContext | null} gl */
const release = (gl) => gl?.getExtension("WEBGL_lose_context")?.loseContext();

/**
 * The headset's space with the floor at height 0: where it knows no floor, below the eyes of someone who stands.
 * @param {XRSession} session
 */
async function floor(session) {
  try {
    return await session.requestReferenceSpace("local-floor");
  } catch {
    const space = await session.requestReferenceSpace("local");
    return space.getOffsetReferenceSpace(new XRRigidTransform({ y: -STANDING }));
  }
}

/**
 * Offer it, once for the page: the button works for the model that is open when it is pressed.
 * @param {HeadsetPage} page
 */
export async function offer(page) {
  try {
    await partMessages("headset");
    if (!document.getElementById("headset")) new Headset(page);
  } catch (error) {
    notice(why(error), 12000);
  }
}
