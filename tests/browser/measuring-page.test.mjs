// Measuring in the page: final values are those of `kilwa measure` to the last digit; everything can be undone, is kept, and is done by pointer, finger and
// keyboard. Links and files of measurements have their own tests (measuring-files.test.mjs).

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { readFile } from "node:fs/promises";
import path from "node:path";
import { promisify } from "node:util";
import { serious } from "./axe.mjs";
import { KILWA, WWW, cameraOf, canvasOf, fortSite, open, openTab, spotOn, test, waitFor, tool as railTool } from "./harness.mjs";
import {
  bar,
  bits,
  done,
  handle,
  labels,
  list,
  measureDistance,
  movePoints,
  moved,
  numbers,
  openRow,
  panel,
  pointing,
  press,
  raysAt,
  row,
  saved,
  status,
  table,
  tool,
  values,
} from "./measuring.mjs";

const site = fortSite();

const fort = (query = "?error=12") => `${site.server.url}/m/fort${query}`;
/** A page just large enough for the panel beside the picture, because the picture is drawn without a graphics card. */
const tab = { size: [960, 640] };
const kilwa = async (...args) => (await promisify(execFile)(KILWA, ["measure", site.pack, ...args.map(String)])).stdout;
/** The places of a distance: two on the wall. */
const ENDS = [
  [0.42, 0.5],
  [0.55, 0.5],
];
const measured = async (options = {}) => {
  const opened = await open(site.browser, fort(), { ...tab, ...options });
  await measureDistance(opened.page, ...ENDS);
  return opened;
};
test("a distance by two clicks is provisional, then final, and the value of kilwa measure to the last digit", async () => {
  const asked = [];
  const { page, complaints, close } = await open(site.browser, fort(), {
    ...tab,
    before: (page) => page.on("request", (request) => asked.push(new URL(request.url()).pathname)),
  });
  assert.ok(!asked.some((name) => /measure/.test(name)), `nothing of measuring is loaded before it is used: ${asked}`);
  await canvasOf(page).focus();
  await page.keyboard.press("m");
  await bar(page).waitFor();
  await status(page, "Distance: click point 1 of 2").waitFor();
  const rays = await raysAt(page, ...ENDS);
  // Answers wait, so that what is not final can be seen.
  let release;
  const held = new Promise((resolve) => (release = resolve));
  await page.route("**/packs/**", async (route) => {
    await held;
    await route.continue().catch(() => {});
  });
  await press(page, ...ENDS);
  const label = labels(page);
  await label.filter({ hasText: "refining" }).waitFor();
  const refining = await label.innerText();
  const [, about, v, spread, short] = /^(≈ ([\d.]+) m ± ([\d.]+) (mm|cm|m), )?refining$/u.exec(refining) ?? assert.fail(refining);
  release();
  await done(page);
  const [one] = await list(page);
  assert.equal(one.state, "final");
  const pointed = await pointing(page);
  assert.ok(pointed.length === 2 && pointed.every((u) => u > 0), `both points were pointed at: ${pointed}`);
  const printed = await kilwa("distance", "--pointing", pointed.join(","), "--rays", ...numbers(rays));
  const [, straight] = /^straight +(.+)$/m.exec(printed);
  const [shown] = await values(page, "Distance 1", 1);
  assert.equal(shown, straight);
  const [{ value, uncertainty }] = one.readings;
  // As uncertain as a pixel is wide on the surface, and no finer than the mesh: the accuracy of the survey is not known.
  assert.ok(uncertainty >= Math.max(...pointed) && uncertainty <= 1.5 * Math.max(...pointed), `${uncertainty} for ${pointed}`);
  const [first, second] = (await label.innerText()).split("\n");
  const mm = (uncertainty * 1000).toFixed(Math.max(0, 1 - Math.floor(Math.log10(uncertainty * 1000))));
  assert.equal(
    first,
    straight.replace(/\(± [\d.]+ m\)$/, (spread) => (uncertainty < 0.01 ? `(± ${mm} mm)` : spread)),
  );
  assert.match(first, /^\d+\.\d{1,2} m \(± /);
  assert.equal(second, "grid and pointing only; survey accuracy unknown");
  if (about) {
    // Both numbers of the label are rounded, by half a unit of their last places at most.
    const half = (digits) => 0.5 * 10 ** -(digits.split(".")[1]?.length ?? 0);
    const metres = { mm: 0.001, cm: 0.01, m: 1 }[short];
    const most = (Number(spread) + half(spread)) * metres + half(v);
    assert.ok(Math.abs(value - Number(v)) <= most, `the final value ${value} lies in the provisional interval ${refining}`);
  }
  await status(page, `Distance 1: ${first}, ${second}`).waitFor({ state: "attached" });
  // The capture accuracy of this pack is not known, and the explanation says so.
  assert.match(await (await openRow(page, "Distance 1")).innerText(), /Capture\s+unknown/);
  assert.deepEqual(complaints, []);
  await close();
});

test("the value does not depend on what is on screen", async () => {
  const { page, complaints, close } = await open(site.browser, fort(), tab);
  const rays = await raysAt(page, ...ENDS);
  await measureDistance(page, ...ENDS);
  const [wanted] = await list(page);
  assert.equal(wanted.state, "final");
  // Small pictures, one of them measured while it is still loading, so that other levels of the model are on screen.
  for (const [query, wait] of [
    ["?error=64", "settled"],
    ["?error=1", "settled"],
    ["?error=1", "first"],
    ["?error=16&gpu=webgl", "settled"],
  ]) {
    const other = await open(site.browser, fort(query), { size: [480, 400], wait });
    const again = await other.page.evaluate((rays) => globalThis.kilwa.api.addMeasurement({ tool: "distance", rays }), rays);
    // Rays of a program are exact, clicks are pointed: the values are the same, the uncertainties are not.
    const found = ({ readings }) => readings.map(({ name, value }) => ({ name, value }));
    assert.deepEqual(found(again), found(wanted));
    assert.deepEqual(again.points, wanted.points);
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
  await movePoints(page, "Distance 1");
  const box = await handle(page, 1, "Distance 1").boundingBox();
  const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
  await page.mouse.move(x, y);
  await page.mouse.down();
  await page.mouse.move(x + 20, y + 4, { steps: 4 });
  await page.mouse.up();
  await moved(page, first[0].points[0]);
  const dragged = await bits(page);
  assert.notDeepEqual(dragged[0].local.slice(0, 3), first[0].local.slice(0, 3));
  assert.deepEqual(dragged[0].local.slice(3), first[0].local.slice(3), "the other point stays");
  assert.notDeepEqual(dragged[0].readings, first[0].readings);
  await page.keyboard.press("Control+z");
  assert.deepEqual(await bits(page), first);
  await page.keyboard.press("Control+y");
  assert.deepEqual(await bits(page), dragged);
  const detail = await openRow(page, "Distance 1");
  await detail.getByLabel("Name", { exact: true }).fill("Gate, width");
  await detail.getByLabel("Note", { exact: true }).fill("Measured at noon.");
  // What is typed is kept before the field is left.
  await page.reload();
  await waitFor(page, "settled");
  await openTab(page, "Measure");
  await row(page, "Gate, width").waitFor();
  await done(page);
  const [kept] = await list(page);
  assert.equal(kept.note, "Measured at noon.");
  const [again] = await bits(page);
  assert.deepEqual(again.readings, dragged[0].readings);
  assert.deepEqual(again.local, dragged[0].local);
  assert.deepEqual(complaints, []);
  await close();
});

test("points move only while Move points is pressed, under a small target, and a drag beside one turns the model", async () => {
  const { page, complaints, close } = await measured();
  await openRow(page, "Distance 1");
  const first = await bits(page);
  const [x, y] = await spotOn(page, ...ENDS[0]);
  /** Drag by 40 pixels, from this far beside the first point; whether the camera turned. */
  const dragged = async (beside) => {
    const before = await cameraOf(page);
    await page.mouse.move(x - beside, y);
    await page.mouse.down();
    await page.mouse.move(x - beside - 40, y + 8, { steps: 4 });
    await page.mouse.up();
    const after = await cameraOf(page);
    await page.evaluate((camera) => globalThis.kilwa.api.setCamera(camera), { azimuth: before[0], elevation: before[1] });
    return after.join() !== before.join();
  };
  assert.equal(await handle(page, 1, "Distance 1").count(), 0, "a row that is open has no handles");
  for (const beside of [20, 0]) {
    assert.ok(await dragged(beside), `a drag ${beside} px beside a point turns the model`);
    assert.deepEqual(await bits(page), first);
  }
  await movePoints(page, "Distance 1");
  await status(page, "Drag a point of the measurement to move it").waitFor();
  assert.ok(await dragged(20), "a drag 20 px beside a point turns the model, also while points are moved");
  assert.deepEqual(await bits(page), first);
  assert.ok(!(await dragged(0)), "a drag on the point does not");
  await moved(page, first[0].points[0]);
  await status(page, "Point 1 of Distance 1 was moved.").getByRole("button", { name: "Undo" }).waitFor();
  await panel(page).getByRole("button", { name: "Undo: move point", exact: true }).click();
  assert.deepEqual(await bits(page), first);
  await panel(page).getByRole("button", { name: "Redo: move point", exact: true }).click();
  await moved(page, first[0].points[0]);
  // A tab takes back what happened in its own list; elsewhere it is the newest edit, and it is named.
  await openTab(page, "Notes");
  await page.evaluate(() => globalThis.kilwa.api.addAnnotation({ place: [0, 0, 1], title: "Gate" }));
  const notes = page.getByRole("tabpanel", { name: "Notes" });
  await notes.getByRole("button", { name: "Undo: add note", exact: true }).click();
  assert.ok(await notes.getByRole("button", { name: "Undo", exact: true }).isDisabled());
  await page.keyboard.press("Control+z");
  assert.equal((await list(page)).length, 1, "nothing of the notes is left to take back, and no measurement goes");
  await openTab(page, "About");
  await page.keyboard.press("Control+z");
  await status(page, "Undone: move point").waitFor();
  assert.deepEqual(await bits(page), first);
  // Esc ends it, wherever the keyboard is.
  await page.keyboard.press("Escape");
  await handle(page, 1, "Distance 1").waitFor({ state: "detached" });
  assert.deepEqual(complaints, []);
  await close();
});

test("points are taken back and put again while they are drawn, and a tool stays until it is left", async () => {
  const { page, complaints, close } = await open(site.browser, fort(), tab);
  await tool(page, "Path");
  await bar(page).waitFor();
  await press(page, [0.42, 0.5], [0.5, 0.5]);
  /** Wait until the hint names the next point: then there are `count` points, drawn with the value between them. */
  const drawn = (count) => status(page, new RegExp(`^Path: click point ${count + 1} ·`)).waitFor();
  await drawn(2);
  await page.keyboard.press("Backspace");
  await drawn(1);
  await page.keyboard.press("Enter");
  await status(page, /^\s*at least 2 points\s*$/).waitFor();
  await page.keyboard.press("Control+Shift+z");
  await drawn(2);
  await press(page, [0.56, 0.52]);
  await page.keyboard.press("Enter");
  await done(page);
  await drawn(0); // The tool goes on.
  const [path] = await list(page);
  assert.equal(path.points.length, 3);
  assert.deepEqual(
    path.readings.map((r) => r.name),
    ["straight", "horizontal", "vertical", "ends"],
  );
  await page.keyboard.press("Escape");
  await bar(page).waitFor({ state: "hidden" });
  await status(page, "Path: click").waitFor({ state: "hidden" });
  assert.deepEqual(complaints, []);
  await close();
});

test("if no meaningful value exists, the page explains why and shows no number", async () => {
  const { page, complaints, close } = await open(site.browser, fort(), tab);
  await tool(page, "Volume");
  await done(page);
  const [volume] = await list(page);
  assert.equal(volume.state, "refused");
  assert.deepEqual(volume.readings, []);
  const detail = await openRow(page, "Volume 1");
  assert.match(await detail.innerText(), /not closed .*border edges/);
  assert.equal(await detail.getByRole("definition").count(), 0);
  await status(page, /^Volume 1: .*not closed/).waitFor({ state: "attached" });
  await tool(page, "Section at the clipping plane");
  await done(page, 2);
  assert.match((await list(page))[1].refusal, /not clipped by a plane/);
  assert.equal(await labels(page).count(), 0);
  // Beside the model there is nothing to measure.
  await tool(page, "Coordinates");
  await bar(page).waitFor();
  await press(page, [0.02, 0.97]);
  await status(page, "no surface").waitFor();
  assert.deepEqual(complaints, []);
  await close();
});

test("by keyboard alone: a distance is measured, one of its points moved, its row named, moved and deleted", async () => {
  const { page, complaints, close } = await open(site.browser, fort(), tab);
  await canvasOf(page).focus();
  await page.keyboard.press("m");
  await bar(page).waitFor();
  const keys = async (...names) => {
    for (const name of names) await page.keyboard.press(name);
  };
  await keys("Space", "Shift+ArrowLeft", "Space", "Shift+ArrowRight", "Shift+ArrowRight", "ArrowDown", "Space");
  await done(page);
  await keys("Escape");
  const first = await bits(page);
  assert.equal((await list(page))[0].state, "final");
  await row(page, "Distance 1").focus();
  await keys("Tab", "Enter"); // Move points
  await handle(page, 1, "Distance 1").focus();
  await keys("Enter");
  await status(page, "new position").waitFor();
  await keys("ArrowUp", "ArrowUp", "Space");
  await moved(page, first[0].points[0]);
  assert.notDeepEqual((await bits(page))[0].local, first[0].local);
  await page.evaluate(() => globalThis.kilwa.api.addMeasurement({ tool: "coordinate", points: [[0, 0, 1]], name: "Second" }));
  await row(page, "Distance 1").focus();
  await keys("Alt+ArrowDown");
  assert.deepEqual(
    (await list(page)).map((m) => m.name),
    ["Second", "Distance 1"],
  );
  assert.ok(await row(page, "Distance 1").evaluate((button) => button === document.activeElement), "the focus goes with it");
  await keys("Delete");
  assert.deepEqual(
    (await list(page)).map((m) => m.name),
    ["Second"],
  );
  assert.deepEqual(complaints, []);
  await close();
});

test("a finger that rests gets a loupe above it, and where it is lifted is measured", async () => {
  const { page, complaints, close } = await open(site.browser, fort(), { size: [390, 844], hasTouch: true, isMobile: true });
  await railTool(page, "Measure").tap();
  await bar(page).waitFor();
  const box = await canvasOf(page).boundingBox();
  const client = await page.context().newCDPSession(page);
  const touch = (type, x, y) =>
    client.send("Input.dispatchTouchEvent", { type, touchPoints: type === "touchEnd" ? [] : [{ x: box.x + box.width * x, y: box.y + box.height * y }] });
  const before = (await cameraOf(page)).join();
  await touch("touchStart", 0.45, 0.5);
  // It is purely visual and has no role.
  const loupe = page.locator("#loupe");
  await loupe.waitFor();
  await touch("touchMove", 0.5, 0.52);
  const colours = () =>
    loupe.locator("canvas").evaluate((canvas) => new Set(canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height).data).size);
  for (let shown = 0; shown <= 20; shown = await colours());
  const glass = await loupe.boundingBox();
  assert.ok(glass.y + glass.height < box.y + box.height * 0.52 - 10, "it is above the finger");
  await touch("touchEnd");
  await loupe.waitFor({ state: "hidden" });
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
  const { page, complaints, close } = await open(site.browser, fort(), tab);
  await tool(page, "Coordinates");
  await bar(page).waitFor();
  await press(page, [0.42, 0.5]);
  await done(page);
  await page.keyboard.down("Shift");
  await press(page, [0.42, 0.5]);
  await page.keyboard.up("Shift");
  await done(page, 2);
  await bar(page).getByRole("button", { name: "Snap to" }).click();
  await press(page, [0.42, 0.5]);
  await done(page, 3);
  const step = await page.evaluate(() => 2 ** globalThis.kilwa.api.info().pack.lattice.step_log2);
  const steps = (await bits(page)).map(({ local }) => local.map((v) => v / step));
  // A vertex lies on the lattice, a point inside a triangle does not.
  assert.ok(!steps[0].every(Number.isInteger), `${steps[0]}`);
  assert.ok(steps[1].every(Number.isInteger), `${steps[1]}`);
  assert.deepEqual(steps[2], steps[1]);
  assert.deepEqual(complaints, []);
  await close();
});

test("units change what is shown and never what is kept; values are copied with unit and uncertainty", async () => {
  const { page, complaints, close } = await open(site.browser, fort(), { ...tab, permissions: ["clipboard-read", "clipboard-write"] });
  const rays = await raysAt(page, ...ENDS);
  await measureDistance(page, ...ENDS);
  const wanted = await bits(page);
  const detail = await openRow(page, "Distance 1");
  const pointed = (await pointing(page)).join(",");
  for (const unit of ["cm", "mm", "km", "ft", "us-ft", "in", "m"]) {
    await panel(page).getByLabel("Unit").selectOption(unit);
    const output = await kilwa("distance", "--unit", unit, "--pointing", pointed, "--rays", ...numbers(rays));
    const printed = [...output.matchAll(/^(straight|horizontal|vertical) +(.+)$/gm)].map((m) => m[2]);
    await detail.getByText(printed[0], { exact: true }).waitFor();
    assert.deepEqual(await values(page, "Distance 1", 3), printed, unit);
  }
  assert.deepEqual(await bits(page), wanted);
  await detail.getByRole("button", { name: "Copy the values" }).click();
  await status(page, "Values copied").waitFor();
  assert.match(await page.evaluate(() => navigator.clipboard.readText()), /^Distance 1\nstraight [\d.]+ m \(± [\d.]+ m\)\nhorizontal/);
  await detail.getByRole("button", { name: "Cite it" }).click();
  const cited = detail.getByText(/Measured on \d{4}-\d\d-\d\d on the finest surface/);
  await cited.waitFor();
  const { pack: named } = JSON.parse(await kilwa("distance", "--json", "--rays", ...numbers(rays)));
  assert.ok((await cited.innerText()).includes(named.identity), "the sentence names the pack");
  assert.deepEqual(complaints, []);
  await close();
});

/** The coordinates that a drawing shows at its cursor, by name. */
const coordinatesOf = async (drawing) => {
  const text = (await drawing.getAttribute("aria-valuetext")).replaceAll("−", "-");
  return Object.fromEntries([...text.matchAll(/(distance|[xyz]) (-?[\d.]+)/g)].map(([, name, value]) => [name, Number(value)]));
};

test("a section is drawn in its row: the cursor shows places of the model, by keys and pointer, and marks them there", async () => {
  const { page, complaints, close } = await open(site.browser, fort(), tab);
  const rays = await raysAt(page, ...ENDS);
  await page.evaluate((rays) => globalThis.kilwa.api.addMeasurement({ tool: "section-upright", rays }), rays);
  await openTab(page, "Measure");
  const detail = await openRow(page, "Section 1");
  const drawing = detail.getByRole("slider", { name: "Drawing of Section 1" });
  /** The picture of the marks, when the model is drawn in full and it is known what it hides. */
  const marks = async () => {
    await page.waitForFunction(() => globalThis.kilwa.api.stats().settled && document.getElementById("marks").dataset.settled);
    return page.locator("#marks").evaluate((canvas) => canvas.toDataURL());
  };
  const { width, height } = await drawing.boundingBox();
  await drawing.evaluate((canvas) => {
    canvas.addEventListener("pointermove", ({ clientX, clientY }) => {
      globalThis.rested = { clientX, clientY };
    });
  });
  await drawing.hover({ position: { x: width - 2, y: 2 } });
  await detail.locator(".plot-read").getByText("height").waitFor();
  assert.deepEqual(await coordinatesOf(drawing), {}, "off the lines there is no place of the model");
  const unmarked = await marks();
  await drawing.focus();
  await page.keyboard.press("ArrowRight");
  const first = await coordinatesOf(drawing);
  for (let k = 0; k < 4; k += 1) await page.keyboard.press("Shift+ArrowRight");
  const spot = await coordinatesOf(drawing);
  assert.ok(spot.distance > first.distance, `${JSON.stringify(first)} → ${JSON.stringify(spot)}`);
  const [[a, b]] = (await list(page)).map(({ points }) => points);
  const across = [b[1] - a[1], a[0] - b[0]];
  const off = ((spot.x - a[0]) * across[0] + (spot.y - a[1]) * across[1]) / Math.hypot(...across);
  assert.ok(Math.abs(off) < 0.15, `${off} m from the plane of the section, of coordinates in steps of 0.1 m`);
  assert.ok((await marks()) !== unmarked, "the place is marked on the model");
  // As Safari does when something moves beneath a pointer that rests.
  await drawing.evaluate(async (canvas) => {
    for (const name of ["pointermove", "pointerleave"]) canvas.dispatchEvent(new PointerEvent(name, { ...globalThis.rested, pointerType: "mouse" }));
    await new Promise(requestAnimationFrame);
  });
  assert.deepEqual(await coordinatesOf(drawing), spot, "the cursor stays where the keys moved it");
  await drawing.hover({ position: { x: width - 3, y: 3 } });
  await detail.locator(".plot-read").getByText("height").waitFor();
  assert.ok((await marks()) === unmarked, "it is no longer marked");
  // Keys of the browser stay its own, and those of the drawing do not turn the model.
  const camera = await cameraOf(page);
  await drawing.focus();
  assert.ok(
    await drawing.evaluate((canvas) => canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "+", ctrlKey: true, bubbles: true, cancelable: true }))),
    "Ctrl + zooms the page",
  );
  await page.keyboard.press("ArrowLeft");
  assert.deepEqual(await cameraOf(page), camera);
  // Enlarged, and back.
  await detail.getByRole("button", { name: "Enlarge the drawing" }).press("Enter");
  const large = page.getByRole("dialog", { name: "Section 1" });
  const canvas = large.getByRole("slider");
  assert.ok((await canvas.boundingBox()).height > 2 * height);
  await page.keyboard.press("ArrowRight");
  await large.getByRole("button", { name: "Zoom in" }).click();
  assert.ok(Object.keys(await coordinatesOf(canvas)).includes("z"));
  await page.keyboard.press("Control+z");
  assert.equal((await list(page)).length, 1, "undo is behind the dialog");
  assert.deepEqual(await serious(page, "the enlarged drawing", ".plot-dialog"), []);
  await page.keyboard.press("Escape");
  await large.waitFor({ state: "hidden" });
  await detail
    .locator(":focus")
    .and(page.getByRole("button", { name: "Enlarge the drawing" }))
    .waitFor();
  assert.deepEqual(await serious(page, "the drawing in its row", "#measure"), []);
  // With its row, the mark leaves the model.
  await drawing.focus();
  await page.keyboard.press("ArrowRight");
  const marked = await marks();
  await row(page, "Section 1").click();
  await drawing.waitFor({ state: "hidden" });
  assert.ok((await marks()) !== marked);
  assert.deepEqual(complaints, []);
  await close();
});

