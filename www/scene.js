// One open model on one graphics device: the viewer, what feeds it, and what moves its camera. After a device is lost there is another one.

import { Flight } from "./flight.js";
import { Input } from "./input.js";
import { Loupe } from "./loupe.js";
import { Session } from "./session.js";
import { Walk } from "./walk.js";

/** @import { Camera, Note, Viewer } from "./types/page.js" */
/** @import { Model } from "./model.js" */

/**
 * What a scene asks of the page.
 * @typedef {object} SceneEvents
 * @property {() => void} leave a deliberate jump begins: the view that is left gets an entry of the history
 * @property {() => void} orbit whoever walks is to stop
 * @property {(isParallel: boolean) => void} projection it may have changed
 * @property {(isFree: boolean) => void} turning the camera turns freely, or on the turntable
 * @property {() => void} history there is another view to go back or forward to
 */

/** From below; fitting it finds the distance. @type {Camera} */
const BELOW = { azimuth: Math.PI, elevation: -Math.PI / 2, distance: 1, target: [0, 0, 0], orthographic: true, roll: 0, fieldOfView: 0.7 };
/** Metres of the surroundings of a note that are seen at most. */
const NEAR_NOTE = 10;

export class Scene {
  /**
   * @param {object} parts
   * @param {HTMLCanvasElement} parts.canvas
   * @param {Viewer} parts.viewer
   * @param {Model} parts.model
   * @param {import("./decode-pool.js").DecodePool} parts.pool
   * @param {import("./session.js").SessionEvents} parts.streaming
   * @param {import("./actions.js").InputActions} parts.actions
   * @param {SceneEvents} parts.on
   */
  constructor({ canvas, viewer, model, pool, streaming, actions, on }) {
    this.viewer = viewer;
    this.on = on;
    const { pack, head, info } = model;
    const { colors, scalars } = info.pack;
    this.session = new Session({ canvas, viewer, pack, head, pool, attributes: { colors, scalars }, on: streaming });
    const { session } = this;
    viewer.whenLost().then(() => session.wake());
    this.flight = new Flight({ viewer, session, onHistory: on.history });
    this.walk = new Walk({ viewer, session, flight: this.flight, onChange: () => on.projection(viewer.camera().orthographic) });
    this.input = new Input(session, actions, this);
    this.loupe = new Loupe(session);
    this.#cover();
  }

  /** Of the picture, the viewer leaves free what lies under the tools when it shows all of the model. */
  #cover() {
    const { canvas, ratio } = this.session;
    const whole = canvas.getBoundingClientRect();
    const rail = /** @type {HTMLElement} */ (document.querySelector(".rail")).getBoundingClientRect();
    const [left, top] = [rail.right - whole.left, rail.bottom - whole.top];
    const [right, bottom] = [whole.right - rail.left, whole.bottom - rail.top];
    const isColumn = rail.height > rail.width;
    const edges = { left: isColumn && left <= right, top: !isColumn && top <= bottom, right: isColumn && left > right, bottom: !isColumn && top > bottom };
    const pixels = (/** @type {boolean} */ isCovered, /** @type {number} */ extent) => (isCovered && rail.width > 0 ? extent * ratio : 0);
    this.viewer.setCovered(pixels(edges.left, left), pixels(edges.top, top), pixels(edges.right, right), pixels(edges.bottom, bottom));
  }

  /** The view that a model opens with. */
  begin() {
    this.viewer.standardView("iso");
  }

  get isOpen() {
    return !this.session.closed;
  }

  /** Whether the camera is being moved: held by a pointer, on a flight, walking. */
  get isMoving() {
    return this.isOpen && (this.input.pointers.size > 0 || this.flight.goal !== null || this.walk.held.size > 0);
  }

  close() {
    this.session.close();
    this.input.close();
    this.walk.close();
  }

  /**
   * Fly to where `move` takes the camera.
   * @param {(viewer: Viewer) => void} move
   * @param {{isJump: boolean}} how
   * @returns {Promise<boolean>} true on arrival, false when something else took over
   */
  fly(move, { isJump }) {
    if (!this.isOpen) return Promise.resolve(false);
    if (this.walk.on) this.on.orbit();
    if (isJump) this.on.leave();
    const { viewer, flight } = this;
    const here = flight.there;
    flight.mark();
    flight.stop();
    const from = viewer.camera();
    viewer.setCamera(here);
    move(viewer);
    const goal = viewer.camera();
    viewer.setCamera(from);
    const arrived = flight.to(goal, { mark: false });
    this.on.projection(goal.orthographic);
    return arrived;
  }

  /** All of the model, from the same direction. */
  fit() {
    this.#cover();
    return this.fly((viewer) => viewer.fit(), { isJump: false });
  }

  /** @param {string} name */
  standardView(name) {
    this.#cover();
    const look = (/** @type {Viewer} */ viewer) => {
      if (name !== "below") viewer.standardView(name);
      else if (viewer.setCamera(BELOW)) viewer.fit();
    };
    return this.fly(look, { isJump: true });
  }

  /**
   * @param {Camera} camera
   * @param {{isJump: boolean}} how
   */
  goTo(camera, how) {
    return this.fly((viewer) => viewer.setCamera(camera), how);
  }

  /**
   * A place on the model, from the direction it is looked at now.
   * @param {Note["place"]} place
   * @param {{isJump: boolean}} how
   */
  lookAtPlace(place, how) {
    const near = (/** @type {Viewer} */ viewer) => {
      const camera = viewer.camera();
      const shown = viewer.metresPerPixel() * this.session.canvas.height;
      const distance = Math.min(camera.distance, camera.distance * Math.max(0.2, NEAR_NOTE / shown));
      viewer.setCamera({ ...camera, distance, target: vector(place) });
    };
    return this.fly(near, how);
  }

  /**
   * Look at a part of the model, `across` metres wide, from the current direction or from `side`.
   * @param {number[]} middle
   * @param {number} across
   * @param {Partial<Camera>} [side]
   */
  lookAtRegion(middle, across, side) {
    const { width, height } = this.session.canvas;
    const look = (/** @type {Viewer} */ viewer) => {
      const camera = viewer.camera();
      const shown = viewer.metresPerPixel() * Math.min(width, height);
      viewer.setCamera({ ...camera, ...side, distance: (camera.distance * Math.max(across * 1.6, 1e-3)) / shown, target: vector(middle) });
    };
    return this.fly(look, { isJump: true });
  }

  /** @param {boolean} isParallel */
  setOrthographic(isParallel) {
    if (!this.isOpen) return;
    this.viewer.setOrthographic(isParallel);
    this.on.projection(isParallel);
    this.session.wake();
  }

  /**
   * On the turntable up stays up; freely there is no up.
   * @param {boolean} isFree
   */
  setFree(isFree) {
    this.input.isFree = isFree;
    this.on.turning(isFree);
    const camera = this.viewer.camera();
    if (!isFree && Math.abs(camera.roll) > 1e-9) this.flight.to({ ...camera, roll: 0 });
  }
}

/**
 * @param {number[]} place
 * @returns {[number, number, number]}
 */
const vector = ([x, y, z]) => [x, y, z];
