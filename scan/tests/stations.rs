//! Meshes of simulated stations against the true surface of the simulator (`kilwa synth scans --truth-mesh`).
//!
//! For each station:
//!
//! * *false*: the share of the mesh's area that is farther from the true surface than the tolerance;
//! * *seen*: points spread evenly over the true surface to which the line of sight from the scanner is free, within the elevations and ranges of the
//!   instrument, at an incidence of at most 85°;
//! * *present*: the share of seen points that are no farther from the mesh than the tolerance.
//!
//! The tolerance is 2 σ + 2 spacings at that range: the deviation of ranges of the instrument, without the part for incidence, and the distance between
//! neighbouring rays.
//!
//! `KILWA_STATIONS=FOLDER` measures the scans in FOLDER, as `cargo xtask bench stations` does, and prints a table; without it a survey of two small
//! stations is made and held to the bounds.

use crate::support::Site;
use glam::DVec3;
use kilwa_formats::read::read_mesh;
use kilwa_geometry::bvh::Bvh;
use kilwa_geometry::distance::{point_triangle_squared, ray_triangle};
use kilwa_scan::ScanError;
use kilwa_scan::import::Silent;
use kilwa_scan::mask::{self, Recipe, Request, make};
use kilwa_scan::mesh::{MeshVertex, Options, Surface, mesh};
use kilwa_scan::read::ReadOptions;
use kilwa_scan::survey::{Station, Survey};
use kilwa_scan_core::Pose;
use kilwa_scan_core::mask::mixed;
use kilwa_synth::scans::{Extras, INSTRUMENTS, Instrument, LOWEST_ELEVATION, MIN_RANGE, ScanOptions, write};
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Points of the true surface that are looked at, and places on triangles of a mesh.
const POINTS: usize = 150_000;
const PLACES: usize = 60_000;
/// Largest incidence of what counts as seen.
const GRAZING: f64 = 85.0;
/// A line of sight ends this far before its point, metres: the true surface is a mesh, whose triangles are flat.
const BEFORE: f64 = 0.03;

#[derive(Default)]
struct Triangles {
    vertices: Vec<DVec3>,
    triangles: Vec<[DVec3; 3]>,
}

impl Surface for Triangles {
    fn vertex(&mut self, vertex: &MeshVertex) -> Result<u32, ScanError> {
        self.vertices.push(vertex.position);
        Ok(self.vertices.len() as u32 - 1)
    }

    fn triangle(&mut self, corners: [u32; 3]) -> Result<(), ScanError> {
        self.triangles.push(corners.map(|k| self.vertices[k as usize]));
        Ok(())
    }
}

/// Triangles that can be searched.
struct Searched {
    triangles: Vec<[DVec3; 3]>,
    tree: Bvh,
}

impl Searched {
    fn new(triangles: Vec<[DVec3; 3]>) -> Self {
        Self { tree: Bvh::new(&triangles), triangles }
    }

    /// Whether something is within a distance of a point.
    fn is_near(&self, p: DVec3, distance: f64) -> bool {
        let (limit, mut is_near) = (distance * distance, false);
        self.tree.search(
            limit,
            |bounds| Some(bounds.distance_squared(p)),
            |triangle, limit| {
                if !is_near && point_triangle_squared(p, self.triangles[triangle as usize]) <= limit {
                    is_near = true;
                }
                // Nothing more is looked at.
                if is_near { -1.0 } else { limit }
            },
        );
        is_near
    }

    /// Whether the line between two points meets nothing, but for its last centimetres.
    fn is_free(&self, from: DVec3, to: DVec3) -> bool {
        let length = from.distance(to) - BEFORE;
        let direction = (to - from).normalize();
        let mut is_free = true;
        self.tree.search(
            length,
            |bounds| bounds.entry(from, direction),
            |triangle, limit| {
                let hit = ray_triangle(from, direction, self.triangles[triangle as usize]);
                is_free &= hit.is_none_or(|t| t >= length);
                if is_free { limit } else { -1.0 }
            },
        );
        is_free
    }

    /// Places spread evenly over the area, with the normals there.
    fn spread(&self, count: usize, seed: u64) -> Vec<(DVec3, DVec3)> {
        let area = |t: &[DVec3; 3]| (t[1] - t[0]).cross(t[2] - t[0]).length() / 2.0;
        let step = self.triangles.iter().map(area).sum::<f64>() / count as f64;
        let mut rng = fastrand::Rng::with_seed(seed);
        let (mut next, mut sum, mut out) = (step * rng.f64(), 0.0, Vec::with_capacity(count));
        for triangle in &self.triangles {
            sum += area(triangle);
            while next < sum {
                next += step;
                let (a, b) = (rng.f64(), rng.f64());
                let (a, b) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
                let [p, q, r] = *triangle;
                out.push((p + (q - p) * a + (r - p) * b, (q - p).cross(r - p).normalize_or_zero()));
            }
        }
        out
    }
}

/// A station and what it was scanned with.
struct Scanner<'a> {
    pose: Pose,
    instrument: &'a Instrument,
    step: f64,
}

impl Scanner<'_> {
    /// What a point may be away, by its range.
    fn tolerance(&self, p: DVec3) -> f64 {
        let range = p.distance(self.pose.translation);
        2.0 * (self.instrument.noise[0] + self.instrument.noise[1] * range) + 2.0 * self.step * range
    }

    fn sees(&self, truth: &Searched, p: DVec3, normal: DVec3) -> bool {
        let ray = p - self.pose.translation;
        let range = ray.length();
        let elevation = (self.pose.rotation.inverse() * ray / range).z.asin().to_degrees();
        let incidence = (normal.dot(ray) / range).abs().min(1.0).acos().to_degrees();
        elevation > LOWEST_ELEVATION
            && (MIN_RANGE..self.instrument.max_range).contains(&range)
            && incidence <= GRAZING
            && truth.is_free(self.pose.translation, p)
    }
}

