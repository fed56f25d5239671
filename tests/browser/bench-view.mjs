// What the page takes on three simulated links: `node bench-view.mjs PACK [--soak MINUTES] [--quick]`, run by
// `cargo xtask bench view`. Prints Markdown on stdout, what it does on stderr.
//
// Chromium emulates the link on the page's requests (CDP). As for the peers there, draws are counted but not executed (`--draw`
// executes them): without a graphics card they would take the processor from everything else. Medians of three loads, each in a new
// window that has stood open for two seconds, with an empty store; `--quick` makes one.

import { readFileSync } from "node:fs";
import { launch, packFolder, serve, stats, waitFor } from "./harness.mjs";

const [pack, ...options] = process.argv.slice(2);
process.env.KILWA_PACK = pack;
const LINKS = [
  ["unlimited", null],
  ["10 Mbit/s, 50 ms", { bits: 10e6, latency: 50 }],
  ["2 Mbit/s, 300 ms", { bits: 2e6, latency: 300 }],
];
const SIZE = { width: 1280, height: 720 };
const server = await serve(await packFolder());
const browser = await launch();
const say = (text) => process.stderr.write(`${text}\n`);
const median = (values) => values.toSorted((a, b) => a - b)[values.length >> 1];

async function fresh(link, address) {
  const context = await browser.newContext({ viewport: SIZE });
  const page = await context.newPage();
  page.setDefaultTimeout(300_000);
  // Lengths of the head that were requested: if the metadata is long, the last one is the true length.
  const heads = [];
  page.on("request", (request) => {
    const last = /^bytes=0-(\d+)$/.exec(request.headers().range ?? "")?.[1];
    if (last) heads.push(Number(last) + 1);
  });
  const client = await context.newCDPSession(page);
  await client.send("Network.enable");
  await client.send("Network.setCacheDisabled", { cacheDisabled: true });
  await emulate(client, link);
  if (!options.includes("--draw")) {
    await page.addInitScript(() => {
      for (const name of ["draw", "drawIndexed"]) globalThis.GPURenderPassEncoder.prototype[name] = () => {};
    });
  }
  await page.addInitScript(() => {
    globalThis.long = { count: 0, ms: 0 };
    new PerformanceObserver((list) => {
      for (const entry of list.getEntries()) {
        globalThis.long.count += 1;
        globalThis.long.ms += entry.duration;
      }
    }).observe({ type: "longtask" });
    // The moments are taken in the page itself, after each of its frames, not from outside.
    globalThis.moments = {};
    let kilwa;
    Object.defineProperty(globalThis, "kilwa", {
      get: () => kilwa,
      set(parts) {
        kilwa = parts;
        parts.api.on("frame", (s) => {
          const { moments } = globalThis;
          if (s.trianglesDrawn > 0) moments.first ??= performance.now();
          if (!s.targetReached) return;
          moments.target ??= performance.now();
          moments.stats ??= s;
        });
      },
    });
  });
  // Part of what is measured: a new window keeps the browser itself busy for a while; people enter an address in one that is already open.
  await page.waitForTimeout(2000);
  await page.goto(address);
  return { page, client, heads, close: () => context.close() };
}

const emulate = (client, link) =>
  client.send("Network.emulateNetworkConditions", {
    offline: false,
    latency: link?.latency ?? 0,
    downloadThroughput: link ? link.bits / 8 : -1,
    uploadThroughput: link ? link.bits / 8 : -1,
  });

async function load(link, query) {
  const { page, heads, close } = await fresh(link, `${server.url}/m/fort?${query}`);
  await page.waitForFunction(() => globalThis.moments.stats, null, { polling: 100 });
  const { first, target, stats } = await page.evaluate(() => globalThis.moments);
  const long = await page.evaluate(() => globalThis.long);
  await close();
  return { first, target, stats, long, head: heads.at(-1) };
}

