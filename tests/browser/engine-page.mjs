// A page for tests of the measuring engine as a module: the model is streamed and drawn by the page's own modules, with no controls around it. The modules
// are those of www/ before they are bundled; the programs and workers are the built ones.

import { access, readFile } from "node:fs/promises";
import path from "node:path";
import { ROOT, WWW, open } from "./harness.mjs";

const MODULES = path.join(ROOT, "www");
/** Where the page's built files are, on every server. */
const FILES = "/viewer/";
const HTML = `<!doctype html><base href="${FILES}"><title>engine</title><canvas style="width: 700px; height: 500px"></canvas>`;

const isThere = (file) =>
  access(file).then(
    () => true,
    () => false,
  );

/** Files that the page requests although the bundle contains them. In the bundle, the engine is one folder higher than in www/. */
async function answer(route) {
  const name = new URL(route.request().url()).pathname.slice(FILES.length);
  if (name === "engine.html") return route.fulfill({ contentType: "text/html", body: HTML });
  if (!name.endsWith(".js") || (await isThere(path.join(WWW, name)))) return route.continue();
  const text = await readFile(path.join(MODULES, name === "engine.js" ? "measure/engine.js" : name), "utf8");
  return route.fulfill({ contentType: "text/javascript", body: text.replaceAll('from "../', 'from "./') });
}

/**
 * Open a pack of a server with the engine: returns what `harness.open` returns, and adds `engineTest` to the page, with `engine`, `viewer`, `session` and `settled()`.
 * @param {import("playwright-core").Browser} browser
 * @param {string} server its address
 * @param {{pack?: string, error?: number}} options the pack's name, and the error allowed in the picture, in pixels
 */
export async function openEngine(browser, server, { pack = "fort", error = 8 } = {}) {
  const opened = await open(browser, `${server}${FILES}engine.html`, {
    size: [700, 500],
    wait: null,
    before: (page) => page.route(`**${FILES}*`, answer),
  });
  await opened.page.evaluate(load, { address: `${server}/packs/${pack}.kilwa`, error });
  return opened;
}

/** Runs in the page. */
async function load({ address, error }) {
  const [{ Pack }, { load }, { DecodePool }, { Session }, { Engine }, { firstBytes, wholeHead }] = await Promise.all(
    ["loader", "program", "decode-pool", "session", "engine", "head"].map((name) => import(new URL(`${name}.js`, document.baseURI).href)),
  );
  const pack = new Pack(new URL(address));
  const module = await load(new URLSearchParams());
  const head = await wholeHead(pack, module, await firstBytes(pack, pack.head(), () => {}));
  const { colors, scalars } = JSON.parse(module.packInfo(head)).pack;
  const canvas = document.querySelector("canvas");
  const viewer = await module.Viewer.create(canvas, head);
  viewer.setTargetPixels(error);
  const fail = (failure) => {
    throw failure;
  };
  const on = { frame: () => {}, first: () => {}, waits: () => {}, changed: fail, lost: () => {}, damaged: () => {}, broken: fail };
  const session = new Session({ canvas, viewer, pack, head, pool: new DecodePool(), attributes: { colors, scalars }, on });
  await session.firstPicture;
  const program = WebAssembly.compileStreaming(fetch("measure_bg.wasm"));
  const engine = await Engine.open({ pack, head, viewer: () => viewer, pages: () => session.pages, program });
  const settled = async () => {
    while (!(session.stats?.settled && !session.stats.more && !session.scheduled && session.answers.size === 0)) await new Promise(requestAnimationFrame);
  };
  globalThis.engineTest = { engine, viewer, session, settled };
}
