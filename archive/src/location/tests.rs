use super::*;
use proptest::prelude::*;
use std::collections::BTreeMap;

/// A fort in UTM 37 S and its metadata.
const BOUNDS: [DVec3; 2] = [DVec3::new(565_950.0, 9_009_900.0, 2.0), DVec3::new(566_000.0, 9_009_990.0, 20.0)];

fn place(latitude: f64, longitude: f64) -> Place {
    Place { latitude: Some(latitude), longitude: Some(longitude), ..Place::default() }
}

fn fort() -> Location {
    Location::of(BOUNDS, Some("EPSG:32737"), Some(&place(-8.9577, 39.5228)))
}

/// The texts of one part of `texts.json`:
///
/// * `found by form` and `found by place`: every form of the fort's place (its middle is 565975 E, 9009945 N; -8.9562, 39.6001 by its
///   system, -8.9577, 39.5228 by its metadata). The former look like coordinates, so they are refused even if the place is unknown;
///   the latter only match the place.
/// * `ordinary`: sentences of catalogues, reports and metadata in which no search may find a location.
fn texts(part: &str) -> Vec<String> {
    let parts: BTreeMap<String, BTreeMap<String, Vec<String>>> =
        serde_json::from_str(include_str!("texts.json")).unwrap();
    parts[part].values().flatten().cloned().collect()
}

#[test]
fn the_location_is_found_in_every_form() {
    let (fort, planted) = (fort(), [texts("found by form"), texts("found by place")].concat());
    let missed: Vec<&String> = planted.iter().filter(|text| fort.find(text).is_none()).collect();
    assert!(missed.is_empty(), "{missed:#?}");
    // Also in the middle of other words.
    for text in &planted {
        let among = format!("The fort was built in 1505 of coral rag; {text} (see p. 12)");
        assert!(fort.find(&among).is_some(), "{among}");
    }
}

/// As grid references are written without their letters: in whatever system the pack has, and outside the zone that the system is meant for.
#[test]
fn the_last_five_digits_of_easting_and_northing_are_found_in_every_system() {
    for (code, east, north) in [
        (27700, 412_345.0, 142_345.0),
        (2154, 652_345.0, 6_862_345.0),
        (28992, 155_123.0, 463_456.0),
        (2193, 1_756_123.0, 5_916_456.0),
        (2056, 2_634_123.0, 1_234_456.0),
        (3857, 4_408_123.0, -1_000_987.0),
        (32737, 565_982.0, 9_009_946.0),
        (32701, 930_123.0, 8_123_456.0),
        (32737, 599_995.0, 9_000_002.0),
    ] {
        let bounds = [DVec3::new(east - 20.0, north - 20.0, 0.0), DVec3::new(east + 20.0, north + 20.0, 9.0)];
        let location = Location::of(bounds, Some(&format!("EPSG:{code}")), None);
        let last = |v: f64| format!("{:05}", (v.abs() as u64) % 100_000);
        for (e, n) in [(east, north), (east + 12.0, north - 15.0)].map(|(e, n)| (last(e), last(n))) {
            for text in [format!("{e} {n}"), format!("{n}/{e}"), format!("Find spot {e}, {n}."), format!("E{e} N{n}")] {
                assert!(location.find(&text).is_some(), "EPSG:{code}: {text}");
            }
        }
        let far = format!("{} {}", last(east + 30_000.0), last(north + 40_000.0));
        assert!(location.find(&far).is_none(), "EPSG:{code}: {far} is elsewhere");
    }
}

/// Short Plus Codes that consist of letters or of digits alone are found too.
#[test]
fn a_short_plus_code_in_letters_or_digits_is_found() {
    let peru = Location::of([DVec3::ZERO, DVec3::ONE], None, Some(&place(-13.1812, -72.5511)));
    let digit = |v: f64| "23456789CFGHJMPQRVWX".chars().nth(v as usize).unwrap();
    for (lat, lon) in
        [(-13.1812, -72.5511), (0.52211, 36.0713), (51.4779, -0.0015), (-17.7134, 179.9993), (78.2232, 15.6267)]
    {
        let location = Location::of([DVec3::ZERO, DVec3::ONE], None, Some(&place(lat, lon)));
        let (mut size, mut rest, mut code) = (20.0, [lat + 90.0, lon + 180.0], String::new());
        for _ in 0..5 {
            for axis in &mut rest {
                code.push(digit((*axis / size).floor()));
                *axis %= size;
            }
            size /= 20.0;
        }
        code.insert(8, '+');
        for text in [&code[..], &code[2..], &code[4..]] {
            for text in [text.to_owned(), text.to_lowercase(), format!("near {text}, Cusco")] {
                assert!(location.find(&text).is_some(), "{text} of {lat} {lon}");
            }
        }
    }
    for anywhere in ["RCMX+HF", "near FVMH+CR, Cusco", "CCRCMX+HF"] {
        assert!(peru.find(anywhere).is_some() && Location::unknown().find(anywhere).is_some(), "{anywhere}");
    }
}

