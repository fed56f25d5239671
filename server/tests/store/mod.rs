//! An archive in an S3-compatible store is served as the same archive in a folder is, and nothing is lost while the store is unavailable.
//!
//! The store is moto, filled by boto3, both from PyPI: `cargo xtask test` puts them where `KILWA_MOTO` says; without that the tests say that
//! they were skipped.

mod bucket;
mod collections;
mod extracts;
mod institution;
mod publishing;
mod races;
mod start;
mod uploads;

use crate::common::{Answer, LogCapture, ask, get, noise, object, page, public};
use crate::eventually::eventually_async;
use axum::Router;
use axum::body::Body;
use axum::http::{Request, StatusCode};
use bucket::Bucket;
use futures_util::{StreamExt as _, TryStreamExt as _};
use kilwa_archive::manifest::{Access, AccessState, Manifest};
use kilwa_server::index::{Index, Query};
use kilwa_server::store::S3;
use kilwa_server::{Catalogue, Clock, Site, app};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tokio::time::timeout;
use tower::ServiceExt as _;

/// A step of a request to the store may take so long; long enough for a busy machine where nothing is cut.
const PATIENCE: Duration = Duration::from_secs(20);
/// The same where the store is silent.
const SHORT: Duration = Duration::from_millis(600);
/// A reader that waits longer than this counts as hanging.
const HANGS: Duration = Duration::from_secs(60);

fn site(catalogue: Catalogue) -> Site {
    let mut site = Site::new(catalogue, page());
    let index = Index::of(site.catalogue.shelf().unwrap(), None).unwrap();
    index.refresh().unwrap();
    site.index = Some(Arc::new(index));
    site.url = Some("https://museum.example".to_owned());
    // 2026-11-21T12:00:00Z
    site.clock = Clock::new(|| 1_795_262_400);
    site
}

fn of_folder(folder: &Path) -> Router {
    app(site(Catalogue::open(folder).unwrap()))
}

fn of_store(store: &Arc<S3>) -> Site {
    site(Catalogue::of_store(store).unwrap())
}

/// Objects of each kind; packs long enough to be streamed.
fn archive(folder: &Path) -> Vec<Manifest> {
    let closed = |state, until: Option<&str>| Access {
        state,
        until: until.map(str::to_owned),
        reason: Some("The family asked.".to_owned()),
        ..public()
    };
    let all = vec![
        object(folder, "fort", &[noise(5000, 1), noise(1_300_000, 2)], public()),
        object(folder, "wall", &[noise(2_500_000, 3)], public()),
        object(folder, "grave", &[noise(4000, 4)], closed(AccessState::Restricted, None)),
        object(folder, "tower", &[noise(3000, 5)], closed(AccessState::Embargo, Some("2026-12-01"))),
        object(folder, "gone", &[noise(3000, 6)], closed(AccessState::Withdrawn, None)),
    ];
    std::fs::write(folder.join("fort/annotations.json"), "{\"notes\":[]}").unwrap();
    std::fs::write(folder.join("fort/v2/left-behind.txt"), "not published").unwrap();
    std::fs::create_dir(folder.join("broken")).unwrap();
    std::fs::write(folder.join("broken/manifest.json"), "{").unwrap();
    all
}

/// The comparable parts of a response: status, headers except those that depend on time, body.
fn facts(a: &Answer) -> (u16, Vec<(String, String)>, axum::body::Bytes) {
    let mut headers: Vec<_> = a
        .headers
        .iter()
        .filter(|(name, _)| !["date", "x-request-id"].contains(&name.as_str()))
        .map(|(name, value)| (name.to_string(), String::from_utf8_lossy(value.as_bytes()).into_owned()))
        .collect();
    headers.sort();
    (a.status.as_u16(), headers, a.body.clone())
}

