// Everything round the picture that needs no model: tabs, the phone's sheet, popover, tooltips, dialogs, notices.

import { $ } from "./dom.js";
import { fill } from "./facts.js";
import { t } from "./i18n.js";
import { hasSheet, isSmall } from "./screen-size.js";
import { get, put } from "./store.js";

/** @import { NoticeAction } from "./types/page.js" */
/** @typedef {"about" | "measure" | "saved" | "notes" | "display" | "section" | "info"} TabName */

/** The element that an event happened to; null for a document or a window. @param {Event} event */
export const elementOf = ({ target }) => (target instanceof Element ? target : null);

/**
 * Show a tab of the panel, and the panel.
 * @param {TabName} name
 */
export function openTab(name) {
  if (hasSheet()) {
    if ($("panel").dataset.size === "peek") sheet("half");
  } else if (document.body.dataset.panel === "closed") {
    $("panel-toggle").click();
  }
  $(`tab-${name}`).click();
}

/** On a phone: the sheet goes down, so that the picture can be seen. */
export function peek() {
  if (hasSheet()) sheet("peek");
}

/** Tabs as WAI-ARIA has them: one in the tab order, arrows move, the panel follows. */
export function tabs() {
  const all = [.../** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("[role=tab]"))];
  const panelOf = (/** @type {Element} */ tab) => /** @type {HTMLElement} */ (document.getElementById(tab.getAttribute("aria-controls") ?? ""));
  // All tabs scroll in one element: each finds its own place again.
  const scroller = /** @type {HTMLElement} */ (document.querySelector(".sheet"));
  /** @type {Map<Element, number>} */
  const places = new Map();
  const select = (/** @type {HTMLElement} */ tab, { focus = false } = {}) => {
    const last = all.find((other) => other.getAttribute("aria-selected") === "true");
    if (last) places.set(last, scroller.scrollTop);
    for (const other of all) {
      const isIt = other === tab;
      other.setAttribute("aria-selected", String(isIt));
      other.tabIndex = isIt ? 0 : -1;
      panelOf(other).hidden = !isIt;
    }
    scroller.scrollTop = places.get(tab) ?? 0;
    if (focus) tab.focus();
    if ($("panel").dataset.size === "peek") sheet("half");
  };
  for (const [at, tab] of all.entries()) {
    tab.addEventListener("click", (event) => {
      // A press on the open tab closes the sheet; a script's press (openTab) only opens.
      const isOpen = event.isTrusted && tab.getAttribute("aria-selected") === "true" && $("panel").dataset.size !== "peek";
      if (hasSheet() && isOpen) sheet("peek");
      else select(tab);
    });
    tab.addEventListener("keydown", (event) => {
      const forward = document.documentElement.dir === "rtl" ? "ArrowLeft" : "ArrowRight";
      const back = document.documentElement.dir === "rtl" ? "ArrowRight" : "ArrowLeft";
      const to = { [forward]: at + 1, [back]: at - 1, Home: 0, End: all.length - 1 }[event.key];
      if (to === undefined) return;
      event.preventDefault();
      select(all[(to + all.length) % all.length], { focus: true });
    });
  }
}

/** @param {string} size */
function sheet(size) {
  $("panel").dataset.size = size;
}

/** The panel beside the picture, or the sheet below it on a phone: a press or a pull changes its size. */
export function panel() {
  sheet("peek");
  $("panel-toggle").addEventListener("click", () => {
    const isOpen = document.body.dataset.panel !== "closed";
    document.body.dataset.panel = isOpen ? "closed" : "open";
    $("panel-toggle").setAttribute("aria-expanded", String(!isOpen));
  });
  const sizes = ["peek", "half", "full"];
  const grip = $("grip");
  /** @type {number | null} */
  let from = null;
  grip.addEventListener("pointerdown", (event) => {
    from = event.clientY;
    grip.setPointerCapture(event.pointerId);
  });
  grip.addEventListener("pointerup", (event) => {
    if (from === null) return;
    const pulled = from - event.clientY;
    from = null;
    if (Math.abs(pulled) < 12) return;
    const at = sizes.indexOf($("panel").dataset.size ?? "") + Math.sign(pulled);
    sheet(sizes[Math.max(0, Math.min(2, at))]);
    grip.dataset.pulled = "yes";
  });
  grip.addEventListener("click", () => {
    if (grip.dataset.pulled) return delete grip.dataset.pulled;
    return sheet(sizes[(sizes.indexOf($("panel").dataset.size ?? "") + 1) % 3]);
  });
}

const WIDTH = { usual: 360, min: 280, step: 24 };

