// The page: brings head, program and controls together, and shows what is going on.

import { Api, CALLS } from "./api.js";
import * as chrome from "./chrome.js";
import { Cube } from "./cube.js";
import { Display } from "./display.js";
import * as format from "./format.js";
import { onChange, preferred, remember, t, use } from "./i18n.js";
import { Flight } from "./flight.js";
import { Identity } from "./identity.js";
import { Input } from "./input.js";
import { Address, readState } from "./link.js";
import { firstBytes, wholeHead } from "./head.js";
import { LocalPack, openers } from "./local-pack.js";
import { Loupe } from "./loupe.js";
import { Measuring } from "./measuring.js";
import { factsList } from "./facts.js";
import { readJson } from "./store.js";
import { Notes, fetchPublished } from "./notes.js";
import { Pictures } from "./pictures.js";
import { Saved } from "./saved.js";
import { Section } from "./section.js";
import { Session } from "./session.js";
import { Status } from "./status.js";
import { Trouble } from "./trouble.js";
import { Undo } from "./undo.js";
import { Walk } from "./walk.js";

const $ = (id) => document.getElementById(id);
const MEMORY = [64, 128, 256, 512, 1024, 2048];
const DETAIL = [0.5, 1, 2, 4, 8];

/**
 * @param {object} parts
 * @param {import("./loader.js").Pack | null} parts.pack
 * @param {Promise<Uint8Array>} parts.head
 * @param {Promise<object>} parts.program
 * @param {{whyNoGpu: () => string | null, otherProgram: (address: string, parameters: URLSearchParams) => string | null}} parts.gpu program.js
 * @param {import("./decode-pool.js").DecodePool | null} parts.pool for the first model that is opened
 * @param {() => import("./decode-pool.js").DecodePool} parts.newPool for the others
 * @param {typeof import("./embed.js") | null} parts.embed where this page is inside another one
 * @param {URLSearchParams} parts.parameters
 */
export async function start(parts) {
  const { head, program, parameters } = parts;
  await use(preferred(parameters));
  document.documentElement.classList.add("started");
  const page = new Page(parts);
  await page.open(head, program);
}

