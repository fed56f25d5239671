// The pages of a survey: pictures that can be zoomed, and a plan and a list that highlight the same station. Without this script the pages show the same, but do not zoom.

const STEP = 1.5;
/** A picture is enlarged until a cell of the grid is this wide, in pixels of the page. */
const CELL = 12;
/** Parts with every cell are shown from this width of a cell on, in pixels of the screen. */
const FINE = 0.5;
/** Parts that are kept beyond those in view. */
const SPARE = 24;

/** An element that shows its content enlarged, and is scrolled to move it. */
class Zoom {
  /** @param {HTMLElement} frame @param {HTMLElement | SVGSVGElement} content */
  constructor(frame, content) {
    this.frame = frame;
    this.content = content;
    this.by = 1;
    /** @type {Map<string, HTMLImageElement>} */
    this.parts = new Map();
    this.tools = frame.closest("figure")?.querySelector(".zoom-tools");
    const { width, height, part, parts, closest } = frame.dataset;
    this.full = [Number(width), Number(height)];
    this.part = Number(part);
    this.address = parts;
    this.closest = Number(closest);
    /**
     * Where the wheel was turned, which share of the content was there, and which one is there after the zoom; until the pointer or the content is moved.
     * @type {{ at: [number, number], share: number[], after: number[] } | null}
     */
    this.anchor = null;
    /** The request for the next frame, in which parts are shown; 0 where there is none. */
    this.planned = 0;
    this.state = new URL(content.querySelector("img")?.src ?? location.href).search;
    frame.addEventListener("wheel", (event) => this.#wheel(event), { passive: false });
    frame.addEventListener("keydown", (event) => this.#key(event));
    frame.addEventListener("scroll", () => this.#later());
    this.#drag();
    this.#pinch();
    for (const button of this.tools?.querySelectorAll("button") ?? []) button.addEventListener("click", () => this.#do(button.dataset.zoom));
    if (this.tools instanceof HTMLElement) this.tools.hidden = false;
    frame.classList.add("fitted");
    new ResizeObserver(() => {
      const anchor = this.#anchorAt(this.anchor?.at);
      this.#fit();
      // Scroll bars that have just appeared have moved nothing.
      if (anchor) anchor.after = this.#share(...anchor.at);
    }).observe(frame);
    this.#fit();
  }

  /** Width of the content where all of it is shown. */
  get #whole() {
    const [w, h] = this.#form();
    // The frame grows with its content up to this height.
    const tallest = Number.parseFloat(getComputedStyle(this.frame).maxHeight) || innerHeight;
    return Math.min(this.frame.clientWidth, (tallest * w) / h);
  }

  /** Width and height of the content, in whatever unit. */
  #form() {
    if (this.content instanceof SVGSVGElement) return [this.content.viewBox.baseVal.width, this.content.viewBox.baseVal.height];
    const picture = this.content.querySelector("img");
    return [picture?.width ? Number(picture.getAttribute("width")) : 1, Number(picture?.getAttribute("height")) || 1];
  }

  get #most() {
    return this.closest || Math.max(4, (CELL * this.full[0]) / this.#whole);
  }

  #fit() {
    const whole = this.#whole;
    if (!whole) return;
    this.content.style.width = `${whole * this.by}px`;
    this.content.style.setProperty("--closer", String(this.by));
    this.frame.classList.toggle("zoomed", this.by > 1);
    this.content.classList.toggle("cells", whole * this.by > this.full[0]);
    const shown = this.tools?.querySelector("output");
    if (shown) shown.textContent = `${Math.round(100 * this.by)} %`;
    this.#later();
  }

  /** Enlarge `times`, so that what is at a place of the window stays there; without one, what is in the middle. */
  zoom(/** @type {number} */ times, /** @type {number | undefined} */ x = undefined, /** @type {number | undefined} */ y = undefined) {
    const frame = this.frame.getBoundingClientRect();
    const [atX, atY] = [x ?? frame.left + frame.width / 2, y ?? frame.top + frame.height / 2];
    this.#around(times, [atX, atY], this.#share(atX, atY));
  }

  /** Which share of the content's width and height is at a place of the window. */
  #share(/** @type {number} */ x, /** @type {number} */ y) {
    const shown = this.content.getBoundingClientRect();
    return [(x - shown.left) / shown.width, (y - shown.top) / shown.height];
  }

