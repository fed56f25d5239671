// Saved views: camera and display under a name, in the person's order, kept by the browser for each pack, and as a file.
//
// The file: `{"type": "KilwaViews", "version": 1, "pack": identity, "views": [{"name", "camera": [7 to 9 numbers], "display"}]}`.

import { notice } from "./chrome.js";
import { t } from "./i18n.js";
import { EditList, moved } from "./list.js";
import { download, fileName, get, put, readJson, unique } from "./store.js";

const $ = (id) => document.getElementById(id);
const MOST = 1000;

/** Views from a file's JSON; throws a sentence that says what is wrong and where. */
export function parseViews(json) {
  if (json?.type !== "KilwaViews" || !Array.isArray(json.views)) throw new Error(t("importNoViews"));
  if (json.views.length > MOST) throw new Error(t("importTooMany", { count: json.views.length, most: MOST }));
  return json.views.map((view, at) => {
    const camera = view?.camera;
    const isCamera = Array.isArray(camera) && camera.length >= 7 && camera.length <= 9 && camera.every(Number.isFinite) && camera[2] > 0;
    if (!isCamera) throw new Error(t("importBadView", { number: at + 1 }));
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
   * @param {() => {camera: number[], display: object | null}} parts.now
   * @param {(view: object) => void} parts.go
   */
  constructor({ hash, identity, title, undo, now, go }) {
    Object.assign(this, { hash, identity, title, undo, now, go });
    this.views = get(`views.${hash}`, []);
    this.list = new EditList($("saved-list"), {
      name: (view) => view.name,
      go: (view) => go(view),
      rename: (view, name) => this.#change(this.views.map((v) => (v.id === view.id ? { ...v, name } : v))),
      edit: null,
      move: (view, by) => this.#change(moved(this.views, view, by)),
      remove: (view) => this.#remove(view),
    });
    this.show();
  }

  show() {
    this.list.show(this.views);
    $("saved-none").hidden = this.views.length > 0;
    $("saved-export").disabled = this.views.length === 0;
  }

  /** Save what is seen now, under a name that can be changed at once. */
  add(name = null) {
    const numbers = this.views.length + 1;
    const view = { id: unique(), name: name ?? t("viewNumber", { number: numbers }), ...this.now() };
    this.#change([...this.views, view]);
    return view;
  }

  #remove(view) {
    this.#change(this.views.filter((v) => v !== view));
    notice(t("deleted", { name: view.name }), 10000, { label: t("undo"), run: () => this.undo.undo() });
  }

  #change(views) {
    const before = this.views;
    const set = (list) => {
      this.views = list;
      if (!put(`views.${this.hash}`, list)) notice(t("notKept"));
      this.show();
    };
    this.undo.do({ undo: () => set(before), redo: () => set(views) });
  }

  async export() {
    await this.identity.known();
    const views = this.views.map(({ name, camera, display }) => ({ name, camera, ...(display ? { display } : {}) }));
    const json = { type: "KilwaViews", version: 1, pack: this.identity.name, views };
    download(fileName(this.title, ".views.json"), new Blob([JSON.stringify(json, null, 1)], { type: "application/json" }));
  }

  async import(file) {
    try {
      const json = await readJson(file);
      const views = parseViews(json);
      this.#change([...this.views, ...views]);
      const isHere = typeof json.pack !== "string" || (await this.identity.isHere(json.pack));
      const words = t("imported", { count: views.length });
      notice(isHere ? words : `${words} ${t("otherFile")}`, isHere ? 6000 : 20000);
    } catch (error) {
      notice(t("importFailed", { why: error.message }), 12000);
    }
  }
}
