//! What the 3D Tiles reader reads, leaves out and refuses.

use super::super::{ReadError, ReadOptions, read_into_with, read_mesh};
use super::sizes;
use crate::RawMesh;
use crate::read::MemorySink;
use flate2::Compression;
use flate2::write::GzEncoder;
use glam::DVec3;
use serde_json::{Value, json};
use std::io::Write;
use std::path::PathBuf;

/// A triangle in glTF, from a corner to one step along x and one along y.
fn glb(corner: [f32; 3]) -> Vec<u8> {
    let [x, y, z] = corner;
    let binary: Vec<u8> = [x, y, z, x + 1.0, y, z, x, y + 1.0, z].iter().flat_map(|v: &f32| v.to_le_bytes()).collect();
    glb_of(&triangle(&json!({"byteLength": 36})), &binary)
}

fn triangle(buffer: &Value) -> Value {
    json!({
        "asset": {"version": "2.0"}, "buffers": [buffer], "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}], "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0,
    })
}

fn glb_of(json: &Value, binary: &[u8]) -> Vec<u8> {
    let mut bytes = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    let mut text = json.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    for (kind, chunk) in [(b"JSON", &text[..]), (b"BIN\0", binary)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    let length = bytes.len() as u32;
    bytes[8..12].copy_from_slice(&length.to_le_bytes());
    bytes
}

/// A b3dm, with the tables given and filled up to a multiple of 8 bytes.
fn b3dm(features: &str, binary: &[u8], glb: &[u8]) -> Vec<u8> {
    let length = (28 + features.len() + binary.len() + glb.len()).next_multiple_of(8);
    let mut bytes = b"b3dm".to_vec();
    for word in [1, length, features.len(), binary.len(), 0, 0] {
        bytes.extend((word as u32).to_le_bytes());
    }
    bytes.extend(features.as_bytes());
    bytes.extend(binary);
    bytes.extend(glb);
    bytes.resize(length, 0);
    bytes
}

/// A composite of tiles.
fn cmpt(parts: &[Vec<u8>]) -> Vec<u8> {
    let mut bytes = b"cmpt\x01\0\0\0".to_vec();
    bytes.extend((16 + parts.concat().len() as u32).to_le_bytes());
    bytes.extend((parts.len() as u32).to_le_bytes());
    bytes.extend(parts.concat());
    bytes
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

fn tileset(root: &Value) -> Vec<u8> {
    json!({"asset": {"version": "1.0"}, "geometricError": 100.0, "root": root}).to_string().into_bytes()
}

fn moved(x: f64, y: f64, z: f64) -> Value {
    json!([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z, 1])
}

/// A folder with `site/tileset.json` and what else is written into it.
struct Site(tempfile::TempDir);

impl Site {
    fn new(root: &Value) -> Self {
        let site = Self(tempfile::tempdir().unwrap());
        site.with("tileset.json", &tileset(root))
    }

    fn with(self, name: &str, bytes: &[u8]) -> Self {
        let path = self.path(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
        self
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join("site").join(name)
    }

    fn read(&self) -> Result<RawMesh, ReadError> {
        read_mesh(&self.path("tileset.json"), &mut |done, all| assert!(done <= all))
    }

    fn mesh(&self) -> RawMesh {
        self.read().unwrap_or_else(|e| panic!("{e}"))
    }

    /// The first corner of each triangle.
    fn corners(&self) -> Vec<[f64; 3]> {
        let mesh = self.mesh();
        mesh.triangles.iter().map(|t| mesh.positions[t[0] as usize].to_array()).collect()
    }

    fn refusal(&self) -> String {
        self.read().expect_err("is refused").to_string()
    }
}

#[test]
fn transforms_are_multiplied_down_from_the_root_and_y_of_gltf_becomes_z() {
    // A quarter turn about z, twice as large; its content one step to the east of it.
    let turned = json!([0, 2, 0, 0, -2, 0, 0, 0, 0, 0, 2, 0, 10, 20, 30, 1]);
    let inner = json!({"transform": moved(1.0, 0.0, 0.0), "content": {"uri": "a.glb"}});
    let root = json!({"transform": turned, "refine": "REPLACE", "children": [{"children": [inner]}]});
    let mesh = Site::new(&root).with("a.glb", &glb([3.0, 5.0, 7.0])).mesh();
    // (3, 5, 7) in glTF is (3, -7, 5) with z up, (4, -7, 5) after the first transform, (14, 8, 10) turned.
    assert_eq!(mesh.positions, [[24.0, 28.0, 40.0], [24.0, 30.0, 40.0], [24.0, 28.0, 42.0]].map(DVec3::from));
}

#[test]
fn large_coordinates_keep_double_precision_and_are_counted() {
    let root = json!({"transform": moved(4_000_000.123, 300_000.5, 4_900_000.25), "content": {"url": "a.b3dm"}});
    let features = r#"{"BATCH_LENGTH":0,"RTC_CENTER":[0.001,0,-0.25]}  "#;
    let mesh = Site::new(&root).with("a.b3dm", &b3dm(features, &[], &glb([0.0; 3]))).mesh();
    assert!(mesh.positions[0].abs_diff_eq(DVec3::new(4_000_000.124, 300_000.5, 4_900_000.0), 1e-8));
    assert_eq!(mesh.diagnostics.count("tiles in geocentric coordinates (EPSG:4978), kept as they are"), 1);
    assert_eq!(mesh.diagnostics.count("bytes behind the end that the header of the GLB gives left out"), 0);
}

#[test]
fn the_center_of_a_b3dm_is_added_after_the_rotation_and_before_the_transform() {
    let turned = json!([0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);
    let corner = |bytes: &[u8]| {
        Site::new(&json!({"transform": turned, "content": {"uri": "a.b3dm"}})).with("a.b3dm", bytes).corners()[0]
    };
    let glb = glb([1.0, 2.0, 3.0]);
    // (1, -3, 2) with z up, (11, 17, 32) with the center.
    assert_eq!(corner(&b3dm(r#"{"RTC_CENTER":[10,20,30]}"#, &[], &glb)), [-17.0, 11.0, 32.0]);
    let binary: Vec<u8> = [0.0f32, 10.0, 20.0, 30.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    assert_eq!(corner(&b3dm(r#"{"RTC_CENTER":{"byteOffset":4}}"#, &binary, &glb)), [-17.0, 11.0, 32.0]);
    assert_eq!(corner(&b3dm("", &[], &glb)), [3.0, 1.0, 2.0]);
    let mut scene = triangle(&json!({"byteLength": 36}));
    scene["extensions"] = json!({"CESIUM_RTC": {"center": [10, 20, 30]}});
    scene["extensionsRequired"] = json!(["CESIUM_RTC"]);
    let zeros = [[0u8; 12], [1; 12], [2; 12]].concat();
    let at = corner(&b3dm("", &[], &glb_of(&scene, &zeros)));
    assert_eq!(at, [-20.0, 10.0, 30.0], "the extension has the same effect");
}

#[test]
fn other_axes_of_gltf_are_turned_as_the_tileset_states() {
    for (axis, expected) in [("X", [-3.0, 2.0, 1.0]), ("Y", [1.0, -3.0, 2.0]), ("Z", [1.0, 2.0, 3.0])] {
        let mut json: Value = serde_json::from_slice(&tileset(&json!({"content": {"uri": "a.glb"}}))).unwrap();
        json["asset"]["gltfUpAxis"] = json!(axis);
        let site = Site::new(&Value::Null).with("tileset.json", json.to_string().as_bytes());
        assert_eq!(site.with("a.glb", &glb([1.0, 2.0, 3.0])).corners(), [expected], "{axis}");
    }
}

#[test]
fn the_center_of_a_glb_is_added_after_the_rotation_of_every_axis() {
    let mut scene = triangle(&json!({"byteLength": 36}));
    scene["extensions"] = json!({"CESIUM_RTC": {"center": [10, 20, 30]}});
    scene["nodes"][0]["translation"] = json!([1, 2, 3]);
    let quarter = json!([0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 100, 0, 0, 1]);
    // The node turned as without a center, then the center, then a quarter turn about z and 100 steps along x.
    for (axis, [x, y, z]) in [("X", [7.0, 22.0, 31.0]), ("Y", [11.0, 17.0, 32.0]), ("Z", [11.0, 22.0, 33.0])] {
        let root = json!({"transform": quarter, "content": {"uri": "a.glb"}});
        let mut json: Value = serde_json::from_slice(&tileset(&root)).unwrap();
        json["asset"]["gltfUpAxis"] = json!(axis);
        let site = Site::new(&Value::Null).with("tileset.json", json.to_string().as_bytes());
        let corners = site.with("a.glb", &glb_of(&scene, &[0; 36])).mesh().positions;
        assert_eq!(corners[0], DVec3::new(100.0 - y, x, z), "{axis}");
    }
}

#[test]
fn tiles_are_geocentric_by_the_position_of_their_meshes_and_counted_once() {
    let count = |bytes: &[u8], transform: &Value| {
        let root = json!({"transform": transform, "content": {"uri": "a.glb"}});
        let found = Site::new(&root).with("a.glb", bytes).mesh().diagnostics;
        found.count("tiles in geocentric coordinates (EPSG:4978), kept as they are")
    };
    let origin = moved(0.0, 0.0, 0.0);
    let binary = [[0u8; 12], [1; 12], [2; 12]].concat();
    let mut scene = triangle(&json!({"byteLength": 36}));
    assert_eq!(count(&glb_of(&scene, &binary), &origin), 0);
    scene["nodes"][0]["translation"] = json!([4_000_000, 4_900_000, -300_000]);
    assert_eq!(count(&glb_of(&scene, &binary), &origin), 1, "by the node");
    // Back to the centre of the earth: local coordinates after all.
    assert_eq!(count(&glb_of(&scene, &binary), &moved(-4_000_000.0, -300_000.0, -4_900_000.0)), 0);
    scene["nodes"][0]["translation"] = json!([0, 0, 0]);
    scene["extensions"] = json!({"CESIUM_RTC": {"center": [4_000_000, 300_000, 4_900_000]}});
    assert_eq!(count(&glb_of(&scene, &binary), &origin), 1, "by the center");
    let part = b3dm(r#"{"RTC_CENTER":[4000000,300000,4900000]}"#, &[], &glb([0.0; 3]));
    assert_eq!(count(&cmpt(&[part.clone(), part]), &origin), 1, "one tile of two parts");
}

#[test]
fn only_the_finest_tiles_are_read_and_coarser_ones_may_be_missing() {
    let leaf = |uri: &str| json!({"content": {"uri": uri}});
    let root = json!({"refine": "REPLACE", "content": {"uri": "coarse.b3dm"}, "children": [
        {"content": {"uri": "middle.b3dm"}, "children": [leaf("a.glb"), {"children": [leaf("b.glb")]}]},
        {"content": {"uri": "c.glb"}, "children": []},
        // Its children replace it by nothing.
        {"content": {"uri": "gone.glb"}, "children": [{}, {"children": []}]},
        // What is added to is part of the surface.
        {"content": {"uri": "d.glb"}, "refine": "ADD", "children": [leaf("e.glb")]},
    ]});
    let mut site = Site::new(&root);
    for (i, name) in ["a", "b", "c", "d", "e"].iter().enumerate() {
        site = site.with(&format!("{name}.glb"), &glb([i as f32, 0.0, 0.0]));
    }
    let mut xs: Vec<f64> = site.corners().iter().map(|c| c[0]).collect();
    xs.sort_by(f64::total_cmp);
    assert_eq!(xs, [0.0, 1.0, 2.0, 3.0, 4.0]);
    let found = site.mesh().diagnostics;
    assert_eq!(found.count("coarser tiles left out, because finer ones replace them"), 3);
    assert_eq!(found.count("coarser tiles left out, although nothing finer has content"), 1);
    assert_eq!(found.count("tiles of the finest level read"), 5);
}

#[test]
fn external_tilesets_replace_the_tile_that_refers_to_them() {
    let site = Site::new(&json!({"transform": moved(100.0, 0.0, 0.0), "content": {"uri": "coarse.glb"}, "refine": "REPLACE", "children": [
            {"transform": moved(0.0, 10.0, 0.0), "content": {"uri": "sub/b%20c.json?v=3"}},
        ]}),
    )
    .with(
        "sub/b c.json",
        &tileset(
            &json!({"transform": moved(0.0, 0.0, 1.0), "contents": [{"uri": "../tiles/a.glb"}, {"uri": "d.gltf"}]}),
        ),
    )
    .with("tiles/a.glb", &glb([0.0; 3]))
    .with("sub/d.gltf", triangle(&json!({"byteLength": 36, "uri": "../buffers/d.bin"})).to_string().as_bytes())
    .with(
        "buffers/d.bin",
        &[[1.0f32; 3], [2.0; 3], [3.0, 4.0, 5.0]].concat().iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<_>>(),
    );
    assert_eq!(site.corners(), [[100.0, 10.0, 1.0], [101.0, 9.0, 2.0]]);
    let found = site.mesh().diagnostics;
    assert_eq!(found.count("coarser tiles left out, because finer ones replace them"), 1);
    assert_eq!(found.count("external tilesets read"), 1);
}

#[test]
fn contents_beside_a_tileset_are_part_of_the_surface() {
    let root = json!({"refine": "REPLACE", "contents": [{"uri": "more.json"}, {"uri": "a.glb"}]});
    let site = Site::new(&root)
        .with("more.json", &tileset(&json!({"content": {"uri": "b.glb"}})))
        .with("a.glb", &glb([1.0, 0.0, 0.0]))
        .with("b.glb", &glb([2.0, 0.0, 0.0]));
    let mut corners = site.corners();
    corners.sort_by(|a, b| a[0].total_cmp(&b[0]));
    assert_eq!(corners, [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
    assert_eq!(site.mesh().diagnostics.count("coarser tiles left out, because finer ones replace them"), 0);
}

#[test]
fn coarser_tiles_may_be_missing_whatever_their_names_are() {
    let root = |refine: &str, uri: &str| {
        let root = json!({"refine": refine, "content": {"uri": uri}, "children": [{"content": {"uri": "a.glb"}}]});
        Site::new(&root).with("a.glb", &glb([1.0, 0.0, 0.0]))
    };
    assert_eq!(root("REPLACE", "gone.mesh").corners(), [[1.0, 0.0, 0.0]]);
    for site in [root("ADD", "gone.mesh"), root("REPLACE", "gone.json")] {
        assert!(site.refusal().contains("which does not exist"));
    }
    assert!(root("REPLACE", "../gone.mesh").refusal().contains("outside the folder"));
}

#[test]
fn files_compressed_with_gzip_are_read_whatever_their_names_say() {
    let root = json!({"children": [{"content": {"uri": "a.b3dm"}}, {"content": {"uri": "more.json"}}]});
    let site = Site::new(&root)
        .with("tileset.json", &gzip(&tileset(&root)))
        .with("a.b3dm", &gzip(&b3dm("", &[], &glb([1.0, 0.0, 0.0]))))
        .with("more.json", &gzip(&tileset(&json!({"content": {"uri": "b"}}))))
        .with("b", &gzip(&glb([2.0, 0.0, 0.0])));
    assert_eq!(site.corners(), [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]);
    let cut = gzip(&glb([2.0, 0.0, 0.0]));
    let message = site.with("b", &cut[..cut.len() / 2]).refusal();
    assert!(message.contains("cannot be decompressed"), "{message}");
}

#[test]
fn the_uncompressed_size_is_limited() {
    let site = Site::new(&json!({"content": {"uri": "a.b3dm"}})).with("a.b3dm", &gzip(&vec![0; 1 << 20]));
    let options = ReadOptions { document: 1 << 16, ..ReadOptions::default() };
    let path = site.path("tileset.json");
    let refusal = read_into_with(&path, &options, &mut MemorySink::new(&path), &mut |_, _| {}).unwrap_err();
    assert!(refusal.to_string().contains("give a larger --memory"), "{refusal}");
}

#[test]
fn the_tiles_say_how_large_the_surface_is() {
    let tile = |i: usize| glb([i as f32, 0.0, 0.0]);
    let parts = cmpt(&[b3dm("", &[], &tile(1)), cmpt(&[b3dm("", &[], &tile(2))])]);
    let named = ["a.b3dm", "b.glb", "c.cmpt", "d.b3dm", "more.json"];
    let children: Vec<Value> =
        named.iter().map(|name| json!({"geometricError": 0, "content": {"uri": name}})).collect();
    let root = json!({"geometricError": 9, "refine": "REPLACE", "content": {"uri": "b.glb"}, "children": children});
    let site = Site::new(&root)
        .with("a.b3dm", &b3dm("{\"BATCH_LENGTH\":0}  ", &[], &tile(3)))
        .with("b.glb", &tile(4))
        .with("c.cmpt", &parts)
        .with("d.b3dm", &gzip(&b3dm("", &[], &tile(5))))
        .with("more.json", &tileset(&json!({"geometricError": 0, "content": {"uri": "e.glb"}})))
        .with("e.glb", &tile(6));
    let (mesh, path) = (site.mesh(), site.path("tileset.json"));
    let found = sizes(&path, &ReadOptions::default()).unwrap();
    assert_eq!((found.vertices, found.triangles), (mesh.positions.len() as u64, mesh.triangles.len() as u64));
    assert_eq!(found.triangles, 6);
    // What the reader refuses counts as nothing.
    let site = site.with("e.glb", &tile(6)[..30]).with("c.cmpt", &parts[..40]);
    assert_eq!(sizes(&path, &ReadOptions::default()).unwrap().triangles, 3);
    // A composite inside another one that states fewer bytes than its own header has.
    let mut short = b"cmpt".to_vec();
    for word in [1, 44, 1] {
        short.extend(u32::to_le_bytes(word));
    }
    short.extend(b"cmpt");
    for word in [1, 12, 9, 0, 0, 44] {
        short.extend(u32::to_le_bytes(word));
    }
    let site = site.with("c.cmpt", &short);
    assert_eq!(sizes(&path, &ReadOptions::default()).unwrap().triangles, 3);
    assert_eq!(sizes(&path, &ReadOptions { document: 100, ..ReadOptions::default() }), None);
    let site = site.with("tileset.json", b"{");
    assert_eq!(sizes(&site.path("tileset.json"), &ReadOptions::default()), None);
}

#[test]
fn composite_tiles_are_unpacked() {
    let parts = [b3dm("", &[], &glb([1.0, 0.0, 0.0])), b3dm(r#"{"RTC_CENTER":[5,0,0]}"#, &[], &glb([0.0; 3]))];
    let mut bytes = cmpt(&parts);
    let site = Site::new(&json!({"content": {"uri": "a.cmpt"}})).with("a.cmpt", &bytes);
    assert_eq!(site.corners(), [[1.0, 0.0, 0.0], [5.0, 0.0, 0.0]]);
    bytes[27] = 0xff;
    let message = site.with("a.cmpt", &bytes).refusal();
    assert!(message.contains("a.cmpt, byte 16: found tile 0 of 2"), "{message}");
}

#[test]
fn circular_and_repeated_references_to_tilesets_are_refused() {
    let names = |uri: &str| json!({"children": [{"content": {"uri": uri}}]});
    let site = Site::new(&names("a/b.json")).with("a/b.json", &tileset(&names("../tileset.json")));
    let message = site.refusal();
    assert!(message.contains("b.json, root.children[0].content.uri") && message.contains("circular"), "{message}");
    assert!(Site::new(&names("tileset.json")).refusal().contains("a circular reference"));
    let twice = json!({"children": [{"content": {"uri": "b.json"}}, {"content": {"uri": "./b.json"}}]});
    let site =
        Site::new(&twice).with("b.json", &tileset(&json!({"content": {"uri": "a.glb"}}))).with("a.glb", &glb([0.0; 3]));
    assert!(site.refusal().contains("included twice"));
}

#[test]
fn a_mesh_may_be_placed_several_times_but_only_once_at_each_place() {
    let leaf = |uri: &str, x: f64| json!({"transform": moved(x, 0.0, 0.0), "content": {"uri": uri}});
    let site = |leaves: &[Value]| Site::new(&json!({"children": leaves})).with("a.glb", &glb([0.0; 3]));
    assert_eq!(site(&[leaf("a.glb", 0.0), leaf("a.glb", 5.0)]).corners(), [[0.0; 3], [5.0, 0.0, 0.0]]);
    let message = site(&[leaf("a.glb", 0.0), leaf("./a.glb?again", -0.0)]).refusal();
    assert!(message.contains("root.children[1].content.uri") && message.contains("included twice"), "{message}");
}

#[test]
fn a_query_is_not_part_of_the_name() {
    for uri in ["a.glb?x=/../../..", "a.glb?x=C:\\", "a.glb#/../../.."] {
        let site = Site::new(&json!({"content": {"uri": uri}})).with("a.glb", &glb([0.0; 3]));
        assert_eq!(site.corners(), [[0.0; 3]], "{uri}");
    }
}

#[test]
fn urls_absolute_paths_and_paths_outside_the_folder_are_refused() {
    for (uri, words) in [
        ("https://example.org/a.glb", "the URL \"https://example.org/a.glb\""),
        ("http://example.org/a.json", "download the whole tileset"),
        ("//example.org/a.b3dm", "the URL"),
        ("file:///etc/passwd", "the URL"),
        ("data:application/octet-stream;base64,AAAA", "the URL"),
        ("/etc/passwd", "the absolute path"),
        ("C:\\tiles\\a.b3dm", "the absolute path"),
        ("../secret.glb", "outside the folder"),
        ("x/../../secret.glb", "outside the folder"),
        ("%2e%2e/secret.glb", "outside the folder"),
        ("..\\secret.glb", "outside the folder"),
        ("missing/a.glb", "the file \"missing/a.glb\", which does not exist"),
        ("", "which does not exist"),
    ] {
        // A file of the same name in the folder must not be used instead.
        let site = Site::new(&json!({"content": {"uri": uri}}))
            .with("a.glb", &glb([0.0; 3]))
            .with("../secret.glb", &glb([0.0; 3]));
        let message = site.refusal();
        assert!(message.contains(words) && message.contains("root.content.uri"), "{uri}: {message}");
    }
}

#[cfg(unix)]
#[test]
fn links_out_of_the_folder_are_refused_unless_allowed() {
    let site = Site::new(&json!({"content": {"uri": "a.glb"}})).with("../secret.glb", &glb([0.0; 3]));
    std::os::unix::fs::symlink("../secret.glb", site.path("a.glb")).unwrap();
    assert!(site.refusal().contains("outside the folder"));
    let options = ReadOptions { allow_outside: true, ..ReadOptions::default() };
    for uri in ["a.glb", "../secret.glb"] {
        let site = &Site::new(&json!({"content": {"uri": uri}})).with("../secret.glb", &glb([0.0; 3]));
        if uri == "a.glb" {
            std::os::unix::fs::symlink("../secret.glb", site.path("a.glb")).unwrap();
        }
        let path = site.path("tileset.json");
        read_into_with(&path, &options, &mut MemorySink::new(&path), &mut |_, _| {}).unwrap();
    }
}

#[test]
fn unsupported_content_is_refused_by_name() {
    let content = |bytes: &[u8]| Site::new(&json!({"content": {"uri": "a.b3dm"}})).with("a.b3dm", bytes).refusal();
    for (bytes, words) in [
        (&b"pnts\x01\0\0\0"[..], "tile of points (pnts)"),
        (b"i3dm\x01\0\0\0", "tile of instances (i3dm)"),
        (b"vctr\x01\0\0\0", "tile of vector data (vctr)"),
        (b"", "0 bytes of an unknown format"),
        (&tileset(&json!({})), "a tileset with the file extension of a mesh"),
        (&b3dm("", &[], b"glTF\x01\0\0\0\x14\0\0\0\0\0\0\0\0\0\0\0"), "is glTF 1;"),
        (&b3dm("{", &[], &glb([0.0; 3])), "a feature table that cannot be read"),
        (&b3dm(r#"{"RTC_CENTER":{"byteOffset":1}}"#, &[0; 12], &glb([0.0; 3])), "RTC_CENTER at byte 1"),
        (&b3dm("", &[0; 8], b"not a GLB"), "after the tables of a b3dm"),
    ] {
        let message = content(bytes);
        assert!(message.contains(words) && message.contains("a.b3dm"), "{words}: {message}");
    }
    let root = |root: &Value| Site::new(root).refusal();
    assert!(root(&json!({"implicitTiling": {}})).contains("implicit tiling in root"));
    assert!(root(&json!({"children": [{"extensions": {"3DTILES_implicit_tiling": {}}}]})).contains("root.children[0]"));
    assert!(root(&json!({"transform": vec![1.0; 16]})).contains("root.transform: found a matrix whose last row"));
    assert!(root(&json!({"transform": [1, 2]})).contains("root.transform"));
    assert!(root(&json!({"refine": "MERGE"})).contains("REPLACE or ADD"));
    assert!(root(&json!({"content": {}})).contains("root.content.uri: found nothing"));
    assert!(root(&json!({})).contains("no tile has content"));
    let whole = |json: &Value| Site::new(&Value::Null).with("tileset.json", json.to_string().as_bytes()).refusal();
    let with = |version: &str, extension: &str| {
        whole(
            &json!({"asset": {"version": version}, "geometricError": 1, "extensionsRequired": [extension], "root": {}}),
        )
    };
    assert!(with("2.0", "3DTILES_metadata").contains("3D Tiles 2.0; only 1.0 and 1.1"));
    assert!(with("1.0", "X_other").contains("not read: X_other"));
    assert!(whole(&json!({"asset": {"version": "1.0"}, "geometricError": 1})).contains("root"));
    let mut deep = json!({});
    for _ in 0..50 {
        deep = json!({"children": [deep]});
    }
    assert!(root(&deep).contains("no tile has content"));
}

#[test]
fn too_deeply_nested_tiles_are_refused() {
    let chain = |n: usize| {
        let mut site = Site::new(&json!({"content": {"uri": "0.json"}}));
        for i in 0..n {
            site = site.with(&format!("{i}.json"), &tileset(&json!({"content": {"uri": format!("{}.json", i + 1)}})));
        }
        site.with(&format!("{n}.json"), &tileset(&json!({"content": {"uri": "a.glb"}}))).with("a.glb", &glb([0.0; 3]))
    };
    let nested = |n: usize| {
        let mut tile = json!({"content": {"uri": "a.glb"}});
        for _ in 1..n {
            tile = json!({"children": [tile]});
        }
        Site::new(&tile).with("a.glb", &glb([0.0; 3]))
    };
    assert_eq!(nested(63).mesh().triangles.len(), 1);
    let message = nested(64).refusal();
    assert!(message.contains("some 60 tiles one below the other in one file"), "{message}");
    assert!(!message.contains("damaged"), "{message}");
    assert_eq!(chain(150).mesh().triangles.len(), 1);
    assert!(chain(250).refusal().contains("more than 200 levels"));
}

#[test]
fn truncated_files_are_refused_at_every_length() {
    let root = tileset(&json!({"children": [{"content": {"uri": "a.b3dm"}}], "transform": moved(1.0, 2.0, 3.0)}));
    let tile = b3dm(r#"{"RTC_CENTER":[1,2,3]}"#, &[0; 8], &glb([0.0; 3]));
    let mut site = Site::new(&Value::Null).with("a.b3dm", &tile);
    for n in 0..root.len() {
        site = site.with("tileset.json", &root[..n]);
        assert!(site.read().is_err(), "tileset.json of {n} bytes");
    }
    site = site.with("tileset.json", &root);
    let packed = gzip(&tile);
    for (what, bytes) in [("b3dm", &tile), ("gzip", &packed)] {
        for n in 0..bytes.len() {
            site = site.with("a.b3dm", &bytes[..n]);
            assert!(site.read().is_err(), "{what} of {n} bytes");
        }
    }
}

#[test]
fn damage_to_any_byte_does_not_panic() {
    let root = tileset(&json!({"children": [{"content": {"uri": "a.b3dm"}}], "transform": moved(1.0, 2.0, 3.0)}));
    let tile = b3dm(r#"{"RTC_CENTER":[1,2,3]}"#, &[0; 8], &glb([0.0; 3]));
    let mut random = fastrand::Rng::with_seed(26);
    let mut site = Site::new(&Value::Null);
    for _ in 0..2000 {
        let mut damaged = [root.clone(), tile.clone()];
        let which = &mut damaged[usize::from(random.bool())];
        let at = random.usize(..which.len());
        which[at] = random.u8(..);
        site = site.with("tileset.json", &damaged[0]).with("a.b3dm", &damaged[1]);
        // It may succeed or fail, but must not panic.
        let _ = site.read();
    }
}

#[test]
fn tiles_without_triangles_are_counted() {
    let mut empty = triangle(&json!({"byteLength": 36}));
    empty["nodes"] = json!([{}]);
    let site = Site::new(&json!({"contents": [{"uri": "a.glb"}, {"uri": "b.glb"}]}))
        .with("a.glb", &glb_of(&empty, &[0; 36]))
        .with("b.glb", &glb([0.0; 3]));
    let mesh = site.mesh();
    assert_eq!((mesh.triangles.len(), mesh.diagnostics.count("tiles without triangles")), (1, 1));
    let message = site.with("b.glb", &glb_of(&empty, &[0; 36])).refusal();
    assert!(message.contains("no triangles in its 2 tiles of the finest level"), "{message}");
}

#[test]
fn memory_for_the_json_is_checked_before_it_is_parsed() {
    let site = Site::new(&json!({"children": vec![json!({}); 1000]}));
    let options = ReadOptions { document: 100_000, ..ReadOptions::default() };
    let path = site.path("tileset.json");
    let refusal = read_into_with(&path, &options, &mut MemorySink::new(&path), &mut |_, _| {}).unwrap_err();
    assert!(refusal.to_string().contains("give a larger --memory"), "{refusal}");
}

#[test]
fn nested_tilesets_share_the_memory_limit() {
    // Each takes some 330 kB.
    let full = |uri: &str| {
        let mut children = vec![json!({}); 1000];
        children.push(json!({"content": {"uri": uri}}));
        json!({"children": children})
    };
    let read = |site: &Site| {
        let options = ReadOptions { document: 1_200_000, ..ReadOptions::default() };
        let path = site.path("tileset.json");
        read_into_with(&path, &options, &mut MemorySink::new(&path), &mut |_, _| {})
    };
    let files = |site: Site| (1..=5).fold(site, |site, i| site.with(&format!("{i}.glb"), &glb([i as f32, 0.0, 0.0])));
    let names: Vec<Value> = (1..=5).map(|i| json!({"content": {"uri": format!("{i}.json")}})).collect();
    let mut beside = files(Site::new(&json!({"children": names})));
    let mut nested = files(Site::new(&full("1.json")));
    for i in 1..=5 {
        beside = beside.with(&format!("{i}.json"), &tileset(&full(&format!("{i}.glb"))));
        let next = if i == 5 { "5.glb".to_owned() } else { format!("{}.json", i + 1) };
        nested = nested.with(&format!("{i}.json"), &tileset(&full(&next)));
    }
    read(&beside).unwrap();
    let refusal = read(&nested).unwrap_err().to_string();
    assert!(refusal.contains("3.json: its JSON may take") && refusal.contains("give a larger --memory"), "{refusal}");
}

#[test]
fn a_feature_table_that_is_too_long_is_refused_before_it_is_read() {
    let of = |spaces: usize| {
        let table = format!(r#"{{"RTC_CENTER":[5,0,0]}}{}"#, " ".repeat(spaces));
        Site::new(&json!({"content": {"uri": "a.b3dm"}})).with("a.b3dm", &b3dm(&table, &[], &glb([0.0; 3])))
    };
    assert_eq!(of(1000).corners(), [[5.0, 0.0, 0.0]]);
    let message = of(1 << 20).refusal();
    assert!(message.contains("a.b3dm, byte 28: found a feature table of 1048598 bytes"), "{message}");
}
