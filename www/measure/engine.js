// Measuring, as the page sees it: questions go to a worker (measure/worker.js, wasm), bytes are fetched here through the page's own loader.
//
// const engine = await Engine.open({ pack, head, viewer, pages, footer, program });
//   pack    loader.js Pack or LocalPack; head  its first bytes; viewer  a function that gives the wasm Viewer in force, for provisional values;
//   pages   a function that gives what the viewer has of the directory (offset in the file → bytes); footer  the pack's last bytes, or null;
//   program  a promise of the compiled module
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
//     or { refusal: "English sentence", said: { code, values } }.  `printed` are the very digits of `kilwa measure`; a remark is { code, values, english }.
//     said.js says both in the language of the page.
//   level        how far the points may still be from the finest surface, metres: then the answer is provisional, from the points alone
// engine.shown(readings, unit)            → printed: the same readings in another unit
// engine.cite(measurement, { unit })      → one English sentence, that of `kilwa measure --cite`; cite.js says it in the language of the page
// engine.write(what, format, { scale })   → text; what: a document (json, csv, geojson, dxf) or an answer with lines (those and svg)
// engine.read(text)                       → document, with `same`: false where it is of another pack; its points are counted from this pack's origin
// engine.drawing({ view, scale, dpi, paper, bare, title, format, widest }) → a drawing to scale, for sheet.js; one at a time
// engine.close()
//
// Progress: { done, all } bytes, all is 0 where nobody knows; { waiting: seconds } while the connection is gone. A signal that is aborted rejects with
// an AbortError; a pack that changed or cannot be read with a sentence (`said` where it is the engine's, `kind` where it is the network's). Questions asked last are fetched for first.

import { isPassing } from "../loader.js";

/** Requests on their way at a time. */
const IN_FLIGHT = 6;

/** Bytes of the footer and of a directory page, entries in a page, and where the header says what (docs/FORMAT.md, sections 3, 4 and 7). */
const [FOOTER_BYTES, PAGE_BYTES, PAGE_ENTRIES] = [80, 16_384, 127];
const [FILE_BYTES_AT, ENTRIES_AT, PAGES_AT] = [64, 84, 112];

const aborted = () => new DOMException("the question was taken back", "AbortError");

