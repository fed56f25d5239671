//! Properties of the OBJ reader.

use crate::RawMesh;
use crate::read::texture::detail::Detail;
use crate::read::{MemorySink, ReadError, ReadOptions, note_detail, read_into_with, read_mesh, read_mesh_from};
use glam::{DVec3, Vec3};
use std::collections::BTreeMap;
use std::fmt::Write;
use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

fn read(text: &str) -> Result<RawMesh, ReadError> {
    read_mesh_from(Cursor::new(text), text.len() as u64, Path::new("scan.obj"), &mut |_, _| {})
}

fn ok(text: &str) -> RawMesh {
    read(text).unwrap_or_else(|e| panic!("refused: {e}"))
}

fn refusal(text: &str) -> String {
    match read(text) {
        Ok(mesh) => panic!("read as {mesh:?}"),
        Err(e) => e.to_string(),
    }
}

fn places(mesh: &RawMesh, kind: &str) -> Vec<String> {
    mesh.diagnostics.iter().find(|(k, ..)| *k == kind).map(|(_, _, p)| p.to_vec()).unwrap_or_default()
}

const SQUARE: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

/// Corners of all triangles with what they have, in an order of their own: what a mesh is, however it is indexed.
fn soup(mesh: &RawMesh) -> Vec<[(String, [u8; 3]); 3]> {
    let corner = |&v: &u32| {
        let v = v as usize;
        let normal = mesh.normals.get(v).copied().unwrap_or_default();
        (format!("{:?} {normal:?}", mesh.positions[v]), mesh.colors.get(v).copied().unwrap_or_default())
    };
    let mut all: Vec<_> = mesh.triangles.iter().map(|t| [corner(&t[0]), corner(&t[1]), corner(&t[2])]).collect();
    all.sort();
    all
}

// Text.

#[test]
fn line_ends_comments_blanks_continuations_and_a_byte_order_mark_change_nothing() {
    let mesh = ok(&format!("{SQUARE}f 1 2 3\nf 1 3 4\n"));
    assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    let plain = format!("{SQUARE}f 1 2 3\nf 1 3 4");
    for text in [
        plain.clone(),
        plain.replace('\n', "\r\n"),
        plain.replace('\n', "\r"),
        format!("\u{feff}# made by hand\n\n{plain}\n\n"),
        plain.replace("f 1 2 3", "f 1 \\\n 2 \\\r\n3"),
        plain.replace("1 0 0", "\t+1.0e0   0 0.00  # a corner").replace("f 1 2 3", "  f 1 2 3 # a face"),
        format!("o wall\ng a b\ns off\n{plain}"),
    ] {
        assert_eq!(ok(&text), mesh, "{text:?}");
    }
}

#[test]
fn lines_are_numbered_as_an_editor_numbers_them() {
    for (text, line) in [
        (format!("{SQUARE}f 1 2 x\n"), 5),
        (format!("{SQUARE}f 1 \\\n2 \\\n3\nf 1 2 9\n"), 8),
        (format!("# a\r\n\r\n{SQUARE}f 1 2 \\\r\n 9"), 7),
    ] {
        let message = refusal(&text);
        assert!(message.contains(&format!("scan.obj, line {line}: ")), "{message}");
    }
}

#[test]
fn invalid_lines_are_refused_with_what_was_expected() {
    for (line, found, expected) in [
        ("v 1 2", "a vertex of 2 numbers", "x, y and z"),
        ("v 1 2,5 3", "2,5", "not a comma"),
        ("f 1 2 5", "vertex index 5", "1 to 4 or -1 to -4"),
        ("f 0 1 2", "vertex index 0", "1 to 4"),
        ("f -5 1 2", "vertex index -5", "-1 to -4"),
        ("f 1 2 99999999999999999999", "99999999999999999999", "1/2/3"),
        ("f a b c", "\"a\"", "1/2/3"),
        ("f /1 /2 /3", "\"/1\"", "names a vertex"),
        ("f 1/x 2 3", "1/x", "1/2/3"),
    ] {
        let message = refusal(&format!("{SQUARE}{line}\nf 1 2 3\n"));
        let has_all = message.contains("line 5: ") && message.contains(found) && message.contains(expected);
        assert!(has_all, "{line}: {message}");
    }
    let endless = refusal(&format!("{SQUARE}f {}\n", "1 ".repeat(1 << 20)));
    assert!(endless.contains("a line of more than"), "{endless}");
    let many = refusal(&format!("{SQUARE}f {}\n", "1 2 3 ".repeat(4000)));
    assert!(many.contains("12000 corners"), "{many}");
}

