// The panels Display and Section in Chromium, the recovery of a lost device, and levels that fade.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import path from "node:path";
import { after, before } from "node:test";
import { cameraOf, launch, measuredPack, open, packFolder, picture, pixels, serve, test, waitFor } from "./harness.mjs";

let server;
let browser;

before(async () => {
  const folder = await packFolder();
  await measuredPack(folder);
  server = await serve(folder);
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
});

const fort = (options = {}, query = "?error=4") => open(browser, `${server.url}/m/fort${query}`, { size: [900, 600], ...options });
const state = (page) => page.evaluate(() => JSON.parse(globalThis.kilwa.viewer.displayState()));
const rest = async (page) => {
  await page.waitForTimeout(60);
  await waitFor(page, "settled");
};

test("each shading is chosen in the panel, has the controls that belong to it, and is kept by the address", async () => {
  const { page, complaints, close } = await fort();
  await page.locator("#tab-display").click();
  const seen = new Set();
  for (const mode of ["colour", "clay", "headlight", "raking", "curvature", "eye-dome", "normals", "height", "distance", "level", "error"]) {
    await page.locator(`input[name=mode][value=${mode}]`).check();
    await rest(page);
    const { hash } = await picture(page);
    // Height counts from the reference system, distance from the lowest point: the colours are the same until told otherwise.
    if (mode !== "distance") assert.ok(!seen.has(hash), `${mode} looks like another shading`);
    seen.add(hash);
    const shown = await page.locator("#look > [data-modes]").evaluateAll((all) => all.filter((e) => !e.hidden).map((e) => e.dataset.modes));
    assert.ok(
      shown.every((modes) => modes.split(" ").includes(mode)),
      `${mode}: ${shown}`,
    );
  }
  assert.equal(await page.locator("input[name=mode][value=scalar]").count(), 0, "this scan has no scalars");

  // The light: typed, dragged, by keyboard.
  await page.locator("input[name=mode][value=raking]").check();
  await page.locator("#azimuth").fill("90");
  await page.locator("#elevation").fill("10");
  assert.deepEqual((await state(page)).light, { azimuth: 90, elevation: 10 });
  await rest(page);
  const east = await picture(page);
  await page.locator("#light-disc").focus();
  await page.keyboard.press("Shift+ArrowRight");
  assert.equal((await state(page)).light.azimuth, 105);
  const disc = await page.locator("#light-disc").boundingBox();
  await page.mouse.click(disc.x + disc.width * 0.2, disc.y + disc.height / 2);
  const dragged = (await state(page)).light;
  assert.ok(Math.abs(dragged.azimuth - 270) <= 3 && dragged.elevation > 10 && dragged.elevation < 50, JSON.stringify(dragged));
  await rest(page);
  assert.notEqual((await picture(page)).hash, east.hash);

  // The scale: typed ends, and back to the whole model.
  await page.locator("input[name=mode][value=height]").check();
  await rest(page);
  const whole = await picture(page);
  await page.locator("#scale-high").fill("2");
  await rest(page);
  assert.notEqual((await picture(page)).hash, whole.hash);
  await page.locator("#scale-reset").click();
  await rest(page);
  assert.equal((await picture(page)).hash, whole.hash);

  // White is white, and the address opens the same picture.
  await page.locator("#background").selectOption("white");
  await rest(page);
  const white = await pixels(page);
  assert.deepEqual([...white.pixels.slice(0, 4)], [255, 255, 255, 255]);
  await page.evaluate(() => globalThis.kilwa.address.now());
  const url = page.url();
  const before = await picture(page);
  await page.goto("about:blank");
  await page.goto(url);
  await waitFor(page, "settled");
  assert.equal((await picture(page)).hash, before.hash, "the address opens the same picture");
  assert.deepEqual(complaints, []);
  await close();
});

