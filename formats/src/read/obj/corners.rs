//! Corners of an OBJ that have normals or a picture: each distinct one becomes a vertex.
//!
//! Positions, texture coordinates and normals wait in tables of bounded memory. A cache of bounded size knows the number
//! of the vertex that a corner became; a corner that it has forgotten becomes a vertex again, which the builder welds.
//! Vertices that no face names are never handed on.

use super::material::{Map, Material};
use super::statements::Corner;
use super::survey::Survey;
use super::table::{Scratch, Table};
use super::{Body, MeshSink, ReadError};
use crate::Diagnostics;
use crate::read::ReadOptions;
use crate::read::companions::{Companions, Reference};
use crate::read::faces::{CROSSING, REPEATED, TOO_FEW, TRIANGULATED};
use crate::read::sink::{NOT_FINITE, TWICE, VertexBlock};
use crate::read::texture::detail::{Detail, Shared, Vertex, middle, split};
use crate::read::texture::{Refusal, Texture, Textures, light_from_srgb, srgb_from_light};
use glam::{DVec2, DVec3, Vec2, Vec3};
use kilwa_geometry::triangulate::{Outcome, Triangulator};
use kilwa_pack::visible::visible;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Vertices and triangles handed on at a time.
const BLOCK: usize = 4096;
/// Bytes of the three tables in memory at the most.
const TABLES: u64 = 176 << 20;
/// Corners remembered.
const REMEMBERED: u64 = 1 << 20;

/// Position (3 × f64) and colour (3 bytes and whether there is one).
const POSITION_BYTES: usize = 28;

/// What colours the faces in hand.
enum Paint {
    Nothing,
    Color([u8; 3]),
    /// A picture, by its number.
    Picture(usize, Map),
}

