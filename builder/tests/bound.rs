//! The certified error holds: for every stored level of three synthetic meshes and three real scans, points sampled on the coarse surface are within ε*
//! of the finest one and points sampled on the finest one within the cut's ε* of the coarse one. The search here is a
//! simple grid, independent of the certifier.

use crate::support::{Opened, build, closed, fort, open, wall};
use glam::DVec3;
use kilwa_geometry::distance::point_triangle_squared;
use kilwa_pack::cut::Cut;
use rayon::prelude::*;
use std::collections::HashMap;
use std::path::Path;

type Triangle = [DVec3; 3];

/// In larger meshes every level samples about this many triangles, different ones at each level.
const SAMPLED: usize = 25_000;

/// Triangles in a uniform grid of cubes.
struct Grid {
    cell: f64,
    cells: HashMap<[i32; 3], Vec<u32>>,
    triangles: Vec<Triangle>,
}

impl Grid {
    fn new(triangles: Vec<Triangle>) -> Self {
        let edge = |t: &Triangle| t[0].distance(t[1]);
        let cell = (triangles.iter().map(edge).sum::<f64>() / triangles.len() as f64 * 1.5).max(1.0);
        let mut cells: HashMap<[i32; 3], Vec<u32>> = HashMap::new();
        for (n, t) in triangles.iter().enumerate() {
            let low = (t.iter().copied().fold(DVec3::MAX, DVec3::min) / cell).floor().as_ivec3();
            let high = (t.iter().copied().fold(DVec3::MIN, DVec3::max) / cell).floor().as_ivec3();
            for x in low.x..=high.x {
                for y in low.y..=high.y {
                    for z in low.z..=high.z {
                        cells.entry([x, y, z]).or_default().push(n as u32);
                    }
                }
            }
        }
        Self { cell, cells, triangles }
    }

    /// Distance to the nearest triangle and its number: cubes in growing shells until no nearer one is possible.
    fn nearest(&self, p: DVec3) -> (f64, u32) {
        let home = (p / self.cell).floor().as_ivec3();
        let mut best = (f64::MAX, 0);
        for r in 0i32.. {
            if best.0.sqrt() <= f64::from(r - 1) * self.cell {
                break;
            }
            for x in -r..=r {
                for y in -r..=r {
                    let shell = x.abs() == r || y.abs() == r;
                    for z in (-r..=r).step_by(if shell || r == 0 { 1 } else { 2 * r as usize }) {
                        for t in self.cells.get(&[home.x + x, home.y + y, home.z + z]).into_iter().flatten() {
                            let d = point_triangle_squared(p, self.triangles[*t as usize]);
                            if d < best.0 {
                                best = (d, *t);
                            }
                        }
                    }
                }
            }
        }
        (best.0.sqrt(), best.1)
    }

    fn distance(&self, p: DVec3) -> f64 {
        self.nearest(p).0
    }
}

