// The tool in use: places are pressed one after the other until a measurement is complete; and points of finished ones that are moved. A place is picked
// on what is on screen (provisional), and at once looked up along the same ray on the finest surface.

import { announce, hint, notice, peek } from "../chrome.js";
import { t } from "../i18n.js";
import { why } from "../messages.js";
import { Point, Task } from "./task.js";
import { SNAPS, stepText, toolOf } from "./tools.js";

/** @import { Box, Placing, Plane, Tool, MeasureTool } from "../types/page.js" */
/** @import { Scene } from "../scene.js" */
/** @import { Engine } from "./engine.js" */
/** @import { Items } from "./items.js" */

/** A press so near to the last one is a second press of a double click, and near the first point it closes the polygon; CSS pixels. */
const NEAR = 10;
/** Milliseconds within which a second press makes a double click. */
const DOUBLE_MS = 500;
/** A surface seen at a slant makes a pixel wider, but no more than so many times. */
const SLANT = 10;
const isTouch = () => matchMedia("(pointer: coarse)").matches;

/** @param {number[]} a @param {number[]} b */
const dot = (a, b) => a.reduce((sum, v, i) => sum + v * b[i], 0);

/**
 * How wide a pixel is on the surface at a place, metres: how exactly a person can point at it.
 * @param {number[][]} rays of this pixel and of the next: origin and direction
 * @param {import("./task.js").Found} found
 */
function pixelAt([ray, next], { world, normal }) {
  const [from, along] = [ray.slice(0, 3), ray.slice(3)];
  const way = dot(
    world.map((v, i) => v - from[i]),
    along,
  );
  const far = way / dot(along, along);
  const wide = Math.hypot(...from.map((v, i) => next[i] - v + (next[i + 3] - along[i]) * far));
  const facing = Math.abs(dot(along, normal)) / (Math.hypot(...along) * Math.hypot(...normal));
  // A triangle without area has no normal.
  return wide / Math.max(1 / SLANT, facing || 1);
}

/**
 * @typedef {object} DraftParts
 * @property {() => Scene} scene
 * @property {Items} items
 * @property {() => Promise<Engine>} engine
 * @property {() => {clipPlane: Plane | null, clipBox: Box | null}} clip what cuts the model
 * @property {() => string} snap what points snap to
 * @property {(tool: Tool, which?: string) => void} tool choose a tool of the page
 * @property {() => {plane: import("./task.js").PlaneChoice, interval: number}} options what was chosen for the tool in the panel
 * @property {() => void} changed something that is shown
 * @property {() => void} toolChanged another tool, or another step of it
 * @property {() => void} draw what is drawn over the picture
 */

export class Draft {
  #parts;

  /** @param {DraftParts} parts */
  constructor(parts) {
    this.#parts = parts;
    this.isClosed = false;
    /** @type {MeasureTool} */
    this.kind = /** @type {MeasureTool} */ (toolOf("distance"));
    /** While a tool is in use: the points so far, and those taken back. @type {{points: Point[], undone: Point[]} | null} */
    this.drawn = null;
    /** Id of the measurement whose points can be moved. @type {string | null} */
    this.editing = null;
    /** A point whose place is chosen anew. @type {{id: string, index: number} | null} */
    this.moving = null;
    /** A point that the keyboard took up, and the pixel it was at. @type {{id: string, index: number, at: [number, number]} | null} */
    this.taken = null;
    /** The place under the pointer. @type {{world: number[], half: number} | null} */
    this.cursor = null;
    /** A measurement one of whose points is dragged. @type {{id: string, task: Task} | null} */
    this.dragged = null;
    /** When the last place was pressed, milliseconds. */
    this.pressed = 0;
    /** @type {[number, number]} */
    this.hovered = [0, 0];
    this.hovering = false;
  }

  /**
   * Choose a tool by its name; without one, the last.
   * @param {string | null} name
   */
  start(name = null) {
    const { taken } = this;
    if (!taken) this.editing = null;
    this.moving = taken;
    if (taken) {
      this.#parts.scene().input.showPoint(taken.at);
      this.taken = this.drawn = null;
      this.#step();
      return;
    }
    this.kind = toolOf(name ?? this.kind.id) ?? this.kind;
    this.#begin();
    if (this.kind.max === 0) this.#finish();
    this.#parts.toolChanged();
  }

  /**
   * A tool of the panel or of a script.
   * @param {string} name
   */
  use(name) {
    this.kind = toolOf(name) ?? this.kind;
    this.#parts.tool("measure", this.kind.id);
  }

