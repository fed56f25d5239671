//! Files of scans: what every reader of them guarantees.

use super::{complaint, file};
use glam::DVec3;
use kilwa_formats::Diagnostics;
use kilwa_scan::ScanError;
use kilwa_scan::read::{Head, Picture, ReadOptions, Sink};
use kilwa_scan::spool::Layout;
use kilwa_scan_core::Sample;

/// Counts what a reader of scans delivers, and checks it.
#[derive(Default)]
pub(crate) struct Scans {
    pub(crate) samples: u64,
    pub(crate) stations: u64,
    /// Of all samples in their order, and the cells they were put in.
    pub(crate) digest: u64,
    cells: u64,
    diagnostics: Diagnostics,
}

impl Scans {
    fn add(&mut self, sample: &Sample, cell: u64) {
        assert!(sample.position.is_finite() && sample.position.abs().max_element() <= 10_000.0);
        self.samples += 1;
        let [r, g, b] = sample.color.map(u32::from);
        let [x, y, z] = sample.position.to_array().map(f32::to_bits);
        let words = [x, y, z, sample.intensity.to_bits(), r, g, b, sample.state.to_byte().into()];
        for word in words.map(u64::from).into_iter().chain([cell]) {
            self.digest = (self.digest ^ word).wrapping_mul(0x0100_0000_01b3).rotate_left(23);
        }
    }
}

impl Sink for Scans {
    fn begin(&mut self, head: &Head) -> Result<bool, ScanError> {
        assert!(head.pose.is_none_or(|pose| pose.rotation.is_normalized() && pose.translation.is_finite()));
        Ok(true)
    }

    fn skip(&mut self) {}

    fn push(&mut self, sample: &Sample) -> Result<(), ScanError> {
        self.add(sample, self.samples);
        Ok(())
    }

    fn put(&mut self, cell: u64, sample: &Sample) -> Result<bool, ScanError> {
        self.add(sample, cell);
        self.cells = self.cells.max(cell + 1);
        Ok(true)
    }

    fn end(&mut self, layout: Layout) -> Result<(), ScanError> {
        assert!(self.cells <= layout.grid.cells());
        self.stations += 1;
        Ok(())
    }

    fn picture(
        &mut self,
        _: &Picture,
        write: &mut dyn FnMut(&mut dyn std::io::Write) -> Result<(), ScanError>,
    ) -> Result<(), ScanError> {
        write(&mut std::io::sink())
    }

    fn progress(&mut self, _: u64) -> Result<(), ScanError> {
        Ok(())
    }

    fn diagnostics(&mut self) -> &mut Diagnostics {
        &mut self.diagnostics
    }
}

/// Any bytes as a file of scans with this name: the reader ends, does not panic, and delivers no more than eight samples for each byte; an error names
/// the file.
///
/// # Errors
/// Those of the reader.
pub(crate) fn read_scans(bytes: &[u8], name: &str, keep_incomplete: bool) -> Result<Scans, ScanError> {
    let path = file(bytes, name);
    let options = ReadOptions { station: Some(DVec3::ZERO), keep_incomplete, ..ReadOptions::default() };
    let mut sink = Scans::default();
    let done = kilwa_scan::read::read(&path, &options, &mut sink);
    // A record of an E57 has at least one bit.
    assert!(sink.samples <= 8 * bytes.len() as u64);
    match done {
        Ok(()) => Ok(sink),
        Err(e) => {
            assert!(e.to_string().contains(name), "{e}");
            Err(e)
        }
    }
}

fn scans(bytes: &[u8], name: &str) -> String {
    match read_scans(bytes, name, true) {
        Ok(sink) => format!("{} scans", sink.stations.min(3)),
        Err(e) => complaint(e),
    }
}

/// Any bytes as a PTX.
pub(crate) fn ptx_file(bytes: &[u8]) -> String {
    scans(bytes, "a.ptx")
}

/// Any bytes as PTS or XYZ.
pub(crate) fn points_file(bytes: &[u8]) -> String {
    scans(bytes, "a.pts")
}

/// Any bytes as an E57. Its pages have checksums, which are made right, so that what is behind them is reached.
pub(crate) fn e57_file(bytes: &[u8]) -> String {
    const PAGE: usize = 1024;
    let mut sound = bytes.to_vec();
    for page in sound.chunks_exact_mut(PAGE) {
        let sum = crc32c::crc32c(&page[..PAGE - 4]);
        page[PAGE - 4..].copy_from_slice(&sum.to_be_bytes());
    }
    scans(&sound, "a.e57")
}

/// Any bytes as LAS or LAZ.
pub(crate) fn las_file(bytes: &[u8]) -> String {
    scans(bytes, "a.las")
}

/// Any bytes as a PLY of points.
pub(crate) fn range_grid(bytes: &[u8]) -> String {
    scans(bytes, "a.ply")
}
