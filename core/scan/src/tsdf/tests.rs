//! Surfaces that are known, cut into pieces and merged.

use super::*;
use glam::{DVec3, IVec3};
use std::collections::{BTreeMap, HashMap};

type Triangles = Vec<[DVec3; 3]>;

fn corner(position: DVec3) -> Corner {
    Corner { position, color: Some([200, 100, 50]), intensity: Some(0.5), quality: 25.0 }
}

const EVERYWHERE: [DVec3; 2] = [DVec3::NEG_INFINITY, DVec3::INFINITY];
/// Best quality: as of [`corner`].
const BEST: f64 = 25.0;

/// A sphere of triangles with edges of about `edge`, facing outside.
fn sphere(center: DVec3, radius: f64, edge: f64) -> Triangles {
    let steps = (std::f64::consts::PI * radius / edge).ceil() as i32;
    let at = |i: i32, j: i32| {
        let (a, e) = (f64::from(j), f64::from(i) - f64::from(steps) / 2.0);
        let (a, e) = (a * std::f64::consts::PI / f64::from(steps), e * std::f64::consts::PI / f64::from(steps));
        center + DVec3::new(e.cos() * a.cos(), e.cos() * a.sin(), e.sin()) * radius
    };
    let cells = (0..steps).flat_map(|i| (0..2 * steps).map(move |j| (i, j)));
    cells
        .flat_map(|(i, j)| {
            let (p, q, r, s) = (at(i, j), at(i, j + 1), at(i + 1, j + 1), at(i + 1, j));
            [[p, q, r], [p, r, s]]
        })
        .collect()
}

/// A rectangle from `origin` along `u` and `v`, facing `u × v`.
fn rectangle(origin: DVec3, u: DVec3, v: DVec3, edge: f64) -> Triangles {
    let (m, n) = ((u.length() / edge).ceil() as i32, (v.length() / edge).ceil() as i32);
    let at = |i: i32, j: i32| origin + u * (f64::from(i) / f64::from(m)) + v * (f64::from(j) / f64::from(n));
    let cells = (0..m).flat_map(|i| (0..n).map(move |j| (i, j)));
    cells
        .flat_map(|(i, j)| {
            let (p, q, r, s) = (at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1));
            [[p, q, r], [p, r, s]]
        })
        .collect()
}

fn cut(triangles: &Triangles) -> Vec<Piece> {
    let mut out = Vec::new();
    for triangle in triangles {
        pieces(&triangle.map(corner), BEST, EVERYWHERE, &mut |piece| out.push(piece));
    }
    out
}

/// The joined patches of regions of `region` bricks that fill a cube of `bricks`.
struct Surface {
    vertices: BTreeMap<EdgeKey, PatchVertex>,
    triangles: Vec<[EdgeKey; 3]>,
}

fn surface(stations: &[Vec<Piece>], bricks: i32, region: i32) -> Surface {
    surface_of(stations, &[], bricks, region)
}

/// The same for stations with the uncertainties `sigmas`.
fn surface_of(stations: &[Vec<Piece>], sigmas: &[Sigma], bricks: i32, region: i32) -> Surface {
    let cubes = Cubes::default();
    let mut out = Surface { vertices: BTreeMap::new(), triangles: Vec::new() };
    let grid = |n: i32| (0..n * n * n).map(move |k| IVec3::new(k % n, k / n % n, k / (n * n)));
    for first in grid(bricks / region) {
        let own = Region { min: first * region, bricks: region };
        let mut field = Field::new(own);
        for (number, pieces) in stations.iter().enumerate() {
            pieces
                .iter()
                .filter(|piece| own.needs(piece, MARGIN))
                .for_each(|piece| field.add(number as u16 + 1, piece, sigmas.get(number).copied()));
        }
        for brick in grid(region) {
            let Some(patch) = field.patch(&cubes, own.min + brick, None) else { continue };
            for vertex in &patch.vertices {
                let before = out.vertices.insert(vertex.key, *vertex);
                assert!(before.is_none_or(|before| before == *vertex), "a vertex differs between bricks");
            }
            out.triangles.extend(patch.triangles.iter().map(|t| t.map(|k| patch.vertices[k as usize].key)));
        }
    }
    out.triangles.sort_unstable();
    out
}

