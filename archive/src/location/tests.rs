use super::*;
use proptest::prelude::*;

/// A fort in UTM 37 S and its metadata.
const BOUNDS: [DVec3; 2] = [DVec3::new(565_950.0, 9_009_900.0, 2.0), DVec3::new(566_000.0, 9_009_990.0, 20.0)];

fn place(latitude: f64, longitude: f64) -> Place {
    Place { latitude: Some(latitude), longitude: Some(longitude), ..Place::default() }
}

fn fort() -> Location {
    Location::of(BOUNDS, Some("EPSG:32737"), Some(&place(-8.9577, 39.5228)))
}

/// Every form of the fort's place (its middle is 565975 E, 9009945 N; -8.9562, 39.6001 by its system, -8.9577, 39.5228 by its metadata).
const PLANTED: &[&str] = &[
    // Map coordinates.
    "at 565977",
    "E 565 977.25",
    "N 9,009,946.5",
    "9'009'946",
    "9.009.946",
    "565_977",
    "x=565977.25m",
    "2026 565\u{a0}977",
    "565.98 km east",
    "5.65977e5",
    "1 856 880 ft",
    "56597725 cm",
    "9009946250",
    "UTM 37L 565977 9009946",
    "65977 / -990054",
    "65977 09946",
    "E65977 N09946",
    "4 408 262 / -1 001 044",
    // Degrees.
    "(-8.9577, 39.5228)",
    "lat 8,9577°",
    "-8.957, 39.523",
    "8,957 / 39,523",
    "-8.96, 39.52",
    "8.96°S",
    "8.96 S",
    "latitude: -8.96",
    "Long. 39.6",
    "39.5228",
    "8\u{b0}57'27.7\" S",
    "39\u{b0} 31\u{2032} 22\u{2033} E",
    "8\u{ba} 57,5' S",
    "8&deg;57&prime;27&Prime; S",
    "8 deg 57 min 27 sec south",
    "8d57m27s",
    "S08:57:27",
    "08:57:27, 39:31:22",
    "8-57-27 S",
    "085727S 0393122E",
    "0857.462,S",
    "8° 57.46'",
    // Other digits and signs.
    "\u{665}\u{666}\u{665}\u{669}\u{667}\u{667}",
    "\u{669}\u{66c}\u{660}\u{660}\u{669}\u{66c}\u{669}\u{664}\u{666}",
    "\u{668}\u{66b}\u{669}\u{665}\u{667}\u{667}\u{60c}\u{663}\u{669}",
    "\u{6f5}\u{6f6}\u{6f5}\u{6f9}\u{6f7}\u{6f7}",
    "\u{ff15}\u{ff16}\u{ff15}\u{ff19}\u{ff17}\u{ff17}",
    "\u{1d7d3}\u{1d7d4}\u{1d7d3}\u{1d7d7}\u{1d7d5}\u{1d7d5}",
    "565\u{200b}977",
    // Addresses.
    "geo:-8.9577,39.5228",
    "geo:10,20",
    "https://example.org/?mlat=-8.9577&mlon=39.5228",
    "https://example.org/#map=17/-8.957/39.522",
    "https://example.org/@-8.96,39.52,17z",
    "https://example.org/?q=-8%2E9577%2C39%2E5228",
    "https://example.org/?u=https%253A%252F%252Fx%252F%2540-8%252E9577",
    "https://www.openstreetmap.org/node/1",
    "https://maps.app.goo.gl/abc",
    "https://www.google.com/maps/place/Kilwa",
    "https://www.wikidata.org/wiki/Q1741245",
    "https://www.geonames.org/157107",
    "https://tile.example.org/15/19988/17202.png",
    "///filled.count.soap",
    // Codes.
    "kykjj1ef",
    "geohash kykj5379",
    "kykjj",
    "6G3X2GRF+W4",
    "2GRF+W4 Kilwa",
    "6g3x2jv2%2bg2",
    "37L EL 65977 09946",
    "37LEL659099",
    "MGRS EL 6597 0994",
    "KI91tb",
    "ki91sb",
    "EPSG:32737",
    "epsg::32737",
    "UTM zone 37S",
    "37L (UTM)",
    "WGS 84 / UTM 37",
    "zone 37 S",
    // Metres south of the equator, other signs and units.
    "990054",
    "990 054 m south",
    "8\u{b7}9561",
    "9   009   946",
    "0857,367,S",
    "618 961.5 yd",
    "9.9513 gon",
    "537.4 minutes south",
    "wd:Q12345",
    // Non-decimal digits, and encodings.
    "\u{2079}\u{2070}\u{2070}\u{2079}\u{2079}\u{2074}\u{2076}",
    "\u{2089}\u{2080}\u{2080}\u{2089}\u{2089}\u{2084}\u{2086}",
    "\u{2468}\u{24ea}\u{24ea}\u{2468}\u{2468}\u{2463}\u{2465}",
    "\u{4e5d}\u{3007}\u{3007}\u{4e5d}\u{4e5d}\u{56db}\u{516d}",
    "&#57;&#48;&#48;&#57;&#57;&#52;&#54;",
    "&#x39;&#x30;&#x30;&#x39;&#x39;&#x34;&#x36;",
    "&#0057&#48&#48&#57&#57&#52&#54",
    "\\u0039\\u0030\\u0030\\u0039946",
    "\\u{39}\\u{30}09946",
    "\\x39\\x30\\x30\\x39946",
    "%26%2357;009946",
    "&amp;#57;&amp;#48;&amp;#48;&amp;#57;&amp;#57;&amp;#52;&amp;#54;",
    "&amp;amp;#57;009946",
    "\\u0026#57;009946",
    "&&num;57;009946",
    "\\ud835\\udfd7\\ud835\\udfce\\uD835\\uDFCE9946",
    "9\\udb40\\udd000\\udb40\\udd000\\udb40\\udd009946",
    "\u{7396}\u{96f6}\u{96f6}\u{7396}\u{7396}\u{8086}\u{9678}",
    // Without spaces, with commas, points and fractions.
    "S8.956E39.600",
    "8.956S39.600E",
    "s8,956e39,600",
    "S20.268E30.934",
    "20.268S30.934E",
    "8\u{b0}57'22\"S39\u{b0}36'01\"E",
    "65938,09442",
    "(65938,09442)",
    "[65938.09442]",
    "09442,65938",
    "8 degrees, 57 minutes, 22 seconds South",
    "8 degrees, 57 minutes and 22 seconds",
    "8 Grad, 57 Minuten, 22 Sekunden",
    "8.57.22 S",
    "S 8.57.22",
    "8,57,22S",
    "8/57/22 S",
    "8_57_22.4 S",
    "8.57.22S 39.36.00E",
    "8.57.22, 39.36.00",
    "S8.57",
    "8 57 22 S",
    "39\u{2d9}60023",
    "39\u{b7} 60023",
    "39. 60023",
    "39 .60023",
    "8, 95611",
    "8\u{3002}9561",
    "-085722+0393600/",
    "-08.956+039.600/",
    "-0857.4+03936.0+12CRSWGS_84/",
    "+48.577+007.749",
    "8/1,57/1,22/1",
    "[8/1, 57/1, 2240/100] [39/1, 36/1, 0/1]",
    "8/1 5736/100 0/1",
    // Addresses.
    "https://www.google.co.tz/maps/place/x",
    "google.com.br/maps",
    "google.co.za/maps",
    "google.ch:443/maps?q=x",
    "https://yandex.ru/maps/-/x",
    "https://wego.here.com/x",
    "https://here.com/p/s-x",
    "https://www.bing.com/maps?cp=x",
    "https://maps.apple.com/?ll=x",
    "https://mapy.cz/s/x",
    "https://waze.com/ul/x",
    "https://www.openstreetmap.fr/x",
    "https://t0.tiles.virtualearth.net/tiles/x",
    "https://www.getty.edu/vow/TGNFullDisplay?find=&place=&nation=&subjectid=7001234",
    "https://vocab.getty.edu/resource/tgn/7001234",
    "tgn:7001234",
    "/// index.home.raft",
    "///index . home . raft",
    "what3words: index.home.raft",
    // Codes.
    "tiles/a3001132002301203.jpeg",
    "6G3X2JV2&plus;H3",
    "6G3X2J00+",
    "6G3X0000+",
    "6G3X2JV2+",
    "EL6509",
    "EL 65 09",
    "locator KI91",
    "grid square KI91",
];

