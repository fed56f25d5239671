//! Header, directory, metadata, footer: what is written is read back, and nothing else is accepted.

use glam::DVec3;
use kilwa_geometry::Sphere;
use kilwa_pack::directory::{parse_page, round_up, write_page};
use kilwa_pack::verify::{self, Totals};
use kilwa_pack::{
    Attributes, DirectoryEntry, HEAD_BYTES, Header, PackError, PackWriter, Reader, SliceSource, Source, checksum,
    parse_head,
};

const COLORED: Attributes = Attributes { colors: true, scalars: 0 };

/// Open, decode and verify everything, as `kilwa verify` does.
fn verify_all(bytes: &[u8]) -> Result<(), PackError> {
    let reader = Reader::open(SliceSource(bytes))?;
    verify::directory(reader.entries())?;
    verify::order(reader.header(), reader.entries())?;
    let mut totals = Totals::default();
    for i in 0..reader.header().entry_count {
        totals = totals.plus(verify::chunk(i, &reader.chunk(i)?, reader.entries())?);
    }
    let mut metadata = reader.metadata().clone();
    // The test's metadata knows neither.
    metadata.border_edges = totals.finest_borders;
    metadata.bounds_min = reader.header().lattice.world_from_lattice(totals.finest_bounds.min);
    metadata.bounds_max = reader.header().lattice.world_from_lattice(totals.finest_bounds.max);
    totals.agree(reader.header(), &metadata)
}

/// A header with a correct hash and any contents.
fn forged(bytes: &[u8], change: impl Fn(&mut [u8])) -> Vec<u8> {
    let mut out = bytes.to_vec();
    change(&mut out);
    let hash = blake3::hash(&out[..224]);
    out[224..256].copy_from_slice(hash.as_bytes());
    out
}

/// As [`forged`], with a footer that agrees: a sound pack but for what was changed.
pub(crate) fn forged_with_footer(bytes: &[u8], change: impl Fn(&mut [u8])) -> Vec<u8> {
    let mut out = forged(bytes, change);
    let footer = out.len() - 80;
    out.copy_within(224..256, footer + 16);
    out
}

#[test]
fn a_chunk_of_a_codec_that_the_header_does_not_announce_is_refused() {
    let bytes = crate::common::pack(3, 6, COLORED);
    let unannounced = forged_with_footer(&bytes, |b| b[16..24].fill(0));
    let reader = Reader::open(SliceSource(unannounced)).expect("opens");
    let message = reader.chunk(1).expect_err("refused").to_string();
    assert!(message.contains("chunk 1") && message.contains("does not announce"), "{message}");
}

#[test]
fn a_pack_round_trips() {
    let attributes = Attributes { colors: true, scalars: 1 };
    let bytes = crate::common::pack(300, 6, attributes);
    let reader = Reader::open(SliceSource(&bytes)).expect("opens");
    assert_eq!(reader.entries().len(), 300);
    assert_eq!(*reader.metadata(), crate::common::metadata(attributes, reader.header().triangles));
    assert_eq!(Header::parse(&reader.header().to_bytes()).expect("parses"), *reader.header());
    for i in 0..300 {
        assert_eq!(reader.chunk(i).expect("decodes").mesh.triangle_count(), 72);
    }
    verify_all(&bytes).expect("sound");
}

