//! Figures of streaming and drawing for `cargo xtask bench view`.
//!
//! `flight sim PACK…`: the two views of design/peers.md (all of it; a place one metre wide) over simulated links: when the first
//! picture and the target are there, what it cost, and the bytes of the chunks that are then shown.

use kilwa_pack::SliceSource;
use kilwa_stream::sim::{Decoders, Flight, Link, PackStore, Simulator};
use kilwa_stream::{Budgets, Stats, View};
use kilwa_viewer::{Bounds, Camera, StandardView};
use std::error::Error;

const SIZE: [u32; 2] = [1280, 720];

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
        _ => Err("usage: flight sim PACK...".into()),
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
            let (streamer, head) = (store.streamer(Budgets { uploads: 16, ..Budgets::default() }), store.head_bytes());
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
