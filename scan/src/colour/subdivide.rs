//! Splits triangles of the finest surface where photographs show more than its vertices can hold.
//!
//! First each photograph notes, for every triangle of which it sees a corner, how many of its pixels each edge spans ([`Subdivision::note`]); then the triangles of
//! a chunk are split so that no edge spans more pixels than asked for ([`Subdivision::apply`]). Whether an edge is split depends on the edge alone ([`Detail`]), so no crack
//! opens between triangles or chunks. New vertices lie in the middle of an edge, rounded to the lattice of the model.

use super::observe::GRAZING;
use super::picture::Photograph;
use super::vertices::finest;
use super::view::View;
use super::{Input, LeftOut, Placed, Placing, VIEW_BYTES};
use crate::ScanError;
use crate::import::Progress;
use glam::{DVec3, IVec3, Vec3};
use kilwa_formats::read::texture::detail::{Detail, Vertex, split};
use kilwa_geometry::color::{light_from_srgb, srgb_from_light};
use kilwa_geometry::normal::{self, OctNormal};
use kilwa_geometry::{Lattice, LatticePoint, Mesh};
use kilwa_pack::{Chunk, NO_DIAMOND, PatchRange, Source};
use rayon::prelude::*;
use std::collections::HashMap;
use std::sync::atomic::{AtomicU8, AtomicU64, Ordering};

/// Edges are not split into parts shorter than this, in steps of the lattice: rounding must not fold the surface, and a single photograph from nearby must not
/// fill the memory.
const SHORTEST: i64 = 16;
/// Channels whose values count or name something: their mean would mean nothing.
const LABELS: [&str; 7] = ["filled", "source", "stations", "photos", "classification", "class", "label"];
/// A chunk is split into this many triangles at most, so that the memory that it takes is bounded.
const MAX_TRIANGLES: usize = 1 << 21;

/// Find out how far triangles are to be split, and where the photographs were taken. The depth maps of as many photographs as an eighth of the memory holds are kept at a time, so
/// that each chunk is decoded once for all of them.
///
/// # Errors
/// [`ScanError::Model`] if a chunk is damaged; [`ScanError::Stopped`].
pub(super) fn note_all<S: Source + Sync>(
    placing: &Placing<'_, S>,
    inputs: &[Input],
    pixels: f64,
    progress: &(dyn Progress + Sync),
) -> Result<(Subdivision, Vec<Result<Placed, LeftOut>>), ScanError> {
    let reader = placing.model.reader();
    let lattice = &reader.header().lattice;
    let metadata = reader.metadata();
    let channels = metadata.scalars.iter().map(|channel| channel.name.as_str());
    let subdivision = Subdivision::new(pixels, channels, metadata.triangles * 3 / 2);
    let at_once = (placing.options.memory / 8 / VIEW_BYTES).clamp(1, inputs.len().max(1) as u64) as usize;
    let count = AtomicU64::new(0);
    let done = || {
        let count = count.fetch_add(1, Ordering::Relaxed) + 1;
        progress.update("finding what the photographs resolve", count, inputs.len() as u64);
    };
    let process = |number: u32, input: &Input| {
        // What cannot be read must not split triangles.
        let placed = match Photograph::read(&input.path, input.camera.camera.size(), input.mask.as_deref()) {
            Ok(picture) => placing.placed(number, input, &picture)?,
            Err(why) => Err(why.into()),
        };
        Ok(match placed {
            Ok(placed) => Ok((View::new(placing.model, placed.camera)?, placed)),
            Err(why) => Err(why),
        })
    };
    let numbered: Vec<(u32, &Input)> = (0u32..).zip(inputs).collect();
    let mut all = Vec::new();
    for several in numbered.chunks(at_once) {
        let found = placing.each(several, progress, done, process)?;
        let views: Vec<&View> = found.iter().filter_map(|found| Some(&found.as_ref().ok()?.0)).collect();
        (0u32..).zip(reader.entries()).collect::<Vec<_>>().into_par_iter().try_for_each(|(number, entry)| {
            if progress.is_stopped() {
                return Err(ScanError::Stopped);
            }
            let center = lattice.world_from_steps(entry.sphere.center);
            let radius = entry.sphere.radius * lattice.step();
            let mut views = views.iter().filter(|view| view.may_show(center, radius)).peekable();
            if views.peek().is_some() {
                let chunk = reader.chunk(number).map_err(|source| ScanError::Model { source })?;
                for view in views {
                    subdivision.note(&chunk, lattice, view);
                }
            }
            Ok(())
        })?;
        all.extend(found.into_iter().map(|found| found.map(|(_, placed)| placed)));
    }
    Ok((subdivision, all))
}

