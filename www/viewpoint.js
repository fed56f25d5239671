// What is seen, as the address, saved views and notes hold it: taken, given back, and shared.

import { cameraOf, numbersOf } from "./camera.js";
import * as chrome from "./chrome.js";
import { t } from "./i18n.js";
import { showProjection } from "./settings.js";

/** @import { Note, PageState, SavedView, Seen } from "./types/page.js" */
/** @import { Current } from "./current.js" */

/** Milliseconds that a clipboard waits for the end of the file, which names the pack. */
const CLIPBOARD_MS = 1000;

export class Viewpoint {
  /** @type {import("./share.js").ShareDialog | null} */
  #dialog = null;

  /**
   * @param {object} parts
   * @param {Current} parts.current
   * @param {import("./display.js").Display} parts.look
   * @param {import("./measuring.js").Measuring} parts.measuring
   * @param {() => import("./link.js").Address} parts.address
   * @param {() => void} parts.orbit whoever walks is to stop
   */
  constructor({ current, look, measuring, address, orbit }) {
    this.current = current;
    this.look = look;
    this.measuring = measuring;
    this.address = address;
    this.orbit = orbit;
  }

  /** All that the address holds. */
  state() {
    const { model, notes, scene } = this.current.opened;
    return {
      camera: numbersOf(scene.flight.there),
      display: this.look.chosen,
      notes: notes.shown,
      annotation: notes.openId,
      measurements: this.measuring.address,
      pack: model.identity.name,
    };
  }

  /** What saved views and notes hold. @returns {Seen} */
  seen() {
    const { camera, display } = this.state();
    return { camera, display };
  }

  /**
   * A state of the address: after Back and Forward, from a link, from a script.
   * @param {PageState} state
   */
  restore(state) {
    const { scene, notes } = this.current;
    if (!scene?.isOpen || !notes) return;
    if (scene.walk.on) this.orbit();
    if (state.camera) {
      scene.flight.to(cameraOf(state.camera)).then(() => {
        if (scene.isOpen) showProjection(scene.viewer.camera().orthographic);
      });
    }
    this.look.show(state.display);
    notes.setShown(state.notes);
    // The browser has made the entry of a link that was followed on this page.
    if (state.annotation) notes.openNamed(state.annotation, { fly: !state.camera, isJump: false });
    else notes.tour.close();
  }

  /** @param {SavedView} view */
  goTo({ camera, display, name }) {
    this.current.scene?.goTo(cameraOf(camera), { isJump: true });
    this.look.show(display);
    chrome.announce(name);
  }

  /**
   * A note: as it was looked at when it was written, or from here.
   * @param {Note} note
   * @param {boolean} isJump
   */
  lookAt({ camera, display, place }, isJump) {
    const { scene } = this.current;
    if (camera) scene?.goTo(cameraOf(camera), { isJump });
    else scene?.lookAtPlace(place, { isJump });
    if (display) this.look.show(display);
  }

  /** Brings the address up to date; the end of the file, which names the pack, may still be on its way. */
  async #bringAddress() {
    const identity = this.current.model?.identity;
    const address = this.address();
    address.now();
    const late = new Promise((resolve) => setTimeout(resolve, CLIPBOARD_MS));
    if (identity && !identity.text) await Promise.race([identity.known(), late]);
    address.now();
  }

  /** Offer what is seen to others: the dialog comes when it is first opened. */
  async openShare() {
    const { model } = this.current;
    if (!model) return;
    try {
      const [{ ShareDialog }] = await Promise.all([import("./share.js"), this.#bringAddress()]);
      this.#dialog ??= new ShareDialog();
      const { tools } = this.measuring;
      const save = () => tools?.files.save("json");
      this.#dialog.open({ title: model.title, link: location.href, isLocal: model.pack.isLocal, isLong: Boolean(tools?.isLong), save });
    } catch (error) {
      chrome.notice(t("shareBroken", { why: error.message }));
    }
  }

  /** The address of what is seen, to the clipboard. */
  async share() {
    try {
      await this.#bringAddress();
      await navigator.clipboard.writeText(location.href);
      const { tools } = this.measuring;
      if (tools?.isLong) chrome.notice(t("measureLinkLong"), 12000, { label: t("exportFile"), run: () => tools.files.save("json") });
      else chrome.notice(t("shared"), 2500);
    } catch {
      chrome.notice(t("shareFailed"));
    }
  }
}