test("planes and boxes cut the model, by numbers, handles and keys; picks go through what is removed", async () => {
  const { page, complaints, close } = await fort();
  const whole = await picture(page);
  await page.locator("#tab-section").click();
  await page.locator("#clip-plane").check();
  await rest(page);
  const cut = await picture(page);
  assert.notEqual(cut.hash, whole.hash);
  const height = async () => (await state(page)).clipPlane.point[2];
  await page.locator("#clip-position").fill("1.5");
  assert.equal(await height(), 1.5);

  // A handle, dragged up and by key.
  const handle = page.locator(".handle").first();
  const box = await handle.boundingBox();
  const middle = [box.x + box.width / 2, box.y + box.height / 2];
  await page.mouse.move(...middle);
  await page.mouse.down();
  await page.mouse.move(middle[0], middle[1] - 30, { steps: 3 });
  await page.mouse.up();
  const up = await height();
  assert.ok(up > 1.6, `dragged up the plane is at ${up}`);
  await handle.focus();
  await page.keyboard.press("ArrowDown");
  assert.ok((await height()) < up);
  assert.equal(await handle.getAttribute("role"), "slider");

  // Nothing that is picked lies above the plane.
  const highest = () =>
    page.evaluate(() => {
      const { viewer, session } = globalThis.kilwa;
      let most = -Infinity;
      for (let x = 0; x < session.canvas.width; x += 16) {
        for (let y = 0; y < session.canvas.height; y += 16) most = Math.max(most, viewer.pick(x, y)[2] ?? -Infinity);
      }
      return most;
    });
  await rest(page);
  const top = await highest();
  assert.ok(top <= (await height()) + 1e-6 && top > (await height()) - 2, `picked up to ${top}`);
  await page.locator("#clip-flip").click();
  assert.deepEqual((await state(page)).clipPlane.normal, [0, 0, -1]);
  await page.locator("#clip-plane").uncheck();
  await rest(page);
  assert.equal((await picture(page)).hash, whole.hash, "without a cut the model is whole again");

  await page.locator("#clip-box").check();
  await page.locator("#box-size-x").fill("12");
  assert.equal((await state(page)).clipBox.size[0], 12);
  await rest(page);
  const inside = await picture(page);
  assert.ok(inside.share < whole.share * 0.8, "only the inside of the box is left");
  await page.locator("#box-remove").check();
  await rest(page);
  assert.ok((await picture(page)).share > inside.share, "only the outside is left");
  assert.equal(await page.locator(".handle:visible").count(), 6);
  await page.locator("#tab-about").click();
  await page.locator(".handle").first().waitFor({ state: "detached" }); // handles belong to the panel
  assert.deepEqual(complaints, []);
  await close();
});

test("a plane through three places is what distances count from", async () => {
  const { page, complaints, close } = await fort();
  await page.locator("#tab-display").click();
  await page.locator("input[name=mode][value=distance]").check();
  await page.locator("#plane-axis").selectOption("points");
  const canvas = await page.locator("#canvas").boundingBox();
  for (const [x, y] of [
    [0.45, 0.5],
    [0.55, 0.5],
    [0.5, 0.58],
  ]) {
    assert.match(await page.locator("#hint").textContent(), /of three/);
    await page.mouse.click(canvas.x + canvas.width * x, canvas.y + canvas.height * y);
  }
  const { plane } = await state(page);
  assert.ok(plane && Math.abs(Math.hypot(...plane.normal) - 1) < 1e-4, JSON.stringify(plane));
  assert.equal(await page.locator("#plane-axis").inputValue(), "other");
  assert.equal(await page.evaluate(() => globalThis.kilwa.input.tool), "orbit");
  assert.deepEqual(complaints, []);
  await close();
});

