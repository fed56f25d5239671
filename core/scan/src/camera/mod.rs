//! Cameras: which pixel sees a direction, and which direction a pixel sees.
//!
//! Axes of a camera: x right, y down, z forward along the optical axis (OpenCV, COLMAP, Metashape). Pixels: x right, y down; (0, 0) is the
//! *corner* of the top left pixel, whose centre is (0.5, 0.5), so that a picture of `size` covers 0 to `size`. OpenCV itself puts (0, 0) at
//! the centre of that pixel: add 0.5 to its principal point.

mod distortion;
#[cfg(test)]
mod tests;

pub use distortion::Distortion;

use crate::Pose;
use glam::{DMat2, DQuat, DVec2, DVec3};
use std::f64::consts::{FRAC_1_SQRT_2, FRAC_PI_2, PI, TAU};
use std::fmt;

/// How directions become pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraModel {
    /// A plane behind a lens.
    Pinhole {
        /// fx and fy, pixels.
        focal: DVec2,
        /// The principal point, pixels from the corner of the picture.
        center: DVec2,
        /// Pixels by which x grows for each unit of the distorted y (Metashape's B2): 0 for almost all cameras.
        skew: f64,
        /// The lens.
        distortion: Distortion,
    },
    /// A panorama whose columns are longitudes and whose rows are latitudes: x = center.x + scale.x · atan2(X, Z),
    /// y = center.y + scale.y · atan2(Y, hypot(X, Z)). Its centre looks along +z; the right half is to the right.
    Equirectangular {
        /// Pixels per radian.
        scale: DVec2,
        /// Longitude and latitude 0, pixels.
        center: DVec2,
    },
    /// A panorama on a cylinder whose axis is y: x as [`Self::Equirectangular`], y = center.y + scale.y · Y / hypot(X, Z).
    Cylindrical {
        /// Pixels per radian, and pixels per unit of the tangent of the latitude.
        scale: DVec2,
        /// Longitude and latitude 0, pixels.
        center: DVec2,
    },
}

/// A camera: the size of its pictures and its model, with how far from the axis that can be used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Camera {
    size: [u32; 2],
    model: CameraModel,
    /// The radius up to which the distortion is one-to-one.
    limit: f64,
}

/// Why a camera cannot be made from these numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CameraError {
    /// A picture without pixels.
    Empty,
    /// A number is not finite.
    NotFinite,
    /// A focal length or scale is not positive.
    NotPositive,
}

impl fmt::Display for CameraError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Empty => "a picture size of 0",
            Self::NotFinite => "a number that is not finite",
            Self::NotPositive => "a focal length or scale that is not positive",
        })
    }
}

impl std::error::Error for CameraError {}

/// A projection and its derivative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    /// Pixels.
    pub pixel: DVec2,
    /// Pixels per unit of the point: the derivatives of x and of y with respect to the point in the camera's frame. Both are perpendicular to
    /// the ray.
    pub rows: [DVec3; 2],
}

impl Camera {
    /// A camera of pictures of `size` (width and height, pixels). A distortion whose coefficients are all 0 becomes [`Distortion::None`], unless it is that of a fisheye.
    ///
    /// # Errors
    /// [`CameraError`]: a size of 0, a number that is not finite, a focal length or scale that is not positive.
    pub fn new(size: [u32; 2], mut model: CameraModel) -> Result<Self, CameraError> {
        if size.contains(&0) {
            return Err(CameraError::Empty);
        }
        let (scale, center, others) = match &model {
            CameraModel::Pinhole { focal, center, skew, distortion } => {
                (*focal, *center, skew.is_finite() && distortion.is_finite())
            }
            CameraModel::Equirectangular { scale, center } | CameraModel::Cylindrical { scale, center } => {
                (*scale, *center, true)
            }
        };
        if !(scale.is_finite() && center.is_finite() && others) {
            return Err(CameraError::NotFinite);
        }
        if scale.min_element() <= 0.0 {
            return Err(CameraError::NotPositive);
        }
        let limit = match &mut model {
            CameraModel::Pinhole { distortion, .. } => {
                *distortion = distortion.simplified();
                distortion.limit()
            }
            _ => f64::INFINITY,
        };
        Ok(Self { size, model, limit })
    }

