// Elements made by code: texts only ever as text.

import { t } from "../i18n.js";

const SVG = "http://www.w3.org/2000/svg";

/** An element: `on…` are listeners, `text` its content, `key` the string that is its content and stays so in every language. */
export function h(tag, options = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(options)) {
    if (value === undefined || value === null || value === false) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "text") element.textContent = value;
    else if (name === "key") Object.assign(element, { textContent: t(value) }).dataset.text = value;
    else if (name === "label") named(element, value);
    else if (name === "data") Object.assign(element.dataset, value);
    else if (name in element && typeof value !== "string") element[name] = value;
    else element.setAttribute(name === "className" ? "class" : name, value === true ? "" : value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** Its name for readers and its tooltip, in every language. */
function named(element, key) {
  element.dataset.label = key;
  element.setAttribute("aria-label", t(key));
}

/** A picture of this folder's own sheet, which is loaded with this code, or of the page's. */
export function icon(name, sheet = "measure") {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("class", ["undo", "redo"].includes(name) ? "icon mirror" : "icon");
  svg.setAttribute("aria-hidden", "true");
  const use = document.createElementNS(SVG, "use");
  use.setAttribute("href", `icons/${sheet}.svg#${name}`);
  svg.append(use);
  return svg;
}

/** A button that is a picture; `about` is what it is about, for readers. */
export function iconButton({ name, sheet = "measure", key, about = "", ...options }) {
  const button = h("button", { type: "button", className: "button icon", ...options }, icon(name, sheet));
  button.dataset.label = key;
  button.setAttribute("aria-label", about ? `${t(key)}: ${about}` : t(key));
  return button;
}