/** The edge of the panel beside the picture: dragged, or moved by arrows; a double click makes it as usual. The browser keeps it. */
export function divider() {
  const edge = $("divider");
  const max = () => Math.max(WIDTH.min, Math.min(800, innerWidth - 400));
  const held = (/** @type {number} */ width) => Math.round(Math.max(WIDTH.min, Math.min(max(), width)));
  let width = Number(get("panel", WIDTH.usual)) || WIDTH.usual;
  const show = () => {
    if (width === WIDTH.usual) document.body.style.removeProperty("--panel");
    else document.body.style.setProperty("--panel", `${held(width)}px`);
    for (const [name, value] of [
      ["min", WIDTH.min],
      ["max", max()],
      ["now", held(width)],
    ])
      edge.setAttribute(`aria-value${name}`, String(value));
  };
  const set = (/** @type {number} */ value, { keep = true } = {}) => {
    width = held(value);
    show();
    if (keep) put("panel", width === WIDTH.usual ? null : width);
  };
  const isRtl = () => document.documentElement.dir === "rtl";
  const at = (/** @type {PointerEvent} */ event) => (isRtl() ? event.clientX : innerWidth - event.clientX);
  /** @type {number | null} */
  let grabbed = null;
  edge.addEventListener("pointerdown", (event) => {
    if (event.button !== 0) return;
    edge.setPointerCapture(event.pointerId);
    edge.classList.add("moving");
    grabbed = $("panel").offsetWidth - at(event);
  });
  edge.addEventListener("pointermove", (event) => grabbed !== null && set(at(event) + grabbed, { keep: false }));
  for (const type of ["pointerup", "pointercancel"]) {
    edge.addEventListener(type, () => {
      if (grabbed === null) return;
      grabbed = null;
      edge.classList.remove("moving");
      set(width);
    });
  }
  edge.addEventListener("dblclick", () => set(WIDTH.usual));
  edge.addEventListener("keydown", (event) => {
    const wider = isRtl() ? "ArrowRight" : "ArrowLeft";
    const step = WIDTH.step * (event.shiftKey ? 4 : 1);
    if (event.key === "ArrowLeft" || event.key === "ArrowRight") set(held(width) + (event.key === wider ? step : -step));
    else if (event.key === "Home") set(WIDTH.min);
    else if (event.key === "End") set(max());
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
  addEventListener("resize", show);
  show();
}

/** Keys of one letter, figure or sign, which some people press without meaning to (WCAG 2.1.4): on, or off. */
export function keys() {
  const box = $("keys-on");
  box.checked = get("keys", true) !== false;
  const show = () => (document.body.dataset.keys = box.checked ? "on" : "off");
  box.addEventListener("change", () => {
    put("keys", box.checked ? null : false);
    show();
  });
  show();
}

/**
 * A menu below a button: arrows move, Escape and a press elsewhere close.
 * @param {HTMLElement} button
 * @param {HTMLElement} list
 * @param {(item: HTMLElement) => void} choose
 */
export function menu(button, list, choose) {
  const items = [.../** @type {NodeListOf<HTMLElement>} */ (list.querySelectorAll("[role=menuitem]"))];
  const show = (/** @type {boolean} */ open) => {
    list.hidden = !open;
    button.setAttribute("aria-expanded", String(open));
    if (open) items[0].focus();
  };
  button.addEventListener("click", () => show(Boolean(list.hidden)));
  list.addEventListener("keydown", (event) => {
    const at = items.indexOf(/** @type {HTMLElement} */ (document.activeElement));
    const to = { ArrowDown: at + 1, ArrowUp: at - 1, Home: 0, End: items.length - 1 }[event.key];
    if (to !== undefined) items[(to + items.length) % items.length].focus();
    else if (event.key === "Escape") {
      show(false);
      button.focus();
    } else if (event.key === "Tab") return show(false);
    else if (event.key.length === 1 && items[Number(event.key) - 1]) items[Number(event.key) - 1].click();
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
  for (const item of items) {
    item.addEventListener("click", () => {
      show(false);
      button.focus();
      choose(item);
    });
  }
  document.addEventListener("pointerdown", (event) => {
    const target = /** @type {Node} */ (event.target);
    if (!list.hidden && !list.contains(target) && !button.contains(target)) show(false);
  });
}

/** The names of the controls, and their keys, beside them while the pointer rests there or the focus is there. */
export function tooltips() {
  const tip = document.createElement("div");
  tip.className = "tip";
  tip.hidden = true;
  tip.setAttribute("aria-hidden", "true");
  document.body.append(tip);
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  const hide = () => {
    clearTimeout(timer);
    tip.hidden = true;
  };
  const show = (/** @type {HTMLElement} */ element) => {
    tip.textContent = t(element.dataset.label ?? "");
    if (element.dataset.key) {
      const key = document.createElement("kbd");
      key.textContent = element.dataset.key;
      tip.append(key);
    }
    tip.hidden = false;
    const box = element.getBoundingClientRect();
    const own = tip.getBoundingClientRect();
    const isBeside = element.closest(".rail") && !isSmall();
    const isRtl = document.documentElement.dir === "rtl";
    const x = isBeside ? (isRtl ? box.left - own.width - 8 : box.right + 8) : box.left + (box.width - own.width) / 2;
    const below = box.bottom + 6 + own.height < innerHeight ? box.bottom + 6 : box.top - own.height - 6;
    tip.style.left = `${Math.max(8, Math.min(innerWidth - own.width - 8, x))}px`;
    tip.style.top = `${isBeside ? box.top + (box.height - own.height) / 2 : below}px`;
  };
  const later = (/** @type {Event} */ event) => {
    const element = /** @type {HTMLElement | null} */ (elementOf(event)?.closest("[data-label]"));
    hide();
    if (element && /** @type {PointerEvent} */ (event).pointerType !== "touch") timer = setTimeout(() => show(element), 400);
  };
  document.addEventListener("pointerover", later);
  document.addEventListener("focusin", (event) => {
    if (elementOf(event)?.matches(":focus-visible")) later(event);
  });
  document.addEventListener("pointerdown", hide);
  document.addEventListener("focusout", hide);
  document.addEventListener("keydown", hide);
}

/** @type {ReturnType<typeof setTimeout> | undefined} */
let noticeTimer;
/**
 * One sentence above the picture's lower edge, for a while; with `action` a button beside it.
 * @param {string} text
 * @param {number} milliseconds
 * @param {NoticeAction | null} action
 */
export function notice(text, milliseconds = 6000, action = null) {
  clearTimeout(noticeTimer);
  $("notice-text").textContent = text;
  $("notice-action").hidden = !action;
  $("notice-action").textContent = action?.label ?? "";
  $("notice-action").onclick = () => {
    quiet();
    action?.run();
  };
  $("notice").hidden = false;
  const quiet = () => ($("notice").hidden = true);
  const later = () => {
    // It stays while someone is about to press its button.
    if ($("notice").matches(":hover, :focus-within")) noticeTimer = setTimeout(later, 2000);
    else quiet();
  };
  noticeTimer = setTimeout(later, milliseconds);
}

/**
 * The next step of a tool, above the picture; nothing hides it.
 * @param {string | null | undefined} text
 */
export function hint(text) {
  $("hint").textContent = text ?? "";
  $("hint").hidden = !text;
}

/**
 * For screen readers: what happened.
 * @param {string} text
 */
export function announce(text) {
  $("announce").textContent = text;
}

/** Hide or show everything but the model. */
export function toggleChrome() {
  const isHidden = document.body.dataset.chrome === "hidden";
  document.body.dataset.chrome = isHidden ? "shown" : "hidden";
  $("show-again").hidden = isHidden;
}

/** The help dialog, written anew for the language. */
export function help() {
  fill($("help-mouse"), [
    [t("turn"), t("leftDrag")],
    [t("move"), t("rightDrag")],
    [t("zoom"), t("wheel")],
    [t("pivot"), t("doubleClick")],
    [t("standThere"), t("doubleClick")],
  ]);
  fill($("help-touch"), [
    [t("turn"), t("oneFinger")],
    [t("move"), t("twoFingers")],
    [t("zoom"), t("pinch")],
    [t("lean"), t("twist")],
    [t("pivot"), t("doubleTap")],
  ]);
  fill($("help-keys"), [
    [t("turn"), t("arrows")],
    [t("move"), t("shiftArrows")],
    [t("zoom"), "+ −"],
    [t("fit"), "F"],
    [t("views6"), "1 – 7"],
    [t("viewBack"), "Z"],
    [t("viewForward"), t("shiftKey", { key: "Z" })],
    [t("viewSave"), "B"],
    [t("freely"), "T"],
    [t("orthographic"), "O"],
    [t("picture"), "P"],
    [t("hide"), "H"],
    [t("help"), "?"],
  ]);
  fill($("help-walk"), [
    [t("toolWalk"), "W"],
    [t("walkForward"), "W ↑"],
    [t("walkBack"), "S ↓"],
    [t("walkSides"), "A D"],
    [t("turn"), "← →"],
    [t("walkRun"), t("shiftKey", { key: "" }).trim()],
    [t("eyeChange"), "Q E"],
    [t("walkLeave"), "Esc"],
  ]);
  fill($("help-measure"), [
    [t("toolMeasure"), "M"],
    [t("notePoint"), t("arrows")],
    [t("measurePick"), t("spaceKey")],
    [t("measureFinish"), "Enter"],
    [t("measureBack"), t("backspaceKey")],
    [t("measureSnap"), t("shiftKey", { key: "" }).trim()],
    [t("cancel"), "Esc"],
  ]);
  fill($("help-notes"), [
    [t("toolNote"), "N"],
    [t("notePoint"), t("arrows")],
    [t("noteChoose"), t("spaceKey")],
    [t("cancel"), "Esc"],
    [t("undo"), "Ctrl Z"],
    [t("redo"), t("shiftKey", { key: "Ctrl Z" })],
  ]);
}
