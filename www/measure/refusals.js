// Why there is no value, in the language of the page. The engine says it in English (core/measure, refusal.rs); a sentence that is not known here is
// shown as it came.

import { count } from "../format.js";
import { t } from "../i18n.js";

const KNOWN = [
  [/needs at least (\d+) points; (\d+) are given/, "refuseFew", ["needed", "given"]],
  [/points lie on one line, which does not fix/, "refuseCollinear", []],
  [/two of the points are the same place/, "refuseSame", []],
  [/sides of the polygon cross/, "refuseCross", []],
  [/surface is not closed \((\d+) border edges\)/, "refuseOpen", ["borders"]],
  [/triangles of the surface do not agree/, "refuseInside", []],
  [/meets? no surface/, "refuseMisses", []],
  [/the surface has a gap along the plane/, "refuseGap", []],
];

export function refusalText(sentence) {
  for (const [pattern, key, names] of KNOWN) {
    const found = pattern.exec(sentence);
    if (found) return t(key, Object.fromEntries(names.map((name, k) => [name, count(Number(found[k + 1]))])));
  }
  return sentence;
}
