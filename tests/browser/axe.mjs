// axe-core on pages, in both themes.

import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import path from "node:path";

/** Rules about colours. All others find the same in both themes. */
const COLOUR_RULES = ["color-contrast", "link-in-text-block"];

/**
 * What axe-core finds serious on a page in its present state: with all rules in the light theme, and with those about colours in the dark one. `include` limits it to
 * parts of the page.
 */
export async function serious(page, where, include = null) {
  if (!(await page.evaluate(() => "axe" in globalThis))) {
    await page.evaluate(await readFile(path.join(path.dirname(createRequire(import.meta.url).resolve("axe-core")), "axe.min.js"), "utf8"));
  }
  const found = [];
  for (const [colorScheme, rules] of [
    ["light", {}],
    ["dark", { runOnly: { type: "rule", values: COLOUR_RULES } }],
  ]) {
    await page.emulateMedia({ colorScheme });
    await page.waitForFunction((scheme) => matchMedia(`(prefers-color-scheme: ${scheme})`).matches, colorScheme);
    // While colours fade, their contrast is neither that of one theme nor that of the other.
    await page.evaluate(() => {
      const ends = (animation) => Number.isFinite(animation.effect?.getComputedTiming().endTime);
      return Promise.allSettled(
        document
          .getAnimations()
          .filter(ends)
          .map((animation) => animation.finished),
      ).then(() => {});
    });
    const { violations } = await page.evaluate(
      ([include, options]) => globalThis.axe.run(include ? { include } : document, options),
      [include, { resultTypes: ["violations"], ...rules }],
    );
    const bad = violations.filter((v) => ["serious", "critical"].includes(v.impact));
    found.push(...bad.map((v) => `${where} ${colorScheme}: ${v.id}: ${v.nodes.map((n) => `${n.target} ${n.failureSummary}`).join("; ")}`));
  }
  return found;
}

/**
 * What axe-core finds serious on `pages`, in English and Arabic and in both themes, and what the browser complains about there. `look` opens an address with
 * options of a browser context; complaints for which `isExpected` holds are left out.
 */
export async function seriousOn(look, pages, isExpected = () => false) {
  const found = [];
  for (const locale of ["en", "ar"]) {
    for (const address of pages) {
      const { page, complaints, close } = await look(address, { locale });
      found.push(...(await serious(page, `${address} ${locale}`)));
      found.push(...complaints.filter((text) => !isExpected(text)).map((text) => `${address}: ${text}`));
      await close();
    }
  }
  return found;
}
