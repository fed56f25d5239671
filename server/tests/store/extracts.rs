//! Meshes on request from packs in a store: only the needed parts are read, and the bytes equal those of a folder.

use super::bucket::Bucket;
use super::{PATIENCE, SHORT, archive, of_store, site};
use crate::common::{Answer, ask, get, noise, object, public};
use crate::eventually::eventually_async;
use axum::Router;
use axum::body::Body;
use axum::http::Request;
use kilwa_pack::Source as _;
use kilwa_server::extracts::{Detail, Extractor, Extracts, Failure, Format, Pack, is_not_given};
use kilwa_server::{Catalogue, Site, app};
use std::io::Write as _;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use tower::ServiceExt as _;

/// Gives the pack itself, or so many bytes of its end, in pieces that fit no block.
struct Copier {
    /// Between two pieces.
    pause: Duration,
}

const PIECE: usize = 70_001;

impl Copier {
    fn extractor(self) -> Arc<Extractor> {
        Arc::new(move |pack, to, format, detail, progress| self.extract(pack, to, format, detail, progress))
    }

    fn extract(
        &self,
        pack: &Pack,
        to: &Path,
        format: Format,
        detail: Detail,
        progress: &(dyn Fn(f64) + Sync),
    ) -> Result<(), Failure> {
        let failed = |e: std::io::Error| if is_not_given(&e) { Failure::Away } else { Failure::Other(e.to_string()) };
        let source = pack.open().map_err(failed)?;
        let all = source.len().map_err(failed)?;
        let from = if let Detail::Triangles(bytes) = detail { all - bytes.min(all) } else { 0 };
        let pieces: Vec<(u64, usize)> =
            (from..all).step_by(PIECE).map(|at| (at, PIECE.min((all - at) as usize))).collect();
        let mut bytes = format!("{} of {}\n", format.ending(), pack.name()).into_bytes();
        for (i, piece) in pieces.iter().enumerate() {
            if i % 8 == 0 {
                source.expect(&pieces[i..pieces.len().min(i + 8)]);
            }
            // Simulated work on a mesh; no test relies on its duration.
            std::thread::sleep(self.pause);
            bytes.extend(source.read_at(piece.0, piece.1).map_err(failed)?);
            progress(i as f64 / pieces.len() as f64);
        }
        let mut file = tempfile::NamedTempFile::new_in(to.parent().unwrap()).unwrap();
        file.write_all(&bytes).unwrap();
        file.persist(to).unwrap();
        Ok(())
    }
}

fn with_extracts(mut site: Site, cache: &Path, max: u64, pause: Duration) -> Router {
    site.extracts = Some(Extracts::with_extractor(cache.to_owned(), max, Copier { pause }.extractor()).unwrap());
    app(site)
}

async fn post(app: &Router, uri: &str, form: &str) -> Answer {
    let request = Request::post(uri).header("host", "museum.example").body(Body::from(form.to_owned())).unwrap();
    Answer::of(app.clone().oneshot(request).await.unwrap()).await
}

