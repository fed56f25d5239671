//! What the columns of a text file of points hold: decided once for a cloud, by its heading or by its first lines, because a line alone does not
//! show it (`0 0 1` is a colour and a normal).

use super::lines::{numbers, whole};

/// How much of a cloud is looked at, bytes and lines.
pub(super) const LOOKED_AT: usize = 64 << 10;
const MAX_ROWS: usize = 1000;
/// Most lines of names before the first point.
pub(super) const MAX_HEADINGS: usize = 2;

/// Which column holds what.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Order {
    /// Numbers in a line.
    pub(super) columns: usize,
    pub(super) position: [usize; 3],
    pub(super) intensity: Option<usize>,
    pub(super) color: Option<[usize; 3]>,
    pub(super) has_normal: bool,
}

impl Order {
    const fn new(columns: usize, intensity: Option<usize>, color: Option<[usize; 3]>, has_normal: bool) -> Self {
        Self { columns, position: [0, 1, 2], intensity, color, has_normal }
    }
}

const POINT: Order = Order::new(3, None, None, false);
const INTENSITY: Order = Order::new(4, Some(3), None, false);
const COLOR: Order = Order::new(6, None, Some([3, 4, 5]), false);
const NORMAL: Order = Order::new(6, None, None, true);
const INTENSITY_COLOR: Order = Order::new(7, Some(3), Some([4, 5, 6]), false);
const COLOR_INTENSITY: Order = Order::new(7, Some(6), Some([3, 4, 5]), false);

