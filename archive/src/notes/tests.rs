use super::*;
use proptest::prelude::*;

const IDENTITY: &str = "9c7c0123456789abcdef0123456789ab";

/// A note as the page writes it.
fn page(items: &Value) -> Vec<u8> {
    json!({ "@context": CONTEXT, "type": "AnnotationPage", "items": items }).to_string().into_bytes()
}

fn note(title: &str, place: [f64; 3]) -> Value {
    let [x, y, z] = place;
    json!({
        "id": format!("urn:uuid:{title}"), "type": "Annotation", "motivation": "describing", "label": title,
        "created": "2026-11-20T10:00:00Z", "creator": { "name": "M. Juma", "homepage": "https://example.org/juma" },
        "body": [{ "type": "TextualBody", "purpose": "describing", "format": "text/plain", "value": "Coral rag.\n<b>Lime</b>" },
                 { "type": "SpecificResource", "purpose": "linking", "source": "https://example.org/gate" }],
        "target": { "type": "SpecificResource", "source": "https://museum.example/packs/fort.kilwa",
            "selector": { "type": "PointSelector", "x": x, "y": y, "z": z },
            "state": [{ "type": "urn:kilwa:pack", "identity": IDENTITY },
                      { "type": "urn:kilwa:view", "camera": [3.9, 0.5, 82, x, y, z, 0], "display": { "mode": "clay" } }] }
    })
}

fn refused(items: &Value) -> String {
    Notes::parse(&page(items)).unwrap_err().to_string()
}

#[test]
fn notes_saved_by_the_page_are_read_and_written_in_one_form() {
    let notes = Notes::parse(&page(&json!([note("Gate", [1.0, 2.0, 3.0]), note("Well", [4.0, 5.0, 6.5])]))).unwrap();
    assert_eq!((notes.notes.len(), notes.left_out), (2, 0));
    let gate = &notes.notes[0];
    assert_eq!(
        (gate.title("en"), gate.place, gate.made_on.as_deref()),
        ("Gate".to_owned(), DVec3::new(1.0, 2.0, 3.0), Some(IDENTITY))
    );
    assert_eq!(gate.texts("en"), ["Coral rag.\n<b>Lime</b>"]);
    assert_eq!(gate.links().collect::<Vec<_>>(), ["https://example.org/gate"]);
    let bytes = notes.to_bytes("pack.ab.kilwa", "ff").unwrap();
    assert_eq!(Notes::parse(&bytes).unwrap(), notes);
    assert_eq!(Notes::parse(&bytes).unwrap().to_bytes("pack.ab.kilwa", "ff").unwrap(), bytes);
    let value: Value = serde_json::from_slice(&bytes).unwrap();
    let first = &value["items"][0];
    assert_eq!(
        (&first["target"]["source"], &first["target"]["state"][0]["identity"]),
        (&json!("pack.ab.kilwa"), &json!(IDENTITY))
    );
    assert_eq!(first["creator"]["homepage"], "https://example.org/juma", "what else it says is kept");
}

#[test]
fn collections_lists_and_single_annotations_are_read() {
    let one = note("Gate", [1.0, 2.0, 3.0]);
    let forms = [
        json!([one]),
        one.clone(),
        json!({ "type": "AnnotationPage", "items": [one] }),
        json!({ "type": "AnnotationCollection", "first": { "items": [one] } }),
    ];
    for form in forms {
        assert_eq!(Notes::parse(form.to_string().as_bytes()).unwrap().notes.len(), 1, "{form}");
    }
    let named = json!([{ "target": { "selector": [{ "type": "XPathSelector" }, { "type": "PointSelector", "x": 1, "y": 2, "z": 3 }] },
        "label": { "sw": ["Lango"], "en": ["Gate"] }, "bodyValue": "Kept" },
        { "type": "Annotation", "target": "https://example.org/a-page", "bodyValue": "about a page" }]);
    let notes = Notes::parse(&page(&named)).unwrap();
    assert_eq!((notes.notes.len(), notes.left_out), (1, 1));
    let gate = &notes.notes[0];
    assert_eq!((gate.title("sw"), gate.title("fr")), ("Lango".to_owned(), "Gate".to_owned()));
    assert!(gate.id.starts_with("urn:kilwa:note:") && gate.texts("en") == ["Kept"], "{gate:?}");
    assert_eq!(Notes::parse(&page(&named)).unwrap().notes[0].id, gate.id, "the same file, the same names");
}

