// Measurements as files: JSON that reads back to the last bit, CSV, GeoJSON and DXF, and drawings of lines as SVG and DXF; written and read by the engine (core/measure,
// record.rs), so that `kilwa measure … again` and the page read the same.

import { notice } from "../chrome.js";
import { t } from "../i18n.js";
import { why } from "../said.js";
import { download, fileName } from "../store.js";

export const FORMATS = [
  ["json", "fileJson", "application/json"],
  ["csv", "fileCsv", "text/csv"],
  ["geojson", "fileGeojson", "application/geo+json"],
  ["dxf", "fileDxf", "image/vnd.dxf"],
];
const DRAWINGS = { svg: "image/svg+xml", dxf: "image/vnd.dxf" };
const FILE_LIMIT = 64e6;

export class Files {
  /** @param {import("./measure.js").Measure} measure */
  constructor(measure) {
    this.measure = measure;
  }

  /** One measurement as in files. */
  measurement({ name, color, hidden, note, task }) {
    const { readings, uncertainty } = task;
    return {
      name,
      ...task.record(),
      readings,
      uncertainty: uncertainty ?? this.unknown,
      color,
      hidden,
      ...(note ? { note } : {}),
      ...(task.date ? { date: task.date } : {}),
    };
  }

  /** The document of some measurements, those left out whose places are not found yet. */
  async document(items = this.measure.items) {
    const { identity, title, lattice, crs } = (await this.measure.engine).pack;
    this.unknown = { lattice: 2 ** lattice.step_log2 / Math.sqrt(12), level: 0, capture: null };
    const found = items.filter(({ task }) => task.points.every((p) => p.isFinal));
    return {
      kilwa: "measurements",
      version: 1,
      pack: { identity, title, lattice, ...(crs ? { crs } : {}) },
      measurements: found.map((item) => this.measurement(item)),
    };
  }

  /** Offer a file. */
  async save(format, items = this.measure.items) {
    try {
      const engine = await this.measure.engine;
      const words = await engine.write(await this.document(items), format);
      const [, , type] = FORMATS.find(([name]) => name === format);
      download(fileName(this.measure.page.title, `.measurements.${format}`), new Blob([words], { type }));
    } catch (error) {
      notice(t("measureFailed", { why: why(error) }), 12000);
    }
  }

  /** Offer the lines of one measurement as a drawing. */
  async draw(format, { name, task }) {
    try {
      const words = await (await this.measure.engine).write({ ...task.answer, title: name }, format);
      download(fileName(`${this.measure.page.title} ${name}`, `.${format}`), new Blob([words], { type: DRAWINGS[format] }));
    } catch (error) {
      notice(t("measureFailed", { why: why(error) }), 12000);
    }
  }

  /** Read a file the person chose. One of another pack is read only when the person says so. */
  async read(file) {
    try {
      if (file.size > FILE_LIMIT) throw new Error(`${file.name}: ${file.size} > ${FILE_LIMIT} bytes`);
      const engine = await this.measure.engine;
      const document = await engine.read(await file.text());
      if (document.same) this.#add(document, null);
      else this.#ask(document, engine.pack);
    } catch (error) {
      notice(t("importFailed", { why: why(error) }), 12000);
    }
  }

  #ask(document, here) {
    const { title, identity } = document.pack;
    const key = title === here.title ? "measureOtherVersion" : "measureOtherPack";
    notice(t(key, { title, identity: identity.slice(0, 12), here: here.title }), 60_000, {
      label: t("measureAddAnyway"),
      run: () => this.#add(document, { title, identity }),
    });
  }

  /** `foreign`: the pack that they were made on, where it is not this one; they are then measured again, on this one. */
  #add(document, foreign) {
    // Points of another lattice are counted from this one's origin already.
    const all = document.measurements.map((one) => (foreign ? { ...one, world: [], readings: [], foreign } : one));
    this.measure.take(all);
  }
}