/// Texts that match the place but do not look like coordinates, so they are accepted if the place is unknown. Everything else
/// in [`PLANTED`] is refused by its form alone.
const FORMLESS: &[&str] = &[
    "at 565977",
    "E 565 977.25",
    "9'009'946",
    "9.009.946",
    "565_977",
    "x=565977.25m",
    "2026 565\u{a0}977",
    "565.98 km east",
    "5.65977e5",
    "1 856 880 ft",
    "56597725 cm",
    "9009946250",
    "65977 / -990054",
    "65977 09946",
    "-8.96, 39.52",
    "8.96°S",
    "8.96 S",
    "Long. 39.6",
    "39.5228",
    "8° 57.46'",
    "\u{665}\u{666}\u{665}\u{669}\u{667}\u{667}",
    "\u{669}\u{66c}\u{660}\u{660}\u{669}\u{66c}\u{669}\u{664}\u{666}",
    "\u{668}\u{66b}\u{669}\u{665}\u{667}\u{667}\u{60c}\u{663}\u{669}",
    "\u{6f5}\u{6f6}\u{6f5}\u{6f9}\u{6f7}\u{6f7}",
    "\u{ff15}\u{ff16}\u{ff15}\u{ff19}\u{ff17}\u{ff17}",
    "\u{1d7d3}\u{1d7d4}\u{1d7d3}\u{1d7d7}\u{1d7d5}\u{1d7d5}",
    "565\u{200b}977",
    "https://example.org/@-8.96,39.52,17z",
    "https://example.org/?u=https%253A%252F%252Fx%252F%2540-8%252E9577",
    "https://tile.example.org/15/19988/17202.png",
    "kykjj1ef",
    "kykjj",
    "KI91tb",
    "ki91sb",
    "zone 37 S",
    "990054",
    "990 054 m south",
    "8\u{b7}9561",
    "9   009   946",
    "618 961.5 yd",
    "9.9513 gon",
    "537.4 minutes south",
    "\u{2079}\u{2070}\u{2070}\u{2079}\u{2079}\u{2074}\u{2076}",
    "\u{2089}\u{2080}\u{2080}\u{2089}\u{2089}\u{2084}\u{2086}",
    "\u{2468}\u{24ea}\u{24ea}\u{2468}\u{2468}\u{2463}\u{2465}",
    "\u{4e5d}\u{3007}\u{3007}\u{4e5d}\u{4e5d}\u{56db}\u{516d}",
    "&#57;&#48;&#48;&#57;&#57;&#52;&#54;",
    "&#x39;&#x30;&#x30;&#x39;&#x39;&#x34;&#x36;",
    "&#0057&#48&#48&#57&#57&#52&#54",
    "\\u0039\\u0030\\u0030\\u0039946",
    "\\u{39}\\u{30}09946",
    "\\x39\\x30\\x30\\x39946",
    "%26%2357;009946",
    "&amp;#57;&amp;#48;&amp;#48;&amp;#57;&amp;#57;&amp;#52;&amp;#54;",
    "&amp;amp;#57;009946",
    "\\u0026#57;009946",
    "&&num;57;009946",
    "\\ud835\\udfd7\\ud835\\udfce\\uD835\\uDFCE9946",
    "9\\udb40\\udd000\\udb40\\udd000\\udb40\\udd009946",
    "\u{7396}\u{96f6}\u{96f6}\u{7396}\u{7396}\u{8086}\u{9678}",
    "65938,09442",
    "(65938,09442)",
    "[65938.09442]",
    "09442,65938",
    "8.57.22, 39.36.00",
    "S8.57",
    "8, 95611",
    "8\u{3002}9561",
    "tiles/a3001132002301203.jpeg",
    "EL6509",
    "EL 65 09",
    "grid square KI91",
];

