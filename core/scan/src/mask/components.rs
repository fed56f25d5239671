//! Connected components of a grid of samples, line by line and without keeping the grid.
//!
//! Neighbouring cells (eight around each) are joined where the samples are near enough to each other. A first pass over the lines gives each sample a
//! provisional label and notes which labels meet; a second pass over the same lines gives the same labels, which then lead to their component. What is
//! kept is one line and 12 bytes for each provisional label, of which there are far fewer than samples where surfaces are connected.

use crate::sample::{Rays, Sample};

/// No sample, or one that takes no part.
pub const NONE: u32 = u32::MAX;

/// When neighbours are joined: where their distance is at most `factor` times the distance between both rays, plus `floor`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Joining {
    /// How many times the spacing of the rays.
    pub factor: f64,
    /// Metres that are allowed anyway, for the noise of ranges.
    pub floor: f64,
}

impl Joining {
    /// Whether two neighbours belong together.
    pub fn joins(&self, a: &Sample, b: &Sample, rays: Rays) -> bool {
        let reach = self.factor * rays.spacing(a.position, b.position) + self.floor;
        f64::from(a.position.distance_squared(b.position)) <= reach * reach
    }
}

/// Gives labels to the samples of one line after the other.
#[derive(Debug)]
struct Labeller {
    joining: Joining,
    rays: Rays,
    next: u32,
    before: Vec<Sample>,
    labels: Vec<u32>,
}

impl Labeller {
    fn new(joining: Joining, rays: Rays) -> Self {
        Self { joining, rays, next: 0, before: Vec::new(), labels: Vec::new() }
    }

    /// The labels of a line; `meet` is called with labels that are of one component.
    fn line(&mut self, line: &[Sample], takes_part: &dyn Fn(usize) -> bool, meet: &mut dyn FnMut(u32, u32)) {
        let mut labels: Vec<u32> = Vec::with_capacity(line.len());
        for (at, sample) in line.iter().enumerate() {
            if !sample.is_measured() || !takes_part(at) {
                labels.push(NONE);
                continue;
            }
            let mut own = NONE;
            let mut join = |other: u32, neighbour: &Sample| {
                if other == NONE || !self.joining.joins(sample, neighbour, self.rays) {
                    return;
                }
                if own == NONE {
                    own = other;
                } else if own != other {
                    meet(own, other);
                }
            };
            if let Some(before) = at.checked_sub(1) {
                join(labels[before], &line[before]);
            }
            for place in at.saturating_sub(1)..=at + 1 {
                if let Some((label, neighbour)) = self.labels.get(place).zip(self.before.get(place)) {
                    join(*label, neighbour);
                }
            }
            if own == NONE {
                own = self.next;
                self.next += 1;
            }
            labels.push(own);
        }
        self.labels = labels;
        self.before.clear();
        self.before.extend_from_slice(line);
    }
}

/// The first pass.
#[derive(Debug)]
pub struct Finder {
    labeller: Labeller,
    first: Option<(Vec<Sample>, Vec<u32>)>,
    parents: Vec<u32>,
    sizes: Vec<u32>,
    marks: Vec<u32>,
}

impl Finder {
    /// Nothing yet.
    pub fn new(joining: Joining, rays: Rays) -> Self {
        let labeller = Labeller::new(joining, rays);
        Self { labeller, first: None, parents: Vec::new(), sizes: Vec::new(), marks: Vec::new() }
    }

    /// The next line. `takes_part` chooses samples by their place in it; `is_marked` those that are counted apart.
    pub fn line(&mut self, line: &[Sample], takes_part: &dyn Fn(usize) -> bool, is_marked: &dyn Fn(usize) -> bool) {
        let mut met = Vec::new();
        self.labeller.line(line, takes_part, &mut |a, b| met.push((a, b)));
        while self.parents.len() < self.labeller.next as usize {
            self.parents.push(self.parents.len() as u32);
            self.sizes.push(0);
            self.marks.push(0);
        }
        for (at, label) in self.labeller.labels.iter().enumerate() {
            if *label != NONE {
                let label = *label as usize;
                self.sizes[label] = self.sizes[label].saturating_add(1);
                self.marks[label] = self.marks[label].saturating_add(u32::from(is_marked(at)));
            }
        }
        for (a, b) in met {
            union(&mut self.parents, a, b);
        }
        if self.first.is_none() {
            self.first = Some((line.to_vec(), self.labeller.labels.clone()));
        }
    }

    /// The last line is a neighbour of the first, as in a scan of a whole turn.
    pub fn close(&mut self) {
        let Some((line, labels)) = &self.first else { return };
        for (at, (sample, label)) in self.labeller.before.iter().zip(&self.labeller.labels).enumerate() {
            for place in at.saturating_sub(1)..=at + 1 {
                if let Some((neighbour, other)) = line.get(place).zip(labels.get(place))
                    && *label != NONE
                    && *other != NONE
                    && self.labeller.joining.joins(sample, neighbour, self.labeller.rays)
                {
                    union(&mut self.parents, *label, *other);
                }
            }
        }
    }

    /// The second pass.
    pub fn finish(mut self) -> Components {
        for label in 0..self.parents.len() as u32 {
            let root = find(&mut self.parents, label) as usize;
            if root != label as usize {
                self.sizes[root] = self.sizes[root].saturating_add(self.sizes[label as usize]);
                self.marks[root] = self.marks[root].saturating_add(self.marks[label as usize]);
            }
        }
        let labeller = Labeller::new(self.labeller.joining, self.labeller.rays);
        Components { labeller, parents: self.parents, sizes: self.sizes, marks: self.marks }
    }
}

