//! Collars: a rim is as jagged as the voxels at its border, so it can cross itself when it is projected. Then a strip of triangles leads from the rim to a smoother
//! loop, which is closed instead.

use super::membrane::Vertex;
use super::{Filler, Source};
use crate::ScanError;
use crate::merge::rims::RimVertex;
use glam::DVec3;

/// The numbers of smoothing passes to try, in turn, for a rim of `count` vertices until it no longer crosses itself. The smoothing must be narrow
/// compared with the rim, which shrinks to a point otherwise: after n passes, its standard deviation is √(n / 2) vertices.
pub(super) fn passes(count: usize) -> impl Iterator<Item = u32> {
    let most = (count / 8).pow(2);
    [0, 4, 16, 64, 256].into_iter().filter(move |passes| *passes as usize <= most)
}

/// The smooth loop of a rim.
pub(super) struct Collar {
    /// As many vertices as the rim has. Their numbers are those of the rim.
    pub(super) inner: Vec<RimVertex>,
}

impl Collar {
    pub(super) fn new(rim: &[RimVertex], passes: u32) -> Self {
        let count = rim.len();
        let mut places: Vec<DVec3> = rim.iter().map(|vertex| vertex.position).collect();
        for _ in 0..passes {
            let around = |k: usize| (places[(k + count - 1) % count] + 2.0 * places[k] + places[(k + 1) % count]) / 4.0;
            places = (0..count).map(around).collect();
        }
        Self { inner: rim.iter().zip(places).map(|(vertex, position)| RimVertex { position, ..*vertex }).collect() }
    }
}

impl Filler<'_, '_, '_> {
    /// Add the strips between rims and their smooth loops; returns the loops.
    pub(super) fn collars(
        &mut self,
        rims: &[&[RimVertex]],
        collars: Vec<Collar>,
        source: Source,
    ) -> Result<Vec<Vec<RimVertex>>, ScanError> {
        let mut loops = Vec::with_capacity(rims.len());
        for (rim, collar) in rims.iter().zip(collars) {
            let mut inner = collar.inner;
            for vertex in &mut inner {
                let RimVertex { position, normal, color, intensity, .. } = *vertex;
                vertex.number = self.vertex(&Vertex { position, normal, color, intensity }, source)?;
            }
            self.strip(rim, &inner, source)?;
            loops.push(inner);
        }
        Ok(loops)
    }

    /// Add the triangles between two loops with the same number of vertices.
    pub(super) fn strip(&mut self, rim: &[RimVertex], inner: &[RimVertex], source: Source) -> Result<(), ScanError> {
        for k in 0..rim.len() {
            let next = (k + 1) % rim.len();
            let [a, b, c, d] = [&rim[k], &rim[next], &inner[k], &inner[next]].map(|vertex| vertex.number);
            self.joined.triangle([b, a, c], source)?;
            self.joined.triangle([b, c, d], source)?;
        }
        Ok(())
    }
}