/// A note with `levels` nested lists beside its text, with these values in the innermost one.
fn nested(levels: usize, values: &str) -> String {
    let target = note("Gate", [1.0, 2.0, 3.0])["target"].take();
    format!(
        "[{{\"label\":\"Gate\",\"target\":{target},\"more\":{}{values}{}}}]",
        "[".repeat(levels),
        "]".repeat(levels)
    )
}

#[test]
fn notes_whose_written_form_would_be_too_large_are_refused_without_allocating_it() {
    // As long as possible, and thirty times as long with each zero on its own line.
    let wide = nested(DEEPEST - 1, &vec!["0"; 7_000_000].join(","));
    assert!(wide.len() as u64 <= NOTES_MAX);
    let notes = Notes::parse(wide.as_bytes()).unwrap();
    // On success only the length is printed, not gigabytes of bytes.
    let message = notes.to_bytes("pack.kilwa", IDENTITY).map(|bytes| bytes.len()).unwrap_err().to_string();
    assert!(message.contains("would be longer than 16000000 bytes") && message.contains("remove some"), "{message}");
    let mut written = write::Bounded::default();
    let page = write::Page { notes: &notes.notes, pack_file: "pack.kilwa", identity: IDENTITY };
    assert!(serde_json::to_writer_pretty(&mut written, &page).is_err());
    assert!(written.0.len() as u64 <= NOTES_MAX && written.0.len() > 15_000_000, "{}", written.0.len());
}

#[test]
fn nesting_too_deep_to_be_read_again_is_refused_with_its_note() {
    let parsed = |levels: usize| Notes::parse(nested(levels, "0").as_bytes());
    for levels in [DEEPEST, 124] {
        let message = parsed(levels).unwrap_err().to_string();
        assert!(message.contains("note 1: it is nested deeper than 32 levels"), "{message}");
    }
    let bytes = parsed(DEEPEST - 1).unwrap().to_bytes("pack.kilwa", IDENTITY).unwrap();
    assert_eq!(Notes::parse(&bytes).unwrap(), parsed(DEEPEST - 1).unwrap(), "what is taken is read again");
    // Also in the parts of its target that are kept.
    let mut deep = note("Gate", [1.0; 3]);
    deep["target"]["state"][1]["display"]["x"] = (0..30).fold(json!(0), |inner, _| json!([inner]));
    assert!(refused(&json!([deep])).contains("nested deeper"));
}

#[test]
fn a_duplicate_key_is_refused() {
    let text = String::from_utf8(page(&json!([note("Gate", [1.0, 2.0, 3.0])]))).unwrap();
    for twice in [
        text.replacen("\"label\":", "\"label\":\"Other\",\"label\":", 1),
        text.replacen("\"x\":", "\"x\":565977,\"x\":", 1),
        text.replacen("\"items\":", "\"items\":[],\"items\":", 1),
    ] {
        assert_ne!(twice, text);
        let message = Notes::parse(twice.as_bytes()).unwrap_err().to_string();
        assert!(message.contains("duplicate key") && message.contains("Save as a file"), "{message}");
    }
}

/// What makes a note wrong.
type Change = fn(&mut Value);

