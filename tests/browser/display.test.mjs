// The panels Display and Section in Chromium, the recovery of a lost device, and levels that fade.

import assert from "node:assert/strict";
import { serious } from "./axe.mjs";
import { cameraOf, canvasOf, displayOf, fortSite, measuredPack, open, openTab, picture, pixels, press, test, tool, troubleOf, waitFor } from "./harness.mjs";

const site = fortSite({ prepare: measuredPack });

const fort = (options = {}, query = "?error=4") => open(site.browser, `${site.server.url}/m/fort${query}`, { size: [900, 600], ...options });
const rest = (page) => waitFor(page, "settled");
const shading = (page) => page.getByRole("group", { name: "Shading" });
const choose = (page, name) => shading(page).getByRole("radio", { name, exact: true }).check();
/** How coarse the picture may be: 0.5, 1, 2, 4 or 8 pixels of error. */
const detail = (page) => page.getByRole("slider", { name: "Maximum error on screen" });
/** The handles over the picture that move the clipping plane and box. */
const handles = (page) => page.getByRole("group", { name: "Clipping" }).getByRole("slider");

/** Controls, and for each the shadings that have it. */
const CONTROLS = {
  "Direction of the light": ["Raking light"],
  "Azimuth, °": ["Raking light"],
  "Elevation, °": ["Raking light"],
  "Fixed to the picture": ["Raking light"],
  "On the scan's colours": ["Headlight", "Raking light", "Ridges and hollows", "Depth edges"],
  "From, m": ["Height", "Distance from a plane"],
  "To, m": ["Height", "Distance from a plane"],
  "Full range": ["Height", "Distance from a plane"],
  "Offset, m": ["Distance from a plane"],
  "Through three points": ["Distance from a plane"],
  "Relief shading": ["Colour", "Height", "Distance from a plane"],
  Strength: ["Ridges and hollows", "Depth edges"],
  Radius: ["Depth edges"],
  "Feature size, m": ["Ridges and hollows"],
  finest: ["Surface error"],
};
const SHADINGS = [
  "Colour",
  "Clay",
  "Headlight",
  "Raking light",
  "Ridges and hollows",
  "Depth edges",
  "Normals",
  "Height",
  "Distance from a plane",
  "Level of detail",
  "Surface error",
];

test("each shading is chosen in the panel, has the controls that belong to it, and is kept by the address", async () => {
  const { page, complaints, close } = await fort({ size: [900, 420] }, "?error=8");
  await openTab(page, "Display");
  const seen = new Set();
  for (const name of SHADINGS) {
    await choose(page, name);
    await rest(page);
    const { hash } = await picture(page);
    // Height counts from the reference system, distance from the lowest point: the colours are the same until told otherwise.
    if (name !== "Distance from a plane") assert.ok(!seen.has(hash), `${name} looks like another shading`);
    seen.add(hash);
    const shown = await shading(page).ariaSnapshot();
    const found = Object.keys(CONTROLS).filter((control) => shown.includes(control));
    assert.deepEqual(
      found,
      Object.keys(CONTROLS).filter((control) => CONTROLS[control].includes(name)),
      name,
    );
  }
  assert.equal(await shading(page).getByRole("radio").count(), SHADINGS.length, "this scan has no scalars");

  // The light: typed, dragged, by keyboard.
  await choose(page, "Raking light");
  await page.getByLabel("Azimuth, °").fill("90");
  await page.getByLabel("Elevation, °").fill("10");
  assert.deepEqual((await displayOf(page)).light, { azimuth: 90, elevation: 10 });
  await rest(page);
  const east = await picture(page);
  const disc = page.getByRole("slider", { name: "Direction of the light" });
  await disc.focus();
  await page.keyboard.press("Shift+ArrowRight");
  assert.equal((await displayOf(page)).light.azimuth, 105);
  const { width, height } = await disc.boundingBox();
  await disc.click({ position: { x: width * 0.2, y: height / 2 } });
  const dragged = (await displayOf(page)).light;
  assert.ok(Math.abs(dragged.azimuth - 270) <= 3 && dragged.elevation > 10 && dragged.elevation < 50, JSON.stringify(dragged));
  await rest(page);
  assert.notEqual((await picture(page)).hash, east.hash);

  // The scale: typed ends, and back to the whole model.
  await choose(page, "Height");
  await rest(page);
  const whole = await picture(page);
  await page.getByLabel("To, m").fill("2");
  await rest(page);
  assert.notEqual((await picture(page)).hash, whole.hash);
  await page.getByRole("button", { name: "Full range" }).click();
  await rest(page);
  assert.equal((await picture(page)).hash, whole.hash);

  // White is white, and the address opens the same picture.
  await page.getByRole("combobox", { name: "Background" }).selectOption("White");
  await rest(page);
  const white = await pixels(page);
  assert.deepEqual([...white.pixels.subarray(0, 4)], [255, 255, 255, 255]);
  const url = await page.evaluate(() => globalThis.kilwa.api.link());
  const before = await picture(page);
  await page.goto("about:blank");
  await page.goto(url);
  await rest(page);
  assert.equal((await picture(page)).hash, before.hash, "the address opens the same picture");
  assert.deepEqual(complaints, []);
  await close();
});

