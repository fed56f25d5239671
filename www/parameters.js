// The parameters of the address behind its `?`. Benchmarks use short names that other viewers of this kind have, too.
//
//   model=ADDRESS  the same as pack=
//   err=PIXELS     the same as error=
//   cam=NUMBERS    the camera, as in `#view=` (link.js), where the address has none behind its `#`

const SAME = { model: "pack", err: "error" };

/** @returns {URLSearchParams} under the names that the page knows; a camera is moved behind the `#`. */
export function read() {
  const parameters = new URLSearchParams(location.search);
  for (const [short, name] of Object.entries(SAME)) {
    const value = parameters.get(short);
    if (value !== null && !parameters.has(name)) parameters.set(name, value);
  }
  const camera = parameters.get("cam");
  if (camera && !location.hash.includes("view=")) {
    const rest = location.hash.length > 1 ? `&${location.hash.slice(1)}` : "";
    history.replaceState(null, "", `${location.pathname}${location.search}#view=${camera}${rest}`);
  }
  return parameters;
}
