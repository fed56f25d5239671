// The Section panel: a plane and a box that cut the model, typed or dragged by handles over the picture. The state is the display's
// (display.js); handles follow the camera with every frame, and each is a slider for the keyboard.

import { cameraKey } from "./camera.js";
import { number, on, put } from "./display.js";
import { $ } from "./dom.js";
import * as format from "./format.js";
import { t } from "./i18n.js";
import { AXES, axisName, cross, moved, planeOfPoints, position, reach, short, towardsEye } from "./planes.js";

/** @import { Box, DisplayState, Plane } from "./types/page.js" */
/** @import { Scene } from "./scene.js" */
/** @typedef {{name: string, at: number[], normal: number[], value: number, move: (by: number) => DisplayState}} Handle */

const FACES = ["faceWest", "faceEast", "faceSouth", "faceNorth", "faceBelow", "facePlan"];
const PARTS = /** @type {const} */ (["center", "size"]);
const COORDINATES = /** @type {const} */ (["x", "y", "z"]);
/** @type {Record<string, string>} */
const AXIS_LETTERS = { up: "z", north: "y", east: "x" };
const SVG = "http://www.w3.org/2000/svg";
/** @param {number[]} a @param {number[]} b @param {number} by */
const add = (a, b, by = 1) => a.map((v, i) => v + b[i] * by);

export class Section {
  /** @param {{display: import("./display.js").Display, pickPoints: (use: (points: number[][]) => void) => void}} parts */
  constructor({ display, pickPoints }) {
    this.display = display;
    this.pickPoints = pickPoints;
    /** @type {Scene | null} */
    this.scene = null;
    /** @type {(Handle & {button: HTMLButtonElement})[]} */
    this.handles = [];
    this.seen = "";
    this.#listen();
  }

  /** @param {Scene} scene */
  attach(scene) {
    this.scene = scene;
    this.seen = "";
  }

  get viewer() {
    return this.display.viewer;
  }

  /** Pixels of the picture for one of CSS. */
  get ratio() {
    return this.scene?.session.ratio ?? 1;
  }

  get state() {
    return this.display.state;
  }

