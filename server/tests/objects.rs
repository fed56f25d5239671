//! Archive objects over HTTP: exactly what was published, what is new at once, nothing of what is not public.

use crate::common::{ask, fresh_site, get, noise, object, pack, page, public, site};
use crate::eventually::eventually_async;
use kilwa_archive::checksums::sha256;
use kilwa_archive::manifest::{Access, AccessState};
use kilwa_server::{Catalogue, Clock, Policy, Site, app};
use std::fs::write;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

#[tokio::test]
async fn an_object_is_served_file_by_file_under_its_checksums() {
    let dir = tempfile::tempdir().unwrap();
    let bytes = pack("Fort");
    let manifest = object(dir.path(), "fort", std::slice::from_ref(&bytes), public());
    let app = site(dir.path());
    let a = get(&app, "/fort/").await;
    assert_eq!((a.status.as_u16(), a.header("cache-control")), (200, "no-cache"));
    assert!(a.text().contains("landing of fort") && a.text().contains("data-list=\"/\""), "{}", a.text());
    assert!(a.header("content-security-policy").contains("frame-ancestors 'self'"));
    let pack_url = format!("/fort/{}", manifest.versions[0].pack.url);
    let a = ask(&app, "GET", &pack_url, &[("accept-encoding", "gzip, br")]).await;
    assert_eq!((a.status.as_u16(), &a.body[..]), (200, &bytes[..]));
    assert_eq!(a.header("etag"), format!("\"{}\"", sha256(&bytes)));
    assert!(a.header("cache-control").contains("immutable") && !a.headers.contains_key("content-encoding"));
    assert_eq!(a.header("access-control-allow-origin"), "*");
    assert_eq!(a.header("cross-origin-resource-policy"), "cross-origin");
    let a = ask(&app, "GET", &pack_url, &[("range", "bytes=4-9"), ("if-range", a.header("etag"))]).await;
    assert_eq!((a.status.as_u16(), &a.body[..]), (206, &bytes[4..10]));
    let poster = std::fs::read(dir.path().join("fort/v1/poster.jpg")).unwrap();
    for (file, kind, body) in [
        ("v1/metadata/dc.xml", "application/xml", &b"<dc/>"[..]),
        ("v1/poster.jpg", "image/jpeg", &poster),
        ("v1/preview.glb", "model/gltf-binary", b"glTF"),
    ] {
        let a = get(&app, &format!("/fort/{file}")).await;
        assert_eq!((a.status.as_u16(), a.header("content-type"), &a.body[..]), (200, kind, body), "{file}");
        assert_eq!(a.header("etag"), format!("\"{}\"", sha256(body)), "{file}");
    }
    let list = get(&app, "/fort/v1/checksums.sha256").await;
    assert_eq!(sha256(&list.body), manifest.versions[0].checksums.sha256);
    let a = get(&app, "/fort/manifest.json").await;
    assert_eq!((a.header("cache-control"), &a.body[..]), ("no-cache", &manifest.to_bytes().unwrap()[..]));
    let again = ask(&app, "GET", "/fort/manifest.json", &[("if-none-match", a.header("etag"))]).await;
    assert_eq!(again.status, 304);
    assert_eq!(get(&app, "/packs/fort.kilwa").await.body, bytes);
    let alone = site(&dir.path().join("fort"));
    assert_eq!(get(&alone, "/fort/").await.status, 200, "an object can be served by itself");
}

#[tokio::test]
async fn the_published_viewer_is_compressed_if_the_client_accepts_it() {
    let dir = tempfile::tempdir().unwrap();
    object(dir.path(), "fort", &[pack("Fort")], public());
    let app = site(dir.path());
    for (accepted, coding, body) in [
        ("", "", "export {};"),
        ("gzip", "gzip", "(gzip)"),
        ("gzip, br", "br", "(brotli)"),
        ("br;q=0", "", "export {};"),
    ] {
        let a = ask(&app, "GET", "/fort/v1/viewer/app.js", &[("accept-encoding", accepted)]).await;
        assert_eq!((a.header("content-encoding"), a.text().as_str()), (coding, body), "{accepted}");
        assert_eq!(a.header("content-type"), "text/javascript; charset=utf-8", "{accepted}");
        assert_eq!(
            (a.header("vary"), a.header("etag")),
            ("Accept-Encoding", &*format!("\"{}\"", sha256(body.as_bytes())))
        );
    }
}

