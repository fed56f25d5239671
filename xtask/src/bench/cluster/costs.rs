//! Estimated costs of a build of a larger model, extrapolated from measurements: formulae, each with its assumption.
//!
//! With N triangles, tasks of [`TASK`] triangles and P cores, each a worker with one thread:
//!
//! * The ingest, the tree and the assembly are one task each, whose time grows with N; they are not divided.
//! * The regions and the leaves are N / TASK tasks each.
//! * Level k below the finest has N / [`REDUCTION`]^k triangles. It is divided into as many tasks as its triangles need, at least
//!   [`LEAST`], if it has more than 1 / [`TAIL_SHARE`] of the triangles of a task; the other levels are the tail.
//! * Each level costs as much per triangle as all divided levels together did in the measurement; so does the tail.
//! * Waves do not overlap: a stage takes ceil(tasks / P) times as long as one of its tasks.
//! * The task `tree` holds the whole tree in memory: [`TREE_MEMORY`] bytes per triangle. All others read only their part of it; the level tasks and the tail also
//!   read one byte for each tetrahedron of the whole tree.
//! * The assembly holds, for each chunk, its part of the tree ([`PART_MEMORY`] bytes) and its entry in the directory ([`ENTRY_MEMORY`]).

use super::Stage;
use anyhow::{Context, Result};
use std::fmt::Write as _;

/// Default number of triangles of a task.
const TASK: f64 = 1e7;
/// Factor by which each level reduces the triangles (`levels::fragment::REDUCTION` of the builder).
const REDUCTION: f64 = 5.0;
/// Minimum number of tasks of a divided level, and the limit for levels of the tail (`tasks/shards.rs` of the builder).
const LEAST: f64 = 4.0;
const TAIL_SHARE: f64 = 64.0;
/// Bytes of memory per triangle for the whole tree (decision 83).
const TREE_MEMORY: f64 = 1.5;
/// Bytes of memory per chunk for its part of the tree and its results, during assembly: measured as the growth from 10^7 to 10^8 triangles, without the entry
/// (docs/bench/2026-11-27-tasks.md).
const PART_MEMORY: f64 = 700.0;
/// Bytes of memory per chunk of a pack during assembly, for its entry and its place in a page: measured with 5.5 million chunks
/// (`core/stream/tests/giant.rs`: 1.56 GB).
const ENTRY_MEMORY: f64 = 283.0;
const SIZES: [f64; 3] = [1e9, 1e10, 1.5e10];
const CORES: [f64; 3] = [1.0, 16.0, 512.0];

/// A stage, per triangle: of the model, or of the tasks of the stage.
struct Rates {
    cpu_s: f64,
    /// Without the levels of all tetrahedra.
    read: f64,
    written: f64,
}

impl Rates {
    /// The rates of a stage with that many triangles. `tetrahedra` is how many bytes its tasks read for the levels of all tetrahedra.
    fn of(stage: &Stage, triangles: f64, tetrahedra: f64) -> Self {
        // What the assembly reads is not counted.
        let read = if stage.read.is_nan() { 0.0 } else { (stage.read - tetrahedra).max(0.0) };
        Self { cpu_s: stage.cpu_s / triangles, read: read / triangles, written: stage.written / triangles }
    }

    fn moved(&self) -> f64 {
        self.read + self.written
    }
}

/// The measurements. Rates are per triangle of the model; those of the levels and the tail are per triangle that they process.
pub(super) struct Measured {
    ingest: Rates,
    region: Rates,
    tree: Rates,
    leaves: Rates,
    levels: Rates,
    tail: Rates,
    assemble: Rates,
    /// Tetrahedra of the tree per triangle.
    tetrahedra: f64,
    /// Memory of a level task in addition to the levels of all tetrahedra, bytes per triangle of the task.
    level_memory: f64,
    files_per_task: f64,
    chunks: f64,
}

/// The number of files in the folder of a build before the assembly, of tetrahedra in the tree, and of chunks in the pack.
#[derive(Default, Clone)]
pub(super) struct Left {
    pub(super) files: f64,
    pub(super) tetrahedra: f64,
    pub(super) chunks: f64,
}

