// The IIIF records of a published model (iiif/manifest.json, iiif/annotations.json), read by the implementation of the IIIF 3D group (@iiif/3d-manifesto-dev), and held
// against what the draft of Presentation 4 (21 May 2026) requires. No browser.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { mkdtemp, readFile, rm, stat, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, before } from "node:test";
import { promisify } from "node:util";
import manifesto from "@iiif/3d-manifesto-dev";
import { KILWA, WWW, test } from "./harness.mjs";

const run = promisify(execFile);
const HOME = "https://museum.example/models/pyramid/";
const METADATA = `title = "Pyramid"
slug = "pyramid"
url = "${HOME}"
publisher = "Museum"
[rights]
uri = "CC BY 4.0"
statement = "Photograph it, and name us."
[model]
units = "m"
crs = "local"
`;
/** A pyramid that stands far from zero, so that its scene has another origin than its pack. */
const CORNERS = ["1000 2000 30", "1004 2000 30", "1004 2002 30", "1000 2002 30", "1002 2001 33"];
const FACES = ["3 0 2 1", "3 0 3 2", "3 0 1 4", "3 1 2 4", "3 2 3 4", "3 3 0 4"];
const NOTES = [
  { title: "The top", place: [1002, 2001, 33], body: [{ type: "TextualBody", purpose: "describing", value: "Three metres high." }] },
  {
    title: "A corner",
    place: [1004, 2002, 30],
    body: [
      { type: "TextualBody", purpose: "describing", value: "North-east." },
      { type: "SpecificResource", purpose: "linking", source: "https://example.org/corner" },
    ],
  },
];
let folder;

/** The file of the object with this address. */
function fileAt(address) {
  assert.ok(address.startsWith(HOME), address);
  return path.join(folder, "site/pyramid", decodeURIComponent(address.slice(HOME.length)));
}
const json = async (address) => JSON.parse(await readFile(fileAt(address), "utf8"));

before(async () => {
  folder = await mkdtemp(path.join(tmpdir(), "kilwa-iiif-"));
  const at = (name) => path.join(folder, name);
  const header = ["ply", "format ascii 1.0", `element vertex ${CORNERS.length}`, "property double x", "property double y", "property double z"];
  const lines = [...header, `element face ${FACES.length}`, "property list uchar int vertex_indices", "end_header", ...CORNERS, ...FACES];
  await writeFile(at("pyramid.ply"), `${lines.join("\n")}\n`);
  await writeFile(at("m.toml"), METADATA);
  const items = NOTES.map(({ title, place: [x, y, z], body }, i) => ({
    id: `urn:uuid:0000000${i}-0000-4000-8000-000000000000`,
    type: "Annotation",
    label: title,
    body,
    target: { selector: { type: "PointSelector", x, y, z } },
  }));
  await writeFile(at("notes.json"), JSON.stringify({ type: "AnnotationPage", items }));
  await run(KILWA, ["build", at("pyramid.ply"), "-o", at("pyramid.kilwa")]);
  await run(KILWA, ["publish", at("pyramid.kilwa"), "--to", at("site"), "--metadata", at("m.toml"), "--notes", at("notes.json"), "--software", "--www", WWW]);
});
after(() => rm(folder, { recursive: true, force: true }));

/** The only scene, as manifesto gives it. */
async function sceneOf(manifest) {
  const scenes = manifest.getSequences()[0].getScenes();
  assert.equal(scenes.length, 1);
  assert.ok(scenes[0].isScene());
  return scenes[0];
}
const parsed = async () => manifesto.parseManifest(await json(`${HOME}v1/iiif/manifest.json`));

/** Column by column, as glTF has it. */
const times = (matrix, [x, y, z]) => [0, 1, 2].map((row) => matrix[row] * x + matrix[4 + row] * y + matrix[8 + row] * z + matrix[12 + row]);

test("another implementation finds the scene, its model, and what must be shown with it", async () => {
  const manifest = await parsed();
  assert.equal(manifest.getLabel().getValue("en"), "Pyramid");
  assert.equal(manifest.getRights(), "http://creativecommons.org/licenses/by/4.0/");
  assert.equal(manifest.getRequiredStatement().getValue("en"), "Photograph it, and name us.");
  assert.equal((await stat(fileAt(manifest.getThumbnail().id))).isFile(), true);
  const scene = await sceneOf(manifest);
  assert.equal(scene.getLabel().getValue("en"), "Pyramid");
  assert.deepEqual(scene.getBackgroundColor().value, [230, 226, 217]);
  assert.deepEqual(scene.getProperty("spatialScale").quantityValue, 1);

  const painted = scene.getContent();
  assert.equal(painted.length, 1);
  assert.deepEqual(painted[0].getMotivation(), ["painting"]);
  assert.equal(painted[0].getTarget().id, scene.id);
  const [model, ...others] = painted[0].getBody();
  assert.deepEqual([model.isModel(), model.getFormat(), others.length], [true, "model/gltf-binary", 0]);
  const glb = await readFile(fileAt(model.id));
  assert.equal(glb.toString("latin1", 0, 4), "glTF");

  // The pack, for those who want all levels of detail.
  const [pack, ...rest] = manifest.getRenderings();
  assert.equal(rest.length, 0);
  const file = await readFile(fileAt(pack.id));
  assert.equal(file.toString("latin1", 0, 8), "KILWAPCK");
  assert.equal(pack.getProperty("fileSize"), file.length);
});

