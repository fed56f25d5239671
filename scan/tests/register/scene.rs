//! Scenes of boxes and vertical cylinders, and a simulated scanner: the true poses are known exactly, and the code is independent of the simulator of
//! `kilwa synth scans`, so that a mistake in one is not hidden by the same mistake in the other.

use crate::support::ptx_header;
use glam::{DQuat, DVec2, DVec3};
use kilwa_scan_core::Pose;
use std::f64::consts::TAU;
use std::fmt::Write as _;

/// Thickness of a wall, metres.
const THICK: f64 = 0.2;
/// Elevations of the lowest and the highest row, degrees.
const ELEVATIONS: [f64; 2] = [-60.0, 88.0];
/// Standard deviation of each of the two tilts that remain after levelling, degrees.
const TILT: f64 = 0.02;

/// A shape that stops rays.
#[derive(Debug, Clone, Copy)]
pub(super) enum Shape {
    /// A box, turned about the vertical by an angle in radians.
    Block { center: DVec3, half: DVec3, turn: f64 },
    /// A vertical cylinder with a closed top, seen from inside or outside.
    Cylinder { axis: DVec2, radius: f64, bottom: f64, top: f64 },
}

impl Shape {
    /// The distance at which a ray meets the shape; infinite if it misses.
    fn distance(&self, from: DVec3, along: DVec3) -> f64 {
        match *self {
            Self::Block { center, half, turn } => {
                let back = DVec2::from_angle(-turn);
                let local = |v: DVec3| back.rotate(v.truncate()).extend(v.z);
                let (from, along) = (local(from - center), local(along));
                let (mut enter, mut leave) = (0.0_f64, f64::INFINITY);
                for k in 0..3 {
                    let (a, b) = ((-half[k] - from[k]) / along[k], (half[k] - from[k]) / along[k]);
                    enter = enter.max(a.min(b));
                    leave = leave.min(a.max(b));
                }
                if enter > 0.0 && enter <= leave { enter } else { f64::INFINITY }
            }
            Self::Cylinder { axis, radius, bottom, top } => {
                let (p, d) = (from.truncate() - axis, along.truncate());
                let (a, b, c) = (d.length_squared(), p.dot(d), p.length_squared() - radius * radius);
                let root = (b * b - a * c).sqrt();
                let is_hit = |t: f64| t > 1e-9 && (bottom..=top).contains(&(from.z + t * along.z));
                let side = [(-b - root) / a, (-b + root) / a].into_iter().find(|t| is_hit(*t));
                let lid = (top - from.z) / along.z;
                let lid = (lid > 1e-9 && (p + d * lid).length() <= radius).then_some(lid);
                side.unwrap_or(f64::INFINITY).min(lid.unwrap_or(f64::INFINITY))
            }
        }
    }
}

/// An opening in a wall: from its start, metres.
#[derive(Debug, Clone, Copy)]
pub(super) struct Opening {
    pub(super) from: f64,
    pub(super) to: f64,
    pub(super) bottom: f64,
    pub(super) top: f64,
}

/// A doorway between two places along a wall.
pub(super) fn door(from: f64, to: f64) -> Opening {
    Opening { from, to, bottom: 0.0, top: 2.1 }
}

/// A window between two places along a wall.
pub(super) fn window(from: f64, to: f64) -> Opening {
    Opening { from, to, bottom: 0.9, top: 2.0 }
}

/// What a scanner may see.
#[derive(Debug, Clone, Default)]
pub(super) struct Scene(pub(super) Vec<Shape>);

impl Scene {
    /// An upright box on a rectangle in plan, between two heights.
    pub(super) fn block(&mut self, min: [f64; 3], max: [f64; 3]) -> &mut Self {
        let (min, max) = (DVec3::from_array(min), DVec3::from_array(max));
        self.0.push(Shape::Block { center: (min + max) / 2.0, half: (max - min) / 2.0, turn: 0.0 });
        self
    }

    /// A piece of furniture on the floor at `z` = 0: its middle in plan, its length, width and height, turned by some degrees.
    pub(super) fn furniture(&mut self, at: [f64; 2], size: [f64; 3], degrees: f64) -> &mut Self {
        let half = DVec3::from_array(size) / 2.0;
        let center = DVec2::from_array(at).extend(half.z);
        self.0.push(Shape::Block { center, half, turn: degrees.to_radians() });
        self
    }

