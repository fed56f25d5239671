// What measuring takes in the page on three simulated links: `node bench-measure.mjs PACK`. Prints Markdown on stdout. For each link an empty store: the time and the bytes
// from choosing a tool to the first final pick (the program that measures, the directory, the leaves), those of a second pick elsewhere, and a full
// section on the link without a limit. The viewer's own picture is at rest before.

import { launch, open, packFolder, serve, waitFor } from "./harness.mjs";

const [pack] = process.argv.slice(2);
process.env.KILWA_PACK = pack;
const LINKS = [
  ["unlimited", null],
  ["10 Mbit/s, 50 ms", { bits: 10e6, latency: 50 }],
  ["2 Mbit/s, 300 ms", { bits: 2e6, latency: 300 }],
];
const server = await serve(await packFolder());
const browser = await launch();

async function onLink([name, link]) {
  const { page, close } = await open(browser, `${server.url}/m/fort?error=8`, { size: [1280, 720] });
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
  await page.waitForTimeout(500);
  await waitFor(page, "settled");
  bytes = { program: 0, pack: 0, requests: 0 };
  const pick = (x, y) =>
    page.evaluate(
      async ([x, y]) => {
        const { viewer, session } = globalThis.kilwa;
        const ray = viewer.ray(session.canvas.width * x, session.canvas.height * y);
        const began = performance.now();
        const engine = await globalThis.kilwa.engine();
        const opened = performance.now() - began;
        const found = await engine.pick({ origin: [...ray.slice(0, 3)], direction: [...ray.slice(3, 6)] }, {});
        return { opened, took: performance.now() - began, fetched: found?.fetched, isFound: Boolean(found) };
      },
      [x, y],
    );
  const first = await pick(0.5, 0.55);
  const all = { ...bytes };
  const second = await pick(0.4, 0.5);
  const s = (ms) => (ms / 1000).toFixed(2);
  const kb = (n) => Math.round(n / 1000);
  console.log(
    `| ${name} | ${s(first.took)} | ${s(first.opened)} | ${kb(all.program)} | ${kb(all.pack)} in ${all.requests} | ${kb(first.fetched)} | ${s(second.took)} | ${kb(second.fetched)} |`,
  );
  if (!link) {
    const section = await page.evaluate(async () => {
      const engine = await globalThis.kilwa.engine();
      const { bounds_min: low, bounds_max: high } = globalThis.kilwa.info.metadata;
      const { origin } = globalThis.kilwa.info.pack.lattice;
      const point = low.map((v, i) => (v + high[i]) / 2 - origin[i]);
      const times = [];
      let found;
      for (const normal of [
        [0, -1, 0],
        [1, 0, 0],
        [0, 0, 1],
      ]) {
        const began = performance.now();
        found = await engine.measure({ tool: "section", plane: { point, normal } });
        times.push({
          ms: performance.now() - began,
          read: found.read,
          refusal: found.refusal,
          fetched: found.fetched,
          points: found.lines?.reduce((n, l) => n + l.world.length, 0),
        });
      }
      return times;
    });
    for (const [k, t] of section.entries())
      console.error(`section ${"yxz"[k]}: ${t.refusal ?? `${s(t.ms)} s, ${t.points} points, ${kb(t.read.bytes)} kB of ${kb(t.read.of_bytes)}`}`);
  }
  await close();
}

console.log(
  "| link | first pick, s | of it until open | program, kB | of the pack, kB | of it leaves, kB | second pick, s | leaves, kB |\n|---|---|---|---|---|---|---|---|",
);
for (const link of LINKS) await onLink(link);
await browser.close();
await server.stop();
