//! JSON in which every object names each key once.
//!
//! If an object has the same key twice, one parser takes the first value and another the last (RFC 8259, section 4, leaves it open). A file that one
//! program has checked could then mean something else to the next. This module refuses such text. It reads manifests, metadata, notes, accounts,
//! uploads, previews, the metadata of packs and saved measurements. Meshes (glTF), cameras and display settings are not read through it, because only
//! one program reads them.

use serde::de::DeserializeOwned;

/// Read a value; an object that has a key twice is refused.
///
/// In the page's programs, whose bytes count before the first picture, a value's own fields are looked at and members that it does not know are not:
/// serde refuses the former, and nothing there depends on the latter.
///
/// # Errors
/// As [`serde_json::from_slice`], and for a duplicate key, with the key, its line and column.
pub fn from_slice<T: DeserializeOwned>(bytes: &[u8]) -> serde_json::Result<T> {
    #[cfg(not(target_arch = "wasm32"))]
    serde_json::from_slice::<unique::UniqueKeys>(bytes)?;
    serde_json::from_slice(bytes)
}

/// As [`from_slice`].
///
/// # Errors
/// As [`from_slice`].
pub fn from_str<T: DeserializeOwned>(text: &str) -> serde_json::Result<T> {
    from_slice(text.as_bytes())
}

#[cfg(not(target_arch = "wasm32"))]
mod unique {
    use serde::de::{Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
    use std::collections::HashSet;
    use std::fmt;

    /// Longest key that an error repeats, in characters.
    const KEY_SHOWN: usize = 60;

    /// Any JSON value without duplicate keys. Nothing of it is kept; depth is bounded by the parser, memory by the keys of one branch.
    pub(super) struct UniqueKeys;

    impl<'de> serde::Deserialize<'de> for UniqueKeys {
        fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
            deserializer.deserialize_any(Self)
        }
    }

    impl<'de> Visitor<'de> for UniqueKeys {
        type Value = Self;

        fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
            f.write_str("JSON")
        }

        fn visit_bool<E>(self, _: bool) -> Result<Self, E> {
            Ok(self)
        }

        fn visit_i64<E>(self, _: i64) -> Result<Self, E> {
            Ok(self)
        }

        fn visit_u64<E>(self, _: u64) -> Result<Self, E> {
            Ok(self)
        }

        fn visit_f64<E>(self, _: f64) -> Result<Self, E> {
            Ok(self)
        }

        fn visit_str<E>(self, _: &str) -> Result<Self, E> {
            Ok(self)
        }

        fn visit_unit<E>(self) -> Result<Self, E> {
            Ok(self)
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Self, A::Error> {
            while list.next_element::<Self>()?.is_some() {}
            Ok(self)
        }

        fn visit_map<A: MapAccess<'de>>(self, mut object: A) -> Result<Self, A::Error> {
            let mut seen = HashSet::new();
            while let Some(key) = object.next_key::<String>()? {
                if seen.contains(&key) {
                    let shown: String = key.chars().take(KEY_SHOWN).collect();
                    return Err(A::Error::custom(format!(
                        "duplicate key {shown:?}: programs would disagree about its value; remove one of the two"
                    )));
                }
                seen.insert(key);
                object.next_value::<Self>()?;
            }
            Ok(self)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::{Value, json};

    #[test]
    fn duplicate_keys_are_refused_at_every_depth_with_their_line() {
        for text in [
            "{\"a\":1,\n\"a\":1}",
            "[0,{\"b\":{\"a\":{},\n\"a\":[]}}]",
            "{\"x\":[[{\"a\":null,\n\"\\u0061\":true}]]}",
            "{\"a\":1,\"b\":2,\n\"a\":3}",
        ] {
            let message = from_str::<Value>(text).unwrap_err().to_string();
            assert!(message.contains("duplicate key \"a\"") && message.contains("line 2"), "{message}");
        }
    }

    #[test]
    fn text_without_duplicate_keys_is_read_as_by_serde_json() {
        for text in
            ["{\"a\":{\"a\":[{\"a\":1},{\"a\":2}]},\"A\":-1.5e3}", "7", "\"x\"", "null", "[]", "18446744073709551615"]
        {
            assert_eq!(from_str::<Value>(text).unwrap(), serde_json::from_str::<Value>(text).unwrap(), "{text}");
        }
        assert_eq!(from_slice::<Value>(b"{}").unwrap(), json!({}));
        for bad in ["{", "{\"a\":}", "[1,]", "nul", "", "{} x"] {
            assert!(from_str::<Value>(bad).is_err(), "{bad}");
        }
        // No deeper than the parser goes.
        assert!(from_str::<Value>(&"[".repeat(100_000)).is_err());
    }
}
