//! Samples that rays of other stations pass through.
//!
//! What a station saw is kept as a range image: equal steps of azimuth and elevation, and in each pixel the nearest range. A sample of another station is
//! taken to the coordinates of the witness; where the witness measured something farther away in that direction, its ray passed through the place of
//! the sample. One pixel would also be passed through beside a thin bar or along a surface seen at a grazing angle, so that the pixels around it count
//! too: each keeps the *nearest* range, and all must be farther.

use glam::{DVec3, Vec3};

/// What a witness says of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Witness {
    /// It did not see there, or saw something as near or nearer.
    Silent,
    /// Its rays passed through, but for a few of the pixels around.
    Partly,
    /// All its rays there passed through.
    Through,
}

/// What a station saw in the direction of a place.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Seen {
    /// It does not look in that direction.
    Outside,
    /// It looked, and nothing came back.
    NoReturn,
    /// Something nearer.
    Hidden,
    /// Something about there.
    At,
    /// Something farther away: its rays passed through.
    Through,
}

/// How near the pixels around may be blocked for [`Witness::Partly`].
const MOST_BLOCKED: u32 = 2;
/// Pixels to each side where a column of azimuth is narrow, near the zenith.
const MAX_SIDE: i64 = 12;
/// Largest width of a range image in pixels: 33 MB.
pub const MAX_WIDTH: u32 = 4096;

/// The nearest range in every direction around a station.
#[derive(Debug, Clone)]
pub struct RangeImage {
    width: u32,
    height: u32,
    step: f64,
    /// Infinite where nothing was measured.
    nearest: Vec<f32>,
    farthest: f32,
    /// The first and the last row that has a measured point.
    rows: [u32; 2],
    /// The columns that have one.
    columns: Vec<bool>,
}

impl RangeImage {
    /// An empty image of a station whose rays are `spacing` radians apart. Pixels are a little wider than that, so that nearly each has a sample, and no
    /// narrower than [`MAX_WIDTH`] allows.
    pub fn new(spacing: f64) -> Self {
        const ROOM: f64 = 1.3;
        let turn = std::f64::consts::TAU;
        let wanted = turn / (ROOM * spacing).max(1e-6);
        let width = (wanted as u32).clamp(16, MAX_WIDTH);
        let step = turn / f64::from(width);
        let height = width.div_ceil(2);
        let nearest = vec![f32::INFINITY; width as usize * height as usize];
        Self { width, height, step, nearest, farthest: 0.0, rows: [u32::MAX, 0], columns: vec![false; width as usize] }
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        self.nearest.len() * size_of::<f32>()
    }

    /// The nearest range of each pixel, metres; infinite where nothing was measured.
    pub fn pixels(&self) -> &[f32] {
        &self.nearest
    }

    /// Bytes of an image of this size.
    pub fn full_bytes(&self) -> usize {
        self.width as usize * self.height as usize * size_of::<f32>()
    }

    /// The same without its pixels, which [`Self::filled`] gives back.
    #[must_use]
    pub fn emptied(&self) -> Self {
        Self { nearest: Vec::new(), ..self.clone() }
    }

    /// An emptied image with its pixels.
    #[must_use]
    pub fn filled(&self, nearest: Vec<f32>) -> Self {
        debug_assert_eq!(nearest.len() * size_of::<f32>(), self.full_bytes());
        Self { nearest, ..self.clone() }
    }

    /// Enter a point that the station measured, in its coordinates.
    pub fn add(&mut self, position: Vec3) {
        let range = position.length();
        if range > 0.0 {
            let (column, row) = self.pixel(position.as_dvec3(), f64::from(range));
            let pixel = &mut self.nearest[row as usize * self.width as usize + column as usize];
            *pixel = pixel.min(range);
            self.farthest = self.farthest.max(range);
            self.rows = [self.rows[0].min(row), self.rows[1].max(row)];
            self.columns[column as usize] = true;
        }
    }

    /// The horizontal range of view: the nearest range at elevations up to `band` radians, in this many equal steps of azimuth from -π; infinite
    /// where there was no return, 0 outside the field of view.
    pub fn horizon(&self, steps: usize, band: f64) -> Vec<f32> {
        let middle = f64::from(self.height) / 2.0;
        let rows = (band / self.step).ceil();
        let (low, high) = ((middle - rows).max(0.0) as u32, ((middle + rows) as u32).min(self.height));
        let mut out = vec![f32::INFINITY; steps];
        let mut looked = vec![false; steps];
        for column in 0..self.width {
            let step = (column as usize * steps / self.width as usize).min(steps - 1);
            looked[step] |= self.columns[column as usize];
            for row in low..high {
                out[step] = out[step].min(self.nearest[row as usize * self.width as usize + column as usize]);
            }
        }
        out.iter_mut().zip(looked).filter(|(_, looked)| !looked).for_each(|(range, _)| *range = 0.0);
        out
    }

