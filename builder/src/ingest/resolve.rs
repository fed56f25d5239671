//! From vertex numbers to corners: every triangle gets the cells and attributes of its three vertices, with bounded
//! memory also where numbers jump at random.
//!
//! Input: the files of the spool. Output: `corners`, for each triangle that is kept three vertices in words
//! ([`super::words`]) on the provisional lattice, in slots ([`super::corners`]); the lattice; a sample of the triangles.
//! As many vertices as the budget allows are in memory at a time. For each such range of vertices, one pass goes through
//! the slots whose triangles may use some of them. A slot is complete once all its vertices have been in memory; its
//! triangles are then dropped (a corner that is not finite, `--crop`, `--min-confidence`), or measured and kept. In most
//! meshes, neighbouring triangles use neighbouring vertices, so that nearly every slot is written in one pass only.
//! Everything is counted in integers, so the order of triangles does not matter.
//!
//! Fails as [`super::lattice::choose`] does, and where the scratch disk fails.

use super::IngestOptions;
use super::collapse::spare_triangles;
use super::corners::{CORNERS, Slots};
use super::lattice::{Box3, Lengths, Measured, Provisional, Rounding, choose};
use super::spool::{
    COLORS, ColorSource, NORMALS, POSITIONS, Spooled, TRIANGLE_COLORS, TRIANGLES, TRIANGLES_HIGH, position_of_row,
};
use super::tally::{PLACES_KEPT, Tally};
use super::words::{INVALID, Layout, read_words, word_of_color, word_of_normal, write_words};
use crate::build::options::BuildError;
use crate::build::work::Work;
use crate::scratch::{ScratchError, ScratchFile};
use glam::{DVec3, I64Vec3};
use kilwa_formats::UNCOLOURED;
use kilwa_formats::read::sink::{NO_POSITION, NOT_FINITE, UNUSED};
use kilwa_geometry::Lattice;
use kilwa_pack::plural::counted;
use kilwa_simplify::Precision;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::sync::atomic::{AtomicU64, Ordering};

/// Triangles in the hands of a thread: a multiple of 64.
pub(super) const PIECE: usize = 1 << 14;
/// Vertices read at a time, and in the hands of a thread.
const ROWS: usize = 1 << 16;
const ROW_PIECE: usize = 1 << 12;
/// About how many triangles are sampled.
const SAMPLES: u64 = 1 << 17;
/// Triangles sampled for the length of edges if most of them vanish on the lattice.
const ASTRAY_SAMPLES: u64 = 4096;

/// What is known once triangles have corners.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Resolved {
    pub(super) layout: Layout,
    pub(super) lattice: Lattice,
    pub(super) cube_log2: u32,
    provisional_log2: i32,
    provisional_origin: DVec3,
    /// Triangles that are kept, and where they are in [`CORNERS`].
    pub(super) triangles: u64,
    pub(super) slots: Slots,
    /// Vertices that they use.
    pub(super) used: u64,
    /// 1st percentile and median of the lengths of edges, metres.
    pub(super) first: f64,
    pub(super) median: f64,
    /// See [`crate::ingest::surface::Surface::facing`].
    pub(super) facing: DVec3,
    /// Sums of corners on the lattice, each representing `weight` triangles.
    pub(super) samples: Vec<I64Vec3>,
    pub(super) weight: u64,
    pub(super) tally: Tally,
}

impl Resolved {
    pub(super) fn rounding(&self) -> Rounding {
        Rounding::between(&self.provisional(), &self.lattice)
    }

    fn provisional(&self) -> Provisional {
        Provisional { step_log2: self.provisional_log2, origin: self.provisional_origin }
    }
}

/// Which attributes the vertices have.
pub(super) fn layout_of(spooled: &Spooled) -> Layout {
    let colors = spooled.color != ColorSource::None;
    Layout { colors, normals: spooled.normals, scalars: spooled.channels.len() }
}