#[test]
fn one_request_is_enough_for_a_first_picture() {
    // Metadata as long as possible: 64 KiB.
    let mut metadata = crate::common::metadata(COLORED, 32);
    metadata.title = "x".repeat(64_000);
    let chunk = crate::common::height_field(8, 1, 1, COLORED);
    let encoded = kilwa_pack::chunk::encode(&chunk, COLORED).expect("encodes");
    let entries: Vec<_> = (0..400u32)
        .map(|i| {
            let (error, parents) = if i == 0 { (f32::INFINITY, vec![]) } else { (1.0, vec![0]) };
            crate::common::entry_of(&chunk, &encoded, u8::from(i > 0), error, &parents)
        })
        .collect();
    let mut writer =
        PackWriter::begin(Vec::new(), crate::common::header(COLORED, 32), &metadata, entries.clone()).expect("begins");
    for _ in 0..400 {
        writer.chunk(&encoded).expect("writes");
    }
    let bytes = writer.finish().expect("finishes");
    assert!(bytes.len() as u64 > HEAD_BYTES);
    let head = parse_head(&bytes[..HEAD_BYTES as usize]).expect("the head is complete");
    assert_eq!(head.entries.len(), 127);
    let inside = head.entries.iter().filter(|e| e.offset + u64::from(e.encoded_bytes) <= HEAD_BYTES).count();
    assert!(inside > 50, "the coarsest chunks lie in the head: {inside}");
    let reader = Reader::open(SliceSource(&bytes)).expect("opens");
    let first_beyond = &reader.entries()[inside..].iter().map(|e| e.offset).min().expect("some lie beyond");
    assert!(*first_beyond > reader.header().other_pages, "the other pages lie between the two runs of chunks");
    assert_eq!(head.entries, reader.entries()[..127]);
    for i in 0..400 {
        reader.chunk(i).expect("decodes");
    }

    metadata.title = "x".repeat(66_000);
    let refused = PackWriter::begin(Vec::new(), crate::common::header(COLORED, 32), &metadata, entries).err();
    assert!(refused.expect("refused").to_string().contains("shorten"));
}

#[test]
fn a_truncated_header_reports_how_many_bytes_are_needed() {
    let bytes = crate::common::pack(5, 3, COLORED);
    let needed = {
        let header = Header::parse(&bytes).expect("header");
        header.first_page + 16_384
    };
    for length in (256..needed).step_by(997) {
        match parse_head(&bytes[..length as usize]) {
            Err(PackError::Truncated { needed: reported, available, .. }) => {
                assert_eq!((reported, available), (needed, length));
            }
            other => panic!("{other:?}"),
        }
    }
    parse_head(&bytes[..needed as usize]).expect("enough");
}

#[test]
fn any_prefix_of_the_directory_is_a_coarser_tree() {
    let reader = Reader::open(SliceSource(crate::common::pack(300, 3, COLORED))).expect("opens");
    for (i, e) in reader.entries().iter().enumerate().skip(1) {
        assert!(e.parents().count() > 0 && e.parents().all(|p| (p as usize) < i));
    }
    assert!(reader.entries().windows(2).all(|w| w[0].offset < w[1].offset && w[0].level <= w[1].level));
}

#[test]
fn every_flipped_bit_is_detected_and_names_a_part() {
    let bytes = crate::common::pack(3, 2, COLORED);
    let header = Header::parse(&bytes).expect("header");
    let padding = header.metadata.0 + u64::from(header.metadata.1)..header.first_page;
    let empty_tail = header.first_page + 128 + 3 * 128..header.first_page + 16_384;
    for at in 0..bytes.len() {
        // In the unused tail of the page, one bit per byte is enough.
        let bits = if empty_tail.contains(&(at as u64)) { 1 } else { 8 };
        for bit in 0..bits {
            let mut damaged = bytes.clone();
            damaged[at] ^= 1 << bit;
            match verify_all(&damaged) {
                Ok(()) => assert!(padding.contains(&(at as u64)), "byte {at} bit {bit} went unnoticed"),
                Err(e) => {
                    let message = e.to_string();
                    let parts = ["not a Kilwa pack", "header", "metadata", "directory page 0", "chunk ", "footer"];
                    assert!(parts.iter().any(|p| message.contains(p)), "{message}");
                }
            }
        }
    }
}

#[test]
fn every_truncation_and_every_extension_is_detected() {
    let bytes = crate::common::pack(3, 2, COLORED);
    for length in 0..bytes.len() {
        assert!(verify_all(&bytes[..length]).is_err(), "{length}");
    }
    let mut longer = bytes.clone();
    longer.push(0);
    assert!(verify_all(&longer).expect_err("refused").to_string().contains("follows its end"));
}

/// A source that counts the bytes requested and panics at absurd requests.
struct Guarded<'a>(&'a [u8]);

