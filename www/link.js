// The view in the address: after `#view=`, the seven numbers of the camera.

let timer;

/** The camera of an address, or null. */
export function readView(hash) {
  const match = /(?:^#|&)view=([-\d.e,]+)/.exec(hash);
  const numbers = match?.[1].split(",").map(Number);
  return numbers?.length === 7 && numbers.every(Number.isFinite) ? new Float64Array(numbers) : null;
}

/** Keep the address at the view, once the camera rests (browsers allow few changes a second), or at once. */
export function writeView(viewer, now = false) {
  clearTimeout(timer);
  const camera = viewer.camera();
  const write = () => {
    const short = [...camera].map((v) => Number(v.toPrecision(9)));
    history.replaceState(null, "", `${location.pathname}${location.search}#view=${short.join(",")}`);
  };
  if (now) write();
  else timer = setTimeout(write, 400);
}
