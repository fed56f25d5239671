//! The tasks of a build exchange files through an object store as through a folder, even if the store fails in all the ways that a network can.

mod faulty;

use crate::support::{StopAt, fort, wall};
use crate::tasks::{Worker, expected, open_in, ready};
use faulty::Faulty;
use kilwa_builder::tasks::{ObjectFolder, Outcome, SharedBuild, SharedFolder, Store, Task};
use kilwa_builder::{BuildError, Silent, build::work::Stop};
use kilwa_store::{Client, Condition, Objects, RetryPolicy, Unfinished};
use object_store::path::Path;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::atomic::Ordering;
use std::sync::{Arc, LazyLock};
use std::time::Duration;

static THREADS: LazyLock<tokio::runtime::Runtime> =
    LazyLock::new(|| tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build().unwrap());

/// Enough for a store where three requests in ten fail: only one in 10^10 fails for good.
const PATIENCE: RetryPolicy = RetryPolicy {
    attempts: 20,
    first_pause: Duration::from_micros(50),
    longest_pause: Duration::from_millis(1),
    whole: Duration::from_secs(60),
};

fn objects(store: &Arc<Faulty>) -> Objects {
    let client = Arc::clone(store) as Arc<dyn Client>;
    let objects = Objects::of(client, "s3://museum", PATIENCE, THREADS.handle());
    objects.with_part(40_000).with_unfinished(Arc::clone(store) as Arc<dyn Unfinished>)
}

fn folder(store: &Arc<Faulty>) -> Box<dyn Store> {
    Box::new(ObjectFolder::new(objects(store), Path::from("work/kilwa-build-1")))
}

/// The location of a build: a folder, or a store where a percentage of requests fails.
enum Shared {
    Folder(tempfile::TempDir),
    Store(Arc<Faulty>),
}

impl Shared {
    fn all() -> [Self; 3] {
        let store = |percent| Self::Store(Arc::new(Faulty::new(percent, 5)));
        [Self::Folder(tempfile::tempdir().unwrap()), store(0), store(30)]
    }

    fn store(&self) -> Box<dyn Store> {
        match self {
            Self::Folder(at) => Box::new(SharedFolder::new(&at.path().join("kilwa-build-1"))),
            Self::Store(store) => folder(store),
        }
    }

    fn open(&self, size: u64) -> SharedBuild {
        open_in(self.store(), size)
    }

    fn left(&self) -> Vec<String> {
        match self {
            Self::Folder(at) => {
                let entries = std::fs::read_dir(at.path()).unwrap();
                entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect()
            }
            Self::Store(store) => store.left(),
        }
    }
}

#[test]
fn tasks_in_any_order_give_the_same_bytes_as_a_build_on_one_machine_and_leave_nothing() {
    let raw = fort(25_000);
    let expected = expected(&raw);
    for shared in Shared::all() {
        let mut random = fastrand::Rng::with_seed(3);
        loop {
            let mut tasks = ready(&shared.open(3_000));
            if tasks.is_empty() {
                break;
            }
            random.shuffle(&mut tasks);
            for task in tasks {
                let worker = Worker { raw: &raw, threads: random.usize(1..4), memory: 1 << random.usize(20..32) };
                worker.run(&shared.open(3_000), task.task, &Stop::default(), &Silent).unwrap();
            }
        }
        let build = shared.open(3_000);
        assert!(build.tasks().unwrap().iter().any(|t| matches!(t.task, Task::Level { shard: 1.., .. })));
        let worker = Worker { raw: &raw, threads: 2, memory: 1 << 28 };
        assert!(worker.assemble(build).unwrap() == expected);
        shared.store().remove_all().unwrap();
        assert_eq!(shared.left(), [""; 0]);
    }
}

