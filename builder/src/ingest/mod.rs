//! The first half of a build, out of core: from what readers deliver to the patches of the leaves and the tree.
//!
//! Stages, each a function over named files of the scratch folder; the rest of a stage's state is in a small
//! JSON file of its name, written when the files are complete, and its input is removed after that. A stage whose JSON
//! is there is skipped, so a build that was interrupted continues with the first that is not. Files of these stages are not
//! forced to the disk, where many are never written at all: [`can_resume`] checks whether the machine has run without a
//! break since, and where it has not, the inputs are read again.
//!
//! | stage | reads | writes | a triangle takes |
//! |---|---|---|---|
//! | [`spool`] | the inputs | `positions`, `colors`, `normals`, `scalar-N`, `triangles`, `triangle-colors` | 26 B |
//! | `resolve` | these | `corners`: three vertices a triangle on a provisional lattice | 48 B |
//! | `scatter` | `corners` | `buckets` and `halo`: triangles by region, on the lattice | 49 B |
//! | `topology` | these | `welded`: each region indexed, with borders and normals; `replies` between regions | 25 B |
//! | `leaves` | these | `leaves.patches`, `leaves.shared` | 17 B |
//!
//! Memory follows the budget and not the mesh; what comes out depends on the mesh and the options alone, not on memory,
//! threads, or the order of inputs, vertices and triangles. Numbers of the bytes are for an indexed mesh with colours.
//!
//! Failures: [`BuildError`], with what is wrong and what to do.

mod buckets;
mod collapse;
mod column;
mod components;
mod corners;
mod crowded;
pub(crate) mod divided;
mod islands;
mod lattice;
mod leaves;
mod resolve;
mod scatter;
mod spill;
mod split_requests;
pub mod spool;
pub mod surface;
mod tally;
mod topology;
mod weld;
mod words;

use crate::build::Provenance;
use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::ingest::surface::{Diagnostic, Ingested, LEAVES, SHARED, Surface};
use crate::scratch::{PatchFile, Records, Scratch, ScratchError, Sum, seal, unseal};
use buckets::{Buckets, point_of_words};
use crowded::refuse_leaves;
use glam::DVec3;
use kilwa_geometry::{DiamondKey, LatticePoint};
use kilwa_pack::chunk::MAX_SCALARS;
use kilwa_pack::metadata::ScalarChannel;
use kilwa_simplify::Precision;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
pub use spool::{Spool, Spooled};
use std::collections::BTreeMap;
pub use topology::Counts;
use topology::{Welded, Whole};
use words::color_of_word;

/// What the user can choose.
#[derive(Debug, Clone)]
pub struct IngestOptions {
    /// Largest leaf in triangles.
    pub leaf_triangles: usize,
    /// Lattice spacing in metres, a power of two; `None` derives it from the mesh.
    pub step: Option<f64>,
    /// Keep only triangles whose centroid lies in this box: smallest and largest corner, metres, axes of the pack.
    pub crop: Option<[DVec3; 2]>,
    /// Drop triangles with a corner whose `confidence` or `quality` is below this.
    pub min_confidence: Option<f32>,
    /// Drop components of fewer triangles.
    pub drop_islands_below: Option<u64>,
    /// Bits of colours and normals.
    pub precision: Precision,
}

/// Scratch bytes that the ingest takes at most for inputs of so many vertices and triangles, halo and patches included;
/// `vertex_bytes` beyond the position, for each vertex (4 for colours, 4 for normals, 4 for each scalar).
pub fn scratch_needed(vertices: u64, triangles: u64, vertex_bytes: u64) -> u64 {
    let spool = vertices * (24 + vertex_bytes) + 12 * triangles;
    let corners = triangles * 3 * (12 + vertex_bytes);
    let welded = vertices * (20 + vertex_bytes) + 12 * triangles;
    // On disk at the same time: spool and corners, then corners and buckets, then buckets and welded, then welded and leaves.
    (spool + corners).max(corners * 21 / 10).max(corners + welded).max(welded * 2)
}

