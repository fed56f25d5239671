//! docs/tutorial.md and docs/tutorial-scans.md, word for word: every command that they show is run in its order, in an empty folder, and prints the lines that
//! it shows. The fort is a hundredth as large, and so are its scans, so numbers differ.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

const PAGE: &str = include_str!("../docs/tutorial.md");
const SCANS: &str = include_str!("../docs/tutorial-scans.md");

/// Sizes on the pages, and those here.
const SMALLER: [(&str, &str); 2] = [("2M", "20k"), ("1000", "100")];

/// The blocks of code of a page, each as its lines.
fn blocks(page: &str) -> Vec<Vec<&str>> {
    let parts = page.split("```").skip(1).step_by(2);
    parts.map(|block| block.trim_matches('\n').lines().collect()).collect()
}

/// The first word of each line that is shown, up to an ellipsis: labels, not figures.
fn labels<'a>(lines: impl Iterator<Item = &'a str>) -> Vec<&'a str> {
    let shown = lines.map(str::trim).take_while(|line| *line != "…");
    let is_label = |word: &&str| word.starts_with(char::is_alphabetic);
    shown.filter_map(|line| line.split([' ', ':']).next()).filter(is_label).collect()
}

fn kilwa(command: &str, folder: &Path) -> Command {
    let home = folder.join("home");
    let mut call = Command::new(env!("CARGO_BIN_EXE_kilwa"));
    let args = command.strip_prefix("kilwa ").unwrap_or_else(|| panic!("{command} is no command of kilwa"));
    let given = args.split_whitespace().map(|arg| match arg.strip_prefix("~/") {
        Some(rest) => home.join(rest).display().to_string(),
        None => SMALLER.iter().find(|(large, _)| *large == arg).map_or(arg, |(_, small)| small).to_owned(),
    });
    call.args(given).current_dir(folder).stdin(Stdio::null());
    call
}

/// Run a command, which must succeed; what it prints.
fn run(command: &str, folder: &Path) -> String {
    let output = kilwa(command, folder).output().unwrap();
    // What it notes comes before its report.
    let printed = [output.stderr, output.stdout].concat();
    let printed = String::from_utf8_lossy(&printed).into_owned();
    assert!(output.status.success(), "{command}: {printed}");
    printed
}

/// Start the server, and stop it when it has printed as many lines as the page shows.
fn serve(command: &str, folder: &Path, lines: usize) -> String {
    let mut server = kilwa(command, folder);
    let mut server = server.args(["--listen", "127.0.0.1:0"]).stdout(Stdio::piped()).spawn().unwrap();
    let out = BufReader::new(server.stdout.take().unwrap());
    let printed: Vec<String> = out.lines().take(lines).map(Result::unwrap).collect();
    server.kill().unwrap();
    server.wait().unwrap();
    printed.join("\n")
}

/// The lines that the reader is to change in the metadata.
fn edit(file: &Path, lines: &[&str]) {
    let mut text = std::fs::read_to_string(file).unwrap();
    for line in lines {
        let key = line.split_once('=').unwrap().0;
        let old = text.lines().find(|old| old.starts_with(key)).unwrap_or_else(|| panic!("{key}is not in the file"));
        text = text.replacen(&old.to_owned(), line, 1);
    }
    std::fs::write(file, text).unwrap();
}

/// Does what a page says; how many commands there were.
fn follow(page: &str, folder: &Path) -> usize {
    let mut commands = 0;
    for block in blocks(page) {
        if block.iter().all(|line| line.contains(" = \"")) {
            edit(&folder.join("fort.toml"), &block);
            continue;
        }
        let Some(command) = block[0].strip_prefix("$ ") else { continue };
        if command.contains("Downloads") {
            // What the reader has saved in the page.
            let points = "-15.503 -7.163 0.918 -10.596 9.486 0.813";
            let file = "~/Downloads/A-synthetic-fort.measurements.json";
            run(&format!("kilwa measure fort.kilwa distance {points} --name Distance_1 --save {file}"), folder);
        }
        let printed = if command.starts_with("kilwa serve") {
            serve(command, folder, block.len() - 1)
        } else {
            run(command, folder)
        };
        let mut found = labels(printed.lines()).into_iter();
        for label in labels(block[1..].iter().copied()) {
            let label = label.trim_start_matches("Distance");
            assert!(found.any(|word| word.contains(label)), "{command} does not print {label}, but\n{printed}");
        }
        commands += 1;
    }
    commands
}

#[test]
fn the_tutorial_works_word_for_word_from_a_scan_to_a_published_and_measured_model() {
    let folder = tempfile::tempdir().unwrap();
    let commands = follow(PAGE, folder.path());
    assert!(commands >= 9, "{commands} commands");
    let object = folder.path().join("site/a-synthetic-fort");
    assert!(object.join("v1").is_dir() && object.join("index.html").is_file(), "published");
}

#[test]
fn the_tutorial_of_scans_works_word_for_word_from_simulated_scans_to_a_served_model() {
    let folder = tempfile::tempdir().unwrap();
    let commands = follow(SCANS, folder.path());
    assert!(commands >= 9, "{commands} commands");
    for file in ["colour.png", "mask.png", "scan_001.ply", "fort.kilwa"] {
        assert!(folder.path().join(file).is_file(), "{file} was written");
    }
}
