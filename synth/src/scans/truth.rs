//! The truth of a survey, in files of its own: poses, and the class of each sample.

use super::stations::Station;
use super::{CLASSES, Class, Poses, ScanOptions};
use glam::{DMat3, DVec3};
use std::fmt::Write as _;

/// The first bytes of a file of classes; two `u32` (columns, rows) follow, then a byte for each sample in the order of the scan.
pub(super) const LABELS: &[u8; 8] = b"KSYNLBL1";

/// One station in the truth.
pub(super) struct Entry<'a> {
    pub(super) station: &'a Station,
    pub(super) name: String,
    pub(super) file: String,
    pub(super) grid: (u32, u32),
    /// The true position, in the coordinates of the poses.
    pub(super) position: DVec3,
    /// The pose that the file has.
    pub(super) written: (DMat3, DVec3),
    /// Number of samples of each class.
    pub(super) counts: [u64; CLASSES],
}

/// The file of poses, as TOML.
pub(super) fn poses(options: &ScanOptions, crs: Option<&str>, entries: &[Entry<'_>]) -> String {
    let mut text = String::from("# The truth of simulated scans (kilwa synth scans). No real place.\n");
    let mut line = |what: std::fmt::Arguments<'_>| {
        let _ = text.write_fmt(what);
        text.push('\n');
    };
    line(format_args!("seed = {}", options.seed));
    line(format_args!("units = \"metre\""));
    if let Some(crs) = crs {
        line(format_args!("crs = \"{crs}\""));
    }
    line(format_args!("noise = {:?}", options.noise));
    if options.trace_every > 1 {
        line(format_args!("trace_every = {}", options.trace_every));
    }
    match options.poses {
        Poses::True => line(format_args!("poses_in_scans = \"true\"")),
        Poses::None => line(format_args!("poses_in_scans = \"none\"")),
        Poses::Rough { position, heading } => {
            line(format_args!("poses_in_scans = \"rough\""));
            line(format_args!("rough_position_sigma_m = {position:?}\nrough_heading_sigma_degrees = {heading:?}"));
            line(format_args!("surveyed = {}", options.surveyed));
        }
    }
    for entry in entries {
        let Entry { station, name, file, grid, position: p, written, counts } = entry;
        line(format_args!("\n[[station]]\nname = \"{name}\"\nfile = \"{file}\"\nlabels = \"{name}.labels\""));
        line(format_args!("instrument = \"{}\"", station.instrument.name));
        line(format_args!("columns = {}\nrows = {}", grid.0, grid.1));
        line(format_args!("indoors = {}", station.indoors));
        line(format_args!("scaffolding_moved = {}", station.later));
        line(format_args!("shared = {:.3}", station.shared));
        line(format_args!("# site_from_scan"));
        line(format_args!("position = [{:.6}, {:.6}, {:.6}]", p.x, p.y, p.z));
        line(format_args!("rotation = {}", rows(&station.rotation)));
        line(format_args!("# as the file has it"));
        let (rotation, q) = written;
        line(format_args!("written_position = [{:.6}, {:.6}, {:.6}]", q.x, q.y, q.z));
        line(format_args!("written_rotation = {}", rows(rotation)));
        line(format_args!("[station.samples]"));
        for class in Class::ALL {
            line(format_args!("{} = {}", class.name(), counts[class as usize]));
        }
    }
    text
}

/// The rows of a matrix that is multiplied by column vectors.
pub(crate) fn rows(m: &DMat3) -> String {
    let row = |k: usize| {
        let [x, y, z] = m.row(k).to_array();
        format!("[{x:.15}, {y:.15}, {z:.15}]")
    };
    format!("[{}, {}, {}]", row(0), row(1), row(2))
}
