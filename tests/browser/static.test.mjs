// What `kilwa publish --site` writes, from hosts that know nothing of Kilwa: nginx, and Python's http.server, which ignores Range.

import assert from "node:assert/strict";
import { execFile, execFileSync, spawn } from "node:child_process";
import { mkdir, mkdtemp, readFile, readdir, rm, writeFile } from "node:fs/promises";
import net from "node:net";
import { tmpdir } from "node:os";
import path from "node:path";
import { after, before } from "node:test";
import { promisify } from "node:util";
import jsQR from "jsqr";
import { KILWA, WWW, launch, open, openTab, packFolder, picture, stats, test, waitFor } from "./harness.mjs";
import { decodePng } from "./png.mjs";

const run = promisify(execFile);
const METADATA = `title = "Gereza"\ndescription = "A fort by the sea."\nslug = "gereza"\n[rights]\nuri = "CC BY 4.0"\n[[creators]]\nname = "Held, Christoph"\n[model]\nunits = "m"\n`;
const TEXT = "Coral rag.\n<img src=x onerror=alert(1)>";
let folder;
let site;
let browser;

before(async () => {
  folder = await mkdtemp(path.join(tmpdir(), "kilwa-static-"));
  site = path.join(folder, "site");
  const packs = await packFolder();
  await writeFile(path.join(folder, "m.toml"), METADATA);
  const pack = path.join(packs, "fort.kilwa");
  const { metadata } = JSON.parse((await run(KILWA, ["info", pack, "--json"])).stdout);
  const [x, y, z] = metadata.bounds_min.map((low, k) => (low + metadata.bounds_max[k]) / 2);
  const note = {
    id: "urn:uuid:00000001-0000-4000-8000-000000000000",
    type: "Annotation",
    label: "The gate",
    body: [
      { type: "TextualBody", purpose: "describing", value: TEXT },
      { type: "SpecificResource", purpose: "linking", source: "https://example.org/gate" },
    ],
    target: { selector: { type: "PointSelector", x, y, z } },
  };
  await writeFile(path.join(folder, "notes.json"), JSON.stringify({ type: "AnnotationPage", items: [note] }));
  const args = [
    "publish",
    pack,
    "--notes",
    path.join(folder, "notes.json"),
    "--to",
    site,
    "--metadata",
    path.join(folder, "m.toml"),
    "--site",
    "--software",
    "--www",
    WWW,
  ];
  await run(KILWA, args);
  await rm(packs, { recursive: true });
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await rm(folder, { recursive: true });
});

/** A port that is free now. */
const freePort = () =>
  new Promise((resolve) => {
    const probe = net.createServer().listen(0, "127.0.0.1", () => {
      const { port } = probe.address();
      probe.close(() => resolve(port));
    });
  });

/** A program that serves the site on a port, until `stop()`. */
async function host(program, args, port) {
  const child = spawn(program, args, { stdio: "ignore" });
  const ended = new Promise((resolve) => child.once("exit", resolve));
  const url = `http://127.0.0.1:${port}`;
  for (let tries = 0; ; tries += 1) {
    try {
      const { status } = await fetch(`${url}/models.json`);
      if (status !== 200) throw new Error(`it answers ${status}`);
      break;
    } catch (error) {
      assert.ok(tries < 100 && child.exitCode === null, `${program} does not serve the site: ${error.message}`);
      await new Promise((resolve) => setTimeout(resolve, 100)); // between two attempts: a program does not announce when it listens
    }
  }
  return {
    url,
    stop: async () => {
      child.kill("SIGTERM");
      await ended;
    },
  };
}

async function python() {
  const port = await freePort();
  return host("python3", ["-m", "http.server", String(port), "--bind", "127.0.0.1", "--directory", site], port);
}

/** The smallest nginx that serves a folder, in the foreground and without root. */
async function nginx() {
  const port = await freePort();
  const home = path.join(folder, "nginx");
  await mkdir(home, { recursive: true });
  const temp = ["client_body", "proxy", "fastcgi", "uwsgi", "scgi"].map((t) => `${t}_temp_path ${home}/${t};`).join(" ");
  await writeFile(
    path.join(home, "nginx.conf"),
    `daemon off; ${process.getuid?.() === 0 ? "user root; " : ""}pid ${home}/pid; error_log ${home}/error.log; events {} http { include /etc/nginx/mime.types; access_log off; ${temp}
     server { listen 127.0.0.1:${port}; root ${site}; } }`,
  );
  return host("nginx", ["-p", home, "-e", path.join(home, "error.log"), "-c", path.join(home, "nginx.conf")], port);
}

