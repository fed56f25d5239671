//! What a photograph sees of the model: depth maps, which determine which vertices are visible and how near they are to occlusion boundaries.

use super::model::Model;
use crate::ScanError;
use glam::{DMat3, DVec3};
use kilwa_pack::Source;
use kilwa_scan_core::PosedCamera;
use kilwa_scan_core::raster::{Edges, Raster, Window, windows};

/// Pixels of the depth maps of a photograph, at most.
const MAX_PIXELS: u32 = 3_000_000;
/// Pixels of a depth map per pixel of the photograph, in each direction.
const SCALE: f64 = 1.0;
/// Error of the surface that is drawn, in pixels of the depth map.
const ERROR_PIXELS: f64 = 0.5;
/// A jump in depth is an edge where it exceeds this share of the depth.
const JUMP: f32 = 0.01;
/// The steepest slope, as a tangent, that the tolerance allows for.
const STEEPEST: f64 = 8.0;

/// The depth maps of a photograph.
pub struct View {
    camera: PosedCamera,
    position: DVec3,
    faces: Vec<Face>,
}

struct Face {
    window_from_world: DMat3,
    raster: Raster<()>,
    edges: Edges,
}

/// A vertex that a photograph sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// Cosine of the angle between its normal and the direction to the camera.
    pub facing: f64,
    /// Distance from the camera, metres.
    pub range: f64,
    /// Distance to the nearest occlusion boundary, as an angle in radians.
    pub clearance: f64,
}

impl View {
    /// Draw the depth maps.
    ///
    /// # Errors
    /// [`ScanError::Model`] if a chunk is damaged.
    pub fn new<S: Source + Sync>(model: &Model<'_, S>, camera: PosedCamera) -> Result<Self, ScanError> {
        let faces = windows(&camera.camera, SCALE, MAX_PIXELS).into_iter().map(|window| {
            let raster = model.draw(&camera, window, ERROR_PIXELS, |_, _| ())?;
            let edges = Edges::of(&raster, JUMP);
            let turn = DMat3::from_quat(camera.camera_from_world.rotation);
            Ok(Face { window_from_world: window.window_from_camera * turn, raster, edges })
        });
        Ok(Self { camera, position: camera.position(), faces: faces.collect::<Result<_, ScanError>>()? })
    }

    /// The camera.
    pub fn camera(&self) -> &PosedCamera {
        &self.camera
    }

    /// Whether any part of a sphere may be visible.
    pub fn may_show(&self, center: DVec3, radius: f64) -> bool {
        let at = self.camera.camera_from_world.apply(center);
        self.faces.iter().any(|face| face.raster.window().may_show(at, radius))
    }

    /// How the vertex at a place is seen. `error` is how far it may be from the surface, metres. None if it faces away, lies outside the picture, or is hidden.
    pub fn sighting(&self, place: DVec3, normal: DVec3, error: f64) -> Option<Sighting> {
        let offset = place - self.position;
        let range = offset.length();
        let facing = -normal.dot(offset) / range;
        if facing <= 0.0 || !facing.is_finite() {
            return None;
        }
        let (face, at, pixel) = self.faces.iter().find_map(|face| {
            let at = face.window_from_world * offset;
            Some((face, at, face.raster.window().project(at)?))
        })?;
        let Window { focal, .. } = *face.raster.window();
        let slope = ((1.0 - facing * facing).max(0.0).sqrt() / facing).min(STEEPEST);
        let texel = at.z / focal;
        let tolerance = error + texel * (ERROR_PIXELS + 1.5 * slope + 0.5);
        let [x, y] = [pixel.x as u32, pixel.y as u32];
        let from_edge = face.edges.distance(x, y);
        // Beside an edge, only the pixel itself tells: its neighbours show what lies behind.
        let depth = if from_edge < 1.0 { face.raster.depth(x, y) } else { face.raster.farthest_around(pixel) };
        if at.z > f64::from(depth) + tolerance {
            return None;
        }
        let clearance = f64::from(from_edge) / focal;
        Some(Sighting { facing, range, clearance })
    }
}
