//! Meshes and an independent reading of packs, shared by the property tests of the hierarchy.
#![allow(dead_code, reason = "each test file uses its own part")]

use glam::DVec3;
use kilwa_builder::build::work::Stop;
use kilwa_builder::{BuildOptions, Progress, Silent, build_pack};
use kilwa_formats::RawMesh;
use kilwa_geometry::LatticePoint;
use kilwa_pack::cut::Cut;
use kilwa_pack::reader::SliceSource;
use kilwa_pack::{Chunk, DirectoryEntry, Reader};
use kilwa_synth::{self as synth, Phantom, SiteKind, SynthOptions};
use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};

pub(crate) fn fort(triangles: u64) -> RawMesh {
    synth::mesh(SiteKind::Fort, &SynthOptions::new(triangles)).expect("fort")
}

pub(crate) fn wall(triangles: u64) -> RawMesh {
    synth::mesh(SiteKind::Wall, &SynthOptions::new(triangles)).expect("wall")
}

/// A closed manifold: a sphere with relief.
pub(crate) fn closed(triangles: u64) -> RawMesh {
    let mut mesh = synth::mesh(SiteKind::Phantom(Phantom::Sphere), &SynthOptions::new(triangles)).expect("sphere");
    for p in &mut mesh.positions {
        let r = 1.0 + 0.05 * (p[0] * 9.0).sin() * (p[1] * 7.0).cos() + 0.01 * (p[2] * 61.0).sin();
        *p = p.map(|x| x * r);
    }
    mesh
}

/// The closed mesh with patches of triangles torn out: true borders.
pub(crate) fn with_holes(triangles: u64) -> RawMesh {
    let mut mesh = closed(triangles);
    let mut random = fastrand::Rng::with_seed(5);
    let centres: Vec<DVec3> = (0..40).map(|_| mesh.positions[random.usize(..mesh.positions.len())]).collect();
    let positions = mesh.positions.clone();
    mesh.triangles.retain(|t| {
        let p = positions[t[0] as usize];
        centres.iter().enumerate().all(|(i, c)| p.distance(*c) > 0.01 + 0.004 * i as f64)
    });
    // And single triangles, so that borders touch in points.
    let mut n = 0;
    mesh.triangles.retain(|_| {
        n += 1;
        n % 997 != 0
    });
    mesh
}

/// Sheets that cross in shared edges (four triangles at an edge), fans that touch in points (bow-ties), doubled
/// triangles and loose islands.
pub(crate) fn non_manifold(n: u32) -> RawMesh {
    let mut mesh = RawMesh::default();
    let mut at: HashMap<[i64; 3], u32> = HashMap::new();
    let mut vertex = |mesh: &mut RawMesh, p: [f64; 3]| {
        let key = p.map(|x| (x * 1e6).round() as i64);
        *at.entry(key).or_insert_with(|| {
            mesh.positions.push(p.into());
            mesh.colors.push(p.map(|x| (128.0 + 100.0 * (x * 11.0).sin()) as u8));
            mesh.positions.len() as u32 - 1
        })
    };
    let s = 1.0 / f64::from(n);
    for i in 0..n {
        for j in 0..n {
            let (x, y) = (f64::from(i) * s, f64::from(j) * s);
            let relief = |u: f64, v: f64| {
                if (u - 0.5).abs() < s * 0.5 { 0.0 } else { 0.02 * (u * 20.0).sin() * (v * 30.0).cos() }
            };
            let horizontal = |u: f64, v: f64| [u, v, relief(u, v)];
            let upright = |u: f64, v: f64| [0.5 + relief(u, v), v, u - 0.5];
            for sheet in [&horizontal as &dyn Fn(f64, f64) -> [f64; 3], &upright] {
                let q = [sheet(x, y), sheet(x + s, y), sheet(x + s, y + s), sheet(x, y + s)];
                let v = q.map(|p| vertex(&mut mesh, p));
                // Checkerboard holes in one corner: bow-ties everywhere.
                if x < 0.2 && y < 0.2 && (i + j) % 2 == 0 {
                    continue;
                }
                mesh.triangles.extend([[v[0], v[1], v[2]], [v[0], v[2], v[3]]]);
            }
        }
    }
    let mut random = fastrand::Rng::with_seed(3);
    for _ in 0..50 {
        let t = mesh.triangles[random.usize(..mesh.triangles.len())];
        mesh.triangles.push(t);
    }
    for k in 0..200 {
        let base: [f64; 3] = std::array::from_fn(|_| random.f64());
        let v = [[0.0, 0.0, 0.0], [s, 0.0, 0.0], [0.0, s, 0.0], [0.0, 0.0, s]].map(|d| {
            let p = std::array::from_fn(|i| base[i] + d[i] + 1e-4 * f64::from(k));
            vertex(&mut mesh, p)
        });
        mesh.triangles.extend([[v[0], v[2], v[1]], [v[0], v[1], v[3]]]);
        if k % 2 == 0 {
            mesh.triangles.extend([[v[1], v[2], v[3]], [v[0], v[3], v[2]]]);
        }
    }
    mesh
}

