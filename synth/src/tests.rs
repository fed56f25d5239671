//! Properties of synthetic sites.

use super::*;
use glam::DVec3;
use std::collections::{BTreeMap, HashMap};

const KINDS: [SiteKind; 4] =
    [SiteKind::Fort, SiteKind::Wall, SiteKind::Phantom(Phantom::Sphere), SiteKind::Phantom(Phantom::SteppedWall)];

fn options(triangles: u64) -> SynthOptions {
    SynthOptions::new(triangles)
}

fn make(kind: SiteKind, triangles: u64) -> RawMesh {
    mesh(kind, &options(triangles)).unwrap()
}

/// Area and signed volume.
fn size(mesh: &RawMesh) -> (f64, f64) {
    mesh.triangles.iter().fold((0.0, 0.0), |(area, volume), t| {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        let n = (b - a).cross(c - a);
        (area + n.length() / 2.0, volume + a.dot(b.cross(c)) / 6.0)
    })
}

/// For each undirected edge how often it is used forward and backward.
fn edges(mesh: &RawMesh) -> HashMap<(u32, u32), [u32; 2]> {
    let mut map: HashMap<(u32, u32), [u32; 2]> = HashMap::new();
    for t in &mesh.triangles {
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            map.entry((a.min(b), a.max(b))).or_default()[usize::from(a > b)] += 1;
        }
    }
    map
}

fn root(parent: &mut [u32], mut v: u32) -> u32 {
    while parent[v as usize] != v {
        parent[v as usize] = parent[parent[v as usize] as usize];
        v = parent[v as usize];
    }
    v
}

/// Triangles of each connected component, largest first.
fn components(mesh: &RawMesh) -> Vec<usize> {
    let mut parent: Vec<u32> = (0..mesh.positions.len() as u32).collect();
    for t in &mesh.triangles {
        for pair in [[t[0], t[1]], [t[1], t[2]]] {
            let [a, b] = pair.map(|v| root(&mut parent, v));
            parent[a as usize] = b;
        }
    }
    let mut sizes: BTreeMap<u32, usize> = BTreeMap::new();
    for t in &mesh.triangles {
        *sizes.entry(root(&mut parent, t[0])).or_default() += 1;
    }
    let mut sizes: Vec<usize> = sizes.into_values().collect();
    sizes.sort_unstable_by(|a, b| b.cmp(a));
    sizes
}

type Corner = ([u64; 3], [u8; 3]);

/// Triangles as their corners' bits, sorted: what a file says apart from its indices.
fn multiset(meshes: &[RawMesh]) -> Vec<[Corner; 3]> {
    let mut all: Vec<[Corner; 3]> = meshes
        .iter()
        .flat_map(|m| {
            let corner = |v: u32| (m.positions[v as usize].to_array().map(f64::to_bits), m.colors[v as usize]);
            m.triangles.iter().map(move |t| t.map(corner))
        })
        .collect();
    all.sort_unstable();
    all
}

fn nothing(_: u64, _: u64) {}

fn read(path: &Path) -> RawMesh {
    kilwa_formats::read::read_mesh(path, &mut |_, _| {}).unwrap()
}

#[test]
fn the_same_options_give_the_same_bytes_with_any_number_of_threads() {
    let folder = tempfile::tempdir().unwrap();
    for (n, kind) in KINDS.into_iter().enumerate() {
        let bytes = [1, 2, 5].map(|threads| {
            let path = folder.path().join(format!("{n}_{threads}.ply"));
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| write(kind, &options(9_000), &path, &mut nothing)).unwrap();
            std::fs::read(path).unwrap()
        });
        assert!(bytes[0] == bytes[1] && bytes[0] == bytes[2], "{kind:?}");
    }
}

