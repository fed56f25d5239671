//! Concurrent publishing to and withdrawing from one folder: what is reported as done is done, and nobody undoes another's work.
//!
//! Everything is done as by `kilwa publish`, but that pictures are made of nothing: they take seconds, and have no part in this.

use super::super::progress::tests::watched;
use super::super::withdraw;
use super::*;
use clap::Parser as _;
use kilwa_archive::checksums::Checksums;
use kilwa_archive::layout::{MANIFEST, PAGE, POSTER, THUMBNAILS};
use kilwa_archive::{AccessState, Version};
use std::path::PathBuf;

#[path = "../../tests/support/serving.rs"]
#[expect(dead_code, reason = "no server is started here")]
mod serving;

#[derive(clap::Parser)]
struct Cli {
    #[command(flatten)]
    args: Args,
}

fn args(more: &[&str]) -> Args {
    Cli::parse_from([&["kilwa"], more].concat()).args
}

const METADATA: &str = "title = \"Wall\"\npublished = 2026-11-21\n[rights]\nuri = \"CC0\"\n[model]\nunits = \"m\"\n";

/// A folder with a page and metadata, and room for objects.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        // Thousands of files are put on disk: in memory that takes no time.
        let memory = Path::new("/dev/shm");
        let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
        let bench = Self { folder: folder.unwrap() };
        serving::page(&bench.path("www"));
        bench
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn object(&self) -> PathBuf {
        self.path("site/wall")
    }

    /// What publishes a version whose description and note are `words`; none for a first one.
    fn publishing(&self, words: Option<&str>, more: &[&str]) -> Args {
        let pack = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/compat/1.0-wall.kilwa");
        let metadata = self.path(&format!("{}.toml", words.unwrap_or("first")));
        let described = words.map(|words| format!("description = \"{words}\"\n")).unwrap_or_default();
        std::fs::write(&metadata, format!("{described}{METADATA}")).unwrap();
        let text = |path: &Path| path.to_str().unwrap().to_owned();
        let (pack, site, www) = (text(&pack), text(&self.path("site")), text(&self.path("www")));
        let all = ["publish", &pack, "--to", &site, "--metadata", &text(&metadata), "--www", &www, "--json"];
        let noted = ["--date", "2026-11-22", "--version-note"];
        let noted: Vec<&str> = words.map(|words| [&noted[..], &[words]].concat()).unwrap_or_default();
        args(&[&all[1..], &noted, more].concat())
    }

    fn withdrawing(&self, more: &[&str]) -> Args {
        let (site, keep, www) = (self.path("site"), self.path("keep"), self.path("www"));
        let (site, keep, www) = (site.to_str().unwrap(), keep.to_str().unwrap(), www.to_str().unwrap());
        let all = ["--withdraw", "wall", "--to", site, "--keep", keep, "--reason", "asked to", "--www", www, "--json"];
        args(&[&all[..], more].concat())
    }

    /// The list of the folder's pages says of the object what its manifest says.
    fn is_listed(&self, m: &Manifest) {
        let list = std::fs::read(self.path("site/models.json")).unwrap();
        let list: serde_json::Value = serde_json::from_slice(&list).unwrap();
        let is_withdrawn = m.access.state == AccessState::Withdrawn;
        let pack = m.current().filter(|_| !is_withdrawn).map(|v| format!("wall/{}", v.pack.url));
        let wanted = serde_json::json!({ "access": m.access.state, "version": m.current, "pack": pack });
        for (name, value) in wanted.as_object().unwrap() {
            assert_eq!(list["models"][0][name], *value, "{name}");
        }
        let html = std::fs::read_to_string(self.path("site/index.html")).unwrap();
        assert_eq!(html.contains("<h2>Withdrawn</h2>"), is_withdrawn);
    }

    fn manifest(&self) -> Manifest {
        Manifest::parse(&std::fs::read(self.object().join(MANIFEST)).unwrap()).unwrap()
    }

    /// Every file of every version is there and right, in the object or, of what was withdrawn, outside; the page is the manifest's.
    fn is_whole(&self) -> Manifest {
        let m = self.manifest();
        assert_eq!(sha256(&std::fs::read(self.object().join(PAGE)).unwrap()), m.page.sha256);
        for Version { folder, checksums, .. } in &m.versions {
            let list = std::fs::read(self.object().join(&checksums.url)).unwrap();
            assert_eq!(sha256(&list), checksums.sha256, "{folder}");
            for (path, sum) in Checksums::parse(std::str::from_utf8(&list).unwrap()).unwrap().iter() {
                let here = std::fs::read(self.object().join(folder).join(path));
                let bytes = here.or_else(|_| std::fs::read(self.path("keep/wall").join(folder).join(path)));
                assert_eq!(sha256(&bytes.unwrap()), sum, "{folder}/{path}");
            }
        }
        let keep = Some(self.path("keep")).filter(|keep| keep.is_dir());
        for folder in [self.path("site"), self.object()].into_iter().chain(keep) {
            let hidden =
                |e: std::io::Result<std::fs::DirEntry>| e.unwrap().file_name().to_string_lossy().starts_with('.');
            assert!(!std::fs::read_dir(&folder).unwrap().any(hidden), "something is left in {}", folder.display());
        }
        m
    }
}

