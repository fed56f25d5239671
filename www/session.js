// One open model: carries out what the viewer asks for (fetch, decode) and draws a frame whenever something changed.
// The viewer (wasm) decides; nothing here knows what a chunk looks like.

import { isPassing } from "./answer.js";

/** @import { Command, DecodeCommand, Failure, FrameStats, PackSource, Viewer } from "./types/page.js" */
/** @typedef {ReturnType<typeof setTimeout> | null} Timer */

/**
 * @typedef {object} SessionEvents
 * @property {(stats: FrameStats) => void} frame a frame was drawn
 * @property {() => void} first something of the model is on screen
 * @property {(seconds: number) => void} waits nothing can be decoded; it is tried again in some seconds
 * @property {(error: Failure) => void} changed the file is another one now
 * @property {(error: Failure) => void} lost bytes did not come and will not
 * @property {(chunk: number, error: Failure) => void} damaged a chunk cannot be decoded
 * @property {(error: Failure) => void} broken the program itself failed
 */

/** Most bytes of the directory that are kept for whoever measures. */
const KEPT_PAGES = 8 << 20;
/** So long after something came the next frame is waited for, milliseconds: longer than one of a sixtieth of a second. */
const PATIENCE_MS = 25;
/** So long after the last frame the model goes on coming without one, milliseconds: a page that nobody sees gets none. */
const UNSEEN_MS = 2000;
/** Frames that take longer to come are slow, milliseconds. */
const SLOW_MS = 100;
const LONGEST_PAUSE_MS = 250;

export class Session {
  /**
   * @param {object} parts
   * @param {HTMLCanvasElement} parts.canvas
   * @param {Viewer} parts.viewer
   * @param {PackSource} parts.pack
   * @param {Uint8Array<ArrayBuffer>} parts.head
   * @param {import("./decode-pool.js").DecodePool} parts.pool
   * @param {{colors: boolean, scalars: number}} parts.attributes
   * @param {SessionEvents} parts.on
   * @param {(draw: (now: number) => void) => void} [parts.nextFrame] where frames come from: a headset has its own
   */
  constructor({ canvas, viewer, pack, head, pool, attributes, on, nextFrame = (draw) => requestAnimationFrame(draw) }) {
    this.canvas = canvas;
    this.viewer = viewer;
    this.pack = pack;
    this.head = head;
    this.pool = pool;
    this.attributes = attributes;
    this.on = on;
    this.nextFrame = nextFrame;
    /** By request. @type {Map<number, AbortController>} */
    this.inFlight = new Map();
    /** Bytes of the directory as they came, by their offset in the file. @type {Map<number, Uint8Array>} */
    this.pages = new Map();
    /** Answers by request, until the step that takes them in. @type {Map<number, Uint8Array>} */
    this.answers = new Map();
    /** By chunk, the number of its newest job. @type {Map<number, number>} */
    this.decoding = new Map();
    /** By chunk, how many times in a row it was damaged. @type {Map<number, number>} */
    this.damaged = new Map();
    this.suspect = false; // the next requests go round the browser's own store
    this.jobs = 0;
    this.scheduled = false;
    this.closed = false;
    this.drawn = false;
    this.frames = 0;
    this.lag = 0; // from asking for a frame to its beginning, milliseconds
    this.framedAt = performance.now();
    this.now = 0; // the viewer's clock
    this.ratio = 1; // pixels of the picture for one of CSS
    /** Of the last frame. @type {FrameStats | null} */
    this.stats = null;
    /** Why bytes did not come, the last time that they did not. @type {Failure | null} */
    this.lastFailure = null;
    /** Called after each frame, and when the session ends. @type {Set<() => void>} */
    this.watchers = new Set();
    /** @type {Timer} */
    this.pausing = null;
    /** @type {Timer} */
    this.attending = null;
    /** @type {Timer} */
    this.retry = null;
    this.sized = false;
    this.showFirst = () => {};
    /** @type {Promise<void>} */
    this.firstPicture = new Promise((resolve) => {
      this.showFirst = resolve;
    });
    pool.onWait = on.waits;
    viewer.setRanges(pack.maxRanges);
    this.observer = new ResizeObserver(() => this.resize());
    this.observer.observe(canvas);
    this.resize();
  }

  /** Whether the last frame shows all data that arrived and all changes that were made: nothing more will change by itself. */
  get isSettled() {
    const { stats, scheduled, pausing, answers } = this;
    return Boolean(stats?.settled && !stats.more && !scheduled && !pausing && answers.size === 0);
  }

