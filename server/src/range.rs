//! The `Range` header of a pack request (RFC 9110 section 14), single ranges only.
//!
//! What is not understood (another unit, nonsense, several ranges at once) is ignored, as the RFC allows: the answer is
//! then the whole file, which is never wrong.

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
    fn ranges_mean_what_the_rfc_says() {
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
    fn tags_are_compared_whole() {
        assert!(lists("\"a\", \"b\"", "\"b\"", false));
        assert!(lists("*", "\"b\"", false));
        assert!(lists("W/\"b\"", "\"b\"", true));
        assert!(!lists("W/\"b\"", "\"b\"", false));
        assert!(!lists("\"bb\"", "\"b\"", true));
        assert!(!lists("b", "\"b\"", true));
    }
}
