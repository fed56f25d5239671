//! The sink that keeps a mesh in memory, for tests and for meshes known to be small.
//!
//! Input: what a reader delivers, in any order the contract of [`MeshSink`] allows. Output: a [`RawMesh`] in which every
//! position is finite, every index is below the number of vertices, every attribute is empty or has one value per
//! vertex, and no triangle names a vertex twice; at least one triangle. Whatever was dropped to get there is counted.
//! Fails where nothing is left, or where there are more vertices than 32 bits number.

use super::ReadError;
use super::sink::{MeshSink, NO_POSITION, NOT_FINITE, TWICE, UNUSED, VertexBlock, VertexSink};
use crate::{Diagnostics, RawMesh, UNCOLOURED};
use glam::{DVec3, Vec3};
use kilwa_pack::plural::counted;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

/// A triangle's own colour, where it has one.
type OwnColor = Option<[u8; 3]>;

/// Keeps one input in memory.
#[derive(Debug)]
pub struct MemorySink {
    path: PathBuf,
    mesh: RawMesh,
    /// Vertices delivered without a normal.
    without_normal: u64,
    /// Empty, or the own colour of each triangle.
    colors: Vec<OwnColor>,
    /// Triangles delivered.
    delivered: u64,
}

impl MemorySink {
    /// An empty sink; `path` names the input in messages.
    pub fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), mesh: RawMesh::default(), without_normal: 0, colors: Vec::new(), delivered: 0 }
    }

    /// The mesh, with all that [`RawMesh`] promises.
    ///
    /// # Errors
    /// [`ReadError::NoTriangles`] where none is left, [`ReadError::TooLarge`] beyond 2^32 vertices.
    pub fn into_mesh(mut self) -> Result<RawMesh, ReadError> {
        if self.without_normal > 0 && !self.mesh.normals.is_empty() {
            let n = self.mesh.normals.len() as u64 - self.without_normal;
            self.mesh.diagnostics.add_many("normals dropped and computed anew, because other vertices have none", n);
            self.mesh.normals = Vec::new();
        } else if self.without_normal > 0 {
            self.mesh.normals = Vec::new();
        }
        let Self { path, mut mesh, mut colors, delivered, .. } = self;
        drop_without_position(&mut mesh, &mut colors);
        if !colors.is_empty() {
            split_wedges(&mut mesh, &colors, &path)?;
        }
        if mesh.triangles.is_empty() {
            let reasons: Vec<String> = mesh.diagnostics.iter().map(|(kind, n, _)| format!("{kind}: {n}")).collect();
            return Err(ReadError::NoTriangles {
                file: path,
                found: format!(
                    "of its {} none is left ({})",
                    counted(delivered, "triangle", "triangles"),
                    reasons.join("; ")
                ),
                way_out: "Export the mesh again and give that",
            });
        }
        let mut used = vec![false; mesh.positions.len()];
        mesh.triangles.iter().flatten().for_each(|&i| used[i as usize] = true);
        let unused = used.iter().filter(|u| !**u).count();
        mesh.diagnostics.add_many(UNUSED, unused as u64);
        Ok(mesh)
    }

    fn too_many(&self) -> ReadError {
        let what = format!("more than {} vertices in memory: split it into blocks", u32::MAX);
        ReadError::TooLarge { file: self.path.clone(), what }
    }
}

impl VertexSink for MemorySink {
    fn channels(&mut self, names: &[String]) -> Result<(), ReadError> {
        self.mesh.scalars = names.iter().map(|name| (name.clone(), Vec::new())).collect();
        Ok(())
    }

    fn vertices(&mut self, block: &VertexBlock<'_>) -> Result<(), ReadError> {
        let (before, n) = (self.mesh.positions.len(), block.positions.len());
        if before + n > u32::MAX as usize {
            return Err(self.too_many());
        }
        let mesh = &mut self.mesh;
        mesh.positions.extend(block.positions);
        if block.colors.is_empty() && !mesh.colors.is_empty() {
            mesh.diagnostics.add_many("vertices without colour beside coloured ones, shown grey", n as u64);
            mesh.colors.resize(before + n, UNCOLOURED);
        } else if !block.colors.is_empty() {
            if mesh.colors.is_empty() {
                mesh.diagnostics.add_many("vertices without colour beside coloured ones, shown grey", before as u64);
                mesh.colors.resize(before, UNCOLOURED);
            }
            mesh.colors.extend(block.colors);
        }
        if block.normals.is_empty() {
            self.without_normal += n as u64;
            mesh.normals.resize(before + n, Vec3::ZERO);
        } else {
            mesh.normals.extend(block.normals);
        }
        for ((_, values), more) in mesh.scalars.iter_mut().zip(block.scalars) {
            values.extend(more);
        }
        // A channel without values in this block has none.
        mesh.scalars.iter_mut().for_each(|(_, values)| values.resize(before + n, f32::NAN));
        Ok(())
    }

    fn vertex_count(&self) -> u64 {
        self.mesh.positions.len() as u64
    }

    fn diagnostics(&mut self) -> &mut Diagnostics {
        &mut self.mesh.diagnostics
    }
}

