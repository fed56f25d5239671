//! The samples of a station, column by column.
//!
//! Tracing a ray takes ten times as long as writing its sample. For surveys of hundreds of millions of samples, only every Nth column and row can be traced;
//! the samples between four traced ones are interpolated if these are on one smooth surface or all empty. Otherwise, the cell between them is divided.

use super::beam::{Echo, Sample, Scratch, Shot};
use super::props::Props;
use super::stations::Station;
use super::{CLASSES, Class, LOWEST_ELEVATION, ScanOptions, truth};
use crate::fort::scene::Scene;
use crate::noise::{derive, lerp};
use glam::{DMat3, DVec3};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, BufWriter, Write};

/// Maximum difference between the ranges of two neighbouring echoes of one smooth surface: this many times the difference that a plane would give at their incidence,
/// plus this share of the distance between their rays.
const MAX_STEEPER: f64 = 1.5;
const MAX_STEP: f64 = 0.1;
/// Maximum difference between the range differences on opposite sides of a cell, as a share of the distance between its rays.
const MAX_TWIST: f64 = 0.5;

/// The columns of a station, made in batches by all threads and delivered in order; their classes are written on the way.
pub(super) struct Columns<'a> {
    scene: &'a Scene,
    options: &'a ScanOptions,
    station: &'a Station,
    props: Props,
    eye: DVec3,
    fort_from_scan: DMat3,
    /// Sine and cosine for each row.
    elevations: Vec<(f64, f64)>,
    width: u32,
    next: u32,
    ready: VecDeque<Vec<Sample>>,
    labels: Option<BufWriter<File>>,
    counts: [u64; CLASSES],
}

impl<'a> Columns<'a> {
    /// The columns of a station whose props are these; the classes of the samples are written into `labels`.
    pub(super) fn new(
        scene: &'a Scene,
        options: &'a ScanOptions,
        station: &'a Station,
        props: Props,
        labels: File,
    ) -> Self {
        let (columns, rows) = station.instrument.grid(options.columns);
        let step = (90.0 - LOWEST_ELEVATION) / f64::from(rows - 1);
        let elevation = |row: u32| libm::sincos((LOWEST_ELEVATION + step * f64::from(row)).to_radians());
        let axis = |v: DVec3| Scene::from_site(station.rotation * v);
        Self {
            scene,
            options,
            station,
            props,
            eye: Scene::from_site(station.position),
            fort_from_scan: DMat3::from_cols(axis(DVec3::X), axis(DVec3::Y), axis(DVec3::Z)),
            elevations: (0..rows).map(elevation).collect(),
            width: columns,
            next: 0,
            ready: VecDeque::new(),
            labels: Some(BufWriter::new(labels)),
            counts: [0; CLASSES],
        }
    }

    /// Whether all columns that were made have been delivered.
    pub(super) fn is_batch_taken(&self) -> bool {
        self.ready.is_empty()
    }

    fn fill(&mut self) {
        let every = self.options.trace_every;
        let threads = rayon::current_num_threads() as u32;
        let batch = (8 * threads).max(2 * threads * every).max(64).next_multiple_of(every);
        let (from, to) = (self.next, self.next.saturating_add(batch).min(self.width));
        let (columns, shot) = (&*self, self.shot());
        let strip = |scratch: &mut Scratch, k: u32| {
            let first = from + k * every;
            let mut strip = Strip::new(columns, &shot, first, scratch);
            strip.fill();
            (first..(first + every).min(to)).map(|column| strip.column(column)).collect::<Vec<_>>()
        };
        let strips = (0..(to - from).div_ceil(every)).into_par_iter().map_init(Scratch::default, strip);
        self.ready = strips.collect::<Vec<_>>().into_iter().flatten().collect();
        self.next = to;
    }

