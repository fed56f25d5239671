//! Compressed Nexus files compared with the output of Corto's own JavaScript decoder (html/js at 0d624d5, MIT, in Node 20): twenty small ones, and a
//! real one if `../shared/data` is present.

use crate::shared_data::{check_invariants, data};
use glam::DVec3;
use kilwa_formats::RawMesh;
use kilwa_formats::read::read_mesh;
use sha2::{Digest, Sha256};
use std::path::Path;

/// The corner positions of all triangles, sorted, each triangle starting at its smallest corner.
fn triangles(mesh: &RawMesh) -> Vec<[[u64; 3]; 3]> {
    let place = |v: u32| (mesh.positions[v as usize] + DVec3::ZERO).to_array().map(f64::to_bits);
    let turned = |t: &[u32; 3]| {
        let corners = t.map(place);
        let first = (0..3).min_by_key(|&k| corners[k]).unwrap_or(0);
        [0, 1, 2].map(|k| corners[(first + k) % 3])
    };
    let mut all: Vec<_> = mesh.triangles.iter().map(turned).collect();
    all.sort_unstable();
    all
}

#[test]
fn a_real_compressed_model_matches_the_reference_decoder() {
    let Some(folder) = data() else { return };
    let path = folder.join("cnr-isti-vclab+nexus/html/models/gargo.nxz");
    if !path.is_file() {
        eprintln!("skipped: {} is not there", path.display());
        return;
    }
    let mesh = read_mesh(&path, &mut |_, _| {}).unwrap();
    check_invariants(&mesh, "gargo.nxz");
    // Counts and sums over the vertices of the two finest nodes, from html/js of Corto at 0d624d5 (MIT) in Node 20.
    assert_eq!((mesh.positions.len(), mesh.triangles.len()), (9599 + 15829, 18772 + 31228));
    assert_eq!(mesh.positions.iter().sum::<DVec3>(), DVec3::new(34144.25, 1_630_331.0, -288_010.75));
    let colors = mesh.colors.iter().fold([0; 3], |sum: [u64; 3], c| [0, 1, 2].map(|k| sum[k] + u64::from(c[k])));
    assert_eq!(colors, [2_458_476, 2_279_672, 1_821_816]);
    // That decoder rounds normal corrections differently from the encoder; normals differ by up to 0.25 degrees.
    let normals: DVec3 = mesh.normals.iter().map(|n| n.as_dvec3()).sum();
    let theirs = DVec3::new(-219.272_121, 782.744_134, 1_008.091_587);
    assert!((normals - theirs).length() < 0.0005 * mesh.normals.len() as f64, "{normals}");
    let derived = folder.join("derived/gargo_from_nxz.ply");
    if !derived.is_file() {
        eprintln!("skipped: {} is not there", derived.display());
        return;
    }
    // It was decoded from the same file by another program, and its vertices were merged.
    let other = read_mesh(&derived, &mut |_, _| {}).unwrap();
    let joined: std::collections::BTreeSet<_> = triangles(&other).into_iter().collect();
    let missing = triangles(&mesh).into_iter().filter(|t| !joined.contains(t)).count();
    // Merging made the missing ones degenerate.
    assert!(missing <= 50_000 - other.triangles.len(), "{missing} triangles are not in {}", derived.display());
}

/// SHA-256 of the corners of all triangles, positions as floats and colours, sorted, each triangle starting at its smallest corner.
fn digest(mesh: &RawMesh) -> String {
    let corner = |v: u32| {
        let position = (mesh.positions[v as usize] + DVec3::ZERO).as_vec3().to_array().map(f32::to_le_bytes);
        let color = mesh.colors.get(v as usize).copied().unwrap_or_default();
        [position.as_flattened(), &color].concat()
    };
    let turned = |t: &[u32; 3]| {
        let mut corners = t.map(corner);
        let first = (0..3).min_by_key(|&k| &corners[k]).unwrap_or(0);
        corners.rotate_left(first);
        corners.concat()
    };
    let mut all: Vec<Vec<u8>> = mesh.triangles.iter().map(turned).collect();
    all.sort_unstable();
    format!("{:x}", Sha256::digest(all.concat()))
}

/// The files were made by `xtask/peers/nxz_files.py` (`nxs_build` and `nxs_compress` of pymeshlab 2025.7), the digests by `nxz_decoded.js` beside it.
#[test]
fn twenty_compressed_models_match_the_reference_decoder() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/nexus");
    let digests = std::fs::read_to_string(folder.join("SHA256")).unwrap();
    let mut files = 0;
    for line in digests.lines() {
        let (expected, name) = line.split_once("  ").unwrap();
        let mesh = read_mesh(&folder.join(name), &mut |_, _| {}).unwrap();
        check_invariants(&mesh, name);
        assert_eq!(digest(&mesh), expected, "{name}");
        files += 1;
    }
    assert_eq!(files, 20);
}
