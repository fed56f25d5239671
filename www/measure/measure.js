// Measuring in the page: brings the list (items.js), the tool in use (draft.js), what measures (runner.js), the picture (marks.js) and the tab (panel.js)
// together. The geometry is in engine.js (wasm, core/measure), the same that `kilwa measure` has; nothing here computes a value that is final.
//
// A measurement is drawn with places that are picked on what is on screen (provisional, dashed) and at once looked up along the same rays on
// the finest surface; when all are found, it is measured and final (solid). Every change of the list can be undone and is kept by the browser
// for the pack; nothing is lost by a reload, also what is not final yet.

import { announce, elementOf, notice, openTab } from "../chrome.js";
import { $ } from "../dom.js";
import { apply, t } from "../i18n.js";
import { partStyles } from "../part-styles.js";
import { get, put } from "../store.js";
import { LONGEST } from "./address.js";
import { Bar } from "./bar.js";
import { Draft } from "./draft.js";
import { Engine } from "./engine.js";
import { Files } from "./files.js";
import { COLOR, Items } from "./items.js";
import { Marks } from "./marks.js";
import { Panel } from "./panel.js";
import { Runner } from "./runner.js";
import { linesOf, shapeOf } from "./shapes.js";
import { addressed, Sharing } from "./sharing.js";
import { Point, Task } from "./task.js";
import { toolOf } from "./tools.js";
import { mainLines, UNITS } from "./values.js";

/** @import { MeasuringPage } from "../measuring.js" */
/** @import { Box, FrameStats, MeasureItem, MeasureTool, NewMeasurement, Placing, Plane, Ray } from "../types/page.js" */
/** @import { Model } from "../model.js" */
/** @import { Scene } from "../scene.js" */

export class Measure {
  /** @type {Scene | null} */
  #scene = null;
  /** @type {Promise<Engine> | null} */
  #opened = null;
  /** The engine that is open. @type {Engine | null} */
  #current = null;
  #isClosed = false;
  #abort = new AbortController();
  /** A refresh is on its way. */
  #refreshing = false;

