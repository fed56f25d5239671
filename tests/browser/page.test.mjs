// The page in Chromium through `kilwa serve`: one browser, one page at a time.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import path from "node:path";
import { after, before } from "node:test";
import { cameraOf, hostile, launch, open, packFolder, picture, serve, stats, test, waitFor } from "./harness.mjs";

const HEAD = "bytes=0-65535";
let folder;
let server;
let proxy;
let browser;

before(async () => {
  folder = await packFolder();
  server = await serve(folder);
  proxy = await hostile(server.url);
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await proxy?.stop();
  await server?.stop();
});

const fort = (query = "", base = server.url) => `${base}/m/fort${query}`;

test("the first picture needs one range request of the pack, and the model then refines to the target", async () => {
  // Everything after the head is held back: the picture must come all the same.
  let release;
  const held = new Promise((resolve) => (release = resolve));
  const { page, complaints, packs, close } = await open(browser, fort(), {
    wait: "first",
    before: (page) =>
      page.route("**/packs/**", async (route) => {
        if (route.request().headers().range !== HEAD) await held;
        await route.continue();
      }),
  });
  assert.equal(packs.filter((range) => range === HEAD).length, 1);
  const atFirst = await page.evaluate(() => ({ ...globalThis.kilwa.session.stats, asked: globalThis.kilwa.pack.received }));
  assert.equal(atFirst.asked, 0, "nothing but the head has arrived");
  assert.ok(atFirst.trianglesDrawn > 0);
  const coarse = await picture(page);
  assert.ok(coarse.share > 0.05, `only ${coarse.share} of the first picture is model`);
  release();
  await waitFor(page, "settled");
  const s = await stats(page);
  assert.ok(s.targetReached && s.worstPixelError <= s.targetPixels, JSON.stringify(s));
  assert.ok(s.trianglesDrawn > atFirst.trianglesDrawn);
  const fine = await picture(page);
  assert.ok(Math.abs(fine.share - coarse.share) < 0.25 * coarse.share, "the coarse picture stands where the fine one does");
  assert.notEqual(fine.hash, coarse.hash);
  assert.equal(packs.filter((range) => range === HEAD).length, 1);
  assert.ok(
    packs.every((range) => /^(bytes=\d+-\d+|\d+-\d+(,\d+-\d+)+)$/.test(range)),
    "only ranges are asked for",
  );
  assert.deepEqual(complaints, []);
  await close();
});