/// Pictures of nothing.
fn blank(_: &Path, folder: &Path, _: &Plan) -> anyhow::Result<Pictured> {
    let names = || [POSTER].into_iter().chain(THUMBNAILS.map(|(name, _)| name));
    for name in names() {
        std::fs::write(folder.join(name), b"\xff\xd8\xff\xe0")?;
    }
    let files = names().map(str::to_owned).collect();
    Ok(Pictured { files, drawings: Vec::new(), preview: None, left_out: Vec::new() })
}

fn publish(args: &Args) -> anyhow::Result<Report> {
    run_planned(args, &mut Plan::for_folder(args)?, &blank)
}

fn run_planned(args: &Args, plan: &mut Plan, picture: Picture<'_>) -> anyhow::Result<Report> {
    let progress = Progress::new(&stages(args, plan), plan.given.pack_bytes);
    run_with(args, plan, &progress, picture)
}

#[test]
fn progress_is_continuous_over_all_stages_of_a_publication() {
    let bench = Bench::new();
    let args = bench.publishing(None, &[]);
    let mut plan = Plan::for_folder(&args).unwrap();
    let (progress, seen) = watched(&stages(&args, &plan), plan.given.pack_bytes);
    // The pictures report as real ones do.
    let drawn = |pack: &Path, folder: &Path, plan: &Plan| {
        progress.begin(Stage::Pictures);
        (0..6).for_each(|done| progress.at(done, 6));
        progress.begin(Stage::Preview);
        blank(pack, folder, plan)
    };
    run_with(&args, &mut plan, &progress, &drawn).unwrap();
    progress.end();
    let seen = seen.lock().unwrap();
    let mut names: Vec<&str> = seen.iter().map(|(name, _)| *name).collect();
    names.dedup();
    assert_eq!(
        names,
        [
            "checking the pack",
            "copying the pack",
            "hashing the pack",
            "drawing",
            "making the preview",
            "writing the records"
        ]
    );
    let shares: Vec<f64> = seen.iter().map(|(_, share)| *share).collect();
    assert!(shares.is_sorted() && shares[0] == 0.0 && shares.last() == Some(&1.0), "{shares:?}");
    // Each stage begins where the one before it ends.
    let begins: Vec<f64> = names.iter().map(|name| seen.iter().find(|(n, _)| n == name).unwrap().1).collect();
    assert!(begins.windows(2).all(|pair| pair[0] < pair[1]), "{begins:?}");
}

#[test]
fn two_publications_planned_as_the_same_version_are_both_published_in_turn() {
    let bench = Bench::new();
    publish(&bench.publishing(None, &[])).unwrap();
    let (ours, theirs) = (bench.publishing(Some("ours"), &[]), bench.publishing(Some("theirs"), &[]));
    let mut planned = Plan::for_folder(&ours).unwrap();
    assert_eq!(publish(&theirs).unwrap().version, 2);
    let report = run_planned(&ours, &mut planned, &blank).unwrap();
    assert_eq!(report.version, 3);
    assert!(
        report.warnings.iter().any(|w| w.contains("version 2 was published by somebody else")),
        "{:?}",
        report.warnings
    );
    let notes: Vec<String> = bench.is_whole().versions.into_iter().map(|v| v.note).collect();
    assert_eq!(notes, ["First publication", "theirs", "ours"]);
}

