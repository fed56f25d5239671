// An answer to a request for a part of a pack: what it is a part of, its bytes, and why they did not come.

/** Why bytes did not come. `kind`: missing, offline, server, noRange, noCors (with `host`), changed, truncated, cutOff (beyond the end of the file), closed (with `signIn`, an address or null). */
export class PackError extends Error {
  /**
   * @param {string} kind
   * @param {string} message
   * @param {{signIn?: string | null, bytes?: number, host?: string}} more
   */
  constructor(kind, message, { signIn, bytes, host } = {}) {
    super(message);
    this.kind = kind;
    this.signIn = signIn;
    this.bytes = bytes;
    this.host = host;
  }
}

/**
 * Whether trying the same again can help.
 * @param {any} error
 */
export const isPassing = (error) => ["offline", "server", "truncated"].includes(error?.kind);

/**
 * Whether two tags may be of the same file: RFC 9110, 8.8.3.2, weak comparison, for proxies weaken the tags of what they compress, and of that alone. A weak tag promises
 * less; checksums tell what it does not. Where there is none there is nothing to compare.
 * @param {string | null} a
 * @param {string | null} b
 */
export const isSameTag = (a, b) => !a || !b || a.replace(/^W\//, "") === b.replace(/^W\//, "");

/** Where the file's own length ends in its header, and what it begins with: the same in every version of the format. */
export const LENGTH_END = 72;
const MAGIC = "KILWAPCK";

/**
 * The length that a pack states; null where these bytes begin none.
 * @param {Uint8Array} first
 */
export function statedLength(first) {
  if (first.length < LENGTH_END || String.fromCharCode(...first.subarray(0, 8)) !== MAGIC) return null;
  return Number(new DataView(first.buffer, first.byteOffset).getBigUint64(64, true));
}

/**
 * The first bytes of an answer: `min` of them and what came along, or all of a shorter one.
 * @param {ReadableStreamDefaultReader<Uint8Array<ArrayBuffer>> | undefined} reader
 * @param {number} min
 */
export async function readStart(reader, min) {
  let bytes = new Uint8Array();
  try {
    while (reader && bytes.length < min) {
      const { done, value } = await reader.read();
      if (done) break;
      const joined = new Uint8Array(bytes.length + value.length);
      joined.set(bytes);
      joined.set(value, bytes.length);
      bytes = joined;
    }
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new PackError("truncated", String(error.message ?? error));
  }
  return bytes;
}

/**
 * `bytes 0-9/100` as numbers; `total` is null where it is `*`; null where there is none.
 * @param {Response} response
 */
export function contentRange(response) {
  const match = /^bytes (\d+)-(\d+)\/(\d+|\*)$/.exec(response.headers.get("content-range") ?? "");
  if (!match) return null;
  return { from: Number(match[1]), to: Number(match[2]), total: match[3] === "*" ? null : Number(match[3]) };
}

/**
 * Stop an answer that is not wanted. Where its connection broke it has stopped already, and the error of stopping it means nothing.
 * @param {Response} response
 */
export async function discard(response) {
  await response.body?.cancel().catch(() => {});
}

/** Longest wait before a server that asked for one is asked again, milliseconds. */
const LONGEST_WAIT = 60_000;

/**
 * Milliseconds to wait for a server that asks to: as long as it says (seconds, or a date), and longer from time to time where it keeps refusing or nothing can be read;
 * pages of other sites see Retry-After only if the server exposes it.
 * @param {Response} response
 * @param {number} refusals so many in a row
 */
export function waitOf({ headers }, refusals) {
  const said = headers.get("retry-after") ?? "";
  const told = /^\d+$/.test(said) ? Number(said) * 1000 : Date.parse(said) - Date.now() || 0;
  const own = 2 ** Math.min(refusals, 7) * 500 * (0.5 + Math.random() / 2);
  return Math.min(Math.max(told, own), LONGEST_WAIT);
}

/**
 * All bytes of an answer; fewer or more than `length` is an error.
 * @param {Response} response
 * @param {number} length
 * @param {(count: number, into: Uint8Array<ArrayBuffer>) => void} onProgress
 */
export async function read(response, length, onProgress) {
  if (!response.body) throw new PackError("truncated", `0 of ${length} bytes came`);
  const reader = response.body.getReader();
  const into = new Uint8Array(length);
  let at = 0;
  try {
    for (;;) {
      const { done, value } = await reader.read();
      if (done) break;
      if (at + value.length > length) {
        await reader.cancel().catch(() => {});
        throw new PackError("truncated", "more bytes came than were asked for");
      }
      into.set(value, at);
      at += value.length;
      onProgress(at, into);
    }
  } catch (error) {
    if (error.name === "AbortError" || error instanceof PackError) throw error;
    throw new PackError("truncated", String(error.message ?? error));
  }
  if (at < length) throw new PackError("truncated", `${at} of ${length} bytes came`);
  return into;
}
