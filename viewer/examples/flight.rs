//! Figures of streaming and drawing for `cargo xtask bench view`.
//!
//! `flight sim PACK…`: the views (all of it, obliquely and from the front; a place one metre wide) over simulated
//! links: when the first picture and the target are there, what it cost, and that over the bytes of the chunks that are then shown. The pixel
//! error is 1 or `ERR`; with `LOG` in the environment the requests over 10 Mbit/s are listed, too.
//!
//! `flight steps PACK WIDTH HEIGHT`: how long [`kilwa_stream::Streamer::step`] takes while a view is loaded, at rest, in an orbit around the
//! whole model, in the same orbit again (now everything is resident), and in the recorded flight; what making the list of draw calls takes; and a
//! digest of all answers. The pixel error is 1 or `ERR`, the memory for chunks `GPU_BYTES`.
//!
//! `flight render PACK WIDTH HEIGHT FRAMES`: a recorded flight (all of it, down to the surface, along it, back) drawn
//! without a window: times of whole frames (deciding, reading, decoding, uploading, drawing, waiting for the GPU) and of drawing alone.

#[path = "shared/course.rs"]
mod course;

use glam::IVec3;
use kilwa_pack::reader::decode_checked;
use kilwa_pack::{HEAD_BYTES, SliceSource, Source};
use kilwa_stream::sim::{Decoders, Flight, Link, PackStore, Simulator};
use kilwa_stream::{Budgets, Command, Event, FetchKind, Stats, Step, Streamer, View, length_of};
use kilwa_viewer::draw_list::{DrawList, PerCall, Place};
use kilwa_viewer::shell::native::Session;
use kilwa_viewer::{Bounds, Camera, Gpu, Prefer, RenderOptions, StandardView};
use std::collections::BTreeMap;
use std::error::Error;
use std::f64::consts::TAU;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::time::Instant;

const SIZE: [u32; 2] = [1280, 720];
/// About as many as a slab of the largest size has.
const SLAB_INDICES: u32 = 1_500_000;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let error: f64 = std::env::var("ERR").ok().map_or(Ok(1.0), |e| e.parse())?;
    match args.split_first() {
        Some((verb, packs)) if verb == "sim" => {
            println!(
                "| pack | view | link | first picture s | target s | MB | requests | triangles | bytes / bytes shown |"
            );
            println!("|---|---|---|---:|---:|---:|---:|---:|---:|");
            for pack in packs {
                simulate(pack, error)?;
            }
            Ok(())
        }
        Some((verb, [pack, width, height, frames])) if verb == "render" => {
            render(pack, [width.parse()?, height.parse()?], frames.parse()?)
        }
        Some((verb, [pack, width, height])) if verb == "steps" => steps(pack, [width.parse()?, height.parse()?], error),
        _ => Err("usage: flight sim PACK... | flight steps PACK WIDTH HEIGHT | flight render PACK WIDTH HEIGHT FRAMES"
            .into()),
    }
}

fn views(store: &PackStore<SliceSource<Vec<u8>>>, error: f64) -> Vec<(&'static str, View)> {
    let m = store.reader().metadata();
    let bounds = Bounds { min: m.bounds_min, max: m.bounds_max };
    let all = Camera::standard(StandardView::Iso, &bounds, SIZE);
    let mut front = Camera::standard(StandardView::South, &bounds, SIZE);
    front.orthographic = false;
    let mut near = front;
    near.distance = 0.5 / ((front.field_of_view * 0.5).tan() * f64::from(SIZE[0]) / f64::from(SIZE[1]));
    near.target[1] = bounds.min[1];
    let view = |camera: &Camera| camera.view(&store.head().header.lattice, &bounds, SIZE, error);
    vec![("oblique", view(&all)), ("front", view(&front)), ("1 m wide", view(&near))]
}

