// The Display panel: shadings with their controls, legend, background. All of it is one state of the viewer
// (`displayState()`, viewer/src/display.rs), which leaves out what is as usual; the Section panel (section.js) changes the same state.

import { notice } from "./chrome.js";
import * as format from "./format.js";
import { apply, t } from "./i18n.js";

const $ = (id) => document.getElementById(id);
const MODE_NAMES = {
  colour: "modeColor",
  clay: "modeClay",
  headlight: "modeHeadlight",
  raking: "modeRaking",
  curvature: "modeCurvature",
  "eye-dome": "modeEyeDome",
  normals: "modeNormals",
  height: "modeHeight",
  distance: "modeDistance",
  scalar: "modeScalar",
  level: "modeLevels",
  error: "modeError",
};
const USUAL = { light: { azimuth: 315, elevation: 20 }, shading: 0.35, strength: 0.5, radius: 3, background: "auto" };
export const AXES = { up: [0, 0, 1], north: [0, 1, 0], east: [1, 0, 0] };

const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const sub = (a, b) => a.map((v, i) => v - b[i]);
/** Numbers for links: a tenth of a millimetre, a ten-thousandth of a direction. */
export const short = (v) => Number(v.toFixed(4));

/** From the model to the eye, a unit vector. */
export function towardsEye(viewer) {
  const [azimuth, elevation] = viewer.camera();
  return [Math.cos(elevation) * Math.sin(azimuth), Math.cos(elevation) * Math.cos(azimuth), Math.sin(elevation)].map(short);
}

/** The middle of the model, and how far it reaches along a direction: `[low, high]` of `normal · p`. */
export function reach(viewer, normal) {
  const [a, b, c, u, v, w] = viewer.bounds();
  const center = [(a + u) / 2, (b + v) / 2, (c + w) / 2];
  const half = (Math.abs(normal[0]) * (u - a) + Math.abs(normal[1]) * (v - b) + Math.abs(normal[2]) * (w - c)) / 2;
  return { center, low: dot(normal, center) - half, high: dot(normal, center) + half };
}

/** The plane through three places, its normal towards the eye; null where they lie on a line. */
export function planeOfPoints([a, b, c], viewer) {
  const n = cross(sub(b, a), sub(c, a));
  const length = Math.hypot(...n);
  if (!(length > 1e-12)) return null;
  const sign = dot(n, towardsEye(viewer)) < 0 ? -1 : 1;
  return { normal: n.map((v) => Number(((v * sign) / length).toFixed(6))), point: a.map(short) };
}

export class Display {
  /**
   * @param {object} parts
   * @param {(patch: object) => void} parts.onChange the state changed
   * @param {(use: (points: number[][]) => void) => void} parts.pickPoints let the person choose three places
   */
  constructor({ onChange, pickPoints }) {
    this.onChange = onChange;
    this.pickPoints = pickPoints;
    this.viewer = null;
    this.#listen();
  }

  /** A viewer is there. Returns the shading that is usual for this model. */
  attach(viewer, session, info) {
    Object.assign(this, { viewer, session, info });
    const names = viewer.constructor.modes().filter((m) => (m !== "colour" || info.pack.colors) && (m !== "scalar" || info.pack.scalars > 0));
    $("modes").replaceChildren(...names.map((name) => choice(name)));
    apply($("modes"));
    for (const row of document.querySelectorAll("[data-colours]")) row.hidden = !info.pack.colors;
    const { channels } = JSON.parse(viewer.legend());
    $("channel").replaceChildren(...channels.map((c) => new Option(c.name, c.name)));
    return names[0];
  }

  get state() {
    return JSON.parse(this.viewer.displayState());
  }

  /** Change a part; `undefined` makes it usual again. */
  change(patch) {
    if (!this.viewer || this.session.closed) return;
    const next = { ...this.state, ...patch };
    for (const key of Object.keys(next)) if (next[key] === undefined) delete next[key];
    try {
      this.viewer.setDisplayState(JSON.stringify(next));
    } catch (error) {
      notice(t("displayFailed", { why: error.message }), 10000);
    }
    this.onChange();
    this.session.wake();
  }

  /** What the system asks for. */
  settle() {
    if (!this.viewer || this.session.closed) return;
    this.viewer.setDark(matchMedia("(prefers-color-scheme: dark)").matches);
    this.viewer.setReducedMotion(matchMedia("(prefers-reduced-motion: reduce)").matches);
    this.viewer.setPixelRatio(this.session.ratio);
    this.refresh();
  }

  /** Show what is in force. */
  refresh() {
    if (!this.viewer || this.session.closed) return;
    const { state } = this;
    const mode = this.viewer.mode();
    const chosen = document.querySelector(`input[name=mode][value="${CSS.escape(mode)}"]`);
    if (chosen && !chosen.checked) {
      chosen.checked = true;
      chosen.parentElement.scrollIntoView({ block: "nearest", inline: "nearest" });
    }
    for (const part of $("look").querySelectorAll("[data-modes]")) part.hidden = !part.dataset.modes.split(" ").includes(mode);
    const light = { ...USUAL.light, ...state.light };
    put("azimuth", short(light.azimuth));
    put("elevation", short(light.elevation));
    $("light-with-view").checked = light.withView ?? false;
    this.#disc(light);
    $("on-colour").checked = state.onColour ?? false;
    for (const name of ["shading", "strength", "radius"]) $(name).value = state[name] ?? USUAL[name];
    $("shading-value").textContent = format.count(Math.round((state.shading ?? USUAL.shading) * 100)) + " %";
    $("strength-value").textContent = format.count(Math.round((state.strength ?? USUAL.strength) * 100)) + " %";
    $("radius-value").textContent = t("pixels", { n: format.pixels(state.radius ?? USUAL.radius) });
    $("mark-inside").checked = state.backFaces ?? true;
    $("inside-help").hidden = !$("mark-inside").checked;
    $("background").value = [...$("background").options].some((o) => o.value === state.background) ? state.background : USUAL.background;
    document.body.classList.toggle("clear", state.background === "transparent");
    $("fade").checked = state.fade ?? !matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.#legend(state, mode);
  }

