// `<kilwa-viewer src="fort.kilwa">`: the viewer as an element of any page.
//
//   <script type="module" src="https://host/viewer/kilwa-viewer.js"></script>
//   <kilwa-viewer src="https://host/packs/fort.kilwa" style="height: 480px"></kilwa-viewer>
//
// Attributes: `src` (the pack), `view` (a link's part behind the `#`), `annotations` (address of published notes), `lang`,
// `viewer` (address of the viewer's page; else the folder of this file), `controls="none"`. Methods return promises;
// see kilwa-viewer.d.ts. The viewer is in a frame: neither document can break the other, and messages are taken only
// from that frame and its origin.

import { CALLS } from "./calls.js";

const HERE = new URL("./", import.meta.url);
/** Shown in place of a viewer that does not come, in the languages of the viewer. @type {Record<string, [string, string]>} */
const WORDS = {
  en: ["The 3D model cannot be shown here: {host} does not allow this page to embed it, or does not answer.", "Open the model"],
  fr: ["Le modèle 3D ne peut pas s’afficher ici : {host} n’autorise pas cette page à l’intégrer, ou ne répond pas.", "Ouvrir le modèle"],
  pt: ["O modelo 3D não pode ser mostrado aqui: {host} não permite que esta página o incorpore, ou não responde.", "Abrir o modelo"],
  sw: ["Modeli ya 3D haiwezi kuonyeshwa hapa: {host} hairuhusu ukurasa huu kuipachika, au haijibu.", "Fungua modeli"],
  ar: ["لا يمكن عرض النموذج ثلاثي الأبعاد هنا: لا يسمح {host} لهذه الصفحة بتضمينه، أو لا يجيب.", "فتح النموذج"],
};
const EVENTS = ["ready", "frame", "camera", "annotation", "annotations", "measurement", "measurements", "trouble"];

/** Whether the viewer in the frame has answered. @typedef {{heard: boolean, promise: Promise<void>, resolve: () => void, end: (error: Error) => void}} Hello */

export class KilwaViewerElement extends HTMLElement {
  static observedAttributes = ["src", "annotations", "lang", "viewer", "controls"];
  /** Milliseconds that whoever calls waits for the viewer's page, once that has loaded. */
  static patience = 15_000;
  /** Milliseconds after which a viewer's page that has loaded and sends nothing is taken for blocked. */
  static silence = 5_000;
  /** @type {HTMLIFrameElement | null} */
  #frame = null;
  /** The open calls, by number. @type {Map<number, {resolve: (result: any) => void, reject: (error: Error) => void}>} */
  #calls = new Map();
  #last = 0;
  /** What is shown in place of a viewer that does not come. @type {HTMLElement | null} */
  #plate = null;
  /** The viewer's page runs in the frame, whether it may be spoken to or not. */
  #heardFrom = false;
  /** @type {Hello | null} */
  #hello = null;
  #origin = "";
  #onMessage = (/** @type {MessageEvent} */ event) => this.#take(event);

  connectedCallback() {
    if (!this.shadowRoot) {
      const style = new CSSStyleSheet();
      style.replaceSync(
        `:host { display: block; position: relative; box-sizing: border-box; inline-size: 100%; min-inline-size: 0; max-inline-size: 100%; min-block-size: 240px; aspect-ratio: 16 / 10; }
         :host([hidden]) { display: none; }
         iframe { position: absolute; inset: 0; width: 100%; height: 100%; border: 0; }
         div { position: absolute; inset: 0; display: grid; place-content: center; gap: 8px; padding: 16px; overflow: auto; text-align: center; font: 15px/1.4 system-ui, sans-serif; color: #2b2620; background: #f2eee6; }
         p { margin: 0; overflow-wrap: anywhere; } a { color: #7a4a00; }`,
      );
      this.attachShadow({ mode: "open" }).adoptedStyleSheets = [style];
    }
    addEventListener("message", this.#onMessage);
    this.#load();
  }

  disconnectedCallback() {
    removeEventListener("message", this.#onMessage);
    this.#drop("the element was removed");
  }

  /**
   * @param {string} _name
   * @param {string | null} before
   * @param {string | null} after
   */
  attributeChangedCallback(_name, before, after) {
    if (this.isConnected && this.shadowRoot && before !== after) this.#load();
  }

  get src() {
    return this.getAttribute("src") ?? "";
  }

  set src(value) {
    this.setAttribute("src", value);
  }

  /** Resolves when the viewer answers; rejects where its page has loaded and does not. */
  get loaded() {
    return this.#hello?.promise ?? Promise.reject(new Error("the element has no src, or is not in a document"));
  }

  /** @param {string} why */
  #drop(why) {
    this.#hello?.end(new Error(why));
    this.#hello = null;
    this.#refuse(why);
    this.#frame?.remove();
    this.#frame = null;
  }

  /**
   * Calls to a viewer that is gone get no answer.
   * @param {string} why
   */
  #refuse(why) {
    for (const { reject } of this.#calls.values()) reject(new Error(why));
    this.#calls.clear();
  }

  /** From now on the viewer is waited for. */
  #wait() {
    let [resolve, end] = [() => {}, (/** @type {Error} */ _error) => {}];
    const promise = new Promise((/** @type {(value: void) => void} */ done, fail) => {
      [resolve, end] = [done, fail];
    });
    promise.catch(() => {}); // whoever waits hears of it; nobody has to wait
    this.#hello = { heard: false, promise, resolve, end };
  }

