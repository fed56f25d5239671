// A reader's way through the portal, from end to end: find a model by search, open it, measure on it, cite the measurement, follow the citation back
// and find the same value; sign in to what is not public and come back to it. By pointer, in Arabic, and by keyboard alone.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import path from "node:path";
import { after, before } from "node:test";
import { AMINA, archive } from "./archive.mjs";
import { ROOT, WWW, canvasOf, launch, open, stats, test, troubleOf, waitFor } from "./harness.mjs";
import { bits, done, list, press } from "./measuring.mjs";

/** Coarse, because software draws; what is measured does not depend on it. */
const COARSE = "error=16";
const OBJECTS = [
  ["gereza", "Gereza fort", 'description = "A fort of coral stone by the harbour."\nsubjects = ["coral stone"]', ""],
  ["husuni", "Husuni Kubwa", 'description = "A palace."', ""],
  ["cave", "Painted cave", 'description = "Paintings of animals."', '[access]\nstate = "restricted"\nreason = "Graves of the living."\n'],
];
/** The points to measure between, in fractions of the picture's width and height. */
const PLACES = [
  [0.42, 0.5],
  [0.55, 0.5],
];
let server;
let browser;
let english;
let arabic;

before(async () => {
  const texts = OBJECTS.map(
    ([slug, title, words, access]) => `title = "${title}"\nslug = "${slug}"\n${words}\n[rights]\nuri = "CC BY 4.0"\n[model]\nunits = "m"\n${access}`,
  );
  server = await archive(texts, { granted: ["cave"] });
  browser = await launch();
  [english, arabic] = await Promise.all(["en", "ar"].map(words));
});
after(async () => {
  await browser?.close();
  await server?.stop();
});

const reader = (address, options = {}) =>
  open(browser, `${server.url}${address}`, { size: [1200, 800], wait: null, permissions: ["clipboard-read", "clipboard-write"], ...options });
const ready = (page) => waitFor(page, "first");
/** Wait until there is one measurement and it is final; returns it with every bit of its values and places. */
async function measured(page) {
  await done(page);
  const [{ name, tool, local, readings }] = await bits(page);
  const [{ state }] = await list(page);
  return { name, tool, state, local, readings };
}
/** The messages of a language: the viewer's, and the portal's messages without parameters, which take precedence. */
async function words(language) {
  const viewer = JSON.parse(await readFile(path.join(WWW, `i18n/${language}.json`), "utf8"));
  const portal = await readFile(path.join(ROOT, `i18n/${language}/portal.ftl`), "utf8");
  return { ...viewer, ...Object.fromEntries([...portal.matchAll(/^(\w+) = ([^{}\n]+)$/gmu)].map(([, key, text]) => [key, text])) };
}

// Elements of the pages as a reader finds them, by their names in a language.

const search = (page, t) => page.getByRole("searchbox", { name: t.searchLabel });
const searchButton = (page, t) => page.getByRole("search").getByRole("button", { name: t.search });
/** The titles of the models in the list. */
const titles = (page) => page.getByRole("listitem").getByRole("heading", { level: 2 });
const back = (page, t) => page.getByRole("banner").getByRole("link", { name: t.allModels });
const measure = (page, t) => page.getByRole("toolbar", { name: t.tools }).getByRole("button", { name: t.toolMeasure, exact: true });
const measureBar = (page, t) => page.getByRole("toolbar", { name: t.measurements });
const table = (page, t) => page.getByRole("table", { name: t.measurements });
const cite = (page, t) => table(page, t).getByRole("button", { name: t.measureCite });
/** The address of a citation, which is below the sentence. */
const citedAddress = (page, t) => table(page, t).getByRole("link");
const toSignIn = (page, t) => troubleOf(page).getByRole("link", { name: t.signIn });
const name = (page, t) => page.getByRole("textbox", { name: t.userName });
const password = (page, t) => page.getByLabel(t.password);
const signIn = (page, t) => page.getByRole("button", { name: t.signIn });

const clipboard = (page) => page.evaluate(() => navigator.clipboard.readText());
/** The address at the end of a citation. */
const addressOf = (citation) => /(http:\S+)$/u.exec(citation)[1];

