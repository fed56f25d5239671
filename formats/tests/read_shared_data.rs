//! Every real file of `../shared/data`, where that folder is present: a PLY is read as the reference parser reads it or
//! refused with a reason and a place; a file of another format is refused by its name.

use crate::shared_data::{check_invariants, data, extension, files, refusal_of};
use kilwa_formats::read::{MESH_EXTENSIONS, ReadError, read_mesh};
use std::collections::BTreeMap;
use std::path::Path;

/// What the reference parser found in a file.
struct Row {
    parsed: bool,
    vertices: Option<u64>,
    triangles: Option<u64>,
    colors: bool,
    degenerate: u64,
    not_finite: u64,
}

/// The table of the folder's README, by path.
fn table(folder: &Path) -> BTreeMap<String, Row> {
    let text = std::fs::read_to_string(folder.join("README.md")).unwrap();
    let mut rows = BTreeMap::new();
    for line in text.lines().filter(|l| l.starts_with("| ")) {
        let cells: Vec<&str> = line.split('|').map(str::trim).collect();
        if cells.len() < 16 || cells[2].parse::<u64>().is_err() {
            continue;
        }
        let row = Row {
            parsed: cells[3] == "ok",
            vertices: cells[5].parse().ok(),
            triangles: cells[6].parse().ok(),
            colors: cells[8].contains("red+green+blue"),
            degenerate: cells[12].split('/').next().and_then(|c| c.parse().ok()).unwrap_or(0),
            not_finite: cells[14].parse().unwrap_or(0),
        };
        rows.insert(cells[1].to_owned(), row);
    }
    rows
}

#[test]
fn every_ply_is_read_as_the_reference_reads_it_or_refused_with_a_reason() {
    let Some(folder) = data() else { return };
    let table = table(&folder);
    let all = files(&folder);
    let (mut read, mut refused, mut compared) = (0, 0, 0);
    for path in all.iter().filter(|p| extension(p) == "ply") {
        let name = path.strip_prefix(&folder).unwrap().to_string_lossy().into_owned();
        let row = &table[&name];
        match read_mesh(path, &mut |_, _| {}) {
            Ok(mesh) => {
                read += 1;
                println!("read    {name}: {} vertices, {} triangles", mesh.positions.len(), mesh.triangles.len());
                for (kind, n, places) in mesh.diagnostics.iter() {
                    println!("          {n} {kind}: {}", places.join("; "));
                }
                check_invariants(&mesh, &name);
                let f = |kind| mesh.diagnostics.count(kind);
                if !row.parsed {
                    continue;
                }
                compared += 1;
                let split = f("vertices split so that faces keep their colours");
                let dropped = f("vertices without a finite position dropped");
                assert_eq!(dropped > 0, row.not_finite > 0, "{name}");
                assert_eq!(Some(mesh.positions.len() as u64 - split + dropped), row.vertices, "{name}: vertices");
                if let Some(triangles) = row.triangles {
                    assert_eq!(mesh.triangles.len() as u64, triangles - row.degenerate, "{name}: triangles");
                }
                assert_eq!(f("triangles that name a vertex twice dropped"), row.degenerate, "{name}");
                let from_faces = f("triangles whose colour was given to their vertices") > 0;
                assert_eq!(!mesh.colors.is_empty(), row.colors || from_faces, "{name}: colours");
            }
            Err(e) => {
                refused += 1;
                let text = refusal_of(path, &e);
                match e {
                    ReadError::Malformed { .. } => {
                        assert!(text.contains(", line ") || text.contains(", byte "), "names the place: {text}");
                        assert!(text.contains("expected"), "says what was expected: {text}");
                    }
                    ReadError::NoTriangles { .. } => {
                        assert_eq!(row.triangles.unwrap_or(0), 0, "{text}");
                        assert!(text.contains("(line "), "names the place: {text}");
                    }
                    e => panic!("{name}: {e}"),
                }
            }
        }
    }
    println!("{read} read ({compared} compared with the reference), {refused} refused");
    assert!(read + refused >= 80 && read >= 30 && compared >= 25, "{read} {refused} {compared}");
}

