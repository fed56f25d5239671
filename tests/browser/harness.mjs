// The real server over a real pack, a proxy that misbehaves on request, and Debian's Chromium.
//
// Environment: KILWA or KILWA_BIN (the program; default target/debug/kilwa), KILWA_PACK (a pack; default: a fort of
// 200 k triangles, made here), KILWA_WWW (the page; default www/dist), CHROMIUM (default /usr/bin/chromium).

import assert from "node:assert/strict";
import { execFile, spawn } from "node:child_process";
import { copyFile, mkdtemp, rename, rm, stat, writeFile } from "node:fs/promises";
import http from "node:http";
import { tmpdir } from "node:os";
import path from "node:path";
import { test as nodeTest } from "node:test";
import { fileURLToPath } from "node:url";
import { promisify } from "node:util";
import { chromium } from "playwright-core";

export const ROOT = path.resolve(path.dirname(fileURLToPath(import.meta.url)), "../..");
export const KILWA = process.env.KILWA_BIN || process.env.KILWA || path.join(ROOT, "target/debug/kilwa");
/** Moves the chunks of a pack beyond any 32-bit offset: an example of kilwa-pack, built with the tests. */
export const FAR = path.join(path.dirname(KILWA), "examples/far");
export const WWW = process.env.KILWA_WWW || path.join(ROOT, "www/dist");
const TRIANGLES = 200_000;

/** A test that ends: what waits for an answer that never comes fails by its name, and the others run. */
export function test(name, ...rest) {
  const run = rest.pop();
  nodeTest(name, { timeout: 300_000, ...rest[0] }, run);
}

/** With these, WebGPU runs on SwiftShader and a screenshot shows the canvas too. */
const FLAGS = [
  "--no-sandbox",
  "--no-first-run",
  "--disable-background-networking",
  "--disable-component-update",
  "--disable-sync",
  "--enable-unsafe-webgpu",
  "--enable-gpu",
  "--enable-features=Vulkan",
  "--use-vulkan=swiftshader",
  "--use-angle=swiftshader",
  "--enable-unsafe-swiftshader",
  "--ignore-gpu-blocklist",
];

/** A camera as links hold it: nine numbers. */
export const numbersOf = ({ azimuth, elevation, distance, target, orthographic, roll, fieldOfView }) => [
  azimuth,
  elevation,
  distance,
  ...target,
  Number(orthographic),
  roll,
  fieldOfView,
];

/** The camera of a page that shows a model, as numbers. */
export const cameraOf = async (page) => numbersOf(await page.evaluate(() => globalThis.kilwa.viewer.camera()));

/** A folder with `fort.kilwa` in it. */
export async function packFolder() {
  const folder = await mkdtemp(path.join(tmpdir(), "kilwa-browser-"));
  const pack = path.join(folder, "fort.kilwa");
  if (process.env.KILWA_PACK) {
    await copyFile(process.env.KILWA_PACK, pack);
    return folder;
  }
  // Made once per version of the program. Test files that run at once may each make it; it gets its name when it is complete.
  const cached = path.join(tmpdir(), `kilwa-browser-${(await stat(KILWA)).mtimeMs}.kilwa`);
  if (!(await stat(cached).catch(() => null))) {
    const making = await mkdtemp(path.join(tmpdir(), "kilwa-browser-fort-"));
    const run = promisify(execFile);
    const mesh = path.join(making, "fort.ply");
    const built = path.join(making, "fort.kilwa");
    await run(KILWA, ["synth", "fort", "--triangles", String(TRIANGLES), "-o", mesh]);
    await run(KILWA, ["build", mesh, "-o", built]);
    await rename(built, cached);
    await rm(making, { recursive: true });
  }
  await copyFile(cached, pack);
  return folder;
}