/// Shares of a station, in percent.
struct Shares {
    triangles: usize,
    is_false: f64,
    present: f64,
    seen: usize,
}

fn measure(survey: &Path, station: &Station, unmasked: bool, truth: &Searched, options: &Options) -> Shares {
    let mut reader = mask::open(survey, station, unmasked).unwrap();
    let grid = reader.header().grid;
    // Two instruments, of which the second has rays 5/3 as far apart, take turns: two stations use the first.
    let number: u32 = station.name.trim_start_matches("scan_").parse().unwrap();
    let instrument = &INSTRUMENTS[usize::from(number.is_multiple_of(3))];
    let scanner = Scanner { pose: station.pose.unwrap(), instrument, step: TAU / f64::from(grid.columns) };
    let mut made = Triangles::default();
    mesh(&mut reader, scanner.pose, options, &mut made).unwrap();
    let made = Searched::new(made.triangles);
    let places = made.spread(PLACES, 1);
    let off = places.iter().filter(|(p, _)| !truth.is_near(*p, scanner.tolerance(*p))).count();
    let (mut seen, mut present) = (0, 0);
    for (p, normal) in truth.spread(POINTS, 2) {
        if scanner.sees(truth, p, normal) {
            seen += 1;
            present += usize::from(made.is_near(p, scanner.tolerance(p)));
        }
    }
    let percent = |part: usize, of: usize| 100.0 * part as f64 / of.max(1) as f64;
    Shares {
        triangles: made.triangles.len(),
        is_false: percent(off, places.len()),
        present: percent(present, seen),
        seen,
    }
}

/// The options of `KILWA_MESH`: `factor,max_edge,grazing`, or the defaults.
fn options() -> Options {
    let mut options = Options::default();
    if let Ok(text) = std::env::var("KILWA_MESH") {
        let numbers: Vec<f64> = text.split(',').map(|n| n.parse().unwrap()).collect();
        let own = &mut options.tessellate;
        (own.edge_factor, own.max_edge, own.grazing) = (numbers[0], numbers[1], numbers[2].to_radians());
    }
    options
}

/// Rows of all stations without masks, and with those of mixed pixels and (of three stations or more) of what others see through; the largest share of
/// false surface in any of them, and the smallest of present surface without masks.
fn table(scans: &Path, truth: &Path) -> (String, f64, f64) {
    let truth = read_mesh(truth, &mut |_, _| {}).unwrap();
    let corners = |t: &[u32; 3]| t.map(|v| truth.positions[v as usize]);
    let truth = Searched::new(truth.triangles.iter().map(corners).collect());
    let site = Site::new();
    let mut files: Vec<PathBuf> = std::fs::read_dir(scans).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.retain(|file| file.extension().is_some_and(|end| end == "ptx"));
    files.sort();
    site.import(&files, ReadOptions::default()).unwrap();
    for recipe in [Recipe::Mixed(mixed::Options::default()), Recipe::SeenThrough { witnesses: 2, margin: 0.1 }] {
        if files.len() < 3 && matches!(recipe, Recipe::SeenThrough { .. }) {
            continue;
        }
        let name = recipe.kind().to_owned();
        make(&site.survey(), &Request { name, recipe, stations: Vec::new() }, &Silent).unwrap();
    }
    let survey = Survey::open(&site.survey()).unwrap();
    let mut text = String::from(
        "| station | seen points | triangles | false % | present % | masked: triangles | false % | present % |\n|---|---:|---:|---:|---:|---:|---:|---:|\n",
    );
    let (mut most, mut least, mut sums) = (0.0_f64, 100.0_f64, [0.0; 4]);
    for station in &survey.stations {
        let [all, masked] =
            [true, false].map(|unmasked| measure(&site.survey(), station, unmasked, &truth, &options()));
        writeln!(
            text,
            "| {} | {} | {} | {:.2} | {:.1} | {} | {:.2} | {:.1} |",
            station.name,
            all.seen,
            all.triangles,
            all.is_false,
            all.present,
            masked.triangles,
            masked.is_false,
            masked.present
        )
        .unwrap();
        (most, least) = (most.max(all.is_false).max(masked.is_false), least.min(all.present));
        for (sum, value) in sums.iter_mut().zip([all.is_false, all.present, masked.is_false, masked.present]) {
            *sum += value / survey.stations.len() as f64;
        }
    }
    let [a, b, c, d] = sums;
    writeln!(text, "| mean | | | {a:.2} | {b:.1} | | {c:.2} | {d:.1} |").unwrap();
    (text, most, least)
}

#[test]
fn meshes_of_simulated_stations_lie_on_the_true_surface_and_cover_what_is_seen() {
    if let Some(scans) = std::env::var_os("KILWA_STATIONS").map(PathBuf::from) {
        let truth = std::env::var_os("KILWA_TRUTH").map_or_else(|| scans.join("truth/surface.ply"), PathBuf::from);
        println!("{}", table(&scans, &truth).0);
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scans = folder.path().join("scans");
    let extras = Extras { walkers: false, grass: false, scaffolding: false };
    let simulated = ScanOptions { truth_mesh: Some(400_000), extras, ..ScanOptions::new(2, 360) };
    write(&simulated, &scans, &mut |_, _| {}).unwrap();
    let (text, most, least) = table(&scans, &scans.join("truth/surface.ply"));
    println!("{text}");
    assert!(most <= 0.5, "{most} % of the surface is false");
    // Rays are 17 mrad apart and the true surface has triangles of 17 cm, so that both miss detail; the bench asks for 97 %.
    assert!(least >= 96.0, "{least} % of the seen surface is present");
}
