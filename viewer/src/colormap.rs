//! The colours of values: viridis (van der Walt and Smith 2015), whose steps look equal and which people who confuse red and green can
//! read. Nine stops, mixed in sRGB values; the shader has the same numbers, and a test compares what it draws.

/// sRGB of the stops, from the lowest value to the highest.
pub const VIRIDIS: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];

/// The colour of a place without a value, sRGB.
pub const NO_VALUE: [u8; 3] = [128, 126, 122];

/// sRGB of a share of the scale; shares outside 0 to 1 get the colours of the ends.
pub fn viridis(share: f64) -> [f64; 3] {
    let at = share.clamp(0.0, 1.0) * (VIRIDIS.len() - 1) as f64;
    let low = (at as usize).min(VIRIDIS.len() - 2);
    let t = at - low as f64;
    std::array::from_fn(|i| f64::from(VIRIDIS[low][i]) * (1.0 - t) + f64::from(VIRIDIS[low + 1][i]) * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// CIE lightness of an sRGB colour.
    fn lightness(c: [f64; 3]) -> f64 {
        let linear = c.map(|x| kilwa_geometry::color::decode(x / 255.0));
        let y = 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2];
        116.0 * y.cbrt() - 16.0
    }

    #[test]
    fn equal_differences_of_value_are_equal_differences_of_lightness() {
        let steps: Vec<f64> = (0..=16).map(|k| lightness(viridis(f64::from(k) / 16.0))).collect();
        let mean = (steps[16] - steps[0]) / 16.0;
        assert!(mean > 4.0, "lightness spans {mean} per step");
        for pair in steps.windows(2) {
            assert!((pair[1] - pair[0] - mean).abs() < 0.3 * mean, "a step of {} in {steps:?}", pair[1] - pair[0]);
        }
    }
}
