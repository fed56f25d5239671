// The page where somebody marks the same places in the pictures of two stations. The server states which sample is at a place, how well the pairs fit, and the
// entries for survey.toml; what was marked is kept by the browser until its tab is closed.

/** A sample that was marked: its cell in the picture with every cell, its coordinates in the station and their standard deviation, metres.
 * @typedef {{ cell: [number, number], at: [number, number, number], sigma: number }} Mark */
/** The marks of a place, by the identities of the two stations. @typedef {Record<string, Mark>} Pair */
/** @typedef {{ pairs: Pair[], half: { id: string, mark: Mark } | null }} Marked */
/** A pair as the server names it. @typedef {{ name: string, label: string, at: [number, number, number][], residual: number | null, known: boolean }} Point */
/** @typedef {{ pairs: Point[], known: Point[], state: "few" | "line" | "check" | "fits", missing: number, suspect: string | null, entries: string, again: boolean, fixed: boolean }} Fit */

/** As many pairs as the server aligns. */
const PAIRS_MAX = 64;
/** Steps that can be undone. */
const PAST_MAX = 200;
/** Largest `width` of a request for a sample, cells. */
const WIDTH_MAX = 64;
/** Pixels that a key moves the cross. */
const STEP = 8;
/** How long the address of a download stays valid, milliseconds. */
const DOWNLOAD = 10_000;

/** @template {Element} E @param {string} selector @param {new () => E} kind @param {ParentNode} [inside] */
function find(selector, kind, inside = document) {
  const found = inside.querySelector(selector);
  if (!(found instanceof kind)) throw new Error(`the page has no ${selector}`);
  return found;
}

/** @param {string} name @param {string} [text] @param {string} [className] */
function element(name, text = "", className = "") {
  const made = document.createElement(name);
  made.textContent = text;
  if (className) made.className = className;
  return made;
}

const root = find(".marking", HTMLElement);
/** @type {Record<string, string>} */
const messages = JSON.parse(root.dataset.messages ?? "{}");

/** A message with its values. @param {string} key @param {Record<string, string | number>} [values] */
function message(key, values = {}) {
  let text = messages[key] ?? key;
  for (const [name, value] of Object.entries(values)) text = text.replaceAll(`{${name}}`, () => String(value));
  return text;
}

/** @param {number} value @param {number} digits */
const decimal = (value, digits) => value.toFixed(digits).replace("-", "−").replace(".", messages.decimal);

/** @param {number} metres */
function length(metres) {
  if (metres < 0.01) return `${decimal(1000 * metres, 1)} mm`;
  return metres < 1 ? `${decimal(100 * metres, 1)} cm` : `${decimal(metres, 2)} m`;
}

/** The picture of a station, and what is marked in it. */
class Side {
  /** @param {HTMLElement} frame @param {(side: Side, x: number, y: number) => void} pick */
  constructor(frame, pick) {
    this.frame = frame;
    this.content = find(".content", HTMLElement, frame);
    this.cross = find(".cross", HTMLElement, /** @type {HTMLElement} */ (frame.parentElement));
    const { width, height, side, station, identity } = frame.dataset;
    this.size = [Number(width), Number(height)];
    this.letter = side ?? "";
    this.name = station ?? "";
    this.id = identity ?? "";
    /** Of the cross from the middle of the view, pixels. */
    this.offset = [0, 0];
    frame.addEventListener("click", (event) => {
      // The click at the end of a drag has been prevented; a double click marks one place.
      if (!event.defaultPrevented && event.detail <= 1) pick(this, event.clientX, event.clientY);
    });
    frame.addEventListener("keydown", (event) => this.#key(event, pick));
    // The cross stays in view when the frame gets smaller.
    new ResizeObserver(() => this.#move(0, 0)).observe(frame);
  }

  /** @param {KeyboardEvent} event @param {(side: Side, x: number, y: number) => void} pick */
  #key(event, pick) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key === "Enter") {
      event.preventDefault();
      if (event.repeat) return;
      this.#move(0, 0);
      const box = this.frame.getBoundingClientRect();
      pick(this, box.left + box.width / 2 + this.offset[0], box.top + box.height / 2 + this.offset[1]);
    }
    const step = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
    // Without Shift these keys move the picture.
    if (!step || !event.shiftKey) return;
    event.preventDefault();
    this.#move(STEP * step[0], STEP * step[1]);
  }

