//! The outline of the land, for the map.
//!
//! `assets/land.txt` is Natural Earth 1:50m (public domain) made small by `xtask/npm/land.mjs`: one ring a line, in the polyline encoding
//! (differences of latitude and longitude in hundredths of a degree). Rings are closed, none crosses the 180th meridian.

use std::sync::LazyLock;

/// Longitude and latitude, degrees.
pub(crate) type Point = [f64; 2];

/// A ring, and its smallest and largest corner.
struct Ring {
    points: Vec<Point>,
    low: Point,
    high: Point,
}

static RINGS: LazyLock<Vec<Ring>> = LazyLock::new(|| {
    include_str!("../../assets/land.txt")
        .lines()
        .filter_map(decoded)
        .filter(|points| points.len() > 2)
        .map(ring)
        .collect()
});

fn ring(points: Vec<Point>) -> Ring {
    let corner =
        |start: f64, pick: fn(f64, f64) -> f64| [0, 1].map(|k: usize| points.iter().map(|p| p[k]).fold(start, pick));
    let (low, high) = (corner(f64::INFINITY, f64::min), corner(f64::NEG_INFINITY, f64::max));
    Ring { points, low, high }
}

/// The points of a line; `None` where it is none of this encoding.
fn decoded(line: &str) -> Option<Vec<Point>> {
    let mut numbers = Vec::new();
    let (mut value, mut shift) = (0u32, 0);
    for b in line.bytes() {
        let bits = u32::from(b.checked_sub(63)?);
        value |= (bits & 31).checked_shl(shift)?;
        shift += 5;
        if bits < 32 {
            let half = (value >> 1).cast_signed();
            numbers.push(if value & 1 == 0 { half } else { !half });
            (value, shift) = (0, 0);
        }
    }
    let mut at = [0i32; 2];
    let points = numbers.chunks_exact(2).map(|step| {
        at = [at[0].wrapping_add(step[0]), at[1].wrapping_add(step[1])];
        [f64::from(at[1]) / 100.0, f64::from(at[0]) / 100.0]
    });
    Some(points.collect())
}

/// The rings that meet a window, cut at it.
pub(crate) fn within(low: Point, high: Point) -> Vec<Vec<Point>> {
    let meets = |r: &&Ring| (0..2).all(|k| r.low[k] <= high[k] && low[k] <= r.high[k]);
    let cut = |r: &Ring| {
        let mut points = r.points.clone();
        for k in 0..2 {
            points = cut(&points, k, |v| v >= low[k], low[k]);
            points = cut(&points, k, |v| v <= high[k], high[k]);
        }
        points
    };
    RINGS.iter().filter(meets).map(cut).filter(|points| points.len() > 2).collect()
}

/// The part of a ring on one side of a line, after Sutherland and Hodgman.
fn cut(points: &[Point], k: usize, is_inside: impl Fn(f64) -> bool, limit: f64) -> Vec<Point> {
    let mut kept = Vec::with_capacity(points.len());
    let Some(mut last) = points.last().copied() else { return kept };
    for &point in points {
        if is_inside(point[k]) != is_inside(last[k]) {
            let share = (limit - last[k]) / (point[k] - last[k]);
            let mut crossing = [0, 1].map(|i: usize| last[i] + (point[i] - last[i]) * share);
            crossing[k] = limit;
            kept.push(crossing);
        }
        if is_inside(point[k]) {
            kept.push(point);
        }
        last = point;
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    fn area(points: &[Point]) -> f64 {
        let next = points.iter().cycle().skip(1);
        points.iter().zip(next).map(|(a, b)| a[0] * b[1] - b[0] * a[1]).sum::<f64>() / 2.0
    }

    /// Whether a point is on land: how often a line to the west crosses a ring.
    fn is_land(at: Point) -> bool {
        let crossings =
            RINGS.iter().flat_map(|r| r.points.iter().zip(r.points.iter().cycle().skip(1))).filter(|(a, b)| {
                (a[1] > at[1]) != (b[1] > at[1]) && a[0] + (b[0] - a[0]) * (at[1] - a[1]) / (b[1] - a[1]) < at[0]
            });
        crossings.count() % 2 == 1
    }

    #[test]
    fn the_coastline_is_that_of_the_earth() {
        assert!(
            RINGS.len() > 300 && RINGS.iter().all(|r| r.low[0] >= -180.0 && r.high[0] <= 180.0 && r.high[1] <= 90.0)
        );
        let steps = RINGS.iter().flat_map(|r| r.points.windows(2));
        let leaps = steps.filter(|p| (p[0][0] - p[1][0]).abs() > 180.0 && p[0][1] > -89.0);
        assert_eq!(leaps.count(), 0, "no ring runs across the map from one end to the other");
        for (name, at, wanted) in [
            ("Dodoma", [35.7, -6.2], true),
            ("Paris", [2.35, 48.85], true),
            ("Manaus", [-60.0, -3.1], true),
            ("Zanzibar's channel", [38.98, -6.3], false),
            ("the Atlantic", [-30.0, 0.0], false),
            ("between Fiji and the rest", [0.0, -16.8], false),
            ("Chukotka beyond the 180th meridian", [-175.0, 67.0], true),
            ("Madagascar", [46.5, -19.5], true),
            ("the south pole", [0.0, -88.0], true),
        ] {
            assert_eq!(is_land(at), wanted, "{name}");
        }
    }

    #[test]
    fn a_clipped_outline_lies_in_the_window_and_keeps_its_area() {
        let square = vec![[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0]];
        let half = cut(&square, 0, |v| v <= 1.0, 1.0);
        assert_eq!(area(&half), 4.0);
        let (low, high) = ([30.0, -15.0], [45.0, 0.0]);
        let rings = within(low, high);
        assert!(!rings.is_empty());
        for point in rings.iter().flatten() {
            assert!((0..2).all(|k| (low[k]..=high[k]).contains(&point[k])), "{point:?}");
        }
        let land: f64 = rings.iter().map(|r| area(r).abs()).sum();
        assert!((100.0..225.0).contains(&land), "{land} square degrees of 225 are land on this coast");
        assert!(within([-40.0, -5.0], [-35.5, 5.0]).iter().map(|r| area(r).abs()).sum::<f64>() < 5.0);
    }

    #[test]
    fn a_line_in_another_encoding_is_skipped() {
        assert_eq!(decoded("_p~iF~ps|U").unwrap().len(), 1);
        assert_eq!(decoded(" ü"), None);
        assert!(decoded("~~~~~~~~~~~~~~~~").is_none_or(|points| points.is_empty()));
    }
}
