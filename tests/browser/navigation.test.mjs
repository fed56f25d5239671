// Moves of the camera beyond drags: free turning, walking, the cube, saved views, last views, and the address.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { readFile } from "node:fs/promises";
import { promisify } from "node:util";
import { KILWA, cameraOf, canvasOf, fortSite, open, openTab, picture, spotOn, test, tool, waitFor } from "./harness.mjs";

const site = fortSite();

const fort = (query = "?error=16") => `${site.server.url}/m/fort${query}`;
/** What touches the picture is tested with both programs. */
const onBoth = (name, run) => {
  test(name, () => run(""));
  test(`${name} (WebGL 2)`, () => run("&gpu=webgl"));
};
const camera = cameraOf;
/** The tab that is open. */
const tabOf = (page, name) => page.getByRole("tabpanel", { name });
const hasFocus = (locator) => locator.evaluate((e) => e === document.activeElement);
/** The message that the page shows over the picture. */
const message = (page, text) => page.getByRole("main").getByRole("status").filter({ hasText: text });
/** The address of the current view. */
const linkOf = (page) => page.evaluate(() => globalThis.kilwa.api.link());
const close = (a, b, within = 1e-6) => a.length === b.length && a.every((v, i) => Math.abs(v - b[i]) <= within * Math.max(1, Math.abs(b[i])));
const rest = (page) => waitFor(page, "settled");

test("turned freely the camera passes over the top, and the turntable sets it upright again", async () => {
  const { page, complaints, close: end } = await open(site.browser, fort());
  await canvasOf(page).focus();
  await page.keyboard.press("t");
  for (let i = 0; i < 14; i += 1) await page.keyboard.press("ArrowDown");
  await page.keyboard.press("ArrowRight");
  await rest(page);
  const free = await camera(page);
  assert.ok(Math.abs(Math.abs(free[7]) - Math.PI) < 0.5, `the picture stands on its head: roll ${free[7]}`);
  await openTab(page, "Views");
  await page.getByRole("radio", { name: "Turntable" }).check();
  await rest(page);
  assert.equal((await camera(page))[7], 0);
  await canvasOf(page).focus();
  for (let i = 0; i < 30; i += 1) await page.keyboard.press("ArrowDown");
  assert.ok((await camera(page))[1] <= Math.PI / 2 + 1e-9, "on the turntable the pole is the end");
  assert.deepEqual(complaints, []);
  await end();
});

/** Runs in the page: where the eye of a camera is, of the page's own if none is given, and how high above the surface; null where there is none below it. */
const stand = (given) => {
  const { api } = globalThis.kilwa;
  const camera = given ?? api.getCamera();
  const { azimuth, elevation, distance, target } = camera;
  const way = [Math.cos(elevation) * Math.sin(azimuth), Math.cos(elevation) * Math.cos(azimuth), Math.sin(elevation)];
  const eye = target.map((v, i) => v + distance * way[i]);
  const ground = api.groundBelow(eye);
  return { camera, eye, above: ground === null ? null : eye[2] - ground };
};
/** Look around in the court, where the ground is level for some steps, from three metres above it. */
async function goToCourt(page) {
  await page.evaluate(() => {
    const { api } = globalThis.kilwa;
    const ground = (x, y) => api.groundBelow([x, y, 30]);
    const isLevel = (x, y) =>
      [0, 1, 2, 3, 4, 5, 6, 7].every((k) => Math.abs(ground(x + 2 * Math.cos(k * 0.8), y + 2 * Math.sin(k * 0.8)) - ground(x, y)) < 0.25);
    for (let r = 0; r < 8; r += 0.5) {
      for (let k = 0; k < 12; k += 1) {
        const [x, y] = [r * Math.cos(k), r * Math.sin(k)];
        if (isLevel(x, y)) return api.setCamera({ azimuth: 0, elevation: 0, distance: 2, target: [x, y - 2, ground(x, y) + 3], orthographic: false });
      }
    }
    throw new Error("the court is not level anywhere");
  });
  await rest(page);
}

