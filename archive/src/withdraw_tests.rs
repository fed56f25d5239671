use super::*;
use crate::draft::tests::{folders as folders_in, publish, slug, tree};
use crate::lock::{Lock, PATIENCE};
use std::cell::RefCell;

const WITHDRAWAL: Withdrawal<'_> = Withdrawal { reason: "asked to", day: "2026-11-21" };

fn withdrawn(shelf: &Path, keep: &Path) -> Result<PathBuf, DraftError> {
    ended(shelf, keep, &|_| Ok(())).map(|done| done.kept)
}

fn ended(shelf: &Path, keep: &Path, steps: Steps<'_>) -> Result<Withdrawn, DraftError> {
    withdraw(&Folders::lock(shelf, keep, &slug(), &|_| (), steps)?, &slug(), &WITHDRAWAL, steps)
}

/// A folder `shelf` with an object of two versions, in memory, because the tests sync thousands of files.
fn with_two_versions() -> tempfile::TempDir {
    let memory = Path::new("/dev/shm");
    let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() }.unwrap();
    fs::create_dir(folder.path().join("shelf")).unwrap();
    for version in [1, 2] {
        publish(&folder.path().join("shelf"), version, &|_| Ok(())).unwrap();
    }
    folder
}

#[test]
fn a_withdrawal_moves_the_files_and_keeps_the_metadata() {
    let (shelf, keep) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    for version in [1, 2] {
        publish(shelf.path(), version, &|_| Ok(())).unwrap();
    }
    let before = tree(&shelf.path().join("fort"));
    let kept = withdrawn(shelf.path(), keep.path()).unwrap();
    assert!(tree(&kept) == before, "all of it is there as it was");
    let left = tree(&shelf.path().join("fort"));
    let names: Vec<&str> = left.keys().map(String::as_str).collect();
    let stays = ["checksums.sha256", "metadata/b.txt", "viewer/style.css"];
    let of_versions = ["v1", "v2"].iter().flat_map(|v| stays.iter().map(move |name| format!("{v}/{name}")));
    let wanted: Vec<String> = [PAGE, MANIFEST].map(str::to_owned).into_iter().chain(of_versions).collect();
    assert_eq!(names, wanted);
    let manifest = Manifest::parse(&left[MANIFEST]).unwrap();
    assert_eq!((manifest.access.state, manifest.access.reason.as_deref()), (AccessState::Withdrawn, Some("asked to")));
    assert!(String::from_utf8_lossy(&left[PAGE]).contains("asked to"));
}

#[test]
fn a_foreign_file_of_the_same_name_is_left_unchanged() {
    let (shelf, keep) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    publish(shelf.path(), 1, &|_| Ok(())).unwrap();
    let before = tree(shelf.path());
    fs::create_dir(keep.path().join("fort")).unwrap();
    fs::write(keep.path().join("fort/thesis.txt"), "years of work").unwrap();
    assert!(matches!(withdrawn(shelf.path(), keep.path()), Err(DraftError::There(_))));
    assert!(tree(shelf.path()) == before);
    assert_eq!(tree(keep.path()).len(), 1);
}

#[test]
fn no_file_is_removed_unless_its_copy_is_kept() {
    let (shelf, keep) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    publish(shelf.path(), 1, &|_| Ok(())).unwrap();
    let kept = withdrawn(shelf.path(), keep.path()).unwrap();
    // The state after an interrupted attempt whose copy was lost since.
    fs::rename(kept.join("v1/a.txt"), shelf.path().join("fort/v1/a.txt")).unwrap();
    withdrawn(shelf.path(), keep.path()).unwrap();
    assert_eq!(fs::read_to_string(kept.join("v1/a.txt")).unwrap(), "a of 1");
    assert!(!shelf.path().join("fort/v1/a.txt").exists());
}

#[test]
fn a_resumed_withdrawal_includes_versions_published_since() {
    let (shelf, keep) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    publish(shelf.path(), 1, &|_| Ok(())).unwrap();
    // The state after a command that was killed before it replaced the manifest.
    let begun = keep.path().join("fort");
    fs::create_dir(&begun).unwrap();
    for name in [PAGE, MANIFEST] {
        fs::copy(shelf.path().join("fort").join(name), begun.join(name)).unwrap();
    }
    fs::write(begun.join(KEEPING), KEEPING_TEXT).unwrap();
    publish(shelf.path(), 2, &|_| Ok(())).unwrap();
    let before = tree(&shelf.path().join("fort"));
    let kept = withdrawn(shelf.path(), keep.path()).unwrap();
    assert!(tree(&kept) == before);
}

