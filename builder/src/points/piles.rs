//! Points by region: while they are read, each goes to the pile of its tetrahedron some levels down the tree. A pile too large for memory is divided again.

use super::runs::{Run, RunFile};
use super::splat::{BYTES, Splat};
use super::{Placement, Point, PointInputs};
use crate::build::options::{BuildError, BuildOptions};
use crate::build::work::Work;
use crate::partition::{BISECTIONS, root_of};
use glam::I64Vec3;
use kilwa_geometry::Tetra;
use kilwa_geometry::tetra::{SplitPlane, max_level};
use kilwa_pack::metadata::SourceFile;

/// Bisections from the roots to the piles, and from a pile that is divided again to those that it becomes.
const DEPTHS: [u8; 2] = [12, 6];
/// Splats that a pile gathers before they are written.
const GATHERED: usize = 1024;

/// A pile: a tetrahedron and its splats.
pub(super) struct Pile {
    pub(super) tetra: Tetra,
    /// The tetrahedra of the tree that it is in, from its root.
    pub(super) above: Vec<Tetra>,
    pub(super) runs: Vec<Run>,
    pub(super) count: u64,
}

/// What was read.
pub(super) struct Read {
    /// Every pile that is not empty, in the order of a walk through the tree.
    pub(super) piles: Vec<Pile>,
    /// Files of the runs: those of a pile are in one of them.
    pub(super) file: RunFile,
    pub(super) has_colors: bool,
    /// Smallest and largest, if there are any.
    pub(super) intensity: Option<[f32; 2]>,
    pub(super) cropped: u64,
    pub(super) sources: Vec<SourceFile>,
}

/// Points that a pile may have to be sorted in memory, beside others.
pub(super) fn largest_pile(work: &Work<'_>) -> u64 {
    (work.memory / 8 / (3 * BYTES as u64)).max(1 << 16)
}

/// Read all inputs.
pub(super) fn read(
    inputs: &mut dyn PointInputs,
    place: &Placement,
    options: &BuildOptions,
    work: &Work<'_>,
) -> Result<Read, BuildError> {
    let file = RunFile::create(work.scratch, "points")?;
    let (has_colors, has_intensity) = inputs.attributes();
    let depth = DEPTHS[0].min(max_level(place.cube_log2) / BISECTIONS * BISECTIONS);
    let mut sorter = Sorter::new(Tetra::roots(place.cube_log2).to_vec(), &[], depth, work.memory / 4);
    let (mut low, mut high, mut cropped) = (f32::INFINITY, f32::NEG_INFINITY, 0);
    let is_in =
        |p: &Point| options.crop.is_none_or(|[min, max]| p.position.cmpge(min).all() && p.position.cmple(max).all());
    let mut sink = |points: &[Point]| -> Result<(), BuildError> {
        work.stop.check()?;
        for point in points {
            if !is_in(point) {
                cropped += 1;
                continue;
            }
            let splat = Splat::new(point, place, options.normal_bits).ok_or_else(|| BuildError::Inputs {
                why: format!("a point at {:?} m is outside of the box of the inputs", point.position.to_array()),
            })?;
            (low, high) = (low.min(splat.intensity), high.max(splat.intensity));
            let sum = 3 * splat.center().as_i64vec3();
            sorter.add(root_of(sum), sum, splat, &file)?;
        }
        Ok(())
    };
    let sources = inputs.deliver(&mut sink, work)?;
    let mut piles = Vec::new();
    for pile in sorter.finish(&file)? {
        divided(pile, place, work, &file, &mut piles)?;
    }
    if piles.is_empty() {
        let why = if cropped > 0 {
            "the box of --crop holds no points"
        } else {
            "the inputs have no points, or active masks cover all of them (--unmasked uses them)"
        };
        return Err(BuildError::Inputs { why: why.to_owned() });
    }
    let intensity = (has_intensity && low <= high).then_some([low, high]);
    Ok(Read { piles, file, has_colors, intensity, cropped, sources })
}