#[test]
fn tasks_that_are_stopped_or_run_several_times_at_once_give_the_same_bytes() {
    let raw = wall(15_000);
    let expected = expected(&raw);
    for shared in Shared::all() {
        let (mut random, mut longest) = (fastrand::Rng::with_seed(7), 10);
        while let Some(task) = ready(&shared.open(4_000)).into_iter().next() {
            let stop = Stop::default();
            let at = StopAt::new(&stop, random.u64(1..longest));
            let worker = Worker { raw: &raw, threads: 1, memory: 1 << 26 };
            match worker.run(&shared.open(4_000), task.task, &stop, &at) {
                Ok(_) | Err(BuildError::Stopped) => longest += longest / 2,
                Err(e) => panic!("{}: {e}", task.id),
            }
            let done: Vec<Outcome> = std::thread::scope(|scope| {
                let one = || worker.run(&shared.open(4_000), task.task, &Stop::default(), &Silent).unwrap();
                let threads: Vec<_> = (0..3).map(|_| scope.spawn(one)).collect();
                threads.into_iter().map(|t| t.join().unwrap()).collect()
            });
            assert!(done.iter().all(|d| d.manifest == done[0].manifest), "{}", task.id);
        }
        let worker = Worker { raw: &raw, threads: 1, memory: 1 << 26 };
        assert!(worker.assemble(shared.open(4_000)).unwrap() == expected);
        shared.store().remove_all().unwrap();
        assert_eq!(shared.left(), [""; 0]);
    }
}

#[test]
fn every_reader_of_a_store_sees_what_was_written() {
    for shared in Shared::all() {
        let mut random = fastrand::Rng::with_seed(11);
        let (store, other) = (shared.store(), shared.store());
        let mut model: BTreeMap<String, Vec<u8>> = BTreeMap::new();
        // Names are never reused, so that readers may keep files open.
        let mut gone = BTreeSet::new();
        let local = tempfile::NamedTempFile::new().unwrap();
        for step in 0..300u32 {
            let reader = if random.bool() { &store } else { &other };
            let name = format!("done/task{}.json", random.u8(..30));
            match random.u8(..6) {
                0 if gone.contains(&name) => {}
                0 => {
                    let bytes = step.to_le_bytes().repeat(random.usize(1..50));
                    let created = store.create_new(&name, &bytes).unwrap();
                    let was_free = !model.contains_key(&name);
                    // If the response was lost, the object is our own.
                    assert!(was_free || !created);
                    if was_free {
                        assert_eq!(other.read_all(&name).unwrap().unwrap(), bytes);
                    }
                    model.entry(name).or_insert(bytes);
                }
                1 => {
                    store.remove(&name).unwrap();
                    model.remove(&name);
                    gone.insert(name);
                }
                2 => {
                    let name = format!("files/task.{step}");
                    let bytes = step.to_le_bytes().repeat(random.usize(..40_000));
                    std::fs::write(local.path(), &bytes).unwrap();
                    store.upload(&name, local.path()).unwrap();
                    model.insert(name, bytes);
                }
                3 => assert_eq!(reader.read_all(&name).unwrap().as_ref(), model.get(&name)),
                4 => {
                    let mut there = reader.list("done").unwrap();
                    there.sort();
                    let done: Vec<_> = model.keys().filter(|name| name.starts_with("done/")).cloned().collect();
                    assert_eq!(there, done);
                }
                _ => {
                    let files: Vec<_> = model.iter().filter(|(name, _)| name.starts_with("files/")).collect();
                    let Some((name, bytes)) = random.choice(&files) else { continue };
                    assert_eq!(reader.length(name).unwrap(), Some(bytes.len() as u64));
                    let (at, end) = (random.usize(..=bytes.len()), random.usize(..=bytes.len()));
                    let (at, end) = (at.min(end), at.max(end));
                    assert!(reader.read(name, at as u64, (end - at) as u64).unwrap() == bytes[at..end]);
                    let error = reader.read(name, at as u64, (bytes.len() - at) as u64 + 1).unwrap_err().to_string();
                    assert!(error.contains(&reader.display_path(name)), "{error}");
                }
            }
        }
        store.remove_all().unwrap();
        assert_eq!(shared.left(), [""; 0]);
    }
}

