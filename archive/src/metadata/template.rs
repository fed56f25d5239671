//! The commented file that `kilwa metadata init` writes.

use kilwa_pack::plural::counted;
use kilwa_pack::visible::visible;
use std::fmt::Write as _;

/// The values known before anybody writes: from a pack, or from answers.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Known {
    /// Title.
    pub title: Option<String>,
    /// Address or short name of a statement of rights.
    pub rights: Option<String>,
    /// Who holds the rights.
    pub holder: Option<String>,
    /// Who made it; `true` for an organisation.
    pub creators: Vec<(String, bool)>,
    /// What it shows.
    pub description: Option<String>,
    /// Who publishes it.
    pub publisher: Option<String>,
    /// Name of the place.
    pub place: Option<String>,
    /// Two letters.
    pub country: Option<String>,
    /// Date or span of the capture.
    pub captured: Option<String>,
    /// Technique.
    pub method: Option<String>,
    /// Units of the mesh.
    pub units: Option<String>,
    /// Reference system.
    pub crs: Option<String>,
    /// Standard uncertainty, metres.
    pub accuracy: Option<f64>,
    /// Triangles and vertices, for a comment.
    pub counts: Option<(u64, u64)>,
    /// How to give credit.
    pub credit: Option<String>,
    /// Address of what the model was made from.
    pub source: Option<String>,
    /// Comments above fields, in order: for example where a value comes from.
    pub remarks: Vec<(Remarked, String)>,
}

/// A field that can have a comment of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Remarked {
    /// The title.
    Title,
    /// The licence.
    Rights,
    /// How to give credit.
    Credit,
    /// Who made it.
    Creators,
    /// What it was made from.
    Source,
}

impl Known {
    /// The comments above a field, each a line.
    fn remarks(&self, field: Remarked) -> String {
        let mut lines = String::new();
        for (_, text) in self.remarks.iter().filter(|(of, _)| *of == field) {
            let _ = writeln!(lines, "# {}", visible(text));
        }
        lines
    }
}

/// The file. Known values are filled in, unknown required ones are empty, and everything else is commented out.
pub fn write(known: &Known) -> String {
    let mut s = String::from(HEAD);
    if let Some((triangles, vertices)) = known.counts {
        let (triangles, vertices) =
            (counted(triangles, "triangle", "triangles"), counted(vertices, "vertex", "vertices"));
        let _ = writeln!(s, "# The pack has {triangles} and {vertices}.");
    }
    let _ = write!(s, "\n{}", known.remarks(Remarked::Title));
    needed(&mut s, "# REQUIRED. The name of the model.", "title", known.title.as_deref());
    optional(
        &mut s,
        "# What it shows, for people who have not seen it. Put three quotation marks before and after a text of several lines.",
        "description",
        known.description.as_deref(),
        "A fort of coral rag on the shore …",
    );
    optional(&mut s, "# Who publishes it.", "publisher", known.publisher.as_deref(), "Museum of …");
    s.push_str(TOP);
    let _ = write!(s, "\n[rights]\n{}", known.remarks(Remarked::Rights));
    needed(
        &mut s,
        "# REQUIRED. A licence or rights statement that machines understand: \"CC BY 4.0\", \"CC0\", \"InC\" (in copyright) …, or its address.\n\
         # All of them: https://creativecommons.org/choose and https://rightsstatements.org/page/1.0/",
        "uri",
        known.rights.as_deref(),
    );
    optional(&mut s, "# Who holds the rights.", "holder", known.holder.as_deref(), "Antiquities Division");
    s.push_str(&known.remarks(Remarked::Credit));
    let example = "Please name the Antiquities Division.";
    optional(&mut s, "# How to give credit.", "statement", known.credit.as_deref(), example);
    s.push_str("\n[model]\n");
    needed(
        &mut s,
        "# REQUIRED. Units of the mesh that was scanned: m, dm, cm, mm, km, ft, us-ft, in.",
        "units",
        known.units.as_deref(),
    );
    optional(
        &mut s,
        "# Reference system of its coordinates; \"local\" if they are not map coordinates.",
        "crs",
        known.crs.as_deref(),
        "EPSG:32737",
    );
    s.push_str(
        "\n# One block [[creators]] for each person or organisation that made the model, the most important first.\n",
    );
    s.push_str(&known.remarks(Remarked::Creators));
    if known.creators.is_empty() {
        s.push_str("# [[creators]]\n# name = \"<Family, Given>\"\n");
    }
    for (name, is_organisation) in &known.creators {
        let _ = writeln!(s, "[[creators]]\nname = {}", quoted(name));
        if *is_organisation {
            s.push_str("kind = \"organisation\"\n");
        }
    }
    s.push_str(PEOPLE);
    place(&mut s, known);
    s.push_str(OBJECT);
    capture(&mut s, known);
    s.push_str(PHOTOGRAPHS);
    s.push_str(ACCESS);
    related(&mut s, known);
    s.push_str(FUNDING);
    s
}

