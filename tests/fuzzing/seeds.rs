//! Seed files: the damaged and repaired ones of `tests/malformed`, and files that the program itself writes.

use crate::bodies::CHUNK_HEAD;
use crate::mutate::MAX_BYTES;
use kilwa_builder::{BuildOptions, Silent, build_pack};
use kilwa_formats::RawMesh;
use kilwa_pack::Reader;
use kilwa_pack::reader::SliceSource;
use std::path::Path;

/// The seeds of a target, in an order that is always the same.
pub(crate) fn of(target: &str) -> Vec<Vec<u8>> {
    let mut seeds = match target {
        "obj" => objs(),
        "open_pack" => packs(),
        "metadata" => metadata(),
        "manifest" => manifests(),
        "notes" => notes(),
        "decode_chunk" => packs().iter().flat_map(|pack| chunks(pack)).collect(),
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
