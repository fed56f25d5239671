// For everyone: large targets under fingers, nothing lost at 200 % zoom, a way by keyboard that shows where it is,
// and numbers and directions of the language.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import path from "node:path";
import { WWW, cameraOf, canvasOf, fortSite, open, openTab, pick, test, tool, waitFor } from "./harness.mjs";

const site = fortSite();

const fort = (query = "?error=8") => `${site.server.url}/m/fort${query}`;

/** The messages of a language, by their keys. */
const messages = async (language) => JSON.parse(await readFile(path.join(WWW, `i18n/${language}.json`), "utf8"));
const dialog = (page, name) => page.getByRole("dialog", { name, exact: true });
const button = (page, name) => page.getByRole("button", { name, exact: true });
/** The details beside the picture. */
const details = (page, name = "Details") => page.getByRole("complementary", { name, exact: true });
const hasFocus = (locator) => locator.evaluate((e) => e === document.activeElement);

const CONTROLS = ["button", "link", "tab", "combobox", "textbox", "spinbutton", "radio", "checkbox"];

/** Controls on screen that are smaller than 44 by 44. */
async function small(page) {
  const [first, ...others] = CONTROLS.map((role) => page.getByRole(role));
  const controls = others.reduce((all, one) => all.or(one), first);
  // Larger controls do the same: buttons in the Views tab for the cube, a list for things on the picture, and a button beside the tabs for the grip.
  // Links inside text are as high as the text, such as the link of a note.
  const groups = ["View cube", "Notes", "Measurements"].map((name) => page.getByRole("group", { name, exact: true }).getByRole("button"));
  const exempt = [...groups, page.getByRole("paragraph").getByRole("link", { name: "Read more" })].reduce(
    (all, one) => all.or(one),
    button(page, "Make the details panel larger or smaller"),
  );
  return controls.evaluateAll(
    (all, exempt) =>
      all
        .filter((e) => !exempt.includes(e))
        // The target is the label, with its radio button or check box, or in place of the file input.
        .flatMap((e) => (["radio", "checkbox", "file"].includes(e.type) ? [...e.labels] : [e]))
        .map((e) => [e, e.getBoundingClientRect()])
        .filter(([, { width, height }]) => width > 0 && (width < 43.5 || height < 43.5))
        .map(([e, { width, height }]) => `${e.ariaLabel || e.textContent || e.labels?.[0].textContent}: ${width} × ${height}`),
    await exempt.elementHandles(),
  );
}

test("on a phone every control is at least 44 pixels wide and high, in every tab, form and dialog", async () => {
  // A slow server: anything that arrived before the style sheet would be shown without it.
  const before = (page) =>
    page.route("**/measure.css", async (route) => {
      await new Promise((resolve) => setTimeout(resolve, 1500));
      await route.continue();
    });
  const { page, complaints, close } = await open(site.browser, fort(), { size: [390, 844], hasTouch: true, isMobile: true, before });
  const found = [];
  const look = async (where) => found.push(...(await small(page)).map((s) => `${where}: ${s}`));
  for (const tab of await page.getByRole("tab").all()) {
    const name = await tab.innerText();
    await tab.tap();
    const panel = page.getByRole("tabpanel", { name });
    await page.waitForFunction((panel) => panel.parentElement.clientHeight > 200, await panel.elementHandle());
    if (name === "Measure") await panel.getByText("All tools").waitFor();
    await look(name);
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 390);
  }
  const { place } = await pick(page, 0.5, 0.5);
  await page.evaluate((place) => {
    const { api } = globalThis.kilwa;
    api.addAnnotation({ place, title: "A note", text: "Text ".repeat(200), link: "https://example.org/" });
    api.openAnnotation("1");
  }, place);
  const note = page.getByRole("region", { name: "Note", exact: true });
  await note.waitFor();
  await look("card");
  const card = await note.boundingBox();
  const stage = await page.getByRole("main").boundingBox();
  assert.ok(card.y >= stage.y && card.x >= 0 && card.x + card.width <= 390, "the card is on the picture");
  await note.getByRole("button", { name: "Edit the note" }).tap();
  await page.getByRole("textbox", { name: "Title" }).waitFor();
  await look("form");
  await button(page, "Done").tap();
  await note.getByRole("button", { name: "Close" }).tap();
  await tool(page, "Walk at eye height").tap();
  await button(page, "Stop walking").waitFor();
  await look("walking");
  await button(page, "Stop walking").tap();
  await button(page, "Save a picture").tap();
  await dialog(page, "Save a picture").waitFor();
  await look("picture");
  await dialog(page, "Save a picture").getByRole("button", { name: "Close" }).tap();
  await button(page, "How to look around").tap();
  await dialog(page, "How to look around").waitFor();
  await look("help");
  assert.deepEqual(found, []);
  assert.deepEqual(complaints, []);
  await close();
});

