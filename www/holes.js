// The holes of a merged surface (`kilwa merge --holes`): outlines over the picture, and a list in the Display tab. Loaded only where the host
// publishes a list (`?holes=`, `data-holes`) or one is dropped on the page; its messages are in a file of their own.

import { html, nothing } from "lit-html";
import { notice, peek } from "./chrome.js";
import { $ } from "./dom.js";
import { count, isolate } from "./format.js";
import { onChange, t } from "./i18n.js";
import { why } from "./messages.js";
import { partMessages } from "./part-messages.js";
import { get } from "./store.js";
import { show } from "./view.js";

/** @import { Current } from "./current.js" */
/** @import { Scene } from "./scene.js" */

/**
 * @typedef {object} Hole metres in coordinates of the pack
 * @property {number} cause its place in CAUSES
 * @property {number} area square metres
 * @property {number} length of its rim
 * @property {number[]} center
 * @property {number[]} areas square metres of each cause
 * @property {number[][]} rim closed, the first point is not repeated
 */
/** A stretch of an outline: its first and last point. @typedef {{hole: Hole, from: number, to: number, hidden: boolean}} Piece */

/** Causes, the keys of their names, and colours that people with any colour vision tell apart (Okabe and Ito). */
const CAUSES = ["unseen", "free", "dropped", "no_return"];
const NAMES = ["holeUnseen", "holeFree", "holeDropped", "holeNoReturn"];
const COLORS = ["#d55e00", "#0072b2", "#cc79a7", "#009e73"];
/** Metres of the units that measurements can be in (measure/values.js, which only measuring loads). @type {Record<string, number>} */
const METRES = { m: 1, cm: 0.01, mm: 0.001, km: 1000, ft: 0.3048, "us-ft": 1200 / 3937, in: 0.0254 };
/** Maximum number of holes drawn and listed, and of points in all outlines; more would slow down drawing. */
const [MAX_HOLES, MAX_POINTS] = [200, 12_000];
/** Points of an outline that are tested together for occlusion by the model. */
const PIECE = 8;
/** Milliseconds per turn of that test; how far a point may lie behind the drawn surface and still count as visible, as a share of its distance. */
const [PATIENCE, SLACK] = [4, 0.004];

/** @param {number[]} a @param {number[]} b */
const distance = (a, b) => Math.hypot(...a.map((v, k) => v - b[k]));

/**
 * The holes of a list, largest first.
 * @param {any} json
 * @param {number[]} bounds of the model: its lowest and its highest corner
 * @returns {Hole[]}
 */
function parse(json, bounds) {
  const [low, high] = [bounds.slice(0, 3), bounds.slice(3)];
  const margin = distance(low, high) / 50;
  const isOn = (/** @type {number[]} */ p) => p.every((v, k) => v >= low[k] - margin && v <= high[k] + margin);
  try {
    if (json.name !== "holes") throw 0;
    const all = json.features.map((/** @type {any} */ { geometry, properties: p }) => {
      const areas = CAUSES.map((cause) => p.areas_m2[cause]);
      const rim = geometry.coordinates[0].slice(1);
      const places = [p.center, ...rim];
      const cause = CAUSES.indexOf(p.cause);
      const isRight = places.every((place) => place.length === 3 && isOn(place)) && [p.area_m2, p.rim_m, ...areas, ...places.flat()].every(Number.isFinite);
      if (!isRight || cause < 0 || rim.length < 3) throw 0;
      return { cause, area: p.area_m2, length: p.rim_m, center: p.center, areas, rim };
    });
    return all.sort((/** @type {Hole} */ a, /** @type {Hole} */ b) => b.area - a.area);
  } catch {
    throw new Error(t("holesForm"));
  }
}

/**
 * The direction from which to view a hole. A rim runs clockwise as seen from the scanned side, so its Newell normal is reversed.
 * @param {number[][]} rim
 */
function before(rim) {
  const [x, y, z] = [0, 1, 2].map((i) => {
    const [j, k] = [(i + 1) % 3, (i + 2) % 3];
    return rim.reduce((sum, p, at) => {
      const q = rim[(at + 1) % rim.length];
      return sum + (q[j] - p[j]) * (p[k] + q[k]);
    }, 0);
  });
  return { azimuth: Math.atan2(x, y), elevation: Math.atan2(z, Math.hypot(x, y)) };
}

/**
 * A length or an area in the person's unit, to three digits.
 * @param {number} value
 * @param {1 | 2} power
 */
