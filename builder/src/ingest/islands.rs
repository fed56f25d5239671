//! `--drop-islands-below`: components of fewer triangles are dropped before anything is made of them.
//!
//! Input: `buckets` and `halo`. Output: the same without the triangles of small components, under other names; places of
//! halo triangles follow. Done only where the option is given.

use super::buckets::Buckets;
use super::components::{INNER, Joining, Part};
use super::scatter::{HALO_HEAD, Scattered, bytes_per_triangle};
use super::spill::Spill;
use super::topology::Local;
use super::words::{Layout, append_words, read_words};
use crate::build::options::BuildError;
use crate::build::work::Work;
use kilwa_pack::plural::counted;

pub(super) const KEPT_BUCKETS: &str = "buckets-kept";
pub(super) const KEPT_HALO: &str = "halo-kept";
pub(super) const MARKS: &str = "components";

const DROPPED: &str = "triangles of components smaller than --drop-islands-below dropped";

/// A mark beside the numbers of components: all of the component is known to be kept, or dropped.
const KEEP: u32 = u32::MAX;
const DROP: u32 = u32::MAX - 1;

/// The stage.
pub(super) fn drop_islands(
    work: &Work<'_>,
    layout: Layout,
    scattered: &Scattered,
    below: u64,
) -> Result<Scattered, BuildError> {
    let buckets = Buckets::of_shape(scattered.cube_log2, scattered.shape.clone());
    let files = (scattered.own.open(work.scratch)?, scattered.halo.open(work.scratch)?);
    let (own, halo) = (&files.0, &files.1);
    let marks = work.scratch.create(MARKS)?;
    let joining = Joining::create(work.scratch)?;
    let cost = |b: usize| scattered.triangles_in(layout, b) * bytes_per_triangle(layout);
    // First which component each triangle belongs to.
    let mark = |bucket: usize| -> Result<(Part, u64), BuildError> {
        let local = Local::read(scattered, layout, (own, halo), bucket, &buckets)?;
        let (components, part) = local.components(&joining)?;
        let mark = |p: &[u32; 3]| match components.number(p[0]) {
            INNER if components.triangles(p[0]) < below => DROP,
            INNER => KEEP,
            number => number,
        };
        let mut words: Vec<u32> = local.own_points().iter().map(mark).collect();
        Ok((part, append_words(&marks, &mut words)?))
    };
    let (parts, places): (Vec<Part>, Vec<u64>) =
        work.run_jobs(buckets.len(), work.memory / 10 * 9, cost, mark)?.into_iter().unzip();
    let joined = joining.finish(work.scratch, work.memory / 4, &parts)?;
    // Then copy what is kept, and note how many are kept before each triangle.
    let mut kept_own = Spill::create(work.scratch, KEPT_BUCKETS, buckets.len(), &scattered.regions, work.memory / 4)?;
    let mut kept_before: Vec<Kept> = Vec::with_capacity(buckets.len());
    let mut triangles = 0;
    let mut words = Vec::new();
    for (bucket, place) in places.into_iter().enumerate() {
        work.stop.check()?;
        words.clear();
        scattered.own.read(own, bucket, &mut words)?;
        let mut of = vec![0; words.len() / layout.triangle()];
        read_words(&marks, place, &mut of)?;
        let is_kept = |mark: u32| mark == KEEP || (mark != DROP && joined.triangles[mark as usize] >= below);
        let kept = Kept::of(of.into_iter().map(is_kept));
        for (_, t) in words.chunks_exact(layout.triangle()).enumerate().filter(|(i, _)| kept.is_kept(*i)) {
            kept_own.push(bucket, t)?;
            triangles += 1;
        }
        kept_before.push(kept);
    }
    if triangles == 0 {
        let why = format!(
            "no component has {}; give a smaller --drop-islands-below",
            counted(below, "triangle", "triangles")
        );
        return Err(BuildError::Empty { why });
    }
    let mut kept_halo = Spill::create(work.scratch, KEPT_HALO, buckets.len(), &scattered.regions, work.memory / 16)?;
    for bucket in 0..buckets.len() {
        words.clear();
        scattered.halo.read(halo, bucket, &mut words)?;
        for t in words.chunks_exact(HALO_HEAD + layout.triangle()) {
            let home = &kept_before[t[0] as usize];
            if home.is_kept(t[1] as usize) {
                kept_halo.push(bucket, &[t[0], home.before(t[1] as usize)])?;
                kept_halo.push(bucket, &t[HALO_HEAD..])?;
            }
        }
    }
    drop(marks);
    work.scratch.remove(MARKS)?;
    let mut out = scattered.clone();
    out.tally.add_many(DROPPED, scattered.triangles - triangles);
    (out.own, out.halo, out.triangles) = (kept_own.finish()?, kept_halo.finish()?, triangles);
    Ok(out)
}

/// Which triangles of a bucket are kept: bits, and how many before each word of them.
struct Kept {
    bits: Vec<u64>,
    before: Vec<u32>,
}

impl Kept {
    fn of(kept: impl Iterator<Item = bool>) -> Self {
        let mut out = Self { bits: Vec::new(), before: Vec::new() };
        let mut count = 0;
        for (i, kept) in kept.enumerate() {
            if i % 64 == 0 {
                out.bits.push(0);
                out.before.push(count);
            }
            if kept {
                out.bits[i / 64] |= 1 << (i % 64);
                count += 1;
            }
        }
        out
    }

    fn is_kept(&self, i: usize) -> bool {
        self.bits[i / 64] >> (i % 64) & 1 == 1
    }

    /// The new place of a triangle that is kept.
    fn before(&self, i: usize) -> u32 {
        self.before[i / 64] + (self.bits[i / 64] & ((1 << (i % 64)) - 1)).count_ones()
    }
}
