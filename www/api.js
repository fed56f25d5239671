// What scripts may do with the viewer: the same object that the page itself uses (`kilwa.api`), that `<kilwa-viewer>` calls
// from another document, and that kilwa-viewer.d.ts declares. Everything that crosses it is plain data.

import { safeLink } from "./annotations.js";
import { numbersOf } from "./camera.js";

/** @import { Events } from "./kilwa-viewer.js" */
/** @import { Display } from "./display.js" */
/** @import { Model } from "./model.js" */
/** @import { Notes } from "./notes.js" */
/** @import { Scene } from "./scene.js" */
/** @import { Camera, NewMeasurement, PageState, PictureOptions } from "./types/page.js" */

const VIEWS = ["plan", "north", "east", "south", "west", "iso", "below"];

/**
 * What the API acts on.
 * @typedef {object} ApiParts
 * @property {() => Scene | null} scene
 * @property {() => Model | null} model
 * @property {() => Notes} notes throws where no model is open
 * @property {Display} display
 * @property {import("./measuring.js").Measuring} measuring
 * @property {import("./link.js").Address} address
 * @property {(name: "orbit" | "pan" | "walk") => void} tool
 * @property {() => import("./link.js").Linked} state
 * @property {(state: PageState) => void} restore
 * @property {(language: string) => Promise<void>} setLanguage
 */

/** @typedef {(detail: any, event: string) => void} Listener */

export class Api {
  /** @type {Map<string, Set<Listener>>} */
  #listeners = new Map();
  #parts;

  /** @param {ApiParts} parts */
  constructor(parts) {
    this.#parts = parts;
  }

