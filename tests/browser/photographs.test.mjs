// The photographs that a model was coloured from: their cameras over the model, a strip of them, and each over the picture of its own view, whatever lens it has.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { mkdtemp, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, before } from "node:test";
import { promisify } from "node:util";
import { serious } from "./axe.mjs";
import { SHARP, canvasOf, cameraOf, drag, KILWA, launch, open, openTab, pixels, serve, setCamera, test, tool, waitFor, WWW } from "./harness.mjs";
import { projected } from "./projection.mjs";

const run = promisify(execFile);
const SHOTS = process.env.KILWA_SHOTS;
const METADATA = `title = "Gereza"
slug = "gereza"
published = 2026-11-29
[rights]
uri = "CC0"
[model]
units = "m"
[photographs]
rights = "CC BY 4.0"
credit = "Photographs: A. Juma"
`;

let [scratch, server, browser] = [];
/** A model that was coloured from four simulated photographs, published with them. */
before(async () => {
  scratch = await mkdtemp(path.join(tmpdir(), "kilwa-photographs-"));
  const at = (name) => path.join(scratch, name);
  await writeFile(at("metadata.toml"), METADATA);
  await run(KILWA, ["synth", "photos", "--photos", "4", "--panoramas", "0", "--size", "320x240", "-o", at("session")]);
  await run(KILWA, ["synth", "fort", "--triangles", "60k", "-o", at("fort.ply")]);
  await run(KILWA, ["build", at("fort.ply"), "-o", at("plain.kilwa")]);
  const photos = at("session/photos");
  await run(KILWA, ["colour", at("plain.kilwa"), "--photos", photos, "--report", at("report.json"), "-o", at("fort.kilwa")]);
  const included = ["--colour-report", at("report.json"), "--photos", photos];
  await run(KILWA, ["publish", at("fort.kilwa"), "--to", at("site"), "--metadata", at("metadata.toml"), ...included, "--www", WWW, "--software"]);
  server = await serve(at("site"));
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
  await rm(scratch, { recursive: true });
});

const PAGE = () => `${server.url}/gereza/?error=8`;
const group = (page, name = "Photographs") => page.getByRole("group", { name, exact: true });
const strip = (page) => page.getByRole("region", { name: "Photographs", exact: true });
const thumbs = (page) => strip(page).getByRole("listitem").getByRole("button");
const slider = (page) => strip(page).getByRole("slider", { name: "Photograph opacity" });
const closing = (page) => strip(page).getByRole("button", { name: "Close" });
const message = (page, text) => page.getByRole("main").getByRole("status").filter({ hasText: text });

async function openStrip(page) {
  await openTab(page, "Display");
  await group(page).getByRole("checkbox").check();
  await thumbs(page).first().waitFor();
}

/** Wait until the photograph is over the model. */
const shown = (page) => page.locator(".photo-bar:is([data-state=whole], [data-state=preview])").waitFor();

async function openPhotograph(page, at) {
  await thumbs(page).nth(at).click();
  await shown(page);
  await waitFor(page, "settled");
}

/** Part of a picture, in fractions of its width and height: what the photograph covers, and the strip does not. */
const PART = { from: 0.35, to: 0.6 };

/** The pixels of the photograph over the model in that part, rows from the top; and the width and height of the whole. */
const photographed = (page) =>
  page.evaluate(({ from, to }) => {
    const canvas = document.querySelector(".photo-overlay");
    const { width, height } = canvas;
    const copy = Object.assign(document.createElement("canvas"), { width, height });
    const context = copy.getContext("2d");
    context.drawImage(canvas, 0, 0);
    const [left, top, right, bottom] = [from * width, from * height, to * width, to * height].map(Math.round);
    return { width, height, pixels: [...context.getImageData(left, top, right - left, bottom - top).data] };
  }, PART);

/** Mean difference of the model's picture from these pixels, of 255. */
function difference(model, pixels) {
  const [left, top, right, bottom] = [PART.from * model.width, PART.from * model.height, PART.to * model.width, PART.to * model.height].map(Math.round);
  let [sum, at] = [0, 0];
  for (let y = top; y < bottom; y += 1) {
    for (let x = left; x < right; x += 1, at += 4) {
      for (let k = 0; k < 3; k += 1) sum += Math.abs(model.pixels[(y * model.width + x) * 4 + k] - pixels[at + k]);
    }
  }
  return sum / (3 * (right - left) * (bottom - top));
}

