// The loader against servers that do not behave: a clear reason or a recovery, never wrong bytes.

import assert from "node:assert/strict";
import http from "node:http";
import { after, before, test } from "node:test";
import { isPassing, waitOf } from "../../www/answer.js";
import { HEAD_BYTES, Pack, WHOLE_LIMIT } from "../../www/loader.js";

const FILE = Buffer.from(Array.from({ length: 300_000 }, (_, i) => (i * 31 + (i >> 8)) & 255));
let server;
let behave;
let url;

before(async () => {
  server = http.createServer((request, response) => behave(request, response));
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  url = new URL(`http://127.0.0.1:${server.address().port}/a.kilwa`);
});
after(() => {
  server.closeAllConnections();
  server.close();
});

/** A good server, changed by `change({ status, headers, body, from, to })`. */
function good(change = () => ({})) {
  return (request, response) => {
    const [, first, last] = /^bytes=(\d+)-(\d+)$/.exec(request.headers.range);
    const [from, to] = [Number(first), Math.min(Number(last), FILE.length - 1)];
    const answer = {
      status: 206,
      headers: { etag: '"1"', "content-range": `bytes ${from}-${to}/${FILE.length}` },
      body: FILE.subarray(from, to + 1),
    };
    const changed = { ...answer, ...change({ ...answer, from, to }) };
    response.writeHead(changed.status, { "content-length": changed.length ?? changed.body.length, ...changed.headers });
    if (changed.length > changed.body.length) response.write(changed.body, () => response.destroy());
    else response.end(changed.body);
  };
}

const kind = (wanted) => (error) => {
  assert.equal(error.kind, wanted, `${error.kind}: ${error.message}`);
  return true;
};

test("head and ranges are the bytes of the file", async () => {
  behave = good();
  const pack = new Pack(url);
  assert.deepEqual(Buffer.from(await pack.head()), FILE.subarray(0, HEAD_BYTES));
  assert.deepEqual(Buffer.from(await pack.range(200_000, 1234)), FILE.subarray(200_000, 201_234));
  assert.equal(pack.bytes, FILE.length);
  assert.equal(pack.requests, 2);
});

test("a server that ignores Range gives a small file whole, and nothing more is asked of it", async () => {
  let asked = 0;
  behave = (_, response) => {
    asked += 1;
    response.writeHead(200, { "content-length": FILE.length });
    response.end(FILE);
  };
  const pack = new Pack(url);
  assert.equal((await pack.head()).length, HEAD_BYTES);
  assert.deepEqual(Buffer.from(await pack.range(250_000, 50_000)), FILE.subarray(250_000));
  await assert.rejects(pack.range(299_999, 2), kind("cutOff"));
  assert.equal(asked, 1);
});

/** What begins as a pack of so many bytes does. */
function packOf(length) {
  const file = Buffer.alloc(300_000, FILE);
  file.write("KILWAPCK");
  file.writeBigUInt64LE(BigInt(length), 64);
  return file;
}

test("a server that ignores Range and has a large file is refused with its size, which the file tells where the server does not", async () => {
  behave = (_, response) => {
    response.writeHead(200, { "content-length": WHOLE_LIMIT + 1 });
    response.write("x");
  };
  await assert.rejects(new Pack(url).head(), (e) => kind("noRange")(e) && e.bytes === WHOLE_LIMIT + 1);
  let closed;
  behave = (_, response) => {
    closed = new Promise((resolve) => response.on("close", resolve));
    response.writeHead(200).write(packOf(5_000_000_000).subarray(0, 1000));
  };
  await assert.rejects(new Pack(url).head(), (e) => kind("noRange")(e) && e.bytes === 5_000_000_000);
  await closed; // nothing more of it is downloaded
});

