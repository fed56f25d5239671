//! Bytes, speed and vertex-cache use of the chunk codec on the chunks of real packs, beside meshoptimizer's: `cargo xtask bench
//! codec`.
//!
//! Usage: `codec PACK...`. Every chunk is decoded, encoded again and decoded again. Tables in Markdown come out: bytes per
//! triangle of the input by part, the same by level, speeds on one core. A meshoptimizer stream of the same chunk holds
//! the vertices as the GPU gets them (20 bytes, in the order of the triangles' first use) and the indices.

use kilwa_pack::chunk::{Declared, PartBytes, decode, encode_parts};
use kilwa_pack::{Attributes, Chunk, Reader, SliceSource, interleave};
use meshoptimizer_rs::Workspace;
use meshoptimizer_rs::codec::{IndexEncoding, VertexEncoding, encode_index_buffer, encode_vertex_buffer};
use std::collections::{BTreeMap, VecDeque};
use std::io::Write;
use std::time::Instant;

/// Each chunk is timed so many times and its fastest counts, so that what else the machine does counts little.
const ROUNDS: usize = 9;
/// Entries of the first-in, first-out vertex caches that are tried.
const CACHES: [usize; 2] = [16, 32];

/// Sums over chunks.
#[derive(Default, Clone)]
struct Sums {
    chunks: u64,
    triangles: u64,
    vertices: u64,
    bytes: u64,
    /// In the order of [`PARTS`].
    parts: [u64; 7],
    misses: [u64; 2],
    meshopt: u64,
    deflated: u64,
}

const PARTS: [&str; 7] = ["connectivity", "borders", "positions", "colours", "normals", "scalars", "tables"];

impl Sums {
    fn add(&mut self, chunk: &Chunk, bytes: &[u8], parts: PartBytes) -> Result<(), Box<dyn std::error::Error>> {
        self.chunks += 1;
        self.triangles += chunk.mesh.triangle_count() as u64;
        self.vertices += chunk.mesh.vertex_count() as u64;
        self.bytes += bytes.len() as u64;
        let PartBytes { connectivity, borders, positions, colors, normals, scalars, other } = parts;
        let parts = [connectivity, borders, positions, colors, normals, scalars, other];
        for (sum, part) in self.parts.iter_mut().zip(parts) {
            *sum += part as u64;
        }
        for (sum, size) in self.misses.iter_mut().zip(CACHES) {
            *sum += misses(chunk, size);
        }
        let other = meshopt(chunk)?;
        self.meshopt += other.len() as u64;
        let mut deflate = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::best());
        deflate.write_all(&other)?;
        self.deflated += deflate.finish()?.len() as u64;
        Ok(())
    }

    fn plus(&self, other: &Self) -> Self {
        let mut sum = self.clone();
        sum.chunks += other.chunks;
        sum.triangles += other.triangles;
        sum.vertices += other.vertices;
        sum.bytes += other.bytes;
        for (a, b) in sum.parts.iter_mut().zip(other.parts) {
            *a += b;
        }
        for (a, b) in sum.misses.iter_mut().zip(other.misses) {
            *a += b;
        }
        sum.meshopt += other.meshopt;
        sum.deflated += other.deflated;
        sum
    }
}

/// Vertices that a first-in, first-out cache has to fetch, patch by patch, as they are drawn.
fn misses(chunk: &Chunk, size: usize) -> u64 {
    let mut misses = 0;
    for patch in &chunk.patches {
        let mut cache = VecDeque::with_capacity(size + 1);
        for v in chunk.mesh.triangles[patch.first as usize..][..patch.count as usize].as_flattened() {
            if !cache.contains(v) {
                misses += 1;
                cache.push_back(*v);
                if cache.len() > size {
                    cache.pop_front();
                }
            }
        }
    }
    misses
}

/// The chunk in meshoptimizer's codecs, after its optimisation of triangle and vertex order.
fn meshopt(chunk: &Chunk) -> Result<Vec<u8>, meshoptimizer_rs::Error> {
    let gpu = interleave(chunk);
    let mut work = Workspace::default();
    let mut indices = Vec::with_capacity(gpu.indices.len());
    for patch in &chunk.patches {
        let of_patch = &gpu.indices[3 * patch.first as usize..][..3 * patch.count as usize];
        indices.extend(meshoptimizer_rs::optimize_vertex_cache_strip(of_patch, gpu.vertex_count as usize, &mut work)?);
    }
    if indices.is_empty() {
        return Ok(Vec::new());
    }
    let mut number = vec![u32::MAX; gpu.vertex_count as usize];
    let mut vertices = Vec::with_capacity(gpu.vertices.len());
    for index in &mut indices {
        let slot = &mut number[*index as usize];
        if *slot == u32::MAX {
            *slot = (vertices.len() / 20) as u32;
            vertices.extend_from_slice(&gpu.vertices[20 * *index as usize..][..20]);
        }
        *index = *slot;
    }
    let mut out = encode_vertex_buffer(&vertices, vertices.len() / 20, 20, VertexEncoding::DEFAULT, &mut work)?;
    out.extend(encode_index_buffer(&indices, IndexEncoding::DEFAULT, &mut work)?);
    Ok(out)
}

