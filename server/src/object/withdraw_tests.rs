use super::*;
use crate::object::draft::tests::{folders as folders_in, publish, slug, tree};

fn said(keep: &Path) -> Withdrawal<'_> {
    Withdrawal { reason: "asked to", day: "2026-11-21", keep }
}

fn withdrawn(shelf: &Path, keep: &Path) -> Result<PathBuf, DraftError> {
    ended(shelf, keep, &|_| Ok(())).map(|done| done.kept)
}

fn ended(shelf: &Path, keep: &Path, steps: Steps<'_>) -> Result<Withdrawn, DraftError> {
    withdraw(&Lock::wait(shelf, PATIENCE, &|| ()).unwrap(), &slug(), &said(keep), steps)
}

#[test]
fn files_go_outside_and_words_stay() {
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
fn what_somebody_else_keeps_under_the_name_is_left_as_it_is() {
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
fn no_file_is_removed_that_is_not_kept() {
    let (shelf, keep) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    publish(shelf.path(), 1, &|_| Ok(())).unwrap();
    let kept = withdrawn(shelf.path(), keep.path()).unwrap();
    // As an earlier attempt leaves it that was cut off, and a copy that was lost since.
    fs::rename(kept.join("v1/a.txt"), shelf.path().join("fort/v1/a.txt")).unwrap();
    withdrawn(shelf.path(), keep.path()).unwrap();
    assert_eq!(fs::read_to_string(kept.join("v1/a.txt")).unwrap(), "a of 1");
    assert!(!shelf.path().join("fort/v1/a.txt").exists());
}

#[test]
fn a_resumed_withdrawal_includes_versions_published_since() {
    let (shelf, keep) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    publish(shelf.path(), 1, &|_| Ok(())).unwrap();
    let cut = |what: &str| if what == "manifest.json" { Err(io::Error::other("cut off")) } else { Ok(()) };
    let begun = std::cell::Cell::new(0);
    let second = |what: &str| {
        begun.set(begun.get() + u32::from(what == "manifest.json"));
        if begun.get() > 1 { cut(what) } else { Ok(()) }
    };
    let lock = Lock::wait(shelf.path(), PATIENCE, &|| ()).unwrap();
    withdraw(&lock, &slug(), &said(keep.path()), &second).unwrap_err();
    drop(lock);
    publish(shelf.path(), 2, &|_| Ok(())).unwrap();
    let before = tree(&shelf.path().join("fort"));
    let kept = withdrawn(shelf.path(), keep.path()).unwrap();
    assert!(tree(&kept) == before);
}

#[test]
fn nothing_was_changed_is_printed_only_if_true_and_a_rerun_finishes() {
    let with_two_versions = || {
        // Thousands of files are put on disk: in memory that takes no time.
        let memory = Path::new("/dev/shm");
        let folder = if memory.is_dir() { tempfile::tempdir_in(memory) } else { tempfile::tempdir() }.unwrap();
        fs::create_dir(folder.path().join("shelf")).unwrap();
        for version in [1, 2] {
            publish(&folder.path().join("shelf"), version, &|_| Ok(())).unwrap();
        }
        folder
    };
    let run = |folder: &Path, steps: Steps<'_>| ended(&folder.join("shelf"), &folder.join("keep"), steps);
    let whole = with_two_versions();
    let done = run(whole.path(), &|_| Ok(())).unwrap();
    assert!(!done.before && done.changed);
    let everything = |folder: &Path| (tree(folder), folders_in(folder));
    // Once, and from then on for good.
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
                let said = e.to_string();
                assert_eq!(said.contains("nothing was changed"), !is_withdrawn, "step {step}: {said}");
                assert_eq!(said.contains("the object is withdrawn, but"), is_withdrawn, "step {step}: {said}");
                assert_eq!(said.contains("Run the same command again"), is_withdrawn, "step {step}: {said}");
                assert!(std::error::Error::source(e).is_none() && said.matches("denied").count() == 1, "{said}");
                after += u32::from(is_withdrawn);
            }
            if !is_withdrawn {
                assert!(tree(&folder.path().join("shelf")) == before, "step {step}");
            }
            run(folder.path(), &|_| Ok(())).unwrap();
            assert!(everything(folder.path()) == everything(whole.path()), "step {step}: it does not come to the same");
        }
        assert!(after > 5, "{after} failures after the manifest are too few");
    }
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
