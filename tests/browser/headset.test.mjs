// Standing in the model with a headset, which the emulator iwer simulates: what each eye sees, at 1:1; walking, turning, jumping; measuring with a controller; and
// how it begins and ends.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import path from "node:path";
import { serious } from "./axe.mjs";
import { Hands } from "../../www/headset/hands.js";
import { Rig } from "../../www/headset/rig.js";
import { SHARP, decoded, fortSite, open, pixels, ROOT, stats, test } from "./harness.mjs";

const SHOTS = process.env.KILWA_SHOTS;
const EMULATOR = await readFile(path.join(ROOT, "tests/browser/node_modules/iwer/build/iwer.min.js"), "utf8");
/** Of the page, which the emulator's picture fills: each eye has half of it. */
const [WIDTH, HEIGHT] = [320, 200];
/** Of the emulator, metres: the eyes above the floor, and between them. */
const [EYES, APART] = [1.6, 0.063];
/** Straight down; and slanting down, by 45 degrees. */
const [DOWN, SLANT] = [
  [-Math.SQRT1_2, 0, 0, Math.SQRT1_2],
  [-Math.sin(Math.PI / 8), 0, 0, Math.cos(Math.PI / 8)],
];

const site = fortSite();

/** A page in a browser with an emulated headset. `prepare` runs in it before its own scripts: a function and its argument. */
async function withHeadset({ query = "", prepare = [() => {}] } = {}) {
  const all = await open(site.browser, `${site.server.url}/m/fort?error=8${query}`, {
    ...SHARP,
    size: [WIDTH, HEIGHT],
    before: async (page) => {
      await page.addInitScript({ content: EMULATOR });
      await page.addInitScript(() => {
        const { IWER } = globalThis;
        const device = new IWER.XRDevice(IWER.metaQuest3, { stereoEnabled: true, visibilityMask: null });
        device.installRuntime({ forceInstall: true });
        globalThis.device = device;
        /** What happens in the next frame of the headset. */
        globalThis.headsetFrame = () => new Promise((resolve) => device.activeSession.requestAnimationFrame(resolve));
      });
      await page.addInitScript(...prepare);
    },
  });
  return all;
}

const button = (page, name = "View in VR") => page.getByRole("button", { name, exact: true });
const notice = (page, text) => page.getByRole("main").getByRole("status").filter({ hasText: text });

/** Frames of the headset. */
const frames = (page, count = 2) =>
  page.evaluate(async (count) => {
    for (let k = 0; k < count; k += 1) await globalThis.headsetFrame();
  }, count);

/** The picture of the headset: both eyes. */
const seen = async (page) => decoded(await page.screenshot({ caret: "initial" }));

/** Until all that the picture needs of the model is there, and drawn. */
async function whole(page) {
  await frames(page);
  await page.locator('#headset[data-picture="whole"]').waitFor({ state: "attached" });
  await frames(page);
}

/** The share of pixels that differ by more than `most` in a channel. */
function differing(a, b, most) {
  let count = 0;
  for (let k = 0; k < a.pixels.length; k += 4) if ([0, 1, 2].some((c) => Math.abs(a.pixels[k + c] - b.pixels[k + c]) > most)) count += 1;
  return count / (a.pixels.length / 4);
}

/** Part of a picture. */
function part({ width, pixels: all }, [left, top, wide, tall]) {
  const out = Buffer.alloc(wide * tall * 4);
  for (let y = 0; y < tall; y += 1) all.copy(out, y * wide * 4, ((top + y) * width + left) * 4, ((top + y) * width + left + wide) * 4);
  return { width: wide, height: tall, pixels: out };
}

/** Of two places in plan. */
const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

/** Put on the headset in the middle of the courtyard, looking north. */
async function enter(page) {
  await page.evaluate(() => {
    const { api } = globalThis.kilwa;
    const { bounds_min: low, bounds_max: high } = api.info().metadata;
    const [x, y] = [(low[0] + high[0]) / 2, (low[1] + high[1]) / 2];
    const target = [x, y + 1, api.groundBelow([x, y, high[2]]) + 1.6];
    return api.setCamera({ azimuth: Math.PI, elevation: 0, distance: 1, target, orthographic: false, roll: 0 });
  });
  await button(page).click();
  await button(page, "Exit VR").waitFor({ state: "attached" });
  await page.waitForFunction(() => globalThis.device.activeSession);
  await frames(page);
}