  /**
   * @param {{model: Model, page: MeasuringPage, program: () => Promise<WebAssembly.Module>}} parts `program`: the compiled module
   * @param {string | null} linked measurements of the address
   */
  constructor({ model, page, program }, linked) {
    this.model = model;
    this.page = page;
    this.program = program;
    // Earlier versions called the US survey foot ftUS.
    const unit = get("unit") === "ftUS" ? "us-ft" : get("unit");
    this.unit = UNITS.includes(unit) ? unit : "m";
    this.snap = get("snap", "none");
    /** The list is too long for an address. */
    this.isLong = false;
    const { origin } = model.info.pack.lattice;
    const changed = () => this.refresh();
    const clip = () => this.clip;
    const engine = () => this.engine;
    const scene = () => this.scene;
    this.list = new Items({
      hash: model.hash,
      origin,
      undo: page.undo,
      on: {
        changed,
        // At once: a reload would find what the address still held.
        kept: () => page.address.now(),
        counted: (count) => page.emit("measurements", { count }),
        arrived: (item) => this.runner.go(item),
      },
    });
    this.runner = new Runner({
      engine,
      clip,
      origin,
      changed,
      progress: (task) => this.panel.progress(this.list.of(task)),
      ended: (task) => this.#ended(task),
    });
    this.draft = new Draft({
      scene,
      items: this.list,
      engine,
      clip,
      snap: () => this.snap,
      tool: page.tool,
      options: () => ({ plane: this.panel.planeChoice(), interval: this.panel.interval() }),
      changed,
      toolChanged: () => this.#showTools(),
      draw: () => this.#draw(),
    });
    this.marks = new Marks({
      open: (id) => this.choose(id, { focus: true }),
      drag: (id, index, x, y, isFinger) => this.draft.drag(id, index, x, y, isFinger),
      drop: (id, index, x, y, snap) => this.draft.drop(id, index, x, y, snap),
      cancel: () => this.draft.cancelDrag(),
      take: (id, index) => this.draft.take(id, index),
      pins: page.pins,
    });
    this.bar = new Bar({
      draft: this.draft,
      leave: () => page.tool("orbit"),
      snap: () => this.snap,
      setSnap: (snap) => this.setSnap(snap),
    });
    this.files = new Files({ items: this.list, engine, title: () => model.title });
    this.sharing = new Sharing({
      model,
      scene,
      engine,
      files: this.files,
      display: page.display,
      unit: () => this.unit,
      state: page.state,
      cited: (id, words, address) => this.panel.cited(id, words, address),
    });
    this.panel = new Panel({
      items: this.list,
      draft: this.draft,
      runner: this.runner,
      files: this.files,
      sharing: this.sharing,
      undo: page.undo,
      bounds: model.info.metadata,
      settings: () => ({ unit: this.unit, snap: this.snap, isLong: this.isLong, setUnit: (unit) => this.setUnit(unit), setSnap: (snap) => this.setSnap(snap) }),
      lines: (item) => this.linesOf(item.task),
      choose: (id) => this.choose(id),
      pointed: ({ color, hidden }, world) => this.marks.point(world && !hidden && !this.#isClosed ? { color, world } : null),
    });
    this.list.restore(linked);
    const key = (/** @type {KeyboardEvent} */ event) => {
      if (event.key === "Escape" && !elementOf(event)?.closest("dialog")) this.draft.edit(null);
    };
    document.addEventListener("keydown", key, { signal: this.#abort.signal });
  }

  get scene() {
    if (!this.#scene) throw new Error("the model is not open");
    return this.#scene;
  }

  /** The measuring engine, opened when it is first asked for. */
  get engine() {
    // Failures are those of the network or of the program: the next question tries again.
    if (this.#current?.closed) this.#opened = this.#current = null;
    const { pack, head, identity } = this.model;
    this.#opened ??= Engine.open({
      pack,
      head,
      viewer: () => (this.#scene?.isOpen ? this.#scene.viewer : null),
      pages: () => this.#scene?.session.pages ?? new Map(),
      footer: identity.footer,
      program: this.program(),
    }).then(
      (engine) => {
        this.#current = engine;
        return engine;
      },
      (error) => {
        this.#opened = null;
        throw error;
      },
    );
    return this.#opened;
  }

  /** The measurements. */
  get items() {
    return this.list.all;
  }

  /** @param {Scene} scene */
  attach(scene) {
    this.#scene = scene;
    this.marks.attach(scene);
    this.refresh();
  }

  close() {
    this.leave();
    this.#abort.abort();
    this.#isClosed = this.draft.isClosed = true;
    this.runner.close(this.items);
    this.marks.close();
    this.panel.close();
    this.#opened?.then((engine) => engine.close()).catch(() => {});
  }

  /** @param {import("./task.js").Task} task */
  #ended(task) {
    this.list.keep();
    this.refresh();
    const item = this.list.of(task);
    if (!item) return;
    const result = task.isFinal
      ? mainLines(task.tool, task.readings, this.unit, task.uncertainty).join(", ")
      : task.state === "missed"
        ? t("measureMissed")
        : task.refusal?.();
    if (result) announce(`${item.name}: ${result}`);
    if (task.isFinal) this.page.emit("measurement", this.plain(item));
    if (task.state === "missed") notice(t("measureMissed"), 8000);
  }

  /** The clip of the model: picks go through what is cut away. @returns {{clipPlane: Plane | null, clipBox: Box | null}} */
  get clip() {
    const { clipPlane, clipBox } = this.page.display.state;
    return { clipPlane: clipPlane ?? null, clipBox: clipBox ?? null };
  }

  // The tool in use (draft.js).

  /** @param {string | null} name */
  start(name = null) {
    this.draft.start(name);
  }

  leave() {
    this.draft.leave();
  }

  hint() {
    return this.draft.hint();
  }

  /**
   * @param {number} x
   * @param {number} y
   * @param {Placing} how
   */
  place(x, y, how) {
    this.draft.place(x, y, how);
  }

  /**
   * @param {number} x
   * @param {number} y
   */
  hover(x, y) {
    this.draft.hover(x, y);
  }

  /** @param {string} key */
  key(key) {
    return this.draft.key(key);
  }

  /** @param {boolean} isRedo */
  undoPoint(isRedo) {
    return this.draft.undoPoint(isRedo);
  }

  #showTools() {
    if (this.#isClosed) return;
    this.bar.show();
    this.panel.showTools();
  }

  // What is seen.

  /**
   * Open a measurement: its row, its handles.
   * @param {string} id
   * @param {{focus?: boolean}} how
   */
  choose(id, { focus = false } = {}) {
    this.list.chosen = this.list.chosen === id && !focus ? null : id;
    this.refresh();
    if (!focus) return;
    openTab("measure");
    this.panel.focus(id);
  }

  /** @param {string} unit */
  setUnit(unit) {
    this.unit = unit;
    put("unit", unit === "m" ? null : unit);
    this.refresh();
  }

  /** @param {string} snap */
  setSnap(snap) {
    this.snap = snap;
    put("snap", snap === "none" ? null : snap);
    this.#showTools();
  }

  refresh() {
    if (this.#isClosed || this.#refreshing) return;
    this.#refreshing = true;
    queueMicrotask(() => {
      this.#refreshing = false;
      if (this.#isClosed) return;
      if (this.draft.editing !== this.list.chosen) this.draft.edit(null);
      this.panel.show();
      this.#draw();
    });
  }

  #draw() {
    if (!this.#scene) return;
    const { dragged, drawn, editing, moving, task } = this.draft;
    const shapes = this.items
      .filter((item) => !item.hidden)
      .map((item) => {
        const shown = dragged?.id === item.id ? { ...item, task: dragged.task } : item;
        const canMove = shown.task.points.length > 0 && !drawn && editing === item.id;
        return shapeOf(shown, { label: linesOf(shown.task, this.unit), chosen: this.list.chosen === item.id, canMove });
      });
    if (task) {
      const draft = { id: "draft", name: t("measureDraft"), color: COLOR, task };
      shapes.push(shapeOf(draft, { label: linesOf(task, this.unit, { isDraft: true }), chosen: false, canMove: false }));
    }
    // While a tool is in use, presses are its own, also on other measurements.
    $("mark-labels").classList.toggle("still", Boolean(drawn || moving));
    this.marks.set(shapes);
  }

  /** @param {FrameStats} stats */
  frame(stats) {
    this.marks.frame(stats);
  }

  translate() {
    this.bar.show();
    this.panel.build();
    apply($("measure"));
    this.refresh();
  }

  /** What the address holds; null where it would be too long. */
  address() {
    const text = addressed(this.items);
    this.isLong = text.length > LONGEST;
    return this.isLong || text === "" ? null : text;
  }

  // For a headset (headset/tape.js), where places are picked along rays.

  /**
   * A place along a ray, looked up on the finest surface at once; it does not snap, for the magnet cannot be seen there. `world` and `half` as in Point; `pixel`:
   * how wide what points is at a place.
   * @param {Ray} ray
   * @param {{world: number[], half: number, pixel: (found: import("./task.js").Found) => number}} seen
   */
  pointAlong(ray, { world, half, pixel }) {
    const point = new Point({ ray, world, half });
    point.pick(this.engine, { clip: this.clip, snap: "none", onChange: () => this.refresh(), pixel });
    return point;
  }

  /** @param {(Point | {world: number[], half: number})[]} places */
  distanceOf(places) {
    return new Task({ kind: /** @type {MeasureTool} */ (toolOf("distance")), points: places.map((p) => (p instanceof Point ? p : new Point(p))) });
  }

  /**
   * The lines of its label.
   * @param {Task} task
   * @param {boolean} isDraft
   */
  linesOf(task, isDraft = false) {
    return linesOf(task, this.unit, { isDraft });
  }

  // For scripts (api.js).

  /**
   * @param {MeasureItem} item
   * @returns {import("../types/page.js").Measurement}
   */
  plain({ id, name, color, hidden, note, task }) {
    const points = /** @type {[number, number, number][]} */ (task.points.map((p) => p.world));
    return { id, name, tool: task.tool, state: task.state, points, readings: task.readings, refusal: task.refusal?.() ?? null, color, hidden, note };
  }

  /**
   * Take one away; false where there is none of that id.
   * @param {string} id
   */
  remove(id) {
    const item = this.list.find(id);
    if (item) this.list.remove(item);
    return Boolean(item);
  }

  /**
   * Add one for a script; resolves when it is final or refused.
   * @param {NewMeasurement} measurement
   */
  async addPlain(measurement) {
    const { rays = [], points = [], name = "", plane = null, interval = null, reach = null, color, note = "" } = measurement;
    const kind = checked(measurement);
    const { origin } = (await this.engine).pack.lattice;
    const local = (/** @type {number[]} */ world) => world.map((v, i) => v - origin[i]);
    const given = [...points.map((world) => new Point({ world, local: local(world), half: 0 })), ...rays.map((ray) => new Point({ ray }))];
    const task = new Task({ kind, points: given, plane: plane && { point: local(plane.point), normal: plane.normal }, reach, interval });
    const item = this.list.add(task, { ...(name ? { name: String(name).slice(0, 200) } : {}), ...(color ? { color } : {}), note: String(note) });
    if (!item) throw new Error("there are too many measurements");
    await task.running;
    return this.plain(item);
  }
}

/**
 * The tool of a measurement that a script asks for; throws where something of it is not as it should be.
 * @param {NewMeasurement} measurement
 * @returns {MeasureTool}
 */
function checked({ tool, points = [], rays = [], color }) {
  const kind = toolOf(tool) ?? (tool === "section" ? toolOf("section-points") : undefined);
  if (!kind) throw new TypeError("tool: no such tool");
  const isPlace = (/** @type {unknown} */ p) => Array.isArray(p) && p.length === 3 && p.every((v) => Number.isFinite(v));
  if (!points.every(isPlace)) throw new TypeError("points: three numbers each, metres");
  if (!rays.every((r) => isPlace(r?.origin) && isPlace(r?.direction))) throw new TypeError("rays: origin and direction, three numbers each");
  if (color !== undefined && !/^#[0-9a-f]{6}$/.test(color)) throw new TypeError("color: #rrggbb");
  return kind;
}

/** The sheet of what is only here. */
export const styles = () => partStyles("measure.css");
