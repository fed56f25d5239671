// Style sheets of parts of the page that are loaded when they are first used.

/**
 * Resolves when the sheet applies, or cannot be had.
 * @param {string} name of its file
 * @returns {Promise<void>}
 */
export function partStyles(name) {
  if (document.querySelector(`link[href$="${name}"]`)) return Promise.resolve();
  const link = Object.assign(document.createElement("link"), { rel: "stylesheet", href: name });
  return new Promise((resolve) => {
    link.onload = link.onerror = () => resolve();
    document.head.append(link);
  });
}