#[test]
fn ordinary_sentences_are_accepted() {
    let ordinary = texts("ordinary");
    assert!(ordinary.len() >= 50);
    let elsewhere = Location::of(
        [DVec3::new(428_000.0, 5_520_000.0, 90.0), DVec3::new(428_050.0, 5_520_040.0, 120.0)],
        Some("EPSG:32632"),
        Some(&place(49.83, 8.0)),
    );
    for location in [fort(), elsewhere, Location::unknown()] {
        let refused: Vec<String> =
            ordinary.iter().filter_map(|text| location.find(text).map(|f| format!("{text}: {f}"))).collect();
        assert!(refused.is_empty(), "{} of {}: {refused:#?}", refused.len(), ordinary.len());
    }
    let local = Location::of([DVec3::ZERO, DVec3::splat(50.0)], None, None);
    assert!(local.find("1505 and 12.5").is_none(), "local coordinates reveal nothing");
}

/// What looks like a date is still found if the place is known.
#[test]
fn an_angle_that_could_be_a_date_is_found_if_it_is_near_the_location() {
    let location = Location::of([DVec3::ZERO, DVec3::ONE], None, Some(&place(-8.156, 39.6)));
    for text in ["8.09.22 south", "8-09-22 south", "8/9/22 south"] {
        assert!(location.find(text).is_some() && Location::unknown().find(text).is_none(), "{text}");
    }
}

/// In slugs and titles, hyphens may mean decimal points or spaces.
#[test]
fn coordinates_with_hyphens_are_found_in_names() {
    for name in [
        "8-95611-39-60023",
        "fort-8-95611-39-60023",
        "6g3x2jv2-h3",
        "lat-8-956-lon-39-600",
        "8-57-22-s",
        "s-8-57-22-e-39-36-00",
        "e-565-977-n-9-009-946",
        "37l-el-65977-09946",
        "Fort 8-95611 39-60023",
        "Fort 8_95611_39_60023",
        "Fort 8\u{2010}95611 39\u{2011}60023",
        "utm-37s-565977",
    ] {
        assert!(fort().find_in_name(name).is_some(), "{name}");
        assert!(Location::unknown().find_in_name(name).is_some(), "{name} by its form");
    }
    for near in ["fort-8-95611", "565-977", "9-009-946", "2grf-w4"] {
        assert!(fort().find_in_name(near).is_some(), "{near}");
    }
    let ordinary = texts("ordinary");
    for name in ordinary.iter().map(String::as_str).chain([
        "fort-2026-11-23",
        "gereza-1505-1807",
        "ki-91",
        "vase-12-34567",
        "KI 2019-12 and 2019-13",
        "room-12-13",
        "saint-8-e",
        "model-v8-57-22",
        "tz-na-00123-b",
    ]) {
        for location in [fort(), Location::unknown()] {
            let found = location.find_in_name(name);
            assert!(found.is_none(), "{name}: {found:?}");
        }
    }
    assert!(is_name("title") && is_name("a.alternative_titles[2]") && !is_name("subtitle[0]") && !is_name("title.x"));
}

#[test]
fn lists_are_searched_as_one_joined_text() {
    for list in [["-8.956", "39.600"], ["65977", "09946"], ["8", "95611"], ["lat -8.95", "lon 39.52"]] {
        let found = |value: &Value| fort().find_in_json(value, &|_| false);
        let (at, _) = found(&serde_json::json!({ "subjects": ["fort", list[0], list[1]] })).unwrap();
        assert!(at.starts_with("subjects"), "{list:?}: {at}");
        let objects = serde_json::json!({ "creators": [{ "name": list[0], "role": "x" }, { "name": list[1] }] });
        assert!(found(&objects).unwrap().0.starts_with("creators"), "{list:?}");
    }
    let passed = serde_json::json!({ "subjects": ["-8.956", "39.600"] });
    assert!(fort().find_in_json(&passed, &|at| at == "subjects[1]").is_none());
    for list in [["fort", "coral rag"], ["rooms 12", "13"], ["1505", "1807"], ["KI 91", "KI 92"]] {
        assert!(fort().find_in_list(list).is_none() && Location::unknown().find_in_list(list).is_none(), "{list:?}");
    }
}

