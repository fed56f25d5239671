// Measuring in the page: final values are those of `kilwa measure` to the last digit; everything can be undone, is kept, travels by address and file,
// and is done by pointer, finger and keyboard.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, before } from "node:test";
import { promisify } from "node:util";
import { KILWA, WWW, cameraOf, launch, open, packFolder, serve, test, waitFor } from "./harness.mjs";

let server;
let browser;
let pack;
let scratch;

before(async () => {
  const folder = await packFolder();
  pack = path.join(folder, "fort.kilwa");
  scratch = await mkdtemp(path.join(tmpdir(), "kilwa-measuring-"));
  server = await serve(folder);
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
  await rm(scratch, { recursive: true });
});

const fort = (query = "?error=4") => `${server.url}/m/fort${query}`;
const tab = { size: [1200, 800] };
const kilwa = async (...args) => (await promisify(execFile)(KILWA, ["measure", pack, ...args.map(String)])).stdout;

/** Presses at shares of the canvas's width and height. */
async function press(page, ...places) {
  const box = await page.locator("#canvas").boundingBox();
  for (const [x, y] of places) await page.mouse.click(box.x + box.width * x, box.y + box.height * y);
}
/** Until the list has so many, and each has its value or a reason for none. */
const done = (page, count = 1) =>
  page.waitForFunction(
    (count) => {
      const items = globalThis.kilwa.measuring.tools?.items;
      return items?.length === count && items.every(({ task }) => !["picking", "measuring"].includes(task.state));
    },
    count,
    { polling: 50 },
  );
const list = (page) => page.evaluate(() => globalThis.kilwa.api.measurements());
/** The measurements with every bit of their places and values. */
const bits = (page) =>
  page.evaluate(() => {
    const hex = (v) => [...new Uint8Array(new Float64Array([v]).buffer)].map((b) => b.toString(16).padStart(2, "0")).join("");
    return globalThis.kilwa.measuring.tools.items.map(({ name, task }) => ({
      name,
      tool: task.tool,
      local: task.points.flatMap((p) => p.local.map(hex)),
      readings: task.readings.map((r) => [r.name, hex(r.value), hex(r.uncertainty)]),
    }));
  });
const rays = (page, at = 0) =>
  page.evaluate((at) => globalThis.kilwa.measuring.tools.items[at].task.points.flatMap((p) => [...p.ray.origin, ...p.ray.direction]), at);
const tool = async (page, name) => {
  await page.locator("#tab-measure").click();
  await page.locator(".more-tools").waitFor();
  await page.evaluate((name) => document.querySelector(`.more-tools [data-tool="${name}"]`).click(), name);
};
const measured = async (options = {}) => {
  const opened = await open(browser, fort(), { ...tab, ...options });
  await opened.page.locator("#tool-measure").click();
  await opened.page.locator("#measure-bar").waitFor();
  await press(opened.page, [0.42, 0.5], [0.55, 0.5]);
  await done(opened.page);
  await opened.page.keyboard.press("Escape");
  return opened;
};

