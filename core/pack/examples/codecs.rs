//! Bytes and decoding speed of codec 2 beside codec 1 on the chunks of real packs, alternately in one run: `codecs PACK...`.

use kilwa_pack::chunk::{Declared, decode, encode_first, encode_parts};
use kilwa_pack::{Chunk, Reader, SliceSource};
use std::time::Instant;

/// Each chunk is timed so many times and its fastest counts.
const ROUNDS: usize = 7;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    for path in std::env::args().skip(1) {
        let reader = Reader::open(SliceSource(std::fs::read(&path)?))?;
        let attributes = reader.header().attributes;
        let (mut bytes, mut seconds, mut triangles, mut parts) = ([0usize; 2], [0.0; 3], 0usize, [0usize; 7]);
        for i in 0..reader.header().entry_count {
            let chunk: Chunk = reader.chunk(i)?;
            let declared =
                Declared { vertices: chunk.mesh.vertex_count() as u32, triangles: chunk.mesh.triangle_count() as u32 };
            let first = encode_first(&chunk, attributes)?;
            let begin = Instant::now();
            let (second, p) = encode_parts(&chunk, attributes)?;
            let encoding = begin.elapsed().as_secs_f64();
            for (sum, part) in
                parts.iter_mut().zip([p.connectivity, p.borders, p.positions, p.colors, p.normals, p.scalars, p.other])
            {
                *sum += part;
            }
            if decode(&second, declared, attributes)?.canonical() != chunk.canonical() {
                return Err(format!("{path}: chunk {i} did not survive encoding and decoding").into());
            }
            let mut fastest = [f64::INFINITY; 2];
            for _ in 0..ROUNDS {
                for (fastest, coded) in fastest.iter_mut().zip([&first, &second]) {
                    let begin = Instant::now();
                    std::hint::black_box(decode(coded, declared, attributes)?);
                    *fastest = fastest.min(begin.elapsed().as_secs_f64());
                }
            }
            bytes[0] += first.len();
            bytes[1] += second.len();
            seconds[0] += fastest[0];
            seconds[1] += fastest[1];
            seconds[2] += encoding;
            triangles += declared.triangles as usize;
        }
        let rate = |s: f64| triangles as f64 / s / 1e6;
        let other = reader.header().file_bytes as usize
            - reader.entries().iter().map(|e| e.encoded_bytes as usize).sum::<usize>();
        let per = |b: usize| (b + other) as f64 / reader.header().triangles as f64;
        println!(
            "{path}: bytes {bytes:?} per input triangle {:.4} {:.4} ({:.4})",
            per(bytes[0]),
            per(bytes[1]),
            bytes[1] as f64 / bytes[0] as f64
        );
        println!("   decoded M/s {:.2} {:.2}; encoded {:.2}", rate(seconds[0]), rate(seconds[1]), rate(seconds[2]));
        println!(
            "   connectivity, borders, positions, colors, normals, scalars, other: {:?}",
            parts.map(|b| (b as f64 / reader.header().triangles as f64 * 1e4).round() / 1e4)
        );
    }
    Ok(())
}