    fn shot(&self) -> Shot<'_> {
        let instrument = self.station.instrument;
        Shot {
            scene: self.scene,
            props: &self.props,
            instrument,
            returns: self.options.returns.unwrap_or(instrument.returns),
            noise: self.options.noise,
            eye: self.eye,
            seed: derive(derive(self.options.seed, 0xe4), u64::from(self.station.number)),
        }
    }

    /// The direction of a sample in the scan's frame.
    fn direction(&self, column: u32, row: usize) -> DVec3 {
        let (s, c) = libm::sincos(std::f64::consts::TAU * f64::from(column) / f64::from(self.width));
        let (up, flat) = self.elevations[row];
        DVec3::new(c * flat, s * flat, up)
    }

    fn label(&mut self, column: &[Sample]) -> io::Result<()> {
        let Some(labels) = &mut self.labels else { return Ok(()) };
        let mut bytes = Vec::with_capacity(column.len());
        for sample in column {
            self.counts[sample.class as usize] += 1;
            bytes.push(sample.class as u8);
        }
        labels.write_all(&bytes)
    }

    /// All columns have been taken: complete the file of classes.
    pub(super) fn finish(mut self) -> io::Result<[u64; CLASSES]> {
        if let Some(labels) = self.labels.take() {
            labels.into_inner().map_err(io::IntoInnerError::into_error)?.sync_all()?;
        }
        Ok(self.counts)
    }
}

/// The echoes of the columns from one whose rays are traced to the next: the columns of a station whose number is divisible by `trace_every` are traced in the rows
/// whose number is, and in the last one. The cells between are divided until their corners are on a smooth surface; a corner of such a part may have been interpolated for
/// the cell beside it. The last column is traced again for the next strip.
struct Strip<'a, 's> {
    columns: &'a Columns<'a>,
    shot: &'a Shot<'a>,
    first: u32,
    scratch: &'s mut Scratch,
    /// By column and row.
    echoes: Vec<Known>,
}

/// Whether the echo of a sample is known yet.
#[derive(Clone, Copy)]
enum Known {
    NotYet,
    /// `None`: nothing comes back.
    Echo(Option<Echo>),
}

impl<'a, 's> Strip<'a, 's> {
    fn new(columns: &'a Columns<'a>, shot: &'a Shot<'a>, first: u32, scratch: &'s mut Scratch) -> Self {
        let count = (columns.options.trace_every as usize + 1) * columns.elevations.len();
        Self { columns, shot, first, scratch, echoes: vec![Known::NotYet; count] }
    }

    fn fill(&mut self) {
        let (every, last) = (self.columns.options.trace_every as usize, self.columns.elevations.len() - 1);
        if every == 1 {
            for row in 0..=last {
                self.trace(0, row);
            }
        }
        for low in (0..last).step_by(every).filter(|_| every > 1) {
            self.cell([0, every], [low, (low + every).min(last)]);
        }
    }

    fn at(&mut self, column: usize, row: usize) -> &mut Known {
        &mut self.echoes[column * self.columns.elevations.len() + row]
    }

    /// The echo of a sample, traced if it is not known yet.
    fn trace(&mut self, column: usize, row: usize) -> Option<Echo> {
        if let Known::Echo(echo) = *self.at(column, row) {
            return echo;
        }
        let local = self.columns.direction(self.first + column as u32, row);
        let echo = self.shot.echo(self.columns.fort_from_scan * local, self.scratch);
        *self.at(column, row) = Known::Echo(echo);
        echo
    }

    /// Finds the echoes of a cell of several columns and rows, from its first to its last of each.
    fn cell(&mut self, [left, right]: [usize; 2], [low, high]: [usize; 2]) {
        let corners = [left, right].map(|column| [low, high].map(|row| self.trace(column, row)));
        let (width, height) = (right - left, high - low);
        if width.max(height) <= 1 {
            return;
        }
        let spread = std::f64::consts::TAU * width.max(height) as f64 / f64::from(self.columns.width);
        if is_smooth(corners, spread) {
            for (column, row) in (left..=right).flat_map(|column| (low..=high).map(move |row| (column, row))) {
                let share = |at: usize, from: usize, size: usize| (at - from) as f64 / size.max(1) as f64;
                let known = self.at(column, row);
                if matches!(known, Known::NotYet) {
                    *known = Known::Echo(between(corners, share(column, left, width), share(row, low, height)));
                }
            }
            return;
        }
        let halves = |from: usize, to: usize| {
            let middle = from.midpoint(to);
            [[from, middle], [middle, to]].into_iter().filter(|[a, b]| b > a)
        };
        for columns in halves(left, right) {
            for rows in halves(low, high) {
                self.cell(columns, rows);
            }
        }
    }

