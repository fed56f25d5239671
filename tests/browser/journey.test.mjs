// A reader's way through the portal, from end to end: find a model by search, open it, measure on it, cite the measurement, follow the citation back
// and find the same value; sign in to what is not public and come back to it. By pointer, in Arabic, and by keyboard alone.

import assert from "node:assert/strict";
import { after, before } from "node:test";
import { AMINA, archive } from "./archive.mjs";
import { launch, open, test, waitFor } from "./harness.mjs";

/** Coarse, because software draws; what is measured does not depend on it. */
const COARSE = "error=16";
const OBJECTS = [
  ["gereza", "Gereza fort", 'description = "A fort of coral stone by the harbour."\nsubjects = ["coral stone"]', ""],
  ["husuni", "Husuni Kubwa", 'description = "A palace."', ""],
  ["cave", "Painted cave", 'description = "Paintings of animals."', '[access]\nstate = "restricted"\nreason = "Graves of the living."\n'],
];
let server;
let browser;

before(async () => {
  const texts = OBJECTS.map(
    ([slug, title, words, access]) => `title = "${title}"\nslug = "${slug}"\n${words}\n[rights]\nuri = "CC BY 4.0"\n[model]\nunits = "m"\n${access}`,
  );
  server = await archive(texts, { granted: ["cave"] });
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
});

const reader = (address, options = {}) =>
  open(browser, `${server.url}${address}`, { size: [1200, 800], wait: null, permissions: ["clipboard-read", "clipboard-write"], ...options });
const ready = (page) => waitFor(page, "first");
/** Until there is one measurement and it is final; its bits. */
async function measured(page) {
  const isFinal = () => {
    const items = globalThis.kilwa?.measuring?.tools?.items;
    return items?.length === 1 && !["picking", "measuring"].includes(items[0].task.state);
  };
  await page.waitForFunction(isFinal, null, { polling: 50 });
  return page.evaluate(() => {
    const hex = (v) => [...new Uint8Array(new Float64Array([v]).buffer)].map((b) => b.toString(16).padStart(2, "0")).join("");
    const [{ name, task }] = globalThis.kilwa.measuring.tools.items;
    return {
      name,
      state: task.state,
      local: task.points.flatMap((p) => p.local.map(hex)),
      readings: task.readings.map((r) => [r.name, hex(r.value), hex(r.uncertainty)]),
    };
  });
}
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
  assert.equal(await other.page.locator("#title").innerText(), "Gereza fort");
  assert.deepEqual(other.complaints, []);
  return other;
}

test("found by search, opened, measured, cited, and the citation leads back to the same value", async () => {
  const { page, complaints, close } = await reader("/");
  await page.locator("#q").fill("coral harb");
  await page.locator("#search button").click();
  assert.deepEqual(await page.locator(".card h2").allInnerTexts(), ["Gereza fort"]);
  await page.locator(".card h2 a").click();
  await ready(page);
  await page.locator("#tool-measure").click();
  await page.locator("#measure-bar").waitFor();
  const box = await page.locator("#canvas").boundingBox();
  for (const x of [0.42, 0.55]) await page.mouse.click(box.x + box.width * x, box.y + box.height * 0.5);
  const wanted = await measured(page);
  assert.equal(wanted.state, "final");
  await page.locator('.measure-table [data-act="cite"]').click();
  const link = page.locator(".cited-address a");
  await link.waitFor();
  const citation = await clipboard(page);
  assert.match(citation, /straight [\d.]+ ± [\d.]+ m.* of “Gereza fort” \(pack [0-9a-f]{32}\)/u);
  assert.equal(addressOf(citation), await link.getAttribute("href"));
  const other = await follow(citation, wanted, "en");
  // Whoever follows it has that one measurement, and the list of what else there is.
  await other.page.locator("#back").click();
  await other.page.locator("#q").waitFor();
  assert.equal(await other.page.locator(".card").count(), OBJECTS.length);
  await other.close();
  assert.deepEqual(complaints, []);
  await close();
});