test("planes and boxes cut the model, by numbers, handles and keys; picks go through what is removed", async () => {
  const { page, complaints, close } = await fort();
  const whole = await picture(page);
  await openTab(page, "Clipping");
  const panel = page.getByRole("tabpanel", { name: "Clipping" });
  const cutsByPlane = panel.getByRole("group", { name: "Plane" }).getByLabel("Clip here");
  await cutsByPlane.check();
  await rest(page);
  const cut = await picture(page);
  assert.notEqual(cut.hash, whole.hash);
  const height = async () => (await displayOf(page)).clipPlane.point[2];
  await panel.getByLabel("Position z, m").fill("1.5");
  assert.equal(await height(), 1.5);

  // A handle, dragged up and by key.
  const handle = handles(page);
  assert.equal(await handle.getAttribute("aria-label"), "Move the plane");
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

  // Nothing that is picked lies above the plane.
  const { width, height: tall } = await canvasOf(page).boundingBox();
  const highest = () =>
    page.evaluate(
      ([width, height]) => {
        const { api } = globalThis.kilwa;
        let highest = -Infinity;
        for (let x = 0; x < width; x += 16) {
          for (let y = 0; y < height; y += 16) highest = Math.max(highest, api.pick(x, y)?.place[2] ?? -Infinity);
        }
        return highest;
      },
      [width, tall],
    );
  await rest(page);
  const top = await highest();
  assert.ok(top <= (await height()) + 1e-6 && top > (await height()) - 2, `picked up to ${top}`);
  await panel.getByRole("button", { name: "Other side" }).click();
  assert.deepEqual((await displayOf(page)).clipPlane.normal, [0, 0, -1]);
  await cutsByPlane.uncheck();
  await rest(page);
  assert.equal((await picture(page)).hash, whole.hash, "without a cut the model is whole again");

  await panel.getByRole("group", { name: "Box" }).getByLabel("Clip here").check();
  await panel.getByLabel("Size x, m").fill("12");
  assert.equal((await displayOf(page)).clipBox.size[0], 12);
  await rest(page);
  const inside = await picture(page);
  assert.ok(inside.share < whole.share * 0.8, "only the inside of the box is left");
  await panel.getByLabel("Remove the inside").check();
  await rest(page);
  assert.ok((await picture(page)).share > inside.share, "only the outside is left");
  assert.equal(await handles(page).count(), 6);
  await openTab(page, "About");
  await handles(page).first().waitFor({ state: "detached" }); // handles belong to the panel
  assert.deepEqual(complaints, []);
  await close();
});

test("a plane through three places is what distances count from", async () => {
  const { page, complaints, close } = await fort();
  await openTab(page, "Display");
  await choose(page, "Distance from a plane");
  const plane = page.getByRole("combobox", { name: "Plane" });
  await plane.selectOption("Through three points…");
  for (const [i, [x, y]] of [
    [0.45, 0.5],
    [0.55, 0.5],
    [0.5, 0.58],
  ].entries()) {
    await page
      .getByRole("status")
      .filter({ hasText: `Choose point ${i + 1} of three` })
      .waitFor();
    await press(page, x, y);
  }
  const { plane: found } = await displayOf(page);
  assert.ok(found && Math.abs(Math.hypot(...found.normal) - 1) < 1e-4, JSON.stringify(found));
  assert.equal(await plane.evaluate((e) => e.selectedOptions[0].label), "Inclined");
  assert.equal(await tool(page, "Drag turns the model").getAttribute("aria-pressed"), "true");
  assert.deepEqual(complaints, []);
  await close();
});

/** In the page: keep the devices that it gets, the newest last. */
function keepDevices() {
  globalThis.devices = [];
  const { requestDevice } = GPUAdapter.prototype;
  GPUAdapter.prototype.requestDevice = async function (...what) {
    const device = await requestDevice.apply(this, what);
    globalThis.devices.push(device);
    return device;
  };
}