#[test]
fn manifests_of_a_level_are_read_in_one_batch_and_never_outdated() {
    let shared = Arc::new(Faulty::new(0, 1));
    let name = |shard: usize| format!("done/level-07-{shard:04}.json");
    let store = folder(&shared);
    for shard in 0..40 {
        assert!(store.create_new(&name(shard), &[shard as u8; 10]).unwrap());
    }
    let reader = folder(&shared);
    let before = shared.requests.load(Ordering::Relaxed);
    for shard in 0..41 {
        let expected = (shard < 40).then(|| vec![shard as u8; 10]);
        assert_eq!(reader.read_all(&name(shard)).unwrap(), expected, "{shard}");
    }
    // One, the list, forty in a batch, and the missing one.
    assert_eq!(shared.requests.load(Ordering::Relaxed) - before, 43);
    // What was read in a batch is used once, and not after a change.
    let reader = folder(&shared);
    reader.read_all(&name(0)).unwrap();
    reader.read_all(&name(1)).unwrap();
    reader.remove(&name(2)).unwrap();
    assert_eq!(reader.read_all(&name(2)).unwrap(), None);
    assert!(reader.create_new(&name(2), b"other").unwrap());
    assert_eq!(reader.read_all(&name(2)).unwrap().unwrap(), b"other");
    store.remove(&name(1)).unwrap();
    assert_eq!(reader.read_all(&name(1)).unwrap(), None);
}

#[test]
fn only_one_of_several_writers_creates_an_object() {
    let shared = Arc::new(Faulty::new(0, 1));
    for round in 0..20 {
        let name = format!("done/{round}.json");
        let made: Vec<bool> = std::thread::scope(|scope| {
            let one = |i: u8| folder(&shared).create_new(&name, &[i; 100]).unwrap();
            let threads: Vec<_> = (0..8).map(|i| scope.spawn(move || one(i))).collect();
            threads.into_iter().map(|t| t.join().unwrap()).collect()
        });
        assert_eq!(made.iter().filter(|made| **made).count(), 1);
        let winner = made.iter().position(|made| *made).unwrap() as u8;
        assert_eq!(folder(&shared).read_all(&name).unwrap().unwrap(), [winner; 100]);
    }
}

#[test]
fn the_error_for_an_unavailable_store_says_what_to_do_and_a_stop_ends_the_retries() {
    let shared = Arc::new(Faulty::new(0, 1));
    folder(&shared).create_new("plan.json", b"{}").unwrap();
    shared.go_away();
    let error = folder(&shared).read_all("plan.json").unwrap_err().to_string();
    for part in ["s3://museum/work/kilwa-build-1/plan.json", "503", "20 attempts", "AWS_ENDPOINT_URL"] {
        assert!(error.contains(part), "{error}");
    }
    let stop = Stop::default();
    stop.ask();
    let long = RetryPolicy { first_pause: Duration::from_secs(3600), ..PATIENCE };
    let objects = Objects::of(Arc::clone(&shared) as Arc<dyn Client>, "s3://museum", long, THREADS.handle());
    let stopped = ObjectFolder::new(objects.with_stop(move || stop.asked()), Path::from("work"));
    assert!(matches!(stopped.read_all("plan.json"), Err(BuildError::Stopped)));
}

#[test]
fn incomplete_uploads_are_aborted_with_the_build() {
    let shared = Arc::new(Faulty::new(30, 9));
    let store = folder(&shared);
    store.create_new("plan.json", b"{}").unwrap();
    // Left by a machine that lost power during an upload.
    for path in ["work/kilwa-build-1/files/a", "work/kilwa-build-10/files/b"] {
        let path = Path::from(path);
        while THREADS.block_on(object_store::multipart::MultipartStore::create_multipart(&*shared, &path)).is_err() {}
    }
    store.remove_all().unwrap();
    let left = shared.left();
    assert!(!left.is_empty() && left.iter().all(|l| l == "upload of work/kilwa-build-10/files/b"), "{left:?}");
}

#[test]
fn several_uploads_together_send_no_more_parts_at_once_than_one() {
    let shared = Arc::new(Faulty::new(0, 3));
    let (objects, local) = (objects(&shared), tempfile::NamedTempFile::new().unwrap());
    std::fs::write(local.path(), vec![7; 800_000]).unwrap();
    let upload = |i: u32| {
        let (to, notes) = (Path::from(format!("files/{i}")), BTreeMap::new());
        objects.upload(&to, local.path(), Condition::Replace, &notes, &mut |_, _| ()).unwrap();
    };
    upload(0);
    let alone = shared.most_sending.load(Ordering::Relaxed);
    assert!(alone > 1, "{alone}");
    std::thread::scope(|scope| {
        for i in 1..5 {
            let upload = &upload;
            scope.spawn(move || upload(i));
        }
    });
    let most = shared.most_sending.load(Ordering::Relaxed);
    assert!(most <= alone, "{most} at once, {alone} by one upload");
    assert_eq!(shared.left().len(), 5);
}
