//! Properties of the PLY reader.

use super::super::{ReadError, read_mesh, read_mesh_from};
use crate::RawMesh;
use glam::{DVec3, Vec3};
use proptest::prelude::*;
use std::path::Path;

fn read(bytes: &[u8]) -> Result<RawMesh, ReadError> {
    read_mesh_from(std::io::Cursor::new(bytes), bytes.len() as u64, Path::new("scan.ply"), &mut |_, _| {})
}

fn ok(bytes: impl AsRef<[u8]>) -> RawMesh {
    match read(bytes.as_ref()) {
        Ok(mesh) => mesh,
        Err(e) => panic!("refused: {e}"),
    }
}

fn refusal(bytes: impl AsRef<[u8]>) -> String {
    match read(bytes.as_ref()) {
        Ok(mesh) => panic!("read as {mesh:?}"),
        Err(e) => e.to_string(),
    }
}

/// A text PLY of the properties of its vertices and these rows; faces are triangles without further properties.
fn text(properties: &[&str], vertices: &[&str], faces: &[&str]) -> String {
    let properties = properties.iter().fold(String::new(), |all, p| all + "property " + p + "\n");
    let rows = vertices.iter().chain(faces).fold(String::new(), |all, r| all + r + "\n");
    format!(
        "ply\nformat ascii 1.0\nelement vertex {}\n{properties}element face {}\nproperty list uchar int vertex_indices\nend_header\n{rows}",
        vertices.len(),
        faces.len()
    )
}

const XYZ: [&str; 3] = ["float x", "float y", "float z"];
const CORNERS: [&str; 3] = ["0 0 0", "1 0 0", "0 1 0"];
const TRIANGLE: [&str; 1] = ["3 0 1 2"];

fn with_properties(more: &[&str]) -> Vec<String> {
    XYZ.iter().chain(more).map(ToString::to_string).collect()
}

/// A triangle whose three vertices have further properties with these values.
fn attributed(more: &[&str], values: [&str; 3]) -> String {
    let properties = with_properties(more);
    let properties: Vec<&str> = properties.iter().map(String::as_str).collect();
    let rows: Vec<String> = CORNERS.iter().zip(values).map(|(c, v)| format!("{c} {v}")).collect();
    text(&properties, &[&rows[0], &rows[1], &rows[2]], &TRIANGLE)
}

fn places(mesh: &RawMesh, kind: &str) -> Vec<String> {
    mesh.diagnostics.iter().find(|(k, ..)| *k == kind).map(|(_, _, p)| p.to_vec()).unwrap_or_default()
}

// Encodings and headers.

/// The same little mesh in an encoding: a double, a short, a float list to pass over, and two triangles.
fn encoded(encoding: &str, scalar_names: [&str; 4]) -> Vec<u8> {
    let [int16, float64, uint8, int32] = scalar_names;
    let mut bytes = format!(
        "ply\nformat {encoding} 1.0\nelement vertex 4\nproperty {float64} z\nproperty list {uint8} {int16} extra\nproperty {int16} y\nproperty {int16} x\nelement other 2\nproperty {int32} a\nelement face 2\nproperty {uint8} flag\nproperty list {int16} {int32} vertex_index\nproperty {float64} weight\nend_header\n"
    )
    .into_bytes();
    let big = encoding == "binary_big_endian";
    let mut put = |value: f64, name: &str| {
        let mut b = match name {
            _ if encoding == "ascii" => format!("{value} ").into_bytes(),
            n if n == int16 => (value as i16).to_le_bytes().to_vec(),
            n if n == float64 => value.to_le_bytes().to_vec(),
            n if n == int32 => (value as i32).to_le_bytes().to_vec(),
            n if n == uint8 => vec![value as u8],
            // Ends the row.
            _ => Vec::new(),
        };
        if big {
            b.reverse();
        }
        if name.is_empty() && encoding == "ascii" {
            b = b"\n".to_vec();
        }
        bytes.extend(b);
    };
    for i in 0..4i16 {
        put(f64::from(i) * 0.1, float64);
        put(f64::from(i), uint8);
        for k in 0..i {
            put(f64::from(k), int16);
        }
        put(f64::from(i / 2) - 300.0, int16);
        put(f64::from(i % 2), int16);
        put(0.0, "");
    }
    for i in 0..2 {
        put(f64::from(i), int32);
        put(0.0, "");
    }
    for corners in [[0, 1, 2], [2, 1, 3]] {
        put(200.0, uint8);
        put(3.0, int16);
        for c in corners {
            put(f64::from(c), int32);
        }
        put(0.5, float64);
        put(0.0, "");
    }
    bytes
}