impl Source for Guarded<'_> {
    fn len(&self) -> std::io::Result<u64> {
        Ok(self.0.len() as u64)
    }

    fn read_at(&self, offset: u64, length: usize) -> std::io::Result<Vec<u8>> {
        assert!(length <= self.0.len(), "{length} bytes asked for at {offset}");
        SliceSource(self.0).read_at(offset, length)
    }
}

#[test]
fn hostile_counts_are_refused_before_anything_is_read_for_them() {
    let bytes = crate::common::pack(3, 2, COLORED);
    let u64_fields = [64, 72, 104, 112, 120, 128, 136];
    for at in u64_fields {
        for value in [1u64 << 63, u64::MAX, 1 << 40, 0] {
            let forged = forged(&bytes, |b| b[at..at + 8].copy_from_slice(&value.to_le_bytes()));
            assert!(Reader::open(Guarded(&forged)).is_err(), "field at {at} = {value}");
            let _ = parse_head(&forged);
        }
    }
    for at in [56, 60, 80, 84] {
        for value in [u32::MAX, 1 << 31, 1 << 20, 0] {
            let forged = forged(&bytes, |b| b[at..at + 4].copy_from_slice(&value.to_le_bytes()));
            assert!(Reader::open(Guarded(&forged)).is_err(), "field at {at} = {value}");
        }
    }
}

/// A hostile writer makes the hashes correct, so the checks of values must suffice alone.
#[test]
fn forged_directories_with_right_hashes_never_panic() {
    let bytes = crate::common::pack(5, 3, COLORED);
    let page = Header::parse(&bytes).expect("header").first_page as usize;
    let mut random = fastrand::Rng::with_seed(5);
    let (mut opened, mut refused) = (0, 0);
    for _ in 0..3000 {
        let mut forged = bytes.clone();
        for _ in 0..=random.u64(..3) {
            let at = page + 128 + random.u64(..5 * 128) as usize;
            forged[at] = [0, 1, 0x7f, 0x80, 0xff, random.u8(..)][random.u64(..6) as usize];
        }
        forged[page + 16..page + 32].fill(0);
        let sum = checksum(&forged[page..page + 16_384]);
        forged[page + 16..page + 32].copy_from_slice(&sum);
        let end = forged.len();
        forged[end - 32..].copy_from_slice(blake3::hash(&sum).as_bytes());
        let _ = parse_head(&forged);
        match Reader::open(Guarded(&forged)) {
            Ok(reader) => {
                opened += 1;
                for cut in [
                    kilwa_pack::Cut::finest(reader.entries()),
                    kilwa_pack::Cut::for_error(reader.entries(), 0.3),
                    kilwa_pack::Cut::random(reader.entries(), 1, 3),
                ] {
                    assert!(cut.is_valid(reader.entries()), "errors are monotone in everything that opens");
                }
                let _ = verify_all(&forged);
            }
            Err(_) => refused += 1,
        }
    }
    assert!(opened > 100 && refused > 100, "{opened} opened, {refused} refused");
}

#[test]
fn an_unknown_required_feature_is_refused_by_its_number() {
    let bytes = crate::common::pack(2, 2, COLORED);
    for bit in [2u32, 5, 37, 63] {
        let forged = forged(&bytes, |b| b[16..24].copy_from_slice(&(1u64 << bit).to_le_bytes()));
        let e = Reader::open(SliceSource(forged)).err().expect("refused");
        assert!(e.to_string().contains(&format!("feature bit {bit},")), "{e}");
    }
    let optional = forged(&bytes, |b| b[24..32].fill(0xff));
    assert!(matches!(Reader::open(SliceSource(optional)), Err(PackError::Invalid { what, .. }) if what == "footer"));
}

#[test]
fn another_major_version_is_refused_by_its_number_and_a_minor_one_read() {
    let bytes = crate::common::pack(2, 2, COLORED);
    let minor = forged(&bytes, |b| b[10..12].copy_from_slice(&7u16.to_le_bytes()));
    assert_eq!(Header::parse(&minor[..256]).expect("is read").entry_count, 2);
    let major = forged(&bytes, |b| b[8..12].copy_from_slice(&[2, 0, 7, 0]));
    assert!(Reader::open(SliceSource(major)).err().expect("refused").to_string().contains("2.7"));
}

