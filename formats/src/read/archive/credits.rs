//! What a download states about its title, author, licence and source: in `license.txt`, which Sketchfab puts into every download, and in the
//! `asset.extras` of its glTF. Both are taken as they stand; nothing is guessed from other files or names.
//!
//! The form of `license.txt`, with tabs behind the colons:
//!
//! ```text
//! Model Information:
//! * title: NAME
//! * source: https://sketchfab.com/3d-models/…
//! * author: NAME (https://sketchfab.com/…)
//!
//! Model License:
//! * license type: CC-BY-4.0 (http://creativecommons.org/licenses/by/4.0/)
//! * requirements: Author must be credited. Commercial use is allowed.
//!
//! If you use this 3D model in your project be sure to copy paste this credit wherever you share it:
//! This work is based on "NAME" (https://…) by NAME (https://…) licensed under CC-BY-4.0 (http://…)
//! ```
//!
//! `asset.extras` has `title`, `source`, `author` and `license` in the same words.

use super::choose;
use super::directory::{Archive, Entry};
use crate::read::{Bytes, ReadError, ReadOptions, open};
use serde::Deserialize;
use serde::de::{Deserializer, IgnoredAny, MapAccess, SeqAccess, Visitor};
use std::fmt;
use std::path::Path;

/// The file in which Sketchfab states the licence.
const LICENSE: &str = "license.txt";
/// The longest `license.txt`, bytes.
const LICENSE_MAX: u64 = 64 << 10;
/// The most bytes of JSON that are looked through.
const JSON_MAX: u64 = 16 << 20;
/// Bytes of a GLB in front of its JSON.
const GLB_HEAD: usize = 20;
/// The longest text of one field, bytes.
const TEXT_MAX: usize = 4096;

/// What a download states, and where.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Credits {
    /// Each with the place where it is stated, for people.
    pub statements: Vec<(String, Statement)>,
    /// What could not be read of it, in sentences.
    pub notes: Vec<String>,
}

/// What one place states.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Statement {
    /// The title of the model.
    pub title: Option<String>,
    /// The address of the model.
    pub source: Option<String>,
    /// Who made it, with the address of their page.
    pub author: Option<Named>,
    /// The licence, with its address.
    pub license: Option<Named>,
    /// What the licence requires, in words.
    pub requirements: Option<String>,
    /// The sentence that gives credit.
    pub credit: Option<String>,
}

/// A name, and the address that stands in brackets behind it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Named {
    /// The name.
    pub name: String,
    /// The address.
    pub address: Option<String>,
}

impl Named {
    /// From `NAME (https://…)`.
    fn parse(text: &str) -> Self {
        let inside = text.strip_suffix(')').and_then(|text| text.rsplit_once(" ("));
        match inside {
            Some((name, address)) if address.starts_with("https://") || address.starts_with("http://") => {
                Self { name: name.trim().to_owned(), address: Some(address.to_owned()) }
            }
            _ => Self { name: text.to_owned(), address: None },
        }
    }
}

/// What the download at `path` states.
///
/// # Errors
/// [`ReadError`] for an archive that is damaged or refused. Statements that cannot be read are in the notes.
pub fn credits(path: &Path) -> Result<Credits, ReadError> {
    let (mut file, total) = open(path)?;
    credits_from(&mut file, total, path)
}

/// The same from any source of `total` bytes; `path` is its name in messages.
///
/// # Errors
/// As [`credits`].
pub fn credits_from(source: &mut dyn Bytes, total: u64, path: &Path) -> Result<Credits, ReadError> {
    let archive = Archive::open(source, total, path, &ReadOptions::default())?;
    let mut credits = Credits::default();
    credits.add_license(&archive);
    credits.add_mesh(&archive);
    Ok(credits)
}

/// The first statement in the download at `path` and where it is; the mesh is only read if `license.txt` states nothing.
///
/// # Errors
/// As [`credits`].
pub fn first_statement(path: &Path) -> Result<Option<(String, Statement)>, ReadError> {
    let (mut file, total) = open(path)?;
    let archive = Archive::open(&mut file, total, path, &ReadOptions::default())?;
    let mut credits = Credits::default();
    credits.add_license(&archive);
    if credits.statements.is_empty() {
        credits.add_mesh(&archive);
    }
    Ok(credits.statements.into_iter().next())
}

