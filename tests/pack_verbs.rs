//! `kilwa info`, `verify` and `extract` on packs that `kilwa build` wrote: the mesh round-trips, coarser forms have
//! no cracks, damage is found and named, and a failure leaves no files behind.

use crate::support::{
    Corner, Input, Ply, built_once, fails, json, kilwa, large_pack, multiset, plys, shared, succeeds, text,
};
use kilwa_geometry::Lattice;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Triangles of the torus.
const TRIANGLES: usize = 40_960;

/// A torus at UTM coordinates, and the pack of it.
fn torus() -> &'static (Input, PathBuf) {
    static BUILT: OnceLock<(Input, PathBuf)> = OnceLock::new();
    BUILT.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("pack_verbs");
        let mesh = Input::torus(320, 64, [531_000.0, 9_010_000.0, 12.0]);
        let pack = built_once(&folder, "torus", |to| mesh.write(to), &["--crs", "EPSG:32737"]);
        (mesh, pack)
    })
}

fn lattice(pack: &Path) -> Lattice {
    let info = json(&["info", text(pack)]);
    let step = info["lattice_step"].as_f64().unwrap();
    let origin = [0, 1, 2].map(|k| info["lattice_origin"][k].as_f64().unwrap());
    let lattice = Lattice { origin: origin.into(), step_log2: step.log2().round() as i32 };
    assert_eq!(lattice.step(), step);
    lattice
}

fn of_ply(ply: &Ply, lattice: &Lattice) -> Vec<[Corner; 3]> {
    let corner = |v: u32| {
        let color = ply.get(v, "red").map(|r| [r, ply.get(v, "green").unwrap(), ply.get(v, "blue").unwrap()]);
        (
            lattice.snap(ply.position(v).into()).expect("inside the lattice").to_array(),
            color.map(|c| c.map(|x| x as u8)),
        )
    };
    multiset(ply.triangles.iter().map(|t| t.map(corner)))
}

#[test]
fn a_full_extract_contains_every_triangle_with_its_colours() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, pack) = torus();
    let lattice = lattice(pack);
    let corner =
        |v: u32| (lattice.snap(mesh.positions[v as usize].into()).unwrap().to_array(), Some(mesh.colors[v as usize]));
    let wanted = multiset(mesh.triangles.iter().map(|t| t.map(corner)));
    assert_eq!(wanted.len(), TRIANGLES);
    for form in [&[][..], &["--ascii"]] {
        let out = folder.path().join("back.ply");
        let args = [&["extract", text(pack), "-o", text(&out), "--force"], form].concat();
        assert_eq!(json(&args)["max_error"], 0.0);
        let back = Ply::read(&out);
        assert_eq!(back.types[0], "double", "a float cannot hold UTM coordinates");
        assert_eq!(back.vertices.len(), mesh.positions.len(), "vertices are welded");
        assert!(of_ply(&back, &lattice) == wanted, "the same triangles, as a multiset");
        for v in 0..100 {
            let n = ["nx", "ny", "nz"].map(|k| back.get(v, k).unwrap());
            assert!((n.iter().map(|x| x * x).sum::<f64>() - 1.0).abs() < 1e-5);
        }
    }
}

#[test]
fn coarser_extracts_have_no_cracks_and_stay_within_their_error() {
    let folder = tempfile::tempdir().unwrap();
    let (_, pack) = torus();
    let out = folder.path().join("coarse.ply");
    let mut last = 0;
    for limit in ["1", "0.1", "0.02", "0.005", "0.001", "0"] {
        let report = json(&["extract", text(pack), "-o", text(&out), "--force", "--max-error", limit]);
        assert!(report["max_error"].as_f64().unwrap() <= limit.parse::<f64>().unwrap());
        let ply = Ply::read(&out);
        assert_eq!(report["triangles"], ply.triangles.len());
        assert!(ply.triangles.len() >= last, "a smaller error needs no fewer triangles");
        last = ply.triangles.len();
        assert!(ply.edge_uses().values().all(|&n| n == 2), "a closed mesh stays closed at {limit} m");
    }
    assert_eq!(last, TRIANGLES);
    let few = kilwa(&["extract", text(pack), "-o", text(&out), "--force", "--max-triangles", "10"]);
    assert!(few.status.success());
    assert!(
        String::from_utf8_lossy(&few.stderr).contains("cannot be simplified further"),
        "a torus has at least 14 triangles, and the message says that there are more than 10"
    );
}

