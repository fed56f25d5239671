// A pack that lies on this computer: chosen or dropped in. The same interface as `Pack` of loader.js, over `Blob.slice`.
// Nothing of it leaves the computer.

import { PackError } from "./answer.js";
import { HEAD_BYTES } from "./loader.js";

export class LocalPack {
  /** @param {File} file */
  constructor(file) {
    this.file = file;
    this.url = URL.createObjectURL(file);
    this.name = file.name;
    this.isLocal = true;
    this.etag = null;
    this.bytes = file.size;
    this.whole = null; // only a server without ranges sends all of it
    this.requests = 0;
    this.received = 0;
    this.limitedFor = this.held = 0; // no server asks to wait
    this.onLimit = () => {};
    this.maxRanges = 1; // ranges that one request may ask for
    /** @type {(done: number, total: number) => void} */
    this.onProgress = () => {};
  }

  /**
   * The first bytes of the file, `length` or all of a shorter one.
   * @param {number} length
   */
  async head(length = HEAD_BYTES) {
    if (this.file.size === 0) throw new PackError("empty", `${this.name}: 0 bytes`);
    const bytes = await this.#read(0, Math.min(length, this.file.size));
    this.onProgress(bytes.length, bytes.length);
    return bytes;
  }

  /**
   * The bytes `offset .. offset + length`, exactly.
   * @param {number} offset
   * @param {number} length
   * @param {AbortSignal} [signal]
   * @param {unknown} [_how] what matters over HTTP alone
   */
  async range(offset, length, signal, _how) {
    if (offset + length > this.file.size) throw new PackError("cutOff", `${this.name}: byte ${offset + length} of ${this.file.size}`);
    const bytes = await this.#read(offset, length);
    signal?.throwIfAborted();
    this.received += bytes.length;
    return bytes;
  }

  /** The address of the file is no longer needed. */
  close() {
    URL.revokeObjectURL(this.url);
  }

  /**
   * @param {number} offset
   * @param {number} length
   */
  async #read(offset, length) {
    this.requests += 1;
    /** @type {ArrayBuffer} */
    let buffer;
    try {
      buffer = await this.file.slice(offset, offset + length).arrayBuffer();
    } catch (error) {
      // Browsers refuse to read a file that was changed or taken away since it was chosen.
      throw new PackError("changed", `${this.name}: ${error.message}`);
    }
    return new Uint8Array(buffer);
  }
}

/**
 * Opens a pack of this computer: the file input, and a file dropped anywhere on the page.
 * @param {{input: HTMLInputElement, drop: HTMLElement, open: (file: File) => void}} parts
 */
export function openers({ input, drop, open }) {
  input.addEventListener("change", () => {
    const [file] = input.files ?? [];
    input.value = ""; // The same file again is a choice too.
    if (file) open(file);
  });
  const hasFile = (/** @type {DragEvent} */ event) => [...(event.dataTransfer?.types ?? [])].includes("Files");
  let depth = 0;
  addEventListener("dragenter", (event) => {
    if (!hasFile(event)) return;
    event.preventDefault();
    depth += 1;
    drop.hidden = false;
  });
  addEventListener("dragover", (event) => hasFile(event) && event.preventDefault());
  addEventListener("dragleave", () => {
    depth = Math.max(0, depth - 1);
    if (depth === 0) drop.hidden = true;
  });
  addEventListener("drop", (event) => {
    depth = 0;
    drop.hidden = true;
    if (!hasFile(event)) return;
    event.preventDefault();
    const [file] = event.dataTransfer?.files ?? [];
    if (file) open(file);
  });
}
