//! Versions that are published from elsewhere into a store, by way of a folder of the server.

use super::bucket::Bucket;
use super::{PATIENCE, SHORT};
use crate::common::version::{Version, fort_pack, status};
use crate::common::{Answer, get, page};
use crate::eventually::eventually_async;
use axum::Router;
use axum::body::{Body, Bytes};
use axum::http::{Method, Request, StatusCode};
use futures_util::stream;
use kilwa_archive::Manifest;
use kilwa_archive::checksums::{Checksums, sha256};
use kilwa_server::access::{Accounts, Grant, Purpose};
use kilwa_server::auth::Auth;
use kilwa_server::index::Index;
use kilwa_server::store::{Place, S3, S3Options};
use kilwa_server::upload::wire::{State, Status};
use kilwa_server::upload::{UploadLimits, Uploads};
use kilwa_server::{Catalogue, Clock, Site, app};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tower::ServiceExt as _;

/// 2026-11-21T12:00:00Z.
const NOW: u64 = 1_795_262_400;
const SHELF: &str = "s3://museum/shelf";

/// A site over a store that takes uploads by way of a folder.
pub(super) struct Museum {
    pub(super) app: Router,
    robot: String,
    pub(super) folder: tempfile::TempDir,
}

impl Museum {
    fn over(bucket: &Bucket, timeout: Duration) -> Self {
        Self::over_part(bucket.options(SHELF, timeout))
    }

    /// The same over another part of the store.
    pub(super) fn over_part(mut options: S3Options) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let writer = S3::open(&options).unwrap();
        // The list is never refreshed by age, so what appears at once does so for another reason.
        options.refresh = Duration::from_secs(600);
        let store = S3::open(&options).unwrap();
        let shelf = Place::Key(Arc::clone(&store), String::new());
        let index = Index::of(&shelf, Some(&folder.path().join("index.sqlite"))).unwrap();
        index.refresh().unwrap();
        let mut site = Site::new(Catalogue::of_store(&store).unwrap(), page());
        site.index = Some(Arc::new(index));
        let uploads = Uploads::into_store(&folder.path().join("uploads"), &writer, page(), UploadLimits::default());
        site.uploads = Some(Arc::new(uploads.unwrap()));
        Self::with(folder, site)
    }

    /// The same over a folder.
    pub(super) fn over_folder() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let models = folder.path().join("models");
        std::fs::create_dir(&models).unwrap();
        Self::over_models(folder, &models)
    }

    /// The same over this folder, with one for accounts.
    pub(super) fn over_models(folder: tempfile::TempDir, models: &Path) -> Self {
        let mut site = Site::new(Catalogue::open(models).unwrap(), page());
        let limits = UploadLimits { per_minute: u32::MAX, ..UploadLimits::default() };
        site.uploads = Some(Arc::new(Uploads::new(models.canonicalize().unwrap(), page(), limits)));
        Self::with(folder, site)
    }

    fn with(folder: tempfile::TempDir, mut site: Site) -> Self {
        let mut accounts = Accounts::new().unwrap();
        accounts.set_user("robot", &Grant::All, None).unwrap();
        let robot = accounts.add_token("robot", Purpose::Publish, 30, NOW).unwrap();
        let file = folder.path().join("access.json");
        accounts.create(&file).unwrap();
        site.auth = Some(Arc::new(Auth::open(&file, Some(&folder.path().join("audit.jsonl"))).unwrap()));
        site.clock = Clock::new(|| NOW);
        Self { app: app(site), robot, folder }
    }

    async fn send(&self, method: Method, uri: &str, more: &[(&str, &str)], body: Body) -> Answer {
        let mut request = Request::builder().method(method).uri(uri).header("host", "museum.example");
        request = request.header("authorization", format!("Bearer {}", self.robot));
        for (name, value) in more {
            request = request.header(*name, *value);
        }
        Answer::of(self.app.clone().oneshot(request.body(body).unwrap()).await.unwrap()).await
    }

    async fn begin(&self, version: &Version) -> Answer {
        self.send(Method::POST, "/uploads", &[], serde_json::to_vec(&version.intent).unwrap().into()).await
    }

    async fn patch(&self, sha256: &str, offset: u64, body: Body) -> Answer {
        let offset = offset.to_string();
        let headers = [
            ("tus-resumable", "1.0.0"),
            ("upload-offset", offset.as_str()),
            ("content-type", "application/offset+octet-stream"),
        ];
        self.send(Method::PATCH, &format!("/uploads/fort/{sha256}"), &headers, body).await
    }

    /// Send everything that is missing.
    pub(super) async fn send_all(&self, version: &Version) {
        let begun = self.begin(version).await;
        assert_eq!(begun.status, StatusCode::CREATED, "{}", begun.text());
        for lack in status(&begun).lacks {
            let rest = version.bytes(&lack.sha256)[lack.offset as usize..].to_vec();
            let answer = self.patch(&lack.sha256, lack.offset, rest.into()).await;
            assert_eq!(answer.status, StatusCode::NO_CONTENT, "{}", answer.text());
        }
    }

    pub(super) async fn finish(&self) -> Answer {
        self.send(Method::POST, "/uploads/fort", &[], Body::empty()).await
    }

    async fn look(&self) -> (StatusCode, Status) {
        let answer = self.send(Method::GET, "/uploads/fort", &[], Body::empty()).await;
        (answer.status, status(&answer))
    }

    pub(super) async fn ended(&self) -> (StatusCode, Status) {
        let ended = async || Some(self.look().await).filter(|(_, status)| status.state != State::Verifying);
        eventually_async("the end of verifying", ended).await
    }

    fn left(&self) -> Vec<String> {
        let names = |folder: &Path| -> Vec<String> {
            let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
            entries.map(|e| e.file_name().to_string_lossy().into_owned()).collect()
        };
        let uploads = self.folder.path().join("uploads");
        names(&uploads)
            .into_iter()
            // `.kilwa-making` is an empty folder that serves as a lock.
            .filter(|n| n != ".kilwa-uploads" && n != ".kilwa-making")
            .chain(names(&uploads.join(".kilwa-uploads")))
            .collect()
    }
}