#[tokio::test]
async fn packs_and_objects_have_a_model_page() {
    let dir = tempfile::tempdir().unwrap();
    object(dir.path(), "fort", &[pack("Fort")], public());
    write(dir.path().join("wall.kilwa"), pack("Wall")).unwrap();
    let app = site(dir.path());
    for (from, to) in [("/fort", "/fort/"), ("/m/fort", "/fort/"), ("/wall", "/m/wall"), ("/wall/", "/m/wall")] {
        let a = get(&app, from).await;
        assert_eq!((a.status.as_u16(), a.header("location")), (308, to), "{from}");
    }
    let list = get(&app, "/").await.text();
    assert!(list.contains("href=\"/fort/\"") && list.contains("href=\"/m/wall\""), "{list}");
    assert!(list.contains("Title of fort") && list.contains("CC BY 4.0"));
}

#[tokio::test]
async fn only_what_was_published_is_served() {
    let dir = tempfile::tempdir().unwrap();
    let manifest = object(dir.path(), "fort", &[pack("Fort")], public());
    let fort = dir.path().join("fort");
    write(dir.path().join("secret.txt"), "secret").unwrap();
    write(fort.join(".hidden"), "secret").unwrap();
    write(fort.join("v1/notes-to-self.txt"), "secret").unwrap();
    std::fs::create_dir_all(fort.join("v2")).unwrap();
    write(fort.join("v2/unfinished.txt"), "secret").unwrap();
    std::fs::create_dir(fort.join("sub")).unwrap();
    write(fort.join("sub/a.txt"), "secret").unwrap();
    #[cfg(unix)]
    for link in ["v1/link.txt", "link.txt"] {
        std::os::unix::fs::symlink(dir.path().join("secret.txt"), fort.join(link)).unwrap();
    }
    let app = site(dir.path());
    for name in [
        ".hidden",
        "v1/notes-to-self.txt",
        "v2/unfinished.txt",
        "sub/a.txt",
        "v1/link.txt",
        "link.txt",
        "v1",
        "v1/",
        "v1/metadata",
        "v1/metadata/",
        "v1//poster.jpg",
        "V1/poster.jpg",
        "../secret.txt",
        "v1/../../secret.txt",
        "v1/%2e%2e/%2e%2e/secret.txt",
        "v1%2fposter.jpg%00",
    ] {
        let a = get(&app, &format!("/fort/{name}")).await;
        assert_eq!(a.status, 404, "{name}");
        assert!(!a.text().contains("secret"), "{name}");
    }
    // A list of checksums other than the manifest's proves nothing.
    write(fort.join("v1/checksums.sha256"), "").unwrap();
    let app = site(dir.path());
    assert_eq!(get(&app, &format!("/fort/{}", manifest.versions[0].pack.url)).await.status, 404);
}