/// The second pass: lines in the same order as before.
#[derive(Debug)]
pub struct Components {
    labeller: Labeller,
    parents: Vec<u32>,
    sizes: Vec<u32>,
    marks: Vec<u32>,
}

impl Components {
    /// Call `found` with the place, the size of the component and its marked samples, for every sample of the line that takes part.
    pub fn line(
        &mut self,
        line: &[Sample],
        takes_part: &dyn Fn(usize) -> bool,
        found: &mut dyn FnMut(usize, u32, u32),
    ) {
        self.labeller.line(line, takes_part, &mut |_, _| {});
        for at in 0..self.labeller.labels.len() {
            let label = self.labeller.labels[at];
            if label != NONE {
                let root = find(&mut self.parents, label) as usize;
                found(at, self.sizes[root], self.marks[root]);
            }
        }
    }
}

fn find(parents: &mut [u32], mut label: u32) -> u32 {
    while parents[label as usize] != label {
        let grandparent = parents[parents[label as usize] as usize];
        parents[label as usize] = grandparent;
        label = grandparent;
    }
    label
}

fn union(parents: &mut [u32], a: u32, b: u32) {
    let (a, b) = (find(parents, a), find(parents, b));
    // The older label stays, so that trees are shallow.
    let (old, new) = (a.min(b), a.max(b));
    parents[new as usize] = old;
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;
    use proptest::prelude::*;

    /// Samples a metre apart on a plane, where the pattern has something.
    fn grid(pattern: &[Vec<bool>]) -> Vec<Vec<Sample>> {
        let at = |line: usize, place: usize, is: bool| {
            if is { Sample::measured(Vec3::new(line as f32, place as f32, 0.0)) } else { Sample::EMPTY }
        };
        let line = |(k, cells): (usize, &Vec<bool>)| cells.iter().enumerate().map(|(n, is)| at(k, n, *is)).collect();
        pattern.iter().enumerate().map(line).collect()
    }

    const RAYS: Rays = Rays::Parallel(glam::DVec3::Z);
    const JOINING: Joining = Joining { factor: 1.5, floor: 0.0 };

    fn sizes(grid: &[Vec<Sample>]) -> Vec<Vec<u32>> {
        let mut finder = Finder::new(JOINING, RAYS);
        for line in grid {
            finder.line(line, &|_| true, &|_| false);
        }
        let mut components = finder.finish();
        let mut out = Vec::new();
        for line in grid {
            let mut sizes = vec![0; line.len()];
            components.line(line, &|_| true, &mut |at, size, _| sizes[at] = size);
            out.push(sizes);
        }
        out
    }

    /// By flooding, with the whole grid in memory.
    fn flooded(pattern: &[Vec<bool>]) -> Vec<Vec<u32>> {
        let mut sizes = vec![vec![0; pattern[0].len()]; pattern.len()];
        for line in 0..pattern.len() {
            for at in 0..pattern[0].len() {
                if !pattern[line][at] || sizes[line][at] > 0 {
                    continue;
                }
                let (mut seen, mut open) = (vec![(line, at)], vec![(line, at)]);
                while let Some((l, a)) = open.pop() {
                    for (dl, da) in (-1..=1).flat_map(|dl| (-1..=1).map(move |da| (dl, da))) {
                        let next = (l.wrapping_add_signed(dl), a.wrapping_add_signed(da));
                        let is = pattern.get(next.0).and_then(|line| line.get(next.1)) == Some(&true);
                        if is && !seen.contains(&next) {
                            seen.push(next);
                            open.push(next);
                        }
                    }
                }
                for (l, a) in &seen {
                    sizes[*l][*a] = seen.len() as u32;
                }
            }
        }
        sizes
    }

    proptest! {
        #[test]
        fn components_are_those_of_flooding(cells in prop::collection::vec(prop::collection::vec(prop::bool::weighted(0.4), 9), 1..12)) {
            prop_assert_eq!(sizes(&grid(&cells)), flooded(&cells));
        }
    }

    #[test]
    fn a_closed_turn_joins_its_last_line_to_its_first_and_marks_are_summed() {
        let lines: Vec<Vec<Sample>> = (0..12)
            .map(|k| {
                let turn = f64::from(k) * std::f64::consts::TAU / 12.0;
                // A ring with two gaps.
                let is = ![3, 7].contains(&k);
                let p = Vec3::new(libm::cos(turn) as f32, libm::sin(turn) as f32, 0.0) * 10.0;
                vec![if is { Sample::measured(p) } else { Sample::EMPTY }]
            })
            .collect();
        let mut finder = Finder::new(JOINING, Rays::Central);
        for (k, line) in lines.iter().enumerate() {
            finder.line(line, &|_| true, &|_| k == 0);
        }
        finder.close();
        let mut components = finder.finish();
        let mut found = Vec::new();
        for line in &lines {
            components.line(line, &|_| true, &mut |_, size, marks| found.push((size, marks)));
        }
        assert_eq!(found, [[(7, 1)].repeat(3), [(3, 0)].repeat(3), [(7, 1)].repeat(4)].concat());
    }
}
