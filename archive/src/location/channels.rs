//! Scalar channels that hold coordinates: scans are exported with `scalar_X`, `Elevation` and the like, which reveal the true location to a metre
//! wherever the model is moved to.
//!
//! Names say nothing reliable, so values are looked at: a channel that is a linear function of the position is a coordinate or a height, in
//! whatever unit and however turned; a large offset with a small range is a coordinate, too. Where the true location is known, ranges and single
//! values are also compared with it. All of this is checked for the whole channel and for groups of its values ([`samples`]), because missing values
//! and outliers would hide the rest. Every vertex of every level is read for the whole channel; groups come from a sample of the vertices.

use super::samples::{Group, KEPT, Sample, groups, is_mark};
use super::{AROUND_DEGREES, Location, MAP};
use glam::{DVec3, DVec4};
use kilwa_geometry::LengthUnit;
use kilwa_pack::{PackError, Reader, Source};
use rayon::prelude::*;

/// Share of a channel's variance that position explains, from which on it is a coordinate.
const EXPLAINED: f64 = 0.99;
/// An offset so many times larger than half of the range.
const OFFSET: f64 = 50.0;
/// A channel whose range is so much wider than the model's surroundings holds something else.
const WIDER: f64 = 20.0;
/// Heights agree when both ends of their ranges do, by this share of the model's height.
const SAME_HEIGHT: f64 = 0.02;
/// Units of angles, in degrees: degree, radian, gon.
const ANGLES: [f64; 3] = [1.0, 180.0 / std::f64::consts::PI, 0.9];

/// A value counts as the coordinate of its vertex if it is this near to it, as a share of the model's size along the axis.
const OWN: f64 = 0.02;
/// A channel is refused if more than this share of its values is near the coordinate of their vertex, or near the place. The second share is for heights
/// and degrees, which other values match more often by chance.
const SHARE: f64 = 0.05;
const LARGE_SHARE: f64 = 0.4;
/// A value counts as near a known latitude or longitude if it is this near, degrees.
const NEAR_DEGREES: f64 = 0.01;

/// What was found of a channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Its name.
    pub name: String,
    /// All of its values as one group, if any is finite.
    whole: Option<Group>,
    /// Its values in groups.
    groups: Vec<Group>,
    samples: Vec<Sample>,
}

/// What is read from a channel.
#[derive(Debug, Clone, Default)]
struct Read {
    sums: Sums,
    samples: Vec<Sample>,
}

/// Look at every value of every channel.
///
/// # Errors
/// [`PackError`] when a chunk is damaged or cannot be read.
pub fn survey<S: Source + Sync>(reader: &Reader<S>) -> Result<Vec<Channel>, PackError> {
    let channels = &reader.metadata().scalars;
    if channels.is_empty() {
        return Ok(Vec::new());
    }
    let (mut min, mut max) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for bounds in reader.entries().iter().map(|e| &e.bounds).filter(|b| !b.is_empty()) {
        (min, max) = (min.min(bounds.min.as_dvec3()), max.max(bounds.max.as_dvec3()));
    }
    let middle = min.midpoint(max);
    let half = ((max - min) / 2.0).max_element().max(1.0);
    // Values are centred as the metadata says, so that squares of large offsets do not swallow what varies.
    let scales: Vec<[f64; 2]> = channels
        .iter()
        .map(|c| {
            let (low, high) = (f64::from(c.min), f64::from(c.max));
            let half = (high - low) / 2.0;
            if half.is_finite() && half > 0.0 { [f64::midpoint(low, high), half] } else { [0.0, 1.0] }
        })
        .collect();
    let empty = || vec![Read::default(); channels.len()];
    let count = u32::try_from(reader.entries().len()).unwrap_or(u32::MAX);
    let lattice = reader.header().lattice;
    let stride = usize::try_from(reader.header().stored_vertices / KEPT).unwrap_or(usize::MAX).max(1);
    let read = (0..count)
        .into_par_iter()
        .try_fold(empty, |mut read, index| {
            let chunk = reader.chunk(index)?;
            // The first vertex differs from chunk to chunk, so that small chunks are sampled too.
            let first = (index as usize).wrapping_mul(0x9e37_79b1) % stride;
            for ((read, values), scale) in read.iter_mut().zip(&chunk.mesh.scalars).zip(&scales) {
                let mut all = chunk.mesh.positions.iter().zip(values).map(|(p, v)| (p.as_dvec3(), f64::from(*v)));
                all.clone().for_each(|(p, v)| read.sums.add((p - middle) / half, v, scale));
                let some = all.by_ref().skip(first).step_by(stride).filter(|(_, value)| value.is_finite());
                read.samples.extend(some.map(|(p, value)| Sample { at: lattice.world_from_steps(p), value }));
            }
            Ok(read)
        })
        .try_reduce(empty, |mut a, b| {
            a.iter_mut().zip(b).for_each(|(a, b)| {
                a.sums.merge(&b.sums);
                a.samples.extend(b.samples);
            });
            Ok(a)
        })?;
    Ok(channels.iter().zip(read).map(|(c, read)| Channel::of(&c.name, read)).collect())
}