#[test]
fn a_file_without_faces_is_refused_with_what_it_contains() {
    assert!(refusal(SQUARE).contains("4 points and no faces"));
    assert!(refusal("o nothing\n").contains("no vertices and no faces"));
    assert!(refusal("f 1 2 3\n").contains("1 face and no vertices"));
    let curves = refusal(&format!("{SQUARE}cstype bspline\ndeg 3\ncurv 0 1 1 2 3 4\nend\nl 1 2\n"));
    assert!(curves.contains("2 lines, points or free-form elements"), "{curves}");
    assert!(refusal(&format!("{SQUARE}f 1 1 2\nf 1 2\n")).contains("of its 2 faces none is left"));
}

// Faces.

#[test]
fn corners_of_every_form_and_negative_indices_name_the_same_vertices() {
    let expected = ok(&format!("{SQUARE}f 1 2 3\n"));
    let extra = "vt 0 0\nvt 1 0\nvn 0 0 1\n";
    for face in ["f 1/1 2/2 3/1", "f 1/ 2/ 3/", "f -4 -3 -2", "f 1.0 2.0 3.0"] {
        let mesh = ok(&format!("{SQUARE}{extra}{face}\n"));
        assert_eq!(
            (mesh.positions, mesh.triangles),
            (expected.positions.clone(), expected.triangles.clone()),
            "{face}"
        );
    }
    for face in ["f 1//1 2//1 3//-1", "f 1/1/1 2/2/1 3//1"] {
        let mesh = ok(&format!("{SQUARE}{extra}{face}\n"));
        assert_eq!(mesh.positions, expected.positions[..3]);
        assert_eq!(mesh.normals, [Vec3::Z; 3]);
    }
    // Negative indices count back from the line they are on.
    let two = ok("v 9 9 9\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf -3 -2 -1\nv 5 5 5\nv 6 5 5\nv 5 6 5\nf -3 -2 -1\n");
    assert_eq!(two.triangles, [[1, 2, 3], [4, 5, 6]]);
}

#[test]
fn texture_coordinates_and_normals_that_do_not_exist_are_counted_and_left_out() {
    let mesh = ok(&format!("{SQUARE}vn 0 0 1\nf 1/7/1 2/8/1 3/9/2\n"));
    assert_eq!(mesh.triangles.len(), 1);
    let kind = "texture coordinates and normals named by faces that do not exist";
    assert_eq!(mesh.diagnostics.count(kind), 4);
}

#[test]
fn polygons_keep_their_surface_whether_their_corners_have_normals_or_not() {
    let arrow = "v 0 0 7\nv 2 1 7\nv 4 0 7\nv 2 4 7\nvn 0 0 1\n";
    for face in ["f 1 2 3 4", "f 1//1 2//1 3//1 4//1", "f 1 2 2 3 4 1"] {
        let mesh = ok(&format!("{arrow}{face}\n"));
        let area = |t: &[u32; 3]| {
            let [a, b, c] = t.map(|i| mesh.positions[i as usize]);
            ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0
        };
        assert!(mesh.triangles.iter().all(|t| area(t) > 0.0), "{face}");
        assert_eq!(mesh.triangles.iter().map(area).sum::<f64>(), 6.0);
        assert_eq!(places(&mesh, "polygons triangulated"), ["line 6"]);
    }
}

#[test]
fn a_triangle_may_come_before_its_vertices_and_a_polygon_may_not() {
    let mesh = ok(&format!("f 1 2 3\n{SQUARE}"));
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    let message = refusal(&format!("v 0 0 0\nf 1 2 3 4\n{SQUARE}"));
    assert!(message.contains("line 2") && message.contains("vertex 2, which comes after it"), "{message}");
}

