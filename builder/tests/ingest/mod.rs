//! The ingest gives the same tree and the same leaf patches for any memory, threads and order of the input, and they equal
//! those of a simple construction in memory.

mod plain;

use crate::support::{closed, fort, non_manifold, shuffled, wall, with_holes};
use glam::{DVec3, Vec3};
use kilwa_builder::build::work::{Stop, Work};
use kilwa_builder::ingest::surface::{Ingested, Surface};
use kilwa_builder::ingest::{IngestOptions, Spool, ingest};
use kilwa_builder::scratch::Scratch;
use kilwa_builder::{BuildError, Precision, Provenance, Silent};
use kilwa_formats::RawMesh;
use kilwa_geometry::{Mesh, Tetra};
use plain::{partition, plain};
use std::collections::BTreeMap;
use std::path::Path;

/// A corner with all its attributes.
type Corner = ([i32; 3], [u8; 3], [i16; 2], Vec<u32>);

/// Triangles with their border bits.
type Triangles = Vec<([Corner; 3], u8)>;

fn corner(m: &Mesh, v: u32) -> Corner {
    let v = v as usize;
    let scalars = m.scalars.iter().map(|s| s[v].to_bits()).collect();
    (m.positions[v].to_array(), m.colors.get(v).copied().unwrap_or_default(), m.normals[v], scalars)
}

fn triangles_of(m: &Mesh) -> Triangles {
    m.triangles.iter().zip(&m.borders).map(|(t, b)| (t.map(|v| corner(m, v)), *b)).collect()
}

