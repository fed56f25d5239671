//! A camera: it looks at a target from an azimuth and an elevation. On the turntable up stays up; turned freely it may
//! roll as well; inside a room it looks about from where the eye stands.
//!
//! World metres, z up, north +y, east +x, all in f64. Pure: input is turned into moves here, and tested here.

use glam::{BVec3, DVec3};
use kilwa_geometry::Lattice;
use kilwa_measure::sheet::Part;
use kilwa_stream::{Clip, Projection, View};

/// A box in world metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Smallest corner.
    pub min: DVec3,
    /// Largest corner.
    pub max: DVec3,
}

impl Bounds {
    /// The middle.
    pub fn center(&self) -> DVec3 {
        (self.min + self.max) * 0.5
    }

    /// Radius of the ball round the box; never 0.
    pub fn radius(&self) -> f64 {
        let half = (self.max - self.min) * 0.5;
        half.length().max(1e-6)
    }

    /// All eight corners.
    pub fn corners(&self) -> [DVec3; 8] {
        [0, 1, 2, 3, 4, 5, 6, 7]
            .map(|k| DVec3::select(BVec3::new(k & 1 == 0, k & 2 == 0, k & 4 == 0), self.min, self.max))
    }
}

/// The views that a survey drawing has, and a first impression.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StandardView {
    /// From above, north up.
    Plan,
    /// The north face, from the north.
    North,
    /// The east face, from the east.
    East,
    /// The south face, from the south.
    South,
    /// The west face, from the west.
    West,
    /// From the south-west and above, in perspective.
    Iso,
}

impl StandardView {
    /// All of them with the names of the command line and the page.
    pub const ALL: [(Self, &'static str); 6] = [
        (Self::Plan, "plan"),
        (Self::North, "north"),
        (Self::East, "east"),
        (Self::South, "south"),
        (Self::West, "west"),
        (Self::Iso, "iso"),
    ];

    /// The view of a name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.iter().find(|(_, n)| *n == name).map(|(view, _)| *view)
    }
}

/// A camera that looks at a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    /// The point that it turns round, world metres.
    pub target: DVec3,
    /// Where the eye stands, seen from the target: radians from north, clockwise (east is π/2).
    pub azimuth: f64,
    /// How high the eye stands, radians, −π/2 to π/2.
    pub elevation: f64,
    /// Metres from the eye to the target. For parallel projection it gives the scale.
    pub distance: f64,
    /// Vertical opening angle, radians.
    pub field_of_view: f64,
    /// Parallel projection instead of perspective. The scale at the target stays the same.
    pub orthographic: bool,
    /// Radians that the picture's top leans to the left of straight up; 0 on the turntable.
    pub roll: f64,
}

/// Half a right angle of vertical view: close to what a surveyor's photograph shows.
pub const DEFAULT_FIELD_OF_VIEW: f64 = 0.7;
/// The eye never stands farther or nearer than these multiples of the model's radius.
const DISTANCE_RANGE: (f64, f64) = (1e-5, 50.0);
const QUARTER: f64 = std::f64::consts::FRAC_PI_2;

/// Pixels at the edges of a picture that something else covers.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Edges {
    /// From the left edge.
    pub left: f64,
    /// From the upper edge.
    pub top: f64,
    /// From the right edge.
    pub right: f64,
    /// From the lower edge.
    pub bottom: f64,
}

/// Two edges of an extent: at least half of it stays free.
fn kept(edges: [f64; 2], extent: f64) -> [f64; 2] {
    let edges = edges.map(|x| if x.is_finite() { x.max(0.0) } else { 0.0 });
    let most = (extent * 0.5 / (edges[0] + edges[1]).max(1e-9)).min(1.0);
    edges.map(|x| x * most)
}

