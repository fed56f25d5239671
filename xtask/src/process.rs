//! How the tasks run other programs: always from the repository root, the command shown before it runs, and an error that
//! repeats the command when it fails.
//!
//! Invariant: no shell is involved; arguments reach the program as they are given.

use anyhow::{Context, Result, bail};
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

/// How long the output of an ended command may be silent before its background processes are ignored, and how often this is checked.
const QUIET: Duration = Duration::from_secs(2);

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
    // The variables that `cargo run` sets for xtask are wrong for the packages that its children build.
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

/// Runs `command` and writes its standard output to `file`.
///
/// # Errors
/// As [`run`]; a file that cannot be created.
pub(crate) fn run_to(command: &mut Command, file: &Path) -> Result<()> {
    let output = File::create(file).with_context(|| format!("cannot create {}", file.display()))?;
    run(command.stdout(output))
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

/// The standard output of a command, trimmed; nothing is shown.
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

/// How a watched command ended.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Ended {
    /// With status 0.
    Well,
    /// With another status.
    Badly,
    /// It was stopped, with all that it had started, for it took longer than it may.
    Late,
}

/// Runs a command for at most `limit`, handing its output line by line to `each` and passing on the lines that this keeps (true). What a
/// command leaves behind when it ends is not waited for, even where it holds the command's output open.
///
/// # Errors
/// It cannot be started.
pub(crate) fn watch(command: &mut Command, limit: Duration, mut each: impl FnMut(&str) -> bool) -> Result<Ended> {
    println!("  $ {}", shown(command));
    let started = Instant::now();
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .with_context(|| format!("cannot start `{}`", shown(command)))?;
    // Bounded: a child that writes faster than we print waits.
    let (sender, lines) = mpsc::sync_channel::<String>(256);
    for stream in [child.stdout.take().map(boxed), child.stderr.take().map(boxed)].into_iter().flatten() {
        let sender = sender.clone();
        thread::spawn(move || pass_lines(stream, &sender));
    }
    drop(sender);
    let mut is_late = false;
    let mut has_ended = false;
    loop {
        match lines.recv_timeout(QUIET) {
            Ok(line) if each(&line) => println!("{line}"),
            Ok(_) => {}
            Err(RecvTimeoutError::Disconnected) => break,
            Err(RecvTimeoutError::Timeout) if has_ended => break,
            Err(RecvTimeoutError::Timeout) => has_ended = child.try_wait().is_ok_and(|status| status.is_some()),
        }
        if is_late && started.elapsed() > limit + 5 * QUIET {
            break; // Something that could not be found continues writing.
        }
        if !is_late && !has_ended && started.elapsed() > limit {
            is_late = true;
            println!("`{}` is stopped: it may take {} minutes", shown(command), limit.as_secs() / 60);
            stop_tree(&mut child);
        }
    }
    // A process that has closed its output may still run.
    while child.try_wait().is_ok_and(|status| status.is_none()) {
        if !is_late && started.elapsed() > limit {
            is_late = true;
            stop_tree(&mut child);
        }
        thread::sleep(QUIET / 20);
    }
    let status = child.wait().with_context(|| format!("waiting for `{}`", shown(command)))?;
    Ok(match status.success() {
        _ if is_late => Ended::Late,
        true => Ended::Well,
        false => Ended::Badly,
    })
}

/// Ends a process and all its descendants, as far as `ps` lists them.
fn stop_tree(child: &mut Child) {
    let listing = Command::new("ps").args(["-A", "-o", "pid=,ppid="]).output().map(|o| o.stdout).unwrap_or_default();
    let listing = String::from_utf8_lossy(&listing);
    let pairs: Vec<(u32, u32)> = listing
        .lines()
        .filter_map(|line| {
            let mut ids = line.split_whitespace().map(|id| id.parse().ok());
            Some((ids.next()??, ids.next()??))
        })
        .collect();
    let mut tree = vec![child.id()];
    let mut at = 0;
    while let Some(&parent) = tree.get(at) {
        tree.extend(pairs.iter().filter(|(_, of)| *of == parent).map(|(id, _)| *id));
        at += 1;
    }
    // Parents first, so that none continues when its child ends.
    let ids = tree.iter().map(u32::to_string);
    // A process that has ended meanwhile is not a failure; nor is a system without these programs, where only the child itself can be ended.
    let _ = Command::new("kill").arg("-KILL").args(ids).stderr(Stdio::null()).status();
    let _ = child.kill();
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

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    fn shell(script: &str) -> Command {
        let mut command = Command::new("sh");
        command.args(["-c", script]);
        command
    }

    const HOUR: Duration = Duration::from_secs(3600);

    #[test]
    fn lines_of_both_streams_are_read_to_the_last() {
        let mut lines = Vec::new();
        let ended = watch(&mut shell("echo a; echo b >&2; printf c; exit 3"), HOUR, |line| {
            lines.push(line.to_owned());
            false
        });
        lines.sort();
        assert_eq!((ended.unwrap(), lines.join("")), (Ended::Badly, "abc".to_owned()));
        assert_eq!(watch(&mut shell("exit 0"), HOUR, |_| true).unwrap(), Ended::Well);
    }

    #[test]
    fn background_processes_of_a_command_are_not_waited_for() {
        let mut child = 0;
        let ended = watch(&mut shell("sleep 3000 & echo $!"), HOUR, |line| {
            child = line.parse().unwrap();
            false
        });
        assert_eq!(ended.unwrap(), Ended::Well);
        assert!(Command::new("kill").arg(child.to_string()).status().unwrap().success(), "it went on");
    }

    #[test]
    fn a_hanging_command_is_stopped_with_its_children() {
        let mut child: u32 = 0;
        let ended = watch(&mut shell("sh -c 'sleep 3000 & echo $!; wait'; echo never"), Duration::ZERO, |line| {
            assert_ne!(line, "never");
            child = line.parse().unwrap_or(child);
            false
        });
        assert_eq!(ended.unwrap(), Ended::Late);
        let is_there =
            || Command::new("kill").args(["-0", &child.to_string()]).stderr(Stdio::null()).status().unwrap().success();
        let begun = Instant::now();
        while is_there() && begun.elapsed() < Duration::from_secs(20) {
            thread::sleep(Duration::from_millis(20));
        }
        assert!(!is_there(), "it was stopped, too");
    }
}
