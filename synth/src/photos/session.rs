//! A photo session: cameras, light and people at the fort, and the ground truth about them.

use super::colmap::{Given, Model};
use super::develop::{Exposure, develop};
use super::light::{self, RELIEF, Sky};
use super::people::Crowd;
use super::place::{self, Carrier, Placed};
use super::view::{Eye, View, What, reflectance};
use super::{PhotoError, PhotoOptions};
use crate::fort::scene::{Beam, Scene};
use crate::noise::{derive, hash2, normal, unit};
use crate::scans::props::{Prop, Props, Shape};
use crate::scans::{figures, stations};
use glam::{DMat3, DQuat, DVec2, DVec3};
use kilwa_scan_core::camera::{Camera, CameraError, Distortion, PosedCamera};
use kilwa_scan_core::pose::Pose;
use rayon::prelude::*;

/// Visibility is tested at points this far in front of the surface, in metres, because rays end slightly in front of what they hit.
const BEFORE: f64 = 0.004;
/// A point counts as on the surface if it is within this distance of it, in metres.
const REACH: f64 = 0.15;
/// A point counts as on a bar of a grille if it is within this distance of it, in metres.
const BAR_REACH: f64 = 0.012;
/// Light that a photographer aims for: the mean (of logarithms) over the surface, as a share of white.
const AIM: f64 = 0.14;
/// Rays across and down with which the light is metered.
const METER: [u32; 2] = [20, 15];

/// A photograph or a panorama, in the site's frame (metres, z up).
#[derive(Debug, Clone, PartialEq)]
pub struct Photo {
    /// The name of its file without extension: `IMG_0001`, or the station's name for a panorama.
    pub name: String,
    /// Who holds the camera.
    pub carrier: Carrier,
    /// The camera.
    pub camera: Camera,
    /// Where it is.
    pub position: DVec3,
    /// `site_from_camera`; the camera's axes are x right, y down, z forward.
    pub rotation: DMat3,
    /// Local solar time, in hours.
    pub hour: f64,
    /// Azimuth of the sun from north over east, and its elevation, in radians.
    pub sun: (f64, f64),
    /// How it was exposed.
    pub exposure: Exposure,
}

impl Photo {
    /// The camera with its true pose.
    pub fn posed(&self) -> PosedCamera {
        let rotation = DQuat::from_mat3(&self.rotation.transpose()).normalize();
        let camera_from_world = Pose { rotation, translation: -(rotation * self.position) };
        PosedCamera { camera: self.camera, camera_from_world }
    }

    /// Width and height, in pixels.
    pub fn size(&self) -> (u32, u32) {
        self.camera.size().into()
    }

    /// The pixel of a point of the site; `None` if it is outside the picture. Occlusion is ignored.
    pub fn project(&self, place: DVec3) -> Option<DVec2> {
        self.camera.project(self.rotation.transpose() * (place - self.position)).filter(|at| self.camera.contains(*at))
    }

    pub(super) fn eye(&self) -> Eye<'_> {
        let axis = |k: usize| Scene::from_site(self.rotation.col(k));
        Eye {
            position: Scene::from_site(self.position),
            rotation: DMat3::from_cols(axis(0), axis(1), axis(2)),
            camera: &self.camera,
        }
    }

    pub(super) fn sun_in_fort(&self) -> DVec3 {
        Scene::from_site(light::towards(self.sun))
    }
}

/// A place of the true surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// In the site's frame, metres.
    pub position: DVec3,
    /// Outward unit normal, from differences over 2 cm.
    pub normal: DVec3,
    /// Linear reflectance in red, green and blue, from 0 to 1.
    pub albedo: [f64; 3],
}

/// The fort, the photographs, and the people in each of them. Coordinates are those of the site.
pub struct Session {
    scene: Scene,
    sky: Sky,
    bars: Vec<Prop>,
    grilles: Props,
    photos: Vec<Photo>,
    people: Vec<Props>,
}

