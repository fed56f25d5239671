//! One sample: several rays across the beam, their returns, and what the instrument reports of them.

use super::Class;
use super::instrument::{Instrument, MIN_RANGE, Returns};
use super::props::Props;
use crate::fort::scene::{Hit, Scene};
use crate::noise::{hash3, mix, normal as gauss, smooth, unit};
use glam::DVec3;

/// A sample of a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Where it is in the scan's frame, in metres; nothing where nothing was measured.
    pub point: Option<DVec3>,
    /// Intensity, from 0 to 1.
    pub intensity: f64,
    /// sRGB.
    pub color: [u8; 3],
    /// What it truly is.
    pub class: Class,
}

impl Sample {
    /// A sample without a point.
    pub(super) fn none(class: Class) -> Self {
        Self { point: None, intensity: 0.5, color: [0; 3], class }
    }
}

/// Rays of a beam: one along the axis and a ring of six at this share of its radius, with their shares of the light (a Gaussian profile).
const RING: usize = 6;
const RING_RADIUS: f64 = 0.72;
const AXIS_LIGHT: f64 = 0.28;
const RING_LIGHT: f64 = 0.12;
/// A group of returns with less light than this is not noticed.
const NOTICED: f64 = 0.11;
/// Returns that lie further apart along the beam than this, and than the tilt of the surface explains, are of different surfaces; in metres.
const APART: f64 = 0.012;
/// Direction to the sun, in the fort's frame.
const SUN: DVec3 = DVec3::new(-0.480_414_295_761_445_9, -0.560_483_345_055_020_3, 0.674_581_740_298_363_7);
const SKY_LIGHT: f64 = 0.42;
const SUN_LIGHT: f64 = 0.62;
/// Share of samples that are lost for no reason.
const LOST: f64 = 0.000_4;
/// Range at which intensity has fallen to half of what the material would give, in metres.
const HALF_INTENSITY: f64 = 60.0;

/// What comes back from a direction, before any noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Echo {
    /// Distance, in metres.
    pub(super) range: f64,
    /// Cosine of the angle of incidence.
    pub(super) cosine: f64,
    /// Light that comes back, as a share of that from a white surface, upright at 20 m.
    pub(super) signal: f64,
    /// Intensity, from 0 to 1.
    pub(super) intensity: f64,
    /// sRGB, from 0 to 255.
    pub(super) color: [f64; 3],
    /// What it truly is.
    pub(super) class: Class,
}

/// What a beam met.
#[derive(Debug, Clone, Copy)]
struct Return {
    t: f64,
    light: f64,
    on_axis: bool,
    what: What,
    /// The normal of the surface, if it is known already.
    normal: Option<DVec3>,
}

#[derive(Debug, Clone, Copy)]
enum What {
    Fort(Hit),
    Prop(u32),
}

/// What all samples of a station share.
pub(super) struct Shot<'a> {
    pub(super) scene: &'a Scene,
    pub(super) props: &'a Props,
    pub(super) instrument: &'a Instrument,
    pub(super) returns: Returns,
    /// What the noise of ranges and intensities is multiplied by.
    pub(super) noise: f64,
    /// The instrument, in the fort's frame.
    pub(super) eye: DVec3,
    /// Seed of the station.
    pub(super) seed: u64,
}

/// Buffers that are used again.
#[derive(Default)]
pub(super) struct Scratch {
    near: Vec<u32>,
    returns: Vec<Return>,
}

