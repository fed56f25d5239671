//! What every verb of `kilwa` owes its user: help, exit codes (0 done, 1 the input or the world is wrong, 2 usage), and a
//! message that names the file it is about.

use std::path::Path;
use std::process::{Command, Output, Stdio};

/// The verbs, in the order of `kilwa --help`.
const VERBS: [&str; 8] = ["synth", "build", "info", "verify", "extract", "render", "measure", "serve"];

fn kilwa(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_kilwa")).args(args).stdin(Stdio::null()).output().unwrap()
}

fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

/// A call with a file that is not there: the arguments in which `{in}` and `{out}` stand for paths in an empty folder.
fn calls_without_input() -> [(&'static str, Vec<&'static str>); 7] {
    [
        ("build", vec!["{in}.ply", "-o", "{out}.kilwa"]),
        ("info", vec!["{in}.kilwa"]),
        ("verify", vec!["{in}.kilwa"]),
        ("extract", vec!["{in}.kilwa", "-o", "{out}.ply"]),
        ("render", vec!["{in}.kilwa", "-o", "{out}.png"]),
        ("measure", vec!["{in}.kilwa", "area"]),
        ("serve", vec!["{in}", "--listen", "127.0.0.1:0"]),
    ]
}

fn is_empty(folder: &Path) -> bool {
    std::fs::read_dir(folder).unwrap().next().is_none()
}

#[test]
fn help_lists_exactly_the_verbs_that_are_documented() {
    let output = kilwa(&["--help"]);
    assert_eq!(output.status.code(), Some(0));
    let text = stdout(&output);
    let commands = text.split("Commands:").nth(1).unwrap().split("Options:").next().unwrap();
    let listed: Vec<_> =
        commands.lines().filter_map(|line| line.split_whitespace().next()).filter(|v| *v != "help").collect();
    assert_eq!(listed, VERBS);
    for verb in VERBS {
        let page = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("docs/{verb}.md"));
        assert!(page.is_file(), "{} is missing", page.display());
    }
}

#[test]
fn every_verb_explains_itself() {
    for verb in VERBS {
        let output = kilwa(&[verb, "--help"]);
        assert_eq!(output.status.code(), Some(0), "{verb} --help: {}", stderr(&output));
        let text = stdout(&output);
        assert!(text.contains(&format!("Usage: kilwa {verb}")), "{verb} --help says {text}");
        assert!(!text.starts_with("Usage:"), "{verb} --help does not say what the verb does: {text}");
    }
}

#[test]
fn every_option_in_the_help_has_a_description() {
    for verb in VERBS {
        let text = stdout(&kilwa(&[verb, "-h"]));
        let lines: Vec<_> = text.lines().collect();
        for (at, line) in lines.iter().enumerate().filter(|(_, line)| line.trim_start().starts_with('-')) {
            // Two spaces separate the description; a long option has it on the next, deeper line.
            let has_own = line.trim_start().contains("  ");
            let has_next = lines
                .get(at + 1)
                .is_some_and(|next| next.starts_with("          ") && !next.trim_start().starts_with('-'));
            assert!(has_own || has_next, "{verb}: no description for {line:?}");
        }
    }
}

#[test]
fn usage_errors_exit_with_2_and_say_how_it_goes() {
    let mut calls: Vec<Vec<&str>> = vec![vec![], vec!["paint"], vec!["--no-such-option"]];
    calls.extend(VERBS.iter().map(|verb| vec![*verb]));
    calls.extend(VERBS.iter().map(|verb| vec![*verb, "--no-such-option"]));
    for call in calls {
        let output = kilwa(&call);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(2), "kilwa {call:?}: {text}");
        assert!(text.contains("Usage:") || text.contains("--help"), "kilwa {call:?} does not say how it goes: {text}");
        assert!(output.stdout.is_empty(), "kilwa {call:?} writes to stdout: {}", stdout(&output));
    }
}

#[test]
fn a_missing_file_exits_with_1_names_the_file_and_leaves_nothing_behind() {
    for (verb, args) in calls_without_input() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).display().to_string();
        let args: Vec<String> =
            args.iter().map(|arg| arg.replace("{in}", &path("not-there")).replace("{out}", &path("result"))).collect();
        let call: Vec<&str> = std::iter::once(verb).chain(args.iter().map(String::as_str)).collect();
        let output = kilwa(&call);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "kilwa {call:?}: {text}");
        assert!(text.contains("not-there"), "kilwa {verb} does not name the file: {text}");
        assert!(text.starts_with("kilwa: "), "kilwa {verb}: {text}");
        assert!(is_empty(folder.path()), "kilwa {verb} left files behind");
    }
}

#[test]
fn what_is_no_pack_is_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("letter.kilwa");
    std::fs::write(&file, "Dear archivist, this is not a pack.\n".repeat(200)).unwrap();
    let file = file.display().to_string();
    for verb in ["info", "verify"] {
        let output = kilwa(&[verb, &file]);
        let text = stderr(&output);
        assert_eq!(output.status.code(), Some(1), "kilwa {verb}: {text}");
        assert!(text.contains("letter.kilwa"), "kilwa {verb} does not name the file: {text}");
    }
}

#[test]
fn a_reader_that_leaves_early_is_no_error() {
    let mut child = Command::new(env!("CARGO_BIN_EXE_kilwa"))
        .arg("--help")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
}
