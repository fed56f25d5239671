//! sRGB and linear light (IEC 61966-2-1).

use std::sync::LazyLock;

static LINEAR: LazyLock<[f32; 256]> = LazyLock::new(|| {
    std::array::from_fn(|c| {
        let x = c as f32 / 255.0;
        if x <= 0.04045 { x / 12.92 } else { libm::powf((x + 0.055) / 1.055, 2.4) }
    })
});

/// The linear values half way (in sRGB) between neighbouring bytes: above entry `c` the byte is more than `c`.
static MIDDLES: LazyLock<[f32; 255]> = LazyLock::new(|| {
    std::array::from_fn(|c| {
        let x = (c as f32 + 0.5) / 255.0;
        if x <= 0.04045 { x / 12.92 } else { libm::powf((x + 0.055) / 1.055, 2.4) }
    })
});

/// sRGB to linear light.
pub(crate) fn linear(c: u8) -> f32 {
    LINEAR[usize::from(c)]
}

/// Linear light to sRGB, rounded to the nearest byte.
pub(crate) fn srgb(x: f32) -> u8 {
    MIDDLES.partition_point(|m| *m < x) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_byte_round_trips_and_values_out_of_range_are_clamped() {
        assert!((0..=255).all(|c| srgb(linear(c)) == c));
        assert_eq!((srgb(-1.0), srgb(2.0), srgb(f32::NAN)), (0, 255, 0));
    }
}
