// Measurements over the picture: lines and points on a canvas of their own, values as labels, and handles at the points of the one that is chosen.
// They follow the camera with every frame. What the model hides is dimmed; that is found out piece by piece in what time is left, so that
// no picture waits for it.

import { html, render } from "lit-html";
import { cameraKey } from "../camera.js";
import { $ } from "../dom.js";
import { Handles } from "./handles.js";
import { arrange } from "./labels.js";
import { isSame, pieces } from "./shapes.js";

/** @import { MarkActions } from "./handles.js" */
/** @import { Piece, Shape } from "./shapes.js" */
/** @import { FrameStats } from "../types/page.js" */
/** @import { Scene } from "../scene.js" */

/**
 * A shape and where it is on the picture.
 * @typedef {object} Drawn
 * @property {Shape} source
 * @property {Piece[]} pieces
 * @property {ArrayLike<number> & Iterable<number>} places x, y, z of the points of its pieces
 * @property {boolean[]} dotsHidden
 * @property {boolean} isHidden
 * @property {Float64Array} at pixels of the places, three numbers each
 * @property {Float64Array} dotsAt
 * @property {Float64Array | null} anchorAt
 */

/** Milliseconds of a frame for finding out what is hidden. */
const PATIENCE = 4;
/** Parts of the page that lie over the picture. */
const OVER = ".rail, #cube, #hint, #measure-bar, #note-card, #show-again";
/** Half of a handle, CSS pixels. */
const HANDLE = 10;
/** Milliseconds that their places are known for. */
const FRESH = 400;
/** Where the picture is narrower, CSS pixels, and there are more labels than these, they stay near their places. */
const [NARROW, FEW] = [720, 8];
/** Part of its distance that a place may lie behind the surface shown and still be on it. */
const SLACK = 0.004;

/** Before it was projected. */
const NOWHERE = new Float64Array();

export class Marks {
  /** @param {MarkActions} on */
  constructor(on) {
    this.on = on;
    /** @type {Drawn[]} */
    this.shapes = [];
    /** By the shape's id. @type {Map<string, HTMLButtonElement>} */
    this.labels = new Map();
    /** Of labels, CSS pixels. @type {Map<string, number[]>} */
    this.sizes = new Map();
    /** The places of labels. @type {ReturnType<typeof arrange>} */
    this.spots = new Map();
    this.handles = new Handles(on);
    this.seen = "";
    /** Places to be checked for whether they are hidden. @type {(() => void)[]} */
    this.queue = [];
    this.version = 0;
    this.error = 0; // of the surface on screen, metres
    this.picture = 0; // triangles of the last frame
    /** @type {Scene | null} */
    this.scene = null;
    /** The place that the cursor in a drawing is at. @type {{color: string, world: number[]} | null} */
    this.spot = null;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    /** Boxes of what lies over the picture, and when they were measured. @type {number[][] | null} */
    this.covered = null;
    this.coveredAt = 0;
  }

  /** @param {Scene} scene */
  attach(scene) {
    this.scene = scene;
    this.handles.scene = scene;
    this.seen = "";
  }

