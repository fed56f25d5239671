//! Binary STL: 80 bytes of text, the number of facets, 50 bytes for each. It has no colours and its numbers are floats:
//! where these are too short for the coordinates of the world, coordinates are relative to a point that is reported.

use super::format::{Encoder, Target};
use super::output::Scratch;
use super::stream::Counts;
use glam::{DVec3, Vec3};
use kilwa_geometry::{LatticePoint, Mesh};
use std::io::{Error, Write};

/// Bytes of the text that a file begins with.
const TEXT: usize = 80;

pub(super) struct Stl {
    target: Target,
}

impl Stl {
    pub(super) fn new(target: Target) -> Self {
        Self { target }
    }
}

impl Encoder for Stl {
    fn shares_vertices(&self) -> bool {
        false
    }

    fn vertex(&mut self, _: &mut Vec<u8>, _: &Mesh, _: usize) {}

    fn triangle(&mut self, out: &mut Vec<u8>, _: [u32; 3], points: [LatticePoint; 3]) {
        let [a, b, c] = points;
        let n = (b - a).as_dvec3().cross((c - a).as_dvec3());
        let length = n.length();
        // A facet without area has no normal: zero, as the format has it.
        let normal = if length > 0.0 { (n / length).as_vec3() } else { Vec3::ZERO };
        let position = |p: LatticePoint| {
            if self.target.needs_double {
                self.target.relative(p)
            } else {
                self.target.lattice.world_from_lattice(p).as_vec3()
            }
        };
        for x in std::iter::once(normal).chain(points.map(position)).flat_map(|v| v.to_array()) {
            out.extend(x.to_le_bytes());
        }
        out.extend([0; 2]);
    }

    fn assemble(&self, out: &mut dyn Write, scratch: &mut Scratch, counts: Counts) -> std::io::Result<()> {
        let count = u32::try_from(counts.triangles)
            .map_err(|_| Error::other("an STL can hold at most 4,294,967,295 triangles: use --max-triangles"))?;
        // It must not begin with "solid", as text files do.
        let mut header = format!("kilwa {}, metres, z up", env!("CARGO_PKG_VERSION"));
        if self.target.needs_double {
            let DVec3 { x, y, z } = self.target.lattice.world_from_lattice(self.target.center);
            header = format!("kilwa, m, z up, add {x} {y} {z}");
            if header.len() > TEXT {
                header = format!("add {x:e} {y:e} {z:e}");
            }
        }
        let mut header = header.into_bytes();
        header.resize(TEXT, b' ');
        out.write_all(&header)?;
        out.write_all(&count.to_le_bytes())?;
        scratch.copy_triangles(out)
    }
}