fn related(s: &mut String, known: &Known) {
    s.push_str("\n# What belongs to it elsewhere: IsDescribedBy, IsDerivedFrom, IsPartOf, IsDocumentedBy …\n");
    s.push_str(&known.remarks(Remarked::Source));
    match &known.source {
        Some(source) => drop(writeln!(s, "[[related]]\nrelation = \"IsDerivedFrom\"\nuri = {}", quoted(source))),
        None => s.push_str(RELATED),
    }
}

fn place(s: &mut String, known: &Known) {
    let begun = known.place.is_some() || known.country.is_some();
    s.push_str("\n# Where the site is. Leave out latitude and longitude if the place must not be found.\n");
    s.push_str(if begun { "[place]\n" } else { "# [place]\n" });
    optional(s, "", "name", known.place.as_deref(), "Kilwa Kisiwani");
    optional(s, "# Two letters of ISO 3166.", "country", known.country.as_deref(), "TZ");
    s.push_str("# latitude = \"<-8.9577>\"\n# longitude = \"<39.5228>\"\n# Entry in a gazetteer: GeoNames, Wikidata, Getty TGN.\n# uri = \"<https://www.wikidata.org/wiki/Q…>\"\n");
}

fn capture(s: &mut String, known: &Known) {
    let begun = known.captured.is_some() || known.method.is_some() || known.accuracy.is_some();
    s.push_str("\n# How it was captured.\n");
    s.push_str(if begun { "[capture]\n" } else { "# [capture]\n" });
    optional(s, "# A year, month or day, or a span of two.", "date", known.captured.as_deref(), "2009-07/2009-08");
    optional(s, "", "method", known.method.as_deref(), "Terrestrial laser scanning");
    s.push_str("# instruments = [\"<Leica HDS 3000>\"]\n# software = [\"<MeshLab 2023.12>\"]\n# Standard uncertainty of a point in metres.\n");
    match known.accuracy {
        Some(accuracy) => drop(writeln!(s, "accuracy = {accuracy:?}")),
        None => s.push_str("# accuracy = \"<0.003>\"\n"),
    }
    s.push_str(STEPS);
}

fn needed(s: &mut String, comment: &str, key: &str, value: Option<&str>) {
    let _ = writeln!(s, "{comment}\n{key} = {}", quoted(value.unwrap_or_default()));
}

fn optional(s: &mut String, comment: &str, key: &str, value: Option<&str>, example: &str) {
    if !comment.is_empty() {
        let _ = writeln!(s, "{comment}");
    }
    let _ = match value {
        Some(value) => writeln!(s, "{key} = {}", quoted(value)),
        None => writeln!(s, "# {key} = {}", quoted(&format!("<{example}>"))),
    };
}

/// A text as TOML writes it.
pub(super) fn quoted(text: &str) -> String {
    let mut s = String::from("\"");
    for c in text.chars() {
        match c {
            '"' | '\\' => s.extend(['\\', c]),
            '\n' => s.push_str("\\n"),
            c if kilwa_pack::visible::is_control(c) => drop(write!(s, "\\u{:04X}", c as u32)),
            c => s.push(c),
        }
    }
    s.push('"');
    s
}

