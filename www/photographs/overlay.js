// A photograph over the picture of its own view. From where it was taken, what a pixel shows depends on its direction only: the photograph is a net of
// directions (lens.js) that the graphics card draws for the camera of the page, so that distorted photographs and panoramas fit too.

import { linked } from "../gl-program.js";
import { t } from "../i18n.js";
import { net } from "./lens.js";

/** @import { Axes } from "./pose.js" */
/** @import { Lens } from "./lens.js" */

const VERTEX = `#version 300 es
in vec3 direction;
in vec2 place;
uniform mat3 view;
out vec2 at;
void main() {
  vec3 seen = view * direction;
  at = place;
  gl_Position = vec4(seen.xy, 0.0, seen.z);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec2 at;
uniform sampler2D photograph;
out vec4 colour;
void main() { colour = vec4(texture(photograph, at).rgb, 1.0); }`;

export class Overlay {
  #corners = 0;
  /** @type {WebGL2RenderingContext} */
  #gl;
  #view;

  /** Its canvas is added to the page by whoever made it, when it shows something. @param {Lens} lens */
  constructor(lens) {
    const canvas = Object.assign(document.createElement("canvas"), { className: "photo-overlay", ariaHidden: "true" });
    this.canvas = canvas;
    const gl = canvas.getContext("webgl2", { alpha: true, antialias: false, premultipliedAlpha: true, preserveDrawingBuffer: true });
    if (!gl) throw new Error(t("photographNoWebgl"));
    this.#gl = gl;
    const program = linked(gl, VERTEX, FRAGMENT);
    gl.useProgram(program);
    this.#view = gl.getUniformLocation(program, "view");
    const { directions, places, corners } = net(lens);
    for (const [name, data, numbers] of /** @type {[string, Float32Array<ArrayBuffer>, number][]} */ ([
      ["direction", directions, 3],
      ["place", places, 2],
    ])) {
      const at = gl.getAttribLocation(program, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, numbers, gl.FLOAT, false, 0, 0);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, corners, gl.STATIC_DRAW);
    this.#corners = corners.length;
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
  }

  /**
   * Show these pixels, or fewer where the graphics card takes fewer. The picture is closed.
   * @param {ImageBitmap} picture
   */
  async set(picture) {
    const gl = this.#gl;
    const share = gl.getParameter(gl.MAX_TEXTURE_SIZE) / Math.max(picture.width, picture.height);
    let shown = picture;
    if (share < 1) {
      const [resizeWidth, resizeHeight] = [picture.width, picture.height].map((side) => Math.max(1, Math.floor(side * share)));
      shown = await createImageBitmap(picture, { resizeWidth, resizeHeight, resizeQuality: "high" });
      picture.close();
    }
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, shown);
    gl.generateMipmap(gl.TEXTURE_2D);
    shown.close();
  }

  /**
   * Draw it for a camera of the page.
   * @param {Axes} camera axes of the page's camera in the axes of the photograph's
   * @param {{width: number, height: number, tangent: number}} picture pixels, and the tangent of half the vertical opening angle
   */
  draw({ right, up, forward }, { width, height, tangent }) {
    const gl = this.#gl;
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    const rows = [right.map((v) => (v * height) / (width * tangent)), up.map((v) => v / tangent), forward];
    // Column after column.
    gl.uniformMatrix3fv(
      this.#view,
      false,
      [0, 1, 2].flatMap((k) => rows.map((row) => row[k])),
    );
    gl.drawElements(gl.TRIANGLES, this.#corners, gl.UNSIGNED_SHORT, 0);
  }

  close() {
    this.#gl.getExtension("WEBGL_lose_context")?.loseContext();
    this.canvas.remove();
  }
}
