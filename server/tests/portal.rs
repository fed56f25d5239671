//! The portal, for people and for other systems, over published objects.

use crate::common::{Answer, LogCapture, ask, fresh, get, object, pack, page, public};
use crate::eventually::eventually_async;
use axum::body::{Body, Bytes};
use axum::http::{Request, StatusCode};
use http_body::{Frame, SizeHint};
use kilwa_archive::manifest::{Access, AccessState, Manifest};
use kilwa_server::index::{Facet, Index};
use kilwa_server::{COLLECTIONS_FILE, Catalogue, Clock, Collections, Site, app};
use std::path::Path;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::task::{Context, Poll};
use std::time::Duration;
use tower::ServiceExt as _;

fn portal(folder: &Path) -> axum::Router {
    let mut site = Site::new(Catalogue::open(folder).unwrap(), page());
    let index = Index::open(folder, None).unwrap();
    index.refresh().unwrap();
    site.index = Some(Arc::new(index));
    site.collections = Some(Arc::new(Collections::new(folder.join(COLLECTIONS_FILE))));
    site.url = Some("https://museum.example".to_owned());
    // 2026-11-21T12:00:00Z
    site.clock = Clock::new(|| 1_795_262_400);
    app(site)
}

/// An object with what the catalogue shows and searches.
fn published(folder: &Path, slug: &str, change: impl FnOnce(&mut Manifest)) {
    let mut manifest = object(folder, slug, &[pack(slug)], public());
    change(&mut manifest);
    std::fs::write(folder.join(slug).join("manifest.json"), manifest.to_bytes().unwrap()).unwrap();
}

fn archive() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    published(dir.path(), "gereza", |m| {
        m.title = "Gereza <Kilwa> & \"fort\"".into();
        m.subjects = vec!["fort".to_owned(), "coral stone".to_owned()];
        m.place = Some("Kilwa Kisiwani, Tanzania".to_owned());
        m.creators = vec!["Ñandú, A.".to_owned()];
        m.identifier = Some("https://doi.example/10.1/2".to_owned());
        m.versions[0].figures.triangles = 2_000_000;
    });
    published(dir.path(), "songo-mnara", |m| {
        m.title = "Songo Mnara, north wall".into();
        m.subjects = vec!["wall".to_owned(), "coral stone".to_owned()];
        m.versions[0].published = "2026-11-20".into();
    });
    published(dir.path(), "panel", |m| {
        m.title = "Rock art panel".into();
        m.access = Access { state: AccessState::Embargo, until: Some("2027-01-01".to_owned()), ..public() };
    });
    published(dir.path(), "gone", |m| {
        m.title = "What was here".into();
        m.access = Access { state: AccessState::Withdrawn, withdrawn: Some("2026-11-19".to_owned()), ..public() };
    });
    std::fs::write(dir.path().join("plain.kilwa"), pack("Plain pack")).unwrap();
    dir
}

fn titles(a: &Answer) -> Vec<&'static str> {
    let text = a.text();
    ["Gereza &lt;Kilwa&gt;", "Songo Mnara", "Rock art", "What was here", "Plain pack"]
        .into_iter()
        .filter(|title| text.contains(title))
        .collect()
}

/// `Vary` names the headers that absolute addresses depend on, so that a cache separates responses for different hosts.
#[tokio::test]
async fn responses_vary_by_host_unless_the_site_address_is_configured() {
    let dir = tempfile::tempdir().unwrap();
    object(dir.path(), "fort", &[pack("Fort")], public());
    let site = |url: Option<&str>, behind_proxy| {
        let mut site = Site::new(Catalogue::open(dir.path()).unwrap(), page());
        site.url = url.map(str::to_owned);
        site.behind_proxy = behind_proxy;
        app(site)
    };
    for (url, behind_proxy, wanted) in
        [(None, false, "Host"), (None, true, "Host, X-Forwarded-Proto"), (Some("https://museum.example"), true, "")]
    {
        let app = site(url, behind_proxy);
        for address in ["/", "/fort/", "/robots.txt", "/no-such/"] {
            let a = get(&app, address).await;
            let varies = a.headers.get_all("vary").iter().map(|v| v.to_str().unwrap()).filter(|v| v.contains("Host"));
            assert_eq!(varies.collect::<Vec<_>>().concat(), wanted, "{address}");
        }
        let pack = get(&app, "/fort/manifest.json").await;
        let manifest = kilwa_archive::Manifest::parse(&pack.body).unwrap();
        let pack = get(&app, &format!("/fort/{}", manifest.versions[0].pack.url)).await;
        assert_eq!(pack.header("vary"), "", "the bytes of a pack are the same everywhere");
    }
}

