// The photographs that a model was coloured from (`kilwa publish --colour-report --photos`): where they were taken, drawn over the model; a strip of them;
// and one at a time over the picture of its own view. Loaded only where the host names a colour report (`?photographs=`, `data-photographs`); the messages
// are in a file of their own.

import { html, nothing } from "lit-html";
import { announce, notice, peek } from "../chrome.js";
import { $ } from "../dom.js";
import { onChange, t } from "../i18n.js";
import { why } from "../messages.js";
import { partMessages } from "../part-messages.js";
import { partStyles } from "../part-styles.js";
import { show } from "../view.js";
import { Frusta } from "./frusta.js";
import { Overlay } from "./overlay.js";
import { axesOfCamera, cameraAt, plus, seenFrom } from "./pose.js";
import { photographsOf } from "./report.js";
import { Strip } from "./strip.js";

/** @import { Camera } from "../types/page.js" */
/** @import { Current } from "../current.js" */
/** @import { Scene } from "../scene.js" */
/** @import { Photograph } from "./pose.js" */
/** @import { Shown } from "./strip.js" */

/** How far from a camera, in pixels of the screen, a press still means it: with a mouse, and with a finger. */
const [REACH, REACH_TOUCH] = [14, 24];
/** A press that moved by so many CSS pixels was a drag. */
const SLACK = 6;
/** The eye stands where the photograph was taken, as a share of what the model measures. */
const SAME_PLACE = 1e-7;

class Photographs {
  /** @type {Photograph[] | null} */
  #all = null;
  #isOn = false;
  /** @type {Promise<void> | null} */
  #reading = null;
  /** @type {Frusta | null} */
  #frusta = null;
  /** @type {Strip | null} */
  #strip = null;
  /** @type {Shown | null} */
  #shown = null;
  /** The visit of the place where it was taken: another one each time that a photograph is opened. `goal`: of the flight there; null on arrival. @type {{goal: Camera | null} | null} */
  #visit = null;
  /** The opening angle before the first visit. */
  #before = 0.7;
  /** The opening angle of the last frame there. */
  #opening = 0;
  /** @type {Overlay | null} */
  #overlay = null;
  #panel = Object.assign(document.createElement("fieldset"), { id: "photographs" });
  #abort = new AbortController();
  /** @type {AbortController | null} */
  #loading = null;
  /** The size of the picture that the camera was put for, and where it looked then. */
  #size = "";
  #look = "";
  #press = { x: 0, y: 0 };

