// The worker that measures: wasm in a thread of its own, so that the picture never waits for it. The page fetches the bytes; here they are asked
// for (`need`) and come (`got`). Messages: see engine.js.
import * as surfaces from "../measure.js";
import { sheetHost } from "./drawing.js";

/** @typedef {{module: WebAssembly.Module, points: boolean}} Program the program that was compiled; whether it is that of packs of points */

// The page fetches the program while this code is on its way, and sends it.
/** @type {(program: Program) => void} */
let begin = () => {};
/** @type {Promise<Program>} */
const compiled = new Promise((resolve) => {
  begin = resolve;
});
const ready = compiled.then(async ({ module, points }) => {
  const program = points ? await import("../measure-points.js") : surfaces;
  await program.default({ module_or_path: module });
  return program.Engine;
});
ready.catch(() => {}); // whoever asks hears of it
/** The pack that is open. @type {surfaces.Engine} */
let engine;
/** What a trap left behind: the instance is of no use after it. @type {Error | null} */
let broken = null;
let needs = 0;
/** Requests to the page, by number. @type {Map<number, {call: number, resolve: (bytes: Uint8Array) => void, reject: (error: Error) => void}>} */
const waiting = new Map();
/** @type {Set<number>} */
const cancelled = new Set();

const gone = () => new DOMException("the question was taken back", "AbortError");

/**
 * Ask the page for something that a question needs.
 * @param {number} call
 * @param {object} what bytes of the pack, or a `method` of the drawing's host
 * @param {Transferable[]} [transfer]
 * @returns {Promise<any>}
 */
function ask(call, what, transfer = []) {
  needs += 1;
  const need = needs;
  const answer = new Promise((resolve, reject) => {
    if (cancelled.has(call)) reject(gone());
    else waiting.set(need, { call, resolve, reject });
  });
  answer.catch(() => {}); // bytes that were fetched ahead may never be used
  if (waiting.has(need)) postMessage({ need, call, ...what }, { transfer });
  return answer;
}

/**
 * The two functions that a question fetches with and reports its progress with.
 * @param {number} call
 * @returns {[Fetch, (done: number, all: number) => void]}
 */
function ways(call) {
  return [(offset, length, fresh) => ask(call, { offset, length, fresh }), (done, all) => postMessage({ call, done, all })];
}

/** @typedef {(offset: number, length: number, fresh: boolean) => Promise<Uint8Array>} Fetch */

/** What the page may ask; the first argument is the number of the question. @type {Record<string, (call: number, ...args: any[]) => unknown>} */
const methods = {
  open: async (_, head, pages, footer) => {
    const Engine = await ready;
    engine = new Engine(head, pages, footer);
    return JSON.parse(engine.pack());
  },
  /** What the viewer knows: chunks without anything of the finest surface. */
  leafless: (_, chunks) => engine.areLeafless(chunks),
  pick: async (call, asked) => JSON.parse(await engine.pick(JSON.stringify(asked), ...ways(call))),
  measure: async (call, asked) => JSON.parse(await engine.measure(JSON.stringify(asked), ...ways(call))),
  write: (_, what, format, scale) => engine.write(JSON.stringify(what), format, scale),
  read: (_, text) => JSON.parse(engine.read(text)),
  drawing: async (call, asked) => {
    const host = sheetHost(asked, (method, args, transfer) => ask(call, { method, args }, transfer), ways(call)[1]);
    return JSON.parse(await engine.drawSheet(JSON.stringify(asked), host));
  },
  shown: (_, readings, unit) => JSON.parse(engine.shown(JSON.stringify(readings), unit)),
  cite: (_, measurement, unit) => engine.cite(JSON.stringify(measurement), unit),
};

/** @param {{got: number, bytes: Uint8Array, error?: string}} answer */
function got({ got: need, bytes, error }) {
  const entry = waiting.get(need);
  waiting.delete(need);
  if (error) entry?.reject(new Error(error));
  else entry?.resolve(bytes);
}

/** @param {number} call */
function cancel(call) {
  cancelled.add(call);
  for (const [need, entry] of waiting) {
    if (entry.call !== call) continue;
    waiting.delete(need);
    entry.reject(gone());
  }
}

/** @param {MessageEvent} event */
async function take({ data }) {
  if (data.module) return begin(data);
  if (data.got) return got(data);
  if (data.cancel) return cancel(data.cancel);
  const { call, method, args } = data;
  try {
    if (broken) throw broken;
    await ready;
    const result = await methods[method](call, ...args);
    postMessage({ call, result });
  } catch (error) {
    if (error instanceof WebAssembly.RuntimeError) broken = error;
    postMessage({ call, error: String(error?.message ?? error), said: error?.said ? JSON.parse(error.said) : null, broken: Boolean(broken) });
  } finally {
    cancel(call); // what was fetched ahead and not needed
    cancelled.delete(call);
  }
}

addEventListener("message", take);
