// The holes of a merged surface in the page: outlines where the surface ends, a list that leads to each, messages in every language, and files that are refused.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { readFile, rm, writeFile } from "node:fs/promises";
import path from "node:path";
import { promisify } from "node:util";
import { serious } from "./axe.mjs";
import { SHARP, fortSite, KILWA, open, openTab, picture, setCamera, stats, test, waitFor } from "./harness.mjs";

const run = promisify(execFile);
let list;

/** A pack of two squares beside each other, 1 m wide; the one at larger x was filled. */
async function halfFilled(folder) {
  const [vertices, faces, size] = [[], [], 24];
  for (const filled of [0, 1]) {
    const first = vertices.length;
    for (let row = 0; row <= size; row += 1)
      for (let column = 0; column <= size; column += 1) vertices.push(`${filled + column / size} ${row / size} 0 ${filled}`);
    for (let row = 0; row < size; row += 1) {
      for (let column = 0; column < size; column += 1) {
        const a = first + row * (size + 1) + column;
        faces.push(`3 ${a} ${a + 1} ${a + size + 2}`, `3 ${a} ${a + size + 2} ${a + size + 1}`);
      }
    }
  }
  const header = ["ply", "format ascii 1.0", `element vertex ${vertices.length}`, ...["x", "y", "z", "scalar_filled"].map((name) => `property float ${name}`)];
  const mesh = path.join(folder, "half.ply");
  await writeFile(
    mesh,
    [...header, `element face ${faces.length}`, "property list uchar int vertex_indices", "end_header", ...vertices, ...faces, ""].join("\n"),
  );
  await run(KILWA, ["build", mesh, "-o", path.join(folder, "half.kilwa")]);
  await rm(mesh);
}

/** Simulated scans of the fort, merged with a list of holes, which is beside the pack; and a pack without a list. */
const site = fortSite({
  prepare: async (folder) => {
    const at = (name) => path.join(folder, name);
    await halfFilled(folder);
    await run(KILWA, ["synth", "scans", "--stations", "3", "--columns", "200", "-o", at("scans")]);
    await run(KILWA, ["scans", "import", at("scans"), "-o", at("survey")]);
    await run(KILWA, ["merge", at("survey"), "-o", at("ruin.kilwa"), "--holes", at("ruin.holes.geojson")]);
    await Promise.all(["scans", "survey"].map((name) => rm(at(name), { recursive: true })));
    list = JSON.parse(await readFile(at("ruin.holes.geojson"), "utf8"));
  },
});

const ruin = (query = "") => `${site.server.url}/m/ruin?error=8${query}`;
const group = (page, name = "Holes") => page.getByRole("group", { name, exact: true });
const shown = (page) => group(page).getByRole("checkbox");
const rows = (page) => group(page).getByRole("listitem").getByRole("button");
const message = (page, text) => page.getByRole("main").getByRole("status").filter({ hasText: text });

async function openHoles(page) {
  await openTab(page, "Display");
  await shown(page).check();
  await rows(page).first().waitFor();
  await waitFor(page, "settled");
}

/** How many pixels of the outlines have a colour of their own: the canvas is the one before that of the measurements. */
const inked = (page) =>
  page.evaluate(() => {
    const canvas = document.querySelector("canvas.marks:not(#marks)");
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    let count = 0;
    for (let k = 3; k < data.length; k += 4) count += Number(data[k] > 0);
    return count;
  });

/** Drops a file onto the page. */
async function drop(page, name, text) {
  const transfer = await page.evaluateHandle(
    ([name, text]) => {
      const data = new DataTransfer();
      data.items.add(new File([text], name, { type: "application/geo+json" }));
      return data;
    },
    [name, text],
  );
  await page.dispatchEvent("body", "drop", { dataTransfer: transfer });
}

for (const gpu of ["", "&gpu=webgl"]) {
  test(`outlines appear on request, and a row moves the view to its hole${gpu && " (WebGL 2)"}`, async () => {
    const asked = [];
    const { page, complaints, close } = await open(site.browser, ruin(gpu), {
      size: [1280, 800],
      before: (page) => page.on("request", (request) => asked.push(new URL(request.url()).pathname)),
    });
    await openTab(page, "Display");
    await shown(page).waitFor();
    assert.ok(!asked.some((name) => name.endsWith(".geojson")), "the list is loaded when it is asked for");
    await openHoles(page);
    assert.ok((await inked(page)) > 500);
    const holes = list.features.length;
    assert.equal(await rows(page).count(), Math.min(holes, 200));
    const { area_m2: area } = list.features[0].properties;
    assert.ok((await rows(page).first().innerText()).includes(`${Number(area.toPrecision(3))} m²`), await rows(page).first().innerText());
    assert.equal(await group(page).getByText("Seen by no station").first().isVisible(), true);
    await rows(page).first().focus();
    await page.keyboard.press("Enter");
    await page.waitForFunction(() => document.querySelector("#holes [aria-current=true]"));
    await waitFor(page, "settled");
    const { target, distance } = await page.evaluate(() => globalThis.kilwa.api.getCamera());
    const { center } = list.features[0].properties;
    assert.ok(Math.hypot(...target.map((v, k) => v - center[k])) < 0.01, JSON.stringify({ target, center }));
    assert.ok(distance > 0.1);
    await shown(page).uncheck();
    assert.equal(await inked(page), 0);
    assert.equal(await rows(page).count(), 0);
    assert.deepEqual(complaints, []);
    await close();
  });
}

