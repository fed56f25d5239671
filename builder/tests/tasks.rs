//! A build that is divided into tasks gives the bytes of a build on one machine, whichever worker runs a task, in any
//! order, and even if tasks run twice or are killed.

use crate::support::{StopAt, fort, non_manifold, wall, with_holes};
use kilwa_builder::build::journal::PlannedInput;
use kilwa_builder::build::work::{Stop, Work};
use kilwa_builder::ingest::Spool;
use kilwa_builder::scratch::Scratch;
use kilwa_builder::tasks::{self, Outcome, SharedBuild, SharedFolder, SharedPlan, Store, Task, TaskEntry};
use kilwa_builder::{BuildError, BuildOptions, Inputs, Progress, Provenance, Silent, build_pack};
use kilwa_formats::RawMesh;
use kilwa_pack::verify::{self, Totals};
use kilwa_pack::{Reader, SliceSource};
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

pub(crate) struct Delivered(RawMesh);

impl Inputs for Delivered {
    fn plan(&self) -> Result<Vec<PlannedInput>, BuildError> {
        Ok(Vec::new())
    }

    fn deliver(&mut self, spool: &mut Spool, _work: &Work<'_>) -> Result<Provenance, BuildError> {
        spool.add(&self.0)?;
        Ok(Provenance::default())
    }
}

pub(crate) fn options() -> BuildOptions {
    BuildOptions { title: "test".into(), leaf_triangles: 300, ..BuildOptions::default() }
}

pub(crate) fn expected(raw: &RawMesh) -> Vec<u8> {
    build_pack(raw.clone(), &options(), &Silent).unwrap().bytes
}

fn open(folder: &Path, task_triangles: u64) -> SharedBuild {
    open_in(Box::new(SharedFolder::new(folder)), task_triangles)
}

pub(crate) fn open_in(store: Box<dyn Store>, task_triangles: u64) -> SharedBuild {
    let plan = kilwa_builder::build::plan(&Delivered(RawMesh::default()), &options()).unwrap();
    let plan = SharedPlan {
        plan,
        reading: String::new(),
        task_triangles,
        arguments: Vec::new(),
        working_folder: String::new(),
    };
    SharedBuild::begin(store, plan).unwrap()
}

/// One worker with a task.
pub(crate) struct Worker<'a> {
    pub(crate) raw: &'a RawMesh,
    pub(crate) threads: usize,
    pub(crate) memory: u64,
}

impl Worker<'_> {
    fn with<T>(&self, stop: &Stop, progress: &dyn Progress, f: impl FnOnce(&Work<'_>) -> T) -> T {
        let scratch = Scratch::temporary().unwrap();
        f(&Work { scratch: &scratch, memory: self.memory, threads: self.threads, stop, progress })
    }

    pub(crate) fn run(
        &self,
        build: &SharedBuild,
        task: Task,
        stop: &Stop,
        progress: &dyn Progress,
    ) -> Result<Outcome, BuildError> {
        let mut prepare = || -> Result<(Box<dyn Inputs>, BuildOptions), BuildError> {
            Ok((Box::new(Delivered(self.raw.clone())), options()))
        };
        self.with(stop, progress, |work| tasks::run(build, task, work, &mut prepare))
    }

    pub(crate) fn assemble(&self, build: SharedBuild) -> Result<Vec<u8>, BuildError> {
        let mut out = Vec::new();
        let (_, totals) = self.with(&Stop::default(), &Silent, |work| tasks::assemble(build, work, &mut out))?;
        assert_eq!(totals, totals_of(&out), "the counts of the tasks differ from those of the pack");
        Ok(out)
    }
}

/// The counts of a pack, found by decoding every chunk.
fn totals_of(pack: &[u8]) -> Totals {
    let reader = Reader::open(SliceSource(pack)).unwrap();
    let of_chunk = |i| verify::chunk(i, &reader.chunk(i).unwrap(), reader.entries()).unwrap();
    (0..reader.header().entry_count).map(of_chunk).fold(Totals::default(), Totals::plus)
}

/// The tasks of the first wave that is not done.
pub(crate) fn ready(build: &SharedBuild) -> Vec<TaskEntry> {
    let mut open: Vec<TaskEntry> = build.tasks().unwrap().into_iter().filter(|t| !t.done).collect();
    let wave = open.iter().map(|t| t.wave).min();
    open.retain(|t| Some(t.wave) == wave);
    open
}

