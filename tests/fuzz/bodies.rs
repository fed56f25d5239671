//! What every fuzz target does with its bytes, for both runners: cargo-fuzz (`fuzz_targets/`, needs a nightly compiler) and
//! `tests/fuzzing`, which any compiler runs.
//!
//! Each body takes any bytes, must return, and panics if a property does not hold. What it returns distinguishes inputs that
//! took different paths: the kind of result, without its numbers.

use glam::{DVec2, DVec3};
use kilwa_archive::layout::safe;
use kilwa_archive::notes::Body as NoteBody;
use kilwa_archive::rights::Rights;
use kilwa_archive::{Checksums, Manifest, Metadata, Notes};
use kilwa_formats::read::{
    Input, MemorySink, MeshSink, ReadError, ReadOptions, VertexBlock, VertexSink, archive, gltf, nexus, obj,
    read_mesh_from, stl, tiles,
};
use kilwa_formats::{Diagnostics, RawMesh};
use kilwa_pack::chunk::{Declared, decode, encode};
use kilwa_pack::reader::SliceSource;
use kilwa_pack::{
    Attributes, ENTRIES_PER_PAGE, HEADER_BYTES, PAGE_BYTES, Reader, directory::ENTRY_BYTES, parse_head, verify,
};
use kilwa_scan::ScanError;
use kilwa_scan::mask::{self, MaskReader, read_list};
use kilwa_scan::mesh::{MeshVertex, Options as MeshOptions, Surface, mesh};
use kilwa_scan::panorama::{Show, WIDTH_MAX, pick, render};
use kilwa_scan::photos::Options as PhotoOptions;
use kilwa_scan::spool::Reader as Spool;
use kilwa_scan::survey::Survey;
use kilwa_scan_core::Pose;
use std::fmt::Display;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;

pub(crate) mod scans;

use scans::{e57_file, las_file, points_file, ptx_file, range_grid};

/// One target.
pub(crate) type Body = fn(&[u8]) -> String;

/// All targets by name.
pub(crate) const ALL: [(&str, Body); 22] = [
    ("ply", ply),
    ("obj", obj_file),
    ("stl", stl_file),
    ("gltf", gltf_file),
    ("nexus", nexus_file),
    ("tiles", tiles_in_folder),
    ("zip", archive_file),
    ("open_pack", open_pack),
    ("decode_chunk", decode_chunk),
    ("metadata", metadata),
    ("manifest", manifest),
    ("notes", notes),
    ("ptx", ptx_file),
    ("points", points_file),
    ("e57", e57_file),
    ("las", las_file),
    ("range_grid", range_grid),
    ("survey", survey),
    ("photos", photos),
    ("spool", spool),
    ("mask", mask_file),
    ("point_list", point_list),
];

/// The words of an error, without numbers, quotations, what was found in the file and
/// names at its end, so that the same complaint about another place is the same.
fn complaint(error: impl Display) -> String {
    let message = error.to_string();
    let message = message.rsplit_once(" expected ").map_or(message.as_str(), |(_, expected)| expected);
    let own = message.split(['"', '`']).step_by(2).flat_map(str::chars);
    own.filter(|c| c.is_ascii_alphabetic() || *c == ' ').take(45).collect()
}

/// Checks the properties that every reader guarantees of a mesh; returns what kind of mesh it is.
fn sound(mesh: &RawMesh) -> String {
    let n = mesh.positions.len();
    assert!(mesh.positions.iter().all(|p| p.is_finite()));
    assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < n));
    assert!(mesh.triangles.iter().all(|t| t[0] != t[1] && t[1] != t[2] && t[2] != t[0]));
    assert!(mesh.colors.is_empty() || mesh.colors.len() == n);
    assert!(mesh.normals.is_empty() || mesh.normals.len() == n);
    assert!(mesh.scalars.iter().all(|(_, values)| values.len() == n));
    let mut kind = format!("{} {} {}", mesh.colors.len().min(1), mesh.normals.len().min(1), mesh.scalars.len());
    for (diagnostic, _, _) in mesh.diagnostics.iter() {
        kind.push_str(diagnostic);
    }
    kind
}

