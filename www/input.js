// Mouse, pen, touch and keyboard on the canvas, turned into moves of the viewer. Pixels are those of the picture, y down.

import { $ } from "./dom.js";
import { WALK_KEYS } from "./walk.js";

/** @import { InputActions } from "./actions.js" */
/** @import { Tool } from "./types/page.js" */
/** @typedef {{x: number, y: number, pans: boolean, moved: number, button: number, aims: boolean}} Pointer */

/** A drag of the whole height of the canvas turns the model by this many radians. */
const TURN = Math.PI;
const KEY_TURN = Math.PI / 24;
const KEY_MOVE = 0.06;
const KEY_ZOOM = 0.8;
/** A press that moved by at most so many CSS pixels was a press and not a drag. */
const SLACK = 6;
/** CSS pixels that an arrow moves the crosshair by. */
const KEY_POINT = 6;

/** Tools that choose places on the surface. */
const PLACING = new Set(["note", "points", "measure"]);
/** Milliseconds that a finger rests before it aims instead of turning the model. */
const LONG_PRESS = 350;

/** @type {Record<string, string>} */
export const VIEW_KEYS = { 1: "plan", 2: "north", 3: "east", 4: "south", 5: "west", 6: "iso", 7: "below" };

export class Input {
  /**
   * @param {import("./session.js").Session} session
   * @param {InputActions} actions
   * @param {{flight: import("./flight.js").Flight, walk: import("./walk.js").Walk}} movers
   */
  constructor(session, actions, { flight, walk }) {
    this.session = session;
    this.viewer = session.viewer;
    this.canvas = session.canvas;
    this.actions = actions;
    this.flight = flight;
    this.walk = walk;
    /** @type {Tool} */
    this.tool = "orbit";
    this.isFree = false;
    /** Whether the eye stays where it is: drags look about, the wheel changes the opening angle. */
    this.stays = false;
    /** The crosshair, in pixels of the picture, while the keyboard points. @type {[number, number] | null} */
    this.point = null;
    /** @type {Map<number, Pointer>} */
    this.pointers = new Map();
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.press = undefined;
    this.lastTap = { time: 0, x: 0, y: 0 };
    this.abort = new AbortController();
    const listen = (/** @type {EventTarget} */ target, /** @type {string} */ type, /** @type {(event: any) => void} */ handler, options = {}) =>
      target.addEventListener(type, handler.bind(this), { signal: this.abort.signal, ...options });
    listen(this.canvas, "pointerdown", this.down);
    listen(this.canvas, "pointermove", this.move);
    listen(this.canvas, "pointerup", this.up);
    listen(this.canvas, "pointercancel", this.up);
    listen(this.canvas, "pointerleave", () => this.actions.leave());
    listen(this.canvas, "wheel", this.wheel, { passive: false });
    listen(this.canvas, "dblclick", this.doubleClick);
    listen(this.canvas, "contextmenu", (/** @type {Event} */ event) => event.preventDefault());
    listen(window, "keydown", this.key);
    listen(window, "keyup", this.keyUp);
  }

  close() {
    this.abort.abort();
  }

  /**
   * The pixel of the picture that an event is at.
   * @param {MouseEvent} event
   */
  at(event) {
    const box = this.canvas.getBoundingClientRect();
    return [(event.clientX - box.left) * this.session.ratio, (event.clientY - box.top) * this.session.ratio];
  }

  /** @param {PointerEvent} event */
  down(event) {
    if (event.pointerType === "mouse" && event.button > 2) return;
    // The middle button would scroll the page.
    if (event.button === 1) event.preventDefault();
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.classList.add("moving");
    this.flight.mark();
    this.flight.stop();
    this.showPoint(null);
    const [x, y] = this.at(event);
    const pans = event.button !== 0 || event.shiftKey || event.ctrlKey || event.metaKey || this.tool === "pan";
    this.endAim();
    this.pointers.set(event.pointerId, { x, y, pans, moved: 0, button: event.button, aims: false });
    this.actions.leave();
    if (event.pointerType === "touch" && this.pointers.size === 1 && PLACING.has(this.tool)) {
      this.press = setTimeout(() => this.aim(this.pointers.get(event.pointerId)), LONG_PRESS);
    }
  }

