//! Sizes in bytes, as people write and read them.

/// Bytes from a text such as `300M`, `1G`, `2.5GiB` or `800000000`: K, M, G and T are powers of 1024.
///
/// # Errors
/// A message, if the text is not a size.
pub fn parse(text: &str) -> Result<u64, String> {
    let wrong = || format!("{text:?} is not a size; write for example 300M, 1G or 2.5GiB");
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

/// The value, with a decimal point, and the unit of a size in powers of 1000: for files. Units are `byte`, `bytes`, `kB`, `MB` and `GB`.
pub fn decimal(bytes: u64) -> (String, &'static str) {
    let b = bytes as f64;
    match bytes {
        0..1_000 => (bytes.to_string(), byte(bytes)),
        1_000..1_000_000 => (format!("{:.0}", b / 1e3), "kB"),
        1_000_000..1_000_000_000 => (format!("{:.1}", b / 1e6), "MB"),
        _ => (format!("{:.2}", b / 1e9), "GB"),
    }
}

fn byte(bytes: u64) -> &'static str {
    if bytes == 1 { "byte" } else { "bytes" }
}

/// A size in powers of 1000, for files: `5.2 MB`.
pub fn text(bytes: u64) -> String {
    let (value, unit) = decimal(bytes);
    format!("{value} {unit}")
}

/// A size in powers of 1024, for memory and what is compared with it: `2.5 GiB`.
pub fn binary(bytes: u64) -> String {
    const UNITS: [&str; 5] = ["bytes", "KiB", "MiB", "GiB", "TiB"];
    let power = (0..UNITS.len() - 1).find(|p| bytes >> (10 * (p + 1)) == 0).unwrap_or(UNITS.len() - 1);
    let value = bytes as f64 / 1024f64.powi(power as i32);
    match power {
        0 => format!("{bytes} {}", byte(bytes)),
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
            assert_eq!(parse(text), Ok(is), "{text}");
        }
        for text in ["", "G", "-1G", "1X", "1e9", "1..2G", "NaN", "99999999T"] {
            let message = parse(text).unwrap_err();
            assert!(message.contains("is not a size; write for example 300M"), "{text}: {message}");
        }
    }

    #[test]
    fn sizes_are_written_in_the_largest_unit_that_leaves_a_number_above_one() {
        assert_eq!(
            [1, 999, 1000, 5_230_000, 2_500_000_000].map(text),
            ["1 byte", "999 bytes", "1 kB", "5.2 MB", "2.50 GB"]
        );
        assert_eq!(
            [1, 5, 1536, 300 << 20, 5 << 29].map(binary),
            ["1 byte", "5 bytes", "1.5 KiB", "300 MiB", "2.5 GiB"]
        );
    }
}