#[test]
fn invalid_notes_are_refused_with_the_note_and_what_to_do() {
    let changed = |change: &dyn Fn(&mut Value)| {
        let mut bad = note("Bad", [1.0, 2.0, 3.0]);
        change(&mut bad);
        refused(&json!([note("Gate", [0.0; 3]), bad]))
    };
    let table: [(Change, &str); 14] = [
        (
            |v| v["body"][1]["source"] = "javascript:alert(1)".into(),
            "note 2 (\"Bad\"): its link \"javascript:alert(1)\" is not an http",
        ),
        (|v| v["body"][1]["source"] = "https://a b".into(), "not an http or https address"),
        (|v| v["body"][1]["source"] = "https://".into(), "not an http or https address"),
        (|v| v["body"][0]["format"] = "text/html".into(), "plain text: open the file in the viewer"),
        (|v| v["body"][0]["value"] = "x".repeat(20_001).into(), "it has 20001 characters; at most"),
        (|v| v["label"] = "x".repeat(201).into(), "201 characters"),
        (|v| v["body"][0]["value"] = "a\u{0}b".into(), "control characters"),
        (|v| v["target"]["selector"]["x"] = "1".into(), "no numbers x, y and z"),
        (|v| v["target"] = json!([v["target"], v["target"]]), "two places"),
        (|v| v["target"]["state"][0]["identity"] = "../../x".into(), "identity of its pack"),
        (|v| v["target"]["state"][1]["camera"] = json!([1, 2, 0, 3, 4, 5, 6]), "its camera"),
        (|v| v["target"]["state"][1]["display"] = json!("clay"), "display is not a JSON object"),
        (|v| v["id"] = "urn:uuid:Gate".into(), "notes 1 and 2 have the same id"),
        (|v| v["body"] = json!([{ "type": "Choice", "items": [] }]), "a choice or a composite"),
    ];
    for (change, expected) in table {
        let message = changed(&change);
        assert!(message.contains(expected), "{expected} in {message}");
    }
    let empty = changed(&|v| (v["label"], v["body"]) = (json!(""), json!([])));
    assert!(empty.contains("note 2 is empty") && empty.contains("delete it"), "{empty}");
    let parse = |text: &str| Notes::parse(text.as_bytes()).unwrap_err().to_string();
    assert!(parse("{").contains("not usable JSON") && parse("{").contains("Save as a file"));
    assert!(
        parse("{\"type\":\"Feature\"}").contains("no Web Annotations") && parse("7").contains("no Web Annotations")
    );
    assert!(parse("[]").contains("contains no annotations") && parse("[{}]").contains("none of its annotations"));
    assert!(parse("{\"type\":\"AnnotationCollection\",\"first\":\"https://a/1\"}").contains("other addresses"));
    assert!(parse("{\"items\":[],\"next\":\"https://a/2\"}").contains("other addresses"));
    assert!(parse("[1]").contains("annotation 1 is not a JSON object"));
    assert!(
        refused(&Value::Array(vec![json!({}); MAX_ANNOTATIONS + 1])).contains("the file has 5001 annotations; at most")
    );
    assert!(
        Notes::parse(&vec![b' '; NOTES_MAX as usize + 1]).unwrap_err().to_string().contains("the file of notes has")
    );
    // All problems at once, in no more lines than a person would read.
    let many =
        refused(&Value::Array((0..30).map(|i| json!({ "id": i, "target": note("x", [0.0; 3])["target"] })).collect()));
    assert!(many.lines().count() == 11 && many.contains("and 20 more"), "{many}");
}

#[test]
fn a_position_outside_the_model_is_refused_and_one_on_a_coarse_level_is_accepted() {
    let at = |place: [f64; 3]| {
        let notes = Notes::parse(&page(&json!([note("Gate", [3.0; 3]), note("Well", place)]))).unwrap();
        notes.within(DVec3::ZERO, DVec3::new(10.0, 10.0, 4.0)).map_err(|e| e.to_string())
    };
    assert!(at([10.1, 5.0, 4.1]).is_ok());
    let message = at([5.0, 12.0, 1.0]).unwrap_err();
    assert!(
        message.contains("note 2 (\"Well\"): 5 12 1 is outside of the model") && message.contains("other coordinates"),
        "{message}"
    );
    assert!(at([5.0, 5.0, -9_009_000.0]).is_err());
}

#[test]
fn notes_are_matched_to_the_pack_they_were_made_on() {
    let notes = Notes::parse(&page(&json!([note("Gate", [0.0; 3]), note("Well", [1.0; 3])]))).unwrap();
    assert!(notes.strangers(&[IDENTITY]).is_empty());
    assert!(notes.strangers(&[&IDENTITY[..12]]).is_empty(), "twelve digits are enough");
    assert_eq!(notes.strangers(&["0123456789abcdef0123456789abcdef"]).into_iter().collect::<Vec<_>>(), [(IDENTITY, 2)]);
}