impl Camera {
    /// A camera that shows all of `bounds` in a picture of `size` pixels.
    pub fn standard(view: StandardView, bounds: &Bounds, size: [u32; 2]) -> Self {
        let (azimuth, elevation) = match view {
            StandardView::Plan => (2.0 * QUARTER, QUARTER),
            StandardView::North => (0.0, 0.0),
            StandardView::East => (QUARTER, 0.0),
            StandardView::South => (2.0 * QUARTER, 0.0),
            StandardView::West => (3.0 * QUARTER, 0.0),
            StandardView::Iso => (2.5 * QUARTER, 0.55),
        };
        let mut camera = Self {
            target: bounds.center(),
            azimuth,
            elevation,
            distance: 1.0,
            field_of_view: DEFAULT_FIELD_OF_VIEW,
            orthographic: view != StandardView::Iso,
            roll: 0.0,
        };
        camera.fit(bounds, size);
        camera
    }

    /// A camera that sees a part of a drawing to scale.
    pub fn of_part(view: StandardView, bounds: &Bounds, part: &Part) -> Self {
        let mut camera = Self::standard(view, bounds, [1, 1]);
        camera.target = part.target;
        camera.distance *= part.half_height / camera.half_height();
        camera
    }

    /// From the target to the eye, a unit vector.
    pub fn backward(&self) -> DVec3 {
        let (se, ce) = libm::sincos(self.elevation);
        let (sa, ca) = libm::sincos(self.azimuth);
        DVec3::new(ce * sa, ce * ca, se)
    }

    /// To the right of the picture, a unit vector, level where nothing rolls.
    pub fn right(&self) -> DVec3 {
        let (level, upright) = self.upright();
        let (sin, cos) = libm::sincos(self.roll);
        level * cos + upright * sin
    }

    /// To the top of the picture, a unit vector.
    pub fn up(&self) -> DVec3 {
        self.backward().cross(self.right())
    }

    /// Right and up of a camera that looks the same way and does not roll.
    fn upright(&self) -> (DVec3, DVec3) {
        let (sa, ca) = libm::sincos(self.azimuth);
        let right = DVec3::new(-ca, sa, 0.0);
        (right, self.backward().cross(right))
    }

    /// The eye, world metres.
    pub fn eye(&self) -> DVec3 {
        let back = self.backward();
        self.target + back * self.distance
    }

    /// Metres at the target that half the picture's height shows.
    pub fn half_height(&self) -> f64 {
        self.distance * libm::tan(self.field_of_view * 0.5)
    }

    /// Turn round the target, radians. A positive `azimuth` moves the eye clockwise seen from above.
    pub fn orbit(&mut self, azimuth: f64, elevation: f64) {
        self.azimuth = positive(self.azimuth + azimuth);
        self.elevation = (self.elevation + elevation).clamp(-QUARTER, QUARTER);
    }

    /// Turn round the target about the picture's own axes, radians: `across` moves the eye to the left of the picture,
    /// `upward` to its top, `twist` leans the picture's top to the left. There is no pole and no up.
    pub fn turn_free(&mut self, across: f64, upward: f64, twist: f64) {
        let (right, up, back) = (self.right(), self.up(), self.backward());
        let mix = |a: DVec3, b: DVec3, angle: f64| {
            let (sin, cos) = libm::sincos(angle);
            a * cos + b * sin
        };
        let back = mix(back, right, -across);
        let (back, up) = (mix(back, up, upward), mix(up, back, -upward));
        self.elevation = libm::asin(back.z.clamp(-1.0, 1.0));
        // Straight above or below, the azimuth has no meaning: the roll takes its value.
        if libm::hypot(back.x, back.y) > 1e-9 {
            self.azimuth = positive(libm::atan2(back.x, back.y));
        }
        let (level, upright) = self.upright();
        self.roll = libm::atan2(-up.dot(level), up.dot(upright)) + twist;
    }

    /// Look about without moving the eye: the target goes round it. Radians, as for [`Camera::orbit`].
    pub fn look(&mut self, azimuth: f64, elevation: f64) {
        let eye = self.eye();
        self.orbit(azimuth, elevation);
        self.place_eye(eye);
    }

    /// Put the eye somewhere, looking the same way.
    pub fn place_eye(&mut self, eye: DVec3) {
        let back = self.backward();
        self.target = eye - back * self.distance;
    }

