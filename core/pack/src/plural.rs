//! Plurals in the English messages of the program: `1 file`, `2 files`. The page and the portal have messages in five
//! languages with the plural forms of each (`i18n/`).

use std::fmt::{self, Display};

/// `one` for 1, `other` for every other number: `plural(n, "is", "are")`.
pub fn plural<N: PartialEq + From<u8> + Copy>(n: N, one: &'static str, other: &'static str) -> &'static str {
    if n == N::from(1) { one } else { other }
}

/// A number and what it counts: `counted(n, "file", "files")` is `1 file` or `2 files`.
pub fn counted<N: Display + PartialEq + From<u8> + Copy>(n: N, one: &'static str, other: &'static str) -> Counted<N> {
    Counted { n, noun: plural(n, one, other) }
}

/// Made by [`counted`].
#[derive(Debug, Clone, Copy)]
pub struct Counted<N> {
    n: N,
    noun: &'static str,
}

impl<N: Display> Display for Counted<N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} {}", self.n, self.noun)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_is_singular_and_every_other_number_is_plural() {
        let files = |n: u64| counted(n, "file", "files").to_string();
        assert_eq!([0, 1, 2, 11, 101].map(files), ["0 files", "1 file", "2 files", "11 files", "101 files"]);
        assert_eq!([0_usize, 1, 2].map(|n| plural(n, "is", "are")), ["are", "is", "are"]);
        assert_eq!(counted(1_u8, "vertex", "vertices").to_string(), "1 vertex");
    }
}