test("keyboard, mouse, wheel and fingers fly the camera, and the error comes back to the target", async () => {
  const { page, complaints, close } = await open(browser, fort("?error=2"), { hasTouch: true });
  const canvas = page.locator("#canvas");
  const camera = () => cameraOf(page);
  const near = (a, b) => a.every((v, i) => Math.abs(v - b[i]) < 1e-6);
  let last = { camera: await camera(), picture: await picture(page) };
  const step = async (name, act, { moves = true } = {}) => {
    await act();
    await page.waitForTimeout(60);
    await waitFor(page, "settled");
    const now = { camera: await camera(), picture: await picture(page) };
    assert.equal(!near(now.camera, last.camera), moves, `${name}: the camera`);
    if (moves) assert.notEqual(now.picture.hash, last.picture.hash, `${name}: the picture`);
    const s = await stats(page);
    assert.ok(s.targetReached, `${name}: ${s.worstPixelError} px of ${s.targetPixels}`);
    const before = last;
    last = now;
    return { before, now };
  };
  const drag = async (from, to, options = {}) => {
    await page.mouse.move(...from);
    await page.mouse.down(options);
    await page.mouse.move(...to, { steps: 3 });
    await page.mouse.up(options);
  };
  const box = await canvas.boundingBox();
  const middle = [box.x + box.width / 2, box.y + box.height / 2];
  await canvas.focus();

  const left = await step("arrow", () => page.keyboard.press("ArrowLeft"));
  assert.notEqual(left.before.camera[0], left.now.camera[0]);
  await step("shift and arrow", () => page.keyboard.press("Shift+ArrowUp"));
  const plus = await step("plus", () => page.keyboard.press("+"));
  assert.ok(plus.now.camera[2] < plus.before.camera[2]);
  await step("drag", () => drag(middle, [middle[0] + 80, middle[1] + 30]));
  const panned = await step("right drag", () => drag(middle, [middle[0] - 50, middle[1]], { button: "right" }));
  assert.deepEqual(panned.now.camera.slice(0, 3), panned.before.camera.slice(0, 3), "a pan turns nothing");
  await step("show all", () => page.keyboard.press("f"));

  // The wheel goes towards what is under the pointer, which stays there.
  const place = [middle[0] + 60, middle[1] + 20];
  const under = () =>
    page.evaluate(([x, y]) => {
      const { viewer, session } = globalThis.kilwa;
      const b = session.canvas.getBoundingClientRect();
      return [...viewer.pick((x - b.left) * session.ratio, (y - b.top) * session.ratio)];
    }, place);
  const target = await under();
  assert.equal(target.length, 4, "the pointer is over the model");
  await page.mouse.move(...place);
  const wheeled = await step("wheel", () => page.mouse.wheel(0, -240));
  const stays = await under();
  const moved = Math.hypot(...[0, 1, 2].map((i) => stays[i] - target[i]));
  assert.ok(wheeled.now.camera[2] < wheeled.before.camera[2] * 0.8);
  assert.ok(moved < wheeled.now.camera[2] * 0.05, `what was under the pointer moved by ${moved} m`);
  assert.match(await page.locator("#coordinates").textContent(), /x -?[\d.,]+ {2}y -?[\d.,]+ {2}z -?[\d.,]+ m/);

  // A double click turns about the place without moving the picture's direction.
  const pivoted = await step("double click", () => page.mouse.dblclick(...place));
  assert.deepEqual(pivoted.now.camera.slice(0, 2), pivoted.before.camera.slice(0, 2));

  for (const [key, name] of [
    ["1", "plan"],
    ["3", "east"],
    ["6", "oblique"],
  ]) {
    await step(name, () => page.keyboard.press(key));
  }
  await step("minus, closer again by the button", () => page.locator("#zoom-in").click());
  await step("two fingers", () => pinch(page, middle));
  assert.deepEqual(complaints, []);
  await close();
});

/** Two fingers that move apart and turn a little. */
async function pinch(page, [x, y]) {
  const client = await page.context().newCDPSession(page);
  const points = (d, a) => [1, -1].map((s, id) => ({ id, x: x + s * d * Math.cos(a), y: y + s * d * Math.sin(a) }));
  await client.send("Input.dispatchTouchEvent", { type: "touchStart", touchPoints: points(40, 0) });
  for (let i = 1; i <= 4; i += 1) {
    await client.send("Input.dispatchTouchEvent", { type: "touchMove", touchPoints: points(40 + i * 12, i * 0.08) });
  }
  await client.send("Input.dispatchTouchEvent", { type: "touchEnd", touchPoints: [] });
}

test("a view comes back from its address", async () => {
  const first = await open(browser, fort("?error=8"));
  await first.page.keyboard.press("3");
  await first.page.keyboard.press("+");
  await waitFor(first.page, "settled");
  await first.page.waitForFunction(() => location.hash.includes("view="));
  await first.page.waitForTimeout(600);
  const address = first.page.url();
  const before = await picture(first.page);
  await first.close();
  const second = await open(browser, address);
  assert.deepEqual(await picture(second.page), before);
  assert.deepEqual([...first.complaints, ...second.complaints], []);
  await second.close();
});

