//! The catalogue's index: what is in the folder is found, by words and by facets, and nothing else; the index itself can be lost.

use kilwa_server::index::{Facet, Index, Query, Sort};
use serde_json::json;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// A way to damage a file.
type Spoil = fn(&mut Vec<u8>);

/// What varies between the objects of these tests.
struct Object<'a> {
    slug: &'a str,
    title: &'a str,
    description: &'a str,
    country: &'a str,
    kind: &'a str,
    triangles: u64,
    published: &'a str,
    state: &'a str,
}

impl Default for Object<'_> {
    fn default() -> Self {
        Self {
            slug: "gereza",
            title: "Gereza, Kilwa Kisiwani",
            description: "A fort by the sea",
            country: "TZ",
            kind: "fort",
            triangles: 32_600_000,
            published: "2026-11-21",
            state: "public",
        }
    }
}

impl Object<'_> {
    fn write(&self, folder: &Path) {
        let home = folder.join(self.slug);
        std::fs::create_dir_all(home.join("v1/metadata")).expect("a folder");
        let hash = "a".repeat(64);
        let manifest = json!({
            "kilwa": 1, "slug": self.slug, "title": self.title, "description": self.description, "language": "en",
            "place": "Kilwa Kisiwani", "subjects": ["laser scanning"], "creators": ["Rüther, Heinz"],
            "rights": {"uri": "https://creativecommons.org/licenses/by/4.0/", "label": "Attribution 4.0", "short": "CC BY 4.0"},
            "citation": "Rüther (2009).", "access": {"state": self.state}, "current": 1,
            "versions": [{"version": 1, "folder": "v1", "published": self.published, "note": "first",
                "pack": {"url": format!("v1/pack.{hash}.kilwa"), "bytes": 7, "sha256": hash, "identity": "b".repeat(32)},
                "checksums": {"url": "v1/checksums.sha256", "bytes": 3, "sha256": hash},
                "figures": {"bounds": [[0.0, 0.0, 0.0], [1.0, 1.0, 1.0]], "units": "m", "source_units": "m",
                    "triangles": self.triangles, "vertices": 3, "spacing": 0.02}}],
            "page": {"url": "index.html", "bytes": 1, "sha256": hash}, "tool": "kilwa test",
        });
        let metadata = json!({
            "title": self.title, "language": "en", "rights": {"uri": "https://creativecommons.org/licenses/by/4.0/"},
            "place": {"name": "Kilwa Kisiwani", "country": self.country, "latitude": -8.96, "longitude": 39.5},
            "object": {"kind": self.kind, "period": "Swahili"}, "model": {"units": "m"},
        });
        std::fs::write(home.join("v1/metadata/metadata.json"), metadata.to_string()).expect("writes");
        std::fs::write(home.join("manifest.json"), manifest.to_string()).expect("writes");
    }
}

/// Six objects in a folder.
fn some() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a folder");
    let objects = [
        Object::default(),
        Object { slug: "husuni", title: "Husuni Kubwa", kind: "palace", triangles: 900_000, ..Object::default() },
        Object {
            slug: "mosque",
            title: "Great Mosque",
            description: "South of the fort",
            kind: "mosque",
            published: "2027-01-02",
            ..Object::default()
        },
        Object {
            slug: "chateau",
            title: "Château d’Œuf",
            description: "Großes Haus",
            country: "FR",
            kind: "fort",
            triangles: 5_000_000,
            ..Object::default()
        },
        Object {
            slug: "qalat", title: "قلعة كِلوة", description: "حصن", country: "OM", ..Object::default()
        },
        Object { slug: "gone", title: "Withdrawn fort", state: "withdrawn", ..Object::default() },
    ];
    for object in &objects {
        object.write(folder.path());
    }
    folder
}

fn in_memory(folder: &Path) -> Index {
    let index = Index::open(folder, None).expect("opens");
    index.refresh().expect("reads");
    index
}

fn words(text: &str) -> Query {
    Query { text: text.to_owned(), per_page: 20, ..Query::default() }
}

fn slugs(index: &Index, query: &Query) -> Vec<String> {
    let found = index.search(query).expect("searches");
    assert!(found.entries.len() as u64 <= found.total);
    found.entries.into_iter().map(|e| e.slug).collect()
}

