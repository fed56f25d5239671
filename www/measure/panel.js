// The Measurements tab: the tools, what they need to be told, and the table. Values are text that can be selected and copied; a row opens to
// say everything of its measurement. Names and notes are only ever put in as text.

import { bytes as sizeOf, length } from "../format.js";
import { t } from "../i18n.js";
import { sentence } from "../said.js";
import { h, icon, iconButton } from "./dom.js";
import { FORMATS } from "./files.js";
import { GROUPS, SNAPS, TOOLS, kindName, toolOf } from "./tools.js";
import { UNITS, readingName, text } from "./values.js";

const $ = (id) => document.getElementById(id);
const PLANES = { fitted: "planeFitted", lowest: "planeLowest", height: "planeAtHeight" };
const PARTS = { lattice: "partLattice", level: "partLevel", capture: "partCapture" };

export class Panel {
  /** @param {import("./measure.js").Measure} measure */
  constructor(measure) {
    this.measure = measure;
    this.sentences = new Map(); // citations, by id
    this.rows = new Map();
    this.build();
  }

  close() {
    $("measure").replaceChildren(h("p", { className: "quiet", key: "measureLoading" }));
  }

  /** All of the tab; again in another language. */
  build() {
    const { measure } = this;
    this.rows.clear();
    const toolButton = (tool) =>
      h(
        "button",
        { type: "button", className: "tool", data: { tool: tool.id }, "aria-pressed": "false", onclick: () => this.#use(tool) },
        icon(tool.id),
        h("span", { key: tool.key }),
      );
    const often = TOOLS.filter((tool) => tool.often);
    this.more = h(
      "details",
      { className: "more-tools" },
      h("summary", {}, icon("more"), h("span", { key: "measureMore" }), (this.inUse = h("strong"))),
      ...GROUPS.map(([key, ids]) => h("section", {}, h("h3", { key }), h("div", { className: "tools" }, ...ids.map((id) => toolButton(toolOf(id)))))),
    );
    const options = (keys) => Object.entries(keys).map(([value, key]) => h("option", { value, key }));
    this.snap = h("select", { onchange: (e) => measure.setSnap(e.target.value) }, ...options(SNAPS));
    this.unit = h("select", { onchange: (e) => measure.setUnit(e.target.value) }, ...UNITS.map((u) => h("option", { value: u, text: u })));
    this.planeBy = h("select", { onchange: () => this.showTools() }, ...options(PLANES));
    this.height = h("input", { type: "number", step: "any", inputmode: "decimal", value: "0" });
    this.every = h("input", { type: "number", min: "0", step: "any", inputmode: "decimal", value: String(this.#usualInterval()) });
    this.heightRow = h("label", { className: "field", hidden: true }, h("span", { key: "planeHeight" }), this.height);
    this.planeRow = h("label", { className: "field", hidden: true }, h("span", { key: "planeBy" }), this.planeBy);
    // Rows wrap where a value is wide, which takes the roles of a table away: they are said.
    this.body = h("tbody", { role: "rowgroup" });
    this.table = h(
      "table",
      { className: "measure-table", role: "table" },
      h("caption", { className: "hidden", key: "measurements" }),
      h(
        "thead",
        { className: "hidden", role: "rowgroup" },
        h("tr", { role: "row" }, h("th", { role: "columnheader", key: "name" }), h("th", { role: "columnheader", key: "channel" })),
      ),
      this.body,
    );
    this.none = h("p", { className: "quiet", key: "measureNone" });
    this.format = h("select", { label: "measureFormat" }, ...FORMATS.map(([value, key]) => h("option", { value, key })));
    this.save = h("button", { type: "button", className: "button outlined", key: "exportFile", onclick: () => measure.files.save(this.format.value) });
    const file = h("input", { className: "hidden", type: "file", id: "measure-import", accept: ".json,application/json" });
    file.dataset.aria = "importFile";
    file.setAttribute("aria-label", t("importFile"));
    file.addEventListener("change", () => {
      const [chosen] = file.files;
      file.value = "";
      if (chosen) measure.files.read(chosen);
    });
    this.undo = h(
      "button",
      { type: "button", className: "button outlined", onclick: () => measure.page.undo.undo() },
      icon("undo", "sprite"),
      h("span", { key: "undo" }),
    );
    this.redo = h(
      "button",
      { type: "button", className: "button outlined", onclick: () => measure.page.undo.redo() },
      icon("redo", "sprite"),
      h("span", { key: "redo" }),
    );
    this.long = h("p", { className: "quiet", key: "measureLinkLong", hidden: true });
    this.clear = h("button", { type: "button", className: "button outlined", key: "measureDeleteAll", onclick: () => measure.removeAll() });
    $("measure").replaceChildren(
      h("div", { className: "tools often" }, ...often.map(toolButton)),
      this.more,
      this.planeRow,
      this.heightRow,
      h("label", { className: "field" }, h("span", { key: "measureSnap" }), this.snap),
      h("label", { className: "field" }, h("span", { key: "measureUnit" }), this.unit),
      h("h2", { key: "measurements" }),
      this.none,
      this.table,
      this.long,
      h("p", { className: "actions" }, this.undo, this.redo, this.clear),
      h(
        "p",
        { className: "actions" },
        this.format,
        this.save,
        h("label", { className: "button outlined", for: "measure-import" }, h("span", { key: "importFile" })),
        file,
      ),
    );
    // Beside the tool that it is for.
    this.more.lastElementChild.append(h("label", { className: "field" }, h("span", { key: "contoursEvery" }), this.every));
    this.showTools();
    this.show();
  }

  /** The list of all tools makes room for the table again. */
  #use(tool) {
    this.more.open = false;
    this.measure.use(tool.id);
  }

  /** A twentieth of the height, as a round number. */
  #usualInterval() {
    const { bounds_min: low, bounds_max: high } = this.measure.page.info.metadata;
    const value = Math.max((high[2] - low[2]) / 20, 1e-4);
    const power = 10 ** Math.floor(Math.log10(value));
    const lead = value / power;
    return Number(((lead >= 5 ? 5 : lead >= 2 ? 2 : 1) * power).toPrecision(2));
  }

  /** What the tool in use needs to be told, and which it is. */
  showTools() {
    const { measure } = this;
    if (!this.table) return;
    const { draft, kind, snap, unit } = measure;
    for (const button of $("measure").querySelectorAll("[data-tool]"))
      button.setAttribute("aria-pressed", String(Boolean(draft) && button.dataset.tool === kind.id));
    this.inUse.textContent = draft && !kind.often ? t(kind.key) : "";
    this.snap.value = snap;
    this.unit.value = unit;
    const isIn = (id) => Boolean(draft) && kind.id === id;
    this.planeRow.hidden = !(isIn("cut-fill") || isIn("deviation"));
    this.heightRow.hidden = this.planeRow.hidden || this.planeBy.value !== "height";
  }

  /** What cut and fill and deviation count from. */
  planeChoice() {
    const name = this.planeBy.value;
    return name === "height" ? { name, height: Number(this.height.value) } : { name };
  }

  interval() {
    return Number(this.every.value);
  }

  /** The table. */
  show() {
    const { measure } = this;
    if (!this.table) return;
    const { items, page } = measure;
    const active = document.activeElement;
    const focus = this.body.contains(active) ? { id: active.closest("[data-id]")?.dataset.id, act: active.dataset.act } : null;
    const typed =
      focus && ["INPUT", "TEXTAREA"].includes(active.tagName) && active.type !== "color"
        ? { value: active.value, from: active.selectionStart, to: active.selectionEnd }
        : null;
    this.body.replaceChildren(...items.flatMap((item, at) => this.#row(item, at)));
    if (focus?.id) {
      const rows = [...this.body.querySelectorAll(`[data-id="${CSS.escape(focus.id)}"]`)];
      const again =
        rows.map((r) => r.querySelector(`[data-act="${focus.act}"]:not(:disabled)`)).find(Boolean) ??
        rows[0]?.querySelector("button") ??
        this.body.querySelector("button");
      again?.focus();
      if (typed && again?.dataset.act === focus.act) {
        again.value = typed.value;
        again.setSelectionRange?.(typed.from, typed.to);
      }
    }
    this.none.hidden = items.length > 0;
    this.table.hidden = items.length === 0;
    this.save.disabled = this.clear.disabled = items.length === 0;
    this.undo.disabled = page.undo.done.length === 0;
    this.redo.disabled = page.undo.undone.length === 0;
    this.long.hidden = !measure.isLong;
  }

  progress(task) {
    const item = this.measure.items.find((i) => i.task === task);
    const bar = item && this.body.querySelector(`[data-id="${CSS.escape(item.id)}"] progress`);
    if (bar && task.progress !== null) bar.value = task.progress;
    if (bar) bar.title = task.waiting ? t("offline", { seconds: Math.ceil(task.waiting) }) : "";
  }

  focus(id) {
    const button = this.body.querySelector(`[data-id="${CSS.escape(id)}"] .go`);
    button?.focus();
    button?.scrollIntoView({ block: "nearest" });
  }

  #row(item, at) {
    const { measure } = this;
    const isOpen = measure.chosen === item.id;
    const swatch = h("span", { className: "swatch", "aria-hidden": "true" });
    swatch.style.setProperty("--mark", item.color);
    const go = h(
      "button",
      { type: "button", className: "go", "aria-expanded": String(isOpen), data: { act: "go" }, onclick: () => measure.choose(item.id) },
      swatch,
      h("span", { className: "name", text: item.name, dir: "auto" }),
      item.hidden && icon("hide", "sprite"),
    );
    go.addEventListener("keydown", (event) => {
      const by = event.altKey ? { ArrowUp: -1, ArrowDown: 1 }[event.key] : undefined;
      if (by) measure.move(item, by);
      else if (event.key === "Delete") measure.remove(item);
      else return;
      event.preventDefault();
    });
    const row = h(
      "tr",
      { role: "row", data: { id: item.id }, className: isOpen ? "open" : undefined },
      h("th", { scope: "row", role: "rowheader" }, go),
      h("td", { role: "cell" }, this.#value(item)),
    );
    if (!isOpen) return [row];
    return [row, h("tr", { role: "row", className: "detail", data: { id: item.id } }, h("td", { role: "cell", colSpan: 2 }, this.#detail(item, at)))];
  }

  /** The value: a press explains it, the text can be selected. */
  #value(item) {
    const { task } = item;
    if (["refused", "failed", "missed"].includes(task.state))
      return h("span", { className: "quiet", key: task.state === "missed" ? "stateMissed" : task.state === "failed" ? "stateFailed" : "stateRefused" });
    const lines = this.measure.lines(item);
    const box = h(
      "div",
      {
        className: task.isFinal ? "value" : "value dashed",
        onclick: () => getSelection().isCollapsed && this.measure.chosen !== item.id && this.measure.choose(item.id),
      },
      ...lines.map((line) => h("span", { text: line, dir: "auto" })),
    );
    if (task.state === "measuring") box.append(h("progress", { max: 1, value: task.progress ?? undefined, "aria-label": t("refiningNoValue") }));
    return box;
  }

  #detail(item, at) {
    const { measure } = this;
    const { task } = item;
    const { items, unit } = measure;
    const act = (name, sheet, key, what, run, more = {}) => iconButton({ name, sheet, key, about: item.name, data: { act: what }, onclick: run, ...more });
    const out = h("div", { className: "explain" });
    if (item.foreign)
      out.append(h("p", { className: "warn", text: t("measureForeign", { title: item.foreign.title, identity: item.foreign.identity.slice(0, 12) }) }));
    if (task.refusal) out.append(h("p", { className: "error", text: task.refusal() }));
    if (task.state === "missed") out.append(h("p", { className: "error", key: "measureMissed" }));
    if (["failed", "missed"].includes(task.state))
      out.append(h("button", { type: "button", className: "button outlined", key: "tryAgain", data: { act: "again" }, onclick: () => measure.again(item) }));
    const fact = (name, value) => h("div", {}, h("dt", { text: name }), h("dd", { text: value, dir: "ltr" }));
    if (task.readings.length > 0) {
      out.append(
        h("p", { className: "quiet", text: kindName(task.kind) }),
        h("dl", { className: "facts" }, ...task.readings.map((r) => fact(readingName(r.name), text(r, unit)))),
        ...this.#parts(task),
      );
    }
    out.append(this.#words(item));
    const sentence = this.sentences.get(item.id);
    if (sentence) {
      out.append(h("p", { className: "cited", text: sentence.words, dir: "auto" }));
      if (sentence.address) out.append(h("p", { className: "cited-address" }, h("a", { href: sentence.address, text: sentence.address, dir: "ltr" })));
    }
    if (task.fitted && task.kind.plane && task.isFinal) {
      out.append(
        h(
          "p",
          { className: "actions" },
          h("button", { type: "button", className: "button outlined", key: "measureMap", data: { act: "map" }, onclick: () => measure.map(item) }),
        ),
      );
    }
    if (task.answer) {
      out.append(
        h(
          "p",
          { className: "actions" },
          ...["svg", "dxf"].map((format) =>
            h("button", {
              type: "button",
              className: "button outlined",
              data: { act: format },
              text: t("measureDrawing", { format: format.toUpperCase() }),
              onclick: () => measure.files.draw(format, item),
            }),
          ),
        ),
      );
    }
    if (task.tool === "deviation" && task.isFinal) {
      out.append(
        h(
          "p",
          { className: "actions" },
          h("button", { type: "button", className: "button outlined", key: "deviationShow", data: { act: "colours" }, onclick: () => measure.colour(item) }),
        ),
      );
    }
    const color = h("input", { type: "color", value: item.color, data: { act: "color" } });
    color.setAttribute("aria-label", `${t("measureColor")}: ${item.name}`);
    color.addEventListener("change", () => measure.update(item.id, { color: color.value }));
    out.append(
      h(
        "div",
        { className: "strip" },
        act("look", "measure", "measureLook", "look", () => measure.look(item)),
        act("copy", "measure", "measureCopy", "copy", () => measure.copy(measure.words(item)), { disabled: !task.isFinal }),
        act("cite", "measure", "measureCite", "cite", () => measure.cite(item), { disabled: !task.isFinal }),
        color,
        act(item.hidden ? "show" : "hide", "sprite", item.hidden ? "measureShow" : "measureHide", "hide", () =>
          measure.update(item.id, { hidden: !item.hidden }),
        ),
        act("up", "sprite", "moveUp", "up", () => measure.move(item, -1), { disabled: at === 0 }),
        act("down", "sprite", "moveDown", "down", () => measure.move(item, 1), { disabled: at === items.length - 1 }),
        act("delete", "sprite", "delete", "delete", () => measure.remove(item)),
      ),
    );
    return out;
  }

  /** What an uncertainty is made of, and what was read for the value. */
  #parts({ uncertainty, parts, read, remarks }) {
    const own = uncertainty
      ? [
          ["lattice", uncertainty.lattice],
          ["level", uncertainty.level],
          ["capture", uncertainty.capture],
        ]
      : [];
    const value = (name, v) => (v === null || v === undefined ? t("unknownCapture") : typeof v === "number" ? (v === 0 ? "0" : length(v)) : String(v));
    const rows = own.map(([name, v]) =>
      h("div", {}, h("dt", { text: t(PARTS[name]) }), h("dd", { text: value(name, v), dir: name === "capture" && v === null ? "auto" : "ltr" })),
    );
    const more = parts.filter((p) => !(p.what in PARTS)).map((p) => h("div", {}, h("dt", { text: p.what }), h("dd", { text: value(p.what, p.value) })));
    if (read)
      more.push(
        h("div", {}, h("dt", { key: "measureRead" }), h("dd", { text: t("measureReadOf", { bytes: sizeOf(read.bytes), all: sizeOf(read.of_bytes) }) })),
      );
    if (rows.length + more.length === 0) return [];
    return [
      h("h3", { key: "measureUncertainty" }),
      h("dl", { className: "facts" }, ...rows, ...more),
      ...remarks.map((said) => h("p", { className: "quiet", text: sentence(said), dir: "auto" })),
    ];
  }

  #words(item) {
    const { measure } = this;
    const name = h("input", { value: item.name, maxLength: 200, dir: "auto", autocomplete: "off", data: { act: "name" } });
    name.value = item.name;
    name.addEventListener("change", () => {
      const given = name.value.trim();
      if (given && given !== item.name) measure.update(item.id, { name: given });
    });
    name.addEventListener("keydown", (event) => event.key === "Enter" && name.blur());
    const note = h("textarea", { rows: 2, maxLength: 20_000, dir: "auto", data: { act: "note" } });
    note.value = item.note;
    // Kept with every letter, so that a reload loses nothing; one edit to undo when the field is left.
    note.addEventListener("input", () => measure.type(item.id, note.value));
    note.addEventListener("change", () => measure.typed(item.id));
    return h("div", { className: "editor" }, h("label", {}, h("span", { key: "name" }), name), h("label", {}, h("span", { key: "note" }), note));
  }

  /** The sentence that cites a measurement, below it, and the address that leads back to it. */
  cited(id, words, address) {
    this.sentences.set(id, { words, address });
    this.show();
  }
}