/// The search of uploads refuses everything that the local search refuses, except texts that only match the place.
#[test]
fn every_recognisable_form_is_found_even_if_the_location_is_unknown() {
    let unknown = Location::unknown();
    let (by_form, by_place) = (texts("found by form"), texts("found by place"));
    let missed: Vec<&String> = by_form.iter().filter(|text| unknown.find(text).is_none()).collect();
    assert!(missed.is_empty(), "{missed:#?}");
    let found: Vec<&String> = by_place.iter().filter(|text| unknown.find(text).is_some()).collect();
    assert!(found.is_empty(), "move to `found by form`: {found:#?}");
    // Text that is refused for another location is also refused if none is known.
    let elsewhere = Location::of([DVec3::ZERO, DVec3::ONE], None, Some(&place(61.5, 121.5)));
    for text in by_form.iter().chain(&by_place).chain(&texts("ordinary")) {
        assert!(elsewhere.find(text).is_none() || unknown.find(text).is_some(), "{text}");
        assert!(elsewhere.find_in_name(text).is_none() || unknown.find_in_name(text).is_some(), "{text}");
    }
}

#[test]
fn if_the_location_is_unknown_only_unambiguous_coordinates_are_refused() {
    let unknown = Location::unknown();
    for text in [
        "8°57'27\" S, 39°31'22\" E",
        "S 8.9577 E 39.5228",
        "lat=-8.95, lon=39.52",
        "-8.957712, 39.522834",
        "geo:-8.9577,39.5228",
        "https://www.openstreetmap.org/?mlat=1",
        "6GF72GVF+G4",
        "///filled.count.soap",
    ] {
        assert!(unknown.find(text).is_some(), "{text}");
    }
    assert!(unknown.find("565977").is_none() && unknown.find("39.5228").is_none(), "nobody knows");
}

/// The first digits of all 76 scripts of Unicode 17 that count by tens (General_Category Nd), without ASCII.
#[rustfmt::skip]
const ZEROS: [u32; 75] = [
    0x660, 0x6f0, 0x7c0, 0x966, 0x9e6, 0xa66, 0xae6, 0xb66, 0xbe6, 0xc66, 0xce6, 0xd66, 0xde6, 0xe50, 0xed0, 0xf20, 0x1040, 0x1090, 0x17e0,
    0x1810, 0x1946, 0x19d0, 0x1a80, 0x1a90, 0x1b50, 0x1bb0, 0x1c40, 0x1c50, 0xa620, 0xa8d0, 0xa900, 0xa9d0, 0xa9f0, 0xaa50, 0xabf0, 0xff10,
    0x104a0, 0x10d30, 0x10d40, 0x11066, 0x110f0, 0x11136, 0x111d0, 0x112f0, 0x11450, 0x114d0, 0x11650, 0x116c0, 0x116d0, 0x116da, 0x11730,
    0x118e0, 0x11950, 0x11bf0, 0x11c50, 0x11d50, 0x11da0, 0x11f50, 0x16130, 0x16a60, 0x16ac0, 0x16b50, 0x16d70, 0x1ccf0, 0x1d7ce, 0x1d7d8,
    0x1d7e2, 0x1d7ec, 0x1d7f6, 0x1e140, 0x1e2f0, 0x1e4f0, 0x1e5f1, 0x1e950, 0x1fbf0,
];

/// Northing, degrees, and degrees with minutes.
const BY_DIGITS: [&str; 3] = ["9009946", "-8.9562", "8°57'22\" S"];

#[test]
fn digits_of_every_script_are_recognised() {
    let fort = fort();
    for zero in ZEROS {
        let other = |c: char| char::from_u32(zero + c.to_digit(10)?);
        for form in BY_DIGITS {
            let text: String = form.chars().map(|c| other(c).unwrap_or(c)).collect();
            assert!(fort.find(&text).is_some(), "{text} (U+{zero:04X})");
        }
    }
}

