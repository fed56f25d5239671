// PNG, written row by row: a picture larger than any canvas needs the memory of one strip. RFC 2083; deflate is the browser's.

import { BlobSink } from "./sink.js";

const CRC = new Uint32Array(256).map((_, n) => {
  for (let k = 0; k < 8; k += 1) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
  return n;
});
/** Bytes of a chunk of the picture, but for the last. */
const PART = 1 << 20;

/** @param {Uint8Array[]} parts */
function crc(parts) {
  let c = 0xffffffff;
  for (const part of parts) for (const byte of part) c = CRC[(c ^ byte) & 255] ^ (c >>> 8);
  return (c ^ 0xffffffff) >>> 0;
}

/** @param {number} n */
const number = (n) => new Uint8Array([n >>> 24, (n >>> 16) & 255, (n >>> 8) & 255, n & 255]);

/** @param {Uint8Array[]} parts */
function joined(parts) {
  const all = new Uint8Array(parts.reduce((sum, part) => sum + part.length, 0));
  let at = 0;
  for (const part of parts) {
    all.set(part, at);
    at += part.length;
  }
  return all;
}

/**
 * @param {string} name
 * @param {Uint8Array} data
 */
function chunk(name, data) {
  const type = new TextEncoder().encode(name);
  return joined([number(data.length), type, data, number(crc([type, data]))]);
}

export class PngWriter {
  /**
   * A picture of 8 bits per channel, red, green, blue and, where `alpha`, alpha. `dotsPerMetre`: of paper, or 0. `sink` (sink.js) is where it goes; without
   * one it becomes a Blob.
   * @param {number} width
   * @param {number} height
   * @param {{alpha?: boolean, texts?: Record<string, string>, dotsPerMetre?: number, sink?: import("./types/page.js").Sink}} how
   */
  constructor(width, height, { alpha = false, texts = {}, dotsPerMetre = 0, sink = new BlobSink("image/png") } = {}) {
    this.width = width;
    this.sink = sink;
    this.bytesPerPixel = alpha ? 4 : 3;
    const head = new Uint8Array(13);
    head.set(number(width), 0);
    head.set(number(height), 4);
    head.set([8, alpha ? 6 : 2, 0, 0, 0], 8);
    const parts = [new Uint8Array([137, 80, 78, 71, 13, 10, 26, 10]), chunk("IHDR", head), chunk("sRGB", new Uint8Array([0]))];
    if (dotsPerMetre > 0) {
      const dots = number(Math.round(dotsPerMetre));
      parts.push(chunk("pHYs", new Uint8Array([...dots, ...dots, 1])));
    }
    for (const [key, value] of Object.entries(texts)) {
      // iTXt: keyword, not compressed, no language; UTF-8.
      parts.push(chunk("iTXt", new TextEncoder().encode(`${key}\0\0\0\0\0${value}`)));
    }
    const deflate = new CompressionStream("deflate");
    this.writer = deflate.writable.getWriter();
    this.written = this.#pass(joined(parts), deflate.readable.getReader());
    this.written.catch(() => {}); // whoever writes rows or ends hears of it
    this.above = new Uint8Array(width * this.bytesPerPixel);
  }

  /**
   * What is deflated goes to the sink in chunks.
   * @param {Uint8Array<ArrayBuffer>} head
   * @param {ReadableStreamDefaultReader<Uint8Array<ArrayBuffer>>} reader
   */
  async #pass(head, reader) {
    try {
      await this.sink.write(head);
      /** @type {Uint8Array[]} */
      let parts = [];
      let held = 0;
      for (;;) {
        const { done, value } = await reader.read();
        if (!done) {
          parts.push(value);
          held += value.length;
        }
        if (held > PART || (done && held > 0)) {
          await this.sink.write(chunk("IDAT", joined(parts)));
          [parts, held] = [[], 0];
        }
        if (done) return;
      }
    } catch (error) {
      // A full disk, for example: who writes must not wait for ever.
      await reader.cancel(error);
      throw error;
    }
  }

  /**
   * The next rows. They are read before anything is awaited.
   * @param {Uint8Array | Uint8ClampedArray} pixels
   * @param {3 | 4} given bytes per pixel
   */
  async rows(pixels, given = 4) {
    const { width, bytesPerPixel } = this;
    const count = pixels.length / (width * given);
    const line = width * bytesPerPixel;
    const out = new Uint8Array(count * (line + 1));
    const row = new Uint8Array(line);
    for (let y = 0; y < count; y += 1) {
      for (let x = 0, from = y * width * given, to = 0; x < width; x += 1, from += given, to += bytesPerPixel) {
        row[to] = pixels[from];
        row[to + 1] = pixels[from + 1];
        row[to + 2] = pixels[from + 2];
        if (bytesPerPixel === 4) row[to + 3] = pixels[from + 3];
      }
      const at = y * (line + 1);
      out[at] = 2; // Up: what the row above does not say
      for (let i = 0; i < line; i += 1) out[at + 1 + i] = row[i] - this.above[i];
      this.above.set(row);
    }
    // Where the sink failed, that is what is wrong.
    await this.writer.write(out).catch(() => this.written);
  }

  /** @returns {Promise<Blob | null>} what the sink gives */
  async end() {
    await this.writer.close().catch(() => this.written);
    await this.written;
    await this.sink.write(chunk("IEND", new Uint8Array()));
    return this.sink.end();
  }
}
