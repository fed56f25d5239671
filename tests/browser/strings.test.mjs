// Messages: each language has its plural forms, every key that is used has a message, and every message is used. That the languages have the same keys and
// values, a test of the crate kilwa-messages (i18n/) checks.

import assert from "node:assert/strict";
import { readFile, readdir } from "node:fs/promises";
import path from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";

const ROOT = path.resolve(path.dirname(fileURLToPath(import.meta.url)), "../..");
const WWW = path.join(ROOT, "www");
const BUILT = process.env.KILWA_WWW || path.join(WWW, "dist");
const LANGUAGES = ["en", "fr", "pt", "sw", "ar"];

/** The page's messages as it reads them, with those that it loads later. */
async function messages(language) {
  const read = async (name) => JSON.parse(await readFile(path.join(BUILT, `i18n/${name}.json`), "utf8"));
  const parts = [language, ...["holes", "photographs", "headset"].map((part) => `${part}-${language}`)];
  return Object.assign({}, ...(await Promise.all(parts.map(read))));
}

/** Plural forms in a message. */
function choices(message) {
  if (typeof message === "string") return [];
  if (Array.isArray(message)) return message.flatMap(choices);
  const { $: _, ...forms } = message;
  return [forms, ...Object.values(forms).flatMap(choices)];
}

async function sources() {
  const names = (await readdir(WWW)).filter((n) => n.endsWith(".js") || n === "index.html");
  for (const folder of ["headset", "measure", "photographs"]) {
    names.push(...(await readdir(path.join(WWW, folder))).filter((n) => n.endsWith(".js")).map((n) => `${folder}/${n}`));
  }
  const own = await Promise.all(names.map((n) => readFile(path.join(WWW, n), "utf8")));
  // The landing page and the server's own pages have elements that name their strings in the same way.
  const folders = ["../archive/src", "../archive/templates", "../server/src", "../server/templates"].map((folder) => path.join(WWW, folder));
  const rustFiles = async (folder) => (await readdir(folder, { recursive: true })).filter((n) => /\.(rs|html)$/.test(n)).map((n) => path.join(folder, n));
  const written = (await Promise.all(folders.map(rustFiles))).flat();
  const rust = await Promise.all(written.map((file) => readFile(file, "utf8")));
  return [...own, ...rust.filter((text) => text.includes("data-text")).map((text) => text.replaceAll('\\"', '"'))].join("\n");
}

