//! A pack moved to another place is the same model, and nothing in it tells the old place.

mod common;

use kilwa_pack::{Attributes, Reader, SliceSource, relocate};

const COLOURED: Attributes = Attributes { colors: true, scalars: 0 };

fn open(bytes: Vec<u8>) -> Reader<SliceSource<Vec<u8>>> {
    Reader::open(SliceSource(bytes)).expect("a sound pack")
}

#[test]
fn every_chunk_is_the_same_and_only_origin_and_metadata_differ() {
    let old = open(common::pack(40, 12, COLOURED));
    let moved = relocate(&old, Vec::new(), [-8.0, -8.0, 0.0], |m| {
        m.crs = None;
        m.sources.clear();
    });
    let new = open(moved.expect("moves"));
    assert_eq!(new.header().lattice.origin, [-8.0, -8.0, 0.0]);
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
fn the_bounds_move_with_the_lattice_in_whole_steps() {
    let old = open(common::pack(3, 6, COLOURED));
    let steps = |m: [f64; 3], origin: [f64; 3]| [0, 1, 2].map(|k| ((m[k] - origin[k]) * 8192.0).round());
    let wanted = steps(old.metadata().bounds_max, old.header().lattice.origin);
    let new = open(relocate(&old, Vec::new(), [0.0; 3], |_| ()).expect("moves"));
    assert_eq!(new.metadata().bounds_max.map(|x| x * 8192.0), wanted, "exact: there is no far offset any more");
}

#[test]
fn a_damaged_chunk_is_named_and_not_copied() {
    let mut bytes = common::pack(5, 8, COLOURED);
    let at = open(bytes.clone()).entries()[3].offset as usize + 9;
    bytes[at] ^= 1;
    let old = open(bytes);
    let said = relocate(&old, Vec::new(), [0.0; 3], |_| ()).map(drop).expect_err("damaged").to_string();
    assert!(said.contains("chunk 3"), "{said}");
}