test("a distance by two presses is provisional, then final, and the value of kilwa measure to the last digit", async () => {
  const asked = [];
  const { page, complaints, close } = await open(browser, fort("?error=12"), {
    ...tab,
    before: (page) => page.on("request", (request) => asked.push(new URL(request.url()).pathname)),
  });
  assert.ok(!asked.some((name) => /measure/.test(name)), `nothing of measuring is loaded before it is used: ${asked}`);
  await page.locator("#canvas").focus();
  await page.keyboard.press("m");
  await page.locator("#measure-bar").waitFor();
  assert.match(await page.locator("#hint").innerText(), /Distance: click point 1 of 2/);
  // Answers wait, so that what is not final can be seen.
  let release;
  const held = new Promise((resolve) => (release = resolve));
  await page.route("**/packs/**", async (route) => {
    await held;
    await route.continue().catch(() => {});
  });
  await press(page, [0.42, 0.5], [0.55, 0.5]);
  const label = page.locator(".mark-label");
  await label.filter({ hasText: "refining" }).waitFor();
  assert.match(await label.innerText(), /^(≈ [\d.]+ m ± [\d.]+ (mm|cm|m), )?refining$/u);
  const before = await page.evaluate(() => globalThis.kilwa.measuring.tools.items[0].task.provisional);
  release();
  await done(page);
  const [one] = await list(page);
  assert.equal(one.state, "final");
  const printed = await kilwa("distance", "--rays", ...(await rays(page)));
  const [, straight] = /^straight +(.+)$/m.exec(printed);
  await page.locator(".measure-table .facts dd").first().waitFor();
  assert.equal(await page.locator(".measure-table .facts dd").first().innerText(), straight);
  assert.equal(
    await label.innerText(),
    straight.replace(
      /^([\d.]+) ± ([\d.]+) m$/,
      (_, v) => `${v} m ± ${(one.readings[0].uncertainty * 1000).toFixed(1 - Math.floor(Math.log10(one.readings[0].uncertainty * 1000)))} mm`,
    ),
  );
  if (before) assert.ok(Math.abs(one.readings[0].value - before.value) <= before.half, "the final value lies in the provisional interval");
  assert.equal(await page.locator("#announce").innerText(), `Distance 1: ${await label.innerText()}`);
  // The capture accuracy of this pack is not known, and the explanation says so.
  assert.match(await page.locator(".explain").innerText(), /Capture\s+unknown/);
  assert.deepEqual(complaints, []);
  await close();
});

test("the value does not depend on what is on screen", async () => {
  const { page, complaints, close } = await measured();
  const [wanted] = await list(page);
  const given = await page.evaluate(() => globalThis.kilwa.measuring.tools.items[0].task.points.map((p) => p.ray));
  for (const query of ["?error=64", "?error=1", "?error=16&gpu=webgl"]) {
    const other = await open(browser, fort(query), tab);
    const again = await other.page.evaluate((rays) => globalThis.kilwa.api.addMeasurement({ tool: "distance", rays }), given);
    assert.deepEqual(again.readings, wanted.readings);
    await other.close();
  }
  assert.deepEqual(complaints, []);
  await close();
});

test("everything is undone and redone, a reload keeps it, and a point that is dragged is measured again", async () => {
  const { page, complaints, close } = await measured();
  const first = await bits(page);
  await page.keyboard.press("Control+z");
  assert.equal((await list(page)).length, 0);
  await page.keyboard.press("Control+Shift+z");
  assert.deepEqual(await bits(page), first);
  await page.locator(".measure-table .go").click();
  const handle = await page.locator(".mark-point").first().boundingBox();
  const [x, y] = [handle.x + handle.width / 2, handle.y + handle.height / 2];
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 20, y + 4, { steps: 4 });
  await page.mouse.up();
  await page.waitForFunction((was) => globalThis.kilwa.measuring.tools.items[0].task.points[0].world.join() !== was, first[0].local.join());
  await done(page);
  const moved = await bits(page);
  assert.notDeepEqual(moved[0].local.slice(0, 3), first[0].local.slice(0, 3));
  assert.deepEqual(moved[0].local.slice(3), first[0].local.slice(3), "the other point stays");
  assert.notDeepEqual(moved[0].readings, first[0].readings);
  await page.keyboard.press("Control+z");
  assert.deepEqual(await bits(page), first);
  await page.keyboard.press("Control+y");
  assert.deepEqual(await bits(page), moved);
  await page.locator('.measure-table [data-act="name"]').fill("Gate, width");
  await page.locator('.measure-table [data-act="note"]').fill("Measured at noon.");
  // What is typed is kept before the field is left.
  await page.reload();
  await waitFor(page, "settled");
  await done(page);
  const [kept] = await list(page);
  assert.equal(kept.note, "Measured at noon.");
  assert.deepEqual((await bits(page))[0].readings, moved[0].readings);
  assert.deepEqual((await bits(page))[0].local, moved[0].local);
  assert.deepEqual(complaints, []);
  await close();
});

