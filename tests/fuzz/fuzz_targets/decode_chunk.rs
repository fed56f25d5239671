//! Any bytes as a chunk: decoding gives an error, or a chunk that encodes and decodes to the same geometry.
#![no_main]

use kilwa_pack::Attributes;
use kilwa_pack::chunk::{Declared, decode, encode};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: (u16, u16, bool, u8, Vec<u8>)| {
    let (vertices, triangles, colors, scalars, bytes) = input;
    let attributes = Attributes { colors, scalars: scalars % 20 };
    let declared = Declared { vertices: vertices.into(), triangles: triangles.into() };
    let Ok(chunk) = decode(&bytes, declared, attributes) else { return };
    let again = encode(&chunk, attributes).expect("what decodes can be encoded");
    let back = decode(&again, declared, attributes).expect("what was encoded decodes");
    assert_eq!(back.canonical(), chunk.canonical());
});
