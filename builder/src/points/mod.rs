//! From points to a pack: the same tree as for surfaces, with points in its patches instead of triangles. Each point is a *splat*, a square across its
//! normal, as large as the distance between the points (Rusinkiewicz and Levoy, "QSplat", SIGGRAPH 2000).
//!
//! | stage | does |
//! |---|---|
//! | `piles` | puts the points on the lattice and sorts them by region, in scratch files |
//! | `leaves` | decides which tetrahedra are split, and gives every leaf its points along Morton's curve |
//! | `levels` | thins the points of a diamond's tetrahedra to a third, finest level first, and encodes them |
//! | [`crate::assemble`] | numbers the chunks, orders them and writes the pack |
//!
//! Points need no care at the borders of tetrahedra, so each tetrahedron is thinned alone. A build of points cannot be resumed: most of its time is reading.
//! Memory follows the budget; the bytes depend on the points and the options alone.

mod coarsen;
mod leaves;
mod levels;
mod piles;
mod runs;
mod splat;

use crate::assemble::assemble;
use crate::build::options::{BuildError, BuildOptions};
use crate::build::progress::Whole;
use crate::build::work::Work;
use crate::build::{BuildReport, Run, StageTime, machine, report};
use crate::ingest::surface::{ColoredBy, Diagnostic, Surface};
use glam::{DVec3, Vec3};
use kilwa_geometry::Lattice;
use kilwa_geometry::lattice::MAX_COORDINATE;
use kilwa_pack::chunk::splat::MIN_RADIUS;
use kilwa_pack::metadata::{ScalarChannel, SourceFile};
use std::collections::BTreeMap;
use std::io::{Seek, Write};
use std::time::Instant;

/// Largest number of points in a leaf tetrahedron that is not split further.
pub const LEAF_POINTS: usize = 1024;

/// Steps that the longest side of a model has at least, and the largest lattice spacing that is chosen, as powers of two: half a millimetre.
const STEPS_LOG2: i32 = 17;
const LARGEST_STEP_LOG2: i32 = -11;

/// A radius that is guessed, where there are too few neighbours, is at most the margin over this: a 256th of the extent.
const ESTIMATED: f64 = 64.0;
/// The extent of a single point, metres.
const SMALLEST: f64 = 1e-3;

/// A measured point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Where, metres, axes of the pack.
    pub position: DVec3,
    /// The normal of the surface there, of any length; zero where nothing is known.
    pub normal: Vec3,
    /// The distance between the points of the surface there, metres; 0 if it has to be estimated.
    pub spacing: f32,
    /// sRGB.
    pub color: [u8; 3],
    /// As the source has it; NaN where it has none.
    pub intensity: f32,
}

/// Where points come from.
pub trait PointInputs {
    /// A box that holds all points, metres, axes of the pack; it may be larger than needed.
    ///
    /// # Errors
    /// [`BuildError`] if an input cannot be read.
    fn bounds(&self) -> Result<[DVec3; 2], BuildError>;

    /// Whether any point has a colour, and whether any has an intensity.
    fn attributes(&self) -> (bool, bool);

    /// Deliver all points in blocks. Returns the sources for the metadata.
    ///
    /// # Errors
    /// [`BuildError`], with what is wrong and what to do.
    fn deliver(&mut self, sink: &mut PointSink<'_>, work: &Work<'_>) -> Result<Vec<SourceFile>, BuildError>;
}

/// Receives points in blocks.
pub type PointSink<'a> = dyn FnMut(&[Point]) -> Result<(), BuildError> + 'a;

/// Build a pack of points into `out`, from its beginning; like [`crate::build()`], which builds a pack of a mesh.
///
/// # Errors
/// [`BuildError`] with what is wrong and what to do.
pub fn build_points(
    inputs: &mut dyn PointInputs,
    options: &BuildOptions,
    run: &Run<'_>,
    out: &mut (impl Write + Seek + Send),
) -> Result<BuildReport, BuildError> {
    options.check()?;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(options.threads).build()?;
    let progress = Whole::new(run.progress);
    let Run { scratch, memory, stop, .. } = *run;
    let work = Work { scratch, memory, threads: pool.current_num_threads(), stop, progress: &progress };
    for (name, _) in scratch.files()? {
        scratch.remove(&name)?;
    }
    let mut stages = Stages::default();
    let built = stages.all(inputs, options, &work, out);
    let mut report = if stop.asked() { built.map_err(|_| BuildError::Stopped)? } else { built? };
    report.scratch_peak_bytes = scratch.peak_bytes();
    report.stages = stages.times;
    Ok(report)
}

/// The stages that were done.
#[derive(Default)]
struct Stages {
    times: Vec<StageTime>,
}

impl Stages {
    fn timed<T>(&mut self, stage: &str, part: impl FnOnce() -> Result<T, BuildError>) -> Result<T, BuildError> {
        let (clock, cpu) = (Instant::now(), machine::cpu_seconds());
        let result = part()?;
        let cpu_seconds = cpu.and_then(|before| Some(machine::cpu_seconds()? - before));
        self.times.push(StageTime { stage: stage.to_owned(), seconds: clock.elapsed().as_secs_f64(), cpu_seconds });
        Ok(result)
    }

