//! The whole build: inputs in, pack out, by way of scratch files, with a journal of the stages that are complete.
//!
//! Stages, each a function over files: `read` (the inputs into the spool), `ingest` (leaf patches, the tree),
//! `level-NN` from the finest to level 0, then assembly straight into the output. A build that is resumed continues after
//! the last complete stage. A scratch file that turns out to be damaged is noticed by its checksum, and the stages
//! from the one that wrote it on are done again.
//!
//! The bytes of the pack depend on the inputs and on [`BuildOptions`] (threads excepted), on nothing else.

mod interrupt;
pub mod journal;
pub mod machine;
pub mod options;
pub mod progress;
pub(crate) mod report;
pub mod work;

pub use interrupt::Interruptible;
pub use report::{BuildReport, StageTime};

use crate::assemble::assemble;
use crate::build::journal::{Journal, Plan, PlannedInput};
use crate::build::options::{BuildError, BuildOptions};
use crate::build::progress::{Progress, Whole};
use crate::build::work::{Stop, Work};
use crate::ingest::surface::{LEAVES, SHARED, Surface};
use crate::ingest::{IngestOptions, Spool, Spooled, can_resume, ingest, is_file_of_ingest};
use crate::levels::{CHUNKS, Hierarchy};
use crate::partition::tree_file::{self, TREE};
use crate::scratch::{Scratch, ScratchError};
use glam::{DVec3, Vec3};
use kilwa_formats::RawMesh;
use kilwa_formats::Up;
use kilwa_pack::metadata::SourceFile;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::io::{Seek, Write};
use std::path::Path;
use std::time::Instant;

/// Name of the stage that reads.
pub(crate) const READ: &str = "read";
/// Name of the stage that makes the leaves and the tree.
pub(crate) const INGEST: &str = "ingest";

/// A finished pack.
pub struct Built {
    /// The bytes of the file.
    pub bytes: Vec<u8>,
    /// What was read, repaired and made.
    pub report: BuildReport,
}

/// What the metadata records about the inputs.
#[derive(Debug, Clone, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Provenance {
    /// The files.
    pub sources: Vec<SourceFile>,
    /// The accuracy of the capture, if the inputs state it; [`BuildOptions::capture_accuracy`] takes precedence.
    #[serde(default)]
    pub capture: Option<Capture>,
}

/// The accuracy of a capture.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Capture {
    /// Standard uncertainty of a coordinate, metres.
    pub accuracy: f64,
    /// The part of it that is due to the poses of the stations, metres.
    pub registration: f64,
    /// The part of it that is due to the noise of the instruments, metres.
    pub instrument: f64,
}

/// Where the mesh comes from.
pub trait Inputs {
    /// Identifies the inputs: a build is resumed only with the same ones.
    ///
    /// # Errors
    /// [`BuildError`] where an input does not exist.
    fn plan(&self) -> Result<Vec<PlannedInput>, BuildError>;

    /// Whether input `number` of the plan still has the content that was read, which `sources`, the list of inputs in the metadata, describes.
    /// Called only if its stamp differs.
    ///
    /// # Errors
    /// [`BuildError`] if it cannot be read, or the build is asked to stop.
    fn is_unchanged(
        &self,
        _number: usize,
        _sources: &[SourceFile],
        _progress: &dyn Progress,
        _stop: &Stop,
    ) -> Result<bool, BuildError> {
        Ok(false)
    }

    /// Deliver all of them to `spool`, in metres and with z up. Returns what the metadata records about them.
    ///
    /// # Errors
    /// [`BuildError`], with what is wrong and what to do.
    fn deliver(&mut self, spool: &mut Spool, work: &Work<'_>) -> Result<Provenance, BuildError>;
}

/// How a build is run; nothing of it changes the bytes.
#[derive(Clone, Copy)]
pub struct Run<'a> {
    /// Where files are kept meanwhile.
    pub scratch: &'a Scratch,
    /// Bytes of memory that the build may hold; a fragment that space cannot divide may take more.
    pub memory: u64,
    /// Go on with what an interrupted build left in the scratch folder, where there is something.
    pub resume: bool,
    /// Looked at between pieces of work.
    pub stop: &'a Stop,
    /// Called with the progress.
    pub progress: &'a dyn Progress,
}

/// Build a pack from a mesh in memory.
///
/// # Errors
/// [`BuildError`] with what is wrong and what to do.
pub fn build_pack(raw: RawMesh, options: &BuildOptions, progress: &dyn Progress) -> Result<Built, BuildError> {
    let (scratch, stop) = (Scratch::temporary()?, Stop::default());
    let run = Run { scratch: &scratch, memory: machine::default_budget(), resume: false, stop: &stop, progress };
    let mut out = std::io::Cursor::new(Vec::new());
    let report = build(&mut InMemory { raw, options }, options, &run, &mut out)?;
    Ok(Built { bytes: out.into_inner(), report })
}

