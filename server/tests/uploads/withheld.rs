//! A version announced as without its location is searched for it: texts, channels, pictures, preview.

use super::Museum;
use crate::common::pack_at;
use crate::common::version::Version;
use axum::http::StatusCode;
use glam::DVec3;
use kilwa_pack::{DirectoryEntry, HEADER_BYTES, Metadata, PAGE_BYTES, PackWriter, Reader, SliceSource};
use kilwa_server::upload::wire::State;
use serde_json::{Value, json};
use std::io::Write as _;

/// A version announced as without its location, with the pictures that `kilwa publish` makes.
fn withheld(pack: Vec<u8>) -> Version {
    let mut version = Version::new("fort", 1, pack);
    version.intent.location_redacted = true;
    let posters = [("poster.jpg", [1200, 630]), ("poster-600.jpg", [600, 315]), ("poster-300.jpg", [300, 158])];
    let others = [("drawings/plan.png", drawing(&[0; 12])), ("preview.glb", preview(&json!({}), &[]))];
    for (path, bytes) in posters.map(|(p, size)| (p, jpeg(size, &[]))).into_iter().chain(others) {
        replace(&mut version, path, bytes);
    }
    version
}

/// A drawing of 2 x 2 pixels as `kilwa publish` writes it.
fn drawing(pixels: &[u8; 12]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = kilwa_archive::drawing::begin(&mut bytes, [2, 2], 0x1712).unwrap();
    let mut stream = writer.stream_writer().unwrap();
    stream.write_all(pixels).unwrap();
    stream.finish().unwrap();
    drop(writer);
    bytes
}

/// A grey poster as `kilwa publish` writes it, with something before its end.
fn jpeg(size: [u32; 2], more: &[u8]) -> Vec<u8> {
    jpeg_with(size, &[], more)
}

/// The same with more bits in its first block.
fn jpeg_with([width, height]: [u32; 2], first: &[u8], more: &[u8]) -> Vec<u8> {
    let mut bytes = include_bytes!("../../src/upload/poster-head.bin").to_vec();
    bytes[25..29].copy_from_slice(&(height << 16 | width).to_be_bytes());
    // Three blocks of nothing in 14 bits.
    let units = width.div_ceil(8) * height.div_ceil(8);
    let mut bits: Vec<u8> = (0..units).flat_map(|_| [0, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0]).collect();
    drop(bits.splice(2..2, first.iter().copied()));
    let whole = |byte: &[u8]| (0..8).fold(0, |sum, i| sum << 1 | byte.get(i).copied().unwrap_or(1));
    bytes.extend(bits.chunks(8).map(whole));
    [&bytes, more, b"\xff\xd9"].concat()
}

const RESOLUTION: &[u8] = b"\0\0\x17\x12\0\0\x17\x12\x01";

/// A drawing of 2 x 2 pixels with these chunks.
fn png(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    let head: (&[u8; 4], &[u8]) = (b"IHDR", b"\0\0\0\x02\0\0\0\x02\x08\x02\0\0\0");
    for (kind, data) in [&[head], chunks, &[(b"IEND", b"")]].concat() {
        let body = [&kind[..], data].concat();
        let mut crc = flate2::Crc::new();
        crc.update(&body);
        bytes.extend([&(data.len() as u32).to_be_bytes()[..], &body, &crc.sum().to_be_bytes()].concat());
    }
    bytes
}

fn zipped(bytes: &[u8]) -> Vec<u8> {
    let mut out = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
    out.write_all(bytes).unwrap();
    out.finish().unwrap()
}