fn run_all(folder: &Path, size: u64, raw: &RawMesh, random: &mut fastrand::Rng) -> usize {
    let mut count = 0;
    loop {
        let build = open(folder, size);
        let mut tasks = ready(&build);
        if tasks.is_empty() {
            return count;
        }
        random.shuffle(&mut tasks);
        for task in tasks {
            let worker = Worker { raw, threads: random.usize(1..4), memory: 1 << random.usize(20..32) };
            // Each worker opens the build for itself.
            let done = worker.run(&open(folder, size), task.task, &Stop::default(), &Silent).unwrap();
            assert!(!done.already_done);
            count += 1;
        }
    }
}

fn shared_files(folder: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(folder.join("files")).unwrap();
    entries.map(|e| format!("files/{}", e.unwrap().file_name().to_string_lossy())).collect()
}

/// The files that manifests name.
fn named_files(build: &SharedBuild) -> BTreeSet<String> {
    let tasks = build.tasks().unwrap();
    let manifests = tasks.iter().filter(|t| t.done).map(|t| build.finished(t.task).unwrap());
    manifests.flat_map(|m| m.files.into_values().map(|f| f.name)).collect()
}

#[test]
fn tasks_of_any_size_in_any_order_give_the_bytes_of_a_build_on_one_machine() {
    let mut random = fastrand::Rng::with_seed(2);
    let mut levels_divided = 0;
    for (name, raw, few) in [
        ("fort", fort(25_000), 2_000),
        ("wall", wall(15_000), 4_000),
        ("holes", with_holes(15_000), 1_000),
        ("non-manifold", non_manifold(40), 2_000),
        ("small", wall(2_000), 1),
    ] {
        let expected = expected(&raw);
        for size in [few, 1 << 40] {
            let folder = tempfile::tempdir().unwrap();
            let count = run_all(folder.path(), size, &raw, &mut random);
            let build = open(folder.path(), size);
            let tasks = build.tasks().unwrap();
            assert_eq!(tasks.len(), count);
            levels_divided += usize::from(tasks.iter().any(|t| matches!(t.task, Task::Level { shard: 1.., .. })));
            assert_eq!(shared_files(folder.path()), named_files(&build));
            let bytes = Worker { raw: &raw, threads: 2, memory: 1 << 28 }.assemble(build).unwrap();
            assert!(bytes == expected, "{name}, tasks of {size} triangles: different bytes");
        }
    }
    assert!(levels_divided >= 4, "{levels_divided}");
}

#[test]
fn tasks_that_are_stopped_at_any_moment_and_repeated_give_the_same_bytes() {
    let raw = wall(20_000);
    let expected = expected(&raw);
    let folder = tempfile::tempdir().unwrap();
    let mut random = fastrand::Rng::with_seed(7);
    let (mut stopped, mut longest) = (0, 20);
    loop {
        let build = open(folder.path(), 3_000);
        let Some(task) = ready(&build).into_iter().next() else { break };
        let stop = Stop::default();
        let at = StopAt::new(&stop, random.u64(1..longest));
        let worker = Worker { raw: &raw, threads: 2, memory: 1 << 26 };
        match worker.run(&build, task.task, &stop, &at) {
            Ok(_) => longest = 20,
            Err(BuildError::Stopped) => {
                stopped += 1;
                longest += longest / 2;
            }
            Err(e) => panic!("{}: {e}", task.id),
        }
    }
    assert!(stopped > 5, "{stopped}");
    let worker = Worker { raw: &raw, threads: 1, memory: 1 << 26 };
    assert!(worker.assemble(open(folder.path(), 3_000)).unwrap() == expected);
}

#[test]
fn only_one_of_several_workers_with_the_same_task_counts_and_the_others_leave_nothing() {
    let raw = wall(10_000);
    let folder = tempfile::tempdir().unwrap();
    while let Some(task) = ready(&open(folder.path(), 4_000)).into_iter().next() {
        let done: Vec<Outcome> = std::thread::scope(|scope| {
            let one = || {
                let worker = Worker { raw: &raw, threads: 1, memory: 1 << 26 };
                worker.run(&open(folder.path(), 4_000), task.task, &Stop::default(), &Silent).unwrap()
            };
            let threads: Vec<_> = (0..3).map(|_| scope.spawn(one)).collect();
            threads.into_iter().map(|t| t.join().unwrap()).collect()
        });
        assert_eq!(done.iter().filter(|d| !d.already_done).count(), 1, "{}", task.id);
        assert!(done.iter().all(|d| d.manifest == done[0].manifest), "{}", task.id);
        assert_eq!(shared_files(folder.path()), named_files(&open(folder.path(), 4_000)));
    }
}

