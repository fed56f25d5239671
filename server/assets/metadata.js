// The form for a metadata file (`kilwa metadata edit`): sends what is in the fields, shows mistakes beside them, and adds, moves and removes
// the blocks of repeated sections. What is right is decided by the program.

/** @typedef {{ place: string, label: string, advice: string, check: string, isMissing: boolean }} Fault */
/** @typedef {HTMLInputElement | HTMLTextAreaElement | HTMLSelectElement} Control */

/** @template {Element} E @param {string} selector @param {new () => E} kind @param {ParentNode} [inside] */
function find(selector, kind, inside = document) {
  const found = inside.querySelector(selector);
  if (!(found instanceof kind)) throw new Error(`the page has no ${selector}`);
  return found;
}

const form = find("#form", HTMLFormElement);
const summary = find("#summary", HTMLElement);
const statusLine = find("#status", HTMLElement);
const preview = find("#preview", HTMLDetailsElement);
const leave = find("#leave", HTMLDialogElement);
const conflict = find("#conflict", HTMLDialogElement);
/** @type {Record<string, string>} */
const messages = JSON.parse(form.dataset.messages ?? "{}");
const CONTROLS = "input, textarea, select";
/** Delay before the preview follows what is typed, milliseconds. */
const PAUSE = 400;

let hash = form.dataset.hash ?? "";
let file = find("#file", HTMLElement).textContent ?? "";
/** Numbers of new blocks, which name their fields. */
let added = 0;
/** A save that is on its way. */
let isSaving = false;
let isFinished = false;

/** A message with its values. @param {string} key @param {Record<string, string | number>} [values] */
function say(key, values = {}) {
  let text = messages[key] ?? key;
  for (const [name, value] of Object.entries(values)) text = text.replaceAll(`{${name}}`, () => String(value));
  return text;
}

/** @param {ParentNode} inside */
const controls = (inside) => /** @type {Control[]} */ ([...inside.querySelectorAll(CONTROLS)]);
/** @param {Control} control */
const keyOf = (control) => /** @type {HTMLElement} */ (control.closest(".input")).dataset.key ?? "";
/** @param {Element} row */
const valuesOf = (row) => Object.fromEntries(controls(row).map((control) => [keyOf(control), control.value]));
const lists = () => /** @type {HTMLElement[]} */ ([...form.querySelectorAll("section[data-path]")]);
/** @param {Element} list */
const rowsOf = (list) => /** @type {HTMLFieldSetElement[]} */ ([...list.querySelectorAll(".rows > .row")]);
/** A block that was added and left empty is not sent. @param {HTMLElement} row */
const isSent = (row) => row.dataset.from !== "" || Object.values(valuesOf(row)).some((value) => value.trim() !== "");

/** What the form holds. */
function collect() {
  const single = controls(form).filter((control) => !control.closest(".row"));
  const fields = Object.fromEntries(single.map((control) => [control.id, control.value]));
  const block = (/** @type {HTMLElement} */ row) => ({ from: row.dataset.from ? Number(row.dataset.from) : null, fields: valuesOf(row) });
  const blocks = Object.fromEntries(lists().map((list) => [list.dataset.path, rowsOf(list).filter(isSent).map(block)]));
  return { fields, blocks };
}

let kept = form.dataset.filled === "true" ? "" : JSON.stringify(collect());
const isChanged = () => !isFinished && JSON.stringify(collect()) !== kept;

/** @param {string} text @param {string} [kind] */
function report(text, kind = "") {
  // The same text again would be read out again, at every key.
  if (statusLine.textContent !== text) statusLine.textContent = text;
  statusLine.className = kind;
}

function showChanged() {
  if (isSaving) return;
  if (isChanged()) report(say("unsaved"), "changed");
  else if (statusLine.classList.contains("changed")) report(say("unchanged"));
}

