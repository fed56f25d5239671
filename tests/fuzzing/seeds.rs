//! Seed files: the damaged and repaired ones of `tests/malformed`, and files that the program itself writes.

use crate::bodies::CHUNK_HEAD;
use crate::mutate::MAX_BYTES;
use crate::zip::{Item, archive, archive64, deflated, ended, gltf, license, local, stored};
use kilwa_builder::{BuildOptions, Silent, build_pack};
use kilwa_formats::RawMesh;
use kilwa_pack::Reader;
use kilwa_pack::reader::SliceSource;
use std::path::Path;

/// The seeds of a target, in an order that is always the same.
pub(crate) fn of(target: &str) -> Vec<Vec<u8>> {
    let mut seeds = match target {
        "obj" => objs(),
        "nexus" => nexus(),
        "tiles" => tiles(),
        "zip" => archives(),
        "open_pack" => packs().into_iter().chain([of_points()]).collect(),
        "metadata" => metadata(),
        "manifest" => manifests(),
        "notes" => notes(),
        // All codecs: new packs of surfaces have codec 2.
        "decode_chunk" => {
            packs().iter().chain([&of_format_1_0(), &of_points()]).flat_map(|pack| chunks(pack)).collect()
        }
        "ptx" => ptx(),
        "points" => points(),
        "e57" => e57s(),
        "las" => las_files(),
        "range_grid" => range_grids(),
        "survey" => surveys(),
        "photos" => photos(),
        "spool" => spools(),
        "mask" => masks(),
        "point_list" => point_lists(),
        "gltf" => [malformed("gltf"), malformed("glb")].concat(),
        other => malformed(other),
    };
    seeds.retain(|seed| seed.len() <= MAX_BYTES);
    seeds
}

/// All files of one kind.
fn malformed(extension: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/malformed");
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let mut files: Vec<_> = entries.filter(|p| p.extension().is_some_and(|e| e == extension)).collect();
    files.sort();
    files.iter().map(|path| std::fs::read(path).unwrap()).collect()
}

/// Every statement that the reader knows, and libraries behind a zero byte.
fn objs() -> Vec<Vec<u8>> {
    [
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0.5\nf 1 2 3\nf 2 4 3\n",
        "# a\nv 0 0 0 1 0.5 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nvn 0 0 1\nvt 0 0\nf 1/1/1 2/1/1 3/1/1\n",
        "o one\ng two three\ns off\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0.5 2 0\nf -5 -4 -3 -2 -1\nl 1 2\np 1\n",
        "mtllib a.mtl\nusemtl red\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\nusemtl none\nf 1//  2 3\n\0\
         newmtl red\nKd 1 0 0\nd 0.5\nTr 0.5\nmap_Kd -s 1 1 1 -o 0 0 0 -clamp on a.png\nnewmtl none\nKd spectral x\n",
        "v 1e3 -2.5E-2 +.5\r\nv 1. 0 0\r\nv 0 1 \\\r\n0\r\nf 1 2 \\\r\n3\r\nf 1 1 2\r\nf 1 2\r\nf 9 1 2\r\n",
        "v 0 0 0 1\nv 1 0 0 1\nv 0 1 0 1\nvp 0 0\ncstype bezier\ncurv 0 1 1 2\nf 1 2 3\ncall x\n",
        "v nan 0 0\nv 1 0 inf\nv 0 1 0\nv 1,5 0 0\nf 1 2 3\n",
    ]
    .map(|text| text.as_bytes().to_vec())
    .to_vec()
}

/// A Nexus model of one node with so many vertices and triangles, stored or compressed as `flags` say.
pub(crate) fn nexus_model(flags: u8, [vertices, triangles]: [usize; 2], node: &[u8]) -> Vec<u8> {
    let short = |n: usize| (n as u16).to_le_bytes();
    let mut bytes = b" sxN\x02\0\0\0".to_vec();
    bytes.extend([vertices as u64, triangles as u64].iter().flat_map(|n| n.to_le_bytes()));
    bytes.extend([7, 3]);
    bytes.resize(40, 0);
    bytes.extend([4, 3]);
    bytes.resize(56, 0);
    bytes.extend([flags, 0, 0, 0, 2, 0, 0, 0, 1, 0, 0, 0]);
    bytes.resize(88, 0);
    bytes.extend([1, 0, 0, 0]);
    bytes.extend([short(vertices), short(triangles)].as_flattened());
    bytes.resize(88 + 44, 0);
    let end = (256 + node.len()).next_multiple_of(256);
    bytes.extend((end as u32 / 256).to_le_bytes());
    bytes.resize(88 + 84, 0);
    bytes.extend([1, 0, 0, 0, 1, 0, 0, 0]);
    bytes.extend((triangles as u32).to_le_bytes());
    bytes.extend([0xff; 4]);
    bytes.resize(256, 0);
    bytes.extend(node);
    bytes.resize(end, 0);
    bytes
}

