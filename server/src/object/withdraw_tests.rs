use super::*;
use crate::object::draft::tests::{publish, slug, tree};

fn said(keep: &Path) -> Withdrawal<'_> {
    Withdrawal { reason: "asked to", day: "2026-11-21", keep }
}

fn withdrawn(shelf: &Path, keep: &Path) -> Result<PathBuf, DraftError> {
    withdraw(&Lock::wait(shelf, PATIENCE, &|| ()).unwrap(), &slug(), &said(keep), &|_| Ok(()))
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
fn a_withdrawal_that_was_begun_before_another_version_came_goes_on_with_all_of_them() {
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
