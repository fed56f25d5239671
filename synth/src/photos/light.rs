//! Light on the fort: a sun that moves while the photographs are taken, and the sky.
//!
//! Light is a factor for the reflectance of a surface (irradiance divided by π): about 1 on ground in the sun. The sun's share is `SUN · cos θ`
//! where masonry does not shade it. The sky's share comes from a lattice of nodes 0.5 m apart. From each node, 24 rays above the horizon show
//! where the sky is free and where masonry reflects light; below the horizon the ground reflects. The light of a node is kept as its mean and its gradient
//! (spherical harmonics of degree 1), which gives the irradiance on any slope (Ramamoorthi and Hanrahan, "An efficient representation for
//! irradiance environment maps", SIGGRAPH 2001). Between nodes it is interpolated, so walls thinner than 0.5 m can let light through.

use crate::fort::scene::Scene;
use glam::{DVec3, IVec3};
use std::array::from_fn;
use std::sync::OnceLock;

/// Sunlight at normal incidence, light from an open sky on level ground, and reflected light, in linear red, green and
/// blue.
const SUN: [f64; 3] = [0.84, 0.80, 0.72];
const SKY: [f64; 3] = [0.27, 0.30, 0.345];
const REFLECTED: [f64; 3] = [0.125, 0.11, 0.09];
/// Latitude of the site, and the sun's declination (in December), in degrees.
const LATITUDE: f64 = -8.96;
const DECLINATION: f64 = -23.4;
/// Local solar time in the middle of the session, in hours.
pub(super) const MIDDLE: f64 = 9.0;
/// Reach of the differences that the normal is made of, in metres: light does not show finer relief.
pub(super) const RELIEF: f64 = 0.02;

/// The lattice: spacing, first node and number of nodes.
const SPACING: f64 = 0.5;
const FIRST: DVec3 = DVec3::new(-28.5, -28.5, -5.5);
const NODES: IVec3 = IVec3::new(115, 115, 39);
/// Rays over the whole sphere; the half above the horizon is traced.
const RAYS: u32 = 48;
/// The sky's light is looked up this far in front of the surface, in metres.
const BEFORE: f64 = 0.25;

/// Where the sun is at a time of day (local solar time in hours): azimuth from north over east and elevation, in radians.
pub(super) fn sun_at(hour: f64) -> (f64, f64) {
    let (sl, cl) = libm::sincos(LATITUDE.to_radians());
    let (sd, cd) = libm::sincos(DECLINATION.to_radians());
    let (sh, ch) = libm::sincos((hour - 12.0) * std::f64::consts::PI / 12.0);
    // East, north, up.
    let direction = DVec3::new(-cd * sh, cl * sd - sl * cd * ch, sl * sd + cl * cd * ch);
    (libm::atan2(direction.x, direction.y), libm::asin(direction.z.clamp(-1.0, 1.0)))
}

/// The direction to the sun, unit, in the site's frame.
pub(super) fn towards((azimuth, elevation): (f64, f64)) -> DVec3 {
    let ((s, c), (up, flat)) = (libm::sincos(azimuth), libm::sincos(elevation));
    DVec3::new(s * flat, c * flat, up)
}

/// Sky and reflected light around a node, each as mean and gradient; nothing where the node is in masonry or in the ground.
type Node = Option<[[f32; 4]; 2]>;

/// The sky over the fort. Nodes are made when they are first needed.
pub(super) struct Sky {
    nodes: Box<[OnceLock<Node>]>,
}

impl Sky {
    pub(super) fn new() -> Self {
        Self { nodes: (0..NODES.x * NODES.y * NODES.z).map(|_| OnceLock::new()).collect() }
    }

    /// Light from the sky and reflected light on a point of the surface with a normal, in the fort's frame.
    fn light(&self, scene: &Scene, p: DVec3, normal: DVec3) -> [f64; 3] {
        let at = (p + normal * BEFORE - FIRST) / SPACING;
        let low = at.floor().as_ivec3().clamp(IVec3::ZERO, NODES - 2);
        let share = (at - low.as_dvec3()).clamp(DVec3::ZERO, DVec3::ONE);
        let (mut sum, mut weights) = ([[0.0; 4]; 2], 0.0);
        for corner in 0..8 {
            let step = IVec3::new(corner & 1, corner >> 1 & 1, corner >> 2);
            let along = |k: usize| if step[k] == 1 { share[k] } else { 1.0 - share[k] };
            let weight = along(0) * along(1) * along(2);
            let node = if weight > 0.0 { self.node(scene, low + step) } else { None };
            if let Some(node) = node {
                weights += weight;
                for (sums, values) in sum.iter_mut().zip(node) {
                    for (sum, value) in sums.iter_mut().zip(values) {
                        *sum += weight * f64::from(value);
                    }
                }
            }
        }
        // A place whose neighbourhood is all masonry sees little.
        let irradiance = |[mean, x, y, z]: [f64; 4]| {
            if weights < 1e-6 { 0.3 } else { ((mean + 2.0 * DVec3::new(x, y, z).dot(normal)) / weights).max(0.05) }
        };
        let [sky, reflected] = sum.map(irradiance);
        from_fn(|k| SKY[k] * sky + REFLECTED[k] * reflected)
    }