/// Points on a triangle: corners, middle, and some at random.
fn samples(t: &Triangle, random: &mut fastrand::Rng, n: usize) -> Vec<DVec3> {
    let at = |u: f64, v: f64| t[0] + (t[1] - t[0]) * u + (t[2] - t[0]) * v;
    let mut out = vec![t[0], t[1], t[2], at(1.0 / 3.0, 1.0 / 3.0)];
    for _ in 0..n {
        let (mut u, mut v) = (random.f64(), random.f64());
        if u + v > 1.0 {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        out.push(at(u, v));
    }
    out
}

fn drawn_by_diamond(pack: &Opened, cut: &Cut) -> HashMap<u32, Vec<Triangle>> {
    let mut out: HashMap<u32, Vec<Triangle>> = HashMap::new();
    for i in cut.refined() {
        let chunk = &pack.chunks[i as usize];
        for p in cut.drawn(&chunk.patches) {
            let triangles =
                (p.first..p.first + p.count).map(|t| chunk.mesh.corners(t as usize).map(glam::IVec3::as_dvec3));
            out.entry(p.diamond).or_default().extend(triangles);
        }
    }
    out
}

fn the_bound_holds_at_every_level(name: &str, raw: kilwa_formats::RawMesh) {
    let pack = open(&build(raw, 0));
    let finest: Vec<Triangle> = drawn_by_diamond(&pack, &Cut::finest(&pack.entries)).into_values().flatten().collect();
    let reference = Grid::new(finest);
    let deepest = pack.entries.iter().map(|e| e.level).max().unwrap_or(0);
    let stride = reference.triangles.len().div_ceil(SAMPLED);
    let mut ratios = Vec::new();
    for level in 0..=deepest {
        let refined = (0..pack.entries.len() as u32).filter(|i| *i == 0 || pack.entries[*i as usize].level < level);
        let cut = Cut::from_refined(&pack.entries, refined).expect("a uniform cut is valid");
        let shown = drawn_by_diamond(&pack, &cut);
        let of_cut: usize = shown.values().map(Vec::len).sum();
        // From the coarse form of each diamond to the finest surface: its own ε* must hold.
        let coarse: Vec<(u32, f64)> = shown
            .par_iter()
            .filter(|(d, _)| **d != kilwa_pack::NO_DIAMOND)
            .map(|(d, triangles)| {
                let mut random = fastrand::Rng::with_seed(u64::from(*d));
                let n = if of_cut > SAMPLED { 3 } else { 12 };
                let worst = triangles
                    .iter()
                    .flat_map(|t| samples(t, &mut random, n))
                    .map(|p| reference.distance(p))
                    .fold(0.0, f64::max);
                (*d, worst * pack.step)
            })
            .collect();
        for (d, sampled) in &coarse {
            let bound = f64::from(pack.entries[*d as usize].error);
            assert!(*sampled <= bound, "{name}, diamond {d}: sampled {sampled} m, certified {bound} m");
        }
        // From the finest surface to the whole cut: the cut's ε* must hold. What is nearest to a diamond's coarse form
        // counts for that diamond.
        let error = f64::from(cut.error(&pack.entries));
        let (owners, triangles): (Vec<u32>, Vec<Triangle>) =
            shown.into_iter().flat_map(|(d, ts)| ts.into_iter().map(move |t| (d, t))).unzip();
        let whole = Grid::new(triangles);
        let away: Vec<(u32, f64)> = reference
            .triangles
            .par_iter()
            .enumerate()
            .filter(|(i, _)| (i + usize::from(level)) % stride == 0)
            .flat_map_iter(|(i, t)| {
                let mut random = fastrand::Rng::with_seed(i as u64);
                samples(t, &mut random, 2).into_iter().map(|p| whole.nearest(p)).collect::<Vec<_>>()
            })
            .map(|(d, t)| (owners[t as usize], d * pack.step))
            .collect();
        let mut back: HashMap<u32, f64> = HashMap::new();
        for (d, away) in &away {
            let worst = back.entry(*d).or_default();
            *worst = worst.max(*away);
        }
        let worst = back.values().copied().fold(0.0, f64::max);
        assert!(worst <= error, "{name}, level {level}: sampled {worst} m, certified {error} m");
        for (d, sampled) in coarse {
            let sampled = sampled.max(back.get(&d).copied().unwrap_or(0.0));
            // Levels at which a diamond is first shown: each counts once.
            if pack.entries[d as usize].level == level && sampled > 0.0 {
                ratios.push(f64::from(pack.entries[d as usize].error) / sampled);
            }
        }
        println!(
            "{name}, level {level}: certified {:.3} mm, finest to coarse sampled {:.3} mm",
            error * 1e3,
            worst * 1e3
        );
    }
    ratios.sort_by(f64::total_cmp);
    println!("{name}: median of certified over sampled, {} diamonds: {:.2}", ratios.len(), ratios[ratios.len() / 2]);
    assert!(ratios[ratios.len() / 2] <= 2.5, "{name}: a bound this loose says little");
}

#[test]
fn the_bound_holds_on_a_wall() {
    the_bound_holds_at_every_level("wall", wall(40_000));
}

#[test]
fn the_bound_holds_on_a_closed_mesh() {
    the_bound_holds_at_every_level("closed", closed(80_000));
}

#[test]
fn the_bound_holds_on_a_fort() {
    the_bound_holds_at_every_level("fort", fort(60_000));
}

/// A real scan of the shared data; prints that it is skipped if missing.
fn the_bound_holds_on_a_scan(name: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared/data").join(name);
    if !path.is_file() {
        println!("skipped: {} is not here", path.display());
        return;
    }
    let raw = kilwa_formats::read::read_mesh(&path, &mut |_, _| {}).expect("reads");
    the_bound_holds_at_every_level(name, raw);
}

/// Range scans merged, with holes where no scan reached.
#[test]
fn the_bound_holds_on_the_scan_of_a_bunny() {
    the_bound_holds_on_a_scan("google+draco/testdata/bun_zipper.ply");
}

/// A bust with colours.
#[test]
fn the_bound_holds_on_the_scan_of_a_bust() {
    the_bound_holds_on_a_scan("cnr-isti-vclab+3DHOP/examples/models/laurana.ply");
}

/// A cranium in 209 components, most of them crumbs.
#[test]
fn the_bound_holds_on_the_scan_of_a_cranium() {
    the_bound_holds_on_a_scan("IIIF+3d/assets/whale/whale_cranium.glb");
}