test("points are taken back and put again while they are drawn, and a tool stays until it is left", async () => {
  const { page, complaints, close } = await open(browser, fort(), tab);
  await tool(page, "polyline");
  await page.locator("#measure-bar").waitFor();
  await press(page, [0.42, 0.5], [0.5, 0.5]);
  const drawn = () => page.evaluate(() => globalThis.kilwa.measuring.tools.draft.drawn?.points.length ?? null);
  assert.equal(await drawn(), 2);
  await page.keyboard.press("Backspace");
  assert.equal(await drawn(), 1);
  await page.keyboard.press("Enter");
  assert.match(await page.locator("#notice").innerText(), /at least 2/);
  await page.keyboard.press("Control+Shift+z");
  assert.equal(await drawn(), 2);
  await press(page, [0.56, 0.52]);
  await page.keyboard.press("Enter");
  await done(page);
  assert.equal(await drawn(), 0, "the tool goes on");
  assert.match(await page.locator("#hint").innerText(), /^Path: click point 1/);
  const [path] = await list(page);
  assert.equal(path.points.length, 3);
  assert.deepEqual(
    path.readings.map((r) => r.name),
    ["straight", "horizontal", "vertical", "ends"],
  );
  await page.keyboard.press("Escape");
  assert.equal(await drawn(), null);
  assert.ok(await page.locator("#measure-bar").isHidden());
  assert.deepEqual(complaints, []);
  await close();
});

test("an address opens the same measurement elsewhere, to the last bit, and one that is too long says so", async () => {
  const { page, complaints, close } = await measured();
  await page.evaluate(() =>
    globalThis.kilwa.measuring.tools.update(globalThis.kilwa.measuring.tools.items[0].id, { name: "Gate! ~ width, 50 % “é”", color: "#c2256b" }),
  );
  const wanted = await bits(page);
  const address = await page.evaluate(() => globalThis.kilwa.api.link());
  const other = await open(browser, address, tab);
  await done(other.page);
  assert.deepEqual(await bits(other.page), wanted);
  assert.equal((await list(other.page))[0].color, "#c2256b");
  await other.page.reload();
  await waitFor(other.page, "settled");
  await done(other.page);
  assert.equal((await list(other.page)).length, 1, "what is kept and what the address says are the same measurement");
  await other.page.evaluate(() => {
    const { tools } = globalThis.kilwa.measuring;
    tools.list.change(Array.from({ length: 80 }, (_, k) => ({ ...tools.items[0], id: `x${k}` })));
  });
  await other.page.locator("#share").click();
  await other.page.locator("#notice", { hasText: "too many measurements for a link" }).waitFor();
  assert.ok(!(await other.page.evaluate(() => location.hash)).includes("measurements="));
  assert.deepEqual([...complaints, ...other.complaints], []);
  await other.close();
  await close();
});

