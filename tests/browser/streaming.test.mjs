// What streaming costs before the first pixel, and a server that refuses every third request.

import assert from "node:assert/strict";
import { SHARP, fortSite, open, picture, stats, test, waitFor } from "./harness.mjs";

/** All bytes over the wire before the first pixel, as the server packs them: readers on slow links are the audience. The decoder has
 * two codecs since format 1.1. */
const FIRST_PIXEL_MAX = 400_000;

const site = fortSite({ proxied: true });

test("before the first pixel the pack costs one request of 64 KiB, asked for before the program has come", async () => {
  const events = [];
  // What is fetched after the picture does not count: it is held back until the sum is taken.
  let release;
  const held = new Promise((resolve) => (release = resolve));
  const { page, close } = await open(site.browser, `${site.server.url}/m/fort`, {
    ...SHARP,
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
  const decoder = [at("sent", "decode_bg.wasm"), at("sent", "decode-worker.js")];
  assert.ok(
    decoder.every((i) => i >= 0 && i < at("came", "viewer_bg.wasm")),
    "and so does what decodes",
  );
  const drawn = await page.evaluate(() => performance.getEntriesByType("resource").filter((e) => e.name.endsWith(".kilwa")));
  assert.ok(drawn.length >= 1);
  const total = seen.reduce((sum, e) => sum + (e.bytes ?? 0), 0);
  assert.ok(total <= FIRST_PIXEL_MAX, `${total} bytes before the first pixel`);
  console.log(`# ${total} bytes before the first pixel`);
  release();
  await close();
});

test("a server that refuses or drops every third request gives the same picture in the end", async () => {
  const right = await open(site.browser, `${site.proxy.url}/m/fort?error=2`, SHARP);
  const wanted = await picture(right.page);
  await right.close();
  // Seeded: which requests fail is the same in every run.
  let seed = 10;
  let [refused, dropped] = [0, 0];
  site.proxy.mishap = ({ range }) => {
    seed = (Math.imul(seed, 1664525) + 1013904223) >>> 0;
    const chance = seed / 2 ** 32;
    if (range[0] === 0 || chance > 0.35) return null;
    if (chance < 0.3) {
      refused += 1;
      return { status: 500 };
    }
    dropped += 1;
    return { drop: true };
  };
  const { page, close } = await open(site.browser, `${site.proxy.url}/m/fort?error=2`, { ...SHARP, wait: "first" });
  await waitFor(page, "settled");
  const s = await stats(page);
  // A browser itself repeats a request whose connection, used before, is dropped; the page sees nothing of that.
  assert.ok(refused > 0 && s.failures >= refused, `${refused} refused and ${dropped} dropped, ${s.failures} noticed`);
  assert.ok(s.targetReached);
  assert.deepEqual(await picture(page), wanted);
  await close();
  site.proxy.mishap = null;
});

/**
 * Runs in the page before its own scripts. Frames are given late, or (`hold`) not at all from the first picture on. `globalThis.seen` says what
 * the page did: when it drew the model last, how long it paused from a frame of the model until it asked for the next one, what was decoded,
 * and how many answers with bytes of the pack are there.
 */
function watch({ late = 0, hold = false }) {
  const { requestAnimationFrame } = globalThis;
  const seen = { pauses: [], drewAt: null, waiting: 0, jobs: 0, answers: 0, arrived: 0, byPerson: false, inPause: null };
  globalThis.seen = seen;
  new PerformanceObserver((list) => {
    for (const { name } of list.getEntries()) seen.arrived += Number(new URL(name).pathname.startsWith("/packs/"));
  }).observe({ type: "resource", buffered: true });
  const isReady = () => Boolean(globalThis.kilwa?.api.isReady);
  const frames = () => globalThis.kilwa?.api.stats()?.frames ?? 0;
  const held = [];
  let isInside = false;
  const run = (callback, pause) => (now) => {
    const before = frames();
    seen.waiting -= 1;
    isInside = true;
    callback(now);
    isInside = false;
    if (frames() === before) return; // other parts of the page ask for frames, too
    if (pause !== null) seen.pauses.push(pause);
    seen.drewAt = isReady() ? performance.now() : null;
  };
  globalThis.release = () => {
    hold = false;
    for (const callback of held.splice(0)) requestAnimationFrame(run(callback, null));
  };
  globalThis.requestAnimationFrame = (callback) => {
    seen.waiting += 1;
    if (hold && isReady()) return held.push(callback);
    const since = isInside ? 0 : performance.now() - seen.drewAt;
    const pause = seen.drewAt === null || seen.byPerson ? null : since;
    return setTimeout(() => requestAnimationFrame(run(callback, pause)), late); // the simulated browser's delay
  };
  globalThis.Worker = class extends Worker {
    constructor(...what) {
      super(...what);
      this.addEventListener("message", () => {
        seen.answers += 1;
        // Once the page has processed it: something has arrived, and no frame is requested.
        setTimeout(() => isReady() && seen.waiting === 0 && seen.inPause?.());
      });
    }
    postMessage(data, transfer) {
      if (data.job) seen.jobs += 1;
      super.postMessage(data, transfer);
    }
  };
}

test("while the browser gives no frames the model goes on coming, for two seconds", async () => {
  // Answers come late enough that there is something to come after two seconds.
  let release;
  const released = new Promise((resolve) => (release = resolve));
  const { page, close } = await open(site.browser, `${site.server.url}/m/fort?error=0.5`, {
    ...SHARP,
    wait: "first",
    before: async (page) => {
      await page.clock.install();
      await page.addInitScript(watch, { hold: true });
      let asked = 0;
      await page.route("**/packs/**", async (route) => {
        asked += 1;
        if (asked === 3) await released;
        await route.continue().catch(() => {});
      });
    },
  });
  const now = () =>
    page.evaluate(() => {
      const { frames, requests } = globalThis.kilwa.api.stats();
      return { frames, decoded: globalThis.seen.jobs, requests };
    });
  const first = await now();
  // Longer than the two seconds, and what was begun in them is decoded.
  await page.waitForFunction(() => performance.now() - globalThis.seen.drewAt > 2500 && globalThis.seen.jobs === globalThis.seen.answers, null, {
    polling: 50,
  });
  const held = await now();
  assert.ok(held.frames <= first.frames + 1, "one frame may have been asked for already");
  assert.ok(held.decoded > first.decoded + 10, JSON.stringify({ first, held }));
  // Nobody looks: what comes now leads to nothing.
  assert.ok((await page.evaluate(() => globalThis.seen.arrived)) < held.requests, "something is still to come");
  release();
  await page.waitForFunction((requests) => globalThis.seen.arrived === requests, held.requests, { polling: 50 });
  await page.clock.runFor(10_000); // by the page's clock: everything that it does later happens at once
  assert.deepEqual(await now(), held);
  await page.evaluate(() => globalThis.release());
  await waitFor(page, "settled");
  assert.ok((await now()).decoded > held.decoded, "what came late was worth decoding");
  assert.ok((await stats(page)).targetReached);
  await close();
});

test("where frames are slow to come, what came by itself leaves as long to what fetches and decodes, and what a person does is drawn at once", async () => {
  const { page, close } = await open(site.browser, `${site.server.url}/m/fort?error=0.5`, {
    ...SHARP,
    wait: null,
    reducedMotion: "no-preference",
    before: (page) => page.addInitScript(watch, { late: 150 }),
  });
  // A person interrupts a pause.
  await page.evaluate(() => {
    const { seen } = globalThis;
    seen.inPause = () => {
      seen.inPause = null;
      const { api } = globalThis.kilwa;
      seen.byPerson = true;
      api.setCamera(api.getCamera());
      seen.byPerson = false;
      seen.asked = seen.waiting;
    };
  });
  await waitFor(page, "settled");
  const { pauses, asked } = await page.evaluate(() => ({ ...globalThis.seen, inPause: null }));
  assert.equal(asked, 1, "there was a pause, during which a frame was requested at once");
  assert.ok(pauses.length >= 3, "else this shows nothing");
  assert.ok(
    pauses.every((ms) => ms >= 100),
    pauses.join(" "),
  );
  await close();
});

test("what decodes is asked for again where it did not come", async () => {
  let refused = 0;
  const { page, close } = await open(site.browser, `${site.server.url}/m/fort?error=4`, {
    ...SHARP,
    before: (page) =>
      page.route("**/decode_bg.wasm", async (route) => {
        refused += 1;
        if (refused <= 4) await route.fulfill({ status: 503 });
        else await route.continue();
      }),
  });
  assert.equal(refused, 5);
  assert.ok((await stats(page)).targetReached);
  await close();
});

test("a worker whose script does not come is started again", async () => {
  let refused = 0;
  const { page, close } = await open(site.browser, `${site.server.url}/m/fort?error=4`, {
    ...SHARP,
    before: async (page) => {
      // The script fails while the program is on its way.
      await page.route("**/decode_bg.wasm", async (route) => {
        await new Promise((resolve) => setTimeout(resolve, 500)); // the simulated server is slow
        await route.continue().catch(() => {});
      });
      await page.context().route("**/decode-worker.js", async (route) => {
        refused += 1;
        if (refused <= 2) await route.fulfill({ status: 503 });
        else await route.continue();
      });
    },
  });
  assert.ok(refused > 2);
  assert.ok((await stats(page)).targetReached);
  await close();
});
