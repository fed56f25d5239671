//! What a camera sees: rays through its pixels to the fort and to the people in front of it.

use super::light::{self, RELIEF, Sky};
use crate::fort::scene::{Beam, Scene};
use crate::scans::props::Props;
use glam::{DMat3, DVec2, DVec3};
use kilwa_geometry::color::decode;
use kilwa_scan_core::Camera;
use rayon::prelude::*;
use std::array::from_fn;

/// Nothing is farther away, in metres.
pub(super) const FAR: f64 = 120.0;
/// Rays through a pixel at which something ends: places in the pixel, in pixels from its middle.
const SAMPLES: [[f64; 2]; 4] = [[-0.25, -0.25], [0.25, -0.25], [-0.25, 0.25], [0.25, 0.25]];
/// Neighbouring pixels show an edge if their ranges differ by more than this share, or their light by more than this share and this much.
const RANGE_STEP: f32 = 0.03;
const LIGHT_STEP: (f32, f32) = (0.2, 0.015);
/// Rows that are traced between two reports of progress.
const BAND: usize = 64;
const RAY: Beam = Beam { exit: 0.0, spread: 0.0 };

/// A camera in the fort's frame.
#[derive(Clone, Copy)]
pub(super) struct Eye<'a> {
    pub(super) position: DVec3,
    /// Takes the camera's coordinates to the fort's.
    pub(super) rotation: DMat3,
    pub(super) camera: &'a Camera,
}

impl Eye<'_> {
    pub(super) fn size(&self) -> (u32, u32) {
        self.camera.size().into()
    }

    /// The unit direction that a place of the picture shows.
    pub(super) fn ray(&self, x: f64, y: f64) -> Option<DVec3> {
        Some(self.rotation * self.camera.ray(DVec2::new(x, y))?)
    }
}

/// What a ray meets.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum What {
    Backdrop,
    Ground,
    Masonry,
    Bar,
    Person,
}

/// The result of a ray: linear light before exposure, and the distance, in metres (infinite for the backdrop).
#[derive(Debug, Clone, Copy)]
pub(super) struct Texel {
    pub(super) light: [f32; 3],
    pub(super) range: f32,
    pub(super) what: What,
}

/// A camera before the fort at a time of day.
pub(super) struct View<'a> {
    pub(super) scene: &'a Scene,
    pub(super) sky: &'a Sky,
    /// The grilles in the windows.
    pub(super) bars: &'a Props,
    pub(super) people: &'a Props,
    pub(super) eye: Eye<'a>,
    /// The direction to the sun, in the fort's frame.
    pub(super) sun: DVec3,
}

/// A picture before exposure.
pub(super) struct Rendered {
    pub(super) light: Vec<[f32; 3]>,
    /// Range of the middle of each pixel.
    pub(super) range: Vec<f32>,
    /// Whether anything of a pixel is a person.
    pub(super) is_person: Vec<bool>,
    /// Whether the middle of each pixel is the fort, its ground or a person.
    pub(super) surface: u64,
}

/// Linear reflectance of a colour in sRGB, 0 to 255.
pub(super) fn reflectance(srgb: [f64; 3]) -> [f64; 3] {
    srgb.map(|c| decode((c / 255.0).clamp(0.0, 1.0)))
}