/// The stage.
pub(super) fn resolve(work: &Work<'_>, spooled: &Spooled, options: &IngestOptions) -> Result<Resolved, BuildError> {
    let Some(mut bounds) = spooled.bounds.filter(|_| spooled.triangles > 0) else {
        let why = match spooled.triangles {
            0 => "the input has no triangles; give a mesh, not a point cloud".to_owned(),
            n => format!(
                "of {} none is left: no vertex has a finite position; check the export",
                counted(n, "triangle", "triangles")
            ),
        };
        return Err(BuildError::Empty { why });
    };
    let weight = spooled.triangles.div_ceil(SAMPLES);
    let run = Run::new(work, spooled, options, weight)?;
    // What the first attempt decided about triangles.
    let mut decided: Option<(Vec<u64>, Tally)> = None;
    loop {
        let provisional = Provisional::of(&bounds, options.step);
        let mut out = run.passes(&provisional, decided.as_ref().map(|(keep, _)| keep.as_slice()))?;
        if out.triangles == 0 {
            return Err(nothing_left(spooled.triangles, &out.dropped.tally()));
        }
        let used_bounds = run.used_bounds()?;
        let step = provisional.step();
        let first = out.lengths.percentile(0.01) * step;
        // Vertices that no triangle uses (any more) made the cells too large: once more with the box of the others.
        let coarse = out.lengths.none > 0 || first < 32.0 * step || options.step.is_some_and(|s| s < 2.0 * step);
        let finer = Provisional::of(&used_bounds, options.step).step_log2 < provisional.step_log2;
        if decided.is_none() && coarse && finer {
            bounds = used_bounds;
            decided = Some((out.keep, out.dropped.tally()));
            continue;
        }
        let mut tally = decided.map_or_else(|| out.dropped.tally(), |(_, tally)| tally);
        let mut measured = Measured { bounds: used_bounds, first, median: out.lengths.percentile(0.5) * step };
        if out.lengths.none > out.lengths.total {
            measured.median = run.sampled_median(&out.keep)?;
        }
        let mut chosen = choose(&measured, options.step)?;
        if options.step.is_none() {
            let corners = (&provisional, out.triangles, &out.slots);
            chosen = spare_triangles(work, run.layout, corners, &out.lengths, &measured, chosen)?;
        }
        let (lattice, cube_log2) = chosen;
        let rounding = Rounding::between(&provisional, &lattice);
        let used = run.used_count();
        if options.crop.is_none() && options.min_confidence.is_none() {
            let not_finite = spooled.tally.count(NO_POSITION);
            tally.add_many(UNUSED, (spooled.vertices - used).saturating_sub(not_finite));
        }
        out.samples.iter_mut().for_each(|s| {
            *s = I64Vec3::from(rounding.point(s.to_array().map(|x| (x / 3) as u32)).map(|x| 3 * i64::from(x)));
        });
        return Ok(Resolved {
            layout: run.layout,
            lattice,
            cube_log2,
            provisional_log2: provisional.step_log2,
            provisional_origin: provisional.origin,
            triangles: out.triangles,
            slots: out.slots,
            used,
            first,
            median: measured.median,
            facing: out.facing.mean(),
            samples: out.samples,
            weight,
            tally,
        });
    }
}

const LOW_CONFIDENCE: &str = "triangles dropped because of --min-confidence";
const CROPPED: &str = "triangles outside of --crop dropped";

fn nothing_left(triangles: u64, tally: &Tally) -> BuildError {
    let reasons: Vec<String> = tally.iter().map(|(kind, n, _)| format!("{kind}: {n}")).collect();
    BuildError::Empty {
        why: format!("of {} none is left ({})", counted(triangles, "triangle", "triangles"), reasons.join("; ")),
    }
}

/// What the passes over the triangles give.
#[derive(Default)]
struct Measures {
    triangles: u64,
    slots: Slots,
    /// Number of slots that are complete.
    complete: usize,
    lengths: Lengths,
    facing: Facing,
    /// Sums of cells.
    samples: Vec<I64Vec3>,
    /// One bit for every triangle that is kept.
    keep: Vec<u64>,
    dropped: Dropped,
}

impl Measures {
    /// Add a piece whose first triangle has number `first`.
    fn take(&mut self, piece: &Piece, first: u64) {
        self.triangles += piece.kept as u64;
        self.lengths.merge(&piece.lengths);
        self.facing.add(&piece.facing);
        self.samples.extend(&piece.samples);
        let word = (first / 64) as usize;
        self.keep[word..word + piece.keep.len()].copy_from_slice(&piece.keep);
        self.dropped.add(&piece.dropped);
    }
}

