//! How many bits colours and normals keep, and rounding to them.
//!
//! Rounded values are multiples of a power of two of what they are stored in, which is what the codec saves bits on. The
//! largest value stays what it is, though it is no such multiple: white stays white.

use kilwa_geometry::normal::OctNormal;

/// Bits of colours and normals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Precision {
    /// Bits of each channel of a colour, at most 8.
    pub color_bits: u8,
    /// Bits of each octahedral coordinate of a normal, 2 to 16.
    pub normal_bits: u8,
}

impl Default for Precision {
    /// Colours as they are; normals to a tenth of a degree, well below what shading shows.
    fn default() -> Self {
        Self { color_bits: 8, normal_bits: 10 }
    }
}

impl Precision {
    /// Of vertices that simplification makes, which are means of many: half a quantum is two of 255 shades, and one degree.
    #[must_use]
    pub fn coarse(self) -> Self {
        Self { color_bits: self.color_bits.min(6), normal_bits: self.normal_bits.min(7) }
    }

    /// A colour of the finest level.
    pub fn color(self, color: [u8; 3]) -> [u8; 3] {
        let lost = 8 - u32::from(self.color_bits.clamp(1, 8));
        color.map(|c| rounded(i32::from(c), lost).min(255) as u8)
    }

    /// A normal of the finest level, from coordinates of 16 bits.
    pub fn normal(self, normal: OctNormal) -> OctNormal {
        self.normal_within(normal, self)
    }

    /// A normal of these bits in a pack whose finest level has `finest`.
    pub fn normal_within(self, normal: OctNormal, finest: Self) -> OctNormal {
        let bits = u32::from(finest.normal_bits.clamp(2, 16));
        let lost = bits.saturating_sub(self.normal_bits.into());
        let levels = (1i32 << (bits - 1)) - 1;
        normal.map(|x| {
            let (x, sign) = (i32::from(x.max(-32767)).abs(), i32::from(x.signum()));
            let level = rounded((2 * x * levels + 32767) / 65534, lost).min(levels);
            // Half away from zero both times, as the codec does (FORMAT section 5.8).
            ((65534 * level + levels) / (2 * levels) * sign) as i16
        })
    }
}

/// The nearest multiple of `2^lost` of a number that is not negative.
fn rounded(x: i32, lost: u32) -> i32 {
    (x + ((1 << lost) >> 1)) >> lost << lost
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_geometry::normal;

    #[test]
    fn colours_are_rounded_to_within_half_a_quantum_and_black_and_white_are_kept() {
        for color_bits in 1..=8 {
            let precision = Precision { color_bits, ..Precision::default() };
            for c in 0..=255u8 {
                let [r, ..] = precision.color([c; 3]);
                let quantum = 1 << (8 - color_bits);
                assert!(i32::from(r.abs_diff(c)) * 2 <= quantum, "{c} became {r} at {color_bits} bits");
                assert!(r == 255 || i32::from(r) % quantum == 0);
                assert_eq!(precision.color([r; 3]), [r; 3]);
            }
            assert_eq!([0, 255].map(|c| precision.color([c; 3])[0]), [0, 255]);
        }
        assert!((0..=255).all(|c| Precision::default().color([c; 3]) == [c; 3]), "8 bits are exact");
    }

    #[test]
    fn normals_are_rounded_as_the_codec_stores_them() {
        for normal_bits in 2..=16 {
            let precision = Precision { normal_bits, ..Precision::default() };
            for x in (-32767..=32767).step_by(13) {
                let there = precision.normal([x, -x]);
                assert_eq!(there, normal::quantize([x, -x], normal_bits.into()), "{x} at {normal_bits} bits");
                assert_eq!(precision.normal(there), there);
                let coarse = precision.coarse().normal_within(there, precision);
                assert_eq!(precision.normal(coarse), coarse, "a coarse normal is one of the finer ones");
            }
        }
    }
}
