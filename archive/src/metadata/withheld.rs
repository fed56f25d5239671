//! Whether metadata give a withheld location away: every text of every field, with its line in the file.

use super::{Metadata, fields};
use crate::location::{Finding, Location, is_name};
use kilwa_toml::{File, Problems};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Fields that [`Metadata::without_location`] leaves out.
const LEFT_OUT: [&str; 5] = ["place.latitude", "place.longitude", "place.uri", "object.uri", "model.crs"];

impl Metadata {
    /// Whether no text of a metadata file that would be published gives `location` away. Comments are not published; neither are the fields that
    /// [`Metadata::without_location`] leaves out. A file that is not TOML has other problems, and none here.
    ///
    /// # Errors
    /// Each text that does, with line, field, what was found and what to do.
    pub fn check_withheld(text: &str, location: &Location) -> Result<(), Problems> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        if text.len() > fields::FILE_MAX {
            return Ok(());
        }
        let Ok(root) = DeTable::parse(text) else { return Ok(()) };
        let file = File::new(text);
        let search = Search { text, file: &file, location };
        search.table("", root.get_ref());
        let problems = file.into_problems();
        if problems.is_empty() { Ok(()) } else { Err(Problems(problems)) }
    }

    /// The first text of the metadata, as they are published, that gives `location` away: its field, and what was found.
    pub fn giving_away(&self, location: &Location) -> Option<(String, Finding)> {
        let value = serde_json::to_value(self).ok()?;
        location.find_in_json(&value, &|at| LEFT_OUT.contains(&at))
    }
}

/// Maximum number of significant digits of an accuracy. With more, it could be a coordinate.
const ACCURACY_DIGITS: usize = 3;

/// Check that an accuracy, in metres, has too few digits to hide a coordinate.
///
/// # Errors
/// The end of a sentence that says why not and what to do.
pub fn plain_accuracy(metres: f64) -> Result<(), String> {
    let written = format!("{:.*e}", ACCURACY_DIGITS - 1, metres);
    if written.parse() == Ok(metres) {
        return Ok(());
    }
    Err(format!(
        "is {metres}, which has more than {ACCURACY_DIGITS} digits, and the location is to be withheld; round it"
    ))
}

/// Applies the same check to the capture accuracy that a pack states, and to its parts.
///
/// # Errors
/// The name of the member, and the end of a sentence as in [`plain_accuracy`].
pub fn plain_capture(pack: &kilwa_pack::Metadata) -> Result<(), (&'static str, String)> {
    let members = [
        ("capture_accuracy", pack.capture_accuracy),
        ("capture_registration", pack.capture_registration),
        ("capture_instrument", pack.capture_instrument),
    ];
    for (name, metres) in members {
        metres.map_or(Ok(()), plain_accuracy).map_err(|what| (name, what))?;
    }
    Ok(())
}

struct Search<'a> {
    text: &'a str,
    file: &'a File<'a>,
    location: &'a Location,
}

