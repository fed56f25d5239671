// A session in one of three browsers, with the little that tests of the engines need. Chromium and Firefox are driven with Playwright (Firefox as
// Debian ships it, by WebDriver BiDi), WebKitGTK with its own WebDriver; Firefox and WebKitGTK run on virtual displays.
//
// Environment: FIREFOX, WEBKIT_DRIVER and XVFB name other programs than those on PATH.

import { spawn } from "node:child_process";
import { mkdir, mkdtemp, rm, stat, writeFile } from "node:fs/promises";
import { createServer } from "node:net";
import { tmpdir } from "node:os";
import path from "node:path";
import { firefox } from "playwright-core";
import { Builder, By, Capabilities, Key, Origin, error as refused } from "selenium-webdriver";
import { launch, open, SHARP } from "./harness.mjs";

/** Longest wait for a state, in milliseconds; software rendering is slow on a busy machine. */
const LATE = Number(process.env.KILWA_TIMEOUT) || 120_000;

/**
 * @typedef {object} Session
 * @property {(url: string) => Promise<void>} goto
 * @property {(code: Function, argument?: unknown) => Promise<any>} run Runs a function in the page and returns what it resolves to.
 * @property {(role: "button" | "tab", name: string) => Promise<void>} clickOn
 * @property {(x: number, y: number) => Promise<void>} click In pixels of the window, as `drag`.
 * @property {(from: number[], to: number[]) => Promise<void>} drag
 * @property {(...keys: string[]) => Promise<void>} press Keys as Playwright names them, such as "Control+z".
 * @property {(text: string) => Promise<void>} type
 * @property {() => Promise<Buffer>} screenshot The window as a PNG.
 * @property {() => Promise<string[]>} complaints Errors that the page has reported.
 * @property {() => Promise<void>} close
 */

/** A program that is not installed: its tests are skipped. */
export class Missing extends Error {}

/** A program: the one that a variable names, or the one with this name on PATH. */
async function program(variable, name) {
  const isFile = async (file) => Boolean((await stat(file).catch(() => null))?.isFile());
  const chosen = process.env[variable];
  if (chosen) {
    if (await isFile(chosen)) return chosen;
    throw new Error(`${variable}=${chosen} is not a file`);
  }
  for (const folder of (process.env.PATH ?? "").split(path.delimiter)) {
    if (await isFile(path.join(folder, name))) return path.join(folder, name);
  }
  throw new Missing(`${name} is not installed`);
}

/** Calls `get` until it returns something true, and returns that. */
async function poll(get, what) {
  for (const end = Date.now() + LATE; Date.now() < end; await new Promise((resolve) => setTimeout(resolve, 20))) {
    const found = await get();
    if (found) return found;
  }
  throw new Error(`waited ${LATE / 1000} s for ${what}`);
}

/** Waits until a function in the page returns something true, and returns that. */
export const until = (session, code, argument) => poll(() => session.run(code, argument), String(code));

/** A session over a page of Playwright; `ignore` recognises errors that the tests themselves cause. */
function pageSession({ page, complaints, close }, ignore = () => false) {
  return {
    goto: async (url) => void (await page.goto(url)),
    run: (code, argument) => page.evaluate(code, argument),
    clickOn: (role, name) => page.getByRole(role, { name, exact: true }).click(),
    click: (x, y) => page.mouse.click(x, y),
    drag: async (from, to) => {
      await page.mouse.move(...from);
      await page.mouse.down();
      await page.mouse.move(...to, { steps: 4 });
      await page.mouse.up();
    },
    press: async (...keys) => {
      for (const key of keys) await page.keyboard.press(key);
    },
    type: (text) => page.keyboard.type(text),
    screenshot: () => page.screenshot({ caret: "initial" }),
    complaints: async () => complaints.filter((text) => !ignore(text)),
    close,
  };
}

async function startChromium() {
  const browser = await launch();
  return {
    // As the other browsers show it: their pictures are compared.
    open: async (options) => pageSession(await open(browser, "about:blank", { ...SHARP, ...options, wait: null })),
    close: () => browser.close(),
  };
}

