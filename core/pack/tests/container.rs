//! Header, directory, metadata, footer.

mod common;

use kilwa_pack::{Attributes, Reader, SliceSource, parse_head};

#[test]
fn a_pack_reads_back_as_written() {
    let attributes = Attributes { colors: true, scalars: 1 };
    let bytes = common::pack(300, 6, attributes);
    let reader = Reader::open(SliceSource(&bytes)).expect("opens");
    assert_eq!(reader.entries().len(), 300);
    for i in 0..300 {
        let chunk = reader.chunk(i).expect("decodes");
        assert_eq!(chunk.mesh.triangle_count(), 72);
    }
    assert_eq!(*reader.metadata(), common::metadata(attributes, reader.header().triangles));
    let head = parse_head(&bytes[..131_072]).expect("head");
    assert_eq!(head.entries, reader.entries()[..127]);
}
