//! Uploads that the server could not finish, and what happens when the same command is run again.

use super::Museum;
use crate::common::version::{Version, fort_pack};
use axum::http::{Method, StatusCode};
use kilwa_archive::Manifest;
use kilwa_archive::checksums::sha256;
use kilwa_server::upload::UploadLimits;
use kilwa_server::upload::wire::State;
use std::path::Path;
use std::sync::atomic::Ordering;

fn numbered(number: u32) -> Version {
    let mut version = Version::new("fort", number, fort_pack());
    version.intent.metadata.description = Some(format!("Text {number}"));
    version
}

/// Whether the object has no leftovers of a change, and its page is the one that the manifest names.
fn is_finished(object: &Path) -> bool {
    let manifest = Manifest::parse(&std::fs::read(object.join("manifest.json")).unwrap()).unwrap();
    let page = std::fs::read(object.join("index.html")).unwrap();
    !object.join(".kilwa-next").exists() && sha256(&page) == manifest.page.sha256
}

/// The disk fails before each change in turn. It makes no difference whether the client asks for the status before it repeats the upload.
#[tokio::test]
async fn the_same_command_finishes_a_version_interrupted_after_its_manifest() {
    for looks in [true, false] {
        let m = Museum::with(UploadLimits { per_minute: u32::MAX, ..UploadLimits::default() });
        let object = m.models().join("fort");
        let inside = m.folder.path().to_str().unwrap();
        assert_eq!(m.publish(&numbered(1)).await.1.version, 1);
        let (mut number, mut unfinished) = (2, 0);
        for allowed in 0.. {
            let version = numbered(number);
            m.steps.store(allowed, Ordering::Relaxed);
            let (code, status) = m.publish(&version).await;
            m.steps.store(u64::MAX, Ordering::Relaxed);
            if status.state == State::Published {
                assert!(!status.already && is_finished(&object));
                break;
            }
            let why = status.error.unwrap_or_default();
            assert!(!why.contains(inside) && !why.contains(".kilwa"), "step {allowed}: {code} {why}");
            if !object.join(".kilwa-next").exists() {
                continue;
            }
            let now = Manifest::parse(&std::fs::read(object.join("manifest.json")).unwrap()).unwrap();
            let is_published = now.current == number;
            unfinished += u32::from(is_published);
            if looks {
                let looked = m.send(Method::GET, "/uploads/fort", &m.robot, &[], Vec::new()).await;
                assert!(is_finished(&object), "step {allowed}: {}", looked.text());
            }
            let (code, status) = m.publish(&version).await;
            assert_eq!(
                (code, status.version, status.already),
                (StatusCode::OK, number, is_published),
                "step {allowed}"
            );
            assert!(is_finished(&object), "step {allowed}");
            number += 1;
        }
        assert!(unfinished > 2, "{unfinished} are too few");
    }
}

#[tokio::test]
async fn an_obstructing_file_is_reported_without_paths_of_the_server() {
    let m = Museum::new();
    let inside = m.folder.path().to_str().unwrap();
    assert_eq!(m.publish(&numbered(1)).await.1.version, 1);
    std::fs::create_dir(m.models().join("fort/v2")).unwrap();
    let (code, unnamed) = m.publish(&numbered(2)).await;
    assert_eq!(code, StatusCode::CONFLICT);
    std::fs::write(m.models().join("fort/manifest.json"), "{").unwrap();
    let (other, foreign) = m.publish(&numbered(2)).await;
    assert_eq!(other, StatusCode::CONFLICT);
    for why in [unnamed, foreign].map(|status| status.error.unwrap_or_default()) {
        assert!(!why.contains(inside) && why.contains("un the same command again"), "{why}");
    }
}
