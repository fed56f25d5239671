// Drawings to scale: plans and elevations as PNG, PDF or TIFF (GeoTIFF for plans) of any size. The worker that measures makes them (measure/drawing.js) as
// `kilwa render --scale` does; here the parts that it requests are rendered, and its output is kept.

import { PngWriter } from "./png.js";
import { detail } from "./screenshot.js";

/** @import { Pixels, SheetAsked, SheetHost, SheetMade, Sink, Viewer } from "./types/page.js" */
/** @import { Engine } from "./measure/engine.js" */
/** @import { Session } from "./session.js" */

export const TYPES = { png: "image/png", pdf: "application/pdf", tif: "image/tiff" };

/**
 * @param {{viewer: Viewer, session: Session}} scene
 * @param {Engine} engine
 * @param {Omit<SheetAsked, "widest" | "direction">} asked
 * @param {{open: (bytes: number) => Promise<Sink>, onProgress?: (part: number) => void, signal?: AbortSignal, texts?: Record<string, string>}} how `open` gives
 *   the place (sink.js) for a file of at most about that many bytes; `texts` are for a PNG
 * @returns {Promise<SheetMade & {blob: Blob | null}>} no blob if the file was saved where the person wanted it
 */
export async function drawSheet({ viewer, session }, engine, asked, { open, onProgress = () => {}, signal, texts }) {
  const camera = viewer.camera();
  const display = viewer.displayState();
  /** @type {Promise<Sink> | undefined} */
  let place;
  /** @type {PngWriter | undefined} */
  let png;
  /** The part that is being rendered, or was rendered last. @type {Promise<unknown> | undefined} */
  let part;
  /** @type {SheetHost} */
  const host = {
    async open(ended, [width, height]) {
      place = open(width * height * 3);
      const sink = await place;
      ended.throwIfAborted();
      if (asked.format === "png") png = new PngWriter(width, height, { texts, dotsPerMetre: asked.dpi / 0.0254, sink });
      viewer.setDisplayState(JSON.stringify({ ...JSON.parse(display), background: "white" }));
    },
    part(ended, x, y, z, halfHeight, width, height) {
      const render = async () => {
        viewer.aimSheet(asked.view, x, y, z, halfHeight);
        viewer.setPicture(width, height);
        await detail(session, () => {}, ended);
        const { targetReached, worstErrorMetres, trianglesDrawn } = session.stats ?? {};
        /** @type {Pixels} */
        const { pixels } = await viewer.renderTile(width, height, 0, 0, width, height);
        return [pixels, targetReached, worstErrorMetres, trianglesDrawn];
      };
      part = render();
      return part;
    },
    rows: async (_, rgb) => png?.rows(rgb, 3),
    write: async (_, bytes) => (await place)?.write(bytes),
    head: async (_, bytes) => (await place)?.head(bytes),
  };
  const direction = /** @type {CanvasDirection} */ (document.dir || "ltr");
  try {
    const made = await engine.drawing({ ...asked, direction, widest: viewer.maxTile() }, host, {
      progress: ({ done = 0, all = 1 }) => onProgress(done / all),
      signal,
    });
    return { ...made, blob: (await (png ?? (await place))?.end()) ?? null };
  } catch (error) {
    const sink = await place?.catch(() => null);
    await sink?.abort();
    throw error;
  } finally {
    // A drawing that ended early may still be rendering.
    await part?.catch(() => {});
    if (!session.closed) {
      viewer.setPicture(0, 0);
      viewer.setCamera(camera);
      viewer.setDisplayState(display);
      session.wake();
    }
  }
}