impl Session {
    /// Place the cameras and the people, as [`super::write`] does with the same options: first the photographs, then the panoramas.
    ///
    /// # Errors
    /// [`PhotoError::Count`], [`PhotoError::Size`], [`PhotoError::Value`] and [`PhotoError::Places`].
    pub fn new(options: &PhotoOptions) -> Result<Self, PhotoError> {
        options.check()?;
        let scene = Scene::new(options.seed);
        let bars = figures::grilles(&scene);
        let mut session = Self {
            grilles: Props::new(bars.clone()),
            sky: Sky::new(),
            bars,
            photos: Vec::new(),
            people: Vec::new(),
            scene,
        };
        session.photos = session.placed(options)?;
        let scene = &session.scene;
        let mut crowd = Crowd::new(options.seed, options.passers_by / 100.0);
        session.people = session.photos.iter().map(|photo| Props::new(crowd.next(scene, &photo.eye()))).collect();
        let exposures: Vec<f64> =
            (0..session.photos.len()).into_par_iter().map(|k| session.metered(k, options)).collect();
        for (photo, ev) in session.photos.iter_mut().zip(exposures) {
            photo.exposure.ev = ev;
        }
        Ok(session)
    }

    fn placed(&self, options: &PhotoOptions) -> Result<Vec<Photo>, PhotoError> {
        let enough = |what, found: usize, asked: u32| {
            if found == asked as usize { Ok(()) } else { Err(PhotoError::Places { what, found: found as u32, asked }) }
        };
        let (width, height) = options.size;
        let aspect = f64::from(height) / f64::from(width);
        let places = if options.photos == 0 {
            Vec::new()
        } else {
            place::places(&self.scene, options.seed, options.photos, aspect)
        };
        enough("photographs", places.len(), options.photos)?;
        let stations = if options.panoramas == 0 {
            Vec::new()
        } else {
            stations::stations(&self.scene, options.seed, options.panoramas)
        };
        enough("panoramas", stations.len(), options.panoramas)?;
        let seed = derive(options.seed, 0xf4);
        let invalid = |_: CameraError| PhotoError::Size { width, height };
        let mut photos = Vec::new();
        for (k, placed) in places.iter().enumerate() {
            let Placed { eye, rotation, carrier } = *placed;
            let axis = |k: usize| Scene::to_site(rotation.col(k));
            let (hour, exposure) = taken(options, seed, k, places.len(), carrier);
            photos.push(Photo {
                name: format!("IMG_{:04}", k + 1),
                carrier,
                camera: lens(carrier, options.size).map_err(invalid)?,
                position: Scene::to_site(eye),
                rotation: DMat3::from_cols(axis(0), axis(1), axis(2)),
                hour,
                sun: light::sun_at(hour),
                exposure,
            });
        }
        for (k, station) in stations.iter().enumerate() {
            let axis = |v: DVec3| station.rotation * v;
            let (hour, exposure) = taken(options, derive(seed, 1), k, stations.len(), Carrier::Tripod);
            photos.push(Photo {
                name: format!("scan_{:03}", station.number),
                carrier: Carrier::Tripod,
                camera: Camera::equirectangular([2 * width, width]).map_err(invalid)?,
                position: station.position,
                // The middle of the picture looks along the scan's x axis.
                rotation: DMat3::from_cols(axis(-DVec3::Y), axis(-DVec3::Z), axis(DVec3::X)),
                hour,
                sun: light::sun_at(hour),
                exposure,
            });
        }
        Ok(photos)
    }

    /// Exposure in stops: partly from the photographer's light meter, partly random, within the limits of the options.
    fn metered(&self, number: usize, options: &PhotoOptions) -> f64 {
        let view = self.view(number);
        let photo = &self.photos[number];
        let (width, height) = photo.size();
        let mut near = Vec::new();
        let (mut sum, mut count) = (0.0, 0.0);
        for k in 0..METER[0] * METER[1] {
            let at = |i: u32, n: u32, side: u32| (f64::from(i) + 0.5) * f64::from(side) / f64::from(n);
            let (x, y) = (at(k % METER[0], METER[0], width), at(k / METER[0], METER[1], height));
            let Some(d) = view.eye.ray(x, y) else { continue };
            let texel = view.trace(d, &mut near);
            if matches!(texel.what, What::Ground | What::Masonry) {
                let value = f64::from(texel.light[1]) * photo.exposure.factor(x, y, (width, height))[1];
                sum += libm::log2(value.max(1e-4));
                count += 1.0;
            }
        }
        let wanted = if count > 0.0 { libm::log2(AIM) - sum / count } else { 0.0 };
        let chance = 2.0 * unit(hash2(derive(options.seed, 0xf5), number as i64, 0), 0) - 1.0;
        let limit = options.exposure;
        (0.6 * wanted.clamp(-1.5 * limit, 1.5 * limit) + 0.75 * limit * chance).clamp(-limit, limit)
    }