impl MeshSink for MemorySink {
    fn triangles(&mut self, triangles: &[[u64; 3]], colors: &[[u8; 3]]) -> Result<(), ReadError> {
        self.delivered += triangles.len() as u64;
        if !colors.is_empty() && self.colors.is_empty() {
            self.colors.resize(self.mesh.triangles.len(), None);
        }
        let colored = !colors.is_empty() || !self.colors.is_empty();
        for (i, t) in triangles.iter().enumerate() {
            if t[0] == t[1] || t[1] == t[2] || t[2] == t[0] {
                self.mesh
                    .diagnostics
                    .add(TWICE, || format!("triangle of the vertices {}, {} and {}", t[0], t[1], t[2]));
                continue;
            }
            if t.iter().any(|&v| v >= u64::from(u32::MAX)) {
                return Err(self.too_many());
            }
            self.mesh.triangles.push(t.map(|v| v as u32));
            if colored {
                self.colors.push(colors.get(i).copied());
            }
        }
        Ok(())
    }

    fn positions(&mut self, of: &[u64], into: &mut Vec<DVec3>) -> Result<(), ReadError> {
        let at = |v: u64| usize::try_from(v).ok().and_then(|v| self.mesh.positions.get(v).copied());
        into.extend(of.iter().map(|&v| at(v).unwrap_or(DVec3::NAN)));
        Ok(())
    }
}

/// Drop the vertices without a finite position and the triangles at them or at vertices that never came.
fn drop_without_position(mesh: &mut RawMesh, colors: &mut Vec<OwnColor>) {
    let finite = |p: &DVec3| p.is_finite();
    let n = mesh.positions.len();
    let named = mesh.triangles.iter().flatten().all(|&v| (v as usize) < n);
    if named && mesh.positions.iter().all(finite) {
        return;
    }
    let keep: Vec<bool> = mesh.positions.iter().map(finite).collect();
    for (number, p) in mesh.positions.iter().enumerate().filter(|(number, _)| !keep[*number]) {
        mesh.diagnostics.add(NO_POSITION, || format!("vertex {number} ({} {} {})", p.x, p.y, p.z));
    }
    let stays = |t: &[u32; 3]| t.iter().all(|&i| keep.get(i as usize) == Some(&true));
    let mut triangles = mesh.triangles.iter();
    colors.retain(|_| triangles.next().is_some_and(stays));
    let diagnostics = &mut mesh.diagnostics;
    mesh.triangles.retain(|t| {
        if !stays(t) {
            diagnostics.add(NOT_FINITE, || format!("triangle of the vertices {}, {} and {}", t[0], t[1], t[2]));
        }
        stays(t)
    });
    retain_vertices(mesh, &keep);
}

/// Drop the vertices that are not to be kept; no triangle may name one.
fn retain_vertices(mesh: &mut RawMesh, keep: &[bool]) {
    fn retain<T>(values: &mut Vec<T>, keep: &[bool]) {
        let mut kept = keep.iter();
        values.retain(|_| kept.next().copied().unwrap_or_default());
    }
    retain(&mut mesh.positions, keep);
    retain(&mut mesh.colors, keep);
    retain(&mut mesh.normals, keep);
    for (_, values) in &mut mesh.scalars {
        retain(values, keep);
    }
    let mut next = 0;
    let new_index: Vec<u32> = keep
        .iter()
        .map(|&k| {
            let index = next;
            next += u32::from(k);
            index
        })
        .collect();
    mesh.triangles.iter_mut().flatten().for_each(|i| *i = new_index[*i as usize]);
}

/// Give each triangle's own colour to its corners; a vertex where triangles of several colours meet becomes several. The
/// corners of triangles without a colour keep the colour of the vertex.
fn split_wedges(mesh: &mut RawMesh, colors: &[OwnColor], path: &Path) -> Result<(), ReadError> {
    let vertices = mesh.positions.len();
    let own = |v: u32, mesh: &[[u8; 3]]| mesh.get(v as usize).copied().unwrap_or(UNCOLOURED);
    let mut first: Vec<OwnColor> = vec![None; vertices];
    let mut wedges: HashMap<(u32, [u8; 3]), u32> = HashMap::new();
    let mut origins = Vec::new();
    for (triangle, color) in mesh.triangles.iter_mut().zip(colors) {
        for corner in triangle {
            let color = color.unwrap_or_else(|| own(*corner, &mesh.colors));
            if *first[*corner as usize].get_or_insert(color) == color {
                continue;
            }
            let next = u32::try_from(vertices + origins.len()).map_err(|_| ReadError::TooLarge {
                file: path.to_owned(),
                what: "colours per face split it into more than 4294967295 vertices: split it into blocks".to_owned(),
            })?;
            let wedge = *wedges.entry((*corner, color)).or_insert(next);
            if wedge == next {
                origins.push((*corner as usize, color));
            }
            *corner = wedge;
        }
    }
    let given = colors.iter().flatten().count();
    mesh.diagnostics.add_many("triangles whose colour was given to their vertices", given as u64);
    mesh.diagnostics.add_many("vertices split so that faces keep their colours", origins.len() as u64);
    mesh.colors = (0u32..).zip(first).map(|(v, color)| color.unwrap_or_else(|| own(v, &mesh.colors))).collect();
    mesh.colors.extend(origins.iter().map(|(_, color)| *color));
    append_copies(&mut mesh.positions, &origins);
    append_copies(&mut mesh.normals, &origins);
    for (_, values) in &mut mesh.scalars {
        append_copies(values, &origins);
    }
    Ok(())
}