async function startFirefox() {
  const executablePath = await program("FIREFOX", "firefox-esr");
  // Even headless, Firefox needs an X display for WebGL.
  const display = await virtualDisplay();
  // Screenshots add a <style> in Firefox, which the page's security policy forbids.
  const isOfScreenshot = (text) => /^Content-Security-Policy: .*blocked an inline style/.test(text);
  try {
    const browser = await firefox.launch({
      channel: "moz-firefox",
      executablePath,
      env: { ...process.env, ...ENVIRONMENT, DISPLAY: display.name },
      // BiDi cannot set the colour scheme and reduced motion in this version, so preferences do.
      firefoxUserPrefs: { "webgl.force-enabled": true, "ui.prefersReducedMotion": 1, "layout.css.prefers-color-scheme.content-override": 1 },
    });
    const settings = { wait: null, reducedMotion: null, colorScheme: null };
    return {
      open: async (options) => pageSession(await open(browser, "about:blank", { ...SHARP, ...options, ...settings }), isOfScreenshot),
      close: async () => {
        await browser.close();
        await display.stop();
      },
    };
  } catch (error) {
    await display.stop();
    throw error;
  }
}

/** What would otherwise differ from one developer's desktop to another's: display, language, theme, scale. */
const ENVIRONMENT = {
  WAYLAND_DISPLAY: "",
  GDK_BACKEND: "x11",
  MOZ_ENABLE_WAYLAND: "0",
  LC_ALL: "C.UTF-8",
  LANGUAGE: "en",
  GTK_THEME: "Adwaita",
  GDK_SCALE: "1",
};

/** A virtual display: its `name`, and `stop()`. */
async function virtualDisplay() {
  const xvfb = await program("XVFB", "Xvfb");
  const options = ["-displayfd", "1", "-screen", "0", "1400x1100x24", "-nolisten", "tcp", "-noreset"];
  const child = spawn(xvfb, options, { stdio: ["ignore", "pipe", "ignore"] });
  const number = await new Promise((resolve, reject) => {
    let output = "";
    child.stdout.on("data", (text) => {
      output += text;
      if (output.endsWith("\n")) resolve(output.trim());
    });
    child.once("error", reject);
    child.once("exit", (code) => reject(new Error(`${xvfb} ended with ${code}`)));
  });
  return { name: `:${number}`, stop: () => stop(child) };
}

/** Ends a program, and waits until it has ended. */
async function stop(child) {
  if (child.exitCode !== null || child.signalCode !== null) return;
  const exit = new Promise((resolve) => child.once("exit", resolve));
  child.kill("SIGTERM");
  const late = setTimeout(() => child.kill("SIGKILL"), 10_000);
  await exit;
  clearTimeout(late);
}

/** A port of this computer that nothing listens on now. */
async function freePort() {
  const server = createServer();
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  const { port } = server.address();
  await new Promise((resolve) => server.close(resolve));
  return port;
}

/** WebKitGTK's driver: its `url` and its process. Another program may take a free port first, so several are tried. */
async function webkitDriver(env) {
  const driver = await program("WEBKIT_DRIVER", "WebKitWebDriver");
  for (let tries = 1; ; tries += 1) {
    const port = await freePort();
    const child = spawn(driver, [`--port=${port}`, "--replace-on-new-session"], { stdio: "ignore", env });
    const gone = new Promise((_, reject) => {
      child.once("error", reject);
      child.once("exit", (code) => reject(new Error(`${driver} ended with ${code}`)));
    });
    gone.catch(() => {});
    const url = `http://127.0.0.1:${port}`;
    const answers = () =>
      fetch(`${url}/status`, { signal: AbortSignal.timeout(1000) }).then(
        (response) => response.ok,
        () => false,
      );
    try {
      await Promise.race([gone, poll(answers, driver)]);
      return { url, child };
    } catch (error) {
      await stop(child);
      if (tries === 5) throw error;
    }
  }
}

async function startWebkit() {
  const display = await virtualDisplay();
  const home = await mkdtemp(path.join(tmpdir(), "kilwa-webkit-"));
  // Its processes end a little later than the driver.
  const clear = () => rm(home, { recursive: true, force: true, maxRetries: 50, retryDelay: 100 });
  try {
    // Pages read reduced motion from this GTK setting.
    await mkdir(path.join(home, "gtk-3.0"));
    await writeFile(path.join(home, "gtk-3.0/settings.ini"), "[Settings]\ngtk-enable-animations=0\n");
    const folders = { XDG_CONFIG_HOME: home, XDG_DATA_HOME: home, XDG_CACHE_HOME: home };
    const driver = await webkitDriver({ ...process.env, ...ENVIRONMENT, ...folders, DISPLAY: display.name });
    return {
      open: (options) => webkitSession(driver.url, options),
      close: async () => {
        await stop(driver.child);
        await display.stop();
        await clear();
      },
    };
  } catch (error) {
    await display.stop();
    await clear();
    throw error;
  }
}