/// A preview of one triangle as `kilwa publish` writes it, with other values, and with more behind its triangle.
fn preview(other: &Value, more: &[u8]) -> Vec<u8> {
    let mut value = json!({
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "max": [0.25, 0.25, 0.0], "min": [-0.25, -0.25, 0.0], "type": "VEC3"},
            {"bufferView": 0, "byteOffset": 12, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 3, "type": "SCALAR"}
        ],
        "asset": {"generator": concat!("kilwa ", env!("CARGO_PKG_VERSION")), "version": "2.0"},
        "bufferViews": [
            {"buffer": 0, "byteLength": 72, "byteStride": 24, "target": 34962},
            {"buffer": 0, "byteLength": 12, "byteOffset": 72, "target": 34963}
        ],
        "buffers": [{"byteLength": 84}],
        "extras": {"certified_error_m": 0.0, "crs": null, "world_from_local_m": [0.0, 0.0, 0.195_312_5]},
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 1.0}}],
        "meshes": [{"primitives": [{"attributes": {"NORMAL": 1, "POSITION": 0}, "indices": 2, "material": 0}]}],
        "nodes": [{"matrix": [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, -0.0, 1.0], "mesh": 0, "name": "Fort"}],
        "scene": 0,
        "scenes": [{"nodes": [0]}]
    });
    for (at, new) in other.as_object().unwrap() {
        let (parent, key) = at.rsplit_once('/').unwrap();
        value.pointer_mut(parent).unwrap()[key] = new.clone();
    }
    let mut text = value.to_string();
    text.extend(std::iter::repeat_n(' ', text.len().next_multiple_of(4) - text.len()));
    let corners = [[-0.25f32, -0.25, 0.0], [0.25, -0.25, 0.0], [0.25, 0.25, 0.0]];
    let floats = corners.iter().flat_map(|p| p.iter().chain(&[0.0, 0.0, 1.0])).flat_map(|f| f.to_le_bytes());
    let binary: Vec<u8> = floats.chain((0..3u32).flat_map(u32::to_le_bytes)).chain(more.iter().copied()).collect();
    let word = |n: usize| (n as u32).to_le_bytes();
    let (all, json, bin) = (word(28 + text.len() + binary.len()), word(text.len()), word(binary.len()));
    [b"glTF", &word(2)[..], &all, &json, b"JSON", text.as_bytes(), &bin, b"BIN\0", &binary].concat()
}

/// The same with one more vertex, inside the model, which no triangle uses.
fn with_unused_vertices() -> Vec<u8> {
    let other = json!({
        "/accessors/0/count": 4,
        "/accessors/1/count": 4,
        "/bufferViews/0/byteLength": 96,
        "/bufferViews/1/byteOffset": 96,
        "/buffers/0/byteLength": 108
    });
    let mut bytes = preview(&other, &[0; 24]);
    // Its position and normal are zero, and come before the indices.
    let corners = bytes.len() - 36;
    bytes[corners..].rotate_right(24);
    bytes
}

fn replace(version: &mut Version, path: &str, bytes: Vec<u8>) {
    version.files.remove(version.intent.files.iter().position(|f| f.path == path).unwrap());
    version.intent.files.retain(|f| f.path != path);
    version.add(path, bytes);
}

/// Where the middle of the test's pack lies, so that its bounds surround the origin, m.
const MIDDLE: DVec3 = DVec3::new(-500.0 / 1024.0, -400.0 / 1024.0, 0.0);
/// The true place, in a form that every file is tried with.
const HERE: &[u8] = b"-8.956109 39.600225 EPSG:32737 565977 9009946";
const PICTURE: &str = "contains something besides its pixels";

fn at(x: f64, y: f64, z: f64) -> DVec3 {
    MIDDLE + DVec3::new(x, y, z)
}

fn true_place() -> DVec3 {
    at(565_977.0, 9_009_946.0, 31.0)
}

fn pack(origin: DVec3, channels: &[(&str, [f32; 3])]) -> Vec<u8> {
    pack_at("Fort", None, origin, channels)
}

/// A version without a fault, changed.
fn with(change: impl FnOnce(&mut Version)) -> Version {
    let mut version = withheld(pack(MIDDLE, &[]));
    change(&mut version);
    version
}

/// A version that announces that it keeps a channel.
fn kept(name: &str, values: [f32; 3]) -> Version {
    let mut version = withheld(pack(MIDDLE, &[(name, values)]));
    version.intent.kept_channels = vec![name.to_owned()];
    version
}

