// Saved views: camera and display under a name, in the person's order, kept by the browser for each pack, and as a file.
//
// The file: `{"type": "KilwaViews", "version": 1, "pack": identity, "views": [{"name", "camera": [7 to 9 numbers], "display"}]}`.

import { isCamera } from "./camera.js";
import { notice } from "./chrome.js";
import { $ } from "./dom.js";
import { t } from "./i18n.js";
import { EditList, moved } from "./list.js";
import { download, fileName, get, put, readJson, unique } from "./store.js";

/** @import { SavedView, Seen } from "./types/page.js" */

const MAX_VIEWS = 1000;

/**
 * Views from a file's JSON; throws an error whose message names what is wrong and where.
 * @param {any} json
 * @returns {SavedView[]}
 */
export function parseViews(json) {
  if (json?.type !== "KilwaViews" || !Array.isArray(json.views)) throw new Error(t("importNoViews"));
  if (json.views.length > MAX_VIEWS) throw new Error(t("importTooMany", { count: json.views.length, most: MAX_VIEWS }));
  return json.views.map((/** @type {any} */ view, /** @type {number} */ at) => {
    const camera = view?.camera;
    if (!isCamera(camera)) throw new Error(t("importBadView", { number: at + 1 }));
    const name =
      String(view.name ?? "")
        .trim()
        .slice(0, 200) || t("viewNumber", { number: at + 1 });
    const display = view.display && typeof view.display === "object" ? view.display : null;
    return { id: unique(), name, camera, display };
  });
}

export class Saved {
  /**
   * @param {object} parts
   * @param {string} parts.hash the header's, under which the browser keeps them
   * @param {import("./identity.js").Identity} parts.identity
   * @param {string} parts.title
   * @param {import("./undo.js").Undo} parts.undo
   * @param {() => Seen} parts.now
   * @param {(view: SavedView) => void} parts.go
   */
  constructor({ hash, identity, title, undo, now, go }) {
    this.hash = hash;
    this.identity = identity;
    this.title = title;
    this.undo = undo;
    this.now = now;
    /** @type {SavedView[]} */
    this.views = get(`views.${hash}`, []);
    /** @type {EditList<SavedView>} */
    this.list = new EditList($("saved-list"), {
      name: (view) => view.name,
      go: (view) => go(view),
      rename: (view, name) =>
        this.#change(
          "editRename",
          this.views.map((v) => (v.id === view.id ? { ...v, name } : v)),
        ),
      edit: null,
      move: (view, by) => this.#change("editReorder", moved(this.views, view, by)),
      remove: (view) => this.#remove(view),
    });
    this.show();
  }

  show() {
    this.list.show(this.views);
    $("saved-none").hidden = this.views.length > 0;
    $("saved-export").disabled = this.views.length === 0;
  }

  /**
   * Save what is seen now, under a name that can be changed at once.
   * @param {string | null} name
   */
  add(name = null) {
    const numbers = this.views.length + 1;
    const view = { id: unique(), name: name ?? t("viewNumber", { number: numbers }), ...this.now() };
    this.#change("editView", [...this.views, view]);
    return view;
  }

  /** @param {SavedView} view */
  #remove(view) {
    this.#change(
      "editDelete",
      this.views.filter((v) => v !== view),
    );
    notice(t("deleted", { name: view.name }), 10000, { label: t("undo"), run: () => this.undo.undo("views") });
  }

  /**
   * @param {string} name key of the message that names the edit
   * @param {SavedView[]} views
   */
  #change(name, views) {
    const before = this.views;
    const set = (/** @type {SavedView[]} */ list) => {
      this.views = list;
      if (!put(`views.${this.hash}`, list)) notice(t("notKept"));
      this.show();
    };
    this.undo.do({ scope: "views", name, undo: () => set(before), redo: () => set(views) });
  }

  async export() {
    await this.identity.known();
    const views = this.views.map(({ name, camera, display }) => ({ name, camera, ...(display ? { display } : {}) }));
    const json = { type: "KilwaViews", version: 1, pack: this.identity.name, views };
    download(fileName(this.title, ".views.json"), new Blob([JSON.stringify(json, null, 1)], { type: "application/json" }));
  }

  /** @param {File} file */
  async import(file) {
    try {
      const json = await readJson(file);
      const views = parseViews(json);
      this.#change("editImport", [...this.views, ...views]);
      const isHere = typeof json.pack !== "string" || (await this.identity.isHere(json.pack));
      const words = t("imported", { count: views.length });
      notice(isHere ? words : `${words} ${t("otherFile")}`, isHere ? 6000 : 20000);
    } catch (error) {
      notice(t("importFailed", { why: error.message }), 12000);
    }
  }
}