    /// A column, a barrel or a person on the floor.
    pub(super) fn column(&mut self, at: [f64; 2], radius: f64, top: f64) -> &mut Self {
        self.0.push(Shape::Cylinder { axis: DVec2::from_array(at), radius, bottom: 0.0, top });
        self
    }

    /// A large ground plane.
    pub(super) fn ground(&mut self) -> &mut Self {
        self.block([-200.0, -200.0, -1.0], [200.0, 200.0, 0.0])
    }

    /// A wall between two places in plan, along x or y, with openings.
    pub(super) fn wall(&mut self, from: [f64; 2], to: [f64; 2], height: f64, openings: &[Opening]) -> &mut Self {
        let (from, to) = (DVec2::from_array(from), DVec2::from_array(to));
        let (length, along) = (from.distance(to), (to - from).normalize());
        let mut piece = |a: f64, b: f64, bottom: f64, top: f64| {
            if b > a && top > bottom {
                let middle = (from + along * (a + b) / 2.0).extend(f64::midpoint(bottom, top));
                let half = DVec3::new((b - a) / 2.0, THICK / 2.0, (top - bottom) / 2.0);
                self.0.push(Shape::Block { center: middle, half, turn: along.to_angle() });
            }
        };
        // Walls meet in corners without gaps.
        let mut done = -THICK / 2.0;
        for opening in openings {
            piece(done, opening.from, 0.0, height);
            piece(opening.from, opening.to, 0.0, opening.bottom);
            piece(opening.from, opening.to, opening.top, height);
            done = opening.to;
        }
        piece(done, length + THICK / 2.0, 0.0, height);
        self
    }

    /// The same scene rotated about a point by some degrees and moved.
    pub(super) fn moved(&self, about: [f64; 2], degrees: f64, by: [f64; 2]) -> Self {
        let (about, by, turn) = (DVec2::from_array(about), DVec2::from_array(by), degrees.to_radians());
        let at = |p: DVec2| DVec2::from_angle(turn).rotate(p - about) + about + by;
        let shape = |shape: &Shape| match *shape {
            Shape::Block { center, half, turn: own } => {
                Shape::Block { center: at(center.truncate()).extend(center.z), half, turn: own + turn }
            }
            Shape::Cylinder { axis, radius, bottom, top } => Shape::Cylinder { axis: at(axis), radius, bottom, top },
        };
        Self(self.0.iter().map(shape).collect())
    }

    /// Both scenes.
    pub(super) fn and(&self, other: &Self) -> Self {
        Self(self.0.iter().chain(&other.0).copied().collect())
    }

    /// How far a ray goes.
    fn distance(&self, from: DVec3, along: DVec3) -> f64 {
        self.0.iter().map(|shape| shape.distance(from, along)).fold(f64::INFINITY, f64::min)
    }
}

/// A scanner, and how it records its grid.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scanner {
    pub(super) columns: u32,
    pub(super) rows: u32,
    /// Standard deviation of a range, metres.
    pub(super) noise: f64,
    pub(super) max_range: f64,
    /// Share of the rays without a return.
    pub(super) dropouts: f64,
    /// Columns from right to left and rows from the zenith downwards, as other manufacturers record them.
    pub(super) is_reversed: bool,
}

impl Default for Scanner {
    fn default() -> Self {
        Self { columns: 360, rows: 150, noise: 0.0015, max_range: 80.0, dropouts: 0.003, is_reversed: false }
    }
}

impl Scanner {
    /// The direction of a cell in the frame of the scanner.
    fn ray(&self, column: u32, row: u32) -> DVec3 {
        let (column, row) =
            if self.is_reversed { (self.columns - 1 - column, self.rows - 1 - row) } else { (column, row) };
        let turn = f64::from(column) / f64::from(self.columns) * TAU;
        let [lowest, highest] = ELEVATIONS;
        let up = (lowest + (highest - lowest) * f64::from(row) / f64::from(self.rows - 1)).to_radians();
        (DVec2::from_angle(turn) * up.cos()).extend(up.sin())
    }

