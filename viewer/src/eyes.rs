//! The eyes of a headset: where each looks from and which part of the world it shows; and one view that contains what all of them see, for deciding
//! what is loaded. Pure, and tested here.

use crate::options::Frustum;
use glam::DVec3;
use kilwa_geometry::Lattice;
use kilwa_stream::{Clip, Projection, View};

/// Numbers that describe an eye: [`Eye::from_numbers`].
pub const NUMBERS: usize = 15;
/// Nothing nearer to an eye is drawn, metres: a hand's breadth would cut away what people bend down to.
const NEAR: f64 = 0.03;
/// From this depth on, metres, the pixel error that [`View::target_pixels`] asks for holds in every eye. What is nearer is drawn about as fine.
const EXACT_FROM: f64 = 0.5;
/// An eye that looks farther aside than this from where all of them look together cannot be an eye of a headset: cosine.
const ASIDE: f64 = 0.2;

/// An eye of a headset, in world coordinates: metres, z up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eye {
    /// Where it is.
    pub position: DVec3,
    /// To the right of its picture, a unit vector.
    pub right: DVec3,
    /// To the top of its picture, a unit vector at right angles to `right`.
    pub up: DVec3,
    /// The edges of its picture.
    pub frustum: Frustum,
    /// Width and height of its picture in pixels.
    pub size: [u32; 2],
}

impl Eye {
    /// From its position, right and up (three numbers each), the tangents of its left, right, lower and upper edge, its width and its height. `None` where
    /// they describe no eye.
    pub fn from_numbers(numbers: &[f64]) -> Option<Self> {
        let numbers: &[f64; NUMBERS] = numbers.try_into().ok()?;
        let &[x, y, z, rx, ry, rz, ux, uy, uz, left, right, down, up, width, height] = numbers;
        let frustum = Frustum { left, right, down, up };
        let is_sane =
            numbers.iter().all(|v| v.is_finite()) && left < right && down < up && width >= 1.0 && height >= 1.0;
        // Browsers give axes as 32-bit numbers, which are not quite at right angles.
        let right = DVec3::new(rx, ry, rz).try_normalize()?;
        let up = DVec3::new(ux, uy, uz).reject_from_normalized(right).try_normalize()?;
        is_sane.then_some(Self {
            position: DVec3::new(x, y, z),
            right,
            up,
            frustum,
            size: [width as u32, height as u32],
        })
    }

    /// Into its picture, a unit vector.
    pub fn forward(&self) -> DVec3 {
        self.up.cross(self.right)
    }

    /// Its view in lattice units. The edges of its picture are those of [`Eye::frustum`], which the options of the picture need as well.
    pub fn view(&self, lattice: &Lattice, target_pixels: f64) -> View {
        let eye = lattice.steps_from_world(self.position);
        let Frustum { down, up, .. } = self.frustum;
        let projection = Projection::Perspective { tan_half_height: (up - down) * 0.5 };
        View {
            eye,
            right: self.right,
            up: self.up,
            forward: self.forward(),
            anchor: eye,
            projection,
            size: self.size,
            near: near(lattice),
            far: f64::INFINITY,
            target_pixels,
            clip: Clip::default(),
        }
    }

    /// Pixels for a tangent of 1, of the direction in which there are more.
    fn density(&self) -> f64 {
        let Frustum { left, right, down, up } = self.frustum;
        let [width, height] = self.size.map(f64::from);
        (width / (right - left)).max(height / (up - down))
    }

    /// Directions through the corners of its picture; the part along [`Eye::forward`] is 1.
    fn corners(&self) -> [DVec3; 4] {
        let Frustum { left, right, down, up } = self.frustum;
        [(left, down), (right, down), (left, up), (right, up)]
            .map(|(x, y)| self.forward() + self.right * x + self.up * y)
    }
}

fn near(lattice: &Lattice) -> f64 {
    (NEAR / lattice.step()).max(1.0)
}

