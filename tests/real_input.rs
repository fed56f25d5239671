//! Real input: every real PLY of `../shared/data` and every damaged one of `tests/malformed` becomes a pack that
//! verifies and gives the same triangles back, or is refused with exit code 1, a message that names the file, the place
//! and the reason, and nothing left under the final name or beside it.

use crate::support::{Ply, fails, json, multiset, plys, succeeds, text};
use kilwa_formats::read::read_mesh;
use kilwa_geometry::Lattice;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn is_empty(folder: &Path) -> bool {
    std::fs::read_dir(folder).unwrap().next().is_none()
}

/// Build, verify and extract `input` in `folder`; the full extract must be the mesh that was read. Returns the output of the build.
fn round_trip(input: &Path, folder: &Path) -> String {
    let (pack, back) = (folder.join("a.kilwa"), folder.join("a.ply"));
    let output = succeeds(&["build", text(input), "-o", text(&pack)]);
    succeeds(&["verify", text(&pack)]);
    succeeds(&["extract", text(&pack), "-o", text(&back)]);

    let info = json(&["info", text(&pack)]);
    let lattice = Lattice {
        origin: [0, 1, 2].map(|k| info["lattice_origin"][k].as_f64().unwrap()).into(),
        step_log2: info["lattice_step"].as_f64().unwrap().log2().round() as i32,
    };
    let raw = read_mesh(input, &mut |_, _| {}).unwrap();
    // Where a mesh has no colours, its intensity becomes grey; that it is kept is looked at below.
    let colored = !raw.colors.is_empty();
    let given = |v: u32| {
        let at = raw.positions[v as usize];
        (lattice.snap(at).expect("inside the lattice").to_array(), raw.colors.get(v as usize).copied())
    };
    let wanted = multiset(raw.triangles.iter().map(|t| t.map(given)));
    let ply = Ply::read(&back);
    let got = |v: u32| {
        let color = ply.get(v, "red").map(|r| [r, ply.get(v, "green").unwrap(), ply.get(v, "blue").unwrap()]);
        let color = color.filter(|_| colored).map(|c| c.map(|x| x as u8));
        (lattice.snap(ply.position(v).into()).expect("inside the lattice").to_array(), color)
    };
    let found = multiset(ply.triangles.iter().map(|t| t.map(got)));
    assert_eq!(found.len(), ply.triangles.len(), "{}: no empty triangle is stored", input.display());
    assert!(found == wanted, "{}: {} triangles of {} come back", input.display(), found.len(), wanted.len());
    for (name, _) in &raw.scalars {
        assert!(ply.properties.contains(name), "{} keeps {name}", input.display());
    }
    for path in [pack, back] {
        std::fs::remove_file(path).unwrap();
    }
    assert!(is_empty(folder), "nothing is left beside the results");
    output
}

/// The build must refuse `input` and leave no file; its message.
fn refused(input: &Path, folder: &Path) -> String {
    let message = fails(&["build", text(input), "-o", text(&folder.join("a.kilwa"))]);
    assert!(is_empty(folder), "{} left something behind", input.display());
    assert!(message.contains(input.file_name().unwrap().to_str().unwrap()), "the file is named: {message}");
    assert_eq!(message.trim_end().lines().count(), 1, "one line says it: {message}");
    message
}

#[test]
fn every_real_ply_round_trips_or_is_refused_with_position_and_reason() {
    let data = root().join("../shared/data");
    if !data.is_dir() {
        println!("skipped: {} is not here", data.display());
        return;
    }
    let mut all = Vec::new();
    plys(&data, &mut all);
    let folder = tempfile::tempdir().unwrap();
    let (mut built, mut turned_away) = (0, 0);
    for input in &all {
        if read_mesh(input, &mut |_, _| {}).is_ok() {
            round_trip(input, folder.path());
            built += 1;
        } else {
            let message = refused(input, folder.path());
            assert!(["line ", "byte "].iter().any(|place| message.contains(place)), "the place is named: {message}");
            turned_away += 1;
        }
    }
    println!("{built} built, {turned_away} refused");
    assert!(built >= 40 && built + turned_away >= 80, "{built} built, {turned_away} refused");
}

/// Each file of the corpus says in a comment what becomes of it: `refused: WORDS` or `repaired: WORDS`.
#[test]
fn every_malformed_ply_is_refused_or_repaired_as_expected() {
    let mut all = Vec::new();
    plys(&root().join("tests/malformed"), &mut all);
    assert!(all.len() >= 35);
    let folder = tempfile::tempdir().unwrap();
    for input in &all {
        let name = input.file_name().unwrap().to_str().unwrap();
        let content = std::fs::read_to_string(input).unwrap();
        let after = |key: &str| content.lines().find_map(|l| l.split_once(key)).map(|(_, words)| words.trim());
        if let Some(words) = after("repaired: ") {
            let output = round_trip(input, folder.path());
            assert!(output.contains(words), "{name}: expected \"{words}\" in\n{output}");
        } else {
            let words = after("refused: ").unwrap_or("0 bytes");
            let message = refused(input, folder.path());
            assert!(message.contains(words), "{name}: expected \"{words}\" in\n{message}");
        }
    }
}

