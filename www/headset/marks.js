// What is drawn over the model in each eye: rays, dots, lines, rings and plates with text. WebGL 2, in the context that the viewer draws in: what it keeps
// between frames is put back.

import { linked } from "../gl-program.js";
import { card } from "./cards.js";
import { cross, dot, facing, minus, plus, times, unit } from "./vectors.js";

/** @import { Vector } from "./vectors.js" */

/** Where an eye is in the model, the axes of its picture and the tangents of its edges: left, right, down, up. @typedef {{position: Vector, right: Vector, up: Vector, tangents: number[]}} Eye */
/** Red, green, blue and opacity, 0 to 1. @typedef {[number, number, number, number]} Color */

const VERTEX = `#version 300 es
in vec3 place;
in vec4 color;
in vec2 edge;
in vec2 at;
uniform mat4 clip;
out vec4 shade;
out vec2 rim;
out vec2 spot;
void main() {
  shade = color;
  rim = edge;
  spot = at;
  gl_Position = clip * vec4(place, 1.0);
}`;
// Lines and dots end softly at the distance 1 from their middle: the picture of a headset has no other samples.
const FRAGMENT = `#version 300 es
precision highp float;
in vec4 shade;
in vec2 rim;
in vec2 spot;
uniform sampler2D plate;
out vec4 colour;
void main() {
  float r = length(rim);
  float inside = clamp((1.0 - r) / max(fwidth(r), 1e-4) + 0.5, 0.0, 1.0);
  colour = texture(plate, spot) * vec4(shade.rgb * shade.a, shade.a) * inside;
}`;
/** Numbers of a vertex, and those of its attributes. */
const STRIDE = 12;
/** @type {[name: string, numbers: number][]} */
const ATTRIBUTES = [
  ["place", 3],
  ["color", 4],
  ["edge", 2],
  ["at", 2],
];
/** Nothing nearer is drawn, metres. */
const NEAR = 0.02;
/** Radians: half the width of a line, and the radius of a dot. */
const [LINE, DOT] = [0.0016, 0.006];
/** Radians of a dash, with the gap behind it; and dashes of a line at most. */
const [DASH, MAX_DASHES] = [0.024, 200];
/** A ring has so many sides. */
const SIDES = 48;
/** Plates that are kept. */
const KEPT = 24;

export class Marks {
  #gl;
  #program;
  #clip;
  #array;
  #buffer;
  /** The array that the viewer has bound all the time: asking for it in every frame would wait for the graphics card. */
  #before;
  /** A white pixel, for what has no picture. */
  #plain;
  #canvas = document.createElement("canvas");
  /** By text. @type {Map<string, {texture: WebGLTexture, width: number, height: number}>} */
  #plates = new Map();
  /** @type {number[]} */
  #numbers = [];
  /** What is drawn with which picture. @type {{texture: WebGLTexture, first: number, count: number}[]} */
  #calls = [];
  /** Places are counted from here. @type {Vector} */
  #base = [0, 0, 0];
  /** Radians of half the width of a line. */
  #half = LINE;

  /** @param {WebGL2RenderingContext} gl */
  constructor(gl) {
    this.#gl = gl;
    const program = linked(gl, VERTEX, FRAGMENT);
    this.#program = program;
    this.#clip = gl.getUniformLocation(program, "clip");
    this.#before = gl.getParameter(gl.VERTEX_ARRAY_BINDING);
    this.#array = gl.createVertexArray();
    this.#buffer = gl.createBuffer();
    gl.bindVertexArray(this.#array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#buffer);
    let offset = 0;
    for (const [name, numbers] of ATTRIBUTES) {
      const at = gl.getAttribLocation(program, name);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, numbers, gl.FLOAT, false, 4 * STRIDE, 4 * offset);
      offset += numbers;
    }
    gl.bindVertexArray(this.#before);
    this.#plain = this.#texture((target) => gl.texImage2D(target, 0, gl.RGBA, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([255, 255, 255, 255])));
  }

  /** @param {(target: number) => void} fill */
  #texture(fill) {
    const gl = this.#gl;
    const texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    fill(gl.TEXTURE_2D);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.bindTexture(gl.TEXTURE_2D, null);
    return texture;
  }

  /**
   * Begin a frame, with nothing in it.
   * @param {Vector} base the middle of the eyes: places are counted from there
   * @param {number} pixel radians, which lines cover at least
   */
  begin(base, pixel) {
    this.#base = base;
    this.#half = Math.max(LINE, pixel * 0.7);
    this.#numbers = [];
    this.#calls = [];
  }

