//! A metadata file as lines, for mistakes that a TOML parser cannot name: a field below a commented-out block, quotation marks of
//! word processors, dates without quotation marks.

use crate::date::iso;
use kilwa_toml::Problem;

/// The blocks of the template, with their fields.
const BLOCKS: [(&str, &[&str]); 11] = [
    ("rights", &["uri", "holder", "statement"]),
    ("photographs", &["rights", "creators", "holder", "credit"]),
    ("model", &["units", "crs"]),
    ("creators", &["name", "kind", "orcid", "ror", "affiliation", "role"]),
    ("contributors", &["name", "kind", "orcid", "ror", "affiliation", "role"]),
    ("place", &["name", "country", "latitude", "longitude", "uri"]),
    ("object", &["kind", "date", "period", "materials", "identifiers", "uri"]),
    ("capture", &["date", "method", "instruments", "software", "accuracy", "description"]),
    ("capture.steps", &["what", "tool", "by", "date"]),
    ("access", &["state", "until", "reason", "contact"]),
    ("related", &["relation", "uri", "title"]),
];
const FUNDING: (&str, &[&str]) = ("funding", &["funder", "award", "uri"]);

/// Fields whose block is still a comment above them, so that they belong to the block before it.
pub(super) fn strays(text: &str) -> Vec<Problem> {
    let (mut all, mut block, mut comment, mut in_text) = (Vec::new(), String::from("the top of the file"), None, false);
    for (line, written) in (1..).zip(text.lines()) {
        let was_in_text = in_text;
        in_text ^= (written.matches("\"\"\"").count() + written.matches("'''").count()) % 2 == 1;
        let written = written.trim();
        if was_in_text || written.is_empty() {
            continue;
        }
        if let Some(rest) = written.strip_prefix('#') {
            if let Some(name) = header(rest.trim()).filter(|name| fields(name).is_some()) {
                comment = Some((line, name, rest.trim().to_owned()));
            }
            continue;
        }
        if header(written).is_some() {
            (block, comment) = (written.to_owned(), None);
            continue;
        }
        let key = written.split('=').next().unwrap_or_default().trim();
        if let Some((at, name, shown)) = &comment
            && fields(name).is_some_and(|f| f.contains(&key))
        {
            let message = format!(
                "it is below `# {shown}` (line {at}), which is still a comment, so it would belong to {block}; remove the # at the start of line {at} too"
            );
            all.push(Problem::new(line, format!("{name}.{key}"), message));
        }
    }
    all
}

pub(super) fn header(line: &str) -> Option<String> {
    let inner = line.strip_prefix("[[").and_then(|l| l.strip_suffix("]]"));
    let inner = inner.or_else(|| line.strip_prefix('[').and_then(|l| l.strip_suffix(']')))?;
    let is_name = !inner.is_empty() && inner.chars().all(|c| c.is_ascii_alphanumeric() || "._-".contains(c));
    is_name.then(|| inner.to_owned())
}

pub(super) fn fields(block: &str) -> Option<&'static [&'static str]> {
    BLOCKS.iter().chain([&FUNDING]).find(|(name, _)| *name == block).map(|(_, fields)| *fields)
}

/// Messages of the TOML reader, and what is usually wrong.
pub(super) fn syntax(message: &str, text: &str, line: usize) -> String {
    let written = text.lines().nth(line.saturating_sub(1)).unwrap_or_default();
    let value = written.split_once('=').map(|(_, value)| value.trim());
    let hint = match value {
        _ if written.contains(['“', '”', '„', '‟', '«', '»', '‘', '’']) && !written.contains(['"', '\'']) => {
            ". These are typographic quotation marks; write straight ones, \"like these\" (a plain text editor does)"
                .to_owned()
        }
        Some(value) if !value.starts_with(['"', '\'', '[', '{']) => match iso(value) {
            Some(meant) => format!(". Dates are written with the year first: {meant}"),
            None => ". Put texts in quotation marks: name = \"text\"".to_owned(),
        },
        None if written.contains(':') => ". Write a field as name = \"text\", with an equals sign".to_owned(),
        _ => String::new(),
    };
    format!("{}{hint}", message.trim().replace('\n', ", "))
}

#[cfg(test)]
mod tests {
    use crate::Metadata;

    const MINIMAL: &str = "title = \"Fort\"\n[rights]\nuri = \"CC BY 4.0\"\n[model]\nunits = \"m\"\n";

    fn refusal(more: &str) -> String {
        Metadata::parse(&format!("{MINIMAL}{more}")).unwrap_err().to_string()
    }

    #[test]
    fn a_field_under_a_commented_out_table_is_reported_with_both_lines() {
        // Unknown in the block before it, known there, and there for the second time.
        for (more, field) in [
            ("# [place]\nlatitude = -8.9\n", "place.latitude"),
            ("[object]\nkind = \"Fort\"\n# [capture]\ndate = 2009\n", "capture.date"),
            ("[[creators]]\nname = \"A\"\n# [[contributors]]\n# a word\nname = \"B\"\n", "contributors.name"),
        ] {
            let message = refusal(more);
            assert!(
                message.contains(field)
                    && message.contains("which is still a comment")
                    && message.contains("remove the #"),
                "{message}"
            );
            assert_eq!(message.matches("line ").count(), 3, "reported once: {message}");
        }
        let other = "# [place]\n# latitude = 1\n# holder = \"x\"\ncrs = \"EPSG:32737\"\n";
        assert!(Metadata::parse(&format!("{MINIMAL}{other}")).is_ok(), "a field of the block that it stands in");
        let text = "[capture]\ndescription = \"\"\"\n# [place]\nname = x\n\"\"\"\n";
        assert!(Metadata::parse(&format!("{MINIMAL}{text}")).is_ok(), "within a text");
    }

    #[test]
    fn typographic_quotation_marks_and_unquoted_dates_are_reported_by_name() {
        let curly = Metadata::parse("title = “Fort”\n").unwrap_err().to_string();
        assert!(curly.contains("line 1") && curly.contains("typographic quotation marks"), "{curly}");
        for (text, meant) in [("21.11.2026", "2026-11-21"), ("21/11/2026", "2026-11-21")] {
            let bare = refusal(&format!("[capture]\ndate = {text}\n"));
            assert!(bare.contains("line 7") && bare.contains(meant), "{bare}");
            let quoted = refusal(&format!("[capture]\ndate = \"{text}\"\n"));
            assert!(quoted.contains("line 7: capture.date") && quoted.contains(meant), "{quoted}");
        }
    }
}
