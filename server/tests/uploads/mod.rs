//! Uploaded versions: published whole, verified and by authorised users, or not at all; and they contain nothing that a browser executes.

mod limits;
mod photographs;
mod unfinished;
mod withheld;

use crate::common::version::{METADATA, Version, fort_pack, status};
use crate::common::{Answer, ask, get, pack_in, page};
use crate::eventually::{eventually, eventually_async};
use axum::Router;
use axum::body::Body;
use axum::http::{Method, Request, StatusCode};
use kilwa_archive::{Manifest, Metadata};
use kilwa_server::access::{Accounts, Grant, Purpose};
use kilwa_server::auth::Auth;
use kilwa_server::upload::wire::{Intent, State, Status};
use kilwa_server::upload::{UploadLimits, Uploads};
use kilwa_server::{Catalogue, Clock, Site, app};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;
use tower::ServiceExt;

/// 2026-11-21T12:00:00Z.
const NOW: u64 = 1_795_262_400;

/// A site that takes uploads, with tokens of several kinds, a clock that can be set and a disk that can fail.
struct Museum {
    app: Router,
    clock: Arc<AtomicU64>,
    /// How many more steps the disk allows.
    steps: Arc<AtomicU64>,
    /// Whether verifying panics.
    falls: Arc<AtomicBool>,
    /// Whether verifying goes no further than its first step.
    waits: Arc<AtomicBool>,
    /// As much room as the disk seems to have at most, bytes.
    free: Arc<AtomicU64>,
    folder: tempfile::TempDir,
    robot: String,
    amina: String,
    viewer: String,
}

impl Museum {
    fn new() -> Self {
        Self::with(UploadLimits::default())
    }

