//! Fuzzing without a nightly compiler: the bodies of `tests/fuzz` on mutated seeds, each reader for itself.
//!
//! By default every target runs a fixed number of inputs from a fixed seed: always the same ones. Environment variables
//! change this, as `cargo xtask test` does in its stage "fuzz":
//!
//! * `KILWA_FUZZ_SECONDS=30` runs for this time, `KILWA_FUZZ_SECONDS=10,ptx=30` the target `ptx` for another;
//! * `KILWA_FUZZ_SEED=2` uses other random numbers;
//! * `KILWA_FUZZ_INPUT=FILE` runs one input alone;
//! * `KILWA_FUZZ_CORPUS=DIR` writes the seeds to `DIR/TARGET` for cargo-fuzz and runs nothing.
//!
//! An input that makes a body panic, take more than [`SLOWEST`], or hold more than [`LARGEST`] is kept and its path printed,
//! as is one that ends the process.

#[path = "../fuzz/bodies.rs"]
mod bodies;
mod cuts;
mod damage;
mod mutate;
mod seeds;
#[path = "../support/zip.rs"]
#[allow(dead_code, reason = "other tests use the rest")]
mod zip;

use bodies::Body;
use mutate::{MAX_BYTES, Mutator};
use std::collections::HashSet;
use std::fs::File;
use std::panic::AssertUnwindSafe;
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Inputs of a run without a time limit.
const INPUTS: u64 = 4000;
/// The longest that one input may take.
const SLOWEST: Duration = Duration::from_secs(20);
/// The most memory that the process may have held after an input, bytes.
const LARGEST: u64 = 1 << 30;
/// The most inputs kept for further mutation.
const MAX_KEPT: usize = 4000;

fn variable(name: &str) -> Option<String> {
    std::env::var(name).ok().filter(|value| !value.is_empty())
}

/// The current input, in a file that outlives the process.
struct Current {
    file: File,
    path: PathBuf,
    begun: Mutex<Option<Instant>>,
}

impl Current {
    fn new(name: &str) -> Self {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("fuzz");
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join(format!("{name}-{}", std::process::id()));
        let file = File::create(&path).unwrap();
        Self { file, path, begun: Mutex::new(None) }
    }

    /// Run one input; what it was like.
    fn run(&self, body: Body, input: &[u8]) -> String {
        use std::io::{Seek, Write};
        let mut file = &self.file;
        file.rewind().and_then(|()| file.write_all(input)).unwrap();
        self.file.set_len(input.len() as u64).unwrap();
        let begun = Instant::now();
        *self.begun.lock().unwrap() = Some(begun);
        let result = std::panic::catch_unwind(AssertUnwindSafe(|| body(input)));
        *self.begun.lock().unwrap() = None;
        let path = self.path.display();
        let Ok(kind) = result else { panic!("this input broke a promise and is kept: {path}") };
        // Allocating much memory takes some time.
        if begun.elapsed() > Duration::from_millis(2) {
            let held = kilwa_builder::build::machine::peak_memory().unwrap_or(0);
            assert!(
                held < LARGEST,
                "this input of {} bytes took {held} bytes of memory and is kept: {path}",
                input.len()
            );
        }
        kind
    }

    /// Ends the process where an input does not end.
    fn watch(&self, is_done: &Mutex<bool>) {
        while !*is_done.lock().unwrap() {
            std::thread::sleep(Duration::from_millis(20));
            if self.begun.lock().unwrap().is_some_and(|at| at.elapsed() > SLOWEST) {
                eprintln!("this input takes more than {SLOWEST:?} and is kept: {}", self.path.display());
                std::process::abort();
            }
        }
    }
}

/// Ends the watch also where a panic ends the run.
struct Done<'a>(&'a Mutex<bool>);

impl Drop for Done<'_> {
    fn drop(&mut self) {
        *self.0.lock().unwrap() = true;
    }
}

fn fuzz(name: &str) {
    let (_, body) = *bodies::ALL.iter().find(|(n, _)| *n == name).expect("a target of that name");
    let seeds = seeds::of(name);
    assert!(seeds.len() >= 5, "{name} has {} seeds", seeds.len());
    if let Some(folder) = variable("KILWA_FUZZ_CORPUS") {
        let folder = Path::new(&folder).join(name);
        std::fs::create_dir_all(&folder).unwrap();
        for (i, seed) in seeds.iter().enumerate() {
            std::fs::write(folder.join(format!("seed-{i:03}")), seed).unwrap();
        }
        return;
    }
    if let Some(file) = variable("KILWA_FUZZ_INPUT") {
        println!("{}", body(&std::fs::read(file).unwrap()));
        return;
    }
    let (current, is_done) = (Current::new(name), Mutex::new(false));
    let inputs = std::thread::scope(|scope| {
        scope.spawn(|| current.watch(&is_done));
        let _done = Done(&is_done);
        go_on(name, body, seeds, &current)
    });
    assert!(inputs >= 100, "only {inputs} inputs were tried");
    std::fs::remove_file(&current.path).unwrap();
}

