// Which of the two programs draws here: the small one with WebGPU, or the large one with WebGL 2 where no WebGPU adapter
// answers. Only one of them is downloaded to its end.

/** Why nothing can be drawn, as the key of a sentence; null where something can. */
/** @type {string | null} */
let reason = null;
/** @type {"webgpu" | "webgl" | null} */
let chosen = null;

export const whyNoGpu = () => reason;
/** "webgpu" or "webgl", once it is known. */
export const backend = () => chosen;

/**
 * @param {URLSearchParams} parameters `gpu=webgl` or `gpu=webgpu` takes that one without asking for the other.
 * @returns {Promise<"webgpu" | "webgl">}
 */
async function choose(parameters) {
  const asked = parameters.get("gpu");
  if (asked !== "webgl" && (await hasWebGpu())) return "webgpu";
  if (asked !== "webgpu" && hasWebGl2()) return "webgl";
  if (navigator.gpu) reason = "noGpuAdapter";
  else reason = isSecureContext ? "noGpuMissing" : "noGpuInsecure";
  return "webgpu"; // The small one reads the pack's facts all the same.
}

async function hasWebGpu() {
  const adapter = await navigator.gpu?.requestAdapter({ powerPreference: "high-performance" }).catch(() => null);
  return Boolean(adapter);
}

/**
 * The address that opens the same page with WebGL 2, where WebGPU promised an adapter and gave no device; else null.
 * @param {string} address
 * @param {URLSearchParams} parameters
 */
export function otherProgram(address, parameters) {
  if (chosen !== "webgpu" || parameters.has("gpu") || !hasWebGl2()) return null;
  const other = new URL(address);
  other.searchParams.set("gpu", "webgl");
  return other.href;
}

function hasWebGl2() {
  const context = document.createElement("canvas").getContext("webgl2");
  // Browsers allow few contexts: this one goes before the viewer's own comes.
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return Boolean(context);
}

/**
 * Ask for a program and its script.
 * @param {"viewer" | "viewer-gl"} name
 */
function begin(name) {
  const abort = new AbortController();
  const wasm = fetch(new URL(`${name}_bg.wasm`, import.meta.url), { signal: abort.signal });
  const address = new URL(`${name}.js`, import.meta.url).href;
  /** @type {Promise<import("./types/page.js").Program>} */
  const script = import(address);
  // One of the two may fail first; whoever awaits it reports that.
  wasm.catch(() => {});
  script.catch(() => {});
  return { wasm, script, abort };
}

/**
 * The program, ready to be called.
 * @param {URLSearchParams} parameters
 * @returns {Promise<import("./types/page.js").Program>}
 */
export async function load(parameters) {
  // An adapter takes its time to answer. Nearly always it does, so that the small program is on its way meanwhile; where it does not, its
  // transfer ends.
  const likely = navigator.gpu && parameters.get("gpu") !== "webgl" ? begin("viewer") : null;
  chosen = await choose(parameters);
  if (chosen === "webgl") likely?.abort.abort();
  const { wasm, script } = chosen === "webgl" ? begin("viewer-gl") : (likely ?? begin("viewer"));
  const module = await script;
  await module.default({ module_or_path: wasm });
  return module;
}
