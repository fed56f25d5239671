//! `collections.toml` beside the objects of a store.

use super::bucket::Bucket;
use super::{PATIENCE, SHORT, of_store};
use crate::common::{LogCapture, get, noise, object, public};
use crate::eventually::eventually_async;
use axum::Router;
use kilwa_server::{Collections, Site, app};
use std::path::Path;
use std::sync::Arc;

const ONE: &str = "[[collection]]\nslug = \"coast\"\ntitle = \"The coast\"\nmembers = [\"wall\", \"fort\"]\n";

fn serve(mut site: Site) -> Router {
    site.collections = Some(Arc::new(Collections::beside(site.catalogue.shelf().unwrap())));
    app(site)
}

/// Whether the page of the collection has these words.
async fn has(app: &Router, words: &str) -> Option<()> {
    get(app, "/collections/coast/").await.text().contains(words).then_some(())
}

fn put(bucket: &mut Bucket, folder: &Path, text: &str) {
    let file = folder.join("new.toml");
    std::fs::write(&file, text).unwrap();
    bucket.put(&file, "shelf/collections.toml");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn collections_in_the_store_follow_changes_and_survive_a_mistake() {
    let Some(mut bucket) = Bucket::start("collections_lie_beside_the_objects…") else { return };
    let log = LogCapture::listen();
    let (dir, drafts) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    object(dir.path(), "fort", &[noise(3000, 1)], public());
    object(dir.path(), "wall", &[noise(3000, 2)], public());
    bucket.sync(dir.path(), "shelf");
    let app = serve(of_store(&bucket.open("s3://museum/shelf", PATIENCE).unwrap()));
    assert_eq!(get(&app, "/collections/coast/").await.status, 404, "there is no such file yet");
    put(&mut bucket, drafts.path(), ONE);
    let status = async |wanted: u16| {
        let asked = async || Some(get(&app, "/collections/coast/").await).filter(|a| a.status == wanted);
        eventually_async(&format!("{wanted} for the collection"), asked).await
    };
    let page = status(200).await.text();
    let at = |what: &str| page.find(what).unwrap_or_else(|| panic!("{what}: {page}"));
    assert!(at("Title of wall") < at("Title of fort"), "in the order of the file");
    assert!(get(&app, "/").await.text().contains("href=\"/collections/coast/\""));
    // A mistake is reported with its line, and the earlier collections stay.
    put(&mut bucket, drafts.path(), "[[collection]]\nslug = \"coast\"\ntitle = \"Cut off");
    let named = || log.about("shelf/collections.toml").into_iter().find(|line| line.contains("line 3"));
    let looked = async || {
        get(&app, "/collections/coast/").await;
        named()
    };
    eventually_async("a line in the log", looked).await;
    assert_eq!(get(&app, "/collections/coast/").await.status, 200);
    assert_eq!(log.about("shelf/collections.toml").len(), 1, "once");
    put(&mut bucket, drafts.path(), &ONE.replace("The coast", "The shore"));
    eventually_async("the new title", async || has(&app, "The shore").await).await;
    bucket.delete("shelf/collections.toml");
    status(404).await;
    assert!(!get(&app, "/").await.text().contains("href=\"/collections/"));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn collections_are_kept_and_nobody_waits_while_the_store_is_unavailable_or_refuses() {
    let Some(mut bucket) = Bucket::start("while_the_store_is_away_or_refuses_them_the_collections_stay…") else {
        return;
    };
    let (dir, drafts) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    object(dir.path(), "fort", &[noise(3000, 1)], public());
    bucket.sync(dir.path(), "shelf");
    put(&mut bucket, drafts.path(), ONE);
    let app = serve(of_store(&bucket.open_fresh("s3://museum/shelf", SHORT).unwrap()));
    assert_eq!(get(&app, "/collections/coast/").await.status, 200, "they are there from the beginning");
    bucket.proxy.refuse("/collections.toml");
    bucket.proxy.asked();
    for _ in 0..3 {
        assert_eq!(get(&app, "/collections/coast/").await.status, 200, "refused");
    }
    let asked = bucket.proxy.asked().iter().filter(|line| line.contains("/collections.toml")).count();
    assert!(asked >= 3, "each of them asked for the file: {asked}");
    bucket.proxy.allow();
    bucket.proxy.down();
    for _ in 0..5 {
        assert_eq!(get(&app, "/collections/coast/").await.status, 200, "away");
    }
    put(&mut bucket, drafts.path(), &ONE.replace("The coast", "The shore"));
    bucket.proxy.up();
    eventually_async("the new title", async || has(&app, "The shore").await).await;
}