/// Where the faces go.
pub(super) enum To<'s> {
    /// Each corner becomes a vertex.
    Sink(&'s mut dyn MeshSink),
    /// Nowhere: the texels that their edges span are noted.
    Notes(&'s Detail),
}

/// A vertex in the making.
#[derive(Clone, Copy)]
struct Made {
    position: DVec3,
    own_color: Option<[u8; 3]>,
    uv: Option<DVec2>,
    normal: Option<Vec3>,
}

pub(super) struct Corners<'s, 'p> {
    to: To<'s>,
    detail: Option<&'p Detail>,
    diagnostics: Diagnostics,
    positions: Table<'p, POSITION_BYTES>,
    uvs: Table<'p, 8>,
    normals: Table<'p, 12>,
    /// Number + 1 of the vertex of a corner and the corner itself, by its hash.
    remembered: Vec<[u64; 4]>,
    /// Changes with each material, so that corners of another are not found.
    epoch: u64,
    paint: Paint,
    textures: Textures,
    companions: &'p Companions<'p>,
    /// The mesh file.
    path: &'p Path,
    /// Pictures by their numbers: name and file.
    pictures: Vec<(String, Option<PathBuf>)>,
    /// The number of a picture, by its library and its name there.
    picture_of: HashMap<(Arc<Path>, String), usize>,
    block: Block,
    triangles: Vec<[u64; 3]>,
    delivered: u64,
    /// Vertices of the triangle that is being split.
    shared: Shared,
    triangulator: Triangulator,
    ring: Vec<Corner>,
    ring_made: Vec<Made>,
}

/// Vertices that wait to be handed on; all have a colour or none, all a normal or none.
#[derive(Default)]
struct Block {
    /// The number of the first.
    first: u64,
    positions: Vec<DVec3>,
    colors: Vec<[u8; 3]>,
    normals: Vec<Vec3>,
}

impl<'s, 'p> Corners<'s, 'p> {
    pub(super) fn new(
        path: &'p Path,
        options: &'p ReadOptions,
        companions: &'p Companions<'p>,
        survey: &Survey,
        to: To<'s>,
        diagnostics: Diagnostics,
    ) -> Self {
        let scratch = Scratch { folder: &options.scratch, file: path };
        // Half of them for positions, the rest for normals and texture coordinates as large as they are.
        let tables = (options.memory / 4).min(TABLES) as usize;
        let remembered = survey.faces.saturating_mul(4).clamp(16, REMEMBERED).next_power_of_two();
        let first = if let To::Sink(sink) = &to { sink.vertex_count() } else { 0 };
        Self {
            to,
            detail: options.detail.as_deref(),
            diagnostics,
            positions: Table::new(scratch, tables / 2),
            uvs: Table::new(scratch, tables / 5),
            normals: Table::new(scratch, tables / 10 * 3),
            remembered: vec![[0; 4]; remembered as usize],
            epoch: 0,
            paint: Paint::Nothing,
            textures: Textures::new(options.texture_bytes).keeping(options.memory / 2).within(options.picture),
            companions,
            path,
            pictures: Vec::new(),
            picture_of: HashMap::new(),
            block: Block { first, ..Block::default() },
            triangles: Vec::with_capacity(BLOCK),
            delivered: 0,
            shared: Shared::default(),
            triangulator: Triangulator::default(),
            ring: Vec::new(),
            ring_made: Vec::new(),
        }
    }

    /// What a corner names.
    fn made(&mut self, corner: Corner) -> Result<Made, ReadError> {
        let record = self.positions.get(corner.vertex)?.unwrap_or([0; POSITION_BYTES]);
        let coordinate = |i: usize| record[8 * i..].first_chunk().map_or(f64::NAN, |b| f64::from_le_bytes(*b));
        let position = DVec3::new(coordinate(0), coordinate(1), coordinate(2));
        let own_color = (record[27] != 0).then(|| [record[24], record[25], record[26]]);
        let uv = match corner.uv.filter(|_| matches!(self.paint, Paint::Picture(..))) {
            Some(i) => self.uvs.get(i)?.map(|b| Vec2::new(f32_at(&b, 0), f32_at(&b, 1)).as_dvec2()),
            None => None,
        };
        let normal = match corner.normal {
            Some(i) => self.normals.get(i)?.map(|b| Vec3::new(f32_at(&b, 0), f32_at(&b, 1), f32_at(&b, 2))),
            None => None,
        };
        Ok(Made { position, own_color, uv, normal })
    }

    /// The number of the vertex that a corner is.
    fn number(&mut self, corner: Corner, made: Option<Made>) -> Result<u64, ReadError> {
        let uv = corner.uv.filter(|_| matches!(self.paint, Paint::Picture(..)));
        let key = [corner.vertex, uv.map_or(0, |i| i + 1), corner.normal.map_or(0, |i| i + 1) ^ (self.epoch << 40)];
        // Corners that lie together have neighbouring places: the numbers of what they name mostly run along together.
        let spread = |i: u64| i.wrapping_sub(corner.vertex).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 40;
        let at = corner.vertex.wrapping_add(spread(key[1])).wrapping_add(spread(key[2]) >> 3);
        let at = at as usize & (self.remembered.len() - 1);
        let [number, a, b, c] = self.remembered[at];
        if number > 0 && [a, b, c] == key {
            return Ok(number - 1);
        }
        let made = match made {
            Some(made) => made,
            None => self.made(corner)?,
        };
        let number = self.vertex_of(&made)?;
        self.remembered[at] = [number + 1, key[0], key[1], key[2]];
        Ok(number)
    }

    /// Make a vertex.
    fn vertex_of(&mut self, made: &Made) -> Result<u64, ReadError> {
        let color = self.color(made);
        let block = &self.block;
        let same = color.is_some() != block.colors.is_empty() && made.normal.is_some() != block.normals.is_empty();
        if block.positions.len() >= BLOCK || !(same || block.positions.is_empty()) {
            self.flush_vertices()?;
        }
        let block = &mut self.block;
        block.positions.push(made.position);
        block.colors.extend(color);
        block.normals.extend(made.normal);
        Ok(block.first + block.positions.len() as u64 - 1)
    }

    /// The picture of the faces in hand, where there is one that can be read.
    fn picture(&mut self) -> Option<(&Texture, &Map)> {
        let Paint::Picture(number, map) = &self.paint else { return None };
        let (name, file) = &self.pictures[*number];
        let (companions, max) = (self.companions, self.textures.file_bytes());
        let load = || match file {
            Some(file) => companions.read(file, max).map_err(|e| Refusal::of_file(file, &e)),
            None => Err(Refusal::Unreadable("it is missing".to_owned())),
        };
        let diagnostics = &mut self.diagnostics;
        let refused = |why| diagnostics.add("pictures left out", || format!("{}: {why}", visible(name)));
        Some((self.textures.get(*number, load, refused)?, map))
    }

    /// Number a picture that was not used before.
    fn new_picture(&mut self, map: &Map, key: (Arc<Path>, String)) -> Result<usize, ReadError> {
        let folder = map.library.parent().unwrap_or(Path::new(""));
        let place = format!("line {} (map_Kd)", map.line);
        let by = Reference { file: &map.library, place: &place, name: &map.name };
        let file = self.companions.locate(folder, &by)?;
        let number = self.pictures.len();
        self.pictures.push((map.name.clone(), file));
        self.picture_of.insert(key, number);
        Ok(number)
    }

    /// The colour of a vertex: of the picture, else its own, else of the material.
    fn color(&mut self, made: &Made) -> Option<[u8; 3]> {
        let from_picture = made.uv.and_then(|uv| {
            let (texture, map) = self.picture()?;
            let placed = uv * map.scale + map.offset;
            // In an OBJ the first row of a picture is at the top, v goes up.
            Some(texture.sample(DVec2::new(placed.x, 1.0 - placed.y), [map.wrap; 2]))
        });
        let from_material = if let Paint::Color(color) = self.paint { Some(color) } else { None };
        from_picture.or(made.own_color).or(from_material)
    }

    fn flush_vertices(&mut self) -> Result<(), ReadError> {
        let Block { first, positions, colors, normals } = &mut self.block;
        if let (To::Sink(sink), false) = (&mut self.to, positions.is_empty()) {
            sink.vertices(&VertexBlock { positions, colors, normals, scalars: &[] })?;
            *first += positions.len() as u64;
            positions.clear();
            colors.clear();
            normals.clear();
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), ReadError> {
        if let Some(why) = self.textures.short() {
            return Err(ReadError::TooLarge {
                file: self.path.to_owned(),
                what: format!("a picture that it names: {why}"),
            });
        }
        self.flush_vertices()?;
        if let (To::Sink(sink), false) = (&mut self.to, self.triangles.is_empty()) {
            sink.triangles(&self.triangles, &[])?;
            self.delivered += self.triangles.len() as u64;
            self.triangles.clear();
        }
        Ok(())
    }

    /// A triangle of three distinct vertices.
    fn triangle(&mut self, corners: [Corner; 3], made: Option<[Made; 3]>, line: u64) -> Result<(), ReadError> {
        let [a, b, c] = corners.map(|c| c.vertex);
        if a == b || b == c || c == a {
            self.diagnostics.add(TWICE, || format!("line {line}"));
            return Ok(());
        }
        if let Some(detail) = self.detail {
            let made = match made {
                Some(made) => made,
                None => [self.made(corners[0])?, self.made(corners[1])?, self.made(corners[2])?],
            };
            return self.detailed(detail, corners, made);
        }
        let mut numbers = [0; 3];
        for (k, number) in numbers.iter_mut().enumerate() {
            *number = self.number(corners[k], made.map(|m| m[k]))?;
        }
        self.push(numbers)
    }

    fn push(&mut self, numbers: [u64; 3]) -> Result<(), ReadError> {
        self.triangles.push(numbers);
        if self.triangles.len() >= BLOCK { self.flush() } else { Ok(()) }
    }

    /// A triangle that is split where it or a neighbour spans many texels.
    fn detailed(&mut self, detail: &Detail, corners: [Corner; 3], made: [Made; 3]) -> Result<(), ReadError> {
        // Texels from one end of the coordinates to the other.
        let size = self.picture().map(|(texture, map)| {
            let [width, height] = texture.size().map(|n| n as f64);
            DVec2::new(width, height) * map.scale
        });
        let texels = |a: &Made, b: &Made| match (size, a.uv, b.uv) {
            (Some(size), Some(a), Some(b)) => {
                let apart = (a - b) * size;
                libm::hypot(apart.x, apart.y)
            }
            _ => 0.0,
        };
        if let To::Notes(detail) = self.to {
            for (a, b) in [(0, 1), (1, 2), (2, 0)] {
                detail.note(made[a].position, made[b].position, texels(&made[a], &made[b]));
            }
            return Ok(());
        }
        self.shared.clear();
        for k in 0..3 {
            let number = self.number(corners[k], Some(made[k]))?;
            self.shared.insert(made[k].position, number);
        }
        if [(0, 1), (1, 2), (2, 0)].iter().any(|&(a, b)| detail.is_beyond(texels(&made[a], &made[b]))) {
            self.diagnostics.add_many("triangles that span too many texels to be split for all of them", 1);
        }
        let mut parts = 0;
        split(detail, made, texels, |part| {
            parts += 1;
            let mut numbers = [0; 3];
            for (number, made) in numbers.iter_mut().zip(&part) {
                *number = if let Some(number) = self.shared.get(made.position) {
                    number
                } else {
                    let number = self.vertex_of(made)?;
                    self.shared.insert(made.position, number);
                    number
                };
            }
            self.push(numbers)
        })?;
        self.diagnostics.add_many("triangles split so that they keep their pictures", u64::from(parts > 1));
        Ok(())
    }

    fn polygon(&mut self, line: u64) -> Result<(), ReadError> {
        let ring = std::mem::take(&mut self.ring);
        let mut made = std::mem::take(&mut self.ring_made);
        made.clear();
        for &corner in &ring {
            made.push(self.made(corner)?);
        }
        if made.iter().all(|m| m.position.is_finite()) {
            self.diagnostics.add(TRIANGULATED, || format!("line {line}"));
            let positions: Vec<_> = made.iter().map(|m| m.position).collect();
            let mut triangles = Vec::with_capacity(ring.len());
            if self.triangulator.polygon(&positions, |t| triangles.push(t)) == Outcome::Crossing {
                self.diagnostics.add(CROSSING, || format!("line {line}"));
            }
            for t in triangles {
                self.triangle(t.map(|i| ring[i]), Some(t.map(|i| made[i])), line)?;
            }
        } else {
            self.diagnostics.add(NOT_FINITE, || format!("line {line}"));
            self.diagnostics.add_many(NOT_FINITE, ring.len() as u64 - 3);
        }
        (self.ring, self.ring_made) = (ring, made);
        Ok(())
    }
}

impl Vertex for Made {
    fn position(&self) -> DVec3 {
        self.position
    }

    fn between(&self, other: &Self) -> Self {
        let color = |a: [u8; 3], b: [u8; 3]| {
            [0, 1, 2].map(|i| srgb_from_light(f64::midpoint(light_from_srgb(a[i]), light_from_srgb(b[i]))))
        };
        Self {
            position: middle(self.position, other.position),
            own_color: self.own_color.zip(other.own_color).map(|(a, b)| color(a, b)),
            uv: self.uv.zip(other.uv).map(|(a, b)| a.midpoint(b)),
            // Not Vec3::midpoint, whose sum overflows where both are very large.
            normal: self
                .normal
                .zip(other.normal)
                .map(|(a, b)| Vec3::from_array([0, 1, 2].map(|i| f32::midpoint(a[i], b[i])))),
        }
    }
}

fn f32_at(bytes: &[u8], k: usize) -> f32 {
    bytes[4 * k..].first_chunk().map_or(0.0, |b| f32::from_le_bytes(*b))
}

impl Body for Corners<'_, '_> {
    fn vertex(&mut self, position: DVec3, color: Option<[u8; 3]>) -> Result<(), ReadError> {
        let mut record = [0; POSITION_BYTES];
        for (slot, v) in record.chunks_exact_mut(8).zip(position.to_array()) {
            slot.copy_from_slice(&v.to_le_bytes());
        }
        if let Some([r, g, b]) = color {
            record[24..].copy_from_slice(&[r, g, b, 1]);
        }
        self.positions.push(&record)
    }

    fn uv(&mut self, uv: DVec2) -> Result<(), ReadError> {
        let [u, v] = uv.as_vec2().to_array().map(f32::to_le_bytes);
        let mut record = [0; 8];
        record[..4].copy_from_slice(&u);
        record[4..].copy_from_slice(&v);
        self.uvs.push(&record)
    }

    fn normal(&mut self, normal: DVec3) -> Result<(), ReadError> {
        let mut normal = normal.as_vec3();
        if !normal.is_finite() {
            self.diagnostics.add_many("normals that are not finite set to zero", 1);
            normal = Vec3::ZERO;
        }
        let mut record = [0; 12];
        for (slot, v) in record.chunks_exact_mut(4).zip(normal.to_array()) {
            slot.copy_from_slice(&v.to_le_bytes());
        }
        self.normals.push(&record)
    }

    fn material(&mut self, material: &Material) -> Result<(), ReadError> {
        self.epoch += 1;
        self.paint = match (&material.map, material.color) {
            (Some(map), _) => {
                let key = (Arc::clone(&map.library), map.name.clone());
                let number = match self.picture_of.get(&key) {
                    Some(number) => *number,
                    None => self.new_picture(map, key)?,
                };
                Paint::Picture(number, map.clone())
            }
            (None, Some(color)) => Paint::Color(color),
            (None, None) => Paint::Nothing,
        };
        Ok(())
    }

    fn face(&mut self, corners: &[Corner], line: u64) -> Result<(), ReadError> {
        if let &[a, b, c] = corners {
            return self.triangle([a, b, c], None, line);
        }
        self.ring.clear();
        self.ring.extend(corners);
        self.ring.dedup_by_key(|c| c.vertex);
        while self.ring.len() > 1 && self.ring.first().map(|c| c.vertex) == self.ring.last().map(|c| c.vertex) {
            self.ring.pop();
        }
        let repeated = (corners.len() - self.ring.len()) as u64;
        if corners.len() > 3 && repeated > 0 {
            self.diagnostics.add(REPEATED, || format!("line {line}"));
            self.diagnostics.add_many(REPEATED, repeated - 1);
        }
        if self.ring.len() < 3 {
            self.diagnostics.add(TOO_FEW, || format!("line {line}"));
            return Ok(());
        }
        self.polygon(line)
    }

    fn may_look_ahead(&self, _: usize) -> bool {
        false
    }

    fn needs_corners(&self) -> bool {
        true
    }

    fn diagnostics(&mut self) -> &mut Diagnostics {
        &mut self.diagnostics
    }

    fn finish(mut self) -> Result<(u64, Diagnostics), ReadError> {
        self.flush()?;
        self.diagnostics.pictures.add(self.textures.used());
        Ok((self.delivered, self.diagnostics))
    }
}
