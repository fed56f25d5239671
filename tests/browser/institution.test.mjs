// The portal of an institution (site.toml): its front page and every other page, in both themes, on a phone, in Arabic, and for readers with accounts.

import assert from "node:assert/strict";
import path from "node:path";
import { after, before } from "node:test";
import { AMINA, archive } from "./archive.mjs";
import { seriousOn } from "./axe.mjs";
import { launch, open, test } from "./harness.mjs";

const OBJECTS = [
  ["gereza", "Gereza fort", ""],
  ["husuni", "Husuni Kubwa", ""],
  ["cave", "Painted cave", '[access]\nstate = "restricted"\nreason = "Graves."\n'],
];
// The accent is too bright for the light theme.
const SITE = `name = "National Museum of Kilwa"
logo = "logo.svg"
accent = "#2fa37c"
featured = ["husuni", "gereza", "cave"]
imprint = "https://museum.example/legal-notice"
contact = """The museum
Kilwa Masoko, Tanzania"""

[introduction]
en = """The museum has documented the stone towns of the coast since 2009.

Everything here can be measured."""
ar = "يوثق المتحف مدن الساحل الحجرية منذ سنة 2009."
`;
const LOGO = `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 64 64"><script>globalThis.hasRun = true; document.documentElement.setAttribute("data-ran", "")</script><path d="M8 56V24l24-16 24 16v32H40V36H24v20z" fill="#2fa37c"/></svg>`;
const PAGES = ["/", "/?q=fort", "/map", "/collections/", "/sign-in", "/gereza/extract"];
let server;
let browser;

before(async () => {
  const texts = OBJECTS.map(
    ([slug, title, more]) =>
      `title = "${title}"\nslug = "${slug}"\ndescription = "A building of coral ragstone at the harbour of Kilwa Kisiwani."\n[rights]\nuri = "CC BY 4.0"\n[model]\nunits = "m"\n${more}`,
  );
  const options = (own) => ["--cache", path.join(own, "cache")];
  server = await archive(texts, { granted: ["cave"], files: { "site.toml": SITE, "logo.svg": LOGO }, options });
  browser = await launch();
});
after(async () => {
  await browser?.close();
  await server?.stop();
});

const look = (address, options = {}) => open(browser, `${server.url}${address}`, { size: [1200, 800], wait: null, ...options });

test("axe-core finds nothing serious on the institution's pages, in both themes and in Arabic", async () => {
  assert.deepEqual(await seriousOn(look, PAGES), []);
});

test("the front page shows name, logo, introduction and featured models before the list, and a reader searches and returns", async () => {
  const { page, close } = await look("/", { javaScriptEnabled: false });
  assert.equal(await page.getByRole("heading", { level: 1 }).innerText(), "National Museum of Kilwa");
  assert.equal(await page.title(), "Models - National Museum of Kilwa");
  const featured = page.getByRole("region", { name: "Featured models" });
  assert.deepEqual(await featured.getByRole("heading", { level: 3 }).allInnerTexts(), ["Husuni Kubwa", "Gereza fort"], "nothing that is not public");
  const tops = await Promise.all(
    [page.locator(".hero img"), page.getByText("since 2009"), featured, page.getByRole("search")].map(async (one) => (await one.boundingBox()).y),
  );
  assert.deepEqual(
    tops.toSorted((a, b) => a - b),
    tops,
  );
  await page.getByRole("searchbox").fill("gereza");
  await page.getByRole("button", { name: "Search" }).click();
  assert.equal(await featured.count(), 0);
  await page.getByRole("banner").getByRole("link", { name: "National Museum of Kilwa" }).click();
  assert.equal(new URL(page.url()).pathname + new URL(page.url()).search, "/");
  await featured.getByRole("link", { name: "Husuni Kubwa" }).click();
  assert.equal(new URL(page.url()).pathname, "/husuni/");
  await close();
});

test("on the narrowest phone nothing is wider than the screen, and links and buttons are large enough for a finger", async () => {
  for (const [address, locale] of PAGES.flatMap((address) => [
    [address, "en"],
    [address, "ar"],
  ])) {
    const { page, close } = await look(address, { size: [360, 740], hasTouch: true, isMobile: true, locale });
    assert.equal(await page.evaluate(() => document.documentElement.scrollWidth), 360, address);
    const frame = page.getByRole("banner").or(page.getByRole("contentinfo"));
    const small = await frame
      .getByRole("link")
      .or(frame.getByRole("button"))
      .evaluateAll((all) => all.filter((e) => e.getBoundingClientRect().height < 43.5).map((e) => e.textContent.trim()));
    assert.deepEqual(small, [], `${address} ${locale}`);
    await close();
  }
});

test("a reader signs in and out in the header, and stays where they were", async () => {
  const { page, close } = await look("/map?q=gereza", { javaScriptEnabled: false });
  const banner = page.getByRole("banner");
  await banner.getByRole("link", { name: "Sign in" }).click();
  assert.equal(await banner.getByRole("link", { name: "National Museum of Kilwa" }).count(), 1);
  await page.getByLabel("User name").fill(AMINA.name);
  await page.getByLabel("Password").fill(AMINA.password);
  await Promise.all([page.waitForURL(/\/map\?q=gereza/), page.getByRole("main").getByRole("button", { name: "Sign in" }).click()]);
  await banner.getByText("You are signed in as amina.").waitFor({ state: "attached" });
  await banner.getByRole("button", { name: "Sign out" }).click();
  await banner.getByRole("link", { name: "Sign in" }).waitFor();
  assert.match(page.url(), /\/map\?q=gereza/);
  await close();
});

test("a script in the logo does not run, in a page or at the logo's own address", async () => {
  const front = await look("/");
  assert.equal(await front.page.locator(".hero img").evaluate((img) => img.complete && img.naturalWidth > 0), true);
  assert.equal(await front.page.evaluate(() => "hasRun" in globalThis), false);
  await front.close();
  const logo = await look("/logo.svg");
  await logo.page.locator("path").waitFor({ state: "attached" });
  assert.equal(await logo.page.evaluate(() => document.documentElement.hasAttribute("data-ran")), false);
  await logo.close();
});