#[tokio::test]
async fn the_catalogue_lists_searches_and_narrows_without_a_script() {
    let dir = archive();
    let app = portal(dir.path());
    let all = get(&app, "/").await;
    assert_eq!(titles(&all), ["Gereza &lt;Kilwa&gt;", "Songo Mnara", "Rock art", "Plain pack"], "{}", all.text());
    let html = all.text();
    assert!(!html.contains("<script") && !html.contains(" style="), "no script, nothing that the policy forbids");
    assert!(html.contains("href=\"/gereza/\"") && html.contains("/gereza/v1/poster-600.jpg"));
    assert!(html.contains("&quot;fort&quot;") && !html.contains("<Kilwa>"));
    assert!(html.contains("Public from 1 January 2027 on"));
    assert!(
        html.contains("<bdi>Kilwa Kisiwani, Tanzania</bdi>") && html.contains("dir=\"auto\">Ñandú, A.</p>"),
        "{html}"
    );
    assert_eq!(titles(&get(&app, "/?q=gerez").await), ["Gereza &lt;Kilwa&gt;"]);
    assert_eq!(titles(&get(&app, "/?q=nandu").await), ["Gereza &lt;Kilwa&gt;"], "accents do not matter");
    assert_eq!(titles(&get(&app, "/?q=coral&sort=title").await), ["Gereza &lt;Kilwa&gt;", "Songo Mnara"]);
    assert_eq!(titles(&get(&app, "/?q=coral&size=1m-10m").await), ["Gereza &lt;Kilwa&gt;"]);
    assert_eq!(titles(&get(&app, "/?subject=wall&subject=fort").await), ["Gereza &lt;Kilwa&gt;", "Songo Mnara"]);
    let narrowed = get(&app, "/?subject=wall&q=mnara").await.text();
    assert!(narrowed.contains("value=\"wall\" checked") && narrowed.contains("href=\"/?q=mnara\""), "{narrowed}");
    for nothing in ["/?q=xyzzy", "/?page=99", "/?country=ZZ"] {
        let a = get(&app, nothing).await;
        assert_eq!((a.status.as_u16(), titles(&a).len()), (200, 0), "{nothing}");
    }
    assert!(get(&app, "/?q=xyzzy").await.text().contains("Nothing matches."));
    for hostile in ["/?q=%22%27%29%3B--&q=AND", "/?q=%00%ff*NEAR%28&page=-1", "/?subject=%3Cscript%3E&lang=%22%3E"] {
        let a = get(&app, hostile).await;
        assert_eq!(a.status, 200, "{hostile}");
        assert!(!a.text().contains("<script") && !a.text().contains("\"\">"), "{hostile}");
    }
}

/// Text from an address is shown as text, in every field of every page.
#[tokio::test]
async fn no_part_of_an_address_becomes_markup() {
    let dir = archive();
    let app = portal(dir.path());
    let pages = ["/", "/map", "/collections/", "/collections/x/", "/gereza/", "/gereza/extract", "/sign-in", "/oai"];
    let facets = Facet::ALL.map(Facet::name);
    let others = ["q", "sort", "lang", "page", "packs", "box", "verb", "identifier", "set", "metadataPrefix", "next"];
    for path in pages {
        for field in facets.iter().chain(&others) {
            for (mark, raw) in [("%3Ci+id%3Dzz%3E", "<i id=zz>"), ("%22zz%27%3E%3Cb%3E", "\"zz'><b>")] {
                let address = format!("{path}?{field}={mark}");
                let text = get(&app, &address).await.text();
                assert!(!text.contains(raw), "{address}: {text}");
            }
        }
    }
}

#[tokio::test]
async fn the_catalogue_is_available_in_five_languages() {
    let dir = archive();
    let app = portal(dir.path());
    let arabic = get(&app, "/?lang=ar&q=coral").await.text();
    assert!(arabic.contains("<html lang=\"ar\" dir=\"rtl\">") && arabic.contains("name=\"lang\" value=\"ar\""));
    assert!(arabic.contains("href=\"/?q=coral&amp;lang=sw\""), "the other languages keep the question");
    let a = ask(&app, "GET", "/", &[("accept-language", "sw, en;q=0.5")]).await;
    assert!(a.text().contains("<html lang=\"sw\"") && a.header("vary").contains("Accept-Language"));
}

