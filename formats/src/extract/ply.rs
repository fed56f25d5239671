//! PLY (Turk, "The PLY Polygon File Format", 1994): everything that the pack has.

use super::format::{Encoder, Target, one_line};
use super::output::Scratch;
use super::stream::Counts;
use kilwa_geometry::{LatticePoint, Mesh, normal};
use std::io::Write;

pub(super) struct Ply {
    target: Target,
    ascii: bool,
}

impl Ply {
    /// Coordinates are `float` where that keeps every lattice point apart, else `double`.
    pub(super) fn new(target: Target, ascii: bool) -> Self {
        Self { target, ascii }
    }

    fn header(&self, out: &mut dyn Write, counts: Counts) -> std::io::Result<()> {
        let target = &self.target;
        writeln!(out, "ply")?;
        writeln!(out, "format {} 1.0", if self.ascii { "ascii" } else { "binary_little_endian" })?;
        writeln!(out, "comment {}", one_line(&target.metadata.title))?;
        writeln!(out, "comment {}", target.comment(counts.error))?;
        writeln!(out, "comment {}", target.frame())?;
        writeln!(out, "element vertex {}", counts.vertices)?;
        for axis in ["x", "y", "z"] {
            writeln!(out, "property {} {axis}", if target.needs_double { "double" } else { "float" })?;
        }
        if target.colors {
            for channel in ["red", "green", "blue"] {
                writeln!(out, "property uchar {channel}")?;
            }
        }
        for axis in ["nx", "ny", "nz"] {
            writeln!(out, "property float {axis}")?;
        }
        for name in scalar_names(target.metadata.scalars.iter().map(|s| s.name.as_str())) {
            writeln!(out, "property float {name}")?;
        }
        if counts.triangles > 0 {
            writeln!(out, "element face {}", counts.triangles)?;
            writeln!(out, "property list uchar int vertex_indices")?;
        }
        writeln!(out, "end_header")
    }

    fn text(&self, out: &mut Vec<u8>, mesh: &Mesh, v: usize) {
        let world = self.target.lattice.world_from_lattice(mesh.positions[v]);
        let double = self.target.needs_double;
        let mut words: Vec<String> =
            world.to_array().iter().map(|x| if double { x.to_string() } else { (*x as f32).to_string() }).collect();
        words.extend(mesh.colors.get(v).into_iter().flatten().map(ToString::to_string));
        words.extend(normal::decode(mesh.normals[v]).to_array().iter().map(|x| (*x as f32).to_string()));
        words.extend(mesh.scalars.iter().map(|s| s[v].to_string()));
        out.extend(words.join(" ").into_bytes());
        out.push(b'\n');
    }
}

impl Encoder for Ply {
    fn writes_points(&self) -> bool {
        true
    }

    /// Indices are `int`.
    fn max_vertices(&self) -> u32 {
        i32::MAX as u32
    }

    fn vertex(&mut self, out: &mut Vec<u8>, mesh: &Mesh, v: usize) {
        if self.ascii {
            return self.text(out, mesh, v);
        }
        for x in self.target.lattice.world_from_lattice(mesh.positions[v]).to_array() {
            if self.target.needs_double {
                out.extend(x.to_le_bytes());
            } else {
                out.extend((x as f32).to_le_bytes());
            }
        }
        out.extend(mesh.colors.get(v).into_iter().flatten());
        let normal = normal::decode(mesh.normals[v]).as_vec3();
        for x in normal.to_array().into_iter().chain(mesh.scalars.iter().map(|s| s[v])) {
            out.extend(x.to_le_bytes());
        }
    }

    fn triangle(&mut self, out: &mut Vec<u8>, corners: [u32; 3], _: [LatticePoint; 3]) {
        if self.ascii {
            let [a, b, c] = corners;
            // Writing to memory does not fail.
            let _ = writeln!(out, "3 {a} {b} {c}");
            return;
        }
        out.push(3);
        for corner in corners {
            out.extend(corner.to_le_bytes());
        }
    }

    fn assemble(&self, out: &mut dyn Write, scratch: &mut Scratch, counts: Counts) -> std::io::Result<()> {
        self.header(out, counts)?;
        scratch.copy_vertices(out)?;
        scratch.copy_triangles(out)
    }
}

/// PLY property names: no blanks, none used twice, none that this file uses for something else.
fn scalar_names<'a>(names: impl Iterator<Item = &'a str>) -> Vec<String> {
    let mut used: Vec<String> = ["x", "y", "z", "red", "green", "blue", "nx", "ny", "nz"].map(str::to_owned).to_vec();
    let fixed = used.len();
    for name in names {
        let mut clean: String = name.chars().map(|c| if c.is_ascii_graphic() { c } else { '_' }).collect();
        if clean.is_empty() || used.contains(&clean) {
            clean = format!("scalar_{clean}");
        }
        while used.contains(&clean) {
            clean.push('_');
        }
        used.push(clean);
    }
    used.split_off(fixed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scalar_names_stay_distinct_and_valid() {
        let names = scalar_names(["confidence", "x", "a b", "confidence", ""].into_iter());
        assert_eq!(names, ["confidence", "scalar_x", "a_b", "scalar_confidence", "scalar_"]);
    }
}