impl Search<'_> {
    fn table(&self, name: &str, table: &DeTable<'_>) {
        for (key, value) in table {
            let key = key.get_ref();
            let field = if name.is_empty() { key.to_string() } else { format!("{name}.{key}") };
            if !LEFT_OUT.contains(&field.as_str()) {
                self.value(&field, value);
            }
        }
    }

    fn value(&self, field: &str, value: &Spanned<DeValue<'_>>) {
        match value.get_ref() {
            DeValue::String(text) => {
                let found = if is_name(field) { self.location.find_in_name(text) } else { self.location.find(text) };
                if let Some(finding) = found {
                    self.file.problem(self.start(value), field, finding.to_string());
                }
            }
            DeValue::Array(list) => {
                list.iter().for_each(|v| self.value(field, v));
                self.list(field, value.span().start, list);
            }
            DeValue::Table(table) => self.table(field, table),
            DeValue::Float(number) if field == "capture.accuracy" => {
                let metres = number.as_str().replace('_', "").parse::<f64>();
                if let Some(Err(what)) = metres.ok().map(plain_accuracy) {
                    self.file.problem(value.span().start, field, what);
                }
            }
            _ => {}
        }
    }

    /// Report what the texts of a list give away together, if none of them does alone.
    fn list(&self, field: &str, at: usize, list: &[Spanned<DeValue<'_>>]) {
        let texts = || list.iter().filter_map(|v| v.get_ref().as_str());
        if texts().any(|text| self.location.find(text).is_some()) {
            return;
        }
        if let Some(finding) = self.location.find_in_list(texts()) {
            self.file.problem(at, field, finding.to_string());
        }
    }

    /// Where in the file the finding is: of a text of several lines, the first line that has one by itself.
    fn start(&self, value: &Spanned<DeValue<'_>>) -> usize {
        let span = value.span();
        let mut at = span.start;
        for line in self.text.get(span.clone()).unwrap_or_default().split_inclusive('\n') {
            if self.location.find(line).is_some() {
                return at;
            }
            at += line.len();
        }
        span.start
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "title = \"Fort\"\ndescription = \"\"\"\nFirst.\nAt 565977 east.\n\"\"\"\n# 565977 in a comment\nsubjects = [\"fort\",\n  \"37L EL 65977 09946\"]\n\
        [rights]\nuri = \"CC0\"\nholder = \"Office, 8.9577 S\"\n[model]\nunits = \"m\"\ncrs = \"EPSG:32737\"\n[place]\nname = \"Kilwa\"\n\
        latitude = -8.9577\nlongitude = 39.5228\nuri = \"https://www.geonames.org/157107\"\n[object]\nidentifiers = [\"N 9009946\"]\n\
        [capture]\ndescription = \"EPSG:32737\"\n[[capture.steps]]\nwhat = \"Registered\"\ntool = \"565 977\"\n\
        [[related]]\nrelation = \"IsDescribedBy\"\nuri = \"https://www.openstreetmap.org/?mlat=-8.95\"\n";

    fn location() -> Location {
        let bounds = [[565_950.0, 9_009_900.0, 2.0], [566_000.0, 9_009_990.0, 20.0]].map(glam::DVec3::from);
        let place = Metadata::parse(FILE).unwrap().place;
        Location::of(bounds, Some("EPSG:32737"), place.as_ref())
    }

    #[test]
    fn every_text_is_named_with_its_line_and_field() {
        let problems = Metadata::check_withheld(FILE, &location()).unwrap_err();
        let found: Vec<(usize, &str)> = problems.0.iter().map(|p| (p.line, p.field.as_str())).collect();
        assert_eq!(
            found,
            [
                (4, "description"),
                (8, "subjects"),
                (11, "rights.holder"),
                (21, "object.identifiers"),
                (23, "capture.description"),
                (26, "capture.steps.tool"),
                (29, "related.uri")
            ],
            "{problems}"
        );
        let message = problems.to_string();
        assert!(
            message.contains("line 11: rights.holder: \"8.9577\" is a latitude or longitude of the model"),
            "{message}"
        );
        let metadata = Metadata::parse(FILE).unwrap().without_location();
        assert_eq!(metadata.giving_away(&location()).unwrap().0, "capture.description");
    }

    #[test]
    fn coordinates_in_names_and_lists_are_reported_with_their_line() {
        let file = |more: &str| format!("title = \"Fort\"\n{more}\n[rights]\nuri = \"CC0\"\n[model]\nunits = \"m\"\n");
        for (more, field) in [
            ("slug = \"fort-8-95611-39-60023\"", "slug"),
            ("alternative_titles = [\"Fort 8-95611 39-60023\"]", "alternative_titles"),
            ("subjects = [\"-8.956\", \"39.600\"]", "subjects"),
            ("subjects = [\"fort\", \"65977\", \"09946\"]", "subjects"),
        ] {
            let problems = Metadata::check_withheld(&file(more), &location()).unwrap_err();
            let found: Vec<(usize, &str)> = problems.0.iter().map(|p| (p.line, p.field.as_str())).collect();
            assert_eq!(found, [(2, field)], "{problems}");
        }
        let plain = file("slug = \"fort-1505-1807\"\nsubjects = [\"fort\", \"coral rag\", \"1505\", \"1807\"]");
        assert_eq!(Metadata::check_withheld(&plain, &location()), Ok(()));
    }

    #[test]
    fn an_accuracy_that_could_be_a_coordinate_is_reported_with_its_line() {
        let file = |accuracy: &str| {
            format!(
                "title = \"Fort\"\n[rights]\nuri = \"CC0\"\n[model]\nunits = \"m\"\n[capture]\naccuracy = {accuracy}\n"
            )
        };
        for bad in ["8.95611", "0.039601", "5_659.7"].map(file) {
            let found = Metadata::check_withheld(&bad, &location());
            let line = found.err().map(|p| p.0[0].line);
            assert_eq!(line, Some(7), "{bad}");
        }
        for good in ["0.002", "0.0035", "0.00123", "2", "12.5", "1e-3"].map(file) {
            assert_eq!(Metadata::check_withheld(&good, &location()), Ok(()), "{good}");
        }
    }

    #[test]
    fn the_template_and_omitted_fields_are_accepted() {
        let plain = "title = \"Fort\"\n[rights]\nuri = \"CC0\"\n[model]\nunits = \"m\"\ncrs = \"EPSG:32737\"\n[place]\nlatitude = -8.9577\nlongitude = 39.5228\n";
        assert_eq!(Metadata::check_withheld(plain, &location()), Ok(()));
        let metadata = Metadata::parse(plain).unwrap().without_location();
        assert_eq!(metadata.giving_away(&location()), None);
    }
}