/// The time of a target, from a list such as `10,ptx=30,e57=30`.
fn seconds_of(name: &str, list: &str) -> u64 {
    let own = list.split(',').find_map(|item| item.split_once('=').filter(|(of, _)| *of == name).map(|(_, s)| s));
    let seconds = own.or_else(|| list.split(',').find(|item| !item.contains('=')));
    seconds.and_then(|s| s.parse().ok()).expect("KILWA_FUZZ_SECONDS is a number, or a list such as 10,ptx=30")
}

/// Mutates until the time or the number is up; how many inputs there were.
fn go_on(name: &str, body: Body, seeds: Vec<Vec<u8>>, current: &Current) -> u64 {
    let seconds = variable("KILWA_FUZZ_SECONDS").map(|list| seconds_of(name, &list));
    let seed = variable("KILWA_FUZZ_SEED").map_or(1, |s| s.parse().expect("KILWA_FUZZ_SEED is a number"));
    let begun = Instant::now();
    let mut kinds: HashSet<String> = HashSet::new();
    for seed in &seeds {
        kinds.insert(current.run(body, seed));
    }
    let of_seeds = kinds.len();
    let mut mutator = Mutator::new(seed, seeds);
    let mut inputs = 0;
    while seconds.map_or(inputs < INPUTS, |s| begun.elapsed() < Duration::from_secs(s)) {
        let input = mutator.next();
        assert!(input.len() <= MAX_BYTES);
        // An input with a new kind of result is kept for further mutation.
        if kinds.insert(current.run(body, &input)) && mutator.len() < MAX_KEPT {
            mutator.keep(input);
        }
        inputs += 1;
    }
    println!(
        "{name}: {inputs} inputs from seed {seed} in {:.1} s, {of_seeds} kinds of result in the seeds, {} in all",
        begun.elapsed().as_secs_f64(),
        kinds.len()
    );
    inputs
}

#[test]
fn any_bytes_are_read_as_ply_or_refused() {
    fuzz("ply");
}

#[test]
fn any_bytes_are_read_as_obj_or_refused() {
    fuzz("obj");
}

#[test]
fn any_bytes_are_read_as_stl_or_refused() {
    fuzz("stl");
}

#[test]
fn any_bytes_are_read_as_gltf_or_refused() {
    fuzz("gltf");
}

#[test]
fn any_bytes_are_read_as_a_nexus_model_or_refused() {
    fuzz("nexus");
}

#[test]
fn any_bytes_are_read_as_3d_tiles_or_refused() {
    fuzz("tiles");
}

#[test]
fn any_bytes_are_read_as_a_zip_archive_or_refused() {
    fuzz("zip");
}

#[test]
fn any_bytes_are_read_as_a_pack_or_refused() {
    fuzz("open_pack");
}

#[test]
fn any_bytes_are_read_as_a_chunk_or_refused() {
    fuzz("decode_chunk");
}

#[test]
fn any_bytes_are_read_as_metadata_or_refused() {
    fuzz("metadata");
}

#[test]
fn any_bytes_are_read_as_a_manifest_or_refused() {
    fuzz("manifest");
}

#[test]
fn any_bytes_are_read_as_notes_or_refused() {
    fuzz("notes");
}

#[test]
fn any_bytes_are_read_as_ptx_or_refused() {
    fuzz("ptx");
}

#[test]
fn any_bytes_are_read_as_points_or_refused() {
    fuzz("points");
}

#[test]
fn any_bytes_are_read_as_e57_or_refused() {
    fuzz("e57");
}

#[test]
fn any_bytes_are_read_as_las_or_refused() {
    fuzz("las");
}

#[test]
fn any_bytes_are_read_as_a_range_grid_or_refused() {
    fuzz("range_grid");
}

#[test]
fn any_bytes_are_read_as_a_survey_or_refused() {
    fuzz("survey");
}

#[test]
fn any_bytes_are_read_as_poses_of_photographs_or_refused() {
    fuzz("photos");
}

#[test]
fn any_bytes_are_read_as_a_spool_or_refused() {
    fuzz("spool");
}

#[test]
fn any_bytes_are_read_as_a_mask_or_refused() {
    fuzz("mask");
}

#[test]
fn any_bytes_are_read_as_a_point_list_or_refused() {
    fuzz("point_list");
}
