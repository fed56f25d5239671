// A pack of more than 4 GiB: the fort with all but its head moved on by 4 GiB, in a sparse file.

import assert from "node:assert/strict";
import { execFile } from "node:child_process";
import { stat } from "node:fs/promises";
import path from "node:path";
import { promisify } from "node:util";
import { FAR, fortSite, open, picture, stats, test } from "./harness.mjs";

/** No more than is needed: the server reads all of the file once, for its tag. */
const GAP = 2 ** 32;
/** Size of the page in pixels: small, because the processor draws them; chunks of every level are requested all the same. */
const SMALL = [480, 360];

const site = fortSite({
  prepare: async (folder) => {
    const [near, far] = ["fort", "far"].map((name) => path.join(folder, `${name}.kilwa`));
    await promisify(execFile)(FAR, [near, far, String(GAP)]);
    const { size, blocks } = await stat(far);
    assert.ok(size > GAP && blocks * 512 < 2 ** 26, "the file system keeps holes: else this would fill the disk");
  },
});

test("chunks beyond 2^32 bytes are streamed, and the picture is that of the small file", async () => {
  const near = await open(site.browser, `${site.server.url}/m/fort?error=2`, { size: SMALL });
  const wanted = { picture: await picture(near.page), stats: await stats(near.page) };
  await near.close();
  const far = await open(site.browser, `${site.server.url}/m/far?error=2`, { size: SMALL });
  assert.deepEqual(await picture(far.page), wanted.picture);
  assert.equal((await stats(far.page)).trianglesDrawn, wanted.stats.trianglesDrawn);
  const beyond = far.packs.filter((range) => Number(/^(?:bytes=)?(\d+)/.exec(range)?.[1]) > 2 ** 32);
  assert.ok(beyond.length > 0, `asked for ${far.packs}`);
  assert.deepEqual(far.complaints, []);
  await far.close();
});
