//! What a build of a larger model would cost, from what was measured: formulae, each with its assumption.
//!
//! With N triangles, tasks of [`TASK`] triangles and P cores, each a worker with one thread:
//!
//! * Level k below the finest has N / 4^k triangles (two bisections of a surface halve its triangles twice), and is divided into N / 4^k /
//!   TASK tasks, as long as that is more than one; the rest is the tail.
//! * The levels cost as much per triangle of theirs, on each level, as measured over all divided levels.
//! * Waves do not overlap: a level takes ceil(tasks / P) times as long as a task.
//! * Of the ingest, [`DIVIDED`] can be divided; the rest is done by one worker on one core.
//! * Every task reads the whole tree: [`TREE_MEMORY`] bytes per triangle in memory (decision 83).
//! * Assembling holds the directory: [`ENTRY_MEMORY`] bytes for each chunk.

use super::Stage;
use anyhow::{Context, Result};
use std::fmt::Write as _;

/// Triangles of a task by default.
const TASK: f64 = 1e7;
/// Share of the ingest's processor time that can be divided. Decision 83: none, the ingest is one task.
const DIVIDED: f64 = 0.0;
/// Bytes of memory per triangle for the tree in every task, as decision 83 measured.
const TREE_MEMORY: f64 = 1.5;
/// Bytes of memory for each chunk of a pack while it is assembled, its entry and its place in a page: measured with 5.5 million chunks
/// (`core/stream/tests/giant.rs`: 1.56 GB).
const ENTRY_MEMORY: f64 = 283.0;
const SIZES: [f64; 3] = [1e9, 1e10, 1.5e10];
const CORES: [f64; 3] = [1.0, 16.0, 512.0];

/// What was measured, per triangle of the model if nothing else is said.
pub(super) struct Measured {
    ingest_cpu_s: f64,
    /// Per triangle of the levels.
    level_cpu_s: f64,
    /// Per triangle of the level that the tail begins with.
    tail_cpu_s: f64,
    assemble_cpu_s: f64,
    ingest_written: f64,
    /// Per triangle of the levels; reading the tree is left out.
    level_read: f64,
    level_written: f64,
    tree: f64,
    pack: f64,
    /// Memory of a level's task beside the tree, bytes per triangle of the task.
    level_memory: f64,
    files_per_task: f64,
    chunks: f64,
}

/// What a build left before the pack was assembled: files in its folder, bytes of the tree; and chunks of the pack.
#[derive(Default, Clone)]
pub(super) struct Left {
    pub(super) files: f64,
    pub(super) tree_bytes: f64,
    pub(super) chunks: f64,
}

impl Measured {
    /// From the stages of a model of `n` triangles.
    pub(super) fn of(n: f64, task: f64, stages: &[(String, Stage)], left: &Left) -> Result<Self> {
        let of = |name: &str| {
            let found = stages.iter().find(|(stage, _)| stage == name).map(|(_, stage)| stage);
            found.with_context(|| format!("the mesh is too small for its tasks: there is no stage {name}"))
        };
        let (ingest, of_shards, tail, assemble) = (of("ingest")?, of("levels")?, of("tail")?, of("assemble")?);
        let tasks = f64::from(of_shards.tasks);
        let divided = levels(n, task);
        let of_levels = divided.iter().sum::<f64>() * task;
        let of_tail = n / 4f64.powi(i32::try_from(divided.len())?);
        let tree = left.tree_bytes / n;
        Ok(Self {
            ingest_cpu_s: ingest.cpu_s / n,
            level_cpu_s: of_shards.cpu_s / of_levels,
            tail_cpu_s: tail.cpu_s / of_tail,
            assemble_cpu_s: assemble.cpu_s / n,
            ingest_written: ingest.written / n,
            level_read: (of_shards.read - tasks * left.tree_bytes).max(0.0) / of_levels,
            level_written: of_shards.written / of_levels,
            tree,
            pack: assemble.written / n,
            level_memory: (of_shards.peak_bytes as f64 - TREE_MEMORY * n).max(0.0) / task,
            files_per_task: left.files / (tasks + 2.0),
            chunks: left.chunks / n,
        })
    }
}

