//! Primitives whose triangles are split where a picture shows more than their corners hold (see
//! [`crate::read::texture::detail`]), and the pass before, which notes how many texels their edges span.
//!
//! Vertices are looked up as triangles name them, through a few blocks of each attribute; of the numbers of those that were
//! delivered a fixed count is remembered, and a vertex that was forgotten comes out twice, to be welded later. So nothing
//! grows with the primitive.

use super::super::sink::TWICE;
use super::super::texture::detail::{Detail, Shared, Vertex, middle, split};
use super::super::texture::{light_from_srgb, srgb_from_light};
use super::super::{MeshSink, ReadError, VertexBlock, VertexSink};
use super::Context;
use super::buffers::Buffers;
use super::material::{Material, Texture};
use super::primitive::{Column, Columns, Delivery};
use super::transform::Transform;
use glam::{DVec2, DVec3, Vec3};
use std::collections::{HashMap, VecDeque};

/// Elements of a block that is kept.
const BLOCK: u64 = 1 << 12;
/// Blocks kept of each attribute.
const BLOCKS: usize = 64;
/// Vertices and triangles handed on at a time.
const PENDING: usize = 1 << 14;
/// Numbers of delivered vertices that are remembered.
const REMEMBERED: usize = 1 << 20;

/// What happens with triangles.
#[derive(Clone, Copy)]
pub(in crate::read) struct Detailing<'d> {
    pub(in crate::read) detail: &'d Detail,
    /// Note how many texels edges span, and deliver nothing.
    pub(in crate::read) notes: bool,
}

/// A vertex in the making.
#[derive(Debug, Clone, Copy)]
struct Made {
    position: DVec3,
    normal: Option<DVec3>,
    /// Linear, without the picture.
    color: DVec3,
    uv: Option<DVec2>,
}

impl Vertex for Made {
    fn position(&self) -> DVec3 {
        self.position
    }

    fn between(&self, other: &Self) -> Self {
        Self {
            position: middle(self.position, other.position),
            normal: self.normal.zip(other.normal).map(|(a, b)| middle(a, b)),
            color: middle(self.color, other.color),
            // glam's midpoint adds first, which overflows where this does not.
            uv: self.uv.zip(other.uv).map(|(a, b)| DVec2::from_array([0, 1].map(|i| f64::midpoint(a[i], b[i])))),
        }
    }
}

/// One primitive while it is split.
pub(super) struct Run<'m> {
    material: &'m Material,
    transform: Transform,
    positions: Cached,
    normals: Option<Cached>,
    colors: Option<Cached>,
    coordinates: Option<Cached>,
    /// Texels across and down, where there is a picture.
    size: Option<DVec2>,
    remembered: HashMap<u64, u64>,
    shared: Shared,
    /// Vertices that wait to be handed on.
    waiting: Vec<Made>,
    triangles: Vec<[u64; 3]>,
}

/// An attribute that is looked up at random.
struct Cached {
    column: Column,
    count: u64,
    blocks: HashMap<u64, Vec<f64>>,
    order: VecDeque<u64>,
}

impl Cached {
    fn new(column: Column, count: u64) -> Self {
        Self { column, count, blocks: HashMap::new(), order: VecDeque::new() }
    }

    /// The first components of an element; NaN where it has fewer.
    fn at<const N: usize>(
        &mut self,
        index: u64,
        buffers: &mut Buffers<'_>,
        context: &Context<'_>,
    ) -> Result<[f64; N], ReadError> {
        let number = index / BLOCK;
        if !self.blocks.contains_key(&number) {
            let mut values = match self.order.len() {
                BLOCKS => self.order.pop_front().and_then(|oldest| self.blocks.remove(&oldest)).unwrap_or_default(),
                _ => Vec::new(),
            };
            let first = number * BLOCK;
            let n = (self.count - first).min(BLOCK) as usize;
            self.column.block(buffers, first, n, &mut values, context)?;
            self.blocks.insert(number, values);
            self.order.push_back(number);
        }
        let from = (index % BLOCK) as usize * self.column.width();
        let values = self.blocks.get(&number).and_then(|block| block.get(from..)).unwrap_or_default();
        Ok(std::array::from_fn(|k| values.get(k).copied().unwrap_or(f64::NAN)))
    }
}

