//! What a build prints when it is done.

use super::Args;
use super::need::Need;
use crate::info::metres;
use crate::plausible::{self, Model, ReadAs};
use kilwa_builder::build::machine;
use kilwa_builder::{BuildReport, Spread, StageTime};
use kilwa_files::size::binary;
use kilwa_pack::plural::{counted, plural};
use serde::Serialize;
use std::io::Write;
use std::path::Path;

/// The report for machines.
#[derive(Serialize)]
pub(super) struct Report<'a> {
    #[serde(flatten)]
    pub(super) build: &'a BuildReport,
    /// How the inputs were read.
    pub(super) read_as: String,
    /// The line about colours.
    pub(super) colors: String,
    /// What is doubtful.
    pub(super) warnings: Vec<String>,
    pub(super) run: Spent,
    /// The merge of the survey that was built, if this run did it.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) merge: Option<serde_json::Value>,
}

impl<'a> Report<'a> {
    pub(super) fn of(build: &'a BuildReport, run: Spent, read: &ReadAs<'_>, args: &Args) -> Self {
        let is_split = args.shaping.input.texture_detail.is_some();
        let merge = args.merging.as_ref().and_then(|merging| merging.figures());
        let bounds = [build.bounds_min, build.bounds_min + build.extent];
        let is_closed = build.border_edges == 0;
        let model = Model { bounds, facing: build.facing, is_closed, diagnostics: &build.diagnostics };
        let colors = plausible::colors(&build.colored_by, build.vertices, build.triangles, is_split);
        Self { build, read_as: read.words(), colors, warnings: plausible::warnings(&model, read), run, merge }
    }
}

/// What the build took.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Spent {
    /// The budget, bytes.
    memory_bytes: u64,
    /// The most memory that the process held, bytes, where the system says.
    peak_memory_bytes: Option<u64>,
    /// Threads.
    threads: usize,
    seconds: f64,
    /// Processor time of all threads, where the system says.
    cpu_seconds: Option<f64>,
    triangles_per_second: f64,
    triangles_per_cpu_second: Option<f64>,
    /// Disk space estimated beforehand.
    estimated: Need,
}

impl Spent {
    pub(super) fn of(build: &BuildReport, memory: u64, threads: usize, estimated: Need, seconds: f64) -> Self {
        let cpu_seconds = machine::cpu_seconds();
        let rate = |s: f64| build.triangles as f64 / s.max(1e-3);
        Self {
            memory_bytes: memory,
            peak_memory_bytes: machine::peak_memory(),
            threads,
            seconds,
            cpu_seconds,
            triangles_per_second: rate(seconds),
            triangles_per_cpu_second: cpu_seconds.map(rate),
            estimated,
        }
    }
}

/// A certified bound, rounded up: what is printed is a bound too.
fn bound(metres: f64) -> String {
    if metres >= 1.0 {
        format!("{:.3} m", (metres * 1e3).ceil() / 1e3)
    } else {
        format!("{:.3} mm", (metres * 1e6).ceil() / 1e3)
    }
}

/// How many triangles the parts of a pack have.
pub(crate) fn spread(s: &Spread) -> String {
    format!(
        "{} of {} to {}, median {}; 5 % have {} or fewer, 5 % have {} or more",
        s.count,
        s.smallest,
        counted(s.largest, "triangle", "triangles"),
        s.median,
        s.percent_5,
        s.percent_95
    )
}

/// Triangles that are there more than once.
pub(crate) fn duplicates(n: u64) -> String {
    if n == 0 {
        return "no duplicate triangles".to_owned();
    }
    counted(n, "duplicate triangle", "duplicate triangles").to_string()
}

/// For people, of a pack of points.
fn print_points(output: &Path, r: &Report<'_>, points: u64, out: &mut impl Write) -> std::io::Result<()> {
    let (b, p) = (r.build, &r.build.pack);
    writeln!(out, "{}: {}", output.display(), counted(points, "point", "points"))?;
    writeln!(out, "  size      {:.3} × {:.3} × {:.3} m", b.extent.x, b.extent.y, b.extent.z)?;
    writeln!(out, "  lattice   steps of {}; median spacing of the points {}", metres(b.step), metres(b.median_edge))?;
    for (kind, found) in &b.diagnostics {
        writeln!(out, "  found     {}: {}", kind, found.count)?;
    }
    writeln!(
        out,
        "  pack      {}, {:.2} per point; {} in {}; coarsest form {}, within {}",
        counted(p.bytes, "byte", "bytes"),
        p.bytes as f64 / points.max(1) as f64,
        counted(p.chunks, "chunk", "chunks"),
        counted(p.levels, "level", "levels"),
        counted(p.root_triangles / 2, "point", "points"),
        bound(p.root_error)
    )?;
    spent(r, out)
}