test("published photographs are offered, listed with their credit, and one is seen over the model from where it was taken", async () => {
  const asked = [];
  const { page, complaints, close } = await open(browser, PAGE(), {
    size: [1280, 800],
    before: (page) => page.on("request", (request) => asked.push(new URL(request.url()).pathname)),
  });
  await openTab(page, "Display");
  await group(page).getByText("Photographs: A. Juma").waitFor();
  assert.equal(await group(page).getByRole("link", { name: "CC BY 4.0" }).getAttribute("href"), "https://creativecommons.org/licenses/by/4.0/");
  assert.ok(!asked.some((name) => name.endsWith("colour-report.json") || name.includes("/photographs/")), "nothing of it is loaded before it is asked for");
  await openStrip(page);
  assert.equal(await thumbs(page).count(), 4);
  await page.waitForFunction(() => [...document.querySelectorAll(".thumbs img")].every((img) => img.complete && img.naturalWidth === 240));
  if (SHOTS) await page.screenshot({ path: path.join(SHOTS, "photographs-frusta.png") });
  const before = await cameraOf(page);
  await openPhotograph(page, 1);
  if (SHOTS) await page.screenshot({ path: path.join(SHOTS, "photographs-open.png") });
  assert.equal(await thumbs(page).nth(1).getAttribute("aria-current"), "true");
  await strip(page).getByText("Photographs: A. Juma · CC BY 4.0").waitFor();
  const file = await strip(page).getByRole("link", { name: "Open the photograph file" }).getAttribute("href");
  assert.match(file, /\/v1\/photographs\/IMG_\d+\.jpg$/);
  // The model has its colours from the photographs: where they fit, both look the same.
  const over = await photographed(page);
  const model = await pixels(page);
  assert.deepEqual([over.width, over.height], [model.width, model.height]);
  const here = difference(model, over.pixels);
  await strip(page).getByRole("button", { name: "Next photograph" }).click();
  await shown(page);
  const elsewhere = difference(model, (await photographed(page)).pixels);
  assert.ok(here < 20 && here < 0.6 * elsewhere, `the photograph differs from the model by ${here}, another one by ${elsewhere}`);
  await strip(page).getByRole("button", { name: "Previous photograph" }).click();
  await shown(page);
  await slider(page).fill("0");
  await slider(page).fill("40");
  assert.equal(await page.locator(".photo-overlay").evaluate((canvas) => canvas.style.opacity), "0.4");
  await strip(page).getByRole("button", { name: "Next photograph" }).click();
  await shown(page);
  assert.equal(await thumbs(page).nth(2).getAttribute("aria-current"), "true");
  assert.equal(await slider(page).inputValue(), "40");
  await page.keyboard.press("Escape");
  await closing(page).waitFor({ state: "detached" });
  assert.equal((await cameraOf(page)).at(-1), 0.7, "the usual opening angle");
  assert.notDeepEqual(await cameraOf(page), before);
  await group(page).getByRole("checkbox").uncheck();
  await strip(page).waitFor({ state: "hidden" });
  assert.deepEqual(complaints, []);
  await close();
});

test("with a photograph over the model, the eye stays: drags and arrows look about, the wheel narrows the view; moving the eye ends it", async () => {
  const { page, complaints, close } = await open(browser, PAGE(), { size: [1000, 700] });
  await openStrip(page);
  await openPhotograph(page, 0);
  const eye = () =>
    page.evaluate(() => {
      const { target, azimuth: a, elevation: e, distance: d } = globalThis.kilwa.api.getCamera();
      return target.map((v, k) => v + d * [Math.cos(e) * Math.sin(a), Math.cos(e) * Math.cos(a), Math.sin(e)][k]);
    });
  const isHere = (a, b) => Math.hypot(...a.map((v, k) => v - b[k])) < 1e-4;
  const stands = await eye();
  const first = await page.evaluate(() => globalThis.kilwa.api.getCamera());
  await drag(page, [0.5, 0.5], [0.6, 0.55]);
  await page.mouse.wheel(0, -300);
  await canvasOf(page).focus();
  await page.keyboard.press("ArrowLeft");
  await page.keyboard.press("+");
  await waitFor(page, "settled");
  const then = await page.evaluate(() => globalThis.kilwa.api.getCamera());
  assert.ok(isHere(await eye(), stands), `${await eye()} ${stands}`);
  assert.ok(then.fieldOfView < 0.8 * first.fieldOfView && then.azimuth !== first.azimuth, JSON.stringify({ first, then }));
  // Another size of the page does not move it either.
  await page.setViewportSize({ width: 900, height: 640 });
  await page.waitForFunction(() => Math.abs(document.querySelector("#canvas").width - document.querySelector(".photo-overlay").width) < 1);
  await waitFor(page, "settled");
  assert.ok(isHere(await eye(), stands), "after a change of size");
  assert.ok(await closing(page).isVisible());
  // Panning leaves the place.
  await drag(page, [0.5, 0.5], [0.6, 0.5], { button: "right" });
  await closing(page).waitFor({ state: "detached" });
  assert.ok(!isHere(await eye(), stands));
  // Walking does, too.
  await openPhotograph(page, 0);
  await tool(page, "Walk at eye height").click();
  await page.getByRole("group", { name: "Walking", exact: true }).waitFor();
  await closing(page).waitFor({ state: "detached" });
  assert.deepEqual(complaints, []);
  await close();
});

