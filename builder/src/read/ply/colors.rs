//! Colours of every type to 8-bit sRGB.
//!
//! A component runs to 255, to 65535 or to 1. The type alone does not tell: writers put 0 to 255 into shorts and floats
//! too. So the largest value of the file decides between the ranges that the type allows. Values are taken as sRGB.

use super::scalar::Scalar;
use crate::raw::Findings;

/// The value that stands for full, where `max` is the largest value in the file.
pub(super) fn full_scale(kind: Scalar, max: f32) -> f32 {
    match kind {
        Scalar::U8 | Scalar::I8 => 255.0,
        // Up to 2 it can only be light above white; nothing that runs to 255 is as dark.
        Scalar::F32 | Scalar::F64 if max <= 2.0 => 1.0,
        _ if max <= 255.0 => 255.0,
        _ => 65535.0,
    }
}

/// The largest finite value.
pub(super) fn largest<'v>(values: impl Iterator<Item = &'v f32>) -> f32 {
    values.copied().filter(|v| v.is_finite()).fold(0.0, f32::max)
}

/// Round all colours to 8 bits; what is lost by that is counted.
pub(super) fn to_bytes(raw: &[[f32; 3]], kind: Scalar, findings: &mut Findings) -> Vec<[u8; 3]> {
    let full = full_scale(kind, largest(raw.iter().flatten()));
    if kind != Scalar::U8 && full == 255.0 && !raw.is_empty() {
        findings.add("colours of a wide type read as 0 to 255, because none is larger", || kind.name().to_owned());
    }
    let (mut rounded, mut clamped) = (0, 0);
    let colors = raw.iter().map(|color| {
        let mut off = 0.0f32;
        let mut outside = false;
        let bytes = color.map(|component| {
            let level = component / full * 255.0;
            let byte = level.round().clamp(0.0, 255.0);
            if (-0.001..=255.001).contains(&level) {
                off = off.max((level - byte).abs());
            } else {
                outside = true;
            }
            byte as u8 // NaN becomes 0
        });
        rounded += u64::from(off > 0.01);
        clamped += u64::from(outside);
        bytes
    });
    let colors = colors.collect();
    findings.add_many("colours rounded to 8 bits", rounded);
    findings.add_many("colours outside their range clamped", clamped);
    colors
}