/// Any bytes as a PLY: the reader ends, does not panic, and returns a sound mesh no larger than the file justifies.
pub(crate) fn ply(bytes: &[u8]) -> String {
    match read_mesh_from(Cursor::new(bytes), bytes.len() as u64, Path::new("fuzz.ply"), &mut |_, _| {}) {
        Ok(mesh) => {
            assert!(mesh.positions.capacity() * 24 + mesh.triangles.capacity() * 12 <= 100 * bytes.len());
            sound(&mesh)
        }
        Err(e) => complaint(e),
    }
}

/// The folder of this process.
static FOLDER: LazyLock<PathBuf> = LazyLock::new(|| {
    let folder = std::env::temp_dir().join(format!("kilwa-fuzz-obj-{}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder for libraries");
    folder
});

/// Any bytes as an OBJ, and what follows a zero byte as the library `a.mtl` beside it: the reader ends, does not panic,
/// and returns a sound mesh no larger than the file justifies.
pub(crate) fn obj_file(bytes: &[u8]) -> String {
    let (mesh, library) = match bytes.iter().position(|&b| b == 0) {
        Some(n) => (&bytes[..n], &bytes[n + 1..]),
        None => (bytes, &[][..]),
    };
    if !library.is_empty() {
        std::fs::write(FOLDER.join("a.mtl"), library).expect("a library is written");
    }
    let path = &FOLDER.join("fuzz.obj");
    let mut sink = MemorySink::new(path);
    let (options, total) = (ReadOptions::default(), mesh.len() as u64);
    let mut source = Cursor::new(mesh);
    let input = Input { path, total, source: &mut source, progress: &mut |_, _| {}, options: &options, archive: None };
    // Also what the format detection would not recognise as an OBJ.
    match obj::read(input, &mut sink).and_then(|()| sink.into_mesh()) {
        Ok(mesh) => {
            // A vertex takes 8 bytes ("v 0 0 0\n"), a corner of a face 2; with a colour for each face it becomes one vertex.
            assert!(mesh.positions.len() + mesh.triangles.len() <= bytes.len());
            sound(&mesh)
        }
        Err(e) => complaint(e),
    }
}

/// Any bytes as an STL: the reader ends, does not panic, and returns a sound mesh no larger than the file justifies.
pub(crate) fn stl_file(bytes: &[u8]) -> String {
    let path = Path::new("fuzz.stl");
    let mut sink = MemorySink::new(path);
    let (options, total) = (ReadOptions::default(), bytes.len() as u64);
    let mut source = Cursor::new(bytes);
    let input = Input { path, total, source: &mut source, progress: &mut |_, _| {}, options: &options, archive: None };
    // Also what the format detection would not recognise as an STL.
    match stl::read(input, &mut sink).and_then(|()| sink.into_mesh()) {
        Ok(mesh) => {
            // A text corner takes 13 bytes ("vertex 0 0 0 "), three positions make a facet, and fans deliver three for each.
            assert!(mesh.positions.len() <= bytes.len());
            sound(&mesh)
        }
        Err(e) => complaint(e),
    }
}

/// Collects the mesh, up to a limit.
struct Limited(MemorySink, u64);

impl Limited {
    fn spend(&mut self, n: usize) -> Result<(), ReadError> {
        self.1 = self.1.saturating_sub(n as u64);
        let full = || ReadError::TooLarge { file: PathBuf::new(), what: "enough for a fuzzer".to_owned() };
        if self.1 == 0 { Err(full()) } else { Ok(()) }
    }
}

impl VertexSink for Limited {
    fn channels(&mut self, names: &[String]) -> Result<(), ReadError> {
        self.0.channels(names)
    }
    fn vertices(&mut self, block: &VertexBlock<'_>) -> Result<(), ReadError> {
        let n = block.positions.len();
        assert!(block.colors.is_empty() || block.colors.len() == n);
        assert!(block.normals.is_empty() || block.normals.len() == n);
        self.spend(n)?;
        self.0.vertices(block)
    }
    fn vertex_count(&self) -> u64 {
        self.0.vertex_count()
    }
    fn diagnostics(&mut self) -> &mut Diagnostics {
        self.0.diagnostics()
    }
}

impl MeshSink for Limited {
    fn triangles(&mut self, triangles: &[[u64; 3]], colors: &[[u8; 3]]) -> Result<(), ReadError> {
        self.spend(triangles.len())?;
        assert!(triangles.iter().flatten().all(|v| *v < self.0.vertex_count()));
        self.0.triangles(triangles, colors)
    }
    fn positions(&mut self, of: &[u64], into: &mut Vec<DVec3>) -> Result<(), ReadError> {
        self.0.positions(of, into)
    }
}

/// Any bytes as a glTF or GLB: the reader ends, does not panic, and returns a sound mesh. A mesh shown by many nodes is
/// delivered for each, so that its size is not bounded by that of the file; the sink here ends the file when it is large.
pub(crate) fn gltf_file(bytes: &[u8]) -> String {
    let path = Path::new("/nowhere/fuzz.gltf");
    let mut sink = Limited(MemorySink::new(path), 1 << 20);
    let options = ReadOptions { texture_bytes: 1 << 22, ..ReadOptions::default() };
    let mut source = Cursor::new(bytes);
    let total = bytes.len() as u64;
    let input = Input { path, total, source: &mut source, progress: &mut |_, _| {}, options: &options, archive: None };
    match gltf::read(input, &mut sink).and_then(|()| sink.0.into_mesh()) {
        Ok(mesh) => sound(&mesh),
        Err(e) => complaint(e),
    }
}

/// Any bytes as a Nexus model: the reader ends, does not panic, and returns a sound mesh. A compressed node of a few bytes may
/// have 65535 triangles; the sink here stops reading when the mesh becomes large.
pub(crate) fn nexus_file(bytes: &[u8]) -> String {
    let path = Path::new("fuzz.nxz");
    let mut sink = Limited(MemorySink::new(path), 1 << 20);
    let options = ReadOptions { texture_bytes: 1 << 22, ..ReadOptions::default() };
    // What a build looks at before it reads.
    let start = &bytes[..bytes.len().min(1 << 16)];
    let head =
        nexus::head_bytes(start).map_or(bytes.len(), |n| bytes.len().min(usize::try_from(n).unwrap_or(usize::MAX)));
    let _ = nexus::sizes(&bytes[..head], bytes.len() as u64);
    let mut source = Cursor::new(bytes);
    let total = bytes.len() as u64;
    let input = Input { path, total, source: &mut source, progress: &mut |_, _| {}, options: &options, archive: None };
    match nexus::read(input, &mut sink).and_then(|()| sink.0.into_mesh()) {
        Ok(mesh) => sound(&mesh),
        Err(e) => complaint(e),
    }
}

/// Any bytes as a tileset and, after the first zero byte, the file of its tiles: the reader ends, does not panic, and returns a sound mesh.
pub(crate) fn tiles_in_folder(bytes: &[u8]) -> String {
    // Several tests call this side by side.
    thread_local! {
        static FOLDER: tempfile::TempDir = tempfile::tempdir().expect("a temporary folder");
    }
    let folder = FOLDER.with(|folder| folder.path().to_owned());
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    let (json, content) = (&bytes[..end], bytes.get(end + 1..).unwrap_or_default());
    for name in ["a.b3dm", "b.glb", "more.json"] {
        write(&folder.join(name), content);
    }
    let path = &folder.join("tileset.json");
    write(path, json);
    let mut sink = Limited(MemorySink::new(path), 1 << 20);
    let options = ReadOptions { texture_bytes: 1 << 22, ..ReadOptions::default() };
    // What a build looks at before it reads.
    let _ = tiles::sizes(path, &options);
    let mut source = Cursor::new(json);
    let total = json.len() as u64;
    let input = Input { path, total, source: &mut source, progress: &mut |_, _| {}, options: &options, archive: None };
    match tiles::read(input, &mut sink).and_then(|()| sink.0.into_mesh()) {
        Ok(mesh) => sound(&mesh),
        Err(e) => complaint(e),
    }
}

/// Any bytes as a ZIP archive with a mesh: the reader ends, does not panic, and returns a sound mesh; what the archive states about its rights
/// is read as well.
pub(crate) fn archive_file(bytes: &[u8]) -> String {
    let path = Path::new("fuzz.zip");
    let mut sink = Limited(MemorySink::new(path), 1 << 20);
    let options = ReadOptions { texture_bytes: 1 << 22, ..ReadOptions::default() };
    let (total, mut source) = (bytes.len() as u64, Cursor::new(bytes));
    let stated = archive::credits_from(&mut source, total, path);
    let stated =
        stated.map_or_else(complaint, |credits| format!("{} {}", credits.statements.len(), credits.notes.len()));
    source.set_position(0);
    let input = Input { path, total, source: &mut source, progress: &mut |_, _| {}, options: &options, archive: None };
    match archive::read(input, &mut sink).and_then(|()| sink.0.into_mesh()) {
        Ok(mesh) => stated + &sound(&mesh),
        Err(e) => stated + &complaint(e),
    }
}

/// A pack with its length and all hashes made to agree, where they lie inside it, as FORMAT sections 3, 4 and 7 place them:
/// otherwise they would stop the fuzzer at once.
fn agreeing(bytes: &[u8]) -> Vec<u8> {
    const FOOTER: usize = 80;
    let mut bytes = bytes.to_vec();
    let end = bytes.len();
    if end < HEADER_BYTES + FOOTER {
        return bytes;
    }
    let number = |bytes: &[u8], at: usize, n: usize| {
        bytes.get(at..at + n).map_or(0, |b| b.iter().rev().fold(0u64, |x, b| x << 8 | u64::from(*b))) as usize
    };
    let sum = |bytes: &[u8], from: usize, n: usize| bytes.get(from..from.saturating_add(n)).map(kilwa_pack::checksum);
    let length = number(&bytes, 80, 4);
    if let Some(sum) = sum(&bytes, number(&bytes, 72, 8), length) {
        bytes[88..104].copy_from_slice(&sum);
    }
    bytes[64..72].copy_from_slice(&(end as u64).to_le_bytes());
    let pages = number(&bytes, 84, 4).div_ceil(ENTRIES_PER_PAGE).min(end / PAGE_BYTES);
    let mut all = Vec::new();
    for page in 0..pages {
        let at = match page {
            0 => number(&bytes, 104, 8),
            _ => number(&bytes, 112, 8).saturating_add((page - 1) * PAGE_BYTES),
        };
        let Some(to) = at.checked_add(PAGE_BYTES).filter(|to| *to <= end) else { continue };
        for entry in (0..ENTRIES_PER_PAGE).map(|i| at + 128 + i * ENTRY_BYTES) {
            if let Some(sum) = sum(&bytes, number(&bytes, entry, 8), number(&bytes, entry + 8, 4)) {
                bytes[entry + 104..entry + 120].copy_from_slice(&sum);
            }
        }
        bytes[at + 16..at + 32].fill(0);
        let sum = kilwa_pack::checksum(&bytes[at..to]);
        bytes[at + 16..at + 32].copy_from_slice(&sum);
        all.extend(sum);
    }
    let hash = *blake3::hash(&bytes[..224]).as_bytes();
    bytes[224..256].copy_from_slice(&hash);
    bytes[end - 64..end - 32].copy_from_slice(&hash);
    bytes[end - 72..end - 64].copy_from_slice(&(end as u64).to_le_bytes());
    bytes[end - 32..].copy_from_slice(blake3::hash(&all).as_bytes());
    bytes
}

/// Any bytes as a pack: opening, decoding and verifying gives an error or a sound pack, never a panic; as it is, and with its
/// hashes made to agree.
pub(crate) fn open_pack(bytes: &[u8]) -> String {
    let as_it_is = open(bytes.to_vec());
    let mended = agreeing(bytes);
    if mended == bytes { as_it_is } else { open(mended) }
}

fn open(bytes: Vec<u8>) -> String {
    let _ = parse_head(&bytes);
    let reader = match Reader::open(SliceSource(bytes)) {
        Ok(reader) => reader,
        Err(e) => return complaint(e),
    };
    let mut kind = verify::directory(reader.entries()).map_or_else(complaint, |()| "open".to_owned());
    for index in 0..reader.header().entry_count {
        match reader.chunk(index).and_then(|chunk| verify::chunk(index, &chunk, reader.entries())) {
            Ok(_) => {}
            Err(e) => kind = complaint(e),
        }
    }
    kind
}

/// Bytes before the chunk itself: vertices and triangles (u16 each), colours, scalar channels.
pub(crate) const CHUNK_HEAD: usize = 6;

/// Any bytes as a chunk: decoding gives an error, or a chunk that encodes and decodes to the same geometry.
pub(crate) fn decode_chunk(bytes: &[u8]) -> String {
    let Some((&[v0, v1, t0, t1, colors, scalars], bytes)) = bytes.split_first_chunk::<CHUNK_HEAD>() else {
        return String::new();
    };
    let attributes = Attributes { colors: colors & 1 == 1, scalars: scalars % 20 };
    let declared =
        Declared { vertices: u16::from_le_bytes([v0, v1]).into(), triangles: u16::from_le_bytes([t0, t1]).into() };
    let chunk = match decode(bytes, declared, attributes) {
        Ok(chunk) => chunk,
        Err(e) => return complaint(e),
    };
    let again = encode(&chunk, attributes).expect("what decodes can be encoded");
    let back = decode(&again, declared, attributes).expect("what was encoded decodes");
    assert_eq!(back.canonical(), chunk.canonical());
    format!("{} patches", chunk.patches.len().min(9))
}

/// Any bytes as the metadata of a model: valid, with all properties of valid metadata, or refused with existing lines, in order.
pub(crate) fn metadata(bytes: &[u8]) -> String {
    let Ok(text) = std::str::from_utf8(bytes) else { return "no UTF-8".to_owned() };
    match Metadata::parse(text) {
        Ok(m) => {
            assert!(!m.title.is_empty() && m.title == m.title.trim() && !m.title.chars().any(char::is_control));
            assert_eq!(Rights::parse(&m.rights.uri).expect("rights are known").uri, m.rights.uri);
            let json = serde_json::to_string(&m).expect("is JSON");
            assert_eq!(serde_json::from_str::<Metadata>(&json).expect("reads back"), m);
            format!("right {} {} {}", m.creators.len(), m.related.len(), m.subjects.len().min(3))
        }
        Err(problems) => {
            let lines = text.split('\n').count();
            assert!(!problems.0.is_empty() && problems.0.iter().all(|p| (1..=lines).contains(&p.line)));
            assert!(problems.0.is_sorted_by_key(|p| p.line));
            problems.0.iter().take(3).map(|p| complaint(&p.message)).collect()
        }
    }
}

/// Any bytes as the manifest of an object and as a list of checksums: refused, or what it names stays in its folder and it reads back.
pub(crate) fn manifest(bytes: &[u8]) -> String {
    let of_manifest = match Manifest::parse(bytes) {
        Ok(m) => {
            let files = m.versions.iter().flat_map(|v| [&v.pack.url, &v.checksums.url]);
            assert!(files.chain([&m.page.url]).all(|url| safe(url)));
            assert_eq!(Manifest::parse(&m.to_bytes().expect("is written")).expect("reads back"), m);
            format!("right {}", m.versions.len())
        }
        Err(e) => complaint(e),
    };
    let list = std::str::from_utf8(bytes).map(Checksums::parse);
    let of_list = match list {
        Ok(Ok(list)) => {
            assert!(list.iter().all(|(path, sum)| safe(path) && sum.len() == 64));
            assert_eq!(Checksums::parse(&list.to_text()).expect("reads back"), list);
            format!("list {}", list.len().min(3))
        }
        Ok(Err(e)) => complaint(e),
        Err(_) => "no UTF-8".to_owned(),
    };
    format!("{of_manifest} {of_list}")
}

/// Any bytes as published notes: refused, or finite places, addresses that may be followed, and a form that reads back as the same bytes, with
/// its place and without.
pub(crate) fn notes(bytes: &[u8]) -> String {
    let notes = match Notes::parse(bytes) {
        Ok(notes) => notes,
        Err(e) => return complaint(e),
    };
    let (mut links, mut views) = (0, 0);
    for note in &notes.notes {
        assert!(note.place.is_finite());
        for body in &note.bodies {
            if let NoteBody::Link { address, .. } = body {
                let scheme = address.split("://").next().unwrap_or_default().to_ascii_lowercase();
                assert!(["http", "https"].contains(&scheme.as_str()), "{address}");
                links += 1;
            }
        }
        views += usize::from(note.view.is_some());
    }
    let (pack, identity) = ("pack.kilwa", "0123456789abcdef");
    let written = notes.to_bytes(pack, identity).expect("what was short stays short");
    let again = Notes::parse(&written).expect("reads back");
    assert_eq!(again.to_bytes(pack, identity).expect("is written again"), written);
    let hidden = notes.clone().without_place(DVec3::new(500_000.0, 9_000_000.0, 10.0), &[]);
    assert!(hidden.notes.iter().all(|n| n.links().next().is_none() && n.made_on.is_none()));
    // Without its links a note may be empty.
    if hidden.notes.iter().all(|n| n.label.is_some() || !n.bodies.is_empty()) {
        let written = hidden.to_bytes(pack, identity).expect("is written");
        let again = Notes::parse(&written).expect("reads back").without_place(DVec3::ZERO, &[]);
        assert_eq!(again.to_bytes(pack, identity).expect("is written again"), written);
    }
    let _ = notes.within(DVec3::ZERO, DVec3::splat(10.0));
    let location =
        kilwa_archive::location::Location::of([DVec3::splat(1e5), DVec3::splat(2e5)], Some("EPSG:32737"), None);
    let _ = notes.check_words(&location);
    format!(
        "{} notes {} left {} links {} views",
        notes.notes.len().min(3),
        notes.left_out.min(2),
        links.min(2),
        views.min(2)
    )
}

/// A file of this thread with these bytes: targets run side by side, each in a thread of its own.
fn file(bytes: &[u8], name: &str) -> PathBuf {
    static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| tempfile::tempdir().expect("a temporary folder"));
    let path = FOLDER.path().join(format!("{:?}-{name}", std::thread::current().id()));
    write(&path, bytes);
    path
}