/** The field of a mistake. @param {string} place */
function controlAt(place) {
  const [, path, at, key] = /^(.*)\.(\d+)\.([^.]*)$/.exec(place) ?? [];
  // The ids of blocks are those of the loaded page, where they may have stood elsewhere.
  const direct = path ? null : document.getElementById(place);
  if (direct?.matches(CONTROLS)) return /** @type {Control} */ (direct);
  const list = lists().find((one) => one.dataset.path === path);
  const row = list && rowsOf(list).filter(isSent)[Number(at)];
  return row && controls(row).find((control) => keyOf(control) === key);
}

/** @param {Control} control */
const errorOf = (control) => find(".error", HTMLElement, /** @type {Element} */ (control.closest(".input")));

function clearFaults() {
  for (const control of controls(form)) {
    if (!control.hasAttribute("aria-invalid")) continue;
    control.removeAttribute("aria-invalid");
    errorOf(control).hidden = true;
    errorOf(control).replaceChildren();
  }
  summary.replaceChildren();
}

/** What the check says, which is English in every language. @param {string} text */
function checkSays(text) {
  const says = document.createElement("span");
  says.className = "check";
  const words = document.createElement("bdi");
  words.lang = "en";
  words.textContent = text;
  says.append(`${say("checkSays")} `, words);
  return says;
}

/** Show mistakes at their fields, and above all a list of links to them. @param {string} title @param {Fault[]} faults @param {boolean} isDraft */
function showFaults(title, faults, isDraft) {
  clearFaults();
  if (faults.length === 0) return;
  const heading = document.createElement("h2");
  heading.textContent = say(title, { n: faults.length });
  const list = document.createElement("ul");
  for (const fault of faults) {
    const item = document.createElement("li");
    const control = controlAt(fault.place);
    if (control) {
      const error = errorOf(control);
      control.setAttribute("aria-invalid", "true");
      error.replaceChildren(fault.advice, ...(fault.check ? [checkSays(fault.check)] : []));
      error.hidden = false;
      const link = document.createElement("a");
      link.href = `#${control.id}`;
      const row = control.closest(".row")?.querySelector("legend")?.textContent;
      link.textContent = `${row ? `${row}: ` : ""}${fault.label}: ${fault.advice}`;
      link.addEventListener("click", (event) => {
        event.preventDefault();
        control.focus();
      });
      item.append(link);
    } else {
      item.append(`${fault.label} `, checkSays(fault.check));
    }
    list.append(item);
  }
  summary.classList.toggle("draft", isDraft);
  summary.replaceChildren(heading, list);
}

/** @param {string} what @param {boolean} [copy] */
async function send(what, copy = false) {
  const body = what === "done" ? null : JSON.stringify({ hash, lang: form.dataset.lang, values: collect(), ...(copy ? { copy } : {}) });
  const response = await fetch(what, { method: "POST", headers: { "content-type": "application/json" }, body });
  const isJson = response.headers.get("content-type")?.startsWith("application/json");
  const answer = isJson ? await response.json() : { kind: "failed", why: await response.text() };
  return { isOk: response.ok, answer };
}

/** Save; whether it was. @param {boolean} [copy] */
async function save(copy = false) {
  if (isSaving) return false;
  isSaving = true;
  report(say("saving"));
  const sent = JSON.stringify(collect());
  // Blocks may be moved and removed before the answer comes.
  const rows = lists().flatMap((list) =>
    rowsOf(list)
      .filter(isSent)
      .map((row, at) => /** @type {const} */ ([row, String(at)])),
  );
  try {
    const { isOk, answer } = await send("save", copy);
    if (isOk) saved(answer, sent, new Map(rows));
    else refused(answer);
    return isOk;
  } catch {
    report(say("unreachable"), "failed");
    return false;
  } finally {
    isSaving = false;
    if (isChanged() && !statusLine.classList.contains("failed")) report(say("unsaved"), "changed");
  }
}

/**
 * @param {{ hash: string, file: string, text: string, faults: Fault[], isCopy: boolean }} answer
 * @param {string} sent
 * @param {Map<HTMLElement, string>} rows
 */
