//! `kilwa serve` as a process: it prints its address, ends on SIGTERM, and refuses what cannot be served.

use crate::support::serving::{address, page};
use std::io::{Read as _, Write as _};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::Path;
use std::process::{Command, Output, Stdio};

fn kilwa(args: &[&str], www: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_kilwa"));
    command.arg("serve").args(args).arg("--www").arg(www).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn refused(args: &[&str], www: &Path) -> String {
    let Output { status, stderr, .. } = kilwa(args, www).output().unwrap();
    assert_eq!(status.code(), Some(1), "{args:?}");
    String::from_utf8(stderr).unwrap()
}

fn get(address: SocketAddr, path: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    write!(stream, "GET {path} HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer).unwrap();
    String::from_utf8_lossy(&answer).into_owned()
}

#[test]
fn the_server_prints_its_address_answers_and_exits_with_success_at_sigterm() {
    let dir = tempfile::tempdir().unwrap();
    page(dir.path());
    std::fs::write(dir.path().join("broken.kilwa"), "no pack").unwrap();
    let folder = dir.path().to_str().unwrap();
    let mut child = kilwa(&[folder, "--listen", "127.0.0.1:0"], dir.path()).spawn().unwrap();
    let address = address(&mut child);
    assert!(get(address, "/healthz").ends_with("ok\n"));
    assert!(get(address, "/").contains("cannot be shown"));
    assert!(get(address, "/packs/broken.kilwa").starts_with("HTTP/1.1 404"), "only packs are given out");
    assert!(get(address, "/packs/../broken.kilwa").starts_with("HTTP/1.1 404"));
    let kill = Command::new("kill").arg("-TERM").arg(child.id().to_string()).status().unwrap();
    assert!(kill.success());
    assert_eq!(child.wait().unwrap().code(), Some(0));
}

#[test]
fn a_folder_that_cannot_be_served_is_refused_with_the_reason() {
    let dir = tempfile::tempdir().unwrap();
    let folder = dir.path().to_str().unwrap();
    let no_page = refused(&[folder], dir.path());
    assert!(no_page.contains("cargo xtask web"), "{no_page}");
    page(dir.path());
    let missing = refused(&["/nowhere/at/all"], dir.path());
    assert!(missing.contains("/nowhere/at/all"), "{missing}");
    let mesh = dir.path().join("mesh.ply");
    std::fs::write(&mesh, "ply").unwrap();
    let other = refused(&[mesh.to_str().unwrap()], dir.path());
    assert!(other.contains("kilwa build"), "{other}");
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().to_string();
    let busy = refused(&[folder, "--listen", &port], dir.path());
    assert!(busy.contains("in use") && busy.contains(&port), "{busy}");
    let usage = kilwa(&[folder, "--listen", "nonsense"], dir.path()).output().unwrap();
    assert_eq!(usage.status.code(), Some(2));
}

#[test]
fn secret_files_in_the_served_folder_are_refused_and_nothing_is_created_in_it() {
    let dir = tempfile::tempdir().unwrap();
    page(dir.path());
    let (models, elsewhere) = (dir.path().join("models"), dir.path().join("elsewhere"));
    std::fs::create_dir(&models).unwrap();
    std::fs::create_dir(&elsewhere).unwrap();
    std::os::unix::fs::symlink(&models, elsewhere.join("link")).unwrap();
    let accounts = dir.path().join("access.json");
    kilwa_server::access::Accounts::new().unwrap().create(&accounts).unwrap();
    let folder = models.to_str().unwrap();
    for option in ["--sessions", "--audit"] {
        for place in
            ["models/s", "models/deeper/s", "elsewhere/link/s", "elsewhere/new/../../models/s", "models/../models/s"]
        {
            let at = dir.path().join(place);
            let args = [folder, "--listen", "127.0.0.1:0", "--access", accounts.to_str().unwrap()];
            let message = refused(&[&args[..], &[option, at.to_str().unwrap()]].concat(), dir.path());
            assert!(message.contains("in the folder that is served"), "{option} {place}: {message}");
            assert_eq!(std::fs::read_dir(&models).unwrap().count(), 0, "{option} {place}");
            assert_eq!(std::fs::read_dir(&elsewhere).unwrap().count(), 1, "{option} {place}");
        }
    }
}

#[test]
fn a_survey_is_served_and_what_does_not_fit_it_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    page(dir.path());
    let survey = dir.path().join("survey");
    std::fs::create_dir(&survey).unwrap();
    std::fs::write(survey.join("survey.toml"), "version = 1\ntitle = \"Fort\"\n").unwrap();
    let folder = survey.to_str().unwrap();
    let mut child = kilwa(&[folder, "--listen", "127.0.0.1:0"], dir.path()).spawn().unwrap();
    let address = address(&mut child);
    assert!(get(address, "/").contains("<title>Fort</title>"));
    assert!(get(address, "/survey.toml").starts_with("HTTP/1.1 404"));
    let kill = Command::new("kill").arg("-TERM").arg(child.id().to_string()).status().unwrap();
    assert!(kill.success());
    assert_eq!(child.wait().unwrap().code(), Some(0));

    let accounts = dir.path().join("access.json");
    kilwa_server::access::Accounts::new().unwrap().create(&accounts).unwrap();
    let open = refused(&[folder, "--access", accounts.to_str().unwrap()], dir.path());
    assert!(open.contains("--access is for archive objects") && open.contains("everyone"), "{open}");
    let file = refused(&[survey.join("survey.toml").to_str().unwrap()], dir.path());
    assert!(file.contains(&format!("kilwa serve {folder}")), "{file}");
    std::fs::write(survey.join("survey.toml"), "version = 1\nstatoin = 3\n").unwrap();
    let mistake = refused(&[folder], dir.path());
    assert!(mistake.contains("statoin"), "{mistake}");
}

#[test]
fn a_folder_with_nothing_to_serve_gets_a_hint_about_what_can_be_served() {
    let dir = tempfile::tempdir().unwrap();
    page(dir.path());
    let empty = dir.path().join("empty");
    std::fs::create_dir(&empty).unwrap();
    let mut child = kilwa(&[empty.to_str().unwrap(), "--listen", "127.0.0.1:0"], dir.path()).spawn().unwrap();
    let mut lines = std::io::BufRead::lines(std::io::BufReader::new(child.stdout.take().unwrap()));
    assert!(lines.next().unwrap().unwrap().starts_with("Serving 0 models"));
    let hint = lines.next().unwrap().unwrap();
    assert!(["kilwa publish", "*.kilwa", "survey.toml"].iter().all(|what| hint.contains(what)), "{hint}");
    child.kill().unwrap();
    child.wait().unwrap();
}
