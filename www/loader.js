// The pack over HTTP: ranges, and what a server can get wrong about them.
//
// The first answer fixes the length and the ETag of the file. Every later answer is compared with them, and its length
// with what was asked for; checksums (in the decoder) catch the rest. A server that ignores Range is put up with where the
// whole file is small, and refused with its size where it is not.

/** What the first request asks for: header, metadata, the first directory page and the coarsest chunks. */
export const HEAD_BYTES = 65536;
/** A pack up to this size is taken whole from a server that does not know ranges. */
export const WHOLE_LIMIT = 64 * 1024 * 1024;

/** Why bytes did not come. `kind`: missing, offline, server, noRange, changed, truncated. */
export class PackError extends Error {
  constructor(kind, message, extra = {}) {
    super(message);
    this.kind = kind;
    Object.assign(this, extra);
  }
}

/** Whether trying the same again can help. */
export const isPassing = (error) => ["offline", "server", "truncated"].includes(error?.kind);

export class Pack {
  /** @param {URL} url */
  constructor(url) {
    this.url = url;
    this.etag = null;
    this.bytes = null;
    this.whole = null; // Uint8Array of all of it, where the server does not know ranges
    this.requests = 0;
    this.received = 0;
    this.onProgress = () => {};
  }

  /** The first bytes of the file, `length` or all of a shorter one. */
  async head(length = HEAD_BYTES, signal = undefined) {
    const response = await this.#ask(0, length, signal);
    if (response.status === 200) {
      return (await this.#takeWhole(response, signal)).subarray(0, Math.max(length, HEAD_BYTES));
    }
    const range = contentRange(response);
    if (!range || range.from !== 0 || range.total === null) {
      throw new PackError("noRange", "the answer does not say which part of which length it is", { bytes: NaN });
    }
    this.bytes = range.total;
    this.etag = response.headers.get("etag");
    return read(response, Math.min(length, range.total), (n) => this.onProgress(n, Math.min(length, range.total)));
  }

  /**
   * The bytes `offset .. offset + length`, exactly. `fresh` goes round the browser's own store, after damage.
   * `onPart(bytes, count)` is shown the first `count` of them while the others are on their way.
   */
  async range(offset, length, signal, { fresh = false, onPart = () => {} } = {}) {
    if (this.whole) {
      if (offset + length > this.whole.length) throw new PackError("truncated", "beyond the end of the file");
      return this.whole.slice(offset, offset + length);
    }
    const response = await this.#ask(offset, length, signal, fresh);
    const etag = response.headers.get("etag");
    if (this.etag && etag && etag !== this.etag) {
      await discard(response);
      throw new PackError("changed", "the ETag of the file changed");
    }
    if (response.status === 200) {
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

  async #ask(offset, length, signal, fresh = false) {
    this.requests += 1;
    let response;
    try {
      response = await fetch(this.url, {
        headers: { Range: `bytes=${offset}-${offset + length - 1}` },
        signal,
        credentials: "same-origin",
        cache: fresh ? "reload" : "default",
      });
    } catch (error) {
      if (error.name === "AbortError") throw error;
      throw new PackError("offline", String(error.message ?? error));
    }
    if (response.status === 200 || response.status === 206) return response;
    await discard(response);
    const says = `${response.status} ${response.statusText}`.trim();
    if (response.status === 404 || response.status === 410) throw new PackError("missing", says);
    // Nothing there to send a part of: an empty file at the start, a shorter file later.
    if (response.status === 416) throw new PackError(this.bytes === null ? "empty" : "changed", says);
    throw new PackError("server", says);
  }

  async #takeWhole(response, signal) {
    const header = response.headers.get("content-length");
    const length = header === null ? NaN : Number(header);
    if (!(length <= WHOLE_LIMIT)) {
      await discard(response);
      throw new PackError("noRange", "the server ignores Range", { bytes: length });
    }
    // What arrives is counted after decompression, what is announced before: only an end before the end is an error.
    const encoded = response.headers.has("content-encoding");
    const bytes = await read(response, encoded ? null : length, (n) => this.onProgress(n, length), WHOLE_LIMIT);
    signal?.throwIfAborted();
    this.whole = bytes;
    this.bytes = bytes.length;
    this.etag = response.headers.get("etag");
    return bytes;
  }
}

/** `bytes 0-9/100` as numbers; `total` is null where it is `*`; null where there is none. */
export function contentRange(response) {
  const match = /^bytes (\d+)-(\d+)\/(\d+|\*)$/.exec(response.headers.get("content-range") ?? "");
  if (!match) return null;
  return { from: Number(match[1]), to: Number(match[2]), total: match[3] === "*" ? null : Number(match[3]) };
}

/** Stop an answer that is not wanted. One whose connection broke already has stopped: its error says nothing more. */
async function discard(response) {
  await response.body?.cancel().catch(() => {});
}

/** All bytes of an answer, at most `limit`; fewer or more than `length` is an error. */
async function read(response, length, onProgress, limit = length) {
  const reader = response.body.getReader();
  let into = new Uint8Array(length ?? 65536);
  let at = 0;
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) break;
      if (at + value.length > into.length) {
        if (length !== null || at + value.length > limit) {
          await reader.cancel().catch(() => {});
          throw new PackError("truncated", "more bytes came than were asked for");
        }
        const larger = new Uint8Array(Math.max(into.length * 2, at + value.length));
        larger.set(into);
        into = larger;
      }
      into.set(value, at);
      at += value.length;
      onProgress(at, into);
    }
  } catch (error) {
    if (error.name === "AbortError" || error instanceof PackError) throw error;
    throw new PackError("truncated", String(error.message ?? error));
  }
  if (length !== null && at < length) throw new PackError("truncated", `${at} of ${length} bytes came`);
  return length === null ? into.slice(0, at) : into;
}
