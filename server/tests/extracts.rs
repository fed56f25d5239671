//! Meshes for other programs: requested by a form, made while a page waits, sent as a file, to readers with access to the model.

#[path = "../src/extracts/fake.rs"]
#[allow(dead_code, reason = "the tests of the module use all of it")]
mod fake;

use crate::common::{Answer, ask, get, object, pack, page, public};
use crate::eventually::eventually_async;
use axum::Router;
use axum::body::Body;
use axum::http::Request;
use fake::Fake;
use kilwa_archive::manifest::{Access, AccessState};
use kilwa_server::access::{Accounts, Grant};
use kilwa_server::auth::Auth;
use kilwa_server::extracts::{Detail, Extractor, Extracts, Failure, Format, Pack};
use kilwa_server::{Catalogue, Clock, Site, app};
use std::sync::Arc;
use tower::ServiceExt;

struct Archive {
    app: Router,
    fake: Arc<Fake>,
    folder: tempfile::TempDir,
}

fn archive() -> Archive {
    let folder = tempfile::tempdir().unwrap();
    let models = folder.path().join("models");
    std::fs::create_dir(&models).unwrap();
    let closed = |state| Access { state, reason: Some("Graves.".to_owned()), ..public() };
    let mut fort = object(&models, "fort", &[pack("fort"), pack("fort again")], public());
    fort.versions[1].figures.triangles = 1_000_000;
    std::fs::write(models.join("fort/manifest.json"), fort.to_bytes().unwrap()).unwrap();
    object(&models, "cave", &[pack("cave")], closed(AccessState::Restricted));
    object(&models, "gone", &[pack("gone")], closed(AccessState::Withdrawn));
    std::fs::write(models.join("plain.kilwa"), pack("Plain pack")).unwrap();
    let mut accounts = Accounts::new().unwrap();
    accounts.set_user("amina", &Grant::Objects(vec!["cave".to_owned()]), Some("a long sentence")).unwrap();
    accounts.set_user("omar", &Grant::Objects(Vec::new()), Some("another sentence")).unwrap();
    accounts.create(&folder.path().join("access.json")).unwrap();
    let fake = Arc::new(Fake::default());
    let mut site = Site::new(Catalogue::open(&models).unwrap(), page());
    site.clock = Clock::new(|| 1_795_262_400);
    site.behind_proxy = true;
    site.auth = Some(Arc::new(Auth::open(&folder.path().join("access.json"), None).unwrap()));
    let cache = folder.path().join("cache");
    site.extracts = Some(Extracts::with_extractor(cache, 140_000_000, fake.extractor()).unwrap());
    Archive { app: app(site), fake, folder }
}

impl Archive {
    async fn post(&self, uri: &str, cookie: &str, form: &str) -> Answer {
        let request = Request::post(uri).header("host", "museum.example").header("cookie", cookie);
        let response = self.app.clone().oneshot(request.body(Body::from(form.to_owned())).unwrap()).await.unwrap();
        Answer::of(response).await
    }

    async fn sign_in(&self, name: &str, password: &str) -> String {
        let form = format!("name={name}&password={}&next=%2F", password.replace(' ', "+"));
        let answer = self.post("/sign-in", "", &form).await;
        answer.header("set-cookie").split(';').next().unwrap_or_default().to_owned()
    }

    /// Until the file of an address is there.
    async fn made(&self, uri: &str, cookie: &str) -> Answer {
        let made = async || Some(ask(&self.app, "GET", uri, &[("cookie", cookie)]).await).filter(|a| a.status != 202);
        eventually_async(uri, made).await
    }
}

