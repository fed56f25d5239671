//! `kilwa scans photos`: the photographs of a survey or a folder.

use anyhow::{Context as _, bail, ensure};
use clap::Subcommand;
use kilwa_pack::plural::counted;
use kilwa_scan::photos::{self, Frame, Missing, Options, PhotoRecord, PhotoSet, Source};
use kilwa_scan::survey::{self, Survey};
use kilwa_scan_core::{Camera, CameraModel, Distortion, PosedCamera};
use serde_json::{Value, json};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Show what is known about photographs: cameras, poses, and what is missing.
#[derive(clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    what: What,
}

#[derive(Subcommand)]
enum What {
    List(List),
}

/// List the photographs in a folder or survey with their cameras and poses, and what is missing.
///
/// Poses are read from COLMAP (text or binary), Bundler, Metashape XML, XMP sidecars of RealityCapture, MeshLab projects and camera XML, and E57.
/// Photographs are JPEG and PNG files. They are not decoded, and nothing is written.
#[derive(clap::Args)]
struct List {
    /// A folder with photographs, or a survey (its survey.toml lists them).
    #[arg(value_name = "DIR|SURVEY")]
    folder: PathBuf,
    /// The file with the poses, if the folder contains several or it is elsewhere; for COLMAP, the model's folder or
    /// one of its files.
    #[arg(long, value_name = "FILE")]
    poses: Option<PathBuf>,
    /// The survey whose stations have panoramas in the folder: a picture named after a station and twice as wide as
    /// high gets its pose.
    #[arg(long, value_name = "SURVEY")]
    survey: Option<PathBuf>,
    /// Print the list as JSON.
    #[arg(long)]
    json: bool,
}

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    match &args.what {
        What::List(args) => list(args),
    }
}

fn list(args: &List) -> anyhow::Result<()> {
    let set = read(args)?;
    let mut out = crate::terminal::out();
    if args.json {
        writeln!(out, "{}", crate::terminal::json_line(&as_json(&set))?)?;
    } else {
        table(&set, &mut out)?;
    }
    Ok(())
}

fn read(args: &List) -> anyhow::Result<PhotoSet> {
    let is_survey = args.folder.join(survey::FILE).is_file();
    if is_survey {
        if args.poses.is_some() || args.survey.is_some() {
            bail!(
                "{} is a survey, so its photographs are listed in survey.toml; to use poses from another program, give the folder of the photographs instead, and the survey with --survey",
                args.folder.display()
            );
        }
        return Ok(photos::of_survey(&args.folder, &Survey::open(&args.folder)?));
    }
    ensure!(args.folder.exists(), "{} does not exist", args.folder.display());
    ensure!(args.folder.is_dir(), "{} is not a folder; give the folder of the photographs", args.folder.display());
    let survey = args.survey.as_deref().map(Survey::open).transpose()?;
    let stations = survey.as_ref().map(|survey| survey.stations.as_slice()).unwrap_or_default();
    let options = Options { poses: args.poses.as_deref(), stations };
    photos::read(&args.folder, &options).with_context(|| format!("the photographs of {}", args.folder.display()))
}

fn table(set: &PhotoSet, out: &mut impl Write) -> anyhow::Result<()> {
    if let Some((format, path)) = &set.poses {
        writeln!(out, "poses: {} ({format})", path.display())?;
    }
    if let Some(crs) = &set.crs {
        writeln!(out, "coordinates: {}", kilwa_pack::visible::visible(crs))?;
    }
    let names: Vec<String> =
        set.photos.iter().map(|photo| kilwa_pack::visible::visible(&photo.name).to_string()).collect();
    let widest = names.iter().map(|name| name.chars().count()).max().unwrap_or(0).max(10);
    writeln!(
        out,
        "{:widest$}  {:>13}  {:22}  {:19}  {:30}  missing",
        "photograph", "pixels", "camera", "taken", "position"
    )?;
    for (photo, name) in set.photos.iter().zip(&names) {
        let taken = photo.picture.as_ref().and_then(|picture| picture.taken.as_deref()).unwrap_or("");
        let missing: Vec<String> = photo.missing.iter().map(ToString::to_string).collect();
        let line = format!(
            "{name:widest$}  {:>13}  {:22}  {:19}  {:30}  {}",
            pixels(photo),
            camera(photo.camera.as_ref()),
            taken.get(..19).unwrap_or(taken),
            position(photo),
            kilwa_pack::visible::visible(&missing.join("; "))
        );
        writeln!(out, "{}", line.trim_end())?;
    }
    summary(set, out)
}