    fn with(limits: UploadLimits) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let models = folder.path().join("models");
        std::fs::create_dir(&models).unwrap();
        let mut accounts = Accounts::new().unwrap();
        accounts.set_user("robot", &Grant::All, Some("a long sentence")).unwrap();
        accounts.set_user("amina", &Grant::Objects(vec!["cave".to_owned()]), None).unwrap();
        let robot = accounts.add_token("robot", Purpose::Publish, 30, NOW).unwrap();
        let viewer = accounts.add_token("robot", Purpose::View, 30, NOW).unwrap();
        let amina = accounts.add_token("amina", Purpose::Publish, 30, NOW).unwrap();
        let file = folder.path().join("access.json");
        accounts.create(&file).unwrap();
        let clock = Arc::new(AtomicU64::new(NOW));
        let mut site = Site::new(Catalogue::open(&models).unwrap(), page());
        let time = Arc::clone(&clock);
        site.clock = Clock::new(move || time.load(Ordering::Relaxed));
        let auth = Auth::open(&file, Some(&folder.path().join("audit.jsonl"))).unwrap();
        site.auth = Some(Arc::new(auth.with_freshness(Duration::ZERO)));
        let steps = Arc::new(AtomicU64::new(u64::MAX));
        let left = Arc::clone(&steps);
        let falls = Arc::new(AtomicBool::new(false));
        let fall = Arc::clone(&falls);
        let waits = Arc::new(AtomicBool::new(false));
        let wait = Arc::clone(&waits);
        let uploads = Uploads::new(models.canonicalize().unwrap(), page(), limits).with_steps(move |what| {
            let is_verifying = !matches!(what, "stage" | "receive");
            assert!(!is_verifying || !fall.load(Ordering::Relaxed), "a defect at {what}");
            eventually("leave to go on", || (!is_verifying || !wait.load(Ordering::Relaxed)).then_some(()));
            let take = |n: u64| n.checked_sub(1);
            match left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take) {
                Ok(_) => Ok(()),
                Err(_) => Err(io::Error::from(io::ErrorKind::StorageFull)),
            }
        });
        let free = Arc::new(AtomicU64::new(u64::MAX));
        let limit = Arc::clone(&free);
        let uploads = uploads.with_space(move |at| {
            let free = fs4::available_space(at).ok()?;
            Some(free.min(limit.load(Ordering::Relaxed)))
        });
        site.uploads = Some(Arc::new(uploads));
        Self { app: app(site), clock, steps, falls, waits, free, folder, robot, amina, viewer }
    }

    fn models(&self) -> PathBuf {
        self.folder.path().join("models")
    }

    async fn send(&self, method: Method, uri: &str, token: &str, more: &[(&str, &str)], body: Vec<u8>) -> Answer {
        let mut request = Request::builder().method(method).uri(uri).header("host", "museum.example");
        if !token.is_empty() {
            request = request.header("authorization", format!("Bearer {token}"));
        }
        for (name, value) in more {
            request = request.header(*name, *value);
        }
        Answer::of(self.app.clone().oneshot(request.body(Body::from(body)).unwrap()).await.unwrap()).await
    }

    async fn begin(&self, token: &str, intent: &Intent) -> Answer {
        self.send(Method::POST, "/uploads", token, &[], serde_json::to_vec(intent).unwrap()).await
    }

    async fn patch(&self, slug: &str, sha256: &str, offset: u64, bytes: &[u8]) -> Answer {
        self.patch_as(&self.robot, slug, sha256, offset, bytes).await
    }

    async fn patch_as(&self, token: &str, slug: &str, sha256: &str, offset: u64, bytes: &[u8]) -> Answer {
        let offset = offset.to_string();
        let headers = [
            ("tus-resumable", "1.0.0"),
            ("upload-offset", offset.as_str()),
            ("content-type", "application/offset+octet-stream"),
        ];
        let uri = format!("/uploads/{slug}/{sha256}");
        self.send(Method::PATCH, &uri, token, &headers, bytes.to_vec()).await
    }

    /// Send all files of a version and request its publication.
    async fn hand_in(&self, token: &str, version: &Version) -> Answer {
        let slug = &version.intent.slug;
        assert_eq!(self.begin(token, &version.intent).await.status, StatusCode::CREATED);
        for (file, bytes) in version.intent.files.iter().zip(&version.files) {
            let answer = self.patch_as(token, slug, &file.sha256, 0, bytes).await;
            assert_eq!(answer.status, StatusCode::NO_CONTENT, "{}", answer.text());
        }
        self.send(Method::POST, &format!("/uploads/{slug}"), token, &[], Vec::new()).await
    }

    /// Send everything that is missing and finish; the final status.
    async fn publish(&self, version: &Version) -> (StatusCode, Status) {
        let begun = self.begin(&self.robot, &version.intent).await;
        if begun.status != StatusCode::CREATED {
            return (begun.status, status(&begun));
        }
        for lack in status(&begun).lacks {
            let bytes = version.bytes(&lack.sha256);
            let answer =
                self.patch(&version.intent.slug, &lack.sha256, lack.offset, &bytes[lack.offset as usize..]).await;
            if answer.status != StatusCode::NO_CONTENT {
                return (answer.status, status(&answer));
            }
        }
        self.finish(&version.intent.slug).await
    }

    async fn finish(&self, slug: &str) -> (StatusCode, Status) {
        let uri = format!("/uploads/{slug}");
        let answer = self.send(Method::POST, &uri, &self.robot, &[], Vec::new()).await;
        let upload = status(&answer);
        if upload.state == State::Verifying { self.ended(slug).await } else { (answer.status, upload) }
    }

    /// How verifying ends.
    async fn ended(&self, slug: &str) -> (StatusCode, Status) {
        let uri = format!("/uploads/{slug}");
        eventually_async("the end of verifying", async || {
            let answer = self.send(Method::GET, &uri, &self.robot, &[], Vec::new()).await;
            let upload = status(&answer);
            (upload.state != State::Verifying).then_some((answer.status, upload))
        })
        .await
    }

    /// Nothing of the object is there, and nothing hidden but the folder of uploads.
    fn has_nothing(&self) -> bool {
        let names = std::fs::read_dir(self.models()).unwrap().map(|e| e.unwrap().file_name());
        names.into_iter().all(|n| n == ".kilwa-uploads")
    }
}

