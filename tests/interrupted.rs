//! A signal while a file is written under a temporary name: the program ends, and no part of the file is left.

use crate::support::{large_pack, text};
use std::path::Path;
use std::process::{Child, Command, Stdio};

/// Names of signals, and the exit code of the program.
const SIGNALS: [(&str, i32); 3] = [("-HUP", 129), ("-INT", 130), ("-TERM", 143)];

fn names(folder: &Path) -> Vec<String> {
    std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
}

/// Wait until a hidden file is in the folder, or the program has ended, and send a signal.
fn signal_at_hidden_file(child: &mut Child, folder: &Path, signal: &str) {
    while !names(folder).iter().any(|name| name.starts_with('.')) {
        if child.try_wait().unwrap().is_some() {
            return;
        }
        std::thread::yield_now();
    }
    Command::new("kill").args([signal, &child.id().to_string()]).stderr(Stdio::null()).status().unwrap();
}

fn begun(args: &[&str]) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kilwa"));
    command.args(args).stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Run a command that writes the file `out` into an empty folder and send it each signal: no file is left, or the whole one if it had its name
/// before the signal came. Try again until a signal comes before the file has its name.
pub(crate) fn leaves_nothing_partial(out: &Path, args: &[&str]) {
    let folder = out.parent().unwrap();
    for (signal, code) in SIGNALS {
        let caught = (0..50).any(|_| {
            let mut child = begun(args);
            signal_at_hidden_file(&mut child, folder, signal);
            let output = child.wait_with_output().unwrap();
            let message = String::from_utf8_lossy(&output.stderr);
            let (left, was_finished) = (names(folder), out.exists());
            assert_eq!(left.len(), usize::from(was_finished), "{args:?}, {signal}: {left:?}: {message}");
            if output.status.success() {
                assert!(was_finished, "{args:?}: no file: {message}");
            } else {
                assert_eq!(output.status.code(), Some(code), "{args:?}, {signal}: {message}");
            }
            if was_finished {
                let written = std::fs::read(out).unwrap();
                std::fs::remove_file(out).unwrap();
                if !output.status.success() {
                    crate::support::succeeds(args);
                    assert!(written == std::fs::read(out).unwrap(), "{args:?}, {signal}: the file is not whole");
                    std::fs::remove_file(out).unwrap();
                }
            }
            !was_finished
        });
        assert!(caught, "{args:?} was always faster than {signal}");
    }
}

#[test]
fn a_signal_during_synth_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.ply");
    leaves_nothing_partial(&out, &["synth", "wall", "--triangles", "20M", "-o", text(&out)]);
}

#[test]
fn a_signal_while_scans_are_simulated_leaves_no_folder() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scans");
    let mut child = begun(&["synth", "scans", "--columns", "20000", "-o", text(&out)]);
    signal_at_hidden_file(&mut child, folder.path(), "-INT");
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(names(folder.path()), Vec::<String>::new());
}

#[test]
fn a_signal_during_extract_leaves_no_file() {
    let pack = large_pack();
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.obj");
    leaves_nothing_partial(&out, &["extract", text(&pack), "-o", text(&out)]);
}

#[test]
fn a_signal_during_a_mesh_report_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, temporary) = (folder.path().join("a.ply"), folder.path().join("temporary"));
    crate::support::succeeds(&["synth", "wall", "--triangles", "1M", "-o", text(&mesh)]);
    std::fs::create_dir(&temporary).unwrap();
    for (signal, code) in SIGNALS {
        let mut command = Command::new(env!("CARGO_BIN_EXE_kilwa"));
        let mut child = command.args(["info", text(&mesh)]).env("TMPDIR", &temporary).spawn().unwrap();
        while names(&temporary).is_empty() {
            assert!(child.try_wait().unwrap().is_none(), "it must use scratch files while it reads the mesh");
            std::thread::yield_now();
        }
        Command::new("kill").args([signal, &child.id().to_string()]).status().unwrap();
        assert_eq!(child.wait().unwrap().code(), Some(code), "{signal}");
        assert!(names(&temporary).is_empty(), "{signal}: {:?}", names(&temporary));
    }
}

/// Under `nohup`, and in background jobs of a script, signals are ignored; this must stay so.
#[cfg(target_os = "linux")]
#[test]
fn a_signal_ignored_by_the_parent_stays_ignored() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("a.ply");
    let mut command = Command::new("sh");
    command.args(["-c", "trap '' HUP; exec \"$@\"", "sh", env!("CARGO_BIN_EXE_kilwa")]);
    command.args(["synth", "wall", "--triangles", "1M", "-o", text(&out)]).stdout(Stdio::null());
    let mut child = command.spawn().unwrap();
    signal_at_hidden_file(&mut child, folder.path(), "-HUP");
    assert!(child.wait().unwrap().success());
    assert!(out.exists());
}
