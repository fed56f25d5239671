// Drawings to scale from the page: as large and in the same place as those of `kilwa render --scale`, the scale bar as long as it says, also on sheets wider than any canvas;
// PDF, PNG and GeoTIFF sound.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { readFile, rm } from "node:fs/promises";
import path from "node:path";
import { promisify } from "node:util";
import { inflateSync } from "node:zlib";
import { KILWA, cameraOf, fortSite, open, test } from "./harness.mjs";
import { decodePng } from "./png.mjs";

const [SCALE, DPI] = [500, 200];

const site = fortSite({
  // A wall at UTM coordinates, whose reference system is known.
  prepare: async (folder) => {
    const mesh = path.join(folder, "utm.ply");
    const run = promisify(execFile);
    await run(KILWA, ["synth", "wall", "--triangles", "20000", "--utm", "-o", mesh]);
    await run(KILWA, ["build", mesh, "-o", path.join(folder, "utm.kilwa"), "--crs", "EPSG:32737"]);
    await rm(mesh);
  },
});

/** A drawing as PNG: `grey(x, y)` of its pixels, and dots per metre. */
function png(bytes) {
  const { width, height, channels, pixels, chunks } = decodePng(bytes);
  assert.equal(channels, 3, "red, green, blue");
  const grey = (x, y) => {
    const at = (y * width + x) * 3;
    return (pixels[at] + pixels[at + 1] + pixels[at + 2]) / 3;
  };
  return { width, height, grey, dots: chunks.find(({ type }) => type === "pHYs")?.data.readUInt32BE(0) };
}

/** Fields of a TIFF by tag: numbers. */
function tiff(bytes) {
  assert.equal(bytes.toString("latin1", 0, 4), "II*\0");
  const at = bytes.readUInt32LE(4);
  const sizes = { 3: 2, 4: 4, 5: 8, 12: 8 };
  const fields = {};
  for (let n = 0; n < bytes.readUInt16LE(at); n += 1) {
    const entry = at + 2 + n * 12;
    const [tag, type, count] = [bytes.readUInt16LE(entry), bytes.readUInt16LE(entry + 2), bytes.readUInt32LE(entry + 4)];
    const from = count * sizes[type] <= 4 ? entry + 8 : bytes.readUInt32LE(entry + 8);
    const value = {
      3: (p) => bytes.readUInt16LE(p),
      4: (p) => bytes.readUInt32LE(p),
      5: (p) => bytes.readUInt32LE(p) / bytes.readUInt32LE(p + 4),
      12: (p) => bytes.readDoubleLE(p),
    }[type];
    fields[tag] = Array.from({ length: count }, (_, k) => value(from + k * sizes[type]));
  }
  return fields;
}

/** The dialog of pictures and drawings. */
async function openDialog(page) {
  await page.getByRole("banner").getByRole("button", { name: "Save a picture" }).click();
  return page.getByRole("dialog", { name: "Save a picture" });
}
const make = (dialog) => dialog.getByRole("button", { name: "Save the picture" }).click();

/** What the dialog saves. */
async function save(page, { view, format, paper = "", custom = "", scale = SCALE, dpi = DPI, bare = false }) {
  const dialog = await openDialog(page);
  await dialog.getByRole("radio", { name: "Drawing to scale" }).check();
  await dialog.getByRole("combobox", { name: "View" }).selectOption(view);
  await dialog.getByRole("combobox", { name: "File format" }).selectOption(format);
  await dialog.getByRole("combobox", { name: "Paper" }).selectOption(paper);
  if (custom) await dialog.getByRole("textbox", { name: "Width × height, mm" }).fill(custom);
  await dialog.getByRole("checkbox", { name: "Only the model" }).setChecked(bare);
  await dialog.getByRole("spinbutton", { name: "Scale, 1 to" }).fill(String(scale));
  await dialog.getByRole("spinbutton", { name: "Dots per inch" }).fill(String(dpi));
  const saved = page.waitForEvent("download");
  await make(dialog);
  const file = await saved;
  await dialog.waitFor({ state: "hidden" });
  return { name: file.suggestedFilename(), bytes: await readFile(await file.path()) };
}

/** Dark pixels side by side from a place. */
function dark({ grey, width }, x, y) {
  let n = 0;
  while (x + n < width && grey(x + n, y) < 60) n += 1;
  return n;
}

