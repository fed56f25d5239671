//! The fort as simulated scans see it: masonry ([`super::distance`]) and ground ([`super::terrain`]), with the colours of their materials.
//!
//! It has the plan, the ruin and the ground of the fort that `kilwa synth fort` makes of the same seed. Different are the relief of the masonry,
//! whose steps are drawn out into slopes, and thin walls that only the scans have; the faults that the mesh copies from real surveys
//! (holes, islands, noise) are not there, since scans make their own.

pub(crate) use super::distance::Beam;
use super::distance::{Masonry, Met, Until};
use super::field::Distance;
use super::ground::Ground;
use super::paint::{self, Spot};
pub(crate) use super::plan::{DRUM, GATE_X, HALF_X, HALF_Y, KEEP};
pub(crate) use super::terrain::HALF;
use super::terrain::Terrain;
use super::{TURN, fort_from_site};
use crate::noise::derive;
use glam::DVec3;

/// Colours show what a sampling this many metres apart would.
const DETAIL: f64 = 0.02;

/// The fort and its ground, in the fort's frame: metres, z up.
pub(crate) struct Scene {
    seed: u64,
    masonry: Masonry,
    terrain: Terrain,
}

/// A place of the surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Hit {
    /// Distance along the ray, in metres.
    pub(crate) t: f64,
    /// On the ground, not on masonry.
    pub(crate) on_ground: bool,
}

impl Scene {
    /// The fort of a seed.
    pub(crate) fn new(seed: u64) -> Self {
        let seed = derive(seed, super::SALT);
        let masonry = Masonry::new(seed);
        let terrain = Terrain::new(seed, &masonry);
        Self { seed, masonry, terrain }
    }

    /// The fort's frame from the site's, in which meshes and poses are.
    pub(crate) fn from_site(p: DVec3) -> DVec3 {
        fort_from_site(p)
    }

    /// The site's frame from the fort's.
    pub(crate) fn to_site(p: DVec3) -> DVec3 {
        let [c, s] = TURN;
        DVec3::new(c * p.x - s * p.y, s * p.x + c * p.y, p.z)
    }

    /// The first surface that a ray (origin, unit direction) meets between two distances.
    pub(crate) fn hit(&self, o: DVec3, d: DVec3, from: f64, to: f64) -> Option<Hit> {
        let ground = match self.terrain.meet(o, d, from, to, None) {
            Met::Surface(t) | Met::Close(t) => Some(t),
            Met::Nothing => None,
        };
        match self.masonry.meet(o, d, from, ground.unwrap_or(to), Until::Surface) {
            Met::Surface(t) | Met::Close(t) => Some(Hit { t, on_ground: false }),
            Met::Nothing => ground.map(|t| Hit { t, on_ground: true }),
        }
    }

    /// How far a beam goes without touching anything; at most `to`.
    pub(crate) fn clear(&self, o: DVec3, d: DVec3, to: f64, beam: Beam) -> f64 {
        let until = |met, to| match met {
            Met::Surface(t) | Met::Close(t) => t,
            Met::Nothing => to,
        };
        let to = until(self.terrain.meet(o, d, 0.0, to, Some(beam)), to);
        until(self.masonry.meet(o, d, 0.0, to, Until::Beam(beam)), to)
    }

    /// Whether masonry stands between a place of the surface and the sun, or other light from a direction.
    pub(crate) fn is_shaded(&self, p: DVec3, normal: DVec3, light: DVec3) -> bool {
        self.masonry.meet(p + normal * 0.15, light, 0.05, 60.0, Until::Smooth) != Met::Nothing
    }

    /// The field: positive outside, zero on the surface. About the distance near masonry, the height above the ground near that.
    pub(crate) fn value(&self, p: DVec3) -> f64 {
        self.masonry.value(p).min(p.z - self.terrain.height(p.x, p.y))
    }

    /// The field of the ground or of the masonry alone.
    pub(crate) fn value_of(&self, p: DVec3, on_ground: bool) -> f64 {
        if on_ground { p.z - self.terrain.height(p.x, p.y) } else { self.masonry.value(p) }
    }

    /// About how far a place is from the surface, on either side.
    #[cfg(test)]
    pub(super) fn off_surface(&self, p: DVec3) -> f64 {
        let ground = (p.z - self.terrain.height(p.x, p.y)).abs();
        let slope = (self.normal(p, true, 0.05).z).abs();
        self.masonry.value(p).abs().min(ground * slope)
    }

    /// Whether the surface is outside a ball, or the ball is below the ground.
    pub(crate) fn is_clear(&self, middle: DVec3, radius: f64) -> bool {
        self.terrain.misses(middle, radius)
            && (self.masonry.misses(middle, radius) || middle.z < self.terrain.height(middle.x, middle.y))
    }

    /// Whether the ground is nearer than masonry, at a place of the surface.
    pub(crate) fn is_ground(&self, p: DVec3) -> bool {
        p.z - self.terrain.height(p.x, p.y) < self.masonry.value(p)
    }

    /// Height of the ground.
    pub(crate) fn ground(&self, x: f64, y: f64) -> f64 {
        self.terrain.height(x, y)
    }

    /// A lower bound of the distance to the masonry, at most 0.3 m, negative inside; 1-Lipschitz.
    pub(crate) fn masonry_distance(&self, p: DVec3) -> f64 {
        self.masonry.distance(p)
    }

    /// Outward unit normal of the surface, from differences over `reach` metres.
    pub(crate) fn normal(&self, p: DVec3, on_ground: bool, reach: f64) -> DVec3 {
        let value = |q: DVec3| self.value_of(q, on_ground);
        // The corners of a tetrahedron (Quilez, "Normals for an SDF").
        let corners = [(1.0, -1.0, -1.0), (-1.0, -1.0, 1.0), (-1.0, 1.0, -1.0), (1.0, 1.0, 1.0)];
        let sum = corners.into_iter().map(|k| DVec3::from(k) * value(p + DVec3::from(k) * reach)).sum::<DVec3>();
        sum.normalize_or(DVec3::Z)
    }

    /// Colour of the material at a place of the surface, sRGB from 0 to 255.
    pub(crate) fn albedo(&self, p: DVec3, normal: DVec3, on_ground: bool) -> [f64; 3] {
        let height = self.terrain.height(p.x, p.y);
        let above = (p.z - height).max(0.0);
        // High on a wall nothing but the ground's height matters.
        let ground =
            if on_ground || above < 0.3 { self.terrain.look(p.x, p.y) } else { Ground { height, ..Ground::default() } };
        let (walls, above) = if on_ground { (self.masonry.distance(p).max(0.0), 0.0) } else { (0.0, above) };
        let distance = Distance { walls, ground: above, crumbs: f64::MAX, all: 0.0 };
        paint::albedo(self.seed, DETAIL, &Spot { p, normal, distance, ground, hash: 0 })
    }
}
