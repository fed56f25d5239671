// The first bytes of a pack, which everything waits for: asked for until they come.

import { isPassing } from "./answer.js";

/** @import { PackSource, Program } from "./types/page.js" */

/**
 * @param {PackSource} pack
 * @param {Promise<Uint8Array<ArrayBuffer>>} first the request that is under way
 * @param {(seconds: number) => void} onWait called every second with how many are left until they are asked for again
 * @returns {Promise<Uint8Array<ArrayBuffer>>} rejects with what trying again does not mend
 */
export async function firstBytes(pack, first, onWait) {
  for (let attempt = 0, pending = first; ; attempt += 1) {
    try {
      return await pending;
    } catch (error) {
      if (!isPassing(error)) throw error;
      await wait(Math.min(30, 2 ** (attempt + 1)), onWait);
      pending = pack.head();
    }
  }
}

/**
 * Count the seconds down; being online again ends the wait.
 * @param {number} seconds
 * @param {(seconds: number) => void} onWait
 */
async function wait(seconds, onWait) {
  for (let left = seconds; left > 0; left -= 1) {
    onWait(left);
    let online = () => {};
    const again = new Promise((resolve) => {
      online = () => resolve(true);
      addEventListener("online", online, { once: true });
      setTimeout(resolve, 1000, false);
    });
    const isBack = await again;
    removeEventListener("online", online);
    if (isBack) return;
  }
}

/**
 * A head longer than the first request asked for, where the metadata is large.
 * @param {PackSource} pack
 * @param {Program} module
 * @param {Uint8Array<ArrayBuffer>} bytes
 * @returns {Promise<Uint8Array<ArrayBuffer>>}
 */
export async function wholeHead(pack, module, bytes) {
  const needed = module.headNeeds(bytes);
  if (needed === 0) return bytes;
  if (needed > Number(pack.bytes)) throw Object.assign(new Error(`${needed} > ${pack.bytes}`), { kind: "damaged" });
  return pack.head(needed);
}