#[test]
fn another_seed_gives_another_fort_and_wall() {
    for kind in [SiteKind::Fort, SiteKind::Wall] {
        let one = make(kind, 6_000);
        let two = mesh(kind, &SynthOptions { seed: 2, ..options(6_000) }).unwrap();
        assert_ne!(one.positions, two.positions, "{kind:?}");
        assert_ne!(one.colors, two.colors, "{kind:?}");
    }
}

#[test]
fn triangle_counts_are_within_two_percent_and_phantoms_within_ten() {
    let off = |kind, n: u64| make(kind, n).triangles.len() as f64 / n as f64 - 1.0;
    for (kind, n) in
        [(SiteKind::Wall, 2_000), (SiteKind::Wall, 77_777), (SiteKind::Fort, 5_000), (SiteKind::Fort, 40_000)]
    {
        assert!(off(kind, n).abs() < 0.02, "{kind:?} of {n}: off by {}", off(kind, n));
    }
    for phantom in Phantom::ALL {
        let off = off(SiteKind::Phantom(phantom), 10_000);
        assert!(off.abs() < 0.1, "{phantom:?}: off by {off}");
    }
}

#[test]
fn a_fort_too_large_to_count_has_its_triangle_count_according_to_a_sample() {
    let seed = SynthOptions { seed: 3, ..options(400_000) };
    let off = mesh(SiteKind::Fort, &seed).unwrap().triangles.len() as f64 / 400_000.0 - 1.0;
    assert!(off.abs() < 0.02, "off by {off}");
}

#[test]
fn no_triangle_is_degenerate_and_no_vertex_is_unused_or_doubled() {
    for kind in KINDS {
        let m = make(kind, 20_000);
        let mut used = vec![false; m.positions.len()];
        for t in &m.triangles {
            let [a, b, c] = t.map(|v| m.positions[v as usize]);
            assert!((b - a).cross(c - a).length_squared() > 0.0, "{kind:?}: {t:?} has no area");
            for v in t {
                used[*v as usize] = true;
            }
        }
        assert!(used.iter().all(|u| *u), "{kind:?} has unused vertices");
        let mut places: Vec<_> = m.positions.iter().map(|p| p.to_array().map(f64::to_bits)).collect();
        places.sort_unstable();
        places.dedup();
        assert_eq!(places.len(), m.positions.len(), "{kind:?} has two vertices at one place");
    }
}

#[test]
fn blocks_together_are_the_single_file_and_share_exact_borders() {
    let folder = tempfile::tempdir().unwrap();
    for (n, (kind, blocks)) in KINDS.into_iter().zip([6, 9, 4, 5]).enumerate() {
        let path = folder.path().join(format!("{n}.ply"));
        let cut = SynthOptions { blocks: Some(blocks), ..options(12_000) };
        let report = write(kind, &cut, &path, &mut nothing).unwrap();
        assert_eq!(report.files.len(), blocks as usize);
        let parts: Vec<RawMesh> = report.files.iter().map(|f| read(f)).collect();
        let whole = make(kind, 12_000);
        assert!(multiset(&parts) == multiset(std::slice::from_ref(&whole)), "{kind:?}: the union differs");
        let doubled = parts.iter().map(|p| p.positions.len()).sum::<usize>() - whole.positions.len();
        assert!(doubled > 0, "{kind:?}: blocks share no vertices");
    }
}

#[test]
fn a_file_read_back_is_the_mesh_in_memory() {
    let folder = tempfile::tempdir().unwrap();
    for utm in [false, true] {
        let path = folder.path().join(format!("{utm}.ply"));
        let asked = SynthOptions { utm, ..options(8_000) };
        let report = write(SiteKind::Fort, &asked, &path, &mut nothing).unwrap();
        let (file, memory) = (read(&path), mesh(SiteKind::Fort, &asked).unwrap());
        assert_eq!(file.positions, memory.positions);
        assert_eq!((&file.triangles, &file.colors), (&memory.triangles, &memory.colors));
        assert_eq!((report.vertices, report.triangles), (file.positions.len() as u64, file.triangles.len() as u64));
        assert_eq!(report.bytes, std::fs::metadata(&path).unwrap().len());
    }
}

