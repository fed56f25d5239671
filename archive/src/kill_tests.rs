//! Every command that changes an archive is killed before every change on disk, and, if `strace` is installed, before the system calls that make one: each leaves
//! the old object or the new one, served whole, and running the same command again reaches the same result.

use super::bag::{self, BagInfo};
use super::checksums::sha256;
use super::draft::tests::{folders, is_whole, pack_of, publish_as, slug, tree};
use super::draft::{Draft, DraftError, Steps};
use super::keep::Folders;
use super::layout::{MANIFEST, PAGE};
use super::lock::{Lock, PATIENCE};
use super::manifest::{AccessState, Manifest};
use super::next::settle;
use super::site;
use super::withdraw::{Withdrawal, withdraw};
use crate::viewer::Page;
use axum::body::Body;
use axum::http::{Request, StatusCode};
use kilwa_server::{Catalogue, Site, app};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitStatus, Stdio};
use tower::ServiceExt as _;

#[path = "../../tests/support/kill_seed.rs"]
mod kill_seed;

/// The command that is killed, and what exists before it.
#[derive(Debug, Clone, Copy, PartialEq)]
enum What {
    /// A version of this number.
    Publish(u32),
    /// A second version, which closes what was public.
    Close,
    /// A third version, which opens what was public and then closed.
    Open,
    /// An object with two versions and a bag.
    Withdraw,
    /// Another bag of an object with two versions.
    Bag,
    /// The pages of the folder, for the first time or again.
    Site(bool),
}

const ALL: [What; 8] = [
    What::Publish(1),
    What::Publish(2),
    What::Close,
    What::Open,
    What::Withdraw,
    What::Bag,
    What::Site(false),
    What::Site(true),
];

impl What {
    /// The version that is added, and the access state of the object afterwards.
    fn added(self) -> Option<(u32, AccessState)> {
        match self {
            Self::Publish(version) => Some((version, AccessState::Public)),
            Self::Close => Some((2, AccessState::Restricted)),
            Self::Open => Some((3, AccessState::Public)),
            Self::Withdraw | Self::Bag | Self::Site(_) => None,
        }
    }
}

/// A folder of objects, and one outside of it.
struct Archive {
    folder: tempfile::TempDir,
}

impl Archive {
    fn new(what: What) -> Self {
        // Thousands of files are put on disk: in memory that takes no time.
        let memory = Path::new("/dev/shm");
        let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() };
        let archive = Self { folder: folder.unwrap() };
        fs::create_dir(archive.shelf()).unwrap();
        for version in 1..what.added().map_or(3, |(version, _)| version) {
            let is_closed = what == What::Open && version == 2;
            let state = if is_closed { AccessState::Restricted } else { AccessState::Public };
            publish_as(&archive.shelf(), version, &|_| Ok(()), state).unwrap();
        }
        match what {
            What::Withdraw | What::Bag => wrap(&archive.shelf(), &|_| Ok(())).unwrap(),
            What::Site(true) => pages(&archive.shelf(), &|_| Ok(())).unwrap(),
            _ => {}
        }
        archive
    }

    fn shelf(&self) -> PathBuf {
        self.folder.path().join("shelf")
    }
}

/// A program started by another test at this moment inherits open files and locks until it executes.
fn locked(shelf: &Path) -> Result<Lock, DraftError> {
    Lock::wait(shelf, PATIENCE, &|| ())
}

fn wrap(shelf: &Path, steps: Steps<'_>) -> Result<(), DraftError> {
    let info = BagInfo {
        organization: None,
        identifier: "urn:x".to_owned(),
        description: "Fort".to_owned(),
        date: "2026-11-21".to_owned(),
        tool: "kilwa".to_owned(),
    };
    bag::wrap(&locked(shelf)?, &slug(), &info, steps).map(drop)
}

fn pages(shelf: &Path, steps: Steps<'_>) -> Result<(), DraftError> {
    let page = Page::from_files([("style.css".to_owned(), b"css".to_vec())].into());
    site::write(&locked(shelf)?, &page, site::Listed::All, steps)
}

/// Run the command; running it again must not repeat finished work.
fn run(what: What, folder: &Path, steps: Steps<'_>) -> Result<(), DraftError> {
    let (shelf, keep) = (folder.join("shelf"), folder.join("keep"));
    match (what, what.added()) {
        (_, Some((version, state))) => {
            let settled = settle(&locked(&shelf)?, &slug(), steps)?;
            if settled.is_none_or(|m| m.current < version) {
                publish_as(&shelf, version, steps, state)?;
            } else {
                // The program makes a version before it finds that it is there.
                Draft::begin(&locked(&shelf)?, &slug(), steps)?;
            }
            Ok(())
        }
        (What::Bag, _) => wrap(&shelf, steps),
        (What::Site(_), _) => pages(&shelf, steps),
        _ => {
            let withdrawal = Withdrawal { reason: "asked to", day: "2026-11-21" };
            withdraw(&Folders::lock(&shelf, &keep, &slug(), &|_| (), steps)?, &slug(), &withdrawal, steps).map(drop)
        }
    }
}