test("nothing is drawn over the model while a photograph is being loaded; H hides it with the rest", async () => {
  const { page, close } = await open(browser, PAGE(), { size: [1000, 700] });
  let release;
  const held = new Promise((resolve) => {
    release = resolve;
  });
  await page.route("**/photographs/IMG_*.jpg", async (route) => {
    await held;
    await route.continue();
  });
  await openStrip(page);
  await thumbs(page).first().click();
  await strip(page).getByText("Loading the photograph…").waitFor();
  await waitFor(page, "settled");
  assert.equal(await page.locator(".photo-overlay").count(), 0);
  release();
  await shown(page);
  assert.equal(await page.locator(".photo-overlay").count(), 1);
  await canvasOf(page).focus();
  await page.keyboard.press("h");
  await strip(page).waitFor({ state: "hidden" });
  assert.equal(await page.locator(".photo-overlay").isVisible(), true, "the picture stays");
  await close();
});

test("from a photograph, another view is reached as from anywhere else, with the opening angle of before and upright", async () => {
  const { page, complaints, close } = await open(browser, PAGE(), { size: [1000, 700], reducedMotion: "no-preference" });
  await openStrip(page);
  const camera = () => page.evaluate(() => globalThis.kilwa.api.getCamera());
  // A camera that stays the same for five frames is at rest.
  const rest = () =>
    page.evaluate(async () => {
      for (let same = 0, last = ""; same < 5; ) {
        await new Promise((resolve) => requestAnimationFrame(resolve));
        const key = JSON.stringify(globalThis.kilwa.api.getCamera());
        same = key === last ? same + 1 : 0;
        last = key;
      }
    });
  for (const go of [() => tool(page, "Show the whole model").click(), () => page.keyboard.press("2"), () => page.keyboard.press("6")]) {
    await openPhotograph(page, 0);
    assert.notEqual((await camera()).fieldOfView, 0.7);
    await canvasOf(page).focus();
    await go();
    await closing(page).waitFor({ state: "detached" });
    await rest();
    const { fieldOfView, roll, distance } = await camera();
    assert.ok(Math.abs(fieldOfView - 0.7) < 1e-9 && roll === 0, JSON.stringify({ fieldOfView, roll }));
    assert.ok(distance > 20, `${distance}: the whole model is in view`);
  }
  // Left on the way there; in the page itself, for a flight is short.
  const onTheWay = async (what) => {
    await thumbs(page).nth(1).click();
    await page.evaluate(async (what) => {
      while (globalThis.kilwa.api.getCamera().fieldOfView === 0.7) await new Promise((resolve) => requestAnimationFrame(resolve));
      const escapeKey = () => document.body.dispatchEvent(new KeyboardEvent("keydown", { key: "Escape", bubbles: true, cancelable: true }));
      const wheel = () => document.querySelector("#canvas").dispatchEvent(new WheelEvent("wheel", { deltaY: -50, cancelable: true }));
      (what === "wheel" ? wheel : escapeKey)();
      if (what === "again") document.querySelectorAll(".thumbs button")[1].click();
    }, what);
  };
  for (const what of ["escape", "wheel"]) {
    await onTheWay(what);
    await closing(page).waitFor({ state: "detached" });
    await rest();
    const { fieldOfView, roll } = await camera();
    assert.ok(Math.abs(fieldOfView - 0.7) < 1e-9 && Math.abs(roll) < 1e-9, JSON.stringify({ what, fieldOfView, roll }));
  }
  // The same photograph again before the first flight has ended.
  await onTheWay("again");
  await shown(page);
  await rest();
  assert.ok(await closing(page).isVisible());
  assert.deepEqual(complaints, []);
  await close();
});

