// What streaming costs before the first pixel, and a server that refuses every third request.

import assert from "node:assert/strict";
import { after, before } from "node:test";
import { hostile, launch, open, packFolder, picture, serve, stats, test, waitFor } from "./harness.mjs";

/** All bytes over the wire before the first pixel, as the server packs them (issue 5): readers on slow links are the audience. */
const FIRST_PIXEL_MAX = 380_000;
let server;
let proxy;
let browser;

before(async () => {
  server = await serve(await packFolder());
  proxy = await hostile(server.url);
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await proxy?.stop();
  await server?.stop();
});

test("before the first pixel the pack costs one request of 64 KiB, asked for before the program has come", async () => {
  const events = [];
  // What is fetched after the picture does not count: it is held back until the sum is taken.
  let release;
  const held = new Promise((resolve) => (release = resolve));
  const { page, close } = await open(browser, `${server.url}/m/fort`, {
    wait: "first",
    before: async (page) => {
      await page.route("**/packs/**", async (route) => {
        if (!route.request().headers().range?.startsWith("bytes=0-")) await held;
        await route.continue().catch(() => {});
      });
      const client = await page.context().newCDPSession(page);
      await client.send("Network.enable");
      const names = new Map();
      client.on("Network.requestWillBeSent", ({ requestId, request }) => {
        names.set(requestId, new URL(request.url).pathname);
        events.push({ sent: names.get(requestId) });
      });
      client.on("Network.loadingFinished", ({ requestId, encodedDataLength }) => {
        events.push({ came: names.get(requestId), bytes: encodedDataLength });
      });
    },
  });
  const seen = events.slice();
  const at = (what, name) => seen.findIndex((e) => e[what]?.endsWith(name));
  assert.ok(at("sent", ".kilwa") < at("came", "viewer_bg.wasm"), "head and program come at the same time");
  const drawn = await page.evaluate(() => performance.getEntriesByType("resource").filter((e) => e.name.endsWith(".kilwa")));
  assert.ok(drawn.length >= 1);
  const total = seen.reduce((sum, e) => sum + (e.bytes ?? 0), 0);
  assert.ok(total <= FIRST_PIXEL_MAX, `${total} bytes before the first pixel`);
  console.log(`# ${total} bytes before the first pixel`);
  release();
  await close();
});

test("a server that refuses or drops every third request gives the same picture in the end", async () => {
  const right = await open(browser, `${proxy.url}/m/fort?error=2`);
  const wanted = await picture(right.page);
  await right.close();
  // Seeded: which requests fail is the same in every run.
  let seed = 7;
  let mishaps = 0;
  proxy.mishap = ({ range }) => {
    seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
    const chance = seed / 2 ** 32;
    if (range[0] === 0 || chance > 0.35) return null;
    mishaps += 1;
    return chance < 0.3 ? { status: 503 } : { drop: true };
  };
  const { page, close } = await open(browser, `${proxy.url}/m/fort?error=2`, { wait: "first" });
  await waitFor(page, "settled");
  const s = await stats(page);
  assert.ok(mishaps > 0 && s.failures >= mishaps, `${mishaps} mishaps, ${s.failures} noticed`);
  assert.ok(s.targetReached);
  assert.deepEqual(await picture(page), wanted);
  await close();
  proxy.mishap = null;
});
