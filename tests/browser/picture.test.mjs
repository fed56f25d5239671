// Pictures saved from the page: of the canvas's size, larger than it, with and without scale bar and background.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { SHARP, canvasOf, fortSite, open, pixels, test, waitFor } from "./harness.mjs";
import { decodePng } from "./png.mjs";

const site = fortSite();

const dialogOf = (page) => page.getByRole("dialog", { name: "Save a picture" });
const openDialog = (page) => page.getByRole("banner").getByRole("button", { name: "Save a picture" }).click();
async function save(page) {
  const [download] = await Promise.all([page.waitForEvent("download"), dialogOf(page).getByRole("button", { name: "Save the picture" }).click()]);
  assert.match(download.suggestedFilename(), /^fort\.png$/);
  return decodePng(await readFile(await download.path()));
}

test("a picture requested while the camera is still moving, at a low frame rate, is made", async () => {
  const { page, complaints, close } = await open(site.browser, `${site.server.url}/m/fort?error=8`, { ...SHARP, size: [700, 500] });
  const size = await page.evaluate(async () => {
    const { api } = globalThis.kilwa;
    const frame = () => new Promise((resolve) => requestAnimationFrame(resolve));
    for (let at = 0; at < 12; at += 1) {
      const until = performance.now() + 120;
      while (performance.now() < until);
      await api.setCamera({ azimuth: at / 10 });
      await frame();
    }
    return (await api.picture({ width: 320, height: 200 })).size;
  });
  assert.ok(size > 1000);
  assert.deepEqual(complaints, []);
  await close();
});

test("a picture of the canvas shows what the canvas shows; one twice as large shows the same, in tiles", async () => {
  const { page, complaints, close } = await open(site.browser, `${site.server.url}/m/fort?error=8`, { ...SHARP, size: [700, 500] });
  await canvasOf(page).focus();
  await page.keyboard.press("p");
  await dialogOf(page).getByRole("checkbox", { name: "With the scale bar" }).uncheck();
  const small = await save(page);
  await dialogOf(page).waitFor({ state: "hidden" });
  // Away from edges, which are smoothed alike but not on the same places.
  const spots = [
    [0.5, 0.5],
    [0.5, 0.58],
    [0.1, 0.1],
    [0.9, 0.95],
  ];
  const canvas = await pixels(page);
  const seen = ([x, y]) => {
    const at = (Math.floor(y * canvas.height) * canvas.width + Math.floor(x * canvas.width)) * 4;
    return [...canvas.pixels.subarray(at, at + 3)];
  };
  assert.deepEqual(
    spots.map(([x, y]) => small.at(Math.floor(x * small.width), Math.floor(y * small.height))),
    spots.map(seen),
  );
  assert.equal(small.channels, 3);
  const size = await canvasOf(page).evaluate((canvas) => [canvas.width, canvas.height]);
  assert.deepEqual([small.width, small.height], size);
  assert.deepEqual([canvas.width, canvas.height], size);
  await page.keyboard.press("p");
  await dialogOf(page).getByRole("radio", { name: "Twice as large" }).check();
  const large = await save(page);
  assert.deepEqual(
    [large.width, large.height],
    size.map((v) => v * 2),
  );
  // Brightness averaged over cells is that of the small one: the same view, finer.
  const mean = (picture, x0, y0, w, h) => {
    let sum = 0;
    for (let y = 0; y < h; y += 2)
      for (let x = 0; x < w; x += 2)
        sum += picture
          .at(x0 + x, y0 + y)
          .slice(0, 3)
          .reduce((a, b) => a + b);
    return sum / (Math.ceil(w / 2) * Math.ceil(h / 2) * 3);
  };
  for (let i = 0; i < 5; i += 1) {
    for (let j = 0; j < 5; j += 1) {
      const [w, h] = [Math.floor(size[0] / 5), Math.floor(size[1] / 5)];
      const [a, b] = [mean(small, i * w, j * h, w, h), mean(large, i * w * 2, j * h * 2, w * 2, h * 2)];
      assert.ok(Math.abs(a - b) < 8, `cell ${i}, ${j}: ${a} and ${b}`);
    }
  }
  assert.deepEqual(complaints, []);
  await close();
});

test("a picture of any size has a scale bar if requested, and a background unless none is requested", async () => {
  const { page, complaints, close } = await open(site.browser, `${site.server.url}/m/fort?error=8`, { ...SHARP, size: [700, 500] });
  const shown = await pixels(page);
  await openDialog(page);
  await dialogOf(page).getByRole("radio", { name: "Another size" }).check();
  const width = dialogOf(page).getByRole("spinbutton", { name: "Width, px" });
  await width.fill("2500");
  await dialogOf(page).getByRole("spinbutton", { name: "Height, px" }).fill("1100");
  await dialogOf(page).getByRole("checkbox", { name: "Transparent background" }).check();
  const picture = await save(page);
  assert.deepEqual([picture.width, picture.height, picture.channels], [2500, 1100, 4]);
  assert.equal(picture.at(3, 3)[3], 0, "the background is clear");
  assert.equal(picture.at(1250, 550)[3], 255, "the model is not");
  assert.ok(picture.at(2500 - 40, 1100 - 40)[3] > 200, "the scale bar's plate stands in the corner");
  await waitFor(page, "settled");
  const again = await pixels(page);
  // The finer surface that the picture needed may still be shown, so a few pixels differ; another background or shading would change far more.
  let differing = 0;
  for (let at = 0; at < shown.pixels.length; at += 4) differing += shown.pixels.readUInt32LE(at) === again.pixels.readUInt32LE(at) ? 0 : 1;
  assert.ok(differing < 0.05 * shown.width * shown.height, `the page's own picture is as before: ${differing} pixels differ`);
  // Sizes that cannot be are refused in words.
  await openDialog(page);
  await width.evaluate((input) => (input.max = "")); // past the browser's own check
  await width.fill("20000");
  await dialogOf(page).getByRole("button", { name: "Save the picture" }).click();
  assert.match(await dialogOf(page).getByRole("alert").innerText(), /16,384/);
  assert.deepEqual(complaints, []);
  await close();
});
