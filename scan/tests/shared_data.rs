//! Real files, where the folders beside the project are there.

use crate::support::{Site, seen_from, shared};
use glam::{DVec3, IVec3};
use kilwa_formats::RawMesh;
use kilwa_scan::ScanError;
use kilwa_scan::import::Silent;
use kilwa_scan::merge::{self, Begin, MergedSurface, MergedVertex};
use kilwa_scan::mesh::{MeshVertex, Options, Surface, mesh};
use kilwa_scan::panorama::{Show, render};
use kilwa_scan::read::ReadOptions;
use kilwa_scan::spool::Reader;
use kilwa_scan::survey::{Station, Survey};
use std::collections::HashMap;
use std::path::PathBuf;

fn files(folder: &std::path::Path, extension: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let mut files: Vec<PathBuf> = entries.filter(|p| p.extension().is_some_and(|e| e == extension)).collect();
    files.sort();
    files
}

#[test]
fn the_ten_range_grids_of_the_bunny_are_imported_with_every_vertex_in_its_cell() {
    let Some(folder) = shared("scan-data") else { return };
    let site = Site::new();
    let mut files = files(&folder.join("bunny"), "ply");
    // A mesh, not a range grid.
    files.retain(|file| !file.ends_with("bun000_1.ply"));
    assert_eq!(files.len(), 10);
    let report = site.import(&files, ReadOptions::default()).unwrap();
    let first = report.stations.iter().find(|s| s.station.name == "bun000").unwrap().header;
    assert_eq!((first.grid.columns, first.grid.rows, first.statistics.measured), (512, 400, 40_256));
    assert!(
        report.diagnostics.iter().all(|(_, d)| d.count("vertices that no cell of the grid refers to dropped") == 0)
    );
    let mut reader = Reader::open(&site.survey().join("stations/bun000.scan")).unwrap();
    let picture = render(&mut reader, Show::Range, &mut [], 400).unwrap();
    assert_eq!((picture.width, picture.height), (256, 200));
}

#[test]
fn every_e57_is_imported_or_refused_with_its_place() {
    let Some(folder) = shared("scan-data/e57").zip(shared("data/cry-inc+e57/testdata")) else { return };
    let (mut read, mut refused) = (Vec::new(), Vec::new());
    for file in files(&folder.0, "e57").into_iter().chain(files(&folder.1, "e57")) {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        let site = Site::new();
        match site.import(&[file], seen_from(0.0, 0.0, 0.0)) {
            Ok(report) => {
                let points: u64 = report.stations.iter().map(|s| s.header.statistics.measured).sum();
                read.push((name, points, report.photographs));
            }
            Err(e) => refused.push((name, e.to_string())),
        }
    }
    println!("{read:?}\n{refused:#?}");
    let points = |name: &str| read.iter().find(|r| r.0 == name).map(|r| (r.1, r.2));
    assert_eq!(points("bunnyInt19.e57"), Some((30_571, 0)));
    assert_eq!(points("bunnyInt21.e57"), Some((30_571, 0)));
    assert_eq!(points("ColouredCubeFloat.e57"), Some((7_680, 0)));
    let why = |name: &str| refused.iter().find(|r| r.0 == name).map_or("", |r| r.1.as_str());
    assert!(why("bad-crc.e57").contains("byte 0") && why("bad-crc.e57").contains("checksum"), "{}", why("bad-crc.e57"));
    assert!(why("corrupt_crc.e57").contains("checksum"), "{}", why("corrupt_crc.e57"));
}

#[test]
fn the_ptx_whose_header_lies_is_refused_and_kept_on_request() {
    let Some(folder) = shared("data/visgl+loaders.gl/cpp/Model3DTiler/test/resources") else { return };
    let site = Site::new();
    let ptx = [folder.join("ripple.ptx")];
    let message = site.import(&ptx, ReadOptions::default()).unwrap_err().to_string();
    assert!(message.contains("10201 points of scan 1") && message.contains("4444 × 10014"), "{message}");
    let report = site.import(&ptx, ReadOptions { keep_incomplete: true, ..ReadOptions::default() }).unwrap();
    assert_eq!(report.stations[0].header.statistics.measured, 10_201);
    let report = site.import(&[folder.join("ripple.pts")], seen_from(0.0, 0.0, 10.0)).unwrap();
    assert_eq!(report.stations[0].header.statistics.measured, 10_201);
}