/// How far triangles are split.
pub(super) struct Subdivision {
    detail: Detail,
    /// For each channel of the model, whether its values are labels.
    is_label: Vec<bool>,
    deepest: AtomicU8,
}

impl Subdivision {
    /// No edge is to span more than `pixels`; `channels` are the names of the scalars of the model, which has about so many edges.
    pub(super) fn new<'n>(pixels: f64, channels: impl Iterator<Item = &'n str>, edges: u64) -> Self {
        let is_label = |name: &str| LABELS.contains(&name.trim_start_matches("scalar_").to_ascii_lowercase().as_str());
        let is_label = channels.map(is_label).collect();
        Self { detail: Detail::for_edges(pixels, edges), is_label, deepest: AtomicU8::new(0) }
    }

    /// Note what a photograph shows of the finest triangles of a chunk.
    pub(super) fn note(&self, chunk: &Chunk, lattice: &Lattice, view: &View) {
        let mesh = &chunk.mesh;
        let mut seen = vec![None; mesh.positions.len()];
        for k in finest(mesh, &chunk.patches) {
            let k = k as usize;
            seen[k] = pixel_angle(view, lattice, mesh.positions[k], mesh.normals[k]);
        }
        let eye = view.camera().position();
        for triangle in finest_triangles(chunk) {
            let corners = mesh.triangles[triangle].map(|k| k as usize);
            // The finest pixels that show a corner.
            let Some(pixel) = corners.iter().filter_map(|k| seen[*k]).reduce(f64::min) else { continue };
            let edges = [[0, 1], [1, 2], [2, 0]].map(|edge| edge.map(|k| mesh.positions[corners[k]]));
            let length = |[a, b]: [LatticePoint; 2]| a.as_dvec3().distance(b.as_dvec3()).max(1.0);
            let span = |edge: [LatticePoint; 2]| {
                let [a, b] = edge.map(|end| lattice.world_from_lattice(end) - eye);
                libm::atan2(a.cross(b).length(), a.dot(b)) / pixel
            };
            let density = edges.iter().map(|edge| span(*edge) / length(*edge)).fold(0.0, f64::max);
            // The same density for all edges: else an edge that is not split would meet parts that get ever thinner.
            for edge in edges {
                let [from, to] = edge.map(LatticePoint::as_dvec3);
                self.detail.note(from, to, density * length(edge));
            }
        }
    }

    /// Split the finest triangles of a chunk.
    ///
    /// # Errors
    /// [`ScanError::Request`] if there would be more than 2,097,152 of them.
    pub(super) fn apply(&self, chunk: &mut Chunk) -> Result<(), ScanError> {
        let patches = std::mem::take(&mut chunk.patches);
        let mut splitting = Splitting {
            subdivision: self,
            mesh: &mut chunk.mesh,
            made: HashMap::new(),
            triangles: Vec::new(),
            borders: Vec::new(),
        };
        chunk.patches = patches.into_iter().map(|patch| splitting.patch(patch)).collect::<Result<_, _>>()?;
        let Splitting { triangles, borders, .. } = splitting;
        (chunk.mesh.triangles, chunk.mesh.borders) = (triangles, borders);
        Ok(())
    }

    /// How often any edge was halved so far.
    pub(super) fn deepest(&self) -> u8 {
        self.deepest.load(Ordering::Relaxed)
    }
}

