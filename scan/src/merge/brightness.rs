//! Intensities as if every place had been seen by the same instrument, at the same range and perpendicularly: see [`kilwa_scan_core::intensity`].

use super::cut::Station;
use super::{Intensity, PARTS, share};
use crate::ScanError;
use crate::import::Progress;
use crate::points::{StationPoint, points};
use glam::{DVec3, IVec3};
use kilwa_scan_core::Rays;
use kilwa_scan_core::intensity::{Falloff, Observation};
use std::collections::HashMap;

/// Edge of a place, metres.
const PLACE: f64 = 0.25;
/// Minimum number of samples of a station at a place.
const SAMPLES_MIN: u32 = 3;
/// Maximum number of observations kept. With more, only half of the places are used, then a quarter, and so on.
const OBSERVATIONS_MAX: usize = 1 << 20;
/// The share of samples that may be negative. If there are more, intensities are not on a linear scale.
const NEGATIVE_MAX: f64 = 0.001;

/// What became of intensities.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Light {
    /// There are none.
    #[default]
    None,
    /// Normalised for range, incidence and the gains of stations, from places that several stations saw.
    Normalised {
        /// Number of observations at them.
        observations: usize,
    },
    /// As in the files, because that was asked for.
    Raw,
    /// As in the files, because too few places were seen by several stations at different ranges or angles.
    Unknown,
    /// As in the files, because some are negative, as logarithms are.
    Negative,
}

/// The falloff of the stations, where it is known.
pub(super) struct Brightness {
    falloff: Option<Falloff>,
    /// The number of each station in it.
    numbers: Vec<usize>,
    pub(super) light: Light,
}

impl Brightness {
    /// Find the falloff.
    pub(super) fn of(
        stations: &[Station<'_>],
        has_intensity: bool,
        wanted: Intensity,
        progress: &dyn Progress,
    ) -> Result<Self, ScanError> {
        // The result must not depend on the order of the stations, not even in the last bit.
        let mut order: Vec<usize> = (0..stations.len()).collect();
        order.sort_by_key(|k| stations[*k].name());
        let mut numbers = vec![0; stations.len()];
        order.iter().enumerate().for_each(|(number, k)| numbers[*k] = number);
        let plain = |light| Self { falloff: None, numbers: Vec::new(), light };
        match (has_intensity, wanted) {
            (false, _) => return Ok(plain(Light::None)),
            (true, Intensity::Raw) => return Ok(plain(Light::Raw)),
            (true, Intensity::Normalised) if stations.len() < 2 => return Ok(plain(Light::Unknown)),
            _ => {}
        }
        let mut all = Seen::default();
        for (done, k) in order.iter().enumerate() {
            all.add(&stations[*k], done as u16, &mut |part, of| {
                if progress.is_stopped() {
                    return Err(ScanError::Stopped);
                }
                progress.update("measuring intensities", share(done, part, of), PARTS * stations.len() as u64);
                Ok(())
            })?;
        }
        if all.negative as f64 > NEGATIVE_MAX * all.samples as f64 {
            return Ok(plain(Light::Negative));
        }
        let mut instruments: Vec<_> = Vec::new();
        let instrument_of = |k: &usize| {
            let own = stations[*k].instrument();
            instruments.iter().position(|other| *other == own).unwrap_or_else(|| {
                instruments.push(own);
                instruments.len() - 1
            })
        };
        let instruments: Vec<usize> = order.iter().map(instrument_of).collect();
        let observations = all.observations();
        Ok(match Falloff::fit(&observations, &instruments) {
            None => plain(Light::Unknown),
            Some(falloff) => {
                let light = Light::Normalised { observations: observations.len() };
                Self { falloff: Some(falloff), numbers, light }
            }
        })
    }

    /// The factor by which to multiply an intensity of a station; `offset` leads from the instrument to the sample.
    pub(super) fn factor(&self, station: usize, offset: DVec3, normal: DVec3) -> f64 {
        let range = offset.length();
        let factor = |falloff: &Falloff| falloff.factor(self.numbers[station], range, -offset.dot(normal) / range);
        self.falloff.as_ref().filter(|_| range > 0.0).map_or(1.0, factor)
    }
}

/// A place: a cell of a grid, and the axis that its surface faces along, because the walls of a corner are seen at different angles.
type Place = (IVec3, u8);

fn place_of(point: &StationPoint) -> Place {
    let n = point.normal;
    let axis = (0..3).max_by(|i, j| n[*i].abs().total_cmp(&n[*j].abs())).unwrap_or(0);
    ((point.position / PLACE).floor().as_ivec3(), axis as u8 * 2 + u8::from(n[axis] < 0.0))
}

/// A number that looks random, to choose places by.
fn hash((cell, side): Place) -> u64 {
    let mut h = u64::from(side);
    for v in cell.to_array() {
        h = (h ^ u64::from(v.cast_unsigned())).wrapping_mul(0x9e37_79b9_7f4a_7c15);
        h ^= h >> 29;
    }
    h
}

/// Sums over the samples of a station at a place.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    log_intensity: f64,
    range: f64,
    cosine: f64,
    count: u32,
}

