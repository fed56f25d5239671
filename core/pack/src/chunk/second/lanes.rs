//! Four numbers at once: a vector where the target has them (the page's modules), an array elsewhere. (The web
//! build optimises for size, so code for arrays is not vectorised there.)

#[cfg(not(all(target_arch = "wasm32", target_feature = "simd128")))]
pub(super) use self::array::Lanes;
#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
pub(super) use self::vector::Lanes;

#[cfg(all(target_arch = "wasm32", target_feature = "simd128"))]
mod vector {
    use std::arch::wasm32::{
        f32x4_convert_i32x4, i32x4, i32x4_add, i32x4_extract_lane, i32x4_max, i32x4_min, i32x4_mul, i32x4_shr,
        i32x4_splat, i32x4_sub, u32x4_shr, v128,
    };

    /// Three axes or channels, and a fourth number.
    #[derive(Clone, Copy)]
    pub(in super::super) struct Lanes(v128);

    #[expect(clippy::inline_always, reason = "single instructions")]
    impl Lanes {
        #[inline(always)]
        pub(in super::super) const fn new([a, b, c, d]: [i32; 4]) -> Self {
            Self(i32x4(a, b, c, d))
        }

        #[inline(always)]
        pub(in super::super) fn array(self) -> [i32; 4] {
            let x = self.0;
            [
                i32x4_extract_lane::<0>(x),
                i32x4_extract_lane::<1>(x),
                i32x4_extract_lane::<2>(x),
                i32x4_extract_lane::<3>(x),
            ]
        }

        #[inline(always)]
        pub(in super::super) fn plus(self, other: Self) -> Self {
            Self(i32x4_add(self.0, other.0))
        }

        #[inline(always)]
        pub(in super::super) fn minus(self, other: Self) -> Self {
            Self(i32x4_sub(self.0, other.0))
        }

        #[inline(always)]
        pub(in super::super) fn times(self, factor: i32) -> Self {
            Self(i32x4_mul(self.0, i32x4_splat(factor)))
        }

        /// Each shifted right by at most 31.
        #[inline(always)]
        pub(in super::super) fn down(self, bits: u32) -> Self {
            Self(i32x4_shr(self.0, bits))
        }

        #[inline(always)]
        pub(in super::super) fn at_least(self, least: i32) -> Self {
            Self(i32x4_max(self.0, i32x4_splat(least)))
        }

        #[inline(always)]
        pub(in super::super) fn clamped(self, least: i32, most: i32) -> Self {
            Self(i32x4_min(i32x4_max(self.0, i32x4_splat(least)), i32x4_splat(most)))
        }

        /// Quarter octaves of `x + 1`, for x from 0 to 2^24 - 2: exponent and two bits of its float.
        #[inline(always)]
        pub(in super::super) fn quarter_octaves(self) -> [usize; 3] {
            let floats = f32x4_convert_i32x4(i32x4_add(self.0, i32x4_splat(1)));
            let [a, b, c, _] = Self(i32x4_sub(u32x4_shr(floats, 21), i32x4_splat(508))).array();
            [a, b, c].map(|x| x.cast_unsigned() as usize & 127)
        }
    }
}

#[cfg(not(all(target_arch = "wasm32", target_feature = "simd128")))]
mod array {
    /// Three axes or channels, and a fourth number.
    #[derive(Clone, Copy)]
    pub(in super::super) struct Lanes([i32; 4]);

    #[expect(clippy::inline_always, reason = "single instructions")]
    impl Lanes {
        #[inline(always)]
        pub(in super::super) const fn new(lanes: [i32; 4]) -> Self {
            Self(lanes)
        }

        #[inline(always)]
        pub(in super::super) fn array(self) -> [i32; 4] {
            self.0
        }

        #[inline(always)]
        fn zip(self, other: Self, with: impl Fn(i32, i32) -> i32) -> Self {
            let (Self([a, b, c, d]), Self([e, f, g, h])) = (self, other);
            Self([with(a, e), with(b, f), with(c, g), with(d, h)])
        }

        #[inline(always)]
        pub(in super::super) fn plus(self, other: Self) -> Self {
            self.zip(other, i32::wrapping_add)
        }

        #[inline(always)]
        pub(in super::super) fn minus(self, other: Self) -> Self {
            self.zip(other, i32::wrapping_sub)
        }

        #[inline(always)]
        pub(in super::super) fn times(self, factor: i32) -> Self {
            Self(self.0.map(|x| x.wrapping_mul(factor)))
        }

        /// Each shifted right by at most 31.
        #[inline(always)]
        pub(in super::super) fn down(self, bits: u32) -> Self {
            Self(self.0.map(|x| x.wrapping_shr(bits)))
        }

        #[inline(always)]
        pub(in super::super) fn at_least(self, least: i32) -> Self {
            Self(self.0.map(|x| x.max(least)))
        }

        #[inline(always)]
        pub(in super::super) fn clamped(self, least: i32, most: i32) -> Self {
            Self(self.0.map(|x| x.max(least).min(most)))
        }

        /// Quarter octaves of `x + 1`, for x from 0 to 2^24 - 2: exponent and two bits of its float.
        #[inline(always)]
        pub(in super::super) fn quarter_octaves(self) -> [usize; 3] {
            let bits = self.0.map(|x| ((x.wrapping_add(1) as f32).to_bits() >> 21).wrapping_sub(508) & 127);
            let [a, b, c, _] = bits;
            [a as usize, b as usize, c as usize]
        }
    }
}
