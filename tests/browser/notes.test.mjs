// Notes on the model: placed by pointer and by keyboard, edited, kept, written and read as W3C Web Annotations, opened by
// address, gone through in a tour; and never anything but text.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import { canvasOf, fortSite, open, openTab, pick, press, test, tool, waitFor } from "./harness.mjs";

const site = fortSite();

const fort = (query = "?error=16") => `${site.server.url}/m/fort${query}`;
/** What touches the picture is tested with both programs. */
const onBoth = (name, run) => {
  test(name, () => run(""));
  test(`${name} (WebGL 2)`, () => run("&gpu=webgl"));
};
/** The tab, while the list of notes is shown. */
const list = (page) => page.getByRole("tabpanel", { name: "Notes" });
/** Titles of the rows; each begins with its number. */
const titles = async (page) =>
  (await list(page).getByRole("listitem").getByRole("button", { name: /^\d/ }).allInnerTexts()).map((text) => text.replace(/^\d+\s*/, ""));
const pins = (page) => page.getByRole("group", { name: "Notes" }).getByRole("button");
/** The note that is open. */
const card = (page) => page.getByRole("region", { name: "Note", exact: true });
const read = (page, file) => list(page).getByLabel("Read a file…").setInputFiles(file);
/** The message that the page shows over the picture. */
const message = (page, text) => page.getByRole("main").getByRole("status").filter({ hasText: text });
const json = (value) => ({ name: "notes.json", mimeType: "application/json", buffer: Buffer.from(typeof value === "string" ? value : JSON.stringify(value)) });
const rest = (page) => waitFor(page, "settled");

/** Three places on the surface, seen from here. */
const places = async (page) => {
  const hits = [await pick(page, 0.5, 0.5), await pick(page, 0.4, 0.55), await pick(page, 0.6, 0.5)];
  return hits.map(({ place }) => place);
};
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
  const { page, complaints, close } = await open(site.browser, fort(`?error=16${gpu}`));
  await tool(page, "Write a note on the model").click();
  await message(page, "Click a place on the surface").waitFor();
  const box = await canvasOf(page).boundingBox();
  // Beside the model nothing is placed, and the tool says so.
  await press(page, 0.3, 0.02);
  assert.ok(await message(page, "no surface").isVisible());
  await press(page, 0.5, 0.5);
  await page.getByRole("textbox", { name: "Title" }).waitFor();
  await page.keyboard.type("The gate");
  await page.getByRole("textbox", { name: "Text" }).fill("Coral rag, laid in lime.\n<img src=x onerror=alert(1)>");
  // Nothing typed is lost by a reload, even before Done.
  await page.reload();
  await rest(page);
  await openTab(page, "Notes");
  assert.deepEqual(await titles(page), ["The gate"]);
  await page.getByRole("button", { name: "Edit: The gate" }).click();
  await page.getByRole("button", { name: "Edit the note" }).click();
  await page.getByRole("textbox", { name: "Link" }).fill("javascript:alert(1)");
  await page.getByRole("button", { name: "Done" }).click();
  assert.match(await page.getByRole("alert").innerText(), /https/);
  await page.getByRole("textbox", { name: "Link" }).fill("https://example.org/gate");
  await page.getByRole("button", { name: "Done" }).click();
  const text = card(page).getByText("Coral rag");
  assert.equal(await text.innerText(), "Coral rag, laid in lime.\n<img src=x onerror=alert(1)>");
  assert.equal(await card(page).getByRole("img").count(), 0);
  const link = card(page).getByRole("link");
  assert.equal(await link.getAttribute("href"), "https://example.org/gate");
  assert.equal(await link.getAttribute("rel"), "noopener noreferrer");
  // The pin stands where the press was.
  const pin = await pins(page).boundingBox();
  assert.ok(Math.hypot(pin.x + pin.width / 2 - box.x - box.width / 2, pin.y + pin.height / 2 - box.y - box.height / 2) < 3);
  await page.getByRole("button", { name: "Delete: The gate" }).click();
  assert.deepEqual(await titles(page), []);
  await canvasOf(page).focus();
  await page.keyboard.press("Control+z");
  assert.deepEqual(await titles(page), ["The gate"]);
  await page.keyboard.press("Control+Shift+z");
  assert.deepEqual(await titles(page), []);
  assert.deepEqual(complaints, []);
  await close();
});

