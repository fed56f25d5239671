//! Measures drawing on this machine's GPU. `cargo xtask bench gpu` packs this program, `kilwa` (which makes the models)
//! and a script into an archive that runs without a toolchain.
//!
//! For every pack, size and pixel error: how long a picture takes from bytes in memory; an orbit around the whole model and a flight along its
//! surface in real time, streamed and decoded as in the page. Frames are drawn as fast as possible, two in flight, to a
//! target without sRGB, like a canvas. It prints percentiles of the time from frame to frame; processor time of a
//! frame, by part; GPU time of every pass, from timestamps. Software renderers get the same tables and are marked as
//! such.

#[path = "../shared/course.rs"]
mod course;
mod measure;
mod report;

use clap::Parser;
use kilwa_viewer::{Gpu, Mode, Prefer};
use measure::{Course, Run, Setting};
use std::error::Error;
use std::num::NonZeroUsize;
use std::path::PathBuf;

#[derive(Parser)]
#[command(about = "Measure how fast packs are drawn on this machine's GPU")]
struct Args {
    /// Packs to draw
    #[arg(required = true, value_name = "FILE")]
    packs: Vec<PathBuf>,
    /// Width and height of the picture; separate several with commas
    #[arg(long, value_name = "WxH", value_delimiter = ',', default_value = "1920x1080,3840x2160", value_parser = size)]
    sizes: Vec<[u32; 2]>,
    /// Pixel errors to refine to; 0 shows the finest surface
    #[arg(long, value_name = "PX", value_delimiter = ',', default_value = "1,0.5,0")]
    pixels: Vec<f64>,
    /// Duration of each orbit and flight, seconds
    #[arg(long, value_name = "S", default_value_t = 6.0)]
    seconds: f64,
    /// Samples per pixel, 1 or 4; by default 4 if the adapter supports it, as in the page
    #[arg(long, value_name = "N", value_parser = samples)]
    samples: Option<u32>,
    /// Decoding threads; by default as many as the page would have workers
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Record draw calls one by one, as a browser does, instead of letting the GPU read them from a buffer
    #[arg(long)]
    direct: bool,
    /// Write the figures as JSON, too
    #[arg(long, value_name = "FILE")]
    json: Option<PathBuf>,
}

fn samples(text: &str) -> Result<u32, String> {
    text.parse().ok().filter(|n| [1, 4].contains(n)).ok_or_else(|| "the number of samples must be 1 or 4".to_owned())
}

fn size(text: &str) -> Result<[u32; 2], String> {
    let parsed = text.split_once('x').and_then(|(w, h)| Some([w.parse().ok()?, h.parse().ok()?]));
    parsed
        .filter(|s: &[u32; 2]| s.iter().all(|&n| n > 0))
        .ok_or_else(|| "give width and height in pixels, such as 1920x1080".to_owned())
}

fn main() -> Result<(), Box<dyn Error>> {
    let args = Args::parse();
    let gpu = pollster::block_on(Gpu::headless(Prefer::Hardware))?;
    let threads = args.threads.unwrap_or_else(measure::page_workers);
    print!("{}", report::machine(&gpu, threads));
    let mut runs: Vec<Run> = Vec::new();
    for path in &args.packs {
        let bytes = std::fs::read(path).map_err(|e| format!("cannot read {}: {e}", path.display()))?;
        let pack = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        for &size in &args.sizes {
            let setting = |pixels: f64, mode: Mode| Setting {
                pack: pack.clone(),
                size,
                samples: args.samples.unwrap_or_else(|| gpu.samples(measure::CANVAS_FORMAT)),
                pixels,
                seconds: args.seconds,
                threads,
                mode,
                direct: args.direct,
            };
            for &pixels in &args.pixels {
                eprintln!("{pack}, {} x {}, {pixels} px", size[0], size[1]);
                let courses = [Course::Orbit, Course::Flight];
                let courses = if pixels > 0.0 { &courses[..] } else { &courses[..1] };
                runs.push(measure::run(&gpu, &bytes, setting(pixels, Mode::Color), courses)?);
            }
            // A mode with the depth and normal pass.
            runs.push(measure::run(&gpu, &bytes, setting(1.0, Mode::EyeDome), &[Course::Orbit])?);
        }
    }
    print!("{}", report::tables(&runs));
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(&report::json(&gpu, &runs))?;
        std::fs::write(path, text).map_err(|e| format!("cannot write {}: {e}", path.display()))?;
    }
    Ok(())
}