  /** The frame has loaded something that says nothing: a browser shows no more than an empty frame where the host does not allow it. */
  #explain() {
    const frame = this.#frame;
    setTimeout(() => {
      if (!frame || frame !== this.#frame || this.#heardFrom) return;
      const wanted = (this.getAttribute("lang") ?? document.documentElement.lang).toLowerCase().split("-")[0];
      const lang = wanted in WORDS ? wanted : "en";
      const [text, open] = WORDS[lang];
      const whole = new URL(frame.src);
      whole.searchParams.delete("embed");
      const plate = Object.assign(document.createElement("div"), { lang, dir: lang === "ar" ? "rtl" : "ltr" });
      plate.setAttribute("role", "alert");
      const words = Object.assign(document.createElement("p"), { textContent: text.replace("{host}", whole.host) });
      const link = Object.assign(document.createElement("a"), { href: whole.href, target: "_blank", rel: "noopener", textContent: open });
      const line = document.createElement("p");
      line.append(link);
      plate.append(words, line);
      this.#plate?.remove(); // the frame has loaded twice
      this.#plate = plate;
      this.shadowRoot?.append(plate);
    }, KilwaViewerElement.silence);
  }

  /** Who waits hears after a while; on a slow line the viewer may still come, and is there for the next call. */
  #lose() {
    const hello = this.#hello;
    setTimeout(() => {
      if (!hello || hello !== this.#hello || hello.heard) return;
      this.#wait();
      this.#lose();
      hello.end(
        new Error(
          `the viewer's page at ${this.#origin} does not answer: it is slow, not there, or does not name ${location.origin} in <meta name="kilwa-origins">`,
        ),
      );
    }, KilwaViewerElement.patience);
  }

  #load() {
    this.#drop("another model was chosen");
    if (!this.src) return;
    const page = new URL(this.getAttribute("viewer") ?? "index.html", this.hasAttribute("viewer") ? document.baseURI : HERE);
    page.searchParams.set("embed", this.getAttribute("controls") === "none" ? "bare" : "1");
    page.searchParams.set("pack", new URL(this.src, document.baseURI).href);
    for (const name of ["annotations", "lang"]) {
      const value = this.getAttribute(name);
      if (value) page.searchParams.set(name, name === "lang" ? value : new URL(value, document.baseURI).href);
    }
    page.hash = this.getAttribute("view") ?? "";
    this.#origin = page.origin;
    this.#wait();
    const frame = document.createElement("iframe");
    frame.title = this.getAttribute("aria-label") || this.title || "3D model";
    frame.allow = "fullscreen; clipboard-write; xr-spatial-tracking";
    frame.src = page.href;
    this.#heardFrom = false;
    frame.addEventListener("load", () => {
      this.#lose();
      this.#explain();
    });
    this.#frame = frame;
    this.shadowRoot?.replaceChildren(frame);
  }

  /** @param {object} message */
  #send(message) {
    this.#frame?.contentWindow?.postMessage({ kilwa: 1, ...message }, this.#origin);
  }

  /** @param {MessageEvent} event */
  #take({ data, origin, source }) {
    if (source !== this.#frame?.contentWindow || origin !== this.#origin || data?.kilwa !== 1) return;
    this.#heardFrom = true;
    this.#plate?.remove(); // it was only slow
    this.#plate = null;
    if (data.event === "listening") {
      // Another page than the one that was asked.
      if (this.#hello?.heard) this.#refuse("the viewer was loaded again");
      this.#send({ hello: 1, listen: EVENTS });
      return;
    }
    if (data.event) {
      if (data.event === "hello" && this.#hello) {
        this.#hello.heard = true;
        this.#hello.resolve();
      }
      if (data.event === "hello" && data.detail?.ready) this.dispatchEvent(new CustomEvent("ready"));
      else if (data.event !== "hello") this.dispatchEvent(new CustomEvent(data.event, { detail: data.detail }));
      return;
    }
    const call = this.#calls.get(data.id);
    this.#calls.delete(data.id);
    if (data.error === undefined) call?.resolve(data.result);
    else call?.reject(new Error(data.error));
  }

  /**
   * Call something of the API by its name.
   * @param {string} name
   * @param {...any} args
   */
  async call(name, ...args) {
    const hello = this.#hello;
    await this.loaded;
    if (hello !== this.#hello) throw new Error("another model was chosen");
    return new Promise((resolve, reject) => {
      this.#last += 1;
      const id = this.#last;
      this.#calls.set(id, { resolve, reject });
      this.#send({ id, call: name, args });
    });
  }

  /**
   * As `addEventListener`, with the detail alone; returns what stops it.
   * @param {string} event
   * @param {(detail: any) => void} listener
   */
  on(event, listener) {
    const take = (/** @type {any} */ { detail }) => listener(detail);
    this.addEventListener(event, take);
    return () => this.removeEventListener(event, take);
  }
}

for (const name of CALLS) {
  Object.defineProperty(KilwaViewerElement.prototype, name, {
    configurable: true,
    writable: true,
    /** @this {KilwaViewerElement} @param {...any} args */
    value(...args) {
      return this.call(name, ...args);
    },
  });
}

if (!customElements.get("kilwa-viewer")) customElements.define("kilwa-viewer", KilwaViewerElement);