#[tokio::test]
async fn the_form_leads_to_a_waiting_page_and_then_to_the_file() {
    let a = archive();
    let form = get(&a.app, "/fort/extract").await;
    assert_eq!(form.status, 200);
    let html = form.text();
    assert!(
        html.contains("action=\"/fort/extract\"") && html.contains("value=\"stl\"") && html.contains("1,000,000"),
        "{html}"
    );
    assert!(!html.contains("<script") && !html.contains(" style="));
    a.fake.waits(true);
    let begun = a.post("/fort/extract", "", "format=ply&detail=triangles&triangles=100%20000&lang=fr").await;
    assert_eq!((begun.status.as_u16(), begun.header("location")), (303, "/fort/extract/v2-100000.ply?page=1&lang=fr"));
    let waits = get(&a.app, "/fort/extract/v2-100000.ply?page=1&lang=fr").await;
    assert_eq!(waits.status, 202);
    assert!(
        waits.text().contains("http-equiv=\"refresh\"") && waits.text().contains("en préparation"),
        "{}",
        waits.text()
    );
    assert_eq!(get(&a.app, "/fort/extract/v2-100000.ply").await.status, 202, "a program waits at the same address");
    a.fake.waits(false);
    let ready = a.made("/fort/extract/v2-100000.ply?page=1", "").await;
    assert_eq!(ready.status, 200);
    assert!(ready.text().contains("url=/fort/extract/v2-100000.ply\""), "the download begins: {}", ready.text());
    let file = get(&a.app, "/fort/extract/v2-100000.ply").await;
    assert!(file.status == 200 && file.text().starts_with("ply 100000 of pack."), "{}", file.text());
    assert_eq!(file.header("content-disposition"), "attachment; filename=\"fort-v2-100000.ply\"");
    let etag = file.header("etag").to_owned();
    let part = ask(&a.app, "GET", "/fort/extract/v2-100000.ply", &[("range", "bytes=4-9"), ("if-range", &etag)]).await;
    assert_eq!((part.status.as_u16(), part.text().as_str()), (206, "100000"));
    assert_eq!(ask(&a.app, "GET", "/fort/extract/v2-100000.ply", &[("if-none-match", &etag)]).await.status, 304);
    // Every kind, of an earlier version, and of a pack without metadata.
    for (post, form, name) in [
        ("/fort/extract", "format=stl&detail=whole", "/fort/extract/v2-whole.stl"),
        ("/fort/extract", "format=ply&detail=error&error=0,05", "/fort/extract/v2-0.05m.ply"),
        ("/plain/extract", "format=glb&detail=whole", "/plain/extract/v1-whole.glb"),
    ] {
        assert_eq!(a.post(post, "", form).await.status, 303, "{form}");
        assert_eq!(a.made(name, "").await.status, 200, "{name}");
    }
    assert_ne!(get(&a.app, "/fort/extract/v2-whole.stl").await.header("etag"), etag);
}

/// The server sends a file of the cache only if it is the one that it made.
#[cfg(unix)]
#[tokio::test]
async fn a_modified_file_in_the_cache_is_made_again() {
    let a = archive();
    let (form, name) = ("format=stl&detail=whole", "/fort/extract/v2-whole.stl");
    let make = async || {
        assert_eq!(a.post("/fort/extract", "", form).await.status, 303);
        let made = a.made(name, "").await;
        assert_eq!(made.status, 200, "{}", made.text());
        made.body
    };
    let good = make().await;
    let cache = a.folder.path().join("cache");
    let file = std::fs::read_dir(&cache).unwrap().map(|e| e.unwrap().path()).find(|p| p.is_file()).unwrap();
    let mode = std::os::unix::fs::PermissionsExt::mode(&file.metadata().unwrap().permissions());
    assert_eq!(mode & 0o777, 0o600, "not readable by other users of the computer, even if the folder is");
    std::fs::write(a.folder.path().join("secret"), "secret").unwrap();
    let changes: [&dyn Fn(); 4] = [
        &|| std::fs::write(&file, &good[..10]).unwrap(),
        &|| {
            std::fs::remove_file(&file).unwrap();
            std::os::unix::fs::symlink("../secret", &file).unwrap();
        },
        &|| {
            std::fs::remove_file(&file).unwrap();
            assert!(std::process::Command::new("mkfifo").arg(&file).status().unwrap().success());
        },
        &|| std::fs::remove_dir_all(&cache).unwrap(),
    ];
    for (i, change) in changes.into_iter().enumerate() {
        change();
        assert_eq!(get(&a.app, name).await.status, 404, "change {i}");
        assert_eq!(make().await, good, "change {i}");
    }
}

