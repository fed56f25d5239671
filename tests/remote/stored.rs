//! The same over a store: server, client and both lines are cut off, and the store has the old object or the new one.

use super::cuts::{killed_client, once, portal, publish};
use super::proxy::Proxy;
use super::send::Patience;
use super::{ARCHIVE, Server, local, tree};
use crate::bucket::Bucket;
use fastrand::Rng;
use kilwa_archive::Manifest;
use kilwa_archive::checksums::{Checksums, sha256};
use kilwa_server::{Catalogue, Limits, Page, Site, app, listen};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

/// In the short form, and in the long one.
const CUTS: [u32; 2] = [20, 40];

/// The object as the store shows it now; every file that its manifest names exists and is correct.
fn seen(bucket: &Bucket) -> BTreeMap<String, Vec<u8>> {
    let store = bucket.open_directly(ARCHIVE, Duration::from_secs(20)).unwrap();
    let site = Site::new(Catalogue::of_store(&store).unwrap(), Page::from_files(BTreeMap::new()));
    let threads = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().unwrap();
    let listener = threads.block_on(tokio::net::TcpListener::bind("127.0.0.1:0")).unwrap();
    let address = listener.local_addr().unwrap();
    let metrics = Arc::clone(&site.metrics);
    threads.spawn(listen(listener, app(site), metrics, Limits::default(), std::future::pending()));
    let config =
        ureq::Agent::config_builder().http_status_as_error(false).timeout_global(Some(Duration::from_secs(30)));
    let agent: ureq::Agent = config.build().into();
    let get = |name: &str| {
        let mut answer = agent.get(format!("http://{address}/fort/{name}")).call().unwrap();
        (answer.status().as_u16(), answer.body_mut().read_to_vec().unwrap())
    };
    let mut all = BTreeMap::new();
    let (status, manifest) = get("manifest.json");
    if status == 404 {
        return all;
    }
    for version in &Manifest::parse(&manifest).unwrap().versions {
        let (_, list) = get(&version.checksums.url);
        assert_eq!(sha256(&list), version.checksums.sha256);
        for (path, sum) in Checksums::parse(std::str::from_utf8(&list).unwrap()).unwrap().iter() {
            let name = format!("{}/{path}", version.folder);
            let (status, bytes) = get(&name);
            assert!(status == 200 && sha256(&bytes) == *sum, "{name}: {status}");
            all.insert(name, bytes);
        }
        all.insert(version.checksums.url.clone(), list);
    }
    all.insert("manifest.json".to_owned(), manifest);
    all.insert("index.html".to_owned(), get("index.html").1);
    all
}

fn versions(of: &BTreeMap<String, Vec<u8>>) -> usize {
    of.get("manifest.json").map_or(0, |bytes| Manifest::parse(bytes).unwrap().versions.len())
}

#[test]
fn a_publication_to_a_store_interrupted_at_random_shows_the_old_or_new_object_and_ends_with_the_bytes_of_a_local_one() {
    let Some(bucket) = Bucket::start("cut_off_at_random_the_store_has_the_old_object…") else { return };
    let site = local();
    let mut dice = Rng::with_seed(0x0dd0_5eed_1234_5679);
    let mut server = Server::over(bucket.options(ARCHIVE, Duration::from_secs(5)).endpoint);
    let (mut cuts, mut kinds) = (0, [0; 4]);
    let wanted = CUTS[usize::from(std::env::var_os("KILWA_SOAK").is_some())];
    for number in [1, 2] {
        let all: u64 = super::intent(&site, number).files.iter().map(|f| f.bytes).sum();
        for _ in 0..wanted / 2 {
            let before = versions(&seen(&bucket));
            let kind = dice.u64(..4) as usize;
            let bytes = if dice.u64(..3) == 0 { all * 2 } else { 1 + dice.u64(..all / 10) };
            let proxy = Proxy::before(server.address);
            let address = format!("http://{}", proxy.address);
            let (token, from) = (server.token.clone(), site.clone());
            match kind {
                0 => {
                    proxy.allow(bytes as i64);
                    drop(publish(&address, &token, number, &site, once()));
                }
                1 => killed_client(&address, &token, number, &site, Duration::from_millis(dice.u64(..200))),
                2 => {
                    let client = std::thread::spawn(move || publish(&address, &token, number, &from, once()));
                    // A random moment of the client's work.
                    std::thread::sleep(Duration::from_millis(dice.u64(..300)));
                    server.restart();
                    drop(client.join().unwrap());
                }
                _ => {
                    bucket.proxy.cut_after(dice.u64(..8000) as i64);
                    let client = std::thread::spawn(move || publish(&address, &token, number, &from, once()));
                    // As long as a random outage lasts.
                    std::thread::sleep(Duration::from_millis(100 + dice.u64(..300)));
                    bucket.proxy.down();
                    bucket.proxy.up();
                    drop(client.join().unwrap());
                }
            }
            cuts += 1;
            kinds[kind] += 1;
            let now = versions(&seen(&bucket));
            assert!(now == before || now == number as usize, "{before} versions became {now}");
        }
        // Without a cut it continues from where it is.
        let address = format!("http://{}", server.address);
        assert_eq!(publish(&address, &server.token, number, &site, Patience::default()), Ok(number));
        assert_eq!(portal(server.address), number as usize, "the portal shows it at once");
    }
    let [connection, client, killed, store] = kinds;
    println!(
        "{cuts} cuts: {connection} of the connection, {client} of the client, {killed} of the server, {store} of the connection to the store"
    );
    assert!(kinds.iter().all(|n| *n > 0));
    let (here, there) = (tree(&site.join("fort"), true), seen(&bucket));
    assert_eq!(here.keys().collect::<Vec<_>>(), there.keys().collect::<Vec<_>>());
    for (path, bytes) in &here {
        assert!(*bytes == there[path], "{path} differs from publishing here");
    }
    assert!(server.audit().matches("\"published\"").count() <= 2, "each version was published once");
    server.kill();
    let left = std::fs::read_dir(server.path("uploads")).unwrap().map(|e| e.unwrap().file_name());
    // `.kilwa-making` is an empty folder that serves as a lock.
    let left: Vec<_> = left.filter(|name| name != ".kilwa-uploads" && name != ".kilwa-making").collect();
    assert!(left.is_empty(), "what a kill left behind was taken away: {left:?}");
}
