//! Areas of triangle sets: along the surface, and in plan. Two numbers, never one for the other: a wall has much of the
//! first and almost none of the second. Of a drawn polygon there is a third: in the plane that fits its corners.

use crate::leaves::finest_triangles;
use crate::plane::{Plane, PlaneFit};
use crate::polygon::{is_simple, signed_area};
use crate::refusal::{Refusal, at_least};
use crate::region::Region;
use crate::roughness::{added_area, variance};
use crate::space::Space;
use crate::sum::Sum;
use glam::{DVec2, DVec3};
use kilwa_pack::Chunk;
use serde::Serialize;

/// Areas of a surface that is summed up triangle by triangle, in the square of the unit of the triangles.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Areas {
    surface: Sum,
    plan: Sum,
    spread: [Sum; 2],
    triangles: u64,
    edges: Sum,
    roughness: Roughness,
}

/// What the roughness of a surface from vertex to vertex adds to its area: see [`crate::roughness`].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Roughness {
    added: Sum,
    /// Of the variance of the heights of vertices, weighted by area.
    variance: Sum,
}

impl Areas {
    /// Add one triangle; its area.
    pub fn add(&mut self, triangle: [DVec3; 3]) -> f64 {
        self.count(triangle);
        self.add_part(triangle)
    }

    fn count(&mut self, [a, b, c]: [DVec3; 3]) {
        self.triangles += 1;
        self.edges.add((b - a).length() + (c - b).length() + (a - c).length());
    }

    /// Add the finest triangles of a chunk, or their parts inside a region, in metres, with what their roughness adds.
    pub fn add_chunk(&mut self, chunk: &Chunk, space: &Space, region: Option<&Region>) {
        let variance = variance(chunk) * space.step() * space.step();
        for t in finest_triangles(chunk) {
            let triangle = chunk.mesh.corners(t).map(|p| space.local_from_lattice(p));
            let part = match region {
                Some(region) => self.add_clipped(triangle, region),
                None => self.add(triangle),
            };
            if part > 0.0 {
                let [a, b, c] = triangle;
                let whole = (b - a).cross(c - a).length() * 0.5;
                self.roughness.added.add(added_area(triangle, variance) * (part / whole));
                self.roughness.variance.add(variance * part);
            }
        }
    }

    fn add_part(&mut self, [a, b, c]: [DVec3; 3]) -> f64 {
        let n = (b - a).cross(c - a);
        let area = n.length() * 0.5;
        self.surface.add(area);
        self.plan.add(n[2].abs() * 0.5);
        // A corner that moves across the opposite side of length l changes the area by l / 2 for each unit.
        for (p, q) in [(a, b), (b, c), (c, a)] {
            let d = q - p;
            self.spread[0].add(d.length_squared() * 0.25);
            self.spread[1].add((d[0] * d[0] + d[1] * d[1]) * 0.25);
        }
        area
    }

    /// Add the part of a triangle inside a region; its area.
    pub fn add_clipped(&mut self, triangle: [DVec3; 3], region: &Region) -> f64 {
        let [u, v] = region.plane().axes();
        let n = region.plane().normal;
        let (mut met, mut area) = (false, 0.0);
        region.clip(triangle, |part| {
            met = true;
            // Back from the plane's coordinates: only directions matter for areas.
            let world = |p: DVec3| u * p.x + v * p.y + n * p.z;
            for i in 1..part.len() - 1 {
                area += self.add_part([world(part[0]), world(part[i]), world(part[i + 1])]);
            }
        });
        if met {
            self.count(triangle);
        }
        area
    }

    /// Add another sum; in a fixed order the result is the same for any number of threads.
    pub fn join(&mut self, other: &Self) {
        self.surface.join(&other.surface);
        self.plan.join(&other.plan);
        self.spread.iter_mut().zip(&other.spread).for_each(|(a, b)| a.join(b));
        self.triangles += other.triangles;
        self.edges.join(&other.edges);
        self.roughness.added.join(&other.roughness.added);
        self.roughness.variance.join(&other.roughness.variance);
    }

    /// Along the surface.
    pub fn surface(&self) -> f64 {
        self.surface.value()
    }

    /// Projected to the horizontal plane, both sides counted (a roof over a floor counts twice).
    pub fn plan(&self) -> f64 {
        self.plan.value()
    }

    /// The factor by which the standard uncertainty of a coordinate is multiplied to give that of [`Areas::surface`] and of
    /// [`Areas::plan`]: as if every corner of every triangle erred by itself, which is more than where neighbours share it.
    pub fn spread(&self) -> [f64; 2] {
        self.spread.map(|s| libm::sqrt(s.value()))
    }