test("the memory limit holds during a flight, and what was forgotten comes back", async () => {
  const { page, complaints, close } = await open(browser, fort("?memory=2&error=1"));
  const limit = 2e6;
  const over = [];
  const check = async () => {
    const s = await stats(page);
    if (s.gpuBytes > limit || s.gpuBytesHeld > limit) over.push(s);
    return s;
  };
  assert.ok((await check()).budgetLimited, "two megabytes are too few for this model: else the test shows nothing");
  // Two rounds past four places, each looked at from near.
  const places = await page.evaluate(() => {
    const { viewer, session } = globalThis.kilwa;
    const { width, height } = session.canvas;
    return [
      [0.3, 0.55],
      [0.7, 0.55],
      [0.5, 0.45],
      [0.5, 0.7],
    ]
      .map(([x, y]) => [...viewer.pick(x * width, y * height)].slice(0, 3))
      .filter((place) => place.length === 3);
  });
  assert.ok(places.length >= 3, "the model is where it is looked for");
  const received = [];
  for (let round = 0; round < 2; round += 1) {
    for (const place of places) {
      await page.evaluate((place) => {
        globalThis.kilwa.viewer.setCamera({ azimuth: 4, elevation: 0.5, distance: 5, target: place, orthographic: false, roll: 0, fieldOfView: 0.7 });
        globalThis.kilwa.session.wake();
      }, place);
      await page.waitForTimeout(60);
      await waitFor(page, "settled");
      await check();
    }
    received.push((await stats(page)).bytesReceived);
  }
  assert.deepEqual(over, []);
  assert.ok(received[1] > received[0], `what was forgotten was asked for again: ${received}`);
  assert.ok((await picture(page)).share > 0.02);
  assert.deepEqual(complaints, []);
  await close();
});

/** What stands on the plate of trouble. */
const plate = (page) => page.locator("#trouble").innerText();

test("a model that is not there, or is no pack, is said with the next step", async () => {
  const trouble = async (mishap) => {
    proxy.mishap = mishap;
    const { page, close } = await open(browser, fort("", proxy.url), { wait: "trouble" });
    const text = await plate(page);
    assert.ok(await page.locator("#trouble-retry").isVisible());
    await close();
    return text;
  };
  assert.match(await trouble(() => ({ status: 404 })), /not found/);
  assert.match(await trouble(() => ({ body: () => Buffer.alloc(65536, 65) })), /damaged[\s\S]*magic bytes/);
  const flipped = (body) => {
    const bad = Buffer.from(body);
    bad[300] ^= 4;
    return bad;
  };
  assert.match(await trouble(() => ({ body: flipped })), /damaged[\s\S]*checksum/);
  // A copy that ends early: the server says so honestly, and the header knows better.
  const short = ({ range }) => ({
    body: (b) => b.subarray(0, 50_000),
    headers: { "content-range": `bytes ${range[0]}-49999/50000` },
  });
  assert.match(await trouble(short), /damaged/);
  assert.match(await trouble(() => ({ whole: true, status: 200, announce: 3e9 })), /whole file of 3\.00\sGB/);
  proxy.mishap = null;
});

test("a server that ignores Range is put up with where the pack is small", async () => {
  proxy.mishap = () => ({ whole: true, status: 200 });
  proxy.requests.length = 0;
  const { page, complaints, close } = await open(browser, fort("?error=4", proxy.url));
  assert.equal(proxy.requests.length, 1);
  assert.match(await page.locator("#notice").innerText(), /does not send parts of files/);
  assert.ok((await stats(page)).targetReached);
  assert.deepEqual(complaints, []);
  await close();
  proxy.mishap = null;
});

test("a silent server at the start, flipped bits, short answers and refusals are outlived, and the picture is right", async () => {
  proxy.mishap = null;
  const right = await open(browser, fort("?error=2", proxy.url));
  const wanted = await picture(right.page);
  await right.close();
  const flip = (b) => {
    const bad = Buffer.from(b);
    for (let at = 7; at < bad.length; at += 4096) bad[at] ^= 64;
    return bad;
  };
  let number = 0;
  let mishaps = 0;
  proxy.mishap = ({ range }) => {
    number += 1;
    if (range[0] === 0) return number === 1 ? { drop: true } : null;
    if (number > 16) return null;
    mishaps += 1;
    return [
      { body: flip },
      { status: 503 },
      { body: (b) => b.subarray(0, b.length >> 1), announce: range[1] - range[0] + 1 },
      { drop: true },
      { body: (b) => b.subarray(1) },
    ][number % 5];
  };
  const { page, complaints, close } = await open(browser, fort("?error=2", proxy.url), { wait: "first" });
  await waitFor(page, "settled");
  const s = await stats(page);
  assert.ok(mishaps >= 5, `only ${mishaps} answers were bad`);
  assert.ok(s.failures >= 5, `only ${s.failures} failures were noticed`);
  assert.ok(s.targetReached);
  assert.deepEqual(await picture(page), wanted, "the same picture as from a good server");
  assert.deepEqual(
    complaints.filter((c) => !/Failed to load resource/.test(c)),
    [],
  );
  await close();
  proxy.mishap = null;
});