fn tree(folder: &Path) -> std::collections::BTreeMap<String, Vec<u8>> {
    let mut all = std::collections::BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            all.extend(tree(&path).into_iter().map(|(p, b)| (format!("{name}/{p}"), b)));
        } else {
            all.insert(name, std::fs::read(&path).unwrap());
        }
    }
    all
}

#[tokio::test]
async fn a_complete_upload_is_published_served_and_logged() {
    let m = Museum::new();
    let version = Version::new("fort", 1, fort_pack());
    let (code, status) = m.publish(&version).await;
    assert_eq!((code, status.state, status.version), (StatusCode::OK, State::Published, 1), "{status:?}");
    let manifest = Manifest::parse(&get(&m.app, "/fort/manifest.json").await.body).unwrap();
    assert_eq!((manifest.title.as_str(), manifest.versions.len()), ("Fort", 1));
    let served = get(&m.app, &format!("/fort/{}", manifest.versions[0].pack.url)).await;
    assert_eq!((served.status, &served.body[..]), (StatusCode::OK, &version.files[0][..]));
    let page = get(&m.app, "/fort/").await.text();
    assert!(page.contains("Fort") && page.contains("v1/viewer/"), "{page}");
    // The viewer is the server's own.
    assert_eq!(std::fs::read(m.models().join("fort/v1/viewer/boot.js")).unwrap(), b"export {};");
    let record = std::fs::read_to_string(m.folder.path().join("audit.jsonl")).unwrap();
    assert!(record.contains("\"published\",\"who\":\"robot\"") && record.contains("\"version\":1"), "{record}");
    assert!(!record.contains(&m.robot[6..]));
    // Again: it exists already. Changed: it is the next version.
    let before = tree(&m.models().join("fort"));
    let (code, status) = m.publish(&version).await;
    assert_eq!((code, status.state, status.already), (StatusCode::OK, State::Published, true));
    assert!(tree(&m.models().join("fort")) == before, "nothing was added");
    let mut second = Version::new("fort", 2, fort_pack());
    second.intent.metadata.description = Some("Better text".to_owned());
    let (code, status) = m.publish(&second).await;
    assert_eq!((code, status.version), (StatusCode::OK, 2), "{status:?}");
    let now = tree(&m.models().join("fort"));
    assert!(before.iter().filter(|(p, _)| p.starts_with("v1/")).all(|(p, b)| now[p] == *b), "version 1 is as it was");
    assert_eq!(std::fs::read_dir(m.models().join(".kilwa-uploads")).unwrap().count(), 0, "nothing is left of it");
}

#[tokio::test]
async fn publishing_needs_a_publishing_token_of_a_user_with_a_grant_for_the_object() {
    let m = Museum::new();
    let fort = Version::new("fort", 1, fort_pack()).intent;
    for (token, code) in [
        ("", StatusCode::UNAUTHORIZED),
        ("kilwa-0000", StatusCode::UNAUTHORIZED),
        (m.viewer.as_str(), StatusCode::FORBIDDEN),
        (m.amina.as_str(), StatusCode::FORBIDDEN),
        (m.robot.as_str(), StatusCode::CREATED),
    ] {
        let answer = m.begin(token, &fort).await;
        assert_eq!(answer.status, code, "{}", answer.text());
    }
    let cave = Version::new("cave", 1, fort_pack()).intent;
    assert_eq!(m.begin(&m.amina, &cave).await.status, StatusCode::CREATED, "granted, though it is not there yet");
    assert_eq!(m.begin(&m.robot, &cave).await.status, StatusCode::CONFLICT, "one upload of an object at a time");
    let uri = format!("/uploads/cave/{}", cave.files[0].sha256);
    assert_eq!(m.send(Method::HEAD, &uri, &m.robot, &[], Vec::new()).await.status, StatusCode::FORBIDDEN);
    // A session is not accepted here: what a browser sends automatically does not count.
    let form = "name=robot&password=a+long+sentence&next=%2F";
    let signed = m.send(Method::POST, "/sign-in", "", &[("origin", "http://museum.example")], form.into()).await;
    let cookie = signed.header("set-cookie").split(';').next().unwrap().to_owned();
    assert_eq!(signed.status, StatusCode::SEE_OTHER);
    let body = serde_json::to_vec(&fort).unwrap();
    let answer = m.send(Method::POST, "/uploads", "", &[("cookie", &cookie)], body).await;
    assert_eq!(answer.status, StatusCode::UNAUTHORIZED);
    // Guessing is slowed down, even for a correct guess.
    let mut last = StatusCode::OK;
    for i in 0..8 {
        last = m.begin(&format!("kilwa-{i:064x}"), &fort).await.status;
    }
    assert_eq!(last, StatusCode::TOO_MANY_REQUESTS);
    // Without uploads there are none.
    let site = Site::new(Catalogue::open(&m.models()).unwrap(), page());
    assert_eq!(ask(&app(site), "POST", "/uploads", &[]).await.status, StatusCode::NOT_IMPLEMENTED);
}

