//! Archives made by hand: what is read, and every refusal.

#[path = "../../../../tests/support/zip.rs"]
#[allow(dead_code, reason = "other tests use the rest")]
mod zip;

use super::credits;
use crate::RawMesh;
use crate::Up;
use crate::read::texture::detail::Detail;
use crate::read::{
    MemorySink, ReadError, ReadOptions, note_detail, read_into_with, read_mesh, read_mesh_from, recognise,
};
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use zip::{Item, archive, archive64, deflated, ended, gltf, license, local, stored};

const OBJ: &str = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n";
const PLAIN: &str = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";

fn picture(color: [u8; 3]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    image::RgbImage::from_pixel(4, 4, image::Rgb(color)).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

/// The parts of a download of Sketchfab.
fn download() -> Vec<(&'static str, Vec<u8>)> {
    let (json, buffer) = gltf(Some("textures/fort_baseColor.png"), "{\"title\":\"Fort\"}");
    vec![
        ("license.txt", license("Fort", "CC-BY-4.0 (http://creativecommons.org/licenses/by/4.0/)").into_bytes()),
        ("scene.bin", buffer),
        ("scene.gltf", json.into_bytes()),
        ("textures/fort_baseColor.png", picture([200, 100, 50])),
    ]
}

fn items(parts: &[(&str, Vec<u8>)]) -> Vec<Item> {
    parts.iter().map(|(name, data)| deflated(name, data)).collect()
}

fn read(bytes: &[u8]) -> Result<RawMesh, ReadError> {
    read_mesh_from(Cursor::new(bytes), bytes.len() as u64, Path::new("a.zip"), &mut |_, _| {})
}

fn refusal(bytes: &[u8]) -> String {
    read(bytes).map(|mesh| mesh.triangles.len()).unwrap_err().to_string()
}

/// A mesh that is read, and a file that is wrong.
fn beside(item: Item) -> Vec<u8> {
    archive(&[stored("a.obj", PLAIN.as_bytes()), item])
}

#[test]
fn a_download_gives_the_same_mesh_as_its_unpacked_folder() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("textures")).unwrap();
    for (name, data) in download() {
        std::fs::write(folder.path().join(name), data).unwrap();
    }
    let unpacked = read_mesh(&folder.path().join("scene.gltf"), &mut |_, _| {}).unwrap();
    assert_eq!(unpacked.triangles.len(), 2);
    assert_eq!(unpacked.colors, [[200, 100, 50]; 4]);
    let mut all = items(&download());
    let zipped = folder.path().join("fort.zip");
    for stores in [false, true] {
        if stores {
            all = download().iter().map(|(name, data)| stored(name, data)).collect();
        }
        all.insert(1, Item { mode: 0o040_755, ..stored("textures/", b"") });
        std::fs::write(&zipped, archive(&all)).unwrap();
        assert_eq!(read_mesh(&zipped, &mut |_, _| {}).unwrap(), unpacked);
        let format = recognise(&zipped).unwrap();
        assert!(format.is_archive() && format.up == Up::Y);
        // With edges split by texels.
        let detail = || Some(Arc::new(Detail::new(1.0)));
        let split = |path: &Path| {
            let options = ReadOptions { detail: detail(), ..ReadOptions::default() };
            note_detail(path, &options, &mut |_, _| {}).unwrap();
            let mut sink = MemorySink::new(path);
            read_into_with(path, &options, &mut sink, &mut |_, _| {}).unwrap();
            sink.into_mesh().unwrap()
        };
        let finer = split(&zipped);
        assert!(finer.triangles.len() > 2 && finer == split(&folder.path().join("scene.gltf")));
    }
}