test("over two seconds of latency and with weak tags the picture is right, also where bytes change under the same tag", async () => {
  proxy.mishap = null;
  const right = await open(browser, fort("?error=8", proxy.url));
  const wanted = await picture(right.page);
  await right.close();
  let changed = 0;
  proxy.mishap = ({ range, number }) => {
    const late = { late: 2000, headers: { etag: number % 2 ? 'W/"1"' : '"1"' } };
    // Once, the end of an answer is of another file; a weak tag does not tell.
    if (range[0] === 0 || changed > 0) return late;
    changed += 1;
    return { ...late, body: (b) => Buffer.concat([b.subarray(0, b.length >> 1), Buffer.alloc(b.length - (b.length >> 1), 7)]) };
  };
  const { page, close } = await open(browser, fort("?error=8", proxy.url), { wait: "first" });
  await waitFor(page, "settled");
  assert.equal(changed, 1);
  assert.deepEqual(await picture(page), wanted, "the same picture as from a good server");
  await close();
  proxy.mishap = null;
});

test("a file that changes while it is looked at is said, and the model stays on screen", async () => {
  proxy.mishap = ({ range }) => (range[0] === 0 ? null : { headers: { etag: '"another"' } });
  const { page, close } = await open(browser, fort("", proxy.url), { wait: "first" });
  await page.locator("#notice", { hasText: "replaced" }).waitFor();
  assert.ok((await picture(page)).share > 0.05);
  await close();
  proxy.mishap = null;
});

test("without WebGPU and WebGL 2 there is a sentence, the facts and the download", async () => {
  const hide = () => {
    Object.defineProperty(Navigator.prototype, "gpu", { value: undefined });
    const real = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
      return kind === "webgl2" ? null : real.call(this, kind, ...rest);
    };
  };
  const { page, close } = await open(browser, fort(), { wait: "trouble", before: (page) => page.addInitScript(hide) });
  assert.match(await plate(page), /cannot draw the model[\s\S]*WebGPU[\s\S]*WebGL 2/);
  assert.ok(await page.locator("#trouble-download").isVisible());
  assert.match(await page.locator("#facts").innerText(), /Triangles/);
  await close();
});

test("the list and a model's facts work without JavaScript", async () => {
  const { page, close } = await open(browser, server.url, { wait: null, javaScriptEnabled: false });
  await page.locator(".card a", { hasText: "fort" }).first().click();
  assert.match(await page.locator("#facts").innerText(), /Triangles/);
  assert.match(page.url(), /\/m\/fort$/);
  await close();
});

test("panels, views, help and hiding work by keyboard, in another language and from right to left", async () => {
  const { page, complaints, close } = await open(browser, fort("?error=8"));
  await page.locator("#tab-about").focus();
  await page.keyboard.press("ArrowRight");
  assert.ok(await page.locator("#measure").isVisible());
  await page.keyboard.press("ArrowRight");
  assert.ok(await page.locator("#saved").isVisible());
  await page.locator("#tab-display").click();
  assert.ok(await page.locator("#display").isVisible());
  const colour = await picture(page);
  await page.locator("input[name=mode][value=normals]").check();
  await waitFor(page, "settled");
  await page.waitForTimeout(300);
  assert.notEqual((await picture(page)).hash, colour.hash);
  await page.locator("input[name=projection][value=orthographic]").check();
  await page.waitForTimeout(300);
  assert.equal(await page.evaluate(() => globalThis.kilwa.viewer.camera().orthographic), true);
  await page.locator("#tab-info").click();
  await page.waitForFunction(() => /\d/.test(document.getElementById("stats").textContent));
  await page.locator("#views-open").click();
  await page.keyboard.press("ArrowDown");
  await page.keyboard.press("Enter");
  assert.ok(await page.locator("#views").isHidden());
  await page.locator("#canvas").focus();
  await page.keyboard.press("?");
  assert.ok(await page.locator("#help").isVisible());
  await page.keyboard.press("Escape");
  await page.keyboard.press("h");
  assert.ok(await page.locator(".bar").isHidden());
  await page.keyboard.press("h");
  await page.locator("#language").selectOption("ar");
  await page.waitForFunction(() => document.documentElement.dir === "rtl");
  assert.equal(await page.locator("#tab-about").innerText(), "نبذة");
  const rail = await page.locator(".rail").boundingBox();
  assert.ok(rail.x > 300, "the tools stand at the right");
  assert.deepEqual(complaints, []);
  await close();
});