test("a server that answers in pieces of no announced length is read once, and parts are given out as they come", async () => {
  const file = packOf(300_000);
  let asked = 0;
  let rest;
  behave = (_, response) => {
    asked += 1;
    response.writeHead(200).write(file.subarray(0, 50));
    setTimeout(() => response.write(file.subarray(50, 100_000)), 10); // part of the simulated server: the pieces arrive separately
    rest = () => response.end(file.subarray(100_000));
  };
  const pack = new Pack(url);
  assert.deepEqual(Buffer.from(await pack.head()), file.subarray(0, HEAD_BYTES));
  assert.equal(pack.bytes, 300_000);
  assert.deepEqual(Buffer.from(await pack.range(70_000, 1000)), file.subarray(70_000, 71_000));
  const late = pack.range(250_000, 50_000);
  const controller = new AbortController();
  const given_up = pack.range(250_000, 10, controller.signal);
  controller.abort();
  await assert.rejects(given_up, { name: "AbortError" });
  rest();
  assert.deepEqual(Buffer.from(await late), file.subarray(250_000));
  assert.equal(asked, 1);
});

test("a whole file that breaks off is asked for again, and a page instead of a pack is not read on for ever", async () => {
  const file = packOf(300_000);
  let breakOff;
  behave = (_, response) => {
    response.writeHead(200).write(file.subarray(0, 100_000));
    breakOff = () => response.destroy();
  };
  const pack = new Pack(url);
  await pack.head();
  const waiting = pack.range(200_000, 10);
  breakOff();
  await assert.rejects(waiting, (e) => kind("truncated")(e) && isPassing(e));
  behave = (_, response) => response.writeHead(500).end();
  await assert.rejects(pack.range(200_000, 10), (e) => isPassing(e));
  behave = (_, response) => response.writeHead(200).end(packOf(300_001));
  await assert.rejects(pack.range(200_000, 10), kind("changed"));
  behave = (_, response) => response.writeHead(200).end(file);
  assert.deepEqual(Buffer.from(await pack.range(200_000, 10)), file.subarray(200_000, 200_010));
  behave = (_, response) => {
    response.writeHead(200, { "content-type": "text/html" }).write("<!doctype html>".padEnd(1000, " "));
  };
  assert.equal(
    Buffer.from(await new Pack(url).head())
      .subarray(0, 9)
      .toString(),
    "<!doctype",
  );
  // Cut off: as long as the server announces.
  behave = (_, response) => response.writeHead(200, { "content-length": 1000 }).end(packOf(300_000).subarray(0, 1000));
  const cut = new Pack(url);
  assert.equal((await cut.head()).length, 1000);
  assert.equal(cut.bytes, 1000);
  await assert.rejects(cut.range(999, 2), kind("cutOff"));
});

test("a file that changes between two requests is noticed by tag and by length", async () => {
  for (const headers of [
    { etag: '"2"', "content-range": "bytes 5-9/300000" },
    { etag: '"1"', "content-range": "bytes 5-9/300001" },
  ]) {
    behave = good();
    const pack = new Pack(url);
    await pack.head();
    behave = good(() => ({ headers }));
    await assert.rejects(pack.range(5, 5), kind("changed"));
  }
  behave = good();
  const pack = new Pack(url);
  await pack.head();
  behave = (_, response) => response.writeHead(416, { "content-range": "bytes */10" }).end();
  await assert.rejects(pack.range(5, 5), kind("changed"));
});

test("weak tags are the same file while they are equal, also where a proxy weakens some of them, and another file when they differ", async () => {
  const tagged = (etag) => good(({ headers }) => ({ headers: { ...headers, etag } }));
  for (const [first, then] of [
    ['W/"1"', 'W/"1"'],
    ['"1"', 'W/"1"'],
    ['W/"1"', '"1"'],
  ]) {
    behave = tagged(first);
    const pack = new Pack(url);
    await pack.head();
    behave = tagged(then);
    assert.deepEqual(Buffer.from(await pack.range(70_000, 500)), FILE.subarray(70_000, 70_500), `${first} ${then}`);
    behave = tagged('W/"2"');
    await assert.rejects(pack.range(70_000, 500), kind("changed"), `${first} ${then}`);
  }
  // A server that answers a range with all of it, because a weak tag does not let it compare: never taken for the part.
  behave = tagged('W/"1"');
  const pack = new Pack(url);
  await pack.head();
  behave = (_, response) => response.writeHead(200, { etag: 'W/"1"', "content-length": FILE.length }).end(FILE);
  await assert.rejects(pack.range(70_000, 500), (error) => kind("server")(error) && isPassing(error));
});