test("a file reads back to the last bit, here and by kilwa measure, and one of another pack warns first", async () => {
  const { page, complaints, close } = await measured();
  await tool(page, "area");
  await page.locator("#measure-bar").waitFor();
  await press(page, [0.42, 0.48], [0.5, 0.48], [0.48, 0.53]);
  await page.keyboard.press("Enter");
  await done(page, 2);
  await page.keyboard.press("Escape");
  const wanted = await bits(page);
  const [download] = await Promise.all([page.waitForEvent("download"), page.locator("#measure .button", { hasText: "Save as a file" }).click()]);
  const words = await readFile(await download.path(), "utf8");
  const file = path.join(scratch, "fort.json");
  await writeFile(file, words);
  assert.match(await kilwa("again", file), /Distance 1 \(distance\): the same[\s\S]*Area 1 \(area\): the same/);
  await page.locator("#measure .button", { hasText: "Delete all" }).click();
  assert.equal((await list(page)).length, 0);
  await page.locator("#measure-import").setInputFiles(file);
  await done(page, 2);
  assert.deepEqual(await bits(page), wanted);
  // Dropped on the page it is read too; what is here already is not added twice.
  await page.keyboard.press("Escape");
  await page.evaluate((words) => {
    const data = new DataTransfer();
    data.items.add(new File([words], "fort.json", { type: "application/json" }));
    dispatchEvent(new DragEvent("drop", { dataTransfer: data, cancelable: true }));
  }, words);
  await page.locator("#notice", { hasText: "Read: 2" }).waitFor();
  assert.deepEqual(await bits(page), wanted);
  const [again] = await Promise.all([page.waitForEvent("download"), page.locator("#measure .button", { hasText: "Save as a file" }).click()]);
  assert.equal(await readFile(await again.path(), "utf8"), words);
  for (const [format, says] of [
    ["csv", /^name,tool,reading/],
    ["geojson", /FeatureCollection/],
    ["dxf", /AC1024|SECTION/],
  ]) {
    await page.locator("#measure p.actions select").selectOption(format);
    const [out] = await Promise.all([page.waitForEvent("download"), page.locator("#measure .button", { hasText: "Save as a file" }).click()]);
    assert.match(await readFile(await out.path(), "utf8"), says, format);
  }
  // Of another pack: nothing is added before the person says so, and then it is measured here.
  const foreign = JSON.parse(words);
  foreign.pack.identity = foreign.pack.identity.replace(/^./, (c) => (c === "0" ? "1" : "0"));
  foreign.pack.title = "Husuni Kubwa";
  for (const one of foreign.measurements) one.name += ", before";
  // A file that somebody sent may have anything in place of a colour.
  foreign.measurements[0].color = "red;position:fixed;inset:0;width:auto;height:auto";
  const give = (value) => page.locator("#measure-import").setInputFiles({ name: "x.json", mimeType: "application/json", buffer: Buffer.from(value) });
  await give(JSON.stringify(foreign));
  await page.locator("#notice", { hasText: "another model: “Husuni Kubwa”" }).waitFor();
  assert.equal((await list(page)).length, 2);
  await page.locator("#notice-action").click();
  await done(page, 4);
  const swatches = await page.locator(".measure-table .swatch").evaluateAll((all) => all.map((e) => getComputedStyle(e).position));
  assert.ok(swatches.length === 4 && !swatches.includes("fixed"), `${swatches}`);
  await page.locator(".measure-table .go").last().click();
  await page.locator(".explain .warn", { hasText: "another pack" }).waitFor();
  for (const [bad, says] of [
    ["{", /could not be read/],
    ['{"kilwa":"measurements","version":99,"measurements":[]}', /this page reads versions up to 1/],
    ['{"kilwa":"pack","version":1}', /not a file of measurements; its type is “pack”/],
  ]) {
    await give(bad);
    await page.waitForFunction((text) => new RegExp(text).test(document.getElementById("notice-text").textContent), says.source);
  }
  assert.equal((await list(page)).length, 4);
  assert.deepEqual(complaints, []);
  await close();
});

