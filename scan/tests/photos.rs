//! Photographs: readers of files with poses, by samples written from the formats' documentation; how pictures are found; what is reported as missing; damaged files.

use crate::support::Site;
use glam::{DVec2, DVec3};
use kilwa_scan::photos::{Format, Frame, Missing, Options, PhotoRecord, PhotoSet, Source, extract, of_survey, read};
use kilwa_scan::survey::{self, Survey};
use kilwa_scan_core::CameraModel;
use std::path::Path;

/// A PNG of this size, whose pixels nothing here decodes.
fn png(site: &Site, name: &str, [width, height]: [u32; 2]) {
    let path = site.path(name);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::One);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&vec![0; (width.div_ceil(8) * height) as usize]).unwrap();
    writer.finish().unwrap();
    std::fs::write(path, bytes).unwrap();
}

/// Write a file that is there anew. Some file systems wait for the disk where a file is only truncated and written again.
fn rewrite(site: &Site, name: &str, bytes: &[u8]) {
    std::fs::remove_file(site.path(name)).unwrap();
    site.write(name, bytes);
}

fn folder(site: &Site) -> PhotoSet {
    read(&site.path(""), &Options::default()).unwrap()
}

fn missing(photo: &PhotoRecord) -> Vec<String> {
    photo.missing.iter().map(ToString::to_string).collect()
}

fn near(a: DVec2, b: [f64; 2]) {
    assert!(a.distance(DVec2::from_array(b)) < 1e-9, "{a} {b:?}");
}

const COLMAP_CAMERAS: &str = "# Camera list\n1 PINHOLE 40 30 50 50 20 15\n2 FOV 40 30 50 50 20 15 0.5\n";
const COLMAP_IMAGES: &str = "# Number of images: 2, mean observations per image: 1\n1 1 0 0 0 0 0 5 1 a.png\n1 2 3\n2 1 0 0 0 0 0 5 2 b.png\n\n";
const COLMAP_POINTS: &str = "# Number of points: 1\n7 0.5 0 0 1 2 3 0.1 1 0 2 0\n";

fn colmap(site: &Site) {
    site.write("cameras.txt", COLMAP_CAMERAS);
    site.write("images.txt", COLMAP_IMAGES);
    site.write("points3D.txt", COLMAP_POINTS);
}

#[test]
fn what_is_missing_is_listed_with_the_photograph() {
    let site = Site::new();
    colmap(&site);
    png(&site, "images/b.png", [40, 30]);
    png(&site, "images/c.png", [7, 8]);
    let set = folder(&site);
    assert_eq!(set.poses.as_ref().unwrap().0, Format::ColmapText);
    let names: Vec<&str> = set.photos.iter().map(|photo| photo.name.as_str()).collect();
    assert_eq!(names, ["a.png", "b.png", "images/c.png"]);
    assert_eq!(missing(&set.photos[0]), ["no file"]);
    assert_eq!(missing(&set.photos[1]), ["no calibration: the camera model FOV is not supported"]);
    assert_eq!(missing(&set.photos[2]), ["no calibration: no file describes its camera", "no pose"]);
    assert_eq!(set.sparse_points[0].seen, 2);
    // A picture of another size than the calibrated one has no camera that fits.
    png(&site, "images/a.png", [20, 15]);
    let set = folder(&site);
    assert_eq!(missing(&set.photos[0]), ["20 × 15 pixels, but calibrated for 40 × 30"]);
    assert!(set.photos[0].posed().is_none());
    // The same name in two folders.
    png(&site, "more/a.png", [40, 30]);
    assert_eq!(folder(&site).photos[0].missing, [Missing::Ambiguous(2)]);
    // Folders in the name decide.
    site.write("images.txt", COLMAP_IMAGES.replace("a.png", "D:\\work\\more\\a.png"));
    let set = folder(&site);
    assert_eq!(set.photos[0].source, Source::File(site.path("more/a.png")));
    assert!(set.photos[0].posed().is_some());
}

#[test]
fn names_in_files_never_lead_outside_the_folder() {
    let site = Site::new();
    png(&site, "secret.png", [40, 30]);
    std::fs::create_dir(site.path("in")).unwrap();
    for name in ["../secret.png", &site.path("secret.png").display().to_string()] {
        std::fs::write(site.path("in/cameras.txt"), COLMAP_CAMERAS).unwrap();
        std::fs::write(site.path("in/images.txt"), COLMAP_IMAGES.replace("a.png", name)).unwrap();
        let set = read(&site.path("in"), &Options::default()).unwrap();
        assert_eq!(missing(&set.photos[0]), ["no file"]);
    }
}

#[test]
fn masks_are_distinguished_from_photographs() {
    let site = Site::new();
    for name in ["a.png", "a.mask.png", "b.png", "b_mask.png", "sub/c.png", "sub/masks/c.png", "images/d.png"] {
        png(&site, name, [4, 4]);
    }
    png(&site, "masks/d.png.png", [4, 4]);
    let set = folder(&site);
    let masks: Vec<_> = set
        .photos
        .iter()
        .map(|photo| photo.mask.as_ref().map(|mask| mask.strip_prefix(site.path("")).unwrap().display().to_string()))
        .collect();
    let expected = ["a.mask.png", "b_mask.png", "masks/d.png.png", "sub/masks/c.png"].map(|name| Some(name.to_owned()));
    assert_eq!(masks, expected);
}

