// Every language has every string, with the same places to fill in, and every string is used.

import assert from "node:assert/strict";
import { readFile, readdir } from "node:fs/promises";
import path from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";

const WWW = path.resolve(path.dirname(fileURLToPath(import.meta.url)), "../../www");
const LANGUAGES = ["en", "fr", "pt", "sw", "ar"];

async function strings(language) {
  return JSON.parse(await readFile(path.join(WWW, `i18n/${language}.json`), "utf8"));
}

async function sources() {
  const names = (await readdir(WWW)).filter((n) => n.endsWith(".js") || n === "index.html");
  names.push(...(await readdir(path.join(WWW, "measure"))).filter((n) => n.endsWith(".js")).map((n) => `measure/${n}`));
  const own = await Promise.all(names.map((n) => readFile(path.join(WWW, n), "utf8")));
  // The landing page and the server's own pages have elements that name their strings in the same way.
  const folders = ["../archive/src", "../server/src"].map((folder) => path.join(WWW, folder));
  const rustFiles = async (folder) =>
    (await readdir(folder, { recursive: true })).filter((n) => n.endsWith(".rs")).map((n) => path.join(folder, n));
  const written = (await Promise.all(folders.map(rustFiles))).flat();
  const rust = await Promise.all(written.map((file) => readFile(file, "utf8")));
  return [...own, ...rust.filter((text) => text.includes("data-text")).map((text) => text.replaceAll('\\"', '"'))].join("\n");
}

/** Codes of the engine's sentences. */
async function codes() {
  const folders = ["../core/measure/src", "../viewer/measure/src"].map((f) => path.join(WWW, f));
  const files = (await Promise.all(folders.map(async (f) => (await readdir(f, { recursive: true })).filter((n) => n.endsWith(".rs")).map((n) => path.join(f, n))))).flat();
  const text = (await Promise.all(files.map((f) => readFile(f, "utf8")))).join("\n");
  return [...text.matchAll(/Said::new\(\s*"([a-z-]+)"/g)].map((m) => m[1]);
}

test("all languages have the same keys, none of them empty, with the same places to fill in", async () => {
  const english = await strings("en");
  const places = (text) => [...text.matchAll(/\{\w+\}/g)].map(String).sort().join();
  for (const language of LANGUAGES) {
    const other = await strings(language);
    assert.deepEqual(Object.keys(other).sort(), Object.keys(english).sort(), language);
    for (const [key, text] of Object.entries(other)) {
      assert.ok(text.trim().length > 0, `${language}: ${key} is empty`);
      assert.equal(places(text), places(english[key]), `${language}: ${key}`);
    }
  }
  assert.deepEqual((await readdir(path.join(WWW, "i18n"))).sort(), LANGUAGES.map((l) => `${l}.json`).sort());
});

test("every key that the page names has a string", async () => {
  const english = await strings("en");
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

test("every string is used somewhere", async () => {
  const text = await sources();
  const made = ["missing", "damaged", "noRange", "changed", "closed", "broken"].flatMap((k) => [`${k}Title`, `${k}Text`]);
  // Of what the engine says (viewer/measure/tests/messages.rs has the other direction).
  const said = (await codes()).map((code) => code.replace(/-(\w)/g, (_, letter) => letter.toUpperCase()));
  const unused = Object.keys(await strings("en")).filter((key) => !made.includes(key) && !said.includes(key) && !text.includes(`"${key}"`));
  assert.deepEqual(unused, []);
});

test("no page file holds an inline script, style or handler", async () => {
  const html = await readFile(path.join(WWW, "index.html"), "utf8");
  assert.ok(!/<script(?![^>]*\bsrc=)/.test(html) && !/\son\w+=/.test(html) && !/\sstyle=/.test(html) && !/<style/.test(html));
});
