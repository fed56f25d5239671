// The Display panel: shadings with their controls, legend, background. All of it is one state of the viewer
// (`displayState()`, viewer/src/display.rs), which leaves out what is as usual; the Section panel (section.js) changes the same state.

import { notice } from "./chrome.js";
import { $ } from "./dom.js";
import * as format from "./format.js";
import { apply, t } from "./i18n.js";
import { AXES, axisName, moved, planeOfPoints, position, reach, short, towardsEye } from "./planes.js";
import { SHADINGS } from "./shadings.js";

/** @import { Ids, IdsOf } from "./types/ids.js" */
/** @import { DisplayState, Legend, Viewer } from "./types/page.js" */
/** @import { Model } from "./model.js" */
/** @import { Scene } from "./scene.js" */

const USUAL = { light: { azimuth: 315, elevation: 20 }, shading: 0.35, strength: 0.5, radius: 3, background: "auto" };
const SLIDERS = /** @type {const} */ (["shading", "strength", "radius"]);
const percent = (/** @type {number} */ share) => `${format.count(Math.round(share * 100))} %`;

export class Display {
  /**
   * @param {object} parts
   * @param {() => void} parts.onChange the state changed
   * @param {(use: (points: number[][]) => void) => void} parts.pickPoints let the person choose three places
   */
  constructor({ onChange, pickPoints }) {
    this.onChange = onChange;
    this.pickPoints = pickPoints;
    /** @type {Scene | null} */
    this.scene = null;
    this.usualMode = "";
    this.#listen();
  }

  /** The viewer in force: what changes the display can be used only while there is one. */
  get viewer() {
    if (!this.scene) throw new Error("the model is not open");
    return this.scene.viewer;
  }

  /**
   * A viewer is there (again).
   * @param {Scene} scene
   * @param {Model} model
   */
  attach(scene, model) {
    this.scene = scene;
    const { viewer } = scene;
    const { info } = model;
    const names = model.module.Viewer.modes().filter((m) => (m !== "colour" || info.pack.colors) && (m !== "scalar" || info.pack.scalars > 0));
    $("modes").replaceChildren(...names.map((name) => choice(name)));
    apply($("modes"));
    for (const row of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[data-colours]"))) row.hidden = !info.pack.colors;
    /** @type {Legend} */
    const { channels } = JSON.parse(viewer.legend());
    $("filled-row").hidden = !channels.some((c) => /^(scalar_)?filled$/.test(c.name));
    $("channel").replaceChildren(...channels.map((c) => new Option(c.name, c.name)));
    this.usualMode = model.usualMode ??= names[0];
    viewer.setMode(this.usualMode);
  }

  /** @returns {DisplayState} */
  get state() {
    return JSON.parse(this.viewer.displayState());
  }

  /** Shading, light and section as links, saved views and notes hold them; null where nothing was chosen. @returns {DisplayState | null} */
  get chosen() {
    const { mode: _, ...rest } = this.state;
    const mode = this.viewer.mode();
    const chosen = mode === this.usualMode ? rest : { mode, ...rest };
    return Object.keys(chosen).length > 0 ? chosen : null;
  }

  /**
   * Show what a link, a saved view or a note holds: what it leaves out is as usual.
   * @param {DisplayState | null} chosen
   */
  show(chosen) {
    if (this.scene?.isOpen) this.#set({ mode: this.usualMode, ...chosen });
  }

  /**
   * Change a part; `undefined` makes it usual again.
   * @param {DisplayState} patch
   */
  change(patch) {
    if (this.scene?.isOpen) this.#set({ ...this.state, ...patch });
  }

  /** @param {DisplayState} next */
  #set(next) {
    try {
      this.viewer.setDisplayState(JSON.stringify(next));
    } catch (error) {
      notice(t("displayFailed", { why: error.message }), 10000);
    }
    this.onChange();
    this.scene?.session.wake();
  }

  /** The preference of the system. */
  settle() {
    if (!this.scene?.isOpen) return;
    const { viewer, session } = this.scene;
    viewer.setDark(matchMedia("(prefers-color-scheme: dark)").matches);
    viewer.setReducedMotion(matchMedia("(prefers-reduced-motion: reduce)").matches);
    viewer.setPixelRatio(session.ratio);
    this.refresh();
  }

