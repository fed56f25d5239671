//! The tables, and the same as JSON.

use crate::measure::{Course, Frame, Run};
use kilwa_viewer::gpu::timer::PassTime;
use kilwa_viewer::{Gpu, Mode};
use serde_json::json;
use std::fmt::Write as _;
use std::num::NonZeroUsize;

/// Lines on the machine.
pub(crate) fn machine(gpu: &Gpu, threads: NonZeroUsize) -> String {
    let info = gpu.adapter.get_info();
    let software = if info.device_type == wgpu::DeviceType::Cpu {
        " It is a software renderer, so these figures are for the CPU."
    } else {
        ""
    };
    let timestamps = if gpu.device.features().contains(wgpu::Features::TIMESTAMP_QUERY) {
        ""
    } else {
        " It does not support timestamps, so GPU times are missing."
    };
    let cores = std::thread::available_parallelism().map_or(0, NonZeroUsize::get);
    format!(
        "Adapter: {}, driver {} {}.{software}{timestamps} Processor: {}, {cores} threads, {threads} of them decode.\n\n",
        gpu.describe(),
        info.driver,
        info.driver_info,
        processor(),
    )
}

fn processor() -> String {
    let text = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = text.lines().find_map(|line| line.strip_prefix("model name")?.split_once(':'));
    name.map_or("unknown", |(_, name)| name.trim()).to_owned()
}

/// All tables in Markdown.
pub(crate) fn tables(runs: &[Run]) -> String {
    let mut out = String::from(
        "From bytes in memory to pictures of the whole model:\n\n\
         | pack | size | mode | px | first picture ms | target ms | chunks | MB of the pack | M triangles | GPU memory MB |\n\
         |---|---|---|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    for run in runs {
        let (setting, load) = (&run.setting, &run.load);
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {:.1} | {:.0} | {} | {:.1} | {:.2} | {:.0} |",
            setting.pack,
            size(run),
            mode(setting.mode),
            setting.pixels,
            load.first_ms,
            load.target_ms,
            load.stats.chunks_resident,
            load.stats.bytes_received as f64 / 1e6,
            load.stats.triangles_drawn as f64 / 1e6,
            load.stats.gpu_bytes as f64 / 1e6,
        );
    }
    out += "\nSizes are width x height x samples. Frames; processor and GPU times are those of one frame, p50 / p99:\n\n\
         | pack | size | mode | px | course | frames | ms p50 | ms p95 | ms p99 | frames/s at p99 | processor: step ms | of it uploads ms | processor: draw ms | GPU ms | M triangles | patches | calls | G triangles/s on the GPU |\n\
         |---|---|---|---:|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n";
    for (run, course, frames) in all_courses(runs) {
        let f = Figures::new(frames);
        let gpu = f.gpu.map_or("-".to_owned(), pair);
        let rate = f.gpu_triangles_per_s.map_or("-".to_owned(), |r| format!("{:.2}", r / 1e9));
        let _ = writeln!(
            out,
            "| {} | {} | {} | {} | {} | {} | {:.2} | {:.2} | {:.2} | {:.0} | {} | {} | {} | {gpu} | {:.2} | {:.0} | {:.0} | {rate} |",
            run.setting.pack,
            size(run),
            mode(run.setting.mode),
            run.setting.pixels,
            name(course),
            frames.len(),
            f.frame[0],
            f.frame[1],
            f.frame[2],
            1e3 / f.frame[2],
            pair(f.step),
            pair(f.upload),
            pair(f.draw),
            f.triangles / 1e6,
            f.patches,
            f.calls,
        );
    }
    out += "\nPasses, p50 / p99:\n\n| pack | size | mode | px | course | pass | processor ms | GPU ms |\n|---|---|---|---:|---|---|---:|---:|\n";
    for (run, course, frames) in all_courses(runs) {
        for PassFigures { name: pass, cpu, gpu } in passes(frames) {
            let gpu = gpu.map_or("-".to_owned(), pair);
            let (pack, size, mode, px) = (&run.setting.pack, size(run), mode(run.setting.mode), run.setting.pixels);
            let _ = writeln!(
                out,
                "| {pack} | {size} | {mode} | {px} | {} | {pass} | {} | {gpu} |",
                name(course),
                pair(cpu)
            );
        }
    }
    out
}

