//! Closing what is left, to make the surface watertight.

use super::NEAREST;
use super::membrane::{self, Membrane, Nearest, membrane};
use super::{Filler, Source};
use crate::ScanError;
use crate::merge::rims::RimVertex;
use glam::DVec3;

impl Filler<'_, '_, '_> {
    /// Close all loops that are open; returns their number. The longest outer edge, if it surrounds the ground, gets vertical walls down to a flat base below
    /// everything. Other loops get a membrane, or, where they are folded, a cone.
    pub(super) fn close(&mut self) -> Result<usize, ScanError> {
        let open = self.joined.rims().loops();
        let is_around = |rim: &[RimVertex]| rim.iter().map(|v| v.normal.z).sum::<f64>() > 0.5 * rim.len() as f64;
        let runs_round = |rim: &[RimVertex]| membrane::plane(rim).is_some_and(|normal| normal.z < 0.0);
        let longest = (0..open.len()).max_by(|a, b| length(&open[*a]).total_cmp(&length(&open[*b])));
        for (number, rim) in open.iter().enumerate() {
            if Some(number) == longest && is_around(rim) && runs_round(rim) {
                self.base(rim)?;
                continue;
            }
            if self.diffuse(&[rim], Source::Closed)?.is_none() {
                self.add(&[rim], &cone(rim), Source::Closed)?;
            }
        }
        Ok(open.len())
    }

    /// Vertical walls from a loop down to the lowest place, and a floor.
    pub(super) fn base(&mut self, rim: &[RimVertex]) -> Result<(), ScanError> {
        let mut bottom = Vec::with_capacity(rim.len());
        for (k, vertex) in rim.iter().enumerate() {
            let next = rim[(k + 1) % rim.len()].position - vertex.position;
            let position = vertex.position.with_z(self.bounds[0].z);
            let number = self.vertex(
                &membrane::Vertex {
                    position,
                    // The wall is on the right of the loop.
                    normal: next.cross(DVec3::Z).normalize_or(DVec3::NEG_Z),
                    color: vertex.color,
                    intensity: vertex.intensity,
                },
                Source::Closed,
            )?;
            bottom.push(RimVertex { position, number, normal: DVec3::NEG_Z, ..*vertex });
        }
        self.strip(rim, &bottom, Source::Closed)?;
        // The floor needs no detail.
        let wide = length(rim) / 64.0;
        let nearest = Nearest { distance: self.voxel * NEAREST, checks_rims: false };
        match membrane(&[&bottom], wide.max(self.voxel), nearest) {
            Some(made) => self.add(&[&bottom], &made, Source::Closed),
            None => self.add(&[&bottom], &cone(&bottom), Source::Closed),
        }
    }
}

fn length(rim: &[RimVertex]) -> f64 {
    rim.iter().zip(rim.iter().cycle().skip(1)).map(|(a, b)| a.position.distance(b.position)).sum()
}

/// Triangles from the middle of a loop to its sides. They can cross each other, but close the loop, whatever its shape.
fn cone(rim: &[RimVertex]) -> Membrane {
    let count = rim.len();
    let position = rim.iter().map(|vertex| vertex.position).sum::<DVec3>() / count as f64;
    let colors: Vec<[u8; 3]> = rim.iter().filter_map(|vertex| vertex.color).collect();
    let channel = |k: usize| (colors.iter().map(|c| u64::from(c[k])).sum::<u64>() / colors.len() as u64) as u8;
    let intensities: Vec<f32> = rim.iter().map(|vertex| vertex.intensity).filter(|v| v.is_finite()).collect();
    let apex = membrane::Vertex {
        position,
        normal: membrane::plane(rim).unwrap_or(DVec3::Z),
        color: (!colors.is_empty()).then(|| [0, 1, 2].map(channel)),
        // NaN if there is none.
        intensity: intensities.iter().sum::<f32>() / intensities.len() as f32,
    };
    let triangles = (0..count).map(|k| [((k + 1) % count) as u32, k as u32, count as u32]).collect();
    Membrane { vertices: vec![apex], triangles }
}
