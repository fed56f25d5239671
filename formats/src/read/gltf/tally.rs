//! How much memory the JSON of a glTF takes, found before it is parsed: a few bytes of text can represent hundreds in
//! memory (`{}` is a whole node), so the length of the file says nothing.
//!
//! One pass over the text counts what is made of it. Prices are on the safe side, with room for lists that grow by
//! doubling; that they cover the types of `schema` is checked where these are.

use super::Context;
use super::json::string_length;
use crate::read::ReadError;
use kilwa_pack::plural::counted;

/// Bytes for an object: an element of a list that doubles, and what is kept of a node beside it.
const OBJECT: u64 = 320;
/// For a list: a small one takes room for four elements.
const LIST: u64 = 192;
/// For a string or the name of a member, beside its bytes.
const STRING: u64 = 64;
/// For a number, `true`, `false` or `null`.
const SCALAR: u64 = 16;

/// The largest element of a list in `schema`.
pub(in crate::read) const LARGEST_ELEMENT: usize = 104;
const _: () = assert!(OBJECT >= 3 * LARGEST_ELEMENT as u64 && LIST + OBJECT >= 4 * LARGEST_ELEMENT as u64);

/// What a text represents.
#[derive(Debug, Default, PartialEq, Eq)]
pub(in crate::read) struct Tally {
    objects: u64,
    lists: u64,
    strings: u64,
    string_bytes: u64,
    scalars: u64,
}

impl Tally {
    /// Of any text; what is no JSON counts as whatever it looks like.
    pub(in crate::read) fn of(json: &[u8]) -> Self {
        let mut tally = Self::default();
        let (mut at, mut in_scalar) = (0, false);
        while let Some(&b) = json.get(at) {
            let was_scalar = std::mem::take(&mut in_scalar);
            at += 1;
            match b {
                b'{' => tally.objects += 1,
                b'[' => tally.lists += 1,
                b'"' => {
                    let length = string_length(&json[at - 1..]);
                    tally.strings += 1;
                    tally.string_bytes += length as u64;
                    at += length - 1;
                }
                b'}' | b']' | b',' | b':' | b' ' | b'\n' | b'\r' | b'\t' => {}
                _ => {
                    tally.scalars += u64::from(!was_scalar);
                    in_scalar = true;
                }
            }
        }
        tally
    }

    /// Bytes that it takes in memory at the most, the text itself not counted.
    pub(in crate::read) fn bytes(&self) -> u64 {
        let Self { objects, lists, strings, string_bytes, scalars } = self;
        objects * OBJECT + lists * LIST + strings * STRING + string_bytes + scalars * SCALAR
    }
}

/// Refuse JSON that would take more than `most` bytes with its text.
///
/// # Errors
/// [`ReadError::TooLarge`] with what there is and what to do.
pub(super) fn check(json: &[u8], max: u64, context: &Context<'_>) -> Result<(), ReadError> {
    let tally = Tally::of(json);
    let needed = json.len() as u64 + tally.bytes();
    if needed <= max {
        return Ok(());
    }
    let Tally { objects, lists, strings, .. } = tally;
    let what = format!(
        "its JSON of {} has {}, {} and {}",
        counted(json.len(), "byte", "bytes"),
        counted(objects, "object", "objects"),
        counted(lists, "list", "lists"),
        counted(strings, "string", "strings")
    );
    Err(too_large(&what, needed, max, context))
}

/// Refuse JSON that is longer than `most` bytes, before it is read.
///
/// # Errors
/// [`ReadError::TooLarge`].
pub(super) fn check_length(length: u64, max: u64, context: &Context<'_>) -> Result<(), ReadError> {
    if length <= max {
        return Ok(());
    }
    Err(too_large(&format!("its JSON has {length} bytes"), length, max, context))
}

fn too_large(what: &str, needed: u64, max: u64, context: &Context<'_>) -> ReadError {
    let mebibytes = |bytes: u64| bytes.div_ceil(1 << 20);
    let what = format!(
        "{what}, which may take {} MiB of memory, and {} MiB are allowed; give a larger --memory, or export it with its \
         data in a binary buffer (GLB) and with fewer nodes",
        mebibytes(needed),
        max >> 20
    );
    ReadError::TooLarge { file: context.path.to_owned(), what }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_of_a_text_is_counted_once() {
        let json = br#"{"a":[1,-2.5e3,true],"b\"{[":"c,d","e":{},"f":[[]], "g" : null }"#;
        let tally = Tally::of(json);
        assert_eq!((tally.objects, tally.lists, tally.strings, tally.scalars), (2, 3, 6, 4));
        assert_eq!(tally.string_bytes, 3 + 7 + 5 + 3 + 3 + 3);
        for cut in 0..json.len() {
            Tally::of(&json[..cut]);
        }
        assert_eq!(Tally::of(b"\"\\"), Tally { strings: 1, string_bytes: 2, ..Tally::default() });
    }
}