test("the box may be checked and unchecked faster than the report comes", async () => {
  const { page, close } = await open(browser, PAGE(), { size: [1000, 700] });
  let release;
  const held = new Promise((resolve) => {
    release = resolve;
  });
  let asked = 0;
  await page.route("**/colour-report.json", async (route) => {
    asked += 1;
    await held;
    await route.continue();
  });
  await openTab(page, "Display");
  for (let n = 0; n < 5; n += 1) await group(page).getByRole("checkbox").click();
  release();
  await thumbs(page).first().waitFor();
  assert.equal(asked, 1);
  assert.equal(await page.locator(".photo-strip").count(), 1);
  assert.equal(await page.locator("canvas.marks").count(), 2);
  assert.equal(await group(page).getByRole("checkbox").isChecked(), true);
  await close();
});

test("cameras in the picture can be pointed at and clicked, and the strip is used with the keyboard", async () => {
  const { page, close } = await open(browser, PAGE(), { size: [1280, 800] });
  await openStrip(page);
  const { position } = (await (await page.request.get(`${server.url}/gereza/v1/colour-report.json`)).json()).photographs[3];
  // Its camera in the middle of the picture, seen from above.
  await setCamera(page, { target: position, azimuth: 0.3, elevation: 1.2, distance: 25, orthographic: false });
  const { x, y, width, height } = await canvasOf(page).boundingBox();
  await page.mouse.move(x + width / 2 + 3, y + height / 2);
  await page.locator("#canvas.points").waitFor();
  await page.mouse.click(x + width / 2 + 3, y + height / 2);
  await shown(page);
  assert.equal(await thumbs(page).nth(3).getAttribute("aria-current"), "true");
  await thumbs(page).nth(3).focus();
  await page.keyboard.press("Home");
  assert.equal(
    await thumbs(page)
      .nth(0)
      .evaluate((button) => button === document.activeElement),
    true,
  );
  await page.keyboard.press("ArrowRight");
  await page.keyboard.press("Enter");
  await shown(page);
  assert.equal(await thumbs(page).nth(1).getAttribute("aria-current"), "true");
  await page.keyboard.press("Escape");
  await closing(page).waitFor({ state: "detached" });
  await close();
});

const LENSES = {
  "a distorted photograph": {
    camera: {
      kind: "pinhole",
      size: [600, 400],
      focal: [520, 510],
      center: [310, 190],
      skew: 2,
      max_angle_degrees: 50,
      distortion: { kind: "brown", k: [-0.25, 0.08, -0.01], p: [0.003, -0.002] },
    },
  },
  "a photograph that was taken with the camera on its side": {
    camera: {
      kind: "pinhole",
      size: [600, 400],
      focal: [500, 500],
      center: [300, 200],
      max_angle_degrees: 50,
      distortion: { kind: "rational", k: [0.4, 0.1, 0.01, 0.5, 0.2, 0.02], p: [0, 0] },
    },
    turned: Math.PI / 2,
  },
  "a fisheye": {
    camera: {
      kind: "pinhole",
      size: [500, 500],
      focal: [160, 160],
      center: [250, 250],
      max_angle_degrees: 100,
      distortion: { kind: "fisheye", k: [0.02, -0.005, 0, 0], p: [] },
    },
  },
  "a panorama": { camera: { kind: "equirectangular", size: [1600, 800], max_angle_degrees: 180 }, turned: 0.2 },
  "a cylindrical panorama": {
    camera: { kind: "cylindrical", size: [1600, 500], focal: [254.6, 254.6], scale: [254.6, 254.6], center: [800, 250], max_angle_degrees: 180 },
  },
};

/** The rotation from the world to a camera that looks along `forward`, its picture turned, as three rows: right, down, forward. */
function rowsOf(forward, turned) {
  const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const unit = (v) => v.map((c) => c / Math.hypot(...v));
  const right = unit(cross(forward, [0, 0, 1]));
  const down = cross(forward, right);
  const [s, c] = [Math.sin(turned), Math.cos(turned)];
  return [right.map((v, k) => c * v + s * down[k]), down.map((v, k) => c * v - s * right[k]), forward];
}