    /// Triangles that count, whole or in part.
    pub fn triangles(&self) -> u64 {
        self.triangles
    }

    /// The mean length of an edge of these triangles; zero without any.
    pub fn spacing(&self) -> f64 {
        if self.triangles == 0 { 0.0 } else { self.edges.value() / (3.0 * self.triangles as f64) }
    }

    /// What the roughness from vertex to vertex adds to [`Areas::surface`], if it is noise; of what was added chunk by chunk.
    pub fn added_by_roughness(&self) -> f64 {
        self.roughness.added.value()
    }

    /// The standard deviation of the heights of vertices from one to the next.
    pub fn roughness(&self) -> f64 {
        let area = self.surface();
        if area > 0.0 { libm::sqrt(self.roughness.variance.value() / area) } else { 0.0 }
    }
}

/// Areas of a polygon given by its corners.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PolygonArea {
    /// In the plane fitted to the corners.
    pub fitted: f64,
    /// In the horizontal plane.
    pub plan: f64,
    /// Length round it, from corner to corner.
    pub perimeter: f64,
    /// The fitted plane, and how far the corners are from it.
    pub plane: PlaneFit,
}

impl PolygonArea {
    /// Of corners in order.
    ///
    /// # Errors
    /// [`Refusal`] for fewer than three corners, corners on a line, and sides that cross in the fitted plane.
    pub fn of(points: &[DVec3]) -> Result<Self, Refusal> {
        at_least("an area", 3, points)?;
        let plane = Plane::fit(points)?;
        let outline: Vec<DVec2> = points.iter().map(|p| plane.plane.coordinates(*p)).collect();
        if !is_simple(&outline) {
            return Err(Refusal::Crossing);
        }
        let level: Vec<DVec2> = points.iter().map(|p| (*p - points[0]).truncate()).collect();
        let side = |i: usize| {
            let d = points[(i + 1) % points.len()] - points[i];
            d.length()
        };
        Ok(Self {
            fitted: signed_area(&outline).abs(),
            plan: signed_area(&level).abs(),
            perimeter: (0..points.len()).map(side).sum(),
            plane,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_upright_wall_has_its_full_surface_area_and_no_plan_area() {
        let mut a = Areas::default();
        a.add([DVec3::ZERO, DVec3::new(4.0, 0.0, 0.0), DVec3::new(4.0, 0.0, 3.0)]);
        a.add([DVec3::ZERO, DVec3::new(4.0, 0.0, 3.0), DVec3::new(0.0, 0.0, 3.0)]);
        assert_eq!((a.surface(), a.plan(), a.triangles()), (12.0, 0.0, 2));
        let p = PolygonArea::of(&[
            DVec3::ZERO,
            DVec3::new(4.0, 0.0, 0.0),
            DVec3::new(4.0, 0.0, 3.0),
            DVec3::new(0.0, 0.0, 3.0),
        ])
        .unwrap();
        assert!((p.fitted - 12.0).abs() < 1e-12 && p.plan.abs() < 1e-12 && (p.perimeter - 14.0).abs() < 1e-12, "{p:?}");
    }

    #[test]
    fn a_ramp_of_sixty_degrees_has_twice_its_plan_area_and_a_region_cuts_it_exactly() {
        let rise = 3f64.sqrt();
        let (a, b, c, d) = (DVec3::ZERO, DVec3::new(1.0, 0.0, rise), DVec3::new(1.0, 1.0, rise), DVec3::Y);
        let mut whole = Areas::default();
        whole.add([a, b, c]);
        whole.add([a, c, d]);
        assert!((whole.surface() - 2.0).abs() < 1e-12 && (whole.plan() - 1.0).abs() < 1e-12);
        let floor = Plane::new(DVec3::ZERO, DVec3::Z).unwrap();
        let corners = [
            DVec3::new(0.25, 0.25, 0.0),
            DVec3::new(0.75, 0.25, 0.0),
            DVec3::new(0.75, 0.75, 0.0),
            DVec3::new(0.25, 0.75, 0.0),
        ];
        let region = Region::new(floor, &corners, 10.0).unwrap();
        let mut part = Areas::default();
        part.add_clipped([a, b, c], &region);
        part.add_clipped([a, c, d], &region);
        assert!((part.surface() - 0.5).abs() < 1e-12 && (part.plan() - 0.25).abs() < 1e-12, "{part:?}");
        assert_eq!(part.triangles(), 2);
    }
}
