//! MeshLab: the rasters of a project (`.mlp`), and the camera that it copies as text (an XML file with one `VCGCamera`).
//!
//! RotationMatrix has the axes of the camera as rows (x right, y up, z backwards), TranslationVector is the negative position. Pixels are FocalMm /
//! PixelSizeMm; CenterPx is measured from the *lower* left corner, as the y axis points up.
//!
//! Source: VCGlib, `vcg/math/camera.h`, `vcg/math/shot.h` and `wrap/io_trimesh` (read as documentation of the format).

use super::xml::{Xml, size};
use super::{Contents, PhotoRecord};
use crate::ScanError;
use glam::{DMat3, DMat4, DVec2, DVec3};
use kilwa_scan_core::{Camera, Distortion, Pose};
use roxmltree::Node;
use std::path::Path;

/// Read the cameras of a file.
pub(super) fn read(path: &Path) -> Result<Contents, ScanError> {
    let xml = Xml::open(path)?;
    let document = xml.parse()?;
    let mut contents = Contents::default();
    for node in document.descendants().filter(|node| node.has_tag_name("VCGCamera")) {
        let raster = node.parent().filter(|parent| parent.has_tag_name("MLRaster"));
        let plane = raster.and_then(|raster| raster.children().find(|child| child.has_tag_name("Plane")));
        let name = plane.and_then(|plane| plane.attribute("fileName")).or_else(|| raster?.attribute("label"));
        // A camera file that is not a project belongs to the picture of the same name.
        let own = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let mut photo = PhotoRecord::named(name.filter(|name| !name.is_empty()).map_or(own, str::to_owned));
        photo.set_camera(camera(&xml, node)?);
        photo.set_pose(Ok(pose(&xml, node)?));
        contents.photos.push(photo);
    }
    Ok(contents)
}

fn pose(xml: &Xml<'_>, node: Node<'_, '_>) -> Result<Pose, ScanError> {
    if node.attribute("BinaryData").is_some_and(|value| value != "0") {
        return Err(xml.wrong(node, "a camera in binary form", "a project saved as text"));
    }
    let rows = xml.attribute::<16>(node, "RotationMatrix")?;
    let [x, y, z, _] = xml.attribute::<4>(node, "TranslationVector")?;
    let position = -DVec3::new(x, y, z);
    // Turned about x, so that y points down and z forward.
    let flip = DVec3::new(1.0, -1.0, -1.0);
    let rotation = DMat3::from_diagonal(flip) * DMat3::from_mat4(DMat4::from_cols_array(&rows)).transpose();
    let matrix = DMat4::from_mat3_translation(rotation, -(rotation * position));
    let (pose, _) = Pose::from_matrix(matrix)
        .map_err(|e| xml.wrong(node, format!("{e} in RotationMatrix"), "a rotation matrix, row by row"))?;
    Ok(Pose { translation: -(pose.rotation * position), ..pose })
}

/// The camera; or why there is none.
fn camera(xml: &Xml<'_>, node: Node<'_, '_>) -> Result<Result<Camera, String>, ScanError> {
    let viewport = xml.attribute::<2>(node, "ViewportPx")?;
    let [focal] = xml.attribute(node, "FocalMm")?;
    let [width, height] = xml.attribute(node, "PixelSizeMm")?;
    let [x, y] = xml.attribute(node, "CenterPx")?;
    let distortion =
        node.attribute("LensDistortion").map_or(Ok([0.0; 2]), |_| xml.attribute(node, "LensDistortion"))?;
    let pixels = size(viewport).ok_or_else(|| {
        xml.wrong(node, format!("a ViewportPx of {} × {}", viewport[0], viewport[1]), "positive whole numbers")
    })?;
    if distortion != [0.0; 2] {
        return Ok(Err("the lens distortion of MeshLab is not supported; undistort the picture".to_owned()));
    }
    if node.attribute("CameraType").is_some_and(|kind| kind != "0") {
        return Ok(Err("only perspective cameras of MeshLab are supported".to_owned()));
    }
    let center = DVec2::new(x, f64::from(pixels[1]) - y);
    let focal = DVec2::new(focal / width, focal / height);
    Ok(Camera::pinhole(pixels, focal, center, Distortion::None).map_err(|e| e.to_string()))
}
