// The pack over HTTP: ranges, and what a server can get wrong about them.
//
// The first answer fixes the length and the ETag of the file. Every later answer is compared with them, and its length
// with what was asked for; checksums (in the decoder) catch the rest. A server that ignores Range is put up with where the
// whole file is small: it is read once, front to back, and parts are given out as they come; the coarse levels lie in front. Where it is
// large it is refused with its size, which the file itself states where the server does not (docs/FORMAT.md, section 3).
//
// A server that asks to wait (429, 503) is not asked for anything until the time is over: every request waits, and the one that was refused is made again.

import { contentRange, discard, isSameTag, LENGTH_END, PackError, read, readStart, statedLength, waitOf } from "./answer.js";

// Other modules that ask for parts take it from here, so that the bundle has one file for both modules (each costs its headers before the first picture).
export { isPassing } from "./answer.js";

/** Length of the first request: header, metadata, the first directory page and the coarsest chunks. */
export const HEAD_BYTES = 65536;
/** A pack up to this size is taken whole from a server that does not know ranges. */
export const WHOLE_LIMIT = 64 * 1024 * 1024;

export class Pack {
  /** @param {URL} url */
  constructor(url) {
    this.url = url;
    this.isLocal = false;
    this.name = ""; // of a file of this computer
    /** @type {string | null} */
    this.etag = null;
    /** Length of the file, once it is known. @type {number | null} */
    this.bytes = null;
    this.maxRanges = 1; // ranges that one request may ask for
    /** All of it, where the server does not know ranges. @type {Uint8Array<ArrayBuffer> | null} */
    this.whole = null;
    this.arrived = 0; // how much of `whole` is there
    /** Settles when the reading of `whole` ends. @type {Promise<void> | null} */
    this.reading = null;
    /** Who waits for more of it. @type {Set<(failure: unknown) => void>} */
    this.waiting = new Set();
    /** While access is asked for. @type {Promise<void> | null} */
    this.opening = null;
    this.requests = 0;
    this.received = 0;
    this.headBytes = 0; // of the first answer
    this.held = 0; // requests that wait for the server to be asked again
    this.refusals = 0; // in a row, by a server that asks to wait
    this.resumesAt = 0; // until then it is not asked for anything, by the page's clock
    /** Called at least every second while requests wait for that. @type {(seconds: number) => void} */
    this.onLimit = () => {};
    /** @type {(done: number, total: number) => void} */
    this.onProgress = () => {};
  }

  /** Seconds until the server may be asked again; 0 where it may. */
  get limitedFor() {
    return Math.max(0, Math.ceil((this.resumesAt - performance.now()) / 1000));
  }

  /**
   * The first bytes of the file, `length` or all of a shorter one.
   * @param {number} length
   * @param {AbortSignal} [signal]
   */
  async head(length = HEAD_BYTES, signal = undefined) {
    const response = await this.#ask(0, length, signal);
    if (response.status === 200) {
      const whole = await this.#openWhole(response, signal);
      const end = Math.min(Math.max(length, HEAD_BYTES), whole.length);
      const timer = setInterval(() => this.onProgress(this.arrived, end), 100);
      try {
        return await this.#part(whole, 0, end, signal);
      } finally {
        clearInterval(timer);
      }
    }
    const range = contentRange(response);
    this.etag = response.headers.get("etag");
    this.maxRanges = Number(response.headers.get("kilwa-ranges")) || 1;
    if (range?.from !== 0 || range.total === null) return this.#unstated(response, length);
    this.bytes = range.total;
    const end = Math.min(length, range.total);
    this.headBytes = end;
    return read(response, end, (n) => this.onProgress(n, end));
  }

