//! Interrupted fifty times, at random bytes and steps: nobody ever sees part of a version, and in the end it is complete.

use super::proxy::Proxy;
use super::send::{Patience, Sender};
use super::{Server, intent, local, tree};
use crate::support::succeeds;
use fastrand::Rng;
use kilwa_archive::Manifest;
use kilwa_archive::checksums::{Checksums, sha256};
use kilwa_server::upload::wire::{AnnouncedFile, Intent};
use std::io::{Read as _, Write as _};
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

const CUTS: u32 = 50;
/// Environment variables for the client that will be killed.
const CLIENT: &str = "KILWA_TEST_CLIENT";

/// One attempt, ended by the first failure.
pub(crate) fn once() -> Patience {
    Patience { attempts: 1, first: Duration::ZERO, longest: Duration::ZERO }
}

pub(crate) fn publish(address: &str, token: &str, number: u32, site: &Path, patience: Patience) -> Result<u32, String> {
    let sender = Sender::new(address, token.to_owned(), patience);
    let intent = intent(site, number);
    sender.publish(&intent, &at(site, &intent), &|_| ()).map(|p| p.version)
}

/// Where the files of a version lie.
fn at(site: &Path, intent: &Intent) -> impl Fn(&AnnouncedFile) -> PathBuf + use<> {
    let folder = site.join("fort").join(format!("v{}", intent.version));
    move |file| folder.join(&file.path)
}

/// Helper that the next test runs in a separate process and kills.
#[test]
fn helper_process_that_publishes_until_it_is_killed() {
    let Ok(text) = std::env::var(CLIENT) else { return };
    let parts: Vec<&str> = text.splitn(4, ' ').collect();
    drop(publish(parts[0], parts[1], parts[2].parse().unwrap(), Path::new(parts[3]), once()));
}

pub(crate) fn killed_client(address: &str, token: &str, number: u32, site: &Path, after: Duration) {
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "cuts::helper_process_that_publishes_until_it_is_killed", "--quiet"])
        .env(CLIENT, format!("{address} {token} {number} {}", site.display()))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    // The moment of the kill is the subject of this test; it waits for no state.
    std::thread::sleep(after);
    drop(child.kill());
    drop(child.wait());
}

/// The object as everybody sees it: nothing, or every file that its manifest names, whole; how many versions.
fn seen(folder: &Path) -> usize {
    let object = folder.join("fort");
    let read = || std::fs::read(object.join("manifest.json")).ok();
    // The server may be publishing it at this moment: an object that is there has a manifest.
    let is_there = object.exists();
    let Some(bytes) = read() else {
        assert!(!is_there, "an object without a manifest");
        return 0;
    };
    let manifest = Manifest::parse(&bytes).unwrap();
    for version in &manifest.versions {
        let list = std::fs::read(object.join(&version.checksums.url)).unwrap();
        assert_eq!(sha256(&list), version.checksums.sha256);
        for (path, sum) in Checksums::parse(std::str::from_utf8(&list).unwrap()).unwrap().iter() {
            assert_eq!(sha256(&std::fs::read(object.join(&version.folder).join(path)).unwrap()), sum, "{path}");
        }
    }
    manifest.versions.len()
}

/// How many versions the portal shows of it, 0 where it shows nothing.
pub(crate) fn portal(address: std::net::SocketAddr) -> usize {
    let config = ureq::Agent::config_builder().http_status_as_error(false);
    let agent: ureq::Agent = config.timeout_global(Some(Duration::from_secs(10))).build().into();
    let mut answer = agent.get(format!("http://{address}/fort/manifest.json")).call().unwrap();
    match answer.status().as_u16() {
        404 => 0,
        200 => Manifest::parse(&answer.body_mut().read_to_vec().unwrap()).unwrap().versions.len(),
        other => panic!("{other}"),
    }
}

