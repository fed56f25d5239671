//! The header of a spool: 256 bytes, of which the last 32 are the BLAKE3 hash of the others.

use super::{BLOCK_SAMPLES, SAMPLE_BYTES};
use crate::hashed::HASH_BYTES;
use glam::{DVec3, Vec3};
use kilwa_scan_core::{Grid, Kind, Rays, Sample};

pub(super) const HEADER_BYTES: usize = 256;
const CHECKED: usize = HEADER_BYTES - 32;
const MAGIC: &[u8; 8] = b"KILWASCN";
const VERSION: u32 = 1;

const IS_GRID: u32 = 1;
const BY_ROWS: u32 = 2;
const IS_PARALLEL: u32 = 4;
const HAS_INTENSITY: u32 = 8;
const HAS_COLOR: u32 = 16;
const KNOWN: u32 = 31;

/// What the samples of a station amount to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Statistics {
    /// Measured points.
    pub measured: u64,
    /// Cells without a valid return that the file records as such.
    pub no_return: u64,
    /// Measured points with a colour.
    pub colored: u64,
    /// Measured points with an intensity.
    pub with_intensity: u64,
    /// Smallest and largest coordinates of measured points, relative to the origin, metres; infinite where there are none.
    pub bounds: [Vec3; 2],
    /// Smallest and largest intensity; infinite where there is none.
    pub intensity: [f32; 2],
    /// Largest distance from the origin, metres.
    pub max_range: f32,
}

impl Default for Statistics {
    fn default() -> Self {
        Self {
            measured: 0,
            no_return: 0,
            colored: 0,
            with_intensity: 0,
            bounds: [Vec3::INFINITY, Vec3::NEG_INFINITY],
            intensity: [f32::INFINITY, f32::NEG_INFINITY],
            max_range: 0.0,
        }
    }
}

impl Statistics {
    #[inline]
    pub(super) fn add(&mut self, sample: &Sample) {
        match sample.state.kind() {
            Kind::Empty => {}
            Kind::NoReturn => self.no_return += 1,
            Kind::Measured => {
                self.measured += 1;
                self.colored += u64::from(sample.state.has_color());
                self.bounds = [self.bounds[0].min(sample.position), self.bounds[1].max(sample.position)];
                self.max_range = self.max_range.max(sample.position.length());
                if !sample.intensity.is_nan() {
                    self.with_intensity += 1;
                    self.intensity = [self.intensity[0].min(sample.intensity), self.intensity[1].max(sample.intensity)];
                }
            }
        }
    }
}

/// What a spool holds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Header {
    /// The grid; for a cloud without one, one line of all points.
    pub grid: Grid,
    /// Whether rows and columns mean anything.
    pub is_grid: bool,
    /// How the rays run.
    pub rays: Rays,
    /// What must be added to positions to get the coordinates of the source, in metres.
    pub origin: DVec3,
    /// What the samples amount to.
    pub statistics: Statistics,
    /// The hash of the table.
    pub(super) table_hash: [u8; 32],
}

impl Header {
    pub(super) fn blocks(&self) -> u64 {
        self.grid.cells().div_ceil(BLOCK_SAMPLES)
    }

    pub(super) fn table_offset(&self) -> u64 {
        HEADER_BYTES as u64 + self.grid.cells() * SAMPLE_BYTES as u64
    }

    /// Bytes of the whole file.
    pub(super) fn file_bytes(&self) -> u64 {
        self.table_offset() + self.blocks() * HASH_BYTES as u64
    }

    /// What is wrong with a header whose hash is right: anybody can write one.
    fn check(&self) -> Result<(), String> {
        let Grid { columns, rows, .. } = self.grid;
        let cells = self.grid.cells();
        let per_block = BLOCK_SAMPLES * SAMPLE_BYTES as u64 + HASH_BYTES as u64;
        // One block more than there are, and the header.
        let bytes = cells.div_ceil(BLOCK_SAMPLES).checked_add(1).and_then(|blocks| blocks.checked_mul(per_block));
        if cells == 0 || bytes.is_none() {
            return Err(format!("its header is damaged: it states {columns} columns and {rows} rows"));
        }
        let s = &self.statistics;
        let counts = s.measured.checked_add(s.no_return).is_some_and(|n| n <= cells);
        if !counts || s.colored > s.measured || s.with_intensity > s.measured {
            return Err(format!("its header is damaged: {} measured points in {cells} cells", s.measured));
        }
        let [min, max] = s.bounds;
        let is_bounded = min.is_finite() && max.is_finite() && min.cmple(max).all();
        let is_placed = match self.rays {
            Rays::Central => true,
            Rays::Parallel(direction) => direction.is_normalized(),
        };
        if s.measured > 0 && !(is_bounded && s.max_range.is_finite()) || !self.origin.is_finite() || !is_placed {
            return Err("its header is damaged: its origin, rays or bounds are impossible".to_owned());
        }
        Ok(())
    }

