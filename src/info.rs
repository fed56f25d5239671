//! `kilwa info`: what a pack says of itself, from its header, metadata, directory and the tables of patches; no geometry is
//! read. Of a mesh: what it is, without building anything of it.

mod mesh;
mod patches;
mod picture;

use crate::build::report::spread;
use crate::inputs::InputArgs;
use crate::source::open_pack;
use glam::DVec3;
use kilwa_formats::{Up, read};
use kilwa_geometry::LengthUnit;
use kilwa_pack::plural::plural;
use kilwa_pack::visible::visible;
use kilwa_pack::{DirectoryEntry, Header, Metadata};
use patches::Patches;
use picture::Picture;
use serde::Serialize;
use std::fmt::Write as _;
use std::io::Write as _;
use std::path::PathBuf;

/// Describe a pack: size, position, precision, levels of detail, sources. Or describe a mesh before it is
/// built: borders, components, edges, noise, necessary repairs.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The pack, or a mesh (PLY, OBJ, STL, glTF, Nexus, 3D Tiles, a ZIP download from Sketchfab).
    file: PathBuf,
    /// Units of a mesh: m, dm, cm, mm, km, ft, us-ft, in (default: m).
    #[arg(long, value_parser = crate::inputs::units)]
    units: Option<LengthUnit>,
    /// Axis that points up in a mesh: z or y (default: z for PLY, OBJ and STL, y for glTF).
    #[arg(long, value_parser = crate::inputs::up)]
    up: Option<Up>,
    /// Read files outside a mesh's own folder if it names them. Only for meshes that you trust.
    #[arg(long)]
    allow_outside: bool,
    /// Draw the mesh to this PNG file, in the orientation that it would have in a pack.
    #[arg(long, value_name = "FILE.png")]
    picture: Option<PathBuf>,
    /// Replace an existing picture.
    #[arg(long, requires = "picture")]
    force: bool,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

/// One row of the table of levels.
#[derive(Serialize)]
struct Level {
    /// `root`, or the level of the diamonds.
    #[serde(rename = "level")]
    name: String,
    chunks: u64,
    triangles: u64,
    bytes: u64,
    /// Smallest and largest certified error, in metres, of what is shown while these diamonds are not refined; none for
    /// the root, which always is.
    errors: Option<(f32, f32)>,
}

#[derive(Serialize)]
struct Info<'a> {
    file: String,
    format: String,
    bytes: u64,
    bytes_per_input_triangle: f64,
    stored_triangles: u64,
    stored_vertices: u64,
    stored_per_input_triangle: f64,
    lattice_origin: DVec3,
    lattice_step: f64,
    colors: bool,
    chunks: u32,
    #[serde(flatten)]
    patches: Patches,
    levels: Vec<Level>,
    metadata: &'a Metadata,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    // What is wrong with an archive is said when it is read as a mesh.
    if read::archive::is_archive(&args.file) || read::recognise(&args.file).is_ok() {
        let input = InputArgs {
            inputs: vec![args.file.clone()],
            units: args.units,
            up: args.up,
            origin: None,
            transform: None,
            texture_detail: None,
            allow_outside: args.allow_outside,
            unmasked: false,
            stores: None,
        };
        let picture = args.picture.as_deref().map(|path| Picture { path, replace: args.force });
        return mesh::run(&input, picture, args.json);
    }
    anyhow::ensure!(args.picture.is_none(), "--picture draws a mesh; `kilwa render` draws a pack");
    let reader = open_pack(&args.file)?;
    let header = reader.header();
    let per_input = |x: u64| x as f64 / header.triangles.max(1) as f64;
    let (major, minor) = header.version;
    let info = Info {
        file: args.file.display().to_string(),
        format: format!("{major}.{minor}"),
        bytes: header.file_bytes,
        bytes_per_input_triangle: per_input(header.file_bytes),
        stored_triangles: header.stored_triangles,
        stored_vertices: header.stored_vertices,
        stored_per_input_triangle: per_input(header.stored_triangles),
        lattice_origin: header.lattice.origin,
        lattice_step: header.lattice.step(),
        colors: header.attributes.colors,
        chunks: header.entry_count,
        patches: patches::of(&reader)?,
        levels: levels(reader.entries()),
        metadata: reader.metadata(),
    };
    if args.json {
        writeln!(crate::terminal::out(), "{}", crate::terminal::json_text(&info)?)?;
    } else {
        write!(crate::terminal::out(), "{}", words(&info, header))?;
    }
    Ok(())
}

fn levels(entries: &[DirectoryEntry]) -> Vec<Level> {
    let mut rows: Vec<Level> = Vec::new();
    for (i, e) in entries.iter().enumerate() {
        let name = if i == 0 { "root".to_owned() } else { e.level.to_string() };
        if rows.last().is_none_or(|row| row.name != name) {
            rows.push(Level { name, chunks: 0, triangles: 0, bytes: 0, errors: None });
        }
        let Some(row) = rows.last_mut() else { continue };
        row.chunks += 1;
        row.triangles += u64::from(e.triangles);
        row.bytes += u64::from(e.encoded_bytes);
        if i > 0 {
            let (low, high) = row.errors.unwrap_or((e.error, e.error));
            row.errors = Some((low.min(e.error), high.max(e.error)));
        }
    }
    rows
}

