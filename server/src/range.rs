//! Which part of a file a request asks for: the `Range` header (RFC 9110 section 14), single ranges only; and the last step of a pack's
//! address, which may be several.
//!
//! A header that is not understood (another unit, nonsense, several ranges at once) is ignored, as the RFC allows: the answer is
//! then the whole file, which is never wrong.
//!
//! Several ranges have an address of their own, `/…/pack.kilwa/0-99,4096-8191`, and not the header: what answers to several ranges in a
//! header is put into no cache (RFC 9111, section 3.3; browsers keep none), and a page of another site would have to ask for leave first.

/// What part of a file a request asks for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Wanted {
    /// All of it.
    Whole,
    /// `start ..= end`, inside the file.
    Part {
        /// First byte.
        start: u64,
        /// Last byte, included.
        end: u64,
    },
    /// Nothing that the file has.
    Unsatisfiable,
}

/// Read a `Range` value against a file of `length` bytes.
pub(crate) fn parse(value: &str, length: u64) -> Wanted {
    let Some((unit, spec)) = value.trim().split_once('=') else { return Wanted::Whole };
    if !unit.trim().eq_ignore_ascii_case("bytes") {
        return Wanted::Whole;
    }
    let Some((first, last)) = spec.trim().split_once('-') else { return Wanted::Whole };
    match (first.trim(), last.trim()) {
        ("", suffix) => match digits(suffix) {
            None => Wanted::Whole,
            Some(0) => Wanted::Unsatisfiable,
            Some(_) if length == 0 => Wanted::Unsatisfiable,
            Some(n) => Wanted::Part { start: length.saturating_sub(n), end: length - 1 },
        },
        (first, last) => {
            let Some(start) = digits(first) else { return Wanted::Whole };
            let Some(end) = (if last.is_empty() { Some(u64::MAX) } else { digits(last) }) else { return Wanted::Whole };
            if end < start {
                Wanted::Whole
            } else if start >= length {
                Wanted::Unsatisfiable
            } else {
                Wanted::Part { start, end: end.min(length - 1) }
            }
        }
    }
}

/// Most ranges of one address. A browser's line and headers stay far below what the server reads of them.
pub(crate) const RANGES_MAX: usize = 64;

/// Read `first-last,first-last,…` against a file of `length` bytes: stretches `(start, length)` in the order of the header. `None` where it is
/// nonsense, more than [`RANGES_MAX`], reaches beyond the file, or names a byte twice: an answer is never longer than the file.
pub(crate) fn list(value: &str, length: u64) -> Option<Vec<(u64, u64)>> {
    let one = |range: &str| {
        let (first, last) = range.split_once('-')?;
        let (first, last) = (digits(first)?, digits(last)?);
        (first <= last && last < length).then(|| (first, last - first + 1))
    };
    let stretches: Vec<_> = value.split(',').take(RANGES_MAX + 1).map(one).collect::<Option<_>>()?;
    let mut sorted = stretches.clone();
    sorted.sort_unstable();
    let is_once = sorted.windows(2).all(|w| matches!(w, [a, b] if a.0 + a.1 <= b.0));
    (is_once && stretches.len() <= RANGES_MAX).then_some(stretches)
}

/// The address of a file, and the ranges behind it where it is a pack.
pub(crate) fn split(name: &str) -> (&str, Option<&str>) {
    match name.rsplit_once('/') {
        Some((file, ranges)) if is_pack(file) => (file, Some(ranges)),
        _ => (name, None),
    }
}

/// Whether a file's name is that of a pack, written as the server writes it.
pub(crate) fn is_pack(name: &str) -> bool {
    name.strip_suffix(".kilwa").is_some()
}

/// Digits only (no sign), saturating: a position beyond any file is still a position.
fn digits(s: &str) -> Option<u64> {
    if s.is_empty() || !s.bytes().all(|b| b.is_ascii_digit()) {
        return None;
    }
    Some(s.bytes().fold(0_u64, |n, b| n.saturating_mul(10).saturating_add(u64::from(b - b'0'))))
}