  /** Draw soon. */
  wake() {
    if (this.scheduled || this.closed) return;
    this.scheduled = true;
    clearTimeout(this.pausing ?? undefined);
    this.pausing = null;
    const asked = performance.now();
    this.nextFrame((now) => {
      this.scheduled = false;
      this.lag = performance.now() - asked;
      this.#guarded(() => this.#frame(now));
    });
  }

  /**
   * Draw what came by itself. Where frames are slow to come (no graphics card: the processor draws), as long again is left to what
   * fetches and decodes: the model is there sooner. What a person does is drawn at once. Levels do not fade there, so that what came
   * shows in the first frame after it.
   */
  #wakeInTurn() {
    if (this.scheduled || this.pausing || this.closed) return;
    if (!this.drawn || this.lag < SLOW_MS) this.wake();
    else this.pausing = setTimeout(() => this.wake(), Math.min(this.lag, LONGEST_PAUSE_MS));
  }

  /** The picture has as many pixels as the screen, up to two per CSS pixel. */
  resize() {
    const ratio = Math.min(devicePixelRatio || 1, 2);
    const width = Math.max(1, Math.round(this.canvas.clientWidth * ratio));
    const height = Math.max(1, Math.round(this.canvas.clientHeight * ratio));
    this.ratio = ratio;
    if (this.canvas.width === width && this.canvas.height === height && this.sized) return;
    this.sized = true;
    this.canvas.width = width;
    this.canvas.height = height;
    this.viewer.resize(width, height);
    this.wake();
  }

  close() {
    this.closed = true;
    for (const timer of [this.retry, this.attending, this.pausing]) clearTimeout(timer ?? undefined);
    this.observer.disconnect();
    for (const controller of this.inFlight.values()) controller.abort();
    this.pool.close();
    this.viewer.free();
    this.#tellWatchers();
  }

  #tellWatchers() {
    for (const look of [...this.watchers]) look();
  }

  /** @param {() => void} action */
  #guarded(action) {
    if (this.closed) return;
    try {
      action();
    } catch (error) {
      this.closed = true;
      this.on.broken(error);
      this.#tellWatchers();
    }
  }

  /**
   * Something came; it shows in the next frame. Where the browser gives none for a while (a slow graphics card, shaders being compiled),
   * what it leads to is asked for and decoded meanwhile, so that the line and the workers do not stand still.
   */
  #came() {
    this.#wakeInTurn();
    if (this.attending || this.closed) return;
    this.attending = setTimeout(() => {
      this.attending = null;
      const isSeen = !document.hidden && performance.now() - this.framedAt < UNSEEN_MS;
      if (isSeen) this.#guarded(() => this.#carryOut(this.viewer.attend(this.#tick(performance.now()))));
    }, PATIENCE_MS);
  }

  /**
   * A frame's time is that of its beginning: before what was done since. The viewer's clock never runs backwards.
   * @param {number} now
   */
  #tick(now) {
    this.now = Math.max(this.now, now);
    return this.now;
  }

  /** @param {number} now */
  #frame(now) {
    clearTimeout(this.attending ?? undefined); // This frame takes in all that came.
    this.attending = null;
    /** @type {{commands: Command[], stats: FrameStats}} */
    const { commands, stats } = this.viewer.frame(this.#tick(now), this.lag >= SLOW_MS);
    this.#carryOut(commands);
    this.stats = stats;
    this.frames += 1;
    this.framedAt = performance.now();
    if (!this.drawn && stats.patchesDrawn > 0) {
      this.drawn = true;
      this.showFirst();
      this.on.first();
    }
    clearTimeout(this.retry ?? undefined);
    if (stats.more) this.#wakeInTurn();
    else if (stats.retryInMs >= 0) this.retry = setTimeout(() => this.wake(), Math.max(stats.retryInMs, 16));
    // Such a wait may end with nothing new to draw, but the status line says when.
    else if (this.pack.held > 0) this.retry = setTimeout(() => this.wake(), 1000);
    this.on.frame(stats);
    this.#tellWatchers();
  }

  /**
   * All that a step asks for; after it the answers that it took in are not needed.
   * @param {Command[]} commands
   */
  #carryOut(commands) {
    for (const command of commands) this.#do(command);
    this.answers.clear();
  }

  /** @param {Command} command */
  #do(command) {
    switch (command.type) {
      case "fetch":
        this.#fetch(command);
        break;
      case "cancel":
        this.inFlight.get(command.request)?.abort();
        break;
      case "decode":
        this.#decode(command);
        break;
      case "evict":
        this.decoding.delete(command.chunk);
        this.pool.drop(command.chunk);
        break;
    }
  }

  /** @param {Extract<Command, {type: "fetch"}>} command */
  async #fetch({ request, parts, pages }) {
    const [offset] = parts;
    const ranges = [];
    let length = 0;
    for (let i = 0; i < parts.length; i += 2) {
      ranges.push(`${parts[i]}-${parts[i] + parts[i + 1] - 1}`);
      length += parts[i + 1];
    }
    const controller = new AbortController();
    this.inFlight.set(request, controller);
    const fresh = this.suspect;
    try {
      await null; // the other commands of this step first
      // While the root chunk is being decoded from the head, nothing competes with the first picture.
      if (!this.drawn && this.decoding.has(0)) await this.firstPicture;
      // Chunks that are complete are decoded while the rest of the answer is on its way.
      const onPart = (/** @type {Uint8Array} */ bytes, /** @type {number} */ count) => {
        if (pages || count === length || !this.inFlight.has(request)) return;
        this.answers.set(request, bytes);
        this.#guarded(() => this.viewer.onProgress(request, count));
        this.#came();
      };
      const bytes = await this.pack.range(offset, length, controller.signal, {
        fresh,
        onPart,
        ranges: ranges.length > 1 ? ranges.join() : "",
      });
      this.suspect = false;
      this.#guarded(() => {
        if (pages) {
          this.viewer.onPageBytes(request, bytes);
          this.#keepPages(parts, bytes);
        } else {
          this.answers.set(request, bytes);
          this.viewer.onBytes(request, bytes.length);
        }
      });
    } catch (error) {
      if (error.name === "AbortError") return;
      this.#guarded(() => {
        this.viewer.setRanges(this.pack.maxRanges);
        this.viewer.onFailed(request);
      });
      this.lastFailure = error;
      if (error.kind === "changed") this.on.changed(error);
      else if (!isPassing(error)) this.on.lost(error);
    } finally {
      this.inFlight.delete(request);
      this.#came();
    }
  }

  /**
   * For whoever measures.
   * @param {number[]} parts
   * @param {Uint8Array} bytes
   */
  #keepPages(parts, bytes) {
    for (let i = 0, at = 0; i < parts.length; at += parts[i + 1], i += 2) {
      if ((this.pages.size + 1) * parts[i + 1] > KEPT_PAGES) break;
      this.pages.set(parts[i], bytes.subarray(at, at + parts[i + 1]));
    }
  }

  /**
   * The bytes of a part of the head again, round the browser's own store: they may have been damaged on the way.
   * @param {number} offset
   * @param {number} length
   */
  async #repairHead(offset, length) {
    try {
      this.head.set(await this.pack.range(offset, length, undefined, { fresh: true }), offset);
    } catch (error) {
      this.lastFailure = error;
    }
  }

  /** @param {DecodeCommand} command */
  async #decode({ chunk, request, offset, length, vertices, triangles, checksum }) {
    this.jobs += 1;
    const job = this.jobs;
    this.decoding.set(chunk, job);
    const source = request === 0 ? this.head : this.answers.get(request);
    const bytes = source?.slice(offset, offset + length) ?? new Uint8Array();
    const isWanted = () => this.decoding.get(chunk) === job;
    try {
      const decoded = await this.pool.decode(chunk, { bytes, vertices, triangles, checksum, ...this.attributes });
      if (!isWanted()) return;
      this.damaged.delete(chunk);
      this.#guarded(() => this.viewer.onDecoded(chunk, decoded.vertices, decoded.indices, decoded.patches, decoded.scalars));
    } catch (error) {
      if (!isWanted()) return;
      const times = (this.damaged.get(chunk) ?? 0) + 1;
      this.damaged.set(chunk, times);
      this.suspect = true;
      if (request === 0) await this.#repairHead(offset, length);
      this.#guarded(() => this.viewer.onDecodeFailed(chunk));
      if (times >= 2) this.on.damaged(chunk, error);
    } finally {
      if (isWanted()) this.decoding.delete(chunk);
      this.#came();
    }
  }
}
