// An archive as an institution has it: models published with their metadata, readers with accounts, the real server.

import assert from "node:assert/strict";
import { execFile, spawn } from "node:child_process";
import { mkdtemp, rm, writeFile } from "node:fs/promises";
import { tmpdir } from "node:os";
import path from "node:path";
import { promisify } from "node:util";
import { KILWA, WWW, packFolder, serve } from "./harness.mjs";

const run = promisify(execFile);

/** The one reader with an account. */
export const AMINA = { name: "amina", password: "a long sentence" };

/**
 * The fort once for each of the metadata files (TOML texts), served until `stop()`. `granted`: slugs that Amina may open; `collections`: the text of
 * collections.toml; `files`: other files beside the objects, by their names; `options`: further arguments of `kilwa serve`, or a function from the archive's own folder to them.
 */
export async function archive(metadata, { granted = [], collections, files = {}, options = () => [] } = {}) {
  const scratch = await mkdtemp(path.join(tmpdir(), "kilwa-archive-"));
  const [accounts, site, file] = ["access.json", "site", "metadata.toml"].map((name) => path.join(scratch, name));
  const folder = await packFolder();
  for (const text of metadata) {
    await writeFile(file, text);
    await run(KILWA, ["publish", path.join(folder, "fort.kilwa"), "--to", site, "--metadata", file, "--www", WWW, "--software"]);
  }
  await rm(folder, { recursive: true });
  if (collections) await writeFile(path.join(site, "collections.toml"), collections);
  for (const [name, content] of Object.entries(files)) await writeFile(path.join(site, name), content);
  const args = options(scratch);
  if (granted.length > 0) {
    await run(KILWA, ["access", "init", accounts]);
    const grants = granted.flatMap((slug) => ["--object", slug]);
    const user = spawn(KILWA, ["access", "user", accounts, AMINA.name, ...grants], { stdio: ["pipe", "ignore", "inherit"] });
    user.stdin.end(`${AMINA.password}\n`);
    assert.equal(await new Promise((resolve) => user.once("exit", resolve)), 0);
    args.push("--access", accounts);
  }
  const server = await serve(site, ...args);
  const stop = async () => {
    await server.stop();
    await rm(scratch, { recursive: true });
  };
  return { url: server.url, stop };
}
