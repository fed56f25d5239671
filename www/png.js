// PNG, written row by row: a picture larger than any canvas needs the memory of one strip. RFC 2083; deflate is the browser's.

const CRC = new Uint32Array(256).map((_, n) => {
  for (let k = 0; k < 8; k += 1) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
  return n;
});

function crc(parts) {
  let c = 0xffffffff;
  for (const part of parts) for (const byte of part) c = CRC[(c ^ byte) & 255] ^ (c >>> 8);
  return (c ^ 0xffffffff) >>> 0;
}

const number = (n) => new Uint8Array([n >>> 24, (n >>> 16) & 255, (n >>> 8) & 255, n & 255]);

function chunk(name, data) {
  const type = new TextEncoder().encode(name);
  return [number(data.length), type, data, number(crc([type, data]))];
}

export class PngWriter {
  /** A picture of 8 bits per channel, red, green, blue and, where `alpha`, alpha. `dotsPerMetre`: of paper, or 0. */
  constructor(width, height, { alpha = false, texts = {}, dotsPerMetre = 0 } = {}) {
    this.width = width;
    this.bytesPerPixel = alpha ? 4 : 3;
    const head = new Uint8Array(13);
    head.set(number(width), 0);
    head.set(number(height), 4);
    head.set([8, alpha ? 6 : 2, 0, 0, 0], 8);
    this.parts = [new Uint8Array([137, 80, 78, 71, 13, 10, 26, 10]), ...chunk("IHDR", head), ...chunk("sRGB", new Uint8Array([0]))];
    if (dotsPerMetre > 0) {
      const dots = number(Math.round(dotsPerMetre));
      this.parts.push(...chunk("pHYs", new Uint8Array([...dots, ...dots, 1])));
    }
    for (const [key, value] of Object.entries(texts)) {
      // iTXt: keyword, not compressed, no language; UTF-8.
      this.parts.push(...chunk("iTXt", new TextEncoder().encode(`${key}\0\0\0\0\0${value}`)));
    }
    const deflate = new CompressionStream("deflate");
    this.writer = deflate.writable.getWriter();
    this.data = new Response(deflate.readable).arrayBuffer();
    this.above = new Uint8Array(width * this.bytesPerPixel);
  }

  /** The next rows: four bytes per pixel. */
  async rows(pixels) {
    const { width, bytesPerPixel } = this;
    const count = pixels.length / (width * 4);
    const line = width * bytesPerPixel;
    const out = new Uint8Array(count * (line + 1));
    const row = new Uint8Array(line);
    for (let y = 0; y < count; y += 1) {
      for (let x = 0, from = y * width * 4, to = 0; x < width; x += 1, from += 4, to += bytesPerPixel) {
        row[to] = pixels[from];
        row[to + 1] = pixels[from + 1];
        row[to + 2] = pixels[from + 2];
        if (bytesPerPixel === 4) row[to + 3] = pixels[from + 3];
      }
      const at = y * (line + 1);
      out[at] = 2; // Up: what the row above does not say
      for (let i = 0; i < line; i += 1) out[at + 1 + i] = row[i] - this.above[i];
      this.above.set(row);
    }
    await this.writer.write(out);
  }

  /** @returns {Promise<Blob>} */
  async end() {
    await this.writer.close();
    const data = new Uint8Array(await this.data);
    const parts = [...this.parts, ...chunk("IDAT", data), ...chunk("IEND", new Uint8Array())];
    return new Blob(parts, { type: "image/png" });
  }
}