/// The server's response to a visitor of the site.
async fn get(shelf: &Path, path: &str) -> (StatusCode, Vec<u8>) {
    let page = kilwa_server::Page::from_files([("index.html".to_owned(), b"<html></html>".to_vec())].into());
    let app = app(Site::new(Catalogue::open(shelf).unwrap(), page));
    let answer =
        app.oneshot(Request::get(path).header("host", "x.example").body(Body::empty()).unwrap()).await.unwrap();
    let status = answer.status();
    (status, axum::body::to_bytes(answer.into_body(), usize::MAX).await.unwrap().to_vec())
}

/// What must hold at every moment.
fn is_old_or_new(what: What, folder: &Path) {
    let (shelf, object) = (folder.join("shelf"), folder.join("shelf/fort"));
    let threads = tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap();
    let get = |path: &str| threads.block_on(get(&shelf, path));
    if !object.exists() {
        assert_eq!(what, What::Publish(1), "the object is gone");
        return;
    }
    let manifest = Manifest::parse(&fs::read(object.join(MANIFEST)).unwrap()).unwrap();
    // A static host shows this page, whatever the manifest says.
    let page = fs::read_to_string(object.join(PAGE)).unwrap();
    let needs = page.split("needs ").nth(1);
    if manifest.access.state == AccessState::Withdrawn {
        assert_eq!(what, What::Withdraw);
        for version in &manifest.versions {
            let (_, here) = (get(&format!("/fort/{}", version.pack.url)), object.join(&version.pack.url));
            assert!(here.exists() || folder.join("keep/fort").join(&version.pack.url).exists(), "a pack is lost");
            assert_eq!(get(&format!("/fort/{}", version.pack.url)).0, StatusCode::GONE);
        }
        let (status, served) = get("/fort/");
        assert!(status == StatusCode::GONE && String::from_utf8_lossy(&served).contains("asked to"));
        assert!(needs.is_none_or(|needs| object.join(needs).exists()), "a static host shows half of it");
        return;
    }
    let current = is_whole(&object);
    let added = what.added().map_or(2, |(version, _)| version);
    assert!(current == added || (what.added().is_some() && current + 1 == added));
    is_closed_to_others(what, folder, &manifest);
    assert!(object.join(needs.unwrap()).exists(), "a static host shows half of it");
    let (status, served) = get("/fort/");
    let served = String::from_utf8(served).unwrap();
    assert!(status == StatusCode::OK && served.contains(&format!("page of {current},")), "{served}");
    assert_eq!(sha256(&get("/fort/index.html").1), manifest.page.sha256);
    let is_open = manifest.access.state == AccessState::Public;
    for version in &manifest.versions {
        assert_eq!(get(&format!("/fort/{}", version.pack.url)).0.is_success(), is_open, "{}", version.pack.url);
        assert_eq!(get(&format!("/fort/{}", version.checksums.url)).0, StatusCode::OK, "{}", version.checksums.url);
    }
}

/// No other user of the computer can read a model that is not public, or a version that will not be public.
#[cfg(unix)]
fn is_closed_to_others(what: What, folder: &Path, manifest: &Manifest) {
    let visible = super::draft::tests::visible(folder);
    let closed = manifest.versions.iter().filter(|_| manifest.access.state != AccessState::Public).map(|v| v.version);
    for version in closed.chain((what == What::Close).then_some(2)) {
        assert!(!visible.contains(&pack_of(version)), "{what:?}: others can read version {version}");
    }
}

#[cfg(not(unix))]
fn is_closed_to_others(_: What, _: &Path, _: &Manifest) {}

/// The same, and that the same command continues.
fn is_gone_on_with(what: What, archive: &Archive, whole: &Archive, cut: &str) {
    let folder = archive.folder.path();
    is_old_or_new(what, folder);
    run(what, folder, &|_| Ok(())).unwrap_or_else(|e| panic!("{what:?}, {cut}: {e}"));
    is_old_or_new(what, folder);
    let (mut there, wanted) = (tree(folder), tree(whole.folder.path()));
    // Only the newest of these remains, and nobody reads it.
    there.retain(|name, _| !name.ends_with(".kilwa-lock"));
    let differ = |name: &&String| there.get(*name) != wanted.get(*name);
    let names: Vec<&String> = there.keys().chain(wanted.keys()).filter(differ).collect();
    assert!(names.is_empty(), "{what:?}, {cut}: it does not come to the same: {names:?}");
    assert_eq!(folders(folder), folders(whole.folder.path()), "{what:?}, {cut}: folders are left");
    #[cfg(unix)]
    {
        use super::draft::tests::modes;
        let mut there = modes(folder);
        there.retain(|name, _| !name.ends_with(".kilwa-lock"));
        assert_eq!(there, modes(whole.folder.path()), "{what:?}, {cut}: the permissions differ");
    }
}