/// The result of a run, in a comparable form.
#[derive(PartialEq)]
struct Outcome {
    surface: Surface,
    /// Every tetrahedron with its children, every diamond with its tetrahedra.
    tetrahedra: Vec<(Tetra, u32, Option<[u32; 4]>, u32)>,
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
        shared.entry(p.to_array()).or_default().push(kilwa_builder::scratch::tetrahedron_of(r));
    }
    for leaves in shared.values_mut() {
        leaves.sort_unstable();
        leaves.dedup();
    }
    shared.retain(|_, l| l.len() > 1);
    let tree = &i.tree;
    Outcome {
        surface: i.surface.clone(),
        tetrahedra: tree.tetrahedra.iter().map(|t| (t.tetra, t.diamond, t.children, t.parent_diamond)).collect(),
        diamonds: tree
            .diamonds
            .iter()
            .map(|d| (d.key.level, d.key.midpoint.to_array(), d.tetrahedra.clone(), d.split))
            .collect(),
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
    IngestOptions {
        leaf_triangles,
        step: None,
        crop: None,
        min_confidence: None,
        drop_islands_below: None,
        precision: Precision::default(),
    }
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
        Ok(outcome(&ingest(&work, Some(spooled), options, Provenance::default())?))
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
fn the_result_does_not_depend_on_memory_or_threads() {
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
fn an_ingest_equals_a_simple_construction_in_memory() {
    for (name, mesh) in meshes() {
        for memory in [LARGE, TINY] {
            let leaf_triangles = 300;
            let found = run(&[&mesh], &Case { memory, threads: 2, leaf_triangles });
            let expected = plain(&mesh);
            let tree = partition(&expected.mesh, expected.cube_log2, leaf_triangles);
            let s = &found.surface;
            assert_eq!((s.lattice, s.cube_log2), (expected.lattice, expected.cube_log2), "{name}");
            assert_eq!(s.points, expected.points, "{name}");
            assert_eq!(s.border_edges, expected.border_edges, "{name}");
            assert_eq!(s.non_manifold_edges, expected.non_manifold_edges, "{name}");
            assert_eq!(s.triangles, expected.mesh.triangle_count() as u64, "{name}");
            assert!((s.median_edge / expected.median_edge - 1.0).abs() < 2e-3, "{name}");
            let bounds = expected.mesh.bounds();
            assert_eq!(s.bounds, [bounds.min, bounds.max], "{name}");
            let count = |kind: &str| s.diagnostics.get(kind).map_or(0, |f| f.count);
            assert_eq!(count("triangles dropped because they collapse on the lattice"), expected.collapsed, "{name}");
            assert_eq!(count("vertices welded because they are equal on the lattice"), expected.welded, "{name}");
            let theirs: BTreeMap<Tetra, Triangles> = tree
                .leaves()
                .filter(|t| !tree.tetrahedra[*t as usize].range.is_empty())
                .map(|t| {
                    let node = &tree.tetrahedra[t as usize];
                    let m = &expected.mesh;
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
            assert!(theirs.keys().eq(ours.keys()), "{name}: {} and {} leaves", theirs.len(), ours.len());
            for (tetra, triangles) in &theirs {
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

#[test]
fn the_result_does_not_depend_on_the_order_of_vertices_triangles_and_inputs() {
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

fn refused(mesh: &RawMesh, step: Option<f64>) -> String {
    let options = IngestOptions { step, ..options(2048) };
    let case = Case { memory: LARGE, threads: 2, leaf_triangles: 2048 };
    try_run(&[mesh], &case, &options).err().map(|e| e.to_string()).unwrap_or_default()
}

fn grid(n: u32, edge: f64) -> RawMesh {
    let mut raw = RawMesh::default();
    for i in 0..n {
        for j in 0..n {
            let v = raw.positions.len() as u32;
            let (x, y) = (f64::from(i) * edge, f64::from(j) * edge);
            raw.positions.extend([[x, y, 0.0], [x + edge, y, 0.0], [x, y + edge, 0.0]].map(DVec3::from));
            raw.triangles.push([v, v + 1, v + 2]);
        }
    }
    raw
}

/// A grid of triangles, of which every sixtieth is so thin that its shortest edge is `short` long.
fn grid_with_slivers(n: u32, short: f64) -> RawMesh {
    let mut raw = grid(n, 1.0);
    for t in (0..raw.triangles.len()).step_by(60) {
        let [a, b, _] = raw.triangles[t].map(|v| v as usize);
        raw.positions[b] = raw.positions[a] + DVec3::new(short, 0.0, 0.0);
    }
    raw
}

#[test]
fn the_spacing_keeps_all_but_a_thousandth_of_the_triangles_and_stays_where_they_are_kept_anyway() {
    let found = |short: f64| {
        let s = run(&[&grid_with_slivers(60, short)], &Case { memory: TINY, threads: 2, leaf_triangles: 300 }).surface;
        let dropped =
            s.diagnostics.get("triangles dropped because they collapse on the lattice").map_or(0, |f| f.count);
        (s.lattice.step(), dropped)
    };
    // A sixteenth of the edges, where the thin ones survive too.
    assert_eq!(found(0.05), (0.0625, 0));
    // One sixtieth of the triangles would collapse on a sixteenth.
    assert_eq!(found(0.02), (0.031_25, 0));
    assert_eq!(found(0.000_2), (0.000_244_140_625, 0));
    // No spacing within reach keeps these: they cost no bytes.
    assert_eq!(found(1e-9), (0.0625, 60));
    let given = IngestOptions { step: Some(0.0625), ..options(300) };
    let case = Case { memory: LARGE, threads: 2, leaf_triangles: 300 };
    let given = try_run(&[&grid_with_slivers(60, 0.02)], &case, &given).expect("ingests");
    assert_eq!(given.surface.lattice.step(), 0.0625, "a spacing that was asked for is used");
}

#[test]
fn inputs_with_more_channels_together_than_a_pack_holds_are_refused_by_name() {
    let mut raw = grid(1, 1.0);
    raw.scalars = (0..20).map(|i| (format!("channel{i}"), vec![0.0; 3])).collect();
    let error = refused(&raw, None);
    assert!(error.contains("20 scalar channels") && error.contains("channel19"), "{error}");
}

#[test]
fn an_outlying_vertex_is_refused_instead_of_coarsening_the_lattice() {
    let raw = grid(10, 0.01);
    assert_eq!(refused(&raw, None), "");
    for astray in [1e8, 1e12, 1e300, f64::MAX, -f64::MAX] {
        let mut raw = raw.clone();
        raw.positions[0] = DVec3::new(astray, 0.0, 0.0);
        let error = refused(&raw, None);
        assert!(error.contains("m wide"), "{astray}: {error}");
        // An unused one is harmless.
        raw.positions[0] = DVec3::ZERO;
        raw.positions.push(DVec3::new(astray, 0.0, 0.0));
        let case = Case { memory: LARGE, threads: 2, leaf_triangles: 2048 };
        let found = run(&[&raw], &case);
        assert_eq!(found.surface.diagnostics["vertices that no triangle uses"].count, 1);
        raw.positions.pop();
        assert!(found.leaves == run(&[&raw], &case).leaves, "{astray}");
    }
}

#[test]
fn a_mesh_too_small_for_a_lattice_is_reported_as_too_small() {
    for edge in [1e-300, 1e-100, 1e-30] {
        let error = refused(&grid(10, edge), None);
        assert!(error.contains("too small") && error.contains("--units"), "{edge:e}: {error}");
        assert!(!error.contains("astray") && !error.contains(" 0e0 "), "{edge:e}: {error}");
    }
}

#[test]
fn the_lattice_spacing_suggested_by_a_refusal_works() {
    let raw = grid(80, 0.1);
    let error = refused(&raw, Some(2f64.powi(-40)));
    let named: f64 =
        error.rsplit("use ").next().and_then(|s| s.split(' ').next()).and_then(|s| s.parse().ok()).expect("a step");
    assert_eq!(refused(&raw, Some(named)), "");
    assert!(refused(&raw, Some(0.0)).contains("greater than zero") && refused(&raw, Some(0.3)).contains("0.25"));
    assert!(refused(&RawMesh::default(), None).contains("no triangles"));
}

#[test]
fn coincident_triangles_and_fans_do_not_subdivide_forever() {
    for memory in [LARGE, TINY] {
        let case = Case { memory, threads: 2, leaf_triangles: 100 };
        let mut raw = grid(12, 0.1);
        let t = raw.triangles[40];
        raw.triangles.extend(std::iter::repeat_n(t, 10_000));
        let found = run(&[&raw], &case);
        assert!(found.tetrahedra.len() < 200, "{}", found.tetrahedra.len());
        assert_eq!(found.surface.triangles, 10_144);
        // A fan round one vertex, each blade far longer than wide.
        let mut fan = RawMesh { positions: vec![DVec3::ZERO], ..RawMesh::default() };
        for i in 0..6000u32 {
            let a = f64::from(i) * std::f64::consts::TAU / 6000.0;
            fan.positions.push(DVec3::new(a.cos(), a.sin(), 0.01 * (9.0 * a).sin()));
            fan.triangles.push([0, i + 1, (i + 1) % 6000 + 1]);
        }
        let found = run(&[&fan], &case);
        assert_eq!((found.surface.triangles, found.surface.border_edges), (6000, 6000));
        assert!(found.tetrahedra.len() < 4000, "{}", found.tetrahedra.len());
    }
}

#[test]
fn only_triangles_with_vertices_that_are_not_finite_are_dropped() {
    let mut raw = grid(30, 0.1);
    for (v, x) in [(0, f64::NAN), (301, f64::INFINITY), (302, f64::NEG_INFINITY)] {
        raw.positions[v][v % 3] = x;
    }
    for memory in [LARGE, TINY] {
        let found = run(&[&raw], &Case { memory, threads: 2, leaf_triangles: 100 }).surface;
        assert_eq!(found.triangles, 900 - 2);
        let dropped = &found.diagnostics["triangles dropped because a corner has no finite position"];
        assert_eq!((dropped.count, dropped.places.clone()), (2, vec!["triangle 0".into(), "triangle 100".into()]));
        assert_eq!(found.diagnostics["vertices without a finite position dropped"].count, 3);
    }
}

#[test]
fn the_order_in_which_the_corners_of_triangles_are_found_does_not_affect_the_result() {
    let mut raw = grid(400, 0.1);
    for v in [7, 60_000, 60_001, 180_000, 240_000, 440_000, 479_000] {
        raw.positions[v].x = f64::NAN;
    }
    // Where no triangle is kept for a long stretch, and single ones.
    let low = |v: usize| (270_000..420_000).contains(&v) || v.is_multiple_of(1000);
    raw.scalars.push(("confidence".into(), (0..raw.positions.len()).map(|v| if low(v) { 0.1 } else { 0.9 }).collect()));
    let o = IngestOptions { min_confidence: Some(0.5), ..options(2000) };
    let (forwards, half) = (raw.triangles.clone(), raw.triangles.len() / 2);
    // Little memory: few vertices at a time, so that triangles are complete at once, much later, or in the opposite order.
    let backwards: Vec<[u32; 3]> = forwards.iter().rev().copied().collect();
    let ends_in_turn = forwards[..half].iter().zip(&backwards).flat_map(|(a, b)| [*a, *b]).collect();
    for (name, triangles) in [("forwards", forwards), ("backwards", backwards), ("ends in turn", ends_in_turn)] {
        raw.triangles = triangles;
        let at_once = try_run(&[&raw], &Case { memory: LARGE, threads: 2, leaf_triangles: 2000 }, &o).unwrap();
        assert!(at_once.surface.diagnostics.values().any(|d| d.places.len() == 5), "{name}");
        for (memory, threads) in [(TINY, 1), (1 << 21, 2)] {
            let found = try_run(&[&raw], &Case { memory, threads, leaf_triangles: 2000 }, &o).unwrap();
            same(&at_once, &found, &format!("{name}, {memory} bytes"));
        }
    }
}

#[test]
fn a_triangle_with_an_index_out_of_range_is_an_error_that_names_it() {
    let (scratch, raw) = (Scratch::temporary().unwrap(), grid(3, 0.1));
    let mut spool = Spool::create(&scratch, Path::new("first.ply")).unwrap();
    spool.add(&raw).unwrap();
    spool.input(Path::new("second.ply")).unwrap();
    let mut wrong = raw.clone();
    wrong.triangles[5][1] = 27;
    spool.add(&wrong).unwrap();
    let error = spool.finish().unwrap_err().to_string();
    assert!(error.contains("second.ply: triangle 5 ") && error.contains("vertex 27, but the file has 27"), "{error}");
}

#[test]
fn triangles_removed_by_crop_and_confidence_are_counted() {
    let mut raw = grid(30, 0.1);
    let confidence = (0..raw.positions.len()).map(|v| if v % 300 < 3 { 0.1 } else { 0.9 }).collect();
    raw.scalars.push(("confidence".into(), confidence));
    for memory in [LARGE, TINY] {
        let case = Case { memory, threads: 2, leaf_triangles: 100 };
        let crop = Some([[-1.0, -1.0, -1.0], [1.0, 0.5, 1.0]].map(Into::into));
        let o = IngestOptions { crop, min_confidence: Some(0.5), ..options(100) };
        let found = try_run(&[&raw], &case, &o).unwrap();
        let n = |kind: &str| found.surface.diagnostics.get(kind).map_or(0, |f| f.count);
        // Centroids lie a third of an edge inside: 10 columns and 5 rows, less those of low confidence among them.
        assert_eq!(n("triangles dropped because of --min-confidence"), 9);
        let low_inside = 1;
        assert_eq!(found.surface.triangles, 50 - low_inside);
        assert_eq!(n("triangles outside of --crop dropped"), 900 - 9 - 49);
        let outside = |m: &Mesh| {
            let step = found.surface.lattice;
            m.positions.iter().any(|p| step.world_from_lattice(*p)[1] > 0.5 + 0.1)
        };
        assert!(!found.leaves.iter().any(|(_, m)| outside(m)));
    }
}

#[test]
fn attributes_of_several_inputs_are_combined_and_missing_ones_counted() {
    let (mut coloured, mut plain) = (grid(4, 0.1), grid(4, 0.1));
    plain.positions.iter_mut().for_each(|p| p[0] += 0.4);
    coloured.colors = vec![[10, 20, 30]; 48];
    coloured.scalars = vec![("b".into(), vec![2.0; 48]), ("alpha".into(), vec![1.0; 48])];
    plain.scalars = vec![("a".into(), vec![5.0; 48])];
    plain.normals = vec![Vec3::Z; 48];
    let case = Case { memory: LARGE, threads: 2, leaf_triangles: 100 };
    let (one, other) = (run(&[&coloured, &plain], &case), run(&[&plain, &coloured], &case));
    same(&one, &other, "order of inputs");
    let names: Vec<&str> = one.surface.scalars.iter().map(|s| s.name.as_str()).collect();
    assert_eq!(names, ["a", "alpha", "b"]);
    assert_eq!((one.surface.scalars[2].min, one.surface.scalars[2].max), (0.0, 2.0));
    let n = |kind: &str| one.surface.diagnostics.get(kind).map_or(0, |f| f.count);
    assert_eq!(n("vertices without colour beside coloured ones, shown grey"), 48);
    assert_eq!(n("vertices without a scalar that other files have, set to 0"), 3 * 48);
    assert_eq!(n("normals dropped and computed anew, because other files have none"), 48);
    let colors: std::collections::BTreeSet<[u8; 3]> =
        one.leaves.iter().flat_map(|(_, m)| m.colors.iter().copied()).collect();
    assert_eq!(colors.len(), 2);
    // A constant alpha of 1 is dropped, and an intensity is shown as grey.
    let mut scan = grid(20, 0.1);
    let n = scan.positions.len();
    scan.scalars =
        vec![("Alpha".into(), vec![1.0; n]), ("scalar_Intensity".into(), (0..n).map(|i| i as f32).collect())];
    let found = run(&[&scan], &case);
    assert!(found.surface.colors && found.surface.scalars.len() == 1);
    let greys: std::collections::BTreeSet<[u8; 3]> =
        found.leaves.iter().flat_map(|(_, m)| m.colors.iter().copied()).collect();
    assert!(greys.iter().all(|[r, g, b]| r == g && g == b) && greys.len() > 200);
    assert!(greys.contains(&[0; 3]) && greys.contains(&[255; 3]));
}

#[test]
fn only_small_components_are_dropped_and_they_leave_nothing_behind() {
    // A wall with islands of 1 to 40 triangles scattered before it.
    let base = wall(20_000);
    let mut raw = base.clone();
    let mut random = fastrand::Rng::with_seed(4);
    let mut dropped = 0u64;
    for n in 1..=40u32 {
        let first = raw.positions.len() as u32;
        let at: [f64; 3] = std::array::from_fn(|k| raw.positions[random.usize(..base.positions.len())][k] + 0.5);
        for i in 0..n + 2 {
            let (x, y) = (f64::from(i / 2) * 0.01, f64::from(i % 2) * 0.01);
            raw.positions.push(DVec3::new(at[0] + x, at[1] + y, at[2]));
            raw.colors.push([200, 0, 0]);
        }
        raw.triangles.extend((0..n).map(|i| [first + i, first + i + 1, first + i + 2]));
        dropped += if n < 30 { u64::from(n) } else { 0 };
    }
    for memory in [LARGE, 1 << 18, TINY] {
        let case = Case { memory, threads: 2, leaf_triangles: 300 };
        let with = |o: IngestOptions, raw: &RawMesh| try_run(&[raw], &case, &o).unwrap();
        let below = IngestOptions { drop_islands_below: Some(30), step: Some(2f64.powi(-12)), ..options(300) };
        let all = with(IngestOptions { drop_islands_below: None, ..below.clone() }, &raw);
        assert_eq!((all.surface.components, all.surface.largest_component), (41, base.triangles.len() as u64));
        let found = with(below.clone(), &raw);
        assert_eq!(all.surface.triangles - found.surface.triangles, dropped);
        assert_eq!(found.surface.components, 12);
        let kind = "triangles of components smaller than --drop-islands-below dropped";
        assert_eq!(found.surface.diagnostics[kind].count, dropped);
        let alone = with(IngestOptions { drop_islands_below: Some(41), ..below }, &raw);
        let expected = with(IngestOptions { step: Some(2f64.powi(-12)), ..options(300) }, &base);
        assert_eq!(alone.surface.border_edges, expected.surface.border_edges);
        assert_eq!((alone.surface.points, alone.surface.components), (expected.surface.points, 1));
    }
}

#[test]
fn the_estimated_noise_is_that_of_the_surface() {
    for sigma in [0.0005, 0.002] {
        let mut raw = RawMesh::default();
        let mut random = fastrand::Rng::with_seed(12);
        let n = 120u32;
        for i in 0..n {
            for j in 0..n {
                // The sum of twelve uniform numbers is normal enough.
                let noise = (0..12).map(|_| random.f64()).sum::<f64>() - 6.0;
                raw.positions.push(DVec3::new(f64::from(i) * 0.01, f64::from(j) * 0.01, noise * sigma));
                let v = i * n + j;
                if i + 1 < n && j + 1 < n {
                    raw.triangles.extend([[v, v + n, v + 1], [v + 1, v + n, v + n + 1]]);
                }
            }
        }
        let found = run(&[&raw], &Case { memory: 1 << 19, threads: 2, leaf_triangles: 500 }).surface;
        assert!((found.noise / sigma - 1.0).abs() < 0.15, "{} instead of {sigma}", found.noise);
    }
}

#[test]
fn duplicate_triangles_and_inconsistent_orientation_are_counted() {
    let mut raw = closed(8_000);
    for t in [10, 500, 2000] {
        let [a, b, c] = raw.triangles[t];
        raw.triangles.push([b, c, a]);
    }
    let [a, b, c] = raw.triangles[3000];
    raw.triangles[3000] = [a, c, b];
    for memory in [LARGE, TINY] {
        let found = run(&[&raw], &Case { memory, threads: 2, leaf_triangles: 500 }).surface;
        assert_eq!((found.duplicate_triangles, found.inconsistent_edges), (3, 3));
        assert_eq!((found.border_edges, found.non_manifold_edges), (0, 9));
    }
}

/// Asks to stop when a stage begins.
struct StopAt(&'static str, Stop);

impl kilwa_builder::Progress for StopAt {
    fn update(&self, stage: &'static str, _done: u64, _total: u64) {
        if stage == self.0 {
            self.1.ask();
        }
    }
}

#[test]
fn an_ingest_stopped_in_any_stage_resumes_with_the_same_result() {
    let mesh = with_holes(20_000);
    let reference = run(&[&mesh], &Case { memory: LARGE, threads: 2, leaf_triangles: 300 });
    for stage in ["finding corners", "sorting into regions", "joining triangles", "filling leaves"] {
        let (scratch, stop) = (Scratch::temporary().unwrap(), Stop::default());
        let progress = StopAt(stage, stop.clone());
        let work = Work { scratch: &scratch, memory: TINY, threads: 2, stop: &stop, progress: &progress };
        let mut spool = Spool::create(&scratch, Path::new("input 0")).unwrap();
        spool.add(&mesh).unwrap();
        let stopped = ingest(&work, Some(spool.finish().unwrap()), &options(300), Provenance::default());
        assert!(matches!(stopped, Err(BuildError::Stopped)), "{stage}");
        assert!(kilwa_builder::ingest::can_resume(&scratch));
        assert!(scratch.files().unwrap().iter().all(|(name, _)| kilwa_builder::ingest::is_file_of_ingest(name)));
        let (stop, progress) = (Stop::default(), Silent);
        let work = Work { scratch: &scratch, memory: LARGE, threads: 1, stop: &stop, progress: &progress };
        let found = ingest(&work, None, &options(300), Provenance::default()).expect("goes on");
        same(&reference, &outcome(&found), stage);
    }
}

/// More triangles at a few places than a chunk holds: no later stage can divide them.
#[test]
fn a_leaf_too_large_for_a_chunk_is_refused_with_any_amount_of_memory() {
    for places in [1u32, 60] {
        let mut mesh = RawMesh::default();
        // The last one is far away, so that all others are in one leaf.
        for x in (0..places).map(|i| f64::from(i) / 100.0).chain([10.0]) {
            mesh.positions.extend([[x, 0.0, 0.0], [x + 0.01, 0.0, 0.0], [x, 0.01, 0.0]].map(DVec3::from));
        }
        let triangle = |place: u32| [3 * place, 3 * place + 1, 3 * place + 2];
        mesh.triangles = (0..(1 << 20) + 50_000).map(|t| triangle(t % places)).chain([triangle(places)]).collect();
        // With little memory a single place is a bucket that is never read whole.
        for memory in [LARGE, 1 << 24] {
            let case = Case { memory, threads: 2, leaf_triangles: 300 };
            let refused = try_run(&[&mesh], &case, &options(case.leaf_triangles)).err().expect("refused");
            let BuildError::TooLarge { why } = &refused else { panic!("{places} places, {memory} bytes: {refused}") };
            assert!(why.contains("1098576 triangles near"), "{why}");
        }
    }
}
