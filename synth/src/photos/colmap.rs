//! Poses in the form that structure-from-motion programs write: a COLMAP text model, with sparse points, their
//! observations and errors.
//!
//! Format: <https://colmap.github.io/format.html>. Pixels count from the corner of the picture.

use super::session::{Photo, Session};
use super::{Carrier, PhotoOptions};
use crate::noise::{derive, hash2, hash3, normal, unit};
use glam::{DMat3, DQuat, DVec2, DVec3};
use kilwa_geometry::color::srgb_from_light;
use kilwa_scan_core::camera::{CameraModel, Distortion};
use rayon::prelude::*;
use std::fmt::Write as _;

/// Places of each photograph that are tried as sparse points.
const PICKS: u32 = 48;
/// Standard deviation of an observation and of a point across the view of the photograph that it comes from, in pixels.
const NOISE: f64 = 0.25;
/// Observations keep this distance from the border of a picture, in pixels.
const BORDER: f64 = 2.0;

/// A similarity: takes coordinates of the site to those of the reconstruction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Similarity {
    pub(super) scale: f64,
    pub(super) rotation: DMat3,
    pub(super) shift: DVec3,
}

impl Similarity {
    const IDENTITY: Self = Self { scale: 1.0, rotation: DMat3::IDENTITY, shift: DVec3::ZERO };

    /// An arbitrary frame, as a reconstruction without known points has it.
    fn arbitrary(seed: u64) -> Self {
        let h = derive(seed, 0xf6);
        let random = |k: i64| normal(hash2(h, k, 0));
        let rotation = DQuat::from_xyzw(random(1), random(2), random(3), random(4)).normalize();
        Self {
            scale: 0.08 + 0.2 * unit(h, 0),
            rotation: DMat3::from_quat(rotation),
            shift: DVec3::new(random(5), random(6), random(7)) * 2.0,
        }
    }

    /// The frame of the reconstruction.
    pub(super) fn of(options: &PhotoOptions) -> Self {
        if options.sfm_frame { Self::arbitrary(options.seed) } else { Self::IDENTITY }
    }

    fn apply(&self, p: DVec3) -> DVec3 {
        self.rotation * p * self.scale + self.shift
    }

    pub(super) fn inverse(&self) -> Self {
        let (scale, rotation) = (1.0 / self.scale, self.rotation.transpose());
        Self { scale, rotation, shift: -(rotation * self.shift) * scale }
    }
}

/// A sparse point with its observations: number of the photograph and place in it.
struct Point {
    position: DVec3,
    color: [u8; 3],
    seen: Vec<(usize, DVec2)>,
    /// Mean distance of the observations from where the true poses see the point, in pixels.
    error: f64,
}

/// A pose as the reconstruction has it, in the site's frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Given {
    pub(super) position: DVec3,
    /// `site_from_camera`.
    pub(super) rotation: DMat3,
    /// By how many pixels (root mean square) places of the picture are shifted.
    pub(super) error: f64,
}

/// The reconstruction of a session.
pub(super) struct Model {
    pub(super) frame: Similarity,
    /// The poses of the photographs, without the panoramas.
    pub(super) given: Vec<Given>,
    points: Vec<Point>,
}

impl Model {
    /// Choose points, and disturb the poses.
    pub(super) fn new(session: &Session, options: &PhotoOptions) -> Self {
        let photos: Vec<&Photo> = session.photos().iter().filter(|photo| photo.carrier != Carrier::Tripod).collect();
        let seed = derive(options.seed, 0xf7);
        let tries: Vec<(usize, u32)> = (0..photos.len()).flat_map(|k| (0..PICKS).map(move |n| (k, n))).collect();
        let points: Vec<Point> = tries
            .into_par_iter()
            .filter_map(|(k, n)| point(session, &photos, hash3(seed, k as i64, i64::from(n), 0), k))
            .collect();
        let mut targets = vec![Vec::new(); photos.len()];
        for point in &points {
            for (photo, _) in &point.seen {
                targets[*photo].push(point.position);
            }
        }
        let given = photos.iter().zip(&targets).enumerate();
        let given =
            given.map(|(k, (photo, targets))| disturbed(photo, targets, options.pose_error, hash2(seed, k as i64, 1)));
        Self { frame: Similarity::of(options), given: given.collect(), points }
    }