#[test]
fn a_task_that_starts_too_early_names_the_task_that_must_run_first() {
    let raw = wall(20_000);
    let folder = tempfile::tempdir().unwrap();
    let worker = Worker { raw: &raw, threads: 1, memory: 1 << 26 };
    let error =
        |task| worker.run(&open(folder.path(), 3_000), task, &Stop::default(), &Silent).unwrap_err().to_string();
    assert!(error(Task::Tail).contains("ingest"), "{}", error(Task::Tail));
    worker.run(&open(folder.path(), 3_000), Task::Ingest, &Stop::default(), &Silent).unwrap();
    assert!(error(Task::Tree).contains("region-"), "{}", error(Task::Tree));
    assert!(error(Task::Tail).contains("tree"), "{}", error(Task::Tail));
    for wave in ["region", "tree"] {
        assert!(ready(&open(folder.path(), 3_000)).iter().all(|t| t.id.starts_with(wave)), "{wave}");
        for task in ready(&open(folder.path(), 3_000)) {
            worker.run(&open(folder.path(), 3_000), task.task, &Stop::default(), &Silent).unwrap();
        }
    }
    assert!(error(Task::Tail).contains("leaves-"), "{}", error(Task::Tail));
    let none = Task::Region { region: 1000 };
    assert!(error(none).contains("no region 1000"), "{}", error(none));
    let none = Task::Level { level: 200, shard: 0 };
    assert!(error(none).contains("no shard 0 of level 200"), "{}", error(none));
    let early = worker.assemble(open(folder.path(), 3_000)).unwrap_err().to_string();
    assert!(early.contains("leaves-"), "{early}");
}

/// Counts the bytes that are read from the file of the tree; one of the uploads may fail.
#[derive(Debug)]
struct Counting {
    folder: SharedFolder,
    read: Arc<AtomicU64>,
    /// The number of the upload that fails, counting from 0.
    failing: Option<u64>,
    uploads: AtomicU64,
}

impl Counting {
    fn new(folder: &Path, read: &Arc<AtomicU64>, failing: Option<u64>) -> Self {
        Self { folder: SharedFolder::new(folder), read: Arc::clone(read), failing, uploads: AtomicU64::new(0) }
    }
}

impl Store for Counting {
    fn display_path(&self, name: &str) -> String {
        self.folder.display_path(name)
    }

    fn length(&self, name: &str) -> Result<Option<u64>, BuildError> {
        self.folder.length(name)
    }

    fn read(&self, name: &str, at: u64, bytes: u64) -> Result<Vec<u8>, BuildError> {
        if Path::new(name).extension().is_some_and(|extension| extension == "tree") {
            self.read.fetch_add(bytes, Ordering::Relaxed);
        }
        self.folder.read(name, at, bytes)
    }

    fn upload(&self, name: &str, from: &Path) -> Result<(), BuildError> {
        if self.failing == Some(self.uploads.fetch_add(1, Ordering::Relaxed)) {
            return Err(BuildError::Shared {
                doing: "write",
                place: name.to_owned(),
                why: "the disk is on fire".into(),
            });
        }
        self.folder.upload(name, from)
    }

    fn create_new(&self, name: &str, bytes: &[u8]) -> Result<bool, BuildError> {
        self.folder.create_new(name, bytes)
    }

    fn remove(&self, name: &str) -> Result<(), BuildError> {
        self.folder.remove(name)
    }

    fn list(&self, prefix: &str) -> Result<Vec<String>, BuildError> {
        self.folder.list(prefix)
    }

    fn remove_all(&self) -> Result<(), BuildError> {
        self.folder.remove_all()
    }
}

#[test]
fn a_task_reads_only_its_part_of_the_tree() {
    let raw = wall(60_000);
    let folder = tempfile::tempdir().unwrap();
    let (mut most, mut sum, mut tetrahedra) = (0, 0, 0);
    loop {
        let Some(task) = ready(&open(folder.path(), 3_000)).into_iter().next() else { break };
        let read = Arc::new(AtomicU64::new(0));
        let store = Counting::new(folder.path(), &read, None);
        let build = open_in(Box::new(store), 3_000);
        let worker = Worker { raw: &raw, threads: 1, memory: 1 << 26 };
        let done = worker.run(&build, task.task, &Stop::default(), &Silent).unwrap();
        tetrahedra = done.manifest.files.get("levels").map_or(tetrahedra, |file| file.bytes);
        let read = read.load(Ordering::Relaxed);
        (most, sum) = (most.max(read), sum + read);
    }
    // A tetrahedron takes 73 bytes in the tree, and one byte in the file `levels`.
    let whole = 73 * tetrahedra;
    assert!(most > 0 && most * 3 < whole, "{most} of {whole} bytes");
    assert!(sum < 4 * whole, "{sum} of {whole} bytes by all tasks together");
}

