// One pack that was opened: what its first bytes say, what it is called, and its title.

import { Identity } from "./identity.js";

/** @import { PackInfo, PackSource, Program } from "./types/page.js" */

export class Model {
  /**
   * @param {object} parts
   * @param {PackSource} parts.pack
   * @param {Program} parts.module
   * @param {Uint8Array<ArrayBuffer>} parts.head its first bytes
   */
  constructor({ pack, module, head }) {
    this.pack = pack;
    this.module = module;
    this.head = head;
    /** @type {PackInfo} */
    this.info = JSON.parse(module.packInfo(head));
    /** The header's hash, under which the browser keeps views, notes and measurements. */
    this.hash = this.info.pack.hash;
    this.identity = new Identity({ pack, head, module, hash: this.hash });
    /** The file ends before what its header states. */
    this.isCutOff = Number(pack.bytes) < this.info.pack.bytes;
    /** The shading that is usual for it, once a viewer is there. @type {string | null} */
    this.usualMode = null;
  }

  /** The published title; for a file of this computer, its own name. */
  get title() {
    const published = this.pack.isLocal ? "" : document.body.dataset.title;
    return published || this.info.metadata.title.trim() || this.pack.name || document.title;
  }

  /** The address of the pack; null for one of this computer. */
  get address() {
    return this.pack.isLocal ? null : new URL(this.pack.url, location.href).href;
  }

  close() {
    this.identity.close();
  }
}
