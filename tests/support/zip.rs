//! ZIP archives made by hand, so that every field can be wrong.

use std::io::Write as _;

/// An entry as it is written: each field goes into both headers unless it says otherwise.
#[derive(Clone)]
pub(crate) struct Item {
    pub(crate) name: Vec<u8>,
    /// The name in the header in front of the data.
    pub(crate) local_name: Option<Vec<u8>>,
    /// The data as they are in the archive.
    pub(crate) packed: Vec<u8>,
    pub(crate) bytes: u32,
    pub(crate) crc: u32,
    pub(crate) method: u16,
    pub(crate) flags: u16,
    /// Mode of Unix.
    pub(crate) mode: u32,
    /// Whether length and checksum follow the data instead of preceding them, as programs write that do not know them beforehand.
    pub(crate) has_descriptor: bool,
}

/// An entry that is compressed.
pub(crate) fn deflated(name: &str, data: &[u8]) -> Item {
    let mut packed = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::default());
    packed.write_all(data).unwrap();
    Item { packed: packed.finish().unwrap(), method: 8, ..stored(name, data) }
}

/// An entry that is not compressed.
pub(crate) fn stored(name: &str, data: &[u8]) -> Item {
    let mut sum = flate2::Crc::new();
    sum.update(data);
    Item {
        name: name.as_bytes().to_vec(),
        local_name: None,
        packed: data.to_vec(),
        bytes: data.len() as u32,
        crc: sum.sum(),
        method: 0,
        flags: 0,
        mode: 0o100_644,
        has_descriptor: false,
    }
}

/// The archive.
pub(crate) fn archive(items: &[Item]) -> Vec<u8> {
    let mut all = Vec::new();
    let mut places = Vec::new();
    for item in items {
        places.push(all.len() as u32);
        local(item, &mut all);
    }
    ended(all, items, &places)
}

/// The header and the data of an entry.
pub(crate) fn local(item: &Item, all: &mut Vec<u8>) {
    let name = item.local_name.as_ref().unwrap_or(&item.name);
    all.extend(b"PK\x03\x04\x14\0");
    if item.has_descriptor {
        const DESCRIPTOR: u16 = 8;
        let unknown = Item { flags: item.flags | DESCRIPTOR, crc: 0, bytes: 0, packed: Vec::new(), ..item.clone() };
        common(&unknown, name, all);
    } else {
        common(item, name, all);
    }
    all.extend(name);
    all.extend(&item.packed);
    if item.has_descriptor {
        all.extend(b"PK\x07\x08");
        for word in [item.crc, item.packed.len() as u32, item.bytes] {
            all.extend(word.to_le_bytes());
        }
    }
}

/// Entries, the list of them, and the end.
pub(crate) fn ended(mut all: Vec<u8>, items: &[Item], places: &[u32]) -> Vec<u8> {
    let directory = all.len() as u32;
    for (item, place) in items.iter().zip(places) {
        // Made by Unix.
        all.extend(b"PK\x01\x02\x14\x03\x14\0");
        let flags = if item.has_descriptor { item.flags | 8 } else { item.flags };
        common(&Item { flags, ..item.clone() }, &item.name, &mut all);
        all.extend([0; 6]);
        all.extend((item.mode << 16).to_le_bytes());
        all.extend(place.to_le_bytes());
        all.extend(&item.name);
    }
    let bytes = all.len() as u32 - directory;
    let count = (items.len() as u16).to_le_bytes();
    all.extend(b"PK\x05\x06\0\0\0\0");
    all.extend(count);
    all.extend(count);
    all.extend(bytes.to_le_bytes());
    all.extend(directory.to_le_bytes());
    all.extend([0; 2]);
    all
}

