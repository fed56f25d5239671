//! What `kilwa colour` prints.

use super::{Args, Done, PhotoFiles};
use crate::info::grouped;
use crate::scans::photos::camera_as_json;
use kilwa_archive::colour_report::COLOUR_REPORT_FORM;
use kilwa_builder::build::machine;
use kilwa_pack::metadata::SourceFile;
use kilwa_pack::plural::{counted, plural};
use kilwa_pack::visible::visible;
use kilwa_scan::colour::align::Aligned;
use kilwa_scan::colour::{Input, PhotoReport, Split};
use kilwa_scan_core::photo_pose::Similarity;
use kilwa_scan_core::photo_pose::icp::SurfaceFit;
use serde_json::{Value, json};
use std::io::Write as _;
use std::path::Path;

pub(super) fn print(args: &Args, done: &Done, seconds: f64) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    let report = &done.report;
    let left_out = left_out(done);
    let cost = json!({
        "seconds": seconds,
        "cpu_seconds": machine::cpu_seconds(),
        "peak_memory": machine::peak_memory(),
        "scratch_bytes": report.scratch,
    });
    if let Some(path) = &args.report {
        let text = crate::terminal::json_text(&as_json(args, done, &left_out))?;
        crate::new_file::NewFile::write(path, text.as_bytes(), args.force)?;
    }
    if args.json {
        let mut json = as_json(args, done, &left_out);
        if let (Some(json), Value::Object(cost)) = (json.as_object_mut(), cost) {
            json.extend(cost);
        }
        writeln!(out, "{}", crate::terminal::json_line(&json)?)?;
        return Ok(());
    }
    writeln!(
        out,
        "{}: {} {}, {:.1} % of them coloured from {}.",
        args.output.display(),
        grouped(done.vertices),
        plural(done.vertices, "vertex", "vertices"),
        100.0 * share(report.coloured, report.vertices),
        counted(report.photos.iter().filter(|photo| photo.seen > 0).count() as u64, "photograph", "photographs"),
    )?;
    if let Some(Split { before, after, .. }) = report.split {
        if after > before {
            writeln!(out, "  The {} triangles of the surface were split into {}.", grouped(before), grouped(after))?;
        } else {
            writeln!(
                out,
                "  No triangle was split; a smaller number of pixels for --texture-detail keeps more detail."
            )?;
        }
    }
    if let Some(aligned) = &done.aligned {
        writeln!(out, "  {}", frame_in_words(aligned))?;
    }
    if let Some([near, all]) = done.doubt {
        writeln!(
            out,
            "  Warning: only {near} of {all} points of the reconstruction are near the model. If its poses are not in the coordinates of the model, give --control-points, --camera-positions or --approximate-poses."
        )?;
    }
    let blind: Vec<&str> =
        report.photos.iter().filter(|p| p.seen == 0 && p.left_out.is_none()).map(|p| p.name.as_str()).collect();
    for name in blind {
        writeln!(out, "  {} does not see the model.", visible(name))?;
    }
    if !done.left_out.is_empty() {
        writeln!(out, "  The format cannot store {}; use PLY or a pack for that.", done.left_out.join(", "))?;
    }
    let compared = report.photos.iter().filter(|photo| photo.seen > 0).count();
    if report.places == 0 && compared > 1 {
        writeln!(out, "  No vertex is seen clearly by two photographs, so their exposures could not be compared.")?;
    }
    for LeftOut { name, why, overlay, .. } in left_out {
        let see = overlay.map_or_else(String::new, |path| format!(" (see {})", path.display()));
        writeln!(out, "  {} was left out: {}{}.", visible(name), visible(why), visible(&see))?;
    }
    Ok(())
}

/// A photograph that was not used.
struct LeftOut<'a> {
    name: &'a str,
    why: &'a str,
    /// The picture that shows why, if one was written.
    overlay: Option<&'a Path>,
    /// Its file, if it could be read.
    file: Option<&'a SourceFile>,
}

fn left_out(done: &Done) -> Vec<LeftOut<'_>> {
    let unusable = done.photographs.left_out.iter().map(|(name, why)| LeftOut { name, why, overlay: None, file: None });
    let photos = done.report.photos.iter().zip(&done.files);
    let unfit = photos.filter_map(|(photo, files)| {
        let file = files.as_ref().map(|files| &files.photograph);
        let left_out = photo.left_out.as_ref()?;
        Some(LeftOut { name: &photo.name, why: &left_out.why, overlay: left_out.overlay.as_deref(), file })
    });
    unusable.chain(unfit).collect()
}

fn share(part: u64, whole: u64) -> f64 {
    part as f64 / whole.max(1) as f64
}