  /** Move the cross, but not out of the frame, whose size may have changed. @param {number} right @param {number} down */
  #move(right, down) {
    const { width, height } = this.frame.getBoundingClientRect();
    const reach = [width, height].map((size) => Math.max(0, size / 2 - 2));
    this.offset = [right, down].map((by, k) => Math.min(reach[k], Math.max(-reach[k], this.offset[k] + by)));
    this.cross.style.translate = `${this.offset[0]}px ${this.offset[1]}px`;
  }

  /**
   * The cell at a place of the window, and how many cells are seen as one pixel; null beside the picture.
   * @param {number} x @param {number} y @returns {{ cell: [number, number], width: number } | null}
   */
  cellAt(x, y) {
    const box = this.content.getBoundingClientRect();
    const column = Math.floor(((x - box.left) / box.width) * this.size[0]);
    const row = Math.floor(((y - box.top) / box.height) * this.size[1]);
    if (column < 0 || row < 0 || column >= this.size[0] || row >= this.size[1]) return null;
    return { cell: [column, row], width: Math.min(WIDTH_MAX, Math.max(1, Math.ceil(this.size[0] / box.width))) };
  }

  /** Show these marks and no others. @param {{ label: string, mark: Mark, kind: string }[]} marks */
  show(marks) {
    for (const old of this.content.querySelectorAll(".mark")) old.remove();
    for (const { label, mark, kind } of marks) {
      const shown = element("span", "", `mark ${kind}`);
      shown.append(element("span", label));
      // Read from the table instead.
      shown.setAttribute("aria-hidden", "true");
      const [left, top] = mark.cell.map((at, k) => `${(100 * (at + 0.5)) / this.size[k]}%`);
      Object.assign(shown.style, { left, top });
      this.content.append(shown);
    }
  }
}

class Page {
  constructor() {
    const frames = /** @type {HTMLElement[]} */ ([...root.querySelectorAll(".zoom")]);
    this.sides = frames.map((frame) => new Side(frame, (side, x, y) => this.#pick(side, x, y)));
    this.key = `kilwa control ${this.sides
      .map((side) => side.id)
      .sort()
      .join(" ")}`;
    /** @type {Marked} */
    this.marked = this.#load();
    /** @type {string[]} */
    this.past = [];
    /** @type {Fit | null} */
    this.fit = null;
    /** The last request for a fit: earlier answers are not used. */
    this.asked = 0;
    this.isFitting = false;
    /** Places are read one after the other, so that quick clicks become pairs in their order. @type {Promise<void>} */
    this.queue = Promise.resolve();
    /** Places that wait or are being read. */
    this.reading = 0;
    /** Places that were marked in an earlier epoch are discarded. */
    this.epoch = 0;
    /** Why the last place could not be marked. */
    this.notice = "";
    /** Why the pairs could not be aligned. */
    this.trouble = "";
    this.next = find(".next", HTMLElement, root);
    this.undo = find(".undo", HTMLButtonElement, root);
    this.rows = find("tbody", HTMLElement, root);
    this.entries = find(".entries", HTMLElement, root);
    this.text = find("textarea", HTMLTextAreaElement, this.entries);
    this.actions = [".copy", ".download"].map((name) => find(name, HTMLButtonElement, this.entries));
    this.#listen();
    for (const hidden of root.querySelectorAll(".guide, .help")) if (hidden instanceof HTMLElement) hidden.hidden = false;
    this.#fit();
    this.#show();
  }

  #listen() {
    addEventListener("focus", () => {
      // Somebody who comes back may have changed survey.toml. A place that is being read leads to a request anyway.
      if (!this.reading) this.#fit();
    });
    this.undo.addEventListener("click", () => this.#undo());
    const [copy, download] = this.actions;
    copy.addEventListener("click", () => this.#copy());
    download.addEventListener("click", () => this.#download());
    document.addEventListener("keydown", (event) => {
      const isUndo = (event.ctrlKey || event.metaKey) && !event.shiftKey && !event.altKey && event.key.toLowerCase() === "z";
      if (isUndo) {
        event.preventDefault();
        this.#undo();
      } else if (event.key === "Escape") {
        this.#discard();
        if (this.marked.half) this.#change({ ...this.marked, half: null });
        else this.#guide();
      }
    });
  }

  /** @returns {Marked} */
  #load() {
    try {
      const kept = JSON.parse(sessionStorage.getItem(this.key) ?? "");
      const isMark = (/** @type {Mark | undefined} */ mark) =>
        mark?.cell?.length === 2 && mark.at?.length === 3 && [...mark.cell, ...mark.at, mark.sigma].every(Number.isFinite);
      const pairs = kept.pairs.filter((/** @type {Pair} */ pair) => this.sides.every((side) => isMark(pair[side.id])));
      return { pairs, half: kept.half && isMark(kept.half.mark) ? kept.half : null };
    } catch {
      // Nothing was marked, or the browser keeps nothing.
      return { pairs: [], half: null };
    }
  }

  /** @param {Marked} marked */
  #change(marked) {
    this.past.push(JSON.stringify(this.marked));
    if (this.past.length > PAST_MAX) this.past.shift();
    this.#set(marked);
  }

  /** @param {Marked} marked */
  #set(marked) {
    const { pairs } = this.marked;
    this.marked = marked;
    this.notice = "";
    try {
      sessionStorage.setItem(this.key, JSON.stringify(marked));
    } catch {
      // The browser keeps nothing: the marks are there until the page is left.
    }
    if (JSON.stringify(pairs) !== JSON.stringify(marked.pairs)) {
      // Names and residuals of other pairs would be shown.
      this.fit = null;
      this.#fit();
    }
    this.#show();
  }

  /** Places that wait or are being read are not marked. */
  #discard() {
    this.epoch += 1;
    this.reading = 0;
  }