/** `measured.kilwa` in a folder: a pack of a flat square whose confidence grows to the east, and is not known beyond three quarters of it. */
export async function measuredPack(folder) {
  const n = 41;
  const vertices = Array.from({ length: n * n }, (_, k) => {
    const [i, j] = [k % n, Math.floor(k / n)];
    return `${i / 10} ${j / 10} ${((i * 7 + j * 3) % 5) / 1000} 180 170 160 ${i > 30 ? "nan" : 10 + i}`;
  });
  const faces = [];
  for (let j = 0; j + 1 < n; j += 1) {
    for (let i = 0; i + 1 < n; i += 1)
      faces.push(`3 ${j * n + i} ${j * n + i + 1} ${(j + 1) * n + i + 1}`, `3 ${j * n + i} ${(j + 1) * n + i + 1} ${(j + 1) * n + i}`);
  }
  const names = ["float x", "float y", "float z", "uchar red", "uchar green", "uchar blue", "float confidence"];
  const header = ["ply", "format ascii 1.0", `element vertex ${vertices.length}`, ...names.map((p) => `property ${p}`)];
  const mesh = path.join(folder, "measured.ply");
  const lines = [...header, `element face ${faces.length}`, "property list uchar int vertex_indices", "end_header", ...vertices, ...faces];
  await writeFile(mesh, `${lines.join("\n")}\n`);
  await promisify(execFile)(KILWA, ["build", mesh, "-o", path.join(folder, "measured.kilwa")]);
  await rm(mesh);
}

/** `kilwa serve`, until `stop()`. */
export async function serve(folder, ...options) {
  const child = spawn(KILWA, ["serve", folder, "--listen", "127.0.0.1:0", "--www", WWW, ...options], { stdio: ["ignore", "pipe", "inherit"] });
  const address = await new Promise((resolve, reject) => {
    let said = "";
    child.stdout.on("data", (text) => {
      said += text;
      const found = /http:\/\/([\d.]+:\d+)\//.exec(said);
      if (found) resolve(found[1]);
    });
    child.once("error", reject);
    child.once("exit", (code) => reject(new Error(`kilwa serve ended with ${code}: ${said}`)));
  });
  const ended = new Promise((resolve) => child.once("exit", resolve));
  return {
    url: `http://${address}`,
    stop: async () => {
      child.kill("SIGTERM");
      const late = setTimeout(() => child.kill("SIGKILL"), 60_000);
      assert.equal(await ended, 0, "kilwa serve ends well when it is told to");
      clearTimeout(late);
      await rm(folder, { recursive: true });
    },
  };
}

/**
 * A proxy before `upstream` that can misbehave about packs. `proxy.mishap` is null, or a function of
 * `{ range: [first, last] | null, number }` that returns null (behave; of several ranges the first), or changes to the answer:
 * `{ status, headers, body(Buffer) → Buffer, whole: true, drop: true, announce, late: milliseconds }`.
 */