  /** Enlarge, so that this share of the content is at a place of the window, as far as the content can be moved. */
  #around(/** @type {number} */ times, /** @type {[number, number]} */ [atX, atY], /** @type {number[]} */ share) {
    const by = Math.min(this.#most, Math.max(1, this.by * times));
    this.by = by < 1.001 ? 1 : by;
    this.#fit();
    const after = this.content.getBoundingClientRect();
    this.frame.scrollLeft += after.left + share[0] * after.width - atX;
    this.frame.scrollTop += after.top + share[1] * after.height - atY;
  }

  #do(/** @type {string | undefined} */ what) {
    this.anchor = null;
    this.zoom(what === "in" ? STEP : what === "out" ? 1 / STEP : 0);
  }

  #wheel(/** @type {WheelEvent} */ event) {
    // Where nothing is enlarged, turning back scrolls the page.
    if (event.deltaY > 0 && this.by === 1) return;
    event.preventDefault();
    const lines = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
    /** @type {[number, number]} */
    const at = [event.clientX, event.clientY];
    // While the frame grows, what is at the pointer cannot stay there, but it comes back with the next turns.
    const anchor = this.#anchorAt(at) ?? { at, share: this.#share(...at), after: [] };
    this.#around(Math.exp(-event.deltaY * lines * (event.ctrlKey ? 0.01 : 0.002)), anchor.at, anchor.share);
    anchor.after = this.#share(...anchor.at);
    this.anchor = anchor;
  }

  /** The anchor, if it is at this place of the window and the content was not moved since, for example with scroll bars or arrow keys. */
  #anchorAt(/** @type {[number, number] | undefined} */ at) {
    const { anchor } = this;
    if (!anchor || !at || Math.abs(anchor.at[0] - at[0]) + Math.abs(anchor.at[1] - at[1]) >= 2) return null;
    const { width, height } = this.content.getBoundingClientRect();
    const share = this.#share(...anchor.at);
    const isMoved = [width, height].some((size, k) => Math.abs(share[k] - anchor.after[k]) * size >= 2);
    return isMoved ? null : anchor;
  }

  #key(/** @type {KeyboardEvent} */ event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const what = { "+": "in", "=": "in", "-": "out", "−": "out", 0: "whole" }[event.key];
    if (!what) return;
    event.preventDefault();
    this.#do(what);
  }

  /** With a mouse; fingers scroll by themselves. */
  #drag() {
    const { frame } = this;
    /** @type {[number, number] | null} */
    let last = null;
    let far = 0;
    frame.addEventListener("dragstart", (event) => event.preventDefault());
    frame.addEventListener("pointerdown", (event) => {
      far = 0;
      this.anchor = null;
      if (event.pointerType !== "mouse" || event.button !== 0) return;
      last = [event.clientX, event.clientY];
    });
    frame.addEventListener("pointermove", (event) => {
      if (!last) return;
      const by = [event.clientX - last[0], event.clientY - last[1]];
      far += Math.abs(by[0]) + Math.abs(by[1]);
      if (far < 5) return;
      if (!frame.hasPointerCapture(event.pointerId)) frame.setPointerCapture(event.pointerId);
      frame.classList.add("moving");
      frame.scrollLeft -= by[0];
      frame.scrollTop -= by[1];
      last = [event.clientX, event.clientY];
    });
    const end = () => {
      last = null;
      frame.classList.remove("moving");
    };
    frame.addEventListener("pointerup", end);
    frame.addEventListener("pointercancel", end);
    // The end of a movement is no click on what happens to be there.
    frame.addEventListener("click", (event) => far >= 5 && event.detail > 0 && event.preventDefault(), { capture: true });
  }

  #pinch() {
    let last = 0;
    const apart = (/** @type {TouchList} */ [a, b]) => Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
    this.frame.addEventListener("touchstart", (event) => {
      last = event.touches.length === 2 ? apart(event.touches) : 0;
    });
    this.frame.addEventListener(
      "touchmove",
      (event) => {
        if (event.touches.length !== 2 || !last) return;
        event.preventDefault();
        const [a, b] = event.touches;
        const now = apart(event.touches);
        this.zoom(now / last, (a.clientX + b.clientX) / 2, (a.clientY + b.clientY) / 2);
        last = now;
      },
      { passive: false },
    );
  }

  /** Show the parts in view with every cell, if the picture has fewer and they can be seen. */
  #later() {
    if (!this.address || this.planned) return;
    this.planned = requestAnimationFrame(() => {
      this.planned = 0;
      this.#show();
    });
  }

  #show() {
    const [width, height] = this.full;
    const { content, frame, part, parts } = this;
    const shown = content.getBoundingClientRect();
    const cell = shown.width / width;
    if (this.by === 1 || cell * devicePixelRatio < FINE) {
      for (const picture of parts.values()) picture.remove();
      parts.clear();
      return;
    }
    const seen = frame.getBoundingClientRect();
    /** @param {number} from @param {number} to @param {number} start @param {number} cells */
    const range = (from, to, start, cells) => {
      const [first, last] = [from, to].map((at) => Math.floor((at - start) / cell / part));
      return [Math.max(0, first), Math.min(Math.ceil(cells / part) - 1, last)];
    };
    const columns = range(seen.left, seen.right, shown.left, width);
    const rows = range(seen.top, seen.bottom, shown.top, height);
    for (let row = rows[0]; row <= rows[1]; row += 1) {
      for (let column = columns[0]; column <= columns[1]; column += 1) {
        const name = `${column}-${row}`;
        const picture = parts.get(name) ?? this.#part(name, column, row);
        // The last ones of the map are the ones in view.
        parts.delete(name);
        parts.set(name, picture);
      }
    }
    const inView = (rows[1] - rows[0] + 1) * (columns[1] - columns[0] + 1);
    for (const [name, picture] of parts) {
      if (parts.size <= inView + SPARE) break;
      picture.remove();
      parts.delete(name);
    }
  }

  #part(/** @type {string} */ name, /** @type {number} */ column, /** @type {number} */ row) {
    const [width, height] = this.full;
    const picture = new Image();
    picture.className = "part";
    picture.alt = "";
    const size = [Math.min(this.part, width - column * this.part), Math.min(this.part, height - row * this.part)];
    const share = (/** @type {number} */ cells, /** @type {number} */ all) => `${(100 * cells) / all}%`;
    Object.assign(picture.style, {
      left: share(column * this.part, width),
      top: share(row * this.part, height),
      width: share(size[0], width),
      height: share(size[1], height),
    });
    // Until it is there, and where it cannot be drawn, the whole picture is seen.
    picture.addEventListener("error", () => picture.remove());
    picture.src = `${this.address}/${name}.png${this.state}`;
    this.content.append(picture);
    return picture;
  }
}