test("a drawing is saved to scale on the paper that is chosen, under the published title; paper that is too small and no scale are refused", async () => {
  const { page, complaints, close } = await open(site.browser, fort(), tab);
  const rays = await raysAt(page, ...ENDS);
  await page.evaluate((rays) => globalThis.kilwa.api.addMeasurement({ tool: "section-upright", rays }), rays);
  await openTab(page, "Measure");
  const detail = await openRow(page, "Section 1");
  const scale = detail.getByRole("textbox", { name: "Scale, 1 to" });
  const paper = detail.getByRole("combobox", { name: "Paper" });
  const [svg, dxf] = ["SVG", "DXF"].map((format) => detail.getByRole("button", { name: `Drawing, ${format}` }));
  const choose = async (value) => {
    await scale.fill(value);
    await scale.press("Enter");
  };
  await detail.getByText(/^A[34]: \d+ × \d+ mm on paper$/).waitFor();
  await choose("50");
  await paper.selectOption("A0");
  await detail.getByText("A0: 1189 × 841 mm on paper").waitFor();
  const text = await saved(page, svg);
  assert.match(text, /<svg [^>]*width="1189mm" height="841mm" viewBox="0 0 1189 841">\s*<title>fort: Section 1<\/title>/);
  const points = [...text.matchAll(/points="([^"]*)"/g)].flatMap(([, all]) => all.split(" ").map((p) => p.split(",").map(Number)));
  const [low, high] = [Math.min, Math.max].map((pick) => points.reduce((x, p) => pick(x, p[0]), points[0][0]));
  const [metres] = text.match(/>[\d.]+ m</g).map((t) => Number(t.slice(1, -3)));
  assert.ok(Math.abs(high - low - (metres * 1000) / 50) < 0.02, `${high - low} mm of paper for ${metres} m at 1:50`);
  await paper.selectOption("A4");
  await detail.getByText("larger than the paper").waitFor();
  assert.ok(await svg.isDisabled());
  assert.match(await saved(page, dxf), /SECTION/, "a DXF is in metres, whatever the paper");
  await choose("fifty");
  await detail.getByText("Enter a scale such as 1:50").waitFor();
  assert.ok((await svg.isDisabled()) && (await dxf.isDisabled()));
  await choose("500,0");
  await detail.getByText("A4: 297 × 210 mm on paper").waitFor();
  assert.equal(await scale.inputValue(), "500");
  assert.deepEqual(complaints, []);
  await close();
});

