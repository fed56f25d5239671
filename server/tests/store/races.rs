//! Concurrent publishing to one store, or to one folder through a server and directly: a version reported as published is there, complete; the others are report why not.

use super::bucket::Bucket;
use super::uploads::{Museum, tree, version};
use super::{PATIENCE, noise, object};
use crate::common::{page, public};
use kilwa_archive::checksums::{Checksums, sha256};
use kilwa_archive::draft::{Draft, DraftError};
use kilwa_archive::keep::Folders;
use kilwa_archive::layout::Slug;
use kilwa_archive::lock::Lock;
use kilwa_archive::next::settle;
use kilwa_archive::withdraw::{Withdrawal, withdraw};
use kilwa_archive::{AccessState, Manifest};
use kilwa_server::store::{S3, S3Options};
use kilwa_server::upload::wire::State;
use kilwa_server::{Catalogue, Site, app};
use std::path::Path;
use std::sync::mpsc::channel;
use std::time::Duration;

/// A version stays claimed for this long, unless a test says otherwise.
const LEASE: Duration = Duration::from_secs(3600);

fn options(bucket: &Bucket, part: &str, lease: Duration) -> S3Options {
    S3Options { lease, ..bucket.options(&format!("s3://museum/{part}"), PATIENCE) }
}

/// Send a version that lies in a folder, as `kilwa publish --to s3://…` does.
fn send(options: &S3Options, shelf: &Path, version: u32, report: &dyn Fn(&str)) -> Result<(), String> {
    let (slug, fetched) = (Slug::new("fort").unwrap(), tempfile::tempdir().unwrap());
    let store = S3::open(options).map_err(|e| e.to_string())?;
    let against = store.fetch(&slug, fetched.path()).map_err(|e| e.to_string())?;
    store.send(&slug, shelf, version, &against, report).map(drop).map_err(|e| e.to_string())
}

