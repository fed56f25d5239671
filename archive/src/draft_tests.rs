use super::*;
use crate::layout::pack_name;
use crate::lock::PATIENCE;
use crate::manifest::AccessState;
use crate::manifest::tests::sample;
use crate::next::settle;
use std::cell::Cell;
use std::collections::{BTreeMap, BTreeSet};

pub(crate) fn slug() -> Slug {
    Slug::new("fort").unwrap()
}

/// Publish version `version` with some files whose text differs between versions.
pub(crate) fn publish(shelf: &Path, version: u32, steps: Steps<'_>) -> Result<PathBuf, DraftError> {
    publish_as(shelf, version, steps, AccessState::Public)
}

/// The same, with the access state `state`.
pub(crate) fn publish_as(
    shelf: &Path,
    version: u32,
    steps: Steps<'_>,
    state: AccessState,
) -> Result<PathBuf, DraftError> {
    let mut draft = Draft::begin(&Lock::wait(shelf, PATIENCE, &|| ())?, &slug(), steps)?;
    draft.write("a.txt", format!("a of {version}").as_bytes())?;
    draft.write("metadata/b.txt", format!("b of {version}").as_bytes())?;
    draft.write("viewer/style.css", b"css")?;
    fs::write(draft.folder().join("by-others.part"), pack_of(version)).unwrap();
    let (bytes, sum) = draft.adopt_named("by-others.part", pack_name)?;
    let lock = Lock::wait(shelf, PATIENCE, &|| ())?;
    let before = settle(&lock, &slug(), steps)?;
    let page = format!("page of {version}, which needs v{version}/a.txt");
    draft.finish(&lock, version, page.as_bytes(), |checksums, page| {
        let mut m = sample();
        let mut added = m.versions.remove(0);
        m.versions = before.map(|m| m.versions).unwrap_or_default();
        (added.version, added.folder, added.checksums) = (version, version_folder(version), checksums);
        added.pack.url = format!("v{version}/{}", pack_name(&sum));
        (added.pack.sha256, added.pack.bytes) = (sum, bytes);
        m.versions.push(added);
        (m.current, m.page) = (version, page);
        m.access.state = state;
        m.access.until = (state == AccessState::Embargo).then(|| "2099-01-01".to_owned());
        m
    })
}

/// Every file of a folder, hidden ones too.
pub(crate) fn tree(folder: &Path) -> BTreeMap<String, Vec<u8>> {
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

/// The permissions of every file of a folder, hidden ones too.
#[cfg(unix)]
pub(crate) fn modes(folder: &Path) -> BTreeMap<String, u32> {
    use std::os::unix::fs::PermissionsExt as _;
    let mode = |name: &String| fs::symlink_metadata(folder.join(name)).unwrap().permissions().mode() & 0o777;
    tree(folder).into_keys().map(|name| (name.clone(), mode(&name))).collect()
}

/// The contents of the files in a folder that other users of the computer can read.
#[cfg(unix)]
pub(crate) fn visible(folder: &Path) -> BTreeSet<Vec<u8>> {
    use std::os::unix::fs::PermissionsExt as _;
    let mut all = BTreeSet::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let mode = fs::symlink_metadata(&path).unwrap().permissions().mode();
        if path.is_dir() && mode & 0o001 != 0 {
            all.extend(visible(&path));
        } else if path.is_file() && mode & 0o004 != 0 {
            all.insert(fs::read(&path).unwrap());
        }
    }
    all
}

/// The content of a version's pack as [`publish`] writes it.
pub(crate) fn pack_of(version: u32) -> Vec<u8> {
    format!("pack {version}").into_bytes()
}

/// Every folder in a folder, hidden and empty ones too.
pub(crate) fn folders(folder: &Path) -> BTreeSet<String> {
    let mut all = BTreeSet::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            all.extend(folders(&path).into_iter().map(|inner| format!("{name}/{inner}")));
            all.insert(name);
        }
    }
    all
}