/// Sums of a least-squares fit of a channel by 1, x, y and z.
#[derive(Debug, Clone, Default)]
pub(super) struct Sums {
    range: Option<[f64; 2]>,
    count: f64,
    square: f64,
    products: [DVec4; 4],
    with_value: DVec4,
}

impl Sums {
    pub(super) fn add(&mut self, DVec3 { x, y, z }: DVec3, value: f64, [middle, half]: &[f64; 2]) {
        if !value.is_finite() {
            return;
        }
        let [low, high] = self.range.unwrap_or([value; 2]);
        self.range = Some([low.min(value), high.max(value)]);
        let (v, terms) = ((value - middle) / half, DVec4::new(1.0, x, y, z));
        self.count += 1.0;
        self.square += v * v;
        self.with_value += terms * v;
        for (row, a) in self.products.iter_mut().zip(terms.to_array()) {
            *row += a * terms;
        }
    }

    fn merge(&mut self, other: &Self) {
        self.range = match (self.range, other.range) {
            (Some(a), Some(b)) => Some([a[0].min(b[0]), a[1].max(b[1])]),
            (a, b) => a.or(b),
        };
        self.count += other.count;
        self.square += other.square;
        for (a, b) in self.products.iter_mut().zip(other.products) {
            *a += b;
        }
        self.with_value += other.with_value;
    }

    pub(super) fn explained(&self) -> f64 {
        let Some([low, high]) = self.range else { return 0.0 };
        let mean = self.with_value.x;
        let total = self.square - mean * mean / self.count;
        if low == high || total <= 0.0 {
            return 0.0;
        }
        let fitted = self.fit().dot(self.with_value);
        (1.0 - (self.square - fitted) / total).clamp(0.0, 1.0)
    }

    /// The weights of 1, x, y and z.
    pub(super) fn fit(&self) -> DVec4 {
        let mut rows = self.products;
        // A flat model leaves an axis open; a little weight settles it.
        for (k, row) in rows.iter_mut().enumerate().skip(1) {
            row[k] += 1e-9 * self.count;
        }
        solved(rows, self.with_value)
    }
}

/// The solution of four symmetric positive equations.
fn solved(mut rows: [DVec4; 4], mut right: DVec4) -> DVec4 {
    for pivot in 0..4 {
        for below in pivot + 1..4 {
            let factor = rows[below][pivot] / rows[pivot][pivot];
            let from = rows[pivot];
            rows[below] -= factor * from;
            right[below] -= factor * right[pivot];
        }
    }
    let mut solution = DVec4::ZERO;
    for k in (0..4).rev() {
        let known: f64 = (k + 1..4).map(|j| rows[k][j] * solution[j]).sum();
        solution[k] = (right[k] - known) / rows[k][k];
    }
    solution
}

impl Channel {
    fn of(name: &str, Read { sums, samples }: Read) -> Self {
        let whole = sums.range.map(|range| Group { range, explained: sums.explained(), is_apart: true });
        Self { name: name.to_owned(), whole, groups: groups(&samples), samples }
    }

