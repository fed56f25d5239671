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
import { after, before, test as nodeTest } from "node:test";
import { fileURLToPath } from "node:url";
import { promisify } from "node:util";
import { chromium } from "playwright-core";
import { decodePng } from "./png.mjs";

export const ROOT = path.resolve(path.dirname(fileURLToPath(import.meta.url)), "../..");
export const KILWA = process.env.KILWA_BIN || process.env.KILWA || path.join(ROOT, "target/debug/kilwa");
/** Moves the chunks of a pack beyond any 32-bit offset: an example of kilwa-pack, built with the tests. */
export const FAR = path.join(path.dirname(KILWA), "examples/far");
export const WWW = process.env.KILWA_WWW || path.join(ROOT, "www/dist");
const TRIANGLES = 200_000;

/** A test with a time limit: one that waits for an answer that never comes fails by its name, and the others run. */
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
  // Without a graphics card, panels and text are painted with less work by Chromium's own painter than through SwiftShader.
  "--disable-gpu-rasterization",
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
export const cameraOf = async (page) => numbersOf(await page.evaluate(() => globalThis.kilwa.api.getCamera()));

/**
 * The path of a pack of a fort, made once per version of the program. Test files that run at once may each make it; it gets its name when it is complete.
 * @param {number} triangles
 */
export async function cachedFort(triangles) {
  const cached = path.join(tmpdir(), `kilwa-browser-${triangles}-${(await stat(KILWA)).mtimeMs}.kilwa`);
  if (await stat(cached).catch(() => null)) return cached;
  const run = promisify(execFile);
  const making = await mkdtemp(path.join(tmpdir(), "kilwa-browser-fort-"));
  const [mesh, pack] = [path.join(making, "fort.ply"), path.join(making, "fort.kilwa")];
  await run(KILWA, ["synth", "fort", "--triangles", String(triangles), "-o", mesh]);
  await run(KILWA, ["build", mesh, "-o", pack]);
  await rename(pack, cached);
  await rm(making, { recursive: true });
  return cached;
}

/** A folder with `fort.kilwa` in it. */
export async function packFolder() {
  const folder = await mkdtemp(path.join(tmpdir(), "kilwa-browser-"));
  await copyFile(process.env.KILWA_PACK || (await cachedFort(TRIANGLES)), path.join(folder, "fort.kilwa"));
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
      // Not a pause: a server that does not end is killed, so that the test fails instead of waiting for ever.
      const late = setTimeout(() => child.kill("SIGKILL"), 60_000);
      assert.equal(await ended, 0, "kilwa serve ends without an error on SIGTERM");
      clearTimeout(late);
      await rm(folder, { recursive: true });
    },
  };
}

/**
 * The fort on a server, and a browser, from before the first test of a file until after its last: the `folder` of packs with its `pack`, the
 * `server`, the `browser`, and with `proxied` a `proxy` before the server (see `hostile`). `prepare(folder)` may add other packs.
 */
