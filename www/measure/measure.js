// Measuring in the page: the tool that is chosen, what is being drawn, the list of measurements, and what becomes of each. The geometry is
// in engine.js (wasm, core/measure), the same that `kilwa measure` has; nothing here computes a value that is final.
//
// A measurement is drawn with places that are picked on what is on screen (provisional, dashed) and at once looked up along the same rays on
// the finest surface; when all are found, it is measured and final (solid). Every change of the list can be undone and is kept by the browser
// for the pack; nothing is lost by a reload, also what is not final yet.

import { notice, hint, openTab, peek } from "../chrome.js";
import { apply, t } from "../i18n.js";
import { writeState } from "../link.js";
import { moved } from "../list.js";
import { sentence, why } from "../said.js";
import { get, put, unique } from "../store.js";
import { LONGEST, read as readAddress, write as writeAddress } from "./address.js";
import { Bar } from "./bar.js";
import { citation } from "./cite.js";
import { Engine } from "./engine.js";
import { Files } from "./files.js";
import { Marks } from "./marks.js";
import { Panel } from "./panel.js";
import { Point, Task } from "./task.js";
import { SNAPS, kindName, stepText, toolOf } from "./tools.js";
import { UNITS, about, mainLines, text } from "./values.js";

const $ = (id) => document.getElementById(id);
export const MOST = 1000;
const COLOR = "#1668c7";
/** A press so near to the last one is a second press of a double click, and near the first point it closes the polygon; CSS pixels. */
const NEAR = 10;
const isTouch = () => matchMedia("(pointer: coarse)").matches;

export class Measure {
  /** @param {object} page @param {string | null} linked measurements of the address */
  constructor(page, linked) {
    this.page = page;
    this.hash = page.info.pack.hash;
    this.kept = `measurements.${this.hash}`;
    // Earlier versions called the US survey foot ftUS.
    const unit = get("unit") === "ftUS" ? "us-ft" : get("unit");
    this.unit = UNITS.includes(unit) ? unit : "m";
    this.snap = get("snap", "none");
    this.kind = toolOf("distance");
    this.draft = null; // { points, taken } while a tool is in use
    this.moving = null; // { id, index } of a point whose place is chosen anew
    this.cursor = null; // the place under the pointer
    this.chosen = null; // id of the measurement that is open
    this.isLong = false;
    this.items = [];
    this.marks = new Marks({
      open: (id) => this.choose(id, { focus: true }),
      drag: (id, index, x, y, finger) => this.#drag(id, index, x, y, finger),
      drop: (id, index, x, y, snap) => this.#drop(id, index, x, y, snap),
      take: (id, index) => this.#take(id, index),
    });
    this.bar = new Bar(this);
    this.files = new Files(this);
    this.panel = new Panel(this);
    this.#restore(linked);
  }

  get engine() {
    // Failures are those of the network or of the program: the next question tries again.
    if (this.current?.closed) this.opened = this.current = null;
    this.opened ??= Engine.open({
      pack: this.page.pack, head: this.page.headBytes, viewer: () => (this.session?.closed ? null : this.viewer),
      pages: () => this.session?.pages ?? new Map(), footer: this.page.identity.footer, program: this.page.measuring.program(),
    }).then(
      (engine) => (this.current = engine),
      (error) => {
        this.opened = null;
        throw error;
      },
    );
    return this.opened;
  }

  attach(viewer, session) {
    Object.assign(this, { viewer, session });
    this.marks.attach(viewer, session);
    this.refresh();
  }

  close() {
    this.isClosed = true;
    this.leave();
    for (const { task } of this.items) task.abort?.abort();
    this.marks.close();
    this.panel.close();
    this.opened?.then((engine) => engine.close()).catch(() => {});
  }

  // What is kept.

