//! `site.toml`: whose archive it is, as people see it in the portal, and what becomes of mistakes in it.

use crate::common::{LogCapture, ask, fresh, get, object, pack, page, public};
use axum::Router;
use kilwa_archive::manifest::{Access, AccessState, Manifest};
use kilwa_server::index::Index;
use kilwa_server::{Clock, SITE_FILE, Site, SiteFile, app, report_featured};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// 2026-11-21T12:00:00Z, and the first second of 2027.
const NOW: u64 = 1_795_262_400;
const NEW_YEAR: u64 = 1_798_761_600;

const SITE: &str = r#"name = "Museum of <Kilwa>"
logo = "logo.svg"
featured = ["gereza", "songo-mnara"]
imprint = "https://museum.example/imprint?a=1&b=2"
contact = """Museum
Street <1>"""

[introduction]
en = """Towns of stone.

On the coast."""
sw = "Miji ya mawe."
"#;
const SVG: &str =
    "<svg xmlns=\"http://www.w3.org/2000/svg\"><script>alert(1)</script><rect width=\"9\" height=\"9\"/></svg>";
const PNG: &[u8] = b"\x89PNG\r\n\x1a\nand so on";

fn published(folder: &Path, slug: &str, access: Access) -> Manifest {
    object(folder, slug, &[pack(slug)], access)
}

/// An archive with public objects, one under embargo, a restricted and a withdrawn one, and this `site.toml`.
fn archive(text: &str) -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let closed = |state, until: Option<&str>| Access { state, until: until.map(str::to_owned), ..public() };
    for slug in ["gereza", "songo-mnara"] {
        published(dir.path(), slug, public());
    }
    published(dir.path(), "panel", closed(AccessState::Embargo, Some("2027-01-01")));
    published(dir.path(), "cave", closed(AccessState::Restricted, None));
    published(dir.path(), "gone", closed(AccessState::Withdrawn, None));
    write(&dir, SITE_FILE, text);
    write(&dir, "logo.svg", SVG);
    dir
}

fn write(dir: &tempfile::TempDir, name: &str, content: impl AsRef<[u8]>) {
    // Another file each time, as most editors write it.
    std::fs::write(dir.path().join(".new"), content).unwrap();
    std::fs::rename(dir.path().join(".new"), dir.path().join(name)).unwrap();
}

/// The site, which looks at everything for every request.
fn site(dir: &tempfile::TempDir) -> Site {
    let mut site = Site::new(fresh(dir.path()), page());
    let index = Index::open(dir.path(), None).unwrap();
    index.refresh().unwrap();
    site.index = Some(Arc::new(index));
    let file = SiteFile::beside(site.catalogue.shelf().unwrap()).with_freshness(Duration::ZERO);
    site.institution = Some(Arc::new(file));
    site.clock = Clock::new(|| NOW);
    site
}

fn serve(dir: &tempfile::TempDir) -> Router {
    app(site(dir))
}

/// The larger cards, by their addresses.
async fn featured(app: &Router) -> Vec<String> {
    let html = get(app, "/").await.text();
    let Some((_, rest)) = html.split_once("class=\"featured\"") else { return Vec::new() };
    let section = rest.split("</section>").next().unwrap();
    section
        .split("<h3")
        .skip(1)
        .map(|h| h.split("href=\"").nth(1).unwrap().split('"').next().unwrap().to_owned())
        .collect()
}