/// Triangles that are not kept.
#[derive(Default)]
struct Dropped {
    not_finite: u64,
    /// The lowest numbers of triangles that are not finite, ascending.
    first_not_finite: Vec<u64>,
    low_confidence: u64,
    cropped: u64,
}

impl Dropped {
    fn not_finite(&mut self, number: u64) {
        self.not_finite += 1;
        if self.first_not_finite.len() < PLACES_KEPT {
            self.first_not_finite.push(number);
        }
    }

    fn add(&mut self, other: &Self) {
        self.not_finite += other.not_finite;
        self.low_confidence += other.low_confidence;
        self.cropped += other.cropped;
        // Slots are not completed in ascending order.
        self.first_not_finite.extend(&other.first_not_finite);
        self.first_not_finite.sort_unstable();
        self.first_not_finite.truncate(PLACES_KEPT);
    }

    fn tally(&self) -> Tally {
        let mut tally = Tally::default();
        for number in &self.first_not_finite {
            tally.add(NOT_FINITE, || format!("triangle {number}"));
        }
        tally.add_many(NOT_FINITE, self.not_finite - self.first_not_finite.len() as u64);
        tally.add_many(LOW_CONFIDENCE, self.low_confidence);
        tally.add_many(CROPPED, self.cropped);
        tally
    }
}

/// What stays the same over the passes.
struct Run<'a> {
    work: &'a Work<'a>,
    spooled: &'a Spooled,
    options: &'a IngestOptions,
    layout: Layout,
    weight: u64,
    /// The word of the confidence.
    confidence: Option<usize>,
    triangles: ScratchFile,
    /// The high bits of the vertex numbers of triangles.
    triangles_high: Option<ScratchFile>,
    triangle_colors: Option<ScratchFile>,
    /// One bit for every vertex that a kept triangle uses.
    used: Vec<AtomicU64>,
}

/// The triangles of a slot.
#[derive(Default)]
struct Block {
    slot: usize,
    /// The lowest and highest number of a vertex that they use.
    used: [u64; 2],
    /// Their corners, as far as they are known; empty if this pass found none.
    words: Vec<u32>,
    /// Empty until all corners are known.
    pieces: Vec<Piece>,
}

/// A part of a block in the hands of a thread.
#[derive(Default)]
struct Piece {
    kept: usize,
    /// One bit for every triangle that is kept.
    keep: Vec<u64>,
    lengths: Lengths,
    facing: Facing,
    samples: Vec<I64Vec3>,
    dropped: Dropped,
}

/// Sums of the normals and areas of triangles: whole numbers, so that their order does not matter.
#[derive(Default)]
struct Facing {
    normals: [i128; 3],
    areas: u128,
}

impl Facing {
    /// Count a triangle, given by its cells.
    fn triangle(&mut self, a: &[u32], b: &[u32], c: &[u32]) {
        let along = |p: &[u32]| I64Vec3::from(std::array::from_fn(|i| i64::from(p[i]) - i64::from(a[i])));
        let (u, v) = (along(b), along(c));
        if u.abs().max(v.abs()).max_element() < 1 << 30 {
            // True of nearly all triangles: the products fit in 64 bits.
            let normal = u.cross(v);
            self.normals.iter_mut().zip(normal.to_array()).for_each(|(sum, n)| *sum += i128::from(n));
            self.areas += u128::from(normal.as_dvec3().length() as u64);
            return;
        }
        let (u, v) = (|i: usize| i128::from(u[i]), |i: usize| i128::from(v[i]));
        let normal = [u(1) * v(2) - u(2) * v(1), u(2) * v(0) - u(0) * v(2), u(0) * v(1) - u(1) * v(0)];
        self.normals.iter_mut().zip(normal).for_each(|(sum, n)| *sum += n);
        self.areas += DVec3::from(normal.map(|n| n as f64)).length() as u128;
    }

    fn add(&mut self, other: &Self) {
        self.normals.iter_mut().zip(other.normals).for_each(|(sum, n)| *sum += n);
        self.areas += other.areas;
    }

