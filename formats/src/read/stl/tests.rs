//! What the STL reader keeps, repairs and refuses.

use super::super::{ReadError, read_mesh_from};
use super::facets::CONTRADICTS;
use crate::RawMesh;
use glam::{DVec3, Vec3};
use std::path::Path;

fn read(bytes: &[u8]) -> Result<RawMesh, ReadError> {
    read_mesh_from(std::io::Cursor::new(bytes), bytes.len() as u64, Path::new("a.stl"), &mut |_, _| {})
}

/// Text as a mesh.
fn text(lines: &str) -> RawMesh {
    read(lines.as_bytes()).unwrap()
}

fn refusal(bytes: &[u8]) -> String {
    read(bytes).unwrap_err().to_string()
}

const FACET: &str =
    "facet normal 0 0 1\n outer loop\n vertex 0 0 0\n vertex 1 0 0\n vertex 0 1 0\n endloop\n endfacet\n";

/// Normal, corners and attribute.
type Facet = (Vec3, [Vec3; 3], u16);

/// A binary file: free text, the count in the header, facets.
fn binary(header: &[u8], announced: u32, facets: &[Facet]) -> Vec<u8> {
    let mut bytes = header.to_vec();
    bytes.resize(80, b' ');
    bytes.extend(announced.to_le_bytes());
    for (normal, corners, attribute) in facets {
        for x in [normal].into_iter().chain(corners).flat_map(Vec3::to_array) {
            bytes.extend(x.to_le_bytes());
        }
        bytes.extend(attribute.to_le_bytes());
    }
    bytes
}

const UP: Vec3 = Vec3::Z;
const CORNERS: [Vec3; 3] = [Vec3::ZERO, Vec3::X, Vec3::Y];

#[test]
fn a_binary_file_that_begins_with_solid_is_read_as_binary() {
    let mesh = read(&binary(b"solid facet made by a scanner", 2, &[(UP, CORNERS, 0); 2])).unwrap();
    assert_eq!((mesh.triangles.len(), mesh.positions.len()), (2, 6));
    assert!(mesh.colors.is_empty() && mesh.normals.is_empty());
}

#[test]
fn a_wrong_facet_count_is_reported_and_the_existing_facets_are_read() {
    let facets = [(UP, CORNERS, 0); 3];
    let mesh = read(&binary(b"scan", 10, &facets)).unwrap();
    assert_eq!(mesh.triangles.len(), 3);
    assert_eq!(mesh.diagnostics.count("facets that the header counts and the file does not have"), 7);
    let mesh = read(&binary(b"scan", 0, &facets)).unwrap();
    assert_eq!(mesh.triangles.len(), 3);
    let mut bytes = binary(b"scan", 2, &facets);
    bytes.extend(b"abc");
    let mesh = read(&bytes).unwrap();
    assert_eq!(mesh.triangles.len(), 2);
    assert_eq!(mesh.diagnostics.count("bytes after the last facet left out"), 53);
}

#[test]
fn a_header_that_announces_4_billion_facets_allocates_no_memory() {
    let mesh = read(&binary(b"scan", u32::MAX, &[(UP, CORNERS, 0)])).unwrap();
    assert_eq!(mesh.triangles.len(), 1);
    assert!(mesh.positions.capacity() < 100);
}

#[test]
fn an_empty_binary_file_is_refused_for_having_no_facets() {
    assert!(refusal(&binary(b"scan", 0, &[])).contains("has no triangles"));
}

#[test]
fn viscam_colours_stay_with_their_facets_and_other_facets_have_none() {
    let blue = 0x8000 | 31;
    let mesh =
        read(&binary(b"x", 3, &[(UP, CORNERS, blue), (UP, CORNERS, 31), (UP, CORNERS, 0x8000 | 31 << 10)])).unwrap();
    let color = |t: usize| mesh.colors[mesh.triangles[t][0] as usize];
    assert_eq!((color(0), color(2)), ([0, 0, 255], [255, 0, 0]));
    assert_eq!(color(1), crate::UNCOLOURED);
}

#[test]
fn a_facet_without_a_magics_colour_takes_the_header_colour() {
    let header = b"COLOR=\x0a\x14\x1e\xff";
    let mesh = read(&binary(header, 2, &[(UP, CORNERS, 0x8000), (UP, CORNERS, 31)])).unwrap();
    let color = |t: usize| mesh.colors[mesh.triangles[t][0] as usize];
    assert_eq!((color(0), color(1)), ([10, 20, 30], [255, 0, 0]));
    let all_zero = read(&binary(header, 2, &[(UP, CORNERS, 0); 2])).unwrap();
    assert!(all_zero.colors.iter().all(|c| *c == [10, 20, 30]), "not black");
}