fn write(path: &Path, bytes: &[u8]) {
    // A file that is made empty first is written to the disk at once by some file systems, which takes most of the time.
    let file = std::fs::File::options().write(true).create(true).truncate(false).open(path);
    let written = file.and_then(|mut file| {
        std::io::Write::write_all(&mut file, bytes)?;
        file.set_len(bytes.len() as u64)
    });
    written.expect("room for the file");
}

/// Any bytes as a `survey.toml`.
pub(crate) fn survey(bytes: &[u8]) -> String {
    match Survey::parse(&String::from_utf8_lossy(bytes)) {
        Ok(survey) => format!("{} stations", survey.stations.len().min(3)),
        Err(problems) => {
            assert!(problems.0.iter().all(|problem| problem.line > 0 && !problem.message.is_empty()));
            problems.0.first().map(complaint).unwrap_or_default()
        }
    }
}

/// Files with the poses of photographs; the first byte of an input chooses one.
pub(crate) const POSES: [&str; 10] = [
    "text/images.txt",
    "text/cameras.txt",
    "text/points3D.txt",
    "binary/images.bin",
    "binary/cameras.bin",
    "binary/points3D.bin",
    "bundler/bundle.out",
    "metashape/cameras.xml",
    "meshlab/a.mlp",
    "sidecars/a.xmp",
];