#[test]
fn lengths_may_follow_the_data_and_names_may_be_in_any_encoding() {
    let streamed: Vec<Item> =
        items(&download()).into_iter().map(|item| Item { has_descriptor: true, ..item }).collect();
    assert_eq!(read(&archive(&streamed)).unwrap().triangles.len(), 2);
    // "ä" and "ö" of Latin-1 are two names, although neither is UTF-8.
    let [one, other] = [b"\xe4.png", b"\xf6.png"].map(|name| Item { name: name.to_vec(), ..stored("x", b"x") });
    let mesh = stored("a.obj", PLAIN.as_bytes());
    assert_eq!(read(&archive(&[one.clone(), other, mesh.clone()])).unwrap().triangles.len(), 1);
    assert!(refusal(&archive(&[one.clone(), one, mesh])).contains("occurs twice"));
}

#[test]
fn archives_with_sizes_of_64_bits_are_read_and_lies_in_them_refused() {
    let expected = read(&archive(&items(&download()))).unwrap();
    for has_descriptor in [false, true] {
        let all: Vec<Item> = items(&download()).into_iter().map(|item| Item { has_descriptor, ..item }).collect();
        let whole = archive64(&all);
        assert_eq!(read(&whole).unwrap(), expected);
        for length in 4..whole.len() {
            let message = refusal(&whole[..length]);
            assert!(message.contains("truncated or damaged"), "{length}: {message}");
        }
    }
    let whole = archive64(&[deflated("a.obj", PLAIN.as_bytes())]);
    assert_eq!(read(&whole).unwrap().triangles.len(), 1);
    let of_entry = 4 + whole.windows(4).position(|bytes| bytes == [1, 0, 24, 0]).unwrap();
    let of_list = 24 + whole.windows(4).position(|bytes| bytes == b"PK\x06\x06").unwrap();
    let lies = [1 << 40, i64::MAX as u64, u64::MAX - 3, u64::MAX];
    let with = |place: usize, lie: u64| {
        let mut bytes = whole.clone();
        bytes[place..place + 8].copy_from_slice(&lie.to_le_bytes());
        bytes
    };
    for (place, found) in [
        (of_entry, "that inflate to"),
        // Compressed length, and where the entry begins.
        (of_entry + 8, "one after another"),
        (of_entry + 16, "one after another"),
        // How many entries, and where their list begins.
        (of_list, "as its end states"),
        (of_list + 24, "truncated or damaged"),
    ] {
        for lie in lies {
            let message = refusal(&with(place, lie));
            assert!(message.contains(found) && message.starts_with("a.zip"), "{place} {lie}: {message}");
        }
    }
    // The length of the list is not needed: its entries say where each ends.
    assert!(lies.iter().all(|lie| read(&with(of_list + 16, *lie)).is_ok_and(|mesh| mesh.triangles.len() == 1)));
}

#[test]
fn pictures_of_an_obj_are_found_where_sketchfab_puts_them() {
    let library = |name: &str| format!("newmtl m\nmap_Kd {name}\n").into_bytes();
    for name in ["a.png", "../textures/A.PNG", "C:\\maps\\a.png", "..\\..\\..\\a.png", "/home/a/a.png", "deep/a.png"] {
        let parts = [
            ("source/a.obj", OBJ.as_bytes().to_vec()),
            ("source/a.mtl", library(name)),
            ("textures/a.png", picture([1, 2, 3])),
        ];
        let mesh = read(&archive(&items(&parts))).unwrap();
        assert_eq!(mesh.colors, [[1, 2, 3]; 3], "{name}");
    }
    let parts = [("a.obj", OBJ.as_bytes().to_vec()), ("a.mtl", library("none.png"))];
    let mesh = read(&archive(&items(&parts))).unwrap();
    assert!(mesh.diagnostics.iter().any(|(kind, ..)| kind == "pictures left out"));
}

