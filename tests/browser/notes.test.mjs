// Notes on the model: placed by pointer and by keyboard, edited, kept, written and read as W3C Web Annotations, opened by
// address, gone through in a tour; and never anything but text.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { after, before } from "node:test";
import { launch, open, packFolder, serve, test, waitFor } from "./harness.mjs";

let server;
let browser;

before(async () => {
  server = await serve(await packFolder());
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
});

const fort = (query = "?error=8") => `${server.url}/m/fort${query}`;
/** What touches the picture is tested with both programs. */
const onBoth = (name, run) => {
  test(name, () => run(""));
  test(`${name} (WebGL 2)`, () => run("&gpu=webgl"));
};
const titles = (page) => page.locator("#notes-list .name").allInnerTexts();
const json = (value) => ({ name: "notes.json", mimeType: "application/json", buffer: Buffer.from(typeof value === "string" ? value : JSON.stringify(value)) });
const rest = async (page) => {
  await page.waitForTimeout(60);
  await waitFor(page, "settled");
};

/** Three places on the surface, seen from here. */
const places = (page) =>
  page.evaluate(() => {
    const { viewer, session } = globalThis.kilwa;
    const { width, height } = session.canvas;
    return [
      [0.5, 0.5],
      [0.4, 0.55],
      [0.6, 0.5],
    ].map(([x, y]) => [...viewer.pick(x * width, y * height)].slice(0, 3));
  });
const annotation = (place, more = {}) => ({
  "@context": "http://www.w3.org/ns/anno.jsonld",
  id: `https://example.org/notes/${place.map(Math.round).join("_")}`,
  type: "Annotation",
  label: "A note",
  body: { type: "TextualBody", value: "Text" },
  target: { source: "x", selector: { type: "PointSelector", x: place[0], y: place[1], z: place[2] } },
  ...more,
});

onBoth("a note is placed with a press, written, kept by the browser, and undone", async (gpu) => {
  const { page, complaints, close } = await open(browser, fort(`?error=8${gpu}`));
  await page.locator("#tool-note").click();
  assert.match(await page.locator("#hint").innerText(), /surface/);
  const box = await page.locator("#canvas").boundingBox();
  // Beside the model nothing is placed, and the tool says so.
  await page.mouse.click(box.x + box.width * 0.3, box.y + 10);
  assert.match(await page.locator("#notice").innerText(), /no surface/);
  await page.mouse.click(box.x + box.width / 2, box.y + box.height / 2);
  await page.locator("#note-form-name").waitFor();
  await page.keyboard.type("The gate");
  await page.locator("#note-form-text").fill("Coral rag, laid in lime.\n<img src=x onerror=alert(1)>");
  // Nothing typed is lost by a reload, even before Done.
  await page.reload();
  await waitFor(page, "settled");
  await page.locator("#tab-notes").click();
  assert.deepEqual(await titles(page), ["The gate"]);
  await page.locator("#notes-list [data-act=more]").click();
  await page.locator("#notes-list [data-act=edit]").click();
  await page.locator("#note-form-link").fill("javascript:alert(1)");
  await page.locator("#note-form button[type=submit]").click();
  assert.match(await page.locator("#note-form-error").innerText(), /https/);
  await page.locator("#note-form-link").fill("https://example.org/gate");
  await page.locator("#note-form button[type=submit]").click();
  assert.equal(await page.locator("#note-text").innerText(), "Coral rag, laid in lime.\n<img src=x onerror=alert(1)>");
  assert.equal(await page.locator("#note-text img").count(), 0);
  const link = page.locator("#note-link");
  assert.equal(await link.getAttribute("href"), "https://example.org/gate");
  assert.equal(await link.getAttribute("rel"), "noopener noreferrer");
  // The pin stands where the press was.
  const pin = await page.locator(".pin").boundingBox();
  assert.ok(Math.hypot(pin.x + pin.width / 2 - box.x - box.width / 2, pin.y + pin.height / 2 - box.y - box.height / 2) < 3);
  await page.locator("#notes-list [data-act=more]").click();
  await page.locator("#notes-list [data-act=more]").click();
  await page.locator("#notes-list [data-act=delete]").click();
  assert.deepEqual(await titles(page), []);
  await page.locator("#canvas").focus();
  await page.keyboard.press("Control+z");
  assert.deepEqual(await titles(page), ["The gate"]);
  await page.keyboard.press("Control+Shift+z");
  assert.deepEqual(await titles(page), []);
  assert.deepEqual(complaints, []);
  await close();
});