/// A version with a valid pack, and pictures that differ.
pub(super) fn version(number: u32, words: &str) -> Version {
    let mut version = Version::new("fort", number, fort_pack());
    version.intent.metadata.description = Some(words.to_owned());
    version
}

/// Every file of the object that a site serves, by the lists of its versions, each as its list says it is; `None` if there is none.
pub(super) async fn tree(app: &Router) -> Option<BTreeMap<String, Bytes>> {
    let answer = get(app, "/fort/manifest.json").await;
    if answer.status == 404 {
        return None;
    }
    let manifest = Manifest::parse(&answer.body).unwrap();
    let mut all = BTreeMap::from([("manifest.json".to_owned(), answer.body)]);
    let page = get(app, "/fort/index.html").await;
    assert_eq!(page.status, 200, "the landing page");
    all.insert("index.html".to_owned(), page.body);
    for version in &manifest.versions {
        let list = get(app, &format!("/fort/{}", version.checksums.url)).await.body;
        assert_eq!(sha256(&list), version.checksums.sha256);
        for (path, sum) in Checksums::parse(std::str::from_utf8(&list).unwrap()).unwrap().iter() {
            let name = format!("{}/{path}", version.folder);
            let answer = get(app, &format!("/fort/{name}")).await;
            assert!(answer.status == 200 && sha256(&answer.body) == *sum, "{name}: {}", answer.status);
            all.insert(name, answer.body);
        }
    }
    Some(all)
}