/// Links and special files in every place of a served folder, to a secret file outside and to a closed object inside.
#[cfg(unix)]
#[tokio::test]
async fn no_link_and_no_special_file_is_followed_anywhere() {
    use std::os::unix::fs::symlink;
    let (outside, dir) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let (root, pipe) = (dir.path(), |path: &std::path::Path| {
        assert!(std::process::Command::new("mkfifo").arg(path).status().unwrap().success());
    });
    let secret = pack("SECRET");
    let closed = Access { state: AccessState::Restricted, ..public() };
    let manifest = object(root, "closed", std::slice::from_ref(&secret), closed);
    let hidden = object(outside.path(), "outside", std::slice::from_ref(&secret), public());
    let fort = object(root, "fort", &[pack("Fort")], public());
    write(outside.path().join("SECRET.kilwa"), &secret).unwrap();
    write(outside.path().join("notes.json"), "{\"SECRET\": 1}").unwrap();
    write(outside.path().join("collections.toml"), "[[collection]]\nslug = \"c\"\ntitle = \"SECRET\"\n").unwrap();
    // Packs and notes beside objects.
    symlink(outside.path().join("SECRET.kilwa"), root.join("linked.kilwa")).unwrap();
    symlink("/etc/passwd", root.join("passwd.kilwa")).unwrap();
    symlink(format!("closed/{}", manifest.versions[0].pack.url), root.join("inner.kilwa")).unwrap();
    write(root.join("plain.kilwa"), pack("Plain")).unwrap();
    symlink(outside.path().join("notes.json"), root.join("plain.annotations.json")).unwrap();
    pipe(&root.join("pipe.kilwa"));
    symlink(outside.path().join("collections.toml"), root.join("collections.toml")).unwrap();
    // Objects, and parts of objects.
    symlink(outside.path().join("outside"), root.join("outside")).unwrap();
    std::fs::create_dir(root.join("half")).unwrap();
    symlink(outside.path().join("outside/manifest.json"), root.join("half/manifest.json")).unwrap();
    std::fs::create_dir(root.join("piped")).unwrap();
    pipe(&root.join("piped/manifest.json"));
    // A version folder that was moved away and linked, as somebody short of room would.
    object(root, "moved", std::slice::from_ref(&secret), public());
    std::fs::rename(root.join("moved/v1"), outside.path().join("moved-v1")).unwrap();
    symlink(outside.path().join("moved-v1"), root.join("moved/v1")).unwrap();
    // A listed file of a version, replaced by a pipe.
    std::fs::remove_file(root.join("fort/v1/metadata/dc.xml")).unwrap();
    pipe(&root.join("fort/v1/metadata/dc.xml"));

    let app = site(root);
    let pack_of = |m: &kilwa_archive::Manifest| m.versions[0].pack.url.clone();
    let addresses = [
        "/packs/linked.kilwa".to_owned(),
        "/packs/passwd.kilwa".to_owned(),
        "/packs/inner.kilwa".to_owned(),
        "/packs/pipe.kilwa".to_owned(),
        "/packs/plain.annotations.json".to_owned(),
        "/packs/outside.kilwa".to_owned(),
        "/packs/moved.kilwa".to_owned(),
        "/m/linked".to_owned(),
        "/outside/".to_owned(),
        "/outside/manifest.json".to_owned(),
        format!("/outside/{}", pack_of(&hidden)),
        "/half/manifest.json".to_owned(),
        "/piped/manifest.json".to_owned(),
        "/fort/v1/metadata/dc.xml".to_owned(),
        format!("/moved/{}", pack_of(&hidden)),
        "/moved/v1/poster.jpg".to_owned(),
        "/moved/v1/metadata/dc.xml".to_owned(),
        "/collections/c/".to_owned(),
    ];
    for address in &addresses {
        let answer = tokio::time::timeout(Duration::from_secs(20), get(&app, address)).await;
        let a = answer.unwrap_or_else(|_| panic!("{address} hangs"));
        assert!(matches!(a.status.as_u16(), 404 | 503), "{address}: {}", a.status);
        assert!(!a.text().contains("SECRET") && !a.text().contains("root:"), "{address}");
    }
    for address in ["/", "/models.json", "/map", "/collections/", "/feed.xml", "/sitemap.xml"] {
        let a = get(&app, address).await;
        assert!(!a.text().contains("SECRET"), "{address}");
    }
    // Real files are served as before.
    assert_eq!(get(&app, "/packs/plain.kilwa").await.status, 200);
    assert_eq!(get(&app, &format!("/fort/{}", pack_of(&fort))).await.status, 200);
}