  /**
   * @param {Current} current
   * @param {Scene} scene
   * @param {URL} report the address of the colour report
   * @param {() => unknown} read the report as JSON
   */
  constructor(current, scene, report, read) {
    this.current = current;
    this.scene = scene;
    this.report = report;
    this.read = read;
    $("display").firstElementChild?.after(this.#panel);
    onChange(() => {
      const written = this.#isHere && partMessages("photographs").then(() => this.#show());
      if (written) written.catch(() => {}); // the messages of before stay
    });
    const { signal } = this.#abort;
    const canvas = $("canvas");
    canvas.addEventListener("pointerdown", ({ clientX: x, clientY: y }) => (this.#press = { x, y }), { signal });
    canvas.addEventListener("pointermove", (event) => this.#point(event), { signal });
    canvas.addEventListener("click", (event) => this.#click(event), { signal });
    addEventListener("keydown", (event) => this.#key(event), { signal });
    this.attach(scene);
  }

  get #isHere() {
    return this.current.photographs === this && this.scene.isOpen;
  }

  /** Another model is opened. */
  close() {
    this.#leave();
    this.current.photographs = null;
    this.#abort.abort();
    this.#frusta?.close();
    this.#strip?.remove();
    this.#panel.remove();
  }

  /**
   * Follow the frames of this scene; called again when the picture was rebuilt.
   * @param {Scene} scene
   */
  attach(scene) {
    this.scene = scene;
    if (this.#frusta) this.#frusta.scene = scene;
    scene.session.watchers.add(() => this.#frame());
    this.#leave();
  }

  /** @param {boolean} isOn */
  async turn(isOn) {
    this.#isOn = isOn;
    try {
      if (isOn) {
        this.#reading ??= this.#list();
        await this.#reading;
      }
    } catch (error) {
      this.#reading = null;
      this.#isOn = false;
      if (this.#isHere) notice(t("photographsFailed", { why: why(error) }), 12000);
    }
    if (!this.#isHere) return;
    if (!this.#isOn) this.#leave();
    this.#show();
  }

  /** Read the report, and make the strip. */
  async #list() {
    const all = photographsOf(await this.#renewing(this.read));
    if (!this.#isHere) return;
    const canvas = Object.assign(document.createElement("canvas"), { className: "marks", ariaHidden: "true" });
    this.#frusta = new Frusta(canvas, this.scene, all);
    $("marks").before(canvas);
    const { photographsCredit: credit = "", photographsRights: rights = "" } = document.body.dataset;
    this.#strip = new Strip(all, [credit, rights].filter(Boolean).join(" · "), {
      open: (photo) => this.open(photo),
      point: (photo) => this.#mark(photo),
      close: () => this.#leave(),
      load: (isWhole) => this.#load(isWhole),
      blend: (share) => this.#blend(share),
      address: (path) => new URL(path, this.report).href,
    });
    this.#strip.attach($("hint"));
    this.#all = all;
  }

  /**
   * Fly to where a photograph was taken, and show it over the model.
   * @param {Photograph} photo
   */
  async open(photo) {
    if (!this.#isHere || this.#shown?.photo === photo) return;
    const { scene } = this;
    const share = this.#shown?.share ?? 1;
    this.#mark(null);
    if (scene.walk.on) scene.on.orbit(); // with the opening angle of before
    if (!this.#visit) this.#before = scene.flight.there.fieldOfView;
    this.#forget();
    peek();
    this.#shown = { photo, share, state: photo.path ? "loading" : "none" };
    this.#show();
    announce(photo.name);
    this.#size = sizeOf(scene);
    /** @type {{goal: Camera | null}} */
    const visit = { goal: null };
    this.#visit = visit;
    const flight = scene.goTo(this.#camera(photo), { isJump: true });
    visit.goal = scene.flight.goal;
    const isThere = await flight;
    if (this.#visit !== visit) return;
    // The person has taken the camera elsewhere.
    if (!isThere) return this.#leave({ moved: true });
    // From now on the eye stays where it is.
    visit.goal = null;
    scene.input.stays = true;
    this.#look = lookOf(scene);
    this.#frusta?.turn(false);
    scene.session.wake();
    if (photo.path) await this.#load(false);
  }

  /**
   * The camera that shows a photograph in what the strip leaves free.
   * @param {Photograph} photo
   */
  #camera(photo) {
    const { canvas, ratio } = this.scene.session;
    const { width, height } = canvas;
    return cameraAt(photo, { width, height, covered: ratio * (this.#strip?.covers(canvas) ?? 0) }, this.#distance(photo));
  }

  /**
   * How far what the camera turns about later lies before a photograph: the middle of the model, or less inside it. The viewer takes no camera that is farther
   * away from what it turns about.
   * @param {Photograph} photo
   */
  #distance({ position }) {
    const [a, b, c, u, v, w] = this.scene.viewer.bounds();
    const size = Math.hypot(u - a, v - b, w - c);
    const middle = [(a + u) / 2, (b + v) / 2, (c + w) / 2];
    const away = Math.hypot(...middle.map((m, k) => m - position[k])) - size / 4;
    return Math.max(0.05 * size, Math.min(20 * size, away));
  }

  /**
   * What `ask` answers; an error of it has the status of the answer as `cause`. Permission to read a closed model lasts for minutes and is renewed with the
   * pack: `ask` is called once more after that.
   * @template T
   * @param {() => T} ask
   * @returns {Promise<Awaited<T>>}
   */
  async #renewing(ask) {
    try {
      return await ask();
    } catch (error) {
      if (error.cause !== 401 || !this.current.pack) throw error;
      await this.current.pack.range(0, 1, undefined, { fresh: true });
      return await ask();
    }
  }

  /** @param {boolean} isWhole all pixels, instead of those of the preview */
  async #load(isWhole) {
    const { photo, state: before } = this.#shown ?? {};
    if (!photo?.path) return;
    this.#loading?.abort();
    this.#loading = new AbortController();
    const { signal } = this.#loading;
    this.#state("loading");
    const address = new URL((!isWhole && photo.preview) || photo.path, this.report);
    try {
      const blob = await this.#renewing(async () => {
        const response = await fetch(address, { credentials: "same-origin", signal });
        if (!response.ok) throw new Error(`${address.pathname}: ${response.status}`, { cause: response.status });
        return response.blob();
      });
      // Calibrations do not turn a photograph as its EXIF data say.
      const picture = await createImageBitmap(blob, { imageOrientation: "none" });
      if (signal.aborted) return picture.close();
      this.#overlay ??= new Overlay(photo.camera);
      await this.#overlay.set(picture);
      if (signal.aborted) return;
      $("marks").before(this.#overlay.canvas);
      this.#state(isWhole || !photo.preview ? "whole" : "preview");
      this.#blend(this.#shown?.share ?? 1);
      this.#frame();
    } catch (error) {
      if (signal.aborted) return;
      this.#state(this.#overlay?.canvas.isConnected && before ? before : "failed");
      notice(t("photographFailed", { why: why(error) }), 12000);
    }
  }

  /** @param {Shown["state"]} state */
  #state(state) {
    if (!this.#shown) return;
    this.#shown = { ...this.#shown, state };
    this.#show();
  }

  /** @param {number} share */
  #blend(share) {
    if (this.#shown) this.#shown = { ...this.#shown, share };
    if (this.#overlay) this.#overlay.canvas.style.opacity = String(share);
  }

  #frame() {
    if (!this.#isHere) return;
    this.#frusta?.frame();
    const { input, session, viewer } = this.scene;
    if (!this.#shown || !input.stays) return;
    const { photo } = this.#shown;
    const { width, height } = session.canvas;
    const camera = viewer.camera();
    if (sizeOf(this.scene) !== this.#size) {
      // The picture has another size, and the viewer has moved the eye so that it shows the same part of the model.
      this.#size = sizeOf(this.scene);
      const isAsPut = lookOf(this.scene) === this.#look;
      viewer.setCamera(isAsPut ? this.#camera(photo) : { ...camera, target: ahead(photo, camera) });
      if (isAsPut) this.#look = lookOf(this.scene);
      session.wake();
      return;
    }
    const [a, b, c, u, v, w] = viewer.bounds();
    const eye = viewer.eye();
    const moved = Math.hypot(...photo.position.map((p, k) => p - eye[k]));
    if (moved > SAME_PLACE * (Math.hypot(u - a, v - b, w - c) + camera.distance) || camera.orthographic || this.scene.walk.on)
      return this.#leave({ moved: true });
    this.#opening = camera.fieldOfView;
    const axes = seenFrom(axesOfCamera(camera), photo.axes);
    this.#overlay?.draw(axes, { width, height, tangent: Math.tan(camera.fieldOfView / 2) });
  }

  /**
   * The photograph goes, and with it the opening angle and the roll that the camera had for it.
   * @param {{moved?: boolean}} how `moved`: the eye is elsewhere already, or on its way; otherwise it stays
   */
  #leave({ moved = false } = {}) {
    const visit = this.#visit;
    if (!this.#shown || !visit) return;
    const { scene } = this;
    const opening = scene.input.stays ? this.#opening : null;
    this.#visit = null;
    this.#forget();
    this.#shown = null;
    this.#show();
    if (!scene.isOpen || scene.walk.on) return;
    const { flight, input, viewer } = scene;
    const usual = (/** @type {Camera} */ camera) => {
      const { distance, fieldOfView } = camera;
      // Where the eye is elsewhere, the model keeps its size in the picture.
      const nearer = moved ? Math.tan(fieldOfView / 2) / Math.tan(this.#before / 2) : 1;
      return { ...camera, distance: distance * nearer, roll: input.isFree ? camera.roll : 0, fieldOfView: this.#before };
    };
    const goal = flight.goal;
    if (goal && goal !== visit.goal) {
      // On its way to something else, which may have an opening angle of its own.
      if (opening === null || Math.abs(goal.fieldOfView - opening) < 1e-9) Object.assign(goal, usual(goal));
      return;
    }
    flight.stop();
    const camera = viewer.camera();
    const isOther = moved && opening !== null && Math.abs(camera.fieldOfView - opening) > 1e-9;
    if (!isOther) flight.to(usual(camera), { mark: false, ease: input.pointers.size === 0 });
  }

  #forget() {
    this.#loading?.abort();
    this.#overlay?.close();
    this.#overlay = null;
    this.scene.input.stays = false;
    this.#frusta?.turn(this.#isOn);
  }

  // Pointing at the cameras.

  /** @param {PointerEvent | MouseEvent} event */
  #under(event) {
    const { input, session } = this.scene;
    if (!this.#isHere || !this.#isOn || input.stays || !["orbit", "pan"].includes(input.tool)) return null;
    const [x, y] = input.at(event);
    const isTouch = "pointerType" in event && event.pointerType === "touch";
    return this.#frusta?.at(x, y, (isTouch ? REACH_TOUCH : REACH) * session.ratio) ?? null;
  }

  /** @param {PointerEvent} event */
  #point(event) {
    if (event.buttons === 0) this.#mark(this.#under(event));
  }

  /** @param {Photograph | null} photo */
  #mark(photo) {
    if (!this.#frusta || this.#frusta.pointed === photo) return;
    this.#frusta.pointed = photo;
    this.#frusta.paint();
    $("canvas").classList.toggle("points", photo !== null);
  }

  /** @param {MouseEvent} event */
  #click(event) {
    if (Math.hypot(event.clientX - this.#press.x, event.clientY - this.#press.y) > SLACK) return;
    const photo = this.#under(event);
    if (photo) this.open(photo);
  }

  /** @param {KeyboardEvent} event */
  #key(event) {
    const target = /** @type {Element} */ (event.target);
    if (event.key !== "Escape" || !this.#shown || event.defaultPrevented || target.closest?.("dialog, [role=menu]")) return;
    event.preventDefault();
    this.#leave();
  }

  #show() {
    const turn = async (/** @type {Event} */ event) => {
      const box = /** @type {HTMLInputElement} */ (event.target);
      await this.turn(box.checked);
      box.checked = this.#isOn; // also where the report could not be read
    };
    const { photographsCredit: credit, photographsRights: rights, photographsRightsUri: uri } = document.body.dataset;
    const count = this.#all && this.#isOn ? html`<p class="quiet">${t("photographsCount", { count: this.#all.length })}</p>` : nothing;
    const link = rights ? html`<a href=${uri ?? nothing} target="_blank" rel="noopener license">${rights}</a>` : nothing;
    const whose = credit || rights ? html`<p class="quiet"><bdi>${credit}</bdi> ${link}</p>` : nothing;
    show(
      html`<legend>${t("photographs")}</legend><label class="choice"><input type="checkbox" .checked=${this.#isOn} @change=${turn}><span>${t("photographsShow")}</span></label>${count}${whose}`,
      this.#panel,
    );
    this.#strip?.show(this.#isOn, this.#shown);
    this.#frusta?.turn(this.#isOn && !this.scene.input.stays);
  }
}

/** @param {Scene} scene */
const sizeOf = ({ session: { canvas } }) => `${canvas.width} ${canvas.height}`;

/** Where the camera looks, wherever it stands. @param {Scene} scene */
function lookOf({ viewer }) {
  const { azimuth, elevation, roll, fieldOfView } = viewer.camera();
  return [azimuth, elevation, roll, fieldOfView].map((v) => v.toFixed(6)).join();
}

/**
 * What the camera turns about, so that the eye stands where a photograph was taken.
 * @param {Photograph} photo
 * @param {Camera} camera
 */
function ahead({ position }, camera) {
  const { forward } = axesOfCamera(camera);
  return plus(position, /** @type {[number, number, number]} */ (forward.map((v) => v * camera.distance)));
}

/**
 * Offer the photographs of the model that is open.
 * @param {Current} current
 * @param {{report: string, pack: string | URL, read: () => unknown}} where the address of the colour report, relative to the pack; reads it as JSON
 */
export async function offer(current, { report, pack, read }) {
  const { scene } = current;
  try {
    await Promise.all([partMessages("photographs"), partStyles("photographs.css")]);
    if (!scene?.isOpen || current.scene !== scene) return;
    current.photographs?.close();
    const photographs = new Photographs(current, scene, new URL(report, new URL(pack, location.href)), read);
    current.photographs = photographs;
    await photographs.turn(false);
  } catch (error) {
    notice(why(error), 12000);
  }
}

export { Photographs };
