//! A small GLB of a pack, for programs that open nothing else: the coarsest of what it has, at zero, under a limit of bytes.

use super::choose;
use super::format::{Format, Target};
use super::output::Output;
use super::stream;
use crate::source::open_pack;
use anyhow::Context;
use std::path::Path;

/// What was written.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Preview {
    /// Length of the file.
    pub(crate) bytes: u64,
    /// Triangles in it.
    pub(crate) triangles: u64,
    /// Certified error against the finest surface, metres.
    pub(crate) error: f32,
}

/// Bytes of a triangle with its share of the vertices: 12 and half of 32, and seams.
const BYTES_PER_TRIANGLE: u64 = 29;
/// How often fewer triangles are tried.
const TRIES: u32 = 6;

/// Write the best surface of the pack at `pack` that takes at most `most_bytes` as GLB to `to`, a new file.
/// The model stands at zero, because viewers that compute in `float` break far from it; its place is told in `asset.extras`.
///
/// # Errors
/// When the pack cannot be read, its coarsest surface takes more than that, or the file cannot be written.
pub(crate) fn write(pack: &Path, to: &Path, most_bytes: u64) -> anyhow::Result<Preview> {
    let of_pack = || pack.display().to_string();
    let reader = open_pack(pack)?;
    let mut most = (most_bytes / BYTES_PER_TRIANGLE).max(1);
    for _ in 0..TRIES {
        let chosen = choose::choose(&reader, None, Some(most), None).with_context(of_pack)?;
        let target = Target::new(&reader, &chosen, None, Format::Glb).with_context(of_pack)?;
        let target = Target { at_zero: true, ..target };
        let mut encoder = Format::Glb.encoder(&target);
        let output = Output::prepare(to, false)?;
        let mut scratch = output.scratch()?;
        let counts =
            stream::stream(&reader, &chosen, None, &mut *encoder, &mut scratch, &|_| {}).with_context(of_pack)?;
        anyhow::ensure!(counts.triangles > 0, "{}: it holds no triangle", pack.display());
        let mut bytes = Vec::new();
        encoder.assemble(&mut bytes, &mut scratch, counts).with_context(|| format!("cannot make {}", to.display()))?;
        let length = bytes.len() as u64;
        if length <= most_bytes {
            output.write(|out| out.write_all(&bytes))?;
            return Ok(Preview { bytes: length, triangles: counts.triangles, error: chosen.error });
        }
        if counts.triangles > most {
            break;
        }
        most = (counts.triangles * most_bytes / length).min(most * 9 / 10).max(1);
    }
    anyhow::bail!("{}: its coarsest surface takes more than {most_bytes} bytes as GLB", pack.display())
}

#[cfg(test)]
mod tests {
    use super::*;
    use kilwa_builder::{BuildOptions, Silent, build_pack};
    use kilwa_formats::RawMesh;

    /// A rough square of 80,000 triangles at map coordinates.
    fn square(folder: &Path) -> std::path::PathBuf {
        let n = 200u32;
        let height = |i: u32, j: u32| f64::from((i * 7919 + j * 104_729) % 97) * 0.0005;
        let at = |i: u32, j: u32| [524_000.0 + f64::from(i) * 0.05, 9_012_000.0 + f64::from(j) * 0.05, height(i, j)];
        let mesh = RawMesh {
            positions: (0..=n).flat_map(|j| (0..=n).map(move |i| at(i, j))).collect(),
            triangles: (0..n)
                .flat_map(|j| (0..n).map(move |i| (i + j * (n + 1), n + 1)))
                .flat_map(|(a, row)| [[a, a + 1, a + row + 1], [a, a + row + 1, a + row]])
                .collect(),
            ..RawMesh::default()
        };
        let path = folder.join("square.kilwa");
        let built = build_pack(mesh, &BuildOptions::default(), &Silent).expect("builds");
        std::fs::write(&path, built.bytes).expect("writes");
        path
    }

    #[test]
    fn it_keeps_the_limit_and_uses_most_of_it_and_stands_at_zero() {
        let work = tempfile::tempdir().expect("a folder");
        let (pack, to) = (square(work.path()), work.path().join("preview.glb"));
        let preview = write(&pack, &to, 900_000).expect("writes");
        let bytes = std::fs::read(&to).expect("reads");
        assert_eq!(preview.bytes, bytes.len() as u64);
        assert!((450_000..=900_000).contains(&bytes.len()), "{} bytes", bytes.len());
        assert!(preview.error > 0.0 && preview.triangles > 10_000, "{preview:?}");
        let length = u32::from_le_bytes(bytes[12..16].try_into().expect("four")) as usize;
        let json: serde_json::Value = serde_json::from_slice(&bytes[20..20 + length]).expect("JSON");
        let matrix = &json["nodes"][0]["matrix"];
        assert_eq!([&matrix[12], &matrix[13], &matrix[14]].map(serde_json::Value::as_f64), [Some(0.0); 3], "{matrix}");
        let place = json["extras"]["world_from_local_m"][0].as_f64().expect("a number");
        assert!((place - 524_005.0).abs() < 1.0, "{place}");
    }

    #[test]
    fn a_limit_below_the_coarsest_surface_is_refused_and_leaves_nothing() {
        let work = tempfile::tempdir().expect("a folder");
        let (pack, to) = (square(work.path()), work.path().join("preview.glb"));
        let said = write(&pack, &to, 2000).expect_err("too small").to_string();
        assert!(said.contains("coarsest surface takes more than 2000 bytes"), "{said}");
        assert_eq!(std::fs::read_dir(work.path()).expect("lists").count(), 1);
    }
}
