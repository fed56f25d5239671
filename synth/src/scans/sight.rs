//! What the stations of a simulated survey can see, from the field that they were traced against: the truth for holes of a merged surface.

use super::figures;
use super::instrument::{LOWEST_ELEVATION, MIN_RANGE};
use super::props::Props;
use super::stations::{self, Station};
use crate::fort::scene::{Beam, Scene};
use glam::DVec3;

/// Visibility is tested at points this far in front of a surface, metres, because rays end slightly in front of what they hit.
const BEFORE: f64 = 0.004;
/// Spacing of the places at which the field is evaluated along a line, metres.
const STEP: f64 = 0.01;
/// Cosine of the largest incidence at which a surface is meshed.
const FLATTEST: f64 = 0.052;

/// A place of the true surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePlace {
    /// In the site's frame, metres.
    pub position: DVec3,
    /// Outward unit normal.
    pub normal: DVec3,
}

/// The fort and the stations of a survey without walkers, grass and scaffolding. Coordinates are those of the site (without the origin of map coordinates).
pub struct Sight {
    scene: Scene,
    bars: Props,
    stations: Vec<Station>,
}

impl Sight {
    /// The fort with this seed and this number of stations, as `kilwa synth scans` places them.
    pub fn new(seed: u64, stations: u32) -> Self {
        let scene = Scene::new(seed);
        let stations = stations::stations(&scene, seed, stations);
        let bars = Props::new(figures::grilles(&scene));
        Self { scene, bars, stations }
    }

    /// Whether any station has a line of sight to a place, within its field of view and its range.
    pub fn is_in_sight(&self, place: DVec3) -> bool {
        self.stations.iter().any(|station| self.sees(station, place))
    }

    fn sees(&self, station: &Station, place: DVec3) -> bool {
        let offset = place - station.position;
        let range = offset.length();
        if range < MIN_RANGE || range > station.instrument.max_range {
            return false;
        }
        let elevation = (station.rotation.transpose() * offset).z / range;
        if elevation < LOWEST_ELEVATION.to_radians().sin() {
            return false;
        }
        let (eye, d) = (Scene::from_site(station.position), Scene::from_site(offset / range));
        let mut near = Vec::new();
        self.bars.near(eye, d, range, Beam { exit: 0.0, spread: 0.0 }, &mut near);
        let is_barred = near.iter().any(|bar| self.bars.get(*bar).shape.meet(eye, d).is_some_and(|t| t < range));
        !is_barred && self.scene.hit(eye, d, 0.0, range).is_none()
    }

    /// Whether any station has a line of sight to a place of the surface.
    pub fn is_visible(&self, place: &SurfacePlace) -> bool {
        let before = place.position + place.normal * BEFORE;
        self.stations
            .iter()
            .any(|station| (station.position - place.position).dot(place.normal) > 0.0 && self.sees(station, before))
    }

    /// Whether a station with a line of sight to a place of the surface, at an incidence of less than 87°, sampled it in a survey with `columns` columns: one of the
    /// four rays of its grid around the place meets the surface at most `reach` metres away from it. Otherwise the place lies between its rays.
    pub fn is_sampled(&self, place: &SurfacePlace, columns: u32, reach: f64) -> bool {
        let before = place.position + place.normal * BEFORE;
        self.stations.iter().any(|station| {
            let offset = station.position - place.position;
            let is_facing = offset.dot(place.normal) > FLATTEST * offset.length();
            is_facing && self.sees(station, before) && self.samples(station, place, columns, reach)
        })
    }

    fn samples(&self, station: &Station, place: &SurfacePlace, columns: u32, reach: f64) -> bool {
        let (width, height) = station.instrument.grid(columns);
        let angle = std::f64::consts::TAU / f64::from(width);
        let lowest = LOWEST_ELEVATION.to_radians();
        let step = (90.0 - LOWEST_ELEVATION).to_radians() / f64::from(height - 1);
        let local = station.rotation.transpose() * (place.position - station.position).normalize_or_zero();
        let column = (libm::atan2(local.y, local.x) / angle).floor();
        let row = ((libm::asin(local.z.clamp(-1.0, 1.0)) - lowest) / step).floor();
        (0..4).any(|k| {
            let (s, c) = libm::sincos((column + f64::from(k & 1)) * angle);
            let (up, flat) = libm::sincos(lowest + (row + f64::from(k >> 1)) * step);
            let d = station.rotation * DVec3::new(c * flat, s * flat, up);
            let far = station.instrument.max_range;
            let hit = self.scene.hit(Scene::from_site(station.position), Scene::from_site(d), 0.0, far);
            hit.is_some_and(|hit| (station.position + d * hit.t).distance(place.position) <= reach)
        })
    }

    /// The places where a line crosses the surface from outside to inside against `normal`, at most `reach` metres before or behind `place`; the nearest first.
    pub fn surfaces_at(&self, place: DVec3, normal: DVec3, reach: f64) -> Vec<SurfacePlace> {
        let (p, n) = (Scene::from_site(place), Scene::from_site(normal));
        let steps = (reach / STEP).ceil().max(1.0) as i64;
        let at = |k: i64| reach * k as f64 / steps as f64;
        let value = |t: f64| self.scene.value(p + n * t);
        let mut found = Vec::new();
        let mut outer = value(at(steps));
        for k in (-steps..steps).rev() {
            let inner = value(at(k));
            if outer > 0.0 && inner <= 0.0 {
                found.push(self.between(p, n, at(k), at(k + 1)));
            }
            outer = inner;
        }
        found.sort_by(|a, b| a.position.distance(place).total_cmp(&b.position.distance(place)));
        found
    }

    /// The surface between a place inside and one outside of it, both on one line in the fort's frame.
    fn between(&self, p: DVec3, n: DVec3, mut inside: f64, mut outside: f64) -> SurfacePlace {
        for _ in 0..16 {
            let middle = f64::midpoint(inside, outside);
            if self.scene.value(p + n * middle) > 0.0 { outside = middle } else { inside = middle }
        }
        let at = p + n * outside;
        let normal = self.scene.normal(at, self.scene.is_ground(at), 2.0 * BEFORE);
        SurfacePlace { position: Scene::to_site(at), normal: Scene::to_site(normal) }
    }

    /// All places where a line from `from` to `to` crosses the surface. Of lines that are spread evenly over positions and directions, the crossings are
    /// spread evenly over the surface (Cauchy and Crofton).
    pub fn crossings(&self, from: DVec3, to: DVec3) -> Vec<SurfacePlace> {
        let (o, length) = (Scene::from_site(from), from.distance(to));
        let d = Scene::from_site((to - from) / length);
        let steps = (length / (2.0 * STEP)).ceil().max(1.0) as u64;
        let at = |k: u64| length * k as f64 / steps as f64;
        let mut out = Vec::new();
        let mut before = self.scene.value(o) > 0.0;
        for k in 1..=steps {
            let is_out = self.scene.value(o + d * at(k)) > 0.0;
            if is_out != before {
                let (inside, outside) = if is_out { (at(k - 1), at(k)) } else { (at(k), at(k - 1)) };
                out.push(self.between(o, d, inside, outside));
            }
            before = is_out;
        }
        out
    }
}