  #begin() {
    this.drawn = { points: [], undone: [] };
    this.cursor = null;
    this.#step();
  }

  leave() {
    if (!this.drawn && !this.moving && !this.editing) return;
    this.drawn = this.moving = this.cursor = this.editing = null;
    this.#parts.toolChanged();
    this.#parts.changed();
  }

  /** The next step, in words. */
  hint() {
    if (this.moving) return t(isTouch() ? "measureMoveTouch" : "measureMove");
    if (this.editing) return t(isTouch() ? "measureEditTouch" : "measureEditHint");
    if (!this.drawn || this.kind.max === 0) return null;
    return stepText(this.kind, this.drawn.points.length, isTouch());
  }

  #step() {
    hint(this.hint());
    this.#parts.toolChanged();
    this.#parts.changed();
  }

  /** As many places as the person wants. */
  get #isOpenEnded() {
    return this.kind.max === Infinity;
  }

  /** Enough places for a measurement. */
  get #isEnough() {
    return (this.drawn?.points.length ?? 0) >= this.kind.min;
  }

  get canFinish() {
    return Boolean(this.drawn) && this.#isOpenEnded && this.#isEnough;
  }

  /**
   * A press on the picture.
   * @param {number} x
   * @param {number} y
   * @param {Placing} how
   */
  place(x, y, { snap = false, isKey = false } = {}) {
    if (this.moving) {
      const { id, index } = this.moving;
      this.moving = null;
      this.drop(id, index, x, y, snap);
      this.edit(id);
      return;
    }
    if (!this.drawn) return;
    const { points } = this.drawn;
    const { ratio } = this.#parts.scene().session;
    const last = points[points.length - 1]?.pixel;
    const now = performance.now();
    if (!isKey && last && Math.hypot(last[0] - x, last[1] - y) < NEAR * ratio && now - this.pressed < DOUBLE_MS) {
      // The second press of a double click does not add a point.
      this.finish();
      return;
    }
    this.pressed = now;
    if (this.kind.closed && this.canFinish && this.#isAt(points[0], x, y)) {
      this.#finish();
      return;
    }
    const point = this.#pick(x, y, snap);
    if (!point) {
      notice(t("noteMissed"));
      return;
    }
    points.push(point);
    this.drawn.undone = [];
    announce(t("measurePlaced", { number: points.length }));
    if (points.length >= this.kind.max) this.#finish();
    else this.#step();
    if (!isKey) this.#parts.scene().input.showPoint(null);
  }

  /**
   * @param {Point} point
   * @param {number} x
   * @param {number} y
   */
  #isAt(point, x, y) {
    const { viewer, session } = this.#parts.scene();
    const [u, v] = viewer.project(new Float64Array(point.world ?? []));
    return Math.hypot(u - x, v - y) < NEAR * session.ratio;
  }

  /**
   * A point along the ray of a pixel; null where nothing is seen there.
   * @param {number} x
   * @param {number} y
   * @param {boolean} snap to the nearest vertex, where no other snapping was chosen
   */
  #pick(x, y, snap) {
    const { viewer, session } = this.#parts.scene();
    const hit = [...viewer.pick(x, y)];
    if (hit.length === 0) return null;
    // The camera may have moved when the place is found.
    const [ray, next] = [x, x + session.ratio].map((at) => [...viewer.ray(at, y)]);
    const point = new Point({ ray: { origin: ray.slice(0, 3), direction: ray.slice(3) }, world: hit.slice(0, 3), half: hit[3] });
    point.pixel = [x, y];
    const chosen = this.#parts.snap();
    const to = snap && chosen === "none" ? "vertex" : chosen;
    const { drawn } = this;
    point.pick(this.#parts.engine(), { clip: this.#parts.clip(), snap: to, onChange: this.#parts.changed, pixel: (found) => pixelAt([ray, next], found) }).then(
      (isFound) => {
        if (this.isClosed) return;
        if (isFound && point.snapped !== "none") announce(t("measureSnapped", { what: t(SNAPS[point.snapped] ?? "snapVertex") }));
        // Of what is still being drawn, a point that lies on no surface is removed; in the list it is shown with its measurement.
        if (!isFound && drawn && this.drawn === drawn && drawn.points.includes(point)) {
          drawn.points = drawn.points.filter((p) => p !== point);
          notice(t("measureMissed"), 8000);
          this.#step();
        }
      },
      (error) => {
        if (!this.isClosed && error.name !== "AbortError") notice(t("measureFailed", { why: why(error) }), 10000);
      },
    );
    return point;
  }

  /**
   * Keys while a tool is in use; false where they mean nothing.
   * @param {string} key
   */
  key(key) {
    if (!this.drawn) return false;
    if (key === "Backspace") {
      this.undoPoint(false);
      return true;
    }
    if (key !== "Enter" || !this.#isOpenEnded) return false;
    const { length } = this.drawn.points;
    if (this.#isEnough) this.#finish();
    else if (length > 0) notice(t("stepLeast", { count: this.kind.min }));
    return length > 0;
  }

  /**
   * The last point of what is being drawn, taken back or put there again.
   * @param {boolean} isRedo
   */
  undoPoint(isRedo) {
    if (!this.drawn) return false;
    const { points, undone } = this.drawn;
    const [from, to] = isRedo ? [undone, points] : [points, undone];
    const point = from.pop();
    if (!point) return false;
    to.push(point);
    announce(t(isRedo ? "redo" : "measureBack"));
    this.#step();
    return true;
  }

  finish() {
    if (this.canFinish) this.#finish();
  }

  #finish() {
    const { kind } = this;
    const options = this.#parts.options();
    const by = kind.plane && options.plane.name !== "fitted" ? options.plane : null;
    const interval = kind.interval ? options.interval : null;
    if (interval !== null && !(interval > 0)) notice(t("measureInterval"));
    else this.#parts.items.add(new Task({ kind, points: this.drawn?.points ?? [], by, interval }));
    // The tool stays until it is left.
    if (kind.max === 0) this.#parts.tool("orbit");
    else this.#begin();
  }

  /**
   * The place under the pointer: the line from the last point goes there.
   * @param {number} x
   * @param {number} y
   */
  hover(x, y) {
    if (!this.drawn || this.drawn.points.length === 0) return;
    this.hovered = [x, y];
    if (this.hovering) return;
    this.hovering = true;
    requestAnimationFrame(() => {
      this.hovering = false;
      const scene = this.#parts.scene();
      if (!this.drawn || !scene.isOpen) return;
      const hit = [...scene.viewer.pick(...this.hovered)];
      this.cursor = hit.length > 0 ? { world: hit.slice(0, 3), half: hit[3] } : null;
      this.#parts.draw();
    });
  }

  /** What is drawn as it is now, with the place under the pointer; null while there is nothing of it. */
  get task() {
    if (!this.drawn || this.kind.max === 0) return null;
    const points = [...this.drawn.points, ...(this.cursor ? [new Point(this.cursor)] : [])].filter((p) => p.world);
    return points.length > 0 ? new Task({ kind: this.kind, points }) : null;
  }

  // Points that are moved afterwards.

  /**
   * Let the points of a measurement be moved; null: of none.
   * @param {string | null} id
   */
  edit(id) {
    if (this.editing === id && !this.moving) return;
    this.#parts.tool("orbit"); // leaves the tool in use, and this mode
    if (id === null || !this.#parts.items.find(id)) return;
    peek();
    this.#parts.items.chosen = id;
    this.editing = id;
    this.#step();
  }

  /**
   * A handle is dragged to a pixel.
   * @param {string} id
   * @param {number} index
   * @param {number} x
   * @param {number} y
   * @param {boolean} isFinger
   */
  drag(id, index, x, y, isFinger) {
    const item = this.#parts.items.find(id);
    if (!item) return;
    const { viewer, loupe } = this.#parts.scene();
    const hit = [...viewer.pick(x, y)];
    if (isFinger) loupe.show([x, y]);
    if (hit.length === 0) return;
    this.dragged = { id, task: item.task.withPoint(index, new Point({ world: hit.slice(0, 3), half: hit[3] })) };
    this.#parts.draw();
  }

  /**
   * It was let go.
   * @param {string} id
   * @param {number} index
   * @param {number} x
   * @param {number} y
   * @param {boolean} snap
   */
  drop(id, index, x, y, snap) {
    this.#endDrag();
    const item = this.#parts.items.find(id);
    if (!item) return;
    const point = this.#pick(x, y, snap);
    if (!point) {
      notice(t("noteMissed"));
      return;
    }
    this.#parts.items.update("editMove", id, { task: item.task.withPoint(index, point), foreign: null });
    this.#parts.items.offerUndo(t("measureMoved", { number: index + 1, name: item.name }));
  }

  /** It goes back to where it was. */
  cancelDrag() {
    this.#endDrag();
  }

  #endDrag() {
    this.dragged = null;
    this.#parts.scene().loupe.show(null);
    this.#parts.draw();
  }

  /**
   * By keyboard: the crosshair chooses the new place.
   * @param {string} id
   * @param {number} index
   */
  take(id, index) {
    const item = this.#parts.items.find(id);
    const world = item?.task.points[index]?.world;
    if (!world) return;
    const [x, y] = this.#parts.scene().viewer.project(new Float64Array(world));
    if (!Number.isFinite(x)) return;
    this.taken = { id, index, at: [x, y] };
    this.#parts.tool("measure");
  }
}
