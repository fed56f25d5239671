// The declared types hold together, and say of the API what the API has.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { mkdtemp, readFile, rm, writeFile } from "node:fs/promises";
import { createRequire } from "node:module";
import { tmpdir } from "node:os";
import path from "node:path";
import { test } from "node:test";
import { promisify } from "node:util";
import { ROOT } from "./harness.mjs";

const WWW = path.join(ROOT, "www");
const TSC = path.join(path.dirname(createRequire(import.meta.url).resolve("typescript/package.json")), "bin/tsc");

/** What a page writes: right uses, and wrong ones that must be refused. */
const USE = `
import type { KilwaApi, Camera } from "./kilwa-viewer.js";
const element = document.createElement("kilwa-viewer");
element.src = "fort.kilwa";
export async function use(api: KilwaApi): Promise<string> {
  const camera: Camera = await element.getCamera();
  await element.setCamera({ azimuth: camera.azimuth + 1 }, { ease: true });
  const hit = await element.pick(1, 2);
  if (hit) await element.addAnnotation({ place: hit.place, title: "Gate" });
  if (hit) {
    const { readings } = await element.addMeasurement({ tool: "distance", rays: [hit.ray, hit.ray] });
    readings[0]?.value.toFixed();
  }
  // @ts-expect-error there is no such tool
  await element.addMeasurement({ tool: "weight" });
  element.on("camera", (moved) => moved.target[2].toFixed());
  api.on("annotation", ({ id }) => id?.length);
  const blob: Blob = await api.picture({ width: 3840, height: 2160 });
  api.camera = { ...api.camera, distance: 3 };
  // @ts-expect-error there is no such view
  await element.view("sideways");
  // @ts-expect-error a place has three numbers
  await element.addAnnotation({ place: [1, 2] });
  // @ts-expect-error inside the page, figures are no promise
  await api.stats().then();
  return api.mode + blob.type;
}
`;

test("the types compile strictly, take right uses and refuse wrong ones", async () => {
  const folder = await mkdtemp(path.join(tmpdir(), "kilwa-types-"));
  try {
    await writeFile(path.join(folder, "kilwa-viewer.d.ts"), await readFile(path.join(WWW, "kilwa-viewer.d.ts")));
    await writeFile(path.join(folder, "use.ts"), USE);
    const options = ["--noEmit", "--strict", "--target", "es2022", "--module", "nodenext", "--lib", "es2022,dom", "use.ts"];
    await promisify(execFile)(process.execPath, [TSC, ...options], { cwd: folder }).catch((error) => assert.fail(error.stdout));
  } finally {
    await rm(folder, { recursive: true });
  }
});

test("the types, the API, the element and the messages name the same calls", async () => {
  const read = (name) => readFile(path.join(WWW, name), "utf8");
  const names = (text) => [...text.matchAll(/"(\w+)"/g)].map((m) => m[1]).sort();
  const api = await read("api.js");
  const calls = names(/CALLS = \[([^\]]+)\]/.exec(await read("calls.js"))[1]);
  const declared = /interface KilwaMethods \{([\s\S]*?)\n\}/.exec(await read("kilwa-viewer.d.ts"))[1];
  const typed = [...declared.matchAll(/^ {2}(\w+)\(/gm)].map((m) => m[1]).sort();
  assert.deepEqual(typed, calls);
  for (const name of calls) assert.match(api, new RegExp(`^ {2}(async )?${name}\\(`, "m"), name);
});