pub(crate) fn build(raw: RawMesh, threads: usize) -> Vec<u8> {
    let options = BuildOptions { threads, title: "test".into(), ..BuildOptions::default() };
    build_pack(raw, &options, &Silent).expect("builds").bytes
}

/// A whole decoded pack.
pub(crate) struct Opened {
    pub(crate) entries: Vec<DirectoryEntry>,
    pub(crate) chunks: Vec<Chunk>,
    pub(crate) step: f64,
    pub(crate) triangles: u64,
    pub(crate) border_edges: u64,
}

pub(crate) fn open(bytes: &[u8]) -> Opened {
    let pack = Reader::open(SliceSource(bytes)).expect("opens");
    let chunks = (0..pack.entries().len() as u32).map(|i| pack.chunk(i).expect("decodes")).collect();
    Opened {
        entries: pack.entries().to_vec(),
        chunks,
        step: pack.header().lattice.step(),
        triangles: pack.header().triangles,
        border_edges: pack.metadata().border_edges,
    }
}

/// The triangles of a cut: corner positions and border bits.
pub(crate) fn drawn(pack: &Opened, cut: &Cut) -> Vec<([LatticePoint; 3], u8)> {
    let mut out = Vec::new();
    for i in cut.refined() {
        let chunk = &pack.chunks[i as usize];
        for patch in cut.drawn(&chunk.patches) {
            for t in patch.first..patch.first + patch.count {
                out.push((chunk.mesh.corners(t as usize), chunk.mesh.borders[t as usize]));
            }
        }
    }
    out
}

/// The mesh with its vertices and triangles in another order.
pub(crate) fn shuffled(mesh: &RawMesh, seed: u64) -> RawMesh {
    let mut out = mesh.clone();
    let mut random = fastrand::Rng::with_seed(seed);
    let n = mesh.positions.len();
    let mut new_of_old: Vec<u32> = (0..n as u32).collect();
    for i in (1..n).rev() {
        new_of_old.swap(i, random.usize(..=i));
    }
    for (old, new) in new_of_old.iter().enumerate() {
        out.positions[*new as usize] = mesh.positions[old];
        if !mesh.colors.is_empty() {
            out.colors[*new as usize] = mesh.colors[old];
        }
    }
    out.triangles.iter_mut().for_each(|t| *t = t.map(|v| new_of_old[v as usize]));
    for i in (1..out.triangles.len()).rev() {
        out.triangles.swap(i, random.usize(..=i));
    }
    out
}

/// Asks to stop at a given update of the progress.
pub(crate) struct StopAt<'a> {
    stop: &'a Stop,
    left: AtomicU64,
}

impl<'a> StopAt<'a> {
    /// At update `number`, counted from 1.
    pub(crate) fn new(stop: &'a Stop, number: u64) -> Self {
        Self { stop, left: AtomicU64::new(number) }
    }
}

impl Progress for StopAt<'_> {
    fn update(&self, _stage: &'static str, _done: u64, _total: u64) {
        if self.left.fetch_sub(1, Ordering::Relaxed) == 1 {
            self.stop.ask();
        }
    }
}
