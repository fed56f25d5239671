use super::*;
use crate::metadata::template::{self, Known};

const FILE: &str = "\
# Ours, since 2009.
title = \"Fort\"  # the working title
unheard_of = 1
subjects = [ \"fort\",  # first
  \"coast\" ]

[rights]
uri = 'CC BY 4.0'

# Heinz scanned.
[[creators]]
name = \"Rüther, Heinz\"

[model] # as scanned
units = \"mm\"

# Amina drew.
[[creators]]
name = \"Juma, Amina\"
orcid = \"0000-0002-1825-0097\"

[place]
latitude = -8.95770
longitude = 39.5 # from GPS
";

fn change(file: &str, edit: impl FnOnce(&mut Values)) -> String {
    let document = Document::parse(file).unwrap();
    let mut values = document.values().clone();
    edit(&mut values);
    document.with(&values).unwrap().text().to_owned()
}

fn put(values: &mut Values, name: &str, value: &str) {
    values.fields.insert(name.to_owned(), value.to_owned());
}

fn block(fields: &[(&str, &str)]) -> Block {
    Block { from: None, fields: fields.iter().map(|(k, v)| ((*k).to_owned(), (*v).to_owned())).collect() }
}

fn full() -> Known {
    Known { title: Some("Fort".into()), rights: Some("CC0".into()), units: Some("m".into()), ..Known::default() }
}

#[test]
fn a_file_whose_values_are_not_changed_has_the_same_bytes() {
    let windows = format!("\u{feff}{}", FILE.replace('\n', "\r\n"));
    let template = template::write(&Known::default());
    for file in [FILE, &windows, FILE.trim_end(), "", "# nothing\n", &template] {
        assert_eq!(change(file, |_| ()), file);
    }
}

#[test]
fn changing_one_field_changes_only_its_line() {
    for (name, value, line, with) in [
        ("title", "A \"new\" fort", "title = \"Fort\"", "title = \"A \\\"new\\\" fort\""),
        ("rights.uri", "CC0", "uri = 'CC BY 4.0'", "uri = \"CC0\""),
        ("place.latitude", "-9", "latitude = -8.95770", "latitude = -9"),
        ("model.units", "m", "units = \"mm\"", "units = \"m\""),
        ("subjects", "fort\nshore", "  \"coast\" ]", "  \"shore\" ]"),
        ("subjects", "castle\ncoast", "[ \"fort\",", "[ \"castle\","),
    ] {
        for end in ["\n", "\r\n"] {
            let file = FILE.replace('\n', end);
            assert_eq!(change(&file, |v| put(v, name, value)), file.replacen(line, with, 1), "{name}");
        }
    }
}

#[test]
fn a_number_that_is_only_written_differently_is_not_written_again() {
    assert_eq!(change(FILE, |v| put(v, "place.latitude", "-8.9577")), FILE);
    let quoted = FILE.replace("-8.95770", "\"-8.9577\"");
    assert!(change(&quoted, |_| ()).contains("latitude = -8.9577\n"), "between quotation marks it is no number");
}

#[test]
fn comments_and_unknown_fields_stay_whatever_is_changed() {
    let changed = change(FILE, |v| {
        put(v, "title", "Gereza");
        put(v, "place.longitude", "");
        put(v, "place.latitude", "");
        put(v, "description", "One.\n\n\"Two\"");
        put(v, "access.state", "restricted");
        v.blocks.get_mut("creators").unwrap().remove(0);
    });
    for kept in [
        "# Ours, since 2009.",
        "# the working title",
        "unheard_of = 1",
        "# first",
        "# Heinz scanned.",
        "[model] # as scanned",
        "# Amina drew.",
        "# from GPS",
    ] {
        assert!(changed.contains(kept), "{kept}: {changed}");
    }
    assert!(!changed.contains("Rüther") && changed.contains("[access]\nstate = \"restricted\"\n"), "{changed}");
    let read = Document::parse(&changed).unwrap();
    assert_eq!(read.value("description"), "One.\n\n\"Two\"");
    assert!(!changed.contains("[place]"), "nothing is left in it: {changed}");
}

#[test]
fn blocks_are_moved_with_their_comments_and_added_and_removed() {
    let swapped = change(FILE, |v| v.blocks.get_mut("creators").unwrap().swap(0, 1));
    let [first, second] =
        ["# Amina drew.\n[[creators]]\nname = \"Juma", "# Heinz scanned.\n[[creators]]\nname = \"Rüther"]
            .map(|block| swapped.find(block).unwrap_or_else(|| panic!("{swapped}")));
    let model = swapped.find("[model]").unwrap();
    assert!(first < model && model < second, "{swapped}");
    let added = change(FILE, |v| {
        v.blocks.get_mut("creators").unwrap().insert(1, block(&[("name", "Museum"), ("kind", "organisation")]));
        v.blocks.get_mut("creators").unwrap().push(block(&[("name", " ")]));
        v.blocks.get_mut("capture.steps").unwrap().push(block(&[("what", "Registered"), ("date", "2009-09")]));
        v.blocks.get_mut("funding").unwrap().push(block(&[("funder", "A fund")]));
    });
    let m = Metadata::parse(&added.replace("unheard_of = 1\n", "")).unwrap_or_else(|e| panic!("{e}\n{added}"));
    let names: Vec<_> = m.creators.iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names, ["Rüther, Heinz", "Museum", "Juma, Amina"]);
    assert_eq!((m.capture.unwrap().steps.len(), m.funding[0].funder.as_str()), (1, "A fund"));
}