fn addresses(all: &[Manifest], folder: &Path) -> Vec<String> {
    let mut addresses: Vec<String> = [
        "/",
        "/?q=fort",
        "/?q=nothing",
        "/models.json",
        "/feed.xml",
        "/sitemap.xml",
        "/robots.txt",
        "/healthz",
        "/oembed?url=https%3A%2F%2Fmuseum.example%2Ffort%2F",
        "/oai?verb=ListRecords&metadataPrefix=oai_dc",
        "/oai?verb=Identify",
        "/fort",
        "/nothing",
        "/nothing/",
        "/fort/nothing",
        "/fort/v3/x",
        "/fort/v1/../manifest.json",
        "/fort/v2/left-behind.txt",
        "/fort/v1",
        "/fort/v1/",
        "/broken/",
        "/broken/manifest.json",
        "/m/fort",
        "/packs/fort.kilwa",
        "/packs/wall.kilwa",
        "/packs/grave.kilwa",
        "/packs/gone.kilwa",
        "/packs/nothing.kilwa",
        "/packs/fort.annotations.json",
        "/fort/annotations.json",
    ]
    .map(str::to_owned)
    .to_vec();
    for m in all {
        addresses.push(format!("/{}/", m.slug));
        for name in ["index.html", "manifest.json", "annotations.json"] {
            addresses.push(format!("/{}/{name}", m.slug));
        }
        for v in &m.versions {
            let list = std::fs::read_to_string(folder.join(&m.slug).join(&v.checksums.url)).unwrap();
            let names = list.lines().map(|line| line.split_once("  ").unwrap().1).chain(["checksums.sha256"]);
            addresses.extend(names.map(|name| format!("/{}/{}/{name}", m.slug, v.folder)));
            for ranges in ["0-0", "5-9,0-3", "900-999,3-3,20-40,100-400,500-501,60-60", "0-9,9-19", "0-99999999999"] {
                addresses.push(format!("/{}/{}/{ranges}", m.slug, v.pack.url));
            }
        }
    }
    addresses
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn every_address_answers_from_the_store_as_from_the_folder() {
    let Some(mut bucket) = Bucket::start("every_address_answers_from_the_store_as_from_the_folder") else { return };
    let dir = tempfile::tempdir().unwrap();
    let all = archive(dir.path());
    bucket.sync(dir.path(), "a/b");
    // Keys beside the prefix are not served.
    bucket.put(&dir.path().join("fort/manifest.json"), "a/secret/manifest.json");
    bucket.put(&dir.path().join("fort/manifest.json"), "a/bc/manifest.json");
    let folder = of_folder(dir.path());
    let store = app(of_store(&bucket.open("s3://museum/a/b/", PATIENCE).unwrap()));
    let mut generator = fastrand::Rng::with_seed(7);
    let mut random = |below: u64| generator.u64(..below);
    for address in addresses(&all, dir.path()) {
        let first = get(&folder, &address).await;
        let etag = first.header("etag").to_owned();
        let length = first.body.len() as u64;
        let mut asked: Vec<(&str, Vec<(&str, String)>)> = vec![
            ("GET", vec![]),
            ("HEAD", vec![]),
            ("OPTIONS", vec![]),
            ("GET", vec![("accept-encoding", "br, gzip".to_owned())]),
        ];
        if !etag.is_empty() {
            asked.push(("GET", vec![("if-none-match", etag.clone())]));
            asked.push(("GET", vec![("if-match", "\"other\"".to_owned())]));
            asked.push(("HEAD", vec![("range", "bytes=0-1".to_owned())]));
            for range in ["bytes=0-0", "bytes=-1", "bytes=-0", "bytes=0-1,3-4", "bytes=5-2", "nonsense"] {
                asked.push(("GET", vec![("range", range.to_owned())]));
            }
            asked.push(("GET", vec![("range", format!("bytes={length}-"))]));
            asked.push(("GET", vec![("range", format!("bytes={}-", length.saturating_sub(1)))]));
            for i in 0..6 {
                let start = random(length + 2);
                let end = start + random(length + 2);
                let tag = if i % 3 == 0 { "\"other\"".to_owned() } else { etag.clone() };
                asked.push(("GET", vec![("range", format!("bytes={start}-{end}")), ("if-range", tag)]));
            }
        }
        for (method, headers) in asked {
            let headers: Vec<_> = headers.iter().map(|(n, v)| (*n, v.as_str())).collect();
            let (a, b) =
                (ask(&folder, method, &address, &headers).await, ask(&store, method, &address, &headers).await);
            let (a, b) = (facts(&a), facts(&b));
            assert_eq!((a.0, &a.1), (b.0, &b.1), "{method} {address} {headers:?}");
            assert!(a.2 == b.2, "{method} {address} {headers:?}: other bytes");
        }
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_single_object_of_a_store_can_be_served_to_many_concurrent_readers() {
    let Some(mut bucket) = Bucket::start("one_object_of_a_store_can_be_served_by_itself…") else { return };
    let dir = tempfile::tempdir().unwrap();
    let bytes = noise(2_000_000, 9);
    let manifest = object(dir.path(), "fort", std::slice::from_ref(&bytes), public());
    bucket.sync(dir.path(), "");
    let store = bucket.open("s3://museum/fort", PATIENCE).unwrap();
    let app = app(Site::new(Catalogue::of_store(&store).unwrap(), page()));
    assert_eq!(get(&app, "/fort/").await.status, 200);
    let url = format!("/fort/{}", manifest.versions[0].pack.url);
    let readers: Vec<_> = (0..40_usize)
        .map(|i| {
            let (app, url, start) = (app.clone(), url.clone(), i * 48_000);
            tokio::spawn(async move {
                let range = format!("bytes={start}-{}", start + 65_535);
                (start, ask(&app, "GET", &url, &[("range", &range)]).await)
            })
        })
        .collect();
    for reader in readers {
        let (start, a) = reader.await.unwrap();
        assert_eq!(a.status, 206);
        assert!(a.body == bytes[start..(start + 65_536).min(bytes.len())], "from {start}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn changes_in_the_store_appear_and_are_never_mixed_with_the_previous_listing() {
    let Some(mut bucket) = Bucket::start("what_changes_in_the_store_shows…") else { return };
    let dir = tempfile::tempdir().unwrap();
    let (old, new) = (noise(1_500_000, 1), noise(1_500_000, 2));
    let manifest = object(dir.path(), "fort", std::slice::from_ref(&old), public());
    bucket.sync(dir.path(), "");
    let site = of_store(&bucket.open_fresh("s3://museum", PATIENCE).unwrap());
    let app = app(site);
    let url = format!("/fort/{}", manifest.versions[0].pack.url);
    assert_eq!(get(&app, &url).await.body, old);
    // Another file of the same length under the same name: refused, not mixed in.
    let other = dir.path().join("other");
    std::fs::write(&other, &new).unwrap();
    bucket.put(&other, &format!("fort/{}", manifest.versions[0].pack.url));
    let a = ask(&app, "GET", &url, &[("range", "bytes=100-200")]).await;
    assert_eq!(a.status, 503, "{}", a.text());
    std::fs::write(&other, &old).unwrap();
    bucket.put(&other, &format!("fort/{}", manifest.versions[0].pack.url));
    let a = ask(&app, "GET", &url, &[("range", "bytes=100-200")]).await;
    assert_eq!((a.status.as_u16(), &a.body[..]), (206, &old[100..=200]), "what is right again is served again");
    // A second version, a new object, one that goes.
    let manifest = object(dir.path(), "fort", &[old.clone(), new.clone()], public());
    bucket.sync(&dir.path().join("fort"), "fort");
    object(dir.path(), "wall", &[noise(3000, 3)], public());
    bucket.sync(&dir.path().join("wall"), "wall");
    assert_eq!(get(&app, &format!("/fort/{}", manifest.versions[1].pack.url)).await.body, new);
    assert_eq!(get(&app, "/wall/").await.status, 200);
    let listed = async || Some(get(&app, "/").await.text()).filter(|l| l.contains("Title of wall"));
    let list = eventually_async("the new object in the catalogue", listed).await;
    assert!(list.contains("Title of fort"));
    bucket.delete("wall/manifest.json");
    assert_eq!(get(&app, "/wall/").await.status, 404);
    let dropped = async || (!get(&app, "/").await.text().contains("Title of wall")).then_some(());
    eventually_async("the catalogue without the object", dropped).await;
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn while_the_store_is_unavailable_readers_are_informed_and_cached_files_are_served() {
    let Some(mut bucket) = Bucket::start("while_the_store_is_away_readers_are_told…") else { return };
    let log = LogCapture::listen();
    let dir = tempfile::tempdir().unwrap();
    let all = archive(dir.path());
    bucket.sync(dir.path(), "outage");
    let site = of_store(&bucket.open("s3://museum/outage", SHORT).unwrap());
    let (index, app) = (site.index.clone().unwrap(), app(site));
    let known = index.search(&Query::default()).unwrap().total;
    let pack = format!("/wall/{}", all[1].versions[0].pack.url);
    let held = [
        "/fort/",
        "/fort/manifest.json",
        "/fort/v2/poster.jpg",
        "/fort/v2/metadata/dc.xml",
        "/",
        "/models.json",
        "/healthz",
    ];
    let range = [("range", "bytes=1000-99999")];
    for address in held {
        assert_eq!(get(&app, address).await.status, 200, "{address}");
    }
    let whole = ask(&app, "GET", &pack, &range).await;
    for how in ["refuses connections", "takes questions and answers nothing"] {
        if how.starts_with("refuses") {
            bucket.proxy.down();
        } else {
            bucket.proxy.silent();
        }
        let a = timeout(HANGS, ask(&app, "GET", &pack, &range)).await.expect("no reader hangs");
        assert_eq!(a.status, 503, "{how}");
        assert_eq!(a.header("retry-after"), "10");
        assert!(a.text().contains("storage does not answer") && !a.headers.contains_key("etag"), "{}", a.text());
        let before = bucket.proxy.connections();
        for _ in 0..30 {
            assert_eq!(ask(&app, "GET", &pack, &range).await.status, 503);
        }
        assert!(bucket.proxy.connections() - before < 20, "{how}: readers are no load on a store that is ill");
        let a = ask(&app, "GET", "/wall/", &[("accept", "text/html")]).await;
        assert!(a.status == 503 && a.text().contains("<h1>"), "{} {}", a.status, a.text());
        assert_eq!(get(&app, "/never-seen/").await.status, 503, "nobody can say that there is nothing");
        for address in held.iter().filter(|a| **a != "/healthz") {
            assert_eq!(get(&app, address).await.status, 200, "{how}: {address}");
        }
        assert_eq!(get(&app, "/healthz").await.status, 503);
        assert!(index.refresh().is_err() && index.search(&Query::default()).unwrap().total == known, "{how}");
        if how.starts_with("refuses") {
            bucket.proxy.up();
        } else {
            bucket.proxy.down();
            bucket.proxy.up();
        }
        let read = async || Some(ask(&app, "GET", &pack, &range).await).filter(|a| a.status == 206);
        let again = eventually_async("the pack after the outage", read).await;
        assert!(again.body == whole.body && again.header("etag") == whole.header("etag"), "{how}");
        assert_eq!(get(&app, "/healthz").await.status, 200);
    }
    index.refresh().unwrap();
    assert_eq!(index.search(&Query::default()).unwrap().total, known);
    let mut lines = log.about("museum/outage");
    lines.retain(|line| !line.contains("left-behind"));
    assert_eq!(lines.len(), 1, "a line for an outage and not for each request: {lines:#?}");
    assert!(!log.about("").iter().any(|line| line.contains("secret")), "keys are in no line");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_interrupted_transfer_ends_early_or_resumes_and_never_looks_complete() {
    let Some(mut bucket) = Bucket::start("a_transfer_that_is_cut_ends_early…") else { return };
    let dir = tempfile::tempdir().unwrap();
    let bytes = noise(4_000_000, 5);
    let manifest = object(dir.path(), "fort", std::slice::from_ref(&bytes), public());
    bucket.sync(dir.path(), "");
    let app = app(of_store(&bucket.open("s3://museum", SHORT).unwrap()));
    let url = format!("/fort/{}", manifest.versions[0].pack.url);
    let begin = || async {
        let request = Request::get(&url).body(Body::empty()).unwrap();
        app.clone().oneshot(request).await.unwrap()
    };
    assert_eq!(axum::body::to_bytes(begin().await.into_body(), usize::MAX).await.unwrap(), bytes);
    let cuts: [&dyn Fn(&Bucket); 2] = [&|b| b.proxy.cut_after(500_000), &|b| b.proxy.silent_after(500_000)];
    for (i, cut) in cuts.iter().enumerate() {
        cut(&bucket);
        let response = begin().await;
        assert_eq!(
            (response.status(), response.headers()["content-length"].to_str().unwrap()),
            (StatusCode::OK, "4000000")
        );
        let read = timeout(HANGS, axum::body::to_bytes(response.into_body(), usize::MAX)).await;
        assert!(read.expect("no reader hangs").is_err(), "cut {i}: a short body is no body");
        bucket.proxy.down();
        bucket.proxy.up();
        let read = async || Some(get(&app, &url).await).filter(|a| a.status == 200);
        let again = eventually_async("the pack after the cut", read).await;
        assert!(again.body == bytes, "cut {i}: it recovers by itself");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_file_refused_by_the_store_affects_no_other_and_is_served_once_readable() {
    let Some(mut bucket) = Bucket::start("a_file_that_the_store_refuses_takes_nothing_else_away…") else { return };
    let log = LogCapture::listen();
    let dir = tempfile::tempdir().unwrap();
    let all = archive(dir.path());
    bucket.sync(dir.path(), "refusing");
    let app = app(of_store(&bucket.open("s3://museum/refusing", PATIENCE).unwrap()));
    let (fort, wall) =
        (format!("/fort/{}", all[0].versions[1].pack.url), format!("/wall/{}", all[1].versions[0].pack.url));
    let range = [("range", "bytes=1000-99999")];
    let whole = ask(&app, "GET", &wall, &range).await;
    assert_eq!(whole.status, 206);
    bucket.proxy.refuse("/wall/v1/pack.");
    for _ in 0..20 {
        let refused = ask(&app, "GET", &wall, &range).await;
        assert_eq!((refused.status.as_u16(), refused.header("retry-after")), (503, "10"));
        assert!(!refused.text().contains("storage does not answer"), "the storage does: {}", refused.text());
        assert_eq!(ask(&app, "GET", &fort, &range).await.status, 206, "another file is served meanwhile");
    }
    for address in ["/healthz", "/wall/", "/wall/v1/poster.jpg", "/models.json"] {
        assert_eq!(get(&app, address).await.status, 200, "{address}");
    }
    let lines = log.about("refusing/wall");
    assert!(lines.len() == 1 && lines[0].contains("403") && lines[0].contains("/v1/pack."), "once: {lines:#?}");
    assert!(!log.about("").iter().any(|line| line.contains("everything else gets 503")));
    bucket.proxy.allow();
    let again = ask(&app, "GET", &wall, &range).await;
    assert!(again.status == 206 && again.body == whole.body, "nothing has to be waited for: {}", again.status);
    // In the middle of an answer: the connection breaks, and what follows is refused.
    bucket.proxy.cut_after(500_000);
    let request = Request::get(&wall).body(Body::empty()).unwrap();
    let mut body = app.clone().oneshot(request).await.unwrap().into_body().into_data_stream();
    assert!(body.next().await.unwrap().is_ok());
    bucket.proxy.refuse("/wall/v1/pack.");
    bucket.proxy.down();
    bucket.proxy.up();
    let rest: Result<Vec<_>, _> = body.try_collect().await;
    assert!(rest.is_err(), "a short body is no body");
    assert_eq!(ask(&app, "GET", &fort, &range).await.status, 206, "no outage began");
    assert_eq!(get(&app, "/healthz").await.status, 200);
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_object_with_a_refused_manifest_stays_known_or_is_reported_and_returns_once_readable() {
    let Some(mut bucket) = Bucket::start("an_object_whose_manifest_is_refused_stays_known…") else { return };
    let dir = tempfile::tempdir().unwrap();
    archive(dir.path());
    bucket.sync(dir.path(), "");
    let fresh = || {
        let site = of_store(&bucket.open_fresh("s3://museum", PATIENCE).unwrap());
        (site.index.clone().unwrap(), app(site))
    };
    let (index, app) = fresh();
    let known = index.search(&Query::default()).unwrap().total;
    bucket.proxy.refuse("/wall/manifest.json");
    index.refresh().unwrap();
    assert_eq!(index.search(&Query::default()).unwrap().total, known, "what was known stays");
    assert!(get(&app, "/").await.text().contains("Title of wall"));
    assert_eq!(get(&app, "/fort/").await.status, 200);
    // A server that begins now has never seen it.
    let (index, app) = fresh();
    assert_eq!(index.search(&Query::default()).unwrap().total, known - 1);
    let refused = index.refused().unwrap();
    assert!(refused.iter().any(|r| r.slug == "wall" && r.why.contains("403")), "{refused:?}");
    assert_eq!(get(&app, "/wall/").await.status, 503, "that there is nothing nobody can say");
    assert_eq!((get(&app, "/fort/").await.status.as_u16(), get(&app, "/healthz").await.status.as_u16()), (200, 200));
    bucket.proxy.allow();
    let listed = async || get(&app, "/").await.text().contains("Title of wall").then_some(());
    eventually_async("the object in the catalogue", listed).await;
    assert_eq!(get(&app, "/wall/").await.status, 200);
    // The list of one version: the other is served, and this one when it is given.
    bucket.proxy.refuse("/fort/v1/checksums.sha256");
    let (_, app) = fresh();
    assert_eq!(get(&app, "/fort/v2/poster.jpg").await.status, 200);
    assert_eq!(get(&app, "/fort/v1/poster.jpg").await.status, 404);
    bucket.proxy.allow();
    let served = async || (get(&app, "/fort/v1/poster.jpg").await.status == 200).then_some(());
    eventually_async("the files of the first version", served).await;
}

#[test]
fn a_store_that_cannot_be_served_is_refused_with_what_to_do_and_without_keys() {
    let Some(mut bucket) = Bucket::start("a_store_that_cannot_be_served_is_named…") else { return };
    let dir = tempfile::tempdir().unwrap();
    object(dir.path(), "fort", &[noise(3000, 1)], public());
    bucket.sync(dir.path(), "");
    let error = |change: &dyn Fn(&mut kilwa_server::store::S3Options)| {
        let mut options = bucket.options("s3://museum/x", SHORT);
        change(&mut options);
        let message = S3::open(&options).expect_err("refused").to_string();
        assert!(!message.contains("secret-of-the-test"), "{message}");
        message
    };
    let message = error(&|o| o.url = "s3://nothing-of-that-name/x".to_owned());
    assert!(message.contains("s3://nothing-of-that-name/x") && message.contains("bucket"), "{message}");
    let message = error(&|o| o.endpoint = Some("http://127.0.0.1:9".to_owned()));
    assert!(message.contains("no connection") && message.contains("--s3-endpoint"), "{message}");
    // Without keys what is public is asked for, and this is not.
    let mut options = bucket.options("s3://museum", SHORT);
    options.settings.clear();
    let result = S3::open(&options).map_err(|e| e.to_string());
    let message =
        result.and_then(|store| Catalogue::of_store(&store).map_err(|e| e.to_string())).err().expect("refused");
    assert!(message.contains("s3://museum") && message.contains("403"), "{message}");
    let message = error(&|o| o.url = "s3://test:secret-of-the-test@museum".to_owned());
    assert!(message.contains("s3://bucket/folder"), "{message}");
    bucket.proxy.silent();
    assert!(error(&|_| {}).contains("nothing within"));
}