#[test]
fn a_resumed_withdrawal_keeps_the_page_as_it_is_now() {
    let (shelf, keep) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    publish(shelf.path(), 1, &|_| Ok(())).unwrap();
    let (object, begun) = (shelf.path().join("fort"), keep.path().join("fort"));
    fs::create_dir(&begun).unwrap();
    fs::copy(object.join(MANIFEST), begun.join(MANIFEST)).unwrap();
    // Access changed after the attempt that was interrupted.
    fs::write(begun.join(PAGE), "the page of before").unwrap();
    fs::write(begun.join(KEEPING), KEEPING_TEXT).unwrap();
    let before = tree(&object);
    let kept = withdrawn(shelf.path(), keep.path()).unwrap();
    assert!(tree(&kept) == before);
}

#[test]
fn the_message_nothing_was_changed_is_true_and_a_rerun_finishes() {
    let run = |folder: &Path, steps: Steps<'_>| ended(&folder.join("shelf"), &folder.join("keep"), steps);
    let whole = with_two_versions();
    let done = run(whole.path(), &|_| Ok(())).unwrap();
    assert!(!done.before && done.changed);
    let everything = |folder: &Path| (tree(folder), folders_in(folder));
    // From the first withdrawal on, permanently.
    for lasts in [false, true] {
        let mut after = 0;
        for step in 1.. {
            let folder = with_two_versions();
            let (before, count) = (tree(&folder.path().join("shelf")), Cell::new(0));
            let failing = |_: &str| {
                count.set(count.get() + 1);
                let fails = count.get() == step || (lasts && count.get() > step);
                if fails { Err(io::Error::from(io::ErrorKind::PermissionDenied)) } else { Ok(()) }
            };
            let failed = run(folder.path(), &failing);
            if count.get() < step {
                break;
            }
            let object = folder.path().join("shelf/fort");
            let manifest = Manifest::parse(&fs::read(object.join(MANIFEST)).unwrap()).unwrap();
            let is_withdrawn = manifest.access.state == AccessState::Withdrawn;
            if let Err(e) = &failed {
                let message = e.to_string();
                assert_eq!(message.contains("nothing was changed"), !is_withdrawn, "step {step}: {message}");
                assert_eq!(message.contains("the object is withdrawn, but"), is_withdrawn, "step {step}: {message}");
                assert_eq!(message.contains("Run the same command again"), is_withdrawn, "step {step}: {message}");
                assert!(std::error::Error::source(e).is_none() && message.matches("denied").count() == 1, "{message}");
                after += u32::from(is_withdrawn);
            }
            if !is_withdrawn {
                assert!(tree(&folder.path().join("shelf")) == before, "step {step}");
                assert!(!folder.path().join("keep").exists(), "step {step}: something is left in the folder outside");
            }
            run(folder.path(), &|_| Ok(())).unwrap();
            assert!(everything(folder.path()) == everything(whole.path()), "step {step}: it does not come to the same");
        }
        assert!(after > 5, "{after} failures after the manifest are too few");
    }
}

/// Calls `then` and fails when the manifest is about to be replaced.
fn failing_at_the_manifest(then: &dyn Fn()) -> impl Fn(&str) -> io::Result<()> + '_ {
    move |what: &str| {
        if what != "rename manifest.json" {
            return Ok(());
        }
        then();
        Err(io::ErrorKind::PermissionDenied.into())
    }
}

#[test]
fn a_failed_withdrawal_removes_only_its_own_unfinished_files() {
    let folder = with_two_versions();
    let (shelf, keep) = (folder.path().join("shelf"), folder.path().join("keep"));
    fs::create_dir_all(keep.join("empty")).unwrap();
    fs::write(keep.join("thesis.txt"), "years of work").unwrap();
    let everything = || (tree(folder.path()), folders_in(folder.path()));
    let before = everything();
    let failed = ended(&shelf, &keep, &failing_at_the_manifest(&|| ())).unwrap_err().to_string();
    assert!(failed.contains("nothing was changed"), "{failed}");
    assert!(everything() == before, "{failed}");
    // Leftovers of an earlier command that was killed do not belong to this one.
    let begun = keep.join("fort");
    fs::create_dir(&begun).unwrap();
    for name in [PAGE, MANIFEST] {
        fs::copy(shelf.join("fort").join(name), begun.join(name)).unwrap();
    }
    let before = everything();
    ended(&shelf, &keep, &failing_at_the_manifest(&|| ())).unwrap_err();
    assert!(everything() == before);
    withdrawn(&shelf, &keep).unwrap();
    assert!(keep.join("thesis.txt").exists() && !begun.join(KEEPING).exists());
}