/// The object's manifest names folders that are complete: every checksum right, nothing else in them. The number of the version that is shown.
pub(crate) fn is_whole(object: &Path) -> u32 {
    let manifest = Manifest::parse(&fs::read(object.join(MANIFEST)).unwrap()).unwrap();
    for v in &manifest.versions {
        let list = fs::read(object.join(&v.checksums.url)).unwrap();
        assert_eq!(sha256(&list), v.checksums.sha256);
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
fn versions_are_added_and_published_files_never_change() {
    let shelf = tempfile::tempdir().unwrap();
    let object = publish(shelf.path(), 1, &|_| Ok(())).unwrap();
    let first = tree(&object.join("v1"));
    assert_eq!(is_whole(&object), 1);
    publish(shelf.path(), 2, &|_| Ok(())).unwrap();
    assert_eq!((is_whole(&object), tree(&object.join("v1"))), (2, first));
    assert!(fs::read_to_string(object.join(PAGE)).unwrap().starts_with("page of 2"));
    assert_eq!(fs::read_dir(&object).unwrap().count(), 4);
    assert!(matches!(publish(shelf.path(), 1, &|_| Ok(())), Err(DraftError::There(_))));
}

#[test]
fn a_failure_at_any_step_leaves_the_folder_as_it_was() {
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
                // The manifest was replaced: it is the new object, and the next command replaces the page.
                Err(e @ DraftError::Unfinished { .. }) => {
                    let message = e.to_string();
                    assert!(
                        message.contains("the version is published") && message.contains("same command again"),
                        "{message}"
                    );
                    assert!(!message.contains("nothing was changed"), "{message}");
                    settle(&Lock::wait(shelf.path(), PATIENCE, &|| ()).unwrap(), &slug(), &|_| Ok(())).unwrap();
                    let whole = tempfile::tempdir().unwrap();
                    (1..=version).for_each(|v| drop(publish(whole.path(), v, &|_| Ok(())).unwrap()));
                    assert!(tree(shelf.path()) == tree(whole.path()), "step {step} of version {version}: {e}");
                }
                Err(e) => {
                    let message = e.to_string();
                    assert!(message.contains("Free space") && message.contains("nothing was changed"), "{message}");
                    assert!(tree(shelf.path()) == before, "step {step} of version {version}: {e}");
                }
            }
        }
    }
}

#[test]
fn an_existing_version_is_never_touched_whoever_published_it() {
    let shelf = tempfile::tempdir().unwrap();
    let object = publish(shelf.path(), 1, &|_| Ok(())).unwrap();
    // The next version copied from elsewhere, its manifest last.
    let (theirs, copied) = (object.join("v2"), "of theirs");
    fs::create_dir(&theirs).unwrap();
    fs::write(theirs.join("a.txt"), copied).unwrap();
    let refused = publish(shelf.path(), 2, &|_| Ok(())).unwrap_err();
    assert!(matches!(refused, DraftError::Unnamed(_)) && refused.to_string().contains("v2 is there"), "{refused}");
    assert_eq!(fs::read_to_string(theirs.join("a.txt")).unwrap(), copied);
    assert_eq!((is_whole(&object), fs::read_dir(&object).unwrap().count()), (1, 4), "nothing hidden is left");
}

#[test]
fn a_version_published_meanwhile_by_another_program_is_kept_and_ours_refused() {
    let shelf = tempfile::tempdir().unwrap();
    let object = publish(shelf.path(), 1, &|_| Ok(())).unwrap();
    let lock = Lock::wait(shelf.path(), PATIENCE, &|| ()).unwrap();
    let mut late = Draft::begin(&lock, &slug(), &|_| Ok(())).unwrap();
    late.write("a.txt", b"late").unwrap();
    drop(lock);
    publish(shelf.path(), 2, &|_| Ok(())).unwrap();
    let theirs = tree(&object.join("v2"));
    let refused = late.finish(&Lock::wait(shelf.path(), PATIENCE, &|| ()).unwrap(), 2, b"late", |_, _| sample());
    assert!(matches!(refused, Err(DraftError::There(_) | DraftError::Manifest(_))), "{refused:?}");
    assert_eq!((is_whole(&object), tree(&object.join("v2"))), (2, theirs));
}

