// The worker that measures: wasm in a thread of its own, so that the picture never waits for it. The page fetches the bytes; here they are asked
// for (`need`) and come (`got`). Messages: see engine.js.
import init, { Engine } from "../measure.js";

// The page fetches the program while this code is on its way, and sends it.
let begin;
const ready = new Promise((resolve) => (begin = resolve)).then((module) => init({ module_or_path: module }));
ready.catch(() => {}); // whoever asks hears of it
let engine;
let drawing; // the drawing to scale that is being made
let broken; // what a trap said: the instance is of no use after it
let needs = 0;
const waiting = new Map(); // need → { call, resolve, reject }
const cancelled = new Set();

const gone = () => new DOMException("the question was taken back", "AbortError");

/** The two functions that a question fetches and tells with. */
function ways(call) {
  const fetch = (offset, length, fresh) => {
    const need = (needs += 1);
    const bytes = new Promise((resolve, reject) => {
      if (cancelled.has(call)) reject(gone());
      else waiting.set(need, { call, resolve, reject });
    });
    bytes.catch(() => {}); // what was fetched ahead may never be looked at
    if (waiting.has(need)) postMessage({ need, call, offset, length, fresh });
    return bytes;
  };
  return [fetch, (done, all) => postMessage({ call, done, all })];
}

const methods = {
  open: (_, head, pages, footer) => {
    engine = new Engine(head, pages, footer);
    return JSON.parse(engine.pack());
  },
  /** What the viewer knows: chunks without anything of the finest surface. */
  leafless: (_, chunks) => engine.areLeafless(chunks),
  pick: async (call, asked) => JSON.parse(await engine.pick(JSON.stringify(asked), ...ways(call))),
  measure: async (call, asked) => JSON.parse(await engine.measure(JSON.stringify(asked), ...ways(call))),
  write: (_, what, format, scale) => engine.write(JSON.stringify(what), format, scale),
  read: (_, text) => JSON.parse(engine.read(text)),
  drawing: (_, asked) => {
    drawing?.free();
    drawing = null;
    drawing = engine.drawing(JSON.stringify(asked));
    return JSON.parse(drawing.told());
  },
  band: (_, number) => JSON.parse(drawing.band(number)),
  strip: (_, rows, length) => drawing.strip(rows, length),
  drawingEnd: () => drawing.end(),
  shown: (_, readings, unit) => JSON.parse(engine.shown(JSON.stringify(readings), unit)),
  cite: (_, measurement, unit) => engine.cite(JSON.stringify(measurement), unit),
};

function got({ got: need, bytes, error }) {
  const entry = waiting.get(need);
  waiting.delete(need);
  if (error) entry?.reject(new Error(error));
  else entry?.resolve(bytes);
}

function cancel(call) {
  cancelled.add(call);
  for (const [need, entry] of waiting) {
    if (entry.call !== call) continue;
    waiting.delete(need);
    entry.reject(gone());
  }
}

onmessage = async ({ data }) => {
  if (data.module) return begin(data.module);
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
};
