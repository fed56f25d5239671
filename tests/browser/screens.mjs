// The pictures of the viewer in docs/screens: every shading, panel, dialog and trouble, at both sizes, in both themes, and in Arabic what has words.
//
//   node screens.mjs [--to FOLDER] [--missing] [NAME…]     names are the beginnings of files: `mode-`, `note`, `help-phone`
//
// A person looks at them before a change of the page is done; no test compares them. Environment: that of harness.mjs; without KILWA_PACK a fort of a
// million triangles is made.

import { execFile } from "node:child_process";
import { existsSync } from "node:fs";
import { mkdir, mkdtemp, rm } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { promisify } from "node:util";
import { KILWA, ROOT, WWW, hostile, launch, measuredPack, packFolder, serve, waitFor } from "./harness.mjs";

const run = promisify(execFile);
const SIZES = { desktop: [1440, 900], phone: [390, 844] };
const MODES = ["colour", "clay", "headlight", "raking", "curvature", "eye-dome", "normals", "height", "distance", "level", "error"];
/** Scenes that write other files than one of their name. */
const FILES = {
  mode: MODES.map((mode) => `mode-${mode}`),
  notes: ["notes", "note", "note-form"],
  section: ["section-plane", "section-box"],
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

/** One page in one variant; `shoot(name)` writes what it shows. */
class Shot {
  constructor(page, { size, end, lang }) {
    Object.assign(this, { page, end, lang, isPhone: size === "phone" });
  }

  async rest() {
    await this.page.waitForTimeout(80);
    await waitFor(this.page, "settled");
  }

  async shoot(name) {
    if (!isWanted(`${name}-${this.end}`)) return;
    await this.page.screenshot({ path: path.join(to, `${name}-${this.end}.jpg`), type: "jpeg", quality: 85 }); // 17 MB in all; as PNG 50
    process.stdout.write(`${name}-${this.end}\n`);
  }

  async tab(name) {
    await this.page.locator(`#tab-${name}`).click();
    await this.rest();
  }

  /** Presses at shares of the canvas. */
  async press(...places) {
    const box = await this.page.locator("#canvas").boundingBox();
    for (const [x, y] of places) await this.page.mouse.click(box.x + box.width * x, box.y + box.height * y);
  }

  /** A measurement at places below shares of the canvas; none where one of them is beside the model. */
  measured(tool, ...shares) {
    return this.page.evaluate(
      async ({ tool, shares }) => {
        const { api, session } = globalThis.kilwa;
        const [w, h] = [session.canvas.width / session.ratio, session.canvas.height / session.ratio];
        const rays = shares.map(([x, y]) => api.pick(w * x, h * y)?.ray);
        if (rays.every(Boolean)) await api.addMeasurement({ tool, rays });
      },
      { tool, shares },
    );
  }

  /** Places on the surface below shares of the canvas. */
  places(shares) {
    return this.page.evaluate((shares) => {
      const { viewer, session } = globalThis.kilwa;
      const { width, height } = session.canvas;
      return shares.map(([x, y]) => [...viewer.pick(x * width, y * height)].slice(0, 3));
    }, shares);
  }
}

// What is shown. Each starts with a fresh page of the fort, at rest.

const scenes = {
  async viewer(shot) {
    await shot.shoot("viewer");
  },

  async mode(shot) {
    if (shot.lang) return;
    await shot.tab("display");
    for (const mode of MODES) {
      await shot.page.locator(`input[name=mode][value=${mode}]`).check();
      await shot.rest();
      await shot.shoot(`mode-${mode}`);
    }
  },

  async info(shot) {
    await shot.tab("info");
    await shot.page.waitForFunction(() => /\d/.test(document.getElementById("stats").textContent));
    await shot.shoot("info");
  },

  async display(shot) {
    await shot.tab("display");
    await shot.shoot("display");
  },

  async views(shot) {
    const { page } = shot;
    await shot.tab("saved");
    for (const key of ["6", "1"]) {
      await page.locator("#canvas").focus();
      await page.keyboard.press(key);
      await shot.rest();
      await page.evaluate(() => globalThis.kilwa.saved.add());
    }
    await page.locator("#canvas").focus();
    await page.keyboard.press("6");
    await shot.rest();
    await shot.shoot("views");
  },

  async notes(shot) {
    const { page } = shot;
    const places = await shot.places(NOTES.map(([, share]) => share));
    await page.evaluate(
      (notes) => {
        for (const note of notes) globalThis.kilwa.api.addAnnotation(note);
      },
      NOTES.map(([title, , text, link], i) => ({ title, text, link, place: places[i] })),
    );
    await shot.tab("notes");
    await shot.shoot("notes");
    await page.locator("#tour-start").click();
    await shot.rest();
    await shot.shoot("note");
    await page.locator("#note-edit").click();
    await shot.rest();
    await shot.shoot("note-form");
  },

  async placing(shot) {
    await shot.tab("notes");
    await shot.page.locator("#note-new").click();
    await shot.rest();
    await shot.shoot("placing");
  },

  async help(shot) {
    await shot.page.locator("#help-open").click();
    await shot.shoot("help");
  },

  async picture(shot) {
    await shot.page.locator("#picture-open").click();
    await shot.page.locator("#picture").waitFor();
    await shot.shoot("picture");
  },

  async section(shot) {
    const { page } = shot;
    await shot.tab("section");
    await page.locator("#clip-plane").check();
    await page.locator("#clip-axis").selectOption("north");
    await shot.rest();
    await shot.shoot("section-plane");
    await page.locator("#clip-plane").uncheck();
    await page.locator("#clip-box").check();
    for (const [id, value] of [
      ["center-x", -8],
      ["center-y", -6],
      ["center-z", 3],
      ["size-x", 24],
      ["size-y", 20],
      ["size-z", 12],
    ])
      await page.locator(`#box-${id}`).fill(String(value));
    await page.locator("#box-turn").fill("20");
    await shot.rest();
    await shot.shoot("section-box");
  },

  async walk(shot) {
    await shot.page.evaluate(() => globalThis.kilwa.tool("walk"));
    await shot.page.locator("#walk-pad").waitFor();
    await shot.rest();
    await shot.shoot("walk");
  },

  async measure(shot) {
    const { page } = shot;
    const done = (count) =>
      page.waitForFunction(
        (count) => {
          const items = globalThis.kilwa.measuring.tools?.items;
          return items?.length === count && items.every(({ task }) => !["picking", "measuring"].includes(task.state));
        },
        count,
        { polling: 50 },
      );
    const use = async (name) => {
      await shot.tab("measure");
      await page.locator(".more-tools").waitFor();
      await page.evaluate((name) => document.querySelector(`.more-tools [data-tool="${name}"]`).click(), name);
      await page.locator("#measure-bar").waitFor();
      await page.waitForTimeout(400); // the sheet of a phone goes down
      await shot.rest();
    };
    await shot.tab("measure");
    await page.locator(".more-tools").waitFor();
    await shot.shoot("measure");
    await use("distance");
    await shot.press([0.42, 0.5]);
    await page.mouse.move(10, 300);
    await shot.rest();
    await shot.shoot("measure-picking");
    await shot.press([0.55, 0.5]);
    await done(1);
    await page.keyboard.press("Escape");
    await shot.rest();
    await shot.shoot("measure-distance");
    await shot.measured("area", [0.45, 0.48], [0.5, 0.48], [0.5, 0.51], [0.45, 0.51]);
    await shot.measured("section-upright", [0.38, 0.52], [0.62, 0.52]);
    await shot.tab("measure");
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

  async hidden(shot) {
    await shot.page.keyboard.press("h");
    await shot.rest();
    await shot.shoot("hidden");
  },
};

/** Pages that are not a fort at rest: address below the server, what to wait for, and what is done before it is opened. */
const others = {
  list: { address: "/", wait: ".card" },
  welcome: { address: "/static/", before: staticHost, wait: "#welcome:not([hidden])" },
  "mode-scalar": { address: "/m/measured?error=2", settled: true, act: scalar },
  embed: { address: "/m/fort?embed=1&error=2", settled: true, frame: { desktop: [800, 500], phone: [360, 480] } },
  "trouble-missing": { address: "/m/fort", mishap: () => ({ status: 404 }), wait: "#trouble:not([hidden])" },
  "trouble-damaged": { address: "/m/fort", mishap: () => ({ body: () => Buffer.alloc(65536, 65) }), wait: "#trouble:not([hidden])" },
  "trouble-gpu": { address: "/m/fort", before: (page) => page.addInitScript(noGpu), wait: "#trouble:not([hidden])" },
  loading: { address: "/m/fort", mishap: () => ({ status: 503 }), wait: "#loading:not([hidden])", act: (page) => page.waitForTimeout(1500) },
};

async function scalar(page) {
  await page.locator("#tab-display").click();
  await page.locator("input[name=mode][value=scalar]").check();
  await page.waitForTimeout(80);
  await waitFor(page, "settled");
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
  return { shot: new Shot(page, variant), close: () => context.close() };
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
    if (other.wait) await shot.page.locator(other.wait).first().waitFor();
    await other.act?.(shot.page);
    await shot.page.waitForTimeout(400); // icons
    await shot.shoot(name);
    await close();
  }
}
await browser.close();
await proxy.stop();
await server.stop();