#[tokio::test]
async fn new_and_changed_objects_are_noticed_without_a_restart() {
    let dir = tempfile::tempdir().unwrap();
    let app = fresh_site(dir.path());
    assert_eq!(get(&app, "/fort/").await.status, 404);
    let (one, two) = (pack("One"), pack("Two"));
    let first = object(dir.path(), "fort", std::slice::from_ref(&one), public());
    assert_eq!(get(&app, "/fort/").await.status, 200);
    assert_eq!(get(&app, "/fort/annotations.json").await.status, 404);
    write(dir.path().join("fort/annotations.json"), "{}").unwrap();
    let second = object(dir.path(), "fort", &[one.clone(), two.clone()], public());
    assert_eq!(get(&app, "/fort/manifest.json").await.body, second.to_bytes().unwrap());
    assert_eq!(get(&app, "/fort/annotations.json").await.text(), "{}");
    assert_eq!(get(&app, &format!("/fort/{}", second.versions[1].pack.url)).await.body, two);
    assert_eq!(get(&app, &format!("/fort/{}", first.versions[0].pack.url)).await.body, one, "the old one stays");
    assert_eq!(get(&app, "/packs/fort.kilwa").await.body, two);
    let json = get(&app, "/models.json").await.text();
    assert!(json.contains(&second.versions[1].pack.url), "{json}");
    std::fs::remove_dir_all(dir.path().join("fort")).unwrap();
    assert_eq!(get(&app, "/fort/").await.status, 404);
    assert_eq!(get(&app, "/fort/manifest.json").await.status, 404);
}

#[tokio::test]
async fn a_withdrawn_object_answers_410_with_its_tombstone() {
    let dir = tempfile::tempdir().unwrap();
    let withdrawn = Access {
        state: AccessState::Withdrawn,
        reason: Some("The family <asked>.".to_owned()),
        withdrawn: Some("2026-11-01".to_owned()),
        ..public()
    };
    let manifest = object(dir.path(), "fort", &[pack("Fort")], withdrawn);
    let app = fresh_site(dir.path());
    let pack_url = format!("/fort/{}", manifest.versions[0].pack.url);
    for url in ["/fort/", &pack_url, "/fort/v1/poster.jpg", "/fort/v1/nothing", "/packs/fort.kilwa"] {
        let a = ask(&app, "GET", url, &[("range", "bytes=0-3")]).await;
        assert_eq!(a.status, 410, "{url}");
        assert!(url.starts_with("/packs/") || a.text().contains("landing of fort"), "{url}");
    }
    let a = get(&app, "/fort/manifest.json").await;
    assert_eq!((a.status.as_u16(), &a.body[..]), (410, &manifest.to_bytes().unwrap()[..]));
    std::fs::remove_file(dir.path().join("fort/index.html")).unwrap();
    let a = get(&app, "/fort/").await;
    assert_eq!(a.status, 410);
    assert!(a.text().contains("The family &lt;asked&gt;."), "{}", a.text());
    let list = get(&app, "/").await.text();
    assert!(list.contains("Withdrawn") && !list.contains("Download"), "{list}");
}

#[tokio::test]
async fn an_embargo_ends_at_midnight_utc_while_serving() {
    let dir = tempfile::tempdir().unwrap();
    let embargo = Access { state: AccessState::Embargo, until: Some("2026-11-22".to_owned()), ..public() };
    let manifest = object(dir.path(), "fort", &[pack("Fort")], embargo);
    let now = Arc::new(AtomicU64::new(0));
    let mut site = Site::new(Catalogue::open(dir.path()).unwrap(), page());
    let hand = Arc::clone(&now);
    site.clock = Clock::new(move || hand.load(Ordering::Relaxed));
    let app = app(site);
    let midnight = 1_795_305_600;
    for (second, status) in [(midnight - 1, 403), (midnight, 200), (midnight + 1, 200), (midnight - 1, 403)] {
        now.store(second, Ordering::Relaxed);
        for url in [
            format!("/fort/{}", manifest.versions[0].pack.url),
            "/fort/v1/preview.glb".to_owned(),
            "/packs/fort.kilwa".to_owned(),
        ] {
            assert_eq!(get(&app, &url).await.status, status, "{url} at {second}");
        }
        for url in ["/fort/", "/fort/manifest.json", "/fort/v1/poster.jpg", "/fort/v1/metadata/dc.xml"] {
            assert_eq!(get(&app, url).await.status, 200, "{url} at {second}");
        }
        assert_eq!(get(&app, "/").await.text().contains("from 22 November 2026 on"), status == 403);
    }
}