impl Surface {
    /// The number of edges by their number of triangles; panics unless neighbours have the same orientation.
    fn edges(&self) -> BTreeMap<usize, usize> {
        let mut edges: HashMap<[EdgeKey; 2], Vec<bool>> = HashMap::new();
        for [a, b, c] in &self.triangles {
            for [p, q] in [[*a, *b], [*b, *c], [*c, *a]] {
                edges.entry([p.min(q), p.max(q)]).or_default().push(p < q);
            }
        }
        let mut counts = BTreeMap::new();
        for sides in edges.values() {
            assert!(sides.len() != 2 || sides[0] != sides[1], "neighbours face different ways");
            *counts.entry(sides.len()).or_default() += 1;
        }
        counts
    }

    fn positions(&self) -> impl Iterator<Item = DVec3> {
        self.vertices.values().map(|v| v.position)
    }

    fn facing(&self) -> impl Iterator<Item = (DVec3, DVec3)> {
        self.triangles.iter().map(|t| {
            let [a, b, c] = t.map(|key| self.vertices[&key].position);
            ((a + b + c) / 3.0, (b - a).cross(c - a))
        })
    }
}

#[test]
fn a_sphere_comes_back_closed_and_in_its_place() {
    let center = DVec3::new(20.3, 21.1, 19.7);
    for edge in [0.3, 0.8, 2.5] {
        let merged = surface(&[cut(&sphere(center, 12.0, edge))], 5, 5);
        assert!(merged.triangles.len() > 2000);
        assert_eq!(merged.edges().into_keys().collect::<Vec<_>>(), [2], "edges of {edge}");
        let off = merged.positions().map(|p| (p.distance(center) - 12.0).abs()).fold(0.0, f64::max);
        assert!(off < 0.12, "edges of {edge}: {off} voxels off");
        assert!(merged.facing().all(|(at, normal)| normal.dot(at - center) > 0.0));
        for vertex in merged.vertices.values() {
            assert_eq!((vertex.color, vertex.stations), (Some([200, 100, 50]), 1));
            assert!((vertex.intensity.unwrap() - 0.5).abs() < 1e-3);
            assert!(vertex.normal.dot((vertex.position - center).normalize()) > 0.97);
        }
    }
}

#[test]
fn the_surface_does_not_depend_on_regions_or_on_the_order_of_pieces() {
    let shell = |k: f64| cut(&sphere(DVec3::new(15.0 + k, 16.2, 15.5), 11.0, 0.7));
    let stations = [shell(0.0), shell(0.4), shell(-0.3)];
    let whole = surface(&stations, 4, 4);
    let mut turned: Vec<Vec<Piece>> = stations.to_vec();
    turned.reverse();
    for pieces in &mut turned {
        pieces.reverse();
    }
    for (stations, region) in [(&stations[..], 2), (&stations[..], 1), (&turned[..], 4), (&turned[..], 2)] {
        let other = surface(stations, 4, region);
        assert_eq!(whole.triangles, other.triangles);
        assert!(whole.vertices == other.vertices);
    }
}

