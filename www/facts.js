// Lists of facts: what a pack states about itself.

import { html, nothing } from "lit-html";
import { bound, bytes, coordinate, count, extent, length } from "./format.js";
import { t } from "./i18n.js";
import { rowsOf, show } from "./view.js";

/** @import { PackInfo } from "./types/page.js" */

/**
 * Put `[name, value]` rows into a list.
 * @param {HTMLElement} list
 * @param {string[][]} rows
 */
export const fill = (list, rows) => show(rowsOf(rows), list);

/** @param {string[][]} rows */
const listOf = (rows) => html`<dl class="facts">${rowsOf(rows)}</dl>`;

/**
 * @param {string} title
 * @param {string[][]} rows
 */
const section = (title, rows) => (rows.length > 0 ? html`<h3>${title}</h3>${listOf(rows)}` : nothing);

/**
 * The facts of a pack (`packInfo` of the viewer).
 * @param {HTMLElement} into
 * @param {PackInfo} info
 */
export function showFacts(into, { metadata: m, pack }) {
  const size = m.bounds_max.map((v, i) => v - m.bounds_min[i]);
  // The metadata published with a model may know more than the pack does.
  const published = Number(document.body.dataset.accuracy) || undefined;
  const accuracy = m.capture_accuracy ?? published;
  const licence = /** @type {HTMLLinkElement | null} */ (document.querySelector("link[rel=license]"))?.title;
  const rows = [
    ...(pack.points ? [] : [[t("triangles"), count(pack.triangles)]]),
    [t("vertices"), count(m.vertices)],
    [t("extent"), extent(size)],
    [t("spacing"), length(m.median_edge)],
    [t("grid"), length(m.lattice_step)],
    [t("crs"), m.crs ?? t("crsLocal")],
    [t("accuracy"), accuracy === undefined ? t("accuracyUnknown") : bound(accuracy)],
    [t("licence"), licence || t("licenceUnknown")],
    [t("file"), bytes(pack.bytes)],
    [t("tool"), m.tool],
  ];
  const sources = m.sources.map((s) => [s.name, bytes(s.bytes)]);
  const repairs = Object.entries(m.repairs).map(([what, n]) => [what.replaceAll("_", " "), count(n)]);
  show([listOf(rows), section(t("sources"), sources), section(t("repairs"), repairs)], into);
}

/**
 * x, y, z of a place.
 * @param {Iterable<number>} place
 */
export const place = ([x, y, z]) => `x ${coordinate(x)}  y ${coordinate(y)}  z ${coordinate(z)} m`;

/** What the publisher states for a credit: who made the model, and its licence; empty where that is not known. */
export function credit() {
  const { creators = "", rights = "", rightsUri = "" } = document.body.dataset;
  return { creators, rights, rightsUri };
}
