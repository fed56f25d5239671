//! `kilwa verify` on archive objects, folders of them and addresses: a changed byte of any file is found and named, so is what is missing
//! or too much; a nightly job continues where it was stopped.

#[cfg(unix)]
use crate::support::make_pipe;
use crate::support::{built_once, fails, kilwa, succeeds, text};
use kilwa_archive::Metadata;
use kilwa_archive::checksums::sha256;
use kilwa_archive::draft::{Draft, DraftError};
use kilwa_archive::frame::Frame;
use kilwa_archive::keep::{Folders, KEEPING};
use kilwa_archive::layout::{self, Slug, pack_name, version_folder};
use kilwa_archive::lock::Lock;
use kilwa_archive::manifest::{Access, AccessState, FORM, Figures, Manifest, PackEntry, RightsEntry, Version};
use kilwa_archive::page::{Surroundings, landing};
use kilwa_archive::record::{Publication, records, ro_crate};
use kilwa_archive::rights::Rights;
use kilwa_archive::withdraw::{Withdrawal, withdraw};
use kilwa_pack::{Reader, SliceSource};
use std::cell::Cell;
use std::collections::BTreeSet;
use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

const METADATA: &str = "title = \"Gereza\"\ndescription = \"A fort.\"\n[rights]\nuri = \"CC BY 4.0\"\n[[creators]]\nname = \"Held, C.\"\n[model]\nunits = \"m\"\n";
const VIEWER: &str = "<!doctype html><html><head><base href=\"./\"><title>Kilwa</title><script src=\"boot.js\"></script></head>\
    <body data-pack=\"\" data-list=\"\"><!--title--><!--poster--><!--about--><!--facts--></body></html>";

pub(crate) fn pack() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("verify_objects");
    let write = |input: &Path| drop(succeeds(&["synth", "wall", "--triangles", "3000", "-o", text(input), "--force"]));
    built_once(&folder, "wall", write, &[])
}

fn publication(slug: &str, number: u32, bytes: &[u8]) -> Publication {
    let reader = Reader::open(SliceSource(bytes)).unwrap();
    let m = reader.metadata();
    let metadata = Metadata::parse(METADATA).unwrap();
    let sha256 = sha256(bytes);
    Publication {
        rights: Rights::parse(&metadata.rights.uri).unwrap(),
        metadata,
        slug: Slug::new(slug).unwrap(),
        version: number,
        published: format!("2026-11-{:02}", 20 + number),
        first_published: "2026-11-21".to_owned(),
        note: format!("Version {number}"),
        pack: PackEntry {
            url: format!("{}/{}", version_folder(number), pack_name(&sha256)),
            bytes: bytes.len() as u64,
            sha256,
            identity: reader.identity(),
        },
        figures: Figures {
            bounds: [m.bounds_min, m.bounds_max],
            crs: None,
            units: "m".to_owned(),
            source_units: "m".to_owned(),
            triangles: m.triangles,
            points: None,
            vertices: m.vertices,
            spacing: m.median_edge,
            accuracy: None,
        },
        of_pack: m.clone(),
        location_redacted: false,
        preview: None,
        notes: None,
        holes: None,
        tiles: None,
        colours: None,
        tool: "kilwa".to_owned(),
    }
}

/// Publish a version on a shelf; the object.
pub(crate) fn publish(shelf: &Path, slug: &str, number: u32) -> PathBuf {
    let bytes = fs::read(pack()).unwrap();
    let p = publication(slug, number, &bytes);
    let lock = Lock::take(shelf).unwrap();
    let mut draft = Draft::begin(&lock, &p.slug, &|_| Ok(())).unwrap();
    draft.write(p.pack.url.split_once('/').unwrap().1, &bytes).unwrap();
    for (path, content) in records(&p) {
        draft.write(path, &content).unwrap();
    }
    let others = [
        layout::POSTER,
        "viewer/boot.js",
        "viewer/plain/plain.css",
        "viewer/plain/plain.js",
        "poster-600.jpg",
        "poster-300.jpg",
    ];
    for path in others {
        draft.write(path, path.as_bytes()).unwrap();
    }
    let list = ro_crate(&p, draft.files());
    draft.write(layout::CRATE, &list).unwrap();
    let object = shelf.join(slug);
    let earlier =
        fs::read(object.join(layout::MANIFEST)).ok().map(|b| Manifest::parse(&b).unwrap().versions).unwrap_or_default();
    let page =
        landing(Frame::of(VIEWER).unwrap(), &p, &Surroundings { earlier: earlier.clone(), ..Surroundings::default() });
    let made = draft.finish(&lock, number, page.as_bytes(), |checksums, page| {
        let mut versions = earlier;
        versions.push(Version {
            version: number,
            folder: version_folder(number),
            published: p.published.clone(),
            note: p.note.clone(),
            pack: p.pack.clone(),
            checksums,
            annotations: None,
            holes: None,
            tiles: None,
            colour_report: None,
            photographs: None,
            figures: p.figures.clone(),
            location_redacted: false,
        });
        Manifest {
            kilwa: FORM,
            slug: slug.to_owned(),
            title: p.metadata.title.clone(),
            description: None,
            language: "en".to_owned(),
            place: None,
            captured: None,
            subjects: Vec::new(),
            creators: vec!["Held, C.".to_owned()],
            url: None,
            identifier: None,
            rights: RightsEntry { uri: "u".to_owned(), label: "l".to_owned(), short: "s".to_owned(), holder: None },
            citation: "Gereza.".to_owned(),
            access: Access { state: AccessState::Public, until: None, reason: None, contact: None, withdrawn: None },
            current: number,
            versions,
            page,
            tool: "kilwa".to_owned(),
        }
    });
    made.unwrap()
}