/// Build a pack from any inputs into `out`, from its beginning. What stood in `out` beyond the end of the pack is the
/// caller's to cut off. The scratch folder is left as it is: the caller keeps it or discards it.
///
/// # Errors
/// [`BuildError`] with what is wrong and what to do.
pub fn build(
    inputs: &mut dyn Inputs,
    options: &BuildOptions,
    run: &Run<'_>,
    out: &mut (impl Write + Seek + Send),
) -> Result<BuildReport, BuildError> {
    options.check()?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build()?;
    let progress = Whole::new(run.progress);
    let Run { scratch, memory, stop, .. } = *run;
    let work = Work { scratch, memory, threads: pool.current_num_threads(), stop, progress: &progress };
    let plan = plan(inputs, options)?;
    let journal = if run.resume {
        Journal::resume(scratch, plan, &|number, sources| inputs.is_unchanged(number, sources, &progress, stop))?
    } else {
        Journal::begin(scratch, plan)?
    };
    let resumed_after = journal.last().map(|s| s.stage.clone());
    match &resumed_after {
        Some(stage) => run.progress.note(&format!("going on after stage {stage}, which was complete")),
        None if run.resume => run.progress.note("no stage was complete: the build starts over"),
        None => {}
    }
    let mut building = Building { work, options, journal, stages: Vec::new(), spooled: None };
    let mut redone = BTreeSet::new();
    loop {
        let attempt = building.read(inputs).and_then(|()| {
            let (building, out) = (&mut building, &mut *out);
            pool.install(move || building.build(out))
        });
        match attempt {
            Ok(mut report) => {
                report.resumed_after = resumed_after;
                report.redone = redone.into_iter().collect();
                report.scratch_peak_bytes = scratch.peak_bytes();
                report.stages = building.stages;
                return Ok(report);
            }
            Err(BuildError::Scratch(error @ ScratchError::Damaged { .. })) => {
                let Some(name) = name_of(&error, scratch) else { return Err(error.into()) };
                // The same file twice: the disk itself is at fault.
                if !redone.insert(name) {
                    return Err(error.into());
                }
                run.progress.note(&format!("{error}; what it was for is done again"));
                building.journal.go_back(&redone)?;
                if building.journal.stage(INGEST).is_none() {
                    building.forget_ingest()?;
                }
            }
            Err(_) if stop.asked() => return Err(BuildError::Stopped),
            Err(error) => return Err(error),
        }
    }
}

/// The name of the scratch file that an error is about.
fn name_of(error: &ScratchError, scratch: &Scratch) -> Option<String> {
    let ScratchError::Damaged { path, .. } = error else { return None };
    let name = path.strip_prefix(scratch.folder()).ok()?;
    Some(name.to_string_lossy().into_owned())
}

/// What distinguishes a build of these inputs with these options from others.
///
/// # Errors
/// Those of [`Inputs::plan`].
pub fn plan(inputs: &dyn Inputs, options: &BuildOptions) -> Result<Plan, BuildError> {
    Ok(Plan { tool: tool(), options: shaping(options), inputs: inputs.plan()? })
}

/// The program, and the format of its packs: encoded chunks are kept between runs.
pub fn tool() -> String {
    let (major, minor) = kilwa_pack::header::VERSION;
    format!("kilwa {} (format {major}.{minor})", env!("CARGO_PKG_VERSION"))
}

/// Every option that shapes the pack, by name.
fn shaping(options: &BuildOptions) -> BTreeMap<String, Value> {
    match serde_json::to_value(options) {
        Ok(Value::Object(map)) => map.into_iter().collect(),
        _ => BTreeMap::new(),
    }
}

/// The options that concern the ingest.
pub(crate) fn ingest_of(options: &BuildOptions) -> IngestOptions {
    IngestOptions {
        leaf_triangles: options.leaf_triangles,
        step: options.step,
        crop: options.crop,
        min_confidence: options.min_confidence,
        drop_islands_below: options.drop_islands_below,
        precision: options.precision(),
    }
}

/// A build in progress.
struct Building<'a> {
    work: Work<'a>,
    options: &'a BuildOptions,
    journal: Journal,
    stages: Vec<StageTime>,
    /// What was read in this run, until the ingest has it.
    spooled: Option<Spooled>,
}

