// The first thing that runs: starts what decodes, asks for the program, for the head of the pack and for the messages at the same time, then
// starts the page. Nothing here waits for the graphics adapter, which can take longer than all of them.
import { DecodePool } from "./decode-pool.js";
import { ask, preferred } from "./language.js";
import { Pack } from "./loader.js";
import { read } from "./parameters.js";
import { load, otherProgram, whyNoGpu } from "./program.js";

const parameters = read();
// The server writes the address of the pack into the page; on a plain static host ?pack=URL names it.
const address = document.body.dataset.pack || parameters.get("pack");
/** @type {Pack | null} */
const pack = address ? new Pack(new URL(address, document.body.dataset.pack ? document.baseURI : location.href)) : null;
const newPool = () => new DecodePool();
// The first chunk is decoded as soon as the program has found a device: by then a worker is ready.
const pool = pack ? newPool().warm() : null;
// Failures are awaited, and shown, by the page; they must not count as unhandled until it is loaded.
const program = load(parameters);
program.catch(() => {});
const head = pack?.head();
head?.catch(() => {});
const language = preferred(parameters);
const messages = ask(language);
messages.catch(() => {});

// The bar of the loading card: it only ever goes on, whatever comes first.
const bar = /** @type {HTMLProgressElement} */ (document.getElementById("loading-bar"));
const came = (/** @type {number} */ part) => (bar.value = Math.max(bar.position < 0 ? 0 : bar.value, part));
if (pack) pack.onProgress = (done, total) => came(total ? (0.3 * done) / total : 0);
program.then(
  () => came(0.6),
  () => {},
);

// Most pages are not embedded.
const embed = parent !== window || parameters.has("embed") ? import("./embed.js") : null;
const { start } = await import("./app.js");
await start({ pack, head, program, gpu: { whyNoGpu, otherProgram }, pool, newPool, embed: await embed, parameters, language, messages, came });