#[tokio::test]
async fn the_front_page_introduces_the_institution_and_its_featured_models_before_the_catalogue() {
    let dir = archive(SITE);
    let app = serve(&dir);
    let html = get(&app, "/").await.text();
    let at = |what: &str| html.find(what).unwrap_or_else(|| panic!("{what}\n{html}"));
    assert!(html.contains("<title>Models - Museum of &lt;Kilwa&gt;</title>"));
    let order = [
        "<img src=\"/logo.svg\" alt=\"\"",
        "<h1 lang=\"en\" dir=\"auto\">Museum of &lt;Kilwa&gt;</h1>",
        "Towns of stone.</p>",
        "On the coast.</p>",
        "Featured models",
        "href=\"/gereza/\"",
        "href=\"/songo-mnara/\"",
        "<form id=\"search\"",
        "class=\"portal-body\"",
        "<footer",
    ];
    assert!(order.map(at).is_sorted(), "{:?}\n{html}", order.map(at));
    assert_eq!(featured(&app).await, ["/gereza/", "/songo-mnara/"], "in the order of the file");
    assert_eq!(html.matches("<h1").count(), 1);
    assert!(!html.contains("<script") && !html.contains(" style=") && !html.contains("<Kilwa>"));
    // A search has the name and the notices, and is otherwise a search.
    let search = get(&app, "/?q=gereza").await.text();
    assert!(!search.contains("Towns of stone") && !search.contains("class=\"featured\""), "{search}");
    assert!(search.contains("<h1>Models</h1>") && search.contains("class=\"brand\""), "{search}");
}

#[tokio::test]
async fn every_page_of_the_portal_has_the_name_and_the_notices() {
    let dir = archive(SITE);
    let app = serve(&dir);
    let long = format!("/?q={}", "x".repeat(3000));
    let many = format!("/?{}", (0..20).map(|n| format!("kind={n}")).collect::<Vec<_>>().join("&"));
    for address in ["/", "/?q=xyzzy", "/map", "/collections/", &long, &many, "/nothing/", "/no/such/thing"] {
        let html = get(&app, address).await.text();
        assert!(html.contains("Museum of &lt;Kilwa&gt;"), "{address}\n{html}");
        let imprint = "<a href=\"https://museum.example/imprint?a=1&amp;b=2\">Legal notice</a>";
        assert!(html.contains(imprint) && html.contains("Museum\nStreet &lt;1&gt;</p>"), "{address}\n{html}");
    }
}

#[tokio::test]
async fn an_address_that_leads_nowhere_has_a_page_in_the_readers_language() {
    let dir = archive(SITE);
    let app = serve(&dir);
    for (language, wanted) in [("en", "There is nothing at this address"), ("fr", "Il n’y a rien à cette adresse")] {
        let lost = ask(&app, "GET", "/nothing/", &[("accept-language", language)]).await;
        assert_eq!(lost.status, 404);
        assert!(lost.text().contains(wanted) && lost.text().contains("<footer"), "{}", lost.text());
        assert!(lost.header("vary").contains("Accept-Language"), "{}", lost.header("vary"));
    }
}

#[tokio::test]
async fn texts_are_in_the_readers_language_where_they_are_given_in_it() {
    let dir = archive(SITE);
    let app = serve(&dir);
    let swahili = get(&app, "/?lang=sw").await.text();
    assert!(swahili.contains("Miji ya mawe.") && !swahili.contains("Towns of stone"), "{swahili}");
    assert!(swahili.contains("<div class=\"introduction\" lang=\"sw\""));
    let arabic = get(&app, "/?lang=ar").await.text();
    assert!(arabic.contains("<div class=\"introduction\" lang=\"en\"") && arabic.contains("dir=\"rtl\""), "{arabic}");
    let accepted = ask(&app, "GET", "/", &[("accept-language", "sw")]).await;
    assert!(accepted.text().contains("Miji ya mawe."));
}

#[tokio::test]
async fn without_a_site_file_the_portal_has_no_institution() {
    let dir = archive(SITE);
    std::fs::remove_file(dir.path().join(SITE_FILE)).unwrap();
    let app = serve(&dir);
    let html = get(&app, "/").await.text();
    assert!(html.contains("<h1>Models</h1>") && html.contains(" Kilwa</a>") && !html.contains("<footer"), "{html}");
    for (address, status) in [("/logo.svg", 404), ("/logo.png", 404), ("/site.css", 200), ("/site.toml", 404)] {
        assert_eq!(get(&app, address).await.status, status, "{address}");
    }
}

