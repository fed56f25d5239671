// The viewer elsewhere: as an element of another page, from a plain static host, and with a pack of this computer.

import assert from "node:assert/strict";
import { readFile, stat } from "node:fs/promises";
import http from "node:http";
import path from "node:path";
import { after, before } from "node:test";
import { WWW, cameraOf, canvasOf, launch, open, packFolder, picture, serve, stats, test, troubleOf, waitFor } from "./harness.mjs";

const TYPES = {
  ".html": "text/html; charset=utf-8",
  ".js": "text/javascript",
  ".css": "text/css",
  ".json": "application/json",
  ".wasm": "application/wasm",
  ".svg": "image/svg+xml",
};
let folder;
let server;
let hosts;
let browser;

/** A static host as simple as they come: whole files, no ranges. `extra` holds pages of its own; `meta` allows origins. */
async function staticHost(extra = {}, meta = () => "", headers = {}) {
  const host = http.createServer(async (request, response) => {
    const { pathname } = new URL(request.url, "http://x");
    const name = pathname.endsWith("/") ? `${pathname}index.html` : pathname;
    const file = name === "/fort.kilwa" ? path.join(folder, "fort.kilwa") : path.join(WWW, path.normalize(name));
    try {
      let body = extra[name] ?? (await readFile(file));
      if (name === "/index.html") body = String(body).replace("<title>", `${meta()}<title>`);
      response.writeHead(200, {
        "content-type": TYPES[path.extname(name)] ?? "application/octet-stream",
        "content-length": Buffer.byteLength(body),
        "access-control-allow-origin": "*",
        "cache-control": "no-store",
        ...headers,
      });
      response.end(body);
    } catch {
      response.writeHead(404);
      response.end();
    }
  });
  await new Promise((resolve) => host.listen(0, "127.0.0.1", resolve));
  const stop = () => {
    host.closeAllConnections();
    return new Promise((resolve) => host.close(resolve));
  };
  return { url: `http://127.0.0.1:${host.address().port}`, stop };
}

const HOST_PAGE = '<!doctype html><link rel="icon" href="data:,"><title>host</title><body><script type="module" src="/host.js"></script>';

before(async () => {
  folder = await packFolder();
  server = await serve(folder);
  const viewer = await staticHost({}, () => `<meta name="kilwa-origins" content="${hosts.friend?.url ?? ""}">`);
  const page = { "/host.html": HOST_PAGE, "/host.js": `import "${viewer.url}/kilwa-viewer.js";` };
  hosts = { viewer };
  hosts.friend = await staticHost(page);
  hosts.stranger = await staticHost(page);
  hosts.walled = await staticHost({}, undefined, { "content-security-policy": "frame-ancestors 'none'" });
  browser = await launch();
});
after(async () => {
  await browser?.close();
  for (const host of Object.values(hosts ?? {})) await host.stop();
  await server?.stop();
});

test("a static host that knows no ranges is enough for page and pack", async () => {
  const { page, complaints, close } = await open(browser, `${hosts.viewer.url}/?pack=fort.kilwa&error=8`);
  assert.ok((await picture(page)).share > 0.05);
  assert.ok(await page.getByRole("main").getByRole("status").filter({ hasText: "does not send parts of files" }).isVisible());
  assert.equal(await page.getByRole("link", { name: "All models" }).count(), 0, "there is no list to go back to");
  assert.deepEqual(complaints, []);
  await close();
});

