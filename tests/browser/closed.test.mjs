// A model that is not public: its page says so and shows everything else; whoever is granted it signs in and sees it; what ends in the middle of a view
// is asked for again and nothing is lost.

import assert from "node:assert/strict";
import { execFile, spawn } from "node:child_process";
import { mkdtemp, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, before, test } from "node:test";
import { promisify } from "node:util";
import { KILWA, WWW, launch, open, packFolder, serve, waitFor } from "./harness.mjs";

const run = promisify(execFile);
let scratch;
let server;
let browser;

before(async () => {
  scratch = await mkdtemp(path.join(tmpdir(), "kilwa-closed-"));
  const folder = await packFolder();
  const [metadata, accounts, site] = ["cave.toml", "access.json", "site"].map((name) => path.join(scratch, name));
  await writeFile(
    metadata,
    'title = "A cave"\nslug = "cave"\n[rights]\nuri = "InC"\n[model]\nunits = "m"\n[access]\nstate = "restricted"\nreason = "Graves of the living."\n',
  );
  await run(KILWA, ["publish", path.join(folder, "fort.kilwa"), "--to", site, "--metadata", metadata, "--www", WWW, "--software"]);
  await rm(folder, { recursive: true });
  await run(KILWA, ["access", "init", accounts]);
  const user = spawn(KILWA, ["access", "user", accounts, "amina", "--object", "cave"], { stdio: ["pipe", "ignore", "inherit"] });
  user.stdin.end("a long sentence\n");
  assert.equal(await new Promise((resolve) => user.once("exit", resolve)), 0);
  server = await serve(site, "--access", accounts);
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
  await rm(scratch, { recursive: true });
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
  await page.locator("#name").fill("amina");
  await page.locator("#password").fill("not this sentence");
  await page.keyboard.press("Enter");
  await page.locator("[role=alert]").filter({ hasText: "not right" }).waitFor();
  assert.equal(await page.locator("#name").inputValue(), "amina", "what was typed is kept");
  await page.locator("#password").fill("a long sentence");
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