/// What does not change from run to run.
fn as_json(args: &Args, done: &Done, left_out: &[LeftOut<'_>]) -> Value {
    let report = &done.report;
    let all = report.photos.iter().zip(done.photographs.inputs.iter().zip(&done.files));
    let used = all.filter(|(photo, _)| photo.left_out.is_none());
    json!({
        "kilwa_colour_report": COLOUR_REPORT_FORM,
        "output": args.output.display().to_string(),
        "bytes": done.bytes,
        "triangles": done.triangles,
        "vertices": done.vertices,
        "coloured_share": share(report.coloured, report.vertices),
        "points_compared": report.places,
        "triangles_split": report.split.map(|Split { before, after, .. }| json!({"before": before, "after": after})),
        "not_stored": done.left_out,
        "brightness": report.brightness,
        "photographs": used.map(|(photo, (input, files))| photo_as_json(photo, input, files.as_ref())).collect::<Vec<_>>(),
        "frame": done.aligned.as_ref().map(frame_as_json),
        "points_near_model": done.doubt.map(|[near, all]| json!({"near": near, "points": all})),
        "left_out": left_out.iter().map(|LeftOut { name, why, overlay, file }| {
            json!({"name": name, "why": why, "overlay": overlay, "bytes": file.map(|file| file.bytes), "sha256": file.map(|file| &file.sha256)})
        }).collect::<Vec<_>>(),
    })
}

/// How the frame of the reconstruction was found.
fn frame_in_words(aligned: &Aligned) -> String {
    let worst = aligned.residuals.iter().max_by(|a, b| a.after.total_cmp(&b.after));
    let known = aligned.rms.zip(worst).map_or_else(String::new, |(rms, worst)| {
        let points = counted(aligned.residuals.len() as u64, "known position", "known positions");
        let (largest, name) = (worst.after, visible(&worst.name));
        format!(" {rms:.3} m from {points} (root mean square), {largest:.3} m at {name};")
    });
    let missing = match aligned.without_pose.len() as u64 {
        0 => String::new(),
        n => format!(" {} no pose;", counted(n, "known camera has", "known cameras have")),
    };
    let surface = match (&aligned.landed, &aligned.not_landed) {
        (Some(SurfaceFit { points, share, median, .. }), _) => {
            let points = counted(*points as u64, "point", "points");
            format!(
                "{points} of the reconstruction ({:.0} %) on the surface, median distance {median:.4} m",
                100.0 * share
            )
        }
        (None, Some(why)) => format!("not fitted to the surface: {why}"),
        (None, None) => "not fitted to the surface, because the reconstruction has no points".to_owned(),
    };
    format!("Frame of the reconstruction:{known}{missing} {surface}.")
}

fn frame_as_json(aligned: &Aligned) -> Value {
    let Similarity { scale, rotation: q, translation } = aligned.similarity;
    json!({
        "scale": scale,
        "rotation_wxyz": [q.w, q.x, q.y, q.z],
        "translation": translation.to_array(),
        "rms": aligned.rms,
        "residuals": aligned.residuals.iter().map(|r| json!({"name": r.name, "before": r.before, "after": r.after})).collect::<Vec<_>>(),
        "cameras_without_pose": aligned.without_pose,
        "surface": aligned.landed.as_ref().map(|fit| json!({"points": fit.points, "share": fit.share, "median": fit.median})),
        "surface_not_used": aligned.not_landed.as_ref().map(ToString::to_string),
    })
}

fn photo_as_json(photo: &PhotoReport, input: &Input, files: Option<&PhotoFiles>) -> Value {
    let (file, mask) = (files.map(|files| &files.photograph), files.and_then(|files| files.mask.as_ref()));
    let pose = photo.camera.camera_from_world;
    let q = pose.rotation;
    json!({
        "name": photo.name,
        "file": input.path.display().to_string(),
        "bytes": file.map(|file| file.bytes),
        "sha256": file.map(|file| &file.sha256),
        "mask": input.mask.as_ref().map(|mask| mask.display().to_string()),
        "mask_bytes": mask.map(|mask| mask.bytes),
        "mask_sha256": mask.map(|mask| &mask.sha256),
        "camera": camera_as_json(&photo.camera.camera),
        "camera_from_world": {"rotation_wxyz": [q.w, q.x, q.y, q.z], "translation": pose.translation.to_array()},
        "position": photo.camera.position().to_array(),
        "refined": photo.refined.map(|refined| json!({
            "moved_px": refined.moved_px,
            "residual_px": refined.residual_px,
            "agreement": refined.agreement,
        })),
        "seen": photo.seen,
        "share": photo.share,
        "dropped": photo.dropped,
        "gain": photo.gain,
        "offset": photo.offset,
        "corner": photo.corner,
    })
}
