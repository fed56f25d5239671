// A model that is not public: its page says so and shows everything else; whoever is granted it signs in and sees it; what ends in the middle of a view
// is asked for again and nothing is lost.

import assert from "node:assert/strict";
import { after, before } from "node:test";
import { AMINA, archive } from "./archive.mjs";
import { launch, open, openTab, stats, test, troubleOf, waitFor } from "./harness.mjs";

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
  const trouble = troubleOf(page);
  assert.equal(await trouble.getByRole("heading").innerText(), "This model is not public");
  assert.match(await trouble.innerText(), /Graves of the living/);
  await page.getByRole("main").getByRole("presentation").waitFor(); // the poster, which says nothing that the page does not
  assert.equal(await trouble.getByRole("link", { name: "Download pack" }).count(), 0, "no link to a file that is not available");
  assert.match(await page.getByRole("complementary", { name: "Details" }).innerText(), /How to cite/);
  assert.equal(await trouble.getByRole("link", { name: "Sign in" }).getAttribute("href"), `${server.url}/sign-in?next=%2Fcave%2F&lang=en`);
  await close();
});

test("whoever is granted it signs in by keyboard, sees it, and loses nothing when leave ends in the middle of the view", async () => {
  const { page, close } = await open(browser, `${server.url}/cave/?error=16`, { wait: "trouble", size: [1200, 800] });
  await troubleOf(page).getByRole("link", { name: "Sign in" }).focus();
  await page.keyboard.press("Enter");
  await page.getByLabel("User name").fill(AMINA.name);
  await page.getByLabel("Password").fill("not this sentence");
  await page.keyboard.press("Enter");
  await page.getByRole("alert").filter({ hasText: "is wrong" }).waitFor();
  assert.equal(await page.getByLabel("User name").inputValue(), AMINA.name, "what was typed is kept");
  await page.getByLabel("Password").fill(AMINA.password);
  await page.keyboard.press("Enter");
  await waitFor(page, "settled");
  assert.equal(new URL(page.url()).pathname, "/cave/", "back where the reader came from");

  // Coarse first, so that there is more to fetch.
  await page.goto(`${server.url}/cave/?error=32`);
  await waitFor(page, "settled");

  await openTab(page, "Display");
  const { trianglesDrawn } = await stats(page);
  await page.context().clearCookies({ name: "kilwa_pack" });
  const opened = page.waitForResponse((response) => response.url().endsWith("/cave/open"));
  await page.getByRole("slider", { name: "Maximum error on screen" }).fill("1"); // one pixel
  assert.equal((await opened).status(), 204);
  await page.waitForFunction((before) => globalThis.kilwa.api.stats().trianglesDrawn > before, trianglesDrawn, { polling: 50 });
  await waitFor(page, "settled");
  assert.ok(await page.evaluate(() => globalThis.kilwa.api.isReady));
  assert.ok(await troubleOf(page).isHidden());
  await close();
});