#[tokio::test]
async fn cards_of_packs_without_metadata_are_in_the_readers_language_too() {
    let dir = archive();
    let swahili = get(&portal(dir.path()), "/?lang=sw").await.text();
    assert!(swahili.contains("Pakua furushi") && !swahili.contains("Download pack"), "{swahili}");
    let alone = tempfile::tempdir().unwrap();
    std::fs::write(alone.path().join("plain.kilwa"), pack("Plain pack")).unwrap();
    let list = get(&portal(alone.path()), "/?lang=fr").await.text();
    assert!(list.contains("<html lang=\"fr\"") && list.contains("Télécharger le paquet"), "{list}");
    assert!(list.contains("href=\"/m/plain?lang=fr\""), "the language goes along: {list}");
}

/// Where a model is by its box alone: UTM 37 S.
fn stands(m: &mut Manifest, east: f64, north: f64) {
    let figures = &mut m.versions[0].figures;
    figures.crs = Some("EPSG:32737".to_owned());
    figures.bounds = [[east, north, 0.0], [east + 50.0, north + 50.0, 9.0]].map(glam::DVec3::from);
}

#[tokio::test]
async fn the_map_shows_only_public_locations() {
    let dir = tempfile::tempdir().unwrap();
    published(dir.path(), "gereza", |m| stands(m, 556_800.0, 9_009_000.0));
    published(dir.path(), "songo", |m| stands(m, 560_000.0, 8_996_000.0));
    published(dir.path(), "nowhere", |_| {});
    let whole = get(&portal(dir.path()), "/map").await;
    assert_eq!(whole.status, 200);
    published(dir.path(), "hidden", |m| {
        stands(m, 300_000.0, 9_300_000.0);
        m.versions[0].location_redacted = true;
    });
    published(dir.path(), "closed", |m| {
        stands(m, 310_000.0, 9_300_000.0);
        m.access = Access { state: AccessState::Restricted, ..public() };
    });
    published(dir.path(), "gone", |m| {
        stands(m, 320_000.0, 9_300_000.0);
        m.access = Access { state: AccessState::Withdrawn, withdrawn: Some("2026-11-19".to_owned()), ..public() };
    });
    let app = portal(dir.path());
    let with_hidden = get(&app, "/map").await.text();
    assert_eq!(with_hidden, whole.text(), "not even a gap, another middle or a number reveals them");
    assert!(with_hidden.contains("href=\"/gereza/\"") && with_hidden.contains("href=\"/songo/\""));
    assert!(with_hidden.contains("Models on the map: 2") && with_hidden.contains("class=\"land\""));
    assert!(!with_hidden.contains("<script") && !with_hidden.contains(" style="));
    assert!(get(&app, "/map?q=songo&lang=ar").await.text().contains("href=\"/songo/?lang=ar\""));
    assert!(!get(&app, "/map?q=songo").await.text().contains("gereza"));
    for odd in ["/map?box=1,2", "/map?box=0,0,1,1", "/map?box=%22%3E", "/map?q=xyzzy"] {
        assert_eq!(get(&app, odd).await.status, 200, "{odd}");
    }
}

const COLLECTION: &str = "[[collection]]\nslug = \"coast\"\ntitle = \"The <coast>\"\ntext = \"\"\"One.\n\nTwo.\"\"\"\nmembers = [\"songo-mnara\", \"gone\", \"none\", \"gereza\"]\n";

