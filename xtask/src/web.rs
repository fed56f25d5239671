//! `cargo xtask web`: the page, ready to be served by any static host, in `www/dist`.
//!
//! Input: the crates `kilwa-viewer` (twice: with WebGPU, and with WebGL 2 for browsers without it) and `kilwa-decode`, `kilwa-measure-web`, and the
//! static files of `www/`, the messages in `i18n/`. Steps: cargo for wasm32 with the profile `web` (in `target/web`, `target/web-points` and `target/web-gl`, so that neither a
//! native build waits for it nor one variant replaces the other), wasm-bindgen as a library of exactly the version that the
//! crates link, wasm-opt from npm's binaryen, a copy of the static files, a `.gz` beside everything that compresses.
//!
//! `trunk build` and `trunk serve` (`Trunk.toml`) make the same page: their hook is `cargo xtask web --trunk`.
//!
//! Invariants: `www/dist` holds what this run wrote and nothing else; a file whose bytes did not change is not touched, so
//! that a binary that embeds the page is not rebuilt for nothing. wasm-opt is skipped where its input, version and flags are those
//! of the last run. Fails on any step, and when the page outgrows its budget.

use crate::bundle;
use crate::process::{cargo, command, on_path, root, run as run_command};
use crate::setup;
use anyhow::{Context, Result, bail};
use flate2::{Compression, write::GzEncoder};
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;
use wasm_bindgen_cli_support::Bindgen;

/// Build the page into www/dist.
#[derive(clap::Args, Default)]
pub(crate) struct Args {
    /// As a hook of trunk: into the folder that trunk names in TRUNK_STAGING_DIR, around the index.html there
    #[arg(long)]
    trunk: bool,
}

/// The variable with which trunk names the folder that it publishes as www/dist after its hooks.
const TRUNK_STAGING: &str = "TRUNK_STAGING_DIR";

/// One call of cargo: its target folder, its further arguments, and the modules that come out: name of the library file, name in
/// the page.
struct Build {
    target: &'static str,
    args: &'static [&'static str],
    modules: &'static [(&'static str, &'static str)],
}

const BUILDS: [Build; 3] = [
    Build {
        target: "target/web",
        args: &["--package", "kilwa-viewer", "--package", "kilwa-decode", "--package", "kilwa-measure-web"],
        modules: &[("kilwa_viewer", "viewer"), ("kilwa_decode", "decode"), ("kilwa_measure_web", "measure")],
    },
    // What packs of points need beyond that, so that nobody else loads it.
    Build {
        target: "target/web-points",
        args: &[
            "--package",
            "kilwa-decode",
            "--package",
            "kilwa-measure-web",
            "--features",
            "kilwa-decode/points,kilwa-measure-web/points",
        ],
        modules: &[("kilwa_decode", "decode-points"), ("kilwa_measure_web", "measure-points")],
    },
    Build {
        target: "target/web-gl",
        args: &["--package", "kilwa-viewer", "--no-default-features", "--features", "webgl"],
        modules: &[("kilwa_viewer", "viewer-gl")],
    },
];

/// What wasm-opt does with every module.
const WASM_OPT: &[&str] = &["-Oz"];
/// What it does with the viewer after that, which every visitor waits for: 0.3 % fewer bytes.
const WASM_OPT_AGAIN: &[&str] = &["--gufa", "-Oz", "--converge"];
/// The features that rustc uses for this target plus `+simd128` of .cargo/config.toml, and no names of tools.
const WASM_FEATURES: [&str; 8] = [
    "--enable-simd",
    "--enable-bulk-memory",
    "--enable-nontrapping-float-to-int",
    "--enable-sign-ext",
    "--enable-mutable-globals",
    "--enable-reference-types",
    "--enable-multivalue",
    "--strip-producers",
];

