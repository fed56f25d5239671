//! The pieces that triangles of stations are cut into.

use super::SUB_LOG2;
use glam::{DVec3, IVec3};

/// A corner of a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Where, voxels.
    pub position: DVec3,
    /// sRGB, where there is one.
    pub color: Option<[u8; 3]>,
    /// Up to [`INTENSITY_MAX`], if known.
    pub intensity: Option<f32>,
    /// The inverse variance of its position across the surface, 1/voxel².
    pub quality: f64,
}

/// Fixed-point scale of intensities: 2^14 is 1.
pub const INTENSITY_LOG2: u32 = 14;
/// Largest intensity that a piece can have; counts of 16 bits are smaller.
pub const INTENSITY_MAX: f32 = 100_000.0;

/// Bytes of a piece in a file.
pub const PIECE_BYTES: usize = 32;

/// A planar spot of a surface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Piece {
    /// Its middle, in 1/2^[`SUB_LOG2`] voxel.
    pub at: IVec3,
    /// Its unit normal towards the scanner, times [`Self::NORMAL_ONE`].
    pub normal: [i16; 3],
    /// Its area in 1/[`Self::AREA_ONE`] square voxel.
    pub area: u16,
    /// Area times quality.
    pub weight: u32,
    /// sRGB; black where there is none.
    pub color: [u8; 3],
    /// Whether there is a colour (bit 0) and an intensity (bit 1).
    pub has: u8,
    /// In 1/2^[`INTENSITY_LOG2`].
    pub intensity: i32,
}

impl Piece {
    /// Fixed-point scale of normals.
    pub const NORMAL_ONE: i32 = 1 << 14;
    /// Fixed-point scale of areas: one square voxel.
    pub const AREA_ONE: f64 = 16384.0;
    /// The weight of one square voxel at the best quality.
    pub const WEIGHT_ONE: f64 = 1_048_576.0;
    pub(super) const HAS_COLOR: u8 = 1;
    pub(super) const HAS_INTENSITY: u8 = 2;

    /// Its middle, voxels.
    pub fn position(&self) -> DVec3 {
        self.at.as_dvec3() / f64::from(1 << SUB_LOG2)
    }

    /// As bytes.
    pub fn to_bytes(&self) -> [u8; PIECE_BYTES] {
        let mut bytes = [0; PIECE_BYTES];
        for (axis, v) in self.at.to_array().into_iter().enumerate() {
            bytes[4 * axis..4 * axis + 4].copy_from_slice(&v.to_le_bytes());
        }
        for (axis, v) in self.normal.into_iter().enumerate() {
            bytes[12 + 2 * axis..14 + 2 * axis].copy_from_slice(&v.to_le_bytes());
        }
        bytes[18..20].copy_from_slice(&self.area.to_le_bytes());
        bytes[20..24].copy_from_slice(&self.weight.to_le_bytes());
        bytes[24..27].copy_from_slice(&self.color);
        bytes[27] = self.has;
        bytes[28..32].copy_from_slice(&self.intensity.to_le_bytes());
        bytes
    }

    /// From the bytes.
    pub fn from_bytes(bytes: &[u8; PIECE_BYTES]) -> Self {
        let int = |at: usize| i32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]]);
        let short = |at: usize| u16::from_le_bytes([bytes[at], bytes[at + 1]]);
        Self {
            at: IVec3::new(int(0), int(4), int(8)),
            normal: [12, 14, 16].map(|at| short(at).cast_signed()),
            area: short(18),
            weight: int(20).cast_unsigned(),
            color: [bytes[24], bytes[25], bytes[26]],
            has: bytes[27],
            intensity: int(28),
        }
    }
}

