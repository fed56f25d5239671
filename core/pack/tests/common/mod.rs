//! Chunks, entries and small packs to test with; deterministic.
#![allow(dead_code, reason = "each test file uses its part")]

#[cfg(unix)]
pub(crate) mod sparse;

use glam::DVec3;
use kilwa_geometry::{Aabb, Lattice, Mesh, Sphere, normal};
use kilwa_pack::metadata::{ScalarChannel, SourceFile};
use kilwa_pack::{Attributes, Chunk, DirectoryEntry, Header, Metadata, NO_DIAMOND, PackWriter, PatchRange};

/// Roughly normal with standard deviation 1.
pub(crate) fn gauss(random: &mut fastrand::Rng) -> f64 {
    (0..12).map(|_| random.f64()).sum::<f64>() - 6.0
}

/// A wavy, noisy height field like a scanned wall: `n` by `n` cells of about 10 mm on a lattice of 2^-13 m, noise
/// 0.15 mm, colours with noise of sigma 4, cut into `patches` patches.
pub(crate) fn height_field(n: usize, patches: usize, seed: u64, attributes: Attributes) -> Chunk {
    let mut random = fastrand::Rng::with_seed(seed);
    let step = 8192.0;
    let mut mesh = Mesh { scalars: vec![Vec::new(); usize::from(attributes.scalars)], ..Mesh::default() };
    for j in 0..=n {
        for i in 0..=n {
            let (x, y) = (i as f64 * 0.01, j as f64 * 0.01);
            let relief = 0.05 * (x * 7.0).sin() * (y * 5.0).cos() + 0.004 * (x * 61.0).sin() * (y * 83.0).sin();
            let jitter = [gauss(&mut random) * 0.002, gauss(&mut random) * 0.002];
            let z = relief + gauss(&mut random) * 0.00015;
            let at = DVec3::new(x + jitter[0] + 3.0, y + jitter[1] + 5.0, z + 1.0);
            mesh.positions.push((at * step).as_ivec3());
            if attributes.colors {
                let base = 130.0 + 40.0 * (x * 11.0).sin() * (y * 13.0).sin();
                let grey = gauss(&mut random) * 3.5;
                mesh.colors.push(
                    [1.1, 1.0, 0.85].map(|k| (base * k + grey + gauss(&mut random) * 2.0).clamp(0.0, 255.0) as u8),
                );
            }
            for channel in &mut mesh.scalars {
                channel.push((random.u64(..1000) as f32) / 999.0);
            }
        }
    }
    let at = |i: usize, j: usize| (j * (n + 1) + i) as u32;
    for j in 0..n {
        for i in 0..n {
            let (west, east) = (i == 0, i + 1 == n);
            let (south, north) = (j == 0, j + 1 == n);
            mesh.triangles.push([at(i, j), at(i + 1, j), at(i + 1, j + 1)]);
            mesh.borders.push(u8::from(south) | u8::from(east) << 1);
            mesh.triangles.push([at(i, j), at(i + 1, j + 1), at(i, j + 1)]);
            mesh.borders.push(u8::from(north) << 1 | u8::from(west) << 2);
        }
    }
    mesh.normals = area_weighted(&mesh);
    let total = mesh.triangles.len() as u32;
    let patches = patches as u32;
    let edges: Vec<u32> =
        (0..=patches).map(|p| total / patches * p + if p == patches { total % patches } else { 0 }).collect();
    let patches =
        edges.windows(2).map(|w| PatchRange { first: w[0], count: w[1] - w[0], diamond: NO_DIAMOND }).collect();
    Chunk { mesh, patches }
}

/// Area-weighted normals of the whole field, to 10 bits, as the builder makes them.
fn area_weighted(mesh: &Mesh) -> Vec<[i16; 2]> {
    let mut sums = vec![DVec3::ZERO; mesh.positions.len()];
    for (t, triangle) in mesh.triangles.iter().enumerate() {
        let [p, q, r] = mesh.corners(t).map(glam::IVec3::as_dvec3);
        let n = (q - p).cross(r - p);
        for corner in triangle {
            sums[*corner as usize] += n;
        }
    }
    sums.into_iter().map(|n| normal::quantize(normal::encode(n), 10)).collect()
}

