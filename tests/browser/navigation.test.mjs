// Moves of the camera beyond drags: free turning, walking, the cube, saved views, last views, and the address.

import assert from "node:assert/strict";
import { after, before } from "node:test";
import { execFile } from "node:child_process";
import { readFile } from "node:fs/promises";
import path from "node:path";
import { promisify } from "node:util";
import { KILWA, cameraOf, launch, open, packFolder, picture, serve, test, waitFor } from "./harness.mjs";

let server;
let browser;
let pack;

before(async () => {
  const folder = await packFolder();
  pack = path.join(folder, "fort.kilwa");
  server = await serve(folder);
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
});

const fort = (query = "?error=8") => `${server.url}/m/fort${query}`;
/** What touches the picture is tested with both programs. */
const onBoth = (name, run) => {
  test(name, () => run(""));
  test(`${name} (WebGL 2)`, () => run("&gpu=webgl"));
};
const camera = cameraOf;
const close = (a, b, within = 1e-6) => a.length === b.length && a.every((v, i) => Math.abs(v - b[i]) <= within * Math.max(1, Math.abs(b[i])));
const rest = async (page) => {
  await page.waitForTimeout(60);
  await waitFor(page, "settled");
};

test("turned freely the camera passes over the top, and the turntable sets it upright again", async () => {
  const { page, complaints, close: end } = await open(browser, fort());
  await page.locator("#canvas").focus();
  await page.keyboard.press("t");
  for (let i = 0; i < 14; i += 1) await page.keyboard.press("ArrowDown");
  await page.keyboard.press("ArrowRight");
  await rest(page);
  const free = await camera(page);
  assert.ok(Math.abs(Math.abs(free[7]) - Math.PI) < 0.5, `the picture stands on its head: roll ${free[7]}`);
  await page.locator("#tab-saved").click();
  await page.locator("input[name=turning][value=turntable]").check();
  await rest(page);
  assert.equal((await camera(page))[7], 0);
  await page.locator("#canvas").focus();
  for (let i = 0; i < 30; i += 1) await page.keyboard.press("ArrowDown");
  assert.ok((await camera(page))[1] <= Math.PI / 2 + 1e-9, "on the turntable the pole is the end");
  assert.deepEqual(complaints, []);
  await end();
});

onBoth("walking keeps the eye at its height above the ground, goes where keys and pad say, and ends as it began", async (gpu) => {
  const { page, complaints, close: end } = await open(browser, fort(`?error=4${gpu}`));
  // Above the court, which is level.
  const state = () =>
    page.evaluate(() => {
      const { viewer } = globalThis.kilwa;
      const eye = [...viewer.eye()];
      return { eye, above: eye[2] - viewer.groundBelow(...eye), camera: viewer.camera() };
    });
  await page.locator("#canvas").focus();
  await page.keyboard.press("w");
  await rest(page);
  assert.ok(await page.locator("#walk-pad").isVisible());
  assert.match(await page.locator("#hint").innerText(), /W A S D/);
  // Stand in the court, where the ground is level some steps around.
  await page.evaluate(() => {
    const { viewer, walk } = globalThis.kilwa;
    const ground = (x, y) => viewer.groundBelow(x, y, 30);
    const isLevel = (x, y) =>
      [0, 1, 2, 3, 4, 5, 6, 7].every((k) => Math.abs(ground(x + 2 * Math.cos(k * 0.8), y + 2 * Math.sin(k * 0.8)) - ground(x, y)) < 0.25);
    for (let r = 0; r < 8; r += 0.5) {
      for (let k = 0; k < 12; k += 1) {
        const [x, y] = [r * Math.cos(k), r * Math.sin(k)];
        if (isLevel(x, y)) return walk.stand([x, y, ground(x, y)]);
      }
    }
    throw new Error("the court is not level anywhere");
  });
  await rest(page);
  const start = await state();
  assert.ok(Math.abs(start.above - 1.6) < 0.1, `the eye stands ${start.above} m above the ground`);
  assert.ok(start.camera.fieldOfView > 1 && !start.camera.orthographic);
  const walked = async (act) => {
    const from = await state();
    await act();
    await rest(page);
    const to = await state();
    return { from, to, length: Math.hypot(to.eye[0] - from.eye[0], to.eye[1] - from.eye[1]) };
  };
  // Held until something came of it: frames are slow here.
  const hold = (key) => async () => {
    const from = (await state()).camera;
    await page.keyboard.down(key);
    await page.waitForFunction((from) => {
      const { target } = globalThis.kilwa.viewer.camera();
      return Math.hypot(target[0] - from.target[0], target[1] - from.target[1]) > 0.2;
    }, from);
    await page.keyboard.up(key);
  };
  const back = await walked(hold("s"));
  assert.ok(back.length > 0.1, `S walked ${back.length} m`);
  const facing = [-Math.sin(back.from.camera.azimuth), -Math.cos(back.from.camera.azimuth)];
  const ahead = (back.to.eye[0] - back.from.eye[0]) * facing[0] + (back.to.eye[1] - back.from.eye[1]) * facing[1];
  assert.ok(ahead < 0, "S goes back");
  assert.ok(back.to.above > 0.5 && back.to.above < 2.5, `${back.to.above} m above the ground`);
  const turned = await walked(hold("ArrowLeft"));
  assert.ok(turned.length < 1e-6 && turned.to.camera.azimuth !== turned.from.camera.azimuth, "the arrow turns on the spot");
  const pad = await walked(async () => {
    await page.locator("[data-walk=back]").focus();
    await page.keyboard.press("Enter");
  });
  assert.ok(pad.length > 0.05, "the pad works by keyboard");
  // Lower eyes.
  await page.locator("#eye-lower").click();
  await page.locator("#canvas").focus();
  await rest(page);
  assert.match(await page.locator("#eye-height").innerText(), /1\.28/);
  await page.waitForFunction(() => {
    const { viewer } = globalThis.kilwa;
    const eye = [...viewer.eye()];
    return Math.abs(eye[2] - viewer.groundBelow(...eye) - 1.28) < 0.05;
  });
  await page.keyboard.press("Escape");
  await rest(page);
  assert.ok(await page.locator("#walk-pad").isHidden());
  assert.ok(Math.abs((await camera(page))[8] - 0.7) < 1e-9, "the opening angle is the usual one again");
  assert.deepEqual(complaints, []);
  await end();
});

