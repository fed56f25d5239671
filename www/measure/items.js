// The list of measurements of a pack: kept by the browser with every change, and every change can be undone.

import { notice } from "../chrome.js";
import { t } from "../i18n.js";
import { moved } from "../list.js";
import { get, put, unique } from "../store.js";
import { read as readAddress, write as writeAddress } from "./address.js";
import { Task } from "./task.js";
import { kindName } from "./tools.js";

/** @import { MeasureItem, MeasureRecord, MeasureTool } from "../types/page.js" */

/** Most measurements of a pack. */
export const MAX_ITEMS = 1000;
/** Of a measurement that nobody coloured. */
export const COLOR = "#1668c7";

/**
 * @typedef {object} ItemEvents
 * @property {() => void} changed the list, or something of it
 * @property {() => void} kept the browser keeps it as it is now
 * @property {(count: number) => void} counted how many there are
 * @property {(item: MeasureItem) => void} arrived it is to be measured
 */

export class Items {
  /**
   * @param {object} parts
   * @param {string} parts.hash the header's, under which the browser keeps them
   * @param {number[]} parts.origin the lattice's
   * @param {import("../undo.js").Undo} parts.undo
   * @param {ItemEvents} parts.on
   */
  constructor({ hash, origin, undo, on }) {
    this.key = `measurements.${hash}`;
    this.origin = origin;
    this.undo = undo;
    this.on = on;
    /** @type {MeasureItem[]} */
    this.all = [];
    /** Id of the one that is open. @type {string | null} */
    this.chosen = null;
    /** The list before a note was written. @type {MeasureItem[] | null} */
    this.before = null;
    this.toldNotKept = false;
  }

  /**
   * Those that the browser keeps, and those of the address that opened the page.
   * @param {string | null} linked
   */
  restore(linked) {
    const kept = get(this.key, []);
    this.all = (Array.isArray(kept) ? kept : []).flatMap((one) => this.item(one) ?? []);
    if (linked) {
      const { found, left } = readAddress(linked);
      const plain = (/** @type {MeasureRecord} */ one) => writeAddress([{ ...one, name: "", color: undefined, hidden: false }]);
      const have = new Set(this.all.map(({ task }) => plain(task.record())));
      const added = found.filter((one) => !have.has(plain(one))).flatMap((one) => this.item(one) ?? []);
      if (added.length > 0) this.change("editLink", [...this.all, ...added]);
      if (left > 0) notice(t("measureLinkCut", { count: left }), 10000);
    }
    for (const item of this.all) this.on.arrived(item);
  }

  /**
   * A measurement from plain data; null where it is none.
   * @param {MeasureRecord} one
   * @returns {MeasureItem | null}
   */
  item(one) {
    try {
      const { id = unique(), name = "", color = COLOR, hidden = false, note = "", foreign = null } = one;
      const task = Task.of(one, this.origin);
      return { id, name: name || this.#newName(task.kind), color, hidden, note, foreign, task };
    } catch {
      return null;
    }
  }

  /** @param {MeasureTool} kind */
  #newName(kind) {
    const same = this.all.filter(({ task }) => task.kind.key === kind.key || (task.tool === "section" && kind.tool === "section")).length;
    return `${kindName(kind)} ${same + 1}`;
  }

  /** @param {string | null} id */
  find(id) {
    return this.all.find((item) => item.id === id) ?? null;
  }

  /** @param {Task} task */
  of(task) {
    return this.all.find((item) => item.task === task) ?? null;
  }

  /** As they are kept: the fields of a file's measurement, and what is not final. */
  keep() {
    const kept = this.all.map(({ id, name, color, hidden, note, foreign, task }) => {
      const { local, ...record } = task.record();
      const isFound = task.points.every((p) => p.isFinal);
      const places = isFound ? { local } : { rays: task.points.map((p) => p.ray) };
      const result = task.isFinal ? { readings: task.readings, uncertainty: task.uncertainty, date: task.date, fitted: task.fitted } : {};
      return { id, name, color, hidden, note, foreign, kind: task.kind.id, ...record, ...places, ...result };
    });
    if (!put(this.key, kept.length > 0 ? kept : null) && !this.toldNotKept) {
      this.toldNotKept = true;
      notice(t("notKept"));
    }
    this.on.kept();
  }