/** Hold a controller. */
const hold = (page, hand, place, turn) =>
  page.evaluate(
    ([hand, place, turn]) => {
      const { position, quaternion } = globalThis.device.controllers[hand];
      position.set(...place);
      quaternion.set(...turn);
    },
    [hand, place, turn],
  );

/** Press a button of a controller for a frame. */
const press = (page, hand, name) =>
  page.evaluate(
    async ([hand, name]) => {
      for (const value of [1, 0]) {
        globalThis.device.controllers[hand].updateButtonValue(name, value);
        await globalThis.headsetFrame();
      }
    },
    [hand, name],
  );

const push = (page, hand, x, y) =>
  page.evaluate(
    async ([hand, x, y]) => {
      globalThis.device.controllers[hand].updateAxes("thumbstick", x, y);
      await globalThis.headsetFrame();
    },
    [hand, x, y],
  );

/** Neither controllers nor the help over the picture. */
const putDown = (page) =>
  page.evaluate(async () => {
    for (const hand of ["left", "right"]) globalThis.device.controllers[hand].connected = false;
    await globalThis.headsetFrame();
  });

const measurements = (page) => page.evaluate(() => globalThis.kilwa.api.measurements());

/** Measure between two places with the right controller, pointing from there in these directions; the measurement when it is final. */
async function measure(page, from, to, turns = [DOWN, DOWN]) {
  const before = (await measurements(page)).length;
  for (const [k, place] of [from, to].entries()) {
    await hold(page, "right", place, turns[k]);
    await press(page, "right", "trigger");
  }
  await page.evaluate(async (before) => {
    for (;;) {
      const all = await globalThis.kilwa.api.measurements();
      if (all.length > before && !["picking", "measuring"].includes(all.at(-1).state)) return;
      await globalThis.headsetFrame();
    }
  }, before);
  const one = (await measurements(page)).at(-1);
  assert.equal(one.state, "final");
  return one;
}

/** Where the headset's space lies in the model, from a measurement between two places on its floor: how far it is turned, and its middle. */
async function spaceOf(page) {
  const [a, b] = [
    [0.3, 1, -0.4],
    [-0.3, 1, -0.9],
  ];
  const { points } = await measure(page, a, b);
  const turned = Math.atan2(points[1][1] - points[0][1], points[1][0] - points[0][0]) - Math.atan2(-(b[2] - a[2]), b[0] - a[0]);
  const turn = Math.atan2(Math.sin(turned), Math.cos(turned));
  const level = ([x, , z]) => [Math.cos(turn) * x + Math.sin(turn) * z, Math.sin(turn) * x - Math.cos(turn) * z];
  const middle = level(a).map((v, k) => points[0][k] - v);
  return { turn, middle, points, at: (place) => level(place).map((v, k) => v + middle[k]) };
}

/**
 * The tangents of the edges of the left eye's picture, for pixels that are as wide as high, and the picture that contains it and is symmetric: its size, and where
 * the eye's is in it. Those of the right eye are mirrored.
 */
const EDGES = { left: -1.25, right: 0.75, down: -1, up: 1.5 };
const [FULL_WIDTH, FULL_HEIGHT] = [200, 240];

/** Runs in the page: the emulator's eyes get these edges, as those of real headsets are not symmetric either. */
const asymmetric = ({ left, right, down, up }) => {
  const { XRView } = globalThis;
  const plain = Object.getOwnPropertyDescriptor(XRView.prototype, "projectionMatrix").get;
  Object.defineProperty(XRView.prototype, "projectionMatrix", {
    get() {
      const p = Float32Array.from(plain.call(this));
      const [l, r] = this.eye === "left" ? [left, right] : [-right, -left];
      Object.assign(p, { 0: 2 / (r - l), 5: 2 / (up - down), 8: (r + l) / (r - l), 9: (up + down) / (up - down) });
      return p;
    },
  });
};

