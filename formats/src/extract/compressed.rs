//! GLB with `EXT_meshopt_compression`: one mesh of one node, in primitives with at most 65,535 vertices.
//!
//! Vertices and triangles are collected as they come, and compressed part by part when all are known: memory follows the size of a part. Vertices at the
//! border between two parts are stored in both, with the same coordinates. Positions within 2^23 steps of the middle are
//! restored exactly, and farther ones are rounded to 23 significant bits; normals are rounded to 8 bits, colours restored to the same level of sRGB.

use super::format::{Encoder, Target};
use super::gltf::{BYTE, FLOAT, UNSIGNED_SHORT, begin, document, padded};
use super::meshopt::{MESHOPT, QUANTIZED, ViewError, Views, colored, exponential, octahedral, ordered};
use super::output::Scratch;
use super::stream::Counts;
use glam::{DVec3, IVec3};
use kilwa_geometry::{LatticePoint, Mesh, normal};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::fs::File;
use std::io::{BufReader, BufWriter, Error, Read, Seek, SeekFrom, Write};

/// Bytes of a vertex in the scratch file: position, normal, colour and a byte for alignment.
const VERTEX: usize = 20;
/// Bytes of a triangle there.
const TRIANGLE: usize = 12;
/// Vertices and triangles of a part.
const VERTICES_MAX: usize = 65_535;
const TRIANGLES_MAX: usize = 65_536;
/// Vertices that are read although they are not needed, rather than searched for.
const GAP: u32 = 200;
/// Vertices that are read at once.
const RUN_MAX: u32 = 200_000;
/// Largest mantissa of the exponential filter.
const MANTISSA_MAX: i32 = (1 << 23) - 1;

pub(super) struct Compressed {
    target: Target,
}

/// A vertex as it was collected.
#[derive(Clone, Copy, Default)]
struct Vertex {
    /// Steps from the middle.
    position: IVec3,
    normal: [i16; 2],
    color: [u8; 3],
}

/// A part of the mesh.
#[derive(Default)]
struct Part {
    /// Numbers of its vertices among all, in the order in which triangles name them first.
    names: Vec<u32>,
    /// The reverse.
    numbers: HashMap<u32, u32>,
    /// Corners by their numbers in the part.
    corners: Vec<u32>,
}

impl Part {
    fn is_full(&self) -> bool {
        self.names.len() + 3 > VERTICES_MAX || self.corners.len() >= 3 * TRIANGLES_MAX
    }

    fn add(&mut self, corner: u32) {
        let Self { names, numbers, corners } = self;
        corners.push(*numbers.entry(corner).or_insert_with(|| {
            names.push(corner);
            names.len() as u32 - 1
        }));
    }
}

impl Compressed {
    pub(super) fn new(target: Target) -> Self {
        Self { target }
    }

    /// Compress a part and describe it in the JSON.
    fn write_part(
        &self,
        part: &Part,
        vertices: &[Vertex],
        views: &mut Views<&mut BufWriter<File>>,
        file: &mut Value,
    ) -> Result<(), ViewError> {
        let (indices, order) = ordered(&part.corners, vertices.len()).map_err(ViewError::Encode)?;
        let vertices: Vec<Vertex> = order.iter().map(|v| vertices[*v]).collect();
        let count = vertices.len();
        let step_log2 = self.target.lattice.step_log2;
        let (mut bytes, mut min, mut max) = (Vec::with_capacity(12 * count), DVec3::MAX, DVec3::MIN);
        for vertex in &vertices {
            let restored = vertex.position.to_array().map(|x| {
                let (mantissa, shift) = shortened(x);
                let exponent = step_log2 + shift;
                bytes.extend(exponential(mantissa, exponent as i8));
                libm::scalbn(f64::from(mantissa), exponent)
            });
            (min, max) = (min.min(restored.into()), max.max(restored.into()));
        }
        let (min, max) = (min.to_array(), max.to_array());
        let view = views.vertices(&bytes, count, 12, "EXPONENTIAL")?;
        let mut accessors = file["accessors"].as_array_mut().map(std::mem::take).unwrap_or_default();
        let mut accessor = |value: Value| {
            accessors.push(value);
            accessors.len() - 1
        };
        let mut attributes = json!({"POSITION": accessor(json!({"bufferView": view, "componentType": FLOAT,
            "count": count, "type": "VEC3", "min": min, "max": max}))});
        let normals: Vec<[f32; 3]> = vertices.iter().map(|v| normal::decode(v.normal).as_vec3().to_array()).collect();
        let view = views.vertices(&octahedral(&normals).map_err(ViewError::Encode)?, count, 4, "OCTAHEDRAL")?;
        attributes["NORMAL"] = json!(accessor(json!({"bufferView": view, "componentType": BYTE, "normalized": true,
            "count": count, "type": "VEC3"})));
        if self.target.colors {
            let colors: Vec<[u8; 3]> = vertices.iter().map(|v| v.color).collect();
            let view = views.vertices(&colored(&colors).map_err(ViewError::Encode)?, count, 12, "EXPONENTIAL")?;
            attributes["COLOR_0"] =
                json!(accessor(json!({"bufferView": view, "componentType": FLOAT, "count": count, "type": "VEC3"})));
        }
        let view = views.triangles(&indices)?;
        let indices = accessor(json!({"bufferView": view, "componentType": UNSIGNED_SHORT, "count": indices.len(),
            "type": "SCALAR"}));
        file["accessors"] = Value::Array(accessors);
        if let Some(primitives) = file["meshes"][0]["primitives"].as_array_mut() {
            primitives.push(json!({"attributes": attributes, "indices": indices, "material": 0}));
        }
        Ok(())
    }

