//! The reader of Nexus multiresolution models, version 2 (.nxs and .nxz, the format of 3DHOP; F. Ponchio, "Multiresolution
//! structures for interactive visualization of very large 3D datasets", 2009): the finest level.
//!
//! A file has a header, an index (`index`) and nodes. Each node holds a part of the surface at one level of detail, divided into patches. Each patch
//! points to the node with the same surface in more detail; those that point to the last node, the sink, are the finest, and
//! only they are delivered. Nodes are read one at a time, plain (`node`) or compressed with Corto (`corto`).
//!
//! Kept: positions, normals, vertex colours. If a patch has a texture, its vertices get the colours of the texture
//! instead. A vertex at a border between nodes, or between textures, is delivered once for each, at the same position;
//! preparing the mesh welds them. The format stores neither units nor the up axis; metres and z are the defaults.
//!
//! Counted: textures that cannot be read; a triangle count in the header that differs from that of the nodes. Refused: MECO,
//! one file per node, point clouds, other versions; and, with the offset: data outside the file, inconsistent counts and
//! indices, streams that cannot be decoded.
//!
//! Memory: the index, one node (at most 65535 vertices and triangles), pictures. An index beyond the memory and a compressed node beyond all
//! measure are refused.

mod bytes;
mod corto;
mod index;
mod node;
mod sizes;
#[cfg(test)]
mod tests;

use super::texture::{Refusal, Textures, Wrap};
use super::{Bytes, Input, MeshSink, ReadError, VertexBlock};
use bytes::Cursor;
use glam::{DVec2, DVec3, Vec3};
use index::{Header, Index, Layout, Node};
use node::NodeMesh;
pub use sizes::{head_bytes, sizes};
use std::io::{Read, SeekFrom};
use std::ops::Range;
use std::path::Path;

/// The first bytes of a file.
const MAGIC: &[u8] = b" sxN";
/// The vertex has not been delivered.
const NONE: u64 = u64::MAX;
/// Progress is reported every so many bytes.
const REPORTED: u64 = 1 << 20;
/// Bytes of a compressed node at the most. It has up to 65535 vertices and triangles, and a few hundred bytes for each would be far too many.
const MAX_COMPRESSED: u64 = 64 << 20;
/// Bytes that a byte of the index takes in memory, about, with the index itself.
const INDEX_SHARE: u64 = 8;
/// Diagnostic: the header and the nodes disagree.
const COUNT_MISMATCH: &str = "headers whose triangle count differs from that of the nodes; the nodes were used";

const ALTERNATIVE: &str =
    "Give the mesh from which it was built, or export its finest level as PLY with the Nexus tools";

/// Whether a file that starts with these bytes is a Nexus model.
pub fn is_nexus(start: &[u8]) -> bool {
    start.starts_with(MAGIC)
}

/// Deliver the finest level.
///
/// # Errors
/// [`ReadError`] for a file that is damaged, of another version or compression, or has no triangles; errors of the sink.
pub fn read(input: Input<'_>, sink: &mut dyn MeshSink) -> Result<(), ReadError> {
    let Input { path, total, source, progress, options, .. } = input;
    let mut file = File { source, path };
    let start = file.bytes(0..total.min(index::HEADER as u64))?;
    if !is_nexus(&start) {
        let found = String::from_utf8_lossy(&start[..start.len().min(4)]).escape_debug().collect::<String>();
        let fault = Cursor::new(&[], 0).fault(format!("\"{found}\""), "\" sxN\", the beginning of a Nexus file");
        return Err(fault.in_file(path));
    }
    let header = Header::parse(&start).map_err(|fault| fault.in_file(path))?;
    let coding = coding(&header, path)?;
    let end = index::HEADER as u64 + header.index_bytes();
    if end > total {
        let found = format!("{total} bytes in all");
        let expected = format!("{end} for the header and {}; the file is truncated or damaged", header.counts());
        return Err(Cursor::new(&[], total).fault(found, expected).in_file(path));
    }
    let needed = INDEX_SHARE * header.index_bytes();
    if needed > options.document {
        let what = format!(
            "its index of {} may take {} MiB of memory, and {} MiB are allowed; give a larger --memory",
            header.counts(),
            needed.div_ceil(1 << 20),
            options.document >> 20
        );
        return Err(ReadError::TooLarge { file: path.to_owned(), what });
    }
    let bytes = file.bytes(index::HEADER as u64..end)?;
    let index = Index::parse(&header, &bytes, total).map_err(|fault| fault.in_file(path))?;
    drop(bytes);
    if header.triangles != index.triangles {
        sink.diagnostics().add(COUNT_MISMATCH, || format!("{} for {}", header.triangles, index.triangles));
    }
    let textures = Textures::new(options.texture_bytes).keeping(options.memory / 2).within(options.picture);
    let mut delivery = Delivery { file, index: &index, textures, sink, triangles: 0 };
    let mut reported = 0;
    for node in &index.nodes {
        delivery.node(node, coding)?;
        if node.bytes.end - reported >= REPORTED {
            reported = node.bytes.end;
            progress(reported, total);
        }
    }
    let pictures = delivery.textures.used();
    let triangles = delivery.triangles;
    sink.diagnostics().pictures.add(pictures);
    progress(total, total);
    if triangles > 0 {
        return Ok(());
    }
    let found = "no patch of it leads to the last node, so it has no finest level".to_owned();
    Err(ReadError::NoTriangles { file: path.to_owned(), found, way_out: ALTERNATIVE })
}

