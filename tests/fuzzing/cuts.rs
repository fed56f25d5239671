//! Truncations of meshes in the formats that other archives hold: Nexus models, tilesets with their tiles, ZIP archives.
//!
//! `KILWA_SOAK=1` runs 10^4 truncations of each, the short form a tenth of that. Each has to be refused in time and in memory that its bytes justify, never taken for the
//! whole.

use crate::bodies::{Body, archive_file, nexus_file, tiles_in_folder};
use crate::seeds;
use crate::zip::{Item, archive, archive64, stored};
use crate::{Current, Done};
use std::fmt::Write as _;
use std::sync::Mutex;
use std::time::Instant;

/// Truncations at evenly spaced bytes; those below byte `needed` lack something.
fn cut(name: &str, whole: &[u8], needed: usize, body: Body) {
    let count = if crate::variable("KILWA_SOAK").is_some() { 10_000 } else { 1000 };
    assert!(whole.len() > 10_000, "{} bytes have fewer different truncations than are asked for", whole.len());
    let (current, is_done) = (Current::new(&format!("cut-{name}")), Mutex::new(false));
    let begun = Instant::now();
    let mut slowest = 0.0f64;
    std::thread::scope(|scope| {
        scope.spawn(|| current.watch(&is_done));
        let _done = Done(&is_done);
        let of_whole = current.run(body, whole);
        assert!(of_whole.contains("0 0 0"), "{name} is not read: {of_whole}");
        for k in 0..count {
            let (length, begun) = (k * whole.len() / count, Instant::now());
            let kind = current.run(body, &whole[..length]);
            // A mesh has its three counts in its kind, an error has none.
            assert!(length >= needed || !kind.contains("0 0 0"), "{name} cut at byte {length} is read: {kind}");
            slowest = slowest.max(begun.elapsed().as_secs_f64());
        }
    });
    println!(
        "{name} of {} bytes: {count} truncations in {:.1} s, the slowest {slowest:.3} s",
        whole.len(),
        begun.elapsed().as_secs_f64()
    );
    std::fs::remove_file(&current.path).unwrap();
}

/// The four bytes of a number that looks random.
fn scrambled(i: usize) -> [u8; 4] {
    (i as u32).wrapping_mul(2_654_435_761).to_le_bytes()
}

fn coordinate(i: usize) -> [u8; 4] {
    (f32::from(u16::from_le_bytes([scrambled(i)[1], scrambled(i)[2]])) * 0.01).to_le_bytes()
}

#[test]
fn a_truncated_nexus_model_is_refused() {
    const VERTICES: usize = 500;
    const TRIANGLES: usize = 900;
    let mut node: Vec<u8> = (0..3 * VERTICES).flat_map(coordinate).collect();
    let corner = |i: usize| [i % VERTICES, (i + 1) % VERTICES, (i + 7) % VERTICES].map(|v| v as u16);
    node.extend((0..TRIANGLES).flat_map(corner).flat_map(u16::to_le_bytes));
    let whole = seeds::nexus_model(0, [VERTICES, TRIANGLES], &node);
    cut("nxs", &whole, 256 + node.len(), nexus_file);
}

#[test]
fn a_truncated_compressed_nexus_model_is_refused() {
    const TRIANGLES: usize = 2800;
    let stream = seeds::corto(TRIANGLES, scrambled);
    let whole = seeds::nexus_model(4, [TRIANGLES + 2, TRIANGLES], &stream);
    cut("nxz", &whole, 256 + stream.len(), nexus_file);
}

/// A tileset of forty tiles that name this file, and a GLB of so many triangles.
fn tileset(file: &str, triangles: usize) -> (String, Vec<u8>) {
    let mut tiles = String::new();
    for i in 0..40 {
        let comma = if i > 0 { "," } else { "" };
        write!(
            tiles,
            "{comma}{{\"geometricError\":0,\"transform\":[1,0,0,0,0,1,0,0,0,0,1,0,{i},6,7,1],\"content\":{{\"uri\":\"{file}\"}}}}"
        )
        .unwrap();
    }
    let json = format!(
        "{{\"asset\":{{\"version\":\"1.1\"}},\"geometricError\":9,\"root\":{{\"geometricError\":5,\"refine\":\"REPLACE\",\"children\":[{tiles}]}}}}"
    );
    let buffer: Vec<u8> = (0..9 * triangles).flat_map(coordinate).collect();
    (json, seeds::glb_of("", &buffer))
}

#[test]
fn a_truncated_tileset_or_glb_is_refused() {
    let (json, glb) = tileset("b.glb", 200);
    let whole = [json.as_bytes(), b"\0", &glb].concat();
    cut("glb", &whole, whole.len(), tiles_in_folder);
}

#[test]
fn a_truncated_tileset_or_b3dm_is_refused() {
    let (json, glb) = tileset("a.b3dm", 200);
    let b3dm = seeds::b3dm_of("{\"BATCH_LENGTH\":0,\"RTC_CENTER\":[1,2,3]} ", &glb);
    let whole = [json.as_bytes(), b"\0", &b3dm].concat();
    cut("b3dm", &whole, whole.len(), tiles_in_folder);
}

/// A mesh in text, and a file that nothing needs.
fn items() -> [Item; 2] {
    let mut obj = String::new();
    for i in 0..300 {
        writeln!(obj, "v {i} 0 {}", i % 7).unwrap();
    }
    for i in 1..298 {
        writeln!(obj, "f {i} {} {}", i + 1, i + 3).unwrap();
    }
    let picture: Vec<u8> = (0..1500).flat_map(scrambled).collect();
    [stored("a.obj", obj.as_bytes()), stored("textures/a.png", &picture)]
}

#[test]
fn a_truncated_archive_is_refused() {
    let whole = archive(&items());
    cut("zip", &whole, whole.len(), archive_file);
}

#[test]
fn a_truncated_archive_with_sizes_of_64_bits_is_refused() {
    let whole = archive64(&items());
    cut("zip64", &whole, whole.len(), archive_file);
}
