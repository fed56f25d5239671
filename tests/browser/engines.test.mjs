// The core of the page in Chromium, Firefox and WebKitGTK: loading, drawing, clipping, measuring, notes, a phone's screen and Arabic. What the latter
// two give is compared with what Chromium gave. All three draw with WebGL 2, which is what Firefox and WebKitGTK have.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import path from "node:path";
import { after, before } from "node:test";
import { ENGINES, Missing, until } from "./engines.mjs";
import { BARE, WWW, decoded, figuresOf, packFolder, serve, test } from "./harness.mjs";

/** The window, so wide that the panel stands beside the picture. */
const SIZE = [1000, 700];
/** About the narrowest window of WebKitGTK (447 pixels). */
const PHONE = [450, 722];
/** Coarse, because software draws; what is measured does not depend on it. */
const FORT = "/m/fort?gpu=webgl&error=4";
/** The points to measure between, in fractions of the picture's width and height. */
const PLACES = [
  [0.42, 0.5],
  [0.55, 0.5],
];

let server;
/** Each engine, while it starts and once it has. */
const engines = {};
/** What Chromium gave, by the name of the test: the others have to give the same. */
const reference = {};

before(async () => {
  server = await serve(await packFolder());
});
after(async () => {
  const started = await Promise.allSettled(Object.values(engines));
  const ended = await Promise.allSettled(started.map(({ value }) => value?.close()));
  await server?.stop();
  for (const { reason } of ended) if (reason) throw reason;
});

/**
 * A test in each engine. `run(session)` may return something, which has to be `same(theirs, chromiums)`; tests without a comparison are not run in
 * Chromium, where other files cover them.
 */
function inEach(name, options, run, same) {
  for (const [label, start] of Object.entries(ENGINES).filter(([label]) => same || label !== "Chromium")) {
    test(`${label}: ${name}`, async (t) => {
      engines[label] ??= start();
      const engine = await engines[label].catch((error) => error);
      if (engine instanceof Missing) {
        console.log(`skipped: ${label}: ${name}: ${engine.message}`);
        return t.skip(engine.message);
      }
      if (engine instanceof Error) throw engine;
      const session = await engine.open({ size: SIZE, ...options });
      const close = () => session.close().catch(() => {});
      t.signal.addEventListener("abort", close); // a test that takes too long
      try {
        const given = await run(session);
        if (label === "Chromium") reference[name] = given;
        else if (same) {
          assert.ok(name in reference, "there is nothing to compare with: the test in Chromium did not run to its end");
          same(given, reference[name]);
        }
        assert.deepEqual(await session.complaints(), []);
      } catch (error) {
        const late = new Promise((resolve) => setTimeout(resolve, 5000, "the page did not answer").unref());
        error.message += `\n${await Promise.race([stateOf(session), late]).catch((why) => `no state of the page: ${why}`)}`;
        throw error;
      } finally {
        await close();
      }
    });
  }
}

/** What helps to understand why a test failed: what the page complained of, where the focus is, and what is written on it. */
async function stateOf(session) {
  const complaints = await session.complaints();
  const page = await session.run(() => {
    const { outerHTML } = document.activeElement ?? document.body;
    return [`focus (${document.hasFocus()}): ${outerHTML.slice(0, 300)}`, document.body.innerText.replace(/\s+/g, " ").slice(0, 1500)];
  });
  return [`complaints: ${JSON.stringify(complaints)}`, ...page].join("\n");
}

const settled = (session) => until(session, () => Boolean(globalThis.kilwa?.api.stats()?.settled));

async function fort(session, language = "en") {
  await session.goto(`${server.url}${FORT}&lang=${language}`);
  await settled(session);
}

/** The place of an element in the window: left, top, width and height. */
const boxOf = (session, id = "canvas") =>
  session.run((id) => {
    const { x, y, width, height } = document.getElementById(id).getBoundingClientRect();
    return [x, y, width, height];
  }, id);

/** Pixels of the window of places in the picture, given as fractions of its width and height. */
async function spots(session, places) {
  const [left, top, width, height] = await boxOf(session);
  return places.map(([x, y]) => [Math.round(left + x * width), Math.round(top + y * height)]);
}

async function middleOf(session, id) {
  const [left, top, width, height] = await boxOf(session, id);
  return [left + width / 2, top + height / 2];
}

