//! Triangles to buckets: every triangle goes whole to the bucket of its centroid; a bucket that a corner lies in, and
//! that is another, gets a copy (a *halo* triangle), so that all triangles round a point are seen together in the bucket
//! of the point.
//!
//! Input: `corners`. Output: `buckets`, triangles on the final lattice by bucket; `halo`, by bucket, each triangle
//! behind the number of its own bucket and its place there. Triangles that collapse on the lattice are dropped and
//! counted, by where they are.

use super::IngestOptions;
use super::buckets::{Buckets, point_of_words};
use super::corners::Corners;
use super::lattice::Rounding;
use super::resolve::{PIECE, Resolved};
use super::spill::{Lists, Spill};
use super::tally::Tally;
use super::words::Layout;
use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::scratch::ScratchError;
use crate::tasks::equal_parts;
use glam::{DVec3, I64Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

pub(super) const BUCKETS: &str = "buckets";
pub(super) const HALO: &str = "halo";

const COLLAPSED: &str = "triangles dropped because they collapse on the lattice";
/// Stands for the bucket of a triangle that collapsed.
const NOWHERE: u32 = u32::MAX;
/// Words before the corners of a halo triangle: its bucket, its place there.
pub(super) const HALO_HEAD: usize = 2;

/// Where the triangles are. A *region* is a range of consecutive buckets whose triangles are in their own files. Either the
/// whole model is one region, or each region has about as many triangles as one task should take.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Scattered {
    pub(super) cube_log2: u32,
    pub(super) shape: Vec<bool>,
    pub(super) own: Lists,
    pub(super) halo: Lists,
    /// The first bucket of each region.
    pub(super) regions: Vec<u32>,
    pub(super) triangles: u64,
    pub(super) tally: Tally,
}

impl Scattered {
    /// Names of the files of triangles.
    pub(super) fn files(&self) -> Vec<&str> {
        self.own.files.iter().chain(&self.halo.files).map(|file| file.name.as_str()).collect()
    }

    /// Triangles of a bucket, halo included.
    pub(super) fn triangles_in(&self, layout: Layout, bucket: usize) -> u64 {
        ((self.own.words(bucket) + self.halo.words(bucket)) / layout.triangle()) as u64
    }
}

/// Minimum number of buckets of a region, so that regions of whole buckets have about the same size.
const BUCKETS_OF_REGION: u64 = 8;

/// What a triangle of a bucket that is worked on takes: corners as they were, welded vertices, tables, edges, sums.
pub(super) fn bytes_per_triangle(layout: Layout) -> u64 {
    8 * layout.triangle() as u64 + 150
}

/// How many triangles a bucket should have, in regions of about `region` triangles.
fn capacity(work: &Work<'_>, layout: Layout, triangles: u64, options: &IngestOptions, region: Option<u64>) -> u64 {
    let threads = work.threads.max(1) as u64;
    let fits = work.memory / 10 * 7 / threads / bytes_per_triangle(layout);
    // Small enough to keep all threads busy to the end, large enough for few halo triangles.
    let even = (triangles / (8 * threads)).max(1 << 15);
    // They are also small enough that a bucket's tables stay in the processor's caches even if its triangles are in no particular order.
    let even = even.min(region.map_or(u64::MAX, |n| n / BUCKETS_OF_REGION));
    fits.min(even).clamp((options.leaf_triangles as u64 / 2).max(16), 1 << 18)
}

/// The triangles of a piece: bucket of each (on the final lattice by now), and copies for other buckets.
struct Piece {
    bucket: Vec<u32>,
    /// Bucket that gets a copy, and which triangle of the piece.
    halo: Vec<(u32, u32)>,
    collapsed: Tally,
}

/// The first bucket of each region of about `size` triangles.
fn regions(buckets: &Buckets, resolved: &Resolved, size: u64) -> Vec<u32> {
    let mut weights = vec![0.0; buckets.len()];
    for sample in &resolved.samples {
        weights[buckets.of_sum(*sample) as usize] += resolved.weight as f64;
    }
    equal_parts(&weights, size)
}

