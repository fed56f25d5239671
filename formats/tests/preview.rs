//! The small GLB that is published beside a pack.

use glam::DVec3;
use kilwa_builder::{BuildOptions, Silent, build_pack};
use kilwa_formats::RawMesh;
use kilwa_formats::extract::{ExtractError, Preview, preview};
use kilwa_pack::Reader;
use kilwa_pack::reader::SliceSource;
use std::path::Path;

/// A rough square of 80,000 triangles at map coordinates.
fn square(folder: &Path) -> std::path::PathBuf {
    let n = 200u32;
    let height = |i: u32, j: u32| f64::from((i * 7919 + j * 104_729) % 97) * 0.0005;
    let at =
        |i: u32, j: u32| DVec3::new(524_000.0 + f64::from(i) * 0.05, 9_012_000.0 + f64::from(j) * 0.05, height(i, j));
    let mesh = RawMesh {
        positions: (0..=n).flat_map(|j| (0..=n).map(move |i| at(i, j))).collect(),
        triangles: (0..n)
            .flat_map(|j| (0..n).map(move |i| (i + j * (n + 1), n + 1)))
            .flat_map(|(a, row)| [[a, a + 1, a + row + 1], [a, a + row + 1, a + row]])
            .collect(),
        ..RawMesh::default()
    };
    let path = folder.join("square.kilwa");
    let built = build_pack(mesh, &BuildOptions::default(), &Silent).expect("builds");
    std::fs::write(&path, built.bytes).expect("writes");
    path
}

fn write(pack: &Path, to: &Path, max_bytes: u64) -> Result<Preview, ExtractError> {
    let reader = Reader::open(SliceSource(std::fs::read(pack).expect("reads"))).expect("opens");
    preview(&reader, to, max_bytes)
}

#[test]
fn a_preview_stays_within_the_limit_nearly_reaches_it_and_is_centred_at_zero() {
    let work = tempfile::tempdir().expect("a folder");
    let (pack, to) = (square(work.path()), work.path().join("preview.glb"));
    let preview = write(&pack, &to, 900_000).expect("writes");
    let bytes = std::fs::read(&to).expect("reads");
    assert_eq!(preview.bytes, bytes.len() as u64);
    assert!((450_000..=900_000).contains(&bytes.len()), "{} bytes", bytes.len());
    assert!(preview.error > 0.0 && preview.triangles > 10_000, "{preview:?}");
    let length = u32::from_le_bytes(bytes[12..16].try_into().expect("four")) as usize;
    let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).expect("JSON");
    let matrix = &json["nodes"][0]["matrix"];
    assert_eq!([&matrix[12], &matrix[13], &matrix[14]].map(serde_json::Value::as_f64), [Some(0.0); 3], "{matrix}");
    let place = json["extras"]["world_from_local_m"][0].as_f64().expect("a number");
    assert!((place - 524_005.0).abs() < 1.0, "{place}");
}

#[test]
fn a_limit_below_the_simplest_surface_is_refused_and_leaves_no_file() {
    let work = tempfile::tempdir().expect("a folder");
    let (pack, to) = (square(work.path()), work.path().join("preview.glb"));
    let message = write(&pack, &to, 1000).expect_err("too small").to_string();
    assert!(message.contains("simplest surface takes more than 1000 bytes"), "{message}");
    assert_eq!(std::fs::read_dir(work.path()).expect("lists").count(), 1);
}