#[test]
fn a_triangle_limit_is_met_without_cracks() {
    let pack = large_pack();
    let work = tempfile::tempdir().unwrap();
    let out = work.path().join("part.ply");
    for limit in [120_000u64, 160_000, 200_000, 266_664, 327_679] {
        let args = ["extract", text(&pack), "-o", text(&out), "--force", "--max-triangles", &limit.to_string()];
        let found = json(&args)["triangles"].as_u64().unwrap();
        assert!(found <= limit && found + 8 >= limit, "{found} triangles of {limit}");
        assert!(Ply::read(&out).edge_uses().values().all(|&n| n == 2));
    }
}

/// Build, verify and extract one file; whether it was built. What comes back is compared with what the reader gives.
fn comes_back_whole(input: &Path) -> bool {
    let folder = tempfile::tempdir().unwrap();
    let (pack, out) = (folder.path().join("a.kilwa"), folder.path().join("a.ply"));
    let shown = input.display();
    let built = kilwa(&["build", text(input), "-o", text(&pack)]);
    if !built.status.success() {
        let message = String::from_utf8_lossy(&built.stderr);
        let name = input.file_name().unwrap().to_str().unwrap();
        assert_eq!(built.status.code(), Some(1), "{shown}: {message}");
        assert!(
            message.contains(name) || message.contains("no triangles"),
            "{shown}: the message names no file: {message}"
        );
        assert!(std::fs::read_dir(folder.path()).unwrap().next().is_none(), "{shown}: something is left behind");
        return false;
    }
    succeeds(&["verify", text(&pack)]);
    succeeds(&["extract", text(&pack), "-o", text(&out)]);
    let lattice = lattice(&pack);
    let raw = kilwa_formats::read::read_mesh(input, &mut |_, _| {}).unwrap();
    let corner =
        |v: u32| (lattice.snap(raw.positions[v as usize]).unwrap().to_array(), raw.colors.get(v as usize).copied());
    let wanted = multiset(raw.triangles.iter().map(|t| t.map(corner)));
    let back = Ply::read(&out);
    let mut found = of_ply(&back, &lattice);
    if raw.colors.is_empty() && raw.scalars.iter().any(|(name, _)| name == "intensity") {
        // The build coloured them grey from their intensity.
        found = multiset(found.into_iter().map(|t| t.map(|(at, _)| (at, None))));
    }
    assert!(found == wanted, "{shown}: {} triangles of {}", back.triangles.len(), wanted.len());
    for (scalar, _) in &raw.scalars {
        assert!(back.properties.contains(scalar), "{shown}: {scalar} is lost");
    }
    true
}

#[test]
fn every_shared_ply_round_trips_or_is_refused_by_name() {
    let Some(listed) = shared("LIST.sha256") else { return };
    let mut files = Vec::new();
    plys(listed.parent().unwrap(), &mut files);
    let (built, refused): (Vec<_>, Vec<_>) = files.iter().partition(|file| comes_back_whole(file));
    println!("{} built, {} refused: {refused:#?}", built.len(), refused.len());
    for name in ["horse.ply", "laurana.ply", "gargo.ply", "lucy.ply", "bun_zipper.ply", "turbineblade.ply"] {
        assert!(built.iter().any(|file| file.ends_with(name)), "{name} must build");
    }
}