    fn mean(&self) -> DVec3 {
        DVec3::from(self.normals.map(|n| n as f64)) / (self.areas as f64).max(1.0)
    }
}

/// Vertices in memory.
struct Range {
    first: u64,
    words: Vec<u32>,
}

/// A pass over the triangles.
struct Pass<'a> {
    provisional: &'a Provisional,
    /// One bit for every triangle that is kept, if that is known.
    keep: Option<&'a [u64]>,
    loaded: Range,
    corners: &'a ScratchFile,
    /// For the display of progress: triangles of the passes before, and of all passes.
    done: u64,
    total: u64,
}

impl<'a> Run<'a> {
    fn new(
        work: &'a Work<'a>,
        spooled: &'a Spooled,
        options: &'a IngestOptions,
        weight: u64,
    ) -> Result<Self, BuildError> {
        let layout = layout_of(spooled);
        let is_confidence = |name: &str| ["confidence", "quality"].iter().any(|n| name.eq_ignore_ascii_case(n));
        let channel = spooled.channels.iter().position(|c| is_confidence(&c.name));
        if options.min_confidence.is_some() && channel.is_none() {
            let why = "--min-confidence needs a channel named confidence or quality, and no input has one".to_owned();
            return Err(BuildError::Empty { why });
        }
        let colors = spooled.triangle_colors.then(|| work.scratch.existing(TRIANGLE_COLORS)).transpose()?;
        let high = spooled.has_high_bits.then(|| work.scratch.existing(TRIANGLES_HIGH)).transpose()?;
        Ok(Self {
            work,
            spooled,
            options,
            layout,
            weight,
            confidence: channel.filter(|_| options.min_confidence.is_some()).map(|c| layout.scalar() + c),
            triangles: work.scratch.existing(TRIANGLES)?,
            triangles_high: high,
            triangle_colors: colors,
            used: (0..spooled.vertices.div_ceil(64)).map(|_| AtomicU64::new(0)).collect(),
        })
    }

    /// Vertices that fit the budget.
    fn range(&self) -> u64 {
        let bits = 8 * self.used.len() as u64 + self.spooled.triangles / 8;
        let blocks = (2 * block(self.work, self.layout) * (4 * self.layout.triangle() + 40)) as u64;
        let capacity = (self.work.memory / 8 * 7).saturating_sub(bits + blocks) / (4 * self.layout.vertex() as u64);
        // Ever more passes would take for ever: 64 of them at most.
        capacity.max(self.spooled.vertices.div_ceil(64)).clamp(1, self.spooled.vertices)
    }

    /// Stream the triangles past the vertices; `keep` are the bits of those that are kept, where they are known.
    fn passes(&self, provisional: &Provisional, keep: Option<&[u64]>) -> Result<Measures, BuildError> {
        let corners = self.work.scratch.create(CORNERS)?;
        // Vertices before the first that a triangle names, and after the last, are not needed.
        let [start, last] = self.spooled.vertex_range.unwrap_or_default();
        let (end, range) = (last + 1, self.range());
        let slots = Slots::new(self.spooled.triangles, block(self.work, self.layout));
        // The lowest and highest number of a vertex that the triangles of each slot use; the first pass finds them.
        let mut used = vec![[start, last]; slots.len()];
        let keep_words = self.spooled.triangles.div_ceil(64) as usize;
        let mut measures = Measures { slots, keep: vec![0; keep_words], ..Measures::default() };
        let total = self.spooled.triangles * (end - start).div_ceil(range);
        for (pass, first) in (0..).zip((start..end).step_by(range as usize)) {
            let count = range.min(end - first);
            let loaded = Range { first, words: self.load(provisional, first, count as usize)? };
            let pass =
                Pass { provisional, keep, loaded, corners: &corners, done: pass * self.spooled.triangles, total };
            self.pass(&pass, &mut used, &mut measures)?;
        }
        if measures.complete < used.len() {
            return Err(ScratchError::damaged(self.triangles.path(), "it names vertices that do not exist").into());
        }
        Ok(measures)
    }