#[test]
fn normals_that_contradict_the_winding_are_counted_and_the_winding_decides() {
    let facets = [UP, -UP, Vec3::ZERO].map(|normal| (normal, CORNERS, 0));
    let mesh = read(&binary(b"x", 3, &facets)).unwrap();
    assert_eq!(mesh.diagnostics.count(CONTRADICTS), 1);
    assert_eq!(mesh.triangles[1], [3, 4, 5]);
    let mesh = text(&format!("solid\n{}endsolid", FACET.replace("0 0 1", "0 0 -1")));
    assert_eq!(mesh.diagnostics.count(CONTRADICTS), 1);
}

#[test]
fn facets_with_corners_that_are_not_finite_are_dropped_and_counted() {
    let bad = [Vec3::new(0.0, f32::NAN, 0.0), CORNERS[1], CORNERS[2]];
    let mesh = read(&binary(b"x", 2, &[(UP, CORNERS, 0), (UP, bad, 0)])).unwrap();
    assert_eq!(mesh.triangles.len(), 1);
    let bad = FACET.replace("vertex 1 0 0", "vertex -1.#IND nan(0x1) inf");
    let mesh = text(&format!("solid\n{FACET}{bad}endsolid"));
    assert_eq!(mesh.triangles.len(), 1);
}

#[test]
fn ascii_stl_with_any_case_spacing_and_line_ends_is_read() {
    let upper = format!("SOLID Thing\r\n{}ENDSOLID Thing\r\n", FACET.to_uppercase().replace('\n', "\r\n"));
    let tabs = format!("\u{feff}solid\t\n\n{}\nendsolid", FACET.replace(' ', "\t  "));
    let one_line = format!("solid a name {}endsolid a name", FACET.replace('\n', " "));
    for file in [upper, tabs, one_line] {
        assert_eq!(text(&file).positions, [DVec3::ZERO, DVec3::X, DVec3::Y], "{file}");
    }
}

#[test]
fn several_solids_with_any_names_are_one_mesh() {
    let file = format!(
        "solid facet\n{FACET}endsolid facet\nsolid normal\nendsolid\nsolid outer loop\n{FACET}endsolid vertex 1\n"
    );
    let mesh = text(&file);
    assert_eq!(mesh.triangles.len(), 2);
    assert_eq!(mesh.diagnostics.iter().count(), 0, "{:?}", mesh.diagnostics);
}

#[test]
fn exponents_and_double_precision_are_preserved() {
    let file = format!("solid\n{}endsolid", FACET.replace("vertex 1 0 0", "vertex +5.310001234567E+05 -1e-3 .5"));
    assert_eq!(text(&file).positions[1], DVec3::new(531_000.123_456_7, -0.001, 0.5));
}

#[test]
fn a_missing_endfacet_and_a_missing_end_are_repaired_and_counted() {
    let file = format!("solid\n{0}{0}", FACET.replace(" endfacet\n", ""));
    let mesh = text(&file);
    assert_eq!(mesh.triangles.len(), 2);
    assert_eq!(mesh.diagnostics.count("facets without endfacet"), 2);
    assert_eq!(mesh.diagnostics.count("solids without an end; the file may be truncated"), 1);
}

#[test]
fn facets_without_exactly_three_corners_become_fans_or_are_dropped() {
    let quad = FACET.replace(" endloop", " vertex -1 1 0\n endloop");
    let two = FACET.replace(" vertex 0 1 0\n", "");
    let mesh = text(&format!("solid\n{quad}{two}endsolid"));
    assert_eq!(mesh.triangles.len(), 2);
    assert_eq!(mesh.positions[3..], [DVec3::ZERO, DVec3::Y, DVec3::Y - DVec3::X]);
    assert_eq!(mesh.diagnostics.count("facets of more than three corners cut as fans"), 1);
    assert_eq!(mesh.diagnostics.count("facets of fewer than three corners dropped"), 1);
}

#[test]
fn text_that_is_not_stl_is_refused_with_its_line() {
    for (from, to, line, found) in [
        ("vertex 1 0 0", "vertex 1,5 0 0", "line 5", "1,5"),
        ("vertex 1 0 0", "vertex 1 0", "line 6", "vertex"),
        (" endloop", "banana endloop", "line 7", "banana"),
    ] {
        let message = refusal(format!("solid\n{}endsolid", FACET.replace(from, to)).as_bytes());
        assert!(message.contains(line) && message.contains(found) && message.contains("a.stl"), "{message}");
    }
    let message = refusal(b"solid\nfacet normal 0 0 1\nouter loop\nvertex 1 2");
    assert!(message.contains("the end of the file"), "{message}");
}

#[test]
fn a_long_file_is_delivered_in_blocks_and_in_order() {
    let facets: Vec<_> =
        (0..40_000u16).map(|i| (UP, CORNERS.map(|c| c + f32::from(i) * Vec3::X), 0x8000 * (i / 1000 % 2))).collect();
    let mesh = read(&binary(b"x", 40_000, &facets)).unwrap();
    assert_eq!(mesh.triangles.len(), 40_000);
    assert!(mesh.triangles.iter().enumerate().all(|(i, t)| mesh.positions[t[0] as usize][0] == i as f64));
}
