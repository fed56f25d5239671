use super::collar::{self, Collar};
use super::membrane::{Membrane, Nearest};
use super::{Fill, Filler};
use crate::ScanError;
use crate::merge::join::Joined;
use crate::merge::rims::RimVertex;
use crate::merge::{Begin, MergedSurface, MergedVertex, Scale, Source, holes};
use glam::{DVec2, DVec3, IVec3};
use kilwa_scan_core::tsdf::{EdgeKey, Patch, PatchVertex};
use std::collections::{HashMap, HashSet};
use std::f64::consts::TAU;

fn membrane(rims: &[&[RimVertex]], spacing: f64) -> Option<Membrane> {
    super::membrane::membrane(rims, spacing, Nearest { distance: spacing / 256.0, checks_rims: true })
}

/// The rim of a hole in a surface that was scanned from above; the points run counterclockwise seen from above.
fn rim(points: &[DVec3]) -> Vec<RimVertex> {
    let vertex = |(k, p): (usize, &DVec3)| RimVertex {
        number: k as u64,
        position: *p,
        normal: DVec3::Z,
        color: Some([200, 100, (p.x.abs() * 40.0) as u8]),
        intensity: p.x as f32,
    };
    // The surface is on the left, so a hole is on the right.
    points.iter().rev().enumerate().map(vertex).collect()
}

fn star(count: usize, radius: impl Fn(usize) -> f64, height: impl Fn(DVec2) -> f64) -> Vec<RimVertex> {
    let place = |k: usize| {
        let p = DVec2::from_angle(k as f64 / count as f64 * TAU) * radius(k);
        p.extend(height(p))
    };
    rim(&(0..count).map(place).collect::<Vec<_>>())
}

/// Panics unless every side of a rim has one triangle, on its right, and every other edge has two, and each triangle has a new vertex.
fn assert_closed(rims: &[&[RimVertex]], made: &Membrane) {
    let fixed: usize = rims.iter().map(|rim| rim.len()).sum();
    let mut sides = HashSet::new();
    for [a, b, c] in &made.triangles {
        assert!([a, b, c].into_iter().any(|k| *k as usize >= fixed), "a triangle without a new vertex");
        for side in [[*a, *b], [*b, *c], [*c, *a]] {
            assert!(sides.insert(side), "{side:?} twice");
        }
    }
    let mut first = 0;
    for rim in rims {
        let count = rim.len() as u32;
        for k in 0..count {
            let (a, b) = (first + k, first + (k + 1) % count);
            assert!(sides.remove(&[b, a]), "the side {a} to {b} is open");
            assert!(!sides.contains(&[a, b]));
        }
        first += count;
    }
    for [a, b] in &sides {
        assert!(sides.contains(&[*b, *a]), "{a} to {b} is a border");
        assert!((*a.max(b)) as usize >= fixed, "{a} to {b} could be an edge of the surface");
    }
}

#[test]
fn rims_of_any_shape_that_do_not_cross_themselves_are_closed_without_new_edges_between_old_vertices() {
    for seed in 0..60 {
        let mut random = fastrand::Rng::with_seed(seed);
        let count = random.usize(3..120);
        let radii: Vec<f64> = (0..count).map(|_| 0.2 + random.f64() * count as f64 / 8.0).collect();
        let rim = star(count, |k| radii[k], |p| 0.3 * p.x);
        let made = membrane(&[&rim], 1.0).unwrap_or_else(|| panic!("seed {seed}"));
        assert_closed(&[&rim], &made);
    }
}

#[test]
fn a_membrane_continues_the_plane_the_colours_and_the_intensities_of_its_rim() {
    let height = |p: DVec2| 2.0 + 0.4 * p.x - 0.2 * p.y;
    let rim = star(80, |_| 5.0, height);
    let made = membrane(&[&rim], 0.25).unwrap();
    assert!(made.vertices.len() > 800, "{}", made.vertices.len());
    let normal = DVec3::new(-0.4, 0.2, 1.0).normalize();
    for vertex in &made.vertices {
        let p = vertex.position;
        assert!((p.z - height(p.truncate())).abs() < 1e-9, "{p}");
        assert!(vertex.normal.dot(normal) > 1.0 - 1e-9);
        // A linear function is harmonic.
        assert!((f64::from(vertex.intensity) - p.x).abs() < 1e-3, "{} at {}", vertex.intensity, p.x);
        let [r, g, _] = vertex.color.unwrap();
        assert_eq!([r, g], [200, 100]);
    }
    let area: f64 = made
        .triangles
        .iter()
        .map(|t| {
            let place = |k: u32| match (k as usize).checked_sub(rim.len()) {
                Some(k) => made.vertices[k].position,
                None => rim[k as usize].position,
            };
            let [a, b, c] = t.map(place);
            (b - a).cross(c - a).z / 2.0
        })
        .sum();
    let disc = 80.0 / 2.0 * (TAU / 80.0).sin() * 25.0;
    assert!((area - disc).abs() < 1e-9, "{area}");
}

