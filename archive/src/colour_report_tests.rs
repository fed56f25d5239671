use super::*;
use serde_json::{Value, json};

/// A report of two photographs as `kilwa colour` writes it, changed by `change`.
pub(crate) fn report(change: &dyn Fn(&mut Value)) -> Vec<u8> {
    let photo = |name: &str, sum: &str| {
        json!({
            "name": format!("images/{name}"), "file": format!("/home/amina/photos/{name}"), "bytes": 10, "sha256": sum.repeat(32),
            "mask": null, "mask_bytes": null, "mask_sha256": null,
            "camera": { "kind": "pinhole", "size": [96, 72], "max_angle_degrees": 60.0, "focal": [80.5, 80.5], "center": [48.0, 36.0], "skew": 0.0,
                "distortion": { "kind": "brown", "k": [0.1, -0.01], "p": [] } },
            "camera_from_world": { "rotation_wxyz": [1.0, 0.0, 0.0, 0.0], "translation": [1.0, 2.0, 3.0] },
            "position": [-1.0, -2.0, -3.0],
            "refined": { "moved_px": 2.0, "residual_px": 0.6, "agreement": 0.8 },
            "seen": 100, "share": 50.25, "dropped": 1, "gain": [1.0, 1.1, 0.9], "offset": [0.0, 0.0, 0.0], "corner": 0.8,
        })
    };
    let mut list = json!({
        "kilwa_colour_report": 1, "output": "/home/amina/fort.kilwa", "bytes": 5, "triangles": 9, "vertices": 200, "coloured_share": 0.75,
        "points_compared": 40, "brightness": 1.0, "frame": null,
        "photographs": [photo("a.jpg", "aa"), photo("b.jpg", "bb")],
        "left_out": [{ "name": "c.jpg", "why": "its pose stays uncertain", "overlay": "/home/amina/overlays/0003.png", "bytes": 7, "sha256": "cc".repeat(32) }],
    });
    change(&mut list);
    list.to_string().into_bytes()
}

fn refused(change: &dyn Fn(&mut Value)) -> String {
    ColourReport::parse(&report(change)).unwrap_err().to_string()
}

fn source(name: &str, sum: &str) -> SourceFile {
    SourceFile { name: name.to_owned(), bytes: 10, sha256: sum.repeat(32) }
}

#[test]
fn a_report_has_one_written_form_without_folders_of_the_computer() {
    let parsed = ColourReport::parse(&report(&|_| {})).unwrap();
    let bytes = parsed.to_bytes().unwrap();
    assert_eq!(ColourReport::parse(&bytes).unwrap().to_bytes().unwrap(), bytes);
    let text = String::from_utf8(bytes).unwrap();
    assert!(!text.contains("amina") && text.contains("\"file\":\"a.jpg\"") && text.contains("uncertain\""), "{text}");
    let windows = report(&|v| v["photographs"][0]["file"] = "C:\\photos\\a.jpg".into());
    assert_eq!(ColourReport::parse(&windows).unwrap().photographs[0].file, "a.jpg");
}