    /// Do one pass. `used` are the lowest and highest number of a vertex that the triangles of each slot use.
    fn pass(&self, pass: &Pass<'_>, used: &mut [[u64; 2]], measures: &mut Measures) -> Result<(), BuildError> {
        let (layout, loaded) = (self.layout, self.vertices_of(&pass.loaded));
        let may_use = |[lowest, highest]: [u64; 2]| lowest < loaded.end && highest >= loaded.start;
        let todo: Vec<(usize, u64)> = (0..used.len())
            .filter(|slot| may_use(used[*slot]))
            .map(|slot| (slot, measures.slots.first(slot)))
            .collect();
        let capacity = measures.slots.capacity();
        let triangles = |first: u64| (self.spooled.triangles - first).min(capacity);
        let mut done =
            pass.done + self.spooled.triangles - todo.iter().map(|(_, first)| triangles(*first)).sum::<u64>();
        let look = |i: usize, words: Vec<u32>| -> Result<Block, ScratchError> {
            let Some(&(slot, first)) = todo.get(i) else { return Ok(Block::default()) };
            self.look(pass, &loaded, (slot, first, triangles(first) as usize), words)
        };
        let mut write = |mut block: Block| -> Result<Vec<u32>, ScratchError> {
            used[block.slot] = block.used;
            if block.pieces.is_empty() {
                if !block.words.is_empty() {
                    write_words(pass.corners, measures.slots.byte(block.slot, layout), &mut block.words)?;
                }
                return Ok(block.words);
            }
            measures.complete += 1;
            let (mut kept, first) = (0, measures.slots.first(block.slot));
            for (i, piece) in block.pieces.iter().enumerate() {
                let (from, words) = (i * PIECE * layout.triangle(), piece.kept * layout.triangle());
                if kept < from {
                    block.words.copy_within(from..from + words, kept);
                }
                kept += words;
                measures.take(piece, first + (i * PIECE) as u64);
            }
            measures.slots.fill(pass.corners, layout, block.slot, &mut block.words[..kept])?;
            Ok(block.words)
        };
        // One block is written while the next is looked at, in the memory of the one before.
        let (mut ready, mut spare) = (look(0, Vec::new())?, Vec::new());
        for (i, (_, first)) in todo.iter().enumerate() {
            let (written, next) = rayon::join(|| write(ready), || look(i + 1, spare));
            (ready, spare) = (next?, written?);
            done += triangles(*first);
            self.work.progress.update("finding corners", done, pass.total);
            self.work.stop.check()?;
        }
        Ok(())
    }

    /// The numbers of the vertices in memory.
    fn vertices_of(&self, loaded: &Range) -> std::ops::Range<u64> {
        loaded.first..loaded.first + (loaded.words.len() / self.layout.vertex()) as u64
    }

    /// Fill in those corners of the `n` triangles of a slot, starting with number `first`, whose vertices are in memory. If
    /// all corners are known then, measure the triangles.
    fn look(
        &self,
        pass: &Pass<'_>,
        loaded: &std::ops::Range<u64>,
        (slot, first, n): (usize, u64, usize),
        mut words: Vec<u32>,
    ) -> Result<Block, ScratchError> {
        let rows = self.numbers(first, n)?;
        let join = |a: [u64; 2], b: [u64; 2]| [a[0].min(b[0]), a[1].max(b[1])];
        let of = |[a, b, c]: &[u64; 3]| [*a.min(b).min(c), *a.max(b).max(c)];
        let used = rows.par_iter().map(of).reduce(|| [u64::MAX, 0], join);
        if !rows.par_iter().any(|row| row.iter().any(|v| loaded.contains(v))) {
            words.clear();
            return Ok(Block { slot, used, words, pieces: Vec::new() });
        }
        words.resize(n * self.layout.triangle(), 0);
        if used[0] < loaded.start {
            // An earlier pass filled in some of them.
            read_words(pass.corners, first * 4 * self.layout.triangle() as u64, &mut words)?;
        }
        self.fill(&pass.loaded, &rows, &mut words);
        let is_complete = used[1] < loaded.end;
        let pieces = if is_complete {
            self.complete(pass.provisional, first, &rows, &mut words, pass.keep)?
        } else {
            Vec::new()
        };
        Ok(Block { slot, used, words, pieces })
    }