/** Of a rotation matrix, w first. */
function quaternion([[a, b, c], [d, e, f], [g, h, i]]) {
  const w = Math.sqrt(Math.max(0, 1 + a + e + i)) / 2;
  if (w > 0.1) return [w, (h - f) / (4 * w), (c - g) / (4 * w), (d - b) / (4 * w)];
  const x = Math.sqrt(Math.max(0, 1 + a - e - i)) / 2;
  if (x > 0.4) return [(h - f) / (4 * x), x, (b + d) / (4 * x), (c + g) / (4 * x)];
  const y = Math.sqrt(Math.max(0, 1 - a + e - i)) / 2;
  if (y > 0.4) return [(c - g) / (4 * y), (b + d) / (4 * y), y, (f + h) / (4 * y)];
  const z = Math.sqrt(Math.max(0, 1 - a - e + i)) / 2;
  return [(d - b) / (4 * z), (c + g) / (4 * z), (f + h) / (4 * z), z];
}

/** Answers requests for a colour report and its photographs: one with this camera and pose, which shows a red dot at a pixel on white. */
async function pretend(page, { camera, rotation, position, dot, name = "a.png" }) {
  const { size } = camera;
  const png = await page.evaluate(
    ([[width, height], [x, y]]) => {
      const canvas = Object.assign(document.createElement("canvas"), { width, height });
      const context = canvas.getContext("2d");
      context.fillStyle = "#fff";
      context.fillRect(0, 0, width, height);
      context.fillStyle = "#f00";
      context.beginPath();
      context.arc(x, y, 6, 0, 7);
      context.fill();
      return canvas.toDataURL("image/png").split(",")[1];
    },
    [size, dot],
  );
  const photo = {
    name,
    file: name,
    path: `photographs/${name}`,
    bytes: 1000,
    camera,
    camera_from_world: { rotation_wxyz: rotation, translation: [0, 0, 0] },
    position,
    seen: 1,
    share: 1,
  };
  await page.route("**/colour-report.json", (route) => route.fulfill({ json: { kilwa_colour_report: 1, photographs: [photo], left_out: [] } }));
  await page.route("**/photographs/a.png", (route) => route.fulfill({ body: Buffer.from(png, "base64"), contentType: "image/png" }));
}