/// A strip of triangles in Corto without entropy coding: one attribute, one group, the CLERS codes, one list of bit lengths. `word` gives the bits of
/// the differences, 15 for each vertex but the first.
pub(crate) fn corto(triangles: usize, word: impl Fn(usize) -> [u8; 4]) -> Vec<u8> {
    let mut bytes = vec![0, 0x63, 0x7a, 0x78, 1, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 9, 0];
    bytes.extend(b"position\0\x01\0\0\0\0\0\0\x3f\x03\x06\x03");
    let vertices = triangles + 2;
    let number = |n: usize, into: &mut Vec<u8>| into.extend((n as u32).to_le_bytes());
    for n in [vertices, triangles, 1, triangles] {
        number(n, &mut bytes);
    }
    bytes.push(0);
    number(3 * triangles + 3, &mut bytes);
    number(triangles, &mut bytes);
    bytes.resize(bytes.len() + triangles, 0);
    number(0, &mut bytes);
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    let words = (15 * (vertices - 1)).div_ceil(32);
    number(words, &mut bytes);
    bytes.extend((0..words).flat_map(word));
    number(vertices, &mut bytes);
    bytes.push(0);
    bytes.resize(bytes.len() + vertices - 1, 5);
    bytes
}

/// A plain and a compressed Nexus model of one node with two triangles, and damaged ones.
fn nexus() -> Vec<Vec<u8>> {
    let positions = [[0f32, 0.0, 0.0], [4.0, 0.0, 0.0], [4.0, 4.0, 0.0], [8.0, 4.0, 0.0]];
    let mut plain: Vec<u8> = positions.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
    plain.extend([0u16, 1, 2, 2, 1, 3].iter().flat_map(|v| v.to_le_bytes()));
    let file = |flags: u8, node: &[u8]| nexus_model(flags, [4, 2], node);
    let compressed = corto(2, |word| [[0x42, 0x0c, 0x21, 0xc4], [0, 0, 0x80, 0x10]][word]);
    let mut many_nodes = file(0, &plain);
    many_nodes[56 + 4] = 200;
    // Two that are read, and three that are refused: MECO compression, a node of the wrong kind, and nodes beyond the end.
    vec![file(0, &plain), file(4, &compressed), file(2, &compressed), file(4, &plain), many_nodes]
}

/// A GLB of triangles without indices, whose JSON has this text behind its asset.
pub(crate) fn glb_of(extensions: &str, buffer: &[u8]) -> Vec<u8> {
    let (bytes, count) = (buffer.len(), buffer.len() / 12);
    let mut json = format!(
        "{{\"asset\":{{\"version\":\"2.0\"}},{extensions}\"buffers\":[{{\"byteLength\":{bytes}}}],\"bufferViews\":[{{\"buffer\":0,\"byteLength\":{bytes}}}],\
         \"accessors\":[{{\"bufferView\":0,\"componentType\":5126,\"count\":{count},\"type\":\"VEC3\"}}],\
         \"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0}}}}]}}],\"nodes\":[{{\"mesh\":0}}],\"scenes\":[{{\"nodes\":[0]}}],\"scene\":0}}"
    );
    while !json.len().is_multiple_of(4) {
        json.push(' ');
    }
    let chunk = |kind: &[u8], data: &[u8]| [&(data.len() as u32).to_le_bytes()[..], kind, data].concat();
    let chunks = [chunk(b"JSON", json.as_bytes()), chunk(b"BIN\0", buffer)].concat();
    [&b"glTF\x02\0\0\0"[..], &(chunks.len() as u32 + 12).to_le_bytes(), &chunks].concat()
}

/// A b3dm with this feature table.
pub(crate) fn b3dm_of(table: &str, glb: &[u8]) -> Vec<u8> {
    let words = [1, 28 + table.len() + glb.len(), table.len(), 0, 0, 0];
    let words = words.iter().flat_map(|word| (*word as u32).to_le_bytes());
    [&b"b3dm"[..], &words.collect::<Vec<u8>>(), table.as_bytes(), glb].concat()
}