/// Whether an `If-None-Match` or `If-Match` list holds the strong tag `etag` (quotes included). `weak` also accepts
/// `W/"..."` of the same tag, as `If-None-Match` does.
pub(crate) fn lists(value: &str, etag: &str, weak: bool) -> bool {
    value.split(',').map(str::trim).any(|t| t == "*" || t == etag || (weak && t.strip_prefix("W/") == Some(etag)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_are_interpreted_as_the_rfc_defines() {
        let part = |start, end| Wanted::Part { start, end };
        for (value, length, wanted) in [
            ("bytes=0-0", 10, part(0, 0)),
            ("bytes=0-9", 10, part(0, 9)),
            ("bytes=0-10", 10, part(0, 9)),
            ("bytes=0-99999999999999999999999999", 10, part(0, 9)),
            ("bytes=9-", 10, part(9, 9)),
            ("bytes=10-", 10, Wanted::Unsatisfiable),
            ("bytes=10-12", 10, Wanted::Unsatisfiable),
            ("bytes=99999999999999999999999999-", 10, Wanted::Unsatisfiable),
            ("bytes=-1", 10, part(9, 9)),
            ("bytes=-10", 10, part(0, 9)),
            ("bytes=-11", 10, part(0, 9)),
            ("bytes=-0", 10, Wanted::Unsatisfiable),
            ("bytes=-5", 0, Wanted::Unsatisfiable),
            ("bytes=0-0", 0, Wanted::Unsatisfiable),
            ("Bytes=2-3", 10, part(2, 3)),
            ("bytes= 2-3", 10, part(2, 3)),
            ("bytes=3-2", 10, Wanted::Whole),
            ("bytes=", 10, Wanted::Whole),
            ("bytes=-", 10, Wanted::Whole),
            ("bytes=a-b", 10, Wanted::Whole),
            ("bytes=+1-2", 10, Wanted::Whole),
            ("bytes=1--2", 10, Wanted::Whole),
            ("bytes=0x1-2", 10, Wanted::Whole),
            ("bytes=0-1,3-4", 10, Wanted::Whole),
            ("bytes 0-1", 10, Wanted::Whole),
            ("items=0-1", 10, Wanted::Whole),
            ("", 10, Wanted::Whole),
        ] {
            assert_eq!(parse(value, length), wanted, "{value:?} of {length}");
        }
    }

    #[test]
    fn several_ranges_contain_no_byte_twice_and_stay_inside_the_file() {
        assert_eq!(list("0-9", 10), Some(vec![(0, 10)]));
        assert_eq!(list("7-7,0-2,3-4", 10), Some(vec![(7, 1), (0, 3), (3, 2)]), "in the order asked for");
        for nonsense in [
            "",
            "-",
            "1",
            "1-",
            "-1",
            "2-1",
            "0-10",
            "10-10",
            "0-3,3-4",
            "4-5,0-9",
            "0-1,",
            ",0-1",
            "0-1 ,3-4",
            "+0-1",
            "0-1;3-4",
            "0-99999999999999999999999999",
            "99999999999999999999999999-99999999999999999999999999",
            "0x0-1",
            "0-1,0-1",
        ] {
            assert_eq!(list(nonsense, 10), None, "{nonsense:?}");
        }
        assert_eq!(list("0-0", 0), None);
        let many = |n: u64| (0..n).map(|i| format!("{i}-{i}")).collect::<Vec<_>>().join(",");
        assert_eq!(list(&many(64), 1000).map(|l| l.len()), Some(64));
        assert_eq!(list(&many(65), 1000), None);
    }

    #[test]
    fn ranges_are_accepted_only_in_the_address_of_a_pack() {
        assert_eq!(split("v1/pack.ab.kilwa/0-9,20-29"), ("v1/pack.ab.kilwa", Some("0-9,20-29")));
        assert_eq!(split("v1/pack.ab.kilwa"), ("v1/pack.ab.kilwa", None));
        assert_eq!(split("v1/poster.jpg/0-9"), ("v1/poster.jpg/0-9", None));
        assert_eq!(split("v1/pack.ab.kilwa/"), ("v1/pack.ab.kilwa", Some("")));
    }

    #[test]
    fn tags_are_compared_whole() {
        assert!(lists("\"a\", \"b\"", "\"b\"", false));
        assert!(lists("*", "\"b\"", false));
        assert!(lists("W/\"b\"", "\"b\"", true));
        assert!(!lists("W/\"b\"", "\"b\"", false));
        assert!(!lists("\"bb\"", "\"b\"", true));
        assert!(!lists("b", "\"b\"", true));
    }
}
