use super::*;
use crate::levels::fragment::Patch;
use kilwa_geometry::{LatticePoint, Mesh};
use kilwa_simplify::Bound;

fn patch(vertices: u32, colored: bool, channels: usize, bounded: bool) -> Patch {
    let n = vertices as usize;
    let mesh = Mesh {
        positions: (0..vertices as i32).map(|i| LatticePoint::new(i, i * 7 % 1000, 1 << 29)).collect(),
        colors: if colored { (0..n).map(|i| [i as u8, 2, 3]).collect() } else { Vec::new() },
        normals: (0..n).map(|i| [i as i16, -5]).collect(),
        scalars: (0..channels).map(|c| (0..n).map(|i| i as f32 + c as f32 * 0.5).collect()).collect(),
        triangles: (2..vertices).map(|i| [i - 2, i - 1, i]).collect(),
        borders: (2..vertices).map(|i| if bounded { (i % 8) as u8 } else { 0 }).collect(),
    };
    let bound = |i: u32| Bound { out: i as f32 * 0.25, back: 1.0 };
    let bounds = (2..vertices).map(|i| if bounded { bound(i) } else { Bound::default() }).collect();
    Patch { mesh, bounds }
}

#[test]
fn a_patch_round_trips_through_its_file_also_after_reopening() {
    let scratch = Scratch::temporary().unwrap();
    let patches = [
        patch(3, false, 0, false),
        patch(100, true, 2, true),
        patch(65_536, true, 0, true),
        patch(65_537, false, 1, false),
        Patch::default(),
    ];
    let file = PatchFile::create(&scratch, "level-07.patches").unwrap();
    for (t, p) in patches.iter().enumerate() {
        file.append(t as u32 * 3, p).unwrap();
    }
    let check = |file: &PatchFile| {
        for (t, p) in patches.iter().enumerate() {
            let back = file.read(t as u32 * 3).unwrap().unwrap();
            assert_eq!((&back.mesh, &back.bounds), (&p.mesh, &p.bounds));
            assert_eq!(file.triangles(t as u32 * 3) as usize, p.bounds.len());
        }
        assert!(file.read(1).unwrap().is_none());
        assert_eq!(file.tetrahedra(), [0, 3, 6, 9, 12]);
    };
    check(&file);
    let file = file.finish().unwrap();
    check(&file);
    check(&PatchFile::open(&scratch, "level-07.patches").unwrap());
    assert_eq!(scratch.bytes(), scratch.length("level-07.patches").unwrap());
}

#[test]
fn every_damaged_byte_of_a_patch_file_is_detected() {
    let scratch = Scratch::temporary().unwrap();
    let file = PatchFile::create(&scratch, "p").unwrap();
    file.append(4, &patch(20, true, 1, true)).unwrap();
    drop(file.finish().unwrap());
    let whole = std::fs::read(scratch.path("p")).unwrap();
    for i in 0..whole.len() {
        let mut bytes = whole.clone();
        bytes[i] ^= 0x10;
        std::fs::write(scratch.path("p"), &bytes).unwrap();
        let read = PatchFile::open(&scratch, "p").and_then(|f| f.read(4));
        assert!(matches!(read, Err(ScratchError::Damaged { .. })), "byte {i}");
    }
    for length in 0..whole.len() {
        std::fs::write(scratch.path("p"), &whole[..length]).unwrap();
        assert!(PatchFile::open(&scratch, "p").is_err(), "cut to {length} bytes");
    }
}