/// Run the stages that are not done yet. `spooled` is what [`Spool::finish`] gave, `None` where that stage was done
/// before an interruption; `provenance` is what the metadata records about the inputs.
///
/// # Errors
/// [`BuildError`], each with what to do.
pub fn ingest(
    work: &Work<'_>,
    spooled: Option<Spooled>,
    options: &IngestOptions,
    provenance: Provenance,
) -> Result<Ingested, BuildError> {
    let mut stages = Stages { work, unchecked: BTreeMap::new() };
    let known = Known::find(&mut stages, spooled, options)?;
    let key = |(level, midpoint): &(u8, LatticePoint)| DiamondKey { level: *level, midpoint: *midpoint };
    let mut tree = leaves::tree_of(known.sorted.resolved.cube_log2, known.topology.split_requests.iter().map(key));
    let leaves = stages.run("leaves", &[topology::WELDED, topology::REPLIES], &[""; 0], || {
        let Known { sorted: Sorted { resolved, scattered, .. }, topology } = &known;
        let buckets = Buckets::of_shape(scattered.cube_log2, scattered.shape.clone());
        let triangles = |bucket: u32| topology.places[bucket as usize].triangles;
        refuse_leaves(&buckets, &resolved.lattice, triangles, &tree)?;
        leaves::leaves(work, resolved.layout, &buckets, topology, &tree)
    })?;
    leaves.count(&mut tree, options.leaf_triangles);
    let (leaves, shared) = (PatchFile::open(work.scratch, LEAVES)?, Records::open(work.scratch, SHARED)?);
    Ok(Ingested { surface: known.surface(provenance), tree, leaves, shared })
}

/// What is known of a mesh without building anything of it: for a report. The scratch files are left to the caller. `visitor`, if there is
/// one, sees every triangle.
///
/// # Errors
/// As [`ingest`].
pub fn survey(
    work: &Work<'_>,
    spooled: Spooled,
    options: &IngestOptions,
    visitor: Option<&mut dyn TriangleVisitor>,
) -> Result<Surface, BuildError> {
    let mut stages = Stages { work, unchecked: BTreeMap::new() };
    let known = Known::find(&mut stages, Some(spooled), options)?;
    if let Some(visitor) = visitor {
        known.visit(work, visitor)?;
    }
    Ok(known.surface(Provenance::default()))
}

/// Sees the triangles of a mesh, region by region.
pub trait TriangleVisitor {
    /// The smallest and largest corner of the mesh, metres; before the first triangle.
    fn begin(&mut self, bounds: [DVec3; 2]);
    /// The corners of a triangle, metres, and their colours, if the mesh has any.
    fn triangle(&mut self, corners: [DVec3; 3], colors: Option<[[u8; 3]; 3]>);
}

/// What is known once the triangles are sorted into regions.
struct Sorted {
    spooled: Spooled,
    resolved: resolve::Resolved,
    scattered: scatter::Scattered,
}

impl Sorted {
    /// Run the stages up to sorting; with regions of about `region` triangles, if that is given.
    fn find(
        stages: &mut Stages<'_>,
        spooled: Option<Spooled>,
        options: &IngestOptions,
        region: Option<u64>,
    ) -> Result<Self, BuildError> {
        let work = stages.work;
        if spooled.is_some() {
            work.scratch.create(SESSION)?.append(session().as_bytes())?;
        }
        let is_resumed = spooled.is_none();
        let spooled = stages.run("spool", &[""; 0], &[""; 0], || match spooled {
            Some(spooled) => Ok(spooled),
            None => Err(ScratchError::damaged(&work.scratch.path("spool.json"), "it is not there").into()),
        })?;
        if is_resumed {
            stages.unchecked.extend(spooled.sums.clone());
        }
        if spooled.channels.len() > usize::from(MAX_SCALARS) {
            let names = spooled.channels.iter().map(|c| c.name.as_str()).collect::<Vec<_>>().join(", ");
            let n = spooled.channels.len();
            let why = format!("{n} scalar channels together ({names}); a pack holds {MAX_SCALARS}");
            return Err(BuildError::TooLarge { why });
        }
        let inputs = spooled.files();
        let resolved =
            stages.run("resolve", &inputs, &[corners::CORNERS], || resolve::resolve(work, &spooled, options))?;
        let (layout, files) = (resolved.layout, [scatter::BUCKETS, scatter::HALO]);
        let mut scattered = stages
            .run("scatter", &[corners::CORNERS], &files, || scatter::scatter(work, &resolved, options, region))?;
        if let Some(below) = options.drop_islands_below {
            scattered = stages.run("islands", &files, &[islands::KEPT_BUCKETS, islands::KEPT_HALO], || {
                islands::drop_islands(work, layout, &scattered, below)
            })?;
        }
        Ok(Self { spooled, resolved, scattered })
    }