#[test]
fn a_picture_of_a_mask_is_a_photograph() {
    let site = Site::new();
    for name in ["gold_mask.png", "masks/death.png", "a.mask.png", "a.png", "masks/a.png"] {
        png(&site, name, [4, 4]);
    }
    let names: Vec<String> = folder(&site).photos.iter().map(|photo| photo.name.clone()).collect();
    assert_eq!(
        names,
        ["a.png", "gold_mask.png", "masks/a.png", "masks/death.png"],
        "the second mask of a picture, too"
    );
}

#[test]
fn a_name_is_found_at_its_place_in_the_folder_first() {
    let site = Site::new();
    colmap(&site);
    png(&site, "a.png", [40, 30]);
    png(&site, "thumbs/a.png", [40, 30]);
    assert_eq!(folder(&site).photos[0].source, Source::File(site.path("a.png")));
}

#[test]
fn a_colmap_image_line_in_place_of_observations_is_refused() {
    let site = Site::new();
    colmap(&site);
    site.write("images.txt", "1 1 0 0 0 0 0 5 1 a.png\n2 1 0 0 0 0 0 5 2 b.png\n");
    let message = read(&site.path(""), &Options::default()).unwrap_err().to_string();
    assert!(message.contains("images.txt, line 2") && message.contains("or an empty line"), "{message}");
}

#[test]
fn xml_that_would_take_more_memory_than_its_file_is_refused() {
    let site = Site::new();
    let head = "<!DOCTYPE d [\n<!ENTITY e \"";
    let many = "&e;".repeat(1000);
    site.write("cameras.xml", format!("{head}{}\">]><document><chunk>{many}</chunk></document>", "x".repeat(1000)));
    let message = read(&site.path(""), &Options::default()).unwrap_err().to_string();
    assert!(message.contains("cameras.xml, line 2") && message.contains("<!ENTITY"), "{message}");
    rewrite(&site, "cameras.xml", format!("<document><chunk>{}", "<".repeat(5 << 20)).as_bytes());
    let message = read(&site.path(""), &Options::default()).unwrap_err().to_string();
    assert!(message.contains("\"<\" characters"), "{message}");
}

#[test]
fn a_jpeg_of_fill_bytes_is_unreadable_at_once() {
    let site = Site::new();
    let mut bytes = vec![0xff; 8 << 20];
    bytes[1] = 0xd8;
    site.write("a.jpg", bytes);
    assert_eq!(missing(&folder(&site).photos[0])[0], "unreadable: neither JPEG nor PNG");
}

#[test]
fn several_files_with_poses_are_an_error_that_names_them_and_the_option() {
    let site = Site::new();
    colmap(&site);
    site.write("cameras.xml", METASHAPE);
    let message = read(&site.path(""), &Options::default()).unwrap_err().to_string();
    for part in ["(COLMAP, text)", "cameras.xml (Metashape)", "--poses FILE"] {
        assert!(message.contains(part), "{message}");
    }
    for (poses, format) in
        [("cameras.xml", Format::Metashape), ("images.txt", Format::ColmapText), ("", Format::ColmapText)]
    {
        let path = site.path(poses);
        let set = read(&site.path(""), &Options { poses: Some(&path), stations: &[] }).unwrap();
        assert_eq!(set.poses.unwrap().0, format);
    }
    let path = site.write("notes.txt", "hello");
    let message = read(&site.path(""), &Options { poses: Some(&path), stations: &[] }).unwrap_err().to_string();
    assert!(message.contains("notes.txt contains no poses"), "{message}");
}

/// The camera stands at (1, 0, 0) of the chunk and looks along +z; the chunk is twice as large as its coordinate system's tenth, turned by 90° about z,
/// and moved. The file is as Metashape 1.8 writes it, shortened.
const METASHAPE: &str = r#"<?xml version="1.0" encoding="UTF-8"?>
<document version="1.5.0">
  <chunk label="Chunk 1" enabled="true">
    <sensors next_id="2">
      <sensor id="0" label="cam" type="frame">
        <resolution width="40" height="30"/>
        <calibration type="frame" class="initial"><resolution width="40" height="30"/><f>1</f></calibration>
        <calibration type="frame" class="adjusted">
          <resolution width="40" height="30"/>
          <f>50</f><cx>1.5</cx><cy>-0.5</cy><b1>2</b1><b2>0.25</b2>
          <k1>-0.1</k1><k2>0.02</k2><k3>0.003</k3><p1>0.001</p1><p2>-0.002</p2>
        </calibration>
      </sensor>
      <sensor id="1" label="pano" type="spherical"><resolution width="80" height="40"/></sensor>
      <sensor id="2" label="none" type="frame"><resolution width="40" height="30"/></sensor>
    </sensors>
    <components><component id="0"><transform>
      <rotation>0 -1 0 1 0 0 0 0 1</rotation><translation>100 200 300</translation><scale>0.2</scale>
    </transform></component></components>
    <cameras>
      <camera id="0" sensor_id="0" component_id="0" label="a"><transform>1 0 0 1 0 1 0 0 0 0 1 0 0 0 0 1</transform></camera>
      <group label="g"><camera id="1" sensor_id="1" component_id="0" label="b.png" enabled="false"><transform>1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1</transform></camera></group>
      <camera id="2" sensor_id="2" label="c.png"/>
    </cameras>
    <reference>LOCAL_CS["Local Coordinates (m)"]</reference>
  </chunk>