#[test]
fn records_are_visited_once_and_in_order_with_any_amount_of_memory() {
    let scratch = Scratch::temporary().unwrap();
    let records = Records::create(&scratch, "shared").unwrap();
    let mut random = fastrand::Rng::with_seed(1);
    let mut all: Vec<u128> = (0..300_000)
        .map(|_| {
            let state = random.u32(..);
            record(LatticePoint::new((state >> 20) as i32, (state & 0xff) as i32, 1 << 30), state >> 28)
        })
        .collect();
    all.chunks(1000).for_each(|c| records.append(c).unwrap());
    all.sort_unstable();
    all.dedup();
    for memory in [0, 1 << 30] {
        let mut visited = Vec::new();
        records
            .sorted(&scratch, "runs", memory, |r| {
                visited.push(r);
                Ok::<_, ScratchError>(())
            })
            .unwrap();
        assert_eq!(visited, all);
        assert_eq!(scratch.files().unwrap().len(), 1, "runs are removed");
    }
    let r = record(LatticePoint::new(1, 1 << 30, 3), 77);
    assert_eq!((point_of(r), tetrahedron_of(r)), (LatticePoint::new(1, 1 << 30, 3), 77));
}

#[test]
fn damaged_records_are_detected_before_the_first_is_visited() {
    let scratch = Scratch::temporary().unwrap();
    let records = Records::create(&scratch, "shared").unwrap();
    records.append(&(0..50).map(|i| record(LatticePoint::new(i, 2, 3), 4)).collect::<Vec<_>>()).unwrap();
    drop(records.finish().unwrap());
    let visit = || {
        let mut visited = 0;
        let records = Records::open(&scratch, "shared")?;
        assert_eq!(records.len(), 50);
        let all = records.sorted(&scratch, "runs", 0, |_| {
            visited += 1;
            Ok::<_, ScratchError>(())
        });
        assert!(all.is_ok() == (visited == 50) && (visited == 0 || visited == 50));
        all
    };
    visit().unwrap();
    let whole = std::fs::read(scratch.path("shared")).unwrap();
    for i in 0..whole.len() {
        let mut bytes = whole.clone();
        bytes[i] ^= 1 << (i % 8);
        std::fs::write(scratch.path("shared"), &bytes).unwrap();
        assert!(matches!(visit(), Err(ScratchError::Damaged { .. })), "byte {i}");
    }
}

#[test]
fn a_folder_in_use_is_refused_until_it_is_released() {
    let outer = tempfile::tempdir().unwrap();
    let folder = outer.path().join("scratch");
    let first = Scratch::open(&folder).unwrap();
    assert!(matches!(Scratch::open(&folder), Err(ScratchError::Busy { .. })));
    first.create("a").unwrap().append(&[1; 100]).unwrap();
    assert_eq!((first.bytes(), first.peak_bytes()), (100, 100));
    first.remove("a").unwrap();
    assert_eq!((first.bytes(), first.peak_bytes()), (0, 100));
    drop(first);
    let second = Scratch::open(&folder).unwrap();
    second.create("ours").unwrap();
    std::fs::write(folder.join("theirs"), "kept").unwrap();
    second.discard(|name| name == "ours").unwrap();
    assert!(folder.join("theirs").is_file() && !folder.join("ours").exists());
}

#[cfg(unix)]
#[test]
fn no_other_user_can_read_a_temporary_folder() {
    use std::os::unix::fs::PermissionsExt as _;
    let scratch = Scratch::temporary().unwrap();
    assert_eq!(scratch.folder().metadata().unwrap().permissions().mode() & 0o777, 0o700);
}

