//! A hundred thousand islands: loose pieces, as vegetation, scaffolding and scanner noise leave them, most of which no edge
//! can be taken from. The build succeeds, nothing of the finest level is lost, and the first request of a viewer shows the
//! whole extent.

use crate::support::{Opened, drawn, open};
use glam::DVec3;
use kilwa_builder::{BuildOptions, Silent, build_pack};
use kilwa_formats::RawMesh;
use kilwa_geometry::{Lattice, LatticePoint};
use kilwa_pack::chunk::Declared;
use kilwa_pack::cut::Cut;
use kilwa_pack::{HEAD_BYTES, parse_head};
use std::collections::HashSet;

/// Islands along each side of the square.
const SIDE: u32 = 317;

/// Pieces over a square, one in each metre: four in five a tetrahedron of 2 to 40 cm, the others a rough sheet of 2 by 2 to 4 by 4 quads.
fn islands() -> RawMesh {
    let (mut mesh, mut random) = (RawMesh::default(), fastrand::Rng::with_seed(11));
    for i in 0..SIDE {
        for j in 0..SIDE {
            let base =
                DVec3::new(f64::from(i) + 0.3 * random.f64(), f64::from(j) + 0.3 * random.f64(), 3.0 * random.f64());
            let size = 0.02 + 0.38 * random.f64().powi(2);
            let first = mesh.positions.len() as u32;
            let color = [(i % 256) as u8, (j % 256) as u8, 90];
            let vertex = |mesh: &mut RawMesh, d: [f64; 3]| {
                mesh.positions.push(base + size * DVec3::from(d));
                mesh.colors.push(color);
            };
            if random.usize(..5) > 0 {
                for d in [[0.0, 0.0, 0.0], [1.0, 0.0, 0.1], [0.1, 1.0, 0.0], [0.2, 0.3, 1.0]] {
                    vertex(&mut mesh, d);
                }
                let faces = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];
                mesh.triangles.extend(faces.map(|t| t.map(|v| first + v)));
            } else {
                let n = 2 + random.usize(..3) as u32;
                for (u, v) in (0..=n).flat_map(|u| (0..=n).map(move |v| (u, v))) {
                    let at = [f64::from(u), f64::from(v)].map(|x| x / f64::from(n));
                    vertex(&mut mesh, [at[0], at[1], 0.2 * random.f64()]);
                }
                for (u, v) in (0..n).flat_map(|u| (0..n).map(move |v| (u, v))) {
                    let at = |u: u32, v: u32| first + u * (n + 1) + v;
                    mesh.triangles.push([at(u, v), at(u + 1, v), at(u + 1, v + 1)]);
                    mesh.triangles.push([at(u, v), at(u + 1, v + 1), at(u, v + 1)]);
                }
            }
        }
    }
    mesh
}

/// Triangles of a picture as corners, each turned so that the smallest is first, in order.
fn sorted(triangles: impl Iterator<Item = [LatticePoint; 3]>) -> Vec<[[i32; 3]; 3]> {
    let triangles = triangles.map(|t| t.map(|p| p.to_array()));
    let mut all: Vec<_> =
        triangles.map(|[a, b, c]| [[a, b, c], [b, c, a], [c, a, b]].into_iter().min().unwrap()).collect();
    all.sort_unstable();
    all
}

/// The share of the 16 by 16 fields of the square in which a triangle has a corner.
fn covered(triangles: &[([LatticePoint; 3], u8)], lattice: &Lattice) -> f64 {
    let fields: HashSet<[i64; 2]> = triangles
        .iter()
        .flat_map(|(t, _)| t)
        .map(|p| lattice.world_from_lattice(*p))
        .map(|p| [p.x, p.y].map(|x| ((x / f64::from(SIDE) * 16.0) as i64).min(15)))
        .collect();
    fields.len() as f64 / 256.0
}

/// The chunks that the first request contains whole, and the finest cut that they allow.
fn first_request(bytes: &[u8], pack: &Opened) -> Cut {
    let first = &bytes[..bytes.len().min(HEAD_BYTES as usize)];
    let head = parse_head(first).expect("the first request holds header, metadata and page 0");
    let mut there: HashSet<u32> = HashSet::new();
    for (i, e) in (0u32..).zip(&head.entries) {
        let range = e.offset as usize..e.offset as usize + e.encoded_bytes as usize;
        if let Some(body) = first.get(range) {
            let declared = Declared { vertices: e.vertices, triangles: e.triangles };
            kilwa_pack::chunk::decode(body, declared, head.header.attributes).expect("decodes");
            if e.parents().all(|p| there.contains(&p)) {
                there.insert(i);
            }
        }
    }
    assert!(there.contains(&0), "the first request holds the root chunk");
    Cut::from_refined(&pack.entries, there).expect("a valid cut")
}

#[test]
fn a_site_of_a_hundred_thousand_islands_is_built_and_its_first_request_shows_all_of_it() {
    let raw = islands();
    let options = BuildOptions { title: "islands".into(), ..BuildOptions::default() };
    let (triangles, positions) = (raw.triangles.clone(), raw.positions.clone());
    let built = build_pack(raw, &options, &Silent).expect("builds");
    let (r, pack) = (&built.report, open(&built.bytes));
    println!(
        "{} triangles in {} components; {:.2} bytes per triangle, {} chunks in {} levels; per patch {:?}; stuck {} places, {} \
         triangles; {} overfull",
        r.triangles,
        r.components,
        built.bytes.len() as f64 / r.triangles as f64,
        r.pack.chunks,
        r.pack.levels,
        r.pack.patch_triangles,
        r.stuck_diamonds,
        r.stuck_triangles,
        r.overfull_leaves
    );
    assert_eq!(r.components, u64::from(SIDE * SIDE));

    let finest = drawn(&pack, &Cut::finest(&pack.entries));
    let lattice = kilwa_pack::Reader::open(kilwa_pack::reader::SliceSource(&built.bytes)).unwrap().header().lattice;
    let given: Vec<LatticePoint> = positions.iter().map(|p| lattice.snap(*p).expect("inside")).collect();
    let wanted = sorted(triangles.iter().map(|t| t.map(|v| given[v as usize])));
    assert!(sorted(finest.iter().map(|(t, _)| *t)) == wanted, "every triangle comes back from the finest level");

    let per_level: Vec<u64> = (0..r.pack.levels as u8)
        .map(|l| pack.entries.iter().skip(1).filter(|e| e.level == l).map(|e| u64::from(e.triangles)).sum())
        .collect();
    println!("triangles per level {per_level:?}");
    let coarsest = drawn(&pack, &Cut::coarsest(&pack.entries));
    let first = first_request(&built.bytes, &pack);
    let shown = drawn(&pack, &first);
    println!(
        "root: {} triangles, {} bytes, {:.0} % of the square; first request: {} chunks, {} triangles, {:.0} %, within {} m",
        coarsest.len(),
        pack.entries[0].encoded_bytes,
        100.0 * covered(&coarsest, &lattice),
        first.refined().count(),
        shown.len(),
        100.0 * covered(&shown, &lattice),
        first.error(&pack.entries)
    );
    assert!(first.refined().count() >= 2, "more than the root is in the first request");
    assert!(covered(&shown, &lattice) >= 0.95, "the first picture shows the whole extent");
    assert!(covered(&coarsest, &lattice) >= 0.5, "and so does the root alone, roughly");
    assert!(r.stuck_triangles * 5 < r.triangles, "little stays at full resolution");
}