for (const [what, { camera, turned = 0 }] of Object.entries(LENSES)) {
  test(`${what} fits the model: a place is shown where it was photographed`, async () => {
    const { page, complaints, close } = await open(browser, PAGE(), { ...SHARP, size: [1100, 800] });
    // A place on the model that is certainly seen: what is beside the middle of the picture.
    const { place, eye } = await page.evaluate(() => {
      const { api } = globalThis.kilwa;
      const { width, height } = document.querySelector("#canvas").getBoundingClientRect();
      const { target, azimuth: a, elevation: e, distance: d } = api.getCamera();
      const eye = target.map((v, k) => v + d * [Math.cos(e) * Math.sin(a), Math.cos(e) * Math.cos(a), Math.sin(e)][k]);
      return { place: api.pick(0.55 * width, 0.5 * height).place, eye };
    });
    const towards = place.map((v, k) => v - eye[k]);
    const far = Math.hypot(...towards);
    // The camera does not look straight at it.
    const [px, py, pz] = towards.map((v) => v / far);
    const forward = [px * Math.cos(0.15) - py * Math.sin(0.15), px * Math.sin(0.15) + py * Math.cos(0.15), pz];
    const rows = rowsOf(
      camera.kind === "pinhole" ? forward : [forward[0] / Math.hypot(forward[0], forward[1]), forward[1] / Math.hypot(forward[0], forward[1]), 0],
      turned,
    );
    const seen = rows.map((row) => row.reduce((sum, v, k) => sum + v * towards[k], 0));
    const dot = projected(camera, seen);
    assert.ok(dot[0] > 20 && dot[0] < camera.size[0] - 20 && dot[1] > 20 && dot[1] < camera.size[1] - 20, `${dot}`);
    await pretend(page, { camera, rotation: quaternion(rows), position: eye, dot });
    await openStrip(page);
    await openPhotograph(page, 0);
    if (SHOTS) await page.screenshot({ path: path.join(SHOTS, `photographs-${camera.kind}-${camera.distortion?.kind ?? "none"}.png`) });
    if (turned > 1) assert.ok(Math.abs((await cameraOf(page)).at(-2)) < 0.2, "it stands upright");
    // Panoramas open ahead; the place may lie above or below what is seen then.
    if (camera.kind !== "pinhole") {
      await page.evaluate(
        ({ eye, place }) => {
          const { api } = globalThis.kilwa;
          const to = eye.map((v, k) => v - place[k] + [0.02, 0.03, 0.01][k] * Math.hypot(...eye.map((v, k) => v - place[k])));
          const distance = api.getCamera().distance;
          const length = Math.hypot(...to);
          const back = to.map((v) => v / length);
          api.setCamera({
            ...api.getCamera(),
            azimuth: Math.atan2(back[0], back[1]),
            elevation: Math.asin(back[2]),
            target: eye.map((v, k) => v - back[k] * distance),
          });
        },
        { eye, place },
      );
      await waitFor(page, "settled");
    }
    const found = await page.evaluate(() => {
      const canvas = document.querySelector(".photo-overlay");
      const { width, height } = canvas;
      const copy = Object.assign(document.createElement("canvas"), { width, height });
      const context = copy.getContext("2d");
      context.drawImage(canvas, 0, 0);
      const { data } = context.getImageData(0, 0, width, height);
      let [x, y, count] = [0, 0, 0];
      for (let at = 0; at < data.length; at += 4) {
        const isRed = data[at] > 150 && data[at + 1] < 100 && data[at + 3] > 200;
        if (!isRed) continue;
        x += ((at / 4) % width) + 0.5;
        y += Math.floor(at / 4 / width) + 0.5;
        count += 1;
      }
      const ratio = width / canvas.clientWidth;
      const at = [x / count / ratio, y / count / ratio];
      return { count, at, hit: globalThis.kilwa.api.pick(...at)?.place, metresPerPixel: null };
    });
    assert.ok(found.count > 20, JSON.stringify(found));
    assert.ok(found.hit, `nothing is picked at ${found.at}`);
    // How far the picked place lies off the ray, as an angle.
    const to = found.hit.map((v, k) => v - eye[k]);
    const dotted = to.reduce((sum, v, k) => sum + v * towards[k], 0) / (Math.hypot(...to) * far);
    const { fieldOfView } = await page.evaluate(() => globalThis.kilwa.api.getCamera());
    const pixel = fieldOfView / (await canvasOf(page).boundingBox()).height;
    const off = Math.acos(Math.min(1, dotted)) / pixel;
    assert.ok(off < 1.5, `${off} pixels off`);
    assert.deepEqual(complaints, []);
    await close();
  });
}

test("a report that is not one, a photograph that cannot be loaded, and photographs that were not published are named in words", async () => {
  const { page, close } = await open(browser, PAGE(), { size: [1000, 700] });
  await page.route("**/colour-report.json", (route) => route.fulfill({ json: { kilwa_colour_report: 7 } }));
  await openTab(page, "Display");
  await group(page).getByRole("checkbox").click();
  await message(page, "this is not a colour report that Kilwa can read").waitFor();
  assert.equal(await group(page).getByRole("checkbox").isChecked(), false);
  await page.unroute("**/colour-report.json");
  // A path that leads out of the version.
  const photo = {
    name: "a",
    bytes: 1,
    camera: { kind: "equirectangular", size: [200, 100], max_angle_degrees: 180 },
    camera_from_world: { rotation_wxyz: [1, 0, 0, 0] },
    position: [0, 0, 5],
    seen: 1,
  };
  const report = (more) => ({ json: { kilwa_colour_report: 1, photographs: [{ ...photo, ...more }] } });
  await page.route("**/colour-report.json", (route) => route.fulfill(report({ path: "photographs/../../x.jpg" })));
  await group(page).getByRole("checkbox").click();
  await page.waitForFunction(() => !document.querySelector("#photographs input").checked);
  await page.unroute("**/colour-report.json");
  await page.route("**/colour-report.json", (route) => route.fulfill(report({ path: "photographs/missing.jpg" })));
  await openStrip(page);
  await thumbs(page).first().click();
  await message(page, "/gereza/v1/photographs/missing.jpg: 404").waitFor();
  await strip(page).getByText("The photograph could not be loaded.").waitFor();
  assert.equal(await slider(page).isDisabled(), true);
  // What is no picture is not drawn, and can be tried again.
  await page.route("**/missing.jpg", (route) => route.fulfill({ body: "no picture", contentType: "image/jpeg" }));
  await strip(page).getByRole("button", { name: "Try again" }).click();
  await page.locator(".photo-bar[data-state=failed]").waitFor();
  assert.equal(await page.locator(".photo-overlay").count(), 0);
  await page.unroute("**/missing.jpg");
  await page.route("**/missing.jpg", (route) => route.fulfill({ path: path.join(scratch, "session/photos/images/IMG_0001.jpg") }));
  await strip(page).getByRole("button", { name: "Try again" }).click();
  await shown(page);
  assert.equal(await page.locator(".photo-overlay").count(), 1);
  await close();

  const other = await open(browser, PAGE(), { size: [1000, 700] });
  await other.page.route("**/colour-report.json", (route) => route.fulfill(report({})));
  await openStrip(other.page);
  await thumbs(other.page).first().click();
  await strip(other.page).getByText("The photograph itself was not published.").waitFor();
  assert.equal(await slider(other.page).count(), 0);
  assert.deepEqual(other.complaints, []);
  await other.close();
});