    fn surface(&self, whole: &Whole, provenance: Provenance) -> Surface {
        let Self { spooled, resolved, scattered } = self;
        let mut tally = spooled.tally.clone();
        tally.merge(&resolved.tally);
        tally.merge(&scattered.tally);
        tally.add_many(WELDED_VERTICES, resolved.used.saturating_sub(whole.counts.vertices));
        let channel = |c: &spool::Channel| ScalarChannel { name: c.name.clone(), min: c.min, max: c.max };
        let diagnostic = |(kind, count, places): (&str, u64, &[String])| {
            (kind.to_owned(), Diagnostic { count, places: places.to_vec() })
        };
        Surface {
            lattice: resolved.lattice,
            cube_log2: resolved.cube_log2,
            bounds: whole.bounds,
            supplied_normals: resolved.layout.normals,
            colors: resolved.layout.colors,
            colored_by: spooled.colored_by(),
            facing: resolved.facing,
            scalars: spooled.channels.iter().map(channel).collect(),
            triangles: scattered.triangles,
            points: whole.counts.points,
            border_edges: whole.counts.border_edges,
            non_manifold_edges: whole.counts.non_manifold_edges,
            inconsistent_edges: whole.counts.inconsistent_edges,
            duplicate_triangles: whole.counts.duplicate_triangles,
            components: whole.components.count,
            largest_component: whole.components.largest,
            median_edge: resolved.median,
            short_edge: resolved.first,
            noise: whole.roughness * resolved.lattice.step() * DEVIATION_PER_MEDIAN,
            sources: provenance.sources,
            capture: provenance.capture,
            diagnostics: tally.iter().map(diagnostic).collect::<BTreeMap<_, _>>(),
        }
    }
}

/// What all stages but the last know.
struct Known {
    sorted: Sorted,
    topology: topology::Topology,
}

impl Known {
    fn find(stages: &mut Stages<'_>, spooled: Option<Spooled>, options: &IngestOptions) -> Result<Self, BuildError> {
        let work = stages.work;
        let sorted = Sorted::find(stages, spooled, options, None)?;
        let Sorted { resolved, scattered, .. } = &sorted;
        let left = [topology::WELDED, topology::REPLIES];
        let topology = stages
            .run("topology", &scattered.files(), &left, || topology::topology(work, resolved, scattered, options))?;
        Ok(Self { sorted, topology })
    }

    fn visit(&self, work: &Work<'_>, visitor: &mut dyn TriangleVisitor) -> Result<(), BuildError> {
        let Self { sorted: Sorted { resolved, .. }, topology } = self;
        let layout = resolved.layout;
        visitor.begin(topology.whole.bounds.map(|p| resolved.lattice.world_from_lattice(p)));
        let file = work.scratch.existing(topology::WELDED)?;
        for (done, place) in (1..).zip(&topology.places) {
            let welded = Welded::read(&file, *place, layout)?;
            let words = |v: u32| &welded.vertices[(v & !topology::BORDER) as usize * layout.vertex()..];
            let corner = |v: u32| {
                let at = words(v);
                resolved.lattice.world_from_lattice(point_of_words([at[0], at[1], at[2]]))
            };
            for triangle in &welded.triangles {
                let colors = layout.color().map(|at| triangle.map(|v| color_of_word(words(v)[at])));
                visitor.triangle(triangle.map(corner), colors);
            }
            work.progress.update("drawing", done, topology.places.len() as u64);
            work.stop.check()?;
        }
        Ok(())
    }

    fn surface(&self, provenance: Provenance) -> Surface {
        self.sorted.surface(&self.topology.whole, provenance)
    }
}

/// The standard deviation of normally distributed noise is 1.4826 times its median size; the distance of a point from the
/// mean of six neighbours that are as noisy has a variance 7/6 as large.
const DEVIATION_PER_MEDIAN: f64 = 1.372_6;

const WELDED_VERTICES: &str = "vertices welded because they are equal on the lattice";