    /// A pinhole without skew.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn pinhole(size: [u32; 2], focal: DVec2, center: DVec2, distortion: Distortion) -> Result<Self, CameraError> {
        Self::new(size, CameraModel::Pinhole { focal, center, skew: 0.0, distortion })
    }

    /// A panorama of the whole sphere.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn equirectangular(size: [u32; 2]) -> Result<Self, CameraError> {
        let [width, height] = size.map(f64::from);
        let scale = DVec2::new(width / TAU, height / PI);
        Self::new(size, CameraModel::Equirectangular { scale, center: DVec2::new(width, height) * 0.5 })
    }

    /// One of the six faces of a cube panorama, `side` pixels wide and high; [`CubeFace::face_from_cube`] turns it.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn cube_face(side: u32) -> Result<Self, CameraError> {
        let half = DVec2::splat(f64::from(side) * 0.5);
        Self::pinhole([side; 2], half, half, Distortion::None)
    }

    /// Width and height of its pictures, pixels.
    pub fn size(&self) -> [u32; 2] {
        self.size
    }

    /// Pixels per radian on the optical axis, where it is larger if they differ between the directions.
    pub fn pixels_per_radian(&self) -> f64 {
        match &self.model {
            CameraModel::Pinhole { focal, .. } => focal.max_element(),
            CameraModel::Equirectangular { scale, .. } | CameraModel::Cylindrical { scale, .. } => scale.max_element(),
        }
    }

    /// Whether its pictures go all the way round, so that their left and right edges are the same place.
    pub fn is_full_turn(&self) -> bool {
        match &self.model {
            CameraModel::Equirectangular { scale, .. } | CameraModel::Cylindrical { scale, .. } => {
                f64::from(self.size[0]) >= 0.999 * TAU * scale.x
            }
            CameraModel::Pinhole { .. } => false,
        }
    }

    /// The model.
    pub fn model(&self) -> &CameraModel {
        &self.model
    }

    /// The widest angle from the optical axis at which the model can be used, radians: where the distortion ceases to
    /// be one-to-one, and less
    /// than half a turn. π for panoramas.
    pub fn max_angle(&self) -> f64 {
        match &self.model {
            CameraModel::Pinhole { distortion, .. } if distortion.is_fisheye() => self.limit,
            CameraModel::Pinhole { .. } => libm::atan(self.limit),
            _ => PI,
        }
    }

    /// Whether a place is in the picture.
    pub fn contains(&self, pixel: DVec2) -> bool {
        let [width, height] = self.size.map(f64::from);
        pixel.x >= 0.0 && pixel.x < width && pixel.y >= 0.0 && pixel.y < height
    }

    /// Where a point of the camera's frame is seen, which may be outside the picture. None behind the camera, where the distortion
    /// is not one-to-one, and at the origin.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        let pixel = match &self.model {
            CameraModel::Pinhole { focal, center, skew, distortion } => {
                let u = if distortion.is_fisheye() { angular(point)? } else { flat(point)? };
                if u.length_squared() > self.limit * self.limit {
                    return None;
                }
                let d = if *distortion == Distortion::None { u } else { distortion.apply(u).0 };
                *center + DVec2::new(focal.x * d.x + skew * d.y, focal.y * d.y)
            }
            CameraModel::Equirectangular { scale, center } => {
                let across = length(point.x, point.z);
                let angles = DVec2::new(longitude(point), libm::atan2(point.y, across));
                (point != DVec3::ZERO).then_some(*center + *scale * angles)?
            }
            CameraModel::Cylindrical { scale, center } => {
                let across = length(point.x, point.z);
                *center + *scale * DVec2::new(longitude(point), point.y / across)
            }
        };
        pixel.is_finite().then_some(pixel)
    }

    /// As [`Self::project`], with the derivative.
    pub fn project_with_derivative(&self, point: DVec3) -> Option<Projection> {
        let pixel = self.project(point)?;
        let rows = match &self.model {
            CameraModel::Pinhole { focal, skew, distortion, .. } => {
                let (u, du) =
                    if distortion.is_fisheye() { angular_derivative(point)? } else { flat_derivative(point)? };
                let DMat2 { x_axis, y_axis } = distortion.apply(u).1;
                let d = [du[0] * x_axis.x + du[1] * y_axis.x, du[0] * x_axis.y + du[1] * y_axis.y];
                [d[0] * focal.x + d[1] * *skew, d[1] * focal.y]
            }
            CameraModel::Equirectangular { scale, .. } => {
                let across = length(point.x, point.z);
                let latitude = DVec3::new(-point.x * point.y / across, across, -point.z * point.y / across);
                [longitude_derivative(point) * scale.x, latitude * (scale.y / point.length_squared())]
            }
            CameraModel::Cylindrical { scale, .. } => {
                let across = length(point.x, point.z);
                let squared = across * across;
                let slope = DVec3::new(-point.x * point.y / squared, 1.0, -point.z * point.y / squared);
                [longitude_derivative(point) * scale.x, slope * (scale.y / across)]
            }
        };
        rows.iter().all(|row| row.is_finite()).then_some(Projection { pixel, rows })
    }

    /// The unit direction, in the camera's frame, that a place of the picture sees. None where no direction within the limit of the
    /// distortion is seen there, and beyond the sphere of a panorama.
    pub fn ray(&self, pixel: DVec2) -> Option<DVec3> {
        if !pixel.is_finite() {
            return None;
        }
        match &self.model {
            CameraModel::Pinhole { focal, center, skew, distortion } => {
                let y = (pixel.y - center.y) / focal.y;
                let distorted = DVec2::new((pixel.x - center.x - skew * y) / focal.x, y);
                let u = distortion.invert(distorted, self.limit)?;
                if !distortion.is_fisheye() {
                    return Some(u.extend(1.0).normalize());
                }
                let angle = u.length();
                let sine = if angle > 0.0 { libm::sin(angle) / angle } else { 1.0 };
                Some((u * sine).extend(libm::cos(angle)))
            }
            CameraModel::Equirectangular { scale, center } => {
                let angles = (pixel - *center) / *scale;
                let (sine, cosine) = (libm::sin(angles.y), libm::cos(angles.y));
                let is_on_sphere = angles.x.abs() <= PI && angles.y.abs() <= FRAC_PI_2;
                is_on_sphere.then(|| DVec3::new(cosine * libm::sin(angles.x), sine, cosine * libm::cos(angles.x)))
            }
            CameraModel::Cylindrical { scale, center } => {
                let at = (pixel - *center) / *scale;
                (at.x.abs() <= PI).then(|| DVec3::new(libm::sin(at.x), at.y, libm::cos(at.x)).normalize())
            }
        }
    }

    /// The angle that a pixel covers where a point of the camera's frame is seen, radians: the larger one where pixels are stretched, so that
    /// an object at this distance times the angle is certainly resolved. None as [`Self::project`], and at the poles of a panorama.
    pub fn pixel_angle(&self, point: DVec3) -> Option<f64> {
        let [a, b] = self.project_with_derivative(point)?.rows;
        // The smaller singular value of the derivative: pixels per unit of length across the ray.
        let (aa, ab, bb) = (a.length_squared(), a.dot(b), b.length_squared());
        let half = 0.5 * (aa - bb);
        let squared = 0.5 * (aa + bb) - (half * half + ab * ab).sqrt();
        let angle = 1.0 / (squared.max(0.0).sqrt() * point.length());
        angle.is_finite().then_some(angle)
    }
}