/// How nodes are stored.
#[derive(Debug, Clone, Copy)]
enum Coding {
    Plain(Layout),
    Corto,
}

/// How nodes are stored; an error if that is not supported.
fn coding(header: &Header, path: &Path) -> Result<Coding, ReadError> {
    let needs = |needs: String, way_out| ReadError::Needs { file: path.to_owned(), needs, way_out };
    if header.version != index::VERSION {
        let needed = format!("is a Nexus model of version {}; only version {} is read", header.version, index::VERSION);
        return Err(needs(needed, ALTERNATIVE));
    }
    if header.flags & index::MECO != 0 {
        return Err(needs(
            "is a Nexus model compressed with MECO, which is not read".to_owned(),
            "Give the .nxs from which it was compressed, or the mesh; if both are lost, open it with an older release of Nexus that reads MECO, export its finest level as PLY, and build from that",
        ));
    }
    if header.flags & index::DEEPZOOM != 0 {
        return Err(needs(
            "is the index of a Nexus model with one file per node (deepzoom)".to_owned(),
            "Give the .nxs or .nxz from which `nxsedit` made it",
        ));
    }
    if header.flags & !index::FLAGS != 0 {
        return Err(needs(format!("is a Nexus model with unknown flags ({:#x})", header.flags), ALTERNATIVE));
    }
    if header.has_no_faces() {
        let found = "it is a Nexus point cloud".to_owned();
        let way_out = "Make a mesh of the points first (for example Poisson reconstruction in CloudCompare or MeshLab)";
        return Err(ReadError::NoTriangles { file: path.to_owned(), found, way_out });
    }
    if header.flags & index::CORTO != 0 {
        return Ok(Coding::Corto);
    }
    let layout = header.layout();
    layout
        .map(Coding::Plain)
        .map_err(|what| needs(format!("is a Nexus model with {what}, which is not read"), ALTERNATIVE))
}

/// The file being read.
struct File<'a> {
    source: &'a mut dyn Bytes,
    path: &'a Path,
}

impl File<'_> {
    /// The bytes of a range that lies inside the file.
    fn bytes(&mut self, range: Range<u64>) -> Result<Vec<u8>, ReadError> {
        let failed = |source| ReadError::Io { file: self.path.to_owned(), offset: range.start, source };
        self.source.seek(SeekFrom::Start(range.start)).map_err(failed)?;
        let mut bytes = Vec::new();
        let length = range.end - range.start;
        (&mut *self.source).take(length).read_to_end(&mut bytes).map_err(failed)?;
        if (bytes.len() as u64) < length {
            // The file has become shorter since its length was taken.
            return Err(failed(std::io::ErrorKind::UnexpectedEof.into()));
        }
        Ok(bytes)
    }
}

/// The state of the delivery.
struct Delivery<'a, 's> {
    file: File<'a>,
    index: &'a Index,
    textures: Textures,
    sink: &'s mut dyn MeshSink,
    triangles: u64,
}

impl Delivery<'_, '_> {
    /// Deliver the triangles of a node that belong to the finest level.
    fn node(&mut self, node: &Node, coding: Coding) -> Result<(), ReadError> {
        let bytes = self.file.bytes(self.needed(node, coding)?)?;
        let mut from = Cursor::new(&bytes, node.bytes.start);
        let piece = match coding {
            Coding::Plain(layout) => NodeMesh::plain(&mut from, layout, node),
            Coding::Corto => corto::decode(&mut from, node.vertices, node.triangles),
        };
        let piece = piece.and_then(|piece| piece.checked(node.number, node.bytes.start));
        let piece = piece.map_err(|fault| fault.in_file(self.file.path))?;
        // Parts with the same picture share their vertices.
        let mut numbers = vec![NONE; piece.positions.len()];
        for parts in node.parts.chunk_by(|a, b| a.1 == b.1) {
            let triangles = parts.iter().flat_map(|(range, _)| &piece.triangles[range.clone()]);
            let texture = parts.first().and_then(|(_, texture)| *texture);
            self.part(&piece, triangles.copied(), texture, &mut numbers)?;
        }
        Ok(())
    }

