//! The tools that the tasks need besides cargo, checked before they are used and installed where that is possible without asking:
//! the wasm target (rustup), Node and npm packages (npm ci from the lock files), Debian's Chromium with and without its windows, Firefox
//! and WebKitGTK, Mesa's software Vulkan and strace (apt-get, only as root).
//!
//! Invariants: each step says what it does before it does it; nothing is installed through sudo; where a step cannot be done the
//! error is the command to type. A step that has nothing to do prints one line or none.

use crate::process::{command, on_path, output, root, run, shown};
use anyhow::{Context, Result, bail};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The target of the page's code.
pub(crate) const WASM: &str = "wasm32-unknown-unknown";

/// Oldest major version of Node that the tools were run with.
const MIN_NODE: u32 = 18;

/// The standard library for wasm32 of the toolchain in use.
///
/// # Errors
/// It does not exist and rustup cannot add it.
pub(crate) fn wasm_target() -> Result<()> {
    let folder = output(&mut command("rustc", &["--print", "target-libdir", "--target", WASM])?)?;
    if Path::new(&folder).is_dir() {
        return Ok(());
    }
    println!("setup: the Rust target {WASM} is not installed; adding it with rustup");
    if on_path(&["rustup"]).is_none() {
        bail!(
            "rustc has no {WASM} ({folder} is missing) and there is no rustup to add it; \
             install Rust from https://rustup.rs, or your distribution's package for that target"
        );
    }
    run(&mut command("rustup", &["target", "add", WASM])?)
        .with_context(|| format!("run `rustup target add {WASM}` yourself"))
}

/// Node and npm, not older than what the tools were tried with.
///
/// # Errors
/// One of them is missing or too old.
pub(crate) fn node() -> Result<()> {
    for program in ["node", "npm"] {
        if on_path(&[program, &format!("{program}.exe"), &format!("{program}.cmd")]).is_none() {
            apt(&["nodejs", "npm"], &format!("{program} is not on PATH"))?;
        }
    }
    let version = output(&mut command("node", &["--version"])?)?;
    let major = version.trim_start_matches('v').split('.').next().and_then(|n| n.parse::<u32>().ok());
    match major {
        Some(major) if major >= MIN_NODE => Ok(()),
        _ => bail!("node is {version}; version {MIN_NODE} or newer is needed (https://nodejs.org)"),
    }
}

/// `npm ci` in `folder` (relative to the root), skipped where the packages of this very lock file are installed already.
///
/// # Errors
/// There is no lock file, or npm fails.
pub(crate) fn npm_packages(folder: &str) -> Result<PathBuf> {
    node()?;
    let folder = root()?.join(folder);
    let lock_file = folder.join("package-lock.json");
    let lock = fs::read(&lock_file).with_context(|| format!("cannot read {}", lock_file.display()))?;
    let wanted = blake3::hash(&lock).to_hex();
    let stamp = folder.join("node_modules/.kilwa-lock");
    if fs::read_to_string(&stamp).is_ok_and(|have| have == wanted.as_str()) {
        return Ok(folder);
    }
    println!("setup: installing the npm packages of {}", folder.display());
    // npm's own cache (~/.npm, by version and checksum) makes the second clone cheap; prefer-offline uses it without asking the registry.
    let mut npm = command("npm", &["ci", "--prefer-offline", "--no-audit", "--no-fund"])?;
    npm.current_dir(&folder);
    run(&mut npm).with_context(|| {
        format!(
            "npm cannot install what {} lists. Without network it needs these packages in its cache (`npm config get cache`); \
             behind a proxy set HTTPS_PROXY and NODE_EXTRA_CA_CERTS. To try again: cd {} && {}",
            lock_file.display(),
            folder.display(),
            shown(&npm)
        )
    })?;
    fs::write(&stamp, wanted.as_str()).with_context(|| format!("cannot write {}", stamp.display()))?;
    Ok(folder)
}

