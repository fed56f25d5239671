//! The fields of a metadata file as a table, for forms: sections in the order of docs/metadata.md, and what each field holds.
//!
//! What a value may be is decided by [`super::Metadata::parse`] alone. A test compares the names here with those that it knows.

use crate::rights::Rights;
use kilwa_geometry::LengthUnit;

/// What a field holds, and so how it is written in the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A text of one line.
    Line,
    /// A text with line breaks.
    Paragraphs,
    /// A list of texts; in a form, a line for each.
    List,
    /// A number without quotation marks.
    Number,
    /// A text that is one of [`Choices::values`].
    Choice(Choices),
}

/// Where the values of a choice come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Choices {
    /// Licences and rights statements, by their short names.
    Rights,
    /// Units of length.
    Units,
    /// A person or an organisation.
    AgentKind,
    /// Who may see the model.
    Access,
    /// Relations of DataCite.
    Relations,
    /// Codes of ISO 3166-1, whose names a form knows.
    Countries,
}

impl Choices {
    /// The values that are written in the file; none for countries.
    pub fn values(self) -> Vec<String> {
        let own = |values: &[&str]| values.iter().map(|v| (*v).to_owned()).collect();
        match self {
            Self::Rights => Rights::all().into_iter().map(|r| r.short).collect(),
            Self::Units => LengthUnit::symbols().split(", ").map(str::to_owned).collect(),
            Self::AgentKind => own(&["person", "organisation"]),
            Self::Access => own(&["public", "embargo", "restricted"]),
            Self::Relations => own(&super::fields::RELATIONS),
            Self::Countries => Vec::new(),
        }
    }
}

/// A field of a section.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Its name in the file.
    pub key: &'static str,
    /// What it holds.
    pub kind: Kind,
    /// Whether its section requires it.
    pub is_required: bool,
    /// A value that would be right; empty where the choices say enough.
    pub example: &'static str,
}

/// A block of the file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Section {
    /// Its name in the file, for example `capture.steps`; empty for the top of the file.
    pub path: &'static str,
    /// Whether there may be several, `[[creators]]`.
    pub is_repeated: bool,
    /// Its fields.
    pub fields: &'static [Field],
}

impl Section {
    /// The full name of a field: `rights.uri`, or `title` at the top of the file.
    pub fn name_of(&self, key: &str) -> String {
        if self.path.is_empty() { key.to_owned() } else { format!("{}.{key}", self.path) }
    }
}

/// The section of a name.
pub fn section(path: &str) -> Option<&'static Section> {
    SECTIONS.iter().find(|s| s.path == path)
}

const fn line(key: &'static str, example: &'static str) -> Field {
    field(key, Kind::Line, example)
}

const fn needed(key: &'static str, kind: Kind, example: &'static str) -> Field {
    Field { key, kind, is_required: true, example }
}

const fn field(key: &'static str, kind: Kind, example: &'static str) -> Field {
    Field { key, kind, is_required: false, example }
}

const AGENT: [Field; 6] = [
    needed("name", Kind::Line, "Juma, Amina"),
    field("kind", Kind::Choice(Choices::AgentKind), ""),
    line("orcid", "0000-0002-1825-0097"),
    line("ror", "https://ror.org/03p74gp79"),
    line("affiliation", "University of Cape Town"),
    line("role", "Data Collector"),
];