#[tokio::test]
async fn an_interrupted_file_resumes_only_where_it_stopped() {
    let m = Museum::new();
    let version = Version::new("fort", 1, fort_pack());
    let (pack, name) = (&version.files[0], &version.intent.files[0].sha256);
    let begun = status(&m.begin(&m.robot, &version.intent).await);
    assert_eq!((begun.state, begun.lacks.len(), begun.lacks[0].offset), (State::Sending, 6, 0));
    let first = m.patch("fort", name, 0, &pack[..100]).await;
    assert_eq!((first.status, first.header("upload-offset")), (StatusCode::NO_CONTENT, "100"));
    for offset in [0, 99, 101] {
        let answer = m.patch("fort", name, offset, b"x").await;
        assert_eq!((answer.status, answer.header("upload-offset")), (StatusCode::CONFLICT, "100"), "{offset}");
    }
    let uri = format!("/uploads/fort/{name}");
    let head = m.send(Method::HEAD, &uri, &m.robot, &[], Vec::new()).await;
    assert_eq!((head.header("upload-offset"), head.header("upload-length")), ("100", pack.len().to_string().as_str()));
    let again = status(&m.begin(&m.robot, &version.intent).await);
    assert_eq!(again.lacks[0].offset, 100);
    assert_eq!(m.finish("fort").await.1.state, State::Refused, "not whole");
    // Received parts of a file can be used by another version of the same object.
    let mut other = Version::new("fort", 1, fort_pack());
    other.intent.note = "With a better note".to_owned();
    assert_eq!(status(&m.begin(&m.robot, &other.intent).await).lacks[0].offset, 100);
    let plain = [("upload-offset", "100"), ("content-type", "application/offset+octet-stream")];
    assert_eq!(m.send(Method::PATCH, &uri, &m.robot, &plain, vec![1]).await.status, StatusCode::PRECONDITION_FAILED);
    // None of it can be downloaded.
    for address in [format!("/.kilwa-uploads/fort/{name}"), "/.kilwa-uploads/fort/upload.json".to_owned(), uri.clone()]
    {
        let answer = m.send(Method::GET, &address, &m.robot, &[], Vec::new()).await;
        assert!(matches!(answer.status, StatusCode::NOT_FOUND | StatusCode::METHOD_NOT_ALLOWED), "{address}");
    }
    // Nor is anything outside of the folder of uploads reached, or made.
    let outside = m.models().join("outside");
    std::fs::create_dir(&outside).unwrap();
    std::fs::write(outside.join("lock"), "precious").unwrap();
    let whole = outside.to_string_lossy().replace('/', "%2F");
    for slug in [whole.as_str(), "..%2Foutside", "%2E%2E%2Foutside", "..%2F.kilwa-uploads%2Ffort", ".%2Ffort", "viewer"]
    {
        let (of, file) = (format!("/uploads/{slug}"), format!("/uploads/{slug}/{name}"));
        for (method, uri) in [(Method::GET, &of), (Method::POST, &of), (Method::DELETE, &of), (Method::HEAD, &file)] {
            let answer = m.send(method.clone(), uri, &m.robot, &[], Vec::new()).await;
            assert_eq!(answer.status, StatusCode::NOT_FOUND, "{method} {uri}");
        }
        assert_eq!(m.patch(slug, name, 0, b"x").await.status, StatusCode::NOT_FOUND, "{slug}");
    }
    assert_eq!(std::fs::read(outside.join("lock")).unwrap(), b"precious");
    std::fs::remove_dir_all(&outside).unwrap();
    let given_up = m.send(Method::DELETE, "/uploads/fort", &m.robot, &[], Vec::new()).await;
    assert_eq!((given_up.status, m.has_nothing()), (StatusCode::NO_CONTENT, true));
}