/// What the first lines show.
#[derive(Debug, PartialEq, Eq)]
pub(super) enum Found {
    /// The order, and what is to be reported where it could also be another one.
    Order(Order, Option<&'static str>),
    /// Numbers have decimal commas; how many lines come before the first such line.
    DecimalCommas(usize),
    /// No order has so many numbers, or columns that should be colours are not; how many lines come before the first point, and its numbers.
    Unknown(usize, usize),
}

/// Decide from the names before the cloud, if there are any, and the bytes with which it begins. The last line of these may be cut, unless they are
/// `whole`.
pub(super) fn order(start: &[u8], is_whole: bool, heading: Option<&[u8]>, is_pts: bool) -> Found {
    let all = memchr::memchr_iter(b'\n', start).count() + usize::from(is_whole);
    let mut heading = heading.map(<[u8]>::to_vec);
    let mut rows: Vec<[f64; 7]> = Vec::new();
    let (mut columns, mut before, mut headings) = (0, 0, 0);
    for (at, line) in start.split(|b| *b == b'\n').take(all).map(<[u8]>::trim_ascii).enumerate() {
        if line.is_empty() {
            continue;
        }
        if has_decimal_commas(line) {
            return Found::DecimalCommas(at);
        }
        let mut row = [0.0; 7];
        match numbers(line, &mut row) {
            _ if is_comment(line) => heading = Some(line.to_vec()).filter(|_| rows.is_empty()).or(heading),
            Err(_) if rows.is_empty() && !is_pts && headings < MAX_HEADINGS => {
                headings += 1;
                heading = Some(line.to_vec());
            }
            Ok(n) if n > 0 && rows.is_empty() && whole(line).is_none() => {
                (columns, before) = (n, at);
                rows.push(row);
            }
            Ok(n) if n == columns && rows.len() < MAX_ROWS => rows.push(row),
            // Another cloud, a mistake, or enough.
            _ => break,
        }
    }
    if rows.is_empty() {
        return Found::Order(POINT, None);
    }
    let named = heading.and_then(|names| named(&names)).filter(|order| order.columns == columns);
    let found = named.map(|order| (order, None)).or_else(|| by_values(&rows, columns, is_pts));
    found.map_or(Found::Unknown(before, columns), |(order, doubt)| Found::Order(order, doubt))
}

pub(super) fn is_comment(line: &[u8]) -> bool {
    line.starts_with(b"#") || line.starts_with(b"//")
}

/// A channel of a colour.
pub(super) fn is_channel(value: f64) -> bool {
    (0.0..=255.0).contains(&value) && value.fract() == 0.0
}

fn by_values(rows: &[[f64; 7]], columns: usize, is_pts: bool) -> Option<(Order, Option<&'static str>)> {
    let are_channels = |from: usize| rows.iter().all(|row| row[from..from + 3].iter().all(|v| is_channel(*v)));
    let length = |row: &[f64; 7]| row[3..6].iter().map(|v| v * v).sum::<f64>();
    let are_along_axes = || rows.iter().all(|row| length(row) <= 1.0) && rows.iter().any(|row| length(row) == 1.0);
    let decided = |order| Some((order, None));
    match columns {
        3 => decided(POINT),
        4 => decided(INTENSITY),
        6 if !are_channels(3) => decided(NORMAL),
        6 if are_along_axes() => {
            Some((NORMAL, Some("clouds of six columns whose last three, read as normals, could also be colours")))
        }
        6 => decided(COLOR),
        7 => match (are_channels(4), are_channels(3)) {
            (true, true) if !is_pts => Some((
                INTENSITY_COLOR,
                Some(
                    "clouds of seven columns without a heading, read as x y z intensity red green blue (x y z red green blue intensity is also possible)",
                ),
            )),
            (true, _) => decided(INTENSITY_COLOR),
            (false, true) => decided(COLOR_INTENSITY),
            (false, false) => None,
        },
        _ => None,
    }
}

/// The order that the names of a heading give, if all of them are known and each is there once.
fn named(heading: &[u8]) -> Option<Order> {
    const NAMES: [&[&str]; 10] = [
        &["x", "easting"],
        &["y", "northing"],
        &["z", "height", "elevation"],
        &["r", "red"],
        &["g", "green"],
        &["b", "blue"],
        &["i", "int", "intensity", "scalar_intensity", "reflectance", "amplitude"],
        &["nx", "normalx", "normal_x"],
        &["ny", "normaly", "normal_y"],
        &["nz", "normalz", "normal_z"],
    ];
    let heading = String::from_utf8_lossy(heading).to_lowercase();
    let words = heading.trim_start_matches(['#', '/']).split([' ', '\t', ',', ';', '\r']);
    // Units in brackets are no part of a name.
    let words = words.map(|word| word.trim_matches('"').split(['[', '(']).next().unwrap_or_default());
    let mut places = [None; NAMES.len()];
    let mut columns = 0;
    for word in words.filter(|word| !word.is_empty()) {
        let name = NAMES.iter().position(|names| names.contains(&word))?;
        if places[name].replace(columns).is_some() {
            return None;
        }
        columns += 1;
    }
    let three = |from: usize| Some([places[from]?, places[from + 1]?, places[from + 2]?]);
    let (position, color, normal) = (three(0)?, three(3), three(7));
    let used =
        3 + 3 * usize::from(color.is_some()) + 3 * usize::from(normal.is_some()) + usize::from(places[6].is_some());
    (used == columns).then_some(Order { columns, position, intensity: places[6], color, has_normal: normal.is_some() })
}

/// Whether a line can only be numbers with decimal commas: blanks, tabs or semicolons separate three words or more, and commas stand inside of words,
/// between digits.
pub(super) fn has_decimal_commas(line: &[u8]) -> bool {
    let words = line.split(|b| matches!(b, b' ' | b'\t' | b';')).filter(|word| !word.is_empty());
    let (mut count, mut commas) = (0, 0);
    for word in words {
        count += 1;
        let mut parts = word.strip_prefix(b"-").unwrap_or(word).split(|b| *b == b',');
        let is_whole = |part: &[u8]| !part.is_empty() && part.iter().all(u8::is_ascii_digit);
        let is_fraction = |part: &[u8]| {
            let mut parts = part.splitn(2, |b| b.eq_ignore_ascii_case(&b'e'));
            let exponent = |part: &[u8]| is_whole(part.strip_prefix(b"-").or(part.strip_prefix(b"+")).unwrap_or(part));
            parts.next().is_some_and(is_whole) && parts.next().is_none_or(exponent)
        };
        match (parts.next(), parts.next(), parts.next()) {
            (Some(first), Some(second), None) if is_whole(first) && is_fraction(second) => commas += 1,
            (Some(only), None, None) if is_whole(only) => {}
            _ => return false,
        }
    }
    count >= 3 && commas > 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decimal_commas_are_recognised_and_other_commas_are_not() {
        for line in ["1,23 4,56 7,89", "1,5;2;3", "-1,234\t5,678\t9,012\t12", "1,5e-3 2,0E+2 0 255 0 0"] {
            assert!(has_decimal_commas(line.as_bytes()), "{line}");
        }
        for line in
            ["1,2,3", "1.5, 2.5, 3.5", "1 2 3", "1.5,2.5,3.5 255 0 0", "1,2,3 4,5,6 7,8,9", "1,5 2,5", "X,Y,Z,I"]
        {
            assert!(!has_decimal_commas(line.as_bytes()), "{line}");
        }
    }

    #[test]
    fn headings_name_columns_in_any_order() {
        let order = |heading: &str| named(heading.as_bytes());
        assert_eq!(order("//X Y Z R G B Intensity"), Some(COLOR_INTENSITY));
        assert_eq!(order("# x, y, z, i, red, green, blue"), Some(INTENSITY_COLOR));
        assert_eq!(order("\"X[m]\";\"Y[m]\";\"Z[m]\";\"Nx\";\"Ny\";\"Nz\"\r"), Some(NORMAL));
        assert_eq!(order("Northing Easting Height").unwrap().position, [1, 0, 2]);
        for heading in ["X Y", "X Y Z Time", "X Y Z R G", "X Y Z X", "made by hand"] {
            assert_eq!(order(heading), None, "{heading}");
        }
    }

    #[test]
    fn values_decide_where_nothing_is_named_and_doubts_are_reported() {
        let found = |text: &str, is_pts| order(text.as_bytes(), true, None, is_pts);
        let decided = |order| Found::Order(order, None);
        assert_eq!(found("1 2 3 0 0 1\n1 2 3 0.6 0.8 0\n", false), decided(NORMAL));
        assert_eq!(found("1 2 3 0 0 1\n1 2 3 255 0 1\n", false), decided(COLOR));
        assert!(matches!(found("1 2 3 0 0 1\n1 2 3 1 0 0", false), Found::Order(NORMAL, Some(_))));
        assert_eq!(found("1 2 3 0.5 7 8 9\n", false), decided(INTENSITY_COLOR));
        assert_eq!(found("1 2 3 7 8 9 0.5\n", false), decided(COLOR_INTENSITY));
        assert!(matches!(found("1 2 3 7 8 9 10\n", false), Found::Order(INTENSITY_COLOR, Some(_))));
        assert_eq!(found("1 2 3 7 8 9 10\n", true), decided(INTENSITY_COLOR));
        assert_eq!(found("# a\n\n1 2 3 0.7 8 0.9 10\n", false), Found::Unknown(2, 7));
        assert_eq!(found("1 2 3 4 5\n", false), Found::Unknown(0, 5));
        assert_eq!(found("x y z\n1 2 3\n1,5 2 3\n", false), Found::DecimalCommas(2));
        // A line that is cut, and what belongs to the next cloud.
        assert_eq!(order(b"1 2 3 4\n1 2 3", false, None, true), decided(INTENSITY));
        assert_eq!(found("1 2 3 4\n1\n1 2 3 0 0 1\n", true), decided(INTENSITY));
    }
}
