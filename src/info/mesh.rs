//! `kilwa info MESH`: what a mesh is, without building anything of it: what was read, joined, dropped and why; borders,
//! components, edges, noise. Scratch files go to the folder for temporary files.

use super::metres;
use super::picture::{Drawing, Picture};
use crate::build::report::duplicates;
use crate::inputs::{InputArgs, Inputs};
use crate::plausible::{self, Model, ReadAs};
use crate::progress::Bar;
use kilwa_builder::build::machine;
use kilwa_builder::build::work::{Stop, Work};
use kilwa_builder::ingest::surface::Surface;
use kilwa_builder::ingest::{self, IngestOptions, Spool, TriangleVisitor};
use kilwa_builder::scratch::Scratch;
use kilwa_builder::{BuildOptions, Inputs as _, Precision, Provenance};
use kilwa_pack::plural::counted;
use serde::Serialize;
use std::io::Write;
use std::path::Path;

/// The report for machines.
#[derive(Serialize)]
struct Report<'a> {
    #[serde(flatten)]
    surface: &'a Surface,
    read_as: String,
    warnings: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    picture: Option<String>,
}

/// Report on the mesh in a file, and draw it if asked to.
pub(super) fn run(input: &InputArgs, picture: Option<Picture<'_>>, json: bool) -> anyhow::Result<()> {
    if let Some(picture) = &picture {
        picture.check(&input.inputs)?;
    }
    let mut inputs = Inputs::find(input, false)?;
    let read = ReadAs { units: input.units, given_up: input.up, up: inputs.up(), crs: None };
    let (scratch, stop, bar) = (Scratch::temporary()?, Stop::default(), Bar::new());
    let threads = rayon::current_num_threads();
    let work = Work { scratch: &scratch, memory: machine::default_budget(), threads, stop: &stop, progress: &bar };
    let mut drawing = picture.as_ref().map(|_| Drawing::new());
    let surface = survey(&mut inputs, &work, drawing.as_mut());
    bar.clear();
    let surface = surface?;
    if let (Some(picture), Some(drawing)) = (&picture, drawing) {
        picture.write(&drawing.finish())?;
    }
    let bounds = surface.bounds.map(|p| surface.lattice.world_from_lattice(p));
    let is_closed = surface.border_edges == 0;
    let model = Model { bounds, facing: surface.facing, is_closed, diagnostics: &surface.diagnostics };
    let report = Report {
        surface: &surface,
        read_as: read.words(),
        warnings: plausible::warnings(&model, &read),
        picture: picture.map(|p| p.path.display().to_string()),
    };
    let mut out = crate::terminal::out();
    if json {
        writeln!(out, "{}", crate::terminal::json_text(&report)?)?;
    } else {
        words(&inputs.names(), &report, &mut out)?;
    }
    Ok(())
}

fn survey(inputs: &mut Inputs, work: &Work<'_>, drawing: Option<&mut Drawing>) -> anyhow::Result<Surface> {
    let mut spool = Spool::create(work.scratch, Path::new("mesh"))?;
    let Provenance { sources, .. } = inputs.deliver(&mut spool, work)?;
    let options = IngestOptions {
        leaf_triangles: BuildOptions::default().leaf_triangles,
        step: None,
        crop: None,
        min_confidence: None,
        drop_islands_below: None,
        precision: Precision::default(),
    };
    let visitor = drawing.map(|drawing| drawing as &mut dyn TriangleVisitor);
    let mut surface = ingest::survey(work, spool.finish()?, &options, visitor)?;
    surface.sources = sources;
    Ok(surface)
}

fn words(names: &str, report: &Report<'_>, out: &mut impl Write) -> std::io::Result<()> {
    let s = report.surface;
    let [min, max] = s.bounds.map(|p| s.lattice.world_from_lattice(p));
    let size = max - min;
    let (triangles, vertices) =
        (counted(s.triangles, "triangle", "triangles"), counted(s.points, "vertex", "vertices"));
    writeln!(out, "{names}: {triangles}, {vertices}")?;
    for warning in &report.warnings {
        writeln!(out, "  warning     {warning}")?;
    }
    writeln!(out, "  read as     {}", report.read_as)?;
    writeln!(out, "  size        {:.3} × {:.3} × {:.3} m", size[0], size[1], size[2])?;
    writeln!(out, "  from        {:.3} {:.3} {:.3} m", min[0], min[1], min[2])?;
    writeln!(out, "  to          {:.3} {:.3} {:.3} m", max[0], max[1], max[2])?;
    writeln!(out, "  edges       median {}, one in a hundred below {}", metres(s.median_edge), metres(s.short_edge))?;
    writeln!(out, "  noise       about {}", metres(s.noise))?;
    writeln!(out, "  borders     {}", counted(s.border_edges, "edge", "edges"))?;
    writeln!(
        out,
        "  components  {}, the largest of {}",
        s.components,
        counted(s.largest_component, "triangle", "triangles")
    )?;
    writeln!(out, "  not clean   {} used by more than two triangles", counted(s.non_manifold_edges, "edge", "edges"))?;
    writeln!(out, "              {} of two triangles that face apart", counted(s.inconsistent_edges, "edge", "edges"))?;
    writeln!(out, "              {}", duplicates(s.duplicate_triangles))?;
    writeln!(out, "  colours     {}", plausible::colors(&s.colored_by, s.points, s.triangles, false))?;
    for c in &s.scalars {
        writeln!(out, "  channel     {}, {} to {}", c.name, c.min, c.max)?;
    }
    writeln!(out, "  a pack would have a lattice spacing of {}", metres(s.lattice.step()))?;
    for (kind, f) in s.diagnostics.iter().filter(|(kind, _)| !plausible::is_warning(kind)) {
        let places = if f.places.is_empty() { String::new() } else { format!(" (first: {})", f.places.join("; ")) };
        writeln!(out, "  {:>9} {kind}{places}", f.count)?;
    }
    if let Some(picture) = &report.picture {
        writeln!(out, "  drawn to    {picture}")?;
    }
    Ok(())
}
