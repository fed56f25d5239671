// The tools: how many places each asks for, and what its next step is called. `tool` is its name in files (core/measure, record.rs).

import { count } from "../format.js";
import { t } from "../i18n.js";

const MANY = Infinity;

/** What a pick snaps to, and what that is called. */
export const SNAPS = { none: "snapNone", vertex: "snapVertex", crease: "snapCrease", border: "snapBorder" };

/**
 * `least` and `most` places; `closed`: they enclose something; `plane`: it counts from a plane that can be chosen; `draws`: what comes out are lines; `steps`: strings
 * of its single steps, where they say more than a number.
 */
export const TOOLS = [
  { id: "distance", key: "mDistance", least: 2, most: 2, often: true },
  { id: "polyline", key: "mPolyline", tool: "distance", least: 2, most: MANY },
  { id: "along", key: "mAlong", least: 2, most: 2 },
  { id: "coordinate", key: "mCoordinate", least: 1, most: 1, often: true },
  { id: "height", key: "mHeight", least: 4, most: 4, steps: ["stepPlane", "stepPlane", "stepPlane", "stepAbove"] },
  { id: "perimeter", key: "mPerimeter", least: 3, most: MANY, closed: true },
  { id: "angle", key: "mAngle", least: 3, most: 3, steps: [null, "stepCorner", null] },
  { id: "plane-angle", key: "mPlaneAngle", least: 6, most: 6, steps: ["stepFirst", "stepFirst", "stepFirst", "stepSecond", "stepSecond", "stepSecond"] },
  { id: "circle", key: "mCircle", least: 3, most: MANY },
  { id: "area", key: "mArea", least: 3, most: MANY, closed: true, often: true },
  { id: "area-whole", key: "mAreaWhole", tool: "area", least: 0, most: 0 },
  { id: "volume", key: "mVolume", least: 0, most: 0 },
  { id: "cut-fill", key: "mCutFill", least: 3, most: MANY, closed: true, plane: true },
  { id: "deviation", key: "mDeviation", least: 3, most: MANY, closed: true, plane: true },
  { id: "section-upright", key: "mUpright", tool: "section", least: 2, most: 2, draws: true, often: true },
  { id: "section-level", key: "mLevel", tool: "section", least: 1, most: 1, draws: true },
  { id: "section-points", key: "mThrough", tool: "section", least: 3, most: 3, draws: true },
  { id: "section-clip", key: "mClip", tool: "section", least: 0, most: 0, draws: true },
  { id: "profile", key: "mProfile", least: 2, most: MANY, draws: true },
  { id: "contours", key: "mContours", least: 0, most: 0, draws: true, interval: true },
];

export const GROUPS = [
  ["groupLengths", ["coordinate", "distance", "polyline", "along", "perimeter", "height"]],
  ["groupAngles", ["angle", "plane-angle", "circle"]],
  ["groupSurfaces", ["area", "area-whole", "volume", "cut-fill", "deviation"]],
  ["groupLines", ["section-upright", "section-level", "section-points", "section-clip", "profile", "contours"]],
];

export const toolOf = (id) => TOOLS.find((tool) => tool.id === id);

/** Names in files, and those that a script may use beside the tools' own. */
export const RECORDED = new Set(TOOLS.map((tool) => tool.tool ?? tool.id));

/** The tool that a measurement of a file was made with, as well as the file says. */
export function toolOfRecord({ tool, local = [] }) {
  if (tool === "distance") return toolOf(local.length > 2 ? "polyline" : "distance");
  if (tool === "area") return toolOf(local.length > 0 ? "area" : "area-whole");
  if (tool === "section") return toolOf(["section-clip", "section-level", "section-upright"][local.length] ?? "section-points");
  return toolOf(tool);
}

/** What a measurement of it is called where nobody named it. */
export const kindName = (tool) => t(tool.tool === "section" ? "mSection" : tool.key);

/** The next step, in words. */
export function stepText(tool, given, isTouch) {
  const press = t(isTouch ? "stepTap" : "stepClick");
  const end = t(isTouch ? "stepHold" : "stepEnd");
  const number = count(given + 1);
  if (tool.most === MANY) {
    const more = given >= tool.least ? t(isTouch ? "stepDoneTouch" : "stepDone") : t("stepLeast", { count: tool.least });
    return `${t("stepTool", { tool: t(tool.key), step: t("stepMany", { press, number }) })} · ${more} · ${end}`;
  }
  const special = tool.steps?.[given];
  const where = special ? t(special) : "";
  const step = t("stepOf", { press, number, count: count(tool.most) });
  return `${t("stepTool", { tool: t(tool.key), step })}${where ? ` (${where})` : ""} · ${end}`;
}
