//! What the glTF reader keeps, counts and refuses.

use super::super::texture::detail::Detail;
use super::super::{MemorySink, ReadError, ReadOptions, note_detail, read_into_with, read_mesh, read_mesh_from};
use crate::RawMesh;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use glam::{DVec2, DVec3, Vec3};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

fn bytes_of<T: Copy, const N: usize>(values: &[T], bytes: fn(T) -> [u8; N]) -> Vec<u8> {
    values.iter().flat_map(|v| bytes(*v)).collect()
}

fn floats(values: &[f32]) -> Vec<u8> {
    bytes_of(values, f32::to_le_bytes)
}

fn shorts(values: &[u16]) -> Vec<u8> {
    bytes_of(values, u16::to_le_bytes)
}

/// A file in the making: every attribute has a buffer, a view and an accessor of its own.
struct Scene(Value);

const TRIANGLE: [f32; 9] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0];

impl Scene {
    /// One node that shows one triangle.
    fn triangle() -> Self {
        let mut scene = Self(json!({
            "asset": {"version": "2.0"}, "buffers": [], "bufferViews": [], "accessors": [],
            "meshes": [{"primitives": [{"attributes": {}}]}],
            "nodes": [{"mesh": 0}], "scenes": [{"nodes": [0]}], "scene": 0,
        }));
        scene.attribute("POSITION", "VEC3", 5126, &floats(&TRIANGLE), 3);
        scene
    }

    fn at(&mut self, pointer: &str) -> &mut Value {
        self.0.pointer_mut(pointer).unwrap()
    }

    fn push(&mut self, list: &str, value: Value) -> usize {
        let list = self.0.as_object_mut().unwrap().entry(list).or_insert_with(|| json!([])).as_array_mut().unwrap();
        list.push(value);
        list.len() - 1
    }

    fn view(&mut self, bytes: &[u8]) -> usize {
        let uri = format!("data:application/octet-stream;base64,{}", STANDARD.encode(bytes));
        let buffer = self.push("buffers", json!({"uri": uri, "byteLength": bytes.len()}));
        self.push("bufferViews", json!({"buffer": buffer, "byteLength": bytes.len()}))
    }

    fn accessor(&mut self, kind: &str, component: u32, bytes: &[u8], count: usize) -> usize {
        let view = self.view(bytes);
        let about = json!({"bufferView": view, "componentType": component, "count": count, "type": kind});
        self.push("accessors", about)
    }

    fn attribute(&mut self, name: &str, kind: &str, component: u32, bytes: &[u8], count: usize) -> usize {
        let accessor = self.accessor(kind, component, bytes, count);
        self.at("/meshes/0/primitives/0/attributes")[name] = json!(accessor);
        accessor
    }

    fn indices(&mut self, mode: u32, indices: &[u16]) {
        let accessor = self.accessor("SCALAR", 5123, &shorts(indices), indices.len());
        self.at("/meshes/0/primitives/0")["indices"] = json!(accessor);
        self.at("/meshes/0/primitives/0")["mode"] = json!(mode);
    }

    fn read(&self) -> Result<RawMesh, ReadError> {
        read_bytes(self.0.to_string().as_bytes())
    }

    fn mesh(&self) -> RawMesh {
        self.read().unwrap_or_else(|e| panic!("{e}"))
    }

    fn refusal(&self) -> String {
        self.read().unwrap_err().to_string()
    }
}

fn read_bytes(bytes: &[u8]) -> Result<RawMesh, ReadError> {
    read_mesh_from(std::io::Cursor::new(bytes), bytes.len() as u64, Path::new("a.gltf"), &mut |_, _| {})
}

fn glb(json: &str, binary: &[u8]) -> Vec<u8> {
    let mut bytes = b"glTF\x02\0\0\0\0\0\0\0".to_vec();
    for (kind, chunk) in [(b"JSON", json.as_bytes()), (b"BIN\0", binary)] {
        bytes.extend((chunk.len() as u32).to_le_bytes());
        bytes.extend(kind);
        bytes.extend(chunk);
    }
    let length = bytes.len() as u32;
    bytes[8..12].copy_from_slice(&length.to_le_bytes());
    bytes
}