  #legend(state, mode) {
    const legend = JSON.parse(this.viewer.legend());
    put("feature", short(legend.feature));
    $("scale-legend").hidden = !legend.scale;
    const [low, high] = this.viewer.constructor.errorScale();
    $("error-low").textContent = `≤ ${format.round(low)}`;
    $("error-high").textContent = `≥ ${format.round(high)}`;
    if (!legend.scale) return;
    const stops = legend.stops.map((c) => `rgb(${c.join(" ")})`);
    $("scale-ramp").style.backgroundImage = `linear-gradient(to right, ${stops.join(", ")})`;
    for (const [id, value] of [
      ["scale-low", legend.low],
      ["scale-high", legend.high],
    ])
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

  #light(patch) {
    const light = { ...USUAL.light, ...this.state.light, ...patch };
    light.azimuth = short(((light.azimuth % 360) + 360) % 360);
    light.elevation = short(Math.max(-90, Math.min(90, light.elevation)));
    this.change({ light });
  }

  #listen() {
    $("modes").addEventListener("change", (event) => {
      // Height and distance count from different planes: a range of one means nothing for the other.
      this.change({ mode: event.target.value, range: undefined });
    });
    number("azimuth", (azimuth) => this.#light({ azimuth }));
    number("elevation", (elevation) => this.#light({ elevation }));
    on("light-with-view", "change", (e) => this.#light({ withView: e.target.checked }));
    on("on-colour", "change", (e) => this.change({ onColour: e.target.checked }));
    for (const name of ["shading", "strength", "radius"]) on(name, "input", (e) => this.change({ [name]: Number(e.target.value) }));
    number("feature", (feature) => feature > 0 && this.change({ feature }));
    for (const [id, at] of [
      ["scale-low", 0],
      ["scale-high", 1],
    ])
      number(id, (value) => this.#range(at, value));
    on("scale-reset", "click", () => this.change({ range: undefined, channelRange: undefined }));
    on("channel", "change", (e) => this.change({ channel: e.target.value, channelRange: undefined }));
    on("plane-axis", "change", (e) => this.#plane(e.target.value));
    number("plane-offset", (value) => {
      const { plane } = JSON.parse(this.viewer.legend());
      this.change({ plane: moved(plane, value, this.viewer), range: undefined });
    });
    on("mark-inside", "change", (e) => this.change({ backFaces: e.target.checked }));
    on("background", "change", (e) => this.change({ background: e.target.value }));
    on("fade", "change", (e) => this.change({ fade: e.target.checked }));
    this.#listenDisc();
  }

  #range(at, value) {
    const { low, high } = JSON.parse(this.viewer.legend());
    const range = [low, high];
    range[at] = value;
    if (!(range[0] < range[1])) this.refresh();
    else this.change(this.viewer.mode() === "scalar" ? { channelRange: range } : { range });
  }

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
    const drag = (event) => {
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

function choice(name) {
  const label = document.createElement("label");
  label.className = "choice";
  const input = Object.assign(document.createElement("input"), { type: "radio", name: "mode", value: name });
  const text = document.createElement("span");
  text.dataset.text = MODE_NAMES[name] ?? name;
  label.append(input, text);
  return label;
}

/** The name of an axis that a plane looks along. */
export function axisName(normal) {
  const found = Object.entries(AXES).find(([, axis]) => Math.abs(Math.abs(dot(axis, normal)) - 1) < 1e-6);
  return found?.[0] ?? "other";
}

/** Where a plane lies along its normal: the coordinate for an axis, else metres from the middle of the model. */
export function position({ normal, point }, viewer) {
  const name = axisName(normal);
  if (name !== "other") return dot(AXES[name], point);
  return dot(normal, sub(point, reach(viewer, normal).center));
}

/** The plane at another position. */
export function moved({ normal, point }, value, viewer) {
  const name = axisName(normal);
  const by = value - position({ normal, point }, viewer);
  const along = name === "other" ? normal : AXES[name];
  return { normal, point: point.map((v, i) => short(v + along[i] * by)) };
}

/** A number in its field, unless the person is typing there. */
export function put(id, value) {
  if (document.activeElement !== $(id)) $(id).value = String(value);
}

export function on(id, type, action) {
  $(id).addEventListener(type, action);
}

/** A field of a number: what is no number is left until it is one. */
export function number(id, use) {
  $(id).addEventListener("input", (event) => {
    const value = event.target.value.trim() === "" ? NaN : Number(event.target.value);
    if (Number.isFinite(value)) use(value);
  });
}
