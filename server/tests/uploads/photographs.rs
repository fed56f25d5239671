//! Uploads with a colour report and photographs: published with what they are, or refused with what is wrong.

use super::{METADATA, Museum};
use crate::common::version::Version;
use crate::common::{get, pack_from};
use axum::http::StatusCode;
use glam::DVec3;
use kilwa_archive::checksums::sha256;
use kilwa_archive::{ColourReport, Metadata};
use kilwa_pack::metadata::SourceFile;
use kilwa_server::upload::wire::State;
use serde_json::{Value, json};

const PHOTO: &[u8] = b"\xff\xd8\xff\xe0 a photograph";
const MASK: &[u8] = b"\x89PNG\r\n\x1a\n a mask";
const PATH: &str = "photographs/images/a.jpg";
const MASK_PATH: &str = "photographs/masks/a.png";

/// A version with a photograph, its mask and the report, changed by `change`.
fn with(change: impl FnOnce(&mut Value, &mut Vec<(String, Vec<u8>)>)) -> Version {
    let mut report = json!({
        "kilwa_colour_report": 1, "vertices": 3, "coloured_share": 1.0, "points_compared": 0, "brightness": 1.0, "frame": null,
        "photographs": [{
            "name": "images/a.jpg", "file": "a.jpg", "path": PATH, "bytes": PHOTO.len(), "sha256": sha256(PHOTO),
            "mask": "a.png", "mask_path": MASK_PATH, "mask_bytes": MASK.len(), "mask_sha256": sha256(MASK),
            "camera": { "kind": "equirectangular", "size": [8, 4], "max_angle_degrees": 180.0 },
            "camera_from_world": { "rotation_wxyz": [1.0, 0.0, 0.0, 0.0], "translation": [0.0, 0.0, 0.0] }, "position": [0.0, 0.0, 0.0],
            "refined": null, "seen": 3, "share": 3.0, "dropped": 0, "gain": [1.0, 1.0, 1.0], "offset": [0.0, 0.0, 0.0], "corner": 1.0,
        }],
        "left_out": [],
    });
    let mut files = vec![(PATH.to_owned(), PHOTO.to_vec()), (MASK_PATH.to_owned(), MASK.to_vec())];
    change(&mut report, &mut files);
    let source = SourceFile { name: "a.jpg".to_owned(), bytes: PHOTO.len() as u64, sha256: sha256(PHOTO) };
    let mut version = Version::new("fort", 1, pack_from("fort", None, DVec3::ZERO, &[], vec![source]));
    let metadata = format!("{METADATA}[photographs]\nrights = \"CC BY 4.0\"\n");
    version.intent.metadata = Metadata::parse(&metadata).unwrap();
    for (path, bytes) in files {
        version.add(&path, bytes);
    }
    let written = ColourReport::parse(report.to_string().as_bytes()).and_then(|report| report.to_bytes());
    version.add("colour-report.json", written.unwrap_or_else(|_| report.to_string().into_bytes()));
    version
}

#[tokio::test]
async fn photographs_and_their_report_are_published_and_served_with_their_type() {
    let m = Museum::new();
    let (code, status) = m.publish(&with(|_, _| {})).await;
    assert_eq!((code, status.state), (StatusCode::OK, State::Published), "{status:?}");
    for (path, bytes, kind) in [(PATH, PHOTO, "image/jpeg"), (MASK_PATH, MASK, "image/png")] {
        let served = get(&m.app, &format!("/fort/v1/{path}")).await;
        assert_eq!((served.status, &served.body[..]), (StatusCode::OK, bytes), "{path}");
        assert_eq!((served.header("content-type"), served.header("x-content-type-options")), (kind, "nosniff"));
    }
    let paradata: Value = serde_json::from_slice(&get(&m.app, "/fort/v1/metadata/paradata.json").await.body).unwrap();
    assert_eq!(paradata["colours"]["photographs"][0]["share"], 3.0);
    assert_eq!(paradata["colours"]["included_photographs"]["count"], 1);
    let again = m.publish(&with(|_, _| {})).await.1;
    assert!(again.already, "{again:?}");
}

#[tokio::test]
async fn photographs_that_the_report_does_not_describe_are_refused() {
    let html = b"<script>alert(1)</script>".to_vec();
    let named = "the photographs that were sent are not those that it names";
    for (version, expected) in [
        (with(|_, files| files[0].1.push(0)), named),
        (with(|_, files| drop(files.pop())), named),
        (with(|_, files| files.push(("photographs/b.jpg".to_owned(), b"\xff\xd8\xff other".to_vec()))), named),
        (with(|report, _| report["photographs"][0]["seen"] = 0.into()), "no colour comes from it"),
        (with(|report, _| report["photographs"][0]["sha256"] = "0".repeat(64).into()), "a.jpg has the SHA-256"),
        (with(|report, _| report["left_out"] = "x".into()), "not a report as written by kilwa colour"),
        (
            with(|report, files| {
                files[0].1 = html;
                report["photographs"][0]["bytes"] = files[0].1.len().into();
                report["photographs"][0]["sha256"] = sha256(&files[0].1).into();
            }),
            "is not a picture of the type that its name states",
        ),
    ] {
        let m = Museum::new();
        let (code, status) = m.publish(&version).await;
        let why = status.error.clone().unwrap_or_default();
        assert_eq!((code, status.state), (StatusCode::UNPROCESSABLE_ENTITY, State::Refused), "{expected}: {why}");
        assert!(why.contains(expected), "{expected}: {why}");
        assert!(m.has_nothing());
    }
}

#[tokio::test]
async fn an_announcement_of_photographs_is_checked_before_a_byte_is_sent() {
    let without_rights = with(|_, _| {});
    let withheld = with(|_, _| {});
    let (mut a, mut b, mut c) = (without_rights.intent, withheld.intent, with(|_, _| {}).intent);
    a.metadata.photographs = None;
    b.location_redacted = true;
    c.files.retain(|file| file.path != "colour-report.json");
    let mut all = vec![
        (a, "photographs need a statement of rights"),
        (b, "a colour report and photographs can reveal it"),
        (c, "no colour-report.json that names them"),
    ];
    for path in
        ["photographs/a.html", "photographs/../a.jpg", "photographs/.a.jpg", "photographs/a.JPG", "photos/a.jpg"]
    {
        let mut intent = with(|_, _| {}).intent;
        intent.files.iter_mut().filter(|file| file.path == PATH).for_each(|file| path.clone_into(&mut file.path));
        all.push((intent, "cannot be uploaded"));
    }
    for (intent, expected) in all {
        let m = Museum::new();
        let answer = m.begin(&m.robot, &intent).await;
        assert_eq!(answer.status, StatusCode::UNPROCESSABLE_ENTITY, "{expected}: {}", answer.text());
        assert!(answer.text().contains(expected), "{expected}: {}", answer.text());
    }
}