#[test]
fn utm_coordinates_keep_the_detail_of_the_site() {
    let near = make(SiteKind::Wall, 4_000);
    let far = mesh(SiteKind::Wall, &SynthOptions { utm: true, ..options(4_000) }).unwrap();
    for (a, b) in near.positions.iter().zip(&far.positions) {
        for k in 0..3 {
            assert!((b[k] - UTM_ORIGIN[k] - a[k]).abs() < 1e-6, "{a:?} and {b:?}");
        }
    }
}

#[test]
fn phantoms_are_closed_face_outward_and_have_their_analytic_size() {
    for phantom in Phantom::ALL {
        let m = make(SiteKind::Phantom(phantom), 40_000);
        assert!(edges(&m).values().all(|uses| *uses == [1, 1]), "{phantom:?} is not a closed oriented manifold");
        assert_eq!(components(&m).len(), 1, "{phantom:?}");
        let (area, volume) = size(&m);
        assert!((area / phantom.area() - 1.0).abs() < 2e-3, "{phantom:?}: area {area}, not {}", phantom.area());
        assert!(
            (volume / phantom.volume() - 1.0).abs() < 2e-3,
            "{phantom:?}: volume {volume}, not {}",
            phantom.volume()
        );
        let low = m.positions.iter().map(|p| p[2]).fold(f64::MAX, f64::min);
        assert!(low.abs() < 1e-6, "{phantom:?} does not stand on z = 0 but on {low}");
    }
}

#[test]
fn the_wall_is_one_sheet_of_ten_by_five_metres_with_one_border() {
    let m = make(SiteKind::Wall, 20_000);
    let uses = edges(&m);
    assert!(uses.values().all(|[f, b]| *f <= 1 && *b <= 1), "an edge is used twice in one direction");
    let border: Vec<_> = uses.iter().filter(|(_, [f, b])| f + b == 1).map(|(e, _)| *e).collect();
    let outline = |v: u32| {
        let DVec3 { x, z, .. } = m.positions[v as usize];
        x == 0.0 || (x - 10.0).abs() < 1e-5 || z == 0.0 || (z - 5.0).abs() < 1e-5
    };
    assert!(!border.is_empty() && border.iter().all(|(a, b)| outline(*a) && outline(*b)));
    assert_eq!(components(&m).len(), 1);
    let faces_south = m.triangles.iter().all(|t| {
        let [a, b, c] = t.map(|v| m.positions[v as usize]);
        (b - a).cross(c - a).y < 0.0
    });
    assert!(faces_south, "a triangle of the height field turns away");
}

#[test]
fn the_wall_has_joints_twenty_millimetres_deep() {
    let m = make(SiteKind::Wall, 400_000);
    // In a strip as wide as a brick the relief spans a joint, the bricks' own offsets and little of the waves.
    let strip = m.positions.iter().filter(|p| (4.0..4.34).contains(&p[0]) && (3.0..3.25).contains(&p[2]));
    let (low, high) = strip.fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[1]), h.max(p[1])));
    assert!((0.018..0.08).contains(&(high - low)), "relief of {} m", high - low);
}

#[test]
fn the_fort_has_true_borders_islands_and_one_main_part() {
    for triangles in [20_000, 200_000] {
        let m = make(SiteKind::Fort, triangles);
        let border = edges(&m).values().filter(|[f, b]| f + b == 1).count();
        assert!(border > 200, "{border} border edges");
        let parts = components(&m);
        assert!(parts.len() > 5, "{} components", parts.len());
        assert!(parts[0] as f64 > 0.95 * m.triangles.len() as f64, "the main part has {} triangles", parts[0]);
    }
}

