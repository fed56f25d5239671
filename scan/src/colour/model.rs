//! The model as photographs see it: the chunks of a pack, decoded once and kept while there is room.

use crate::ScanError;
use glam::{DMat3, DVec3, Vec3};
use kilwa_geometry::{LatticePoint, normal};
use kilwa_pack::{DirectoryEntry, PatchRange, Reader, Source};
use kilwa_scan_core::PosedCamera;
use kilwa_scan_core::raster::{Raster, Value, Window};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// A decoded chunk, in metres.
#[derive(Debug)]
pub struct Part {
    /// The corner of its box.
    pub origin: DVec3,
    /// Vertices relative to it.
    pub positions: Vec<Vec3>,
    /// Unit normals.
    pub normals: Vec<Vec3>,
    /// sRGB, one per vertex; empty if the model has no colours.
    pub colors: Vec<[u8; 3]>,
    triangles: Vec<[u32; 3]>,
    patches: Vec<PatchRange>,
}

impl Part {
    /// Its patches, in order.
    pub fn patches(&self) -> &[PatchRange] {
        &self.patches
    }

    /// The triangles of a patch, as numbers of vertices.
    pub fn triangles_of(&self, patch: &PatchRange) -> &[[u32; 3]] {
        self.triangles.get(patch.first as usize..(patch.first + patch.count) as usize).unwrap_or_default()
    }

    fn bytes(&self) -> usize {
        let vertex = 2 * size_of::<Vec3>() + 3;
        self.positions.len() * vertex + self.triangles.len() * 12 + self.patches.len() * size_of::<PatchRange>()
    }
}

/// A pack with a cache of decoded chunks, for drawing it many times.
pub struct Model<'r, S> {
    reader: &'r Reader<S>,
    parts: Mutex<Parts>,
    /// Bytes that decoded chunks may take.
    room: usize,
}

/// Decoded chunks, and when each was last used.
#[derive(Default)]
struct Parts {
    known: HashMap<u32, (Arc<Part>, u64)>,
    bytes: usize,
    clock: u64,
}

impl<'r, S: Source + Sync> Model<'r, S> {
    /// The model of a pack; decoded chunks take about `room` bytes.
    pub fn new(reader: &'r Reader<S>, room: u64) -> Self {
        Self { reader, parts: Mutex::default(), room: usize::try_from(room).unwrap_or(usize::MAX) }
    }

