// Where photographs were taken: a small pyramid for each, from the camera to the corners of its picture, and a ring for each panorama, on a canvas over the
// picture of the model. What the model hides is dimmed; that is found out a few photographs at a time.

import { border } from "./lens.js";
import { inWorld, plus } from "./pose.js";

/** @import { Scene } from "../scene.js" */
/** @import { Photograph, Vector } from "./pose.js" */

/** The pyramids are as deep as this share of the distance between neighbours, within these shares of the model's size. */
const [DEPTH, LEAST, MOST] = [0.4, 0.01, 0.04];
/** So many photographs are asked for the distance of their nearest neighbour. */
const ASKED = 100;
/** Parts of each side of a picture that is drawn: a fisheye bends it. */
const sidesOf = (/** @type {Photograph} */ { camera: { distortion } }) => (distortion?.kind === "fisheye" ? 4 : 1);
/** A pyramid that is smaller is a dot, pixels of the screen: of thousands in sight, most are. */
const SMALLEST = 3;
/** Milliseconds per turn of the test for occlusion; how far a point may lie behind the drawn surface and still count as visible, as a share of its distance. */
const [PATIENCE, SLACK] = [4, 0.004];
const COLOUR = "#0072b2";
const CHOSEN = "#d55e00";

/** @typedef {{photo: Photograph, first: number, rim: number, isHidden: boolean}} Mark its first point is the camera, `rim` points follow, the upper edge first */

