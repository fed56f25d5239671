//! OBJ: `v x y z r g b` with colours of 0 to 1, and `f` with indices from 1 (Wavefront; the colours as MeshLab, Blender
//! and CloudCompare write and read them).

use super::format::{Encoder, Target, one_line};
use super::output::Scratch;
use super::stream::Counts;
use glam::DVec3;
use kilwa_geometry::{LatticePoint, Mesh};
use std::io::Write;

pub(super) struct Obj {
    target: Target,
}

impl Obj {
    pub(super) fn new(target: Target) -> Self {
        Self { target }
    }
}

impl Encoder for Obj {
    fn vertex(&mut self, out: &mut Vec<u8>, mesh: &Mesh, v: usize) {
        let DVec3 { x, y, z } = self.target.lattice.world_from_lattice(mesh.positions[v]);
        // Writing to memory does not fail.
        let _ = write!(out, "v {x} {y} {z}");
        for c in mesh.colors.get(v).into_iter().flatten() {
            // Rounded up, so that programs that cut instead of rounding get the same colour.
            let millionths = (u32::from(*c) * 1_000_000).div_ceil(255);
            let _ = write!(out, " {}.{:06}", millionths / 1_000_000, millionths % 1_000_000);
        }
        out.push(b'\n');
    }

    fn triangle(&mut self, out: &mut Vec<u8>, corners: [u32; 3], _: [LatticePoint; 3]) {
        let [a, b, c] = corners.map(|v| u64::from(v) + 1);
        let _ = writeln!(out, "f {a} {b} {c}");
    }

    fn assemble(&self, out: &mut dyn Write, scratch: &mut Scratch, counts: Counts) -> std::io::Result<()> {
        writeln!(out, "# {}", one_line(&self.target.metadata.title))?;
        writeln!(out, "# {}", self.target.comment(counts.error))?;
        writeln!(out, "# {}", self.target.frame())?;
        scratch.copy_vertices(out)?;
        scratch.copy_triangles(out)
    }
}