#[test]
fn objects_are_found_by_words_of_their_metadata_best_match_first() {
    let folder = some();
    let index = in_memory(folder.path());
    assert_eq!(slugs(&index, &words("gereza")), ["gereza"]);
    assert_eq!(slugs(&index, &words("great mosq")), ["mosque"], "the beginning of a word is enough");
    assert_eq!(slugs(&index, &words("ruther palace")), ["husuni"], "all words count, wherever they stand");
    assert_eq!(slugs(&index, &words("chateau oeuf")), ["chateau"], "accents and ligatures do not");
    assert_eq!(slugs(&index, &words("GROSSES")), ["chateau"]);
    assert_eq!(slugs(&index, &words("قلعه")), ["qalat"], "Arabic is written in several ways");
    assert_eq!(slugs(&index, &words("nothing of it")), Vec::<String>::new());
    assert_eq!(slugs(&index, &words("kubwa"))[0], "husuni");
    assert_eq!(index.search(&words("")).expect("searches").total, 5, "withdrawn objects are in no list");
    assert!(index.entry("gone").expect("reads").is_some(), "but their page is found");
}

#[test]
fn search_text_is_never_interpreted_as_query_syntax() {
    let folder = some();
    let index = in_memory(folder.path());
    let long = "fort ".repeat(10_000);
    let typed = [
        "\"",
        "\"\"",
        "*",
        "fort*",
        "title:fort",
        "fort AND",
        "NEAR(fort mosque)",
        "fort OR 1=1",
        "'; DROP TABLE object; --",
        "^fort",
        "-fort",
        "(",
        ")",
        "{}",
        "\0",
        "fort\0",
        "%",
        "_",
        "\\",
        "☃",
        "fort\u{301}",
        long.as_str(),
    ];
    for text in typed {
        let mut query = words(text);
        index.search(&query).unwrap_or_else(|e| panic!("{text:?}: {e}"));
        query.facets.insert(Facet::Kind, BTreeSet::from([text.to_owned()]));
        assert_eq!(index.search(&query).unwrap_or_else(|e| panic!("{text:?}: {e}")).total, 0, "{text:?}");
    }
    assert_eq!(index.search(&words("")).expect("still there").total, 5);
}

#[test]
fn facets_narrow_the_result_and_their_counts_show_what_each_choice_gives() {
    let folder = some();
    let index = in_memory(folder.path());
    let choose = |facet: Facet, values: &[&str]| {
        let mut query = words("");
        query.facets.insert(facet, values.iter().map(|v| (*v).to_owned()).collect());
        query
    };
    assert_eq!(slugs(&index, &choose(Facet::Kind, &["palace", "mosque"])), ["mosque", "husuni"], "or within a facet");
    let mut query = choose(Facet::Kind, &["fort"]);
    query.facets.insert(Facet::Country, BTreeSet::from(["FR".to_owned()]));
    assert_eq!(slugs(&index, &query), ["chateau"], "and between facets");
    assert_eq!(slugs(&index, &choose(Facet::Size, &["1m-10m"])), ["chateau"]);

    let found = index.search(&choose(Facet::Kind, &["palace"])).expect("searches");
    for (facet, counts) in &found.facets {
        for count in counts {
            let mut query = choose(Facet::Kind, &["palace"]);
            query.facets.insert(*facet, BTreeSet::from([count.value.clone()]));
            assert_eq!(index.search(&query).expect("searches").total, count.count, "{facet:?} {}", count.value);
        }
    }
    assert!(found.facets[&Facet::Kind].len() == 3 && found.facets[&Facet::Country].len() == 1, "{found:?}");
}

#[test]
fn pages_and_orders_show_every_object_once() {
    let folder = some();
    let index = in_memory(folder.path());
    for sort in [Sort::Relevance, Sort::Title, Sort::Newest, Sort::Largest] {
        let page =
            |page| slugs(&index, &Query { sort, page, per_page: 2, text: "kilwa".to_owned(), ..Query::default() });
        let mut all: Vec<String> = (0..4).flat_map(page).collect();
        assert_eq!(all.len(), 5, "{sort:?}");
        let first = all.first().cloned();
        match sort {
            Sort::Newest => assert_eq!(first.as_deref(), Some("mosque")),
            Sort::Title => assert_eq!(first.as_deref(), Some("chateau")),
            Sort::Largest | Sort::Relevance => {}
        }
        all.sort();
        all.dedup();
        assert_eq!(all.len(), 5, "{sort:?}");
    }
    let all: Vec<String> = index.after("", 3).expect("reads").into_iter().map(|e| e.slug).collect();
    assert_eq!(all, ["chateau", "gereza", "gone"]);
    assert_eq!(index.after("gone", 9).expect("reads").len(), 3);
}

