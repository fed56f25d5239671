//! What `kilwa colour` prints.

use super::photos::Photographs;
use super::{Args, Done};
use crate::info::grouped;
use kilwa_builder::build::machine;
use kilwa_pack::plural::{counted, plural};
use kilwa_pack::visible::visible;
use kilwa_scan::colour::PhotoReport;
use serde_json::{Value, json};
use std::io::Write as _;

pub(super) fn print(args: &Args, photographs: &Photographs, done: &Done, seconds: f64) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    let report = &done.report;
    let left_out: Vec<(&str, &str)> = photographs
        .left_out
        .iter()
        .map(|(name, why)| (name.as_str(), why.as_str()))
        .chain(report.photos.iter().filter_map(|photo| Some((photo.name.as_str(), photo.left_out.as_deref()?))))
        .collect();
    if args.json {
        let json = json!({
            "output": args.output.display().to_string(),
            "bytes": done.bytes,
            "triangles": done.triangles,
            "vertices": done.vertices,
            "coloured_share": share(report.coloured, report.vertices),
            "places_compared": report.places,
            "brightness": report.brightness,
            "photographs": report.photos.iter().filter(|photo| photo.left_out.is_none()).map(as_json).collect::<Vec<_>>(),
            "left_out": left_out.iter().map(|(name, why)| json!({"name": name, "why": why})).collect::<Vec<_>>(),
            "scratch_bytes": report.scratch,
            "seconds": seconds,
            "cpu_seconds": machine::cpu_seconds(),
            "peak_memory": machine::peak_memory(),
        });
        writeln!(out, "{}", crate::terminal::json_line(&json)?)?;
        return Ok(());
    }
    writeln!(
        out,
        "{}: {} {}, {:.1} % of the vertices coloured from {}.",
        args.output.display(),
        grouped(done.vertices),
        plural(done.vertices, "vertex", "vertices"),
        100.0 * share(report.coloured, report.vertices),
        counted(report.photos.iter().filter(|photo| photo.seen > 0).count() as u64, "photograph", "photographs"),
    )?;
    let blind: Vec<&str> =
        report.photos.iter().filter(|p| p.seen == 0 && p.left_out.is_none()).map(|p| p.name.as_str()).collect();
    for name in blind {
        writeln!(out, "  {} does not see the model.", visible(name))?;
    }
    for (name, why) in left_out {
        writeln!(out, "  {} was left out: {}.", visible(name), visible(why))?;
    }
    Ok(())
}

fn share(part: u64, whole: u64) -> f64 {
    part as f64 / whole.max(1) as f64
}

fn as_json(photo: &PhotoReport) -> Value {
    json!({
        "name": photo.name,
        "seen": photo.seen,
        "share": photo.share,
        "dropped": photo.dropped,
        "gain": photo.gain,
        "offset": photo.offset,
        "corner": photo.corner,
    })
}
