//! Lists of checksums as `sha256sum` writes them and `sha256sum -c` checks them: `<64 hexadecimal digits>  <path>`, sorted by path.
//!
//! Read strictly: a line that is not a checksum, a path that leaves the folder and a path listed twice are refused, and the error names the line.

use super::layout::safe;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::io::Read;
use thiserror::Error;

/// SHA-256, lower-case hexadecimal, 64 digits.
pub type Checksum = String;

/// Why a list is refused.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum ChecksumsError {
    /// A line of another form.
    #[error(
        "line {line} is not a checksum: expected 64 hexadecimal digits, two spaces and a path, as sha256sum writes them"
    )]
    Line {
        /// From 1.
        line: usize,
    },
    /// A path that cannot be one of this folder.
    #[error("line {line} names {path:?}, which is not a path inside the folder")]
    Path {
        /// From 1.
        line: usize,
        /// What it says.
        path: String,
    },
    /// A path that is listed twice.
    #[error("line {line} names {path} again")]
    Twice {
        /// From 1.
        line: usize,
        /// What it says.
        path: String,
    },
}

/// Paths relative to the folder of the list, with the SHA-256 of each file.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Checksums {
    files: BTreeMap<String, Checksum>,
}

impl Checksums {
    /// Add a file.
    pub fn add(&mut self, path: impl Into<String>, sha256: Checksum) {
        self.files.insert(path.into(), sha256);
    }

    /// Paths with their checksums, sorted.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &str)> {
        self.files.iter().map(|(path, sum)| (path.as_str(), sum.as_str()))
    }

    /// The checksum of a path.
    pub fn get(&self, path: &str) -> Option<&str> {
        self.files.get(path).map(String::as_str)
    }

    /// How many files there are.
    pub fn len(&self) -> usize {
        self.files.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.files.is_empty()
    }

    /// As `sha256sum` writes it.
    pub fn to_text(&self) -> String {
        self.files.iter().fold(String::new(), |mut text, (path, sum)| {
            let _ = writeln!(text, "{sum}  {path}");
            text
        })
    }

    /// Read a list.
    ///
    /// # Errors
    /// [`ChecksumsError`] with the line.
    pub fn parse(text: &str) -> Result<Self, ChecksumsError> {
        let mut files = BTreeMap::new();
        for (line, entry) in (1..).zip(text.lines()) {
            let (sum, path) = entry.split_once("  ").ok_or(ChecksumsError::Line { line })?;
            if !is_sha256(sum) {
                return Err(ChecksumsError::Line { line });
            }
            if !safe(path) {
                return Err(ChecksumsError::Path { line, path: path.to_owned() });
            }
            if files.insert(path.to_owned(), sum.to_owned()).is_some() {
                return Err(ChecksumsError::Twice { line, path: path.to_owned() });
            }
        }
        Ok(Self { files })
    }
}

/// Whether a text is a SHA-256 as it is written here.
pub fn is_sha256(text: &str) -> bool {
    text.len() == 64 && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'))
}

/// The SHA-256 of some bytes.
pub fn sha256(bytes: &[u8]) -> Checksum {
    hex(&Sha256::digest(bytes))
}

/// Length and SHA-256 of what a reader gives, in constant memory.
///
/// # Errors
/// When it cannot be read.
pub fn sha256_of(mut reader: impl Read) -> std::io::Result<(u64, Checksum)> {
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 18];
    let mut bytes = 0;
    loop {
        match reader.read(&mut buffer) {
            Ok(0) => return Ok((bytes, hex(&hash.finalize()))),
            Ok(n) => {
                hash.update(buffer.get(..n).unwrap_or_default());
                bytes += n as u64;
            }
            Err(e) if e.kind() == std::io::ErrorKind::Interrupted => {}
            Err(e) => return Err(e),
        }
    }
}

/// Bytes in lower-case hexadecimal.
pub fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::new(), |mut text, byte| {
        let _ = write!(text, "{byte:02x}");
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_reads_back_and_is_sorted() {
        let mut list = Checksums::default();
        list.add("b/x", sha256(b"1"));
        list.add("a", sha256(b""));
        let text = list.to_text();
        assert!(text.starts_with("e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855  a\n"));
        assert_eq!(Checksums::parse(&text), Ok(list));
        assert_eq!(sha256_of(&b"1"[..]).unwrap(), (1, sha256(b"1")));
    }

    #[test]
    fn damaged_lists_are_refused_with_the_line() {
        let sum = "a".repeat(64);
        let bad = |text: String| Checksums::parse(&text).unwrap_err().to_string();
        assert!(bad(format!("{sum}  a\nx")).contains("line 2"));
        assert!(bad(format!("{}  a", "A".repeat(64))).contains("line 1 is not a checksum"));
        assert!(bad(format!("{sum}  ../a")).contains("not a path inside"));
        assert!(bad(format!("{sum}  /etc/passwd")).contains("not a path inside"));
        assert!(bad(format!("{sum}  a\n{sum}  a")).contains("again"));
    }
}