#[test]
fn a_task_whose_upload_fails_leaves_nothing_and_can_be_repeated() {
    let raw = wall(8_000);
    let folder = tempfile::tempdir().unwrap();
    let worker = Worker { raw: &raw, threads: 1, memory: 1 << 26 };
    let entries = |name: &str| std::fs::read_dir(folder.path().join(name)).map_or(0, Iterator::count);
    let ingest = |failing| {
        let store = Counting::new(folder.path(), &Arc::default(), failing);
        worker.run(&open_in(Box::new(store), 1_500), Task::Ingest, &Stop::default(), &Silent)
    };
    for failing in 0..6 {
        let why = ingest(Some(failing)).unwrap_err().to_string();
        assert!(why.contains("the disk is on fire") && why.contains("files/ingest."), "{why}");
        assert_eq!([entries("files"), entries("done")], [0, 0]);
    }
    let done = ingest(None).unwrap();
    assert_eq!([entries("files"), entries("done")], [done.manifest.files.len(), 1]);
}

fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap().map(Result::unwrap) {
        let to = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy_folder(&entry.path(), &to);
        } else {
            std::fs::copy(entry.path(), to).unwrap();
        }
    }
}

#[test]
fn a_task_whose_file_is_lost_runs_again_and_a_damaged_file_is_named() {
    let raw = wall(8_000);
    let (folder, mut random) = (tempfile::tempdir().unwrap(), fastrand::Rng::with_seed(1));
    let worker = Worker { raw: &raw, threads: 1, memory: 1 << 26 };
    run_all(folder.path(), 1_500, &raw, &mut random);
    let tasks = || open(folder.path(), 1_500).tasks().unwrap().into_iter().map(|t| t.task);
    let level = tasks().find(|t| matches!(t, Task::Level { .. })).unwrap();
    let chunks = |task| open(folder.path(), 1_500).finished(task).unwrap().files["chunks"].name.clone();

    std::fs::remove_file(folder.path().join(chunks(level))).unwrap();
    let why = worker.assemble(open(folder.path(), 1_500)).unwrap_err().to_string();
    assert!(why.contains(&level.id()) && why.contains("is missing"), "{why}");
    assert_eq!(ready(&open(folder.path(), 1_500))[0].task, level);
    worker.run(&open(folder.path(), 1_500), level, &Stop::default(), &Silent).unwrap();

    // Flip one bit in each file of one task of each kind: later tasks, or the assembly, refuse the file by name.
    let files_of = |task| open(folder.path(), 1_500).finished(task).unwrap().files;
    let damaged = [Task::Ingest, Task::Region { region: 1 }, Task::Tree, Task::Leaves { shard: 1 }, level];
    let mut files: Vec<(Task, String, String)> = Vec::new();
    for task in damaged {
        // Of the files of regions, only those of one region.
        let files_of =
            files_of(task).into_iter().filter(|(content, _)| !content.contains("-0") || content.ends_with("-0001"));
        files.extend(files_of.map(|(content, file)| (task, content, file.name)));
    }
    assert!(files.len() > 15, "{files:?}");
    let later: Vec<Task> = tasks().collect();
    let mut bits = fastrand::Rng::with_seed(4);
    for (of, content, name) in files {
        let copy = tempfile::tempdir().unwrap();
        copy_folder(folder.path(), copy.path());
        let path = copy.path().join(&name);
        let mut bytes = std::fs::read(&path).unwrap();
        let at = bits.usize(..bytes.len());
        bytes[at] ^= 1 << bits.u8(..8);
        std::fs::write(&path, bytes).unwrap();
        let attempt = || -> Result<Vec<u8>, BuildError> {
            for task in later.iter().skip_while(|t| **t != of).skip(1) {
                std::fs::remove_file(copy.path().join(format!("done/{}.json", task.id()))).unwrap();
                worker.run(&open(copy.path(), 1_500), *task, &Stop::default(), &Silent)?;
            }
            worker.assemble(open(copy.path(), 1_500))
        };
        let error = attempt().map(|_| "no error").unwrap_err().to_string();
        assert!(error.contains(&name), "{content}, byte {at}: {error}");
    }
    run_all(folder.path(), 1_500, &raw, &mut random);
    assert!(worker.assemble(open(folder.path(), 1_500)).unwrap() == expected(&raw));
}