test("an outline lies where the surface ends", async () => {
  const { page, close } = await open(site.browser, ruin(), { size: [1000, 800] });
  await openHoles(page);
  // A hole that is large and nearly upright or level: its rim is on the surface, its middle is not.
  const found = await page.evaluate(async (features) => {
    const { api } = globalThis.kilwa;
    for (const { geometry, properties } of features.filter(({ properties }) => properties.area_m2 > 0.3).slice(0, 30)) {
      const rim = geometry.coordinates[0];
      const [x, y, z] = properties.center;
      for (const elevation of [1.4, 0.2]) {
        for (const azimuth of [0, 1.57, 3.14, 4.71]) {
          api.setCamera({ target: [x, y, z], azimuth, elevation, distance: 6, orthographic: false });
          await new Promise((resolve) => setTimeout(resolve, 300));
          const canvas = document.querySelector("canvas").getBoundingClientRect();
          const hit = api.pick(canvas.width / 2, canvas.height / 2);
          const near = hit && Math.hypot(...hit.place.map((v, k) => v - properties.center[k]));
          if (!hit || near > 0.5) return { rim: rim.length, azimuth, elevation };
        }
      }
    }
    return null;
  }, list.features);
  assert.ok(found, "no hole shows what lies behind it");
  await close();
});

test("lengths and areas are in the unit of the measurements", async () => {
  const { page, close } = await open(site.browser, ruin());
  await page.evaluate(() => localStorage.setItem("kilwa.unit", '"ft"'));
  await openHoles(page);
  const { area_m2: area } = list.features[0].properties;
  assert.ok((await rows(page).first().innerText()).includes(`${Number((area / 0.3048 ** 2).toPrecision(3)).toLocaleString("en")} ft²`));
  await page.evaluate(() => localStorage.removeItem("kilwa.unit"));
  await close();
});

test("the list is in the language of the page, and follows it", async () => {
  const { page, close } = await open(site.browser, ruin());
  await openHoles(page);
  for (const [language, name, cause] of [
    ["fr", "Trous", "Vu d’aucune station"],
    ["pt", "Buracos", "Não visto de nenhuma estação"],
    ["sw", "Matundu", "Halikuonekana na kituo chochote"],
    ["ar", "الثقوب", "لم تره أي محطة"],
  ]) {
    await page.evaluate((language) => globalThis.kilwa.api.setLanguage(language), language);
    await group(page, name).getByText(cause).first().waitFor();
  }
  await close();
});

test("a list can be dropped onto the page of a pack; lists of another model and malformed lists are refused", async () => {
  const { page, close } = await open(site.browser, `${site.server.url}/m/fort?error=16`, SHARP);
  const { bounds_min: min, bounds_max: max } = await page.evaluate(() => globalThis.kilwa.api.info().metadata);
  assert.equal(await group(page).count(), 0);
  const middle = min.map((v, k) => (v + max[k]) / 2);
  const rim = (d) => [
    middle.map((v) => v + d),
    [middle[0] + d + 1, middle[1] + d, middle[2]],
    [middle[0] + d, middle[1] + d + 1, middle[2]],
    middle.map((v) => v + d),
  ];
  const hole = (d, cause = "free") => ({
    type: "Feature",
    geometry: { type: "Polygon", coordinates: [rim(d)] },
    properties: { cause, area_m2: 0.5, rim_m: 3.4, center: middle, areas_m2: { unseen: 0, free: 0.5, dropped: 0, no_return: 0 } },
  });
  const holes = (...features) => JSON.stringify({ type: "FeatureCollection", name: "holes", features });
  await drop(page, "other.geojson", holes(hole(1e5)));
  await message(page, "not the list that kilwa merge --holes wrote with this model").waitFor();
  await drop(page, "broken.geojson", holes(hole(0, "magic")));
  await message(page, "The list of holes could not be read").waitFor();
  // More than a page could show at once.
  await drop(page, "many.geojson", holes(...Array.from({ length: 3000 }, () => hole(0))));
  await openTab(page, "Display");
  await rows(page).first().waitFor();
  assert.equal(await rows(page).count(), 200);
  await group(page).getByText("3,000 holes, 1,500 m² in total.").waitFor();
  await group(page).getByText("Smaller holes not shown: 2,800.").waitFor();
  assert.ok((await inked(page)) > 20);
  // Another pack has no list.
  const file = path.join(site.folder, "ruin.kilwa");
  await page.getByLabel("Open a file").first().setInputFiles(file);
  await waitFor(page, "settled");
  assert.equal(await group(page).count(), 0);
  await close();
});

