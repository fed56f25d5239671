//! A small picture of a mesh, drawn while it is surveyed: which way is up and how large it is can be seen before anything is built. Drawn by the processor, one
//! triangle after the other, in the memory of the picture.

use crate::new_file::{NewFile, check_output};
use anyhow::{Context, ensure};
use glam::{DMat3, DVec2, DVec3};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder as _};
use kilwa_builder::ingest::TriangleVisitor;
use noto_sans_mono_bitmap::{FontWeight, RasterHeight, get_raster};
use std::path::{Path, PathBuf};

/// Width and height of the picture, pixels.
const SIZE: [usize; 2] = [640, 480];
/// Samples to a pixel, across and down.
const FINE: usize = 2;
/// Left free around the model, as a share of the picture.
const MARGIN: f64 = 0.06;
/// Of a mesh without colours.
const CLAY: [u8; 3] = [190, 184, 174];
const BACKGROUND: [u8; 3] = [246, 245, 242];
/// Light on what faces away from the eye.
const DARKEST: f64 = 0.35;
/// What the inside of a surface is tinted with.
const INSIDE: DVec3 = DVec3::new(0.75, 0.8, 1.0);
/// The axes at the lower left: their origin and length, pixels.
const AXES: (DVec2, f64) = (DVec2::new(52.0, 424.0), 34.0);
/// Their names and colours.
const NAMES: [(char, [u8; 3]); 3] = [('x', [196, 60, 50]), ('y', [52, 140, 60]), ('z', [48, 88, 190])];

/// Where a picture goes.
pub(super) struct Picture<'a> {
    pub(super) path: &'a Path,
    pub(super) replace: bool,
}

impl Picture<'_> {
    /// Report what would prevent writing, before the work is done.
    pub(super) fn check(&self, inputs: &[PathBuf]) -> anyhow::Result<()> {
        let is_png = self.path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png"));
        ensure!(is_png, "{}: the file extension of the picture must be .png", self.path.display());
        check_output(self.path, self.replace, inputs.iter().map(PathBuf::as_path))
    }

    /// Write rows of red, green and blue.
    pub(super) fn write(&self, pixels: &[u8]) -> anyhow::Result<()> {
        let mut file = NewFile::create(self.path)?;
        let [width, height] = SIZE.map(|n| n as u32);
        PngEncoder::new(file.file())
            .write_image(pixels, width, height, ExtendedColorType::Rgb8)
            .with_context(|| format!("cannot write {}", self.path.display()))?;
        file.commit(self.replace)
    }
}

/// A parallel projection from the south-west and above.
pub(super) struct Drawing {
    /// Right, up and towards the eye, from metres.
    view: DMat3,
    middle: DVec3,
    /// Samples to a metre.
    scale: f64,
    /// How near each sample is, and its colour.
    samples: Vec<(f32, [u8; 3])>,
}

impl Drawing {
    pub(super) fn new() -> Self {
        let towards = DVec3::new(-1.0, -1.0, 0.9).normalize();
        let right = DVec3::Z.cross(towards).normalize();
        let view = DMat3::from_cols(right, towards.cross(right), towards).transpose();
        let samples = vec![(f32::NEG_INFINITY, BACKGROUND); SIZE[0] * SIZE[1] * FINE * FINE];
        Self { view, middle: DVec3::ZERO, scale: 1.0, samples }
    }

    /// Samples across and down.
    fn extent() -> DVec2 {
        DVec2::from(SIZE.map(|n| (n * FINE) as f64))
    }

    /// Across and down in samples, and how near.
    fn project(&self, p: DVec3) -> DVec3 {
        let p = self.view * (p - self.middle) * self.scale;
        let half = Self::extent() * 0.5;
        DVec3::new(half.x + p.x, half.y - p.y, p.z)
    }

    /// The picture: rows of red, green and blue.
    pub(super) fn finish(self) -> Vec<u8> {
        let [width, height] = SIZE;
        let mut pixels = Vec::with_capacity(width * height * 3);
        for y in 0..height {
            for x in 0..width {
                let of = |k: usize| self.samples[(y * FINE + k / FINE) * width * FINE + x * FINE + k % FINE].1;
                let all: [[u8; 3]; FINE * FINE] = std::array::from_fn(of);
                let mean = |c: usize| all.iter().map(|s| u32::from(s[c])).sum::<u32>() / all.len() as u32;
                pixels.extend([0, 1, 2].map(|c| mean(c) as u8));
            }
        }
        self.draw_axes(&mut pixels);
        pixels
    }

