// The page: opens a pack, draws it, and brings the parts together. What is open is in current.js: a model (model.js) and, on one graphics device, a
// scene (scene.js); both are replaced, the page stays.

import { actionsOf } from "./actions.js";
import { Api } from "./api.js";
import { CALLS } from "./calls.js";
import { cameraOf, numbersOf } from "./camera.js";
import * as chrome from "./chrome.js";
import { connect, showTurning } from "./controls.js";
import { Current } from "./current.js";
import { Display } from "./display.js";
import { $ } from "./dom.js";
import * as format from "./format.js";
import { firstBytes, wholeHead } from "./head.js";
import { onChange, t, use } from "./i18n.js";
import { Address, readState } from "./link.js";
import { LocalPack } from "./local-pack.js";
import { Measuring } from "./measuring.js";
import { Model } from "./model.js";
import { Person } from "./person.js";
import { Pictures } from "./pictures.js";
import { Scene } from "./scene.js";
import { Screen } from "./screen.js";
import { Section } from "./section.js";
import { Settings, showProjection } from "./settings.js";
import { Toolbox } from "./toolbox.js";
import { Trouble } from "./trouble.js";
import { stepName, Undo } from "./undo.js";
import { Viewpoint } from "./viewpoint.js";

/** @import { DecodePool } from "./decode-pool.js" */
/** @import { Failure, PackSource, PageState, Program, Tool } from "./types/page.js" */

/** A device that is lost more often than this is given up. */
const MAX_REBUILDS = 3;
/** Milliseconds that a lost WebGL context is waited for. */
const CONTEXT_MS = 10_000;

/**
 * @typedef {object} Parts
 * @property {PackSource | null} pack
 * @property {Promise<Uint8Array<ArrayBuffer>> | undefined} head
 * @property {Promise<Program>} program
 * @property {{whyNoGpu: () => string | null, otherProgram: (address: string, parameters: URLSearchParams) => string | null}} gpu program.js
 * @property {DecodePool | null} pool for the first model that is opened
 * @property {() => DecodePool} newPool for the others
 * @property {typeof import("./embed.js") | null} embed where this page is inside another one
 * @property {URLSearchParams} parameters
 * @property {string} language
 * @property {Promise<Response>} messages its messages
 * @property {(part: number) => void} came how much of what the first picture needs is there, 0 to 1
 */

/** @param {Parts} parts */
export async function start(parts) {
  await use(parts.language, parts.messages);
  document.documentElement.classList.add("started");
  const page = new Page(parts);
  if (parts.pack && parts.head) await page.open(parts.pack, parts.head);
  else page.screen.welcome();
}

class Page {
  #rebuilt = 0;