/// Chromium: `$CHROMIUM`, or the first on `PATH`, installed from Debian where possible.
///
/// # Errors
/// None is there and none can be installed.
pub(crate) fn chromium() -> Result<PathBuf> {
    if let Some(chosen) = chosen_chromium()? {
        return Ok(chosen);
    }
    let names = ["chromium", "chromium-browser", "google-chrome-stable", "google-chrome"];
    if let Some(found) = on_path(&names) {
        return Ok(found);
    }
    apt(&["chromium"], "no Chromium on PATH; the page is tested in one (or set CHROMIUM to another build's program)")?;
    on_path(&names).context("Debian's package chromium was installed, yet there is no chromium on PATH")
}

/// Chromium without its windows: the same engine, which draws the same pictures for three quarters of the processor time
/// (docs/bench/2026-11-30-headless-shell.md). Where it cannot be installed, [`chromium`].
///
/// # Errors
/// As for [`chromium`].
pub(crate) fn headless_chromium() -> Result<PathBuf> {
    if let Some(chosen) = chosen_chromium()? {
        return Ok(chosen);
    }
    let names = ["chromium-headless-shell", "chrome-headless-shell"];
    if let Some(found) = on_path(&names) {
        return Ok(found);
    }
    let installed =
        apt(&["chromium-headless-shell"], "no chromium-headless-shell on PATH, in which the page is tested");
    match installed.map(|()| on_path(&names)) {
        Ok(Some(found)) => Ok(found),
        Ok(None) => chromium(),
        Err(why) => {
            println!("setup: {why:#}; the whole Chromium, which takes longer, is used instead");
            chromium()
        }
    }
}

/// `$CHROMIUM`.
fn chosen_chromium() -> Result<Option<PathBuf>> {
    match std::env::var_os("CHROMIUM").map(PathBuf::from) {
        Some(chosen) if chosen.is_file() => Ok(Some(chosen)),
        Some(chosen) => bail!("CHROMIUM={} is not a file", chosen.display()),
        None => Ok(None),
    }
}

/// A Vulkan driver for headless rendering: any on Linux, Mesa's software one if there is none.
///
/// # Errors
/// None is there and none can be installed.
pub(crate) fn vulkan() -> Result<()> {
    if !cfg!(target_os = "linux")
        || std::env::var_os("VK_DRIVER_FILES").or_else(|| std::env::var_os("VK_ICD_FILENAMES")).is_some()
    {
        return Ok(());
    }
    let has_driver = ["/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d"]
        .iter()
        .filter_map(|folder| fs::read_dir(folder).ok())
        .flat_map(Iterator::flatten)
        .any(|entry| entry.path().extension().is_some_and(|e| e == "json"));
    let has_loader =
        output(&mut command("ldconfig", &["-p"])?).map_or(true, |libraries| libraries.contains("libvulkan.so.1"));
    if has_driver && has_loader {
        return Ok(());
    }
    apt(
        &["mesa-vulkan-drivers", "libvulkan1"],
        "no Vulkan driver; headless rendering needs one (Mesa's llvmpipe will do)",
    )
}

/// strace, with which tests kill a program just before one of its system calls.
///
/// # Errors
/// If it is not on PATH and cannot be installed. Those tests then print that they were skipped.
pub(crate) fn strace() -> Result<PathBuf> {
    let names = ["strace"];
    if let Some(found) = on_path(&names) {
        return Ok(found);
    }
    if !cfg!(target_os = "linux") {
        bail!("strace runs only on Linux");
    }
    apt(&names, "no strace on PATH; tests use it to kill programs before system calls")?;
    on_path(&names).context("Debian's package strace was installed, but there is still no strace on PATH")
}

