// Measuring, as the page sees it: questions go to a worker (measure/worker.js, wasm), bytes are fetched here through the page's own loader.
//
// const engine = await Engine.open({ pack, head, viewer, pages, footer, program });
// engine.pack        { identity, title, crs, lattice: { origin, step_log2 }, step, capture, bytes, triangles, borders }
// engine.pick({ origin, direction }, { clip, snap, within, provisional, progress, signal })
//   → { local, world, normal, ray, snapped: "vertex" | "crease" | "border" | null, fetched }, or null where the ray meets nothing
//   clip         the viewer's display state (an object); only clipPlane and clipBox count. Left out: that of the viewer.
//   snap         "none" | "vertex" | "crease" | "border", within so many metres (usually ten edges)
//   provisional  hears at once { local, world, low, high, stretches, error }: low and high are metres along the ray (null where there are several
//                stretches: no number then), error is the certified error of what is drawn there; or null where nothing can be met
// engine.measure(task, { unit, level, progress, signal })
//   → { readings, printed: [{ name, text }], parts: [{ what: "lattice" | "level" | "capture", value: metres | null }], uncertainty, remarks, details, task,
//       lines?: [{ closed, flat, world, elevation? }], title?, layer?, read?: { chunks, bytes, of_chunks, of_bytes }, fetched, provisional }
//     or { refusal: "English sentence", said: { code, values } }.  `printed` are the very digits of `kilwa measure`; a remark is { code, values, english };
//     messages.js has both in the language of the page.
//   level        how far the points may still be from the finest surface, metres: then the answer is provisional, from the points alone
// engine.shown(readings, unit)            → printed: the same readings in another unit
// engine.cite(measurement, { unit })      → one English sentence, that of `kilwa measure --cite`; cite.js writes it in the language of the page
// engine.write(what, format, { scale })   → text; what: a document (json, csv, geojson, dxf) or an answer with lines (those and svg)
// engine.read(text)                       → document, with `same`: false where it is of another pack; its points are counted from this pack's origin
// engine.drawing(asked, host, { progress, signal }) → { paper, world, isFull }: a drawing to scale; sheet.js is the host
// Progress: { done, all } bytes, of a drawing rows; all is 0 if it is unknown; { waiting: seconds } while the connection is gone. A signal that is aborted rejects with
// an AbortError; a pack that changed or cannot be read with a sentence (`said` where it is the engine's, `kind` where it is the network's). Questions asked last are fetched for first.

import { isPassing } from "../loader.js";

/** Requests on their way at a time. */
const IN_FLIGHT = 6;

/** Bytes of the footer and of a directory page, entries in a page, and offsets in the header (docs/FORMAT.md, sections 3, 4 and 7). */
const [FOOTER_BYTES, PAGE_BYTES, PAGE_ENTRIES] = [80, 16_384, 127];
const [FEATURES_AT, POINTS] = [16, 2];
const [FILE_BYTES_AT, ENTRIES_AT, PAGES_AT] = [64, 84, 112];

/** Before one is open. @type {EnginePack} */
const NO_PACK = {
  identity: "",
  title: "",
  crs: null,
  lattice: { origin: [0, 0, 0], step_log2: 0 },
  step: 1,
  capture: NaN,
  bytes: 0,
  triangles: 0,
  program: "",
};

const aborted = () => new DOMException("the question was taken back", "AbortError");

/** @import { Asking, Call, EnginePack, Need, Provisional, MeasureAnswer, MeasureRecord, PackSource, Progress, Ray, Reading, SheetAsked, SheetHost, SheetMade, Uncertainty, Viewer } from "../types/page.js" */

export class Engine {
  /**
   * Open a pack for measuring: what is missing of its directory comes while the program does.
   * @param {object} parts
   * @param {PackSource} parts.pack
   * @param {Uint8Array} parts.head
   * @param {() => Viewer | null} [parts.viewer]
   * @param {() => Map<number, Uint8Array>} [parts.pages]
   * @param {Uint8Array | null} [parts.footer]
   * @param {Promise<WebAssembly.Module>} parts.program
   */
  static async open({ pack, head, viewer = () => null, pages = () => new Map(), footer = null, program }) {
    const engine = new Engine(pack, viewer);
    try {
      program.then(
        (module) => engine.worker.postMessage({ module, points: (head[FEATURES_AT] & POINTS) !== 0 }),
        (error) => engine.#lost(error.message),
      );
      await engine.#open(head, pages(), footer);
    } catch (error) {
      engine.close();
      throw error;
    }
    return engine;
  }