class Page {
  constructor({ pack, gpu, pool, newPool, embed, parameters }) {
    Object.assign(this, { pack, gpu, pool, newPool, parameters });
    this.trouble = new Trouble();
    this.status = new Status();
    this.settings = this.#defaults();
    this.session = null;
    this.rebuilt = 0;
    this.api = new Api(this);
    this.undo = new Undo(() => this.#undoButtons());
    this.address = new Address(() => (this.session && !this.session.closed && this.api.isReady ? this.state() : null), (state) => this.restore(state));
    this.cube = new Cube((view) => this.standardView(view));
    this.pictures = new Pictures(() => ({ viewer: this.viewer, session: this.session, title: this.title, engine: () => this.engine() }));
    const pickPoints = (use) => this.#pickPoints(use);
    this.look = new Display({ onChange: () => this.#displayed(), pickPoints });
    this.section = new Section({ display: this.look, pickPoints });
    this.measuring = new Measuring(this);
    this.trouble.onShow = (kind) => this.api.emit("trouble", { kind });
    this.controls();
    this.#contexts();
    if (parameters.has("embed")) embed.reduce(parameters.get("embed") === "bare");
    embed?.serve(this.api, CALLS);
    globalThis.kilwa = this; // the same objects for scripts and tests as for the page
  }

  #defaults() {
    const small = matchMedia("(max-width: 720px)").matches || (navigator.deviceMemory ?? 8) <= 4;
    const asked = (name) => (this.parameters.has(name) ? Number(this.parameters.get(name)) : NaN);
    const memory = asked("memory") > 0 ? asked("memory") : MEMORY[small ? 2 : 3];
    const detail = asked("error") > 0 ? asked("error") : 1;
    return { memory, detail, orthographic: false };
  }

  /** Head and program arrive in parallel; then the first picture, then everything else. */
  async open(head, program) {
    this.program = program;
    if (!this.pack) {
      document.body.dataset.state = "welcome";
      $("loading").hidden = true;
      $("welcome").hidden = false;
      return;
    }
    for (const id of ["download", "trouble-download", "about-download"]) {
      $(id).href = this.pack.url;
      $(id).download = this.pack.name ?? "";
    }
    this.pack.onProgress = (done, total) => this.#progress(done, total);
    let bytes;
    try {
      bytes = await firstBytes(this.pack, head, (seconds) => this.#waits(seconds));
    } catch (error) {
      this.#cannotOpen(error.kind ?? "broken", error);
      return;
    }
    $("loading-text").textContent = t("loadingProgram");
    try {
      const module = await program;
      bytes = await wholeHead(this.pack, module, bytes);
      this.module = module;
      this.headBytes = bytes;
      this.info = JSON.parse(module.packInfo(bytes));
      this.#about();
      if (this.pack.bytes !== this.info.pack.bytes) {
        const detail = `${format.count(this.pack.bytes)} / ${format.count(this.info.pack.bytes)}`;
        throw Object.assign(new Error(detail), { kind: "damaged" });
      }
    } catch (error) {
      // What the parser refuses is no pack, or not a whole one; what a module loader refuses is our own trouble.
      this.#cannotOpen(error.kind ?? (this.module || error.constructor === Error ? "damaged" : "broken"), error);
      return;
    }
    this.#person();
    await this.draw();
    await this.#published();
  }

  /** Until something is tried again, before there is a picture. */
  #waits(seconds) {
    $("loading-text").textContent = t("offlineFirst", { seconds });
  }

  #cannotOpen(kind, error, more) {
    this.pool?.close();
    this.pool = null;
    this.trouble.show(kind, error, more);
  }

  /** What measures (measure/engine.js), loaded when it is first asked for. */
  async engine() {
    return (await this.measuring.load()).engine;
  }

  /** A pack of this computer, in place of what is open. */
  async openFile(file) {
    this.session?.close();
    this.input?.close();
    this.walk?.close();
    this.notes?.tour.close();
    this.notes?.closeForm();
    this.measuring.close();
    if (this.pack?.isLocal) this.pack.close();
    this.pack = new LocalPack(file);
    this.session = this.module = this.info = this.usual = null;
    document.body.dataset.state = "loading";
    document.body.dataset.pack = "";
    for (const id of ["welcome", "trouble"]) $(id).hidden = true;
    $("loading").hidden = false;
    history.replaceState(null, "", location.pathname + location.search);
    await this.open(this.pack.head(), this.program);
  }

  /** What the person keeps for this pack: saved views and notes. */
  #person() {
    const { hash } = this.info.pack;
    this.identity?.close();
    this.identity = new Identity({ pack: this.pack, head: this.headBytes, module: this.module, hash });
    const { identity } = this;
    const now = () => ({ camera: [...(this.flight.goal ?? this.viewer.camera())], display: this.display() });
    this.undo.done = [];
    this.undo.undone = [];
    this.#undoButtons();
    this.saved = new Saved({ hash, identity, title: this.title, undo: this.undo, now, go: (view) => this.goTo(view) });
    this.notes?.close();
    this.notes = new Notes({
      hash,
      identity,
      title: this.title,
      pack: this.pack.isLocal ? null : new URL(this.pack.url, location.href).href,
      undo: this.undo,
      now,
      look: (note, isJump) => this.#lookAt(note, isJump),
      tool: (name) => this.tool(name),
      tell: (event, detail) => {
        if (event === "annotation") this.address.now();
        else this.address.later();
        this.api.emit(event, detail);
      },
      shareAddress: () => this.share(),
    });
  }

