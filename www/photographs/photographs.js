// The photographs that a model was coloured from (`kilwa publish --colour-report --photos`): where they were taken, drawn over the model; a strip of them;
// and one at a time over the picture of its own view. Loaded only where the host names a colour report (`?photographs=`, `data-photographs`); the messages
// are in a file of their own.

import { html, nothing } from "lit-html";
import { announce, notice, peek } from "../chrome.js";
import { $ } from "../dom.js";
import { add, onChange, t } from "../i18n.js";
import { why } from "../messages.js";
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

/** The messages of the page's language. @returns {Promise<void>} */
async function words() {
  const { lang } = document.documentElement;
  const messages = await (await fetch(`i18n/photographs-${lang}.json`)).json();
  if (lang !== document.documentElement.lang) return words();
  add(messages);
}

/** The sheet of what is only here. @returns {Promise<void>} */
function styles() {
  if (document.querySelector("link[href$='photographs.css']")) return Promise.resolve();
  const link = Object.assign(document.createElement("link"), { rel: "stylesheet", href: "photographs.css" });
  return new Promise((resolve) => {
    link.onload = link.onerror = () => resolve();
    document.head.append(link);
  });
}

/** A canvas over the picture. */
function layer() {
  const canvas = Object.assign(document.createElement("canvas"), { className: "marks", ariaHidden: "true" });
  $("marks").before(canvas);
  return canvas;
}