    /// The photographs, then the panoramas.
    pub fn photos(&self) -> &[Photo] {
        &self.photos
    }

    pub(super) fn view(&self, number: usize) -> View<'_> {
        let photo = &self.photos[number];
        View {
            scene: &self.scene,
            sky: &self.sky,
            bars: &self.grilles,
            people: &self.people[number],
            eye: photo.eye(),
            sun: photo.sun_in_fort(),
        }
    }

    /// The bytes of a photograph before it is compressed: sRGB, rows from the top, three bytes per pixel. `options`: those of the session.
    ///
    /// # Panics
    /// If there is no photograph of this number.
    pub fn picture(&self, number: usize, options: &PhotoOptions) -> Vec<u8> {
        let photo = &self.photos[number];
        let rendered = self.view(number).render(&mut |_| {});
        let seed = hash2(derive(options.seed, 0xf8), number as i64, 0);
        develop(&rendered.light, photo.size(), &photo.exposure, options.noise, seed)
    }

    /// The poses of the photographs (without the panoramas) as [`super::write`] gives them with the same options, but in the site's frame: with the error of
    /// poses, and the number of pixels by which what is seen is shifted by it (root mean square).
    pub fn disturbed(&self, options: &PhotoOptions) -> Vec<(PosedCamera, f64)> {
        let given = Model::new(self, options).given;
        let posed = |(given, photo): (&Given, &Photo)| {
            let rotation = DQuat::from_mat3(&given.rotation.transpose()).normalize();
            let camera_from_world = Pose { rotation, translation: -(rotation * given.position) };
            (PosedCamera { camera: photo.camera, camera_from_world }, given.error)
        };
        given.iter().zip(&self.photos).map(posed).collect()
    }

    /// The true surface at a place that is within 15 cm of it, such as a vertex of a mesh; nothing elsewhere. Grilles count.
    pub fn surface_at(&self, place: DVec3) -> Option<Place> {
        let mut p = Scene::from_site(place);
        if let Some(bar) = self.bar_at(p) {
            let normal = bar.shape.normal(p);
            if let Shape::Capsule { a, b, radius } = bar.shape {
                p = on_axis(p, a, b) + normal * radius;
            }
            let (position, normal) = (Scene::to_site(p), Scene::to_site(normal));
            return Some(Place { position, normal, albedo: reflectance(bar.color) });
        }
        let from = p;
        let on_ground = self.scene.is_ground(p);
        let value = |p| self.scene.value_of(p, on_ground);
        for _ in 0..12 {
            let here = value(p);
            if here.abs() < 2e-5 || here.abs() > 4.0 * REACH || here.is_nan() {
                break;
            }
            let normal = self.scene.normal(p, on_ground, 0.004);
            // The slope of the field along its normal.
            let step = 1e-3;
            let slope = ((value(p + normal * step) - value(p - normal * step)) / (2.0 * step)).max(0.4);
            p -= normal * (here / slope).clamp(-0.05, 0.05);
        }
        if !(value(p).abs() < 1e-3 && p.distance(from) <= REACH) {
            return None;
        }
        let normal = self.scene.normal(p, on_ground, RELIEF);
        let albedo = reflectance(self.scene.albedo(p, normal, on_ground));
        Some(Place { position: Scene::to_site(p), normal: Scene::to_site(normal), albedo })
    }

    fn bar_at(&self, p: DVec3) -> Option<&Prop> {
        self.bars.iter().find(|bar| match bar.shape {
            Shape::Capsule { a, b, radius } => (p.distance(on_axis(p, a, b)) - radius).abs() < BAR_REACH,
            Shape::Plank { .. } => false,
        })
    }

    /// Linear reflectance (red, green, blue, from 0 to 1) of the true surface at a place that is within 15 cm of it.
    pub fn albedo_at(&self, place: DVec3) -> Option<[f64; 3]> {
        Some(self.surface_at(place)?.albedo)
    }

    /// Light on a place of the surface when the sun is at an azimuth (from north over east) and an elevation, in radians: what reflectance is multiplied by
    /// before exposure.
    pub fn light_at(&self, place: &Place, sun: (f64, f64)) -> [f64; 3] {
        let [p, normal, sun] = [place.position, place.normal, light::towards(sun)].map(Scene::from_site);
        light::light(&self.scene, &self.sky, p, normal, sun)
    }

    /// Whether a photograph shows a place that is within 15 cm of the surface, apart from people: it is in the picture, faces the camera, and neither fort nor
    /// grilles are in front of it.
    ///
    /// # Panics
    /// If there is no photograph of this number.
    pub fn is_seen(&self, number: usize, place: DVec3) -> bool {
        self.surface_at(place).is_some_and(|surface| self.sees(number, &surface))
    }

    /// As [`Self::is_seen`], for a place of the true surface.
    ///
    /// # Panics
    /// If there is no photograph of this number.
    pub fn sees(&self, number: usize, surface: &Place) -> bool {
        let photo = &self.photos[number];
        let before = surface.position + surface.normal * BEFORE;
        let offset = before - photo.position;
        if offset.dot(surface.normal) >= 0.0 || photo.project(surface.position).is_none() {
            return false;
        }
        let range = offset.length();
        let (eye, d) = (Scene::from_site(photo.position), Scene::from_site(offset / range));
        !is_met(&self.grilles, eye, d, range) && self.scene.hit(eye, d, 0.0, range).is_none()
    }

    /// Whether people stand between a photograph's camera and a place.
    ///
    /// # Panics
    /// If there is no photograph of this number.
    pub fn is_behind_people(&self, number: usize, place: DVec3) -> bool {
        let photo = &self.photos[number];
        let offset = place - photo.position;
        let range = offset.length();
        let (eye, d) = (Scene::from_site(photo.position), Scene::from_site(offset / range));
        is_met(&self.people[number], eye, d, range)
    }

    /// The point of the surface that a picture shows at a pixel, ignoring people; `None` for the sky.
    ///
    /// # Panics
    /// If there is no photograph of this number.
    pub fn shown_at(&self, number: usize, pixel: DVec2) -> Option<Place> {
        let eye = self.photos[number].eye();
        let d = eye.ray(pixel.x, pixel.y)?;
        let hit = self.scene.hit(eye.position, d, 0.0, super::view::FAR)?;
        self.surface_at(Scene::to_site(eye.position + d * hit.t))
    }

    /// Distance from a place to the nearest masonry, at most 0.3 m and a little too small; negative inside.
    pub fn clearance(&self, place: DVec3) -> f64 {
        self.scene.masonry_distance(Scene::from_site(place))
    }
}