async function loads() {
  // All of it from the front, and one metre of it (azimuth of south, level, parallel off).
  const front = [Math.PI, 0];
  const { page, close } = await fresh(null, `${server.url}/m/fort?err=16`);
  await waitFor(page, "first");
  const { bounds_min: min, bounds_max: max } = (await page.evaluate(() => globalThis.kilwa.api.info())).metadata;
  const { adapter } = await stats(page);
  await close();
  const middle = [0, 1, 2].map((i) => (min[i] + max[i]) / 2);
  const tan = Math.tan(0.35);
  const aspect = 1.5; // of the canvas, about: panel and bars beside it
  const far = Math.max((max[0] - min[0]) / 2 / tan / aspect, (max[2] - min[2]) / 2 / tan) * 1.04;
  const at = (distance, y) => [...front, distance, middle[0], y, middle[2], 0].join(",");
  const views = [
    ["all, 1 px", `err=1&cam=${at(far, middle[1])}`],
    ["all, 0.5 px", `err=0.5&cam=${at(far, middle[1])}`],
    ["1 m wide, 1 px", `err=1&cam=${at(0.5 / tan / aspect, min[1])}`],
  ];
  console.log(`Chromium ${browser.version()}, ${SIZE.width} x ${SIZE.height} window, adapter ${adapter || "WebGPU, unnamed"}.\n`);
  console.log("| view | link | first picture s | target s | MB of the pack | requests of the pack | triangles | tasks over 50 ms | s in them |");
  console.log("|---|---|---:|---:|---:|---:|---:|---:|---:|");
  const times = options.includes("--quick") ? 1 : 3;
  for (const [name, query] of views) {
    for (const [linkName, link] of LINKS) {
      const all = [];
      for (let k = 0; k < times; k += 1) all.push(await load(link, query));
      const m = (of) => median(all.map(of));
      const s = all[0].stats;
      say(`${name}, ${linkName}: ${(m((l) => l.target) / 1e3).toFixed(2)} s`);
      const cells = [
        name,
        linkName,
        (m((l) => l.first) / 1e3).toFixed(2),
        (m((l) => l.target) / 1e3).toFixed(2),
        (m((l) => l.stats.bytesReceived + l.head) / 1e6).toFixed(2),
        m((l) => l.stats.requests),
        s.trianglesDrawn,
        m((l) => l.long.count),
        (m((l) => l.long.ms) / 1e3).toFixed(2),
      ];
      console.log(`| ${cells.join(" | ")} |`);
    }
  }
}

/** Resident memory of the browser's processes, bytes: of those that run pages, of the one that draws, and of all. What a leak on the GPU's side shows in, too. */
function resident() {
  const sum = { renderer: 0, gpu: 0, all: 0 };
  const add = (pid) => {
    const bytes = Number(/VmRSS:\s+(\d+)/.exec(readFileSync(`/proc/${pid}/status`, "utf8"))?.[1] ?? 0) * 1024;
    const kind = /--type=(renderer|gpu)/.exec(readFileSync(`/proc/${pid}/cmdline`, "utf8"))?.[1];
    if (kind) sum[kind] += bytes;
    sum.all += bytes;
    children(pid).forEach(add);
  };
  const children = (pid) => readFileSync(`/proc/${pid}/task/${pid}/children`, "utf8").trim().split(/\s+/).filter(Boolean).map(Number);
  try {
    children(process.pid).forEach(add);
    return sum;
  } catch {
    return { renderer: NaN, gpu: NaN, all: NaN };
  }
}