impl Credits {
    /// What `license.txt` states.
    fn add_license(&mut self, archive: &Archive<'_>) {
        let Some(entry) = archive.named_in_any_case(LICENSE) else { return };
        match archive.bytes(entry, LICENSE_MAX) {
            Ok(bytes) => {
                let statement = of_license(&String::from_utf8_lossy(&bytes));
                self.add(&entry.name, statement, "it is not in Sketchfab's format; read it yourself");
            }
            Err(e) => self.notes.push(format!("{} cannot be read: {e}", entry.shown())),
        }
    }

    /// What the extras of the glTF state.
    fn add_mesh(&mut self, archive: &Archive<'_>) {
        // The build says what is wrong if there is no mesh.
        let Ok(number) = choose::mesh(archive) else { return };
        let entry = &archive.files()[number];
        match extras(archive, entry) {
            Ok(Some(statement)) if statement != Statement::default() => {
                self.statements.push((format!("asset.extras of {}", entry.name), statement));
            }
            Ok(_) => {}
            Err(why) => self.notes.push(format!("the asset of {} cannot be read: {why}", entry.shown())),
        }
    }

    fn add(&mut self, place: &str, statement: Statement, otherwise: &str) {
        if statement == Statement::default() {
            self.notes.push(format!("{place}: {otherwise}"));
        } else {
            self.statements.push((place.to_owned(), statement));
        }
    }
}

/// From the text of `license.txt`. The first line of each field counts.
fn of_license(text: &str) -> Statement {
    let mut found = Statement::default();
    let mut is_credit_next = false;
    for line in text.trim_start_matches('\u{feff}').lines().map(str::trim).filter(|line| !line.is_empty()) {
        if is_credit_next {
            found.credit = Some(line.to_owned()).filter(|line| line.len() <= TEXT_MAX);
            break;
        }
        is_credit_next = line.starts_with("If you use this 3D model") && line.ends_with(':');
        let Some((key, value)) = line.strip_prefix('*').and_then(|line| line.split_once(':')) else { continue };
        let value = value.trim();
        if value.is_empty() || value.len() > TEXT_MAX {
            continue;
        }
        match key.trim().to_ascii_lowercase().as_str() {
            "title" => drop(found.title.get_or_insert_with(|| value.to_owned())),
            "source" => drop(found.source.get_or_insert_with(|| value.to_owned())),
            "author" => drop(found.author.get_or_insert_with(|| Named::parse(value))),
            "license type" => drop(found.license.get_or_insert_with(|| Named::parse(value))),
            "requirements" => drop(found.requirements.get_or_insert_with(|| value.to_owned())),
            _ => {}
        }
    }
    found
}

/// From the JSON of a glTF or GLB; `None` if the entry is neither.
fn extras(archive: &Archive<'_>, entry: &Entry) -> Result<Option<Statement>, String> {
    #[derive(Deserialize)]
    struct Head {
        #[serde(default)]
        asset: Asset,
    }
    #[derive(Deserialize, Default)]
    struct Asset {
        #[serde(default)]
        extras: Extras,
    }
    if !["gltf", "glb"].contains(&entry.extension().as_str()) {
        return Ok(None);
    }
    let too_long = || Err(format!("its JSON has more than {} MiB", JSON_MAX >> 20));
    let is_binary = entry.extension() == "glb";
    if !is_binary && entry.bytes > JSON_MAX {
        return too_long();
    }
    // All of it is inflated and compared with its checksum, but only the beginning is kept.
    let mut start = Vec::new();
    let keep = &mut |block: &[u8]| {
        let room = GLB_HEAD + JSON_MAX as usize - start.len();
        start.extend_from_slice(&block[..block.len().min(room)]);
        Ok(())
    };
    archive.inflated(entry, keep).map_err(|fault| archive.refusal(entry, fault).to_string())?;
    let mut json = start.as_slice();
    if is_binary {
        let (head, rest) = start.split_at_checked(GLB_HEAD).ok_or("it is shorter than the head of a GLB")?;
        let length = u64::from(u32::from_le_bytes([head[12], head[13], head[14], head[15]]));
        if length > JSON_MAX {
            return too_long();
        }
        json = &rest[..rest.len().min(length as usize)];
    }
    let mut json = serde_json::Deserializer::from_slice(json);
    let head = Head::deserialize(&mut json).map_err(|e| e.to_string())?;
    let Extras { title, source, author, license } = head.asset.extras;
    let named = |text: Text| text.0.map(|text| Named::parse(&text));
    Ok(Some(Statement {
        title: title.0,
        source: source.0,
        author: named(author),
        license: named(license),
        ..Statement::default()
    }))
}

