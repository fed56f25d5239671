//! `kilwa render`: a picture of a pack without a window, through the same streamer and renderer as the page.

use crate::source::FileSource;
use anyhow::{Context, bail};
use kilwa_stream::{Budgets, Stats};
use kilwa_viewer::shell::native::Session;
use kilwa_viewer::{Background, Camera, Gpu, Image, Mode, Prefer, RenderOptions, StandardView};
use serde::{Deserialize, Serialize};
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};

/// Draw a picture of a pack without a window.
///
/// Plan and elevations are parallel projections: north is +y, and `--view north` looks at the north face, from the
/// north. `iso` is a perspective from the south-west and above.
#[derive(clap::Args)]
pub(crate) struct Args {
    /// The pack.
    pack: PathBuf,
    /// The picture, a PNG.
    #[arg(short, long, value_name = "FILE.png")]
    output: PathBuf,
    /// Where to look from: plan, north, east, south, west or iso.
    #[arg(long, default_value = "iso", value_parser = parse_view, conflicts_with = "camera")]
    view: StandardView,
    /// A camera from a JSON file: target [x, y, z] and distance in metres; azimuth (of the eye, clockwise from north),
    /// elevation and field_of_view in degrees; orthographic true or false.
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// Width and height in pixels.
    #[arg(long, default_value = "1600x1200", value_parser = parse_size, value_name = "WxH")]
    size: [u32; 2],
    /// What colours the surface: colour, clay, normals, level or error.
    #[arg(long, default_value = "colour", value_parser = parse_mode)]
    mode: Mode,
    /// Largest error of what is drawn, in pixels.
    #[arg(long, default_value_t = 1.0, value_parser = parse_pixels, value_name = "PIXELS")]
    pixel_error: f64,
    /// limestone, basalt, transparent, or a colour such as #ffffff.
    #[arg(long, default_value = "limestone", value_parser = parse_background)]
    background: Background,
    /// Lamp at the eye on the scan's colours: 0 shows them as they are, 1 shades them fully.
    #[arg(long, default_value_t = 0.35, value_parser = parse_share)]
    shading: f32,
    /// Do not tint the inside of the surface.
    #[arg(long)]
    plain_back_faces: bool,
    /// Take a software renderer even where there is a graphics card.
    #[arg(long)]
    software: bool,
    /// Memory for chunks, in megabytes.
    #[arg(long, default_value_t = 2048, value_name = "MB", value_parser = clap::value_parser!(u64).range(16..=1_000_000))]
    memory: u64,
    /// Report as JSON.
    #[arg(long)]
    json: bool,
}

/// The camera file: angles in degrees, lengths in metres.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    target: [f64; 3],
    distance: f64,
    #[serde(default)]
    azimuth: f64,
    #[serde(default)]
    elevation: f64,
    #[serde(default = "default_field_of_view")]
    field_of_view: f64,
    #[serde(default)]
    orthographic: bool,
}

fn default_field_of_view() -> f64 {
    40.0
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report {
    picture: String,
    size: [u32; 2],
    adapter: String,
    camera: CameraFile,
    patches: u32,
    triangles: u64,
    chunks: u32,
    requests: u64,
    worst_pixel_error: f64,
    worst_error_metres: f64,
    target_reached: bool,
    budget_limited: bool,
}

/// Most pixels of one picture: 4 bytes each are held in memory.
const MAX_PIXELS: u64 = 1 << 30;

pub(crate) fn run(args: &Args) -> anyhow::Result<()> {
    let source = FileSource::open(&args.pack)?;
    let prefer = if args.software { Prefer::Software } else { Prefer::Hardware };
    let gpu = pollster::block_on(Gpu::headless(prefer))?;
    let adapter = gpu.describe();
    if std::io::stderr().is_terminal() {
        eprintln!("drawing with {adapter}");
    }
    let bytes = args.memory << 20;
    let budgets = Budgets { cpu_bytes: bytes, gpu_bytes: bytes, uploads: 64, ..Budgets::default() };
    let in_pack = || format!("cannot draw {}", args.pack.display());
    let mut session = Session::open(source, &gpu, budgets).with_context(in_pack)?;
    let camera = match &args.camera {
        Some(path) => read_camera(path)?,
        None => Camera::standard(args.view, &session.bounds(), args.size),
    };
    let view = session.view(&camera, args.size, args.pixel_error);
    let options = RenderOptions {
        mode: args.mode,
        shading: args.shading,
        mark_back_faces: !args.plain_back_faces,
        background: args.background,
        tile: None,
    };
    let (image, stats) = session.render(&view, &options).with_context(in_pack)?;
    write_png(&args.output, &image, args.background == Background::Transparent)?;
    report(args, adapter, &camera, &stats)
}

fn report(args: &Args, adapter: String, camera: &Camera, stats: &Stats) -> anyhow::Result<()> {
    let mut out = std::io::stdout().lock();
    if args.json {
        let report = Report {
            picture: args.output.display().to_string(),
            size: args.size,
            adapter,
            camera: CameraFile {
                target: camera.target,
                distance: camera.distance,
                azimuth: camera.azimuth.to_degrees(),
                elevation: camera.elevation.to_degrees(),
                field_of_view: camera.field_of_view.to_degrees(),
                orthographic: camera.orthographic,
            },
            patches: stats.patches_drawn,
            triangles: stats.triangles_drawn,
            chunks: stats.chunks_resident,
            requests: stats.requests_made,
            worst_pixel_error: stats.worst_pixel_error,
            worst_error_metres: stats.worst_error_metres,
            target_reached: stats.target_reached,
            budget_limited: stats.budget_limited,
        };
        writeln!(out, "{}", serde_json::to_string_pretty(&report)?)?;
    } else {
        writeln!(
            out,
            "{}: {} x {} pixels, {} triangles, surface within {:.2} px ({:.4} m), {adapter}",
            args.output.display(),
            args.size[0],
            args.size[1],
            stats.triangles_drawn,
            stats.worst_pixel_error,
            stats.worst_error_metres,
        )?;
    }
    if !stats.target_reached {
        eprintln!(
            "kilwa: the picture is coarser than asked for: the memory of {} MB is full (--memory gives more)",
            args.memory
        );
    }
    Ok(())
}

fn read_camera(path: &Path) -> anyhow::Result<Camera> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read the camera {}", path.display()))?;
    let file: CameraFile = serde_json::from_str(&text).with_context(|| format!("{} is no camera", path.display()))?;
    let CameraFile { target, distance, azimuth, elevation, field_of_view, orthographic } = file;
    let finite = target.iter().chain(&[azimuth, distance]).all(|x| x.is_finite());
    if !finite || distance <= 0.0 {
        bail!("{}: target and azimuth must be finite, distance greater than 0", path.display());
    }
    if !(-90.0..=90.0).contains(&elevation) || !(1.0..=150.0).contains(&field_of_view) {
        bail!("{}: elevation must be -90 to 90 degrees, field_of_view 1 to 150", path.display());
    }
    Ok(Camera {
        target,
        azimuth: azimuth.to_radians(),
        elevation: elevation.to_radians(),
        distance,
        field_of_view: field_of_view.to_radians(),
        orthographic,
        roll: 0.0,
    })
}

