// A section, a profile or contours, drawn in the row of the measurement: the pointer or the arrow keys show coordinates, which are marked on the model too, and
// the drawing can be enlarged. The lines are those that were measured; nothing here computes a value of its own.

import { html, nothing, render } from "lit-html";
import { niceBelow } from "../format.js";
import { t } from "../i18n.js";
import { icon, iconButton } from "../view.js";
import { COLOR } from "./items.js";
import { Linework } from "./linework.js";
import { coordinate, metresIn, readingName } from "./values.js";

/** @import { MeasureAnswer, MeasureItem } from "../types/page.js" */
/** @import { Spot } from "./linework.js" */
/** On a line, or off every line. @typedef {Spot | {flat: number[], world: null}} Cursor */

/** Around the lines, and how near a pointer must be to a line to be on it, CSS pixels. */
const [EDGE, NEAR] = [14, 16];
/** Minimum and maximum height in the panel, CSS pixels. */
const [LOW, HIGH] = [96, 260];
/** Minimum spacing of the grid; what an arrow key moves the cursor by, and with Shift. CSS pixels. */
const [GRID, STEP, STRIDE] = [56, 4, 40];
/** Points that are no farther apart than this are drawn as one, CSS pixels. */
const FINE = 0.4;
/** More lines than these are drawn thin. */
const MANY = 60;
/** Zoom of a key or a button, and of a pixel of the wheel; how far in, compared with all of the drawing on 100 pixels. */
const [ZOOM, WHEEL, MAX] = [1.5, 1.002, 1e4];

export class Plot extends HTMLElement {
  /** Of the mesh, metres; it limits the digits where the accuracy of the survey is unknown. */
  spacing = 0;
  /** @type {MeasureItem | null} */
  #item = null;
  /** Whose lines are drawn. @type {MeasureAnswer | null} */
  #answer = null;
  #unit = "m";
  #work = new Linework([]);
  /** What is seen: the place in the middle, metres to a CSS pixel, and whether a person chose that. */
  #center = [0, 0];
  #scale = 1;
  #isZoomed = false;
  /** CSS pixels. */
  #width = 0;
  #height = 0;
  /** @type {Cursor | null} */
  #cursor = null;
  /** Pointers that are pressed, and where they are. @type {Map<number, number[]>} */
  #held = new Map();
  /** Where the pointer is, until the next frame. @type {number[] | null} */
  #hovered = null;
  /** Where the pointer was last, in the window. */
  #rested = "";
  #isResized = false;
  #frame = 0;
  #canvas = document.createElement("canvas");
  #dialog = document.createElement("dialog");
  #row = document.createElement("div");
  #ends = new AbortController();

  /** @param {MeasureItem} item */
  set item(item) {
    this.#item = item;
    // The colour may come from a file that somebody sent.
    this.style.setProperty("--mark", CSS.supports("color", item.color) ? item.color : COLOR);
    if (this.#answer !== item.task.answer) {
      this.#answer = item.task.answer;
      this.#work = new Linework(this.#answer?.lines ?? []);
      this.#isZoomed = false;
      this.#point(null);
      if (this.isConnected) this.#resize();
    }
    this.#show();
  }

