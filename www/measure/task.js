// What is measured: points that are picked on the finest surface, and the task that they belong to. A point knows where it was pressed at
// once (provisional) and where it lies on the finest surface later (final); a task is measured when all its points are final.

import { toolOf, toolOfRecord } from "./tools.js";

/** @import { Line, MeasureAnswer, MeasureRecord, MeasureTool, Message, Plane, Ray, Reading, Uncertainty } from "../types/page.js" */
/** @import { Engine } from "./engine.js" */
/** A place on the finest surface. @typedef {{world: number[], normal: number[]}} Found */
/** What a plane of cut and fill or of deviation is chosen by. @typedef {{name: string, height?: number}} PlaneChoice */

/** @param {number[]} a @param {number[]} b */
const sub = (a, b) => a.map((v, i) => v - b[i]);
/** @param {number[]} a @param {number[]} b */
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @param {number[]} v */
const unit = (v) => v.map((x) => x / Math.hypot(...v));

/**
 * One place. `half`: how far it may be off while it is provisional, metres; null where there is no number for that. `pointing`: standard uncertainty of
 * where a person pointed, metres; 0 where the place was given or snapped to.
 */
export class Point {
  /** @param {{world?: number[] | null, local?: number[] | null, ray?: Ray | null, half?: number | null, pointing?: number}} known */
  constructor({ world = null, local = null, ray = null, half = null, pointing = 0 }) {
    this.world = world;
    this.local = local;
    this.ray = ray;
    this.half = half;
    this.pointing = pointing;
    this.isMissed = false;
    this.snapped = "none";
    /** Where it is roughly, local metres. @type {number[] | null} */
    this.rough = null;
    /** The pixel that was pressed. @type {[number, number] | null} */
    this.pixel = null;
    /** @type {Promise<boolean> | null} */
    this.done = local ? Promise.resolve(true) : null;
  }

  get isFinal() {
    return this.local !== null;
  }

  /**
   * Where the ray meets the finest surface; false where it meets nothing.
   * @param {Promise<Engine>} engine
   * @param {{clip: object | null, snap: string, onChange: () => void, pixel?: (found: Found) => number}} how `pixel`: metres that a pixel covers at a place
   * @returns {Promise<boolean>}
   */
  pick(engine, { clip, snap, onChange, pixel = () => 0 }) {
    const { ray } = this;
    if (!ray) return Promise.resolve(false);
    const provisional = (/** @type {import("../types/page.js").Provisional | null} */ p) => {
      if (this.isFinal || !p) return;
      if (p.world) this.world = p.world;
      this.rough = p.local ?? null;
      // Several stretches of the ray: there is no number.
      this.half = Number.isFinite(p.low) && Number.isFinite(p.high) ? Math.max(0, (p.high - p.low) / 2) : null;
      onChange();
    };
    this.done = (async () => {
      const found = await (await engine).pick(ray, { clip, snap, provisional });
      if (!found) {
        this.isMissed = true;
        return false;
      }
      const snapped = found.snapped ?? "none";
      Object.assign(this, { local: [...found.local], world: [...found.world], half: 0, snapped, pointing: snapped === "none" ? pixel(found) : 0 });
      onChange();
      return true;
    })();
    return this.done;
  }
}

/** What is measured, and what came out. `state`: picking, measuring, final, refused, missed, failed. */
export class Task {
  /** @param {{kind: MeasureTool, points?: Point[], plane?: Plane | null, reach?: number | null, interval?: number | null, by?: PlaneChoice | null}} task */
  constructor({ kind, points = [], plane = null, reach = null, interval = null, by = null }) {
    this.kind = kind;
    this.points = points;
    this.plane = plane;
    this.reach = reach;
    this.interval = interval;
    this.by = by;
    this.tool = kind.tool ?? kind.id;
    /** @type {"picking" | "measuring" | "final" | "refused" | "missed" | "failed"} */
    this.state = "picking";
    /** @type {Reading[]} */
    this.readings = [];
    /** @type {Uncertainty | null} */
    this.uncertainty = null;
    /** @type {NonNullable<MeasureAnswer["parts"]>} */
    this.parts = [];
    /** @type {Message[]} */
    this.remarks = [];
    /** Closed ones end where they begin. @type {number[][][]} */
    this.lines = [];
    /** What drawings are made of. @type {MeasureAnswer | null} */
    this.answer = null;
    /** Why there is no value, in the language of the page. @type {(() => string) | null} */
    this.refusal = null;
    /** @type {MeasureAnswer["read"]} */
    this.read = null;
    /** The plane it counted from, in world coordinates. @type {Plane | null} */
    this.fitted = null;
    /** The day it was measured, `2026-11-21`. @type {string | null} */
    this.date = null;
    /** @type {AbortController | null} */
    this.abort = null;
    /** Readings that are not final. @type {Reading[]} */
    this.guess = [];
    /** While it is measured. @type {Promise<void> | null} */
    this.running = null;
    /** Part of its bytes that came, and seconds until the connection is tried again. @type {number | null} */
    this.progress = null;
    /** @type {number | null} */
    this.waiting = null;
  }