#[test]
fn pose_variances_are_averaged_and_range_noise_averages_out_over_stations() {
    let wall = |from: f64| cut(&rectangle(DVec3::new(from, 12.3, 3.0), DVec3::X * 17.0, DVec3::Z * 26.0, 0.6));
    // Side by side, overlapping by 8 voxels.
    let stations = [wall(3.0), wall(12.0)];
    let poses = [1e-3_f64, 4e-3].map(|sigma| sigma * sigma);
    let ranges = [3e-3, 2e-3];
    let sigmas = [0, 1].map(|k| Sigma::new(poses[k], ranges[k]));
    let merged = surface_of(&stations, &sigmas, 4, 4);
    let bare = surface(&stations, 4, 4);
    assert_eq!(merged.triangles, bare.triangles);
    let mut both = 0;
    for (vertex, bare) in merged.vertices.values().zip(bare.vertices.values()) {
        assert_eq!(PatchVertex { variance: None, ..*vertex }, *bare);
        let Variance { pose, range } = vertex.variance.unwrap();
        let is_near = |a: f64, b: f64| (a / b - 1.0).abs() < 1e-6;
        let x = vertex.position.x;
        if x < 9.0 {
            assert!(is_near(pose, poses[0]) && is_near(range, ranges[0].powi(2)), "{vertex:?}");
        } else if x > 23.0 {
            assert!(is_near(pose, poses[1]) && is_near(range, ranges[1].powi(2)), "{vertex:?}");
        } else if x > 14.0 && x < 18.0 && vertex.position.z > 6.0 && vertex.position.z < 26.0 {
            // The variance of the poses gives the weight share of the first station, from which that of the ranges follows.
            let share = (poses[1] - pose) / (poses[1] - poses[0]);
            assert!((0.3..0.7).contains(&share), "{vertex:?}");
            let wanted = (share * ranges[0]).powi(2) + ((1.0 - share) * ranges[1]).powi(2);
            // Between two voxels the variances are averaged, not the shares.
            assert!((range / wanted - 1.0).abs() < 0.02, "{share}: {range} {wanted}");
            both += 1;
        }
    }
    assert!(both > 50, "{both}");
    let [turned, uncertain] = [[stations[1].clone(), stations[0].clone()], [stations[0].clone(), stations[1].clone()]]
        .map(|mut stations| {
            for pieces in &mut stations {
                pieces.reverse();
            }
            stations
        });
    for region in [1, 2] {
        assert!(surface_of(&turned, &[sigmas[1], sigmas[0]], 4, region).vertices == merged.vertices);
        assert!(surface_of(&uncertain, &sigmas, 4, region).vertices == merged.vertices);
    }
    // NaN counts as the maximum.
    assert_eq!(Sigma::new(f64::NAN, f64::INFINITY), Sigma::new(1e9, 1e9));
}

#[test]
fn both_faces_of_a_thin_wall_are_kept() {
    for thickness in [1.5, 3.0, 10.0] {
        let y = 12.4;
        let front = rectangle(DVec3::new(3.0, y, 3.0), DVec3::X * 26.0, DVec3::Z * 26.0, 0.6);
        let back = rectangle(DVec3::new(3.0, y + thickness, 3.0), DVec3::Z * 26.0, DVec3::X * 26.0, 0.6);
        let merged = surface(&[cut(&front), cut(&back)], 4, 4);
        let inner = |p: DVec3| p.x > 5.0 && p.x < 27.0 && p.z > 5.0 && p.z < 27.0;
        let area = |is_front: bool| {
            let own = merged.facing().filter(|(at, normal)| inner(*at) && (normal.y < 0.0) == is_front);
            own.map(|(_, normal)| normal.length() / 2.0).sum::<f64>()
        };
        for is_front in [true, false] {
            assert!((area(is_front) / (22.0 * 22.0) - 1.0).abs() < 0.05, "{thickness}: {}", area(is_front));
        }
        for (at, normal) in merged.facing().filter(|(at, _)| inner(*at)) {
            let wanted = if normal.y < 0.0 { y } else { y + thickness };
            assert!((at.y - wanted).abs() < 0.25, "{thickness}: {}", at.y - wanted);
        }
    }
}

#[test]
fn two_layers_of_one_surface_leave_no_surface_between_them_that_faces_inside() {
    let layer = |y: f64| cut(&rectangle(DVec3::new(3.0, y, 3.0), DVec3::X * 26.0, DVec3::Z * 26.0, 0.6));
    for apart in [0.3, 1.0, 2.5, 3.5] {
        let merged = surface(&[layer(12.0), layer(12.0 + apart)], 4, 4);
        assert!(merged.triangles.len() > 1000);
        assert!(merged.facing().all(|(_, normal)| normal.y < 0.0), "{apart}");
    }
}

