// Mouse, touch and keyboard on the canvas, turned into moves of the viewer. Pixels are those of the picture, y down.

/** A drag of the whole height of the canvas turns the model by this many radians. */
const TURN = Math.PI;
const KEY_TURN = Math.PI / 24;
const KEY_MOVE = 0.06;
const KEY_ZOOM = 0.8;

export const VIEW_KEYS = { 1: "plan", 2: "north", 3: "east", 4: "south", 5: "west", 6: "iso" };

export class Input {
  /**
   * @param {import("./session.js").Session} session
   * @param {object} actions `hover(x, y)`, `leave()`, `fit()`, `view(name)`, `hide()`, `help()`, `pivot(found)`, `parallel()`
   */
  constructor(session, actions) {
    this.session = session;
    this.viewer = session.viewer;
    this.canvas = session.canvas;
    this.actions = actions;
    this.tool = "orbit";
    this.pointers = new Map();
    this.lastTap = { time: 0, x: 0, y: 0 };
    this.abort = new AbortController();
    const listen = (target, type, handler, options = {}) =>
      target.addEventListener(type, handler.bind(this), { signal: this.abort.signal, ...options });
    listen(this.canvas, "pointerdown", this.down);
    listen(this.canvas, "pointermove", this.move);
    listen(this.canvas, "pointerup", this.up);
    listen(this.canvas, "pointercancel", this.up);
    listen(this.canvas, "pointerleave", () => this.actions.leave());
    listen(this.canvas, "wheel", this.wheel, { passive: false });
    listen(this.canvas, "dblclick", this.doubleClick);
    listen(this.canvas, "contextmenu", (event) => event.preventDefault());
    listen(window, "keydown", this.key);
  }

  close() {
    this.abort.abort();
  }

  at(event) {
    const box = this.canvas.getBoundingClientRect();
    return [(event.clientX - box.left) * this.session.ratio, (event.clientY - box.top) * this.session.ratio];
  }

  down(event) {
    if (event.pointerType === "mouse" && event.button > 2) return;
    // The middle button would scroll the page.
    if (event.button === 1) event.preventDefault();
    this.canvas.setPointerCapture(event.pointerId);
    this.canvas.classList.add("moving");
    const [x, y] = this.at(event);
    const pans = event.button !== 0 || event.shiftKey || event.ctrlKey || event.metaKey || this.tool === "pan";
    this.pointers.set(event.pointerId, { x, y, pans, moved: 0 });
    this.actions.leave();
  }

  move(event) {
    const [x, y] = this.at(event);
    const pointer = this.pointers.get(event.pointerId);
    if (!pointer) {
      if (event.pointerType === "mouse") this.actions.hover(x, y);
      return;
    }
    const before = [...this.pointers.values()].map((p) => ({ ...p }));
    pointer.moved += Math.hypot(x - pointer.x, y - pointer.y);
    const [dx, dy] = [x - pointer.x, y - pointer.y];
    pointer.x = x;
    pointer.y = y;
    if (this.pointers.size === 1) {
      if (pointer.pans) this.viewer.pan(dx, dy);
      else this.turn(dx, dy);
    } else if (this.pointers.size === 2) {
      this.pinch(before, [...this.pointers.values()]);
    }
    this.session.wake();
  }

  turn(dx, dy) {
    const scale = TURN / this.canvas.height;
    // The model follows the pointer: to the right means that the eye goes round to the left.
    this.viewer.orbit(dx * scale, dy * scale);
  }

  /** Two fingers: their middle moves the model, their distance zooms about it, their angle turns it. */
  pinch([a0, b0], [a1, b1]) {
    const middle = (a, b) => [(a.x + b.x) / 2, (a.y + b.y) / 2];
    const [from, to] = [middle(a0, b0), middle(a1, b1)];
    this.viewer.pan(to[0] - from[0], to[1] - from[1]);
    const apart = (a, b) => Math.max(Math.hypot(a.x - b.x, a.y - b.y), 1);
    this.viewer.zoom(apart(a0, b0) / apart(a1, b1), to[0], to[1]);
    const angle = (a, b) => Math.atan2(b.y - a.y, b.x - a.x);
    const twist = angle(a1, b1) - angle(a0, b0);
    this.viewer.orbit(Math.atan2(Math.sin(twist), Math.cos(twist)), 0);
  }

  up(event) {
    const pointer = this.pointers.get(event.pointerId);
    this.pointers.delete(event.pointerId);
    if (this.pointers.size === 0) this.canvas.classList.remove("moving");
    if (pointer && event.type === "pointerup" && event.pointerType !== "mouse") this.tap(event, pointer);
    this.session.wake();
  }

  /** Two taps at one place are the double click of a finger. */
  tap(event, pointer) {
    const slack = 12 * this.session.ratio;
    if (pointer.moved > slack) return;
    const last = this.lastTap;
    const isSecond = event.timeStamp - last.time < 350 && Math.hypot(pointer.x - last.x, pointer.y - last.y) < 3 * slack;
    this.lastTap = isSecond ? { time: 0, x: 0, y: 0 } : { time: event.timeStamp, x: pointer.x, y: pointer.y };
    if (isSecond) this.pivot(pointer.x, pointer.y);
    else this.actions.hover(pointer.x, pointer.y);
  }

  doubleClick(event) {
    event.preventDefault();
    this.pivot(...this.at(event));
  }

  pivot(x, y) {
    this.actions.pivot(this.viewer.setPivot(x, y));
    this.session.wake();
  }

  wheel(event) {
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : event.deltaMode === 2 ? 400 : 1;
    // A pinch on a trackpad comes as a wheel with Ctrl, in much smaller steps.
    const delta = Math.max(-240, Math.min(240, event.deltaY * lines)) * (event.ctrlKey ? 5 : 1);
    const [x, y] = this.at(event);
    this.viewer.zoom(Math.exp(delta * 0.0016), x, y);
    this.session.wake();
    this.actions.hover(x, y);
  }

  /** Zoom about the middle, for buttons and keys. */
  zoom(factor) {
    this.viewer.zoom(factor, this.canvas.width / 2, this.canvas.height / 2);
    this.session.wake();
  }

  key(event) {
    if (event.altKey || event.ctrlKey || event.metaKey || event.defaultPrevented) return;
    const target = event.target;
    if (target.closest?.("input, select, textarea, dialog, [role=menu]")) return;
    const onCanvas = target === this.canvas || target === document.body;
    if (this.shortcut(event) || (onCanvas && this.arrow(event))) event.preventDefault();
  }

  arrow(event) {
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    if (!step) return false;
    const [dx, dy] = step;
    if (event.shiftKey) {
      const pixels = this.canvas.height * KEY_MOVE;
      this.viewer.pan(dx * pixels, dy * pixels);
    } else {
      this.viewer.orbit(dx * KEY_TURN, dy * KEY_TURN);
    }
    this.session.wake();
    return true;
  }

  shortcut(event) {
    if (VIEW_KEYS[event.key]) {
      this.actions.view(VIEW_KEYS[event.key]);
      return true;
    }
    const actions = {
      "+": () => this.zoom(KEY_ZOOM),
      "=": () => this.zoom(KEY_ZOOM),
      "-": () => this.zoom(1 / KEY_ZOOM),
      "_": () => this.zoom(1 / KEY_ZOOM),
      "?": () => this.actions.help(),
      f: () => this.actions.fit(),
      h: () => this.actions.hide(),
      o: () => this.actions.parallel(),
    };
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    action?.();
    return Boolean(action);
  }
}