/// Whatever a mesh in an archive names, the disk is not asked.
#[test]
fn nothing_beside_the_archive_is_read() {
    let folder = tempfile::tempdir().unwrap();
    let site = folder.path().join("site");
    std::fs::create_dir(&site).unwrap();
    let (_, buffer) = gltf(None, "{}");
    for place in [folder.path().join("scene.bin"), site.join("scene.bin")] {
        std::fs::write(place, &buffer).unwrap();
    }
    let absolute = site.join("scene.bin").display().to_string();
    let zipped = site.join("a.zip");
    for allow_outside in [false, true] {
        for name in
            ["scene.bin", "../scene.bin", "../../scene.bin", "a.zip/../scene.bin", "%2e%2e/scene.bin", &absolute]
        {
            let json = gltf(None, "{}").0.replace("scene.bin", name);
            std::fs::write(&zipped, archive(&[deflated("scene.gltf", json.as_bytes())])).unwrap();
            let options = ReadOptions { allow_outside, ..ReadOptions::default() };
            let read = read_into_with(&zipped, &options, &mut MemorySink::new(&zipped), &mut |_, _| {});
            let message = read.unwrap_err().to_string();
            assert!(message.contains("buffers[0]") && message.contains("is not there"), "{name}: {message}");
        }
    }
}

#[test]
fn names_that_would_leave_the_folder_are_refused() {
    for (name, reason) in [
        ("/etc/passwd", "absolute"),
        ("../a.png", "upwards"),
        ("a/../../b.png", "upwards"),
        ("a/..", "upwards"),
        ("a\\b.png", "backslash"),
        ("..\\b.png", "backslash"),
        ("C:/a.png", "drive letter"),
        ("c:a.png", "drive letter"),
        ("a\0b", "zero byte"),
        ("", "no name"),
        ("./.", "no name"),
    ] {
        let message = refusal(&beside(stored(name, b"x")));
        assert!(message.contains(reason) && message.contains("a.zip"), "{name:?}: {message}");
    }
    let long = refusal(&beside(stored(&"a".repeat(5000), b"x")));
    assert!(long.contains("4096") && long.len() < 400, "{long}");
    assert!(read(&archive(&[stored("./a.obj", PLAIN.as_bytes())])).is_ok(), "a folder of its own is nothing bad");
    let mut item = stored("b", b"x");
    item.name = b"\xff\xfe".to_vec();
    assert!(read(&beside(item)).is_ok(), "names in other encodings are of no use, and no harm");
}

#[test]
fn encrypted_files_links_and_repeated_names_are_refused() {
    let made = |change: &dyn Fn(&mut Item)| {
        let mut item = stored("b.png", b"x");
        change(&mut item);
        refusal(&beside(item))
    };
    for flags in [1, 1 << 6 | 1, 1 << 13] {
        assert!(made(&|item| item.flags = flags).contains("encrypted"), "{flags}");
    }
    assert!(made(&|item| item.method = 99).contains("password"));
    assert!(made(&|item| item.mode = 0o120_777).contains("a link"));
    assert!(made(&|item| item.mode = 0o010_644).contains("a pipe"));
    assert!(made(&|item| item.name = b"a.obj".to_vec()).contains("occurs twice"));
    assert!(made(&|item| item.name = b"./a.obj".to_vec()).contains("occurs twice"));
}

/// What is changed in an archive, and how.
type Change<'a> = (&'a str, &'a dyn Fn(&mut Item));

#[test]
fn entries_that_are_not_what_is_stated_are_refused() {
    let damaged = |change: &dyn Fn(&mut Item)| {
        let mut item = deflated("a.obj", PLAIN.as_bytes());
        change(&mut item);
        refusal(&archive(&[item]))
    };
    let n = PLAIN.len() as u32;
    let changes: [Change<'_>; 9] = [
        ("more than 31 bytes", &|item| item.bytes = n - 1),
        ("of 33 bytes", &|item| item.bytes = n + 1),
        ("another checksum", &|item| item.crc ^= 1),
        ("a different name", &|item| item.local_name = Some(b"b.obj".to_vec())),
        ("method BZIP2", &|item| item.method = 12),
        ("method number 77", &|item| item.method = 77),
        ("not compressed", &|item| item.method = 0),
        ("damaged deflate stream", &|item| item.packed[0] = 0xff),
        ("inflate to 4294967294", &|item| item.bytes = u32::MAX - 1),
    ];
    for (found, change) in changes {
        let message = damaged(change);
        assert!(message.contains(found) && message.contains("a.obj"), "{found}: {message}");
    }
    // A picture is left out, a buffer is not.
    let (json, buffer) = gltf(None, "{}");
    let mut bin = deflated("scene.bin", &buffer);
    bin.crc ^= 1;
    let message = refusal(&archive(&[deflated("scene.gltf", json.as_bytes()), bin]));
    assert!(message.contains("buffers[0]") && message.contains("another checksum"), "{message}");
}