    /// The samples of a column of the strip.
    fn column(&self, column: u32) -> Vec<Sample> {
        let rows = self.columns.elevations.len();
        let echoes = &self.echoes[(column - self.first) as usize * rows..][..rows];
        let sample = |(row, known): (usize, &Known)| match known {
            Known::Echo(Some(echo)) => {
                self.shot.report(echo, self.columns.direction(column, row), [column, row as u32])
            }
            Known::Echo(None) => Sample::none(Class::Empty),
            Known::NotYet => unreachable!("every cell of a strip is filled"),
        };
        echoes.iter().enumerate().map(sample).collect()
    }
}

/// Whether four echoes (two of one column, the lower first, and two of the next) are of one smooth surface, or all empty. `spread`: the angle between their rays, radians.
fn is_smooth(corners: [[Option<Echo>; 2]; 2], spread: f64) -> bool {
    if corners == [[None; 2]; 2] {
        return true;
    }
    let [[Some(a), Some(b)], [Some(c), Some(d)]] = corners else { return false };
    let apart = spread * a.range;
    let is_flat = |x: &Echo, y: &Echo| {
        let cosine = x.cosine.min(y.cosine);
        let slope = (1.0 - cosine * cosine).sqrt() / cosine;
        (x.range - y.range).abs() <= apart * (MAX_STEEPER * slope + MAX_STEP)
    };
    [a, b, c, d].iter().all(|echo| echo.class == a.class && echo.class != Class::Mixed)
        && is_flat(&a, &b)
        && is_flat(&c, &d)
        && is_flat(&a, &c)
        && is_flat(&b, &d)
        && (a.range - b.range - c.range + d.range).abs() <= MAX_TWIST * apart
}

/// The echo between four (see [`is_smooth`]) at shares `u` across and `v` up.
fn between(corners: [[Option<Echo>; 2]; 2], u: f64, v: f64) -> Option<Echo> {
    let [[Some(a), Some(b)], [Some(c), Some(d)]] = corners else { return None };
    let mix = |of: fn(&Echo) -> f64| lerp(lerp(of(&a), of(&b), v), lerp(of(&c), of(&d), v), u);
    Some(Echo {
        // The reciprocal of the range is linear on a plane.
        range: mix(|echo| echo.range.recip()).recip(),
        cosine: mix(|echo| echo.cosine),
        signal: mix(|echo| echo.signal),
        intensity: mix(|echo| echo.intensity),
        color: [mix(|echo| echo.color[0]), mix(|echo| echo.color[1]), mix(|echo| echo.color[2])],
        class: a.class,
    })
}

impl Iterator for Columns<'_> {
    type Item = io::Result<Vec<Sample>>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.next == 0
            && let Some(labels) = &mut self.labels
        {
            let rows = self.elevations.len() as u32;
            let head = [&truth::LABELS[..], &self.width.to_le_bytes(), &rows.to_le_bytes()].concat();
            if let Err(e) = labels.write_all(&head) {
                return Some(Err(e));
            }
        }
        if self.ready.is_empty() {
            if self.next == self.width {
                return None;
            }
            self.fill();
        }
        let column = self.ready.pop_front()?;
        Some(self.label(&column).map(|()| column))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn echo(range: f64, cosine: f64) -> Echo {
        Echo { range, cosine, signal: 1.0, intensity: 0.5, color: [100.0; 3], class: Class::Surface }
    }

    #[test]
    fn only_echoes_of_one_surface_are_interpolated() {
        let spread = 0.05;
        let at = |range: f64, cosine: f64| Some(echo(range, cosine));
        assert!(is_smooth([[at(10.0, 1.0); 2]; 2], spread));
        // A wall seen at 45°.
        assert!(is_smooth([[at(10.0, 0.7); 2], [at(10.5, 0.7); 2]], spread));
        assert!(
            !is_smooth([[at(10.0, 0.98); 2], [at(10.5, 0.98); 2]], spread),
            "the edge of a wall in front of another"
        );
        assert!(!is_smooth([[at(10.0, 0.7), at(10.3, 0.7)], [at(10.3, 0.7), at(10.0, 0.7)]], spread), "twisted");
        assert!(!is_smooth([[at(10.0, 1.0), None], [at(10.0, 1.0); 2]], spread));
        assert!(is_smooth([[None; 2]; 2], spread));
    }
}
