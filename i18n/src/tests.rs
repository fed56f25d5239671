use super::*;
use serde_json::Value as Json;
use std::collections::BTreeSet;

#[test]
fn a_message_has_the_plural_forms_of_its_language() {
    let bytes = |language: usize, n: u64| portal()[language].format("bytes", &[("count", n.into())]).unwrap();
    let some = [0, 1, 2, 1_000];
    assert_eq!(some.map(|n| bytes(0, n)), ["0 bytes", "1 byte", "2 bytes", "1,000 bytes"]);
    assert_eq!(some.map(|n| bytes(1, n)), ["0 octet", "1 octet", "2 octets", "1\u{202f}000 octets"]);
    assert_eq!(some.map(|n| bytes(2, n)), ["0 byte", "1 byte", "2 bytes", "1.000 bytes"]);
    assert_eq!(some.map(|n| bytes(3, n)), ["baiti 0", "baiti 1", "baiti 2", "baiti 1,000"]);
    let arabic = [
        (0, "0 بايت"),
        (1, "بايت واحد"),
        (2, "بايتان"),
        (3, "3 بايتات"),
        (10, "10 بايتات"),
        (11, "11 بايتًا"),
        (99, "99 بايتًا"),
        (100, "100 بايت"),
        (102, "102 بايت"),
        // The rules of the crate intl_pluralrules, which fluent-bundle uses, take these for `other`.
        (103, "103 بايتات"),
        (111, "111 بايتًا"),
    ];
    for (n, text) in arabic {
        assert_eq!(bytes(4, n), text);
    }
}

#[test]
fn every_number_of_a_message_chooses_its_own_form() {
    let wait = |language: usize, count: u64, seconds: u64| {
        portal()[language].format("extractShare", &[("count", count.into()), ("seconds", seconds.into())]).unwrap()
    };
    assert!(wait(0, 1, 2).contains(" 1 file in the queue") && wait(0, 1, 2).ends_with(" in 2 seconds."));
    assert!(wait(0, 3, 1).contains(" 3 files in the queue") && wait(0, 3, 1).ends_with(" in 1 second."));
    assert!(wait(1, 0, 1).contains(" 0 fichier dans") && wait(1, 1, 1).ends_with(" 1 seconde."));
    assert!(wait(4, 2, 11).contains("ملفان") && wait(4, 2, 3).contains("3 ثوانٍ"));
}

#[test]
fn a_message_without_values_is_a_text_and_an_unknown_key_is_nothing() {
    let english = &portal()[0];
    assert_eq!((english.code(), english.text("title"), english.text("bytes")), ("en", Some("Models"), None));
    assert_eq!((english.text("no-such"), english.format("no-such", &[])), (None, None));
    assert_eq!(english.format("signedIn", &[("name", "<Amina>".into())]).unwrap(), "You are signed in as <Amina>.");
    assert_eq!(english.format("signedIn", &[]).unwrap(), "You are signed in as {name}.");
}

/// The names of the values in a message of the page's form.
fn values(message: &Json, found: &mut BTreeSet<String>) {
    match message {
        Json::String(text) => {
            found.extend(text.split('{').skip(1).filter_map(|rest| Some(rest.split_once('}')?.0.to_owned())));
        }
        Json::Array(parts) => parts.iter().for_each(|part| values(part, found)),
        Json::Object(choice) => {
            found.extend(choice["$"].as_str().map(ToOwned::to_owned));
            choice.iter().filter(|(key, _)| *key != "$").for_each(|(_, form)| values(form, found));
        }
        _ => panic!("{message}"),
    }
}

/// The plural forms in a message: their categories, in the order of the alphabet.
fn forms<'m>(message: &'m Json, found: &mut Vec<Vec<&'m str>>) {
    match message {
        Json::Array(parts) => parts.iter().for_each(|part| forms(part, found)),
        Json::Object(choice) => {
            let mut categories: Vec<_> = choice.keys().map(String::as_str).filter(|key| *key != "$").collect();
            categories.sort_unstable();
            found.push(categories);
            choice.values().for_each(|form| forms(form, found));
        }
        _ => {}
    }
}

fn of_page(source: &Source) -> &str {
    source.page
}

fn of_portal(source: &Source) -> &str {
    source.portal
}

fn of_holes(source: &Source) -> &str {
    source.holes
}

fn of_metadata(source: &Source) -> &str {
    source.metadata
}

#[test]
fn every_language_has_the_same_messages_with_the_same_values_and_exactly_its_plural_forms() {
    for (of, fewest) in [(of_page as fn(&Source) -> &str, 100), (of_portal, 100), (of_holes, 10), (of_metadata, 100)] {
        let english = message::parse(of(&SOURCES[0])).unwrap();
        assert!(english.len() > fewest);
        for source in &SOURCES {
            let code = source.code;
            let rules = PluralRules::try_new_cardinal((&source.locale).into()).unwrap();
            let categories: BTreeSet<String> = rules.categories().map(|c| format!("{c:?}").to_lowercase()).collect();
            let own = message::parse(of(source)).unwrap_or_else(|e| panic!("{code}: {e}"));
            let keys = |all: &[(String, Message)]| all.iter().map(|(key, _)| key.clone()).collect::<Vec<_>>();
            assert_eq!(keys(&own), keys(&english), "{code}: the keys and their order are those of English");
            for ((key, message), (_, in_english)) in own.iter().zip(&english) {
                let (json, (mut here, mut there)) = (message.to_json(), (BTreeSet::new(), BTreeSet::new()));
                values(&json, &mut here);
                values(&in_english.to_json(), &mut there);
                assert_eq!(here, there, "{code} {key}: the values are those of English");
                let mut found = Vec::new();
                forms(&json, &mut found);
                for own in found {
                    assert!(
                        own.iter().copied().eq(&categories),
                        "{code} {key}: {own:?}, the language has {categories:?}"
                    );
                }
                assert!(!json.to_string().contains("\"\""), "{code} {key} is empty");
            }
        }
    }
}

#[test]
fn messages_of_the_portal_and_the_form_can_be_put_into_html() {
    for source in &SOURCES {
        let (portal, metadata) = (message::parse(source.portal).unwrap(), message::parse(source.metadata).unwrap());
        for (key, message) in portal.into_iter().chain(metadata) {
            // The quotation marks of JSON itself are not in the message.
            let text = message.to_json().to_string();
            assert!(!text.contains(['<', '&']) && !text.contains("\\\""), "{} {key}", source.code);
        }
    }
}

#[test]
fn the_page_gets_one_object_for_each_language() {
    for code in languages() {
        let page: serde_json::Map<String, Json> = serde_json::from_str(&page_json(code).unwrap()).unwrap();
        assert!(page.len() > 500 && page.values().any(Json::is_array) && page.values().any(Json::is_object), "{code}");
    }
    assert_eq!(page_json("xx").unwrap_err(), "xx is not one of the languages");
}