/// Tilesets, each with the file that all its tiles name: a GLB, a b3dm, or another tileset.
fn tiles() -> Vec<Vec<u8>> {
    let buffer: Vec<u8> = [0f32, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0].iter().flat_map(|v| v.to_le_bytes()).collect();
    let glb = |extensions: &str| glb_of(extensions, &buffer);
    let b3dm = |table: &str| b3dm_of(table, &glb(""));
    let tileset = |root: &str| {
        format!("{{\"asset\":{{\"version\":\"1.1\"}},\"geometricError\":9,\"root\":{{\"geometricError\":5,{root}}}}}")
    };
    let leaf = "\"refine\":\"REPLACE\",\"content\":{\"uri\":\"b.glb\"}";
    let moved = "\"transform\":[1,0,0,0,0,1,0,0,0,0,1,0,5,6,7,1]";
    let children = format!(
        "\"refine\":\"ADD\",\"content\":{{\"url\":\"a.b3dm\"}},{moved},\"children\":[{{\"geometricError\":0,{moved},\"content\":{{\"uri\":\"a.b3dm\"}}}}]"
    );
    let many = "\"contents\":[{\"uri\":\"b.glb\"},{\"uri\":\"a.b3dm\"}]";
    let rtc = "\"extensionsUsed\":[\"CESIUM_RTC\"],\"extensions\":{\"CESIUM_RTC\":{\"center\":[6e6,1,2]}},";
    [
        (tileset(leaf), glb("")),
        (tileset(leaf), glb(rtc)),
        (tileset(&children), b3dm("{\"BATCH_LENGTH\":0,\"RTC_CENTER\":[1,2,3]} ")),
        (tileset(many), glb("")),
        (tileset("\"content\":{\"uri\":\"more.json\"}"), tileset(leaf).into_bytes()),
        (tileset("\"implicitTiling\":{\"subdivisionScheme\":\"OCTREE\"}"), Vec::new()),
    ]
    .map(|(json, content)| [json.as_bytes(), b"\0", &content].concat())
    .to_vec()
}

/// Downloads with a glTF or an OBJ, compressed and not, and archives that are refused.
fn archives() -> Vec<Vec<u8>> {
    let text = license("Fort", "CC-BY-4.0 (http://creativecommons.org/licenses/by/4.0/)");
    let (json, buffer) = gltf(Some("textures/a.png"), "{\"title\":\"Fort\",\"license\":\"Editorial\"}");
    let parts = [("license.txt", text.as_bytes()), ("scene.bin", &buffer), ("scene.gltf", json.as_bytes())];
    let obj = b"mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n";
    let source = [
        deflated("source/a.obj", obj),
        stored("source/a.mtl", b"newmtl m\nKd 1 0 0\nmap_Kd ..\\textures\\a.png\n"),
        stored("textures/a.png", b"no picture"),
    ];
    let mesh = deflated("a.obj", obj);
    let streamed = Item { has_descriptor: true, ..mesh.clone() };
    let mut overlapping = Vec::new();
    local(&mesh, &mut overlapping);
    vec![
        archive(&parts.map(|(name, data)| deflated(name, data))),
        archive(&parts.map(|(name, data)| stored(name, data))),
        archive(&source),
        archive64(&source),
        archive64(&[streamed]),
        archive(&[stored("source/a.zip", &archive(&source))]),
        archive(&[mesh.clone(), stored("../b", b"x")]),
        ended(overlapping, &[mesh.clone(), mesh], &[0, 0]),
    ]
}

/// What `kilwa metadata init` writes, all its examples, and files with mistakes.
fn metadata() -> Vec<Vec<u8>> {
    use kilwa_archive::metadata::template::{Known, write};
    let text = |t: &str| Some(t.to_owned());
    let known = Known { title: text("Fort"), rights: text("CC0"), units: text("m"), ..Known::default() };
    let is_example = |l: &str| {
        l.strip_prefix("# ")
            .is_some_and(|l| l.starts_with('[') || l.split_once(" = ").is_some_and(|(k, _)| !k.contains(' ')))
    };
    let all = write(&known);
    let examples: Vec<&str> = all.lines().map(|l| if is_example(l) { &l[2..] } else { l }).collect();
    let minimal = "title = \"Fort\"\n[rights]\nuri = \"InC\"\n[model]\nunits = \"m\"\n";
    [
        write(&Known::default()),
        all.clone(),
        examples.join("\n"),
        minimal.to_owned(),
        format!("{minimal}crs = \"EPSG:4326\"\n[place]\nlatitude = 1e99\n[[creators]]\n[capture]\ndate = \"2009/2008\"\naccuracy = -1\n"),
        format!("identifier = \"10.1/x\"\nlanguage = \"?\"\nurl = \"x\"\nslug = \"..\"\npublished = 2026\n{minimal}"),
        "title = Fort\nrights = 1".to_owned(),
        "title: Fort".to_owned(),
    ]
    .map(String::into_bytes)
    .to_vec()
}