test("sections and contours are lines on the model, and drawings as files", async () => {
  const { page, complaints, close } = await open(site.browser, fort(), tab);
  await tool(page, "Vertical section");
  await bar(page).waitFor();
  await press(page, ...ENDS);
  await done(page);
  await page.keyboard.press("Escape");
  const [section] = await list(page);
  assert.equal(section.state, "final");
  assert.ok(section.readings.find((r) => r.name === "length").value > 1);
  const detail = await openRow(page, "Section 1");
  for (const [format, says] of [
    ["SVG", /^<(\?xml|svg)/],
    ["DXF", /SECTION/],
  ]) {
    assert.match(await saved(page, detail.getByRole("button", { name: `Drawing, ${format}` })), says);
  }
  await panel(page).getByText("All tools").click();
  const every = panel(page).getByRole("spinbutton", { name: "Contours every, m" });
  assert.ok(Number(await every.inputValue()) > 0, "an interval is proposed");
  await every.fill("2");
  await panel(page).getByRole("group").getByRole("button", { name: "Contours", exact: true }).click();
  await done(page, 2);
  assert.equal((await list(page))[1].state, "final");
  await page.reload();
  await waitFor(page, "settled");
  await openTab(page, "Measure");
  // There are drawings again where there are lines again.
  for (const name of ["Section 1", "Contours 1"]) {
    const again = await openRow(page, name);
    await again.getByRole("button", { name: "Drawing, SVG" }).waitFor();
    assert.match(await saved(page, again.getByRole("button", { name: "Drawing, SVG" })), /<(path|polyline|polygon|line)\b/, name);
  }
  assert.deepEqual(complaints, []);
  await close();
});