/** The page's own picture from a place of the model, level, as wide as both eyes together. */
async function reference(page, eye, turn) {
  const azimuth = Math.PI - turn;
  const target = [eye[0] - Math.sin(azimuth), eye[1] - Math.cos(azimuth), eye[2]];
  const camera = { azimuth, elevation: 0, distance: 1, target, orthographic: false, roll: 0, fieldOfView: 2 * Math.atan(EDGES.up) };
  const all = await page.evaluate(
    async ([camera, width, height]) => {
      const { api } = globalThis.kilwa;
      await api.setCamera(camera);
      const picture = await createImageBitmap(await api.picture({ width, height, scaleBar: false }));
      const context = new OffscreenCanvas(width, height).getContext("2d");
      context.drawImage(picture, 0, 0);
      return [...context.getImageData(0, 0, width, height).data];
    },
    [camera, FULL_WIDTH, FULL_HEIGHT],
  );
  return { width: FULL_WIDTH, height: FULL_HEIGHT, pixels: Buffer.from(all) };
}

/** Runs in the page: from now on the headset has a framebuffer of its own, as real ones have. */
const ownFramebuffer = ([width, height]) => {
  const { XRWebGLLayer } = globalThis;
  const made = new WeakMap();
  const framebuffer = (layer) => {
    const gl = layer.context;
    if (!made.has(layer)) {
      const [framebuffer, color] = [gl.createFramebuffer(), gl.createRenderbuffer()];
      gl.bindRenderbuffer(gl.RENDERBUFFER, color);
      gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, width, height);
      gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, color);
      gl.bindFramebuffer(gl.FRAMEBUFFER, null);
      made.set(layer, framebuffer);
    }
    return made.get(layer);
  };
  Object.defineProperties(XRWebGLLayer.prototype, {
    framebuffer: { get: () => framebuffer(globalThis.headsetLayer) },
    framebufferWidth: { get: () => width },
    framebufferHeight: { get: () => height },
  });
  XRWebGLLayer.prototype.getViewport = function (view) {
    globalThis.headsetLayer = this;
    return { x: view.eye === "left" ? 0 : width / 2, y: 0, width: width / 2, height };
  };
  /** Rows from the bottom, as WebGL has them. */
  globalThis.headsetPixels = () => {
    const gl = globalThis.headsetLayer.context;
    const pixels = new Uint8Array(4 * width * height);
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer(globalThis.headsetLayer));
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    return [...pixels];
  };
};

/** The picture in the headset's own framebuffer. */
async function framed(page) {
  const upward = Buffer.from(await page.evaluate(() => globalThis.headsetPixels()));
  const rows = Array.from({ length: HEIGHT }, (_, y) => upward.subarray((HEIGHT - 1 - y) * WIDTH * 4, (HEIGHT - y) * WIDTH * 4));
  return { width: WIDTH, height: HEIGHT, pixels: Buffer.concat(rows) };
}

test("the button is there only where there is a headset, with its name in the language of the page", async () => {
  const plain = await open(site.browser, `${site.server.url}/m/fort?error=8`, { ...SHARP, size: [WIDTH, HEIGHT] });
  assert.equal(await button(plain.page).count(), 0);
  await plain.close();
  const { page, complaints, close } = await withHeadset({ query: "&lang=ar" });
  await button(page, "العرض بالواقع الافتراضي").waitFor();
  await page.locator("#language").selectOption("fr");
  await button(page, "Voir en réalité virtuelle").waitFor();
  assert.deepEqual(await serious(page), []);
  assert.deepEqual(complaints, []);
  await close();
});

