// Elements of index.html by their ids.

/** @import { Ids } from "./types/ids.js" */

/**
 * The element with this id. The ids and their elements are known to the type checker (xtask/npm/ids.mjs).
 * @template {keyof Ids} K
 * @param {K} id
 * @returns {Ids[K]}
 */
export const $ = (id) => /** @type {any} */ (document.getElementById(id));

/**
 * The page's first element for a selector that always finds one.
 * @param {string} selector
 * @returns {HTMLInputElement}
 */
export const input = (selector) => /** @type {HTMLInputElement} */ (document.querySelector(selector));