/// Tasks of the divided levels, the finest first.
fn levels(n: f64, task: f64) -> Vec<f64> {
    let sizes = std::iter::successors(Some(n), |above| Some(above / 4.0));
    sizes.map(|at| at / task).take_while(|&tasks| tasks > 1.0).collect()
}

/// Seconds by the clock on so many cores.
fn seconds(m: &Measured, n: f64, cores: f64) -> f64 {
    let ingest = m.ingest_cpu_s * n * ((1.0 - DIVIDED) + DIVIDED / cores);
    let task = m.level_cpu_s * TASK;
    let waves: f64 = levels(n, TASK).iter().map(|tasks| (tasks.ceil() / cores).ceil() * task).sum();
    ingest + waves + m.tail_cpu_s * TASK + m.assemble_cpu_s * n
}

pub(super) fn table(m: &Measured) -> Result<String> {
    let mut table = format!(
        "\nCosts on paper, by the formulae of `xtask/src/bench/cluster/costs.rs`, from these constants: ingest {:.2} and assembly {:.2} µs of processor time per triangle, levels {:.2} and tail {:.2} µs per triangle of theirs; {:.1} bytes per triangle written by the ingest, {:.1} read and {:.1} written by the levels, per triangle of theirs, and {:.2} for the tree, read by every task; pack {:.2} bytes per triangle, {:.0} triangles per chunk.\n\n\
         | triangles | tasks | files | processor h | moved, TB | of that the tree, TB | memory of a task of a level, GB | of the assembly, GB | 1 core: h | 16 cores: h | 512 cores: h | of that the ingest: h |\n\
         |---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
        m.ingest_cpu_s * 1e6,
        m.assemble_cpu_s * 1e6,
        m.level_cpu_s * 1e6,
        m.tail_cpu_s * 1e6,
        m.ingest_written,
        m.level_read,
        m.level_written,
        m.tree,
        m.pack,
        1.0 / m.chunks
    );
    for n in SIZES {
        let levels = levels(n, TASK);
        let tasks: f64 = levels.iter().map(|tasks| tasks.ceil()).sum();
        let of_levels: f64 = levels.iter().sum::<f64>() * TASK;
        let cpu_h =
            (m.ingest_cpu_s * n + m.level_cpu_s * of_levels + m.tail_cpu_s * TASK + m.assemble_cpu_s * n) / 3600.0;
        let trees = (tasks + 2.0) * m.tree * n;
        let moved = m.ingest_written * n + (m.level_read + m.level_written) * of_levels + 2.0 * m.pack * n + trees;
        let [memory, assembly] = [TREE_MEMORY * n + m.level_memory * TASK, (TREE_MEMORY + ENTRY_MEMORY * m.chunks) * n];
        let [one, some, many] = CORES.map(|cores| seconds(m, n, cores) / 3600.0);
        writeln!(
            table,
            "| {n:.1e} | {:.0} | {:.0} | {cpu_h:.1} | {:.2} | {:.2} | {:.1} | {:.1} | {one:.1} | {some:.1} | {many:.1} | {:.1} |",
            tasks + 3.0,
            (tasks + 2.0) * m.files_per_task,
            moved / 1e12,
            trees / 1e12,
            memory / 1e9,
            assembly / 1e9,
            m.ingest_cpu_s * n * ((1.0 - DIVIDED) + DIVIDED / CORES[2]) / 3600.0
        )?;
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_shrink_to_a_quarter_until_they_are_one_task() {
        let tasks = levels(1e9, TASK);
        assert_eq!(tasks.iter().map(|t| t.ceil() as u32).collect::<Vec<_>>(), [100, 25, 7, 2]);
        assert!(levels(9e6, TASK).is_empty());
    }
}