/// Manifests and lists of checksums, right and wrong.
fn manifests() -> Vec<Vec<u8>> {
    let sum = "ab".repeat(32);
    let version = |n: u32| {
        format!(
            "{{\"version\":{n},\"folder\":\"v{n}\",\"published\":\"2026-11-21\",\"note\":\"n\",\"pack\":{{\"url\":\"v{n}/pack.{sum}.kilwa\",\"bytes\":5,\
             \"sha256\":\"{sum}\",\"identity\":\"{}\"}},\"checksums\":{{\"url\":\"v{n}/checksums.sha256\",\"bytes\":1,\"sha256\":\"{sum}\"}},\
             \"figures\":{{\"bounds\":[[0,0,0],[1,1,1]],\"units\":\"m\",\"source_units\":\"m\",\"triangles\":1,\"vertices\":3,\"spacing\":0.1}}}}",
            "cd".repeat(16)
        )
    };
    let manifest = |versions: &str, current: u32| {
        format!(
            "{{\"kilwa\":1,\"slug\":\"fort\",\"title\":\"Fort\",\"language\":\"en\",\"rights\":{{\"uri\":\"u\",\"label\":\"l\",\"short\":\"s\"}},\
             \"citation\":\"c\",\"access\":{{\"state\":\"public\"}},\"current\":{current},\"versions\":[{versions}],\
             \"page\":{{\"url\":\"index.html\",\"bytes\":1,\"sha256\":\"{sum}\"}},\"tool\":\"kilwa\"}}"
        )
    };
    [
        manifest(&version(1), 1),
        manifest(&format!("{},{}", version(1), version(2)), 2),
        manifest(&version(2), 2),
        manifest("", 0),
        format!("{sum}  a\n{sum}  metadata/dc.xml\n"),
        format!("{sum}  ../a\n{sum} *b\n"),
        format!("{sum}  a\n{sum}  a\n"),
    ]
    .map(String::into_bytes)
    .to_vec()
}

/// Web Annotations as the page and others write them, right and wrong.
fn notes() -> Vec<Vec<u8>> {
    let point = "{\"type\":\"PointSelector\",\"x\":1.5,\"y\":2,\"z\":-0.25}";
    let state = "[{\"type\":\"urn:kilwa:pack\",\"identity\":\"9c7c0123456789abcdef0123456789ab\"},\
        {\"type\":\"urn:kilwa:view\",\"camera\":[3.9,0.5,82,1,2,3,0],\"display\":{\"mode\":\"clay\"}}]";
    let target = format!("{{\"type\":\"SpecificResource\",\"source\":\"x\",\"selector\":{point},\"state\":{state}}}");
    let text =
        "{\"type\":\"TextualBody\",\"purpose\":\"describing\",\"format\":\"text/plain\",\"value\":\"Coral rag\"}";
    let link = "{\"type\":\"SpecificResource\",\"purpose\":\"linking\",\"source\":\"https://example.org/gate\"}";
    let one = format!(
        "{{\"id\":\"urn:uuid:1\",\"type\":\"Annotation\",\"label\":\"Gate\",\"created\":\"2026\",\"body\":[{text},{link}],\"target\":{target}}}"
    );
    let other = format!(
        "{{\"label\":{{\"sw\":[\"Lango\",\"2\"],\"en\":\"Gate\"}},\"creator\":[{{\"name\":\"M\"}},\"N\"],\"bodyValue\":\"565977\",\"target\":[{{\"selector\":[{point}]}}]}}"
    );
    let html = text.replace("plain", "html");
    [
        format!("{{\"@context\":\"http://www.w3.org/ns/anno.jsonld\",\"type\":\"AnnotationPage\",\"items\":[{one},{other}]}}"),
        format!("[{other},{{\"type\":\"Annotation\",\"target\":\"https://example.org/\"}}]"),
        one.clone(),
        format!("{{\"type\":\"AnnotationCollection\",\"first\":{{\"items\":[{one}]}}}}"),
        "{\"type\":\"AnnotationCollection\",\"first\":\"https://example.org/1\"}".to_owned(),
        one.replace("https://example.org/gate", "javascript:alert(1)"),
        one.replace(text, &html),
        one.replace("1.5", "1e999"),
        format!("[{one},{one}]"),
        "{\"type\":\"Feature\"}".to_owned(),
    ]
    .map(String::into_bytes)
    .to_vec()
}

/// A square with relief of `2 n n` triangles, with colours and a channel where wanted.
fn square(n: u32, colors: bool, channel: bool) -> RawMesh {
    let mut mesh = RawMesh::default();
    let mut values = Vec::new();
    for (i, j) in (0..=n).flat_map(|i| (0..=n).map(move |j| (i, j))) {
        let (x, y) = (f64::from(i) * 0.01, f64::from(j) * 0.01);
        mesh.positions.push(glam::DVec3::new(x, y, 0.02 * (x * 20.0).sin() * (y * 30.0).cos()));
        values.push((i * j) as f32);
        if colors {
            mesh.colors.push([(i * 7) as u8, (j * 5) as u8, (i + j) as u8]);
        }
    }
    if channel {
        mesh.scalars.push(("quality".to_owned(), values));
    }
    for (i, j) in (0..n).flat_map(|i| (0..n).map(move |j| (i, j))) {
        let at = |i: u32, j: u32| i * (n + 1) + j;
        mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
        mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
    }
    mesh
}