    fn all(
        &mut self,
        inputs: &mut dyn PointInputs,
        options: &BuildOptions,
        work: &Work<'_>,
        out: &mut (impl Write + Seek),
    ) -> Result<BuildReport, BuildError> {
        let place = Placement::of(inputs.bounds()?, options)?;
        let read = self.timed("read", || piles::read(inputs, &place, options, work))?;
        let ingested = self.timed("ingest", || leaves::leaves(&read, &place, work))?;
        let surface = surface(&read, &ingested, &place, options);
        let levels = self.timed("level-all", || levels::levels(ingested, surface, &place, work))?;
        self.timed("assemble", || {
            let mut report = BuildReport::of(&levels);
            report.points = Some(levels.surface.points);
            let mut metadata = report::metadata(&levels.surface, &report::Stated::of(options));
            metadata.options = shaped(options);
            let header = report::header_of(&levels).of_points();
            let failed = |source| kilwa_pack::PackError::Io { what: "pack".to_owned(), source };
            out.rewind().map_err(failed)?;
            let (_, pack) = assemble(levels, work, header, &metadata, out)?;
            report.pack = pack;
            Ok(report)
        })
    }
}

/// The lattice of a pack of points, and how large its splats may be.
#[derive(Debug, Clone, Copy)]
struct Placement {
    lattice: Lattice,
    cube_log2: u32,
    /// Largest code of a radius: no corner of a splat is outside of the lattice.
    largest: u8,
    /// Largest code of a radius that is guessed: an outlier does not hide the model.
    largest_estimated: u8,
}

impl Placement {
    /// For points in a box, metres.
    fn of([min, max]: [DVec3; 2], options: &BuildOptions) -> Result<Self, BuildError> {
        let extent = (max - min).max_element();
        if !(min.is_finite() && max.is_finite() && extent >= 0.0) {
            return Err(BuildError::Inputs { why: "the inputs have no points".to_owned() });
        }
        // One point alone has a place, too.
        let extent = extent.max(SMALLEST);
        let log2 = |x: f64| libm::log2(x).clamp(-60.0, 60.0);
        // A quarter of the extent is left for splats on every side; and doubles tell places apart.
        let magnitude = min.abs().max(max.abs()).max_element();
        let room = log2(extent * 1.6 / f64::from(MAX_COORDINATE)).ceil() as i32;
        let needed = room.max(log2(magnitude * f64::EPSILON * 2.0).ceil() as i32);
        let coarsest = log2(extent.max(1.0) / 16.0).floor() as i32;
        let step_log2 = match options.step {
            Some(step) if step > 0.0 && step.is_finite() => libm::log2(step).floor().clamp(-1000.0, 1000.0) as i32,
            Some(step) => return Err(BuildError::Inputs { why: format!("--step {step} is not a length in metres") }),
            None => (log2(extent).floor() as i32 - STEPS_LOG2).min(LARGEST_STEP_LOG2).max(needed),
        };
        if !(needed..=coarsest.max(needed)).contains(&step_log2) {
            let [least, most] = [needed, coarsest.max(needed)].map(|log2| libm::scalbn(1.0, log2));
            let why = format!(
                "the points extend over {extent} m, for which a lattice spacing is possible from {least} to {most} m; give --step such a value, or leave it out"
            );
            return Err(BuildError::Inputs { why });
        }
        let step = libm::scalbn(1.0, step_log2);
        let margin = (extent / step / 4.0).ceil().max(64.0);
        let origin = ((min / step).floor() - margin) * step;
        let last = ((max - origin) / step).max_element() + 1.0;
        let cube_log2 = (libm::log2(last).ceil().max(1.0) as u32).min(30);
        let codes = [margin - 2.0, margin / ESTIMATED].map(|r| kilwa_pack::chunk::splat::code_of(r) - 1);
        let [largest, largest_estimated] = codes.map(|code| code.max(MIN_RADIUS));
        Ok(Self { lattice: Lattice { origin, step_log2 }, cube_log2, largest, largest_estimated })
    }
}

/// The options that shape a pack of points, for people.
fn shaped(options: &BuildOptions) -> BTreeMap<String, String> {
    let step = if options.step.is_some() { "given" } else { "derived" };
    let all = [
        ("step", step.to_owned()),
        (kilwa_pack::metadata::LEAF_POINTS, LEAF_POINTS.to_string()),
        ("normal-bits", options.normal_bits.min(splat::NORMAL_BITS).to_string()),
        ("coarse-points", format!("one in {} of those of the next finer level", coarsen::KEEP)),
    ];
    all.map(|(name, value)| (name.to_owned(), value)).into()
}

/// What is known of the points as a whole.
fn surface(read: &piles::Read, ingested: &leaves::Ingested, place: &Placement, options: &BuildOptions) -> Surface {
    let count = ingested.points;
    let spacing = place.lattice.step() * ingested.median_radius();
    let mut diagnostics = BTreeMap::new();
    let mut note = |kind: &str, count: u64| {
        if count > 0 {
            diagnostics.insert(kind.to_owned(), Diagnostic { count, places: Vec::new() });
        }
    };
    note("points at the same place on the lattice, of which one is kept", ingested.duplicates);
    note("points outside the box of --crop", read.cropped);
    let intensity = read.intensity.map(|[min, max]| ScalarChannel { name: "intensity".to_owned(), min, max });
    Surface {
        lattice: place.lattice,
        cube_log2: place.cube_log2,
        bounds: [ingested.bounds.min, ingested.bounds.max],
        colors: read.has_colors,
        colored_by: if read.has_colors { ColoredBy::Vertices } else { ColoredBy::Nothing },
        facing: DVec3::ZERO,
        supplied_normals: true,
        scalars: intensity.into_iter().collect(),
        triangles: 2 * count,
        points: count,
        border_edges: 4 * count,
        non_manifold_edges: 0,
        inconsistent_edges: 0,
        duplicate_triangles: 0,
        components: count,
        largest_component: 2,
        median_edge: spacing,
        short_edge: spacing,
        noise: options.capture_accuracy.unwrap_or(0.0),
        sources: read.sources.clone(),
        capture: None,
        diagnostics,
    }
}
