//! `site.toml` and the logo beside the objects of a store.

use super::bucket::Bucket;
use super::{PATIENCE, SHORT, of_store};
use crate::common::{get, noise, object, public};
use crate::eventually::eventually_async;
use axum::Router;
use kilwa_server::{Site, SiteFile, app};
use std::path::Path;
use std::sync::Arc;

fn serve(mut site: Site) -> Router {
    site.institution = Some(Arc::new(SiteFile::beside(site.catalogue.shelf().unwrap())));
    app(site)
}

fn put(bucket: &mut Bucket, folder: &Path, name: &str, text: &str) {
    let file = folder.join("new");
    std::fs::write(&file, text).unwrap();
    bucket.put(&file, &format!("shelf/{name}"));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_institution_in_the_store_is_shown_follows_changes_and_stays_during_an_outage() {
    let Some(mut bucket) = Bucket::start("the_institution_in_the_store…") else { return };
    let (dir, drafts) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    object(dir.path(), "fort", &[noise(3000, 1)], public());
    bucket.sync(dir.path(), "shelf");
    put(&mut bucket, drafts.path(), "site.toml", "name = \"Museum\"\nlogo = \"logo.svg\"\n");
    put(&mut bucket, drafts.path(), "logo.svg", "<svg/>");
    let app = serve(of_store(&bucket.open("s3://museum/shelf", PATIENCE).unwrap()));
    let shows = async |what: &str| get(&app, "/").await.text().contains(what).then_some(());
    eventually_async("the name", async || shows("Museum</h1>").await).await;
    eventually_async("the logo", async || shows("<img src=\"/logo.svg\"").await).await;
    assert_eq!(get(&app, "/logo.svg").await.text(), "<svg/>");
    put(&mut bucket, drafts.path(), "site.toml", "name = \"The archive\"\nlogo = \"logo.svg\"\n");
    eventually_async("the new name", async || shows("The archive</h1>").await).await;
    // Without the store, what was known is shown, and nobody waits.
    let away = serve(of_store(&bucket.open_fresh("s3://museum/shelf", SHORT).unwrap()));
    let known = async |app: &Router| {
        let html = get(app, "/").await.text();
        html.contains("The archive</h1>") && html.contains("<img src=\"/logo.svg\"")
    };
    assert!(known(&away).await);
    bucket.proxy.down();
    for _ in 0..5 {
        assert!(known(&away).await);
    }
    assert_eq!(get(&away, "/logo.svg").await.text(), "<svg/>");
}