#[test]
fn the_three_encodings_give_the_same_mesh() {
    let old = ["short", "double", "uchar", "int"];
    let mesh = ok(encoded("ascii", old));
    assert_eq!(mesh.positions[3], DVec3::new(1.0, -299.0, 3.0 * 0.1));
    assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 3]]);
    for encoding in ["binary_little_endian", "binary_big_endian"] {
        assert_eq!(ok(encoded(encoding, old)), mesh, "{encoding}");
        assert_eq!(ok(encoded(encoding, ["int16", "float64", "uint8", "int32"])), mesh, "{encoding}");
    }
}

#[test]
fn elements_that_are_not_kept_are_named() {
    let mesh = ok(encoded("binary_big_endian", ["short", "double", "uchar", "int"]));
    assert_eq!(places(&mesh, "properties of the vertices not kept"), ["extra"]);
    assert_eq!(places(&mesh, "properties of the faces not kept"), ["flag, weight"]);
    assert_eq!(places(&mesh, "elements of the file not kept"), ["other (2 rows)"]);
    assert_eq!(mesh.diagnostics.count("properties of the faces not kept"), 2);
}

#[test]
fn header_lines_may_end_with_lf_crlf_or_cr() {
    let lf = encoded("binary_little_endian", ["short", "double", "uchar", "int"]);
    let at = lf.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    for end in ["\r\n", "\r"] {
        let header = String::from_utf8(lf[..at].to_vec()).unwrap().replace('\n', end);
        let bytes = [header.as_bytes(), &lf[at..]].concat();
        assert_eq!(ok(bytes), ok(&lf), "{end:?}");
    }
}

#[test]
fn binary_data_that_begin_with_a_line_end_are_read_whole() {
    // 0x0a0a0d0a and 0x0d0a0a0d as the first values, after each kind of header line end.
    for end in ["\n", "\r\n", "\r"] {
        for first in [*b"\n\n\r\n", *b"\r\n\n\r"] {
            let mut bytes = "ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty int x\nproperty int y\nproperty int z\nelement face 1\nproperty list uchar uchar vertex_indices\nend_header\n"
                .replace('\n', end)
                .into_bytes();
            for i in 0..3 {
                bytes.extend(first);
                bytes.extend([i, 0, 0, 0, 0, i, 0, 0]);
            }
            bytes.extend([3, 0, 1, 2]);
            assert_eq!(ok(bytes).positions[0][0], f64::from(i32::from_le_bytes(first)), "{end:?}");
        }
    }
}

#[test]
fn text_may_have_any_line_ends_spaces_blank_lines_comments_and_exponents() {
    let plain = text(&XYZ, &["0 0 0", "100 0 0", "0 0.5 0"], &TRIANGLE);
    let mesh = ok(&plain);
    assert_eq!(ok(plain.replace('\n', "\r\n")), mesh);
    assert_eq!(ok(plain.replace('\n', "\r")), mesh);
    assert_eq!(ok(plain.trim_end()), mesh, "no line end after the last row");
    let spaced = plain.replace("100 0 0", "\n\n \t +1E2   0.0e+00 -0 \t").replace("0 0.5 0", "0 5e-1 0\n");
    assert_eq!(ok(spaced), mesh);
    let commented =
        plain.replace("format", "comment a\nobj_info b\n  format").replace("100 0 0", "comment here\n100 0 0");
    let commented = ok(commented);
    assert_eq!(commented.triangles, mesh.triangles);
    assert_eq!(commented.diagnostics.count("comment lines among the data passed over"), 1);
}

#[test]
fn extra_values_in_a_row_are_skipped_and_counted() {
    let mesh = ok(text(&XYZ, &CORNERS, &["3 0 1 2 255 0 0", "3 2 1 0"]));
    assert_eq!(mesh.triangles.len(), 2);
    assert_eq!(places(&mesh, "lines with more words than the header declares"), ["line 13"]);
}

#[test]
fn rows_beyond_the_declared_ones_are_counted() {
    let mesh = ok(text(&XYZ, &CORNERS, &TRIANGLE) + "3 2 1 0\n3 2 1 0\n");
    assert_eq!(mesh.triangles.len(), 1);
    assert_eq!(mesh.diagnostics.count("lines after the last element ignored"), 2);
    let mut binary = encoded("binary_little_endian", ["short", "double", "uchar", "int"]);
    binary.extend([1, 2, 3]);
    assert_eq!(ok(binary).diagnostics.count("bytes after the last element ignored"), 3);
}

#[test]
fn names_of_texture_images_are_reported() {
    let mesh =
        ok(text(&XYZ, &CORNERS, &TRIANGLE).replace("element vertex", "comment TextureFile wall.jpg\nelement vertex"));
    assert_eq!(places(&mesh, "pictures named in the header not read"), ["wall.jpg"]);
}