#[test]
fn the_template_is_filled_in_where_its_comments_explain() {
    let file = template::write(&full());
    let filled = change(&file, |v| {
        put(v, "publisher", "Museum");
        put(v, "place.latitude", "-8.9");
        put(v, "place.longitude", "39,5");
        put(v, "capture.method", "scan");
        put(v, "subjects", "fort\n\n coast ");
        v.blocks.insert("creators".into(), vec![block(&[("name", "Juma, Amina")]), block(&[("name", "Omar")])]);
        v.blocks.insert("contributors".into(), vec![block(&[("name", "Ali"), ("role", "Editor")])]);
        v.blocks.insert("capture.steps".into(), vec![block(&[("what", "merged")])]);
    });
    for part in [
        "# Who publishes it.\npublisher = \"Museum\"\n",
        "# Keywords.\nsubjects = [\"fort\", \"coast\"]\n",
        "must not be found.\n[place]\n# name = ",
        "\nlatitude = -8.9\nlongitude = \"39,5\"\n# Entry in",
        "\n[[creators]]\nname = \"Juma, Amina\"\n# kind = ",
        "\n[[creators]]\nname = \"Omar\"\n\n# Who helped",
        "# Who helped, in the same form.\n[[contributors]]\nname = \"Ali\"\nrole = \"Editor\"\n",
        "# How it was captured.\n[capture]\n# A year",
        "in order.\n[[capture.steps]]\nwhat = \"merged\"\n",
    ] {
        assert!(filled.contains(part), "{part}\n---\n{filled}");
    }
    let faults = Document::parse(&filled).unwrap().faults();
    let places: Vec<_> = faults.iter().map(|f| f.place.as_str()).collect();
    assert_eq!(places, ["place.longitude"], "a comma is for the check to refuse: {faults:?}");
}

#[test]
fn other_ways_to_write_a_table_are_kept() {
    let file = "title = \"t\"\nrights.uri = \"CC0\"\nmodel = { units = \"m\" }\ncreators = [{ name = \"A\" }, { name = \"B\" }]\n";
    let changed = change(file, |v| {
        put(v, "rights.holder", "h");
        put(v, "model.crs", "local");
        let creators = v.blocks.get_mut("creators").unwrap();
        creators.swap(0, 1);
        creators[0].fields.insert("role".into(), "Editor".into());
        creators.push(block(&[("name", "C")]));
    });
    assert_eq!(
        changed,
        "title = \"t\"\nrights.uri = \"CC0\"\nrights.holder = \"h\"\nmodel = { units = \"m\", crs = \"local\" }\n\
         creators = [{ name = \"B\", role = \"Editor\" }, { name = \"A\" }, { name = \"C\" }]\n"
    );
    let one = "title = \"t\"\n[creators]\nname = \"A\"\n";
    let two = change(one, |v| v.blocks.get_mut("creators").unwrap().push(block(&[("name", "B")])));
    assert_eq!(two, "title = \"t\"\n[[creators]]\nname = \"A\"\n\n[[creators]]\nname = \"B\"\n");
    let unfit = Document::parse("place = \"Kilwa\"\n").unwrap();
    let mut values = unfit.values().clone();
    put(&mut values, "place.name", "Kilwa");
    assert_eq!(unfit.with(&values).unwrap_err(), Unwritable("place.name".into()));
}

#[test]
fn mistakes_are_found_by_the_check_and_shown_at_the_field_of_the_right_block() {
    let file = FILE.replace("0097", "0098").replace("mm", "miles").replace("title = \"Fort\"", "title = \"\"");
    let faults = Document::parse(&file).unwrap().faults();
    let places: Vec<_> = faults.iter().map(|f| (f.place.as_str(), f.field.as_str(), f.is_missing)).collect();
    assert_eq!(
        places,
        [
            ("title", "title", true),
            ("", "unheard_of", false),
            ("model.units", "model.units", false),
            ("creators.1.orcid", "creators.orcid", false)
        ]
    );
    let none = Document::parse("").unwrap().faults();
    assert_eq!(none.iter().map(|f| f.place.as_str()).collect::<Vec<_>>(), ["title", "rights.uri", "model.units"]);
    assert_eq!(Document::parse("a = 1\nb = \n").unwrap_err().line, 2);
}

#[test]
fn texts_of_any_shape_survive() {
    for text in [
        "a\n\"\"\"\nb",
        "ends with \"",
        "one\ntwo\"",
        "a\n\"\"\"",
        "a\nb\\\"",
        "a\n\n\"c",
        "back\\slash\nand \\n",
        "# [place]\nname = x",
        "tab\there\nx",
        "a\n\n\nb",
        "\"\"\"\"\"\"\n\"\"",
    ] {
        let changed = change(&template::write(&full()), |v| put(v, "description", text));
        assert_eq!(Document::parse(&changed).unwrap().value("description"), text, "{changed}");
        assert_eq!(Metadata::parse(&changed).unwrap().description.as_deref(), Some(text), "{changed}");
    }
}
