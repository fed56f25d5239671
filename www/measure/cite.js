// One sentence that cites a measurement, in the language of the page: what, how much with its uncertainty, of which model in which version, with what. In
// English it is the sentence of `kilwa measure --cite`; the digits are the same in every language.

import { isolate } from "../format.js";
import { t } from "../i18n.js";
import { kindName } from "./tools.js";
import { readingName, text } from "./values.js";

/**
 * @param {object} engine
 * @param {object} measurement as in files
 * @param {{kind: object, unit: string, lang: string}} how `kind`: its tool
 */
export async function citation(engine, measurement, { kind, unit, lang }) {
  if (lang === "en") return engine.cite(measurement, { unit });
  const { name, readings, uncertainty, date } = measurement;
  const values = readings.map((r) => `${readingName(r.name)} ${isolate(text(r, unit))}`);
  const { title, identity, program } = engine.pack;
  const capture = Number.isFinite(uncertainty.capture) ? t("citeCapture", { value: isolate(`${uncertainty.capture} m`) }) : t("citeCaptureUnknown");
  const given = date ? t("citeDate", { date: isolate(date) }) : "";
  return t("citeSentence", { name, tool: kindName(kind), values: values.join(", "), title, identity: isolate(identity), program: isolate(program), capture, date: given });
}
