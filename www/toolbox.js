// Which tool the left button, one finger and the keys use: turn, move, walk, note, measure; and the choice of three places for a plane.

import * as chrome from "./chrome.js";
import { $ } from "./dom.js";
import * as format from "./format.js";
import { t } from "./i18n.js";

/** @import { Placing, Tool } from "./types/page.js" */
/** @import { Measuring } from "./measuring.js" */
/** @import { Notes } from "./notes.js" */
/** @import { Scene } from "./scene.js" */

/** The tools that have a button. */
const BUTTONS = /** @type {const} */ (["orbit", "pan", "walk", "note", "measure"]);

export class Toolbox {
  /**
   * @param {object} parts
   * @param {() => Scene | null} parts.scene
   * @param {() => Notes | null} parts.notes
   * @param {Measuring} parts.measuring
   */
  constructor({ scene, notes, measuring }) {
    this.scene = scene;
    this.notes = notes;
    this.measuring = measuring;
    /** While three places are chosen: those found, and what is done with them. @type {{use: (points: number[][]) => void, found: number[][]} | null} */
    this.points = null;
  }

  /**
   * Choose a tool.
   * @param {Tool} name
   * @param {string | null} which a tool of the Measurements tab
   */
  choose(name, which = null) {
    const scene = this.scene();
    if (!scene?.isOpen) return;
    const { input, walk } = scene;
    if (name !== "walk") walk.leave();
    if (name !== "measure") this.measuring.leave();
    input.tool = name;
    input.showPoint(null);
    for (const other of BUTTONS) $(`tool-${other}`).setAttribute("aria-pressed", String(other === name));
    $("canvas").dataset.tool = name;
    this.showHint();
    if (name === "walk" || name === "note") chrome.peek();
    if (name === "walk") walk.enter();
    if (name === "points" && this.points) this.points.found = [];
    else this.points = null;
    if (name !== "orbit" && name !== "pan") $("canvas").focus({ preventScroll: true });
    if (name === "measure") this.measuring.start(which);
  }

  /**
   * A tool that its own button puts away again.
   * @param {Tool} name
   */
  toggle(name) {
    this.choose(this.scene()?.input.tool === name ? "orbit" : name);
  }

  /**
   * Let the person press three places on the surface, then go on as before.
   * @param {(points: number[][]) => void} use
   */
  pickPoints(use) {
    this.points = { use, found: [] };
    this.choose("points");
  }

  /** The next step of the tool in use, above the picture. */
  showHint() {
    const isTouch = matchMedia("(pointer: coarse)").matches;
    const tool = this.scene()?.input.tool;
    const number = format.count((this.points?.found.length ?? 0) + 1);
    /** @type {Partial<Record<Tool, () => string | null>>} */
    const hints = {
      orbit: () => this.measuring.hint, // while points are moved
      walk: () => t(isTouch ? "hintWalkTouch" : "hintWalk"),
      note: () => t(isTouch ? "hintNoteTouch" : "hintNote"),
      measure: () => this.measuring.hint,
      points: () => t("hintPoints", { n: number }),
    };
    chrome.hint(tool ? hints[tool]?.() : null);
  }

  /**
   * A place on the picture was pressed.
   * @param {number} x
   * @param {number} y
   * @param {Placing} how
   */
  place(x, y, how) {
    const scene = this.scene();
    if (!scene) return;
    if (scene.input.tool === "measure") {
      this.measuring.place(x, y, how);
      return;
    }
    const place = [...scene.viewer.pick(x, y)].slice(0, 3);
    if (place.length === 0) {
      chrome.notice(t("noteMissed"));
    } else if (this.points) {
      this.#addPoint(this.points, place);
    } else {
      scene.input.showPoint(null);
      this.notes()?.place(place);
    }
  }

  /**
   * @param {{use: (points: number[][]) => void, found: number[][]}} points
   * @param {number[]} place
   */
  #addPoint({ use, found }, place) {
    found.push(place);
    if (found.length < 3) {
      this.showHint();
      return;
    }
    this.choose("orbit");
    use(found);
  }
}