#[test]
fn rounding_to_fewer_bits_is_within_half_a_quantum_and_recorded_in_the_pack() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, exact) = torus();
    let input = folder.path().join("torus.ply");
    mesh.write(&input);
    let extracted = |pack: &Path, name: &str| {
        let ply = folder.path().join(name);
        succeeds(&["extract", text(pack), "--force", "-o", text(&ply)]);
        let ply = Ply::read(&ply);
        let vertex = |v: u32| {
            let of = |names: [&str; 3]| names.map(|n| ply.get(v, n).unwrap());
            (ply.position(v).map(f64::to_bits), of(["red", "green", "blue"]), of(["nx", "ny", "nz"]))
        };
        let used: BTreeSet<u32> = ply.triangles.iter().flatten().copied().collect();
        used.into_iter().map(vertex).map(|(place, color, normal)| (place, (color, normal))).collect::<BTreeMap<_, _>>()
    };
    let before = extracted(exact, "exact.ply");
    let mut bytes = std::fs::metadata(exact).unwrap().len();
    // The largest angle: half a diagonal of the octahedral grid, twice as long on the sphere at the worst place.
    for (bits, normal_bits, angle) in [("8", "10", 0.0), ("6", "8", 1.3), ("4", "6", 5.2)] {
        let pack = folder.path().join(format!("{bits}.kilwa"));
        let options = ["--crs", "EPSG:32737", "--color-bits", bits, "--normal-bits", normal_bits];
        succeeds(&[&["build", text(&input), "-o", text(&pack)][..], &options].concat());
        let after = extracted(&pack, "fewer.ply");
        assert_eq!(before.len(), after.len(), "{bits}");
        let quantum = f64::from(1 << (8 - bits.parse::<u32>().unwrap()));
        let mut worst = 0.0f64;
        for ((place, (c, n)), (same_place, (d, m))) in before.iter().zip(&after) {
            assert_eq!(place, same_place, "places are exact");
            let error = (0..3).map(|k| (c[k] - d[k]).abs()).fold(0.0, f64::max);
            assert!(error <= if quantum > 1.0 { quantum / 2.0 } else { 0.0 }, "{bits}: {c:?} became {d:?}");
            worst = worst.max((0..3).map(|k| n[k] * m[k]).sum::<f64>().clamp(-1.0, 1.0).acos().to_degrees());
        }
        assert!(worst <= angle + 0.05, "{normal_bits}: {worst} degrees");
        let now = std::fs::metadata(&pack).unwrap().len();
        assert!(now < bytes || bits == "8", "{bits}: {now} bytes, {bytes} before");
        bytes = now;
        let words = succeeds(&["info", text(&pack)]);
        for part in [format!("color-bits = {bits}"), format!("normal-bits = {normal_bits}")] {
            assert!(words.contains(&part), "{part} is missing in\n{words}");
        }
    }
    for (option, bits) in
        [("--color-bits", "3"), ("--color-bits", "9"), ("--normal-bits", "5"), ("--normal-bits", "17")]
    {
        let output = kilwa(&["build", text(&input), "-o", text(&folder.path().join("no.kilwa")), option, bits]);
        let message = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{message}");
        assert!(message.contains(option) && message.contains(bits), "{message}");
    }
}

#[test]
fn info_describes_the_pack() {
    let (mesh, pack) = torus();
    let info = json(&["info", text(pack)]);
    assert_eq!(info["metadata"]["triangles"], mesh.triangles.len());
    assert_eq!(info["metadata"]["vertices"], mesh.positions.len());
    assert_eq!(info["metadata"]["border_edges"], 0);
    assert_eq!(info["metadata"]["crs"], "EPSG:32737");
    assert_eq!(info["bytes"], std::fs::metadata(pack).unwrap().len());
    let levels = info["levels"].as_array().unwrap();
    let sum = |key: &str| levels.iter().map(|l| l[key].as_u64().unwrap()).sum::<u64>();
    assert_eq!(sum("triangles"), info["stored_triangles"].as_u64().unwrap());
    assert_eq!(sum("chunks"), info["chunks"].as_u64().unwrap());
    let words = succeeds(&["info", text(pack)]);
    for part in ["40,960", "EPSG:32737", "531", "bytes per input triangle", "torus.ply", "repairs"] {
        assert!(words.contains(part), "{part} is missing in\n{words}");
    }
}