#[test]
fn counts_follow_every_change_also_by_other_programs_and_agree_with_the_results() {
    let folder = some();
    let file = file_in(folder.path());
    let [ours, theirs] = [(); 2].map(|()| Index::open(folder.path(), Some(&file)).expect("opens"));
    let agrees = |index: &Index| {
        let found = index.search(&Query::default()).expect("searches");
        for (facet, counts) in &found.facets {
            for count in counts {
                let chosen = BTreeSet::from([count.value.clone()]);
                let query = Query { facets: [(*facet, chosen)].into(), ..Query::default() };
                let total = index.search(&query).expect("searches").total;
                assert_eq!(total, count.count, "{facet:?} {}", count.value);
            }
        }
        found.facets[&Facet::Kind].iter().map(|c| (c.value.clone(), c.count)).collect::<Vec<_>>()
    };
    let kinds = |counts: &[(&str, u64)]| counts.iter().map(|(k, n)| ((*k).to_owned(), *n)).collect::<Vec<_>>();
    assert_eq!(agrees(&ours), []);
    theirs.refresh().expect("reads");
    assert_eq!(agrees(&ours), kinds(&[("fort", 3), ("mosque", 1), ("palace", 1)]));
    Object { kind: "palace", ..Object::default() }.write(folder.path());
    Object { slug: "tomb", title: "A tomb", kind: "tomb", ..Object::default() }.write(folder.path());
    std::fs::remove_dir_all(folder.path().join("husuni")).expect("removes");
    theirs.refresh().expect("reads");
    let now = kinds(&[("fort", 2), ("mosque", 1), ("palace", 1), ("tomb", 1)]);
    assert_eq!((agrees(&ours), agrees(&theirs)), (now.clone(), now));
    ours.rebuild().expect("reads");
    assert_eq!(agrees(&ours).len(), 4);
}

#[test]
fn changes_in_the_folder_reach_the_index() {
    let folder = some();
    let index = in_memory(folder.path());
    assert_eq!(index.refresh().expect("reads"), kilwa_server::index::Changes::default());
    Object { slug: "new", title: "Makutani", ..Object::default() }.write(folder.path());
    Object { title: "Gereza, renamed", ..Object::default() }.write(folder.path());
    std::fs::remove_dir_all(folder.path().join("mosque")).expect("removes");
    std::fs::write(folder.path().join("husuni/manifest.json"), "{").expect("writes");
    let changes = index.refresh().expect("reads");
    assert_eq!((changes.added, changes.changed, changes.removed, changes.refused), (1, 1, 1, 1), "{changes:?}");
    assert_eq!(slugs(&index, &words("makutani")), ["new"]);
    assert_eq!(slugs(&index, &words("renamed")), ["gereza"]);
    assert_eq!(slugs(&index, &words("mosque")), Vec::<String>::new());
    let refused = index.refused().expect("reads");
    assert!(
        refused.len() == 1 && refused[0].slug == "husuni" && refused[0].why.contains("manifest.json"),
        "{refused:?}"
    );
    Object { slug: "husuni", title: "Husuni Kubwa", ..Object::default() }.write(folder.path());
    index.refresh().expect("reads");
    assert_eq!((index.refused().expect("reads").len(), slugs(&index, &words("husuni")).len()), (0, 1), "mended");
}

#[test]
fn a_folder_under_another_name_than_its_manifest_is_refused_by_name() {
    let folder = some();
    std::fs::rename(folder.path().join("gereza"), folder.path().join("elsewhere")).expect("renames");
    let refused = in_memory(folder.path()).refused().expect("reads");
    assert!(refused[0].slug == "elsewhere" && refused[0].why.contains("gereza"), "{refused:?}");
}

fn file_in(folder: &Path) -> PathBuf {
    folder.join("index.sqlite")
}

