// The portal's pages as people meet them: map, collections and downloads, in both themes, on a phone, in Arabic, and without scripts.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import path from "node:path";
import { after, before } from "node:test";
import { archive } from "./archive.mjs";
import { seriousOn } from "./axe.mjs";
import { launch, open, test } from "./harness.mjs";

const OBJECTS = [
  ["gereza", "Gereza fort", 'country = "TZ"\nname = "Kilwa Kisiwani"\nlatitude = -8.957\nlongitude = 39.513'],
  ["husuni", "Husuni Kubwa", 'country = "TZ"\nname = "Kilwa Kisiwani"\nlatitude = -8.951\nlongitude = 39.522'],
  ["gede", "Great mosque of Gede", 'country = "KE"\nname = "Gede"\nlatitude = -3.309\nlongitude = 40.018'],
];
const PAGES = ["/", "/map", "/collections/", "/collections/coast/", "/gereza/extract", "/gereza/extract/v1-whole.ply"];
const COAST = '[[collection]]\nslug = "coast"\ntitle = "The Swahili coast"\ntext = "Towns of stone."\nmembers = ["gede", "gereza"]\n';
let server;
let browser;

before(async () => {
  const texts = OBJECTS.map(
    ([slug, title, place]) => `title = "${title}"\nslug = "${slug}"\n[rights]\nuri = "CC BY 4.0"\n[place]\n${place}\n[model]\nunits = "m"\n`,
  );
  server = await archive(texts, { collections: COAST, options: (own) => ["--cache", path.join(own, "cache")] });
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
});

const look = (address, options = {}) => open(browser, `${server.url}${address}`, { size: [1200, 800], wait: null, ...options });

test("axe-core finds nothing serious, in both themes and in Arabic", async () => {
  assert.deepEqual(await seriousOn(look, PAGES, (text) => text.includes("404")), []);
});

test("on a phone nothing is wider than the screen and every control is large enough for a finger", async () => {
  for (const address of PAGES) {
    const { page, close } = await look(address, { size: [390, 844], hasTouch: true, isMobile: true });
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 390, address);
    // The links of a drawing are also in the list beside it, and a whole card is its link.
    const drawn = await page.getByRole("group", { name: "Map" }).getByRole("link").elementHandles();
    const cards = await page
      .getByRole("listitem")
      .filter({ has: page.getByRole("heading") })
      .getByRole("link")
      .elementHandles();
    const controls = ["link", "button", "combobox", "textbox", "searchbox", "spinbutton", "radio", "checkbox"].map((role) => page.getByRole(role));
    const small = await controls
      .reduce((all, one) => all.or(one))
      .evaluateAll(
        (all, others) =>
          all
            .filter((e) => !others.includes(e))
            // The target is the label with its radio button or check box.
            .map((e) => [e, (["radio", "checkbox"].includes(e.type) ? e.labels[0] : e).getBoundingClientRect()])
            .filter(([, b]) => b.height < 43.5)
            .map(([e, b]) => `${e.textContent.trim() || e.name}: ${b.width} × ${b.height}`),
        [...drawn, ...cards],
      );
    assert.deepEqual(small, [], address);
    await close();
  }
});

test("the map leads to models and closer, without scripts and by keyboard", async () => {
  const { page, close } = await look("/map", { javaScriptEnabled: false });
  const dots = page.getByRole("group", { name: "Map" }).getByRole("link");
  assert.equal(await dots.count(), 2);
  assert.ok(await dots.and(page.getByRole("link", { name: "Models here: 2. Zoom in", exact: true })).isVisible());
  assert.ok(await dots.and(page.getByRole("link", { name: "Great mosque of Gede, Gede", exact: true })).isVisible());
  assert.deepEqual(await page.getByRole("region", { name: "Places" }).getByRole("listitem").getByRole("link").allInnerTexts(), [
    "Gereza fort",
    "Great mosque of Gede",
    "Husuni Kubwa",
  ]);
  await dots.first().focus(); // the two of Kilwa Kisiwani
  await Promise.all([page.waitForURL(/#places|box=/), page.keyboard.press("Enter")]);
  await page.goto(`${server.url}/map?q=gede`);
  await dots.first().focus();
  await Promise.all([page.waitForURL(/\/gede\/$/), page.keyboard.press("Enter")]);
  await close();
});

test("a mesh is asked for, waited for and saved, without scripts", async () => {
  const { page, close } = await look("/gereza/extract", { javaScriptEnabled: false, acceptDownloads: true });
  await page.getByRole("radio", { name: "STL" }).check();
  await page.getByRole("radio", { name: "Maximum number of triangles" }).check();
  await page.getByRole("textbox", { name: "Maximum number of triangles" }).fill("5 000");
  const [download] = await Promise.all([page.waitForEvent("download"), page.getByRole("button", { name: "Make the file" }).click()]);
  assert.equal(download.suggestedFilename(), "gereza-v1-5000.stl");
  const bytes = await readFile(await download.path());
  const triangles = bytes.readUInt32LE(80);
  assert.ok(triangles > 3000 && triangles <= 5000, String(triangles));
  assert.equal(bytes.length, 84 + 50 * triangles);
  await close();
});

test("a model's page leads to its downloads, and they lead back", async () => {
  const { page, close } = await look("/gereza/", { javaScriptEnabled: false });
  await page.getByRole("link", { name: /^PLY, GLB, OBJ, STL/ }).click();
  assert.equal(await page.getByRole("heading", { level: 1 }).innerText(), "Downloads");
  await page.getByRole("link", { name: "Back to the model" }).click();
  assert.equal(new URL(page.url()).pathname, "/gereza/");
  await close();
});