/// A pile, divided until its parts fit into memory.
fn divided(
    pile: Pile,
    place: &Placement,
    work: &Work<'_>,
    file: &RunFile,
    out: &mut Vec<Pile>,
) -> Result<(), BuildError> {
    if pile.count <= largest_pile(work) || pile.tetra.level + DEPTHS[1] > max_level(place.cube_log2) {
        out.push(pile);
        return Ok(());
    }
    let mut sorter = Sorter::new(vec![pile.tetra], &pile.above, DEPTHS[1], work.memory / 4);
    let mut splats = Vec::new();
    for run in pile.runs {
        work.stop.check()?;
        splats.clear();
        file.read(run, &mut splats)?;
        for splat in &splats {
            sorter.add(0, 3 * splat.center().as_i64vec3(), *splat, file)?;
        }
    }
    for part in sorter.finish(file)? {
        divided(part, place, work, file, out)?;
    }
    Ok(())
}

/// Sorts splats by the tetrahedra some bisections below others.
struct Sorter {
    roots: Vec<Tetra>,
    above: Vec<Tetra>,
    depth: u8,
    /// For each root, the planes of all bisections: the children of number k are 2k and 2k + 1, and the first is 1.
    planes: Vec<Vec<SplitPlane>>,
    /// For each root and tetrahedron below it: what is not written yet, and what is.
    gathered: Vec<Vec<Splat>>,
    runs: Vec<Vec<Run>>,
    /// Splats that are not written yet, and how many there may be.
    held: usize,
    most: usize,
}

impl Sorter {
    fn new(roots: Vec<Tetra>, above: &[Tetra], depth: u8, memory: u64) -> Self {
        let planes = roots.iter().map(|root| {
            let mut tetrahedra = vec![*root; 2];
            for k in 2..1usize << depth {
                let child = tetrahedra[k / 2].children()[k % 2];
                tetrahedra.push(child);
            }
            tetrahedra.iter().map(Tetra::split_plane).collect()
        });
        let places = roots.len() << depth;
        Self {
            planes: planes.collect(),
            above: above.to_vec(),
            depth,
            gathered: vec![Vec::new(); places],
            runs: vec![Vec::new(); places],
            held: 0,
            most: (memory as usize / BYTES).max(1 << 16),
            roots,
        }
    }

    fn add(&mut self, root: usize, sum: I64Vec3, splat: Splat, file: &RunFile) -> Result<(), BuildError> {
        let planes = &self.planes[root];
        let mut k = 1;
        for _ in 0..self.depth {
            k = 2 * k + planes[k].child_of_sum(sum);
        }
        let place = (root << self.depth) + k - (1 << self.depth);
        self.gathered[place].push(splat);
        self.held += 1;
        if self.gathered[place].len() >= GATHERED {
            self.write(place, file)?;
        } else if self.held > self.most {
            (0..self.gathered.len()).try_for_each(|place| self.write(place, file))?;
        }
        Ok(())
    }

    fn write(&mut self, place: usize, file: &RunFile) -> Result<(), BuildError> {
        let gathered = std::mem::take(&mut self.gathered[place]);
        if !gathered.is_empty() {
            self.held -= gathered.len();
            self.runs[place].push(file.append(&gathered)?);
        }
        Ok(())
    }

    /// The piles, in the order of a walk through the tree.
    fn finish(mut self, file: &RunFile) -> Result<Vec<Pile>, BuildError> {
        (0..self.gathered.len()).try_for_each(|place| self.write(place, file))?;
        let mut piles = Vec::new();
        for (place, runs) in self.runs.iter_mut().enumerate().filter(|(_, runs)| !runs.is_empty()) {
            let mut tetra = self.roots[place >> self.depth];
            let mut above = self.above.clone();
            for bit in (0..self.depth).rev() {
                if tetra.level.is_multiple_of(BISECTIONS) {
                    above.push(tetra);
                }
                tetra = tetra.children()[place >> bit & 1];
            }
            let runs = std::mem::take(runs);
            let count = runs.iter().map(|run| u64::from(run.count)).sum();
            piles.push(Pile { tetra, above, runs, count });
        }
        Ok(piles)
    }
}