#[test]
fn degenerate_faces_are_dropped_and_counted_with_their_line() {
    for normal in ["", "//1"] {
        let rows = ["1 2", "1 1 2", "1 2 3", "1 1 2 2"]
            .map(|row| row.split(' ').fold("f".to_owned(), |line, v| line + " " + v + normal));
        let mesh = ok(&format!("{SQUARE}vn 0 0 1\n{}\n", rows.join("\n")));
        assert_eq!(mesh.triangles.len(), 1);
        assert_eq!(places(&mesh, "faces of fewer than three corners dropped"), ["line 6", "line 9"]);
        assert_eq!(places(&mesh, "triangles that name a vertex twice dropped"), ["line 7"]);
    }
}

#[test]
fn vertices_that_are_not_finite_are_dropped_with_their_triangles() {
    for normal in ["", "//1"] {
        let faces = ["1 2 3", "1 3 4", "1 2 3 4"]
            .map(|row| row.split(' ').fold("f".to_owned(), |line, v| line + " " + v + normal));
        let mesh = ok(&format!("v 0 0 0\nv nan 0 0\nv 1 1 0\nv 0 1 0\nvn 0 0 1\n{}\n", faces.join("\n")));
        assert_eq!(mesh.triangles.len(), 1);
        assert_eq!(mesh.diagnostics.count("triangles dropped because a corner has no finite position"), 3);
    }
}

#[test]
fn unsupported_statements_are_counted_with_their_line() {
    let mesh = ok(&format!("{SQUARE}l 1 2\np 1\ncurv 0 1 1 2\nlod 3\nwhatever 1\nv 0 0 0 2\nf 1 2 3\n"));
    assert_eq!(places(&mesh, "lines (l) not kept"), ["line 5"]);
    assert_eq!(places(&mesh, "points (p) not kept"), ["line 6"]);
    assert_eq!(places(&mesh, "free-form curves and surfaces not kept"), ["line 7"]);
    assert_eq!(places(&mesh, "statements about display not kept"), ["line 8"]);
    assert_eq!(places(&mesh, "lines that begin with an unknown word passed over"), ["line 9"]);
    assert_eq!(places(&mesh, "weights (w) of vertices not kept"), ["line 10"]);
}

// Attributes.

#[test]
fn vertex_colours_range_to_1_or_to_255() {
    let expected = [[255, 0, 51], [0, 255, 0], [0, 0, 255]];
    let faces = ["f 1 2 3\n", "vn 0 0 1\nf 1//1 2//1 3//1\n"];
    for face in faces {
        let unit = ok(&format!("v 0 0 0 1 0 0.2\nv 1 0 0 0 1 0\nv 0 1 0 1.0 0 0 1\n{face}"));
        assert_eq!(unit.colors, expected, "{face}");
        let bytes = ok(&format!("v 0 0 0 255 0 51\nv 1 0 0 0 255 0\nv 0 1 0 0 0 255\n{face}"));
        assert_eq!(bytes.colors, expected);
        assert_eq!(bytes.diagnostics.count("colours rounded to 8 bits"), 0);
    }
    let grey = ok("v 0 0 0 1 0 0\nv 1 0 0\nv 0 1 0 0 0 1\nf 1 2 3\n");
    assert_eq!(grey.diagnostics.count("vertices without colour beside coloured ones, shown grey"), 1);
}

#[test]
fn corner_normals_create_wedges_only_where_they_differ() {
    let roof = "v 0 0 0\nv 1 0 0\nv 0 1 1\nv 0 -1 1\nvn 0 1 1\nvn 0 -1 1\n";
    let sharp = ok(&format!("{roof}f 1//1 2//1 3//1\nf 2//2 1//2 4//2\n"));
    assert_eq!(sharp.positions.len(), 6);
    let smooth = ok(&format!("{roof}f 1//1 2//1 3//1\nf 2//1 1//1 4//1\n"));
    assert_eq!(smooth.positions.len(), 4);
    assert_eq!(smooth.triangles, [[0, 1, 2], [1, 0, 3]]);
}

/// A folder with these files; reads `a.obj` in it.
fn in_folder(files: &[(&str, &[u8])]) -> RawMesh {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
    }
    read_mesh(&folder.path().join("a.obj"), &mut |_, _| {}).unwrap()
}

