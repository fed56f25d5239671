//! Colours of every type to 8-bit sRGB.
//!
//! A component runs to 255, to 65535 or to 1. The type alone does not decide: writers put 0 to 255 into shorts and floats
//! too. So the largest value of the file decides between the ranges that the type allows; it is looked for before the
//! colours are handed on. Values are taken as sRGB.

use super::scalar::Scalar;
use crate::Diagnostics;
use glam::{DVec3, Vec3};

/// Colours of one element: their type, and what they have been found to run to.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    kind: Scalar,
    full: f32,
}

/// Whether the largest value must be known before the first can be converted.
pub(super) fn needs_scan(kind: Scalar) -> bool {
    !matches!(kind, Scalar::U8 | Scalar::I8)
}

impl Scale {
    /// The scale where `max` is the largest value in the file.
    pub(super) fn new(kind: Scalar, max: f32, diagnostics: &mut Diagnostics) -> Self {
        let full = full_scale(kind, max);
        if kind != Scalar::U8 && full == 255.0 {
            diagnostics
                .add("colours of a wide type read as 0 to 255, because none is larger", || kind.name().to_owned());
        }
        Self { kind, full }
    }

    /// One colour; what is lost by rounding is counted.
    #[inline]
    pub(super) fn color(self, color: DVec3, diagnostics: &mut Diagnostics) -> [u8; 3] {
        match self.kind {
            Scalar::U8 => color.to_array().map(|v| byte(v, diagnostics)),
            // Some writers say char and mean uchar.
            Scalar::I8 => self.round(color.map(|v| if v < 0.0 { v + 256.0 } else { v }).as_vec3(), diagnostics),
            _ => self.round(color.as_vec3(), diagnostics),
        }
    }

    fn round(self, color: Vec3, diagnostics: &mut Diagnostics) -> [u8; 3] {
        let mut off = 0.0f32;
        let mut outside = false;
        let bytes = color.to_array().map(|component| {
            let level = component / self.full * 255.0;
            let byte = level.round().clamp(0.0, 255.0);
            if (-0.001..=255.001).contains(&level) {
                off = off.max((level - byte).abs());
            } else {
                outside = true;
            }
            byte as u8 // NaN becomes 0
        });
        diagnostics.add_many("colours rounded to 8 bits", u64::from(off > 0.01));
        diagnostics.add_many("colours outside their range clamped", u64::from(outside));
        bytes
    }
}

/// The value that represents full, where `max` is the largest value in the file.
pub(super) fn full_scale(kind: Scalar, max: f32) -> f32 {
    match kind {
        Scalar::U8 | Scalar::I8 => 255.0,
        // Up to 2 it can only be light above white; nothing that runs to 255 is as dark.
        Scalar::F32 | Scalar::F64 if max <= 2.0 => 1.0,
        _ if max <= 255.0 => 255.0,
        _ => 65535.0,
    }
}

/// A colour component of 8 bits; only text can hold another value.
#[inline]
fn byte(value: f64, diagnostics: &mut Diagnostics) -> u8 {
    let byte = value as u8;
    if f64::from(byte) == value {
        return byte;
    }
    if (0.0..=255.0).contains(&value) {
        diagnostics.add_many("colours rounded to 8 bits", 1);
        value.round() as u8
    } else {
        diagnostics.add_many("colours outside their range clamped", 1);
        byte
    }
}