/// Small packs: one chunk, several levels, with and without attributes.
fn packs() -> Vec<Vec<u8>> {
    let build = |mesh: RawMesh, leaf_triangles: usize| {
        let options = BuildOptions { title: "seed".into(), threads: 1, leaf_triangles, ..BuildOptions::default() };
        build_pack(mesh, &options, &Silent).expect("builds").bytes
    };
    vec![
        build(square(2, false, false), 2048),
        build(square(8, true, false), 2048),
        build(square(12, true, true), 64),
        build(square(16, false, true), 32),
        build(square(20, true, false), 128),
    ]
}

/// A pack whose chunks have codec 1.
fn of_format_1_0() -> Vec<u8> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/compat/1.0-wall.kilwa");
    std::fs::read(path).expect("is there")
}

/// A pack of points, whose chunks have codec 3.
fn of_points() -> Vec<u8> {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/compat/1.2-points.kilwa");
    std::fs::read(path).expect("is there")
}

/// The chunks of a pack as the target takes them.
fn chunks(pack: &[u8]) -> Vec<Vec<u8>> {
    let reader = Reader::open(SliceSource(pack)).expect("opens");
    let attributes = reader.header().attributes;
    let chunk = |e: &kilwa_pack::DirectoryEntry| {
        let mut seed = Vec::with_capacity(CHUNK_HEAD + e.encoded_bytes as usize);
        seed.extend((e.vertices as u16).to_le_bytes());
        seed.extend((e.triangles as u16).to_le_bytes());
        seed.extend([u8::from(attributes.colors), attributes.scalars]);
        seed.extend(&pack[e.offset as usize..e.offset as usize + e.encoded_bytes as usize]);
        seed
    };
    reader.entries().iter().map(chunk).collect()
}

/// Scans with and without colours, several in a file, cut and lying ones.
fn ptx() -> Vec<Vec<u8>> {
    let header = "2\n2\n1 2 3\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n1 2 3 1\n";
    let plain = "1.5 -2 3e0 0.5\n0 0 0 0.5\n1 2 4 1\n1 2 5 0\n";
    let colored = "1 2 3 0.5 1 2 3\r\n0 0 0 0.5 0 0 0\r\n1 2 4 1 255 256 -1\r\n nan 1 2 3 4 5 6\r\n";
    [
        format!("{header}{plain}"),
        format!("{header}{colored}{header}{plain}"),
        format!("{header}1 2 3 0.5\n{header}{plain}"),
        format!("{header}{plain}1 2 3 4\n"),
        header.replace("2\n2\n", "4444\n10014\n"),
        header.replace("1 0 0 0", "2 0 0 0"),
    ]
    .map(String::into_bytes)
    .to_vec()
}

fn points() -> Vec<Vec<u8>> {
    [
        "2\n1 2 3 -12 1 2 3\n4 5 6 7 8 9 10\n1\n1 2 3\n",
        "X Y Z\n1 2 3\n4 5 6\n",
        "# a\n1,2,3,4\n\n4;5;6;1.#IND\n",
        "1 2 3 0 0.5 1\n1e4 2 3 0 0 1\n",
        "3\n1 2 3\n",
    ]
    .map(|text| text.as_bytes().to_vec())
    .to_vec()
}

fn range_grids() -> Vec<Vec<u8>> {
    let header = |format: &str| {
        format!(
            "ply\nformat {format} 1.0\nobj_info num_cols 2\nobj_info num_rows 2\nelement vertex 2\nproperty float x\nproperty float y\nproperty float z\nproperty float intensity\nelement range_grid 4\nproperty list uchar int vertex_indices\nend_header\n"
        )
    };
    let text = format!("{}0 0 1 0.5\n1 0 1 0.25\n1 0\n0\n1 1\n0\n", header("ascii"));
    let mut binary = header("binary_little_endian").into_bytes();
    for number in [0.0_f32, 0.0, 1.0, 0.5, 1.0, 0.0, 1.0, 0.25] {
        binary.extend(number.to_le_bytes());
    }
    binary.extend([1, 0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0]);
    let wrong = text.replace("num_cols 2", "num_cols 3");
    let cloud = "ply\nformat ascii 1.0\nelement vertex 1\nproperty double x\nproperty double y\nproperty double z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n1 2 3 4 5 6\n";
    vec![
        text.into_bytes(),
        binary,
        wrong.into_bytes(),
        cloud.as_bytes().to_vec(),
        b"ply\nformat ascii 1.0\nend_header\n".to_vec(),
    ]
}

