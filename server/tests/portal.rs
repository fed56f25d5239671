//! The portal: what people search and other systems read, over objects as publishing writes them.

mod common;

use common::{Answer, ask, get, object, pack, page, public};
use kilwa_server::index::Index;
use kilwa_server::object::manifest::{Access, AccessState, Manifest};
use kilwa_server::{Catalogue, Clock, Site, app};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

fn portal(folder: &Path) -> axum::Router {
    let mut site = Site::new(Catalogue::open(folder).unwrap(), page());
    let index = Index::open(folder, None).unwrap();
    index.refresh().unwrap();
    site.index = Some(Arc::new(index));
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
    assert!(html.contains("Public from 2027-01-01 on"));
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

#[tokio::test]
async fn the_catalogue_speaks_five_languages() {
    let dir = archive();
    let app = portal(dir.path());
    let arabic = get(&app, "/?lang=ar&q=coral").await.text();
    assert!(arabic.contains("<html lang=\"ar\" dir=\"rtl\">") && arabic.contains("name=\"lang\" value=\"ar\""));
    assert!(arabic.contains("href=\"/?q=coral&amp;lang=sw\""), "the other languages keep the question");
    let a = ask(&app, "GET", "/", &[("accept-language", "sw, en;q=0.5")]).await;
    assert!(a.text().contains("<html lang=\"sw\"") && a.header("vary").contains("Accept-Language"));
}

#[tokio::test]
async fn new_objects_are_found_while_serving() {
    let dir = archive();
    let app = portal(dir.path());
    assert_eq!(get(&app, "/?q=husuni").await.text().matches("class=\"card\"").count(), 0);
    published(dir.path(), "husuni", |m| m.title = "Husuni Kubwa".into());
    tokio::time::sleep(Duration::from_millis(1100)).await;
    for attempt in 0.. {
        if get(&app, "/?q=husuni").await.text().contains("Husuni Kubwa") {
            break;
        }
        assert!(attempt < 50, "it was not noticed");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    assert_eq!(get(&app, "/husuni/").await.status, 200);
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
    for (url, status) in [("gone%2F", 404), ("none%2F", 404), ("gereza%2F&format=yaml", 501)] {
        let a = get(&app, &format!("/oembed?url=https%3A%2F%2Fmuseum.example%2F{url}")).await;
        assert_eq!(a.status, status, "{url}");
    }
}

#[tokio::test]
async fn harvesters_get_what_oai_pmh_promises() {
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
        ("verb=ListRecords&resumptionToken=x", "badResumptionToken"),
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
async fn feed_and_sitemap_name_what_is_public() {
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
async fn an_index_that_is_deleted_or_damaged_while_serving_costs_nothing() {
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