test("who signs in to what is not public comes back to the view that the link held", async () => {
  const view = "#view=3,4,5,0.5,-0.6,40,0&measurements=coordinate~AAAAAAAAAAAAAAAAAAAAAAAAAAAAAADwPw~There";
  const { page, close } = await reader(`/cave/?${COARSE}${view}`);
  await waitFor(page, "trouble");
  assert.match(await page.locator("#trouble-detail").innerText(), /Graves of the living/);
  await page.locator("#trouble-sign-in").click();
  await page.locator("#name").fill(AMINA.name);
  await page.locator("#password").fill(AMINA.password);
  await page.locator("main button").click();
  await ready(page);
  const at = new URL(page.url());
  assert.equal(`${at.pathname}${at.search}`, `/cave/?${COARSE}`);
  assert.match(at.hash, /^#view=3,4,5,0\.5,-0\.6,40,0/);
  assert.ok((await page.evaluate(() => globalThis.kilwa.session.stats.trianglesDrawn)) > 0, "the model is there");
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
  await isArabic("the catalogue");
  await page.locator("#q").fill("coral");
  await page.locator("#search button").click();
  await isArabic("what was found");
  const [shown, wanted] = await page.evaluate(() => {
    const text = document.querySelector(".card .facts dd").innerText;
    const digits = Number(text.replace(/\D/g, ""));
    return [text, new Intl.NumberFormat("ar-u-nu-latn").format(digits)];
  });
  assert.equal(shown, wanted);
  await page.locator(".card h2 a").click();
  await ready(page);
  await isArabic("the viewer");
  await page.locator("#tool-measure").click();
  await page.locator("#measure-bar").waitFor();
  const box = await page.locator("#canvas").boundingBox();
  for (const x of [0.42, 0.55]) await page.mouse.click(box.x + box.width * x, box.y + box.height * 0.5);
  const value = await measured(page);
  await page.locator('.measure-table [data-act="cite"]').click();
  await page.locator(".cited-address a").waitFor();
  const citation = await clipboard(page);
  assert.match(citation, /\p{Script=Arabic}{3}/u);
  const other = await follow(citation, value, "ar");
  assert.equal(await other.page.evaluate(() => document.documentElement.dir), "rtl");
  await other.close();
  // Signing in speaks it too, also after a wrong password.
  await page.goto(`${server.url}/cave/?${COARSE}`);
  await waitFor(page, "trouble");
  await page.locator("#trouble-sign-in").click();
  await isArabic("the form");
  await page.locator("#name").fill(AMINA.name);
  await page.locator("#password").fill("not this sentence");
  await page.locator("main button").click();
  await page.locator("[role=alert]").waitFor();
  await isArabic("the form after a wrong password");
  await page.locator("#password").fill(AMINA.password);
  await page.locator("main button").click();
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
  await page.locator(".card h2 a").first().click();
  await ready(page);
  assert.equal(await page.evaluate(() => document.documentElement.lang), "ar");
  await page.locator("#back").click();
  await page.locator("#q").waitFor();
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
  const tabTo = async (selector) => {
    for (let steps = 0; steps < 120; steps += 1) {
      if (await page.evaluate((s) => document.activeElement.matches(s), selector)) return;
      await page.keyboard.press("Tab");
    }
    assert.fail(`Tab does not lead to ${selector}`);
  };
  await tabTo("#q");
  await page.keyboard.type("gereza");
  await Promise.all([page.waitForURL(/q=gereza/), keys("Enter")]);
  await tabTo(".card h2 a");
  await Promise.all([page.waitForURL((url) => url.pathname !== "/"), keys("Enter")]);
  await ready(page);
  await tabTo("#tool-measure");
  await keys("Enter");
  await page.locator("#measure-bar").waitFor();
  await tabTo("#canvas");
  // The first Space brings the crosshair, the others take the places.
  await keys("Space", "Shift+ArrowLeft", "Space", "Shift+ArrowRight", "Shift+ArrowRight", "ArrowDown", "Space");
  const wanted = await measured(page);
  assert.equal(wanted.state, "final");
  await keys("Escape");
  await tabTo('.measure-table [data-act="cite"]');
  await keys("Enter");
  await page.locator(".cited-address a").waitFor();
  const citation = await clipboard(page);
  await tabTo(".cited-address a");
  await keys("Enter");
  assert.deepEqual(await measured(page), wanted, "the link in the page changes nothing");
  await page.goto("about:blank");
  await page.goto(addressOf(citation));
  await ready(page);
  assert.deepEqual(await measured(page), wanted);
  await tabTo("#back");
  await keys("Enter");
  await page.locator("#q").waitFor();
  await tabTo('.card h2 a[href^="/cave/"]');
  await Promise.all([page.waitForURL(/\/cave\//), keys("Enter")]);
  await waitFor(page, "trouble");
  await tabTo("#trouble-sign-in");
  await keys("Enter");
  await page.locator("#name").waitFor();
  await tabTo("#name");
  await page.keyboard.type(AMINA.name);
  await tabTo("#password");
  await page.keyboard.type(AMINA.password);
  await keys("Enter");
  await ready(page);
  assert.equal(new URL(page.url()).pathname, "/cave/");
  assert.deepEqual(await page.evaluate(() => globalThis.pointed), [], "no pointer was used");
  await close();
});
