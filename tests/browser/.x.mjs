import { launch, packFolder, serve } from "/work/hL/tests/browser/harness.mjs";
process.env.KILWA_PACK = "/work/scratch/wall4c.kilwa";
const server = await serve(await packFolder());
const browser = await launch();
const times = Number(process.argv[2] ?? 1);
const firsts=[], targets=[];
for (let k = 0; k < times; k++) {
const context = await browser.newContext({ viewport: { width: 1280, height: 720 } });
const page = await context.newPage();
const client = await context.newCDPSession(page);
await client.send("Network.enable");
await client.send("Network.setCacheDisabled", { cacheDisabled: true });
await client.send("Network.emulateNetworkConditions", { offline: false, latency: 0, downloadThroughput: -1, uploadThroughput: -1 });
await page.addInitScript(() => {
  const ct = GPUDevice.prototype.createTexture; GPUDevice.prototype.createTexture = function (d) { return ct.call(this, {...d, sampleCount: 1}); }; const cp0 = GPUDevice.prototype.createRenderPipeline; GPUDevice.prototype.createRenderPipeline = function (d) { return cp0.call(this, {...d, multisample: {count: 1}}); }; const br = GPUCommandEncoder.prototype.beginRenderPass; GPUCommandEncoder.prototype.beginRenderPass = function (d) { return br.call(this, {...d, colorAttachments: d.colorAttachments.map((c) => c && ({...c, resolveTarget: undefined}))}); }; for (const name of ['draw','drawIndexed']) globalThis.GPURenderPassEncoder.prototype[name] = () => {};
  globalThis.log = [];
  const mark = (n) => log.push([performance.now(), n]);
  globalThis.mark = mark;
  new PerformanceObserver((l) => { for (const e of l.getEntries()) log.push([e.startTime, `LONG ${e.duration|0} ms`]); }).observe({ type: "longtask" });
  const wrap = (o, n) => { const f = o[n]; o[n] = async function (...a) { mark(`${n} >`); const r = await f.apply(this, a); mark(`${n} <`); return r; }; };
  if (navigator.gpu) wrap(GPU.prototype, "requestAdapter");
  wrap(GPUAdapter.prototype, "requestDevice");
  wrap(WebAssembly, "instantiateStreaming"); wrap(WebAssembly, "compileStreaming"); wrap(WebAssembly,"instantiate");
  for (const n of ["createRenderPipeline","createComputePipeline","createShaderModule","createRenderPipelineAsync"]) { const f = GPUDevice.prototype[n]; GPUDevice.prototype[n] = function (...a) { const t = performance.now(); const r = f.apply(this, a); log.push([t, `${n} ${(performance.now()-t).toFixed(1)} ms ${a[0].label ?? ""} samples ${a[0].multisample?.count ?? ""}`]); if (n === "createRenderPipeline") { this.pushErrorScope("validation"); this.popErrorScope().then(() => mark("  pipeline known " + a[0].label)); } return r; }; }
  
  const W = Worker; globalThis.Worker = class extends W { constructor(...a) { mark("worker"); super(...a); this.addEventListener("message", () => mark("worker answered")); } };
  const fo = fetch; globalThis.fetch = async function (u, o) { const name = String(u.url??u).split("/").pop().slice(0, 40); mark(`fetch ${name} ${o?.headers?.Range ?? ""} >`); const r = await fo(u, o); mark(`fetch ${name} headers`); return r; };
  const look = () => { const s = globalThis.kilwa?.session?.stats;
    if (globalThis.kilwa?.session && !globalThis.seen) { globalThis.seen = 1; mark("SESSION"); const v = globalThis.kilwa.session.viewer; for (const n of ["frame","attend","onDecoded","onPageBytes"]) { const f = v[n]; if (f) v[n] = function (...a) { const t = performance.now(); const r = f.apply(this, a); const c = (n==="frame"? r.commands : n==="attend" ? r : []).map((x)=>x.type[0]).join(""); if (n!=="onDecoded") log.push([t, `${n} ${(performance.now()-t).toFixed(1)} ms ${c} ${n==="frame"? "missing "+r.stats.chunksMissing+" pages "+r.stats.pagesMissing+" req "+r.stats.requestsInFlight:""}`]); return r; }; } }
    if (s?.trianglesDrawn > 0 && !globalThis.one) { globalThis.one = performance.now(); mark("FIRST"); }
    if (s?.targetReached) { globalThis.two = performance.now(); mark("TARGET"); return; } setTimeout(look, 5); };
  look();
});
const tan = Math.tan(0.35);
await page.waitForTimeout(2500); await page.goto(`${server.url}/m/fort?err=1&cam=${[Math.PI,0,0.5/tan/1.5,5,0,2.5,0].join(",")}`);
await page.waitForFunction(() => globalThis.two, null, { polling: 100 });
if (k === times - 1) {
const { log, res } = await page.evaluate(() => ({ log, res: performance.getEntriesByType("resource").map((e) => [e.startTime, e.responseStart, e.responseEnd, e.name.split("/").pop().slice(0, 50), e.transferSize]) }));
const all = [...log, ...res.flatMap((r) => [[r[0], `NET ${r[3]} start`], [r[2], `NET ${r[3]} end (${r[4]} B, first byte ${r[1]|0})`]])].sort((a, b) => a[0] - b[0]);
for (const [t, n] of all) console.log(t.toFixed(0).padStart(6), n);
}
const r = await page.evaluate(() => [one, two, performance.timeOrigin]); console.log("LOAD", r[2]/1000, r[0], r[1]); firsts.push(r[0]); targets.push(r[1]);
await context.close();
}
const med=a=>a.toSorted((x,y)=>x-y)[a.length>>1];
console.log("first", firsts.map(x=>x|0).join(" "), "median", med(firsts)|0, " target", targets.map(x=>x|0).join(" "), "median", med(targets)|0);
await browser.close(); server.stop?.(); process.exit(0);
