// The first thing that runs: asks for the head of the pack and for the program at the same time, then starts the page.
import { Pack } from "./loader.js";
import { read } from "./parameters.js";
import { load } from "./program.js";

const parameters = read();
// The server writes the address of the pack into the page; on a plain static host ?pack=URL names it.
const address = document.body.dataset.pack || parameters.get("pack");
const pack = address ? new Pack(new URL(address, document.body.dataset.pack ? document.baseURI : location.href)) : null;
// Failures are awaited, and shown, by the page; they must not count as unhandled until it is loaded.
const head = pack?.head();
head?.catch(() => {});
const program = load(parameters);
program.catch(() => {});

const { start } = await import("./app.js");
await start({ pack, head, program, parameters });