test("at 200 % zoom nothing is cut off sideways, and the model keeps its place", async () => {
  // 1440 by 900 at 200 % is a page of 720 by 450 CSS pixels.
  const { page, complaints, close } = await open(site.browser, fort(), { size: [720, 450], deviceScaleFactor: 2 });
  const wide = () => page.evaluate(() => [document.documentElement.scrollWidth, document.documentElement.scrollHeight]);
  assert.deepEqual(await wide(), [720, 450]);
  for (const tab of await page.getByRole("tab").all()) {
    await tab.click();
    const name = await tab.innerText();
    const sheet = await page.getByRole("tabpanel", { name }).evaluate(({ parentElement }) => [parentElement.scrollWidth, parentElement.clientWidth]);
    assert.ok(sheet[0] <= sheet[1], `${name} is ${sheet[0]} wide in ${sheet[1]}`);
  }
  const canvas = await canvasOf(page).boundingBox();
  assert.ok(canvas.height >= 120 && canvas.width >= 400, JSON.stringify(canvas));
  for (const name of ["How to look around", "Save a picture"]) {
    await button(page, name).click();
    const box = await dialog(page, name).boundingBox();
    assert.ok(box.x >= 0 && box.x + box.width <= 720 && box.y >= 0 && box.y + box.height <= 450, `${name}: ${JSON.stringify(box)}`);
    await page.keyboard.press("Escape");
  }
  assert.deepEqual(complaints, []);
  await close();
});

test("Tab reaches every control and shows where it stands; Escape closes what is open", async () => {
  const { page, complaints, close } = await open(site.browser, fort());
  await openTab(page, "Views");
  const wanted = [
    ["button", "Share"],
    ["button", "Save a picture"],
    ["link", "Download pack"],
    ["button", "Full screen"],
    ["button", "How to look around"],
    ["combobox", "Language"],
    ["button", "Details"],
    ["button", "Drag turns the model"],
    ["button", "Drag moves the model"],
    ["button", "Walk at eye height"],
    ["button", "Show the whole model"],
    ["button", "Standard views"],
    ["button", "Zoom in"],
    ["button", "Zoom out"],
    ["button", "Measure"],
    ["button", "Write a note on the model"],
    ["button", "Hide everything but the model"],
    ["tab", "Views"],
    ["radio", "Turntable: up stays up"],
    ["button", "Save this view"],
  ];
  const controls = wanted.map(([role, name]) => page.getByRole(role, { name, exact: true }));
  const cube = page.getByRole("group", { name: "View cube" }).getByRole("button", { name: "Plan, from above", exact: true });
  const handles = await Promise.all([...controls, cube, canvasOf(page)].map((control) => control.elementHandle()));
  const seen = new Set();
  for (let i = 0; i < 60; i += 1) {
    await page.keyboard.press("Tab");
    const at = await page.evaluate((handles) => {
      const e = document.activeElement;
      // File inputs are not visible; their labels are.
      const isShown = e === document.body || e.type === "file" || getComputedStyle(e).outlineStyle !== "none";
      globalThis.firstFocused ??= e;
      return { control: handles.indexOf(e), name: e.ariaLabel || e.textContent, isShown, isFirst: e === globalThis.firstFocused };
    }, handles);
    assert.ok(at.isShown, `${at.name} has the focus and does not show it`);
    if (i > 0 && at.isFirst) break;
    seen.add(at.control);
  }
  for (const [i, name] of [...wanted, ["the cube"], ["the model"]].entries()) assert.ok(seen.has(i), `Tab does not reach ${name.join(" ")}`);
  await button(page, "Save a picture").click();
  await dialog(page, "Save a picture").waitFor();
  await page.keyboard.press("Escape");
  assert.ok(await dialog(page, "Save a picture").isHidden());
  assert.ok(await hasFocus(button(page, "Save a picture")), "the focus returns");
  assert.deepEqual(complaints, []);
  await close();
});