test("a server that takes two seconds for each answer gives the bytes of the file, many at a time, and whoever does not want to wait need not", async () => {
  // The simulated server's two seconds.
  const slow = (then) => (request, response) => setTimeout(() => then(request, response), 2000);
  let under = 0;
  let most = 0;
  behave = slow(good());
  const pack = new Pack(url);
  assert.deepEqual(Buffer.from(await pack.head()), FILE.subarray(0, HEAD_BYTES));
  behave = (request, response) => {
    under += 1;
    most = Math.max(most, under);
    response.on("close", () => (under -= 1));
    slow(good())(request, response);
  };
  const from = [70_000, 110_000, 150_000, 190_000];
  const all = await Promise.all(from.map((at) => pack.range(at, 1000)));
  for (const [k, at] of from.entries()) assert.deepEqual(Buffer.from(all[k]), FILE.subarray(at, at + 1000));
  assert.equal(most, from.length, "the answers were waited for together");
  const controller = new AbortController();
  const asked = pack.range(0, 10, controller.signal);
  let answered = false;
  behave = slow((request, response) => {
    answered = true;
    good()(request, response);
  });
  controller.abort();
  await assert.rejects(asked, { name: "AbortError" });
  assert.ok(!answered);
  // Late and damaged: what is late is checked like everything else.
  behave = slow(good(({ body }) => ({ body: body.subarray(1), length: body.length - 1 })));
  await assert.rejects(pack.range(0, 10), (error) => kind("truncated")(error) && isPassing(error));
  behave = slow(good(({ headers }) => ({ headers: { ...headers, etag: '"2"' } })));
  await assert.rejects(pack.range(0, 10), kind("changed"));
});

test("short, long and misplaced answers are failures that can be tried again", async () => {
  behave = good();
  const pack = new Pack(url);
  await pack.head();
  for (const change of [
    ({ body }) => ({ body: body.subarray(0, 3) }),
    ({ body }) => ({ body: body.subarray(0, 3), length: body.length }),
    ({ body }) => ({ body: Buffer.concat([body, body]) }),
    ({ from, to }) => ({ headers: { etag: '"1"', "content-range": `bytes ${from + 1}-${to + 1}/300000` } }),
    () => ({ status: 200 }),
    () => ({ status: 500 }),
    () => ({ status: 502 }),
  ]) {
    behave = good(change);
    await assert.rejects(pack.range(100, 50), (e) => isPassing(e));
  }
  behave = (request) => request.socket.destroy();
  await assert.rejects(pack.range(100, 50), kind("offline"));
  behave = good();
  assert.deepEqual(Buffer.from(await pack.range(100, 50)), FILE.subarray(100, 150));
});

test("a server that asks to wait is asked again when the time is over, by nobody before, and whoever gives up need not wait", async () => {
  behave = good();
  const pack = new Pack(url);
  await pack.head();
  const asked = [];
  const said = [];
  pack.onLimit = (seconds) => said.push(seconds);
  behave = (request, response) => {
    asked.push(Date.now());
    if (asked.length === 1) response.writeHead(429, { "retry-after": "1" }).end();
    else good()(request, response);
  };
  const first = pack.range(100, 50);
  while (pack.limitedFor === 0) await new Promise((resolve) => setImmediate(resolve));
  const controller = new AbortController();
  const given_up = assert.rejects(pack.range(300, 50, controller.signal), { name: "AbortError" });
  controller.abort();
  const second = pack.range(200, 50);
  assert.ok(pack.held >= 2, "requests that wait are counted");
  assert.deepEqual(Buffer.from(await first), FILE.subarray(100, 150));
  assert.deepEqual(Buffer.from(await second), FILE.subarray(200, 250));
  await given_up;
  assert.equal(asked.length, 3);
  assert.ok(
    asked.slice(1).every((at) => at - asked[0] >= 990),
    String(asked),
  );
  assert.ok(said.length > 0 && said.every((seconds) => seconds === 1), String(said));
  assert.equal(pack.limitedFor, 0);
  assert.equal(pack.held, 0);
});

