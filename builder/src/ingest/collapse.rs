//! Small triangles and the lattice spacing. The spacing follows from the edges; where that would let more than [`MAX_SHARE`] of the triangles
//! collapse (two corners at one lattice point), it is halved until it does not.
//!
//! Input: `corners`, on the provisional lattice, which decide exactly what collapses on a coarser one. They are read only if the lengths of the edges
//! leave room for doubt. Triangles that collapse on the provisional lattice too do not count: no spacing would keep them.

use super::corners::{Corners, Slots};
use super::lattice::{Lengths, Measured, Provisional, Rounding, choose, finest};
use super::resolve::PIECE;
use super::words::Layout;
use crate::build::options::BuildError;
use crate::build::work::Work;
use kilwa_geometry::Lattice;
use rayon::prelude::*;

/// Fewer triangles than this share of all may collapse.
const MAX_SHARE: f64 = 0.001;
/// How often the spacing is halved at most. Each time costs up to three bits for a vertex.
const MAX_HALVINGS: usize = 8;

/// The lattice to use instead of the one derived from the edges, and the logarithm of the side of its cube.
///
/// # Errors
/// As [`choose`], and where the scratch disk fails.
pub(super) fn spare_triangles(
    work: &Work<'_>,
    layout: Layout,
    (provisional, triangles, slots): (&Provisional, u64, &Slots),
    lengths: &Lengths,
    measured: &Measured,
    derived: (Lattice, u32),
) -> Result<(Lattice, u32), BuildError> {
    let allowed = MAX_SHARE * triangles as f64;
    // Points farther apart than a cell's diagonal are never rounded to one point.
    let diagonal = 3f64.sqrt() * derived.0.step() / provisional.step();
    if (lengths.below(diagonal) as f64) < allowed {
        return Ok(derived);
    }
    let finest = finest(&measured.bounds).max(provisional.step_log2 + 1);
    let mut candidates = vec![derived];
    while candidates.len() <= MAX_HALVINGS {
        let step_log2 = derived.0.step_log2 - candidates.len() as i32;
        if step_log2 < finest {
            break;
        }
        match choose(measured, Some(libm::scalbn(1.0, step_log2))) {
            Ok(candidate) => candidates.push(candidate),
            // The model does not fit into so many steps.
            Err(BuildError::Step { .. }) => break,
            Err(e) => return Err(e),
        }
    }
    let roundings: Vec<Rounding> = candidates.iter().map(|c| Rounding::between(provisional, &c.0)).collect();
    let collapsed = count(work, &Corners::open(work.scratch, layout, slots)?, layout, &roundings)?;
    let enough = collapsed.iter().position(|n| (*n as f64) < allowed);
    let fewest = || (0..collapsed.len()).min_by_key(|i| collapsed[*i]);
    Ok(enough.or_else(fewest).map_or(derived, |i| candidates[i]))
}

/// How many triangles collapse in each of some roundings, but not on the provisional lattice.
fn count(
    work: &Work<'_>,
    corners: &Corners<'_>,
    layout: Layout,
    roundings: &[Rounding],
) -> Result<Vec<u64>, BuildError> {
    let mut all = vec![0; roundings.len()];
    let mut words = Vec::new();
    for slot in 0..corners.len() {
        corners.read(slot, &mut words)?;
        let pieces = words.par_chunks(PIECE * layout.triangle());
        let counts = pieces.map(|piece| {
            let mut counts = vec![0u64; roundings.len()];
            for triangle in piece.chunks_exact(layout.triangle()) {
                let mut cells = triangle.chunks_exact(layout.vertex()).map(|v| [v[0], v[1], v[2]]);
                let cells: [[u32; 3]; 3] = std::array::from_fn(|_| cells.next().unwrap_or_default());
                add(&mut counts, cells, roundings);
            }
            counts
        });
        let sum = |a: Vec<u64>, b: Vec<u64>| a.iter().zip(&b).map(|(a, b)| a + b).collect();
        let counts = counts.reduce(|| vec![0; roundings.len()], sum);
        all.iter_mut().zip(counts).for_each(|(all, n)| *all += n);
        work.progress.update("looking for small triangles", slot as u64 + 1, corners.len() as u64);
        work.stop.check()?;
    }
    Ok(all)
}

/// Count a triangle, given by its cells on the provisional lattice.
fn add(counts: &mut [u64], [a, b, c]: [[u32; 3]; 3], roundings: &[Rounding]) {
    if a == b || b == c || c == a {
        return;
    }
    for (n, rounding) in counts.iter_mut().zip(roundings) {
        let joins = |p: [u32; 3], q: [u32; 3]| rounding.may_join(p, q) && rounding.point(p) == rounding.point(q);
        if joins(a, b) || joins(b, c) || joins(c, a) {
            *n += 1;
        }
    }
}
