//! Vertex attributes at every level: normals continue across chunks, positions with two colours keep both, and colours
//! are averaged.

use crate::support::{Opened, build, fort, open};
use glam::DVec3;
use kilwa_formats::RawMesh;
use kilwa_geometry::normal;
use kilwa_pack::NO_DIAMOND;
use kilwa_pack::cut::Cut;
use std::collections::{BTreeMap, BTreeSet};

/// The uniform cut of each level, as a view with the same detail everywhere has it.
fn levels(pack: &Opened) -> Vec<Cut> {
    let deepest = pack.entries.iter().map(|e| e.level).max().unwrap();
    let above = |level: u8| {
        let refined =
            (0..pack.entries.len() as u32).filter(move |i| *i == 0 || pack.entries[*i as usize].level < level);
        Cut::from_refined(&pack.entries, refined).expect("a uniform cut is valid")
    };
    (0..=deepest + 1).map(above).collect()
}

/// The vertices that a cut draws, once for each patch: position, normal, colour.
fn vertices(pack: &Opened, cut: &Cut) -> Vec<([i32; 3], [i16; 2], [u8; 3])> {
    let mut all = Vec::new();
    for i in cut.refined() {
        let chunk = &pack.chunks[i as usize];
        for p in chunk.patches.iter().filter(|p| cut.draws(p)) {
            let triangles = &chunk.mesh.triangles[p.first as usize..(p.first + p.count) as usize];
            let used: BTreeSet<u32> = triangles.iter().flatten().copied().collect();
            all.extend(used.into_iter().map(|v| v as usize).map(|v| {
                let color = chunk.mesh.colors.get(v).copied().unwrap_or_default();
                (chunk.mesh.positions[v].to_array(), chunk.mesh.normals[v], color)
            }));
        }
    }
    all
}

/// A rough square of `n` by `n` quads with a side of 1 m; `color` of column and row.
fn square(n: u32, mut color: impl FnMut(u32, u32) -> [u8; 3]) -> RawMesh {
    let mut mesh = RawMesh::default();
    for y in 0..=n {
        for x in 0..=n {
            let z = f64::from((x * 31 + y * 17) * 7919 % 13) * 1e-4;
            mesh.positions.push(DVec3::new(f64::from(x) / f64::from(n), f64::from(y) / f64::from(n), z));
            mesh.colors.push(color(x, y));
        }
    }
    for y in 0..n {
        for x in 0..n {
            let i = y * (n + 1) + x;
            mesh.triangles.extend([[i, i + 1, i + n + 1], [i + 1, i + n + 2, i + n + 1]]);
        }
    }
    mesh
}

/// Lattice coordinates and colour of a vertex.
type Corner = ([i32; 3], [u8; 3]);

#[test]
fn normals_continue_across_chunks_at_every_level() {
    let pack = open(&build(fort(60_000), 0));
    for (level, cut) in levels(&pack).iter().enumerate() {
        let mut normals = BTreeMap::<Corner, BTreeSet<[i16; 2]>>::new();
        let all = vertices(&pack, cut);
        for (place, normal, color) in &all {
            normals.entry((*place, *color)).or_default().insert(*normal);
        }
        assert!(normals.len() < all.len(), "level {level}: patches share vertices");
        let torn = normals.iter().find(|(_, n)| n.len() > 1);
        assert!(torn.is_none(), "level {level}: {torn:?}");
    }
}

#[test]
fn inside_a_patch_coarse_vertices_have_the_normals_of_the_coarse_triangles() {
    let pack = open(&build(square(160, |_, _| [90; 3]), 0));
    let mut compared = 0;
    for cut in levels(&pack) {
        let mut patches_at = BTreeMap::<[i32; 3], u32>::new();
        for (place, ..) in vertices(&pack, &cut) {
            *patches_at.entry(place).or_default() += 1;
        }
        for i in cut.refined() {
            let chunk = &pack.chunks[i as usize];
            for patch in chunk.patches.iter().filter(|p| cut.draws(p) && p.diamond != NO_DIAMOND) {
                let mut sums = BTreeMap::<u32, DVec3>::new();
                for t in &chunk.mesh.triangles[patch.first as usize..(patch.first + patch.count) as usize] {
                    let [a, b, c] = t.map(|v| chunk.mesh.positions[v as usize].as_dvec3());
                    for v in t {
                        *sums.entry(*v).or_default() += (b - a).cross(c - a);
                    }
                }
                for (v, sum) in sums {
                    let place = chunk.mesh.positions[v as usize].to_array();
                    if patches_at[&place] == 1 {
                        assert_eq!(
                            chunk.mesh.normals[v as usize],
                            normal::quantize(normal::encode(sum), 10),
                            "{place:?}"
                        );
                        compared += 1;
                    }
                }
            }
        }
    }
    assert!(compared > 500, "{compared}");
}