#[test]
fn a_note_without_its_location_keeps_text_and_view_and_nothing_that_reveals_it() {
    let offset = DVec3::new(565_977.25, 9_009_946.5, 31.75);
    let true_place = [565_980.123_456_789, 9_009_950.5, 33.0];
    let mut gate = note("Gate", true_place);
    gate["id"] = "https://museum.example/kilwa-kisiwani/gate".into();
    gate["location"] = json!({ "latitude": -8.9577 });
    gate["target"]["state"].as_array_mut().unwrap().push(json!({ "type": "TimeState", "cached": "https://a/kilwa" }));
    let notes = Notes::parse(&page(&json!([gate]))).unwrap();
    assert!(notes.revealing().unwrap().contains("links of 1 note"), "{:?}", notes.revealing());
    let hidden = notes.clone().without_place(offset, &[]);
    let near = hidden.notes[0].place;
    assert_eq!(near, DVec3::new(2.873_457, 4.0, 1.25), "to a micrometre");
    let bytes = hidden.to_bytes("pack.kilwa", "0123456789abcdef").unwrap();
    let text = String::from_utf8(bytes.clone()).unwrap();
    for secret in ["5659", "90099", "8.9577", "kisiwani", "example.org", "clay", IDENTITY, "homepage", "cached"] {
        assert!(!text.contains(secret), "{secret} in {text}");
    }
    for kept in ["Gate", "Coral rag", "M. Juma", "2026-11-20", "0123456789abcdef"] {
        assert!(text.contains(kept), "{kept} in {text}");
    }
    let camera = hidden.notes[0].view.as_ref().unwrap().camera.as_ref().unwrap();
    assert_eq!(camera[3..6], near.to_array(), "the camera still looks at it");
    // Redacting is idempotent, so a server can check that nothing is left.
    let again = Notes::parse(&bytes).unwrap().without_place(DVec3::ZERO, &[]);
    assert_eq!(again.to_bytes("pack.kilwa", "0123456789abcdef").unwrap(), bytes);
    assert_ne!(
        notes.clone().without_place(DVec3::ZERO, &[]).to_bytes("p", "i").unwrap(),
        notes.to_bytes("p", "i").unwrap()
    );
    // Notes made on a redacted model already have its coordinates.
    let there =
        Notes::parse(&page(&json!([note("Gate", [2.0, 3.0, 4.0])]))).unwrap().without_place(offset, &[IDENTITY]);
    assert_eq!(there.notes[0].place, DVec3::new(2.0, 3.0, 4.0));
}

#[test]
fn a_note_without_its_location_keeps_no_unknown_text_fields() {
    let uuid = "urn:uuid:0B6FF3F0-5c3a-4c1f-9d53-8a5d00c0ffee";
    let with = |change: &dyn Fn(&mut Value)| {
        let mut one = note("Gate", [1.0; 3]);
        change(&mut one);
        let hidden = Notes::parse(&page(&json!([one]))).unwrap().without_place(DVec3::splat(0.5), &[]);
        let bytes = hidden.to_bytes("pack.kilwa", IDENTITY).unwrap();
        let again = Notes::parse(&bytes).unwrap().without_place(DVec3::ZERO, &[]);
        assert_eq!(again.to_bytes("pack.kilwa", IDENTITY).unwrap(), bytes, "twice is once");
        let value: Value = serde_json::from_slice(&bytes).unwrap();
        value["items"][0].clone()
    };
    for revealing in ["565977 9009946", "565977-9009946", "565977", "-8.9577", "2026-11-20T565977", "5659-77-90"] {
        let one = with(&|v| {
            for key in ["created", "modified", "motivation"] {
                v[key] = revealing.into();
            }
            v["body"][0]["purpose"] = revealing.into();
            v["id"] = format!("urn:uuid:{}", revealing.replace(' ', "-")).into();
        });
        assert!(!one.to_string().contains(revealing), "{revealing} in {one}");
        assert_eq!((&one["motivation"], &one["body"][0]["purpose"]), (&json!("describing"), &json!("describing")));
        assert!(one["id"].as_str().unwrap().starts_with("urn:kilwa:note:"), "{one}");
    }
    let list = with(&|v| v["motivation"] = json!(["565977", "tagging"]));
    assert_eq!(list["motivation"], "describing");
    let kept = with(&|v| {
        (v["id"], v["motivation"], v["body"][0]["purpose"]) = (uuid.into(), "questioning".into(), "tagging".into());
    });
    assert_eq!(
        (&kept["id"], &kept["motivation"], &kept["body"][0]["purpose"]),
        (&json!(uuid), &json!("questioning"), &json!("tagging"))
    );
    let created = |text: &str| with(&|v| v["created"] = text.into())["created"] == text;
    for moment in [
        "2026-11-20",
        "2026-11-20T10:00Z",
        "2026-11-20T10:00:00Z",
        "2026-11-20T10:00:00.123Z",
        "2026-11-20T10:00:00+03:00",
        "2026-11-20T10:00:00.5-03:30",
        "2026-11-20T10:00:00",
    ] {
        assert!(created(moment), "{moment}");
    }
    for none in [
        "2026-13-20",
        "2026-11-20T",
        "2026-11-20T10",
        "2026-11-20T10:00:00.565977Z",
        "2026-11-20T10:00.5Z",
        "2026-11-20T10:61Z",
        "2026-11-20T10:00:00Z565977",
        "2026-11-20T10:00:00+565977",
        "2026-11-20T+10:00",
        "2026-11-20 565977",
        "5659-07-07",
        "1899-12-31",
        "2101-01-01T10:00Z",
        "T",
        "",
    ] {
        assert!(!created(none), "{none}");
    }
}