/// Any bytes as a file with the poses of photographs. The other files of its format are sound.
pub(crate) fn photos(bytes: &[u8]) -> String {
    static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| {
        let folder = tempfile::tempdir().expect("a temporary folder");
        for name in POSES {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().expect("a name in a folder")).expect("room for a folder");
        }
        std::fs::create_dir(folder.path().join("photos")).expect("room for a folder");
        write(&folder.path().join("bundler/list.txt"), b"a.jpg\nb.jpg\n");
        folder
    });
    const NO_RECORDS: [u8; 8] = [0; 8];
    let Some((choice, bytes)) = bytes.split_first() else { return "nothing".to_owned() };
    let name = POSES[usize::from(*choice) % POSES.len()];
    let format = name.split('/').next().unwrap_or(name);
    for other in POSES.iter().filter(|other| other.starts_with(format) && **other != name) {
        let cameras = "1 PINHOLE 40 30 50 50 20 15\n2 OPENCV 40 30 50 50 20 15 0.1 0 0 0\n";
        let sound = match *other {
            "text/cameras.txt" => cameras.as_bytes(),
            other if other.ends_with("bin") => &NO_RECORDS,
            _ => b"",
        };
        write(&FOLDER.path().join(other), sound);
    }
    let path = FOLDER.path().join(name);
    write(&path, bytes);
    let options = PhotoOptions { poses: Some(&path), stations: &[] };
    match kilwa_scan::photos::read(&FOLDER.path().join("photos"), &options) {
        Ok(set) => {
            assert!(set.photos.len() <= bytes.len() && set.sparse_points.len() <= bytes.len());
            for posed in set.photos.iter().filter_map(kilwa_scan::photos::PhotoRecord::posed) {
                assert!(posed.position().is_finite());
                if let Some(ray) = posed.ray(DVec2::from_array(posed.camera.size().map(f64::from)) * 0.5) {
                    assert!((ray.length() - 1.0).abs() < 1e-9, "{ray}");
                }
            }
            let missing = set.photos.iter().flat_map(|photo| &photo.missing).next();
            format!("{name} {} {}", set.photos.len().min(3), missing.map(complaint).unwrap_or_default())
        }
        Err(e) => {
            let message = e.to_string();
            assert!(!message.is_empty());
            format!("{name} {}", complaint(message))
        }
    }
}