test("what the engine remarks, refuses and cannot read is said in the language of the page, also after it is changed", async () => {
  const strings = async (lang) => JSON.parse(await readFile(path.join(WWW, `i18n/${lang}.json`), "utf8"));
  // Any number may be any form of its message.
  const source = (message) => {
    if (Array.isArray(message)) return message.map(source).join("");
    if (typeof message === "object")
      return `(?:${Object.entries(message)
        .filter(([key]) => key !== "$")
        .map(([, form]) => source(form))
        .join("|")})`;
    return message.replace(/[.*+?^$()|[\]\\]/g, "\\$&").replace(/\{\w+\}/g, ".+");
  };
  const pattern = (message) => new RegExp(source(message));
  const { page, complaints, close } = await open(browser, fort("?error=8&lang=fr"), tab);
  const { bounds_min: low, bounds_max: high } = await page.evaluate(() => globalThis.kilwa.info.metadata);
  const middle = low.map((v, i) => (v + high[i]) / 2);
  const square = [
    [-4, -4],
    [4, -4],
    [4, 4],
    [-4, 4],
  ].map(([x, y]) => [middle[0] + x, middle[1] + y, middle[2]]);
  const add = (one) => page.evaluate((one) => globalThis.kilwa.api.addMeasurement(one), one);
  const found = [
    [await add({ tool: "section", plane: { point: middle, normal: [1, 0, 0] } }), ["remarkLines"]],
    [await add({ tool: "contours", interval: 2 }), ["remarkHeights"]],
    [await add({ tool: "cut-fill", points: square, reach: 20 }), ["remarkCovered"]],
    [await add({ tool: "area", points: square, reach: 20 }), ["remarkReach"]],
    [await add({ tool: "volume" }), ["refuseOpen"]],
    [await add({ tool: "area", points: [square[0], square[2], square[1], square[3]] }), ["refuseCross"]],
    [await add({ tool: "contours", interval: 1e-9 }), ["refuseInterval"]],
    [await add({ tool: "section", plane: { point: [middle[0], middle[1], high[2] + 100], normal: [0, 0, 1] } }), ["refuseMisses"]],
    [await add({ tool: "circle", points: [middle, middle, middle] }), ["refuseCollinear"]],
  ];
  const english = await strings("en");
  for (const lang of ["fr", "ar"]) {
    await page.selectOption("#language", lang);
    await page.waitForFunction((lang) => document.documentElement.lang === lang, lang);
    const here = await strings(lang);
    for (const [{ id, state }, keys] of found) {
      assert.ok(["final", "refused"].includes(state), `${keys}: ${state}`);
      await page.evaluate((id) => globalThis.kilwa.measuring.tools.choose(id, { focus: true }), id);
      const said = (await page.locator(".explain").innerText()).replaceAll(/[\u2066\u2069]/g, "");
      for (const key of keys) {
        assert.match(said, pattern(here[key]), `${lang}: ${key}`);
        assert.doesNotMatch(said, pattern(english[key]), `${lang}: ${key}`);
      }
    }
    const give = (value) => page.locator("#measure-import").setInputFiles({ name: "x.json", mimeType: "application/json", buffer: Buffer.from(value) });
    for (const [bad, key] of [
      ["{", "documentJson"],
      ['{"kilwa":"pack","version":1}', "documentOther"],
    ]) {
      await give(bad);
      await page.waitForFunction((text) => new RegExp(text).test(document.getElementById("notice-text").textContent), pattern(here[key]).source);
    }
    await page.evaluate(() => globalThis.kilwa.pictures.open());
    await page.locator("input[name=picture-size][value=sheet]").check();
    await page.locator("#sheet-scale").fill("1");
    await page.locator("#picture-make").click();
    await page.locator("#picture-error:not([hidden])").waitFor();
    assert.match((await page.locator("#picture-error").textContent()).replaceAll(/[\u2066\u2069]/g, ""), pattern(here.sheetTooLargeFits));
    await page.locator("#picture > form button").first().click();
  }
  assert.deepEqual(complaints, []);
  await close();
});

test("what has no answer gets a sentence and no number", async () => {
  const { page, complaints, close } = await open(browser, fort(), tab);
  await tool(page, "volume");
  await done(page);
  const [volume] = await list(page);
  assert.equal(volume.state, "refused");
  assert.deepEqual(volume.readings, []);
  assert.match(await page.locator(".explain .error").innerText(), /not closed .*border edges/);
  assert.match(await page.locator("#announce").innerText(), /not closed/);
  await tool(page, "section-clip");
  await done(page, 2);
  assert.match((await list(page))[1].refusal, /not cut by a plane/);
  assert.equal(await page.locator(".mark-label").count(), 0);
  // Beside the model there is nothing to measure.
  await tool(page, "coordinate");
  await page.locator("#measure-bar").waitFor();
  await press(page, [0.02, 0.97]);
  assert.match(await page.locator("#notice").innerText(), /no surface/);
  assert.deepEqual(complaints, []);
  await close();
});