onBoth("a note is placed by keyboard alone", async (gpu) => {
  const { page, complaints, close } = await open(site.browser, fort(`?error=16${gpu}`));
  await canvasOf(page).focus();
  // The part of the picture where the cross goes: it starts in the middle.
  const { x, y, width, height } = await canvasOf(page).boundingBox();
  const look = async () => (await page.screenshot({ clip: { x: x + width / 2 - 88, y: y + height / 2 - 40, width: 80, height: 80 } })).toString("base64");
  await page.keyboard.press("n");
  const choosing = await look();
  await page.keyboard.press("Escape");
  const bare = await look();
  await page.keyboard.press("n");
  await page.keyboard.press("Shift+ArrowLeft");
  assert.ok((await look()) !== choosing, "a cross shows the place");
  for (let i = 0; i < 3; i += 1) await page.keyboard.press("ArrowDown");
  await page.keyboard.press("Space");
  await page.getByRole("textbox", { name: "Title" }).waitFor();
  await page.keyboard.type("By keys");
  await page.keyboard.press("Escape");
  assert.deepEqual(await titles(page), ["By keys"]);
  await card(page).getByRole("button", { name: "Close" }).click();
  await canvasOf(page).focus();
  await page.keyboard.press("Control+z"); // the words
  await page.keyboard.press("Control+z"); // the place
  assert.deepEqual(await titles(page), []);
  assert.ok((await look()) === bare, "neither cross nor pin is left");
  assert.deepEqual(complaints, []);
  await close();
});

onBoth("pins follow the camera, and fade where the model stands before them", async (gpu) => {
  const { page, complaints, close } = await open(site.browser, fort(`?error=4${gpu}`));
  const [spot] = await places(page);
  const { azimuth, elevation } = await page.evaluate(() => globalThis.kilwa.api.getCamera());
  const backward = [Math.cos(elevation) * Math.sin(azimuth), Math.cos(elevation) * Math.cos(azimuth), Math.sin(elevation)];
  const behind = spot.map((v, i) => v - 5 * backward[i]);
  await openTab(page, "Notes");
  await read(page, json([annotation(spot, { label: "In front" }), annotation(behind, { label: "Behind" })]));
  const pin = (name) => pins(page).and(page.getByRole("button", { name }));
  // A pin that is hidden by the surface is faded.
  const faded = (pin) => pin.evaluate((e) => getComputedStyle(e).opacity < 0.6);
  const fades = async (name) => page.waitForFunction((e) => getComputedStyle(e).opacity < 0.6, await pin(name).elementHandle());
  await fades("Behind"); // Both are judged at once.
  assert.ok(!(await faded(pin("In front"))), "what was picked is in front");
  const before = await pin("In front").boundingBox();
  await canvasOf(page).focus();
  await page.keyboard.press("Shift+ArrowRight");
  await rest(page);
  const after = await pin("In front").boundingBox();
  assert.ok(after.x > before.x + 5, "the pin moved with the model");
  await page.keyboard.press("2");
  await fades("In front"); // From the other side, walls hide it.
  await page.getByLabel("Show notes on the model").uncheck();
  assert.equal(await pins(page).count(), 0);
  assert.match(await page.evaluate(() => globalThis.kilwa.api.link()), /notes=off/);
  assert.deepEqual(complaints, []);
  await close();
});

test("notes are written as Web Annotations and read back the same, with what others said in them", async () => {
  const { page, complaints, close } = await open(site.browser, fort());
  const [a, b] = await places(page);
  await openTab(page, "Notes");
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
  await read(page, json(foreign));
  await message(page, "2 without a place").waitFor();
  assert.deepEqual(await titles(page), ["Gate", "Well"]);
  await list(page)
    .getByRole("button", { name: /^1\s*Gate$/ })
    .click();
  assert.match(await card(page).getByRole("paragraph").first().textContent(), /^Carved door/);
  assert.equal(await card(page).getByRole("link").getAttribute("href"), "https://example.org/door");
  const [download] = await Promise.all([page.waitForEvent("download"), list(page).getByRole("button", { name: "Save as a file" }).click()]);
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
  const notes = () => page.evaluate(() => globalThis.kilwa.api.annotations());
  const had = await notes();
  await read(page, json(written));
  await message(page, /Read: 2\.(?! \d)/).waitFor();
  assert.deepEqual(await notes(), had);
  for (const [bad, says] of [
    ["{", /could not be read/],
    ['{"type":"Feature"}', /no Web Annotations/],
    [JSON.stringify(Array(5001).fill({})), /at most 5,000 are allowed/],
  ]) {
    await read(page, json(bad));
    await message(page, says).waitFor();
  }
  assert.deepEqual(await notes(), had);
  assert.deepEqual(complaints, []);
  await close();
});