#[tokio::test]
async fn restricted_models_withhold_their_geometry_and_say_why() {
    let dir = tempfile::tempdir().unwrap();
    let restricted = Access { state: AccessState::Restricted, reason: Some("Rock art.".to_owned()), ..public() };
    let manifest = object(dir.path(), "fort", &[pack("Fort")], restricted);
    let app = site(dir.path());
    let a = ask(&app, "GET", &format!("/fort/{}", manifest.versions[0].pack.url), &[("range", "bytes=0-9")]).await;
    assert_eq!(a.status, 403);
    assert!(a.text().contains("Rock art."));
    let by_name = get(&app, "/packs/fort.kilwa").await;
    assert_eq!((by_name.status, by_name.text()), (a.status, a.text()), "its other address says the same");
    assert_eq!(get(&app, "/fort/v1/poster.jpg").await.status, 200);
    let list = get(&app, "/").await.text();
    assert!(list.contains("Rock art.") && !list.contains("Download pack"), "{list}");
}

#[tokio::test]
async fn a_damaged_object_is_reported_with_the_reason_and_others_are_served() {
    let dir = tempfile::tempdir().unwrap();
    object(dir.path(), "good", &[pack("Good")], public());
    for (name, manifest) in [("newer", "{\"kilwa\": 2}"), ("broken", "{"), ("empty", "")] {
        std::fs::create_dir(dir.path().join(name)).unwrap();
        write(dir.path().join(name).join("manifest.json"), manifest).unwrap();
    }
    object(dir.path(), "cut", &[pack("Cut")], public());
    std::fs::remove_dir_all(dir.path().join("cut/v1")).unwrap();
    let app = site(dir.path());
    let list = get(&app, "/").await.text();
    assert!(list.contains("newer kilwa") && list.matches("cannot be shown").count() == 4, "{list}");
    assert_eq!(get(&app, "/good/").await.status, 200);
    assert_eq!(get(&app, "/newer/").await.status, 503);
    assert_eq!(get(&app, "/cut/v1/poster.jpg").await.status, 404);
    // A file that was overwritten in place is not what its checksum says, and is not sent under it.
    assert_eq!(get(&app, "/good/v1/metadata/dc.xml").await.status, 200);
    write(dir.path().join("good/v1/metadata/dc.xml"), "<other/>").unwrap();
    assert_eq!(get(&app, "/good/v1/metadata/dc.xml").await.status, 503);
    assert_eq!(get(&app, "/good/v1/poster.jpg").await.status, 200);
}

/// An operator who replaces a damaged file with a sound copy need not restart the server.
#[tokio::test]
async fn a_damaged_or_lost_file_is_served_again_when_restored() {
    let dir = tempfile::tempdir().unwrap();
    let manifest = object(dir.path(), "fort", &[pack("fort")], public());
    let app = fresh_site(dir.path());
    let pack = manifest.versions[0].pack.url.clone();
    for name in [&pack, "v1/poster.jpg"] {
        let (path, address) = (dir.path().join("fort").join(name), format!("/fort/{name}"));
        let good = std::fs::read(&path).unwrap();
        let damage: [&dyn Fn(); 2] =
            [&|| std::fs::write(&path, &good[1..]).unwrap(), &|| std::fs::remove_file(&path).unwrap()];
        for damage in damage {
            let until = async |status: u16| {
                let what = format!("{status} for {address}");
                eventually_async(&what, async || (get(&app, &address).await.status == status).then_some(())).await;
            };
            until(200).await;
            damage();
            let answer = get(&app, &address).await;
            assert!(answer.status != 200 || answer.body == good, "{address}: other bytes under its checksum");
            std::fs::write(path.with_extension("new"), &good).unwrap();
            std::fs::rename(path.with_extension("new"), &path).unwrap();
            until(200).await;
        }
    }
}