test("a lost device is replaced, and camera, shading and section are as they were", async () => {
  const { page, close } = await fort({
    before: (page) => page.addInitScript(keepDevices),
  });
  await page.evaluate(() => {
    const display = { mode: "raking", light: { azimuth: 100, elevation: 15 }, clipPlane: { normal: [0, 0, 1], point: [0, 0, 3] } };
    globalThis.kilwa.api.setState({ camera: [1, 0.4, 40, 1, 2, 3, 0, 0, 0.7], display });
  });
  await rest(page);
  const before = { camera: await cameraOf(page), state: await displayOf(page), picture: await picture(page) };
  assert.deepEqual(before.camera, [1, 0.4, 40, 1, 2, 3, 0, 0, 0.7]);
  const made = await page.evaluate(() => {
    globalThis.devices.at(-1).destroy();
    return globalThis.devices.length;
  });
  await page.getByRole("status").filter({ hasText: "The graphics device was reset." }).waitFor();
  await page.waitForFunction((made) => globalThis.devices.length > made, made);
  await rest(page);
  assert.deepEqual(await cameraOf(page), before.camera);
  assert.deepEqual(await displayOf(page), before.state);
  assert.equal((await picture(page)).hash, before.picture.hash, "the same picture as before");
  await openTab(page, "Clipping");
  assert.equal(await page.getByRole("tabpanel", { name: "Clipping" }).getByRole("group", { name: "Plane" }).getByLabel("Clip here").isChecked(), true);
  await close();
});

test("a device that keeps being lost ends in words with a way to try again, which keeps the view", async () => {
  for (const gpu of ["webgpu", "webgl"]) {
    const { page, close } = await fort({ before: (page) => page.addInitScript(keepDevices) }, `?error=8&gpu=${gpu}`);
    await page.evaluate(() => globalThis.kilwa.api.setState({ camera: [1, 0.4, 40, 1, 2, 3, 0, 0, 0.7] }));
    await rest(page);
    for (let times = 1; times <= 4; times += 1) {
      const made = await page.evaluate(() => globalThis.devices.length);
      if (gpu === "webgpu") {
        await page.evaluate(() => globalThis.devices.at(-1).destroy());
        if (times < 4) await page.waitForFunction((made) => globalThis.devices.length > made, made);
      } else {
        const context = await canvasOf(page).evaluateHandle((canvas) => canvas.getContext("webgl2").getExtension("WEBGL_lose_context"));
        await context.evaluate((context) => context.loseContext());
        await page.waitForFunction(() => !globalThis.kilwa.api.stats());
        if (times < 4) await context.evaluate((context) => context.restoreContext());
      }
      if (times < 4) await rest(page);
    }
    const trouble = troubleOf(page);
    await trouble.getByRole("heading", { name: "The graphics device keeps failing" }).waitFor();
    const isSeen = () => [...document.querySelectorAll("canvas")].some((canvas) => canvas.checkVisibility({ checkOpacity: true }) && canvas.width > 0);
    assert.equal(await page.evaluate(isSeen), false, "no black picture is left");
    await trouble.getByRole("button", { name: "Try again" }).click();
    await rest(page);
    assert.deepEqual((await cameraOf(page)).slice(0, 6), [1, 0.4, 40, 1, 2, 3]);
    await close();
  }
});

test("levels fade unless the system asks for little motion, and at rest the picture is the exact one", async () => {
  const pictures = [];
  for (const reducedMotion of ["no-preference", "reduce"]) {
    const { page, complaints, close } = await fort({ reducedMotion });
    await openTab(page, "Display");
    assert.equal(await page.getByLabel("Fade in detail").isChecked(), reducedMotion !== "reduce");
    // A coarser picture and back: while it changes frames go on, then they stop.
    for (const key of ["End", "ArrowLeft"]) {
      await detail(page).press(key);
      await rest(page);
    }
    pictures.push((await picture(page)).hash);
    assert.deepEqual(complaints, []);
    await close();
  }
  assert.equal(pictures[0], pictures[1]);
});

