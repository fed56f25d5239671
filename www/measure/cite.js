// One sentence that cites a measurement, in the language of the page: what, how much with its uncertainty, of which model in which version, with which tool. In
// English it is the sentence of `kilwa measure --cite`; the digits are the same in every language.

import { day, isolate } from "../format.js";
import { t } from "../i18n.js";
import { kindName } from "./tools.js";
import { readingName, text } from "./values.js";

/** @import { MeasureRecord, MeasureTool, Reading, Uncertainty } from "../types/page.js" */
/** @import { Engine } from "./engine.js" */

/**
 * @param {Engine} engine
 * @param {MeasureRecord & {readings: Reading[], uncertainty: Uncertainty, name: string}} measurement as in files
 * @param {{kind: MeasureTool, unit: string, lang: string, published: string}} how `kind`: its tool; `published`: the title that the model was
 * published under, which is what others find; without it, the pack's own
 */
export async function citation(engine, measurement, { kind, unit, lang, published }) {
  if (lang === "en") {
    const sentence = await engine.cite(measurement, { unit });
    return published ? sentence.replace(`“${engine.pack.title}”`, () => `“${published}”`) : sentence;
  }
  const { name, readings, uncertainty, date } = measurement;
  const values = readings.map((r) => `${readingName(r.name)} ${isolate(text(r, unit))}`);
  const { identity, program } = engine.pack;
  const title = published || engine.pack.title;
  const capture = Number.isFinite(uncertainty.capture) ? t("citeCapture", { value: isolate(`${uncertainty.capture} m`) }) : t("citeCaptureUnknown");
  const given = date ? t("citeDate", { date: isolate(day(date)) }) : "";
  return t("citeSentence", {
    name,
    tool: kindName(kind),
    values: values.join(", "),
    title,
    identity: isolate(identity),
    program: isolate(program),
    capture,
    date: given,
  });
}