/** Figures of the picture, with nothing over it. */
async function picture(session) {
  await session.run((css) => {
    globalThis.bare = new CSSStyleSheet();
    globalThis.bare.replaceSync(css);
    document.adoptedStyleSheets.push(globalThis.bare);
  }, BARE);
  const shown = figuresOf(decoded(await session.screenshot(), await boxOf(session)));
  await session.run(() => globalThis.bare.replaceSync(""));
  assert.ok(shown.share > 0.1, `only ${shown.share} of the picture is model`);
  return shown;
}

/** The share of the picture that is model differs by less than 0.2 %. */
const sameShare = (given, wanted) =>
  assert.ok(Math.abs(given.share - wanted.share) < 0.002, `the model covers ${given.share} of the picture, in Chromium ${wanted.share}`);

/** Waits until the tool for measuring is in use: until its buttons are shown. */
const bar = (session) => until(session, () => document.getElementById("measure-bar").checkVisibility());

/** Chooses the tool for distances by the name of its button, and clicks two places. */
async function measure(session, name) {
  await session.clickOn("button", name);
  await bar(session);
  for (const spot of await spots(session, PLACES)) await session.click(...spot);
}

/** Waits until there is one measurement with a value, and returns it. */
async function measured(session) {
  const one = await until(session, async () => {
    const [one] = await globalThis.kilwa.api.measurements();
    return one && !["picking", "measuring"].includes(one.state) ? one : null;
  });
  assert.equal(one.state, "final", one.refusal);
  return one;
}

/** Equal to 0.1 µm: engines may round the last bits of a sine differently. */
function sameValue(given, wanted) {
  const numbers = ({ readings, points }) => [...readings.flatMap(({ value, uncertainty, resolution }) => [value, uncertainty, resolution]), ...points.flat()];
  const [have, want] = [numbers(given), numbers(wanted)];
  assert.deepEqual([given.name, have.length], [wanted.name, want.length]);
  assert.ok(want.length >= 9, "three lengths, and two places");
  for (const [k, value] of have.entries()) assert.ok(Math.abs(value - want[k]) <= 1e-7, `${value} is not Chromium's ${want[k]}`);
}

inEach(
  "loads and draws the model",
  {},
  async (session) => {
    await fort(session);
    const { targetReached, trianglesDrawn } = await session.run(() => globalThis.kilwa.api.stats());
    assert.ok(targetReached);
    return { trianglesDrawn, ...(await picture(session)) };
  },
  (given, wanted) => {
    assert.equal(given.trianglesDrawn, wanted.trianglesDrawn);
    sameShare(given, wanted);
  },
);

/** How many pixels of the view cube have the colour of the arrow to the north, seen from a place. */
async function arrow(session, azimuth, elevation) {
  await session.run((view) => globalThis.kilwa.api.setCamera({ ...globalThis.kilwa.api.getCamera(), ...view }), { azimuth, elevation });
  await settled(session);
  const { pixels } = decoded(await session.screenshot(), await boxOf(session, "cube"));
  let count = 0;
  for (let at = 0; at < pixels.length; at += 4) if (pixels[at] - pixels[at + 2] > 60) count += 1;
  return count;
}

inEach("the view cube hides the arrow behind it, and shows it before it", {}, async (session) => {
  await fort(session);
  const fromSouth = await arrow(session, Math.PI, 0.3);
  const fromNorth = await arrow(session, 0, 0.3);
  assert.ok(fromNorth > 15, `from the north ${fromNorth} pixels of the arrow are seen`);
  assert.equal(fromSouth, 0, "from the south the arrow is behind the cube");
});

inEach(
  "measures a distance with the pointer",
  {},
  async (session) => {
    await fort(session);
    await measure(session, "Measure");
    return measured(session);
  },
  sameValue,
);

inEach(
  "measures a distance by keyboard",
  {},
  async (session) => {
    await fort(session);
    await session.run(() => document.getElementById("canvas").focus());
    await session.press("m");
    await bar(session);
    // The first Space brings the crosshair, the others take the places.
    await session.press("Space", "Shift+ArrowLeft", "Space", "Shift+ArrowRight", "Shift+ArrowRight", "ArrowDown", "Space");
    return measured(session);
  },
  sameValue,
);

/** The highest place that is picked, on a grid over the picture. */
const highest = (session) =>
  session.run(() => {
    const { width, height } = document.getElementById("canvas").getBoundingClientRect();
    let highest = -Infinity;
    for (let x = 0; x < width; x += 16) {
      for (let y = 0; y < height; y += 16) highest = Math.max(highest, globalThis.kilwa.api.pick(x, y)?.place[2] ?? -Infinity);
    }
    return highest;
  });