/// Write under a temporary name in the same folder, then rename: no half picture under the final name.
fn write_png(path: &Path, image: &Image, alpha: bool) -> anyhow::Result<()> {
    let failed = || format!("cannot write {}", path.display());
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let mut file =
        tempfile::Builder::new().prefix(".kilwa-").suffix(".png").tempfile_in(folder).with_context(failed)?;
    let [width, height] = image.size;
    let (pixels, color) = if alpha {
        (image.pixels.clone(), image::ExtendedColorType::Rgba8)
    } else {
        let opaque = image.pixels.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
        (opaque, image::ExtendedColorType::Rgb8)
    };
    let encoder = image::codecs::png::PngEncoder::new(std::io::BufWriter::new(file.as_file_mut()));
    image::ImageEncoder::write_image(encoder, &pixels, width, height, color).with_context(failed)?;
    let temporary = file.into_temp_path();
    share(&temporary)?;
    temporary.persist(path).with_context(failed)?;
    Ok(())
}

/// Temporary files are private; a picture is as readable as any other new file.
fn share(path: &Path) -> anyhow::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o644))
            .with_context(|| format!("cannot set the mode of {}", path.display()))?;
    }
    Ok(())
}

fn parse_view(text: &str) -> Result<StandardView, String> {
    StandardView::from_name(text)
        .ok_or_else(|| format!("no view is called so; there are {}", names(&StandardView::ALL)))
}

fn parse_mode(text: &str) -> Result<Mode, String> {
    Mode::from_name(text).ok_or_else(|| format!("no mode is called so; there are {}", names(&Mode::ALL)))
}

fn names<T>(all: &[(T, &str)]) -> String {
    all.iter().map(|(_, name)| *name).collect::<Vec<_>>().join(", ")
}

fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let parts = text.split_once(['x', 'X', '×']);
    let size = parts.and_then(|(w, h)| Some([w.trim().parse().ok()?, h.trim().parse().ok()?]));
    match size {
        Some([w, h]) if w > 0 && h > 0 && u64::from(w) * u64::from(h) <= MAX_PIXELS => Ok([w, h]),
        Some(_) => Err(format!("between 1 and {MAX_PIXELS} pixels in all")),
        None => Err("width and height such as 1600x1200".to_owned()),
    }
}

fn parse_pixels(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x.is_finite() && x > 0.0 => Ok(x),
        _ => Err("a number greater than 0".to_owned()),
    }
}

fn parse_share(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(x) if (0.0..=1.0).contains(&x) => Ok(x),
        _ => Err("a number from 0 to 1".to_owned()),
    }
}

fn parse_background(text: &str) -> Result<Background, String> {
    match text {
        "limestone" => Ok(Background::LIMESTONE),
        "basalt" => Ok(Background::BASALT),
        "transparent" => Ok(Background::Transparent),
        _ => {
            let hex = text.strip_prefix('#').unwrap_or(text);
            let value = u32::from_str_radix(hex, 16).ok().filter(|_| hex.len() == 6);
            let [_, r, g, b] = value.ok_or("limestone, basalt, transparent or a colour such as #ffffff")?.to_be_bytes();
            Ok(Background::Flat([r, g, b]))
        }
    }
}