#[tokio::test]
async fn published_notes_are_served_where_the_page_looks_for_them() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path().join("fort.kilwa"), pack("Fort")).unwrap();
    write(dir.path().join("wall.kilwa"), pack("Wall")).unwrap();
    write(dir.path().join("fort.annotations.json"), "{\"type\":\"AnnotationPage\"}").unwrap();
    let app = site(dir.path());
    assert!(get(&app, "/m/fort").await.text().contains("data-annotations=\"/packs/fort.annotations.json\""));
    assert!(!get(&app, "/m/wall").await.text().contains("data-annotations"));
    let a = get(&app, "/packs/fort.annotations.json").await;
    assert_eq!((a.status.as_u16(), a.header("content-type")), (200, "application/json"));
    assert_eq!(a.header("cache-control"), "no-cache");
    assert_eq!(get(&app, "/packs/wall.annotations.json").await.status, 404);
    assert_eq!(get(&app, "/packs/none.annotations.json").await.status, 404);
}

#[tokio::test]
async fn a_list_of_holes_beside_a_pack_is_served_where_the_page_looks_for_it() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path().join("fort.kilwa"), pack("Fort")).unwrap();
    write(dir.path().join("wall.kilwa"), pack("Wall")).unwrap();
    write(dir.path().join("fort.holes.geojson"), "{\"name\":\"holes\"}").unwrap();
    let app = site(dir.path());
    assert!(get(&app, "/m/fort").await.text().contains("data-holes=\"/packs/fort.holes.geojson\""));
    assert!(!get(&app, "/m/wall").await.text().contains("data-holes"));
    let list = get(&app, "/packs/fort.holes.geojson").await;
    assert_eq!((list.status.as_u16(), list.header("content-type")), (200, "application/geo+json"));
    assert_eq!(list.header("cache-control"), "no-cache");
    for name in ["wall", "none"] {
        assert_eq!(get(&app, &format!("/packs/{name}.holes.geojson")).await.status, 404);
    }
}

#[tokio::test]
async fn any_site_may_embed_a_public_model_and_nothing_else() {
    let dir = tempfile::tempdir().unwrap();
    object(dir.path(), "fort", &[pack("Fort")], public());
    object(dir.path(), "grave", &[pack("Grave")], Access { state: AccessState::Restricted, ..public() });
    write(dir.path().join("wall.kilwa"), pack("Wall")).unwrap();
    let app = site(dir.path());
    let ancestors = async |url: &str| {
        let policy = get(&app, url).await.header("content-security-policy").to_owned();
        policy.rsplit_once("frame-ancestors ").map(|(_, who)| who.to_owned()).unwrap()
    };
    for url in ["/m/wall", "/fort/", "/viewer/", "/viewer/index.html"] {
        assert_eq!(ancestors(url).await, "'self'", "{url}");
        for query in ["?embed=1", "?pack=/packs/wall.kilwa&embed=bare"] {
            assert_eq!(ancestors(&format!("{url}{query}")).await, "*", "{url}{query}");
        }
    }
    for url in ["/?embed=1", "/grave/?embed=1", "/viewer/boot.js?embed=1", "/fort/?lang=embed"] {
        assert_eq!(ancestors(url).await, "'self'", "{url}");
    }
}