    /// Why the channel gives the location away, as a sentence without a subject; nothing where it does not.
    pub fn gives_away(&self, location: &Location) -> Option<String> {
        if let Some(finding) = location.find_in_name(&self.name) {
            return Some(format!("has a name that gives the location away: {finding}"));
        }
        let whole = self.whole.as_ref()?;
        let of_groups = || self.groups.iter().filter(|g| !g.is_mark()).find_map(|g| holds(g, location));
        holds(whole, location).or_else(of_groups).or_else(|| {
            let axis = location.shared(&self.samples)?;
            let [low, high] = whole.range;
            Some(format!("holds values from {low} to {high}, many of which are the {axis} of the model"))
        })
    }
}

/// Why a group of values gives the location away.
fn holds(group: &Group, location: &Location) -> Option<String> {
    let [low, high] = group.range;
    if group.explained > EXPLAINED {
        return Some(format!(
            "holds a coordinate or a height: its values, {low} to {high}, are a linear function of the position"
        ));
    }
    if let Some(axis) = location.agreeing(low, high) {
        return Some(format!("holds values from {low} to {high}, which agree with the {axis} of the model"));
    }
    let (middle, half) = (f64::midpoint(low, high).abs(), (high - low) / 2.0);
    (group.is_apart && middle >= MAP && middle > OFFSET * half).then(|| {
        format!("holds values from {low} to {high}: a large offset with a small range, as map coordinates have")
    })
}