test("parts of the first answer are not asked of the browser's own store, whether the answer says its place or not", async () => {
  const real = globalThis.fetch;
  const begin = Buffer.from(FILE);
  begin.write("KILWAPCK");
  begin.writeBigUInt64LE(BigInt(FILE.length), 64);
  for (const place of [`bytes 0-${HEAD_BYTES - 1}/${FILE.length}`, null]) {
    const stores = [];
    globalThis.fetch = async (_, { headers, cache }) => {
      stores.push(cache);
      const [, from, to] = /^bytes=(\d+)-(\d+)$/.exec(headers.Range);
      return new Response(begin.subarray(Number(from), Number(to) + 1), { status: 206, headers: place && from === "0" ? { "content-range": place } : {} });
    };
    try {
      const pack = new Pack(url);
      await pack.head();
      for (const offset of [100, HEAD_BYTES - 1, HEAD_BYTES]) await pack.range(offset, 50);
    } finally {
      globalThis.fetch = real;
    }
    assert.deepEqual(stores, ["default", "no-store", "no-store", "default"], String(place));
  }
});

test("whoever gives up while the host is asked whether it answers need not wait for that", async () => {
  const real = globalThis.fetch;
  const controller = new AbortController();
  globalThis.fetch = async (_, { method, signal }) => {
    if (method !== "HEAD") throw new TypeError("Failed to fetch");
    controller.abort();
    signal.throwIfAborted();
  };
  try {
    await assert.rejects(new Pack(url).head(HEAD_BYTES, controller.signal), { name: "AbortError" });
  } finally {
    globalThis.fetch = real;
  }
});

test("how long a server is waited for: as it says, at most a minute, and by itself longer each time", () => {
  const wait = (header, refusals = 1) => waitOf({ headers: new Headers(header === null ? {} : { "retry-after": header }) }, refusals);
  assert.equal(wait("7"), 7000);
  assert.equal(wait("86400"), 60_000);
  const date = wait(new Date(Date.now() + 20_000).toUTCString());
  assert.ok(date > 18_000 && date <= 20_000, String(date));
  for (const useless of [null, "0", "-5", "soon", new Date(0).toUTCString()]) {
    const waits = [1, 2, 3, 4, 5, 6, 7, 8, 1000].map((refusals) => wait(useless, refusals));
    assert.ok(
      waits.every((ms, k) => ms >= 2 ** Math.min(k, 6) * 500 && ms <= Math.min(60_000, 2 ** Math.min(k, 6) * 1000)),
      `${useless}: ${waits}`,
    );
  }
  assert.ok(wait("1", 6) > 10_000, "a server that keeps refusing is asked less often than it says");
});

test("what is not there, empty, or without a length is said", async () => {
  behave = (_, response) => response.writeHead(404).end();
  await assert.rejects(new Pack(url).head(), kind("missing"));
  behave = (_, response) => response.writeHead(416, { "content-range": "bytes */0" }).end();
  await assert.rejects(new Pack(url).head(), kind("empty"));
  behave = good(() => ({ headers: { "content-range": "bytes 0-131071/*" } }));
  await assert.rejects(new Pack(url).head(), kind("noRange"));
});

test("a cancelled request ends as such", async () => {
  behave = good();
  const pack = new Pack(url);
  await pack.head();
  behave = (_, response) => response.writeHead(206, { "content-range": "bytes 0-9/300000", "content-length": 10 }).write("x");
  const controller = new AbortController();
  // In the middle of the answer.
  const asked = pack.range(0, 10, controller.signal, { onPart: () => controller.abort() });
  await assert.rejects(asked, { name: "AbortError" });
});

test("a connection that breaks while an answer is being thrown away does not hide the reason", async () => {
  const real = globalThis.fetch;
  globalThis.fetch = async () => ({
    status: 200,
    headers: new Headers({ "content-length": "3000000000" }),
    body: { getReader: () => ({ cancel: () => Promise.reject(new TypeError("network error")) }) },
  });
  try {
    await assert.rejects(new Pack(url).head(), kind("noRange"));
  } finally {
    globalThis.fetch = real;
  }
});