    /// Compress everything to `packed`, and describe it in the JSON; returns the number of bytes.
    fn pack(
        &self,
        (vertices, triangles): (&mut File, &mut File),
        packed: &mut BufWriter<File>,
        file: &mut Value,
    ) -> std::io::Result<u64> {
        let in_words = |e: ViewError| match e {
            ViewError::Encode(e) => Error::other(format!("a part of the mesh cannot be compressed: {e}")),
            ViewError::Write(e) => e,
        };
        file["accessors"] = json!([]);
        let mut views = Views::new(packed);
        triangles.seek(SeekFrom::Start(0))?;
        let mut triangles = BufReader::with_capacity(1 << 20, triangles);
        let mut part = Part::default();
        loop {
            let triangle = next_triangle(&mut triangles)?;
            if (triangle.is_none() || part.is_full()) && !part.corners.is_empty() {
                let read = read_vertices(vertices, &part.names)?;
                self.write_part(&part, &read, &mut views, file).map_err(in_words)?;
                part = Part::default();
            }
            match triangle {
                Some(corners) => corners.into_iter().for_each(|corner| part.add(corner)),
                None => break,
            }
        }
        views.describe(file);
        Ok(views.bytes())
    }
}

/// A number of steps as a mantissa and an exponent of two, rounded to the nearest.
fn shortened(x: i32) -> (i32, i32) {
    let (mut mantissa, mut exponent) = (i64::from(x), 0);
    while mantissa.abs() > i64::from(MANTISSA_MAX) {
        exponent += 1;
        mantissa = (i64::from(x) + (1 << (exponent - 1))) >> exponent;
    }
    (mantissa as i32, exponent)
}

fn next_triangle(from: &mut impl Read) -> std::io::Result<Option<[u32; 3]>> {
    let mut bytes = [0; TRIANGLE];
    let mut filled = 0;
    while filled < TRIANGLE {
        match from.read(&mut bytes[filled..])? {
            0 if filled == 0 => return Ok(None),
            0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            n => filled += n,
        }
    }
    let (words, _) = bytes.as_chunks::<4>();
    Ok(Some([0, 1, 2].map(|k| u32::from_le_bytes(words[k]))))
}

/// Read the vertices with these numbers.
fn read_vertices(file: &mut File, names: &[u32]) -> std::io::Result<Vec<Vertex>> {
    let mut sorted: Vec<(u32, usize)> = names.iter().copied().zip(0..).collect();
    sorted.sort_unstable();
    let mut vertices = vec![Vertex::default(); names.len()];
    let mut bytes = Vec::new();
    let mut rest = &*sorted;
    while let Some((first, _)) = rest.first().copied() {
        let goes_on = |pair: &[(u32, usize)]| pair[1].0 - pair[0].0 <= GAP && pair[1].0 - first < RUN_MAX;
        let (run, others) = rest.split_at(1 + rest.windows(2).take_while(|pair| goes_on(pair)).count());
        rest = others;
        let last = run[run.len() - 1].0;
        bytes.resize((last - first + 1) as usize * VERTEX, 0);
        file.seek(SeekFrom::Start(u64::from(first) * VERTEX as u64))?;
        file.read_exact(&mut bytes)?;
        let (stored, _) = bytes.as_chunks::<VERTEX>();
        for (name, at) in run {
            vertices[*at] = Vertex::from_bytes(&stored[(name - first) as usize]);
        }
    }
    Ok(vertices)
}

