// 3d-tiles-renderer with three.js, as its documentation says, with its own limit unless a view has another.

import { TilesRenderer } from "3d-tiles-renderer";
import { GLTFExtensionsPlugin } from "3d-tiles-renderer/plugins";
import { AmbientLight } from "three";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";
import { breath } from "./picture.mjs";
import { stage } from "./three.mjs";

const { renderer, scene, camera, look, draw } = stage();
scene.add(new AmbientLight(0xffffff, 3));
let tiles;
let failures = 0;

globalThis.client = {
  async open(url) {
    if (tiles) {
      scene.remove(tiles.group);
      tiles.dispose();
    }
    tiles = new TilesRenderer(url);
    tiles.registerPlugin(new GLTFExtensionsPlugin({ meshoptDecoder: MeshoptDecoder }));
    tiles.setCamera(camera);
    tiles.setResolutionFromRenderer(camera, renderer);
    tiles.addEventListener("load-error", () => {
      failures += 1;
    });
    scene.add(tiles.group);
    return tiles.errorTarget;
  },
  /** At rest: ten times in a row it is loading nothing and shows the same tiles. Twice was not always enough: CI once drew a view with tiles missing. */
  async show({ limit = tiles.errorTarget, ...view }) {
    tiles.errorTarget = limit;
    look(view);
    let before = "";
    for (let same = 0; same < 10; ) {
      tiles.update();
      const shown = [...tiles.visibleTiles].map((tile) => tile.content.uri).join();
      same = tiles.root && !tiles.isLoading && shown === before ? same + 1 : 0;
      before = shown;
      await breath();
    }
    const chosen = [...tiles.visibleTiles].map((tile) => ({ uri: tile.content.uri, error: tile.geometricError }));
    return { background: draw(), tiles: chosen, limit: tiles.errorTarget, failures };
  },
};
