//! The bytes do not depend on the memory or on what is kept on disk, nor on being stopped at any moment and resumed with
//! other threads and other memory.

use crate::support::{StopAt, fort, non_manifold, wall};
use kilwa_builder::build::journal::PlannedInput;
use kilwa_builder::build::work::{Stop, Work};
use kilwa_builder::ingest::Spool;
use kilwa_builder::scratch::Scratch;
use kilwa_builder::{BuildError, BuildOptions, BuildReport, Inputs, Progress, Provenance, Run, Silent, build};
use kilwa_formats::RawMesh;
use std::io::Cursor;
use std::path::Path;

struct Delivered<'a>(&'a RawMesh);

impl Inputs for Delivered<'_> {
    fn plan(&self) -> Result<Vec<PlannedInput>, BuildError> {
        Ok(Vec::new())
    }

    fn deliver(&mut self, spool: &mut Spool, _work: &Work<'_>) -> Result<Provenance, BuildError> {
        spool.add(self.0)?;
        Ok(Provenance::default())
    }
}

struct Settings<'a> {
    threads: usize,
    memory: u64,
    scratch: &'a Scratch,
    resume: bool,
}

fn built(
    raw: &RawMesh,
    s: &Settings<'_>,
    stop: &Stop,
    progress: &dyn Progress,
) -> Result<(Vec<u8>, BuildReport), BuildError> {
    let options = BuildOptions { threads: s.threads, title: "test".into(), leaf_triangles: 500, ..Default::default() };
    let run = Run { scratch: s.scratch, memory: s.memory, resume: s.resume, stop, progress };
    let mut out = Cursor::new(Vec::new());
    let report = build(&mut Delivered(raw), &options, &run, &mut out)?;
    Ok((out.into_inner(), report))
}

fn undisturbed(raw: &RawMesh, threads: usize, memory: u64) -> Vec<u8> {
    let scratch = Scratch::temporary().unwrap();
    let settings = Settings { threads, memory, scratch: &scratch, resume: false };
    built(raw, &settings, &Stop::default(), &Silent).unwrap().0
}

#[test]
fn one_mebibyte_of_memory_gives_the_same_bytes_as_plenty() {
    for (name, raw) in [("fort", fort(100_000)), ("non-manifold", non_manifold(60))] {
        let plenty = undisturbed(&raw, 2, 1 << 32);
        for threads in [1, 8] {
            assert!(undisturbed(&raw, threads, 1 << 20) == plenty, "{name}, {threads} threads");
        }
    }
}

#[test]
fn a_build_stopped_at_any_moment_resumes_to_the_same_bytes() {
    let raw = wall(10_000);
    let expected = undisturbed(&raw, 1, 1 << 32);
    let mut random = fastrand::Rng::with_seed(5);
    let mut resumed = 0;
    for round in 0..20 {
        let scratch = Scratch::temporary().unwrap();
        let (mut resume, mut longest) = (false, 100);
        let bytes = loop {
            let stop = Stop::default();
            let at = StopAt::new(&stop, 1 + random.usize(..longest) as u64);
            // A stage that is restarted again and again must finish in the end.
            longest *= 2;
            let (threads, memory) = (1 + random.usize(..3), 1 << (24 + random.usize(..8)));
            match built(&raw, &Settings { threads, memory, scratch: &scratch, resume }, &stop, &at) {
                Ok((bytes, report)) => {
                    resumed += u32::from(report.resumed_after.is_some());
                    break bytes;
                }
                Err(BuildError::Stopped) => resume = true,
                Err(e) => panic!("round {round}: {e}"),
            }
        };
        assert!(bytes == expected, "round {round}");
    }
    println!("{resumed} of 20 builds were finished by going on");
    assert!(resumed > 5);
}

