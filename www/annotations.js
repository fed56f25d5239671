// Notes on the model, in memory and as W3C Web Annotations (https://www.w3.org/TR/annotation-model/).
//
// A note: `{ id, title, text, link, place: [x, y, z], camera, display, created, modified, source }`. As an annotation:
//
//   label              the title
//   body               a TextualBody (purpose describing) with the text; a SpecificResource (purpose linking) with the link
//   target.source      the address of the pack
//   target.selector    `{"type": "PointSelector", "x", "y", "z"}`: world metres, as in IIIF Presentation 4
//   target.state       `{"type": "urn:kilwa:pack", "identity": "…"}`: which version of the pack it was made on (docs/FORMAT.md, section 7);
//                      `{"type": "urn:kilwa:view", "camera": [7 to 9 numbers], "display": {…}}`: how it is looked at
//
// A file holds an AnnotationPage; an AnnotationCollection, a single Annotation and a plain array are read too. What an
// annotation says beyond this is kept and written again. Annotations without a point are counted and left out.

import { isCamera } from "./camera.js";
import { t } from "./i18n.js";
import { unique } from "./store.js";

/** @import { Note } from "./types/page.js" */

export const MAX_NOTES = 5000;
const LONGEST = { title: 200, text: 20_000, link: 2000 };
const CONTEXT = "http://www.w3.org/ns/anno.jsonld";

/** @param {any} value @returns {any[]} */
const array = (value) => (value === undefined || value === null ? [] : Array.isArray(value) ? value : [value]);
/**
 * @param {unknown} value
 * @param {keyof typeof LONGEST} kind
 */
const cut = (value, kind) => String(value ?? "").slice(0, LONGEST[kind]);

/**
 * A web address that may be followed: http or https. Null for anything else.
 * @param {unknown} text
 */
export function safeLink(text) {
  try {
    const url = new URL(String(text).trim());
    return ["http:", "https:"].includes(url.protocol) ? url.href : null;
  } catch {
    return null;
  }
}

/**
 * A text in some language: `"…"`, or IIIF's `{"en": ["…"]}`.
 * @param {any} value
 */
function words(value) {
  if (typeof value === "string") return value;
  if (value && typeof value === "object") {
    const chosen = value[document.documentElement.lang] ?? value["@value"] ?? value.en ?? Object.values(value)[0];
    return array(chosen).map(String).join(" ");
  }
  return "";
}

/**
 * HTML bodies are read as text: nothing of them is ever put into the page as markup.
 * @param {any} body
 */
function plain(body) {
  const value = words(body.value ?? body.chars);
  if (!/html/i.test(body.format ?? "")) return value;
  return new DOMParser().parseFromString(value, "text/html").body.textContent ?? "";
}

/**
 * @param {any} target
 * @returns {{place: number[], state: any} | null}
 */
function placeOf(target) {
  for (const one of array(target)) {
    for (const selector of array(one?.selector)) {
      const place = [selector?.x, selector?.y, selector?.z];
      const isPoint = ["PointSelector", "urn:kilwa:point"].includes(selector?.type);
      if (isPoint && place.every(Number.isFinite)) return { place, state: array(one.state).find((s) => s?.type === "urn:kilwa:view") };
    }
  }
  return null;
}

/**
 * One annotation as a note, or null where it names no point.
 * @param {any} annotation
 * @returns {Note | null}
 */
export function noteOf(annotation) {
  const found = placeOf(annotation?.target);
  if (!found) return null;
  const bodies = array(annotation.body)
    .map((b) => (typeof b === "string" ? { id: b } : b))
    .filter((b) => b && typeof b === "object");
  const texts = bodies.filter((b) => b.type === "TextualBody" || b.value !== undefined);
  const titles = texts.filter((b) => ["identifying", "tagging"].includes(b.purpose));
  const title = words(annotation.label) || (titles[0] ? plain(titles[0]) : "");
  const text = texts
    .filter((b) => b !== titles[0] || words(annotation.label))
    .filter((b) => b.purpose !== "tagging")
    .map(plain)
    .join("\n\n");
  const links = bodies
    .filter((b) => !texts.includes(b))
    .map((b) => safeLink(words(b.source) || b.source?.id || b.id))
    .filter(Boolean);
  const camera = found.state?.camera;
  return {
    id: typeof annotation.id === "string" && annotation.id ? annotation.id : `urn:uuid:${unique()}`,
    title: cut(title, "title"),
    text: cut(text, "text"),
    link: links[0] ?? "",
    place: found.place,
    camera: isCamera(camera) ? camera : null,
    display: found.state?.display && typeof found.state.display === "object" ? found.state.display : null,
    created: annotation.created ?? null,
    modified: annotation.modified ?? null,
    source: annotation,
  };
}