/** Another reader, who has nothing but the citation. */
async function follow(citation, wanted, lang) {
  const address = addressOf(citation);
  assert.equal(new URL(address).pathname, "/gereza/");
  const other = await reader(address.slice(server.url.length), { locale: lang });
  await ready(other.page);
  assert.deepEqual(await measured(other.page), wanted, "the same measurement with the same value");
  assert.equal(await other.page.getByRole("banner").getByRole("heading", { level: 1 }).innerText(), "Gereza fort");
  assert.deepEqual(other.complaints, []);
  return other;
}

test("found by search, opened, measured, cited, and the citation leads back to the same value", async () => {
  const { page, complaints, close } = await reader("/");
  const t = english;
  await search(page, t).fill("coral harb");
  await searchButton(page, t).click();
  assert.deepEqual(await titles(page).allInnerTexts(), ["Gereza fort"]);
  await titles(page).getByRole("link").click();
  await ready(page);
  await measure(page, t).click();
  await measureBar(page, t).waitFor();
  await press(page, ...PLACES);
  const wanted = await measured(page);
  assert.equal(wanted.state, "final");
  await cite(page, t).click();
  const link = citedAddress(page, t);
  await link.waitFor();
  const citation = await clipboard(page);
  assert.match(citation, /straight [\d.]+ m \(± [\d.]+ m\).* of “Gereza fort” \(pack [0-9a-f]{32}\)/u);
  assert.equal(addressOf(citation), await link.getAttribute("href"));
  const other = await follow(citation, wanted, "en");
  // Whoever follows it has that one measurement, and the list of what else there is.
  await back(other.page, t).click();
  await search(other.page, t).waitFor();
  assert.equal(await titles(other.page).count(), OBJECTS.length);
  await other.close();
  assert.deepEqual(complaints, []);
  await close();
});

