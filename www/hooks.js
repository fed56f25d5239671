// `globalThis.kilwa`: the same objects for scripts and tests as for the page. `kilwa.api` is what docs/embedding.md promises; the rest is for tests, and may
// change.

/** @import { Current } from "./current.js" */

/**
 * @param {Current} current
 * @param {object} parts what stays as long as the page
 */
export function expose(current, parts) {
  const kilwa = {
    get pack() {
      return current.pack;
    },
    get module() {
      return current.model?.module;
    },
    get info() {
      return current.model?.info;
    },
    get saved() {
      return current.saved;
    },
    get notes() {
      return current.notes;
    },
    get viewer() {
      return current.scene?.viewer;
    },
    get session() {
      return current.scene?.session;
    },
    get input() {
      return current.scene?.input;
    },
    get walk() {
      return current.scene?.walk;
    },
  };
  Object.assign(globalThis, { kilwa: Object.assign(kilwa, parts) });
}
