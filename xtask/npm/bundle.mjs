// Bundles the page's modules: few files instead of many, each small. `node bundle.mjs WWW OUT GLUE…`; prints the names of the chunks
// that the page needs before it runs. GLUE are scripts that wasm-bindgen wrote: they stay modules of their own, which program.js and the
// worker load by address, and are only made smaller.
import { build, transform } from "esbuild";
import { readFile, writeFile } from "node:fs/promises";
import { basename, join } from "node:path";

const [, , www, out, ...glue] = process.argv;
const entries = ["boot.js", "app.js", "list.js", "kilwa-viewer.js", "decode-worker.js", "measure/worker.js"];
const result = await build({
  entryPoints: entries.map((name) => join(www, name)),
  outdir: out,
  bundle: true,
  splitting: true,
  format: "esm",
  target: "es2022",
  minify: true,
  charset: "utf8",
  chunkNames: "chunk-[hash]",
  external: ["./decode.js", "../measure.js"],
  metafile: true,
  logLevel: "warning",
});
for (const path of glue) {
  const { code } = await transform(await readFile(path, "utf8"), { minify: true, format: "esm", target: "es2022", charset: "utf8" });
  await writeFile(join(out, basename(path)), code);
}
// What the first two need before they run.
const needed = new Set();
for (const [name, output] of Object.entries(result.metafile.outputs)) {
  if (!/(^|\/)(boot|app)\.js$/.test(name)) continue;
  for (const use of output.imports) if (use.kind === "import-statement" && !use.external) needed.add(use.path.split("/").pop());
}
console.log([...needed].sort().join("\n"));