test("a plan from the page has the size, the place and the scale of the one that kilwa render draws", async () => {
  const { page, complaints, close } = await open(site.browser, `${site.server.url}/m/fort?error=8`, { size: [800, 600], acceptDownloads: true });
  const camera = await cameraOf(page);
  const { name, bytes } = await save(page, { view: "plan", format: "png" });
  assert.ok(name.endsWith(".plan-1-500.png"), name);
  const here = png(bytes);
  const out = path.join(site.folder, "native.png");
  await promisify(execFile)(KILWA, [
    "render",
    site.pack,
    "-o",
    out,
    "--force",
    "--view",
    "plan",
    "--scale",
    `1:${SCALE}`,
    "--dpi",
    String(DPI),
    "--mode",
    "colour",
  ]);
  const there = png(await readFile(out));
  assert.deepEqual([here.width, here.height], [there.width, there.height]);
  assert.equal(here.dots, Math.round(DPI / 0.0254));
  const k = DPI / 25.4;
  const size = [here.width / k, here.height / k];
  // The bar begins 16 mm from the left and 9 mm below the frame; it is black along its upper edge.
  const [x, y] = [Math.round(16 * k), Math.round((size[1] - 40 + 9) * k)];
  const metres = 20;
  const wanted = ((metres * 1000) / SCALE) * k;
  const [long, native] = [dark(here, x, y), dark(there, x, y)];
  console.log(`trust | scale bar of a drawing from the page, pixels off | 0.5 | ${Math.abs(long - wanted).toFixed(3)}`);
  assert.ok(Math.abs(long - wanted) <= 0.5 + 1e-9, `${long} instead of ${wanted}`);
  assert.equal(long, native);
  // The model lies on the same pixels: where one shows ground or sky, so does the other.
  let [both, differing] = [0, 0];
  for (let v = Math.round(20 * k); v < Math.round((size[1] - 50) * k); v += 3) {
    for (let u = Math.round(20 * k); u < Math.round((size[0] - 20) * k); u += 3) {
      const [a, b] = [here.grey(u, v) < 245, there.grey(u, v) < 245];
      both += a && b ? 1 : 0;
      differing += a === b ? 0 : 1;
    }
  }
  assert.ok(both > 500, `${both}`);
  assert.ok(differing < both * 0.03, `${differing} of ${both} pixels differ`);
  assert.deepEqual(await cameraOf(page), camera, "the view is as it was");
  assert.deepEqual(complaints, []);
  await close();
});

test("an elevation as PDF is a sound file of the paper's size, and paper that is too small is reported before anything is drawn", async () => {
  const { page, complaints, close } = await open(site.browser, `${site.server.url}/m/fort?error=8`, { size: [800, 600], acceptDownloads: true });
  const { bytes } = await save(page, { view: "south", format: "pdf", paper: "A3" });
  const words = bytes.toString("latin1");
  assert.ok(words.startsWith("%PDF-1.4") && words.trimEnd().endsWith("%%EOF"));
  assert.match(words, /MediaBox \[0 0 (1190\.5\d+ 841\.8\d+|841\.8\d+ 1190\.5\d+)\]/);
  const table = Number(/startxref\n(\d+)/.exec(words)[1]);
  const [, count] = /^xref\n0 (\d+)/.exec(words.slice(table)).map(Number);
  const offsets = [...words.slice(table).matchAll(/^(\d{10}) 00000 n $/gm)].map(([, at]) => Number(at));
  assert.equal(offsets.length, count - 1);
  for (const [n, at] of offsets.entries()) assert.ok(words.slice(at).startsWith(`${n + 1} 0 obj`), `object ${n + 1}`);
  const streams = [...words.matchAll(/\/FlateDecode \/Length (\d+) >>\nstream\n/g)];
  for (const match of streams) {
    const from = match.index + match[0].length;
    inflateSync(bytes.subarray(from, from + Number(match[1])));
  }
  assert.ok(streams.length >= 1);
  const dialog = await openDialog(page);
  await dialog.getByRole("spinbutton", { name: "Scale, 1 to" }).fill("1");
  await make(dialog);
  await dialog.getByRole("alert").waitFor();
  assert.match(await dialog.getByRole("alert").innerText(), /larger than the paper\. 1:\d+ would fit/);
  assert.deepEqual(complaints, []);
  await close();
});

