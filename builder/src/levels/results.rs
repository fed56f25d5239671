//! What a level leaves in memory and in `level-NN.results`: one entry per diamond, some hundred bytes each.

use crate::scratch::{Appender, Scratch, ScratchError};
use glam::{DVec3, IVec3};
use kilwa_geometry::{Aabb, Sphere};
use kilwa_pack::chunk::PatchRange;
use std::path::Path;

/// What one split diamond contributes to the pack.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// Index in [`crate::partition::Partition::diamonds`].
    pub diamond: u32,
    /// Which of several files the chunk's body is in; not written to the file of results, which belongs to one.
    pub file: u32,
    /// Certified error of the coarse form in lattice units, not yet saturated over what lies below.
    pub error: f32,
    /// Root mean square colour difference of the coarse form, 0 to 255, not yet saturated.
    pub color_error: f32,
    /// Round the chunk and the coarse form, in lattice units, not yet saturated.
    pub sphere: Sphere,
    /// Triangles before and after simplification; the former are those of the chunk.
    pub triangles: (u32, u32),
    /// Vertices of the chunk.
    pub vertices: u32,
    /// Box of the chunk.
    pub bounds: Aabb,
    /// Patches of the chunk, diamonds by their index in the tree.
    pub patches: Vec<PatchRange>,
    /// Where the chunk's body begins in `chunks`.
    pub at: u64,
    /// Bytes of the body.
    pub bytes: u32,
    /// CRC-32 of the body.
    pub sum: u32,
}

/// Begins the file, combined with the number of results.
const MAGIC: u32 = u32::from_le_bytes(*b"KLWR");

/// Write a file of results and wait until it is on the disk.
pub(crate) fn write(scratch: &Scratch, name: &str, results: &[Refined]) -> Result<(), ScratchError> {
    let mut bytes = (results.len() as u32 ^ MAGIC).to_le_bytes().to_vec();
    for r in results {
        bytes.extend(r.diamond.to_le_bytes());
        bytes.extend(r.error.to_le_bytes());
        bytes.extend(r.color_error.to_le_bytes());
        for x in r.sphere.center.to_array().into_iter().chain([r.sphere.radius]) {
            bytes.extend(x.to_le_bytes());
        }
        for x in [r.triangles.0, r.triangles.1, r.vertices] {
            bytes.extend(x.to_le_bytes());
        }
        for x in r.bounds.min.to_array().into_iter().chain(r.bounds.max.to_array()) {
            bytes.extend(x.to_le_bytes());
        }
        bytes.extend(r.at.to_le_bytes());
        for x in [r.bytes, r.sum, r.patches.len() as u32] {
            bytes.extend(x.to_le_bytes());
        }
        for p in &r.patches {
            bytes.extend(p.count.to_le_bytes());
            bytes.extend(p.diamond.to_le_bytes());
        }
    }
    bytes.extend(crc32fast::hash(&bytes).to_le_bytes());
    let mut file = Appender::new(scratch.create(name)?);
    file.push(&bytes)?;
    file.finish()?.sync()
}

/// Read a file of results.
pub(super) fn read(scratch: &Scratch, name: &str) -> Result<Vec<Refined>, ScratchError> {
    let file = scratch.existing(name)?;
    let bytes = file.read(0, file.len())?;
    parse(&bytes, file.path())
}

/// The results in the bytes of a file, which is at `path`.
pub(crate) fn parse(bytes: &[u8], path: &Path) -> Result<Vec<Refined>, ScratchError> {
    let damaged = || ScratchError::damaged(path, "its results do not match their checksum");
    let (body, sum) = bytes.split_last_chunk::<4>().ok_or_else(damaged)?;
    if crc32fast::hash(body) != u32::from_le_bytes(*sum) {
        return Err(damaged());
    }
    let mut fields = Fields(body);
    let count = fields.u32().ok_or_else(damaged)? ^ MAGIC;
    let mut results = Vec::new();
    for _ in 0..count {
        results.push(entry(&mut fields).ok_or_else(damaged)?);
    }
    if fields.0.is_empty() { Ok(results) } else { Err(damaged()) }
}

/// Little-endian numbers, one after the other.
struct Fields<'a>(&'a [u8]);

impl Fields<'_> {
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, tail) = self.0.split_first_chunk::<N>()?;
        self.0 = tail;
        Some(*head)
    }

    fn u32(&mut self) -> Option<u32> {
        self.take().map(u32::from_le_bytes)
    }

    fn point(&mut self) -> Option<IVec3> {
        Some(IVec3::new(self.u32()? as i32, self.u32()? as i32, self.u32()? as i32))
    }

    fn f64(&mut self) -> Option<f64> {
        self.take().map(f64::from_le_bytes)
    }
}

fn entry(f: &mut Fields<'_>) -> Option<Refined> {
    let diamond = f.u32()?;
    let (error, color_error) = (f32::from_bits(f.u32()?), f32::from_bits(f.u32()?));
    let sphere = Sphere { center: DVec3::new(f.f64()?, f.f64()?, f.f64()?), radius: f.f64()? };
    let triangles = (f.u32()?, f.u32()?);
    let vertices = f.u32()?;
    let bounds = Aabb { min: f.point()?, max: f.point()? };
    let at = f.take().map(u64::from_le_bytes)?;
    let (bytes, sum, count) = (f.u32()?, f.u32()?, f.u32()?);
    let (mut patches, mut first) = (Vec::new(), 0u32);
    for _ in 0..count {
        let (count, diamond) = (f.u32()?, f.u32()?);
        patches.push(PatchRange { first, count, diamond });
        first = first.checked_add(count)?;
    }
    Some(Refined { diamond, file: 0, error, color_error, sphere, triangles, vertices, bounds, patches, at, bytes, sum })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_round_trip_bit_for_bit_and_damage_is_detected() {
        let scratch = Scratch::temporary().unwrap();
        let one = |n: u32| Refined {
            diamond: n,
            file: 0,
            error: 0.1 * n as f32,
            color_error: 1.0 / 3.0,
            sphere: Sphere { center: DVec3::new(1.0 / 7.0, -2.5, 1e9), radius: f64::from(n) / 3.0 },
            triangles: (n * 2, n),
            vertices: 9,
            bounds: Aabb { min: IVec3::new(-1, 0, 1), max: IVec3::new(5, 6, 7) },
            patches: (0..n).map(|i| PatchRange { first: i * 10, count: 10, diamond: i }).collect(),
            at: 1 << 40,
            bytes: 77,
            sum: 0xdead_beef,
        };
        let all: Vec<Refined> = (0..5).map(one).collect();
        write(&scratch, "r", &all).unwrap();
        assert_eq!(read(&scratch, "r").unwrap(), all);
        let whole = std::fs::read(scratch.path("r")).unwrap();
        for i in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[i] ^= 4;
            assert!(parse(&bytes, Path::new("r")).is_err(), "byte {i}");
            assert!(parse(&whole[..i], Path::new("r")).is_err(), "cut at {i}");
        }
    }
}
