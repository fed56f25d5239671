//! Rounding the places that simplification made. What a coarse form keeps of the fine one lies where it lay; a point
//! that represents many lies anywhere within the error, and there a place with zeros at its end is as good and takes fewer
//! bits (FORMAT section 5.3, grains). Twice as coarse would save half as much again, but coarse forms would be a tenth
//! farther from the fine one (docs/decisions/0016-rounding-coarse-forms.md).
//!
//! Locked points never move. The certifier measures what came out, as it does for everything else here.

use super::{NONE, Simplifier, local};
use kilwa_geometry::LatticePoint;
use kilwa_geometry::lattice::MAX_COORDINATE;

/// One fine triangle in so many is sampled for the roughness of the surface.
const SAMPLE: usize = 4;
/// Most zeros that the codec saves.
const MAX: u32 = 15;

impl Simplifier<'_> {
    /// Round the places that were made to multiples of a power of two, at most their [roughness](Self::roughness), each to
    /// the corner of its cell that suits its quadric best of those that turn no triangle over.
    pub(super) fn settle(&mut self) {
        let grain = (libm::log2(self.roughness().max(1.0)) as u32).min(MAX);
        if grain == 0 {
            return;
        }
        for p in 0..self.points.len() as u32 {
            let point = &self.points[p as usize];
            if point.made && !point.locked && point.head != NONE && self.merged_into[p as usize] == p {
                self.settle_point(p, grain);
            }
        }
    }

    /// Root mean square distance, by area, of the points that were made from the planes of the fine triangles at what was
    /// merged into them, by a sample.
    fn roughness(&mut self) -> f64 {
        let (mut sum, mut weight) = (0.0, 0.0);
        for t in (0..self.alive.len()).step_by(SAMPLE) {
            let corners = self.source.corners(t).map(|p| local(p, self.center));
            let n = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
            let double_area = n.length();
            if double_area <= 0.0 {
                continue;
            }
            for v in self.source.triangles[t] {
                let p = self.now(self.point_of_vertex[v as usize]);
                let point = &self.points[p as usize];
                if point.made && !point.locked {
                    let away = n.dot(point.local - corners[0]);
                    sum += away * away / double_area;
                    weight += double_area;
                }
            }
        }
        if weight > 0.0 { (sum / weight).sqrt() } else { 0.0 }
    }

    fn settle_point(&mut self, p: u32, grain: u32) {
        let (at, quadric) = (self.points[p as usize].at, self.points[p as usize].quadric);
        let low = at >> grain << grain;
        let mut corners = [0, 1, 2, 3, 4, 5, 6, 7].map(|i| {
            // An axis that is a multiple already has one choice.
            let steps = LatticePoint::new(i & 1, i >> 1 & 1, i >> 2 & 1) << grain;
            let corner = low + LatticePoint::select(at.cmpne(low), steps, LatticePoint::ZERO);
            (quadric.at(local(corner, self.center)), corner)
        });
        corners.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.to_array().cmp(&b.1.to_array())));
        if let Some(&(_, to)) = corners.iter().find(|c| self.may_settle(p, c.1)) {
            self.occupied.remove(&at);
            self.occupied.insert(to, p);
            let to_local = local(to, self.center);
            let point = &mut self.points[p as usize];
            (point.at, point.local) = (to, to_local);
        }
    }

    /// Whether a point may lie there: nothing else does, and no triangle turns over or loses its area.
    fn may_settle(&self, p: u32, to: LatticePoint) -> bool {
        to.to_array().iter().all(|x| (0..=MAX_COORDINATE).contains(x))
            && self.occupied.get(&to).is_none_or(|other| *other == p)
            && self.corners_at(p).all(|c| {
                let [q, r] = self.others(c);
                self.keeps_shape(p, q, r, local(to, self.center))
            })
    }
}

#[cfg(test)]
mod tests {
    use crate::precision::Precision;
    use crate::simplify::{Purpose, simplify};
    use kilwa_geometry::{LatticePoint, Mesh};
    use rustc_hash::FxHashSet;
    use std::collections::BTreeMap;

    /// A sheet of `n` by `n` quads of 512 steps at odd places, `rough` steps high.
    fn sheet(n: i32, rough: i32) -> Mesh {
        let mut m = Mesh::default();
        for y in 0..=n {
            for x in 0..=n {
                // A Weyl sequence with its high bits: as good as noise here.
                let z = ((x as u32 * 25 + y as u32).wrapping_mul(0x9E37_79B1) >> 12) as i32 % rough.max(1);
                m.positions.push(LatticePoint::new(x * 512 + 1001, y * 512 + 2001, 5001 + z / 2 * 2));
                m.normals.push([0, 0]);
            }
        }
        let w = n as u32 + 1;
        for i in 0..n as u32 * w {
            let (x, y) = (i % w, i / w);
            if x < n as u32 {
                m.triangles.extend([[i, i + 1, i + w], [i + 1, i + w + 1, i + w]]);
                let last = n as u32 - 1;
                let (left, right) = (u8::from(x == 0) << 2, u8::from(x == last));
                let (bottom, top) = (u8::from(y == 0), u8::from(y == last) << 1);
                m.borders.extend([left | bottom, right | top]);
            }
        }
        m
    }

    /// Vertices that the fine mesh does not have, by the zeros at the end of their places.
    fn zeros(coarse: &Mesh, fine: &Mesh) -> BTreeMap<u32, usize> {
        let there: FxHashSet<LatticePoint> = fine.positions.iter().copied().collect();
        let mut zeros = BTreeMap::new();
        for p in coarse.positions.iter().filter(|p| !there.contains(*p)) {
            *zeros.entry((p[0] | p[1] | p[2]).trailing_zeros()).or_insert(0) += 1;
        }
        zeros
    }

    #[test]
    fn new_positions_are_rounded_more_coarsely_where_the_surface_is_rougher() {
        let mut last = 0;
        for rough in [17, 67, 257] {
            let fine = sheet(24, rough);
            let coarse = simplify(&fine, &FxHashSet::default(), 200, Purpose::Level(Precision::default())).mesh;
            let zeros = zeros(&coarse, &fine);
            let all: usize = zeros.values().sum();
            // The grain of the sheet: most have just it, by chance some have more; few were refused it.
            let (&grain, _) = zeros.iter().max_by_key(|(_, n)| **n).unwrap();
            assert!(grain > last, "{rough}: {zeros:?}");
            let finer: usize = zeros.range(..grain).map(|(_, n)| n).sum();
            assert!(finer * 20 <= all, "{rough}: {zeros:?}");
            assert!(1 << grain <= rough, "{rough}: {zeros:?}");
            last = grain;
        }
    }

    #[test]
    fn locked_positions_do_not_move_and_a_plane_stays_flat() {
        let fine = sheet(24, 257);
        let locked: FxHashSet<LatticePoint> = fine.positions.iter().copied().filter(|p| p[0] < 3000).collect();
        let coarse = simplify(&fine, &locked, 300, Purpose::Level(Precision::default())).mesh;
        assert!(locked.iter().all(|p| coarse.positions.contains(p)));
        let coarse = simplify(&sheet(24, 0), &FxHashSet::default(), 200, Purpose::Level(Precision::default())).mesh;
        assert!(coarse.positions.iter().all(|p| p[2] == 5001), "a plane has no roughness to hide a step in");
    }
}
