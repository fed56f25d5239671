// Tilesets of the fort, the pages of the three clients, and a server for both that knows nothing of either.

import { execFile } from "node:child_process";
import { mkdir, readFile, readdir, rm, writeFile } from "node:fs/promises";
import http from "node:http";
import path from "node:path";
import { promisify } from "node:util";
import { build } from "esbuild";
import { KILWA, ROOT } from "../harness.mjs";

const run = promisify(execFile);
const HERE = path.join(ROOT, "tests/browser/tiles");
const CESIUM = path.join(ROOT, "tests/browser/node_modules/cesium/Build/Cesium");
const PAGES = ["cesium", "loaders", "renderer", "whole"];
const TYPES = {
  ".html": "text/html",
  ".js": "text/javascript",
  ".css": "text/css",
  ".json": "application/json",
  ".glb": "model/gltf-binary",
  ".wasm": "application/wasm",
};

/**
 * The fort as one file (`whole.glb`) and as two tilesets: `web`, compressed and placed on the globe by its reference system, and `plain`, without extensions
 * and in the coordinates of the pack.
 */
export async function makeTilesets(folder, triangles) {
  const [mesh, pack] = ["fort.ply", "fort.kilwa"].map((name) => path.join(folder, name));
  await run(KILWA, ["synth", "fort", "--utm", "--triangles", String(triangles), "-o", mesh]);
  await run(KILWA, ["build", mesh, "--crs", "EPSG:32737", "-o", pack]);
  await rm(mesh);
  const extract = (name, ...options) => run(KILWA, ["extract", pack, "-o", path.join(folder, name), ...options]);
  await extract("whole.glb");
  await extract("web", "--to", "tiles", "--geoid-offset", "-28");
  await extract("plain", "--to", "tiles", "--profile", "plain", "--crs", "local");
}

/** The pages and their code in `folder`; CesiumJS comes as it is published. */
export async function makePages(folder) {
  await build({
    entryPoints: PAGES.map((page) => path.join(HERE, `${page}.mjs`)),
    outdir: folder,
    bundle: true,
    format: "esm",
    target: "es2022",
    external: ["cesium"],
    // Loads other programs in Node.js only.
    define: { "process.env.NODE_ENV": '"production"' },
    logLevel: "error",
  });
  for (const page of PAGES) {
    const cesium = `<link rel="stylesheet" href="/cesium/Widgets/widgets.css"><script>globalThis.CESIUM_BASE_URL = "/cesium/"</script>`;
    const head = `<meta charset="utf-8"><link rel="icon" href="data:,"><style>body { margin: 0 }</style>${page === "cesium" ? cesium : ""}`;
    const imports = JSON.stringify({ imports: { cesium: "/cesium/index.js" } });
    const code = `<script type="importmap">${imports}</script><script type="module" src="${page}.js"></script>`;
    await writeFile(path.join(folder, `${page}.html`), `<!doctype html><html lang="en"><head>${head}<title>${page}</title></head><body>${code}</body></html>`);
  }
}

/**
 * The tileset in `from` as an ordinary exporter would have written it: each tile has the smallest sphere about its own triangles and the spheres below, so
 * that neighbours decide differently. Of the profile without compression, for what is read here.
 */
export async function separateTiles(from, to) {
  await mkdir(path.join(to, "tilesets"), { recursive: true });
  await run("cp", ["-r", path.join(from, "tiles"), to]);
  const tilesets = await readdir(path.join(from, "tilesets")).catch(() => []);
  for (const name of ["tileset.json", ...tilesets.map((name) => `tilesets/${name}`)]) {
    const tileset = JSON.parse(await readFile(path.join(from, name)));
    const shrink = async (tile) => {
      const below = [];
      for (const child of tile.children ?? []) below.push(await shrink(child));
      const uri = tile.content?.uri;
      if (uri?.endsWith(".json")) below.push(tile.boundingVolume.sphere);
      else if (uri) below.push(await sphereOf(path.join(from, path.dirname(name), uri)));
      // There are tiles that show nothing.
      if (below.length > 0) tile.boundingVolume.sphere = about(below);
      return tile.boundingVolume.sphere;
    };
    await shrink(tileset.root);
    await writeFile(path.join(to, name), JSON.stringify(tileset));
  }
}

/** Of a GLB without compression: the sphere about its box, with z up. */
async function sphereOf(file) {
  const bytes = await readFile(file);
  const json = JSON.parse(bytes.toString("utf8", 20, 20 + bytes.readUInt32LE(12)));
  const { min, max } = json.accessors[json.meshes[0].primitives[0].attributes.POSITION];
  const center = json.nodes[0].translation.map((x, k) => x + (min[k] + max[k]) / 2);
  return [center[0], -center[2], center[1], Math.hypot(...max.map((x, k) => x - min[k])) / 2];
}

/** A sphere that holds all of these. */
function about(spheres) {
  return spheres.reduce(([x, y, z, r], [u, v, w, s]) => {
    const apart = Math.hypot(u - x, v - y, w - z);
    if (apart + s <= r) return [x, y, z, r];
    if (apart + r <= s) return [u, v, w, s];
    const radius = (apart + r + s) / 2;
    const share = (radius - r) / apart;
    return [x + (u - x) * share, y + (v - y) * share, z + (w - z) * share, radius];
  });
}

/** Serves `folder`, and CesiumJS under `/cesium`. */
export async function serveFiles(folder) {
  const server = http.createServer((request, response) => {
    const { pathname } = new URL(request.url, "http://localhost");
    const file = pathname.startsWith("/cesium/") ? path.join(CESIUM, pathname.slice("/cesium/".length)) : path.join(folder, pathname);
    readFile(file).then(
      (body) => response.writeHead(200, { "content-type": TYPES[path.extname(file)] ?? "application/octet-stream" }).end(body),
      () => response.writeHead(404).end(),
    );
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  return {
    url: `http://127.0.0.1:${server.address().port}`,
    stop: () => {
      server.closeAllConnections();
      return new Promise((resolve) => server.close(resolve));
    },
  };
}