impl Vertex {
    fn to_bytes(self) -> [u8; VERTEX] {
        let mut bytes = [0; VERTEX];
        let position = self.position.to_array().into_iter().flat_map(i32::to_le_bytes);
        let normal = self.normal.into_iter().flat_map(i16::to_le_bytes);
        for (to, from) in bytes.iter_mut().zip(position.chain(normal).chain(self.color)) {
            *to = from;
        }
        bytes
    }

    fn from_bytes(bytes: &[u8; VERTEX]) -> Self {
        let (words, _) = bytes.as_chunks::<4>();
        let half = |k: usize| i16::from_le_bytes([bytes[12 + 2 * k], bytes[13 + 2 * k]]);
        Self {
            position: IVec3::from_array([0, 1, 2].map(|k| i32::from_le_bytes(words[k]))),
            normal: [half(0), half(1)],
            color: [bytes[16], bytes[17], bytes[18]],
        }
    }
}

impl Encoder for Compressed {
    fn vertex(&mut self, out: &mut Vec<u8>, mesh: &Mesh, v: usize) {
        let vertex = Vertex {
            position: mesh.positions[v] - self.target.center,
            normal: mesh.normals[v],
            color: mesh.colors.get(v).copied().unwrap_or_default(),
        };
        out.extend(vertex.to_bytes());
    }

    fn triangle(&mut self, out: &mut Vec<u8>, corners: [u32; 3], _: [LatticePoint; 3]) {
        out.extend(corners.into_iter().flat_map(u32::to_le_bytes));
    }

    fn assemble(&self, out: &mut dyn Write, scratch: &mut Scratch, counts: Counts) -> std::io::Result<()> {
        scratch.vertices.flush()?;
        scratch.triangles.flush()?;
        let mut file = document(&self.target, counts);
        let parts = (scratch.vertices.get_mut(), scratch.triangles.get_mut());
        let binary = self.pack(parts, &mut scratch.packed, &mut file)?;
        file["extensionsRequired"] = json!([MESHOPT, QUANTIZED]);
        file["extensionsUsed"] = json!([MESHOPT, QUANTIZED]);
        begin(out, &padded(&file), binary)?;
        scratch.copy_packed(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_vertex_is_restored_from_its_bytes() {
        let vertex = Vertex { position: IVec3::new(-7, 1 << 30, i32::MIN), normal: [-300, 301], color: [1, 2, 255] };
        let restored = Vertex::from_bytes(&vertex.to_bytes());
        assert_eq!(
            (restored.position, restored.normal, restored.color),
            (vertex.position, vertex.normal, vertex.color)
        );
    }

    #[test]
    fn only_positions_far_from_the_middle_are_rounded_and_to_the_nearest() {
        for exact in [0, 5, -5, MANTISSA_MAX, -MANTISSA_MAX] {
            assert_eq!(shortened(exact), (exact, 0));
        }
        assert_eq!(shortened(MANTISSA_MAX + 1), (1 << 22, 1));
        for far in [(1 << 23) + 3, -(1 << 23) - 3, (1 << 25) - 1, 1 << 29, -(1 << 30), i32::MAX - 5] {
            let (mantissa, exponent) = shortened(far);
            let restored = i64::from(mantissa) << exponent;
            assert!(mantissa.abs() <= MANTISSA_MAX && mantissa.abs() >= 1 << 21);
            assert!((restored - i64::from(far)).abs() <= 1 << (exponent - 1), "{far}: {restored}");
        }
    }

    #[test]
    fn a_part_has_no_more_vertices_than_two_bytes_can_number() {
        let mut part = Part::default();
        let mut corner = 0;
        while !part.is_full() {
            (0..3).for_each(|k| part.add(corner + k));
            corner += 3;
        }
        assert!(part.names.len() <= VERTICES_MAX && part.names.len() > VERTICES_MAX - 6);
        assert!(part.corners.iter().all(|c| *c < 65_535));
    }
}
