// The WebGL 2 build: chosen where no WebGPU adapter answers, alone downloaded, and the same pictures.

import assert from "node:assert/strict";
import { canvasOf, fortSite, open, openTab, pixels, setCamera, stats, test, waitFor } from "./harness.mjs";

const site = fortSite();

/** What differs between two pictures: the share of pixels that differ by more than `levels` in some channel. */
function difference(a, b, levels) {
  assert.deepEqual([a.width, a.height], [b.width, b.height]);
  let differing = 0;
  for (let at = 0; at < a.pixels.length; at += 4) {
    if ([0, 1, 2].some((c) => Math.abs(a.pixels[at + c] - b.pixels[at + c]) > levels)) differing += 1;
  }
  return differing / (a.width * a.height);
}

/** Opens the fort, and the names of the wasm modules that came to their end. */
async function fort(query, before, size = [500, 400]) {
  const modules = [];
  const opened = await open(site.browser, `${site.server.url}/m/fort?error=4${query}`, {
    size,
    before: async (page) => {
      page.on("requestfinished", (request) => {
        const name = /([\w-]+)(_bg\.wasm|\.js)$/.exec(new URL(request.url()).pathname);
        if (name?.[1].startsWith("viewer")) modules.push(name[0]);
      });
      await before?.(page);
    },
  });
  return { ...opened, modules };
}

/** One picture per shading that this model can have, by its name. */
async function pictures(page) {
  const all = {};
  await openTab(page, "Display");
  for (const shading of await page.getByRole("group", { name: "Shading" }).getByRole("radio").all()) {
    await shading.check();
    await waitFor(page, "settled");
    const name = await shading.evaluate((radio) => radio.labels[0].innerText.trim());
    all[name] = await pixels(page);
  }
  return all;
}

test("WebGL 2 draws the same pictures as WebGPU, and only one program is downloaded", async () => {
  const size = [900, 500]; // the panel stands beside the picture
  const gpu = await fort("", undefined, size);
  const wanted = { stats: await stats(gpu.page), pictures: await pictures(gpu.page) };
  assert.deepEqual(gpu.modules.sort(), ["viewer.js", "viewer_bg.wasm"]);
  assert.deepEqual(gpu.complaints, []);
  await gpu.close();

  const gl = await fort("&gpu=webgl", undefined, size);
  assert.deepEqual(gl.modules.sort(), ["viewer-gl.js", "viewer-gl_bg.wasm"]);
  const shown = await stats(gl.page);
  assert.match(shown.adapter, /Gl/);
  assert.equal(shown.trianglesDrawn, wanted.stats.trianglesDrawn);
  const drawn = await pictures(gl.page);
  assert.deepEqual(Object.keys(drawn), Object.keys(wanted.pictures));
  assert.ok(Object.keys(drawn).length >= 5);
  for (const mode of Object.keys(drawn)) {
    const share = difference(drawn[mode], wanted.pictures[mode], 4);
    assert.ok(share < 0.0005, `${mode}: ${(share * 100).toFixed(3)} % of the pixels differ`);
  }
  assert.ok(difference(drawn.Colour, drawn.Normals, 4) > 0.05, "else the comparison shows nothing");
  assert.deepEqual(gl.complaints, []);
  await gl.close();
});

test("where no WebGPU adapter answers, WebGL 2 takes over by itself", async () => {
  for (const hide of [
    () => Object.defineProperty(Navigator.prototype, "gpu", { value: undefined }),
    () => (globalThis.GPU.prototype.requestAdapter = async () => null),
  ]) {
    const { page, modules, complaints, close } = await fort("", (page) => page.addInitScript(hide));
    // The script of the other program, a few kilobytes, may have come while the adapter was asked for; the program itself was given up.
    assert.deepEqual(modules.filter((name) => name !== "viewer.js").sort(), ["viewer-gl.js", "viewer-gl_bg.wasm"]);
    assert.ok((await stats(page)).targetReached);
    assert.deepEqual(complaints, []);
    await close();
  }
});

test("a lost context is replaced when the browser gives another, and the picture is as it was", async () => {
  const { page, close } = await fort("&gpu=webgl");
  await setCamera(page, { azimuth: 1, elevation: 0.4, distance: 40, target: [1, 2, 3], orthographic: false, roll: 0, fieldOfView: 0.7 });
  const wanted = await pixels(page);
  const context = await canvasOf(page).evaluateHandle((canvas) => canvas.getContext("webgl2").getExtension("WEBGL_lose_context"));
  await context.evaluate((context) => context.loseContext());
  await page.getByRole("status").filter({ hasText: "The graphics device was reset." }).waitFor();
  assert.equal(await stats(page), null, "nothing is drawn any more");
  await context.evaluate((context) => context.restoreContext());
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