fn is_met(props: &Props, o: DVec3, d: DVec3, to: f64) -> bool {
    let mut near = Vec::new();
    props.near(o, d, to, Beam { exit: 0.0, spread: 0.0 }, &mut near);
    near.iter().any(|k| props.get(*k).shape.meet(o, d).is_some_and(|t| t < to))
}

fn on_axis(p: DVec3, a: DVec3, b: DVec3) -> DVec3 {
    let axis = b - a;
    a + axis * ((p - a).dot(axis) / axis.length_squared().max(1e-12)).clamp(0.0, 1.0)
}

/// When photograph `k` of `count` was taken, and how, apart from the exposure in stops.
fn taken(options: &PhotoOptions, seed: u64, k: usize, count: usize, carrier: Carrier) -> (f64, Exposure) {
    let share = if count > 1 { k as f64 / (count - 1) as f64 } else { 0.5 };
    let off = |channel| 1.0 + 0.03 * normal(hash2(seed, k as i64, channel));
    let vignette = Exposure::vignette_of(carrier);
    let exposure = Exposure { ev: 0.0, white_balance: [off(1), 1.0, off(2)], vignette };
    (light::MIDDLE + options.hours * (share - 0.5), exposure)
}

/// The camera that is carried: Brown's distortion as calibrations find it.
fn lens(carrier: Carrier, (width, height): (u32, u32)) -> Result<Camera, CameraError> {
    let long = f64::from(width.max(height));
    let (k, p, off) = match carrier {
        Carrier::Hand => ([-0.118, 0.072, 0.0, 0.0], [0.000_6, -0.000_4], DVec2::new(0.006, -0.004)),
        _ => ([0.031, -0.044, 0.0, 0.0], [-0.000_3, 0.000_5], DVec2::new(-0.003, 0.005)),
    };
    let focal = DVec2::splat(carrier.focal() * long);
    let center = DVec2::new(f64::from(width), f64::from(height)) * 0.5 + off * long;
    Camera::pinhole([width, height], focal, center, Distortion::Brown { k, p })
}
