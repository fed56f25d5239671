// The first thing that runs: asks for the head of the pack, for the program and for what decodes at the same time, then starts the page.
import { DecodePool } from "./decode-pool.js";
import { Pack } from "./loader.js";
import { read } from "./parameters.js";
import { load, otherProgram, whyNoGpu } from "./program.js";

const parameters = read();
// The server writes the address of the pack into the page; on a plain static host ?pack=URL names it.
const address = document.body.dataset.pack || parameters.get("pack");
/** @type {Pack | null} */
const pack = address ? new Pack(new URL(address, document.body.dataset.pack ? document.baseURI : location.href)) : null;
// Failures are awaited, and shown, by the page; they must not count as unhandled until it is loaded.
const head = pack?.head();
head?.catch(() => {});
const program = load(parameters);
program.catch(() => {});
// The first chunk is decoded as soon as the program has found a device: by then a worker is ready.
const newPool = () => new DecodePool();
const pool = pack ? newPool().warm() : null;

// Most pages are not embedded.
const embed = parent !== window || parameters.has("embed") ? import("./embed.js") : null;
const { start } = await import("./app.js");
await start({ pack, head, program, gpu: { whyNoGpu, otherProgram }, pool, newPool, embed: await embed, parameters });