test("each eye sees the model from where it is, at 1:1, with the floor on the ground; then the page is as it was", async () => {
  const { page, complaints, close } = await withHeadset({ prepare: [asymmetric, EDGES] });
  await page.evaluate(() => globalThis.kilwa.api.setState({ display: { background: "#ff00ff" } }));
  await page.waitForFunction(() => globalThis.kilwa.api.stats().settled);
  const [before, canvases] = [await pixels(page), await page.locator("canvas").count()];
  await enter(page);
  if (SHOTS) await page.screenshot({ path: path.join(SHOTS, "headset-help.png") });
  const space = await spaceOf(page);
  // Places that are 0.6 m and 0.5 m apart in the room are so in the model.
  const [across, along] = [0, 1].map((k) => space.points[1][k] - space.points[0][k]);
  assert.ok(Math.abs(Math.hypot(across, along) - Math.hypot(0.6, 0.5)) < 0.002, `${Math.hypot(across, along)} m`);
  if (SHOTS) await page.screenshot({ path: path.join(SHOTS, "headset-measured.png") });
  await page.evaluate(async () => {
    const { api } = globalThis.kilwa;
    for (const { id } of await api.measurements()) await api.removeMeasurement(id);
  });
  await press(page, "left", "x-button");
  await putDown(page);
  await whole(page);
  const both = await seen(page);
  if (SHOTS) await page.screenshot({ path: path.join(SHOTS, "headset-eyes.png") });
  const eyes = [0, 1].map((k) => part(both, [(k * WIDTH) / 2, 0, WIDTH / 2, HEIGHT]));
  assert.ok(differing(...eyes, 8) > 0.05, "the eyes see different pictures");
  await page.evaluate(() => globalThis.device.activeSession.end());
  await button(page).waitFor();

  // A headset with a framebuffer of its own gets the same picture; the canvas then has room for one eye only.
  await page.evaluate(ownFramebuffer, [WIDTH, HEIGHT]);
  await page.evaluate(() => Object.assign(globalThis.device.controllers.left, { connected: true }));
  await enter(page);
  await press(page, "left", "x-button");
  await putDown(page);
  await whole(page);
  const canvas = page.locator("[data-webxr_runtime] canvas");
  assert.deepEqual(await canvas.evaluate(({ width, height }) => [width, height]), [WIDTH / 2, HEIGHT]);
  assert.ok(differing(await framed(page), both, 2) < 0.001);
  await page.evaluate(() => globalThis.device.activeSession.end());
  await button(page).waitFor();
  assert.ok(await button(page).evaluate((element) => element === document.activeElement));
  assert.equal(await page.locator("canvas").count(), canvases);

  const floor = await page.evaluate((place) => globalThis.kilwa.api.groundBelow(place), [...space.at([0, 0, 0]), space.points[0][2] + 1]);
  for (const [k, eye] of eyes.entries()) {
    const place = [...space.at([((2 * k - 1) * APART) / 2, 0, 0]), floor + EYES];
    const share = async (higher) => {
      const whole = await reference(page, [place[0], place[1], place[2] + higher], space.turn);
      return differing(eye, part(whole, [k * (FULL_WIDTH - WIDTH / 2), 0, WIDTH / 2, HEIGHT]), 24);
    };
    const here = await share(0);
    assert.ok(here < 0.02, `${(here * 100).toFixed(2)} % of the pixels of eye ${k} differ from what the page draws from there`);
    if (k === 0) assert.ok((await share(0.1)) > 2 * here, "10 cm would be seen");
  }
  await page.evaluate(() => globalThis.kilwa.api.home());
  await page.waitForFunction(() => globalThis.kilwa.api.stats().settled);
  assert.equal(differing(await pixels(page), before, 8), 0);
  assert.deepEqual(complaints, []);
  await close();
});

