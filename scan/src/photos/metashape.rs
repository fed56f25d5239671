//! Agisoft Metashape and PhotoScan: the XML file of "Export Cameras".
//!
//! A camera's `transform` takes its axes (those of [`kilwa_scan_core::camera`]) to the chunk; the chunk's transform (or
//! that of the camera's component) is a rotation, a
//! translation and a scale to the chunk's local system, or to geocentric coordinates if it has a geographic or projected one. A scale does not change what a camera sees, so it is
//! moved into the position: poses are in units of the coordinate system.
//!
//! Frame cameras: x' = x·(1 + K1·r² + … + K4·r⁸) + P1·(r² + 2x²) + 2·P2·x·y, y' with P1 and P2 exchanged (so P1 is p2 of OpenCV, and P2 is p1);
//! u = w/2 + cx + x'·f + x'·B1 + y'·B2, v = h/2 + cy + y'·f, where the centre of the upper left pixel is (0.5, 0.5). Fisheye
//! cameras: the same, with x and y multiplied by atan(r) / r. Spherical and cylindrical ones: longitude times f from the centre of the picture.
//!
//! PhotoScan before 1.2, and MeshLab, write fx, fy and the principal point itself as cx, cy.
//!
//! Source: "Agisoft Metashape User Manual, Professional Edition", appendix "Camera models"; the form of the files from those that MeshLab writes and from published files.

use super::xml::{Xml, child, size};
use super::{Contents, Missing, PhotoRecord};
use crate::ScanError;
use glam::{DMat3, DMat4, DVec2, DVec3, DVec4};
use kilwa_scan_core::{Camera, CameraModel, Distortion, Pose};
use roxmltree::Node;
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::path::Path;

/// A rotation, a translation and a scale.
#[derive(Clone, Copy)]
struct Similarity {
    rotation: DMat3,
    translation: DVec3,
    scale: f64,
}

impl Similarity {
    const IDENTITY: Self = Self { rotation: DMat3::IDENTITY, translation: DVec3::ZERO, scale: 1.0 };
}

/// Read a file of cameras.
pub(super) fn read(path: &Path) -> Result<Contents, ScanError> {
    let xml = Xml::open(path)?;
    let document = xml.parse()?;
    let root = document.root_element();
    let chunks: Vec<Node<'_, '_>> = root.children().filter(|node| node.has_tag_name("chunk")).collect();
    let [chunk] = chunks[..] else {
        let found = format!("{} chunks", chunks.len());
        return Err(xml.wrong(root, found, "one chunk; export the cameras of one chunk"));
    };
    let mut sensors = HashMap::new();
    for node in chunk.descendants().filter(|node| node.has_tag_name("sensor")) {
        sensors.insert(id(&xml, node, "id")?, sensor(&xml, node)?);
    }
    let own = child(chunk, "transform").map(|node| similarity(&xml, node)).transpose()?;
    let mut components = HashMap::new();
    for node in chunk.descendants().filter(|node| node.has_tag_name("component")) {
        if let Some(transform) = child(node, "transform") {
            components.insert(id(&xml, node, "id")?, similarity(&xml, transform)?);
        }
    }
    let mut contents = Contents::default();
    for node in chunk.descendants().filter(|node| node.has_tag_name("camera")) {
        contents.photos.push(camera(&xml, node, &sensors, own, &components)?);
    }
    let reference = child(chunk, "reference").and_then(|node| node.text()).map(str::trim);
    contents.crs = reference.filter(|text| !text.is_empty()).map(coordinates);
    Ok(contents)
}

/// The coordinates of the poses, for people. If the chunk has a geographic or projected system, its transform leads to geocentric coordinates, and
/// Metashape projects afterwards.
fn coordinates(reference: &str) -> String {
    if ["LOCAL_CS", "ENGCRS", "ENGINEERINGCRS"].iter().any(|kind| reference.starts_with(kind)) {
        return reference.to_owned();
    }
    let name = reference.split('"').nth(1).unwrap_or(reference);
    format!("geocentric (ECEF), metres; the coordinate system of the chunk is {name}")
}