inEach(
  "clips the model with a plane, and does not pick what is removed",
  {},
  async (session) => {
    await fort(session);
    assert.ok((await highest(session)) > 2);
    const whole = await picture(session);
    await session.clickOn("tab", "Clipping");
    await until(session, () => {
      const [first] = document.querySelectorAll("#section input[type=checkbox]");
      first?.click();
      return Boolean(first);
    });
    await session.click(...(await middleOf(session, "clip-position")));
    await session.press("Control+a");
    await session.type("1.5");
    await until(session, () => globalThis.kilwa.api.state().display?.clipPlane?.point[2] === 1.5);
    await settled(session);
    const top = await highest(session);
    assert.ok(top <= 1.5 + 1e-6 && top > 0, `picked up to ${top}`);
    const clipped = await picture(session);
    assert.ok(clipped.share < whole.share, "the walls no longer cover what is behind them");
    return clipped;
  },
  sameShare,
);

inEach(
  "draws a section in its row, and shows the coordinates of its first place",
  {},
  async (session) => {
    await fort(session);
    await session.run(async () => {
      const { bounds_min: low, bounds_max: high } = globalThis.kilwa.api.info().metadata;
      const at = (share) => low.map((v, i) => v + (high[i] - v) * (i === 1 ? 0.5 : share));
      await globalThis.kilwa.api.addMeasurement({ tool: "section-upright", points: [at(0.3), at(0.6)] });
    });
    await session.clickOn("tab", "Measure");
    // Pixels that are much darker than the ground: its lines.
    await until(session, () => {
      const canvas = document.querySelector("kilwa-plot canvas");
      if (!canvas?.checkVisibility() || canvas.width < 100) return 0;
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      const pixels = data.filter((value, k) => k % 4 === 0 && value < 90 && data[k + 3] > 200).length;
      return pixels > 100;
    });
    await until(session, () => {
      const canvas = document.querySelector("kilwa-plot canvas");
      canvas.focus();
      return document.activeElement === canvas;
    });
    await session.press("ArrowRight");
    return until(
      session,
      () =>
        document
          .querySelector("kilwa-plot canvas")
          .getAttribute("aria-valuetext")
          .match(/line 1 of \d+, distance .* m$/)?.[0],
    );
  },
  (given, wanted) => assert.equal(given, wanted),
);

inEach("keeps a note over a reload, and draws its pin", {}, async (session) => {
  await fort(session);
  await session.clickOn("button", "Write a note on the model");
  const [[x, y]] = await spots(session, [[0.5, 0.5]]);
  await session.click(x, y);
  await until(session, () => document.activeElement?.matches("input, textarea"));
  await session.type("The gate");
  await session.press("Escape");
  await fort(session);
  await until(session, () => {
    const pins = [...document.querySelectorAll("#pins .pin")].filter((pin) => pin.checkVisibility());
    return pins.length === 1 && pins[0].getAttribute("aria-label").includes("The gate");
  });
});

inEach("turns the model when it is dragged", {}, async (session) => {
  await fort(session);
  const azimuth = () => session.run(() => globalThis.kilwa.api.getCamera().azimuth);
  const was = await azimuth();
  const [from, to] = await spots(session, [
    [0.5, 0.5],
    [0.6, 0.55],
  ]);
  await session.drag(from, to);
  await settled(session);
  assert.ok(Math.abs((await azimuth()) - was) > 0.1);
});

inEach("phone: no sideways scrolling, and buttons large enough for a finger", { size: PHONE }, async (session) => {
  await fort(session);
  const { across, sizes } = await session.run(() => {
    scrollTo(50, 0);
    const buttons = [...document.querySelectorAll("[role=toolbar] button")].filter((e) => e.checkVisibility());
    const sizes = buttons.map((e) => Math.min(e.getBoundingClientRect().width, e.getBoundingClientRect().height));
    return { across: scrollX, sizes };
  });
  assert.equal(across, 0);
  assert.ok(sizes.length > 4 && Math.min(...sizes) >= 44, `buttons of ${sizes} pixels`);
});

inEach("Arabic: from right to left, and measures", {}, async (session) => {
  await fort(session, "ar");
  const arabic = JSON.parse(await readFile(path.join(WWW, "i18n/ar.json"), "utf8"));
  assert.equal(await session.run(() => document.documentElement.dir), "rtl");
  await measure(session, arabic.toolMeasure);
  await measured(session);
});