#[test]
fn unfinished_work_of_another_program_is_left_alone() {
    let shelf = tempfile::tempdir().unwrap();
    for version in [1, 2] {
        let lock = Lock::wait(shelf.path(), PATIENCE, &|| ()).unwrap();
        let mut other = Draft::begin(&lock, &slug(), &|_| Ok(())).unwrap();
        other.write("a.txt", b"a of theirs").unwrap();
        drop(lock);
        publish(shelf.path(), version, &|_| Ok(())).unwrap();
        assert_eq!(fs::read(other.folder().join("a.txt")).unwrap(), b"a of theirs");
    }
}

/// The access states of an object's versions, in order.
#[cfg(unix)]
const HISTORIES: [&[AccessState]; 4] = [
    &[AccessState::Restricted],
    &[AccessState::Embargo, AccessState::Embargo],
    &[AccessState::Public, AccessState::Restricted],
    &[AccessState::Public, AccessState::Restricted, AccessState::Public],
];

#[cfg(unix)]
#[test]
fn no_other_user_can_read_a_closed_model_while_it_is_published() {
    for history in HISTORIES {
        let shelf = tempfile::tempdir().unwrap();
        let looks = Cell::new(0);
        for (version, state) in (1..).zip(history) {
            let look = |what: &str| {
                looks.set(looks.get() + 1);
                if *state != AccessState::Public {
                    assert!(!visible(shelf.path()).contains(&pack_of(version)), "{history:?}: before {what}");
                }
                Ok(())
            };
            publish_as(shelf.path(), version, &look, *state).unwrap();
            look("the end").unwrap();
        }
        assert!(looks.get() > 10);
    }
}

#[cfg(unix)]
#[test]
fn after_a_failure_at_any_step_permissions_match_the_manifest() {
    for history in HISTORIES.into_iter().filter(|history| history.len() > 1) {
        let (last, (state, earlier)) = (history.len().try_into().unwrap(), history.split_last().unwrap());
        let before = |shelf: &Path| {
            for (version, state) in (1..).zip(earlier) {
                publish_as(shelf, version, &|_| Ok(()), *state).unwrap();
            }
        };
        let whole = tempfile::tempdir().unwrap();
        before(whole.path());
        let old = modes(whole.path());
        publish_as(whole.path(), last, &|_| Ok(()), *state).unwrap();
        for step in 0.. {
            let shelf = tempfile::tempdir().unwrap();
            before(shelf.path());
            let count = Cell::new(0);
            let failing = |_: &str| {
                count.set(count.get() + 1);
                if count.get() > step { Err(io::Error::from(io::ErrorKind::StorageFull)) } else { Ok(()) }
            };
            match publish_as(shelf.path(), last, &failing, *state) {
                Ok(_) => break,
                Err(DraftError::Unfinished { .. }) => {
                    settle(&Lock::wait(shelf.path(), PATIENCE, &|| ()).unwrap(), &slug(), &|_| Ok(())).unwrap();
                    assert_eq!(modes(shelf.path()), modes(whole.path()), "{history:?}: step {step}");
                }
                Err(_) => assert_eq!(modes(shelf.path()), old, "{history:?}: step {step}"),
            }
        }
    }
}

/// Modes of the packs of an object, version by version.
#[cfg(unix)]
fn modes_of_packs(object: &Path) -> Vec<u32> {
    use std::os::unix::fs::PermissionsExt;
    let manifest = Manifest::parse(&fs::read(object.join(MANIFEST)).unwrap()).unwrap();
    let mode = |path: &str| fs::metadata(object.join(path)).unwrap().permissions().mode() & 0o777;
    manifest.versions.iter().map(|v| mode(&v.pack.url)).collect()
}