#[test]
fn text_that_reveals_the_location_is_refused_with_its_note() {
    let location =
        Location::of([DVec3::new(565_950.0, 9_009_900.0, 0.0), DVec3::new(566_000.0, 9_009_990.0, 20.0)], None, None);
    let message = Notes::parse(&page(&json!([note("Gate/565977", [0.0; 3])])))
        .unwrap()
        .check_words(&location)
        .unwrap_err()
        .to_string();
    assert!(message.contains("\"565977\" is a map coordinate of the model"), "{message}");
    let tongue = |language: &str| {
        let mut one = note("Gate", [0.0; 3]);
        one["body"][0]["language"] = language.into();
        Notes::parse(&page(&json!([one]))).unwrap().check_words(&location)
    };
    for none in ["x-565977", "x-65977099", "x-895611-3960023", "sw-565977", "en-x-kilwa", "565", "sw-565"] {
        let message = tongue(none).unwrap_err().to_string();
        assert!(message.contains("is not a registered language"), "{none}: {message}");
    }
    for registered in ["en", "sw", "pt-BR", "zh-Hant-TW", "zh-yue", "es-419", "de-CH-1901", "sr-Latn"] {
        assert_eq!(tongue(registered), Ok(()), "{registered}");
    }
    let mut bare = note("", [0.0; 3]);
    bare["body"] = json!(["https://example.org/gate"]);
    let message = Notes::parse(&page(&json!([bare]))).unwrap().check_words(&location).unwrap_err().to_string();
    assert!(message.contains("contains only links"), "{message}");
}

proptest! {
    #[test]
    fn the_same_notes_give_the_same_bytes(
        titles in proptest::collection::vec("[^\\x00-\\x1f\\x7f-\\x9f]{1,20}", 1..5),
        at in proptest::collection::vec(proptest::array::uniform3(-1e7..1e7f64), 5),
        offset in proptest::array::uniform3(-1e7..1e7f64),
    ) {
        let items: Vec<Value> = titles.iter().zip(&at).enumerate().map(|(i, (t, p))| {
            let mut one = note(t, *p);
            one["id"] = format!("urn:uuid:{i}").into();
            one
        }).collect();
        let kept = titles.iter().all(|t| !t.trim().is_empty());
        let notes = Notes::parse(&page(&json!(items))).unwrap();
        let bytes = notes.to_bytes("p.kilwa", IDENTITY).unwrap();
        let again = Notes::parse(&bytes).unwrap();
        prop_assert_eq!(&again.to_bytes("p.kilwa", IDENTITY).unwrap(), &bytes);
        prop_assert!(again == notes && (!kept || notes.notes.iter().zip(&titles).all(|(n, t)| n.title("en") == *t)));
        let moved = notes.clone().without_place(offset.into(), &[]);
        for (a, b) in notes.notes.iter().zip(&moved.notes) {
            prop_assert!((b.place + DVec3::from(offset)).abs_diff_eq(a.place, 1e-6));
        }
        let bytes = moved.to_bytes("p.kilwa", IDENTITY).unwrap();
        prop_assert_eq!(Notes::parse(&bytes).unwrap().without_place(DVec3::ZERO, &[]).to_bytes("p.kilwa", IDENTITY).unwrap(), bytes);
    }

    #[test]
    fn the_iiif_scene_has_y_up(
        a in proptest::array::uniform3(-1e3..1e3f64), b in proptest::array::uniform3(-1e3..1e3f64), origin in proptest::array::uniform3(-1e3..1e3f64),
    ) {
        let [a, b, origin] = [a, b, origin].map(DVec3::from);
        let (p, q) = (scene_point(a, origin), scene_point(b, origin));
        prop_assert!((p.distance(q) - a.distance(b)).abs() < 1e-5);
        prop_assert!((p.y - q.y - (a.z - b.z)).abs() < 1e-5, "height is height");
        prop_assert!((p.x - q.x - (a.x - b.x)).abs() < 1e-5, "east is x");
        prop_assert!((p.z - q.z + (a.y - b.y)).abs() < 1e-5, "north is minus z, so that it stays right-handed");
    }

    #[test]
    fn no_bytes_make_the_reader_panic_or_hang(text in ".{0,300}") {
        let _ = Notes::parse(text.as_bytes());
    }
}
