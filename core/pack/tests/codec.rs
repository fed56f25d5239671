//! The chunk codec gives back exactly what it was given, and refuses everything else.

mod common;

use common::height_field;
use kilwa_pack::chunk::{Declared, decode, encode};
use kilwa_pack::{Attributes, Chunk};

fn declared(chunk: &Chunk) -> Declared {
    Declared { vertices: chunk.mesh.vertex_count() as u32, triangles: chunk.mesh.triangle_count() as u32 }
}

#[test]
fn a_height_field_comes_back_with_every_attribute_and_border() {
    for attributes in [Attributes { colors: true, scalars: 0 }, Attributes { colors: false, scalars: 2 }] {
        let chunk = height_field(40, 5, 1, attributes);
        let bytes = encode(&chunk, attributes).expect("encodes");
        let back = decode(&bytes, declared(&chunk), attributes).expect("decodes");
        assert_eq!(back.canonical(), chunk.canonical());
    }
}

#[test]
fn report_bytes_per_triangle() {
    let attributes = Attributes { colors: true, scalars: 0 };
    let chunk = height_field(90, 8, 1, attributes);
    let bytes = encode(&chunk, attributes).expect("encodes");
    println!("{:.3} bytes per triangle", bytes.len() as f64 / chunk.mesh.triangle_count() as f64);
}
