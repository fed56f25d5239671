// Where to look from, and what is a crack in a picture.

import assert from "node:assert/strict";
import { HEIGHT, WIDTH } from "./picture.mjs";

/** Numbers from 0 to 1 that look random and are the same every time (mulberry32). */
function numbers(seed) {
  let state = seed;
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let t = Math.imul(state ^ (state >>> 15), 1 | state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return ((t ^ (t >>> 14)) >>> 0) / 2 ** 32;
  };
}

/** `count` views of what is in a sphere `[x, y, z, radius]`, from close by to far away, from just above the ground to steeply down; z is up. */
export function viewsOf([x, y, z, radius], count, seed = 26) {
  const random = numbers(seed);
  return Array.from({ length: count }, () => {
    const [east, north] = [0, 1].map(() => (random() - 0.5) * radius * 0.8);
    const [azimuth, elevation] = [random() * 2 * Math.PI, ((8 + random() * 62) * Math.PI) / 180];
    const away = radius * 0.4 * 10 ** (random() * 0.6);
    const target = [x + east, y + north, z];
    const direction = [Math.sin(azimuth) * Math.cos(elevation), Math.cos(azimuth) * Math.cos(elevation), Math.sin(elevation)];
    return { target, eye: target.map((v, k) => v + direction[k] * away), up: [0, 0, 1] };
  });
}

/** A view through a matrix by columns, as 3D Tiles and glTF write it. */
export function moved({ eye, target, up }, m) {
  const apply = ([a, b, c], w) => [0, 1, 2].map((k) => m[k] * a + m[4 + k] * b + m[8 + k] * c + m[12 + k] * w);
  return { eye: apply(eye, 1), target: apply(target, 1), up: apply(up, 0) };
}

/** One byte for each pixel, 1 where the background is: of what `background` of picture.mjs returns. */
export function unpacked(base64) {
  const bits = Buffer.from(base64, "base64");
  assert.equal(bits.length * 8, WIDTH * HEIGHT);
  return Uint8Array.from({ length: WIDTH * HEIGHT }, (_, at) => (bits[at >> 3] >> (at & 7)) & 1);
}

/** Pixels that are set, or have one that is set at most `steps` away, along rows and columns. */
function widened(pixels, steps) {
  let now = pixels;
  for (const [along, across, stride, next] of [
    [WIDTH, HEIGHT, 1, WIDTH],
    [HEIGHT, WIDTH, WIDTH, 1],
  ]) {
    const wide = new Uint8Array(now.length);
    for (let line = 0; line < across; line += 1) {
      let last = -Infinity;
      for (let i = 0, at = line * next; i < along + steps; i += 1, at += stride) {
        if (i < along && now[at]) last = i;
        const middle = i - steps;
        if (middle >= 0 && last >= middle - steps) wide[at - steps * stride] = 1;
      }
    }
    now = wide;
  }
  return now;
}

/**
 * `inside`: how many pixels have nothing but surface within `margin` pixels in the picture of the whole model; `cracks`: those of them that show the
 * background in a client. Coarse levels may move an outline by the pixel that their error allows; a hole in the middle of a surface is no outline.
 */
export function cracksIn(shown, whole, margin) {
  const outside = widened(whole, margin);
  const cracks = [];
  let inside = 0;
  for (let at = 0; at < outside.length; at += 1) {
    if (outside[at]) continue;
    inside += 1;
    if (shown[at]) cracks.push([at % WIDTH, Math.floor(at / WIDTH)]);
  }
  return { inside, cracks };
}

/** How many different levels of detail are among tiles: their errors by powers of two, those without error together. */
export const levelsOf = (tiles) => new Set(tiles.map(({ error }) => (error === 0 ? "finest" : Math.round(Math.log2(error))))).size;
