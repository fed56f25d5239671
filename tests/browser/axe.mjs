// axe-core on pages of the server.

import { readFile } from "node:fs/promises";
import { createRequire } from "node:module";
import path from "node:path";

/**
 * What axe-core finds serious on `pages`, in both themes and in Arabic, and what the browser complains about there. `look` opens an address with options of
 * a browser context; complaints for which `isExpected` holds are left out.
 */
export async function serious(look, pages, isExpected = () => false) {
  const axe = await readFile(path.join(path.dirname(createRequire(import.meta.url).resolve("axe-core")), "axe.min.js"), "utf8");
  const found = [];
  for (const [colorScheme, locale] of [
    ["light", "en"],
    ["dark", "en"],
    ["light", "ar"],
  ]) {
    for (const address of pages) {
      const { page, complaints, close } = await look(address, { colorScheme, locale });
      await page.evaluate(axe);
      const { violations } = await page.evaluate(() => globalThis.axe.run());
      const bad = violations.filter((v) => ["serious", "critical"].includes(v.impact));
      found.push(...bad.map((v) => `${address} ${colorScheme} ${locale}: ${v.id}: ${v.nodes.map((n) => n.failureSummary).join("; ")}`));
      found.push(...complaints.filter((text) => !isExpected(text)).map((text) => `${address}: ${text}`));
      await close();
    }
  }
  return found;
}
