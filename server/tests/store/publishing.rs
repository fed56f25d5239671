//! Versions sent to a store appear whole or not at all, also with concurrent publishers and interruptions anywhere.

use super::bucket::Bucket;
use super::{PATIENCE, SHORT};
use crate::common::{get, noise, object, page, public};
use kilwa_archive::checksums::sha256;
use kilwa_archive::layout::Slug;
use kilwa_archive::manifest::Manifest;
use kilwa_server::store::Sent;
use kilwa_server::{Catalogue, Site, app};
use std::path::Path;

/// What the store shows of the object: the number of its current version, whose every file is there and right.
async fn shown(bucket: &Bucket, packs: &[Vec<u8>]) -> Option<u32> {
    shown_at(bucket, "s3://museum/shelf", packs).await
}

async fn shown_at(bucket: &Bucket, name: &str, packs: &[Vec<u8>]) -> Option<u32> {
    let store = bucket.open(name, PATIENCE).unwrap();
    let app = app(Site::new(Catalogue::of_store(&store).unwrap(), page()));
    let answer = get(&app, "/fort/manifest.json").await;
    if answer.status == 404 {
        return None;
    }
    let manifest = Manifest::parse(&answer.body).unwrap();
    assert!(get(&app, "/fort/").await.text().contains("landing of fort"));
    for (version, pack) in manifest.versions.iter().zip(packs) {
        let list = get(&app, &format!("/fort/{}", version.checksums.url)).await.text();
        assert_eq!(list.lines().count(), 7);
        assert_eq!(sha256(list.as_bytes()), version.checksums.sha256);
        for line in list.lines() {
            let (sum, name) = line.split_once("  ").unwrap();
            let answer = get(&app, &format!("/fort/{}/{name}", version.folder)).await;
            assert_eq!(answer.status, 200, "{name}");
            assert_eq!(sha256(&answer.body), sum, "{name}");
            assert!(!name.starts_with("pack.") || answer.body == *pack, "{name}");
        }
    }
    Some(manifest.current)
}

fn send(bucket: &Bucket, shelf: &Path, version: u32) -> Result<Sent, String> {
    send_to(bucket, "s3://museum/shelf", shelf, version)
}

