// The uses of a measurement beside the list: copied, cited with a link that leads back to it, and shown on the model.

import { notice, openTab, peek } from "../chrome.js";
import { t } from "../i18n.js";
import { writeState } from "../link.js";
import { why } from "../messages.js";
import { LONGEST, write as writeAddress } from "./address.js";
import { citation } from "./cite.js";
import { COLOR } from "./items.js";
import { text } from "./values.js";

/** @import { MeasureItem } from "../types/page.js" */
/** @import { Display } from "../display.js" */
/** @import { Linked } from "../link.js" */
/** @import { Model } from "../model.js" */
/** @import { Scene } from "../scene.js" */
/** @import { Engine } from "./engine.js" */
/** @import { Files } from "./files.js" */

/** Metres that a deviation's colours reach at least. */
const MIN_REACH = 1e-6;

/** As in an address: the colour only where it is another one. @param {MeasureItem} item */
const recordOf = ({ name, color, task }) => ({ ...task.record(), name, color: color === COLOR ? undefined : color });

/**
 * The measurements as an address holds them; too long ones are left out of it by whoever asks.
 * @param {MeasureItem[]} items
 */
export function addressed(items) {
  const found = items.filter(({ task }) => task.points.every((p) => p.isFinal) && (task.points.length > 0 || task.state !== "picking"));
  return writeAddress(found.map((item) => ({ ...recordOf(item), hidden: item.hidden })));
}

/**
 * @typedef {object} SharingParts
 * @property {Model} model
 * @property {() => Scene} scene
 * @property {() => Promise<Engine>} engine
 * @property {Files} files
 * @property {Display} display
 * @property {() => string} unit
 * @property {() => Linked} state what the address holds
 * @property {(id: string, words: string, address: string | null) => void} cited
 */

export class Sharing {
  #parts;

  /** @param {SharingParts} parts */
  constructor(parts) {
    this.#parts = parts;
  }

  /** All values, a line for each, to the clipboard. @param {MeasureItem} item */
  copyValues({ name, task }) {
    const unit = this.#parts.unit();
    return copy([name, ...task.readings.map((r) => `${r.name} ${text(r, unit)}`)].join("\n"), "measureCopied");
  }

  /** A sentence that cites it, to the clipboard and below it. @param {MeasureItem} item */
  async cite(item) {
    const { model, files, unit, cited } = this.#parts;
    try {
      const engine = await this.#parts.engine();
      const sentence = await citation(engine, files.measurement(item, engine), {
        kind: item.task.kind,
        lang: document.documentElement.lang,
        unit: unit(),
        published: model.pack.isLocal ? "" : (document.body.dataset.title ?? ""),
      });
      const address = this.addressOf(item);
      cited(item.id, sentence, address);
      await copy(address ? `${sentence} ${address}` : sentence, "measureCited");
    } catch (error) {
      failed(error);
    }
  }

  /** A deviation as colours on the model: distances from its plane, as far as it found any. @param {MeasureItem} item */
  async colour({ task }) {
    try {
      const { details, readings } = await (await this.#parts.engine()).measure(task.record());
      const extremes = readings.filter((r) => ["lowest", "highest"].includes(r.name)).map((r) => Math.abs(r.value));
      const reach = Math.max(...extremes, MIN_REACH);
      const plane = details?.plane;
      if (plane) this.#parts.display.change({ mode: "distance", plane: { normal: plane.normal, point: plane.point }, range: [-reach, reach] });
    } catch (error) {
      failed(error);
    }
  }

  /** The distance from the plane of a measurement as colours on the model, with its legend in the Display tab. @param {MeasureItem} item */
  map({ task }) {
    if (!task.fitted) return;
    const extreme = (/** @type {string} */ name) => Math.abs(task.readings.find((r) => r.name === name)?.value ?? 0);
    const reach = Math.max(extreme("lowest"), extreme("highest"));
    const { plane: _plane, range: _range, ...rest } = this.#parts.display.chosen ?? {};
    this.#parts.display.show({ ...rest, mode: "distance", plane: task.fitted, ...(reach > 0 ? { range: [-reach, reach] } : {}) });
    openTab("display");
    peek();
  }

  /** Fly to a measurement, so that all of it is seen. @param {MeasureItem} item */
  look({ task }) {
    const places = task.lines.length > 0 ? task.lines.flat() : task.points.flatMap((p) => (p.world ? [p.world] : []));
    const scene = this.#parts.scene();
    if (places.length === 0) {
      scene.fit();
      return;
    }
    const low = [0, 1, 2].map((i) => places.reduce((m, p) => Math.min(m, p[i]), Infinity));
    const high = [0, 1, 2].map((i) => places.reduce((m, p) => Math.max(m, p[i]), -Infinity));
    const middle = low.map((v, i) => (v + high[i]) / 2);
    scene.lookAtRegion(middle, Math.hypot(...high.map((v, i) => v - low[i])));
    peek();
  }

  /**
   * Where a citation leads: this model, seen as now, with this one measurement; null for a file of this computer.
   * @param {MeasureItem} item
   */
  addressOf(item) {
    if (this.#parts.model.pack.isLocal) return null;
    const measurements = writeAddress([recordOf(item)]);
    const given = new URLSearchParams(location.search).get("pack");
    const search = given ? `?pack=${encodeURIComponent(given)}` : "";
    const state = { ...this.#parts.state(), measurements: measurements.length > LONGEST ? null : measurements, annotation: null };
    return `${location.origin}${location.pathname}${search}${writeState(state)}`;
  }
}

/** @param {unknown} error */
const failed = (error) => notice(t("measureFailed", { why: why(error) }), 10000);

/**
 * @param {string} words
 * @param {string} done string that reports it
 */
async function copy(words, done) {
  try {
    await navigator.clipboard.writeText(words);
    notice(t(done), 2500);
  } catch {
    notice(t("measureCopyFailed"), 6000);
  }
}