#[tokio::test]
async fn an_invalid_announcement_is_refused_before_a_byte_is_sent() {
    let m = Museum::new();
    let change = |how: &dyn Fn(&mut Version)| {
        let mut version = Version::new("fort", 1, fort_pack());
        how(&mut version);
        version.intent
    };
    let file = |path: &'static str| move |v: &mut Version| v.add(path, b"<script>alert(1)</script>".to_vec());
    let cases: Vec<(&str, Intent, StatusCode, &str)> = vec![
        ("traversal", change(&file("../../etc/cron.d/x")), StatusCode::UNPROCESSABLE_ENTITY, "cannot be uploaded"),
        ("absolute", change(&file("/etc/passwd")), StatusCode::UNPROCESSABLE_ENTITY, "cannot be uploaded"),
        ("page", change(&file("index.html")), StatusCode::UNPROCESSABLE_ENTITY, "the server makes everything else"),
        (
            "script",
            change(&file("viewer/boot.js")),
            StatusCode::UNPROCESSABLE_ENTITY,
            "the server makes everything else",
        ),
        (
            "manifest",
            change(&file("manifest.json")),
            StatusCode::UNPROCESSABLE_ENTITY,
            "the server makes everything else",
        ),
        (
            "no pack",
            change(&|v| drop(v.intent.files.remove(0))),
            StatusCode::UNPROCESSABLE_ENTITY,
            "the pack is missing",
        ),
        (
            "no poster",
            change(&|v| drop(v.intent.files.remove(1))),
            StatusCode::UNPROCESSABLE_ENTITY,
            "poster.jpg is missing",
        ),
        (
            "twice",
            change(&|v| v.intent.files.push(v.intent.files[1].clone())),
            StatusCode::UNPROCESSABLE_ENTITY,
            "twice",
        ),
        (
            "no hash",
            change(&|v| v.intent.files[1].sha256 = "../x".to_owned()),
            StatusCode::UNPROCESSABLE_ENTITY,
            "SHA-256",
        ),
        ("too large", change(&|v| v.intent.files[1].bytes = 1 << 40), StatusCode::PAYLOAD_TOO_LARGE, "are allowed"),
        ("reserved", change(&|v| v.intent.slug = "viewer".to_owned()), StatusCode::UNPROCESSABLE_ENTITY, "slug"),
        ("hidden", change(&|v| v.intent.slug = ".kilwa-x".to_owned()), StatusCode::UNPROCESSABLE_ENTITY, "slug"),
        (
            "another slug announced",
            change(&|v| v.intent.slug = "cave".to_owned()),
            StatusCode::UNPROCESSABLE_ENTITY,
            "announced for \\\"cave\\\", but the slug in its metadata is \\\"fort\\\"",
        ),
        (
            "another slug in the metadata",
            change(&|v| v.intent.metadata.slug = Some("cave".to_owned())),
            StatusCode::UNPROCESSABLE_ENTITY,
            "announced for \\\"fort\\\", but the slug in its metadata is \\\"cave\\\"",
        ),
        ("version", change(&|v| v.intent.version = 2), StatusCode::CONFLICT, "has no version yet"),
        (
            "future",
            change(&|v| v.intent.published = "2027-01-01".to_owned()),
            StatusCode::UNPROCESSABLE_ENTITY,
            "clock",
        ),
        (
            "a link that runs",
            change(&|v| v.intent.metadata.rights.uri = "javascript:alert(1)".to_owned()),
            StatusCode::UNPROCESSABLE_ENTITY,
            "rights.uri",
        ),
        (
            "an address that runs",
            change(&|v| v.intent.metadata.url = Some("javascript:alert(1)".to_owned())),
            StatusCode::UNPROCESSABLE_ENTITY,
            "url",
        ),
        (
            "words of a drawing",
            change(&|v| v.intent.drawings[0].words = "<img src=x onerror=alert(1)>".to_owned()),
            StatusCode::UNPROCESSABLE_ENTITY,
            "drawings",
        ),
    ];
    for (what, intent, code, expected) in cases {
        let answer = m.begin(&m.robot, &intent).await;
        assert!(
            answer.status == code && answer.text().contains(expected),
            "{what}: {} {}",
            answer.status,
            answer.text()
        );
    }
    assert!(m.has_nothing());
    let answer = m.send(Method::POST, "/uploads", &m.robot, &[], b"{\"kilwa_upload\":1}".to_vec()).await;
    assert_eq!(answer.status, StatusCode::UNPROCESSABLE_ENTITY);
    let named_by_its_title = change(&|v| v.intent.metadata.slug = None);
    assert_eq!(m.begin(&m.robot, &named_by_its_title).await.status, StatusCode::CREATED);
}