  /** Of the browser, and of the address that opened the page. */
  #restore(linked) {
    const kept = get(this.kept, []);
    this.origin = this.page.info.pack.lattice.origin;
    this.items = (Array.isArray(kept) ? kept : []).map((one) => this.#item(one)).filter(Boolean);
    if (linked) {
      const { found, left } = readAddress(linked);
      const have = new Set(this.items.map(({ task }) => writeAddress([{ ...task.record(), name: "" }])));
      const more = found.filter((one) => !have.has(writeAddress([{ ...one, name: "", color: undefined, hidden: false }])));
      const added = more.map((one) => this.#item(one)).filter(Boolean);
      if (added.length > 0) this.change([...this.items, ...added]);
      if (left > 0) notice(t("measureLinkCut", { count: left }), 10000);
    }
    for (const item of this.items) this.#go(item);
  }

  /** A measurement from plain data; null where it is none. */
  #item(one) {
    try {
      const { id = unique(), name = "", color = COLOR, hidden = false, note = "", foreign = null } = one;
      const task = Task.of(one, this.origin);
      return { id, name: name || this.#newName(task.kind), color, hidden, note, foreign, task };
    } catch {
      return null;
    }
  }

  #newName(kind) {
    const same = this.items.filter(({ task }) => task.kind.key === kind.key || (task.tool === "section" && kind.tool === "section")).length;
    return `${kindName(kind)} ${same + 1}`;
  }

  /** As it is kept: the fields of a file's measurement, and what is not final. */
  keep() {
    const kept = this.items.map(({ id, name, color, hidden, note, foreign, task }) => {
      const { local, ...record } = task.record();
      const isFound = task.points.every((p) => p.isFinal);
      const places = isFound ? { local } : { rays: task.points.map((p) => p.ray) };
      const result = task.isFinal ? { readings: task.readings, uncertainty: task.uncertainty, date: task.date, fitted: task.fitted } : {};
      return { id, name, color, hidden, note, foreign, kind: task.kind.id, ...record, ...places, ...result };
    });
    if (!put(this.kept, kept.length > 0 ? kept : null) && !this.saidNotKept) {
      this.saidNotKept = true;
      notice(t("notKept"));
    }
    // At once: a reload would find what the address still said.
    this.page.address.now();
  }

  /** Another list, as an edit that can be taken back. */
  change(items, before = this.items) {
    const set = (list) => {
      this.items = list;
      if (!list.some((i) => i.id === this.chosen)) this.chosen = null;
      this.keep();
      this.refresh();
      this.page.api.emit("measurements", { count: list.length });
    };
    this.page.undo.do({
      undo: () => set(before),
      redo: () => {
        set(items);
        for (const item of items) this.#go(item);
      },
    });
  }

  /** One measurement with other words, colour or place on screen. */
  update(id, fields) {
    this.change(this.items.map((i) => (i.id === id ? { ...i, ...fields } : i)));
  }

  /** A note while it is written: kept with every letter; one edit when it is left. */
  type(id, note) {
    this.before ??= this.items;
    this.items = this.items.map((i) => (i.id === id ? { ...i, note } : i));
    this.keep();
  }

  typed() {
    const before = this.before;
    this.before = null;
    if (before && before !== this.items) this.change(this.items, before);
  }

  /** Measurements of a file, as one edit; what is here already stays as it is. */
  take(records) {
    const signature = (item) => JSON.stringify([item.name, item.note, item.task.record()]);
    const have = new Set(this.items.map(signature));
    const all = records.map((one) => this.#item({ ...one, id: unique() })).filter(Boolean);
    const more = all.filter((item) => !have.has(signature(item)));
    if (this.items.length + more.length > MOST) throw new Error(t("importTooMany", { count: this.items.length + more.length, most: MOST }));
    if (more.length > 0) this.change([...this.items, ...more]);
    notice(t("imported", { count: all.length }), 6000);
  }

  move(item, by) {
    this.change(moved(this.items, item, by));
  }

  remove(item) {
    this.change(this.items.filter((i) => i.id !== item.id));
    notice(t("deleted", { name: item.name }), 10000, { label: t("undo"), run: () => this.page.undo.undo() });
  }

  removeAll() {
    const count = this.items.length;
    this.change([]);
    notice(t("measureAllDeleted", { count }), 10000, { label: t("undo"), run: () => this.page.undo.undo() });
  }

  add(task, more = {}) {
    if (this.items.length >= MOST) {
      notice(t("importTooMany", { count: this.items.length + 1, most: MOST }));
      return null;
    }
    const item = { id: unique(), name: this.#newName(task.kind), color: COLOR, hidden: false, note: "", foreign: null, task, ...more };
    this.chosen = item.id;
    this.change([...this.items, item]);
    return item;
  }

  // Measuring.

  /** Whatever is missing for a measurement: its places, then its values. Runs once for each task. */
  async #go({ task }) {
    const isOpen = task.state === "picking" || (task.isFinal && task.kind.draws && task.lines.length === 0);
    if (task.running || !isOpen) return task.running;
    task.running = this.#measure(task).finally(() => (task.running = null));
    return task.running;
  }

  async #measure(task) {
    task.abort = new AbortController();
    const { signal } = task.abort;
    const had = task.isFinal ? task.readings : null;
    try {
      for (const point of task.points) if (!point.done) point.pick(this.engine, { clip: null, snap: "none", onChange: () => this.refresh() });
      this.#guess(task, signal);
      const all = await Promise.all(task.points.map((p) => p.done));
      if (all.includes(false)) {
        task.state = "missed";
        return;
      }
      const engine = await this.engine;
      if (!task.plane) {
        const plane = task.planeFrom({ origin: this.origin, clipPlane: this.clip.clipPlane });
        if (typeof plane === "string") {
          Object.assign(task, { state: "refused", refusal: () => t(plane) });
          return;
        }
        task.plane = plane;
      }
      if (!had) task.state = "measuring";
      this.refresh();
      const progress = ({ done = 0, all = 0, waiting = null }) => {
        Object.assign(task, { progress: all > 0 ? done / all : null, waiting });
        this.panel.progress(task);
      };
      const found = await engine.measure(task.record(), { unit: "m", progress, signal });
      this.#found(task, found, engine);
    } catch (error) {
      if (error.name === "AbortError") return;
      Object.assign(task, { state: had ? "final" : "failed", refusal: had ? null : () => why(error) });
    } finally {
      task.progress = null;
      if (!this.isClosed) {
        this.keep();
        this.refresh();
        this.#tell(task);
      }
    }
  }

