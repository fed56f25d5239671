// The trust suite's claims about the page (docs/trust.md): final values do not depend on zoom, cache or network and are those of `kilwa measure` to
// the last digit; provisional intervals contain them; what is cut away is never picked; a section fetches the leaves along the cut.
// Each claim prints a line `trust | claim | bound | measured`.
//
// What a person sees is read from the page; what only the engine knows (intervals, snapping, bytes fetched) is read from its module, in a page
// of its own (engine-page.mjs).

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { readFile } from "node:fs/promises";
import { promisify } from "node:util";
import { openEngine } from "./engine-page.mjs";
import { KILWA, canvasOf, fortSite, open, openTab, test, waitFor } from "./harness.mjs";
import { numbers, openRow } from "./measuring.mjs";

const run = promisify(execFile);

const site = fortSite({ proxied: true });

const fort = (query = "?error=8") => open(site.browser, `${site.server.url}/m/fort${query}`, { size: [900, 560] });

/** State a claim about a count of exceptions, which has to be zero. */
function claimNone(what, of, exceptions) {
  console.log(`trust | ${what} | 0 of ${of} | ${exceptions}`);
  assert.equal(exceptions, 0, what);
}

/** What the command line measures: its JSON, or the sentence of its refusal. */
async function native(tool, numbers, options = []) {
  const given = numbers.length > 0 ? ["--", ...numbers.map(String)] : [];
  try {
    const { stdout } = await run(KILWA, ["measure", site.pack, ...tool, ...options, "--json", ...given], { maxBuffer: 1 << 28 });
    return JSON.parse(stdout);
  } catch (error) {
    return { refusal: error.stderr.trim() };
  }
}

/** Places spread over the middle of a picture, as shares of its width and height. */
const SPREAD = Array.from({ length: 400 }, (_, k) => [0.25 + ((k * 0.754877666) % 1) * 0.5, 0.3 + ((k * 0.569840296) % 1) * 0.4]);

/** Rays through this many of the places that show the model, in the engine's own page. */
const raysOf = (page, n) =>
  page.evaluate(
    ([n, spread]) => {
      const { viewer, session } = globalThis.engineTest;
      const { width, height } = session.canvas;
      const rays = [];
      for (const [u, v] of spread) {
        const [x, y] = [u * width, v * height];
        const ray = [...viewer.ray(x, y)];
        if (rays.length < n && viewer.pick(x, y).length > 0) rays.push({ origin: ray.slice(0, 3), direction: ray.slice(3) });
      }
      return rays;
    },
    [n, SPREAD],
  );

/** The same in the viewer's page. */
async function seenRays(page, n) {
  const { width, height } = await canvasOf(page).boundingBox();
  return page.evaluate(
    ([n, places]) => {
      const { api } = globalThis.kilwa;
      return places.flatMap(([x, y]) => api.pick(x, y)?.ray ?? []).slice(0, n);
    },
    [n, SPREAD.map(([u, v]) => [u * width, v * height])],
  );
}

/** Final picks of rays, each with what was said before. */
const picksOf = (page, rays, options = {}) =>
  page.evaluate(
    async ([rays, options]) => {
      const { engine } = globalThis.engineTest;
      const out = [];
      for (const ray of rays) {
        let before;
        const final = await engine.pick(ray, { ...options, provisional: (p) => (before = p) });
        out.push({ before, final });
      }
      return out;
    },
    [rays, options],
  );