test("controllers measure as the page does; squeezing takes back; thumbsticks walk, turn and jump", async () => {
  const { page, complaints, close } = await withHeadset();
  await enter(page);
  await press(page, "left", "x-button"); // the help goes
  const start = await spaceOf(page);
  const [first] = await measurements(page);
  const again = await page.evaluate((points) => globalThis.kilwa.api.addMeasurement({ tool: "distance", points }), first.points);
  const value = ({ readings }) => readings.find(({ name }) => name === "straight").value;
  assert.equal(value(first), value(again));
  assert.ok(Math.abs(value(first) - Math.hypot(...[0, 1, 2].map((k) => first.points[1][k] - first.points[0][k]))) < 1e-6);

  // A place that was begun with is cancelled; the next two make a measurement of their own.
  await hold(page, "right", [0, 1, -1.5], DOWN);
  await press(page, "right", "trigger");
  await press(page, "right", "squeeze");
  const second = await measure(page, [0.2, 1, -0.5], [0.2, 1, -0.8]);
  assert.ok(Math.abs(Math.hypot(second.points[1][0] - second.points[0][0], second.points[1][1] - second.points[0][1]) - 0.3) < 0.002);
  assert.equal((await measurements(page)).length, 3);
  await press(page, "right", "squeeze");
  assert.deepEqual(
    (await measurements(page)).map(({ id }) => id),
    [first.id, again.id],
  );

  // A turn by 30 degrees to the right, about the head.
  await push(page, "right", 1, 0);
  await push(page, "right", 0, 0);
  const turned = await spaceOf(page);
  assert.ok(Math.abs(Math.sin((turned.turn - start.turn + Math.PI / 6) / 2)) < 0.005, `${start.turn} → ${turned.turn}`);
  assert.ok(distance(turned.at([0, 0, 0]), start.at([0, 0, 0])) < 0.01);

  // A walk straight ahead.
  await push(page, "left", 0, -1);
  await frames(page, 4);
  await push(page, "left", 0, 0);
  const walked = await spaceOf(page);
  const ahead = [-Math.sin(turned.turn), Math.cos(turned.turn)];
  const way = walked.at([0, 0, 0]).map((v, k) => v - turned.at([0, 0, 0])[k]);
  const [far, aside] = [way[0] * ahead[0] + way[1] * ahead[1], way[0] * ahead[1] - way[1] * ahead[0]];
  assert.ok(far > 0.05 && Math.abs(aside) < 0.3 * far, `${far} m ahead, ${aside} m aside`);

  // A jump to the place that the ray meets.
  const { points } = await measure(page, [0.3, 1.3, -0.4], [0.1, 1.5, -0.4], [SLANT, SLANT]);
  await push(page, "right", 0, -1);
  if (SHOTS) await page.screenshot({ path: path.join(SHOTS, "headset-jump.png") });
  await push(page, "right", 0, 0);
  const jumped = await spaceOf(page);
  assert.ok(distance(jumped.at([0, 0, 0]), points[1]) < 0.02, `${jumped.at([0, 0, 0])}, not ${points[1]}`);
  if (SHOTS) await page.screenshot({ path: path.join(SHOTS, "headset-many.png") });

  // What the page shows and cuts away is what the headset shows.
  await whole(page);
  const plain = await seen(page);
  const mode = await page.evaluate(() => globalThis.kilwa.api.getMode());
  await page.evaluate(() => globalThis.kilwa.api.setMode("error"));
  await whole(page);
  assert.ok(differing(plain, await seen(page), 24) > 0.1);
  await page.evaluate((mode) => globalThis.kilwa.api.setMode(mode), mode);
  await whole(page);
  assert.ok(differing(plain, await seen(page), 24) < 0.02);

  // What was measured is in the list of the page.
  await button(page, "Exit VR").evaluate((element) => element.click());
  await button(page).waitFor();
  const listed = await measurements(page);
  assert.ok(listed.length >= 5 && listed.every(({ tool, state }) => tool === "distance" && state === "final"));
  assert.deepEqual(complaints, []);
  await close();
});