/// Writes the counts, and for each kind of problem the number of photographs that have it.
fn summary(set: &PhotoSet, out: &mut impl Write) -> anyhow::Result<()> {
    let count = |is: &dyn Fn(&PhotoRecord) -> bool| set.photos.iter().filter(|photo| is(photo)).count() as u64;
    let usable = count(&|photo| photo.posed().is_some() && photo.source != Source::Missing);
    let masks = count(&|photo| photo.mask.is_some());
    write!(
        out,
        "{}, {usable} with file, camera and pose",
        counted(set.photos.len() as u64, "photograph", "photographs")
    )?;
    if masks > 0 {
        write!(out, ", {}", counted(masks, "mask", "masks"))?;
    }
    if !set.sparse_points.is_empty() {
        write!(out, ", {}", counted(set.sparse_points.len() as u64, "sparse point", "sparse points"))?;
    }
    writeln!(out)?;
    for kind in KINDS {
        let missing = count(&|photo| photo.missing.iter().any(|missing| of(missing) == kind));
        if missing > 0 {
            writeln!(out, "{}: {kind}", counted(missing, "photograph", "photographs"))?;
        }
    }
    let loose = count(&|photo| photo.camera_from_world.is_some() && photo.frame == Frame::Reconstruction);
    if loose > 0 {
        writeln!(
            out,
            "{} in the frame of the reconstruction, not of a survey",
            counted(loose, "pose is", "poses are")
        )?;
    }
    Ok(())
}

/// Names of the kinds of [`Missing`], in the table and in JSON.
const KINDS: [&str; 7] = [
    "no file",
    "several files with this name",
    "unreadable",
    "no calibration",
    "no pose",
    "size differs from the calibration",
    "disabled",
];

fn of(missing: &Missing) -> &'static str {
    match missing {
        Missing::File => KINDS[0],
        Missing::Ambiguous(_) => KINDS[1],
        Missing::Picture(_) => KINDS[2],
        Missing::Calibration(_) => KINDS[3],
        Missing::Pose(_) => KINDS[4],
        Missing::Size { .. } => KINDS[5],
        Missing::Disabled => KINDS[6],
    }
}

fn size(photo: &PhotoRecord) -> Option<[u32; 2]> {
    photo.picture.as_ref().map(|picture| picture.size).or(photo.camera.map(|camera| camera.size()))
}

fn pixels(photo: &PhotoRecord) -> String {
    size(photo).map_or_else(String::new, |[width, height]| format!("{width} × {height}"))
}

/// The kind of camera, and its distortion model.
fn kind(camera: &Camera) -> (&'static str, &'static str) {
    match camera.model() {
        CameraModel::Pinhole { distortion, .. } => match distortion {
            Distortion::None => ("pinhole", "none"),
            Distortion::Brown { .. } => ("pinhole", "brown"),
            Distortion::OpenCv { .. } => ("pinhole", "rational"),
            Distortion::Fisheye { .. } => ("pinhole", "fisheye"),
        },
        CameraModel::Equirectangular { .. } => ("equirectangular", "none"),
        CameraModel::Cylindrical { .. } => ("cylindrical", "none"),
    }
}

fn camera(camera: Option<&Camera>) -> String {
    let Some(camera) = camera else { return String::new() };
    let (kind, lens) = kind(camera);
    match camera.model() {
        CameraModel::Pinhole { focal, .. } => {
            let lens = if lens == "none" { kind } else { lens };
            format!("{lens}, f {:.1} px", focal.x)
        }
        _ => kind.to_owned(),
    }
}