    /// The vertices that `n` triangles from number `first` on name.
    fn numbers(&self, first: u64, n: usize) -> Result<Vec<[u64; 3]>, ScratchError> {
        let rows = self.triangles.read(12 * first, 12 * n as u64)?;
        let number = |bytes: &[u8; 4]| u64::from(u32::from_le_bytes(*bytes));
        let (numbers, _) = rows.as_chunks::<4>();
        let low: Vec<[u64; 3]> = numbers.as_chunks::<3>().0.par_iter().map(|t| t.each_ref().map(number)).collect();
        let Some(high) = &self.triangles_high else { return Ok(low) };
        let high = high.read(3 * first, 3 * n as u64)?;
        let joined = |(low, high): ([u64; 3], &[u8; 3])| std::array::from_fn(|k| low[k] | u64::from(high[k]) << 32);
        Ok(low.into_iter().zip(high.as_chunks::<3>().0).map(joined).collect())
    }

    /// The vertices from `first` on as words on the provisional lattice.
    fn load(&self, provisional: &Provisional, first: u64, count: usize) -> Result<Vec<u32>, ScratchError> {
        let width = self.layout.vertex();
        let open = |yes: bool, name: &str| yes.then(|| self.work.scratch.existing(name)).transpose();
        let positions = self.work.scratch.existing(POSITIONS)?;
        let normals = open(self.spooled.normals, NORMALS)?;
        let colors = open(self.spooled.vertex_colors, COLORS)?;
        let (grey, black, white) = match &self.spooled.color {
            ColorSource::Scalar { file, black, white } => (open(true, file)?, *black, *white),
            _ => (None, 0.0, 1.0),
        };
        let scalars: Vec<ScratchFile> =
            self.spooled.channels.iter().map(|c| self.work.scratch.existing(&c.file)).collect::<Result<_, _>>()?;
        let mut words = vec![0u32; count * width];
        let per_metre = provisional.per_metre();
        let precision = self.options.precision;
        let none = word_of_color(precision.color(UNCOLOURED));
        for (block, out) in words.chunks_mut(ROWS * width).enumerate() {
            let (row, n) = (first + (block * ROWS) as u64, out.len() / width);
            let read = |file: &ScratchFile, bytes: usize| file.read(row * bytes as u64, (n * bytes) as u64);
            let read_four = |file: &Option<ScratchFile>| file.as_ref().map(|f| read(f, 4)).transpose();
            let places = read(&positions, 24)?;
            let (colors, normals, grey) = (read_four(&colors)?, read_four(&normals)?, read_four(&grey)?);
            let scalars = scalars.iter().map(|f| read(f, 4)).collect::<Result<Vec<_>, _>>()?;
            out.par_chunks_mut(ROW_PIECE * width).enumerate().for_each(|(piece, out)| {
                for (i, vertex) in (piece * ROW_PIECE..).zip(out.chunks_exact_mut(width)) {
                    let cell = provisional.cell(position_of_row(&places.as_chunks::<24>().0[i]), per_metre);
                    vertex[..3].copy_from_slice(&cell.unwrap_or([INVALID; 3]));
                    if let Some(at) = self.layout.color() {
                        vertex[at] = match (&colors, &grey) {
                            (Some(rows), _) => color_of_row(rows.as_chunks::<4>().0[i], none, precision),
                            (None, Some(rows)) => {
                                grey_of_row(rows.as_chunks::<4>().0[i], [black, white], none, precision)
                            }
                            (None, None) => none,
                        };
                    }
                    if let (Some(at), Some(rows)) = (self.layout.normal(), &normals) {
                        let [a, b, c, d] = rows.as_chunks::<4>().0[i];
                        let normal = [i16::from_le_bytes([a, b]), i16::from_le_bytes([c, d])];
                        vertex[at] = word_of_normal(precision.normal(normal));
                    }
                    for (to, rows) in vertex[self.layout.scalar()..].iter_mut().zip(&scalars) {
                        *to = u32::from_le_bytes(rows.as_chunks::<4>().0[i]);
                    }
                }
            });
        }
        Ok(words)
    }

