// For everyone: large targets under fingers, nothing lost at 200 % zoom, a way by keyboard that shows where it is,
// and numbers and directions of the language.

import assert from "node:assert/strict";
import { after, before } from "node:test";
import { cameraOf, launch, open, packFolder, serve, test } from "./harness.mjs";

let server;
let browser;

before(async () => {
  server = await serve(await packFolder());
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
});

const fort = (query = "?error=8") => `${server.url}/m/fort${query}`;

/** Controls on screen that are smaller than 44 by 44, but for words inside text. The cube has buttons in the Views tab. */
const small = (page) =>
  page.evaluate(() =>
    [
      ...document.querySelectorAll(
        "button, a.button, label.button, label.choice, [role=tab], select, input:not([type=radio], [type=checkbox], [type=file]), textarea",
      ),
    ]
      .filter(
        (e) =>
          e.checkVisibility({ visibilityProperty: true, opacityProperty: false }) &&
          !e.closest(".cube, .pins, .hidden") &&
          !e.matches(".hidden, .grip, .language select, input[type=range]"),
      )
      .map((e) => ({ e, b: e.getBoundingClientRect() }))
      .filter(({ b }) => b.width > 0 && (b.width < 43.5 || b.height < 43.5))
      .map(({ e, b }) => `${e.id || e.className || e.textContent}: ${b.width} × ${b.height}`),
  );

test("on a phone every control is at least 44 pixels wide and high, in every tab, form and dialog", async () => {
  // What comes later than its sheet of styles would be shown without it.
  const before = (page) =>
    page.route("**/measure.css", async (route) => {
      await new Promise((resolve) => setTimeout(resolve, 1500));
      await route.continue();
    });
  const { page, complaints, close } = await open(browser, fort(), { size: [390, 844], hasTouch: true, isMobile: true, before });
  const found = [];
  const look = async (where) => found.push(...(await small(page)).map((s) => `${where}: ${s}`));
  for (const tab of await page.locator("[role=tab]").all()) {
    const id = await tab.getAttribute("id");
    await page.evaluate((id) => document.getElementById(id).click(), id);
    await page.waitForFunction(() => document.querySelector(".sheet").clientHeight > 200);
    if (id === "tab-measure") await page.locator(".more-tools").waitFor();
    await look(id);
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 390);
  }
  await page.evaluate(() => {
    const { api, viewer, session } = globalThis.kilwa;
    const place = [...viewer.pick(session.canvas.width / 2, session.canvas.height / 2)].slice(0, 3);
    api.addAnnotation({ place, title: "A note", text: "Text ".repeat(200), link: "https://example.org/" });
    api.openAnnotation("1");
  });
  await look("card");
  const card = await page.locator("#note-card").boundingBox();
  const stage = await page.locator(".stage").boundingBox();
  assert.ok(card.y >= stage.y && card.x >= 0 && card.x + card.width <= 390, "the card is on the picture");
  await page.locator("#note-edit").tap();
  await look("form");
  await page.locator("#note-form button[type=submit]").click();
  await page.locator("#note-close").click();
  await page.locator("#tool-walk").tap();
  await look("walking");
  await page.locator("#walk-leave").tap();
  await page.locator("#picture-open").tap();
  await look("picture");
  await page.locator("#picture form[method=dialog] button").tap();
  await page.locator("#help-open").tap();
  await look("help");
  assert.deepEqual(found, []);
  assert.deepEqual(complaints, []);
  await close();
});

test("at 200 % zoom nothing is cut off sideways, and the model keeps its place", async () => {
  // 1440 by 900 at 200 % is a page of 720 by 450 CSS pixels.
  const { page, complaints, close } = await open(browser, fort(), { size: [720, 450], deviceScaleFactor: 2 });
  const wide = () => page.evaluate(() => [document.documentElement.scrollWidth, document.documentElement.scrollHeight]);
  assert.deepEqual(await wide(), [720, 450]);
  for (const tab of await page.locator("[role=tab]").all()) {
    await page.evaluate((id) => document.getElementById(id).click(), await tab.getAttribute("id"));
    const sheet = await page.evaluate(() => [document.querySelector(".sheet").scrollWidth, document.querySelector(".sheet").clientWidth]);
    assert.ok(sheet[0] <= sheet[1], `${await tab.getAttribute("id")} is ${sheet[0]} wide in ${sheet[1]}`);
  }
  const canvas = await page.locator("#canvas").boundingBox();
  assert.ok(canvas.height >= 120 && canvas.width >= 400, JSON.stringify(canvas));
  for (const [open, dialog] of [
    ["#help-open", "#help"],
    ["#picture-open", "#picture"],
  ]) {
    await page.locator(open).click();
    await page.locator(dialog).waitFor();
    const box = await page.locator(dialog).boundingBox();
    assert.ok(box.x >= 0 && box.x + box.width <= 720 && box.y >= 0 && box.y + box.height <= 450, `${dialog}: ${JSON.stringify(box)}`);
    await page.keyboard.press("Escape");
  }
  assert.deepEqual(complaints, []);
  await close();
});

