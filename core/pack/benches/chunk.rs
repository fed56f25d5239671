//! Encoding and decoding of one chunk, in triangles per second: `cargo xtask bench kernels`. A height field of the size that the
//! builder writes represents real geometry; figures are compared on one machine only.

#[path = "../tests/common/mod.rs"]
mod common;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use kilwa_pack::Attributes;
use kilwa_pack::chunk::{Declared, decode, encode};
use std::hint::black_box;

fn chunk(criterion: &mut Criterion) {
    let attributes = Attributes { colors: true, scalars: 0 };
    let chunk = common::height_field(64, 8, 1, attributes);
    let bytes = encode(&chunk, attributes).expect("the chunk is sound");
    let (vertices, triangles) = (chunk.mesh.vertex_count() as u32, chunk.mesh.triangle_count() as u32);
    println!("{triangles} triangles, {:.2} bytes per triangle", bytes.len() as f64 / f64::from(triangles));
    let mut group = criterion.benchmark_group("chunk");
    group.throughput(Throughput::Elements(u64::from(triangles)));
    group.bench_function("encode", |b| b.iter(|| encode(black_box(&chunk), attributes)));
    let declared = Declared { vertices, triangles };
    group.bench_function("decode", |b| b.iter(|| decode(black_box(&bytes), declared, attributes)));
    group.finish();
}

criterion_group!(benches, chunk);
criterion_main!(benches);