#[test]
fn the_fort_is_about_fifty_metres_across_and_coloured() {
    let m = make(SiteKind::Fort, 20_000);
    for (k, range) in [(0, 44.0..60.0), (1, 44.0..60.0), (2, 9.0..18.0)] {
        let (low, high) = m.positions.iter().fold((f64::MAX, f64::MIN), |(l, h), p| (l.min(p[k]), h.max(p[k])));
        assert!(range.contains(&(high - low)), "axis {k}: {low} to {high}");
    }
    let mut colors = m.colors.clone();
    colors.sort_unstable();
    colors.dedup();
    assert!(colors.len() > 3_000, "{} colours", colors.len());
    let dark = m.colors.iter().filter(|c| c.iter().all(|x| *x < 20)).count();
    assert!(dark * 100 < m.colors.len(), "{dark} vertices are black");
}

#[test]
fn memory_depends_on_the_border_of_a_slab_and_not_on_the_mesh() {
    struct Nowhere;
    impl Sink for Nowhere {
        type Error = Infallible;
        fn vertex(&mut self, _: DVec3, _: [u8; 3]) -> Result<(), Infallible> {
            Ok(())
        }
        fn triangle(&mut self, _: [u32; 3]) -> Result<(), Infallible> {
            Ok(())
        }
    }
    let peak = |kind, n| {
        let site = site(kind, &options(n), 1).unwrap();
        let Ok(peak) = weld(site.as_ref(), 0, true, &mut Nowhere, &mut |_| {});
        peak as f64
    };
    // Sixteen times the triangles are four times the length of a border.
    for (kind, n) in [(SiteKind::Wall, 100_000), (SiteKind::Fort, 15_000)] {
        let growth = peak(kind, 16 * n) / peak(kind, n);
        assert!(growth < 8.0, "{kind:?}: remembered vertices grew {growth} times");
    }
}

#[test]
fn impossible_options_are_refused_and_leave_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let refused = |kind, options: &SynthOptions, name: &str| {
        write(kind, options, &path(name), &mut nothing).unwrap_err().to_string()
    };
    assert!(refused(SiteKind::Fort, &options(100), "a.ply").contains("at least 5000"));
    assert!(refused(SiteKind::Wall, &options(5_000_000_000), "a.ply").contains("int indices"));
    assert!(refused(SiteKind::Wall, &options(3_000), "a.obj").contains(".ply"));
    std::fs::write(path("file"), "").unwrap();
    assert!(refused(SiteKind::Wall, &options(3_000), "file/a.ply").contains("is not a folder"));
    std::fs::remove_file(path("file")).unwrap();
    for blocks in [0, 1_001, 900] {
        let cut = SynthOptions { blocks: Some(blocks), ..options(3_000) };
        assert!(refused(SiteKind::Wall, &cut, "a.ply").contains("blocks are not possible"), "{blocks} blocks");
    }
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "something was left behind");
}

#[test]
fn an_existing_file_is_replaced_only_with_force() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    std::fs::write(&path, "mine").unwrap();
    let error = write(SiteKind::Wall, &options(3_000), &path, &mut nothing).unwrap_err();
    assert!(error.to_string().contains("--force"), "{error}");
    assert_eq!(std::fs::read(&path).unwrap(), b"mine");
    write(SiteKind::Wall, &SynthOptions { force: true, ..options(3_000) }, &path, &mut nothing).unwrap();
    assert!(std::fs::read(&path).unwrap().starts_with(b"ply\n"));
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "a temporary file was left");
}

#[test]
fn progress_ends_at_the_number_of_triangles_written() {
    let folder = tempfile::tempdir().unwrap();
    let (mut last, mut rising) = (0, true);
    let report = write(SiteKind::Fort, &options(10_000), &folder.path().join("a.ply"), &mut |done, _| {
        rising &= done >= last;
        last = done;
    });
    assert!(rising);
    assert_eq!(last, report.unwrap().triangles);
}
