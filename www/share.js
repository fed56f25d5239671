// The dialog Share: the link to what is seen, the code that shows the model in another page, and the link as a QR code. Loaded when it is first opened.

import { html, nothing, svg } from "lit-html";
import { encode } from "uqr";
import { input } from "./dom.js";
import { credit } from "./facts.js";
import { t } from "./i18n.js";
import { download, fileName } from "./store.js";
import { icon, show } from "./view.js";

/**
 * What is shared.
 * @typedef {object} Shared
 * @property {string} title
 * @property {string} link the address of what is seen
 * @property {boolean} isLocal the pack is a file of this computer
 * @property {boolean} isLong the measurements did not fit into the link
 * @property {() => void} save offers the measurements as a file
 */

/** Modules of light around a QR code, which readers need (ISO/IEC 18004). */
const QUIET = 4;

/** @type {Record<string, string>} */
const ENTITIES = { "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" };
/** @param {string} text */
const escaped = (text) => text.replace(/[&<>"]/g, (sign) => ENTITIES[sign]);

/**
 * The HTML that shows the model in another page, with its title and credit in the frame and below it.
 * @param {string} title
 * @param {string} link
 */
export function embedCode(title, link) {
  const frame = new URL(link);
  frame.searchParams.set("embed", "1");
  const { creators, rights, rightsUri } = credit();
  const licence = rightsUri ? `<a rel="license" href="${escaped(rightsUri)}">${escaped(rights)}</a>` : escaped(rights);
  // A pack that nobody named has no title, and a link needs a name.
  const name = escaped(title || frame.host);
  const caption = [`<a href="${escaped(link)}">${name}</a>`, escaped(creators), licence].filter(Boolean).join(", ");
  return `<figure style="margin:0"><iframe src="${escaped(frame.href)}" title="${name}" style="width:100%;aspect-ratio:16/10;border:0" allow="fullscreen; xr-spatial-tracking" loading="lazy"></iframe><figcaption>${caption}</figcaption></figure>`;
}

/**
 * A QR code as the path of its dark modules, and its side in modules; null where the text is too long for one.
 * @param {string} text
 */
export function qrPath(text) {
  try {
    const { data, size } = encode(text, { ecc: "L", border: QUIET });
    const path = data.flatMap((row, y) => row.flatMap((isDark, x) => (isDark ? `M${x} ${y}h1v1h-1z` : []))).join("");
    return { path, size };
  } catch {
    return null;
  }
}

export class ShareDialog {
  constructor() {
    this.dialog = Object.assign(document.createElement("dialog"), { id: "share-dialog" });
    this.dialog.setAttribute("aria-labelledby", "share-title");
    document.body.append(this.dialog);
    /** What was copied last. @type {string | null} */
    this.copied = null;
    this.failed = false;
  }

  /** @param {Shared} shared */
  open(shared) {
    this.shared = shared;
    this.copied = null;
    this.failed = false;
    this.#show();
    this.dialog.showModal();
  }

  /**
   * Copy a field, whose text stays selected where the browser does not let the page copy.
   * @param {"link" | "code"} which
   */
  async #copy(which) {
    const field = input(`[data-share=${which}]`);
    field.select();
    try {
      await navigator.clipboard.writeText(field.value);
      [this.copied, this.failed] = [which, false];
    } catch {
      [this.copied, this.failed] = [null, true];
    }
    this.#show();
  }

  #show() {
    if (this.shared) show(this.#content(this.shared), this.dialog);
  }

  /** @param {Shared} shared */
  #content(shared) {
    const { isLocal } = shared;
    return html`<form method="dialog"><button class="button icon" data-label="close" aria-label=${t("close")}>${icon("close")}</button></form>
<h2 id="share-title">${t("share")}</h2>
${isLocal ? html`<p>${t("shareLocal")}</p>` : this.#ways(shared)}`;
  }

  /** @param {Shared} shared */
  #ways({ title, link, isLong, save }) {
    const copy = (/** @type {"link" | "code"} */ which) =>
      html`<button type="button" class="button outlined" aria-label="${t("copy")}: ${t(which === "link" ? "shareLink" : "shareCode")}" @click=${() => this.#copy(which)}>${icon(this.copied === which ? "check" : "copy", this.copied === which ? "sprite" : "measure")}<span>${t("copy")}</span></button>`;
    const message = this.failed ? t("measureCopyFailed") : this.copied ? t("copied") : "";
    return html`<div class="editor">
<label><span>${t("shareLink")}</span><input readonly dir="ltr" data-share="link" .value=${link}></label>
<p class="actions">${copy("link")}</p>
${isLong ? html`<p class="quiet">${t("measureLinkLong")} <button type="button" class="button outlined" @click=${save}>${t("exportFile")}</button></p>` : nothing}
<label><span>${t("shareCode")}</span><textarea readonly rows="4" dir="ltr" data-share="code" .value=${embedCode(title, link)}></textarea></label>
<p class="quiet">${t("shareCodeHelp")}</p>
<p class="actions">${copy("code")}</p>
${this.#qr(title, link)}
<p role="status" class="quiet">${message}</p>
</div>`;
  }

  /**
   * @param {string} title
   * @param {string} link
   */
  #qr(title, link) {
    const code = qrPath(link);
    if (!code) return html`<p class="quiet">${t("shareQrLong")}</p>`;
    const { path, size } = code;
    const save = () => {
      const drawn = `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${size} ${size}"><path fill="#fff" d="M0 0h${size}v${size}H0z"/><path d="${path}"/></svg>`;
      download(fileName(title, ".qr.svg"), new Blob([drawn], { type: "image/svg+xml" }));
    };
    return html`<div class="qr"><svg role="img" aria-label=${t("shareQr")} viewBox="0 0 ${size} ${size}" shape-rendering="crispEdges">${svg`<path class="light" d="M0 0h${size}v${size}H0z"/><path class="dark" d=${path} />`}</svg><div><p>${t("shareQr")}</p><p class="actions"><button type="button" class="button outlined" @click=${save}>${icon("download")}<span>${t("shareQrSave")}</span></button></p></div></div>`;
  }
}
