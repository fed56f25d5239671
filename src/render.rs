//! `kilwa render`: a picture of a pack without a window, through the same streamer and renderer as the page.

mod picture;

use crate::new_file::check_output;
use crate::sheet::{self, SheetArgs};
use crate::source::{FileSource, read_named_text};
use anyhow::{Context, bail};
use glam::DVec3;
use kilwa_pack::Metadata;
use kilwa_pack::plural::counted;
use kilwa_stream::{Budgets, Stats};
use kilwa_viewer::colormap::VIRIDIS;
use kilwa_viewer::display::{LightAngles, Plane, SectionBox};
use kilwa_viewer::shell::native::Session;
use kilwa_viewer::{Background, Bounds, Camera, Display, Gpu, Mode, Prefer, StandardView};
use serde::{Deserialize, Serialize};
use std::io::{IsTerminal, Write};
use std::path::{Path, PathBuf};

/// Render a picture of a pack without a window.
///
/// Plan and elevations are parallel projections: north is +y, and `--view north` looks at the north face, from the
/// north. `iso` is a perspective from the south-west and above.
#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is a switch of the command line")]
pub(crate) struct Args {
    /// The pack.
    pack: PathBuf,
    /// The picture to write: .png or .jpg; a drawing to scale: .png, .pdf or .tif.
    #[arg(short, long, value_name = "FILE")]
    output: PathBuf,
    /// View: plan, north, east, south, west or iso.
    #[arg(long, default_value = "iso", value_parser = parse_view, conflicts_with = "camera")]
    view: StandardView,
    /// A camera from a JSON file: target [x, y, z] and distance in metres; azimuth (of the eye, clockwise from north),
    /// elevation and field_of_view in degrees; orthographic true or false.
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    #[command(flatten)]
    sheet: SheetArgs,
    /// Width and height in pixels.
    #[arg(long, default_value = "1600x1200", value_parser = parse_size, value_name = "WxH")]
    size: [u32; 2],
    /// What colours the surface: colour, clay, headlight, raking, curvature, eye-dome, normals, height, distance, scalar,
    /// level or error.
    #[arg(long, value_parser = parse_mode)]
    mode: Option<Mode>,
    /// All display settings: JSON, or a file with it (as in links of the page and printed by `--json`). Other options
    /// override it.
    #[arg(long, value_name = "JSON|FILE")]
    display: Option<String>,
    /// Direction of the raking light: degrees from north clockwise, and degrees above the horizon.
    #[arg(long, value_name = "AZIMUTH,ELEVATION", value_parser = parse_numbers::<2>, allow_hyphen_values = true)]
    light: Option<[f64; 2]>,
    /// Headlight, raking, curvature and eye-dome on the scan's colours instead of a neutral surface.
    #[arg(long)]
    on_colour: bool,
    /// Range of the colours of height and distance, metres (default: that of the model).
    #[arg(long, value_name = "LOW,HIGH", value_parser = parse_numbers::<2>, allow_hyphen_values = true)]
    range: Option<[f64; 2]>,
    /// The plane that the mode distance measures from: a point on it and its normal.
    #[arg(long, value_name = "X,Y,Z,NX,NY,NZ", value_parser = parse_numbers::<6>, allow_hyphen_values = true)]
    plane: Option<[f64; 6]>,
    /// Clip the model at a plane and keep the side opposite to the normal: a point on the plane and its normal.
    #[arg(long, value_name = "X,Y,Z,NX,NY,NZ", value_parser = parse_numbers::<6>, allow_hyphen_values = true)]
    clip: Option<[f64; 6]>,
    /// Clip the model to a box: smallest corner, largest corner, metres.
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", value_parser = parse_numbers::<6>, allow_hyphen_values = true)]
    clip_box: Option<[f64; 6]>,
    /// Largest error of the picture, in pixels.
    #[arg(long, default_value_t = 1.0, value_parser = parse_pixels, value_name = "PIXELS")]
    pixel_error: f64,
    /// light, dark, white, black, transparent, or a colour such as #ffffff (default: light).
    #[arg(long, value_parser = parse_background)]
    background: Option<String>,
    /// Strength of the headlight on colours: 0 shows them as they are, 1 shades them fully (default: 0.35).
    #[arg(long, value_parser = parse_share)]
    shading: Option<f64>,
    /// Do not tint the inside of the surface.
    #[arg(long)]
    plain_back_faces: bool,
    /// Use a software renderer even if there is a graphics card.
    #[arg(long)]
    software: bool,
    /// Memory for chunks, in megabytes.
    #[arg(long, default_value_t = 2048, value_name = "MB", value_parser = clap::value_parser!(u64).range(16..=1_000_000))]
    memory: u64,
    /// Replace an existing picture, and the world file beside a plan to scale.
    #[arg(long)]
    force: bool,
    /// Print the report as JSON.
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
    display: Display,
    #[serde(skip_serializing_if = "Option::is_none")]
    legend: Option<Legend>,
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
    check_outputs(args)?;
    let display = display(args)?;
    if !args.sheet.is_wanted() {
        let is_transparent =
            kilwa_viewer::display::background(&display.background, false) == Some(Background::Transparent);
        picture::check(&args.output, args.size, is_transparent)?;
    }
    let source = FileSource::open(&args.pack)?;
    let prefer = if args.software { Prefer::Software } else { Prefer::Hardware };
    let gpu = pollster::block_on(Gpu::headless(prefer))?;
    let adapter = gpu.describe();
    if std::io::stderr().is_terminal() {
        crate::terminal::say!("drawing with {adapter}");
    }
    let bytes = args.memory << 20;
    let budgets = Budgets { cpu_bytes: bytes, gpu_bytes: bytes, uploads: 64, ..Budgets::default() };
    let in_pack = || format!("cannot draw {}", args.pack.display());
    let mut session = Session::open(source, &gpu, budgets).with_context(in_pack)?;
    if args.sheet.is_wanted() {
        return draw_sheet(args, session);
    }
    let camera = match &args.camera {
        Some(path) => read_camera(path)?,
        None => Camera::standard(args.view, &session.bounds(), args.size),
    };
    let view = session.view(&camera, args.size, args.pixel_error);
    let options = session.options(&display);
    let (image, stats) = session.render(&view, &options).with_context(in_pack)?;
    picture::write(&args.output, &image, options.background == Background::Transparent, args.force)?;
    let legend = legend(&display, session.metadata(), &session.bounds());
    report(args, adapter, &camera, &stats, display, legend)
}