const HEAD: &str = "\
# What kilwa publish has to know of a model. Each field is explained in docs/metadata.md.
# A line that begins with # is a comment: take the # away to use the field, and that of the [block] above it. Texts stand in quotation
# marks. What stands in < and > is an example: replace it, < and > too; kilwa publish takes no examples.
";

const TOP: &str = "\
# Day of publication; without it, the day on which kilwa publish runs.
# published = \"<2026-11-21>\"
# Language of these texts.
# language = \"<en>\"
# Other titles, also in other languages.
# alternative_titles = [\"<Ngome ya Kilwa>\"]
# Keywords.
# subjects = [\"<fort>\", \"<Swahili coast>\"]
# Its name in the address; without it, made from the title.
# slug = \"<gereza>\"
# The address where the object will be, for links that have to be complete (oEmbed, IIIF, citation).
# url = \"<https://museum.example/models/gereza/>\"
# An identifier that lasts: DOI, ARK, handle.
# identifier = \"<doi:10.1234/abcd>\"
";

const PEOPLE: &str = "\
# kind = \"<organisation>\"
# orcid = \"<0000-0002-1825-0097>\"
# ror = \"<https://ror.org/03p74gp79>\"
# affiliation = \"<University of Cape Town>\"
# role = \"<scanning>\"

# Who helped, in the same form.
# [[contributors]]
# name = \"<Family, Given>\"
# role = \"<conservation>\"
";

const OBJECT: &str = "
# The site or thing itself.
# [object]
# kind = \"<Fort>\"
# date = \"<1505, rebuilt about 1800>\"
# period = \"<Portuguese, Omani>\"
# materials = [\"<coral rag>\", \"<lime>\"]
# identifiers = [\"<UNESCO WHL 144>\"]
# uri = \"<https://www.wikidata.org/wiki/Q…>\"
";

const STEPS: &str = "\
# description = \"<What was captured and what was not, and what was filled in by hand.>\"
# Each step from the scan to the mesh, in order.
# [[capture.steps]]
# what = \"<Registration of 42 scans>\"
# tool = \"<Cyclone 6.0>\"
# by = \"<Family, Given>\"
# date = \"<2009-09>\"
";

const PHOTOGRAPHS: &str = "
# Rights in the photographs that the model was coloured from; needed to publish them with it (kilwa publish --photos).
# [photographs]
# A licence or rights statement, as above.
# rights = \"<CC BY 4.0>\"
# creators = [\"<Family, Given>\"]
# holder = \"<Antiquities Division>\"
# credit = \"<Photographs: Antiquities Division.>\"
";

const ACCESS: &str = "
# Who may see it: public, embargo (until a day) or restricted. Without this block, public.
# [access]
# state = \"<embargo>\"
# until = \"<2027-06-01>\"
# reason = \"<The excavation is not published yet.>\"
# contact = \"<archive@museum.example>\"
";

const RELATED: &str = "\
# [[related]]
# relation = \"<IsDescribedBy>\"
# uri = \"<doi:10.1234/article>\"
# title = \"<The survey of 2009>\"
";

