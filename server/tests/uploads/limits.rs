//! Limits of uploads: disk space and number.

use super::{Museum, NOW};
use crate::common::get;
use crate::common::version::{Version, fort_pack};
use axum::http::{Method, StatusCode};
use kilwa_server::access::{Accounts, Purpose};
use kilwa_server::upload::UploadLimits;
use kilwa_server::upload::wire::State;
use std::sync::atomic::Ordering;

#[tokio::test]
async fn a_disk_full_at_any_step_publishes_nothing_keeps_received_files_and_resumes_when_there_is_space() {
    let version = Version::new("fort", 1, fort_pack());
    let mut full = 0;
    for allowed in (0..).step_by(3) {
        let m = Museum::new();
        m.steps.store(allowed, Ordering::Relaxed);
        let (code, upload) = m.publish(&version).await;
        if upload.state == State::Published {
            break;
        }
        full += 1;
        assert_eq!(code, StatusCode::INSUFFICIENT_STORAGE, "step {allowed}: {upload:?}");
        let why = upload.error.unwrap_or_default();
        assert!(why.contains("is full") && why.contains("run the same command again"), "{why}");
        // After the manifest, only the page and the permissions are missing, and the message says so.
        let is_published = why.contains("the version is published, but not all of its files are in place");
        let status = get(&m.app, "/fort/").await.status;
        assert!(is_published || m.has_nothing() && status == StatusCode::NOT_FOUND, "step {allowed}: {why}");
        m.steps.store(u64::MAX, Ordering::Relaxed);
        assert_eq!(m.publish(&version).await.1.version, 1, "step {allowed}: with room it goes on");
    }
    assert!(full > 7, "{full} steps are too few");
}

#[tokio::test]
async fn uploads_are_limited_in_size_number_and_time() {
    let fort = Version::new("fort", 1, fort_pack());
    let bytes: u64 = fort.intent.files.iter().map(|f| f.bytes).sum();
    let limits = UploadLimits { version_bytes: 100_000, staged_bytes: bytes + 400, days: 3, per_minute: 5 };
    let m = Museum::with(limits);
    assert_eq!(m.begin(&m.robot, &fort.intent).await.status, StatusCode::CREATED);
    let first = &fort.intent.files[0];
    let cave = m.begin(&m.robot, &Version::new("cave", 1, fort_pack()).intent).await;
    assert_eq!(cave.status, StatusCode::INSUFFICIENT_STORAGE, "what is announced counts before it is sent");
    m.patch("fort", &first.sha256, 0, &fort.files[0][..500]).await;
    let other = Version::new("cave", 1, fort_pack());
    assert_eq!(m.begin(&m.robot, &other.intent).await.status, StatusCode::INSUFFICIENT_STORAGE);
    let mut large = Version::new("large", 1, vec![0; 200_000]);
    large.intent.metadata.slug = Some("large".to_owned());
    assert_eq!(m.begin(&m.robot, &large.intent).await.status, StatusCode::PAYLOAD_TOO_LARGE);
    m.begin(&m.robot, &fort.intent).await;
    let braked = m.begin(&m.robot, &fort.intent).await;
    assert_eq!(braked.status, StatusCode::TOO_MANY_REQUESTS);
    assert!(!braked.header("retry-after").is_empty());
    // After some days it lapses: the clock of the test is of another day than that of the files.
    let written = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_secs();
    m.clock.store(written + 2 * 86_400, Ordering::Relaxed);
    m.begin(&m.robot, &fort.intent).await;
    assert!(m.models().join(".kilwa-uploads/fort").join(&first.sha256).exists());
    m.clock.store(written + 4 * 86_400, Ordering::Relaxed);
    let file = m.folder.path().join("access.json");
    let token = Accounts::change(&file, |a| a.add_token("robot", Purpose::Publish, 3000, written)).unwrap();
    m.begin(&token, &Version::new("mosque", 1, fort_pack()).intent).await;
    assert!(!m.models().join(".kilwa-uploads/fort").exists());
}

