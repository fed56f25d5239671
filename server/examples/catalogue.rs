//! How long the catalogue takes: `cargo run --release -p kilwa-server --example catalogue -- [OBJECTS] [store]`.
//!
//! Writes so many small objects (10,000 by default) to a temporary folder, then prints: first reading, warm start (the index, and all of the server's:
//! folder and index), a refresh when nothing and when one object changed, and searches (median, 95 and 99 %) with two threads asking at
//! once; then the same of whole pages (list, search, filters, map, collection, model) through the site's own router, without a socket.
//! With `store` the objects lie in an S3-compatible store (moto, where `KILWA_MOTO` says), not in a folder.

#[path = "../tests/store/bucket.rs"]
#[allow(dead_code, reason = "the tests use all of it")]
mod bucket;
#[path = "../tests/common/eventually.rs"]
mod eventually;

use axum::body::Body;
use axum::http::Request;
use bucket::Bucket;
use kilwa_server::index::{Facet, Index, Query, Sort};
use kilwa_server::store::{Place, S3};
use kilwa_server::{COLLECTIONS_FILE, Catalogue, CatalogueError, Collections, Page, Site, app};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tower::ServiceExt as _;

const KINDS: [&str; 8] = ["fort", "mosque", "palace", "tomb", "well", "house", "wall", "rock art"];
const COUNTRIES: [&str; 6] = ["TZ", "KE", "MZ", "OM", "PT", "FR"];
const WORDS: [&str; 12] =
    ["coral", "stone", "great", "north", "court", "arch", "gate", "harbour", "island", "old", "mihrab", "tower"];