#[tokio::test]
async fn unrequested_extracts_and_invalid_names_are_refused_with_a_message() {
    let a = archive();
    let never = get(&a.app, "/fort/extract/v1-whole.ply").await;
    assert_eq!(never.status, 404);
    assert!(never.text().contains("Nothing is being made"), "{}", never.text());
    for lost in [
        "/fort/extract/x",
        "/fort/extract/v9-whole.ply",
        "/fort/extract/v1-whole.exe",
        "/none/extract",
        "/plain/extract/v2-whole.ply",
    ] {
        assert_eq!(get(&a.app, lost).await.status, 404, "{lost}");
    }
    for bad in [
        "",
        "format=ply",
        "format=ply&detail=triangles&triangles=0",
        "format=exe&detail=whole",
        "format=ply&detail=error&error=nan",
    ] {
        let answer = a.post("/fort/extract", "", bad).await;
        assert_eq!(answer.status, 422, "{bad}");
        assert!(answer.text().contains("This is not a valid size"), "{bad}: {}", answer.text());
    }
    // A tiny error limit means every triangle.
    for large in ["format=obj&detail=whole", "format=obj&detail=error&error=0.000001"] {
        let large = a.post("/fort/extract", "", large).await;
        assert_eq!(large.status, 422);
        assert!(large.text().contains("150") && large.text().contains("140"), "{}", large.text());
    }
    a.fake.fails(Failure::Full);
    assert_eq!(a.post("/fort/extract", "", "format=ply&detail=triangles&triangles=7").await.status, 303);
    let full = a.made("/fort/extract/v2-7.ply?page=1", "").await;
    assert_eq!(full.status, 507);
    assert!(full.text().contains("disk is full") && !full.text().contains("http-equiv=\"refresh\""), "{}", full.text());
    let foreign =
        Request::post("/fort/extract").header("host", "museum.example").header("origin", "https://evil.example");
    let refused = a.app.clone().oneshot(foreign.body(Body::from("format=ply&detail=whole")).unwrap()).await.unwrap();
    assert_eq!(refused.status(), 403);
}

#[tokio::test]
async fn extracts_need_access_to_the_model_and_no_script() {
    let a = archive();
    let closed = get(&a.app, "/cave/extract").await;
    assert_eq!(closed.status, 403);
    assert!(closed.text().contains("Graves.") && closed.text().contains("/sign-in?next="), "{}", closed.text());
    let form = "format=ply&detail=whole";
    assert_eq!(a.post("/cave/extract", "", form).await.status, 403);
    assert_eq!(get(&a.app, "/gone/extract").await.status, 410);
    std::fs::remove_dir_all(a.folder.path().join("models/gone/v1")).unwrap();
    for gone in ["/gone/extract", "/gone/extract/v1-whole.ply"] {
        assert_eq!(get(&a.app, gone).await.status, 410, "{gone}");
    }
    let omar = a.sign_in("omar", "another sentence").await;
    assert_eq!(a.post("/cave/extract", &omar, form).await.status, 403, "signed in, and not granted it");
    let amina = a.sign_in("amina", "a long sentence").await;
    let begun = a.post("/cave/extract", &amina, form).await;
    assert_eq!(begun.status, 303);
    let set = begun.header("set-cookie").to_owned();
    assert!(set.starts_with("kilwa_pack=") && set.contains("HttpOnly") && set.contains("Path=/cave/"), "{set}");
    let leave = set.split(';').next().unwrap().to_owned();
    let file = a.made("/cave/extract/v1-whole.ply", &leave).await;
    assert_eq!((file.status.as_u16(), file.header("cache-control")), (200, "private, no-store"));
    for stranger in ["", omar.as_str(), "kilwa_pack=x"] {
        let refused = ask(&a.app, "GET", "/cave/extract/v1-whole.ply", &[("cookie", stranger)]).await;
        assert_eq!(refused.status, 403, "it is made, and still not for {stranger:?}");
        assert!(!refused.text().contains("of pack."));
    }
}

