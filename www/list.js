// An ordered list that can be edited: each row goes somewhere when pressed, and opens to be renamed, moved or deleted.
// Names are only ever put in as text.

import { t } from "./i18n.js";

const SVG = "http://www.w3.org/2000/svg";

export function icon(name) {
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("class", "icon");
  svg.setAttribute("aria-hidden", "true");
  const use = document.createElementNS(SVG, "use");
  use.setAttribute("href", `icons/sprite.svg#${name}`);
  svg.append(use);
  return svg;
}

/** A button with a picture; `key` names its string, `about` what it is about (for readers). */
export function iconButton(name, key, about = "") {
  const button = Object.assign(document.createElement("button"), { type: "button", className: "button icon" });
  button.dataset.label = key;
  button.setAttribute("aria-label", about ? `${t(key)}: ${about}` : t(key));
  button.append(icon(name));
  return button;
}

export class EditList {
  /**
   * @param {HTMLOListElement} element
   * @param {object} on `go(item)`, `rename(item, name)` or null, `edit(item)` or null, `move(item, by)`, `remove(item)`, `name(item)`
   */
  constructor(element, on) {
    this.element = element;
    this.on = on;
    this.open = null; // id of the row that is open for editing
    this.current = null; // id of the row that is shown
  }

  show(items) {
    this.items = items;
    const active = this.element.contains(document.activeElement) ? document.activeElement.dataset : null;
    const focus = active ? `[data-id="${CSS.escape(active.id ?? "")}"][data-act="${active.act}"]` : null;
    this.element.replaceChildren(...items.map((item, at) => this.#row(item, at)));
    if (focus) (this.element.querySelector(`${focus}:not(:disabled)`) ?? this.element.querySelector("button"))?.focus();
  }

  /** Open a row and stand in its name. */
  edit(id) {
    this.open = id;
    this.show(this.items);
    const name = this.element.querySelector(`input[data-id="${CSS.escape(id)}"]`);
    name?.focus();
    name?.select();
  }

  #row(item, at) {
    const name = this.on.name(item);
    const li = document.createElement("li");
    const line = document.createElement("div");
    line.className = "row";
    const act = (button, what, run) => {
      button.dataset.id = item.id;
      button.dataset.act = what;
      button.addEventListener("click", run);
      return button;
    };
    const go = Object.assign(document.createElement("button"), { type: "button", className: "go" });
    const number = Object.assign(document.createElement("span"), { className: "pin-number", textContent: at + 1 });
    const label = Object.assign(document.createElement("span"), { className: "name", textContent: name, dir: "auto" });
    go.append(number, label);
    if (item.id === this.current) go.setAttribute("aria-current", "true");
    const isOpen = this.open === item.id;
    const more = act(iconButton("edit", "edit", name), "more", () => {
      this.open = isOpen ? null : item.id;
      this.show(this.items);
    });
    more.setAttribute("aria-expanded", String(isOpen));
    line.append(
      act(go, "go", () => this.on.go(item)),
      more,
    );
    li.append(line);
    if (isOpen) li.append(this.#strip(item, at, name, act));
    return li;
  }

  #strip(item, at, name, act) {
    const strip = document.createElement("div");
    strip.className = "strip";
    if (this.on.rename) {
      const input = Object.assign(document.createElement("input"), { value: name, maxLength: 200, dir: "auto", autocomplete: "off" });
      input.setAttribute("aria-label", t("name"));
      input.dataset.id = item.id;
      input.dataset.act = "name";
      let known = name;
      const rename = () => {
        const given = input.value.trim();
        if (!given || given === known) return;
        // Set before the list is redrawn: removing the field while it has the focus can fire a second change event.
        known = given;
        this.on.rename(item, given);
      };
      input.addEventListener("change", rename);
      input.addEventListener("keydown", (event) => {
        if (event.key !== "Enter" && event.key !== "Escape") return;
        event.preventDefault();
        if (event.key === "Enter") rename();
        else known = input.value.trim();
        this.open = null;
        this.show(this.items);
        this.element.querySelector(`.go[data-id="${CSS.escape(item.id)}"]`)?.focus();
      });
      strip.append(input);
    }
    if (this.on.edit) {
      const edit = act(Object.assign(document.createElement("button"), { type: "button", className: "button outlined" }), "edit", () => this.on.edit(item));
      edit.textContent = t("noteEdit");
      strip.append(edit);
    }
    const up = act(iconButton("up", "moveUp", name), "up", () => this.on.move(item, -1));
    const down = act(iconButton("down", "moveDown", name), "down", () => this.on.move(item, 1));
    up.disabled = at === 0;
    down.disabled = at === this.items.length - 1;
    const remove = act(iconButton("delete", "delete", name), "delete", () => this.on.remove(item));
    strip.append(up, down, remove);
    return strip;
  }
}

/** A list with one thing moved by some places. */
export function moved(list, item, by) {
  const at = list.indexOf(item);
  const to = Math.max(0, Math.min(list.length - 1, at + by));
  const rest = list.filter((other) => other !== item);
  rest.splice(to, 0, item);
  return rest;
}
