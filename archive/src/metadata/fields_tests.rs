use super::*;

const MINIMAL: &str = "title = \"Fort\"\n[rights]\nuri = \"CC BY 4.0\"\n[model]\nunits = \"m\"\n";

/// The problems of a file, one per line.
fn refusal(text: &str) -> String {
    Metadata::parse(text).unwrap_err().to_string()
}

#[test]
fn title_rights_and_units_are_enough() {
    let m = Metadata::parse(MINIMAL).unwrap();
    assert_eq!(
        (m.title.as_str(), m.rights.uri.as_str(), m.model.units.as_str()),
        ("Fort", "https://creativecommons.org/licenses/by/4.0/", "m")
    );
    assert_eq!(m.access(), AccessState::Public);
    let json = serde_json::to_string(&m).unwrap();
    assert_eq!(serde_json::from_str::<Metadata>(&json).unwrap(), m);
}

#[test]
fn each_missing_field_is_named_with_what_to_write() {
    let all = refusal("");
    assert!(all.contains("title: every model needs a title"), "{all}");
    assert!(all.contains("rights: add a line [rights]") && all.contains("CC BY 4.0"), "{all}");
    assert!(all.contains("model: add a line [model]") && all.contains("mm"), "{all}");
    let unseen = refusal("title = \"\\u202E\"\n[rights]\nuri = \"CC0\"\n[model]\nunits = \"m\"\n");
    assert!(unseen.contains("every model needs a title"), "{unseen}");
    let empty = refusal("title = \"\"\n\n[rights]\nuri = \" \"\n[model]\n");
    assert!(
        empty.contains("line 1: title")
            && empty.contains("line 4: rights.uri")
            && empty.contains("line 5: model.units"),
        "{empty}"
    );
}

#[test]
fn every_mistake_is_reported_in_order_with_line_and_field() {
    let text = format!(
        "{MINIMAL}crs = \"EPSG:4326\"\nunitz = 1\n[[creators]]\nnmae = \"x\"\norcid = \"0000-0002-1825-0098\"\n[place]\nlatitude = 91\nlongitude = \"39\"\n\
         country = \"Tanzania\"\n[capture]\ndate = 2009-02-30\naccuracy = 0\n"
    );
    let problems = match Metadata::parse(&text.replace("2009-02-30", "\"2009-02-30\"")) {
        Err(p) => p.0,
        Ok(_) => panic!(),
    };
    let fields: Vec<(usize, &str)> = problems.iter().map(|p| (p.line, p.field.as_str())).collect();
    let wanted = [
        (6, "model.crs"),
        (7, "model.unitz"),
        (8, "creators.name"),
        (9, "creators.nmae"),
        (10, "creators.orcid"),
        (12, "place.latitude"),
        (13, "place.longitude"),
        (14, "place.country"),
        (16, "capture.date"),
        (17, "capture.accuracy"),
    ];
    for one in wanted {
        assert!(fields.contains(&one), "{one:?} in {problems:#?}");
    }
    assert!(fields.is_sorted_by_key(|(line, _)| *line));
    let all = Problems(problems).to_string();
    assert!(all.contains("did you mean \"units\"") && all.contains("did you mean \"name\""), "{all}");
}

#[test]
fn invalid_toml_is_reported_with_its_line_and_the_correct_form() {
    assert!(refusal("title = Fort\n").starts_with("line 1: ") && refusal("title = Fort\n").contains("quotation marks"));
    assert!(
        refusal("\ntitle: \"Fort\"\n").starts_with("line 2: ") && refusal("\ntitle: \"Fort\"").contains("equals sign")
    );
    assert!(refusal("title = \"a\"\ntitle = \"b\"").contains("line 2"));
}

#[test]
fn dates_identifiers_and_people_are_checked_and_normalised() {
    let m = Metadata::parse(&format!(
        "identifier = \"doi:10.5281/zenodo.123\"\npublished = 2026-11-21\nurl = \"https://a.org/fort\"\n{MINIMAL}\
         [[creators]]\nname = \"Rüther, Heinz\"\norcid = \"0000-0002-1825-0097\"\n[[creators]]\nname = \"Zamani\"\nkind = \"organisation\"\n\
         [access]\nstate = \"embargo\"\nuntil = 2027-01-01\n[[related]]\nrelation = \"isdescribedby\"\nuri = \"10.1145/1015706.1015802\"\n"
    ))
    .unwrap();
    assert_eq!(m.identifier.as_deref(), Some("https://doi.org/10.5281/zenodo.123"));
    assert_eq!(m.published.as_deref(), Some("2026-11-21"));
    assert_eq!(m.url.as_deref(), Some("https://a.org/fort/"));
    assert_eq!(m.creators[0].orcid.as_deref(), Some("https://orcid.org/0000-0002-1825-0097"));
    assert_eq!(m.creators[1].kind, AgentKind::Organisation);
    assert_eq!(
        (m.related[0].relation.as_str(), m.related[0].uri.as_str()),
        ("IsDescribedBy", "https://doi.org/10.1145/1015706.1015802")
    );
    for (bad, field) in [
        ("published = \"2026-11\"", "published"),
        ("url = \"fort\"", "url"),
        ("identifier = \"x y\"", "identifier"),
        ("slug = \"A b\"", "slug"),
        ("language = \"english!\"", "language"),
        ("title2 = \"x\"", "title2"),
        ("subjects = [1]", "subjects"),
        ("description = 4", "description"),
    ] {
        assert!(refusal(&format!("{bad}\n{MINIMAL}")).starts_with(&format!("line 1: {field}: ")), "{bad}");
    }
    for (bad, what) in [
        ("state = \"embargo\"", "until"),
        ("state = \"withdrawn\"", "--withdraw"),
        ("state = \"secret\"", "none of"),
        ("state = \"public\"\nuntil = 2027-01-01", "only an embargo"),
    ] {
        assert!(refusal(&format!("{MINIMAL}[access]\n{bad}\n")).contains(what), "{bad}");
    }
}

#[test]
fn fields_that_reveal_the_location_can_be_removed() {
    let text = format!(
        "{MINIMAL}crs = \"EPSG:32737\"\n[place]\nname = \"A cave\"\nlatitude = -8.95\nlongitude = 39.5\nuri = \"https://www.wikidata.org/wiki/Q1\"\n"
    );
    let m = Metadata::parse(&text).unwrap().without_location();
    let json = serde_json::to_string(&m).unwrap();
    assert!(json.contains("A cave"));
    for word in ["8.95", "39.5", "Q1", "32737"] {
        assert!(!json.contains(word), "{word}");
    }
}
