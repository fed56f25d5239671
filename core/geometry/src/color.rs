//! sRGB and linear light (IEC 61966-2-1).
//!
//! In double and in single precision: the colours of a pack's coarser levels are averaged in single precision, those of textures in double,
//! and the bytes of packs depend on both. `libm` gives the same digits on every machine.

use std::sync::LazyLock;

/// The formula, in the precision of its argument.
macro_rules! decode {
    ($srgb:expr, $pow:path) => {
        if $srgb <= 0.04045 { $srgb / 12.92 } else { $pow(($srgb + 0.055) / 1.055, 2.4) }
    };
}

/// Linear light of an sRGB value, both 0 to 1.
pub fn decode(srgb: f64) -> f64 {
    decode!(srgb, libm::pow)
}

/// The same in single precision.
pub fn decode_f32(srgb: f32) -> f32 {
    decode!(srgb, libm::powf)
}

/// The sRGB value of linear light, both 0 to 1, in single precision.
pub fn encode_f32(light: f32) -> f32 {
    if light <= 0.003_130_8 { light * 12.92 } else { 1.055 * libm::powf(light, 1.0 / 2.4) - 0.055 }
}

/// Light of each level.
static LIGHT: LazyLock<[f64; 256]> = LazyLock::new(|| std::array::from_fn(|level| decode(level as f64 / 255.0)));
static LIGHT_F32: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|level| decode_f32(level as f32 / 255.0)));
/// Light of the values half way (in sRGB) between neighbouring levels.
static BETWEEN: LazyLock<[f64; 255]> =
    LazyLock::new(|| std::array::from_fn(|level| decode((level as f64 + 0.5) / 255.0)));
static BETWEEN_F32: LazyLock<[f32; 255]> =
    LazyLock::new(|| std::array::from_fn(|level| decode_f32((level as f32 + 0.5) / 255.0)));

/// The light, 0 to 1, of an 8-bit sRGB level.
pub fn light_from_srgb(level: u8) -> f64 {
    LIGHT[usize::from(level)]
}

/// The same in single precision.
pub fn light_from_srgb_f32(level: u8) -> f32 {
    LIGHT_F32[usize::from(level)]
}

/// The 8-bit sRGB level nearest to an amount of light from 0 to 1, the higher of two; below is 0, above is 255.
pub fn srgb_from_light(light: f64) -> u8 {
    BETWEEN.partition_point(|between| *between <= light) as u8
}

/// The same in single precision, but the lower of two; NaN is 0.
pub fn srgb_from_light_f32(light: f32) -> u8 {
    BETWEEN_F32.partition_point(|between| *between < light) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_level_survives_and_what_is_outside_is_clamped() {
        assert!((0..=255).all(|level| srgb_from_light(light_from_srgb(level)) == level));
        assert!((0..=255).all(|level| srgb_from_light_f32(light_from_srgb_f32(level)) == level));
        assert!((0..=255u8).all(|level| (encode_f32(light_from_srgb_f32(level)) * 255.0).round() as u8 == level));
        assert_eq!((srgb_from_light(-1.0), srgb_from_light(2.0)), (0, 255));
        assert_eq!((srgb_from_light_f32(-1.0), srgb_from_light_f32(2.0), srgb_from_light_f32(f32::NAN)), (0, 255, 0));
    }

    #[test]
    fn half_the_light_is_188() {
        assert_eq!((srgb_from_light(0.5), srgb_from_light_f32(0.5), srgb_from_light(0.25)), (188, 188, 137));
    }
}