</document>
"#;

#[test]
fn metashape_follows_its_documentation() {
    let site = Site::new();
    let file = site.write("cameras.xml", METASHAPE);
    png(&site, "photos/a.png", [40, 30]);
    let set = folder(&site);
    assert_eq!(set.crs.as_deref(), Some("LOCAL_CS[\"Local Coordinates (m)\"]"));
    let posed = set.photos[0].posed().unwrap();
    assert!(posed.position().distance(DVec3::new(100.0, 200.2, 300.0)) < 1e-12, "{}", posed.position());
    assert!(posed.forward().distance(DVec3::Z) < 1e-12);
    // A point of the camera's frame, projected by hand with the formulas of the manual.
    let (x, y): (f64, f64) = (0.3, -0.2);
    let r2 = x * x + y * y;
    let radial = 1.0 - 0.1 * r2 + 0.02 * r2 * r2 + 0.003 * r2.powi(3);
    let (p1, p2) = (0.001, -0.002);
    let xd = x * radial + p1 * (r2 + 2.0 * x * x) + 2.0 * p2 * x * y;
    let yd = y * radial + p2 * (r2 + 2.0 * y * y) + 2.0 * p1 * x * y;
    let expected = [20.0 + 1.5 + xd * 50.0 + xd * 2.0 + yd * 0.25, 15.0 - 0.5 + yd * 50.0];
    near(posed.camera.project(DVec3::new(x, y, 1.0)).unwrap(), expected);
    // x of the camera is y of the world.
    near(posed.project(posed.position() + DVec3::new(0.2, 0.3, 1.0)).unwrap(), expected);
    assert_eq!(missing(&set.photos[1]), ["no file", "disabled"]);
    assert!(matches!(set.photos[1].camera.unwrap().model(), CameraModel::Equirectangular { .. }));
    assert_eq!(
        missing(&set.photos[2]),
        ["no file", "no calibration: the sensor was not calibrated", "no pose: not aligned by Metashape"]
    );
    for (from, to, parts) in [
        (
            "0 0 0 0 1</transform></camera>\n      <g",
            "0 0 0 1</transform></camera>\n      <g",
            ["line 21", "16 numbers"],
        ),
        ("<f>50</f>", "<f>5O</f>", ["line 10", "\"5O\" as f; expected a number"]),
        ("<scale>0.2", "<scale>-1", ["line 18", "a positive scale"]),
        (">1 0 0 1 0 1 0 0", ">1 0 0 1 0 2 0 0", ["line 21", "a matrix that scales"]),
        ("</cameras>", "", ["line 26", "malformed XML"]),
        ("width=\"80\"", "width=\"8.5\"", ["line 14", "a resolution of 8.5 × 40"]),
    ] {
        std::fs::write(&file, METASHAPE.replacen(from, to, 1)).unwrap();
        let message = read(&site.path(""), &Options::default()).unwrap_err().to_string();
        for part in parts {
            assert!(message.contains(part) && message.contains("cameras.xml"), "{from}: {message}");
        }
    }
    // With a geographic or projected system, the transform leads to geocentric coordinates.
    std::fs::write(
        &file,
        METASHAPE.replace("LOCAL_CS[\"Local Coordinates (m)\"]", "PROJCS[\"WGS 84 / UTM zone 36S\",GEOGCS[]]"),
    )
    .unwrap();
    let crs = folder(&site).crs.unwrap();
    assert!(crs.starts_with("geocentric (ECEF)") && crs.ends_with("WGS 84 / UTM zone 36S"), "{crs}");
    std::fs::write(&file, METASHAPE.replace("<p1>", "<p3>1e-5</p3><p1>")).unwrap();
    assert!(missing(&folder(&site).photos[0])[0].contains("P3 and P4"));
}

/// A camera at (10, 20, 5) that looks north (y), in a portrait picture; numbers are relative to the longer side, 40.
const XMP: &str = r#"<x:xmpmeta xmlns:x="adobe:ns:meta/">
  <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
    <rdf:Description xcr:Version="3" xcr:PosePrior="exact" xcr:Coordinates="absolute"
       xcr:DistortionModel="brown3t2" xcr:FocalLength35mm="45" xcr:Skew="0" xcr:AspectRatio="1"
       xcr:PrincipalPointU="0.025" xcr:PrincipalPointV="-0.05" xmlns:xcr="http://www.capturingreality.com/ns/xcr/1.1#">
      <xcr:Rotation>1 0 0 0 0 -1 0 1 0</xcr:Rotation>
      <xcr:Position>10 20 5</xcr:Position>
      <xcr:DistortionCoeficients>-0.1 0.02 0.003 0 0.001 -0.002</xcr:DistortionCoeficients>
    </rdf:Description>
  </rdf:RDF>