fn file(path: &str, bytes: Vec<u8>) -> Version {
    with(|v| replace(v, path, bytes))
}

/// A version with another value in its preview.
fn previewed(key: &str, value: &Value) -> Version {
    file("preview.glb", preview(&json!({ key: value }), b""))
}

/// The JPEG code for sixteen zeros in a block.
const ZEROS: [u8; 11] = [1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 1];

/// A segment of a JPEG that holds the true place.
fn segment(marker: u8) -> Vec<u8> {
    [&[0xff, marker, 0, HERE.len() as u8 + 2], HERE].concat()
}

/// Each of these versions is refused with this reason, and nothing of it appears.
async fn are_refused(table: Vec<(Version, &str)>) {
    // One server takes few uploads in a minute.
    for part in table.chunks(20) {
        let m = Museum::new();
        for (version, wanted) in part {
            let (code, status) = m.publish(version).await;
            let why = status.error.unwrap_or_default();
            assert_eq!(code, StatusCode::UNPROCESSABLE_ENTITY, "{wanted}: {why}");
            assert!(why.contains(wanted), "{wanted}: {why}");
            assert!(!m.models().join("fort").exists(), "{wanted}");
        }
    }
}

#[tokio::test]
async fn a_withheld_location_is_searched_for_in_pack_and_texts() {
    let utm = pack_at("Fort", Some("EPSG:32737"), MIDDLE, &[]);
    let titled = pack_at("Fort 8°57'27\" S 39°31'22\" E", None, MIDDLE, &[]);
    let description = Some("At S 8.9577 E 39.5228".to_owned());
    let holder = Some("geo:-8.95,39.52".to_owned());
    let note = "See https://www.openstreetmap.org/way/1".to_owned();
    are_refused(vec![
        (withheld(pack(true_place(), &[])), "the middle of its pack is at 565977.000 9009946.000, on height 31.000"),
        (withheld(pack(at(3.0, 0.0, 0.0), &[])), " m, not at 0 0"),
        (withheld(pack(at(0.0, 0.0, 31.0), &[])), "on height 31.000"),
        (withheld(utm), "its pack names a reference system"),
        (withheld(titled), "title of its pack: \"8°57'27\" S 39°31'22\"\" states coordinates"),
        (withheld(pack(MIDDLE, &[("intensity", [1.0, 2.0, 0.5])])), "\"intensity\", which was not announced as kept"),
        (kept("scalar_X", [565_977.0, 565_978.0, 565_977.0]), "\"scalar_X\" holds a coordinate or a height"),
        (with(|v| v.intent.metadata.description = description), "metadata: description: \"8.9577"),
        (with(|v| v.intent.metadata.rights.holder = holder), "metadata: rights.holder: \"geo:"),
        (with(|v| v.intent.note = note), "the note of the version: \"openstreetmap.org"),
        (with(|v| v.intent.location_cell = Some(0.5)), "a cell of 0.5 m does not hide a model"),
        (with(|v| v.intent.location_cell = Some(100_000.0)), " m, not at 50000 50000"),
        (with(|v| v.intent.location_cell = Some(-1.0)), "not a valid cell size"),
    ])
    .await;
}