onBoth("a walk never falls through the ground, wherever it leads", async (gpu) => {
  const { page, complaints, close: end } = await open(browser, fort(`?error=4${gpu}`));
  await page.locator("#tool-walk").click();
  await rest(page);
  const lowest = await page.evaluate(() => {
    const { viewer } = globalThis.kilwa;
    let lowest = Infinity;
    // 400 steps in a spiral: over rubble, along walls, past the edge of the scan.
    for (let i = 0; i < 400; i += 1) {
      viewer.look(0.09, 0);
      viewer.walk(0.02 * i * 0.2, 0, 0.05, 1.6);
      const eye = [...viewer.eye()];
      const above = eye[2] - viewer.groundBelow(...eye);
      if (Number.isFinite(above)) lowest = Math.min(lowest, above);
      // Where there is nothing below, there must be nothing close above either: the eye is beside the model, not under it.
    }
    return lowest;
  });
  assert.ok(lowest > 0.5, `${lowest} m above the ground`);
  assert.deepEqual(complaints, []);
  await end();
});

test("the cube turns with the camera, and its faces look at the model from their side, by pointer and by keyboard", async () => {
  const { page, complaints, close: end } = await open(browser, fort());
  const turn = () => page.evaluate(() => document.getElementById("cube-turn").style.transform);
  const before = await turn();
  await page.locator("#canvas").focus();
  await page.keyboard.press("ArrowLeft");
  await rest(page);
  assert.notEqual(await turn(), before);
  await page.locator(".face[data-view=plan]").focus();
  await page.keyboard.press("Enter");
  await rest(page);
  assert.ok(Math.abs((await camera(page))[1] - Math.PI / 2) < 1e-9);
  await page.keyboard.press("ArrowRight");
  assert.equal(await page.evaluate(() => document.activeElement.dataset.view), "east");
  await page.keyboard.press("Enter");
  await rest(page);
  const east = await camera(page);
  assert.ok(Math.abs(east[0] - Math.PI / 2) < 1e-9 && east[1] === 0 && east[6] === 1);
  await page.locator("#canvas").focus();
  await page.keyboard.press("7");
  await rest(page);
  const below = await camera(page);
  assert.ok(Math.abs(below[1] + Math.PI / 2) < 1e-9);
  assert.ok((await picture(page)).share > 0.02, "the underside is in the picture");
  // A press on the face that is seen.
  await page.keyboard.press("6");
  await rest(page);
  await page.locator(".face[data-view=south]").click();
  await rest(page);
  assert.ok(Math.abs((await camera(page))[0] - Math.PI) < 1e-6);
  assert.deepEqual(complaints, []);
  await end();
});

test("the last view comes back, and the next one, by key and by button", async () => {
  const { page, complaints, close: end } = await open(browser, fort());
  await page.locator("#canvas").focus();
  const first = await camera(page);
  await page.keyboard.press("3");
  await rest(page);
  const east = await camera(page);
  // A row of presses is one move.
  for (let i = 0; i < 4; i += 1) await page.keyboard.press("ArrowLeft");
  await rest(page);
  const turned = await camera(page);
  await page.keyboard.press("z");
  assert.ok(close(await camera(page), east));
  await page.keyboard.press("z");
  assert.ok(close(await camera(page), first));
  await page.keyboard.press("z");
  assert.ok(close(await camera(page), first), "there is nothing before the first");
  await page.keyboard.press("Shift+Z");
  assert.ok(close(await camera(page), east));
  await page.locator("#tab-saved").click();
  await page.locator("#view-forward").click();
  assert.ok(close(await camera(page), turned));
  assert.ok(await page.locator("#view-forward").isDisabled());
  assert.deepEqual(complaints, []);
  await end();
});