  /** What the places as they are known now give, while the finest surface is on its way. */
  async #guess(task, signal) {
    try {
      const engine = await this.engine;
      const rough = task.rough();
      if (!rough || task.points.every((p) => p.isFinal)) return;
      const found = await engine.measure(rough.task, { level: rough.level, signal });
      if (found.refusal || task.isFinal) return;
      task.guess = found.readings;
      this.refresh();
    } catch {
      // It is a guess: what is final says what is wrong.
    }
  }

  #found(task, found, engine) {
    if (found.refusal) {
      Object.assign(task, { state: "refused", refusal: () => sentence(found.said), readings: [] });
      return;
    }
    const step = 2 ** engine.pack.lattice.step_log2;
    const capture = Number.isFinite(engine.pack.capture) ? engine.pack.capture : null;
    const uncertainty = found.uncertainty ?? { lattice: step / Math.sqrt(12), level: 0, capture };
    const { readings, parts = [], remarks = [], lines = [], read = null } = found;
    task.date ??= today();
    task.fitted = found.details?.plane ?? null;
    const drawn = lines.map(({ world, closed }) => (closed ? [...world, world[0]] : world));
    Object.assign(task, { state: "final", readings, parts, remarks, lines: drawn, answer: lines.length > 0 ? found : null, read, uncertainty, refusal: null });
  }

  #tell(task) {
    const item = this.items.find((i) => i.task === task);
    if (!item) return;
    const says = { final: () => mainLines(task.tool, task.readings, this.unit).join(", "), refused: task.refusal, missed: () => t("measureMissed"), failed: task.refusal }[task.state];
    if (says) this.say(`${item.name}: ${says()}`);
    if (task.isFinal) this.page.api.emit("measurement", this.plain(item));
    if (task.state === "missed") notice(t("measureMissed"), 8000);
  }

  /** Measure again what failed. */
  again(item) {
    for (const point of item.task.points) if (!point.isFinal) Object.assign(point, { done: null, isMissed: false });
    item.task.state = "picking";
    this.refresh();
    this.#go(item);
  }

  say(words) {
    $("announce").textContent = words;
  }

  /** What cuts the model: picks go through what is cut away. */
  get clip() {
    const { clipPlane = null, clipBox = null } = JSON.parse(this.viewer.displayState());
    return { clipPlane, clipBox };
  }

  // The tool in use.

  /** Choose a tool by its name; without one, the last. */
  start(name = null) {
    this.moving = this.taken ?? null;
    if (this.taken) {
      this.page.input.showPoint(this.taken.at);
      this.taken = this.draft = null;
      this.#step();
      return;
    }
    this.kind = toolOf(name ?? this.kind.id) ?? this.kind;
    this.#begin();
    if (this.kind.most === 0) this.#finish();
    this.panel.showTools();
  }

  /** A tool of the panel or of a script. */
  use(name) {
    this.kind = toolOf(name) ?? this.kind;
    this.page.tool("measure", this.kind.id);
  }

  #begin() {
    this.draft = { points: [], undone: [] };
    this.cursor = null;
    this.#step();
  }

  leave() {
    if (!this.draft && !this.moving) return;
    this.draft = this.moving = this.cursor = null;
    this.bar.hide();
    this.panel.showTools();
    this.refresh();
  }

  hint() {
    if (this.moving) return t(isTouch() ? "measureMoveTouch" : "measureMove");
    if (!this.draft || this.kind.most === 0) return null;
    return stepText(this.kind, this.draft.points.length, isTouch());
  }

  #step() {
    hint(this.hint());
    this.bar.show();
    this.refresh();
  }

  /** A press on the picture. `isKey`: by the crosshair, which stays. */
  place(x, y, { snap = false, isKey = false } = {}) {
    if (this.moving) {
      const { id, index } = this.moving;
      this.moving = null;
      this.#drop(id, index, x, y, snap);
      this.page.tool("orbit");
      return;
    }
    if (!this.draft) return;
    const { points } = this.draft;
    const isMany = this.kind.most === Infinity;
    const near = (point) => point?.pixel && Math.hypot(point.pixel[0] - x, point.pixel[1] - y) < NEAR * this.session.ratio;
    const now = performance.now();
    if (!isKey && near(points.at(-1)) && now - this.pressed < 500) {
      // The second press of a double click is no further point.
      if (isMany && points.length >= this.kind.least) this.#finish();
      return;
    }
    this.pressed = now;
    if (isMany && this.kind.closed && points.length >= this.kind.least && this.#isAt(points[0], x, y)) {
      this.#finish();
      return;
    }
    const point = this.#pick(x, y, snap);
    if (!point) {
      notice(t("noteMissed"));
      return;
    }
    points.push(point);
    this.draft.undone = [];
    this.say(t("measurePlaced", { number: points.length }));
    if (points.length >= this.kind.most) this.#finish();
    else this.#step();
    if (!isKey) this.page.input.showPoint(null);
  }

  #isAt(point, x, y) {
    const [u, v] = this.viewer.project(new Float64Array(point.world));
    return Math.hypot(u - x, v - y) < NEAR * this.session.ratio;
  }

  /** A point along the ray of a pixel; null where nothing is seen there. */
  #pick(x, y, snap) {
    const hit = this.viewer.pick(x, y);
    if (hit.length === 0) return null;
    const ray = this.viewer.ray(x, y);
    const point = new Point({ ray: { origin: [...ray.slice(0, 3)], direction: [...ray.slice(3, 6)] }, world: [...hit.slice(0, 3)], half: hit[3] });
    point.pixel = [x, y];
    const way = snap || this.snap !== "none" ? (this.snap === "none" ? "vertex" : this.snap) : "none";
    const { draft } = this;
    point.pick(this.engine, { clip: this.clip, snap: way, onChange: () => this.refresh() }).then(
      (isFound) => {
        if (this.isClosed) return;
        if (isFound && point.snapped !== "none" && point.snapped) this.say(t("measureSnapped", { what: t(SNAPS[point.snapped] ?? "snapVertex") }));
        // Of what is still being drawn, a point that is nowhere goes; what is in the list says so itself.
        if (!isFound && draft && this.draft === draft && draft.points.includes(point)) {
          draft.points = draft.points.filter((p) => p !== point);
          notice(t("measureMissed"), 8000);
          this.#step();
        }
      },
      (error) => !this.isClosed && error.name !== "AbortError" && notice(t("measureFailed", { why: why(error) }), 10000),
    );
    return point;
  }

  /** Keys while a tool is in use; false where they mean nothing. */
  key(key) {
    if (key === "Enter" && this.draft) {
      if (this.draft.points.length >= this.kind.least && this.kind.most === Infinity) {
        this.#finish();
        return true;
      }
      if (this.kind.most !== Infinity) return false;
      if (this.draft.points.length > 0) notice(t("stepLeast", { count: this.kind.least }));
      return this.draft.points.length > 0;
    }
    if (key === "Backspace" && this.draft) return this.undoPoint(false) || true;
    return false;
  }

  get canFinish() {
    return Boolean(this.draft) && this.kind.most === Infinity && this.draft.points.length >= this.kind.least;
  }

  /** The last point of what is being drawn, taken back or put there again. */
  undoPoint(isRedo) {
    if (!this.draft) return false;
    const { points, undone } = this.draft;
    const from = isRedo ? undone : points;
    if (from.length === 0) return false;
    (isRedo ? points : undone).push(from.pop());
    this.say(t(isRedo ? "redo" : "measureBack"));
    this.#step();
    return true;
  }

  finish() {
    if (this.canFinish) this.#finish();
  }

  #finish() {
    const { points } = this.draft;
    const { kind } = this;
    const by = kind.plane ? this.panel.planeChoice() : null;
    const interval = kind.interval ? this.panel.interval() : null;
    const task = new Task({ kind, points, by: by?.name === "fitted" ? null : by, interval });
    if (kind.interval && !(interval > 0)) {
      notice(t("measureInterval"));
    } else {
      this.add(task);
    }
    if (kind.most === 0) {
      this.page.tool("orbit");
      return;
    }
    // The tool stays until it is left.
    this.#begin();
  }

  /** The place under the pointer: the line from the last point goes there. */
  hover(x, y) {
    if (!this.draft || this.draft.points.length === 0) return;
    this.hovered = [x, y];
    if (this.hovering) return;
    this.hovering = true;
    requestAnimationFrame(() => {
      this.hovering = false;
      if (!this.draft || this.session.closed) return;
      const hit = this.viewer.pick(...this.hovered);
      this.cursor = hit.length > 0 ? { world: [...hit.slice(0, 3)], half: hit[3] } : null;
      this.#draw();
    });
  }

  // Points that are moved afterwards.

  #drag(id, index, x, y, isFinger) {
    const item = this.items.find((i) => i.id === id);
    if (!item) return;
    const hit = this.viewer.pick(x, y);
    if (isFinger) this.page.loupe.show([x, y]);
    if (hit.length === 0) return;
    const task = item.task.withPoint(index, new Point({ world: [...hit.slice(0, 3)], half: hit[3] }));
    this.dragged = { id, task };
    this.#draw();
  }

  #drop(id, index, x, y, snap) {
    this.dragged = null;
    this.page.loupe.show(null);
    const item = this.items.find((i) => i.id === id);
    const point = item && x !== null ? this.#pick(x, y, snap) : null;
    if (!point) {
      if (item && x !== null) notice(t("noteMissed"));
      this.#draw();
      return;
    }
    this.update(id, { task: item.task.withPoint(index, point), foreign: null });
  }

  #take(id, index) {
    const item = this.items.find((i) => i.id === id);
    const at = item && this.viewer.project(new Float64Array(item.task.points[index].world));
    if (!at || !Number.isFinite(at[0])) return;
    this.taken = { id, index, at: [at[0], at[1]] };
    this.page.tool("measure");
  }

  // What is seen.

  /** Open a measurement: its row, its handles. */
  choose(id, { focus = false } = {}) {
    this.chosen = this.chosen === id && !focus ? null : id;
    this.refresh();
    if (!focus) return;
    openTab("measure");
    this.panel.focus(id);
  }

  setUnit(unit) {
    this.unit = unit;
    put("unit", unit === "m" ? null : unit);
    this.refresh();
  }

  setSnap(snap) {
    this.snap = snap;
    put("snap", snap === "none" ? null : snap);
    this.bar.show();
    this.panel.showTools();
  }

  refresh() {
    if (this.isClosed) return;
    if (this.refreshing) return;
    this.refreshing = true;
    queueMicrotask(() => {
      this.refreshing = false;
      if (this.isClosed) return;
      this.panel.show();
      this.#draw();
    });
  }

  /** What a measurement says now. */
  lines({ id, task }) {
    if (id === "draft") return task.provisional ? [about(task.provisional.value, task.provisional.half, this.unit)] : [];
    switch (task.state) {
      case "final":
        return mainLines(task.tool, task.readings, this.unit);
      case "refused":
      case "failed":
      case "missed":
        return [];
      default: {
        const { provisional } = task;
        if (task.guess.length > 0) return mainLines(task.tool, task.guess, this.unit).map((line, k, all) => (k === all.length - 1 ? t("refining", { value: `≈ ${line}` }) : `≈ ${line}`));
        return [provisional ? t("refining", { value: about(provisional.value, provisional.half, this.unit) }) : t("refiningNoValue")];
      }
    }
  }

  #draw() {
    if (!this.viewer) return;
    const shapes = this.items.filter((i) => !i.hidden).map((item) => this.#shape(this.dragged?.id === item.id ? { ...item, task: this.dragged.task } : item));
    if (this.draft && this.kind.most > 0) {
      const points = [...this.draft.points, ...(this.cursor ? [new Point(this.cursor)] : [])].filter((p) => p.world);
      const task = new Task({ kind: this.kind, points });
      if (points.length > 0) shapes.push(this.#shape({ id: "draft", name: t("measureDraft"), color: COLOR, task }));
    }
    // While a tool is in use, presses are its own, also where other measurements stand.
    $("mark-labels").classList.toggle("still", Boolean(this.draft || this.moving));
    this.marks.set(shapes);
  }

  #shape(item) {
    const { id, name, color, task } = item;
    const dots = task.points.map((p) => p.world).filter(Boolean);
    const isFinal = task.isFinal;
    const drawn = task.lines.length > 0;
    const joins = !["coordinate", "height", "circle", "plane-angle"].includes(task.tool) && !(task.tool === "section" && drawn);
    const planes = task.tool === "plane-angle" ? [dots.slice(0, 3), dots.slice(3)] : task.tool === "height" ? [dots.slice(0, 3)] : [];
    const paths = drawn ? task.lines : joins ? (dots.length > 1 ? [dots] : []) : planes.filter((p) => p.length > 1).map((p) => (p.length > 2 ? [...p, p[0]] : p));
    const closed = joins && !drawn && Boolean(task.kind.closed) && dots.length > 2;
    return {
      id, name, color, closed, paths, dots, dashed: !isFinal, straight: !drawn, chosen: this.chosen === id, canMove: task.points.length > 0 && !this.draft,
      label: this.lines(item), anchor: anchorOf(task, dots, drawn),
    };
  }

  frame(stats) {
    this.marks.frame(stats);
  }

  translate() {
    this.bar.show();
    this.panel.build();
    apply($("measure"));
    this.refresh();
  }

  // Words about a measurement.

  /** All it says, a line for each value, for the clipboard. */
  words({ name, task }) {
    return [name, ...task.readings.map((r) => `${r.name} ${text(r, this.unit)}`)].join("\n");
  }

  async copy(words, done = "measureCopied") {
    try {
      await navigator.clipboard.writeText(words);
      notice(t(done), 2500);
    } catch {
      notice(t("measureCopyFailed"), 6000);
    }
  }

  async cite(item) {
    try {
      const sentence = await citation(await this.engine, this.files.measurement(item), {
        kind: item.task.kind,
        lang: document.documentElement.lang,
        unit: this.unit,
        published: this.page.pack.isLocal ? "" : (document.body.dataset.title ?? ""),
      });
      const address = this.addressOf(item);
      this.panel.cited(item.id, sentence, address);
      await this.copy(address ? `${sentence} ${address}` : sentence, "measureCited");
    } catch (error) {
      notice(t("measureFailed", { why: why(error) }), 10000);
    }
  }

  /** A deviation as colours on the model: distances from its plane, as far as it found any. */
  async colour({ task }) {
    try {
      const { details, readings } = await (await this.engine).measure(task.record());
      const reach = Math.max(...readings.filter((r) => ["lowest", "highest"].includes(r.name)).map((r) => Math.abs(r.value)), 1e-6);
      const { normal, point } = details.plane;
      this.page.look.change({ mode: "distance", plane: { normal, point }, range: [-reach, reach] });
    } catch (error) {
      notice(t("measureFailed", { why: why(error) }), 10000);
    }
  }

  /** The distance from the plane of a measurement as colours on the model, with its legend in the Display tab. */
  map({ task }) {
    const of = (name) => Math.abs(task.readings.find((r) => r.name === name)?.value ?? 0);
    const most = Math.max(of("lowest"), of("highest"));
    const { plane, range, ...rest } = this.page.display() ?? {};
    this.page.setDisplay({ ...rest, mode: "distance", plane: task.fitted, ...(most > 0 ? { range: [-most, most] } : {}) });
    openTab("display");
    peek();
  }

  /** Fly to a measurement, so that all of it is seen. */
  look({ task }) {
    const places = task.lines.length > 0 ? task.lines.flat() : task.points.map((p) => p.world).filter(Boolean);
    if (places.length === 0) {
      this.page.fit();
      return;
    }
    const low = [0, 1, 2].map((i) => places.reduce((m, p) => Math.min(m, p[i]), Infinity));
    const high = [0, 1, 2].map((i) => places.reduce((m, p) => Math.max(m, p[i]), -Infinity));
    const middle = low.map((v, i) => (v + high[i]) / 2);
    const across = Math.hypot(...high.map((v, i) => v - low[i]));
    this.page.lookAtRegion(middle, across);
    peek();
  }

  /** Where a citation leads: this model, seen as now, with this one measurement; null for a file of this computer. */
  addressOf({ name, color, task }) {
    if (this.page.pack.isLocal) return null;
    const measurements = writeAddress([{ ...task.record(), name, color: color === COLOR ? undefined : color }]);
    const given = new URLSearchParams(location.search).get("pack");
    const search = given ? `?pack=${encodeURIComponent(given)}` : "";
    const state = { ...this.page.state(), measurements: measurements.length > LONGEST ? null : measurements, annotation: null };
    return `${location.origin}${location.pathname}${search}${writeState(state)}`;
  }

  /** What the address holds; null where it would be too long. */
  address() {
    const found = this.items.filter(({ task }) => task.points.every((p) => p.isFinal) && (task.points.length > 0 || task.state !== "picking"));
    const words = writeAddress(found.map(({ name, color, hidden, task }) => ({ ...task.record(), name, hidden, color: color === COLOR ? undefined : color })));
    this.isLong = words.length > LONGEST;
    return this.isLong || words === "" ? null : words;
  }

  // For scripts (api.js).

  plain(item) {
    const { task } = item;
    const points = task.points.map((p) => p.world);
    return { id: item.id, name: item.name, tool: task.tool, state: task.state, points, readings: task.readings, refusal: task.refusal?.() ?? null, color: item.color, hidden: item.hidden, note: item.note };
  }

  /** Add one for a script; resolves when it is final or refused. */
  async addPlain({ tool, points = [], rays = [], name = "", plane = null, interval = null, reach = null, color, note = "" }) {
    const kind = toolOf(tool) ?? (tool === "section" ? toolOf("section-points") : null);
    if (!kind) throw new TypeError("tool: no such tool");
    const isPlace = (p) => Array.isArray(p) && p.length === 3 && p.every(Number.isFinite);
    if (!points.every(isPlace)) throw new TypeError("points: three numbers each, metres");
    if (!rays.every((r) => isPlace(r?.origin) && isPlace(r?.direction))) throw new TypeError("rays: origin and direction, three numbers each");
    if (color !== undefined && !/^#[0-9a-f]{6}$/.test(color)) throw new TypeError("color: #rrggbb");
    const { lattice } = (await this.engine).pack;
    const given = [
      ...points.map((world) => new Point({ world, local: world.map((v, i) => v - lattice.origin[i]), half: 0 })),
      ...rays.map((ray) => new Point({ ray })),
    ];
    const local = plane && { point: plane.point.map((v, i) => v - lattice.origin[i]), normal: plane.normal };
    const task = new Task({ kind, points: given, plane: local, reach, interval });
    const item = this.add(task, { ...(name ? { name: String(name).slice(0, 200) } : {}), ...(color ? { color } : {}), note: String(note) });
    await task.running;
    return this.plain(item);
  }
}

/** The day, where the person is. */
function today() {
  const now = new Date();
  return [now.getFullYear(), now.getMonth() + 1, now.getDate()].map((n) => String(n).padStart(2, "0")).join("-");
}

/** Where the value stands. */
function anchorOf(task, dots, drawn) {
  if (drawn) {
    const all = task.lines.flat();
    return all.reduce((best, p) => (p[2] > best[2] ? p : best), all[0]);
  }
  if (dots.length === 0) return null;
  if (task.tool === "angle" && dots.length > 1) return dots[1];
  if (task.tool === "height") return dots.at(-1);
  if (dots.length === 1) return dots[0];
  if (task.tool === "distance" && dots.length > 2) return dots.at(-1);
  const mean = [0, 1, 2].map((i) => dots.reduce((s, p) => s + p[i], 0) / dots.length);
  return mean;
}

/** The sheet of what is only here: resolves when it applies, or cannot be had. */
export function styles() {
  if (document.querySelector("link[href$='measure.css']")) return Promise.resolve();
  const link = Object.assign(document.createElement("link"), { rel: "stylesheet", href: "measure.css" });
  return new Promise((resolve) => {
    link.onload = link.onerror = () => resolve();
    document.head.append(link);
  });
}