/// Whether the value of `--display` is JSON and not the name of a file.
fn is_json(display: &str) -> bool {
    display.trim_start().starts_with('{')
}

/// Check that no output replaces an input, before anything is drawn.
fn check_outputs(args: &Args) -> anyhow::Result<()> {
    let display = args.display.as_deref().filter(|text| !is_json(text)).map(Path::new);
    let inputs = || [Some(args.pack.as_path()), args.camera.as_deref(), display].into_iter().flatten();
    check_output(&args.output, args.force, inputs())?;
    match sheet::world_file_of(&args.output, args.view).filter(|_| args.sheet.is_wanted()) {
        Some(world) => check_output(&world, args.force, inputs()),
        None => Ok(()),
    }
}

/// A drawing to scale: on white paper by default.
fn draw_sheet(args: &Args, mut session: Session<FileSource>) -> anyhow::Result<()> {
    let mut display = display(args)?;
    if args.background.is_none() && args.display.is_none() {
        "white".clone_into(&mut display.background);
    }
    let options = session.options(&display);
    let identity = sheet::identity(&FileSource::open(&args.pack)?).with_context(|| args.pack.display().to_string())?;
    let subject = sheet::Subject {
        session,
        view: args.view,
        options,
        pixel_error: args.pixel_error,
        output: &args.output,
        replace: args.force,
        identity,
        on_rows: None,
    };
    let report = sheet::run(&args.sheet, subject)?;
    let mut out = crate::terminal::out();
    if args.json {
        writeln!(out, "{}", crate::terminal::json_text(&report)?)?;
    } else {
        writeln!(out, "{}", report.text())?;
    }
    if !report.is_complete() {
        crate::terminal::say!(
            "kilwa: the drawing is coarser than requested: the memory limit of {} MB was reached (raise it with --memory)",
            args.memory
        );
    }
    Ok(())
}

/// Longest file of a camera or a display, bytes.
const SETTINGS_MAX: u64 = 1 << 20;

/// What the options say of how the model is shown.
fn display(args: &Args) -> anyhow::Result<Display> {
    let mut display = match &args.display {
        Some(text) if is_json(text) => Display::from_json(text).context("--display")?,
        Some(path) => {
            let text = read_named_text(Path::new(path), SETTINGS_MAX)?;
            Display::from_json(&text).with_context(|| path.clone())?
        }
        None => Display::default(),
    };
    if let Some(mode) = args.mode {
        mode.name().clone_into(&mut display.mode);
    }
    if let Some([azimuth, elevation]) = args.light {
        display.light = LightAngles { azimuth, elevation, with_view: false };
    }
    let plane = |[x, y, z, a, b, c]: [f64; 6]| Plane { point: DVec3::new(x, y, z), normal: DVec3::new(a, b, c) };
    display.plane = args.plane.map(plane).or(display.plane);
    display.clip_plane = args.clip.map(plane).or(display.clip_plane);
    if let Some([x, y, z, u, v, w]) = args.clip_box {
        let (low, high) = (DVec3::new(x, y, z), DVec3::new(u, v, w));
        let (center, size) = ((low + high) * 0.5, high - low);
        display.clip_box = Some(SectionBox { center, size, turn: 0.0, remove_inside: false });
    }
    display.on_colour |= args.on_colour;
    display.range = args.range.or(display.range);
    display.background = args.background.clone().unwrap_or(display.background);
    display.shading = args.shading.unwrap_or(display.shading);
    display.back_faces &= !args.plain_back_faces;
    display.check()?;
    Ok(display)
}

