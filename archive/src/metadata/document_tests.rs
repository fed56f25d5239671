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

const CREATOR: &str = "title = \"t\"\n\n[[creators]]\nname = \"A\"\n";

fn of_creators(values: &mut Values) -> &mut Vec<Block> {
    values.blocks.get_mut("creators").unwrap()
}

#[test]
fn comments_directly_above_a_header_stay_above_it() {
    let two = format!(
        "{CREATOR}# One.\n# Two.\n[[creators]]\nname = \"B\"\n# The fort\n# on the shore\n[place]\nname = \"K\"\n"
    );
    let swapped = change(&two, |v| of_creators(v).swap(0, 1));
    assert_eq!(
        swapped,
        "title = \"t\"\n\n# One.\n# Two.\n[[creators]]\nname = \"B\"\n[[creators]]\nname = \"A\"\n# The fort\n# on the shore\n[place]\nname = \"K\"\n"
    );
    let above = "# The fort\n# on the shore\n[place]\n";
    for changed in [
        change(&two, |v| drop(of_creators(v).remove(0))),
        change(&two, |v| drop(of_creators(v).remove(1))),
        change(&two, |v| of_creators(v).clear()),
        change(&two, |v| of_creators(v).push(block(&[("name", "C")]))),
    ] {
        assert!(changed.contains(above) && changed.contains("# One.\n# Two.\n"), "{changed}");
    }
    // Also above a header that is a comment itself.
    let template = format!("{CREATOR}# Others.\n# [[contributors]]\n# name = \"<Family, Given>\"\n");
    let added = change(&template, |v| of_creators(v).push(block(&[("name", "B")])));
    assert!(added.contains("# Others.\n# [[contributors]]\n# name"), "{added}");
}

#[test]
fn a_block_with_unknown_tables_below_it_is_not_separated_from_them() {
    let file = format!("{CREATOR}[creators.address]\ncity = \"Kilwa\"\n");
    let document = Document::parse(&file).unwrap();
    let mut values = document.values().clone();
    of_creators(&mut values).push(block(&[("name", "B")]));
    assert_eq!(document.with(&values).unwrap_err(), Unwritable("creators".into()));
}

#[test]
fn values_of_a_wrong_type_are_put_right_when_the_file_is_saved() {
    let file =
        format!("{CREATOR}role = 7\n[capture]\ndate = 2009\nsoftware = [\"MeshLab\", 2023]\naccuracy = \"0.003\"\n");
    assert!(!Document::parse(&file).unwrap().faults().is_empty());
    let changed = change(&file, |_| ());
    for line in ["role = \"7\"\n", "date = \"2009\"\n", "software = [\"MeshLab\", \"2023\"]\n", "accuracy = 0.003\n"] {
        assert!(changed.contains(line), "{line}{changed}");
    }
    let date = format!("{CREATOR}[capture]\ndate = 2009-07-21\n");
    assert_eq!(change(&date, |_| ()), date, "a date of TOML is right");
}

#[test]
fn a_field_below_a_header_that_is_a_comment_is_reported_with_its_line() {
    let file = "title = \"t\"\n[rights]\nuri = \"CC0\"\n[model]\nunits = \"m\"\n# [place]\nlatitude = -8.9\n";
    let faults = Document::parse(file).unwrap().faults();
    assert_eq!(faults.len(), 1, "{faults:?}");
    assert_eq!((faults[0].place.as_str(), faults[0].line, faults[0].is_missing), ("", 7, false));
}

#[test]
fn a_mistake_in_one_of_several_blocks_on_a_line_is_shown_at_that_block() {
    let file = "title = \"t\"\nrights.uri = \"CC0\"\nmodel.units = \"m\"\ncreators = [{ name = \"A\", orcid = \"1\" }, { name = \"B\" }]\n";
    let places: Vec<_> = Document::parse(file).unwrap().faults().into_iter().map(|f| f.place).collect();
    assert_eq!(places, ["creators.0.orcid"]);
    let places = |file: &str| Document::parse(file).unwrap().faults().into_iter().map(|f| f.place).collect::<Vec<_>>();
    assert_eq!(places(&file.replace("orcid = \"1\"", "role = \"\"").replace("\"A\"", "\"\"")), ["creators.0.name"]);
}

#[test]
fn entries_of_a_list_are_added_and_removed_and_comments_stay_beside_the_others() {
    let list = |entries: &str| format!("title = \"t\"\nsubjects = {entries}\n");
    let lines = "[\n  \"fort\",  # first\n  \"coast\",\n  \"sea\"  # last\n]";
    for (before, value, after) in [
        (lines, "fort\nsea", "[\n  \"fort\",  # first\n  \"sea\"  # last\n]"),
        (lines, "fort\ncoast", "[\n  \"fort\",  # first\n  \"coast\",\n  # last\n]"),
        (lines, "coast\nsea", "[\n  # first\n  \"coast\",\n  \"sea\"  # last\n]"),
        (lines, "fort\nnew\ncoast\nsea", "[\n  \"fort\",  # first\n  \"new\",\n  \"coast\",\n  \"sea\"  # last\n]"),
        (
            lines,
            "fort\ncoast\nsea\nx\ny",
            "[\n  \"fort\",  # first\n  \"coast\",\n  \"sea\",  # last\n  \"x\",\n  \"y\"\n]",
        ),
        (lines, "new\nfort\ncoast\nsea", "[\n  \"new\",\n  \"fort\",  # first\n  \"coast\",\n  \"sea\"  # last\n]"),
        ("[\n\t\"a\", # one\n\t\"b\", # two\n]", "a\nb\nc", "[\n\t\"a\", # one\n\t\"b\", # two\n\t\"c\",\n]"),
        ("[\n\t\"a\", # one\n\t\"b\",\n]", "a", "[\n\t\"a\", # one\n]"),
        ("[\"a\", \"b\"]", "a", "[\"a\"]"),
        ("[\"a\", \"b\"]", "b", "[\"b\"]"),
        ("[\"a\", \"b\"]", "c\nd\ne", "[\"c\", \"d\", \"e\"]"),
        ("[\"a\",]", "a\nb", "[\"a\", \"b\",]"),
        ("[\n  \"a\",\n  \"b\"\n]", "a\nb\nc", "[\n  \"a\",\n  \"b\",\n  \"c\"\n]"),
        ("[\n  # about a\n  \"a\",\n]", "a\nb", "[\n  # about a\n  \"a\",\n  \"b\",\n]"),
    ] {
        for end in ["\n", "\r\n"] {
            let [before, after] = [before, after].map(|text| list(text).replace('\n', end));
            assert_eq!(change(&before, |v| put(v, "subjects", value)), after);
        }
    }
}

#[test]
fn a_block_of_which_nothing_is_left_goes_but_not_the_comment_on_its_line() {
    let file = format!("{CREATOR}[place] # see p. 3\nname = \"K\"\n[photographs]\n");
    let changed = change(&file, |v| put(v, "place.name", ""));
    assert_eq!(changed, format!("{CREATOR}# see p. 3\n"));
    let none = change("creators = [{ name = \"A\" }, ]\ntitle = \"t\"\n", |v| of_creators(v).clear());
    assert_eq!(none, "creators = []\ntitle = \"t\"\n");
}