const FUNDING: &str = "
# Who paid.
# [[funding]]
# funder = \"<World Monuments Fund>\"
# award = \"<12-345>\"
";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Metadata;

    #[test]
    fn the_template_asks_only_for_required_fields() {
        let problems = Metadata::parse(&write(&Known::default())).unwrap_err().0;
        let fields: Vec<&str> = problems.iter().map(|p| p.field.as_str()).collect();
        assert_eq!(fields, ["title", "rights.uri", "model.units"]);
    }

    fn known() -> Known {
        let text = |t: &str| Some(t.to_owned());
        Known {
            title: text("A \"fort\" \\ of\ttabs"),
            rights: text("CC0"),
            holder: text("h"),
            creators: vec![("Ø, Å".to_owned(), false), ("Museum".to_owned(), true)],
            description: text("two\nlines"),
            publisher: text("p"),
            place: text("Kilwa"),
            country: text("TZ"),
            captured: text("2009"),
            method: text("m"),
            units: text("mm"),
            crs: text("EPSG:32737"),
            accuracy: Some(0.003),
            counts: Some((1, 2)),
            credit: text("By \"h\",\nwith thanks"),
            source: text("https://sketchfab.com/3d-models/fort"),
            remarks: vec![
                (Remarked::Title, "from license.txt\n[rights]\u{1b}".to_owned()),
                (Remarked::Rights, "also from it".to_owned()),
                (Remarked::Creators, "and again".to_owned()),
            ],
        }
    }

    #[test]
    fn known_values_are_filled_into_the_template_and_round_trip() {
        let mut known = known();
        known.title = Some("A \"fort\" \\".to_owned());
        let m = Metadata::parse(&write(&known)).unwrap();
        assert_eq!((m.title.as_str(), m.description.as_deref()), ("A \"fort\" \\", Some("two\nlines")));
        assert_eq!((m.creators.len(), m.creators[1].kind), (2, crate::metadata::AgentKind::Organisation));
        assert_eq!(m.capture.and_then(|c| c.accuracy), Some(0.003));
        assert_eq!(m.rights.statement.as_deref(), Some("By \"h\",\nwith thanks"));
        assert_eq!(m.related[0].uri, "https://sketchfab.com/3d-models/fort");
        assert_eq!((m.related.len(), m.related[0].relation.as_str()), (1, "IsDerivedFrom"));
        let text = write(&known);
        assert!(text.contains("\n# from license.txt\\n[rights]\\u{1b}\n# REQUIRED. The name"), "{text}");
        assert!(text.contains("[rights]\n# also from it\n") && text.contains("\n# and again\n[[creators]]"), "{text}");
        assert_eq!(
            (m.place.and_then(|p| p.country), m.model.crs),
            (Some("TZ".to_owned()), Some("EPSG:32737".to_owned()))
        );
    }

    /// Without their `#` the examples are refused, each with its line; without `<` and `>` they are right.
    #[test]
    fn every_example_in_the_template_is_valid_and_none_is_taken_as_a_value() {
        let known =
            Known { title: Some("t".into()), rights: Some("CC0".into()), units: Some("m".into()), ..Known::default() };
        let is_example = |l: &str| {
            l.strip_prefix("# ")
                .is_some_and(|l| l.starts_with('[') || l.split_once(" = ").is_some_and(|(k, _)| !k.contains(' ')))
        };
        let text: String =
            write(&known).lines().map(|l| if is_example(l) { &l[2..] } else { l }).collect::<Vec<_>>().join("\n");
        let examples = text.lines().filter(|l| l.contains("= \"<") || l.contains("= [\"<")).count();
        let problems = Metadata::parse(&text).unwrap_err().0;
        let lines = problems.iter().filter(|p| p.is_example).map(|p| p.line);
        assert_eq!(lines.collect::<std::collections::BTreeSet<_>>().len(), examples, "{problems:?}");
        let is_number = |l: &str| ["latitude", "longitude", "accuracy"].iter().any(|k| l.starts_with(k));
        let filled = |l: &str| if is_number(l) { l.replace(['<', '>', '"'], "") } else { l.replace(['<', '>'], "") };
        let text = text.lines().map(filled).collect::<Vec<_>>().join("\n");
        // Nobody can mean these, whether or not they are marked.
        let text =
            text.replace("Family, Given", "Juma, Amina").replace("Q…", "Q1").replace("abcd", "1").replace(" …\"", "\"");
        let m = Metadata::parse(&text).unwrap_or_else(|e| panic!("{e}\n{text}"));
        assert!(m.access.is_some() && m.funding.len() == 1 && m.related.len() == 1 && m.contributors.len() == 1);
        assert_eq!(m.capture.unwrap().steps.len(), 1);
    }
}