fn posed(photo: &PhotoRecord) -> Option<[f64; 3]> {
    photo.camera_from_world.map(|pose| pose.inverse().translation.to_array())
}

fn position(photo: &PhotoRecord) -> String {
    let station = photo.station.as_deref().map(|name| format!(" ({name})")).unwrap_or_default();
    // No -0.000.
    let rounded = |value: f64| (value * 1e3).round() / 1e3 + 0.0;
    posed(photo)
        .map(|at| at.map(rounded))
        .map_or_else(String::new, |[x, y, z]| format!("{x:.3} {y:.3} {z:.3}{station}"))
}

fn as_json(set: &PhotoSet) -> Value {
    json!({
        "poses": set.poses.as_ref().map(|(format, path)| json!({"format": format.name(), "path": path.display().to_string()})),
        "coordinates": set.crs,
        "sparse_points": set.sparse_points.len(),
        "photographs": set.photos.iter().map(photo_as_json).collect::<Vec<_>>(),
    })
}

fn photo_as_json(photo: &PhotoRecord) -> Value {
    let pose = photo.camera_from_world.map(|pose| {
        let q = pose.rotation;
        json!({
            "frame": match photo.frame { Frame::Survey => "survey", Frame::Reconstruction => "reconstruction" },
            "camera_from_world": {"rotation_wxyz": [q.w, q.x, q.y, q.z], "translation": pose.translation.to_array()},
            "position": posed(photo),
            "forward": photo.camera.map(|camera| {
                PosedCamera { camera, camera_from_world: pose }.forward().to_array()
            }),
        })
    });
    // JSON strings must be Unicode, so other names are converted with loss.
    let shown = |path: &Path| path.display().to_string();
    let (file, inside) = match &photo.source {
        Source::File(path) => (Some(shown(path)), None),
        Source::Inside { file, number } => (None, Some(json!({"file": shown(file), "picture": number + 1}))),
        Source::Missing => (None, None),
    };
    let picture = photo.picture.as_ref();
    json!({
        "name": photo.name,
        "file": file,
        "inside": inside,
        "size": picture.map(|picture| picture.size),
        "taken": picture.and_then(|picture| picture.taken.clone()),
        "exposure": picture.map(|picture| json!({
            "seconds": picture.exposure.time,
            "f_number": picture.exposure.f_number,
            "iso": picture.exposure.iso,
        })),
        "camera": photo.camera.as_ref().map(camera_as_json),
        "pose": pose,
        "station": photo.station,
        "mask": photo.mask.as_deref().map(shown),
        "missing": photo.missing.iter().map(|missing| json!({"kind": of(missing), "message": missing.to_string()})).collect::<Vec<_>>(),
    })
}

/// A camera with its coefficients.
pub(crate) fn camera_as_json(camera: &Camera) -> Value {
    let (kind, lens) = kind(camera);
    let mut json = json!({"kind": kind, "size": camera.size(), "max_angle_degrees": camera.max_angle().to_degrees()});
    match camera.model() {
        CameraModel::Pinhole { focal, center, skew, distortion } => {
            json["focal"] = json!(focal.to_array());
            json["center"] = json!(center.to_array());
            json["skew"] = json!(skew);
            json["distortion"] = json!({"kind": lens});
            let (k, p): (&[f64], &[f64]) = match distortion {
                Distortion::None => (&[], &[]),
                Distortion::Brown { k, p } | Distortion::Fisheye { k, p } => (k, p),
                Distortion::OpenCv { k, p } => (k, p),
            };
            json["distortion"]["k"] = json!(k);
            json["distortion"]["p"] = json!(p);
        }
        CameraModel::Equirectangular { scale, center } | CameraModel::Cylindrical { scale, center } => {
            json["scale"] = json!(scale.to_array());
            json["center"] = json!(center.to_array());
        }
    }
    json
}