test("by keyboard alone: a distance is measured, one of its points moved, its row named, moved and deleted", async () => {
  const { page, complaints, close } = await open(browser, fort(), tab);
  await page.locator("#canvas").focus();
  await page.keyboard.press("m");
  await page.locator("#measure-bar").waitFor();
  const keys = async (...names) => {
    for (const name of names) await page.keyboard.press(name);
  };
  await keys("Space", "Shift+ArrowLeft", "Space", "Shift+ArrowRight", "Shift+ArrowRight", "ArrowDown", "Space");
  await done(page);
  await keys("Escape");
  const first = await bits(page);
  assert.equal((await list(page))[0].state, "final");
  const was = await page.evaluate(() => globalThis.kilwa.measuring.tools.items[0].task.points[0].world.join());
  await page.locator(".mark-point").first().focus();
  await keys("Enter");
  assert.match(await page.locator("#hint").innerText(), /new position/);
  await keys("ArrowUp", "ArrowUp", "Space");
  await page.waitForFunction((was) => globalThis.kilwa.measuring.tools.items[0].task.points[0].world.join() !== was, was);
  await done(page);
  assert.notDeepEqual((await bits(page))[0].local, first[0].local);
  await page.evaluate(() => globalThis.kilwa.api.addMeasurement({ tool: "coordinate", points: [[0, 0, 1]], name: "Second" }));
  await page.locator(".measure-table .go").first().focus();
  await keys("Alt+ArrowDown");
  assert.deepEqual(
    (await list(page)).map((m) => m.name),
    ["Second", "Distance 1"],
  );
  assert.equal(await page.evaluate(() => document.activeElement.textContent), "Distance 1", "the focus goes with it");
  await keys("Delete");
  assert.deepEqual(
    (await list(page)).map((m) => m.name),
    ["Second"],
  );
  assert.deepEqual(complaints, []);
  await close();
});

test("a finger that rests gets a loupe above it, and where it is lifted is measured", async () => {
  const { page, complaints, close } = await open(browser, fort(), { size: [390, 844], hasTouch: true, isMobile: true });
  await page.locator("#tool-measure").tap();
  await page.locator("#measure-bar").waitFor();
  const box = await page.locator("#canvas").boundingBox();
  const client = await page.context().newCDPSession(page);
  const touch = (type, x, y) =>
    client.send("Input.dispatchTouchEvent", { type, touchPoints: type === "touchEnd" ? [] : [{ x: box.x + box.width * x, y: box.y + box.height * y }] });
  const before = (await cameraOf(page)).join();
  await touch("touchStart", 0.45, 0.5);
  await page.locator("#loupe").waitFor();
  await touch("touchMove", 0.5, 0.52);
  await page.waitForFunction(() => {
    const { width, height } = document.getElementById("loupe-picture");
    const { data } = document.getElementById("loupe-picture").getContext("2d").getImageData(0, 0, width, height);
    return new Set(data).size > 20;
  });
  const loupe = await page.locator("#loupe").boundingBox();
  assert.ok(loupe.y + loupe.height < box.y + box.height * 0.52 - 10, "it stands above the finger");
  await touch("touchEnd");
  assert.ok(await page.locator("#loupe").isHidden());
  assert.equal((await cameraOf(page)).join(), before, "aiming turns nothing");
  await page.touchscreen.tap(box.x + box.width * 0.4, box.y + box.height * 0.5);
  await done(page);
  const [one] = await list(page);
  assert.equal(one.points.length, 2);
  assert.equal(one.state, "final");
  // A finger that moves at once turns the model, also while a tool is in use.
  await Promise.all([touch("touchStart", 0.5, 0.5), touch("touchMove", 0.6, 0.5), touch("touchMove", 0.7, 0.5)]);
  await touch("touchEnd");
  assert.notEqual((await cameraOf(page)).join(), before);
  assert.deepEqual(complaints, []);
  await close();
});

test("Shift, or the magnet, snaps to points of the finest mesh", async () => {
  const { page, complaints, close } = await open(browser, fort(), tab);
  await tool(page, "coordinate");
  await page.locator("#measure-bar").waitFor();
  await press(page, [0.42, 0.5]);
  await done(page);
  await page.keyboard.down("Shift");
  await press(page, [0.42, 0.5]);
  await page.keyboard.up("Shift");
  await done(page, 2);
  await page.locator("#measure-bar button").first().click();
  await press(page, [0.42, 0.5]);
  await done(page, 3);
  const steps = await page.evaluate(() => {
    const { tools } = globalThis.kilwa.measuring;
    const step = 2 ** globalThis.kilwa.info.pack.lattice.step_log2;
    return tools.items.map(({ task }) => task.points[0].local.map((v) => v / step));
  });
  // A vertex lies on the lattice, a point inside a triangle does not.
  assert.ok(!steps[0].every(Number.isInteger), `${steps[0]}`);
  assert.ok(steps[1].every(Number.isInteger), `${steps[1]}`);
  assert.deepEqual(steps[2], steps[1]);
  assert.deepEqual(complaints, []);
  await close();
});