#[tokio::test]
async fn only_public_models_are_featured_and_the_log_says_what_is_left_out() {
    let log = LogCapture::listen();
    let text = "name = \"M\"\n\nfeatured = [\"panel\", \"gereza\", \"cave\", \"gone\", \"gerezza\"]\n";
    let dir = archive(text);
    let mut site = site(&dir);
    let clock = Arc::new(AtomicU64::new(NOW));
    let time = Arc::clone(&clock);
    site.clock = Clock::new(move || time.load(Ordering::Relaxed));
    report_featured(&site).await;
    let lines = || log.about(dir.path().join(SITE_FILE).to_str().unwrap());
    let about =
        |slug: &str| lines().into_iter().filter(|line| line.contains(&format!("line 3: featured: {slug} "))).count();
    assert_eq!(["panel", "gereza", "cave", "gone", "gerezza"].map(about), [1, 0, 1, 1, 1], "{:?}", lines());
    let app = app(site);
    for _ in 0..3 {
        assert_eq!(featured(&app).await, ["/gereza/"]);
    }
    assert_eq!(lines().len(), 4, "each of them once: {:?}", lines());
    clock.store(NEW_YEAR - 1, Ordering::Relaxed);
    assert_eq!(featured(&app).await, ["/gereza/"], "the last second of the embargo");
    clock.store(NEW_YEAR, Ordering::Relaxed);
    assert_eq!(featured(&app).await, ["/panel/", "/gereza/"]);
}

/// The index may be a second old; the manifest decides.
#[tokio::test]
async fn a_model_that_is_closed_while_serving_is_no_longer_featured() {
    let dir = archive(SITE);
    let app = serve(&dir);
    assert_eq!(featured(&app).await, ["/gereza/", "/songo-mnara/"]);
    for state in [AccessState::Restricted, AccessState::Withdrawn] {
        let mut manifest = Manifest::parse(&std::fs::read(dir.path().join("gereza/manifest.json")).unwrap()).unwrap();
        manifest.access.state = state;
        write(&dir, "gereza/manifest.json", manifest.to_bytes().unwrap());
        assert_eq!(featured(&app).await, ["/songo-mnara/"], "{state:?}");
    }
}

#[tokio::test]
async fn the_logo_is_sent_with_its_type_and_can_run_nothing() {
    let dir = archive(SITE);
    let app = serve(&dir);
    let logo = get(&app, "/logo.svg").await;
    assert_eq!((logo.status.as_u16(), logo.text().as_str()), (200, SVG));
    assert_eq!((logo.header("content-type"), logo.header("x-content-type-options")), ("image/svg+xml", "nosniff"));
    let policies: Vec<_> = logo.headers.get_all("content-security-policy").iter().collect();
    assert_eq!(policies, ["default-src 'none'; style-src 'unsafe-inline'; img-src data:; sandbox"]);
    assert_eq!(logo.header("cache-control"), "no-cache");
    let again = ask(&app, "GET", "/logo.svg", &[("if-none-match", logo.header("etag"))]).await;
    assert_eq!((again.status.as_u16(), again.body.len()), (304, 0));
    assert_eq!(get(&app, "/logo.png").await.status, 404, "it has one address");
    // Its content decides, not its name.
    write(&dir, "logo.svg", PNG);
    let png = get(&app, "/logo.png").await;
    assert_eq!((png.status.as_u16(), png.header("content-type"), &*png.body), (200, "image/png", PNG));
    assert_eq!(get(&app, "/logo.svg").await.status, 404);
    assert!(get(&app, "/").await.text().contains("<img src=\"/logo.png\""));
}