#[tokio::test]
async fn a_collection_has_a_page_a_feed_and_is_a_set() {
    let dir = archive();
    std::fs::write(dir.path().join(COLLECTIONS_FILE), COLLECTION).unwrap();
    let app = portal(dir.path());
    let front = get(&app, "/").await.text();
    assert!(front.contains("href=\"/collections/coast/\"") && front.contains("The &lt;coast&gt;"), "{front}");
    assert!(get(&app, "/collections/").await.text().contains("The &lt;coast&gt;"));
    let page = get(&app, "/collections/coast/").await;
    assert_eq!(titles(&page), ["Gereza &lt;Kilwa&gt;", "Songo Mnara"], "{}", page.text());
    let text = page.text();
    assert!(text.find("Songo").unwrap() < text.find("Gereza").unwrap(), "in the order of the file");
    assert_eq!(text.matches("class=\"prose\"").count(), 2);
    let feed = get(&app, "/collections/coast/feed.xml").await.text();
    assert_eq!(feed.matches("<entry>").count(), 2, "{feed}");
    assert!(feed.contains("<id>https://museum.example/collections/coast/</id>"));
    assert_eq!(get(&app, "/collections/none/").await.status, 404);
    assert!(get(&app, "/sitemap.xml").await.text().contains("https://museum.example/collections/coast/"));
    let sets = get(&app, "/oai?verb=ListSets").await.text();
    assert!(sets.contains("<setSpec>coast</setSpec>\n<setName>The &lt;coast&gt;</setName>"), "{sets}");
    let set = get(&app, "/oai?verb=ListIdentifiers&metadataPrefix=oai_dc&set=coast").await.text();
    assert_eq!(set.matches("<identifier>").count(), 3, "what was withdrawn is a deleted record of it: {set}");
    assert!(set.contains("<setSpec>coast</setSpec>") && !set.contains(":panel<"));
    let other = get(&app, "/oai?verb=ListRecords&metadataPrefix=oai_dc&set=none").await.text();
    assert!(other.contains("noRecordsMatch"), "{other}");
}

#[tokio::test]
async fn new_objects_are_found_while_serving() {
    let dir = archive();
    let app = portal(dir.path());
    assert_eq!(get(&app, "/?q=husuni").await.text().matches("class=\"card\"").count(), 0);
    published(dir.path(), "husuni", |m| m.title = "Husuni Kubwa".into());
    let found = async || get(&app, "/?q=husuni").await.text().contains("Husuni Kubwa").then_some(());
    eventually_async("the new object in the catalogue", found).await;
    assert_eq!(get(&app, "/husuni/").await.status, 200);
}

/// Every check finds the same problem: one line is enough.
#[cfg(unix)]
#[tokio::test]
async fn a_link_or_a_pipe_in_place_of_the_collections_is_logged_once() {
    let log = LogCapture::listen();
    for wanted in ["it is a pipe", "it is a link"] {
        let dir = archive();
        let file = dir.path().join(COLLECTIONS_FILE);
        if wanted.ends_with("pipe") {
            assert!(std::process::Command::new("mkfifo").arg(&file).status().unwrap().success());
        } else {
            std::os::unix::fs::symlink("/etc/passwd", &file).unwrap();
        }
        let mut site = Site::new(fresh(dir.path()), page());
        let index = Index::open(dir.path(), None).unwrap();
        index.refresh().unwrap();
        site.index = Some(Arc::new(index));
        let collections = Collections::beside(site.catalogue.shelf().unwrap());
        site.collections = Some(Arc::new(collections.with_freshness(Duration::ZERO)));
        let app = app(site);
        let lines = || log.about("collections.toml").into_iter().filter(|line| line.contains(wanted)).count();
        for _ in 0..30 {
            assert_eq!(get(&app, "/collections/").await.status, 200);
        }
        assert_eq!(lines(), 1, "{wanted}");
        // A file in its place shows that it was looked at.
        std::fs::remove_file(&file).unwrap();
        std::fs::write(&file, "[[collection]]\nslug = \"coast\"\ntitle = \"The coast\"\nmembers = [\"gereza\"]\n")
            .unwrap();
        assert!(get(&app, "/collections/").await.text().contains("The coast"));
    }
}

#[tokio::test]
async fn landing_pages_are_signposted() {
    let dir = archive();
    let app = portal(dir.path());
    let a = ask(&app, "HEAD", "/gereza/", &[]).await;
    let link = a.header("link");
    for wanted in [
        "<https://doi.example/10.1/2>; rel=\"cite-as\"",
        "<https://creativecommons.org/licenses/by/4.0/>; rel=\"license\"",
        "<https://museum.example/gereza/v1/metadata/dc.xml>; rel=\"describedby\"; type=\"application/xml\"",
        "rel=\"item\"",
        "rel=\"type\"",
        "rel=\"alternate\"; type=\"application/json+oembed\"",
    ] {
        assert!(link.contains(wanted), "{wanted}: {link}");
    }
    assert!(!get(&app, "/panel/").await.header("link").contains("rel=\"item\""), "an embargo has no item yet");
    assert!(get(&app, "/gone/").await.header("link").is_empty());
}

