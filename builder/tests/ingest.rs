//! The ingest gives the same tree and the same leaf patches whatever the memory, the threads and the order of the input,
//! and they are what a plain construction in memory gives.

mod support;

use kilwa_builder::ingest::{IngestOptions, Spool, ingest};
use kilwa_builder::scratch::Scratch;
use kilwa_builder::surface::{Ingested, Surface};
use kilwa_builder::work::{Stop, Work};
use kilwa_builder::{BuildError, BuildOptions, RawMesh, Silent};
use kilwa_geometry::{Mesh, Tetra};
use std::collections::BTreeMap;
use std::path::Path;
use support::{Random, closed, fort, non_manifold, wall, with_holes};

/// A corner with all that it carries.
type Corner = ([i32; 3], [u8; 3], [i16; 2], Vec<u32>);

/// Triangles with their border bits.
type Triangles = Vec<([Corner; 3], u8)>;

fn corner(m: &Mesh, v: u32) -> Corner {
    let v = v as usize;
    let scalars = m.scalars.iter().map(|s| s[v].to_bits()).collect();
    (m.positions[v], m.colors.get(v).copied().unwrap_or_default(), m.normals[v], scalars)
}

fn triangles_of(m: &Mesh) -> Triangles {
    m.triangles.iter().zip(&m.borders).map(|(t, b)| (t.map(|v| corner(m, v)), *b)).collect()
}

/// What a run gave, in a form that can be compared.
#[derive(PartialEq)]
struct Outcome {
    surface: Surface,
    /// Every tetrahedron with its children, every diamond with its tetrahedra.
    tetrahedra: Vec<(Tetra, u32, Option<[u32; 2]>, u32)>,
    diamonds: Vec<(u8, [i32; 3], Vec<u32>, bool)>,
    leaves: Vec<(u32, Mesh)>,
    /// Points that more than one leaf uses, with these leaves.
    shared: BTreeMap<[i32; 3], Vec<u32>>,
}

fn outcome(i: &Ingested) -> Outcome {
    let leaves: Vec<(u32, Mesh)> =
        i.leaves.tetrahedra().into_iter().map(|t| (t, i.leaves.read(t).unwrap().unwrap().mesh)).collect();
    let mut shared: BTreeMap<[i32; 3], Vec<u32>> = BTreeMap::new();
    for r in i.shared.read(0, i.shared.len() as usize).unwrap() {
        let p = kilwa_builder::scratch::point_of(r);
        shared.entry(p).or_default().push(kilwa_builder::scratch::tetrahedron_of(r));
    }
    shared.values_mut().for_each(|l| {
        l.sort_unstable();
        l.dedup();
    });
    shared.retain(|_, l| l.len() > 1);
    let tree = &i.tree;
    Outcome {
        surface: i.surface.clone(),
        tetrahedra: tree.tetrahedra.iter().map(|t| (t.tetra, t.diamond, t.children, t.parent_diamond)).collect(),
        diamonds: tree.diamonds.iter().map(|d| (d.key.level, d.key.midpoint, d.tetrahedra.clone(), d.split)).collect(),
        leaves,
        shared,
    }
}

struct Case {
    memory: u64,
    threads: usize,
    leaf_triangles: usize,
}

fn options(leaf_triangles: usize) -> IngestOptions {
    IngestOptions { leaf_triangles, step: None, crop: None, min_confidence: None }
}

fn try_run(inputs: &[&RawMesh], case: &Case, options: &IngestOptions) -> Result<Outcome, BuildError> {
    let (scratch, stop) = (Scratch::temporary().unwrap(), Stop::default());
    let work = Work { scratch: &scratch, memory: case.memory, threads: case.threads, stop: &stop, progress: &Silent };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(case.threads).build().unwrap();
    pool.install(|| {
        let mut spool = Spool::create(&scratch, Path::new("input 0"))?;
        for (n, input) in inputs.iter().enumerate() {
            spool.input(Path::new(&format!("input {n}"))).unwrap();
            spool.add(input).unwrap();
        }
        let spooled = spool.finish()?;
        Ok(outcome(&ingest(&work, Some(spooled), options, Vec::new())?))
    })
}

fn run(inputs: &[&RawMesh], case: &Case) -> Outcome {
    try_run(inputs, case, &options(case.leaf_triangles)).expect("ingests")
}

fn same(a: &Outcome, b: &Outcome, what: &str) {
    assert_eq!(a.surface, b.surface, "{what}");
    assert!(a.tetrahedra == b.tetrahedra && a.diamonds == b.diamonds, "{what}: the tree");
    assert!(a.leaves.iter().map(|l| l.0).eq(b.leaves.iter().map(|l| l.0)), "{what}: which leaves");
    for (x, y) in a.leaves.iter().zip(&b.leaves) {
        assert!(x == y, "{what}: leaf {}", x.0);
    }
    assert!(a.shared == b.shared, "{what}: shared points");
}

const LARGE: u64 = 1 << 30;

/// Memory for a few hundred vertices and triangles at a time.
const TINY: u64 = 1 << 14;

fn meshes() -> Vec<(&'static str, RawMesh)> {
    vec![
        ("wall", wall(30_000)),
        ("closed", closed(20_000)),
        ("holes", with_holes(20_000)),
        ("non-manifold", non_manifold(40)),
        ("fort", fort(30_000)),
    ]
}