test("standard views enter the browser's history: its Back button returns to the view that was left", async () => {
  const { page, complaints, close: end } = await open(browser, fort());
  await page.locator("#canvas").focus();
  await page.keyboard.press("ArrowLeft");
  await rest(page);
  const left = await camera(page);
  const entries = await page.evaluate(() => history.length);
  await page.keyboard.press("2");
  await rest(page);
  const north = await camera(page);
  assert.equal(await page.evaluate(() => history.length), entries + 1, "a jump is an entry, a drag is none");
  await page.waitForTimeout(500);
  await page.goBack();
  await page.waitForFunction((n) => Math.abs(globalThis.kilwa.viewer.camera().azimuth - n) < 1e-6, left[0]);
  assert.ok(close(await camera(page), left, 1e-6));
  await page.goForward();
  await page.waitForFunction(() => globalThis.kilwa.viewer.camera().azimuth === 0);
  assert.ok(close(await camera(page), north, 1e-6));
  assert.deepEqual(complaints, []);
  await end();
});

test("the address holds camera, shading and the pack, and a link to another pack is noticed", async () => {
  const first = await open(browser, fort());
  await first.page.locator("#canvas").focus();
  await first.page.keyboard.press("3");
  await first.page.evaluate(() => (globalThis.kilwa.api.mode = "normals"));
  await rest(first.page);
  const address = await first.page.evaluate(() => globalThis.kilwa.api.link());
  assert.match(address, /#view=[^&]+&display=[^&]+&pack=[0-9a-f]{12}$/);
  const seen = await picture(first.page);
  await first.close();
  const second = await open(browser, address);
  assert.deepEqual(await picture(second.page), seen);
  assert.equal(await second.page.evaluate(() => globalThis.kilwa.api.mode), "normals");
  assert.ok(await second.page.locator("#notice").isHidden());
  await second.close();
  const third = await open(browser, address.replace(/pack=.*/, "pack=0123456789ab"));
  await third.page.locator("#notice", { hasText: "another version" }).waitFor();
  assert.deepEqual([...first.complaints, ...second.complaints, ...third.complaints], []);
  await third.close();
  // What is cut off or nonsense in an address is passed over.
  const broken = await open(browser, `${fort()}#view=1,2,nonsense&display=%7B%22mo&annotation=%E0%A4%A&notes=off&pack=zz`);
  assert.ok((await picture(broken.page)).share > 0.05);
  assert.deepEqual(broken.complaints, []);
  await broken.close();
});

test("links, views and notes name the identity that kilwa measure prints; what names the header's hash is still of this pack, and what is of another version is said", async () => {
  const { stdout } = await promisify(execFile)(KILWA, ["measure", pack, "area", "--json"]);
  const { identity } = JSON.parse(stdout).pack;
  const { page, complaints, close: end } = await open(browser, fort());
  await page.waitForFunction(() => document.body.dataset.identity);
  const address = await page.evaluate(() => globalThis.kilwa.api.link());
  assert.ok(address.endsWith(`pack=${identity.slice(0, 12)}`), address);
  await page.locator("#tab-saved").click();
  await page.evaluate(() => globalThis.kilwa.saved.add("Gate"));
  await page.evaluate(() => globalThis.kilwa.notes.add({ title: "Gate", place: [0, 0, 0] }));
  const saved = async (what) => {
    const [download] = await Promise.all([page.waitForEvent("download"), page.evaluate((what) => globalThis.kilwa[what].export(), what)]);
    return JSON.parse(await readFile(await download.path(), "utf8"));
  };
  const views = await saved("saved");
  const notes = await saved("notes");
  assert.equal(views.pack, identity);
  assert.deepEqual(notes.items[0].target.state, [{ type: "urn:kilwa:pack", identity }]);
  const hash = await page.evaluate(() => globalThis.kilwa.info.pack.hash);
  assert.notEqual(hash.slice(0, 12), identity.slice(0, 12));
  const read = async (input, json, wanted) => {
    await page.locator(input).setInputFiles({ name: "x.json", mimeType: "application/json", buffer: Buffer.from(JSON.stringify(json)) });
    await page.locator("#notice", { hasText: "Read: 1" }).waitFor();
    assert.equal(/another version/.test(await page.locator("#notice").innerText()), wanted, JSON.stringify(json).slice(0, 120));
    await page.evaluate(() => (document.getElementById("notice").hidden = true));
  };
  const of = (pack) => ({ ...views, pack });
  await read("#saved-import", views, false);
  await read("#saved-import", of(hash), false);
  await read("#saved-import", of("0".repeat(32)), true);
  await page.locator("#tab-notes").click();
  await read("#notes-import", notes, false);
  notes.items[0].target.state[0].identity = "0".repeat(32);
  await read("#notes-import", notes, true);
  assert.deepEqual(complaints, []);
  await end();
  // A link of an earlier version of the page names the header's hash.
  const old = await open(browser, address.replace(/pack=.*/, `pack=${hash.slice(0, 12)}`));
  await old.page.waitForFunction(() => document.body.dataset.identity);
  assert.ok(await old.page.locator("#notice").isHidden());
  assert.ok(old.page.url().endsWith(`pack=${identity.slice(0, 12)}`), "the address names the identity from then on");
  await old.close();
});

test("saved views are kept for the pack: named, renamed, ordered, deleted with undo, and written to and read from a file", async () => {
  const { page, complaints, close: end } = await open(browser, fort());
  await page.locator("#canvas").focus();
  await page.keyboard.press("2");
  await rest(page);
  await page.keyboard.press("b");
  await page.keyboard.type("<b>North</b> face");
  await page.keyboard.press("Enter");
  await page.locator("#canvas").focus();
  await page.keyboard.press("3");
  await rest(page);
  await page.locator("#view-save").click();
  await page.keyboard.press("Enter");
  const names = () => page.locator("#saved-list .name").allInnerTexts();
  assert.deepEqual(await names(), ["<b>North</b> face", "View 2"]);
  assert.equal(await page.locator("#saved-list b").count(), 0, "a name is text");
  // Order, delete, undo.
  await page.locator("#saved-list li").nth(1).locator("[data-act=more]").click();
  await page.locator("#saved-list [data-act=up]").click();
  assert.deepEqual(await names(), ["View 2", "<b>North</b> face"]);
  await page.locator("#saved-list [data-act=delete]").click();
  assert.deepEqual(await names(), ["<b>North</b> face"]);
  await page.locator("#notice-action").click();
  assert.deepEqual(await names(), ["View 2", "<b>North</b> face"]);
  // A file out.
  const [download] = await Promise.all([page.waitForEvent("download"), page.locator("#saved-export").click()]);
  const file = await download.path();
  // A reload keeps them; the file adds them once more.
  await page.reload();
  await waitFor(page, "settled");
  await page.locator("#tab-saved").click();
  assert.deepEqual(await names(), ["View 2", "<b>North</b> face"]);
  await page.locator("#saved-import").setInputFiles(file);
  await page.waitForFunction(() => document.querySelectorAll("#saved-list li").length === 4);
  await page.locator("#saved-list .go").nth(1).click();
  await rest(page);
  assert.equal((await camera(page))[0], 0, "a saved view is gone to");
  await page
    .locator("#saved-import")
    .setInputFiles({ name: "x.json", mimeType: "application/json", buffer: Buffer.from('{"type":"KilwaViews","views":[{"camera":[1,2]}]}') });
  await page.locator("#notice", { hasText: "view 1 has no usable camera" }).waitFor();
  assert.deepEqual(complaints, []);
  await end();
});

test("a flight is eased where motion is welcome, and the person can take over at any time", async () => {
  const {
    page,
    complaints,
    close: end,
  } = await open(browser, fort(), {
    reducedMotion: "no-preference",
    // A frame is 50 ms on the page's clock, however long a busy machine takes for it.
    before: (page) =>
      page.addInitScript(() => {
        const { requestAnimationFrame } = globalThis;
        let last = 0;
        let clock = 0;
        performance.now = () => clock;
        globalThis.requestAnimationFrame = (callback) =>
          requestAnimationFrame((now) => {
            if (now !== last) clock += 50;
            last = now;
            callback(clock);
          });
      }),
  });
  const seen = await page.evaluate(async () => {
    const { api, viewer } = globalThis.kilwa;
    const seen = new Set();
    const stop = api.on("frame", () => seen.add(viewer.camera().azimuth.toFixed(4)));
    const arrived = await api.view("north");
    stop();
    return { arrived, views: seen.size };
  });
  // 650 ms of flight are thirteen frames.
  assert.ok(seen.arrived && seen.views > 10, JSON.stringify(seen));
  const interrupted = await page.evaluate(async () => {
    const flight = globalThis.kilwa.api.view("east");
    await new Promise((resolve) => setTimeout(resolve, 80));
    const canvas = document.getElementById("canvas");
    canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: -10, clientX: 300, clientY: 300, cancelable: true }));
    return flight;
  });
  assert.equal(interrupted, false);
  assert.deepEqual(complaints, []);
  await end();
});
