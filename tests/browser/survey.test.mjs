// The pages of a survey as people meet them: the plan and the list together, pictures that zoom to single cells, both themes, a phone, Arabic, no scripts.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, before } from "node:test";
import { promisify } from "node:util";
import { serious, seriousOn } from "./axe.mjs";
import { KILWA, launch, open, serve, test } from "./harness.mjs";
import { decodePng } from "./png.mjs";

const run = promisify(execFile);
const PAGES = ["/", "/stations/hall/", "/stations/hall/?show=mask", "/stations/yard/?show=intensity", "/control/?a=hall&b=yard", "/stations/nowhere/"];
let work;
let server;
let browser;

/** A scan of a room from its middle, with stripes of intensity one column wide, brighter from row to row. A scan without a pose has no samples in its upper half. */
function room(columns, rows, [x, y], pose = true) {
  const lines = [columns, rows, `${x} ${y} 0`, "1 0 0", "0 1 0", "0 0 1", "1 0 0 0", "0 1 0 0", "0 0 1 0", pose ? `${x} ${y} 0 1` : "0 0 0 1"];
  for (let column = 0; column < columns; column += 1) {
    for (let row = 0; row < rows; row += 1) {
      const azimuth = (column / columns) * 2 * Math.PI;
      const elevation = (row / rows - 0.5) * 1.2;
      const ray = [Math.cos(elevation) * Math.cos(azimuth), Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation)];
      const range = pose || elevation < 0 ? Math.min(...ray.map((d, k) => [4, 3, 1.5][k] / Math.abs(d))) : 0;
      lines.push(`${ray.map((d) => (d * range).toFixed(4)).join(" ")} ${(column % 2) + row / rows}`);
    }
  }
  return `${lines.join("\n")}\n`;
}

before(async () => {
  work = await mkdtemp(path.join(tmpdir(), "kilwa-survey-"));
  const survey = path.join(work, "survey");
  // The hall has more columns than its picture has pixels.
  const scans = { hall: room(2400, 300, [0, 0]), yard: room(240, 80, [9, 2]), lost: room(60, 20, [0, 0], false) };
  for (const [name, text] of Object.entries(scans)) await writeFile(path.join(work, `${name}.ptx`), text);
  await run(KILWA, ["scans", "import", ...Object.keys(scans).map((name) => path.join(work, `${name}.ptx`)), "-o", survey]);
  await run(KILWA, ["scans", "mask", survey, "--inside", "2,-4,-2,6,4,2", "--name", "east", "--station", "hall"]);
  const file = path.join(survey, "survey.toml");
  const text = await readFile(file, "utf8");
  const [placed, lost] = text.split('name = "lost"');
  const control = '\n[[control]]\nname = "P1"\nat = [4.0, 2.0, 0.0]\n';
  await writeFile(file, `${placed}name = "lost"${lost.replace(/^rotation .*\ntranslation .*\n/m, "")}${control}`);
  server = await serve(survey);
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
  await rm(work, { recursive: true });
});

const look = (address, options = {}) => open(browser, `${server.url}${address}`, { size: [1200, 800], wait: null, ...options });
const picture = (page) => page.getByRole("group", { name: /image of station/i });
const zoomOf = async (page) => Number.parseInt(await page.getByRole("status").innerText(), 10);

test("axe-core finds nothing serious, in both themes and in Arabic", async () => {
  assert.deepEqual(await seriousOn(look, PAGES, (text) => text.includes("404")), []);
});

test("on a phone nothing is wider than the screen and every control is large enough for a finger", async () => {
  for (const address of PAGES) {
    const { page, close } = await look(address, { size: [390, 844], hasTouch: true, isMobile: true });
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 390, address);
    // The links of the plan are also in the list.
    const drawn = await page.getByRole("group", { name: "Plan" }).getByRole("link").elementHandles();
    const small = await page
      .getByRole("link")
      .or(page.getByRole("button"))
      .evaluateAll(
        (all, others) =>
          all
            .filter((e) => !others.includes(e))
            .map((e) => [e, e.getBoundingClientRect()])
            .filter(([, b]) => b.height < 43.5)
            .map(([e, b]) => `${e.textContent.trim()}: ${b.width} × ${b.height}`),
        drawn,
      );
    assert.deepEqual(small, [], address);
    await close();
  }
});