#[test]
fn an_invalid_header_is_refused_with_its_line() {
    let good = text(&XYZ, &CORNERS, &TRIANGLE);
    for (from, to, place, expected) in [
        ("ascii 1.0", "ascii 2.0", "line 2", "format ascii 1.0"),
        ("format ascii 1.0\n", "", "line 2", "format line"),
        ("format ascii 1.0\n", "format ascii 1.0\nformat ascii 1.0\n", "line 3", "one format line"),
        ("vertex 3", "vertex three", "line 3", "whole number"),
        ("vertex 3", "vertex -3", "line 3", "whole number"),
        ("vertex 3", "vertex 18446744073709551616", "line 3", "below 2^64"),
        ("float x", "real x", "line 4", "one of the types"),
        ("float x", "float", "line 4", "property TYPE NAME"),
        ("element vertex 3\n", "", "line 3", "element line before"),
        ("list uchar", "list float", "line 8", "integer type"),
        ("uchar int", "uchar float", "line 7", "integer type"),
        ("vertex_indices", "corners", "line 7", "vertex_indices"),
        ("list uchar int", "int", "line 7", "a list"),
        ("float x", "float u", "line 3", "x, y and z"),
        ("float y", "float x\nproperty float y", "line 3", "one"),
        ("end_header", "end_heading", "line 9", "end_header"),
        ("element face", "element vertex 3\nelement face", "line 7", "one"),
    ] {
        let message = refusal(good.replace(from, to));
        assert!(message.contains(&format!("scan.ply, {place}: ")), "{from:?} to {to:?}: {message}");
        assert!(message.contains(expected), "{from:?} to {to:?}: {message}");
    }
    assert!(refusal("ply\nformat ascii 1.0\nelement vertex 3\n").contains("line 4: found the end of the file"));
    assert!(refusal("ply").contains("end of the file"));
}

// Damage.

#[test]
fn counts_larger_than_the_file_are_refused_before_anything_is_allocated() {
    let good = text(&XYZ, &CORNERS, &TRIANGLE);
    let binary = encoded("binary_little_endian", ["short", "double", "uchar", "int"]);
    for count in ["9223372036854775808", "18446744073709551615", "1000000000000", "5000"] {
        for element in ["vertex 3", "face 1"] {
            let name = element.split(' ').next().unwrap();
            let message = refusal(good.replace(element, &format!("{name} {count}")));
            assert!(
                message.contains(count) && message.contains("bytes follow") && message.contains(", line "),
                "{message}"
            );
        }
        for element in ["vertex 4", "other 2", "face 2"] {
            let at = binary.windows(element.len()).position(|w| w == element.as_bytes()).unwrap();
            let name = element.split(' ').next().unwrap();
            let bytes = [&binary[..at], format!("{name} {count}").as_bytes(), &binary[at + element.len()..]].concat();
            assert!(refusal(bytes).contains(count));
        }
    }
}

#[test]
fn a_file_truncated_anywhere_is_refused_with_the_position() {
    for encoding in ["ascii", "binary_little_endian", "binary_big_endian"] {
        let whole = encoded(encoding, ["short", "double", "uchar", "int"]);
        let end = whole.trim_ascii_end().len();
        // From the last line of the header on; before, a shorter word can still be a word.
        let start = whole.windows(10).position(|w| w == b"end_header").unwrap();
        for n in start..whole.len() {
            // In text, a last number can be cut to a shorter number.
            if encoding == "ascii" && n + 3 > end {
                continue;
            }
            let message = refusal(&whole[..n]);
            assert!(message.contains(", line ") || message.contains(", byte "), "{encoding} cut at {n}: {message}");
        }
    }
}

#[test]
fn a_truncated_binary_file_is_refused_with_the_byte_and_the_row() {
    let whole = encoded("binary_little_endian", ["short", "double", "uchar", "int"]);
    let message = refusal(&whole[..whole.len() - 9]);
    let end = whole.len() - 9;
    assert!(message.contains(&format!("byte {end}: found the end of the file in face 1 of 2")), "{message}");
}

#[test]
fn an_index_out_of_range_is_refused_with_its_face_and_line() {
    for index in ["3", "-1", "4294967296", "9223372036854775807"] {
        let message = refusal(text(&XYZ, &CORNERS, &["3 0 1 2", &format!("3 0 {index} 2")]));
        assert!(message.contains("line 14"), "{message}");
        assert!(
            message.contains(&format!("vertex index {index} in face 1")) && message.contains("0 to 2"),
            "{message}"
        );
    }
    let mut binary = encoded("binary_big_endian", ["short", "double", "uchar", "int"]);
    let at = binary.len() - 12;
    binary[at..at + 4].copy_from_slice(&77i32.to_be_bytes());
    assert!(refusal(binary).contains(&format!("byte {at}: found vertex index 77 in face 1")));
}