/** Keys by Playwright's names, as WebDriver has them. */
const KEYS = {
  Control: Key.CONTROL,
  Shift: Key.SHIFT,
  Escape: Key.ESCAPE,
  Space: " ",
  ArrowLeft: Key.ARROW_LEFT,
  ArrowRight: Key.ARROW_RIGHT,
  ArrowDown: Key.ARROW_DOWN,
};
/** Elements that may have a role; the browser computes role and name. */
const CANDIDATES = { button: "button, [role=button]", tab: "[role=tab]" };

/** Why an element cannot be clicked on now, but may be later. */
const PASSING = [refused.ElementClickInterceptedError, refused.ElementNotInteractableError, refused.StaleElementReferenceError];

async function webkitSession(server, { size: [width, height] = [800, 600] } = {}) {
  const capabilities = new Capabilities({ browserName: "MiniBrowser", "webkitgtk:browserOptions": { args: ["--automation"] } });
  const driver = await new Builder().disableEnvironmentOverrides().usingServer(server).withCapabilities(capabilities).build();
  try {
    await driver.manage().setTimeouts({ script: LATE, pageLoad: LATE });
    await fitWindow(driver, width, height);
  } catch (error) {
    await driver.quit();
    throw error;
  }
  const run = async (code, argument) => {
    const answer = await driver.executeAsyncScript(
      `const [argument, done] = arguments;
       Promise.resolve((${code})(argument)).then((value) => done({ value }), (error) => done({ error: String(error) }));`,
      argument ?? null,
    );
    if (answer.error) throw new Error(answer.error);
    return answer.value;
  };
  const complaints = [];
  const collect = async () => complaints.push(...((await run(() => globalThis.complaints?.splice(0))) ?? []));
  const find = async (role, name) => {
    for (const element of await driver.findElements(By.css(CANDIDATES[role]))) {
      if (!(await element.isDisplayed())) continue;
      if ((await element.getAriaRole()) === role && (await element.getAccessibleName()) === name) return element;
    }
    return null;
  };
  const at = (x, y, duration = 0) => ({ x: Math.round(x), y: Math.round(y), origin: Origin.VIEWPORT, duration });
  const actions = (...steps) => steps.reduce((all, step) => step(all), driver.actions()).perform();
  const [down, up] = [(a) => a.press(), (a) => a.release()];
  return {
    // Errors before the listeners are there are not seen.
    goto: async (url) => {
      await collect();
      await driver.get(url);
      await run(() => {
        globalThis.complaints = [];
        addEventListener("error", (event) => globalThis.complaints.push(event.message));
        addEventListener("unhandledrejection", (event) => globalThis.complaints.push(String(event.reason)));
      });
    },
    run,
    // As Playwright does: what is covered for a moment, or drawn anew meanwhile, is tried again.
    clickOn: (role, name) =>
      poll(async () => {
        const element = await find(role, name).catch(() => null);
        try {
          await element?.click();
          return element !== null;
        } catch (error) {
          if (PASSING.some((kind) => error instanceof kind)) return false;
          throw error;
        }
      }, `the ${role} “${name}”`),
    click: (x, y) => actions((a) => a.move(at(x, y)), down, up),
    drag: (from, to) =>
      actions(
        (a) => a.move(at(...from)),
        down,
        (a) => a.move(at(...to, 100)),
        up,
      ),
    press: async (...keys) => {
      for (const key of keys) {
        const parts = key.split("+").map((part) => KEYS[part] ?? part);
        await actions(...parts.map((part) => (a) => a.keyDown(part)), ...[...parts].reverse().map((part) => (a) => a.keyUp(part)));
      }
    },
    type: (text) => actions((a) => a.sendKeys(text)),
    screenshot: async () => {
      // WebKitGTK gives the last frame that was drawn, not one of the page as it is now.
      await run(() => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(() => resolve(true)))));
      return Buffer.from(await driver.takeScreenshot(), "base64");
    },
    complaints: async () => {
      await collect();
      return complaints;
    },
    close: () => driver.quit(),
  };
}

/** Sets the size of the page: each try shows how much the window adds. */
async function fitWindow(driver, width, height) {
  const window = driver.manage().window();
  await window.setRect({ x: 0, y: 0, width, height });
  await poll(async () => {
    const [page, outer] = [await driver.executeScript("return [innerWidth, innerHeight]"), await window.getRect()];
    if (page[0] === width && page[1] === height) return true;
    await window.setRect({ x: 0, y: 0, width: outer.width + width - page[0], height: outer.height + height - page[1] });
    return false;
  }, `a page of ${width} × ${height} pixels`);
}

/** How each engine is started; throws [Missing] where a program is not installed. */
export const ENGINES = { Chromium: startChromium, Firefox: startFirefox, WebKitGTK: startWebkit };