export function fortSite({ prepare, proxied = false } = {}) {
  const site = {};
  before(async () => {
    site.folder = await packFolder();
    site.pack = path.join(site.folder, "fort.kilwa");
    await prepare?.(site.folder);
    site.server = await serve(site.folder);
    if (proxied) site.proxy = await hostile(site.server.url);
    site.browser = await launch();
  });
  after(async () => {
    await site.browser?.close();
    await site.proxy?.stop();
    await site.server?.stop();
  });
  return site;
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
  // Not a pause of a test: the server that is simulated is this slow.
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

/**
 * For tests that count pixels: one of the picture for each of the layout. Elsewhere a pixel of the picture is as large as four of the layout, because the
 * processor draws each.
 */
export const SHARP = { deviceScaleFactor: 1 };

/** A page, with everything it complained about and every request for a pack. */
export async function open(browser, url, { size = [800, 600], wait = "settled", before, ...options } = {}) {
  // Flights of the camera and fades take time and change nothing that is tested, but for the tests that ask for them.
  const context = await browser.newContext({
    viewport: { width: size[0], height: size[1] },
    ...(process.env.KILWA_SHOTS ? SHARP : { deviceScaleFactor: 0.5 }),
    reducedMotion: "reduce",
    ...options,
  });
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
  if (what === "trouble") return troubleOf(page).waitFor();
  const done = {
    first: () => Boolean(globalThis.kilwa?.api.isReady),
    settled: () => Boolean(globalThis.kilwa?.api.stats()?.settled),
  };
  await page.waitForFunction(done[what], null, { polling: 50 });
}

/** The figures that the API gives (docs/embedding.md). */
export const stats = (page) => page.evaluate(() => globalThis.kilwa.api.stats());

/** The message in place of a model that cannot be shown. */
export const troubleOf = (page) => page.getByRole("alert").filter({ has: page.getByRole("heading") });

/** The model's picture, as an element of the page. */
export const canvasOf = (page) => page.getByRole("application");

/** The page coordinates of a point in the picture: `x` and `y` are fractions of its width and height. */
export async function spotOn(page, x, y) {
  const box = await canvasOf(page).boundingBox();
  return [box.x + box.width * x, box.y + box.height * y];
}

/** Click a point in the picture; `options` are those of `mouse.click`. */
export const press = async (page, x, y, options) => page.mouse.click(...(await spotOn(page, x, y)), options);

/** Drag from one point in the picture to another, each `[x, y]` in fractions of its width and height. */
export async function drag(page, from, to, { steps = 4, ...options } = {}) {
  await page.mouse.move(...(await spotOn(page, ...from)));
  await page.mouse.down(options);
  await page.mouse.move(...(await spotOn(page, ...to)), { steps });
  await page.mouse.up(options);
}

/** What the API picks at a point in the picture, or null; `x` and `y` are fractions of its width and height. */
export async function pick(page, x, y) {
  const { width, height } = await canvasOf(page).boundingBox();
  return page.evaluate(([x, y]) => globalThis.kilwa.api.pick(x, y), [width * x, height * y]);
}

/** Move the camera without a flight, and wait until everything in view is loaded. */
export async function setCamera(page, camera) {
  await page.evaluate((camera) => globalThis.kilwa.api.setCamera(camera), camera);
  await waitFor(page, "settled");
}

/** A button of the toolbar beside the picture, by its English name. */
export const tool = (page, name) => page.getByRole("toolbar", { name: "Tools", exact: true }).getByRole("button", { name, exact: true });

/** Open a tab of the details panel by its English name. */
export const openTab = (page, name) => page.getByRole("tab", { name, exact: true }).click();

/** The display settings as links hold them: defaults are left out. */
export const displayOf = (page) => page.evaluate(() => globalThis.kilwa.api.state().display ?? {});

/** Shows only the canvas: everything over it is invisible, but stays in place, keeps the focus, and can be pressed. */
export const BARE = `:not(:has([role="application"]), [role="application"]) { opacity: 0 !important; transition: none !important; }
[role="application"] { outline: none !important; transition: none !important; }`;

/** The model's picture as it is on screen: red, green, blue and alpha, rows from the top. Of a page, or of a frame in one. */
export async function pixels(page) {
  await page.evaluate((css) => {
    globalThis.bare ??= new CSSStyleSheet();
    globalThis.bare.replaceSync(css);
    if (!document.adoptedStyleSheets.includes(globalThis.bare)) document.adoptedStyleSheets.push(globalThis.bare);
  }, BARE);
  // Hiding the caret would add a style, which the page's security policy forbids.
  const png = await canvasOf(page).screenshot({ caret: "initial" });
  await page.evaluate(() => globalThis.bare.replaceSync(""));
  return decoded(png);
}

/** A PNG's pixels: red, green, blue and alpha, rows from the top; or only a part, `[left, top, width, height]`. */
export function decoded(png, part) {
  const { width: whole, height: tall, channels, pixels: bytes } = decodePng(png);
  const [left, top, width, height] = part?.map(Math.round) ?? [0, 0, whole, tall];
  const all = Buffer.alloc(width * height * 4, 255);
  for (let y = 0, to = 0; y < height; y += 1) {
    let from = ((top + y) * whole + left) * channels;
    for (let x = 0; x < width; x += 1, from += channels, to += 4) bytes.copy(all, to, from, from + channels);
  }
  return { width, height, pixels: all };
}

/** Figures of the model's picture on screen: how much of it is model, a hash of its pixels, and the pixel in its middle. */
export const picture = async (page) => figuresOf(await pixels(page));

/** These figures of a picture that is at hand. */
export function figuresOf({ width, height, pixels: bytes }) {
  let model = 0;
  let hash = 0;
  for (let y = 0; y < height; y += 1) {
    // The background is one colour per row; the first pixel of each row shows it.
    const row = y * width * 4;
    for (let x = 0; x < width; x += 1) {
      const at = row + x * 4;
      const isBackground = [0, 1, 2].every((i) => Math.abs(bytes[at + i] - bytes[row + i]) <= 2);
      if (!isBackground) model += 1;
      hash = (Math.imul(hash, 31) + bytes[at] + bytes[at + 1] * 7 + bytes[at + 2] * 13) | 0;
    }
  }
  const middle = ((height >> 1) * width + (width >> 1)) * 4;
  return { width, height, share: model / (width * height), hash, middle: [...bytes.subarray(middle, middle + 4)] };
}