/// Cut a triangle, counterclockwise seen from the scanner, into pieces. `best` is the quality of weight one, 1/voxel²: better ones get no greater weight.
///
/// Of a large triangle, only the part in the box from `least` to `greatest`, voxels, is cut, about.
///
/// A triangle without an edge longer than a voxel is one piece. Of a larger one a piece is taken at every point of a regular grid in the two axes that it is
/// seen along best, so that neighbouring triangles share the grid and the area is right on average.
pub fn pieces(corners: &[Corner; 3], best: f64, [least, greatest]: [DVec3; 2], emit: &mut dyn FnMut(Piece)) {
    let [a, b, c] = corners.map(|corner| corner.position);
    let across = (b - a).cross(c - a);
    let double = across.length();
    let Some(normal) = across.try_normalize() else { return };
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared()).sqrt();
    let triangle = Triangle { corners, normal, best, double };
    if longest <= 1.0 {
        emit(triangle.piece([1.0 / 3.0; 3], double / 2.0));
        return;
    }
    let step = step(longest);
    let axis = (0..3).max_by(|i, j| normal[*i].abs().total_cmp(&normal[*j].abs())).unwrap_or(2);
    let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
    let area = step * step / normal[axis].abs();
    let doubled = (b[u] - a[u]) * (c[v] - a[v]) - (b[v] - a[v]) * (c[u] - a[u]);
    let (low, high) = (a.min(b).min(c).max(least), a.max(b).max(c).min(greatest));
    let from = |x: f64| (x / step - 0.25).ceil() as i64;
    for i in from(low[u])..=from(high[u]) {
        for j in from(low[v])..=from(high[v]) {
            let (x, y) = ((i as f64 + 0.25) * step, (j as f64 + 0.25) * step);
            let share = |p: DVec3, q: DVec3| ((p[u] - x) * (q[v] - y) - (p[v] - y) * (q[u] - x)) / doubled;
            let shares = [share(b, c), share(c, a), share(a, b)];
            if shares.iter().all(|s| *s >= 0.0) {
                emit(triangle.piece(shares, area));
            }
        }
    }
}

/// The mean number of pieces that a triangle (corners in voxels) is cut into, averaged over its position relative to the grid; at most as many as its part in the box
/// from `least` to `greatest` can have.
pub fn expected_pieces([a, b, c]: [DVec3; 3], [least, greatest]: [DVec3; 2]) -> f64 {
    let across = (b - a).cross(c - a);
    let longest = (b - a).length_squared().max((c - b).length_squared()).max((a - c).length_squared()).sqrt();
    if longest <= 1.0 {
        return f64::from(across != DVec3::ZERO);
    }
    let step = step(longest);
    let axis = (0..3).max_by(|i, j| across[*i].abs().total_cmp(&across[*j].abs())).unwrap_or(2);
    let inside = (a.max(b).max(c).min(greatest) - a.min(b).min(c).max(least)).max(DVec3::ZERO);
    // At most the part of its box that lies in the other.
    let limit = inside[(axis + 1) % 3] * inside[(axis + 2) % 3];
    (across[axis].abs() / 2.0).min(limit) / (step * step)
}

/// The spacing of the grid for the pieces of a triangle whose longest edge is this long, voxels.
fn step(longest: f64) -> f64 {
    if longest <= 3.0 { 0.5 } else { 1.0 }
}

struct Triangle<'a> {
    corners: &'a [Corner; 3],
    normal: DVec3,
    best: f64,
    /// Twice its area.
    double: f64,
}

impl Triangle<'_> {
    fn piece(&self, shares: [f64; 3], area: f64) -> Piece {
        let mixed =
            |of: &dyn Fn(&Corner) -> f64| -> f64 { self.corners.iter().zip(shares).map(|(c, s)| of(c) * s).sum() };
        let at = DVec3::new(mixed(&|c| c.position.x), mixed(&|c| c.position.y), mixed(&|c| c.position.z));
        // Between samples, the uncertainty of the surface grows with their spacing.
        let variance = 1.0 / mixed(&|c| c.quality).max(1e-12) + self.double * SPACING;
        let quality = (1.0 / (variance * self.best)).min(1.0);
        let is_colored = self.corners.iter().all(|c| c.color.is_some());
        let is_bright = self.corners.iter().all(|c| c.intensity.is_some());
        let channel = |k: usize| mixed(&|c| f64::from(c.color.unwrap_or_default()[k])).round().clamp(0.0, 255.0) as u8;
        let intensity = mixed(&|c| f64::from(c.intensity.unwrap_or_default()));
        Piece {
            at: (at * f64::from(1 << SUB_LOG2)).round().as_ivec3(),
            normal: self.normal.to_array().map(|n| (n * f64::from(Piece::NORMAL_ONE)).round() as i16),
            area: (area * Piece::AREA_ONE).round().clamp(1.0, f64::from(u16::MAX)) as u16,
            weight: (area * quality * Piece::WEIGHT_ONE).round().clamp(1.0, Piece::WEIGHT_ONE * 2.0) as u32,
            color: if is_colored { [channel(0), channel(1), channel(2)] } else { [0; 3] },
            has: if is_colored { Piece::HAS_COLOR } else { 0 } | if is_bright { Piece::HAS_INTENSITY } else { 0 },
            intensity: (intensity * f64::from(1 << INTENSITY_LOG2)).round() as i32,
        }
    }
}

/// The variance of the surface between samples, as a share of the square of their distance.
const SPACING: f64 = 0.25;