export class Frusta {
  /** @type {Mark[]} */
  #marks = [];
  #places = new Float64Array();
  /** Pixels of the places, three numbers each. @type {Float64Array} */
  #at = new Float64Array();
  /** @type {Mark[]} */
  #unsure = [];
  #seen = "";
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #timer;
  #isOn = false;

  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Scene} scene
   * @param {Photograph[]} photographs
   */
  constructor(canvas, scene, photographs) {
    this.canvas = canvas;
    this.scene = scene;
    /** The one that is pointed at. @type {Photograph | null} */
    this.pointed = null;
    const [a, b, c, u, v, w] = scene.viewer.bounds();
    const size = Math.hypot(u - a, v - b, w - c);
    const depth = Math.max(LEAST * size, Math.min(MOST * size, DEPTH * apart(photographs)));
    /** @type {number[]} */
    const places = [];
    for (const photo of photographs) {
      const first = places.length / 3;
      const rim = rimOf(photo, depth);
      places.push(...photo.position, ...rim.flat());
      this.#marks.push({ photo, first, rim: rim.length, isHidden: false });
    }
    this.#places = new Float64Array(places);
  }

  /** @param {boolean} isOn */
  turn(isOn) {
    this.#isOn = isOn;
    this.again();
  }

  again() {
    this.#seen = "";
    this.frame();
  }

  /** After each frame of the viewer. */
  frame() {
    if (!this.scene.isOpen) return;
    const { viewer, session } = this.scene;
    const seen = JSON.stringify([this.#isOn, viewer.camera(), session.canvas.width, session.canvas.height, session.stats?.trianglesDrawn]);
    if (seen === this.#seen) return;
    this.#seen = seen;
    clearTimeout(this.#timer);
    if (this.#isOn) this.#at = viewer.project(this.#places);
    this.#unsure = this.#isOn ? this.#marks.filter(({ first }) => this.#isInPicture(first)) : [];
    this.paint();
    this.#look();
  }

  /** @param {number} point */
  #isInPicture(point) {
    const { width, height } = this.scene.session.canvas;
    const [x, y] = this.#at.subarray(3 * point, 3 * point + 2);
    return x > 0 && x < width && y > 0 && y < height;
  }

  #look() {
    const until = performance.now() + PATIENCE;
    while (performance.now() < until) {
      const mark = this.#unsure.pop();
      if (!mark || !this.scene.isOpen) return this.paint();
      const { viewer, session } = this.scene;
      const [x, y, z] = mark.photo.position;
      const slack = 2 * (session.stats?.worstErrorMetres ?? 0) + SLACK * Math.abs(this.#at[3 * mark.first + 2]);
      mark.isHidden = viewer.isHidden(x, y, z, slack);
    }
    this.#timer = setTimeout(() => this.#look(), 16);
  }

  paint() {
    if (!this.scene.isOpen) return;
    const { width, height } = this.scene.session.canvas;
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    const context = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
    context.clearRect(0, 0, width, height);
    if (!this.#isOn) return;
    context.lineJoin = context.lineCap = "round";
    const isPointed = (/** @type {Mark} */ { photo }) => photo === this.pointed;
    for (const isHidden of [true, false]) {
      context.globalAlpha = isHidden ? 0.25 : 1;
      const is = (/** @type {Mark} */ mark) => mark.isHidden === isHidden && !isPointed(mark);
      this.#stroke(context, { color: "#fff", wide: 3.5, is });
      this.#stroke(context, { color: COLOUR, wide: 1.5, is });
    }
    context.globalAlpha = 1;
    this.#stroke(context, { color: "#fff", wide: 6, is: isPointed });
    this.#stroke(context, { color: CHOSEN, wide: 3, is: isPointed });
  }

  /**
   * @param {CanvasRenderingContext2D} context
   * @param {{color: string, wide: number, is: (mark: Mark) => boolean}} how
   */
  #stroke(context, { color, wide, is }) {
    const { ratio } = this.scene.session;
    context.strokeStyle = context.fillStyle = color;
    context.lineWidth = wide * ratio;
    context.beginPath();
    const line = (/** @type {number} */ from, /** @type {number} */ to) => {
      const [x, y] = this.#at.subarray(3 * from, 3 * from + 2);
      const [u, v] = this.#at.subarray(3 * to, 3 * to + 2);
      if (!Number.isFinite(x + y + u + v)) return; // behind the eye
      context.moveTo(x, y);
      context.lineTo(u, v);
    };
    for (const mark of this.#marks) {
      if (!is(mark)) continue;
      const { first, rim, photo } = mark;
      const isPyramid = photo.camera.kind === "pinhole";
      const sides = sidesOf(photo);
      const [x, y] = this.#at.subarray(3 * first, 3 * first + 2);
      const [u, v] = this.#at.subarray(3 * first + 3, 3 * first + 5);
      if (Math.hypot(x - u, y - v) < SMALLEST * ratio) continue;
      for (let k = 0; k < rim; k += 1) {
        line(first + 1 + k, first + 1 + ((k + 1) % rim));
        if (isPyramid && k % sides === 0) line(first, first + 1 + k);
      }
    }
    context.stroke();
    context.beginPath();
    for (const { first } of this.#marks.filter(is)) {
      const [x, y] = this.#at.subarray(3 * first, 3 * first + 2);
      if (!Number.isFinite(x + y)) continue;
      context.moveTo(x, y);
      context.arc(x, y, (wide + 1.5) * ratio, 0, 7);
    }
    context.fill();
  }

  /**
   * The photograph whose camera is drawn at a place, those in sight first.
   * @param {number} x pixels of the picture
   * @param {number} y
   * @param {number} reach pixels
   * @returns {Photograph | null}
   */
  at(x, y, reach) {
    if (!this.#isOn) return null;
    let best = null;
    let least = Infinity;
    for (const { photo, first, isHidden } of this.#marks) {
      const far = Math.hypot(this.#at[3 * first] - x, this.#at[3 * first + 1] - y) + (isHidden ? reach : 0);
      if (far < least && far <= (isHidden ? 2 : 1) * reach) [best, least] = [photo, far];
    }
    return best;
  }

  close() {
    clearTimeout(this.#timer);
    this.canvas.remove();
  }
}

/**
 * The points round a mark: the border of a photograph in some depth, or a level ring.
 * @param {Photograph} photo
 * @param {number} depth metres
 * @returns {Vector[]}
 */
function rimOf(photo, depth) {
  const { camera, axes, position } = photo;
  const from = (/** @type {Vector} */ direction) => plus(position, inWorld(axes, direction));
  if (camera.kind !== "pinhole") {
    const angles = Array.from({ length: 24 }, (_, k) => (k * Math.PI) / 12);
    return angles.map((angle) => from([0.6 * depth * Math.sin(angle), 0, 0.6 * depth * Math.cos(angle)]));
  }
  // Where the border of a fisheye sees nothing, the pyramid ends in its camera.
  return border(camera, sidesOf(photo)).map((direction) => {
    const [x, y, z] = direction ?? [0, 0, 0];
    const long = depth / Math.max(z, 0.5);
    return from([x * long, y * long, z * long]);
  });
}

/**
 * The median distance of a photograph from its nearest neighbour, metres.
 * @param {Photograph[]} photographs
 */
function apart(photographs) {
  const every = Math.max(1, Math.floor(photographs.length / ASKED));
  const nearest = photographs
    .filter((_, k) => k % every === 0)
    .map(({ position }) => {
      const away = photographs.map((other) => Math.hypot(...position.map((v, k) => v - other.position[k]))).filter((d) => d > 1e-6);
      return away.reduce((least, d) => Math.min(least, d), Infinity);
    })
    .filter(Number.isFinite)
    .sort((a, b) => a - b);
  return nearest[nearest.length >> 1] ?? Infinity;
}