#[tokio::test]
async fn announced_space_is_reserved_until_the_upload_is_abandoned() {
    let limits = UploadLimits { version_bytes: u64::MAX / 4, staged_bytes: u64::MAX / 2, ..UploadLimits::default() };
    let m = Museum::with(limits);
    let most_of_the_disk = fs4::available_space(m.models()).unwrap() / 10 * 6;
    let large = |slug: &str| {
        let mut version = Version::new(slug, 1, fort_pack());
        version.intent.files[0].bytes = most_of_the_disk;
        version
    };
    let at = |seconds: u64| m.clock.store(NOW + seconds, Ordering::Relaxed);
    assert_eq!(m.begin(&m.robot, &large("fort").intent).await.status, StatusCode::CREATED);
    at(600);
    let both = m.begin(&m.robot, &large("wall").intent).await;
    assert_eq!(both.status, StatusCode::INSUFFICIENT_STORAGE, "together they would fill the disk");
    assert!(both.text().contains("for other uploads"), "{}", both.text());
    assert_eq!(m.begin(&m.robot, &Version::new("tower", 1, fort_pack()).intent).await.status, StatusCode::CREATED);
    // Announcing it again does not count as sending.
    at(3000);
    assert_eq!(m.begin(&m.robot, &large("fort").intent).await.status, StatusCode::CREATED);
    at(2 * 3600);
    let alone = m.begin(&m.robot, &large("wall").intent).await;
    assert_eq!(alone.status, StatusCode::CREATED, "who announces and sends nothing keeps nobody out: {}", alone.text());
}

/// What is kept free while bytes come.
const KEPT_FREE: u64 = 64 << 20;

#[tokio::test]
async fn bytes_are_accepted_only_while_enough_disk_space_remains() {
    let m = Museum::new();
    for slug in ["fort", "wall"] {
        let version = Version::new(slug, 1, vec![1; 1_000_000]);
        let (name, bytes) = (&version.intent.files[0].sha256, &version.files[0]);
        m.free.store(u64::MAX, Ordering::Relaxed);
        assert_eq!(m.begin(&m.robot, &version.intent).await.status, StatusCode::CREATED);
        m.free.store(KEPT_FREE + 999_999, Ordering::Relaxed);
        let full = m.patch(slug, name, 0, bytes).await;
        assert_eq!(full.status, StatusCode::INSUFFICIENT_STORAGE, "{slug}");
        assert!(full.text().contains("this request may bring 1000000"), "{}", full.text());
        // Twice: what a request might have written is free again when it ends, however it ends.
        m.free.store(KEPT_FREE + 1_000_000, Ordering::Relaxed);
        let part = m.patch(slug, name, 0, &bytes[..10]).await;
        assert_eq!(part.status, StatusCode::NO_CONTENT, "{slug}: {}", part.text());
        let rest = m.patch(slug, name, 10, &bytes[10..]).await;
        assert_eq!(rest.status, StatusCode::NO_CONTENT, "{slug}: {}", rest.text());
    }
}

#[tokio::test]
async fn the_total_size_of_all_uploads_is_limited_including_old_ones() {
    let m = Museum::with(UploadLimits { staged_bytes: 1_500_000, ..UploadLimits::default() });
    let version = |slug: &str| Version::new(slug, 1, vec![1; 1_000_000]);
    let (fort, wall) = (version("fort"), version("wall"));
    let name = &fort.intent.files[0].sha256;
    assert_eq!(m.begin(&m.robot, &fort.intent).await.status, StatusCode::CREATED);
    m.clock.store(NOW + 2 * 3600, Ordering::Relaxed);
    assert_eq!(m.begin(&m.robot, &wall.intent).await.status, StatusCode::CREATED, "nothing followed in an hour");
    assert_eq!(m.patch("fort", name, 0, &fort.files[0]).await.status, StatusCode::NO_CONTENT);
    let both = m.patch("wall", name, 0, &wall.files[0]).await;
    assert_eq!(both.status, StatusCode::INSUFFICIENT_STORAGE);
    assert!(both.text().contains("take 1000000 bytes") && both.text().contains("1500000"), "{}", both.text());
    m.send(Method::DELETE, "/uploads/fort", &m.robot, &[], Vec::new()).await;
    assert_eq!(m.patch("wall", name, 0, &wall.files[0]).await.status, StatusCode::NO_CONTENT);
}