    /// A scan as PTX with the identity as its pose, and the true pose: the given position with a random heading and tilt.
    pub(super) fn scan(&self, scene: &Scene, at: [f64; 3], seed: u64) -> (String, Pose) {
        let mut random = fastrand::Rng::with_seed(seed);
        let tilt = [normal(&mut random), normal(&mut random)].map(|n| (n * TILT).to_radians());
        let heading = DQuat::from_rotation_z(random.f64() * TAU);
        let rotation = heading * DQuat::from_rotation_x(tilt[0]) * DQuat::from_rotation_y(tilt[1]);
        let pose = Pose { rotation, translation: DVec3::from_array(at) };
        let mut text = ptx_header(self.columns, self.rows, [0.0; 3]);
        for column in 0..self.columns {
            for row in 0..self.rows {
                let ray = self.ray(column, row);
                let range = scene.distance(pose.translation, rotation * ray);
                // Both are drawn for every ray, so that what one ray meets does not change the noise of the others.
                let (noise, is_lost) = (normal(&mut random) * self.noise, random.f64() < self.dropouts);
                if range > self.max_range || is_lost {
                    text.push_str("0 0 0 0\n");
                } else {
                    let p = ray * (range + noise);
                    writeln!(text, "{:.6} {:.6} {:.6} 0.5", p.x, p.y, p.z).unwrap();
                }
            }
        }
        (text, pose)
    }

    /// The share of the samples of a scan from one place that are seen from another.
    pub(super) fn overlap(&self, scene: &Scene, at: [f64; 3], other: [f64; 3]) -> f64 {
        let (at, other) = (DVec3::from_array(at), DVec3::from_array(other));
        let (mut all, mut common) = (0_u32, 0_u32);
        for column in (0..self.columns).step_by(3) {
            for row in (0..self.rows).step_by(3) {
                let ray = self.ray(column, row);
                let range = scene.distance(at, ray);
                if range <= self.max_range {
                    let way = at + ray * range - other;
                    let free = scene.distance(other, way.normalize());
                    all += 1;
                    common += u32::from(way.length() <= self.max_range && free > way.length() - 0.01);
                }
            }
        }
        f64::from(common) / f64::from(all.max(1))
    }
}

/// A normally distributed number (Box and Muller).
pub(super) fn normal(random: &mut fastrand::Rng) -> f64 {
    let (u, v) = (1.0 - random.f64(), random.f64());
    (-2.0 * u.ln()).sqrt() * (TAU * v).cos()
}

#[test]
fn rays_meet_the_nearest_surface() {
    let mut scene = Scene::default();
    scene.ground().wall([5.0, -3.0], [5.0, 3.0], 2.7, &[door(2.5, 3.5)]).column([-4.0, 0.0], 0.5, 2.0);
    scene.furniture([0.0, 3.0], [2.0, 1.0, 1.0], 90.0);
    let eye = DVec3::new(0.0, 0.0, 1.5);
    let near = |along: DVec3, expected: f64| {
        let found = scene.distance(eye, along.normalize());
        assert!((found - expected).abs() < 1e-9, "{along}: {found}, expected {expected}");
    };
    near(-DVec3::Z, 1.5);
    near(DVec3::NEG_X, 3.5);
    // Above the lintel, beside the door, and through it.
    near(DVec3::new(4.9, 0.0, 1.0), 4.9_f64.hypot(1.0));
    near(DVec3::new(4.9, 0.6, 0.0), 4.9_f64.hypot(0.6));
    assert!(scene.distance(eye, DVec3::X).is_infinite());
    // The end of the furniture after its quarter turn, at half of its height.
    near(DVec3::new(0.0, 2.0, -1.0), 5_f64.sqrt());
    // Onto the lid of a column from above.
    let above = DVec3::new(-4.0, 0.2, 5.0);
    assert!((scene.distance(above, -DVec3::Z) - 3.0).abs() < 1e-9);
    // From within a cylinder.
    let within = DVec3::new(-4.2, 0.0, 1.0);
    assert!((scene.distance(within, DVec3::X) - 0.7).abs() < 1e-9);
}