/// Forms that used to be refused only if the location was known, names with hyphens, and lists whose items belong together.
#[tokio::test]
async fn a_withheld_location_is_searched_for_in_every_recognisable_form() {
    let described = |text: &str| {
        let text = Some(format!("Built in 1505; {text} (see p. 12)"));
        (with(|v| v.intent.metadata.description = text), "metadata: description: ")
    };
    let mut table: Vec<(Version, &str)> = [
        "S08:57:27",
        "S8.956E39.600",
        "20.268S30.934E",
        "8 degrees, 57 minutes, 22 seconds South",
        "8.57.22 S",
        "-085722+0393600/",
        "8/1,57/1,22/1",
        "https://www.google.co.tz/maps/place/x",
        "https://wego.here.com/x",
        "https://www.getty.edu/vow/TGNFullDisplay?subjectid=7001234",
        "/// index.home.raft",
        "6G3X2J00+",
        "6G3X2JV2&plus;H3",
        "39\u{2d9}60023",
        "latitude: -8.96",
    ]
    .map(described)
    .into();
    let named = |slug: &str| {
        let slug = slug.to_owned();
        with(|v| (v.intent.slug, v.intent.metadata.slug) = (slug.clone(), Some(slug)))
    };
    let listed = |list: [&str; 2]| with(|v| v.intent.metadata.subjects = list.map(str::to_owned).into());
    table.extend([
        (named("fort-8-95611-39-60023"), "slug: "),
        (named("6g3x2jv2-h3"), "slug: "),
        (named("lat-8-956-lon-39-600"), "slug: "),
        (listed(["-8.956", "39.600"]), "metadata: subjects: "),
    ]);
    are_refused(table).await;
    let m = Museum::new();
    let ordinary =
        "Version 8.57.22, 2026-11-23; rooms 12, 13; KI 91; the road E 39; ISBN 978-3-16-148410-0; EUR 8,95; scale 1:50";
    let plain = with(|v| {
        v.intent.metadata.description = Some(ordinary.to_owned());
        v.intent.metadata.subjects = ["fort", "coral rag", "1505"].map(str::to_owned).into();
    });
    let (code, status) = m.publish(&plain).await;
    assert_eq!(code, StatusCode::OK, "{:?}", status.error);
}

/// The test's pack with other numbers, written as `kilwa build` would.
fn stating(change: impl FnOnce(&mut Metadata, &mut DirectoryEntry)) -> Version {
    let bytes = pack(MIDDLE, &[]);
    let reader = Reader::open(SliceSource(&bytes)).unwrap();
    let (mut metadata, mut entry) = (reader.metadata().clone(), reader.entries()[0].clone());
    let chunk = &bytes[entry.offset as usize..][..entry.encoded_bytes as usize];
    change(&mut metadata, &mut entry);
    let mut writer = PackWriter::begin(Vec::new(), reader.header().clone(), &metadata, vec![entry]).unwrap();
    writer.chunk(chunk).unwrap();
    withheld(writer.finish().unwrap())
}

/// The test's pack with other bytes and correct checksums.
fn tampered(change: impl FnOnce(&mut [u8], std::ops::Range<usize>, usize)) -> Version {
    let mut bytes = pack_at(&format!("Fort{}", " ".repeat(60)), None, MIDDLE, &[]);
    let header = Reader::open(SliceSource(&bytes)).unwrap().header().clone();
    let (at, page) = (header.metadata.0 as usize, header.first_page as usize);
    let metadata = at..at + header.metadata.1 as usize;
    change(&mut bytes, metadata.clone(), page);
    let sum = kilwa_pack::checksum(&bytes[metadata]);
    bytes[88..104].copy_from_slice(&sum);
    bytes[page + 16..page + 32].fill(0);
    let sum = kilwa_pack::checksum(&bytes[page..page + PAGE_BYTES]);
    bytes[page + 16..page + 32].copy_from_slice(&sum);
    let (head, directory) = (blake3::hash(&bytes[..224]), blake3::hash(&sum));
    bytes[224..HEADER_BYTES].copy_from_slice(head.as_bytes());
    let footer = bytes.len() - 80;
    bytes[footer + 16..footer + 48].copy_from_slice(head.as_bytes());
    bytes[footer + 48..].copy_from_slice(directory.as_bytes());
    Reader::open(SliceSource(&bytes)).expect("a sound pack for every reader");
    withheld(bytes)
}