fn whole(what: What) -> Archive {
    let archive = Archive::new(what);
    run(what, archive.folder.path(), &|_| Ok(())).unwrap();
    archive
}

const KILL: &str = "KILWA_TEST_KILL_AT";

/// Helper that other tests run in a separate process: performs the change and dies at a step.
#[test]
fn helper_process_that_dies_at_a_step() {
    let Ok(text) = std::env::var(KILL) else { return };
    let parts: Vec<&str> = text.splitn(3, ' ').collect();
    let (what, step): (usize, u32) = (parts[0].parse().unwrap(), parts[1].parse().unwrap());
    let count = Cell::new(0);
    let dying = |_: &str| {
        count.set(count.get() + 1);
        if count.get() > step {
            std::process::abort();
        }
        Ok(())
    };
    run(ALL[what], Path::new(parts[2]), &dying).unwrap();
}

/// Run the test above with so many steps to live, by way of another program where one is named.
fn dying(by: &[&str], what: What, step: u32, folder: &Path) -> ExitStatus {
    let number = ALL.iter().position(|w| *w == what).unwrap();
    let program = std::env::current_exe().unwrap();
    let mut command = match by.split_first() {
        Some((first, rest)) => {
            let mut command = Command::new(first);
            command.args(rest).arg(program);
            command
        }
        None => Command::new(program),
    };
    command
        .args(["--exact", "kill_tests::helper_process_that_dies_at_a_step", "--quiet", "--test-threads=1"])
        .env(KILL, format!("{number} {step} {}", folder.display()))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .unwrap()
}

#[test]
fn a_kill_before_any_disk_change_leaves_the_old_or_new_object_and_a_rerun_finishes() {
    for what in ALL {
        let whole = whole(what);
        for step in 0.. {
            let archive = Archive::new(what);
            let ended = dying(&[], what, step, archive.folder.path());
            if ended.success() {
                assert!(step > 5, "{step} steps are too few");
                println!("{what:?}: killed at {step} steps");
                break;
            }
            is_gone_on_with(what, &archive, &whole, &format!("killed at step {step}"));
        }
    }
}

/// The system calls that change a disk.
const CALLS: &str = "rename,renameat,renameat2,unlink,unlinkat,rmdir,mkdir,mkdirat,link,linkat,write,pwrite64,writev,fsync,fdatasync,ftruncate,chmod,fchmod,fchmodat,chown,lchown,fchown,fchownat,copy_file_range,sendfile,flock";

/// How often each of these calls is made, in a run that comes to its end.
fn calls(what: What) -> BTreeMap<String, u32> {
    let (archive, mut counts) = (Archive::new(what), BTreeMap::new());
    let log = archive.folder.path().join("log");
    let by = ["strace", "-f", "-qq", "-o", log.to_str().unwrap(), "-e", &format!("trace={CALLS}")];
    assert!(dying(&by, what, u32::MAX, archive.folder.path()).success());
    for line in fs::read_to_string(log).unwrap().lines() {
        let name = line.split('(').next().and_then(|begin| begin.split_whitespace().last());
        if let Some(name) = name.filter(|name| CALLS.split(',').any(|call| call == *name)) {
            *counts.entry(name.to_owned()).or_default() += 1;
        }
    }
    counts
}

#[test]
fn a_kill_before_any_system_call_leaves_the_old_or_new_object_and_a_rerun_finishes() {
    let works = Command::new("strace").args(["-f", "-qq", "-o", "/dev/null", "true"]).status();
    if !works.is_ok_and(|status| status.success()) {
        println!(
            "skipped: killing the program before system calls: strace is not installed, or may not trace programs"
        );
        return;
    }
    // A run takes a twentieth of a second, so usually only some of the calls are tried; each seed chooses others.
    let every = if std::env::var_os("KILWA_SOAK").is_some() { 1 } else { 7 };
    let seed = kill_seed::seed();
    println!("killed at one in {every} system calls; repeat with KILWA_KILL_SEED={seed}");
    let mut skipped = seed % every;
    for what in ALL {
        let (whole, mut killed, mut of) = (whole(what), 0, 0);
        for (call, count) in calls(what) {
            for nth in 1..=count {
                of += 1;
                skipped = (skipped + 1) % every;
                if skipped > 0 {
                    continue;
                }
                let archive = Archive::new(what);
                let inject = format!("inject={call}:signal=KILL:when={nth}");
                let by = ["strace", "-f", "-qq", "-o", "/dev/null", "-e", &format!("trace={call}"), "-e", &inject];
                killed += u32::from(!dying(&by, what, u32::MAX, archive.folder.path()).success());
                is_gone_on_with(what, &archive, &whole, &format!("killed at call {nth} of {call}"));
            }
        }
        println!("{what:?}: killed at {killed} of {of} system calls");
        assert!(killed > 0 && of > 20, "{killed} of {of} calls are too few");
    }
}
