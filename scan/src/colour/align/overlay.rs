//! A photograph with the borders of the model drawn over it, to see what is wrong with its pose.

use crate::write_png::write_png;
use glam::DVec2;
use kilwa_scan_core::PosedCamera;
use kilwa_scan_core::photo_pose::{Grey, Shown};
use kilwa_scan_core::raster::{Edges, Raster};
use std::io::{self, Write};

/// A jump in depth is a border where it exceeds this share of the depth.
const JUMP: f32 = 0.02;
/// Pixels of the drawing up to which a border reaches.
const WIDE: f32 = 0.9;
/// The colour of borders: yellow shows on stone, plants and sky.
const BORDER: [u8; 3] = [255, 225, 0];
/// Levels of grey that the photograph takes, so that borders stand out.
const GREYS: f32 = 200.0;

/// A picture of three bytes a pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Overlay {
    /// Width and height, pixels.
    pub size: [u32; 2],
    /// Rows from the top, red green blue.
    pub pixels: Vec<u8>,
}

impl Overlay {
    /// `picture`: the luminance of a photograph, 0 to 1, divided by `factor` in both directions. `rasters`: what the model shows to the camera.
    pub fn new(picture: &Grey, factor: f64, camera: &PosedCamera, rasters: &[Raster<Shown>]) -> Self {
        let size = picture.size();
        let edges: Vec<Edges> = rasters.iter().map(|raster| Edges::of(raster, JUMP)).collect();
        let is_border = |x: u32, y: u32| {
            let pixel = (DVec2::new(x.into(), y.into()) + 0.5) * factor;
            let Some(ray) = camera.camera.ray(pixel) else { return false };
            rasters.iter().zip(&edges).any(|(raster, edges)| {
                let window = raster.window();
                let place = window.project(window.window_from_camera * ray);
                place.is_some_and(|place| edges.distance(place.x as u32, place.y as u32) <= WIDE)
            })
        };
        let mut pixels = Vec::with_capacity(3 * size[0] as usize * size[1] as usize);
        for y in 0..size[1] {
            for x in 0..size[0] {
                let value = picture.at(x as usize, y as usize);
                let grey = if value.is_finite() { (value.clamp(0.0, 1.0) * GREYS) as u8 } else { 0 };
                pixels.extend(if is_border(x, y) { BORDER } else { [grey; 3] });
            }
        }
        Self { size, pixels }
    }

    /// Write it as PNG.
    ///
    /// # Errors
    /// Those of `out`.
    pub fn write_png(&self, out: &mut dyn Write) -> io::Result<()> {
        write_png(out, self.size, png::ColorType::Rgb, &self.pixels)
    }
}