/// Whether the stages that were done in `scratch` can be resumed: the mesh was read to the end, and the machine has
/// not been restarted since then, which may lose what was written last.
pub fn can_resume(scratch: &Scratch) -> bool {
    let kept = scratch.existing(SESSION).and_then(|file| file.read(0, file.len().min(1024))).ok();
    scratch.length("spool.json").is_some() && kept.is_some_and(|kept| kept == session().as_bytes())
}

/// Tells one run of the machine from another, where the system does (Linux).
fn session() -> String {
    std::fs::read_to_string("/proc/sys/kernel/random/boot_id").unwrap_or_default()
}

/// Name of the file that says in which run of the machine the stages were done.
const SESSION: &str = "session";

/// Stages that were done are not done again.
struct Stages<'a> {
    work: &'a Work<'a>,
    /// Files written by stages of an earlier process. They are checked before they are used, unless their parts have
    /// checksums of their own, which are checked as they are read: of such a file only the length is known here.
    unchecked: BTreeMap<String, Sum>,
}

/// The result of a finished stage: its state, and the lengths of its files.
#[derive(Serialize, Deserialize)]
struct Done<T> {
    state: T,
    files: BTreeMap<String, Sum>,
}

impl Stages<'_> {
    /// The state of stage `name`: read from its JSON, or computed by running it, which writes the files `outputs`, whose
    /// parts have checksums. Its input files are removed afterwards.
    fn run<T: Serialize + DeserializeOwned>(
        &mut self,
        name: &str,
        inputs: &[impl AsRef<str>],
        outputs: &[impl AsRef<str>],
        stage: impl FnOnce() -> Result<T, BuildError>,
    ) -> Result<T, BuildError> {
        let scratch = self.work.scratch;
        let file = format!("{name}.json");
        let state = if scratch.length(&file).is_some() {
            let done: Done<T> = read_line(scratch, &file)?;
            self.unchecked.extend(done.files);
            done.state
        } else {
            for input in inputs {
                if let Some(sum) = self.unchecked.get(input.as_ref()) {
                    sum.check(scratch, input.as_ref(), self.work.stop)?;
                }
            }
            let state = stage()?;
            let length = |name: &str| Some((name.to_owned(), Sum::length(scratch, name)?));
            let files = outputs.iter().filter_map(|output| length(output.as_ref())).collect();
            let done = Done { state, files };
            write_line(scratch, &file, &done)?;
            done.state
        };
        for input in inputs {
            scratch.remove(input.as_ref())?;
        }
        Ok(state)
    }
}

/// Read a file of one checksummed line of JSON.
fn read_line<T: DeserializeOwned>(scratch: &Scratch, name: &str) -> Result<T, ScratchError> {
    let file = scratch.existing(name)?;
    let damaged = |why: String| ScratchError::damaged(&scratch.path(name), why);
    let text = String::from_utf8(file.read(0, file.len())?).map_err(|e| damaged(e.to_string()))?;
    let json = text.strip_suffix('\n').and_then(unseal).ok_or_else(|| damaged("its checksum differs".to_owned()))?;
    serde_json::from_str(json).map_err(|e| damaged(e.to_string()))
}

fn write_line(scratch: &Scratch, name: &str, what: &impl Serialize) -> Result<(), ScratchError> {
    let path = scratch.path(name);
    let line = seal(&serde_json::to_vec(what).map_err(|e| ScratchError::damaged(&path, e.to_string()))?);
    scratch.write(name, &line)
}

/// Whether a file of the scratch folder belongs to the ingest.
pub fn is_file_of_ingest(name: &str) -> bool {
    let stages = ["spool", "resolve", "scatter", "islands", "topology", "leaves"];
    let is_state = name.strip_suffix(".json").is_some_and(|stage| stages.contains(&stage));
    is_state || name.starts_with("scalar-") || FILES.contains(&name)
}

const FILES: [&str; 18] = [
    SESSION,
    spool::POSITIONS,
    spool::COLORS,
    spool::NORMALS,
    spool::TRIANGLES,
    spool::TRIANGLES_HIGH,
    spool::TRIANGLE_COLORS,
    corners::CORNERS,
    scatter::BUCKETS,
    scatter::HALO,
    islands::MARKS,
    islands::KEPT_BUCKETS,
    islands::KEPT_HALO,
    components::LINKS,
    topology::WELDED,
    topology::REPLIES,
    LEAVES,
    SHARED,
];
