//! Numbers in text files.

/// The number that a word represents, including the forms in which C writes NaN and infinity, which give NaN.
#[inline]
pub(super) fn number(word: &[u8]) -> Option<f64> {
    let plain = std::str::from_utf8(word).ok()?;
    if let Ok(v) = plain.parse() {
        return Some(v);
    }
    let lower = plain.trim_start_matches(['+', '-']).to_ascii_lowercase();
    let not_finite = ["nan(", "1.#ind", "1.#qnan", "1.#snan", "1.#inf"];
    not_finite.iter().any(|n| lower.starts_with(n)).then_some(f64::NAN)
}
