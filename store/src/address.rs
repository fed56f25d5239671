//! Addresses: `s3://bucket/folder/name`.

use object_store::path::Path;
use std::fmt;

/// A bucket, and a key or a key prefix in it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Address {
    /// Name of the bucket.
    pub bucket: String,
    /// The key, empty for the bucket itself.
    pub path: Path,
}

/// Whether a text looks like the address of an object.
pub fn is_address(text: &str) -> bool {
    text.starts_with("s3://")
}

impl Address {
    /// Parse an address; `None` if it is not valid.
    pub fn parse(url: &str) -> Option<Self> {
        let (bucket, key) = parts(url)?;
        Some(Self { bucket: bucket.to_owned(), path: Path::parse(key).ok()? })
    }

    /// The address of `name`, which may have slashes, below this one.
    #[must_use]
    pub fn join(&self, name: &str) -> Self {
        let path = self.path.parts().chain(Path::from(name).parts()).collect();
        Self { bucket: self.bucket.clone(), path }
    }

    /// Whether `other` is this address or one below it.
    pub fn contains(&self, other: &Self) -> bool {
        self.bucket == other.bucket && other.path.prefix_matches(&self.path)
    }
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let slash = if self.path.as_ref().is_empty() { "" } else { "/" };
        write!(f, "s3://{}{slash}{}", self.bucket, self.path)
    }
}

/// Bucket and key.
fn parts(url: &str) -> Option<(&str, &str)> {
    let rest = url.strip_prefix("s3://")?;
    let (bucket, key) = rest.split_once('/').unwrap_or((rest, ""));
    let is_plain =
        (3..=63).contains(&bucket.len()) && bucket.bytes().all(|b| b.is_ascii_alphanumeric() || b"-._".contains(&b));
    is_plain.then_some((bucket, key.trim_matches('/')))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_have_a_bucket_and_an_optional_prefix() {
        assert_eq!(parts("s3://museum"), Some(("museum", "")));
        assert_eq!(parts("s3://museum/"), Some(("museum", "")));
        assert_eq!(parts("s3://museum.tz/a/b/"), Some(("museum.tz", "a/b")));
        for bad in
            ["s3://", "s3:///a", "s3://a b/c", "s3://ab", "s3:/museum", "https://museum", "s3://key:secret@museum"]
        {
            assert_eq!(parts(bad), None, "{bad}");
        }
        assert_eq!(Address::parse("s3://museum/a//b"), None);
    }

    #[test]
    fn a_joined_address_is_below_its_parent_and_printed_as_it_was_given() {
        let work = Address::parse("s3://museum/work/of forts/").unwrap();
        assert_eq!(work.to_string(), "s3://museum/work/of forts");
        let file = work.join("kilwa-build-1/plan.json");
        assert_eq!(file.to_string(), "s3://museum/work/of forts/kilwa-build-1/plan.json");
        assert_eq!(Address::parse(&file.to_string()), Some(file.clone()));
        assert!(work.contains(&file) && work.contains(&work) && !file.contains(&work));
        assert!(!Address::parse("s3://museum/work/of").unwrap().contains(&file));
        assert!(!Address::parse("s3://another/work").unwrap().contains(&file));
    }
}