  /** Notes that the host publishes beside the pack. */
  async #published() {
    const address = this.parameters.get("annotations") ?? document.body.dataset.annotations;
    if (!address || this.pack.isLocal) return;
    try {
      this.notes.publish(await fetchPublished(address, this.pack.url));
      const { annotation } = readState(location.hash);
      if (annotation && !this.notes.openId) this.notes.openNamed(annotation, { fly: !readState(location.hash).camera, isJump: false });
    } catch (error) {
      chrome.notice(t("annotationsFailed", { why: error.message }), 12000);
    }
  }

  /** Make the viewer and start streaming; again after the device was lost, with the same camera. */
  async draw(state = readState(location.hash)) {
    const canvas = $("canvas");
    const reason = this.gpu.whyNoGpu();
    let viewer;
    try {
      if (reason) throw Object.assign(new Error("no GPU"), { kind: "noGpu" });
      canvas.width = Math.max(1, Math.round(canvas.clientWidth * Math.min(devicePixelRatio, 2)));
      canvas.height = Math.max(1, Math.round(canvas.clientHeight * Math.min(devicePixelRatio, 2)));
      viewer = await this.module.Viewer.create(canvas, this.headBytes);
    } catch (error) {
      const isNoGpu = error.kind === "noGpu";
      // A canvas that was asked for WebGPU gives no WebGL any more: the page begins again, once.
      const other = isNoGpu && !reason ? this.gpu.otherProgram(location.href, this.parameters) : null;
      if (other) {
        location.replace(other);
        return;
      }
      this.#cannotOpen(isNoGpu ? "noGpu" : "broken", error, { reason: reason ?? "noGpuAdapter" });
      return;
    }
    const { colors, scalars } = this.info.pack;
    this.viewer = viewer;
    if (state.camera) viewer.setCamera(state.camera);
    this.session = new Session({
      canvas,
      viewer,
      pack: this.pack,
      head: this.headBytes,
      pool: this.pool ?? this.newPool(),
      attributes: { colors, scalars },
      on: {
        frame: (stats) => this.#frame(stats),
        first: () => this.#first(),
        waits: (seconds) => this.#waits(seconds),
        changed: () => this.trouble.show("changed", this.session.lastFailure),
        lost: (error) => chrome.notice(`${t(`${error.kind}Title`)}. ${error.message}`),
        damaged: (chunk, error) => this.#damaged(chunk, error),
        broken: (error) => this.trouble.show("broken", error),
      },
    });
    this.pool = null; // It ends with this session.
    const { session } = this;
    viewer.whenLost().then(() => session.wake());
    this.input?.close();
    this.walk?.close();
    this.flight = new Flight({ viewer, session, onHistory: () => this.#viewButtons() });
    this.walk = new Walk({ viewer, session, flight: this.flight, onChange: () => this.#projected() });
    this.input = new Input(session, this.actions, this);
    this.notes.attach(viewer, session);
    this.loupe = new Loupe(session);
    const usual = this.look.attach(viewer, session, this.info);
    if (!this.usual) this.usual = usual;
    viewer.setMode(this.usual);
    this.section.attach(viewer, session);
    this.settle();
    this.tool("orbit");
    this.#turning();
    this.#viewButtons();
    if (state.display) this.setDisplay(state.display);
    this.measuring.attach(viewer, session, state.measurements);
    this.notes.setShown(state.notes);
    if (state.annotation) this.notes.openNamed(state.annotation, { fly: !state.camera });
    session.firstPicture.then(() => this.#identify(state.pack));
  }

  /** Whether the link that opened the page is of this pack; from then on the address names it by its identity. */
  async #identify(linked) {
    const { identity } = this;
    const isHere = !linked || (await identity.isHere(linked));
    await identity.known();
    if (this.identity !== identity || this.session.closed) return;
    if (!isHere) chrome.notice(t("otherPack"), 20000, { label: t("fit"), run: () => this.home() });
    document.body.dataset.identity = identity.text ?? "";
    if (readState(location.hash).pack) this.address.now();
  }

  actions = {
    hover: (x, y) => {
      this.status.hover(this.viewer, x, y);
      if (this.input.tool === "measure") this.measuring.hover(x, y);
    },
    leave: () => this.status.leave(),
    aim: (at) => {
      this.loupe.show(at);
      if (at) this.actions.hover(...at);
    },
    step: (key) => this.measuring.key(key),
    fit: () => this.fit(),
    view: (name) => this.standardView(name),
    hide: () => chrome.toggleChrome(),
    help: () => $("help").showModal(),
    pivot: () => {},
    parallel: () => this.#parallel(!this.settings.orthographic),
    free: () => this.#turning(!this.input.isFree),
    tool: (name) => this.tool(name),
    place: (x, y, how) => this.#place(x, y, how),
    save: () => this.#save(),
    picture: () => this.session && !this.session.closed && this.pictures.open(),
    back: () => this.flight.back(),
    forward: () => this.flight.forward(),
  };

  get title() {
    // What was published under a title has it; a file of this computer has its own.
    const published = this.pack?.isLocal ? "" : document.body.dataset.title;
    return published || this.info?.metadata.title.trim() || this.pack?.name || document.title;
  }

  // What the address, saved views and notes hold.

  /** Shading, light and section, where they are not as usual; else null. */
  display() {
    const { mode, ...more } = JSON.parse(this.viewer.displayState());
    const display = { ...(this.viewer.mode() === this.usual ? {} : { mode: this.viewer.mode() }), ...more };
    return Object.keys(display).length > 0 ? display : null;
  }

  /** What is left out is as usual. */
  setDisplay(display) {
    try {
      this.viewer.setDisplayState(JSON.stringify({ mode: this.usual, ...display }));
    } catch (error) {
      chrome.notice(t("displayFailed", { why: error.message }), 10000);
    }
    this.#displayed();
    this.session.wake();
  }

  state() {
    const { viewer, notes, identity } = this;
    return { camera: [...(this.flight.goal ?? viewer.camera())], display: this.display(), notes: notes.shown, annotation: notes.openId, measurements: this.measuring.address, pack: identity.name };
  }

  /** A state of the address: after Back and Forward, from a link, from a script. */
  restore(state) {
    if (!this.session || this.session.closed) return;
    if (this.walk.on) this.tool("orbit");
    if (state.camera) this.flight.to(state.camera).then(() => this.#projected());
    this.setDisplay(state.display);
    this.notes.setShown(state.notes);
    // The browser has made the entry of a link that was followed on this page.
    if (state.annotation) this.notes.openNamed(state.annotation, { fly: !state.camera, isJump: false });
    else this.notes.tour.close();
  }

  // Deliberate moves.

  /** Where `move` takes the camera, flown to. */
  #fly(move, { isJump }) {
    if (!this.session || this.session.closed) return Promise.resolve(false);
    if (this.walk.on) this.tool("orbit");
    if (isJump) this.address.leave();
    const here = this.flight.goal ?? [...this.viewer.camera()];
    this.flight.mark();
    this.flight.stop();
    const from = [...this.viewer.camera()];
    this.viewer.setCamera(new Float64Array(here));
    move(this.viewer);
    const goal = [...this.viewer.camera()];
    this.viewer.setCamera(new Float64Array(from));
    const arrived = this.flight.to(goal, { mark: false });
    this.#projected(goal);
    return arrived;
  }

  fit() {
    return this.#fly((v) => v.fit(), { isJump: false });
  }

  home() {
    return this.standardView("iso");
  }

  standardView(name) {
    const below = (v) => v.setCamera(new Float64Array([Math.PI, -Math.PI / 2, 1, 0, 0, 0, 1])) && v.fit();
    return this.#fly((v) => (name === "below" ? below(v) : v.standardView(name)), { isJump: true });
  }

  /** A saved view. */
  goTo({ camera, display, name }) {
    this.#fly((v) => v.setCamera(new Float64Array(camera)), { isJump: true });
    this.setDisplay(display);
    this.#say(name);
  }

  /** A note: as it was looked at when it was written, or from here. */
  #lookAt({ camera, display, place }, isJump) {
    const near = (v) => {
      const c = [...v.camera()];
      const reach = v.metresPerPixel() * this.session.canvas.height;
      v.setCamera(new Float64Array([c[0], c[1], Math.min(c[2], c[2] * Math.max(0.2, 10 / reach)), ...place, ...c.slice(6)]));
    };
    this.#fly((v) => (camera ? v.setCamera(new Float64Array(camera)) : near(v)), { isJump });
    if (display) this.setDisplay(display);
  }

  /** A part of the model, `across` metres wide, from where it is looked at now. */
  lookAtRegion(middle, across) {
    this.#fly((v) => {
      const c = [...v.camera()];
      const shown = v.metresPerPixel() * Math.min(this.session.canvas.width, this.session.canvas.height);
      v.setCamera(new Float64Array([c[0], c[1], (c[2] * Math.max(across * 1.6, 1e-3)) / shown, ...middle, ...c.slice(6)]));
    }, { isJump: true });
  }

  #save() {
    if (!this.session || this.session.closed) return;
    const view = this.saved.add();
    chrome.openTab("saved");
    this.saved.list.edit(view.id);
  }

  #place(x, y, how) {
    if (this.input.tool === "measure") {
      this.measuring.place(x, y, how);
      return;
    }
    const hit = this.viewer.pick(x, y);
    if (hit.length === 0) {
      chrome.notice(t("noteMissed"));
      return;
    }
    if (this.points) {
      this.#point(hit);
      return;
    }
    this.input.showPoint(null);
    this.notes.place([...hit].slice(0, 3));
  }

  #say(text) {
    $("announce").textContent = text;
  }

  /** The projection may have changed with the camera. */
  #projected(camera = this.viewer.camera()) {
    this.settings.orthographic = camera[6] === 1;
    this.#showProjection();
  }

  #move(move) {
    if (!this.session || this.session.closed) return;
    move(this.viewer);
    this.#projected();
    this.session.wake();
  }

  /** On the turntable up stays up; freely there is no up. */
  #turning(free = this.input?.isFree ?? false) {
    if (!this.input) return;
    this.input.isFree = free;
    document.querySelector(`input[name=turning][value=${free ? "free" : "turntable"}]`).checked = true;
    const camera = [...this.viewer.camera()];
    if (!free && Math.abs(camera[7]) > 1e-9) {
      camera[7] = 0;
      this.flight.to(camera);
    }
  }

  #viewButtons() {
    $("view-back").disabled = !this.flight?.canGoBack;
    $("view-forward").disabled = !this.flight?.canGoForward;
  }

  #undoButtons() {
    $("edit-undo").disabled = this.undo.done.length === 0;
    $("edit-redo").disabled = this.undo.undone.length === 0;
  }

  #parallel(orthographic) {
    this.#move((v) => v.setOrthographic(orthographic));
  }

  #showProjection() {
    const value = this.settings.orthographic ? "orthographic" : "perspective";
    document.querySelector(`input[name=projection][value=${value}]`).checked = true;
  }

  /** Hand all settings to the viewer. */
  settle() {
    const { memory, detail } = this.settings;
    $("memory-value").textContent = format.bytes(memory * 1e6);
    $("detail-value").textContent = t("pixels", { n: format.pixels(detail) });
    if (!this.session || this.session.closed) return;
    this.viewer.setMemory(memory * 1e6, memory * 2e6);
    this.viewer.setTargetPixels(detail);
    this.look.settle();
    this.section.refresh();
    this.settings.orthographic = this.viewer.camera()[6] === 1;
    this.#showProjection();
    this.session.wake();
  }

  #progress(done, total) {
    if (this.session) return;
    $("loading-bar").value = total ? done / total : 0;
    $("loading-text").textContent = t("loadingBytes", { done: format.bytes(done), total: format.bytes(total || done) });
  }

  #first() {
    document.body.dataset.state = "ready";
    $("loading").hidden = true;
    $("cube").hidden = false;
    this.api.emit("ready");
    if (this.pack.whole) chrome.notice(t("noRangeSmall", { size: format.bytes(this.pack.bytes) }), 12000);
  }

  #frame(stats) {
    if (stats.lost) {
      this.#rebuild();
      return;
    }
    this.status.show(stats, this.viewer, this.session);
    if (!$("info").hidden) this.status.list($("stats"), stats, this.session);
    const camera = this.viewer.camera();
    this.cube.show(camera);
    this.notes.pins?.frame(stats);
    this.measuring.frame(stats);
    this.loupe.frame();
    this.section.frame();
    this.walk.frame(stats);
    this.address.later();
    this.api.emit("frame", stats);
    if (this.seen !== String(camera)) {
      this.seen = String(camera);
      clearTimeout(this.resting);
      this.resting = setTimeout(() => this.session && !this.session.closed && this.api.emit("camera", this.api.getCamera()), 200);
    }
  }

  /** The device is gone: the same page, head and camera on a new one, unless that keeps happening. */
  #rebuild() {
    const state = this.#leaveDevice();
    if (state) this.draw(state);
  }

  /** Gives up what the lost device held; what the page showed, or null where it keeps being lost. */
  #leaveDevice() {
    const state = { ...this.state(), camera: this.viewer.camera(), pack: null };
    this.session.close();
    this.input.close();
    this.rebuilt += 1;
    if (this.rebuilt > 3) {
      this.trouble.show("noGpu", new Error("device lost"), { reason: "noGpuAdapter" });
      return null;
    }
    chrome.notice(t("gpuLost"));
    return state;
  }

  /** WebGL 2 says so on the canvas, and gives the same canvas another context when it can: wgpu hears of neither. */
  #contexts() {
    let left = null;
    $("canvas").addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      if (this.session && !this.session.closed) left = this.#leaveDevice();
    });
    $("canvas").addEventListener("webglcontextrestored", () => {
      if (left) this.draw(left);
      left = null;
    });
  }

  #damaged(chunk, error) {
    if (!this.session.drawn && this.session.damaged.get(chunk) >= 2) {
      this.trouble.show("damaged", error);
      this.session.close();
      return;
    }
    chrome.notice(t("damagedPart"), 10000);
  }

  #about() {
    const { title } = this;
    $("title").textContent = title;
    $("about-title").textContent = title;
    document.title = `${title} - Kilwa`;
    $("canvas").setAttribute("aria-label", `${t("canvas")}: ${title}`);
    $("facts").replaceChildren(factsList(this.info));
  }

  /** Shading, light or section changed. */
  #displayed() {
    this.look.refresh();
    this.section.refresh();
    this.address.later();
  }

  /** Let the person press three places on the surface, then go on as before. */
  #pickPoints(use) {
    this.points = { use, found: [] };
    this.tool("points");
  }

  #point(hit) {
    this.points.found.push([...hit].slice(0, 3));
    if (this.points.found.length < 3) {
      chrome.hint(this.#hint("points"));
      return;
    }
    const { use, found } = this.points;
    this.tool("orbit");
    use(found);
  }

  #hint(tool) {
    const touch = matchMedia("(pointer: coarse)").matches;
    return { walk: () => t(touch ? "hintWalkTouch" : "hintWalk"), note: () => t(touch ? "hintNoteTouch" : "hintNote"), measure: () => this.measuring.hint, points: () => t("hintPoints", { n: format.count(this.points.found.length + 1) }) }[tool]?.();
  }

  controls() {
    chrome.tabs();
    chrome.panel();
    chrome.divider();
    chrome.keys();
    chrome.tooltips();
    chrome.help();
    chrome.menu($("views-open"), $("views"), (item) => this.actions.view(item.dataset.view));
    const click = (id, action) => $(id).addEventListener("click", action);
    click("fit", () => this.actions.fit());
    click("zoom-in", () => this.input?.zoom(0.7));
    click("zoom-out", () => this.input?.zoom(1 / 0.7));
    click("hide", () => this.actions.hide());
    click("show-again", () => this.actions.hide());
    click("help-open", () => this.actions.help());
    click("share", () => this.share());
    click("picture-open", () => this.actions.picture());
    click("fullscreen", () => (document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen()));
    click("trouble-retry", () => location.reload());
    for (const tool of ["orbit", "pan"]) click(`tool-${tool}`, () => this.tool(tool));
    for (const tool of ["walk", "note", "measure"]) click(`tool-${tool}`, () => this.tool(this.input?.tool === tool ? "orbit" : tool));
    click("walk-leave", () => this.tool("orbit"));
    for (const button of $("grid-views").querySelectorAll("[data-view]")) button.addEventListener("click", () => this.standardView(button.dataset.view));
    click("view-back", () => this.flight?.back());
    click("view-forward", () => this.flight?.forward());
    click("view-save", () => this.#save());
    click("saved-export", () => this.saved?.export());
    click("note-new", () => this.tool("note"));
    click("tour-start", () => this.notes.open(this.notes.notes[0], { focus: true }));
    click("notes-export", () => this.notes?.export());
    click("notes-published", () => this.notes.revert());
    click("edit-undo", () => this.undo.undo());
    click("edit-redo", () => this.undo.redo());
    const chosen = (id, read) => $(id).addEventListener("change", async (event) => {
      const [file] = event.target.files;
      event.target.value = "";
      if (file) await read(file);
    });
    chosen("saved-import", (file) => this.saved?.import(file));
    chosen("notes-import", (file) => this.notes?.import(file));
    $("notes-shown").addEventListener("change", (event) => {
      this.notes?.setShown(event.target.checked);
      this.address.later();
    });
    $("saved").addEventListener("change", (event) => event.target.name === "turning" && this.#turning(event.target.value === "free"));
    addEventListener("keydown", (event) => this.#editKey(event));
    openers({ input: $("open-file"), drop: $("drop"), open: (file) => (/\.json(ld)?$/i.test(file.name) ? this.#document(file) : this.openFile(file)) });
    const list = document.body.dataset.list;
    for (const id of ["back", "trouble-back"]) {
      $(id).hidden = !list;
      // A language that came by the address goes on by it: the list has no other memory.
      if (list) $(id).href = this.parameters.has("lang") ? `${list}?lang=${document.documentElement.lang}` : list;
    }
    this.#settingsControls();
    $("language").value = document.documentElement.lang;
    $("language").addEventListener("change", async (event) => {
      remember(event.target.value);
      await use(event.target.value);
    });
    addEventListener("pagehide", () => this.notes?.closeForm());
    onChange(() => this.translate());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.settle());
    addEventListener("online", () => this.session?.wake());
  }

  #settingsControls() {
    const nearest = (list, value) => list.reduce((best, v, i) => (Math.abs(v - value) < Math.abs(list[best] - value) ? i : best), 0);
    $("memory").value = nearest(MEMORY, this.settings.memory);
    $("detail").value = nearest(DETAIL, this.settings.detail);
    $("memory").addEventListener("input", (event) => {
      this.settings.memory = MEMORY[event.target.value];
      this.settle();
    });
    $("detail").addEventListener("input", (event) => {
      this.settings.detail = DETAIL[event.target.value];
      this.settle();
    });
    $("display").addEventListener("change", (event) => {
      if (event.target.name === "projection") this.#parallel(event.target.value === "orthographic");
    });
    // The figures are written while they can be seen.
    $("tab-info").addEventListener("click", () => this.session?.wake());
    this.settle();
  }

  /** A document that was dropped: it says itself what it holds. */
  async #document(file) {
    if (!this.info) return;
    try {
      const json = await readJson(file, 64e6);
      if (json?.kilwa === "measurements") await (await this.measuring.load()).files.read(file);
      else if (json?.type === "KilwaViews") await this.saved.import(file);
      else await this.notes.import(file);
    } catch (error) {
      chrome.notice(t("importFailed", { why: error.message }), 12000);
    }
  }

  async setLanguage(language) {
    await use(language);
    $("language").value = document.documentElement.lang;
  }

  /** Undo and redo of edits, where the keyboard is not in a text. */
  #editKey(event) {
    if (!(event.ctrlKey || event.metaKey) || event.altKey || event.target.closest?.("input, textarea, select")) return;
    const key = event.key.toLowerCase();
    if (key !== "z" && key !== "y") return;
    const isRedo = key === "y" || event.shiftKey;
    const done = this.measuring.undo(isRedo) || (isRedo ? this.undo.redo() : this.undo.undo());
    event.preventDefault();
    if (done) this.#say(t(isRedo ? "redo" : "undo"));
  }

  /** What the left button, one finger and the keys do: orbit, pan, walk, note, measure (with which tool). */
  tool(name, which = null) {
    if (!this.session || this.session.closed) return;
    if (name !== "walk") this.walk.leave();
    if (name !== "measure") this.measuring.leave();
    this.input.tool = name;
    this.input.showPoint(null);
    for (const other of ["orbit", "pan", "walk", "note", "measure"]) $(`tool-${other}`).setAttribute("aria-pressed", String(other === name));
    $("canvas").dataset.tool = name;
    chrome.hint(this.#hint(name));
    if (name === "walk" || name === "note") chrome.peek();
    if (name === "walk") this.walk.enter();
    if (name === "points") this.points.found = [];
    else if (this.points) this.points = null;
    if (["walk", "note", "points", "measure"].includes(name)) $("canvas").focus({ preventScroll: true });
    if (name === "measure") this.measuring.start(which);
  }

  async share() {
    this.address.now();
    try {
      // The end of the file may still be on its way; a clipboard does not wait long for it.
      if (!this.identity.text) await Promise.race([this.identity.known(), new Promise((resolve) => setTimeout(resolve, 1000))]);
      this.address.now();
      await navigator.clipboard.writeText(location.href);
      if (this.measuring.tools?.isLong) chrome.notice(t("measureLinkLong"), 12000, { label: t("exportFile"), run: () => this.measuring.tools.files.save("json") });
      else chrome.notice(t("shared"), 2500);
    } catch {
      chrome.notice(t("shareFailed"));
    }
  }

  translate() {
    chrome.help();
    this.trouble.translate();
    if (this.info) this.#about();
    this.settle();
    this.saved?.show();
    this.notes?.show();
    this.walk?.show();
    this.measuring.translate();
    if (this.input) chrome.hint(this.#hint(this.input.tool));
  }
}