#[tokio::test]
async fn the_page_of_a_model_links_to_its_downloads() {
    let a = archive();
    let plain = get(&a.app, "/m/plain").await.text();
    assert!(plain.contains("href=\"/plain/extract\""), "{plain}");
    // Without a cache there are no extracts to link to.
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("plain.kilwa"), pack("Plain pack")).unwrap();
    let app = app(Site::new(Catalogue::open(folder.path()).unwrap(), page()));
    assert!(!get(&app, "/m/plain").await.text().contains("/extract"));
    assert_eq!(get(&app, "/plain/extract").await.status, 404);
}

#[tokio::test]
async fn a_network_over_its_share_of_the_queue_learns_why_and_when_to_retry() {
    let a = archive();
    a.fake.waits(true);
    let order = |triangles: usize, client: &str, accept: &str| {
        let request = Request::post("/fort/extract").header("host", "museum.example").header("accept", accept);
        // Everything before the last entry was supplied by the client itself.
        let request = request.header("x-forwarded-for", format!("203.0.113.{}, {client}", triangles % 250));
        let form = format!("format=ply&detail=triangles&triangles={triangles}");
        let (app, request) = (a.app.clone(), request.body(Body::from(form)).unwrap());
        async move { Answer::of(app.oneshot(request).await.unwrap()).await }
    };
    let stands = |name: &str| {
        let (app, name) = (a.app.clone(), name.to_owned());
        async move { ask(&app, "GET", &format!("/fort/extract/v2-{name}.ply"), &[("accept", "application/json")]).await }
    };
    assert_eq!(order(1, "2001:db8:1:2::1", "text/html").await.status, 303);
    // A busy machine may take a while to start the worker; what is next can be said only when it has begun.
    let begun = async || stands("1").await.text().contains("\"running\"").then_some(());
    eventually_async("the first file is being made", begun).await;
    let (mut taken, mut refused) = (vec![1], 0);
    for n in 2..=100 {
        // One /64 is one network.
        let answer = order(n, &format!("2001:db8:1:2::{n:x}"), "text/html").await;
        match answer.status.as_u16() {
            303 => taken.push(n),
            429 => {
                let seconds: u64 = answer.header("retry-after").parse().unwrap();
                assert!((5..=600).contains(&seconds));
                assert!(answer.text().contains("Your network already has 4 files in the queue"), "{}", answer.text());
                refused += 1;
            }
            other => panic!("{other}: {}", answer.text()),
        }
    }
    assert_eq!(taken.len() + refused, 100);
    let workers = std::thread::available_parallelism().unwrap().get();
    assert!(taken.len() <= 4 + workers, "{taken:?}");
    let json = order(200, "2001:db8:1:2::1", "application/json").await;
    let report: serde_json::Value = serde_json::from_slice(&json.body).unwrap();
    assert_eq!((json.status.as_u16(), report["seconds"].as_u64()), (429, json.header("retry-after").parse().ok()));
    // Another network is next, whatever the first asked for.
    assert_eq!(order(300, "2001:db8:1:3::1", "text/html").await.status, 303);
    let next = stands("300").await;
    let report: serde_json::Value = serde_json::from_slice(&next.body).unwrap();
    assert_eq!(next.status, 202);
    assert!(report["state"] == "running" || report["before"] == 0, "{report}");
    let last = taken.last().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&stands(&last.to_string()).await.body).unwrap();
    assert!(report["state"] == "waiting" && report["seconds"].is_null(), "nothing was measured yet: {report}");
    let page = get(&a.app, &format!("/fort/extract/v2-{last}.ply?page=1")).await.text();
    assert!(page.contains("Files ahead of it") && page.contains("cannot be estimated yet"), "{page}");
    a.fake.waits(false);
    for n in taken {
        assert_eq!(a.made(&format!("/fort/extract/v2-{n}.ply"), "").await.status, 200);
    }
    // Now it is known how long they take.
    a.fake.waits(true);
    for n in [401, 402, 403] {
        assert_eq!(order(n, "198.51.100.7", "text/html").await.status, 303);
    }
    let page = get(&a.app, "/fort/extract/v2-403.ply?page=1").await.text();
    // How long depends on how long this machine took for the others.
    assert!(page.contains("Estimated time left:") && !page.contains("cannot be estimated"), "{page}");
    a.fake.waits(false);
}