#[test]
fn values_that_are_not_numbers_are_refused_with_their_line() {
    let message = refusal(text(&XYZ, &["0 0 0", "1,5 0 0", "0 1 0"], &TRIANGLE));
    assert!(
        message.contains("line 11: found \"1,5\" in vertex 1 (property x)") && message.contains("not a comma"),
        "{message}"
    );
    assert!(refusal(text(&XYZ, &CORNERS, &["3 0 1.5 2"])).contains("a whole number"));
    assert!(refusal(text(&XYZ, &CORNERS, &["3 0 1"])).contains("line 13: found the end of the line in face 0 of 1"));
    assert!(refusal(text(&XYZ, &CORNERS, &["-3 0 1 2"])).contains("a list of -3 values"));
    let endless = text(&XYZ, &[&"1".repeat(9000), "1 0 0", "0 1 0"], &TRIANGLE);
    assert!(refusal(endless).contains("4096 characters"));
}

#[test]
fn a_list_longer_than_the_file_is_refused_before_it_is_read() {
    let mut bytes = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty uchar x\nproperty uchar y\nproperty uchar z\nelement face 1\nproperty list uint uint vertex_indices\nend_header\n".to_vec();
    bytes.extend([0, 0, 0, 1, 0, 0, 0, 1, 0]);
    bytes.extend(u32::MAX.to_le_bytes());
    bytes.extend([0; 12]);
    assert!(refusal(&bytes).contains("a list of 4294967295 values"));
    let strips = String::from_utf8_lossy(&bytes).replace("element face", "element tristrips");
    assert!(refusal(strips.as_bytes()).contains("scan.ply"));
}

#[test]
fn a_face_with_too_many_corners_to_triangulate_in_time_is_refused() {
    let corners = "0 1 2 3 ".repeat(2501);
    let message = refusal(text(&XYZ, &["0 0 0", "1 0 0", "1 1 0", "0 1 0"], &[&format!("10004 {corners}")]));
    assert!(message.contains("line 14: found a face of 10004 corners in face 0"), "{message}");
    assert!(message.contains("at most 10000"), "{message}");
}

#[test]
fn files_without_triangles_are_refused_with_what_they_contain() {
    let cloud = refusal(text(&XYZ, &CORNERS, &[]));
    assert!(cloud.contains("has no triangles: it has 3 points") && cloud.contains("Poisson"), "{cloud}");
    assert!(refusal(text(&XYZ, &[], &[])).contains("no vertices"));
    assert!(refusal("ply\nformat ascii 1.0\nend_header\n").contains("no elements at all"));
    let all_dropped = refusal(text(&XYZ, &CORNERS, &["3 0 0 1", "2 0 1"]));
    assert!(all_dropped.contains("of its 2 faces none is left"), "{all_dropped}");
    assert!(all_dropped.contains("triangles that name a vertex twice dropped: 1"), "{all_dropped}");
}

// Repairs.

#[test]
fn vertices_without_a_finite_position_are_dropped_with_their_triangles_and_counted() {
    for bad in ["nan", "inf", "-Infinity", "1e999", "-nan(ind)", "1.#QNAN"] {
        let vertices = ["0 0 0", &format!("0 {bad} 0"), "1 0 0", "0 1 0", "1 1 0"];
        let mesh = ok(text(&XYZ, &vertices, &["3 0 1 2", "3 0 2 3", "3 2 4 3", "4 0 1 4 3"]));
        assert_eq!(mesh.positions, [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::X + DVec3::Y], "{bad}");
        assert_eq!(mesh.triangles, [[0, 1, 2], [1, 3, 2]], "{bad}");
        assert_eq!(mesh.diagnostics.count("vertices without a finite position dropped"), 1);
        assert!(places(&mesh, "vertices without a finite position dropped")[0].starts_with("vertex 1 "));
        assert_eq!(mesh.diagnostics.count("triangles dropped because a corner has no finite position"), 3);
    }
}

#[test]
fn attributes_stay_with_their_vertices_when_others_are_dropped() {
    let properties = with_properties(&["uchar red", "uchar green", "uchar blue", "float quality"]);
    let properties: Vec<&str> = properties.iter().map(String::as_str).collect();
    let rows = ["nan 0 0 9 9 9 9", "0 0 0 1 1 1 1", "1 0 0 2 2 2 2", "0 1 0 3 3 3 3"];
    let mesh = ok(text(&properties, &rows, &["3 1 2 3"]));
    assert_eq!(mesh.colors, [[1; 3], [2; 3], [3; 3]]);
    assert_eq!(mesh.scalars, [("quality".to_owned(), vec![1.0, 2.0, 3.0])]);
}

#[test]
fn degenerate_faces_are_dropped_and_counted() {
    let mesh = ok(text(&XYZ, &CORNERS, &["0", "1 0", "2 0 1", "3 0 1 1", "3 0 1 2", "4 0 0 1 1", "5 0 0 1 2 2"]));
    assert_eq!(mesh.triangles.len(), 2);
    assert_eq!(places(&mesh, "faces of fewer than three corners dropped"), ["face 0", "face 1", "face 2", "face 5"]);
    assert_eq!(places(&mesh, "triangles that name a vertex twice dropped"), ["face 3"]);
}