  /**
   * A finger that rested aims: it moves the place that will be chosen, and a loupe shows it.
   * @param {Pointer | undefined} pointer
   */
  aim(pointer) {
    if (!pointer || this.pointers.size !== 1 || pointer.moved > SLACK * this.session.ratio) return;
    pointer.aims = true;
    this.actions.aim([pointer.x, pointer.y]);
  }

  endAim() {
    clearTimeout(this.press);
    for (const pointer of this.pointers.values()) {
      if (pointer.aims) this.actions.aim(null);
      pointer.aims = false;
    }
  }

  /** @param {PointerEvent} event */
  move(event) {
    const [x, y] = this.at(event);
    const pointer = this.pointers.get(event.pointerId);
    if (!pointer) {
      if (event.pointerType !== "touch") this.actions.hover(x, y);
      return;
    }
    const before = [...this.pointers.values()].map((p) => ({ ...p }));
    pointer.moved += Math.hypot(x - pointer.x, y - pointer.y);
    const [dx, dy] = [x - pointer.x, y - pointer.y];
    pointer.x = x;
    pointer.y = y;
    if (pointer.aims) {
      this.actions.aim([x, y]);
    } else if (this.pointers.size === 1) {
      if (pointer.pans) this.viewer.pan(dx, dy);
      else this.turn(dx, dy);
    } else if (this.pointers.size === 2) {
      this.pinch(before, [...this.pointers.values()]);
    }
    this.session.wake();
  }

  /**
   * @param {number} dx
   * @param {number} dy
   */
  turn(dx, dy) {
    const scale = TURN / this.canvas.height;
    // The model follows the pointer: to the right means that the eye goes round to the left.
    if (this.walk.on || this.stays) {
      const { fieldOfView, roll } = this.viewer.camera();
      const reach = fieldOfView / this.canvas.height;
      const [sine, cosine] = [Math.sin(roll) * reach, Math.cos(roll) * reach];
      this.viewer.look(-dx * cosine - dy * sine, dx * sine - dy * cosine);
    } else if (this.isFree) {
      this.viewer.turnFree(dx * scale, dy * scale, 0);
    } else {
      this.viewer.orbit(dx * scale, dy * scale);
    }
  }

  /**
   * Two fingers: their middle moves the model, their distance zooms about it, their angle turns it.
   * @param {Pointer[]} before
   * @param {Pointer[]} after
   */
  pinch([a0, b0], [a1, b1]) {
    const middle = (/** @type {Pointer} */ a, /** @type {Pointer} */ b) => [(a.x + b.x) / 2, (a.y + b.y) / 2];
    const [from, to] = [middle(a0, b0), middle(a1, b1)];
    if (this.walk.on) {
      this.walk.roll((from[1] - to[1]) / this.canvas.height);
      this.turn(to[0] - from[0], 0);
      return;
    }
    if (this.stays) this.turn(to[0] - from[0], to[1] - from[1]);
    else this.viewer.pan(to[0] - from[0], to[1] - from[1]);
    const apart = (/** @type {Pointer} */ a, /** @type {Pointer} */ b) => Math.max(Math.hypot(a.x - b.x, a.y - b.y), 1);
    this.zoomAt(apart(a0, b0) / apart(a1, b1), to[0], to[1]);
    if (this.stays) return;
    const angle = (/** @type {Pointer} */ a, /** @type {Pointer} */ b) => Math.atan2(b.y - a.y, b.x - a.x);
    const twist = angle(a1, b1) - angle(a0, b0);
    const turned = Math.atan2(Math.sin(twist), Math.cos(twist));
    if (this.isFree) this.viewer.turnFree(0, 0, turned);
    else this.viewer.orbit(turned, 0);
  }