/**
 * The identities of packs that an annotation was made on.
 * @param {any} annotation
 * @returns {string[]}
 */
const identitiesOf = (annotation) =>
  array(annotation?.target)
    .flatMap((one) => array(one?.state))
    .filter((s) => s?.type === "urn:kilwa:pack" && /^[0-9a-f]{12,64}$/.test(s.identity))
    .map((s) => s.identity);

/**
 * @param {any} json
 * @returns {{notes: Note[], left: number, identities: string[]}} the notes of a file's JSON and the packs that they were made on; throws a sentence where it is no such file
 */
export function parseAnnotations(json) {
  const page = json?.type === "AnnotationCollection" ? json.first : json;
  const items = Array.isArray(page) ? page : page?.type === "Annotation" ? [page] : (page?.items ?? page?.resources);
  if (!Array.isArray(items)) throw new Error(t("importNoNotes"));
  if (items.length > MAX_NOTES) throw new Error(t("importTooMany", { count: items.length, most: MAX_NOTES }));
  const notes = [];
  const ids = new Set();
  for (const item of items) {
    const note = noteOf(item);
    if (!note) continue;
    if (ids.has(note.id)) note.id = `urn:uuid:${unique()}`;
    ids.add(note.id);
    notes.push(note);
  }
  return { notes, left: items.length - notes.length, identities: [...new Set(items.flatMap(identitiesOf))] };
}

/**
 * A note as an annotation of the pack at `pack.source` that is called `pack.identity`. What was made on another one keeps naming it.
 * @param {Note} note
 * @param {{source: string, identity: string | null}} pack
 */
export function annotationOf(note, pack) {
  const { source = {} } = note;
  /** @type {object[]} */
  const body = [];
  if (note.text) body.push({ type: "TextualBody", purpose: "describing", format: "text/plain", value: note.text });
  if (note.link) body.push({ type: "SpecificResource", purpose: "linking", source: note.link });
  const view = note.camera ? { type: "urn:kilwa:view", camera: note.camera, ...(note.display ? { display: note.display } : {}) } : null;
  const identity = identitiesOf(source)[0] ?? (array(source.target)[0]?.source ? null : pack.identity);
  const state = [identity && { type: "urn:kilwa:pack", identity }, view].filter(Boolean);
  const [x, y, z] = note.place;
  return {
    ...source,
    "@context": undefined,
    id: note.id,
    type: "Annotation",
    motivation: source.motivation ?? "describing",
    ...(note.created ? { created: note.created } : {}),
    ...(note.modified ? { modified: note.modified } : {}),
    label: note.title,
    body,
    target: {
      type: "SpecificResource",
      source: array(source.target)[0]?.source ?? pack.source,
      selector: { type: "PointSelector", x, y, z },
      ...(state.length > 0 ? { state } : {}),
    },
  };
}

/**
 * The file of a list of notes.
 * @param {Note[]} notes
 * @param {{source: string, identity: string | null}} pack
 */
export function annotationPage(notes, pack) {
  return { "@context": CONTEXT, type: "AnnotationPage", items: notes.map((note) => annotationOf(note, pack)) };
}

/**
 * The name of a note in an address: what is its own in its id.
 * @param {string} id
 */
export const shortId = (id) => id.replace(/^urn:uuid:/, "");

/**
 * The note that an address names: by its id, the end of its id, or its number from 1.
 * @param {Note[]} notes
 * @param {string} name
 */
export function findNote(notes, name) {
  return (
    notes.find((n) => n.id === name || shortId(n.id) === name) ??
    notes.find((n) => n.id.split(/[/#:]/).at(-1) === name) ??
    (/^\d+$/.test(name) ? notes[Number(name) - 1] : undefined)
  );
}