#[tokio::test]
async fn oembed_answers_for_pages_of_this_site() {
    let dir = archive();
    let app = portal(dir.path());
    let a = get(&app, "/oembed?url=https%3A%2F%2Fmuseum.example%2Fgereza%2F&maxwidth=400").await;
    assert_eq!((a.status.as_u16(), a.header("content-type")), (200, "application/json"));
    let v: serde_json::Value = serde_json::from_slice(&a.body).unwrap();
    assert_eq!(
        (v["version"].as_str(), v["type"].as_str(), v["width"].as_u64()),
        (Some("1.0"), Some("rich"), Some(400))
    );
    assert!(v["html"].as_str().unwrap().contains("src=\"https://museum.example/gereza/?embed=1\""), "{v}");
    assert!(v["html"].as_str().unwrap().contains("&lt;Kilwa&gt;"));
    let xml = get(&app, "/oembed?url=https%3A%2F%2Fmuseum.example%2Fgereza%2F&format=xml").await.text();
    assert!(xml.contains("<oembed>") && xml.contains("<width>960</width>"), "{xml}");
    // Frames that other sites may not show are not handed out.
    let closed: serde_json::Value =
        serde_json::from_slice(&get(&app, "/oembed?url=https%3A%2F%2Fmuseum.example%2Fpanel%2F").await.body).unwrap();
    assert_eq!((closed["type"].as_str(), closed.get("html")), (Some("link"), None), "an embargo has no viewer yet");
    for (url, status) in [("gone%2F", 404), ("none%2F", 404), ("gereza%2F&format=yaml", 501)] {
        let a = get(&app, &format!("/oembed?url=https%3A%2F%2Fmuseum.example%2F{url}")).await;
        assert_eq!(a.status, status, "{url}");
    }
}

#[tokio::test]
async fn oai_pmh_responses_conform() {
    let dir = archive();
    let app = portal(dir.path());
    let oai = async |query: &str| {
        let a = get(&app, &format!("/oai?{query}")).await;
        assert_eq!(a.status, 200, "{query}");
        a.text()
    };
    let identify = oai("verb=Identify").await;
    assert!(identify.contains("<baseURL>https://museum.example/oai</baseURL>"), "{identify}");
    assert!(
        identify.contains("<deletedRecord>persistent</deletedRecord>")
            && identify.contains("2026-11-20</earliestDatestamp>")
    );
    assert!(identify.contains("<responseDate>2026-11-21T12:00:00Z</responseDate>"));
    assert!(oai("verb=ListMetadataFormats").await.contains("<metadataPrefix>oai_dc</metadataPrefix>"));
    let records = oai("verb=ListRecords&metadataPrefix=oai_dc").await;
    assert_eq!(records.matches("<record>").count(), 4, "{records}");
    assert!(records.contains("<metadata>\n<dc/>\n</metadata>"), "the object's own record");
    assert!(records.contains("<header status=\"deleted\">\n<identifier>oai:museum.example:gone</identifier>"));
    assert_eq!(
        oai("verb=ListIdentifiers&metadataPrefix=oai_dc&from=2026-11-20&until=2026-11-20")
            .await
            .matches("<header>")
            .count(),
        1
    );
    let one = oai("verb=GetRecord&metadataPrefix=oai_dc&identifier=oai:museum.example:gereza").await;
    assert!(one.contains("<request identifier=\"oai:museum.example:gereza\""), "{one}");
    for (query, code) in [
        ("", "badVerb"),
        ("verb=Nothing", "badVerb"),
        ("verb=Identify&x=1", "badArgument"),
        ("verb=ListRecords", "badArgument"),
        ("verb=ListRecords&metadataPrefix=oai_dc&metadataPrefix=oai_dc", "badArgument"),
        ("verb=ListRecords&metadataPrefix=marc", "cannotDisseminateFormat"),
        ("verb=ListRecords&metadataPrefix=oai_dc&from=yesterday", "badArgument"),
        ("verb=ListRecords&metadataPrefix=oai_dc&from=2030-01-01", "noRecordsMatch"),
        ("verb=ListRecords&resumptionToken=x,y,z,w", "badResumptionToken"),
        ("verb=ListRecords&metadataPrefix=oai_dc&set=a", "noSetHierarchy"),
        ("verb=ListSets", "noSetHierarchy"),
        ("verb=GetRecord&metadataPrefix=oai_dc&identifier=oai:museum.example:none", "idDoesNotExist"),
        ("verb=GetRecord&metadataPrefix=oai_dc&identifier=%3Cx%3E", "idDoesNotExist"),
    ] {
        let text = oai(query).await;
        assert!(text.contains(&format!("<error code=\"{code}\">")) && !text.contains("<x>"), "{query}: {text}");
    }
}