function size(value, power) {
  const unit = get("unit") in METRES ? get("unit") : "m";
  const number = value / METRES[unit] ** power;
  const text = number > 0 && number < 0.001 ? `< ${count(0.001)}` : count(Number(number.toPrecision(3)));
  return isolate(`${text} ${unit}${power > 1 ? "²" : ""}`);
}

/** @param {number} cause */
const swatch = (cause) =>
  html`<svg class="icon" viewBox="0 0 20 20" aria-hidden="true"><path d="M1 10h18" stroke=${COLORS[cause]} stroke-width="5"></path></svg>`;

export class Holes {
  /** @type {Hole[] | null} */
  #all = null;
  /** @type {Hole | null} */
  #chosen = null;
  #isOn = false;
  #seen = "";
  /** Places of the outlines that are drawn. */
  #places = new Float64Array();
  /** @type {Piece[]} */
  #pieces = [];
  /** Pieces that may be hidden or not. @type {Piece[]} */
  #unsure = [];
  #canvas = document.createElement("canvas");
  #panel = document.createElement("fieldset");

  /**
   * @param {Current} current
   * @param {Scene} scene
   * @param {() => unknown} read the list as JSON
   */
  constructor(current, scene, read) {
    this.current = current;
    this.scene = scene;
    this.read = read;
    this.#canvas.className = "marks";
    this.#canvas.ariaHidden = "true";
    this.#panel.id = "holes";
    $("marks").before(this.#canvas);
    $("display").firstElementChild?.after(this.#panel);
    $("tab-display").addEventListener("click", () => this.#show()); // The unit may have changed.
    onChange(() => this.#isHere && partMessages("holes").then(() => this.#show()));
    this.attach(scene);
  }

  get #isHere() {
    return this.current.holes === this && this.scene.isOpen;
  }

  /** Another model is opened, or another list. */
  close() {
    this.current.holes = null;
    this.#panel.remove();
    this.#canvas.remove();
  }

  /**
   * Follow the frames of this scene; called again when the picture was rebuilt.
   * @param {Scene} scene
   */
  attach(scene) {
    this.scene = scene;
    scene.session.watchers.add(() => this.#frame());
  }

  /** @param {boolean} isOn */
  async turn(isOn) {
    try {
      if (isOn && !this.#all) this.#trace(parse(await this.read(), [...this.scene.viewer.bounds()]));
      this.#isOn = isOn;
    } catch (error) {
      notice(t("holesFailed", { why: why(error) }), 12000);
    }
    this.#show();
  }

  /**
   * Outlines of the largest holes, with as many points of their rims as can be drawn.
   * @param {Hole[]} all
   */
  #trace(all) {
    this.#all = all;
    const drawn = all.slice(0, MAX_HOLES);
    const share = Math.min(1, MAX_POINTS / drawn.reduce((sum, { rim }) => sum + rim.length, 1));
    /** @type {number[]} */
    const places = [];
    for (const hole of drawn) {
      const { length } = hole.rim;
      const points = Math.min(length, Math.max(12, Math.round(length * share)));
      const first = places.length / 3;
      for (let k = 0; k <= points; k += 1) places.push(...hole.rim[Math.floor((k * length) / points) % length]);
      for (let k = 0; k < points; k += PIECE) this.#pieces.push({ hole, from: first + k, to: first + Math.min(points, k + PIECE), hidden: false });
    }
    this.#places = new Float64Array(places);
  }

  #frame() {
    if (!this.#isHere) return;
    const { viewer, session } = this.scene;
    const seen = JSON.stringify([viewer.camera(), session.canvas.width, session.canvas.height, session.stats?.trianglesDrawn]);
    if (seen === this.#seen) return;
    this.#seen = seen;
    this.#unsure = this.#isOn ? [...this.#pieces] : [];
    this.#paint();
    this.#look();
  }

  /** Find out what the model hides, a few pieces at a time. */
  #look() {
    clearTimeout(this.timer);
    const until = performance.now() + PATIENCE;
    while (performance.now() < until) {
      const piece = this.#unsure.pop();
      if (!piece || !this.#isHere) return this.#paint();
      const { viewer, session } = this.scene;
      const at = 3 * ((piece.from + piece.to) >> 1);
      const place = this.#places.subarray(at, at + 3);
      const slack = 2 * (session.stats?.worstErrorMetres ?? 0) + SLACK * Math.abs(viewer.project(place)[2]);
      piece.hidden = viewer.isHidden(place[0], place[1], place[2], slack);
    }
    this.timer = setTimeout(() => this.#look(), 16);
  }

  #paint() {
    if (!this.#isHere) return;
    const { viewer, session } = this.scene;
    const { width, height } = session.canvas;
    Object.assign(this.#canvas, { width, height });
    if (!this.#isOn) return;
    const context = /** @type {CanvasRenderingContext2D} */ (this.#canvas.getContext("2d"));
    const at = viewer.project(this.#places);
    context.lineJoin = context.lineCap = "round";
    const line = (/** @type {string} */ color, /** @type {number} */ wide, /** @type {(piece: Piece) => boolean} */ is) => {
      context.strokeStyle = color;
      context.lineWidth = wide * session.ratio;
      context.beginPath();
      for (const { from, to } of this.#pieces.filter(is)) {
        for (let k = from; k < to; k += 1) {
          const [x, y, _, u, v] = at.subarray(3 * k, 3 * k + 5);
          if (!Number.isFinite(x + u)) continue; // behind the eye
          context.moveTo(x, y);
          context.lineTo(u, v);
        }
      }
      context.stroke();
    };
    for (const hidden of [true, false]) {
      context.globalAlpha = hidden ? 0.3 : 1;
      line("#fff", 4.5, (piece) => piece.hidden === hidden);
      for (const [cause, color] of COLORS.entries()) line(color, 2.5, (piece) => piece.hidden === hidden && piece.hole.cause === cause);
    }
    const isChosen = (/** @type {Piece} */ { hole }) => hole === this.#chosen;
    line("#000", 8, isChosen);
    line(COLORS[this.#chosen?.cause ?? 0], 4, isChosen);
  }

  /** @param {Hole} hole */
  #go(hole) {
    if (!this.#isHere) return;
    const { scene } = this;
    const { center, rim } = hole;
    const bounds = [...scene.viewer.bounds()];
    const across = rim.reduce((far, p) => Math.max(far, 2.5 * distance(p, center)), distance(bounds.slice(0, 3), bounds.slice(3)) / 50);
    peek();
    scene.lookAtRegion(center, across, before(rim));
    this.#chosen = hole;
    this.#show();
  }

  #show() {
    const all = this.#isOn && this.#all;
    const turn = async (/** @type {Event} */ event) => {
      const box = /** @type {HTMLInputElement} */ (event.target);
      await this.turn(box.checked);
      box.checked = this.#isOn; // also where the list could not be read
    };
    const toggle = html`<legend>${t("holes")}</legend><label class="choice"><input type="checkbox" .checked=${this.#isOn} @change=${turn}><span>${t("holesShow")}</span></label>`;
    show(html`${toggle}${all ? this.#list(all) : nothing}`, this.#panel);
    this.#seen = "";
    this.#frame();
  }

  /** @param {Hole[]} all */
  #list(all) {
    const total = (/** @type {(hole: Hole) => number} */ of) =>
      size(
        all.reduce((sum, hole) => sum + of(hole), 0),
        2,
      );
    const legend = NAMES.map((name, k) => html`${swatch(k)}<span>${t(name)}</span><span>${total(({ areas }) => areas[k])}</span>`);
    const row = (/** @type {Hole} */ hole) =>
      html`<li><div class="row"><button type="button" class="go" aria-current=${hole === this.#chosen ? "true" : nothing} @click=${() => this.#go(hole)}>${swatch(hole.cause)}<span>${t(NAMES[hole.cause])}<br><span class="quiet">${t("holeSize", { area: size(hole.area, 2), length: size(hole.length, 1) })}</span></span></button></div></li>`;
    const text = t("holesCount", { count: all.length, area: total(({ area }) => area) });
    const rest = all.length > MAX_HOLES ? t("holesRest", { count: all.length - MAX_HOLES }) : "";
    return html`<div class="legend">${legend}</div><details open><summary>${text}</summary><ol class="list-edit">${all.slice(0, MAX_HOLES).map(row)}</ol><p class="quiet">${rest}</p></details>`;
  }
}

/**
 * Offer a list of the model that is open.
 * @param {Current} current
 * @param {() => unknown} read the list as JSON
 * @param {boolean} isOn whether it is shown at once
 */
export async function offer(current, read, isOn) {
  const { scene } = current;
  try {
    await partMessages("holes");
    if (!scene?.isOpen || current.scene !== scene) return;
    current.holes?.close();
    const holes = new Holes(current, scene, read);
    current.holes = holes;
    await holes.turn(isOn);
  } catch (error) {
    notice(why(error), 12000);
  }
}