    fn pixel(&self, p: DVec3, range: f64) -> (u32, u32) {
        let azimuth = libm::atan2(p.y, p.x) + std::f64::consts::PI;
        let elevation = libm::asin((p.z / range).clamp(-1.0, 1.0)) + std::f64::consts::FRAC_PI_2;
        let column = ((azimuth / self.step) as u32).min(self.width - 1);
        let row = ((elevation / self.step) as u32).min(self.height - 1);
        (column, row)
    }

    fn at(&self, column: i64, row: i64) -> f32 {
        if !(0..i64::from(self.height)).contains(&row) {
            return f32::INFINITY;
        }
        let column = column.rem_euclid(i64::from(self.width));
        self.nearest[row as usize * self.width as usize + column as usize]
    }

    /// What the station saw in the direction of `place` (in its coordinates); a ray passed through if it went at least `margin` metres farther.
    pub fn look(&self, place: DVec3, margin: f64) -> Seen {
        let range = place.length();
        if range <= 0.0 {
            return Seen::Outside;
        }
        let (column, row) = self.pixel(place, range);
        if row < self.rows[0] || row > self.rows[1] || !self.columns[column as usize] {
            return Seen::Outside;
        }
        let (column, row) = (i64::from(column), i64::from(row));
        let around = (-1..=1).flat_map(|r| (-1..=1).map(move |c| (c, r))).map(|(c, r)| self.at(column + c, row + r));
        let nearest = f64::from(around.fold(f32::INFINITY, f32::min));
        let own = match f64::from(self.at(column, row)) {
            // An empty pixel takes the nearest range of its neighbours.
            f64::INFINITY => nearest,
            own => own,
        };
        if own.is_infinite() {
            Seen::NoReturn
        } else if own < range - margin {
            Seen::Hidden
        } else if own <= range + margin {
            Seen::At
        } else if nearest <= range + margin && self.witness(place, margin) == Witness::Silent {
            // Beside something nearer, which the ray just missed.
            Seen::Hidden
        } else {
            Seen::Through
        }
    }

    /// Whether rays of the station passed through `place` (in its coordinates) and at least `margin` metres farther.
    pub fn witness(&self, place: DVec3, margin: f64) -> Witness {
        let range = place.length();
        let limit = (range + margin) as f32;
        if limit >= self.farthest || range <= 0.0 {
            return Witness::Silent;
        }
        let (column, row) = self.pixel(place, range);
        let (column, row) = (i64::from(column), i64::from(row));
        let own = self.at(column, row);
        if own == f32::INFINITY || own <= limit {
            return Witness::Silent;
        }
        // Columns are narrower near the zenith: as many as one pixel is wide at the horizon.
        let cos = (1.0 - (place.z / range) * (place.z / range)).max(1e-6).sqrt();
        let side = ((1.0 / cos) as i64).clamp(1, MAX_SIDE);
        let (mut seen, mut blocked, mut all) = (0, 0, 0);
        for r in row - 1..=row + 1 {
            for c in column - side..=column + side {
                let nearest = self.at(c, r);
                all += 1;
                seen += u32::from(nearest < f32::INFINITY);
                blocked += u32::from(nearest <= limit);
            }
        }
        // Where most of the surroundings are without a return, little is known.
        if 3 * seen < 2 * all || blocked > MOST_BLOCKED {
            Witness::Silent
        } else if blocked > 0 {
            Witness::Partly
        } else {
            Witness::Through
        }
    }
}

/// Counts of witnesses for one sample, in a byte.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Tally(u8);

impl Tally {
    const MOST: u8 = 15;

    /// Enter what a witness says.
    pub fn add(&mut self, witness: Witness) {
        let (any, whole) = (self.0 & 15, self.0 >> 4);
        let any = (any + u8::from(witness >= Witness::Partly)).min(Self::MOST);
        let whole = (whole + u8::from(witness == Witness::Through)).min(Self::MOST);
        self.0 = any | whole << 4;
    }

    /// Witnesses whose rays passed through, at least partly; at most 15.
    pub fn any(self) -> u8 {
        self.0 & 15
    }

