// What the person keeps for the pack that is open: saved views and notes; and the notes that its host publishes.

import * as chrome from "./chrome.js";
import { t } from "./i18n.js";
import { readState } from "./link.js";
import { Notes } from "./notes.js";
import { fetchPublished } from "./published.js";
import { Saved } from "./saved.js";

/** @import { Model } from "./model.js" */

export class Person {
  /**
   * @param {object} parts
   * @param {import("./current.js").Current} parts.current
   * @param {import("./undo.js").Undo} parts.undo
   * @param {import("./viewpoint.js").Viewpoint} parts.viewpoint
   * @param {import("./link.js").Address} parts.address
   * @param {import("./api.js").Api} parts.api
   * @param {import("./toolbox.js").Toolbox} parts.toolbox
   */
  constructor({ current, undo, viewpoint, address, api, toolbox }) {
    this.current = current;
    this.undo = undo;
    this.viewpoint = viewpoint;
    this.address = address;
    this.api = api;
    this.toolbox = toolbox;
  }

  /**
   * What the browser keeps for this pack.
   * @param {Model} model
   */
  open({ hash, identity, title, address }) {
    const { current, undo, viewpoint } = this;
    const now = () => viewpoint.seen();
    undo.clear();
    current.saved = new Saved({ hash, identity, title, undo, now, go: (view) => viewpoint.goTo(view) });
    current.notes?.close();
    current.notes = new Notes({
      hash,
      identity,
      title,
      pack: address,
      undo,
      now,
      look: (note, isJump) => viewpoint.lookAt(note, isJump),
      tool: (name) => this.toolbox.choose(name),
      emit: (event, detail) => {
        if (event === "annotation") this.address.now();
        else this.address.later();
        this.api.emit(event, /** @type {any} */ (detail));
      },
      shareAddress: () => viewpoint.share(),
    });
  }

  /**
   * The list of holes and the colour report that the host publishes beside the pack.
   * @param {string | undefined} holes
   * @param {string | undefined} report
   */
  async offer(holes, report) {
    const { pack } = this.current;
    if (!pack || pack.isLocal) return;
    if (holes) (await import("./holes.js")).offer(this.current, () => fetchPublished(holes, pack.url), false);
    if (report) (await import("./photographs/photographs.js")).offer(this.current, { report, pack: pack.url, read: () => fetchPublished(report, pack.url) });
  }

  /**
   * Notes that the host publishes beside the pack.
   * @param {string | undefined} address
   */
  async publish(address) {
    const { model, notes } = this.current;
    if (!address || !model || !notes || model.pack.isLocal) return;
    try {
      notes.publish(await fetchPublished(address, model.pack.url));
      const { annotation, camera } = readState(location.hash);
      if (annotation && !notes.openId) notes.openNamed(annotation, { fly: !camera, isJump: false });
    } catch (error) {
      chrome.notice(t("annotationsFailed", { why: error.message }), 12000);
    }
  }
}
