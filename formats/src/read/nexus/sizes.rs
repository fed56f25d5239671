//! How many vertices and triangles the finest level of a Nexus model has, as its header and index say, for what a build will need.

use super::index::{HEADER, Header, Index};
use super::is_nexus;
use crate::read::gltf::Sizes;

/// Triangles for each byte of a node, at most: 6 bytes are one triangle in a plain node, and about one triangle takes two in a compressed one. More is not
/// believed.
const PER_BYTE: u64 = 16;

/// How many bytes from the beginning of a Nexus model say how large it is; `None` if it is none, or `start` ends within its header.
pub fn head_bytes(start: &[u8]) -> Option<u64> {
    let header = Header::parse(start.get(..HEADER).filter(|start| is_nexus(start))?).ok()?;
    Some(HEADER as u64 + header.index_bytes())
}

/// Of the finest level of a model of `total` bytes, from its first [`head_bytes`], compressed or not; `None` where these are damaged, which the reader will
/// say better.
pub fn sizes(head: &[u8], total: u64) -> Option<Sizes> {
    let header = Header::parse(head.get(..HEADER).filter(|start| is_nexus(start))?).ok()?;
    let end = usize::try_from(HEADER as u64 + header.index_bytes()).ok()?;
    let index = Index::parse(&header, head.get(HEADER..end)?, total).ok()?;
    let mut all = Sizes::default();
    for node in &index.nodes {
        let stated: u64 = node.parts.iter().map(|(range, _)| range.len() as u64).sum();
        let triangles = stated.min((node.bytes.end - node.bytes.start).saturating_mul(PER_BYTE));
        // A vertex is delivered for each picture that it is in.
        let pictures = node.parts.chunk_by(|a, b| a.1 == b.1).count() as u64;
        let vertices = (u64::from(node.vertices) * pictures).min(3 * triangles);
        all = all.and(Sizes { vertices, triangles });
    }
    Some(all)
}