class Photographs {
  /** @type {Photograph[] | null} */
  #all = null;
  #isOn = false;
  /** @type {Frusta | null} */
  #frusta = null;
  /** @type {Strip | null} */
  #strip = null;
  /** @type {Shown | null} */
  #shown = null;
  /** @type {Overlay | null} */
  #overlay = null;
  #panel = Object.assign(document.createElement("fieldset"), { id: "photographs" });
  #abort = new AbortController();
  /** @type {AbortController | null} */
  #loading = null;
  /** The size of the picture that the camera was put for, and where it looked then. */
  #size = "";
  #look = "";
  /** The opening angle before a photograph was opened. */
  #opening = 0.7;
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
    onChange(() => this.#isHere && words().then(() => this.#show()));
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
    if (this.#shown) this.#leave();
  }

  /** @param {boolean} isOn */
  async turn(isOn) {
    try {
      if (isOn && !this.#all) {
        this.#all = photographsOf(await this.read());
        this.#frusta = new Frusta(layer(), this.scene, this.#all);
        const { photographsCredit: credit = "", photographsRights: rights = "" } = document.body.dataset;
        this.#strip = new Strip(this.#all, [credit, rights].filter(Boolean).join(" · "), {
          open: (photo) => this.open(photo),
          point: (photo) => this.#mark(photo),
          close: () => this.#leave(),
          whole: () => this.#load(true),
          blend: (share) => this.#blend(share),
          address: (path) => new URL(path, this.report).href,
        });
        this.#strip.attach($("hint"));
      }
      this.#isOn = isOn;
      if (!isOn) this.#leave();
    } catch (error) {
      notice(t("photographsFailed", { why: why(error) }), 12000);
    }
    this.#show();
  }

  /**
   * Fly to where a photograph was taken, and show it over the model.
   * @param {Photograph} photo
   */
  async open(photo) {
    if (!this.#isHere || this.#shown?.photo === photo) return;
    const { scene } = this;
    const share = this.#shown?.share ?? 1;
    if (!this.#shown) this.#opening = scene.viewer.camera().fieldOfView;
    this.#forget();
    peek();
    this.#shown = { photo, share, state: photo.path ? "loading" : "none" };
    this.#show();
    announce(photo.name);
    this.#size = sizeOf(scene);
    const isThere = await scene.goTo(this.#camera(photo), { isJump: true });
    if (this.#shown?.photo !== photo) return;
    // The person has taken the camera elsewhere.
    if (!isThere) return this.#leave();
    // From now on the eye stays where it is.
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
   * How far what the camera turns about later lies before a photograph: the middle of the model, or less inside it.
   * @param {Photograph} photo
   */
  #distance({ position }) {
    const [a, b, c, u, v, w] = this.scene.viewer.bounds();
    const size = Math.hypot(u - a, v - b, w - c);
    const middle = [(a + u) / 2, (b + v) / 2, (c + w) / 2];
    return Math.max(0.05 * size, Math.hypot(...middle.map((m, k) => m - position[k])) - size / 4);
  }

  /** @param {boolean} isWhole all pixels, instead of those of the preview */
  async #load(isWhole) {
    const { photo } = this.#shown ?? {};
    if (!photo?.path) return;
    this.#loading?.abort();
    this.#loading = new AbortController();
    const { signal } = this.#loading;
    this.#state("loading");
    try {
      const response = await fetch(new URL((!isWhole && photo.preview) || photo.path, this.report), { credentials: "same-origin", signal });
      if (!response.ok) throw new Error(String(response.status));
      const overlay = this.#overlay ?? new Overlay(layer(), photo.camera);
      this.#overlay = overlay;
      // Calibrations do not turn a photograph as its EXIF data say.
      const picture = await bitmap(await response.blob(), overlay.sideMax);
      if (signal.aborted) return picture.close();
      overlay.set(picture);
      picture.close();
      this.#state(isWhole || !photo.preview ? "whole" : "preview");
      this.#blend(this.#shown?.share ?? 1);
      this.#frame();
    } catch (error) {
      if (signal.aborted) return;
      this.#state(this.#overlay ? "preview" : "none");
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
    if (moved > SAME_PLACE * (Math.hypot(u - a, v - b, w - c) + camera.distance) || camera.orthographic || this.scene.walk.on) return this.#leave();
    const axes = seenFrom(axesOfCamera(camera), photo.axes);
    this.#overlay?.draw(axes, { width, height, tangent: Math.tan(camera.fieldOfView / 2) });
  }

  /** The photograph goes; the eye may move again. */
  #leave() {
    if (!this.#shown) return;
    const { scene } = this;
    const stood = scene.input.stays;
    this.#forget();
    this.#shown = null;
    this.#show();
    if (!stood || !scene.isOpen || scene.walk.on) return;
    // The opening angle of before and an upright picture; the eye stays.
    const camera = scene.viewer.camera();
    const { isFree, pointers } = scene.input;
    const ease = pointers.size === 0;
    scene.flight.to({ ...camera, roll: isFree ? camera.roll : 0, fieldOfView: this.#opening }, { mark: false, ease });
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
 * The pixels of a photograph as they are stored, fewer where the graphics card takes fewer.
 * @param {Blob} blob
 * @param {number} sideMax
 */
async function bitmap(blob, sideMax) {
  const picture = await createImageBitmap(blob, { imageOrientation: "none" });
  const longest = Math.max(picture.width, picture.height);
  if (longest <= sideMax) return picture;
  const share = sideMax / longest;
  const [resizeWidth, resizeHeight] = [picture.width, picture.height].map((side) => Math.max(1, Math.floor(side * share)));
  const smaller = await createImageBitmap(picture, { resizeWidth, resizeHeight, resizeQuality: "high" });
  picture.close();
  return smaller;
}

/**
 * Offer the photographs of the model that is open.
 * @param {Current} current
 * @param {URL} report the address of the colour report
 * @param {() => unknown} read the report as JSON
 */
export async function offer(current, report, read) {
  const { scene } = current;
  try {
    await Promise.all([words(), styles()]);
    if (!scene?.isOpen || current.scene !== scene) return;
    current.photographs?.close();
    const photographs = new Photographs(current, scene, report, read);
    current.photographs = photographs;
    await photographs.turn(false);
  } catch (error) {
    notice(why(error), 12000);
  }
}

export { Photographs };