#[test]
fn an_object_withdrawn_during_a_publication_stays_withdrawn() {
    let bench = Bench::new();
    publish(&bench.publishing(None, &[])).unwrap();
    let ours = bench.publishing(Some("ours"), &[]);
    let mut planned = Plan::for_folder(&ours).unwrap();
    withdraw::run(&bench.withdrawing(&[]), "wall").unwrap();
    let why = run_planned(&ours, &mut planned, &blank).err().unwrap().to_string();
    assert!(why.contains("was withdrawn"), "{why}");
    let m = bench.is_whole();
    assert_eq!((m.access.state, m.versions.len()), (AccessState::Withdrawn, 1));
}

#[test]
fn a_withdrawal_updates_pages_that_list_the_object_and_makes_none_where_there_are_none() {
    let bench = Bench::new();
    publish(&bench.publishing(None, &[])).unwrap();
    withdraw::run(&bench.withdrawing(&[]), "wall").unwrap();
    assert!(!bench.path("site/models.json").exists() && !bench.path("site/index.html").exists());
    let bench = Bench::new();
    publish(&bench.publishing(None, &["--site"])).unwrap();
    // The pages cannot be written: the same command does that then.
    let feed = bench.path("site/feed.xml");
    std::fs::remove_file(&feed).unwrap();
    std::fs::create_dir_all(feed.join("in the way")).unwrap();
    let why = format!("{:#}", withdraw::run(&bench.withdrawing(&[]), "wall").unwrap_err());
    assert!(why.contains("the object is withdrawn, but the pages"), "{why}");
    std::fs::remove_dir_all(&feed).unwrap();
    withdraw::run(&bench.withdrawing(&[]), "wall").unwrap();
    bench.is_listed(&bench.is_whole());
    let why = withdraw::run(&bench.withdrawing(&[]), "wall").unwrap_err().to_string();
    assert!(why.contains("was already withdrawn") && why.contains("nothing was changed"), "{why}");
}

#[test]
fn requirements_of_the_object_are_checked_again_after_the_version_is_made() {
    let bench = Bench::new();
    let closed = "[access]\nstate = \"restricted\"\n";
    let restrict = |args: &Args| {
        let file = args.metadata.as_ref().unwrap();
        std::fs::write(file, std::fs::read_to_string(file).unwrap() + closed).unwrap();
    };
    // Two first versions of one name: the second is a further one, and says nothing of what is new.
    let (first, second) = (bench.publishing(None, &[]), bench.publishing(Some("second"), &[]));
    let without_note = Args { version_note: None, date: None, ..second };
    let mut planned = Plan::for_folder(&without_note).unwrap();
    publish(&first).unwrap();
    let why = run_planned(&without_note, &mut planned, &blank).err().unwrap().to_string();
    assert!(why.contains("is published already") && why.contains("--version-note"), "{why}");
    // A version that closes the object comes while an open one is made.
    let (open, restricted) = (bench.publishing(Some("open"), &[]), bench.publishing(Some("closed"), &[]));
    restrict(&restricted);
    let mut planned = Plan::for_folder(&open).unwrap();
    publish(&restricted).unwrap();
    let why = run_planned(&open, &mut planned, &blank).err().unwrap().to_string();
    assert!(why.contains("is restricted, and this version would be public"), "{why}");
    assert_eq!(bench.is_whole().versions.len(), 2);
}