#[test]
fn unused_vertices_are_kept_and_counted() {
    let mesh = ok(text(&XYZ, &["0 0 0", "5 5 5", "1 0 0", "0 1 0"], &["3 0 2 3"]));
    assert_eq!((mesh.positions.len(), mesh.diagnostics.count("vertices that no triangle uses")), (4, 1));
}

#[test]
fn a_concave_polygon_keeps_its_shape() {
    let arrow = ["0 0 7", "2 1 7", "4 0 7", "2 4 7"];
    let mesh = ok(text(&XYZ, &arrow, &["4 0 1 2 3"]));
    let area = |t: &[u32; 3]| {
        let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
        ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0
    };
    assert!(mesh.triangles.iter().all(|t| area(t) > 0.0));
    assert_eq!(mesh.triangles.iter().map(area).sum::<f64>(), 6.0);
    assert_eq!(places(&mesh, "polygons triangulated"), ["face 0"]);
}

#[test]
fn faces_may_come_before_the_vertices() {
    let usual = text(&XYZ, &["0 0 0", "2 1 0", "4 0 0", "2 4 0"], &["4 0 1 2 3", "3 0 1 2"]);
    let early = "ply\nformat ascii 1.0\nelement face 2\nproperty list uchar int vertex_indices\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nend_header\n4 0 1 2 3\n3 0 1 2\n0 0 0\n2 1 0\n4 0 0\n2 4 0\n";
    let (mut a, mut b) = (ok(usual), ok(early));
    a.triangles.sort_unstable();
    b.triangles.sort_unstable();
    assert_eq!(a, b);
    assert!(refusal(early.replace("3 0 1 2\n0", "3 0 1 4\n0")).contains("vertex index 4 in face 1"));
}

#[test]
fn faces_before_the_vertices_keep_their_colours_and_their_lines() {
    let early = "ply\nformat ascii 1.0\nelement face 2\nproperty list uchar int vertex_indices\nproperty float red\nproperty float green\nproperty float blue\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\nelement other 1\nproperty int a\nend_header\n3 0 1 2 51 0 255\n3 2 1 3 1 2 3\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n7\n";
    let mesh = ok(early);
    assert_eq!(mesh.colors[mesh.triangles[0][0] as usize], [51, 0, 255]);
    assert_eq!(mesh.colors[mesh.triangles[1][2] as usize], [1, 2, 3]);
    let message = refusal(early.replace("3 2 1 3 1", "3 2 1 9 1"));
    assert!(message.contains("line 16: found vertex index 9 in face 1"), "{message}");
    assert!(refusal(early.replace("\n7\n", "\n")).contains("other 0 of 1"), "what follows is read too");
}

#[test]
fn a_triangle_with_an_index_out_of_range_is_refused_anywhere_in_a_block() {
    let n = 20_000u32;
    let good = |big: bool, at: u32, index: u32| {
        let order = if big { "big" } else { "little" };
        let mut bytes = format!("ply\nformat binary_{order}_endian 1.0\nelement vertex 4\nproperty uchar x\nproperty uchar y\nproperty uchar z\nelement face {n}\nproperty list uchar uint vertex_indices\nproperty uchar flag\nend_header\n").into_bytes();
        bytes.extend([0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 1, 0]);
        for i in 0..n {
            bytes.push(3);
            for v in [i % 2, 2, if i == at { index } else { 3 }] {
                bytes.extend(if big { v.to_be_bytes() } else { v.to_le_bytes() });
            }
            bytes.push(7);
        }
        bytes
    };
    for big in [false, true] {
        assert_eq!(ok(good(big, n, 0)).triangles.len(), n as usize);
        assert_eq!(ok(good(big, 9_999, 2)).diagnostics.count("triangles that name a vertex twice dropped"), 1);
        for at in [0, 9_999, n - 1] {
            for index in [4, u32::MAX] {
                let message = refusal(good(big, at, index));
                assert!(message.contains(&format!("vertex index {index} in face {at}")), "{message}");
            }
        }
    }
}