/// Clouds of a few points, Cartesian and spherical, with and without a grid.
fn e57s() -> Vec<Vec<u8>> {
    use e57::{E57Writer, Record, RecordDataType, RecordName, RecordValue};
    let write = |prototype: Vec<Record>| {
        let mut file = std::io::Cursor::new(Vec::new());
        let mut writer = E57Writer::new(&mut file, "file").unwrap();
        let mut cloud = writer.add_pointcloud("cloud", prototype.clone()).unwrap();
        for k in 0..9 {
            let value = |record: &Record| match &record.data_type {
                RecordDataType::Single { .. } => RecordValue::Single(k as f32),
                RecordDataType::Double { .. } => RecordValue::Double(0.25 * k as f64),
                RecordDataType::Integer { max, .. } => RecordValue::Integer(k.min(*max)),
                RecordDataType::ScaledInteger { max, .. } => RecordValue::ScaledInteger(k.min(*max)),
            };
            cloud.add_point(prototype.iter().map(value).collect()).unwrap();
        }
        cloud.finalize().unwrap();
        writer.finalize().unwrap();
        drop(writer);
        file.into_inner()
    };
    let index = |name| Record { name, data_type: RecordDataType::Integer { min: 0, max: 8 } };
    let scaled = |name| Record {
        name,
        data_type: RecordDataType::ScaledInteger { min: -100, max: 100, scale: 0.01, offset: 1.0 },
    };
    let floats = vec![Record::CARTESIAN_X_F32, Record::CARTESIAN_Y_F32, Record::CARTESIAN_Z_F32];
    let doubles = vec![Record::SPHERICAL_RANGE_F64, Record::SPHERICAL_AZIMUTH_F64, Record::SPHERICAL_ELEVATION_F64];
    let scaled = [RecordName::CartesianX, RecordName::CartesianY, RecordName::CartesianZ].map(scaled).to_vec();
    let grid = vec![index(RecordName::RowIndex), index(RecordName::ColumnIndex)];
    let colors = vec![Record::COLOR_RED_U8, Record::COLOR_GREEN_U8, Record::COLOR_BLUE_U8, Record::INTENSITY_U16];
    vec![
        write(floats.clone()),
        write([doubles.clone(), vec![Record::SPHERICAL_INVALID_STATE]].concat()),
        write([floats.clone(), grid.clone()].concat()),
        write([scaled, colors.clone()].concat()),
        write([floats, colors, grid].concat()),
    ]
}

fn las_files() -> Vec<Vec<u8>> {
    let formats = [
        (2, 0, false),
        (2, 1, true),
        (2, 2, false),
        (4, 3, true),
        (4, 7, false),
        (4, 6, true),
        (4, 7, true),
        (4, 8, true),
        (4, 10, true),
    ];
    let write = |(minor, format, is_compressed)| {
        let mut builder = las::Builder::from((1, minor));
        builder.point_format = las::point::Format::new(format).unwrap();
        builder.point_format.is_compressed = is_compressed;
        let has_color = builder.point_format.has_color;
        let has_time = builder.point_format.has_gps_time;
        let (has_nir, has_waveform) = (builder.point_format.has_nir, builder.point_format.has_waveform);
        let mut writer = las::Writer::new(std::io::Cursor::new(Vec::new()), builder.into_header().unwrap()).unwrap();
        for k in 0..12_u16 {
            let color = has_color.then_some(las::Color { red: 9 * k, green: 7, blue: 3 });
            let gps_time = has_time.then_some(f64::from(k));
            let number = 1 + (k % 3) as u8;
            let point = las::Point {
                x: f64::from(k),
                return_number: number,
                number_of_returns: 3,
                color,
                gps_time,
                nir: has_nir.then_some(5 * k),
                waveform: has_waveform.then(Default::default),
                ..las::Point::default()
            };
            writer.write_point(point).unwrap();
        }
        writer.close().unwrap();
        writer.into_inner().unwrap().into_inner()
    };
    formats.map(write).to_vec()
}