#[tokio::test]
async fn long_lists_are_harvested_in_pages() {
    let dir = tempfile::tempdir().unwrap();
    for number in 0..230 {
        published(dir.path(), &format!("m{number:03}"), |_| {});
    }
    let app = portal(dir.path());
    let (mut query, mut all) = ("metadataPrefix=oai_dc".to_owned(), std::collections::BTreeSet::new());
    for pages in 1.. {
        let text = get(&app, &format!("/oai?verb=ListIdentifiers&{query}")).await.text();
        all.extend(text.split("<identifier>").skip(1).map(|rest| rest.split('<').next().unwrap().to_owned()));
        let token = text.split("<resumptionToken>").nth(1).map(|rest| rest.split('<').next().unwrap().to_owned());
        let Some(token) = token else {
            assert_eq!(pages, 3);
            assert!(text.contains("<resumptionToken/>"));
            break;
        };
        query = format!("resumptionToken={token}");
    }
    assert_eq!(all.len(), 230);
    let first = get(&app, "/").await.text();
    assert_eq!(first.matches("class=\"card\"").count(), 24);
    assert!(first.contains("rel=\"next\" href=\"/?page=2\"") && first.contains("Page 1 of 10"), "{first}");
    assert_eq!(get(&app, "/?page=10").await.text().matches("class=\"card\"").count(), 230 - 9 * 24);
}

#[tokio::test]
async fn feed_and_sitemap_list_public_objects() {
    let dir = archive();
    let app = portal(dir.path());
    let feed = get(&app, "/feed.xml").await;
    assert!(feed.header("content-type").starts_with("application/atom+xml"));
    let text = feed.text();
    assert_eq!(text.matches("<entry>").count(), 3, "{text}");
    assert!(text.find("Gereza").unwrap() < text.find("Songo").unwrap(), "latest first");
    let sitemap = get(&app, "/sitemap.xml").await.text();
    assert!(sitemap.contains("<loc>https://museum.example/gereza/</loc>") && !sitemap.contains("gone"), "{sitemap}");
    assert!(get(&app, "/robots.txt").await.text().contains("Sitemap: https://museum.example/sitemap.xml"));
}

#[tokio::test]
async fn deleting_or_damaging_the_index_while_serving_loses_nothing() {
    let dir = archive();
    let scratch = tempfile::tempdir().unwrap();
    let file = scratch.path().join("index.sqlite");
    let mut site = Site::new(Catalogue::open(dir.path()).unwrap(), page());
    site.index = Some(Arc::new(Index::open(dir.path(), Some(&file)).unwrap()));
    let app = app(site);
    assert_eq!(titles(&get(&app, "/?q=gereza").await).len(), 1);
    std::fs::write(&file, b"this is no database at all").unwrap();
    for _ in 0..20 {
        let a = get(&app, "/?q=gereza").await;
        assert!(matches!(a.status.as_u16(), 200 | 503), "{}", a.status);
        assert_eq!(get(&app, "/gereza/").await.status, 200, "the models themselves are there");
    }
}

#[tokio::test]
async fn an_excessive_query_is_refused_with_what_to_do() {
    let dir = archive();
    let app = portal(dir.path());
    let many = |n: usize| (0..n).map(|i| format!("subject=s{i}")).collect::<Vec<_>>().join("&");
    assert_eq!(get(&app, &format!("/?{}", many(10))).await.status, 200);
    for path in ["/", "/map"] {
        let refused = get(&app, &format!("{path}?{}&lang=fr", many(11))).await;
        assert_eq!(refused.status, 400, "{path}");
        let html = refused.text();
        assert!(html.contains("On peut choisir au plus 10 valeurs") && html.contains("Sujet"), "{html}");
        let to = html.split("<a href=\"").find(|part| part.contains("subject=s0") && part.contains("10")).unwrap();
        let to = to.split('"').next().unwrap().replace("&amp;", "&");
        assert_eq!(get(&app, &to).await.status, 200, "the way on works: {to}");
    }
    for path in ["/", "/map", "/collections/", "/collections/x/", "/oai", "/gereza/extract"] {
        for filler in ["q=x", "lang=x", "verb=x", "box=0", "x"] {
            let long = get(&app, &format!("{path}?{filler}{}", "x".repeat(2048))).await;
            assert_eq!(long.status, 414, "{path} {filler}");
            assert!(long.text().contains("This address is too long.") && long.body.len() < 4096, "{path} {filler}");
        }
    }
    // What is within the limit as it came, and would not be in the page's own links.
    assert_eq!(get(&app, &format!("/?subject={}", "%ff".repeat(600))).await.status, 414);
    let unknown = get(&app, "/?lang=xxxxxxxx").await.text();
    assert!(!unknown.contains("xxxxxxxx"), "a language that is none goes into no link");
}