/// What refused OBJ files are refused with; all others are read.
const OBJ_REFUSED: &[(&str, &str)] = &[
    ("Cube_fbx_wrong_extension.obj", "an FBX scene"),
    ("box_UTF16BE.obj", "UTF-16"),
    // Reads its colours from a folder beside its own; `--allow-outside` takes it.
    ("box-external-resources/box-external-resources.obj", "outside the folder"),
    ("ObjImporter/Test/empty.obj", "its content does not look like one"),
    ("invalid/malformed.obj", "line 23: found vertex index 12"),
    ("issue-140-zero-face-idx.obj", "line 16: found vertex index 0"),
    ("testdata/inf_nan.obj", "of its 1 triangle none is left"),
    ("obj/lines.obj", "8 vertices, no faces and 3 lines"),
    ("lines_in_meshes_2.obj", "no faces"),
    ("lines_with_vt.obj", "no faces"),
    ("mesh-ignored-keyword.obj", "no faces"),
    ("mesh-named-first-unnamed-index-first.obj", "no faces"),
    ("mesh-named-first-unnamed.obj", "1 point and no faces"),
    ("mesh-negative-indices.obj", "no faces"),
    ("mesh-positions-optional-coordinate.obj", "no faces"),
    ("mesh-primitive-lines.obj", "no faces"),
    ("mesh-primitive-points.obj", "no faces"),
    ("points-prim.obj", "no faces"),
];

#[test]
fn every_obj_is_read_as_the_reference_reads_it_or_refused_with_a_reason() {
    let Some(folder) = data() else { return };
    let table = table(&folder);
    let all = files(&folder);
    let (mut read, mut refused) = (0, 0);
    for path in all.iter().filter(|p| extension(p) == "obj") {
        let name = path.strip_prefix(&folder).unwrap().to_string_lossy().into_owned();
        let expected = OBJ_REFUSED.iter().find(|(end, _)| name.ends_with(end));
        match read_mesh(path, &mut |_, _| {}) {
            Ok(mesh) => {
                assert!(expected.is_none(), "{name} was read");
                read += 1;
                check_invariants(&mesh, &name);
                let row = &table[&name];
                let dropped = mesh.diagnostics.count("triangles that name a vertex twice dropped")
                    + mesh.diagnostics.count("triangles dropped because a corner has no finite position");
                if let (true, Some(triangles)) = (row.parsed, row.triangles) {
                    assert_eq!(mesh.triangles.len() as u64 + dropped, triangles, "{name}: triangles");
                }
            }
            Err(e) => {
                refused += 1;
                let text = e.to_string();
                println!("refused {text}");
                let reason = expected.unwrap_or_else(|| panic!("{name}: {text}")).1;
                assert!(text.contains(reason), "expected {reason:?}: {text}");
            }
        }
    }
    println!("{read} read, {refused} refused");
    assert!(read >= 60 && refused == OBJ_REFUSED.len(), "{read} {refused}");
}

#[test]
fn files_of_other_formats_are_refused_by_the_name_of_their_format() {
    let Some(folder) = data() else { return };
    let expected: &[(&str, &str)] = &[
        ("e57", "E57 scan"),
        ("ptx", "point cloud"),
        ("pts", "point cloud"),
        ("mtl", "Wavefront material library"),
        ("png", "PNG"),
        ("jpg", "JPEG"),
    ];
    let all = files(&folder);
    let mut checked = 0;
    for path in all.iter().filter(|p| !MESH_EXTENSIONS.contains(&extension(p).as_str())) {
        let text = match read_mesh(path, &mut |_, _| {}) {
            Ok(_) => panic!("{} was read as a mesh", path.display()),
            Err(e) => e.to_string(),
        };
        if let Some((_, format)) = expected.iter().find(|(e, _)| *e == extension(path)) {
            assert!(text.contains(format), "expected {format}: {text}");
            checked += 1;
        }
        assert!(text.contains("reads PLY"), "{text}");
    }
    println!("{checked} files of other formats refused by name");
    assert!(checked > 70, "{checked}");
}