#[test]
fn a_binary_ply_truncated_at_any_byte_is_refused_and_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let work = folder.path().join("work");
    std::fs::create_dir(&work).unwrap();
    let mut whole = b"ply\nformat binary_little_endian 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement face 2\nproperty list uchar int vertex_indices\nend_header\n".to_vec();
    let header = whole.len();
    for v in [[0f32, 0., 0.], [1., 0., 0.], [0., 1., 0.], [1., 1., 0.5]].iter().flatten() {
        whole.extend(v.to_le_bytes());
    }
    for t in [[0u32, 1, 2], [2, 1, 3]] {
        whole.push(3);
        whole.extend(t.iter().flat_map(|v| v.to_le_bytes()));
    }
    let cut = folder.path().join("cut.ply");
    for n in [5, header / 2, header, header + 1, header + 47, header + 48, header + 53, whole.len() - 1] {
        std::fs::write(&cut, &whole[..n]).unwrap();
        let message = refused(&cut, &work);
        assert!(message.contains("line ") || message.contains("byte "), "cut at {n}: {message}");
    }
    std::fs::write(&cut, &whole).unwrap();
    round_trip(&cut, &work);
}

#[test]
fn a_file_name_in_capitals_is_accepted() {
    let folder = tempfile::tempdir().unwrap();
    let work = folder.path().join("work");
    std::fs::create_dir(&work).unwrap();
    let input = folder.path().join("GEREZA.PLY");
    std::fs::copy(root().join("tests/malformed/repaired_quad.ply"), &input).unwrap();
    round_trip(&input, &work);
}

#[test]
fn a_missing_file_a_folder_and_a_device_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    assert!(refused(Path::new("/no/such/scan.ply"), folder.path()).contains("cannot be opened: No such file"));
    assert!(refused(root().join("tests").as_path(), folder.path()).contains("contains no readable mesh"));
    if Path::new("/dev/zero").exists() {
        assert!(refused(Path::new("/dev/zero"), folder.path()).contains("not a regular file"));
    }
    assert!(refused(root().join("Cargo.toml").as_path(), folder.path()).contains("reads PLY"));
}

#[test]
fn one_bad_file_among_several_stops_the_build() {
    let folder = tempfile::tempdir().unwrap();
    let corpus = root().join("tests/malformed");
    let (good, bad) = (corpus.join("repaired_quad.ply"), corpus.join("cut_in_a_row.ply"));
    let message = fails(&["build", text(&good), text(&bad), "-o", text(&folder.path().join("a.kilwa"))]);
    assert!(message.contains("cut_in_a_row.ply, line 16"), "{message}");
    assert!(is_empty(folder.path()));
}

/// Only things made in the test's own folder are given as output: a build that replaced a device of the machine would
/// break the machine.
#[test]
fn an_output_that_is_not_a_regular_file_is_never_replaced() {
    let input = root().join("tests/malformed/repaired_quad.ply");
    let folder = tempfile::tempdir().unwrap();
    let (inner, pipe) = (folder.path().join("a.kilwa"), folder.path().join("pipe.kilwa"));
    std::fs::create_dir(&inner).unwrap();
    if !Command::new("mkfifo").arg(&pipe).status().is_ok_and(|s| s.success()) {
        println!("skipped: no pipe can be made here");
    }
    for output in [&inner, &pipe].into_iter().filter(|p| p.exists()) {
        for force in [&[][..], &["--force"]] {
            let message = fails(&[&["build", text(&input), "-o", text(output)], force].concat());
            assert!(message.contains("is a folder or a device"), "{message}");
            assert!(output.exists() && !output.is_file(), "{} is what it was", output.display());
        }
    }
}

/// A mesh whose pack is larger than the room given to it below.
fn large_enough(folder: &Path) -> PathBuf {
    let input = folder.join("torus.ply");
    crate::support::Input::torus(64, 32, [0.0; 3]).write(&input);
    input
}

/// The system refuses to let any file grow beyond 8 blocks of 512 bytes: writing fails in the middle, as on a full disk.
#[test]
fn a_disk_that_fills_up_leaves_no_file_under_the_final_name() {
    let folder = tempfile::tempdir().unwrap();
    let work = folder.path().join("work");
    std::fs::create_dir(&work).unwrap();
    let input = large_enough(folder.path());
    let output = work.join("a.kilwa");
    let run = Command::new("sh")
        .args(["-c", "trap '' XFSZ; ulimit -f 8 || exit 77; exec \"$0\" build \"$1\" -o \"$2\""])
        .args([Path::new(env!("CARGO_BIN_EXE_kilwa")), &input, &output])
        .stdin(Stdio::null())
        .output()
        .unwrap();
    if run.status.code() == Some(77) {
        println!("skipped: this shell cannot limit the size of files");
        return;
    }
    let message = String::from_utf8_lossy(&run.stderr);
    assert_eq!(run.status.code(), Some(1), "{message}");
    assert!(message.contains("a.kilwa") && message.contains("the disk is full"), "{message}");
    assert!(is_empty(&work), "{:?}", std::fs::read_dir(&work).unwrap().collect::<Vec<_>>());
}

/// The same on a file system that is really full, where one can be made.
#[test]
fn a_full_file_system_leaves_no_file_under_the_final_name() {
    let folder = tempfile::tempdir().unwrap();
    let input = large_enough(folder.path());
    let small = folder.path().join("small");
    std::fs::create_dir(&small).unwrap();
    let mount = Command::new("mount").args(["-t", "tmpfs", "-o", "size=16k", "tmpfs", text(&small)]).output();
    if !mount.is_ok_and(|m| m.status.success()) {
        println!("skipped: no small file system can be mounted here");
        return;
    }
    let output = crate::support::kilwa(&["build", text(&input), "-o", text(&small.join("a.kilwa"))]);
    let empty = is_empty(&small);
    assert!(Command::new("umount").arg(&small).status().unwrap().success());
    let message = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{message}");
    // The marker of the scratch folder is already written.
    assert!(
        message.contains("small") && message.contains("12 KiB free") && message.contains("are needed"),
        "{message}"
    );
    assert!(empty, "nothing is left");
}
