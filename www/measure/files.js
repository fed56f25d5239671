// Measurements as files: JSON that reads back to the last bit, CSV, GeoJSON and DXF, and drawings of lines as SVG and DXF; written and read by the engine (core/measure,
// saved.rs), so that `kilwa measure … again` and the page read the same.

import { notice } from "../chrome.js";
import { t } from "../i18n.js";
import { why } from "../messages.js";
import { download, fileName } from "../store.js";
import { onSheet, sizeIn } from "./paper.js";

export const FORMATS = [
  ["json", "fileJson", "application/json"],
  ["csv", "fileCsv", "text/csv"],
  ["geojson", "fileGeojson", "application/geo+json"],
  ["dxf", "fileDxf", "image/vnd.dxf"],
];
/** @type {Record<string, string>} */
const DRAWINGS = { svg: "image/svg+xml", dxf: "image/vnd.dxf" };
/** @import { ForeignPack, MeasureItem, MeasureRecord, Reading, Uncertainty } from "../types/page.js" */
/** @import { Engine } from "./engine.js" */
/** @import { Items } from "./items.js" */

const FILE_LIMIT = 64e6;

export class Files {
  /** @param {{items: Items, engine: () => Promise<Engine>, title: () => string}} parts */
  constructor({ items, engine, title }) {
    this.items = items;
    this.engine = engine;
    this.title = title;
  }

  /**
   * One measurement as in files.
   * @param {MeasureItem} item
   * @param {Engine} engine
   * @returns {MeasureRecord & {name: string, readings: Reading[], uncertainty: Uncertainty}}
   */
  measurement({ name, color, hidden, note, task }, engine) {
    const { readings, date } = task;
    const uncertainty = task.uncertainty ?? { lattice: 2 ** engine.pack.lattice.step_log2 / Math.sqrt(12), level: 0, capture: null };
    return { name, ...task.record(), readings, uncertainty, color, hidden, ...(note ? { note } : {}), ...(date ? { date } : {}) };
  }

  /**
   * The document of some measurements, those left out whose places are not found yet.
   * @param {MeasureItem[]} items
   */
  async document(items) {
    const engine = await this.engine();
    const { identity, title, lattice, crs } = engine.pack;
    const found = items.filter(({ task }) => task.points.every((p) => p.isFinal));
    return {
      kilwa: "measurements",
      version: 1,
      pack: { identity, title, lattice, ...(crs ? { crs } : {}) },
      measurements: found.map((item) => this.measurement(item, engine)),
    };
  }

  /**
   * Offer a file.
   * @param {string} format
   * @param {MeasureItem[]} items
   */
  async save(format, items = this.items.all) {
    try {
      const engine = await this.engine();
      const words = await engine.write(await this.document(items), format);
      const type = FORMATS.find(([name]) => name === format)?.[2];
      download(fileName(this.title(), `.measurements.${format}`), new Blob([words], { type }));
    } catch (error) {
      notice(t("measureFailed", { why: why(error) }), 12000);
    }
  }

  /**
   * Offer the lines of one measurement as a drawing, an SVG on a sheet of so many millimetres where one is given.
   * @param {string} format
   * @param {MeasureItem} item
   * @param {{scale: number, on: number[] | null}} how
   */
  async draw(format, { name, task }, { scale, on }) {
    try {
      const words = await (await this.engine()).write({ ...task.answer, title: `${this.title()}: ${name}` }, format, { scale });
      const file = format === "svg" && on ? onSheet(words, on) : words;
      download(fileName(`${this.title()} ${name}`, `.${format}`), new Blob([file], { type: DRAWINGS[format] }));
    } catch (error) {
      notice(t("measureFailed", { why: why(error) }), 12000);
    }
  }

  /**
   * Width and height of a drawing on paper at a scale, mm: those of a drawing with one line from corner to corner.
   * @param {{low: number[], high: number[]}} corners metres
   * @param {number} scale
   */
  async sizeOf({ low, high }, scale) {
    const line = { closed: false, flat: [low, high], world: [low, high].map((p) => [...p, 0]) };
    return sizeIn(await (await this.engine()).write({ title: "", layer: "", lines: [line] }, "svg", { scale }));
  }

  /**
   * Read a file the person chose. One of another pack is read only when the person wants that.
   * @param {File} file
   */
  async read(file) {
    try {
      if (file.size > FILE_LIMIT) throw new Error(`${file.name}: ${file.size} > ${FILE_LIMIT} bytes`);
      const engine = await this.engine();
      const document = await engine.read(await file.text());
      if (document.same) this.#add(document, null);
      else this.#ask(document, engine.pack);
    } catch (error) {
      notice(t("importFailed", { why: why(error) }), 12000);
    }
  }

  /**
   * @param {Awaited<ReturnType<Engine["read"]>>} document
   * @param {ForeignPack} here
   */
  #ask(document, here) {
    const { title, identity } = document.pack;
    const key = title === here.title ? "measureOtherVersion" : "measureOtherPack";
    notice(t(key, { title, identity: identity.slice(0, 12), here: here.title }), 60_000, {
      label: t("measureAddAnyway"),
      run: () => this.#add(document, { title, identity }),
    });
  }

  /**
   * `foreign`: the pack that they were made on, where it is not this one; they are then measured again, on this one.
   * @param {{measurements: MeasureRecord[]}} document
   * @param {ForeignPack | null} foreign
   */
  #add(document, foreign) {
    // Points of another lattice are counted from this one's origin already.
    const all = document.measurements.map((one) => (foreign ? { ...one, world: [], readings: [], foreign } : one));
    this.items.take(all);
  }
}
