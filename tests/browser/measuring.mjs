// Measuring as a person does it: the tools, the picture, the table and its rows, by their roles and names.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { canvasOf, openTab, tool as railTool, spotOn } from "./harness.mjs";

export const panel = (page) => page.getByRole("tabpanel", { name: "Measure" });
export const table = (page) => page.getByRole("table", { name: "Measurements" });
/** The button of a row, which opens and closes it. */
export const row = (page, name) => table(page).getByRole("rowheader").getByRole("button", { name, exact: true });
/** The labels over the picture, each named by its measurement and its value. */
export const labels = (page) => page.getByRole("group", { name: "Measurements" }).getByRole("button", { name: ": " });
/** The point of a measurement that can be dragged while its points are moved. */
export const handle = (page, number, name) => page.getByRole("button", { name: `Move point ${number} of ${name}`, exact: true });
/** A short text that appears and is announced: hints, notices, results. */
export const status = (page, text) => page.getByRole("status").filter({ hasText: text, visible: true });
/** The buttons of the tool in use. */
export const bar = (page) => page.getByRole("toolbar", { name: "Measurements" });

/** Positions in the window, in whole pixels, of points given as fractions of the picture's width and height. */
const spots = (page, places) => Promise.all(places.map(async ([x, y]) => (await spotOn(page, x, y)).map(Math.round)));

/** Click points in the picture, given as fractions of its width and height. */
export async function press(page, ...places) {
  for (const [x, y] of await spots(page, places)) await page.mouse.click(x, y);
}

/** The viewing rays through the points that `press` clicks. */
export async function raysAt(page, ...places) {
  const box = await canvasOf(page).boundingBox();
  const at = (await spots(page, places)).map(([x, y]) => [x - box.x, y - box.y]);
  return page.evaluate((at) => at.map(([x, y]) => globalThis.kilwa.api.pick(x, y).ray), at);
}

/** Rays as the command line takes them: six numbers each. */
export const numbers = (rays) => rays.flatMap(({ origin, direction }) => [...origin, ...direction]);

export const list = (page) => page.evaluate(() => globalThis.kilwa.api.measurements());

/** Wait until there are `count` measurements, each with a value or a reason why it has none. */
export const done = (page, count = 1) =>
  page.evaluate(async (count) => {
    for (;;) {
      const all = await globalThis.kilwa.api.measurements();
      if (all.length === count && all.every(({ state }) => !["picking", "measuring"].includes(state))) return;
      await new Promise(requestAnimationFrame);
    }
  }, count);

/** Wait until the first point of the first measurement is no longer this one, and the new value is there. */
export const moved = async (page, was) => {
  await page.evaluate(async (was) => {
    while ((await globalThis.kilwa.api.measurements())[0].points[0].join() === was) await new Promise(requestAnimationFrame);
  }, was.join());
  await done(page);
};

/** The measurements with every bit of their values, and of their places as links have them. */
export const bits = async (page) => {
  const all = (await list(page)).map(({ name, tool, points, readings }) => ({ name, tool, points, readings }));
  const places = await localPlaces(page);
  return all.map((one, k) => ({ ...one, local: places[k] }));
};

/** The places of the measurements as a link to this view has them: metres from the lattice's origin, to the last bit (www/measure/address.js). */
async function localPlaces(page) {
  const text = await page.evaluate(() => globalThis.kilwa.api.state().measurements);
  return (text ?? "")
    .split("!")
    .filter(Boolean)
    .map((one) => {
      const bytes = Buffer.from(one.split("~")[1], "base64url");
      return Array.from({ length: bytes.length / 8 }, (_, k) => bytes.readDoubleLE(k * 8));
    });
}

/** The uncertainties of pointing of the first measurement's points, metres, as the command line takes them. */
export async function pointing(page) {
  const text = await page.evaluate(() => globalThis.kilwa.api.state().measurements);
  const option =
    text
      .split("!")[0]
      .split("~")[3]
      ?.split(".")
      .find((o) => o.startsWith("u")) ?? "u";
  const bytes = Buffer.from(option.slice(1), "base64url");
  return Array.from({ length: bytes.length / 8 }, (_, k) => bytes.readDoubleLE(k * 8));
}

/** Choose a tool in the list of all of them. */
export async function tool(page, name) {
  await openTab(page, "Measure");
  await panel(page).getByText("All tools").click();
  await panel(page).getByRole("group").getByRole("button", { name, exact: true }).click();
}

/** Open a row, and return its details. */
export async function openRow(page, name) {
  const button = row(page, name);
  if ((await button.getAttribute("aria-expanded")) !== "true") await button.click();
  return table(page)
    .getByRole("cell")
    .filter({ has: page.getByRole("textbox") });
}

/** Let the points of a measurement be moved. */
export const movePoints = async (page, name) => (await openRow(page, name)).getByRole("button", { name: `Move points: ${name}` }).click();

/** The first `count` values of a row's details, without the sources of the uncertainty. */
export async function values(page, name, count) {
  const all = (await openRow(page, name)).getByRole("definition");
  return (await all.allInnerTexts()).slice(0, count);
}

/** Give the page a file of measurements. */
export const give = (page, words, label = "Read a file…") =>
  page
    .getByRole("tabpanel")
    .getByLabel(label)
    .first()
    .setInputFiles({ name: "measurements.json", mimeType: "application/json", buffer: Buffer.from(words) });

/** The text of the file that a click on a button saves. */
export async function saved(page, button) {
  const [download] = await Promise.all([page.waitForEvent("download"), button.click()]);
  return readFile(await download.path(), "utf8");
}

/** The measurements as a file. */
export const saveAs = async (page, format) => {
  await panel(page).getByLabel("File format").selectOption(format);
  return saved(page, panel(page).getByRole("button", { name: "Save as a file" }));
};

/** Choose Distance with its button and measure between two places. */
export async function measureDistance(page, ...places) {
  await railTool(page, "Measure").click();
  await bar(page).waitFor();
  await press(page, ...places);
  await done(page);
  await page.keyboard.press("Escape");
  await bar(page).waitFor({ state: "hidden" });
  assert.equal((await list(page))[0].tool, "distance");
}
