//! The pages a person sees, and the page's own files.

use crate::common::{ask, fresh_site, get, pack, page, site};
use crate::eventually::eventually_async;
use kilwa_server::{Catalogue, Page, Site, app};
use std::fs::write;
use std::path::Path;

#[tokio::test]
async fn the_list_names_every_model_and_why_a_broken_one_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let good = pack("Gereza <Kilwa> & \"fort\"");
    write(dir.path().join("Gereza Ñ 2009.kilwa"), &good).unwrap();
    write(dir.path().join("gereza-2009.kilwa"), &good).unwrap();
    write(dir.path().join("cut.KILWA"), &good[..good.len() - 5]).unwrap();
    write(dir.path().join("text.kilwa"), "hello").unwrap();
    let app = site(dir.path());
    let html = get(&app, "/").await.text();
    assert!(html.contains("Gereza &lt;Kilwa&gt; &amp; &quot;fort&quot;"), "{html}");
    assert!(!html.contains("<Kilwa>"));
    assert!(html.contains("href=\"/m/gereza-2009\"") && html.contains("href=\"/m/gereza-2009-2\""));
    assert!(html.contains("EPSG:32737") && html.contains("Licence"));
    assert_eq!(html.matches("cannot be shown").count(), 2);
    assert!(html.contains("truncated"));
    assert!(!html.contains("<script"), "the list needs no script");
    let json = get(&app, "/models.json").await.text();
    assert!(json.contains("\"slug\":\"cut\"") && json.contains("\"triangles\":1"));
    // A file that only has the extension of a pack is not served; a pack that begins correctly is.
    assert_eq!(get(&app, "/packs/text.kilwa").await.status, 404);
    assert_eq!(get(&app, "/packs/cut.kilwa").await.status, 200);
    write(dir.path().join("text.kilwa"), &good).unwrap();
    eventually_async("the pack in its place", async || {
        (get(&app, "/packs/text.kilwa").await.status == 200).then_some(())
    })
    .await;
}

#[tokio::test]
async fn a_model_page_carries_its_pack_and_facts_in_plain_html() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path().join("fort.kilwa"), pack("Fort")).unwrap();
    let app = site(dir.path());
    let a = get(&app, "/m/fort").await;
    let html = a.text();
    assert!(html.contains("<title>Fort - Kilwa</title>") && html.contains("<h1>Fort</h1>"), "{html}");
    assert!(html.contains("data-pack=\"/packs/fort.kilwa\"") && html.contains("<base href=\"/viewer/\">"));
    assert!(html.contains("Triangles"));
    let policy = a.header("content-security-policy");
    assert!(policy.contains("script-src 'self' 'wasm-unsafe-eval'") && !policy.contains("unsafe-inline"));
    assert_eq!(a.header("cache-control"), "no-cache");
    assert_eq!(get(&app, "/m/castle").await.status, 404);
}

#[tokio::test]
async fn a_model_added_to_the_folder_appears_and_a_single_pack_can_be_served() {
    let dir = tempfile::tempdir().unwrap();
    let app = fresh_site(dir.path());
    assert!(get(&app, "/").await.text().contains("no model here"));
    write(dir.path().join("late.kilwa"), pack("Late")).unwrap();
    assert_eq!(get(&app, "/m/late").await.status, 200);
    let single = site(&dir.path().join("late.kilwa"));
    assert!(get(&single, "/").await.text().contains("/m/late"));
    assert!(Catalogue::open(Path::new("/nowhere")).is_err_and(|e| e.to_string().contains("/nowhere")));
    write(dir.path().join("mesh.ply"), "ply").unwrap();
    let refused = Catalogue::open(&dir.path().join("mesh.ply")).err().unwrap();
    assert!(refused.to_string().contains("kilwa build"), "{refused}");
}

#[tokio::test]
async fn page_files_are_compressed_if_the_client_accepts_it() {
    let dir = tempfile::tempdir().unwrap();
    let app = app(Site::new(Catalogue::open(dir.path()).unwrap(), page()));
    let plain = get(&app, "/viewer/boot.js").await;
    let packed = ask(&app, "GET", "/viewer/boot.js", &[("accept-encoding", "br;q=1, gzip;q=0.5")]).await;
    assert_eq!((plain.text().as_str(), plain.header("content-encoding")), ("export {};", ""));
    assert_eq!((packed.text().as_str(), packed.header("content-encoding")), ("(gzip)", "gzip"));
    assert_eq!(packed.header("vary"), "Accept-Encoding");
    assert_ne!(plain.header("etag"), packed.header("etag"));
    assert_eq!(packed.header("content-type"), "text/javascript; charset=utf-8");
    let again = ask(&app, "GET", "/viewer/boot.js", &[("if-none-match", plain.header("etag"))]).await;
    assert_eq!(again.status, 304);
    let refused = ask(&app, "GET", "/viewer/boot.js", &[("accept-encoding", "gzip;q=0")]).await;
    assert_eq!(refused.header("content-encoding"), "");
    assert_eq!(get(&app, "/viewer/viewer_bg.wasm").await.header("content-type"), "application/wasm");
    assert_eq!(get(&app, "/viewer/i18n/sw.json").await.status, 200);
    assert_eq!(get(&app, "/viewer/boot.js.gz").await.status, 404);
    let both = ask(&app, "GET", "/viewer/i18n/sw.json", &[("accept-encoding", "gzip, br")]).await;
    assert_eq!((both.text().as_str(), both.header("content-encoding")), ("(brotli)", "br"));
    let one = ask(&app, "GET", "/viewer/i18n/sw.json", &[("accept-encoding", "gzip, br;q=0")]).await;
    assert_eq!((one.text().as_str(), one.header("content-encoding")), ("(gzip)", "gzip"));
    assert_ne!(both.header("etag"), one.header("etag"));
    assert_eq!(get(&app, "/viewer/i18n/sw.json.br").await.status, 404);
    let list = ask(&app, "GET", "/", &[("accept-encoding", "gzip")]).await;
    assert_eq!((list.header("content-encoding"), list.header("vary")), ("gzip", "Accept-Encoding, Accept-Language"));
    assert_eq!(get(&app, "/").await.header("content-encoding"), "");
    assert_eq!(get(&app, "/healthz").await.text(), "ok\n");
}

#[test]
fn a_missing_page_answers_with_how_to_build_it() {
    let dir = tempfile::tempdir().unwrap();
    let e = Page::load(Some(dir.path())).err().unwrap().to_string();
    assert!(e.contains("cargo xtask web") && e.contains("index.html"), "{e}");
}