/// Budget of the viewer's wasm, gzipped bytes (readers on slow links are the audience).
const VIEWER_GZ_MAX: u64 = 350_000;
/// The same of the build with WebGL 2, which carries a shader compiler.
const VIEWER_GL_GZ_MAX: u64 = 1_200_000;
/// Budget of measuring, which is loaded when a tool is first used.
const MEASURE_GZ_MAX: u64 = 350_000;
/// Budget of both modules of packs of points, which take the place of the decoder and of measuring.
const POINTS_GZ_MAX: u64 = 440_000;
/// Budget of what else every visitor loads before the picture, gzipped bytes: what `index.html` names, the worker that decodes, one language.
const FIRST_GZ_MAX: u64 = 90_000;
/// Budget of the parts that the page loads when they are first used (tools, dialogs, embedding), together. No visitor waits for all of them: measuring, the
/// largest, is about half.
const LATER_GZ_MAX: u64 = 58_000;
/// Budget of the photographs that a model was coloured from, which only pages of such models load.
const PHOTOGRAPHS_GZ_MAX: u64 = 12_000;
/// Budget of what browsers with a headset load beside the program for WebGL 2.
const HEADSET_GZ_MAX: u64 = 12_000;
/// Files of the first load that `index.html` does not name: [`first_files`].
const FIRST: [&str; 2] = ["index.html", "decode-worker.js"];

/// File name extensions that are worth compressing beforehand.
const COMPRESSED: [&str; 8] = ["html", "js", "mjs", "css", "json", "wasm", "svg", "webmanifest"];

/// The files of the page: path below `www/dist` with `/`, and bytes.
type Page = BTreeMap<String, Vec<u8>>;

pub(crate) fn run(args: &Args) -> Result<()> {
    if !args.trunk {
        return check_sizes(&build(&root()?.join("www/dist"), None)?);
    }
    let staging = std::env::var_os(TRUNK_STAGING).map(PathBuf::from);
    let staging = staging.with_context(|| {
        format!("{TRUNK_STAGING} is not set: --trunk is for trunk's hook; run `trunk build` or `trunk serve`")
    })?;
    // While it serves, trunk has put the script that reloads the page into it.
    let html = staging.join("index.html");
    let html = fs::read(&html).with_context(|| format!("cannot read {}", html.display()))?;
    let sizes = check_sizes(&build(&staging, Some(html))?);
    // That script counts too, and who is at work may be above the budget for a while.
    if let Err(error) = sizes {
        println!("web: {error:#}; `cargo xtask web` refuses that");
    }
    Ok(())
}

/// The page in `dist`, with another `index.html` than that of `www` where one is given.
fn build(dist: &Path, html: Option<Vec<u8>>) -> Result<Page> {
    setup::wasm_target()?;
    let tools = setup::npm_packages("xtask/npm")?;
    let root = root()?;

    let mut page = Page::new();
    for build in BUILDS {
        let started = Instant::now();
        let mut cargo =
            cargo(&["build", "--locked", "--target", setup::WASM, "--profile", "web", "--target-dir", build.target])?;
        run_command(cargo.args(build.args)).context("the page's code does not compile for wasm32")?;
        let target = root.join(build.target);
        for (library, name) in build.modules {
            let compiled = target.join(setup::WASM).join(format!("web/{library}.wasm"));
            add_module(&mut page, &compiled, name, &tools, &target.join("bindgen"))?;
        }
        println!("web: {} made in {:.1} s", build.target, started.elapsed().as_secs_f64());
    }
    let glue: Vec<String> =
        page.keys().filter(|name| !name.contains('/') && has_extension(name, "js")).cloned().collect();
    add_static_files(&mut page, &root.join("www"), "")?;
    if let Some(html) = html {
        page.insert("index.html".to_owned(), html);
    }
    add_messages(&mut page)?;
    bundle::bundle(&mut page, &root.join("www"), &tools, &root.join("target/web/bundle"), &glue)?;
    add_compressed(&mut page)?;
    let written = synchronise(dist, &page)?;
    println!("web: {} files in {}, {written} of them new or changed", page.len(), dist.display());
    Ok(page)
}

/// Compare what `trunk build --release` makes with `www/dist`, file by file; how many files there are, and `None` where trunk is not
/// installed.
///
/// # Errors
/// A file differs, or is only in one of them; trunk fails.
pub(crate) fn same_with_trunk() -> Result<Option<usize>> {
    if on_path(&["trunk", "trunk.exe"]).is_none() {
        return Ok(None);
    }
    let root = root()?;
    let other = root.join("target/trunk");
    let mut trunk = command("trunk", &["build", "--release", "--dist"])?;
    // trunk 0.21 takes no other value than a word.
    run_command(trunk.arg(&other).env("NO_COLOR", "true"))?;
    let (mut ours, mut theirs) = (Page::new(), Page::new());
    add_folder(&mut ours, &root.join("www/dist"), "", &|_| true)?;
    add_folder(&mut theirs, &other, "", &|_| true)?;
    let unlike: Vec<&str> = ours
        .keys()
        .chain(theirs.keys())
        .filter(|name| ours.get(*name) != theirs.get(*name))
        .map(String::as_str)
        .collect();
    if !unlike.is_empty() {
        bail!("`trunk build --release` makes other files than `cargo xtask web`: {}", unlike.join(", "));
    }
    Ok(Some(ours.len()))
}