const has = (program, flag) => {
  try {
    execFileSync(program, [flag], { stdio: "ignore" });
    return false;
  } catch (error) {
    return error.code === "ENOENT" ? `${program} is not installed` : false;
  }
};

/** What the page says where a host does not send parts of files. */
const whole = (page) => page.getByRole("main").getByRole("status").filter({ hasText: "does not send parts of files" });

/** Open the model; the answers to requests for packs, and what the page says about them. */
async function look(url, options = {}) {
  const answers = [];
  const opened = await open(browser, `${url}/gereza/`, {
    before: (page) =>
      page.on("response", (response) => {
        if (response.url().endsWith(".kilwa")) answers.push(response.status());
      }),
    ...options,
  });
  return { ...opened, answers };
}

test("from nginx the model streams by range", { skip: has("nginx", "-v") }, async () => {
  const server = await nginx();
  try {
    const { page, complaints, answers, close } = await look(server.url);
    const s = await stats(page);
    assert.ok(s.targetReached && s.settled, JSON.stringify(s));
    assert.ok((await picture(page)).share > 0.05);
    assert.ok(answers.length > 1 && answers.every((status) => status === 206), String(answers));
    assert.equal(await whole(page).count(), 0, "the pack was not read whole");
    assert.deepEqual(complaints, []);
    await close();
    const said = await run(KILWA, ["verify", `${server.url}/`]);
    assert.match(said.stdout, /1 of 1 object sound/);
  } finally {
    await server.stop();
  }
});

test("from Python's http.server the pack is read once, as a stream, and the page says so", async () => {
  const server = await python();
  try {
    const { page, complaints, answers, close } = await look(server.url);
    const s = await stats(page);
    assert.ok(s.targetReached && s.settled, JSON.stringify(s));
    assert.ok((await picture(page)).share > 0.05);
    assert.deepEqual(answers, [200]);
    const size = await page.evaluate(() => globalThis.kilwa.api.info().pack.bytes);
    const pack = (await readdir(path.join(site, "gereza/v1"))).find((name) => name.endsWith(".kilwa"));
    assert.equal(size, (await readFile(path.join(site, "gereza/v1", pack))).length);
    assert.ok(await whole(page).isVisible());
    assert.deepEqual(complaints, []);
    await close();
    const said = await run(KILWA, ["verify", `${server.url}/gereza/`]);
    assert.match(said.stdout, /1 of 1 object sound/);
  } finally {
    await server.stop();
  }
});

test("notes that were published are seen on the model's page, as text, and have an address", async () => {
  const server = await python();
  try {
    const { page, complaints, close } = await look(server.url);
    await page.getByRole("group", { name: "Notes" }).getByRole("button").waitFor();
    await openTab(page, "Notes");
    const rows = page.getByRole("tabpanel", { name: "Notes" }).getByRole("listitem").getByRole("button", { name: /^\d/ });
    // Each row begins with its number.
    assert.deepEqual(
      (await rows.allInnerTexts()).map((text) => text.replace(/^\d+\s*/, "")),
      ["The gate"],
    );
    assert.ok(await page.getByText("You see your own version of the notes.").isHidden(), "nothing of the reader's own");
    await rows.click();
    const card = page.getByRole("region", { name: "Note", exact: true });
    assert.equal(await card.getByText("Coral rag").innerText(), TEXT);
    assert.equal(await card.getByRole("img").count(), 0);
    assert.equal(await card.getByRole("link").getAttribute("href"), "https://example.org/gate");
    assert.match(page.url(), /annotation=00000001-0000-4000-8000-000000000000/);
    assert.deepEqual(complaints, []);
    await close();
    const plain = await open(browser, `${server.url}/gereza/`, { wait: null, javaScriptEnabled: false });
    const said = await plain.page.innerText("body");
    assert.ok(said.includes("The gate") && said.includes("<img src=x onerror=alert(1)>"), said);
    await plain.close();
  } finally {
    await server.stop();
  }
});