#[test]
fn files_of_other_formats_are_refused_as_packs() {
    for bytes in [&b""[..], b"ply\nformat ascii 1.0\n", b"KILWA", b"KILWAPCX", &[0; 1000]] {
        let e = Reader::open(SliceSource(bytes)).err().expect("refused");
        assert!(matches!(e, PackError::Magic | PackError::Truncated { .. }), "{e}");
    }
}

#[test]
fn pages_of_another_pack_are_detected() {
    let a = crate::common::pack(300, 2, COLORED);
    let b = crate::common::pack(300, 3, COLORED);
    let (ha, hb) = (Header::parse(&a).expect("header"), Header::parse(&b).expect("header"));
    let mut mixed = a.clone();
    let (to, from) = (ha.page_range(1).0 as usize, hb.page_range(1).0 as usize);
    mixed[to..to + 16_384].copy_from_slice(&b[from..from + 16_384]);
    assert!(Reader::open(SliceSource(mixed)).is_err());
}

#[test]
fn errors_and_spheres_survive_the_file_without_shrinking() {
    for x in [0.0, 1e-12, 0.1, 1.0 / 3.0, 123.456, 1e38, 1e300] {
        let up = round_up(x);
        assert!(f64::from(up) >= x, "{x} {up}");
        assert!(up == 0.0 || up.is_infinite() || f64::from(up.next_down()) < x, "{up} is the nearest above {x}");
    }
    assert_eq!(round_up(0.5), 0.5);
    let chunk = crate::common::height_field(2, 1, 1, COLORED);
    let mut outer = crate::common::entry_of(&chunk, &[1], 0, f32::INFINITY, &[]);
    let mut inner = crate::common::entry_of(&chunk, &[1], 0, 0.25, &[0]);
    inner.sphere = Sphere { center: DVec3::new(1.0 / 3.0, 2e9 / 7.0, 1e-9), radius: 1e5 / 3.0 };
    outer.sphere = inner.sphere.union(&Sphere { center: DVec3::new(77.1, 3e8, 5.0), radius: 12.3 });
    outer.offset = 1 << 40;
    let back = parse_page(&write_page(&[outer.clone(), inner.clone()], 0), 0, 2).expect("parses");
    assert_eq!(back, [outer, inner], "bit for bit: what contained before contains now");
    assert!(back[0].sphere.contains(&back[1].sphere, 0.0));
}

#[test]
fn the_writer_refuses_what_a_reader_would() {
    let chunk = crate::common::height_field(2, 1, 1, COLORED);
    let encoded = kilwa_pack::chunk::encode(&chunk, COLORED).expect("encodes");
    let root = crate::common::entry_of(&chunk, &encoded, 0, f32::INFINITY, &[]);
    let child = |level, error, parents: &[u32]| crate::common::entry_of(&chunk, &encoded, level, error, parents);
    let begin = |entries| {
        let metadata = crate::common::metadata(COLORED, 8);
        PackWriter::begin(Vec::new(), crate::common::header(COLORED, 8), &metadata, entries)
    };
    let refusal = |entries| begin(entries).err().expect("refused").to_string();
    assert!(refusal(vec![]).contains("0 directory entries"));
    assert!(refusal(vec![child(0, 1.0, &[])]).contains("root entry"));
    assert!(refusal(vec![root.clone(), child(0, 1.0, &[])]).contains("no parent"));
    assert!(refusal(vec![root.clone(), child(0, 1.0, &[1])]).contains("does not come before"));
    assert!(refusal(vec![root.clone(), child(0, f32::NAN, &[0])]).contains("errors"));
    assert!(
        refusal(vec![root.clone(), child(0, 1.0, &[0]), child(1, 2.0, &[1])])
            .contains("larger than that of its parent")
    );
    assert!(refusal(vec![root.clone(), child(1, 1.0, &[0]), child(0, 1.0, &[0])]).contains("level 0 after level 1"));

    let mut writer = begin(vec![root.clone(), child(0, 1.0, &[0])]).expect("begins");
    assert!(writer.chunk(&encoded[1..]).is_err(), "not the announced bytes");
    writer.chunk(&encoded).expect("writes");
    assert!(writer.finish().expect_err("refused").to_string().contains("1 chunk written, 2 announced"));
    assert_eq!(checksum(&encoded), root.checksum);
}

