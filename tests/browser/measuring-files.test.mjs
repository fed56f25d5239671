// Measurements that leave the page in a link or a file come back the same to the last bit; messages about them are in the language of
// the page.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, before } from "node:test";
import { promisify } from "node:util";
import { KILWA, WWW, canvasOf, fortSite, open, openTab, test, waitFor } from "./harness.mjs";
import { bar, bits, done, give, list, measureDistance, openRow, panel, press, row, saveAs, status, table, tool } from "./measuring.mjs";

const site = fortSite();
let scratch;
before(async () => {
  scratch = await mkdtemp(path.join(tmpdir(), "kilwa-measuring-"));
});
after(() => rm(scratch, { recursive: true }));

const fort = (query = "?error=12") => `${site.server.url}/m/fort${query}`;
/** A page just large enough for the panel beside the picture, because the picture is drawn without a graphics card. */
const tab = { size: [960, 640] };
const measured = async (options = {}) => {
  const opened = await open(site.browser, fort(), { ...tab, ...options });
  await measureDistance(opened.page, [0.42, 0.5], [0.55, 0.5]);
  return opened;
};

test("a link opens the same measurement elsewhere, to the last bit, and the page reports measurements that are too long for one", async () => {
  const { page, complaints, close } = await measured();
  const name = "Gate! ~ width, 50 % “é”";
  const detail = await openRow(page, "Distance 1");
  await detail.getByLabel("Colour").fill("#c2256b");
  await detail.getByLabel("Name", { exact: true }).fill(name);
  await page.keyboard.press("Enter");
  await row(page, name).waitFor();
  const wanted = await bits(page);
  assert.equal(wanted[0].name, name);
  const address = await page.evaluate(() => globalThis.kilwa.api.link());
  const other = await open(site.browser, address, tab);
  await openTab(other.page, "Measure");
  await row(other.page, name).waitFor();
  await done(other.page);
  assert.deepEqual(await bits(other.page), wanted);
  assert.equal((await list(other.page))[0].color, "#c2256b");
  await other.page.reload();
  await waitFor(other.page, "settled");
  await openTab(other.page, "Measure");
  await row(other.page, name).waitFor();
  await done(other.page);
  assert.equal((await list(other.page)).length, 1, "the stored measurement and the one in the link are the same");
  const document = JSON.parse(await saveAs(other.page, "json"));
  const [one] = document.measurements;
  await give(other.page, JSON.stringify({ ...document, measurements: Array.from({ length: 80 }, (_, k) => ({ ...one, name: `${k}` })) }));
  await status(other.page, "Read: 80").waitFor();
  await other.page.getByRole("button", { name: "Share", exact: true }).click();
  await other.page.getByRole("dialog", { name: "Share" }).getByText("too many measurements for a link").waitFor();
  assert.ok(!new URL(other.page.url()).hash.includes("measurements="));
  assert.deepEqual([...complaints, ...other.complaints], []);
  await other.close();
  await close();
});

test("a file reads back to the last bit, here and by kilwa measure, and one of another pack warns first", async () => {
  const { page, complaints, close } = await measured();
  await tool(page, "Area");
  await bar(page).waitFor();
  await press(page, [0.42, 0.48], [0.5, 0.48], [0.48, 0.53]);
  await page.keyboard.press("Enter");
  await done(page, 2);
  await page.keyboard.press("Escape");
  const wanted = await bits(page);
  const words = await saveAs(page, "json");
  const file = path.join(scratch, "fort.json");
  await writeFile(file, words);
  const { stdout } = await promisify(execFile)(KILWA, ["measure", site.pack, "again", file]);
  assert.match(stdout, /Distance 1 \(distance\): the same[\s\S]*Area 1 \(area\): the same/);
  await panel(page).getByRole("button", { name: "Delete all" }).click();
  assert.equal((await list(page)).length, 0);
  await give(page, words);
  await done(page, 2);
  assert.deepEqual(await bits(page), wanted);
  // Dropped on the page it is read too; what is here already is not added twice.
  const dataTransfer = await page.evaluateHandle((words) => {
    const data = new DataTransfer();
    data.items.add(new File([words], "fort.json", { type: "application/json" }));
    return data;
  }, words);
  await canvasOf(page).dispatchEvent("drop", { dataTransfer });
  await status(page, "Read: 2").waitFor();
  assert.deepEqual(await bits(page), wanted);
  assert.equal(await saveAs(page, "json"), words);
  for (const [format, says] of [
    ["csv", /^name,tool,reading/],
    ["geojson", /FeatureCollection/],
    ["dxf", /AC1024|SECTION/],
  ]) {
    assert.match(await saveAs(page, format), says, format);
  }
  // Of another pack: nothing is added before the person says so, and then it is measured here.
  const foreign = JSON.parse(words);
  foreign.pack.identity = foreign.pack.identity.replace(/^./, (c) => (c === "0" ? "1" : "0"));
  foreign.pack.title = "Husuni Kubwa";
  for (const one of foreign.measurements) one.name += ", before";
  // A file that somebody sent may have anything in place of a colour.
  foreign.measurements[0].color = "red;position:fixed;inset:0;width:auto;height:auto";
  await give(page, JSON.stringify(foreign));
  await status(page, "another model: “Husuni Kubwa”").waitFor();
  assert.equal((await list(page)).length, 2);
  await page.getByRole("button", { name: "Measure them here" }).click();
  await done(page, 4);
  assert.equal(await table(page).getByRole("rowheader").count(), 4);
  const places = await table(page)
    .locator("*")
    .evaluateAll((all) => all.map((e) => getComputedStyle(e).position));
  assert.ok(places.length > 20 && !places.includes("fixed"), `${places}`);
  const detail = await openRow(page, "Area 1, before");
  await detail.getByText("another pack").waitFor();
  for (const [bad, says] of [
    ["{", /could not be read/],
    ['{"kilwa":"measurements","version":99,"measurements":[]}', /this page reads versions up to 1/],
    ['{"kilwa":"pack","version":1}', /not a file of measurements; its type is “pack”/],
  ]) {
    await give(page, bad);
    await status(page, says).waitFor();
  }
  assert.equal((await list(page)).length, 4);
  assert.deepEqual(complaints, []);
  await close();
});