test("units change what is shown and never what is kept; values are copied with unit and uncertainty", async () => {
  const { page, complaints, close } = await measured({ permissions: ["clipboard-read", "clipboard-write"] });
  const wanted = await bits(page);
  const given = await rays(page);
  for (const unit of ["cm", "mm", "km", "ft", "us-ft", "in", "m"]) {
    await page.locator("#measure select", { has: page.locator('option[value="us-ft"]') }).selectOption(unit);
    const printed = [...(await kilwa("distance", "--unit", unit, "--rays", ...given)).matchAll(/^(straight|horizontal|vertical) +(.+)$/gm)].map((m) => m[2]);
    await page.waitForFunction((text) => document.querySelector(".measure-table .facts dd").textContent === text, printed[0]);
    assert.deepEqual(await page.locator(".measure-table .facts").first().locator("dd").allInnerTexts(), printed, unit);
  }
  assert.deepEqual(await bits(page), wanted);
  await page.locator('.measure-table [data-act="copy"]').click();
  assert.match(await page.evaluate(() => navigator.clipboard.readText()), /^Distance 1\nstraight [\d.]+ ± [\d.]+ m\nhorizontal/);
  await page.locator('.measure-table [data-act="cite"]').click();
  await page.locator(".cited").waitFor();
  const identity = await page.evaluate(async () => (await globalThis.kilwa.measuring.tools.engine).pack.identity);
  const cited = await page.locator(".cited").innerText();
  assert.ok(cited.includes(identity), "the sentence names the pack");
  assert.match(cited, /Measured on \d{4}-\d\d-\d\d on the finest surface/);
  assert.deepEqual(complaints, []);
  await close();
});

test("sections and contours are lines on the model, and drawings as files", async () => {
  const { page, complaints, close } = await open(browser, fort(), tab);
  await tool(page, "section-upright");
  await page.locator("#measure-bar").waitFor();
  await press(page, [0.42, 0.5], [0.55, 0.5]);
  await done(page);
  await page.keyboard.press("Escape");
  const [section] = await list(page);
  assert.equal(section.state, "final");
  assert.ok(section.readings.find((r) => r.name === "length").value > 1);
  assert.ok((await page.evaluate(() => globalThis.kilwa.measuring.tools.items[0].task.lines.length)) > 0);
  for (const [format, says] of [
    ["svg", /^<(\?xml|svg)/],
    ["dxf", /SECTION/],
  ]) {
    const [out] = await Promise.all([page.waitForEvent("download"), page.locator(`.explain [data-act="${format}"]`).click()]);
    assert.match(await readFile(await out.path(), "utf8"), says);
  }
  await tool(page, "contours");
  await done(page, 2);
  assert.equal((await list(page))[1].state, "final");
  await page.reload();
  await waitFor(page, "settled");
  await page.waitForFunction(() => globalThis.kilwa.measuring.tools?.items.every(({ task }) => task.lines.length > 0));
  assert.deepEqual(complaints, []);
  await close();
});

test("the deviation from a fitted plane is shown as colours on the model", async () => {
  const { page, complaints, close } = await open(browser, fort(), tab);
  await tool(page, "deviation");
  await page.locator("#measure-bar").waitFor();
  await press(page, [0.42, 0.48], [0.5, 0.48], [0.48, 0.53], [0.42, 0.53]);
  await page.keyboard.press("Enter");
  await done(page);
  await page.keyboard.press("Escape");
  const [one] = await list(page);
  assert.equal(one.state, "final");
  await page.locator('.explain [data-act="map"]').click();
  const { mode, legend } = await page.evaluate(() => ({ mode: globalThis.kilwa.viewer.mode(), legend: JSON.parse(globalThis.kilwa.viewer.legend()) }));
  assert.equal(mode, "distance");
  const most = Math.max(...["lowest", "highest"].map((name) => Math.abs(one.readings.find((r) => r.name === name).value)));
  assert.ok(Math.abs(legend.high - most) < 1e-6 && Math.abs(legend.low + most) < 1e-6, JSON.stringify(legend));
  assert.deepEqual(complaints, []);
  await close();
});