  /** @param {Parts} parts */
  constructor({ pack, program, gpu, pool, newPool, embed, parameters, came }) {
    this.program = program;
    this.gpu = gpu;
    this.pool = pool;
    this.newPool = newPool;
    this.parameters = parameters;
    const current = new Current(pack);
    this.current = current;
    const scene = () => current.scene;
    const tool = (/** @type {Tool} */ name, which = "") => this.toolbox.choose(name, which || null);
    this.trouble = new Trouble();
    this.undo = new Undo(() => undoButtons(this.undo));
    this.address = new Address(
      () => (current.isOpen && this.api.isReady ? this.viewpoint.state() : null),
      (state) => this.viewpoint.restore(state),
      () => current.scene?.isMoving ?? false,
    );
    const pickPoints = (/** @type {(points: number[][]) => void} */ found) => this.toolbox.pickPoints(found);
    this.look = new Display({ onChange: () => this.#displayed(), pickPoints });
    this.section = new Section({ display: this.look, pickPoints });
    this.measuring = new Measuring({
      undo: this.undo,
      address: this.address,
      display: this.look,
      emit: (event, detail) => this.api.emit(event, detail),
      tool,
      state: () => this.viewpoint.state(),
      pins: () => current.notes?.pins?.boxes() ?? [],
    });
    const { address, look, measuring, section, undo } = this;
    this.toolbox = new Toolbox({ scene, notes: () => current.notes, measuring });
    this.viewpoint = new Viewpoint({ current, look, measuring, address: () => address, orbit: () => tool("orbit") });
    this.api = new Api({
      scene,
      model: () => current.model,
      notes: () => current.opened.notes,
      display: look,
      measuring,
      address,
      tool,
      state: () => this.viewpoint.state(),
      restore: (state) => this.viewpoint.restore(state),
      setLanguage: async (language) => {
        await use(language);
        $("language").value = document.documentElement.lang;
      },
    });
    this.screen = new Screen({ current, measuring, section, address, api: this.api, came });
    // The measuring engine (measure/engine.js), loaded when it is first asked for.
    const engine = async () => (await measuring.load()).engine;
    this.pictures = new Pictures(() => {
      const { model, scene: shown } = current.opened;
      return { viewer: shown.viewer, session: shown.session, title: model.title, engine };
    });
    this.trouble.onShow = (kind) => this.api.emit("trouble", { kind });
    const { api, pictures, screen, toolbox } = this;
    const actions = actionsOf({ current, measuring, pictures, screen, toolbox });
    this.actions = actions;
    connect({
      current,
      actions,
      measuring,
      toolbox,
      undo,
      address,
      share: () => this.viewpoint.openShare(),
      openFile: (file) => this.openFile(file),
    });
    this.person = new Person({ current, undo, viewpoint: this.viewpoint, address, api, toolbox });
    this.settings = new Settings(parameters, scene);
    this.#listen();
    if (parameters.has("embed")) embed?.reduce(parameters.get("embed") === "bare", api);
    embed?.serve(api, new Set(CALLS));
    // What docs/embedding.md promises to scripts.
    Object.assign(globalThis, { kilwa: { api } });
  }

  #listen() {
    onChange(() => this.translate());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#settle());
    addEventListener("online", () => this.current.scene?.session.wake());
    // The figures are written while they can be seen.
    $("tab-info").addEventListener("click", () => this.current.scene?.session.wake());
    const { list } = document.body.dataset;
    for (const id of /** @type {const} */ (["back", "trouble-back"])) {
      $(id).hidden = !list;
      // A language that came by the address goes on by it: the list has no other memory.
      if (list) $(id).href = this.parameters.has("lang") ? `${list}?lang=${document.documentElement.lang}` : list;
    }
    // WebGL 2 reports it on the canvas, and gives the same canvas another context when it can: wgpu hears of neither.
    /** @type {PageState | null} */
    let left = null;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    let waiting;
    $("canvas").addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      if (!this.current.isOpen) return;
      left = this.#leaveDevice();
      // A browser that took contexts away repeatedly gives no more.
      if (!left) return;
      waiting = setTimeout(() => {
        left = null;
        this.trouble.show("gpuGone");
      }, CONTEXT_MS);
    });
    $("canvas").addEventListener("webglcontextrestored", () => {
      clearTimeout(waiting);
      if (left) this.draw(left);
      left = null;
    });
  }

  // A pack.

  /**
   * Head and program arrive in parallel; then the first picture, then everything else.
   * @param {PackSource} pack
   * @param {Promise<Uint8Array<ArrayBuffer>>} head
   */
  async open(pack, head) {
    for (const id of /** @type {const} */ (["download", "trouble-download", "about-download"])) {
      $(id).href = String(pack.url);
      $(id).download = pack.name;
    }
    pack.onProgress = (done, total) => this.screen.progress(done, total);
    pack.onLimit = (seconds) => this.screen.limited(seconds);
    let bytes;
    try {
      bytes = await firstBytes(pack, head, (seconds) => this.screen.waits(seconds));
    } catch (error) {
      this.#cannotOpen(error.kind ?? "broken", error);
      return;
    }
    $("loading-text").textContent = t("loadingProgram");
    let module;
    let model;
    try {
      module = await this.program;
      bytes = await wholeHead(pack, module, bytes);
      model = new Model({ pack, module, head: bytes });
      this.current.model = model;
      this.screen.about(model);
      const { bytes: stated } = model.info.pack;
      // Of a file that is cut off, what is there is shown.
      if (Number(pack.bytes) > stated) {
        const detail = `${format.count(Number(pack.bytes))} / ${format.count(stated)}`;
        throw Object.assign(new Error(detail), { kind: "damaged" });
      }
    } catch (error) {
      // A file that the parser refuses is not a pack, or not a whole one; an error of the module loader is the page's own.
      this.#cannotOpen(error.kind ?? (module || error.constructor === Error ? "damaged" : "broken"), error);
      return;
    }
    this.person.open(model);
    await this.draw();
    const published = (/** @type {string} */ name) => this.parameters.get(name) ?? document.body.dataset[name];
    await this.person.publish(published("annotations"));
    await this.person.offer(published("holes"), published("photographs"));
    // Where a frame may not use headsets, asking for one is an error in the console.
    const isAllowed = document.featurePolicy?.allowsFeature("xr-spatial-tracking") ?? true;
    if (isAllowed && (await navigator.xr?.isSessionSupported("immersive-vr").catch(() => {}))) (await import("./headset/headset.js")).offer(this);
  }

  /**
   * @param {string} kind
   * @param {Failure} error
   * @param {{reason?: string}} [more]
   */
  #cannotOpen(kind, error, more) {
    this.pool?.close();
    this.pool = null;
    this.trouble.show(kind, error, more);
  }

  /**
   * A pack of this computer, in place of what is open.
   * @param {File} file
   */
  async openFile(file) {
    const { current } = this;
    const { scene, model } = current;
    // Whoever watches the picture sees that the model goes too.
    current.scene = current.model = null;
    scene?.close();
    current.holes?.close();
    current.photographs?.close();
    current.notes?.tour.close();
    current.notes?.closeForm();
    this.measuring.close();
    if (current.pack instanceof LocalPack) current.pack.close();
    model?.close();
    const pack = new LocalPack(file);
    current.pack = pack;
    this.screen.loading();
    history.replaceState(null, "", location.pathname + location.search);
    await this.open(pack, pack.head());
  }

  // A device.

  /** Make the viewer and start streaming; again after the device was lost, with the same camera. */
  async draw(state = readState(location.hash)) {
    const { model, notes } = this.current;
    if (!model || !notes) return;
    const canvas = $("canvas");
    const reason = this.gpu.whyNoGpu();
    let viewer;
    try {
      if (reason) throw Object.assign(new Error("no GPU"), { kind: "noGpu" });
      canvas.width = Math.max(1, Math.round(canvas.clientWidth * Math.min(devicePixelRatio, 2)));
      canvas.height = Math.max(1, Math.round(canvas.clientHeight * Math.min(devicePixelRatio, 2)));
      viewer = await model.module.Viewer.create(canvas, model.head);
      this.screen.came(0.8);
    } catch (error) {
      const isNoGpu = error.kind === "noGpu";
      // A canvas that was asked for WebGPU gives no WebGL any more: the page begins again, once.
      const other = isNoGpu && !reason ? this.gpu.otherProgram(location.href, this.parameters) : null;
      if (other) location.replace(other);
      else this.#cannotOpen(isNoGpu ? "noGpu" : "broken", error, { reason: reason ?? "noGpuAdapter" });
      return;
    }
    if (state.camera) viewer.setCamera(cameraOf(state.camera));
    if (model.isCutOff) viewer.setCutOff(Number(model.pack.bytes));
    const pool = this.pool ?? this.newPool();
    this.pool = null; // It ends with this scene.
    const scene = new Scene({ canvas, viewer, model, pool, streaming: this.#streaming(), actions: this.actions, on: this.#sceneEvents() });
    if (!state.camera) scene.begin();
    this.current.scene = scene;
    notes.attach(scene);
    this.current.holes?.attach(scene);
    this.current.photographs?.attach(scene);
    this.look.attach(scene, model);
    this.section.attach(scene);
    this.#settle();
    this.toolbox.choose("orbit");
    scene.setFree(false);
    this.screen.viewButtons();
    if (state.display) this.look.show(state.display);
    this.measuring.attach(scene, model, state.measurements);
    notes.setShown(state.notes);
    if (state.annotation) notes.openNamed(state.annotation, { fly: !state.camera });
    scene.session.firstPicture.then(() => this.#identify(model, state.pack));
  }

  /** @returns {import("./session.js").SessionEvents} */
  #streaming() {
    return {
      frame: (stats) => {
        if (stats.lost) this.#rebuild();
        else if (stats.cutOff && stats.settled && stats.patchesDrawn === 0) this.trouble.show("damaged");
        else this.screen.frame(stats);
      },
      first: () => this.screen.first(),
      waits: (seconds) => this.screen.waits(seconds),
      changed: (error) => this.trouble.show("changed", error),
      lost: (error) => chrome.notice(`${t(`${error.kind}Title`)}. ${error.message}`),
      damaged: (chunk, error) => this.#damaged(chunk, error),
      broken: (error) => this.trouble.show("broken", error),
    };
  }

  /** @returns {import("./scene.js").SceneEvents} */
  #sceneEvents() {
    return {
      leave: () => this.address.leave(),
      orbit: () => this.toolbox.choose("orbit"),
      projection: showProjection,
      turning: showTurning,
      history: () => this.screen.viewButtons(),
    };
  }

  /**
   * Whether the link that opened the page is of this pack; from then on the address names it by its identity.
   * @param {Model} model
   * @param {string | null} linked
   */
  async #identify({ identity }, linked) {
    const { current } = this;
    const isHere = !linked || (await identity.isHere(linked));
    await identity.known();
    if (current.model?.identity !== identity || !current.isOpen) return;
    if (!isHere) chrome.notice(t("otherPack"), 20000, { label: t("fit"), run: () => current.scene?.standardView("iso") });
    document.body.dataset.identity = identity.text ?? "";
    if (readState(location.hash).pack) this.address.now();
  }

  /** The device is gone: the same page, head and camera on a new one, unless that keeps happening. */
  #rebuild() {
    const state = this.#leaveDevice();
    if (state) this.draw(state);
  }

  /** Gives up what the lost device held; what the page showed, or null where it keeps being lost. */
  #leaveDevice() {
    const { scene } = this.current.opened;
    const state = { ...this.viewpoint.state(), camera: numbersOf(scene.viewer.camera()), pack: null };
    this.address.now(); // Retry begins with the same view.
    scene.close();
    this.#rebuilt += 1;
    if (this.#rebuilt > MAX_REBUILDS) {
      this.trouble.show("gpuGone");
      return null;
    }
    chrome.notice(t("gpuLost"));
    return state;
  }

  /**
   * @param {number} chunk
   * @param {Failure} error
   */
  #damaged(chunk, error) {
    const { session } = this.current.opened.scene;
    if (!session.drawn && (session.damaged.get(chunk) ?? 0) >= 2) {
      this.trouble.show("damaged", error);
      session.close();
      return;
    }
    chrome.notice(t("damagedPart"), 10000);
  }

  // What is shown.

  /** Hand all settings to the viewer. */
  #settle() {
    this.settings.apply();
    this.look.settle();
    this.section.refresh();
  }

  /** Shading, light or section changed. */
  #displayed() {
    this.look.refresh();
    this.section.refresh();
    this.address.later();
  }

  translate() {
    const { model, saved, notes, scene } = this.current;
    chrome.help();
    undoButtons(this.undo);
    this.trouble.translate();
    if (model) this.screen.about(model);
    this.#settle();
    saved?.show();
    notes?.show();
    scene?.walk.show();
    this.measuring.translate();
    this.toolbox.showHint();
  }
}

/** Those of the notes, named by what they take back. @param {Undo} undo */
function undoButtons(undo) {
  const next = undo.next("notes");
  for (const way of /** @type {const} */ (["undo", "redo"])) {
    $(`edit-${way}`).disabled = !next[way];
    $(`edit-${way}-name`).textContent = stepName(way, next[way]);
  }
}