#[test]
fn a_rerun_reports_what_exists_and_creates_what_is_missing() {
    let bench = Bench::new();
    let first = bench.publishing(None, &["--bag", "--site"]);
    assert!(!publish(&first).unwrap().already);
    let before = bench.is_whole();
    std::fs::remove_dir_all(bench.path("site/wall.bag")).unwrap();
    std::fs::remove_file(bench.path("site/feed.xml")).unwrap();
    let again = publish(&first).unwrap();
    assert!(again.already && again.version == 1 && bench.is_whole() == before);
    assert!(bench.path("site/wall.bag/bagit.txt").exists() && bench.path("site/feed.xml").exists());
    // Only the pages of the folder fail.
    let further = bench.publishing(Some("further"), &["--site"]);
    let feed = bench.path("site/feed.xml");
    std::fs::remove_file(&feed).unwrap();
    std::fs::create_dir_all(feed.join("in the way")).unwrap();
    let why = format!("{:#}", publish(&further).err().unwrap());
    assert!(why.contains("the version is published, but the pages") && why.contains("same command again"), "{why}");
    assert!(!why.contains("nothing was changed") && why.matches("os error").count() == 1, "{why}");
    std::fs::remove_dir_all(&feed).unwrap();
    assert!(publish(&further).unwrap().already && feed.is_file());
    assert!(publish(&further).unwrap().already);
    bench.is_listed(&bench.is_whole());
    let further = bench.publishing(Some("another"), &[]);
    assert!(!publish(&further).unwrap().already && publish(&further).unwrap().already);
    assert_eq!(bench.is_whole().versions.len(), 3);
    // The pages list the object, so they follow without --site, and its page still links to them.
    bench.is_listed(&bench.is_whole());
    assert!(std::fs::read_to_string(bench.object().join(PAGE)).unwrap().contains("All models"));
    // Another version of the very same is none.
    let same = Args { version_note: Some("other words".to_owned()), ..further };
    assert!(publish(&same).err().unwrap().to_string().contains("nothing new to publish"));
    let list = bench.path("site/models.json");
    std::fs::write(&list, "damaged").unwrap();
    assert!(!publish(&bench.publishing(Some("one more"), &[])).unwrap().pages);
    assert_eq!(std::fs::read(&list).unwrap(), b"damaged", "what only the list named must not be lost");
}

#[test]
fn two_publishers_and_a_withdrawal_lose_nothing_in_200_rounds() {
    let rounds: u64 = if std::env::var_os("KILWA_SOAK").is_some() { 2000 } else { 200 };
    let (mut published, mut refused, mut withdrawn) = (0, 0, 0);
    for round in 0..rounds {
        let bench = Bench::new();
        publish(&bench.publishing(None, &[])).unwrap();
        let mut random = fastrand::Rng::with_seed(round);
        // Which of them is where is what this is about: no state is waited for.
        let mut pause = || std::time::Duration::from_micros(random.u64(..12_000));
        let (site, bag): (&[&str], &[&str]) =
            if round % 5 == 0 { (&["--site"], &["--site", "--bag"]) } else { (&[], &[]) };
        let publishing =
            [("ours", bench.publishing(Some("ours"), bag)), ("theirs", bench.publishing(Some("theirs"), site))];
        let (takes, pauses) = (bench.withdrawing(site), [pause(), pause(), pause(), pause(), pause()]);
        let (ends, taken) = std::thread::scope(|scope| {
            let publishers: Vec<_> = publishing
                .iter()
                .zip(pauses.chunks(2))
                .map(|((words, args), pauses)| {
                    scope.spawn(move || {
                        std::thread::sleep(pauses[0]);
                        let planned = Plan::for_folder(args);
                        std::thread::sleep(pauses[1]);
                        (*words, planned.and_then(|mut plan| run_planned(args, &mut plan, &blank)))
                    })
                })
                .collect();
            let taker = (round % 3 > 0).then(|| {
                scope.spawn(|| {
                    std::thread::sleep(pauses[4] * 3);
                    withdraw::run(&takes, "wall")
                })
            });
            let ends: Vec<_> = publishers.into_iter().map(|p| p.join().unwrap()).collect();
            (ends, taker.map(|t| t.join().unwrap()))
        });
        let m = bench.is_whole();
        if round % 5 == 0 {
            bench.is_listed(&m);
        }
        let is_withdrawn = taken.is_some_and(|taken| taken.map_err(|e| panic!("round {round}: {e:#}")).is_ok());
        assert_eq!(m.access.state == AccessState::Withdrawn, is_withdrawn, "round {round}");
        withdrawn += u64::from(is_withdrawn);
        for (words, end) in ends {
            let is_there = m.versions.iter().any(|v| v.note == words);
            match end {
                Ok(report) => {
                    assert!(is_there && m.versions[report.version as usize - 1].note == words, "round {round}");
                }
                Err(why) => {
                    let why = format!("{why:#}");
                    assert!(!is_there && is_withdrawn && why.contains("was withdrawn"), "round {round}: {why}");
                    refused += 1;
                    continue;
                }
            }
            published += 1;
        }
    }
    crate::terminal::say!("{rounds} rounds: {published} published, {refused} refused, {withdrawn} withdrawn, 0 lost");
    assert!(published > rounds / 2 && refused > rounds / 20 && withdrawn > rounds / 2);
}