#[test]
fn strips_flip_every_other_triangle_and_restart_after_minus_one() {
    let strips = |kind: &str, row: &str| {
        format!(
            "ply\nformat ascii 1.0\nelement vertex 5\nproperty float x\nproperty float y\nproperty float z\nelement tristrips 1\nproperty list int {kind} vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 2 0\n{row}\n"
        )
    };
    let mesh = ok(strips("int", "9 0 1 2 3 4 -1 0 1 2"));
    assert_eq!(mesh.triangles, [[0, 1, 2], [2, 1, 3], [2, 3, 4], [0, 1, 2]]);
    // For unsigned types all bits set restart the strip; empty triangles join strips and keep the orientation.
    assert_eq!(ok(strips("uint", "9 0 1 2 3 4 4294967295 0 1 2")).triangles, mesh.triangles);
    let joined = ok(strips("int", "8 0 1 2 2 1 1 3 2"));
    assert_eq!(joined.triangles, [[0, 1, 2], [3, 1, 2]]);
    assert_eq!(joined.diagnostics.count("empty triangles that join strips dropped"), 4);
    assert!(refusal(strips("int", "3 0 1 5")).contains("vertex index 5 in tristrips 0"));
    assert!(refusal(strips("int", "3 0 1 -2")).contains("vertex index -2"));
}

// Colours and other attributes.

#[test]
fn colours_of_every_type_give_the_same_result() {
    let expected = [[0, 51, 255], [204, 102, 1], [255, 255, 255]];
    let eight = ["0 51 255", "204 102 1", "255 255 255"];
    let sixteen = ["0 13107 65535", "52428 26214 257", "65535 65535 65535"];
    let unit = ["0 0.2 1", "0.8 0.4 0.00392156862745098", "1 1 1"];
    for (kind, values) in [
        ("uchar", eight),
        ("uint8", eight),
        ("short", eight),
        ("int", eight),
        ("ushort", eight),
        ("float", eight),
        ("ushort", sixteen),
        ("uint16", sixteen),
        ("float", unit),
        ("double", unit),
    ] {
        for names in [
            ["red", "green", "blue"],
            ["diffuse_red", "diffuse_green", "diffuse_blue"],
            ["r", "g", "b"],
            ["Red", "Green", "Blue"],
        ] {
            let properties = names.map(|n| format!("{kind} {n}"));
            let properties: Vec<&str> = properties.iter().map(String::as_str).collect();
            let mesh = ok(attributed(&properties, values));
            assert_eq!(mesh.colors, expected, "{kind} {names:?}");
            assert_eq!(mesh.diagnostics.count("colours rounded to 8 bits"), 0, "{kind}");
            assert_eq!(mesh.diagnostics.count("colours outside their range clamped"), 0, "{kind}");
        }
    }
}

#[test]
fn colours_that_eight_bits_cannot_hold_are_counted() {
    let rgb = |kind: &str| [format!("{kind} red"), format!("{kind} green"), format!("{kind} blue")];
    let read = |kind: &str, values: [&str; 3]| {
        let properties = rgb(kind);
        ok(attributed(&properties.iter().map(String::as_str).collect::<Vec<_>>(), values))
    };
    let mesh = read("float", ["0.5 0 0", "1 1 1", "0.001 0 0"]);
    assert_eq!((mesh.colors[0][0], mesh.diagnostics.count("colours rounded to 8 bits")), (128, 2));
    let mesh = read("float", ["1.5 -0.2 0", "nan 1 1", "0 0 0"]);
    assert_eq!((mesh.colors[0], mesh.colors[1]), ([255, 0, 0], [0, 255, 255]));
    assert_eq!(mesh.diagnostics.count("colours outside their range clamped"), 2);
    let mesh = read("uchar", ["300 -5 12.4", "0 0 0", "0 0 0"]);
    assert_eq!(mesh.colors[0], [255, 0, 12]);
    assert_eq!(mesh.diagnostics.count("colours outside their range clamped"), 2);
    assert_eq!(mesh.diagnostics.count("colours rounded to 8 bits"), 1);
}

#[test]
fn a_mesh_with_two_of_three_colour_properties_has_no_colour() {
    let mesh = ok(attributed(&["uchar red", "uchar green"], ["1 2", "3 4", "5 6"]));
    assert!(mesh.colors.is_empty());
    assert_eq!(places(&mesh, "properties of the vertices not kept"), ["red, green"]);
    let mixed = refusal(attributed(&["uchar red", "uchar green", "float blue"], ["1 2 0", "3 4 0", "5 6 0"]));
    assert!(mixed.contains("different types"), "{mixed}");
}

#[test]
fn alpha_that_is_not_opaque_is_a_channel_from_0_to_1() {
    let properties = ["uchar red", "uchar green", "uchar blue", "uchar alpha"];
    let opaque = ok(attributed(&properties, ["1 2 3 255", "1 2 3 255", "1 2 3 255"]));
    assert!(opaque.scalars.is_empty());
    let glass = ok(attributed(&properties, ["1 2 3 255", "1 2 3 51", "1 2 3 0"]));
    assert_eq!(glass.scalars, [("alpha".to_owned(), vec![1.0, 0.2, 0.0])]);
}