fn words(info: &Info<'_>, header: &Header) -> String {
    let m = info.metadata;
    let mut out = String::new();
    let mut line = |name: &str, value: String| {
        let _ = writeln!(out, "{name:<14}{}", visible(&value));
    };
    line("title", m.title.clone());
    if header.is_of_points() {
        line("points", grouped(m.vertices));
    } else {
        line("triangles", grouped(m.triangles));
        line("vertices", grouped(m.vertices));
        line("border edges", grouped(m.border_edges));
    }
    let size = m.bounds_max - m.bounds_min;
    line("size", format!("{} x {} x {}", metres(size.x), metres(size.y), metres(size.z)));
    // As many digits as the lattice has.
    let digits = (-info.lattice_step.log10()).ceil().clamp(0.0, 9.0) as usize;
    let corner = |c: DVec3| format!("{:.digits$} {:.digits$} {:.digits$}", c.x, c.y, c.z);
    line("from", format!("{} m", corner(m.bounds_min)));
    line("to", format!("{} m", corner(m.bounds_max)));
    line("crs", m.crs.clone().unwrap_or_else(|| "unknown (local coordinates)".to_owned()));
    line("step", format!("{} (2^{} m)", metres(info.lattice_step), header.lattice.step_log2));
    line("median edge", metres(m.median_edge));
    if let Some(accuracy) = m.capture_accuracy {
        let standard = format!("{} (standard uncertainty of the capture", metres(accuracy));
        let parts = m.capture_parts().map(|parts| {
            let [registration, instrument] = parts.map(metres);
            format!(": registration {registration}, instrument {instrument}")
        });
        line("accuracy", format!("{standard}{})", parts.unwrap_or_default()));
    }
    let mut attributes = vec!["normals".to_owned()];
    if info.colors {
        attributes.insert(0, "colours".to_owned());
    }
    attributes.extend(m.scalars.iter().map(|s| format!("{} ({} to {})", s.name, s.min, s.max)));
    line("attributes", attributes.join(", "));
    line("file", format!("{} {}, format {}", grouped(info.bytes), plural(info.bytes, "byte", "bytes"), info.format));
    line(
        "density",
        format!(
            "{:.2} bytes per input triangle; {:.2} triangles stored for each",
            info.bytes_per_input_triangle, info.stored_per_input_triangle
        ),
    );
    let parts = &info.patches;
    line("patches", spread(&parts.patch_triangles));
    line("chunks", spread(&parts.chunk_triangles));
    if parts.stuck_diamonds > 0 {
        line("stuck", stuck_words(parts));
    }
    for source in &m.sources {
        let (bytes, unit) = (grouped(source.bytes), plural(source.bytes, "byte", "bytes"));
        line("source", format!("{} ({bytes} {unit}, sha256 {})", source.name, source.sha256));
    }
    line("source units", format!("{}, {} up", m.source_units, m.source_up));
    line("made by", m.tool.clone());
    for (option, value) in &m.options {
        line("option", format!("{option} = {value}"));
    }
    if m.repairs.is_empty() {
        line("repairs", "none".to_owned());
    }
    for (reason, count) in &m.repairs {
        line("repair", format!("{reason}: {}", grouped(*count)));
    }
    out.push('\n');
    out += &table(&info.levels);
    out
}

/// How much of the surface could not be simplified.
fn stuck_words(patches: &Patches) -> String {
    let (places, triangles) = (patches.stuck_diamonds, patches.stuck_triangles);
    format!(
        "{} {} {} {} at coarser levels",
        grouped(places),
        plural(places, "place could not be simplified and keeps its", "places could not be simplified and keep their"),
        grouped(triangles),
        plural(triangles, "triangle", "triangles")
    )
}

/// The levels, coarse to fine.
fn table(levels: &[Level]) -> String {
    let mut out =
        format!("{:>5} {:>9} {:>14} {:>15}  {}\n", "level", "chunks", "triangles", "bytes", "certified error");
    for l in levels {
        let errors = match l.errors {
            None => "always refined".to_owned(),
            Some((low, high)) if low == high => metres(f64::from(low)),
            Some((low, high)) => format!("{} to {}", metres(f64::from(low)), metres(f64::from(high))),
        };
        let _ = writeln!(
            out,
            "{:>5} {:>9} {:>14} {:>15}  {errors}",
            l.name,
            grouped(l.chunks),
            grouped(l.triangles),
            grouped(l.bytes)
        );
    }
    out
}

/// A length in the unit that reads best.
pub(crate) fn metres(x: f64) -> String {
    let a = x.abs();
    if a == 0.0 {
        "0 m".to_owned()
    } else if a >= 1.0 {
        format!("{x:.3} m")
    } else if a >= 1e-3 {
        format!("{:.3} mm", x * 1e3)
    } else if a >= 1e-7 {
        format!("{:.4} mm", x * 1e3)
    } else {
        format!("{x:.3e} m")
    }
}

/// Digits in groups of three.
pub(crate) fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut out = String::with_capacity(digits.len() + digits.len() / 3);
    for (i, d) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(d);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_readable() {
        assert_eq!(grouped(0), "0");
        assert_eq!(grouped(999), "999");
        assert_eq!(grouped(1_234_567), "1,234,567");
        assert_eq!(metres(0.000_122), "0.1220 mm");
        assert_eq!(metres(12.3456), "12.346 m");
        assert_eq!(metres(0.0123), "12.300 mm");
    }
}