test("the same ray gives the same final place at ten zoom levels, cold and warm and on a slow line, which is that of the command line", async () => {
  const { page, complaints, close } = await openEngine(site.browser, site.server.url);
  const rays = await raysOf(page, 6);
  assert.equal(rays.length, 6);
  const wanted = [];
  for (const ray of rays) wanted.push(await native(["coordinate"], numbers([ray]), ["--rays"]));
  const seen = (picks) => picks.filter(({ final }, k) => JSON.stringify(final?.world) !== JSON.stringify(wanted[k].points[0].world)).length;
  let [picks, differing, outside, one] = [0, 0, 0, 0];
  for (let zoom = 0; zoom < 10; zoom += 1) {
    await page.evaluate((zoom) => {
      const { viewer, session } = globalThis.engineTest;
      const camera = viewer.camera();
      viewer.setCamera({ ...camera, distance: camera.distance * (zoom < 5 ? 0.6 : 2.2) });
      session.wake();
    }, zoom);
    if (zoom % 3 === 2) await page.evaluate(() => globalThis.engineTest.settled()); // else: whatever has arrived so far
    const found = await picksOf(page, rays);
    picks += found.length;
    differing += seen(found);
    for (const { before, final } of found) {
      if (!before || before.low === null || before.high === null) continue;
      one += 1;
      const along = Math.hypot(...final.world.map((v, i) => v - final.ray.origin[i]));
      if (along < before.low - 1e-6 || along > before.high + 1e-6) outside += 1;
    }
  }
  // The store of the engine is warm by now; another page begins cold, behind a line that is slow and breaks.
  site.proxy.mishap = ({ number }) => (number % 5 === 4 ? { drop: true } : null);
  const cold = await openEngine(site.browser, site.proxy.url);
  const late = await picksOf(cold.page, rays);
  differing += seen(late);
  picks += late.length;
  site.proxy.mishap = null;
  await cold.close();
  claimNone("final picks in the browser that depend on zoom, store or network", picks, differing);
  assert.ok(one > 0, "some picks had a provisional interval");
  claimNone("provisional intervals in the browser that do not contain the final pick", one, outside);
  assert.deepEqual(complaints, []);
  await close();
});

test("every tool prints the digits of the command line", async () => {
  const { page, complaints, close } = await openEngine(site.browser, site.server.url);
  const rays = await raysOf(page, 8);
  const found = (await picksOf(page, rays)).map(({ final }) => final.local);
  const x = 1.25;
  const measure = (task, unit) => page.evaluate(([task, unit]) => globalThis.engineTest.engine.measure(task, { unit }), [task, unit]);
  const origin = await page.evaluate(() => globalThis.engineTest.engine.pack.lattice.origin);
  const local = (p) => p.map((v, i) => v - origin[i]);
  const [a, b] = [
    [-20.5, -20.25, 0],
    [18.5, 12.75, 0],
  ];
  const cases = [
    [{ tool: "coordinate", local: found.slice(0, 1) }, ["coordinate"], 1],
    [{ tool: "distance", local: found.slice(0, 3) }, ["distance"], 3],
    [{ tool: "perimeter", local: found.slice(0, 4) }, ["distance", "--closed"], 4],
    [{ tool: "along", local: found.slice(0, 2) }, ["distance", "--along"], 2],
    [{ tool: "angle", local: found.slice(0, 3) }, ["angle"], 3],
    [{ tool: "plane-angle", local: found.slice(0, 6) }, ["angle", "--planes"], 6],
    [{ tool: "height", local: found.slice(0, 5) }, ["height"], 5],
    [{ tool: "circle", local: found.slice(0, 5) }, ["circle"], 5],
    [{ tool: "area", local: found.slice(0, 3), reach: 2 }, ["area", "--reach", "2"], 3],
    [{ tool: "cut-fill", local: found.slice(0, 3), reach: 2 }, ["volume", "--reach", "2"], 3],
    [{ tool: "deviation", local: found.slice(0, 3), reach: 2 }, ["deviation", "--reach", "2"], 3],
    [{ tool: "area" }, ["area"], 0],
    [{ tool: "volume" }, ["volume"], 0],
    [{ tool: "contours", interval: 2 }, ["contours", "--interval", "2"], 0],
    [{ tool: "section", plane: { point: local([x, 0, 0]), normal: [1, 0, 0] } }, ["section", `--x=${x}`], 0],
    [{ tool: "section", plane: { point: local([0, 0, 999]), normal: [0, 0, 1] } }, ["section", "--z=999"], 0],
  ];
  let [compared, differing] = [0, 0];
  for (const [task, tool, points] of cases) {
    for (const unit of points > 0 ? ["m", "us-ft"] : ["m"]) {
      const here = await measure(task, unit);
      const there = await native(tool, numbers(rays.slice(0, points)), ["--unit", unit, ...(points > 0 ? ["--rays"] : [])]);
      const same = here.refusal ? there.refusal?.includes(here.refusal) : JSON.stringify(here.printed) === JSON.stringify(there.printed);
      const bits = here.refusal || JSON.stringify(here.readings) === JSON.stringify(there.readings);
      compared += 1;
      if (!same || !bits) {
        differing += 1;
        console.log(`${tool.join(" ")}: ${here.refusal ?? JSON.stringify(here.printed)} / ${there.refusal ?? JSON.stringify(there.printed)}`);
      }
    }
  }
  // A profile is drawn in plan and takes positions.
  const here = await measure({ tool: "profile", local: [local(a), local(b)] }, "m");
  const there = await native(["profile"], [...a, ...b]);
  compared += 1;
  differing += JSON.stringify(here.printed) === JSON.stringify(there.printed) ? 0 : 1;
  claimNone("tools in the browser that differ from the command line in a digit or a sentence", compared, differing);
  assert.deepEqual(complaints, []);
  await close();
});

