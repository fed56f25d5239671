//! Scalar channels that hold coordinates: scans are exported with `scalar_X`, `Elevation` and the like, which tell the true place to a metre
//! wherever the model is moved to.
//!
//! Names say nothing reliable, so values are looked at: a channel that is a linear function of the position is a coordinate or a height, in
//! whatever unit and however turned; a large offset with a small range is a coordinate, too. Where the true location is known, ranges are also
//! compared with it. Every vertex of every level is read; memory is one chunk per thread.

use super::{AROUND_DEGREES, Location, MAP};
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
/// Units of length, in metres.
const UNITS: [f64; 8] = [1.0, 0.1, 0.01, 0.001, 1000.0, 0.3048, 1200.0 / 3937.0, 0.0254];
/// Units of angles, in degrees: degree, radian, gon.
const ANGLES: [f64; 3] = [1.0, 180.0 / std::f64::consts::PI, 0.9];

/// What was found of a channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Its name.
    pub name: String,
    /// Smallest and largest finite value.
    pub range: Option<[f64; 2]>,
    /// Share of its variance that a linear function of the position explains, 0 to 1.
    pub explained: f64,
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
    let (mut min, mut max) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
    for bounds in reader.entries().iter().map(|e| &e.bounds).filter(|b| !b.is_empty()) {
        for k in 0..3 {
            min[k] = min[k].min(f64::from(bounds.min[k]));
            max[k] = max[k].max(f64::from(bounds.max[k]));
        }
    }
    let middle: [f64; 3] = [0, 1, 2].map(|k| f64::midpoint(min[k], max[k]));
    let half = (0..3).map(|k| (max[k] - min[k]) / 2.0).fold(1.0, f64::max);
    // Values are centred as the metadata says, so that squares of large offsets do not swallow what varies.
    let scales: Vec<[f64; 2]> = channels
        .iter()
        .map(|c| {
            let (low, high) = (f64::from(c.min), f64::from(c.max));
            let half = (high - low) / 2.0;
            if half.is_finite() && half > 0.0 { [f64::midpoint(low, high), half] } else { [0.0, 1.0] }
        })
        .collect();
    let empty = || vec![Sums::default(); channels.len()];
    let count = u32::try_from(reader.entries().len()).unwrap_or(u32::MAX);
    let sums = (0..count)
        .into_par_iter()
        .try_fold(empty, |mut sums, index| {
            let chunk = reader.chunk(index)?;
            for ((sum, values), scale) in sums.iter_mut().zip(&chunk.mesh.scalars).zip(&scales) {
                for (p, value) in chunk.mesh.positions.iter().zip(values) {
                    let at = [0, 1, 2].map(|k| (f64::from(p[k]) - middle[k]) / half);
                    sum.add(at, f64::from(*value), scale);
                }
            }
            Ok(sums)
        })
        .try_reduce(empty, |mut a, b| {
            a.iter_mut().zip(&b).for_each(|(a, b)| a.merge(b));
            Ok(a)
        })?;
    let named = channels.iter().zip(sums);
    Ok(named.map(|(c, s)| Channel { name: c.name.clone(), range: s.range, explained: s.explained() }).collect())
}

/// Sums of a least-squares fit of a channel by 1, x, y and z.
#[derive(Debug, Clone, Default)]
struct Sums {
    range: Option<[f64; 2]>,
    count: f64,
    square: f64,
    products: [[f64; 4]; 4],
    with_value: [f64; 4],
}

impl Sums {
    fn add(&mut self, [x, y, z]: [f64; 3], value: f64, [middle, half]: &[f64; 2]) {
        if !value.is_finite() {
            return;
        }
        let [low, high] = self.range.unwrap_or([value; 2]);
        self.range = Some([low.min(value), high.max(value)]);
        let (v, terms) = ((value - middle) / half, [1.0, x, y, z]);
        self.count += 1.0;
        self.square += v * v;
        for ((row, sum), a) in self.products.iter_mut().zip(&mut self.with_value).zip(terms) {
            *sum += a * v;
            row.iter_mut().zip(terms).for_each(|(sum, b)| *sum += a * b);
        }
    }

    fn merge(&mut self, other: &Self) {
        self.range = match (self.range, other.range) {
            (Some(a), Some(b)) => Some([a[0].min(b[0]), a[1].max(b[1])]),
            (a, b) => a.or(b),
        };
        self.count += other.count;
        self.square += other.square;
        for (a, b) in self.products.iter_mut().flatten().zip(other.products.iter().flatten()) {
            *a += b;
        }
        self.with_value.iter_mut().zip(other.with_value).for_each(|(a, b)| *a += b);
    }