/// What the colours of a mode mean.
#[derive(Serialize)]
struct Legend {
    /// sRGB, from low to high, evenly spaced.
    stops: [[u8; 3]; 9],
    low: f64,
    high: f64,
    unit: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    channel: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    plane: Option<Plane>,
}

fn legend(display: &Display, metadata: &Metadata, bounds: &Bounds) -> Option<Legend> {
    let mode = display.mode();
    if mode == Mode::Scalar {
        let names: Vec<&str> = metadata.scalars.iter().map(|c| c.name.as_str()).collect();
        let channel = metadata.scalars.get(display.channel_index(&names)?)?;
        let [low, high] = display.channel_range.unwrap_or([f64::from(channel.min), f64::from(channel.max)]);
        return Some(Legend { stops: VIRIDIS, low, high, unit: "", channel: Some(channel.name.clone()), plane: None });
    }
    let [low, high] = display.scale_range(bounds);
    let plane = Some(display.scale_plane(bounds)).filter(|_| mode == Mode::Distance);
    mode.has_scale().then_some(Legend { stops: VIRIDIS, low, high, unit: "m", channel: None, plane })
}

fn report(
    args: &Args,
    adapter: String,
    camera: &Camera,
    stats: &Stats,
    display: Display,
    legend: Option<Legend>,
) -> anyhow::Result<()> {
    let mut out = crate::terminal::out();
    if args.json {
        let report = Report {
            picture: args.output.display().to_string(),
            size: args.size,
            adapter,
            camera: CameraFile {
                target: camera.target.to_array(),
                distance: camera.distance,
                azimuth: camera.azimuth.to_degrees(),
                elevation: camera.elevation.to_degrees(),
                field_of_view: camera.field_of_view.to_degrees(),
                orthographic: camera.orthographic,
            },
            display,
            legend,
            patches: stats.patches_drawn,
            triangles: stats.triangles_drawn,
            chunks: stats.chunks_resident,
            requests: stats.requests_made,
            worst_pixel_error: stats.worst_pixel_error,
            worst_error_metres: stats.worst_error_metres,
            target_reached: stats.target_reached,
            budget_limited: stats.budget_limited,
        };
        writeln!(out, "{}", crate::terminal::json_text(&report)?)?;
    } else {
        writeln!(
            out,
            "{}: {} x {} pixels, {}, surface within {:.2} px ({:.4} m), {adapter}",
            args.output.display(),
            args.size[0],
            args.size[1],
            counted(stats.triangles_drawn, "triangle", "triangles"),
            stats.worst_pixel_error,
            stats.worst_error_metres,
        )?;
    }
    if !stats.target_reached {
        crate::terminal::say!(
            "kilwa: the picture is coarser than requested: the memory limit of {} MB was reached (raise it with --memory)",
            args.memory
        );
    }
    Ok(())
}

fn read_camera(path: &Path) -> anyhow::Result<Camera> {
    let text = read_named_text(path, SETTINGS_MAX)?;
    let file: CameraFile =
        serde_json::from_str(&text).with_context(|| format!("{} is not a camera file", path.display()))?;
    let CameraFile { target, distance, azimuth, elevation, field_of_view, orthographic } = file;
    let finite = target.iter().chain(&[azimuth, distance]).all(|x| x.is_finite());
    if !finite || distance <= 0.0 {
        bail!("{}: target and azimuth must be finite, distance greater than 0", path.display());
    }
    if !(-90.0..=90.0).contains(&elevation) || !(1.0..=150.0).contains(&field_of_view) {
        bail!("{}: elevation must be -90 to 90 degrees, field_of_view 1 to 150", path.display());
    }
    Ok(Camera {
        target: target.into(),
        azimuth: azimuth.to_radians(),
        elevation: elevation.to_radians(),
        distance,
        field_of_view: field_of_view.to_radians(),
        orthographic,
        roll: 0.0,
    })
}

fn parse_view(text: &str) -> Result<StandardView, String> {
    StandardView::from_name(text)
        .ok_or_else(|| format!("there is no such view; the views are {}", names(&StandardView::ALL)))
}

fn parse_mode(text: &str) -> Result<Mode, String> {
    Mode::from_name(text).ok_or_else(|| format!("there is no such mode; the modes are {}", names(&Mode::ALL)))
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

fn parse_share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if (0.0..=1.0).contains(&x) => Ok(x),
        _ => Err("a number from 0 to 1".to_owned()),
    }
}

fn parse_numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|t| t.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    numbers.and_then(|v| v.try_into().ok()).ok_or_else(|| format!("expected {N} numbers with commas between them"))
}

fn parse_background(text: &str) -> Result<String, String> {
    let known = kilwa_viewer::display::background(text, false).map(|_| text.to_owned());
    known.ok_or_else(|| "light, dark, white, black, transparent or a colour such as #ffffff".to_owned())
}