test("Tab reaches every control and shows where it stands; Escape closes what is open", async () => {
  const { page, complaints, close } = await open(browser, fort());
  await page.locator("#tab-saved").click();
  await page.evaluate(() => document.activeElement.blur());
  const seen = [];
  for (let i = 0; i < 60; i += 1) {
    await page.keyboard.press("Tab");
    const at = await page.evaluate(() => {
      const e = document.activeElement;
      const style = getComputedStyle(e);
      return { id: e.id || e.dataset.view || e.name, isShown: e === document.body || style.outlineStyle !== "none" || e.matches(".hidden") };
    });
    assert.ok(at.isShown, `${at.id} has the focus and does not show it`);
    if (at.id && seen.includes(at.id) && at.id === seen[0]) break;
    seen.push(at.id);
  }
  for (const id of [
    "share",
    "picture-open",
    "download",
    "fullscreen",
    "help-open",
    "language",
    "panel-toggle",
    "canvas",
    "tool-orbit",
    "tool-pan",
    "tool-walk",
    "fit",
    "views-open",
    "zoom-in",
    "zoom-out",
    "tool-measure",
    "tool-note",
    "hide",
    "plan",
    "tab-saved",
    "turning",
    "view-save",
  ]) {
    assert.ok(seen.includes(id), `Tab does not reach ${id}: ${seen}`);
  }
  await page.locator("#picture-open").click();
  await page.locator("#picture").waitFor();
  await page.keyboard.press("Escape");
  assert.ok(await page.locator("#picture").isHidden());
  assert.equal(await page.evaluate(() => document.activeElement.id), "picture-open", "the focus returns");
  assert.deepEqual(complaints, []);
  await close();
});

test("numbers and directions are those of the language", async () => {
  const { page, complaints, close } = await open(browser, fort("?error=8&lang=fr"));
  assert.match(await page.locator("#facts").innerText(), /\d{3}[\u202f\u00a0]\d{3}/, "thousands as in French");
  await page.locator("#language").selectOption("ar");
  await page.waitForFunction(() => document.documentElement.dir === "rtl");
  await page.locator("#tab-measure").click();
  await page.locator(".more-tools").waitFor();
  const numbers = await page.locator('input[type="number"]').evaluateAll((all) => all.map((e) => `${e.id} ${getComputedStyle(e).direction}`));
  assert.ok(numbers.length > 15 && numbers.every((n) => n.endsWith(" ltr")), `a sign stands before its number: ${numbers}`);
  await page.locator("#picture-open").click();
  await page.locator("#picture").waitFor();
  const sizes = await page.locator("#picture output").allTextContents();
  assert.ok(sizes.length >= 3 && sizes.slice(0, 3).every((size) => /^\u2066\d+ × \d+\u2069$/.test(size)), `width before height: ${sizes}`);
  await page.keyboard.press("Escape");
  const cube = await page.locator("#cube").boundingBox();
  const panel = await page.locator("#panel").boundingBox();
  assert.ok(panel.x < 10, "the panel stands at the left");
  assert.ok(cube.x - panel.x - panel.width < 40, "and the cube beside it");
  const turn = await page.evaluate(() => document.getElementById("cube-turn").getBoundingClientRect().x);
  assert.ok(Math.abs(turn - cube.x - cube.width / 2) < 60, "the cube turns in its place");
  assert.deepEqual(complaints, []);
  await close();
});

test("the details can be made wider by pointer and by keyboard, and stay so", async () => {
  const { page, complaints, close } = await open(browser, fort(), { size: [1200, 700] });
  const width = async () => (await page.locator("#panel").boundingBox()).width;
  assert.equal(await width(), 360);
  const edge = await page.locator("#divider").boundingBox();
  await page.mouse.move(edge.x + edge.width / 2, 300);
  await page.mouse.down();
  await page.mouse.move(edge.x + edge.width / 2 - 100, 310, { steps: 4 });
  await page.mouse.up();
  assert.equal(await width(), 460);
  await page.locator("#divider").focus();
  await page.keyboard.press("ArrowLeft");
  assert.equal(await width(), 484);
  assert.equal(await page.locator("#divider").getAttribute("aria-valuenow"), "484");
  await page.reload();
  await page.waitForFunction(() => document.body.dataset.state === "ready");
  assert.equal(await width(), 484);
  // Never so wide that no picture is left, and never too narrow for what stands in it.
  await page.locator("#divider").focus();
  await page.keyboard.press("End");
  assert.ok((await page.locator("#canvas").boundingBox()).width >= 400);
  await page.keyboard.press("Home");
  assert.equal(await width(), 280);
  await page.locator("#divider").dblclick();
  assert.equal(await width(), 360);
  // From right to left the edge is at the other side of the panel.
  await page.locator("#language").selectOption("ar");
  await page.waitForFunction(() => document.documentElement.dir === "rtl");
  await page.locator("#divider").focus();
  await page.keyboard.press("ArrowRight");
  assert.equal(await width(), 384);
  assert.deepEqual(complaints, []);
  await close();
});

test("keys of a single letter can be switched off, and stay off", async () => {
  const { page, complaints, close } = await open(browser, fort());
  await page.keyboard.press("?");
  await page.locator("#keys-on").uncheck();
  await page.keyboard.press("Escape");
  await page.reload();
  await page.waitForFunction(() => document.body.dataset.state === "ready");
  await page.locator("#canvas").focus();
  const before = (await cameraOf(page)).join();
  for (const key of ["?", "n", "h", "3", "w", "p", "+"]) await page.keyboard.press(key);
  assert.equal((await cameraOf(page)).join(), before);
  assert.ok(await page.locator("#help").isHidden());
  assert.equal(await page.locator("#tool-orbit").getAttribute("aria-pressed"), "true");
  await page.keyboard.press("ArrowLeft");
  assert.notEqual((await cameraOf(page)).join(), before, "arrows are no letters");
  await page.locator("#help-open").click();
  await page.locator("#keys-on").check();
  await page.keyboard.press("Escape");
  await page.keyboard.press("?");
  assert.ok(await page.locator("#help").isVisible());
  assert.deepEqual(complaints, []);
  await close();
});