test("without a pack the page offers to open one: chosen or dropped in, nothing is sent, another one can follow", async () => {
  const { page, complaints, close } = await open(browser, `${hosts.viewer.url}/?error=3`, { wait: null });
  await page.getByRole("heading", { name: "Open a model" }).waitFor();
  const chooser = page.getByLabel("Open a file…");
  const asked = [];
  page.on("request", (request) => request.url().startsWith("http") && asked.push(`${request.method()} ${new URL(request.url()).pathname}`));
  await chooser.setInputFiles(path.join(folder, "fort.kilwa"));
  await waitFor(page, "settled");
  const chosen = await picture(page);
  assert.ok(chosen.share > 0.05);
  const { requests, bytesReceived } = await stats(page);
  const { bytes } = await page.evaluate(() => globalThis.kilwa.api.info().pack);
  assert.ok(requests > 1 && bytesReceived < bytes, "parts of the file are read, not all of it");
  assert.equal(bytes, (await stat(path.join(folder, "fort.kilwa"))).size);
  assert.deepEqual(
    asked.filter((a) => !a.startsWith("GET /") || a.includes("kilwa-") || a.endsWith(".kilwa")),
    [],
  );
  // Another file in its place: damaged, empty, and the first again, dropped.
  await chooser.setInputFiles({ name: "no.kilwa", mimeType: "", buffer: Buffer.alloc(5000, 65) });
  await waitFor(page, "trouble");
  assert.match(await troubleOf(page).innerText(), /damaged[\s\S]*magic bytes/);
  await chooser.setInputFiles({ name: "no.kilwa", mimeType: "", buffer: Buffer.alloc(0) });
  await waitFor(page, "trouble");
  const pack = (await readFile(path.join(folder, "fort.kilwa"))).toString("base64");
  const dataTransfer = await page.evaluateHandle((base64) => {
    const dropped = new DataTransfer();
    dropped.items.add(new File([Uint8Array.from(atob(base64), (c) => c.charCodeAt(0))], "dropped.kilwa"));
    return dropped;
  }, pack);
  const main = page.getByRole("main");
  await main.dispatchEvent("dragenter", { dataTransfer });
  assert.ok(await page.getByText("Drop to open the model").isVisible(), "the page says that a file can be dropped");
  await main.dispatchEvent("drop", { dataTransfer });
  await waitFor(page, "settled");
  assert.deepEqual(await picture(page), chosen);
  assert.deepEqual(complaints, []);
  await close();
});

test("the model alone fills the window, and what floats over it keeps apart, at every size", async () => {
  const sizes = [
    [320, 480],
    [390, 844],
    [700, 500],
    [720, 360],
    [800, 300],
    [1000, 700],
  ];
  for (const query of ["embed=1", "embed=bare", ""]) {
    const { page, complaints, close } = await open(browser, `${server.url}/m/fort?error=16&${query}`, { size: sizes[0] });
    if (!query) await page.keyboard.press("h"); // hides all but the model
    for (const [width, height] of sizes) {
      await page.setViewportSize({ width, height });
      const at = `${query || "hidden"} at ${width} × ${height}`;
      await page.waitForFunction((canvas) => canvas.clientWidth === innerWidth, await canvasOf(page).elementHandle(), { polling: 50 });
      const boxOf = async (locator) => {
        const { x, y, width, height } = await locator.boundingBox();
        return [x, y, x + width, y + height];
      };
      const floating = [];
      const credit = page.getByRole("main").getByRole("link", { name: "fort", exact: true });
      for (const [name, locator] of [
        ["credit", credit.locator("..")],
        ["tools", page.getByRole("toolbar", { name: "Tools", exact: true })],
        ["cube", page.getByRole("group", { name: "View cube" })],
        ["way to the whole page", page.getByRole("link", { name: "Open the full page" })],
        ["way back", page.getByRole("button", { name: "Show controls" })],
      ])
        if (await locator.isVisible()) floating.push([name, ...(await boxOf(locator))]);
      const boxes = { canvas: await boxOf(canvasOf(page)), floating };
      assert.equal(boxes.floating.length, { "embed=1": 4, "embed=bare": 1, "": 1 }[query], at);
      for (const [i, [name, left, top, right, bottom]] of boxes.floating.entries()) {
        assert.ok(left >= 0 && top >= 0 && right <= width && bottom <= height, `${name} is within ${at}`);
        for (const [other, l, t, r, b] of boxes.floating.slice(i + 1)) {
          assert.ok(right <= l || r <= left || bottom <= t || b <= top, `${name} and ${other} are apart, ${at}`);
        }
      }
    }
    assert.deepEqual(complaints, []);
    await close();
  }
});

