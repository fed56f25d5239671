// What the page shows of the model that is open, beside the picture itself: progress, title and facts, the figures of each frame.

import { cameraKey } from "./camera.js";
import * as chrome from "./chrome.js";
import { Cube } from "./cube.js";
import { $ } from "./dom.js";
import { showFacts } from "./facts.js";
import * as format from "./format.js";
import { t } from "./i18n.js";
import { Status } from "./status.js";

/** @import { FrameStats } from "./types/page.js" */
/** @import { Current } from "./current.js" */
/** @import { Model } from "./model.js" */

/** Milliseconds without a move after which the camera rests. */
const REST_MS = 200;
/** How far the loading bar is when the head of the pack is there. */
const HEAD = 0.3;

export class Screen {
  /** The camera of the last frame. */
  #seen = "";
  /** The model whose facts were shown last: later only their language changes. */
  #titled = "";
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #resting;

  /**
   * @param {object} parts
   * @param {Current} parts.current
   * @param {import("./measuring.js").Measuring} parts.measuring
   * @param {import("./section.js").Section} parts.section
   * @param {import("./link.js").Address} parts.address
   * @param {import("./api.js").Api} parts.api
   * @param {(part: number) => void} parts.came how much of what the first picture needs is there
   */
  constructor({ current, measuring, section, address, api, came }) {
    this.current = current;
    this.measuring = measuring;
    this.section = section;
    this.address = address;
    this.api = api;
    this.came = came;
    this.status = new Status();
    this.cube = new Cube((view) => current.scene?.standardView(view));
  }

  /** No pack was named. */
  welcome() {
    document.body.dataset.state = "welcome";
    $("loading").hidden = true;
    $("welcome").hidden = false;
  }

  /** A pack will be opened, in place of what was. */
  loading() {
    document.body.dataset.state = "loading";
    document.body.dataset.pack = "";
    $("welcome").hidden = $("trouble").hidden = true;
    $("loading").hidden = false;
    $("loading-bar").removeAttribute("value");
    document.querySelector(".stage > .poster")?.remove(); // of another model
  }

  /**
   * @param {number} done
   * @param {number} total
   */
  progress(done, total) {
    if (this.current.scene) return;
    this.came(total ? (HEAD * done) / total : 0);
    $("loading-text").textContent = t("loadingBytes", { done: format.bytes(done), total: format.bytes(total || done) });
  }

  /**
   * Until something is tried again, before there is a picture.
   * @param {number} seconds
   */
  waits(seconds) {
    $("loading-text").textContent = t("offlineFirst", { seconds });
  }

  /**
   * The server asks to wait before it is asked for anything else.
   * @param {number} seconds
   */
  limited(seconds) {
    const { scene } = this.current;
    if (scene?.session.drawn) scene.session.wake();
    else $("loading-text").textContent = t("limited", { seconds });
  }

  /** @param {Model} model */
  about({ title, info }) {
    $("title").textContent = title;
    $("about-title").textContent = title;
    document.title = `${title} - Kilwa`;
    $("canvas").setAttribute("aria-label", `${t("canvas")}: ${title}`);
    showFacts($("facts"), info);
    // Of a published model people read who made it and what it is; of a plain file there is nothing else.
    const technical = /** @type {HTMLDetailsElement} */ (document.getElementById("technical"));
    if (this.#titled !== title) technical.open = document.getElementById("object") === null;
    this.#titled = title;
  }

  /** Something of the model is there. */
  first() {
    document.body.dataset.state = "ready";
    $("loading").hidden = true;
    $("cube").hidden = false;
    this.api.emit("ready", null);
    this.address.later();
    const { pack, info, isCutOff } = this.current.opened.model;
    if (isCutOff) chrome.notice(t("cutOffNotice", { here: format.bytes(Number(pack.bytes)), all: format.bytes(info.pack.bytes) }), 30_000);
    else if (pack.whole) chrome.notice(t("noRangeSmall", { size: format.bytes(Number(pack.bytes)) }), 12000);
  }

  /** @param {FrameStats} stats */
  frame(stats) {
    const { scene, notes } = this.current.opened;
    const { viewer, session, loupe, walk } = scene;
    this.status.show(stats, viewer, session);
    if (!$("info").hidden) this.status.list($("stats"), stats, session);
    const camera = viewer.camera();
    this.cube.show(camera);
    notes.pins?.frame(stats);
    this.measuring.frame(stats);
    loupe.frame();
    this.section.frame();
    walk.frame(stats);
    const figures = this.api.stats();
    if (figures) this.api.emit("frame", figures);
    const seen = cameraKey(camera);
    if (this.#seen === seen) return;
    this.#seen = seen;
    this.address.later();
    clearTimeout(this.#resting);
    this.#resting = setTimeout(() => this.current.isOpen && this.api.emit("camera", this.api.getCamera()), REST_MS);
  }

  /** There is another view to go back or forward to, or none. */
  viewButtons() {
    const flight = this.current.scene?.flight;
    $("view-back").disabled = !flight?.canGoBack;
    $("view-forward").disabled = !flight?.canGoForward;
  }
}