fn id<'a>(xml: &Xml<'_>, node: Node<'a, '_>, name: &str) -> Result<&'a str, ScanError> {
    node.attribute(name)
        .ok_or_else(|| xml.wrong(node, format!("a {} without {name}", node.tag_name().name()), format!("{name}=\"…\"")))
}

fn camera(
    xml: &Xml<'_>,
    node: Node<'_, '_>,
    sensors: &HashMap<&str, Result<Camera, String>>,
    own: Option<Similarity>,
    components: &HashMap<&str, Similarity>,
) -> Result<PhotoRecord, ScanError> {
    let mut photo = PhotoRecord::named(id(xml, node, "label")?);
    let sensor = node.attribute("sensor_id").and_then(|id| sensors.get(id));
    photo.set_camera(sensor.cloned().unwrap_or_else(|| Err("its sensor is not in the file".to_owned())));
    if matches!(node.attribute("enabled"), Some("false" | "0")) {
        photo.missing.push(Missing::Disabled);
    }
    let Some(transform) = child(node, "transform") else {
        let is_of_rig = node.attribute("master_id").is_some();
        let why =
            if is_of_rig { "a camera of a rig without a transform of its own" } else { "not aligned by Metashape" };
        photo.set_pose(Err(Some(why.to_owned())));
        return Ok(photo);
    };
    let rows = xml.numbers::<16>(transform)?;
    let chunk_from_camera = DMat4::from_cols_array(&rows).transpose();
    let component = node.attribute("component_id").and_then(|id| components.get(id)).copied();
    let world = component.or(own).unwrap_or(Similarity::IDENTITY);
    let rotation = world.rotation * DMat3::from_mat4(chunk_from_camera);
    let position = world.rotation * chunk_from_camera.w_axis.truncate() * world.scale + world.translation;
    let last = chunk_from_camera.row(3);
    let mut world_from_camera = DMat4::from_mat3_translation(rotation, position);
    if last != DVec4::W {
        // Pose::from_matrix refuses it and says why.
        world_from_camera.x_axis.w = 1.0;
    }
    let (pose, _) = Pose::from_matrix(world_from_camera)
        .map_err(|e| xml.wrong(transform, e.to_string(), "a rotation and a translation"))?;
    photo.set_pose(Ok(pose.inverse()));
    Ok(photo)
}

fn similarity(xml: &Xml<'_>, node: Node<'_, '_>) -> Result<Similarity, ScanError> {
    let mut found = Similarity::IDENTITY;
    if let Some(rotation) = child(node, "rotation") {
        let rows = xml.numbers::<9>(rotation)?;
        found.rotation = DMat3::from_cols_array(&rows).transpose();
        let matrix = DMat4::from_mat3(found.rotation);
        Pose::from_matrix(matrix).map_err(|e| xml.wrong(rotation, e.to_string(), "a rotation"))?;
    }
    if let Some(translation) = child(node, "translation") {
        found.translation = DVec3::from_array(xml.numbers(translation)?);
    }
    if let Some(scale) = child(node, "scale") {
        let [value] = xml.numbers(scale)?;
        if value <= 0.0 {
            return Err(xml.wrong(scale, format!("a scale of {value}"), "a positive scale"));
        }
        found.scale = value;
    }
    Ok(found)
}

