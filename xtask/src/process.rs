//! How the tasks run other programs: always from the repository root, the command shown before it runs, and an error that
//! repeats the command when it fails.
//!
//! Invariant: no shell is involved; arguments reach the program as they are given.

use anyhow::{Context, Result, bail};
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::mpsc;
use std::thread;

/// The repository root: the folder above `xtask/`.
///
/// # Errors
/// The folder is gone, for example because a binary was kept and its clone deleted.
pub(crate) fn root() -> Result<PathBuf> {
    let here =
        std::env::var_os("CARGO_MANIFEST_DIR").map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")), PathBuf::from);
    let root = here.parent().context("xtask has no folder above it")?;
    root.canonicalize()
        .with_context(|| format!("the repository {} is not there; run `cargo xtask` inside a clone", root.display()))
}

/// A command that starts in the repository root, without colour codes, so that its output can be read back.
///
/// # Errors
/// As [`root`].
pub(crate) fn command(program: &str, args: &[&str]) -> Result<Command> {
    let mut command = Command::new(program);
    command.args(args).current_dir(root()?).env("CARGO_TERM_COLOR", "never").env("NO_COLOR", "1");
    if cfg!(unix) && std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // Without a session (CI, root) Mesa complains of this on stderr each time it starts, though nothing of it is used here.
        command.env("XDG_RUNTIME_DIR", std::env::temp_dir());
    }
    Ok(command)
}

/// The cargo that runs this task, so that a toolchain chosen with `cargo +name` stays chosen.
///
/// # Errors
/// As [`root`].
pub(crate) fn cargo(args: &[&str]) -> Result<Command> {
    let program = std::env::var("CARGO").unwrap_or_else(|_| "cargo".into());
    let mut command = command(&program, args)?;
    // What `cargo run` sets for xtask is not true for the packages that its children build.
    for (name, _) in
        std::env::vars().filter(|(name, _)| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_"))
    {
        command.env_remove(name);
    }
    Ok(command)
}

/// The command as a person would type it.
pub(crate) fn shown(command: &Command) -> String {
    let program = Path::new(command.get_program()).file_name().unwrap_or(command.get_program()).to_string_lossy();
    let mut line = program.into_owned();
    for argument in command.get_args() {
        line.push(' ');
        line.push_str(&argument.to_string_lossy());
    }
    line
}

/// Runs a command with its output passed on.
///
/// # Errors
/// It cannot be started or ends with another status than 0; the message repeats the command.
pub(crate) fn run(command: &mut Command) -> Result<()> {
    println!("  $ {}", shown(command));
    let status = command.stdin(Stdio::null()).status().with_context(|| format!("cannot start `{}`", shown(command)))?;
    if !status.success() {
        bail!("`{}` failed ({status})", shown(command));
    }
    Ok(())
}

/// Compiles `kilwa` in the given cargo profile; the path of the program.
///
/// # Errors
/// It does not compile, or there is no such profile.
pub(crate) fn compile_kilwa(profile: &str) -> Result<PathBuf> {
    run(&mut cargo(&["build", "--locked", "--package", "kilwa", "--profile", profile])?)?;
    kilwa(profile)
}

/// Where cargo puts `kilwa` in the given profile.
///
/// # Errors
/// As [`root`].
pub(crate) fn kilwa(profile: &str) -> Result<PathBuf> {
    let folder = if profile == "dev" { "debug" } else { profile };
    let target = root()?.join(std::env::var_os("CARGO_TARGET_DIR").unwrap_or_else(|| "target".into()));
    Ok(target.join(folder).join(format!("kilwa{}", std::env::consts::EXE_SUFFIX)))
}

/// What a command writes to stdout, trimmed; nothing is shown.
///
/// # Errors
/// It cannot be started or ends with another status than 0; the message carries what it wrote to stderr.
pub(crate) fn output(command: &mut Command) -> Result<String> {
    let result = command.stdin(Stdio::null()).output().with_context(|| format!("cannot start `{}`", shown(command)))?;
    if !result.status.success() {
        bail!("`{}` failed ({}): {}", shown(command), result.status, String::from_utf8_lossy(&result.stderr).trim());
    }
    Ok(String::from_utf8_lossy(&result.stdout).trim().to_owned())
}

/// Runs a command, handing its output line by line to `each` and passing on the lines that this keeps (true); true when the command ended with
/// status 0.
///
/// # Errors
/// It cannot be started.
pub(crate) fn watch(command: &mut Command, mut each: impl FnMut(&str) -> bool) -> Result<bool> {
    println!("  $ {}", shown(command));
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .with_context(|| format!("cannot start `{}`", shown(command)))?;
    // Bounded: a child that writes faster than we print waits.
    let (sender, lines) = mpsc::sync_channel::<String>(256);
    let readers: Vec<_> = [child.stdout.take().map(boxed), child.stderr.take().map(boxed)]
        .into_iter()
        .flatten()
        .map(|stream| {
            let sender = sender.clone();
            thread::spawn(move || pass_lines(stream, &sender))
        })
        .collect();
    drop(sender);
    for line in lines {
        if each(&line) {
            println!("{line}");
        }
    }
    for reader in readers {
        // A reader only ends with its stream; a panic there would have been printed.
        let _ = reader.join();
    }
    Ok(child.wait().with_context(|| format!("waiting for `{}`", shown(command)))?.success())
}

fn boxed<R: Read + Send + 'static>(stream: R) -> Box<dyn Read + Send> {
    Box::new(stream)
}

fn pass_lines(stream: Box<dyn Read + Send>, sender: &mpsc::SyncSender<String>) {
    let mut stream = BufReader::new(stream);
    let mut line = Vec::new();
    while stream.read_until(b'\n', &mut line).is_ok_and(|n| n > 0) {
        let text = String::from_utf8_lossy(&line).trim_end_matches(['\n', '\r']).to_owned();
        line.clear();
        if sender.send(text).is_err() {
            return;
        }
    }
}

/// The first of `names` that is a file on `PATH`.
pub(crate) fn on_path(names: &[&str]) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    let folders: Vec<PathBuf> = std::env::split_paths(&path).collect();
    names.iter().flat_map(|name| folders.iter().map(move |folder| folder.join(name))).find(|file| file.is_file())
}