/// Checks a mesh.
#[derive(Default)]
struct Mesh {
    vertices: u32,
    triangles: u64,
}

impl Surface for Mesh {
    fn vertex(&mut self, vertex: &MeshVertex) -> Result<u32, ScanError> {
        assert!(vertex.position.is_finite() && !vertex.confidence.is_nan());
        self.vertices += 1;
        Ok(self.vertices - 1)
    }

    fn triangle(&mut self, corners: [u32; 3]) -> Result<(), ScanError> {
        assert!(corners.iter().all(|corner| *corner < self.vertices));
        self.triangles += 1;
        Ok(())
    }
}

/// A spool with its hashes made to agree, where they lie in a file of this length: otherwise they would stop the fuzzer at once. The places are those of
/// `kilwa_scan::spool`.
fn hashed(bytes: &[u8]) -> Vec<u8> {
    const HEADER: usize = 256;
    const TABLE_HASH: usize = 148;
    const BLOCK: usize = 1024 * 20;
    let mut bytes = bytes.to_vec();
    if bytes.len() < HEADER {
        return bytes;
    }
    let number = |at: usize| u64::from(u32::from_le_bytes(bytes[at..at + 4].try_into().expect("four bytes")));
    let samples = number(16).checked_mul(number(20)).and_then(|cells| cells.checked_mul(20));
    let table = samples.and_then(|n| usize::try_from(n).ok()).and_then(|n| n.checked_add(HEADER));
    if let Some(table) = table.filter(|table| *table <= bytes.len()) {
        let hashes: Vec<u8> =
            bytes[HEADER..table].chunks(BLOCK).flat_map(|block| blake3::hash(block).as_bytes()[..8].to_vec()).collect();
        let end = bytes.len().min(table + hashes.len());
        bytes[table..end].copy_from_slice(&hashes[..end - table]);
        let sum = *blake3::hash(&bytes[table..]).as_bytes();
        bytes[TABLE_HASH..TABLE_HASH + 32].copy_from_slice(&sum);
    }
    let sum = *blake3::hash(&bytes[..HEADER - 32]).as_bytes();
    bytes[HEADER - 32..HEADER].copy_from_slice(&sum);
    bytes
}