#[test]
fn islands_are_joined_and_what_lies_outside_or_crosses_is_refused() {
    let hole = star(60, |_| 6.0, |_| 0.0);
    let island = |at: DVec2, radius: f64| -> Vec<RimVertex> {
        let mut island = star(12, |_| radius, |_| 0.0);
        for vertex in &mut island {
            vertex.position += at.extend(0.1);
        }
        // The surface is inside.
        island.reverse();
        island
    };
    let inside = [island(DVec2::new(2.0, 1.0), 1.0), island(DVec2::new(-3.0, 0.0), 0.5)];
    let rims = [hole.as_slice(), &inside[0], &inside[1]];
    assert_closed(&rims, &membrane(&rims, 0.5).unwrap());
    for (at, radius) in [(9.0, 1.0), (6.0, 1.0), (0.0, 8.0)] {
        let other = island(DVec2::new(at, 0.0), radius);
        assert_eq!(membrane(&[&hole, &other], 0.5), None, "an island at {at}");
    }
    // A figure of eight, whose lobes have different sizes.
    let eight =
        (0..40).map(|k| f64::from(k) / 40.0 * TAU).map(|a| DVec3::new(a.sin() * (2.0 + a.cos()), (2.0 * a).sin(), 0.0));
    assert_eq!(membrane(&[&rim(&eight.collect::<Vec<_>>())], 0.2), None);
    assert_eq!(membrane(&[&rim(&[DVec3::ZERO, DVec3::X, DVec3::X * 2.0])], 1.0), None);
}

#[test]
fn a_collar_removes_the_jags_that_make_a_rim_cross_itself() {
    let mut random = fastrand::Rng::with_seed(5);
    // Vertices displaced by more than their distance from each other.
    let angles: Vec<f64> = (0..300).map(|k| (f64::from(k) + 4.0 * random.f64()) / 300.0 * TAU).collect();
    let rim = rim(&angles.iter().map(|a| (DVec2::from_angle(*a) * 10.0).extend(random.f64())).collect::<Vec<_>>());
    assert_eq!(membrane(&[&rim], 0.2), None);
    let smooth = collar::passes(rim.len()).map(|passes| Collar::new(&rim, passes).inner);
    let (inner, made) =
        smooth.filter_map(|inner| Some((membrane(&[&inner], 0.2)?, inner))).map(|(m, i)| (i, m)).next().unwrap();
    assert_closed(&[&inner], &made);
    let moved = rim.iter().zip(&inner).map(|(a, b)| a.position.distance(b.position)).fold(0.0, f64::max);
    assert!(moved < 1.5, "{moved}");
}

#[derive(Default)]
struct Mesh {
    places: Vec<DVec3>,
    sources: Vec<Source>,
    triangles: Vec<[u64; 3]>,
}

impl MergedSurface for Mesh {
    fn begin(&mut self, _: &Begin) -> Result<(), ScanError> {
        Ok(())
    }

    fn vertex(&mut self, vertex: &MergedVertex) -> Result<(), ScanError> {
        self.places.push(vertex.vertex.position);
        self.sources.push(vertex.source);
        Ok(())
    }

    fn triangle(&mut self, corners: [u64; 3]) -> Result<(), ScanError> {
        self.triangles.push(corners);
        Ok(())
    }
}

/// Ground of 20 × 20 cells with a pit in which one cell has not been seen.
fn ground() -> Patch {
    let mut patch = Patch::default();
    for k in 0..21 * 21_i32 {
        let (x, y) = (k % 21, k / 21);
        let deep = (x - 10).abs().max((y - 10).abs()) < 4;
        patch.vertices.push(PatchVertex {
            key: EdgeKey { at: [x, y, 0], axis: 2 },
            position: DVec3::new(f64::from(x), f64::from(y), if deep { 4.0 } else { 6.0 }),
            normal: DVec3::Z,
            color: None,
            intensity: None,
            quality: 1.0,
            stations: 1,
            variance: None,
            backing: None,
        });
    }
    patch.measured = patch.vertices.len();
    for (x, y) in (0..400).map(|k| (k % 20, k / 20)).filter(|cell| *cell != (10, 10)) {
        let a = y * 21 + x;
        patch.triangles.extend([[a, a + 1, a + 22], [a, a + 22, a + 21]]);
    }
    patch
}