#[tokio::test]
async fn a_missing_or_unusable_logo_is_reported_and_the_page_works_without_it() {
    let log = LogCapture::listen();
    let dir = archive(SITE);
    let lines = |what: &str| {
        let here = dir.path().to_str().unwrap().to_owned();
        log.about(what).into_iter().filter(|line| line.contains(&here)).count()
    };
    std::fs::remove_file(dir.path().join("logo.svg")).unwrap();
    let app = serve(&dir);
    let has_logo = async || {
        let html = get(&app, "/").await.text();
        assert!(html.contains("Museum of &lt;Kilwa&gt;") && html.contains("Towns of stone"), "{html}");
        html.contains("<img src=\"/logo")
    };
    assert!(!has_logo().await && !has_logo().await);
    assert_eq!(lines("line 2: logo: there is no logo.svg beside this file"), 1, "once");
    write(&dir, "logo.svg", "GIF89a");
    assert!(!has_logo().await && !has_logo().await);
    assert_eq!(lines("logo.svg: this is not a PNG, SVG, JPEG or WebP picture"), 1);
    let mut large = SVG.as_bytes().to_vec();
    large.resize(300_001, b' ');
    write(&dir, "logo.svg", &large);
    assert!(!has_logo().await);
    assert_eq!(lines("logo.svg: it is 300 kB long; at most 300 kB are allowed"), 1);
    write(&dir, "logo.svg", SVG);
    assert!(has_logo().await, "as soon as there is one");
    // What was valid stays while what is there is not.
    write(&dir, "logo.svg", "no picture");
    assert!(has_logo().await);
    assert_eq!(get(&app, "/logo.svg").await.text(), SVG);
}

#[cfg(unix)]
#[tokio::test]
async fn no_link_is_followed_to_a_logo_or_a_site_file() {
    let log = LogCapture::listen();
    let outside = tempfile::tempdir().unwrap();
    for (name, secret) in [("logo.svg", "<svg>SECRET</svg>"), (SITE_FILE, "name = \"SECRET\"\n")] {
        let dir = archive(SITE);
        std::fs::write(outside.path().join(name), secret).unwrap();
        std::fs::remove_file(dir.path().join(name)).unwrap();
        std::os::unix::fs::symlink(outside.path().join(name), dir.path().join(name)).unwrap();
        let mut site = Site::new(fresh(dir.path()), page());
        site.institution = Some(Arc::new(SiteFile::beside(site.catalogue.shelf().unwrap())));
        let app = app(site);
        for address in ["/", "/logo.svg"] {
            assert!(!get(&app, address).await.text().contains("SECRET"), "{name} {address}");
        }
        let lines = log.about(dir.path().join(name).to_str().unwrap());
        assert_eq!(lines.iter().filter(|line| line.contains("it is a link")).count(), 1, "{name}: {lines:?}");
    }
}

/// Also one that was named, with the logo beside it.
#[tokio::test]
async fn changes_are_seen_without_a_restart_and_mistakes_leave_what_was_valid() {
    let log = LogCapture::listen();
    let dir = archive(SITE);
    std::fs::create_dir(dir.path().join("settings")).unwrap();
    for name in [SITE_FILE, "logo.svg"] {
        std::fs::rename(dir.path().join(name), dir.path().join("settings").join(name)).unwrap();
    }
    let mut site = site(&dir);
    let file = SiteFile::new(dir.path().join("settings").join(SITE_FILE)).with_freshness(Duration::ZERO);
    site.institution = Some(Arc::new(file));
    let app = app(site);
    let shows = async |what: &str| get(&app, "/").await.text().contains(what);
    assert!(shows("Museum of &lt;Kilwa&gt;").await && shows("<img src=\"/logo.svg\"").await);
    write(&dir, "settings/site.toml", "name = \"The archive\"\n");
    assert!(shows("The archive").await && !shows("Towns of stone").await && !shows("<img src=\"/logo").await);
    write(&dir, "settings/site.toml", "nmae = \"x\"\naccent = \"blue\"\nlogo = \"../x\"\n");
    assert!(shows("The archive").await);
    let lines: Vec<_> = log.about("site.toml").into_iter().filter(|line| line.contains("nmae")).collect();
    assert_eq!(lines.len(), 1, "once: {lines:?}");
    for wanted in
        ["line 1: nmae: ", "did you mean \"name\"?", "line 2: accent: \"blue\"", "line 3: logo: ", "last valid"]
    {
        assert!(lines[0].contains(wanted), "{wanted}: {lines:?}");
    }
    std::fs::remove_file(dir.path().join("settings/site.toml")).unwrap();
    assert!(!shows("The archive").await);
}