    fn node(&self, scene: &Scene, at: IVec3) -> Node {
        let index = ((at.x * NODES.y + at.y) * NODES.z + at.z) as usize;
        *self.nodes[index].get_or_init(|| look(scene, FIRST + at.as_dvec3() * SPACING))
    }
}

/// Look around from a node.
fn look(scene: &Scene, p: DVec3) -> Node {
    if scene.masonry_distance(p) <= 0.0 || p.z <= scene.ground(p.x, p.y) {
        return None;
    }
    let mut sums = [[0.0_f64; 4]; 2];
    for k in 0..RAYS {
        // A spiral on the sphere: equal areas, turned by the golden angle.
        let z = 1.0 - 2.0 * (f64::from(k) + 0.5) / f64::from(RAYS);
        let (s, c) = libm::sincos(f64::from(k) * 2.399_963_229_728_653);
        let flat = (1.0 - z * z).sqrt();
        let d = DVec3::new(c * flat, s * flat, z);
        let is_free = z > 0.0 && !scene.is_shaded(p, DVec3::ZERO, d);
        // Brighter towards the horizon; together 1 on level ground.
        let light = if is_free { 1.24 - 0.36 * z } else { 1.0 };
        let sum = &mut sums[usize::from(!is_free)];
        for (sum, value) in sum.iter_mut().zip([1.0, d.x, d.y, d.z]) {
            *sum += light * value / f64::from(RAYS);
        }
    }
    Some(sums.map(|sum| sum.map(|value| value as f32)))
}

/// Light on a place of the surface with a normal while the sun is in a direction, all in the fort's frame.
pub(super) fn light(scene: &Scene, sky: &Sky, p: DVec3, normal: DVec3, sun: DVec3) -> [f64; 3] {
    let facing = normal.dot(sun);
    let direct = if facing > 0.0 && !scene.is_shaded(p, normal, sun) { facing } else { 0.0 };
    let around = sky.light(scene, p, normal);
    from_fn(|k| SUN[k] * direct + around[k])
}

/// What is behind everything: the sky, and below the horizon land and sea in haze. Linear; `d` in the site's frame.
pub(super) fn backdrop(d: DVec3, sun: DVec3) -> [f64; 3] {
    let up = d.z.max(0.0);
    let haze = (1.0 - up) * (1.0 - up);
    let glow = d.dot(sun).max(0.0);
    let glow = 0.25 * glow * glow * glow * glow;
    if d.z >= 0.0 {
        let [zenith, horizon] = [[0.16, 0.27, 0.52], [0.52, 0.60, 0.68]];
        from_fn(|k| zenith[k] + (horizon[k] - zenith[k]) * haze + glow)
    } else {
        let far = (1.0 + 6.0 * d.z).max(0.0);
        let [near, horizon] = [[0.10, 0.16, 0.17], [0.42, 0.48, 0.52]];
        from_fn(|k| near[k] + (horizon[k] - near[k]) * far * far)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sun_rises_in_the_east_and_stands_in_the_south_at_noon() {
        let (azimuth, elevation) = sun_at(7.0);
        assert!(azimuth.to_degrees() > 90.0 && azimuth.to_degrees() < 125.0, "{}", azimuth.to_degrees());
        assert!(elevation > 0.0 && elevation < sun_at(9.0).1);
        let (azimuth, elevation) = sun_at(12.0);
        assert!((azimuth.to_degrees().abs() - 180.0).abs() < 1e-6);
        assert!((elevation.to_degrees() - (90.0 - 23.4 + 8.96)).abs() < 1e-6);
        assert!((towards(sun_at(10.0)).length() - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_room_is_darker_than_the_open_and_a_slope_to_the_sky_brighter_than_one_to_the_ground() {
        let (scene, sky) = (Scene::new(1), Sky::new());
        let open = DVec3::new(0.0, -20.0, scene.ground(0.0, -20.0));
        let green = |p, n| sky.light(&scene, p, n)[1];
        let up = green(open, DVec3::Z);
        assert!(up > 0.25 && up < 0.36, "{up}");
        // A vault of the round tower.
        let room = DVec3::new(12.4, -10.8, 0.15);
        assert!(green(room, DVec3::Z) < 0.6 * up);
        assert!(green(open + DVec3::Z * 3.0, -DVec3::Z) < 0.5 * up);
    }
}