test("the catalogue, its feed, its lists and every link in them lead somewhere", async () => {
  const server = await python();
  try {
    const get = async (address) => {
      const response = await fetch(new URL(address, `${server.url}/`));
      return { status: response.status, type: response.headers.get("content-type"), text: await response.text() };
    };
    const list = await get("");
    const links = [...list.text.matchAll(/(?:href|src)="([^"]+)"/g)].map((m) => m[1].replaceAll("&amp;", "&"));
    assert.ok(links.includes("gereza/"), String(links));
    for (const link of links.filter((l) => !/^[a-z]+:/.test(l))) assert.equal((await get(link)).status, 200, link);
    const models = JSON.parse((await get("models.json")).text);
    assert.match(JSON.stringify(models), /gereza/);
    for (const file of ["feed.xml", "gereza/v1/metadata/dc.xml", "gereza/v1/metadata/edm.xml"]) {
      const { page, close } = await open(browser, `${server.url}/`, { wait: null });
      const text = (await get(file)).text;
      const error = await page.evaluate((xml) => new DOMParser().parseFromString(xml, "text/xml").querySelector("parsererror")?.textContent ?? null, text);
      assert.equal(error, null, file);
      await close();
    }
    // Without scripts the page has text, picture, citation and downloads.
    const { page, close } = await open(browser, `${server.url}/gereza/`, { wait: null, javaScriptEnabled: false });
    const plain = await page.innerText("body");
    const addresses = await page.getByRole("link").evaluateAll((links) => links.map((link) => link.href));
    for (const part of ["Gereza", "A fort by the sea.", "CC BY 4.0", "Held"]) assert.ok(plain.includes(part), `${part} in ${plain}`);
    assert.ok(
      addresses.some((address) => address.endsWith(".kilwa")),
      String(addresses),
    );
    await close();
    // From the catalogue to the model.
    const way = await open(browser, `${server.url}/`, { wait: null });
    await way.page.getByRole("link", { name: "Gereza", exact: true }).click();
    await waitFor(way.page, "first");
    assert.deepEqual(way.complaints, []);
    await way.close();
  } finally {
    await server.stop();
  }
});

test("Share gives the link, a code whose frame names title, creators and licence, and a QR code of the link", async () => {
  const server = await python();
  try {
    const { page, complaints, close } = await look(server.url, { permissions: ["clipboard-read", "clipboard-write"], size: [900, 800] });
    await page.evaluate(() => globalThis.kilwa.api.setCamera({ azimuth: 1.25 }));
    await page.getByRole("button", { name: "Share", exact: true }).click();
    const dialog = page.getByRole("dialog", { name: "Share" });
    const link = await dialog.getByRole("textbox", { name: "Link to this view" }).inputValue();
    assert.equal(link, page.url());
    assert.match(link, /#view=1\.25,/);
    await dialog.getByRole("button", { name: "Copy: Link to this view" }).click();
    await dialog.getByRole("status").filter({ hasText: "Copied" }).waitFor();
    assert.equal(await page.evaluate(() => navigator.clipboard.readText()), link);
    // What another reader of QR codes makes of it.
    const { width, height, channels, pixels } = decodePng(
      await dialog.getByRole("img", { name: "QR code of the link" }).screenshot({ caret: "initial", scale: "css" }),
    );
    const rgba = new Uint8ClampedArray(width * height * 4).fill(255);
    for (let at = 0; at < width * height; at += 1) rgba.set(pixels.subarray(at * channels, at * channels + 3), at * 4);
    assert.equal(jsQR(rgba, width, height)?.data, link);
    // Pasted into another page, the code shows the model, and who made it, in the frame and below.
    const code = await dialog.getByRole("textbox", { name: "Code for a web page" }).inputValue();
    await close();
    const other = await open(browser, `${server.url}/models.json`, { wait: null });
    await other.page.setContent(code);
    const licence = "https://creativecommons.org/licenses/by/4.0/";
    assert.match(await other.page.getByRole("figure").innerText(), /Gereza, Held, Christoph, CC BY 4\.0/);
    const frame = await (await other.page.getByTitle("Gereza").elementHandle()).contentFrame();
    await waitFor(frame, "settled");
    const credit = frame.getByRole("main").getByRole("link", { name: "Gereza", exact: true }).locator("..");
    assert.match((await credit.innerText()).replace(/\s+/g, " "), /Gereza Held, Christoph CC BY 4\.0/);
    assert.equal(await credit.getByRole("link", { name: "CC BY 4.0" }).getAttribute("href"), licence);
    assert.ok(!new URL(await credit.getByRole("link", { name: "Gereza" }).getAttribute("href")).searchParams.has("embed"));
    assert.deepEqual(complaints, []);
    await other.close();
  } finally {
    await server.stop();
  }
});
