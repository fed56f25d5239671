// The Notes tab: the list, the form, files, and what the browser keeps. annotations.js knows the format, pins.js draws
// the pins, tour.js shows the note that is open.
//
// The person's own notes are kept by the browser for each pack. Where the host publishes notes (`?annotations=`), they
// are shown until the person changes something; from then on the person's copy is, and the published ones can be had back.

import { annotationPage, findNote, MAX_NOTES, parseAnnotations, safeLink, shortId } from "./annotations.js";
import { notice, openTab, peek } from "./chrome.js";
import { $ } from "./dom.js";
import { t } from "./i18n.js";
import { EditList, moved } from "./list.js";
import { Pins } from "./pins.js";
import { download, fileName, get, put, readJson, unique } from "./store.js";
import { Tour } from "./tour.js";

/** @import { DisplayState, Note, Seen } from "./types/page.js" */
/** @import { Scene } from "./scene.js" */

const FILE_LIMIT = 16e6;

export class Notes {
  /**
   * @param {object} parts
   * @param {string} parts.hash the header's, under which the browser keeps them
   * @param {import("./identity.js").Identity} parts.identity
   * @param {string} parts.title
   * @param {string | null} parts.pack the pack's address; null for one of this computer
   * @param {import("./undo.js").Undo} parts.undo
   * @param {() => Seen} parts.now what is seen now
   * @param {(note: Note, isJump: boolean) => void} parts.look fly to a note
   * @param {(name: "orbit" | "note") => void} parts.tool choose a tool
   * @param {(name: "annotation" | "annotations", detail: object) => void} parts.emit events of the page's API
   * @param {() => void} parts.shareAddress copy the address
   */
  constructor({ hash, identity, title, pack, undo, now, look, tool, emit, shareAddress }) {
    this.hash = hash;
    this.identity = identity;
    this.title = title;
    this.pack = pack;
    this.undo = undo;
    this.now = now;
    this.look = look;
    this.tool = tool;
    this.emit = emit;
    this.shareAddress = shareAddress;
    this.abort = new AbortController();
    /** Those of the host. @type {Note[] | null} */
    this.published = null;
    /** What the browser keeps; null where the person changed nothing. @type {Note[] | null} */
    this.stored = get(`notes.${this.hash}`);
    /** @type {Note[]} */
    this.notes = Array.isArray(this.stored) ? this.stored : [];
    this.shown = true;
    /** The note whose place is being chosen anew. @type {Note | null} */
    this.replacing = null;
    /** Id of the note in the form. @type {string | null} */
    this.editing = null;
    /** The list before the form was opened. @type {Note[] | null} */
    this.before = null;
    /** @type {Pins | null} */
    this.pins = null;
    this.tour = new Tour({
      signal: this.abort.signal,
      notes: () => this.notes,
      go: (note) => this.open(note),
      edit: (note) => this.edit(note),
      share: (note) => this.share(note),
      onClose: () => {
        this.pins?.current(null);
        this.#mark(null);
        this.emit("annotation", { id: null });
      },
    });
    /** @type {EditList<Note>} */
    this.list = new EditList($("notes-list"), {
      name: (note) => note.title || t("noteUnnamed"),
      go: (note) => this.open(note, { focus: true }),
      rename: null,
      edit: (note) => this.edit(note),
      move: (note, by) => this.change("editReorder", moved(this.notes, note, by)),
      remove: (note) => this.remove(note),
    });
    this.#form();
    this.show();
  }

  close() {
    this.abort.abort();
    this.pins?.close();
  }

  /**
   * The picture is (again) there: pins go over it.
   * @param {Scene} scene
   */
  attach({ viewer, session }) {
    this.pins?.close();
    this.pins = new Pins({ viewer, session, open: (note) => this.open(note) });
    this.pins.set(this.notes);
    this.pins.show(this.shown);
  }

  /**
   * Notes that the host publishes.
   * @param {unknown} json
   */
  publish(json) {
    const { notes, left } = parseAnnotations(json);
    this.published = notes;
    if (!Array.isArray(this.stored)) this.notes = notes;
    if (left > 0) notice(t("importLeft", { count: left }), 10000);
    this.show();
  }

  show() {
    this.list.show(this.notes);
    $("notes-none").hidden = this.notes.length > 0;
    $("tour-start").hidden = this.notes.length === 0;
    $("notes-export").disabled = this.notes.length === 0;
    $("notes-own").hidden = !(this.published && Array.isArray(this.stored));
    this.pins?.set(this.notes);
    const open = this.tour.note;
    if (open) {
      const note = this.notes.find((n) => n.id === open.id);
      if (note) this.tour.show(note);
      else this.tour.close();
    }
  }

