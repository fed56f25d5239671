// What the buttons and fields of the page do that need a model: each is connected once, to the model that is open when it is pressed.

import * as chrome from "./chrome.js";
import { $, input } from "./dom.js";
import { remember, t, use } from "./i18n.js";
import { openers } from "./local-pack.js";
import { readJson } from "./store.js";

/** @import { Ids, IdsOf } from "./types/ids.js" */
/** @import { Measuring } from "./measuring.js" */
/** @import { Current } from "./current.js" */
/** @import { Toolbox } from "./toolbox.js" */
/** @import { Undo } from "./undo.js" */

/** Bytes of a document that is read at most. */
const MAX_DOCUMENT = 64e6;

/**
 * @typedef {object} ControlParts
 * @property {Current} current
 * @property {import("./actions.js").InputActions} actions
 * @property {Measuring} measuring
 * @property {Toolbox} toolbox
 * @property {Undo} undo
 * @property {import("./link.js").Address} address
 * @property {() => void} share offer what is seen to others
 * @property {(file: File) => void} openFile open a pack of this computer
 */

/**
 * @param {keyof Ids} id
 * @param {() => void} action
 */
const click = (id, action) => $(id).addEventListener("click", action);

/** @param {ControlParts} parts */
export function connect(parts) {
  chrome.tabs();
  chrome.panel();
  chrome.divider();
  chrome.keys();
  chrome.tooltips();
  chrome.help();
  navigation(parts);
  documents(parts);
  edits(parts);
  const { actions, toolbox, share } = parts;
  click("hide", actions.hide);
  click("show-again", actions.hide);
  click("help-open", actions.help);
  click("share", share);
  click("picture-open", actions.picture);
  click("fullscreen", () => (document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen()));
  click("trouble-retry", () => location.reload());
  for (const tool of /** @type {const} */ (["orbit", "pan"])) click(`tool-${tool}`, () => toolbox.choose(tool));
  for (const tool of /** @type {const} */ (["walk", "note", "measure"])) click(`tool-${tool}`, () => toolbox.toggle(tool));
  click("walk-leave", () => toolbox.choose("orbit"));
  $("language").value = document.documentElement.lang;
  $("language").addEventListener("change", async () => {
    remember($("language").value);
    await use($("language").value);
  });
}

/** Views and moves of the camera. @param {ControlParts} parts */
function navigation({ actions, current }) {
  const look = (/** @type {HTMLElement} */ button) => actions.view(button.dataset.view ?? "");
  chrome.menu($("views-open"), $("views"), look);
  for (const button of /** @type {NodeListOf<HTMLElement>} */ ($("grid-views").querySelectorAll("[data-view]"))) {
    button.addEventListener("click", () => look(button));
  }
  click("fit", actions.fit);
  click("zoom-in", () => current.scene?.input.zoom(0.7));
  click("zoom-out", () => current.scene?.input.zoom(1 / 0.7));
  click("view-back", actions.back);
  click("view-forward", actions.forward);
  click("view-save", actions.save);
  click("saved-export", () => current.saved?.export());
  $("saved").addEventListener("change", (event) => {
    const field = /** @type {HTMLInputElement} */ (event.target);
    if (field.name === "turning") current.scene?.setFree(field.value === "free");
  });
}

/** Files, and the notes. @param {ControlParts} parts */
function documents({ current, measuring, toolbox, address, openFile }) {
  const chosen = (/** @type {IdsOf<HTMLInputElement>} */ id, /** @type {(file: File) => unknown} */ read) => {
    $(id).addEventListener("change", async () => {
      const [file] = $(id).files ?? [];
      $(id).value = ""; // The same file again is a choice too.
      if (file) await read(file);
    });
  };
  chosen("saved-import", (file) => current.saved?.import(file));
  chosen("notes-import", (file) => current.notes?.import(file));
  click("note-new", () => toolbox.choose("note"));
  click("tour-start", () => {
    const first = current.notes?.notes[0];
    if (first) current.notes?.open(first, { focus: true });
  });
  click("notes-export", () => current.notes?.export());
  click("notes-published", () => current.notes?.revert());
  $("notes-shown").addEventListener("change", () => {
    current.notes?.setShown($("notes-shown").checked);
    address.later();
  });
  addEventListener("pagehide", () => current.notes?.closeForm());

  /** A document that was dropped: its own fields state what it holds. */
  const readDocument = async (/** @type {File} */ file) => {
    if (!current.notes) return;
    try {
      const json = await readJson(file, MAX_DOCUMENT);
      if (json?.kilwa === "measurements") await (await measuring.load()).files.read(file);
      else if (json?.type === "KilwaViews") await current.saved?.import(file);
      else if (json?.name === "holes") (await import("./holes.js")).offer(current, () => json, true);
      else await current.notes?.import(file);
    } catch (error) {
      chrome.notice(t("importFailed", { why: error.message }), 12000);
    }
  };
  const open = (/** @type {File} */ file) => (/\.(geo)?json(ld)?$/i.test(file.name) ? readDocument(file) : openFile(file));
  openers({ input: $("open-file"), drop: $("drop"), open });
}

/** The list of a tab of the panel. @type {Record<string, import("./undo.js").Scope>} */
const SCOPES = { notes: "notes", saved: "views", measure: "measurements" };

/** Undo and redo. @param {ControlParts} parts */
function edits({ undo, measuring }) {
  click("edit-undo", () => undo.undo("notes"));
  click("edit-redo", () => undo.redo("notes"));
  // Where the keyboard is not in a text.
  addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.altKey || chrome.elementOf(event)?.closest("input, textarea, select")) return;
    const key = event.key.toLowerCase();
    if (key !== "z" && key !== "y") return;
    const isRedo = key === "y" || event.shiftKey;
    event.preventDefault();
    if (measuring.undo(isRedo)) return;
    // A tab with a list of its own takes back what happened in that list; elsewhere it is the newest edit.
    const tab = document.querySelector("[role=tab][aria-selected=true]")?.getAttribute("aria-controls") ?? "";
    const scope = SCOPES[tab] ?? null;
    const edit = isRedo ? undo.redo(scope) : undo.undo(scope);
    if (edit) chrome.notice(t(isRedo ? "redoneNamed" : "undoneNamed", { what: t(edit.name) }));
  });
}

/** @param {boolean} isFree */
export function showTurning(isFree) {
  input(`input[name=turning][value=${isFree ? "free" : "turntable"}]`).checked = true;
}
