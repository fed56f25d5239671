// What a page does with <kilwa-viewer>: see ../kilwa-viewer.d.ts for everything there is.

const model = document.getElementById("model");
const said = document.getElementById("said");
const parameters = new URLSearchParams(location.search);
if (parameters.has("annotations")) model.setAttribute("annotations", parameters.get("annotations"));
if (parameters.has("pack")) model.src = parameters.get("pack");
else said.textContent = "No pack was named.";

for (const button of document.querySelectorAll("[data-view]")) {
  button.addEventListener("click", () => model.view(button.dataset.view));
}
document.getElementById("clay").addEventListener("click", async () => {
  await model.setMode((await model.getMode()) === "clay" ? "colour" : "clay");
});

let at = 0;
document.getElementById("tour").addEventListener("click", async () => {
  const notes = await model.annotations();
  if (notes.length > 0) await model.openAnnotation(notes[at++ % notes.length].id);
});

model.on("frame", (stats) => {
  said.textContent = `${stats.trianglesDrawn.toLocaleString()} triangles, ${stats.targetReached ? "complete" : "loading"}`;
});