#[test]
fn overlapping_entries_and_bombs_are_refused() {
    // Two names for the same bytes.
    let item = deflated("a.obj", PLAIN.as_bytes());
    let other = Item { name: b"b.obj".to_vec(), ..item.clone() };
    let mut all = Vec::new();
    local(&item, &mut all);
    let message = refusal(&ended(all, &[item.clone(), other], &[0, 0]));
    assert!(message.contains("one after another"), "{message}");
    // One that reaches into the list of files.
    let mut all = Vec::new();
    local(&item, &mut all);
    let longer = Item { packed: vec![0; item.packed.len() + 1], ..item };
    assert!(refusal(&ended(all, &[longer], &[0])).contains("one after another"));
    // One that inflates a thousandfold.
    let bomb = deflated("a.obj", &vec![b' '; 20 << 20]);
    assert!(bomb.packed.len() < 30_000);
    assert!(refusal(&archive(&[bomb])).contains("at most 250"));
}

#[test]
fn the_mesh_must_be_the_only_one_or_the_scene_of_sketchfab() {
    let obj = |name: &str| stored(name, PLAIN.as_bytes());
    let message = refusal(&archive(&[obj("b/c.obj"), obj("a.OBJ")]));
    assert!(message.contains("2 meshes: a.OBJ, b/c.obj") && message.contains("Unpack it"), "{message}");
    let many: Vec<Item> = (0..30).map(|i| obj(&format!("{i:02}.obj"))).collect();
    assert!(refusal(&archive(&many)).contains("09.obj, …"));
    assert!(read(&archive(&[obj("a.obj"), obj("__MACOSX/a.obj"), obj("x/._a.obj"), obj("notes.txt")])).is_ok());
    let (json, buffer) = gltf(None, "{}");
    let scene = [stored("scene.gltf", json.as_bytes()), stored("scene.bin", &buffer), obj("source/a.obj")];
    assert_eq!(read(&archive(&scene)).unwrap().triangles.len(), 2);
    for (name, reason) in [
        ("source/fort.zip", "another archive instead of a mesh, \"source/fort.zip\""),
        ("source/fort.7z", "another archive"),
        ("source/fort.rar", "Unpack it and the archive in it"),
        ("source/fort.fbx", "choose glTF when downloading"),
        ("3D/3dmodel.model", "a 3MF model"),
        ("notes.txt", "contains no mesh (1 file: notes.txt)"),
    ] {
        let message = refusal(&archive(&[stored(name, b"x")]));
        assert!(message.contains(reason), "{name}: {message}");
    }
    assert!(refusal(&archive(&[])).contains("no mesh (0 files)"));
    let inner = archive(&[obj("a.obj")]);
    assert!(refusal(&archive(&[stored("scene.glb", &inner)])).contains("another archive instead"));
    let tiles = "{\"asset\":{\"version\":\"1.1\"},\"geometricError\":9,\"root\":{\"geometricError\":5}}";
    assert!(refusal(&archive(&[stored("scene.gltf", tiles.as_bytes())])).contains("3D Tiles"));
}

#[test]
fn an_archive_cut_at_any_byte_is_refused_without_a_panic() {
    let whole = archive(&items(&download()));
    for length in 4..whole.len() {
        let message = refusal(&whole[..length]);
        assert!(message.contains("truncated or damaged"), "{length}: {message}");
    }
    assert!(read(&whole).is_ok());
}

