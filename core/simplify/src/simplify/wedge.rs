//! Attributes of the vertices that are being merged. Colours are averaged in linear light, normals and scalars summed,
//! each fine vertex with weight 1, and rounded as the [`Purpose`] asks. A vertex that nothing was merged into keeps its attributes bit for bit.

use super::Purpose;
use glam::Vec3;
use kilwa_geometry::color::{light_from_srgb_f32, srgb_from_light_f32};
use kilwa_geometry::{Mesh, normal};

/// Sums of what a vertex represents.
#[derive(Clone, Copy)]
struct Sum {
    /// Linear light.
    color: Vec3,
    /// The same over the weight.
    mean: Vec3,
    weight: f32,
    normal: Vec3,
    changed: bool,
}

/// One sum per vertex of the fine mesh.
pub(super) struct Wedges<'a> {
    source: &'a Mesh,
    sums: Vec<Sum>,
    scalars: Vec<Vec<f32>>,
}

impl<'a> Wedges<'a> {
    pub(super) fn new(source: &'a Mesh) -> Self {
        let sums = (0..source.vertex_count())
            .map(|v| {
                let color = source.colors.get(v).map_or(Vec3::ZERO, |c| c.map(light_from_srgb_f32).into());
                Sum { color, mean: color, weight: 1.0, normal: Vec3::ZERO, changed: false }
            })
            .collect();
        Self { source, sums, scalars: source.scalars.clone() }
    }

    /// Squared difference of two colours in linear light.
    pub(super) fn color_distance(&self, a: u32, b: u32) -> f64 {
        (self.sums[a as usize].mean - self.sums[b as usize].mean).as_dvec3().length_squared()
    }

    fn normal_sum(&self, w: usize) -> Vec3 {
        if self.sums[w].changed { self.sums[w].normal } else { normal::decode(self.source.normals[w]).as_vec3() }
    }

    /// Add what one vertex represents to another.
    pub(super) fn merge(&mut self, from: u32, to: u32) {
        let (from, to) = (from as usize, to as usize);
        let (added, normal) = (self.normal_sum(from), self.normal_sum(to));
        let Sum { color, weight, .. } = self.sums[from];
        let own = self.sums[to].weight;
        for channel in &mut self.scalars {
            // Sums, like the colours; an unchanged wedge holds its value with weight 1. A value that does not exist (NaN)
            // takes no part: the mean stays that of the others.
            let (f, t) = (channel[from], channel[to]);
            channel[to] = match (f.is_nan(), t.is_nan()) {
                (true, false) => t * ((own + weight) / own),
                (false, true) => f * ((own + weight) / weight),
                _ => f + t,
            };
        }
        let sum = &mut self.sums[to];
        sum.weight += weight;
        sum.changed = true;
        sum.color += color;
        sum.mean = sum.color / sum.weight;
        sum.normal = normal + added;
    }

    /// Append the attributes of a vertex to a mesh.
    pub(super) fn emit(&self, w: usize, purpose: Purpose, out: &mut Mesh) {
        let (finest, made) = match purpose {
            Purpose::Level(precision) => (precision, precision.coarse()),
            Purpose::Export(precision, _) => (precision, precision),
        };
        let sum = &self.sums[w];
        if let Some(c) = self.source.colors.get(w) {
            let mean = sum.mean.to_array().map(srgb_from_light_f32);
            // Equal colours stay equal.
            out.colors.push(if !sum.changed || mean == *c { *c } else { made.color(mean) });
        }
        out.normals.push(if sum.changed {
            made.normal_within(normal::encode(sum.normal.as_dvec3()), finest)
        } else {
            self.source.normals[w]
        });
        for (to, from) in out.scalars.iter_mut().zip(&self.scalars) {
            to.push(if sum.changed { from[w] / sum.weight } else { from[w] });
        }
    }
}