  get #open() {
    if (!this.scene) throw new Error("the model is not open");
    return this.scene;
  }

  get viewer() {
    return this.#open.viewer;
  }

  get session() {
    return this.#open.session;
  }

  close() {
    clearTimeout(this.timer);
    this.set([]);
    $("mark-labels").replaceChildren();
    this.labels.clear();
    this.sizes.clear();
    this.spots.clear();
  }

  /** @param {Shape[]} shapes */
  set(shapes) {
    const had = new Map(this.shapes.map((s) => [s.source.id, s]));
    this.shapes = shapes.map((source) => {
      const old = had.get(source.id);
      const same = old && isSame(old.source, source);
      const made = same ? { pieces: old.pieces, places: old.places } : pieces(source);
      const dotsHidden = source.dots.map((_, k) => (same ? (old.dotsHidden[k] ?? false) : false));
      return { ...made, source, dotsHidden, isHidden: old?.isHidden ?? false, at: NOWHERE, dotsAt: NOWHERE, anchorAt: null };
    });
    this.#labels();
    this.handles.show(this.shapes.find(({ source }) => source.chosen && source.canMove) ?? null);
    this.version += 1;
    this.draw();
  }

  /**
   * After each frame of the viewer.
   * @param {FrameStats} stats
   */
  frame(stats) {
    this.error = Number.isFinite(stats.worstErrorMetres) ? stats.worstErrorMetres : 0;
    this.draw(stats.trianglesDrawn);
  }

  /**
   * Mark a place, or none: that of the cursor in a drawing. It moves too often for the shapes to be arranged each time.
   * @param {{color: string, world: number[]} | null} spot
   */
  point(spot) {
    if (!this.spot && !spot) return;
    this.spot = spot;
    if (this.scene?.isOpen) this.#paint();
  }

  draw(picture = this.picture) {
    if (!this.scene?.isOpen) return;
    this.picture = picture;
    const { width, height } = this.session.canvas;
    const seen = `${cameraKey(this.viewer.camera())} ${width} ${height} ${picture} ${this.version} ${this.on.pins().join()}`;
    if (seen === this.seen) return;
    this.seen = seen;
    delete $("marks").dataset.settled;
    for (const shape of this.shapes) this.#project(shape);
    this.#arrange();
    this.#paint();
    this.#place();
    this.queue = this.shapes.flatMap((shape) => [
      ...shape.pieces.map((piece) => () => {
        piece.hidden = this.#isHidden(shape.places, piece.middle);
      }),
      ...shape.source.dots.map((dot, k) => () => {
        shape.dotsHidden[k] = this.#isHidden(dot, 0);
      }),
      () => {
        shape.isHidden = Boolean(shape.source.anchor) && this.#isHidden(shape.source.anchor ?? [], 0);
      },
    ]);
    this.#look();
  }

  /**
   * @param {ArrayLike<number>} places
   * @param {number} at
   */
  #isHidden(places, at) {
    const [x, y, z] = [places[at * 3], places[at * 3 + 1], places[at * 3 + 2]];
    const [, , depth] = this.viewer.project(new Float64Array([x, y, z]));
    return this.viewer.isHidden(x, y, z, 2 * this.error + SLACK * Math.abs(depth));
  }

  /** Find hidden places, a few at a time; the canvas says when all are found. */
  #look() {
    clearTimeout(this.timer);
    if (this.session.closed) return;
    const isIdle = this.queue.length === 0;
    const until = performance.now() + PATIENCE;
    while (this.queue.length > 0 && performance.now() < until) this.queue.shift()?.();
    if (this.queue.length > 0) {
      this.timer = setTimeout(() => this.#look(), 16);
      return;
    }
    $("marks").dataset.settled = "true";
    if (isIdle) return;
    this.#arrange();
    this.#paint();
    this.#place();
  }

  /** @param {Drawn} shape */
  #project(shape) {
    const { source } = shape;
    const dots = source.dots.flat();
    const anchor = source.anchor ?? [];
    const pixels = this.viewer.project(new Float64Array([...shape.places, ...dots, ...anchor]));
    const [a, b] = [shape.places.length, shape.places.length + dots.length];
    Object.assign(shape, { at: pixels.subarray(0, a), dotsAt: pixels.subarray(a, b), anchorAt: anchor.length > 0 ? pixels.subarray(b, b + 3) : null });
  }

  #paint() {
    const canvas = $("marks");
    const { width, height } = this.session.canvas;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    const { ratio } = this.session;
    context.clearRect(0, 0, width, height);
    context.lineJoin = context.lineCap = "round";
    for (const shape of this.shapes) {
      const { source, pieces: all, at } = shape;
      // Many lines at once are thin, or nothing of the model would be seen.
      const isFine = source.paths.length > 60;
      const wide = (isFine ? 1.25 : source.chosen ? 3 : 2) * ratio;
      if (source.closed && source.dots.length > 2) this.#fill(context, shape);
      for (const hidden of [true, false]) {
        context.globalAlpha = hidden ? 0.35 : 1;
        for (const isCasing of isFine ? [false] : [true, false]) {
          context.strokeStyle = isCasing ? "rgb(255 255 255 / 85%)" : source.color;
          context.lineWidth = isCasing ? wide + 2.5 * ratio : wide;
          context.setLineDash(source.dashed && !isCasing ? [7 * ratio, 6 * ratio] : []);
          context.beginPath();
          let joined = -1;
          for (const piece of all) {
            if (piece.hidden !== hidden) continue;
            for (let k = piece.from; k < piece.to; k += 1) {
              const [x, y, u, v] = [at[k * 3], at[k * 3 + 1], at[k * 3 + 3], at[k * 3 + 4]];
              if (![x, y, u, v].every(Number.isFinite)) continue;
              if (joined !== k) context.moveTo(x, y);
              context.lineTo(u, v);
              joined = k + 1;
            }
          }
          context.stroke();
        }
      }
      context.setLineDash([]);
      this.#dots(context, shape);
    }
    this.#leaders(context);
    context.globalAlpha = 1;
    if (this.spot) this.#disc(context, this.viewer.project(new Float64Array(this.spot.world)), { radius: 5, fill: this.spot.color, edge: "#fff" });
  }

  /**
   * Draw lines from places to labels that are not beside them.
   * @param {CanvasRenderingContext2D} context
   */
  #leaders(context) {
    const { ratio } = this.session;
    for (const { source, anchorAt } of this.shapes) {
      const spot = this.spots.get(source.id);
      if (!spot?.line || !anchorAt) continue;
      context.globalAlpha = 1;
      for (const [color, wide] of /** @type {[string, number][]} */ ([
        ["rgb(255 255 255 / 85%)", 3.5],
        [source.color, 1.25],
      ])) {
        context.strokeStyle = color;
        context.lineWidth = wide * ratio;
        context.beginPath();
        context.moveTo(anchorAt[0], anchorAt[1]);
        context.lineTo(spot.line[0] * ratio, spot.line[1] * ratio);
        context.stroke();
      }
    }
  }

  /**
   * @param {CanvasRenderingContext2D} context
   * @param {Drawn} shape
   */
  #fill(context, { source, dotsAt }) {
    const corners = source.dots.map((_, k) => [dotsAt[k * 3], dotsAt[k * 3 + 1]]);
    if (!corners.flat().every(Number.isFinite)) return;
    context.beginPath();
    for (const [x, y] of corners) context.lineTo(x, y);
    context.closePath();
    context.globalAlpha = 0.18;
    context.fillStyle = source.color;
    context.fill();
  }

  /**
   * @param {CanvasRenderingContext2D} context
   * @param {Drawn} shape
   */
  #dots(context, { source, dotsAt, dotsHidden }) {
    for (const [k] of source.dots.entries()) {
      const [x, y] = [dotsAt[k * 3], dotsAt[k * 3 + 1]];
      if (!Number.isFinite(x)) continue;
      context.globalAlpha = dotsHidden[k] ? 0.35 : 1;
      const [fill, edge] = source.dashed ? ["#fff", source.color] : [source.color, "#fff"];
      this.#disc(context, [x, y], { radius: source.chosen ? 5 : 4, fill, edge });
    }
  }

  /**
   * @param {CanvasRenderingContext2D} context
   * @param {ArrayLike<number>} at
   * @param {{radius: number, fill: string, edge: string}} how
   */
  #disc(context, { 0: x, 1: y }, { radius, fill, edge }) {
    const { ratio } = this.session;
    if (!Number.isFinite(x)) return;
    context.beginPath();
    context.arc(x, y, radius * ratio, 0, 7);
    context.fillStyle = fill;
    context.strokeStyle = edge;
    context.lineWidth = 2 * ratio;
    context.fill();
    context.stroke();
  }

  // Labels and handles.

  #labels() {
    const wanted = new Set();
    for (const { source } of this.shapes) {
      if (!source.anchor || source.label.length === 0) continue;
      wanted.add(source.id);
      let label = this.labels.get(source.id);
      if (!label) {
        // The same is in the table, which the keyboard reaches.
        label = Object.assign(document.createElement("button"), { type: "button", className: "mark-label", tabIndex: -1 });
        const { id } = source;
        label.addEventListener("click", () => this.on.open(id));
        this.labels.set(source.id, label);
        $("mark-labels").append(label);
      }
      if (label.dataset.lines !== source.label.join("\n")) {
        render(
          source.label.map((line) => html`<span dir="auto">${line}</span>`),
          label,
        );
        label.dataset.lines = source.label.join("\n");
        label.setAttribute("aria-label", `${source.name}: ${source.label.join(", ")}`);
        this.sizes.delete(source.id);
      }
      label.style.setProperty("--mark", source.color);
      label.classList.toggle("dashed", source.dashed);
      label.classList.toggle("chosen", source.chosen);
    }
    for (const [id, label] of this.labels) {
      if (wanted.has(id)) continue;
      label.remove();
      this.labels.delete(id);
      this.sizes.delete(id);
    }
  }

  /**
   * How large a label is, measured once for its words.
   * @param {string} id
   * @param {HTMLElement} label
   */
  #size(id, label) {
    const known = this.sizes.get(id);
    if (known) return known;
    label.hidden = false;
    label.classList.remove("small");
    const size = [label.offsetWidth, label.offsetHeight];
    if (size[0] > 0) this.sizes.set(id, size);
    return size;
  }

  /** Boxes of what lies over the picture. */
  #over() {
    const now = performance.now();
    if (this.covered && now - this.coveredAt < FRESH) return this.covered;
    const from = this.session.canvas.getBoundingClientRect();
    const boxes = [...document.querySelectorAll(OVER)].map((e) => e.getBoundingClientRect()).filter((r) => r.width > 0);
    this.coveredAt = now;
    this.covered = boxes.map((r) => [r.left - from.left, r.top - from.top, r.right - from.left, r.bottom - from.top]);
    return this.covered;
  }

  /** The place of each label. */
  #arrange() {
    const { ratio, canvas } = this.session;
    const [width, height] = [canvas.width / ratio, canvas.height / ratio];
    const isOn = (/** @type {number} */ x, /** @type {number} */ y) => Number.isFinite(x) && x > -20 && y > -20 && x < width + 20 && y < height + 20;
    const wanted = [];
    for (const { source, anchorAt, dotsAt, isHidden } of this.shapes) {
      const label = this.labels.get(source.id);
      const at = anchorAt ? [anchorAt[0] / ratio, anchorAt[1] / ratio] : [NaN, NaN];
      if (!label || !isOn(at[0], at[1])) continue;
      const rank = source.chosen ? 0 : source.id === "draft" ? 1 : isHidden ? 3 : 2;
      const dots = source.dots
        .map((_, k) => [dotsAt[k * 3] / ratio, dotsAt[k * 3 + 1] / ratio])
        .filter(([x, y]) => isOn(x, y))
        .slice(0, 8);
      wanted.push({ id: source.id, at, dots, size: this.#size(source.id, label), before: this.spots.get(source.id)?.choice, rank });
    }
    wanted.sort((a, b) => a.rank - b.rank);
    // Pins and handles lie above the labels: they would cover digits.
    const handles = this.handles.all.map(({ shape: { dotsAt }, index }) => [dotsAt[index * 3] / ratio, dotsAt[index * 3 + 1] / ratio]);
    const held = handles.filter(([x, y]) => isOn(x, y)).map(([x, y]) => [x - HANDLE, y - HANDLE, x + HANDLE, y + HANDLE]);
    const taken = [...this.#over(), ...this.on.pins(), ...held];
    this.spots = arrange(wanted, { room: [4, 4, width - 4, height - 4], taken, rings: width < NARROW && wanted.length > FEW ? 1 : 4 });
  }

  #place() {
    const { ratio, canvas } = this.session;
    const put = (/** @type {HTMLElement} */ element, /** @type {number} */ x, /** @type {number} */ y, /** @type {boolean} */ isOn) => {
      element.hidden = !isOn;
      if (isOn) element.style.transform = `translate(${(x / ratio).toFixed(1)}px, ${(y / ratio).toFixed(1)}px)`;
    };
    const isOn = (/** @type {number} */ x, /** @type {number} */ y) =>
      Number.isFinite(x) && x > -20 && y > -20 && x < canvas.width + 20 && y < canvas.height + 20;
    for (const shape of this.shapes) {
      const label = this.labels.get(shape.source.id);
      if (!label) continue;
      const spot = this.spots.get(shape.source.id);
      put(label, (spot?.left ?? 0) * ratio, (spot?.top ?? 0) * ratio, Boolean(spot));
      label.classList.toggle("small", Boolean(spot?.isSmall));
      label.classList.toggle("behind", shape.isHidden && !shape.source.chosen);
    }
    for (const { button, shape, index } of this.handles.all) {
      const [x, y] = [shape.dotsAt[index * 3], shape.dotsAt[index * 3 + 1]];
      put(button, x, y, isOn(x, y));
    }
  }
}
