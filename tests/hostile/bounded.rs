//! Meshes that cost more than their size: time grows with the mesh and not with its square, memory stays within the limit.

use crate::support::{Input, kilwa, succeeds, text};
use std::path::Path;

/// Triangles that no tree and no weld can separate, or that all meet in one vertex.
const SHAPES: [&str; 9] = [
    "the same corners",
    "stacked",
    "stacked with colours",
    "facing apart",
    "two places",
    "a fan",
    "a book",
    "needles",
    "one cell",
];

fn shape(kind: &str, n: u32) -> Input {
    let mut mesh = Input::default();
    let base = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let angle = |i: u32| f64::from(i) / f64::from(n) * std::f64::consts::TAU;
    let mut generator = fastrand::Rng::with_seed(5);
    let mut random = || generator.f64();
    match kind {
        "a fan" | "a book" => {
            mesh.positions.extend([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]);
            mesh.positions.extend((0..n).map(|i| [angle(i).cos(), angle(i).sin(), 0.5]));
            let book = kind == "a book";
            mesh.triangles.extend((0..n).map(|i| [0, if book { 1 } else { 2 + (i + 1) % n }, 2 + i]));
        }
        "needles" => {
            mesh.positions.extend((0..n + 2).map(|i| [f64::from(i) / f64::from(n), 0.0, 0.0]));
            mesh.positions.push([0.0, 1.0, 0.0]);
            mesh.triangles.extend((0..n).map(|i| [i, i + 1, i + 2]));
            mesh.triangles.push([0, n + 1, n + 2]);
        }
        "one cell" => {
            mesh.positions.extend((0..3 * n).map(|_| [random() * 1e-6, random() * 1e-6, random() * 1e-6]));
            mesh.positions.extend([[10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]]);
            mesh.triangles.extend((0..=n).map(|i| [3 * i, 3 * i + 1, 3 * i + 2]));
        }
        "the same corners" => {
            mesh.positions.extend(base);
            mesh.triangles.resize(n as usize, [0, 1, 2]);
        }
        _ => {
            let height = |i: u32| if kind == "two places" { f64::from(i % 2) / 2.0 } else { 0.0 };
            mesh.positions.extend((0..n).flat_map(|i| base.map(|[x, y, _]| [x, y, height(i)])));
            let order = |i: u32| if kind == "facing apart" && i.is_multiple_of(2) { [0, 2, 1] } else { [0, 1, 2] };
            mesh.triangles.extend((0..n).map(|i| order(i).map(|k| 3 * i + k)));
            if kind == "stacked with colours" {
                mesh.colors.extend((0..3 * n).map(|i| [i / 3, i / 768, i / 196_608].map(|c| c as u8)));
            }
        }
    }
    mesh.colors.resize(mesh.positions.len(), [200, 190, 180]);
    mesh
}

/// Processor time of a build, seconds.
fn cost(folder: &Path, kind: &str, n: u32) -> f64 {
    let (input, pack) = (folder.join("hostile.ply"), folder.join("hostile.kilwa"));
    shape(kind, n).write(&input);
    let report = succeeds(&[
        "build",
        text(&input),
        "-o",
        text(&pack),
        "--force",
        "--threads",
        "1",
        "--memory",
        "512M",
        "--json",
    ]);
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    report["run"]["cpu_seconds"].as_f64().unwrap()
}

/// Four times as many triangles must take about four times as long; in quadratic time they would take sixteen times as long.
#[test]
fn coincident_triangles_and_high_degree_vertices_take_linear_time() {
    let folder = tempfile::tempdir().unwrap();
    let few = if std::env::var_os("KILWA_SOAK").is_some() { 100_000 } else { 12_000 };
    for kind in SHAPES {
        let mut few = few;
        let mut a = cost(folder.path(), kind, few);
        // A shorter run is mostly the start of the program, so its ratio would mean nothing.
        while a < 0.25 {
            few *= 2;
            a = cost(folder.path(), kind, few);
        }
        let b = cost(folder.path(), kind, 4 * few);
        println!("{kind}: {a:.2} s for {few}, {b:.2} s for {}", 4 * few);
        assert!(b < 8.0 * a, "{kind}: {a} s for {few}, {b} s for {}", 4 * few);
    }
}

