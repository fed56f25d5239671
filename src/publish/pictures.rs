//! Poster, thumbnails and drawings to scale of a pack, drawn headless into a version's folder.

use crate::sheet::{self, SheetArgs};
use crate::source::FileSource;
use anyhow::Context;
use glam::DVec3;
use image::codecs::jpeg::JpegEncoder;
use image::imageops::{FilterType, resize};
use image::{ExtendedColorType, ImageEncoder, RgbImage};
use kilwa_archive::layout::{DRAWINGS, POSTER, THUMBNAILS};
use kilwa_stream::Budgets;
use kilwa_viewer::shell::native::Session;
use kilwa_viewer::{Bounds, Camera, Display, Gpu, Prefer, StandardView};
use std::path::Path;

/// Pixels of the poster: what cards of other sites show.
const SIZE: [u32; 2] = [1200, 630];
/// Quality of JPEG, of 100.
const QUALITY: u8 = 88;
/// Memory for chunks while drawing, bytes.
const MEMORY: u64 = 1 << 30;
/// What drawings are called: view, file, words.
const VIEWS: [(StandardView, &str, &str); 5] = [
    (StandardView::Plan, "plan", "Plan"),
    (StandardView::North, "north", "North elevation"),
    (StandardView::East, "east", "East elevation"),
    (StandardView::South, "south", "South elevation"),
    (StandardView::West, "west", "West elevation"),
];

/// What was drawn: paths in the folder, and the words for each drawing.
pub(super) struct Drawn {
    pub(super) files: Vec<String>,
    pub(super) drawings: Vec<(String, String)>,
}

/// Parts of the progress that each picture counts for, whatever its number of rows.
const ROWS: u32 = 1000;

/// Draw all pictures of `pack` into `folder`. Calls `on_part` with the number of parts drawn and their total.
///
/// # Errors
/// When there is nothing to draw with, the pack is damaged, or a file cannot be written.
pub(super) fn draw(
    pack: &Path,
    folder: &Path,
    title: &str,
    software: bool,
    on_part: &dyn Fn(u64, u64),
) -> anyhow::Result<Drawn> {
    let pictures = VIEWS.len() + 1;
    let rows = |before: usize, row: u32, rows: u32| {
        let part = u64::from(row) * u64::from(ROWS) / u64::from(rows.max(1));
        on_part(before as u64 * u64::from(ROWS) + part, pictures as u64 * u64::from(ROWS));
    };
    let prefer = if software { Prefer::Software } else { Prefer::Hardware };
    let gpu = pollster::block_on(Gpu::headless(prefer)).context(
        "the pictures of the object need a graphics driver; without a graphics card, install Mesa's software driver (Debian: mesa-vulkan-drivers)",
    )?;
    let mut drawn = Drawn { files: Vec::new(), drawings: Vec::new() };
    posters(pack, folder, &gpu, &mut drawn).context("cannot draw the poster")?;
    std::fs::create_dir_all(folder.join(DRAWINGS))
        .with_context(|| format!("cannot write {}", folder.join(DRAWINGS).display()))?;
    let identity = sheet::identity(&FileSource::open(pack)?)?;
    for (before, (view, name, words)) in (1..).zip(VIEWS) {
        rows(before, 0, ROWS);
        let mut session = session(pack, &gpu)?;
        let display = Display { background: "white".to_owned(), ..Display::default() };
        let options = session.options(&display);
        let Some(args) = SheetArgs::fitting(view, &session.bounds(), title) else { continue };
        let path = format!("{DRAWINGS}/{name}.png");
        let scale = args.scale_text();
        let subject = sheet::Subject {
            session,
            view,
            options,
            pixel_error: 1.0,
            output: &folder.join(&path),
            replace: true,
            identity: identity.clone(),
            on_rows: Some(&|row, all| rows(before, row, all)),
        };
        sheet::run(&args, subject).with_context(|| format!("cannot draw {path}"))?;
        drawn.drawings.push((path.clone(), format!("{words}, {scale}")));
        drawn.files.push(path);
        if view == StandardView::Plan {
            drawn.files.push(format!("{DRAWINGS}/{name}.pgw"));
        }
    }
    Ok(drawn)
}

fn session(pack: &Path, gpu: &Gpu) -> anyhow::Result<Session<FileSource>> {
    let budgets = Budgets { cpu_bytes: MEMORY, gpu_bytes: MEMORY, uploads: 64, ..Budgets::default() };
    Session::open(FileSource::open(pack)?, gpu, budgets).with_context(|| pack.display().to_string())
}

fn posters(pack: &Path, folder: &Path, gpu: &Gpu, drawn: &mut Drawn) -> anyhow::Result<()> {
    let mut session = session(pack, gpu)?;
    let display = Display { background: "light".to_owned(), ..Display::default() };
    let options = session.options(&display);
    let view = session.view(&filling(&session.bounds()), SIZE, 1.0);
    let (picture, _) = session.render(&view, &options)?;
    let pixels = picture.pixels.chunks_exact(4).flat_map(|p| [p[0], p[1], p[2]]).collect();
    let poster = RgbImage::from_raw(SIZE[0], SIZE[1], pixels).context("the picture has another size")?;
    jpeg(&poster, folder, POSTER, drawn)?;
    for (name, width) in THUMBNAILS {
        let small = resize(&poster, width, (width * SIZE[1]).div_ceil(SIZE[0]), FilterType::CatmullRom);
        jpeg(&small, folder, name, drawn)?;
    }
    Ok(())
}

/// The oblique view, with the model's box in the middle of the picture and as near as it can be without leaving it.
fn filling(bounds: &Bounds) -> Camera {
    let mut camera = Camera::standard(StandardView::Iso, bounds, SIZE);
    let (right, up, backward) = (camera.right(), camera.up(), camera.backward());
    let tangent = camera.half_height() / camera.distance;
    let aspect = f64::from(SIZE[0]) / f64::from(SIZE[1]);
    // Where a corner is in the picture: across and up, -1 to 1.
    let seen = |target: DVec3, distance: f64| {
        bounds.corners().map(|c| {
            let v = c - target;
            let depth = ((distance - v.dot(backward)) * tangent).max(1e-9);
            [v.dot(right) / (depth * aspect), v.dot(up) / depth]
        })
    };
    for _ in 0..60 {
        let places = seen(camera.target, camera.distance);
        let low = places.iter().map(|p| p[1]).fold(f64::INFINITY, f64::min);
        let high = places.iter().map(|p| p[1]).fold(f64::NEG_INFINITY, f64::max);
        let shift = f64::midpoint(low, high) * camera.distance * tangent;
        camera.target += up * shift;
        let nearer = camera.distance * 0.97;
        if seen(camera.target, nearer).iter().flatten().any(|x| x.abs() > 0.97) {
            break;
        }
        camera.distance = nearer;
    }
    camera
}

fn jpeg(picture: &RgbImage, folder: &Path, name: &str, drawn: &mut Drawn) -> anyhow::Result<()> {
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, QUALITY).write_image(
        picture.as_raw(),
        picture.width(),
        picture.height(),
        ExtendedColorType::Rgb8,
    )?;
    std::fs::write(folder.join(name), bytes)
        .with_context(|| format!("cannot write {}", folder.join(name).display()))?;
    drawn.files.push(name.to_owned());
    Ok(())
}