impl<'m> Run<'m> {
    pub(super) fn new(
        columns: Columns,
        material: &'m Material,
        transform: &Transform,
        size: Option<[usize; 2]>,
    ) -> Self {
        let cached = |column: Option<Column>| column.map(|c| Cached::new(c, columns.count));
        Self {
            material,
            transform: *transform,
            positions: Cached::new(columns.positions, columns.count),
            normals: cached(columns.normals),
            colors: cached(columns.colors),
            coordinates: cached(columns.coordinates),
            size: size.map(|size| size.map(|n| n as f64).into()),
            remembered: HashMap::new(),
            shared: Shared::default(),
            waiting: Vec::new(),
            triangles: Vec::new(),
        }
    }

    fn made(&mut self, v: u64, buffers: &mut Buffers<'_>, context: &Context<'_>) -> Result<Made, ReadError> {
        let position = self.transform.point(self.positions.at(v, buffers, context)?.into());
        let normal = match &mut self.normals {
            Some(normals) => Some(self.transform.normal(normals.at(v, buffers, context)?.into())),
            None => None,
        };
        let mut color = self.material.factor;
        if let Some(colors) = &mut self.colors {
            let own: [f64; 3] = colors.at(v, buffers, context)?;
            color *= DVec3::from_array(own.map(|v| v.clamp(0.0, 1.0)));
        }
        let uv = match (&mut self.coordinates, &self.material.texture) {
            (Some(coordinates), Some(texture)) => Some(texture.place(coordinates.at(v, buffers, context)?.into())),
            _ => None,
        };
        Ok(Made { position, normal, color, uv })
    }

    /// Texels between two vertices.
    fn texels(size: Option<DVec2>, a: &Made, b: &Made) -> f64 {
        match (size, a.uv, b.uv) {
            (Some(size), Some(a), Some(b)) => {
                let apart = (a - b) * size;
                libm::hypot(apart.x, apart.y)
            }
            _ => 0.0,
        }
    }
}