#[tokio::test]
async fn only_named_sites_may_frame_the_page_and_exchange_messages() {
    let dir = tempfile::tempdir().unwrap();
    object(dir.path(), "fort", &[pack("Fort")], public());
    write(dir.path().join("wall.kilwa"), pack("Wall")).unwrap();
    let museum = || vec!["https://museum.example".to_owned()];
    let policy = Policy::new(&museum(), &museum(), &[]).unwrap();
    let app = app(Site::new(Catalogue::open(dir.path()).unwrap(), page()).with_policy(policy));
    let meta = "<meta name=\"kilwa-origins\" content=\"https://museum.example\">";
    for url in ["/m/wall", "/fort/", "/viewer/", "/viewer/index.html", "/fort/?embed=1"] {
        let a = get(&app, url).await;
        assert_eq!(a.status, 200, "{url}");
        assert_eq!(a.text().matches(meta).count(), 1, "{url}: {}", a.text());
        assert!(a.header("content-security-policy").ends_with("frame-ancestors https://museum.example"), "{url}");
    }
    let module = get(&app, "/viewer/boot.js").await;
    assert_eq!(module.header("access-control-allow-origin"), "*", "modules of another site need it");
}

#[tokio::test]
async fn requests_have_ids_and_unexpected_bodies_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    write(dir.path().join("fort.kilwa"), noise(10, 1)).unwrap();
    let app = site(dir.path());
    assert_eq!(
        ask(&app, "GET", "/", &[("x-request-id", "my-own-name-1")]).await.header("x-request-id"),
        "my-own-name-1"
    );
    let own = get(&app, "/packs/fort.kilwa").await.header("x-request-id").to_owned();
    assert!(own.len() > 10);
    let text = get(&app, "/metrics").await.text();
    assert!(text.contains("kilwa_answers_total{route=\"pack\",status=\"200\"} 1"), "{text}");
    assert!(text.contains("kilwa_models 1"));
    for (name, value, status) in [
        ("x-forwarded-proto", "https", 404),
        ("x-forwarded-host", "museum.example", 404),
        ("cf-connecting-ip", "203.0.113.9", 404),
        ("via", "1.1 proxy", 404),
        ("host", "museum.example", 404),
        ("host", "127.0.0.1.evil.example:8080", 404),
        ("host", "localhost@evil.example", 404),
        ("host", "localhost:8080", 200),
        ("host", "127.0.0.1:8080", 200),
        ("host", "[::1]:8080", 200),
    ] {
        assert_eq!(ask(&app, "GET", "/metrics", &[(name, value)]).await.status, status, "{name}: {value}");
    }
    let through_a_proxy = ask(&app, "GET", "/metrics", &[("x-forwarded-for", "203.0.113.9")]).await;
    assert_eq!(through_a_proxy.status, 404);
    assert_eq!(get(&app, "/healthz").await.text(), "ok\n");
    std::fs::remove_dir_all(dir.path()).unwrap();
    assert_eq!(get(&app, "/healthz").await.status, 503);
}

#[tokio::test]
async fn long_notes_are_sent_buffer_by_buffer_with_an_etag_of_their_content() {
    let dir = tempfile::tempdir().unwrap();
    object(dir.path(), "fort", &[pack("fort")], public());
    let notes = noise(300_000, 5);
    std::fs::write(dir.path().join("fort/annotations.json"), &notes).unwrap();
    std::fs::write(dir.path().join("plain.kilwa"), pack("plain")).unwrap();
    std::fs::write(dir.path().join("plain.annotations.json"), &notes).unwrap();
    let app = fresh_site(dir.path());
    let tag = format!("\"{}\"", blake3::hash(&notes).to_hex());
    for address in ["/fort/annotations.json", "/packs/plain.annotations.json"] {
        let whole = get(&app, address).await;
        assert_eq!((whole.status.as_u16(), whole.header("etag"), whole.body[..] == notes[..]), (200, &*tag, true));
        assert_eq!((whole.header("content-type"), whole.header("cache-control")), ("application/json", "no-cache"));
        assert_eq!(ask(&app, "GET", address, &[("if-none-match", &tag)]).await.status, 304);
        let head = ask(&app, "HEAD", address, &[]).await;
        assert_eq!((head.header("content-length"), head.body.len()), ("300000", 0));
    }
    let longer = noise(300_001, 6);
    std::fs::write(dir.path().join("fort/annotations.json"), &longer).unwrap();
    assert!(get(&app, "/fort/annotations.json").await.body[..] == longer[..]);
}