#[test]
fn anything_but_a_report_of_colours_is_refused_with_the_reason() {
    for text in ["", "[]", "{\"kilwa_colour_report\": \"x\"}", "{\"kilwa_colour_report\": 1}"] {
        let why = ColourReport::parse(text.as_bytes()).unwrap_err().to_string();
        assert!(why.contains("kilwa colour --report"), "{why}");
    }
    assert!(
        refused(&|v| drop(v.as_object_mut().unwrap().remove("kilwa_colour_report"))).contains("Run kilwa colour again")
    );
    assert!(refused(&|v| v["kilwa_colour_report"] = 7.into()).contains("format version 7"));
    let photo = |change: &'static dyn Fn(&mut Value)| refused(&move |v| change(&mut v["photographs"][1]));
    assert!(photo(&|p| p["sha256"] = "xy".into()).starts_with("photograph 2 (\"images/b.jpg\"): its SHA-256"));
    assert!(photo(&|p| p["name"] = "a\nb".into()).contains("control characters"));
    assert!(photo(&|p| p["mask"] = "m.png".into()).contains("its mask needs"));
    assert!(
        photo(&|p| (p["path"], p["seen"]) = ("photographs/b.jpg".into(), 0.into())).contains("no colour comes from it")
    );
    assert!(photo(&|p| p["share"] = (-1).into()).contains("not negative"));
    assert!(photo(&|p| p["position"][0] = 1e13.into()).contains("less than 1e12"));
    assert!(photo(&|p| p["camera_from_world"]["rotation_wxyz"][1] = 1.into()).contains("unit quaternion"));
    for path in [
        "../x.jpg",
        "photographs/../x.jpg",
        "poster.jpg",
        "photographs/x.html",
        "photographs/a b.jpg",
        "/photographs/x.jpg",
    ] {
        let why = refused(&|v| v["photographs"][0]["path"] = path.into());
        assert!(why.contains("its path must be in photographs"), "{path}: {why}");
    }
    let text = String::from_utf8(report(&|_| {})).unwrap();
    let twice = text.replacen("\"brightness\"", "\"vertices\":1,\"brightness\"", 1);
    assert!(ColourReport::parse(twice.as_bytes()).unwrap_err().to_string().contains("vertices"), "a key twice");
}

#[test]
fn a_report_belongs_to_a_pack_whose_sources_are_its_photographs() {
    let parsed = ColourReport::parse(&report(&|_| {})).unwrap();
    let mesh = source("fort.ply", "00");
    let (a, b) = (source("a.jpg", "aa"), source("b.jpg", "bb"));
    assert_eq!(parsed.same_photographs(&[mesh.clone(), a.clone(), b.clone()]), Ok(vec![]));
    let why = parsed.same_photographs(&[mesh.clone(), a.clone()]).unwrap_err().to_string();
    assert!(why.contains("b.jpg is not among the source files") && !why.contains("a.jpg"), "{why}");
    let why = parsed.same_photographs(&[mesh.clone(), a.clone(), source("b.jpg", "bc")]).unwrap_err().to_string();
    assert!(why.contains("b.jpg has the SHA-256 bbbbbbbbbbbb… in the report and bcbcbcbcbcbc… in the pack"), "{why}");
    // A photograph without a share need not be there.
    let unused = ColourReport::parse(&report(&|v| v["photographs"][1]["seen"] = 0.into())).unwrap();
    assert_eq!(unused.same_photographs(&[mesh.clone(), a.clone()]), Ok(vec![]));
    // The model may have been coloured before.
    let others = parsed.same_photographs(&[mesh, a, b, source("old.JPG", "dd")]).unwrap();
    assert!(others[0].contains("1 picture") && others[0].contains("old.JPG"), "{others:?}");
}

#[test]
fn sources_that_a_pack_lists_as_one_entry_are_compared_by_their_common_hash() {
    let parsed = ColourReport::parse(&report(&|_| {})).unwrap();
    let lines = format!("{}  a.jpg\n{}  b.jpg\n", "aa".repeat(32), "bb".repeat(32));
    let entry = |count: usize, text: &str| SourceFile::of_further(count, 20, sha256(text.as_bytes()));
    assert_eq!(parsed.same_photographs(&[entry(2, &lines)]), Ok(vec![]));
    let why = parsed.same_photographs(&[entry(2, "other")]).unwrap_err().to_string();
    assert!(why.contains("the last 2 source files of the pack are others"), "{why}");
    let why = parsed.same_photographs(&[entry(1, &lines)]).unwrap_err().to_string();
    assert!(why.contains("a.jpg is not among"), "{why}");
    // Other files may be among them, in which case nothing can be compared.
    let left = parsed.same_photographs(&[entry(3, "other")]).unwrap();
    assert!(left[0].contains("2 photographs of the report could not be compared"), "{left:?}");
}