  /**
   * Another list, as an edit that can be taken back.
   * @param {string} name key of the message that names the edit
   * @param {MeasureItem[]} items
   * @param {MeasureItem[]} before
   */
  change(name, items, before = this.all) {
    const set = (/** @type {MeasureItem[]} */ list) => {
      this.all = list;
      if (!list.some((i) => i.id === this.chosen)) this.chosen = null;
      this.keep();
      this.on.changed();
      this.on.counted(list.length);
    };
    this.undo.do({
      scope: "measurements",
      name,
      undo: () => set(before),
      redo: () => {
        set(items);
        for (const item of items) this.on.arrived(item);
      },
    });
  }

  /**
   * One measurement with another name, colour, point or place in the list.
   * @param {string} name key of the message that names the edit
   * @param {string} id
   * @param {Partial<MeasureItem>} fields
   */
  update(name, id, fields) {
    this.change(
      name,
      this.all.map((i) => (i.id === id ? { ...i, ...fields } : i)),
    );
  }

  /**
   * A note while it is written: kept with every letter; one edit when it is left.
   * @param {string} id
   * @param {string} note
   */
  type(id, note) {
    this.before ??= this.all;
    this.all = this.all.map((i) => (i.id === id ? { ...i, note } : i));
    this.keep();
  }

  /** The note is written. */
  typed() {
    const { before } = this;
    this.before = null;
    if (before && before !== this.all) this.change("editNote", this.all, before);
  }

  /**
   * Measurements of a file, as one edit; what is here already stays as it is.
   * @param {MeasureRecord[]} records
   */
  take(records) {
    const signature = (/** @type {MeasureItem} */ item) => JSON.stringify([item.name, item.note, item.task.record()]);
    const have = new Set(this.all.map(signature));
    const all = records.flatMap((one) => this.item({ ...one, id: unique() }) ?? []);
    const more = all.filter((item) => !have.has(signature(item)));
    const count = this.all.length + more.length;
    if (count > MAX_ITEMS) throw new Error(t("importTooMany", { count, most: MAX_ITEMS }));
    if (more.length > 0) this.change("editImport", [...this.all, ...more]);
    notice(t("imported", { count: all.length }), 6000);
  }

  /**
   * A new one; null where there are too many.
   * @param {Task} task
   * @param {Partial<MeasureItem>} more
   */
  add(task, more = {}) {
    if (this.all.length >= MAX_ITEMS) {
      notice(t("importTooMany", { count: this.all.length + 1, most: MAX_ITEMS }));
      return null;
    }
    const item = { id: unique(), name: this.#newName(task.kind), color: COLOR, hidden: false, note: "", foreign: null, task, ...more };
    this.chosen = item.id;
    this.change("editMeasure", [...this.all, item]);
    return item;
  }

  /**
   * @param {MeasureItem} item
   * @param {number} by
   */
  move(item, by) {
    this.change("editReorder", moved(this.all, item, by));
  }

  /** @param {MeasureItem} item */
  remove(item) {
    this.change(
      "editDelete",
      this.all.filter((i) => i.id !== item.id),
    );
    this.offerUndo(t("deleted", { name: item.name }));
  }

  removeAll() {
    const count = this.all.length;
    this.change("editDeleteAll", []);
    this.offerUndo(t("measureAllDeleted", { count }));
  }

  /**
   * Report a change, with a button that takes it back.
   * @param {string} text
   */
  offerUndo(text) {
    notice(text, 10000, { label: t("undo"), run: () => this.undo.undo("measurements") });
  }
}