/// The camera of a sensor; or why there is none.
fn sensor(xml: &Xml<'_>, node: Node<'_, '_>) -> Result<Result<Camera, String>, ScanError> {
    let kind = node.attribute("type").unwrap_or("frame");
    let calibrations = || node.children().filter(|child| child.has_tag_name("calibration"));
    let adjusted = calibrations().find(|node| node.attribute("class") == Some("adjusted"));
    let calibration = adjusted.or_else(|| calibrations().next());
    let resolution = calibration.and_then(|node| child(node, "resolution")).or_else(|| child(node, "resolution"));
    let Some(resolution) = resolution else {
        return Ok(Err("the sensor has no resolution".to_owned()));
    };
    let pixels = [xml.attribute::<1>(resolution, "width")?[0], xml.attribute::<1>(resolution, "height")?[0]];
    let pixels = size(pixels).ok_or_else(|| {
        xml.wrong(resolution, format!("a resolution of {} × {}", pixels[0], pixels[1]), "positive whole numbers")
    })?;
    let kind = calibration.and_then(|node| node.attribute("type")).unwrap_or(kind);
    if kind == "spherical" && calibration.is_none() {
        return Ok(Camera::equirectangular(pixels).map_err(|e| e.to_string()));
    }
    let values = match calibration {
        Some(node) => Values::read(xml, node)?,
        None if kind == "cylindrical" => Values::default(),
        None => return Ok(Err("the sensor was not calibrated".to_owned())),
    };
    Ok(values.model(kind, pixels).and_then(|model| Camera::new(pixels, model).map_err(|e| e.to_string())))
}

/// The numbers of a calibration; what is not in it is 0.
#[derive(Default)]
struct Values {
    f: Option<f64>,
    /// fx and fy of old files.
    old: Option<[f64; 2]>,
    center: [f64; 2],
    b: [f64; 2],
    k: [f64; 4],
    p: [f64; 4],
    /// `skew` of old files.
    skew: f64,
}

impl Values {
    fn read(xml: &Xml<'_>, node: Node<'_, '_>) -> Result<Self, ScanError> {
        let get = |name: &str| xml.child_number(node, name);
        let or_zero = |name: &str| Ok::<f64, ScanError>(get(name)?.unwrap_or(0.0));
        Ok(Self {
            f: get("f")?,
            old: get("fx")?.zip(get("fy")?).map(|(fx, fy)| [fx, fy]),
            center: [or_zero("cx")?, or_zero("cy")?],
            b: [or_zero("b1")?, or_zero("b2")?],
            k: [or_zero("k1")?, or_zero("k2")?, or_zero("k3")?, or_zero("k4")?],
            p: [or_zero("p1")?, or_zero("p2")?, or_zero("p3")?, or_zero("p4")?],
            skew: or_zero("skew")?,
        })
    }

    fn model(&self, kind: &str, pixels: [u32; 2]) -> Result<CameraModel, String> {
        let middle = DVec2::from_array(pixels.map(f64::from)) * 0.5;
        let offset = DVec2::from_array(self.center);
        if self.p[2] != 0.0 || self.p[3] != 0.0 {
            return Err("the coefficients P3 and P4 of Metashape are not supported; calibrate without them".to_owned());
        }
        let (focal, center, skew) = match (self.f, self.old) {
            (Some(f), _) => (DVec2::new(f + self.b[0], f), middle + offset, self.b[1]),
            (None, Some(old)) if self.p == [0.0; 4] => (DVec2::from_array(old), offset, self.skew),
            (None, Some(_)) => {
                return Err(
                    "tangential distortion of PhotoScan before 1.2 is not supported; export with Metashape".to_owned()
                );
            }
            (None, None) if kind == "cylindrical" || kind == "spherical" => {
                (DVec2::splat(f64::from(pixels[0]) / TAU), middle, 0.0)
            }
            (None, None) => return Err("the calibration has no focal length".to_owned()),
        };
        let p = [self.p[1], self.p[0]];
        match kind {
            "frame" => Ok(CameraModel::Pinhole { focal, center, skew, distortion: Distortion::Brown { k: self.k, p } }),
            "fisheye" | "equidistant_fisheye" => {
                Ok(CameraModel::Pinhole { focal, center, skew, distortion: Distortion::Fisheye { k: self.k, p } })
            }
            "spherical" => Ok(CameraModel::Equirectangular { scale: focal, center }),
            "cylindrical" => Ok(CameraModel::Cylindrical { scale: focal, center }),
            _ => Err(format!("the sensor type {kind} is not supported")),
        }
    }
}