  get isFinal() {
    return this.state === "final";
  }

  /** The task as in files (saved.rs). */
  record() {
    /** @type {MeasureRecord} */
    const out = { tool: this.tool };
    if (this.points.length > 0) {
      out.local = this.points.map((p) => p.local);
      out.world = this.points.map((p) => p.world);
      if (this.points.some((p) => p.pointing > 0)) out.pointing = this.points.map((p) => p.pointing);
    }
    if (this.plane) out.plane = this.plane;
    if (this.reach !== null) out.reach = this.reach;
    if (this.interval !== null) out.interval = this.interval;
    return out;
  }

  /**
   * From a file, the browser's store or an address; throws where it is no measurement.
   * @param {MeasureRecord} record
   * @param {number[]} origin the lattice's
   */
  static of(record, origin) {
    const {
      local = [],
      world = [],
      rays = [],
      pointing = [],
      plane = null,
      reach = null,
      interval = null,
      readings = [],
      uncertainty = null,
      date = null,
      fitted = null,
    } = record;
    const given = local.length > 0 ? local : rays;
    const points = given.map((_, k) => {
      const at = local[k];
      if (at) return new Point({ local: at, world: world[k] ?? at.map((v, i) => v + origin[i]), half: 0, pointing: pointing[k] ?? 0 });
      return new Point({ ray: rays[k], world: world[k] ?? null });
    });
    const kind = toolOf(record.kind) ?? toolOfRecord(record);
    if (!kind) throw new Error(`${record.tool}: no such tool`);
    const task = new Task({ kind, points, plane, reach, interval });
    if (readings.length > 0) Object.assign(task, { readings, uncertainty, date, fitted, state: "final" });
    return task;
  }

  /**
   * The same with another point, to be measured again. A plane that followed from the points follows anew.
   * @param {number} index
   * @param {Point} point
   */
  withPoint(index, point) {
    const points = this.points.map((p, k) => (k === index ? point : p));
    const follows = this.by !== null || (this.tool === "section" && this.points.length > 0);
    return new Task({ kind: this.kind, points, plane: follows ? null : this.plane, reach: this.reach, interval: this.interval, by: this.by });
  }

  /** The task with the places as they are known now, and how far they may be off, metres; null where a place has no number yet. */
  rough() {
    const { points } = this;
    const isOnPoints = ["angle", "plane-angle", "height", "circle", "area"].includes(this.tool) && points.length > 0;
    if (!isOnPoints || points.some((p) => p.half === null || !(p.local ?? p.rough))) return null;
    return { task: { ...this.record(), local: points.map((p) => p.local ?? p.rough) }, level: Math.max(...points.map((p) => p.half ?? 0)) };
  }

  /** A length that is known while the points are provisional: value and how far it may be off, metres; null where there is none. */
  get provisional() {
    const isLength = ["distance", "perimeter", "along"].includes(this.tool);
    const points = this.points.flatMap(({ world, half }) => (world && half !== null ? { world, half } : []));
    if (!isLength || points.length < Math.max(2, this.points.length)) return null;
    const ring = this.tool === "perimeter" ? [...points, points[0]] : points;
    let [value, half] = [0, 0];
    for (let k = 1; k < ring.length; k += 1) {
      value += Math.hypot(...sub(ring[k].world, ring[k - 1].world));
      half += ring[k].half + ring[k - 1].half;
    }
    return { value, half };
  }

  /**
   * The plane that the points or the choice `by` mean, in local metres; a key of a sentence where they mean none.
   * @param {{origin: number[], clipPlane: Plane | null}} of
   * @returns {Plane | string | null}
   */
  planeFrom({ origin, clipPlane }) {
    const local = this.points.map((p) => p.local ?? []);
    const level = (/** @type {number} */ height) => ({ point: [local[0]?.[0] ?? 0, local[0]?.[1] ?? 0, height], normal: [0, 0, 1] });
    switch (this.kind.id) {
      case "section-upright": {
        const d = sub(local[1], local[0]);
        const normal = [d[1], -d[0], 0];
        // Seen from the front, the first point is at the left.
        return Math.hypot(...normal) > 1e-9 ? { point: local[0], normal: unit(normal) } : "refuseUpright";
      }
      case "section-level":
        return level(local[0][2]);
      case "section-points": {
        if (local.length < 3) return null;
        const n = cross(sub(local[1], local[0]), sub(local[2], local[0]));
        return Math.hypot(...n) > 1e-12 ? { point: local[0], normal: unit(n) } : "refuseLine";
      }
      case "section-clip":
        return clipPlane ? { point: sub(clipPlane.point, origin), normal: unit(clipPlane.normal) } : "refuseNoClip";
      default:
        if (this.by?.name === "lowest") return level(Math.min(...local.map((p) => p[2])));
        if (this.by?.name === "height") return level(Number(this.by.height) - origin[2]);
        return null;
    }
  }
}