  /** @param {string} unit */
  set unit(unit) {
    if (this.#unit === unit) return;
    this.#unit = unit;
    this.#paint();
  }

  connectedCallback() {
    this.#ends = new AbortController();
    const { signal } = this.#ends;
    this.#dialog.className = "plot-dialog";
    this.replaceChildren(this.#row, this.#dialog);
    const sizes = new ResizeObserver(() => this.#soon(true));
    for (const element of [this, this.#canvas]) sizes.observe(element);
    signal.addEventListener("abort", () => sizes.disconnect());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#paint(), { signal });
    this.#listen(signal);
    this.#show();
    this.#resize();
  }

  disconnectedCallback() {
    this.#ends.abort();
    cancelAnimationFrame(this.#frame);
    this.#dialog.close();
    this.#held.clear();
    this.#point(null);
  }

  /** @param {AbortSignal} signal */
  #listen(signal) {
    const canvas = this.#canvas;
    const on = (/** @type {string[]} */ names, /** @type {(event: any) => void} */ act) => {
      for (const name of names) canvas.addEventListener(name, act, { signal, passive: false });
    };
    on(["pointerdown"], (event) => this.#press(event));
    on(["pointermove"], (event) => this.#move(event));
    on(["pointerup", "pointercancel", "lostpointercapture"], ({ pointerId }) => this.#held.delete(pointerId));
    // A cursor that the keys moved stays.
    on(["pointerleave"], ({ pointerType, buttons }) => pointerType !== "touch" && !buttons && this.#hovered && this.#hover(null));
    on(["keydown"], (event) => this.#key(event));
    on(["wheel"], (event) => this.#wheel(event));
    on(["dblclick"], () => this.#fit());
    // What the page does with keys, such as undo, is behind the dialog.
    this.#dialog.addEventListener("keydown", (event) => event.stopPropagation(), { signal });
    this.#dialog.addEventListener("close", () => this.#shrink(), { signal });
  }

  // What is seen.

  /** All of it. */
  #fit() {
    this.#isZoomed = false;
    const { low, high, size, paths } = this.#work;
    if (paths.length === 0) return;
    this.#center = low.map((v, i) => (v + high[i]) / 2);
    this.#scale = Math.max(size[0] / Math.max(this.#width - 2 * EDGE, 1), size[1] / Math.max(this.#height - 2 * EDGE, 1), 1e-6);
    this.#paint();
  }

  /** In the panel it is as high as its lines need, in the dialog as high as there is room for. */
  #resize() {
    const { clientWidth: width } = this.#canvas;
    if (width === 0 || this.#work.paths.length === 0) return;
    const [w, h] = this.#work.size;
    const wanted = Math.min(HIGH, Math.max(LOW, ((width - 2 * EDGE) * h) / Math.max(w, 1e-9) + 2 * EDGE));
    this.#canvas.style.height = this.#dialog.open ? "" : `${Math.round(wanted)}px`;
    [this.#width, this.#height] = [width, this.#canvas.clientHeight];
    if (this.#isZoomed) this.#paint();
    else this.#fit();
  }

  /**
   * @param {number} by above 1: nearer
   * @param {number[]} at the pixel that stays where it is
   */
  #zoom(by, at = [this.#width / 2, this.#height / 2]) {
    const before = this.#placeOf(at);
    const whole = Math.max(...this.#work.size, 1e-6) / 100;
    this.#scale = Math.min(whole * 2, Math.max(whole / MAX, this.#scale / by));
    const after = this.#placeOf(at);
    this.#center = this.#center.map((v, i) => v + before[i] - after[i]);
    this.#isZoomed = true;
    this.#paint();
  }

  /** @param {number[]} pixel */
  #placeOf([x, y]) {
    return [this.#center[0] + (x - this.#width / 2) * this.#scale, this.#center[1] - (y - this.#height / 2) * this.#scale];
  }

  /** @param {ArrayLike<number>} flat */
  #pixelOf({ 0: x, 1: y }) {
    return [this.#width / 2 + (x - this.#center[0]) / this.#scale, this.#height / 2 - (y - this.#center[1]) / this.#scale];
  }

  // Pointers and keys.

  /** @param {MouseEvent} event */
  #pixel({ clientX, clientY }) {
    const { left, top } = this.#canvas.getBoundingClientRect();
    return [clientX - left, clientY - top];
  }

  /** @param {PointerEvent} event */
  #press(event) {
    if (event.button !== 0) return;
    this.#canvas.setPointerCapture(event.pointerId);
    this.#held.set(event.pointerId, this.#pixel(event));
    this.#hover(this.#pixel(event));
  }

  /** One pointer that is pressed moves the drawing, two zoom it. @param {PointerEvent} event */
  #move(event) {
    // Safari also reports a pointer that rests, when something else moved beneath it: that would take the cursor from the keys.
    const place = `${event.clientX} ${event.clientY}`;
    const rests = this.#rested === place;
    this.#rested = place;
    if (rests && this.#cursor && !this.#hovered) return;
    if (event.buttons === 0) this.#held.delete(event.pointerId);
    const now = this.#pixel(event);
    const was = this.#held.get(event.pointerId);
    const other = [...this.#held].find(([id]) => id !== event.pointerId)?.[1];
    if (was) this.#held.set(event.pointerId, now);
    if (was && other) {
      const apart = (/** @type {number[]} */ p) => Math.max(1, Math.hypot(p[0] - other[0], p[1] - other[1]));
      const middle = now.map((v, i) => (v + other[i]) / 2);
      this.#zoom(apart(now) / apart(was), middle);
      return;
    }
    if (was) {
      this.#center = [this.#center[0] - (now[0] - was[0]) * this.#scale, this.#center[1] + (now[1] - was[1]) * this.#scale];
      this.#isZoomed = true;
      this.#paint();
    }
    this.#hover(now);
  }

  /** @param {number[] | null} pixel */
  #hover(pixel) {
    this.#hovered = pixel;
    if (pixel) this.#soon();
    else this.#point(null);
  }

  /** In the next frame, once, however many moves and sizes there are. @param {boolean} isResized */
  #soon(isResized = false) {
    this.#isResized ||= isResized;
    cancelAnimationFrame(this.#frame);
    this.#frame = requestAnimationFrame(() => {
      if (this.#isResized) this.#resize();
      this.#isResized = false;
      if (!this.#hovered) return;
      const flat = this.#placeOf(this.#hovered);
      this.#point(this.#work.nearest(flat, NEAR * this.#scale) ?? { flat, world: null });
    });
  }

  /** The wheel scrolls the panel, as everywhere in it; in the dialog, or with Ctrl, it zooms. @param {WheelEvent} event */
  #wheel(event) {
    if (!this.#dialog.open && !event.ctrlKey) return;
    event.preventDefault();
    this.#zoom(WHEEL ** -event.deltaY, this.#pixel(event));
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    const { key, shiftKey } = event;
    // Zooming the page and going back are the browser's.
    if (event.ctrlKey || event.metaKey || event.altKey || this.#work.paths.length === 0) return;
    // Before its first frame it has no size.
    if (this.#width === 0) this.#resize();
    const step = (shiftKey ? STRIDE : STEP) * this.#scale;
    const spot = this.#cursor?.world ? this.#cursor : null;
    const at = spot ? this.#pixelOf(spot.flat) : undefined;
    const walk = (/** @type {(from: Spot) => Spot} */ go) => {
      this.#hovered = null;
      this.#point(spot ? go(spot) : this.#work.spot(0, 0, 0));
      this.#follow();
    };
    if (key === "ArrowRight") walk((from) => this.#work.along(from, step));
    else if (key === "ArrowLeft") walk((from) => this.#work.along(from, -step));
    else if (key === "ArrowDown") walk((from) => this.#work.other(from, 1));
    else if (key === "ArrowUp") walk((from) => this.#work.other(from, -1));
    else if (key === "+" || key === "=") this.#zoom(ZOOM, at);
    else if (key === "-") this.#zoom(1 / ZOOM, at);
    else if (key === "0") this.#fit();
    else return;
    event.preventDefault();
    event.stopPropagation();
  }

  /** A cursor that the keys moved out of the picture comes to its middle. */
  #follow() {
    if (!this.#cursor) return;
    const [x, y] = this.#pixelOf(this.#cursor.flat);
    if (x >= 0 && y >= 0 && x <= this.#width && y <= this.#height) return;
    this.#center = [...this.#cursor.flat];
    this.#isZoomed = true;
    this.#paint();
  }

  /** @param {Cursor | null} cursor */
  #point(cursor) {
    const was = this.#cursor;
    this.#cursor = cursor;
    if (this.isConnected) this.#show();
    if (was?.world || cursor?.world) this.dispatchEvent(new CustomEvent("point", { detail: cursor?.world ?? null }));
  }

  // The picture.

  #paint() {
    if (this.#width === 0 || !this.isConnected) return;
    const ratio = devicePixelRatio;
    Object.assign(this.#canvas, { width: Math.round(this.#width * ratio), height: Math.round(this.#height * ratio) });
    const draw = /** @type {CanvasRenderingContext2D} */ (this.#canvas.getContext("2d"));
    draw.scale(ratio, ratio);
    const style = getComputedStyle(this.#canvas);
    const color = (/** @type {string} */ name) => style.getPropertyValue(name);
    this.#grid(draw, { line: color("--line"), text: color("--quiet"), paper: color("--sunken"), font: style.fontFamily });
    const { paths } = this.#work;
    draw.lineJoin = "round";
    // Many lines at once would run together.
    draw.lineWidth = paths.length > MANY ? 1 : 1.5;
    draw.strokeStyle = color("--ink");
    draw.fillStyle = color("--accent-soft");
    draw.beginPath();
    for (const { flat } of paths) this.#trace(draw, flat);
    // What a section cuts has an area; between contours there is none.
    draw.globalAlpha = 0.6;
    if (this.#item?.task.tool === "section" && paths.every(({ closed }) => closed)) draw.fill("evenodd");
    draw.globalAlpha = 1;
    draw.stroke();
    this.#show();
  }

  /** @param {CanvasRenderingContext2D} draw @param {Float64Array} flat */
  #trace(draw, flat) {
    const [x0, y0, k] = [this.#width / 2 - this.#center[0] / this.#scale, this.#height / 2 + this.#center[1] / this.#scale, 1 / this.#scale];
    let [u, v] = [NaN, NaN];
    for (let i = 0; i < flat.length; i += 2) {
      const [x, y] = [x0 + flat[i] * k, y0 - flat[i + 1] * k];
      if (i > 0 && i < flat.length - 2 && Math.abs(x - u) < FINE && Math.abs(y - v) < FINE) continue;
      if (i === 0) draw.moveTo(x, y);
      else draw.lineTo(x, y);
      [u, v] = [x, y];
    }
  }

  /**
   * Lines at round coordinates in the unit, and their values at the edges.
   * @param {CanvasRenderingContext2D} draw
   * @param {{line: string, text: string, paper: string, font: string}} style
   */
  #grid(draw, { line, text, paper, font }) {
    const [width, height] = [this.#width, this.#height];
    const metres = metresIn(this.#unit);
    const step = niceAbove((GRID * this.#scale) / metres) * metres;
    const [low, high] = [this.#placeOf([0, height]), this.#placeOf([width, 0])];
    draw.lineWidth = 1;
    draw.strokeStyle = line;
    draw.font = `11px ${font}`;
    const words = [];
    draw.beginPath();
    for (const axis of [0, 1]) {
      const from = this.#zero(axis);
      for (let k = Math.ceil((low[axis] - from) / step); from + k * step <= high[axis]; k += 1) {
        const [x, y] = this.#pixelOf(axis === 0 ? [from + k * step, low[1]] : [low[0], from + k * step]);
        draw.moveTo(axis === 0 ? x : 0, axis === 0 ? 0 : y);
        draw.lineTo(axis === 0 ? x : width, axis === 0 ? height : y);
        const value = coordinate(k * step, this.#unit, step);
        if (axis === 0) words.push({ value, x: x + 3, y: height - 4 });
        else if (y < height - 20) words.push({ value, x: 3, y: y - 3 });
      }
    }
    draw.stroke();
    draw.fillStyle = text;
    draw.strokeStyle = paper;
    draw.lineWidth = 3;
    for (const { value, x, y } of words) {
      draw.strokeText(value, x, y);
      draw.fillText(value, x, y);
    }
  }

  /** Where an axis counts from: a plan and a height from the world's origin, a profile from its first point, others from the edge of the drawing. @param {number} axis */
  #zero(axis) {
    const { axes, low } = this.#work;
    const isGiven = axes === "plan" || (axes === "upright" && axis === 1) || this.#item?.task.tool === "profile";
    return isGiven ? 0 : low[axis];
  }

  // The controls around it.

  #show() {
    const item = this.#item;
    if (!item || this.#work.paths.length === 0) {
      render(nothing, this.#row);
      return;
    }
    this.#describe(item.name);
    const isLarge = this.#dialog.open;
    const [x, y] = this.#cursor ? this.#pixelOf(this.#cursor.flat) : [0, 0];
    const cursor = this.#cursor
      ? html`<span class=${this.#cursor.world ? "plot-cursor on" : "plot-cursor"} .style=${`transform: translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`}></span>`
      : nothing;
    const button = (/** @type {string} */ name, /** @type {string} */ key, /** @type {() => void} */ click) =>
      iconButton(name, { key, click, about: item.name, act: `plot-${name}` });
    const tools = html`<div class="plot-tools">${button("plus", "zoomIn", () => this.#zoom(ZOOM))}${button("minus", "zoomOut", () => this.#zoom(1 / ZOOM))}${button("fit", "plotWhole", () => this.#fit())}${isLarge ? nothing : button("fullscreen", "plotLarge", () => this.#enlarge())}</div>`;
    const frame = html`<div class="plot-frame">${this.#canvas}${cursor}</div>${tools}<p class="plot-read">${this.#words()}</p>`;
    const close = html`<form method="dialog"><button class="button icon" aria-label=${t("close")}>${icon("close")}</button></form><h2 dir="auto">${item.name}</h2>`;
    this.#dialog.setAttribute("aria-label", item.name);
    render(isLarge ? html`${close}${frame}` : nothing, this.#dialog);
    render(isLarge ? nothing : frame, this.#row);
  }

  #enlarge() {
    this.#held.clear();
    this.#isZoomed = false;
    this.#dialog.showModal();
    this.#show();
    this.#resize();
    this.#canvas.focus();
  }

  #shrink() {
    this.#held.clear();
    this.#isZoomed = false;
    this.#show();
    this.#resize();
    /** @type {HTMLElement | null} */ (this.querySelector("[data-act=plot-fullscreen]"))?.focus();
  }

  /** For screen readers it is a slider along a line. @param {string} name */
  #describe(name) {
    const spot = this.#cursor?.world ? this.#cursor : null;
    const { paths } = this.#work;
    const share = spot ? (spot.at + spot.part) / (paths[spot.line].flat.length / 2 - 1) : 0;
    const line = spot && paths.length > 1 ? [t("plotLine", { number: String(spot.line + 1), count: String(paths.length) })] : [];
    const text = spot ? [...line, ...this.#coordinates().map((pair) => pair.join(" ")), this.#unit].join(", ") : t("plotHint");
    this.#canvas.tabIndex = 0;
    this.#canvas.setAttribute("role", "slider");
    const aria = { label: t("plotName", { name }), description: t("plotKeys"), valuemin: 0, valuemax: 100, valuenow: Math.round(100 * share), valuetext: text };
    for (const [key, value] of Object.entries(aria)) this.#canvas.setAttribute(`aria-${key}`, String(value));
  }

  #words() {
    if (!this.#cursor) return html`<span class="quiet">${t("plotHint")}</span>`;
    return [
      ...this.#coordinates().map(([name, value]) => html`<span><span class="quiet">${name}</span> ${value}</span>`),
      html`<span class="quiet">${this.#unit}</span>`,
    ];
  }

  /** The cursor's coordinates, no finer than a pixel is, and than the surface is known. @returns {string[][]} names and values */
  #coordinates() {
    const { flat, world } = /** @type {Cursor} */ (this.#cursor);
    const { uncertainty: u } = this.#item?.task ?? {};
    const known = u ? Math.hypot(u.lattice, u.level, u.capture ?? this.spacing) : this.spacing;
    const one = (/** @type {string} */ name, /** @type {number} */ value) => [name, coordinate(value, this.#unit, Math.max(this.#scale, known))];
    const { axes } = this.#work;
    const [across, up] = axes === "upright" ? [t("plotAlong"), readingName("height")] : ["→", "↑"];
    // On a line of an upright drawing, the height is z.
    const isZ = world && axes === "upright";
    const own = axes === "plan" ? [] : [one(across, flat[0] - this.#zero(0)), ...(isZ ? [] : [one(up, flat[1] - this.#zero(1))])];
    const places = world ?? (axes === "plan" ? flat : []);
    return [...own, ...["x", "y", "z"].slice(0, places.length).map((name, i) => one(name, places[i]))];
  }
}

/** The next of 1, 2, 5, 10, 20, … @param {number} value */
function niceAbove(value) {
  const below = niceBelow(value);
  return below >= value ? below : niceBelow(below * 2.5 * (1 + 1e-9));
}

customElements.define("kilwa-plot", Plot);