    /// The three axes, each with its name at its end.
    fn draw_axes(&self, pixels: &mut [u8]) {
        let (origin, length) = AXES;
        let mut put = |x: f64, y: f64, color: [u8; 3], share: f64| {
            let at = 3 * (y as usize * SIZE[0] + x as usize);
            for (to, c) in pixels.iter_mut().skip(at).zip(color) {
                *to = (f64::from(*to) * (1.0 - share) + f64::from(c) * share) as u8;
            }
        };
        for (k, (name, color)) in NAMES.into_iter().enumerate() {
            let axis = self.view.col(k);
            let end = origin + DVec2::new(axis.x, -axis.y) * length;
            for i in 0..=60 {
                let at = origin.lerp(end, f64::from(i) / 60.0);
                for (dx, dy) in [(0.0, 0.0), (1.0, 0.0), (0.0, 1.0)] {
                    put(at.x + dx, at.y + dy, color, 1.0);
                }
            }
            let Some(letter) = get_raster(name, FontWeight::Regular, RasterHeight::Size16) else { continue };
            let corner = origin + DVec2::new(axis.x, -axis.y) * (length + 12.0) - DVec2::new(4.0, 9.0);
            for (y, row) in letter.rows().enumerate() {
                for (x, ink) in row.iter().enumerate() {
                    put(corner.x + x as f64, corner.y + y as f64, color, f64::from(*ink) / 255.0);
                }
            }
        }
    }
}

impl TriangleVisitor for Drawing {
    fn begin(&mut self, [low, high]: [DVec3; 2]) {
        self.middle = (low + high) * 0.5;
        let half = (high - low) * 0.5;
        // How far the box reaches from its middle, on the picture.
        let reach = |row: DVec3| row.abs().dot(half);
        let room = Self::extent() * (0.5 - MARGIN);
        let fits = room / DVec2::new(reach(self.view.row(0)), reach(self.view.row(1)));
        self.scale = fits.min_element().min(1e12);
    }

    fn triangle(&mut self, corners: [DVec3; 3], colors: Option<[[u8; 3]; 3]>) {
        let [a, b, c] = corners.map(|p| self.project(p));
        // Down is positive in the picture: what faces the eye turns the other way there.
        let turn = (b - a).truncate().perp_dot((c - a).truncate());
        if turn == 0.0 || !turn.is_finite() {
            return;
        }
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero();
        let facing = normal.dot(self.view.row(2)).abs();
        let light = DVec3::splat(DARKEST + (1.0 - DARKEST) * facing);
        let light = if turn > 0.0 { light * INSIDE } else { light };
        let colors = colors.unwrap_or([CLAY; 3]).map(|c| DVec3::from(c.map(f64::from)) * light);
        let extent = Self::extent();
        let low = a.min(b).min(c).truncate().floor().max(DVec2::ZERO);
        let high = a.max(b).max(c).truncate().ceil().min(extent - 1.0);
        for y in low.y as i64..=high.y as i64 {
            for x in low.x as i64..=high.x as i64 {
                let p = DVec2::new(x as f64 + 0.5, y as f64 + 0.5);
                let weight = |u: DVec3, v: DVec3| (v - u).truncate().perp_dot(p - u.truncate()) / turn;
                let [u, v, w] = [weight(b, c), weight(c, a), weight(a, b)];
                if u.min(v).min(w) < 0.0 {
                    continue;
                }
                let near = (a.z * u + b.z * v + c.z * w) as f32;
                let sample = &mut self.samples[y as usize * SIZE[0] * FINE + x as usize];
                if near > sample.0 {
                    let color = colors[0] * u + colors[1] * v + colors[2] * w;
                    *sample = (near, color.to_array().map(|c| c.round().clamp(0.0, 255.0) as u8));
                }
            }
        }
    }
}