/// Numbers, unknown members and reserved bytes can contain a location just as texts can.
#[tokio::test]
async fn a_withheld_location_is_searched_for_outside_the_texts_of_the_pack() {
    let member = |text: &'static str| {
        tampered(move |bytes, metadata, _| {
            let json = String::from_utf8(bytes[metadata.clone()].to_vec()).unwrap();
            let title = format!("\"Fort{}\"", " ".repeat(60));
            let other = json.replace(&title, &format!("{:<width$}", format!("\"Fort\"{text}"), width = title.len()));
            bytes[metadata].copy_from_slice(other.as_bytes());
        })
    };
    let (doubles, here) = ([565_977.0f64, 9_009_946.0].map(f64::to_le_bytes).concat(), b"LAT -8.95611 LON 39.60027");
    let (as_written, option) = ("is not, byte for byte, what this version", "is not one that kilwa build writes");
    let named = |name: &str, value: &str| {
        let (name, value) = (name.to_owned(), value.to_owned());
        stating(|m, _| {
            m.options.insert(name, value);
        })
    };
    are_refused(vec![
        (member(",\"wgs84\":[39.60027,-8.95611]"), as_written),
        (member(",\"origin\":[565987,9009946]"), as_written),
        (member(" "), as_written),
        (tampered(|bytes, _, _| bytes[146..146 + here.len()].copy_from_slice(here)), as_written),
        (tampered(|bytes, _, _| bytes[24..32].copy_from_slice(&doubles[..8])), as_written),
        (tampered(|bytes, _, page| bytes[page + 32..page + 48].copy_from_slice(&doubles)), as_written),
        (
            tampered(|bytes, _, page| bytes[page + PAGE_BYTES - 16..page + PAGE_BYTES].copy_from_slice(&doubles)),
            as_written,
        ),
        (named("lat", "-8.956"), option),
        (named("step", "-8.956"), option),
        (named("leaf-triangles", "9009946"), option),
        (named("leaf-triangles", "08956"), option),
        (
            stating(|m, _| {
                m.repairs.insert("x565987".to_owned(), 9_009_946);
            }),
            "has a number in its name",
        ),
        (stating(|m, _| m.median_edge = 39.600_27), "median_edge of its pack is 39.60027 m"),
        (stating(|m, _| m.capture_accuracy = Some(8.956_11)), "capture_accuracy of its pack is 8.95611"),
        (stating(|m, _| m.capture_registration = Some(8.956_11)), "capture_registration of its pack is 8.95611"),
        (stating(|m, _| m.vertices = 9_009_946), "states 9009946 vertices"),
        (
            stating(|m, _| m.border_edges = 9_009_946),
            "3 border edges of the finest level are there, 9009946 are announced",
        ),
        (
            stating(|_, e| (e.sphere.center, e.sphere.radius) = ([565_987.0, 9_009_946.0, 0.0].into(), 1e8)),
            "the directory of its pack has bounding spheres",
        ),
        (stating(|_, e| e.sphere.radius = 9_009_946.0), "the directory of its pack has bounding spheres"),
        (stating(|_, e| e.color_error = 565_987.0), "the directory of its pack has bounding spheres"),
    ])
    .await;
}

/// The announced numbers of the preview appear on pages and in records, so they must be those of the file, even if nothing is withheld.
#[tokio::test]
async fn announced_numbers_are_compared_with_the_files() {
    let accuracy = |metres: f64| {
        with(|v| v.intent.metadata.capture = Some(serde_json::from_value(json!({ "accuracy": metres })).unwrap()))
    };
    let announced = |mut version: Version, triangles: u64, error: f64| {
        version.intent.preview = Some(kilwa_server::upload::wire::AnnouncedPreview { triangles, error });
        version
    };
    let open = || Version::new("fort", 1, pack(true_place(), &[]));
    let what = "preview.glb has 1 triangle with an error of 0 m";
    are_refused(vec![
        (announced(withheld(pack(MIDDLE, &[])), 1, 39.600_27), what),
        (announced(withheld(pack(MIDDLE, &[])), 9_009_946, 0.0), what),
        (announced(open(), 1, 39.600_27), what),
        (announced(open(), 9_009_946, 565_987.0), what),
        (announced(open(), u64::MAX, 0.0), what),
        (accuracy(8.956_11), "metadata: capture.accuracy is 8.95611"),
        (with(|v| v.intent.metadata.description = Some("At -0.79440 36.90123".to_owned())), "metadata: description"),
    ])
    .await;
    let m = Museum::new();
    assert_eq!(m.publish(&accuracy(0.0035)).await.0, StatusCode::OK);
}

