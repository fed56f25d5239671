// Where things are on the page: phones on their side, the model beside the tools, labels beside pins, and tabs that keep their place.

import assert from "node:assert/strict";
import { canvasOf, fortSite, open, openTab, press, test, tool, waitFor } from "./harness.mjs";
import { done } from "./measuring.mjs";

const site = fortSite();
const fort = (query = "") => `${site.server.url}/m/fort${query}`;
const meet = (a, b) => a.x < b.x + b.width && b.x < a.x + a.width && a.y < b.y + b.height && b.y < a.y + a.height;
const TOOLS = (page) => page.getByRole("toolbar", { name: "Tools", exact: true });

test("on a telephone on its side the picture keeps the height, and the panel stands beside it, not over or under it", async () => {
  for (const size of [
    [568, 320],
    [667, 375],
    [740, 360],
    [844, 390],
  ]) {
    const { page, complaints, close } = await open(site.browser, fort("?error=16"), { size, hasTouch: true, isMobile: true });
    const [width, height] = size;
    const panel = page.getByRole("complementary", { name: "Details" });
    for (const tab of [null, "Display", "Measure"]) {
      if (tab) await openTab(page, tab);
      const [canvas, beside] = [await canvasOf(page).boundingBox(), await panel.boundingBox()];
      assert.ok(canvas.height >= height * 0.75, `${size}, ${tab}: the canvas is ${canvas.height} high`);
      assert.ok(canvas.width >= width * 0.55, `${size}, ${tab}: the canvas is ${canvas.width} wide`);
      assert.ok(!meet(canvas, beside) && beside.x >= canvas.x + canvas.width - 1 && beside.height >= canvas.height, `${size}: ${JSON.stringify(beside)}`);
    }
    const canvas = await canvasOf(page).boundingBox();
    const [rail, cube] = [await TOOLS(page).boundingBox(), await page.getByRole("group", { name: "View cube" }).boundingBox()];
    assert.ok(!meet(rail, cube), `${size}: tools and cube`);
    assert.ok(rail.height < canvas.height / 2, `${size}: the tools are ${rail.height} high`);
    for (const part of [rail, cube]) assert.ok(part.x >= canvas.x && part.x + part.width <= canvas.x + canvas.width, `${size}: ${JSON.stringify(part)}`);
    for (const name of ["Drag turns the model", "Measure", "Zoom out"]) {
      const b = await tool(page, name).boundingBox();
      assert.ok(b.width >= 44 && b.height >= 44, `${size}, ${name}: ${JSON.stringify(b)}`);
    }
    await page.getByRole("banner").getByRole("button", { name: "Details" }).tap();
    await panel.waitFor({ state: "hidden" });
    assert.ok((await canvasOf(page).boundingBox()).width > width * 0.95, "without the panel the picture has the whole width");
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), width);
    assert.deepEqual(complaints, []);
    await close();
  }
});

test("in every language, the names of the tabs are whole and no word of the first tools is broken, beside a picture and on a narrow phone", async () => {
  for (const size of [
    [1200, 800],
    [360, 640],
  ]) {
    const { page, close } = await open(site.browser, fort("?error=50"), { size });
    await openTab(page, "Measure");
    await page.getByRole("tabpanel", { name: "Measure" }).getByRole("button", { name: "Distance" }).waitFor();
    const languages = await page
      .getByRole("combobox", { name: "Language" })
      .first()
      .locator("option")
      .evaluateAll((all) => all.map(({ value }) => value));
    assert.ok(languages.length >= 5, languages.join());
    for (const language of languages) {
      await page.getByRole("banner").getByRole("combobox").first().selectOption(language);
      await page.waitForFunction((lang) => document.documentElement.lang === lang, language);
      const tabs = page.getByRole("tab").locator("span");
      const cut = await tabs.evaluateAll((all) => all.filter((e) => e.scrollWidth > e.clientWidth).map((e) => e.textContent));
      assert.deepEqual(cut, [], `${size}, ${language}: tabs`);
      const tools = page.getByRole("tabpanel").locator(".often span");
      assert.equal(await tools.count(), 4);
      const broken = await tools.evaluateAll((all) =>
        all.flatMap((e) =>
          [...e.textContent.matchAll(/\S+/g)].flatMap(({ 0: word, index }) => {
            const range = document.createRange();
            const text = [...e.childNodes].find((node) => node.data?.includes(word));
            range.setStart(text, index);
            range.setEnd(text, index + word.length);
            return range.getClientRects().length > 1 ? [word] : [];
          }),
        ),
      );
      assert.deepEqual(broken, [], `${size}, ${language}: tools`);
    }
    await close();
  }
});

