// The tools: how many places each asks for, and what its next step is called. `tool` is its name in files (core/measure, saved.rs).

import { count } from "../format.js";
import { t } from "../i18n.js";

/** @import { MeasureRecord, MeasureTool } from "../types/page.js" */

const MANY = Infinity;

/** What a pick snaps to, and what that is called. @type {Record<string, string>} */
export const SNAPS = { none: "snapNone", vertex: "snapVertex", crease: "snapCrease", border: "snapBorder" };

/**
 * The tools, in the order of the help. `often`: beside the others.
 * @type {MeasureTool[]}
 */
export const TOOLS = [
  { id: "distance", key: "mDistance", min: 2, max: 2, often: true },
  { id: "polyline", key: "mPolyline", tool: "distance", min: 2, max: MANY },
  { id: "along", key: "mAlong", min: 2, max: 2 },
  { id: "coordinate", key: "mCoordinate", min: 1, max: 1, often: true },
  { id: "height", key: "mHeight", min: 4, max: 4, steps: ["stepPlane", "stepPlane", "stepPlane", "stepAbove"] },
  { id: "perimeter", key: "mPerimeter", min: 3, max: MANY, closed: true },
  { id: "angle", key: "mAngle", min: 3, max: 3, steps: [null, "stepCorner", null] },
  { id: "plane-angle", key: "mPlaneAngle", min: 6, max: 6, steps: ["stepFirst", "stepFirst", "stepFirst", "stepSecond", "stepSecond", "stepSecond"] },
  { id: "circle", key: "mCircle", min: 3, max: MANY },
  { id: "area", key: "mArea", min: 3, max: MANY, closed: true, often: true },
  { id: "area-whole", key: "mAreaWhole", tool: "area", min: 0, max: 0 },
  { id: "volume", key: "mVolume", min: 0, max: 0 },
  { id: "cut-fill", key: "mCutFill", min: 3, max: MANY, closed: true, plane: true },
  { id: "deviation", key: "mDeviation", min: 3, max: MANY, closed: true, plane: true },
  { id: "section-upright", key: "mUpright", tool: "section", min: 2, max: 2, draws: true, often: true },
  { id: "section-level", key: "mLevel", tool: "section", min: 1, max: 1, draws: true },
  { id: "section-points", key: "mThrough", tool: "section", min: 3, max: 3, draws: true },
  { id: "section-clip", key: "mClip", tool: "section", min: 0, max: 0, draws: true },
  { id: "profile", key: "mProfile", min: 2, max: MANY, draws: true },
  { id: "contours", key: "mContours", min: 0, max: 0, draws: true, interval: true },
];

/** @type {[key: string, ids: string[]][]} */
export const GROUPS = [
  ["groupLengths", ["coordinate", "distance", "polyline", "along", "perimeter", "height"]],
  ["groupAngles", ["angle", "plane-angle", "circle"]],
  ["groupSurfaces", ["area", "area-whole", "volume", "cut-fill", "deviation"]],
  ["groupLines", ["section-upright", "section-level", "section-points", "section-clip", "profile", "contours"]],
];

/** @param {string | undefined} id */
export const toolOf = (id) => TOOLS.find((tool) => tool.id === id);

/** Names in files, and those that a script may use beside the tools' own. */
export const RECORDED = new Set(TOOLS.map((tool) => tool.tool ?? tool.id));

/**
 * The tool that a measurement of a file was made with, as far as the file states it.
 * @param {MeasureRecord} record
 */
export function toolOfRecord({ tool, local = [] }) {
  if (tool === "distance") return toolOf(local.length > 2 ? "polyline" : "distance");
  if (tool === "area") return toolOf(local.length > 0 ? "area" : "area-whole");
  if (tool === "section") return toolOf(["section-clip", "section-level", "section-upright"][local.length] ?? "section-points");
  return toolOf(tool);
}

/**
 * What a measurement of it is called where nobody named it.
 * @param {MeasureTool} tool
 */
export const kindName = (tool) => t(tool.tool === "section" ? "mSection" : tool.key);

/**
 * The next step, in words.
 * @param {MeasureTool} tool
 * @param {number} given places so far
 * @param {boolean} isTouch
 */
export function stepText(tool, given, isTouch) {
  const press = t(isTouch ? "stepTap" : "stepClick");
  const end = t(isTouch ? "stepHold" : "stepEnd");
  const number = count(given + 1);
  if (tool.max === MANY) {
    const more = given >= tool.min ? t(isTouch ? "stepDoneTouch" : "stepDone") : t("stepLeast", { count: tool.min });
    return `${t("stepTool", { tool: t(tool.key), step: t("stepMany", { press, number }) })} · ${more} · ${end}`;
  }
  const special = tool.steps?.[given];
  const where = special ? t(special) : "";
  const step = t("stepOf", { press, number, count: count(tool.max) });
  return `${t("stepTool", { tool: t(tool.key), step })}${where ? ` (${where})` : ""} · ${end}`;
}