#[cfg(unix)]
#[test]
fn other_users_of_the_computer_cannot_read_geometry_that_is_not_public() {
    use AccessState::{Embargo, Public, Restricted};
    use std::os::unix::fs::PermissionsExt;
    let shelf = tempfile::tempdir().unwrap();
    let object = shelf.path().join("fort");
    let states = [(Restricted, vec![0o640]), (Public, vec![0o644; 2]), (Embargo, vec![0o640; 3])];
    for (version, (state, wanted)) in (1..).zip(states) {
        publish_as(shelf.path(), version, &|_| Ok(()), state).unwrap();
        assert_eq!(modes_of_packs(&object), wanted, "version {version}");
    }
    // Text and pictures are public even if the model is not.
    assert_eq!(fs::metadata(object.join("v3/a.txt")).unwrap().permissions().mode() & 0o777, 0o644);
}

#[cfg(unix)]
const AS: &str = "KILWA_TEST_PUBLISH_AS";
#[cfg(unix)]
const NOBODY: u32 = 65_534;

/// Run as another user by the tests below: publishes a version, public or not.
#[cfg(unix)]
#[test]
fn helper_process_that_publishes_as_another_user() {
    let Ok(text) = std::env::var(AS) else { return };
    let parts: Vec<&str> = text.splitn(3, ' ').collect();
    let state = if parts[1] == "public" { AccessState::Public } else { AccessState::Restricted };
    publish_as(Path::new(parts[2]), parts[0].parse().unwrap(), &|_| Ok(()), state).unwrap();
}

/// A folder of objects that belongs to another user and to `group`; `None` if this program may not create one.
#[cfg(unix)]
fn shelf_of_another_user(group: u32) -> Option<tempfile::TempDir> {
    use std::os::unix::fs::{PermissionsExt as _, chown};
    let shelf = tempfile::tempdir().unwrap();
    fs::set_permissions(shelf.path(), fs::Permissions::from_mode(0o775)).unwrap();
    chown(shelf.path(), Some(NOBODY), Some(group)).ok().map(|()| shelf)
}

/// Publish as that user, who is in no group but their own; `None` if this program cannot run as another user.
#[cfg(unix)]
fn publish_as_another_user(shelf: &Path, version: u32, state: &str) -> Option<()> {
    let (is_published, output) = try_as_another_user(shelf, version, state)?;
    assert!(is_published, "{output}");
    Some(())
}

/// The same. Returns whether it was published, and the output.
#[cfg(unix)]
fn try_as_another_user(shelf: &Path, version: u32, state: &str) -> Option<(bool, String)> {
    use std::os::unix::process::CommandExt as _;
    let mut command = std::process::Command::new(std::env::current_exe().unwrap());
    command.args(["--exact", "draft::tests::helper_process_that_publishes_as_another_user", "--test-threads=1"]);
    command.env(AS, format!("{version} {state} {}", shelf.display())).current_dir("/").uid(NOBODY).gid(NOBODY);
    let output = command.output().ok()?;
    let printed = String::from_utf8_lossy(&output.stdout).into_owned();
    Some((output.status.success() && printed.contains("1 passed"), printed))
}

#[cfg(unix)]
#[test]
fn leftovers_of_another_user_do_not_prevent_publishing() {
    use std::os::unix::fs::PermissionsExt as _;
    let published = (|| {
        let shelf = shelf_of_another_user(NOBODY)?;
        for version in [1, 2] {
            let within = if version == 1 { shelf.path().to_owned() } else { shelf.path().join("fort") };
            // One as earlier versions of the program made it, and one as this version makes it, which others cannot look into.
            for (name, mode) in [("aB3dEf", 0o755), ("cD4eFg", 0o700)] {
                let left = within.join(format!(".kilwa-fort--{name}"));
                fs::create_dir_all(left.join("version")).unwrap();
                fs::write(left.join("version/pack"), "left").unwrap();
                fs::set_permissions(&left, fs::Permissions::from_mode(mode)).unwrap();
            }
            publish_as_another_user(shelf.path(), version, "public")?;
            assert_eq!(is_whole(&shelf.path().join("fort")), version);
        }
        let left = tree(shelf.path()).into_values().filter(|bytes| bytes == b"left").count();
        assert_eq!(left, 4, "folders that cannot be removed stay");
        // That user's next publication removes them.
        Draft::begin(&Lock::wait(shelf.path(), PATIENCE, &|| ()).unwrap(), &slug(), &|_| Ok(())).unwrap();
        assert!(!tree(shelf.path()).into_values().any(|bytes| bytes == b"left"));
        Some(())
    })();
    if published.is_none() {
        println!("skipped: leftovers of another user: this program cannot run as another user");
    }
}