</x:xmpmeta>
"#;

#[test]
fn sidecars_of_reality_capture_follow_their_documentation() {
    let site = Site::new();
    let file = site.write("IMG_1.xmp", XMP);
    site.write("IMG_2.xmp", "<x:xmpmeta xmlns:x=\"adobe:ns:meta/\"/>");
    site.write("IMG_3.xmp", XMP);
    png(&site, "IMG_1.png", [30, 40]);
    png(&site, "IMG_2.png", [30, 40]);
    let set = folder(&site);
    assert_eq!(set.poses.as_ref().unwrap().0, Format::RealityCapture);
    assert_eq!(set.photos.len(), 3);
    let posed = set.photos[0].posed().unwrap();
    assert!(posed.position().distance(DVec3::new(10.0, 20.0, 5.0)) < 1e-12);
    assert!(posed.forward().distance(DVec3::Y) < 1e-12);
    // Right, down and before the camera: +x, -z and +y of the world.
    let (x, y): (f64, f64) = (0.2, 0.1);
    let r2 = x * x + y * y;
    let radial = 1.0 - 0.1 * r2 + 0.02 * r2 * r2 + 0.003 * r2.powi(3);
    let (t1, t2) = (0.001, -0.002);
    let xd = x * radial + t2 * (r2 + 2.0 * x * x) + 2.0 * t1 * x * y;
    let yd = y * radial + t1 * (r2 + 2.0 * y * y) + 2.0 * t2 * x * y;
    let seen = posed.project(DVec3::new(10.0 + x, 21.0, 5.0 - y)).unwrap();
    near(seen, [15.0 + 0.025 * 40.0 + 50.0 * xd, 20.0 - 0.05 * 40.0 + 50.0 * yd]);
    assert_eq!(missing(&set.photos[1]), ["no file", "no calibration: the size of the picture is unknown"]);
    assert_eq!(missing(&set.photos[2]), ["no calibration: no file describes its camera", "no pose"]);
    // Sidecars elsewhere, and a sidecar of another program that is not even UTF-8.
    std::fs::create_dir(site.path("elsewhere")).unwrap();
    site.write("elsewhere/IMG_2.xmp", XMP);
    site.write("elsewhere/IMG_4.xmp", [0xff, 0xfe, b'<', 0]);
    let elsewhere = site.path("elsewhere");
    std::fs::create_dir(site.path("pictures")).unwrap();
    png(&site, "pictures/IMG_2.png", [30, 40]);
    let set = read(&site.path("pictures"), &Options { poses: Some(&elsewhere), ..Options::default() }).unwrap();
    assert!(set.photos[0].posed().is_some() && set.photos.len() == 1, "{:?}", missing(&set.photos[0]));
    std::fs::remove_dir_all(elsewhere).unwrap();
    std::fs::remove_dir_all(site.path("pictures")).unwrap();
    std::fs::write(&file, XMP.replace("brown3t2", "division")).unwrap();
    assert!(missing(&folder(&site).photos[0])[0].contains("distortion model division is not supported"));
    std::fs::write(&file, XMP.replace("10 20 5", "10 20")).unwrap();
    let message = read(&site.path(""), &Options::default()).unwrap_err().to_string();
    assert!(message.contains("IMG_1.xmp, line 7: found \"10 20\" as Position; expected 3 numbers"), "{message}");
}

/// The principal point of MeshLab is measured from the lower left corner.
const MESHLAB: &str = r#"<!DOCTYPE ViewState>
<project>
 <VCGCamera TranslationVector="-1 -2 -3 1" LensDistortion="0 0" ViewportPx="40 30" PixelSizeMm="0.1 0.1" CenterPx="21 14" FocalMm="5"
  RotationMatrix="1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"/>
</project>
"#;

#[test]
fn a_camera_of_meshlab_belongs_to_the_picture_of_its_name() {
    let site = Site::new();
    let file = site.write("view.xml", MESHLAB);
    png(&site, "view.png", [40, 30]);
    let set = folder(&site);
    let posed = set.photos[0].posed().unwrap();
    assert!(posed.position().distance(DVec3::new(1.0, 2.0, 3.0)) < 1e-12);
    assert!(posed.forward().distance(-DVec3::Z) < 1e-12);
    near(posed.project(DVec3::new(1.1, 2.2, 2.0)).unwrap(), [21.0 + 5.0, 16.0 - 10.0]);
    for (from, to, part) in [
        ("CenterPx=\"21 14\"", "", "line 3: found an element VCGCamera without CenterPx"),
        ("-1 -2 -3 1", "-1 -2 -3", "line 3: found \"-1 -2 -3\" as TranslationVector; expected 4 numbers"),
        ("0 0 0 0 1\"/>", "0 0 0 0 1\"", "line 5: found malformed XML"),
        ("\"40 30\"", "\"-4 30\"", "line 3: found a ViewportPx of -4 × 30"),
        ("\"1 0 0 0 0 1", "\"1 0 0 0 0 -1", "line 3: found a matrix that mirrors"),
    ] {
        std::fs::write(&file, MESHLAB.replacen(from, to, 1)).unwrap();
        let message = read(&site.path(""), &Options::default()).unwrap_err().to_string();
        assert!(message.contains(part) && message.contains("view.xml"), "{message}");
    }
    std::fs::write(&file, MESHLAB.replace("LensDistortion=\"0 0\"", "LensDistortion=\"0.1 0\"")).unwrap();
    assert!(missing(&folder(&site).photos[0])[0].contains("lens distortion of MeshLab"));
}