fn simulate(pack: &str, error: f64) -> Result<(), Box<dyn Error>> {
    let bytes = std::fs::read(pack)?;
    let name = std::path::Path::new(pack).file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let store = PackStore::open(SliceSource(bytes.clone()))?;
    for (view_name, view) in views(&store, error) {
        for (link_name, link) in
            [("1 Gbit/s, 5 ms", Link::FAST), ("10 Mbit/s, 50 ms", Link::COMMON), ("2 Mbit/s, 300 ms", Link::SLOW)]
        {
            let store = PackStore::open(SliceSource(bytes.clone()))?;
            let number =
                |name: &str, otherwise: u64| std::env::var(name).ok().map_or(Ok(otherwise), |e| e.parse::<u64>());
            let usual = Budgets { uploads: 16, ..Budgets::default() };
            let budgets = Budgets {
                ranges: number("RANGES", 1)? as usize,
                requests: number("REQUESTS", 6)? as usize,
                request_bytes: number("REQUEST_BYTES", usual.request_bytes)?,
                bytes_in_flight: number("IN_FLIGHT", usual.bytes_in_flight)?,
                ..usual
            };
            let (streamer, head) = (store.streamer(budgets), store.head_bytes());
            let mut sim = Simulator::new(streamer, head, store, link, Decoders::default());
            let flight = Flight::new(view, Vec::new());
            let mut first = f64::NAN;
            let mut reached: Option<(f64, Stats, u64)> = None;
            let mut now = sim.start_ms();
            while reached.is_none() && now < 600_000.0 {
                let step = sim.step(now, &flight.at(now));
                if first.is_nan() && !step.draw.is_empty() {
                    first = now;
                }
                if step.stats.target_reached || step.stats.settled {
                    reached = Some((now, step.stats, sim.totals().bytes + head));
                }
                now += 16.0;
            }
            if std::env::var_os("LOG").is_some() && link_name.starts_with("10 ") {
                println!("{}", sim.log());
            }
            let Some((at, stats, cost)) = reached else {
                println!("| {name} | {view_name} | {link_name} | the target was not reached |");
                continue;
            };
            println!(
                "| {name} | {view_name} | {link_name} | {:.2} | {:.2} | {:.2} | {} | {} | {:.2} |",
                first / 1e3,
                at / 1e3,
                cost as f64 / 1e6,
                sim.totals().requests + 1,
                stats.triangles_drawn,
                cost as f64 / stats.bytes_shown as f64,
            );
        }
    }
    Ok(())
}

fn steps(pack: &str, size: [u32; 2], error: f64) -> Result<(), Box<dyn Error>> {
    let source = SliceSource(std::fs::read(pack)?);
    let head = kilwa_pack::parse_head(&source.0)?;
    let bounds = Bounds { min: head.metadata.bounds_min, max: head.metadata.bounds_max };
    let number = |name: &str, otherwise: u64| std::env::var(name).ok().map_or(Ok(otherwise), |e| e.parse::<u64>());
    let budgets =
        Budgets { uploads: 64, gpu_bytes: number("GPU_BYTES", 16 << 30)?, cpu_bytes: 32 << 30, ..Budgets::default() };
    let mut streamer = Streamer::new(&head, HEAD_BYTES, budgets);
    let whole = course::whole(&bounds, size);
    let lattice = head.header.lattice;
    let (mut now, mut events) = (0.0, Vec::new());
    let (mut places, mut list) = (Places::default(), DrawList::default());
    println!(
        "| course | steps | ms p50 | ms p99 | draw list ms p50 | ms p99 | chunks | patches | calls | M triangles | digest |"
    );
    println!("|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---|");
    for (course, count) in [("load", usize::MAX), ("rest", 400), ("orbit", 400), ("orbit again", 400), ("flight", 400)]
    {
        let (mut times, mut list_times) = (Vec::new(), Vec::new());
        let mut stats = Stats::default();
        let mut digest = DefaultHasher::new();
        for frame in 0..count {
            let share = frame as f64 / 400.0;
            let camera = match course {
                "load" | "rest" => whole,
                "flight" => course::flight(&whole, &bounds, share),
                _ => Camera { azimuth: whole.azimuth + TAU * share, ..whole },
            };
            now += 16.0;
            let view = camera.view(&lattice, &bounds, size, error);
            let begun = Instant::now();
            let step = streamer.step(&view, now, std::mem::take(&mut events));
            times.push(begun.elapsed().as_secs_f64() * 1e3);
            places.follow(&streamer, &step);
            let begun = Instant::now();
            list.collect(&view, &step.draw, &[], PerCall::Fades, |chunk| places.of.get(&chunk).copied());
            list_times.push(begun.elapsed().as_secs_f64() * 1e3);
            write_digest(&step, &mut digest);
            stats = step.stats;
            events = answers(&streamer, &source, &step.commands)?;
            if count == usize::MAX && stats.settled {
                break;
            }
        }
        let at = |times: &mut Vec<f64>, share: f64| {
            times.sort_by(f64::total_cmp);
            times[((times.len() - 1) as f64 * share).round() as usize]
        };
        println!(
            "| {course} | {} | {:.3} | {:.3} | {:.3} | {:.3} | {} | {} | {} | {:.2} | {:016x} |",
            times.len(),
            at(&mut times, 0.5),
            at(&mut times, 0.99),
            at(&mut list_times, 0.5),
            at(&mut list_times, 0.99),
            stats.chunks_resident,
            stats.patches_drawn,
            list.calls().len(),
            stats.triangles_drawn as f64 / 1e6,
            digest.finish(),
        );
    }
    Ok(())
}

/// Where chunks would be in GPU memory: one behind the other in slabs of the usual size, whose gaps are not used again.
#[derive(Default)]
struct Places {
    of: BTreeMap<u32, Place>,
    slab: u32,
    next_index: u32,
}