#[test]
fn normals_of_any_type_are_kept_as_given() {
    let mesh = ok(attributed(&["char nx", "char ny", "char nz"], ["0 0 127", "0 -127 0", "64 0 0"]));
    assert_eq!(mesh.normals, [127.0 * Vec3::Z, -127.0 * Vec3::Y, 64.0 * Vec3::X]);
    let mesh = ok(attributed(&["float nx", "float ny", "float nz"], ["0 0 nan", "0 1 0", "1 0 0"]));
    assert_eq!((mesh.normals[0], mesh.diagnostics.count("normals that are not finite set to zero")), (Vec3::ZERO, 1));
}

#[test]
fn scan_channels_are_kept_under_their_names() {
    let properties =
        ["float confidence", "uchar quality", "double intensity", "int value", "float scalar_C2C_distance", "float u"];
    let mesh = ok(attributed(&properties, ["0.5 1 2.5 -3 0.25 9", "1 2 3.5 -4 nan 9", "1 2 3.5 -4 0.5 9"]));
    let names: Vec<&str> = mesh.scalars.iter().map(|(n, _)| n.as_str()).collect();
    assert_eq!(names, ["confidence", "quality", "intensity", "value", "scalar_C2C_distance"]);
    assert_eq!(mesh.scalars[2].1, [2.5, 3.5, 3.5]);
    assert!(mesh.scalars[4].1[1].is_nan(), "no value is a value of a scalar field");
    assert_eq!(places(&mesh, "channels narrowed to 32-bit floats"), ["intensity", "value"]);
    assert_eq!(places(&mesh, "properties of the vertices not kept"), ["u"]);
}

#[test]
fn as_many_channels_are_kept_as_a_pack_can_hold() {
    let names: Vec<String> = (0..20).map(|i| format!("float scalar_{i}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let row = "1 ".repeat(20);
    let mesh = ok(attributed(&names, [&row, &row, &row]));
    assert_eq!(mesh.scalars.len(), 16);
    assert_eq!(places(&mesh, "properties of the vertices not kept"), ["scalar_16, scalar_17, scalar_18, scalar_19"]);
    let with_alpha: Vec<&str> =
        ["uchar red", "uchar green", "uchar blue", "uchar alpha"].into_iter().chain(names).collect();
    let row = format!("1 2 3 4 {row}");
    let mesh = ok(attributed(&with_alpha, [&row, &row.replace("3 4", "3 5"), &row]));
    assert_eq!((mesh.scalars.len(), mesh.scalars[15].0.as_str()), (16, "alpha"));
}

/// Two triangles over an edge, with a colour per face.
fn face_colored(vertex_properties: &[&str], tail: &str, colors: [&str; 2]) -> String {
    let properties = with_properties(vertex_properties);
    let properties: Vec<&str> = properties.iter().map(String::as_str).collect();
    let rows = ["0 0 0", "1 0 0", "0 1 0", "1 1 0"].map(|r| format!("{r}{tail}"));
    let faces = [format!("3 0 1 2 {}", colors[0]), format!("3 2 1 3 {}", colors[1])];
    text(&properties, &[&rows[0], &rows[1], &rows[2], &rows[3]], &[&faces[0], &faces[1]])
        .replace("vertex_indices\n", "vertex_indices\nproperty uchar red\nproperty uchar green\nproperty uchar blue\n")
}

#[test]
fn faces_keep_their_colours_by_splitting_vertices_only_where_colours_meet() {
    let same = ok(face_colored(&["float quality"], " 5", ["1 2 3", "1 2 3"]));
    assert_eq!((same.positions.len(), same.colors.as_slice()), (4, &[[1, 2, 3]; 4][..]));
    let two = ok(face_colored(&["float quality"], " 5", ["1 2 3", "4 5 6"]));
    assert_eq!(two.positions.len(), 6);
    assert_eq!(two.scalars[0].1, [5.0; 6]);
    for (triangle, color) in two.triangles.iter().zip([[1, 2, 3], [4, 5, 6]]) {
        assert!(triangle.iter().all(|&i| two.colors[i as usize] == color));
    }
    let corner = |t: usize, k: usize| two.positions[two.triangles[t][k] as usize];
    assert_eq!((corner(1, 0), corner(1, 1), corner(1, 2)), (DVec3::Y, DVec3::X, DVec3::X + DVec3::Y));
    assert_eq!(two.diagnostics.count("vertices split so that faces keep their colours"), 2);
}

#[test]
fn vertex_colours_take_precedence_over_face_colours() {
    let mesh = ok(face_colored(&["uchar red", "uchar green", "uchar blue"], " 7 8 9", ["1 2 3", "4 5 6"]));
    assert_eq!(mesh.colors, [[7, 8, 9]; 4]);
    assert_eq!(places(&mesh, "properties of the faces not kept"), ["red, green, blue"]);
}

#[test]
fn doubles_keep_their_precision() {
    let mesh = ok(text(
        &["double x", "double y", "double z"],
        &["500000.000123456 9000000.000654321 -3.5", "1 0 0", "0 1 0"],
        &TRIANGLE,
    ));
    assert_eq!(mesh.positions[0], DVec3::new(500_000.000_123_456, 9_000_000.000_654_321, -3.5));
}

// Files.

#[test]
fn the_file_name_does_not_matter_and_progress_reaches_the_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("WALL.PLY");
    let bytes = text(&XYZ, &CORNERS, &TRIANGLE);
    std::fs::write(&path, &bytes).unwrap();
    let mut calls = Vec::new();
    read_mesh(&path, &mut |done, all| calls.push((done, all))).unwrap();
    let all = bytes.len() as u64;
    assert!(calls.iter().all(|&(done, total)| done <= total && total == all));
    assert_eq!(calls.last(), Some(&(all, all)));
    let other = folder.path().join("wall.obj");
    std::fs::rename(&path, &other).unwrap();
    assert!(read_mesh(&other, &mut |_, _| {}).is_ok());
}

#[test]
fn missing_files_and_folders_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let missing = read_mesh(&folder.path().join("no.ply"), &mut |_, _| {}).unwrap_err();
    assert!(missing.to_string().contains("no.ply cannot be opened"), "{missing}");
    let folder = read_mesh(folder.path(), &mut |_, _| {}).unwrap_err();
    assert!(folder.to_string().contains("is a folder"), "{folder}");
}

