//! Saved measurements: adding to a document, measuring all of a document again, writing it in other formats.

use super::place::{self, Place};
use super::report::Report;
use super::{Subject, cutting, whole};
use crate::new_file::NewFile;
use anyhow::Context;
use kilwa_measure::{Document, Measurement, PackName, PointTool, Task, ToolName};
use serde_json::json;
use std::io::Write;
use std::path::{Path, PathBuf};

/// A document and what to do with it.
#[derive(clap::Args)]
pub(crate) struct AgainArgs {
    /// The document of measurements (.json).
    file: PathBuf,
    /// Write it in another format too: .csv, .geojson or .dxf.
    #[arg(short, long)]
    output: Option<PathBuf>,
    /// Replace an existing file.
    #[arg(long)]
    force: bool,
    /// Print a sentence to cite for each measurement.
    #[arg(long)]
    cite: bool,
}

/// What the pack is called in a document.
fn pack_name(s: &Subject) -> PackName {
    let metadata = s.pack.metadata();
    PackName {
        identity: s.pack.identity(),
        title: metadata.title.clone(),
        lattice: s.pack.header().lattice,
        crs: metadata.crs.clone(),
    }
}

fn read(path: &Path) -> anyhow::Result<Document> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    Document::parse(&bytes).with_context(|| path.display().to_string())
}

/// Replace or make a file at once: a reader never sees half of it.
pub(super) fn write_whole(path: &Path, text: &str, replace: bool) -> anyhow::Result<()> {
    let mut file = NewFile::beside(path)?;
    file.file().write_all(text.as_bytes()).with_context(|| format!("cannot write {}", path.display()))?;
    file.name(path, replace)
}

/// Add a measurement to a document, which is made where it is not there.
pub(super) fn save(s: &Subject, report: &Report, to: &Path, name: Option<&str>) -> anyhow::Result<()> {
    let pack = pack_name(s);
    let mut document = if to.exists() { read(to)? } else { Document::new(pack.clone()) };
    anyhow::ensure!(
        document.pack.identity == pack.identity,
        "{} holds measurements of another pack ({}, {}); give another file",
        to.display(),
        document.pack.title,
        document.pack.identity
    );
    let task = report.task().clone();
    let default = format!("{} {}", task.tool.name(), document.measurements.len() + 1);
    document.measurements.push(Measurement {
        name: name.map_or(default, str::to_owned),
        task,
        readings: report.readings().to_vec(),
        uncertainty: s.point,
        color: None,
        hidden: false,
        note: String::new(),
    });
    write_whole(to, &document.to_json(), true)
}

/// Measure everything of a document again. True where all values are the same to the last bit.
pub(super) fn again(s: &Subject, args: &AgainArgs, as_json: bool) -> anyhow::Result<bool> {
    let document = read(&args.file)?;
    let ending = args.output.as_deref().map(|path| (path, export(&document, path)));
    if let Some((path, text)) = ending {
        let text = text?;
        anyhow::ensure!(args.force || !path.exists(), "{} exists; --force replaces it", path.display());
        write_whole(path, &text, args.force)?;
    }
    let here = pack_name(s);
    let same_pack = document.pack.identity == here.identity;
    let mut out = std::io::stdout().lock();
    let (mut rows, mut differing) = (Vec::new(), 0);
    for m in &document.measurements {
        let task = on_this_lattice(&m.task, &document.pack, s);
        let now = measure(s, &task).map_err(|e| format!("{e:#}"));
        let same = now.as_ref().is_ok_and(|r| r.readings() == m.readings);
        differing += usize::from(!same);
        rows.push(json!({
            "name": m.name,
            "tool": m.task.tool,
            "same": same,
            "saved": m.readings,
            "now": now.as_ref().ok().map(Report::readings),
            "refused": now.as_ref().err(),
        }));
        if as_json {
            continue;
        }
        writeln!(out, "{} ({}): {}", m.name, m.task.tool.name(), if same { "the same" } else { "DIFFERENT" })?;
        for (i, r) in m.readings.iter().enumerate() {
            let text = r.text(s.unit);
            match now.as_ref().ok().and_then(|n| n.readings().get(i)).filter(|_| !same) {
                Some(other) => writeln!(out, "  {:24} {text}, now {}", r.name, other.text(s.unit))?,
                None => writeln!(out, "  {:24} {text}", r.name)?,
            }
        }
        if let Err(why) = &now {
            writeln!(out, "  {why}")?;
        }
        if args.cite {
            writeln!(out, "  {}", m.citation(&document.pack, concat!("Kilwa ", env!("CARGO_PKG_VERSION"))))?;
        }
    }
    if as_json {
        let all = json!({ "pack": here, "saved_pack": document.pack, "same_pack": same_pack, "measurements": rows });
        serde_json::to_writer_pretty(&mut out, &all)?;
        writeln!(out)?;
    } else if !same_pack {
        writeln!(
            out,
            "The measurements were made on another pack: {} ({}).",
            document.pack.title, document.pack.identity
        )?;
    }
    if differing > 0 && !as_json {
        writeln!(out, "{differing} of {} measurements differ.", document.measurements.len())?;
    }
    Ok(differing == 0)
}