#[tokio::test]
async fn a_withheld_location_is_searched_for_in_the_preview() {
    let world = json!([565_977.0, 9_009_946.0, 31.0]);
    let larger = json!([565_977.0, 0.25, 0.0]);
    let mut table = vec![
        (previewed("/extras/world_from_local_m", &world), "preview.glb states a position outside"),
        (previewed("/accessors/0/max", &larger), "preview.glb has coordinates larger than the model"),
        (
            previewed("/accessors/0/max", &json!([0.375, 0.25, 0.0])),
            "preview.glb does not have the vertices or triangles",
        ),
        (file("preview.glb", preview(&json!({}), b"565977__")), "preview.glb does not have the vertices or triangles"),
        (file("preview.glb", with_unused_vertices()), "preview.glb does not have the vertices or triangles"),
    ];
    for (key, value) in [
        ("/meshes/0/name", json!("E565977 N9009946")),
        ("/accessors/0/name", json!("EPSG:32737")),
        ("/buffers/0/name", json!("9009946")),
        ("/9009946", json!(1)),
        ("/extras/a", json!(565_977.25)),
        ("/extras/crs", json!("EPSG:32737")),
        ("/asset/extras", json!({"lat": -8.956, "lon": 39.6})),
        ("/asset/version", json!("2.0 565977")),
        ("/asset/copyright", json!("-8.957712, 39.522834")),
        ("/cameras", json!([{"type": "perspective", "perspective": {"yfov": 0.5, "znear": 565_977.25}}])),
        ("/nodes/0/translation", json!([565_977.0, 0.0, 0.0])),
    ] {
        table.push((previewed(key, &value), "preview.glb is not in the form in which this version"));
    }
    are_refused(table).await;
}

#[tokio::test]
async fn a_withheld_location_is_searched_for_in_posters() {
    let poster = |change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = jpeg([1200, 630], b"");
        change(&mut bytes);
        (file("poster.jpg", bytes), PICTURE)
    };
    let restart = [b"\xff\xd0", HERE].concat();
    are_refused(vec![
        poster(&|b| drop(b.splice(2..2, segment(0xe1)))),
        poster(&|b| drop(b.splice(2..2, segment(0xdb)))),
        poster(&|b| drop(b.splice(609..609, segment(0xc4)))),
        poster(&|b| drop(b.splice(609..609, segment(0xdd)))),
        poster(&|b| b.extend(HERE)),
        (file("poster.jpg", jpeg([1200, 630], HERE)), PICTURE),
        (file("poster.jpg", jpeg([1200, 630], &restart)), PICTURE),
        // The code for sixteen zeros, once and three times, although only zeros follow.
        (file("poster.jpg", jpeg_with([1200, 630], &ZEROS, b"")), "its coded pixels"),
        (file("poster.jpg", jpeg_with([1200, 630], &[ZEROS; 3].concat(), b"")), "its coded pixels"),
        (file("poster-600.jpg", jpeg([1200, 630], b"")), "poster-600.jpg contains something besides its pixels"),
    ])
    .await;
}

#[tokio::test]
async fn a_withheld_location_is_searched_for_in_drawings() {
    let world = |text: &str| {
        let text = text.as_bytes().to_vec();
        with(|v| v.add("drawings/plan.pgw", text))
    };
    let mut table = vec![
        (world("1\n0\n0\n-1\n565977\n9009946\n"), "drawings/plan.pgw is not in the form"),
        (world("1.0\n0.0\n0.0\n-1.0\n565977.0\n9009946.0\n"), "drawings/plan.pgw places the plan somewhere else"),
    ];
    let with_chunks = |chunks: &[(&[u8; 4], &[u8])]| file("drawings/plan.png", png(chunks));
    let pixels = zipped(&[0; 14]);
    for kind in [b"tEXt", b"eXIf", b"pHYs", b"gAMA", b"tRNS", b"sBIT", b"PLTE", b"sRGB", b"cHRM", b"IDAT"] {
        for at in 0..=2 {
            let mut chunks = vec![(b"pHYs", RESOLUTION), (b"IDAT", &pixels)];
            chunks.insert(at, (kind, HERE));
            table.push((with_chunks(&chunks), PICTURE));
        }
    }
    let more = zipped(&[&[0; 14], HERE].concat());
    for stream in [&more[..], &[&pixels[..], &zipped(HERE)].concat(), &zipped(&[0; 13]), &zipped(&[9; 14])] {
        let chunks = with_chunks(&[(b"pHYs", RESOLUTION), (b"IDAT", stream)]);
        table.push((chunks, "the number of its pixels does not match its size"));
    }
    are_refused(table).await;
}

