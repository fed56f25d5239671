// The line below the picture, and the list of figures.

import { $ } from "./dom.js";
import { fill, place } from "./facts.js";
import { bound, bytes, count, length, niceBelow, pixels, round } from "./format.js";
import { t } from "./i18n.js";

/** @import { FrameStats, Viewer } from "./types/page.js" */
/** @import { Session } from "./session.js" */

const SCALE_PIXELS = 110;
/** On a phone only the figures fit into the line. */
const narrow = matchMedia("(max-width: 720px)");
const NOWHERE = "x –  y –  z – m";

export class Status {
  constructor() {
    this.hovering = false;
    /** @type {[number, number] | null} */
    this.at = null;
    this.leave();
  }

  /**
   * The place under the pointer, at most once per frame of the screen.
   * @param {Viewer} viewer
   * @param {number} x
   * @param {number} y
   */
  hover(viewer, x, y) {
    this.at = [x, y];
    if (this.hovering) return;
    this.hovering = true;
    requestAnimationFrame(() => {
      this.hovering = false;
      if (!this.at) return;
      const hit = viewer.pick(...this.at);
      $("coordinates").textContent = hit.length > 0 ? place(hit) : NOWHERE;
    });
  }

  leave() {
    this.at = null;
    $("coordinates").textContent = NOWHERE;
  }

  /**
   * After each frame.
   * @param {FrameStats} stats
   * @param {Viewer} viewer
   * @param {Session} session
   */
  show(stats, viewer, session) {
    const error = stats.worstErrorMetres;
    const full = error === 0 ? t("shownFull") : t("shownTo", { error: bound(error) });
    text("accuracy", Number.isFinite(error) ? (narrow.matches ? bound(error) : full) : "");
    $("accuracy").title = full;
    this.scale(viewer, session.ratio);
    this.load(stats, session);
  }

  /**
   * @param {Viewer} viewer
   * @param {number} ratio
   */
  scale(viewer, ratio) {
    const metresPerCss = viewer.metresPerPixel() * ratio;
    const metres = niceBelow(metresPerCss * SCALE_PIXELS * (narrow.matches ? 0.7 : 1));
    $("scale").hidden = false;
    $("scale-bar").style.width = `${(metres / metresPerCss).toFixed(1)}px`;
    text("scale-text", round(metres));
  }

  /**
   * @param {FrameStats} stats
   * @param {Session} session
   */
  load(stats, session) {
    const bar = $("load-bar");
    const received = bytes(session.head.length + stats.bytesReceived);
    let line = t("complete", { received });
    let isLoading = false;
    const { limitedFor, held } = session.pack;
    // Whoever waits: the view, a measurement, or what reads the end of the file.
    if (limitedFor > 0 && held > 0) {
      line = t("limited", { seconds: limitedFor });
    } else if (stats.retryInMs >= 0 && stats.requestsInFlight === 0) {
      const seconds = Math.max(1, Math.ceil(stats.retryInMs / 1000));
      const isOffline = !navigator.onLine || session.lastFailure?.kind === "offline";
      line = t(isOffline ? "offline" : "retrying", { seconds });
    } else if (stats.bytesMissing > 0 || stats.chunksMissing > 0) {
      line = t("toLoad", { missing: bytes(stats.bytesMissing) });
      isLoading = true;
    } else if (stats.cutOff) {
      line = t("cutOff");
    } else if (stats.budgetLimited) {
      line = t("memoryFull");
    }
    text("load", line);
    bar.hidden = !isLoading;
    bar.value = stats.bytesWanted > 0 ? 1 - stats.bytesMissing / stats.bytesWanted : 0;
  }

  /**
   * All figures, for the Statistics tab.
   * @param {HTMLElement} into
   * @param {FrameStats} stats
   * @param {Session} session
   */
  list(into, stats, session) {
    fill(into, [
      [t("drawn"), count(stats.trianglesDrawn)],
      [t("pixelError"), t("pixels", { n: pixels(stats.worstPixelError) })],
      [t("surfaceError"), length(stats.worstErrorMetres)],
      [t("chunks"), count(stats.chunksResident)],
      [t("gpuMemory"), t("memoryOf", { used: bytes(stats.gpuBytes), limit: bytes(stats.gpuLimit) })],
      [t("received"), t("memoryOf", { used: bytes(session.head.length + stats.bytesReceived), limit: bytes(Number(session.pack.bytes)) })],
      [t("requests"), count(session.pack.requests)],
      [t("failures"), count(stats.failures)],
    ]);
  }
}

/**
 * @param {"accuracy" | "scale-text" | "load"} id
 * @param {string} value
 */
function text(id, value) {
  const element = $(id);
  if (element.textContent !== value) element.textContent = value;
}