test("a tour steps through the notes, each has an address, and Back returns", async () => {
  const { page, complaints, close } = await open(site.browser, fort());
  const spots = await places(page);
  await openTab(page, "Notes");
  const camera = (azimuth) => ({ state: { type: "urn:kilwa:view", camera: [azimuth, 0.4, 30, ...spots[0], 0] } });
  const items = spots.map((place, i) => {
    const note = annotation(place, { id: `urn:uuid:0000000${i}-0000-4000-8000-000000000000`, label: `Stop ${i + 1}` });
    Object.assign(note.target, i === 2 ? {} : camera(i + 1));
    return note;
  });
  await read(page, json({ type: "AnnotationCollection", first: { items } }));
  await page.getByRole("button", { name: "Start the tour" }).click();
  await rest(page);
  const seen = () => page.evaluate(() => globalThis.kilwa.api.getCamera());
  const title = (name) => card(page).getByRole("heading", { name });
  const next = card(page).getByRole("button", { name: "Next note" });
  assert.ok(await title("Stop 1").isVisible());
  assert.ok(await title("Stop 1").evaluate((e) => e === document.activeElement));
  assert.ok(Math.abs((await seen()).azimuth - 1) < 1e-9);
  assert.ok(await card(page).getByRole("button", { name: "Previous note" }).isDisabled());
  await next.click();
  await rest(page);
  assert.ok(await title("Stop 2").isVisible());
  assert.ok(Math.abs((await seen()).azimuth - 2) < 1e-9);
  await next.click();
  await rest(page);
  assert.ok(await card(page).getByText("3 of 3").isVisible());
  const { target } = await seen();
  assert.ok(
    target.every((v, i) => Math.abs(v - spots[2][i]) < 1e-6),
    "a note without a camera is looked at where it is",
  );
  await page.waitForURL(/annotation=00000002-0000/);
  await page.goBack();
  await title("Stop 2").waitFor();
  assert.match(page.url(), /annotation=00000001-0000/);
  await card(page).getByRole("button", { name: "Close" }).click();
  assert.ok(await card(page).isHidden());
  // A link that says nothing but the note, followed on the page: one entry of the history, and one step back.
  const entry = () => page.evaluate(() => globalThis.navigation.currentEntry.index);
  const had = await entry();
  await page.evaluate(() => (location.hash = "#annotation=00000000-0000-4000-8000-000000000000"));
  await title("Stop 1").waitFor();
  await page.waitForURL(/#view=1,.*annotation=00000000-0000/);
  assert.equal(await entry(), had + 1);
  await page.goBack();
  await page.waitForFunction(() => globalThis.kilwa.api.getCamera().azimuth === 2);
  assert.ok(await card(page).isHidden());
  // And one that opens the page.
  await page.goto(`${fort()}#annotation=00000000-0000-4000-8000-000000000000`);
  await page.reload();
  await rest(page);
  assert.ok(await title("Stop 1").isVisible());
  assert.ok(Math.abs((await seen()).azimuth - 1) < 1e-9);
  assert.deepEqual(complaints, []);
  await close();
});

test("notes that the host publishes are shown, the person's changes to them are the person's, and the published ones come back", async () => {
  const found = await open(site.browser, fort());
  const [place] = await places(found.page);
  await found.close();
  const published = { type: "AnnotationPage", items: [annotation(place, { label: "Published" })] };
  const { page, complaints, close } = await open(site.browser, fort("?error=16&annotations=annotations.json"), {
    before: (page) => page.route("**/packs/annotations.json", (route) => route.fulfill({ json: published })),
  });
  await pins(page).waitFor();
  await openTab(page, "Notes");
  assert.deepEqual(await titles(page), ["Published"]);
  const own = page.getByText("You see your own version of the notes.");
  assert.ok(await own.isHidden());
  await page.getByRole("button", { name: "Edit: Published" }).click();
  await page.getByRole("button", { name: "Delete: Published" }).click();
  await page.reload();
  await rest(page);
  await openTab(page, "Notes");
  await own.waitFor();
  assert.deepEqual(await titles(page), []);
  await page.getByRole("button", { name: "Show the published notes" }).click();
  assert.deepEqual(await titles(page), ["Published"]);
  assert.deepEqual(complaints, []);
  await close();
  // From anywhere else they are refused, before anything is asked for.
  const asked = [];
  const other = await open(site.browser, fort(`?error=16&annotations=${encodeURIComponent("http://example.org/notes.json")}`), {
    before: (page) => page.on("request", (request) => asked.push(request.url())),
  });
  assert.ok(await message(other.page, "not from http://example.org").isVisible());
  assert.ok(!asked.some((url) => url.startsWith("http://example.org")));
  await other.close();
});