function saved(answer, sent, rows) {
  hash = answer.hash;
  file = answer.file;
  find("#file", HTMLElement).textContent = file;
  document.getElementById("is-new")?.remove();
  const isSame = JSON.stringify(collect()) === sent;
  // Now each block that was sent is one of the file, in the order in which they were sent.
  for (const row of lists().flatMap(rowsOf)) row.dataset.from = rows.get(row) ?? "";
  kept = isSame ? JSON.stringify(collect()) : "";
  showFaults("draftTitle", answer.faults, true);
  const key = answer.isCopy ? "savedCopy" : answer.faults.length > 0 ? "savedDraft" : "saved";
  report(say(key, { file }));
  find("pre", HTMLElement, preview).textContent = answer.text;
  previews += 1;
}

/** @param {{ kind: string, faults?: Fault[], copy?: string, field?: string, why?: string }} answer */
function refused(answer) {
  report(say("cannotSave"), "failed");
  if (answer.kind === "wrong") {
    showFaults("wrongTitle", answer.faults ?? [], false);
    summary.focus();
  } else if (answer.kind === "changed") {
    find("#conflict-text", HTMLElement).textContent = say("conflictText", { file });
    find('[data-conflict="copy"]', HTMLElement).textContent = say("conflictCopy", { file: answer.copy ?? "" });
    conflict.showModal();
  } else if (answer.kind === "unwritable") {
    report(say("unwritable", { field: answer.field ?? "" }), "failed");
  } else {
    report(`${say("cannotSave")} ${answer.why ?? ""}`, "failed");
  }
}

/** Numbers of previews: an answer that a newer one has overtaken is not shown. */
let previews = 0;

/** The text that would be written. */
async function showPreview() {
  const pre = find("pre", HTMLElement, preview);
  previews += 1;
  const own = previews;
  try {
    const { isOk, answer } = await send("check");
    if (own !== previews) return;
    pre.textContent = isOk ? answer.text : answer.kind === "unwritable" ? say("unwritable", { field: answer.field }) : say("conflictText", { file });
  } catch {
    report(say("unreachable"), "failed");
  }
}

async function finish() {
  try {
    const { isOk, answer } = await send("done");
    if (!isOk) {
      report(say("unreachable"), "failed");
      return;
    }
    isFinished = true;
    const written = answer.written ?? [];
    find("#written", HTMLElement).textContent = written.length > 0 ? say("doneWritten", { files: written.join(", ") }) : say("doneNothing");
    for (const part of document.querySelectorAll("main, .actions-bar, .languages")) part.remove();
    const finished = find("#finished", HTMLElement);
    finished.hidden = false;
    finished.focus();
  } catch {
    report(say("unreachable"), "failed");
  }
}

// Blocks

/** Number the blocks of a section, and say what their buttons are for. @param {HTMLElement} list */
function number(list) {
  const rows = rowsOf(list);
  rows.forEach((row, at) => {
    const title = (list.dataset.title ?? "").replaceAll("{n}", String(at + 1));
    find("legend", HTMLElement, row).textContent = title;
    for (const button of /** @type {NodeListOf<HTMLButtonElement>} */ (row.querySelectorAll("[data-act]"))) {
      const act = button.dataset.act ?? "";
      button.setAttribute("aria-label", `${say(act)}: ${title}`);
      button.disabled = (act === "up" && at === 0) || (act === "down" && at === rows.length - 1);
    }
  });
}

/** @param {HTMLElement} list */
function add(list) {
  const made = document.importNode(find("template", HTMLTemplateElement, list).content, true);
  const row = find(".row", HTMLFieldSetElement, made);
  added += 1;
  const own = `${list.dataset.path}.new`;
  // The ids of the template are there once for each block.
  for (const name of ["id", "for", "aria-describedby"]) {
    for (const element of row.querySelectorAll(`[${name}*="${own}."]`)) {
      element.setAttribute(name, (element.getAttribute(name) ?? "").replaceAll(`${own}.`, `${own}${added}.`));
    }
  }
  find(".rows", HTMLElement, list).append(row);
  number(list);
  controls(row)[0]?.focus();
}