#[test]
fn a_coarse_and_oblique_view_yields_to_a_fine_one() {
    let at = |y: f64, edge: f64| rectangle(DVec3::new(3.0, y, 3.0), DVec3::X * 26.0, DVec3::Z * 26.0, edge);
    let merged = surface(&[cut(&at(12.0, 0.3)), cut(&at(12.8, 6.0))], 4, 4);
    let middle = merged.positions().filter(|p| p.x > 8.0 && p.x < 24.0 && p.z > 8.0 && p.z < 24.0);
    let off = middle.map(|p| (p.y - 12.0).abs()).fold(0.0, f64::max);
    assert!(off < 0.08, "{off}");
    assert!(merged.vertices.values().any(|v| v.stations == 2));
}

#[test]
fn a_surface_ends_where_its_triangles_end() {
    let merged = surface(&[cut(&rectangle(DVec3::new(4.0, 12.3, 4.0), DVec3::X * 20.0, DVec3::Z * 20.0, 0.5))], 4, 4);
    for p in merged.positions() {
        assert!(p.x > 3.2 && p.x < 24.8 && p.z > 3.2 && p.z < 24.8, "{p}");
    }
    assert!(merged.edges().keys().all(|count| *count <= 2));
}

#[test]
fn the_area_of_pieces_is_that_of_the_triangles() {
    for edge in [0.2, 0.9, 1.7, 4.0] {
        let triangles = sphere(DVec3::splat(30.0), 14.0, edge);
        let area: f64 = triangles.iter().map(|[a, b, c]| (*b - *a).cross(*c - *a).length() / 2.0).sum();
        let pieces: f64 = cut(&triangles).iter().map(|piece| f64::from(piece.area) / Piece::AREA_ONE).sum();
        assert!((pieces / area - 1.0).abs() < 0.02, "{edge}: {pieces} of {area}");
    }
}

#[test]
fn a_piece_survives_its_bytes() {
    for piece in cut(&sphere(DVec3::splat(-20.0), 3.0, 1.0)) {
        assert_eq!(Piece::from_bytes(&piece.to_bytes()), piece);
    }
}

/// The patches of one region, with and without a backing.
fn patches(pieces: &[Piece], mesh: &[Piece], bricks: i32, levels: u32) -> [Vec<Patch>; 2] {
    let own = Region { min: IVec3::ZERO, bricks };
    let mut field = Field::new(own);
    let mut backing = Backing::new(own, !mesh.is_empty(), levels, mesh.is_empty());
    for piece in pieces {
        field.add(1, piece, None);
        backing.add(1, piece);
    }
    for piece in mesh {
        backing.add_mesh(piece);
    }
    let cubes = Cubes::default();
    [None, Some(&backing)].map(|backing| {
        let all = (0..bricks.pow(3)).map(|k| IVec3::new(k % bricks, k / bricks % bricks, k / (bricks * bricks)));
        all.filter_map(|brick| field.patch(&cubes, brick, backing)).collect()
    })
}

/// Edges of all triangles that have no triangle on their other side, and the middle of each.
fn open_edges(patches: &[Patch], with_filled: bool) -> Vec<DVec3> {
    let mut edges = HashMap::new();
    for patch in patches {
        let filled = if with_filled { patch.filled.as_slice() } else { &[] };
        for t in patch.triangles.iter().chain(filled) {
            for [a, b] in [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]] {
                let [a, b] = [a, b].map(|k| &patch.vertices[k as usize]);
                let before = edges.insert([a.key, b.key], (a.position + b.position) / 2.0);
                assert_eq!(before, None, "an edge is used twice in the same direction");
            }
        }
    }
    let is_open = |[a, b]: &[EdgeKey; 2]| !edges.contains_key(&[*b, *a]);
    edges.iter().filter(|(edge, _)| is_open(edge)).map(|(_, middle)| *middle).collect()
}

