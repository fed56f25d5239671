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
        Lens::new(self).may_see(sphere)
    }

    /// Pixels that a displacement of `error` (lattice units) takes up at most, anywhere in the ball that the view
    /// can show: `error / distance × pixels per radian`, at the nearest point of the ball, times `1 / cos²` of the
    /// largest angle off the axis. Monotone: a ball inside another one never gets more.
    pub fn pixel_error(&self, sphere: &Sphere, error: f64) -> f64 {
        Lens::new(self).pixel_error(self.in_view(sphere.center), sphere.radius, error)
    }

    /// [`View::pixel_error`], weighted down where the ball cannot be seen, and 0 where it is cut away: what decides what is loaded
    /// first, or at all.
    pub fn priority(&self, sphere: &Sphere, error: f64) -> f64 {
        Lens::new(self).look(sphere, error).priority
    }
}

/// What a view shows of a ball.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Look {
    /// [`View::may_see`].
    pub(crate) visible: bool,
    /// [`View::priority`]: where the ball is visible, its pixel error. Never NaN.
    pub(crate) priority: f64,
}

/// A view, and what looking at any ball needs: computed once, because every step looks at thousands of balls.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lens {
    pub(crate) view: View,
    is_clipped: bool,
    /// Half the width and half the height of the picture: tangents in perspective, lattice units in parallel projection.
    half: [f64; 2],
    /// 1 over the cosines of the half angles, for perspective.
    secant: [f64; 2],
    /// Pixels per radian, or per lattice unit.
    focal: f64,
    /// Cosine of the angle between the axis and a corner.
    corner: f64,
}

impl Lens {
    pub(crate) fn new(view: &View) -> Self {
        let half_pixels = f64::from(view.size[1].max(1)) * 0.5;
        let (Projection::Perspective { tan_half_height: height } | Projection::Orthographic { half_height: height }) =
            view.projection;
        let half = [height * view.aspect(), height];
        let [width, height] = half;
        Self {
            view: *view,
            is_clipped: view.clip.is_on(),
            half,
            secant: half.map(|t| libm::sqrt(1.0 + t * t)),
            focal: half_pixels / height,
            corner: 1.0 / libm::sqrt(1.0 + height * height + width * width),
        }
    }

    /// [`View::may_see`].
    pub(crate) fn may_see(&self, sphere: &Sphere) -> bool {
        !self.removes(sphere) && self.meets(self.view.in_view(sphere.center), sphere.radius)
    }

    /// Whether a ball can be seen, and its priority.
    pub(crate) fn look(&self, sphere: &Sphere, error: f64) -> Look {
        if self.removes(sphere) {
            return Look::default();
        }
        let center = self.view.in_view(sphere.center);
        let visible = self.meets(center, sphere.radius);
        let weight = if visible { 1.0 } else { OFF_SCREEN_WEIGHT };
        let priority = self.pixel_error(center, sphere.radius, error) * weight;
        Look { visible, priority: if priority.is_nan() { 0.0 } else { priority } }
    }

    fn removes(&self, sphere: &Sphere) -> bool {
        self.is_clipped && self.view.clip.removes(sphere)
    }

    /// Whether a ball touches the view volume. `center` counts from the eye.
    fn meets(&self, DVec3 { x, y, z }: DVec3, radius: f64) -> bool {
        let r = radius * (1.0 + 1e-9);
        if radius < 0.0 || z + r < self.view.near {
            return false;
        }
        let ([width, height], [by_width, by_height]) = (self.half, self.secant);
        match self.view.projection {
            Projection::Perspective { .. } => {
                x.abs() - width * z <= r * by_width && y.abs() - height * z <= r * by_height
            }
            Projection::Orthographic { .. } => z - r <= self.view.far && x.abs() - r <= width && y.abs() - r <= height,
        }
    }

    /// [`View::pixel_error`]. `center` counts from the eye.
    fn pixel_error(&self, center: DVec3, radius: f64, error: f64) -> f64 {
        if error <= 0.0 {
            return 0.0;
        }
        match self.view.projection {
            Projection::Orthographic { half_height } => {
                error * (f64::from(self.view.size[1].max(1)) * 0.5) / half_height
            }
            Projection::Perspective { .. } => {
                let distance = center.length();
                let nearest = (distance - radius).max(self.view.near);
                let cos = self.smallest_cosine(center, distance, radius);
                error * self.focal / (nearest * cos * cos)
            }
        }
    }

    /// Cosine of the largest angle off the axis that the ball reaches, no larger than the angle of the corners.
    fn smallest_cosine(&self, DVec3 { x, y, z }: DVec3, distance: f64, radius: f64) -> f64 {
        if distance <= radius {
            return self.corner;
        }
        let (cos_axis, sin_axis) = (z / distance, libm::sqrt(x * x + y * y) / distance);
        let sin_ball = radius / distance;
        let cos_ball = libm::sqrt((1.0 - sin_ball * sin_ball).max(0.0));
        if sin_axis * cos_ball + cos_axis * sin_ball < 0.0 {
            return self.corner; // The ball reaches round to the point straight behind the eye.
        }
        (cos_axis * cos_ball - sin_axis * sin_ball).max(self.corner)
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
