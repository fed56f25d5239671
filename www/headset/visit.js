// One stay in the model with a headset: a picture for each eye, from a program of its own on a canvas of its own (WebXR draws through WebGL only), fed by a
// streaming session like that of the page; and what the controllers ask for.
//
// The viewer draws one eye after the other into the upper left corner of its canvas; each is copied from there into the headset's framebuffer. An emulator has
// no framebuffer but shows the canvas itself: then the copies are put together in a framebuffer of our own, and copied back.

import { t } from "../i18n.js";
import { Hands } from "./hands.js";
import { Marks } from "./marks.js";
import { Rig, standing } from "./rig.js";
import { Tape } from "./tape.js";
import { axesOf, dot, minus, plus, times, unit, vector } from "./vectors.js";

/** @import { Vector } from "./vectors.js" */
/** @import { Eye, Color } from "./marks.js" */
/** @import { Seen } from "./tape.js" */
/** @import { HeadsetViewer } from "./rig.js" */
/** @import { Command, FrameStats } from "../types/page.js" */
/** @typedef {import("../viewer-gl.js").Viewer & {frame: (now: number) => unknown, attend: (now: number) => unknown}} FedViewer */

/** Metres of a ray that meets nothing. */
const FAR = 30;
/** Milliseconds for which the help and a message are shown. */
const [HELP_MS, SAID_MS] = [25_000, 4000];
/** Metres of a line of the help; how far it is before the eyes, and above the hand. */
const [LETTERS, BEFORE, ABOVE] = [0.016, 0.9, 0.12];
/** Radians of a line of a message; how far it is away. */
const [SAID, SAID_FAR] = [0.03, 1.5];
/** Metres of the ring round a place to jump to. */
const RING = 0.35;
/** @type {Color} */
const RAY = [1, 1, 1, 0.75];
/** @type {Color} */
const EDGE = [0, 0, 0, 0.4];
/** @type {Color} */
const JUMP = [0.1, 0.75, 0.45, 0.95];

/** A picture of an eye, and where it is in the headset's. @typedef {{eye: Eye, numbers: number[], x: number, y: number, width: number, height: number}} Look */
/** What a stay needs of the page. @typedef {import("./headset.js").HeadsetPage} HeadsetPage */

export class Visit {
  #isOver = false;
  #rig = new Rig();
  #hands = new Hands();
  #tape;
  #marks;
  /** Of the last frame, as the viewer takes them. @type {Float64Array} */
  #eyes = new Float64Array();
  /** What the streaming session wants to do in the next frame. @type {((now: number) => void) | null} */
  #next = null;
  /** Numbers of pixels: the headset's picture, and the canvas. */
  #size = "";
  /** Where eyes are put together for an emulator. @type {{framebuffer: WebGLFramebuffer, renderbuffer: WebGLRenderbuffer} | null} */
  #own = null;
  /** When the last frame was, milliseconds; null before the first. @type {number | null} */
  #last = null;
  /** Where to stand, and where to look as a camera of this azimuth does, as soon as it is known where the head is. @type {{ground: Vector, azimuth: number} | null} */
  #entry;
  /** Until when the help is shown; and what is said, until when. */
  #helpUntil = Number.NaN;
  #said = { text: "", until: 0 };
  /** The ray of what points, and what it meets. @type {{origin: Vector, direction: Vector} | null} */
  #ray = null;
  /** @type {Seen | null} */
  #pointed = null;
  /** A place to jump to. @type {Vector | null} */
  #goal = null;
  #abort = new AbortController();

