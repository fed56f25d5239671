//! Whether a GLB in a store refers to other files; only its JSON chunk is read (Khronos, "glTF 2.0 Specification", 2021, section 4.4).

use kilwa_store::{Address, Objects};
use serde::Deserialize;
use serde::de::IgnoredAny;

/// Bytes of the file header and the header of the first chunk.
const HEADERS: u64 = 20;
/// Type of the first chunk.
const JSON: u32 = 0x4e4f_534a;
/// Maximum length of the JSON, which may contain buffers and images as text.
const LONGEST: u64 = 1 << 30;

/// The parts that may be in files of their own.
#[derive(Deserialize)]
struct Root {
    #[serde(default)]
    buffers: Vec<Part>,
    #[serde(default)]
    images: Vec<Part>,
}

/// A buffer or image. An image in a buffer view needs no file.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct Part {
    uri: Option<String>,
    buffer_view: Option<IgnoredAny>,
}

/// The first file that a GLB of `bytes` bytes refers to, if any. `None` also for damaged files and other versions, which the reader reports.
pub(super) fn refers_to(
    objects: &Objects,
    address: &Address,
    bytes: u64,
    beginning: &[u8],
) -> anyhow::Result<Option<String>> {
    let Some(length) = length_of_json(beginning).filter(|length| HEADERS + length <= bytes) else { return Ok(None) };
    anyhow::ensure!(length <= LONGEST, "its JSON has {length} bytes; export it again with binary buffers and pictures");
    let have = beginning.get(HEADERS as usize..(HEADERS + length) as usize);
    Ok(match have {
        Some(json) => file_of(json),
        None => file_of(&objects.read_long(&address.path, HEADERS, length)?),
    })
}

/// The length of the JSON of a GLB of version 2 with this beginning.
fn length_of_json(beginning: &[u8]) -> Option<u64> {
    let word = |at: usize| Some(u32::from_le_bytes(beginning.get(at..at + 4)?.try_into().ok()?));
    (word(4)? == 2 && word(16)? == JSON).then(|| word(12).map(u64::from))?
}

/// The first file that the JSON names.
fn file_of(json: &[u8]) -> Option<String> {
    // Some writers pad it with zeros instead of spaces.
    let end = json.iter().rposition(|b| *b != 0).map_or(0, |last| last + 1);
    let json = json.get(..end)?;
    // The mesh reader also accepts a byte order mark.
    let root: Root = serde_json::from_slice(json.strip_prefix(b"\xef\xbb\xbf").unwrap_or(json)).ok()?;
    let parts = root.buffers.into_iter().chain(root.images).filter(|part| part.buffer_view.is_none());
    parts.filter_map(|part| part.uri).find(|uri| !uri.starts_with("data:"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_beside_are_found_and_embedded_ones_are_not() {
        let none = r#"{"asset":{"version":"2.0"},"buffers":[{"byteLength":4}],"images":[{"bufferView":0},{"uri":"data:image/png;base64,AA"}]}"#;
        assert_eq!(file_of(none.as_bytes()), None);
        assert_eq!(file_of(format!("{none}\0\0").as_bytes()), None);
        let image = none.replace("data:image/png;base64,AA", "wall.png");
        assert_eq!(file_of(image.as_bytes()).unwrap(), "wall.png");
        let buffer = none.replace("\"byteLength\":4", "\"uri\":\"wall.bin\"");
        assert_eq!(file_of(format!("{buffer}\0").as_bytes()).unwrap(), "wall.bin");
        assert_eq!(file_of(format!("\u{feff}{image}").as_bytes()).unwrap(), "wall.png");
        let both = image.replace("\"uri\":", "\"bufferView\":1,\"uri\":");
        assert_eq!(file_of(both.as_bytes()), None);
        assert_eq!(file_of(b"{"), None);
    }

    #[test]
    fn only_glbs_of_version_2_have_json_of_a_known_length() {
        let glb = |version: u32, kind: u32| {
            [b"glTF".to_vec(), [version, 999, 77, kind].iter().flat_map(|n| n.to_le_bytes()).collect()].concat()
        };
        assert_eq!(length_of_json(&glb(2, JSON)), Some(77));
        assert_eq!(length_of_json(&glb(1, JSON)), None);
        assert_eq!(length_of_json(&glb(2, 0)), None);
        assert_eq!(length_of_json(&glb(2, JSON)[..19]), None);
    }
}
