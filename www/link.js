// The address of the page holds what is seen: after the `#`, joined by `&`,
//
//   view=      the camera: 7 to 9 numbers (Viewer.camera())
//   display=   shading, light and section, as `displayState()` of the viewer gives them; left out where nothing was chosen
//   notes=off  pins are hidden
//   annotation=ID  the note that is open
//   measurements=  measurements that are shown (measure/address.js)
//   pack=      the first 12 digits of the pack's identity, so that a link to another model is noticed; of the header's hash in links of earlier versions
//
// A gradual change (a drag) replaces the address; a deliberate jump (a standard view, a saved view, a note)
// adds one to the browser's history, so that its Back button returns to the last view.

import { DEFAULTS } from "./camera.js";
import { DIGITS } from "./identity.js";

/** @import { PageState } from "./types/page.js" */

const LONGEST = 20_000;

/** What an address can hold: the camera always. @typedef {{camera: ArrayLike<number> & Iterable<number>, display: object | null, notes?: boolean, annotation: string | null, measurements: string | null, pack: string | null}} Linked */

/**
 * @param {string} hash
 * @returns {PageState}
 */
export function readState(hash) {
  /** @type {PageState} */
  const state = { camera: null, display: null, notes: true, annotation: null, measurements: null, pack: null };
  if (hash.length > LONGEST) return state;
  for (const part of hash.replace(/^#/, "").split("&")) {
    const [name, value] = [part.slice(0, part.indexOf("=")), part.slice(part.indexOf("=") + 1)];
    if (name === "view") state.camera = readCamera(value);
    else if (name === "display") state.display = decoded(value, (text) => JSON.parse(text));
    else if (name === "notes") state.notes = value !== "off";
    else if (name === "annotation") state.annotation = decoded(value, (text) => text);
    else if (name === "measurements") state.measurements = value || null;
    else if (name === "pack" && /^[0-9a-f]{12,64}$/.test(value)) state.pack = value;
  }
  return state;
}

/**
 * Seven to nine finite numbers, or null.
 * @param {string} text
 */
export function readCamera(text) {
  const numbers = text.split(",").map((n) => (n.trim() === "" ? NaN : Number(n)));
  return numbers.length >= 7 && numbers.length <= 9 && numbers.every(Number.isFinite) ? numbers : null;
}

/**
 * @template T
 * @param {string} value
 * @param {(text: string) => T} read
 */
function decoded(value, read) {
  try {
    return read(decodeURIComponent(value));
  } catch {
    return null; // Cut off or changed on its way: the rest of the address still counts.
  }
}

/**
 * The part of an address behind the `#`.
 * @param {Linked} state
 */
export function writeState({ camera, display, notes = true, annotation, measurements, pack }) {
  const short = [...camera].map((v) => Number(v.toPrecision(9)));
  while (short.length > 7 && Math.abs(short[short.length - 1] - DEFAULTS[short.length - 8]) < 1e-6) short.pop();
  const parts = [`view=${short.join(",")}`];
  if (display && Object.keys(display).length > 0) parts.push(`display=${encodeURIComponent(JSON.stringify(display))}`);
  if (!notes) parts.push("notes=off");
  if (annotation) parts.push(`annotation=${encodeURIComponent(annotation)}`);
  if (measurements) parts.push(`measurements=${measurements}`);
  if (pack) parts.push(`pack=${pack.slice(0, DIGITS)}`);
  return `#${parts.join("&")}`;
}

/** How long the camera rests before the address is brought up to date, milliseconds. */
const REST_MS = 400;
/**
 * Safari allows 100 changes of the address in ten seconds (earlier versions in thirty), Chromium 200: so many are made in
 * half a minute at most, whatever the reason.
 */
const ALLOWED = { changes: 80, ms: 30_000 };

/** Keeps the address at the view. */
export class Address {
  /** When it was changed lately, milliseconds. @type {number[]} */
  #changes = [];
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #timer;

  /**
   * @param {() => Linked | null} state what `writeState` takes, or null while there is nothing to hold
   * @param {(state: ReturnType<typeof readState>) => void} restore called when the person goes back or forward
   * @param {() => boolean} isMoving whether the camera is being moved: where a frame takes long, there is time to rest between two of them
   */
  constructor(state, restore, isMoving) {
    this.state = state;
    this.isMoving = isMoving;
    // A link followed inside the page (#annotation=…) and the Back button both end here.
    addEventListener("popstate", () => {
      clearTimeout(this.#timer);
      restore(readState(location.hash));
    });
  }

  /** Soon, once the camera rests. */
  later(ms = REST_MS) {
    clearTimeout(this.#timer);
    this.#timer = setTimeout(() => {
      if (this.isMoving()) this.later();
      else this.now();
    }, ms);
  }

  now() {
    clearTimeout(this.#timer);
    this.#change("replaceState");
  }

  /** Before a jump: the view that is left keeps an entry of its own. */
  leave() {
    this.now();
    this.#change("pushState");
  }

  /** @param {"replaceState" | "pushState"} how */
  #change(how) {
    const state = this.state();
    if (!state) return;
    const hash = writeState(state);
    if (how === "replaceState" && hash === location.hash) return;
    const now = performance.now();
    this.#changes = this.#changes.filter((at) => now - at < ALLOWED.ms);
    if (this.#changes.length >= ALLOWED.changes) {
      this.later(this.#changes[0] + ALLOWED.ms - now);
      return;
    }
    this.#changes.push(now);
    try {
      history[how](null, "", `${location.pathname}${location.search}${hash}`);
    } catch (error) {
      // Another limit than those above, or other scripts of the page have used it up.
      if (error.name !== "SecurityError") throw error;
      this.later(ALLOWED.ms);
    }
  }
}