test("another implementation finds the notes where they are on the model", async () => {
  const scene = await sceneOf(await parsed());
  const [{ id }] = scene.getProperty("annotations");
  const page = new manifesto.AnnotationPage(await json(id), scene.options);
  const notes = page.getItems().map((item) => new manifesto.Annotation(item, scene.options));
  assert.equal(notes.length, NOTES.length);
  // Where the model stands in the scene, from the file that is painted there.
  const glb = await readFile(fileAt(scene.getContent()[0].getBody()[0].id));
  const gltf = JSON.parse(glb.toString("utf8", 20, 20 + glb.readUInt32LE(12)));
  const origin = gltf.extras.world_from_local_m;
  for (const [i, note] of notes.entries()) {
    const { title, place, body } = NOTES[i];
    assert.deepEqual(note.getMotivation(), ["commenting"]);
    assert.equal(note.getLabel().getValue("en"), title);
    assert.equal(note.getTarget().getSource().id, scene.id);
    const expected = times(
      gltf.nodes[0].matrix,
      place.map((v, k) => v - origin[k]),
    );
    const { x, y, z } = note.LookAtLocation;
    for (const [k, found] of [x, y, z].entries()) assert.ok(Math.abs(found - expected[k]) < 1e-5, `${title}: ${[x, y, z]}, expected ${expected}`);
    // manifesto 0.6.1 makes no object of a TextualBody.
    const said = note.getProperty("body");
    assert.equal((said.items ?? [said])[0].value, body[0].value);
    assert.equal(said.type, body.length > 1 ? "Independents" : "TextualBody");
  }
  assert.equal(notes[1].getProperty("body").items[1].source.id, "https://example.org/corner");
  // Three metres above the ground, in a scene with y up.
  assert.ok(Math.abs(notes[0].LookAtLocation.y - notes[1].LookAtLocation.y - 3) < 1e-5);
});

/** Every object of a record that has a type. */
function* resources(value) {
  if (Array.isArray(value)) for (const one of value) yield* resources(one);
  else if (value !== null && typeof value === "object") {
    if (typeof value.type === "string") yield value;
    for (const one of Object.values(value)) yield* resources(one);
  }
}

test("the records have what the draft of Presentation 4 requires", async () => {
  const isOne = (value) => value !== null && typeof value === "object" && !Array.isArray(value) && typeof value.type === "string";
  const required = {
    Manifest: ["id", "label", "items"],
    Scene: ["id"],
    AnnotationPage: ["id"],
    Annotation: ["id", "target", "motivation"],
    SpecificResource: ["id", "source"],
    TextualBody: ["value"],
    Independents: ["items"],
    Quantity: ["quantityValue", "unit"],
    Agent: ["id", "label"],
    PointSelector: ["x", "y", "z"],
    Model: ["id"],
    Image: ["id"],
    Text: ["id"],
    Dataset: ["id"],
  };
  for (const name of ["manifest", "annotations"]) {
    const record = await json(`${HOME}v1/iiif/${name}.json`);
    assert.equal(record["@context"], "http://iiif.io/api/presentation/4/context.json");
    const ids = new Set();
    for (const one of resources(record)) {
      const about = JSON.stringify(one).slice(0, 300);
      assert.ok(one.type in required, `unexpected: ${about}`);
      for (const key of required[one.type]) assert.ok(key in one, `${key} is missing: ${about}`);
      if ("id" in one) assert.match(one.id, /^https?:/, about);
      if (one.type === "Scene") assert.ok(!one.id.includes("#"), "a container has an address without a fragment");
      if ("selector" in one) assert.ok(Array.isArray(one.selector) && one.selector.length > 0, about);
      for (const key of ["body", "target", "source"]) if (key in one) assert.ok(isOne(one[key]), `${key} is one object: ${about}`);
      if (["Annotation", "SpecificResource", "AnnotationPage"].includes(one.type) && "id" in one) {
        assert.ok(!ids.has(one.id), `twice: ${one.id}`);
        ids.add(one.id);
      }
      for (const key of ["rendering", "thumbnail", "homepage", "seeAlso", "provider", "items", "annotations"]) {
        if (key in one) assert.ok(Array.isArray(one[key]) && one[key].length > 0, `${key}: ${about}`);
      }
    }
  }
});