async fn made(app: &Router, uri: &str) -> Answer {
    eventually_async(uri, async || Some(get(app, uri).await).filter(|a| a.status != 202)).await
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn extracts_from_a_store_equal_those_of_a_folder_and_partial_ones_fetch_partial_packs() {
    let Some(mut bucket) = Bucket::start("every_extract_is_of_the_bytes_of_a_folder…") else { return };
    let (dir, caches) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    archive(dir.path());
    bucket.sync(dir.path(), "");
    let folder = site(Catalogue::open(dir.path()).unwrap());
    let folder = with_extracts(folder, &caches.path().join("folder"), 100 << 20, Duration::ZERO);
    let store = of_store(&bucket.open("s3://museum", PATIENCE).unwrap());
    let cache = caches.path().join("store");
    let store = with_extracts(store, &cache, 100 << 20, Duration::ZERO);
    for slug in ["fort", "wall", "grave", "tower", "gone", "none"] {
        let address = format!("/{slug}/extract");
        let (a, b) = (get(&folder, &address).await, get(&store, &address).await);
        assert_eq!((a.status, a.text()), (b.status, b.text()), "{address}");
        for format in ["ply", "glb", "obj", "stl"] {
            for (form, name) in [
                ("detail=whole", "whole"),
                ("detail=triangles&triangles=100000", "100000"),
                ("detail=error&error=0.25", "0.25m"),
            ] {
                let form = format!("format={format}&{form}");
                // A network begins so many in ten minutes.
                if slug != "wall" && (name != "whole" || format == "obj") {
                    continue;
                }
                let (a, b) = (post(&folder, &address, &form).await, post(&store, &address, &form).await);
                assert_eq!((a.status, a.header("location")), (b.status, b.header("location")), "{address} {form}");
                let file = format!("{address}/v{}-{name}.{format}", if slug == "fort" { 2 } else { 1 });
                let (a, b) = (made(&folder, &file).await, made(&store, &file).await);
                assert_eq!((a.status, a.header("etag")), (b.status, b.header("etag")), "{file}");
                assert!(a.body == b.body, "{file}: other bytes");
                assert_eq!(a.status == 200, ["fort", "wall"].contains(&slug), "{file}: {}", a.status);
            }
        }
    }
    // Of the 2.5 MB some 10 kB: a block or two.
    bucket.proxy.carried();
    assert_eq!(post(&store, "/wall/extract", "format=ply&detail=triangles&triangles=10000").await.status, 303);
    assert_eq!(made(&store, "/wall/extract/v1-10000.ply").await.body.len(), 10_000 + "ply of pack.".len() + 64 + 7);
    let carried = bucket.proxy.carried();
    assert!((10_000..600_000).contains(&carried), "{carried} bytes for 10,000");
    let left: Vec<_> = std::fs::read_dir(&cache).unwrap().map(|e| e.unwrap().file_name()).collect();
    let is_mesh =
        |name: &std::ffi::OsString| ["ply", "glb", "obj", "stl"].iter().any(|e| name.to_string_lossy().ends_with(e));
    assert!(left.iter().all(is_mesh), "nothing is left of the pack: {left:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_extract_pauses_while_the_store_is_unavailable_reports_it_and_continues() {
    let Some(mut bucket) = Bucket::start("a_store_that_goes_away_halts_a_mesh…") else { return };
    let (dir, cache) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let bytes = noise(6_000_000, 3);
    object(dir.path(), "wall", std::slice::from_ref(&bytes), public());
    bucket.sync(dir.path(), "");
    let site = of_store(&bucket.open("s3://museum", SHORT).unwrap());
    let app = with_extracts(site, cache.path(), 100 << 20, Duration::from_millis(15));
    for (how, format) in [("refuses connections", "ply"), ("is silent", "stl")] {
        assert_eq!(post(&app, "/wall/extract", &format!("format={format}&detail=whole")).await.status, 303);
        let file = format!("/wall/extract/v1-whole.{format}");
        let page = format!("{file}?page=1&lang=en");
        // The response states how much was fetched.
        let fetched = async || {
            let text = get(&app, &page).await.text();
            (text.contains("storage so far:") && !text.contains("so far: 0")).then_some(())
        };
        eventually_async("the first fetched bytes", fetched).await;
        if how == "is silent" {
            bucket.proxy.silent();
        } else {
            bucket.proxy.down();
        }
        let away = async || Some(get(&app, &page).await).filter(|a| a.status == 503);
        let halted = eventually_async("the page about the outage", away).await;
        assert_eq!(halted.header("retry-after"), "10", "{how}");
        assert!(halted.text().contains("Work on your file continues when it does"), "{how}: {}", halted.text());
        assert!(halted.text().contains("http-equiv=\"refresh\""), "{how}: the page looks again");
        assert_eq!(get(&app, &file).await.status, 503, "{how}: a program gets the same status");
        if how == "is silent" {
            bucket.proxy.down();
        }
        bucket.proxy.up();
        let made = async || Some(get(&app, &file).await).filter(|a| a.status == 200);
        let done = eventually_async("the mesh", made).await;
        assert!(done.body.ends_with(&bytes) && done.text().starts_with(format), "{how}");
    }
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn an_extract_of_a_refused_changed_or_too_large_pack_is_answered_and_can_be_retried() {
    let Some(mut bucket) = Bucket::start("a_pack_that_is_refused_or_another…") else { return };
    let (dir, caches) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let bytes = noise(3_000_000, 3);
    let manifest = object(dir.path(), "wall", std::slice::from_ref(&bytes), public());
    bucket.sync(dir.path(), "");
    let site = || of_store(&bucket.open("s3://museum", PATIENCE).unwrap());
    let form = "format=ply&detail=whole";
    // A cache that cannot hold what has to be read.
    let app = with_extracts(site(), &caches.path().join("small"), 2_000_000, Duration::ZERO);
    let large = post(&app, "/wall/extract", form).await;
    assert_eq!(large.status, 422, "{}", large.text());
    // A disk that cannot, while the cache could.
    let mut full = site();
    let cache = caches.path().join("full");
    let extracts = Extracts::with_extractor(cache, 100 << 20, Copier { pause: Duration::ZERO }.extractor()).unwrap();
    full.extracts = Some(extracts.with_space(|_| Some(1_000_000)));
    let full = app_of(full);
    assert_eq!(post(&full, "/wall/extract", form).await.status, 303);
    assert_eq!(made(&full, "/wall/extract/v1-whole.ply").await.status, 507);
    let app = with_extracts(site(), &caches.path().join("cache"), 100 << 20, Duration::ZERO);
    bucket.proxy.refuse("/wall/v1/pack.");
    assert_eq!(post(&app, "/wall/extract", form).await.status, 303);
    let refused = made(&app, "/wall/extract/v1-whole.ply?page=1&lang=en").await;
    assert_eq!((refused.status.as_u16(), refused.header("retry-after")), (503, "10"));
    assert!(refused.text().contains("does not deliver the model"), "{}", refused.text());
    bucket.proxy.allow();
    // Not retried before ten seconds have passed; then it works as usual.
    let again = async || {
        post(&app, "/wall/extract", form).await;
        Some(get(&app, "/wall/extract/v1-whole.ply").await).filter(|a| a.status == 200)
    };
    let done = eventually_async("the mesh, at the next attempt", again).await;
    assert!(done.body.ends_with(&bytes));
    // Another file of that name: no mixture, and when the right one is there again it is taken.
    let key = format!("wall/{}", manifest.versions[0].pack.url);
    let other = caches.path().join("other");
    std::fs::write(&other, noise(3_000_000, 4)).unwrap();
    bucket.put(&other, &key);
    let stl = "format=stl&detail=whole";
    assert_eq!(post(&app, "/wall/extract", stl).await.status, 303);
    assert_eq!(made(&app, "/wall/extract/v1-whole.stl").await.status, 500);
    std::fs::write(&other, &bytes).unwrap();
    bucket.put(&other, &key);
    let ranged = ask(&app, "GET", &format!("/{key}"), &[("range", "bytes=0-9")]).await;
    assert_eq!(ranged.status, 206, "{}", ranged.text());
}

fn app_of(site: Site) -> Router {
    app(site)
}