/// So many bytes of text, the memory allowed, in MiB. The ratio is that of 24 MB under `--memory 512M`.
const TEXT: usize = 6 << 20;
const MEMORY: u64 = 128;

fn repeated(before: &str, part: impl Fn(usize) -> String, after: &str) -> String {
    let mut text = before.to_owned();
    let mut i = 0;
    while text.len() < TEXT {
        if i > 0 {
            text.push(',');
        }
        text += &part(i);
        i += 1;
    }
    text + after
}

/// glTF JSON in which a few bytes expand to many.
fn documents(each: &mut dyn FnMut(&str, String)) {
    let asset = r#"{"asset":{"version":"2.0"},"#;
    let list = |name: &str, part: &'static str| repeated(&format!("{asset}\"{name}\":["), |_| part.to_owned(), "]}");
    let accessor = r#"{"componentType":1,"count":1,"type":"A"}"#;
    let compressed = r#"{"buffer":0,"byteLength":1,"extensions":{"EXT_meshopt_compression":{"buffer":0,"byteLength":1,"byteStride":4,"count":1,"mode":"A"}}}"#;
    each("empty nodes", list("nodes", "{}"));
    each("nodes with a matrix", list("nodes", r#"{"matrix":[1,1,1,1,1,1,1,1,1,1,1,1,1,1,1,1]}"#));
    each(
        "nodes with a mesh",
        list("nodes", r#"{"mesh":0}"#).replacen("{\"asset\"", "{\"meshes\":[{\"primitives\":[]}],\"asset\"", 1),
    );
    each(
        "a chain of nodes",
        repeated(&format!("{asset}\"nodes\":["), |i| format!("{{\"children\":[{}]}}", i + 1), ",{}]}"),
    );
    each(
        "a node of many children",
        repeated(&format!("{asset}\"nodes\":[{{\"children\":["), |_| "1".to_owned(), "]},{}]}"),
    );
    each("accessors", list("accessors", accessor));
    each("views", list("bufferViews", r#"{"buffer":0,"byteLength":1}"#));
    each("compressed views", list("bufferViews", compressed));
    each("buffers", list("buffers", r#"{"uri":"a"}"#));
    each("empty images", list("images", "{}"));
    each("images of many names", repeated(&format!("{asset}\"images\":["), |i| format!("{{\"uri\":\"{i}\"}}"), "]}"));
    each("materials", list("materials", "{}"));
    each("materials with colours", list("materials", r#"{"pbrMetallicRoughness":{}}"#));
    each("textures", list("textures", "{}"));
    each("samplers", list("samplers", "{}"));
    each("scenes", list("scenes", "{}"));
    each("meshes", list("meshes", r#"{"primitives":[]}"#));
    each("primitives", list("meshes", r#"{"primitives":[{"attributes":{}}]}"#));
    each(
        "attributes",
        repeated(
            &format!("{asset}\"meshes\":[{{\"primitives\":[{{\"attributes\":{{"),
            |i| format!("\"TEXCOORD_{i}\":0"),
            "}}]}]}",
        ),
    );
    each(
        "targets",
        repeated(
            &format!("{asset}\"meshes\":[{{\"primitives\":[{{\"attributes\":{{}},\"targets\":["),
            |_| "0".to_owned(),
            "]}]}]}",
        ),
    );
    each("animations", list("animations", "0"));
    each("extensions", list("extensionsRequired", "\"\""));
    each("extras", repeated(&format!("{asset}\"extras\":["), |_| "{\"a\":{}}".to_owned(), "]}"));
    each(
        "numbers with a point",
        repeated(&format!("{asset}\"scene\":1.0,\"extras\":["), |_| "{\"a\":1.0}".to_owned(), "]}"),
    );
    each("nesting", format!("{asset}\"extras\":{}", "[".repeat(TEXT)));
    each("a long string", format!("{asset}\"buffers\":[{{\"uri\":\"{}\"}}]}}", "a".repeat(TEXT)));
    each("a long data URI", format!("{asset}\"buffers\":[{{\"uri\":\"data:;base64,{}\"}}]}}", "A".repeat(TEXT)));
    each("a long name", format!("{asset}\"{}\":0}}", "\\u0041".repeat(TEXT / 6)));
    each("names", repeated(asset, |i| format!("\"{i}\":0"), "}"));
    each("nothing but quotes", "{\"asset\":".to_owned() + &"\"\"".repeat(TEXT / 2));
}

/// Other formats.
fn texts(each: &mut dyn FnMut(&str, String)) {
    let surface = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1\n";
    let lines = |line: &dyn Fn(usize) -> String| {
        let mut text = String::new();
        let mut number = 0;
        while text.len() < TEXT {
            text += &line(number);
            number += 1;
        }
        text
    };
    let ply = |inside: &str| {
        format!(
            "ply\nformat ascii 1.0\n{inside}element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
        )
    };
    each("materials.obj", format!("{surface}{}", lines(&|i| format!("usemtl {i}\n"))));
    each("libraries.obj", format!("usemtl a\n{surface}{}", lines(&|i| format!("mtllib {i}\n"))));
    each("groups.obj", format!("{surface}{}", lines(&|i| format!("g {i}\ns {i}\no {i}\n"))));
    each("line.obj", format!("{surface}g {}\n", "a".repeat(TEXT)));
    each("joined.obj", format!("{surface}g {}\n", "a \\\n".repeat(TEXT / 4)));
    each("corners.obj", format!("{surface}f {}\n", "1 2 3 ".repeat(TEXT / 6)));
    each("unknown.obj", format!("{surface}{}", lines(&|i| format!("w{i} 1\n"))));
    each("elements.ply", ply(&lines(&|i| format!("element e{i} 0\n"))));
    each("properties.ply", ply(&format!("element a 0\n{}", lines(&|i| format!("property float p{i}\n")))));
    each("comments.ply", ply(&lines(&|i| format!("comment {i}\n"))));
    each("pictures.ply", ply(&lines(&|i| format!("comment TextureFile {i}\n"))));
    each("line.ply", ply(&format!("comment {}\n", "a".repeat(TEXT))));
    each(
        "name.stl",
        format!(
            "solid {}\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid\n",
            "a".repeat(TEXT)
        ),
    );
    each(
        "solids.stl",
        lines(&|i| {
            format!(
                "solid {i}\nfacet normal 0 0 0\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid {i}\n"
            )
        }),
    );
    each("open.gltf", "{\"asset\"".to_owned() + &"{\"a\":".repeat(TEXT / 5));
}

/// The most memory that any program run by this test had, MiB.
#[cfg(unix)]
fn peak() -> u64 {
    use nix::sys::resource::{UsageWho, getrusage};
    let usage = getrusage(UsageWho::RUSAGE_CHILDREN).unwrap();
    // In KiB on Linux, in bytes on macOS.
    usage.max_rss() as u64 / if cfg!(target_os = "macos") { 1 << 20 } else { 1 << 10 }
}

/// Build from a file: it is built or refused, within the memory that was given. The text is gone by then, for what this
/// process holds counts for those that it begins.
#[cfg(unix)]
fn stays_within_memory(folder: &Path, name: &str, content: impl AsRef<[u8]>) {
    let (input, pack) = (folder.join(name), folder.join("out.kilwa"));
    std::fs::write(&input, content).unwrap();
    let output = kilwa(&[
        "build",
        text(&input),
        "-o",
        text(&pack),
        "--force",
        "--memory",
        &format!("{MEMORY}M"),
        "--threads",
        "2",
    ]);
    let message = String::from_utf8_lossy(&output.stderr);
    println!("{name}: {}, {} MiB: {}", output.status, peak(), message.chars().take(200).collect::<String>());
    assert!(matches!(output.status.code(), Some(0 | 1)), "{name}: {}", output.status);
    assert!(output.status.success() || message.contains(name), "{message}");
    assert!(message.len() < 2000, "{name}: {} bytes of message", message.len());
    assert!(peak() <= MEMORY, "{name}: {} MiB of {MEMORY}", peak());
    std::fs::remove_file(&input).unwrap();
}

#[cfg(unix)]
#[test]
fn any_gltf_json_stays_within_the_memory_limit() {
    let folder = tempfile::tempdir().unwrap();
    documents(&mut |name, content| stays_within_memory(folder.path(), &format!("{name}.gltf"), content));
}

#[cfg(unix)]
#[test]
fn any_lines_headers_and_names_stay_within_the_memory_limit() {
    let folder = tempfile::tempdir().unwrap();
    texts(&mut |name, content| stays_within_memory(folder.path(), name, content));
}

/// Archives whose list of files, names, documents or contents take more than their size.
#[cfg(unix)]
#[test]
fn any_archive_stays_within_the_memory_limit() {
    use crate::support::zip::{archive, deflated, gltf, stored};
    let folder = tempfile::tempdir().unwrap();
    let mesh = || stored("a.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let small = |i: usize| stored(&format!("{i}"), b"");
    let check = |name: &str, content: Vec<u8>| stays_within_memory(folder.path(), name, content);
    check("many.zip", archive(&(0..65_000).map(small).chain([mesh()]).collect::<Vec<_>>()));
    check(
        "names.zip",
        archive(
            &(0..900).map(|i| stored(&format!("{i}{}", "a".repeat(4000)), b"")).chain([mesh()]).collect::<Vec<_>>(),
        ),
    );
    let (json, buffer) = gltf(None, &format!("{{\"title\":\"{}\"}}", "a".repeat(15 << 20)));
    check("title.zip", archive(&[deflated("scene.gltf", json.as_bytes()), stored("scene.bin", &buffer)]));
    check("license.zip", archive(&[mesh(), deflated("license.txt", &vec![b'a'; 15 << 20])]));
    // Not held as a whole: what this process has held counts for those that it begins.
    let mut packed = Vec::new();
    let spaces = std::io::Read::take(std::io::repeat(b' '), 200 << 20);
    let mut encoder = flate2::read::DeflateEncoder::new(spaces, flate2::Compression::default());
    std::io::Read::read_to_end(&mut encoder, &mut packed).unwrap();
    let bomb = crate::support::zip::Item { packed, bytes: 200 << 20, method: 8, ..mesh() };
    check("bomb.zip", archive(&[bomb]));
    // Buffers that are kept open, each small enough for memory.
    let names: Vec<String> = (0..300).map(|i| format!("b{i}.bin")).collect();
    let buffers: Vec<String> = names.iter().map(|name| format!("{{\"uri\":\"{name}\",\"byteLength\":36}}")).collect();
    let list = |each: &dyn Fn(usize) -> String| (0..names.len()).map(each).collect::<Vec<_>>().join(",");
    let json = format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},\"buffers\":[{}],\"bufferViews\":[{}],\"accessors\":[{}],\"meshes\":[{{\"primitives\":[{}]}}],\"nodes\":[{{\"mesh\":0}}]}}",
        buffers.join(","),
        list(&|i| format!("{{\"buffer\":{i},\"byteLength\":36}}")),
        list(&|i| format!("{{\"bufferView\":{i},\"componentType\":5126,\"count\":3,\"type\":\"VEC3\"}}")),
        list(&|i| format!("{{\"attributes\":{{\"POSITION\":{i}}}}}")),
    );
    let mut data: Vec<u8> =
        [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    data.resize(1 << 20, 0);
    let one = deflated("", &data);
    let items = names.iter().map(|name| crate::support::zip::Item { name: name.clone().into_bytes(), ..one.clone() });
    check("buffers.zip", archive(&items.chain([stored("scene.gltf", json.as_bytes())]).collect::<Vec<_>>()));
    assert!(folder.path().join("out.kilwa").exists(), "the last one is sound");
}

/// An OBJ with one triangle that shows this picture.
#[cfg(unix)]
fn with_picture(folder: &Path, picture: &[u8]) -> String {
    std::fs::write(folder.join("a.mtl"), "newmtl m\nmap_Kd a.png\n").unwrap();
    std::fs::write(folder.join("a.png"), picture).unwrap();
    "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n".to_owned()
}

/// A chunk of a PNG of zeros that are compressed.
#[cfg(unix)]
fn inflating(name: [u8; 4], before: &[u8], bytes: u64) -> Vec<u8> {
    use std::io::Read;
    let mut data = [&name[..], before].concat();
    let zeros = std::io::repeat(0).take(bytes);
    flate2::read::ZlibEncoder::new(zeros, flate2::Compression::fast()).read_to_end(&mut data).unwrap();
    let mut sum = flate2::Crc::new();
    sum.update(&data);
    [&(data.len() as u32 - 4).to_be_bytes(), &data[..], &sum.sum().to_be_bytes()].concat()
}

#[cfg(unix)]
fn encoded(picture: &image::DynamicImage) -> Vec<u8> {
    let mut bytes = std::io::Cursor::new(Vec::new());
    picture.write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// Before, a profile of 300 MB in a file of 300 KB took 300 MiB. Profiles and texts are not looked at.
#[cfg(unix)]
#[test]
fn a_profile_or_text_that_inflates_stays_within_the_memory_limit() {
    let folder = tempfile::tempdir().unwrap();
    let plain = encoded(&image::DynamicImage::new_rgb8(4, 4));
    for (name, before) in [(b"iCCP", &b"a\0\0"[..]), (b"zTXt", b"a\0\0"), (b"iTXt", b"a\0\x01\0\0\0")] {
        // After the header, which has 25 bytes with its sum.
        let chunk = inflating(*name, before, 256 << 20);
        let mesh = with_picture(folder.path(), &[&plain[..33], &chunk, &plain[33..]].concat());
        stays_within_memory(folder.path(), "profile.obj", mesh);
        assert!(folder.path().join("out.kilwa").exists(), "the picture is read");
        std::fs::remove_file(folder.path().join("out.kilwa")).unwrap();
    }
}

/// A picture that does not fit is refused with what to do, never left out: what is read does not depend on the memory.
#[cfg(unix)]
#[test]
fn an_image_that_decodes_to_more_than_the_memory_limit_is_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    for picture in [image::DynamicImage::new_luma8(6000, 6000), image::DynamicImage::new_rgba16(3600, 3600)] {
        let bytes = encoded(&picture);
        drop(picture);
        let mesh = with_picture(folder.path(), &bytes);
        stays_within_memory(folder.path(), "large.obj", mesh.clone());
        let (input, pack) = (folder.path().join("large.obj"), folder.path().join("out.kilwa"));
        assert!(!pack.exists());
        std::fs::write(&input, mesh).unwrap();
        let build = ["build", text(&input), "-o", text(&pack), "--force", "--memory"];
        let message = crate::support::fails(&[&build[..], &["128M"]].concat());
        assert!(message.contains("large.obj") && message.contains("larger --memory"), "{message}");
    }
    // With more, the last of them is read. Behind all others, for the most that any program took is what is looked at.
    let (input, pack) = (folder.path().join("large.obj"), folder.path().join("out.kilwa"));
    succeeds(&["build", text(&input), "-o", text(&pack), "--memory", "512M"]);
}

/// A mesh of sixty triangles at `places` places, used by 40,000 nodes that all have the same position.
#[cfg(unix)]
fn coincident_instances(folder: &Path, places: u16) -> String {
    let mut buffer: Vec<u8> = Vec::new();
    for i in 0..places {
        // The last one is far away, so that all others are in one leaf.
        let x = if i > 0 && i + 1 == places { 10.0 } else { f32::from(i) / 100.0 };
        let corners = [[x, 0.0, 0.0], [x + 0.01, 0.0, 0.0], [x, 0.01, 0.0]];
        buffer.extend(corners.as_flattened().iter().flat_map(|c: &f32| c.to_le_bytes()));
    }
    let positions = buffer.len();
    for first in (0..60).map(|i| i % places * 3) {
        buffer.extend([first, first + 1, first + 2].iter().flat_map(|index: &u16| index.to_le_bytes()));
    }
    std::fs::write(folder.join("a.bin"), &buffer).unwrap();
    let (all, vertices, nodes) = (buffer.len(), 3 * places, vec![r#"{"mesh":0}"#; 40_000].join(","));
    format!(
        r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"uri":"a.bin","byteLength":{all}}}],
        "bufferViews":[{{"buffer":0,"byteLength":{positions}}},{{"buffer":0,"byteOffset":{positions},"byteLength":360}}],
        "accessors":[{{"bufferView":0,"componentType":5126,"count":{vertices},"type":"VEC3"}},
        {{"bufferView":1,"componentType":5123,"count":180,"type":"SCALAR"}}],
        "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}],"nodes":[{nodes}]}}"#
    )
}

/// An earlier version took 769 MiB for 32 million such triangles under `--memory 100M` before it refused them.
#[cfg(unix)]
#[test]
fn coincident_instances_are_refused_within_the_memory_limit() {
    let folder = tempfile::tempdir().unwrap();
    for places in [1, 60] {
        let document = coincident_instances(folder.path(), places);
        stays_within_memory(folder.path(), &format!("instances at {places}.gltf"), document);
        assert!(!folder.path().join("out.kilwa").exists(), "no chunk holds 2.4 million triangles");
    }
}
