// Drawings to scale from the page: as large as those of `kilwa render --scale`, the scale bar as long as it says, PDF and PNG sound.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { readFile } from "node:fs/promises";
import path from "node:path";
import { after, before, test } from "node:test";
import { promisify } from "node:util";
import { inflateSync } from "node:zlib";
import { ROOT, launch, open, packFolder, serve, waitFor } from "./harness.mjs";

const KILWA = process.env.KILWA_BIN || process.env.KILWA || path.join(ROOT, "target/debug/kilwa");
const [SCALE, DPI] = [500, 200];

let server;
let browser;
let pack;

before(async () => {
  const folder = await packFolder();
  pack = path.join(folder, "fort.kilwa");
  server = await serve(folder);
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
});

/** Chunks of a PNG by name, and its pixels as grey: rows of numbers. */
function png(bytes) {
  const chunks = {};
  for (let at = 8; at < bytes.length; ) {
    const length = bytes.readUInt32BE(at);
    const name = bytes.toString("latin1", at + 4, at + 8);
    (chunks[name] ??= []).push(bytes.subarray(at + 8, at + 8 + length));
    at += length + 12;
  }
  const [head] = chunks.IHDR;
  const [width, height] = [head.readUInt32BE(0), head.readUInt32BE(4)];
  assert.deepEqual([head[8], head[9], head[12]], [8, 2, 0], "eight bits, red green blue, not interlaced");
  const data = inflateSync(Buffer.concat(chunks.IDAT));
  const line = width * 3;
  const rows = [];
  let above = Buffer.alloc(line);
  for (let y = 0; y < height; y += 1) {
    const filter = data[y * (line + 1)];
    const row = Buffer.from(data.subarray(y * (line + 1) + 1, (y + 1) * (line + 1)));
    for (let i = 0; i < line; i += 1) {
      const [a, b, c] = [i < 3 ? 0 : row[i - 3], above[i], i < 3 ? 0 : above[i - 3]];
      const p = a + b - c;
      const [pa, pb, pc] = [Math.abs(p - a), Math.abs(p - b), Math.abs(p - c)];
      row[i] += [0, a, b, (a + b) >> 1, pa <= pb && pa <= pc ? a : pb <= pc ? b : c][filter];
    }
    rows.push(row);
    above = row;
  }
  const grey = (x, y) => (rows[y][x * 3] + rows[y][x * 3 + 1] + rows[y][x * 3 + 2]) / 3;
  return { width, height, grey, dots: chunks.pHYs?.[0].readUInt32BE(0) };
}

/** What the dialog saves. */
async function save(page, { view, format, paper = "" }) {
  await page.evaluate(() => globalThis.kilwa.pictures.open());
  await page.locator("input[name=picture-size][value=sheet]").check();
  await page.locator("#sheet-view").selectOption(view);
  await page.locator("#sheet-format").selectOption(format);
  await page.locator("#sheet-paper").selectOption(paper);
  await page.locator("#sheet-scale").fill(String(SCALE));
  await page.locator("#sheet-dpi").fill(String(DPI));
  const saved = page.waitForEvent("download");
  await page.locator("#picture-make").click();
  const file = await saved;
  return { name: file.suggestedFilename(), bytes: await readFile(await file.path()) };
}

/** Dark pixels side by side from a place. */
function dark({ grey, width }, x, y) {
  let n = 0;
  while (x + n < width && grey(x + n, y) < 60) n += 1;
  return n;
}

test("a plan from the page has the size, the place and the scale of the one that kilwa render draws", async () => {
  const { page, complaints, close } = await open(browser, `${server.url}/m/fort?error=8`, { size: [800, 600], acceptDownloads: true });
  await waitFor(page, "settled");
  const camera = await page.evaluate(() => [...globalThis.kilwa.viewer.camera()]);
  const { name, bytes } = await save(page, { view: "plan", format: "png" });
  assert.ok(name.endsWith(".plan-1-500.png"), name);
  const here = png(bytes);
  const out = path.join(path.dirname(pack), "native.png");
  await promisify(execFile)(KILWA, ["render", pack, "-o", out, "--view", "plan", "--scale", `1:${SCALE}`, "--dpi", String(DPI), "--mode", "colour"]);
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
  assert.deepEqual(await page.evaluate(() => [...globalThis.kilwa.viewer.camera()]), camera, "the view is as it was");
  assert.deepEqual(complaints, []);
  await close();
});

test("an elevation as PDF is a sound file of the paper's size, and paper that is too small is said before anything is drawn", async () => {
  const { page, complaints, close } = await open(browser, `${server.url}/m/fort?error=8`, { size: [800, 600], acceptDownloads: true });
  const { bytes } = await save(page, { view: "south", format: "pdf", paper: "A3" });
  const words = bytes.toString("latin1");
  assert.ok(words.startsWith("%PDF-1.4") && words.trimEnd().endsWith("%%EOF"));
  assert.match(words, /MediaBox \[0 0 (1190\.5\d+ 841\.8\d+|841\.8\d+ 1190\.5\d+)\]/);
  const table = Number(/startxref\n(\d+)/.exec(words)[1]);
  const [, count] = /^xref\n0 (\d+)/.exec(words.slice(table)).map(Number);
  const offsets = [...words.slice(table).matchAll(/^(\d{10}) 00000 n $/gm)].map(([, at]) => Number(at));
  assert.equal(offsets.length, count - 1);
  for (const [n, at] of offsets.entries()) assert.ok(words.slice(at).startsWith(`${n + 1} 0 obj`), `object ${n + 1}`);
  const streams = [...words.matchAll(/\/Length (\d+) >>\nstream\n/g)];
  for (const match of streams) {
    const from = match.index + match[0].length;
    inflateSync(bytes.subarray(from, from + Number(match[1])));
  }
  assert.ok(streams.length >= 2);
  await page.evaluate(() => globalThis.kilwa.pictures.open());
  await page.locator("#sheet-scale").fill("1");
  await page.locator("#picture-make").click();
  await page.locator("#picture-error:not([hidden])").waitFor();
  assert.match(await page.locator("#picture-error").textContent(), /more than the paper holds/);
  assert.deepEqual(complaints, []);
  await close();
});
