//! Every message of the engine has a text in every language of the page, with a placeholder for each of its values.

use kilwa_measure::saved::{Document, DocumentError};
use kilwa_measure::sheet::SheetError;
use kilwa_measure::{Failure, Refusal, Remark, Target, ToMessage};
use kilwa_measure_web::question::QuestionError;
use kilwa_pack::PackError;
use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};

fn no_json() -> serde_json::Error {
    serde_json::from_str::<Value>("{").expect_err("cut off")
}

/// One of each. A new variant does not compile here before it is added.
fn refusals() -> Vec<Refusal> {
    let misses = |what| Refusal::Misses { what, hint: "look elsewhere".to_owned() };
    let all = vec![
        Refusal::TooFew { tool: "an area", needed: 3, given: 2 },
        Refusal::Collinear { what: "a plane" },
        Refusal::Coincident { what: "an angle" },
        Refusal::Crossing,
        Refusal::Open { borders: 3 },
        Refusal::Inconsistent,
        misses(Target::Plane),
        misses(Target::Polygon),
        misses(Target::Region),
        misses(Target::Contours),
        Refusal::Gap,
        Refusal::NotFinite,
        Refusal::NoRay,
        Refusal::NoPlane { tool: "a section" },
        Refusal::OfPoints,
        Refusal::Waits,
        Refusal::Reach { metres: -1.0 },
        Refusal::Interval { metres: 0.0, max: 10, low: 1.0, high: 2.0 },
    ];
    for one in &all {
        match one {
            Refusal::TooFew { .. }
            | Refusal::Collinear { .. }
            | Refusal::Coincident { .. }
            | Refusal::Crossing
            | Refusal::Open { .. }
            | Refusal::Inconsistent
            | Refusal::Misses { .. }
            | Refusal::Gap
            | Refusal::NotFinite
            | Refusal::NoRay
            | Refusal::NoPlane { .. }
            | Refusal::OfPoints
            | Refusal::Waits
            | Refusal::Reach { .. }
            | Refusal::Interval { .. } => {}
        }
    }
    all
}

fn remarks() -> Vec<Remark> {
    let all = vec![
        Remark::Reach { reach: 0.25 },
        Remark::Spacing { spacing: 0.005 },
        Remark::Rough { deviation: 0.001, share: 0.04 },
        Remark::InsideOut,
        Remark::Body,
        Remark::Covered { reach: 0.25, covered: 0.5 },
        Remark::Holes,
        Remark::Lines { lines: 2, open: 1, triangles: 7 },
        Remark::Heights { lines: 2, heights: 1 },
    ];
    for one in &all {
        match one {
            Remark::Reach { .. }
            | Remark::Spacing { .. }
            | Remark::Rough { .. }
            | Remark::InsideOut
            | Remark::Body
            | Remark::Covered { .. }
            | Remark::Holes
            | Remark::Lines { .. }
            | Remark::Heights { .. } => {}
        }
    }
    all
}

fn sheets() -> Vec<SheetError> {
    let large = |fits| SheetError::TooLarge { scale: 1.0, width: 10.0, height: 20.0, fits };
    let all = vec![
        large(None),
        large(Some(50.0)),
        SheetError::TooLong,
        SheetError::TooFine { width: 1e9, height: 1e9 },
        SheetError::Scale,
        SheetError::Dots,
        SheetError::Oblique,
        SheetError::NoPaper,
        SheetError::Asked("nothing".to_owned()),
    ];
    for one in &all {
        match one {
            SheetError::TooLarge { .. }
            | SheetError::TooLong
            | SheetError::TooFine { .. }
            | SheetError::Scale
            | SheetError::Dots
            | SheetError::Oblique
            | SheetError::NoPaper
            | SheetError::Asked(_) => {}
        }
    }
    all
}