  /** Show what is in force. */
  refresh() {
    if (!this.scene?.isOpen) return;
    const { state } = this;
    const mode = this.viewer.mode();
    const chosen = /** @type {HTMLInputElement | null} */ (document.querySelector(`input[name=mode][value="${CSS.escape(mode)}"]`));
    if (chosen && !chosen.checked) {
      chosen.checked = true;
      chosen.parentElement?.scrollIntoView({ block: "nearest", inline: "nearest" });
    }
    for (const part of /** @type {NodeListOf<HTMLElement>} */ ($("look").querySelectorAll("[data-modes]")))
      part.hidden = !part.dataset.modes?.split(" ").includes(mode);
    const light = { ...USUAL.light, ...state.light };
    put("azimuth", short(light.azimuth));
    put("elevation", short(light.elevation));
    $("light-with-view").checked = light.withView ?? false;
    this.#disc(light);
    $("on-colour").checked = state.onColour ?? false;
    for (const name of SLIDERS) $(name).value = String(state[name] ?? USUAL[name]);
    $("shading-value").textContent = percent(state.shading ?? USUAL.shading);
    $("strength-value").textContent = percent(state.strength ?? USUAL.strength);
    $("radius-value").textContent = t("pixels", { n: format.pixels(state.radius ?? USUAL.radius) });
    $("mark-inside").checked = state.backFaces ?? true;
    $("inside-help").hidden = !$("mark-inside").checked;
    $("background").value = [...$("background").options].some((o) => o.value === state.background) ? String(state.background) : USUAL.background;
    document.body.classList.toggle("clear", state.background === "transparent");
    $("filled").checked = !state.hideFilled;
    $("fade").checked = state.fade ?? !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.#legend(state, mode);
  }

  /**
   * @param {DisplayState} state
   * @param {string} mode
   */
  #legend(state, mode) {
    /** @type {Legend} */
    const legend = JSON.parse(this.viewer.legend());
    put("feature", short(legend.feature));
    $("scale-legend").hidden = !legend.scale;
    const [low, high] = /** @type {typeof Viewer} */ (this.viewer.constructor).errorScale();
    $("error-low").textContent = `≤ ${format.round(low)}`;
    $("error-high").textContent = `≥ ${format.round(high)}`;
    if (!legend.scale) return;
    const stops = legend.stops.map((c) => `rgb(${c.join(" ")})`);
    $("scale-ramp").style.backgroundImage = `linear-gradient(to right, ${stops.join(", ")})`;
    for (const [id, value] of /** @type {const} */ ([
      ["scale-low", legend.low],
      ["scale-high", legend.high],
    ]))
      put(id, Number(value.toPrecision(6)));
    const unit = legend.unit ? `, ${legend.unit}` : "";
    $("scale-low-name").textContent = `${t("legendLow")}${unit}`;
    $("scale-high-name").textContent = `${t("legendHigh")}${unit}`;
    $("no-value").hidden = mode !== "scalar";
    $("channel-row").hidden = mode !== "scalar";
    if (legend.channel) $("channel").value = legend.channel;
    const { normal } = legend.plane;
    $("plane-axis").value = state.plane ? axisName(normal) : "up";
    put("plane-offset", short(position(legend.plane, this.viewer)));
  }

  /** @param {{azimuth: number, elevation: number}} light */
  #disc({ azimuth, elevation }) {
    const r = 40 * (1 - Math.abs(elevation) / 90);
    const a = (azimuth * Math.PI) / 180;
    $("light-ray").setAttribute("d", `M0 0L${(r * Math.sin(a)).toFixed(2)} ${(-r * Math.cos(a)).toFixed(2)}`);
    $("light-handle").setAttribute("transform", `translate(${(r * Math.sin(a)).toFixed(2)} ${(-r * Math.cos(a)).toFixed(2)})`);
    $("light-disc").setAttribute("aria-valuenow", String(Math.round(azimuth)));
    $("light-disc").setAttribute(
      "aria-valuetext",
      t("lightValue", { azimuth: format.count(Math.round(azimuth)), elevation: format.count(Math.round(elevation)) }),
    );
  }

  /** @param {Partial<NonNullable<DisplayState["light"]>>} patch */
  #light(patch) {
    const light = { ...USUAL.light, ...this.state.light, ...patch };
    light.azimuth = short(((light.azimuth % 360) + 360) % 360);
    light.elevation = short(Math.max(-90, Math.min(90, light.elevation)));
    this.change({ light });
  }

  #listen() {
    on("modes", "change", (_, event) => {
      // Height and distance count from different planes: a range of one means nothing for the other.
      this.change({ mode: /** @type {HTMLInputElement} */ (event.target).value, range: undefined });
    });
    number("azimuth", (azimuth) => this.#light({ azimuth }));
    number("elevation", (elevation) => this.#light({ elevation }));
    on("light-with-view", "change", (field) => this.#light({ withView: field.checked }));
    on("on-colour", "change", (field) => this.change({ onColour: field.checked }));
    for (const name of SLIDERS) on(name, "input", (field) => this.change({ [name]: Number(field.value) }));
    number("feature", (feature) => feature > 0 && this.change({ feature }));
    for (const [id, at] of /** @type {const} */ ([
      ["scale-low", 0],
      ["scale-high", 1],
    ]))
      number(id, (value) => this.#range(at, value));
    on("scale-reset", "click", () => this.change({ range: undefined, channelRange: undefined }));
    on("channel", "change", (field) => this.change({ channel: field.value, channelRange: undefined }));
    on("plane-axis", "change", (field) => this.#plane(field.value));
    number("plane-offset", (value) => {
      const { plane } = JSON.parse(this.viewer.legend());
      this.change({ plane: moved(plane, value, this.viewer), range: undefined });
    });
    on("mark-inside", "change", (field) => this.change({ backFaces: field.checked }));
    on("filled", "change", (field) => this.change({ hideFilled: !field.checked }));
    on("background", "change", (field) => this.change({ background: field.value }));
    on("fade", "change", (field) => this.change({ fade: field.checked }));
    this.#listenDisc();
  }

  /**
   * @param {0 | 1} at
   * @param {number} value
   */
  #range(at, value) {
    /** @type {Legend} */
    const { low, high } = JSON.parse(this.viewer.legend());
    /** @type {[number, number]} */
    const range = [low, high];
    range[at] = value;
    if (!(range[0] < range[1])) this.refresh();
    else this.change(this.viewer.mode() === "scalar" ? { channelRange: range } : { range });
  }

  /** @param {string} axis */
  #plane(axis) {
    if (axis === "points") {
      this.pickPoints((points) => this.change({ plane: planeOfPoints(points, this.viewer) ?? undefined, range: undefined }));
      return;
    }
    if (axis === "up") {
      this.change({ plane: undefined, range: undefined });
      return;
    }
    const normal = AXES[axis] ?? towardsEye(this.viewer);
    const { center } = reach(this.viewer, normal);
    this.change({ plane: { normal, point: center.map(short) }, range: undefined });
  }

  #listenDisc() {
    const disc = $("light-disc");
    const drag = (/** @type {PointerEvent} */ event) => {
      const box = disc.getBoundingClientRect();
      const x = ((event.clientX - box.left) / box.width - 0.5) * 100;
      const y = ((event.clientY - box.top) / box.height - 0.5) * 100;
      const azimuth = (Math.atan2(x, -y) * 180) / Math.PI;
      this.#light({ azimuth: Math.round(azimuth), elevation: Math.round(90 * (1 - Math.min(1, Math.hypot(x, y) / 40))) });
    };
    disc.addEventListener("pointerdown", (event) => {
      disc.setPointerCapture(event.pointerId);
      drag(event);
    });
    disc.addEventListener("pointermove", (event) => disc.hasPointerCapture(event.pointerId) && drag(event));
    disc.addEventListener("keydown", (event) => {
      const { azimuth, elevation } = { ...USUAL.light, ...this.state.light };
      const step = event.shiftKey ? 15 : 3;
      /** @type {{azimuth: number} | {elevation: number} | undefined} */
      const patch = {
        ArrowLeft: { azimuth: azimuth - step },
        ArrowRight: { azimuth: azimuth + step },
        ArrowUp: { elevation: elevation + step },
        ArrowDown: { elevation: Math.max(0, elevation - step) },
      }[event.key];
      if (!patch) return;
      event.preventDefault();
      this.#light(patch);
    });
  }
}

