//! One welded mesh, and how it is written as PLY (Turk, "The PLY Polygon File Format", 1994).

use anyhow::Context;
use kilwa_geometry::{Lattice, Mesh, normal};
use kilwa_pack::{PatchRange, Reader, Source};
use std::collections::HashMap;
use std::io::Write;

/// All that makes a vertex: position, colour, normal, bits of the scalars.
type Wedge = ([i32; 3], [u8; 3], [i16; 2], Vec<u32>);

/// Patches joined to one mesh: equal vertices are one.
#[derive(Default)]
pub(super) struct Welded {
    mesh: Mesh,
    known: HashMap<Wedge, u32>,
}

impl Welded {
    /// Add the triangles of one patch.
    ///
    /// # Errors
    /// When there are more vertices than PLY's `int` indices can name.
    pub(super) fn add(&mut self, from: &Mesh, patch: &PatchRange) -> anyhow::Result<()> {
        let first = patch.first as usize;
        for triangle in &from.triangles[first..first + patch.count as usize] {
            let mut corners = [0; 3];
            for (corner, &v) in corners.iter_mut().zip(triangle) {
                let v = v as usize;
                let wedge = (
                    from.positions[v],
                    from.colors.get(v).copied().unwrap_or_default(),
                    from.normals[v],
                    from.scalars.iter().map(|s| s[v].to_bits()).collect(),
                );
                *corner = if let Some(&known) = self.known.get(&wedge) {
                    known
                } else {
                    let new = self.mesh.push_vertex_of(from, v);
                    i32::try_from(new).context("a PLY cannot name more than 2^31 vertices: ask for fewer triangles")?;
                    self.known.insert(wedge, new);
                    new
                };
            }
            self.mesh.triangles.push(corners);
        }
        Ok(())
    }

    pub(super) fn triangle_count(&self) -> u64 {
        self.mesh.triangles.len() as u64
    }

    pub(super) fn vertex_count(&self) -> u64 {
        self.mesh.positions.len() as u64
    }
}

/// How numbers are written.
#[derive(Clone, Copy)]
pub(super) struct Layout {
    ascii: bool,
    /// Coordinates need `double`.
    double: bool,
}

impl Layout {
    /// `float` where it holds every coordinate of the pack to a quarter of a lattice step, else `double`.
    pub(super) fn of<S: Source>(reader: &Reader<S>, ascii: bool) -> Self {
        let header = reader.header();
        let side = f64::from(1u32 << header.cube_log2);
        let far = header.lattice.world_from_steps([side; 3]);
        let largest = far.iter().chain(&header.lattice.origin).fold(0.0f64, |m, x| m.max(x.abs()));
        // Half a unit in the last place of a float is 2^-24 of the power of two below the number.
        let rounding = largest * 2f64.powi(-24);
        Self { ascii, double: rounding > header.lattice.step() * 0.25 }
    }

    /// The PLY name of the type of coordinates.
    pub(super) fn coordinate_type(self) -> &'static str {
        if self.double { "double" } else { "float" }
    }
}

/// Write header, vertices and triangles.
pub(super) fn write<S: Source>(
    out: &mut dyn Write,
    welded: &Welded,
    reader: &Reader<S>,
    layout: Layout,
    comment: &str,
) -> std::io::Result<()> {
    let mesh = &welded.mesh;
    let metadata = reader.metadata();
    let colors = reader.header().attributes.colors;
    writeln!(out, "ply")?;
    writeln!(out, "format {} 1.0", if layout.ascii { "ascii" } else { "binary_little_endian" })?;
    writeln!(out, "comment {}", one_line(&metadata.title))?;
    writeln!(out, "comment kilwa {}: {comment}", env!("CARGO_PKG_VERSION"))?;
    writeln!(out, "comment metres, z up, crs {}", one_line(metadata.crs.as_deref().unwrap_or("unknown")))?;
    writeln!(out, "element vertex {}", mesh.positions.len())?;
    for axis in ["x", "y", "z"] {
        writeln!(out, "property {} {axis}", layout.coordinate_type())?;
    }
    if colors {
        for channel in ["red", "green", "blue"] {
            writeln!(out, "property uchar {channel}")?;
        }
    }
    for axis in ["nx", "ny", "nz"] {
        writeln!(out, "property float {axis}")?;
    }
    for name in scalar_names(metadata.scalars.iter().map(|s| s.name.as_str())) {
        writeln!(out, "property float {name}")?;
    }
    writeln!(out, "element face {}", mesh.triangles.len())?;
    writeln!(out, "property list uchar int vertex_indices")?;
    writeln!(out, "end_header")?;
    for v in 0..mesh.positions.len() {
        write_vertex(out, mesh, v, &reader.header().lattice, layout)?;
    }
    for triangle in &mesh.triangles {
        let [a, b, c] = triangle;
        if layout.ascii {
            writeln!(out, "3 {a} {b} {c}")?;
        } else {
            out.write_all(&[3])?;
            for corner in triangle {
                out.write_all(&corner.to_le_bytes())?;
            }
        }
    }
    Ok(())
}

fn write_vertex(out: &mut dyn Write, mesh: &Mesh, v: usize, lattice: &Lattice, layout: Layout) -> std::io::Result<()> {
    let world = lattice.world_from_lattice(mesh.positions[v]);
    let normal = normal::decode(mesh.normals[v]).map(|x| x as f32);
    let color = mesh.colors.get(v);
    let scalars = mesh.scalars.iter().map(|s| s[v]);
    if layout.ascii {
        let mut words: Vec<String> =
            world.iter().map(|x| if layout.double { x.to_string() } else { (*x as f32).to_string() }).collect();
        words.extend(color.iter().flat_map(|c| c.iter()).map(ToString::to_string));
        words.extend(normal.iter().map(ToString::to_string));
        words.extend(scalars.map(|x| x.to_string()));
        return writeln!(out, "{}", words.join(" "));
    }
    for x in world {
        if layout.double {
            out.write_all(&x.to_le_bytes())?;
        } else {
            out.write_all(&(x as f32).to_le_bytes())?;
        }
    }
    if let Some(c) = color {
        out.write_all(c)?;
    }
    for x in normal.into_iter().chain(scalars) {
        out.write_all(&x.to_le_bytes())?;
    }
    Ok(())
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

/// Text for a header line.
fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scalar_names_stay_apart_and_legal() {
        let names = scalar_names(["confidence", "x", "a b", "confidence", ""].into_iter());
        assert_eq!(names, ["confidence", "scalar_x", "a_b", "scalar_confidence", "scalar_"]);
    }
}