  /** @param {boolean} shown */
  setShown(shown) {
    this.shown = shown;
    $("notes-shown").checked = shown;
    this.pins?.show(shown);
  }

  /**
   * Look at a note and show its card; `isJump`: the view that is left gets an entry of the history.
   * @param {Note} note
   * @param {{focus?: boolean, fly?: boolean, isJump?: boolean}} how
   */
  open(note, { focus = false, fly = true, isJump = true } = {}) {
    peek();
    if (fly) this.look(note, isJump);
    this.tour.show(note, { focus });
    this.pins?.current(note.id);
    this.#mark(note.id);
    if (!this.shown) this.setShown(true);
    this.emit("annotation", { id: note.id });
  }

  /** @param {string | null} id */
  #mark(id) {
    this.list.current = id;
    this.list.show(this.notes);
  }

  /**
   * Open the note of an address; false where there is none.
   * @param {string} name
   * @param {{fly?: boolean, isJump?: boolean}} [options]
   */
  openNamed(name, options) {
    const note = findNote(this.notes, name);
    if (note) this.open(note, options);
    return Boolean(note);
  }

  get openId() {
    return this.tour.note ? shortId(this.tour.note.id) : null;
  }

  /**
   * The person chose a place on the surface.
   * @param {number[]} place
   */
  place([x, y, z]) {
    const now = new Date().toISOString();
    if (this.replacing) {
      const { id } = this.replacing;
      this.replacing = null;
      this.tool("orbit");
      this.change(
        "editNotePlace",
        this.notes.map((n) => (n.id === id ? { ...n, place: [x, y, z], modified: now } : n)),
      );
      this.editById(id);
      return;
    }
    if (this.notes.length >= MAX_NOTES) {
      notice(t("importTooMany", { count: this.notes.length + 1, most: MAX_NOTES }));
      return;
    }
    const note = { id: `urn:uuid:${unique()}`, title: "", text: "", link: "", place: [x, y, z], ...this.now(), created: now, modified: now };
    this.tool("orbit");
    this.change("editNoteAdd", [...this.notes, note]);
    this.edit(note);
  }

  /**
   * Add a note for a script.
   * @param {{title?: string, text?: string, link?: string, place: number[], camera?: number[] | null, display?: DisplayState | null}} note
   */
  add({ title = "", text = "", link = "", place, camera = null, display = null }) {
    if (!Array.isArray(place) || place.length !== 3 || !place.every(Number.isFinite)) throw new TypeError("place: three numbers, metres");
    if (link && !safeLink(link)) throw new TypeError("link: an http or https address");
    const now = new Date().toISOString();
    const note = {
      id: `urn:uuid:${unique()}`,
      title: String(title),
      text: String(text),
      link: safeLink(link) ?? "",
      place,
      camera,
      display,
      created: now,
      modified: now,
    };
    this.change("editNoteAdd", [...this.notes, note]);
    return note.id;
  }

  /** @param {Note} note */
  remove(note) {
    const at = this.notes.findIndex((n) => n.id === note.id);
    this.closeForm();
    this.change(
      "editDelete",
      this.notes.filter((n) => n.id !== note.id),
    );
    notice(t("deleted", { name: note.title || `${t("note")} ${at + 1}` }), 10000, { label: t("undo"), run: () => this.undo.undo("notes") });
  }

  /**
   * Another list, as an edit that can be taken back.
   * @param {string} name key of the message that names the edit
   * @param {Note[]} notes
   * @param {Note[]} before
   */
  change(name, notes, before = this.notes) {
    const stored = this.stored;
    const set = (/** @type {Note[]} */ list, /** @type {Note[] | null} */ kept) => {
      this.notes = list;
      this.stored = kept;
      if (!put(`notes.${this.hash}`, kept)) notice(t("notKept"));
      this.show();
      this.emit("annotations", { count: list.length });
    };
    this.undo.do({ scope: "notes", name, undo: () => set(before, stored && before), redo: () => set(notes, notes) });
  }

  #form() {
    const form = $("note-form");
    const { signal } = this.abort;
    form.addEventListener(
      "submit",
      (event) => {
        event.preventDefault();
        this.#submit();
      },
      { signal },
    );
    form.addEventListener(
      "keydown",
      (event) => {
        if (event.key !== "Escape") return;
        event.stopPropagation();
        this.#submit();
      },
      { signal },
    );
    // Kept with every letter, so that a reload loses nothing; one edit to undo when the form is left.
    form.addEventListener("input", () => this.#type(), { signal });
    $("note-form-camera").addEventListener(
      "click",
      () => {
        this.#type(this.now());
        notice(t("noteCameraKept"));
      },
      { signal },
    );
    $("note-form-place").addEventListener(
      "click",
      () => {
        this.replacing = this.edited;
        this.closeForm();
        this.tool("note");
      },
      { signal },
    );
    $("note-form-delete").addEventListener("click", () => this.edited && this.remove(this.edited), { signal });
  }

  /** The note in the form. */
  get edited() {
    return this.notes.find((n) => n.id === this.editing) ?? null;
  }

  /** @param {string} id */
  editById(id) {
    const note = this.notes.find((n) => n.id === id);
    if (note) this.edit(note);
  }

  /** @param {Note} note */
  edit(note) {
    this.closeForm();
    this.tour.close();
    openTab("notes");
    this.editing = note.id;
    this.before = this.notes;
    const at = this.notes.findIndex((n) => n.id === note.id);
    $("note-form-title").textContent = `${t("note")} ${at + 1}`;
    $("note-form-name").value = note.title;
    $("note-form-text").value = note.text;
    $("note-form-link").value = note.link;
    $("note-form-error").hidden = true;
    $("notes-view").hidden = true;
    $("note-form").hidden = false;
    this.pins?.current(note.id);
    $("note-form-name").focus();
  }

  /** @param {Partial<Note>} more */
  #type(more = {}) {
    const link = $("note-form-link").value.trim();
    const fields = {
      title: $("note-form-name").value.trim(),
      text: $("note-form-text").value,
      link: safeLink(link) ?? "",
      modified: new Date().toISOString(),
      ...more,
    };
    this.notes = this.notes.map((n) => (n.id === this.editing ? { ...n, ...fields } : n));
    this.stored = this.notes;
    if (!put(`notes.${this.hash}`, this.notes)) notice(t("notKept"));
    this.pins?.set(this.notes);
  }

  #submit() {
    const link = $("note-form-link").value.trim();
    if (link && !safeLink(link)) {
      $("note-form-error").textContent = t("noteLinkBad");
      $("note-form-error").hidden = false;
      $("note-form-link").focus();
      return;
    }
    const { editing } = this;
    this.closeForm();
    const note = this.notes.find((n) => n.id === editing);
    if (note) this.open(note, { fly: false });
    $("note-new").focus();
  }

  closeForm() {
    if (!this.editing) return;
    this.editing = null;
    $("note-form").hidden = true;
    $("notes-view").hidden = false;
    this.pins?.current(null);
    if (this.before && this.before !== this.notes) this.change("editNote", this.notes, this.before);
    this.before = null;
  }

  /** @param {Note} note */
  share(note) {
    this.open(note, { fly: false });
    this.shareAddress();
  }

  async export() {
    const identity = await this.identity.known();
    const json = annotationPage(this.notes, { source: this.pack ?? `urn:kilwa:${this.identity.name}`, identity });
    download(fileName(this.title, ".annotations.json"), new Blob([JSON.stringify(json, null, 1)], { type: "application/ld+json" }));
  }

  /** @param {File} file */
  async import(file) {
    try {
      const { notes, left, identities } = parseAnnotations(await readJson(file, FILE_LIMIT));
      const ids = new Set(notes.map((n) => n.id));
      this.change("editImport", [...this.notes.filter((n) => !ids.has(n.id)), ...notes]);
      const here = await Promise.all(identities.map((one) => this.identity.isHere(one)));
      const words = [t("imported", { count: notes.length }), left > 0 && t("importLeft", { count: left }), here.includes(false) && t("otherFile")];
      notice(words.filter(Boolean).join(" "), here.includes(false) ? 20000 : 10000);
    } catch (error) {
      notice(t("importFailed", { why: error.message }), 12000);
    }
  }

  /** The published ones again. */
  revert() {
    const { notes: before, stored, published } = this;
    if (!published) return;
    const set = (/** @type {Note[]} */ list, /** @type {Note[] | null} */ kept) => {
      this.notes = list;
      this.stored = kept;
      put(`notes.${this.hash}`, kept);
      this.show();
    };
    this.undo.do({ scope: "notes", name: "editPublished", undo: () => set(before, stored), redo: () => set(published, null) });
  }
}
