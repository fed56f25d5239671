//! Where the camera is, in lattice units, and how many pixels an error takes up there.

use glam::DVec3;
use kilwa_geometry::Sphere;
use kilwa_geometry::clip::Clip;

/// Weight of what lies outside the view: loaded ten times coarser, so that a turn of the head meets something.
pub const OFF_SCREEN_WEIGHT: f64 = 0.1;

/// How the view volume meets the picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Projection {
    /// A pinhole; the tangent of half the vertical opening angle.
    Perspective {
        /// Tangent of half the vertical angle.
        tan_half_height: f64,
    },
    /// Parallel rays.
    Orthographic {
        /// Half the height of the picture, in lattice units.
        half_height: f64,
    },
}

/// A camera. Lengths are in lattice units, the axes are orthogonal unit vectors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct View {
    /// The eye; for parallel projection the centre of the plane that depth is counted from.
    pub eye: DVec3,
    /// To the right of the picture.
    pub right: DVec3,
    /// To the top of the picture.
    pub up: DVec3,
    /// Into the picture.
    pub forward: DVec3,
    /// A point near what is looked at, from which the renderer counts positions (the eye, in perspective).
    pub anchor: DVec3,
    /// The projection.
    pub projection: Projection,
    /// Width and height in pixels.
    pub size: [u32; 2],
    /// Nothing nearer than this depth is drawn.
    pub near: f64,
    /// Nothing farther than this depth is drawn; only for parallel projection (perspective reaches to infinity).
    pub far: f64,
    /// The pixel error to refine to.
    pub target_pixels: f64,
    /// What is cut away: a ball that lies in it wholly cannot be seen, and is not loaded.
    pub clip: Clip,
}

impl View {
    /// Width over height.
    pub fn aspect(&self) -> f64 {
        f64::from(self.size[0].max(1)) / f64::from(self.size[1].max(1))
    }

    /// Right, up and forward coordinates of a point, from the eye.
    pub fn in_view(&self, p: DVec3) -> DVec3 {
        let d = p - self.eye;
        DVec3::new(d.dot(self.right), d.dot(self.up), d.dot(self.forward))
    }

    /// Whether a ball may touch what is seen: the view volume, without what is cut away (never wrongly `false`).
    pub fn may_see(&self, sphere: &Sphere) -> bool {
        if sphere.radius < 0.0 {
            return false;
        }
        let DVec3 { x, y, z } = self.in_view(sphere.center);
        let r = sphere.radius * (1.0 + 1e-9);
        if z + r < self.near || self.clip.removes(sphere) {
            return false;
        }
        match self.projection {
            Projection::Perspective { tan_half_height } => {
                let side = |c: f64, t: f64| c.abs() - t * z <= r * libm::sqrt(1.0 + t * t);
                side(x, tan_half_height * self.aspect()) && side(y, tan_half_height)
            }
            Projection::Orthographic { half_height } => {
                z - r <= self.far && x.abs() - r <= half_height * self.aspect() && y.abs() - r <= half_height
            }
        }
    }

    /// Pixels that a displacement of `error` (lattice units) takes up at most, anywhere in the ball that the view
    /// can show: `error / distance × pixels per radian`, at the nearest point of the ball, times `1 / cos²` of the
    /// largest angle off the axis. Monotone: a ball inside another one never gets more.
    pub fn pixel_error(&self, sphere: &Sphere, error: f64) -> f64 {
        if error <= 0.0 {
            return 0.0;
        }
        let half_pixels = f64::from(self.size[1].max(1)) * 0.5;
        match self.projection {
            Projection::Orthographic { half_height } => error * half_pixels / half_height,
            Projection::Perspective { tan_half_height } => {
                let focal = half_pixels / tan_half_height;
                let center = self.in_view(sphere.center);
                let distance = center.length();
                let nearest = (distance - sphere.radius).max(self.near);
                let cos = self.smallest_cosine(center, distance, sphere.radius, tan_half_height);
                error * focal / (nearest * cos * cos)
            }
        }
    }

    /// Cosine of the largest angle off the axis that the ball reaches, no larger than the angle of the corners.
    fn smallest_cosine(&self, DVec3 { x, y, z }: DVec3, distance: f64, radius: f64, tan_half_height: f64) -> f64 {
        let tan_width = tan_half_height * self.aspect();
        let corner = 1.0 / libm::sqrt(1.0 + tan_half_height * tan_half_height + tan_width * tan_width);
        if distance <= radius {
            return corner;
        }
        let (cos_axis, sin_axis) = (z / distance, libm::sqrt(x * x + y * y) / distance);
        let sin_ball = radius / distance;
        let cos_ball = libm::sqrt((1.0 - sin_ball * sin_ball).max(0.0));
        if sin_axis * cos_ball + cos_axis * sin_ball < 0.0 {
            return corner; // The ball reaches round to the point straight behind the eye.
        }
        (cos_axis * cos_ball - sin_axis * sin_ball).max(corner)
    }

    /// [`View::pixel_error`], weighted down where the ball cannot be seen, and 0 where it is cut away: what decides what is loaded
    /// first, or at all.
    pub fn priority(&self, sphere: &Sphere, error: f64) -> f64 {
        if self.clip.removes(sphere) {
            return 0.0;
        }
        self.pixel_error(sphere, error) * if self.may_see(sphere) { 1.0 } else { OFF_SCREEN_WEIGHT }
    }
}

#[cfg(test)]
impl View {
    /// A view to the north from a place on the x axis.
    pub(crate) fn north_from(x: f64) -> Self {
        Self {
            eye: DVec3::new(x, 0.0, 0.0),
            right: DVec3::X,
            up: DVec3::Z,
            forward: DVec3::Y,
            anchor: DVec3::new(x, 0.0, 0.0),
            projection: Projection::Perspective { tan_half_height: 0.5 },
            size: [800, 600],
            near: 1.0,
            far: f64::INFINITY,
            target_pixels: 1.0,
            clip: Clip::default(),
        }
    }
}
