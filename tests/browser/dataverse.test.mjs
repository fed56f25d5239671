// The external tool of Dataverse (www/examples/dataverse), from the real server with its policy, and a small Dataverse that answers as versions 5.13 to 6.11 do: the
// callback, signed addresses, Range, CORS. docs/hosting/dataverse.json is the manifest.

import assert from "node:assert/strict";
import { readFile } from "node:fs/promises";
import http from "node:http";
import path from "node:path";
import { after, before } from "node:test";
import { ROOT, launch, open, packFolder, picture, serve, stats, test, waitFor } from "./harness.mjs";

const [SIGNED, RESTRICTED, PUBLIC, TEXT, SILENT, HUGE, HIDDEN, GONE, BROKEN, EMPTY, UNNAMED, BUSY] = [7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18];
const TOKEN = "until=2026-12-01T00:00:00&user=amina&method=GET&token=0a+b/c";
let manifest;
let pack;
let dataverse;
let tool;
let browser;

/** What the callback of a file is answered with: as `URLTokenUtil.createPostBody` of Dataverse fills in the manifest. */
function toolParameters(id) {
  const values = { "{fileId}": id, "{siteUrl}": dataverse.url, "{localeCode}": "en" };
  const queryParameters = Object.assign(
    {},
    ...manifest.toolParameters.queryParameters.map((p) => Object.fromEntries(Object.entries(p).map(([k, v]) => [k, values[v]]))),
  );
  const signedUrls = manifest.allowedApiCalls.map(({ name, httpMethod, urlTemplate, timeOut }) => {
    const url = dataverse.url + urlTemplate.replace("{fileId}", id);
    return { name, httpMethod, signedUrl: id === SIGNED ? `${url}&${TOKEN}` : url, timeOut };
  });
  // As for a manifest without `allowedApiCalls`.
  return { status: "OK", data: id === UNNAMED ? { queryParameters } : { queryParameters, signedUrls } };
}

/** The address that Dataverse opens: its Base64 is not escaped. */
const launched = (id, more = "") => {
  const callback = `${dataverse.url}/api/v1/files/${id}/metadata/3/toolparams/1?until=2026-12-01T00:00:00&user=amina&method=GET&token=${"~?>".repeat(9)}`;
  return `${tool.url}${new URL(manifest.toolUrl).pathname}?callback=${Buffer.from(callback).toString("base64")}&locale=en&preview=true${more}`;
};

function sendFile(request, response, id, url, headers) {
  dataverse.asked.push([id, request.headers.range ?? null]);
  const say = (status, body, more = {}) => response.writeHead(status, { ...headers, ...more }).end(body);
  const forbidden = id === RESTRICTED || (id === SIGNED && !url.search.endsWith(`&${TOKEN}`));
  if (forbidden) return say(403, '{"status":"ERROR","code":403,"message":"Not authorized to access this object via this API endpoint."}');
  if (id === GONE) return say(404, "");
  if (id === BROKEN) return say(500, "");
  // Asks to wait once, before the first bytes.
  if (id === BUSY && dataverse.asked.filter(([one]) => one === BUSY).length === 1) return say(429, "", { "retry-after": "1" });
  // A file of 100 MiB that is sent only as a whole; the reader of this test never wants more than its start.
  if (id === HUGE) return response.writeHead(200, { ...headers, "content-length": 100 * 2 ** 20 }).write(pack.subarray(0, 4096));
  const body = id === TEXT ? Buffer.from("x,y,z\n1,2,3\n") : id === EMPTY ? Buffer.alloc(0) : pack;
  const [, first, last] = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range ?? "") ?? [];
  if (first === undefined) return say(200, body);
  if (Number(first) >= body.length) return say(416, "");
  const part = body.subarray(Number(first), Number(last) + 1);
  return say(206, part, { "accept-ranges": "bytes", "content-range": `bytes ${first}-${Number(first) + part.length - 1}/${body.length}` });
}