  /**
   * The axes of a box that is turned clockwise.
   * @param {Box} box
   */
  #axes({ turn = 0 }) {
    const [s, c] = [Math.sin((turn * Math.PI) / 180), Math.cos((turn * Math.PI) / 180)];
    return [
      [c, -s, 0],
      [s, c, 0],
      [0, 0, 1],
    ];
  }

  // The panel.

  #listen() {
    on("clip-plane", "change", (field) => this.display.change({ clipPlane: field.checked ? this.#usualPlane("up") : undefined }));
    on("clip-axis", "change", (field) => {
      const axis = field.value;
      if (axis !== "points") this.display.change({ clipPlane: this.#usualPlane(axis) });
      else this.pickPoints((points) => this.display.change({ clipPlane: planeOfPoints(points, this.viewer) ?? undefined }));
    });
    const place = (/** @type {number} */ value) => this.state.clipPlane && this.display.change({ clipPlane: moved(this.state.clipPlane, value, this.viewer) });
    number("clip-position", place);
    on("clip-slide", "input", (field) => place(Number(field.value)));
    on("clip-flip", "click", () => {
      const { clipPlane } = this.state;
      if (!clipPlane) return;
      const { normal, point } = clipPlane;
      this.display.change({ clipPlane: { normal: normal.map((v) => -v + 0), point } });
    });
    on("clip-reset", "click", () => this.display.change({ clipPlane: this.#usualPlane(axisName(this.state.clipPlane?.normal ?? [])) }));
    on("clip-box", "change", (field) => this.display.change({ clipBox: field.checked ? this.#usualBox() : undefined }));
    for (const part of PARTS) {
      for (const [i, axis] of COORDINATES.entries()) {
        number(`box-${part}-${axis}`, (value) => {
          const box = this.state.clipBox;
          if (!box || (part === "size" && value <= 0)) return;
          this.display.change({ clipBox: { ...box, [part]: box[part].map((v, k) => (k === i ? value : v)) } });
        });
      }
    }
    number("box-turn", (turn) => this.#changeBox({ turn }));
    on("box-remove", "change", (field) => this.#changeBox({ removeInside: field.checked }));
    on("box-reset", "click", () => this.display.change({ clipBox: this.#usualBox() }));
    on("clip-outline", "change", (field) => this.display.change({ outline: field.checked }));
    for (const tab of document.querySelectorAll("[role=tab]")) tab.addEventListener("click", () => setTimeout(() => this.frame())); // when the tab is shown
  }

  /** @param {Partial<Box>} patch */
  #changeBox(patch) {
    const { clipBox } = this.state;
    if (clipBox) this.display.change({ clipBox: { ...clipBox, ...patch } });
  }

  /** Through the middle of the model; from above at two thirds of the height, where walls are cut and floors are seen. @param {string} axis */
  #usualPlane(axis) {
    const normal = AXES[axis] ?? (axis === "other" && this.state.clipPlane ? this.state.clipPlane.normal : towardsEye(this.viewer));
    const { center, low, high } = reach(this.viewer, normal);
    const share = axis === "up" ? 0.67 : 0.5;
    const middle = (low + high) / 2;
    return { normal, point: add(center, normal, low + (high - low) * share - middle).map(short) };
  }

  /** The middle half of the model. */
  #usualBox() {
    const [a, b, c, u, v, w] = this.viewer.bounds();
    const size = [(u - a) / 2, (v - b) / 2, (w - c) * 1.02].map((x) => Math.max(short(x), 0.001));
    return { center: [(a + u) / 2, (b + v) / 2, (c + w) / 2].map(short), size };
  }

  /** Show what is in force. */
  refresh() {
    if (!this.scene?.isOpen) return;
    const { clipPlane, clipBox, outline } = this.state;
    $("clip-plane").checked = Boolean(clipPlane);
    $("clip-plane-parts").hidden = !clipPlane;
    if (clipPlane) {
      const { normal } = clipPlane;
      const name = axisName(normal);
      const { low, high } = reach(this.viewer, name === "other" ? normal : AXES[name]);
      const from = name === "other" ? -(high - low) / 2 : low;
      $("clip-axis").value = name;
      Object.assign($("clip-slide"), { min: from, max: from + high - low, step: "any" });
      const at = position(clipPlane, this.viewer);
      $("clip-slide").value = String(at);
      put("clip-position", short(at));
      $("clip-position-name").textContent = name === "other" ? t("clipFromMiddle") : t("clipPosition", { axis: AXIS_LETTERS[name] });
    }
    $("clip-box").checked = Boolean(clipBox);
    $("clip-box-parts").hidden = !clipBox;
    if (clipBox) {
      for (const part of PARTS) {
        for (const [i, axis] of COORDINATES.entries()) put(`box-${part}-${axis}`, short(clipBox[part][i]));
      }
      put("box-turn", short(clipBox.turn ?? 0));
      $("box-remove").checked = clipBox.removeInside ?? false;
    }
    $("clip-outline").checked = outline ?? true;
    this.seen = "";
    this.frame();
  }

  // The handles.

  /** Places of the handles and what moving one by some metres does. */
  #wanted() {
    const { clipPlane, clipBox } = this.state;
    /** @type {Handle[]} */
    const out = [];
    if (clipPlane) {
      const { normal, point } = clipPlane;
      const { center } = reach(this.viewer, normal);
      const at = add(
        center,
        normal,
        normal.reduce((s, n, i) => s + n * (point[i] - center[i]), 0),
      );
      const move = (/** @type {number} */ by) => ({ clipPlane: { normal, point: add(point, normal, by).map(short) } });
      out.push({ name: t("clipMove"), at, normal, move, value: position(clipPlane, this.viewer) });
    }
    if (clipBox) {
      const axes = this.#axes(clipBox);
      for (const [k, key] of FACES.entries()) {
        const i = k >> 1;
        const sign = k % 2 === 0 ? -1 : 1;
        const normal = axes[i].map((v) => v * sign);
        const move = (/** @type {number} */ by) => {
          const grown = Math.max(clipBox.size[i] + by, 0.001);
          const size = clipBox.size.map((v, n) => (n === i ? short(grown) : v));
          return { clipBox: { ...clipBox, size, center: add(clipBox.center, normal, (grown - clipBox.size[i]) / 2).map(short) } };
        };
        out.push({ name: t("clipFace", { face: t(key) }), at: add(clipBox.center, normal, clipBox.size[i] / 2), normal, move, value: clipBox.size[i] });
      }
    }
    return out;
  }

  /** After each frame, and when a tab is chosen. */
  frame() {
    if (!this.scene?.isOpen) return;
    const isOpen = !$("section").hidden && document.body.dataset.chrome !== "hidden";
    const { width, height } = this.scene.session.canvas;
    const seen = isOpen ? `${cameraKey(this.viewer.camera())} ${width} ${height} ${this.viewer.displayState()} ${document.documentElement.lang}` : "closed";
    if (seen === this.seen) return;
    this.seen = seen;
    const wanted = isOpen ? this.#wanted() : [];
    while (this.handles.length > wanted.length) this.handles.pop()?.button.remove();
    for (const [k, want] of wanted.entries()) {
      this.handles[k] ??= this.#make(k, want);
      const handle = this.handles[k];
      Object.assign(handle, want);
      const { button } = handle;
      button.setAttribute("aria-label", want.name);
      button.setAttribute("aria-valuenow", String(short(want.value)));
      button.setAttribute("aria-valuetext", format.length(want.value));
      const way = this.#way(want);
      button.hidden = !way;
      if (!way) continue;
      const { ratio } = this;
      const angle = Math.atan2(way.dy, way.dx);
      button.style.transform = `translate(${(way.x / ratio).toFixed(1)}px, ${(way.y / ratio).toFixed(1)}px) rotate(${angle.toFixed(3)}rad)`;
    }
    this.#outlines(isOpen);
  }

  /** Where a handle is in the picture, and how many pixels a metre along its normal is; null where it is not seen. @param {{at: number[], normal: number[]}} handle */
  #way({ at, normal }) {
    const reach = this.viewer.metresPerPixel() * 20;
    const [x, y, , u, v] = this.viewer.project(new Float64Array([...at, ...add(at, normal, reach)]));
    if (![x, y, u, v].every(Number.isFinite)) return null;
    return { x, y, dx: (u - x) / reach, dy: (v - y) / reach };
  }

  /**
   * @param {number} k
   * @param {Handle} want
   */
  #make(k, want) {
    const button = Object.assign(document.createElement("button"), { className: "handle", type: "button" });
    button.setAttribute("role", "slider");
    const arrow = document.createElementNS(SVG, "svg");
    arrow.setAttribute("viewBox", "-22 -22 44 44");
    arrow.setAttribute("aria-hidden", "true");
    const path = document.createElementNS(SVG, "path");
    path.setAttribute("d", "M-18 0-9-6v12zM18 0 9-6v12zM-9 0H9");
    arrow.append(path);
    button.append(arrow);
    const handle = { ...want, button };
    /** @type {{x: number, y: number, dx: number, dy: number, move: Handle["move"]} | null} */
    let from = null;
    button.addEventListener("pointerdown", (event) => {
      const way = this.#way(handle);
      if (!way || event.button !== 0) return;
      button.setPointerCapture(event.pointerId);
      // Seen nearly along the normal a pixel would be many metres: it counts as a quarter of one seen from the side.
      const square = Math.max(way.dx ** 2 + way.dy ** 2, (0.25 / this.viewer.metresPerPixel()) ** 2);
      from = { x: event.clientX, y: event.clientY, dx: way.dx / square, dy: way.dy / square, move: handle.move };
      event.stopPropagation();
    });
    button.addEventListener("pointermove", (event) => {
      if (!from) return;
      const { ratio } = this;
      this.display.change(from.move(((event.clientX - from.x) * from.dx + (event.clientY - from.y) * from.dy) * ratio));
    });
    for (const type of ["pointerup", "pointercancel"]) button.addEventListener(type, () => (from = null));
    button.addEventListener("keydown", (event) => {
      const step = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1, PageUp: 10, PageDown: -10 }[event.key];
      if (!step) return;
      event.preventDefault();
      event.stopPropagation();
      this.display.change(handle.move(step * this.viewer.metresPerPixel() * 4 * (event.shiftKey ? 10 : 1)));
    });
    $("handles").append(button);
    button.dataset.handle = String(k);
    return handle;
  }

  /**
   * The plane's rectangle and the box's edges, as lines over the picture.
   * @param {boolean} isOpen
   */
  #outlines(isOpen) {
    const { clipPlane, clipBox } = this.state;
    /** @type {number[][]} */
    const edges = [];
    if (isOpen && clipBox) {
      const axes = this.#axes(clipBox);
      const corner = (/** @type {number} */ k) => axes.reduce((p, axis, i) => add(p, axis, ((k >> i) & 1 ? 0.5 : -0.5) * clipBox.size[i]), clipBox.center);
      for (let k = 0; k < 8; k += 1) for (const bit of [1, 2, 4]) if (!(k & bit)) edges.push(corner(k), corner(k | bit));
    }
    if (isOpen && clipPlane) edges.push(...this.#rectangle(clipPlane));
    const { ratio } = this;
    const at = this.viewer.project(new Float64Array(edges.flat()));
    let d = "";
    for (let k = 0; k < at.length; k += 6) {
      const [x, y, , u, v] = at.subarray(k, k + 6);
      if ([x, y, u, v].every(Number.isFinite)) d += `M${(x / ratio).toFixed(1)} ${(y / ratio).toFixed(1)}L${(u / ratio).toFixed(1)} ${(v / ratio).toFixed(1)}`;
    }
    $("section-lines").setAttribute("d", d);
  }

  /**
   * Four edges of a rectangle in the plane, as large as the model seen along the normal.
   * @param {Plane} plane
   */
  #rectangle({ normal, point }) {
    const { center } = reach(this.viewer, normal);
    const middle = add(
      center,
      normal,
      normal.reduce((s, n, i) => s + n * (point[i] - center[i]), 0),
    );
    const flat = Math.abs(normal[2]) > 0.9;
    const unit = (/** @type {number[]} */ v) => v.map((x) => x / Math.hypot(...v));
    const u = unit(cross(normal, flat ? [0, 1, 0] : [0, 0, 1]));
    const v = cross(normal, u);
    const half = [u, v].map((axis) => {
      const { low, high } = reach(this.viewer, axis);
      return (high - low) / 2;
    });
    const corners = [
      [-1, -1],
      [1, -1],
      [1, 1],
      [-1, 1],
    ].map(([a, b]) => add(add(middle, u, a * half[0]), v, b * half[1]));
    return corners.flatMap((c, k) => [c, corners[(k + 1) % 4]]);
  }
}