/** @param {HTMLButtonElement} button */
function act(button) {
  const list = /** @type {HTMLElement} */ (button.closest("section[data-path]"));
  const row = /** @type {HTMLElement} */ (button.closest(".row"));
  if (button.dataset.act === "add") {
    add(list);
  } else if (button.dataset.act === "remove") {
    const what = find("legend", HTMLElement, row).textContent ?? "";
    const next = row.nextElementSibling ?? row.previousElementSibling;
    row.remove();
    number(list);
    const focus = next?.querySelector('[data-act="remove"]') ?? list.querySelector('[data-act="add"]');
    /** @type {HTMLElement} */ (focus).focus();
    showChanged();
    report(say("removed", { what }), "changed");
    return;
  } else {
    const isUp = button.dataset.act === "up";
    const other = isUp ? row.previousElementSibling : row.nextElementSibling;
    if (isUp) other?.before(row);
    else other?.after(row);
    number(list);
    // A button that is disabled loses the focus.
    const focus = button.disabled ? row.querySelector(`[data-act="${isUp ? "down" : "up"}"]`) : button;
    /** @type {HTMLElement} */ (focus).focus();
    report(say("moved", { n: rowsOf(list).indexOf(/** @type {HTMLFieldSetElement} */ (row)) + 1 }), "changed");
    return;
  }
  showChanged();
}

for (const list of lists()) number(list);
form.addEventListener("click", (event) => {
  const button = event.target instanceof Element ? event.target.closest("button[data-act]") : null;
  if (!(button instanceof HTMLButtonElement)) return;
  act(button);
  followChange();
});
// Enter in a field is no reason to leave the page.
form.addEventListener("submit", (event) => event.preventDefault());
/** @type {ReturnType<typeof setTimeout> | undefined} */
let waiting;
function followChange() {
  clearTimeout(waiting);
  if (preview.open) waiting = setTimeout(showPreview, PAUSE);
}
form.addEventListener("input", () => {
  showChanged();
  followChange();
});
preview.addEventListener("toggle", () => {
  if (preview.open) showPreview();
});
find("#save", HTMLButtonElement).addEventListener("click", () => save());
document.addEventListener("keydown", (event) => {
  // On Arabic and Cyrillic keyboards the key of the letter S gives another letter.
  const isS = event.key.toLowerCase() === "s" || event.code === "KeyS";
  if (!isS || !(event.ctrlKey || event.metaKey) || event.altKey || event.shiftKey || isFinished) return;
  event.preventDefault();
  if (!document.querySelector("dialog[open]")) save();
});
find("#done", HTMLButtonElement).addEventListener("click", () => {
  if (isChanged()) leave.showModal();
  else finish();
});
leave.addEventListener("click", async (event) => {
  const button = event.target instanceof Element ? event.target.closest("[data-leave]") : null;
  if (!(button instanceof HTMLElement)) return;
  leave.close();
  if (button.dataset.leave === "discard" || (button.dataset.leave === "save" && (await save()))) finish();
});
conflict.addEventListener("click", (event) => {
  const button = event.target instanceof Element ? event.target.closest("[data-conflict]") : null;
  if (!(button instanceof HTMLElement)) return;
  conflict.close();
  if (button.dataset.conflict === "copy") save(true);
  if (button.dataset.conflict !== "reload") return;
  kept = JSON.stringify(collect());
  location.reload();
});
addEventListener("beforeunload", (event) => {
  if (isChanged()) event.preventDefault();
});

showChanged();
// Mistakes that an existing file brings along are shown at once; what is only missing is no mistake yet.
if (hash !== "none") {
  const loaded = hash;
  send("check")
    .then(({ isOk, answer }) => {
      const faults = isOk ? /** @type {Fault[]} */ (answer.faults).filter((fault) => !fault.isMissing) : [];
      // Whoever has saved meanwhile has a newer list.
      if (faults.length > 0 && hash === loaded && !summary.hasChildNodes()) showFaults("foundTitle", faults, false);
    })
    .catch(() => report(say("unreachable"), "failed"));
}
