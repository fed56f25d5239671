// The page of a published model. Before the model is there: the poster at once, a bar that goes on, and nothing that waits for the graphics adapter.
// Its days in words.

import assert from "node:assert/strict";
import { after, before } from "node:test";
import { archive } from "./archive.mjs";
import { launch, open, stats, test, waitFor } from "./harness.mjs";

let server;
let browser;
before(async () => {
  server = await archive([
    'title = "Gereza"\nslug = "gereza"\npublished = 2026-11-24\n[rights]\nuri = "CC0"\n[model]\nunits = "m"\n[capture]\ndate = "2009-07-21"\n',
  ]);
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
});

const PAGE = () => `${server.url}/gereza/?error=8`;
const named = (request) => new URL(request.url()).pathname.split("/").at(-1);

/** Holds back what `isHeld` is true of, until `release()`. */
async function hold(page, isHeld) {
  let release;
  const held = new Promise((resolve) => {
    release = resolve;
  });
  await page.route("**/*", async (route) => {
    if (isHeld(named(route.request()))) await held;
    await route.continue().catch(() => {});
  });
  return () => release();
}

test("the poster is asked for before any script and is seen while nothing else has come, and leaves when the model is there", async () => {
  const asked = [];
  let release;
  const { page, complaints, close } = await open(browser, "about:blank", {
    wait: null,
    size: [1000, 700],
    before: async (page) => {
      page.on("request", (request) => asked.push(named(request)));
      // No module, no program, no pack.
      release = await hold(page, (name) => name !== "plain.js" && /\.(js|wasm|kilwa|json)$/.test(name));
    },
  });
  await page.goto(PAGE(), { waitUntil: "commit" });
  const poster = page.getByRole("main").getByRole("presentation");
  await poster.waitFor();
  await page.waitForFunction((img) => img.complete && img.naturalWidth > 0, await poster.elementHandle());
  const box = await poster.boundingBox();
  assert.ok(box.width > 500 && box.height > 400, JSON.stringify(box));
  const at = (pattern) => asked.findIndex((name) => pattern.test(name));
  assert.ok(at(/^poster/) > 0 && at(/^poster/) < at(/\.js$/), asked.join(" "));
  assert.equal(asked.filter((name) => name.startsWith("poster")).length, 1, "it is fetched once");
  release();
  await waitFor(page, "settled");
  await poster.waitFor({ state: "hidden" });
  assert.deepEqual(complaints, []);
  await close();
});

test("program, messages, decoder, its worker and the head of the pack are asked for while the adapter has not answered", async () => {
  const asked = new Set();
  const { page, complaints, close } = await open(browser, PAGE(), {
    wait: null,
    before: async (page) => {
      page.on("request", (request) => asked.add(named(request)));
      await page.addInitScript(() => {
        const { requestAdapter } = globalThis.GPU.prototype;
        const held = new Promise((resolve) => {
          globalThis.answer = resolve;
        });
        globalThis.GPU.prototype.requestAdapter = async function (options) {
          await held;
          return requestAdapter.call(this, options);
        };
      });
    },
  });
  const wanted = ["viewer_bg.wasm", "viewer.js", "decode_bg.wasm", "decode-worker.js", "en.json"];
  const isAsked = () => wanted.every((name) => asked.has(name)) && [...asked].some((name) => name.endsWith(".kilwa"));
  for (let missing = !isAsked(); missing; missing = !isAsked())
    await page.waitForEvent("request", { timeout: 60_000 }).catch(() => assert.fail([...asked].join(" ")));
  await page.evaluate(() => globalThis.answer());
  await waitFor(page, "settled");
  assert.ok((await stats(page)).trianglesDrawn > 0);
  assert.deepEqual(complaints, []);
  await close();
});

test("where no adapter answers, the transfer of the program that cannot be used ends", async () => {
  const failed = [];
  let release;
  const { page, close } = await open(browser, PAGE(), {
    wait: null,
    before: async (page) => {
      page.on("requestfailed", (request) => failed.push(named(request)));
      release = await hold(page, (name) => name === "viewer_bg.wasm");
      await page.addInitScript(() => (globalThis.GPU.prototype.requestAdapter = async () => null));
    },
  });
  await waitFor(page, "settled");
  assert.deepEqual(failed, ["viewer_bg.wasm"]);
  assert.match((await stats(page)).adapter, /Gl/);
  release();
  await close();
});

test("the bar goes on and never back, and moves while it waits", async () => {
  let release;
  const { page, close } = await open(browser, PAGE(), {
    wait: null,
    reducedMotion: "no-preference",
    before: async (page) => {
      // Whichever of program and head comes first on a busy machine, the bar goes on: here the head does, so that it has three steps.
      release = await hold(page, (name) => name === "viewer_bg.wasm");
      await page.addInitScript(() => {
        globalThis.seen = [];
        new MutationObserver(() => {
          const bar = document.getElementById("loading-bar");
          if (!bar) return;
          if (globalThis.seen.length === 0) globalThis.isMoving = bar.getAnimations().length > 0;
          if (bar.position >= 0 && bar.value !== globalThis.seen.at(-1)) globalThis.seen.push(bar.value);
        }).observe(document, { subtree: true, childList: true, attributes: true, attributeFilter: ["value"] });
      });
    },
  });
  await page.waitForFunction(() => globalThis.seen.some((value) => value > 0));
  release();
  await waitFor(page, "settled");
  const { seen, isMoving } = await page.evaluate(() => ({ seen: globalThis.seen, isMoving: globalThis.isMoving }));
  assert.ok(isMoving);
  assert.ok(seen.length >= 3, seen.join(" "));
  assert.deepEqual(
    seen,
    seen.toSorted((a, b) => a - b),
  );
  assert.ok(seen.at(-1) >= 0.6, seen.join(" "));
  await close();
});

test("days are written in the words of the language", async () => {
  for (const [lang, day] of [
    ["en", "24 November 2026"],
    ["fr", "24 novembre 2026"],
    ["pt", "24 de novembro de 2026"],
    ["sw", "24 Novemba 2026"],
    ["ar", "24 نوفمبر 2026"],
  ]) {
    const { page, close } = await open(browser, `${PAGE()}&lang=${lang}`, { wait: "first", size: [1100, 700] });
    const times = page.getByRole("complementary").locator("time"); // a day has no role
    assert.equal(await times.first().innerText(), day);
    assert.equal(await times.first().getAttribute("datetime"), "2026-11-24");
    await close();
  }
});