  /**
   * A first part whose place is not said: another site's Content-Range is read only if the server exposes it. A pack states its length itself.
   * @param {Response} response
   * @param {number} length
   */
  async #unstated(response, length) {
    const reader = response.body?.getReader();
    const first = (await readStart(reader, length)).slice(0, length);
    await reader?.cancel().catch(() => {});
    const stated = statedLength(first);
    if (stated === null) throw new PackError("noRange", "the answer does not say which part of which length it is", { bytes: NaN });
    this.headBytes = first.length;
    // Fewer than were asked for: the file ends there.
    this.bytes = first.length < length ? Math.min(first.length, stated) : stated;
    return first;
  }

  /**
   * The bytes `offset .. offset + length`, exactly. `fresh` goes round the browser's own store, after damage.
   * `onPart(bytes, count)` is shown the first `count` of them while the others are on their way. `ranges`: `0-99,200-299`, several
   * stretches of `length` bytes in all, one behind the other, where the server has addresses for that (`maxRanges`; docs/serve.md).
   * @param {number} offset
   * @param {number} length
   * @param {AbortSignal} [signal]
   * @param {{fresh?: boolean, onPart?: (bytes: Uint8Array<ArrayBuffer>, count: number) => void, ranges?: string}} how
   */
  async range(offset, length, signal, { fresh = false, onPart = () => {}, ranges = "" } = {}) {
    const { whole } = this;
    // Several stretches are asked for in any order.
    const end = ranges ? Math.max(...ranges.split(/[-,]/).map(Number)) + 1 : offset + length;
    if (this.bytes !== null && end > this.bytes) throw new PackError("cutOff", `byte ${end} of ${this.bytes}`);
    if (whole) {
      if (!this.reading && this.arrived < offset + length) this.#reopenWhole(whole);
      return this.#part(whole, offset, length, signal);
    }
    const response = await this.#ask(offset, length, signal, fresh, ranges);
    const etag = response.headers.get("etag");
    if (!isSameTag(this.etag, etag)) {
      await discard(response);
      // Whether it changed shows in the answer to a single range.
      if (ranges) this.#oneByOne("another file");
      throw new PackError("changed", "the ETag of the file changed");
    }
    if (response.status === 200 && !ranges) {
      await discard(response);
      throw new PackError("server", "the server answered with the whole file instead of a part");
    }
    const range = contentRange(response);
    if (range && range.total !== null && range.total !== this.bytes) {
      await discard(response);
      throw new PackError("changed", "the length of the file changed");
    }
    if (range && (range.from !== offset || range.to !== offset + length - 1)) {
      await discard(response);
      throw new PackError("server", `asked for ${offset} to ${offset + length - 1}, got ${range.from} to ${range.to}`);
    }
    const bytes = await read(response, length, (count, into) => onPart(into, count));
    this.received += bytes.length;
    return bytes;
  }

  /**
   * One request; where the model is not public and the server names an address that grants access, access is asked for, and the request is made once more.
   * @param {number} offset
   * @param {number} length
   * @param {AbortSignal} [signal]
   */
  async #ask(offset, length, signal, fresh = false, ranges = "") {
    const response = await this.#askOnce(offset, length, signal, fresh, ranges);
    if (response.status !== 401) return response;
    const form = response.headers.get("kilwa-open");
    await discard(response);
    // Only the site that this page is of is asked, and only at its own address: a pack from elsewhere leads nobody anywhere.
    const at = form && URL.canParse(form, this.url) ? new URL(form, this.url) : null;
    if (!at || at.origin !== location.origin || this.url.origin !== location.origin) throw new PackError("closed", "", { signIn: null });
    // Requests that are refused at the same time ask once.
    this.opening ??= this.#open(at).finally(() => (this.opening = null));
    await this.opening;
    const again = await this.#askOnce(offset, length, signal, fresh, ranges);
    if (again.status !== 401) return again;
    await discard(again);
    throw new PackError("closed", "", { signIn: null });
  }

  /**
   * Access to the pack, for some minutes: a cookie that scripts do not see.
   * @param {URL} url
   */
  async #open(url) {
    let response;
    try {
      response = await fetch(url, { method: "POST", credentials: "same-origin" });
    } catch (error) {
      throw new PackError("offline", String(error.message ?? error));
    }
    if (response.ok) return;
    if (response.status >= 500 || response.status === 429) throw new PackError("server", String(response.status));
    const { reason, signIn } = await response.json().catch(() => ({}));
    const isHere = typeof signIn === "string" && URL.canParse(signIn, url) && new URL(signIn, url).origin === location.origin;
    throw new PackError("closed", String(reason ?? ""), { signIn: isHere ? new URL(signIn, url).href : null });
  }

  /**
   * Several ranges in one request are not had here after all: from now on each by itself.
   * @param {string} why
   */
  #oneByOne(why) {
    this.maxRanges = 1;
    throw new PackError("server", why);
  }

  /**
   * @param {number} offset
   * @param {number} length
   * @param {AbortSignal | undefined} signal
   * @param {boolean} fresh
   * @param {string} ranges
   */
  async #askOnce(offset, length, signal, fresh, ranges) {
    const url = new URL(this.url);
    if (ranges) url.pathname += `/${ranges}`;
    let asked = 0;
    const ask = async () => {
      await this.#turn(signal);
      asked = performance.now();
      this.requests += 1;
      return fetch(url, {
        headers: ranges ? undefined : { Range: `bytes=${offset}-${offset + length - 1}` },
        signal,
        credentials: "same-origin",
        // A browser that has stored a part of what is asked for asks for that part first, to compare it: another request.
        cache: fresh ? "reload" : offset > 0 && offset < this.headBytes ? "no-store" : "default",
      });
    };
    let response;
    try {
      for (;;) {
        response = await ask().catch((error) => this.#unread(error, ask, signal));
        const isLimited = [429, 503].includes(response.status);
        // What was on its way when the server began to refuse says nothing new.
        if (asked >= this.resumesAt) this.refusals = isLimited ? this.refusals + 1 : 0;
        if (!isLimited) break;
        this.resumesAt = Math.max(this.resumesAt, performance.now() + waitOf(response, this.refusals));
        await discard(response);
      }
    } catch (error) {
      if (error.name === "AbortError" || error instanceof PackError) throw error;
      throw new PackError("offline", String(error.message ?? error));
    }
    if ([200, 206, 401].includes(response.status) && !(ranges && response.status === 206)) return response;
    if (ranges && response.status < 500) {
      await discard(response);
      this.#oneByOne(String(response.status));
    }
    if (response.status === 403) throw new PackError("closed", (await response.text().catch(() => "")).trim(), { signIn: null });
    await discard(response);
    const status = `${response.status} ${response.statusText}`.trim();
    if (response.status === 404 || response.status === 410) throw new PackError("missing", status);
    // Nothing there to send a part of: an empty file at the start, a shorter file later.
    if (response.status === 416) throw new PackError(this.bytes === null ? "empty" : "changed", status);
    throw new PackError("server", status);
  }

  /**
   * Until the server may be asked.
   * @param {AbortSignal} [signal]
   */
  async #turn(signal) {
    this.held += 1;
    try {
      for (let left = this.limitedFor; left > 0; left = this.limitedFor) {
        this.onLimit(left);
        await new Promise((resolve) => setTimeout(resolve, Math.min(1000, this.resumesAt - performance.now())));
        signal?.throwIfAborted();
      }
    } finally {
      this.held -= 1;
    }
  }

  /**
   * A request that got no answer, of a file that nothing was read of yet: browsers do not say whether there was none, or one of another site that this page may
   * not read. A request that reads nothing tells them apart; the first one may have failed by chance and is made once more.
   * @param {any} error
   * @param {() => Promise<Response>} ask
   * @param {AbortSignal} [signal]
   */
  async #unread(error, ask, signal) {
    if (error.name === "AbortError" || this.bytes !== null || this.url.origin === globalThis.location?.origin) throw error;
    const answers = await fetch(this.url, { method: "HEAD", mode: "no-cors", cache: "no-store", signal }).then(
      () => true,
      () => false,
    );
    signal?.throwIfAborted();
    if (!answers) throw error;
    return ask().catch((again) => {
      throw again.name === "AbortError" ? again : new PackError("noCors", String(again.message), { host: this.url.host });
    });
  }

  /**
   * The server sends everything: find out how much that is, and begin to read it.
   * @param {Response} response
   * @param {AbortSignal} [signal]
   */
  async #openWhole(response, signal) {
    const reader = response.body?.getReader();
    const limit = WHOLE_LIMIT;
    const refuse = async (/** @type {number} */ bytes) => {
      await reader?.cancel().catch(() => {});
      throw new PackError("noRange", "the server ignores Range", { bytes });
    };
    const header = response.headers.get("content-length");
    // The announced length counts compressed bytes, the arriving bytes are not compressed.
    const announced = header === null || response.headers.has("content-encoding") ? NaN : Number(header);
    if (header !== null && Number(header) > limit) await refuse(Number(header));
    const first = await readStart(reader, LENGTH_END);
    signal?.throwIfAborted();
    const stated = statedLength(first);
    // Not a pack: enough bytes of it to say so.
    const bytes = stated ?? (announced <= limit ? announced : first.length);
    if (bytes > limit) await refuse(bytes);
    this.etag = response.headers.get("etag");
    // A file that is cut off is as long as the server announces.
    this.bytes = announced < bytes ? announced : bytes;
    const whole = new Uint8Array(this.bytes);
    this.whole = whole;
    this.#readOn(this.#readAll(whole, reader, first));
    return whole;
  }

  /**
   * The reading broke off: once more from the front. What was there stays.
   * @param {Uint8Array<ArrayBuffer>} whole
   */
  #reopenWhole(whole) {
    const again = async () => {
      const response = await this.#ask(0, whole.length);
      const etag = response.headers.get("etag");
      if (!isSameTag(this.etag, etag)) {
        await discard(response);
        throw new PackError("changed", "the ETag of the file changed");
      }
      const reader = response.body?.getReader();
      const first = await readStart(reader, LENGTH_END);
      if (statedLength(first) !== statedLength(whole)) {
        await reader?.cancel().catch(() => {});
        throw new PackError("changed", "the length of the file changed");
      }
      await this.#readAll(whole, reader, first);
    };
    this.#readOn(again());
  }

  /**
   * Read to the end, beginning with what was read already; those who wait hear of every part.
   * @param {Uint8Array<ArrayBuffer>} whole
   * @param {ReadableStreamDefaultReader<Uint8Array<ArrayBuffer>> | undefined} reader
   * @param {Uint8Array<ArrayBuffer>} first
   */
  async #readAll(whole, reader, first) {
    let at = 0;
    for (let part = first; ; ) {
      const fits = part.subarray(0, whole.length - at);
      whole.set(fits, at);
      at += fits.length;
      this.arrived = Math.max(this.arrived, at);
      for (const look of [...this.waiting]) look(null);
      if (at === whole.length) break;
      const { done, value } = (await reader?.read()) ?? { done: true, value: undefined };
      if (done) throw new PackError("truncated", `${at} of ${whole.length} bytes came`);
      part = value;
    }
    await reader?.cancel().catch(() => {});
  }

  /**
   * While a reading is under way; at its end those who still wait hear what is the matter.
   * @param {Promise<void>} reading
   */
  #readOn(reading) {
    const ended = (/** @type {unknown} */ failure) => {
      this.reading = null;
      for (const look of [...this.waiting]) look(failure);
    };
    this.reading = reading.then(
      () => ended(new PackError("truncated", "the answer ended")),
      (error) => ended(error instanceof PackError ? error : new PackError("truncated", String(error.message ?? error))),
    );
  }

  /**
   * A part of `whole`, as soon as it is there.
   * @param {Uint8Array<ArrayBuffer>} whole
   * @param {number} offset
   * @param {number} length
   * @param {AbortSignal} [signal]
   * @returns {Promise<Uint8Array<ArrayBuffer>>}
   */
  #part(whole, offset, length, signal) {
    return new Promise((resolve, reject) => {
      const end = () => {
        this.waiting.delete(look);
        signal?.removeEventListener("abort", abort);
      };
      const abort = () => {
        end();
        reject(signal?.reason);
      };
      const look = (/** @type {unknown} */ failure) => {
        const isHere = this.arrived >= offset + length;
        if (isHere || failure) end();
        if (isHere) resolve(whole.slice(offset, offset + length));
        else if (failure) reject(failure);
      };
      if (signal?.aborted) return abort();
      signal?.addEventListener("abort", abort);
      this.waiting.add(look);
      look(this.reading ? null : new PackError("truncated", `${this.arrived} of ${this.bytes} bytes came`));
    });
  }
}