/// The numbers of the triangles of the finest surface.
pub(super) fn finest_triangles(chunk: &Chunk) -> impl Iterator<Item = usize> {
    let finest = chunk.patches.iter().filter(|patch| patch.diamond == NO_DIAMOND);
    finest.flat_map(|patch| patch.first as usize..(patch.first + patch.count) as usize)
}

/// The angle of a pixel of a photograph where it shows a vertex, radians, if it shows it well enough to colour it.
fn pixel_angle(view: &View, lattice: &Lattice, position: LatticePoint, normal: OctNormal) -> Option<f64> {
    let place = lattice.world_from_lattice(position);
    view.sighting(place, normal::decode(normal), lattice.step()).filter(|sighting| sighting.facing > GRAZING)?;
    let camera = view.camera();
    let point = camera.camera_from_world.apply(place);
    camera.camera.project(point).filter(|pixel| camera.camera.contains(*pixel) || camera.camera.is_full_turn())?;
    camera.camera.pixel_angle(point)
}

/// A vertex of a part of a triangle.
#[derive(Clone, Copy)]
struct Corner {
    position: LatticePoint,
    /// The weights of the corners of the triangle: multiples of a power of two, so that they are exact.
    weights: Vec3,
}

impl Vertex for Corner {
    fn position(&self) -> DVec3 {
        self.position.as_dvec3()
    }

    fn between(&self, other: &Self) -> Self {
        // The mean, rounded down, without overflow (Warren, "Hacker's delight", 2-5).
        let mean = |a: i32, b: i32| (a & b) + ((a ^ b) >> 1);
        let [a, b] = [self.position, other.position];
        let position = IVec3::new(mean(a.x, b.x), mean(a.y, b.y), mean(a.z, b.z));
        Self { position, weights: 0.5 * (self.weights + other.weights) }
    }

    fn most_halvings(&self, other: &Self) -> u8 {
        let length = (self.position.as_i64vec3() - other.position.as_i64vec3()).abs().max_element();
        (length / SHORTEST).checked_ilog2().map_or(0, |halvings| halvings as u8)
    }
}

/// A chunk whose triangles are being split.
struct Splitting<'a> {
    subdivision: &'a Subdivision,
    mesh: &'a mut Mesh,
    /// New vertices, by their place and the ends of the edge or the triangle that they lie on: vertices at the same place may differ in their attributes.
    made: HashMap<(LatticePoint, [u32; 2]), u32>,
    triangles: Vec<[u32; 3]>,
    borders: Vec<u8>,
}