/// The extras of Sketchfab.
#[derive(Deserialize, Default)]
#[serde(default)]
struct Extras {
    title: Text,
    source: Text,
    author: Text,
    license: Text,
}

/// A text, if it is one that is neither empty nor longer than [`TEXT_MAX`]: extras may have any form.
#[derive(Default)]
struct Text(Option<String>);

impl<'de> Deserialize<'de> for Text {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(TextVisitor)
    }
}

struct TextVisitor;

impl<'de> Visitor<'de> for TextVisitor {
    type Value = Text;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("anything")
    }

    fn visit_str<E>(self, text: &str) -> Result<Text, E> {
        let text = text.trim();
        Ok(Text(Some(text).filter(|text| !text.is_empty() && text.len() <= TEXT_MAX).map(str::to_owned)))
    }

    fn visit_bool<E>(self, _: bool) -> Result<Text, E> {
        Ok(Text(None))
    }

    fn visit_i64<E>(self, _: i64) -> Result<Text, E> {
        Ok(Text(None))
    }

    fn visit_u64<E>(self, _: u64) -> Result<Text, E> {
        Ok(Text(None))
    }

    fn visit_f64<E>(self, _: f64) -> Result<Text, E> {
        Ok(Text(None))
    }

    fn visit_unit<E>(self) -> Result<Text, E> {
        Ok(Text(None))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Text, A::Error> {
        while list.next_element::<IgnoredAny>()?.is_some() {}
        Ok(Text(None))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<Text, A::Error> {
        while map.next_entry::<IgnoredAny, IgnoredAny>()?.is_some() {}
        Ok(Text(None))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const LICENSE_TXT: &str = "Model Information:\n* title:\tA \"fort\": part 1\n* source:\thttps://sketchfab.com/3d-models/a-1\n* author:\tA (B) C (https://sketchfab.com/abc)\n\nModel License:\n* license type:\tCC-BY-4.0 (http://creativecommons.org/licenses/by/4.0/)\n* requirements:\tAuthor must be credited. Commercial use is allowed.\n\nIf you use this 3D model in your project be sure to copy paste this credit wherever you share it:\nThis work is based on \"A\" (https://a) by C (https://c) licensed under CC-BY-4.0 (http://d)\n";

    #[test]
    fn every_line_of_a_license_is_understood_whatever_its_line_ends() {
        for text in [LICENSE_TXT.to_owned(), format!("\u{feff}{}", LICENSE_TXT.replace('\n', "\r\n"))] {
            let found = of_license(&text);
            assert_eq!(found.title.as_deref(), Some("A \"fort\": part 1"));
            assert_eq!(found.source.as_deref(), Some("https://sketchfab.com/3d-models/a-1"));
            let author = found.author.unwrap();
            assert_eq!(
                (author.name.as_str(), author.address.as_deref()),
                ("A (B) C", Some("https://sketchfab.com/abc"))
            );
            assert_eq!(found.license.unwrap().name, "CC-BY-4.0");
            assert!(found.requirements.unwrap().starts_with("Author must be"));
            assert!(found.credit.unwrap().starts_with("This work is based on \"A\""));
        }
    }

    #[test]
    fn other_texts_state_nothing() {
        for text in ["", "MIT License\n\nCopyright (c) A", "* title:\n* author:   \n", "* titel: A\ntitle: A\n"] {
            assert_eq!(of_license(text), Statement::default(), "{text:?}");
        }
        assert_eq!(Named::parse("Editorial"), Named { name: "Editorial".to_owned(), address: None });
        assert_eq!(Named::parse("A (b)"), Named { name: "A (b)".to_owned(), address: None });
    }
}