test("the deviation from a fitted plane is shown as colours on the model", async () => {
  const { page, complaints, close } = await open(site.browser, fort(), tab);
  await tool(page, "Deviation from a plane");
  await bar(page).waitFor();
  await press(page, [0.42, 0.48], [0.5, 0.48], [0.48, 0.53], [0.42, 0.53]);
  await page.keyboard.press("Enter");
  await done(page);
  await page.keyboard.press("Escape");
  const [one] = await list(page);
  assert.equal(one.state, "final");
  const detail = await openRow(page, "Deviation from a plane 1");
  await detail.getByRole("button", { name: "Show the distance as colours" }).click();
  // The tab with the legend opens.
  const display = page.getByRole("tabpanel", { name: "Display" });
  await display.waitFor();
  assert.ok(await display.getByRole("radio", { name: "Distance from a plane" }).isChecked());
  assert.equal(await page.evaluate(() => globalThis.kilwa.api.mode), "distance");
  const [low, high] = await page.evaluate(() => globalThis.kilwa.api.state().display.range);
  const most = Math.max(...["lowest", "highest"].map((name) => Math.abs(one.readings.find((r) => r.name === name).value)));
  assert.ok(Math.abs(high - most) < 1e-6 && Math.abs(low + most) < 1e-6, `${low} to ${high}`);
  for (const [name, value] of [
    ["From, m", low],
    ["To, m", high],
  ]) {
    const shown = Number(await display.getByLabel(name, { exact: true }).inputValue());
    assert.ok(Math.abs(shown - value) <= 1e-3 * Math.abs(value), `${name}: ${shown}`);
  }
  assert.deepEqual(complaints, []);
  await close();
});