export async function hostile(upstream) {
  const proxy = { mishap: null, requests: [] };
  const server = http.createServer((request, response) => {
    answer(proxy, upstream, request, response).catch((error) => response.destroy(error));
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  proxy.url = `http://127.0.0.1:${server.address().port}`;
  proxy.stop = () => {
    server.closeAllConnections();
    return new Promise((resolve) => server.close(resolve));
  };
  return proxy;
}

async function answer(proxy, upstream, request, response) {
  const isPack = request.url.startsWith("/packs/");
  const range = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range ?? "");
  const several = /\.kilwa\/(\d+)-(\d+)/.exec(request.url);
  let mishap = null;
  if (isPack) {
    proxy.requests.push({ range: request.headers.range ?? several?.[0] ?? null, at: Date.now() });
    const first = range ?? several;
    const asked = first ? [Number(first[1]), Number(first[2])] : null;
    mishap = proxy.mishap?.({ range: asked, number: proxy.requests.length }) ?? null;
  }
  if (mishap?.late) await new Promise((resolve) => setTimeout(resolve, mishap.late));
  if (mishap?.drop) {
    request.socket.destroy();
    return;
  }
  const headers = { ...(range && !mishap?.whole ? { range: request.headers.range } : {}) };
  const real = await fetch(upstream + request.url, { headers });
  let body = Buffer.from(await real.arrayBuffer());
  if (mishap?.body) body = mishap.body(body);
  const out = {};
  for (const name of ["content-type", "etag", "content-range", "content-security-policy", "cache-control", "kilwa-ranges"]) {
    if (real.headers.has(name)) out[name] = real.headers.get(name);
  }
  if (isPack) out["cache-control"] = "no-store";
  response.writeHead(mishap?.status ?? real.status, { ...out, "content-length": mishap?.announce ?? body.length, ...mishap?.headers });
  // Fewer bytes than announced: the connection ends in the middle.
  if (mishap?.announce > body.length) response.write(body, () => response.destroy());
  else response.end(body);
}

export const launch = () => chromium.launch({ executablePath: process.env.CHROMIUM || "/usr/bin/chromium", args: FLAGS });

/** A page, with everything it complained about and every request for a pack. */
export async function open(browser, url, { size = [800, 600], wait = "settled", before, ...options } = {}) {
  // Flights of the camera and fades take time and change nothing that is tested, but for the tests that ask for them.
  const context = await browser.newContext({ viewport: { width: size[0], height: size[1] }, reducedMotion: "reduce", ...options });
  const page = await context.newPage();
  page.setDefaultTimeout(Number(process.env.KILWA_TIMEOUT) || 240_000); // software rendering on a busy machine
  const complaints = [];
  const packs = [];
  page.on("console", (message) => message.type() === "error" && complaints.push(message.text()));
  page.on("pageerror", (error) => complaints.push(error.stack ?? error.message));
  page.on("request", (request) => {
    const { pathname } = new URL(request.url());
    if (pathname.startsWith("/packs/")) packs.push(request.headers().range ?? /\.kilwa\/(.*)/.exec(pathname)?.[1] ?? "");
  });
  if (before) await before(page);
  await page.goto(url);
  if (wait) await waitFor(page, wait);
  return { page, complaints, packs, close: () => context.close() };
}

/** Wait until the picture is there (`first`), at rest (`settled`), or refused (`trouble`). */
export async function waitFor(page, what) {
  const done = {
    first: () => document.body?.dataset.state === "ready",
    settled: () => {
      const s = globalThis.kilwa?.session;
      return Boolean(s?.stats?.settled && !s.stats.more && !s.scheduled && s.answers.size === 0);
    },
    trouble: () => document.body?.dataset.state === "trouble",
  };
  await page.waitForFunction(done[what], null, { polling: 50 });
}

export const stats = (page) => page.evaluate(() => globalThis.kilwa.session.stats);

/** The picture that is on screen, read back from a texture: how much of it is model, and a hash of its pixels. */
export const picture = (page) =>
  page.evaluate(async () => {
    const { width, height, pixels } = await globalThis.kilwa.viewer.readPixels();
    let model = 0;
    let hash = 0;
    for (let y = 0; y < height; y += 1) {
      // The background is one colour per row; the first pixel of each row shows it.
      const row = y * width * 4;
      for (let x = 0; x < width; x += 1) {
        const at = row + x * 4;
        const isBackground = [0, 1, 2].every((i) => Math.abs(pixels[at + i] - pixels[row + i]) <= 2);
        if (!isBackground) model += 1;
        hash = (Math.imul(hash, 31) + pixels[at] + pixels[at + 1] * 7 + pixels[at + 2] * 13) | 0;
      }
    }
    const middle = ((height >> 1) * width + (width >> 1)) * 4;
    return { width, height, share: model / (width * height), hash, middle: [...pixels.slice(middle, middle + 4)] };
  });

/** The same, with the pixels themselves: red, green, blue and alpha, rows from the top. */
export async function pixels(page) {
  const { width, height, text } = await page.evaluate(async () => {
    const { width, height, pixels } = await globalThis.kilwa.viewer.readPixels();
    let text = "";
    for (let at = 0; at < pixels.length; at += 32768) text += String.fromCharCode(...pixels.subarray(at, at + 32768));
    return { width, height, text: btoa(text) };
  });
  return { width, height, pixels: Buffer.from(text, "base64") };
}