#[test]
fn a_full_disk_is_an_error() {
    struct Full(usize);
    impl std::io::Write for Full {
        fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
            let n = bytes.len().min(self.0);
            self.0 -= n;
            if n == 0 { Err(std::io::ErrorKind::StorageFull.into()) } else { Ok(n) }
        }
        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }
    let chunk = crate::common::height_field(2, 1, 1, COLORED);
    let encoded = kilwa_pack::chunk::encode(&chunk, COLORED).expect("encodes");
    for room in [0, 100, 300, 5000] {
        let root = crate::common::entry_of(&chunk, &encoded, 0, f32::INFINITY, &[]);
        let metadata = crate::common::metadata(COLORED, 8);
        let result = PackWriter::begin(Full(room), crate::common::header(COLORED, 8), &metadata, vec![root]);
        assert!(matches!(result.err(), Some(PackError::Io { .. })));
    }
}

#[test]
fn patch_tables_are_read_without_geometry_and_damage_is_found() {
    let bytes = crate::common::pack(7, 4, COLORED);
    let reader = Reader::open(SliceSource(&bytes[..])).expect("opens");
    for i in 0..7 {
        assert_eq!(reader.patches(i).expect("intact"), reader.chunk(i).expect("decodes").patches);
        let entry = &reader.entries()[i as usize];
        for at in (entry.offset..entry.offset + u64::from(entry.encoded_bytes)).step_by(11) {
            let mut damaged = bytes.clone();
            damaged[at as usize] ^= 16;
            let damaged = Reader::open(SliceSource(damaged)).expect("opens");
            assert!(matches!(damaged.patches(i), Err(PackError::Checksum { .. })), "chunk {i}, byte {at}");
        }
    }
    assert!(reader.patches(7).is_err());
}

#[test]
fn a_model_of_another_size_than_announced_is_found() {
    let reader = Reader::open(SliceSource(crate::common::pack(3, 2, COLORED))).expect("opens");
    let mut totals = Totals::default();
    for i in 0..3 {
        totals = totals.plus(verify::chunk(i, &reader.chunk(i).expect("decodes"), reader.entries()).expect("sound"));
    }
    let mut metadata = reader.metadata().clone();
    metadata.border_edges = totals.finest_borders;
    metadata.bounds_min = reader.header().lattice.world_from_lattice(totals.finest_bounds.min);
    metadata.bounds_max = reader.header().lattice.world_from_lattice(totals.finest_bounds.max);
    totals.agree(reader.header(), &metadata).expect("sound");
    metadata.bounds_max[2] += 0.01;
    assert!(totals.agree(reader.header(), &metadata).expect_err("found").to_string().contains("the model reaches"));
}

