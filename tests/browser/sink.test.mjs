// Files that are written while they are made: to a place that the person chose, or into parts; and pictures wider than any canvas.

import assert from "node:assert/strict";
import { test } from "node:test";
import { inflateSync } from "node:zlib";
import { PngWriter } from "../../www/png.js";
import { BlobSink, openSink } from "../../www/sink.js";

const LARGE = { name: "plan.tif", type: "image/tiff", bytes: 1e9 };

/** A file as the browser gives one: what was written to it, and where. */
function picker({ fails = null } = {}) {
  const file = { bytes: Buffer.alloc(0), closed: false, aborted: false, asked: null };
  const writable = {
    write: async (what) => {
      if (fails) throw fails;
      const [at, data] = what.type === "write" ? [what.position, what.data] : [file.bytes.length, what];
      const end = Math.max(file.bytes.length, at + data.length);
      file.bytes = Buffer.concat([file.bytes, Buffer.alloc(end - file.bytes.length)]);
      file.bytes.set(data, at);
    },
    close: async () => (file.closed = true),
    abort: async () => (file.aborted = true),
  };
  globalThis.showSaveFilePicker = async (options) => {
    file.asked = options;
    return { createWritable: async () => writable };
  };
  return file;
}

test("a large file goes straight to where the person wants it, its head last, and is not offered for download after", async () => {
  const file = picker();
  try {
    const sink = await openSink(LARGE);
    await sink.write(new Uint8Array([0, 0, 3, 4]));
    await sink.write(new Uint8Array());
    await sink.write(new Uint8Array([5]));
    await sink.head(new Uint8Array([1, 2]));
    assert.equal(await sink.end(), null);
    assert.deepEqual([...file.bytes], [1, 2, 3, 4, 5]);
    assert.ok(file.closed);
    assert.deepEqual(file.asked, { suggestedName: "plan.tif", types: [{ accept: { "image/tiff": [".tif"] } }] });
  } finally {
    delete globalThis.showSaveFilePicker;
  }
});

test("a small file, a browser without a file picker, and a click too long ago give parts that make one file; cancelling the picker is no error", async () => {
  const whole = async (sink) => {
    assert.ok(sink instanceof BlobSink);
    sink.write(new Uint8Array([0, 0, 3]));
    sink.write(new Uint8Array([4]));
    sink.head(new Uint8Array([1, 2]));
    const blob = await sink.end();
    assert.equal(blob.type, "image/tiff");
    assert.deepEqual([...new Uint8Array(await blob.arrayBuffer())], [1, 2, 3, 4]);
  };
  await whole(await openSink(LARGE));
  const file = picker();
  try {
    await whole(await openSink({ ...LARGE, bytes: 1e6 }));
    assert.equal(file.asked, null);
    globalThis.showSaveFilePicker = async () => Promise.reject(new DOMException("no press", "SecurityError"));
    await whole(await openSink(LARGE));
    globalThis.showSaveFilePicker = async () => Promise.reject(new DOMException("left", "AbortError"));
    await assert.rejects(openSink(LARGE), { name: "AbortError" });
  } finally {
    delete globalThis.showSaveFilePicker;
  }
});

/** Pixels of a PNG whose rows are all of filter 2, and the sizes of its parts. */
function read(bytes) {
  const [parts, names] = [[], []];
  for (let at = 8; at < bytes.length; ) {
    const length = bytes.readUInt32BE(at);
    const name = bytes.toString("latin1", at + 4, at + 8);
    names.push(name);
    if (name === "IDAT") parts.push(bytes.subarray(at + 8, at + 8 + length));
    at += length + 12;
  }
  const [width, height] = [bytes.readUInt32BE(16), bytes.readUInt32BE(20)];
  const data = inflateSync(Buffer.concat(parts));
  const line = width * 3;
  const pixels = Buffer.alloc(line * height);
  for (let y = 0; y < height; y += 1) {
    assert.equal(data[y * (line + 1)], 2);
    for (let i = 0; i < line; i += 1) pixels[y * line + i] = data[y * (line + 1) + 1 + i] + (y > 0 ? pixels[(y - 1) * line + i] : 0);
  }
  return { width, height, pixels, parts: parts.map((p) => p.length), names };
}

test("a picture wider than 16,384 pixels is written band by band and holds its pixels", async () => {
  const [width, height, rows] = [20_011, 60, 13];
  const mixed = (n) => Math.imul(n ^ (n >>> 15), 2246822519);
  const pixel = (x, y, c) => mixed(mixed(x * 3 + c) + Math.imul(y + 1, 40503)) >>> 24;
  const png = new PngWriter(width, height, { dotsPerMetre: 11811 });
  for (let top = 0; top < height; top += rows) {
    const count = Math.min(rows, height - top);
    const band = new Uint8Array(width * count * 4).fill(255);
    for (let y = 0; y < count; y += 1) for (let x = 0; x < width; x += 1) for (let c = 0; c < 3; c += 1) band[(y * width + x) * 4 + c] = pixel(x, top + y, c);
    await png.rows(band);
  }
  const found = read(Buffer.from(await (await png.end()).arrayBuffer()));
  assert.deepEqual([found.width, found.height], [width, height]);
  assert.equal(found.names.at(-1), "IEND");
  assert.ok(found.parts.length > 2 && Math.max(...found.parts) < 2 << 20, `${found.parts}`);
  for (let at = 0; at < width * height; at += 997)
    for (let c = 0; c < 3; c += 1) assert.equal(found.pixels[at * 3 + c], pixel(at % width, Math.floor(at / width), c));
});

test("a full disk ends the picture with that reason, and nothing waits for ever", async () => {
  const full = new DOMException("the disk is full", "QuotaExceededError");
  const file = picker({ fails: full });
  try {
    const sink = await openSink(LARGE);
    const png = new PngWriter(3000, 4000, { sink });
    const band = Uint8Array.from({ length: 3000 * 500 * 4 }, (_, i) => Math.imul(i, 2654435761) >>> 24);
    const writing = (async () => {
      for (let k = 0; k < 8; k += 1) await png.rows(band);
      await png.end();
    })();
    await assert.rejects(writing, { name: "QuotaExceededError" });
    await sink.abort();
    assert.ok(file.aborted && !file.closed);
  } finally {
    delete globalThis.showSaveFilePicker;
  }
});