test("scripts measure, list and are told", async () => {
  const { page, complaints, close } = await open(browser, fort(), tab);
  const found = await page.evaluate(async () => {
    const { api, session } = globalThis.kilwa;
    const told = [];
    api.on("measurement", (m) => told.push(m.name));
    api.on("measurements", ({ count }) => told.push(count));
    const at = (x, y) => api.pick((session.canvas.width * x) / session.ratio, (session.canvas.height * y) / session.ratio).ray;
    const one = await api.addMeasurement({ tool: "distance", rays: [at(0.42, 0.5), at(0.55, 0.5)], name: "Wall" });
    const refused = await api.addMeasurement({ tool: "volume" });
    const wrong = await api.addMeasurement({ tool: "weight" }).catch((error) => error.message);
    const all = await api.measurements();
    await api.removeMeasurement(one.id);
    return { one, refused, wrong, all: all.length, left: (await api.measurements()).length, told };
  });
  assert.equal(found.one.state, "final");
  assert.equal(found.refused.state, "refused");
  assert.match(found.wrong, /no such tool/);
  assert.deepEqual([found.all, found.left], [2, 1]);
  assert.ok(found.told.includes("Wall") && found.told.includes(2));
  assert.deepEqual(complaints, []);
  await close();
});

test("axe-core finds nothing serious in the tab, the table and the marks, in both themes", async () => {
  const axe = await readFile(path.join(path.dirname(createRequire(import.meta.url).resolve("axe-core")), "axe.min.js"), "utf8");
  for (const colorScheme of ["light", "dark"]) {
    const { page, complaints, close } = await measured({ colorScheme });
    await page.locator(".more-tools summary").click();
    await page.locator("#tool-measure").click();
    await page.evaluate(axe);
    const { violations } = await page.evaluate(() => globalThis.axe.run());
    const serious = violations
      .filter((v) => ["serious", "critical"].includes(v.impact))
      .map((v) => `${v.id}: ${v.nodes.map((n) => `${n.target} ${n.failureSummary}`).join("; ")}`);
    assert.deepEqual(serious, [], colorScheme);
    assert.deepEqual(complaints, []);
    await close();
  }
});

test("after a change of language, the menu of file formats shows the format that is saved", async () => {
  const { page, complaints, close } = await open(browser, fort());
  await page.evaluate(() =>
    globalThis.kilwa.api.addMeasurement({
      tool: "distance",
      points: [
        [0, 0, 0],
        [3, 4, 0],
      ],
    }),
  );
  await page.getByRole("tab", { name: "Measure" }).click();
  await page.getByRole("combobox", { name: "File format" }).selectOption("CSV, a table");
  for (const [language, code] of [
    ["Français", "fr"],
    ["العربية", "ar"],
    ["English", "en"],
  ]) {
    await page.getByRole("banner").getByRole("combobox").selectOption(language);
    const words = JSON.parse(await readFile(path.join(WWW, `i18n/${code}.json`), "utf8"));
    const panel = page.getByRole("tabpanel", { name: words.tabMeasure });
    const menu = panel.getByRole("combobox", { name: words.measureFormat });
    await menu.waitFor();
    assert.equal(await menu.evaluate((e) => e.selectedOptions[0].label), words.fileCsv, language);
    const [download] = await Promise.all([page.waitForEvent("download"), panel.getByRole("button", { name: words.exportFile }).click()]);
    assert.match(await readFile(await download.path(), "utf8"), /^name,tool,reading/, language);
  }
  assert.deepEqual(complaints, []);
  await close();
});