  /**
   * A quad by its corners: lower left, lower right, upper left, upper right.
   * @param {Vector[]} corners
   * @param {Color} color
   * @param {number[][]} edges
   * @param {WebGLTexture} texture
   */
  #quad(corners, color, edges, texture = this.#plain) {
    const last = this.#calls.at(-1);
    if (last?.texture === texture) last.count += 6;
    else this.#calls.push({ texture, first: this.#numbers.length / STRIDE, count: 6 });
    for (const k of [0, 1, 2, 2, 1, 3]) {
      // The last number is there for the alignment.
      this.#numbers.push(...minus(corners[k], this.#base), ...color, ...edges[k], k & 1, k & 2 ? 0 : 1, 0);
    }
  }

  /** @param {Vector} place */
  #far(place) {
    return Math.max(NEAR, Math.hypot(...minus(place, this.#base)));
  }

  /**
   * A line that is equally wide everywhere to the eye.
   * @param {Vector} from
   * @param {Vector} to
   * @param {Color} color
   * @param {number} width a multiple of the usual one
   */
  line(from, to, color, width = 1) {
    const along = minus(to, from);
    const side = (/** @type {Vector} */ place) => times(unit(cross(along, minus(place, this.#base))), this.#far(place) * this.#half * width);
    const [a, b] = [side(from), side(to)];
    const edges = [
      [-1, 0],
      [1, 0],
      [-1, 0],
      [1, 0],
    ];
    this.#quad([minus(from, a), plus(from, a), minus(to, b), plus(to, b)], color, edges);
  }

  /**
   * The same in dashes.
   * @param {Vector} from
   * @param {Vector} to
   * @param {Color} color
   */
  dashes(from, to, color) {
    const along = minus(to, from);
    const angle = Math.hypot(...along) / Math.max(0.1, Math.min(this.#far(from), this.#far(to)));
    const count = Math.min(MAX_DASHES, Math.max(1, Math.round(angle / DASH)));
    for (let k = 0; k < count; k += 1) this.line(plus(from, times(along, k / count)), plus(from, times(along, (k + 0.6) / count)), color);
  }

  /**
   * @param {Vector} place
   * @param {Color} color
   * @param {number} size a multiple of the usual one
   */
  dot(place, color, size = 1) {
    const { right, up } = facing(minus(place, this.#base));
    const radius = this.#far(place) * DOT * size;
    const edges = [
      [-1, -1],
      [1, -1],
      [-1, 1],
      [1, 1],
    ];
    this.#quad(
      edges.map(([x, y]) => plus(place, plus(times(right, x * radius), times(up, y * radius)))),
      color,
      edges,
    );
  }

  /**
   * A level ring.
   * @param {Vector} middle
   * @param {number} radius
   * @param {Color} color
   */
  ring(middle, radius, color) {
    const at = (/** @type {number} */ k) => {
      const angle = (2 * Math.PI * k) / SIDES;
      return plus(middle, [radius * Math.cos(angle), radius * Math.sin(angle), 0]);
    };
    for (let k = 0; k < SIDES; k += 1) this.line(at(k), at(k + 1), color, 2);
  }

  /**
   * A plate with text that faces the viewer; its lower edge is in its place.
   * @param {Vector} place
   * @param {string[]} text
   * @param {{line?: number, angle?: number}} size of a line of text: metres, or radians
   */
  plate(place, text, { line, angle = 0 }) {
    const { texture, width, height } = this.#plate(text);
    const { right, up } = facing(minus(place, this.#base));
    const unitOf = line ?? this.#far(place) * angle;
    const corner = (/** @type {number} */ x, /** @type {number} */ y) => plus(place, plus(times(right, x * width * unitOf), times(up, y * height * unitOf)));
    const middle = [0, 0];
    this.#quad([corner(-0.5, 0), corner(0.5, 0), corner(-0.5, 1), corner(0.5, 1)], [1, 1, 1, 1], [middle, middle, middle, middle], texture);
  }

  /** @param {string[]} text */
  #plate(text) {
    const gl = this.#gl;
    const key = text.join("\n");
    const known = this.#plates.get(key);
    if (known) return known;
    // Those of values that change go, the oldest first.
    for (const [old, { texture }] of this.#plates) {
      if (this.#plates.size < KEPT) break;
      if (this.#calls.some((call) => call.texture === texture)) continue;
      gl.deleteTexture(texture);
      this.#plates.delete(old);
    }
    const size = card(this.#canvas, text);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, true);
    const texture = this.#texture((target) => gl.texImage2D(target, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, this.#canvas));
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    const plate = { texture, ...size };
    this.#plates.set(key, plate);
    return plate;
  }

  /** All that was put together goes to the graphics card, once for all eyes. */
  upload() {
    const gl = this.#gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.#buffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(this.#numbers), gl.DYNAMIC_DRAW);
  }

  /**
   * Draw it in an eye, whose framebuffer is bound.
   * @param {Eye} eye
   * @param {{x: number, y: number, width: number, height: number}} viewport
   */
  draw({ position, right, up, tangents: [l, r, d, u] }, { x, y, width, height }) {
    const gl = this.#gl;
    const forward = cross(up, right);
    const off = minus(this.#base, position);
    const row = (/** @type {Vector} */ way) => [...way, dot(way, off)];
    const across = row(times(minus(times(right, 2), times(forward, l + r)), 1 / (r - l)));
    const upward = row(times(minus(times(up, 2), times(forward, d + u)), 1 / (u - d)));
    const depth = row(forward);
    const rows = [across, upward, [depth[0], depth[1], depth[2], depth[3] - 2 * NEAR], depth];
    for (const state of [gl.DEPTH_TEST, gl.SCISSOR_TEST, gl.CULL_FACE]) gl.disable(state);
    gl.viewport(x, y, width, height);
    gl.enable(gl.BLEND);
    gl.blendEquation(gl.FUNC_ADD);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.colorMask(true, true, true, true);
    gl.useProgram(this.#program);
    gl.bindVertexArray(this.#array);
    // Column after column.
    gl.uniformMatrix4fv(
      this.#clip,
      false,
      [0, 1, 2, 3].flatMap((k) => rows.map((numbers) => numbers[k])),
    );
    gl.activeTexture(gl.TEXTURE0);
    gl.bindSampler(0, null);
    for (const { texture, first, count } of this.#calls) {
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.drawArrays(gl.TRIANGLES, first, count);
    }
    gl.bindTexture(gl.TEXTURE_2D, null);
    gl.bindVertexArray(this.#before);
    gl.useProgram(null);
    gl.disable(gl.BLEND);
  }
}
