//! Meshes of stations.

use crate::support::{Site, ptx_header};
use kilwa_scan::ScanError;
use kilwa_scan::mesh::{MeshVertex, Options, Surface, mesh};
use kilwa_scan::read::ReadOptions;
use kilwa_scan::spool::Reader;
use kilwa_scan_core::Pose;
use std::fmt::Write as _;

#[derive(Default)]
struct Count(u32);

impl Surface for Count {
    fn vertex(&mut self, _: &MeshVertex) -> Result<u32, ScanError> {
        self.0 += 1;
        Ok(self.0 - 1)
    }

    fn triangle(&mut self, _: [u32; 3]) -> Result<(), ScanError> {
        Ok(())
    }
}

/// A detail: a wall at 1 m, seen within two degrees.
#[test]
fn a_narrow_scan_is_not_joined_to_a_ring() {
    const COLUMNS: u32 = 100;
    const ROWS: u32 = 12;
    let mut text = ptx_header(COLUMNS, ROWS, [0.0; 3]);
    for column in 0..COLUMNS {
        let angle = (f64::from(column) / f64::from(COLUMNS) - 0.5) * 2_f64.to_radians();
        for row in 0..ROWS {
            writeln!(text, "1 {:.7} {:.7} 0.5", angle.tan(), f64::from(row) * 3.5e-4).unwrap();
        }
    }
    let site = Site::new();
    let file = site.write("a.ptx", text);
    site.import(&[file], ReadOptions::default()).unwrap();
    let mut reader = Reader::open(&site.survey().join("stations/a.scan")).unwrap();
    let report = mesh(&mut reader, Pose::default(), &Options::default(), &mut Count::default()).unwrap();
    assert!(!report.is_closed);
    assert_eq!(report.triangles, u64::from((COLUMNS - 1) * (ROWS - 1) * 2));
}