test("what is cut away is never picked, and what shows behind it is", async () => {
  const { page, complaints, close } = await openEngine(site.browser, site.server.url);
  const rays = await raysOf(page, 8);
  const open_ = await picksOf(page, rays);
  const clips = open_.map(({ final }) => ({
    // The plane stands a hand behind the place and takes away what is before it.
    clipPlane: { normal: final.ray.direction.map((v) => -v), point: final.world.map((v, i) => v + final.ray.direction[i] * 0.1) },
  }));
  const behind = await page.evaluate(
    async ([rays, clips]) => {
      const { engine, viewer } = globalThis.engineTest;
      const out = [];
      for (const [k, ray] of rays.entries()) {
        viewer.setDisplayState(JSON.stringify(clips[k]));
        let before;
        out.push({ final: await engine.pick(ray, { provisional: (p) => (before = p) }), before });
      }
      return out;
    },
    [rays, clips],
  );
  let [cut, seen] = [0, 0];
  for (const [k, { final, before }] of behind.entries()) {
    if (!final) continue;
    seen += 1;
    const { normal, point } = clips[k].clipPlane;
    const depth = normal.reduce((s, n, i) => s + n * (point[i] - final.world[i]), 0);
    const along = Math.hypot(...final.world.map((v, i) => v - final.ray.origin[i]));
    if (depth < -1e-6) cut += 1;
    if (before && before.low !== null && before.high !== null && (along < before.low - 1e-6 || along > before.high + 1e-6)) cut += 1;
  }
  claimNone("picks in the browser of what is cut away", behind.length, cut);
  assert.ok(seen > 0, "something stands behind");
  assert.deepEqual(complaints, []);
  await close();
});

test("a section fetches a part of the pack and reports how much; the second time it fetches nothing; a request can be cancelled", async () => {
  const { page, complaints, packs, close } = await openEngine(site.browser, site.server.url);
  await page.evaluate(() => globalThis.engineTest.settled());
  const before = packs.length;
  const [first, again, cancelled] = await page.evaluate(async () => {
    const { engine } = globalThis.engineTest;
    const task = { tool: "section", plane: { point: engine.pack.lattice.origin.map((v) => -v), normal: [1, 0, 0] } };
    let told = 0;
    const first = await engine.measure(task, { progress: ({ done, all }) => (told = all > 0 ? done / all : told) });
    const again = await engine.measure(task);
    const abort = new AbortController();
    const cancelled = engine.measure({ tool: "area" }, { signal: abort.signal }).then(
      () => "measured",
      (e) => e.name,
    );
    abort.abort();
    return [{ ...first, lines: first.lines.length, told }, { fetched: again.fetched, printed: again.printed }, await cancelled];
  });
  const asked = packs
    .slice(before)
    .map((range) => /bytes=(\d+)-(\d+)/.exec(range))
    .map(([, from, to]) => to - from + 1);
  assert.equal(first.told, 1);
  assert.ok(first.fetched > 0 && first.fetched <= first.read.bytes, "what the viewer knows to hold no leaf is not fetched");
  assert.ok(first.read.bytes < 0.7 * first.read.of_bytes, `${first.read.bytes} of ${first.read.of_bytes}`);
  assert.ok(asked.reduce((a, b) => a + b, 0) >= first.fetched);
  assert.equal(again.fetched, 0);
  assert.deepEqual(again.printed, first.printed);
  assert.equal(cancelled, "AbortError");
  console.log(`trust | bytes of the pack that a section in the browser reads, percent | any | ${((100 * first.read.bytes) / first.read.of_bytes).toFixed(1)}`);
  assert.deepEqual(complaints, []);
  await close();
});

