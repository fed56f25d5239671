// What `kilwa extract --to tiles` writes, in the clients that people use, as they are published: once they are at rest, no pixel inside the model shows the
// background, which is magenta, although several levels of detail are side by side. Figures: docs/bench/2026-11-27-tiles.md.
//
// What is inside is known from the finest surface in one piece, drawn from the same place: pixels that have no background and no border of the surface near
// them, because the fort has true holes. Back faces are not drawn: behind a crack is the background, or another part of the fort.

import assert from "node:assert/strict";
import { mkdtemp, readFile, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, before } from "node:test";
import { launch, open, test } from "./harness.mjs";
import { makePages, makeTilesets, separateTiles, serveFiles } from "./tiles/site.mjs";
import { cracksIn, levelsOf, moved, unpacked, viewsOf } from "./tiles/views.mjs";

const IS_LONG = Boolean(process.env.KILWA_SOAK);
/** Views in each client; the first half of them sees the tileset `web`, the others `plain`. */
const VIEWS = IS_LONG ? 100 : 6;
const TRIANGLES = IS_LONG ? 1_000_000 : 600_000;
/** Every other view has this limit, the others the client's own: with larger errors, more levels are side by side, and cracks would be wider. */
const COARSE = 64;
/** The page of each client, and its own limit. */
const CLIENTS = { CesiumJS: ["cesium", 16], "3d-tiles-renderer": ["renderer", 16], "loaders.gl": ["loaders", 8] };

let folder;
let server;
let browser;
let whole;
let views;
const roots = {};

before(async () => {
  folder = await mkdtemp(path.join(tmpdir(), "kilwa-tiles-"));
  await Promise.all([makeTilesets(folder, TRIANGLES), makePages(folder)]);
  await separateTiles(path.join(folder, "plain"), path.join(folder, "separate"));
  for (const name of ["web", "plain", "separate"]) roots[name] = JSON.parse(await readFile(path.join(folder, name, "tileset.json"))).root;
  views = viewsOf(roots.plain.boundingVolume.sphere, VIEWS).map((view) => ({ view, covered: null }));
  server = await serveFiles(folder);
  browser = await launch();
  whole = await openClient("whole");
  await whole.load("whole.glb");
});
after(async () => {
  await browser?.close();
  await server?.stop();
  if (folder) await rm(folder, { recursive: true });
});

/** A page of tests/browser/tiles: `load(path)` and `show(view)`; `closed()` closes it, and checks that nothing went wrong and nothing came from elsewhere. */
async function openClient(name) {
  const elsewhere = [];
  const listen = (page) =>
    page.on("request", (request) => !/^(data|blob):/.test(request.url()) && !request.url().startsWith(server.url) && elsewhere.push(request.url()));
  const { page, complaints, close } = await open(browser, `${server.url}/${name}.html`, { wait: null, before: listen });
  await page.waitForFunction(() => globalThis.client);
  return {
    load: (file) => page.evaluate((url) => globalThis.client.open(url), `${server.url}/${file}`),
    show: (view) => page.evaluate((view) => globalThis.client.show(view), view),
    closed: async () => {
      await close();
      assert.deepEqual({ complaints, elsewhere }, { complaints: [], elsewhere: [] });
    },
  };
}

/** Shows each of `some` views in a client, with limits in turn: pixels inside, those of them that show the background, and the mean numbers of levels and tiles. */
async function measure(client, tileset, some, limits) {
  const sum = { views: some.length, inside: 0, background: 0, levels: 0, tiles: 0, where: [] };
  for (const [i, entry] of some.entries()) {
    // The frame of the tiles is the same in all tilesets.
    entry.covered ??= unpacked((await whole.show(moved(entry.view, roots.plain.transform))).background);
    const limit = limits[i % limits.length];
    const shown = await client.show({ ...moved(entry.view, roots[tileset].transform), limit });
    assert.equal(shown.failures, 0, "every tile could be loaded");
    assert.equal(shown.limit, limit);
    // Coarse levels may move an outline by a pixel for 16 of the limit, and rounding may move it in both pictures.
    const { inside, cracks } = cracksIn(unpacked(shown.background), entry.covered, Math.ceil(limit / 16) + 2);
    assert.ok(inside > 500, `view ${views.indexOf(entry)} shows the model: ${inside} pixels`);
    sum.inside += inside;
    sum.background += cracks.length;
    sum.levels += levelsOf(shown.tiles) / some.length;
    sum.tiles += shown.tiles.length / some.length;
    if (cracks.length > 0) sum.where.push({ view: views.indexOf(entry), limit, pixels: cracks.slice(0, 5) });
  }
  return sum;
}

const halves = () => ({ web: views.slice(0, VIEWS / 2), plain: views.slice(VIEWS / 2) });

for (const [name, [page, own]] of Object.entries(CLIENTS)) {
  test(`${name} shows no cracks`, { timeout: 3_600_000 }, async (t) => {
    const client = await openClient(page);
    for (const [tileset, some] of Object.entries(halves())) {
      const started = Date.now();
      assert.equal(await client.load(`${tileset}/tileset.json`), own, "the client's own limit");
      const found = await measure(client, tileset, some, [COARSE, own]);
      t.diagnostic(`${name}, ${tileset}: ${JSON.stringify({ ...found, seconds: (Date.now() - started) / 1000 })}`);
      assert.deepEqual(found.where, [], "pixels inside the model that show the background");
      assert.ok(found.levels >= 2, `on average, ${found.levels} levels are side by side`);
    }
    await client.closed();
  });
}

// What shows that cracks would be found: the same triangles, but every tile has a sphere of its own, as exporters usually write them.
for (const [name, [page]] of Object.entries(CLIENTS).filter(([name]) => IS_LONG || name === "3d-tiles-renderer")) {
  test(`tiles that decide separately crack in ${name}, and this is found`, { timeout: 3_600_000 }, async (t) => {
    const client = await openClient(page);
    await client.load("separate/tileset.json");
    const found = await measure(client, "separate", views.slice(0, 6), [COARSE]);
    t.diagnostic(`${name}, separate: ${JSON.stringify({ ...found, where: found.where.length })}`);
    assert.ok(found.background > 100, `${found.background} pixels`);
    await client.closed();
  });
}
