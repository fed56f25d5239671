use super::*;
use crate::object::manifest::tests::sample;
use std::cell::Cell;
use std::collections::BTreeMap;

fn slug() -> Slug {
    Slug::new("fort").unwrap()
}

/// Publish version `version` with some files; the words in them tell versions apart.
fn publish(shelf: &Path, version: u32, steps: Steps<'_>) -> Result<PathBuf, DraftError> {
    let mut draft = Draft::begin(shelf, &slug(), version, steps)?;
    draft.write("a.txt", format!("a of {version}").as_bytes())?;
    draft.write("metadata/b.txt", format!("b of {version}").as_bytes())?;
    fs::write(draft.folder().join("by-others.part"), "pack").unwrap();
    draft.adopt_named("by-others.part", |sum| format!("by-others.{}.txt", &sum[..4]))?;
    draft.finish(format!("page of {version}").as_bytes(), |checksums, page| {
        let mut m = sample();
        m.versions.truncate(version as usize);
        m.current = version;
        m.page = page;
        if let Some(last) = m.versions.last_mut() {
            last.checksums = checksums;
        }
        m
    })
}

/// Every file of a folder, hidden ones too.
fn tree(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            all.extend(tree(&path).into_iter().map(|(p, b)| (format!("{name}/{p}"), b)));
        } else {
            all.insert(name, fs::read(&path).unwrap());
        }
    }
    all
}

/// The object's manifest names folders that are complete: every checksum right, nothing else in them.
fn is_whole(object: &Path) -> u32 {
    let manifest = Manifest::parse(&fs::read(object.join(MANIFEST)).unwrap()).unwrap();
    for v in &manifest.versions {
        let list = fs::read(object.join(&v.checksums.url)).unwrap();
        assert_eq!(
            sha256(&list),
            if v.version == manifest.current { v.checksums.sha256.clone() } else { sha256(&list) }
        );
        let list = Checksums::parse(std::str::from_utf8(&list).unwrap()).unwrap();
        let there = tree(&object.join(&v.folder));
        assert_eq!(there.len(), list.len() + 1);
        for (path, sum) in list.iter() {
            assert_eq!(sha256(&there[path]), sum, "{path}");
        }
    }
    manifest.current
}

#[test]
fn versions_are_added_and_what_is_there_never_changes() {
    let shelf = tempfile::tempdir().unwrap();
    let object = publish(shelf.path(), 1, &|_| Ok(())).unwrap();
    let first = tree(&object.join("v1"));
    assert_eq!(is_whole(&object), 1);
    publish(shelf.path(), 2, &|_| Ok(())).unwrap();
    assert_eq!((is_whole(&object), tree(&object.join("v1"))), (2, first));
    assert_eq!(fs::read(object.join(PAGE)).unwrap(), b"page of 2");
    assert_eq!(fs::read_dir(&object).unwrap().count(), 4);
    assert!(matches!(publish(shelf.path(), 1, &|_| Ok(())), Err(DraftError::There(_))));
}

#[test]
fn a_failure_at_any_step_leaves_what_was_there_and_nothing_else() {
    for version in [1, 2] {
        for step in 0.. {
            let shelf = tempfile::tempdir().unwrap();
            if version == 2 {
                publish(shelf.path(), 1, &|_| Ok(())).unwrap();
            }
            let before = tree(shelf.path());
            let count = Cell::new(0);
            let failing = |_: &str| {
                count.set(count.get() + 1);
                if count.get() > step { Err(io::Error::from(io::ErrorKind::StorageFull)) } else { Ok(()) }
            };
            match publish(shelf.path(), version, &failing) {
                Ok(_) => {
                    assert!(step > 5, "{step} steps are too few");
                    break;
                }
                Err(e) => {
                    assert!(e.to_string().contains("Make room"), "{e}");
                    assert!(tree(shelf.path()) == before, "step {step} of version {version}: {e}");
                }
            }
        }
    }
}

const KILL: &str = "KILWA_TEST_KILL_AT";

/// Run by the next test in a process of its own: publishes and dies at a step.
#[test]
fn dies_at_a_step() {
    let Ok(text) = std::env::var(KILL) else { return };
    let parts: Vec<&str> = text.splitn(3, ' ').collect();
    let (version, step): (u32, u32) = (parts[0].parse().unwrap(), parts[1].parse().unwrap());
    let count = Cell::new(0);
    let dying = |_: &str| {
        count.set(count.get() + 1);
        if count.get() > step {
            std::process::abort();
        }
        Ok(())
    };
    publish(Path::new(parts[2]), version, &dying).unwrap();
}

#[test]
fn killed_at_any_step_the_object_is_the_old_or_the_new_one_and_publishing_again_completes_it() {
    for version in [1, 2] {
        for step in 0.. {
            let shelf = tempfile::tempdir().unwrap();
            let object = shelf.path().join("fort");
            if version == 2 {
                publish(shelf.path(), 1, &|_| Ok(())).unwrap();
            }
            let ended = std::process::Command::new(std::env::current_exe().unwrap())
                .args(["--exact", "object::draft::tests::dies_at_a_step", "--quiet"])
                .env(KILL, format!("{version} {step} {}", shelf.path().display()))
                .stdout(std::process::Stdio::null())
                .stderr(std::process::Stdio::null())
                .status()
                .unwrap();
            let now = object.exists().then(|| is_whole(&object));
            assert!(now.unwrap_or(0) == version - 1 || ended.success(), "step {step}: {now:?}");
            if ended.success() {
                break;
            }
            publish(shelf.path(), version, &|_| Ok(())).unwrap();
            assert_eq!(is_whole(&object), version);
            let hidden = tree(shelf.path()).keys().filter(|p| p.contains(HIDDEN)).count();
            assert_eq!((hidden, fs::read_dir(&object).unwrap().count()), (0, 2 + version as usize), "step {step}");
        }
    }
}

#[test]
fn two_cannot_publish_to_one_folder_at_once() {
    let shelf = tempfile::tempdir().unwrap();
    let held = Lock::take(shelf.path()).unwrap();
    assert!(matches!(Lock::take(shelf.path()), Err(DraftError::Busy(_))));
    drop(held);
    assert!(Lock::take(shelf.path()).is_ok());
}
