// Reads a PNG of eight bits per channel: what the page saves, what `kilwa render` writes, and screenshots of the browser.

import assert from "node:assert/strict";
import { inflateSync } from "node:zlib";

const CHANNELS = { 0: 1, 2: 3, 4: 2, 6: 4 };

/**
 * Width and height, channels of a pixel (3: red, green, blue; 4: alpha, too), the pixels with that many bytes each, rows from the top, and the chunks of the
 * file in their order: `{ type, data }`. `at(x, y)` is one pixel.
 */
export function decodePng(bytes) {
  assert.equal(bytes.subarray(0, 8).toString("hex"), "89504e470d0a1a0a", "a PNG");
  const chunks = [];
  for (let at = 8; at < bytes.length; ) {
    const length = bytes.readUInt32BE(at);
    chunks.push({ type: bytes.toString("latin1", at + 4, at + 8), data: bytes.subarray(at + 8, at + 8 + length) });
    at += 12 + length;
  }
  assert.equal(chunks[0].type, "IHDR");
  assert.equal(chunks.at(-1).type, "IEND");
  const head = chunks[0].data;
  const [width, height, channels] = [head.readUInt32BE(0), head.readUInt32BE(4), CHANNELS[head[9]]];
  assert.deepEqual([head[8], head[12]], [8, 0], "eight bits per channel, not interlaced");
  const raw = inflateSync(Buffer.concat(chunks.filter((c) => c.type === "IDAT").map((c) => c.data)));
  const pixels = unfilter(raw, width * channels, height, channels);
  return { width, height, channels, pixels, chunks, at: (x, y) => [...pixels.subarray((y * width + x) * channels, (y * width + x + 1) * channels)] };
}

/** Rows of `line` bytes, each of which came after the number of its filter (PNG, section 9.2). */
function unfilter(raw, line, height, channels) {
  assert.equal(raw.length, height * (line + 1));
  const pixels = Buffer.alloc(height * line);
  let above = Buffer.alloc(line);
  for (let y = 0; y < height; y += 1) {
    const filter = raw[y * (line + 1)];
    const row = pixels.subarray(y * line, (y + 1) * line);
    raw.copy(row, 0, y * (line + 1) + 1, (y + 1) * (line + 1));
    for (let i = 0; i < line && filter > 0; i += 1) {
      const [a, b, c] = i < channels ? [0, above[i], 0] : [row[i - channels], above[i], above[i - channels]];
      if (filter === 1) row[i] += a;
      else if (filter === 2) row[i] += b;
      else if (filter === 3) row[i] += (a + b) >> 1;
      else row[i] += paeth(a, b, c);
    }
    above = row;
  }
  return pixels;
}

function paeth(a, b, c) {
  const [pa, pb, pc] = [Math.abs(b - c), Math.abs(a - c), Math.abs(a + b - 2 * c)];
  if (pa <= pb && pa <= pc) return a;
  return pb <= pc ? b : c;
}