impl Places {
    fn follow(&mut self, streamer: &Streamer, step: &Step) {
        for command in &step.commands {
            match *command {
                Command::Upload { chunk } => {
                    let Some(entry) = streamer.entry(chunk) else { continue };
                    let [low, high] = [entry.bounds.min, entry.bounds.max].map(IVec3::as_dvec3);
                    if self.next_index + entry.triangles * 3 > SLAB_INDICES {
                        (self.slab, self.next_index) = (self.slab + 1, 0);
                    }
                    let place = Place {
                        slab: self.slab,
                        first_index: self.next_index,
                        triangles: entry.triangles,
                        middle: (low + high) * 0.5,
                    };
                    self.next_index += entry.triangles * 3;
                    self.of.insert(chunk, place);
                }
                Command::Evict { chunk } => {
                    self.of.remove(&chunk);
                }
                _ => {}
            }
        }
    }
}

/// Everything that a step answers: whoever changes the streamer sees whether it decides as before.
fn write_digest(step: &Step, digest: &mut DefaultHasher) {
    format!("{:?} {:?}", step.commands, step.stats).hash(digest);
    for p in step.draw.iter() {
        (p.chunk, p.patch, p.first, p.count, p.diamond, p.level, p.error.to_bits(), p.visible).hash(digest);
    }
}

/// Everything that is asked for is answered before the next step.
fn answers(
    streamer: &Streamer,
    source: &SliceSource<Vec<u8>>,
    commands: &[Command],
) -> Result<Vec<Event>, Box<dyn Error>> {
    let mut events = Vec::new();
    for command in commands {
        match *command {
            Command::Fetch { request, ref ranges, kind: FetchKind::Pages } => {
                let mut bytes = Vec::new();
                for range in ranges {
                    bytes.extend(source.read_at(range.start, usize::try_from(range.end - range.start)?)?);
                }
                events.push(Event::PageBytes { request, bytes });
            }
            Command::Fetch { request, ref ranges, .. } => {
                events.push(Event::Bytes { request, length: length_of(ranges) });
            }
            Command::Decode { chunk, .. } => {
                let entry = streamer.entry(chunk).ok_or("a chunk without an entry")?;
                let bytes = source.read_at(entry.offset, usize::try_from(entry.encoded_bytes)?)?;
                let decoded = decode_checked(&bytes, chunk, entry, streamer.header())?;
                events.push(Event::Decoded { chunk, patches: decoded.patches });
            }
            Command::Cancel { .. } | Command::Upload { .. } | Command::Evict { .. } => {}
        }
    }
    Ok(events)
}

fn render(pack: &str, size: [u32; 2], frames: usize) -> Result<(), Box<dyn Error>> {
    let gpu = pollster::block_on(Gpu::headless(Prefer::Hardware))?;
    let budgets = Budgets { uploads: 64, ..Budgets::default() };
    let mut session = Session::open(SliceSource(std::fs::read(pack)?), &gpu, budgets)?;
    let bounds = session.bounds();
    let all = course::whole(&bounds, size);
    let target = course::target(&gpu, size, kilwa_viewer::renderer::IMAGE_FORMAT);
    let options = RenderOptions::default();
    let (mut whole, mut draws, mut triangles) = (Vec::new(), Vec::new(), 0);
    let mut last = Stats::default();
    let begun = Instant::now();
    for frame in 0..frames {
        let started = Instant::now();
        let view = session.view(&course::flight(&all, &bounds, frame as f64 / (frames - 1).max(1) as f64), size, 1.0);
        let step = session.settle(&view)?;
        let drawing = Instant::now();
        session.renderer().draw(&view, &step.draw, &options, &target);
        gpu.device.poll(wgpu::PollType::wait_indefinitely())?;
        draws.push(drawing.elapsed().as_secs_f64() * 1e3);
        whole.push(started.elapsed().as_secs_f64() * 1e3);
        triangles += step.stats.triangles_drawn;
        last = step.stats;
    }
    let seconds = begun.elapsed().as_secs_f64();
    println!("Adapter: {}. {} x {} pixels, {frames} frames, 1 px.\n", gpu.describe(), size[0], size[1]);
    println!("| ms | p50 | p95 | p99 |\n|---|---:|---:|---:|");
    for (name, times) in [("frame", &mut whole), ("drawing", &mut draws)] {
        times.sort_by(f64::total_cmp);
        let at = |share: f64| times[((times.len() - 1) as f64 * share).round() as usize];
        println!("| {name} | {:.2} | {:.2} | {:.2} |", at(0.5), at(0.95), at(0.99));
    }
    println!(
        "\n{:.0} triangles a frame, {:.1} M triangles a second, {} requests, {:.2} MB loaded, {:.2} MB a second, {} chunks held at the end.\n",
        triangles as f64 / frames as f64,
        triangles as f64 / seconds / 1e6,
        last.requests_made,
        last.bytes_received as f64 / 1e6,
        last.bytes_received as f64 / 1e6 / seconds,
        last.chunks_resident,
    );
    Ok(())
}