/// Stations with and without a grid, by rows and by columns, round, flat, of parallel rays, and empty.
fn spools() -> Vec<Vec<u8>> {
    use glam::{DVec3, Vec3};
    use kilwa_scan::spool::{Layout, Writer};
    use kilwa_scan_core::{Grid, Kind, Rays, Sample, State};
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.scan");
    let write = |grid: Grid, is_grid: bool, rays: Rays, is_rich: bool| {
        let mut writer = Writer::create(&path).unwrap();
        for cell in (0..grid.cells()).filter(|cell| cell % 7 != 3) {
            let (line, at) = (cell / u64::from(grid.line_length()), cell % u64::from(grid.line_length()));
            let (sin, cos) = (line as f32 * std::f32::consts::TAU / grid.lines() as f32).sin_cos();
            let mut sample = Sample::measured(Vec3::new(cos, sin, at as f32 * 0.05));
            if is_rich {
                sample.intensity = cell as f32;
                sample.color = [cell as u8; 3];
                sample.state = State::new(if cell % 5 == 0 { Kind::NoReturn } else { Kind::Measured }, true, 1);
            }
            writer.put(cell, &sample).unwrap();
        }
        let (pending, _) = writer.finish(Layout { grid, is_grid, rays, origin: DVec3::new(1.0, 2.0, 3.0) }).unwrap();
        pending.commit(true).unwrap();
        std::fs::read(&path).unwrap()
    };
    vec![
        write(Grid::by_columns(20, 10), true, Rays::Central, true),
        write(Grid { columns: 6, rows: 4, by_rows: true }, true, Rays::Central, false),
        write(Grid { columns: 4, rows: 5, by_rows: true }, true, Rays::Parallel(DVec3::NEG_Z), true),
        write(Grid::by_columns(1, 50), false, Rays::Central, true),
        write(Grid::by_columns(40, 30), true, Rays::Central, false),
        write(Grid::by_columns(1, 1), true, Rays::Central, false),
    ]
}

fn surveys() -> Vec<Vec<u8>> {
    let station = "[[station]]\nname = \"north\"\nscan = \"stations/north.scan\"\nrotation = [1, 0, 0, 0]\ntranslation = [1, 2, 3]\ntranslation_sigma = 0.01\nrotation_sigma = 0.02\nfixed = true\n[station.source]\nfile = \"a.ptx\"\nbytes = 12\nblake3 = \"00\"\nnumber = 1\n";
    [
        "version = 1\n".to_owned(),
        format!("version = 1\ntitle = \"Fort\"\ncrs = \"EPSG:32737\"\n{station}"),
        format!("version = 1\n{station}[[control]]\nname = \"P\"\nstation = \"north\"\nat = [1, 2, 3]\nsigma = 0.1\n"),
        format!("version = 1\n{station}[[photograph]]\nfile = \"a.jpg\"\ncamera = {{ kind = \"spherical\", size = [8, 4], pixel = [0.1, 0.1] }}\n"),
        "version = 1\n[options.mesh]\nsubsample = 2\nmax_edge = 0.1\ngrazing = 80\nedge_factor = 2\n".to_owned(),
        format!("version = 1\n{station}[[station.mask]]\nname = \"mixed\"\nfile = \"stations/a.mask\"\non = false\nmade = \"--mixed\"\nposes = \"00\"\n"),
        format!("version = 2\n{station}{station}titel = 1\n"),
    ]
    .map(String::into_bytes)
    .to_vec()
}

