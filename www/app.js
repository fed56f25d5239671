// The page: opens a pack, draws it, and connects what is shown with what the person does. What one open pack is stands in model.js, what one graphics
// device draws in scene.js; both are replaced, the page stays.

import { Api, CALLS } from "./api.js";
import { cameraKey, cameraOf, numbersOf } from "./camera.js";
import * as chrome from "./chrome.js";
import { connect, showTurning } from "./controls.js";
import { Cube } from "./cube.js";
import { Display } from "./display.js";
import { $ } from "./dom.js";
import { showFacts } from "./facts.js";
import * as format from "./format.js";
import { firstBytes, wholeHead } from "./head.js";
import { onChange, preferred, t, use } from "./i18n.js";
import { Address, readState } from "./link.js";
import { LocalPack } from "./local-pack.js";
import { Measuring } from "./measuring.js";
import { Model } from "./model.js";
import { fetchPublished, Notes } from "./notes.js";
import { Pictures } from "./pictures.js";
import { Saved } from "./saved.js";
import { Scene } from "./scene.js";
import { Section } from "./section.js";
import { Settings, showProjection } from "./settings.js";
import { Status } from "./status.js";
import { Toolbox } from "./toolbox.js";
import { Trouble } from "./trouble.js";
import { Undo } from "./undo.js";

/** @import { DecodePool } from "./decode-pool.js" */
/** @import { Failure, FrameStats, Note, PackSource, PageState, Program, SavedView } from "./types/page.js" */

/** A device that is lost more often than this is given up. */
const MAX_REBUILDS = 3;
/** Milliseconds without a move after which the camera rests. */
const REST_MS = 200;

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
 */

/** @param {Parts} parts */
export async function start(parts) {
  await use(preferred(parts.parameters));
  document.documentElement.classList.add("started");
  const page = new Page(parts);
  if (parts.pack && parts.head) await page.open(parts.pack, parts.head);
  else page.welcome();
}

class Page {
  /** @type {Scene | null} */
  scene = null;
  /** @type {Model | null} */
  model = null;
  /** @type {Saved | null} */
  saved = null;
  /** @type {Notes | null} */
  notes = null;
  #rebuilt = 0;
  /** The camera of the last frame. */
  #seen = "";
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  #resting;