const BUNDLE: &str = "# Bundle file v0.3\n2 1\n50 -0.1 0.02\n1 0 0\n0 1 0\n0 0 1\n-1 -2 -3\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n0 0 0\n0.5 0 0\n1 2 3\n1 0 7 0.5 -0.5\n";

#[test]
fn bundler_looks_along_minus_z_with_y_up() {
    let site = Site::new();
    let file = site.write("bundle.out", BUNDLE);
    let message = read(&site.path(""), &Options::default()).unwrap_err().to_string();
    assert!(message.contains("there is no list of pictures beside"), "{message}");
    site.write("list.txt", "./my pictures/a.png 0 532.5\nb.png\n");
    png(&site, "my pictures/a.png", [40, 30]);
    let set = folder(&site);
    let posed = set.photos[0].posed().unwrap();
    assert!(posed.position().distance(DVec3::new(1.0, 2.0, 3.0)) < 1e-12);
    let (x, y): (f64, f64) = (0.1, 0.2);
    let r2 = x * x + y * y;
    let radial = 1.0 - 0.1 * r2 + 0.02 * r2 * r2;
    near(posed.project(DVec3::new(1.1, 2.2, 2.0)).unwrap(), [20.0 + 50.0 * radial * x, 15.0 - 50.0 * radial * y]);
    assert!(missing(&set.photos[1]).contains(&"no pose: not registered by Bundler".to_owned()));
    assert_eq!((set.sparse_points[0].color, set.sparse_points[0].seen), ([1, 2, 3], 1));
    for (from, to, part) in [
        ("2 1\n", "3 1\n", "line 2: found a camera count of 3; expected 2, the number of names in"),
        ("0 1 0\n", "0 1\n", "line 5: found \"0 1\"; expected a row of a rotation: 3 numbers"),
        ("0 1 0\n", "0 2 0\n", "line 7: found a matrix that scales"),
        ("1 0 7 0.5 -0.5\n", "2 0 7 0.5 -0.5\n", "line 15: found \"2 0 7 0.5 -0.5\"; expected the number of views"),
        ("1 0 7 0.5 -0.5\n", "", "line 15: found the end of the file"),
        ("-0.5\n", "-0.5\n9\n", "line 16: found \"9\"; expected the end of the file (number of points: 1)"),
        ("2 1\n", "2 1000000000000\n", "line 16: found the end of the file"),
    ] {
        std::fs::write(&file, BUNDLE.replacen(from, to, 1)).unwrap();
        let message = read(&site.path(""), &Options::default()).unwrap_err().to_string();
        assert!(message.contains(part) && message.contains("bundle.out"), "{from:?}: {message}");
    }
}

#[test]
fn errors_in_colmap_text_state_the_line() {
    let site = Site::new();
    for (name, from, to, part) in [
        ("cameras.txt", "PINHOLE 40 30 50 50 20 15\n2", "PINHOLE 40 30 50 50 20\n2", "line 2: found \"1 PINHOLE"),
        ("cameras.txt", "FOV", "FOW", "line 3: found \"2 FOW"),
        (
            "images.txt",
            "1 a.png",
            "9 a.png",
            "line 2: found \"1 1 0 0 0 0 0 5 9 a.png\"; expected a camera that is in cameras.txt",
        ),
        (
            "images.txt",
            "2 1 0 0 0",
            "2 0 0 0 0",
            "line 4: found \"2 0 0 0 0 0 0 5 2 b.png\"; expected a quaternion other than 0",
        ),
        ("images.txt", "2 1 0 0 0 0 0 5 2 b.png\n", "", "expected 2 images, as stated at the start of the file, not 1"),
        ("points3D.txt", "2 0\n", "2\n", "line 2: found \"7 0.5"),
        ("points3D.txt", "7 0.5", "7 inf", "line 2: found \"7 inf"),
    ] {
        colmap(&site);
        let text = std::fs::read_to_string(site.path(name)).unwrap();
        site.write(name, text.replacen(from, to, 1));
        let message = read(&site.path(""), &Options::default()).unwrap_err().to_string();
        assert!(message.contains(part) && message.contains(name), "{message}");
    }
}