/// Any bytes as the spool of a station, its hashes made right: refused, or all that a survey does with it ends without a panic.
pub(crate) fn spool(bytes: &[u8]) -> String {
    let path = file(&hashed(bytes), "a.scan");
    let mut reader = match Spool::open(&path) {
        Ok(reader) => reader,
        Err(e) => return complaint(e),
    };
    let header = *reader.header();
    assert!(header.grid.cells() > 0 && header.grid.cells() * 20 <= bytes.len() as u64 && header.origin.is_finite());
    let mut samples = Vec::new();
    if let Err(e) = reader.read(0, header.grid.cells() as usize, &mut samples) {
        return complaint(e);
    }
    assert!(samples.iter().all(|sample| sample.position.is_finite()));
    let pictures =
        [Show::Range, Show::Intensity, Show::Colour].map(|show| render(&mut reader, show, &mut [], 64).is_ok());
    if let Ok(picture) = render(&mut reader, Show::Range, &mut [], 64) {
        let last = picture.frame.size.map(|n| n - 1);
        for cell in [[0, 0], last] {
            let picked =
                pick(&mut reader, &picture.frame, cell, WIDTH_MAX).expect("a sound spool and a cell of its picture");
            assert!(
                picked.is_none_or(|picked| picked.cell.iter().zip(picture.frame.size).all(|(at, size)| *at < size))
            );
        }
    }
    let failed = |e: std::io::Error| ScanError::Request(e.to_string());
    let is_ptx =
        kilwa_scan::export::ptx(&mut reader, Pose::default(), None, &mut std::io::sink(), &failed, &mut |_, _| Ok(()));
    let mut surface = Mesh::default();
    match mesh(&mut reader, Pose::default(), &MeshOptions::default(), &mut surface) {
        Ok(report) => {
            assert_eq!((report.vertices, report.triangles), (u64::from(surface.vertices), surface.triangles));
            format!("{pictures:?} {} {} {}", is_ptx.is_ok(), surface.triangles.min(2), report.is_closed)
        }
        Err(e) => format!("{pictures:?} {} {}", is_ptx.is_ok(), complaint(e)),
    }
}