#[test]
fn an_upload_interrupted_fifty_times_shows_the_old_or_new_object_and_ends_with_the_bytes_of_a_local_publication() {
    let site = local();
    let mut dice = Rng::with_seed(0x1234_5678_9abc_def1);
    let mut server = Server::start();
    let (mut cuts, mut kinds) = (0, [0; 3]);
    for number in [1, 2] {
        let all: u64 = intent(&site, number).files.iter().map(|f| f.bytes).sum();
        let (mut done, wanted) = (false, cuts + CUTS / 2);
        while !done && cuts < wanted {
            let before = seen(&server.folder());
            let kind = dice.u64(..3) as usize;
            // Mostly little, so that there is something left to cut; now and then enough to come to the end.
            let bytes = if dice.u64(..8) == 0 { all * 2 } else { 1 + dice.u64(..all / 20) };
            let proxy = Proxy::before(server.address);
            let address = format!("http://{}", proxy.address);
            match kind {
                // The connection breaks after so many bytes, of the request or of the answer.
                0 => {
                    proxy.allow(bytes as i64);
                    done = publish(&address, &server.token, number, &site, once()).is_ok();
                }
                // The client dies after some time.
                1 => killed_client(&address, &server.token, number, &site, Duration::from_millis(dice.u64(..120))),
                // The server dies at a random moment, while the client sends, verifies or waits.
                _ => {
                    proxy.allow(bytes as i64);
                    let (token, from) = (server.token.clone(), site.clone());
                    let client = std::thread::spawn(move || publish(&address, &token, number, &from, once()));
                    std::thread::sleep(Duration::from_millis(dice.u64(..60)));
                    server.restart();
                    done = client.join().unwrap().is_ok();
                }
            }
            cuts += 1;
            kinds[kind] += 1;
            let now = seen(&server.folder());
            assert!(now == before || now == number as usize, "{before} versions became {now}");
            let shown = portal(server.address);
            assert!(shown == before || shown == number as usize, "cut {cuts}: {before} versions, {shown} are shown");
            done |= now == number as usize && kind != 1;
        }
        // Without a cut it continues from where it is.
        let address = format!("http://{}", server.address);
        let published = publish(&address, &server.token, number, &site, Patience::default()).unwrap();
        assert_eq!(published, number);
        if number == 1 {
            // A connection cut after the publication changes nothing.
            assert_eq!(publish(&address, &server.token, 1, &site, Patience::default()), Ok(1));
        }
        while cuts < wanted {
            // It is published: later attempts learn so, however they are interrupted.
            let proxy = Proxy::before(server.address);
            proxy.allow(1 + dice.u64(..3000) as i64);
            drop(publish(&format!("http://{}", proxy.address), &server.token, number, &site, once()));
            assert!(seen(&server.folder()) == number as usize && (proxy.is_cut() || cuts < wanted));
            cuts += 1;
            kinds[0] += 1;
        }
    }
    println!("{cuts} cuts: {} of the connection, {} of the client, {} of the server", kinds[0], kinds[1], kinds[2]);
    assert_eq!(cuts, CUTS);
    let (here, there) = (tree(&site.join("fort"), true), tree(&server.folder().join("fort"), false));
    assert_eq!(here.keys().collect::<Vec<_>>(), there.keys().collect::<Vec<_>>());
    for (path, bytes) in &here {
        assert!(*bytes == there[path], "{path} differs from publishing here");
    }
    // A server that was killed after a version appeared may not have come to writing it down.
    assert!(server.audit().matches("\"published\"").count() <= 2, "each version was published once");
    succeeds(&["verify", server.folder().join("fort").to_str().unwrap()]);
    succeeds(&["verify", &format!("http://{}/fort/", server.address)]);
}

#[test]
fn one_run_survives_a_connection_that_breaks_repeatedly() {
    let site = local();
    let server = Server::start();
    let proxy = Proxy::before(server.address);
    let (address, left) = (format!("http://{}", proxy.address), std::sync::Arc::new(proxy));
    left.allow(60_000);
    let patience = Patience { attempts: 5, first: Duration::from_millis(10), longest: Duration::from_millis(50) };
    let intent = intent(&site, 1);
    let sender = Sender::new(&address, server.token.clone(), patience);
    let waits = std::cell::Cell::new(0);
    let on_progress = |progress: super::send::SendEvent<'_>| {
        if let super::send::SendEvent::Waits(..) = progress {
            waits.set(waits.get() + 1);
            left.allow(300_000);
        }
    };
    let published = sender.publish(&intent, &at(&site, &intent), &on_progress).unwrap();
    assert_eq!((published.version, published.already), (1, false));
    assert!(waits.get() >= 2, "{} waits", waits.get());
}

/// An upload can be repeated whatever status the last one ended with, even if that status otherwise means "try again later".
#[test]
fn a_failed_upload_can_be_repeated_unless_the_server_refuses_to_answer() {
    let answer = |response: &'static str| {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let address = format!("http://{}", listener.local_addr().unwrap());
        let server = std::thread::spawn(move || {
            let (mut stream, _) = listener.accept().unwrap();
            let (mut asked, mut buffer) = (Vec::new(), [0; 1024]);
            while !asked.ends_with(b"\r\n\r\n") {
                let length = stream.read(&mut buffer).unwrap();
                asked.extend_from_slice(&buffer[..length]);
            }
            let length = response.len();
            write!(
                stream,
                "HTTP/1.1 503 Service Unavailable\r\nTus-Resumable: 1.0.0\r\nContent-Length: {length}\r\nConnection: close\r\n\r\n{response}"
            )
            .unwrap();
        });
        let greeted = Sender::new(&address, "kilwa-0".to_owned(), once()).greet("fort");
        server.join().unwrap();
        greeted
    };
    answer("{\"state\":\"refused\",\"version\":2,\"error\":\"the disk failed\"}").unwrap();
    let refused = answer("{\"error\":\"the server cannot identify the user\"}").unwrap_err();
    assert!(refused.contains("cannot identify the user"), "{refused}");
}