impl Delivery<'_, '_, '_> {
    /// Texels across and down of the picture of a material.
    pub(super) fn picture_size(&mut self, texture: Option<&Texture>) -> Option<[usize; 2]> {
        texture.and_then(|texture| self.picture(texture).map(super::super::texture::Texture::size))
    }

    /// Split a block of triangles, or note their edges.
    pub(super) fn detail_block(
        &mut self,
        run: &mut Run<'_>,
        triangles: &mut Vec<[u64; 3]>,
        detailing: Detailing<'_>,
    ) -> Result<(), ReadError> {
        for [a, b, c] in triangles.drain(..) {
            if a == b || b == c || c == a {
                self.sink.diagnostics().add(TWICE, || format!("triangle of the vertices {a}, {b} and {c}"));
                continue;
            }
            let mut made = |v: u64| run.made(v, &mut self.buffers, &self.context);
            let made = [made(a)?, made(b)?, made(c)?];
            if detailing.notes {
                for (i, k) in [(0, 1), (1, 2), (2, 0)] {
                    let texels = Run::texels(run.size, &made[i], &made[k]);
                    detailing.detail.note(made[i].position, made[k].position, texels);
                }
            } else {
                self.split(run, [a, b, c], &made, detailing.detail)?;
            }
        }
        Ok(())
    }

    /// Deliver the parts of a triangle.
    fn split(
        &mut self,
        run: &mut Run<'_>,
        corners: [u64; 3],
        made: &[Made; 3],
        detail: &Detail,
    ) -> Result<(), ReadError> {
        let size = run.size;
        let texels = |a: &Made, b: &Made| Run::texels(size, a, b);
        if [(0, 1), (1, 2), (2, 0)].iter().any(|&(i, k)| detail.is_beyond(texels(&made[i], &made[k]))) {
            self.sink.diagnostics().add_many("triangles that span too many texels to be split for all of them", 1);
        }
        run.shared.clear();
        if run.remembered.len() >= REMEMBERED {
            run.remembered.clear();
        }
        let mut numbers = [0; 3];
        for k in 0..3 {
            numbers[k] = match run.remembered.get(&corners[k]) {
                Some(number) => *number,
                None => self.next_number(run, made[k])?,
            };
            run.remembered.insert(corners[k], numbers[k]);
            run.shared.insert(made[k].position, numbers[k]);
        }
        let finite = made.iter().all(|m| m.position.is_finite());
        if !finite {
            run.triangles.push(numbers);
            return self.hand_on(run, PENDING);
        }
        let mut parts = 0;
        split(detail, *made, texels, |part| {
            parts += 1;
            let mut numbers = [0; 3];
            for (number, made) in numbers.iter_mut().zip(part) {
                *number = match run.shared.get(made.position) {
                    Some(number) => number,
                    None => self.next_number(run, made)?,
                };
                run.shared.insert(made.position, *number);
            }
            run.triangles.push(numbers);
            self.hand_on(run, PENDING)
        })?;
        self.sink.diagnostics().add_many("triangles split so that they keep their pictures", u64::from(parts > 1));
        Ok(())
    }

    /// The number of a vertex that waits from now on.
    fn next_number(&mut self, run: &mut Run<'_>, made: Made) -> Result<u64, ReadError> {
        self.hand_on(run, PENDING)?;
        run.waiting.push(made);
        Ok(self.sink.vertex_count() + run.waiting.len() as u64 - 1)
    }

    /// Hand on what waits, where it is `most` or more.
    pub(super) fn hand_on(&mut self, run: &mut Run<'_>, max: usize) -> Result<(), ReadError> {
        if run.waiting.len() >= max && !run.waiting.is_empty() {
            let positions: Vec<DVec3> = run.waiting.iter().map(|m| m.position).collect();
            let normals: Vec<Vec3> = run.waiting.iter().filter_map(|m| Some(m.normal?.as_vec3())).collect();
            let colors: Vec<[u8; 3]> = if self.colored { self.colors_of(run) } else { Vec::new() };
            let block = VertexBlock { positions: &positions, colors: &colors, normals: &normals, scalars: &[] };
            self.sink.vertices(&block)?;
            run.waiting.clear();
        }
        if run.triangles.len() >= max {
            self.deliver(&mut run.triangles)?;
        }
        Ok(())
    }

    fn colors_of(&mut self, run: &Run<'_>) -> Vec<[u8; 3]> {
        let texture = run.material.texture.as_ref();
        let picture = texture.and_then(|t| Some((self.picture(t)?, t.wrap)));
        let painted = |m: &Made| match (picture, m.uv) {
            (Some((picture, wrap)), Some(uv)) => {
                let texel = picture.sample(uv, wrap);
                [0, 1, 2].map(|k| srgb_from_light(m.color[k] * light_from_srgb(texel[k])))
            }
            _ => m.color.to_array().map(srgb_from_light),
        };
        run.waiting.iter().map(painted).collect()
    }
}

/// Takes nothing: for the pass that only notes.
#[derive(Default)]
pub(in crate::read) struct Nowhere {
    count: u64,
    diagnostics: crate::Diagnostics,
}

impl VertexSink for Nowhere {
    fn channels(&mut self, _: &[String]) -> Result<(), ReadError> {
        Ok(())
    }

    fn vertices(&mut self, block: &VertexBlock<'_>) -> Result<(), ReadError> {
        self.count += block.positions.len() as u64;
        Ok(())
    }

    fn vertex_count(&self) -> u64 {
        self.count
    }

    fn diagnostics(&mut self) -> &mut crate::Diagnostics {
        &mut self.diagnostics
    }
}

impl MeshSink for Nowhere {
    fn triangles(&mut self, _: &[[u64; 3]], _: &[[u8; 3]]) -> Result<(), ReadError> {
        Ok(())
    }

    fn positions(&mut self, of: &[u64], into: &mut Vec<DVec3>) -> Result<(), ReadError> {
        into.extend(of.iter().map(|_| DVec3::NAN));
        Ok(())
    }
}