#[test]
fn memory_and_threads_do_not_matter() {
    for (name, mesh) in meshes() {
        let leaf_triangles = 300;
        let reference = run(&[&mesh], &Case { memory: LARGE, threads: 1, leaf_triangles });
        for (memory, threads) in [(LARGE, 8), (TINY, 1), (TINY, 8), (1 << 19, 2), (1 << 21, 3)] {
            let other = run(&[&mesh], &Case { memory, threads, leaf_triangles });
            same(&reference, &other, &format!("{name}, {memory} bytes, {threads} threads"));
        }
    }
}

#[test]
fn it_is_what_a_plain_construction_in_memory_gives() {
    for (name, mesh) in meshes() {
        for memory in [LARGE, TINY] {
            let leaf_triangles = 300;
            let found = run(&[&mesh], &Case { memory, threads: 2, leaf_triangles });
            let prepared = kilwa_builder::prepare::prepare(mesh.clone(), &BuildOptions::default()).expect("prepares");
            let tree = kilwa_builder::partition::partition(&prepared.mesh, prepared.cube_log2, leaf_triangles);
            let s = &found.surface;
            assert_eq!((s.lattice, s.cube_log2), (prepared.lattice, prepared.cube_log2), "{name}");
            assert_eq!(s.points, prepared.points, "{name}");
            assert_eq!(s.border_edges, prepared.border_edges, "{name}");
            assert_eq!(s.non_manifold_edges, prepared.non_manifold_edges, "{name}");
            assert_eq!(s.triangles, prepared.mesh.triangle_count() as u64, "{name}");
            assert!((s.median_edge / prepared.median_edge - 1.0).abs() < 2e-3, "{name}");
            let bounds = prepared.mesh.bounds();
            assert_eq!(s.bounds, [bounds.min, bounds.max], "{name}");
            let plain_findings: Vec<(&str, u64)> = prepared
                .findings
                .iter()
                .filter(|(kind, ..)| !kind.contains("no triangle uses"))
                .map(|(kind, n, _)| (kind, n))
                .collect();
            let found_findings: Vec<(&str, u64)> = s
                .findings
                .iter()
                .filter(|(kind, _)| !kind.contains("no triangle uses"))
                .map(|(kind, f)| (kind.as_str(), f.count))
                .collect();
            assert_eq!(found_findings, plain_findings, "{name}");
            let plain: BTreeMap<Tetra, Triangles> = tree
                .leaves()
                .filter(|t| !tree.tetrahedra[*t as usize].range.is_empty())
                .map(|t| {
                    let node = &tree.tetrahedra[t as usize];
                    let m = &prepared.mesh;
                    let mut all: Triangles = tree.order[node.range.clone()]
                        .iter()
                        .map(|&t| (m.triangles[t as usize].map(|v| corner(m, v)), m.borders[t as usize]))
                        .collect();
                    all.sort();
                    (node.tetra, all)
                })
                .collect();
            let tetra_of = |t: u32| found.tetrahedra[t as usize].0;
            let ours: BTreeMap<Tetra, Triangles> =
                found.leaves.iter().map(|(t, mesh)| (tetra_of(*t), triangles_of(mesh))).collect();
            assert!(plain.keys().eq(ours.keys()), "{name}: {} and {} leaves", plain.len(), ours.len());
            for (tetra, triangles) in &plain {
                assert!(ours[tetra] == *triangles, "{name}: {tetra:?}");
            }
            let all = |tetrahedra: &mut dyn Iterator<Item = Tetra>| {
                let mut all: Vec<Tetra> = tetrahedra.collect();
                all.sort_unstable();
                all
            };
            assert!(
                all(&mut tree.tetrahedra.iter().map(|t| t.tetra)) == all(&mut found.tetrahedra.iter().map(|t| t.0)),
                "{name}: the same tetrahedra"
            );
        }
    }
}

/// The mesh with its vertices and triangles in another order.
fn shuffled(mesh: &RawMesh, seed: u64) -> RawMesh {
    let mut out = mesh.clone();
    let mut random = Random(seed);
    let n = mesh.positions.len();
    let mut new_of_old: Vec<u32> = (0..n as u32).collect();
    for i in (1..n).rev() {
        new_of_old.swap(i, random.below(i + 1));
    }
    for (old, new) in new_of_old.iter().enumerate() {
        out.positions[*new as usize] = mesh.positions[old];
        if !mesh.colors.is_empty() {
            out.colors[*new as usize] = mesh.colors[old];
        }
    }
    out.triangles.iter_mut().for_each(|t| *t = t.map(|v| new_of_old[v as usize]));
    for i in (1..out.triangles.len()).rev() {
        out.triangles.swap(i, random.below(i + 1));
    }
    out
}

#[test]
fn the_order_of_vertices_triangles_and_inputs_does_not_matter() {
    for (name, mesh) in meshes() {
        let case = |memory| Case { memory, threads: 2, leaf_triangles: 300 };
        let reference = run(&[&mesh], &case(LARGE));
        same(&reference, &run(&[&shuffled(&mesh, 7)], &case(TINY)), &format!("{name} shuffled"));
        // The same mesh in two inputs, both ways round; the vertices at their seam weld.
        let (mut a, mut b) = (mesh.clone(), shuffled(&mesh, 8));
        a.triangles.truncate(mesh.triangles.len() / 2);
        b.triangles = mesh.triangles[a.triangles.len()..].to_vec();
        b.positions.clone_from(&mesh.positions);
        b.colors.clone_from(&mesh.colors);
        let one_way = run(&[&a, &b], &case(LARGE));
        let other_way = run(&[&b, &a], &case(TINY));
        same(&one_way, &other_way, &format!("{name}: order of inputs"));
        assert!(one_way.leaves == reference.leaves && one_way.shared == reference.shared, "{name} in two inputs");
    }
}