/** A good server that has addresses for several ranges, the answer to these changed by `change`; what was asked for is kept in `asked`. */
function several(asked, change = () => ({})) {
  return (request, response) => {
    asked.push(request.headers.range ?? request.url);
    const [, list] = /\.kilwa\/([^?]*)/.exec(request.url) ?? [];
    if (!list) return good(({ headers }) => ({ headers: { ...headers, "kilwa-ranges": "64" } }))(request, response);
    const body = Buffer.concat(
      list
        .split(",")
        .map((r) => r.split("-").map(Number))
        .map(([a, b]) => FILE.subarray(a, b + 1)),
    );
    const answer = { status: 200, headers: { etag: '"1"' }, body };
    const changed = { ...answer, ...change(answer) };
    response.writeHead(changed.status, { "content-length": changed.length ?? changed.body.length, ...changed.headers });
    if (changed.length > changed.body.length) response.write(changed.body, () => response.destroy());
    else response.end(changed.body);
  };
}

const PARTS = Buffer.concat([FILE.subarray(200_000, 200_100), FILE.subarray(90_000, 90_050)]);
const ofParts = (pack) => pack.range(200_000, PARTS.length, undefined, { ranges: "200000-200099,90000-90049" });

test("where the server has addresses for it several ranges come in one answer, in the order asked for", async () => {
  const asked = [];
  behave = several(asked);
  const pack = new Pack(new URL(`${url}?key=1`));
  await pack.head();
  assert.equal(pack.maxRanges, 64);
  assert.deepEqual(Buffer.from(await ofParts(pack)), PARTS);
  assert.deepEqual(asked, ["bytes=0-65535", "/a.kilwa/200000-200099,90000-90049?key=1"]);
  assert.equal(pack.received, PARTS.length);
  // Near the end of the file, first the last one: together they are longer than what follows their beginning.
  behave = several(asked);
  const near = await pack.range(299_000, 3000, undefined, { ranges: "299000-299999,100000-101999" });
  assert.deepEqual(Buffer.from(near), Buffer.concat([FILE.subarray(299_000), FILE.subarray(100_000, 102_000)]));
  await assert.rejects(pack.range(299_000, 3000, undefined, { ranges: "100000-101999,299001-300000" }), kind("cutOff"));
  // Who says nothing of it is asked for one range at a time.
  behave = good();
  const other = new Pack(url);
  await other.head();
  assert.equal(other.maxRanges, 1);
});

test("a server that answers several ranges wrongly is asked for one at a time from then on, and nothing wrong is taken", async () => {
  for (const change of [
    () => ({ status: 404 }),
    () => ({ status: 403 }),
    () => ({ status: 410 }),
    () => ({ status: 414 }),
    () => ({ status: 400 }),
    () => ({ status: 206, headers: { etag: '"1"', "content-range": `bytes 200000-200099/${FILE.length}` } }),
    () => ({ headers: { etag: '"a page"' }, body: Buffer.from("<!doctype html>") }),
  ]) {
    behave = several([], change);
    const pack = new Pack(url);
    await pack.head();
    await assert.rejects(ofParts(pack), (error) => kind("server")(error) && isPassing(error), change.toString());
    assert.equal(pack.maxRanges, 1, change.toString());
    assert.deepEqual(Buffer.from(await pack.range(200_000, 100)), FILE.subarray(200_000, 200_100));
  }
});

test("an answer of several ranges that is too short, too long or refused for a while says so, and they may be asked for again", async () => {
  for (const [change, wanted] of [
    [({ body }) => ({ body: body.subarray(1) }), "truncated"],
    [({ body }) => ({ body: body.subarray(1), length: body.length }), "truncated"],
    [({ body }) => ({ body: Buffer.concat([body, body]) }), "truncated"],
    [() => ({ status: 500 }), "server"],
    [() => ({ status: 502 }), "server"],
  ]) {
    behave = several([], change);
    const pack = new Pack(url);
    await pack.head();
    await assert.rejects(ofParts(pack), (error) => kind(wanted)(error) && isPassing(error), change.toString());
    assert.equal(pack.maxRanges, 64);
    behave = several([]);
    assert.deepEqual(Buffer.from(await ofParts(pack)), PARTS);
  }
});