/// Gives stations the poses of a `.conf` file, in the way of docs/scans.md: `bmesh FILE tx ty tz qx qy qz qw`, whose quaternion turns the model into the
/// scan.
pub(crate) fn with_poses(survey: &str, conf: &str) -> String {
    let mut survey = survey.to_owned();
    for line in conf.lines().filter_map(|line| line.strip_prefix("bmesh ")) {
        let words: Vec<&str> = line.split_whitespace().collect();
        let [file, tx, ty, tz, qx, qy, qz, qw] = words[..] else { panic!("{line}") };
        let scan = format!("scan = \"stations/{}.scan\"\n", file.trim_end_matches(".ply"));
        let turned = |q: &str| q.strip_prefix('-').map_or_else(|| format!("-{q}"), str::to_owned);
        let [qx, qy, qz] = [qx, qy, qz].map(turned);
        // TOML has floats and integers, which do not mix in a list.
        let list = |numbers: &[&str]| {
            let floats: Vec<String> =
                numbers.iter().map(|n| if n.contains('.') { (*n).to_owned() } else { format!("{n}.0") }).collect();
            floats.join(", ")
        };
        let pose = format!("rotation = [{}]\ntranslation = [{}]\n", list(&[qw, &qx, &qy, &qz]), list(&[tx, ty, tz]));
        assert!(survey.contains(&scan), "{scan} is not in\n{survey}");
        survey = survey.replace(&scan, &format!("{scan}{pose}"));
    }
    survey
}

#[derive(Default)]
struct Kept {
    positions: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

impl Surface for Kept {
    fn vertex(&mut self, vertex: &MeshVertex) -> Result<u32, ScanError> {
        assert!(vertex.normal.is_normalized() && vertex.confidence > 0.0);
        self.positions.push(vertex.position);
        Ok(self.positions.len() as u32 - 1)
    }

    fn triangle(&mut self, corners: [u32; 3]) -> Result<(), ScanError> {
        self.triangles.push(corners);
        Ok(())
    }
}

/// Distances from points to the nearest vertex or point of a triangle of a mesh, by a grid of cells.
fn distances(points: &[DVec3], mesh: &RawMesh, cell: f64) -> Vec<f64> {
    let key = |p: DVec3| (p / cell).floor().as_ivec3();
    let mut cells: HashMap<IVec3, Vec<usize>> = HashMap::new();
    for (t, corners) in mesh.triangles.iter().enumerate() {
        let corners = corners.map(|v| mesh.positions[v as usize]);
        let (min, max) =
            (key(corners[0].min(corners[1]).min(corners[2])), key(corners[0].max(corners[1]).max(corners[2])));
        for x in min.x..=max.x {
            for y in min.y..=max.y {
                for z in min.z..=max.z {
                    cells.entry(IVec3::new(x, y, z)).or_default().push(t);
                }
            }
        }
    }
    let nearest = |p: &DVec3| {
        let mut best = f64::INFINITY;
        for around in 0..27 {
            let at = key(*p) + IVec3::new(around % 3 - 1, around / 3 % 3 - 1, around / 9 - 1);
            for &t in cells.get(&at).into_iter().flatten() {
                let [a, b, c] = mesh.triangles[t].map(|v| mesh.positions[v as usize]);
                best = best.min(to_triangle(*p, a, b, c));
            }
        }
        best
    };
    points.iter().map(nearest).collect()
}

/// The distance of a point from a triangle (Ericson, "Real-Time Collision Detection", 5.1.5), by its plane or its edges.
fn to_triangle(p: DVec3, a: DVec3, b: DVec3, c: DVec3) -> f64 {
    let edge = |a: DVec3, b: DVec3| {
        let t = ((p - a).dot(b - a) / (b - a).length_squared()).clamp(0.0, 1.0);
        p.distance(a + (b - a) * t)
    };
    let border = edge(a, b).min(edge(b, c)).min(edge(c, a));
    let normal = (b - a).cross(c - a);
    let is_inside = [(a, b), (b, c), (c, a)].iter().all(|(u, v)| (*v - *u).cross(p - *u).dot(normal) >= 0.0);
    if is_inside { border.min((p - a).dot(normal.normalize()).abs()) } else { border }
}

/// The survey of the ten grids in their published poses, and the published surface; nothing where the files are not there.
fn bunny() -> Option<(Site, RawMesh)> {
    let (folder, data) = shared("scan-data").zip(shared("data"))?;
    let path = data.join("google+draco/testdata/bun_zipper.ply");
    let surface = kilwa_formats::read::read_mesh(&path, &mut |_, _| ()).unwrap();
    let site = Site::new();
    let conf = std::fs::read_to_string(folder.join("bunny/bun.conf")).unwrap();
    let mut files = files(&folder.join("bunny"), "ply");
    files.retain(|file| !file.ends_with("bun000_1.ply"));
    site.import(&files, ReadOptions::default()).unwrap();
    let toml = site.survey().join("survey.toml");
    std::fs::write(&toml, with_poses(&std::fs::read_to_string(&toml).unwrap(), &conf)).unwrap();
    Some((site, surface))
}

/// Receives a merged surface.
#[derive(Default)]
struct Merged {
    positions: Vec<DVec3>,
    triangles: Vec<[u64; 3]>,
}

impl MergedSurface for Merged {
    fn begin(&mut self, _: &Begin) -> Result<(), ScanError> {
        Ok(())
    }