    /// Witnesses all of whose rays passed through; at most 15.
    pub fn whole(self) -> u8 {
        self.0 >> 4
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STEP: f64 = 0.004;

    /// Around a station in the middle of a sphere of 10 m, with a bar of this half width (radians) at 5 m, straight up in the middle of the view.
    fn image(half: f64) -> RangeImage {
        let mut image = RangeImage::new(STEP);
        let columns = (std::f64::consts::TAU / STEP) as i32;
        for column in 0..columns {
            for row in -380..=380 {
                let (a, e) = (f64::from(column) * STEP, f64::from(row) * STEP);
                let turned = (a + std::f64::consts::PI).rem_euclid(std::f64::consts::TAU) - std::f64::consts::PI;
                let range = if turned.abs() < half && e.abs() < 0.5 { 5.0 } else { 10.0 };
                let d = DVec3::new(libm::cos(e) * libm::cos(a), libm::cos(e) * libm::sin(a), libm::sin(e));
                image.add((d * range).as_vec3());
            }
        }
        image
    }

    #[test]
    fn a_place_before_the_wall_is_passed_through_and_one_on_or_behind_it_is_not() {
        let image = image(0.0);
        for (range, expected) in [
            (1.0, Witness::Through),
            (9.5, Witness::Through),
            (9.95, Witness::Silent),
            (10.0, Witness::Silent),
            (12.0, Witness::Silent),
        ] {
            for direction in [DVec3::X, DVec3::new(-1.0, 0.001, 0.0), DVec3::new(0.1, -0.2, 0.97).normalize()] {
                assert_eq!(image.witness(direction * range, 0.1), expected, "{range} {direction}");
            }
        }
    }

    #[test]
    fn a_bar_as_wide_as_a_step_is_protected_also_just_beside_its_rays() {
        let image = image(STEP);
        for across in [-1.0, -0.5, 0.0, 0.7, 1.0] {
            let place = DVec3::new(5.0, 5.0 * STEP * across, 0.3);
            assert_eq!(image.witness(place, 0.1), Witness::Silent, "{across}");
        }
        assert_eq!(image.witness(DVec3::new(5.0, 0.2, 0.3), 0.1), Witness::Through);
        assert_eq!(image.witness(DVec3::new(4.0, 0.0, 0.3), 0.1), Witness::Through, "before the bar");
    }

    #[test]
    fn a_direction_without_returns_is_no_witness() {
        let mut image = RangeImage::new(STEP);
        image.add(Vec3::new(10.0, 0.0, 0.0));
        assert_eq!(image.witness(DVec3::new(5.0, 0.0, 0.0), 0.1), Witness::Silent, "one ray alone");
        assert_eq!(image.witness(DVec3::new(0.0, 5.0, 0.0), 0.1), Witness::Silent);
        assert_eq!(image.witness(DVec3::ZERO, 0.1), Witness::Silent);
    }

    #[test]
    fn a_look_tells_before_at_and_behind_apart_and_where_nothing_came_back() {
        let image = image(0.05);
        let aside = DVec3::new(-1.0, 0.3, 0.1).normalize();
        assert_eq!(image.look(aside * 5.0, 0.1), Seen::Through);
        assert_eq!(image.look(aside * 9.95, 0.1), Seen::At);
        assert_eq!(image.look(aside * 10.5, 0.1), Seen::Hidden);
        assert_eq!(image.look(DVec3::X * 8.0, 0.1), Seen::Hidden, "behind the bar");
        assert_eq!(image.look(DVec3::Z * 5.0, 0.1), Seen::Outside, "above the highest row");
        let mut few = RangeImage::new(STEP);
        few.add(Vec3::new(10.0, 0.0, -1.0));
        few.add(Vec3::new(10.0, 0.0, 1.0));
        assert_eq!(few.look(DVec3::new(5.0, 0.0, 0.0), 0.1), Seen::NoReturn);
        assert_eq!(few.look(DVec3::new(-5.0, 0.0, 0.0), 0.1), Seen::Outside, "a scan of a part of the horizon");
    }

    #[test]
    fn tallies_count_up_to_fifteen() {
        let mut tally = Tally::default();
        for witness in [Witness::Silent, Witness::Partly, Witness::Through] {
            tally.add(witness);
        }
        assert_eq!((tally.any(), tally.whole()), (2, 1));
        (0..300).for_each(|_| tally.add(Witness::Through));
        assert_eq!((tally.any(), tally.whole()), (15, 15));
    }
}
