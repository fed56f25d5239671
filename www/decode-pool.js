// A few workers that decode; each has one job at a time, so that what is no longer wanted never starts. Where none can be started (its
// script or its program do not come) the jobs wait, and it is tried again for as long as the pool lives.

/** First and longest wait until it is tried again, milliseconds. */
const AGAIN_MS = [500, 30_000];

/**
 * @typedef {{bytes: Uint8Array<ArrayBuffer>, vertices: number, triangles: number, checksum: Uint8Array, colors: boolean, scalars: number}} DecodeTask
 * @typedef {{vertices: Uint8Array, indices: Uint32Array, patches: Uint32Array, scalars: Float32Array}} Decoded
 * @typedef {{key: number, task: DecodeTask, resolve: (decoded: Decoded) => void, reject: (error: Error) => void}} Waiting
 */

export class DecodePool {
  /** @param {number} size number of workers: by default one less than there are cores, and at most four */
  constructor(size = Math.max(1, Math.min(4, (navigator.hardwareConcurrency ?? 2) - 1))) {
    this.size = size;
    /** @type {Worker[]} */
    this.idle = [];
    /** @type {Set<Worker>} */
    this.workers = new Set();
    /** @type {Waiting[]} */
    this.waiting = [];
    /** By job. @type {Map<number, Waiting & {worker: Worker}>} */
    this.running = new Map();
    this.jobs = 0;
    /** @type {Promise<WebAssembly.Module> | null} */
    this.module = null;
    this.failures = 0; // workers that did not start, in a row
    /** @type {ReturnType<typeof setTimeout> | null} */
    this.pausing = null;
    /** Called with the seconds until it is tried again. @type {(seconds: number) => void} */
    this.onWait = () => {};
  }

  /** Start the first worker before there is anything to decode. */
  warm() {
    this.#start().then(() => this.#next());
    return this;
  }

  /**
   * Decode `task` (a chunk's bytes and what the directory declares); resolves to its buffers. `key` is for `drop`.
   * @param {number} key
   * @param {DecodeTask} task
   * @returns {Promise<Decoded>}
   */
  decode(key, task) {
    return new Promise((resolve, reject) => {
      this.waiting.push({ key, task, resolve, reject });
      this.#next();
    });
  }

  /**
   * Forget what waits under this key; a running job ends, and its result is the caller's to ignore.
   * @param {number} key
   */
  drop(key) {
    this.waiting = this.waiting.filter((w) => w.key !== key);
  }

  close() {
    clearTimeout(this.pausing ?? undefined);
    for (const worker of this.workers) worker.terminate();
    this.workers.clear();
    this.idle = [];
    this.waiting = [];
  }

  async #next() {
    if (this.waiting.length === 0) return;
    if (this.idle.length === 0) {
      if (this.workers.size >= this.size || this.pausing) return;
      await this.#start();
    }
    const worker = this.idle.pop();
    if (!worker) return;
    const next = this.waiting.shift();
    if (!next) {
      this.idle.push(worker);
      return;
    }
    this.jobs += 1;
    const job = this.jobs;
    this.running.set(job, { worker, ...next });
    worker.postMessage({ job, ...next.task }, [next.task.bytes.buffer]);
  }

  /** The decoder, compiled once for all workers; if it did not load, the next one that needs it asks again. */
  #compiled() {
    this.module ??= WebAssembly.compileStreaming(fetch(new URL("decode_bg.wasm", import.meta.url))).catch((error) => {
      this.module = null;
      throw error;
    });
    return this.module;
  }

  async #start() {
    const worker = new Worker(new URL("decode-worker.js", import.meta.url), { type: "module" });
    this.workers.add(worker);
    worker.onmessage = ({ data }) => this.#done(worker, data);
    worker.onerror = (event) => this.#lost(worker, event.message || "the decoding worker did not start");
    try {
      const module = await this.#compiled();
      if (!this.workers.has(worker)) return; // its script failed, or the pool was closed
      worker.postMessage({ module });
      this.idle.push(worker);
    } catch (error) {
      this.#lost(worker, String(error?.message ?? error));
    }
  }

  /**
   * @param {Worker} worker
   * @param {Decoded & {job: number, error?: string, broken?: boolean}} answer
   */
  #done(worker, { job, error, broken, ...decoded }) {
    const entry = this.running.get(job);
    this.running.delete(job);
    this.failures = 0;
    if (broken) {
      this.workers.delete(worker);
      worker.terminate();
    } else {
      this.idle.push(worker);
    }
    if (error) entry?.reject(new Error(error));
    else entry?.resolve(decoded);
    this.#next();
  }

  /**
   * @param {Worker} worker
   * @param {string} message
   */
  #lost(worker, message) {
    worker.terminate();
    this.workers.delete(worker);
    this.idle = this.idle.filter((w) => w !== worker);
    const lost = [...this.running].filter(([, entry]) => entry.worker === worker);
    for (const [job, entry] of lost) {
      this.running.delete(job);
      entry.reject(new Error(message));
    }
    // Without any worker nothing that waits would ever end.
    if (this.workers.size === 0 && this.waiting.length > 0) this.#again();
  }

  #again() {
    if (this.pausing) return;
    const [first, longest] = AGAIN_MS;
    const wait = Math.min(longest, first * 2 ** this.failures);
    this.failures += 1;
    this.onWait(Math.ceil(wait / 1000));
    this.pausing = setTimeout(() => {
      this.pausing = null;
      for (let k = Math.min(this.size, this.waiting.length); k > 0; k -= 1) this.#next();
    }, wait);
  }
}