/// Only the decoder, as the page has it: `decode.js` and `decode_bg.wasm` in `folder`, for measurements.
///
/// # Errors
/// It does not compile.
pub(crate) fn decoder(folder: &Path) -> Result<()> {
    setup::wasm_target()?;
    let tools = setup::npm_packages("xtask/npm")?;
    let mut cargo =
        cargo(&["build", "--locked", "--target", setup::WASM, "--profile", "web", "--target-dir", "target/web"])?;
    run_command(cargo.args(["--package", "kilwa-decode"])).context("the decoder does not compile for wasm32")?;
    let target = root()?.join("target/web");
    let mut page = Page::new();
    let compiled = target.join(setup::WASM).join("web/kilwa_decode.wasm");
    add_module(&mut page, &compiled, "decode", &tools, &target.join("bindgen"))?;
    synchronise(folder, &page)?;
    Ok(())
}

/// wasm-bindgen and wasm-opt on one compiled module; adds `NAME.js`, `NAME_bg.wasm` and snippets.
fn add_module(page: &mut Page, compiled: &Path, name: &str, tools: &Path, scratch: &Path) -> Result<()> {
    let bound = scratch.join(name);
    if bound.exists() {
        fs::remove_dir_all(&bound).with_context(|| format!("cannot empty {}", bound.display()))?;
    }
    let mut bindgen = Bindgen::new();
    bindgen.input_path(compiled).out_name(name).typescript(true);
    let mut output = bindgen
        .web(true)
        .and_then(Bindgen::generate_output)
        .with_context(|| format!("wasm-bindgen on {}", compiled.display()))?;
    // The names of the module's imports are `__wbg_` and a hash, which do not compress: two letters do.
    let mut short = BTreeMap::new();
    for import in output.wasm_mut().imports.iter_mut().filter(|import| import.name.starts_with("__wb")) {
        let next = format!("i{}", short.len());
        let long = std::mem::take(&mut import.name);
        short.entry(long).or_insert(next).clone_into(&mut import.name);
    }
    output.emit(&bound).with_context(|| format!("wasm-bindgen cannot write to {}", bound.display()))?;
    let glue = bound.join(format!("{name}.js"));
    let text = fs::read_to_string(&glue).with_context(|| format!("wasm-bindgen left no {}", glue.display()))?;
    fs::write(&glue, renamed(&text, &short))?;
    let wasm = format!("{name}_bg.wasm");
    let rounds = if name == "viewer" { &[WASM_OPT, WASM_OPT_AGAIN][..] } else { &[WASM_OPT] };
    optimise(&bound.join(&wasm), rounds, tools, &scratch.join(format!("{name}.opt.wasm")))?;
    // The declarations are for the type checker (www/tsconfig.json), not for the page.
    add_folder(page, &bound, "", &|name| !name.ends_with(".d.ts"))
}

/// `text` with other names for some identifiers.
fn renamed(text: &str, names: &BTreeMap<String, String>) -> String {
    let is_part = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '$';
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while !rest.is_empty() {
        let word_end = rest.find(|c| !is_part(c)).unwrap_or(rest.len());
        let (word, after) = rest.split_at(word_end);
        out.push_str(names.get(word).map_or(word, String::as_str));
        let gap_end = after.find(is_part).unwrap_or(after.len());
        let (gap, next) = after.split_at(gap_end);
        out.push_str(gap);
        rest = next;
    }
    out
}