#[tokio::test]
async fn long_lists_are_divided_into_pages_without_loss() {
    let dir = tempfile::tempdir().unwrap();
    for n in 0..130 {
        published(dir.path(), &format!("fort-{n:03}"), |m| {
            m.versions[0].published = format!("2026-01-{:02}", n % 28 + 1);
        });
    }
    for n in 0..60 {
        std::fs::write(dir.path().join(format!("plain-{n:02}.kilwa")), pack("Plain pack")).unwrap();
    }
    let members = (0..130).map(|n| format!("\"fort-{n:03}\"")).collect::<Vec<_>>().join(",");
    let set = |slug: &str, members: &str| {
        format!("[[collection]]\nslug = \"{slug}\"\ntitle = \"A set\"\nmembers = [{members}]\n")
    };
    let mut sets = vec![set("all", &format!("\"none\",{members}"))];
    sets.extend((0..120).map(|n| set(&format!("s{n}"), "")));
    let sets = sets.concat();
    std::fs::write(dir.path().join(COLLECTIONS_FILE), sets).unwrap();
    let app = portal(dir.path());
    let pages = |path: &'static str, mark: &'static str, separator: &'static str| {
        let app = app.clone();
        async move {
            let mut found = std::collections::BTreeSet::new();
            for page in 1..=4 {
                let html = get(&app, &format!("{path}{page}")).await.text();
                assert!(page > 2 || html.contains(if page == 1 { "rel=\"next\"" } else { "rel=\"prev\"" }), "{html}");
                found.extend(html.split(mark).skip(1).map(|p| p.split(separator).next().unwrap().to_owned()));
            }
            found.len()
        }
    };
    assert_eq!(pages("/collections/all/?page=", "<h2 lang=\"en\" dir=\"auto\"><a href=\"", "\"").await, 130);
    assert!(get(&app, "/collections/all/").await.text().contains("Models: 130"), "those that are there");
    assert_eq!(pages("/collections/?page=", "<li><a href=\"/collections/", "/").await, 121);
    assert_eq!(pages("/?packs=", "<a href=\"/m/", "\"").await, 60);
    // The newest of all members, not of the first page.
    let feed = get(&app, "/collections/all/feed.xml").await.text();
    assert!(feed.contains("/fort-111/") && feed.matches("<entry>").count() == 50, "{feed}");
    let list: serde_json::Value = serde_json::from_slice(&get(&app, "/models.json").await.body).unwrap();
    assert_eq!(list["models"].as_array().unwrap().len(), 190);
    let sitemap = get(&app, "/sitemap.xml").await.text();
    assert_eq!(sitemap.matches("<loc>").count(), 1 + 121 + 130);
    assert!(sitemap.ends_with("</urlset>\n"));
    // Sets of OAI-PMH, by their tokens.
    let (mut sets, mut token) = (0, String::new());
    loop {
        let xml = get(&app, &format!("/oai?verb=ListSets{token}")).await.text();
        sets += xml.matches("<setSpec>").count();
        match xml.split("<resumptionToken>").nth(1) {
            Some(rest) => token = format!("&resumptionToken={}", rest.split('<').next().unwrap()),
            None => break,
        }
    }
    assert_eq!(sets, 121);
    assert!(get(&app, "/oai?verb=ListSets&resumptionToken=nonsense").await.text().contains("badResumptionToken"));
}