fn send_to(bucket: &Bucket, name: &str, shelf: &Path, version: u32) -> Result<Sent, String> {
    let slug = Slug::new("fort").unwrap();
    let fetched = tempfile::tempdir().unwrap();
    let store = bucket.open(name, SHORT).map_err(|e| e.to_string())?;
    let against = store.fetch(&slug, fetched.path()).map_err(|e| e.to_string())?;
    store.send(&slug, shelf, version, &against, &|_| ()).map_err(|e| e.to_string())
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_version_is_published_whole_and_only_on_the_manifest_it_was_made_for() {
    let Some(bucket) = Bucket::start("a_version_is_sent_whole_and_only_against…") else { return };
    // Long enough for parts.
    let packs = [noise(20_000_000, 1), noise(300_000, 2), noise(300_000, 3)];
    let shelves: Vec<_> = (1..=3)
        .map(|n| {
            let dir = tempfile::tempdir().unwrap();
            object(dir.path(), "fort", &packs[..n], public());
            dir
        })
        .collect();
    assert_eq!(shown(&bucket, &packs).await, None);
    assert_eq!(send(&bucket, shelves[0].path(), 1), Ok(Sent { files: 8, there: 0 }));
    assert_eq!(shown(&bucket, &packs).await, Some(1));
    let slug = Slug::new("fort").unwrap();
    let store = bucket.open("s3://museum/shelf", PATIENCE).unwrap();
    let fetched = tempfile::tempdir().unwrap();
    let before = store.fetch(&slug, fetched.path()).unwrap();
    for name in ["manifest.json", "index.html"] {
        let here = std::fs::read(fetched.path().join("fort").join(name)).unwrap();
        assert_eq!(here, std::fs::read(shelves[0].path().join("fort").join(name)).unwrap(), "{name}");
    }
    assert_eq!(send(&bucket, shelves[1].path(), 2), Ok(Sent { files: 8, there: 0 }));
    // Made against the first version, while there is a second by now.
    let late = store.send(&slug, shelves[1].path(), 2, &before, &|_| ()).unwrap_err().to_string();
    assert!(late.contains("somebody else"), "{late}");
    assert_eq!(shown(&bucket, &packs).await, Some(2));
    assert_eq!(send(&bucket, shelves[2].path(), 3), Ok(Sent { files: 8, there: 0 }));
    assert_eq!(shown(&bucket, &packs).await, Some(3));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_publication_interrupted_anywhere_shows_the_old_or_the_new_object_and_resumes() {
    let Some(bucket) = Bucket::start("cut_off_anywhere_it_shows_the_old_object…") else { return };
    let packs = [noise(100_000, 1), noise(100_000, 2)];
    let (first, second) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    object(first.path(), "fort", &packs[..1], public());
    object(second.path(), "fort", &packs, public());
    for (version, shelf) in [(1, first.path()), (2, second.path())] {
        // Answers are short: so many bytes of them are so many steps.
        let mut cut = 0;
        for i in 0..10 {
            bucket.proxy.cut_after(i * 700 * i64::from(version));
            let sent = send(&bucket, shelf, version);
            bucket.proxy.down();
            bucket.proxy.up();
            let now = shown(&bucket, &packs).await.unwrap_or(0);
            cut += u32::from(sent.is_err());
            assert!(now == version || (now == version - 1 && sent.is_err()), "cut {i}: {now}, {sent:?}");
            if now == version {
                break;
            }
        }
        assert!(cut > 1, "it was cut in the middle");
        if shown(&bucket, &packs).await.unwrap_or(0) < version {
            let sent = send(&bucket, shelf, version).unwrap();
            assert!(sent.there > 0, "version {version}: what was sent before is not sent again: {sent:?}");
        }
        assert_eq!(shown(&bucket, &packs).await, Some(version));
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn interrupted_between_landing_page_and_manifest_the_page_matches_the_manifest() {
    let Some(bucket) = Bucket::start("cut_off_between_landing_page_and_manifest…") else { return };
    let packs = [noise(1000, 1), noise(1000, 2)];
    let shelves = [1, 2].map(|version: usize| {
        let dir = tempfile::tempdir().unwrap();
        let mut manifest = object(dir.path(), "fort", &packs[..version], public());
        let page = format!("<!doctype html><html><head></head><body>landing of fort, version {version}</body></html>");
        (manifest.page.bytes, manifest.page.sha256) = (page.len() as u64, sha256(page.as_bytes()));
        std::fs::write(dir.path().join("fort/index.html"), page).unwrap();
        std::fs::write(dir.path().join("fort/manifest.json"), manifest.to_bytes().unwrap()).unwrap();
        dir
    });
    let served =
        || app(Site::new(Catalogue::of_store(&bucket.open("s3://museum/shelf", PATIENCE).unwrap()).unwrap(), page()));
    assert!(send(&bucket, shelves[0].path(), 1).is_ok());
    let running = served();
    assert!(get(&running, "/fort/").await.text().contains("version 1"));
    bucket.proxy.refuse("PUT /museum/shelf/fort/manifest.json");
    let sent = send(&bucket, shelves[1].path(), 2);
    assert!(sent.is_err(), "{sent:?}");
    bucket.proxy.allow();
    for app in [&running, &served()] {
        let manifest = Manifest::parse(&get(app, "/fort/manifest.json").await.body).unwrap();
        assert_eq!(manifest.current, 1);
        assert_eq!(sha256(&get(app, "/fort/index.html").await.body), manifest.page.sha256);
        let landing = get(app, "/fort/").await;
        assert!(landing.status == 200 && landing.text().contains("version 1"), "{}", landing.text());
    }
    assert!(send(&bucket, shelves[1].path(), 2).is_ok());
    assert!(get(&served(), "/fort/").await.text().contains("version 2"));
    assert_eq!(shown(&bucket, &packs).await, Some(2));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_version_published_meanwhile_by_another_is_left_unchanged() {
    let Some(bucket) = Bucket::start("what_somebody_else_published_meanwhile…") else { return };
    let first = noise(100_000, 1);
    // Before anything of ours is sent, and when some of it is.
    for at in [0, 4] {
        let (ours, theirs) = ([first.clone(), noise(100_000, 2)], [first.clone(), noise(100_000, 4)]);
        let shelves = [&ours[..1], &ours[..], &theirs[..]].map(|packs| {
            let dir = tempfile::tempdir().unwrap();
            object(dir.path(), "fort", packs, public());
            dir
        });
        let name = format!("s3://museum/shelf{at}");
        assert!(send_to(&bucket, &name, shelves[0].path(), 1).is_ok());
        let (slug, fetched) = (Slug::new("fort").unwrap(), tempfile::tempdir().unwrap());
        let store = bucket.open(&name, PATIENCE).unwrap();
        let against = store.fetch(&slug, fetched.path()).unwrap();
        let heard = std::cell::Cell::new(0);
        let publish = |i: usize| {
            if i == at {
                assert!(send_to(&bucket, &name, shelves[2].path(), 2).is_ok());
            }
        };
        if at == 0 {
            publish(0);
        }
        let report = |_: &str| {
            heard.set(heard.get() + 1);
            publish(heard.get());
        };
        let late = store.send(&slug, shelves[1].path(), 2, &against, &report).unwrap_err().to_string();
        assert!(late.contains("somebody else"), "{late}");
        assert!(heard.get() >= at);
        assert_eq!(shown_at(&bucket, &name, &theirs).await, Some(2));
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_file_sent_during_another_publication_does_not_overwrite_it() {
    let Some(bucket) = Bucket::start("a_file_that_is_under_way_while_somebody_else_publishes…") else { return };
    let first = noise(100_000, 1);
    let (ours, theirs) = ([first.clone(), noise(100_000, 2)], [first.clone(), noise(100_000, 4)]);
    let shelves = [&ours[..1], &ours[..], &theirs[..]].map(|packs| {
        let dir = tempfile::tempdir().unwrap();
        object(dir.path(), "fort", packs, public());
        dir
    });
    assert!(send(&bucket, shelves[0].path(), 1).is_ok());
    let (slug, fetched) = (Slug::new("fort").unwrap(), tempfile::tempdir().unwrap());
    let store = bucket.open("s3://museum/shelf", PATIENCE).unwrap();
    let against = store.fetch(&slug, fetched.path()).unwrap();
    // Our publication has compared everything and is sending; then theirs is published, whole.
    bucket.proxy.hold("PUT /museum/shelf/fort/v2/poster.jpg");
    let late = std::thread::scope(|scope| {
        let sending = scope.spawn(|| store.send(&slug, shelves[1].path(), 2, &against, &|_| ()));
        bucket.proxy.wait_until_held();
        let direct = bucket.open_directly("s3://museum/shelf", PATIENCE).unwrap();
        let folder = tempfile::tempdir().unwrap();
        let before = direct.fetch(&slug, folder.path()).unwrap();
        assert!(direct.send(&slug, shelves[2].path(), 2, &before, &|_| ()).is_ok());
        bucket.proxy.allow();
        sending.join().unwrap().unwrap_err().to_string()
    });
    assert!(late.contains("somebody else"), "{late}");
    assert_eq!(shown(&bucket, &theirs).await, Some(2));
}