/** What stands for the same station on the plan and in the list is marked together. */
function link() {
  /** @param {string} kind @param {string | undefined} name */
  const mark = (kind, name) => {
    for (const old of document.querySelectorAll(`.${kind}`)) old.classList.remove(kind);
    if (!name) return;
    for (const one of document.querySelectorAll(`[data-station="${CSS.escape(name)}"]`)) one.classList.add(kind);
  };
  const of = (/** @type {EventTarget | null} */ target) => {
    const one = target instanceof Element ? target.closest("[data-station]") : null;
    return one instanceof HTMLElement || one instanceof SVGElement ? one.dataset.station : undefined;
  };
  for (const event of ["pointerover", "focusin"]) document.addEventListener(event, ({ target }) => mark("marked", of(target)));
  const chosen = () => mark("picked", /^#station-(.+)$/.exec(location.hash)?.[1]);
  addEventListener("hashchange", chosen);
  chosen();
  // A line of the list, but for its link, chooses its station without moving the page.
  document.querySelector("table.stations tbody")?.addEventListener("click", ({ target }) => {
    const name = of(target);
    if (!name || (target instanceof Element && target.closest("a")) || String(getSelection())) return;
    history.replaceState(null, "", `#station-${name}`);
    chosen();
  });
}

for (const frame of document.querySelectorAll(".zoom")) {
  const content = frame.querySelector(".content");
  if (frame instanceof HTMLElement && (content instanceof HTMLElement || content instanceof SVGSVGElement)) new Zoom(frame, content);
}
link();

export {};