#[tokio::test]
async fn long_records_shorten_the_pages_of_a_harvest() {
    let dir = tempfile::tempdir().unwrap();
    for n in 0..20 {
        let slug = format!("fort-{n:02}");
        published(dir.path(), &slug, |_| {});
        // Of a record that is too long only the minimum is sent.
        let length = if n == 3 { 200_000 } else { 60_000 };
        let record = format!("<dc>{}</dc>", "x".repeat(length));
        let list = dir.path().join(&slug).join("v1/checksums.sha256");
        let text = std::fs::read_to_string(&list).unwrap();
        let lines: Vec<&str> = text.split_inclusive('\n').filter(|l| !l.trim_end().ends_with("dc.xml")).collect();
        let mut sums = kilwa_archive::Checksums::parse(&lines.concat()).unwrap();
        sums.add("metadata/dc.xml", kilwa_archive::checksums::sha256(record.as_bytes()));
        std::fs::write(dir.path().join(&slug).join("v1/metadata/dc.xml"), record).unwrap();
        std::fs::write(&list, sums.to_text()).unwrap();
        published_again(dir.path(), &slug, &sums.to_text());
    }
    let app = portal(dir.path());
    let (mut records, mut pages, mut asked) = (0, 0, "metadataPrefix=oai_dc".to_owned());
    loop {
        let answer = get(&app, &format!("/oai?verb=ListRecords&{asked}")).await;
        assert!(answer.body.len() < 256 * 1024, "{}", answer.body.len());
        let xml = answer.text();
        (records, pages) = (records + xml.matches("<record>").count(), pages + 1);
        match xml.split("<resumptionToken>").nth(1) {
            Some(rest) => asked = format!("resumptionToken={}", rest.split('<').next().unwrap()),
            None => break,
        }
        assert!(pages < 30);
    }
    assert_eq!(records, 20);
    assert!(pages >= 6, "{pages}");
}

/// The manifest of an object whose list of checksums is another one now.
fn published_again(folder: &Path, slug: &str, list: &str) {
    let file = folder.join(slug).join("manifest.json");
    let mut manifest = Manifest::parse(&std::fs::read(&file).unwrap()).unwrap();
    let checksums = &mut manifest.versions[0].checksums;
    (checksums.bytes, checksums.sha256) = (list.len() as u64, kilwa_archive::checksums::sha256(list.as_bytes()));
    std::fs::write(file, manifest.to_bytes().unwrap()).unwrap();
}

/// A body that is announced and never sent. Counts how many of them the server waits for.
struct Stuck {
    waited_for: Arc<AtomicUsize>,
    is_counted: bool,
}

impl http_body::Body for Stuck {
    type Data = Bytes;
    type Error = std::io::Error;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        _: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Self::Data>, Self::Error>>> {
        if !std::mem::replace(&mut self.is_counted, true) {
            self.waited_for.fetch_add(1, Ordering::SeqCst);
        }
        Poll::Pending
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(100)
    }
}

/// More slow requests than are answered at once, from many networks: by POST, and by GET, where nobody expects a body.
#[tokio::test]
async fn slow_request_bodies_do_not_block_other_queries() {
    let dir = archive();
    let mut site = Site::new(Catalogue::open(dir.path()).unwrap(), page());
    let index = Index::open(dir.path(), None).unwrap();
    index.refresh().unwrap();
    site.index = Some(Arc::new(index));
    site.behind_proxy = true;
    let app = app(site);
    for (method, address, asked) in [
        ("GET", "/oai", "/oai?verb=Identify"),
        ("HEAD", "/oai", "/oai?verb=Identify"),
        ("POST", "/oai", "/oai?verb=Identify"),
    ] {
        let waited_for = Arc::new(AtomicUsize::new(0));
        let slow: Vec<_> = (0..8)
            .map(|n| {
                let body = Body::new(Stuck { waited_for: Arc::clone(&waited_for), is_counted: false });
                let request = Request::builder()
                    .method(method)
                    .uri(address)
                    .header("x-forwarded-for", format!("10.0.0.{}", n / 2));
                tokio::spawn(app.clone().oneshot(request.body(body).unwrap()))
            })
            .collect();
        while waited_for.load(Ordering::SeqCst) < slow.len() {
            tokio::task::yield_now().await;
        }
        let answer = ask(&app, "GET", asked, &[("x-forwarded-for", "10.0.0.9")]).await;
        assert_eq!(answer.status, StatusCode::OK, "{method} {address}");
        assert!(
            slow.iter().all(|s| !s.is_finished()),
            "{method} {address}: it was answered only after the slow requests timed out"
        );
        slow.iter().for_each(tokio::task::JoinHandle::abort);
    }
    // A form is read if there is one.
    let request = Request::get("/oai").body(Body::from("verb=Identify")).unwrap();
    let answer = Answer::of(app.clone().oneshot(request).await.unwrap()).await;
    assert!(answer.text().contains("badVerb"), "{}", answer.text());
    let request = Request::post("/oai").body(Body::from("verb=Identify")).unwrap();
    let answer = Answer::of(app.clone().oneshot(request).await.unwrap()).await;
    assert!(answer.text().contains("<Identify>"), "{}", answer.text());
}
