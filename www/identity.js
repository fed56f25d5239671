// The pack's name: links, notes, saved views and measurements name its identity (docs/FORMAT.md, section 7), which is in its last bytes. They are fetched once
// the first picture is there. Until then, and in links of earlier versions of the page, the header's own hash is used instead.

import { isPassing } from "./loader.js";

/** @import { PackSource, Program } from "./types/page.js" */

/** Bytes at the end of the file that tell it. */
const FOOTER_BYTES = 80;
/** Digits of it in a link. */
export const DIGITS = 12;

export class Identity {
  /** @param {{pack: PackSource, head: Uint8Array, module: Program, hash: string}} parts `hash`: the header's */
  constructor({ pack, head, module, hash }) {
    this.pack = pack;
    this.head = head;
    this.module = module;
    this.hash = hash;
    this.closed = false;
    /** @type {string | null} */
    this.text = null;
    /** The last bytes of the file, once they are there. @type {Uint8Array | null} */
    this.footer = null;
    /** @type {Promise<string | null> | undefined} */
    this.asking = undefined;
  }

  /** Its name; null if the end of the file cannot be read. */
  known() {
    this.asking ??= this.#ask();
    return this.asking;
  }

  async #ask() {
    for (let attempt = 0; !this.closed; attempt += 1) {
      try {
        const footer = await this.pack.range(Number(this.pack.bytes) - FOOTER_BYTES, FOOTER_BYTES);
        this.text = this.module.packIdentity(this.head, footer);
        this.footer = footer;
        return this.text;
      } catch (error) {
        if (!isPassing(error)) return null;
        await new Promise((resolve) => setTimeout(resolve, Math.min(30, 2 ** attempt) * 1000));
      }
    }
    return null;
  }

  /**
   * Whether what a link or a file names is this pack.
   * @param {string} named
   */
  async isHere(named) {
    if (this.hash.startsWith(named.slice(0, DIGITS))) return true;
    const text = await this.known();
    // Where nobody knows there is nothing to warn of.
    return text === null || text.startsWith(named.slice(0, DIGITS));
  }

  /** The name for new links and files. */
  get name() {
    return this.text ?? this.hash;
  }

  close() {
    this.closed = true;
  }
}