#[tokio::test]
async fn files_that_differ_from_the_announcement_are_never_published() {
    let m = Museum::new();
    let version = Version::new("fort", 1, fort_pack());
    let poster = &version.intent.files[1];
    m.begin(&m.robot, &version.intent).await;
    let wrong = vec![7; poster.bytes as usize];
    assert_eq!(m.patch("fort", &poster.sha256, 0, &wrong).await.status.as_u16(), 460, "tus: checksum mismatch");
    let long = vec![7; poster.bytes as usize + 1];
    assert_eq!(m.patch("fort", &poster.sha256, 0, &long).await.status, StatusCode::BAD_REQUEST);
    assert_eq!(m.patch("fort", &"0".repeat(64), 0, b"x").await.status, StatusCode::NOT_FOUND, "not announced");
    assert_eq!(m.patch("fort", "..%2Fupload.json", 0, b"x").await.status, StatusCode::NOT_FOUND);
    // A damaged pack with a correct SHA-256 in the announcement.
    let mut bytes = fort_pack();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    let (code, status) = m.publish(&Version::new("fort", 1, bytes)).await;
    assert_eq!(code, StatusCode::UNPROCESSABLE_ENTITY);
    assert!(status.error.as_deref().is_some_and(|e| e.contains("damaged")), "{status:?}");
    // A page that is called a picture.
    let mut page = Version::new("fort", 1, fort_pack());
    page.intent.files.remove(1);
    page.files.remove(1);
    page.add("poster.jpg", b"<!doctype html><script>alert(1)</script>".to_vec());
    let (code, status) = m.publish(&page).await;
    assert_eq!(code, StatusCode::UNPROCESSABLE_ENTITY);
    assert!(status.error.as_deref().is_some_and(|e| e.contains("not a picture")), "{status:?}");
    // Metadata of another model.
    let mut other = Version::new("fort", 1, fort_pack());
    other.intent.metadata.model.units = "mm".to_owned();
    let (code, status) = m.publish(&other).await;
    assert!(code == StatusCode::UNPROCESSABLE_ENTITY && status.error.is_some_and(|e| e.contains("units")));
    assert!(m.has_nothing() && get(&m.app, "/fort/").await.status == StatusCode::NOT_FOUND);
}