/// Replaces `module` by what wasm-opt makes of it; `kept` holds the last result, valid while the stamp beside it agrees.
fn optimise(module: &Path, rounds: &[&[&str]], tools: &Path, kept: &Path) -> Result<()> {
    let input = fs::read(module).with_context(|| format!("wasm-bindgen left no {}", module.display()))?;
    let mut key = blake3::Hasher::new();
    key.update(&input);
    key.update(&fs::read(tools.join("package-lock.json"))?);
    key.update(rounds.concat().join(" ").as_bytes());
    key.update(WASM_FEATURES.join(" ").as_bytes());
    let key = key.finalize().to_hex();
    let stamp = kept.with_extension("stamp");
    let is_current = kept.is_file() && fs::read_to_string(&stamp).is_ok_and(|have| have == key.as_str());
    if !is_current {
        // A stamp must never outlive the file it vouches for.
        if stamp.exists() {
            fs::remove_file(&stamp)?;
        }
        let program = tools.join("node_modules/binaryen/bin/wasm-opt");
        let started = Instant::now();
        let mut from = module;
        for round in rounds {
            let mut wasm_opt = command("node", &[])?;
            wasm_opt.arg(&program).args(*round).args(WASM_FEATURES).arg(from).arg("-o").arg(kept);
            run_command(&mut wasm_opt)?;
            from = kept;
        }
        let output_len = fs::metadata(kept)?.len();
        println!("web: wasm-opt {} to {output_len} bytes in {:.1} s", input.len(), started.elapsed().as_secs_f64());
        fs::write(&stamp, key.as_str())?;
    }
    fs::copy(kept, module).with_context(|| format!("cannot copy {} to {}", kept.display(), module.display()))?;
    Ok(())
}

/// The hand-written part of the page: everything under `www/` that is neither output nor a development tool.
fn add_static_files(page: &mut Page, www: &Path, prefix: &str) -> Result<()> {
    let belongs = |name: &str| {
        !name.starts_with('.') && !matches!(name, "dist" | "node_modules" | "package.json" | "tsconfig.json" | "types")
    };
    add_folder(page, www, prefix, &belongs)?;
    if !page.contains_key("index.html") {
        bail!("{} has no index.html", www.display());
    }
    Ok(())
}

/// The page's messages, one file for each language, from the Fluent files in `i18n/`.
fn add_messages(page: &mut Page) -> Result<()> {
    for code in kilwa_messages::languages() {
        let messages = kilwa_messages::page_json(code).map_err(anyhow::Error::msg)?;
        page.insert(format!("i18n/{code}.json"), messages.into_bytes());
        let holes = kilwa_messages::holes_json(code).map_err(anyhow::Error::msg)?;
        page.insert(format!("i18n/holes-{code}.json"), holes.into_bytes());
        let photographs = kilwa_messages::photographs_json(code).map_err(anyhow::Error::msg)?;
        page.insert(format!("i18n/photographs-{code}.json"), photographs.into_bytes());
        let headset = kilwa_messages::headset_json(code).map_err(anyhow::Error::msg)?;
        page.insert(format!("i18n/headset-{code}.json"), headset.into_bytes());
    }
    Ok(())
}

fn add_folder(page: &mut Page, folder: &Path, prefix: &str, belongs: &dyn Fn(&str) -> bool) -> Result<()> {
    let entries = fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))?;
    for entry in entries {
        let entry = entry.with_context(|| format!("cannot list {}", folder.display()))?;
        let Ok(name) = entry.file_name().into_string() else {
            bail!("{} has a name that is not UTF-8; a page cannot link to it", entry.path().display());
        };
        if !belongs(&name) {
            continue;
        }
        let path = entry.path();
        let key = format!("{prefix}{name}");
        if path.is_dir() {
            add_folder(page, &path, &format!("{key}/"), belongs)?;
            continue;
        }
        let bytes = fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?;
        if page.insert(key.clone(), bytes).is_some() {
            bail!("{} would overwrite the generated file {key}; give it another name", path.display());
        }
    }
    Ok(())
}

/// Adds `NAME.gz` and `NAME.br` for every file that compresses, the same bytes for the same input (no time stamp inside). Brotli
/// (RFC 7932) takes a seventh less than gzip of wasm; browsers ask for it over https and on localhost.
fn add_compressed(page: &mut Page) -> Result<()> {
    let mut compressed = Page::new();
    for (name, bytes) in page.iter().filter(|(name, _)| is_compressed(name)) {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::best());
        encoder.write_all(bytes)?;
        compressed.insert(format!("{name}.gz"), encoder.finish()?);
        let mut packed = Vec::new();
        // Quality 11 and a window of 4 MiB: the best there is; it takes seconds for the largest file.
        brotli::CompressorWriter::new(&mut packed, 1 << 16, 11, 22).write_all(bytes)?;
        compressed.insert(format!("{name}.br"), packed);
    }
    page.append(&mut compressed);
    Ok(())
}