/// The archive as ZIP64, as programs write it that do not know beforehand how large it will be: all sizes, places and counts have 64 bits.
pub(crate) fn archive64(items: &[Item]) -> Vec<u8> {
    let (mut all, mut list) = (Vec::new(), Vec::new());
    for item in items {
        let place = all.len() as u64;
        let sizes = [u64::from(item.bytes), item.packed.len() as u64];
        let flags = if item.has_descriptor { item.flags | 8 } else { item.flags };
        let before = if item.has_descriptor { (0, [0; 2]) } else { (item.crc, sizes) };
        all.extend(b"PK\x03\x04\x2d\0");
        fields64(item, flags, before.0, 20, &mut all);
        all.extend(&item.name);
        extra64(&before.1, &mut all);
        all.extend(&item.packed);
        if item.has_descriptor {
            all.extend(b"PK\x07\x08");
            all.extend(item.crc.to_le_bytes());
            all.extend([sizes[1], sizes[0]].iter().flat_map(|size| size.to_le_bytes()));
        }
        list.extend(b"PK\x01\x02\x2d\x03\x2d\0");
        fields64(item, flags, item.crc, 28, &mut list);
        list.extend([0; 6]);
        list.extend((item.mode << 16).to_le_bytes());
        list.extend([0xff; 4]);
        list.extend(&item.name);
        extra64(&[sizes[0], sizes[1], place], &mut list);
    }
    let directory = all.len() as u64;
    all.extend(&list);
    let end = all.len() as u64;
    all.extend(b"PK\x06\x06");
    all.extend(44u64.to_le_bytes());
    all.extend([45, 3, 45, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
    for number in [items.len() as u64, items.len() as u64, list.len() as u64, directory] {
        all.extend(number.to_le_bytes());
    }
    all.extend(b"PK\x06\x07\0\0\0\0");
    all.extend(end.to_le_bytes());
    all.extend(1u32.to_le_bytes());
    all.extend(b"PK\x05\x06\0\0\0\0");
    all.extend([0xff; 12]);
    all.extend([0; 2]);
    all
}

/// As [`common`], with sizes that are in an extra field of so many bytes.
fn fields64(item: &Item, flags: u16, crc: u32, extra: u16, all: &mut Vec<u8>) {
    all.extend(flags.to_le_bytes());
    all.extend(item.method.to_le_bytes());
    all.extend([0; 4]);
    all.extend(crc.to_le_bytes());
    all.extend([0xff; 8]);
    all.extend((item.name.len() as u16).to_le_bytes());
    all.extend(extra.to_le_bytes());
}

/// The extra field of ZIP64.
fn extra64(numbers: &[u64], all: &mut Vec<u8>) {
    all.extend(1u16.to_le_bytes());
    all.extend((8 * numbers.len() as u16).to_le_bytes());
    all.extend(numbers.iter().flat_map(|number| number.to_le_bytes()));
}

/// Flags, method, time, sum, sizes and lengths.
fn common(item: &Item, name: &[u8], all: &mut Vec<u8>) {
    all.extend(item.flags.to_le_bytes());
    all.extend(item.method.to_le_bytes());
    all.extend([0; 4]);
    all.extend(item.crc.to_le_bytes());
    all.extend((item.packed.len() as u32).to_le_bytes());
    all.extend(item.bytes.to_le_bytes());
    all.extend((name.len() as u16).to_le_bytes());
    all.extend([0; 2]);
}

/// `license.txt` as Sketchfab writes it.
pub(crate) fn license(title: &str, license: &str) -> String {
    format!(
        "Model Information:\n* title:\t{title}\n* source:\thttps://sketchfab.com/3d-models/fort-0123\n* author:\tAmina Juma \
         (https://sketchfab.com/amina)\n\nModel License:\n* license type:\t{license}\n* requirements:\tAuthor must be credited. \
         Commercial use is allowed.\n\nIf you use this 3D model in your project be sure to copy paste this credit wherever you \
         share it:\nThis work is based on \"{title}\" (https://sketchfab.com/3d-models/fort-0123) by Amina Juma \
         (https://sketchfab.com/amina) licensed under {license}\n"
    )
}

/// A glTF of two triangles, textured if `picture` names a file, with its buffer in `scene.bin`, and that buffer. `extras` is JSON.
pub(crate) fn gltf(picture: Option<&str>, extras: &str) -> (String, Vec<u8>) {
    let positions: [f32; 12] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 1.0, 0.5];
    let coordinates: [f32; 8] = [0.1, 0.1, 0.9, 0.1, 0.9, 0.9, 0.1, 0.9];
    let mut buffer: Vec<u8> = positions.iter().chain(&coordinates).flat_map(|v| v.to_le_bytes()).collect();
    buffer.extend([0u16, 1, 2, 0, 2, 3].iter().flat_map(|v| v.to_le_bytes()));
    let material = picture.map_or_else(String::new, |picture| {
        format!(
            "\"images\":[{{\"uri\":\"{picture}\"}}],\"textures\":[{{\"source\":0}}],\
             \"materials\":[{{\"pbrMetallicRoughness\":{{\"baseColorTexture\":{{\"index\":0}}}}}}],"
        )
    });
    let uses = if picture.is_some() { ",\"material\":0" } else { "" };
    let json = format!(
        "{{\"accessors\":[{{\"bufferView\":0,\"componentType\":5126,\"count\":4,\"type\":\"VEC3\"}},\
         {{\"bufferView\":1,\"componentType\":5126,\"count\":4,\"type\":\"VEC2\"}},\
         {{\"bufferView\":2,\"componentType\":5123,\"count\":6,\"type\":\"SCALAR\"}}],\
         \"asset\":{{\"extras\":{extras},\"generator\":\"Sketchfab-12.68.0\",\"version\":\"2.0\"}},\
         \"buffers\":[{{\"uri\":\"scene.bin\",\"byteLength\":{}}}],\
         \"bufferViews\":[{{\"buffer\":0,\"byteLength\":48}},{{\"buffer\":0,\"byteOffset\":48,\"byteLength\":32}},\
         {{\"buffer\":0,\"byteOffset\":80,\"byteLength\":12}}],{material}\
         \"meshes\":[{{\"primitives\":[{{\"attributes\":{{\"POSITION\":0,\"TEXCOORD_0\":1}},\"indices\":2{uses}}}]}}],\
         \"nodes\":[{{\"mesh\":0}}],\"scenes\":[{{\"nodes\":[0]}}],\"scene\":0}}",
        buffer.len()
    );
    (json, buffer)
}