/// Any bytes as the file of a mask, as they are and with hashes that agree, so that what is behind them is reached: refused, or as many masked cells as
/// it says, none of them beyond the grid.
pub(crate) fn mask_file(bytes: &[u8]) -> String {
    let as_it_is = read_mask(bytes);
    let mut mended = bytes.to_vec();
    if bytes.len() < mask::HEADER_BYTES {
        return as_it_is;
    }
    let number = |at: usize| mended[at..at + 8].iter().rev().fold(0_u64, |x, b| x << 8 | u64::from(*b));
    let cells = number(16);
    let body = cells.div_ceil(8).saturating_add(mask::HEADER_BYTES as u64);
    if let Some(table) = usize::try_from(body).ok().filter(|at| *at <= mended.len()) {
        let hashes: Vec<u8> = mended[mask::HEADER_BYTES..table]
            .chunks(8192)
            .flat_map(|block| blake3::hash(block).as_bytes()[..8].to_vec())
            .collect();
        mended.truncate(table);
        mended.extend(&hashes);
        mended[64..96].copy_from_slice(blake3::hash(&hashes).as_bytes());
    }
    let hash = *blake3::hash(&mended[..96]).as_bytes();
    mended[96..128].copy_from_slice(&hash);
    if mended == bytes { as_it_is } else { read_mask(&mended) }
}