onBoth("a note is placed by keyboard alone", async (gpu) => {
  const { page, complaints, close } = await open(browser, fort(`?error=8${gpu}`));
  await page.locator("#canvas").focus();
  await page.keyboard.press("n");
  await page.keyboard.press("Shift+ArrowLeft");
  assert.ok(await page.locator("#crosshair").isVisible());
  for (let i = 0; i < 3; i += 1) await page.keyboard.press("ArrowDown");
  await page.keyboard.press("Space");
  await page.locator("#note-form-name").waitFor();
  await page.keyboard.type("By keys");
  await page.keyboard.press("Escape");
  assert.deepEqual(await titles(page), ["By keys"]);
  assert.ok(await page.locator("#crosshair").isHidden());
  assert.deepEqual(complaints, []);
  await close();
});

onBoth("pins follow the camera, and fade where the model stands before them", async (gpu) => {
  const { page, complaints, close } = await open(browser, fort(`?error=4${gpu}`));
  const spots = await places(page);
  await page.locator("#tab-notes").click();
  await page.locator("#notes-import").setInputFiles(json([annotation(spots[0])]));
  await page.locator(".pin").waitFor();
  const settled = () => page.waitForFunction(() => globalThis.kilwa.notes.pins.unsure.length === 0);
  await settled();
  assert.ok(!(await page.locator(".pin.behind").count()), "what was picked is in front");
  const before = await page.locator(".pin").boundingBox();
  await page.locator("#canvas").focus();
  await page.keyboard.press("Shift+ArrowRight");
  await rest(page);
  const after = await page.locator(".pin").boundingBox();
  assert.ok(after.x > before.x + 5, "the pin moved with the model");
  await page.keyboard.press("2");
  await rest(page);
  await settled();
  assert.equal(await page.locator(".pin.behind").count(), 1, "from the other side, walls stand before it");
  await page.locator("#notes-shown").uncheck();
  assert.ok(await page.locator("#pins").isHidden());
  assert.match(await page.evaluate(() => globalThis.kilwa.api.link()), /notes=off/);
  assert.deepEqual(complaints, []);
  await close();
});

test("notes are written as Web Annotations and read back the same, with what others said in them", async () => {
  const { page, complaints, close } = await open(browser, fort());
  const [a, b] = await places(page);
  await page.locator("#tab-notes").click();
  const foreign = {
    "@context": "http://www.w3.org/ns/anno.jsonld",
    type: "AnnotationPage",
    items: [
      annotation(a, {
        label: { en: ["Gate"] },
        creator: { name: "M. Juma" },
        body: [
          { type: "TextualBody", format: "text/html", value: "<p>Carved <b>door</b></p><script>alert(1)</script>" },
          { type: "SpecificResource", source: "https://example.org/door" },
          "javascript:alert(1)",
        ],
      }),
      annotation(b, { label: "Well" }),
      { type: "Annotation", target: "https://example.org/a-page" },
      annotation([1, 2, Number.NaN]),
    ],
  };
  await page.locator("#notes-import").setInputFiles(json(foreign));
  await page.locator("#notice", { hasText: "2 without a place" }).waitFor();
  assert.deepEqual(await titles(page), ["Gate", "Well"]);
  await page.locator("#notes-list .go").first().click();
  assert.match(await page.locator("#note-text").textContent(), /^Carved door/);
  assert.equal(await page.locator("#note-link").getAttribute("href"), "https://example.org/door");
  const [download] = await Promise.all([page.waitForEvent("download"), page.locator("#notes-export").click()]);
  const written = JSON.parse(await readFile(await download.path(), "utf8"));
  assert.equal(written["@context"], "http://www.w3.org/ns/anno.jsonld");
  assert.equal(written.type, "AnnotationPage");
  const [first] = written.items;
  assert.deepEqual(first.creator, { name: "M. Juma" }, "what another program wrote is kept");
  assert.deepEqual(first.target.selector, { type: "PointSelector", x: a[0], y: a[1], z: a[2] });
  assert.deepEqual(
    first.body.map((x) => x.purpose),
    ["describing", "linking"],
  );
  assert.equal(first.body[0].format, "text/plain");
  // The same file again changes nothing: notes are known by their id.
  const list = () => page.evaluate(() => globalThis.kilwa.api.annotations());
  const had = await list();
  await page.locator("#notes-import").setInputFiles(json(written));
  await page.locator("#notice", { hasText: "Read: 2" }).waitFor();
  assert.deepEqual(await list(), had);
  for (const [bad, says] of [
    ["{", /could not be read/],
    ['{"type":"Feature"}', /no Web Annotations/],
    [JSON.stringify(Array(5001).fill({})), /at most 5,000 are allowed/],
  ]) {
    await page.locator("#notes-import").setInputFiles(json(bad));
    await page.waitForFunction((text) => new RegExp(text).test(document.getElementById("notice-text").textContent), says.source);
  }
  assert.deepEqual(await list(), had);
  assert.deepEqual(complaints, []);
  await close();
});

