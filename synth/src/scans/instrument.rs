//! The instruments: what a beam becomes when it is measured.

use crate::fort::scene::Beam;

/// Which of the returns of a beam an instrument reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Returns {
    /// The nearest group of returns.
    First,
    /// The group that sends back most light.
    Strongest,
    /// The mean of everything that the beam touches, as with instruments that compare phases.
    Mean,
}

/// An instrument. Its standard deviation of a range r at an incidence θ is `noise[0] + noise[1] r + noise[2] / cos θ`, in metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Instrument {
    /// Name in the truth.
    pub name: &'static str,
    /// Columns for one column of the densest instrument.
    pub density: f64,
    /// Radius of the beam where it leaves, in metres.
    pub exit_radius: f64,
    /// Growth of the radius, in radians.
    pub divergence: f64,
    /// What is reported.
    pub returns: Returns,
    /// Returns nearer together than this are one, in metres.
    pub pulse: f64,
    /// a, b and c of the standard deviation.
    pub noise: [f64; 3],
    /// Nothing beyond this is measured, in metres.
    pub max_range: f64,
    /// Light from a white surface, upright at 20 m, is 1; half of what sends back this much is lost.
    pub sensitivity: f64,
}

/// The two instruments: a dense one that compares phases, and a coarser one that times pulses.
pub const INSTRUMENTS: [Instrument; 2] = [
    Instrument {
        name: "phase",
        density: 1.0,
        exit_radius: 0.002_2,
        divergence: 0.000_15,
        returns: Returns::Mean,
        pulse: 0.0,
        noise: [0.000_8, 0.000_01, 0.000_2],
        max_range: 80.0,
        sensitivity: 0.006,
    },
    Instrument {
        name: "pulse",
        density: 0.6,
        exit_radius: 0.003,
        divergence: 0.000_3,
        returns: Returns::First,
        pulse: 0.4,
        noise: [0.002, 0.000_02, 0.000_6],
        max_range: 120.0,
        sensitivity: 0.003,
    },
];

/// The lowest direction above the blind cone below the tripod, in degrees of elevation; the highest is the zenith.
pub const LOWEST_ELEVATION: f64 = -60.0;
/// Nothing nearer than this is measured, in metres.
pub const MIN_RANGE: f64 = 0.3;

impl Instrument {
    /// Columns and rows of a scan where the densest instrument has `columns`: equal steps of azimuth and elevation.
    pub fn grid(&self, columns: u32) -> (u32, u32) {
        let columns = ((f64::from(columns) * self.density).round() as u32).max(8);
        let rows = (f64::from(columns) * (90.0 - LOWEST_ELEVATION) / 360.0).round() as u32 + 1;
        (columns, rows)
    }

    pub(super) fn beam(&self) -> Beam {
        Beam { exit: self.exit_radius, spread: self.divergence }
    }
}