#[test]
fn false_values_in_the_directory_are_found_by_verify() {
    let chunk = {
        let mut c = crate::common::height_field(4, 2, 1, COLORED);
        c.patches[0].diamond = 1;
        c
    };
    let encoded = kilwa_pack::chunk::encode(&chunk, COLORED).expect("encodes");
    let leaf = crate::common::height_field(4, 1, 2, COLORED);
    let leaf_bytes = kilwa_pack::chunk::encode(&leaf, COLORED).expect("encodes");
    let build = |change: &dyn Fn(&mut [kilwa_pack::DirectoryEntry]), triangles: u64| {
        let mut entries = vec![
            crate::common::entry_of(&chunk, &encoded, 0, f32::INFINITY, &[]),
            crate::common::entry_of(&leaf, &leaf_bytes, 0, 0.5, &[0]),
        ];
        change(&mut entries);
        let metadata = crate::common::metadata(COLORED, triangles);
        let mut w = PackWriter::begin(Vec::new(), crate::common::header(COLORED, triangles), &metadata, entries)
            .expect("begins");
        w.chunk(&encoded).and_then(|()| w.chunk(&leaf_bytes)).expect("writes");
        verify_all(&w.finish().expect("finishes"))
    };
    build(&|_| {}, 48).expect("sound");
    let refusal = |change: &dyn Fn(&mut [kilwa_pack::DirectoryEntry]), triangles| {
        build(change, triangles).expect_err("found").to_string()
    };
    assert!(refusal(&|_| {}, 47).contains("48 triangles of the finest level are there, 47 are announced"));
    assert!(refusal(&|e| e[1].bounds.max[0] += 1, 48).contains("chunk 1"));
    assert!(refusal(&|e| e[1].sphere.radius = 10.0, 48).contains("outside its bounding sphere"));
    assert!(refusal(&|e| e[0].sphere.radius = 30_000.0, 48).contains("sphere of its parent 0"));
    assert!(refusal(&|e| e[1].vertices += 1, 48).contains("chunk 1"));
}

#[test]
fn the_error_bound_of_children_holds_and_is_tight() {
    use kilwa_pack::directory::link_children;
    let mut random = fastrand::Rng::with_seed(1);
    let mut next = || random.u32(..);
    let entry = |parents: [u32; 4], error: f32| DirectoryEntry { parents, error, ..blank() };
    let none = kilwa_pack::NO_DIAMOND;
    let mut entries = vec![entry([none; 4], f32::INFINITY)];
    for index in 1..400u32 {
        let parent = next() % index;
        let above = entries[parent as usize].error.min(1.0);
        // Down to zero, and to values that 32 bits can hardly distinguish.
        let error = match next() % 10 {
            0 => above,
            1 => above.next_down().max(0.0),
            2 => 0.0,
            3 => above * 1e-30,
            _ => above * (next() % 1000) as f32 / 1000.0,
        };
        entries.push(entry([parent, none, none, none], error));
    }
    link_children(&mut entries, |index| index % 3 == 0);
    kilwa_pack::verify::directory(&entries).unwrap();
    for (index, entry) in (0u32..).zip(&entries) {
        let below: Vec<u32> =
            (0u32..).zip(&entries).filter(|(_, e)| e.parents().any(|p| p == index)).map(|(i, _)| i).collect();
        let Some(children) = entry.children else {
            assert!(below.is_empty());
            continue;
        };
        assert_eq!(
            (children.first, usize::from(children.count), children.is_whole),
            (below[0], below.len(), index % 3 == 0)
        );
        assert!(below.iter().all(|&i| children.pages().contains(&(i / 127))));
        let (bound, largest) =
            (children.error(entry.error), below.iter().map(|&i| entries[i as usize].error).fold(0.0, f32::max));
        assert!(largest <= bound && bound <= entry.error, "{index}: {largest} <= {bound} <= {}", entry.error);
        assert!(
            index == 0 || f64::from(bound - largest) <= f64::from(entry.error) / 65_000.0,
            "{index}: {bound} is far above {largest}"
        );
    }
    let back = parse_page(&write_page(&entries[..127], 0), 0, 400).unwrap();
    assert_eq!(back, entries[..127]);
    entries[0].children.as_mut().unwrap().count += 1;
    assert!(kilwa_pack::verify::directory(&entries).is_err(), "a wrong number of children is found");
}

fn blank() -> DirectoryEntry {
    DirectoryEntry {
        offset: 1000,
        encoded_bytes: 1,
        vertices: 0,
        triangles: 0,
        level: 0,
        error: 0.0,
        color_error: 0.0,
        sphere: kilwa_geometry::Sphere::EMPTY,
        bounds: kilwa_geometry::Aabb::EMPTY,
        parents: [kilwa_pack::NO_DIAMOND; 4],
        checksum: [0; 16],
        children: None,
    }
}