fn length(a: f64, b: f64) -> f64 {
    (a * a + b * b).sqrt()
}

/// Where a ray meets the plane at distance 1. None if it does not.
fn flat(point: DVec3) -> Option<DVec2> {
    (point.z > 0.0).then(|| point.truncate() / point.z)
}

fn flat_derivative(point: DVec3) -> Option<(DVec2, [DVec3; 2])> {
    let u = flat(point)?;
    let inverse = 1.0 / point.z;
    Some((u, [DVec3::new(inverse, 0.0, -u.x * inverse), DVec3::new(0.0, inverse, -u.y * inverse)]))
}

/// The direction of a point in the picture, as long as its angle from the axis. None straight behind the camera and at the origin.
fn angular(point: DVec3) -> Option<DVec2> {
    let across = length(point.x, point.y);
    if across == 0.0 {
        return (point.z > 0.0).then_some(DVec2::ZERO);
    }
    Some(point.truncate() * (libm::atan2(across, point.z) / across))
}

fn angular_derivative(point: DVec3) -> Option<(DVec2, [DVec3; 2])> {
    let u = angular(point)?;
    let across = length(point.x, point.y);
    if across == 0.0 {
        let inverse = 1.0 / point.z;
        return Some((u, [DVec3::X * inverse, DVec3::Y * inverse]));
    }
    let (squared, factor) = (point.length_squared(), libm::atan2(across, point.z) / across);
    // The derivative of the factor with respect to x and y is this times x and y.
    let slope = (point.z / squared - factor) / (across * across);
    let (x, y) = (point.x, point.y);
    let rows = [
        DVec3::new(factor + x * x * slope, x * y * slope, -x / squared),
        DVec3::new(x * y * slope, factor + y * y * slope, -y / squared),
    ];
    Some((u, rows))
}

