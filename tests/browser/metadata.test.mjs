// The form for a metadata file (`kilwa metadata edit`): by keyboard, with mistakes, on a phone, in Arabic, and when the file changes meanwhile.

import assert from "node:assert/strict";
import { execFile, spawn } from "node:child_process";
import { mkdtemp, readdir, readFile, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, before } from "node:test";
import { promisify } from "node:util";
import { seriousOn } from "./axe.mjs";
import { cachedFort, KILWA, launch, open, test } from "./harness.mjs";

const FILE = `# Ours.
title = "Gereza"  # the working title

[rights]
uri = "CC BY 4.0"
unheard_of = 1

[model]
units = "mm"

# Amina drew.
[[creators]]
name = "Juma, Amina"
orcid = "0000-0002-1825-0098"
`;
let browser;

before(async () => {
  browser = await launch();
});
after(async () => {
  await browser?.close();
});

/** `kilwa metadata edit` on a file in a folder of its own, until `stop()` or until it ends by itself. */
async function edit(text) {
  const folder = await mkdtemp(path.join(tmpdir(), "kilwa-metadata-"));
  const file = path.join(folder, "gereza.toml");
  if (text) await writeFile(file, text);
  const child = spawn(KILWA, ["metadata", "edit", file], { stdio: ["ignore", "pipe", "inherit"] });
  let output = "";
  const ended = new Promise((resolve) => child.once("exit", (code) => resolve(code)));
  const url = await new Promise((resolve, reject) => {
    child.stdout.on("data", (part) => {
      output += part;
      const found = /http:\/\/127\.0\.0\.1:\d+\/[0-9a-f]+\//.exec(output);
      if (found) resolve(found[0]);
    });
    child.once("error", reject);
    child.once("exit", (code) => reject(new Error(`kilwa metadata edit ended with ${code}: ${output}`)));
  });
  return {
    url,
    file,
    folder,
    ended,
    output: () => output,
    read: () => readFile(file, "utf8"),
    stop: async () => {
      child.kill("SIGINT");
      assert.equal(await ended, 0, "Ctrl-C exits with status 0");
      await rm(folder, { recursive: true });
    },
  };
}

const look = (url, options = {}) => open(browser, url, { size: [1280, 900], wait: null, ...options });
/** Press Tab until a field has the focus. */
async function tabTo(page, field) {
  for (let i = 0; i < 120; i += 1) {
    if (await field.evaluate((element) => element === document.activeElement)) return;
    await page.keyboard.press("Tab");
  }
  assert.fail("the keyboard does not get there");
}

test("by keyboard alone, the required fields are filled in, a creator is added, and the file passes the check", async () => {
  const form = await edit();
  const { page, complaints, close } = await look(form.url);
  await page.getByText("gereza.toml does not exist yet").waitFor();
  await tabTo(page, page.getByLabel("Title (required)"));
  await page.keyboard.type("Gereza fort");
  await tabTo(page, page.getByLabel("Licence or rights statement"));
  await page.keyboard.type("CC BY 4");
  await page.keyboard.press("Control+s");
  await page.getByRole("heading", { name: "Saved as a draft. To do before publishing: 1" }).waitFor();
  await tabTo(page, page.getByLabel("Units of the mesh"));
  await page.keyboard.type("metres");
  await tabTo(page, page.getByRole("button", { name: "Add a creator" }));
  await page.keyboard.press("Enter");
  await page.keyboard.type("Juma, Amina");
  await page.keyboard.press("Control+s");
  await page.getByText("Saved in gereza.toml. The file is complete.").waitFor();
  assert.deepEqual(complaints, []);
  const text = await form.read();
  for (const line of ['title = "Gereza fort"', 'uri = "CC BY 4.0"', 'units = "m"', 'name = "Juma, Amina"', "# REQUIRED. The name of the model."])
    assert.ok(text.includes(line), `${line}\n${text}`);
  const run = promisify(execFile);
  assert.match((await run(KILWA, ["metadata", "check", form.file])).stdout, /gereza\.toml: right\./);
  const site = path.join(form.folder, "site");
  await run(KILWA, ["publish", await cachedFort(20_000), "--to", site, "--metadata", form.file]);
  assert.match(await readFile(path.join(site, "gereza-fort/v1/metadata/metadata.json"), "utf8"), /Juma, Amina/);
  await tabTo(page, page.getByRole("button", { name: "Done" }));
  await page.keyboard.press("Enter");
  await page.getByRole("heading", { name: "Finished" }).waitFor();
  assert.equal(await form.ended, 0);
  assert.match(form.output(), /gereza\.toml was written/);
  await close();
  await rm(form.folder, { recursive: true });
});

test("a mistake is shown at its field and in a summary that has the focus, and nothing is written until it is corrected", async () => {
  const form = await edit(FILE);
  const { page, close } = await look(form.url);
  const alert = page.getByRole("alert");
  // The mistakes that the file brings along, of which the form cannot correct one.
  await alert.getByText("Mistakes in the file: 2").waitFor();
  await page.getByLabel("Date of capture").fill("July 2009");
  await page.getByRole("button", { name: "Save", exact: true }).click();
  await alert.getByText("Not saved. Mistakes: 3").waitFor();
  assert.equal(await alert.evaluate((element) => element === document.activeElement), true);
  const field = page.getByLabel("Date of capture");
  assert.equal(await field.getAttribute("aria-invalid"), "true");
  const described = (await field.getAttribute("aria-describedby")).split(" ");
  const error = page.locator(`[id="${described.at(-1)}"]`);
  assert.match(await error.innerText(), /Enter a year, month or day.*Details:/s);
  assert.equal(await form.read(), FILE);
  await alert.getByRole("link", { name: /^Date of capture/ }).click();
  assert.equal(await field.evaluate((element) => element === document.activeElement), true);
  await field.fill("2009-07");
  await alert.getByRole("link", { name: /^Creator 1: ORCID/ }).click();
  await page.keyboard.press("Control+a");
  await page.keyboard.type("0000-0002-1825-0097");
  await page.keyboard.press("Control+s");
  await page.getByText("Saved in gereza.toml as a draft.").waitFor();
  assert.equal(await form.read(), `${FILE.replace("0098", "0097")}\n[capture]\ndate = "2009-07"\n`);
  await close();
  await form.stop();
});