test("the plan and the list mark the same station", async () => {
  const { page, close } = await look("/");
  const plan = page.getByRole("group", { name: "Plan" }).first();
  const row = (name) => page.getByRole("row").filter({ has: page.getByRole("link", { name, exact: true }) });
  const classes = (locator) => locator.evaluate((e) => e.getAttribute("class") ?? "");
  // The address changes first; the page marks the station when the browser reports the change.
  const picked = (locator) => locator.and(page.locator(".picked")).waitFor();
  await plan.getByRole("link", { name: "yard" }).click();
  assert.match(page.url(), /#station-yard$/);
  await picked(row("yard"));
  await picked(plan.getByRole("link", { name: "yard" }));
  await row("hall").getByRole("cell").first().click();
  await picked(plan.getByRole("link", { name: "hall" }));
  assert.doesNotMatch(await classes(row("yard")), /picked/);
  // By keyboard: the link in the list has the focus, the station on the plan is marked.
  await row("yard").getByRole("link").focus();
  assert.match(await classes(plan.getByRole("link", { name: "yard" })), /marked/);
  assert.equal(await plan.getByRole("link").count(), 2, "a station without a pose has no place");
  assert.ok(await page.getByRole("region", { name: "Pose unknown" }).getByRole("link", { name: "lost" }).isVisible());
  await page.keyboard.press("Enter");
  await page.waitForURL(/\/stations\/yard\/$/);
  await page.getByRole("link", { name: "Plan and all stations" }).click();
  await page.waitForURL(/\/#station-yard$/);
  await picked(row("yard"));
  await close();
});

test("a picture zooms by wheel, keys and buttons, around the place under the pointer", async () => {
  const { page, close } = await look("/stations/hall/");
  const frame = picture(page);
  const box = await frame.boundingBox();
  const at = [box.x + box.width * 0.75, box.y + box.height * 0.5];
  /** The column of the picture under the pointer. */
  const column = () =>
    frame.evaluate((e, [x]) => {
      const b = e.querySelector("img").getBoundingClientRect();
      return (2400 * (x - b.left)) / b.width;
    }, at);
  const before = await column();
  await page.mouse.move(...at);
  await page.mouse.wheel(0, -600);
  await page.waitForFunction(() => Number.parseInt(document.querySelector("output").textContent, 10) > 200);
  assert.ok(Math.abs((await column()) - before) < 4, `${before} stays at the pointer: ${await column()}`);
  // After the picture was moved by other means, the wheel zooms around what is at the pointer now.
  await frame.evaluate((e) => e.scrollBy({ left: e.clientWidth / 4, behavior: "instant" }));
  const [moved, enlarged] = [await column(), await zoomOf(page)];
  assert.ok(Math.abs(moved - before) > 20, `${before} is no longer at the pointer: ${moved}`);
  await page.mouse.wheel(0, -300);
  await page.waitForFunction((before) => Number.parseInt(document.querySelector("output").textContent, 10) > before, enlarged);
  assert.ok(Math.abs((await column()) - moved) < 4, `${moved} stays at the pointer: ${await column()}`);
  // A drag moves the picture, and is no click.
  const scrolled = () => frame.evaluate((e) => e.scrollLeft);
  const from = await scrolled();
  await page.mouse.down();
  await page.mouse.move(at[0] - 60, at[1], { steps: 4 });
  await page.mouse.up();
  assert.ok(Math.abs((await scrolled()) - from - 60) < 8, `${from} to ${await scrolled()}`);
  await frame.focus();
  await page.keyboard.press("0");
  assert.equal(await zoomOf(page), 100);
  await page.keyboard.press("+");
  assert.equal(await zoomOf(page), 150);
  await page.keyboard.press("-");
  assert.equal(await zoomOf(page), 100);
  await page.getByRole("button", { name: "Zoom in" }).click();
  await page.getByRole("button", { name: "Zoom in" }).click();
  assert.equal(await zoomOf(page), 225);
  await page.getByRole("button", { name: "Zoom out" }).click();
  assert.equal(await zoomOf(page), 150);
  await page.getByRole("button", { name: "Show all" }).click();
  assert.equal(await zoomOf(page), 100);
  await close();
});

test("two fingers zoom", async () => {
  const { page, close } = await look("/stations/hall/", { size: [390, 844], hasTouch: true, isMobile: true });
  const { x, y, width, height } = await picture(page).boundingBox();
  const session = await page.context().newCDPSession(page);
  const fingers = (apart) => [-apart, apart].map((dx, id) => ({ x: x + width / 2 + dx, y: y + height / 2, id }));
  await session.send("Input.dispatchTouchEvent", { type: "touchStart", touchPoints: fingers(20) });
  for (const apart of [40, 60, 80, 100]) await session.send("Input.dispatchTouchEvent", { type: "touchMove", touchPoints: fingers(apart) });
  await session.send("Input.dispatchTouchEvent", { type: "touchEnd", touchPoints: [] });
  await page.waitForFunction(() => Number.parseInt(document.querySelector("output").textContent, 10) > 300);
  await close();
});

test("zoomed in, every cell of a large station is shown", async () => {
  const { page, close } = await look("/stations/hall/?show=intensity");
  const frame = picture(page);
  await frame.focus();
  for (let k = 0; k < 20; k += 1) await page.keyboard.press("+");
  await page.waitForFunction(() => [...document.querySelectorAll("img.part")].some((e) => e.complete && e.naturalWidth > 0));
  const cell = await frame.evaluate((e) => e.querySelector("img").getBoundingClientRect().width / 2400);
  assert.ok(cell > 8, `a cell is ${cell} pixels wide`);
  // Stripes one column wide: each cell is unlike its neighbours, which the picture of every second column cannot show.
  await page.waitForFunction(() => [...document.querySelectorAll("img.part")].every((e) => e.complete));
  const { width, at, channels } = decodePng(await frame.screenshot());
  assert.ok(channels >= 3);
  let changes = 0;
  for (let x = 21; x < width - 20; x += 1) changes += Math.abs(at(x, 150)[0] - at(x - 1, 150)[0]) > 60 ? 1 : 0;
  assert.ok(changes > (0.7 * (width - 40)) / cell, `${changes} changes over ${width} pixels`);
  await close();
});

/** Zoom into the picture of a station so that a place is one cell; `at` are shares of its width and height. Returns a function that finds the place in the window. */
async function aim(page, name, at) {
  const frame = page.getByRole("group", { name: new RegExp(`image of station ${name}`, "i") });
  const place = () =>
    frame.evaluate((e, [x, y]) => {
      const box = e.querySelector(".content").getBoundingClientRect();
      return [box.left + x * box.width, box.top + y * box.height];
    }, at);
  await frame.press("0");
  await frame.evaluate((e) => e.scrollIntoView({ block: "center" }));
  await page.mouse.move(...(await place()));
  for (let k = 0; k < 4; k += 1) await page.mouse.wheel(0, -600);
  await page.waitForFunction((e) => e.querySelector(".content").clientWidth > 11.5 * Number(e.dataset.width), await frame.elementHandle());
  return place;
}

// Both rooms are the same and were scanned from the middle: what lies in the same direction is the same place. These are columns and rows of the yard; a column
// there is ten of the hall, four rows are fifteen. In pictures, columns run the other way round, and rows from the top. Not in the east, which a mask hides.
const PLACES = [
  [60, 20],
  [100, 60],
  [150, 16],
  [185, 44],
];
const shareOf = ([column, row], [columns, rows]) => [1 - (column + 0.5) / columns, 1 - (row + 0.5) / rows];
const aimAtYard = (page, place) => aim(page, "yard", shareOf(place, [240, 80]));
const aimAtHall = (page, [column, row]) => aim(page, "hall", shareOf([10 * column, (15 * row) / 4], [2400, 300]));
const says = (page, text) => page.getByRole("status").filter({ hasText: text }).waitFor();
const rowsOf = (page) => page.getByRole("region", { name: "Pairs" }).getByRole("row");

/** Mark a place in both stations; in the hall `off` columns of the yard beside it. */
async function markBoth(page, [column, row], off = 0) {
  await page.mouse.click(...(await (await aimAtYard(page, [column, row]))()));
  await says(page, "Mark the same place in hall.");
  await page.mouse.click(...(await (await aimAtHall(page, [column + off, row]))()));
}

/** The page of the two stations, and three pairs marked on it. Tests share it, and leave it as it was: marking takes long, and the browser keeps marks for a tab only. */
const marking = () => (marked ??= markThree());
let marked;

async function markThree() {
  const opened = await look("/stations/yard/", { size: [1280, 1000], permissions: ["clipboard-read", "clipboard-write"] });
  const { page } = opened;
  await page.getByRole("link", { name: "Mark control points" }).click();
  await page.getByLabel("Second station").selectOption("hall");
  await page.getByRole("button", { name: "Show these stations" }).click();
  await page.waitForURL(/\/control\/\?a=yard&b=hall/);
  await says(page, "3 more pairs are needed.");
  for (const [k, place] of PLACES.slice(0, 3).entries()) {
    await markBoth(page, place);
    await rowsOf(page)
      .nth(k + 1)
      .waitFor();
  }
  await says(page, "The pairs fit each other");
  return opened;
}

test("the same places are marked in two stations, checked, and exported for survey.toml", async () => {
  const { page } = await marking();
  const rows = rowsOf(page);
  for (const k of [1, 2, 3])
    assert.match(await rows.nth(k).getByRole("cell").nth(2).innerText(), /^\d\.\d mm$/, "cells of both grids that lie in the same direction");
  const entries = page.getByRole("textbox", { name: "Entries for survey.toml" });
  const text = await entries.inputValue();
  assert.equal(text.match(/^\[\[control\]\]$/gm).length, 6);
  assert.match(text, /name = "hall\+yard-1"\nstation = "yard"\nat = \[[-\d., ]+\]\nsigma = 0\.0\d\d\n/);
  await page.getByRole("button", { name: "Copy" }).click();
  await says(page, "Copied.");
  assert.equal(await page.evaluate(() => navigator.clipboard.readText()), text);
  const download = page.waitForEvent("download");
  await page.getByRole("button", { name: "Download" }).click();
  assert.equal((await download).suggestedFilename(), "control-yard-hall.toml");
  assert.equal(await readFile(await (await download).path(), "utf8"), text);
  assert.deepEqual(await serious(page, "control points"), []);
});

test("a wrong pair is named, steps are undone, and quick clicks are not lost", async () => {
  const { page } = await marking();
  const rows = rowsOf(page);
  await markBoth(page, PLACES[3], -24);
  await says(page, /Pair 4 does not fit: its residual is \d/);
  assert.match(await rows.nth(4).getByRole("cell").nth(2).innerText(), /^\d.* · check$/, "not by colour alone");
  await page.keyboard.press("Control+z");
  await says(page, "Mark the same place in hall.");
  await page.keyboard.press("Escape");
  await says(page, "The pairs fit each other");
  await page.getByRole("button", { name: "Remove hall+yard-2" }).click();
  await says(page, "1 more pair is needed.");
  const focused = () => page.evaluate(() => document.activeElement?.getAttribute("aria-label"));
  assert.equal(await focused(), "Remove hall+yard-2", "the next pair has taken its place, and the focus stays there");
  await page.evaluate(() => {
    document.activeElement?.classList.add("old");
    dispatchEvent(new Event("focus"));
  });
  await page.waitForFunction(() => !document.querySelector("tbody .old"));
  assert.equal(await focused(), "Remove hall+yard-2", "also when the window gets the focus");
  await page.getByRole("button", { name: "Undo" }).click();
  await says(page, "The pairs fit each other");

  // Both places are clicked before the server has answered for the first.
  const places = [await aimAtYard(page, PLACES[3]), await aimAtHall(page, PLACES[3])];
  await page.route("**/at/*", async (route) => {
    await new Promise((done) => setTimeout(done, 1000));
    await route.continue();
  });
  for (const place of places) await page.mouse.click(...(await place()));
  await rows.nth(4).waitFor();
  await says(page, "The pairs fit each other");
  await page.unroute("**/at/*");
  await page.keyboard.press("Control+z");
  await says(page, "Mark the same place in hall.");
  await page.keyboard.press("Escape");
  await says(page, "The pairs fit each other");
});

test("marks are kept after a reload, in other pictures and in the other order; places are marked by keyboard", async () => {
  const { page, complaints } = await marking();
  const rows = rowsOf(page);
  await page.reload();
  await rows.nth(3).waitFor();
  await page.getByRole("link", { name: "Range", exact: true }).click();
  await page.waitForURL(/show=range/);
  await rows.nth(3).waitFor();
  await page.getByLabel("First station").selectOption("hall");
  await page.getByLabel("Second station").selectOption("yard");
  await page.getByRole("button", { name: "Show these stations" }).click();
  await page.waitForURL(/a=hall&b=yard/);
  await rows.nth(3).waitFor();
  // By keyboard: the place at the middle of the view.
  const frame = page.getByRole("group", { name: /image of station yard/i });
  await frame.focus();
  await page.keyboard.press("Shift+ArrowRight");
  await page.keyboard.press("Enter");
  await says(page, "Mark the same place in hall.");
  await page.keyboard.press("Escape");
  await says(page, "The pairs fit each other");
  assert.deepEqual(complaints, []);
});

test("in the sky, where nothing was measured, no place can be marked", async () => {
  const { page, close } = await look("/control/?a=lost&b=yard");
  const box = await page.getByRole("group", { name: /image of station lost/i }).boundingBox();
  await page.mouse.click(box.x + box.width / 2, box.y + box.height * 0.2);
  await says(page, "There is no sample at this place");
  assert.equal(await rowsOf(page).count(), 0);
  await close();
});

test("without scripts the pages show the same, but do not zoom", async () => {
  const { page, close } = await look("/", { javaScriptEnabled: false });
  await page.getByRole("group", { name: "Plan" }).first().getByRole("link", { name: "yard" }).click();
  assert.match(page.url(), /#station-yard$/);
  await page.getByRole("table").getByRole("link", { name: "hall" }).click();
  await page.getByRole("link", { name: "Masks" }).click();
  const image = page.getByRole("img", { name: /^Image of station hall in grey/ });
  assert.ok(await image.isVisible());
  assert.ok((await image.evaluate((e) => e.naturalWidth)) === 1200);
  assert.ok(await page.getByText("east", { exact: true }).isVisible());
  assert.equal(await page.getByRole("button").count(), 0, "no control that does nothing");
  await page.goto(`${server.url}/control/?a=hall&b=yard`);
  // Chromium shows this text to people who turned scripts off, but not to tests that do.
  assert.match(await page.content(), /<noscript>.*Marking points needs JavaScript/s);
  assert.deepEqual(await page.getByRole("button").allInnerTexts(), ["Show these stations"]);
  await close();
});