/// The entry of an encoded chunk.
pub(crate) fn entry_of(chunk: &Chunk, encoded: &[u8], level: u8, error: f32, parents: &[u32]) -> DirectoryEntry {
    let mut all = [NO_DIAMOND; 4];
    all[..parents.len()].copy_from_slice(parents);
    DirectoryEntry {
        offset: 0,
        encoded_bytes: encoded.len() as u32,
        vertices: chunk.mesh.vertex_count() as u32,
        triangles: chunk.mesh.triangle_count() as u32,
        level,
        error,
        color_error: if error.is_finite() { error * 100.0 } else { 0.0 },
        sphere: Sphere { center: DVec3::new(30_000.0, 45_000.0, 8000.0), radius: 40_000.0 - f64::from(level) },
        bounds: if chunk.mesh.positions.is_empty() { Aabb::EMPTY } else { chunk.mesh.bounds() },
        parents: all,
        checksum: kilwa_pack::checksum(encoded),
        children: None,
    }
}

/// Metadata that agrees with [`header`].
pub(crate) fn metadata(attributes: Attributes, triangles: u64) -> Metadata {
    Metadata {
        title: "Gereza of Kilwa Kisiwani".to_owned(),
        source_units: "m".to_owned(),
        source_up: "z".to_owned(),
        crs: Some("EPSG:32737".to_owned()),
        lattice_step: 1.0 / 8192.0,
        bounds_min: DVec3::new(0.1, 0.2, 0.3),
        bounds_max: DVec3::new(3.0, 4.0, 1.0 / 3.0),
        median_edge: 0.0123,
        triangles,
        vertices: 7,
        border_edges: 3,
        scalars: (0..attributes.scalars)
            .map(|i| ScalarChannel { name: format!("scalar{i}"), min: 0.0, max: 1.0 })
            .collect(),
        sources: vec![SourceFile { name: "a.ply".to_owned(), bytes: 12, sha256: "00".repeat(32) }],
        tool: "kilwa test".to_owned(),
        options: std::iter::once(("patch".to_owned(), "8000".to_owned())).collect(),
        capture_accuracy: None,
        capture_registration: None,
        capture_instrument: None,
        repairs: std::iter::once(("degenerate triangles dropped".to_owned(), 2)).collect(),
    }
}

/// A header; the writer fills in offsets and counts.
pub(crate) fn header(attributes: Attributes, triangles: u64) -> Header {
    let lattice = Lattice { origin: DVec3::new(500_000.0, 9_000_000.0, -3.5), step_log2: -13 };
    Header::new(lattice, 17, triangles, attributes)
}

/// A pack of `count` chunks of `n` by `n` cells: entry 0, then a binary tree of diamonds.
pub(crate) fn pack(count: u32, n: usize, attributes: Attributes) -> Vec<u8> {
    let mut chunks = Vec::new();
    for i in 0..count {
        let mut chunk = height_field(n, 2, u64::from(i) + 1, attributes);
        // The root holds one diamond's coarse form, every later chunk those of its two children, where they exist.
        for (k, patch) in chunk.patches.iter_mut().enumerate() {
            let child = if i == 0 { 1 } else { 2 * i + k as u32 };
            patch.diamond = if child < count { child } else { NO_DIAMOND };
        }
        chunks.push(chunk);
    }
    let encoded: Vec<Vec<u8>> =
        chunks.iter().map(|c| kilwa_pack::chunk::encode(c, attributes).expect("encodes")).collect();
    let level = |i: u32| if i == 0 { 0 } else { i.ilog2() as u8 };
    let entries = (0..count)
        .map(|i| {
            let (error, parents) =
                if i == 0 { (f32::INFINITY, vec![]) } else { (1.0 / f32::from(level(i) + 1), vec![i / 2]) };
            entry_of(&chunks[i as usize], &encoded[i as usize], level(i), error, &parents)
        })
        .collect();
    let drawn: u64 =
        chunks.iter().flat_map(|c| &c.patches).filter(|p| p.diamond == NO_DIAMOND).map(|p| u64::from(p.count)).sum();
    let mut writer = PackWriter::begin(Vec::new(), header(attributes, drawn), &metadata(attributes, drawn), entries)
        .expect("begins");
    for bytes in &encoded {
        writer.chunk(bytes).expect("writes");
    }
    writer.finish().expect("finishes")
}