impl Measured {
    /// From the stages of a model of `n` triangles.
    pub(super) fn of(n: f64, stages: &[(String, Stage)], left: &Left) -> Result<Self> {
        let of = |name: &str| {
            let found = stages.iter().find(|(stage, _)| stage == name).map(|(_, stage)| stage);
            found.with_context(|| format!("the mesh is too small for its tasks: there is no stage {name}"))
        };
        let tetrahedra = |stage: &Stage| f64::from(stage.tasks) * left.tetrahedra;
        let (leaves, levels, tail) = (of("leaves")?, of("levels")?, of("tail")?);
        // All but the assembly.
        let tasks: u32 = stages.iter().filter(|(name, _)| name != "assemble").map(|(_, stage)| stage.tasks).sum();
        Ok(Self {
            ingest: Rates::of(of("ingest")?, n, 0.0),
            region: Rates::of(of("region")?, n, 0.0),
            tree: Rates::of(of("tree")?, n, 0.0),
            leaves: Rates::of(leaves, n, 0.0),
            levels: Rates::of(levels, levels.triangles, tetrahedra(levels)),
            tail: Rates::of(tail, tail.triangles, tetrahedra(tail)),
            assemble: Rates::of(of("assemble")?, n, 0.0),
            tetrahedra: left.tetrahedra / n,
            level_memory: (levels.peak_bytes as f64 - left.tetrahedra).max(0.0) * f64::from(levels.tasks)
                / levels.triangles,
            files_per_task: left.files / f64::from(tasks),
            chunks: left.chunks / n,
        })
    }
}

/// A model divided into tasks of [`TASK`] triangles.
struct Division {
    /// Tasks of the regions; there are as many of the leaves.
    regions: f64,
    /// Triangles and tasks of the divided levels, the finest first.
    levels: Vec<(f64, f64)>,
    /// Triangles of the tail.
    tail: f64,
}

impl Division {
    fn of(n: f64) -> Self {
        let sizes = || std::iter::successors(Some(n), |below| Some(below / REDUCTION));
        let is_divided = |level: &f64| level * TAIL_SHARE > TASK;
        let levels: Vec<_> =
            sizes().take_while(is_divided).map(|level| (level, (level / TASK).ceil().max(LEAST))).collect();
        // The levels of the tail are a part of a part of a part …
        let tail = sizes().find(|level| !is_divided(level)).unwrap_or_default() * REDUCTION / (REDUCTION - 1.0);
        Self { regions: (n / TASK).ceil(), levels, tail }
    }

    fn level_triangles(&self) -> f64 {
        self.levels.iter().map(|(triangles, _)| triangles).sum()
    }

    fn level_tasks(&self) -> f64 {
        self.levels.iter().map(|(_, tasks)| tasks).sum()
    }

    /// All tasks but the assembly: also the ingest, the tree and the tail.
    fn tasks(&self) -> f64 {
        2.0 * self.regions + self.level_tasks() + 3.0
    }

    /// How often the levels of all tetrahedra are read: once by each level task and by the tail.
    fn readers_of_tetrahedra(&self) -> f64 {
        self.level_tasks() + 1.0
    }
}

/// Seconds that one worker is busy while the others wait: the ingest, the tree, the tail and the assembly.
fn alone(m: &Measured, n: f64, divided: &Division) -> f64 {
    (m.ingest.cpu_s + m.tree.cpu_s + m.assemble.cpu_s) * n + m.tail.cpu_s * divided.tail
}

/// Wall time in seconds on `cores` cores.
fn seconds(m: &Measured, n: f64, divided: &Division, cores: f64) -> f64 {
    let rounds = |tasks: f64| (tasks / cores).ceil();
    let finest = rounds(divided.regions) * (m.region.cpu_s + m.leaves.cpu_s) * n / divided.regions;
    let levels = divided.levels.iter().map(|(triangles, tasks)| rounds(*tasks) * m.levels.cpu_s * triangles / tasks);
    alone(m, n, divided) + finest + levels.sum::<f64>()
}

