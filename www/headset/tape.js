// Measuring distances in the headset: two places along a controller's rays become a measurement of the page, by the same code and on the same finest surface
// (measure/measure.js). Until that is found, what is known is shown with how far it may be off, as in the page.

import { t } from "../i18n.js";
import { why } from "../messages.js";
import { times, vector } from "./vectors.js";

/** @import { Vector } from "./vectors.js" */
/** @import { Marks, Color } from "./marks.js" */
/** @import { MeasureItem, Ray } from "../types/page.js" */
/** @import { Measure } from "../measure/measure.js" */
/** @import { Point, Task, Found } from "../measure/task.js" */

/** A surface seen at a slant makes a ray's width on it larger, but no more than so many times. */
const SLANT = 10;
/** Radians of a line of a label. */
const LETTERS = 0.024;

/** Where a ray met what is drawn: the place, and the certified error there, metres. @typedef {{world: Vector, half: number}} Seen */
/** A place that was pointed at; `point` as soon as the tools are there. @typedef {{seen: Seen, point: Point | null, done: Promise<Point>}} Picked */

export class Tape {
  /** @type {Measure | null} */
  #tools = null;
  /** @type {Promise<Measure> | null} */
  #loading = null;
  /** The place that a distance begins at. @type {Picked | null} */
  #first = null;
  /** Pairs that are complete but wait for the tools. @type {Set<Picked[]>} */
  #waiting = new Set();
  /** What was measured here, in order. @type {MeasureItem[]} */
  #items = [];

  /**
   * @param {import("../measuring.js").Measuring} measuring
   * @param {(text: string) => void} say shown in the headset for a while
   */
  constructor(measuring, say) {
    this.measuring = measuring;
    this.say = say;
  }

  /** The tools are fetched before they are needed; where that fails, the next press tries again. */
  load() {
    this.#loading ??= this.measuring.load().then(
      (tools) => {
        this.#tools = tools;
        return tools;
      },
      (error) => {
        this.#loading = null;
        throw error;
      },
    );
    return this.#loading;
  }

  /**
   * The trigger was pulled.
   * @param {Ray} ray
   * @param {Seen | null} seen
   * @param {number} width of the ray, radians: how exactly the hand points
   */
  press(ray, seen, width) {
    if (!seen) {
      this.say(t("headsetMissed"));
      return;
    }
    /** @type {Picked} */
    const picked = { seen, point: null, done: this.#look(ray, seen, width) };
    picked.done.then(
      (point) => (picked.point = point),
      (error) => this.#lose(picked, why(error)),
    );
    picked.done.then(
      ({ done }) =>
        done?.then(
          (isFound) => isFound === false && this.#lose(picked, t("measureMissed")),
          (error) => this.#lose(picked, why(error)),
        ),
      () => {}, // reported above
    );
    if (this.#first) this.#finish([this.#first, picked]);
    this.#first = this.#first ? null : picked;
  }

  /** Look it up on the finest surface. @param {Ray} ray @param {Seen} seen @param {number} width */
  async #look(ray, { world, half }, width) {
    const tools = await this.load();
    const wide = (/** @type {Found} */ { world: found, normal }) => {
      const far = Math.hypot(...found.map((v, k) => v - ray.origin[k]));
      const facing = Math.abs(ray.direction.reduce((sum, v, k) => sum + v * normal[k], 0)) / (Math.hypot(...ray.direction) * Math.hypot(...normal));
      // A triangle without area has no normal.
      return (far * width) / Math.max(1 / SLANT, facing || 1);
    };
    return tools.pointAlong(ray, { world, half, pixel: wide });
  }

  /** A place that is on no surface, or that could not be looked up, is not begun with. @param {Picked} picked @param {string} text */
  #lose(picked, text) {
    if (this.#first === picked) this.#first = null;
    this.say(text);
  }

  /** @param {Picked[]} pair */
  async #finish(pair) {
    this.#waiting.add(pair);
    try {
      const points = await Promise.all(pair.map(({ done }) => done));
      const tools = await this.load();
      if (!this.#waiting.has(pair)) return; // taken back
      const item = tools.list.add(tools.distanceOf(points));
      if (item) this.#items.push(item);
    } catch {
      // Each place reports what failed.
    } finally {
      this.#waiting.delete(pair);
    }
  }

  /** The newest step is taken back: the place that was begun with, else the last measurement. */
  back() {
    const pair = [...this.#waiting].at(-1);
    const item = this.#here.at(-1);
    if (this.#first) this.#first = null;
    else if (pair) this.#waiting.delete(pair);
    else if (item) {
      this.#tools?.remove(item.id);
      this.say(t("deleted", { name: item.name }));
    }
  }

  /** Those measured here that are still in the list, as it has them now. */
  get #here() {
    return this.#items.flatMap(({ id }) => this.#tools?.list.find(id) ?? []);
  }

  /**
   * @param {Marks} marks
   * @param {Seen | null} pointed what the ray meets now
   */
  draw(marks, pointed) {
    for (const { task, color, hidden } of this.#here) if (!hidden) this.#span(marks, task, rgb(color), task.isFinal);
    for (const pair of this.#waiting) this.#pair(marks, pair, null);
    if (this.#first) this.#pair(marks, [this.#first], pointed);
  }

  /** What is not in the list yet. @param {Marks} marks @param {Picked[]} pair @param {Seen | null} pointed */
  #pair(marks, pair, pointed) {
    const color = rgb("#1668c7");
    const places = [...pair.map(({ point, seen }) => point ?? seen), ...(pointed ? [pointed] : [])];
    if (this.#tools && places.length > 1) this.#span(marks, this.#tools.distanceOf(places), color, false, true);
    else for (const { world } of places.slice(0, 1)) if (world) marks.dot(vector(world), color);
  }

  /**
   * @param {Marks} marks
   * @param {Task} task
   * @param {Color} color
   * @param {boolean} isFinal
   */
  #span(marks, task, color, isFinal, isDraft = false) {
    const places = task.points.flatMap(({ world }) => (world ? [vector(world)] : []));
    /** @type {Color} */
    const halo = [1, 1, 1, 0.8];
    if (places.length > 1) {
      const [a, b] = places;
      if (isFinal) {
        marks.line(a, b, halo, 2.2);
        marks.line(a, b, color);
      } else marks.dashes(a, b, color);
    }
    for (const place of places) {
      marks.dot(place, halo, 1.5);
      marks.dot(place, color);
    }
    const label = this.#tools?.linesOf(task, isDraft) ?? [];
    if (label.length === 0 || places.length < 2) return;
    const middle = vector(places[0].map((v, k) => (v + places[1][k]) / 2));
    marks.plate(middle, label, { angle: LETTERS });
  }
}

/** @param {string} color as `#rrggbb` @returns {Color} */
function rgb(color) {
  const value = Number.parseInt(color.slice(1), 16);
  return [...times([value >> 16, (value >> 8) & 255, value & 255], 1 / 255), 1];
}