test("blocks are moved and removed, and the preview shows the file that will be written", async () => {
  const form = await edit(FILE.replace("0098", "0097").replace("unheard_of = 1\n", ""));
  const { page, close } = await look(form.url);
  await page.getByRole("button", { name: "Add a creator" }).click();
  await page.keyboard.type("Museum");
  await page.getByRole("button", { name: "Move up: Creator 2" }).click();
  await page.getByText("Now at position 1.").waitFor();
  assert.equal(await page.getByRole("button", { name: "Move down: Creator 1" }).evaluate((e) => e === document.activeElement), true);
  await page.getByText("Preview of the file").click();
  const preview = page.locator("#preview pre");
  await preview.getByText('name = "Museum"').waitFor();
  await page.keyboard.press("Control+s");
  await page.getByText("Saved in gereza.toml. The file is complete.").waitFor();
  const text = await form.read();
  assert.equal(await preview.textContent(), text);
  assert.ok(text.indexOf("Museum") < text.indexOf("# Amina drew."), text);
  await page.getByRole("button", { name: "Remove: Creator 1" }).click();
  await page.keyboard.press("Control+s");
  await page.getByText("Saved in gereza.toml. The file is complete.").waitFor();
  assert.ok(!(await form.read()).includes("Museum"));
  await close();
  await form.stop();
});

test("a mistake in a block that was moved is shown at that block", async () => {
  const form = await edit(`${FILE.replace("unheard_of = 1\n", "").replace("0098", "0097")}\n[[creators]]\nname = "Omar"\n`);
  const { page, close } = await look(form.url);
  await page.getByLabel("ORCID").nth(1).fill("0000-0002-1825-0098");
  await page.getByRole("button", { name: "Move up: Creator 2" }).click();
  await page.keyboard.press("Control+s");
  await page
    .getByRole("alert")
    .getByRole("link", { name: /^Creator 1: ORCID/ })
    .click();
  assert.equal(await page.evaluate(() => document.activeElement.value), "0000-0002-1825-0098");
  assert.equal(await page.getByLabel("ORCID").first().getAttribute("aria-invalid"), "true");
  await close();
  await form.stop();
});

test("a file that changed meanwhile is not overwritten: my version is saved beside it, and leaving with unsaved changes asks first", async () => {
  const text = FILE.replace("0098", "0097").replace("unheard_of = 1\n", "");
  const form = await edit(text);
  const { page, close } = await look(form.url);
  await page.getByLabel("Title (required)").fill("Mine");
  await page.getByText("Unsaved changes", { exact: true }).waitFor();
  await writeFile(form.file, `${text}# theirs\n`);
  await page.getByRole("button", { name: "Save", exact: true }).click();
  const dialog = page.getByRole("alertdialog", { name: "The file has changed" });
  await dialog.getByRole("button", { name: "Save my version as gereza-2.toml" }).click();
  await page.getByText("Saved as gereza-2.toml. The form now edits this file.").waitFor();
  assert.equal(await form.read(), `${text}# theirs\n`);
  assert.equal(await readFile(path.join(form.folder, "gereza-2.toml"), "utf8"), text.replace('"Gereza"', '"Mine"'));
  assert.deepEqual((await readdir(form.folder)).sort(), ["gereza-2.toml", "gereza.toml"]);
  await page.getByLabel("Title (required)").fill("Mine too");
  const asked = page.waitForEvent("dialog").then(async (one) => {
    assert.equal(one.type(), "beforeunload");
    await one.dismiss();
  });
  await page.reload({ timeout: 3000 }).catch(() => null);
  await asked;
  await page.getByRole("button", { name: "Done" }).click();
  await page.getByRole("button", { name: "Finish without saving" }).click();
  await page.getByRole("heading", { name: "Finished" }).waitFor();
  assert.equal(await form.ended, 0);
  assert.ok(!(await readFile(path.join(form.folder, "gereza-2.toml"), "utf8")).includes("Mine too"));
  await close();
  await rm(form.folder, { recursive: true });
});

test("axe-core finds nothing serious in the form, in both themes and in Arabic, with mistakes and without", async () => {
  const clean = await edit();
  const wrong = await edit(FILE);
  const prepared = async (address, options) => {
    const looked = await look(address, options);
    if (address === wrong.url) await looked.page.locator("#summary h2").waitFor();
    return looked;
  };
  assert.deepEqual(await seriousOn(prepared, [clean.url, wrong.url]), []);
  await clean.stop();
  await wrong.stop();
});

test("on the narrowest phone nothing is wider than the screen, and everything that is pressed is large enough for a finger", async () => {
  const form = await edit(FILE);
  for (const locale of ["en", "fr", "ar"]) {
    const { page, close } = await look(form.url, { size: [360, 740], hasTouch: true, isMobile: true, locale });
    await page.locator("#summary h2").waitFor();
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 360, locale);
    const small = await page
      .locator("a:visible, button:visible, input:visible, select:visible, textarea:visible, summary:visible")
      .evaluateAll((all) => all.filter((e) => e.getBoundingClientRect().height < 43.5).map((e) => e.outerHTML.slice(0, 80)));
    assert.deepEqual(small, [], locale);
    await close();
  }
  await form.stop();
});