    /// Move with the picture: what is at the target's depth follows a pointer that moved `dx`, `dy` pixels (y down).
    pub fn pan(&mut self, dx: f64, dy: f64, size: [u32; 2]) {
        let metres = 2.0 * self.half_height() / f64::from(size[1].max(1));
        let (right, up) = (self.right(), self.up());
        for i in 0..3 {
            self.target[i] += metres * (up[i] * dy - right[i] * dx);
        }
    }

    /// Come nearer (`factor` < 1) or go away, so that the world point `toward` stays on its pixel.
    /// The distance stays within sensible multiples of the model's radius.
    pub fn zoom(&mut self, factor: f64, toward: DVec3, bounds: &Bounds) {
        if !(factor.is_finite() && factor > 0.0) {
            return;
        }
        let radius = bounds.radius();
        let distance = (self.distance * factor).clamp(DISTANCE_RANGE.0 * radius, DISTANCE_RANGE.1 * radius);
        let factor = distance / self.distance;
        self.target = toward + (self.target - toward) * factor;
        self.distance = distance;
    }

    /// The world point under a pixel, at the target's depth. Pixels count from the top left corner.
    pub fn point_at_target_depth(&self, pixel: [f64; 2], size: [u32; 2]) -> DVec3 {
        let (x, y) = self.plane_offset(pixel, size);
        let (right, up) = (self.right(), self.up());
        self.target + right * x + up * y
    }

    /// The ray through a pixel: an origin in world metres and a unit direction.
    pub fn ray(&self, pixel: [f64; 2], size: [u32; 2]) -> (DVec3, DVec3) {
        let through = self.point_at_target_depth(pixel, size);
        let back = self.backward();
        if self.orthographic {
            let origin = through + back * self.distance;
            return (origin, -back);
        }
        let eye = self.eye();
        let d = through - eye;
        let length = d.length();
        (eye, d / length)
    }

    /// The pixel of a world point, and how many metres before the eye it lies (before the target's plane in parallel
    /// projection, more than the distance being behind it). `None` where it is not before the eye.
    pub fn pixel(&self, point: DVec3, size: [u32; 2]) -> Option<([f64; 2], f64)> {
        let d = point - self.eye();
        let depth = -d.dot(self.backward());
        if !self.orthographic && depth <= self.distance * 1e-3 {
            return None;
        }
        let metres = 2.0 * self.half_height() / f64::from(size[1].max(1));
        let scale = if self.orthographic { 1.0 } else { self.distance / depth } / metres;
        let (x, y) = (d.dot(self.right()) * scale, d.dot(self.up()) * scale);
        Some(([f64::from(size[0]) * 0.5 + x, f64::from(size[1]) * 0.5 - y], depth))
    }

    fn plane_offset(&self, [px, py]: [f64; 2], size: [u32; 2]) -> (f64, f64) {
        let metres = 2.0 * self.half_height() / f64::from(size[1].max(1));
        ((px - f64::from(size[0]) * 0.5) * metres, (f64::from(size[1]) * 0.5 - py) * metres)
    }

    /// Turn round another point from now on, without moving the picture.
    pub fn set_pivot(&mut self, point: DVec3) {
        let along = (self.eye() - point).dot(self.backward());
        if self.orthographic {
            let shift = (point - self.target).dot(self.backward());
            let back = self.backward();
            self.target += back * shift;
        } else if along > 0.0 {
            let (eye, back) = (self.eye(), self.backward());
            self.distance = along;
            self.target = eye - back * along;
        }
    }

    /// The picture has another size: what its shorter side showed at the target it continues showing, so that a sheet that is
    /// opened on a phone, or a telephone that is turned, does not make the model small.
    pub fn resized(&mut self, from: [u32; 2], to: [u32; 2]) {
        let shorter = |size: [u32; 2]| f64::from(size[0].min(size[1]).max(1));
        let height = |size: [u32; 2]| f64::from(size[1].max(1));
        self.distance *= height(to) / height(from) * shorter(from) / shorter(to);
    }

