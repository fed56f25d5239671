// The way to measuring. Its code (measure/) and the program behind it are loaded when they are first needed: when a tool is chosen, the tab
// is opened, or the browser or the address has measurements of this pack. Until then it costs nothing.

import { hint, notice, openTab, peek } from "./chrome.js";
import { t } from "./i18n.js";
import { why } from "./said.js";
import { get } from "./store.js";

/** The program behind the tools: it comes while their code does. */
async function compiled() {
  const url = new URL("measure_bg.wasm", import.meta.url);
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url.pathname}: ${response.status}`);
  return WebAssembly.compile(await response.arrayBuffer());
}

export class Measuring {
  /** @param {object} page the page (app.js) */
  constructor(page) {
    this.page = page;
    this.tools = null; // measure/measure.js, once it is there
    this.loading = null;
    this.linked = null; // measurements of the address that opened the page
    const load = () => this.load().catch(() => {});
    document.getElementById("tab-measure").addEventListener("click", load);
    document.getElementById("tab-measure").addEventListener("focus", load);
  }

  /** The picture of a pack is (again) there. `linked` is what the address names. */
  attach(viewer, session, linked = null) {
    this.viewer = viewer;
    this.session = session;
    this.tools?.attach(viewer, session);
    if (linked && !this.seen) this.linked = linked;
    this.seen = true;
    // The first picture first.
    const isOpen = !document.getElementById("measure").hidden;
    if (isOpen || this.linked || get(`measurements.${this.page.info.pack.hash}`)?.length > 0) session.firstPicture.then(() => this.load().catch(() => {}));
  }

  /** Another pack will be opened. */
  close() {
    this.tools?.close();
    this.tools = this.loading = this.linked = null;
    this.seen = false;
  }

  /** A promise of the program, for the worker; what failed is fetched again the next time. */
  program() {
    this.compiling ??= compiled().catch((error) => {
      this.compiling = null;
      throw error;
    });
    return this.compiling;
  }

  /** The tools, loaded where they are not. */
  load() {
    const { page } = this;
    if (!page.info || !this.viewer) return Promise.reject(new Error("the model is not open"));
    this.loading ??= (async () => {
      const { pack } = page;
      this.program().catch(() => {}); // whoever measures hears of it
      try {
        const { Measure, styles } = await import("./measure/measure.js");
        await styles();
        if (page.pack !== pack) throw new Error("another model was opened");
        this.tools = new Measure(page, this.linked);
        this.tools.attach(this.viewer, this.session);
        return this.tools;
      } catch (error) {
        this.loading = null; // The next press tries again.
        if (page.pack === pack) notice(t("measureFailed", { why: why(error) }), 10000);
        throw error;
      }
    })();
    return this.loading;
  }

  /** Choose a tool: the one named, else the last one. */
  async start(name) {
    openTab("measure");
    peek();
    if (!this.tools) hint(t("measureLoading"));
    const tools = await this.load().catch(() => null);
    if (this.page.input.tool !== "measure") return;
    if (tools) tools.start(name);
    else this.page.tool("orbit");
  }

  get hint() {
    return this.tools?.hint() ?? null;
  }

  /** Another tool of the page was chosen. */
  leave() {
    this.tools?.leave();
  }

  place(x, y, how) {
    this.tools?.place(x, y, how);
  }

  hover(x, y) {
    this.tools?.hover(x, y);
  }

  /** A key while a tool is chosen; false where it means nothing. */
  key(key) {
    return this.tools?.key(key) ?? false;
  }

  frame(stats) {
    this.tools?.frame(stats);
  }

  /** Undo and redo inside what is being drawn; false where nothing is. */
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
