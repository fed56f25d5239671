//! How long the catalogue's index takes: `cargo run --release -p kilwa-server --example catalogue -- [OBJECTS]`.
//!
//! Writes so many small objects (10,000 unless told) to a temporary folder, then prints: first reading, warm start, a refresh when
//! nothing and when one object changed, and searches (median, 95 and 99 %) with two threads asking at once.

use kilwa_server::index::{Facet, Index, Query, Sort};
use std::collections::BTreeSet;
use std::path::Path;
use std::time::{Duration, Instant};

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
        "place": {"country": pick(&COUNTRIES, 2)}, "object": {"kind": pick(&KINDS, 5), "period": pick(&WORDS, 11)}, "model": {"units": "m"},
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

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let objects: usize = std::env::args().nth(1).map_or(Ok(10_000), |n| n.parse())?;
    let (folder, home) = (tempfile::tempdir()?, tempfile::tempdir()?);
    for i in 0..objects {
        write(folder.path(), i)?;
    }
    let file = home.path().join("index.sqlite");
    let timed = |what: &str, f: &dyn Fn() -> Result<(), Box<dyn std::error::Error>>| {
        let start = Instant::now();
        f().map(|()| println!("{what}: {:.0} ms", start.elapsed().as_secs_f64() * 1e3))
    };
    timed("first reading", &|| Ok(Index::open(folder.path(), Some(&file))?.refresh().map(drop)?))?;
    timed("warm start", &|| Ok(Index::open(folder.path(), Some(&file))?.refresh().map(drop)?))?;
    let index = Index::open(folder.path(), Some(&file))?;
    timed("refresh, nothing changed", &|| Ok(index.refresh().map(drop)?))?;
    std::fs::remove_dir_all(folder.path().join("object-7"))?;
    timed("refresh, one object gone", &|| Ok(index.refresh().map(drop)?))?;
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
    times.sort();
    for share in [50, 95, 99] {
        println!("search p{share}: {:.1} ms", times[(times.len() - 1) * share / 100].as_secs_f64() * 1e3);
    }
    Ok(())
}
