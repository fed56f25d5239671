//! `kilwa publish --to http://…` as a program: messages, refusals, and finishing what a killed command began.

use super::{METADATA, NOTES, Server, local, pack, tree};
use crate::eventually::eventually;
use crate::support::{serving, text};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

fn command(to: &str, metadata: &Path, www: &Path, token: &str, more: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kilwa"));
    command.args([
        "publish",
        text(&pack()),
        "--to",
        to,
        "--metadata",
        text(metadata),
        "--www",
        text(www),
        "--software",
    ]);
    command.args(more).env("KILWA_TOKEN", token).env_remove("SOURCE_DATE_EPOCH").stdin(Stdio::null());
    command
}

fn bench(metadata: &str) -> (tempfile::TempDir, PathBuf, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let (www, file) = (folder.path().join("www"), folder.path().join("fort.toml"));
    serving::page(&www);
    std::fs::write(&file, metadata).unwrap();
    (folder, file, www)
}

fn printed(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout)
}

#[test]
fn a_command_killed_while_sending_is_finished_once_by_a_rerun_with_the_bytes_of_a_local_publication() {
    let site = local();
    let server = Server::start();
    let (folder, metadata, www) = bench(METADATA);
    let (to, notes) = (format!("http://{}/", server.address), folder.path().join("notes.json"));
    std::fs::write(&notes, NOTES).unwrap();
    let more = ["--date", "2026-11-19", "--notes", text(&notes)];
    let make = || command(&to, &metadata, &www, &server.token, &more);
    let mut child = make().stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
    // As soon as part of it exists.
    let staged = server.folder().join(".kilwa-uploads/fort/upload.json");
    let is_begun = || (staged.exists() || child.try_wait().unwrap().is_some()).then_some(());
    eventually("a part of the upload on the server", is_begun);
    drop(child.kill());
    drop(child.wait());
    let output = make().output().unwrap();
    assert!(output.status.success(), "{}", printed(&output));
    let again = make().arg("--json").output().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&again.stdout).unwrap();
    assert_eq!((&report["already"], &report["version"]), (&true.into(), &1.into()), "{}", printed(&again));
    let (here, there) = (tree(&site.join("fort/v1"), true), tree(&server.folder().join("fort/v1"), true));
    assert_eq!(here.keys().collect::<Vec<_>>(), there.keys().collect::<Vec<_>>());
    assert!(here.iter().all(|(path, bytes)| *bytes == there[path]));
    assert!(!printed(&output).contains(&server.token[6..]));
}

/// The state of an object whose server was killed after it replaced the manifest and before it replaced the page.
#[test]
fn the_same_command_finishes_what_a_killed_server_left_undone() {
    let (server, site) = (Server::start(), local());
    let (_folder, metadata, www) = bench(&METADATA.replace("First.", "Better."));
    for (path, bytes) in tree(&site.join("fort"), true) {
        let to = server.folder().join("fort").join(path);
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        std::fs::write(to, bytes).unwrap();
    }
    let (page, next) = (server.folder().join("fort/index.html"), server.folder().join("fort/.kilwa-next"));
    let new = std::fs::read(&page).unwrap();
    std::fs::create_dir(&next).unwrap();
    std::fs::rename(&page, next.join("index.html")).unwrap();
    std::fs::write(&page, "the page of the version before").unwrap();
    let to = format!("http://{}/", server.address);
    let output = command(&to, &metadata, &www, &server.token, &["--no-notes", "--json"]).output().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&report["already"], &report["version"]), (&true.into(), &2.into()), "{}", printed(&output));
    assert!(std::fs::read(&page).unwrap() == new && !next.exists());
}

#[test]
fn an_upload_without_its_location_is_accepted_and_one_that_reveals_it_is_not_sent() {
    let server = Server::start();
    let (folder, metadata, www) = bench(METADATA);
    let (to, notes) = (format!("http://{}/", server.address), folder.path().join("notes.json"));
    std::fs::write(&notes, NOTES).unwrap();
    let make = |more: &[&str]| {
        command(&to, &metadata, &www, &server.token, more).args(["--date", "2026-11-19"]).output().unwrap()
    };
    let output = make(&["--redact-location", "--notes", text(&notes)]);
    assert!(output.status.success(), "{}", printed(&output));
    let read = |path: &str| -> serde_json::Value {
        serde_json::from_slice(&std::fs::read(server.folder().join(path)).unwrap()).unwrap()
    };
    let version = &read("fort/manifest.json")["versions"][0];
    let bounds = &version["figures"]["bounds"];
    let at = |i: usize, k: usize| bounds[i][k].as_f64().unwrap();
    assert_eq!(version["location_redacted"], true);
    assert!(
        (at(0, 0) + at(1, 0)).abs() < 0.01 && (at(0, 1) + at(1, 1)).abs() < 0.01 && at(0, 2).abs() < 0.01,
        "{bounds}"
    );
    // Moved to a cell, which the upload announces.
    std::fs::write(&metadata, METADATA.replace("\"fort\"", "\"cell\"").replace("/fort/", "/cell/")).unwrap();
    let output = make(&["--redact-location=1000"]);
    assert!(output.status.success(), "{}", printed(&output));
    let east = &read("cell/manifest.json")["versions"][0]["figures"]["bounds"][0][0];
    assert!((400.0..500.0).contains(&east.as_f64().unwrap()), "{east}");
    let output = make(&["--redact-location", "--version-note", "See geo:-8.95,39.52"]);
    assert!(
        !output.status.success() && printed(&output).contains("--version-note: \"geo:-8.95,39.52\" leads to a map"),
        "{}",
        printed(&output)
    );
}

