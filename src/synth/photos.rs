//! `kilwa synth photos`.

use anyhow::Result;
use kilwa_pack::plural::counted;
use kilwa_synth::photos::{self, PhotoOptions};
use std::io::Write as _;
use std::path::PathBuf;

/// Simulated photographs and panoramas of the fort under a moving sun, with poses in COLMAP's format and the ground
/// truth in separate files.
#[derive(clap::Args)]
pub(super) struct Args {
    /// The folder to create: pictures and poses in its subfolder `photos`, the ground truth in `truth`.
    #[arg(short, long = "output", value_name = "FOLDER")]
    output: PathBuf,
    /// Number of photographs, up to 2,000; positions are chosen so that three photographs show as much of the fort as
    /// possible.
    #[arg(long, value_name = "N", default_value_t = 60)]
    photos: u32,
    /// Number of panoramas, up to 200: one from each of the first stations of `kilwa synth scans` with the same seed.
    #[arg(long, value_name = "N", default_value_t = 4)]
    panoramas: u32,
    /// Width and height of a photograph in pixels, each 32 to 8,192. Panoramas are twice as wide, and as high as photographs are wide.
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "1600x1200", value_parser = size)]
    size: (u32, u32),
    /// Seed of the fort and of everything random.
    #[arg(long, value_name = "S", default_value_t = 1)]
    seed: u64,
    /// Vary exposures by up to this many stops in either direction.
    #[arg(long, value_name = "EV", default_value_t = 1.0)]
    exposure: f64,
    /// Percentage of pixels that show people, over all pictures. Their positions differ from picture to picture.
    #[arg(long, value_name = "PERCENT", default_value_t = 2.0)]
    passers_by: f64,
    /// Hours from the first photograph to the last, up to 6, centred on nine in the morning; the sun moves in this
    /// time.
    #[arg(long, value_name = "HOURS", default_value_t = 2.0)]
    hours: f64,
    /// Multiply the sensor noise by this factor; 0 turns it off.
    #[arg(long, value_name = "FACTOR", default_value_t = 1.0)]
    noise: f64,
    /// Write poses and sparse points in an arbitrary frame (scale, rotation and shift), as structure from motion does,
    /// instead of the survey's.
    #[arg(long)]
    sfm_frame: bool,
    /// Rotate and move the poses so that sparse points are off by PX pixels (root mean square) in each photograph.
    #[arg(long, value_name = "PX", default_value_t = 0.0)]
    pose_error: f64,
    /// Also write the range of each pixel, as 16-bit PNG files in units of 2 mm.
    #[arg(long)]
    truth_depth: bool,
    /// Worker threads (default: one per core). The bytes do not depend on it.
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true, value_parser = crate::build::parse_threads)]
    threads: usize,
    /// Print the report as JSON.
    #[arg(long)]
    json: bool,
}

/// Width and height, for example `1600x1200`.
fn size(text: &str) -> Result<(u32, u32), String> {
    let parts = text.split_once(['x', 'X', '×']);
    let size = parts.and_then(|(width, height)| Some((width.parse().ok()?, height.parse().ok()?)));
    size.ok_or_else(|| format!("`{text}` is not a size: write width and height in pixels, for example 1600x1200"))
}

impl Args {
    fn options(&self) -> PhotoOptions {
        PhotoOptions {
            seed: self.seed,
            photos: self.photos,
            panoramas: self.panoramas,
            size: self.size,
            exposure: self.exposure,
            passers_by: self.passers_by,
            hours: self.hours,
            noise: self.noise,
            sfm_frame: self.sfm_frame,
            pose_error: self.pose_error,
            truth_depth: self.truth_depth,
        }
    }
}

pub(super) fn run(args: &Args) -> Result<()> {
    let options = args.options();
    let pool = rayon::ThreadPoolBuilder::new().num_threads(args.threads).build()?;
    let bar = super::progress_bar(0);
    let report = pool.install(|| {
        photos::write(&options, &args.output, &mut |done, total| {
            bar.set_length(total);
            bar.set_position(done);
        })
    });
    bar.finish_and_clear();
    let report = report?;
    let [hand, drone, panoramas] = report.by_carrier;
    let mut out = crate::terminal::out();
    if args.json {
        let files: Vec<String> = report.files.iter().map(|f| f.display().to_string()).collect();
        let json = serde_json::json!({
            "files": files,
            "truth": report.truth.display().to_string(),
            "photos": hand + drone,
            "by_hand": hand,
            "by_drone": drone,
            "panoramas": panoramas,
            "pixels": report.pixels,
            "surface_pixels": report.surface_pixels,
            "people_pixels": report.people_pixels,
            "points": report.points,
            "bytes": report.bytes,
            "seed": args.seed,
        });
        writeln!(out, "{}", crate::terminal::json_line(&json)?)?;
        return Ok(());
    }
    writeln!(
        out,
        "{}: {} ({hand} by hand, {drone} by drone), {}, {:.1} MB",
        args.output.display(),
        counted(u64::from(hand + drone), "photograph", "photographs"),
        counted(u64::from(panoramas), "panorama", "panoramas"),
        report.bytes as f64 / 1e6
    )?;
    let share = |pixels: u64| 100.0 * pixels as f64 / report.pixels.max(1) as f64;
    writeln!(
        out,
        "pixels: surface {:.1} %, people {:.2} %; {}",
        share(report.surface_pixels),
        share(report.people_pixels),
        counted(report.points, "sparse point", "sparse points")
    )?;
    writeln!(out, "truth: {}", report.truth.display())?;
    Ok(())
}