fn near(a: DVec3, b: DVec3) -> bool {
    a.abs_diff_eq(b, 1e-9)
}

#[test]
fn a_triangle_is_read_unchanged_and_without_colours() {
    let mesh = Scene::triangle().mesh();
    assert_eq!(mesh.positions, [DVec3::ZERO, DVec3::X, DVec3::Y]);
    assert_eq!(mesh.triangles, [[0, 1, 2]]);
    assert!(mesh.colors.is_empty() && mesh.normals.is_empty());
}

#[test]
fn integers_may_be_written_with_a_decimal_point() {
    let plain = Scene::triangle();
    let mut scene = Scene::triangle();
    scene.0["accessors"][0]["count"] = json!(3.0);
    scene.0["bufferViews"][0]["buffer"] = json!(0.0);
    assert_eq!(scene.mesh().positions, plain.mesh().positions);
    scene.0["accessors"][0]["count"] = json!(3.5);
    let message = scene.refusal();
    assert!(message.contains("accessors[0].count") && message.contains("expected a whole number"), "{message}");
}

// The next three say why the types of the JSON are our own and not those of the crate `gltf-json` (1.4), which fails each of them.

#[test]
fn a_node_far_from_the_origin_keeps_its_millimetres() {
    let place = DVec3::new(467_123.456, 12.125, -9_014_321.789);
    let mut scene = Scene::triangle();
    scene.0["nodes"][0]["translation"] = json!(place);
    assert_eq!(scene.mesh().positions[0], place, "f32 would be half a metre off");
    let DVec3 { x, y, z } = place;
    scene.0["nodes"][0] = json!({"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z, 1]});
    assert_eq!(scene.mesh().positions[0], place);
}

#[test]
fn numbers_beyond_32_bits_are_not_cut_to_valid_ones() {
    for (pointer, name, value) in [
        ("/accessors/0", "bufferView", 1u64 << 32),
        ("/accessors/0", "componentType", (1 << 32) + 5126),
        ("/meshes/0/primitives/0", "mode", (1 << 32) + 4),
        ("/meshes/0/primitives/0/attributes", "POSITION", 1 << 32),
        ("/nodes/0", "mesh", 1 << 32),
    ] {
        let mut scene = Scene::triangle();
        scene.at(pointer)[name] = json!(value);
        assert!(scene.read().is_err(), "{name} {value} was taken for another");
    }
}

#[test]
fn damage_in_what_carries_no_surface_refuses_nothing() {
    let mut scene = Scene::triangle();
    scene.push("materials", json!({"alphaMode": 7, "normalTexture": "none", "emissiveFactor": [1], "extras": "text"}));
    scene.at("/meshes/0/primitives/0")["material"] = json!(0);
    scene.at("/nodes/0")["extras"] = json!("text");
    scene.at("/accessors/0")["max"] = json!("1 1 0");
    for list in ["animations", "cameras", "skins"] {
        scene.push(list, json!({}));
    }
    assert_eq!(scene.mesh().triangles.len(), 1);
}

#[test]
fn json_that_is_not_gltf_is_refused_with_a_plain_message() {
    let refusal = |text: &str| read_bytes(text.as_bytes()).unwrap_err().to_string();
    for (text, words) in [
        (r#"{"asset": {"version": "2.0"}, "meshes": {}}"#, "expected a list"),
        (r#"{"asset": {"version": "2.0"}, "nodes": [7]}"#, "expected an object"),
        (r#"{"asset": {"version": "2.0"}, "nodes": [none]}"#, "one of the words true, false and null"),
        (r#"{"asset": {"version": "2.0"}, "nodes": ["#, "the end of the text"),
    ] {
        let message = refusal(text);
        assert!(message.contains(words), "{message}");
        for jargon in ["usize", "u64", "struct", "EOF", "ident"] {
            assert!(!message.split(|c: char| !c.is_alphanumeric()).any(|word| word == jargon), "{message}");
        }
    }
}

#[test]
fn nested_transforms_apply_innermost_first() {
    let mut scene = Scene::triangle();
    let half = std::f64::consts::FRAC_1_SQRT_2;
    scene.0["nodes"] = json!([
        {"children": [1], "translation": [100_000.0, 0.0, 7.0]},
        {"mesh": 0, "rotation": [0.0, 0.0, half, half], "scale": [2.0, 3.0, 1.0]},
    ]);
    let p = scene.mesh().positions;
    assert!(near(p[1], DVec3::new(100_000.0, 2.0, 7.0)), "x is scaled, then turned to y, then moved: {:?}", p[1]);
    assert!(near(p[2], DVec3::new(99_997.0, 0.0, 7.0)), "{:?}", p[2]);
    scene.0["nodes"][1] = json!({"mesh": 0, "matrix":
        [0.0, 2.0, 0.0, 0.0, -3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0]});
    let by_matrix = scene.mesh().positions;
    assert!(p.iter().zip(by_matrix).all(|(a, b)| near(*a, b)), "the same as a matrix");
}

#[test]
fn a_mirroring_node_reverses_the_winding_and_keeps_normals_on_their_side() {
    let mut scene = Scene::triangle();
    scene.attribute("NORMAL", "VEC3", 5126, &floats(&[0.0, 0.6, 0.8].repeat(3)), 3);
    scene.0["nodes"][0]["scale"] = json!([1.0, 1.0, -2.0]);
    let mesh = scene.mesh();
    assert_eq!(mesh.triangles, [[0, 2, 1]]);
    let Vec3 { y, z, .. } = mesh.normals[0];
    assert!(z < 0.0 && (z / y + 0.8 / 0.6 / 2.0).abs() < 1e-6, "by the inverse transposed: {:?}", mesh.normals[0]);
}

#[test]
fn a_mesh_is_delivered_for_every_node_that_uses_it() {
    let mut scene = Scene::triangle();
    scene.0["nodes"] = json!([{"mesh": 0}, {"mesh": 0, "translation": [5, 0, 0]}, {"mesh": 0}]);
    scene.0["scenes"][0]["nodes"] = json!([0, 1]);
    let mesh = scene.mesh();
    assert_eq!((mesh.triangles.len(), mesh.positions[3]), (2, 5.0 * DVec3::X));
}

#[test]
fn without_a_default_scene_all_scenes_are_read_and_without_scenes_all_root_nodes() {
    let mut scene = Scene::triangle();
    scene.0["nodes"] = json!([{"mesh": 0}, {"mesh": 0}, {"children": [0]}]);
    scene.0["scenes"] = json!([{"nodes": [1]}, {"nodes": [2]}]);
    assert_eq!(scene.mesh().triangles.len(), 1, "the default scene alone");
    scene.0.as_object_mut().unwrap().remove("scene");
    assert_eq!(scene.mesh().triangles.len(), 2);
    scene.0.as_object_mut().unwrap().remove("scenes");
    assert_eq!(scene.mesh().triangles.len(), 2);
    scene.0.as_object_mut().unwrap().remove("nodes");
    assert_eq!(scene.mesh().triangles.len(), 1, "a mesh without nodes as it stands");
}

#[test]
fn vertex_colours_of_every_type_are_converted_from_linear_light_to_srgb() {
    let half = [0.5f32; 12];
    let cases: [(&str, u32, Vec<u8>); 5] = [
        ("VEC3", 5126, floats(&half[..9])),
        ("VEC4", 5126, floats(&half)),
        ("VEC4", 5121, [128; 12].to_vec()),
        ("VEC3", 5123, shorts(&[32768; 9])),
        ("VEC4", 5123, shorts(&[32768; 12])),
    ];
    for (kind, component, bytes) in cases {
        let mut scene = Scene::triangle();
        let accessor = scene.attribute("COLOR_0", kind, component, &bytes, 3);
        scene.at("/accessors")[accessor]["normalized"] = json!(component != 5126);
        assert_eq!(scene.mesh().colors, [[188; 3]; 3], "{kind} of {component}: half the light is sRGB 188");
    }
}

#[test]
fn the_factor_of_the_material_multiplies_vertex_colours_in_linear_light() {
    let mut scene = Scene::triangle();
    scene.push("materials", json!({"pbrMetallicRoughness": {"baseColorFactor": [0.5, 1.0, 0.0, 1.0]}}));
    scene.at("/meshes/0/primitives/0")["material"] = json!(0);
    assert_eq!(scene.mesh().colors[0], [188, 255, 0]);
    scene.attribute("COLOR_0", "VEC3", 5126, &floats(&[0.5; 9]), 3);
    assert_eq!(scene.mesh().colors[0], [137, 188, 0], "a quarter of the light is sRGB 137");
}

/// A PNG of two by two texels: red, green; blue, white.
fn png() -> Vec<u8> {
    let texels = [[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]].concat();
    let picture = image::RgbImage::from_raw(2, 2, texels).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// A triangle with a picture and these texture coordinates.
fn textured(coordinates: &[f32; 6]) -> Scene {
    let mut scene = Scene::triangle();
    let view = scene.view(&png());
    scene.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
    scene.push("textures", json!({"source": 0}));
    scene.push("materials", json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    scene.at("/meshes/0/primitives/0")["material"] = json!(0);
    scene.attribute("TEXCOORD_0", "VEC2", 5126, &floats(coordinates), 3);
    scene
}

#[test]
fn vertices_take_the_texture_colour_at_their_coordinates() {
    let mut scene = textured(&[0.25, 0.25, 0.75, 0.25, 0.25, 0.75]);
    assert_eq!(scene.mesh().colors, [[255, 0, 0], [0, 255, 0], [0, 0, 255]], "v runs down from the top");
    scene.0["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([0.5, 0.5, 0.5, 1.0]);
    assert_eq!(scene.mesh().colors[0], [188, 0, 0]);
    let uri = format!("data:image/png;base64,{}", STANDARD.encode(png()));
    scene.0["images"][0] = json!({"uri": uri});
    assert_eq!(scene.mesh().colors[0], [188, 0, 0], "as a data URI");
}

/// A square of two triangles under a picture of 64 texels, red growing across and green down, beside one without a
/// picture that shares an edge with it.
fn pictured_square() -> Scene {
    let mut scene = Scene::triangle();
    let picture = image::RgbImage::from_fn(64, 64, |x, y| image::Rgb([(x * 4) as u8, (y * 4) as u8, 0]));
    let mut png = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut png, image::ImageFormat::Png).unwrap();
    let view = scene.view(&png.into_inner());
    scene.push("images", json!({"bufferView": view, "mimeType": "image/png"}));
    scene.push("textures", json!({"source": 0}));
    scene.push("materials", json!({"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}));
    scene.at("/meshes/0/primitives/0")["material"] = json!(0);
    let square = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];
    let positions: Vec<f32> = square.iter().flat_map(|[x, y]| [*x, *y, 0.0]).collect();
    scene.attribute("POSITION", "VEC3", 5126, &floats(&positions), 4);
    scene.attribute("TEXCOORD_0", "VEC2", 5126, &floats(&square.concat()), 4);
    scene.indices(4, &[0, 1, 2, 0, 2, 3]);
    let plain = scene.accessor("VEC3", 5126, &floats(&[1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 1.0, 1.0, 0.0]), 3);
    let plain = json!({"attributes": {"POSITION": plain}});
    scene.at("/meshes/0/primitives").as_array_mut().unwrap().push(plain);
    scene
}

#[test]
fn textured_triangles_are_split_together_with_their_neighbours() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gltf");
    std::fs::write(&path, pictured_square().0.to_string()).unwrap();
    let options = ReadOptions { detail: Some(Arc::new(Detail::new(9.0))), ..ReadOptions::default() };
    note_detail(&path, &options, &mut |_, _| {}).unwrap();
    let mut sink = MemorySink::new(&path);
    read_into_with(&path, &options, &mut sink, &mut |_, _| {}).unwrap();
    let mesh = sink.into_mesh().unwrap();
    assert!(mesh.triangles.len() > 2 * 64, "{}", mesh.triangles.len());
    assert_eq!(mesh.diagnostics.count("triangles split so that they keep their pictures"), 3);

    let at = |v: u32| mesh.positions[v as usize];
    let mut edges: BTreeMap<[[u64; 3]; 2], i32> = BTreeMap::new();
    let mut area = 0.0;
    for t in &mesh.triangles {
        let [a, b, c] = t.map(at);
        area += ((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])) / 2.0;
        for (p, q) in [(a, b), (b, c), (c, a)] {
            let texels = 64.0 * (p[0] - q[0]).hypot(p[1] - q[1]);
            assert!(texels <= 9.0 + 1e-9 || p[0].max(q[0]) > 1.0, "an edge of {texels} texels");
            let (p, q) = (p.to_array().map(f64::to_bits), q.to_array().map(f64::to_bits));
            *edges.entry(if p < q { [p, q] } else { [q, p] }).or_default() += if p < q { 1 } else { -1 };
        }
    }
    assert!((area - 1.5).abs() < 1e-12, "the surface is the same: {area}");
    let open = edges.values().filter(|n| **n != 0).count();
    assert_eq!(open, 3 * 8 + 2, "8 parts of each free side of the square, the two of the triangle whole: no crack");
    for (p, color) in mesh.positions.iter().zip(&mesh.colors).filter(|(p, _)| p[0] < 0.99 && p[1] < 0.99) {
        let expected = [p[0], p[1]].map(|x| (x * 64.0 - 0.5).max(0.0) * 4.0);
        let near = |k: usize| (f64::from(color[k]) - expected[k]).abs() < 3.0 || p[k] < 0.01;
        assert!(near(0) && near(1), "{p:?} {color:?} {expected:?}");
    }
}

#[test]
fn texture_coordinates_outside_the_image_wrap_as_the_sampler_states() {
    let mut scene = textured(&[1.25, 0.25, 1.25, 1.25, 2.25, 0.25]);
    let repeated = [[255, 0, 0], [255, 0, 0], [255, 0, 0]];
    assert_eq!(scene.mesh().colors, repeated);
    scene.push("samplers", json!({"wrapS": 33071, "wrapT": 33648}));
    scene.0["textures"][0]["sampler"] = json!(0);
    assert_eq!(scene.mesh().colors, [[0, 255, 0], [255; 3], [0, 255, 0]], "clamped across, mirrored down");
}

/// The sample model TextureTransformTest of Khronos: the tip of the arrow, drawn on the diagonal of its picture, has to
/// show where the coordinates are turned 22.5 degrees further from u to v.
#[test]
fn a_texture_rotation_turns_like_the_khronos_sample_model() {
    let tip = 0.777_817_5_f32;
    let shown = [0.420_951_78_f32, 1.016_267_5];
    let mut scene = textured(&[shown[0], shown[1], tip, tip, 0.0, 0.0]);
    let rotation = std::f64::consts::FRAC_PI_8;
    scene.0["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] =
        json!({"KHR_texture_transform": {"rotation": rotation}});
    let root = serde_json::from_value::<super::Root>(scene.0.clone()).unwrap();
    let companions = super::Companions::of(Path::new("a.gltf"), &ReadOptions::default(), None);
    let context = super::Context { path: Path::new("a.gltf"), companions: &companions, format: super::GLTF };
    let material = super::Material::of(&root, &root.meshes[0].primitives[0], "", &context).unwrap();
    let at = material.texture.unwrap().place(shown.map(f64::from).into());
    assert!(at.abs_diff_eq(DVec2::splat(f64::from(tip)), 1e-5), "{at:?}");
}

#[test]
fn a_missing_image_leaves_the_material_colour_and_is_counted() {
    let mut scene = textured(&[0.25; 6]);
    scene.0["images"][0] = json!({"uri": "not_here.png"});
    let mesh = scene.mesh();
    assert_eq!(mesh.colors[0], [255; 3]);
    let (kind, n, places) = mesh.diagnostics.iter().find(|(kind, _, _)| kind.starts_with("pictures")).unwrap();
    assert!(n == 1 && places[0].contains("not_here.png"), "{kind}: {places:?}");
}

#[test]
fn quantised_positions_and_normals_are_decoded() {
    let mut scene = Scene::triangle();
    scene.0["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    // Padded to four shorts for each vertex.
    let packed = shorts(&[0, 0, 0, 9, 65535, 0, 0, 9, 0, 65535, 0, 9]);
    let accessor = scene.attribute("POSITION", "VEC3", 5123, &packed, 3);
    scene.at("/bufferViews")[accessor]["byteStride"] = json!(8);
    let normals: Vec<u8> = [0i8, 0, 127, 0].repeat(3).iter().map(|v| v.cast_unsigned()).collect();
    let normal = scene.attribute("NORMAL", "VEC3", 5120, &normals, 3);
    scene.at("/bufferViews")[normal]["byteStride"] = json!(4);
    assert_eq!(scene.mesh().positions[1], 65535.0 * DVec3::X, "integers are numbers");
    scene.at("/accessors")[accessor]["normalized"] = json!(true);
    let mesh = scene.mesh();
    assert_eq!((mesh.positions[1], mesh.normals[0]), (DVec3::X, Vec3::Z));
}

#[test]
fn interleaved_views_and_sparse_accessors_are_read() {
    let mut scene = Scene::triangle();
    let mut packed = Vec::new();
    for v in 0..3 {
        packed.extend(floats(&TRIANGLE[3 * v..3 * v + 3]));
        packed.extend([255, 0, 0, 255]);
    }
    let view = scene.view(&packed);
    scene.at("/bufferViews")[view]["byteStride"] = json!(16);
    let about = json!({"bufferView": view, "byteOffset": 12, "componentType": 5121, "normalized": true,
        "count": 3, "type": "VEC4"});
    let colors = scene.push("accessors", about);
    let exception = scene.view(&floats(&[7.0, 8.0, 9.0]));
    let which = scene.view(&[2]);
    let about = json!({"bufferView": view, "componentType": 5126, "count": 3, "type": "VEC3", "sparse":
        {"count": 1, "indices": {"bufferView": which, "componentType": 5121}, "values": {"bufferView": exception}}});
    let positions = scene.push("accessors", about);
    scene.at("/meshes/0/primitives/0")["attributes"] = json!({"POSITION": positions, "COLOR_0": colors});
    let mesh = scene.mesh();
    assert_eq!(mesh.positions, [DVec3::ZERO, DVec3::X, DVec3::new(7.0, 8.0, 9.0)]);
    assert_eq!(mesh.colors, [[255, 0, 0]; 3]);
}

#[test]
fn strips_and_fans_become_triangles_and_points_are_counted() {
    for (mode, triangles) in [(5, vec![[0, 1, 2], [1, 0, 2]]), (6, vec![[1, 2, 0], [2, 1, 0]]), (4, vec![[0, 1, 2]])] {
        let mut scene = Scene::triangle();
        scene.indices(mode, &[0, 1, 2, 1]);
        if mode == 5 {
            scene.indices(mode, &[0, 1, 2, 0]);
        }
        assert_eq!(scene.mesh().triangles, triangles, "mode {mode}");
    }
    let mut scene = Scene::triangle();
    let points = json!({"mode": 0, "attributes": {"POSITION": 0}});
    scene.at("/meshes/0/primitives").as_array_mut().unwrap().push(points);
    let mesh = scene.mesh();
    assert_eq!((mesh.triangles.len(), mesh.diagnostics.count("primitives of points or lines left out")), (1, 1));
}

#[test]
fn primitives_that_share_their_vertices_deliver_them_once() {
    let mut scene = Scene::triangle();
    let again = scene.at("/meshes/0/primitives/0").clone();
    scene.at("/meshes/0/primitives").as_array_mut().unwrap().push(again);
    let mesh = scene.mesh();
    assert_eq!((mesh.triangles.len(), mesh.positions.len()), (2, 3));
}

#[test]
fn a_glb_has_its_first_buffer_inside_and_others_lie_beside_the_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut scene = Scene::triangle();
    scene.0["buffers"][0] = json!({"byteLength": 36});
    scene.attribute("NORMAL", "VEC3", 5126, &floats(&[0.0, 0.0, 1.0].repeat(3)), 3);
    std::fs::write(folder.path().join("normals of it.bin"), floats(&[0.0, 0.0, 1.0].repeat(3))).unwrap();
    scene.0["buffers"][1] = json!({"byteLength": 36, "uri": "normals%20of%20it.bin"});
    let path = folder.path().join("a.glb");
    std::fs::write(&path, glb(&scene.0.to_string(), &floats(&TRIANGLE))).unwrap();
    let mesh = read_mesh(&path, &mut |done, all| assert!(done <= all)).unwrap();
    assert_eq!((mesh.positions.len(), mesh.normals[0]), (3, Vec3::Z));
    std::fs::remove_file(folder.path().join("normals of it.bin")).unwrap();
    let text = read_mesh(&path, &mut |_, _| {}).unwrap_err().to_string();
    assert!(text.contains("buffers[1]") && text.contains("normals of it.bin"), "{text}");
}

/// Make view `index` of the scene, whose elements of `stride` bytes are `bytes`, one of `EXT_meshopt_compression`.
fn compress(scene: &mut Scene, index: usize, stride: usize, bytes: &[u8], filter: &str) {
    use meshoptimizer_rs::{Workspace, codec};
    let (count, encoding) = (bytes.len() / stride, codec::VertexEncoding::DEFAULT);
    let packed = codec::encode_vertex_buffer(bytes, count, stride, encoding, &mut Workspace::default());
    let Ok(packed) = packed else { panic!("{packed:?}") };
    let view = scene.view(&packed);
    let about = json!({"buffer": view, "byteLength": packed.len(), "byteStride": stride, "count": count,
        "mode": "ATTRIBUTES", "filter": filter});
    // As in files with a fallback: the uncompressed buffer is missing.
    let plain = scene.push("buffers", json!({"byteLength": bytes.len()}));
    scene.at("/bufferViews")[index] = json!({"buffer": plain, "byteLength": bytes.len(), "byteStride": stride,
        "extensions": {"EXT_meshopt_compression": about}});
}

#[test]
fn meshopt_views_are_decoded_and_unknown_filters_refused() {
    let mut scene = Scene::triangle();
    compress(&mut scene, 0, 12, &floats(&TRIANGLE), "NONE");
    assert_eq!(scene.mesh().positions[1], DVec3::X);
    scene.at("/bufferViews/0/extensions/EXT_meshopt_compression")["filter"] = json!("SOMETHING");
    let text = scene.refusal();
    assert!(text.contains("bufferViews[0]") && text.contains("SOMETHING"), "{text}");
}

/// meshoptimizer's own filters in C++ take the processor's estimate of 1 / sqrt (`_mm_rsqrt_ps`, `vrsqrteq_f32`), which Intel, AMD and ARM
/// compute differently: on an AMD EPYC each of these normals came out one step beside the exact value.
#[test]
fn filtered_normals_are_the_same_on_every_machine() {
    let mut scene = Scene::triangle();
    let encoded = [[-113i8, -8, 127, 0], [-57, 73, 127, 0], [74, 7, 127, 0]];
    let exact = [[-127.0, -9.0, 7.0], [-78.0, 100.0, -4.0], [108.0, 10.0, 67.0]];
    let bytes: Vec<u8> = encoded.as_flattened().iter().map(|v| v.cast_unsigned()).collect();
    let normals = scene.attribute("NORMAL", "VEC3", 5120, &bytes, 3);
    scene.at("/accessors")[normals]["normalized"] = json!(true);
    compress(&mut scene, normals, 4, &bytes, "OCTAHEDRAL");
    assert_eq!(scene.mesh().normals, exact.map(|n| (DVec3::from_array(n) / 127.0).as_vec3()));
}

#[test]
fn a_reference_to_a_missing_part_is_refused_by_name() {
    type Damage = fn(&mut Scene);
    let cases: [(Damage, &[&str]); 14] = [
        (|s| s.at("/accessors/0")["count"] = json!(4), &["accessors[0]", "4 elements", "bufferViews[0]"]),
        (|s| s.at("/accessors/0")["count"] = json!(u64::MAX), &["accessors[0]"]),
        (|s| s.at("/accessors/0")["byteOffset"] = json!(u64::MAX), &["accessors[0]"]),
        (|s| s.at("/accessors/0")["bufferView"] = json!(9), &["bufferViews[9]"]),
        (|s| s.at("/accessors/0")["componentType"] = json!(5130), &["accessors[0]", "5130"]),
        (|s| s.at("/accessors/0")["type"] = json!("MAT4"), &["accessors[0]", "MAT4"]),
        (|s| s.at("/bufferViews/0")["byteLength"] = json!(99), &["bufferViews[0]", "99 bytes", "buffers[0]"]),
        (|s| s.at("/bufferViews/0")["byteStride"] = json!(0), &["accessors[0]", "every 0 bytes"]),
        (|s| s.at("/bufferViews/0")["buffer"] = json!(3), &["bufferViews[0]", "buffers[3]"]),
        (|s| s.indices(4, &[0, 1, 7]), &["accessors[1]", "vertex 7"]),
        (|s| s.at("/meshes/0/primitives/0")["material"] = json!(2), &["meshes[0].primitives[0]", "materials[2]"]),
        (|s| s.at("/nodes/0")["children"] = json!([0]), &["nodes[0]", "reached twice"]),
        (|s| s.at("/nodes/0")["mesh"] = json!(-1), &["nodes[0].mesh", "-1"]),
        (|s| s.at("/buffers/0")["uri"] = json!("https://example.org/a.bin"), &["buffers[0]", "https://", "download"]),
    ];
    for (damage, parts) in cases {
        let mut scene = Scene::triangle();
        damage(&mut scene);
        let text = scene.refusal();
        assert!(parts.iter().all(|part| text.contains(part)) && text.contains("a.gltf"), "{parts:?}: {text}");
    }
}

#[test]
fn an_accessor_of_zeros_cannot_be_larger_than_the_file_justifies() {
    let mut scene = Scene::triangle();
    scene.at("/accessors")[0] = json!({"componentType": 5126, "count": 4_000_000_000u64, "type": "VEC3"});
    assert!(scene.refusal().contains("without a buffer view"));
}

#[test]
fn other_versions_and_unknown_required_extensions_are_refused_by_name() {
    let mut scene = Scene::triangle();
    scene.0["extensionsRequired"] = json!(["KHR_mesh_quantization", "ACME_secret"]);
    let text = scene.refusal();
    assert!(text.contains("ACME_secret") && !text.contains("quantization"), "{text}");
    let first = br#"{"asset": {"version": "1.0"}, "accessors": {}, "meshes": {}}"#;
    assert!(read_bytes(first).unwrap_err().to_string().contains("glTF 1.0"));
    let tiles = br#"{"asset": {"version": "1.1"}, "geometricError": 7, "root": {}, "accessors": []}"#;
    assert!(read_bytes(tiles).unwrap_err().to_string().contains("3D Tiles"));
    assert!(read_bytes(b"glTF\x01\0\0\0\x14\0\0\0........").unwrap_err().to_string().contains("glTF 1"));
}

#[test]
fn a_truncated_glb_is_refused_with_the_byte_offset() {
    let whole = glb(&Scene::triangle().0.to_string(), b"");
    assert!(read_bytes(&whole).is_ok());
    for length in 4..whole.len() {
        let text = read_bytes(&whole[..length]).unwrap_err().to_string();
        assert!(text.contains("byte ") && text.contains("truncated"), "{length}: {text}");
    }
}

#[test]
fn a_file_without_triangles_is_refused_with_what_it_contains() {
    let mut scene = Scene::triangle();
    scene.at("/meshes/0/primitives/0")["mode"] = json!(1);
    assert!(scene.refusal().contains("points, lines"));
    scene.0["scenes"][0]["nodes"] = json!([]);
    assert!(scene.refusal().contains("its mesh is not in the scene"));
}
