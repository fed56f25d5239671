//! After a build from a download: what it states about its rights, and how to keep that for publication.

use kilwa_formats::read::archive::{self, Statement};
use kilwa_pack::visible::visible;
use std::path::{Path, PathBuf};

/// Say what the downloads among the inputs state. One that states nothing is not mentioned, nor one that cannot be read any more.
pub(super) fn say_what_downloads_state(inputs: &[PathBuf], pack: &Path) {
    for input in inputs.iter().filter(|input| archive::is_archive(input)) {
        let Ok(Some((place, statement))) = archive::first_statement(input) else { continue };
        crate::terminal::say!(
            "kilwa: {} states its rights ({}): {}; keep them for publication with `kilwa metadata init {} --download {0} -o {}`",
            input.display(),
            visible(&place),
            words(&statement),
            pack.display(),
            pack.with_extension("toml").display()
        );
    }
}

/// Title, author and licence in a sentence.
fn words(statement: &Statement) -> String {
    let name = |named: &Option<archive::Named>| named.as_ref().map(|named| named.name.clone());
    let quoted = statement.title.as_ref().map(|title| format!("\"{title}\""));
    let by = name(&statement.author).map(|author| format!("by {author}"));
    let under = name(&statement.license).map(|license| format!("under {license}"));
    let all: Vec<String> = [quoted, by, under].into_iter().flatten().map(|text| short(&text)).collect();
    if all.is_empty() { "read them there".to_owned() } else { all.join(" ") }
}

/// A text in one line of at most 120 characters.
fn short(text: &str) -> String {
    visible(&text.chars().take(120).collect::<String>()).into_owned()
}
