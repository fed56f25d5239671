// The pictures of the viewer in docs/screens: every shading, panel, dialog and trouble, at both sizes, in both themes, and in Arabic what has words.
//
//   node screens.mjs [--to FOLDER] [--missing] [NAME…]     names are the beginnings of files: `mode-`, `note`, `help-phone`
//
// A person looks at them before a change of the page is done; no test compares them. Environment: that of harness.mjs; without KILWA_PACK a fort of a
// million triangles is made.

import { execFile } from "node:child_process";
import { existsSync } from "node:fs";
import { mkdir, mkdtemp, readFile, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { promisify } from "node:util";
import { SHADINGS } from "../../www/shadings.js";
import { KILWA, ROOT, WWW, canvasOf, hostile, launch, measuredPack, packFolder, pick, press, serve, waitFor } from "./harness.mjs";

const run = promisify(execFile);
const SIZES = { desktop: [1440, 900], phone: [390, 844] };
/** All shadings except that of scalars, which the fort does not have. */
const MODES = Object.entries(SHADINGS).filter(([mode]) => mode !== "scalar");
/** Scenes that write other files than one of their name. */
const FILES = {
  mode: MODES.map(([mode]) => `mode-${mode}`),
  notes: ["notes", "note", "note-form"],
  section: ["section-plane", "section-box"],
  plot: ["plot", "plot-large"],
  measure: ["measure", "measure-picking", "measure-distance", "measure-table"],
};
const NOTES = [
  [
    "The gate",
    [0.6, 0.5],
    "The seaward gate of the fort, its frame carved in coral. The door was of teak and stood until the 1970s.",
    "https://whc.unesco.org/en/list/144",
  ],
  ["North-east tower", [0.35, 0.45], "Rebuilt in 1807 on the foot of the older tower.", ""],
  ["Court", [0.5, 0.45], "", ""],
];

const { to, isMissing, wanted } = options(process.argv.slice(2));

function options(args) {
  const at = args.indexOf("--to");
  const [, folder] = at < 0 ? [] : args.splice(at, 2);
  const names = args.filter((name) => name !== "--missing");
  return { to: path.resolve(folder ?? path.join(ROOT, "docs/screens")), isMissing: names.length < args.length, wanted: names };
}

const isWanted = (name) => (wanted.length === 0 || wanted.some((start) => name.startsWith(start))) && !(isMissing && existsSync(path.join(to, `${name}.jpg`)));

/** How the page is opened: its size, theme and language. */
function variants() {
  const found = [];
  for (const size of Object.keys(SIZES)) {
    for (const theme of ["light", "dark"]) found.push({ size, theme, end: `${size}-${theme}` });
    found.push({ size, theme: "light", lang: "ar", end: `${size}-arabic` });
  }
  return found;
}

/** The page's messages in a language. */
const messages = async (lang) => JSON.parse(await readFile(path.join(WWW, `i18n/${lang}.json`), "utf8"));

/** One page in one variant; `shoot(name)` writes what it shows. Elements are named by the keys of their messages (i18n/en/page.ftl). */
class Shot {
  constructor(page, { end, lang }, words) {
    Object.assign(this, { page, end, lang, words });
  }

  rest() {
    return waitFor(this.page, "settled");
  }

  async shoot(name) {
    if (!isWanted(`${name}-${this.end}`)) return;
    await this.page.screenshot({ path: path.join(to, `${name}-${this.end}.jpg`), type: "jpeg", quality: 85 }); // 17 MB in all; as PNG 50
    process.stdout.write(`${name}-${this.end}\n`);
  }

  /** An element by its role and the key of its name. */
  by(role, key) {
    return this.page.getByRole(role, { name: this.words[key], exact: true });
  }

  async tab(key) {
    await this.by("tab", key).click();
    await this.rest();
  }

  /** Press a key while the picture has the focus. */
  async key(name) {
    await canvasOf(this.page).press(name);
    await this.rest();
  }

  /** A measurement at places below shares of the canvas; none where one of them is beside the model. */
  async measured(tool, ...shares) {
    const hits = [];
    for (const [x, y] of shares) hits.push(await pick(this.page, x, y));
    if (!hits.every(Boolean)) return;
    const rays = hits.map(({ ray }) => ray);
    await this.page.evaluate((measurement) => globalThis.kilwa.api.addMeasurement(measurement), { tool, rays });
  }
}

// What is shown. Each starts with a fresh page of the fort, at rest.

const scenes = {
  async viewer(shot) {
    await shot.shoot("viewer");
  },

  async mode(shot) {
    if (shot.lang) return;
    await shot.tab("tabDisplay");
    for (const [mode, key] of MODES) {
      await shot.by("radio", key).check();
      await shot.rest();
      await shot.shoot(`mode-${mode}`);
    }
  },

  async info(shot) {
    await shot.tab("tabInfo");
    await shot
      .by("tabpanel", "tabInfo")
      .getByRole("definition")
      .filter({ hasText: /[\d٠-٩]/ })
      .first()
      .waitFor();
    await shot.shoot("info");
  },

  async display(shot) {
    await shot.tab("tabDisplay");
    await shot.shoot("display");
  },

  async views(shot) {
    await shot.tab("tabViews");
    for (const view of ["6", "1"]) {
      await shot.key(view);
      await shot.by("button", "viewSave").click();
      await shot.page.keyboard.press("Enter"); // keeps the name that is suggested
      await shot.page.mouse.move(0, 0); // A row is there now.
    }
    await shot.key("6");
    await shot.shoot("views");
  },

  async notes(shot) {
    const { page } = shot;
    for (const [title, share, text, link] of NOTES) {
      const { place } = await pick(page, ...share);
      await page.evaluate((note) => globalThis.kilwa.api.addAnnotation(note), { title, text, link, place });
    }
    await shot.tab("tabNotes");
    await shot.shoot("notes");
    await shot.by("button", "tourStart").click();
    await shot.rest();
    await shot.shoot("note");
    await shot.by("button", "noteEdit").click();
    await shot.rest();
    await shot.shoot("note-form");
  },

  async placing(shot) {
    await shot.tab("tabNotes");
    await shot.by("button", "noteNew").click();
    await shot.rest();
    await shot.shoot("placing");
  },

  async help(shot) {
    await shot.by("button", "help").click();
    await shot.shoot("help");
  },

  async picture(shot) {
    await shot.by("button", "picture").click();
    await shot.by("dialog", "picture").waitFor();
    await shot.shoot("picture");
  },

  async section(shot) {
    await shot.tab("tabSection");
    const [plane, box] = ["clipPlane", "clipBox"].map((key) => shot.by("group", key).getByRole("checkbox", { name: shot.words.clipOn }));
    await plane.check();
    await shot.by("combobox", "clipAxis").selectOption(shot.words.planeNorth);
    await shot.rest();
    await shot.shoot("section-plane");
    await plane.uncheck();
    await box.check();
    for (const [key, value] of [
      ["boxCenterX", -8],
      ["boxCenterY", -6],
      ["boxCenterZ", 3],
      ["boxSizeX", 24],
      ["boxSizeY", 20],
      ["boxSizeZ", 12],
      ["boxTurn", 20],
    ])
      await shot.by("spinbutton", key).fill(String(value));
    await shot.rest();
    await shot.shoot("section-box");
  },

  async walk(shot) {
    await shot.by("button", "toolWalk").click();
    await shot.by("group", "walk").waitFor();
    await shot.rest();
    await shot.shoot("walk");
  },

  async measure(shot) {
    const { page } = shot;
    await shot.tab("tabMeasure");
    await shot.by("button", "mDistance").first().waitFor();
    await shot.shoot("measure");
    await shot.by("button", "mDistance").first().click();
    const bar = shot.by("toolbar", "measurements");
    await bar.waitFor();
    // The sheet of a phone goes down.
    await page.waitForFunction(() => document.getAnimations().every(({ playState }) => playState === "finished"));
    await shot.rest();
    await press(page, 0.42, 0.5);
    await page.mouse.move(10, 300);
    await shot.rest();
    await shot.shoot("measure-picking");
    await press(page, 0.55, 0.5);
    await page.waitForFunction(async () => (await globalThis.kilwa.api.measurements()).some(({ state }) => !["picking", "measuring"].includes(state)));
    await page.keyboard.press("Escape");
    await shot.rest();
    await shot.shoot("measure-distance");
    await shot.measured("area", [0.45, 0.48], [0.5, 0.48], [0.5, 0.51], [0.45, 0.51]);
    await shot.measured("section-upright", [0.38, 0.52], [0.62, 0.52]);
    await shot.tab("tabMeasure");
    await shot.shoot("measure-table");
  },

  async "measure-labels"(shot) {
    for (let i = 0; i < 12; i += 1) {
      const at = (x, y) => [0.3 + (x % 12) * 0.035, 0.42 + (y % 12) * 0.012];
      const places = [at(i * 7, i * 5), at(i * 5 + 3, i * 7 + 2)];
      if (i % 3 === 2) await shot.measured("coordinate", places[0]);
      else await shot.measured("distance", ...places);
    }
    await shot.rest();
    await shot.shoot("measure-labels");
  },

  async plot(shot) {
    const { page } = shot;
    await shot.measured("section-upright", [0.38, 0.52], [0.62, 0.52]);
    await shot.tab("tabMeasure");
    const opener = page.getByRole("rowheader").getByRole("button").first();
    if ((await opener.getAttribute("aria-expanded")) !== "true") await opener.click();
    const drawing = page.getByRole("slider", { name: shot.words.plotName.split("{")[0].trim() });
    await drawing.waitFor();
    await shot.rest();
    const { width, height } = await drawing.boundingBox();
    await drawing.hover({ position: { x: width * 0.4, y: height * 0.5 } });
    await shot.shoot("plot");
    await page.getByRole("button", { name: shot.words.plotLarge }).click();
    await page.keyboard.press("ArrowRight");
    await page.keyboard.press("+");
    await shot.shoot("plot-large");
  },

  async hidden(shot) {
    await shot.page.keyboard.press("h");
    await shot.rest();
    await shot.shoot("hidden");
  },
};

/** The message in place of the model. */
const trouble = (shot) => shot.page.getByRole("alert").getByRole("heading");

/** Pages that are not a fort at rest: address below the server, what to wait for, and what is done before it is opened. */
const others = {
  list: { address: "/", wait: (shot) => shot.page.getByRole("listitem") },
  welcome: { address: "/static/", before: staticHost, wait: (shot) => shot.by("heading", "openTitle") },
  "mode-scalar": { address: "/m/measured?error=2", settled: true, act: scalar },
  embed: { address: "/m/fort?embed=1&error=2", settled: true, frame: { desktop: [800, 500], phone: [360, 480] } },
  "trouble-missing": { address: "/m/fort", mishap: () => ({ status: 404 }), wait: trouble },
  "trouble-damaged": { address: "/m/fort", mishap: () => ({ body: () => Buffer.alloc(65536, 65) }), wait: trouble },
  "trouble-gpu": { address: "/m/fort", before: (page) => page.addInitScript(noGpu), wait: trouble },
  loading: { address: "/m/fort", mishap: () => ({ status: 500 }), wait: (shot) => shot.page.getByText(shot.words.offlineFirst.split("{")[0]) },
};

async function scalar(shot) {
  await shot.tab("tabDisplay");
  await shot.by("radio", "modeScalar").check();
  await shot.rest();
}

/** The page alone, as a host has it that has no list of models. */
function staticHost(page) {
  return page.route("**/static/**", (route) => {
    const { pathname } = new URL(route.request().url());
    return route.fulfill({ path: path.join(WWW, path.normalize(pathname.replace("/static/", "/")).replace(/\/$/, "/index.html")) });
  });
}

/** Runs in the page. */
function noGpu() {
  Object.defineProperty(navigator, "gpu", { value: undefined });
  const { getContext } = HTMLCanvasElement.prototype;
  HTMLCanvasElement.prototype.getContext = function get(kind, ...rest) {
    return /webg/.test(kind) ? null : getContext.call(this, kind, ...rest);
  };
}

/** A folder with the fort and a scan that has confidence. */
async function packs() {
  const scratch = await mkdtemp(path.join(tmpdir(), "kilwa-screens-"));
  if (!process.env.KILWA_PACK) {
    const mesh = path.join(scratch, "fort.ply");
    await run(KILWA, ["synth", "fort", "--triangles", "1000000", "-o", mesh]);
    process.env.KILWA_PACK = path.join(scratch, "fort.kilwa");
    await run(KILWA, ["build", mesh, "-o", process.env.KILWA_PACK]);
  }
  const folder = await packFolder();
  await measuredPack(folder);
  await rm(scratch, { recursive: true });
  return folder;
}

async function opened(browser, url, variant, { frame, before } = {}) {
  const [width, height] = frame?.[variant.size] ?? SIZES[variant.size];
  const context = await browser.newContext({
    viewport: { width, height },
    colorScheme: variant.theme,
    reducedMotion: "reduce",
    hasTouch: variant.size === "phone",
    locale: variant.lang ?? "en",
  });
  const page = await context.newPage();
  page.setDefaultTimeout(240_000);
  await before?.(page);
  await page.goto(variant.lang ? `${url}${url.includes("?") ? "&" : "?"}lang=${variant.lang}` : url);
  return { shot: new Shot(page, variant, await messages(variant.lang ?? "en")), close: () => context.close() };
}

/** Whether any file of a scene is asked for. */
const isNeeded = (scene, end) => (FILES[scene] ?? [scene]).some((name) => isWanted(`${name}-${end}`));

await mkdir(to, { recursive: true });
const server = await serve(await packs());
const proxy = await hostile(server.url);
const browser = await launch();
for (const variant of variants()) {
  for (const [name, scene] of Object.entries(scenes)) {
    if (!isNeeded(name, variant.end)) continue;
    const { shot, close } = await opened(browser, `${server.url}/m/fort?error=2`, variant);
    await waitFor(shot.page, "settled");
    await scene(shot).catch((error) => {
      process.exitCode = 1;
      process.stderr.write(`${name}-${variant.end}: ${error.message}\n`);
    });
    await close();
  }
  for (const [name, other] of Object.entries(others)) {
    if (!isWanted(`${name}-${variant.end}`)) continue;
    proxy.mishap = other.mishap ?? null;
    const { shot, close } = await opened(browser, (other.mishap ? proxy.url : server.url) + other.address, variant, other);
    if (other.settled) await waitFor(shot.page, "settled");
    await other.wait?.(shot).first().waitFor();
    await other.act?.(shot);
    await shot.page.waitForLoadState("networkidle"); // icons
    await shot.shoot(name);
    await close();
  }
}
await browser.close();
await proxy.stop();
await server.stop();