/// The fastest of some rounds, in seconds.
fn fastest(mut work: impl FnMut()) -> f64 {
    let mut round = || {
        let begin = Instant::now();
        work();
        begin.elapsed().as_secs_f64()
    };
    (0..ROUNDS).map(|_| round()).fold(f64::INFINITY, f64::min)
}

fn pack(path: &str) -> Result<(), Box<dyn std::error::Error>> {
    let reader = Reader::open(SliceSource(std::fs::read(path)?))?;
    let (attributes, entries) = (reader.header().attributes, reader.entries());
    let chunks: Vec<Chunk> = (0..reader.header().entry_count).map(|i| reader.chunk(i)).collect::<Result<_, _>>()?;
    let coded: Vec<(Vec<u8>, PartBytes)> =
        chunks.iter().map(|c| encode_parts(c, attributes)).collect::<Result<_, _>>()?;
    let mut levels: BTreeMap<(bool, u8), Sums> = BTreeMap::new();
    for ((chunk, (bytes, parts)), (entry, i)) in chunks.iter().zip(&coded).zip(entries.iter().zip(0..)) {
        let again = decode(bytes, declared(chunk), attributes)?;
        if again.canonical() != chunk.canonical() {
            return Err(format!("{path}: chunk {i} came back as another").into());
        }
        levels.entry((i > 0, entry.level)).or_default().add(&again, bytes, *parts)?;
    }
    let all = levels.values().fold(Sums::default(), |a, b| a.plus(b));
    let stored: u64 = entries.iter().map(|e| u64::from(e.encoded_bytes)).sum();
    report(path, &levels, &all, (reader.header().triangles, reader.header().file_bytes - stored));
    speeds(&chunks, &coded, attributes, all.triangles);
    Ok(())
}

fn declared(chunk: &Chunk) -> Declared {
    Declared { vertices: chunk.mesh.vertex_count() as u32, triangles: chunk.mesh.triangle_count() as u32 }
}

/// `beside` are the bytes of the pack that are in no chunk.
fn report(path: &str, levels: &BTreeMap<(bool, u8), Sums>, all: &Sums, (triangles, beside): (u64, u64)) {
    let name = std::path::Path::new(path).file_stem().unwrap_or_default().to_string_lossy();
    let per = |bytes: u64| bytes as f64 / triangles.max(1) as f64;
    let stored = per(all.triangles);
    println!("\n### {name}: {triangles} triangles, {stored:.2} stored for each, in {} chunks\n", all.chunks);
    println!("Bytes per triangle of the input:\n");
    println!("| {} | directory, header | **all** | meshopt v1 | meshopt + deflate |", PARTS.join(" | "));
    println!("|{}", "---:|".repeat(PARTS.len() + 4));
    let parts: Vec<String> = all.parts.iter().map(|&b| format!("{:.3}", per(b))).collect();
    println!(
        "| {} | {:.3} | **{:.3}** | {:.3} | {:.3} |\n",
        parts.join(" | "),
        per(beside),
        per(beside + all.bytes),
        per(beside + all.meshopt),
        per(beside + all.deflated)
    );
    println!("By level, bytes per triangle stored there:\n");
    println!(
        "| level | triangles | vertices / triangle | {} | all | meshopt v1 | meshopt + deflate |",
        PARTS.join(" | ")
    );
    println!("|---|{}", "---:|".repeat(PARTS.len() + 5));
    for ((below, level), s) in levels {
        let per = |bytes: u64| format!("{:.3}", bytes as f64 / s.triangles.max(1) as f64);
        let parts: Vec<String> = s.parts.iter().map(|&b| per(b)).collect();
        let level = if *below { level.to_string() } else { "root".to_owned() };
        let [parts, all] = [parts.join(" | "), per(s.bytes)];
        let (vertices, meshopt, deflated) = (per(s.vertices), per(s.meshopt), per(s.deflated));
        println!("| {level} | {} | {vertices} | {parts} | {all} | {meshopt} | {deflated} |", s.triangles);
    }
    let rate = |misses: u64| misses as f64 / all.triangles.max(1) as f64;
    let [small, large] = all.misses.map(rate);
    println!(
        "\nVertices fetched per triangle as decoded, by a first-in first-out cache of {}: {small:.3}, of {}: {large:.3}.",
        CACHES[0], CACHES[1]
    );
}

fn speeds(chunks: &[Chunk], coded: &[(Vec<u8>, PartBytes)], attributes: Attributes, triangles: u64) {
    let (mut encoding, mut decoding) = (0.0, 0.0);
    for (chunk, (bytes, _)) in chunks.iter().zip(coded) {
        encoding += fastest(|| {
            std::hint::black_box(encode_parts(chunk, attributes).ok());
        });
        decoding += fastest(|| {
            std::hint::black_box(decode(bytes, declared(chunk), attributes).ok());
        });
    }
    println!(
        "\nOne core: {:.2} million triangles a second encoded ({:.3} µs each), {:.2} decoded.",
        triangles as f64 / encoding / 1e6,
        encoding / triangles as f64 * 1e6,
        triangles as f64 / decoding / 1e6
    );
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let packs: Vec<String> = std::env::args().skip(1).collect();
    if packs.is_empty() {
        return Err("usage: codec PACK...".into());
    }
    packs.iter().try_for_each(|path| pack(path))
}