/// What the store has, for somebody who comes now; once more where a version was published while it was read.
async fn seen(bucket: &Bucket) -> Option<BTreeMap<String, Bytes>> {
    let come = || {
        let store = bucket.open_directly(SHELF, PATIENCE).unwrap();
        app(Site::new(Catalogue::of_store(&store).unwrap(), page()))
    };
    loop {
        let all = tree(&come()).await;
        let answer = get(&come(), "/fort/manifest.json").await;
        let manifest = (answer.status != 404).then_some(answer.body);
        if manifest == all.as_ref().map(|all| all["manifest.json"].clone()) {
            return all;
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_upload_to_a_store_equals_one_to_a_folder_and_is_served_at_once() {
    let Some(bucket) = Bucket::start("what_is_sent_is_in_the_store_as_it_would_be_in_a_folder…") else { return };
    let (store, folder) = (Museum::over(&bucket, PATIENCE), Museum::over_folder());
    for (number, words) in [(1, "With a tower."), (2, "With a cistern.")] {
        let version = version(number, words);
        for museum in [&store, &folder] {
            museum.send_all(&version).await;
            assert_eq!(museum.finish().await.status, StatusCode::ACCEPTED);
            let (code, upload) = museum.ended().await;
            assert_eq!((code, upload.state, upload.version), (StatusCode::OK, State::Published, number), "{upload:?}");
        }
        let list =
            get(&store.app, &format!("/?q={}", words.split(' ').next_back().unwrap().trim_end_matches('.'))).await;
        assert!(list.text().contains("href=\"/fort/\""), "it is found at once: {}", list.text());
        assert!(get(&store.app, "/fort/").await.text().contains(words));
        let (here, there) = (tree(&folder.app).await.unwrap(), tree(&store.app).await.unwrap());
        assert_eq!(here.keys().collect::<Vec<_>>(), there.keys().collect::<Vec<_>>());
        assert!(here.iter().all(|(path, bytes)| there[path] == *bytes), "the same bytes");
        assert!(seen(&bucket).await.unwrap() == there, "and in the store itself");
        assert_eq!(store.left(), Vec::<String>::new(), "nothing is left on the server");
    }
    // Again: it exists already. An old number: the response states which version exists.
    let again = store.begin(&version(2, "With a cistern.")).await;
    assert_eq!((again.status, status(&again).already), (StatusCode::OK, true), "{}", again.text());
    let late = store.begin(&version(2, "Another text.")).await;
    assert!(late.status == StatusCode::CONFLICT && late.text().contains("at version 2"), "{}", late.text());
    let record = std::fs::read_to_string(store.folder.path().join("audit.jsonl")).unwrap();
    assert_eq!(record.matches("\"published\",\"who\":\"robot\"").count(), 2, "{record}");
    assert!(!get(&store.app, "/models.json").await.text().contains("kilwa-may-write"));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_unavailable_store_is_reported_and_waited_for() {
    let Some(bucket) = Bucket::start("an_unavailable_store_is_reported_and_waited_for") else { return };
    let museum = Museum::over(&bucket, SHORT);
    museum.send_all(&version(1, "With a tower.")).await;
    bucket.proxy.down();
    assert_eq!(museum.finish().await.status, StatusCode::ACCEPTED);
    let message = eventually_async("a message", async || museum.look().await.1.waits).await;
    assert!(message.contains("does not answer") && message.contains("continues when it does"), "{message}");
    assert_eq!(museum.look().await.1.state, State::Verifying);
    bucket.proxy.up();
    let (code, status) = museum.ended().await;
    assert_eq!((code, status.state, status.waits), (StatusCode::OK, State::Published, None), "{:?}", status.error);
    assert!(seen(&bucket).await.is_some());
    // The client learns it before anything is sent.
    bucket.proxy.down();
    let begin = async |wanted: u16| {
        let begun = async || Some(museum.begin(&version(2, "Better.")).await).filter(|a| a.status == wanted);
        eventually_async(&format!("{wanted} for an announcement"), begun).await
    };
    let refused = begin(503).await;
    assert!(
        refused.text().contains("storage does not answer") && refused.text().starts_with('{'),
        "{}",
        refused.text()
    );
    assert_eq!(refused.header("retry-after"), "10");
    bucket.proxy.up();
    begin(201).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_read_only_store_is_reported_and_uploaded_files_are_kept() {
    let Some(bucket) = Bucket::start("a_store_that_does_not_let_itself_be_written_to…") else { return };
    let dir = tempfile::tempdir().unwrap();
    let store = bucket.open(SHELF, PATIENCE).unwrap();
    bucket.proxy.refuse("PUT /museum/");
    let refused = Uploads::into_store(&dir.path().join("x"), &store, page(), UploadLimits::default());
    let message = refused.err().expect("it may not write").to_string();
    assert!(message.contains("s3:PutObject") && message.contains("403") && !message.contains("secret"), "{message}");
    bucket.proxy.allow();
    let file = dir.path().join("file");
    std::fs::write(&file, "").unwrap();
    let refused = Uploads::into_store(&file, &store, page(), UploadLimits::default());
    let message = refused.err().expect("a file is no folder").to_string();
    assert!(message.contains(file.to_str().unwrap()), "{message}");
    let museum = Museum::over(&bucket, PATIENCE);
    museum.send_all(&version(1, "With a tower.")).await;
    bucket.proxy.refuse("PUT /museum/shelf/fort/v1/");
    museum.finish().await;
    let (code, upload) = museum.ended().await;
    let why = upload.error.unwrap_or_default();
    assert!(code == StatusCode::FORBIDDEN && why.contains("keys with write permission"), "{code}: {why}");
    assert!(seen(&bucket).await.is_none());
    bucket.proxy.allow();
    assert!(status(&museum.begin(&version(1, "With a tower.")).await).lacks.is_empty(), "what was sent is kept");
    museum.finish().await;
    assert_eq!(museum.ended().await.1.state, State::Published);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn interrupted_fifty_times_on_either_side_the_store_has_the_whole_old_or_new_object() {
    let Some(bucket) = Bucket::start("cut_off_fifty_times_on_either_side…") else { return };
    let (museum, folder) = (Museum::over(&bucket, SHORT), Museum::over_folder());
    let mut random = fastrand::Rng::with_seed(1);
    let mut below = |n: u64| random.u64(..n);
    let (mut client, mut store, mut number) = (0, 0, 0);
    while client + store < 50 || number < 2 {
        number += 1;
        let version = version(number, &format!("The version of the number {number}."));
        folder.send_all(&version).await;
        folder.finish().await;
        assert_eq!(folder.ended().await.1.state, State::Published);
        // The client's connection breaks in the middle of a file.
        loop {
            let begun = museum.begin(&version).await;
            assert_eq!(begun.status, StatusCode::CREATED, "{}", begun.text());
            let Some(lack) = status(&begun).lacks.first().cloned() else { break };
            let rest = &version.bytes(&lack.sha256)[lack.offset as usize..];
            let part = Bytes::copy_from_slice(&rest[..below(rest.len() as u64 + 1) as usize]);
            let broken = stream::iter([Ok(part), Err(std::io::Error::other("the connection broke"))]);
            if client < 12 * number && rest.len() > 1 {
                assert_ne!(museum.patch(&lack.sha256, lack.offset, Body::from_stream(broken)).await.status, 204);
                client += 1;
            } else {
                assert_eq!(museum.patch(&lack.sha256, lack.offset, rest.to_vec().into()).await.status, 204);
            }
        }
        // The connection to the store, repeatedly and at any point.
        let before = seen(&bucket).await;
        bucket.proxy.cut_after(below(3000) as i64);
        museum.finish().await;
        loop {
            let halted = async || {
                let (_, upload) = museum.look().await;
                (upload.state != State::Verifying || upload.waits.is_some()).then_some(upload)
            };
            let upload = eventually_async("an upload that ended or waits", halted).await;
            let now = seen(&bucket).await;
            let shown = now.as_ref().map_or(0, |all| Manifest::parse(&all["manifest.json"]).unwrap().versions.len());
            assert!(now == before || shown == number as usize, "a half: {shown}");
            if upload.state != State::Verifying {
                assert_eq!(upload.state, State::Published, "{upload:?}");
                break;
            }
            store += 1;
            bucket.proxy.down();
            bucket.proxy.up();
            if store < 20 * number {
                bucket.proxy.cut_after(200 + below(6000) as i64);
            }
            // So that the next cut comes at another moment; no state is waited for.
            tokio::time::sleep(Duration::from_millis(100)).await;
        }
        bucket.proxy.down();
        bucket.proxy.up();
        let answers = async || (get(&museum.app, "/healthz").await.status == 200).then_some(());
        eventually_async("an answer of the store", answers).await;
        let (here, there) = (tree(&folder.app).await.unwrap(), seen(&bucket).await.unwrap());
        assert!(here == there, "version {number} is another than in a folder");
    }
    println!("{} cuts: {client} of the client's connection, {store} of the store's", client + store);
    assert!(client >= 20 && store >= 20);
}