    /// Keep the direction; show all of `bounds`, in the middle of the picture, with a small margin.
    pub fn fit(&mut self, bounds: &Bounds, size: [u32; 2]) {
        self.fit_beside(bounds, size, Edges::default());
    }

    /// As [`Camera::fit`], in the middle of what the edges of the picture leave free.
    pub fn fit_beside(&mut self, bounds: &Bounds, size: [u32; 2], covered: Edges) {
        const MARGIN: f64 = 1.04;
        let [width, height] = size.map(|x| f64::from(x.max(1)));
        let ([left, right], [top, bottom]) =
            (kept([covered.left, covered.right], width), kept([covered.top, covered.bottom], height));
        let tan = libm::tan(self.field_of_view * 0.5) / height;
        // The free area as tangents: its middle, and half of its extent.
        let middle = [(left - right) * tan, (bottom - top) * tan];
        let reach = [(width - left - right) * tan / MARGIN, (height - top - bottom) * tan / MARGIN];
        let axes = [self.right(), self.up(), self.backward()];
        let [right, up, _] = axes;
        // What is seen in the middle of the free area, at the target's depth.
        let mut at = bounds.center();
        // A line from the eye through that middle is not parallel to the line of sight.
        let skew = if self.orthographic { [0.0; 2] } else { middle };
        // In perspective the near side looks larger: the place is found in a few rounds.
        for round in 0..8 {
            let corners = bounds.corners().map(|c| DVec3::from_array(axes.map(|axis| (c - at).dot(axis))));
            let beside = |c: DVec3, i: usize| c[i] + skew[i] * c.z;
            let needed = |c: DVec3| {
                let across = (0..2).map(|i| beside(c, i).abs() / reach[i]).fold(0.0, f64::max);
                across + if self.orthographic { 0.0 } else { c.z }
            };
            self.distance = corners.iter().map(|c| needed(*c)).fold(bounds.radius() * 1e-3, f64::max);
            if round == 7 {
                break; // The last word is the distance.
            }
            let scale = |toward: f64| if self.orthographic { 1.0 } else { self.distance / (self.distance - toward) };
            let off: [f64; 2] = std::array::from_fn(|i| {
                let shown = corners.map(|c| beside(c, i) * scale(c.z));
                let (low, high) = shown.iter().fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(*v), h.max(*v)));
                (low + high) * 0.5
            });
            at = at + right * off[0] + up * off[1];
        }
        self.target = at - (right * middle[0] + up * middle[1]) * self.distance;
    }

    /// The view in lattice units for a picture of `size` pixels, to be refined to `target_pixels`, with nothing cut away. `bounds` is the
    /// model's box: parallel projection shows all of its depth.
    pub fn view(&self, lattice: &Lattice, bounds: &Bounds, size: [u32; 2], target_pixels: f64) -> View {
        let step = lattice.step();
        let back = self.backward();
        let forward = -back;
        let anchor = lattice.steps_from_world(if self.orthographic { self.target } else { self.eye() });
        let (eye, projection, near, far) = if self.orthographic {
            let from_center = (self.target - bounds.center()).dot(back);
            let depth = bounds.radius() * 1.01;
            // The plane that depth is counted from touches the ball round the model, on the eye's side.
            let eye = self.target + back * (depth - from_center);
            let half_height = self.half_height() / step;
            (lattice.steps_from_world(eye), Projection::Orthographic { half_height }, 0.0, 2.0 * depth / step)
        } else {
            let tan_half_height = libm::tan(self.field_of_view * 0.5);
            (anchor, Projection::Perspective { tan_half_height }, (self.distance * 1e-3 / step).max(1.0), f64::INFINITY)
        };
        let (right, up, clip) = (self.right(), self.up(), Clip::default());
        View { eye, right, up, forward, anchor, projection, size, near, far, target_pixels, clip }
    }
}

/// An angle as 0 to 2π.
fn positive(angle: f64) -> f64 {
    let angle = libm::fmod(angle, 4.0 * QUARTER);
    if angle < 0.0 { angle + 4.0 * QUARTER } else { angle }
}
