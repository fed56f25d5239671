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

/// Keeps a mesh in parts of at most so many triangles, as coordinates.
struct Parts {
    limit: usize,
    parts: Vec<(Vec<MeshVertex>, Vec<[u32; 3]>)>,
}

impl Parts {
    fn of(reader: &mut Reader, limit: usize) -> (Self, u64) {
        let mut parts = Self { limit, parts: vec![Default::default()] };
        let tessellate = kilwa_scan_core::tessellate::Options { max_edge: 1.0, ..Default::default() };
        let options = Options { tessellate, ..Options::default() };
        let pose = Pose::at(glam::DVec3::new(566_000.1, 9_010_000.3, 4.7));
        let report = mesh(reader, pose, &options, &mut parts).unwrap();
        assert!(report.is_closed);
        (parts, report.vertices)
    }

    /// Every triangle by the bits of its corners, sorted.
    fn triangles(&self) -> Vec<[[u64; 3]; 3]> {
        let of = |(vertices, triangles): &(Vec<MeshVertex>, Vec<[u32; 3]>)| -> Vec<_> {
            let place = |v: u32| vertices[v as usize].position.to_array().map(f64::to_bits);
            triangles.iter().map(|t| t.map(place)).collect()
        };
        let mut all: Vec<_> = self.parts.iter().flat_map(of).collect();
        all.sort_unstable();
        all
    }
}

impl Surface for Parts {
    fn part(&mut self) -> Result<u32, ScanError> {
        if self.parts.last().is_some_and(|(_, triangles)| triangles.len() == self.limit) {
            self.parts.push(Default::default());
        }
        Ok(self.parts.len() as u32)
    }

    fn vertex(&mut self, vertex: &MeshVertex) -> Result<u32, ScanError> {
        let (vertices, _) = self.parts.last_mut().unwrap();
        vertices.push(*vertex);
        Ok(vertices.len() as u32 - 1)
    }

    fn triangle(&mut self, corners: [u32; 3]) -> Result<(), ScanError> {
        let (vertices, triangles) = self.parts.last_mut().unwrap();
        assert!(corners.iter().all(|v| (*v as usize) < vertices.len()), "vertices of this part");
        triangles.push(corners);
        Ok(())
    }
}

#[test]
fn the_parts_of_a_mesh_are_the_whole_mesh_and_share_vertices_that_are_the_same_in_every_bit() {
    const COLUMNS: u32 = 120;
    const ROWS: u32 = 30;
    let mut text = ptx_header(COLUMNS, ROWS, [0.0; 3]);
    for column in 0..COLUMNS {
        let azimuth = f64::from(column) * std::f64::consts::TAU / f64::from(COLUMNS);
        for row in 0..ROWS {
            let (x, y, z) = (3.0 * azimuth.cos(), 3.0 * azimuth.sin(), (f64::from(row) - 14.5) * 0.1);
            writeln!(text, "{x:.6} {y:.6} {z:.6} {:.3}", f64::from(row) / 40.0).unwrap();
        }
    }
    let site = Site::new();
    let file = site.write("a.ptx", text);
    site.import(&[file], ReadOptions::default()).unwrap();
    let mut reader = Reader::open(&site.survey().join("stations/a.scan")).unwrap();
    let (whole, vertices) = Parts::of(&mut reader, usize::MAX);
    let triangles = whole.triangles();
    assert_eq!((whole.parts.len(), triangles.len() as u32, vertices), (1, COLUMNS * (ROWS - 1) * 2, 3600));
    for limit in [1, 7, 1000, 3480, triangles.len()] {
        let (parts, delivered) = Parts::of(&mut reader, limit);
        assert_eq!(parts.parts.len(), triangles.len().div_ceil(limit), "{limit}");
        assert!(parts.parts.iter().all(|(_, t)| t.len() <= limit));
        assert!(parts.triangles() == triangles, "{limit}: no triangle is lost, and none comes twice");
        assert_eq!(delivered, parts.parts.iter().map(|(v, _)| v.len() as u64).sum::<u64>());
        let mut seen = std::collections::BTreeMap::new();
        for vertex in parts.parts.iter().flat_map(|(vertices, _)| vertices) {
            let bits = vertex.position.to_array().map(f64::to_bits);
            let before = seen.insert(bits, *vertex);
            assert!(before.is_none_or(|before| before == *vertex), "{vertex:?}");
        }
        assert_eq!(seen.len() as u64, vertices);
    }
}
