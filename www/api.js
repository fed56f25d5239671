// What scripts may do with the viewer: the same object that the page itself uses (`kilwa.api`), that `<kilwa-viewer>` calls
// from another document, and that kilwa-viewer.d.ts declares. Everything that crosses it is plain data.

import { safeLink } from "./annotations.js";

const VIEWS = ["plan", "north", "east", "south", "west", "iso", "below"];
/** What another document may call by message. */
export const CALLS = new Set([
  "stats",
  "info",
  "getCamera",
  "setCamera",
  "getMode",
  "setMode",
  "modes",
  "pick",
  "view",
  "fit",
  "home",
  "back",
  "forward",
  "setTool",
  "annotations",
  "addAnnotation",
  "openAnnotation",
  "closeAnnotation",
  "showAnnotations",
  "measurements",
  "addMeasurement",
  "removeMeasurement",
  "state",
  "setState",
  "link",
  "picture",
  "setLanguage",
]);

export class Api {
  #listeners = new Map();

  constructor(page) {
    this.page = page;
  }

  get #viewer() {
    const { viewer, session } = this.page;
    if (!viewer || session?.closed) throw new Error("the model is not open");
    return viewer;
  }

  /** Whether the first picture is there. */
  get isReady() {
    return document.body.dataset.state === "ready";
  }

  /** @returns {object | null} figures of the last frame; null before the first */
  stats() {
    const { session, pack } = this.page;
    return session?.stats ? { ...session.stats, requests: pack.requests, adapter: this.#viewer.adapter() } : null;
  }

  info() {
    return this.page.info ?? null;
  }

  get camera() {
    return this.getCamera();
  }

  set camera(camera) {
    this.setCamera(camera);
  }

  getCamera() {
    const [azimuth, elevation, distance, x, y, z, parallel, roll, fieldOfView] = this.#viewer.camera();
    return { azimuth, elevation, distance, target: [x, y, z], orthographic: parallel === 1, roll, fieldOfView };
  }

  /** What is left out stays as it is. Resolves to true on arrival, false where something else took over. */
  setCamera(camera, { ease = false } = {}) {
    const c = { ...this.getCamera(), ...camera };
    const numbers = [c.azimuth, c.elevation, c.distance, ...c.target, c.orthographic ? 1 : 0, c.roll, c.fieldOfView];
    if (numbers.length !== 9 || !numbers.every(Number.isFinite) || !(c.distance > 0)) {
      throw new TypeError("camera: azimuth, elevation, distance > 0, target [x, y, z], all finite");
    }
    return this.page.flight.to(numbers, { ease });
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

  setMode(mode) {
    if (!this.modes().includes(mode)) throw new TypeError(`mode: one of ${this.modes().join(", ")}`);
    this.page.setDisplay({ ...this.page.display(), mode });
  }

  modes() {
    return this.page.module.Viewer.modes();
  }

  /** What is under a place of the picture, CSS pixels from its top left corner; null where there is nothing. */
  pick(x, y) {
    const { ratio } = this.page.session;
    const hit = this.#viewer.pick(x * ratio, y * ratio);
    if (hit.length === 0) return null;
    const ray = [...this.#viewer.ray(x * ratio, y * ratio)];
    return { place: [...hit].slice(0, 3), error: hit[3], ray: { origin: ray.slice(0, 3), direction: ray.slice(3) } };
  }

  view(name) {
    if (!VIEWS.includes(name)) throw new TypeError(`view: one of ${VIEWS.join(", ")}`);
    return this.page.standardView(name);
  }

  fit() {
    return this.page.fit();
  }

  home() {
    return this.page.home();
  }

  back() {
    return this.page.flight.back();
  }

  forward() {
    return this.page.flight.forward();
  }

  setTool(name) {
    if (!["orbit", "pan", "walk"].includes(name)) throw new TypeError("tool: orbit, pan or walk");
    this.page.tool(name);
  }

  annotations() {
    return this.page.notes.notes.map(({ id, title, text, link, place, camera, display }) => ({ id, title, text, link, place, camera, display }));
  }

  addAnnotation(note) {
    if (note?.link && !safeLink(note.link)) throw new TypeError("link: an http or https address");
    return this.page.notes.add(note);
  }

  openAnnotation(id) {
    return this.page.notes.openNamed(String(id));
  }

  closeAnnotation() {
    this.page.notes.tour.close();
  }

  showAnnotations(shown) {
    this.page.notes.setShown(Boolean(shown));
  }

  /** The measurements, with what each gave. */
  async measurements() {
    const tools = await this.page.measuring.load();
    return tools.items.map((item) => tools.plain(item));
  }

  /**
   * Measure. `tool` and, as it needs them, `points` (places in metres, taken as they are), `rays` (as `pick` gives them; what counts is where they meet the
   * finest surface), `plane`, `interval`, `reach`. Resolves when the value is final, or refused with a sentence.
   */
  async addMeasurement(measurement) {
    return (await this.page.measuring.load()).addPlain(measurement);
  }

  /** Take one away; false where there is none of that id. */
  async removeMeasurement(id) {
    const tools = await this.page.measuring.load();
    const item = tools.items.find((i) => i.id === id);
    if (item) tools.remove(item);
    return Boolean(item);
  }

  /** All that the address holds. */
  state() {
    return this.page.state();
  }

  setState(state) {
    return this.page.restore({ camera: null, display: null, notes: true, annotation: null, measurements: null, pack: null, ...state });
  }

  /** The address of this very view. */
  link() {
    this.page.address.now();
    return location.href;
  }

  /** A PNG of the view. */
  async picture({ width, height, scaleBar = true, transparent = false } = {}) {
    const { takePicture } = await import("./screenshot.js");
    const [viewer, { session }] = [this.#viewer, this.page];
    const { canvas } = session;
    return takePicture({ viewer, session }, { width: width ?? canvas.width, height: height ?? canvas.height, scaleBar, transparent });
  }

  setLanguage(language) {
    return this.page.setLanguage(language);
  }

  /**
   * Events: `ready`, `frame` (stats), `camera` (at rest), `annotation` (opened or closed), `annotations` (changed), `measurement` (one is
   * final), `measurements` (their list changed), `trouble`.
   * @returns {() => void} stops it
   */
  on(event, listener) {
    if (!this.#listeners.has(event)) this.#listeners.set(event, new Set());
    this.#listeners.get(event).add(listener);
    return () => this.#listeners.get(event).delete(listener);
  }

  emit(event, detail = null) {
    for (const listener of [...(this.#listeners.get(event) ?? []), ...(this.#listeners.get("*") ?? [])]) listener(detail, event);
  }
}