  /** @param {PointerEvent} event */
  up(event) {
    const pointer = this.pointers.get(event.pointerId);
    const aimed = pointer?.aims ?? false;
    this.endAim();
    this.pointers.delete(event.pointerId);
    if (this.pointers.size === 0) this.canvas.classList.remove("moving");
    const isClick = pointer && event.type === "pointerup" && (aimed || pointer.moved <= SLACK * this.session.ratio);
    if (isClick && PLACING.has(this.tool) && pointer.button === 0) this.actions.place(pointer.x, pointer.y, { snap: event.shiftKey });
    else if (isClick && event.pointerType === "touch") this.tap(event, pointer);
    this.session.wake();
  }

  /**
   * Two taps at one place are the double click of a finger.
   * @param {PointerEvent} event
   * @param {Pointer} pointer
   */
  tap(event, pointer) {
    const slack = SLACK * this.session.ratio;
    const last = this.lastTap;
    const isSecond = event.timeStamp - last.time < 350 && Math.hypot(pointer.x - last.x, pointer.y - last.y) < 3 * slack;
    this.lastTap = isSecond ? { time: 0, x: 0, y: 0 } : { time: event.timeStamp, x: pointer.x, y: pointer.y };
    if (isSecond) this.pivot(pointer.x, pointer.y);
    else this.actions.hover(pointer.x, pointer.y);
  }

  /** @param {MouseEvent} event */
  doubleClick(event) {
    event.preventDefault();
    const [x, y] = this.at(event);
    this.pivot(x, y);
  }

  /**
   * @param {number} x
   * @param {number} y
   */
  pivot(x, y) {
    if (PLACING.has(this.tool)) return;
    if (this.walk.on) {
      this.walk.standAt(x, y);
      return;
    }
    this.viewer.setPivot(x, y);
    this.session.wake();
  }