  get #scene() {
    const scene = this.#parts.scene();
    if (!scene?.isOpen) throw new Error("the model is not open");
    return scene;
  }

  get #viewer() {
    return this.#scene.viewer;
  }

  /** Whether the first picture is there. */
  get isReady() {
    return document.body.dataset.state === "ready";
  }

  /** Figures of the last frame; null before the first. */
  stats() {
    const session = this.#parts.scene()?.session;
    return session?.stats ? { ...session.stats, requests: session.pack.requests, adapter: this.#viewer.adapter() } : null;
  }

  info() {
    return this.#parts.model()?.info ?? null;
  }

  get camera() {
    return this.getCamera();
  }

  set camera(camera) {
    this.setCamera(camera);
  }

  getCamera() {
    return this.#viewer.camera();
  }

  /**
   * What is left out stays as it is. Resolves to true on arrival, false where something else took over.
   * @param {Partial<Camera>} camera
   * @param {{ease?: boolean}} how
   */
  setCamera(camera, { ease = false } = {}) {
    const c = { ...this.getCamera(), ...camera };
    const numbers = numbersOf(c);
    if (numbers.length !== 9 || !numbers.every(Number.isFinite) || !(c.distance > 0)) {
      throw new TypeError("camera: azimuth, elevation, distance > 0, target [x, y, z], all finite");
    }
    return this.#scene.flight.to(c, { ease });
  }

  get mode() {
    return this.getMode();
  }

  set mode(mode) {
    this.setMode(mode);
  }

  getMode() {
    return this.#viewer.mode();
  }

  /** @param {string} mode */
  setMode(mode) {
    if (!this.modes().includes(mode)) throw new TypeError(`mode: one of ${this.modes().join(", ")}`);
    this.#parts.display.show({ ...this.#parts.display.chosen, mode });
  }

  modes() {
    return this.#parts.model()?.module.Viewer.modes() ?? [];
  }

  /**
   * What is under a place of the picture, CSS pixels from its top left corner; null where there is nothing.
   * @param {number} x
   * @param {number} y
   */
  pick(x, y) {
    const { ratio } = this.#scene.session;
    const hit = this.#viewer.pick(x * ratio, y * ratio);
    if (hit.length === 0) return null;
    const ray = [...this.#viewer.ray(x * ratio, y * ratio)];
    return { place: [...hit].slice(0, 3), error: hit[3], ray: { origin: ray.slice(0, 3), direction: ray.slice(3) } };
  }

  /** @param {string} name */
  view(name) {
    if (!VIEWS.includes(name)) throw new TypeError(`view: one of ${VIEWS.join(", ")}`);
    return this.#scene.standardView(name);
  }

  fit() {
    return this.#scene.fit();
  }

  home() {
    return this.#scene.standardView("iso");
  }

  back() {
    return this.#scene.flight.back();
  }

  forward() {
    return this.#scene.flight.forward();
  }

  /** @param {"orbit" | "pan" | "walk"} name */
  setTool(name) {
    if (!["orbit", "pan", "walk"].includes(name)) throw new TypeError("tool: orbit, pan or walk");
    this.#parts.tool(name);
  }

  annotations() {
    return this.#parts.notes().notes.map(({ id, title, text, link, place, camera, display }) => ({ id, title, text, link, place, camera, display }));
  }

  /** @param {Parameters<Notes["add"]>[0]} note */
  addAnnotation(note) {
    if (note?.link && !safeLink(note.link)) throw new TypeError("link: an http or https address");
    return this.#parts.notes().add(note);
  }

  /** @param {string} id */
  openAnnotation(id) {
    return this.#parts.notes().openNamed(String(id));
  }

  closeAnnotation() {
    this.#parts.notes().tour.close();
  }

  /** @param {boolean} shown */
  showAnnotations(shown) {
    this.#parts.notes().setShown(Boolean(shown));
  }

  /** The measurements, with what each gave. */
  async measurements() {
    const tools = await this.#parts.measuring.load();
    return tools.items.map((item) => tools.plain(item));
  }

  /**
   * Measure. `tool` and, as it needs them, `points` (places in metres, taken as they are), `rays` (as `pick` gives them; what counts is where they meet the
   * finest surface), `plane`, `interval`, `reach`. Resolves when the value is final, or refused with a sentence.
   * @param {NewMeasurement} measurement
   */
  async addMeasurement(measurement) {
    return (await this.#parts.measuring.load()).addPlain(measurement);
  }

  /**
   * Take one away; false where there is none of that id.
   * @param {string} id
   */
  async removeMeasurement(id) {
    const tools = await this.#parts.measuring.load();
    return tools.remove(id);
  }

  /** All that the address holds. */
  state() {
    return this.#parts.state();
  }

  /** @param {Partial<PageState>} state */
  setState(state) {
    this.#parts.restore({ camera: null, display: null, notes: true, annotation: null, measurements: null, pack: null, ...state });
  }

  /** The address of this very view. */
  link() {
    this.#parts.address.now();
    return location.href;
  }

  /**
   * A PNG of the view.
   * @param {PictureOptions} options
   */
  async picture({ width, height, scaleBar = true, transparent = false } = {}) {
    const { takePicture } = await import("./screenshot.js");
    const scene = this.#scene;
    const { canvas } = scene.session;
    return takePicture(scene, { width: width ?? canvas.width, height: height ?? canvas.height, scaleBar, transparent });
  }

  /** @param {string} language */
  setLanguage(language) {
    return this.#parts.setLanguage(language);
  }

  /**
   * Events: `ready`, `frame` (stats), `camera` (at rest), `annotation` (opened or closed), `annotations` (changed), `measurement` (one is
   * final), `measurements` (their list changed), `trouble`.
   * @param {keyof Events | "*"} event
   * @param {Listener} listener
   * @returns {() => void} stops it
   */
  on(event, listener) {
    const all = this.#listeners.get(event) ?? new Set();
    this.#listeners.set(event, all.add(listener));
    return () => all.delete(listener);
  }

  /**
   * @template {keyof Events} E
   * @param {E} event
   * @param {Events[E]} detail
   */
  emit(event, detail) {
    for (const listener of [...(this.#listeners.get(event) ?? []), ...(this.#listeners.get("*") ?? [])]) listener(detail, event);
  }
}