    fn vertex(&mut self, vertex: &MergedVertex) -> Result<(), ScanError> {
        self.positions.push(vertex.vertex.position);
        Ok(())
    }

    fn triangle(&mut self, corners: [u64; 3]) -> Result<(), ScanError> {
        self.triangles.push(corners);
        Ok(())
    }
}

/// The vertex that stands for the component of a vertex.
fn find(root: &mut [usize], mut k: usize) -> usize {
    while root[k] != k {
        root[k] = root[root[k]];
        k = root[k];
    }
    k
}

/// Triangles of the largest component, as a share of all.
fn largest_component(mesh: &Merged) -> f64 {
    let mut root: Vec<usize> = (0..mesh.positions.len()).collect();
    for [a, b, c] in &mesh.triangles {
        for (p, q) in [(a, b), (b, c)] {
            let (p, q) = (find(&mut root, *p as usize), find(&mut root, *q as usize));
            root[p.max(q)] = p.min(q);
        }
    }
    let mut counts = std::collections::HashMap::new();
    for [a, ..] in &mesh.triangles {
        *counts.entry(find(&mut root, *a as usize)).or_insert(0) += 1;
    }
    f64::from(*counts.values().max().unwrap()) / mesh.triangles.len() as f64
}

#[test]
fn the_grids_of_the_bunny_merge_into_the_published_surface() {
    let Some((site, bunny)) = bunny() else { return };
    let survey = Survey::open(&site.survey()).unwrap();
    let options = merge::Options {
        voxel: None,
        memory: 300 << 20,
        threads: 2,
        scratch: site.0.path().to_owned(),
        unmasked: false,
        bounds: None,
        fill: merge::Fill::default(),
        intensity: merge::Intensity::Raw,
    };
    let mut merged = Merged::default();
    let how = |_: &Station| Options::default();
    let report = merge::merge(&site.survey(), &survey, &options, &how, &mut merged, &Silent).unwrap();
    let every_ninth: Vec<DVec3> = merged.positions.iter().copied().step_by(9).collect();
    let mut all = distances(&every_ninth, &bunny, 0.003);
    all.sort_unstable_by(f64::total_cmp);
    let (median, largest) = (all[all.len() / 2], largest_component(&merged));
    println!(
        "{report:?}; median {:.4} mm, nine in ten within {:.4} mm, largest component {:.2} %",
        median * 1e3,
        all[all.len() * 9 / 10] * 1e3,
        largest * 100.0
    );
    assert!(median <= 0.0003, "{median} m");
    assert!(largest >= 0.99, "{largest}");
}

#[test]
fn each_range_grid_of_the_bunny_is_meshed_on_the_published_surface() {
    let Some((site, bunny)) = bunny() else { return };
    let stations = Survey::open(&site.survey()).unwrap().stations;
    assert_eq!(stations.len(), 10);
    let mut together = Vec::new();
    for Station { name, pose, scan, .. } in stations {
        let pose = pose.expect("bun.conf has a pose for every grid");
        let mut reader = Reader::open(&site.survey().join(scan)).unwrap();
        let measured = reader.header().statistics.measured;
        let mut kept = Kept::default();
        let report = mesh(&mut reader, pose, &Options::default(), &mut kept).unwrap();
        let every_ninth: Vec<DVec3> = kept.positions.iter().copied().step_by(9).collect();
        let mut all = distances(&every_ninth, &bunny, 0.003);
        all.sort_unstable_by(f64::total_cmp);
        let median = all[all.len() / 2];
        println!(
            "{name}: {measured} points, {} triangles, {:?}, median {:.4} mm",
            report.triangles,
            report.dropped,
            median * 1000.0
        );
        assert!(median <= 0.0004, "{name}: {median} m");
        assert!(report.vertices as f64 > 0.8 * measured as f64, "{name}: {} of {measured}", report.vertices);
        together.append(&mut all);
    }
    together.sort_unstable_by(f64::total_cmp);
    println!(
        "all: median {:.4} mm, nine in ten within {:.4} mm",
        together[together.len() / 2] * 1e3,
        together[together.len() * 9 / 10] * 1e3
    );
}