fn questions() -> Vec<QuestionError> {
    let other = Document::parse(br#"{"kilwa":"views","version":1}"#).expect_err("another kind");
    let newer = Document::parse(br#"{"kilwa":"measurements","version":99}"#).expect_err("from the future");
    let all = vec![
        QuestionError::Document(DocumentError::TooLong { bytes: 1 << 30 }),
        QuestionError::Document(DocumentError::Json(no_json())),
        QuestionError::Document(other),
        QuestionError::Document(newer),
        QuestionError::Asked(no_json()),
        QuestionError::Unit("ell".to_owned()),
        QuestionError::Format("doc".to_owned()),
        QuestionError::Scale,
        QuestionError::Nothing,
        QuestionError::NoLines,
    ];
    for one in &all {
        match one {
            QuestionError::Document(
                DocumentError::TooLong { .. }
                | DocumentError::Json(_)
                | DocumentError::Other(_)
                | DocumentError::Newer(_),
            )
            | QuestionError::Asked(_)
            | QuestionError::Unit(_)
            | QuestionError::Format(_)
            | QuestionError::Scale
            | QuestionError::Nothing
            | QuestionError::NoLines => {}
        }
    }
    all
}

fn all() -> Vec<Box<dyn ToMessage>> {
    let failures = vec![
        Failure::Refused(Refusal::Gap),
        Failure::Pack(PackError::Checksum { what: "chunk 3".to_owned() }),
        Failure::Source("gone".to_owned()),
    ];
    let mut all: Vec<Box<dyn ToMessage>> = Vec::new();
    all.extend(refusals().into_iter().map(|x| Box::new(x) as Box<dyn ToMessage>));
    all.extend(remarks().into_iter().map(|x| Box::new(x) as Box<dyn ToMessage>));
    all.extend(sheets().into_iter().map(|x| Box::new(x) as Box<dyn ToMessage>));
    all.extend(questions().into_iter().map(|x| Box::new(x) as Box<dyn ToMessage>));
    all.extend(failures.into_iter().map(|x| Box::new(x) as Box<dyn ToMessage>));
    all
}

/// `refuse-few` is `refuseFew`.
fn key(code: &str) -> String {
    let mut words = code.split('-');
    let first = words.next().unwrap_or_default().to_owned();
    words.fold(first, |key, word| {
        let (head, tail) = word.split_at(1);
        key + &head.to_uppercase() + tail
    })
}

/// The names of the values in a message, as `www/i18n.js` reads it: a text with names in braces, plural forms of the number that
/// `$` names, or a list of these.
fn places(message: &Value) -> BTreeSet<String> {
    match message {
        Value::String(text) => {
            text.split('{').skip(1).filter_map(|rest| rest.split_once('}')).map(|(name, _)| name.to_owned()).collect()
        }
        Value::Array(parts) => parts.iter().flat_map(places).collect(),
        Value::Object(forms) => {
            let number = forms["$"].as_str().map(ToOwned::to_owned);
            forms.iter().filter(|(key, _)| *key != "$").flat_map(|(_, form)| places(form)).chain(number).collect()
        }
        _ => panic!("{message} is not a message"),
    }
}

fn messages(language: &str) -> BTreeMap<String, Value> {
    let json = kilwa_messages::page_json(language).unwrap_or_else(|e| panic!("{e}"));
    serde_json::from_str(&json).expect("an object")
}

#[test]
fn every_code_has_a_text_in_all_five_languages_with_exactly_its_placeholders() {
    let mut codes = BTreeMap::new();
    for one in all() {
        let text = one.message();
        assert!(!one.to_string().is_empty(), "{} has no English", text.code);
        assert!(
            text.code.split('-').all(|w| !w.is_empty() && w.bytes().all(|b| b.is_ascii_lowercase())),
            "{}",
            text.code
        );
        let names: BTreeSet<String> = text.values.iter().map(|(name, _)| (*name).to_owned()).collect();
        if let Some(before) = codes.insert(text.code, names.clone()) {
            assert_eq!(before, names, "{} has the same values always", text.code);
        }
    }
    assert!(codes.len() > 35, "{}", codes.len());
    let english = messages("en");
    for language in kilwa_messages::languages() {
        let all = messages(language);
        for (code, names) in &codes {
            let message = all.get(&key(code)).unwrap_or_else(|| panic!("{language}: {code} has no text"));
            assert_eq!(&places(message), names, "{language}: {code}");
            assert!(language == "en" || *message != english[&key(code)], "{language}: {code} is English");
        }
    }
}