#[test]
fn invisible_characters_hide_no_coordinate() {
    let fort = fort();
    let ranges = [
        0xad..=0xad,
        0x300..=0x36f,
        0x61c..=0x61c,
        0x64b..=0x65f,
        0x115f..=0x1160,
        0x17b4..=0x17b5,
        0x180b..=0x180f,
        0x1ab0..=0x1ace,
        0x1dc0..=0x1dff,
        0x200b..=0x200f,
        0x202a..=0x202e,
        0x2060..=0x206f,
        0x20d0..=0x20f0,
        0x2800..=0x2800,
        0x3164..=0x3164,
        0xfe00..=0xfe0f,
        0xfe20..=0xfe2f,
        0xfeff..=0xfeff,
        0xffa0..=0xffa0,
        0xfff0..=0xfffb,
        0x1bca0..=0x1bca3,
        0x1d173..=0x1d17a,
        0xe0000..=0xe0fff,
    ];
    for code in ranges.into_iter().flatten() {
        let sign = char::from_u32(code).unwrap();
        for form in BY_DIGITS {
            let text: String = form.chars().flat_map(|c| [c, sign]).collect();
            assert!(fort.find(&text).is_some(), "{form} with U+{code:04X}");
        }
    }
}

#[test]
fn if_the_location_is_unknown_the_form_alone_decides() {
    let unknown = Location::unknown();
    for text in [
        "EPSG:32737",
        "EPSG 32637",
        "UTM 37S 565977",
        "UTM zone 37 south",
        "565977.25 9009946.5",
        "565 977 E 9 009 946 N",
        "N 9,009,946 / E 565,977",
        "Easting 565977, northing 9009946",
        "37LEL6597709946",
        "37L EL 65977 09946",
        "37LEL6597",
        "37LEL 65 97",
        "37L EL 659 099",
        "MGRS 37L EL 65 97",
        "3DVR2023",
        "grid reference 3D VR 2023",
        "8.57.22 S",
        "S 8.57.22",
        "8,57,22S",
        "8.57.22S 39.36.00E",
        "8.57.22 south",
        "8-57-22 south",
        "8.09.22 S",
        "S 8-09-22",
        "lat 8.09.22 south",
        "-8.9561094",
        "39.600225",
        "39,600225\u{b0}",
        "8\u{b0}57'22\"S",
        "8\u{b0}57'22\"",
        "-8.956/39.600",
        "-8.956, 39.600",
        "8.9561 S",
        "lat 8.956",
        "geohash kvu8c2b",
        "8\u{fe0f}.\u{fe0f}9561094",
        "-0.79440, 36.90123",
        "-0.79440",
        "lat -0.79440 lon 0.10234",
        "-0.794, 36.901",
        "0.522; 136.590",
        "lat 0.522",
        "0.79440 S",
        "-0.02361 0.10123",
        "51.4779, -0.0015",
        "Looters came to 8.956109, 39.600225 (EPSG:32737 565977 9009946)",
    ] {
        let among = format!("The fort was built in 1505 of coral rag; {text} (see p. 12)");
        assert!(unknown.find(text).is_some() && unknown.find(&among).is_some(), "{text}");
    }
    for text in ["EPSG:4326", "WGS 84 (EPSG:3857)", "projected with UTM", "123,456 vertices and 1,234,567 triangles"] {
        assert!(unknown.find(text).is_none(), "{text}");
    }
    let projected = Location::unknown().with_known_system();
    assert!(projected.find("EPSG:32737, UTM zone 37S").is_none() && projected.find("565977 9009946").is_some());
}

/// If time grew with the square of the length, the first of these texts would take more than ten minutes, and nextest would end the test.
#[test]
fn search_time_is_linear_in_the_length_of_any_text() {
    let length = if std::env::var_os("KILWA_SOAK").is_some() { 1_200_000 } else { 200_000 };
    for piece in [
        "1",
        "7 ",
        "1.",
        "123'",
        "1e",
        "+2",
        "epsg ",
        "1 utm ",
        "///a.b.",
        "geohash1",
        "N1",
        "1°1'",
        "lat 1 ",
        "a1",
        "&#",
        "%25",
        "\\u",
        ",",
        "1. ",
        "1.1.1S",
        "1/1,",
        "S1.1E",
        "-01",
        "google.",
        "getty.edu ",
        "a. ",
        "AB12 grid ",
        "1-",
        "&plus;",
        "0+",
    ] {
        let text = piece.repeat(usize::div_ceil(length, piece.len()));
        // What is found does not matter here, only how long it takes.
        drop(Location::unknown().find(&text));
        if matches!(piece, "1-") {
            drop(Location::unknown().find_in_name(&text));
        }
        if matches!(piece, "1" | "7 ") {
            drop(fort().find(&text));
        }
    }
}

