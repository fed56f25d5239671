// CesiumJS without its globe and sky, with its own limit.

import { Cartesian3, Cesium3DTileset, CesiumWidget, Color, PerspectiveFrustum } from "cesium";
import { FAR, FIELD_OF_VIEW, HEIGHT, NEAR, WIDTH, background, breath } from "./picture.mjs";

const place = document.createElement("div");
place.style.cssText = `width: ${WIDTH}px; height: ${HEIGHT}px`;
document.body.append(place);
const widget = new CesiumWidget(place, {
  baseLayer: false,
  globe: false,
  skyBox: false,
  skyAtmosphere: false,
  useDefaultRenderLoop: false,
  msaaSamples: 1,
  contextOptions: { webgl: { antialias: false } },
});
widget.resize();
const { scene } = widget;
const { camera } = scene;
scene.backgroundColor = Color.MAGENTA;
scene.postProcessStages.fxaa.enabled = false;
scene.screenSpaceCameraController.enableInputs = false;
scene.screenSpaceCameraController.enableCollisionDetection = false;
// CesiumJS counts the angle along the longer side.
const fov = 2 * Math.atan((Math.tan((FIELD_OF_VIEW * Math.PI) / 360) * WIDTH) / HEIGHT);
camera.frustum = new PerspectiveFrustum({ fov, aspectRatio: WIDTH / HEIGHT, near: NEAR, far: FAR });

let tileset;
let failures = 0;
let visible = [];

globalThis.client = {
  async open(url) {
    if (tileset) scene.primitives.remove(tileset);
    tileset = await Cesium3DTileset.fromUrl(url, { preloadWhenHidden: true });
    tileset.tileVisible.addEventListener((tile) => visible.push(tile));
    tileset.tileFailed.addEventListener(() => {
      failures += 1;
    });
    scene.primitives.add(tileset);
    return tileset.maximumScreenSpaceError;
  },
  /** At rest: everything is loaded, and the same tiles are shown as in the frame before. */
  async show({ eye, target, up, limit = tileset.maximumScreenSpaceError }) {
    tileset.maximumScreenSpaceError = limit;
    const direction = Cartesian3.normalize(Cartesian3.subtract(new Cartesian3(...target), new Cartesian3(...eye), new Cartesian3()), new Cartesian3());
    const right = Cartesian3.normalize(Cartesian3.cross(direction, new Cartesian3(...up), new Cartesian3()), new Cartesian3());
    const orientation = { direction, up: Cartesian3.cross(right, direction, new Cartesian3()) };
    camera.setView({ destination: new Cartesian3(...eye), orientation });
    // While tiles are loaded, nothing is drawn: software takes long to draw.
    tileset.show = false;
    do {
      widget.render();
      await breath();
    } while (!tileset.tilesLoaded);
    tileset.show = true;
    let before = null;
    let bits = "";
    for (let isAtRest = false; !isAtRest; ) {
      visible = [];
      widget.render();
      bits = background(scene.canvas.getContext("webgl2"));
      const shown = visible.map((tile) => tile.content.url).join();
      isAtRest = tileset.tilesLoaded && shown === before;
      before = shown;
      await breath();
    }
    return {
      background: bits,
      tiles: visible.map((tile) => ({ uri: tile.content.url, error: tile.geometricError })),
      limit: tileset.maximumScreenSpaceError,
      failures,
    };
  },
};