#[tokio::test]
async fn the_style_sheet_has_the_institutions_color_in_both_themes_readable_in_each() {
    let log = LogCapture::listen();
    let dir = archive("name = \"M\"\n");
    let app = serve(&dir);
    let plain = get(&app, "/site.css").await;
    assert_eq!(plain.header("content-type"), "text/css; charset=utf-8");
    assert!(!plain.text().contains("--accent:"), "Kilwa's own colours");
    assert!(get(&app, "/").await.text().contains("<link rel=\"stylesheet\" href=\"/site.css\">"));
    write(&dir, SITE_FILE, "name = \"M\"\naccent = \"#1D5A7A\"\n");
    let css = get(&app, "/site.css").await;
    assert!(css.text().contains(":root { --accent: #1d5a7a;") && css.text().matches("--accent: #").count() == 2);
    assert_ne!(css.header("etag"), plain.header("etag"));
    let same = ask(&app, "GET", "/site.css", &[("if-none-match", css.header("etag"))]).await;
    assert_eq!(same.status, 304);
    let about = || log.about(dir.path().join(SITE_FILE).to_str().unwrap());
    assert_eq!(about(), [""; 0]);
    write(&dir, SITE_FILE, "name = \"M\"\n\n[accent]\nlight = \"#ffcc00\"\ndark = \"#ffcc00\"\n");
    let css = get(&app, "/site.css").await.text();
    assert!(css.contains("{ --accent: #ffcc00; }") && !css.contains("--accent: #ffcc00; --accent-soft"), "{css}");
    let lines = about();
    assert!(lines.len() == 1 && lines[0].contains("line 4: accent.light: the contrast of #ffcc00 is 1."), "{lines:?}");
}

#[tokio::test]
async fn feeds_harvesters_and_other_sites_get_the_institutions_name() {
    let dir = archive(SITE);
    let app = serve(&dir);
    assert!(get(&app, "/feed.xml").await.text().contains("<title>Museum of &lt;Kilwa&gt;</title>"));
    let identify = get(&app, "/oai?verb=Identify").await.text();
    assert!(identify.contains("<repositoryName>Museum of &lt;Kilwa&gt;</repositoryName>"), "{identify}");
    let headers = [("host", "museum.example")];
    let embed = ask(&app, "GET", "/oembed?url=http%3A%2F%2Fmuseum.example%2Fgereza%2F", &headers).await.text();
    assert!(embed.contains("\"provider_name\":\"Museum of <Kilwa>\""), "{embed}");
}

/// A folder of packs alone has no index, and a list without search.
#[tokio::test]
async fn a_folder_of_packs_is_introduced_too() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("plain.kilwa"), pack("Plain pack")).unwrap();
    write(&dir, SITE_FILE, SITE);
    let mut site = Site::new(fresh(dir.path()), page());
    site.institution = Some(Arc::new(SiteFile::beside(site.catalogue.shelf().unwrap())));
    let html = get(&app(site), "/").await.text();
    assert!(html.contains("<h1 lang=\"en\" dir=\"auto\">Museum of") && html.contains("Plain pack"), "{html}");
    assert!(!html.contains("class=\"featured\""));
}