#[test]
fn faces_take_the_diffuse_colour_of_their_material_if_vertices_have_none() {
    let mtl = b"newmtl brick red\nKd 1 0 0.2\nnewmtl glass\nNs 10\n";
    let faces = "mtllib my lib.mtl\nf 1 2 3\nusemtl brick red\nf 1 3 4\nusemtl glass\nf 1 2 4\nusemtl lost\nf 2 3 4\n";
    let colour_of = |mesh: &RawMesh, corner: DVec3| {
        let red = mesh.colors.iter().zip(&mesh.positions).filter(|(c, p)| **c == [255, 0, 51] && **p == corner);
        red.count()
    };
    for normals in ["", "vn 0 0 1\n"] {
        let faces = if normals.is_empty() { faces.to_owned() } else { faces.replace("f 1 2 3", "f 1//1 2//1 3//1") };
        let obj = format!("{SQUARE}{normals}{faces}");
        let mesh = in_folder(&[("a.obj", obj.as_bytes()), ("My Lib.MTL", mtl)]);
        assert_eq!(mesh.triangles.len(), 4);
        let red = |t: &&[u32; 3]| t.iter().all(|&v| mesh.colors[v as usize] == [255, 0, 51]);
        assert_eq!(mesh.triangles.iter().filter(red).count(), 1, "{normals:?}");
        assert_eq!(colour_of(&mesh, DVec3::X), 0);
        assert_eq!(places(&mesh, "materials that no library defines, left out"), ["lost"]);
    }
    let coloured = SQUARE.replace(" 0\n", " 0 0 1 0\n");
    let mesh = in_folder(&[("a.obj", format!("{coloured}{faces}").as_bytes()), ("my lib.mtl", mtl)]);
    assert!(mesh.colors.iter().all(|c| *c == [0, 255, 0]), "colours of vertices come first");
}

#[test]
fn a_missing_library_is_counted_and_the_mesh_is_read() {
    let mesh = in_folder(&[("a.obj", format!("mtllib gone.mtl\n{SQUARE}usemtl a\nf 1 2 3\n").as_bytes())]);
    assert!(mesh.colors.is_empty());
    assert_eq!(places(&mesh, "material libraries that are missing; colours and pictures are left out"), ["gone.mtl"]);
}