#[test]
fn the_json_path_of_a_text_is_reported() {
    let value = serde_json::json!({ "a": [{ "b": "fine" }, { "b": "at 565977", "c": 565_977 }], "passed": "565977" });
    let (at, finding) = fort().find_in_json(&value, &|at| at == "passed").unwrap();
    assert_eq!((at.as_str(), finding.kind), ("a[1].b", Kind::MapCoordinate));
    assert!(fort().find_in_json(&value, &|at| at == "passed" || at == "a[1]").is_none());
    assert!(fort().find_in_json(&serde_json::json!({ "565977": 1 }), &|_| false).is_some(), "in a key");
}

/// A number with its digits grouped.
fn grouped(number: u64, sign: char) -> String {
    let digits = number.to_string();
    let mut out = String::new();
    for (i, c) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(sign);
        }
        out.push(c);
    }
    out
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(if std::env::var_os("KILWA_SOAK").is_some() { 20_000 } else { 500 }))]

    #[test]
    fn no_text_makes_the_search_panic_or_hang(text in ".{0,300}") {
        let _ = fort().find(&text);
        let _ = Location::unknown().find(&text);
    }

    #[test]
    fn no_text_of_digits_and_signs_makes_the_search_panic_or_hang(text in "[0-9 .,:°'\"NSEWOnsewo+/%a-f_-]{0,200}") {
        let _ = fort().find(&text);
    }

    /// Any place on earth, in the forms that programs and people write.
    #[test]
    fn a_planted_location_is_found_anywhere_in_a_text(
        lat in -79.9..79.9f64, lon in -179.9..179.9f64, decimals in 2..9usize, before in "[a-zA-Z ]{0,12}", after in "[a-zA-Z ]{0,12}",
    ) {
        let location = Location::of([DVec3::ZERO, DVec3::ONE], None, Some(&place(lat, lon)));
        let quarter = |v: f64, letters: [char; 2]| if v < 0.0 { letters[1] } else { letters[0] };
        let sixty = |v: f64| { let s = (v.abs() * 3600.0).floor() as u64; (s / 3600, s / 60 % 60, s % 60) };
        let ((d, m, s), (e, f, g)) = (sixty(lat), sixty(lon));
        let (n, w) = (quarter(lat, ['N', 'S']), quarter(lon, ['E', 'W']));
        let mut forms = vec![
            format!("{lat:.decimals$}, {lon:.decimals$}"),
            format!("{lon:.decimals$} {lat:.decimals$}").replace('.', ","),
            format!("{:.decimals$}°{n} {:.decimals$}°{w}", lat.abs(), lon.abs()),
            format!("geo:{lat:.decimals$},{lon:.decimals$}"),
            format!("https://x.example/@{lat:.decimals$},{lon:.decimals$},15z"),
            format!("https://x.example/?mlat={lat:.decimals$}&mlon={lon:.decimals$}"),
            format!("{lat:.decimals$}%2C%20{lon:.decimals$}"),
            format!("{d}°{m}'{s}\"{n} {e}°{f}'{g}\"{w}"),
            format!("{n}{d:02}:{m:02}:{s:02} {w}{e:03}:{f:02}:{g:02}"),
            format!("{d:02}{m:02}{s:02}{n}{e:03}{f:02}{g:02}{w}"),
        ];
        if decimals >= 4 {
            forms.push(format!("{lat:.decimals$}"));
            forms.push(format!("{:.decimals$}", lon.abs()).replace('.', ","));
        }
        let zone = (((lon + 180.0) / 6.0).floor() as u32).min(59) + 1;
        let epsg = (32_600 + zone + if lat < 0.0 { 100 } else { 0 }) as u16;
        let [east, north] = projected(epsg, [lat, lon]).unwrap();
        for number in [east, north].into_iter().filter(|v| *v >= MAP) {
            let whole = number.round() as u64;
            forms.extend([whole.to_string(), format!("{number:.3}")]);
            forms.extend([' ', ',', '.', '\'', '_', '\u{202f}'].map(|sign| grouped(whole, sign)));
        }
        for form in forms {
            let text = format!("{before} {form} {after}");
            prop_assert!(location.find(&text).is_some(), "{text}");
        }
    }
}
