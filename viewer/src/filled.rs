//! The filled surface of a merge, which can be hidden: triangles with a vertex whose channel `filled` is 0.5 or more. Every triangle that a merge added has such
//! a vertex, and no measured triangle has one.
//!
//! A hidden triangle stays in its decoded chunk with [`HIDDEN`] set in its first index. Picking skips it, and the GPU gets it as a degenerate triangle. So it
//! can be shown again without decoding the chunk a second time, and no shader needs to know about it.

use kilwa_pack::GpuChunk;
use std::borrow::Cow;

/// Names of the channel (0 where the surface was measured, 1 where it was filled), as a merge writes it and as a PLY file has to.
pub const CHANNELS: [&str; 2] = ["filled", "scalar_filled"];
/// Set in the first index of a hidden triangle.
const HIDDEN: u32 = 1 << 31;

/// Hide the triangles with a vertex whose value of this channel is at least 0.5, and show all others; without a channel, show all.
pub(crate) fn hide(chunk: &mut GpuChunk, channel: Option<usize>) {
    let count = chunk.vertex_count as usize;
    let values = channel.and_then(|c| chunk.scalars.get(c * count..(c + 1) * count)).unwrap_or_default();
    for triangle in chunk.indices.chunks_exact_mut(3) {
        triangle[0] &= !HIDDEN;
        // NaN means no value and hides nothing.
        if triangle.iter().any(|v| values.get(*v as usize).is_some_and(|value| *value >= 0.5)) {
            triangle[0] |= HIDDEN;
        }
    }
}

/// Whether a triangle is hidden.
pub(crate) fn is_hidden(triangle: &[u32]) -> bool {
    triangle[0] & HIDDEN != 0
}

/// The indices as the GPU gets them.
pub(crate) fn drawn(indices: &[u32]) -> Cow<'_, [u32]> {
    let mut drawn = Cow::Borrowed(indices);
    if indices.iter().any(|v| v & HIDDEN != 0) {
        for triangle in drawn.to_mut().chunks_exact_mut(3).filter(|t| is_hidden(t)) {
            triangle.fill(0);
        }
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_with_a_filled_vertex_are_hidden_and_shown_again() {
        let indices = vec![0, 1, 4, 0, 1, 2, 2, 3, 4, 3, 4, 5];
        let mut chunk =
            GpuChunk { vertex_count: 6, triangle_count: 4, indices: indices.clone(), ..GpuChunk::default() };
        // Two channels; the second one counts: 0, 0.4, 0.5, 1, no value, 0.
        chunk.scalars = vec![1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.4, 0.5, 1.0, f32::NAN, 0.0];
        hide(&mut chunk, Some(1));
        let hidden = |chunk: &GpuChunk| chunk.indices.chunks(3).map(is_hidden).collect::<Vec<_>>();
        assert_eq!(hidden(&chunk), [false, true, true, true]);
        assert_eq!(*drawn(&chunk.indices), [0, 1, 4, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        hide(&mut chunk, Some(0));
        assert_eq!(hidden(&chunk), [true; 4]);
        // A channel that the chunk lacks hides nothing.
        hide(&mut chunk, Some(2));
        assert_eq!(chunk.indices, indices);
        hide(&mut chunk, Some(0));
        hide(&mut chunk, None);
        assert!(chunk.indices == indices && matches!(drawn(&chunk.indices), Cow::Borrowed(_)));
    }
}