fn png(width: u32, height: u32, color: impl Fn(u32, u32) -> [u8; 3]) -> Vec<u8> {
    let picture = image::RgbImage::from_fn(width, height, |x, y| image::Rgb(color(x, y)));
    let mut bytes = Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

#[test]
fn a_texture_colours_the_corners_with_v_upwards_and_a_seam_creates_wedges() {
    let colors = [[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]];
    let picture = png(2, 2, |x, y| colors[y as usize][x as usize]);
    let mtl = b"newmtl wall\nKd 0 0 0\nmap_Kd -s 1 1 1 maps\\The Wall.PNG\n";
    // Two triangles that share an edge in space and not in the picture.
    let obj = format!(
        "mtllib a.mtl\n{SQUARE}vt 0.25 0.75\nvt 0.75 0.75\nvt 0.25 0.25\nvt 0.75 0.25\nusemtl wall\nf 1/1 2/2 3/4\nf 1/3 3/3 4/3\n"
    );
    let mesh = in_folder(&[("a.obj", obj.as_bytes()), ("a.mtl", mtl), ("the wall.png", &picture)]);
    let of = |t: usize| mesh.triangles[t].map(|v| mesh.colors[v as usize]);
    assert_eq!(of(0), [[255, 0, 0], [0, 255, 0], [255, 255, 255]]);
    assert_eq!(of(1), [[0, 0, 255]; 3]);
    assert_eq!(mesh.positions.len(), 6, "a wedge for each texture coordinate");
}

#[test]
fn a_missing_or_damaged_image_is_counted_once_with_the_reason() {
    let obj = format!("mtllib a.mtl\n{SQUARE}vt 0 0\nusemtl a\nf 1/1 2/1 3/1\nusemtl b\nf 1/1 3/1 4/1\n");
    let mtl = b"newmtl a\nmap_Kd gone.jpg\nnewmtl b\nmap_Kd bad.png\n";
    let mesh = in_folder(&[("a.obj", obj.as_bytes()), ("a.mtl", mtl), ("bad.png", b"\x89PNG nothing")]);
    assert_eq!(mesh.triangles.len(), 2);
    let reported = places(&mesh, "pictures left out");
    assert!(
        reported.len() == 2 && reported[0].contains("gone.jpg: it is missing") && reported[1].contains("bad.png: "),
        "{reported:?}"
    );
}

#[test]
fn triangles_are_split_until_no_edge_spans_more_texels_and_the_colours_follow_the_picture() {
    let picture = png(64, 64, |x, y| [(4 * x) as u8, (4 * y) as u8, 0]);
    let mtl = b"newmtl wall\nmap_Kd a.png\nnewmtl bare\nKd 0 0 1\n";
    // A square with the picture, beside it a triangle without, and a roof over both edges whose corners have normals.
    let obj = format!(
        "mtllib a.mtl\n{SQUARE}v 2 0.5 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl wall\nf 1/1 2/2 3/3 4/4\nusemtl bare\nf 2/1 5/1 3/1\n"
    );
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.obj");
    std::fs::write(&path, obj).unwrap();
    std::fs::write(folder.path().join("a.mtl"), mtl).unwrap();
    std::fs::write(folder.path().join("a.png"), picture).unwrap();
    let options = ReadOptions { detail: Some(Arc::new(Detail::new(8.0))), ..ReadOptions::default() };
    note_detail(&path, &options, &mut |_, _| {}).unwrap();
    let mut sink = MemorySink::new(&path);
    read_into_with(&path, &options, &mut sink, &mut |_, _| {}).unwrap();
    let mesh = sink.into_mesh().unwrap();

    let mut edges: BTreeMap<[[u64; 3]; 2], i64> = BTreeMap::new();
    let mut area = 0.0;
    for t in &mesh.triangles {
        let [a, b, c] = t.map(|v| mesh.positions[v as usize]);
        area += ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0;
        for (p, q) in [(a, b), (b, c), (c, a)] {
            // In the square a texel is a 64th.
            if p[0].max(q[0]) <= 1.0 {
                assert!((p[0] - q[0]).hypot(p[1] - q[1]) * 64.0 <= 8.0 + 1e-9);
            }
            let [p, q] = [p, q].map(|p| p.to_array().map(f64::to_bits));
            *edges.entry(if p < q { [p, q] } else { [q, p] }).or_default() += if p < q { 1 } else { -1 };
        }
    }
    assert!((area - 1.5).abs() < 1e-12, "the surface is the same");
    // Three open sides of the square in 8 parts, and two of the triangle whole: nothing is open between the two.
    assert_eq!(edges.values().filter(|n| **n != 0).count(), 3 * 8 + 2);
    for (p, c) in mesh.positions.iter().zip(&mesh.colors).filter(|(_, c)| c[2] == 0) {
        let expected = [p[0] * 64.0 - 0.5, (1.0 - p[1]) * 64.0 - 0.5].map(|texel| texel * 4.0);
        if p[0] > 0.01 && p[0] < 0.99 && p[1] > 0.01 && p[1] < 0.99 {
            assert!((0..2).all(|i| (f64::from(c[i]) - expected[i]).abs() <= 2.0), "{p:?} {c:?} {expected:?}");
        }
    }
    assert!(mesh.colors.contains(&[0, 0, 255]));
}

#[test]
fn corners_evicted_from_the_cache_are_duplicated_and_the_mesh_is_unchanged() {
    // A strip with more corners than the cache holds, in an order that revisits each edge late.
    let n = 3000;
    let mut obj = "vn 0 0 1\n".to_owned();
    for i in 0..=n {
        let _ = write!(obj, "v {i} 0 0 0 0 0\nv {i} 1 0 1 1 1\n");
    }
    let mut plain = obj.clone();
    for step in [0, 1] {
        for i in (step..n).step_by(2) {
            let [a, b, c, d] = [2 * i + 1, 2 * i + 2, 2 * i + 3, 2 * i + 4];
            let _ = write!(obj, "f {a}//1 {c}//1 {b}//1\nf {b}//1 {c}//1 {d}//1\n");
            let _ = write!(plain, "f {a} {c} {b}\nf {b} {c} {d}\n");
        }
    }
    let (mut cornered, plain) = (ok(&obj), ok(&plain));
    assert!(cornered.normals.iter().all(|n| *n == Vec3::Z));
    cornered.normals.clear();
    assert_eq!(soup(&cornered), soup(&plain));
}