#[test]
fn an_impossible_upload_is_refused_with_what_to_do() {
    let server = Server::start();
    let (folder, metadata, www) = bench(METADATA);
    let to = format!("http://{}/", server.address);
    let run = |to: &str, token: &str, more: &[&str]| {
        let output = command(to, &metadata, &www, token, more).output().unwrap();
        assert_eq!(output.status.code(), Some(1), "{}", printed(&output));
        printed(&output)
    };
    assert!(run("http://museum.example/", &server.token, &[]).contains("--allow-http"));
    assert!(run(&to, "", &[]).contains("contains no token"));
    assert!(run(&to, &server.token, &["--site"]).contains("is for folders"));
    let unknown = format!("kilwa-{}", "0".repeat(64));
    let refused = run(&to, &unknown, &[]);
    assert!(refused.contains("kilwa access token"), "{refused}");
    let mut none = command(&to, &metadata, &www, "", &[]);
    let none = none.env_remove("KILWA_TOKEN").output().unwrap();
    assert!(printed(&none).contains("KILWA_TOKEN") && printed(&none).contains("--token-file"), "{}", printed(&none));
    let file = folder.path().join("token");
    std::fs::write(&file, format!("{}\n", server.token)).unwrap();
    let dry = command(&to, &metadata, &www, "", &["--dry-run", "--token-file", text(&file)]).output().unwrap();
    assert!(dry.status.success() && printed(&dry).contains("Nothing was written"), "{}", printed(&dry));
    assert!(tree(&server.folder(), true).is_empty());
}

#[test]
fn a_token_for_this_computer_is_not_sent_through_a_proxy() {
    let server = Server::start();
    let (_folder, file, www) = bench(METADATA);
    let proxy = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    proxy.set_nonblocking(true).unwrap();
    let named = format!("http://{}", proxy.local_addr().unwrap());
    let mut command = command(&format!("http://{}", server.address), &file, &www, &server.token, &["--dry-run"]);
    for name in ["HTTP_PROXY", "http_proxy", "HTTPS_PROXY", "ALL_PROXY", "all_proxy"] {
        command.env(name, &named);
    }
    let output = command.env_remove("NO_PROXY").env_remove("no_proxy").output().unwrap();
    assert!(output.status.success(), "{}", printed(&output));
    assert!(proxy.accept().is_err(), "the proxy was asked");
}

#[test]
fn a_file_that_changes_while_it_is_sent_is_reported_and_not_resent_forever() {
    let (site, server, folder) = (local(), Server::start(), tempfile::tempdir().unwrap());
    let intent = super::intent(&site, 1);
    let changed = folder.path().join("changed");
    let mut bytes = std::fs::read(site.join("fort/v1/poster.jpg")).unwrap();
    bytes[20] ^= 1;
    std::fs::write(&changed, bytes).unwrap();
    let (first, longest) = (Duration::ZERO, Duration::ZERO);
    let patience = super::send::Patience { attempts: 10, first, longest };
    let sender = super::send::Sender::new(&format!("http://{}", server.address), server.token.clone(), patience);
    let at = |file: &kilwa_server::upload::wire::AnnouncedFile| {
        if file.path == "poster.jpg" { changed.clone() } else { site.join("fort/v1").join(&file.path) }
    };
    let why = sender.publish(&intent, &at, &|_| ()).unwrap_err();
    assert!(why.contains("changed while it was sent") && why.contains(text(&changed)), "{why}");
}

#[test]
fn photographs_and_their_report_are_uploaded_with_the_bytes_of_a_local_publication() {
    let made = crate::publish::photographs::coloured();
    let rights = "[photographs]\nrights = \"CC BY 4.0\"\n";
    let (folder, metadata, www) = bench(&METADATA.replace("[[creators]]", &format!("{rights}[[creators]]")));
    let server = Server::start();
    let (to, here) = (format!("http://{}/", server.address), folder.path().join("site"));
    let publish = |to: &str, more: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_kilwa"));
        command.args(["publish", text(&made.pack), "--to", to, "--metadata", text(&metadata), "--www", text(&www)]);
        command
            .args(["--colour-report", text(&made.report), "--photos", text(&made.photos), "--software", "--json"])
            .args(more);
        command.args(["--date", "2026-11-19"]).env("KILWA_TOKEN", &server.token).env_remove("SOURCE_DATE_EPOCH");
        let output = command.stdin(Stdio::null()).output().unwrap();
        assert!(output.status.success(), "{}", printed(&output));
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!((&report["photographs"], &report["masks"]), (&3.into(), &1.into()), "{report}");
        report
    };
    publish(text(&here), &[]);
    publish(&to, &[]);
    let (here, there) = (tree(&here.join("fort/v1"), true), tree(&server.folder().join("fort/v1"), true));
    assert_eq!(here.keys().collect::<Vec<_>>(), there.keys().collect::<Vec<_>>());
    for (path, bytes) in &here {
        assert!(*bytes == there[path], "{path}");
    }
    assert!(here.keys().any(|path| path.ends_with("photographs/IMG_0001.jpg")), "{:?}", here.keys());
    assert_eq!(publish(&to, &[])["already"], true);
    assert_eq!(publish(&to, &["--dry-run"])["already"], true);
}