    /// What tells this spool from others: the hash of its header, which holds that of its samples.
    pub fn digest(&self) -> [u8; 32] {
        let mut digest = [0; 32];
        digest.copy_from_slice(&self.to_bytes()[CHECKED..]);
        digest
    }

    pub(super) fn to_bytes(self) -> [u8; HEADER_BYTES] {
        let mut out = Vec::with_capacity(HEADER_BYTES);
        let s = &self.statistics;
        let parallel = match self.rays {
            Rays::Central => DVec3::ZERO,
            Rays::Parallel(direction) => direction,
        };
        let flags = [
            (self.is_grid, IS_GRID),
            (self.grid.by_rows, BY_ROWS),
            (self.rays != Rays::Central, IS_PARALLEL),
            (s.with_intensity > 0, HAS_INTENSITY),
            (s.colored > 0, HAS_COLOR),
        ];
        let flags = flags.iter().filter(|(is, _)| *is).fold(0, |sum, (_, bit)| sum | bit);
        out.extend(MAGIC);
        for word in [VERSION, flags, self.grid.columns, self.grid.rows, BLOCK_SAMPLES as u32, SAMPLE_BYTES as u32] {
            out.extend(word.to_le_bytes());
        }
        for count in [s.measured, s.no_return, s.colored, s.with_intensity] {
            out.extend(count.to_le_bytes());
        }
        for number in self.origin.to_array().into_iter().chain(parallel.to_array()) {
            out.extend(number.to_le_bytes());
        }
        let floats = [s.bounds[0].to_array(), s.bounds[1].to_array()].into_iter().flatten();
        for number in floats.chain([s.intensity[0], s.intensity[1], s.max_range]) {
            out.extend(number.to_le_bytes());
        }
        out.extend(self.table_hash);
        out.resize(CHECKED, 0);
        let hash = *blake3::hash(&out).as_bytes();
        out.extend(hash);
        let mut bytes = [0; HEADER_BYTES];
        bytes.copy_from_slice(&out);
        bytes
    }

    /// The header in these bytes, or what is wrong with them.
    pub(super) fn parse(bytes: &[u8; HEADER_BYTES]) -> Result<Self, String> {
        let mut rest = &bytes[..];
        if take::<8>(&mut rest) != *MAGIC {
            return Err("it is not a Kilwa scan file".to_owned());
        }
        let version = u32::from_le_bytes(take(&mut rest));
        if version != VERSION {
            return Err(format!("it is of version {version}; this version of Kilwa reads version {VERSION}"));
        }
        if blake3::hash(&bytes[..CHECKED]).as_bytes()[..] != bytes[CHECKED..] {
            return Err("its header is damaged (bytes 0 to 255)".to_owned());
        }
        let mut word = || u32::from_le_bytes(take(&mut rest));
        let (flags, columns, rows, block, sample) = (word(), word(), word(), word(), word());
        if flags & !KNOWN != 0 || u64::from(block) != BLOCK_SAMPLES || sample as usize != SAMPLE_BYTES {
            return Err("it was written by a later version of Kilwa".to_owned());
        }
        let mut count = || u64::from_le_bytes(take(&mut rest));
        let (measured, no_return, colored, with_intensity) = (count(), count(), count(), count());
        let mut double = || f64::from_le_bytes(take(&mut rest));
        let mut vector = || DVec3::new(double(), double(), double());
        let (origin, parallel) = (vector(), vector());
        let mut float = || f32::from_le_bytes(take(&mut rest));
        let bounds = [Vec3::new(float(), float(), float()), Vec3::new(float(), float(), float())];
        let (intensity, max_range) = ([float(), float()], float());
        let statistics = Statistics { measured, no_return, colored, with_intensity, bounds, intensity, max_range };
        let header = Self {
            grid: Grid { columns, rows, by_rows: flags & BY_ROWS != 0 },
            is_grid: flags & IS_GRID != 0,
            rays: if flags & IS_PARALLEL != 0 { Rays::Parallel(parallel) } else { Rays::Central },
            origin,
            statistics,
            table_hash: take(&mut rest),
        };
        header.check()?;
        Ok(header)
    }
}

/// The next bytes of a header, whose length is known to suffice.
fn take<const N: usize>(rest: &mut &[u8]) -> [u8; N] {
    let mut out = [0; N];
    let (head, tail) = rest.split_at(N);
    out.copy_from_slice(head);
    *rest = tail;
    out
}