impl Location {
    /// The true coordinate that many of the values are near.
    fn shared(&self, samples: &[Sample]) -> Option<&'static str> {
        let [min, max] = self.bounds?;
        let size = max - min;
        let is_more = |share: f64, is_near: &dyn Fn(&Sample) -> bool| {
            let count = samples.iter().filter(|s| is_near(s)).count();
            count > 0 && count as f64 > share * samples.len() as f64
        };
        let is_own = |axis: usize, unit: f64, s: &Sample| {
            let own = s.at[axis];
            let is_map = own.abs() >= MAP && !is_mark(s.value);
            let is_near = ((s.value * unit).abs() - own.abs()).abs() <= OWN * size[axis];
            is_near && (is_map || axis == 2)
        };
        let is_place = |unit: f64, s: &Sample| !is_mark(s.value) && self.ranges.iter().any(|r| r.has(s.value * unit));
        let is_any = |share, test: &dyn Fn(f64, &Sample) -> bool| {
            LengthUnit::ALL.iter().any(|u| is_more(share, &|s| test(u.metres(), s)))
        };
        if is_any(SHARE, &|u, s| is_own(0, u, s))
            || is_any(SHARE, &|u, s| is_own(1, u, s))
            || is_any(2.0 * SHARE, &is_place)
        {
            return Some("easting or northing");
        }
        let is_degrees = |d: f64, unit: f64, s: &Sample| {
            s.value.fract() != 0.0 && ((s.value * unit).abs() - d.abs()).abs() < NEAR_DEGREES
        };
        let near = |d: &f64| ANGLES.iter().any(|u| is_more(LARGE_SHARE, &|s| is_degrees(*d, *u, s)));
        if self.degrees.iter().any(near) {
            return Some("latitude or longitude");
        }
        (size.z > 0.0 && is_any(LARGE_SHARE, &|u, s| is_own(2, u, s))).then_some("height")
    }

    /// Which true coordinate a range of values agrees with.
    fn agreeing(&self, low: f64, high: f64) -> Option<&'static str> {
        let is_map = self.ranges.iter().any(|r| {
            LengthUnit::ALL.map(LengthUnit::metres).iter().any(|unit| {
                let (a, b) = (low * unit, high * unit);
                let meets = |low: f64, high: f64| low <= r.high && high >= r.low;
                (meets(a, b) || meets(-b, -a)) && b - a <= WIDER * (r.high - r.low)
            })
        });
        if is_map {
            return Some("easting or northing");
        }
        let is_degrees = self.degrees.iter().any(|d| {
            ANGLES.iter().any(|unit| [low, high].iter().all(|v| ((v * unit).abs() - d.abs()).abs() < AROUND_DEGREES))
        });
        if is_degrees {
            return Some("latitude or longitude");
        }
        let [min, max] = self.bounds?;
        let height = max.z - min.z;
        let is_height = height > 0.0
            && LengthUnit::ALL.map(LengthUnit::metres).iter().any(|unit| {
                (low * unit - min.z).abs() < SAME_HEIGHT * height && (high * unit - max.z).abs() < SAME_HEIGHT * height
            });
        is_height.then_some("height")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fitted(value: impl Fn(f64, f64, f64) -> f32) -> Channel {
        let (mut sums, mut samples) = (Sums::default(), Vec::new());
        // A rough dome of 20 m at map coordinates.
        for i in 0..60u32 {
            for j in 0..60u32 {
                let (x, y) = (f64::from(i) / 30.0 - 1.0, f64::from(j) / 30.0 - 1.0);
                let z = (1.5 - x * x - y * y) / 2.0 + f64::from((i * 7919 + j * 104_729) % 97) * 0.0005;
                let value = f64::from(value(x * 10.0, y * 10.0, z * 10.0));
                sums.add(DVec3::new(x, y, z), value, &[0.0, 1.0]);
                if value.is_finite() {
                    samples.push(Sample {
                        at: DVec3::new(565_980.0 + x * 10.0, 9_009_950.0 + y * 10.0, 38.0 + z * 10.0),
                        value,
                    });
                }
            }
        }
        Channel::of("c", Read { sums, samples })
    }

    /// A pseudo-random number from 0 to 1 for each vertex.
    fn scattered(x: f64, y: f64, z: f64) -> f64 {
        ((x * 12.9898 + y * 78.233 + z * 37.719).sin() * 43_758.545_3).rem_euclid(1.0)
    }

    fn location() -> Location {
        let bounds = [DVec3::new(565_970.0, 9_009_940.0, 31.0), DVec3::new(565_990.0, 9_009_960.0, 46.0)];
        Location::of(bounds, Some("EPSG:32737"), None)
    }

    #[test]
    fn coordinates_and_heights_are_found_in_every_unit_and_orientation() {
        let (east, north, height) = (565_980.0, 9_009_950.0, 38.0);
        let channels: Vec<(&str, Channel)> = vec![
            ("X", fitted(|x, _, _| (x + east) as f32)),
            ("Y", fitted(|_, y, _| (y + north) as f32)),
            ("elevation", fitted(|_, _, z| (z + height) as f32)),
            ("elevation in feet", fitted(|_, _, z| ((z + height) / 0.3048) as f32)),
            ("height above the ground", fitted(|_, _, z| z as f32)),
            ("kilometres", fitted(|x, _, _| ((x + east) / 1000.0) as f32)),
            ("latitude", fitted(|_, y, _| (-8.9562 + y / 111_000.0) as f32)),
            ("turned", fitted(|x, y, _| (0.6 * x - 0.8 * y + 1234.0) as f32)),
            ("rounded to 10 m", fitted(|x, _, _| (((x + east) / 10.0).round() * 10.0) as f32)),
            ("one value", fitted(|_, _, _| 565_977.0)),
        ];
        for (name, channel) in &channels {
            assert!(channel.gives_away(&location()).is_some(), "{name}: {channel:?}");
        }
        // Who does not know the location sees it as well, but for what is as coarse as the model is wide.
        for (name, channel) in &channels[..8] {
            assert!(channel.gives_away(&Location::unknown()).is_some(), "{name}: {channel:?}");
        }
    }

    /// Missing values as scanners and CloudCompare write them (0, -1, -9999, the largest float), at one vertex in thousands or at half of them.
    #[test]
    fn coordinates_are_found_among_missing_values_and_outliers() {
        type Value = fn(f64, f64, f64) -> f64;
        let coordinates: [(&str, Value); 5] = [
            ("X", |x, _, _| x + 565_980.0),
            ("Y", |_, y, _| y + 9_009_950.0),
            ("latitude", |_, y, _| -8.9562 + y / 111_000.0),
            ("height", |_, _, z| z + 38.0),
            ("turned", |x, y, _| 0.6 * x - 0.8 * y + 1234.0),
        ];
        for (name, coordinate) in coordinates {
            for missing in [0.0, -1.0, -100.0, -9999.0, 1e30, f64::from(f32::MAX), f64::NAN, f64::INFINITY] {
                for share in [0.0005, 0.001, 0.01, 0.1, 0.5] {
                    let channel = fitted(|x, y, z| {
                        let value = if scattered(x, y, z) < share { missing } else { coordinate(x, y, z) };
                        value as f32
                    });
                    for location in [location(), Location::unknown()] {
                        assert!(channel.gives_away(&location).is_some(), "{name}, {share} of {missing}");
                    }
                }
            }
            // Outliers that are all different, and a second coordinate.
            let wild = fitted(|x, y, z| {
                let chance = scattered(x, y, z);
                (if chance < 0.1 { chance * 2e7 - 1e6 } else { coordinate(x, y, z) }) as f32
            });
            assert!(
                wild.gives_away(&location()).is_some() && wild.gives_away(&Location::unknown()).is_some(),
                "{name}"
            );
            let both = fitted(|x, y, z| {
                let other = coordinates[1].1(x, y, z);
                (if scattered(x, y, z) < 0.5 { other } else { coordinate(x, y, z) }) as f32
            });
            assert!(both.gives_away(&location()).is_some(), "{name} or Y");
        }
        // Every other value is a random number as large as an easting.
        let among = fitted(|x, y, z| {
            let chance = scattered(x, y, z);
            (if chance < 0.5 { chance * 2e6 } else { x + 565_980.0 }) as f32
        });
        assert!(among.gives_away(&location()).is_some());
    }

    #[test]
    fn channels_that_describe_the_surface_are_accepted() {
        for (name, channel) in [
            ("intensity", fitted(|x, y, _| ((x * 13.0 + y * 7.0).sin() * 2048.0) as f32)),
            ("confidence", fitted(|x, y, z| ((x * 91.0 + y * 53.0 + z).sin().abs()) as f32)),
            ("curvature", fitted(|x, y, _| (x * y) as f32)),
            ("class", fitted(|x, _, _| if x.sin() > 0.0 { 2.0 } else { 6.0 })),
            ("constant", fitted(|_, _, _| 1.0)),
            ("0 to 65535", fitted(|x, y, _| ((x * 3.0 + y * 5.0).sin().abs() * 65_535.0) as f32)),
            ("scattered", fitted(|x, y, z| scattered(x, y, z) as f32)),
            ("8 bits", fitted(|x, y, z| (scattered(x, y, z) * 256.0).floor() as f32)),
            ("classes", fitted(|x, y, z| [0.0, 2.0, 9.0, 40.0][(scattered(x, y, z) * 4.0) as usize])),
            ("saturated", fitted(|x, y, z| (scattered(x, y, z) * 90_000.0).min(65_535.0) as f32)),
            (
                "saturated far off",
                fitted(|x, y, z| {
                    let v = scattered(x, y, z);
                    if v < 0.2 { 65_535.0 } else { (v * 4000.0) as f32 }
                }),
            ),
            (
                "missing",
                fitted(|x, y, z| {
                    let v = scattered(x, y, z);
                    if v < 0.05 { -32_768.0 } else { (v * 200.0) as f32 }
                }),
            ),
            (
                "missing 1e30",
                fitted(|x, y, z| {
                    let v = scattered(x, y, z);
                    if v < 0.05 { 1e30 } else { (v - 0.5) as f32 }
                }),
            ),
            (
                "heavy tails",
                fitted(|x, y, z| {
                    let v = scattered(x, y, z);
                    (0.01 / (v - 0.500_01)) as f32
                }),
            ),
            ("distance to the scanner", fitted(|x, y, _| (x - 3.0).hypot(y + 4.0) as f32)),
        ] {
            assert_eq!(channel.gives_away(&location()), None, "{name}");
            assert_eq!(channel.gives_away(&Location::unknown()), None, "{name}");
        }
        let named = Channel::of("dist_565977", Read::default());
        assert!(named.gives_away(&location()).unwrap().contains("name"));
    }
}