  /** @param {WheelEvent} event */
  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
    // A pinch on a trackpad comes as a wheel with Ctrl, in much smaller steps.
    const delta = Math.max(-240, Math.min(240, event.deltaY * lines)) * (event.ctrlKey ? 5 : 1);
    const [x, y] = this.at(event);
    this.flight.mark(true);
    this.flight.stop();
    if (this.walk.on) {
      this.walk.roll(-delta * 0.002);
      return;
    }
    this.zoomAt(Math.exp(delta * 0.0016), x, y);
    this.session.wake();
    this.actions.hover(x, y);
  }

  /**
   * Come nearer to what a pixel shows, or narrow the opening angle.
   * @param {number} factor
   * @param {number} x
   * @param {number} y
   */
  zoomAt(factor, x, y) {
    if (!this.stays) {
      this.viewer.zoom(factor, x, y);
      return;
    }
    const camera = this.viewer.camera();
    this.viewer.setCamera({ ...camera, fieldOfView: Math.max(0.02, Math.min(2.4, camera.fieldOfView * factor)) });
  }

  /**
   * Zoom about the middle, for buttons and keys; walking, a step.
   * @param {number} factor
   */
  zoom(factor) {
    this.flight.mark(true);
    this.flight.stop();
    if (this.walk.on) this.walk.step(factor < 1 ? "forward" : "back");
    else this.zoomAt(factor, this.canvas.width / 2, this.canvas.height / 2);
    this.session.wake();
  }

  /** @param {KeyboardEvent} event */
  key(event) {
    if (event.altKey || event.ctrlKey || event.metaKey || event.defaultPrevented) return;
    const target = /** @type {Element} */ (event.target);
    if (target.closest?.("input, select, textarea, dialog, [role=menu]")) return;
    const onCanvas = target === this.canvas || target === document.body;
    if ((onCanvas && this.placing(event)) || (onCanvas && this.walking(event)) || this.shortcut(event) || (onCanvas && this.arrow(event))) {
      event.preventDefault();
    }
  }

  /** @param {KeyboardEvent} event */
  keyUp(event) {
    this.walk.running = event.shiftKey;
    const way = WALK_KEYS[event.key.toLowerCase()];
    if (way) this.walk.release(way);
  }

  /**
   * While walking, letters and arrows are feet.
   * @param {KeyboardEvent} event
   */
  walking(event) {
    if (!this.walk.on) return false;
    const name = event.key.toLowerCase();
    this.walk.running = event.shiftKey;
    const way = WALK_KEYS[name];
    if (way) {
      if (!event.repeat) this.walk.press(way);
      return true;
    }
    /** @type {Record<string, (() => void) | undefined>} */
    const others = { q: () => this.walk.raise(-1), e: () => this.walk.raise(1), escape: () => this.actions.tool("orbit") };
    const other = others[name];
    other?.();
    return Boolean(other);
  }

  /**
   * While a place is chosen, arrows move a crosshair, Space and Enter choose what is under it.
   * @param {KeyboardEvent} event
   */
  placing(event) {
    if (!PLACING.has(this.tool)) return false;
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    /** @type {[number, number]} */
    const point = this.point ?? [this.canvas.width / 2, this.canvas.height / 2];
    if (this.tool === "measure" && this.actions.step(event.key)) return true;
    if (step) {
      const by = KEY_POINT * this.session.ratio * (event.shiftKey ? 8 : 1);
      const held = (/** @type {number} */ v, /** @type {number} */ size) => Math.min(size - 1, Math.max(0, v));
      const [x, y] = [held(point[0] + step[0] * by, this.canvas.width), held(point[1] + step[1] * by, this.canvas.height)];
      this.showPoint([x, y]);
      this.actions.hover(x, y);
    } else if (event.key === " " || event.key === "Enter") {
      if (this.point) this.actions.place(...this.point, { snap: event.shiftKey, isKey: true });
      else this.showPoint(point);
    } else if (event.key === "Escape") {
      this.actions.tool("orbit");
    } else {
      return false;
    }
    return true;
  }

  /**
   * The crosshair at a pixel, or away with it.
   * @param {[number, number] | null} point
   */
  showPoint(point) {
    this.point = point;
    const cross = $("crosshair");
    cross.toggleAttribute("hidden", !point);
    if (point) cross.style.transform = `translate(${point[0] / this.session.ratio}px, ${point[1] / this.session.ratio}px)`;
  }

  /** @param {KeyboardEvent} event */
  arrow(event) {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!step) return false;
    const [dx, dy] = step;
    this.flight.mark(true);
    this.flight.stop();
    if (event.shiftKey) {
      const pixels = this.canvas.height * KEY_MOVE;
      this.viewer.pan(dx * pixels, dy * pixels);
    } else if (this.stays) {
      const by = this.canvas.height * KEY_MOVE;
      this.turn(-dx * by, -dy * by);
    } else if (this.isFree) {
      this.viewer.turnFree(dx * KEY_TURN, dy * KEY_TURN, 0);
    } else {
      this.viewer.orbit(dx * KEY_TURN, dy * KEY_TURN);
    }
    this.session.wake();
    return true;
  }

  /**
   * Keys of one sign; a person can switch them off (chrome.js).
   * @param {KeyboardEvent} event
   */
  shortcut(event) {
    if (document.body.dataset.keys === "off") return false;
    if (VIEW_KEYS[event.key]) {
      this.actions.view(VIEW_KEYS[event.key]);
      return true;
    }
    /** @type {Record<string, (() => void) | undefined>} */
    const actions = {
      "+": () => this.zoom(KEY_ZOOM),
      "=": () => this.zoom(KEY_ZOOM),
      "-": () => this.zoom(1 / KEY_ZOOM),
      _: () => this.zoom(1 / KEY_ZOOM),
      "?": () => this.actions.help(),
      b: () => this.actions.save(),
      f: () => this.actions.fit(),
      h: () => this.actions.hide(),
      m: () => this.actions.tool("measure"),
      n: () => this.actions.tool("note"),
      o: () => this.actions.parallel(),
      p: () => this.actions.picture(),
      t: () => this.actions.free(),
      w: () => this.actions.tool("walk"),
      z: () => (event.shiftKey ? this.actions.forward() : this.actions.back()),
    };
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    action?.();
    return Boolean(action);
  }
}