fn is_compressed(name: &str) -> bool {
    name.rsplit_once('.').is_some_and(|(_, extension)| COMPRESSED.contains(&extension))
}

/// Makes `dist` equal to `page`; returns how many files were written.
fn synchronise(dist: &Path, page: &Page) -> Result<usize> {
    fs::create_dir_all(dist).with_context(|| format!("cannot create {}", dist.display()))?;
    remove_strangers(dist, "", page)?;
    let mut written = 0;
    for (name, bytes) in page {
        let path = dist.join(name);
        if fs::read(&path).is_ok_and(|have| have == *bytes) {
            continue;
        }
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
        }
        // Written beside and renamed: a server that reads the folder meanwhile never sees half a file.
        let partial = PathBuf::from(format!("{}.part", path.display()));
        fs::write(&partial, bytes).with_context(|| format!("cannot write {}", partial.display()))?;
        fs::rename(&partial, &path).with_context(|| format!("cannot write {}", path.display()))?;
        written += 1;
    }
    Ok(written)
}

fn remove_strangers(folder: &Path, prefix: &str, page: &Page) -> Result<()> {
    for entry in fs::read_dir(folder).with_context(|| format!("cannot list {}", folder.display()))? {
        let path = entry?.path();
        let name = path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default();
        let key = format!("{prefix}{name}");
        if path.is_dir() {
            let inside = format!("{key}/");
            if page.keys().any(|k| k.starts_with(&inside)) {
                remove_strangers(&path, &inside, page)?;
            } else {
                fs::remove_dir_all(&path).with_context(|| format!("cannot remove {}", path.display()))?;
            }
        } else if !page.contains_key(&key) {
            fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
    }
    Ok(())
}

/// Prints what a visitor downloads, and fails where it is more than the budget.
fn check_sizes(page: &Page) -> Result<()> {
    let gzipped =
        |name: &str| page.get(&format!("{name}.gz")).or_else(|| page.get(name)).map_or(0, |bytes| bytes.len() as u64);
    println!("{:>10} {:>10}  file", "bytes", "gzipped");
    let (mut viewer, mut viewer_gl, mut decode, mut measure) = (0, 0, 0, 0);
    let (mut first, mut later, mut glue, mut language, mut holes, mut points) = (0, 0, 0, 0, 0, 0);
    let (mut photographs, mut words_of_photographs) = (0, 0);
    let (mut headset, mut words_of_headset) = (0, 0);
    let at_once = first_files(page);
    for (name, bytes) in page.iter().filter(|(name, _)| !has_extension(name, "gz") && !has_extension(name, "br")) {
        let size = gzipped(name);
        println!("{:>10} {size:>10}  {name}", bytes.len());
        match name.as_str() {
            "viewer_bg.wasm" => viewer = size,
            "viewer-gl_bg.wasm" => viewer_gl = size,
            "decode_bg.wasm" => decode = size,
            "measure_bg.wasm" => measure = size,
            name if name.contains("-points") => points += size,
            // A visitor loads one of the two, and one language.
            "viewer.js" | "viewer-gl.js" => glue = size.max(glue),
            name if name.starts_with("i18n/holes-") => holes = size.max(holes),
            name if name.starts_with("i18n/photographs-") => words_of_photographs = size.max(words_of_photographs),
            name if name.starts_with("i18n/headset-") => words_of_headset = size.max(words_of_headset),
            name if name.starts_with("i18n/") => language = size.max(language),
            // The page itself loads none of these.
            name if name.starts_with("examples/") || name.ends_with(".d.ts") || has_extension(name, "txt") => {}
            name if at_once.contains(name) => first += size,
            name if name.starts_with("photographs") => photographs += size,
            name if name.starts_with("headset") => headset += size,
            _ => later += size,
        }
    }
    first += glue + language;
    later += holes;
    photographs += words_of_photographs;
    headset += words_of_headset;
    println!(
        "web: viewer wasm {viewer} of {VIEWER_GZ_MAX}, with WebGL 2 {viewer_gl} of {VIEWER_GL_GZ_MAX}, decoder wasm {decode}, measuring wasm {measure} of {MEASURE_GZ_MAX}, both for points {points} of {POINTS_GZ_MAX}, page without wasm {first} of {FIRST_GZ_MAX} at first and {later} of {LATER_GZ_MAX} later, photographs {photographs} of {PHOTOGRAPHS_GZ_MAX}, headset {headset} of {HEADSET_GZ_MAX}, bytes gzipped"
    );
    if viewer > VIEWER_GZ_MAX {
        bail!(
            "the viewer's wasm is {viewer} bytes gzipped; at most {VIEWER_GZ_MAX} are allowed (VIEWER_GZ_MAX in xtask/src/web.rs)"
        );
    }
    if viewer_gl > VIEWER_GL_GZ_MAX {
        bail!(
            "the viewer's wasm with WebGL 2 is {viewer_gl} bytes gzipped; at most {VIEWER_GL_GZ_MAX} are allowed (VIEWER_GL_GZ_MAX in xtask/src/web.rs)"
        );
    }
    if measure > MEASURE_GZ_MAX {
        bail!(
            "the measuring wasm is {measure} bytes gzipped; at most {MEASURE_GZ_MAX} are allowed (MEASURE_GZ_MAX in xtask/src/web.rs)"
        );
    }
    if points > POINTS_GZ_MAX {
        bail!(
            "the modules for points are {points} bytes gzipped; at most {POINTS_GZ_MAX} are allowed (POINTS_GZ_MAX in xtask/src/web.rs)"
        );
    }
    if first > FIRST_GZ_MAX {
        bail!(
            "what every visitor loads of the page, without wasm, is {first} bytes gzipped; at most {FIRST_GZ_MAX} are allowed (FIRST_GZ_MAX in xtask/src/web.rs)"
        );
    }
    if later > LATER_GZ_MAX {
        bail!(
            "the parts of the page that are loaded when they are used are {later} bytes gzipped; at most {LATER_GZ_MAX} are allowed (LATER_GZ_MAX in xtask/src/web.rs)"
        );
    }
    if photographs > PHOTOGRAPHS_GZ_MAX {
        bail!(
            "the part of the page for photographs is {photographs} bytes gzipped; at most {PHOTOGRAPHS_GZ_MAX} are allowed (PHOTOGRAPHS_GZ_MAX in xtask/src/web.rs)"
        );
    }
    if headset > HEADSET_GZ_MAX {
        bail!(
            "the part of the page for headsets is {headset} bytes gzipped; at most {HEADSET_GZ_MAX} are allowed (HEADSET_GZ_MAX in xtask/src/web.rs)"
        );
    }
    Ok(())
}

/// What every visitor loads, wasm and its glue aside: the page's HTML and the files that it names.
fn first_files(page: &Page) -> BTreeSet<&str> {
    let html = page.get("index.html").and_then(|bytes| std::str::from_utf8(bytes).ok()).unwrap_or_default();
    let values = ["href=\"", "src=\""].into_iter().flat_map(|attribute| html.split(attribute).skip(1));
    let names = values.map(|rest| rest.split(['"', '#', '?']).next().unwrap_or_default());
    FIRST.into_iter().chain(names).collect()
}

fn has_extension(name: &str, extension: &str) -> bool {
    name.rsplit_once('.').is_some_and(|(_, have)| have == extension)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn page(files: &[(&str, &str)]) -> Page {
        files.iter().map(|(name, text)| ((*name).to_owned(), text.as_bytes().to_vec())).collect()
    }

    fn scratch(name: &str) -> PathBuf {
        let folder = std::env::temp_dir().join(format!("kilwa-xtask-{}-{name}", std::process::id()));
        let _ = fs::remove_dir_all(&folder);
        folder
    }

    #[test]
    fn synchronise_leaves_only_the_files_of_the_page() {
        let dist = scratch("sync");
        assert_eq!(
            synchronise(&dist, &page(&[("index.html", "a"), ("i18n/en.json", "{}"), ("old/x.js", "1")])).unwrap(),
            3
        );
        let next = page(&[("index.html", "b"), ("i18n/en.json", "{}")]);
        assert_eq!(synchronise(&dist, &next).unwrap(), 1, "only the changed file is written");
        assert!(!dist.join("old").exists());
        let mut found = Page::new();
        add_folder(&mut found, &dist, "", &|_| true).unwrap();
        assert_eq!(found, next);
        fs::remove_dir_all(&dist).unwrap();
    }

    #[test]
    fn only_whole_identifiers_are_renamed() {
        let names =
            BTreeMap::from([("__wbg_a_1".to_owned(), "i0".to_owned()), ("__wbg_a_12".to_owned(), "i1".to_owned())]);
        assert_eq!(
            renamed("{ __wbg_a_1: f(__wbg_a_12), x__wbg_a_1: 1 } // é", &names),
            "{ i0: f(i1), x__wbg_a_1: 1 } // é"
        );
    }

    #[test]
    fn only_text_and_wasm_are_precompressed_and_decompress_to_the_same_bytes() {
        let text = "kilwa ".repeat(500);
        let mut files = page(&[("a.js", text.as_str()), ("b.png", "png"), ("c", "no extension")]);
        add_compressed(&mut files).unwrap();
        assert_eq!(files.keys().collect::<Vec<_>>(), ["a.js", "a.js.br", "a.js.gz", "b.png", "c"]);
        let mut back = String::new();
        std::io::Read::read_to_string(&mut flate2::read::GzDecoder::new(&files["a.js.gz"][..]), &mut back).unwrap();
        assert_eq!(back, text);
    }

    #[test]
    fn a_page_over_its_size_budget_is_refused_with_its_size() {
        let mut files = page(&[("index.html", "x")]);
        files.insert("viewer_bg.wasm".into(), vec![0; 10]);
        assert!(check_sizes(&files).is_ok());
        files.insert("viewer_bg.wasm.gz".into(), vec![0; VIEWER_GZ_MAX as usize + 1]);
        assert!(check_sizes(&files).unwrap_err().to_string().contains("350001"));
        files.remove("viewer_bg.wasm.gz");
        files.insert("viewer-gl_bg.wasm".into(), vec![0; 10]);
        files.insert("viewer-gl_bg.wasm.gz".into(), vec![0; VIEWER_GL_GZ_MAX as usize]);
        assert!(check_sizes(&files).is_ok());
        files.insert("viewer-gl_bg.wasm.gz".into(), vec![0; VIEWER_GL_GZ_MAX as usize + 1]);
        assert!(check_sizes(&files).unwrap_err().to_string().contains("1200001"));
        files.remove("viewer-gl_bg.wasm.gz");
        for glue in ["viewer.js", "viewer-gl.js"] {
            files.insert(glue.into(), Vec::new());
            files.insert(format!("{glue}.gz"), vec![0; FIRST_GZ_MAX as usize - 50]);
        }
        assert!(check_sizes(&files).is_ok(), "only one of the two is loaded");
        // What index.html names is loaded at once, the rest when it is used.
        files.insert("index.html".into(), b"<script src=\"app.js\"></script>".to_vec());
        let sized = |name: &str, bytes: u64| {
            let mut files = files.clone();
            files.insert(name.to_owned(), Vec::new());
            files.insert(format!("{name}.gz"), vec![0; bytes as usize]);
            check_sizes(&files).map_err(|e| e.to_string())
        };
        assert!(sized("app.js", 100).unwrap_err().contains("FIRST_GZ_MAX"));
        assert!(sized("share.js", LATER_GZ_MAX).is_ok());
        assert!(sized("share.js", LATER_GZ_MAX + 1).unwrap_err().contains("LATER_GZ_MAX"));
    }

    #[test]
    fn the_hook_of_trunk_without_trunk_says_how_it_is_meant() {
        let message = run(&Args { trunk: true }).unwrap_err().to_string();
        assert!(message.contains("TRUNK_STAGING_DIR") && message.contains("trunk serve"), "{message}");
    }

    #[test]
    fn a_static_file_cannot_replace_a_generated_one() {
        let folder = scratch("clash");
        fs::create_dir_all(&folder).unwrap();
        fs::write(folder.join("viewer.js"), "mine").unwrap();
        let mut files = page(&[("viewer.js", "generated")]);
        assert!(add_folder(&mut files, &folder, "", &|_| true).unwrap_err().to_string().contains("viewer.js"));
        fs::remove_dir_all(&folder).unwrap();
    }
}