/// A plane of 56 × 56 voxels with a hole of this width in the middle.
fn holed(width: f64) -> Vec<Piece> {
    let (low, high) = (28.0 - width / 2.0, 28.0 + width / 2.0);
    let part = |x: [f64; 2], y: [f64; 2]| {
        let origin = DVec3::new(x[0], y[0], 28.3);
        cut(&rectangle(origin, DVec3::X * (x[1] - x[0]), DVec3::Y * (y[1] - y[0]), 0.7))
    };
    let all = [
        part([4.0, low], [4.0, 52.0]),
        part([high, 52.0], [4.0, 52.0]),
        part([low, high], [4.0, low]),
        part([low, high], [high, 52.0]),
    ];
    all.concat()
}

#[test]
fn coarser_voxels_close_narrow_holes_and_leave_the_measured_surface_as_it_is() {
    let is_inside = |p: &&DVec3| (*p - DVec3::new(28.0, 28.0, 28.3)).abs().max_element() < 18.0;
    for (width, closes) in [(3.0, true), (7.0, true), (12.0, true), (26.0, false)] {
        let [bare, backed] = patches(&holed(width), &[], 7, 3);
        let measured = |patches: &[Patch]| -> Vec<(Vec<PatchVertex>, Vec<[u32; 3]>)> {
            let with = patches.iter().filter(|patch| !patch.triangles.is_empty());
            with.map(|patch| (patch.vertices[..patch.measured].to_vec(), patch.triangles.clone())).collect()
        };
        assert!(measured(&bare) == measured(&backed), "width {width}");
        assert!(bare.iter().all(|patch| patch.filled.is_empty()));
        let rim = open_edges(&bare, false).iter().filter(is_inside).count();
        assert!(rim > 3 * width as usize, "{rim} at {width}");
        let left = open_edges(&backed, true).iter().filter(is_inside).count();
        assert_eq!(left == 0, closes, "{left} of {rim} edges are open at {width}");
        for patch in &backed {
            for corners in &patch.filled {
                assert!(corners.iter().any(|k| *k as usize >= patch.measured), "a triangle without a new vertex");
                for k in corners {
                    let vertex = &patch.vertices[*k as usize];
                    assert!((vertex.position.z - 28.3).abs() < 0.5, "{vertex:?}");
                    assert_eq!(vertex.color, Some([200, 100, 50]));
                }
            }
        }
    }
}

#[test]
fn a_mesh_fills_what_scans_left_open_and_adds_no_second_layer() {
    // A mesh of the whole plane, three voxels too high, and a hole too wide for coarser voxels.
    let mesh = cut(&rectangle(DVec3::new(4.0, 4.0, 31.3), DVec3::X * 48.0, DVec3::Y * 48.0, 0.7));
    let [_, backed] = patches(&holed(24.0), &mesh, 7, 3);
    let filled: Vec<DVec3> = backed
        .iter()
        .flat_map(|patch| patch.filled.iter().map(|t| t.map(|k| patch.vertices[k as usize].position)))
        .map(|[a, b, c]| (a + b + c) / 3.0)
        .collect();
    let from_middle = |p: &DVec3| (p.truncate() - glam::DVec2::splat(28.0)).abs().max_element();
    assert!(filled.iter().any(|p| from_middle(p) < 2.0), "the hole is empty");
    let farthest = filled.iter().filter(|p| from_middle(p) < 20.0).map(from_middle).fold(0.0, f64::max);
    assert!(farthest < 12.0 + 8.0, "{farthest}");
}

#[test]
fn coarser_voxels_do_not_mix_the_two_faces_of_a_wall() {
    // Faces 3 voxels apart, each with a hole.
    let (front, mut back) = (holed(5.0), holed(5.0));
    for piece in &mut back {
        piece.at.z -= 3 << SUB_LOG2;
        piece.normal = piece.normal.map(|n| -n);
    }
    let [_, backed] = patches(&[front, back].concat(), &[], 7, 3);
    for patch in &backed {
        for k in patch.filled.iter().flatten() {
            let z = patch.vertices[*k as usize].position.z;
            assert!((z - 28.3).abs() < 0.6 || (z - 25.3).abs() < 0.6, "{z}");
        }
    }
}