impl Shot<'_> {
    /// What comes back from a direction (unit, in the fort's frame), before any noise; nothing if nothing is in range.
    pub(super) fn echo(&self, d: DVec3, scratch: &mut Scratch) -> Option<Echo> {
        self.trace(d, scratch);
        let (first, last) = self.reported(&mut scratch.returns)?;
        let group = &scratch.returns[first..last];
        let light: f64 = group.iter().map(|r| r.light).sum();
        let range = group.iter().map(|r| r.t * r.light).sum::<f64>() / light;
        let main = group.iter().find(|r| r.on_axis).unwrap_or(&group[0]);
        let place = self.eye + d * main.t;
        let (normal, albedo, class) = self.surface(main, place);
        let cosine = (-d.dot(normal)).clamp(0.02, 1.0);
        let class = if self.mixed(group, cosine, main.t) { Class::Mixed } else { class };
        let reflectance = (0.3 * albedo[0] + 0.6 * albedo[1] + 0.1 * albedo[2]) / 255.0;
        let signal = light * reflectance * cosine * (20.0 / range) * (20.0 / range);
        let far = range / HALF_INTENSITY;
        let intensity = 0.75 * light * reflectance * (0.25 + 0.75 * cosine) / (1.0 + far * far);
        Some(Echo { range, cosine, signal, intensity, color: self.photographed(albedo, place, normal), class })
    }

    /// What the instrument reports of an echo, with its noise. `local`: the direction in the scan's frame.
    pub(super) fn report(&self, echo: &Echo, local: DVec3, cell: [u32; 2]) -> Sample {
        let h = hash3(self.seed, i64::from(cell[0]), i64::from(cell[1]), 0);
        let half = self.instrument.sensitivity;
        if unit(h, 0) < LOST + (1.0 - LOST) * smooth(2.0 * half, 0.5 * half, echo.signal) {
            return Sample::none(Class::Dropout);
        }
        let [a, b, c] = self.instrument.noise;
        let sigma = self.noise * (a + b * echo.range + c / echo.cosine);
        let measured = echo.range + sigma * gauss(mix(h ^ 0x11));
        if measured < MIN_RANGE || measured > self.instrument.max_range {
            return Sample::none(Class::Empty);
        }
        let intensity = echo.intensity * (1.0 + 0.03 * self.noise * gauss(mix(h ^ 0x22)));
        let color = std::array::from_fn(|k| {
            let grain = 2.0 * self.noise * gauss(mix(h ^ (0x33 + k as u64)));
            (echo.color[k] + grain).round().clamp(0.0, 255.0) as u8
        });
        Sample { point: Some(local * measured), intensity: intensity.clamp(0.001, 1.0), color, class: echo.class }
    }

    /// Fill the scratch with what the rays of the beam meet.
    fn trace(&self, d: DVec3, scratch: &mut Scratch) {
        let Scratch { near, returns } = scratch;
        near.clear();
        returns.clear();
        let (beam, reach) = (self.instrument.beam(), self.instrument.max_range);
        self.props.near(self.eye, d, reach, beam, near);
        let clear = self.scene.clear(self.eye, d, reach, beam);
        if near.is_empty() && clear >= reach {
            return;
        }
        let across = d.any_orthonormal_vector();
        let other = d.cross(across);
        let ray = |k: usize| {
            let (c, s) = HEXAGON[k];
            let side = (across * c + other * s) * RING_RADIUS;
            (self.eye + side * beam.exit, (d + side * beam.spread).normalize())
        };
        let follow = |o: DVec3, d: DVec3, light: f64, on_axis: bool| {
            let mut met = self.scene.hit(o, d, clear, reach).map(|hit| (hit.t, What::Fort(hit)));
            for &prop in &*near {
                if let Some(t) = self.props.get(prop).shape.meet(o, d)
                    && met.is_none_or(|(first, _)| t < first)
                    && t < reach
                {
                    met = Some((t, What::Prop(prop)));
                }
            }
            met.map(|(t, what)| Return { t, light, on_axis, what, normal: None })
        };
        let mut axis = follow(self.eye, d, AXIS_LIGHT, true);
        if near.is_empty()
            && let Some(axis) = &mut axis
        {
            axis.normal = self.filled(d, [across, other], clear, axis);
            if axis.normal.is_some() {
                axis.light = 1.0;
                returns.push(*axis);
                return;
            }
        }
        returns.extend(axis);
        returns.extend((0..RING).filter_map(|k| {
            let (o, d) = ray(k);
            follow(o, d, RING_LIGHT, false)
        }));
    }

    /// The normal of the surface if it fills the beam where its axis meets it: around the axis, three places just before are outside, three just
    /// behind are inside, and the beam was free nearly as far. The field at these places gives the normal.
    fn filled(&self, d: DVec3, [across, other]: [DVec3; 2], clear: f64, axis: &Return) -> Option<DVec3> {
        let What::Fort(hit) = axis.what else { return None };
        let radius = self.instrument.beam().radius(axis.t);
        let depth = [2.5 * radius, 8.0 * radius].into_iter().find(|depth| axis.t - clear < 0.01 + 8.0 * depth)?;
        let values = |shift: f64| {
            let place = self.eye + d * (axis.t + shift);
            [0, 2, 4].map(|k| {
                let (c, s) = HEXAGON[k];
                self.scene.value_of(place + (across * c + other * s) * radius, hit.on_ground)
            })
        };
        let behind = values(depth);
        if behind.iter().any(|v| *v >= 0.0) {
            return None;
        }
        let before = values(-depth);
        if before.iter().any(|v| *v <= 0.0) {
            return None;
        }
        let [a, b, c] = std::array::from_fn(|k| behind[k] + before[k]);
        let along = (behind.iter().sum::<f64>() - before.iter().sum::<f64>()) / (6.0 * depth);
        let (u, v) = ((2.0 * a - b - c) / (6.0 * radius), (b - c) / (12.0_f64.sqrt() * radius));
        (d * along + across * u + other * v).try_normalize()
    }

    /// The returns that are reported, as a range of those sorted by distance.
    fn reported(&self, returns: &mut [Return]) -> Option<(usize, usize)> {
        returns.sort_by(|a, b| a.t.total_cmp(&b.t));
        let light = |from: usize, to: usize| returns[from..to].iter().map(|r| r.light).sum::<f64>();
        if self.returns == Returns::Mean {
            return (light(0, returns.len()) >= NOTICED).then_some((0, returns.len()));
        }
        let mut best: Option<(usize, usize, f64)> = None;
        let mut from = 0;
        for to in 1..=returns.len() {
            let ends = to == returns.len() || returns[to].t - returns[to - 1].t > self.instrument.pulse;
            if !ends {
                continue;
            }
            let sent = light(from, to);
            let power = sent / (returns[from].t * returns[from].t);
            let better = best.is_none_or(|(_, _, most)| self.returns == Returns::Strongest && power > most);
            if sent >= NOTICED && better {
                best = Some((from, to, power));
            }
            from = to;
        }
        best.map(|(from, to, _)| (from, to))
    }

    /// Whether sorted returns are of surfaces one behind the other.
    fn mixed(&self, group: &[Return], cosine: f64, t: f64) -> bool {
        let slope = (1.0 - cosine * cosine).sqrt() / cosine.max(0.1);
        let allowed = APART + 2.0 * self.instrument.beam().radius(t) * slope;
        group.windows(2).any(|pair| pair[1].t - pair[0].t > allowed)
    }

    /// Normal, albedo (sRGB, 0 to 255) and class of what a return came from.
    fn surface(&self, main: &Return, place: DVec3) -> (DVec3, [f64; 3], Class) {
        match main.what {
            What::Prop(index) => {
                let prop = self.props.get(index);
                (prop.shape.normal(place), prop.color, prop.class)
            }
            What::Fort(Hit { on_ground, .. }) => {
                let reach = self.instrument.beam().radius(main.t).max(0.004);
                let normal = main.normal.unwrap_or_else(|| self.scene.normal(place, on_ground, reach));
                (normal, self.scene.albedo(place, normal, on_ground), Class::Surface)
            }
        }
    }

    /// What a camera beside the instrument shows, without grain (sRGB, 0 to 255): sky and sun on the material.
    fn photographed(&self, albedo: [f64; 3], place: DVec3, normal: DVec3) -> [f64; 3] {
        let facing = normal.dot(SUN);
        let lit = facing > 0.0 && !self.scene.is_shaded(place, normal, SUN);
        let light = SKY_LIGHT * (0.8 + 0.2 * normal.z) + if lit { SUN_LIGHT * facing } else { 0.0 };
        // Light is linear, colours are not: about the square root.
        let light = light.sqrt();
        albedo.map(|value| value * light)
    }
}

/// Cosine and sine of the six directions of the ring.
const HEXAGON: [(f64, f64); RING] = [
    (1.0, 0.0),
    (0.5, 0.866_025_403_784_438_6),
    (-0.5, 0.866_025_403_784_438_6),
    (-1.0, 0.0),
    (-0.5, -0.866_025_403_784_438_6),
    (0.5, -0.866_025_403_784_438_6),
];