pub(crate) fn files(folder: &Path) -> Vec<PathBuf> {
    let mut all = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() { all.extend(files(&path)) } else { all.push(path) }
    }
    all.sort();
    all
}

/// The report of a run that finds something.
pub(crate) fn report(args: &[&str], code: i32) -> serde_json::Value {
    let output = kilwa(&[&["verify"], args, &["--json"]].concat());
    assert_eq!(output.status.code(), Some(code), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// The files with problems, and their kinds.
pub(crate) fn problems(report: &serde_json::Value) -> BTreeSet<(String, String)> {
    let of = |p: &serde_json::Value, key: &str| p[key].as_str().unwrap().to_owned();
    report["problems"].as_array().unwrap().iter().map(|p| (of(p, "file"), of(p, "kind"))).collect()
}

#[test]
fn a_changed_byte_of_any_file_is_found_and_named() {
    let shelf = tempfile::tempdir().unwrap();
    publish(shelf.path(), "fort", 1);
    let object = publish(shelf.path(), "fort", 2);
    let sound = report(&[text(&object)], 0);
    assert_eq!((&sound["sound"], &sound["notes"]), (&true.into(), &serde_json::json!([])), "{sound}");
    let all = files(&object);
    assert_eq!(sound["files"], all.len(), "every file was read");
    for path in &all {
        let good = fs::read(path).unwrap();
        // At the ends and in the middle.
        for at in BTreeSet::from([0, good.len() / 2, good.len() - 1]) {
            let mut bytes = good.clone();
            bytes[at] ^= 4;
            fs::write(path, &bytes).unwrap();
            let name = text(path.strip_prefix(&object).unwrap()).to_owned();
            let found = problems(&report(&[text(&object)], 1));
            let is_named = found.iter().any(|(file, kind)| *file == name && kind == "damaged");
            assert!(is_named, "byte {at} of {name}: {found:?}");
        }
        fs::write(path, &good).unwrap();
    }
    // Another modification time or other permissions alone are not a problem.
    let file = fs::File::options().write(true).open(&all[3]).unwrap();
    file.set_modified(std::time::SystemTime::UNIX_EPOCH).unwrap();
    assert!(succeeds(&["verify", text(&object)]).contains("1 of 1 object sound"));
}

#[test]
fn all_missing_and_extra_files_are_named() {
    let shelf = tempfile::tempdir().unwrap();
    publish(shelf.path(), "fort", 1);
    let object = publish(shelf.path(), "fort", 2);
    for path in files(&object) {
        let (name, good) = (text(path.strip_prefix(&object).unwrap()).to_owned(), fs::read(&path).unwrap());
        fs::remove_file(&path).unwrap();
        let found = problems(&report(&[text(&object)], 1));
        assert!(found.contains(&(name.clone(), "missing".to_owned())), "{name}: {found:?}");
        fs::write(&path, good).unwrap();
    }
    let manifest = Manifest::parse(&fs::read(object.join("manifest.json")).unwrap()).unwrap();
    let pack = object.join(&manifest.versions[0].pack.url);
    let bytes = fs::read(&pack).unwrap();
    fs::write(&pack, &bytes[..bytes.len() - 500]).unwrap();
    fs::write(object.join("notes.txt"), "mine").unwrap();
    fs::write(object.join("v2/metadata/thumbs.db"), "").unwrap();
    fs::create_dir(object.join("v3")).unwrap();
    fs::write(object.join("v3/x"), "").unwrap();
    fs::write(object.join(".kilwa-abc"), "").unwrap();
    let found = report(&[text(&object)], 1);
    let expected = [
        (manifest.versions[0].pack.url.as_str(), "damaged"),
        ("notes.txt", "extra"),
        ("v2/metadata/thumbs.db", "extra"),
        ("v3/x", "extra"),
    ];
    assert_eq!(problems(&found), expected.map(|(f, k)| (f.to_owned(), k.to_owned())).into());
    let cut = found["problems"].to_string();
    assert!(cut.contains("truncated") && cut.contains("SHA-256"), "{cut}");
    assert!(found["notes"][0].as_str().unwrap().contains(".kilwa-abc"));
    let message = fails(&["verify", text(&object)]);
    assert!(["notes.txt", "thumbs.db", "v3/x", "truncated"].iter().all(|part| message.contains(part)), "{message}");
}

#[test]
fn contradictory_records_and_broken_links_are_named() {
    let shelf = tempfile::tempdir().unwrap();
    let object = publish(shelf.path(), "fort", 1);
    // As somebody would who writes checksums again after a change.
    let redo = |change: &dyn Fn(&Path)| {
        let copy = tempfile::tempdir().unwrap();
        let to = copy.path().join("fort");
        for path in files(&object) {
            let target = to.join(path.strip_prefix(&object).unwrap());
            fs::create_dir_all(target.parent().unwrap()).unwrap();
            fs::copy(path, target).unwrap();
        }
        change(&to);
        let mut list = kilwa_archive::Checksums::default();
        for path in files(&to.join("v1")).iter().filter(|p| !p.ends_with("checksums.sha256")) {
            list.add(text(path.strip_prefix(to.join("v1")).unwrap()), sha256(&fs::read(path).unwrap()));
        }
        let mut manifest = Manifest::parse(&fs::read(to.join("manifest.json")).unwrap()).unwrap();
        fs::write(to.join("v1/checksums.sha256"), list.to_text()).unwrap();
        let entry = &mut manifest.versions[0].checksums;
        (entry.bytes, entry.sha256) = (list.to_text().len() as u64, sha256(list.to_text().as_bytes()));
        let page = fs::read(to.join("index.html")).unwrap();
        (manifest.page.bytes, manifest.page.sha256) = (page.len() as u64, sha256(&page));
        fs::write(to.join("manifest.json"), manifest.to_bytes().unwrap()).unwrap();
        let output = kilwa(&["verify", text(&to), "--json"]);
        problems(&serde_json::from_slice(&output.stdout).unwrap())
    };
    assert_eq!(redo(&|_| {}), BTreeSet::new());
    let one = |file: &str, kind: &str| BTreeSet::from([(file.to_owned(), kind.to_owned())]);
    let without = redo(&|o| fs::remove_file(o.join("v1/metadata/edm.xml")).unwrap());
    assert!(without.is_superset(&one("v1/metadata/edm.xml", "incomplete")), "{without:?}");
    assert!(without.contains(&("v1/linkset.json".to_owned(), "link".to_owned())), "{without:?}");
    let title = redo(&|o| {
        let path = o.join("v1/metadata/metadata.json");
        fs::write(&path, fs::read_to_string(&path).unwrap().replace("Gereza", "Other")).unwrap();
    });
    assert_eq!(title, one("v1/metadata/metadata.json", "incomplete"));
    let page = redo(&|o| {
        let path = o.join("index.html");
        fs::write(&path, fs::read_to_string(&path).unwrap().replace("</body>", "<a href=\"gone.html\">x</a></body>"))
            .unwrap();
    });
    assert_eq!(page, one("index.html", "link"));
    let broken = redo(&|o| fs::write(o.join("v1/linkset.json"), "{").unwrap());
    assert_eq!(broken, one("v1/linkset.json", "incomplete"));
}

#[test]
fn a_failed_check_is_reported_as_a_problem_in_json() {
    let folder = tempfile::tempdir().unwrap();
    let (none, notes) = (folder.path().join("none.kilwa"), folder.path().join("notes.txt"));
    fs::write(&notes, "years of work\n").unwrap();
    let cases: [(&[&str], &Path, &str); 3] = [
        (&[text(&none)], &none, "missing"),
        (&[text(folder.path())], folder.path(), "unreadable"),
        (&[text(folder.path()), "--state", text(&notes)], folder.path(), "unreadable"),
    ];
    for (args, target, kind) in cases {
        let found = report(args, 1);
        assert_eq!(problems(&found), BTreeSet::from([(text(target).to_owned(), kind.to_owned())]), "{args:?}: {found}");
        assert_eq!(found["sound"], false, "{args:?}");
    }
}

/// Put the object `fort` of a shelf into a bag.
pub(crate) fn wrap(shelf: &Path) -> PathBuf {
    let info = kilwa_archive::bag::BagInfo {
        organization: None,
        identifier: "x".to_owned(),
        description: "x".to_owned(),
        date: "2026-11-21".to_owned(),
        tool: "kilwa".to_owned(),
    };
    let lock = Lock::take(shelf).unwrap();
    kilwa_archive::bag::wrap(&lock, &Slug::new("fort").unwrap(), &info, &|_| Ok(())).unwrap()
}

/// Withdraw the object `fort` of a shelf; every change on disk after the first `changes` fails.
pub(crate) fn withdraw_with(shelf: &Path, keep: &Path, changes: usize) -> Result<(), DraftError> {
    let (slug, count) = (Slug::new("fort").unwrap(), Cell::new(0));
    let steps = |_: &str| {
        count.set(count.get() + 1);
        if count.get() > changes { Err(std::io::Error::other("cut off")) } else { Ok(()) }
    };
    let withdrawal = Withdrawal { reason: "asked to", day: "2026-11-22" };
    withdraw(&Folders::lock(shelf, keep, &slug, &|_| (), &steps)?, &slug, &withdrawal, &steps).map(drop)
}

/// Whether `kilwa verify` finds nothing wrong and explains that a withdrawal of `name` was interrupted.
fn is_explained(target: &Path, name: &str) -> bool {
    let result = report(&[text(target)], 0);
    assert!(result["sound"] == true && problems(&result).is_empty(), "{result}");
    let of_name = |note: &str| note.contains(name) && note.contains("a withdrawal is in progress or was interrupted");
    result["notes"].as_array().unwrap().iter().filter_map(|note| note.as_str()).any(of_name)
}

#[test]
fn an_interrupted_withdrawal_is_explained_and_damage_in_it_is_reported() {
    let (mut bags, mut copies, mut damaged) = (0, 0, 0);
    for changes in (0..).step_by(4) {
        let folder = tempfile::tempdir().unwrap();
        let (shelf, keep) = (folder.path().join("shelf"), folder.path().join("keep"));
        fs::create_dir(&shelf).unwrap();
        let object = publish(&shelf, "fort", 1);
        let (bag, copy) = (wrap(&shelf), keep.join("fort"));
        let ended = withdraw_with(&shelf, &keep, changes);
        let manifest = Manifest::parse(&fs::read(object.join(layout::MANIFEST)).unwrap()).unwrap();
        let is_withdrawn = manifest.access.state == AccessState::Withdrawn;
        let is_bag_left = is_withdrawn && bag.exists();
        assert_eq!(is_explained(&shelf, "fort.bag"), is_bag_left, "{changes}");
        if is_bag_left {
            assert!(is_explained(&bag, "fort.bag"), "{changes}");
            bags += 1;
        }
        if copy.exists() {
            let is_begun = copy.join(KEEPING).exists();
            assert_eq!(is_explained(&copy, "fort"), is_begun, "{changes}");
            copies += u32::from(is_begun);
        }
        let poster = bag.join("data/v1/poster.jpg");
        if is_bag_left && poster.exists() && bag.join("manifest-sha256.txt").exists() {
            // Files of the bag may be hard links to those of the object.
            fs::remove_file(&poster).unwrap();
            fs::write(&poster, "another").unwrap();
            let found = problems(&report(&[text(&bag)], 1));
            assert!(found.contains(&("data/v1/poster.jpg".to_owned(), "damaged".to_owned())), "{found:?}");
            damaged += 1;
        }
        if ended.is_ok() {
            assert!(!bag.exists() && !copy.join(KEEPING).exists());
            break;
        }
    }
    assert!(bags > 5 && copies > 3 && damaged > 0, "{bags}, {copies}, {damaged}");
    // Without a withdrawal, a missing file is a problem.
    let shelf = tempfile::tempdir().unwrap();
    publish(shelf.path(), "fort", 1);
    let bag = wrap(shelf.path());
    fs::remove_file(bag.join("data/v1/poster.jpg")).unwrap();
    assert!(problems(&report(&[text(&bag)], 1)).contains(&("data/v1/poster.jpg".to_owned(), "missing".to_owned())));
}

#[test]
fn a_bag_is_checked_against_its_manifests_and_its_object() {
    let shelf = tempfile::tempdir().unwrap();
    publish(shelf.path(), "fort", 1);
    let bag = wrap(shelf.path());
    assert_eq!(report(&[text(&bag)], 0)["sound"], true);
    for name in ["bag-info.txt", "bagit.txt", "manifest-sha256.txt", "data/manifest.json"] {
        let path = bag.join(name);
        let good = fs::read(&path).unwrap();
        fs::remove_file(&path).unwrap(); // Files of the bag may be hard links to those of the object.
        let mut bytes = good.clone();
        bytes[2] ^= 1;
        fs::write(&path, bytes).unwrap();
        let found = problems(&report(&[text(&bag)], 1));
        assert!(found.iter().any(|(file, _)| file == name), "{name}: {found:?}");
        fs::write(&path, good).unwrap();
    }
    fs::write(bag.join("data/extra"), "").unwrap();
    assert!(problems(&report(&[text(&bag)], 1)).contains(&("data/extra".to_owned(), "extra".to_owned())));
}

/// A server of a folder that misbehaves as configured; returns a counter of requests and its address.
pub(crate) fn server(folder: &Path, behave: fn(usize, &str) -> Behaviour) -> (Arc<AtomicUsize>, String) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("http://{}/", listener.local_addr().unwrap());
    let count = Arc::new(AtomicUsize::new(0));
    let (folder, counter) = (folder.to_owned(), Arc::clone(&count));
    std::thread::spawn(move || {
        for stream in listener.incoming().flatten() {
            let number = counter.fetch_add(1, Ordering::SeqCst);
            drop(answer(stream, &folder, number, behave));
        }
    });
    (count, address)
}

/// How a server answers.
#[derive(PartialEq)]
pub(crate) enum Behaviour {
    Good,
    IgnoresRange,
    Fails,
    BreaksOff,
    Redirects,
}

fn answer(
    mut stream: TcpStream,
    folder: &Path,
    number: usize,
    behave: fn(usize, &str) -> Behaviour,
) -> std::io::Result<()> {
    let mut request = Vec::new();
    let mut byte = [0];
    while !request.ends_with(b"\r\n\r\n") && stream.read(&mut byte)? == 1 {
        request.push(byte[0]);
    }
    let request = String::from_utf8_lossy(&request).into_owned();
    let path = request.split(' ').nth(1).unwrap_or("/").trim_start_matches('/').to_owned();
    let behaviour = behave(number, &path);
    let head = |status: &str, more: &str, n: usize| {
        format!("HTTP/1.1 {status}\r\nConnection: close\r\nContent-Length: {n}\r\n{more}\r\n")
    };
    let file = if path.is_empty() { folder.join("index.html") } else { folder.join(&path) };
    let Ok(body) = fs::read(file) else { return stream.write_all(head("404 Not Found", "", 0).as_bytes()) };
    let range = request.lines().find_map(|l| l.to_ascii_lowercase().strip_prefix("range: bytes=").map(str::to_owned));
    let range =
        range.and_then(|r| r.split_once('-').map(|(a, b)| (a.parse::<usize>().unwrap(), b.parse::<usize>().unwrap())));
    match (behaviour, range) {
        (Behaviour::Fails, _) => stream.write_all(head("503 Service Unavailable", "", 0).as_bytes()),
        (Behaviour::Redirects, _) => {
            stream.write_all(head("302 Found", &format!("Location: /{path}\r\n"), 0).as_bytes())
        }
        (Behaviour::IgnoresRange, _) | (_, None) => {
            stream.write_all(head("200 OK", "", body.len()).as_bytes())?;
            stream.write_all(&body)
        }
        (behaviour, Some((from, to))) => {
            let part = &body[from.min(body.len())..(to + 1).min(body.len())];
            let more = format!("Content-Range: bytes {from}-{}/{}\r\n", from + part.len() - 1, body.len());
            stream.write_all(head("206 Partial Content", &more, part.len()).as_bytes())?;
            stream.write_all(if behaviour == Behaviour::BreaksOff { &part[..part.len() / 2] } else { part })
        }
    }
}

#[test]
fn an_address_is_checked_like_a_folder() {
    let shelf = tempfile::tempdir().unwrap();
    let object = publish(shelf.path(), "fort", 1);
    publish(shelf.path(), "mosque", 1);
    fs::write(
        shelf.path().join("index.html"),
        "<a href=\"fort/\">f</a><a href=\"mosque/index.html\">m</a><a href=\"about\">x</a>",
    )
    .unwrap();
    let (_, good) = server(shelf.path(), |_, _| Behaviour::Good);
    let (_, plain) = server(shelf.path(), |_, _| Behaviour::IgnoresRange);
    let (_, poor) = server(shelf.path(), |n, _| match n % 7 {
        2 => Behaviour::Fails,
        5 => Behaviour::BreaksOff,
        _ => Behaviour::Good,
    });
    let here = report(&[text(&object)], 0);
    for address in [&good, &plain] {
        let there = report(&[&format!("{address}fort/")], 0);
        assert_eq!((&there["files"], &there["bytes"]), (&here["files"], &here["bytes"]), "{address}");
        assert_eq!(report(&[address], 0)["objects"], 2, "{address}");
    }
    assert_eq!(report(&[&format!("{poor}fort/manifest.json")], 0)["sound"], true);
    let manifest = Manifest::parse(&fs::read(object.join("manifest.json")).unwrap()).unwrap();
    let url = &manifest.versions[0].pack.url;
    assert!(succeeds(&["verify", &format!("{good}fort/{url}")]).contains("sound"));
    // Damage is found from afar.
    let path = object.join(url);
    let mut bytes = fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(&path, bytes).unwrap();
    fs::remove_file(object.join("v1/README.txt")).unwrap();
    for address in [&good, &plain] {
        let found = problems(&report(&[&format!("{address}fort")], 1));
        let expected = [(url.clone(), "damaged".to_owned()), ("v1/README.txt".to_owned(), "missing".to_owned())];
        assert_eq!(found, expected.into(), "{address}");
    }
}

#[test]
fn units_no_longer_listed_are_still_checked_and_missing_only_if_the_server_says_so() {
    static IS_BROKEN: AtomicBool = AtomicBool::new(false);
    let folder = tempfile::tempdir().unwrap();
    let (shelf, state) = (folder.path().join("shelf"), folder.path().join("state"));
    fs::create_dir(&shelf).unwrap();
    publish(&shelf, "fort", 1);
    publish(&shelf, "mosque", 1);
    fs::copy(pack(), shelf.join("single.kilwa")).unwrap();
    let list = |links: &str| fs::write(shelf.join("index.html"), links).unwrap();
    list("<a href=\"fort/\">f</a><a href=\"mosque/\">m</a><a href=\"single.kilwa\">s</a>");
    // A redirect to itself is an error at once; other errors are tried again for seconds.
    let (_, address) = server(&shelf, |_, path| {
        let is_broken = IS_BROKEN.load(Ordering::SeqCst) && path.starts_with("mosque/");
        if is_broken { Behaviour::Redirects } else { Behaviour::Good }
    });
    let run = |more: &[&str], code| report(&[&[address.as_str(), "--state", text(&state)], more].concat(), code);
    assert_eq!(run(&[], 0)["objects"], 3);
    // The others are on another page now.
    list("<a href=\"fort/\">f</a>");
    assert_eq!(run(&[], 0)["sound_objects"], 3);
    fs::remove_file(shelf.join("mosque/v1/README.txt")).unwrap();
    let found = problems(&run(&[], 1));
    assert_eq!(found, BTreeSet::from([("mosque/v1/README.txt".to_owned(), "missing".to_owned())]));
    IS_BROKEN.store(true, Ordering::SeqCst);
    let found = problems(&run(&[], 1));
    assert_eq!(found, BTreeSet::from([("mosque/manifest.json".to_owned(), "unreadable".to_owned())]));
    IS_BROKEN.store(false, Ordering::SeqCst);
    fs::remove_dir_all(shelf.join("mosque")).unwrap();
    fs::remove_file(shelf.join("single.kilwa")).unwrap();
    let missing = ["mosque", "single.kilwa"].map(|name| (name.to_owned(), "missing".to_owned()));
    assert_eq!(problems(&run(&[], 1)), BTreeSet::from(missing));
    assert_eq!(run(&["--forget", "mosque", "--forget", "single.kilwa"], 0)["objects"], 1);
}

#[test]
fn an_unreachable_address_is_refused_with_the_reason() {
    let shelf = tempfile::tempdir().unwrap();
    publish(shelf.path(), "fort", 1);
    let (count, circle) = server(shelf.path(), |_, _| Behaviour::Redirects);
    assert!(fails(&["verify", &format!("{circle}fort/")]).contains("redirect"));
    assert!(count.load(Ordering::SeqCst) < 10, "redirects are bounded");
    let (_, good) = server(shelf.path(), |_, _| Behaviour::Good);
    assert!(fails(&["verify", &format!("{good}nothing/")]).contains("no object"));
    let empty = tempfile::tempdir().unwrap();
    assert!(fails(&["verify", text(empty.path())]).contains("is not an archive object"));
    assert_eq!(kilwa(&["verify", text(empty.path()), "--resume"]).status.code(), Some(2));
    assert_eq!(kilwa(&["verify", text(empty.path()), "--state", "x", "--older-than", "0"]).status.code(), Some(2));
}

/// Only what a server would serve is checked: regular files below the folder, never links.
#[cfg(unix)]
#[test]
fn links_and_special_files_are_named_and_never_followed() {
    use std::os::unix::fs::symlink;
    let (shelf, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let checked = |target: &Path, names: &[&str]| {
        let message = fails(&["verify", text(target)]);
        for name in names {
            assert!(message.contains(name), "{name} is not in: {message}");
        }
    };
    // A pack that was moved away and linked is as sound as it ever was, and not in the archive.
    let object = publish(shelf.path(), "fort", 1);
    let pack = fs::read_dir(object.join("v1")).unwrap().map(|e| e.unwrap().path());
    let pack = pack.into_iter().find(|p| p.extension().is_some_and(|e| e == "kilwa")).unwrap();
    let away = elsewhere.path().join("pack.kilwa");
    fs::rename(&pack, &away).unwrap();
    symlink(&away, &pack).unwrap();
    checked(&object, &["pack.", "it is a link"]);
    checked(shelf.path(), &["fort/v1/pack.", "it is a link"]);
    fs::remove_file(&pack).unwrap();
    make_pipe(&pack);
    checked(&object, &["pack.", "a pipe"]);
    fs::remove_file(&pack).unwrap();
    fs::rename(&away, &pack).unwrap();
    succeeds(&["verify", text(&object)]);
    // A version, and the whole object, behind a link.
    fs::rename(object.join("v1"), elsewhere.path().join("v1")).unwrap();
    symlink(elsewhere.path().join("v1"), object.join("v1")).unwrap();
    checked(&object, &["v1/checksums.sha256", "is a link"]);
    fs::remove_file(object.join("v1")).unwrap();
    fs::rename(elsewhere.path().join("v1"), object.join("v1")).unwrap();
    fs::rename(&object, elsewhere.path().join("fort")).unwrap();
    symlink(elsewhere.path().join("fort"), &object).unwrap();
    checked(shelf.path(), &["fort/manifest.json", "is a link"]);
    // The very thing that a person names may be a link.
    succeeds(&["verify", text(&object)]);
    // Special files where packs lie, beside and alone.
    make_pipe(&shelf.path().join("pipe.kilwa"));
    checked(shelf.path(), &["2 of 2"]);
    checked(&shelf.path().join("pipe.kilwa"), &["a pipe"]);
    // A file that nobody lists.
    fs::remove_file(&object).unwrap();
    let object = publish(elsewhere.path(), "tower", 1);
    symlink("/etc/passwd", object.join("v1/extra")).unwrap();
    checked(&object, &["v1/extra", "unknown file"]);
}

/// The same for a manifest, and for files that the server reads beside objects and packs.
#[cfg(unix)]
#[test]
fn links_and_special_files_beside_objects_and_packs_are_reported_as_damage() {
    let shelf = tempfile::tempdir().unwrap();
    publish(shelf.path(), "fort", 1);
    fs::create_dir(shelf.path().join("tower")).unwrap();
    let target = text(shelf.path());
    for name in ["collections.toml", "site.toml", "wall.annotations.json", "tower/manifest.json"] {
        let at = shelf.path().join(name);
        for is_pipe in [true, false] {
            if is_pipe {
                make_pipe(&at);
            } else {
                std::os::unix::fs::symlink("/etc/passwd", &at).unwrap();
            }
            let found = report(&[target], 1);
            assert_eq!(problems(&found), BTreeSet::from([(name.to_owned(), "unreadable".to_owned())]), "{name}");
            fs::remove_file(&at).unwrap();
        }
        if !name.contains('/') {
            fs::write(&at, "").unwrap();
        }
        succeeds(&["verify", target]);
    }
}

#[cfg(unix)]
#[test]
fn a_file_beside_objects_and_packs_may_be_repaired_or_removed_and_is_not_missing() {
    let folder = tempfile::tempdir().unwrap();
    let (shelf, state) = (folder.path().join("shelf"), folder.path().join("state"));
    fs::create_dir(&shelf).unwrap();
    publish(&shelf, "fort", 1);
    let run = |code| report(&[text(&shelf), "--state", text(&state)], code);
    let names = ["collections.toml", "wall.annotations.json"];
    for name in names {
        let at = shelf.join(name);
        for replacement in [Some(""), None] {
            std::os::unix::fs::symlink("/etc/passwd", &at).unwrap();
            assert_eq!(problems(&run(1)), BTreeSet::from([(name.to_owned(), "unreadable".to_owned())]));
            assert!(!fs::read_to_string(&state).unwrap().contains(name));
            fs::remove_file(&at).unwrap();
            if let Some(content) = replacement {
                fs::write(&at, content).unwrap();
            }
            assert_eq!(run(0)["objects"], 1, "{name}");
            fs::remove_file(&at).ok();
        }
    }
    // Earlier versions of Kilwa wrote these names into the state.
    let mut file = fs::File::options().append(true).open(&state).unwrap();
    for name in names {
        writeln!(file, "{{\"kilwa-verify\":\"unit\",\"name\":\"{name}\",\"at\":1,\"problems\":1}}").unwrap();
    }
    assert_eq!(run(0)["objects"], 1);
}

/// A `kilwa` command as a user who cannot read the folder `closed`: root can read everything.
#[cfg(unix)]
fn without_access_to(closed: &Path, args: &[&str]) -> std::process::Command {
    use std::os::unix::process::CommandExt as _;
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_kilwa"));
    command.args(args).current_dir("/");
    if fs::read_dir(closed).is_ok() {
        command.uid(65_534).gid(65_534);
    }
    command
}

#[cfg(unix)]
#[test]
fn an_object_that_this_user_cannot_read_is_unreadable_and_not_missing() {
    use std::os::unix::fs::PermissionsExt as _;
    let folder = tempfile::tempdir().unwrap();
    let (shelf, states, closed) = (folder.path().join("shelf"), folder.path().join("states"), folder.path().join("no"));
    let allow = |path: &Path, mode| fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    for (path, mode) in [(&shelf, 0o755), (&states, 0o777), (&closed, 0o000), (&shelf.join("lost+found"), 0o000)] {
        fs::create_dir(path).unwrap();
        allow(path, mode);
    }
    allow(folder.path(), 0o755);
    let object = publish(&shelf, "fort", 1);
    publish(&shelf, "mosque", 1);
    let state = states.join("state");
    let run = || without_access_to(&closed, &["verify", text(&shelf), "--json", "--state", text(&state)]).output();
    let found = |output: std::process::Output| {
        let report = serde_json::from_slice::<serde_json::Value>(&output.stdout);
        problems(&report.unwrap_or_else(|_| panic!("{}", String::from_utf8_lossy(&output.stderr))))
    };
    if let Ok(first) = run() {
        assert_eq!(found(first), BTreeSet::new());
        allow(&object, 0o000);
        let unreadable = BTreeSet::from([("fort/manifest.json".to_owned(), "unreadable".to_owned())]);
        for _ in 0..2 {
            assert_eq!(found(run().unwrap()), unreadable);
        }
        allow(&object, 0o755);
        assert_eq!(found(run().unwrap()), BTreeSet::new());
    } else {
        println!("skipped: a folder of another user: this test cannot run the program as another user");
    }
    allow(&closed, 0o700);
    allow(&shelf.join("lost+found"), 0o700);
}

#[cfg(unix)]
#[test]
fn an_unreadable_unfinished_publication_of_another_user_is_reported() {
    use std::os::unix::fs::PermissionsExt as _;
    let shelf = tempfile::tempdir().unwrap();
    fs::set_permissions(shelf.path(), fs::Permissions::from_mode(0o755)).unwrap();
    let object = publish(shelf.path(), "fort", 1);
    let closed = object.join(".kilwa-fort--aB3dEf");
    fs::create_dir(&closed).unwrap();
    fs::set_permissions(&closed, fs::Permissions::from_mode(0o000)).unwrap();
    let Ok(output) = without_access_to(&closed, &["verify", text(&object)]).output() else {
        println!("skipped: a folder of another user: this test cannot run the program as another user");
        return;
    };
    let printed = String::from_utf8_lossy(&[output.stdout, output.stderr].concat()).into_owned();
    fs::set_permissions(&closed, fs::Permissions::from_mode(0o700)).unwrap();
    assert!(output.status.success(), "{printed}");
    assert!(printed.contains(".kilwa-fort--aB3dEf belongs to a publication that is in progress"), "{printed}");
}