#[test]
fn files_that_a_failed_withdrawal_cannot_remove_are_named() {
    let folder = with_two_versions();
    let (shelf, keep) = (folder.path().join("shelf"), folder.path().join("keep"));
    let before = tree(&shelf);
    let theirs = keep.join("fort/thesis.txt");
    // Another program creates a file there meanwhile.
    let meanwhile = || fs::write(&theirs, "years of work").unwrap();
    let failed = ended(&shelf, &keep, &failing_at_the_manifest(&meanwhile)).unwrap_err().to_string();
    assert!(!failed.contains("nothing was changed"), "{failed}");
    let named = keep.join("fort").display().to_string();
    assert!(failed.contains("leftovers of this command remain") && failed.contains(&named), "{failed}");
    assert!(tree(&shelf) == before && theirs.exists());
    // The same command continues.
    withdrawn(&shelf, &keep).unwrap();
    assert!(theirs.exists() && keep.join("fort/v2/a.txt").exists());
}

#[test]
fn the_next_command_removes_leftovers_even_if_everything_is_withdrawn() {
    let folder = tempfile::tempdir().unwrap();
    let (shelf, keep) = (folder.path().join("shelf"), folder.path().join("keep"));
    fs::create_dir(&shelf).unwrap();
    publish(&shelf, 1, &|_| Ok(())).unwrap();
    withdrawn(&shelf, &keep).unwrap();
    let everything = || (tree(folder.path()), folders_in(folder.path()));
    let before = everything();
    let none = ended(&shelf, &keep, &|_| Ok(())).unwrap();
    assert!(none.before && !none.changed && none.day == "2026-11-21");
    for left in ["keep/.kilwa-fort--aB3dEf", "shelf/fort/.kilwa-fort--aB3dEf", "shelf/.kilwa-fort--aB3dEf/bag/data"] {
        fs::create_dir_all(folder.path().join(left)).unwrap();
    }
    // The last folder of a version, whose last file was removed; the mark of pages that were not begun.
    fs::create_dir_all(shelf.join("fort/v1/viewer/icons")).unwrap();
    fs::write(shelf.join(".kilwa-site"), "").unwrap();
    let other = keep.join(".kilwa-fort-2--aB3dEf");
    fs::create_dir(&other).unwrap();
    let swept = ended(&shelf, &keep, &|_| Ok(())).unwrap();
    assert!(swept.before && swept.changed);
    fs::remove_dir(&other).expect("what is of another object stays");
    assert!(everything() == before);
}

#[cfg(unix)]
#[test]
fn no_file_is_moved_into_a_folder_that_a_web_server_would_serve() {
    use std::os::unix::fs::symlink;
    let folder = with_two_versions();
    let at = |path: &str| folder.path().join(path);
    fs::create_dir_all(at("www/deep")).unwrap();
    for (name, to) in [("link", "shelf"), ("within", "shelf/fort"), ("www/up", "shelf"), ("other", "www")] {
        symlink(at(to), at(name)).unwrap();
    }
    let before = (tree(folder.path()), folders_in(folder.path()));
    let inside = [
        "shelf",
        "shelf/kept",
        "shelf/fort/v1",
        "link",
        "link/kept/deeper",
        "within",
        "within/kept",
        "www/../shelf/kept",
        "www/deep/../../shelf",
        "other/up/kept",
        "www/up",
    ];
    for keep in inside {
        for shelf in ["shelf", "link", "www/../shelf"] {
            let refused = withdrawn(&at(shelf), &at(keep)).unwrap_err().to_string();
            assert!(refused.contains("give a folder outside it with --keep"), "{shelf}, {keep}: {refused}");
        }
    }
    // A missing part of the path could later be created as a link to anywhere.
    let refused = withdrawn(&at("shelf"), &at("none/../shelf/kept")).unwrap_err().to_string();
    assert!(refused.contains("give a path without .."), "{refused}");
    assert!((tree(folder.path()), folders_in(folder.path())) == before, "nothing was changed or made");
    // A folder outside may be reached through a link.
    assert!(withdrawn(&at("link"), &at("other/kept")).unwrap().ends_with("fort"));
    assert!(at("www/kept/fort/v2/a.txt").exists() && !at("shelf/fort/v2/a.txt").exists());
}

#[cfg(unix)]
#[test]
fn a_link_in_the_folder_outside_loses_no_file() {
    use std::os::unix::fs::symlink;
    let whole = with_two_versions();
    withdrawn(&whole.path().join("shelf"), &whole.path().join("keep")).unwrap();
    // A link in place of the kept object, or of one of its versions, as an interrupted command might find it.
    for (link, to) in [("keep/fort", "shelf/fort"), ("keep/fort/v1", "shelf/fort/v1"), ("keep/fort/v2", "elsewhere")] {
        let folder = with_two_versions();
        let at = |path: &str| folder.path().join(path);
        fs::create_dir_all(at("elsewhere")).unwrap();
        if link == "keep/fort" {
            fs::create_dir(at("keep")).unwrap();
        } else {
            fs::create_dir_all(at("keep/fort")).unwrap();
            for name in [PAGE, MANIFEST] {
                fs::copy(at("shelf/fort").join(name), at("keep/fort").join(name)).unwrap();
            }
        }
        symlink(at(to), at(link)).unwrap();
        let packs = |path: &str| tree(&at(path)).into_keys().filter(|name| name.contains("/pack.")).count();
        withdrawn(&at("shelf"), &at("keep")).unwrap_err();
        assert_eq!(packs("shelf"), 2, "{link}: a file is gone");
        // Once the link is gone, the same command finishes.
        fs::remove_file(at(link)).unwrap();
        fs::remove_dir(at("elsewhere")).unwrap();
        withdrawn(&at("shelf"), &at("keep")).unwrap();
        assert!(tree(&at("keep")) == tree(&whole.path().join("keep")), "{link}");
    }
}