test("where frames are slow to come levels do not fade, unless a person asked for it", async () => {
  const { page, close } = await fort({
    reducedMotion: "no-preference",
    // A frame takes this long by the page's clock, however long it takes on this machine.
    before: (page) =>
      page.addInitScript(() => {
        const { requestAnimationFrame } = globalThis;
        globalThis.frameMilliseconds = 50;
        let clock = 0;
        performance.now = () => clock;
        globalThis.requestAnimationFrame = (callback) =>
          requestAnimationFrame(() => {
            clock += globalThis.frameMilliseconds;
            callback(clock);
          });
      }),
  });
  await page.evaluate(() => globalThis.kilwa.api.on("frame", ({ settled }) => globalThis.drawn?.push(settled)));
  await openTab(page, "Display");
  // Whether the first frame of a coarser picture, which needs nothing from the server, is not the last: levels fade.
  const fades = async (milliseconds) => {
    await page.evaluate((milliseconds) => {
      globalThis.frameMilliseconds = milliseconds;
      globalThis.drawn = [];
    }, milliseconds);
    await detail(page).press("End");
    await page.waitForFunction(() => globalThis.drawn.length > 0);
    const [isLast] = await page.evaluate(() => globalThis.drawn);
    await rest(page);
    await detail(page).press("ArrowLeft");
    await rest(page);
    return !isLast;
  };
  assert.deepEqual([await fades(50), await fades(500)], [true, false]);
  // The system has already chosen it; after unchecking and checking it, it is the person's own choice.
  await page.getByLabel("Fade in detail").uncheck();
  await page.getByLabel("Fade in detail").check();
  await rest(page);
  assert.equal(await fades(500), true);
  await close();
});

test("axe-core finds nothing serious in either panel, whatever is chosen", async () => {
  const { page, close } = await fort({}, "?error=16");
  const found = [];
  const look = async (where) => {
    // The panel's contents and what it puts over the picture, in both themes.
    const include = [["[role=tabpanel]:not([hidden])"], ["[role=tablist]"], ["[role=group][aria-label=Section]"]];
    found.push(...(await serious(page, where, include)));
  };
  await openTab(page, "Display");
  for (const name of ["Raking light", "Ridges and hollows", "Distance from a plane", "Surface error"]) {
    await choose(page, name);
    await look(name);
  }
  await openTab(page, "Clipping");
  for (const what of ["Plane", "Box"])
    await page.getByRole("tabpanel", { name: "Clipping" }).getByRole("group", { name: what }).getByLabel("Clip here").check();
  await handles(page).nth(6).waitFor();
  await look("Clipping");
  assert.deepEqual(found, []);
  await close();
});

test("values that the scan measured are shown on their scale, and grey where there are none", async () => {
  const { page, complaints, close } = await open(site.browser, `${site.server.url}/m/measured`, { size: [900, 600] });
  await canvasOf(page).press("1");
  await openTab(page, "Display");
  await choose(page, "Measured value");
  await page.getByRole("slider", { name: "Relief shading" }).fill("0");
  await page.getByRole("combobox", { name: "Background" }).selectOption("Black");
  await rest(page);
  const ends = shading(page).getByRole("spinbutton", { name: /^(From|To)/ });
  assert.deepEqual([await ends.first().inputValue(), await ends.last().inputValue()], ["10", "40"]);
  const { width, height, pixels: bytes } = await pixels(page);
  const row = Array.from({ length: width }, (_, x) => [...bytes.subarray(((height >> 1) * width + x) * 4, ((height >> 1) * width + x) * 4 + 3)]).filter((c) =>
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
  assert.equal(await page.getByRole("combobox", { name: "Value" }).inputValue(), "confidence");
  assert.deepEqual(complaints, []);
  await close();
});

test("a page that gets no animation frames, as hidden ones get none, asks for nothing and draws nothing, and goes on when it is shown", async () => {
  const { page, packs, complaints, close } = await fort(
    {
      before: async (page) => {
        await page.clock.install();
        await page.addInitScript(() => {
          const real = globalThis.requestAnimationFrame.bind(globalThis);
          const held = [];
          globalThis.hold = false;
          globalThis.requestAnimationFrame = (callback) => (globalThis.hold ? held.push(callback) : real(callback));
          globalThis.show = () => {
            globalThis.hold = false;
            for (const callback of held.splice(0)) real(callback);
          };
        });
      },
    },
    "?error=16",
  );
  await openTab(page, "Display");
  await rest(page);
  const before = packs.length;
  const frames = () => page.evaluate(() => globalThis.kilwa.api.stats().frames);
  const drawn = await frames();
  await page.evaluate(() => (globalThis.hold = true));
  await detail(page).press("Home");
  await page.clock.runFor(10_000); // by the page's clock: everything that it does later happens at once
  assert.equal(await frames(), drawn);
  assert.equal(packs.length, before, "nothing is asked for");
  await page.evaluate(() => globalThis.show());
  await rest(page);
  assert.ok(packs.length > before, "what is needed is asked for when the page is seen again");
  assert.deepEqual(complaints, []);
  await close();
});