/// A folder of meshes from another person, or a shared one, may contain anything where the scratch folder will be.
#[cfg(unix)]
#[test]
fn a_folder_that_was_not_made_by_a_build_is_refused_and_left_unchanged() {
    let listed = |folder: &std::path::Path| {
        let names = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
        names.collect::<std::collections::BTreeSet<_>>()
    };
    let makes: [&dyn Fn(&std::path::Path); 6] = [
        &|_| {},
        &|f| std::fs::write(f.join("lock"), "").unwrap(),
        &|f| std::fs::write(f.join("journal"), "my diary").unwrap(),
        &|f| std::fs::create_dir(f.join("journal")).unwrap(),
        &|f| std::fs::create_dir(f.join("lock")).unwrap(),
        &|f| assert!(std::process::Command::new("mkfifo").arg(f.join("lock")).status().unwrap().success()),
    ];
    for (i, make) in makes.iter().enumerate() {
        for is_link in [false, true] {
            let outer = tempfile::tempdir().unwrap();
            let (archive, folder) = (outer.path().join("archive"), outer.path().join("scratch"));
            std::fs::create_dir(&archive).unwrap();
            std::fs::write(archive.join("a.tif"), "precious").unwrap();
            make(&archive);
            let before = listed(&archive);
            if is_link {
                std::os::unix::fs::symlink(&archive, &folder).unwrap();
            } else {
                std::fs::rename(&archive, &folder).unwrap();
            }
            let refused = Scratch::open(&folder);
            assert!(matches!(refused, Err(ScratchError::Foreign { .. })), "{i}, link {is_link}: {refused:?}");
            assert_eq!(listed(&folder), before, "{i}, link {is_link}");
        }
    }
}

#[test]
fn a_refusal_says_what_is_wrong_with_the_folder() {
    let refused = |make: &dyn Fn(&std::path::Path)| {
        let outer = tempfile::tempdir().unwrap();
        let folder = outer.path().join("scratch");
        let scratch = Scratch::open(&folder).unwrap();
        scratch.create("journal").unwrap();
        drop(scratch);
        make(&folder);
        Scratch::open(&folder).unwrap_err().to_string()
    };
    let damaged = refused(&|f| std::fs::write(f.join("lock"), "Kilwa keeps nothing").unwrap());
    assert!(damaged.contains("`lock` is damaged, or was not written by a build"), "{damaged}");
    let gone = refused(&|f| std::fs::remove_file(f.join("lock")).unwrap());
    assert!(gone.contains("contains journal but not the file `lock`"), "{gone}");
    // The state after a build that found a foreign folder in its own.
    let theirs = refused(&|f| {
        std::fs::create_dir(f.join("theirs")).unwrap();
        Scratch::open(f).unwrap().discard(|_| true).unwrap();
    });
    assert!(theirs.contains("contains theirs"), "{theirs}");
    let other = refused(&|f| {
        std::fs::remove_file(f.join("lock")).unwrap();
        std::fs::create_dir(f.join("lock")).unwrap();
    });
    assert!(other.contains("is not a regular file"), "{other}");
}

#[cfg(unix)]
#[test]
fn links_and_subfolders_are_never_followed_or_emptied() {
    let outer = tempfile::tempdir().unwrap();
    let (folder, archive) = (outer.path().join("scratch"), outer.path().join("archive"));
    std::fs::create_dir(&archive).unwrap();
    std::fs::write(archive.join("a.tif"), "precious").unwrap();
    let scratch = Scratch::open(&folder).unwrap();
    std::os::unix::fs::symlink(archive.join("a.tif"), folder.join("positions")).unwrap();
    std::os::unix::fs::symlink(&archive, folder.join("corners")).unwrap();
    std::fs::create_dir(folder.join("deep")).unwrap();
    std::fs::write(folder.join("deep/b.tif"), "precious").unwrap();
    for name in ["positions", "corners", "deep", "../archive/a.tif", "..", "deep/b.tif"] {
        assert!(scratch.existing(name).is_err(), "{name}");
        assert_eq!(scratch.length(name).filter(|_| !name.contains('/')), None, "{name}");
    }
    for name in ["deep", "../archive/a.tif", "..", "deep/b.tif"] {
        assert!(scratch.remove(name).is_err() && scratch.create(name).is_err(), "{name}");
    }
    scratch.create("positions").unwrap().append(b"x").unwrap();
    scratch.discard(|_| true).unwrap();
    assert_eq!(std::fs::read(archive.join("a.tif")).unwrap(), b"precious");
    assert_eq!(std::fs::read(folder.join("deep/b.tif")).unwrap(), b"precious");
    assert!(!folder.join("corners").is_symlink() && !folder.join("positions").exists());
}
