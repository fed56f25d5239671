// Where a file goes while it is made: straight to a place that the person chose, where the browser can do that (File System Access), else into parts
// that the browser keeps on disk when they are many. Nothing here grows with the file.

/** Files that may become larger than this are written where the person chooses. */
const LARGE = 256e6;

/** Parts of a Blob. */
export class BlobSink {
  /** @type {Blob[]} */
  #parts = [];
  /** @type {Uint8Array<ArrayBuffer> | null} */
  #head = null;

  /** @param {string} type of the file, as in HTTP */
  constructor(type) {
    this.type = type;
  }

  /** @param {Uint8Array<ArrayBuffer>} bytes */
  write(bytes) {
    // Each a Blob of its own: its bytes leave the page's memory.
    if (bytes.length > 0) this.#parts.push(new Blob([bytes]));
  }

  /**
   * The first bytes of the file, which only its end knows.
   * @param {Uint8Array<ArrayBuffer>} bytes
   */
  head(bytes) {
    this.#head = bytes;
  }

  /** @returns {Promise<Blob>} what is to be offered to the person */
  async end() {
    const all = new Blob(this.#parts, { type: this.type });
    return this.#head ? new Blob([this.#head, all.slice(this.#head.length)], { type: this.type }) : all;
  }

  abort() {
    this.#parts = [];
  }
}

/** A file of the person's. It has its name when it is complete. */
class FileSink {
  /** @param {FileSystemWritableFileStream} writable */
  constructor(writable) {
    this.writable = writable;
  }

  /** @param {Uint8Array<ArrayBuffer>} bytes */
  async write(bytes) {
    if (bytes.length > 0) await this.writable.write(bytes);
  }

  /** @param {Uint8Array<ArrayBuffer>} bytes */
  head(bytes) {
    return this.writable.write({ type: "write", position: 0, data: bytes });
  }

  /** It is where the person wants it: nothing is to be offered. */
  async end() {
    await this.writable.close();
    return null;
  }

  abort() {
    return this.writable.abort().catch(() => {});
  }
}

/**
 * A place for a file of about so many bytes. Throws an AbortError where the person wants none.
 * @param {{name: string, type: string, bytes: number}} file
 * @returns {Promise<import("./types/page.js").Sink>}
 */
export async function openSink({ name, type, bytes }) {
  // Not in every browser, and so not among the types.
  const { showSaveFilePicker } = /** @type {any} */ (globalThis);
  if (bytes > LARGE && showSaveFilePicker) {
    try {
      const ending = name.slice(name.lastIndexOf("."));
      const handle = await showSaveFilePicker({ suggestedName: name, types: [{ accept: { [type]: [ending] } }] });
      return new FileSink(await handle.createWritable());
    } catch (error) {
      if (error.name === "AbortError") throw error;
      // Too long after the press, or not in a frame: then as everywhere else.
    }
  }
  return new BlobSink(type);
}
