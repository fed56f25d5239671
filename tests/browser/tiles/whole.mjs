// The finest surface in one piece (`kilwa extract -o whole.glb`), drawn at once: the pixels that it covers are what the clients are compared with. The borders
// of the surface are drawn in the colour of the background, in front of everything: coarse levels may open a hole that is narrower than a pixel here.

import { BufferAttribute, BufferGeometry, LineBasicMaterial, LineSegments, MeshBasicMaterial } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { stage } from "./three.mjs";

const { scene, look, draw } = stage();

/** The edges that only one triangle has, as lines. */
function borders({ attributes, index }) {
  const corners = index.array;
  const number = (a, b) => corners[a] * attributes.position.count + corners[b];
  const edges = new Set();
  const each = (visit) => {
    for (let first = 0; first < corners.length; first += 3) for (let k = 0; k < 3; k += 1) visit(first + k, first + ((k + 1) % 3));
  };
  each((a, b) => edges.add(number(a, b)));
  const lines = [];
  each((a, b) => edges.has(number(b, a)) || lines.push(corners[a], corners[b]));
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", attributes.position);
  geometry.setIndex(new BufferAttribute(Uint32Array.from(lines), 1));
  return geometry;
}

globalThis.client = {
  async open(url) {
    const { scene: model } = await new GLTFLoader().loadAsync(url);
    // glTF has y up, the tilesets z.
    model.rotation.x = Math.PI / 2;
    const parts = [];
    model.traverse((part) => part.isMesh && parts.push(part));
    for (const part of parts) {
      part.material = new MeshBasicMaterial({ vertexColors: true });
      const lines = new LineSegments(borders(part.geometry), new LineBasicMaterial({ color: 0xff00ff, depthTest: false, transparent: true }));
      part.add(lines);
    }
    scene.add(model);
  },
  async show(view) {
    look(view);
    return { background: draw(), tiles: [] };
  },
};
