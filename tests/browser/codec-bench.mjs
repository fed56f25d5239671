// How fast a worker of Chromium decodes: `node codec-bench.mjs FOLDER PACK...`, FOLDER with the page's decode.js and
// decode_bg.wasm. One line of JSON comes out: the browser, and for each pack the triangles and the seconds that they take, each
// chunk at its fastest of some rounds, so that what else the machine does counts little. Timed is what the page's worker does with a
// chunk: checksum, decoding, the arrays out of the module.
// Environment: CHROMIUM (default /usr/bin/chromium). `cargo xtask bench codec` runs it.

import { readFile } from "node:fs/promises";
import http from "node:http";
import path from "node:path";
import { chromium } from "playwright-core";

const ROUNDS = 25;

/** What the worker runs; it sees nothing of this file. */
async function worker() {
  const { default: init, decode } = await import("/decode.js");
  await init({ module_or_path: "/decode_bg.wasm" });

  /** The chunks that a pack's directory names: docs/FORMAT.md, sections 3 and 4. */
  const chunksOf = (pack) => {
    const view = new DataView(pack.buffer);
    const at64 = (at) => Number(view.getBigUint64(at, true));
    const [count, first, others] = [view.getUint32(84, true), at64(104), at64(112)];
    const [colors, scalars] = [pack[144] === 1, pack[145]];
    return Array.from({ length: count }, (_, i) => {
      const page = Math.floor(i / 127);
      const at = (page === 0 ? first : others + (page - 1) * 16384) + 128 * ((i % 127) + 1);
      const [from, length] = [at64(at), view.getUint32(at + 8, true)];
      return {
        bytes: pack.slice(from, from + length),
        vertices: view.getUint32(at + 12, true),
        triangles: view.getUint32(at + 16, true),
        colors,
        scalars,
        checksum: pack.slice(at + 104, at + 120),
      };
    });
  };

  /** Decode each chunk once; `fastest` keeps the least seconds of each. */
  const round = (chunks, fastest) => {
    for (const [i, c] of chunks.entries()) {
      const begin = performance.now();
      const decoded = decode(c.bytes, c.vertices, c.triangles, c.colors, c.scalars, c.checksum);
      const indices = decoded.takeIndices().length;
      decoded.takeVertices();
      decoded.takePatches();
      decoded.takeScalars();
      decoded.free();
      fastest[i] = Math.min(fastest[i], (performance.now() - begin) / 1000);
      if (indices !== 3 * c.triangles) throw new Error("a chunk came back with other triangles");
    }
  };

  addEventListener("message", async ({ data: { url, rounds } }) => {
    const answer = await fetch(url);
    const chunks = chunksOf(new Uint8Array(await answer.arrayBuffer()));
    const fastest = chunks.map(() => Infinity);
    for (let i = 0; i < rounds; i += 1) round(chunks, fastest);
    const sum = (numbers) => numbers.reduce((a, b) => a + b, 0);
    postMessage({ seconds: sum(fastest), triangles: sum(chunks.map((c) => c.triangles)) });
  });
  postMessage("ready");
}

const [folder, ...packs] = process.argv.slice(2);
if (packs.length === 0) throw new Error("usage: node codec-bench.mjs FOLDER PACK...");

const served = {
  "/": ["text/html", "<!doctype html><title>codec</title>"],
  "/worker.js": ["text/javascript", `(${worker})();`],
  "/decode.js": ["text/javascript", await readFile(path.join(folder, "decode.js"))],
  "/decode_bg.wasm": ["application/wasm", await readFile(path.join(folder, "decode_bg.wasm"))],
};
for (const [i, pack] of packs.entries()) served[`/pack${i}`] = ["application/octet-stream", await readFile(pack)];
const server = http.createServer((request, response) => {
  const [type, body] = served[request.url] ?? [];
  // Isolated, so that the clock has its full resolution.
  const isolated = { "cross-origin-opener-policy": "same-origin", "cross-origin-embedder-policy": "require-corp" };
  response.writeHead(body === undefined ? 404 : 200, { "content-type": type ?? "text/plain", ...isolated });
  response.end(body);
});
await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));

const browser = await chromium.launch({ executablePath: process.env.CHROMIUM || "/usr/bin/chromium", args: ["--no-sandbox"] });
try {
  const page = await browser.newPage();
  page.setDefaultTimeout(600_000);
  await page.goto(`http://127.0.0.1:${server.address().port}/`);
  const results = await page.evaluate(
    async ({ count, rounds }) => {
      const worker = new Worker("/worker.js", { type: "module" });
      const next = (ask) =>
        new Promise((resolve, reject) => {
          worker.onmessage = ({ data }) => resolve(data);
          worker.onerror = (event) => reject(new Error(event.message));
          if (ask) worker.postMessage(ask);
        });
      await next();
      const results = [];
      for (let i = 0; i < count; i += 1) results.push(await next({ url: `/pack${i}`, rounds }));
      return results;
    },
    { count: packs.length, rounds: ROUNDS },
  );
  console.log(JSON.stringify({ browser: `Chromium ${browser.version()}`, rounds: ROUNDS, packs: results }));
} finally {
  await browser.close();
  server.close();
}
