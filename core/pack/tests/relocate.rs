//! A relocated pack is the same model and reveals nothing of its former location.

use glam::DVec3;
use kilwa_pack::{Attributes, Metadata, Reader, SliceSource, relocate};

const COLOURED: Attributes = Attributes { colors: true, scalars: 0 };

fn open(bytes: Vec<u8>) -> Reader<SliceSource<Vec<u8>>> {
    Reader::open(SliceSource(bytes)).expect("a sound pack")
}

#[test]
fn every_chunk_is_the_same_and_only_origin_and_metadata_differ() {
    let old = open(crate::common::pack(40, 12, COLOURED));
    let moved = relocate(&old, Vec::new(), DVec3::new(-8.0, -8.0, 0.0), |m| {
        m.crs = None;
        m.sources.clear();
    });
    let new = open(moved.expect("moves"));
    assert_eq!(new.header().lattice.origin, DVec3::new(-8.0, -8.0, 0.0));
    assert_eq!(new.header().lattice.step_log2, old.header().lattice.step_log2);
    assert_eq!((new.metadata().crs.as_ref(), new.metadata().sources.len()), (None, 0));
    assert_ne!(new.identity(), old.identity());
    assert_eq!(new.entries().len(), old.entries().len());
    for i in 0..old.entries().len() as u32 {
        let (a, b) = (&old.entries()[i as usize], &new.entries()[i as usize]);
        assert_eq!(
            (a.checksum, a.error.to_bits(), &a.bounds, a.parents),
            (b.checksum, b.error.to_bits(), &b.bounds, b.parents)
        );
        assert_eq!(old.chunk(i).expect("sound"), new.chunk(i).expect("sound"), "chunk {i}");
    }
}

#[test]
fn the_bounds_move_with_the_lattice_by_whole_spacings() {
    let old = open(crate::common::pack(3, 6, COLOURED));
    let steps = |m: DVec3, origin: DVec3| ((m - origin) * 8192.0).round();
    let wanted = steps(old.metadata().bounds_max, old.header().lattice.origin);
    let new = open(relocate(&old, Vec::new(), DVec3::ZERO, |_| ()).expect("moves"));
    assert_eq!(new.metadata().bounds_max * 8192.0, wanted, "exact: there is no far offset any more");
}

#[test]
fn a_damaged_chunk_is_named_and_not_copied() {
    let mut bytes = crate::common::pack(5, 8, COLOURED);
    let at = open(bytes.clone()).entries()[3].offset as usize + 9;
    bytes[at] ^= 1;
    let old = open(bytes);
    let message = relocate(&old, Vec::new(), DVec3::ZERO, |_| ()).map(drop).expect_err("damaged").to_string();
    assert!(message.contains("chunk 3"), "{message}");
}

fn of_version_1_0() -> Reader<SliceSource<Vec<u8>>> {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/compat/1.0-wall.kilwa");
    open(std::fs::read(path).expect("is there"))
}

#[test]
fn a_moved_pack_of_1_0_remains_one_that_earlier_readers_know() {
    let old = of_version_1_0();
    let new = open(relocate(&old, Vec::new(), DVec3::ZERO, |_| ()).expect("moves"));
    assert_eq!((new.header().version, new.header().required_features), ((1, 0), 0));
    let encoded_again = old.header().clone().with_current_codec();
    assert_eq!((encoded_again.version, encoded_again.required_features), ((1, 1), 1));
    let now = open(crate::common::pack(3, 6, COLOURED));
    let moved = open(relocate(&now, Vec::new(), DVec3::ZERO, |_| ()).expect("moves"));
    assert_eq!((moved.header().version, moved.header().required_features), ((1, 1), 1));
}

#[test]
fn what_a_newer_minor_version_adds_is_not_announced_by_a_moved_pack() {
    let bytes = crate::container::forged_with_footer(&crate::common::pack(3, 6, COLOURED), |b| {
        b[10..12].copy_from_slice(&9u16.to_le_bytes());
        b[24..32].copy_from_slice(&5u64.to_le_bytes());
    });
    let moved = relocate(&open(bytes), Vec::new(), DVec3::ZERO, |_| ()).expect("moves");
    assert_eq!(moved[24..32], [0; 8], "optional features");
    assert_eq!(open(moved).header().version, (1, 1));
}

/// Every vertex of a chunk as its position and colour: what must survive when channels are left out.
fn without_channels(mut chunk: kilwa_pack::Chunk, keep: &[usize]) -> kilwa_pack::chunk::Canonical {
    let scalars = std::mem::take(&mut chunk.mesh.scalars);
    chunk.mesh.scalars = keep.iter().map(|&k| scalars[k].clone()).collect();
    chunk.canonical()
}

#[test]
fn dropped_channels_are_removed_and_everything_else_is_unchanged() {
    let old = open(crate::common::pack(30, 9, Attributes { colors: true, scalars: 3 }));
    for keep in [&[][..], &[1], &[2, 0], &[0, 1, 2]] {
        let mut scratch = std::io::Cursor::new(Vec::new());
        let moved = kilwa_pack::relocate_with_channels(&old, Vec::new(), &mut scratch, keep, DVec3::ZERO, |_| ());
        let new = open(moved.expect("moves"));
        let names = |r: &Reader<SliceSource<Vec<u8>>>| -> Vec<String> {
            r.metadata().scalars.iter().map(|s| s.name.clone()).collect()
        };
        assert_eq!(names(&new), keep.iter().map(|&k| names(&old)[k].clone()).collect::<Vec<_>>());
        assert_eq!(usize::from(new.header().attributes.scalars), keep.len());
        for i in 0..old.entries().len() as u32 {
            let (a, b) = (old.chunk(i).expect("sound"), new.chunk(i).expect("sound"));
            assert_eq!(without_channels(a, keep), b.canonical(), "chunk {i}");
        }
    }
    let mut scratch = std::io::Cursor::new(Vec::new());
    let refused = kilwa_pack::relocate_with_channels(&old, Vec::new(), &mut scratch, &[3], DVec3::ZERO, |_| ());
    assert!(refused.map(drop).expect_err("no such channel").to_string().contains("3 scalar channels"));
}

#[test]
fn metadata_with_a_duplicate_key_is_refused() {
    let bytes = crate::common::pack(3, 2, COLOURED);
    let pack = open(bytes.clone());
    let (header, metadata) = (pack.header().clone(), pack.metadata());
    let json = serde_json::to_string(metadata).expect("JSON");
    for more in ["{\"title\":\"x\",", "{\"not known\":1,\"not known\":2,"] {
        let twice = json.replacen('{', more, 1);
        let header = kilwa_pack::Header { metadata_checksum: kilwa_pack::checksum(twice.as_bytes()), ..header.clone() };
        let refused = Metadata::parse(twice.as_bytes(), &header).expect_err("two values").to_string();
        assert!(refused.contains("duplicate"), "{refused}");
    }
    // Also in its maps, of which serde would keep the last.
    let options = json.replace("\"options\":{", "\"options\":{\"o\":\"1\",\"o\":\"2\",");
    let header = kilwa_pack::Header { metadata_checksum: kilwa_pack::checksum(options.as_bytes()), ..header };
    assert!(options != json && Metadata::parse(options.as_bytes(), &header).is_err());
}
