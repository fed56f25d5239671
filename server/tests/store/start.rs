//! What a start over a store requests: its list, and of each object only what is unknown.

use super::bucket::Bucket;
use super::{PATIENCE, of_folder};
use crate::common::{get, noise, object, page, public};
use kilwa_server::index::{Index, Query};
use kilwa_server::store::{Place, S3};
use kilwa_server::{Catalogue, Site, app};
use std::path::Path;
use std::sync::Arc;

/// As `kilwa serve` starts: index, then list; the requests that it takes.
fn start(bucket: &Bucket, name: &str, file: &Path) -> (Arc<S3>, Site, Vec<String>) {
    let mut options = bucket.options(name, PATIENCE);
    options.refresh = std::time::Duration::from_secs(60);
    bucket.proxy.asked();
    let store = S3::open(&options).unwrap();
    let index = Index::of(&Place::Key(Arc::clone(&store), String::new()), Some(file)).unwrap();
    index.refresh().unwrap();
    let mut site = Site::new(Catalogue::of_store(&store).unwrap(), page());
    site.index = Some(Arc::new(index));
    let asked = bucket.proxy.asked();
    (store, site, asked)
}

fn is_list(line: &str) -> bool {
    line.contains("list-type=2")
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_warm_start_requests_only_the_list_and_a_cold_one_two_files_per_object() {
    let Some(mut bucket) = Bucket::start("a_warm_start_asks_for_the_list_alone…") else { return };
    let (dir, home) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let file = home.path().join("index.sqlite");
    for i in 0..60 {
        let slug = format!("fort-{i}");
        object(dir.path(), &slug, &[noise(500, i)], public());
        let metadata = "{\"title\":\"T\",\"rights\":{\"uri\":\"https://creativecommons.org/licenses/by/4.0/\"},\"model\":{\"units\":\"m\"}}";
        std::fs::write(dir.path().join(slug).join("v1/metadata/metadata.json"), metadata).unwrap();
    }
    bucket.sync(dir.path(), "shelf");
    let name = "s3://museum/shelf";
    let (_, site, asked) = start(&bucket, name, &file);
    let files = asked.iter().filter(|line| !is_list(line)).count();
    // Manifest and metadata of each; and whether it is one object.
    assert_eq!(files, 60 * 2 + 1, "{asked:#?}");
    assert!(asked.len() - files <= 5, "{asked:#?}");
    let cold = get(&app(site), "/models.json").await.text();
    let (_, site, asked) = start(&bucket, name, &file);
    let files: Vec<_> = asked.iter().filter(|line| !is_list(line)).collect();
    assert!(files.len() == 1 && files[0].ends_with("/shelf/manifest.json"), "{files:?}");
    assert!(asked.len() <= 6, "{asked:#?}");
    assert_eq!(get(&app(site), "/models.json").await.text(), cold, "and shows the same");
    assert_eq!(cold, get(&of_folder(dir.path()), "/models.json").await.text(), "as a folder does");
    // What changed is asked for, and nothing else.
    object(dir.path(), "fort-7", &[noise(500, 7), noise(600, 8)], public());
    bucket.sync(&dir.path().join("fort-7"), "shelf/fort-7");
    let (_, site, asked) = start(&bucket, name, &file);
    let files: Vec<_> = asked.iter().filter(|line| !is_list(line) && !line.ends_with("/shelf/manifest.json")).collect();
    assert!(!files.is_empty() && files.iter().all(|line| line.contains("/fort-7/")), "{files:?}");
    assert_eq!(get(&app(site), "/models.json").await.text(), get(&of_folder(dir.path()), "/models.json").await.text());
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn objects_are_found_among_names_and_keys_of_any_kind() {
    let Some(mut bucket) = Bucket::start("objects_are_found_among_names_and_keys_of_any_kind") else { return };
    let (dir, home) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    // In the order of keys `a-b/` is before `a/`.
    for slug in ["a", "a-b", "a-b-c", "a0", "b", "long", "zz"] {
        object(dir.path(), slug, &[noise(500, 1)], public());
    }
    // More files than are looked through, before and after its manifest.
    let many = dir.path().join("long/A");
    std::fs::create_dir(&many).unwrap();
    for i in 0..1100 {
        std::fs::write(many.join(format!("{i}")), "").unwrap();
    }
    std::fs::create_dir(dir.path().join("no-object")).unwrap();
    std::fs::write(dir.path().join("no-object/readme.txt"), "").unwrap();
    std::fs::create_dir(dir.path().join(".hidden")).unwrap();
    std::fs::copy(dir.path().join("a/manifest.json"), dir.path().join(".hidden/manifest.json")).unwrap();
    bucket.sync(dir.path(), "shelf");
    let wanted = get(&of_folder(dir.path()), "/models.json").await.text();
    let shown = |file: &str| {
        let (_, site, _) = start(&bucket, "s3://museum/shelf", &home.path().join(file));
        assert_eq!(site.index.as_ref().unwrap().search(&Query::default()).unwrap().total, 7);
        site
    };
    assert_eq!(get(&app(shown("first")), "/models.json").await.text(), wanted);
    // A missing pack and one of another length are detected.
    let site = shown("again");
    let pack = site.catalogue.model("b").unwrap();
    assert!(pack.summary.is_ok(), "{:?}", pack.summary);
    let name = std::fs::read_dir(dir.path().join("b/v1")).unwrap().map(|e| e.unwrap().file_name());
    let name = name.map(|n| n.to_string_lossy().into_owned()).find(|n| n.starts_with("pack.")).unwrap();
    bucket.delete(&format!("shelf/b/v1/{name}"));
    let (_, site, _) = start(&bucket, "s3://museum/shelf", &home.path().join("third"));
    let message = site.catalogue.model("b").unwrap().summary.clone().unwrap_err();
    assert!(message.contains("is not there"), "{message}");
    // A key that is no valid path hides nothing: every object in its part of the list is requested.
    bucket.put(&dir.path().join("b/index.html"), "shelf/a-b/odd//key");
    let (_, site, asked) = start(&bucket, "s3://museum/shelf", &home.path().join("fourth"));
    assert_eq!(site.catalogue.models().len(), 7, "{asked:#?}");
    assert!(site.catalogue.model("zz").unwrap().summary.is_ok());
}