/// The same figures for programs.
pub(crate) fn json(gpu: &Gpu, runs: &[Run]) -> serde_json::Value {
    let courses = |run: &Run| -> Vec<_> {
        let one = |(course, frames): &(Course, Vec<Frame>)| {
            let f = Figures::new(frames);
            let passes: Vec<_> = passes(frames)
                .into_iter()
                .map(|p| json!({ "pass": p.name, "cpu_ms": p.cpu, "gpu_ms": p.gpu }))
                .collect();
            json!({
                "course": name(*course), "frames": frames.len(), "frame_ms": f.frame, "step_ms": f.step, "upload_ms": f.upload, "draw_ms": f.draw,
                "gpu_ms": f.gpu, "triangles": f.triangles, "patches": f.patches, "calls": f.calls,
                "gpu_triangles_per_s": f.gpu_triangles_per_s, "passes": passes,
            })
        };
        run.courses.iter().map(one).collect()
    };
    let runs: Vec<_> = runs
        .iter()
        .map(|run| {
            let load = &run.load;
            json!({
                "pack": run.setting.pack, "size": run.setting.size, "samples": run.setting.samples, "mode": mode(run.setting.mode), "pixels": run.setting.pixels,
                "first_picture_ms": load.first_ms, "target_ms": load.target_ms, "bytes": load.stats.bytes_received,
                "courses": courses(run),
            })
        })
        .collect();
    json!({ "adapter": gpu.describe(), "processor": processor(), "runs": runs })
}

fn all_courses(runs: &[Run]) -> impl Iterator<Item = (&Run, Course, &[Frame])> {
    runs.iter().flat_map(|run| run.courses.iter().map(move |(course, frames)| (run, *course, frames.as_slice())))
}

fn size(run: &Run) -> String {
    let [width, height] = run.setting.size;
    format!("{width}x{height} x{}", run.setting.samples)
}

fn mode(mode: Mode) -> &'static str {
    Mode::ALL.iter().find(|(m, _)| *m == mode).map_or("", |(_, name)| name)
}

fn name(course: Course) -> &'static str {
    match course {
        Course::Rest => "rest",
        Course::Orbit => "orbit",
        Course::Flight => "flight",
    }
}

fn pair([p50, p99]: [f64; 2]) -> String {
    format!("{p50:.2} / {p99:.2}")
}

/// Figures of the frames of a course.
struct Figures {
    /// p50, p95, p99.
    frame: [f64; 3],
    /// p50 and p99, milliseconds.
    step: [f64; 2],
    upload: [f64; 2],
    draw: [f64; 2],
    gpu: Option<[f64; 2]>,
    /// Means.
    triangles: f64,
    patches: f64,
    calls: f64,
    gpu_triangles_per_s: Option<f64>,
}

impl Figures {
    fn new(frames: &[Frame]) -> Self {
        let sorted = |value: &dyn Fn(&Frame) -> Option<f64>| {
            let mut values: Vec<f64> = frames.iter().filter_map(value).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let both = |values: &[f64]| [at(values, 0.5), at(values, 0.99)];
        let times = sorted(&|f| Some(f.ms));
        let gpu = sorted(&gpu_ms);
        let count = frames.len().max(1) as f64;
        let triangles = frames.iter().map(|f| f.triangles as f64).sum::<f64>();
        let gpu_s = gpu.iter().sum::<f64>() / 1e3;
        Self {
            frame: [0.5, 0.95, 0.99].map(|share| at(&times, share)),
            step: both(&sorted(&|f| Some(f.step_ms))),
            upload: both(&sorted(&|f| Some(f.upload_ms))),
            draw: both(&sorted(&|f| Some(f.draw_ms))),
            gpu: (!gpu.is_empty()).then(|| both(&gpu)),
            triangles: triangles / count,
            patches: frames.iter().map(|f| f64::from(f.patches)).sum::<f64>() / count,
            calls: frames.iter().map(|f| f.calls as f64).sum::<f64>() / count,
            gpu_triangles_per_s: (gpu_s > 0.0).then(|| triangles / gpu_s),
        }
    }
}

/// GPU time of a frame's passes together, if all of them have one.
fn gpu_ms(frame: &Frame) -> Option<f64> {
    let times: Option<Vec<f64>> = frame.passes.iter().map(|p| p.gpu_ms).collect();
    times.filter(|t| !t.is_empty()).map(|t| t.iter().sum())
}

/// Times of a pass, p50 and p99, milliseconds.
struct PassFigures {
    name: &'static str,
    cpu: [f64; 2],
    gpu: Option<[f64; 2]>,
}

/// Every pass of the frames.
fn passes(frames: &[Frame]) -> Vec<PassFigures> {
    let first = frames.first().map(|f| f.passes.iter().map(|p| p.name));
    let of = |name: &str, value: &dyn Fn(&PassTime) -> Option<f64>| {
        let all = frames.iter().flat_map(|f| &f.passes).filter(|p| p.name == name);
        let mut values: Vec<f64> = all.filter_map(value).collect();
        values.sort_by(f64::total_cmp);
        (!values.is_empty()).then(|| [at(&values, 0.5), at(&values, 0.99)])
    };
    let figures = |name| PassFigures {
        name,
        cpu: of(name, &|p| Some(p.cpu_ms)).unwrap_or_default(),
        gpu: of(name, &|p| p.gpu_ms),
    };
    first.into_iter().flatten().map(figures).collect()
}

fn at(sorted: &[f64], share: f64) -> f64 {
    let last = sorted.len().saturating_sub(1) as f64;
    sorted.get((last * share).round() as usize).copied().unwrap_or(f64::NAN)
}
