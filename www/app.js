// The page: brings head, program and controls together, and shows what is going on.

import * as chrome from "./chrome.js";
import { DecodePool } from "./decode-pool.js";
import * as format from "./format.js";
import { apply, onChange, preferred, remember, t, use } from "./i18n.js";
import { Input } from "./input.js";
import { isPassing } from "./loader.js";
import { factsList } from "./facts.js";
import { whyNoGpu } from "./program.js";
import { Session } from "./session.js";
import { Status } from "./status.js";
import { readView, writeView } from "./link.js";
import { Trouble } from "./trouble.js";

const $ = (id) => document.getElementById(id);
const MEMORY = [64, 128, 256, 512, 1024, 2048];
const DETAIL = [0.5, 1, 2, 4, 8];
const MODE_NAMES = { colour: "modeColor", clay: "modeClay", normals: "modeNormals", level: "modeLevels", error: "modeError" };

/** @param {{pack: import("./loader.js").Pack | null, head: Promise<Uint8Array>, program: Promise<object>, parameters: URLSearchParams}} parts */
export async function start({ pack, head, program, parameters }) {
  await use(preferred(parameters));
  document.documentElement.classList.add("started");
  const page = new Page(pack, parameters);
  await page.open(head, program);
}

class Page {
  constructor(pack, parameters) {
    this.pack = pack;
    this.parameters = parameters;
    this.trouble = new Trouble();
    this.status = new Status();
    this.settings = this.#defaults();
    this.session = null;
    this.rebuilt = 0;
    this.controls();
    globalThis.kilwa = this; // the same objects for scripts and tests as for the page
  }