test("a phone has the canvas first, large targets, and a sheet that opens", async () => {
  const { page, complaints, close } = await open(browser, fort("?error=8"), { size: [390, 844], hasTouch: true, isMobile: true });
  const box = (selector) => page.locator(selector).boundingBox();
  const canvas = await box("#canvas");
  assert.ok(canvas.width === 390 && canvas.height > 560, JSON.stringify(canvas));
  for (const selector of ["#tool-orbit", "#tool-walk", "#tool-measure", "#fit", "#zoom-in", "#zoom-out", "#hide", "#share", "#help-open", "#back"]) {
    const b = await box(selector);
    assert.ok(b.width >= 44 && b.height >= 44, `${selector}: ${JSON.stringify(b)}`);
    assert.ok(b.x >= 0 && b.x + b.width <= 390, `${selector} is on the screen`);
  }
  await page.locator("#tab-about").tap();
  await page.waitForFunction(() => document.querySelector(".sheet").clientHeight > 200);
  assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 390);
  assert.deepEqual(complaints, []);
  await close();
});

test("axe-core finds nothing serious, in both themes, on the list, the viewer, its dialogs and its troubles", async () => {
  const axe = await readFile(path.join(path.dirname(createRequire(import.meta.url).resolve("axe-core")), "axe.min.js"), "utf8");
  const serious = async (page, where) => {
    await page.evaluate(axe);
    const { violations } = await page.evaluate(() => globalThis.axe.run());
    return violations
      .filter((v) => ["serious", "critical"].includes(v.impact))
      .map((v) => `${where}: ${v.id}: ${v.nodes.map((n) => `${n.target} ${n.failureSummary}`).join("; ")}`);
  };
  const found = [];
  for (const colorScheme of ["light", "dark"]) {
    const list = await open(browser, server.url, { wait: null, colorScheme });
    found.push(...(await serious(list.page, `list ${colorScheme}`)));
    await list.close();
    const { page, close } = await open(browser, fort("?error=8"), { colorScheme });
    for (const tab of await page.locator("[role=tab]").all()) {
      await tab.click();
      found.push(...(await serious(page, `${await tab.getAttribute("id")} ${colorScheme}`)));
    }
    for (const [button, dialog] of [
      ["#help-open", "#help"],
      ["#picture-open", "#picture"],
    ]) {
      await page.locator(button).click();
      await page.locator(dialog).waitFor();
      found.push(...(await serious(page, `${dialog} ${colorScheme}`)));
      await page.locator(`${dialog} form[method=dialog] button`).click();
    }
    // Everything at once: a saved view, a note in its form, its card and pin, the pad for walking.
    await page.locator("#tab-saved").click();
    await page.locator("#view-save").click();
    found.push(...(await serious(page, `saved view ${colorScheme}`)));
    await page.evaluate(() => {
      const { api, viewer, session } = globalThis.kilwa;
      const place = [...viewer.pick(session.canvas.width / 2, session.canvas.height / 2)].slice(0, 3);
      for (const title of ["One", "Two"]) api.addAnnotation({ place, title, text: "Text", link: "https://example.org/" });
      api.openAnnotation("1");
    });
    await page.locator("#note-card").waitFor();
    found.push(...(await serious(page, `note ${colorScheme}`)));
    await page.locator("#note-edit").click();
    found.push(...(await serious(page, `note form ${colorScheme}`)));
    await page.locator("#note-form button[type=submit]").click();
    await page.locator("#tool-walk").click();
    await page.locator("#walk-pad").waitFor();
    found.push(...(await serious(page, `walking ${colorScheme}`)));
    await close();
    proxy.mishap = () => ({ status: 404 });
    const lost = await open(browser, fort("", proxy.url), { colorScheme, wait: "trouble" });
    found.push(...(await serious(lost.page, `trouble ${colorScheme}`)));
    await lost.close();
    proxy.mishap = null;
  }
  assert.deepEqual(found, []);
});
