//! Every STL and glTF of `../shared/data`, where that folder is present: read with the number of triangles that the
//! reference parser finds, or refused with a message that a person understands.

use crate::shared_data::{check_invariants, data, files_of, refusal_of};
use kilwa_formats::RawMesh;
use kilwa_formats::read::{ReadError, read_mesh};
use std::path::Path;

/// Triangles that the reference parser found in a file, as the folder's README says.
fn reference(folder: &Path, path: &Path) -> Option<usize> {
    let readme = std::fs::read_to_string(folder.join("README.md")).unwrap();
    let name = path.strip_prefix(folder).unwrap().to_string_lossy().into_owned();
    let row = readme.lines().find(|l| l.starts_with(&format!("| {name} |")))?;
    row.split('|').nth(6)?.trim().parse().ok()
}

fn report(path: &Path, mesh: &RawMesh) {
    println!("read    {}: {} triangles", path.display(), mesh.triangles.len());
    for (kind, n, places) in mesh.diagnostics.iter() {
        println!("          {n} {kind}: {}", places.join("; "));
    }
}

#[test]
fn every_stl_has_the_triangles_that_the_reference_finds() {
    let Some(folder) = data() else { return };
    let all = files_of(&folder, &["stl"]);
    for path in &all {
        let name = path.display().to_string();
        let mesh = read_mesh(path, &mut |_, _| {}).unwrap_or_else(|e| panic!("{e}"));
        report(path, &mesh);
        check_invariants(&mesh, &name);
        if let Some(triangles) = reference(&folder, path) {
            assert_eq!(mesh.triangles.len(), triangles, "{name}");
        }
    }
    assert!(all.len() >= 20, "{}", all.len());
}

#[test]
fn every_gltf_is_read_or_refused_with_a_plain_message() {
    let Some(folder) = data() else { return };
    let all = files_of(&folder, &["gltf", "glb"]);
    let (mut read, mut refused) = (0, 0);
    for path in &all {
        let name = path.strip_prefix(&folder).unwrap().display().to_string();
        match read_mesh(path, &mut |_, _| {}) {
            Ok(mesh) => {
                read += 1;
                report(Path::new(&name), &mesh);
                check_invariants(&mesh, &name);
            }
            Err(e) => {
                refused += 1;
                let text = refusal_of(path, &e);
                match e {
                    ReadError::Part { part, expected, .. } => {
                        assert!(!part.is_empty() && !expected.is_empty(), "names the part: {text}");
                    }
                    ReadError::Malformed { .. } => assert!(text.contains(", byte "), "names the place: {text}"),
                    ReadError::Needs { .. } | ReadError::Format { .. } => {
                        assert!(text.contains("xport") || text.contains("Give"), "says what to do: {text}");
                    }
                    ReadError::NoTriangles { .. } => {}
                    other => panic!("{name}: {other}"),
                }
            }
        }
    }
    println!("{read} read, {refused} refused");
    assert!(read >= 85 && read + refused >= 300, "{read} {refused}");
}

/// A mesh and its Draco form, made by the same program, have the same triangles within the quantisation.
#[test]
fn a_draco_file_has_the_same_surface_as_its_uncompressed_form() {
    let Some(folder) = data() else { return };
    let read = |name: &str| read_mesh(&folder.join("IIIF+3d/assets/whale").join(name), &mut |_, _| {}).unwrap();
    let (plain, packed) = (read("whale_cranium.glb"), read("whale_cranium_draco.glb"));
    assert_eq!((plain.triangles.len(), plain.positions.len()), (packed.triangles.len(), packed.positions.len()));
    let area = |mesh: &RawMesh| -> f64 {
        let corner = |v: u32| mesh.positions[v as usize];
        let areas = mesh.triangles.iter().map(|t| {
            let [a, b, c] = t.map(corner);
            (b - a).cross(c - a).length() / 2.0
        });
        areas.sum()
    };
    let (a, b) = (area(&plain), area(&packed));
    assert!((a / b - 1.0).abs() < 0.01, "{a} {b}");
}

