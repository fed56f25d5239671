// The life of a measurement until it has a value: its places are looked up on the finest surface, then it is measured there. While that is on its way,
// a value is guessed from what is known.

import { t } from "../i18n.js";
import { sentence, why } from "../messages.js";

/** @import { Box, MeasureAnswer, MeasureItem, Plane, Progress } from "../types/page.js" */
/** @import { Engine } from "./engine.js" */
/** @import { Task } from "./task.js" */

/**
 * @typedef {object} RunnerParts
 * @property {() => Promise<Engine>} engine
 * @property {() => {clipPlane: Plane | null, clipBox: Box | null}} clip what cuts the model
 * @property {number[]} origin the lattice's
 * @property {() => void} changed something that is shown
 * @property {(task: Task) => void} progress
 * @property {(task: Task) => void} ended it is final, or will not be
 */

export class Runner {
  /** @param {RunnerParts} parts */
  constructor({ engine, clip, origin, changed, progress, ended }) {
    this.engine = engine;
    this.clip = clip;
    this.origin = origin;
    this.changed = changed;
    this.progress = progress;
    this.ended = ended;
    this.isClosed = false;
  }

  /**
   * Whatever is missing for a measurement: its places, then its values. Runs once for each task.
   * @param {MeasureItem} item
   */
  go({ task }) {
    const isOpen = task.state === "picking" || (task.isFinal && task.kind.draws && task.lines.length === 0);
    if (task.running || !isOpen) return;
    task.running = this.#measure(task).finally(() => {
      task.running = null;
    });
  }

  /**
   * Measure again what failed.
   * @param {MeasureItem} item
   */
  again(item) {
    for (const point of item.task.points) if (!point.isFinal) Object.assign(point, { done: null, isMissed: false });
    item.task.state = "picking";
    this.changed();
    this.go(item);
  }

  /** @param {Task} task */
  async #measure(task) {
    task.abort = new AbortController();
    const { signal } = task.abort;
    const had = task.isFinal ? task.readings : null;
    try {
      for (const point of task.points) if (!point.done) point.pick(this.engine(), { clip: null, snap: "none", onChange: this.changed });
      this.#guess(task, signal);
      const all = await Promise.all(task.points.map((p) => p.done));
      if (all.includes(false)) {
        task.state = "missed";
        return;
      }
      const engine = await this.engine();
      if (!task.plane) {
        const plane = task.planeFrom({ origin: this.origin, clipPlane: this.clip().clipPlane });
        if (typeof plane === "string") {
          Object.assign(task, { state: "refused", refusal: () => t(plane) });
          return;
        }
        task.plane = plane;
      }
      if (!had) task.state = "measuring";
      this.changed();
      const progress = (/** @type {Progress} */ { done = 0, all = 0, waiting = null }) => {
        task.progress = all > 0 ? done / all : null;
        task.waiting = waiting;
        this.progress(task);
      };
      found(task, await engine.measure(task.record(), { unit: "m", progress, signal }), engine);
    } catch (error) {
      if (error.name === "AbortError") return;
      Object.assign(task, { state: had ? "final" : "failed", refusal: had ? null : () => why(error) });
    } finally {
      task.progress = null;
      if (!this.isClosed) this.ended(task);
    }
  }

  /**
   * The value that the places give as they are known now, while the finest surface is on its way.
   * @param {Task} task
   * @param {AbortSignal} signal
   */
  async #guess(task, signal) {
    try {
      const engine = await this.engine();
      const rough = task.rough();
      if (!rough || task.points.every((p) => p.isFinal)) return;
      const { refusal, readings } = await engine.measure(rough.task, { level: rough.level, signal });
      if (refusal || task.isFinal) return;
      task.guess = readings;
      this.changed();
    } catch {
      // It is a guess: what is wrong is reported with the final value.
    }
  }

  /** @param {Iterable<MeasureItem>} items */
  close(items) {
    this.isClosed = true;
    for (const { task } of items) task.abort?.abort();
  }
}

/**
 * @param {Task} task
 * @param {MeasureAnswer} answer
 * @param {Engine} engine
 */
function found(task, answer, engine) {
  const { refusal, said } = answer;
  if (refusal) {
    Object.assign(task, { state: "refused", refusal: () => (said ? sentence(said) : refusal), readings: [] });
    return;
  }
  const { lattice, capture } = engine.pack;
  const spacing = 2 ** lattice.step_log2;
  const uncertainty = answer.uncertainty ?? { lattice: spacing / Math.sqrt(12), level: 0, capture: Number.isFinite(capture) ? capture : null };
  const { readings, parts = [], remarks = [], lines = [], read = null } = answer;
  task.date ??= today();
  task.fitted = answer.details?.plane ?? null;
  const drawn = lines.map(({ world, closed }) => (closed ? [...world, world[0]] : world));
  Object.assign(task, { state: "final", readings, parts, remarks, lines: drawn, answer: lines.length > 0 ? answer : null, read, uncertainty, refusal: null });
}

/** The day, where the person is. */
function today() {
  const now = new Date();
  return [now.getFullYear(), now.getMonth() + 1, now.getDate()].map((n) => String(n).padStart(2, "0")).join("-");
}