    /// Copy the vertices that are in memory to the corners that name them.
    fn fill(&self, loaded: &Range, rows: &[[u64; 3]], words: &mut [u32]) {
        let width = self.layout.vertex();
        let triangle = self.layout.triangle();
        words.par_chunks_mut(PIECE * triangle).zip(rows.par_chunks(PIECE)).for_each(|(words, rows)| {
            for (corner, number) in words.chunks_exact_mut(width).zip(rows.as_flattened()) {
                let vertex = number.wrapping_sub(loaded.first) as usize;
                let at = vertex.wrapping_mul(width);
                if vertex < loaded.words.len() / width {
                    corner.copy_from_slice(&loaded.words[at..at + width]);
                }
            }
        });
    }

    /// Decide which triangles of a block are kept, and measure them; they are at the beginning of their piece.
    fn complete(
        &self,
        provisional: &Provisional,
        block: u64,
        rows: &[[u64; 3]],
        words: &mut [u32],
        keep: Option<&[u64]>,
    ) -> Result<Vec<Piece>, ScratchError> {
        let n = rows.len();
        let colors = self.triangle_colors.as_ref().map(|f| f.read(4 * block, 4 * n as u64)).transpose()?;
        let pieces = words.par_chunks_mut(PIECE * self.layout.triangle()).zip(rows.par_chunks(PIECE)).enumerate();
        let piece = |(i, (words, rows)): (usize, (&mut [u32], &[[u64; 3]]))| {
            let first = i * PIECE;
            let colors = colors.as_ref().map(|c| &c.as_chunks::<4>().0[first..]);
            let number = block + first as u64;
            self.piece(provisional, number, rows, words, colors, keep.map(|k| &k[(number / 64) as usize..]))
        };
        Ok(pieces.map(piece).collect())
    }