    fn explained(&self) -> f64 {
        let Some([low, high]) = self.range else { return 0.0 };
        let [mean, ..] = self.with_value;
        let total = self.square - mean * mean / self.count;
        if low == high || total <= 0.0 {
            return 0.0;
        }
        let mut rows = self.products;
        // A flat model leaves an axis open; a little weight settles it.
        for (k, row) in rows.iter_mut().enumerate().skip(1) {
            row[k] += 1e-9 * self.count;
        }
        let solution = solved(rows, self.with_value);
        let fitted: f64 = solution.iter().zip(self.with_value).map(|(c, b)| c * b).sum();
        (1.0 - (self.square - fitted) / total).clamp(0.0, 1.0)
    }
}

/// The solution of four symmetric positive equations.
fn solved(mut rows: [[f64; 4]; 4], mut right: [f64; 4]) -> [f64; 4] {
    for pivot in 0..4 {
        for below in pivot + 1..4 {
            let factor = rows[below][pivot] / rows[pivot][pivot];
            let from = rows[pivot];
            rows[below].iter_mut().zip(from).for_each(|(a, b)| *a -= factor * b);
            right[below] -= factor * right[pivot];
        }
    }
    let mut solution = [0.0; 4];
    for k in (0..4).rev() {
        let known: f64 = (k + 1..4).map(|j| rows[k][j] * solution[j]).sum();
        solution[k] = (right[k] - known) / rows[k][k];
    }
    solution
}

impl Channel {
    /// Why the channel gives the location away, as a sentence without a subject; nothing where it does not.
    pub fn gives_away(&self, location: &Location) -> Option<String> {
        if let Some(finding) = location.find(&self.name) {
            return Some(format!("has a name that gives the location away: {finding}"));
        }
        let [low, high] = self.range?;
        if self.explained > EXPLAINED {
            return Some(format!(
                "holds a coordinate or a height: its values, {low} to {high}, are a linear function of the position"
            ));
        }
        if let Some(axis) = location.agreeing(low, high) {
            return Some(format!("holds values from {low} to {high}, which agree with the {axis} of the model"));
        }
        let (middle, half) = (f64::midpoint(low, high).abs(), (high - low) / 2.0);
        (middle >= MAP && middle > OFFSET * half).then(|| {
            format!("holds values from {low} to {high}: a large offset with a small range, as map coordinates have")
        })
    }
}

impl Location {
    /// Which true coordinate a range of values agrees with.
    fn agreeing(&self, low: f64, high: f64) -> Option<&'static str> {
        let is_map = self.ranges.iter().any(|r| {
            UNITS.iter().any(|unit| {
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
        let height = max[2] - min[2];
        let is_height = height > 0.0
            && UNITS.iter().any(|unit| {
                (low * unit - min[2]).abs() < SAME_HEIGHT * height
                    && (high * unit - max[2]).abs() < SAME_HEIGHT * height
            });
        is_height.then_some("height")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fitted(value: impl Fn(f64, f64, f64) -> f32) -> Channel {
        let mut sums = Sums::default();
        // A rough dome of 20 m at map coordinates.
        for i in 0..60u32 {
            for j in 0..60u32 {
                let (x, y) = (f64::from(i) / 30.0 - 1.0, f64::from(j) / 30.0 - 1.0);
                let z = (1.5 - x * x - y * y) / 2.0 + f64::from((i * 7919 + j * 104_729) % 97) * 0.0005;
                sums.add([x, y, z], f64::from(value(x * 10.0, y * 10.0, z * 10.0)), &[0.0, 1.0]);
            }
        }
        Channel { name: "c".to_owned(), range: sums.range, explained: sums.explained() }
    }

    fn location() -> Location {
        Location::of([[565_970.0, 9_009_940.0, 31.0], [565_990.0, 9_009_960.0, 46.0]], Some("EPSG:32737"), None)
    }

    #[test]
    fn coordinates_and_heights_are_known_in_every_unit_and_turned() {
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

    #[test]
    fn channels_of_the_surface_pass() {
        for (name, channel) in [
            ("intensity", fitted(|x, y, _| ((x * 13.0 + y * 7.0).sin() * 2048.0) as f32)),
            ("confidence", fitted(|x, y, z| ((x * 91.0 + y * 53.0 + z).sin().abs()) as f32)),
            ("curvature", fitted(|x, y, _| (x * y) as f32)),
            ("class", fitted(|x, _, _| if x.sin() > 0.0 { 2.0 } else { 6.0 })),
            ("constant", fitted(|_, _, _| 1.0)),
            ("0 to 65535", fitted(|x, y, _| ((x * 3.0 + y * 5.0).sin().abs() * 65_535.0) as f32)),
        ] {
            assert_eq!(channel.gives_away(&location()), None, "{name}");
            assert_eq!(channel.gives_away(&Location::unknown()), None, "{name}");
        }
        let named = Channel { name: "dist_565977".to_owned(), range: None, explained: 0.0 };
        assert!(named.gives_away(&location()).unwrap().contains("name"));
    }
}