/// The task with points counted from this pack's lattice origin, where the document's is another.
fn on_this_lattice(task: &Task, saved: &PackName, s: &Subject) -> Task {
    let here = s.pack.header().lattice;
    if saved.lattice.origin == here.origin {
        return task.clone();
    }
    let shift: [f64; 3] = std::array::from_fn(|i| saved.lattice.origin[i] - here.origin[i]);
    let moved = |p: [f64; 3]| std::array::from_fn(|i| p[i] + shift[i]);
    let mut task = task.clone();
    task.local.iter_mut().for_each(|p| *p = moved(*p));
    if let Some(plane) = &mut task.plane {
        plane.point = moved(plane.point);
    }
    task
}

/// One task again.
fn measure(s: &Subject, task: &Task) -> anyhow::Result<Report> {
    let on_points = |tool: PointTool| -> anyhow::Result<Report> {
        Ok(Report::new(task.clone(), tool.measure(&task.local, &s.space, &s.point)?))
    };
    // Which way the surface faces is looked up where the points are; the points stay.
    let places = || -> anyhow::Result<Vec<Place>> {
        task.local.iter().map(|p| place::facing_at(&s.pack, &s.space, *p)).collect()
    };
    match task.tool {
        ToolName::Coordinate => on_points(PointTool::Coordinate),
        ToolName::Distance => on_points(PointTool::Distance),
        ToolName::Perimeter => on_points(PointTool::Perimeter),
        ToolName::Along => {
            let mut report = on_points(PointTool::Distance)?;
            cutting::along(s, &places()?, &mut report)?;
            Ok(report)
        }
        ToolName::Angle => on_points(PointTool::Angle),
        ToolName::PlaneAngle => on_points(PointTool::PlaneAngle),
        ToolName::Height => on_points(PointTool::Height),
        ToolName::Circle => on_points(PointTool::Circle),
        ToolName::Area if task.local.is_empty() => whole::area(s),
        ToolName::Area => whole::polygon_area(s, &places()?, task.reach),
        ToolName::Volume => whole::volume(s),
        ToolName::CutFill => whole::cut_fill(s, &places()?, task.plane, task.reach),
        ToolName::Deviation => whole::deviation(s, &places()?, task.plane, task.reach),
        ToolName::Section => {
            let plane = task.plane.context("the saved section has no plane")?;
            cutting::section(s, plane, &super::output::OutputArgs::none())
        }
        ToolName::Profile => cutting::profile(s, &task.local, &super::output::OutputArgs::none()),
        ToolName::Contours => {
            let interval = task.interval.context("the saved contours have no interval")?;
            cutting::contours(s, interval, &super::output::OutputArgs::none())
        }
    }
}

fn export(document: &Document, path: &Path) -> anyhow::Result<String> {
    let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    match ending.as_deref() {
        Some("csv") => Ok(document.to_csv()),
        Some("geojson") => Ok(document.to_geojson()),
        Some("dxf") => Ok(document.to_dxf()),
        _ => anyhow::bail!("{}: the ending says the format, one of .csv, .geojson, .dxf", path.display()),
    }
}