#[derive(Default)]
struct Seen {
    all: Vec<(Place, u16, Sums)>,
    /// Places whose hash has one of these bits are left out.
    mask: u64,
    samples: u64,
    negative: u64,
}

fn key((cell, side): Place) -> ([i32; 3], u8) {
    (cell.to_array(), side)
}

impl Seen {
    fn add(
        &mut self,
        station: &Station<'_>,
        number: u16,
        progress: &mut dyn FnMut(u64, u64) -> Result<(), ScanError>,
    ) -> Result<(), ScanError> {
        let mut reader = station.open()?;
        let header = *reader.header();
        if header.rays != Rays::Central || header.statistics.with_intensity == 0 {
            return Ok(());
        }
        let mut own: HashMap<Place, Sums> = HashMap::new();
        points(&mut reader, station.pose, &station.options.tessellate, &mut |points, done, total| {
            for point in points.iter().filter(|point| point.intensity.is_finite() && point.spacing > 0.0) {
                self.samples += 1;
                self.negative += u64::from(point.intensity < 0.0);
                let place = place_of(point);
                if point.intensity <= 0.0 || hash(place) & self.mask != 0 {
                    continue;
                }
                let offset = point.position - station.pose.translation;
                let range = offset.length();
                let sums = own.entry(place).or_default();
                sums.log_intensity += libm::log(f64::from(point.intensity));
                sums.range += range;
                sums.cosine += -offset.dot(point.normal) / range;
                sums.count += 1;
            }
            if own.len() > OBSERVATIONS_MAX {
                self.thin(&mut own);
            }
            progress(done, total)
        })?;
        self.all.extend(own.into_iter().filter(|(_, s)| s.count >= SAMPLES_MIN).map(|(place, s)| (place, number, s)));
        while self.all.len() > OBSERVATIONS_MAX {
            self.thin(&mut HashMap::new());
        }
        Ok(())
    }

    /// Leave out half of the places. Which ones remain in the end does not depend on the order of stations, only on how many there are.
    fn thin(&mut self, own: &mut HashMap<Place, Sums>) {
        self.mask = self.mask << 1 | 1;
        let mask = self.mask;
        self.all.retain(|(place, ..)| hash(*place) & mask == 0);
        own.retain(|place, _| hash(*place) & mask == 0);
    }

    /// The observations of places that several stations saw, by place and station.
    fn observations(mut self) -> Vec<Observation> {
        self.all.sort_unstable_by_key(|(place, station, _)| (key(*place), *station));
        let mut out = Vec::new();
        for (number, seen) in self.all.chunk_by(|a, b| a.0 == b.0).filter(|seen| seen.len() > 1).enumerate() {
            out.extend(seen.iter().map(|(_, station, sums)| {
                let count = f64::from(sums.count);
                Observation {
                    place: number as u32,
                    station: *station,
                    log_intensity: sums.log_intensity / count,
                    range: sums.range / count,
                    cosine: sums.cosine / count,
                }
            }));
        }
        out
    }
}
