// Bundles the page's modules: few files instead of many, each small. `node bundle.mjs WWW OUT GLUE…`; prints two lines of names: what
// the page needs before it asks for anything, and what it needs besides before it starts. GLUE are scripts that wasm-bindgen wrote: they stay modules of their own,
// which program.js and the worker of the measuring tools load by address, and are only made smaller; so are the style sheets. That of the decoder is part of
// its worker, which would wait for a second answer.
import { build, transform } from "esbuild";
import { copyFile, readFile, writeFile } from "node:fs/promises";
import { basename, join } from "node:path";
import { fileURLToPath } from "node:url";

const [, , www, out, ...glue] = process.argv;
const decoder = glue.find((path) => basename(path) === "decode.js");
const common = { outdir: out, bundle: true, format: "esm", target: "es2022", minify: true, charset: "utf8", legalComments: "none", logLevel: "warning" };
// Other people's pages load this one alone, perhaps as a copy: it shares no chunk with the viewer.
await build({ ...common, entryPoints: [join(www, "kilwa-viewer.js")] });
const entries = ["boot.js", "app.js", "decode-worker.js", "measure/worker.js"];
const result = await build({
  ...common,
  entryPoints: entries.map((name) => join(www, name)),
  splitting: true,
  chunkNames: "[name]-[hash]",
  external: ["../measure.js", "../measure-points.js", "./decode-points.js"],
  plugins: [{ name: "decoder", setup: (bundle) => bundle.onResolve({ filter: /^\.\/decode\.js$/ }, () => ({ path: decoder })) }],
  // lit-html lies beside this file.
  nodePaths: [fileURLToPath(new URL("node_modules", import.meta.url))],
  metafile: true,
});
// The licences of other people's modules, as files of their own: visitors do not wait for them.
for (const name of ["lit-html", "uqr"]) {
  await copyFile(fileURLToPath(new URL(`node_modules/${name}/LICENSE`, import.meta.url)), join(out, `LICENSE-${name}.txt`));
}
for (const path of glue.filter((path) => path !== decoder)) {
  const { code } = await transform(await readFile(path, "utf8"), { minify: true, format: "esm", target: "es2022", charset: "utf8" });
  await writeFile(join(out, basename(path)), code);
}
for (const name of ["style.css", "measure.css", "photographs.css"]) {
  const { code } = await transform(await readFile(join(www, name), "utf8"), { minify: true, loader: "css", target: "es2022", charset: "utf8" });
  await writeFile(join(out, name), code);
}
// Files that the first one needs before it runs, and that the second one needs besides.
const needs = (entry) => {
  const [, output] = Object.entries(result.metafile.outputs).find(([name]) => basename(name) === entry);
  return output.imports
    .filter((use) => use.kind === "import-statement" && !use.external)
    .map((use) => basename(use.path))
    .sort();
};
const first = needs("boot.js");
console.log(["boot.js", ...first].join(" "));
console.log(["app.js", ...needs("app.js").filter((name) => !first.includes(name))].join(" "));