/// The angle of a point about the y axis, from z towards x, radians; 0 on that axis.
fn longitude(point: DVec3) -> f64 {
    if point.x == 0.0 && point.z == 0.0 { 0.0 } else { libm::atan2(point.x, point.z) }
}

fn longitude_derivative(point: DVec3) -> DVec3 {
    DVec3::new(point.z, 0.0, -point.x) / (point.x * point.x + point.z * point.z)
}

/// The faces of a cube panorama, named as seen from inside by someone who looks at the front.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CubeFace {
    /// Along +z of the cube.
    Front,
    /// Along +x.
    Right,
    /// Along -z.
    Back,
    /// Along -x.
    Left,
    /// Along -y; the lower edge of the picture joins the front.
    Up,
    /// Along +y; the upper edge of the picture joins the front.
    Down,
}

impl CubeFace {
    /// All of them.
    pub const ALL: [Self; 6] = [Self::Front, Self::Right, Self::Back, Self::Left, Self::Up, Self::Down];

    /// The rotation from the frame of the cube (x right, y down, z to the front) to that of the face's camera.
    pub fn face_from_cube(self) -> DQuat {
        let half = FRAC_1_SQRT_2;
        match self {
            Self::Front => DQuat::IDENTITY,
            Self::Right => DQuat::from_xyzw(0.0, -half, 0.0, half),
            Self::Back => DQuat::from_xyzw(0.0, 1.0, 0.0, 0.0),
            Self::Left => DQuat::from_xyzw(0.0, half, 0.0, half),
            Self::Up => DQuat::from_xyzw(-half, 0.0, 0.0, half),
            Self::Down => DQuat::from_xyzw(half, 0.0, 0.0, half),
        }
    }
}

/// A camera with its place. The world is the survey, or the frame of a reconstruction from photographs, whose unit of length is arbitrary.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PosedCamera {
    /// The camera.
    pub camera: Camera,
    /// Transforms world coordinates to camera coordinates.
    pub camera_from_world: Pose,
}

impl PosedCamera {
    /// Where the camera is in the world.
    pub fn position(&self) -> DVec3 {
        self.camera_from_world.inverse().translation
    }

    /// The unit direction in the world along which the camera looks.
    pub fn forward(&self) -> DVec3 {
        self.camera_from_world.rotation.inverse() * DVec3::Z
    }

    /// Where a point of the world is seen; see [`Camera::project`].
    pub fn project(&self, world: DVec3) -> Option<DVec2> {
        self.camera.project(self.camera_from_world.apply(world))
    }

    /// The unit direction in the world that a place of the picture sees; see [`Camera::ray`].
    pub fn ray(&self, pixel: DVec2) -> Option<DVec3> {
        Some(self.camera_from_world.rotation.inverse() * self.camera.ray(pixel)?)
    }

    /// The length that a pixel covers at a point of the world, across the ray, in units of the world; see [`Camera::pixel_angle`].
    pub fn pixel_length(&self, world: DVec3) -> Option<f64> {
        let point = self.camera_from_world.apply(world);
        Some(self.camera.pixel_angle(point)? * point.length())
    }
}
