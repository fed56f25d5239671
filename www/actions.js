// Applies the actions of keys, pointers and buttons to the open model.

import * as chrome from "./chrome.js";
import { $ } from "./dom.js";

/** @import { Placing, Tool } from "./types/page.js" */

/**
 * What keys and pointers ask for; places are pixels of the picture.
 * @typedef {object} InputActions
 * @property {(x: number, y: number) => void} hover
 * @property {() => void} leave
 * @property {(at: [number, number] | null) => void} aim
 * @property {(x: number, y: number, how: Placing) => void} place
 * @property {(key: string) => boolean} step a key while a place is chosen; false where it means nothing
 * @property {() => void} fit
 * @property {(name: string) => void} view
 * @property {() => void} hide
 * @property {() => void} help
 * @property {() => void} parallel
 * @property {() => void} free
 * @property {(name: Tool) => void} tool
 * @property {() => void} save
 * @property {() => void} picture
 * @property {() => void} back
 * @property {() => void} forward
 */

/**
 * @param {object} parts
 * @param {import("./current.js").Current} parts.current
 * @param {import("./measuring.js").Measuring} parts.measuring
 * @param {import("./pictures.js").Pictures} parts.pictures
 * @param {import("./screen.js").Screen} parts.screen
 * @param {import("./toolbox.js").Toolbox} parts.toolbox
 */
export function actionsOf({ current, measuring, pictures, screen, toolbox }) {
  const open = () => (current.isOpen ? current.scene : null);
  /** @type {InputActions} */
  const actions = {
    hover: (x, y) => {
      if (!current.scene) return;
      screen.status.hover(current.scene.viewer, x, y);
      if (current.scene.input.tool === "measure") measuring.hover(x, y);
    },
    leave: () => screen.status.leave(),
    aim: (at) => {
      current.scene?.loupe.show(at);
      if (at) actions.hover(...at);
    },
    step: (key) => measuring.key(key),
    fit: () => current.scene?.fit(),
    view: (name) => current.scene?.standardView(name),
    hide: () => chrome.toggleChrome(),
    help: () => $("help").showModal(),
    parallel: () => open()?.setOrthographic(!open()?.viewer.camera().orthographic),
    free: () => open()?.setFree(!open()?.input.isFree),
    tool: (name) => toolbox.choose(name),
    place: (x, y, how) => toolbox.place(x, y, how),
    save: () => {
      const saved = open() && current.saved;
      if (!saved) return;
      const view = saved.add();
      chrome.openTab("saved");
      saved.list.edit(view.id);
    },
    picture: () => open() && pictures.open(),
    back: () => current.scene?.flight.back(),
    forward: () => current.scene?.flight.forward(),
  };
  return actions;
}
