//! Where the samples of stations are, seen from above: the background of a plan.
//!
//! Each sample is weighted by the area that its ray covers, range² · solid angle, so that near ground is not darker than far walls, and walls, which
//! stand on little ground, are darkest. [`extent`] finds where most samples of a station are, from a part of them; a [`TopView`] adds stations up, line by
//! line. Memory holds only the picture.

use crate::ScanError;
use crate::spool::Reader;
use crate::write_png::write_png;
use glam::{DVec2, DVec3};
use kilwa_scan_core::{Pose, Rays, Sample};
use std::io::Write;

/// Largest number of pixels across and down.
pub const SIZE_MAX: u32 = 4096;

/// The smallest and the largest x and y, in the survey, of 98 % of the samples of a station along each axis; `None` where it has none. Estimated from 64
/// stretches of the scan. Samples that masks of `reader` mask are left out.
///
/// # Errors
/// [`ScanError::Spool`] and [`ScanError::Mask`] where what is read is damaged.
pub fn extent(reader: &mut Reader, pose: Pose) -> Result<Option<[DVec2; 2]>, ScanError> {
    const STRETCHES: u64 = 64;
    const STRETCH: u64 = 1024;
    let cells = reader.header().grid.cells();
    let (mut samples, mut axes) = (Vec::new(), [Vec::new(), Vec::new()]);
    let apart = (cells / STRETCHES).max(STRETCH);
    let mut first = 0;
    while first < cells {
        reader.read(first, STRETCH.min(cells - first) as usize, &mut samples)?;
        for sample in samples.iter().filter(|sample| sample.is_measured()) {
            let at = place(sample, pose);
            axes[0].push(at.x);
            axes[1].push(at.y);
        }
        first += apart;
    }
    for axis in &mut axes {
        axis.sort_unstable_by(f64::total_cmp);
    }
    let end = |share: f64| {
        let at = |axis: &Vec<f64>| axis.get((share * axis.len().saturating_sub(1) as f64) as usize).copied();
        Some(DVec2::new(at(&axes[0])?, at(&axes[1])?))
    };
    Ok(end(0.01).zip(end(0.99)).map(|(min, max)| [min, max]))
}

fn place(sample: &Sample, pose: Pose) -> DVec3 {
    pose.apply(sample.position.as_dvec3())
}

/// The picture while stations are added.
#[derive(Debug)]
pub struct TopView {
    min: DVec2,
    /// Pixels per metre.
    scale: f64,
    size: [u32; 2],
    /// Surface above each pixel, rows from the top.
    surface: Vec<f32>,
    /// That of the station that is being added.
    layer: Vec<f32>,
}

impl TopView {
    /// A picture of what is between `min` and `max` (metres in the survey), whose longer side has `pixels` pixels.
    pub fn new(min: DVec2, max: DVec2, pixels: u32) -> Self {
        let pixels = pixels.clamp(1, SIZE_MAX);
        let span = (max - min).max(DVec2::splat(1e-3));
        let scale = f64::from(pixels) / span.max_element();
        let size = [span.x, span.y].map(|length| ((length * scale).round() as u32).clamp(1, pixels));
        let surface = vec![0.0; size[0] as usize * size[1] as usize];
        Self { min, scale, size, layer: surface.clone(), surface }
    }

    /// Pixels across and down.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Add every so many lines of a station. Samples that masks of `reader` mask are left out.
    ///
    /// # Errors
    /// [`ScanError::Spool`] and [`ScanError::Mask`] where the station is damaged: then nothing of it is added.
    pub fn add(&mut self, reader: &mut Reader, pose: Pose, every: u64) -> Result<(), ScanError> {
        /// Cells read at a time where there is no grid.
        const BATCH: u64 = 65_536;
        let header = *reader.header();
        let cells = header.grid.cells();
        let length = if header.is_grid { u64::from(header.grid.line_length()) } else { BATCH };
        self.layer.fill(0.0);
        let mut samples = Vec::new();
        let mut first = 0;
        while first < cells {
            reader.read(first, length.min(cells - first) as usize, &mut samples)?;
            for sample in samples.iter().filter(|sample| sample.is_measured()) {
                let at = (place(sample, pose).truncate() - self.min) * self.scale;
                let [width, height] = self.size.map(f64::from);
                if at.x >= 0.0 && at.y >= 0.0 && at.x < width && at.y < height {
                    let row = self.size[1] - 1 - at.y as u32;
                    // Rays that are parallel cover the same everywhere.
                    let surface = if header.rays == Rays::Central { sample.position.length_squared() } else { 1.0 };
                    self.layer[row as usize * self.size[0] as usize + at.x as usize] += surface;
                }
            }
            first += length * every.max(1);
        }
        // The solid angle of a cell, up to a factor that all stations share.
        let angle = every.max(1) as f32 / cells as f32;
        for (sum, own) in self.surface.iter_mut().zip(&self.layer) {
            *sum += own * angle;
        }
        Ok(())
    }

    /// Write it as PNG: black, the more opaque the more surface there is, so that it lies on any background.
    ///
    /// # Errors
    /// The system's.
    pub fn write_png(&self, out: &mut dyn Write) -> std::io::Result<()> {
        let mut seen: Vec<f32> = self.surface.iter().copied().filter(|surface| *surface > 0.0).collect();
        seen.sort_unstable_by(f32::total_cmp);
        let at = |share: f64| seen.get((share * seen.len().saturating_sub(1) as f64) as usize).map_or(0.0, |v| v.ln());
        let (low, high) = (at(0.05), at(0.995));
        let mut pixels = Vec::with_capacity(2 * self.surface.len());
        for surface in &self.surface {
            let share = if high > low { (surface.ln() - low) / (high - low) } else { 1.0 };
            let opacity = if *surface > 0.0 { 20.0 + 235.0 * share.clamp(0.0, 1.0) } else { 0.0 };
            pixels.extend([0, opacity as u8]);
        }
        write_png(out, self.size, png::ColorType::GrayscaleAlpha, &pixels)
    }
}