#[test]
fn a_full_output_disk_is_an_error_that_leaves_no_wrong_file_and_scratch_files_are_counted() {
    struct Full(u64);
    impl std::io::Write for Full {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            self.0 = self.0.checked_sub(bytes.len() as u64).ok_or(std::io::ErrorKind::StorageFull)?;
            Ok(bytes.len())
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    impl std::io::Seek for Full {
        fn seek(&mut self, _to: std::io::SeekFrom) -> std::io::Result<u64> {
            Ok(0)
        }
    }
    let raw = wall(20_000);
    let scratch = Scratch::temporary().unwrap();
    let stop = Stop::default();
    let run = Run { scratch: &scratch, memory: 1 << 28, resume: false, stop: &stop, progress: &Silent };
    let error = build(&mut Delivered(&raw), &BuildOptions::default(), &run, &mut Full(50_000)).unwrap_err();
    let BuildError::Pack(kilwa_pack::PackError::Io { source, .. }) = error else { panic!("{error}") };
    assert_eq!(source.kind(), std::io::ErrorKind::StorageFull);
    let counted: u64 = scratch.files().unwrap().iter().map(|f| f.1).sum();
    assert_eq!(scratch.bytes(), counted);
    assert!(scratch.peak_bytes() > counted && scratch.peak_bytes() < 160 * raw.triangles.len() as u64);
    assert!(Path::new(scratch.folder()).join("journal").exists());
}

/// So little memory that several regions are needed.
fn settings(scratch: &Scratch, resume: bool) -> Settings<'_> {
    Settings { threads: 1, memory: 1 << 19, scratch, resume }
}

/// Asks the build to stop in the middle of a stage.
struct StopIn<'a> {
    stop: &'a Stop,
    stage: &'static str,
}

impl Progress for StopIn<'_> {
    fn update(&self, stage: &'static str, _done: u64, _total: u64) {
        if stage == self.stage {
            self.stop.ask();
        }
    }
}

/// Ways to damage a file.
const DAMAGE: [&str; 4] = ["changed", "moved", "cut", "removed"];

fn is_json(path: &Path) -> bool {
    path.extension().is_some_and(|e| e == "json")
}

/// Damages a file: changes a digit of text or two bits of a number, moves bytes to another place in the file, cuts off
/// the end, or removes it.
fn damage(path: &Path, how: &str) {
    let bytes = std::fs::read(path).unwrap();
    let (mut damaged, middle) = (bytes.clone(), bytes.len() / 2);
    match how {
        "changed" if is_json(path) => {
            let at = middle + bytes[middle..].iter().position(u8::is_ascii_digit).unwrap();
            damaged[at] ^= 1;
        }
        "changed" => damaged[middle] ^= 5,
        "moved" => damaged.rotate_left(middle / 4 * 4),
        "cut" => damaged.truncate(bytes.len() - 1),
        _ => return std::fs::remove_file(path).unwrap(),
    }
    assert!(damaged != bytes);
    std::fs::write(path, damaged).unwrap();
}

#[test]
fn a_damaged_scratch_file_is_detected_before_use_and_made_again() {
    let raw = wall(4000);
    let expected = undisturbed(&raw, 1, 1 << 32);
    let stages: [(&str, &[&str]); 4] = [
        ("finding corners", &["positions", "colors", "triangles", "spool.json"]),
        ("sorting into regions", &["corners", "resolve.json"]),
        ("joining triangles", &["buckets", "halo", "scatter.json"]),
        ("filling leaves", &["welded", "replies", "topology.json"]),
    ];
    for (stage, files) in stages {
        let folder = tempfile::tempdir().unwrap();
        let (stopped, again) = (folder.path().join("stopped"), folder.path().join("again"));
        let (scratch, stop) = (Scratch::open(&stopped).unwrap(), Stop::default());
        let result = built(&raw, &settings(&scratch, false), &stop, &StopIn { stop: &stop, stage });
        assert!(matches!(result, Err(BuildError::Stopped)), "{stage}");
        drop(scratch);
        for (file, how) in files.iter().flat_map(|file| DAMAGE.map(|how| (file, how))) {
            if is_json(Path::new(file)) && how == "removed" {
                continue;
            }
            std::fs::create_dir(&again).unwrap();
            for entry in std::fs::read_dir(&stopped).unwrap() {
                let entry = entry.unwrap();
                std::fs::copy(entry.path(), again.join(entry.file_name())).unwrap();
            }
            damage(&again.join(file), how);
            let scratch = Scratch::open(&again).unwrap();
            let (bytes, report) = built(&raw, &settings(&scratch, true), &Stop::default(), &Silent)
                .unwrap_or_else(|e| panic!("{stage}, {file}, {how}: {e}"));
            assert!(bytes == expected, "{stage}, {file}, {how}: other bytes");
            assert_eq!(report.redone, [file.to_string()], "{stage}, {how}");
            scratch.discard(|_| true).unwrap();
        }
    }
}