    fn piece(
        &self,
        provisional: &Provisional,
        number: u64,
        rows: &[[u64; 3]],
        words: &mut [u32],
        colors: Option<&[[u8; 4]]>,
        keep: Option<&[u64]>,
    ) -> Piece {
        let (width, triangle) = (self.layout.vertex(), self.layout.triangle());
        let mut out = Piece::default();
        out.keep.resize(rows.len().div_ceil(64), 0);
        for (i, row) in rows.iter().enumerate() {
            let at = i * triangle;
            let bit = 1u64 << (i % 64);
            let wanted = match keep {
                Some(keep) => keep[i / 64] & bit != 0,
                None => self.wanted(provisional, number + i as u64, &words[at..at + triangle], &mut out.dropped),
            };
            if !wanted {
                continue;
            }
            out.keep[i / 64] |= bit;
            for v in row {
                let (word, bit) = (&self.used[(v / 64) as usize], 1u64 << (v % 64));
                if word.load(Ordering::Relaxed) & bit == 0 {
                    word.fetch_or(bit, Ordering::Relaxed);
                }
            }
            let to = out.kept * triangle;
            if to < at {
                words.copy_within(at..at + triangle, to);
            }
            out.kept += 1;
            let corners = &mut words[to..to + triangle];
            if let (Some(at), Some([r, g, b, 1])) = (self.layout.color(), colors.map(|c| c[i])) {
                corners
                    .chunks_exact_mut(width)
                    .for_each(|c| c[at] = word_of_color(self.options.precision.color([r, g, b])));
            }
            let (a, b, c) = (&corners[..width], &corners[width..2 * width], &corners[2 * width..]);
            out.lengths.add(a, b);
            out.lengths.add(b, c);
            out.lengths.add(c, a);
            out.facing.triangle(a, b, c);
            let mixed = (number + i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 32;
            if mixed.is_multiple_of(self.weight) {
                let sum = |k: usize| i64::from(a[k]) + i64::from(b[k]) + i64::from(c[k]);
                out.samples.push(I64Vec3::new(sum(0), sum(1), sum(2)));
            }
        }
        out
    }

    /// Whether a triangle is kept.
    fn wanted(&self, provisional: &Provisional, number: u64, corners: &[u32], dropped: &mut Dropped) -> bool {
        let mut vertices = corners.chunks_exact(self.layout.vertex());
        if vertices.clone().any(|c| c[0] == INVALID) {
            dropped.not_finite(number);
            return false;
        }
        if let (Some(at), Some(lowest)) = (self.confidence, self.options.min_confidence)
            && vertices.clone().any(|c| f32::from_bits(c[at]) < lowest)
        {
            dropped.low_confidence += 1;
            return false;
        }
        if let Some([min, max]) = self.options.crop {
            let sum: DVec3 = vertices.by_ref().map(|c| DVec3::new(c[0].into(), c[1].into(), c[2].into())).sum();
            let centroid = provisional.metres(sum / 3.0 + 0.5);
            if centroid.cmplt(min).any() || centroid.cmpgt(max).any() {
                dropped.cropped += 1;
                return false;
            }
        }
        true
    }

    fn used_count(&self) -> u64 {
        self.used.iter().map(|w| u64::from(w.load(Ordering::Relaxed).count_ones())).sum()
    }

    /// The box round the vertices that kept triangles use, metres.
    fn used_bounds(&self) -> Result<Box3, ScratchError> {
        if let (true, Some(bounds)) = (self.used_count() == self.spooled.vertices, self.spooled.bounds) {
            return Ok(bounds);
        }
        let positions = self.work.scratch.existing(POSITIONS)?;
        let mut bounds = [DVec3::INFINITY, DVec3::NEG_INFINITY];
        for first in (0..self.spooled.vertices).step_by(ROWS) {
            let n = (self.spooled.vertices - first).min(ROWS as u64);
            let words = &self.used[(first / 64) as usize..(first + n).div_ceil(64) as usize];
            if words.iter().all(|w| w.load(Ordering::Relaxed) == 0) {
                continue;
            }
            let rows = positions.read(24 * first, 24 * n)?;
            for (v, row) in (first..).zip(rows.as_chunks::<24>().0) {
                if self.used[(v / 64) as usize].load(Ordering::Relaxed) >> (v % 64) & 1 == 1 {
                    let p = position_of_row(row);
                    bounds = [bounds[0].min(p), bounds[1].max(p)];
                }
            }
        }
        Ok(bounds)
    }

    /// The median length of the edges of some kept triangles, from the positions as they were given, metres.
    fn sampled_median(&self, keep: &[u64]) -> Result<f64, ScratchError> {
        let positions = self.work.scratch.existing(POSITIONS)?;
        let mut lengths = Vec::new();
        for t in (0..self.spooled.triangles).step_by(self.spooled.triangles.div_ceil(ASTRAY_SAMPLES) as usize) {
            if keep[(t / 64) as usize] >> (t % 64) & 1 == 0 {
                continue;
            }
            let mut p = [DVec3::ZERO; 3];
            for (p, vertex) in p.iter_mut().zip(self.numbers(t, 1)?.into_iter().flatten()) {
                let bytes = positions.read(24 * vertex, 24)?;
                *p = position_of_row(&bytes.as_chunks::<24>().0[0]);
            }
            let edges = [(0, 1), (1, 2), (2, 0)];
            let length = |(a, b): (usize, usize)| p[a].distance(p[b]);
            lengths.extend(edges.map(length).into_iter().filter(|l| *l > 0.0));
        }
        lengths.sort_by(f64::total_cmp);
        Ok(lengths.get(lengths.len() / 2).copied().unwrap_or(0.0))
    }
}

/// The word of a vertex colour; the last byte of the row says whether it was given.
fn color_of_row([r, g, b, given]: [u8; 4], none: u32, precision: Precision) -> u32 {
    if given == 0 { none } else { word_of_color(precision.color([r, g, b])) }
}

/// The word of a grey that represents a scalar.
fn grey_of_row(row: [u8; 4], [black, white]: [f32; 2], none: u32, precision: Precision) -> u32 {
    let v = f32::from_le_bytes(row);
    if !v.is_finite() {
        return none;
    }
    let share = (f64::from(v) - f64::from(black)) / (f64::from(white) - f64::from(black));
    word_of_color(precision.color([libm::round(share.clamp(0.0, 1.0) * 255.0) as u8; 3]))
}

/// Number of triangles in a slot, which this and later stages read at once: two pieces for each thread, if memory allows. Fewer
/// would leave threads idle; more would not stay in the processor's caches.
fn block(work: &Work<'_>, layout: Layout) -> usize {
    let fit = work.memory / 64 / (4 * layout.triangle() as u64) / PIECE as u64;
    PIECE * fit.clamp(1, 2 * work.threads.max(1) as u64) as usize
}
