// A model that is not public: its page says so and shows everything else; whoever is granted it signs in and sees it; what ends in the middle of a view
// is asked for again and nothing is lost.

import assert from "node:assert/strict";
import { after, before } from "node:test";
import { AMINA, archive } from "./archive.mjs";
import { launch, open, test, waitFor } from "./harness.mjs";

let server;
let browser;

before(async () => {
  const cave =
    'title = "A cave"\nslug = "cave"\n[rights]\nuri = "InC"\n[model]\nunits = "m"\n[access]\nstate = "restricted"\nreason = "Graves of the living."\n';
  server = await archive([cave], { granted: ["cave"] });
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
});

test("who may not see it reads why, with its poster, facts and citation, and finds where to sign in", async () => {
  const { page, close } = await open(browser, `${server.url}/cave/`, { wait: "trouble", size: [1200, 800] });
  assert.equal(await page.locator("#trouble-title").innerText(), "This model is not public");
  assert.match(await page.locator("#trouble-detail").innerText(), /Graves of the living/);
  await page.locator("#trouble-poster").waitFor({ state: "visible" });
  assert.ok(!(await page.locator("#trouble-download").isVisible()), "what cannot be had is not offered");
  assert.match(await page.locator("#panel").innerText(), /How to cite/);
  assert.equal(await page.locator("#trouble-sign-in").getAttribute("href"), `${server.url}/sign-in?next=%2Fcave%2F&lang=en`);
  await close();
});

test("whoever is granted it signs in by keyboard, sees it, and loses nothing when leave ends in the middle of the view", async () => {
  const { page, close } = await open(browser, `${server.url}/cave/?error=16`, { wait: "trouble", size: [1200, 800] });
  await page.locator("#trouble-sign-in").focus();
  await page.keyboard.press("Enter");
  await page.locator("#name").fill(AMINA.name);
  await page.locator("#password").fill("not this sentence");
  await page.keyboard.press("Enter");
  await page.locator("[role=alert]").filter({ hasText: "is wrong" }).waitFor();
  assert.equal(await page.locator("#name").inputValue(), AMINA.name, "what was typed is kept");
  await page.locator("#password").fill(AMINA.password);
  await page.keyboard.press("Enter");
  await waitFor(page, "settled");
  assert.equal(new URL(page.url()).pathname, "/cave/", "back where the reader came from");

  // Coarse first, so that there is more to fetch.
  await page.goto(`${server.url}/cave/?error=32`);
  await waitFor(page, "settled");

  const before = await page.evaluate(() => globalThis.kilwa.session.stats.trianglesDrawn);
  await page.context().clearCookies({ name: "kilwa_pack" });
  const opened = page.waitForResponse((response) => response.url().endsWith("/cave/open"));
  await page.evaluate(() => {
    globalThis.kilwa.viewer.setTargetPixels(1);
    globalThis.kilwa.session.wake();
  });
  assert.equal((await opened).status(), 204);
  await page.waitForFunction((before) => globalThis.kilwa.session.stats.trianglesDrawn > before, before, { polling: 50 });
  await waitFor(page, "settled");
  assert.equal(await page.evaluate(() => document.body.dataset.state), "ready");
  await close();
});