#[cfg(unix)]
#[tokio::test]
async fn a_link_in_the_folder_of_an_upload_leads_nowhere() {
    let m = Museum::new();
    let version = Version::new("fort", 1, fort_pack());
    m.begin(&m.robot, &version.intent).await;
    let victim = m.folder.path().join("victim");
    std::fs::write(&victim, "precious").unwrap();
    let poster = &version.intent.files[1];
    std::os::unix::fs::symlink(&victim, m.models().join(".kilwa-uploads/fort").join(&poster.sha256)).unwrap();
    assert_eq!(m.publish(&version).await.1.state, State::Published);
    assert_eq!(std::fs::read(&victim).unwrap(), b"precious");
    assert!(!std::fs::symlink_metadata(m.models().join("fort/v1/poster.jpg")).unwrap().is_symlink());
}

#[tokio::test]
async fn a_model_that_appears_to_be_a_different_one_is_refused_as_a_version() {
    let m = Museum::new();
    assert_eq!(m.publish(&Version::new("fort", 1, fort_pack())).await.1.version, 1);
    let mut mosque = Version::new("fort", 2, pack_in("mosque", None));
    mosque.intent.metadata.title = "A mosque".to_owned();
    let (code, status) = m.publish(&mosque).await;
    assert!(code == StatusCode::CONFLICT && status.error.is_some_and(|e| e.contains("--same-object")), "{code}");
    mosque.intent.same_object = true;
    assert_eq!(m.publish(&mosque).await.1.version, 2);
    // Another publisher was faster.
    let late = Version::new("fort", 2, fort_pack());
    assert_eq!(m.publish(&late).await.0, StatusCode::CONFLICT);
}

#[tokio::test]
async fn an_upload_never_makes_a_closed_model_public() {
    let closed = |number: u32, access: &str| {
        let mut version = Version::new("fort", number, fort_pack());
        version.intent.metadata = Metadata::parse(&format!("{METADATA}{access}")).unwrap();
        version.intent.metadata.description = Some(format!("Version {number}"));
        version
    };
    let embargo = |day: &str| format!("[access]\nstate = \"embargo\"\nuntil = {day}\n");
    let (restricted, public) = ("[access]\nstate = \"restricted\"\n", "");
    let (early, late) = (embargo("2026-12-01"), embargo("2026-12-10"));
    // The access of the object, what is refused then, and what is accepted.
    let cases: [(&str, &[&str], &str); 3] =
        [(restricted, &[public, &late], restricted), (&late, &[public, &early], restricted), (public, &[], &early)];
    for (is, refused, taken) in cases {
        let m = Museum::new();
        assert_eq!(m.publish(&closed(1, is)).await.1.version, 1, "{is}");
        for open in refused {
            let (code, status) = m.publish(&closed(2, open)).await;
            let why = status.error.unwrap_or_default();
            assert!(code == StatusCode::CONFLICT && why.contains("--open-access"), "{is} {open}: {code} {why}");
        }
        assert_eq!(m.publish(&closed(2, taken)).await.1.version, 2, "{is} {taken}");
    }
    // An embargo that has ended keeps nothing closed.
    let m = Museum::new();
    assert_eq!(m.publish(&closed(1, &early)).await.1.version, 1);
    m.clock.store(NOW + 10 * 86_400, Ordering::Relaxed);
    assert_eq!(m.publish(&closed(2, public)).await.1.version, 2);
}

#[tokio::test]
async fn a_crash_during_verification_ends_the_upload_which_can_be_resumed_or_abandoned() {
    let (m, version) = (Museum::new(), Version::new("fort", 1, fort_pack()));
    m.falls.store(true, Ordering::Relaxed);
    let (code, status) = m.publish(&version).await;
    assert_eq!((code, status.state), (StatusCode::SERVICE_UNAVAILABLE, State::Refused), "{status:?}");
    let given_up = m.send(Method::DELETE, "/uploads/fort", &m.robot, &[], Vec::new()).await;
    assert_eq!(given_up.status, StatusCode::NO_CONTENT);
    let after = m.send(Method::GET, "/uploads/fort", &m.robot, &[], Vec::new()).await;
    assert_eq!(after.status, StatusCode::NOT_FOUND, "it is given up");
    assert_eq!(m.publish(&version).await.1.state, State::Refused);
    m.falls.store(false, Ordering::Relaxed);
    assert_eq!(m.publish(&version).await.1.state, State::Published);
}