/** Codes of the engine's sentences. */
async function codes() {
  const folders = ["../core/measure/src", "../viewer/measure/src"].map((f) => path.join(WWW, f));
  const files = (
    await Promise.all(folders.map(async (f) => (await readdir(f, { recursive: true })).filter((n) => n.endsWith(".rs")).map((n) => path.join(f, n))))
  ).flat();
  const text = (await Promise.all(files.map((f) => readFile(f, "utf8")))).join("\n");
  return [...text.matchAll(/Message::new\(\s*"([a-z-]+)"/g)].map((m) => m[1]);
}

test("every language has a folder, a place in the menu and a type", async () => {
  const isFolder = (entry) => entry.isDirectory() && entry.name !== "src";
  const folders = (await readdir(path.join(ROOT, "i18n"), { withFileTypes: true })).filter(isFolder).map((entry) => entry.name);
  assert.deepEqual(folders.sort(), [...LANGUAGES].sort());
  assert.deepEqual(
    (await readdir(path.join(BUILT, "i18n"))).filter((n) => n.endsWith(".json")).sort(),
    LANGUAGES.flatMap((l) => [`${l}.json`, `holes-${l}.json`, `photographs-${l}.json`, `headset-${l}.json`]).sort(),
  );
  const [html, types] = await Promise.all(["index.html", "kilwa-viewer.d.ts"].map((name) => readFile(path.join(WWW, name), "utf8")));
  const { LANGUAGES: offered } = await import(path.join(WWW, "language.js"));
  assert.deepEqual(offered, LANGUAGES);
  for (const language of LANGUAGES) {
    assert.ok(html.includes(`<option value="${language}"`), `${language} is not in the menu of index.html`);
    assert.ok(types.includes(`"${language}"`), `${language} is not in kilwa-viewer.d.ts`);
  }
});

test("the element that other pages embed says in every language that its viewer is blocked", async () => {
  const text = await readFile(path.join(WWW, "kilwa-viewer.js"), "utf8");
  const words = /const WORDS = \{\n([\s\S]*?)\n\};/.exec(text)[1];
  assert.deepEqual(
    [...words.matchAll(/^ {2}([a-z]+): \[/gm)].map((m) => m[1]),
    LANGUAGES,
  );
});

test("plural forms are those that browsers choose among", async () => {
  for (const language of LANGUAGES) {
    const categories = new Intl.PluralRules(language).resolvedOptions().pluralCategories.toSorted();
    for (const [key, message] of Object.entries(await messages(language))) {
      for (const forms of choices(message)) assert.deepEqual(Object.keys(forms).sort(), categories, `${language} ${key}`);
    }
  }
});

test("a message takes the plural form of its number, in every language", async () => {
  globalThis.document = { documentElement: {}, querySelectorAll: () => [] };
  globalThis.fetch = async (address) => ({ ok: true, json: () => messages(path.basename(address.pathname, ".json")) });
  const { t, use } = await import(path.join(WWW, "i18n.js"));
  const deleted = {
    en: [
      [0, "0 measurements were deleted."],
      [1, "1 measurement was deleted."],
      [2, "2 measurements were deleted."],
      [1000, "1,000 measurements were deleted."],
    ],
    fr: [
      [0, "0 mesure supprimée."],
      [1, "1 mesure supprimée."],
      [2, "2 mesures supprimées."],
      [1_000_000, "1\u202f000\u202f000 de mesures supprimées."],
    ],
    pt: [
      [0, "0 medição apagada."],
      [1, "1 medição apagada."],
      [3, "3 medições apagadas."],
    ],
    sw: [
      [0, "Vipimo 0 vimefutwa."],
      [1, "Kipimo 1 kimefutwa."],
      [11, "Vipimo 11 vimefutwa."],
    ],
    ar: [
      [0, "لم يُحذف أي قياس."],
      [1, "حُذف قياس واحد."],
      [2, "حُذف قياسان."],
      [3, "حُذفت 3 قياسات."],
      [11, "حُذف 11 قياسًا."],
      [100, "حُذف 100 قياس."],
      [103, "حُذفت 103 قياسات."],
    ],
  };
  for (const [language, all] of Object.entries(deleted)) {
    await use(language);
    for (const [count, text] of all) assert.equal(t("measureAllDeleted", { count }), text);
  }
  await use("en");
  assert.equal(t("remarkLines", { lines: 1, open: 0, triangles: 1 }), "1 line, 0 open, through 1 triangle");
  assert.equal(t("remarkLines", { lines: 2, open: 1, triangles: 1200 }), "2 lines, 1 of them open, through 1,200 triangles");
  assert.equal(t("deleted", { name: "{count}" }), "“{count}” was deleted.");
  assert.equal(t("noSuchMessage"), "noSuchMessage");
});

test("every key that the page names has a message", async () => {
  const english = await messages("en");
  const text = await sources();
  const named = [
    ...text.matchAll(/data-(?:text|label|aria)="(\w+)"/g),
    ...text.matchAll(/\bt\("(\w+)"/g),
    ...text.matchAll(/"(noGpu\w+|mode[A-Z]\w+)"/g),
    // Of measuring: what elements are made with, and tables of strings.
    ...text.matchAll(/\bkey: "([a-z]\w+)"/g),
    ...text.matchAll(/"(m[A-Z]\w+|r[A-Z]\w+|snap[A-Z]\w+|step[A-Z]\w+|group[A-Z]\w+|refuse[A-Z]\w+|part[A-Z]\w+|file[A-Z]\w+)"/g),
  ].map((m) => m[1]);
  const missing = named.filter((key) => !(key in english) && key !== "noGpu");
  assert.deepEqual(missing, []);
});

test("every message of the page is used somewhere", async () => {
  const text = await sources();
  const made = ["missing", "damaged", "noRange", "noCors", "changed", "closed", "broken", "gpuGone"]
    .flatMap((k) => [`${k}Title`, `${k}Text`])
    .concat("cutOffTitle");
  // Of what the engine says (viewer/measure/tests/messages.rs has the other direction).
  const said = (await codes()).map((code) => code.replace(/-(\w)/g, (_, letter) => letter.toUpperCase()));
  const unused = Object.keys(await messages("en")).filter((key) => !made.includes(key) && !said.includes(key) && !text.includes(`"${key}"`));
  assert.deepEqual(unused, []);
});

test("every message of the portal is used somewhere", async () => {
  const folder = path.join(ROOT, "server");
  const names = (await readdir(folder, { recursive: true })).filter((n) => /^(src|templates)\/.*\.(rs|html)$/.test(n));
  names.push("../files/src/size.rs"); // the units of sizes are keys
  const rust = (await Promise.all(names.map((n) => readFile(path.join(folder, n), "utf8")))).join("\n");
  const portal = await readFile(path.join(ROOT, "i18n/en/portal.ftl"), "utf8");
  const keys = [...portal.matchAll(/^([\w-]+) =/gm)].map(([, key]) => key);
  assert.ok(keys.length > 100);
  // Sizes and formats are named by what is shown.
  const made = (key) => (key.startsWith("size-") && rust.includes(`"${key.slice(5)}"`)) || (key.endsWith("What") && rust.includes(`"${key.slice(0, -4)}"`));
  assert.deepEqual(
    keys.filter((key) => !rust.includes(`"${key}"`) && !made(key)),
    [],
  );
});

test("no page file holds an inline script, style or handler", async () => {
  const html = await readFile(path.join(WWW, "index.html"), "utf8");
  assert.ok(!/<script(?![^>]*\bsrc=)/.test(html) && !/\son\w+=/.test(html) && !/\sstyle=/.test(html) && !/<style/.test(html));
});