test("a lost device is replaced, and camera, shading and section are as they were", async () => {
  const { page, close } = await fort({
    before: (page) =>
      page.addInitScript(() => {
        globalThis.devices = [];
        const { requestDevice } = GPUAdapter.prototype;
        GPUAdapter.prototype.requestDevice = async function (...what) {
          const device = await requestDevice.apply(this, what);
          globalThis.devices.push(device);
          return device;
        };
      }),
  });
  await page.evaluate(() => {
    const { viewer, look } = globalThis.kilwa;
    viewer.setCamera({ azimuth: 1, elevation: 0.4, distance: 40, target: [1, 2, 3], orthographic: false, roll: 0, fieldOfView: 0.7 });
    look.change({ mode: "raking", light: { azimuth: 100, elevation: 15 }, clipPlane: { normal: [0, 0, 1], point: [0, 0, 3] } });
  });
  await rest(page);
  const before = { camera: await cameraOf(page), state: await state(page), picture: await picture(page) };
  await page.evaluate(() => {
    globalThis.old = globalThis.kilwa.session;
    globalThis.devices.at(-1).destroy();
    globalThis.old.wake();
  });
  await page.waitForFunction(() => globalThis.kilwa.session !== globalThis.old, null, { polling: 50 });
  await waitFor(page, "settled");
  assert.deepEqual(await cameraOf(page), before.camera);
  assert.deepEqual(await state(page), before.state);
  assert.equal((await picture(page)).hash, before.picture.hash, "the same picture as before");
  assert.equal(await page.locator("#clip-plane").isChecked(), true);
  await close();
});

test("levels fade unless the system asks for little motion, and at rest the picture is the exact one", async () => {
  const pictures = [];
  for (const reducedMotion of ["no-preference", "reduce"]) {
    const { page, complaints, close } = await fort({ reducedMotion });
    await page.locator("#tab-display").click();
    assert.equal(await page.locator("#fade").isChecked(), reducedMotion !== "reduce");
    // A coarser picture and back: while it changes frames go on, then they stop.
    await page.evaluate(async () => {
      const { viewer, session } = globalThis.kilwa;
      const quiet = async () => {
        for (let last = -1; last !== session.frames || session.scheduled || session.stats.more; ) {
          last = session.frames;
          await new Promise((resolve) => setTimeout(resolve, 500));
        }
      };
      for (const pixels of [16, 4]) {
        viewer.setTargetPixels(pixels);
        session.wake();
        await quiet();
      }
    });
    pictures.push((await picture(page)).hash);
    assert.deepEqual(complaints, []);
    await close();
  }
  assert.equal(pictures[0], pictures[1]);
});

test("where frames are slow to come levels do not fade, unless a person asked for it", async () => {
  const { page, close } = await fort({ reducedMotion: "no-preference" });
  // Whether the first frame of a coarser picture, which needs nothing from the server, is not the last: levels fade.
  const fades = (lag) =>
    page.evaluate(async (lag) => {
      const { viewer, session } = globalThis.kilwa;
      const until = async (is) => {
        while (!is()) await new Promise((resolve) => setTimeout(resolve, 5));
      };
      const rest = () => until(() => session.stats.settled && !session.stats.more && !session.scheduled && !session.pausing);
      const frame = async () => {
        const { frames } = session;
        session.wake();
        await until(() => session.frames > frames);
      };
      await rest();
      Object.defineProperty(session, "lag", { get: () => lag, set() {}, configurable: true });
      await frame();
      viewer.setTargetPixels(16);
      await frame();
      const { more } = session.stats;
      viewer.setTargetPixels(4);
      session.wake();
      await rest();
      return more;
    }, lag);
  assert.deepEqual([await fades(10), await fades(500)], [true, false]);
  await page.evaluate(() => globalThis.kilwa.look.change({ fade: true }));
  assert.equal(await fades(500), true);
  await close();
});