impl Splitting<'_> {
    fn patch(&mut self, patch: PatchRange) -> Result<PatchRange, ScanError> {
        let first = self.triangles.len() as u32;
        for triangle in patch.first..patch.first + patch.count {
            if patch.diamond == NO_DIAMOND {
                self.triangle(triangle)?;
            } else {
                self.triangles.push(self.mesh.triangles[triangle as usize]);
                self.borders.push(self.mesh.borders[triangle as usize]);
            }
        }
        Ok(PatchRange { first, count: self.triangles.len() as u32 - first, ..patch })
    }

    fn triangle(&mut self, number: u32) -> Result<(), ScanError> {
        let corners = self.mesh.triangles[number as usize];
        let borders = self.mesh.borders[number as usize];
        let all = [Vec3::X, Vec3::Y, Vec3::Z];
        let places: [Corner; 3] =
            std::array::from_fn(|k| Corner { position: self.mesh.positions[corners[k] as usize], weights: all[k] });
        let detail = &self.subdivision.detail;
        let (density, deepest) = pixels_per_step(detail, &places);
        self.subdivision.deepest.fetch_max(deepest, Ordering::Relaxed);
        let pixels = |a: &Corner, b: &Corner| density * a.position().distance(b.position());
        let mut parts = Vec::new();
        let room = MAX_TRIANGLES.saturating_sub(self.triangles.len());
        split(detail, places, pixels, |part| {
            if parts.len() >= room {
                return Err(ScanError::Request(format!(
                    "with --texture-detail {}, a chunk of the model would be split into more than {MAX_TRIANGLES} triangles; give a larger number of pixels",
                    detail.texels()
                )));
            }
            parts.push(part);
            Ok(())
        })?;
        for part in parts {
            let numbers = part.map(|corner| self.vertex(&corner, corners, number));
            if (0..3).any(|k| numbers[k] == numbers[(k + 1) % 3]) {
                // Two vertices inside a triangle were rounded to the same place.
                continue;
            }
            self.triangles.push(numbers);
            let is_border = |k: usize| {
                // The edge of the triangle on which both ends lie.
                let edge =
                    (0..3).find(|edge| [k, (k + 1) % 3].iter().all(|end| part[*end].weights[(edge + 2) % 3] == 0.0));
                edge.is_some_and(|edge| borders >> edge & 1 == 1)
            };
            self.borders.push((0..3).map(|k| u8::from(is_border(k)) << k).sum());
        }
        Ok(())
    }

    /// The number of a vertex of a part of a triangle.
    fn vertex(&mut self, corner: &Corner, corners: [u32; 3], triangle: u32) -> u32 {
        let weights = corner.weights.to_array();
        let of: Vec<(u32, f32)> = corners.into_iter().zip(weights).filter(|(_, weight)| *weight > 0.0).collect();
        let on = match *of {
            [(vertex, _)] => return vertex,
            [(a, _), (b, _)] => [a.min(b), a.max(b)],
            _ => [u32::MAX, triangle],
        };
        if let Some(number) = self.made.get(&(corner.position, on)) {
            return *number;
        }
        let number = self.mesh.positions.len() as u32;
        self.mesh.positions.push(corner.position);
        add_attributes(self.mesh, &self.subdivision.is_label, &of);
        self.made.insert((corner.position, on), number);
        number
    }
}

/// Pixels that a step of the lattice spans where a triangle lies, about: the most with which its edges, halved as often as they are to be, are short enough.
/// With more, splitting would not come to an end. Also the largest number of halvings.
fn pixels_per_step(detail: &Detail, corners: &[Corner; 3]) -> (f64, u8) {
    let of_edge = |k: usize| {
        let (a, b) = (&corners[k], &corners[(k + 1) % 3]);
        let level = detail.level(a.position(), b.position()).min(a.most_halvings(b));
        (detail.texels() * f64::from(level).exp2() / a.position().distance(b.position()).max(1.0), level)
    };
    let edges = [0, 1, 2].map(of_edge);
    let least = edges.iter().map(|(density, _)| *density).fold(f64::INFINITY, f64::min);
    (least, edges.iter().map(|(_, level)| *level).max().unwrap_or(0))
}