/// One symmetric view that contains what all eyes see, in lattice units: from a point so far behind them that its edges enclose theirs. `None` without
/// eyes, or where they look in different directions.
///
/// Its pixels are smaller than those of the eyes, so that an error that takes up no more than `target_pixels` of them takes up no more in any
/// eye, from half a metre before the eyes on.
pub fn view_of_all(eyes: &[Eye], lattice: &Lattice, target_pixels: f64) -> Option<View> {
    let middle = eyes.iter().map(|e| e.position).sum::<DVec3>() / eyes.len().max(1) as f64;
    let forward = eyes.iter().map(Eye::forward).sum::<DVec3>().try_normalize()?;
    let right = forward.cross(eyes.iter().map(|e| e.up).sum()).try_normalize()?;
    let up = right.cross(forward);
    let mut half = [0.0, 0.0_f64];
    // How much deeper a point can be before the middle than before an eye that is turned away from it.
    let mut turned = 1.0_f64;
    for corner in eyes.iter().flat_map(Eye::corners) {
        let depth = corner.dot(forward);
        if depth < ASIDE * corner.length() {
            return None;
        }
        turned = turned.max(depth);
        half = [half[0].max((corner.dot(right) / depth).abs()), half[1].max((corner.dot(up) / depth).abs())];
    }
    let offsets = || eyes.iter().map(|e| e.position - middle);
    let behind = |d: DVec3| (d.dot(right).abs() / half[0]).max(d.dot(up).abs() / half[1]) - d.dot(forward);
    let back = offsets().map(behind).fold(0.0, f64::max);
    // The error in an eye, over the error from the point behind: `distance / depth²` of both, at the least favourable place.
    let apart = offsets().map(|d| (d + forward * back).length()).fold(0.0, f64::max);
    let deeper = offsets().map(|d| d.dot(forward) + back).fold(0.0, f64::max);
    let nearer = (1.0 + apart / EXACT_FROM) * ((1.0 + deeper / EXACT_FROM) * turned).powi(2);
    let density = eyes.iter().map(Eye::density).fold(0.0, f64::max) * nearer;
    let size = half.map(|h| (2.0 * h * density).ceil().max(1.0));
    let eye = lattice.steps_from_world(middle - forward * back);
    Some(View {
        eye,
        right,
        up,
        forward,
        anchor: eye,
        projection: Projection::Perspective { tan_half_height: size[1] / (2.0 * density) },
        size: size.map(|s| s as u32),
        near: near(lattice),
        far: f64::INFINITY,
        target_pixels,
        clip: Clip::default(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clip::ClipTransform;
    use glam::{DMat3, DVec4};
    use kilwa_geometry::Sphere;

    const LATTICE: Lattice = Lattice { origin: DVec3::new(500_000.0, 4_649_700.0, -20.0), step_log2: -12 };
    const FRUSTUM: Frustum = Frustum { left: -1.3, right: 0.9, down: -1.1, up: 0.95 };

    /// Two eyes that look to the side, each turned outwards by `cant` radians.
    fn eyes(turn: f64, cant: f64) -> [Eye; 2] {
        let eye = |side: f64| {
            let head = DMat3::from_rotation_z(turn) * DMat3::from_rotation_x(-0.3);
            let at = head * DMat3::from_rotation_z(-side * cant);
            let position = DVec3::new(500_020.0, 4_649_730.0, 1.6) + head * DVec3::new(side * 0.032, 0.0, 0.0);
            let Frustum { left, right, .. } = FRUSTUM;
            let frustum = if side < 0.0 { FRUSTUM } else { Frustum { left: -right, right: -left, ..FRUSTUM } };
            Eye { position, right: at * DVec3::X, up: at * DVec3::Z, frustum, size: [1680, 1760] }
        };
        [eye(-1.0), eye(1.0)]
    }

    /// Places that an eye sees, from half a metre to forty metres before it.
    fn seen(eye: &Eye) -> Vec<DVec3> {
        let Frustum { left, right, down, up } = eye.frustum;
        let mut out = Vec::new();
        for depth in [0.5, 0.7, 2.0, 40.0] {
            for (x, y) in (0..=4).flat_map(|i| (0..=4).map(move |j| (f64::from(i) / 4.0, f64::from(j) / 4.0))) {
                let (x, y) = (left + (right - left) * x, down + (up - down) * y);
                out.push(eye.position + (eye.forward() + eye.right * x + eye.up * y) * depth);
            }
        }
        out
    }

    #[test]
    fn the_view_of_all_eyes_sees_what_each_sees_and_no_error_is_larger_in_an_eye() {
        for (turn, cant) in [(0.0, 0.0), (2.1, 0.0), (4.0, 0.17)] {
            let eyes = eyes(turn, cant);
            let all = view_of_all(&eyes, &LATTICE, 1.0).expect("two eyes");
            for (eye, place) in eyes.iter().flat_map(|e| seen(e).into_iter().map(move |p| (e, p))) {
                let at = LATTICE.steps_from_world(place);
                let ball = Sphere { center: at, radius: 1e-3 };
                assert!(all.may_see(&ball), "{place} at {turn}, {cant}");
                // A displacement by this much, in several directions, in pixels of the eye.
                let error = 0.002 / LATTICE.step();
                let view = eye.view(&LATTICE, 1.0);
                let pixel = |p: DVec3| {
                    let d = p - view.eye;
                    let f = eye.frustum;
                    let depth = d.dot(view.forward);
                    let x = (d.dot(view.right) / depth - f.left) / (f.right - f.left) * f64::from(eye.size[0]);
                    let y = (d.dot(view.up) / depth - f.down) / (f.up - f.down) * f64::from(eye.size[1]);
                    [x, y]
                };
                let from = pixel(at);
                for way in
                    [view.right, view.up, (view.right + view.up).normalize(), (view.right - view.forward).normalize()]
                {
                    let to = pixel(at + way * error);
                    let moved = (to[0] - from[0]).hypot(to[1] - from[1]);
                    let promised = all.pixel_error(&ball, error);
                    // A displacement towards the eye comes nearer while it happens: the promise is for a small one.
                    assert!(moved <= promised * 1.01, "{moved} pixels, {promised} promised at {place}");
                }
            }
        }
    }

    #[test]
    fn an_eye_draws_its_own_edges() {
        for eye in eyes(1.0, 0.1) {
            let view = eye.view(&LATTICE, 1.0);
            let t = ClipTransform::with_frustum(&view, None, eye.frustum);
            for (corner, wanted) in eye.corners().into_iter().zip([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0]])
            {
                let p = LATTICE.steps_from_world(eye.position + corner * 3.0).round().as_ivec3();
                let DVec4 { x, y, w, .. } = t.clip_from_cell.as_dmat4() * (p - t.cell).as_dvec3().extend(1.0);
                assert!((x / w - wanted[0]).abs() < 1e-3 && (y / w - wanted[1]).abs() < 1e-3, "{} {}", x / w, y / w);
            }
        }
    }

    #[test]
    fn numbers_that_describe_no_eye_are_refused() {
        let good = [1.0, 2.0, 3.0, 1.0, 0.0, 0.0, 0.0, 1e-7, 1.0, -1.0, 1.0, -1.0, 1.0, 640.0, 480.0];
        let eye = Eye::from_numbers(&good).expect("an eye");
        assert!(eye.forward().distance(DVec3::Y) < 1e-6 && eye.size == [640, 480]);
        for (at, bad) in [(0, f64::NAN), (9, 1.0), (13, 0.0), (3, 0.0), (12, f64::INFINITY)] {
            let mut numbers = good;
            numbers[at] = bad;
            assert_eq!(Eye::from_numbers(&numbers), None, "{bad} at {at}");
        }
        assert_eq!(Eye::from_numbers(&good[1..]), None);
        assert_eq!(view_of_all(&[], &LATTICE, 1.0), None);
        let back = Eye { right: -eye.right, ..eye };
        assert_eq!(view_of_all(&[eye, back], &LATTICE, 1.0), None);
    }
}
