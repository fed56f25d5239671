// In the pages: the size of every picture, and which of its pixels show the background.

/** Pixels. Small, because the processor draws them. */
export const [WIDTH, HEIGHT] = [480, 360];
/** Angle of view from the lower edge of the picture to the upper one, in degrees. */
export const FIELD_OF_VIEW = 60;
/** Metres to the planes between which things are drawn. */
export const [NEAR, FAR] = [0.1, 1000];

/** A canvas that fills nothing but itself. */
export function canvas() {
  const element = document.createElement("canvas");
  element.width = WIDTH;
  element.height = HEIGHT;
  element.style.cssText = `display: block; width: ${WIDTH}px; height: ${HEIGHT}px`;
  document.body.append(element);
  return element;
}

/**
 * Which pixels are magenta: one bit for each, rows from the top, the first pixel in the lowest bit of the first byte; as base64. To be called in the task
 * that drew the picture, because it is gone afterwards.
 * @param {WebGL2RenderingContext} gl
 */
export function background(gl) {
  const pixels = new Uint8Array(WIDTH * HEIGHT * 4);
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.readPixels(0, 0, WIDTH, HEIGHT, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
  const bits = new Uint8Array((WIDTH * HEIGHT) / 8);
  for (let y = 0; y < HEIGHT; y += 1) {
    for (let x = 0; x < WIDTH; x += 1) {
      const from = ((HEIGHT - 1 - y) * WIDTH + x) * 4;
      const to = y * WIDTH + x;
      if (pixels[from] === 255 && pixels[from + 1] === 0 && pixels[from + 2] === 255) bits[to >> 3] |= 1 << (to & 7);
    }
  }
  let text = "";
  for (let at = 0; at < bits.length; at += 4096) text += String.fromCharCode(...bits.subarray(at, at + 4096));
  return btoa(text);
}

/** Until the browser has had time for other things: answers of the server, workers. */
export const breath = () => new Promise((resolve) => requestAnimationFrame(() => setTimeout(resolve)));