/** Flights between places with stops, 5 % of all requests failing, at 100 Mbit/s. */
async function soak(minutes) {
  const { page, client, close } = await fresh({ bits: 100e6, latency: 10 }, "about:blank");
  let number = 0;
  await page.route("**/packs/**", async (route) => {
    number += 1;
    // Every twentieth, but not the head: the page would wait for it without a model.
    if (number % 20 === 7) await route.fulfill({ status: 500 });
    else await route.continue();
  });
  await page.goto(`${server.url}/m/fort?err=1&memory=64`);
  await waitFor(page, "first");
  const rows = [];
  const waits = [];
  const ends = Date.now() + minutes * 60_000;
  let random = 1;
  const next = () => {
    random = (Math.imul(random, 1664525) + 1013904223) >>> 0;
    return random / 2 ** 32;
  };
  let round = 0;
  while (Date.now() < ends) {
    const to = [next(), next(), next()];
    // A glide of two seconds, then a stop until the target is there.
    const waited = await page.evaluate(async ([u, v, w]) => {
      const { api } = globalThis.kilwa;
      const { bounds_min: min, bounds_max: max } = api.info().metadata;
      const from = api.getCamera();
      const target = [min[0] + u * (max[0] - min[0]), min[1], min[2] + v * (max[2] - min[2])];
      const goal = { azimuth: Math.PI + (u - 0.5), elevation: 0.2 * v, distance: 0.5 + 8 * w * w };
      const begun = performance.now();
      for (;;) {
        const t = Math.min(1, (performance.now() - begun) / 2000);
        const between = (a, b) => a + (b - a) * t;
        const [azimuth, elevation, distance] = ["azimuth", "elevation", "distance"].map((name) => between(from[name], goal[name]));
        api.setCamera({ ...from, azimuth, elevation, distance, target: target.map((x, i) => between(from.target[i], x)), orthographic: false });
        if (t === 1) break;
        await new Promise(requestAnimationFrame);
      }
      const stopped = performance.now();
      await new Promise((resolve) => {
        const end = api.on("frame", ({ targetReached, budgetLimited, chunksMissing }) => {
          if (!targetReached && !(budgetLimited && chunksMissing === 0)) return;
          end();
          resolve();
        });
      });
      return performance.now() - stopped;
    }, to);
    waits.push(waited);
    round += 1;
    if (round % 5 === 0) {
      await client.send("HeapProfiler.collectGarbage");
      const { usedSize } = await client.send("Runtime.getHeapUsage");
      const s = await stats(page);
      rows.push([round, usedSize, s.gpuBytesHeld, resident(), s.failures, s.bytesReceived]);
      say(`stop ${round}: ${(waited / 1e3).toFixed(2)} s, JS heap ${(usedSize / 1e6).toFixed(1)} MB, GPU ${(s.gpuBytesHeld / 1e6).toFixed(1)} MB`);
    }
  }
  await close();
  const sorted = waits.toSorted((a, b) => a - b);
  console.log(`\n### Soak: ${minutes} minutes at 100 Mbit/s, 5 % of the requests refused, 64 MB for the model\n`);
  console.log(
    `${waits.length} stops; the target (or what the memory allows) after a stop: median ${(sorted[sorted.length >> 1] / 1e3).toFixed(2)} s, longest ${(sorted.at(-1) / 1e3).toFixed(2)} s.\n`,
  );
  console.log(
    "| stop | JS heap MB | GPU memory of chunks MB | resident: pages MB | drawing MB | all of the browser MB | failures | received MB |\n|---:|---:|---:|---:|---:|---:|---:|---:|",
  );
  for (const [n, heap, gpu, rss, failures, received] of rows) {
    const cells = [
      n,
      ...[heap, gpu, rss.renderer, rss.gpu, rss.all].map((bytes, i) => (bytes / 1e6).toFixed(i < 2 ? 1 : 0)),
      failures,
      (received / 1e6).toFixed(0),
    ];
    console.log(`| ${cells.join(" | ")} |`);
  }
}

try {
  if (!options.includes("--no-loads")) await loads();
  const minutes = Number(options[options.indexOf("--soak") + 1]);
  if (options.includes("--soak") && minutes > 0) await soak(minutes);
} finally {
  await browser.close();
  await server.stop();
}