fn write(folder: &Path, i: usize) -> std::io::Result<()> {
    let pick = |from: &[&'static str], salt: usize| from[(i.wrapping_mul(2_654_435_761) >> salt) % from.len()];
    let slug = format!("object-{i}");
    let home = folder.join(&slug);
    std::fs::create_dir_all(home.join("v1/metadata"))?;
    let hash = "a".repeat(64);
    let title = format!("{} {} {i}", pick(&WORDS, 3), pick(&KINDS, 5));
    let description: Vec<&str> = (0..60).map(|k| pick(&WORDS, k % 20)).collect();
    let manifest = serde_json::json!({
        "kilwa": 1, "slug": slug, "title": title, "description": description.join(" "), "language": "en", "creators": ["Example, Ann"],
        "subjects": [pick(&WORDS, 7), pick(&WORDS, 9)],
        "rights": {"uri": "https://creativecommons.org/licenses/by/4.0/", "label": "Attribution 4.0", "short": "CC BY 4.0"},
        "citation": "Example.", "access": {"state": "public"}, "current": 1,
        "versions": [{"version": 1, "folder": "v1", "published": format!("20{:02}-01-01", i % 30), "note": "first",
            "pack": {"url": format!("v1/pack.{hash}.kilwa"), "bytes": 7, "sha256": hash, "identity": "b".repeat(32)},
            "checksums": {"url": "v1/checksums.sha256", "bytes": 3, "sha256": hash},
            "figures": {"bounds": [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], "units": "m", "source_units": "m",
                "triangles": i * 30_000, "vertices": 3, "spacing": 0.02}}],
        "page": {"url": "index.html", "bytes": 1, "sha256": hash}, "tool": "kilwa",
    });
    let metadata = serde_json::json!({
        "title": title, "language": "en", "rights": {"uri": "https://creativecommons.org/licenses/by/4.0/"},
        "place": {"country": pick(&COUNTRIES, 2), "latitude": (i * 37 % 1200) as f64 / 10.0 - 60.0, "longitude": (i * 53 % 3400) as f64 / 10.0 - 170.0}, "object": {"kind": pick(&KINDS, 5), "period": pick(&WORDS, 11)}, "model": {"units": "m"},
    });
    std::fs::write(home.join("v1/metadata/metadata.json"), metadata.to_string())?;
    std::fs::write(home.join("manifest.json"), manifest.to_string())
}

fn queries() -> Vec<Query> {
    let plain = |text: &str, sort| Query { text: text.to_owned(), sort, per_page: 24, ..Query::default() };
    let mut all = vec![plain("", Sort::Relevance), plain("", Sort::Newest), plain("", Sort::Largest)];
    all.extend(WORDS.iter().map(|w| plain(w, Sort::Relevance)));
    all.extend(WORDS.iter().map(|w| plain(&format!("{w} st"), Sort::Relevance)));
    all.extend(KINDS.iter().map(|k| {
        let mut query = plain("stone", Sort::Title);
        query.facets.insert(Facet::Kind, BTreeSet::from([(*k).to_owned()]));
        Query { page: 3, ..query }
    }));
    all
}

/// Where the objects lie.
enum Archive {
    Folder(tempfile::TempDir),
    Store(Box<Bucket>),
}

impl Archive {
    /// As a program finds it that begins now: nothing of a store is held.
    fn place(&self) -> Result<Place, Failure> {
        Ok(match self {
            Self::Folder(folder) => Place::Path(folder.path().to_owned()),
            Self::Store(bucket) => {
                let mut options = bucket.options("s3://museum", Duration::from_secs(20));
                options.refresh = Duration::from_secs(30);
                Place::Key(S3::open(&options)?, String::new())
            }
        })
    }

    fn open(place: &Place) -> Result<Catalogue, CatalogueError> {
        match place {
            Place::Path(folder) => Catalogue::open(folder),
            Place::Key(store, _) => Catalogue::of_store(store),
        }
    }

    /// Requests to the store since this was last asked.
    fn asked(&self) -> String {
        match self {
            Self::Folder(_) => String::new(),
            Self::Store(bucket) => format!(", {} requests", bucket.proxy.asked().len()),
        }
    }

    fn remove(&mut self, slug: &str) -> std::io::Result<()> {
        match self {
            Self::Folder(folder) => std::fs::remove_dir_all(folder.path().join(slug)),
            Self::Store(bucket) => {
                bucket.delete(&format!("{slug}/manifest.json"));
                Ok(())
            }
        }
    }
}

type Failure = Box<dyn std::error::Error>;

fn archive(objects: usize, in_store: bool) -> Result<Archive, Failure> {
    let folder = tempfile::tempdir()?;
    for i in 0..objects {
        write(folder.path(), i)?;
    }
    if !in_store {
        return Ok(Archive::Folder(folder));
    }
    let mut bucket = Bucket::start("the catalogue of a store").ok_or("KILWA_MOTO is not set")?;
    bucket.sync(folder.path(), "");
    Ok(Archive::Store(Box::new(bucket)))
}

/// As `kilwa serve` starts.
fn start(archive: &Archive, file: &Path) -> Result<(Catalogue, Index), Failure> {
    let place = archive.place()?;
    let index = Index::of(&place, Some(file))?;
    index.refresh()?;
    Ok((Archive::open(&place)?, index))
}

fn main() -> Result<(), Failure> {
    let objects: usize = std::env::args().nth(1).map_or(Ok(10_000), |n| n.parse())?;
    let home = tempfile::tempdir()?;
    let mut archive = archive(objects, std::env::args().nth(2).is_some_and(|word| word == "store"))?;
    let file = home.path().join("index.sqlite");
    let timed = |archive: &Archive, what: &str, f: &dyn Fn() -> Result<(), Failure>| {
        drop(archive.asked());
        let start = Instant::now();
        f().map(|()| println!("{what}: {:.0} ms{}", start.elapsed().as_secs_f64() * 1e3, archive.asked()))
    };
    let fresh = |file: &Path| -> Result<Index, Failure> { Ok(Index::of(&archive.place()?, Some(file))?) };
    timed(&archive, "first reading", &|| Ok(fresh(&file)?.refresh().map(drop)?))?;
    timed(&archive, "warm start", &|| Ok(fresh(&file)?.refresh().map(drop)?))?;
    let index = fresh(&file)?;
    timed(&archive, "refresh, nothing changed", &|| Ok(index.refresh().map(drop)?))?;
    let cold = home.path().join("cold.sqlite");
    timed(&archive, "cold start of all", &|| start(&archive, &cold).map(drop))?;
    archive.remove("object-7")?;
    let index = Index::of(&archive.place()?, Some(&file))?;
    timed(&archive, "refresh, one object gone", &|| Ok(index.refresh().map(drop)?))?;
    println!("index file: {} bytes", std::fs::metadata(&file)?.len());
    let ask = || -> Vec<Duration> {
        let one = |q: &Query| {
            let start = Instant::now();
            index.search(q).map_or(Duration::MAX, |_| start.elapsed())
        };
        (0..10).flat_map(|_| queries().iter().map(one).collect::<Vec<_>>()).collect()
    };
    let mut times = std::thread::scope(|s| {
        let other = s.spawn(ask);
        let mut mine = ask();
        mine.extend(other.join().unwrap_or_default());
        mine
    });
    shares("search", &mut times);
    pages(&archive, home.path(), &file)
}

fn shares(what: &str, times: &mut [Duration]) {
    times.sort();
    for share in [50, 95, 99] {
        println!("{what} p{share}: {:.1} ms", times[(times.len() - 1) * share / 100].as_secs_f64() * 1e3);
    }
}

/// Processor time of the program so far, seconds, if the system reports it (Linux, in hundredths).
fn processor() -> Option<f64> {
    let stat = std::fs::read_to_string("/proc/self/stat").ok()?;
    let mut fields = stat.rsplit(')').next()?.split_whitespace().skip(11);
    let (user, system): (f64, f64) = (fields.next()?.parse().ok()?, fields.next()?.parse().ok()?);
    Some((user + system) / 100.0)
}

/// Pages as a browser asks for them, from two threads.
fn pages(archive: &Archive, home: &Path, file: &Path) -> Result<(), Failure> {
    let members: Vec<String> = (100..400).map(|i| format!("\"object-{i}\"")).collect();
    let collection = format!("[[collection]]\nslug = \"some\"\ntitle = \"Some\"\nmembers = [{}]\n", members.join(", "));
    std::fs::write(home.join(COLLECTIONS_FILE), collection)?;
    drop(archive.asked());
    let began = Instant::now();
    let (catalogue, index) = start(archive, file)?;
    println!("warm start of all: {:.0} ms{}", began.elapsed().as_secs_f64() * 1e3, archive.asked());
    let mut site = Site::new(catalogue, Page::from_files(BTreeMap::new()));
    site.index = Some(Arc::new(index));
    site.collections = Some(Arc::new(Collections::new(home.join(COLLECTIONS_FILE))));
    let app = app(site);
    let kinds = [
        ("list", vec!["/", "/?page=200", "/?sort=newest", "/?sort=largest&lang=ar"]),
        (
            "search page",
            vec![
                "/?q=coral",
                "/?q=coral%20st",
                "/?q=harbour",
                "/?q=stone&kind=fort&sort=title",
                "/?q=tower&country=TZ",
            ],
        ),
        ("map", vec!["/map", "/map?q=harbour", "/map?country=KE"]),
        ("collection", vec!["/collections/some/"]),
    ];
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build()?;
    for (what, addresses) in kinds {
        let ask = |app: axum::Router, addresses: Vec<&'static str>| async move {
            let mut times = Vec::new();
            for _ in 0..40 {
                for address in &addresses {
                    let start = Instant::now();
                    let request = Request::get(*address)
                        .header("accept-encoding", "gzip")
                        .body(Body::empty())
                        .unwrap_or_default();
                    let answered = app.clone().oneshot(request).await.is_ok_and(|r| r.status().is_success());
                    times.push(if answered { start.elapsed() } else { Duration::MAX });
                }
            }
            times
        };
        let before = processor();
        let mut times = runtime.block_on(async {
            let other = tokio::spawn(ask(app.clone(), addresses.clone()));
            let mut mine = ask(app.clone(), addresses).await;
            mine.extend(other.await.unwrap_or_default());
            mine
        });
        shares(what, &mut times);
        if let (Some(before), Some(after)) = (before, processor()) {
            println!("{what}, processor time of one: {:.1} ms", (after - before) * 1e3 / times.len() as f64);
        }
    }
    Ok(())
}