#[test]
fn supplied_normals_are_carried_on_at_every_level() {
    // They face away from where the triangles do, as in a file whose triangles are wound the wrong way.
    let mut mesh = square(160, |_, _| [90; 3]);
    mesh.normals = vec![glam::Vec3::new(0.3, 0.0, -1.0); mesh.positions.len()];
    let pack = open(&build(mesh, 0));
    for cut in levels(&pack) {
        for (place, stored, _) in vertices(&pack, &cut) {
            let cosine = normal::decode(stored).dot(DVec3::new(0.3, 0.0, -1.0).normalize());
            assert!(cosine > 0.999, "{place:?}: {stored:?}");
        }
    }
}

#[test]
fn positions_with_two_colours_keep_both_at_every_level() {
    const SIDES: [[u8; 3]; 2] = [[200, 20, 20], [20, 20, 200]];
    let n = 160;
    let mut mesh = square(n, |x, _| SIDES[usize::from(x > n / 2)]);
    // The middle column exists twice: red for the left half, blue for the right.
    let mut blue = BTreeMap::new();
    for t in 0..mesh.triangles.len() {
        let is_right = mesh.triangles[t].iter().any(|v| v % (n + 1) > n / 2);
        for k in 0..3 {
            let v = mesh.triangles[t][k];
            if is_right && v % (n + 1) == n / 2 {
                mesh.triangles[t][k] = *blue.entry(v).or_insert_with(|| {
                    mesh.positions.push(mesh.positions[v as usize]);
                    mesh.colors.push(SIDES[1]);
                    mesh.positions.len() as u32 - 1
                });
            }
        }
    }
    let pack = open(&build(mesh, 0));
    assert!(pack.entries.iter().any(|e| e.level >= 1));
    for (level, cut) in levels(&pack).iter().enumerate() {
        let mut colors: BTreeMap<[i32; 3], BTreeSet<[u8; 3]>> = BTreeMap::new();
        for (place, _, color) in vertices(&pack, cut) {
            assert!(SIDES.contains(&color), "level {level}: {color:?} is on neither side");
            colors.entry(place).or_default().insert(color);
        }
        let both: Vec<&[i32; 3]> = colors.iter().filter(|(_, c)| c.len() == 2).map(|(p, _)| p).collect();
        assert!(both.len() >= 2, "level {level}: the seam is gone");
        let (low, high) = (both.iter().map(|p| p[1]).min().unwrap(), both.iter().map(|p| p[1]).max().unwrap());
        let (from, to) = (colors.keys().map(|p| p[1]).min().unwrap(), colors.keys().map(|p| p[1]).max().unwrap());
        assert_eq!((low, high), (from, to), "level {level}: the seam reaches from rim to rim");
    }
}

#[test]
fn colours_are_averaged_in_linear_light_between_levels() {
    let mut random = fastrand::Rng::with_seed(3);
    let pack = open(&build(square(160, |_, _| if random.bool() { [40; 3] } else { [220; 3] }), 0));
    let linear = |c: u8| (f64::from(c) / 255.0).powf(2.2);
    let mean = f64::midpoint(linear(40), linear(220));
    let mut spreads = Vec::new();
    for cut in levels(&pack).iter().rev() {
        let grey: Vec<f64> = vertices(&pack, cut).iter().map(|(_, _, c)| linear(c[0])).collect();
        let average = grey.iter().sum::<f64>() / grey.len() as f64;
        let spread = (grey.iter().map(|g| (g - average).powi(2)).sum::<f64>() / grey.len() as f64).sqrt();
        assert!((average - mean).abs() < 0.05, "{average} for {mean}");
        spreads.push(spread);
    }
    assert!(spreads.is_sorted_by(|finer, coarser| coarser <= finer), "{spreads:?}");
    assert!(spreads.last().unwrap() * 3.0 < spreads[0], "{spreads:?}");
}
