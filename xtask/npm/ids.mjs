// The ids of the page's HTML with the type of element that each names, as a declaration file: `node ids.mjs www/index.html > ids.d.ts`.
// www/dom.js looks elements up by these, so that the type checker finds an id that is misspelt or an element used as another one.
import { readFile } from "node:fs/promises";

const html = await readFile(process.argv[2], "utf8");
const SVG = new Set(["svg", "path", "circle", "use", "g"]);
const found = new Map();
for (const [tag, name] of html.matchAll(/<([a-z][a-z0-9]*)\b[^>]*>/g)) {
  const id = /\sid="([^"]+)"/.exec(tag)?.[1];
  if (!id) continue;
  if (found.has(id)) throw new Error(`${process.argv[2]}: two elements have the id ${id}`);
  found.set(id, `${SVG.has(name) ? "SVG" : "HTML"}ElementTagNameMap["${name}"]`);
}
const lines = [...found].map(([id, type]) => `  ${JSON.stringify(id)}: ${type};`);
console.log(`/** Written by xtask/npm/ids.mjs. */\nexport interface Ids {\n${lines.join("\n")}\n}`);
console.log(`
/** The ids of elements of one kind. */
export type IdsOf<E> = { [K in keyof Ids]: Ids[K] extends E ? K : never }[keyof Ids];`);