onBoth("walking keeps the eye at its height above the ground, goes where keys and pad say, and ends as it began", async (gpu) => {
  const { page, complaints, close: end } = await open(site.browser, fort(`?error=4${gpu}`));
  await goToCourt(page);
  const pad = page.getByRole("group", { name: "Walking" });
  await canvasOf(page).focus();
  await page.keyboard.press("w");
  await rest(page);
  assert.ok(await pad.isVisible());
  assert.ok(await message(page, /W A S D/).isVisible());
  const state = () => page.evaluate(stand);
  const start = await state();
  assert.ok(Math.abs(start.above - 1.6) < 0.1, `the eye stands ${start.above} m above the ground`);
  assert.ok(start.camera.fieldOfView > 1 && !start.camera.orthographic);
  const walked = async (act) => {
    const from = await state();
    await act();
    const to = await state();
    return { from, to, length: Math.hypot(to.eye[0] - from.eye[0], to.eye[1] - from.eye[1]) };
  };
  // Held until something came of it: frames are slow here.
  const hold = (key) => async () => {
    const from = (await state()).camera;
    await page.keyboard.down(key);
    await page.waitForFunction((from) => {
      const { target } = globalThis.kilwa.api.getCamera();
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
  const padded = await walked(async () => {
    await pad.getByRole("button", { name: "Back" }).focus();
    await page.keyboard.press("Enter");
  });
  assert.ok(padded.length > 0.05, "the pad works by keyboard");
  // Lower eyes.
  await pad.getByRole("button", { name: "Lower the eye height" }).click();
  assert.match(await pad.getByRole("status").innerText(), /eye height 1\.28/);
  await canvasOf(page).focus();
  while (Math.abs((await state()).above - 1.28) >= 0.05) await page.evaluate(() => new Promise(requestAnimationFrame));
  await page.keyboard.press("Escape");
  await rest(page);
  assert.ok(await pad.isHidden());
  assert.ok(Math.abs((await camera(page))[8] - 0.7) < 1e-9, "the opening angle is the usual one again");
  assert.deepEqual(complaints, []);
  await end();
});

onBoth("a walk never falls through the ground, wherever it leads", async (gpu) => {
  const {
    page,
    complaints,
    close: end,
  } = await open(site.browser, fort(`?error=4${gpu}`), {
    // While frames are held back, the ground under the walker does not change.
    before: (page) =>
      page.addInitScript(() => {
        const { requestAnimationFrame } = globalThis;
        const held = [];
        let isHeld = false;
        globalThis.requestAnimationFrame = (callback) => (isHeld ? held.push(callback) : requestAnimationFrame(callback));
        globalThis.holdFrames = (hold) => {
          isHeld = hold;
          if (!hold) for (const callback of held.splice(0)) requestAnimationFrame(callback);
        };
      }),
  });
  await page.evaluate(() => {
    globalThis.walked = [];
    addEventListener("click", ({ target }) => target.closest("[role=group]") && globalThis.walked.push(globalThis.kilwa.api.getCamera()));
  });
  const pad = page.getByRole("group", { name: "Walking" });
  const walked = [];
  // 200 steps in a spiral each, from the edge of the scan and past it, and from the middle: over rubble, along walls.
  for (const go of [() => {}, goToCourt]) {
    await go(page);
    await tool(page, "Walk at eye height").click();
    await rest(page);
    await page.evaluate(() => globalThis.holdFrames(true));
    let steps = 0;
    for (let side = 0; steps < 200; side += 1) {
      await pad.getByRole("button", { name: ["Forward", "To the right", "Back", "To the left"][side % 4] }).focus();
      for (let i = 0; i <= 1.5 * side && steps < 200; i += 1, steps += 1) await page.keyboard.press("Enter");
    }
    for (const camera of await page.evaluate(() => globalThis.walked.splice(0))) walked.push(await page.evaluate(stand, camera));
    await page.evaluate(() => globalThis.holdFrames(false));
    await canvasOf(page).press("Escape");
  }
  // Where there is nothing below, there must be nothing close above either: the eye is beside the model, not under it.
  const heights = walked.map(({ above }) => above).filter((above) => above !== null);
  assert.ok(walked.length === 400 && heights.length > 250 && heights.length < 400, `${heights.length} of ${walked.length} steps over the model`);
  assert.ok(Math.min(...heights) > 0.5, `${Math.min(...heights)} m above the ground`);
  assert.deepEqual(complaints, []);
  await end();
});

test("the cube turns with the camera, and its faces look at the model from their side, by pointer and by keyboard", async () => {
  const { page, complaints, close: end } = await open(site.browser, fort());
  const cube = page.getByRole("group", { name: "View cube" });
  const face = (name) => cube.getByRole("button", { name });
  const turn = async () => JSON.stringify(await Promise.all(["Plan, from above", "From the north", "From the east"].map((name) => face(name).boundingBox())));
  const before = await turn();
  await canvasOf(page).focus();
  await page.keyboard.press("ArrowLeft");
  await rest(page);
  assert.notEqual(await turn(), before);
  await face("Plan, from above").focus();
  await page.keyboard.press("Enter");
  await rest(page);
  assert.ok(Math.abs((await camera(page))[1] - Math.PI / 2) < 1e-9);
  await page.keyboard.press("ArrowRight");
  assert.ok(await hasFocus(face("From the east")));
  await page.keyboard.press("Enter");
  await rest(page);
  const east = await camera(page);
  assert.ok(Math.abs(east[0] - Math.PI / 2) < 1e-9 && east[1] === 0 && east[6] === 1);
  await canvasOf(page).focus();
  await page.keyboard.press("7");
  await rest(page);
  const below = await camera(page);
  assert.ok(Math.abs(below[1] + Math.PI / 2) < 1e-9);
  assert.ok((await picture(page)).share > 0.02, "the underside is in the picture");
  // A press on the face that is seen.
  await page.keyboard.press("6");
  await rest(page);
  await face("From the south").click();
  await rest(page);
  assert.ok(Math.abs((await camera(page))[0] - Math.PI) < 1e-6);
  assert.deepEqual(complaints, []);
  await end();
});

test("the last view comes back, and the next one, by key and by button", async () => {
  const { page, complaints, close: end } = await open(site.browser, fort());
  await canvasOf(page).focus();
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
  await openTab(page, "Views");
  const forward = page.getByRole("button", { name: "Next view" });
  await forward.click();
  assert.ok(close(await camera(page), turned));
  assert.ok(await forward.isDisabled());
  assert.deepEqual(complaints, []);
  await end();
});

test("a turn in the first second of the page is remembered as well", async () => {
  // A page whose clock hardly moves is still in its first second when it is used.
  const slowClock = () => {
    const now = performance.now.bind(performance);
    performance.now = () => now() / 1000;
  };
  const { page, complaints, close: end } = await open(site.browser, fort(), { before: (page) => page.addInitScript(slowClock) });
  await canvasOf(page).focus();
  await page.keyboard.press("3");
  const east = await camera(page);
  await page.keyboard.press("ArrowLeft");
  assert.ok(!close(await camera(page), east));
  await page.keyboard.press("z");
  assert.ok(close(await camera(page), east));
  assert.deepEqual(complaints, []);
  await end();
});

test("standard views enter the browser's history: its Back button returns to the view that was left", async () => {
  const { page, complaints, close: end } = await open(site.browser, fort());
  await canvasOf(page).focus();
  await page.keyboard.press("ArrowLeft");
  await rest(page);
  const left = await camera(page);
  const entries = await page.evaluate(() => history.length);
  await page.keyboard.press("2");
  await rest(page);
  const north = await camera(page);
  assert.equal(await page.evaluate(() => history.length), entries + 1, "a jump is an entry, a drag is none");
  // The address follows the camera: the jump is in the history when it names the view from the north.
  await page.waitForURL(/#view=0,/);
  await page.goBack();
  await page.waitForFunction((n) => Math.abs(globalThis.kilwa.api.getCamera().azimuth - n) < 1e-6, left[0]);
  assert.ok(close(await camera(page), left, 1e-6));
  await page.goForward();
  await page.waitForFunction(() => globalThis.kilwa.api.getCamera().azimuth === 0);
  assert.ok(close(await camera(page), north, 1e-6));
  assert.deepEqual(complaints, []);
  await end();
});

/** Counts changes of the address, and may refuse them as browsers do. */
const countChanges = () => {
  globalThis.changes = 0;
  for (const how of ["replaceState", "pushState"]) {
    const change = globalThis.history[how];
    globalThis.history[how] = function (...args) {
      globalThis.changes += 1;
      if (globalThis.isRefusing) throw new globalThis.DOMException("too often", "SecurityError");
      return change.apply(this, args);
    };
  }
};

test("while the camera is moved the address stays, however long a frame takes, and follows when it rests", async () => {
  const { page, complaints, close } = await open(site.browser, fort("?error=16"), {
    before: async (page) => {
      await page.addInitScript(countChanges);
      // Frames that come later than the camera would need to rest.
      await page.addInitScript(() => {
        const { requestAnimationFrame: ask } = globalThis;
        globalThis.requestAnimationFrame = (draw) => (globalThis.isSlow ? setTimeout(() => ask(draw), 600) : ask(draw));
      });
    },
  });
  await page.waitForFunction(() => location.hash.startsWith("#view="));
  const address = page.url();
  await page.evaluate(() => {
    globalThis.isSlow = true;
    globalThis.changes = 0;
  });
  await page.mouse.move(...(await spotOn(page, 0.4, 0.5)));
  await page.mouse.down();
  for (let step = 1; step <= 5; step += 1) {
    const frame = page.evaluate(() => new Promise((resolve) => globalThis.kilwa.api.on("frame", resolve)).then(() => null));
    await page.mouse.move(...(await spotOn(page, 0.4 + 0.03 * step, 0.5)));
    await frame;
  }
  assert.equal(await page.evaluate(() => globalThis.changes), 0);
  assert.equal(page.url(), address);
  await page.mouse.up();
  await page.waitForFunction((address) => location.href !== address, address);
  assert.equal(await page.evaluate(() => globalThis.changes), 1);
  assert.deepEqual(complaints, []);
  await close();
});

test("the address changes less often than any browser allows, and a refusal is outlived", async () => {
  const { page, complaints, close } = await open(site.browser, fort("?error=16"), { before: (page) => page.addInitScript(countChanges) });
  await page.waitForFunction(() => location.hash.startsWith("#view="));
  await page.evaluate(() => (globalThis.isRefusing = true));
  await page.evaluate(() => globalThis.kilwa.api.view("north"));
  await waitFor(page, "settled");
  await page.evaluate(() => (globalThis.isRefusing = false));
  assert.deepEqual(complaints, [], "a refusal is no error of the page");
  // A script that jumps from view to view, much faster than a person.
  await page.evaluate(async () => {
    globalThis.changes = 0;
    for (let k = 0; k < 120; k += 1) await globalThis.kilwa.api.view(k % 2 ? "east" : "south");
  });
  const changes = await page.evaluate(() => globalThis.changes);
  assert.ok(changes > 10 && changes <= 100, `${changes} changes`);
  assert.deepEqual(complaints, []);
  await close();
});

test("the address holds camera, shading and the pack, and a link to another pack is noticed", async () => {
  const first = await open(site.browser, fort());
  await canvasOf(first.page).focus();
  await first.page.keyboard.press("3");
  await openTab(first.page, "Display");
  await first.page.getByRole("radio", { name: "Normals" }).check();
  await rest(first.page);
  const address = await linkOf(first.page);
  assert.match(address, /#view=[^&]+&display=[^&]+&pack=[0-9a-f]{12}$/);
  const seen = await picture(first.page);
  await first.close();
  const second = await open(site.browser, address);
  assert.deepEqual(await picture(second.page), seen);
  assert.equal(await second.page.evaluate(() => globalThis.kilwa.api.mode), "normals");
  assert.equal(await message(second.page, /\S/).count(), 0, "there is nothing to notice");
  await second.close();
  const third = await open(site.browser, address.replace(/pack=.*/, "pack=0123456789ab"));
  await message(third.page, "another version").waitFor();
  assert.deepEqual([...first.complaints, ...second.complaints, ...third.complaints], []);
  await third.close();
  // What is cut off or nonsense in an address is passed over.
  const broken = await open(site.browser, `${fort()}#view=1,2,nonsense&display=%7B%22mo&annotation=%E0%A4%A&notes=off&pack=zz`);
  assert.ok((await picture(broken.page)).share > 0.05);
  assert.deepEqual(broken.complaints, []);
  await broken.close();
});

test("links, views and notes name the identity that kilwa measure prints; what names the header's hash is still of this pack, and what is of another version is said", async () => {
  const { stdout } = await promisify(execFile)(KILWA, ["measure", site.pack, "area", "--json"]);
  const { identity } = JSON.parse(stdout).pack;
  const { page, complaints, close: end } = await open(site.browser, fort());
  const isNamed = (p) => p.waitForFunction((text) => globalThis.kilwa.api.state().pack === text, identity);
  await isNamed(page);
  const address = await linkOf(page);
  assert.ok(address.endsWith(`pack=${identity.slice(0, 12)}`), address);
  await openTab(page, "Views");
  await page.getByRole("button", { name: "Save this view" }).click();
  await page.keyboard.type("Gate");
  await page.keyboard.press("Enter");
  await page.evaluate(() => globalThis.kilwa.api.addAnnotation({ title: "Gate", place: [0, 0, 0] }));
  const saved = async (tab) => {
    await openTab(page, tab);
    const [download] = await Promise.all([page.waitForEvent("download"), tabOf(page, tab).getByRole("button", { name: "Save as a file" }).click()]);
    return JSON.parse(await readFile(await download.path(), "utf8"));
  };
  const views = await saved("Views");
  const notes = await saved("Notes");
  assert.equal(views.pack, identity);
  assert.deepEqual(notes.items[0].target.state, [{ type: "urn:kilwa:pack", identity }]);
  const hash = await page.evaluate(() => globalThis.kilwa.api.info().pack.hash);
  assert.notEqual(hash.slice(0, 12), identity.slice(0, 12));
  const read = async (tab, json, wanted) => {
    await openTab(page, tab);
    const file = { name: "x.json", mimeType: "application/json", buffer: Buffer.from(JSON.stringify(json)) };
    await tabOf(page, tab).getByLabel("Read a file…").setInputFiles(file);
    const words = message(page, `Read: ${(json.views ?? json.items).length}.`);
    await words.waitFor();
    assert.equal(/another version/.test(await words.innerText()), wanted, JSON.stringify(json).slice(0, 120));
  };
  // Each file has one thing more than the last, so that its message is different.
  const [view] = views.views;
  await read("Views", views, false);
  await read("Views", { ...views, views: [view, view], pack: hash }, false);
  await read("Views", { ...views, views: [view, view, view], pack: "0".repeat(32) }, true);
  const [item] = notes.items;
  await read("Notes", notes, false);
  item.target.state[0].identity = "0".repeat(32);
  await read("Notes", { ...notes, items: [item, item] }, true);
  assert.deepEqual(complaints, []);
  await end();
  // A link of an earlier version of the page names the header's hash.
  const old = await open(site.browser, address.replace(/pack=.*/, `pack=${hash.slice(0, 12)}`));
  await isNamed(old.page);
  await old.page.waitForURL((url) => url.href.endsWith(`pack=${identity.slice(0, 12)}`)); // the address names the identity from then on
  assert.equal(await message(old.page, /\S/).count(), 0, "there is nothing to notice");
  await old.close();
});

test("saved views are kept for the pack: named, renamed, ordered, deleted with undo, and written to and read from a file", async () => {
  const { page, complaints, close: end } = await open(site.browser, fort());
  await canvasOf(page).focus();
  await page.keyboard.press("2");
  await rest(page);
  await page.keyboard.press("b");
  await page.keyboard.type("<b>North</b> face");
  await page.keyboard.press("Enter");
  await canvasOf(page).focus();
  await page.keyboard.press("3");
  await rest(page);
  await page.getByRole("button", { name: "Save this view" }).click();
  await page.keyboard.press("Enter");
  const views = tabOf(page, "Views");
  const rows = views.getByRole("listitem");
  // Each row begins with its number.
  const names = async () => (await rows.getByRole("button", { name: /^\d/ }).allInnerTexts()).map((text) => text.replace(/^\d+\s*/, ""));
  const row = (name) => rows.getByRole("button", { name, exact: true });
  assert.deepEqual(await names(), ["<b>North</b> face", "View 2"], "a name is text");
  // Order, delete, undo.
  await row("Edit: View 2").click();
  await row("Move up: View 2").click();
  assert.deepEqual(await names(), ["View 2", "<b>North</b> face"]);
  await row("Delete: View 2").click();
  assert.deepEqual(await names(), ["<b>North</b> face"]);
  await message(page, "“View 2” was deleted.").getByRole("button", { name: "Undo" }).click();
  assert.deepEqual(await names(), ["View 2", "<b>North</b> face"]);
  // A file out.
  const [download] = await Promise.all([page.waitForEvent("download"), views.getByRole("button", { name: "Save as a file" }).click()]);
  const file = await download.path();
  // A reload keeps them; the file adds them once more.
  await page.reload();
  await rest(page);
  await openTab(page, "Views");
  assert.deepEqual(await names(), ["View 2", "<b>North</b> face"]);
  const readFrom = views.getByLabel("Read a file…");
  await readFrom.setInputFiles(file);
  await rows.nth(3).waitFor();
  assert.deepEqual(await names(), ["View 2", "<b>North</b> face", "View 2", "<b>North</b> face"]);
  await rows.nth(1).getByRole("button", { name: /^\d/ }).click();
  await rest(page);
  assert.equal((await camera(page))[0], 0, "a saved view is gone to");
  await readFrom.setInputFiles({ name: "x.json", mimeType: "application/json", buffer: Buffer.from('{"type":"KilwaViews","views":[{"camera":[1,2]}]}') });
  await message(page, "view 1 has no usable camera").waitFor();
  assert.deepEqual(complaints, []);
  await end();
});

test("a flight is eased where motion is welcome, and the person can take over at any time", async () => {
  const {
    page,
    complaints,
    close: end,
  } = await open(site.browser, fort(), {
    reducedMotion: "no-preference",
    // A frame is 50 ms on the page's clock, however long a busy machine takes for it.
    before: (page) =>
      page.addInitScript(() => {
        const { requestAnimationFrame } = globalThis;
        globalThis.frameMilliseconds = 50;
        let last = 0;
        let clock = 0;
        performance.now = () => clock;
        globalThis.requestAnimationFrame = (callback) =>
          requestAnimationFrame((now) => {
            if (now !== last) clock += globalThis.frameMilliseconds;
            last = now;
            callback(clock);
          });
      }),
  });
  const seen = await page.evaluate(async () => {
    const { api } = globalThis.kilwa;
    const seen = new Set();
    const stop = api.on("frame", () => seen.add(api.getCamera().azimuth.toFixed(4)));
    const arrived = await api.view("north");
    stop();
    return { arrived, views: seen.size };
  });
  // 650 ms of flight are thirteen frames.
  assert.ok(seen.arrived && seen.views > 10, JSON.stringify(seen));
  // Now they are 650 frames, so that the wheel is turned during the flight.
  await page.evaluate(() => {
    globalThis.frameMilliseconds = 1;
    globalThis.flight = globalThis.kilwa.api.view("east");
  });
  await page.waitForFunction(() => globalThis.kilwa.api.getCamera().azimuth > 0);
  await canvasOf(page).hover();
  await page.mouse.wheel(0, -10);
  assert.equal(await page.evaluate(() => globalThis.flight), false);
  assert.ok((await camera(page))[0] < Math.PI / 2, "the camera stays where the flight was interrupted");
  assert.deepEqual(complaints, []);
  await end();
});