test("the part for photographs speaks the language of the page, and axe-core finds nothing serious in it", async () => {
  for (const locale of ["en", "ar"]) {
    const { page, complaints, close } = await open(browser, PAGE(), { size: [1280, 800], locale });
    await page.locator("#tab-display").click();
    await page.locator("#photographs input").check();
    await page.locator(".thumbs button").nth(1).click();
    await shown(page);
    await waitFor(page, "settled");
    if (SHOTS) await page.screenshot({ path: path.join(SHOTS, `photographs-${locale}.png`) });
    assert.deepEqual(await serious(page, locale, ["#display", ".photo-strip"]), []);
    const turned = await page.locator(".photo-bar > button.icon svg").evaluateAll((all) => all.map((svg) => getComputedStyle(svg).transform));
    const arrow = locale === "ar" ? "matrix(-1, 0, 0, 1, 0, 0)" : "none";
    assert.deepEqual(turned, [arrow, arrow, "none"], "the arrows of previous and next point in the direction of reading");
    for (const [language, name] of [
      ["fr", "Photographies"],
      ["sw", "Picha"],
    ]) {
      await page.evaluate((language) => globalThis.kilwa.api.setLanguage(language), language);
      await group(page, name).waitFor();
      await page.getByRole("region", { name, exact: true }).waitFor();
    }
    assert.deepEqual(complaints, []);
    await close();
  }
});

test("on a phone, the photograph that is open takes the place of the strip", async () => {
  const { page, close } = await open(browser, PAGE(), { size: [390, 780], hasTouch: true });
  await page.locator("#tab-display").click();
  await page.locator("#photographs input").check();
  await thumbs(page).first().waitFor();
  if (SHOTS) await page.screenshot({ path: path.join(SHOTS, "photographs-phone-strip.png") });
  await thumbs(page).first().click();
  await page.locator("#panel[data-size=peek]").waitFor();
  await shown(page);
  await waitFor(page, "settled");
  assert.equal(await thumbs(page).first().isVisible(), false);
  // The photograph is in the middle of what the bar leaves free, though the sheet was higher when it was clicked.
  const [top, bottom] = await page.evaluate(() => {
    const canvas = document.querySelector(".photo-overlay");
    const { width, height } = canvas;
    const copy = Object.assign(document.createElement("canvas"), { width, height });
    const context = copy.getContext("2d");
    context.drawImage(canvas, 0, 0);
    const { data } = context.getImageData(width / 2, 0, 1, height);
    const rows = [...Array(height).keys()].filter((y) => data[4 * y + 3] > 0);
    return [rows[0], rows.at(-1)];
  });
  const canvas = await canvasOf(page).boundingBox();
  const free = ((await strip(page).boundingBox()).y - canvas.y) / canvas.height;
  const height = await page.evaluate(() => document.querySelector(".photo-overlay").height);
  assert.ok(Math.abs((top + bottom) / 2 / height - free / 2) < 0.03, JSON.stringify({ top, bottom, height, free }));
  assert.ok(await slider(page).isVisible());
  if (SHOTS) await page.screenshot({ path: path.join(SHOTS, "photographs-phone.png") });
  await closing(page).click();
  await thumbs(page).first().waitFor();
  await close();
});