/// A small file of every format with poses.
fn photos() -> Vec<Vec<u8>> {
    let matrix = "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1";
    let sensor = "<sensor id=\"0\" type=\"frame\"><resolution width=\"40\" height=\"30\"/><calibration type=\"frame\" class=\"adjusted\"><resolution width=\"40\" height=\"30\"/><f>50</f><cx>1</cx><k1>-0.1</k1><p1>0.001</p1></calibration></sensor>";
    let images = "# Number of images: 2\n1 1 0 0 0 0 0 5 1 a.jpg\n1 2 3\n2 0.5 0.5 0.5 0.5 1 2 3 2 b.jpg\n\n";
    let cameras = "# Camera list\n1 SIMPLE_RADIAL 40 30 50 20 15 0.1\n2 OPENCV_FISHEYE 40 30 50 50 20 15 0.1 0 0 0\n3 FULL_OPENCV 40 30 50 50 20 15 0 0 0 0 0 0 0 0\n";
    let bundle = "# Bundle file v0.3\n2 1\n50 -0.1 0.02\n1 0 0\n0 1 0\n0 0 1\n-1 -2 -3\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n0.5 0 0\n1 2 3\n1 0 7 0.5 -0.5\n";
    let metashape = format!(
        "<?xml version=\"1.0\"?>\n<document><chunk><sensors>{sensor}</sensors><components><component id=\"0\"><transform><rotation>1 0 0 0 1 0 0 0 1</rotation><translation>1 2 3</translation><scale>2</scale></transform></component></components><cameras><camera id=\"0\" sensor_id=\"0\" component_id=\"0\" label=\"a.jpg\"><transform>{matrix}</transform></camera></cameras><reference>LOCAL_CS[\"m\"]</reference></chunk></document>\n"
    );
    let meshlab = format!(
        "<!DOCTYPE MeshLabDocument>\n<MeshLabProject><RasterGroup><MLRaster label=\"a.jpg\"><VCGCamera TranslationVector=\"-1 -2 -3 1\" LensDistortion=\"0 0\" ViewportPx=\"40 30\" PixelSizeMm=\"0.1 0.1\" CenterPx=\"20 15\" FocalMm=\"5\" RotationMatrix=\"{matrix}\"/><Plane semantic=\"1\" fileName=\"a.jpg\"/></MLRaster></RasterGroup></MeshLabProject>\n"
    );
    let sidecar = "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"><rdf:RDF xmlns:rdf=\"http://www.w3.org/1999/02/22-rdf-syntax-ns#\"><rdf:Description xcr:DistortionModel=\"brown3t2\" xcr:FocalLength35mm=\"45\" xmlns:xcr=\"http://www.capturingreality.com/ns/xcr/1.1#\"><xcr:Rotation>1 0 0 0 0 -1 0 1 0</xcr:Rotation><xcr:Position>10 20 5</xcr:Position><xcr:DistortionCoeficients>-0.1 0.02 0 0 0 0</xcr:DistortionCoeficients></rdf:Description></rdf:RDF></x:xmpmeta>\n";
    let points = "# Number of points: 1\n7 0.5 0 0 1 2 3 0.1 1 0 2 0\n";
    let mut binary_camera =
        [1_u64.to_le_bytes(), [1, 0, 0, 0, 1, 0, 0, 0], 40_u64.to_le_bytes(), 30_u64.to_le_bytes()].concat();
    binary_camera.extend([50.0, 50.0, 20.0, 15.0_f64].iter().flat_map(|value| value.to_le_bytes()));
    let mut binary_image = [1_u64.to_le_bytes().as_slice(), &1_u32.to_le_bytes()].concat();
    binary_image.extend([1.0, 0.0, 0.0, 0.0, 1.0, 2.0, 3.0_f64].iter().flat_map(|value| value.to_le_bytes()));
    binary_image.extend([&1_u32.to_le_bytes()[..], b"a.jpg\0", &0_u64.to_le_bytes()].concat());
    let mut binary_point = [1_u64.to_le_bytes(), 7_u64.to_le_bytes()].concat();
    binary_point.extend([0.5, 0.0, 0.0_f64].iter().flat_map(|value| value.to_le_bytes()));
    binary_point.extend([&[1, 2, 3][..], &0.1_f64.to_le_bytes(), &1_u64.to_le_bytes(), &[0; 8]].concat());
    let text = |text: &str| text.as_bytes().to_vec();
    let files = [
        text(images),
        text(cameras),
        text(points),
        binary_image,
        binary_camera,
        binary_point,
        text(bundle),
        text(&metashape),
        text(&meshlab),
        text(sidecar),
    ];
    (0..).zip(files).map(|(choice, file)| [vec![choice], file].concat()).collect()
}

/// Masks as the program writes them, of grids with and without a whole last block.
fn masks() -> Vec<Vec<u8>> {
    use kilwa_scan::mask::MaskWriter;
    use kilwa_scan::spool::{Layout, Writer};
    use kilwa_scan_core::{Grid, Rays, Sample};
    let folder = tempfile::tempdir().unwrap();
    let grids = [(1, 1), (3, 3), (10, 80), (100, 90), (7, 1024), (1, 9000)];
    let made = grids.into_iter().map(|(columns, rows)| {
        let path = folder.path().join(format!("{columns}-{rows}"));
        let mut scan = Writer::create(&path).unwrap();
        scan.push(&Sample::EMPTY).unwrap();
        let grid = Grid::by_columns(columns, rows);
        let layout = Layout { grid, is_grid: true, rays: Rays::Central, origin: glam::DVec3::ZERO };
        let (_, header) = scan.finish(layout).unwrap();
        let mut mask = MaskWriter::create(&path, &header).unwrap();
        (0..grid.cells()).step_by(5).for_each(|cell| mask.mask(cell).unwrap());
        let (pending, _) = mask.finish().unwrap();
        std::fs::read(pending.temporary()).unwrap()
    });
    made.collect()
}

fn point_lists() -> Vec<Vec<u8>> {
    [
        "1\n2\n3\n",
        "# edited\n// by hand\nindex\n7\r\n8.000\r\n",
        "//X Y Z index\n1.5 2 -3 11.000000\n1,2,3,12\n",
        "0 1\n1 2\n\n2;3\n",
        "-1\n",
        "1e3\n99999999999999999999\n",
    ]
    .map(|text| text.as_bytes().to_vec())
    .to_vec()
}
