//! Extraction to a number of triangles: the number is met, nothing tears, and the stated error holds.

use glam::DVec3;
use kilwa_builder::{BuildOptions, Silent, build_pack};
use kilwa_formats::RawMesh;
use kilwa_formats::extract::{Extraction, Format, Output, Region, Request, WINDOW, extract};
use kilwa_formats::read::read_mesh;
use kilwa_geometry::bvh::Bvh;
use kilwa_geometry::distance::point_triangle_squared;
use kilwa_pack::Reader;
use kilwa_pack::reader::SliceSource;
use std::collections::HashMap;
use std::f64::consts::TAU;

type Pack = Reader<SliceSource<Vec<u8>>>;

/// A rough, closed torus of `2 n m` triangles.
pub(crate) fn torus(n: u32, m: u32) -> RawMesh {
    let at = |i: u32, j: u32| {
        let (u, v) = (f64::from(i) / f64::from(n) * TAU, f64::from(j) / f64::from(m) * TAU);
        let noise = f64::from((i * 7919 + j * 104_729) % 97) / 97.0;
        let r = 1.0 + 0.02 * noise + 0.1 * (5.0 * u).sin();
        DVec3::new((4.0 + r * v.cos()) * u.cos(), (4.0 + r * v.cos()) * u.sin(), r * v.sin())
    };
    let index = |i: u32, j: u32| (i % n) * m + j % m;
    RawMesh {
        positions: (0..n).flat_map(|i| (0..m).map(move |j| at(i, j))).collect(),
        triangles: (0..n)
            .flat_map(|i| (0..m).map(move |j| (i, j)))
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [index(i, j), index(i + 1, j), index(i + 1, j + 1), index(i, j + 1)];
                [[a, b, c], [a, c, d]]
            })
            .collect(),
        ..RawMesh::default()
    }
}

fn packed(mesh: RawMesh) -> Pack {
    let built = build_pack(mesh, &BuildOptions::default(), &Silent).expect("builds");
    Reader::open(SliceSource(built.bytes)).expect("a pack")
}

pub(crate) fn extracted(
    pack: &Pack,
    max_triangles: Option<u64>,
    window: usize,
    region: Option<Region>,
) -> (Extraction, RawMesh) {
    let work = tempfile::tempdir().expect("a folder");
    let path = work.path().join("out.ply");
    let output = Output::prepare(&path, false).expect("writable");
    let request = Request { format: Format::Ply { ascii: false }, max_error: None, max_triangles, region, window };
    let extraction = extract(pack, &request, &output, &|_, _| ()).expect("extracts");
    (extraction, read_mesh(&path, &mut |_, _| {}).expect("reads back"))
}

/// How many edges are used once, twice and more often.
fn edge_uses(mesh: &RawMesh) -> [usize; 3] {
    let mut uses: HashMap<[[u64; 3]; 2], usize> = HashMap::new();
    for t in &mesh.triangles {
        for k in 0..3 {
            let mut ends = [t[k], t[(k + 1) % 3]].map(|v| mesh.positions[v as usize].to_array().map(f64::to_bits));
            ends.sort_unstable();
            *uses.entry(ends).or_default() += 1;
        }
    }
    let mut counts = [0; 3];
    for n in uses.values() {
        counts[(*n).min(3) - 1] += 1;
    }
    counts
}

fn corners(mesh: &RawMesh) -> Vec<[DVec3; 3]> {
    mesh.triangles.iter().map(|t| t.map(|v| mesh.positions[v as usize])).collect()
}

/// The largest distance from samples of one surface to the other, both ways, in metres.
fn apart(a: &[[DVec3; 3]], b: &[[DVec3; 3]]) -> f64 {
    let one_way = |from: &[[DVec3; 3]], to: &[[DVec3; 3]]| {
        let tree = Bvh::new(to);
        let samples = from.iter().flat_map(|[a, b, c]| [*a, (a + b) / 2.0, (b + c) / 2.0, (a + b + c) / 3.0]);
        let nearest = samples.map(|p| {
            let mut best = f64::INFINITY;
            tree.search(
                f64::INFINITY,
                |bounds| Some(bounds.distance_squared(p)),
                |t, _| {
                    best = best.min(point_triangle_squared(p, to[t as usize]));
                    best
                },
            );
            best
        });
        nearest.fold(0.0, f64::max).sqrt()
    };
    one_way(a, b).max(one_way(b, a))
}

#[test]
fn the_number_of_triangles_is_met_without_a_crack_and_the_stated_error_holds_in_windows_of_any_size() {
    let pack = packed(torus(240, 80));
    let (_, finest) = extracted(&pack, None, WINDOW, None);
    let finest = corners(&finest);
    for wanted in [200, 2000, 9999, 20_000] {
        let mut errors = Vec::new();
        for window in [1 << 10, 1 << 12, WINDOW] {
            let (extraction, coarse) = extracted(&pack, Some(wanted), window, None);
            let what = format!("{wanted} triangles by windows of {window}");
            assert!((wanted - 1..=wanted).contains(&extraction.triangles), "{what}: {}", extraction.triangles);
            assert_eq!(coarse.triangles.len() as u64, extraction.triangles, "{what}");
            assert_eq!(edge_uses(&coarse), [0, coarse.triangles.len() * 3 / 2, 0], "{what}: closed, and stays closed");
            // A float rounds coordinates of 5 m by less than a micrometre.
            let (apart, stated) = (apart(&corners(&coarse), &finest), f64::from(extraction.error));
            assert!(apart <= stated + 1e-6, "{what}: {apart} m apart, {stated} m stated");
            assert!(stated <= apart * 3.0, "{what}: {stated} m stated, only {apart} m apart");
            errors.push(apart);
        }
        assert!(errors[0] <= errors[2] * 3.0, "{wanted}: small windows are not much worse: {errors:?}");
    }
}

#[test]
fn a_part_in_a_box_has_the_number_of_triangles_and_its_rim_is_simplified_too() {
    let pack = packed(torus(160, 60));
    let region: Region = "0,-9,-9,9,9,9".parse().expect("a box");
    let (_, whole) = extracted(&pack, None, WINDOW, Some(region));
    let [rim, ..] = edge_uses(&whole);
    for window in [1 << 10, WINDOW] {
        let (extraction, part) = extracted(&pack, Some(2000), window, Some(region));
        assert!((1999..=2000).contains(&extraction.triangles), "{}", extraction.triangles);
        let [once, _, more] = edge_uses(&part);
        assert!(
            once * 3 < rim * 2 && once >= 6 && more == 0,
            "{once} of {rim} edges of the rim, {more} used too often"
        );
    }
}

#[test]
fn as_many_triangles_as_there_are_give_the_finest_surface_and_one_fewer_simplifies_it() {
    let pack = packed(torus(60, 20));
    let (extraction, _) = extracted(&pack, Some(2400), WINDOW, None);
    assert!(extraction.is_finest && extraction.error == 0.0 && extraction.triangles == 2400);
    let (extraction, _) = extracted(&pack, Some(2399), WINDOW, None);
    assert!(!extraction.is_finest && extraction.error > 0.0 && extraction.triangles == 2398);
}