const strings = async (lang) => JSON.parse(await readFile(path.join(WWW, `i18n/${lang}.json`), "utf8"));

/** A pattern that matches a message with any values and in any plural form. */
function pattern(message) {
  const source = (part) => {
    if (Array.isArray(part)) return part.map(source).join("");
    if (typeof part === "string") return part.replace(/[.*+?^$()|[\]\\]/g, "\\$&").replace(/\{\w+\}/g, ".+");
    const { $: _, ...forms } = part;
    return `(?:${Object.values(forms).map(source).join("|")})`;
  };
  return new RegExp(source(message));
}

/** Without the characters that keep numbers together in right-to-left text. */
const plain = (text) => text.replaceAll(/[\u2066\u2069]/g, "");

test("remarks, refusals and complaints about files are in the language of the page, also after it is changed", async () => {
  const english = await strings("en");
  const french = await strings("fr");
  const { page, complaints, close } = await open(site.browser, fort("?error=12&lang=fr"), { size: [760, 480] });
  const { bounds_min: low, bounds_max: high } = await page.evaluate(() => globalThis.kilwa.api.info().metadata);
  const middle = low.map((v, i) => (v + high[i]) / 2);
  const square = [
    [-4, -4],
    [4, -4],
    [4, 4],
    [-4, 4],
  ].map(([x, y]) => [middle[0] + x, middle[1] + y, middle[2]]);
  const asked = {
    remarkLines: { tool: "section", plane: { point: middle, normal: [1, 0, 0] } },
    remarkHeights: { tool: "contours", interval: 6 },
    remarkCovered: { tool: "cut-fill", points: square, reach: 20 },
    remarkReach: { tool: "area", points: square, reach: 20 },
    refuseOpen: { tool: "volume" },
    refuseCross: { tool: "area", points: [square[0], square[2], square[1], square[3]] },
    refuseInterval: { tool: "contours", interval: 1e-9 },
    refuseMisses: { tool: "section", plane: { point: [middle[0], middle[1], high[2] + 100], normal: [0, 0, 1] } },
    refuseCollinear: { tool: "circle", points: [middle, middle, middle] },
  };
  for (const [name, one] of Object.entries(asked)) {
    const { state } = await page.evaluate((one) => globalThis.kilwa.api.addMeasurement(one), { ...one, name });
    assert.equal(state, name.startsWith("refuse") ? "refused" : "final", name);
  }
  let words = french;
  for (const lang of ["fr", "ar"]) {
    await page.getByRole("combobox", { name: words.language }).selectOption(lang);
    words = await strings(lang);
    await page.getByRole("tab", { name: words.tabMeasure }).click();
    const measures = page.getByRole("tabpanel", { name: words.tabMeasure });
    for (const name of Object.keys(asked)) {
      const button = measures.getByRole("button", { name, exact: true });
      if ((await button.getAttribute("aria-expanded")) !== "true") await button.click();
      const detail = measures.getByRole("cell").filter({ has: page.getByRole("textbox") });
      const text = plain(await detail.innerText());
      assert.match(text, pattern(words[name]), `${lang}: ${name}`);
      assert.doesNotMatch(text, pattern(english[name]), `${lang}: ${name}`);
    }
    for (const [bad, key] of [
      ["{", "documentJson"],
      ['{"kilwa":"pack","version":1}', "documentOther"],
    ]) {
      await give(page, bad, words.importFile);
      await status(page, pattern(words[key])).waitFor();
    }
    await page.getByRole("button", { name: words.picture }).click();
    const dialog = page.getByRole("dialog", { name: words.picture });
    await dialog.getByRole("radio", { name: words.pictureSheet }).check();
    await dialog.getByLabel(words.sheetScale, { exact: true }).fill("1");
    await dialog.getByRole("button", { name: words.pictureMake }).click();
    await dialog.getByRole("alert").waitFor();
    assert.match(plain(await dialog.getByRole("alert").innerText()), pattern(words.sheetTooLargeFits));
    await dialog.getByRole("button", { name: words.close }).click();
  }
  assert.deepEqual(complaints, []);
  await close();
});
