// Lists of facts: what a pack says of itself.

import { bound, bytes, coordinate, count, extent, length } from "./format.js";
import { t } from "./i18n.js";

/** Put `[name, value]` rows into a list, keeping the elements that are there. */
export function fill(list, rows) {
  while (list.children.length > rows.length) list.lastChild.remove();
  while (list.children.length < rows.length) {
    const row = document.createElement("div");
    row.append(document.createElement("dt"), document.createElement("dd"));
    list.append(row);
  }
  rows.forEach(([name, value], at) => {
    const [dt, dd] = list.children[at].children;
    if (dt.textContent !== name) dt.textContent = name;
    if (dd.textContent !== value) dd.textContent = value;
  });
}

function list(rows) {
  const dl = document.createElement("dl");
  dl.className = "facts";
  fill(dl, rows);
  return dl;
}

/** The facts of a pack (`packInfo` of the viewer). */
export function factsList({ metadata: m, pack }) {
  const size = m.bounds_max.map((v, i) => v - m.bounds_min[i]);
  // What was published with a model may know more than the pack does.
  const published = Number(document.body.dataset.accuracy) || undefined;
  const accuracy = m.capture_accuracy ?? published;
  const rows = [
    [t("triangles"), count(pack.triangles)],
    [t("vertices"), count(m.vertices)],
    [t("extent"), extent(size)],
    [t("spacing"), length(m.median_edge)],
    [t("grid"), length(m.lattice_step)],
    [t("crs"), m.crs ?? t("crsLocal")],
    [t("accuracy"), accuracy === undefined ? t("accuracyUnknown") : bound(accuracy)],
    [t("licence"), document.querySelector("link[rel=license]")?.title || t("licenceUnknown")],
    [t("file"), bytes(pack.bytes)],
    [t("tool"), m.tool],
  ];
  const out = document.createDocumentFragment();
  out.append(list(rows));
  section(
    out,
    t("sources"),
    m.sources.map((s) => [s.name, bytes(s.bytes)]),
  );
  section(
    out,
    t("repairs"),
    Object.entries(m.repairs).map(([what, n]) => [what.replaceAll("_", " "), count(n)]),
  );
  return out;
}

function section(into, title, rows) {
  if (rows.length === 0) return;
  const h = document.createElement("h3");
  h.textContent = title;
  into.append(h, list(rows));
}

/** x, y, z of a place. */
export const place = ([x, y, z]) => `x ${coordinate(x)}  y ${coordinate(y)}  z ${coordinate(z)} m`;
