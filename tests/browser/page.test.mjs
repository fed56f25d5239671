// The page in Chromium through `kilwa serve`: one browser, one page at a time.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { serious } from "./axe.mjs";
import { SHARP, cameraOf, canvasOf, fortSite, open, openTab, pick, picture, setCamera, spotOn, stats, test, tool, troubleOf, waitFor } from "./harness.mjs";

const HEAD = "bytes=0-65535";

const site = fortSite({ proxied: true });

const fort = (query = "", base = site.server.url) => `${base}/m/fort${query}`;
/** The message that the page shows over the picture. */
const message = (page, text) => page.getByRole("main").getByRole("status").filter({ hasText: text });
const dialog = (page, name) => page.getByRole("dialog", { name, exact: true });
/** The link from a model's page to the list. */
const back = (page) => page.getByRole("banner").getByRole("link", { name: "All models" });

test("the first picture needs one range request of the pack, and the model then refines to the target", async () => {
  // Everything after the head is held back: the picture must come all the same.
  let release;
  const held = new Promise((resolve) => (release = resolve));
  const arrived = [];
  const { page, complaints, packs, close } = await open(site.browser, fort(), {
    wait: "first",
    before: (page) => {
      page.on("response", (response) => new URL(response.url()).pathname.startsWith("/packs/") && arrived.push(response.request().headers().range));
      return page.route("**/packs/**", async (route) => {
        if (route.request().headers().range !== HEAD) await held;
        await route.continue();
      });
    },
  });
  assert.equal(packs.filter((range) => range === HEAD).length, 1);
  const atFirst = await stats(page);
  assert.deepEqual(arrived, [HEAD], "nothing but the head has arrived");
  assert.equal(atFirst.bytesReceived, 0, "nothing but the head is drawn");
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

/** Runs in the page: whether the camera differs from these numbers (harness.mjs, numbersOf). */
const hasMoved = (from) => {
  const { azimuth, elevation, distance, target, orthographic, roll, fieldOfView } = globalThis.kilwa.api.getCamera();
  const now = [azimuth, elevation, distance, ...target, Number(orthographic), roll, fieldOfView];
  return now.some((v, i) => Math.abs(v - from[i]) >= 1e-6);
};

test("keyboard, mouse, wheel and fingers fly the camera, and the error comes back to the target", async () => {
  const { page, complaints, close } = await open(site.browser, fort("?error=2"), { hasTouch: true });
  const canvas = canvasOf(page);
  const camera = () => cameraOf(page);
  let last = { camera: await camera(), picture: await picture(page) };
  const step = async (name, act) => {
    await act();
    await page.waitForFunction(hasMoved, last.camera).catch((error) => assert.fail(`${name}: the camera does not move: ${error.message}`));
    await waitFor(page, "settled");
    const now = { camera: await camera(), picture: await picture(page) };
    assert.notEqual(now.picture.hash, last.picture.hash, `${name}: the picture`);
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
  const under = async () => (await pick(page, (place[0] - box.x) / box.width, (place[1] - box.y) / box.height))?.place;
  const target = await under();
  assert.ok(target, "the pointer is over the model");
  await page.mouse.move(...place);
  const wheeled = await step("wheel", () => page.mouse.wheel(0, -240));
  const stays = await under();
  const moved = Math.hypot(...[0, 1, 2].map((i) => stays[i] - target[i]));
  assert.ok(wheeled.now.camera[2] < wheeled.before.camera[2] * 0.8);
  assert.ok(moved < wheeled.now.camera[2] * 0.05, `what was under the pointer moved by ${moved} m`);
  assert.match(await page.getByRole("contentinfo", { name: "Status" }).innerText(), /x -?[\d.,]+ {2}y -?[\d.,]+ {2}z -?[\d.,]+ m/);

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
  await step("minus, closer again by the button", () => tool(page, "Zoom in").click());
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
  const first = await open(site.browser, fort("?error=8"));
  await first.page.keyboard.press("3");
  await first.page.keyboard.press("+");
  await waitFor(first.page, "settled");
  // The address follows once the camera rests.
  const camera = await cameraOf(first.page);
  await first.page.waitForURL(({ hash }) => {
    const held = /view=([^&]*)/.exec(hash)?.[1].split(",").map(Number);
    return held?.every((v, i) => v === Number(camera[i].toPrecision(9)));
  });
  const address = first.page.url();
  const before = await picture(first.page);
  await first.close();
  const second = await open(site.browser, address);
  assert.deepEqual(await picture(second.page), before);
  assert.deepEqual([...first.complaints, ...second.complaints], []);
  await second.close();
});

test("the memory limit holds during a flight, and what was forgotten comes back", async () => {
  const { page, complaints, close } = await open(site.browser, fort("?memory=2&error=1"), SHARP);
  const limit = 2e6;
  const over = [];
  const check = async () => {
    const s = await stats(page);
    if (s.gpuBytes > limit || s.gpuBytesHeld > limit) over.push(s);
    return s;
  };
  assert.ok((await check()).budgetLimited, "two megabytes are too few for this model: else the test shows nothing");
  // Two rounds past four places, each looked at from near.
  const hits = [await pick(page, 0.4, 0.55), await pick(page, 0.75, 0.55), await pick(page, 0.56, 0.47), await pick(page, 0.56, 0.6)];
  const places = hits.flatMap((hit) => (hit ? [hit.place] : []));
  assert.ok(places.length >= 3, "the model is where it is looked for");
  const received = [];
  for (let round = 0; round < 2; round += 1) {
    for (const place of places) {
      await setCamera(page, { azimuth: 4, elevation: 0.5, distance: 5, target: place, orthographic: false, roll: 0, fieldOfView: 0.7 });
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

test("a model that is not there, or is no pack, is said with the next step", async () => {
  const trouble = async (mishap) => {
    site.proxy.mishap = mishap;
    const { page, close } = await open(site.browser, fort("", site.proxy.url), { wait: "trouble" });
    const text = await troubleOf(page).innerText();
    assert.ok(await troubleOf(page).getByRole("button", { name: "Try again" }).isVisible());
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
  // A copy that ends before the coarsest part of the model: the server states its length, and the header knows better.
  const short = ({ range }) => ({
    body: (b) => b.subarray(0, 20_000),
    headers: { "content-range": `bytes ${range[0]}-19999/20000` },
  });
  assert.match(await trouble(short), /damaged/);
  assert.match(await trouble(() => ({ whole: true, status: 200, announce: 3e9 })), /whole file of 3\.00\sGB/);
  site.proxy.mishap = null;
});

test("of a file that is cut off, what is there is drawn, and the page says what is missing", async () => {
  const whole = await readFile(site.pack);
  const cut = Math.round(whole.length * 0.6);
  site.proxy.mishap = ({ range }) => (range ? { headers: { "content-range": `bytes ${range.join("-")}/${cut}`, "kilwa-ranges": "1" } } : null);
  const { page, packs, complaints, close } = await open(site.browser, fort("?error=0.5", site.proxy.url));
  const seen = await stats(page);
  assert.ok(seen.cutOff && seen.trianglesDrawn > 1000, JSON.stringify(seen));
  assert.ok(Number.isFinite(seen.worstErrorMetres) && seen.worstErrorMetres > 0, "the error of what is shown is stated");
  await message(page, /incomplete: .+ of .+ are available/).waitFor();
  await page.getByText("file incomplete, finer parts are missing").waitFor();
  const ends = packs.flatMap((asked) => [...asked.matchAll(/-(\d+)/g)].map(([, end]) => Number(end)));
  assert.ok(Math.max(...ends) < cut, `nothing beyond its end is asked for: ${packs}`);
  // Values come from the finest surface, whose end, which vouches for it, is missing.
  await canvasOf(page).focus();
  await page.keyboard.press("m");
  await page.getByRole("toolbar", { name: "Measurements" }).waitFor();
  await page.mouse.click(...(await spotOn(page, 0.5, 0.5)));
  await message(page, "This could not be done: The file is incomplete").waitFor();
  // Farther away the same file is enough.
  await page.evaluate(() => {
    const camera = globalThis.kilwa.api.getCamera();
    globalThis.kilwa.api.setCamera({ distance: camera.distance * 20 });
  });
  await waitFor(page, "settled");
  assert.equal((await stats(page)).cutOff, false);
  assert.deepEqual(complaints, []);
  await close();
  site.proxy.mishap = null;
  // The same file on this computer.
  const local = await open(site.browser, fort("?error=0.5"));
  await local.page.getByLabel("Open a file…").setInputFiles({ name: "cut.kilwa", mimeType: "application/octet-stream", buffer: whole.subarray(0, cut) });
  await message(local.page, /incomplete: .+ of .+ are available/).waitFor();
  await waitFor(local.page, "settled");
  assert.equal((await stats(local.page)).trianglesDrawn, seen.trianglesDrawn);
  await local.close();
});

test("a server that ignores Range is put up with where the pack is small", async () => {
  site.proxy.mishap = () => ({ whole: true, status: 200 });
  site.proxy.requests.length = 0;
  const { page, complaints, close } = await open(site.browser, fort("?error=4", site.proxy.url), { wait: null });
  await message(page, "does not send parts of files").waitFor();
  await waitFor(page, "settled");
  assert.equal(site.proxy.requests.length, 1);
  assert.ok((await stats(page)).targetReached);
  assert.deepEqual(complaints, []);
  await close();
  site.proxy.mishap = null;
});

test("a silent server at the start, flipped bits, short answers and refusals are outlived, and the picture is right", async () => {
  site.proxy.mishap = null;
  const right = await open(site.browser, fort("?error=2", site.proxy.url));
  const wanted = await picture(right.page);
  await right.close();
  const flip = (b) => {
    const bad = Buffer.from(b);
    for (let at = 7; at < bad.length; at += 4096) bad[at] ^= 64;
    return bad;
  };
  let number = 0;
  let mishaps = 0;
  site.proxy.mishap = ({ range }) => {
    number += 1;
    if (range[0] === 0) return number === 1 ? { drop: true } : null;
    if (number > 16) return null;
    mishaps += 1;
    return [
      { body: flip },
      { status: 500 },
      { body: (b) => b.subarray(0, b.length >> 1), announce: range[1] - range[0] + 1 },
      { drop: true },
      { body: (b) => b.subarray(1) },
    ][number % 5];
  };
  const { page, complaints, close } = await open(site.browser, fort("?error=2", site.proxy.url), { wait: "first" });
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
  site.proxy.mishap = null;
});

test("over two seconds of latency and with weak tags the picture is right, also where bytes change under the same tag", async () => {
  site.proxy.mishap = null;
  const right = await open(site.browser, fort("?error=8", site.proxy.url));
  const wanted = await picture(right.page);
  await right.close();
  let changed = 0;
  site.proxy.mishap = ({ range, number }) => {
    const late = { late: 2000, headers: { etag: number % 2 ? 'W/"1"' : '"1"' } };
    // Once, the end of an answer is of another file; a weak tag does not tell.
    if (range[0] === 0 || changed > 0) return late;
    changed += 1;
    return { ...late, body: (b) => Buffer.concat([b.subarray(0, b.length >> 1), Buffer.alloc(b.length - (b.length >> 1), 7)]) };
  };
  const { page, close } = await open(site.browser, fort("?error=8", site.proxy.url), { wait: "first" });
  await waitFor(page, "settled");
  assert.equal(changed, 1);
  assert.deepEqual(await picture(page), wanted, "the same picture as from a good server");
  await close();
  site.proxy.mishap = null;
});

test("a file that changes while it is looked at is said, and the model stays on screen", async () => {
  site.proxy.mishap = ({ range }) => (range[0] === 0 ? null : { headers: { etag: '"another"' } });
  const { page, close } = await open(site.browser, fort("", site.proxy.url), { wait: "first" });
  await message(page, "replaced").waitFor();
  assert.ok((await picture(page)).share > 0.05);
  await close();
  site.proxy.mishap = null;
});

test("without WebGPU and WebGL 2 there is a sentence, the facts and the download", async () => {
  const hide = () => {
    Object.defineProperty(Navigator.prototype, "gpu", { value: undefined });
    const real = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
      return kind === "webgl2" ? null : real.call(this, kind, ...rest);
    };
  };
  const { page, close } = await open(site.browser, fort(), { wait: "trouble", before: (page) => page.addInitScript(hide) });
  assert.match(await troubleOf(page).innerText(), /cannot draw the model[\s\S]*WebGPU[\s\S]*WebGL 2/);
  assert.ok(await troubleOf(page).getByRole("link", { name: "Download pack" }).isVisible());
  assert.ok(await page.getByRole("tabpanel", { name: "About" }).getByRole("term").filter({ hasText: "Triangles" }).isVisible());
  await close();
});

test("the list and a model's facts work without JavaScript", async () => {
  const { page, close } = await open(site.browser, site.server.url, { wait: null, javaScriptEnabled: false });
  await page.getByRole("listitem").getByRole("heading").getByRole("link", { name: "fort" }).click();
  assert.ok(await page.getByRole("tabpanel").getByRole("term").filter({ hasText: "Triangles" }).isVisible());
  assert.match(page.url(), /\/m\/fort$/);
  await close();
});

test("panels, views, help and hiding work by keyboard, in another language and from right to left", async () => {
  const { page, complaints, close } = await open(site.browser, fort("?error=8"));
  const tab = (name) => page.getByRole("tab", { name, exact: true });
  const panel = (name) => page.getByRole("tabpanel", { name, exact: true });
  await tab("About").focus();
  await page.keyboard.press("ArrowRight");
  assert.ok(await panel("Measure").isVisible());
  await page.keyboard.press("ArrowRight");
  assert.ok(await panel("Views").isVisible());
  await tab("Display").click();
  assert.ok(await panel("Display").isVisible());
  const colour = await picture(page);
  await page.getByRole("radio", { name: "Normals" }).check();
  await waitFor(page, "settled");
  assert.notEqual((await picture(page)).hash, colour.hash);
  await page.getByRole("radio", { name: "Parallel, true to scale" }).check();
  await waitFor(page, "settled");
  assert.equal((await page.evaluate(() => globalThis.kilwa.api.getCamera())).orthographic, true);
  await tab("Statistics").click();
  await panel("Statistics").getByRole("definition").filter({ hasText: /\d/ }).first().waitFor();
  await tool(page, "Standard views").click();
  const views = page.getByRole("menu", { name: "Standard views" });
  await views.waitFor();
  await page.keyboard.press("ArrowDown");
  await page.keyboard.press("Enter");
  assert.ok(await views.isHidden());
  await canvasOf(page).focus();
  await page.keyboard.press("?");
  assert.ok(await dialog(page, "How to look around").isVisible());
  await page.keyboard.press("Escape");
  await page.keyboard.press("h");
  assert.ok(await page.getByRole("banner").isHidden());
  await page.keyboard.press("h");
  await page.getByRole("combobox", { name: "Language" }).selectOption("ar");
  await page.waitForFunction(() => document.documentElement.dir === "rtl");
  assert.ok(await tab("نبذة").isVisible());
  const rail = await page.getByRole("toolbar", { name: "الأدوات" }).boundingBox();
  assert.ok(rail.x > 300, "the tools stand at the right");
  assert.deepEqual(complaints, []);
  await close();
});

test("a phone has the canvas first, large targets, and a sheet that opens", async () => {
  const { page, complaints, close } = await open(site.browser, fort("?error=8"), { size: [390, 844], hasTouch: true, isMobile: true });
  const canvas = await canvasOf(page).boundingBox();
  assert.ok(canvas.width === 390 && canvas.height > 560, JSON.stringify(canvas));
  const tools = ["Drag turns the model", "Walk at eye height", "Measure", "Show the whole model", "Zoom in", "Zoom out", "Hide everything but the model"];
  const buttons = ["Share", "How to look around"].map((name) => page.getByRole("banner").getByRole("button", { name }));
  for (const target of [...tools.map((name) => tool(page, name)), ...buttons, back(page)]) {
    const b = await target.boundingBox();
    assert.ok(b.width >= 44 && b.height >= 44, `${target}: ${JSON.stringify(b)}`);
    assert.ok(b.x >= 0 && b.x + b.width <= 390, `${target} is on the screen`);
  }
  await page.getByRole("tab", { name: "About" }).tap();
  // The sheet shows what is between the top of its open tab and the end of the panel.
  const ends = [page.getByRole("tabpanel", { name: "About" }), page.getByRole("complementary", { name: "Details" })];
  const isOpen = ([tab, panel]) => Math.min(panel.getBoundingClientRect().bottom, innerHeight) - tab.getBoundingClientRect().top > 200;
  await page.waitForFunction(isOpen, await Promise.all(ends.map((end) => end.elementHandle())));
  assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 390);
  assert.deepEqual(complaints, []);
  await close();
});

test("axe-core finds nothing serious, in both themes, on the list, the viewer, its dialogs and its troubles", async () => {
  const found = [];
  const list = await open(site.browser, site.server.url, { wait: null });
  found.push(...(await serious(list.page, "list")));
  await list.close();
  const { page, close } = await open(site.browser, fort("?error=8"));
  for (const tab of await page.getByRole("tab").all()) {
    await tab.click();
    found.push(...(await serious(page, await tab.innerText())));
  }
  for (const name of ["How to look around", "Save a picture"]) {
    await page.getByRole("banner").getByRole("button", { name, exact: true }).click();
    await dialog(page, name).waitFor();
    found.push(...(await serious(page, name)));
    await dialog(page, name).getByRole("button", { name: "Close" }).click();
  }
  // Everything at once: a saved view, a note in its form, its card and pin, the pad for walking.
  await openTab(page, "Views");
  await page.getByRole("button", { name: "Save this view" }).click();
  found.push(...(await serious(page, "saved view")));
  const { place } = await pick(page, 0.5, 0.5);
  await page.evaluate((place) => {
    const { api } = globalThis.kilwa;
    for (const title of ["One", "Two"]) api.addAnnotation({ place, title, text: "Text", link: "https://example.org/" });
    api.openAnnotation("1");
  }, place);
  await page.getByRole("region", { name: "Note", exact: true }).waitFor();
  found.push(...(await serious(page, "note")));
  await page.getByRole("button", { name: "Edit the note" }).click();
  await page.getByRole("textbox", { name: "Title" }).waitFor();
  found.push(...(await serious(page, "note form")));
  await page.getByRole("button", { name: "Done" }).click();
  await tool(page, "Walk at eye height").click();
  await page.getByRole("group", { name: "Walking" }).waitFor();
  found.push(...(await serious(page, "walking")));
  await close();
  site.proxy.mishap = () => ({ status: 404 });
  const lost = await open(site.browser, fort("", site.proxy.url), { wait: "trouble" });
  found.push(...(await serious(lost.page, "trouble")));
  await lost.close();
  site.proxy.mishap = null;
  assert.deepEqual(found, []);
});
