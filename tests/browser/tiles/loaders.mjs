// loaders.gl chooses, loads and decodes tiles; three.js draws what it has chosen. deck.gl is not used, because its views are of web maps: it places each tile
// by a projection of its own.

import { Tiles3DLoader } from "@loaders.gl/3d-tiles";
import { load } from "@loaders.gl/core";
import { Tileset3D } from "@loaders.gl/tiles";
import { Vector3 } from "@math.gl/core";
import { Ellipsoid } from "@math.gl/geospatial";
import { BufferAttribute, BufferGeometry, Frustum, Matrix4, Mesh, MeshBasicMaterial } from "three";
import { HEIGHT, WIDTH } from "./picture.mjs";
import { stage } from "./three.mjs";

const { scene, camera, look, draw } = stage();
const material = new MeshBasicMaterial({ vertexColors: true });
const meshes = new Map();
let tileset;
let failures = 0;

/** A camera as loaders.gl asks for it: the world is geocentric, in metres; longitudes and latitudes are in degrees. */
class GeocentricViewport {
  id = "view";
  width = WIDTH;
  height = HEIGHT;
  distanceScales = { metersPerUnit: [1, 1, 1] };

  /** loaders.gl makes another one, looking down, of which it takes nothing with these tilesets. */
  constructor() {
    this.cameraPosition = new Vector3(camera.position.toArray());
    this.center = this.cameraPosition;
    const toEast = Ellipsoid.WGS84.eastNorthUpToFixedFrame(this.center).invert();
    const [, y, z] = [0, 1, 2].map((k) => new Vector3(camera.matrixWorld.elements.slice(4 * k, 4 * k + 3)));
    this.cameraDirection = toEast.transformAsVector(z.negate());
    this.cameraUp = toEast.transformAsVector(y);
  }

  unprojectPosition(position) {
    return Ellipsoid.WGS84.cartesianToCartographic(position);
  }

  /** Normals point outwards; `distance` is that of the plane along its normal from the origin. */
  getFrustumPlanes() {
    // About the camera, so that no plane is computed from numbers of millions of metres.
    const rotation = new Matrix4().extractRotation(camera.matrixWorld).invert();
    const { planes } = new Frustum().setFromProjectionMatrix(new Matrix4().multiplyMatrices(camera.projectionMatrix, rotation));
    const names = ["right", "left", "bottom", "top", "far", "near"];
    return Object.fromEntries(
      planes.map((plane, k) => {
        const normal = new Vector3(plane.normal.toArray()).negate();
        return [names[k], { normal, distance: plane.constant + normal.dot(this.cameraPosition) }];
      }),
    );
  }
}

/** The meshes of a tile's glTF below its model matrix; all its nodes have one mesh, and no parents. */
function meshesOf({ content }) {
  const { gltf, cartesianModelMatrix } = content;
  return gltf.scenes[0].nodes.flatMap((node) =>
    node.mesh.primitives.map(({ attributes, indices }) => {
      const geometry = new BufferGeometry();
      geometry.setAttribute("position", new BufferAttribute(attributes.POSITION.value, 3));
      const { value, size, normalized } = {
        normalized: true,
        size: attributes.COLOR_0.value.length / (attributes.POSITION.value.length / 3),
        ...attributes.COLOR_0,
      };
      geometry.setAttribute("color", new BufferAttribute(value, size, normalized));
      geometry.setIndex(new BufferAttribute(indices.value, 1));
      const mesh = new Mesh(geometry, material);
      mesh.matrixAutoUpdate = false;
      mesh.matrix.fromArray(cartesianModelMatrix).multiply(new Matrix4().makeTranslation(...(node.translation ?? [0, 0, 0])));
      mesh.frustumCulled = false;
      return mesh;
    }),
  );
}

function unload(tile) {
  for (const mesh of meshes.get(tile.id) ?? []) {
    scene.remove(mesh);
    mesh.geometry.dispose();
  }
  meshes.delete(tile.id);
}

globalThis.client = {
  async open(url) {
    for (const id of [...meshes.keys()]) unload({ id });
    const options = { core: { worker: false } };
    tileset = new Tileset3D(await load(url, Tiles3DLoader, options), {
      loadOptions: options,
      onTileLoad: (tile) => {
        if (!tile.content?.gltf) return;
        meshes.set(tile.id, meshesOf(tile));
        scene.add(...meshes.get(tile.id));
      },
      onTileUnload: unload,
      onTileError: () => {
        failures += 1;
      },
    });
    return tileset.memoryAdjustedScreenSpaceError;
  },
  /** At rest: twice in a row it is loading nothing and has chosen the same tiles. */
  async show({ limit = tileset.memoryAdjustedScreenSpaceError, ...view }) {
    tileset.memoryAdjustedScreenSpaceError = limit;
    look(view);
    let before = "";
    for (let same = 0; same < 2; ) {
      await tileset.selectTiles([new GeocentricViewport()]);
      const shown = tileset.selectedTiles.map((tile) => tile.id).join();
      same = tileset.isLoaded() && shown === before ? same + 1 : 0;
      before = shown;
    }
    const chosen = tileset.selectedTiles;
    for (const [id, parts] of meshes) for (const mesh of parts) mesh.visible = chosen.some((tile) => tile.id === id);
    return {
      background: draw(),
      tiles: chosen.map((tile) => ({ uri: tile.contentUrl, error: tile.lodMetricValue })),
      limit: tileset.memoryAdjustedScreenSpaceError,
      failures,
    };
  },
};
