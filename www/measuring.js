// The way to measuring. Its code (measure/) and the program behind it are loaded when they are first needed: when a tool is chosen, the tab
// is opened, or the browser or the address has measurements of this pack. Until then it costs nothing.

import { hint, notice, openTab, peek } from "./chrome.js";
import { $ } from "./dom.js";
import { t } from "./i18n.js";
import { why } from "./messages.js";
import { get } from "./store.js";

/** @import { FrameStats, Placing, Tool } from "./types/page.js" */
/** @import { Model } from "./model.js" */
/** @import { Scene } from "./scene.js" */
/** @import { Measure } from "./measure/measure.js" */

/**
 * What measuring needs of the page.
 * @typedef {object} MeasuringPage
 * @property {import("./undo.js").Undo} undo
 * @property {import("./link.js").Address} address
 * @property {import("./display.js").Display} display
 * @property {import("./api.js").Api["emit"]} emit events of the page's API
 * @property {(name: Tool, which?: string) => void} tool choose a tool of the page; `which`: a tool of the Measurements tab
 * @property {() => import("./link.js").Linked} state what the address holds
 * @property {() => number[][]} pins boxes of the pins of notes in the picture, CSS pixels
 */

/** The program behind the tools: it is loaded together with their code. Packs of points have one of their own. @param {Model} model */
async function compiled({ info }) {
  const url = new URL(info.pack.points ? "measure-points_bg.wasm" : "measure_bg.wasm", import.meta.url);
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url.pathname}: ${response.status}`);
  return WebAssembly.compile(await response.arrayBuffer());
}

export class Measuring {
  /** @param {MeasuringPage} page */
  constructor(page) {
    this.page = page;
    /** Once its code is there. @type {Measure | null} */
    this.tools = null;
    /** @type {Promise<Measure> | null} */
    this.loading = null;
    /** Measurements of the address that opened the page. @type {string | null} */
    this.linked = null;
    /** @type {{scene: Scene, model: Model} | null} */
    this.open = null;
    this.seen = false;
    /** @type {Promise<WebAssembly.Module> | null} */
    this.compiling = null;
    const load = () => this.load().catch(() => {});
    for (const event of ["click", "focus"]) $("tab-measure").addEventListener(event, load);
  }

  /**
   * The picture of a pack is (again) there.
   * @param {Scene} scene
   * @param {Model} model
   * @param {string | null} linked what the address names
   */
  attach(scene, model, linked) {
    this.open = { scene, model };
    this.tools?.attach(scene);
    if (linked && !this.seen) this.linked = linked;
    this.seen = true;
    // The first picture first.
    const isOpen = !$("measure").hidden;
    if (isOpen || this.linked || get(`measurements.${model.hash}`)?.length > 0) scene.session.firstPicture.then(() => this.load().catch(() => {}));
  }

  /** Another pack will be opened. */
  close() {
    this.tools?.close();
    this.tools = this.loading = this.linked = this.open = this.compiling = null;
    this.seen = false;
  }

  /** A promise of the program, for the worker; what failed is fetched again the next time. */
  program() {
    if (!this.open) return Promise.reject(new Error("the model is not open"));
    this.compiling ??= compiled(this.open.model).catch((error) => {
      this.compiling = null;
      throw error;
    });
    return this.compiling;
  }

  /**
   * The tools, loaded where they are not.
   * @returns {Promise<Measure>}
   */
  load() {
    if (!this.open) return Promise.reject(new Error("the model is not open"));
    const { model } = this.open;
    this.loading ??= (async () => {
      this.program().catch(() => {}); // whoever measures hears of it
      try {
        const { Measure, styles } = await import("./measure/measure.js");
        await styles();
        if (this.open?.model !== model) throw new Error("another model was opened");
        this.tools = new Measure({ model, page: this.page, program: () => this.program() }, this.linked);
        this.tools.attach(this.open.scene);
        return this.tools;
      } catch (error) {
        this.loading = null; // The next press tries again.
        if (this.open?.model === model) notice(t("measureFailed", { why: why(error) }), 10000);
        throw error;
      }
    })();
    return this.loading;
  }

  /**
   * Choose a tool: the one named, else the last one.
   * @param {string | null} name
   */
  async start(name) {
    openTab("measure");
    peek();
    if (!this.tools) hint(t("measureLoading"));
    const tools = await this.load().catch(() => null);
    if (this.open?.scene.input.tool !== "measure") return;
    if (tools) tools.start(name);
    else this.page.tool("orbit");
  }

  /** The next step of the tool in use. @returns {string | null} */
  get hint() {
    return this.tools?.hint() ?? null;
  }

  /** Another tool of the page was chosen. */
  leave() {
    this.tools?.leave();
  }

  /**
   * @param {number} x
   * @param {number} y
   * @param {Placing} how
   */
  place(x, y, how) {
    this.tools?.place(x, y, how);
  }

  /**
   * @param {number} x
   * @param {number} y
   */
  hover(x, y) {
    this.tools?.hover(x, y);
  }

  /**
   * A key while a tool is chosen; false where it means nothing.
   * @param {string} key
   */
  key(key) {
    return this.tools?.key(key) ?? false;
  }

  /** @param {FrameStats} stats */
  frame(stats) {
    this.tools?.frame(stats);
  }

  /**
   * Undo and redo inside what is being drawn; false where nothing is.
   * @param {boolean} isRedo
   */
  undo(isRedo) {
    return this.tools?.undoPoint(isRedo) ?? false;
  }

  /** What the address holds of them; what it was opened with until they are loaded. */
  get address() {
    return this.tools ? this.tools.address() : this.linked;
  }

  translate() {
    this.tools?.translate();
  }
}