/// Delivers its bytes in pieces of odd sizes, as a slow disk or a network mount may.
struct Crumbs<'b>(std::io::Cursor<&'b [u8]>, usize);

impl std::io::Read for Crumbs<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        self.1 = self.1 % 7 + 1;
        let n = self.1.min(buffer.len());
        self.0.read(&mut buffer[..n])
    }
}

impl std::io::Seek for Crumbs<'_> {
    fn seek(&mut self, to: std::io::SeekFrom) -> std::io::Result<u64> {
        self.0.seek(to)
    }
}

proptest! {
    #[test]
    fn pieces_of_any_size_give_the_same_mesh(encoding in 0usize..3, start in 0usize..7) {
        let bytes = encoded(["ascii", "binary_little_endian", "binary_big_endian"][encoding], ["short", "double", "uchar", "int"]);
        let total = bytes.len() as u64;
        let mesh = read_mesh_from(Crumbs(std::io::Cursor::new(&bytes), start), total, Path::new("scan.ply"), &mut |_, _| {}).unwrap();
        prop_assert_eq!(mesh, ok(&bytes));
    }

    /// A random soup written in all three encodings, larger than a block and than the buffer, comes back exactly.
    #[test]
    fn a_written_file_reads_back_unchanged(seed in any::<u64>(), n in 3u32..6000) {
        let mut generator = fastrand::Rng::with_seed(seed);
        let mut random = || generator.u64(..);
        let positions: Vec<Vec3> = (0..n).map(|_| Vec3::new(random() as i32 as f32 * 1e-3, random() as i32 as f32, 0.25)).collect();
        let colors: Vec<[u8; 3]> = (0..n).map(|_| [random() as u8, random() as u8, random() as u8]).collect();
        let triangles: Vec<[u32; 3]> = (0..2 * n).map(|_| { let a = random() as u32 % (n - 2); [a, a + 1, a + 2] }).collect();
        let header = |e: &str| format!("ply\nformat {e} 1.0\nelement vertex {n}\nproperty float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face {}\nproperty list uchar int vertex_indices\nend_header\n", 2 * n).into_bytes();
        let (mut ascii, mut little, mut big) = (header("ascii"), header("binary_little_endian"), header("binary_big_endian"));
        for (p, c) in positions.iter().zip(&colors) {
            ascii.extend(format!("{} {} {} {} {} {}\n", p[0], p[1], p[2], c[0], c[1], c[2]).bytes());
            for v in p.to_array() { little.extend(v.to_le_bytes()); big.extend(v.to_be_bytes()); }
            little.extend(c);
            big.extend(c);
        }
        for t in &triangles {
            ascii.extend(format!("3 {} {} {}\n", t[0], t[1], t[2]).bytes());
            little.push(3);
            big.push(3);
            for v in t { little.extend(v.to_le_bytes()); big.extend(v.to_be_bytes()); }
        }
        let expected: Vec<DVec3> = positions.iter().map(|p| p.as_dvec3()).collect();
        for bytes in [ascii, little, big] {
            let mesh = ok(bytes);
            // Text is read as doubles, whatever type the header gives it: nothing that is written is lost.
            let positions: Vec<DVec3> = mesh.positions.iter().map(|p| p.as_vec3().as_dvec3()).collect();
            prop_assert_eq!(&positions, &expected);
            prop_assert_eq!(&mesh.colors, &colors);
            prop_assert_eq!(&mesh.triangles, &triangles);
        }
    }
}
