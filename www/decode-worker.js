// A worker: checks and decodes chunks. The compiled module comes from the page, once for all workers.
import init, { decode } from "./decode.js";

/** @type {Promise<unknown>} */
let ready;
let isReady = false;
/** Chunks of points (codec 3) have a decoder of their own, which is loaded when it is needed. @type {Promise<typeof decode> | undefined} */
let points;

async function ofPoints() {
  isReady = false; // until it is there: the page replaces a worker whose program did not come
  const module = await import("./decode-points.js");
  await module.default({ module_or_path: new URL("decode-points_bg.wasm", import.meta.url) });
  isReady = true;
  return module.decode;
}

/** @param {MessageEvent} event */
async function take({ data }) {
  if (data.module) {
    ready = init({ module_or_path: data.module }).then(() => (isReady = true));
    ready.catch(() => {}); // The first job reports it.
    return;
  }
  const { job, bytes, vertices, triangles, colors, scalars, checksum } = data;
  try {
    await ready;
    if (bytes[0] === 3) points ??= ofPoints();
    const from = (bytes[0] === 3 && (await points)) || decode;
    const decoded = from(bytes, vertices, triangles, colors, scalars, checksum);
    const out = {
      job,
      vertices: decoded.takeVertices(),
      indices: decoded.takeIndices(),
      patches: decoded.takePatches(),
      scalars: decoded.takeScalars(),
    };
    decoded.free();
    postMessage(out, { transfer: [out.vertices.buffer, out.indices.buffer, out.patches.buffer, out.scalars.buffer] });
  } catch (error) {
    // A trap leaves the instance unusable: the page then starts another worker.
    postMessage({ job, error: String(error?.message ?? error), broken: !isReady || error instanceof WebAssembly.RuntimeError });
  }
}

addEventListener("message", take);