/** @param {string} name */
function choice(name) {
  const label = document.createElement("label");
  label.className = "choice";
  const input = Object.assign(document.createElement("input"), { type: "radio", name: "mode", value: name });
  const text = document.createElement("span");
  text.dataset.text = SHADINGS[name] ?? name;
  label.append(input, text);
  return label;
}

/**
 * A number in its field, unless the person is typing there.
 * @param {IdsOf<HTMLInputElement>} id
 * @param {number} value
 */
export function put(id, value) {
  if (document.activeElement !== $(id)) $(id).value = String(value);
}

/**
 * Listen to an element, which the listener is given.
 * @template {keyof Ids} K
 * @param {K} id
 * @param {"change" | "click" | "input"} type
 * @param {(element: Ids[K], event: Event) => void} action
 */
export function on(id, type, action) {
  const element = $(id);
  element.addEventListener(type, (/** @type {Event} */ event) => action(element, event));
}

/**
 * A number field: any other text is left until it is a number.
 * @param {IdsOf<HTMLInputElement>} id
 * @param {(value: number) => void} use
 */
export function number(id, use) {
  on(id, "input", (field) => {
    const text = /** @type {HTMLInputElement} */ (field).value.trim();
    const value = text === "" ? NaN : Number(text);
    if (Number.isFinite(value)) use(value);
  });
}