test("the model is framed beside the tools: at first, in standard views, and when all of it is shown", async () => {
  for (const size of [
    [1100, 500],
    [390, 844],
    [740, 360],
  ]) {
    const { page, close } = await open(site.browser, fort("?error=8"), { size });
    const [rail, canvas] = [await TOOLS(page).boundingBox(), await canvasOf(page).boundingBox()];
    const isColumn = rail.height > rail.width;
    /** How many of some places along the tools, and of some in the picture, the model is at. */
    const hits = () =>
      page.evaluate(
        ([from, to, width, height, isColumn]) => {
          const { api } = globalThis.kilwa;
          const isHit = (x, y) => Number(Boolean(api.pick(x, y)));
          const along = Array.from({ length: 41 }, (_, k) => k / 40);
          const under = along.flatMap((part) => [from, (from + to) / 2, to].map((at) => (isColumn ? isHit(at, part * height) : isHit(part * width, at))));
          const all = along.map((part) => (isColumn ? isHit(part * width, height / 2) : isHit(width / 2, part * height)));
          const sum = (list) => list.reduce((a, b) => a + b, 0);
          return { under: sum(under), all: sum(all) };
        },
        isColumn
          ? [1, rail.x + rail.width - canvas.x, canvas.width, canvas.height, true]
          : [rail.y - canvas.y, canvas.height - 1, canvas.width, canvas.height, false],
      );
    const views = { "at first": () => {}, plan: (api) => api.view("plan"), south: (api) => api.view("south"), fit: (api) => api.fit() };
    for (const [name, go] of Object.entries(views)) {
      await page.evaluate(`(${go})(globalThis.kilwa.api)`);
      await waitFor(page, "settled");
      const { under, all } = await hits();
      assert.equal(under, 0, `${size}, ${name}: the model lies under the tools`);
      assert.ok(all > 3, `${size}, ${name}: it is seen`);
    }
    await close();
  }
});

test("labels of measurements keep clear of the pins of notes and of the points that can be moved", async () => {
  const { page, complaints, close } = await open(site.browser, fort("?error=4"), { size: [1100, 700] });
  await openTab(page, "Measure");
  await page.evaluate(async () => {
    const { api } = globalThis.kilwa;
    const canvas = document.querySelector("canvas");
    const at = (x, y) => api.pick(canvas.clientWidth * x, canvas.clientHeight * y);
    const [a, b] = [at(0.45, 0.5), at(0.53, 0.5)];
    await api.addMeasurement({ tool: "distance", rays: [a.ray, b.ray] });
    // Notes round the value: above, below and beside it.
    const spots = [a, b, at(0.49, 0.5), at(0.49, 0.46), at(0.49, 0.54)].filter(Boolean);
    for (const { place } of spots) await api.addAnnotation({ place, title: "Here" });
  });
  const labels = page.getByRole("group", { name: "Measurements" }).getByRole("button", { name: /\d.* m/ });
  const pins = page.getByRole("group", { name: "Notes" }).getByRole("button");
  await labels.first().waitFor();
  const covered = async (others) => {
    const [label, boxes] = [await labels.first().boundingBox(), await Promise.all((await others.all()).map((o) => o.boundingBox()))];
    return boxes.filter((box) => box && meet(label, box)).length;
  };
  await page.waitForFunction(() => document.querySelectorAll("#pins .pin:not([hidden])").length >= 4);
  await waitFor(page, "settled");
  assert.equal(await covered(pins), 0, "a pin covers the value");
  assert.match(await labels.first().innerText(), /\d/, "the value is shown, not only a sign for it");
  await labels.first().click();
  await page.getByRole("tabpanel", { name: "Measure" }).getByRole("button", { name: "Move points" }).first().click();
  const points = page.getByRole("group", { name: "Measurements" }).getByRole("button", { name: /^Move point/ });
  await points.first().waitFor();
  assert.equal(await points.count(), 2);
  assert.equal(await covered(points), 0, "a point that can be moved covers the value");
  assert.deepEqual(complaints, []);
  await close();
});

test("each tab of the panel keeps how far it was scrolled", async () => {
  const { page, close } = await open(site.browser, fort("?error=16"), { size: [1000, 500] });
  const scrolled = () => page.getByRole("tabpanel").evaluate((tab) => tab.parentElement.scrollTop);
  await openTab(page, "Display");
  await page.getByRole("tabpanel", { name: "Display" }).hover();
  await page.mouse.wheel(0, 240);
  await page.waitForFunction(() => document.querySelector("[role=tabpanel]:not([hidden])").parentElement.scrollTop > 200);
  const place = await scrolled();
  await openTab(page, "About");
  assert.equal(await scrolled(), 0, "another tab begins at its top");
  await openTab(page, "Display");
  assert.equal(await scrolled(), place);
  await close();
});

test("a measurement's value and the remark on its accuracy fit in the panel", async () => {
  for (const language of ["en", "fr", "ar"]) {
    const { page, complaints, close } = await open(site.browser, fort(`?error=16&lang=${language}`), { size: [1000, 700] });
    await page.locator("#tool-measure").click();
    await page.locator("#measure-bar").waitFor();
    // Clicked, so that the uncertainty of pointing is part of the remark.
    for (const x of [0.45, 0.53]) await press(page, x, 0.5);
    await done(page);
    await page.locator("#measure .value").first().waitFor();
    const outside = await page.locator("#measure").evaluate((panel) => {
      const { left, right } = panel.getBoundingClientRect();
      const texts = document.createTreeWalker(panel, NodeFilter.SHOW_TEXT);
      const found = [];
      while (texts.nextNode()) {
        const { currentNode: text } = texts;
        const range = document.createRange();
        range.selectNodeContents(text);
        // The lines of the text, not the box around it.
        const lines = [...range.getClientRects()].filter((line) => line.width > 0);
        const isShown = text.parentElement.checkVisibility() && !text.parentElement.closest(".hidden");
        if (isShown && lines.some((line) => line.left < left || line.right > right)) found.push(text.textContent);
      }
      return found;
    });
    assert.deepEqual(outside, [], language);
    assert.deepEqual(complaints, []);
    await close();
  }
});