/// What is reported of each damaged file of `tests/malformed`: in the message if refused, in the diagnostics if repaired
/// (empty: it looks damaged but needs no repair).
const MALFORMED: &[(&str, &str)] = &[
    ("accessor_beyond_view.gltf", "accessors[0]: found 5 elements"),
    ("accessor_count_2_64.gltf", "accessors[0]"),
    ("accessor_of_4_billion.gltf", "4000000000 elements without a buffer view"),
    ("base64_damaged.gltf", "buffers[0]: found a data URI that is not valid base64"),
    ("buffer_missing.gltf", "not here.bin"),
    ("buffer_on_the_web.gltf", "download it"),
    ("chunk_too_large.glb", "found a chunk of 972 bytes"),
    ("comma.stl", "line 5: found \"1,5\""),
    ("cut_in_a_number.stl", "found the end of the file"),
    ("cut_in_binary.glb", "the file is truncated"),
    ("draco_of_noise.gltf", "meshes[0].primitives[0]: found a Draco stream in bufferViews[0]"),
    ("gltf_1_0.gltf", "is glTF 1.0"),
    ("index_out_of_range.gltf", "accessors[1]"),
    ("meshopt_of_noise.gltf", "bufferViews[0]"),
    ("negative_mesh.gltf", "nodes[0].mesh"),
    ("no_binary_chunk.glb", "buffers[0]: found neither a uri nor a binary chunk"),
    ("no_corners.stl", "has no triangles"),
    ("no_facets.stl", "its header counts no facets"),
    ("node_circle.gltf", "nodes[0]: found that it is reached twice"),
    ("only_lines.gltf", "its meshes are points, lines or empty"),
    ("other_word.stl", "line 7: found \"endlop\""),
    ("repaired_bytes_behind.glb", "bytes behind the end"),
    ("repaired_colours.stl", "triangles whose colour was given to their vertices"),
    ("repaired_count_too_large.stl", "facets that the header counts and the file does not have"),
    ("repaired_count_zero.stl", "headers that count no facets"),
    ("repaired_cut_in_a_facet.stl", "facets that the header counts and the file does not have"),
    ("repaired_index_left_over.gltf", "last indices make no triangle"),
    ("repaired_mirrored.gltf", ""),
    ("repaired_nan_corner.stl", "a corner has no finite position"),
    ("repaired_no_default_scene.gltf", ""),
    ("repaired_no_endfacet.stl", "facets without endfacet"),
    ("repaired_no_scene.gltf", "because there is no scene"),
    ("repaired_points_too.gltf", "points or lines left out"),
    ("repaired_quad_facet.stl", "cut as fans"),
    ("repaired_solid_binary.stl", ""),
    ("repaired_trailing_bytes.stl", "bytes after the last facet"),
    ("repaired_two_solids.stl", ""),
    ("sparse_beyond.gltf", "accessors[0].sparse"),
    ("stride_zero.gltf", "every 0 bytes"),
    ("unknown_extension.gltf", "ACME_secret"),
    ("view_beyond_buffer.gltf", "bufferViews[0]: found 4800 bytes"),
];

#[test]
fn every_malformed_stl_and_gltf_is_refused_or_repaired_as_the_table_states() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/malformed");
    let all = files_of(&folder, &["stl", "gltf", "glb"]);
    assert_eq!(all.len(), MALFORMED.len(), "the table names every file");
    for (name, words) in MALFORMED {
        match read_mesh(&folder.join(name), &mut |_, _| {}) {
            Ok(mesh) => {
                assert!(name.starts_with("repaired_"), "{name} was read");
                check_invariants(&mesh, name);
                let kinds: Vec<&str> = mesh.diagnostics.iter().map(|(kind, _, _)| kind).collect();
                assert!(kinds.iter().any(|s| s.contains(words)) || words.is_empty(), "{name}: {words:?} in {kinds:?}");
            }
            Err(e) => {
                let message = e.to_string();
                assert!(
                    !name.starts_with("repaired_") && message.contains(words),
                    "{name}: expected {words:?} in {message}"
                );
                assert!(message.contains(name), "names the file: {message}");
            }
        }
    }
}