fn constants(m: &Measured) -> String {
    let [ingest, region, tree, leaves, assembly] =
        [&m.ingest, &m.region, &m.tree, &m.leaves, &m.assemble].map(|rates| rates.cpu_s * 1e6);
    let [levels, tail] = [&m.levels, &m.tail].map(|rates| rates.cpu_s * 1e6);
    format!(
        "\nEstimated costs of larger models, by the formulae of `xtask/src/bench/cluster/costs.rs`, from these constants. CPU time per triangle of the model, µs: ingest {ingest:.2}, regions {region:.2}, tree {tree:.3}, leaves {leaves:.2}, assembly {assembly:.2}; per triangle that the stage processes: levels {levels:.2}, tail {tail:.2}. Bytes per triangle: {:.1} written by the ingest, {:.1} read and {:.1} written by the regions, {:.1} and {:.1} by the leaves, and {:.1} and {:.1} by the levels per triangle that they process; {:.4} for the levels of all tetrahedra, read by every level task and by the tail; pack {:.2}; {:.0} triangles per chunk.\n\n",
        m.ingest.written,
        m.region.read,
        m.region.written,
        m.leaves.read,
        m.leaves.written,
        m.levels.read,
        m.levels.written,
        m.tetrahedra,
        m.assemble.written,
        1.0 / m.chunks
    )
}

pub(super) fn table(m: &Measured) -> Result<String> {
    let mut table = constants(m);
    table.push_str(
        "| triangles | tasks | files | CPU h | data moved, TB | memory of the task `tree`, GB | memory of a level task, GB | memory of the assembly, GB | 1 core: h | 16 cores: h | 512 cores: h | of which one task runs alone: h |\n\
         |---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for n in SIZES {
        let divided = Division::of(n);
        let tetrahedra = divided.readers_of_tetrahedra() * m.tetrahedra * n;
        // The pack is read once to check it.
        let of_model = [&m.ingest, &m.region, &m.tree, &m.leaves, &m.assemble].map(Rates::moved).iter().sum::<f64>();
        let moved = (of_model + m.assemble.written) * n
            + m.levels.moved() * divided.level_triangles()
            + m.tail.moved() * divided.tail
            + tetrahedra;
        let memory = m.tetrahedra * n + m.level_memory * TASK;
        let [tree, assembly] = [TREE_MEMORY * n, (PART_MEMORY + ENTRY_MEMORY) * m.chunks * n];
        let [one, some, many] = CORES.map(|cores| seconds(m, n, &divided, cores) / 3600.0);
        writeln!(
            table,
            "| {n:.1e} | {:.0} | {:.0} | {one:.1} | {:.2} | {:.1} | {:.1} | {:.1} | {one:.1} | {some:.1} | {many:.1} | {:.1} |",
            divided.tasks() + 1.0,
            divided.tasks() * m.files_per_task,
            moved / 1e12,
            tree / 1e9,
            memory / 1e9,
            assembly / 1e9,
            alone(m, n, &divided) / 3600.0
        )?;
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_shrink_to_a_fifth_until_they_are_a_part_of_a_task() {
        let divided = Division::of(1e9);
        assert_eq!(divided.levels.iter().map(|(_, tasks)| *tasks as u32).collect::<Vec<_>>(), [100, 20, 4, 4, 4, 4]);
        assert!((divided.tail - 80_000.0).abs() < 1.0);
        assert!(Division::of(1.5e5).levels.is_empty());
    }

    #[test]
    fn one_core_takes_the_sum_and_very_many_what_is_not_divided() {
        let rates = |cpu_s| Rates { cpu_s, read: 1.0, written: 1.0 };
        let m = Measured {
            ingest: rates(4e-7),
            region: rates(4e-7),
            tree: rates(4e-8),
            leaves: rates(2e-7),
            levels: rates(4e-6),
            tail: rates(8e-6),
            assemble: rates(2e-7),
            tetrahedra: 0.009,
            level_memory: 80.0,
            files_per_task: 3.0,
            chunks: 1.0 / 3400.0,
        };
        let (n, divided) = (1e10, Division::of(1e10));
        let shared = (m.region.cpu_s + m.leaves.cpu_s) * n + m.levels.cpu_s * divided.level_triangles();
        assert!((seconds(&m, n, &divided, 1.0) - alone(&m, n, &divided) - shared).abs() < 1.0);
        // A task of each stage that is divided is left.
        let most = 1e7 * (m.region.cpu_s + m.leaves.cpu_s + m.levels.cpu_s * divided.levels.len() as f64);
        let many = seconds(&m, n, &divided, 1e6) - alone(&m, n, &divided);
        assert!(many > 0.0 && many <= most * 1.001, "{many} of at most {most}");
    }
}