test("points snap to vertices, creases and borders of the finest surface", async () => {
  const { page, complaints, close } = await openEngine(site.browser, site.server.url);
  const rays = await raysOf(page, 6);
  const step = await page.evaluate(() => globalThis.engineTest.engine.pack.step);
  const free = await picksOf(page, rays);
  for (const snap of ["vertex", "crease", "border"]) {
    const found = await picksOf(page, rays, { snap, within: 3 });
    const snapped = found.filter(({ final }) => final.snapped === snap);
    if (snap === "vertex") {
      assert.equal(snapped.length, 6);
      for (const { final } of snapped)
        assert.ok(
          final.local.every((v) => Number.isInteger(v / step)),
          "a lattice point",
        );
    }
    for (const [k, { final }] of found.entries()) {
      const moved = Math.hypot(...final.local.map((v, i) => v - free[k].final.local[i]));
      assert.ok(moved <= 3 && (final.snapped !== null || moved === 0), `${snap}: ${moved}`);
    }
  }
  assert.deepEqual(complaints, []);
  await close();
});

test("a deviation is shown as colours on the model, from its own plane and as far as it reaches", async () => {
  const { page, complaints, close } = await fort("?error=4");
  const rays = await seenRays(page, 3);
  const { state, readings } = await page.evaluate((one) => globalThis.kilwa.api.addMeasurement(one), { tool: "deviation", rays, reach: 2, name: "Wall" });
  assert.equal(state, "final");
  await openTab(page, "Measure");
  await (await openRow(page, "Wall")).getByRole("button", { name: "Show it as colours" }).click();
  await page.waitForFunction(() => globalThis.kilwa.api.mode === "distance");
  const { mode, plane, range } = await page.evaluate(() => globalThis.kilwa.api.state().display);
  assert.equal(mode, "distance");
  const there = await native(["deviation"], numbers(rays), ["--reach", "2", "--rays"]);
  assert.deepEqual(plane.point, there.plane.point);
  assert.deepEqual(plane.normal, there.plane.normal);
  const [lowest, highest] = ["lowest", "highest"].map((name) => readings.find((r) => r.name === name).value);
  const reach = Math.max(Math.abs(lowest), Math.abs(highest));
  assert.deepEqual(range, [-reach, reach]);
  await openTab(page, "Display");
  const display = page.getByRole("tabpanel", { name: "Display" });
  for (const [name, value] of [
    ["From, m", -reach],
    ["To, m", reach],
  ]) {
    const shown = Number(await display.getByLabel(name, { exact: true }).inputValue());
    assert.ok(Math.abs(shown - value) <= 1e-3 * reach, `${name}: ${shown} for ${value}`);
  }
  assert.deepEqual(complaints, []);
  await close();
});

test("a pack of this computer is measured without a server", async () => {
  const { page, complaints, packs, close } = await fort();
  const rays = await seenRays(page, 1);
  const pick = () => page.evaluate((rays) => globalThis.kilwa.api.addMeasurement({ tool: "coordinate", rays }), rays);
  const here = await pick();
  assert.equal(here.state, "final");
  await page
    .getByLabel("Open a file…")
    .first()
    .setInputFiles({ name: "mine.kilwa", mimeType: "", buffer: await readFile(site.pack) });
  const download = page.getByRole("banner").getByRole("link", { name: "Download pack" });
  while (!(await download.getAttribute("href")).startsWith("blob:")) await page.evaluate(() => new Promise(requestAnimationFrame));
  await waitFor(page, "settled");
  const before = packs.length;
  const mine = await pick();
  assert.deepEqual(mine.points, here.points);
  assert.deepEqual(mine.readings, here.readings);
  assert.equal(packs.length, before, "nothing is requested from the server");
  assert.deepEqual(complaints, []);
  await close();
});