  #calls = 0;
  /** @type {Map<number, Call>} */
  #pending = new Map();
  /** @type {Need[]} */
  #queue = [];
  #running = 0;

  /**
   * @param {PackSource} source
   * @param {() => Viewer | null} viewer
   */
  constructor(source, viewer) {
    this.source = source;
    this.viewer = viewer;
    this.closed = false;
    /** Ends what is fetched while the pack is opened. */
    this.hold = new AbortController();
    /** @type {EnginePack} */
    this.pack = NO_PACK;
    this.fetched = 0;
    this.worker = new Worker(new URL("measure/worker.js", import.meta.url), { type: "module" });
    this.worker.onmessage = ({ data }) => this.#take(data);
    this.worker.onerror = (event) => this.#lost(event.message || "the measuring worker did not start");
  }

  /**
   * @param {Uint8Array} head
   * @param {Map<number, Uint8Array>} kept pages of the directory that the viewer has
   * @param {Uint8Array | null} given the footer, where it is there
   */
  async #open(head, kept, given) {
    const view = new DataView(head.buffer, head.byteOffset);
    const number = (/** @type {number} */ at) => Number(view.getBigUint64(at, true));
    const count = Math.ceil(view.getUint32(ENTRIES_AT, true) / PAGE_ENTRIES);
    const wanted = { offset: number(PAGES_AT), count: Math.max(0, count - 1) };
    const ask = async (/** @type {boolean} */ fresh) => {
      const parts = [
        this.#directory(wanted, fresh ? new Map() : kept, fresh),
        (fresh ? null : given) ?? this.#range(number(FILE_BYTES_AT) - FOOTER_BYTES, FOOTER_BYTES, fresh),
      ];
      const [pages, footer] = await Promise.all(parts);
      // The worker gets copies: the page keeps its own.
      return this.#call("open", [head, pages, footer]);
    };
    this.pack = await ask(false).catch((error) => {
      // What the viewer was given may have been damaged on the way, or what lay in a store.
      if (!error.said || this.closed) throw error;
      return ask(true);
    });
  }

  /**
   * @param {number} offset
   * @param {number} length
   */
  #range(offset, length, fresh = false) {
    return this.#bytes({ offset, length, fresh }, this.hold.signal, () => {});
  }

  /**
   * Pages of the directory from the second on: those that the viewer has are not fetched again.
   * @param {{offset: number, count: number}} wanted
   * @param {Map<number, Uint8Array>} kept
   * @param {boolean} fresh
   */
  async #directory({ offset, count }, kept, fresh) {
    const out = new Uint8Array(count * PAGE_BYTES);
    const have = new Uint8Array(count);
    for (const [at, bytes] of kept) {
      const first = (at - offset) / PAGE_BYTES;
      if (!Number.isInteger(first) || first < 0 || at - offset + bytes.length > out.length) continue;
      out.set(bytes, at - offset);
      have.fill(1, first, first + Math.floor(bytes.length / PAGE_BYTES));
    }
    /** @type {{page: number, pages: number}[]} */
    const missing = [];
    for (let page = 0; page < count; page += 1) {
      if (have[page]) continue;
      const last = missing.at(-1);
      if (last && last.page + last.pages === page) last.pages += 1;
      else missing.push({ page, pages: 1 });
    }
    await Promise.all(
      missing.map(async ({ page, pages }) => out.set(await this.#range(offset + page * PAGE_BYTES, pages * PAGE_BYTES, fresh), page * PAGE_BYTES)),
    );
    return out;
  }

  /**
   * Where a ray meets the finest surface first; null where it meets nothing.
   * @param {Ray} ray
   * @param {Asking & {clip?: object | null, snap?: string, within?: number, provisional?: (found: Provisional | null) => void}} how
   * @returns {Promise<{local: number[], world: number[], normal: number[], ray: Ray, snapped: string | null, fetched: number} | null>}
   */
  async pick({ origin, direction }, { clip, snap = "none", within, provisional, progress, signal } = {}) {
    signal?.throwIfAborted();
    const viewer = this.viewer();
    if (provisional && viewer) {
      const found = viewer.provisional(new Float64Array([...origin, ...direction]));
      provisional(found ? JSON.parse(found) : null);
    }
    const state = clip ?? (viewer ? JSON.parse(viewer.displayState()) : {});
    const { clipPlane, clipBox } = state ?? {};
    const asked = { origin: [...origin], direction: [...direction], clip: { clipPlane, clipBox }, snap, within };
    this.#leafless(viewer);
    return this.#call("pick", [asked], { progress, signal });
  }

  /**
   * Measure a task of a document.
   * @param {MeasureRecord} task
   * @param {Asking & {unit?: string, level?: number}} how
   * @returns {Promise<MeasureAnswer>}
   */
  async measure(task, { unit = "m", level, progress, signal } = {}) {
    signal?.throwIfAborted();
    if (!level) this.#leafless(this.viewer());
    return this.#call("measure", [{ task, unit, level }], { progress, signal });
  }

  /** What the viewer has decoded need not be fetched to find that it holds nothing of the finest surface. @param {Viewer | null} viewer */
  #leafless(viewer) {
    if (viewer) this.#call("leafless", [viewer.leafless()]).catch(() => {}); // what comes after reports it
  }

  /**
   * @param {Reading[]} readings
   * @param {string} unit
   */
  shown(readings, unit) {
    return this.#call("shown", [readings, unit]);
  }

  /**
   * @param {MeasureRecord} measurement
   * @param {{unit?: string}} how
   * @returns {Promise<string>}
   */
  cite(measurement, { unit = "m" } = {}) {
    return this.#call("cite", [measurement, unit]);
  }

  /**
   * Make a drawing to scale; `host` renders its parts and keeps its bytes.
   * @param {SheetAsked} asked
   * @param {SheetHost} host
   * @param {Asking} how
   * @returns {Promise<SheetMade>}
   */
  async drawing(asked, host, { progress, signal } = {}) {
    signal?.throwIfAborted();
    return this.#call("drawing", [asked], { progress, signal, host });
  }

  /**
   * @param {object} what a document, or an answer with lines
   * @param {string} format
   * @param {{scale?: number}} how
   * @returns {Promise<string>}
   */
  write(what, format, { scale = 50 } = {}) {
    return this.#call("write", [what, format, scale]);
  }

  /**
   * @param {string} text
   * @returns {Promise<{same: boolean, pack: {title: string, identity: string}, measurements: MeasureRecord[]}>}
   */
  read(text) {
    return this.#call("read", [text]);
  }

  close() {
    this.closed = true;
    this.hold.abort();
    this.worker.terminate();
    for (const [, entry] of this.#pending) {
      entry.controller.abort();
      entry.reject(aborted());
    }
    this.#pending.clear();
    this.#queue = [];
  }

  /**
   * @param {string} method
   * @param {unknown[]} args
   * @param {Asking & {host?: SheetHost}} how
   * @returns {Promise<any>}
   */
  #call(method, args, { progress = () => {}, signal, host } = {}) {
    if (this.closed) return Promise.reject(aborted());
    this.#calls += 1;
    const call = this.#calls;
    return new Promise((resolve, reject) => {
      const controller = new AbortController();
      const cancel = () => {
        this.worker.postMessage({ cancel: call });
        this.#end(call);
        reject(aborted());
      };
      signal?.addEventListener("abort", cancel, { once: true });
      const done = (/** @type {(value: any) => void} */ then) => (/** @type {any} */ value) => {
        signal?.removeEventListener("abort", cancel);
        then(value);
      };
      this.#pending.set(call, { resolve: done(resolve), reject: done(reject), progress, controller, host });
      this.worker.postMessage({ call, method, args });
    });
  }

  /** @param {number} call */
  #end(call) {
    const entry = this.#pending.get(call);
    this.#pending.delete(call);
    this.#queue = this.#queue.filter((n) => n.call !== call);
    entry?.controller.abort();
    return entry;
  }

  /** @param {any} data a message of the worker */
  #take(data) {
    if (data.method) {
      this.#answer(data);
      return;
    }
    if (data.need) {
      this.#queue.push(data);
      this.#next();
      return;
    }
    if ("all" in data) {
      this.#pending.get(data.call)?.progress({ done: data.done, all: data.all });
      return;
    }
    const entry = this.#end(data.call);
    const error = data.error && (entry?.failure ?? Object.assign(new Error(data.error), { said: data.said }));
    if (data.broken) this.#lost(data.error);
    if (error) entry?.reject(error);
    else entry?.resolve(data.result);
  }

  /**
   * A worker that ended takes every question with it.
   * @param {string} message
   */
  #lost(message) {
    this.closed = true;
    this.worker.terminate();
    for (const call of [...this.#pending.keys()]) this.#end(call)?.reject(new Error(message));
  }

  /** The newest question first, its needs in order. */
  #next() {
    while (this.#running < IN_FLIGHT && this.#queue.length > 0) {
      const newest = Math.max(...this.#queue.map((n) => n.call));
      const [need] = this.#queue.splice(
        this.#queue.findIndex((n) => n.call === newest),
        1,
      );
      this.#fetch(need);
    }
  }

  /** @param {Need} need */
  async #fetch(need) {
    const entry = this.#pending.get(need.call);
    if (!entry) return;
    this.#running += 1;
    try {
      const bytes = await this.#bytes(need, entry.controller.signal, entry.progress);
      this.worker.postMessage({ got: need.need, bytes }, [bytes.buffer]);
    } catch (error) {
      if (error.name !== "AbortError") entry.failure = error;
      this.worker.postMessage({ got: need.need, error: String(error.message ?? error) });
    } finally {
      this.#running -= 1;
      this.#next();
    }
  }

  /**
   * Answer a request that a drawing makes to its host.
   * @param {{need: number, call: number, method: keyof SheetHost, args: any[]}} asked
   */
  async #answer({ need, call, method, args }) {
    const entry = this.#pending.get(call);
    if (!entry?.host) return;
    try {
      /** @type {(...args: any[]) => unknown} */
      const act = entry.host[method];
      const answer = await act(entry.controller.signal, ...args);
      this.worker.postMessage({ got: need, bytes: answer });
    } catch (error) {
      entry.failure = error;
      this.worker.postMessage({ got: need, error: String(error.message || error) });
    }
  }

  /**
   * Bytes of the pack; what passes is waited for as long as somebody wants them.
   * @param {{offset: number, length: number, fresh?: boolean}} need
   * @param {AbortSignal} signal
   * @param {(progress: Progress) => void} progress
   */
  async #bytes({ offset, length, fresh = false }, signal, progress) {
    for (let attempt = 0; ; attempt += 1) {
      try {
        const bytes = await this.source.range(offset, length, signal, { fresh });
        this.fetched += bytes.length;
        // A view of something larger would take all of it along.
        return bytes.byteLength === bytes.buffer.byteLength ? bytes : bytes.slice();
      } catch (error) {
        signal.throwIfAborted();
        if (!isPassing(error)) throw error;
        const seconds = Math.min(30, 2 ** attempt) * (0.75 + Math.random() / 2);
        progress({ waiting: seconds });
        await pause(seconds, signal);
      }
    }
  }
}

/**
 * Some seconds, or until the connection is back.
 * @param {number} seconds
 * @param {AbortSignal} signal
 * @returns {Promise<void>}
 */
function pause(seconds, signal) {
  return new Promise((resolve, reject) => {
    const end = () => {
      clearTimeout(timer);
      removeEventListener("online", end);
      signal.removeEventListener("abort", end);
      if (signal.aborted) reject(aborted());
      else resolve();
    };
    const timer = setTimeout(end, seconds * 1000);
    addEventListener("online", end);
    signal.addEventListener("abort", end);
  });
}