test("a plan as GeoTIFF has the tags, and as PNG the world file, that kilwa render writes", async () => {
  const { page, complaints, close } = await open(site.browser, `${site.server.url}/m/utm?error=8`, { size: [800, 600], acceptDownloads: true });
  const asked = { view: "plan", scale: 100, paper: "A4" };
  const native = async (name) => {
    const out = path.join(site.folder, name);
    await promisify(execFile)(KILWA, [
      "render",
      path.join(site.folder, "utm.kilwa"),
      "-o",
      out,
      "--force",
      "--view",
      "plan",
      "--scale",
      "1:100",
      "--dpi",
      String(DPI),
      "--paper",
      "A4",
    ]);
    return readFile(out);
  };
  const saved = await save(page, { ...asked, format: "tif" });
  assert.ok(saved.name.endsWith(".plan-1-100.tif"), saved.name);
  const [here, there] = [tiff(saved.bytes), tiff(await native("native.tif"))];
  assert.deepEqual(Object.keys(here), Object.keys(there));
  // Where strips lie and how long they are depends on who deflated them.
  const [offsets, lengths] = [273, 279];
  for (const tag of Object.keys(here).filter((t) => ![offsets, lengths].includes(Number(t)))) assert.deepEqual(here[tag], there[tag], `tag ${tag}`);
  assert.deepEqual(here[34735].slice(-4), [3072, 0, 1, 32737]);
  const [[width], [height], [rows]] = [here[256], here[257], here[278]];
  const strips = here[offsets].map((at, k) => inflateSync(saved.bytes.subarray(at, at + here[lengths][k])));
  assert.equal(
    strips.reduce((n, s) => n + s.length, 0),
    width * height * 3,
  );
  assert.equal(strips.length, Math.ceil(height / rows));
  const off = Math.max(...[33550, 33922].flatMap((tag) => here[tag].map((v, k) => Math.abs(v - there[tag][k]))));
  console.log(`trust | GeoTIFF of the page beside that of kilwa render, metres | 0 | ${off}`);
  // The same as PNG: the world file has a press of its own.
  const picture = await save(page, { ...asked, format: "png" });
  const world = page.waitForEvent("download");
  await page.getByRole("button", { name: "World file" }).click();
  const file = await world;
  assert.equal(file.suggestedFilename(), picture.name.replace(".png", ".pgw"));
  await native("native.png");
  assert.equal(await readFile(await file.path(), "utf8"), await readFile(path.join(site.folder, "native.pgw"), "utf8"));
  assert.deepEqual(complaints, []);
  await close();
});

test("on a sheet wider than 16,384 pixels a bar of 10 m measures 10 m to half a pixel, and the model lies where kilwa render draws it", async () => {
  const { page, complaints, close } = await open(site.browser, `${site.server.url}/m/fort?error=8`, { size: [800, 600], acceptDownloads: true });
  // Few dots per inch: a wide sheet of few pixels.
  const [scale, metres, dpi] = [125, 10, 100];
  const paper = [4200, 160];
  const { bytes } = await save(page, { view: "south", format: "png", paper: "custom", custom: paper.join("x"), scale, dpi });
  const here = png(bytes);
  const k = dpi / 25.4;
  assert.equal(here.width, Math.round(paper[0] * k));
  assert.ok(here.width > 16_384, `${here.width}`);
  const wanted = ((metres * 1000) / scale) * k;
  const [x, y] = [Math.round(16 * k), Math.round((paper[1] - 40 + 9) * k)];
  const long = dark(here, x, y);
  console.log(`trust | bar of 10 m on a sheet of ${here.width} pixels from the page, pixels off | 0.5 | ${Math.abs(long - wanted).toFixed(3)}`);
  assert.ok(Math.abs(long - wanted) <= 0.5 + 1e-9, `${long} instead of ${wanted}`);
  // The same drawing, native: the same columns show the model.
  const out = path.join(site.folder, "wide.png");
  await promisify(execFile)(KILWA, [
    "render",
    site.pack,
    "-o",
    out,
    "--force",
    "--view",
    "south",
    "--scale",
    `1:${scale}`,
    "--dpi",
    String(dpi),
    "--paper",
    paper.join("x"),
    "--mode",
    "colour",
  ]);
  const there = png(await readFile(out));
  assert.deepEqual([here.width, here.height], [there.width, there.height]);
  let [both, differing] = [0, 0];
  for (let v = Math.round(25 * k); v < Math.round((paper[1] - 55) * k); v += 7) {
    for (let u = Math.round(25 * k); u < here.width - Math.round(25 * k); u += 7) {
      const [a, b] = [here.grey(u, v) < 245, there.grey(u, v) < 245];
      both += a && b ? 1 : 0;
      differing += a === b ? 0 : 1;
    }
  }
  assert.ok(both > 500, `${both}`);
  assert.ok(differing < both * 0.03, `${differing} of ${both} pixels differ`);
  assert.deepEqual(complaints, []);
  await close();
});
