//! The last step: from the results of all tasks to the pack.

use super::levels::{LevelState, RESULTS, ROOTS, TailState};
use super::plan::{Divided, SharedBuild};
use super::regions::LeavesState;
use super::{Manifest, SharedFile, Task};
use crate::assemble;
use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::build::{BuildReport, StageTime, report};
use crate::levels::{Bodies, CHUNKS, Levels, Refined, results};
use crate::partition::tree_file::TREE;
use crate::scratch::{PatchFile, checksum_matches, read_index};
use kilwa_pack::verify::Totals;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The bodies of chunks, in the files of several tasks.
struct SharedBodies {
    build: Arc<SharedBuild>,
    files: Vec<(SharedFile, PathBuf)>,
}

impl Bodies for SharedBodies {
    fn body(&self, of: &Refined) -> Result<Vec<u8>, BuildError> {
        self.build.read(&self.files[of.file as usize].0, of.at, u64::from(of.bytes))
    }

    fn path(&self, of: &Refined) -> &Path {
        &self.files[of.file as usize].1
    }
}

/// Write the pack of a build whose tasks are all done to `out`. The report adds up the tasks of each stage; the totals are what the tasks
/// counted when they decoded their chunks again.
///
/// # Errors
/// [`BuildError`]: a task is not done, a file cannot be read or is damaged, the pack cannot be written.
pub fn assemble(
    build: SharedBuild,
    work: &Work<'_>,
    out: &mut impl Write,
) -> Result<(BuildReport, Totals), BuildError> {
    let build = Arc::new(build);
    let grown = build.divided()?;
    let mut tree = build.part(&grown, grown.state.shards.pack_part)?;
    let Divided { state, manifest: grown } = grown;
    let of_tree = &build.file(&grown, TREE)?.name;
    let (mut refined, mut files, mut stages) = (Vec::new(), Vec::new(), Vec::new());
    let (mut tail, mut totals) = (None, Totals::default());
    for task in build.tasks()?.iter().map(|listed| listed.task) {
        work.stop.check()?;
        let manifest = match task {
            Task::Ingest | Task::Region { .. } | Task::Tree => build.finished(task)?,
            _ => build.finished_of(task, Some(of_tree))?,
        };
        add_time(&mut stages, &task.stage(), &manifest);
        match task {
            Task::Ingest | Task::Region { .. } | Task::Tree => continue,
            Task::Leaves { .. } => {
                tree.overfull_leaves += build.state_of::<LeavesState>(&manifest)?.overfull;
                continue;
            }
            Task::Level { .. } => totals = totals.plus(build.state_of::<LevelState>(&manifest)?.decoded),
            Task::Tail => totals = totals.plus(build.state_of::<TailState>(&manifest)?.decoded),
        }
        let place = |file: &SharedFile| PathBuf::from(build.store().display_path(&file.name));
        let file = build.file(&manifest, RESULTS)?;
        let mut part = results::parse(&build.read_whole(file)?, &place(file))
            .map_err(|_| build.damaged_file(file, "its results do not match their checksum"))?;
        for r in &mut part {
            r.file = files.len() as u32;
        }
        refined.append(&mut part);
        let chunks = build.file(&manifest, CHUNKS)?.clone();
        let at = place(&chunks);
        files.push((chunks, at));
        tail = Some(manifest);
    }
    let tail = tail.map_or_else(|| build.finished(Task::Tail), Ok)?;
    let roots = local_patches(&build, work, build.file(&tail, ROOTS)?)?;
    let mut root_patches = Vec::new();
    for t in 0..6 {
        root_patches.extend(roots.read(t)?.map(|patch| (t, patch)));
    }
    let bodies = Box::new(SharedBodies { build: Arc::clone(&build), files });
    let levels = Levels::of_surface(state.surface, tree, refined, &root_patches, bodies)?;
    let (mut summary, totals) = (BuildReport::of(&levels), totals.plus(levels.root.decoded));
    let header = report::header_of(&levels);
    let (_, pack) = assemble::assemble(levels, work, header, &state.metadata, out)?;
    summary.pack = pack;
    summary.stages = stages;
    Ok((summary, totals))
}

/// A small file of patches, copied to this machine.
fn local_patches(build: &SharedBuild, work: &Work<'_>, file: &SharedFile) -> Result<PatchFile, BuildError> {
    let local = PatchFile::create(work.scratch, ROOTS)?;
    let index = read_index(file.bytes, |at, bytes| build.read(file, at, bytes))?;
    for (tetrahedron, place) in index.ok_or_else(|| build.damaged_file(file, "its index is missing or damaged"))? {
        let patch = build.read(file, place.at, place.bytes)?;
        if !checksum_matches(&patch) {
            let why = format!("the patch at byte {} does not match its checksum", place.at);
            return Err(build.damaged_file(file, &why));
        }
        local.append_encoded(tetrahedron, place.triangles, &patch)?;
    }
    Ok(local)
}

fn add_time(stages: &mut Vec<StageTime>, stage: &str, of: &Manifest) {
    match stages.last_mut().filter(|last| last.stage == stage) {
        Some(last) => {
            last.seconds += of.seconds;
            last.cpu_seconds = last.cpu_seconds.zip(of.cpu_seconds).map(|(a, b)| a + b);
        }
        None => stages.push(StageTime { stage: stage.to_owned(), seconds: of.seconds, cpu_seconds: of.cpu_seconds }),
    }
}
