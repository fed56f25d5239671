//! From light to a picture: exposure, white balance, vignette, noise of the sensor, sRGB.

use super::place::Carrier;
use crate::noise::{derive, hash3, normal};
use kilwa_geometry::color::srgb_from_light;
use rayon::prelude::*;
use std::array::from_fn;

/// What light is multiplied by at 0 EV: bright stone in the sun becomes about 0.6 of white.
const GAIN: f64 = 0.95;
/// Noise of a pixel of value v, linear: the square root of `v / ELECTRONS + READ²`.
const ELECTRONS: f64 = 9_000.0;
const READ: f64 = 0.001_5;

/// How a photograph was exposed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposure {
    /// In stops; 0 is the same for all photographs.
    pub ev: f64,
    /// What linear red, green and blue are multiplied by; green is 1.
    pub white_balance: [f64; 3],
    /// The vignette: the relative brightness at distance r from the centre, where r is 1 in the corners: 1 + a r² + b
    /// r⁴ + c r⁶.
    pub vignette: [f64; 3],
}

impl Exposure {
    /// The vignette of a carrier's lens.
    pub(super) fn vignette_of(carrier: Carrier) -> [f64; 3] {
        match carrier {
            Carrier::Hand => [-0.34, 0.07, -0.03],
            Carrier::Drone => [-0.2, -0.08, 0.03],
            // A panorama is composed of many pictures.
            Carrier::Tripod => [0.0; 3],
        }
    }

    /// What linear light is multiplied by at a place of a picture of this size; pixels count from the corner, the first pixel's middle is at 0.5.
    pub fn factor(&self, x: f64, y: f64, (width, height): (u32, u32)) -> [f64; 3] {
        let (w, h) = (f64::from(width), f64::from(height));
        let (dx, dy) = (x - 0.5 * w, y - 0.5 * h);
        let r = (dx * dx + dy * dy) / (0.25 * (w * w + h * h));
        let [a, b, c] = self.vignette;
        let left = 1.0 + r * (a + r * (b + r * c));
        let gain = GAIN * libm::exp2(self.ev) * left;
        self.white_balance.map(|wb| gain * wb)
    }
}

/// The bytes of a picture, red, green and blue for each pixel. `noise` multiplies the noise of the sensor.
pub(super) fn develop(light: &[[f32; 3]], size: (u32, u32), exposure: &Exposure, noise: f64, seed: u64) -> Vec<u8> {
    let seed = derive(seed, 0xf3);
    let width = size.0 as usize;
    let row = |(y, row): (usize, &[[f32; 3]])| -> Vec<u8> {
        let pixel = |(x, light): (usize, &[f32; 3])| -> [u8; 3] {
            let factor = exposure.factor(x as f64 + 0.5, y as f64 + 0.5, size);
            from_fn(|k| {
                let value = f64::from(light[k]) * factor[k];
                let sigma = noise * (value / ELECTRONS + READ * READ).sqrt();
                srgb_from_light(value + sigma * normal(hash3(seed, x as i64, y as i64, k as i64)))
            })
        };
        row.iter().enumerate().flat_map(pixel).collect()
    };
    let rows: Vec<Vec<u8>> = light.par_chunks(width).enumerate().map(row).collect();
    rows.concat()
}