test("the element says in words that its viewer is blocked, and only then, and it fits a narrow column", async () => {
  const { page, close } = await open(browser, `${hosts.friend.url}/host.html`, { wait: null });
  const show = (viewer) =>
    page.evaluate(async (viewer) => {
      await customElements.whenDefined("kilwa-viewer");
      customElements.get("kilwa-viewer").silence = 500;
      const column = document.createElement("div");
      column.style.cssText = "width: 300px; display: flex; align-items: flex-start";
      const element = document.createElement("kilwa-viewer");
      element.setAttribute("viewer", `${viewer}/index.html`);
      element.src = `${viewer}/fort.kilwa`;
      column.append(element);
      document.body.replaceChildren(column);
      return new Promise((resolve) => requestAnimationFrame(() => resolve([element.clientWidth, element.clientHeight])));
    }, viewer);
  const [width, height] = await show(hosts.walled.url);
  assert.ok(width === 300 && height >= 240, `${width} × ${height}`);
  const words = page.getByRole("alert");
  await words.waitFor();
  assert.match(await words.innerText(), new RegExp(`${new URL(hosts.walled.url).host} does not allow this page to embed it`));
  const link = new URL(await words.getByRole("link", { name: "Open the model" }).getAttribute("href"));
  assert.equal(link.origin, hosts.walled.url);
  assert.equal(link.searchParams.get("embed"), null);
  // The plate says in which language it is, also where the page is in one that it does not have, and there is one, however often the frame loads.
  assert.equal(await words.getAttribute("lang"), "en");
  await page.evaluate(() => {
    const root = document.querySelector("kilwa-viewer").shadowRoot;
    document.documentElement.lang = "de";
    root.querySelector("[role=alert]").dataset.first = "1";
    root.querySelector("iframe").dispatchEvent(new Event("load"));
  });
  await page.locator("[role=alert]:not([data-first])").waitFor();
  assert.deepEqual([await words.count(), await words.getAttribute("lang")], [1, "en"]);
  // A viewer that may be shown, though not spoken to.
  await show(hosts.viewer.url);
  const frame = await (await page.getByTitle("3D model").elementHandle()).contentFrame();
  await waitFor(frame, "settled");
  assert.equal(await words.count(), 0);
  await close();
});

/** A page of `host` with a viewer of another origin in it. */
async function embed(host) {
  const found = await open(browser, `${host.url}/host.html`, { wait: null });
  await found.page.evaluate(async (viewer) => {
    await customElements.whenDefined("kilwa-viewer");
    const element = document.createElement("kilwa-viewer");
    element.src = `${viewer}/fort.kilwa`;
    element.style.height = "400px";
    globalThis.heard = [];
    for (const event of ["ready", "frame", "camera", "annotation", "annotations"]) element.on(event, () => globalThis.heard.push(event));
    document.body.append(element);
    globalThis.element = element;
  }, hosts.viewer.url);
  const inner = await found.page.getByTitle("3D model").elementHandle();
  const frame = await inner.contentFrame();
  // Events are what the stranger never hears.
  if (host !== hosts.stranger) await found.page.waitForFunction(() => globalThis.heard.includes("ready"), null, { polling: 50 });
  await waitFor(frame, "settled");
  return { ...found, inner, frame };
}

test("<kilwa-viewer> of another origin answers a page that it is allowed to, with data and events", async () => {
  const { page, frame, complaints, close } = await embed(hosts.friend);
  const call = (name, ...args) => page.evaluate(([name, args]) => globalThis.element[name](...args), [name, args]);
  assert.ok(await frame.getByRole("toolbar", { name: "Tools", exact: true }).isVisible());
  assert.equal(await frame.getByRole("banner").count(), 0, "nothing above the picture");
  assert.equal(await frame.getByRole("complementary").count(), 0, "nor beside it");
  const figures = await call("stats");
  assert.ok(figures.trianglesDrawn > 0 && figures.chunksResident > 0 && figures.requests > 0);
  for (const name of ["chunksWanted", "chunksResident", "requestsInFlight", "trianglesDrawn", "bytesReceived", "requests", "worstPixelError", "targetReached"])
    assert.ok(name in figures, name);
  await call("view", "east");
  const camera = await call("getCamera");
  assert.ok(Math.abs(camera.azimuth - Math.PI / 2) < 1e-9 && camera.orthographic);
  await call("setCamera", { azimuth: 1, orthographic: false });
  assert.equal((await call("getCamera")).azimuth, 1);
  await call("setMode", "normals");
  assert.equal(await call("getMode"), "normals");
  await call("view", "iso");
  const hit = await page.evaluate(() => globalThis.element.pick(globalThis.element.clientWidth / 2, 200));
  assert.equal(hit.place.length, 3);
  const id = await call("addAnnotation", { place: hit.place, title: "From outside", text: "<b>text</b>" });
  assert.ok(await call("openAnnotation", id));
  assert.equal(await frame.getByRole("region", { name: "Note", exact: true }).getByRole("heading").innerText(), "From outside");
  const png = await page.evaluate(async () => {
    const blob = await globalThis.element.picture({ width: 320, height: 200 });
    return { type: blob.type, size: blob.size };
  });
  assert.ok(png.type === "image/png" && png.size > 1000);
  // Mistakes come back as errors; what is no call is refused.
  await assert.rejects(call("setMode", "plaid"), /mode: one of/);
  await assert.rejects(call("setCamera", { distance: -1 }), /camera/);
  await assert.rejects(
    page.evaluate(() => globalThis.element.call("constructor")),
    /no such call/,
  );
  await assert.rejects(
    page.evaluate(() => globalThis.element.call("page")),
    /no such call/,
  );
  const heard = await page.evaluate(() => [...new Set(globalThis.heard)].sort());
  assert.ok(
    ["annotation", "annotations", "camera", "frame", "ready"].every((e) => heard.includes(e)),
    heard.join(),
  );
  assert.deepEqual(complaints, []);
  await close();
});