    /// The bytes of a node that are read.
    fn needed(&self, node: &Node, coding: Coding) -> Result<Range<u64>, ReadError> {
        let Range { start, end } = node.bytes;
        match coding {
            Coding::Plain(layout) => {
                let length = u64::from(node.vertices) * layout.vertex_bytes as u64 + 6 * u64::from(node.triangles);
                Ok(start..end.min(start + length))
            }
            Coding::Corto if end - start > MAX_COMPRESSED => {
                let what = format!(
                    "the compressed node {} has {} bytes; at most {MAX_COMPRESSED} are read, which is more than it can need",
                    node.number,
                    end - start
                );
                Err(ReadError::TooLarge { file: self.file.path.to_owned(), what })
            }
            Coding::Corto => Ok(start..end),
        }
    }

    /// Deliver the triangles of a node that have one texture, with the vertices that they use. `numbers` is [`NONE`] for each vertex, and is so again
    /// afterwards.
    fn part(
        &mut self,
        piece: &NodeMesh,
        triangles: impl Iterator<Item = [u32; 3]>,
        texture: Option<usize>,
        numbers: &mut [u64],
    ) -> Result<(), ReadError> {
        let first = self.sink.vertex_count();
        let mut used: Vec<usize> = Vec::new();
        let mut number = |v: u32| {
            let known = &mut numbers[v as usize];
            if *known == NONE {
                *known = first + used.len() as u64;
                used.push(v as usize);
            }
            *known
        };
        let triangles: Vec<[u64; 3]> = triangles.map(|t| t.map(&mut number)).collect();
        for &v in &used {
            numbers[v] = NONE;
        }
        let positions: Vec<DVec3> = used.iter().map(|&v| piece.positions[v]).collect();
        let normals: Vec<Vec3> = used.iter().filter_map(|&v| piece.normals.get(v).copied()).collect();
        let own = || used.iter().filter_map(|&v| piece.colors.get(v).copied()).collect();
        let colors = self.texture_colors(piece, &used, texture)?.unwrap_or_else(own);
        let block = VertexBlock { positions: &positions, colors: &colors, normals: &normals, scalars: &[] };
        self.sink.vertices(&block)?;
        self.sink.triangles(&triangles, &[])?;
        self.triangles += triangles.len() as u64;
        Ok(())
    }

    /// The colours of vertices from a texture; `None` if there is none or it cannot be read.
    fn texture_colors(
        &mut self,
        piece: &NodeMesh,
        vertices: &[usize],
        texture: Option<usize>,
    ) -> Result<Option<Vec<[u8; 3]>>, ReadError> {
        let Some(number) = texture.filter(|_| !piece.coordinates.is_empty()) else { return Ok(None) };
        let Some(range) = self.index.textures.get(number) else { return Ok(None) };
        let (max, file) = (self.textures.file_bytes(), &mut self.file);
        let load = || {
            let length = range.end - range.start;
            if length > max {
                let why = format!("it has {length} bytes, but only {max} fit in memory; give a larger --memory");
                return Err(Refusal::Memory(why));
            }
            file.bytes(range.clone()).map_err(|e| Refusal::Unreadable(e.to_string()))
        };
        let diagnostics = self.sink.diagnostics();
        let picture = self.textures.get(number, load, |why| {
            let kind = "pictures that cannot be read; what they cover keeps its vertex colours, if any";
            diagnostics.add(kind, || format!("texture {number}: {why}"));
        });
        let colors = picture.map(|picture| {
            // The lowest row of the picture is at v = 0.
            let color = |&v: &usize| {
                let uv = piece.coordinates[v];
                picture.sample(DVec2::new(uv.x, 1.0 - uv.y), [Wrap::Repeat; 2])
            };
            vertices.iter().map(color).collect()
        });
        match self.textures.short() {
            Some(why) => {
                let what = format!("a picture of it: {why}");
                Err(ReadError::TooLarge { file: self.file.path.to_owned(), what })
            }
            None => Ok(colors),
        }
    }
}