test("a tour steps through the notes, each has an address, and Back returns", async () => {
  const { page, complaints, close } = await open(browser, fort());
  const spots = await places(page);
  await page.locator("#tab-notes").click();
  const camera = (azimuth) => ({ state: { type: "urn:kilwa:view", camera: [azimuth, 0.4, 30, ...spots[0], 0] } });
  const items = spots.map((place, i) => {
    const note = annotation(place, { id: `urn:uuid:0000000${i}-0000-4000-8000-000000000000`, label: `Stop ${i + 1}` });
    Object.assign(note.target, i === 2 ? {} : camera(i + 1));
    return note;
  });
  await page.locator("#notes-import").setInputFiles(json({ type: "AnnotationCollection", first: { items } }));
  await page.locator("#tour-start").click();
  await rest(page);
  const azimuth = () => page.evaluate(() => globalThis.kilwa.viewer.camera().azimuth);
  assert.equal(await page.locator("#note-title").innerText(), "Stop 1");
  assert.equal(await page.evaluate(() => document.activeElement.id), "note-title");
  assert.ok(Math.abs((await azimuth()) - 1) < 1e-9);
  assert.ok(await page.locator("#note-previous").isDisabled());
  await page.locator("#note-next").click();
  await rest(page);
  assert.equal(await page.locator("#note-title").innerText(), "Stop 2");
  assert.ok(Math.abs((await azimuth()) - 2) < 1e-9);
  await page.locator("#note-next").click();
  await rest(page);
  assert.equal(await page.locator("#note-count").innerText(), "3 of 3");
  const shown = await page.evaluate(() => globalThis.kilwa.viewer.camera().target);
  assert.ok(
    shown.every((v, i) => Math.abs(v - spots[2][i]) < 1e-6),
    "a note without a camera is looked at where it is",
  );
  await page.waitForTimeout(500);
  await page.goBack();
  await page.waitForFunction(() => document.getElementById("note-title").textContent === "Stop 2");
  assert.match(page.url(), /annotation=00000001-0000/);
  await page.locator("#note-close").click();
  assert.ok(await page.locator("#note-card").isHidden());
  // A link that says nothing but the note, followed on the page: one entry of the history, and one step back.
  const entry = () => page.evaluate(() => globalThis.navigation.currentEntry.index);
  const had = await entry();
  await page.evaluate(() => (location.hash = "#annotation=00000000-0000-4000-8000-000000000000"));
  await page.waitForFunction(() => document.getElementById("note-title").textContent === "Stop 1");
  await page.waitForFunction(() => location.hash.startsWith("#view=1,") && location.hash.includes("annotation=00000000-0000"));
  assert.equal(await entry(), had + 1);
  await page.goBack();
  await page.waitForFunction(() => globalThis.kilwa.viewer.camera().azimuth === 2);
  assert.ok(await page.locator("#note-card").isHidden());
  // And one that opens the page.
  await page.goto(`${fort()}#annotation=00000000-0000-4000-8000-000000000000`);
  await page.reload();
  await waitFor(page, "settled");
  assert.equal(await page.locator("#note-title").innerText(), "Stop 1");
  assert.ok(Math.abs((await azimuth()) - 1) < 1e-9);
  assert.deepEqual(complaints, []);
  await close();
});

test("notes that the host publishes are shown, the person's changes to them are the person's, and the published ones come back", async () => {
  const found = await open(browser, fort());
  const [place] = await places(found.page);
  await found.close();
  const published = { type: "AnnotationPage", items: [annotation(place, { label: "Published" })] };
  const { page, complaints, close } = await open(browser, fort("?error=8&annotations=annotations.json"), {
    before: (page) => page.route("**/packs/annotations.json", (route) => route.fulfill({ json: published })),
  });
  await page.locator(".pin").waitFor();
  await page.locator("#tab-notes").click();
  assert.deepEqual(await titles(page), ["Published"]);
  assert.ok(await page.locator("#notes-own").isHidden());
  await page.locator("#notes-list [data-act=more]").click();
  await page.locator("#notes-list [data-act=delete]").click();
  await page.reload();
  await waitFor(page, "settled");
  await page.locator("#tab-notes").click();
  await page.locator("#notes-own").waitFor();
  assert.deepEqual(await titles(page), []);
  await page.locator("#notes-published").click();
  assert.deepEqual(await titles(page), ["Published"]);
  assert.deepEqual(complaints, []);
  await close();
  // From anywhere else they are refused, before anything is asked for.
  const asked = [];
  const other = await open(browser, fort(`?error=8&annotations=${encodeURIComponent("http://example.org/notes.json")}`), {
    before: (page) => page.on("request", (request) => asked.push(request.url())),
  });
  assert.match(await other.page.locator("#notice").innerText(), /not from http:\/\/example\.org/);
  assert.ok(!asked.some((url) => url.startsWith("http://example.org")));
  await other.close();
});
