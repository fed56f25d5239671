//! Sizes in bytes, as people write and read them.

use kilwa_pack::plural::counted;

/// Bytes from text such as `300M`, `1G`, `2.5GiB`, `800000000`: K, M, G, T are powers of 1024.
pub(crate) fn bytes(text: &str) -> Result<u64, String> {
    let wrong = || format!("{text:?} is no size; give for example 300M, 1G or 2.5GiB");
    let digits = text.find(|c: char| !c.is_ascii_digit() && c != '.').unwrap_or(text.len());
    let (number, unit) = text.split_at(digits);
    let number: f64 = number.parse().map_err(|_| wrong())?;
    let factor = match unit.trim().to_ascii_lowercase().as_str() {
        "" | "b" => 0,
        "k" | "kb" | "kib" => 1,
        "m" | "mb" | "mib" => 2,
        "g" | "gb" | "gib" => 3,
        "t" | "tb" | "tib" => 4,
        _ => return Err(wrong()),
    };
    let size = number * 1024f64.powi(factor);
    if size.is_finite() && size < 2f64.powi(60) { Ok(size as u64) } else { Err(wrong()) }
}

/// The smallest budget that a build accepts: less does not hold one diamond.
pub(crate) const LEAST_MEMORY: u64 = 100 << 20;

/// Bytes of memory for a build.
pub(crate) fn memory(text: &str) -> Result<u64, String> {
    let size = bytes(text)?;
    if size < LEAST_MEMORY {
        return Err(format!("{text} is too little to build with; give 100M or more"));
    }
    Ok(size)
}

/// A size for people, in powers of 1024.
pub(crate) fn human(bytes: u64) -> String {
    const UNITS: [&str; 5] = ["bytes", "KiB", "MiB", "GiB", "TiB"];
    let power = (0..UNITS.len() - 1).find(|p| bytes >> (10 * (p + 1)) == 0).unwrap_or(UNITS.len() - 1);
    let value = bytes as f64 / 1024f64.powi(power as i32);
    match power {
        0 => counted(bytes, "byte", "bytes").to_string(),
        _ if value < 10.0 => format!("{value:.1} {}", UNITS[power]),
        _ => format!("{value:.0} {}", UNITS[power]),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_read_as_people_write_them() {
        for (text, is) in [("300M", 300 << 20), ("1G", 1 << 30), ("2.5GiB", 5 << 29), ("1000", 1000), ("1 gb", 1 << 30)]
        {
            assert_eq!(bytes(text), Ok(is), "{text}");
        }
        for text in ["", "G", "-1G", "1X", "1e9", "1..2G", "NaN", "99999999T"] {
            assert!(bytes(text).is_err(), "{text}");
        }
        assert!(memory("99M").is_err() && memory("100M").is_ok());
        assert_eq!(
            [human(5), human(1536), human(300 << 20), human(5 << 29)],
            ["5 bytes", "1.5 KiB", "300 MiB", "2.5 GiB"]
        );
    }
}
