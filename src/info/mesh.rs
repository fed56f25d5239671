//! `kilwa info MESH`: what a mesh is, without building anything of it: what was read, joined, dropped and why; borders,
//! components, edges, noise. Scratch files go to the folder for temporary files.

use super::metres;
use crate::build::report::duplicates;
use crate::inputs::{InputArgs, Inputs};
use crate::progress::Bar;
use kilwa_builder::Precision;
use kilwa_builder::build::machine;
use kilwa_builder::build::work::{Stop, Work};
use kilwa_builder::ingest::surface::Surface;
use kilwa_builder::ingest::{self, IngestOptions, Spool};
use kilwa_builder::scratch::Scratch;
use kilwa_builder::{BuildOptions, Inputs as _};
use kilwa_pack::plural::counted;
use std::io::Write;
use std::path::Path;

/// Report on the mesh in a file.
pub(super) fn run(input: &InputArgs, json: bool) -> anyhow::Result<()> {
    let mut inputs = Inputs::find(input)?;
    let (scratch, stop, bar) = (Scratch::temporary()?, Stop::default(), Bar::new());
    let threads = rayon::current_num_threads();
    let work = Work { scratch: &scratch, memory: machine::default_budget(), threads, stop: &stop, progress: &bar };
    let surface = survey(&mut inputs, &work);
    bar.clear();
    let surface = surface?;
    let mut out = crate::terminal::out();
    if json {
        writeln!(out, "{}", crate::terminal::json_text(&surface)?)?;
    } else {
        words(&inputs.names(), &surface, &mut out)?;
    }
    Ok(())
}

fn survey(inputs: &mut Inputs, work: &Work<'_>) -> anyhow::Result<Surface> {
    let mut spool = Spool::create(work.scratch, Path::new("mesh"))?;
    let sources = inputs.deliver(&mut spool, work)?;
    let options = IngestOptions {
        leaf_triangles: BuildOptions::default().leaf_triangles,
        step: None,
        crop: None,
        min_confidence: None,
        drop_islands_below: None,
        precision: Precision::default(),
    };
    let mut surface = ingest::survey(work, spool.finish()?, &options)?;
    surface.sources = sources;
    Ok(surface)
}

fn words(names: &str, s: &Surface, out: &mut impl Write) -> std::io::Result<()> {
    let [min, max] = s.bounds.map(|p| s.lattice.world_from_lattice(p));
    let size = max - min;
    let (triangles, vertices) =
        (counted(s.triangles, "triangle", "triangles"), counted(s.points, "vertex", "vertices"));
    writeln!(out, "{names}: {triangles}, {vertices}")?;
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
    writeln!(out, "  colours     {}", if s.colors { "yes" } else { "none" })?;
    for c in &s.scalars {
        writeln!(out, "  channel     {}, {} to {}", c.name, c.min, c.max)?;
    }
    writeln!(out, "  a pack would have a lattice spacing of {}", metres(s.lattice.step()))?;
    for (kind, f) in &s.diagnostics {
        let places = if f.places.is_empty() { String::new() } else { format!(" (first: {})", f.places.join("; ")) };
        writeln!(out, "  {:>9} {kind}{places}", f.count)?;
    }
    Ok(())
}