    /// Number of sparse points.
    pub(super) fn point_count(&self) -> u64 {
        self.points.len() as u64
    }

    /// `cameras.txt`, `images.txt` and `points3D.txt`.
    pub(super) fn texts(&self, session: &Session) -> [(&'static str, String); 3] {
        let photos: Vec<&Photo> = session.photos().iter().take(self.given.len()).collect();
        [("cameras.txt", cameras(&photos)), ("images.txt", self.images(&photos)), ("points3D.txt", self.points3d())]
    }

    fn images(&self, photos: &[&Photo]) -> String {
        let mut observed: Vec<Vec<(DVec2, usize)>> = vec![Vec::new(); photos.len()];
        for (number, point) in self.points.iter().enumerate() {
            for (photo, at) in &point.seen {
                observed[*photo].push((*at, number + 1));
            }
        }
        let mut text = String::from(
            "# Made by kilwa synth photos; no real place.\n# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n",
        );
        for (k, (photo, given)) in photos.iter().zip(&self.given).enumerate() {
            let camera_from_frame = given.rotation.transpose() * self.frame.rotation.transpose();
            let q = DQuat::from_mat3(&camera_from_frame).normalize();
            let t = -(camera_from_frame * self.frame.apply(given.position));
            let q = if q.w < 0.0 { -q } else { q };
            let _ = writeln!(
                text,
                "{} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {} {}.jpg",
                k + 1,
                q.w,
                q.x,
                q.y,
                q.z,
                t.x,
                t.y,
                t.z,
                camera_id(photo.carrier),
                photo.name
            );
            let observations: Vec<String> =
                observed[k].iter().map(|(at, point)| format!("{:.3} {:.3} {point}", at.x, at.y)).collect();
            text.push_str(&observations.join(" "));
            text.push('\n');
        }
        text
    }

    fn points3d(&self) -> String {
        let mut next = vec![0_usize; self.given.len()];
        let mut text = String::from(
            "# Made by kilwa synth photos; no real place.\n# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n",
        );
        for (number, point) in self.points.iter().enumerate() {
            let (p, [r, g, b]) = (self.frame.apply(point.position), point.color);
            let _ = write!(text, "{} {:?} {:?} {:?} {r} {g} {b} {:.4}", number + 1, p.x, p.y, p.z, point.error);
            for (photo, _) in &point.seen {
                let _ = write!(text, " {} {}", photo + 1, next[*photo]);
                next[*photo] += 1;
            }
            text.push('\n');
        }
        text
    }
}

fn camera_id(carrier: Carrier) -> u32 {
    if carrier == Carrier::Hand { 1 } else { 2 }
}

/// The cameras that were used, with OpenCV's model.
fn cameras(photos: &[&Photo]) -> String {
    let mut text =
        String::from("# Made by kilwa synth photos; no real place.\n# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
    for carrier in [Carrier::Hand, Carrier::Drone] {
        let Some(photo) = photos.iter().find(|photo| photo.carrier == carrier) else { continue };
        let CameraModel::Pinhole { focal, center, distortion, .. } = photo.camera.model() else { continue };
        let Distortion::Brown { k, p } = distortion else { continue };
        let (width, height) = photo.size();
        let _ = writeln!(
            text,
            "{} OPENCV {width} {height} {:?} {:?} {:?} {:?} {:?} {:?} {:?} {:?}",
            camera_id(carrier),
            focal.x,
            focal.y,
            center.x,
            center.y,
            k[0],
            k[1],
            p[0],
            p[1]
        );
    }
    text
}

/// A point that photograph `from` and at least one more show.
fn point(session: &Session, photos: &[&Photo], h: u64, from: usize) -> Option<Point> {
    let photo = photos[from];
    let (width, height) = photo.size();
    let at = DVec2::new(unit(h, 0) * f64::from(width), unit(h, 1) * f64::from(height));
    let surface = session.shown_at(from, at)?;
    // As large as the pixels that it was measured with.
    let range = surface.position.distance(photo.position);
    let sigma = NOISE * range / focal(photo);
    let off = |k: i64| normal(hash2(h, k, 1));
    let position = surface.position + DVec3::new(off(1), off(2), off(3)) * (0.6 * sigma);
    let mut seen = Vec::new();
    let mut sum = 0.0;
    for (k, photo) in photos.iter().enumerate() {
        let Some(at) = photo.project(surface.position) else { continue };
        let (width, height) = photo.size();
        let noisy = at + DVec2::new(off(4 + 2 * k as i64), off(5 + 2 * k as i64)) * NOISE;
        let is_inside = noisy.cmpgt(DVec2::splat(BORDER)).all()
            && noisy.cmplt(DVec2::new(f64::from(width), f64::from(height)) - BORDER).all();
        let Some(again) = photo.project(position) else { continue };
        // Points seen at a grazing angle are not recognised.
        let to_camera = (photo.position - surface.position).normalize();
        let is_clear = || session.sees(k, &surface) && !session.is_behind_people(k, surface.position);
        if is_inside && surface.normal.dot(to_camera) > 0.2 && again.distance(noisy) < 1.0 && is_clear() {
            sum += again.distance(noisy);
            seen.push((k, noisy));
        }
    }
    let error = sum / seen.len() as f64;
    let color = surface.albedo.map(srgb_from_light);
    (seen.len() >= 2).then_some(Point { position, color, seen, error })
}

fn focal(photo: &Photo) -> f64 {
    let (width, height) = photo.size();
    photo.carrier.focal() * f64::from(width.max(height))
}

/// The pose of a photograph turned and moved so that the places that it shows are shifted by `pixels` (root mean square).
fn disturbed(photo: &Photo, targets: &[DVec3], pixels: f64, h: u64) -> Given {
    let truth = Given { position: photo.position, rotation: photo.rotation, error: 0.0 };
    if pixels == 0.0 {
        return truth;
    }
    let (width, height) = photo.size();
    let mut places = targets.to_vec();
    if places.len() < 8 {
        // Too few points: places at 10 m.
        places = [0.2, 0.5, 0.8]
            .into_iter()
            .flat_map(|x| [0.2, 0.5, 0.8].map(|y| DVec2::new(x * f64::from(width), y * f64::from(height))))
            .filter_map(|at| photo.camera.ray(at))
            .map(|d| photo.position + photo.rotation * d * 10.0)
            .collect();
    }
    let mut ranges: Vec<f64> = places.iter().map(|p| p.distance(photo.position)).collect();
    ranges.sort_by(f64::total_cmp);
    let range = ranges[ranges.len() / 2];
    let off = |k: i64| normal(hash2(h, k, 2));
    let angle = pixels / focal(photo);
    let (turn, shift) =
        (DVec3::new(off(1), off(2), off(3)) * angle, DVec3::new(off(4), off(5), off(6)) * angle * range);
    let with = |factor: f64| {
        let (turn, shift) = (turn * factor * 0.6, shift * factor * 0.4);
        let half = 0.5 * turn;
        // For angles so small the quaternion's real part is 1 before normalising.
        let q = DQuat::from_xyzw(half.x, half.y, half.z, 1.0).normalize();
        let (position, rotation) = (photo.position + shift, photo.rotation * DMat3::from_quat(q));
        let moved = Photo { position, rotation, ..photo.clone() };
        let (mut sum, mut count) = (0.0, 0.0);
        for place in &places {
            // Out of the picture, too.
            let project = |photo: &Photo| photo.camera.project(photo.rotation.transpose() * (*place - photo.position));
            if let (Some(a), Some(b)) = (project(photo), project(&moved)) {
                sum += a.distance_squared(b);
                count += 1.0;
            }
        }
        Given { position, rotation, error: if count > 0.0 { f64::sqrt(sum / count) } else { 0.0 } }
    };
    let mut factor = 1.0;
    let mut given = with(factor);
    for _ in 0..6 {
        if given.error <= 0.0 {
            break;
        }
        factor *= (pixels / given.error).clamp(0.2, 5.0);
        given = with(factor);
    }
    given
}