  /**
   * @param {object} parts
   * @param {XRSession} parts.session
   * @param {XRReferenceSpace} parts.space with the floor at its height 0
   * @param {WebGL2RenderingContext} parts.gl
   * @param {HeadsetViewer} parts.viewer on the same canvas
   * @param {HeadsetPage} parts.page
   * @param {(isWhole: boolean) => void} parts.shown a frame was drawn: with everything that it needs of the model, or without some of it
   * @param {(reason: string | null) => void} parts.ended why it ended, where nobody asked for that
   */
  constructor({ session, space, gl, viewer, page, shown, ended }) {
    this.session = session;
    this.space = space;
    this.gl = gl;
    this.viewer = viewer;
    this.page = page;
    this.shown = shown;
    this.ended = ended;
    const { model, scene } = page.current.opened;
    // The room has no other samples: the viewer has its own, and a copy of several samples is not possible.
    this.layer = new XRWebGLLayer(session, gl, { alpha: true, antialias: false, depth: false, stencil: false });
    session.updateRenderState({ baseLayer: this.layer, depthNear: 0.03 });
    this.#marks = new Marks(gl);
    this.#tape = new Tape(page.measuring, (text) => this.#say(text));
    this.#tape.load().catch(() => {}); // the first press reports it
    this.#entry = { ground: vector(scene.walk.place()), azimuth: scene.viewer.camera().azimuth };
    this.model = model;
    this.#show(page);
    const fed = Object.assign(viewer, {
      frame: (/** @type {number} */ now) => viewer.frameOfEyes(now, this.#eyes),
      attend: (/** @type {number} */ now) => viewer.attendEyes(now, this.#eyes),
    });
    this.streaming = this.#stream(page, /** @type {any} */ (fed));
    const { signal } = this.#abort;
    const on = (/** @type {EventTarget} */ target, /** @type {string} */ event, /** @type {(event: any) => void} */ act) =>
      target.addEventListener(event, act, { signal });
    on(session, "end", () => this.#over(null));
    on(session, "select", (event) => this.#guarded(() => this.#select(event)));
    on(session, "squeeze", () => this.#guarded(() => this.#tape.back()));
    // The person has given the room another middle: they stay where they are in the model.
    on(space, "reset", () => (this.#entry ??= this.#here));
    on(gl.canvas, "webglcontextlost", () => this.end(t("headsetLost")));
    // Another model, or the page's own picture was given up.
    const look = () => !scene.isOpen && this.end(t(page.current.model === model ? "headsetLost" : "headsetClosed"));
    scene.session.watchers.add(look);
    signal.addEventListener("abort", () => scene.session.watchers.delete(look));
    session.requestAnimationFrame(this.#loop);
  }

  /** What the page shows of the model, as the viewer gave it last. */
  #display = "";

  /** What is cut away in the page is cut away here: a measurement is made on what the page shows. */
  #follow() {
    const { scene, model } = this.page.current;
    if (!scene?.isOpen || model !== this.model) return;
    const display = scene.viewer.displayState();
    if (display !== this.#display) this.viewer.setDisplayState(display);
    this.#display = display;
  }

  /** The model as the page shows it. @param {HeadsetPage} page */
  #show({ current, settings }) {
    const { model } = current.opened;
    const { viewer } = this;
    if (model.isCutOff) viewer.setCutOff(Number(model.pack.bytes));
    viewer.setDark(matchMedia("(prefers-color-scheme: dark)").matches);
    viewer.setMemory(settings.memory * 1e6, settings.memory * 2e6);
    viewer.setTargetPixels(settings.detail);
  }

  /**
   * The page's own streaming session, whose frames are those of the headset.
   * @param {HeadsetPage} page
   * @param {import("../types/page.js").Viewer} viewer
   */
  #stream(page, viewer) {
    const { model, scene } = page.current.opened;
    // The class of the page's session: this part must not import its module, which every visitor would then load as a file of its own.
    const Session = /** @type {typeof import("../session.js").Session} */ (scene.session.constructor);
    const Fixed = class extends Session {
      /** The headset gives the canvas its size. @override */
      resize() {}
    };
    const { colors, scalars } = model.info.pack;
    return new Fixed({
      canvas: /** @type {HTMLCanvasElement} */ (this.gl.canvas),
      viewer,
      pack: model.pack,
      head: model.head,
      pool: page.newPool(),
      attributes: { colors, scalars },
      nextFrame: (draw) => {
        this.#next = draw;
      },
      on: {
        frame: (stats) => stats.lost && this.end(t("headsetLost")),
        first: () => {},
        waits: (seconds) => this.#say(t("offlineFirst", { seconds })),
        changed: () => this.end(t("changedTitle")),
        lost: (error) => this.#say(t(`${error.kind}Title`)),
        damaged: () => this.#say(t("damagedPart")),
        broken: (error) => this.end(error.message),
      },
    });
  }

  /** @param {string} text */
  #say(text) {
    this.#said = { text, until: performance.now() + SAID_MS };
  }

  /**
   * End it.
   * @param {string | null} reason where nobody asked for it
   */
  end(reason = null) {
    if (this.#isOver) return;
    this.#over(reason);
    this.session.end().catch(() => {}); // it has ended by itself
  }

  /** @param {string | null} reason */
  #over(reason) {
    if (this.#isOver) return;
    this.#isOver = true;
    this.#abort.abort();
    try {
      this.streaming.close();
    } finally {
      this.gl.getExtension("WEBGL_lose_context")?.loseContext();
      this.ended(reason);
    }
  }

  /** @param {() => void} action */
  #guarded(action) {
    if (this.#isOver) return;
    try {
      action();
    } catch (error) {
      this.end(error.message);
    }
  }

  /** @type {(time: number, frame: XRFrame) => void} */
  #loop = (time, frame) => {
    if (this.#isOver) return;
    this.session.requestAnimationFrame(this.#loop);
    const pose = frame.getViewerPose(this.space);
    // Where the headset does not know where it is, the last picture stays.
    if (pose) this.#guarded(() => this.#frame(time, frame, pose));
  };

  /** Of the head in the headset's space. */
  #head = { position: vector([0, 0, 0]), right: vector([1, 0, 0]), up: vector([0, 1, 0]), forward: vector([0, 0, -1]) };

  /** The floor below the head, and where the person looks, in the model. @returns {{ground: Vector, azimuth: number}} */
  get #here() {
    const { position, forward } = this.#head;
    const [east, north] = this.#rig.way(forward);
    return { ground: this.#rig.place([position[0], 0, position[2]]), azimuth: Math.atan2(-east, -north) };
  }

  /**
   * @param {number} time
   * @param {XRFrame} frame
   * @param {NonNullable<ReturnType<XRFrame["getViewerPose"]>>} pose
   */
  #frame(time, frame, pose) {
    this.#head = axesOf(pose.transform);
    const isFirst = this.#last === null;
    const seconds = Math.max(0, time - (this.#last ?? time)) / 1000;
    this.#last = time;
    if (isFirst) this.#helpUntil = time + HELP_MS;
    this.#follow();
    this.#move(time, frame, seconds);
    const eyes = this.#look(pose);
    if (eyes.length === 0) return;
    this.#fit(eyes);
    this.#eyes = new Float64Array(eyes.flatMap(({ numbers }) => numbers));
    this.streaming.wake();
    const next = this.#next;
    this.#next = null;
    next?.(time);
    if (this.#isOver) return;
    this.#mark(time, frame);
    this.#draw(eyes);
    this.shown(this.streaming.isSettled);
  }

  /**
   * Standing, turning, walking, jumping.
   * @param {number} time
   * @param {XRFrame} frame
   * @param {number} seconds since the last frame
   */
  #move(time, frame, seconds) {
    const { position, forward } = this.#head;
    if (this.#entry) {
      this.#rig.face(forward, this.#entry.azimuth);
      this.#rig.stand(position, this.#entry.ground);
      this.#entry = null;
    }
    const { inputSources } = this.session;
    const asked = this.#hands.asked(inputSources);
    if (asked.help) this.#helpUntil = this.#helpUntil > time ? time : time + HELP_MS;
    if (asked.turn !== 0) this.#rig.turnBy(position, asked.turn);
    if (asked.jumps && this.#goal) this.#rig.stand(position, this.#goal);
    // Before something of the model is here there is no ground.
    else if (this.streaming.drawn) this.#rig.walk(this.viewer, this.#head, asked.walk, seconds);
    const ray = this.#modelRay(this.#hands.pointing(inputSources, frame, this.space, time));
    this.#ray = ray;
    this.#pointed = ray && this.#meet(ray);
    this.#goal = asked.isAiming && ray && this.#pointed ? standing(this.viewer, this.#pointed.world, ray.direction, position[1]) : null;
  }

  /** @param {{origin: Vector, direction: Vector} | null} ray */
  #modelRay(ray) {
    return ray && { origin: this.#rig.place(ray.origin), direction: this.#rig.way(ray.direction) };
  }

  /** @param {{origin: Vector, direction: Vector}} ray @returns {Seen | null} */
  #meet({ origin, direction }) {
    const met = this.viewer.meet(new Float64Array([...origin, ...direction]));
    return met.length > 0 ? { world: vector(met), half: met[3] } : null;
  }

  /** The trigger was pulled. @param {XRInputSourceEvent} event */
  #select({ frame, inputSource }) {
    const ray = this.#modelRay(this.#hands.ray(inputSource, frame, this.space));
    if (!ray || this.#last === null) return;
    this.#hands.pointer = inputSource;
    const pixel = 1 / Math.max(1, this.#density);
    this.#tape.press(ray, this.#meet(ray), Math.max(pixel, this.#hands.wavering(inputSource)));
  }

  /** Pixels for a tangent of 1. */
  #density = 1;

  /**
   * Where the eyes are and what they see.
   * @param {NonNullable<ReturnType<XRFrame["getViewerPose"]>>} pose
   * @returns {Look[]}
   */
  #look(pose) {
    return pose.views.flatMap((view) => {
      const viewport = this.layer.getViewport(view);
      // An emulator that shows one eye has another one without a picture.
      const [width, height] = [Math.floor(viewport?.width ?? 0), Math.floor(viewport?.height ?? 0)];
      if (!viewport || width < 1 || height < 1) return [];
      const axes = axesOf(view.transform);
      const [position, right, up] = [this.#rig.place(axes.position), this.#rig.way(axes.right), this.#rig.way(axes.up)];
      const p = view.projectionMatrix;
      const tangents = [(p[8] - 1) / p[0], (p[8] + 1) / p[0], (p[9] - 1) / p[5], (p[9] + 1) / p[5]];
      this.#density = height / (tangents[3] - tangents[2]);
      /** @type {Eye} */
      const eye = { position, right, up, tangents };
      return [
        { eye, numbers: [...position, ...right, ...up, ...tangents, width, height], x: Math.floor(viewport.x), y: Math.floor(viewport.y), width, height },
      ];
    });
  }

  /** The canvas is as large as an eye; or as the emulator's picture, which it is itself. @param {Look[]} eyes */
  #fit(eyes) {
    const { framebuffer, framebufferWidth, framebufferHeight } = this.layer;
    const whole = framebuffer ? [Math.max(...eyes.map((e) => e.width)), Math.max(...eyes.map((e) => e.height))] : [framebufferWidth, framebufferHeight];
    const size = whole.join();
    if (size === this.#size) return;
    this.#size = size;
    this.viewer.resize(whole[0], whole[1]);
    if (!framebuffer) this.#assemble(whole);
  }

  /** A framebuffer in which an emulator's eyes are put together. @param {number[]} size */
  #assemble([width, height]) {
    const { gl } = this;
    this.#own ??= { framebuffer: gl.createFramebuffer(), renderbuffer: gl.createRenderbuffer() };
    const { framebuffer, renderbuffer } = this.#own;
    gl.bindRenderbuffer(gl.RENDERBUFFER, renderbuffer);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, width, height);
    gl.bindRenderbuffer(gl.RENDERBUFFER, null);
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, renderbuffer);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** @param {Look[]} eyes */
  #draw(eyes) {
    const { gl, layer, viewer } = this;
    const target = layer.framebuffer ?? this.#own?.framebuffer ?? null;
    const { width: whole, height: tall } = gl.canvas;
    this.#marks.upload();
    for (const { eye, numbers, x, y, width, height } of eyes) {
      if (!viewer.drawEye(new Float64Array(numbers))) continue;
      copy(gl, [null, 0, tall - height], [target, x, y], [width, height]);
      gl.bindFramebuffer(gl.FRAMEBUFFER, target);
      this.#marks.draw(eye, { x, y, width, height });
    }
    if (!layer.framebuffer) copy(gl, [target, 0, 0], [null, 0, 0], [whole, tall]);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /**
   * What is drawn over the model.
   * @param {number} time
   * @param {XRFrame} frame
   */
  #mark(time, frame) {
    const marks = this.#marks;
    const head = this.#rig.place(this.#head.position);
    const ahead = this.#rig.way(this.#head.forward);
    marks.begin(head, 1 / this.#density);
    if (this.#ray) {
      const { origin, direction } = this.#ray;
      const end = this.#pointed?.world ?? plus(origin, times(unit(direction), FAR));
      // White is seen on stone, its dark edges before the sky.
      marks.line(origin, end, EDGE, 2);
      marks.line(origin, end, this.#goal ? JUMP : RAY);
      if (this.#pointed && !this.#goal) {
        marks.dot(this.#pointed.world, EDGE, 1.4);
        marks.dot(this.#pointed.world, RAY);
      }
    }
    if (this.#goal) marks.ring(this.#goal, RING, JUMP);
    this.#tape.draw(marks, this.#pointed);
    if (time < this.#helpUntil) this.#help(head, ahead, this.#hands.left(this.session.inputSources, frame, this.space));
    if (performance.now() < this.#said.until) marks.plate(plus(head, times(ahead, SAID_FAR)), [this.#said.text], { angle: SAID });
  }

  /**
   * What the controllers do: above the left hand where the person looks at it, else before the eyes.
   * @param {Vector} head
   * @param {Vector} ahead
   * @param {Vector | null} hand in the headset's space
   */
  #help(head, ahead, hand) {
    const place = hand && plus(this.#rig.place(hand), [0, 0, ABOVE]);
    const isSeen = place && dot(unit(minus(place, head)), ahead) > 0.5;
    const level = unit([ahead[0], ahead[1], 0]);
    const before = plus(plus(head, times(level, BEFORE)), [0, 0, -0.25]);
    const lines = ["headsetWalk", "headsetTurn", "headsetJump", "headsetMeasure", "headsetBack", "headsetHelp"].map((key) => t(key));
    this.#marks.plate(isSeen ? place : before, lines, { line: LETTERS });
  }
}

/**
 * @param {WebGL2RenderingContext} gl
 * @param {[WebGLFramebuffer | null, number, number]} from with the lower left corner
 * @param {[WebGLFramebuffer | null, number, number]} to
 * @param {[width: number, height: number]} size
 */
function copy(gl, [from, x, y], [to, u, v], [width, height]) {
  gl.disable(gl.SCISSOR_TEST);
  gl.bindFramebuffer(gl.READ_FRAMEBUFFER, from);
  gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, to);
  gl.blitFramebuffer(x, y, x + width, y + height, u, v, u + width, v + height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
}