  /** @param {Parts} parts */
  constructor({ pack, program, gpu, pool, newPool, embed, parameters }) {
    this.pack = pack;
    this.program = program;
    this.gpu = gpu;
    this.pool = pool;
    this.newPool = newPool;
    this.parameters = parameters;
    const scene = () => this.scene;
    this.trouble = new Trouble();
    this.status = new Status();
    this.undo = new Undo(() => this.#undoButtons());
    this.address = new Address(
      () => (this.#isOpen && this.api.isReady ? this.state() : null),
      (state) => this.restore(state),
    );
    this.cube = new Cube((view) => this.scene?.standardView(view));
    const pickPoints = (/** @type {(points: number[][]) => void} */ found) => this.toolbox.pickPoints(found);
    this.look = new Display({ onChange: () => this.#displayed(), pickPoints });
    this.section = new Section({ display: this.look, pickPoints });
    this.measuring = new Measuring({
      undo: this.undo,
      address: this.address,
      display: this.look,
      emit: (event, detail) => this.api.emit(event, detail),
      tool: (name, which) => this.toolbox.choose(name, which),
      state: () => this.state(),
    });
    this.toolbox = new Toolbox({ scene, notes: () => this.notes, measuring: this.measuring });
    this.api = new Api({
      scene,
      model: () => this.model,
      notes: () => opened(this.notes),
      display: this.look,
      measuring: this.measuring,
      address: this.address,
      tool: (name) => this.toolbox.choose(name),
      state: () => this.state(),
      restore: (state) => this.restore(state),
      setLanguage: async (language) => {
        await use(language);
        $("language").value = document.documentElement.lang;
      },
    });
    this.pictures = new Pictures(() => {
      const { viewer, session } = opened(this.scene);
      return { viewer, session, title: opened(this.model).title, engine: () => this.engine() };
    });
    this.trouble.onShow = (kind) => this.api.emit("trouble", { kind });
    this.actions = this.#actions();
    connect({
      scene,
      notes: () => this.notes,
      saved: () => this.saved,
      actions: this.actions,
      measuring: this.measuring,
      toolbox: this.toolbox,
      undo: this.undo,
      address: this.address,
      share: () => this.share(),
      openFile: (file) => this.openFile(file),
    });
    this.settings = new Settings(parameters, scene);
    this.#listen();
    if (parameters.has("embed")) embed?.reduce(parameters.get("embed") === "bare");
    embed?.serve(this.api, CALLS);
    expose(this);
  }

  get #isOpen() {
    return this.scene?.isOpen ?? false;
  }

  /** @returns {import("./input.js").InputActions} */
  #actions() {
    const { toolbox } = this;
    const open = () => (this.#isOpen ? this.scene : null);
    return {
      hover: (x, y) => {
        if (!this.scene) return;
        this.status.hover(this.scene.viewer, x, y);
        if (this.scene.input.tool === "measure") this.measuring.hover(x, y);
      },
      leave: () => this.status.leave(),
      aim: (at) => {
        this.scene?.loupe.show(at);
        if (at) this.actions.hover(...at);
      },
      step: (key) => this.measuring.key(key),
      fit: () => this.scene?.fit(),
      view: (name) => this.scene?.standardView(name),
      hide: () => chrome.toggleChrome(),
      help: () => $("help").showModal(),
      parallel: () => open()?.setOrthographic(!this.scene?.viewer.camera().orthographic),
      free: () => open()?.setFree(!this.scene?.input.isFree),
      tool: (name) => toolbox.choose(name),
      place: (x, y, how) => toolbox.place(x, y, how),
      save: () => {
        if (!open() || !this.saved) return;
        const view = this.saved.add();
        chrome.openTab("saved");
        this.saved.list.edit(view.id);
      },
      picture: () => open() && this.pictures.open(),
      back: () => this.scene?.flight.back(),
      forward: () => this.scene?.flight.forward(),
    };
  }

  #listen() {
    onChange(() => this.translate());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.#settle());
    addEventListener("online", () => this.scene?.session.wake());
    // The figures are written while they can be seen.
    $("tab-info").addEventListener("click", () => this.scene?.session.wake());
    const { list } = document.body.dataset;
    for (const id of /** @type {const} */ (["back", "trouble-back"])) {
      $(id).hidden = !list;
      // A language that came by the address goes on by it: the list has no other memory.
      if (list) $(id).href = this.parameters.has("lang") ? `${list}?lang=${document.documentElement.lang}` : list;
    }
    // WebGL 2 reports it on the canvas, and gives the same canvas another context when it can: wgpu hears of neither.
    /** @type {PageState | null} */
    let left = null;
    $("canvas").addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      if (this.#isOpen) left = this.#leaveDevice();
    });
    $("canvas").addEventListener("webglcontextrestored", () => {
      if (left) this.draw(left);
      left = null;
    });
  }

  // A pack.

  /** No pack was named. */
  welcome() {
    document.body.dataset.state = "welcome";
    $("loading").hidden = true;
    $("welcome").hidden = false;
  }

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
    pack.onProgress = (done, total) => this.#progress(done, total);
    let bytes;
    try {
      bytes = await firstBytes(pack, head, (seconds) => this.#waits(seconds));
    } catch (error) {
      this.#cannotOpen(error.kind ?? "broken", error);
      return;
    }
    $("loading-text").textContent = t("loadingProgram");
    let module;
    try {
      module = await this.program;
      bytes = await wholeHead(pack, module, bytes);
      this.model = new Model({ pack, module, head: bytes });
      this.#about(this.model);
      const { bytes: stated } = this.model.info.pack;
      if (pack.bytes !== stated) {
        const detail = `${format.count(Number(pack.bytes))} / ${format.count(stated)}`;
        throw Object.assign(new Error(detail), { kind: "damaged" });
      }
    } catch (error) {
      // What the parser refuses is no pack, or not a whole one; what a module loader refuses is our own trouble.
      this.#cannotOpen(error.kind ?? (module || error.constructor === Error ? "damaged" : "broken"), error);
      return;
    }
    this.#person(this.model);
    await this.draw();
    await this.#published(this.model);
  }

  /**
   * Until something is tried again, before there is a picture.
   * @param {number} seconds
   */
  #waits(seconds) {
    $("loading-text").textContent = t("offlineFirst", { seconds });
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

  /** What measures (measure/engine.js), loaded when it is first asked for. */
  async engine() {
    return (await this.measuring.load()).engine;
  }

  /**
   * A pack of this computer, in place of what is open.
   * @param {File} file
   */
  async openFile(file) {
    this.scene?.close();
    this.notes?.tour.close();
    this.notes?.closeForm();
    this.measuring.close();
    if (this.pack instanceof LocalPack) this.pack.close();
    this.scene = this.model = null;
    const pack = new LocalPack(file);
    this.pack = pack;
    document.body.dataset.state = "loading";
    document.body.dataset.pack = "";
    $("welcome").hidden = $("trouble").hidden = true;
    $("loading").hidden = false;
    history.replaceState(null, "", location.pathname + location.search);
    await this.open(pack, pack.head());
  }

  /**
   * What the person keeps for this pack: saved views and notes.
   * @param {Model} model
   */
  #person({ hash, identity, title, address }) {
    const now = () => {
      const { camera, display } = this.state();
      return { camera, display };
    };
    this.undo.clear();
    this.saved = new Saved({ hash, identity, title, undo: this.undo, now, go: (view) => this.#goTo(view) });
    this.notes?.close();
    this.notes = new Notes({
      hash,
      identity,
      title,
      pack: address,
      undo: this.undo,
      now,
      look: (note, isJump) => this.#lookAt(note, isJump),
      tool: (name) => this.toolbox.choose(name),
      emit: (event, detail) => {
        if (event === "annotation") this.address.now();
        else this.address.later();
        this.api.emit(event, /** @type {any} */ (detail));
      },
      shareAddress: () => this.share(),
    });
  }

  /**
   * Notes that the host publishes beside the pack.
   * @param {Model} model
   */
  async #published({ pack }) {
    const address = this.parameters.get("annotations") ?? document.body.dataset.annotations;
    const { notes } = this;
    if (!address || !notes || pack.isLocal) return;
    try {
      notes.publish(await fetchPublished(address, pack.url));
      const { annotation, camera } = readState(location.hash);
      if (annotation && !notes.openId) notes.openNamed(annotation, { fly: !camera, isJump: false });
    } catch (error) {
      chrome.notice(t("annotationsFailed", { why: error.message }), 12000);
    }
  }

  // A device.

  /** Make the viewer and start streaming; again after the device was lost, with the same camera. */
  async draw(state = readState(location.hash)) {
    const { model, notes } = this;
    if (!model || !notes) return;
    const canvas = $("canvas");
    const reason = this.gpu.whyNoGpu();
    let viewer;
    try {
      if (reason) throw new Error("nogpu:");
      canvas.width = Math.max(1, Math.round(canvas.clientWidth * Math.min(devicePixelRatio, 2)));
      canvas.height = Math.max(1, Math.round(canvas.clientHeight * Math.min(devicePixelRatio, 2)));
      viewer = await model.module.Viewer.create(canvas, model.head);
    } catch (error) {
      const isNoGpu = String(error.message).startsWith("nogpu:");
      // A canvas that was asked for WebGPU gives no WebGL any more: the page begins again, once.
      const other = isNoGpu && !reason ? this.gpu.otherProgram(location.href, this.parameters) : null;
      if (other) location.replace(other);
      else this.#cannotOpen(isNoGpu ? "noGpu" : "broken", error, { reason: reason ?? "noGpuAdapter" });
      return;
    }
    if (state.camera) viewer.setCamera(cameraOf(state.camera));
    const pool = this.pool ?? this.newPool();
    this.pool = null; // It ends with this scene.
    const scene = new Scene({ canvas, viewer, model, pool, streaming: this.#streaming(), actions: this.actions, on: this.#sceneEvents() });
    this.scene = scene;
    notes.attach(scene);
    this.look.attach(scene, model);
    this.section.attach(scene);
    this.#settle();
    this.toolbox.choose("orbit");
    scene.setFree(false);
    this.#viewButtons();
    if (state.display) this.look.show(state.display);
    this.measuring.attach(scene, model, state.measurements);
    notes.setShown(state.notes);
    if (state.annotation) notes.openNamed(state.annotation, { fly: !state.camera });
    scene.session.firstPicture.then(() => this.#identify(model, scene, state.pack));
  }

  /** @returns {import("./session.js").SessionEvents} */
  #streaming() {
    return {
      frame: (stats) => this.#frame(stats),
      first: () => this.#first(),
      waits: (seconds) => this.#waits(seconds),
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
      history: () => this.#viewButtons(),
    };
  }

  /**
   * Whether the link that opened the page is of this pack; from then on the address names it by its identity.
   * @param {Model} model
   * @param {Scene} scene
   * @param {string | null} linked
   */
  async #identify({ identity }, scene, linked) {
    const isHere = !linked || (await identity.isHere(linked));
    await identity.known();
    if (this.model?.identity !== identity || !this.#isOpen) return;
    if (!isHere) chrome.notice(t("otherPack"), 20000, { label: t("fit"), run: () => scene.standardView("iso") });
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
    const scene = opened(this.scene);
    const state = { ...this.state(), camera: numbersOf(scene.viewer.camera()), pack: null };
    scene.close();
    this.#rebuilt += 1;
    if (this.#rebuilt > MAX_REBUILDS) {
      this.trouble.show("noGpu", new Error("device lost"), { reason: "noGpuAdapter" });
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
    const { session } = opened(this.scene);
    if (!session.drawn && (session.damaged.get(chunk) ?? 0) >= 2) {
      this.trouble.show("damaged", error);
      session.close();
      return;
    }
    chrome.notice(t("damagedPart"), 10000);
  }

  // What the address, saved views and notes hold.

  state() {
    const { scene, notes, model } = this;
    return {
      camera: numbersOf(opened(scene).flight.there),
      display: this.look.chosen,
      notes: notes?.shown ?? true,
      annotation: notes?.openId ?? null,
      measurements: this.measuring.address,
      pack: opened(model).identity.name,
    };
  }

  /**
   * A state of the address: after Back and Forward, from a link, from a script.
   * @param {PageState} state
   */
  restore(state) {
    const { scene, notes } = this;
    if (!scene?.isOpen || !notes) return;
    if (scene.walk.on) this.toolbox.choose("orbit");
    if (state.camera) scene.flight.to(cameraOf(state.camera)).then(() => scene.isOpen && showProjection(scene.viewer.camera().orthographic));
    this.look.show(state.display);
    notes.setShown(state.notes);
    // The browser has made the entry of a link that was followed on this page.
    if (state.annotation) notes.openNamed(state.annotation, { fly: !state.camera, isJump: false });
    else notes.tour.close();
  }

  /** @param {SavedView} view */
  #goTo({ camera, display, name }) {
    this.scene?.goTo(cameraOf(camera), { isJump: true });
    this.look.show(display);
    chrome.announce(name);
  }

  /**
   * A note: as it was looked at when it was written, or from here.
   * @param {Note} note
   * @param {boolean} isJump
   */
  #lookAt({ camera, display, place }, isJump) {
    if (camera) this.scene?.goTo(cameraOf(camera), { isJump });
    else this.scene?.lookAtPlace(place, { isJump });
    if (display) this.look.show(display);
  }

  async share() {
    if (!this.model) return;
    const { identity } = this.model;
    this.address.now();
    try {
      // The end of the file may still be on its way; a clipboard does not wait long for it.
      if (!identity.text) await Promise.race([identity.known(), new Promise((resolve) => setTimeout(resolve, 1000))]);
      this.address.now();
      await navigator.clipboard.writeText(location.href);
      const { tools } = this.measuring;
      if (tools?.isLong) chrome.notice(t("measureLinkLong"), 12000, { label: t("exportFile"), run: () => tools.files.save("json") });
      else chrome.notice(t("shared"), 2500);
    } catch {
      chrome.notice(t("shareFailed"));
    }
  }

  // What is shown.

  #viewButtons() {
    $("view-back").disabled = !this.scene?.flight.canGoBack;
    $("view-forward").disabled = !this.scene?.flight.canGoForward;
  }

  #undoButtons() {
    $("edit-undo").disabled = this.undo.done.length === 0;
    $("edit-redo").disabled = this.undo.undone.length === 0;
  }