/// Run the stage; with regions of about `region` triangles, if that is given.
pub(super) fn scatter(
    work: &Work<'_>,
    resolved: &Resolved,
    options: &IngestOptions,
    region: Option<u64>,
) -> Result<Scattered, BuildError> {
    let (layout, rounding) = (resolved.layout, resolved.rounding());
    let capacity = capacity(work, layout, resolved.triangles, options, region);
    let mut samples = resolved.samples.clone();
    let buckets = Buckets::divide(resolved.cube_log2, &mut samples, resolved.weight, capacity);
    drop(samples);
    let firsts = region.map_or_else(|| vec![0], |size| regions(&buckets, resolved, size));
    // Islands are dropped from the whole model, before it is divided into regions.
    let in_files: &[u32] = if options.drop_islands_below.is_some() { &[0] } else { &firsts };
    let corners = Corners::open(work.scratch, layout, &resolved.slots)?;
    let mut own = Spill::create(work.scratch, BUCKETS, buckets.len(), in_files, work.memory / 4)?;
    let mut halo = Spill::create(work.scratch, HALO, buckets.len(), in_files, work.memory / 16)?;
    let mut counts = vec![0u32; buckets.len()];
    let mut tally = Tally::default();
    let (triangle, mut kept) = (layout.triangle(), 0);
    let look = |slot: usize, mut words: Vec<u32>| -> Result<(Vec<u32>, Vec<Piece>), ScratchError> {
        corners.read(slot, &mut words)?;
        let pieces =
            words.par_chunks_mut(PIECE * triangle).map(|w| piece(w, layout, &rounding, &buckets, resolved)).collect();
        Ok((words, pieces))
    };
    let mut keep = |(words, pieces): (Vec<u32>, Vec<Piece>)| -> Result<Vec<u32>, ScratchError> {
        for (piece, words) in pieces.iter().zip(words.chunks(PIECE * triangle)) {
            let mut places = vec![0u32; piece.bucket.len()];
            let mut first = 0;
            // Neighbours in the file are mostly neighbours in space: runs are copied as one.
            for run in piece.bucket.chunk_by(|a, b| a == b) {
                let bucket = run[0];
                if bucket != NOWHERE {
                    own.push(bucket as usize, &words[first * triangle..(first + run.len()) * triangle])?;
                    let count = &mut counts[bucket as usize];
                    for place in &mut places[first..first + run.len()] {
                        *place = *count;
                        *count += 1;
                    }
                    kept += run.len() as u64;
                }
                first += run.len();
            }
            for &(to, t) in &piece.halo {
                let t = t as usize;
                halo.push(to as usize, &[piece.bucket[t], places[t]])?;
                halo.push(to as usize, &words[t * triangle..(t + 1) * triangle])?;
            }
            tally.merge(&piece.collapsed);
        }
        Ok(words)
    };
    // While the triangles of one slot are added to the lists, the next slot is read, into the memory of the previous one.
    let (mut ready, mut spare) = (look(0, Vec::new())?, Vec::new());
    for next in 1..=corners.len() {
        let (written, looked_at) = rayon::join(|| keep(ready), || look(next, spare));
        (ready, spare) = (looked_at?, written?);
        work.progress.update("sorting into regions", next as u64, corners.len() as u64);
        work.stop.check()?;
    }
    if kept == 0 {
        let all = match resolved.triangles {
            1 => "the only triangle collapses".to_owned(),
            n => format!("all {n} triangles collapse"),
        };
        let step = resolved.lattice.step();
        let why = format!("{all} on a lattice of {step:e} m; give a smaller --step or check --units");
        return Err(BuildError::Empty { why });
    }
    let (cube_log2, shape) = (resolved.cube_log2, buckets.shape().to_vec());
    let (own, halo) = (own.finish()?, halo.finish()?);
    Ok(Scattered { cube_log2, shape, own, halo, regions: firsts, triangles: kept, tally })
}

fn piece(words: &mut [u32], layout: Layout, rounding: &Rounding, buckets: &Buckets, resolved: &Resolved) -> Piece {
    let (width, triangle) = (layout.vertex(), layout.triangle());
    let n = words.len() / triangle;
    let mut out = Piece { bucket: Vec::with_capacity(n), halo: Vec::new(), collapsed: Tally::default() };
    // Neighbours in the file are mostly neighbours in space.
    let mut last = NOWHERE;
    for (t, corners) in words.chunks_exact_mut(triangle).enumerate() {
        let mut p = [[0; 3]; 3];
        for (k, vertex) in corners.chunks_exact_mut(width).enumerate() {
            p[k] = rounding.point([vertex[0], vertex[1], vertex[2]]);
            vertex[..3].copy_from_slice(&p[k]);
        }
        if p[0] == p[1] || p[1] == p[2] || p[2] == p[0] {
            out.collapsed.add(COLLAPSED, || {
                let DVec3 { x, y, z } = resolved.lattice.world_from_lattice(point_of_words(p[0]));
                format!("at {x:.4} {y:.4} {z:.4} m")
            });
            out.bucket.push(NOWHERE);
            continue;
        }
        if last != NOWHERE && p.iter().all(|p| buckets.is_inside(last, *p)) {
            out.bucket.push(last);
            continue;
        }
        let of = p.map(|p| buckets.of_point(p));
        if of[0] == of[1] && of[1] == of[2] {
            last = of[0];
            out.bucket.push(last);
            continue;
        }
        let home = buckets.of_sum(p.map(|p| I64Vec3::from(p.map(i64::from))).into_iter().sum());
        out.bucket.push(home);
        for k in 0..3 {
            if of[k] != home && !of[..k].contains(&of[k]) {
                out.halo.push((of[k], t as u32));
            }
        }
    }
    out
}