#[test]
fn the_location_is_found_in_every_form() {
    let fort = fort();
    let missed: Vec<&str> = PLANTED.iter().copied().filter(|text| fort.find(text).is_none()).collect();
    assert!(missed.is_empty(), "{missed:#?}");
    // Also in the middle of other words.
    for text in PLANTED {
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

/// Sentences of catalogues, reports and metadata that no search may refuse.
const ORDINARY: &[&str] = &[
    "Built in 1505 and repaired in 1807.",
    "The keep measures 12.5 m by 8.96 m.",
    "8.957 m high",
    "8.957 m by 1.234 m",
    "8.957 and 8.958",
    "Walls 1.35-1.80 m thick, 9.2 m high.",
    "1,234,567 bricks",
    "The mesh has 32,600,000 triangles at 2 cm.",
    "724,727,186 points in 125 scans.",
    "UNESCO 144, inscribed 1981, criteria (iii).",
    "Inventory number 1987.45.123",
    "Accession 2004,0416.7",
    "TZ-NA-00123/b",
    "Bodleian MS. Arab. c. 90, fols. 23b-24a",
    "pp. 123-145, plates 12-17",
    "ISBN 978-3-16-148410-0",
    "ISSN 0305-4403",
    "doi:10.1145/1015706.1015802",
    "https://doi.org/10.5281/zenodo.1234567",
    "https://orcid.org/0000-0002-1825-0097",
    "https://ror.org/03p74gp79",
    "https://creativecommons.org/licenses/by/4.0/deed.fr",
    "2026-11-21",
    "21.11.2026",
    "8.9.2019 to 8.10.2019",
    "2009-07-20/2009-08-03",
    "2026-11-20T10:00:00.000Z",
    "At 12:30 the tide was in.",
    "From 08:57:27 to 09:31:22 the scanner stood still.",
    "a slope of 8\u{b0}, then of 45\u{b0} 30'",
    "The wall bears N 45\u{b0} 30' E.",
    "Roof pitch 30\u{b0} 15'.",
    "Radiocarbon age 1230 \u{b1} 45 BP (OxA-12345).",
    "cal AD 1280-1390 (95.4 %)",
    "Leica ScanStation P40, serial 1840123",
    "Focal length 24.1234 mm, pixel size 0.00391 mm",
    "Residuals of 0.0031, 0.0042 and 0.0028 m at three targets.",
    "Residuals of 0.01312, 0.00421 and 0.00283 m",
    "Pixels of 0.00391 x 0.00391 mm",
    "A lattice of 0.00390625 m",
    "Registered with CloudCompare 2.13.1 and kilwa 0.1.0",
    "RMS 0.0031 m over 57 targets",
    "Grant AH/V001234/1",
    "EUR 580,000 from the European Regional Development Fund",
    "Award no. 20-2022-0157",
    "phone +255 22 211 6421",
    "P.O. Box 2280, Dar es Salaam",
    "room 8.96, shelf E 12",
    "Scale 1:500, contour interval 0.25 m",
    "Section A-A' at level +3.20",
    "See fig. 4.12 and table 3.7.",
    "37 carved posts, 12 L of lime wash",
    "Two cannon, 18-pounders, on the east side.",
    "N wall, S wall and E gate, 3.5 m wide",
    "Swahili coast; fort; coral rag",
    "A copy of the model is at https://museum.example/models/gereza/",
    "sha256 9c7c0123456789abcdef0123456789abcdef0123",
    "urn:uuid:0b6ff3f0-5c3a-4c1f-9d53-8a5d00c0ffee",
    "Photograph NIKON D850, 1/250 s, f/8, ISO 64, 4288 x 2848 px",
    "Colour difference 2.3 \u{394}E00",
    "The population was 4,000 in 1331 (Ibn Battuta).",
    "32.6 million triangles in 96 blocks",
    "\u{661}\u{665}\u{660}\u{665}",
    "no number",
    // Similar to coordinates.
    "2026-11-23",
    "23.11.2026 E wing, 23.11.26",
    "Version 8.57.22 of the software",
    "8.9.19, S. 12",
    "8.9.2019 E. Juma",
    "Samsung S8, S22 and E39",
    "The road E 39 and the S8 line",
    "rooms 12, 13",
    "rooms 8, 9, 10 and 39, 60",
    "KI 91",
    "KI91, KI92 and EL 65",
    "KI 91.956, KI 39.600",
    "pp. 8, 57, 22",
    "ISBN 978-3-16-148410-0, ISBN 0-306-40615-2",
    "EUR 8,95 for adults; the guide costs USD 39.60",
    "TZS 65,938 and 9,442",
    "1/1, 1/10, 1/100",
    "Scales 1:50, 1:100; sheets 1/10, 2/10",
    "+255 22 211-6421, +49 30 12345-678",
    "+/-0.05",
    "from -12 to +36",
    "In 8 degrees of frost, 57 people stood there.",
    "It took 8 minutes, 22 seconds.",
    "8 degrees, 12 minutes of work",
    "The excavation grid has squares AB12 to AC14.",
    "el 1505 fue un a\u{f1}o de lluvia",
    "/// a comment of three words",
    "Data \u{a9} OpenStreetMap. They are free.",
    "https://www.google.com/search?q=fort and https://getty.edu/research",
    "C++ and A+B, 2+2",
    "A list: 1, 2, 3, 4.",
    "The wall is 12 m long, 8.5 m wide and 3 m high.",
    "Le b\u{e2}timent, haut de 8,95 m, est d\u{2019}\u{e9}poque",
    "Die Mauer ist 8,95 m hoch; O 12 ist die Nordwand.",
    "\u{c1}rea de 39.60 m2, oeste",
    "jengo lina vyumba 8, 12 na 39",
    // Dates and versions beside words for directions and initials.
    "Metashape 2.0.1, south facade",
    "Metashape 2.0.1, N. Juma",
    "CloudCompare 2.13.1, west facade",
    "kilwa 0.1.0, E. Juma",
    "12/05/19 north wall",
    "05/25/19 north wall",
    "Scanned 12-05-19, north facade",
    "Scanned 12-05-19, N. Juma",
    "Scanned 12.05.19, eastern tower",
    // Near grid references.
    "3D VR 2023",
    "3D XR 2024",
    "3D UV 4096",
    "3D-VR 2023 and 2D MR 2024",
    "3D UV 204 810",
];

#[test]
fn ordinary_sentences_are_accepted() {
    assert!(ORDINARY.len() >= 50);
    let elsewhere = Location::of(
        [DVec3::new(428_000.0, 5_520_000.0, 90.0), DVec3::new(428_050.0, 5_520_040.0, 120.0)],
        Some("EPSG:32632"),
        Some(&place(49.83, 8.0)),
    );
    for location in [fort(), elsewhere, Location::unknown()] {
        let refused: Vec<String> =
            ORDINARY.iter().filter_map(|text| location.find(text).map(|f| format!("{text}: {f}"))).collect();
        assert!(refused.is_empty(), "{} of {}: {refused:#?}", refused.len(), ORDINARY.len());
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
    for name in ORDINARY.iter().copied().chain([
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
    let missed: Vec<&str> = PLANTED.iter().copied().filter(|text| unknown.find(text).is_none()).collect();
    assert_eq!(missed, FORMLESS, "{missed:#?}");
    // Text that is refused for another location is also refused if none is known.
    let elsewhere = Location::of([DVec3::ZERO, DVec3::ONE], None, Some(&place(61.5, 121.5)));
    for text in PLANTED.iter().chain(ORDINARY) {
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
    let length = if std::env::var_os("KILWA_SOAK").is_some() { 1_200_000 } else { 600_000 };
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
