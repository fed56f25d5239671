// Browsers run no modules from a disk, so that the viewer cannot start there: the page is shown without it. No module itself.
if (location.protocol === "file:") {
  const sheet = document.createElement("link");
  sheet.rel = "stylesheet";
  sheet.href = "plain/plain.css";
  document.head.append(sheet);
}