#[cfg(unix)]
#[tokio::test]
async fn a_file_hard_linked_into_a_version_is_not_appended_to() {
    let (m, version) = (Museum::new(), Version::new("fort", 1, fort_pack()));
    let (pack, name) = (&version.files[0], &version.intent.files[0].sha256);
    m.begin(&m.robot, &version.intent).await;
    m.patch("fort", name, 0, &pack[..100]).await;
    let published = m.folder.path().join("published");
    std::fs::hard_link(m.models().join(".kilwa-uploads/fort").join(name), &published).unwrap();
    let answer = m.patch("fort", name, 100, &pack[100..]).await;
    assert_eq!((answer.status, answer.header("upload-offset")), (StatusCode::CONFLICT, "0"));
    assert_eq!(m.publish(&version).await.1.state, State::Published);
    assert_eq!(std::fs::read(&published).unwrap(), &pack[..100]);
}

#[tokio::test]
async fn uploads_are_checked_to_the_last_byte_during_other_publications() {
    let m = Museum::new();
    let other = kilwa_archive::lock::Lock::take(&m.models()).unwrap();
    let mut bytes = fort_pack();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    let (code, upload) = m.publish(&Version::new("fort", 1, bytes)).await;
    assert_eq!(code, StatusCode::UNPROCESSABLE_ENTITY, "{upload:?}");
    assert_eq!(m.hand_in(&m.robot, &Version::new("fort", 1, fort_pack())).await.status, StatusCode::ACCEPTED);
    eventually_async("nothing left to be read while the folder is locked", async || {
        let upload = status(&m.send(Method::GET, "/uploads/fort", &m.robot, &[], Vec::new()).await);
        assert_eq!(upload.state, State::Verifying, "the folder is somebody else's: {upload:?}");
        (upload.done == upload.of).then_some(())
    })
    .await;
    drop(other);
    assert_eq!(m.ended("fort").await.1.version, 1);
}

#[tokio::test]
async fn a_publisher_of_many_versions_lets_others_in_between() {
    let m = Museum::new();
    m.waits.store(true, Ordering::Relaxed);
    for slug in ["fort", "wall", "tower"] {
        assert_eq!(m.hand_in(&m.robot, &Version::new(slug, 1, fort_pack())).await.status, StatusCode::ACCEPTED);
    }
    assert_eq!(m.hand_in(&m.amina, &Version::new("cave", 1, fort_pack())).await.status, StatusCode::ACCEPTED);
    m.waits.store(false, Ordering::Relaxed);
    for slug in ["wall", "tower"] {
        assert_eq!(m.ended(slug).await.1.version, 1, "{slug}");
    }
    let record = std::fs::read_to_string(m.folder.path().join("audit.jsonl")).unwrap();
    let when = |slug: &str| record.lines().position(|l| l.contains("\"published\"") && l.contains(slug)).unwrap();
    assert!(when("fort") < when("cave") && when("cave") < when("wall") && when("wall") < when("tower"), "{record}");
}

#[tokio::test]
async fn an_announcement_with_a_duplicate_key_is_refused() {
    let m = Museum::new();
    let version = Version::new("fort", 1, fort_pack());
    let json = serde_json::to_string(&version.intent).unwrap();
    for twice in [
        json.replacen('{', "{\"slug\":\"cave\",", 1),
        json.replacen("\"metadata\":{", "\"metadata\":{\"title\":\"Other\",", 1),
    ] {
        let answer = m.send(Method::POST, "/uploads", &m.robot, &[], twice.into_bytes()).await;
        assert_eq!(answer.status, StatusCode::UNPROCESSABLE_ENTITY);
        assert!(answer.text().contains("duplicate"), "{}", answer.text());
    }
    assert!(m.has_nothing());
}