test("scripts measure, list measurements and receive events", async () => {
  const { page, complaints, close } = await open(site.browser, fort(), tab);
  const rays = await raysAt(page, ...ENDS);
  const found = await page.evaluate(async (rays) => {
    const { api } = globalThis.kilwa;
    const told = [];
    api.on("measurement", (m) => told.push(m.name));
    api.on("measurements", ({ count }) => told.push(count));
    const one = await api.addMeasurement({ tool: "distance", rays, name: "Wall" });
    const refused = await api.addMeasurement({ tool: "volume" });
    const wrong = await api.addMeasurement({ tool: "weight" }).catch((error) => error.message);
    const all = await api.measurements();
    await api.removeMeasurement(one.id);
    return { one, refused, wrong, all: all.length, left: (await api.measurements()).length, told };
  }, rays);
  assert.equal(found.one.state, "final");
  assert.equal(found.refused.state, "refused");
  assert.match(found.wrong, /no such tool/);
  assert.deepEqual([found.all, found.left], [2, 1]);
  assert.ok(found.told.includes("Wall") && found.told.includes(2));
  assert.deepEqual(complaints, []);
  await close();
});

test("axe-core finds nothing serious in the tab, the table and the marks, in both themes", async () => {
  const { page, complaints, close } = await measured();
  await panel(page).getByText("All tools").click();
  await railTool(page, "Measure").click();
  await bar(page).waitFor();
  assert.ok(await table(page).isVisible());
  assert.equal(await labels(page).count(), 1);
  assert.deepEqual(await serious(page, "measuring"), []);
  assert.deepEqual(complaints, []);
  await close();
});

test("after a change of language, the menu of file formats shows the format that is saved", async () => {
  const { page, complaints, close } = await open(site.browser, fort());
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