#[test]
fn withdrawals_with_crossed_folders_do_not_deadlock() {
    let folder = tempfile::tempdir().unwrap();
    let (a, b) = (folder.path().join("a"), folder.path().join("b"));
    for shelf in [&a, &b] {
        fs::create_dir(shelf).unwrap();
        publish(shelf, 1, &|_| Ok(())).unwrap();
    }
    let first = Lock::wait(&a, PATIENCE, &|| ()).unwrap();
    let (waits, waited) = std::sync::mpsc::channel();
    std::thread::scope(|scope| {
        let lock = |shelf: &'static str, keep: &'static str| {
            let (shelf, keep, waits) = (folder.path().join(shelf), folder.path().join(keep), waits.clone());
            scope.spawn(move || {
                let waits = |at: &Path| waits.send(at.to_owned()).unwrap();
                Folders::lock(&shelf, &keep, &slug(), &waits, &|_| Ok(())).map(drop)
            })
        };
        let both = [lock("a", "b"), lock("b", "a")];
        // Both wait for the same folder, and hold no lock meanwhile.
        assert_eq!([waited.recv().unwrap(), waited.recv().unwrap()], [a.clone(), a.clone()]);
        drop(Lock::wait(&b, PATIENCE, &|| panic!("a waiting withdrawal holds it")).unwrap());
        drop(first);
        for one in both {
            one.join().unwrap().unwrap();
        }
    });
}

#[test]
fn no_file_is_removed_before_the_names_of_the_kept_files_are_on_disk() {
    // Whatever step the first attempt is interrupted at, and whatever the second one finds done.
    let mut removals = 0;
    for step in 0.. {
        let folder = with_two_versions();
        let (shelf, keep) = (folder.path().join("shelf"), folder.path().join("deep/keep"));
        let log = RefCell::new(Vec::new());
        let cut = |what: &str| {
            let is_cut = log.borrow().len() == step;
            log.borrow_mut().push(what.to_owned());
            if is_cut { Err(io::Error::other("cut off")) } else { Ok(()) }
        };
        let ends = ended(&shelf, &keep, &cut);
        let mut runs = vec![log.take()];
        if ends.is_err() {
            ended(&shelf, &keep, &|what| {
                log.borrow_mut().push(what.to_owned());
                Ok(())
            })
            .unwrap();
            runs.push(log.take());
        }
        for run in &runs {
            let Some(removed) = run.iter().position(|what| what == "remove a.txt") else { continue };
            removals += 1;
            // The names of the folder itself, of the object in it, and of the versions in the object.
            for name in ["sync deep", "sync keep", "sync fort"] {
                let synced = run.iter().take(removed).rposition(|what| what == name);
                let made = run.iter().take(removed).rposition(|what| what == "v2" || what == "rename fort");
                let is_last = name == "sync deep" || synced > made;
                assert!(synced.is_some() && is_last, "cut at step {step}: {name} is lacking in {run:?}");
            }
        }
        if ends.is_ok() {
            break;
        }
    }
    assert!(removals > 20, "{removals}");
}

#[cfg(unix)]
#[test]
fn other_users_of_the_computer_cannot_read_withdrawn_geometry() {
    use crate::draft::tests::{modes, pack_of, publish_as, visible};
    for state in [AccessState::Public, AccessState::Restricted] {
        let folder = tempfile::tempdir().unwrap();
        let (shelf, keep) = (folder.path().join("shelf"), folder.path().join("keep"));
        fs::create_dir(&shelf).unwrap();
        for version in [1, 2] {
            publish_as(&shelf, version, &|_| Ok(()), state).unwrap();
        }
        withdrawn(&shelf, &keep).unwrap();
        let packs: Vec<u32> =
            modes(&keep).into_iter().filter(|(name, _)| name.contains("/pack.")).map(|(_, mode)| mode).collect();
        assert_eq!(packs, [0o640; 2], "{state:?}");
        let visible = visible(folder.path());
        assert!(
            !visible.contains(&pack_of(1))
                && !visible.contains(&pack_of(2))
                && visible.iter().any(|bytes| bytes == b"a of 1")
        );
    }
}