/// The same pixels can be compressed in countless ways. Only that of `kilwa publish` is accepted, because the choice among the others could be a message.
#[tokio::test]
async fn a_drawing_whose_pixels_are_compressed_in_another_way_is_refused_by_name() {
    let in_parts = |stream: &[u8]| {
        let (begin, end) = stream.split_at(5);
        png(&[(b"pHYs", RESOLUTION), (b"IDAT", begin), (b"IDAT", b""), (b"IDAT", end)])
    };
    let level = |level: u32| {
        let mut out = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::new(level));
        out.write_all(&[0; 14]).unwrap();
        out.finish().unwrap()
    };
    // Rows of zeros are the same with every filter.
    let filtered = |filters: [u8; 2]| zipped(&[&[filters[0]][..], &[0; 6], &[filters[1]], &[0; 6]].concat());
    let mut pictures = vec![in_parts(&zipped(&[0; 14]))];
    for stream in [level(0), level(1), level(9)].into_iter().chain([[1, 2], [3, 4], [4, 1]].map(filtered)) {
        pictures.push(png(&[(b"pHYs", RESOLUTION), (b"IDAT", &stream)]));
    }
    let what =
        "drawings/plan.png contains something besides its pixels, or is damaged: its pixels are not compressed as";
    let own = drawing(&[0; 12]);
    pictures.retain(|picture| *picture != own);
    assert!(pictures.len() > 4);
    are_refused(pictures.into_iter().map(|picture| (file("drawings/plan.png", picture), what)).collect()).await;
    // Any pixels are accepted.
    let m = Museum::new();
    let (code, status) = m.publish(&file("drawings/plan.png", drawing(b"four colours"))).await;
    assert_eq!(code, StatusCode::OK, "{:?}", status.error);
}

/// Without a place, with a channel of the surface, in a cell; and where nothing is announced as withheld, nothing is searched for.
#[tokio::test]
async fn a_version_that_matches_its_announcement_is_published() {
    let m = Museum::new();
    let mut cell = withheld(pack_at("Fort", Some("EPSG:32737"), at(550_000.0, 9_050_000.0, 0.0), &[]));
    cell.intent.location_cell = Some(100_000.0);
    let moved =
        json!({"/extras/crs": "EPSG:32737", "/extras/world_from_local_m": [550_000.0, 9_050_000.0, 0.195_312_5]});
    replace(&mut cell, "preview.glb", preview(&moved, b""));
    (cell.intent.slug, cell.intent.metadata.slug) = ("cell".to_owned(), Some("cell".to_owned()));
    let mut scalar = kept("class", [2.0; 3]);
    (scalar.intent.slug, scalar.intent.metadata.slug) = ("scalar".to_owned(), Some("scalar".to_owned()));
    let world = with(|v| v.add("drawings/plan.pgw", b"0.01\n0.0\n0.0\n-0.01\n-0.5\n0.4\n".to_vec()));
    for version in [world, cell, scalar] {
        let (code, status) = m.publish(&version).await;
        assert_eq!((code, status.state), (StatusCode::OK, State::Published), "{:?}", status.error);
    }
    let mut open = Version::new("open", 1, pack(true_place(), &[]));
    open.intent.metadata.description = Some("At S 8.9577 E 39.5228".to_owned());
    assert_eq!(m.publish(&open).await.0, StatusCode::OK);
}