/// The same model as in the text above.
fn colmap_binary() -> [(&'static str, Vec<u8>); 3] {
    let mut cameras = Vec::new();
    cameras.extend(2_u64.to_le_bytes());
    for (id, model, values) in
        [(1_u32, 1_i32, [50.0_f64, 50.0, 20.0, 15.0, 0.0]), (2, 7, [50.0, 50.0, 20.0, 15.0, 0.5])]
    {
        cameras.extend(id.to_le_bytes());
        cameras.extend(model.to_le_bytes());
        cameras.extend([40_u64, 30].map(u64::to_le_bytes).concat());
        let count = if model == 1 { 4 } else { 5 };
        cameras.extend(values[..count].iter().flat_map(|v| v.to_le_bytes()));
    }
    let mut images = Vec::new();
    images.extend(2_u64.to_le_bytes());
    for (id, name) in [(1_u32, b"a.png\0"), (2, b"b.png\0")] {
        images.extend(id.to_le_bytes());
        images.extend([1.0_f64, 0.0, 0.0, 0.0, 0.0, 0.0, 5.0].map(f64::to_le_bytes).concat());
        images.extend(id.to_le_bytes());
        images.extend(name);
        images.extend(1_u64.to_le_bytes());
        images.extend([2.0_f64, 3.0].map(f64::to_le_bytes).concat());
        images.extend(u64::MAX.to_le_bytes());
    }
    let mut points = Vec::new();
    points.extend(1_u64.to_le_bytes());
    points.extend(7_u64.to_le_bytes());
    points.extend([0.5_f64, 0.0, 0.0].map(f64::to_le_bytes).concat());
    points.extend([1, 2, 3]);
    points.extend(0.1_f64.to_le_bytes());
    points.extend(2_u64.to_le_bytes());
    points.extend([1_u32, 0, 2, 0].map(u32::to_le_bytes).concat());
    [("cameras.bin", cameras), ("images.bin", images), ("points3D.bin", points)]
}

#[test]
fn colmap_binary_equals_text_and_its_counts_are_checked() {
    let (site, text) = (Site::new(), Site::new());
    colmap(&text);
    let write = || colmap_binary().map(|(name, bytes)| site.write(name, bytes));
    write();
    let (set, expected) = (folder(&site), folder(&text));
    assert_eq!((set.photos, set.sparse_points), (expected.photos, expected.sparse_points));
    for (name, bytes) in colmap_binary() {
        for count in [3_u64, 1 << 40, u64::MAX] {
            let mut lies = bytes.clone();
            lies[..8].copy_from_slice(&count.to_le_bytes());
            site.write(name, lies);
            let message = read(&site.path(""), &Options::default()).unwrap_err().to_string();
            assert!(message.contains(name) && message.contains("byte "), "{message}");
        }
        // The count of the observations, at the end of the first image or point.
        write();
    }
    let mut images = colmap_binary()[1].1.clone();
    images[78..86].copy_from_slice(&(1_u64 << 60).to_le_bytes());
    site.write("images.bin", images);
    let message = read(&site.path(""), &Options::default()).unwrap_err().to_string();
    assert!(message.contains("images.bin, byte 78: found a count of 1152921504606846976 observations"), "{message}");
    write();
    let mut cameras = colmap_binary()[0].1.clone();
    cameras[12] = 99;
    site.write("cameras.bin", cameras);
    let message = read(&site.path(""), &Options::default()).unwrap_err().to_string();
    assert!(message.contains("cameras.bin, byte 16: found camera model 99"), "{message}");
}

/// Neither truncation, at every byte, nor damage crashes a reader or makes it hang.
#[test]
fn truncated_and_damaged_files_with_poses_are_refused_or_read() {
    let mut rng = fastrand::Rng::with_seed(11);
    let [cameras, images, points] = colmap_binary();
    let text = |name, text: &str| (name, text.as_bytes().to_vec());
    let sets: [&[(&str, Vec<u8>)]; 6] = [
        &[cameras, images, points],
        &[text("cameras.txt", COLMAP_CAMERAS), text("images.txt", COLMAP_IMAGES), text("points3D.txt", COLMAP_POINTS)],
        &[text("bundle.out", BUNDLE), text("list.txt", "a.png\nb.png\n")],
        &[text("cameras.xml", METASHAPE)],
        &[text("a.xmp", XMP)],
        &[text("a.xml", MESHLAB)],
    ];
    let mut accepted = 0;
    for files in sets {
        let site = Site::new();
        png(&site, "a.png", [40, 30]);
        for (name, bytes) in files {
            site.write(name, bytes);
        }
        let whole = folder(&site);
        assert!(whole.photos.iter().any(|photo| photo.camera_from_world.is_some()), "{whole:?}");
        for (name, bytes) in files {
            let flips = (0..60).map(|_| {
                let mut damaged = bytes.clone();
                for _ in 0..=rng.usize(..3) {
                    let at = rng.usize(..damaged.len());
                    damaged[at] ^= 1 << rng.u8(..8);
                }
                damaged
            });
            let cuts = (0..bytes.len()).map(|length| bytes[..length].to_vec());
            for damaged in cuts.chain(flips).collect::<Vec<_>>() {
                rewrite(&site, name, &damaged);
                match read(&site.path(""), &Options::default()) {
                    Ok(_) => accepted += 1,
                    Err(e) => assert!(e.to_string().contains(&site.path("").display().to_string()), "{e}"),
                }
            }
            site.write(name, bytes);
        }
    }
    assert!(accepted > 0);
}

fn jpeg_with_exif() -> Vec<u8> {
    // One directory of big-endian TIFF with a pointer to the EXIF directory, which has a time, an f-number, a speed and a date.
    let mut tiff = b"MM\0\x2a\0\0\0\x08".to_vec();
    let entry = |tag: u16, kind: u16, count: u32, value: [u8; 4]| {
        [&tag.to_be_bytes()[..], &kind.to_be_bytes(), &count.to_be_bytes(), &value].concat()
    };
    tiff.extend(1_u16.to_be_bytes());
    tiff.extend(entry(0x8769, 4, 1, 26_u32.to_be_bytes()));
    tiff.extend(0_u32.to_be_bytes());
    let data = 26 + 2 + 4 * 12 + 4;
    tiff.extend(4_u16.to_be_bytes());
    tiff.extend(entry(0x829a, 5, 1, u32::to_be_bytes(data)));
    tiff.extend(entry(0x829d, 5, 1, u32::to_be_bytes(data + 8)));
    tiff.extend(entry(0x8827, 3, 1, [0, 200, 0, 0]));
    tiff.extend(entry(0x9003, 2, 20, u32::to_be_bytes(data + 16)));
    tiff.extend(0_u32.to_be_bytes());
    tiff.extend([1_u32, 125, 28, 10].map(u32::to_be_bytes).concat());
    tiff.extend(b"2024:05:17 14:03:22\0");
    let mut jpeg = b"\xff\xd8\xff\xe1".to_vec();
    jpeg.extend((tiff.len() as u16 + 8).to_be_bytes());
    jpeg.extend(b"Exif\0\0");
    jpeg.extend(tiff);
    jpeg.extend(b"\xff\xc0\0\x0b\x08\0\x1e\0\x28\x01\x01\x11\0\xff\xd9\0\0\0\0");
    jpeg
}

#[test]
fn time_and_exposure_come_from_exif() {
    let site = Site::new();
    site.write("a.JPG", jpeg_with_exif());
    site.write("b.jpg", "not a picture, but long enough to be one");
    let set = folder(&site);
    let picture = set.photos[0].picture.as_ref().unwrap();
    assert_eq!((picture.size, picture.taken.as_deref()), ([40, 30], Some("2024-05-17T14:03:22")));
    let stops = (200.0_f64 / 100.0 / 125.0 / 2.8 / 2.8).log2();
    assert!((picture.exposure.stops().unwrap() - stops).abs() < 1e-12);
    assert!(missing(&set.photos[1]).contains(&"unreadable: neither JPEG nor PNG".to_owned()));
    let bytes = jpeg_with_exif();
    let mut rng = fastrand::Rng::with_seed(3);
    for round in 0..600 {
        let mut damaged = bytes.clone();
        if round < bytes.len() {
            damaged.truncate(round);
        } else {
            let at = rng.usize(..damaged.len());
            damaged[at] ^= 1 << rng.u8(..8);
        }
        rewrite(&site, "a.JPG", &damaged);
        folder(&site);
    }
}

/// A survey with one station that is turned by 90° about z.
fn survey_of(site: &Site, photographs: &str) -> Survey {
    let text = format!(
        "version = 1\n\n[[station]]\nname = \"tower\"\nscan = \"stations/tower.scan\"\nrotation = [0.7071067811865476, 0.0, 0.0, 0.7071067811865476]\ntranslation = [10.0, 20.0, 2.0]\n\n[station.source]\nfile = \"t.ptx\"\nbytes = 1\nblake3 = \"00\"\nnumber = 1\n{photographs}"
    );
    std::fs::create_dir_all(site.survey()).unwrap();
    std::fs::write(site.survey().join(survey::FILE), text).unwrap();
    Survey::open(&site.survey()).unwrap()
}

#[test]
fn panoramas_and_cubes_take_the_pose_of_their_station() {
    let site = Site::new();
    let survey = survey_of(&site, "");
    png(&site, "pano/tower.png", [400, 200]);
    png(&site, "pano/other.png", [400, 200]);
    for face in ["front", "right", "up"] {
        png(&site, &format!("pano/tower_{face}.png"), [100, 100]);
    }
    let set = read(&site.path("pano"), &Options { poses: None, stations: &survey.stations }).unwrap();
    let find = |name: &str| set.photos.iter().find(|photo| photo.name == name).unwrap();
    let pano = find("tower.png");
    assert_eq!((pano.frame, pano.station.as_deref(), pano.missing.len()), (Frame::Survey, Some("tower"), 0));
    // The station's x axis is the survey's y axis. Points to its right appear on the right of the picture, points above
    // it at the top.
    let station = DVec3::new(10.0, 20.0, 2.0);
    let seen = |photo: &PhotoRecord, direction: DVec3| photo.posed().unwrap().project(station + direction).unwrap();
    near(seen(pano, DVec3::Y), [200.0, 100.0]);
    near(seen(pano, DVec3::X), [300.0, 100.0]);
    near(seen(pano, DVec3::new(0.0, 1.0, 1.0)), [200.0, 50.0]);
    near(seen(find("tower_front.png"), DVec3::new(0.5, 1.0, 0.2)), [75.0, 40.0]);
    near(seen(find("tower_right.png"), DVec3::new(1.0, -0.5, 0.2)), [75.0, 40.0]);
    near(seen(find("tower_up.png"), DVec3::new(0.5, 0.2, 1.0)), [75.0, 60.0]);
    // A 2:1 picture that is not named after a station is an ordinary picture.
    assert_eq!(missing(find("other.png")), ["no calibration: no file describes its camera", "no pose"]);
    // A panorama named after the station's source file belongs to the station; if the file has a second scan, to
    // neither.
    png(&site, "pano/t.png", [400, 200]);
    let photo = |stations: &[survey::Station]| {
        let set = read(&site.path("pano"), &Options { poses: None, stations }).unwrap();
        set.photos.iter().find(|photo| photo.name == "t.png").unwrap().station.clone()
    };
    assert_eq!(photo(&survey.stations).as_deref(), Some("tower"));
    let mut second = survey.stations[0].clone();
    second.name = "gate".into();
    second.scan = "stations/gate.scan".into();
    second.source.number = 2;
    assert_eq!(photo(&[survey.stations[0].clone(), second]), None);
}

#[test]
fn photographs_of_a_survey_have_the_axes_of_e57() {
    let site = Site::new();
    let survey = survey_of(
        &site,
        "\n[[photograph]]\nfile = \"photographs/a.png\"\nstation = \"tower\"\nrotation = [1.0, 0.0, 0.0, 0.0]\ntranslation = [1.0, 2.0, 3.0]\ncamera = { kind = \"pinhole\", size = [40, 30], focal = [50.0, 50.0], center = [21.0, 14.0] }\n\n[[photograph]]\nfile = \"photographs/b.png\"\nrotation = [1.0, 0.0, 0.0, 0.0]\ntranslation = [1.0, 2.0, 3.0]\ncamera = { kind = \"spherical\", size = [40, 20], pixel = [0.1, 0.1] }\n",
    );
    png(&site, "survey/photographs/a.png", [40, 30]);
    let set = of_survey(&site.survey(), &survey);
    let [a, b] = &set.photos[..] else { panic!("{set:?}") };
    assert_eq!((missing(a), missing(b)), (Vec::new(), vec!["no file".to_owned()]));
    let posed = a.posed().unwrap();
    assert!(posed.forward().distance(-DVec3::Z) < 1e-12);
    near(posed.project(DVec3::new(1.1, 2.2, 2.0)).unwrap(), [26.0, 4.0]);
    let posed = b.posed().unwrap();
    assert!(posed.forward().distance(DVec3::X) < 1e-12);
    let left_and_up = DVec3::new(1.0, 2.0, 3.0) + DVec3::new(libm::cos(0.5), libm::sin(0.5), 0.0);
    near(posed.project(left_and_up).unwrap(), [15.0, 10.0]);
}

#[test]
fn pictures_in_an_e57_file_are_listed_and_taken_out() {
    use e57::{E57Writer, ImageFormat, PinholeImageProperties, Transform};
    let site = Site::new();
    let path = site.path("scan.e57");
    let elsewhere = Site::new();
    png(&elsewhere, "seed.png", [40, 30]);
    let seed = std::fs::read(elsewhere.path("seed.png")).unwrap();
    {
        let mut writer = E57Writer::from_file(&path, "file").unwrap();
        let mut image = writer.add_image("one").unwrap();
        image.set_name("north");
        image.set_transform(Transform {
            rotation: e57::Quaternion { w: 1.0, x: 0.0, y: 0.0, z: 0.0 },
            translation: e57::Translation { x: 1.0, y: 2.0, z: 3.0 },
        });
        let properties = PinholeImageProperties {
            width: 40,
            height: 30,
            focal_length: 0.5,
            pixel_width: 0.01,
            pixel_height: 0.01,
            principal_x: 21.0,
            principal_y: 14.0,
        };
        image.add_pinhole(ImageFormat::Png, &mut seed.as_slice(), properties, None).unwrap();
        image.finalize().unwrap();
        writer.finalize().unwrap();
    }
    let set = folder(&site);
    assert_eq!(set.poses.as_ref().unwrap().0, Format::E57);
    let photo = &set.photos[0];
    assert_eq!((photo.name.as_str(), photo.frame, missing(photo)), ("north", Frame::Survey, Vec::new()));
    near(photo.posed().unwrap().project(DVec3::new(1.1, 2.2, 2.0)).unwrap(), [26.0, 4.0]);
    let Source::Inside { file, number } = &photo.source else { panic!("{photo:?}") };
    let mut out = Vec::new();
    extract(file, *number, &mut out).unwrap();
    assert_eq!(out, seed);
    assert!(extract(file, 1, &mut Vec::new()).unwrap_err().to_string().contains("has no picture 2"));
    // Damaged, it is refused with its byte.
    let mut bytes = std::fs::read(&path).unwrap();
    let at = bytes.len() - 200;
    bytes[at] ^= 1;
    site.write("scan.e57", bytes);
    let message = read(&site.path(""), &Options::default()).unwrap_err().to_string();
    assert!(message.contains("scan.e57, byte "), "{message}");
}

#[test]
fn a_folder_that_is_not_there_is_an_error_and_an_empty_one_is_not() {
    let site = Site::new();
    assert!(folder(&site).photos.is_empty());
    let message = read(Path::new("/not/there"), &Options::default()).unwrap_err().to_string();
    assert!(message.contains("/not/there"), "{message}");
}