#[test]
fn verify_names_the_damaged_part() {
    let folder = tempfile::tempdir().unwrap();
    let (_, pack) = torus();
    assert!(succeeds(&["verify", text(pack)]).contains("sound"));
    assert_eq!(json(&["verify", text(pack)])["sound"], true);
    let good = std::fs::read(pack).unwrap();
    let reader = kilwa_pack::Reader::open(kilwa_pack::SliceSource(&good)).unwrap();
    let header = reader.header();
    let chunk = reader.entries()[3].offset as usize;
    let damaged = folder.path().join("damaged.kilwa");
    let places = [
        (5, "not a Kilwa pack"),
        (100, "header"),
        (300, "metadata"),
        (header.first_page as usize + 200, "directory page 0"),
        (chunk + 20, "chunk 3"),
        (good.len() - 30, "footer"),
    ];
    for (at, part) in places {
        let mut bytes = good.clone();
        bytes[at] ^= 0x10;
        std::fs::write(&damaged, &bytes).unwrap();
        let message = fails(&["verify", text(&damaged)]);
        assert!(message.contains(part) && message.contains("damaged.kilwa"), "byte {at}: {message}");
        let output = kilwa(&["verify", text(&damaged), "--json"]);
        let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
        assert_eq!(report["sound"], false);
        assert!(report["damaged"][0].as_str().unwrap().contains(part));
    }
    std::fs::write(&damaged, &good[..good.len() - 1000]).unwrap();
    assert!(fails(&["verify", text(&damaged)]).contains("truncated"));
    let all_but_one = [1usize, 3, 5].map(|i| reader.entries()[i].offset as usize);
    let mut bytes = good.clone();
    for at in all_but_one {
        bytes[at + 9] ^= 1;
    }
    std::fs::write(&damaged, &bytes).unwrap();
    let message = fails(&["verify", text(&damaged)]);
    assert!(
        ["chunk 1", "chunk 3", "chunk 5"].iter().all(|c| message.contains(c)),
        "every damaged chunk is named: {message}"
    );
}

/// A pack with a change in its header or first directory page, and all hashes corrected.
fn forged(pack: &[u8], change: impl FnOnce(&mut [u8])) -> Vec<u8> {
    let mut bytes = pack.to_vec();
    change(&mut bytes);
    let page = u64::from_le_bytes(bytes[104..112].try_into().unwrap()) as usize;
    bytes[page + 16..page + 32].fill(0);
    let sum = kilwa_pack::checksum(&bytes[page..page + 16_384]);
    bytes[page + 16..page + 32].copy_from_slice(&sum);
    let hash = blake3::hash(&bytes[..224]);
    bytes[224..256].copy_from_slice(hash.as_bytes());
    let end = bytes.len();
    bytes[end - 64..end - 32].copy_from_slice(hash.as_bytes());
    bytes[end - 32..].copy_from_slice(blake3::hash(&sum).as_bytes());
    bytes
}

#[test]
fn verify_finds_wrong_values_even_if_all_hashes_are_right() {
    let folder = tempfile::tempdir().unwrap();
    let good = std::fs::read(&torus().1).unwrap();
    let reader = kilwa_pack::Reader::open(kilwa_pack::SliceSource(&good)).unwrap();
    let header = reader.header();
    assert_eq!(header.page_count(), 1, "hashes can be corrected only for packs of one page");
    let path = folder.path().join("forged.kilwa");
    let write = |change: &dyn Fn(&mut [u8])| std::fs::write(&path, forged(&good, change)).unwrap();
    let color_error = |entry: usize| header.first_page as usize + 128 * (1 + entry) + 24;
    let set = |at: usize, error: f32| move |b: &mut [u8]| b[at..at + 4].copy_from_slice(&error.to_le_bytes());
    // The colour error of the root has no meaning.
    write(&set(color_error(0), f32::INFINITY));
    succeeds(&["verify", text(&path)]);
    write(&set(color_error(1), 255.0));
    succeeds(&["verify", text(&path)]);
    for error in [255.5, 1e30, f32::INFINITY] {
        write(&set(color_error(1), error));
        let message = fails(&["verify", text(&path)]);
        assert!(message.contains("directory entry 1") && message.contains("at most 255"), "{error}: {message}");
    }
    // Between two parts, where a wrong offset leaves no gap, because there are no further pages.
    let places = [header.first_page + 16_384, reader.entries()[1].offset, header.file_bytes - 80];
    let wrong: Vec<u64> = places.into_iter().filter(|at| *at != header.other_pages).collect();
    assert!(wrong.len() >= 2);
    for at in wrong {
        write(&|b: &mut [u8]| b[112..120].copy_from_slice(&at.to_le_bytes()));
        let message = fails(&["verify", text(&path)]);
        assert!(message.contains("directory page 1 is at byte"), "{at}: {message}");
    }
}

