//! `colour_truth SEED PHOTOS PANORAMAS WIDTHxHEIGHT VERTICES FILE.ply…`: compares the colours of meshes of the simulated fort, made from the photographs that `kilwa synth photos` simulates
//! with these options, with the true light (reflectance times light in the middle of the session). Prints a line of JSON per file; used by
//! `cargo xtask bench colour`.
//!
//! Only vertices that a photograph truly sees count. A factor for each channel is free. `psnr` is in linear light, 1 being white.

use kilwa_formats::read::read_mesh;
use kilwa_synth::photos::{PhotoOptions, Place, Session};
use rayon::prelude::*;
use std::path::Path;

/// A vertex counts as seen under at least this cosine.
const FACING: f64 = 0.25;
/// Light that changes by less than this factor is steady.
const STEADY: f64 = 1.3;
/// What light is multiplied by at 0 EV, as in the simulator.
const GAIN: f64 = 0.95;

struct Compared {
    found: [f64; 3],
    /// In the middle of the session, and the mean over it.
    truth: [f64; 3],
    mean: [f64; 3],
    photos: Option<f32>,
    /// Whether its light hardly changes during the session.
    is_steady: bool,
    /// Photographs that see it well, and at all.
    seen: [usize; 2],
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let number = |k: usize| args.get(k).and_then(|arg| arg.parse::<u64>().ok()).expect("a number");
    let (width, height) = args[3].split_once('x').expect("WIDTHxHEIGHT");
    let size = (width.parse().expect("a width"), height.parse().expect("a height"));
    let mut options = PhotoOptions::new(number(1) as u32, size);
    (options.seed, options.panoramas) = (number(0), number(2) as u32);
    let session = Session::new(&options).expect("a session");
    let photos = session.photos();
    let middle = photos.iter().map(|p| p.hour).sum::<f64>() / photos.len() as f64;
    let suns = [photos.first(), photos.get(options.photos as usize - 1)].map(|photo| photo.expect("one").sun);
    let sun =
        photos.iter().min_by(|a, b| (a.hour - middle).abs().total_cmp(&(b.hour - middle).abs())).expect("one").sun;
    for file in &args[5..] {
        compare(&session, [suns[0], sun, suns[1]], number(4) as usize, file);
    }
}

fn compare(session: &Session, suns: [(f64, f64); 3], count: usize, file: &str) {
    let mesh = read_mesh(Path::new(file), &mut |_, _| ()).expect("a mesh");
    let photos = mesh.scalars.iter().find(|(name, _)| name == "photos").map(|(_, values)| values);
    let step = (mesh.positions.len() / count).max(1);
    let vertex = |k: usize| -> Option<Compared> {
        let place = session.surface_at(mesh.positions[k])?;
        let seen = seen(session, &place);
        let lights = suns.map(|sun| session.light_at(&place, sun));
        let light = lights[1];
        let green = lights.map(|light| light[1]);
        let [least, most] =
            [green.iter().copied().fold(f64::INFINITY, f64::min), green.iter().copied().fold(0.0, f64::max)];
        Some(Compared {
            found: mesh.colors[k].map(kilwa_geometry::color::light_from_srgb),
            truth: std::array::from_fn(|c| GAIN * place.albedo[c] * light[c]),
            mean: std::array::from_fn(|c| GAIN * place.albedo[c] * lights.iter().map(|l| l[c]).sum::<f64>() / 3.0),
            photos: photos.map(|values| values[k]),
            is_steady: most < STEADY * least,
            seen,
        })
    };
    let all: Vec<Compared> = (0..mesh.positions.len()).into_par_iter().step_by(step).filter_map(vertex).collect();
    let well: Vec<&Compared> = all.iter().filter(|v| v.seen[0] > 0 && v.photos != Some(0.0)).collect();
    let squares_of = |vertices: &[&Compared], truth: fn(&Compared) -> [f64; 3]| -> Vec<f64> {
        (0..3).flat_map(|c| errors(vertices, c, truth)).map(|e| e * e).collect()
    };
    let squares = squares_of(&well, |v| v.truth);
    let psnr = |squares: &[f64]| -10.0 * (squares.iter().sum::<f64>() / squares.len().max(1) as f64).log10();
    let steady: Vec<&Compared> = well.iter().filter(|v| v.is_steady).copied().collect();
    let mut sorted: Vec<f64> = squares.iter().map(|e| e.sqrt()).collect();
    sorted.sort_by(f64::total_cmp);
    let at = |share: f64| sorted.get((share * sorted.len() as f64) as usize).copied().unwrap_or(0.0);
    let share = |is: &dyn Fn(&Compared) -> bool, of: &dyn Fn(&Compared) -> bool| {
        let whole = all.iter().filter(|v| of(v)).count();
        all.iter().filter(|v| of(v) && is(v)).count() as f64 / whole.max(1) as f64
    };
    println!(
        "{{\"file\":{file:?},\"vertices\":{},\"compared\":{},\"psnr\":{:.2},\"steady_share\":{:.3},\"steady_psnr\":{:.2},\"psnr_mean\":{:.2},\"median\":{:.4},\"p90\":{:.4},\"p99\":{:.4},\"seen_truly\":{:.4},\"missed\":{:.4},\"false\":{:.4}}}",
        all.len(),
        well.len(),
        psnr(&squares),
        steady.len() as f64 / well.len().max(1) as f64,
        psnr(&squares_of(&steady, |v| v.truth)),
        psnr(&squares_of(&well, |v| v.mean)),
        at(0.5),
        at(0.9),
        at(0.99),
        share(&|v| v.seen[0] > 0, &|_| true),
        share(&|v| v.photos == Some(0.0), &|v| v.seen[0] > 0),
        share(&|v| v.photos.is_some_and(|n| n > 0.0), &|v| v.seen[1] == 0),
    );
}

/// Photographs that see a place well, and at all.
fn seen(session: &Session, place: &Place) -> [usize; 2] {
    let mut counts = [0; 2];
    for (number, photo) in session.photos().iter().enumerate() {
        let offset = (place.position - photo.position).normalize();
        let facing = -offset.dot(place.normal);
        if facing > 0.0 && session.sees(number, place) {
            counts[1] += 1;
            counts[0] += usize::from(facing > FACING && !session.is_behind_people(number, place.position));
        }
    }
    counts
}

/// Differences in a channel, after the best factor: the median of ratios.
fn errors(vertices: &[&Compared], channel: usize, truth: fn(&Compared) -> [f64; 3]) -> Vec<f64> {
    let mut ratios: Vec<f64> =
        vertices.iter().filter(|v| v.found[channel] > 0.01).map(|v| truth(v)[channel] / v.found[channel]).collect();
    ratios.sort_by(f64::total_cmp);
    let factor = ratios.get(ratios.len() / 2).copied().unwrap_or(1.0);
    vertices.iter().map(|v| factor * v.found[channel] - truth(v)[channel]).collect()
}