  #undo() {
    const isReading = this.reading > 0;
    this.#discard();
    // What is being read was the last step.
    if (isReading) return this.#guide();
    const before = this.past.pop();
    if (before) this.#set(JSON.parse(before));
  }

  /** Mark the sample at a place of the window. @param {Side} side @param {number} x @param {number} y */
  #pick(side, x, y) {
    // The picture may have been moved when its turn comes.
    const place = side.cellAt(x, y);
    if (!place) return;
    const { epoch } = this;
    this.notice = "";
    this.reading += 1;
    this.#guide();
    this.queue = this.queue.then(() => this.#read(side, place, epoch));
  }

  /** @param {Side} side @param {{ cell: [number, number], width: number }} place @param {number} epoch when it was marked */
  async #read(side, place, epoch) {
    if (epoch !== this.epoch) return;
    const isFull = this.marked.pairs.length >= PAIRS_MAX;
    const found = isFull ? { reason: message("controlMany", { count: PAIRS_MAX }) } : await sampleAt(side.name, place);
    if (epoch !== this.epoch) return;
    if ("reason" in found) {
      // Without this place, those that were marked after it would be paired with the wrong ones.
      this.#discard();
      this.notice = found.reason;
      return this.#guide();
    }
    this.reading -= 1;
    const { pairs, half } = this.marked;
    // Marked again in the same picture: it was the wrong place.
    if (!half || half.id === side.id) return this.#change({ pairs, half: { id: side.id, mark: found } });
    this.#change({ pairs: [...pairs, { [half.id]: half.mark, [side.id]: found }], half: null });
  }

  async #fit() {
    this.asked += 1;
    this.isFitting = true;
    const own = this.asked;
    const [a, b] = this.sides;
    const mark = (/** @type {Mark} */ { at, sigma }) => ({ at, sigma });
    const pairs = this.marked.pairs.map((pair) => ({ a: mark(pair[a.id]), b: mark(pair[b.id]) }));
    let fit = null;
    let reason = message("controlUnreachable");
    try {
      const answer = await fetch("/control/fit", {
        method: "POST",
        headers: { "content-type": "application/json" },
        body: JSON.stringify({ a: a.name, b: b.name, pairs }),
      });
      if (answer.ok) fit = await answer.json();
      else reason = message("controlFailed", { reason: await reasonOf(answer) });
    } catch {
      // The reason is given above.
    }
    if (own !== this.asked) return;
    this.isFitting = false;
    this.fit = fit;
    this.trouble = fit ? "" : reason;
    this.#show();
  }

  /** The label of a pair: as the server names it, or its number until it has. @param {number} number */
  #label(number) {
    return this.fit?.pairs[number]?.label ?? String(number + 1);
  }

  #show() {
    const { pairs, half } = this.marked;
    for (const side of this.sides) {
      const marks = pairs.map((pair, k) => {
        const isSuspect = this.fit?.suspect !== null && this.fit?.suspect === this.fit?.pairs[k]?.name;
        return { label: this.#label(k), mark: pair[side.id], kind: isSuspect ? "suspect" : "" };
      });
      if (half?.id === side.id) marks.push({ label: "?", mark: half.mark, kind: "half" });
      side.show(marks);
    }
    this.#rows();
    this.#entries();
    this.#guide();
  }

  /** The line above the pictures. */
  #guide() {
    setAvailable(this.undo, this.past.length > 0 || this.reading > 0);
    const parts = this.reading ? [message("controlReading")] : [this.trouble, this.notice, this.#advice()];
    const text = parts.filter(Boolean).join(" ");
    // The same text again would be read out again.
    if (this.next.textContent !== text) this.next.textContent = text;
    this.next.classList.toggle("check", !this.marked.half && (this.fit?.state === "check" || this.fit?.state === "line"));
  }

  /** What to do next; nothing while changed pairs are being aligned. */
  #advice() {
    const { half } = this.marked;
    const other = half && this.sides.find((side) => side.id !== half.id);
    if (other) return message("controlOther", { name: other.name });
    const { fit } = this;
    if (!fit) return this.isFitting || this.marked.pairs.length ? "" : message("controlFirst");
    const points = [...fit.pairs, ...fit.known];
    if (fit.state === "few") return `${message(`controlNeed${fit.missing}`)} ${message("controlFirst")}`;
    if (fit.state === "line") return message("controlLine");
    const largest = length(Math.max(...points.map((point) => point.residual ?? 0)));
    if (fit.state === "fits") return message("controlFits", { length: largest });
    const suspect = points.find((point) => point.name === fit.suspect);
    if (!suspect) return message("controlCheckThree", { length: largest });
    const point = suspect.label === suspect.name ? suspect.name : message("controlPair", { number: suspect.label });
    return message("controlCheck", { point, length: length(suspect.residual ?? 0) });
  }

  #rows() {
    const { pairs } = this.marked;
    const known = this.fit?.known ?? [];
    const held = [...this.rows.querySelectorAll("button")].findIndex((button) => button.matches(":focus"));
    find(".marked-pairs", HTMLElement, root).hidden = !pairs.length && !known.length;
    const rows = pairs.map((pair, k) => {
      const point = this.fit?.pairs[k];
      const at = this.sides.map((side) => pair[side.id].at);
      return this.#row({ label: this.#label(k), name: point?.name ?? this.#label(k), at, residual: point?.residual ?? null, known: point?.known ?? false }, k);
    });
    this.rows.replaceChildren(...rows, ...known.map((point) => this.#row(point)));
    if (held >= 0) this.#focus(held);
  }

  /** Focus the button of a pair, or what is nearest to it. @param {number} number */
  #focus(number) {
    const buttons = this.rows.querySelectorAll("button");
    (buttons[Math.min(number, buttons.length - 1)] ?? this.undo).focus({ preventScroll: true });
  }

  /** A line of the table; only pairs that were marked here have a number, and can be removed. @param {Point} point @param {number} [number] */
  #row(point, number) {
    const head = element("th", point.name);
    head.setAttribute("role", "rowheader");
    head.setAttribute("scope", "row");
    if (point.known) head.append(element("span", ` · ${message("controlKnown")}`, "quiet"));
    const titles = [...root.querySelectorAll("thead th")].map((title) => title.textContent ?? "");
    const cells = point.at.map((at) => at.map((v) => decimal(v, 3)).join("; "));
    cells.push(point.residual === null ? "–" : length(point.residual));
    const data = cells.map((text, k) => {
      const cell = element("td", "", "number");
      cell.dataset.label = titles[k + 1];
      const value = element("bdi", text);
      value.dir = "ltr";
      cell.append(value);
      return cell;
    });
    const isSuspect = this.fit?.suspect === point.name;
    // Not by colour alone.
    if (isSuspect) data[data.length - 1].append(` · ${message("controlSuspect")}`);
    const last = element("td");
    if (number !== undefined) {
      const button = element("button", message("controlRemove"), "button outlined");
      button.setAttribute("type", "button");
      button.setAttribute("aria-label", message("controlRemoveName", { name: point.name }));
      button.addEventListener("click", () => this.#remove(number));
      last.append(button);
    }
    const row = element("tr", "", isSuspect ? "suspect" : "");
    row.setAttribute("role", "row");
    for (const cell of [...data, last]) cell.setAttribute("role", "cell");
    row.append(head, ...data, last);
    return row;
  }

  /** @param {number} number */
  #remove(number) {
    this.#discard();
    this.#change({ ...this.marked, pairs: this.marked.pairs.filter((_, k) => k !== number) });
    // The focus stays near the button that is gone, which not every browser focuses when it is clicked.
    this.#focus(number);
  }

  #entries() {
    const { fit } = this;
    const text = fit?.entries ?? "";
    // While changed pairs are being aligned, the section stays as it is, so that nothing below it jumps, but the old entries cannot be copied.
    const isWaiting = !fit && this.isFitting;
    if (!isWaiting) {
      if (!text && this.entries.contains(document.activeElement)) this.undo.focus({ preventScroll: true });
      this.entries.hidden = !text;
    }
    for (const button of this.actions) setAvailable(button, Boolean(text));
    // What is selected stays selected.
    if (this.text.value !== text) this.text.value = text;
    const next = fit?.fixed ? "controlNextFixed" : fit?.again ? "controlNextAgain" : "controlNext";
    if (!isWaiting) find(".what-next", HTMLElement, this.entries).textContent = message(next);
    find(".copied", HTMLElement, this.entries).textContent = "";
  }

  async #copy() {
    if (!this.text.value) return;
    const copied = find(".copied", HTMLElement, this.entries);
    try {
      await navigator.clipboard.writeText(this.text.value);
      copied.textContent = message("controlCopied");
    } catch {
      // Not allowed, or not possible because the page does not come over HTTPS.
      this.text.focus();
      this.text.select();
      copied.textContent = message("controlCopyByHand");
    }
  }

  #download() {
    if (!this.text.value) return;
    const address = URL.createObjectURL(new Blob([this.text.value], { type: "application/toml" }));
    const link = document.createElement("a");
    link.href = address;
    link.download = `control-${this.sides.map((side) => side.name).join("-")}.toml`;
    link.click();
    // Some browsers read it only after the click, and would cancel the download.
    setTimeout(() => URL.revokeObjectURL(address), DOWNLOAD);
  }
}

/** Unlike a disabled button, one that is not available keeps the focus. @param {HTMLElement} button @param {boolean} isAvailable */
function setAvailable(button, isAvailable) {
  button.setAttribute("aria-disabled", String(!isAvailable));
}

/** @param {Response} answer */
async function reasonOf(answer) {
  const text = await answer.text();
  try {
    return String(JSON.parse(text).reason);
  } catch {
    return text.trim() || `${answer.status}`;
  }
}

/**
 * The sample at a place of a picture, or why there is none.
 * @param {string} station @param {{ cell: [number, number], width: number }} place @returns {Promise<Mark | { reason: string }>}
 */
async function sampleAt(station, { cell, width }) {
  try {
    const answer = await fetch(`/stations/${encodeURIComponent(station)}/at/${cell[0]}-${cell[1]}.json?width=${width}`);
    if (answer.ok) {
      const found = await answer.json();
      return { cell: found.cell, at: found.at, sigma: found.sigma };
    }
    if (answer.status === 404) return { reason: message("controlEmpty") };
    return { reason: message("controlFailed", { reason: await reasonOf(answer) }) };
  } catch {
    return { reason: message("controlUnreachable") };
  }
}

new Page();

export {};