/// For people.
pub(super) fn print(output: &Path, r: &Report<'_>, out: &mut impl Write) -> std::io::Result<()> {
    let (b, p) = (r.build, &r.build.pack);
    if let Some(points) = b.points {
        return print_points(output, r, points, out);
    }
    writeln!(
        out,
        "{}: {}, {}",
        output.display(),
        counted(b.triangles, "triangle", "triangles"),
        counted(b.vertices, "vertex", "vertices")
    )?;
    for warning in &r.warnings {
        writeln!(out, "  warning   {warning}")?;
    }
    writeln!(out, "  read as   {}", r.read_as)?;
    writeln!(out, "  size      {:.3} × {:.3} × {:.3} m", b.extent.x, b.extent.y, b.extent.z)?;
    writeln!(out, "  colours   {}", r.colors)?;
    writeln!(
        out,
        "  lattice   steps of {}; median edge {}, one in a hundred below {}; noise about {}",
        metres(b.step),
        metres(b.median_edge),
        metres(b.short_edge),
        metres(b.noise)
    )?;
    writeln!(
        out,
        "  borders   {}; {} used by more than two triangles, {} by two that face apart",
        counted(b.border_edges, "edge", "edges"),
        counted(b.non_manifold_edges, "edge", "edges"),
        b.inconsistent_edges
    )?;
    writeln!(
        out,
        "  parts     {}, the largest of {}; {}",
        counted(b.components, "component", "components"),
        counted(b.largest_component, "triangle", "triangles"),
        duplicates(b.duplicate_triangles)
    )?;
    writeln!(
        out,
        "  pack      {}, {:.2} per triangle; {} in {}; coarsest form {}, within {}",
        counted(p.bytes, "byte", "bytes"),
        p.bytes as f64 / b.triangles as f64,
        counted(p.chunks, "chunk", "chunks"),
        counted(p.levels, "level", "levels"),
        counted(p.root_triangles, "triangle", "triangles"),
        bound(p.root_error)
    )?;
    writeln!(out, "  patches   {}", spread(&p.patch_triangles))?;
    writeln!(out, "  chunks    {}", spread(&p.chunk_triangles))?;
    spent(r, out)?;
    for (kind, f) in b.diagnostics.iter().filter(|(kind, _)| !plausible::is_warning(kind)) {
        let places = if f.places.is_empty() { String::new() } else { format!(" (first: {})", f.places.join("; ")) };
        writeln!(out, "  {:>9} {kind}{places}", f.count)?;
    }
    if b.overfull_leaves > 0 {
        let places = plural(b.overfull_leaves, "place", "places");
        writeln!(out, "  {:>9} {places} too dense to divide further, kept whole", b.overfull_leaves)?;
    }
    if b.stuck_diamonds > 0 {
        writeln!(
            out,
            "  {:>9} {} {} at coarser levels",
            b.stuck_diamonds,
            plural(
                b.stuck_diamonds,
                "place that could not be simplified and keeps its",
                "places that could not be simplified and keep their"
            ),
            counted(b.stuck_triangles, "triangle", "triangles")
        )?;
    }
    Ok(())
}

fn spent(r: &Report<'_>, out: &mut impl Write) -> std::io::Result<()> {
    let (b, s) = (r.build, &r.run);
    let levels = |t: &&StageTime| t.stage.starts_with("level-");
    let mut parts: Vec<String> = Vec::new();
    for t in b.stages.iter().filter(|t| !levels(t)) {
        if t.stage == "assemble" {
            // An empty sum is -0.
            let sum = b.stages.iter().filter(levels).map(|t| t.seconds).fold(0.0, |sum, s| sum + s);
            parts.push(format!("levels {sum:.1}"));
        }
        parts.push(format!("{} {:.1}", t.stage, t.seconds));
    }
    let cpu = s.cpu_seconds.map_or_else(String::new, |c| format!("; {c:.1} s of processor time"));
    // A point has two triangles.
    let (unit, parts_of) = if b.points.is_some() { ("point", 2.0) } else { ("triangle", 1.0) };
    let rate = |t: f64| format!(", {:.0} {unit}s in each", t / parts_of);
    let rate = s.triangles_per_cpu_second.map_or_else(String::new, rate);
    writeln!(out, "  time      {:.1} s ({}){cpu}{rate}", s.seconds, parts.join(", "))?;
    let peak = s.peak_memory_bytes.map_or_else(|| "unknown".to_owned(), binary);
    writeln!(
        out,
        "  space     memory {peak} at most, of {} allowed; scratch files {} at most, {:.0} bytes per {unit}",
        binary(s.memory_bytes),
        binary(b.scratch_peak_bytes),
        b.scratch_peak_bytes as f64 / b.triangles as f64 * parts_of
    )?;
    if let Some(stage) = &b.resumed_after {
        writeln!(out, "  resumed   after stage {stage}")?;
    }
    for file in &b.redone {
        writeln!(out, "  redone    the scratch file {file} was damaged: its stage was done again")?;
    }
    Ok(())
}
