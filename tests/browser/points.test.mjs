// A pack of points in the page: it is drawn, the programs for points are loaded and only they, and points are measured as points.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import path from "node:path";
import { promisify } from "node:util";
import { KILWA, fortSite, open, openTab, picture, test } from "./harness.mjs";
import { labels, list, measureDistance, numbers, pointing, raysAt } from "./measuring.mjs";

const run = promisify(execFile);

/** `points.kilwa`: two simulated stations. */
async function prepare(folder) {
  const [scans, survey] = ["scans", "survey"].map((name) => path.join(path.dirname(folder), `${path.basename(folder)}-${name}`));
  await run(KILWA, ["synth", "scans", "--stations", "2", "--columns", "240", "--without", "walkers,grass,scaffolding", "-o", scans]);
  await run(KILWA, ["scans", "import", scans, "-o", survey]);
  await run(KILWA, ["build", survey, "--points", "--title", "Points", "-o", path.join(folder, "points.kilwa")]);
}

const site = fortSite({ prepare });
/** Two places on the walls of a round room. */
const ENDS = [
  [0.75, 0.41],
  [0.76, 0.43],
];

test("a pack of points is drawn, and measured between points, with the programs for points", async () => {
  const asked = [];
  const { page, complaints, close } = await open(site.browser, `${site.server.url}/m/points?error=4`, {
    size: [960, 640],
    before: (page) => page.on("request", (request) => asked.push(path.basename(new URL(request.url()).pathname))),
  });
  assert.ok((await picture(page)).share > 0.02, "the points are in the picture");
  assert.ok(asked.includes("decode-points_bg.wasm"));
  const rays = await raysAt(page, ...ENDS);
  await measureDistance(page, ...ENDS);
  assert.ok(asked.includes("measure-points_bg.wasm") && !asked.includes("measure_bg.wasm"), `${asked}`);
  const [one] = await list(page);
  assert.equal(one.state, "final");
  const pointed = (await pointing(page)).join(",");
  const { stdout } = await run(KILWA, [
    "measure",
    path.join(site.folder, "points.kilwa"),
    "distance",
    "--pointing",
    pointed,
    "--rays",
    ...numbers(rays).map(String),
  ]);
  const label = await labels(page).first().innerText();
  const value = /[\d.]+ m/u.exec(label)?.[0];
  assert.ok(value && stdout.includes(value), `${label} is in ${stdout}`);
  await openTab(page, "About");
  await page.getByText("Points", { exact: true }).first().waitFor();
  assert.deepEqual(complaints, []);
  await close();
});
