// The WebGL 2 build: chosen where no WebGPU adapter answers, alone downloaded, and the same pictures.

import assert from "node:assert/strict";
import { after, before } from "node:test";
import { launch, open, packFolder, pixels, serve, stats, test, waitFor } from "./harness.mjs";

let server;
let browser;

before(async () => {
  server = await serve(await packFolder());
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
});

/** What differs between two pictures: the share of pixels that differ by more than `levels` in some channel. */
function difference(a, b, levels) {
  assert.deepEqual([a.width, a.height], [b.width, b.height]);
  let differing = 0;
  for (let at = 0; at < a.pixels.length; at += 4) {
    if ([0, 1, 2].some((c) => Math.abs(a.pixels[at + c] - b.pixels[at + c]) > levels)) differing += 1;
  }
  return differing / (a.width * a.height);
}

/** Opens the fort, and the names of the wasm modules that were asked for. */
async function fort(query, before) {
  const modules = [];
  const opened = await open(browser, `${server.url}/m/fort?error=4${query}`, {
    size: [500, 400],
    before: async (page) => {
      page.on("request", (request) => {
        const name = /([\w-]+)(_bg\.wasm|\.js)$/.exec(new URL(request.url()).pathname);
        if (name?.[1].startsWith("viewer")) modules.push(name[0]);
      });
      await before?.(page);
    },
  });
  return { ...opened, modules };
}

/** One picture per shading that this model can have. */
async function pictures(page) {
  const all = {};
  for (const mode of await page.evaluate(() => globalThis.kilwa.module.Viewer.modes())) {
    if (await page.evaluate((mode) => globalThis.kilwa.viewer.setMode(mode), mode)) all[mode] = await pixels(page);
  }
  return all;
}

test("WebGL 2 draws the same pictures as WebGPU, and only one program is downloaded", async () => {
  const gpu = await fort("");
  const wanted = { pictures: await pictures(gpu.page), stats: await stats(gpu.page) };
  assert.deepEqual(gpu.modules.sort(), ["viewer.js", "viewer_bg.wasm"]);
  assert.deepEqual(gpu.complaints, []);
  await gpu.close();

  const gl = await fort("&gpu=webgl");
  assert.deepEqual(gl.modules.sort(), ["viewer-gl.js", "viewer-gl_bg.wasm"]);
  assert.match(await gl.page.evaluate(() => globalThis.kilwa.viewer.adapter()), /Gl/);
  assert.equal((await stats(gl.page)).trianglesDrawn, wanted.stats.trianglesDrawn);
  const drawn = await pictures(gl.page);
  assert.deepEqual(Object.keys(drawn), Object.keys(wanted.pictures));
  assert.ok(Object.keys(drawn).length >= 5);
  for (const mode of Object.keys(drawn)) {
    const share = difference(drawn[mode], wanted.pictures[mode], 4);
    assert.ok(share < 0.0005, `${mode}: ${(share * 100).toFixed(3)} % of the pixels differ`);
  }
  assert.ok(difference(drawn.colour, drawn.normals, 4) > 0.05, "else the comparison shows nothing");
  assert.deepEqual(gl.complaints, []);
  await gl.close();
});

test("where no WebGPU adapter answers, WebGL 2 takes over by itself", async () => {
  for (const hide of [
    () => Object.defineProperty(Navigator.prototype, "gpu", { value: undefined }),
    () => (globalThis.GPU.prototype.requestAdapter = async () => null),
  ]) {
    const { page, modules, complaints, close } = await fort("", (page) => page.addInitScript(hide));
    assert.deepEqual(modules.sort(), ["viewer-gl.js", "viewer-gl_bg.wasm"]);
    assert.ok((await stats(page)).targetReached);
    assert.deepEqual(complaints, []);
    await close();
  }
});

test("a lost context is replaced when the browser gives another, and the picture is as it was", async () => {
  const { page, close } = await fort("&gpu=webgl");
  await page.evaluate(() =>
    globalThis.kilwa.viewer.setCamera({ azimuth: 1, elevation: 0.4, distance: 40, target: [1, 2, 3], orthographic: false, roll: 0, fieldOfView: 0.7 }),
  );
  await page.evaluate(() => globalThis.kilwa.session.wake());
  await waitFor(page, "settled");
  const wanted = await pixels(page);
  await page.evaluate(() => {
    globalThis.old = globalThis.kilwa.session;
    const lose = document.getElementById("canvas").getContext("webgl2").getExtension("WEBGL_lose_context");
    lose.loseContext();
    setTimeout(() => lose.restoreContext(), 300);
  });
  await page.waitForFunction(() => globalThis.kilwa.session !== globalThis.old && globalThis.kilwa.session.drawn, null, { polling: 50 });
  await waitFor(page, "settled");
  assert.equal(difference(await pixels(page), wanted, 0), 0);
  await close();
});

test("an adapter that gives no device leads to WebGL 2", async () => {
  const { page, close } = await fort("", (page) =>
    page.addInitScript(() => {
      GPUAdapter.prototype.requestDevice = () => Promise.reject(new Error("no device today"));
    }),
  );
  assert.equal(new URL(page.url()).searchParams.get("gpu"), "webgl");
  assert.ok((await stats(page)).patchesDrawn > 0);
  await close();
});