/// Append a copy of the value of each wedge's vertex; nothing where the attribute is absent.
fn append_copies<T: Copy>(values: &mut Vec<T>, origins: &[(usize, [u8; 3])]) {
    if !values.is_empty() {
        values.reserve_exact(origins.len());
        for &(origin, _) in origins {
            let value = values[origin];
            values.push(value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TRIANGLE: [DVec3; 3] = [DVec3::ZERO, DVec3::X, DVec3::Y];

    fn sink(positions: &[DVec3]) -> MemorySink {
        let mut sink = MemorySink::new(Path::new("a.mesh"));
        sink.vertices(&VertexBlock { positions, ..VertexBlock::default() }).unwrap();
        sink
    }

    #[test]
    fn triangles_at_vertices_that_are_not_finite_or_never_came_are_dropped_and_counted() {
        let mut s = sink(&[DVec3::ZERO, DVec3::new(f64::NAN, 0.0, 0.0), DVec3::X, DVec3::Y]);
        s.triangles(&[[0, 1, 2], [0, 2, 3], [0, 2, 9], [3, 3, 0]], &[]).unwrap();
        let mesh = s.into_mesh().unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2]]);
        assert_eq!((mesh.diagnostics.count(NOT_FINITE), mesh.diagnostics.count(TWICE)), (2, 1));
        assert_eq!(mesh.diagnostics.count(NO_POSITION), 1);
    }

    #[test]
    fn a_triangle_may_come_before_its_vertices() {
        let mut s = sink(&[DVec3::ZERO]);
        s.triangles(&[[0, 1, 2]], &[]).unwrap();
        s.vertices(&VertexBlock { positions: &[DVec3::X, DVec3::Y], ..VertexBlock::default() }).unwrap();
        assert_eq!(s.into_mesh().unwrap().triangles, [[0, 1, 2]]);
    }

    #[test]
    fn vertices_without_colour_beside_coloured_ones_are_grey_and_counted() {
        for coloured_first in [true, false] {
            let mut s = MemorySink::new(Path::new("a.mesh"));
            for coloured in [coloured_first, !coloured_first] {
                let colors: &[[u8; 3]] = if coloured { &[[1, 2, 3]; 3] } else { &[] };
                s.vertices(&VertexBlock { positions: &TRIANGLE, colors, ..VertexBlock::default() }).unwrap();
            }
            s.triangles(&[[0, 1, 2], [3, 4, 5]], &[]).unwrap();
            let mesh = s.into_mesh().unwrap();
            assert_eq!(mesh.colors.iter().filter(|c| **c == UNCOLOURED).count(), 3);
            assert_eq!(mesh.diagnostics.count("vertices without colour beside coloured ones, shown grey"), 3);
        }
    }

    #[test]
    fn a_triangle_without_a_colour_of_its_own_keeps_those_of_its_vertices() {
        let mut s = MemorySink::new(Path::new("a.mesh"));
        let positions = &[DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::new(1.0, 1.0, 0.0)];
        s.vertices(&VertexBlock { positions, colors: &[[9; 3]; 4], ..VertexBlock::default() }).unwrap();
        s.triangles(&[[0, 1, 2]], &[[1, 2, 3]]).unwrap();
        s.triangles(&[[2, 1, 3]], &[]).unwrap();
        let mesh = s.into_mesh().unwrap();
        assert!(mesh.triangles[0].iter().all(|&v| mesh.colors[v as usize] == [1, 2, 3]));
        assert!(mesh.triangles[1].iter().all(|&v| mesh.colors[v as usize] == [9; 3]));
    }

    #[test]
    fn normals_of_only_some_vertices_are_dropped_and_counted() {
        let mut s = sink(&[DVec3::ZERO]);
        let positions = &[DVec3::X, DVec3::Y];
        s.vertices(&VertexBlock { positions, normals: &[Vec3::Z; 2], ..VertexBlock::default() }).unwrap();
        s.triangles(&[[0, 1, 2]], &[]).unwrap();
        let mesh = s.into_mesh().unwrap();
        assert!(mesh.normals.is_empty());
        let kind = "normals dropped and computed anew, because other vertices have none";
        assert_eq!(mesh.diagnostics.count(kind), 2);
    }

    #[test]
    fn an_input_left_without_triangles_is_refused_with_the_reasons() {
        let mut s = sink(&[DVec3::ZERO, DVec3::NAN]);
        s.triangles(&[[0, 0, 1], [0, 1, 7]], &[]).unwrap();
        let text = s.into_mesh().unwrap_err().to_string();
        assert!(text.contains("a.mesh") && text.contains("of its 2 triangles none is left"), "{text}");
        assert!(text.contains("name a vertex twice"), "{text}");
    }
}