impl View<'_> {
    /// The first thing along a direction, with its distance; `near` is a buffer.
    fn prop(props: &Props, o: DVec3, d: DVec3, to: f64, near: &mut Vec<u32>) -> Option<(f64, u32)> {
        near.clear();
        props.near(o, d, to, RAY, near);
        let met = near.iter().filter_map(|k| props.get(*k).shape.meet(o, d).map(|t| (t, *k)));
        met.filter(|(t, _)| *t < to).min_by(|a, b| a.0.total_cmp(&b.0))
    }

    /// Follow a direction.
    pub(super) fn trace(&self, d: DVec3, near: &mut Vec<u32>) -> Texel {
        let o = self.eye.position;
        let hit = self.scene.hit(o, d, 0.0, FAR);
        let mut to = hit.map_or(FAR, |hit| hit.t);
        let mut prop = None;
        for (props, what) in [(self.bars, What::Bar), (self.people, What::Person)] {
            if let Some((t, index)) = Self::prop(props, o, d, to, near) {
                to = t;
                prop = Some((props.get(index), what));
            }
        }
        let p = o + d * to;
        let (albedo, normal, what) = match (prop, hit) {
            (Some((prop, what)), _) => (prop.color, prop.shape.normal(p), what),
            (None, Some(hit)) => {
                let normal = self.scene.normal(p, hit.on_ground, RELIEF);
                let what = if hit.on_ground { What::Ground } else { What::Masonry };
                (self.scene.albedo(p, normal, hit.on_ground), normal, what)
            }
            (None, None) => {
                let light = light::backdrop(d, self.sun).map(|v| v as f32);
                return Texel { light, range: f32::INFINITY, what: What::Backdrop };
            }
        };
        let (albedo, light) = (reflectance(albedo), light::light(self.scene, self.sky, p, normal, self.sun));
        Texel { light: from_fn(|k| (albedo[k] * light[k]) as f32), range: to as f32, what }
    }

    fn pixel(&self, x: f64, y: f64, near: &mut Vec<u32>) -> Texel {
        match self.eye.ray(x, y) {
            Some(d) => self.trace(d, near),
            None => Texel { light: [0.0; 3], range: f32::INFINITY, what: What::Backdrop },
        }
    }

    /// The picture, by all threads. One ray through each pixel; four where something ends. `progress` is called with finished pixels.
    pub(super) fn render(&self, progress: &mut dyn FnMut(u64)) -> Rendered {
        let (width, height) = self.eye.size();
        let (width, height) = (width as usize, height as usize);
        let mut texels: Vec<Texel> = Vec::with_capacity(width * height);
        for from in (0..height).step_by(BAND) {
            let rows: Vec<Vec<Texel>> = (from..(from + BAND).min(height))
                .into_par_iter()
                .map_init(Vec::new, |near, y| {
                    (0..width).map(|x| self.pixel(x as f64 + 0.5, y as f64 + 0.5, near)).collect()
                })
                .collect();
            texels.extend(rows.into_iter().flatten());
            progress(texels.len() as u64 / 2);
        }
        let mut light = Vec::with_capacity(width * height);
        let mut is_person = Vec::with_capacity(width * height);
        for from in (0..height).step_by(BAND) {
            let rows: Vec<Vec<([f32; 3], bool)>> = (from..(from + BAND).min(height))
                .into_par_iter()
                .map_init(Vec::new, |near, y| {
                    (0..width).map(|x| self.resolved(&texels, [width, height], [x, y], near)).collect()
                })
                .collect();
            for (value, person) in rows.into_iter().flatten() {
                light.push(value);
                is_person.push(person);
            }
            progress((texels.len() + light.len()) as u64 / 2);
        }
        let surface = texels.iter().filter(|t| t.what != What::Backdrop).count() as u64;
        Rendered { light, range: texels.iter().map(|t| t.range).collect(), is_person, surface }
    }

    /// A pixel's light, with more rays if it is on an edge, and whether any of it is a person.
    fn resolved(&self, texels: &[Texel], size: [usize; 2], at: [usize; 2], near: &mut Vec<u32>) -> ([f32; 3], bool) {
        let ([width, height], [x, y]) = (size, at);
        let own = texels[y * width + x];
        let around = [
            (x > 0).then(|| (x - 1, y)),
            (x + 1 < width).then_some((x + 1, y)),
            (y > 0).then(|| (x, y - 1)),
            (y + 1 < height).then_some((x, y + 1)),
        ];
        if !around.into_iter().flatten().any(|(x, y)| is_edge(&own, &texels[y * width + x])) {
            return (own.light, own.what == What::Person);
        }
        let mut sum = [0.0; 3];
        let mut person = own.what == What::Person;
        for [dx, dy] in SAMPLES {
            let texel = self.pixel(x as f64 + 0.5 + dx, y as f64 + 0.5 + dy, near);
            person |= texel.what == What::Person;
            sum = from_fn(|k| sum[k] + texel.light[k] / SAMPLES.len() as f32);
        }
        (sum, person)
    }
}

fn is_edge(a: &Texel, b: &Texel) -> bool {
    if a.what != b.what {
        return true;
    }
    if a.what == What::Backdrop {
        return false;
    }
    let step = (a.light[1] - b.light[1]).abs();
    (a.range - b.range).abs() > RANGE_STEP * a.range.min(b.range)
        || (step > LIGHT_STEP.0 * a.light[1].max(b.light[1]) && step > LIGHT_STEP.1)
}
