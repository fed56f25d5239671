// What is measured: points that are picked on the finest surface, and the task that they belong to. A point knows where it was pressed at
// once (provisional) and where it lies on the finest surface later (final); a task is measured when all its points are final.

import { toolOf, toolOfRecord } from "./tools.js";

const sub = (a, b) => a.map((v, i) => v - b[i]);
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (v) => v.map((x) => x / Math.hypot(...v));

/** One place. `half`: how far it may be off while it is provisional, metres; null where no number can be said. */
export class Point {
  constructor({ world = null, local = null, ray = null, half = null }) {
    Object.assign(this, { world, local, ray, half, isMissed: false, snapped: "none" });
    this.done = local ? Promise.resolve(true) : null;
  }

  get isFinal() {
    return this.local !== null;
  }

  /** Where the ray meets the finest surface. @param {object} engine @param {object} how `{clip, snap, onChange}` */
  pick(engine, { clip, snap, onChange }) {
    const provisional = (p) => {
      if (this.isFinal || !p) return;
      if (p.world) this.world = p.world;
      this.rough = p.local ?? null;
      // Several stretches of the ray: no number can be said.
      this.half = Number.isFinite(p.low) && Number.isFinite(p.high) ? Math.max(0, (p.high - p.low) / 2) : null;
      onChange();
    };
    this.done = (async () => {
      const found = await (await engine).pick(this.ray, { clip, snap, provisional });
      if (!found) {
        this.isMissed = true;
        return false;
      }
      Object.assign(this, { local: [...found.local], world: [...found.world], half: 0, snapped: found.snapped ?? "none" });
      onChange();
      return true;
    })();
    return this.done;
  }
}

/** What is measured, and what came out. `state`: picking, measuring, final, refused, missed, failed. */
export class Task {
  constructor({ kind, points = [], plane = null, reach = null, interval = null, by = null }) {
    Object.assign(this, { kind, points, plane, reach, interval, by });
    this.tool = kind.tool ?? kind.id;
    this.state = "picking";
    this.readings = [];
    this.uncertainty = null;
    this.parts = [];
    this.remarks = [];
    this.lines = [];
    this.answer = null; // what drawings are made of
    this.refusal = null; // a function that says why there is no value
    this.read = null;
    this.fitted = null; // the plane it counted from, in world coordinates
    this.date = null; // the day it was measured, `2026-11-21`
    this.abort = null;
    this.guess = []; // readings that are not final
  }

  get isFinal() {
    return this.state === "final";
  }

  /** The task as in files (record.rs). */
  record() {
    const out = { tool: this.tool };
    if (this.points.length > 0) {
      out.local = this.points.map((p) => p.local);
      out.world = this.points.map((p) => p.world);
    }
    if (this.plane) out.plane = this.plane;
    if (this.reach !== null) out.reach = this.reach;
    if (this.interval !== null) out.interval = this.interval;
    return out;
  }

  /** From a file, the browser's store or an address. `origin` is the lattice's. */
  static of(record, origin) {
    const {
      local = [],
      world = [],
      rays = [],
      plane = null,
      reach = null,
      interval = null,
      readings = [],
      uncertainty = null,
      date = null,
      fitted = null,
    } = record;
    const given = local.length > 0 ? local : rays;
    const points = given.map((_, k) =>
      local[k]
        ? new Point({ local: local[k], world: world[k] ?? local[k].map((v, i) => v + origin[i]), half: 0 })
        : new Point({ ray: rays[k], world: world[k] ?? null }),
    );
    const task = new Task({ kind: toolOf(record.kind) ?? toolOfRecord(record), points, plane, reach, interval });
    if (readings.length > 0) Object.assign(task, { readings, uncertainty, date, fitted, state: "final" });
    return task;
  }

  /** The same with another point, to be measured again. A plane that followed from the points follows anew. */
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
    return { task: { ...this.record(), local: points.map((p) => p.local ?? p.rough) }, level: Math.max(...points.map((p) => p.half)) };
  }

  /** A length that is known while the points are provisional: value and how far it may be off, metres; null where there is none. */
  get provisional() {
    const isLength = ["distance", "perimeter", "along"].includes(this.tool);
    const { points } = this;
    if (!isLength || points.length < 2 || points.some((p) => !p.world || p.half === null)) return null;
    const ring = this.tool === "perimeter" ? [...points, points[0]] : points;
    let [value, half] = [0, 0];
    for (let k = 1; k < ring.length; k += 1) {
      value += Math.hypot(...sub(ring[k].world, ring[k - 1].world));
      half += ring[k].half + ring[k - 1].half;
    }
    return { value, half };
  }

  /** The plane that the points or the choice `by` mean, in local metres; a key of a sentence where they mean none. */
  planeFrom({ origin, clipPlane }) {
    const local = this.points.map((p) => p.local);
    const level = (height) => ({ point: [local[0]?.[0] ?? 0, local[0]?.[1] ?? 0, height], normal: [0, 0, 1] });
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
        if (this.by?.name === "height") return level(this.by.height - origin[2]);
        return null;
    }
  }
}