  #defaults() {
    const small = matchMedia("(max-width: 720px)").matches || (navigator.deviceMemory ?? 8) <= 4;
    const asked = (name) => (this.parameters.has(name) ? Number(this.parameters.get(name)) : NaN);
    const memory = asked("memory") > 0 ? asked("memory") : MEMORY[small ? 2 : 3];
    const detail = asked("error") > 0 ? asked("error") : 1;
    return { memory, detail, mode: null, orthographic: false };
  }

  /** Head and program arrive in parallel; then the first picture, then everything else. */
  async open(head, program) {
    this.program = program;
    if (!this.pack) {
      this.trouble.show("missing", { kind: "missing" });
      return;
    }
    for (const id of ["download", "trouble-download"]) $(id).href = this.pack.url;
    this.pack.onProgress = (done, total) => this.#progress(done, total);
    let bytes;
    try {
      bytes = await this.#head(head);
    } catch (error) {
      this.trouble.show(error.kind ?? "broken", error);
      return;
    }
    $("loading-text").textContent = t("loadingProgram");
    try {
      const module = await program;
      bytes = await this.#whole(module, bytes);
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
      this.trouble.show(error.kind ?? (this.module || error.constructor === Error ? "damaged" : "broken"), error);
      return;
    }
    await this.draw();
  }

  async #head(first) {
    for (let attempt = 0, pending = first; ; attempt += 1) {
      try {
        return await pending;
      } catch (error) {
        if (!isPassing(error)) throw error;
        await this.#wait(Math.min(30, 2 ** (attempt + 1)));
        pending = this.pack.head();
      }
    }
  }

  /** Count the seconds down; being online again ends the wait. */
  async #wait(seconds) {
    for (let left = seconds; left > 0; left -= 1) {
      $("loading-text").textContent = t("offlineFirst", { seconds: left });
      let online;
      const again = new Promise((resolve) => {
        online = () => resolve(true);
        addEventListener("online", online, { once: true });
        setTimeout(resolve, 1000, false);
      });
      const isBack = await again;
      removeEventListener("online", online);
      if (isBack) return;
    }
  }

  /** A head longer than the first request asked for, where the metadata is large. */
  async #whole(module, bytes) {
    const needed = module.headNeeds(bytes);
    if (needed === 0) return bytes;
    if (needed > this.pack.bytes) throw Object.assign(new Error(`${needed} > ${this.pack.bytes}`), { kind: "damaged" });
    return this.pack.head(needed);
  }

  /** Make the viewer and start streaming; again after the device was lost, with the same camera. */
  async draw(camera = readView(location.hash)) {
    const canvas = $("canvas");
    const reason = whyNoGpu();
    let viewer;
    try {
      if (reason) throw new Error("nogpu:");
      canvas.width = Math.max(1, Math.round(canvas.clientWidth * Math.min(devicePixelRatio, 2)));
      canvas.height = Math.max(1, Math.round(canvas.clientHeight * Math.min(devicePixelRatio, 2)));
      viewer = await this.module.Viewer.create(canvas, this.headBytes);
    } catch (error) {
      const isNoGpu = String(error.message).startsWith("nogpu:");
      this.trouble.show(isNoGpu ? "noGpu" : "broken", error, { reason: reason ?? "noGpuAdapter" });
      return;
    }
    const { colors, scalars } = this.info.pack;
    const cores = navigator.hardwareConcurrency ?? 2;
    this.viewer = viewer;
    if (camera) viewer.setCamera(camera);
    this.session = new Session({
      canvas,
      viewer,
      pack: this.pack,
      head: this.headBytes,
      pool: new DecodePool(Math.max(1, Math.min(4, cores - 1))),
      attributes: { colors, scalars },
      on: {
        frame: (stats) => this.#frame(stats),
        first: () => this.#first(),
        changed: () => this.trouble.show("changed", this.session.lastFailure),
        lost: (error) => chrome.notice(`${t(`${error.kind}Title`)}. ${error.message}`),
        damaged: (chunk, error) => this.#damaged(chunk, error),
        broken: (error) => this.trouble.show("broken", error),
      },
    });
    this.input?.close();
    this.input = new Input(this.session, this.actions);
    this.#modes();
    this.settle();
  }

  actions = {
    hover: (x, y) => this.status.hover(this.viewer, x, y),
    leave: () => this.status.leave(),
    fit: () => this.#move((v) => v.fit()),
    view: (name) => this.#move((v) => v.standardView(name)),
    hide: () => chrome.toggleChrome(),
    help: () => $("help").showModal(),
    pivot: () => {},
    parallel: () => this.#parallel(!this.settings.orthographic),
  };

  #move(move) {
    if (!this.session || this.session.closed) return;
    move(this.viewer);
    this.settings.orthographic = this.viewer.camera()[6] === 1;
    this.#showProjection();
    this.session.wake();
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
    const { memory, detail, mode } = this.settings;
    $("memory-value").textContent = format.bytes(memory * 1e6);
    $("detail-value").textContent = t("pixels", { n: format.pixels(detail) });
    if (!this.session || this.session.closed) return;
    this.viewer.setMemory(memory * 1e6, memory * 2e6);
    this.viewer.setTargetPixels(detail);
    this.viewer.setDark(matchMedia("(prefers-color-scheme: dark)").matches);
    if (mode) this.viewer.setMode(mode);
    const [low, high] = this.module.Viewer.errorScale();
    $("error-legend").hidden = this.viewer.mode() !== "error";
    $("error-low").textContent = `≤ ${format.round(low)}`;
    $("error-high").textContent = `≥ ${format.round(high)}`;
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
    $("compass").hidden = false;
    if (this.pack.whole) chrome.notice(t("noRangeSmall", { size: format.bytes(this.pack.bytes) }), 12000);
  }

  #frame(stats) {
    if (stats.lost) {
      this.#rebuild();
      return;
    }
    this.status.show(stats, this.viewer, this.session);
    if (!$("info").hidden) this.status.list($("stats"), stats, this.session);
    writeView(this.viewer);
  }

  /** The device is gone: the same page, head and camera on a new one, unless that keeps happening. */
  #rebuild() {
    const camera = this.viewer.camera();
    this.session.close();
    this.input.close();
    this.rebuilt += 1;
    if (this.rebuilt > 3) {
      this.trouble.show("noGpu", new Error("device lost"), { reason: "noGpuAdapter" });
      return;
    }
    chrome.notice(t("gpuLost"));
    this.draw(camera);
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
    const title = this.info.metadata.title.trim() || document.title;
    $("title").textContent = title;
    $("about-title").textContent = title;
    document.title = `${title} - Kilwa`;
    $("canvas").setAttribute("aria-label", `${t("canvas")}: ${title}`);
    $("facts").replaceChildren(factsList(this.info));
  }

  #modes() {
    const chosen = this.settings.mode ?? this.viewer.mode();
    const names = this.module.Viewer.modes().filter((m) => m !== "colour" || this.info.pack.colors);
    const selected = names.includes(chosen) ? chosen : (names[0] ?? chosen);
    this.settings.mode = selected;
    $("modes").replaceChildren(
      ...names.map((name) => {
        const label = document.createElement("label");
        label.className = "choice";
        const input = Object.assign(document.createElement("input"), {
          type: "radio", name: "mode", value: name, checked: name === selected,
        });
        const text = document.createElement("span");
        text.dataset.text = MODE_NAMES[name] ?? name;
        label.append(input, text);
        return label;
      }),
    );
    apply($("modes"));
  }

  controls() {
    chrome.tabs();
    chrome.panel();
    chrome.tooltips();
    chrome.help();
    chrome.menu($("views-open"), $("views"), (item) => this.actions.view(item.dataset.view));
    const click = (id, action) => $(id).addEventListener("click", action);
    click("fit", () => this.actions.fit());
    click("zoom-in", () => this.input?.zoom(0.7));
    click("zoom-out", () => this.input?.zoom(1 / 0.7));
    click("compass", () => this.actions.view("plan"));
    click("hide", () => this.actions.hide());
    click("show-again", () => this.actions.hide());
    click("help-open", () => this.actions.help());
    click("share", () => this.share());
    click("fullscreen", () => (document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen()));
    click("trouble-retry", () => location.reload());
    for (const tool of ["orbit", "pan"]) click(`tool-${tool}`, () => this.tool(tool));
    const list = document.body.dataset.list;
    for (const id of ["back", "trouble-back"]) {
      $(id).hidden = !list;
      if (list) $(id).href = list;
    }
    this.#settingsControls();
    $("language").value = document.documentElement.lang;
    $("language").addEventListener("change", async (event) => {
      remember(event.target.value);
      await use(event.target.value);
    });
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
      if (event.target.name === "mode") {
        this.settings.mode = event.target.value;
        this.settle();
      } else if (event.target.name === "projection") {
        this.#parallel(event.target.value === "orthographic");
      }
    });
    // The figures are written while they can be seen.
    $("tab-info").addEventListener("click", () => this.session?.wake());
    this.settle();
  }

  /** What the left button and one finger do. */
  tool(name) {
    if (this.input) this.input.tool = name;
    for (const other of ["orbit", "pan"]) $(`tool-${other}`).setAttribute("aria-pressed", String(other === name));
    $("canvas").dataset.tool = name;
  }

  async share() {
    if (this.viewer) writeView(this.viewer, true);
    try {
      await navigator.clipboard.writeText(location.href);
      chrome.notice(t("shared"), 2500);
    } catch {
      chrome.notice(t("shareFailed"));
    }
  }

  translate() {
    chrome.help();
    this.trouble.translate();
    if (this.info) this.#about();
    this.settle();
  }
}