#[test]
fn paths_are_plain_distinct_and_the_same_for_equal_files() {
    let mut paths = Paths::default();
    let of = |paths: &mut Paths, name: &str, sum: &str| paths.photograph(name, "jpg", sum);
    assert_eq!(of(&mut paths, "images/IMG_1.JPG", "1"), "photographs/images/IMG_1.jpg");
    assert_eq!(
        of(&mut paths, "images/img_1.jpeg", "2"),
        "photographs/images/img_1-2.jpg",
        "no two differ in case only"
    );
    assert_eq!(of(&mut paths, "other/IMG_1.jpg", "1"), "photographs/images/IMG_1.jpg", "equal files share a path");
    assert_eq!(of(&mut paths, "../../etc/pass wd", "3"), "photographs/etc/pass_wd.jpg");
    assert_eq!(of(&mut paths, "C:\\Fotos\\Größe #1.jpg", "4"), "photographs/C_/Fotos/Gr__e__1.jpg");
    assert_eq!(of(&mut paths, "..", "5"), "photographs/photograph.jpg");
    assert_eq!(paths.mask("IMG_1.mask.png", "6"), "photographs/masks/IMG_1.mask.png");
    for name in ["a/b/c/d/e.jpg", "\u{202e}gpj.exe", "x/.hidden", "é", " "] {
        let path = of(&mut paths, name, name);
        assert!(is_photograph(&path), "{path}");
    }
}

/// A smaller copy as a report names it.
fn copy(path: &str) -> Value {
    json!({ "path": path, "bytes": 3, "sha256": "ee".repeat(32), "size": [24, 18] })
}

#[test]
fn smaller_copies_are_files_of_the_version_and_counted_apart_from_the_photographs() {
    let (preview, thumbnail) = ("photographs/previews/a.jpg", "photographs/thumbnails/a.jpg");
    let parsed = ColourReport::parse(&report(&|v| {
        let photo = &mut v["photographs"][0];
        photo["path"] = "photographs/a.jpg".into();
        (photo["preview"], photo["thumbnail"]) = (copy(preview), copy(thumbnail));
    }));
    let parsed = parsed.unwrap();
    let paths: Vec<_> = parsed.files().iter().map(|file| file.path.to_owned()).collect();
    assert_eq!(paths, ["photographs/a.jpg", preview, thumbnail]);
    let included = crate::record::Included::of(&parsed).unwrap();
    assert_eq!((included.photographs, included.masks, included.bytes), (1, 0, 10));
    assert_eq!((included.copies, included.copy_bytes, included.files(), included.all_bytes()), (2, 6, 3, 16));
    assert_eq!(ColourReport::parse(&parsed.to_bytes().unwrap()), Ok(parsed));
}

#[test]
fn smaller_copies_that_cannot_be_shown_are_refused() {
    for (change, published) in [
        (&(|copy: &mut Value| copy["path"] = "photographs/a.png".into()) as &dyn Fn(&mut Value), true),
        (&|copy| copy["path"] = "poster.jpg".into(), true),
        (&|copy| copy["sha256"] = "ee".into(), true),
        (&|copy| copy["bytes"] = 0.into(), true),
        (&|copy| copy["bytes"] = (SMALLER_COPY_MAX + 1).into(), true),
        (&|copy| copy["size"][1] = 0.into(), true),
        (&|copy| copy["size"][0] = 100_000.into(), true),
        // Of a photograph that was not published.
        (&|_| {}, false),
    ] {
        let why = refused(&|v| {
            let photo = &mut v["photographs"][0];
            if published {
                photo["path"] = "photographs/a.jpg".into();
            }
            photo["thumbnail"] = copy("photographs/thumbnails/a.jpg");
            change(&mut photo["thumbnail"]);
        });
        assert!(why.contains("its smaller copies must be JPEG files in photographs"), "{why}");
    }
}