test("a lost context and a refused session end with a message, and it can be started again", async () => {
  const { page, close } = await withHeadset({ query: "&gpu=webgl" });
  await enter(page);
  await page.evaluate(() => document.querySelector("[data-webxr_runtime] canvas").getContext("webgl2").getExtension("WEBGL_lose_context").loseContext());
  await notice(page, "VR has ended because the graphics device was reset").waitFor();
  await button(page).waitFor();
  await page.waitForFunction(() => !globalThis.device.activeSession);
  assert.ok((await stats(page)).patchesDrawn > 0, "the page's own picture stays");

  // A headset that knows no floor: it is below the eyes of someone who stands.
  await page.evaluate(() => {
    const { requestReferenceSpace } = globalThis.XRSession.prototype;
    globalThis.XRSession.prototype.requestReferenceSpace = function (type) {
      return type === "local-floor" ? Promise.reject(new DOMException("no floor", "NotSupportedError")) : requestReferenceSpace.call(this, type);
    };
  });
  await enter(page);
  const { points } = await measure(page, [0.3, 1, -0.4], [0.3, 1, -0.4], [DOWN, SLANT]);
  const height = distance(...points);
  assert.ok(Math.abs(height - 1) < 0.25, `a ray that slants by 45° from a hand 1 m above the floor meets the ground ${height} m ahead`);
  await page.evaluate(() => globalThis.device.activeSession.end());
  await button(page).waitFor();

  // Another model is opened in the page.
  await enter(page);
  await page.getByLabel("Open a file").first().setInputFiles(site.pack);
  await notice(page, "VR has ended because the model was closed").waitFor();
  await button(page).waitFor();
  await page.waitForFunction(() => !globalThis.device.activeSession && globalThis.kilwa.api.stats()?.settled);

  await page.evaluate(() => {
    navigator.xr.requestSession = () => Promise.reject(new DOMException("not today", "NotAllowedError"));
  });
  await button(page).click();
  await notice(page, "VR could not be started: not today").waitFor();
  await close();
});

test("a hand that wavers, or that was seen too short a time, points less exactly; what it did long ago does not count", () => {
  const hands = new Hands();
  const [right, left] = [
    { handedness: "right", targetRaySpace: 0 },
    { handedness: "left", targetRaySpace: 1 },
  ];
  let angles = [0, 0];
  const frame = {
    getPose(hand) {
      const [sin, cos] = [Math.sin(angles[hand]), Math.cos(angles[hand])];
      return { transform: { matrix: Float32Array.from([cos, 0, -sin, 0, 0, 1, 0, 0, sin, 0, cos, 0, 0, 0, 0, 1]) } };
    },
  };
  let time = 0;
  const look = (count, angle) => {
    for (let k = 0; k < count; k += 1, time += 11) {
      angles = [0, angle(k)];
      hands.pointing([right, left], frame, null, time);
    }
  };
  look(2, () => 0);
  assert.equal(hands.wavering(left), 0.005);
  look(20, () => 0);
  assert.ok(hands.wavering(right) < 1e-6 && hands.wavering(left) < 1e-6);
  look(20, (k) => (k % 2 ? 0.01 : -0.01));
  assert.ok(Math.abs(hands.wavering(left) - 0.01) < 0.001, `${hands.wavering(left)} of the hand that is not the pointer`);
  assert.ok(hands.wavering(right) < 1e-6);
  look(20, () => 0.3);
  assert.ok(hands.wavering(left) < 1e-6);
});

test("leaning over a parapet moves nobody; a step of the thumbstick, and ground a little higher, are followed", () => {
  const rig = new Rig();
  const head = { position: [0, EYES, 0], forward: [0, 0, -1] };
  rig.stand(head.position, [5, 5, 10]);
  const eye = () => rig.place(head.position);
  assert.deepEqual(eye(), [5, 5, 10 + EYES]);
  let ground = 10;
  // Settles at once.
  const viewer = { groundBelow: () => ground, stepFrom: (x, y, _z, east, north, _seconds, height) => [x + east, y + north, ground + height] };
  for (const parapet of [11.2, 2]) {
    ground = parapet;
    rig.walk(viewer, head, [0, 0], 0.01);
    assert.deepEqual(eye(), [5, 5, 10 + EYES], `over ${parapet} m`);
  }
  ground = 10.3;
  rig.walk(viewer, head, [0, 0], 0.01);
  assert.ok(Math.abs(eye()[2] - 10.3 - EYES) < 1e-9);
  ground = 12;
  rig.walk(viewer, head, [0, 1], 0.01);
  assert.ok(Math.abs(eye()[2] - 12 - EYES) < 1e-9 && eye()[1] > 5);
});