test("who signs in to what is not public comes back to the view that the link held", async () => {
  const view = "#view=3,4,5,0.5,-0.6,40,0&measurements=coordinate~AAAAAAAAAAAAAAAAAAAAAAAAAAAAAADwPw~There";
  const { page, close } = await reader(`/cave/?${COARSE}${view}`);
  await waitFor(page, "trouble");
  assert.match(await troubleOf(page).innerText(), /Graves of the living/);
  await toSignIn(page, english).click();
  await name(page, english).fill(AMINA.name);
  await password(page, english).fill(AMINA.password);
  await signIn(page, english).click();
  await ready(page);
  const at = new URL(page.url());
  assert.equal(`${at.pathname}${at.search}`, `/cave/?${COARSE}`);
  assert.match(at.hash, /^#view=3,4,5,0\.5,-0\.6,40,0/);
  assert.ok((await stats(page)).trianglesDrawn > 0, "the model is there");
  await close();
});

test("in Arabic all of it is from right to left, in Arabic, with figures as the language groups them", async () => {
  const { page, complaints, close } = await reader("/", { locale: "ar" });
  const isArabic = async (where) => {
    const { dir, lang, words } = await page.evaluate(() => ({
      dir: document.documentElement.dir,
      lang: document.documentElement.lang,
      words: document.body.innerText,
    }));
    assert.deepEqual([dir, lang], ["rtl", "ar"], where);
    assert.match(words, /\p{Script=Arabic}{3}/u, where);
  };
  const t = arabic;
  await isArabic("the catalogue");
  await search(page, t).fill("coral");
  await searchButton(page, t).click();
  await isArabic("what was found");
  const shown = await page.getByRole("listitem").getByRole("definition").first().innerText();
  const grouped = (digits) => new Intl.NumberFormat("ar-u-nu-latn").format(digits);
  assert.equal(shown, await page.evaluate(grouped, Number(shown.replace(/\D/g, ""))));
  await titles(page).getByRole("link").click();
  await ready(page);
  await isArabic("the viewer");
  await measure(page, t).click();
  await measureBar(page, t).waitFor();
  await press(page, ...PLACES);
  const value = await measured(page);
  await cite(page, t).click();
  await citedAddress(page, t).waitFor();
  const citation = await clipboard(page);
  assert.match(citation, /\p{Script=Arabic}{3}/u);
  const other = await follow(citation, value, "ar");
  assert.equal(await other.page.evaluate(() => document.documentElement.dir), "rtl");
  await other.close();
  // Signing in speaks it too, also after a wrong password.
  await page.goto(`${server.url}/cave/?${COARSE}`);
  await waitFor(page, "trouble");
  await toSignIn(page, t).click();
  await isArabic("the form");
  await name(page, t).fill(AMINA.name);
  await password(page, t).fill("not this sentence");
  await signIn(page, t).click();
  await page.getByRole("alert").waitFor();
  await isArabic("the form after a wrong password");
  await password(page, t).fill(AMINA.password);
  await signIn(page, t).click();
  await ready(page);
  await isArabic("the model that is not public");
  // The browser itself says that something was refused, and that is all it says.
  assert.deepEqual(
    complaints.filter((c) => !/40[13]/.test(c)),
    [],
  );
  await close();
});

test("a language chosen in the catalogue goes along, whatever the browser asks for", async () => {
  const { page, close } = await reader("/?lang=ar", { locale: "en" });
  await titles(page).first().getByRole("link").click();
  await ready(page);
  assert.equal(await page.evaluate(() => document.documentElement.lang), "ar");
  await back(page, arabic).click();
  await search(page, arabic).waitFor();
  assert.equal(await page.evaluate(() => document.documentElement.lang), "ar");
  await close();
});

test("by keyboard alone: found, opened, measured, cited, followed back; signed in", async () => {
  const listen = (page) =>
    page.addInitScript(() => {
      globalThis.pointed = [];
      for (const kind of ["pointerdown", "mousedown", "mousemove", "touchstart", "wheel"])
        addEventListener(kind, (event) => event.isTrusted && globalThis.pointed.push(kind), true);
    });
  const { page, close } = await reader("/", { before: listen });
  const keys = async (...names) => {
    for (const name of names) await page.keyboard.press(name);
  };
  /** Tab until the focus is there. */
  const tabTo = async (control) => {
    for (let steps = 0; steps < 120; steps += 1) {
      if (await control.evaluate((e) => e === document.activeElement)) return;
      await page.keyboard.press("Tab");
    }
    assert.fail(`Tab does not lead to ${control}`);
  };
  const t = english;
  await tabTo(search(page, t));
  await page.keyboard.type("gereza");
  await Promise.all([page.waitForURL(/q=gereza/), keys("Enter")]);
  await tabTo(titles(page).getByRole("link"));
  await Promise.all([page.waitForURL((url) => url.pathname !== "/"), keys("Enter")]);
  await ready(page);
  await tabTo(measure(page, t));
  await keys("Enter");
  await measureBar(page, t).waitFor();
  await tabTo(canvasOf(page));
  // The first Space brings the crosshair, the others take the places.
  await keys("Space", "Shift+ArrowLeft", "Space", "Shift+ArrowRight", "Shift+ArrowRight", "ArrowDown", "Space");
  const wanted = await measured(page);
  assert.equal(wanted.state, "final");
  await keys("Escape");
  await tabTo(cite(page, t));
  await keys("Enter");
  await citedAddress(page, t).waitFor();
  const citation = await clipboard(page);
  await tabTo(citedAddress(page, t));
  await keys("Enter");
  assert.deepEqual(await measured(page), wanted, "the link in the page changes nothing");
  await page.goto("about:blank");
  await page.goto(addressOf(citation));
  await ready(page);
  assert.deepEqual(await measured(page), wanted);
  await tabTo(back(page, t));
  await keys("Enter");
  await search(page, t).waitFor();
  await tabTo(titles(page).getByRole("link", { name: "Painted cave" }));
  await Promise.all([page.waitForURL(/\/cave\//), keys("Enter")]);
  await waitFor(page, "trouble");
  await tabTo(toSignIn(page, t));
  await keys("Enter");
  await name(page, t).waitFor();
  await tabTo(name(page, t));
  await page.keyboard.type(AMINA.name);
  await tabTo(password(page, t));
  await page.keyboard.type(AMINA.password);
  await keys("Enter");
  await ready(page);
  assert.equal(new URL(page.url()).pathname, "/cave/");
  assert.deepEqual(await page.evaluate(() => globalThis.pointed), [], "no pointer was used");
  await close();
});