export class Engine {
  /** Open a pack for measuring: what is missing of its directory comes while the program does. */
  static async open({ pack, head, viewer = () => null, pages = () => new Map(), footer = null, program }) {
    const engine = new Engine(pack, viewer);
    try {
      program.then(
        (module) => engine.worker.postMessage({ module }),
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
  #open_ = new Map(); // call → { resolve, reject, progress, controller }
  #queue = []; // { need, call, offset, length, fresh }
  #running = 0;

  constructor(source, viewer) {
    this.source = source;
    this.viewer = viewer;
    this.fetched = 0;
    this.worker = new Worker(new URL("measure/worker.js", import.meta.url), { type: "module" });
    this.worker.onmessage = ({ data }) => this.#said(data);
    this.worker.onerror = (event) => this.#lost(event.message || "the measuring worker did not start");
  }

  async #open(head, kept, given) {
    this.hold = new AbortController();
    const view = new DataView(head.buffer, head.byteOffset);
    const number = (at) => Number(view.getBigUint64(at, true));
    const count = Math.ceil(view.getUint32(ENTRIES_AT, true) / PAGE_ENTRIES);
    const wanted = { offset: number(PAGES_AT), count: Math.max(0, count - 1) };
    const ask = async (fresh) => {
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

  #range(offset, length, fresh = false) {
    return this.#bytes({ offset, length, fresh }, this.hold.signal, () => {});
  }

  /** Pages of the directory from the second on: those that the viewer has are not fetched again. */
  async #directory({ offset, count }, kept, fresh) {
    const out = new Uint8Array(count * PAGE_BYTES);
    const have = new Uint8Array(count);
    for (const [at, bytes] of kept) {
      const first = (at - offset) / PAGE_BYTES;
      if (!Number.isInteger(first) || first < 0 || at - offset + bytes.length > out.length) continue;
      out.set(bytes, at - offset);
      have.fill(1, first, first + Math.floor(bytes.length / PAGE_BYTES));
    }
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

  /** Where a ray meets the finest surface first. */
  async pick({ origin, direction }, { clip, snap = "none", within, provisional, progress, signal } = {}) {
    signal?.throwIfAborted();
    const viewer = this.viewer();
    if (provisional && viewer) {
      const said = viewer.provisional(new Float64Array([...origin, ...direction]));
      provisional(said ? JSON.parse(said) : null);
    }
    const state = clip ?? (viewer ? JSON.parse(viewer.displayState()) : {});
    const { clipPlane, clipBox } = state ?? {};
    const asked = { origin: [...origin], direction: [...direction], clip: { clipPlane, clipBox }, snap, within };
    this.#leafless(viewer);
    return this.#call("pick", [asked], { progress, signal });
  }

  /** Measure a task of a document. */
  async measure(task, { unit = "m", level, progress, signal } = {}) {
    signal?.throwIfAborted();
    if (!(level > 0)) this.#leafless(this.viewer());
    return this.#call("measure", [{ task, unit, level }], { progress, signal });
  }

  /** What the viewer has decoded need not be fetched to find that it holds nothing of the finest surface. */
  #leafless(viewer) {
    if (viewer) this.#call("leafless", [viewer.leafless()]).catch(() => {}); // what comes after says it
  }

  shown(readings, unit) {
    return this.#call("shown", [readings, unit]);
  }

  cite(measurement, { unit = "m" } = {}) {
    return this.#call("cite", [measurement, unit]);
  }

  /** `size`, `paper`, `pixelsPerMm`, `metresPerPixel`, `marks`, `bands` (how many), `world`, and what is asked for band by band. */
  async drawing(asked) {
    const told = await this.#call("drawing", [asked]);
    return {
      ...told,
      band: (number) => this.#call("band", [number]),
      strip: (rows, length) => this.#call("strip", [rows, length]),
      end: () => this.#call("drawingEnd", []),
    };
  }

  write(what, format, { scale = 50 } = {}) {
    return this.#call("write", [what, format, scale]);
  }

  read(text) {
    return this.#call("read", [text]);
  }

  close() {
    this.closed = true;
    this.hold?.abort();
    this.worker.terminate();
    for (const [, entry] of this.#open_) {
      entry.controller.abort();
      entry.reject(aborted());
    }
    this.#open_.clear();
    this.#queue = [];
  }

  #call(method, args, { progress = () => {}, signal } = {}) {
    if (this.closed) return Promise.reject(aborted());
    const call = (this.#calls += 1);
    return new Promise((resolve, reject) => {
      const controller = new AbortController();
      const cancel = () => {
        this.worker.postMessage({ cancel: call });
        this.#end(call);
        reject(aborted());
      };
      signal?.addEventListener("abort", cancel, { once: true });
      const done = (then) => (value) => {
        signal?.removeEventListener("abort", cancel);
        then(value);
      };
      this.#open_.set(call, { resolve: done(resolve), reject: done(reject), progress, controller });
      this.worker.postMessage({ call, method, args });
    });
  }

  #end(call) {
    const entry = this.#open_.get(call);
    this.#open_.delete(call);
    this.#queue = this.#queue.filter((n) => n.call !== call);
    entry?.controller.abort();
    return entry;
  }

  #said(data) {
    if (data.need) {
      this.#queue.push(data);
      this.#next();
      return;
    }
    if ("all" in data) {
      this.#open_.get(data.call)?.progress({ done: data.done, all: data.all });
      return;
    }
    const entry = this.#end(data.call);
    const error = data.error && (entry?.failure ?? Object.assign(new Error(data.error), { said: data.said }));
    if (data.broken) this.#lost(data.error);
    if (error) entry?.reject(error);
    else entry?.resolve(data.result);
  }

  /** A worker that ended takes every question with it. */
  #lost(message) {
    this.closed = true;
    this.worker.terminate();
    for (const call of [...this.#open_.keys()]) this.#end(call)?.reject(new Error(message));
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

  async #fetch(need) {
    const entry = this.#open_.get(need.call);
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

  /** Bytes of the pack; what passes is waited for as long as somebody wants them. */
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

/** Some seconds, or until the connection is back. */
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