  /** Hand all settings to the viewer. */
  #settle() {
    this.settings.apply();
    this.look.settle();
    this.section.refresh();
  }

  /**
   * @param {number} done
   * @param {number} total
   */
  #progress(done, total) {
    if (this.scene) return;
    $("loading-bar").value = total ? done / total : 0;
    $("loading-text").textContent = t("loadingBytes", { done: format.bytes(done), total: format.bytes(total || done) });
  }

  #first() {
    document.body.dataset.state = "ready";
    $("loading").hidden = true;
    $("cube").hidden = false;
    this.api.emit("ready", null);
    const { pack } = opened(this.model);
    if (pack.whole) chrome.notice(t("noRangeSmall", { size: format.bytes(Number(pack.bytes)) }), 12000);
  }

  /** @param {FrameStats} stats */
  #frame(stats) {
    if (stats.lost) {
      this.#rebuild();
      return;
    }
    const { viewer, session, loupe, walk } = opened(this.scene);
    this.status.show(stats, viewer, session);
    if (!$("info").hidden) this.status.list($("stats"), stats, session);
    const camera = viewer.camera();
    this.cube.show(camera);
    this.notes?.pins?.frame(stats);
    this.measuring.frame(stats);
    loupe.frame();
    this.section.frame();
    walk.frame(stats);
    this.address.later();
    this.api.emit("frame", stats);
    const seen = cameraKey(camera);
    if (this.#seen === seen) return;
    this.#seen = seen;
    clearTimeout(this.#resting);
    this.#resting = setTimeout(() => this.#isOpen && this.api.emit("camera", this.api.getCamera()), REST_MS);
  }

  /** @param {Model} model */
  #about({ title, info }) {
    $("title").textContent = title;
    $("about-title").textContent = title;
    document.title = `${title} - Kilwa`;
    $("canvas").setAttribute("aria-label", `${t("canvas")}: ${title}`);
    showFacts($("facts"), info);
  }

  /** Shading, light or section changed. */
  #displayed() {
    this.look.refresh();
    this.section.refresh();
    this.address.later();
  }

  translate() {
    chrome.help();
    this.trouble.translate();
    if (this.model) this.#about(this.model);
    this.#settle();
    this.saved?.show();
    this.notes?.show();
    this.scene?.walk.show();
    this.measuring.translate();
    this.toolbox.showHint();
  }
}

/**
 * What exists only while a model is open.
 * @template T
 * @param {T | null} part
 * @returns {T}
 */
function opened(part) {
  if (!part) throw new Error("the model is not open");
  return part;
}

/**
 * The same objects for scripts and tests as for the page. `kilwa.api` is what docs/embedding.md promises; the rest is for tests.
 * @param {Page} page
 */
function expose(page) {
  const { api, address, look, measuring, pictures, toolbox } = page;
  const parts = {
    api,
    address,
    look,
    measuring,
    pictures,
    engine: () => page.engine(),
    tool: (/** @type {import("./types/page.js").Tool} */ name) => toolbox.choose(name),
    get pack() {
      return page.pack;
    },
    get module() {
      return page.model?.module;
    },
    get info() {
      return page.model?.info;
    },
    get saved() {
      return page.saved;
    },
    get notes() {
      return page.notes;
    },
    get viewer() {
      return page.scene?.viewer;
    },
    get session() {
      return page.scene?.session;
    },
    get input() {
      return page.scene?.input;
    },
    get walk() {
      return page.scene?.walk;
    },
  };
  Object.assign(globalThis, { kilwa: Object.freeze(parts) });
}
