// In the pages: three.js on magenta.

import { Color, PerspectiveCamera, Scene, WebGLRenderer } from "three";
import { FAR, FIELD_OF_VIEW, HEIGHT, NEAR, WIDTH, background, canvas } from "./picture.mjs";

/** A scene with a camera; `draw()` returns which pixels show the background. */
export function stage() {
  const renderer = new WebGLRenderer({ canvas: canvas(), antialias: false });
  renderer.setSize(WIDTH, HEIGHT, false);
  const scene = new Scene();
  scene.background = new Color(1, 0, 1);
  const camera = new PerspectiveCamera(FIELD_OF_VIEW, WIDTH / HEIGHT, NEAR, FAR);
  return {
    renderer,
    scene,
    camera,
    look({ eye, target, up }) {
      camera.position.fromArray(eye);
      camera.up.fromArray(up);
      camera.lookAt(...target);
      camera.updateMatrixWorld();
    },
    draw() {
      renderer.render(scene, camera);
      return background(renderer.getContext());
    },
  };
}