test("a list that cannot be loaded gives a message and leaves the model as it is", async () => {
  const { page, close } = await open(site.browser, ruin(), {
    before: (page) => page.route("**/*.geojson", (route) => route.fulfill({ status: 500 })),
  });
  await openTab(page, "Display");
  await shown(page).click();
  await message(page, "The list of holes could not be read").waitFor();
  assert.equal(await shown(page).isChecked(), false);
  assert.ok((await stats(page)).trianglesDrawn > 0);
  await close();
});

test("axe-core finds nothing serious in the list, in both themes and in Arabic", async () => {
  for (const locale of ["en", "ar"]) {
    const { page, complaints, close } = await open(site.browser, ruin(), { size: [1280, 900], locale });
    await page.locator("#tab-display").click();
    await page.locator("#holes input").check();
    await page.locator("#holes li button").nth(2).click();
    await waitFor(page, "settled");
    if (process.env.KILWA_SHOTS) await page.screenshot({ path: path.join(process.env.KILWA_SHOTS, `holes-${locale}.png`) });
    assert.deepEqual(await serious(page, locale, ["#display"]), []);
    assert.deepEqual(complaints, []);
    await close();
  }
});

test("on a phone, selecting a hole lowers the sheet", async () => {
  const { page, close } = await open(site.browser, ruin(), { size: [360, 780], hasTouch: true });
  await page.locator("#tab-display").click();
  await page.locator("#holes input").check();
  await rows(page).first().waitFor();
  if (process.env.KILWA_SHOTS) await page.screenshot({ path: path.join(process.env.KILWA_SHOTS, "holes-phone-list.png") });
  await rows(page).first().click();
  await page.locator("#panel[data-size=peek]").waitFor();
  await waitFor(page, "settled");
  if (process.env.KILWA_SHOTS) {
    await page.waitForTimeout(1500);
    await page.screenshot({ path: path.join(process.env.KILWA_SHOTS, "holes-phone.png") });
  }
  await close();
});

for (const gpu of ["", "&gpu=webgl"]) {
  test(`the filled surface is hidden and shown again, in the picture and for picks${gpu && " (WebGL 2)"}`, async () => {
    const { page, complaints, close } = await open(site.browser, `${site.server.url}/m/half?error=0${gpu}`);
    await setCamera(page, { target: [1, 0.5, 0], azimuth: 0, elevation: 1.57, distance: 8, orthographic: true });
    await waitFor(page, "settled");
    await openTab(page, "Display");
    const filled = page.getByRole("checkbox", { name: "Show the filled surface" });
    assert.equal(await filled.isChecked(), true);
    const look = async () => {
      await waitFor(page, "settled");
      return page.evaluate(() => {
        const { width, height } = document.querySelector("#canvas").getBoundingClientRect();
        const { api } = globalThis.kilwa;
        const hits = [];
        for (let x = 0; x < width; x += 4) hits.push(...(api.pick(x, height / 2)?.place.slice(0, 1) ?? []));
        return { right: hits.filter((x) => x > 1.02).length, left: hits.filter((x) => x < 0.98).length };
      });
    };
    const before = await look();
    assert.ok(before.left > 5 && before.right > 5, JSON.stringify(before));
    const { share } = await picture(page);
    await filled.uncheck();
    const hidden = await look();
    assert.deepEqual({ ...hidden, left: hidden.left > 5 }, { right: 0, left: true });
    const half = (await picture(page)).share / share;
    assert.ok(Math.abs(half - 0.5) < 0.05, `${half} of the picture is left`);
    assert.equal((await page.evaluate(() => globalThis.kilwa.api.state().display)).hideFilled, true);
    // A link shows it in the same way; the address is updated once the camera stops moving.
    await page.waitForFunction(() => location.hash.includes("hideFilled"));
    await page.reload();
    await waitFor(page, "settled");
    await openTab(page, "Display");
    assert.equal(await filled.isChecked(), false);
    assert.equal((await look()).right, 0);
    await filled.check();
    assert.deepEqual(await look(), before);
    assert.equal((await picture(page)).share, share);
    assert.deepEqual(complaints, []);
    await close();
  });
}

test("a pack without the channel has no such setting", async () => {
  const { page, close } = await open(site.browser, ruin());
  await openTab(page, "Display");
  await shown(page).waitFor();
  assert.equal(await page.getByRole("checkbox", { name: "Show the filled surface" }).count(), 0);
  await close();
});