/// A user may name a disk image by mistake, and reading it to the end would take hours.
#[test]
fn verify_does_not_read_a_file_that_is_not_a_pack() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("image.kilwa");
    // A sparse file of 1 TiB takes no space but would take hours to read.
    std::fs::File::create(&path).unwrap().set_len(1 << 40).unwrap();
    let message = fails(&["verify", text(&path)]);
    assert!(message.contains("not a Kilwa pack") && message.contains("image.kilwa"), "{message}");
    let output = kilwa(&["verify", text(&path), "--json"]);
    let report: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&report["sound"], output.status.code()), (&serde_json::Value::Bool(false), Some(1)));
}

/// `kilwa info x | head -1` succeeds.
#[test]
#[cfg(unix)]
fn a_closed_pipe_does_not_hide_damage() {
    let folder = tempfile::tempdir().unwrap();
    let (_, pack) = torus();
    let damaged = folder.path().join("damaged.kilwa");
    let mut bytes = std::fs::read(pack).unwrap();
    bytes[300] ^= 1;
    std::fs::write(&damaged, bytes).unwrap();
    for (args, code) in [(["info", text(pack)], 0), (["verify", text(pack)], 0), (["verify", text(&damaged)], 1)] {
        let (reader, writer) = std::io::pipe().unwrap();
        drop(reader);
        let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_kilwa"));
        let output = command.args(args).arg("--json").stdout(writer).stderr(std::process::Stdio::piped()).spawn();
        let output = output.unwrap().wait_with_output().unwrap();
        assert_eq!(output.status.code(), Some(code), "{args:?}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn a_failed_extract_leaves_nothing_behind() {
    let folder = tempfile::tempdir().unwrap();
    let (_, pack) = torus();
    let work = folder.path().join("work");
    std::fs::create_dir(&work).unwrap();
    let empty = || std::fs::read_dir(&work).unwrap().next().is_none();
    let out = work.join("a.ply");

    let mut bytes = std::fs::read(pack).unwrap();
    let entry = kilwa_pack::Reader::open(kilwa_pack::SliceSource(&bytes)).unwrap().entries()[4].clone();
    let (offset, error) = (entry.offset as usize, f64::from(entry.error).to_string());
    bytes[offset + 30] ^= 4;
    let damaged = folder.path().join("damaged.kilwa");
    std::fs::write(&damaged, &bytes).unwrap();
    for limit in [&[][..], &["--max-triangles", "90000"]] {
        let message = fails(&[&["extract", text(&damaged), "-o", text(&out)], limit].concat());
        assert!(message.contains("chunk 4") && message.contains("damaged.kilwa"), "{message}");
        assert!(empty());
    }
    // What needs nothing of the damaged chunk is the same as without the damage.
    let coarse = |pack: &Path| {
        succeeds(&["extract", text(pack), "-o", text(&out), "--max-error", &error]);
        let bytes = std::fs::read(&out).unwrap();
        std::fs::remove_file(&out).unwrap();
        bytes
    };
    assert!(coarse(&damaged) == coarse(pack));
    // Folders are made, and removed again where nothing came into them.
    let made = work.join("made/for/it/a.ply");
    succeeds(&["extract", text(pack), "-o", text(&made), "--max-error", &error]);
    assert!(made.is_file());
    std::fs::remove_dir_all(work.join("made")).unwrap();
    fails(&["extract", text(&damaged), "-o", text(&made)]);
    assert!(fails(&["extract", text(pack), "-o", text(&work)]).contains("folder"));
    assert!(fails(&["extract", text(pack), "-o", text(&work.join("a.xyz"))]).contains("cannot write .xyz"));
    assert!(fails(&["extract", text(&work.join("no.kilwa")), "-o", text(&out)]).contains("no.kilwa"));
    if Path::new("/dev/full").exists() {
        assert!(fails(&["extract", text(pack), "-o", "/dev/full"]).contains("/dev/full"));
        assert!(Path::new("/dev/full").exists());
    }
    assert!(empty());

    std::fs::write(&out, "precious").unwrap();
    assert!(fails(&["extract", text(pack), "-o", text(&out)]).contains("--force"));
    assert_eq!(std::fs::read_to_string(&out).unwrap(), "precious");
    assert!(fails(&["extract", text(&damaged), "-o", text(&out), "--force"]).contains("chunk 4"));
    assert_eq!(std::fs::read_to_string(&out).unwrap(), "precious", "replaced only by a complete file");
    succeeds(&["extract", text(pack), "-o", text(&out), "--force"]);
    assert_eq!(std::fs::read_dir(&work).unwrap().count(), 1);
}