test("numbers and directions are those of the language", async () => {
  const { page, complaints, close } = await open(site.browser, fort("?error=8&lang=fr"));
  const [fr, ar] = await Promise.all(["fr", "ar"].map(messages));
  const triangles = page.getByRole("tabpanel", { name: fr.tabAbout }).getByRole("definition").first();
  assert.match(await triangles.innerText(), /\d{3}[\u202f\u00a0]\d{3}/, "thousands as in French");
  await page.getByRole("combobox", { name: fr.language }).selectOption("ar");
  await openTab(page, ar.tabMeasure);
  assert.equal(await page.evaluate(() => document.documentElement.dir), "rtl");
  await page.getByRole("tabpanel", { name: ar.tabMeasure }).getByText(ar.measureMore).waitFor();
  const numbers = await page
    .getByRole("spinbutton", { includeHidden: true })
    .evaluateAll((all) => all.map((e) => `${e.labels[0].textContent} ${getComputedStyle(e).direction}`));
  assert.ok(numbers.length > 15 && numbers.every((n) => n.endsWith(" ltr")), `a sign stands before its number: ${numbers}`);
  await button(page, ar.picture).click();
  await dialog(page, ar.picture).waitFor();
  const sizes = await dialog(page, ar.picture).getByRole("status").allTextContents();
  assert.ok(sizes.length >= 3 && sizes.slice(0, 3).every((size) => /^\u2066\d+ × \d+\u2069$/.test(size)), `width before height: ${sizes}`);
  await page.keyboard.press("Escape");
  const cube = page.getByRole("group", { name: ar.cube });
  const at = await cube.boundingBox();
  const panel = await details(page, ar.panel).boundingBox();
  assert.ok(panel.x < 10, "the panel stands at the left");
  assert.ok(at.x - panel.x - panel.width < 40, "and the cube beside it");
  for (const face of await cube.getByRole("button").all()) {
    const { x, width } = await face.boundingBox();
    assert.ok(Math.abs(x + width / 2 - at.x - at.width / 2) < 60, "the cube turns in its place");
  }
  assert.deepEqual(complaints, []);
  await close();
});

test("the details can be made wider by pointer and by keyboard, and stay so", async () => {
  const { page, complaints, close } = await open(site.browser, fort(), { size: [1200, 700] });
  const width = async () => (await details(page).boundingBox()).width;
  const divider = page.getByRole("separator", { name: "Width of the details panel; arrow keys change it" });
  assert.equal(await width(), 360);
  const edge = await divider.boundingBox();
  await page.mouse.move(edge.x + edge.width / 2, 300);
  await page.mouse.down();
  await page.mouse.move(edge.x + edge.width / 2 - 100, 310, { steps: 4 });
  await page.mouse.up();
  assert.equal(await width(), 460);
  await divider.focus();
  await page.keyboard.press("ArrowLeft");
  assert.equal(await width(), 484);
  assert.equal(await divider.getAttribute("aria-valuenow"), "484");
  await page.reload();
  await waitFor(page, "first");
  assert.equal(await width(), 484);
  // Never so wide that no picture is left, and never too narrow for what stands in it.
  await divider.focus();
  await page.keyboard.press("End");
  assert.ok((await canvasOf(page).boundingBox()).width >= 400);
  await page.keyboard.press("Home");
  assert.equal(await width(), 280);
  await divider.dblclick();
  assert.equal(await width(), 360);
  // From right to left the edge is at the other side of the panel.
  const ar = await messages("ar");
  await page.getByRole("combobox", { name: "Language" }).selectOption("ar");
  await page.getByRole("separator", { name: ar.panelWidth }).focus();
  await page.keyboard.press("ArrowRight");
  assert.equal((await details(page, ar.panel).boundingBox()).width, 384);
  assert.deepEqual(complaints, []);
  await close();
});

test("keys of a single letter can be switched off, and stay off", async () => {
  const { page, complaints, close } = await open(site.browser, fort());
  await page.keyboard.press("?");
  const help = dialog(page, "How to look around");
  const keys = help.getByRole("checkbox", { name: "Single-key shortcuts" });
  await keys.uncheck();
  await page.keyboard.press("Escape");
  await page.reload();
  await waitFor(page, "first");
  await canvasOf(page).focus();
  const before = (await cameraOf(page)).join();
  for (const key of ["?", "n", "h", "3", "w", "p", "+"]) await page.keyboard.press(key);
  assert.equal((await cameraOf(page)).join(), before);
  assert.ok(await help.isHidden());
  assert.equal(await tool(page, "Drag turns the model").getAttribute("aria-pressed"), "true");
  await page.keyboard.press("ArrowLeft");
  assert.notEqual((await cameraOf(page)).join(), before, "arrows are no letters");
  await button(page, "How to look around").click();
  await keys.check();
  await page.keyboard.press("Escape");
  await page.keyboard.press("?");
  await help.waitFor();
  assert.deepEqual(complaints, []);
  await close();
});
