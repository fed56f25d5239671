//! Versions that are published from elsewhere: whole, verified, by whoever may, or not at all; and nothing that a browser runs comes from them.

mod common;

use axum::Router;
use axum::body::Body;
use axum::http::{Method, Request, StatusCode};
use common::version::{METADATA, Version, fort_pack, status};
use common::{Answer, ask, get, pack_at, pack_in, page};
use kilwa_server::access::{Accounts, Grant, Purpose};
use kilwa_server::door::Door;
use kilwa_server::object::{Manifest, Metadata};
use kilwa_server::upload::wire::{Intent, State, Status};
use kilwa_server::upload::{UploadLimits, Uploads};
use kilwa_server::{Catalogue, Clock, Site, app};
use serde_json::{Value, json};
use std::io::{self, Write as _};
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
    /// Whether verifying comes to a defect of the program.
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
        let told = Arc::clone(&clock);
        site.clock = Clock::new(move || told.load(Ordering::Relaxed));
        site.door = Some(Arc::new(Door::open(&file, Some(&folder.path().join("audit.jsonl"))).unwrap()));
        let steps = Arc::new(AtomicU64::new(u64::MAX));
        let left = Arc::clone(&steps);
        let falls = Arc::new(AtomicBool::new(false));
        let fall = Arc::clone(&falls);
        let waits = Arc::new(AtomicBool::new(false));
        let wait = Arc::clone(&waits);
        let uploads = Uploads::new(models.canonicalize().unwrap(), page(), limits).with_steps(move |what| {
            let is_verifying = !matches!(what, "stage" | "receive");
            assert!(!is_verifying || !fall.load(Ordering::Relaxed), "a defect at {what}");
            while is_verifying && wait.load(Ordering::Relaxed) {
                std::thread::sleep(Duration::from_millis(2));
            }
            let take = |n: u64| n.checked_sub(1);
            match left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, take) {
                Ok(_) => Ok(()),
                Err(_) => Err(io::Error::from(io::ErrorKind::StorageFull)),
            }
        });
        let free = Arc::new(AtomicU64::new(u64::MAX));
        let most = Arc::clone(&free);
        let uploads = uploads.with_space(move |at| {
            let free = fs4::available_space(at).ok()?;
            Some(free.min(most.load(Ordering::Relaxed)))
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

    /// Everything of a version, and that it be published.
    async fn hand_in(&self, token: &str, version: &Version) -> Answer {
        let slug = &version.intent.slug;
        assert_eq!(self.begin(token, &version.intent).await.status, StatusCode::CREATED);
        for (said, bytes) in version.intent.files.iter().zip(&version.files) {
            let answer = self.patch_as(token, slug, &said.sha256, 0, bytes).await;
            assert_eq!(answer.status, StatusCode::NO_CONTENT, "{}", answer.text());
        }
        self.send(Method::POST, &format!("/uploads/{slug}"), token, &[], Vec::new()).await
    }

    /// Everything that is lacking, then the end; how it ended.
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
        let said = status(&answer);
        if said.state == State::Verifying { self.ended(slug).await } else { (answer.status, said) }
    }

    /// How verifying ends.
    async fn ended(&self, slug: &str) -> (StatusCode, Status) {
        for _ in 0..3000 {
            let answer = self.send(Method::GET, &format!("/uploads/{slug}"), &self.robot, &[], Vec::new()).await;
            let said = status(&answer);
            if said.state != State::Verifying {
                return (answer.status, said);
            }
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        panic!("it is verified for ever");
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
async fn what_is_sent_whole_is_published_served_and_written_down() {
    let m = Museum::new();
    let version = Version::new("fort", 1, fort_pack());
    let (code, said) = m.publish(&version).await;
    assert_eq!((code, said.state, said.version), (StatusCode::OK, State::Published, 1), "{said:?}");
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
    // Again: there already. Changed: the next version, after the first.
    let before = tree(&m.models().join("fort"));
    let (code, said) = m.publish(&version).await;
    assert_eq!((code, said.state, said.already), (StatusCode::OK, State::Published, true));
    assert!(tree(&m.models().join("fort")) == before, "nothing was added");
    let mut second = Version::new("fort", 2, fort_pack());
    second.intent.metadata.description = Some("Better text".to_owned());
    let (code, said) = m.publish(&second).await;
    assert_eq!((code, said.version), (StatusCode::OK, 2), "{said:?}");
    let now = tree(&m.models().join("fort"));
    assert!(before.iter().filter(|(p, _)| p.starts_with("v1/")).all(|(p, b)| now[p] == *b), "version 1 is as it was");
    assert_eq!(std::fs::read_dir(m.models().join(".kilwa-uploads")).unwrap().count(), 0, "nothing is left of it");
}

#[tokio::test]
async fn only_a_token_for_publishing_of_somebody_who_was_granted_the_object_publishes() {
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
    // A session opens nothing here: what a browser sends by itself does not count.
    let form = "name=robot&password=a+long+sentence&next=%2F";
    let signed = m.send(Method::POST, "/sign-in", "", &[("origin", "http://museum.example")], form.into()).await;
    let cookie = signed.header("set-cookie").split(';').next().unwrap().to_owned();
    assert_eq!(signed.status, StatusCode::SEE_OTHER);
    let body = serde_json::to_vec(&fort).unwrap();
    let answer = m.send(Method::POST, "/uploads", "", &[("cookie", &cookie)], body).await;
    assert_eq!(answer.status, StatusCode::UNAUTHORIZED);
    // Guessing has to wait, and so does whoever guesses when right.
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
async fn a_file_is_gone_on_with_where_it_broke_off_and_nowhere_else() {
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
    // What is there of a file serves another version of the same object too.
    let mut other = Version::new("fort", 1, fort_pack());
    other.intent.note = "With a better note".to_owned();
    assert_eq!(status(&m.begin(&m.robot, &other.intent).await).lacks[0].offset, 100);
    let plain = [("upload-offset", "100"), ("content-type", "application/offset+octet-stream")];
    assert_eq!(m.send(Method::PATCH, &uri, &m.robot, &plain, vec![1]).await.status, StatusCode::PRECONDITION_FAILED);
    // Nothing of it can be had.
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
async fn what_cannot_be_is_refused_before_a_byte_is_sent() {
    let m = Museum::new();
    let change = |how: &dyn Fn(&mut Version)| {
        let mut version = Version::new("fort", 1, fort_pack());
        how(&mut version);
        version.intent
    };
    let file = |path: &'static str| move |v: &mut Version| v.add(path, b"<script>alert(1)</script>".to_vec());
    let cases: Vec<(&str, Intent, StatusCode, &str)> = vec![
        (
            "traversal",
            change(&file("../../etc/cron.d/x")),
            StatusCode::UNPROCESSABLE_ENTITY,
            "no file that can be uploaded",
        ),
        ("absolute", change(&file("/etc/passwd")), StatusCode::UNPROCESSABLE_ENTITY, "no file that can be uploaded"),
        ("page", change(&file("index.html")), StatusCode::UNPROCESSABLE_ENTITY, "made by the server"),
        ("script", change(&file("viewer/boot.js")), StatusCode::UNPROCESSABLE_ENTITY, "made by the server"),
        ("manifest", change(&file("manifest.json")), StatusCode::UNPROCESSABLE_ENTITY, "made by the server"),
        ("no pack", change(&|v| drop(v.intent.files.remove(0))), StatusCode::UNPROCESSABLE_ENTITY, "there is no pack"),
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
        ("too large", change(&|v| v.intent.files[1].bytes = 1 << 40), StatusCode::PAYLOAD_TOO_LARGE, "are possible"),
        ("reserved", change(&|v| v.intent.slug = "viewer".to_owned()), StatusCode::UNPROCESSABLE_ENTITY, "slug"),
        ("hidden", change(&|v| v.intent.slug = ".kilwa-x".to_owned()), StatusCode::UNPROCESSABLE_ENTITY, "slug"),
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
    for (what, intent, code, said) in cases {
        let answer = m.begin(&m.robot, &intent).await;
        assert!(answer.status == code && answer.text().contains(said), "{what}: {} {}", answer.status, answer.text());
    }
    assert!(m.has_nothing());
    let answer = m.send(Method::POST, "/uploads", &m.robot, &[], b"{\"kilwa_upload\":1}".to_vec()).await;
    assert_eq!(answer.status, StatusCode::UNPROCESSABLE_ENTITY);
}

#[tokio::test]
async fn what_arrives_otherwise_than_it_was_said_is_never_published() {
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
    // A pack that is damaged, and says so of itself with the right SHA-256.
    let mut bytes = fort_pack();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    let (code, said) = m.publish(&Version::new("fort", 1, bytes)).await;
    assert_eq!(code, StatusCode::UNPROCESSABLE_ENTITY);
    assert!(said.error.as_deref().is_some_and(|e| e.contains("damaged")), "{said:?}");
    // A page that is called a picture.
    let mut page = Version::new("fort", 1, fort_pack());
    page.intent.files.remove(1);
    page.files.remove(1);
    page.add("poster.jpg", b"<!doctype html><script>alert(1)</script>".to_vec());
    let (code, said) = m.publish(&page).await;
    assert_eq!(code, StatusCode::UNPROCESSABLE_ENTITY);
    assert!(said.error.as_deref().is_some_and(|e| e.contains("no picture")), "{said:?}");
    // Metadata of another model.
    let mut other = Version::new("fort", 1, fort_pack());
    other.intent.metadata.model.units = "mm".to_owned();
    let (code, said) = m.publish(&other).await;
    assert!(code == StatusCode::UNPROCESSABLE_ENTITY && said.error.is_some_and(|e| e.contains("units")));
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
async fn a_model_that_seems_to_be_another_is_no_version_of_this_one() {
    let m = Museum::new();
    assert_eq!(m.publish(&Version::new("fort", 1, fort_pack())).await.1.version, 1);
    let mut mosque = Version::new("fort", 2, pack_in("mosque", None));
    mosque.intent.metadata.title = "A mosque".to_owned();
    let (code, said) = m.publish(&mosque).await;
    assert!(code == StatusCode::CONFLICT && said.error.is_some_and(|e| e.contains("--same-object")), "{code}");
    mosque.intent.same_object = true;
    assert_eq!(m.publish(&mosque).await.1.version, 2);
    // Somebody else was quicker.
    let late = Version::new("fort", 2, fort_pack());
    assert_eq!(m.publish(&late).await.0, StatusCode::CONFLICT);
}

#[tokio::test]
async fn a_disk_that_is_full_at_any_step_publishes_nothing_keeps_what_came_and_goes_on_when_there_is_room() {
    let version = Version::new("fort", 1, fort_pack());
    let mut full = 0;
    for allowed in (0..).step_by(3) {
        let m = Museum::new();
        m.steps.store(allowed, Ordering::Relaxed);
        let (code, said) = m.publish(&version).await;
        if said.state == State::Published {
            break;
        }
        full += 1;
        assert_eq!(code, StatusCode::INSUFFICIENT_STORAGE, "step {allowed}: {said:?}");
        let why = said.error.unwrap_or_default();
        assert!(why.contains("no room") && why.contains("run the same command again"), "{why}");
        assert!(m.has_nothing() && get(&m.app, "/fort/").await.status == StatusCode::NOT_FOUND, "step {allowed}");
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
    std::thread::sleep(Duration::from_millis(1100));
    m.begin(&token, &Version::new("mosque", 1, fort_pack()).intent).await;
    assert!(!m.models().join(".kilwa-uploads/fort").exists());
}

#[tokio::test]
async fn an_upload_never_opens_what_is_closed() {
    let closed = |number: u32, access: &str| {
        let mut version = Version::new("fort", number, fort_pack());
        version.intent.metadata = Metadata::parse(&format!("{METADATA}{access}")).unwrap();
        version.intent.metadata.description = Some(format!("Version {number}"));
        version
    };
    let embargo = |day: &str| format!("[access]\nstate = \"embargo\"\nuntil = {day}\n");
    let (restricted, public) = ("[access]\nstate = \"restricted\"\n", "");
    let (early, late) = (embargo("2026-12-01"), embargo("2026-12-10"));
    // What it is, what is refused then, what is not.
    let cases: [(&str, &[&str], &str); 3] =
        [(restricted, &[public, &late], restricted), (&late, &[public, &early], restricted), (public, &[], &early)];
    for (is, refused, taken) in cases {
        let m = Museum::new();
        assert_eq!(m.publish(&closed(1, is)).await.1.version, 1, "{is}");
        for open in refused {
            let (code, said) = m.publish(&closed(2, open)).await;
            let why = said.error.unwrap_or_default();
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
async fn a_defect_while_it_is_verified_ends_the_upload_and_it_can_be_gone_on_with_or_given_up() {
    let (m, version) = (Museum::new(), Version::new("fort", 1, fort_pack()));
    m.falls.store(true, Ordering::Relaxed);
    let (code, said) = m.publish(&version).await;
    assert_eq!((code, said.state), (StatusCode::SERVICE_UNAVAILABLE, State::Refused), "{said:?}");
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
async fn what_has_a_name_in_a_version_too_is_not_appended_to() {
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
async fn what_was_sent_is_checked_to_its_last_byte_while_somebody_else_publishes_to_the_folder() {
    let m = Museum::new();
    let other = kilwa_server::object::lock::Lock::take(&m.models()).unwrap();
    let mut bytes = fort_pack();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    let (code, said) = m.publish(&Version::new("fort", 1, bytes)).await;
    assert_eq!(code, StatusCode::UNPROCESSABLE_ENTITY, "{said:?}");
    assert_eq!(m.hand_in(&m.robot, &Version::new("fort", 1, fort_pack())).await.status, StatusCode::ACCEPTED);
    let mut checked = false;
    for _ in 0..2000 {
        let said = status(&m.send(Method::GET, "/uploads/fort", &m.robot, &[], Vec::new()).await);
        assert_eq!(said.state, State::Verifying, "the folder is somebody else's: {said:?}");
        checked = said.done == said.of;
        if checked {
            break;
        }
        tokio::time::sleep(Duration::from_millis(5)).await;
    }
    assert!(checked, "nothing is left to be read when the folder is locked");
    drop(other);
    assert_eq!(m.ended("fort").await.1.version, 1);
}

#[tokio::test]
async fn who_publishes_many_versions_lets_others_go_between_them() {
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
async fn room_that_was_announced_is_no_longer_free_until_nothing_follows() {
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
    // Announcing it again is not sending it.
    at(3000);
    assert_eq!(m.begin(&m.robot, &large("fort").intent).await.status, StatusCode::CREATED);
    at(2 * 3600);
    let alone = m.begin(&m.robot, &large("wall").intent).await;
    assert_eq!(alone.status, StatusCode::CREATED, "who announces and sends nothing keeps nobody out: {}", alone.text());
}

/// What is kept free while bytes come.
const KEPT_FREE: u64 = 64 << 20;

#[tokio::test]
async fn bytes_are_taken_only_where_they_leave_room() {
    let m = Museum::new();
    for slug in ["fort", "wall"] {
        let version = Version::new(slug, 1, vec![1; 1_000_000]);
        let (name, bytes) = (&version.intent.files[0].sha256, &version.files[0]);
        m.free.store(u64::MAX, Ordering::Relaxed);
        assert_eq!(m.begin(&m.robot, &version.intent).await.status, StatusCode::CREATED);
        m.free.store(KEPT_FREE + 999_999, Ordering::Relaxed);
        let full = m.patch(slug, name, 0, bytes).await;
        assert_eq!(full.status, StatusCode::INSUFFICIENT_STORAGE, "{slug}");
        assert!(full.text().contains("1000000 may come now"), "{}", full.text());
        // Twice: what a request might have written is free again when it ends, however it ends.
        m.free.store(KEPT_FREE + 1_000_000, Ordering::Relaxed);
        let part = m.patch(slug, name, 0, &bytes[..10]).await;
        assert_eq!(part.status, StatusCode::NO_CONTENT, "{slug}: {}", part.text());
        let rest = m.patch(slug, name, 10, &bytes[10..]).await;
        assert_eq!(rest.status, StatusCode::NO_CONTENT, "{slug}: {}", rest.text());
    }
}

#[tokio::test]
async fn what_all_uploads_hold_is_limited_also_where_it_was_announced_long_ago() {
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
    assert!(both.text().contains("hold 1000000 bytes") && both.text().contains("1500000"), "{}", both.text());
    m.send(Method::DELETE, "/uploads/fort", &m.robot, &[], Vec::new()).await;
    assert_eq!(m.patch("wall", name, 0, &wall.files[0]).await.status, StatusCode::NO_CONTENT);
}

/// A version that is said to be without its location, with the pictures that `kilwa publish` makes.
fn withheld(pack: Vec<u8>) -> Version {
    let mut version = Version::new("fort", 1, pack);
    version.intent.location_redacted = true;
    let posters = [("poster.jpg", [1200, 630]), ("poster-600.jpg", [600, 315]), ("poster-300.jpg", [300, 158])];
    let png = png(&[(b"pHYs", RESOLUTION), (b"IDAT", &zipped(&[0; 14]))]);
    let others = [("drawings/plan.png", png), ("preview.glb", preview(&json!({}), &[]))];
    for (path, bytes) in posters.map(|(p, size)| (p, jpeg(size, &[]))).into_iter().chain(others) {
        replace(&mut version, path, bytes);
    }
    version
}

/// A grey poster as `kilwa publish` writes it, with something before its end.
fn jpeg([width, height]: [u32; 2], more: &[u8]) -> Vec<u8> {
    let mut bytes = include_bytes!("../src/upload/poster-head.bin").to_vec();
    bytes[25..29].copy_from_slice(&(height << 16 | width).to_be_bytes());
    // Three blocks of nothing in 14 bits.
    let units = width.div_ceil(8) * height.div_ceil(8);
    let bits: Vec<u8> = (0..units).flat_map(|_| [0, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0]).collect();
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

fn replace(version: &mut Version, path: &str, bytes: Vec<u8>) {
    version.files.remove(version.intent.files.iter().position(|f| f.path == path).unwrap());
    version.intent.files.retain(|f| f.path != path);
    version.add(path, bytes);
}

/// Where `kilwa publish --redact-location` puts the pack of the tests: its middle at zero.
const MIDDLE: [f64; 3] = [-500.0 / 1024.0, -400.0 / 1024.0, 0.0];

#[tokio::test]
async fn a_location_that_is_said_to_be_withheld_is_looked_for() {
    let m = Museum::new();
    let at = |x: f64, y: f64, z: f64| [MIDDLE[0] + x, MIDDLE[1] + y, z];
    let true_place = at(565_977.0, 9_009_946.0, 31.0);
    let pack = |origin, channels: &[(&str, [f32; 3])]| pack_at("Fort", None, origin, channels);
    let with = |change: &dyn Fn(&mut Version)| {
        let mut version = withheld(pack(MIDDLE, &[]));
        change(&mut version);
        version
    };
    let kept = |name: &str, values: [f32; 3]| {
        let mut version = withheld(pack(MIDDLE, &[(name, values)]));
        version.intent.kept_channels = vec![name.to_owned()];
        version
    };
    let file = |path: &str, bytes: Vec<u8>| with(&|v| replace(v, path, bytes.clone()));
    let poster = |path: &str, change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = jpeg([1200, 630], b"");
        change(&mut bytes);
        file(path, bytes)
    };
    let told = |key: &str, value: Value| file("preview.glb", preview(&json!({ key: value }), b""));
    let here = b"-8.956109 39.600225 EPSG:32737 565977 9009946";
    let segment = |marker: u8| [&[0xff, marker, 0, here.len() as u8 + 2], &here[..]].concat();
    let pixels = zipped(&[0; 14]);
    let mut table: Vec<(Version, &str)> = vec![
        (withheld(pack(true_place, &[])), "the middle of its pack is at 565977.000 9009946.000, on height 31.000"),
        (withheld(pack(at(3.0, 0.0, 0.0), &[])), "and not at 0 0"),
        (withheld(pack(at(0.0, 0.0, 31.0), &[])), "on height 31.000"),
        (withheld(pack_at("Fort", Some("EPSG:32737"), MIDDLE, &[])), "its pack names a reference system"),
        (
            withheld(pack_at("Fort 8°57'27\" S 39°31'22\" E", None, MIDDLE, &[])),
            "title of its pack: \"8°57'27\" S 39°31'22\"\" states coordinates",
        ),
        (withheld(pack(MIDDLE, &[("intensity", [1.0, 2.0, 0.5])])), "\"intensity\", which was not announced as kept"),
        (kept("scalar_X", [565_977.0, 565_978.0, 565_977.0]), "\"scalar_X\" holds a coordinate or a height"),
        (
            with(&|v| v.intent.metadata.description = Some("At S 8.9577 E 39.5228".to_owned())),
            "metadata: description: \"8.9577",
        ),
        (
            with(&|v| v.intent.metadata.rights.holder = Some("geo:-8.95,39.52".to_owned())),
            "metadata: rights.holder: \"geo:",
        ),
        (
            with(&|v| v.intent.note = "See https://www.openstreetmap.org/way/1".to_owned()),
            "the note of the version: \"openstreetmap.org",
        ),
        (with(&|v| v.intent.location_cell = Some(0.5)), "a cell of 0.5 m does not hide a model"),
        (with(&|v| v.intent.location_cell = Some(100_000.0)), "and not at 50000 50000"),
        (with(&|v| v.intent.location_cell = Some(-1.0)), "no side of a cell"),
        (
            told("/extras/world_from_local_m", json!([565_977.0, 9_009_946.0, 31.0])),
            "preview.glb tells a place outside",
        ),
        (told("/accessors/0/max", json!([565_977.0, 0.25, 0.0])), "preview.glb has coordinates larger than the model"),
        (
            told("/accessors/0/max", json!([0.375, 0.25, 0.0])),
            "preview.glb has vertices or triangles other than it says",
        ),
        (file("preview.glb", preview(&json!({}), b"565977__")), "preview.glb has vertices or triangles other"),
        (
            poster("poster.jpg", &|b| drop(b.splice(2..2, segment(0xe1)))),
            "poster.jpg holds something beside its pixels",
        ),
        (
            poster("poster.jpg", &|b| drop(b.splice(2..2, segment(0xdb)))),
            "poster.jpg holds something beside its pixels",
        ),
        (poster("poster.jpg", &|b| drop(b.splice(609..609, segment(0xc4)))), "poster.jpg holds something beside"),
        (poster("poster.jpg", &|b| drop(b.splice(609..609, segment(0xdd)))), "poster.jpg holds something beside"),
        (poster("poster.jpg", &|b| b.extend(here)), "poster.jpg holds something beside its pixels"),
        (file("poster.jpg", jpeg([1200, 630], here)), "poster.jpg holds something beside its pixels"),
        (
            file("poster.jpg", jpeg([1200, 630], &[b"\xff\xd0", &here[..]].concat())),
            "poster.jpg holds something beside",
        ),
        (file("poster-600.jpg", jpeg([1200, 630], b"")), "poster-600.jpg holds something beside its pixels"),
        (
            with(&|v| v.add("drawings/plan.pgw", b"1\n0\n0\n-1\n565977\n9009946\n".to_vec())),
            "drawings/plan.pgw is not in the form",
        ),
        (
            with(&|v| v.add("drawings/plan.pgw", b"1.0\n0.0\n0.0\n-1.0\n565977.0\n9009946.0\n".to_vec())),
            "drawings/plan.pgw places the plan somewhere else",
        ),
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
        table.push((told(key, value), "preview.glb is not in the form in which this version"));
    }
    let sound = [(b"pHYs", RESOLUTION), (b"IDAT", &pixels[..])];
    for kind in [b"tEXt", b"eXIf", b"pHYs", b"gAMA", b"tRNS", b"sBIT", b"PLTE", b"sRGB", b"cHRM", b"IDAT"] {
        for at in 0..=2 {
            let mut chunks = sound.to_vec();
            chunks.insert(at, (kind, here));
            table
                .push((file("drawings/plan.png", png(&chunks)), "drawings/plan.png holds something beside its pixels"));
        }
    }
    let more = zipped(&[&[0; 14], &here[..]].concat());
    for stream in [&more[..], &[&pixels[..], &zipped(here)].concat(), &zipped(&[0; 13]), &zipped(&[9; 14])] {
        let chunks = [(b"pHYs", RESOLUTION), (b"IDAT", stream)];
        table.push((file("drawings/plan.png", png(&chunks)), "its pixels do not fill its size"));
    }
    // A museum takes few uploads in a minute.
    for part in table.chunks(20) {
        let m = Museum::new();
        for (version, wanted) in part {
            let (code, said) = m.publish(version).await;
            let why = said.error.unwrap_or_default();
            assert_eq!(code, StatusCode::UNPROCESSABLE_ENTITY, "{wanted}: {why}");
            assert!(why.contains(wanted), "{wanted}: {why}");
            assert!(!m.models().join("fort").exists(), "{wanted}");
        }
    }
    // What is as it is said is published: without a place, with a channel of the surface, in a cell.
    let mut cell = withheld(pack_at("Fort", Some("EPSG:32737"), at(550_000.0, 9_050_000.0, 0.0), &[]));
    cell.intent.location_cell = Some(100_000.0);
    let moved =
        json!({"/extras/crs": "EPSG:32737", "/extras/world_from_local_m": [550_000.0, 9_050_000.0, 0.195_312_5]});
    replace(&mut cell, "preview.glb", preview(&moved, b""));
    (cell.intent.slug, cell.intent.metadata.slug) = ("cell".to_owned(), Some("cell".to_owned()));
    let mut scalar = kept("class", [2.0; 3]);
    (scalar.intent.slug, scalar.intent.metadata.slug) = ("scalar".to_owned(), Some("scalar".to_owned()));
    let world = with(&|v| v.add("drawings/plan.pgw", b"0.01\n0.0\n0.0\n-0.01\n-0.5\n0.4\n".to_vec()));
    for version in [world, cell, scalar] {
        let (code, said) = m.publish(&version).await;
        assert_eq!((code, said.state), (StatusCode::OK, State::Published), "{:?}", said.error);
    }
    // Where nothing is said to be withheld, nothing is looked for.
    let mut open = Version::new("open", 1, pack(true_place, &[]));
    open.intent.metadata.description = Some("At S 8.9577 E 39.5228".to_owned());
    assert_eq!(m.publish(&open).await.0, StatusCode::OK);
}

#[tokio::test]
async fn an_announcement_in_which_a_key_stands_twice_is_refused() {
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
