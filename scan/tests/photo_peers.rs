//! Files with poses that other programs write: pycolmap and pymeshlab, where Python has them. Points are seen where those programs see them.

use crate::peers::{has, python};
use crate::support::Site;
use glam::{DVec2, DVec3};
use kilwa_scan::photos::{Options, PhotoSet, Source, read};
use serde_json::Value;
use std::path::Path;

/// Has another program write files of this kind into a folder.
fn written(kind: &str) -> Site {
    let site = Site::new();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/photo_peers.py");
    let output = python().arg(script).arg(kind).arg(site.path("")).output().unwrap();
    assert!(output.status.success(), "{kind}: {}", String::from_utf8_lossy(&output.stderr));
    site
}

fn photos(site: &Site, poses: &str) -> PhotoSet {
    let path = site.path(poses);
    read(&site.path(""), &Options { poses: Some(&path), stations: &[] }).unwrap()
}

fn vector(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect()
}

/// The largest distance from where the other program sees its points, pixels; how many were compared; models without a camera here.
fn compare(site: &Site, set: &PhotoSet) -> (f64, usize, Vec<String>) {
    let truth: Value = serde_json::from_slice(&std::fs::read(site.path("truth.json")).unwrap()).unwrap();
    let (mut worst, mut compared, mut without): (f64, usize, Vec<String>) = (0.0, 0, Vec::new());
    for expected in truth.as_array().unwrap() {
        let name = expected["name"].as_str().unwrap();
        let photo = set.photos.iter().find(|photo| photo.name == name).unwrap_or_else(|| panic!("no {name}"));
        let Some(posed) = photo.posed() else {
            without.push(expected["model"].as_str().unwrap().to_owned());
            continue;
        };
        for (point, pixel) in expected["points"].as_array().unwrap().iter().zip(expected["pixels"].as_array().unwrap())
        {
            let found = posed.project(DVec3::from_slice(&vector(point))).unwrap();
            worst = worst.max(found.distance(DVec2::from_slice(&vector(pixel))));
            compared += 1;
        }
    }
    (worst, compared, without)
}

#[test]
fn pycolmap_sees_the_same_pixels_in_every_model_as_text_and_binary() {
    if !has("pycolmap") {
        return;
    }
    let site = written("colmap");
    let both = read(&site.path(""), &Options::default()).unwrap_err().to_string();
    for part in ["text", "binary", "--poses"] {
        assert!(both.contains(part), "{both}");
    }
    for poses in ["text", "binary/cameras.bin"] {
        let set = photos(&site, poses);
        let (worst, compared, without) = compare(&site, &set);
        println!("{poses}: {compared} points, largest distance {worst:.1e} pixels");
        assert!(worst < 1e-6, "{poses}: {worst}");
        assert_eq!((compared, without.as_slice()), (13 * 40, &["FOV".to_owned()][..]));
        assert_eq!(set.sparse_points.len(), 3);
        assert_eq!((set.sparse_points[1].color, set.sparse_points[1].seen), ([10, 20, 31], 2));
        for photo in &set.photos {
            assert!(matches!(&photo.source, Source::File(path) if path.ends_with(&photo.name)), "{photo:?}");
            let missing: Vec<String> = photo.missing.iter().map(ToString::to_string).collect();
            let expected: &[&str] =
                if photo.camera.is_none() { &["no calibration: the camera model FOV is not supported"] } else { &[] };
            assert_eq!(missing, expected);
        }
    }
}

#[test]
fn pycolmap_sees_the_same_pixels_in_rigs() {
    if !has("pycolmap") {
        return;
    }
    let site = written("rig");
    for poses in ["text", "binary"] {
        let set = photos(&site, poses);
        let (worst, compared, without) = compare(&site, &set);
        println!("{poses}: {compared} points, largest distance {worst:.1e} pixels");
        assert!(worst < 1e-6 && compared > 200 && without.is_empty(), "{poses}: {worst}, {compared}");
        assert_eq!((set.photos.len(), set.sparse_points.len()), (12, 30));
        assert!(set.photos.iter().all(|photo| photo.source == Source::Missing));
    }
}

/// MeshLab keeps single precision and writes six digits.
#[test]
fn meshlab_writes_the_cameras_of_colmap_as_its_project_for_bundler_and_for_photoscan() {
    if !has("pymeshlab") || !has("pycolmap") {
        return;
    }
    let site = written("meshlab");
    for poses in ["images/in.out", "images/project.mlp", "images/meshlab.out", "images/meshlab.xml"] {
        let set = photos(&site, poses);
        let (worst, compared, without) = compare(&site, &set);
        println!("{poses}: {compared} points, largest distance {worst:.1e} pixels");
        assert!(worst < 2e-3 && compared == 160 && without.is_empty(), "{poses}: {worst}, {without:?}");
    }
}
