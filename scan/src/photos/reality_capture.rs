//! XMP sidecars of RealityCapture and RealityScan: `NAME.xmp` beside each picture.
//!
//! x = R·(X − Position) with the axes of [`kilwa_scan_core::camera`]; R is stored row by row. Lengths in the picture
//! are relative to its longer side: the focal length is that times
//! FocalLength35mm / 36, the principal point is (PrincipalPointU, PrincipalPointV) from the centre. DistortionCoeficients (so spelled) are k1 k2 k3 k4 t1 t2
//! of Brown's model; t1 and t2 are p1 and p2 of OpenCV.
//!
//! Sources: "RealityCapture XMP Camera Math" (<https://support.capturingreality.com/hc/en-us/articles/360017783459>); "Camera model equations"
//! in Epic's forum (<https://forums.unrealengine.com/t/707399>) for the order of the coefficients.

use super::folder::Folder;
use super::xml::{Xml, child};
use super::{Contents, PhotoRecord, picture, sniff};
use crate::ScanError;
use glam::{DMat3, DMat4, DVec2, DVec3};
use kilwa_scan_core::{Camera, CameraModel, Distortion, Pose};
use roxmltree::Node;
use std::path::Path;

/// The namespace of its properties.
pub(super) const NAMESPACE: &str = "http://www.capturingreality.com/ns/xcr/1.1#";

/// Read the sidecars in `at`, which need not lie in the folder of the pictures.
pub(super) fn read(at: &Path, folder: &Folder) -> Result<Contents, ScanError> {
    let mut contents = Contents::default();
    let sidecars = Folder::walk(at)?;
    for path in sidecars.others.iter().filter(|path| is_sidecar(path)) {
        let name = sidecars.relative(&path.with_extension(""));
        contents.photos.extend(one(path, name, folder)?);
    }
    Ok(contents)
}

pub(super) fn is_sidecar(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("xmp"))
}

/// The photograph of a sidecar; None if other programs wrote it.
fn one(path: &Path, name: String, folder: &Folder) -> Result<Option<PhotoRecord>, ScanError> {
    if !sniff::contains(path, NAMESPACE)? {
        return Ok(None);
    }
    let xml = Xml::open(path)?;
    let document = xml.parse()?;
    let has_own = |node: &Node<'_, '_>| {
        node.attributes().any(|a| a.namespace() == Some(NAMESPACE))
            || node.children().any(|c| c.tag_name().namespace() == Some(NAMESPACE))
    };
    let Some(node) = document.descendants().find(has_own) else { return Ok(None) };
    let mut photo = PhotoRecord::named(name);
    let size = folder.find(&photo.name).ok().and_then(|at| picture::read(&folder.pictures[at]).ok()).map(|p| p.size);
    photo.set_camera(camera(&xml, node, size)?);
    photo.set_pose(pose(&xml, node)?.ok_or(None));
    Ok(Some(photo))
}

/// A property: an attribute or an element.
fn text<'a>(node: Node<'a, '_>, name: &str) -> Option<&'a str> {
    let element = || node.children().find(|child| child.has_tag_name((NAMESPACE, name))).and_then(|child| child.text());
    node.attribute((NAMESPACE, name)).or_else(element)
}

fn property<const N: usize>(xml: &Xml<'_>, node: Node<'_, '_>, name: &str) -> Result<Option<[f64; N]>, ScanError> {
    let place = child(node, name).unwrap_or(node);
    text(node, name).map(|text| xml.parse_numbers(place, name, text)).transpose()
}

fn pose(xml: &Xml<'_>, node: Node<'_, '_>) -> Result<Option<Pose>, ScanError> {
    let (rotation, position) = (property::<9>(xml, node, "Rotation")?, property::<3>(xml, node, "Position")?);
    let Some((rows, position)) = rotation.zip(position) else { return Ok(None) };
    let rotation = DMat3::from_cols_array(&rows).transpose();
    let translation = -(rotation * DVec3::from_array(position));
    let (pose, _) = Pose::from_matrix(DMat4::from_mat3_translation(rotation, translation))
        .map_err(|e| xml.wrong(node, format!("{e} in Rotation and Position"), "a rotation matrix, row by row"))?;
    Ok(Some(Pose { translation: -(pose.rotation * DVec3::from_array(position)), ..pose }))
}

/// The camera; or why there is none.
fn camera(xml: &Xml<'_>, node: Node<'_, '_>, size: Option<[u32; 2]>) -> Result<Result<Camera, String>, ScanError> {
    let number = |name: &str| property::<1>(xml, node, name).map(|found| found.map(|[value]| value));
    let coefficients = property::<6>(xml, node, "DistortionCoeficients")?.unwrap_or_default();
    let skew = number("Skew")?.unwrap_or(0.0);
    let aspect = number("AspectRatio")?.unwrap_or(1.0);
    let center = [number("PrincipalPointU")?.unwrap_or(0.0), number("PrincipalPointV")?.unwrap_or(0.0)];
    let Some(focal) = number("FocalLength35mm")? else {
        return Ok(Err("the sidecar has no FocalLength35mm".to_owned()));
    };
    let distortion = match distortion(text(node, "DistortionModel").unwrap_or("brown3"), coefficients) {
        Ok(distortion) => distortion,
        Err(why) => return Ok(Err(why)),
    };
    let Some(size) = size else { return Ok(Err("the size of the picture is unknown".to_owned())) };
    if skew != 0.0 {
        return Ok(Err("skew is not supported".to_owned()));
    }
    let longer = f64::from(size[0].max(size[1]));
    let focal = focal / 36.0 * longer;
    let model = CameraModel::Pinhole {
        focal: DVec2::new(focal, focal * aspect),
        center: DVec2::from_array(size.map(f64::from)) * 0.5 + DVec2::from_array(center) * longer,
        skew,
        distortion,
    };
    Ok(Camera::new(size, model).map_err(|e| e.to_string()))
}

fn distortion(model: &str, [k1, k2, k3, k4, t1, t2]: [f64; 6]) -> Result<Distortion, String> {
    let is_brown = ["brown3", "brown4", "brown3t2", "brown4t2"].contains(&model);
    match model {
        "perspective" => Ok(Distortion::None),
        _ if [k1, k2, k3, k4, t1, t2] == [0.0; 6] => Ok(Distortion::None),
        _ if is_brown => Ok(Distortion::Brown { k: [k1, k2, k3, k4], p: [t1, t2] }),
        _ => Err(format!("the distortion model {model} is not supported; export with a Brown model")),
    }
}