    /// The pack.
    pub fn reader(&self) -> &'r Reader<S> {
        self.reader
    }

    /// A chunk.
    ///
    /// # Errors
    /// [`ScanError::Model`] if it is damaged.
    pub fn part(&self, number: u32) -> Result<Arc<Part>, ScanError> {
        {
            let mut parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
            parts.clock += 1;
            let now = parts.clock;
            if let Some((part, used)) = parts.known.get_mut(&number) {
                *used = now;
                return Ok(Arc::clone(part));
            }
        }
        // Two threads may decode the same chunk; that is cheaper than waiting for each other.
        let part = Arc::new(self.decoded(number)?);
        let mut parts = self.parts.lock().unwrap_or_else(PoisonError::into_inner);
        let now = parts.clock;
        if parts.known.insert(number, (Arc::clone(&part), now)).is_none() {
            parts.bytes += part.bytes();
        }
        if parts.bytes > self.room {
            parts.forget(self.room / 4 * 3);
        }
        Ok(part)
    }

    fn decoded(&self, number: u32) -> Result<Part, ScanError> {
        let mesh_and_patches = self.reader.chunk(number).map_err(|source| ScanError::Model { source })?;
        let mesh = mesh_and_patches.mesh;
        let lattice = &self.reader.header().lattice;
        let start = self.reader.entries().get(number as usize).map_or(LatticePoint::ZERO, |e| e.bounds.min);
        let step = lattice.step();
        let relative = |p: &LatticePoint| ((*p - start).as_dvec3() * step).as_vec3();
        Ok(Part {
            origin: lattice.world_from_lattice(start),
            positions: mesh.positions.iter().map(relative).collect(),
            normals: mesh.normals.iter().map(|n| normal::decode(*n).as_vec3()).collect(),
            colors: mesh.colors,
            triangles: mesh.triangles,
            patches: mesh_and_patches.patches,
        })
    }

    /// Draw what a window of a camera sees, from chunks whose error is at most `tolerance` of the window's pixels where they are seen. `value` gives
    /// the value of a vertex, by its number in its chunk.
    ///
    /// # Errors
    /// [`ScanError::Model`] if a chunk is damaged.
    pub fn draw<V: Value>(
        &self,
        camera: &PosedCamera,
        window: Window,
        tolerance: f64,
        value: impl Fn(&Part, usize) -> V,
    ) -> Result<Raster<V>, ScanError> {
        let sight = Sight::new(camera, window, tolerance);
        let entries = self.reader.entries();
        let lattice = &self.reader.header().lattice;
        let ball = |e: &DirectoryEntry| {
            let center = lattice.world_from_steps(e.sphere.center);
            (center, e.sphere.radius * lattice.step())
        };
        // Spheres and errors are saturated, so the parents of a refined entry are refined too.
        let is_refined: Vec<bool> = entries
            .iter()
            .enumerate()
            .map(|(i, e)| {
                let (center, radius) = ball(e);
                i == 0 || sight.needs(center, radius, f64::from(e.error))
            })
            .collect();
        let mut raster = Raster::new(window);
        let mut seen = Vec::new();
        for number in (0u32..).zip(&is_refined).filter(|(_, is)| **is).map(|(i, _)| i) {
            let part = self.part(number)?;
            let turned = sight.seen_from(part.origin);
            let turn = sight.rotation.as_mat3();
            seen.clear();
            seen.extend(part.positions.iter().map(|p| turn * *p + turned));
            let is_drawn = |patch: &&PatchRange| !is_refined.get(patch.diamond as usize).copied().unwrap_or(false);
            for patch in part.patches.iter().filter(is_drawn) {
                for triangle in part.triangles_of(patch) {
                    let corners = triangle.map(|k| seen[k as usize]);
                    raster.draw(corners, triangle.map(|k| value(&part, k as usize)));
                }
            }
        }
        Ok(raster)
    }
}

impl Parts {
    /// Evict the least recently used chunks until at most `to` bytes remain.
    fn forget(&mut self, to: usize) {
        let mut order: Vec<(u64, u32)> = self.known.iter().map(|(number, (_, used))| (*used, *number)).collect();
        order.sort_unstable();
        for (_, number) in order {
            if self.bytes <= to {
                break;
            }
            if let Some((part, _)) = self.known.remove(&number) {
                self.bytes -= part.bytes();
            }
        }
    }
}

/// Decides which bounding spheres a window sees, and which chunks it needs.
struct Sight {
    window: Window,
    /// To the axes of the window, from those of the world.
    rotation: DMat3,
    position: DVec3,
    /// Metres of error per metre of distance.
    per_metre: f64,
    camera_from_world: kilwa_scan_core::Pose,
}

impl Sight {
    fn new(camera: &PosedCamera, window: Window, tolerance: f64) -> Self {
        Self {
            rotation: window.window_from_camera * DMat3::from_quat(camera.camera_from_world.rotation),
            position: camera.position(),
            per_metre: tolerance / window.focal,
            camera_from_world: camera.camera_from_world,
            window,
        }
    }

    /// A point in the axes of the window, relative to the camera, so that `f32` suffices.
    fn seen_from(&self, point: DVec3) -> Vec3 {
        (self.rotation * (point - self.position)).as_vec3()
    }

    fn needs(&self, center: DVec3, radius: f64, error: f64) -> bool {
        let distance = (center.distance(self.position) - radius).max(0.0);
        error > self.per_metre * distance && self.window.may_show(self.camera_from_world.apply(center), radius)
    }
}