test("axe-core finds nothing serious in either panel, whatever is chosen", async () => {
  const axe = await readFile(path.join(path.dirname(createRequire(import.meta.url).resolve("axe-core")), "axe.min.js"), "utf8");
  const found = [];
  for (const colorScheme of ["light", "dark"]) {
    const { page, close } = await fort({ colorScheme }, "?error=16");
    await page.evaluate(axe);
    const look = async (where) => {
      const { violations } = await page.evaluate(() => globalThis.axe.run({ include: [["#panel"], ["#handles"]] }));
      const serious = violations.filter((v) => ["serious", "critical"].includes(v.impact));
      found.push(...serious.map((v) => `${where} ${colorScheme}: ${v.id}: ${v.nodes.map((n) => `${n.target} ${n.failureSummary}`).join("; ")}`));
    };
    await page.locator("#tab-display").click();
    for (const mode of ["raking", "curvature", "distance", "error"]) {
      await page.evaluate((mode) => globalThis.kilwa.look.change({ mode }), mode);
      await look(mode);
    }
    await page.locator("#tab-section").click();
    await page.locator("#clip-plane").check();
    await page.locator("#clip-box").check();
    await look("section");
    await close();
  }
  assert.deepEqual(found, []);
});

test("values that the scan measured are shown on their scale, and grey where there are none", async () => {
  const { page, complaints, close } = await open(browser, `${server.url}/m/measured`, { size: [900, 600] });
  await page.evaluate(() => globalThis.kilwa.viewer.standardView("plan"));
  await page.locator("#tab-display").click();
  await page.locator("input[name=mode][value=scalar]").check();
  await page.evaluate(() => globalThis.kilwa.look.change({ shading: 0, background: "black" }));
  await rest(page);
  assert.deepEqual([await page.locator("#scale-low").inputValue(), await page.locator("#scale-high").inputValue()], ["10", "40"]);
  const { width, height, pixels: bytes } = await pixels(page);
  const row = Array.from({ length: width }, (_, x) => [...bytes.slice(((height >> 1) * width + x) * 4, ((height >> 1) * width + x) * 4 + 3)]).filter((c) =>
    c.some((v) => v > 0),
  );
  const near = (color, wanted) => color.every((v, i) => Math.abs(v - wanted[i]) <= 12);
  const at = (share) => row[Math.min(row.length - 1, Math.round(share * row.length))];
  // Viridis at its ends and in the middle of three quarters of the square; beyond there is nothing known.
  assert.ok(
    near(at(0.005), [68, 1, 84]) && near(at(0.375), [33, 144, 141]) && near(at(0.745), [253, 231, 37]),
    JSON.stringify([at(0.005), at(0.375), at(0.745)]),
  );
  assert.ok(near(at(0.9), [128, 126, 122]), JSON.stringify(at(0.9)));
  assert.equal(await page.locator("#channel").inputValue(), "confidence");
  assert.deepEqual(complaints, []);
  await close();
});

test("a page that gets no animation frames, as hidden ones get none, asks for nothing and draws nothing, and goes on when it is shown", async () => {
  const { page, packs, complaints, close } = await fort(
    {
      before: (page) =>
        page.addInitScript(() => {
          const real = globalThis.requestAnimationFrame.bind(globalThis);
          const held = [];
          globalThis.hold = false;
          globalThis.requestAnimationFrame = (callback) => (globalThis.hold ? held.push(callback) : real(callback));
          globalThis.show = () => {
            globalThis.hold = false;
            for (const callback of held.splice(0)) real(callback);
          };
        }),
    },
    "?error=16",
  );
  await rest(page);
  const before = packs.length;
  const frames = await page.evaluate(() => {
    globalThis.hold = true;
    globalThis.kilwa.viewer.setTargetPixels(0.5);
    globalThis.kilwa.session.wake();
    return globalThis.kilwa.session.frames;
  });
  await page.waitForTimeout(1000);
  assert.equal(await page.evaluate(() => globalThis.kilwa.session.frames), frames);
  assert.equal(packs.length, before, "nothing is asked for");
  await page.evaluate(() => globalThis.show());
  await rest(page);
  assert.ok(packs.length > before, "what is needed is asked for when the page is seen again");
  assert.deepEqual(complaints, []);
  await close();
});