async function fakeDataverse() {
  const server = http.createServer((request, response) => {
    const url = new URL(request.url, "http://x");
    // Its page of a file, which shows the tool in a frame.
    if (url.pathname === "/file.xhtml") {
      response.writeHead(200, { "content-type": "text/html" });
      response.end(
        `<!doctype html><link rel="icon" href="data:,"><title>Dataverse</title><iframe title="Preview" width="780" height="560" src="${launched(SIGNED)}"></iframe>`,
      );
      return;
    }
    const id = Number(/\/(?:files|datafile)\/(\d+)/.exec(url.pathname)?.[1]);
    const headers = {
      "access-control-allow-origin": "*",
      "access-control-allow-headers": "Range",
      "access-control-expose-headers": "Accept-Ranges, Content-Range",
    };
    if (id === SILENT) delete headers["access-control-allow-origin"];
    if (id === HIDDEN) delete headers["access-control-expose-headers"];
    if (url.pathname.includes("/access/datafile/")) sendFile(request, response, id, url, headers);
    else if (url.pathname.includes("/toolparams/") && url.search.includes("token=~")) response.writeHead(200, headers).end(JSON.stringify(toolParameters(id)));
    else response.writeHead(401, headers).end('{"status":"ERROR","message":"Bad signature"}');
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  const stop = () => {
    server.closeAllConnections();
    return new Promise((resolve) => server.close(resolve));
  };
  return { url: `http://127.0.0.1:${server.address().port}`, asked: [], stop };
}

before(async () => {
  manifest = JSON.parse(await readFile(path.join(ROOT, "docs/hosting/dataverse.json"), "utf8"));
  const folder = await packFolder();
  pack = await readFile(path.join(folder, "fort.kilwa"));
  dataverse = await fakeDataverse();
  tool = await serve(folder, "--pack-origins", dataverse.url, "--frame-ancestors", "self", dataverse.url);
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await dataverse?.stop();
  await tool?.stop();
});

test("the manifest has what Dataverse requires, and leads to a page that is there", async () => {
  for (const field of ["displayName", "description", "scope", "types", "toolUrl", "contentType"]) assert.ok(manifest[field]?.length > 0, field);
  assert.equal(manifest.scope, "file");
  const words = manifest.toolParameters.queryParameters.flatMap(Object.values);
  assert.ok(words.includes("{fileId}"), "required for tools of files");
  assert.ok(words.every((w) => ["{fileId}", "{siteUrl}", "{localeCode}"].includes(w)));
  for (const { timeOut, urlTemplate } of manifest.allowedApiCalls) assert.ok(Number.isInteger(timeOut) && urlTemplate.startsWith("/api/"));
  assert.equal((await fetch(tool.url + new URL(manifest.toolUrl).pathname)).status, 200);
});

test("Dataverse shows a model that is not public in a frame of its page, streamed from a signed address", async () => {
  const { page, complaints, close } = await open(browser, `${dataverse.url}/file.xhtml`, { wait: null });
  const inner = page.frameLocator("iframe").getByTitle("3D model");
  const frame = await (await inner.elementHandle()).contentFrame();
  await waitFor(frame, "settled");
  assert.ok((await picture(frame)).share > 0.05);
  const { bytesReceived } = await stats(frame);
  assert.ok(bytesReceived > 0);
  const asked = dataverse.asked.filter(([id]) => id === SIGNED);
  assert.ok(asked.length > 1 && asked.every(([, range]) => range), "every request asks for a range");
  assert.deepEqual(complaints, []);
  await close();
});

test("without a callback, a public file is read from the site that the address names", async () => {
  const { page, complaints, close } = await open(browser, `${tool.url}${new URL(manifest.toolUrl).pathname}?siteUrl=${dataverse.url}/&fileid=${PUBLIC}`, {
    wait: null,
  });
  const frame = await (await page.getByTitle("3D model").elementHandle()).contentFrame();
  await waitFor(frame, "first");
  assert.deepEqual(complaints, []);
  await close();
});

test("a file is shown even if this page may not read Content-Range, or if the host asks to wait before the first bytes", async () => {
  const { page, complaints, close } = await open(browser, "about:blank", { wait: null });
  for (const id of [HIDDEN, BUSY]) {
    await page.goto(launched(id));
    const frame = await (await page.getByTitle("3D model").elementHandle()).contentFrame();
    await waitFor(frame, "settled");
    assert.ok((await picture(frame)).share > 0.05);
    assert.equal(await page.getByRole("alert").count(), 0);
  }
  // The refusal leaves a line of the browser's own.
  assert.deepEqual(
    complaints.filter((text) => !/Failed to load resource/.test(text)),
    [],
  );
  await close();
});

test("each reason why a file cannot be shown has its sentence", async () => {
  const host = new URL(dataverse.url).host;
  const page = `${tool.url}${new URL(manifest.toolUrl).pathname}`;
  const expired = Buffer.from(`${dataverse.url}/api/v1/files/7/metadata/3/toolparams/1?token=old`).toString("base64");
  const cases = [
    [launched(RESTRICTED), `This file is restricted. Sign in at ${host} with an account that has access to it, and open the file again.`],
    [launched(TEXT), "This file is not a Kilwa pack, so it cannot be shown as a 3D model."],
    [launched(EMPTY), "This file is not a Kilwa pack, so it cannot be shown as a 3D model."],
    [launched(UNNAMED), `${host} gave no address for the contents of the file. The manifest of this tool needs the call retrieveFileContents.`],
    [launched(GONE), `${host} does not have this file any more.`],
    [launched(BROKEN), `${host} answers with error 500. Try again later.`],
    [
      launched(SILENT),
      `${host}, or the storage to which it redirects, does not answer or does not allow ${tool.url} to read files. Its operator can allow it (CORS).`,
    ],
    [
      launched(HUGE),
      `${host} sends this file only as a whole. The file is 100 MB; above 64 MB, models can be shown only if the server answers Range requests.`,
    ],
    [`${page}?callback=${expired}`, `The link from ${host} has expired. Open the file in Dataverse again.`],
    ...[
      "",
      "?fileid=9",
      `?siteUrl=${dataverse.url}&fileid=9/../8`,
      "?siteUrl=javascript:alert(1)//&fileid=9",
      "?callback=%25",
      `?callback=${btoa("file:///etc/passwd")}`,
    ].map((query) => [page + query, "The address of this page names no file. Open the file in Dataverse, and choose this tool there."]),
    [
      launched(RESTRICTED).replace("locale=en", "locale=pt_BR"),
      `O acesso a este ficheiro é restrito. Inicie sessão em ${host} com uma conta que tenha acesso e abra de novo o ficheiro.`,
    ],
  ];
  const { page: tab, close } = await open(browser, "about:blank", { wait: null });
  for (const [address, sentence] of cases) {
    await tab.goto(address);
    const alert = tab.getByRole("alert");
    await alert.waitFor();
    assert.equal(await alert.innerText(), sentence, address);
    assert.equal(await tab.getByTitle("3D model").count(), 0);
  }
  await close();
});

test("all languages have all sentences, with the same values", async () => {
  const { WORDS } = await import(path.join(ROOT, "www/examples/dataverse/words.js"));
  const shape = (words) => Object.entries(words).map(([key, text]) => [key, [...text.matchAll(/\{\w+\}/g)].map(String).sort()]);
  for (const [language, words] of Object.entries(WORDS)) assert.deepEqual(shape(words), shape(WORDS.en), language);
});