#[test]
fn a_warm_start_rereads_no_object() {
    let (folder, home) = (some(), tempfile::tempdir().expect("a folder"));
    let file = file_in(home.path());
    assert_eq!(Index::open(folder.path(), Some(&file)).expect("opens").refresh().expect("reads").added, 6);
    let again = Index::open(folder.path(), Some(&file)).expect("opens");
    assert_eq!(slugs(&again, &words("gereza")), ["gereza"], "known before the folder is looked at");
    assert_eq!(again.refresh().expect("reads"), kilwa_server::index::Changes::default());
}

#[test]
fn an_index_that_is_damaged_or_of_another_version_is_rebuilt() {
    let (folder, home) = (some(), tempfile::tempdir().expect("a folder"));
    let file = file_in(home.path());
    let make = || Index::open(folder.path(), Some(&file)).expect("opens").refresh().expect("reads");
    make();
    let sound = std::fs::read(&file).expect("reads");
    let spoil: [(&str, Spoil); 5] = [
        ("cut", |b| b.truncate(b.len() / 2)),
        ("zeros", |b| b[4096..12_288].fill(0)),
        ("noise", |b| b.iter_mut().skip(4000).step_by(7).for_each(|x| *x ^= 0x5a)),
        ("no database but ours by its mark", |b| b[100..2000].fill(0xff)),
        ("another version", |b| b[60..64].copy_from_slice(&99u32.to_be_bytes())),
    ];
    for (what, how) in spoil {
        let mut bytes = sound.clone();
        how(&mut bytes);
        for ending in ["-wal", "-shm"] {
            std::fs::remove_file(home.path().join(format!("index.sqlite{ending}"))).ok();
        }
        std::fs::write(&file, &bytes).expect("writes");
        let index = Index::open(folder.path(), Some(&file)).unwrap_or_else(|e| panic!("{what}: {e}"));
        index.refresh().unwrap_or_else(|e| panic!("{what}: {e}"));
        assert_eq!(slugs(&index, &words("gereza")), ["gereza"], "{what}");
        assert_eq!(index.search(&words("")).expect("searches").total, 5, "{what}");
    }
}

#[test]
fn an_index_damaged_or_deleted_while_serving_is_rebuilt() {
    let (folder, home) = (some(), tempfile::tempdir().expect("a folder"));
    let file = file_in(home.path());
    let index = Index::open(folder.path(), Some(&file)).expect("opens");
    index.refresh().expect("reads");
    std::fs::remove_file(&file).expect("removes");
    assert_eq!(index.rebuild().expect("rebuilds").added, 6);
    assert_eq!(slugs(&index, &words("gereza")), ["gereza"]);
    assert!(file.is_file());
}

#[test]
fn a_foreign_database_is_never_overwritten_and_the_index_is_kept_in_memory() {
    let (folder, home) = (some(), tempfile::tempdir().expect("a folder"));
    let file = file_in(home.path());
    let own = rusqlite::Connection::open(&file).expect("opens");
    own.execute_batch("CREATE TABLE precious (x); INSERT INTO precious VALUES (1);").expect("writes");
    drop(own);
    let before = std::fs::read(&file).expect("reads");
    let index = Index::open(folder.path(), Some(&file)).expect("opens");
    assert_eq!(index.file(), None);
    index.refresh().expect("reads");
    assert_eq!(slugs(&index, &words("gereza")), ["gereza"]);
    assert_eq!(std::fs::read(&file).expect("reads"), before);
    let nowhere = Index::open(folder.path(), Some(Path::new("/nowhere/index.sqlite"))).expect("opens");
    assert_eq!((nowhere.file(), nowhere.refresh().expect("reads").added), (None, 6));
}

#[test]
fn searches_during_a_refresh_see_a_consistent_state() {
    let (folder, home) = (some(), tempfile::tempdir().expect("a folder"));
    let index = Index::open(folder.path(), Some(&file_in(home.path()))).expect("opens");
    index.refresh().expect("reads");
    std::thread::scope(|scope| {
        let searching: Vec<_> = (0..3)
            .map(|_| {
                scope.spawn(|| {
                    for _ in 0..100 {
                        assert_eq!(index.search(&words("fort")).expect("searches").total, 5);
                    }
                })
            })
            .collect();
        for i in 0..10 {
            let published = format!("2026-01-{:02}", i + 1);
            Object { published: &published, ..Object::default() }.write(folder.path());
            index.refresh().expect("reads");
        }
        for thread in searching {
            thread.join().expect("no panic");
        }
    });
}