/// Add the attributes of a new vertex: the means of those of the vertices `of`, with their weights.
fn add_attributes(mesh: &mut Mesh, is_label: &[bool], of: &[(u32, f32)]) {
    if !mesh.colors.is_empty() {
        let light = |channel: usize| {
            of.iter().map(|(k, w)| f64::from(*w) * light_from_srgb(mesh.colors[*k as usize][channel])).sum()
        };
        let color = [0, 1, 2].map(|channel| srgb_from_light(light(channel)));
        mesh.colors.push(color);
    }
    let sum: DVec3 = of.iter().map(|(k, w)| f64::from(*w) * normal::decode(mesh.normals[*k as usize])).sum();
    // Opposite normals have no mean; neighbouring triangles must choose the same one.
    let any = of.iter().map(|(k, _)| mesh.normals[*k as usize]).min().unwrap_or_default();
    mesh.normals.push(sum.try_normalize().map_or(any, normal::encode));
    for (channel, is_label) in mesh.scalars.iter_mut().zip(is_label) {
        let values = of.iter().map(|(k, w)| (channel[*k as usize], *w));
        let value = if *is_label {
            let nearest = values.max_by(|a, b| a.1.total_cmp(&b.1).then(a.0.total_cmp(&b.0)));
            nearest.map_or(f32::NAN, |(value, _)| value)
        } else {
            values.map(|(value, weight)| value * weight).sum()
        };
        channel.push(value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    /// A bumpy square of two chunks that meet in the middle; its rim is the border of the scan.
    fn chunks(random: &mut fastrand::Rng) -> [Chunk; 2] {
        const N: i32 = 6;
        let place = |i: i32, j: i32, random: &mut fastrand::Rng| {
            IVec3::new(i * 97 - 200, j * 83 - 300, 0)
                + IVec3::new(random.i32(-20..20), random.i32(-20..20), random.i32(-40..40))
        };
        let grid: Vec<IVec3> =
            (0..(2 * N + 1) * (N + 1)).map(|k| place(k % (2 * N + 1), k / (2 * N + 1), random)).collect();
        [0, N].map(|left| {
            let number = |i: i32, j: i32| (j * (N + 1) + i - left) as u32;
            let mut mesh = Mesh { scalars: vec![Vec::new(); 2], ..Mesh::default() };
            for (j, i) in (0..=N).flat_map(|j| (left..=left + N).map(move |i| (j, i))) {
                let at = grid[(j * (2 * N + 1) + i) as usize];
                mesh.positions.push(at);
                mesh.colors.push([at.x, at.y, at.z].map(|c| c.rem_euclid(256) as u8));
                mesh.normals.push(normal::encode(at.as_dvec3().with_z(400.0).normalize()));
                mesh.scalars[0].push((at.x & 15) as f32);
                mesh.scalars[1].push((at.y & 1) as f32);
            }
            for (j, i) in (0..N).flat_map(|j| (left..left + N).map(move |i| (j, i))) {
                let [a, b, c, d] = [number(i, j), number(i + 1, j), number(i + 1, j + 1), number(i, j + 1)];
                mesh.triangles.extend([[a, b, c], [a, c, d]]);
                // Edges from corner k to the next: below and at the right; above and at the left.
                mesh.borders.push(u8::from(j == 0) | u8::from(i + 1 == 2 * N) << 1);
                mesh.borders.push(u8::from(j + 1 == N) << 1 | u8::from(i == 0) << 2);
            }
            let count = mesh.triangles.len() as u32;
            Chunk { mesh, patches: vec![PatchRange { first: 0, count, diamond: NO_DIAMOND }] }
        })
    }

    /// What vertices that were made on both sides of an edge have in common.
    type Attributes = ([i32; 3], [u8; 3], OctNormal, [u32; 2]);

    fn attributes(mesh: &Mesh, k: u32) -> Attributes {
        let k = k as usize;
        let scalars = [0, 1].map(|channel: usize| mesh.scalars[channel][k].to_bits());
        (mesh.positions[k].to_array(), mesh.colors[k], mesh.normals[k], scalars)
    }

    fn area(mesh: &Mesh) -> i64 {
        let twice = |[a, b, c]: [u32; 3]| {
            let [a, b, c] = [a, b, c].map(|k| mesh.positions[k as usize].truncate().as_i64vec2());
            (b - a).perp_dot(c - a)
        };
        mesh.triangles.iter().copied().map(twice).sum()
    }

    #[test]
    fn triangles_and_chunks_still_meet_in_equal_vertices_wherever_edges_are_split() {
        let mut random = fastrand::Rng::with_seed(5);
        for _ in 0..20 {
            let mut both = chunks(&mut random);
            let subdivision = Subdivision::new(4.0, ["height", "filled"].into_iter(), 1000);
            for chunk in &both {
                for [a, b, c] in &chunk.mesh.triangles {
                    let [a, b] = [*a, *[b, c][random.usize(..2)]].map(|k| chunk.mesh.positions[k as usize].as_dvec3());
                    if random.u8(..3) == 0 {
                        subdivision.detail.note(a, b, random.f64() * 60.0);
                    }
                }
            }
            let before: i64 = both.iter().map(|chunk| area(&chunk.mesh)).sum();
            let mut edges = BTreeMap::<[Attributes; 2], (i32, u8)>::new();
            let mut triangles = 0;
            for chunk in &mut both {
                subdivision.apply(chunk).expect("parts");
                let mesh = &chunk.mesh;
                assert_eq!(chunk.patches[0].count as usize, mesh.triangles.len());
                triangles += mesh.triangles.len();
                for (triangle, borders) in mesh.triangles.iter().zip(&mesh.borders) {
                    for k in 0..3 {
                        let ends = [triangle[k], triangle[(k + 1) % 3]].map(|v| attributes(mesh, v));
                        assert_ne!(ends[0].0, ends[1].0);
                        let is_border = borders >> k & 1;
                        let (sign, key) = if ends[0] < ends[1] { (1, ends) } else { (-1, [ends[1], ends[0]]) };
                        let (sum, border) = edges.entry(key).or_default();
                        *sum += sign;
                        *border += is_border;
                    }
                }
            }
            assert!(triangles > 300, "{triangles} triangles of 144");
            for (edge, (sum, border)) in edges {
                assert_eq!(sum != 0, border == 1, "{edge:?}: used once if it is a border, else from both sides");
            }
            // Rounding moves what lies on the rim by less than a step.
            let after: i64 = both.iter().map(|chunk| area(&chunk.mesh)).sum();
            assert!((after - before).abs() < 2 * 2 * (1200 + 600), "{before}, {after}");
        }
    }

    #[test]
    fn new_vertices_have_mean_attributes_but_no_mean_of_labels() {
        let mut mesh = Mesh {
            positions: vec![IVec3::ZERO, IVec3::new(100, 0, 0), IVec3::new(0, 100, 0)],
            colors: vec![[0, 0, 0], [255, 100, 0], [255, 0, 0]],
            normals: vec![normal::encode(DVec3::Z); 3],
            scalars: vec![vec![1.0, 2.0, f32::NAN], vec![0.0, 1.0, 0.0]],
            triangles: vec![[0, 1, 2]],
            borders: vec![7],
        };
        add_attributes(&mut mesh, &[false, true], &[(0, 0.5), (1, 0.5)]);
        add_attributes(&mut mesh, &[false, true], &[(2, 0.75), (1, 0.25)]);
        // Half of the light of white is level 188.
        assert_eq!((mesh.colors[3], mesh.colors[4][0]), ([188, 71, 0], 255));
        assert_eq!(mesh.scalars[0][3], 1.5);
        assert!(mesh.scalars[0][4].is_nan());
        assert_eq!(mesh.scalars[1][3..], [1.0, 0.0]);
    }

    #[test]
    fn edges_are_not_split_into_parts_of_a_few_steps() {
        let mut random = fastrand::Rng::with_seed(6);
        let mut both = chunks(&mut random);
        let subdivision = Subdivision::new(1.0, ["height", "filled"].into_iter(), 1000);
        for chunk in &mut both {
            for triangle in &chunk.mesh.triangles {
                for k in 0..3 {
                    let [a, b] = [k, (k + 1) % 3].map(|k| chunk.mesh.positions[triangle[k] as usize].as_dvec3());
                    subdivision.detail.note(a, b, 1e6);
                }
            }
            subdivision.apply(chunk).expect("parts");
            let shortest = chunk.mesh.triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]);
            let shortest = shortest.map(|ends| {
                let [a, b] = ends.map(|k| chunk.mesh.positions[k as usize]);
                (a - b).abs().max_element()
            });
            assert!(
                chunk.mesh.triangles.len() > 72 * 8
                    && shortest.min().is_some_and(|steps| i64::from(steps) >= SHORTEST / 2)
            );
        }
    }
}
