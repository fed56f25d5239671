//! The page's modules as few and small files: esbuild from npm bundles and shrinks what is hand-written, and shrinks what
//! wasm-bindgen wrote. A slow line pays for every file with a round trip and for every byte.
//!
//! Input: the page's files, hand-written modules among them at the top. Output: the same page with the entry scripts in their place, shared
//! chunks beside them, and all that it starts with named in `index.html` so that it is fetched at once. Fails when esbuild does.

use crate::process::{command, output};
use anyhow::{Context, Result, bail};
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// The line of `index.html` that what is bundled is named in place of.
const PLACE: &str = "<link rel=\"modulepreload\" href=\"app.js\">";

/// Folders of the page whose scripts are modules of it.
const FOLDERS: [&str; 3] = ["headset", "measure", "photographs"];

/// Every file of a folder and of those in it.
fn add(page: &mut BTreeMap<String, Vec<u8>>, folder: &Path, prefix: &str) -> Result<()> {
    for entry in fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))? {
        let path = entry.with_context(|| format!("cannot list {}", folder.display()))?.path();
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        if path.is_dir() {
            add(page, &path, &format!("{prefix}{name}/"))?;
        } else {
            let bytes = fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
            page.insert(format!("{prefix}{name}"), bytes);
        }
    }
    Ok(())
}

/// Bundle `page`, whose hand-written modules lie in `www`. `glue` are names of scripts that wasm-bindgen wrote.
pub(crate) fn bundle(
    page: &mut BTreeMap<String, Vec<u8>>,
    www: &Path,
    tools: &Path,
    scratch: &Path,
    glue: &[String],
) -> Result<()> {
    if scratch.exists() {
        fs::remove_dir_all(scratch).with_context(|| format!("cannot empty {}", scratch.display()))?;
    }
    let (written, out) = (scratch.join("glue"), scratch.join("out"));
    for folder in [&written, &out] {
        fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    }
    let mut node = command("node", &[])?;
    node.arg(tools.join("bundle.mjs")).arg(www).arg(&out);
    for name in glue {
        let path = written.join(name);
        let bytes = page.get(name).with_context(|| format!("the page has no {name}"))?;
        fs::write(&path, bytes).with_context(|| format!("cannot write {}", path.display()))?;
        node.arg(path);
    }
    let named = output(&mut node).context("esbuild on the page's modules")?;

    // Modules at the top and in the folders of tools; examples are for people and stay as they are.
    let is_module = |name: &String| {
        Path::new(name).extension().is_some_and(|e| e == "js")
            && (!name.contains('/') || FOLDERS.iter().any(|f| name.strip_prefix(f).is_some_and(|n| n.starts_with('/'))))
    };
    page.retain(|name, _| !is_module(name));
    add(page, &out, "")?;
    let html = page.get("index.html").and_then(|bytes| std::str::from_utf8(bytes).ok()).unwrap_or_default();
    if !html.contains(PLACE) {
        bail!("www/index.html has no line {PLACE}, in place of which the bundled files are named");
    }
    // A browser has six connections, and fetches in this order: what asks for the pack and the program comes first.
    let links: Vec<String> =
        named.split_whitespace().map(|name| format!("<link rel=\"modulepreload\" href=\"{name}\">")).collect();
    let html = html.replacen(PLACE, &links.join("\n"), 1).into_bytes();
    page.insert("index.html".to_owned(), html);
    Ok(())
}