#[test]
fn ground_becomes_a_body_with_a_flat_base() {
    let mut mesh = Mesh::default();
    let mut joined = Joined::new(&mut mesh, Scale { origin: DVec3::ZERO, voxel: 1.0 });
    joined.patch(IVec3::ZERO, &ground()).unwrap();
    let loops = joined.rims().loops();
    assert_eq!(loops.iter().map(Vec::len).collect::<Vec<_>>(), [80, 4]);
    let mut borders = holes::borders(&loops, &[], 2.0, &mut |_, _| Ok(())).unwrap();
    let fill = Fill { watertight: true, ..Fill::default() };
    let bounds = [DVec3::splat(-4.0), DVec3::splat(24.0)];
    let mut filler = Filler { fill: &fill, voxel: 1.0, bounds, stations: &[], joined: &mut joined };
    let filled = filler.run(&loops, &mut borders, &mut |_, _| Ok(())).unwrap();
    assert_eq!([filled.holes, filled.closed], [1, 1]);
    let sides: HashMap<[u64; 2], usize> = mesh
        .triangles
        .iter()
        .flat_map(|[a, b, c]| [[*a, *b], [*b, *c], [*c, *a]])
        .fold(HashMap::new(), |mut counts, side| {
            *counts.entry(side).or_default() += 1;
            counts
        });
    assert!(sides.iter().all(|([a, b], count)| *count == 1 && sides.contains_key(&[*b, *a])));
    let volume: f64 = mesh
        .triangles
        .iter()
        .map(|t| t.map(|k| mesh.places[k as usize]))
        .map(|[a, b, c]| a.dot(b.cross(c)) / 6.0)
        .sum();
    // 6 m of ground and 4 m below it; the pit is 2 m deep, its edges slope over one cell.
    let pit = 2.0 * (36.0 + 4.0 * 6.0 / 2.0 + 4.0 / 3.0);
    assert!((volume - (400.0 * 10.0 - pit)).abs() < 1.5, "{volume} {pit}");
    assert!(mesh.sources.contains(&Source::Closed) && mesh.sources.contains(&Source::Diffused));
}

#[test]
fn the_base_is_flat_below_an_outline_that_is_not_convex_and_has_short_sides() {
    let mut mesh = Mesh::default();
    let mut joined = Joined::new(&mut mesh, Scale { origin: DVec3::ZERO, voxel: 0.1 });
    // Each vertex twice, 2 mm apart, on an outline 1.2 km long.
    let radius = |k: usize| if k / 2 % 8 < 4 { 100.0 } else { 60.0 };
    let angle = |k: usize| (k / 2) as f64 / 200.0 * TAU + (k % 2) as f64 * 2e-5;
    let outline = (0..400).map(|k| (DVec2::from_angle(angle(k)) * radius(k)).extend(6.0 + (k as f64).sin()));
    let mut rim: Vec<RimVertex> = rim(&outline.collect::<Vec<_>>());
    // The ground is inside.
    rim.reverse();
    for vertex in &mut rim {
        let RimVertex { position, normal, color, intensity, .. } = *vertex;
        let vertex_of = crate::mesh::MeshVertex { position, normal, color, intensity, confidence: 1.0 };
        let merged = MergedVertex { vertex: vertex_of, stations: 1, registration: None, source: Source::Scans };
        vertex.number = joined.vertex(&merged).unwrap();
    }
    let bounds = [DVec3::splat(-200.0).with_z(0.0), DVec3::splat(200.0)];
    let fill = Fill { watertight: true, ..Fill::default() };
    Filler { fill: &fill, voxel: 0.1, bounds, stations: &[], joined: &mut joined }.base(&rim).unwrap();
    let places = |t: &[u64; 3]| t.map(|k| mesh.places[k as usize]);
    let floor: Vec<f64> = mesh
        .triangles
        .iter()
        .map(places)
        .filter(|t| t.iter().all(|p| p.z == 0.0))
        .map(|[a, b, c]| (b - a).cross(c - a).z / 2.0)
        .collect();
    assert!(floor.iter().all(|area| *area < 0.0), "a triangle of the floor faces up");
    let flat =
        rim.iter().zip(rim.iter().cycle().skip(1)).map(|(a, b)| a.position.truncate().perp_dot(b.position.truncate()));
    let area = flat.sum::<f64>() / 2.0;
    assert!((floor.iter().sum::<f64>() + area).abs() < 1e-6 * area, "{area}");
}