impl Building<'_> {
    /// Do a part of the build and note how long it took.
    fn timed<T>(
        &mut self,
        stage: &str,
        part: impl FnOnce(&mut Self) -> Result<T, BuildError>,
    ) -> Result<T, BuildError> {
        self.work.stop.check()?;
        let (clock, cpu) = (Instant::now(), machine::cpu_seconds());
        let result = part(self)?;
        let cpu_seconds = cpu.and_then(|before| Some(machine::cpu_seconds()? - before));
        self.stages.push(StageTime { stage: stage.to_owned(), seconds: clock.elapsed().as_secs_f64(), cpu_seconds });
        Ok(result)
    }

    /// Read the inputs, where that was not done before.
    fn read(&mut self, inputs: &mut dyn Inputs) -> Result<(), BuildError> {
        let scratch = self.work.scratch;
        let is_read = self.spooled.is_some() || can_resume(scratch);
        if self.journal.stage(INGEST).is_some() || (self.journal.stage(READ).is_some() && is_read) {
            return Ok(());
        }
        self.timed(READ, |b| {
            b.forget_ingest()?;
            let mut spool = Spool::create(scratch, Path::new("mesh"))?;
            let provenance = inputs.deliver(&mut spool, &b.work)?;
            b.spooled = Some(spool.finish()?);
            let provenance = serde_json::to_value(&provenance).unwrap_or_default();
            Ok(b.journal.complete(READ, &[], provenance)?)
        })
    }

    /// Remove what the ingest has done so far.
    fn forget_ingest(&mut self) -> Result<(), ScratchError> {
        self.spooled = None;
        for (name, _) in self.work.scratch.files()? {
            if is_file_of_ingest(&name) {
                self.work.scratch.remove(&name)?;
            }
        }
        Ok(())
    }

    /// Everything after reading.
    fn build(&mut self, out: &mut (impl Write + Seek)) -> Result<BuildReport, BuildError> {
        let mut hierarchy = self.hierarchy()?;
        while let Some(level) = hierarchy.next() {
            let name = format!("level-{level:02}");
            self.timed(&name, |b| {
                hierarchy.coarsen_next(&b.work, b.options.precision())?;
                let mut files = hierarchy.files();
                files.push(TREE.to_owned());
                Ok(b.journal.complete(&name, &files, Value::Null)?)
            })?;
        }
        self.timed("assemble", |b| {
            let levels = hierarchy.finish()?;
            let mut report = BuildReport::of(&levels);
            let metadata = report::metadata(&levels.surface, &report::Stated::of(b.options));
            let header = report::header_of(&levels);
            out.rewind().map_err(output_failed)?;
            let (_, pack) = assemble(levels, &b.work, header, &metadata, out)?;
            report.pack = pack;
            Ok(report)
        })
    }

    /// The hierarchy as far as it was built before, or with nothing but its leaves.
    fn hierarchy(&mut self) -> Result<Hierarchy, BuildError> {
        let (scratch, damaged) = (self.work.scratch, ScratchError::damaged);
        let journal = self.work.scratch.path(crate::build::journal::JOURNAL);
        if let Some(stage) = self.journal.stage(INGEST) {
            let surface: Surface =
                serde_json::from_value(stage.data.clone()).map_err(|e| damaged(&journal, e.to_string()))?;
            let tree = tree_file::read(scratch)?;
            let last = self.journal.last().map_or(stage, |last| last);
            let done = last.stage.strip_prefix("level-").and_then(|n| n.parse().ok());
            let chunks = last.files.get(CHUNKS).copied().unwrap_or(0);
            return Hierarchy::resume(&self.work, surface, tree, done, chunks);
        }
        let read = self.journal.stage(READ).map(|s| s.data.clone()).unwrap_or_default();
        let provenance: Provenance = serde_json::from_value(read).map_err(|e| damaged(&journal, e.to_string()))?;
        self.timed(INGEST, |b| {
            let ingested = ingest(&b.work, b.spooled.take(), &ingest_of(b.options), provenance)?;
            tree_file::write(scratch, &ingested.tree)?;
            let surface = serde_json::to_value(&ingested.surface).map_err(|e| damaged(&journal, e.to_string()))?;
            b.journal.complete(INGEST, &[LEAVES, SHARED, TREE].map(str::to_owned), surface)?;
            Hierarchy::begin(&b.work, ingested)
        })
    }
}

fn output_failed(source: std::io::Error) -> BuildError {
    kilwa_pack::PackError::Io { what: "pack".to_owned(), source }.into()
}

/// A mesh in memory as the only input.
struct InMemory<'a> {
    raw: RawMesh,
    options: &'a BuildOptions,
}

impl Inputs for InMemory<'_> {
    fn plan(&self) -> Result<Vec<PlannedInput>, BuildError> {
        Ok(Vec::new())
    }

    fn deliver(&mut self, spool: &mut Spool, _work: &Work<'_>) -> Result<Provenance, BuildError> {
        let (s, y_up) = (self.options.units.metres(), self.options.up == Up::Y);
        for p in &mut self.raw.positions {
            *p = s * if y_up { DVec3::new(p.x, -p.z, p.y) } else { *p };
        }
        for n in self.raw.normals.iter_mut().filter(|_| y_up) {
            *n = Vec3::new(n.x, -n.z, n.y);
        }
        spool.add(&self.raw)?;
        // Its memory is needed for what follows.
        self.raw = RawMesh::default();
        Ok(Provenance { sources: self.options.sources.clone(), capture: None })
    }
}