/// What the store has: every file of every version is the one that its list names.
async fn shown(options: &S3Options) -> Manifest {
    let app = app(Site::new(Catalogue::of_store(&S3::open(options).unwrap()).unwrap(), page()));
    Manifest::parse(&tree(&app).await.unwrap()["manifest.json"]).unwrap()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn concurrent_versions_are_never_mixed() {
    let Some(bucket) = Bucket::start("a_version_that_somebody_publishes_is_not_mixed…") else { return };
    let options = options(&bucket, "mixed", LEASE);
    let first = noise(10_000, 1);
    let shelves = [&[first.clone()][..], &[first.clone(), noise(10_000, 2)], &[first.clone(), noise(10_000, 4)]];
    let shelves = shelves.map(|packs| {
        let dir = tempfile::tempdir().unwrap();
        object(dir.path(), "fort", packs, public());
        dir
    });
    send(&options, shelves[0].path(), 1, &|_| ()).unwrap();
    // Ours has sent and compared everything but page and manifest; theirs begins then, and writes some of its files before ours continues.
    let ((compared, on), (begun, wrote)) = (channel::<()>(), channel::<()>());
    let (go, goes) = channel::<()>();
    let (ours, theirs) = std::thread::scope(|scope| {
        let (options, shelves) = (&options, &shelves);
        let ours = scope.spawn(move || {
            send(options, shelves[1].path(), 2, &|key| {
                if key.ends_with("index.html") {
                    compared.send(()).unwrap();
                    wrote.recv().unwrap();
                }
            })
        });
        on.recv().unwrap();
        let theirs = scope.spawn(move || {
            let has_raced = std::cell::Cell::new(false);
            let sent = send(options, shelves[2].path(), 2, &|key| {
                if key.contains("/v2/pack.") && !has_raced.replace(true) {
                    begun.send(()).unwrap();
                    goes.recv().unwrap();
                }
            });
            if !has_raced.get() {
                begun.send(()).unwrap();
            }
            sent
        });
        let ours = ours.join().unwrap();
        // Nobody receives it if the other publication did not get this far.
        let _ = go.send(());
        (ours, theirs.join().unwrap())
    });
    assert_eq!(ours, Ok(()));
    let manifest = shown(&options).await;
    let published = std::fs::read(shelves[1].path().join("fort/manifest.json")).unwrap();
    assert_eq!(manifest, Manifest::parse(&published).unwrap());
    let why = theirs.unwrap_err();
    assert!(why.contains("somebody else is publishing version 2") && why.contains("60 minutes"), "{why}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_command_started_twice_publishes_one_version_and_no_mixture() {
    let Some(bucket) = Bucket::start("a_command_started_again…") else { return };
    let options = options(&bucket, "twice", LEASE);
    // The same pack with the same metadata, with two different posters.
    let shelves = [&b"drawn first"[..], b"drawn again"].map(|poster| {
        let dir = tempfile::tempdir().unwrap();
        let mut manifest = object(dir.path(), "fort", &[noise(10_000, 1)], public());
        let fort = dir.path().join("fort");
        std::fs::write(fort.join("v1/poster.jpg"), poster).unwrap();
        let path = fort.join("v1/checksums.sha256");
        let mut list = Checksums::parse(&std::fs::read_to_string(&path).unwrap()).unwrap();
        list.add("poster.jpg", sha256(poster));
        std::fs::write(&path, list.to_text()).unwrap();
        let entry = &mut manifest.versions[0].checksums;
        (entry.bytes, entry.sha256) = (list.to_text().len() as u64, sha256(list.to_text().as_bytes()));
        std::fs::write(fort.join("manifest.json"), manifest.to_bytes().unwrap()).unwrap();
        dir
    });
    let ((waits, waiting), (go, goes)) = (channel::<()>(), channel::<()>());
    let (first, second) = std::thread::scope(|scope| {
        let (options, shelves) = (&options, &shelves);
        let first = scope.spawn(move || {
            send(options, shelves[0].path(), 1, &|key| {
                if key.ends_with("/poster.jpg") {
                    waits.send(()).unwrap();
                    goes.recv().unwrap();
                }
            })
        });
        waiting.recv().unwrap();
        // The second command has sent and compared everything when the first one continues.
        let first = std::cell::RefCell::new(Some(first));
        let ended = std::cell::RefCell::new(None);
        let second = send(options, shelves[1].path(), 1, &|key| {
            if key.ends_with("index.html")
                && let Some(first) = first.take()
            {
                go.send(()).unwrap();
                ended.replace(Some(first.join().unwrap()));
            }
        });
        (ended.take().unwrap(), second)
    });
    assert_eq!(second, Ok(()));
    let why = first.unwrap_err();
    assert!(why.contains("somebody else has published this object meanwhile"), "{why}");
    let published = std::fs::read(shelves[1].path().join("fort/manifest.json")).unwrap();
    assert_eq!(shown(&options).await, Manifest::parse(&published).unwrap());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_abandoned_claim_goes_to_the_same_command_at_once_and_to_others_after_the_lease() {
    let Some(bucket) = Bucket::start("what_somebody_gave_up_is_taken_over…") else { return };
    let packs = [noise(10_000, 1), noise(10_000, 2)];
    let shelves = [0, 1].map(|i: usize| {
        let dir = tempfile::tempdir().unwrap();
        object(dir.path(), "fort", &packs[i..=i], public());
        dir
    });
    let claimed = options(&bucket, "left", LEASE);
    bucket.proxy.refuse("PUT /museum/left/fort/v1/poster.jpg");
    assert!(send(&claimed, shelves[0].path(), 1, &|_| ()).is_err());
    bucket.proxy.allow();
    let why = send(&claimed, shelves[1].path(), 1, &|_| ()).unwrap_err();
    assert!(why.contains("somebody else is publishing version 1"), "{why}");
    bucket.proxy.refuse("PUT /museum/left/fort/v1/poster.jpg");
    assert!(send(&claimed, shelves[0].path(), 1, &|_| ()).is_err());
    bucket.proxy.allow();
    // A lease of no time is over at once.
    send(&options(&bucket, "left", Duration::ZERO), shelves[1].path(), 1, &|_| ()).unwrap();
    let published = std::fs::read(shelves[1].path().join("fort/manifest.json")).unwrap();
    assert_eq!(shown(&claimed).await, Manifest::parse(&published).unwrap());
    let store = S3::open(&claimed).unwrap();
    let gone = store.fetch(&Slug::new("fort").unwrap(), tempfile::tempdir().unwrap().path());
    assert!(gone.is_ok());
}

/// Publish a further version to a folder, as `kilwa publish` does.
fn publish_beside(models: &Path, words: &str, pause: &dyn Fn(&str)) -> Result<(), String> {
    let steps = |what: &str| {
        pause(what);
        Ok(())
    };
    let locked = || Lock::wait(models, PATIENCE, &|| ());
    let slug = Slug::new("fort").unwrap();
    let work = || -> Result<Result<(), String>, DraftError> {
        let mut draft = Draft::begin(&locked()?, &slug, &steps)?;
        draft.write("a.txt", words.as_bytes())?;
        let lock = locked()?;
        let Some(before) = settle(&lock, &slug, &steps)? else { return Ok(Err("there is none".to_owned())) };
        if before.access.state == AccessState::Withdrawn {
            return Ok(Err("it was withdrawn".to_owned()));
        }
        let version = before.versions.len() as u32 + 1;
        draft.finish(&lock, version, b"landing of fort", |checksums, page| {
            let mut added = before.versions.last().unwrap().clone();
            (added.version, added.folder, added.checksums) = (version, format!("v{version}"), checksums);
            (added.note, added.annotations) = (words.to_owned(), None);
            added.pack.url = format!("v{version}/pack.{}.kilwa", added.pack.sha256);
            let mut m = before.clone();
            m.versions.push(added);
            (m.current, m.page) = (version, page);
            m
        })?;
        Ok(Ok(()))
    };
    work().map_err(|e| e.to_string())?
}

/// Pauses of any length up to so many microseconds.
fn pauses(seed: u64, max: u64) -> impl Fn(&str) + Send {
    let random = std::cell::RefCell::new(fastrand::Rng::with_seed(seed));
    move |_: &str| {
        // The test is about concurrent operations, so it waits for no state.
        std::thread::sleep(Duration::from_micros(random.borrow_mut().u64(..max)));
    }
}

/// An upload, a version that is published to the same folder, and a withdrawal.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_concurrent_upload_publication_and_withdrawal_lose_nothing() {
    let rounds = 200;
    let memory = Path::new("/dev/shm");
    let folder = || if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() }.unwrap();
    let archive = folder();
    let (models, keep) = (archive.path().join("models"), archive.path().join("keep"));
    std::fs::create_dir(&models).unwrap();
    let server = Museum::over_models(folder(), &models);
    let (mut done, mut refused, mut withdrawn) = (0, 0, 0);
    for round in 0..rounds {
        for folder in [models.join("fort"), keep.clone()] {
            drop(std::fs::remove_dir_all(folder));
        }
        server.send_all(&version(1, "With a tower.")).await;
        server.finish().await;
        assert_eq!(server.ended().await.1.state, State::Published);
        let mut uploaded = version(2, "With a cistern.");
        uploaded.intent.note = "uploaded".to_owned();
        server.send_all(&uploaded).await;
        let (at, pause) = (models.clone(), pauses(2 * round, 400));
        let beside = tokio::task::spawn_blocking(move || {
            pauses(round, 8000)("");
            publish_beside(&at, "beside", &pause)
        });
        let (at, to, pause) = (models.clone(), keep.clone(), pauses(2 * round + 1, 400));
        let taking = (round % 2 == 1).then(|| {
            tokio::task::spawn_blocking(move || {
                pauses(round + 1000, 40_000)("");
                let steps = |what: &str| {
                    pause(what);
                    Ok(())
                };
                let (slug, withdrawal) =
                    (Slug::new("fort").unwrap(), Withdrawal { reason: "asked to", day: "2026-11-21" });
                withdraw(&Folders::lock(&at, &to, &slug, &|_| (), &steps)?, &slug, &withdrawal, &steps)
            })
        });
        server.finish().await;
        let (_, status) = server.ended().await;
        let by_upload = if status.state == State::Published { Ok(()) } else { Err(status.error.unwrap_or_default()) };
        let ends = [("uploaded", by_upload), ("beside", beside.await.unwrap())];
        let is_withdrawn = match taking {
            Some(taking) => taking.await.unwrap().map_err(|e| panic!("round {round}: {e}")).is_ok(),
            None => false,
        };
        let m = Manifest::parse(&std::fs::read(models.join("fort/manifest.json")).unwrap()).unwrap();
        assert_eq!(m.access.state == AccessState::Withdrawn, is_withdrawn, "round {round}: {ends:?}");
        withdrawn += u32::from(is_withdrawn);
        for (note, end) in ends {
            assert_eq!(m.versions.iter().any(|v| v.note == note), end.is_ok(), "round {round}: {note}: {end:?}");
            match end {
                Ok(()) => done += 1,
                Err(why) => {
                    assert!(why.contains("withdrawn") || why.contains("is at version 2"), "round {round}: {why}");
                    refused += 1;
                }
            }
        }
        for v in &m.versions {
            let list = std::fs::read(models.join("fort").join(&v.checksums.url)).unwrap();
            for (path, sum) in Checksums::parse(std::str::from_utf8(&list).unwrap()).unwrap().iter() {
                let here = std::fs::read(models.join("fort").join(&v.folder).join(path));
                let bytes = here.or_else(|_| std::fs::read(keep.join("fort").join(&v.folder).join(path))).unwrap();
                assert_eq!(sha256(&bytes), sum, "round {round}: {path}");
            }
        }
    }
    println!("{rounds} rounds: {done} published, {refused} refused, {withdrawn} withdrawn, 0 lost");
    assert!(done > 100 && refused > 10 && withdrawn == 100);
}

/// Two programs that send what they made, and a server that takes an upload, at once and with pauses of any length between their steps.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn three_concurrent_publishers_lose_nothing() {
    let Some(bucket) = Bucket::start("three_concurrent_publishers_lose_nothing") else { return };
    let rounds = if std::env::var_os("KILWA_SOAK").is_some() { 200 } else { 8 };
    // The same object with two further versions, made in folders.
    let mut made = Vec::new();
    for further in [None, Some("With a gate."), Some("With a well.")] {
        let folder = Museum::over_folder();
        for (number, words) in (1..).zip([Some("With a tower."), further].into_iter().flatten()) {
            folder.send_all(&version(number, words)).await;
            folder.finish().await;
            assert_eq!(folder.ended().await.1.state, State::Published);
        }
        made.push(folder);
    }
    let shelves: Vec<_> = made.iter().map(|m| m.folder.path().join("models")).collect();
    let (mut done, mut refused) = (0, 0);
    for round in 0..rounds {
        let options = options(&bucket, &format!("round{round}"), LEASE);
        send(&options, &shelves[0], 1, &|_| ()).unwrap();
        let server = Museum::over_part(options.clone());
        server.send_all(&version(2, "With a cistern.")).await;
        let sending: Vec<_> = shelves[1..]
            .iter()
            .zip(1..)
            .map(|(shelf, seed)| {
                let (options, shelf) = (options.clone(), shelf.clone());
                tokio::task::spawn_blocking(move || {
                    let pause = pauses(seed * 7919 + round, 9000);
                    pause("");
                    let words = if seed == 1 { "With a gate." } else { "With a well." };
                    (words, send(&options, &shelf, 2, &pause))
                })
            })
            .collect();
        server.finish().await;
        let (_, status) = server.ended().await;
        let uploaded = if status.state == State::Published { Ok(()) } else { Err(status.error.unwrap_or_default()) };
        let mut ends = vec![("With a cistern.", uploaded)];
        for one in sending {
            ends.push(one.await.unwrap());
        }
        let manifest = shown(&options).await;
        let published: Vec<_> = ends.iter().filter(|(_, end)| end.is_ok()).collect();
        assert!(published.len() <= 1, "round {round}: {ends:?}");
        if let Some((words, _)) = published.first() {
            assert_eq!((manifest.versions.len(), manifest.description.as_deref()), (2, Some(*words)), "round {round}");
            done += 1;
        } else {
            assert_eq!(manifest.versions.len(), 1, "round {round}");
        }
        for why in ends.iter().filter_map(|(_, end)| end.as_ref().err()) {
            assert!(why.contains("somebody else") || why.contains("at version 2"), "round {round}: {why}");
            refused += 1;
        }
    }
    println!("{rounds} rounds: {done} published, {refused} refused, 0 lost");
    assert!(done > rounds / 2, "{done} of {rounds}");
}