#[test]
fn an_archive_with_any_bit_flipped_is_read_or_refused() {
    let whole = archive(&items(&download()));
    let expected = read(&whole).unwrap();
    let mut differ = 0;
    for bit in (0..whole.len() * 8).step_by(3) {
        let mut bytes = whole.clone();
        bytes[bit / 8] ^= 1 << (bit % 8);
        // A bit of the list or of a picture may leave a mesh; a bit of the mesh never goes unnoticed.
        if let Ok(mesh) = read(&bytes) {
            assert_eq!((&mesh.positions, &mesh.triangles), (&expected.positions, &expected.triangles), "bit {bit}");
            differ += usize::from(mesh != expected);
        }
    }
    assert!(differ > 0, "pictures that cannot be read are left out");
}

fn written(items: &[Item]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("fort.zip");
    std::fs::write(&path, archive(items)).unwrap();
    (folder, path)
}

#[test]
fn a_download_states_its_rights_in_the_license_and_in_the_gltf() {
    let extras = "{\"author\":\"Amina Juma (https://sketchfab.com/amina)\",\"license\":\"CC-BY-4.0 (http://creativecommons.org/licenses/by/4.0/)\",\"source\":\"https://sketchfab.com/3d-models/fort-0123\",\"title\":\"Fort\",\"more\":{\"a\":[1,null]}}";
    let (json, buffer) = gltf(None, extras);
    let mut glb_json = json.replace("\"uri\":\"scene.bin\",", "");
    while !glb_json.len().is_multiple_of(4) {
        glb_json.push(' ');
    }
    let chunk = |kind: &[u8], data: &[u8]| [&(data.len() as u32).to_le_bytes()[..], kind, data].concat();
    let chunks = [chunk(b"JSON", glb_json.as_bytes()), chunk(b"BIN\0", &buffer)].concat();
    let glb = [&b"glTF\x02\0\0\0"[..], &(chunks.len() as u32 + 12).to_le_bytes(), &chunks].concat();
    let text = license("Fort", "CC-BY-4.0 (http://creativecommons.org/licenses/by/4.0/)");
    for (name, data) in [("scene.gltf", json.into_bytes()), ("scene.glb", glb)] {
        let (_folder, path) =
            written(&[deflated("license.txt", text.as_bytes()), deflated(name, &data), deflated("scene.bin", &buffer)]);
        let found = credits(&path).unwrap();
        assert_eq!(found.notes, Vec::<String>::new());
        let [(from, license), (asset, extras)] = found.statements.as_slice() else { panic!("{found:?}") };
        assert_eq!((from.as_str(), asset.clone()), ("license.txt", format!("asset.extras of {name}")));
        assert_eq!((&license.title, &license.author), (&extras.title, &extras.author));
        assert_eq!((&license.source, &license.license), (&extras.source, &extras.license));
        assert!(license.credit.is_some() && extras.credit.is_none());
    }
}

#[test]
fn a_license_that_cannot_be_read_is_noted_and_extras_may_have_any_form() {
    let notes = |license: Item, extras: &str| {
        let (json, buffer) = gltf(None, extras);
        let (_folder, path) =
            written(&[license, deflated("scene.gltf", json.as_bytes()), deflated("scene.bin", &buffer)]);
        credits(&path).unwrap()
    };
    let long = "a".repeat(70_000);
    assert!(notes(stored("License.TXT", long.as_bytes()), "{}").notes[0].contains("longer than"));
    assert!(notes(stored("license.txt", b"MIT"), "{}").notes[0].contains("not in Sketchfab's format"));
    for extras in
        ["{\"title\":5,\"author\":null,\"license\":[{}],\"source\":{\"a\":1}}", "{\"title\":true}", "{\"title\":\" \"}"]
    {
        let found = notes(stored("notes.txt", b""), extras);
        assert!(found.statements.is_empty() && found.notes.is_empty(), "{extras}: {found:?}");
    }
    for extras in ["5", "\"a\""] {
        assert!(notes(stored("notes.txt", b""), extras).notes[0].contains("asset of scene.gltf"), "{extras}");
    }
}