/// The other browsers that the core of the page is tested in, Firefox and WebKitGTK's, and a virtual display for them. Variables that name
/// other programs are those of tests/browser/engines.mjs.
///
/// # Errors
/// One of them is missing and cannot be installed. The tests that need it are then reported as skipped.
pub(crate) fn other_browsers() -> Result<()> {
    let needed = [
        ("FIREFOX", "firefox-esr", "firefox-esr"),
        ("WEBKIT_DRIVER", "WebKitWebDriver", "webkit2gtk-driver"),
        ("XVFB", "Xvfb", "xvfb"),
    ];
    let is_missing = |variable, program| std::env::var_os(variable).is_none() && on_path(&[program]).is_none();
    let mut failures = Vec::new();
    for (variable, program, package) in needed {
        // One at a time: a system may have some of the packages.
        if is_missing(variable, program)
            && let Err(why) = apt(&[package], &format!("no {program} on PATH; the page's core is tested with it"))
        {
            failures.push(format!("{why:#}"));
        }
    }
    if failures.is_empty() { Ok(()) } else { bail!("{}", failures.join("; ")) }
}

/// Python packages of a list with exact versions (relative to the root), from PyPI, in a folder of their own in the user's cache: what to
/// put on `PYTHONPATH`. Nothing is installed into the system's or the user's Python.
///
/// # Errors
/// Python or pip is missing and cannot be installed, or pip fails.
pub(crate) fn python_packages(list: &str) -> Result<PathBuf> {
    let list = root()?.join(list);
    let wanted = fs::read(&list).with_context(|| format!("cannot read {}", list.display()))?;
    let name = blake3::hash(&wanted).to_hex();
    let cache = std::env::var_os("XDG_CACHE_HOME").map(PathBuf::from).filter(|p| p.is_absolute());
    let cache = cache.or_else(|| std::env::home_dir().map(|home| home.join(".cache")));
    let parent = cache.context("there is no home folder to keep Python packages in; set XDG_CACHE_HOME")?.join("kilwa");
    let folder = parent.join(format!("python-{}", &name[..16]));
    if folder.is_dir() {
        return Ok(folder);
    }
    let has_pip = || {
        Ok::<bool, anyhow::Error>(
            command("python3", &["-m", "pip", "--version"])?.output().is_ok_and(|o| o.status.success()),
        )
    };
    if on_path(&["python3"]).is_none() || !has_pip()? {
        apt(&["python3", "python3-pip"], "python3 with pip is not here; second opinions of the trust suite need it")?;
    }
    println!("setup: installing the Python packages of {} to {}", list.display(), folder.display());
    fs::create_dir_all(&parent).with_context(|| format!("cannot create {}", parent.display()))?;
    // Complete or not there at all: installed beside, then renamed.
    let partial = parent.join(format!("python-{}.part-{}", &name[..16], std::process::id()));
    let mut pip =
        command("python3", &["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-compile"])?;
    pip.arg("--target").arg(&partial).arg("--requirement").arg(&list);
    run(&mut pip).with_context(|| {
        format!("pip cannot install what {} lists (from PyPI); to try again: {}", list.display(), shown(&pip))
    })?;
    if fs::rename(&partial, &folder).is_err() && !folder.is_dir() {
        bail!("cannot rename {} to {}", partial.display(), folder.display());
    }
    Ok(folder)
}

/// Installs Debian packages when root, else fails with the command to type.
fn apt(packages: &[&str], why: &str) -> Result<()> {
    let by_hand = format!("apt-get install -y --no-install-recommends {}", packages.join(" "));
    if on_path(&["apt-get"]).is_none() {
        bail!("{why}. Install it with this system's package manager (on Debian: {by_hand})");
    }
    let is_root = output(&mut command("id", &["-u"])?)? == "0";
    if !is_root {
        bail!("{why}. As root: apt-get update && {by_hand}");
    }
    println!("setup: {why}; installing {} from Debian", packages.join(", "));
    apt_get(&["update"])?;
    let mut args = vec!["install", "-y", "--no-install-recommends"];
    args.extend_from_slice(packages);
    apt_get(&args)
}

fn apt_get(args: &[&str]) -> Result<()> {
    let mut apt: Command = command("apt-get", args)?;
    run(apt.env("DEBIAN_FRONTEND", "noninteractive"))
}
