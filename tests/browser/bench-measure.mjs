// What measuring takes in the page on three simulated links: `node bench-measure.mjs PACK`. Prints Markdown on stdout. For each link an empty store: the time and the bytes
// from asking for a measurement to the first final pick (the program that measures, the directory, the leaves), and those of a second pick elsewhere. The viewer's own
// picture is at rest before. The share of leaves, and the cost of full sections, come from the measuring engine in a page of its own (engine-page.mjs), without a limit.

import { openEngine } from "./engine-page.mjs";
import { launch, open, SHARP, packFolder, pick, serve, waitFor } from "./harness.mjs";

const [pack] = process.argv.slice(2);
process.env.KILWA_PACK = pack;
const LINKS = [
  ["unlimited", null],
  ["10 Mbit/s, 50 ms", { bits: 10e6, latency: 50 }],
  ["2 Mbit/s, 300 ms", { bits: 2e6, latency: 300 }],
];
const s = (ms) => (ms / 1000).toFixed(2);
const kb = (n) => Math.round(n / 1000);
let leaves;
const server = await serve(await packFolder());
const browser = await launch();

async function onLink([name, link]) {
  const { page, close } = await open(browser, `${server.url}/m/fort?error=8`, { ...SHARP, size: [1280, 720] });
  const client = await page.context().newCDPSession(page);
  await client.send("Network.enable");
  const loaded = new Map();
  let bytes = { program: 0, pack: 0, requests: 0 };
  client.on("Network.responseReceived", ({ requestId, response }) => loaded.set(requestId, response.url));
  client.on("Network.loadingFinished", ({ requestId, encodedDataLength }) => {
    const isPack = loaded.get(requestId)?.includes("/packs/");
    bytes[isPack ? "pack" : "program"] += encodedDataLength;
    bytes.requests += isPack ? 1 : 0;
  });
  const rate = link ? link.bits / 8 : -1;
  await client.send("Network.emulateNetworkConditions", { offline: false, latency: link?.latency ?? 0, downloadThroughput: rate, uploadThroughput: rate });
  await waitFor(page, "settled");
  const rays = [(await pick(page, 0.5, 0.55)).ray, (await pick(page, 0.4, 0.5)).ray];
  if (!leaves) {
    const { metadata } = await page.evaluate(() => globalThis.kilwa.api.info());
    const middle = metadata.bounds_min.map((v, i) => (v + metadata.bounds_max[i]) / 2);
    leaves = await ofEngine(rays, middle);
  }
  bytes = { program: 0, pack: 0, requests: 0 };
  const measure = (ray) =>
    page.evaluate(async (ray) => {
      const { api } = globalThis.kilwa;
      const began = performance.now();
      await api.measurements(); // loads what the page needs for measuring
      const loaded = performance.now() - began;
      const { state } = await api.addMeasurement({ tool: "coordinate", rays: [ray] });
      return { loaded, took: performance.now() - began, state };
    }, ray);
  const first = await measure(rays[0]);
  const all = { ...bytes };
  const second = await measure(rays[1]);
  for (const { state } of [first, second]) if (state !== "final") throw new Error(`the pick is ${state}`);
  console.log(
    `| ${name} | ${s(first.took)} | ${s(first.loaded)} | ${kb(all.program)} | ${kb(all.pack)} in ${all.requests} | ${kb(leaves[0])} | ${s(second.took)} | ${kb(leaves[1])} |`,
  );
  await close();
}

/** Bytes of the leaves that picks along these rays fetch, one after the other; also prints the cost of sections through a place. */
async function ofEngine(rays, middle) {
  const { page, close } = await openEngine(browser, server.url);
  const { fetched, sections } = await page.evaluate(
    async ([rays, middle]) => {
      const { engine } = globalThis.engineTest;
      const fetched = [];
      for (const ray of rays) fetched.push((await engine.pick(ray, {})).fetched);
      const point = middle.map((v, i) => v - engine.pack.lattice.origin[i]);
      const sections = [];
      for (const normal of [
        [0, -1, 0],
        [1, 0, 0],
        [0, 0, 1],
      ]) {
        const began = performance.now();
        const { read, refusal, lines } = await engine.measure({ tool: "section", plane: { point, normal } });
        sections.push({ ms: performance.now() - began, read, refusal, points: lines?.reduce((n, l) => n + l.world.length, 0) });
      }
      return { fetched, sections };
    },
    [rays, middle],
  );
  for (const [k, t] of sections.entries())
    console.error(`section ${"yxz"[k]}: ${t.refusal ?? `${s(t.ms)} s, ${t.points} points, ${kb(t.read.bytes)} kB of ${kb(t.read.of_bytes)}`}`);
  await close();
  return fetched;
}

console.log(
  "| link | first pick, s | of it until measuring is loaded | program, kB | of the pack, kB | of it leaves, kB | second pick, s | leaves, kB |\n|---|---|---|---|---|---|---|---|",
);
for (const link of LINKS) await onLink(link);
await browser.close();
await server.stop();