test("a page of an origin that nobody allowed sees the model and gets no answer", async () => {
  const { page, frame, close } = await embed(hosts.stranger);
  const answer = await page.evaluate(() =>
    globalThis.element.stats().then(
      () => "an answer",
      (error) => error.message,
    ),
  );
  assert.equal(
    answer,
    `the viewer's page at ${hosts.viewer.url} does not answer: it is slow, not there, or does not name ${hosts.stranger.url} in <meta name="kilwa-origins">`,
  );
  assert.deepEqual(await page.evaluate(() => globalThis.heard), []);
  assert.ok(await canvasOf(frame).isVisible());
  await close();
});

test("on a line so slow that whoever waits is told, the viewer comes later and answers", async () => {
  const { page, close } = await open(browser, `${hosts.friend.url}/host.html`, { wait: null });
  let let_go;
  const held = new Promise((resolve) => (let_go = resolve));
  await page.route("**/i18n/en.json", async (route) => {
    await held;
    await route.continue();
  });
  const first = await page.evaluate(async (viewer) => {
    await customElements.whenDefined("kilwa-viewer");
    customElements.get("kilwa-viewer").patience = 300;
    const element = document.createElement("kilwa-viewer");
    element.lang = "en";
    element.src = `${viewer}/fort.kilwa`;
    element.style.height = "400px";
    document.body.append(element);
    globalThis.element = element;
    return element.stats().then(
      () => "an answer",
      (error) => error.message,
    );
  }, hosts.viewer.url);
  assert.match(first, /does not answer: it is slow/);
  let_go();
  // `loaded` is awaited again after each failure, until the viewer is there.
  await page.evaluate(async () => {
    const isLoaded = () =>
      globalThis.element.loaded.then(
        () => true,
        () => false,
      );
    while (!(await isLoaded()));
  });
  assert.ok((await page.evaluate(() => globalThis.element.modes())).includes("clay"));
  // A call is rejected if another model is chosen before its answer.
  const overtaken = await page.evaluate(() => {
    const call = globalThis.element.fit();
    globalThis.element.src += "?other";
    return call.then(
      () => "an answer",
      (error) => error.message,
    );
  });
  assert.equal(overtaken, "another model was chosen");
  await close();
});

test("messages that are no calls, from other windows or in other shapes, change nothing", async () => {
  const { page, inner, frame, complaints, close } = await embed(hosts.friend);
  const before = await cameraOf(frame);
  await inner.evaluate(({ contentWindow }) => {
    for (const message of [
      null,
      1,
      "view",
      {},
      { kilwa: 1, call: "view" },
      { kilwa: 1, id: 1, call: "view", args: "plan" },
      { kilwa: 2, id: 1, call: "fit" },
      { kilwa: 1, id: 2, call: "__proto__", args: [] },
    ])
      contentWindow.postMessage(message, "*");
  });
  // The frame itself is not its host. Messages arrive in their order: when the last one is there, the viewer has had the others.
  await frame.evaluate(async () => {
    const last = new Promise((resolve) => addEventListener("message", ({ data }) => data === "last" && resolve()));
    postMessage({ kilwa: 1, id: 9, call: "view", args: ["plan"] }, "*");
    postMessage("last", "*");
    await last;
  });
  // The host's messages were handled too, and the viewer still answers it.
  assert.ok(await page.evaluate(() => globalThis.element.stats()));
  await waitFor(frame, "settled");
  assert.deepEqual(await cameraOf(frame), before);
  assert.deepEqual(complaints, []);
  await close();
});

test("the example page works", async () => {
  const { page, complaints, close } = await open(browser, `${hosts.viewer.url}/examples/?pack=/fort.kilwa`, { wait: null });
  await page.getByText(/\d triangles/).waitFor();
  await page.getByRole("button", { name: "Plan" }).click();
  const frame = await (await page.getByTitle("Model", { exact: true }).elementHandle()).contentFrame();
  await frame.waitForFunction(() => Math.abs(globalThis.kilwa.api.getCamera().elevation - Math.PI / 2) < 1e-6);
  assert.deepEqual(complaints, []);
  await close();
});