/// All sections.
pub const SECTIONS: [Section; 13] = [
    Section {
        path: "",
        is_repeated: false,
        fields: &[
            needed("title", Kind::Line, "Gereza fort, Kilwa Kisiwani"),
            field("alternative_titles", Kind::List, "Ngome ya Kilwa"),
            field("description", Kind::Paragraphs, "A fort of coral rag on the shore, first built in 1505."),
            line("language", "sw"),
            field("subjects", Kind::List, "fort"),
            line("publisher", "National Museum of Tanzania"),
            line("published", "2026-11-21"),
            line("identifier", "doi:10.1234/abc"),
            line("url", "https://museum.example/models/gereza/"),
            line("slug", "gereza"),
        ],
    },
    Section {
        path: "rights",
        is_repeated: false,
        fields: &[
            needed("uri", Kind::Choice(Choices::Rights), ""),
            line("holder", "Antiquities Division"),
            field("statement", Kind::Paragraphs, "Please name the Antiquities Division."),
        ],
    },
    Section {
        path: "model",
        is_repeated: false,
        fields: &[needed("units", Kind::Choice(Choices::Units), ""), line("crs", "EPSG:32737")],
    },
    Section { path: "creators", is_repeated: true, fields: &AGENT },
    Section { path: "contributors", is_repeated: true, fields: &AGENT },
    Section {
        path: "place",
        is_repeated: false,
        fields: &[
            line("name", "Kilwa Kisiwani"),
            field("country", Kind::Choice(Choices::Countries), ""),
            field("latitude", Kind::Number, "-8.9577"),
            field("longitude", Kind::Number, "39.5228"),
            line("uri", "https://www.wikidata.org/wiki/Q1370225"),
        ],
    },
    Section {
        path: "object",
        is_repeated: false,
        fields: &[
            line("kind", "fort"),
            line("date", "1505, rebuilt about 1800"),
            line("period", "Portuguese, Omani"),
            field("materials", Kind::List, "coral rag"),
            field("identifiers", Kind::List, "UNESCO WHL 144"),
            line("uri", "https://www.wikidata.org/wiki/Q1370225"),
        ],
    },
    Section {
        path: "capture",
        is_repeated: false,
        fields: &[
            line("date", "2009-07/2009-08"),
            line("method", "terrestrial laser scanning"),
            field("instruments", Kind::List, "Leica HDS 3000"),
            field("software", Kind::List, "MeshLab 2023.12"),
            field("accuracy", Kind::Number, "0.003"),
            field("description", Kind::Paragraphs, "The roof was not scanned; holes in it were filled by hand."),
        ],
    },
    Section {
        path: "capture.steps",
        is_repeated: true,
        fields: &[
            needed("what", Kind::Line, "Registration of 42 scans"),
            line("tool", "Cyclone 6.0"),
            line("by", "Juma, Amina"),
            line("date", "2009-09"),
        ],
    },
    Section {
        path: "photographs",
        is_repeated: false,
        fields: &[
            // Not marked as required, so that an emptied block is removed.
            field("rights", Kind::Choice(Choices::Rights), ""),
            field("creators", Kind::List, "Juma, Amina"),
            line("holder", "Antiquities Division"),
            field("credit", Kind::Paragraphs, "Photographs: Antiquities Division."),
        ],
    },
    Section {
        path: "access",
        is_repeated: false,
        fields: &[
            field("state", Kind::Choice(Choices::Access), ""),
            line("until", "2027-06-01"),
            field("reason", Kind::Paragraphs, "The excavation has not been published yet."),
            line("contact", "archive@museum.example"),
        ],
    },
    Section {
        path: "related",
        is_repeated: true,
        fields: &[
            field("relation", Kind::Choice(Choices::Relations), ""),
            needed("uri", Kind::Line, "doi:10.1234/article"),
            line("title", "The survey of 2009"),
        ],
    },
    Section {
        path: "funding",
        is_repeated: true,
        fields: &[
            needed("funder", Kind::Line, "World Monuments Fund"),
            line("award", "12-345"),
            line("uri", "https://funder.example/grants/12-345"),
        ],
    },
];

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Metadata;

    /// A file with every field; unless `is_filled`, also with an unknown field in every section.
    fn every_field(is_filled: bool) -> String {
        let mut lines = Vec::new();
        for section in SECTIONS {
            match (section.path, section.is_repeated) {
                ("", _) => {}
                (path, true) => lines.push(format!("[[{path}]]")),
                (path, false) => lines.push(format!("[{path}]")),
            }
            for field in section.fields {
                let value = match field.kind {
                    Kind::Choice(Choices::Countries) => "TZ".to_owned(),
                    // The second, so that the day of the example fits the state.
                    Kind::Choice(choices) => choices.values()[1].clone(),
                    _ => field.example.to_owned(),
                };
                let quotes = if field.kind == Kind::Number { "" } else { "\"" };
                lines.push(format!("{} = {quotes}{value}{quotes}", field.key));
            }
            if !is_filled {
                lines.push("unheard_of = 1".to_owned());
            }
        }
        lines.join("\n")
    }

    #[test]
    fn every_example_is_accepted_and_every_field_is_known_to_the_check() {
        let m = Metadata::parse(&every_field(true)).unwrap_or_else(|e| panic!("{e}"));
        assert_eq!(m.access.unwrap().until.as_deref(), Some("2027-06-01"));
    }

    #[test]
    fn the_table_has_every_field_that_the_check_knows() {
        // A field of the check that is missing here would be suggested, or unknown, in a file that has it.
        let json = serde_json::to_value(Metadata::parse(&every_field(true)).unwrap()).unwrap();
        let fields: usize = json
            .as_object()
            .unwrap()
            .iter()
            .map(|(key, value)| match value {
                serde_json::Value::Object(table) => table.len(),
                serde_json::Value::Array(list) => list[0].as_object().map_or(1, serde_json::Map::len),
                _ => usize::from(key != "x"),
            })
            .sum();
        // `capture.steps` counts as a field of `capture` there, and its fields are here.
        let here: usize = SECTIONS.iter().map(|s| s.fields.len()).sum();
        assert_eq!(fields, here - section("capture.steps").unwrap().fields.len() + 1);
        let problems = Metadata::parse(&every_field(false)).unwrap_err().0;
        assert_eq!(problems.len(), SECTIONS.len(), "nothing but the one unknown field of each: {problems:?}");
    }
}
