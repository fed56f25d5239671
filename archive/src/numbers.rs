//! Numbers, sizes and lengths as people read them, in the landing page and the catalogue.

use glam::DVec3;

pub use kilwa_files::size::text as size;

/// 1234567 as `1 234 567`, with narrow no-break spaces.
pub fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut s = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            s.push('\u{202f}');
        }
        s.push(c);
    }
    s
}

/// Factor, unit and decimals that leave two to four digits of a length.
fn scale_of(metres: f64) -> (f64, &'static str, usize) {
    match metres.abs() {
        m if m < 1e-4 => (1e3, "mm", 3),
        m if m < 1e-3 => (1e3, "mm", 2),
        m if m < 0.1 => (1e3, "mm", 1),
        m if m < 1.0 => (1e2, "cm", 1),
        m if m < 10.0 => (1.0, "m", 2),
        m if m < 1e3 => (1.0, "m", 1),
        _ => (1e-3, "km", 2),
    }
}

/// Metres in the unit that fits them best.
pub fn length(v: f64) -> String {
    if !v.is_finite() {
        return "unknown".to_owned();
    }
    let (factor, unit, digits) = scale_of(v);
    format!("{:.digits$} {unit}", v * factor)
}

/// Width, depth and height in one unit.
pub fn size_in_space(e: DVec3) -> String {
    if !e.is_finite() {
        return "unknown".to_owned();
    }
    let (factor, unit, digits) = scale_of(e.max_element().max(0.0));
    let [x, y, z] = (e * factor).to_array().map(|v| format!("{v:.digits$}"));
    format!("{x} × {y} × {z} {unit}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_in_a_readable_form() {
        assert_eq!(grouped(1_234_567), "1\u{202f}234\u{202f}567");
        assert_eq!(grouped(12), "12");
        assert_eq!(length(0.0021), "2.1 mm");
        assert_eq!(length(0.221), "22.1 cm");
        assert_eq!(size_in_space(DVec3::new(52.43, 51.88, 0.5)), "52.4 × 51.9 × 0.5 m");
        assert_eq!(size_in_space(DVec3::new(2e-4, 1e-4, 3e-5)), "0.20 × 0.10 × 0.03 mm");
    }
}