#[cfg(unix)]
#[test]
fn closed_files_are_owner_only_if_the_owner_is_not_in_the_group_of_the_folder() {
    use std::os::unix::fs::chown;
    let published = (|| {
        let theirs = 12_345;
        let shelf = shelf_of_another_user(theirs)?;
        let (object, unshared) = (shelf.path().join("fort"), |version: &str| {
            super::modes::unshared_with(&shelf.path().join("fort").join(version), shelf.path()).unwrap()
        });
        publish_as_another_user(shelf.path(), 1, "restricted")?;
        assert_eq!((modes_of_packs(&object), unshared("v1")), (vec![0o600], Some(theirs)));
        // Permissions that an earlier version of the program set are corrected with the next version.
        fs::set_permissions(find_pack(&object), std::os::unix::fs::PermissionsExt::from_mode(0o640)).unwrap();
        publish_as_another_user(shelf.path(), 2, "restricted")?;
        assert_eq!(modes_of_packs(&object), vec![0o600; 2]);
        // As if the user had been added to the group.
        chown(shelf.path(), None, Some(NOBODY)).unwrap();
        publish_as_another_user(shelf.path(), 3, "restricted")?;
        assert_eq!((modes_of_packs(&object), unshared("v3")), (vec![0o640; 3], None));
        publish_as_another_user(shelf.path(), 4, "public")?;
        assert_eq!(modes_of_packs(&object), vec![0o644; 4]);
        Some(())
    })();
    if published.is_none() {
        println!("skipped: groups that a publisher is not in: this program cannot run as another user");
    }
}

/// A file of another user counts as closed only if nobody but its owner and the group of the folder can read it.
#[cfg(unix)]
#[test]
fn a_file_of_another_user_that_others_can_read_is_refused_by_name() {
    use std::os::unix::fs::{PermissionsExt as _, chown};
    let (ours, broader) = (12_345, 54_321);
    let cases = [
        (ours, 0o640, true),
        (ours, 0o600, true),
        (broader, 0o600, true),
        (broader, 0o640, false),
        (broader, 0o620, false),
        (broader, 0o604, false),
        (ours, 0o644, false),
    ];
    let tried = cases.into_iter().try_for_each(|(group, mode, is_closed)| {
        let shelf = shelf_of_another_user(ours)?;
        let object = shelf.path().join("fort");
        publish_as_another_user(shelf.path(), 1, "restricted")?;
        let pack = find_pack(&object);
        chown(&pack, Some(0), Some(group)).ok()?;
        fs::set_permissions(&pack, fs::Permissions::from_mode(mode)).unwrap();
        let (is_published, output) = try_as_another_user(shelf.path(), 2, "restricted")?;
        assert_eq!(is_published, is_closed, "group {group}, {mode:o}: {output}");
        assert_eq!(is_whole(&object), if is_closed { 2 } else { 1 });
        let is_named = output.contains(pack.to_str().unwrap()) && output.contains("belongs to another user");
        assert_eq!(is_named, !is_closed, "group {group}, {mode:o}: {output}");
        Some(())
    });
    if tried.is_none() {
        println!("skipped: files of another user: this program cannot run as another user");
    }
}

/// The pack of the first version.
#[cfg(unix)]
fn find_pack(object: &Path) -> PathBuf {
    let manifest = Manifest::parse(&fs::read(object.join(MANIFEST)).unwrap()).unwrap();
    object.join(&manifest.versions[0].pack.url)
}