fn read_mask(bytes: &[u8]) -> String {
    static FOLDER: LazyLock<tempfile::TempDir> = LazyLock::new(|| tempfile::tempdir().expect("a temporary folder"));
    let path = FOLDER.path().join(format!("{:?}.mask", std::thread::current().id()));
    std::fs::write(&path, bytes).expect("room for the file");
    let read = MaskReader::open(&path, "fuzz").and_then(|mut mask| {
        let cells = mask.header().cells;
        let (mut at, mut masked) = (0, 0);
        while at < cells {
            let count = (cells - at).min(1000) as usize;
            mask.cells(at, count, &mut |cell| {
                assert!(cell < count);
                masked += 1;
            })?;
            at += count as u64;
        }
        assert!(mask.cells(cells, 1, &mut |_| {}).is_err());
        Ok((masked, mask.header().masked))
    });
    match read {
        Ok((found, told)) => format!("mask {} {}", found.min(3), found == told),
        Err(e) => complaint(e),
    }
}

/// Any bytes as a list of points: refused with a line of it, or indices, no more than there are lines.
pub(crate) fn point_list(bytes: &[u8]) -> String {
    let lines = bytes.split(|b| *b == b'\n').count() as u64;
    let read = |column| {
        let (mut found, mut before) = (0, 0);
        let done = read_list(Path::new("a.txt"), &mut &bytes[..], column, &mut |_, line| {
            assert!(before < line && line <= lines);
            before = line;
            found += 1_u64;
            Ok(())
        });
        match done {
            Ok(()) => format!("{} points", found.min(3)),
            Err(e) => complaint(e),
        }
    };
    format!("{} {}", read(None), read(Some(2)))
}
