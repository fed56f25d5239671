//! Frames and poses of simulated photographs of the fort.

use super::pairs::{self, NamedPair};
use super::*;
use crate::colour::Model;
use crate::photos::{self, Frame, PhotoSet};
use glam::{DQuat, DVec3};
use kilwa_pack::{Reader, SliceSource};
use kilwa_scan_core::PosedCamera;
use kilwa_scan_core::photo_pose::similarity::Pair;
use kilwa_scan_core::photo_pose::{Grey, Options, Similarity, Surface};
use kilwa_synth::photos::{PhotoOptions, Session};
use kilwa_synth::{SiteKind, SynthOptions};

fn read(text: &str) -> Result<Vec<NamedPair>, String> {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("points.csv");
    std::fs::write(&file, text).unwrap();
    pairs::read(&file).map_err(|e| e.to_string().replace(&file.display().to_string(), "FILE"))
}

#[test]
fn files_of_points_are_read_with_commas_or_spaces() {
    let text = "# name, reconstruction, survey\nA, 1, 2, 3, 10, 20, 30\n\"tower; top\" 1 2 3 4 5 6 0.02\r\nB;0;0;0;1;1;1e1;0.5\n";
    let read = read(text).unwrap();
    let names: Vec<&str> = read.iter().map(|pair| pair.name.as_str()).collect();
    assert_eq!(names, ["A", "tower; top", "B"]);
    let expected =
        Pair { reconstruction: DVec3::new(1.0, 2.0, 3.0), survey: DVec3::new(10.0, 20.0, 30.0), sigma: pairs::SIGMA };
    assert_eq!(read[0].pair, expected);
    assert_eq!([read[1].pair.sigma, read[2].pair.sigma, read[2].pair.survey.z], [0.02, 0.5, 10.0]);
}

#[test]
fn mistakes_in_files_of_points_are_named_with_their_line() {
    for (text, message) in [
        ("A 1 2 3 4 5", "line 1"),
        ("A 1 2 3 4 5 6\nB 1 2 x 4 5 6", "line 2"),
        ("A 1 2 3 4 5 6\n\nA 1 2 3 4 5 6", "line 3"),
        ("A 1 2 3 4 5 inf", "\"inf\""),
        ("A 1 2 3 4 5 6 0", "positive"),
        ("\"A 1 2 3 4 5 6", "quote"),
    ] {
        let error = read(text).unwrap_err();
        assert!(error.contains("FILE") && error.contains(message), "{error}");
    }
}

/// Photographs of the fort in a frame of their own, and the true positions of their cameras.
fn reconstruction(photos: u32) -> (PhotoSet, Vec<(String, DVec3, f64)>) {
    let options = PhotoOptions { sfm_frame: true, passers_by: 0.0, ..PhotoOptions::new(photos, (96, 72)) };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("session");
    kilwa_synth::photos::write(&options, &out, &mut |_, _| {}).unwrap();
    let set = photos::read(&out.join("photos"), &photos::Options::default()).unwrap();
    let truth = std::fs::read_to_string(out.join("truth/photos.toml")).unwrap();
    let truth: toml_edit::DocumentMut = truth.parse().unwrap();
    let place = |photo: &toml_edit::Table| {
        let at = photo["position"].as_array().unwrap();
        let number = |k: usize| at.get(k).and_then(toml_edit::Value::as_float).unwrap();
        let name = photo["name"].as_str().unwrap();
        (format!("{name}.jpg"), DVec3::from_array(std::array::from_fn(number)), 0.01)
    };
    (set, truth["photo"].as_array_of_tables().unwrap().iter().map(place).collect())
}

/// Where the frame puts cameras, compared with where they are, metres.
fn worst(aligned: &Aligned, set: &PhotoSet, known: &[(String, DVec3, f64)]) -> f64 {
    let mut set = set.clone();
    aligned.apply(&mut set);
    assert!(set.photos.iter().all(|photo| photo.frame == Frame::Survey));
    let error = |photo: &photos::PhotoRecord| {
        let (_, truth, _) = known.iter().find(|(name, ..)| photo.name == *name).unwrap();
        photo.posed().unwrap().position().distance(*truth)
    };
    set.photos.iter().map(error).fold(0.0, f64::max)
}

#[test]
fn a_reconstruction_gets_its_frame_from_cameras_points_and_its_sparse_points() {
    let (set, known) = reconstruction(8);
    let exact = frame(&set, &Start::Cameras(known.clone()), None).unwrap();
    assert!(worst(&exact, &set, &known) < 1e-6 && exact.rms.unwrap() < 1e-6, "{exact:?}");
    // Known to 10 cm; and a start that is half a metre and one degree off. The surface helps.
    let mesh = kilwa_synth::mesh(SiteKind::Fort, &SynthOptions::new(150_000)).unwrap();
    let mut normals = vec![DVec3::ZERO; mesh.positions.len()];
    for corners in &mesh.triangles {
        let [a, b, c] = corners.map(|k| mesh.positions[k as usize]);
        for k in corners {
            normals[*k as usize] += (b - a).cross(c - a);
        }
    }
    let normals = normals.into_iter().map(DVec3::normalize_or_zero);
    let surface = Surface::new(mesh.positions.iter().copied().zip(normals));
    let mut random = fastrand::Rng::with_seed(1);
    let mut off = || DVec3::from_array(std::array::from_fn(|_| (random.f64() - 0.5) * 0.34));
    let rough: Vec<_> = known.iter().map(|(name, at, _)| (name.clone(), *at + off(), 0.1)).collect();
    let turned = Similarity {
        scale: 1.01,
        rotation: DQuat::from_scaled_axis(DVec3::new(0.01, -0.01, 0.015)),
        translation: DVec3::new(0.2, -0.3, 0.2),
    };
    let given = exact.similarity.then(&turned);
    for start in [Start::Cameras(rough), Start::Given(given, 1.0)] {
        let without = frame(&set, &start, None).unwrap();
        let with = frame(&set, &start, Some((&surface, 0.25))).unwrap();
        let (before, after) = (worst(&without, &set, &known), worst(&with, &set, &known));
        assert!(with.landed.is_some() && after < 0.12 && after < before, "{before} {after} {with:?}");
    }
    // A surface of something else: the start is kept, and the reason stated.
    let elsewhere = Surface::new([(DVec3::splat(1e4), DVec3::Z)]);
    let kept = frame(&set, &Start::Cameras(known.clone()), Some((&elsewhere, 0.25))).unwrap();
    assert!(kept.not_landed.is_some() && worst(&kept, &set, &known) < 1e-6);
    // Contradictions name the photograph.
    let mut wrong = known.clone();
    wrong[3].1 += DVec3::new(1.0, 1.0, 0.0);
    let error = frame(&set, &Start::Cameras(wrong), None).unwrap_err().to_string();
    assert!(error.contains(&known[3].0) && error.contains("contradicts"), "{error}");
    let error = frame(&set, &Start::Cameras(known[..2].to_vec()), None).unwrap_err().to_string();
    assert!(error.contains("at least three"), "{error}");
    let unknown = vec![("nobody.jpg".to_owned(), DVec3::ZERO, 0.1)];
    let error = frame(&set, &Start::Cameras(unknown), None).unwrap_err().to_string();
    assert!(error.contains("nobody.jpg"), "{error}");
}

#[test]
fn a_photograph_is_refined_against_a_pack_and_its_overlay_shows_the_borders() {
    let options = PhotoOptions { pose_error: 5.0, ..PhotoOptions::new(2, (320, 240)) };
    let session = Session::new(&options).unwrap();
    let mesh = kilwa_synth::mesh(SiteKind::Fort, &SynthOptions::new(400_000)).unwrap();
    let build = kilwa_builder::BuildOptions::default();
    let pack = kilwa_builder::build_pack(mesh, &build, &kilwa_builder::build::progress::Silent).unwrap().bytes;
    let reader = Reader::open(SliceSource(&pack[..])).unwrap();
    let model = Model::new(&reader, 1 << 30);
    let (start, _) = session.disturbed(&options)[0];
    let size = start.camera.size();
    let bytes = session.picture(0, &options);
    let level = |p: &[u8]| p.iter().map(|v| f32::from(*v)).sum::<f32>() / 765.0;
    let picture = Grey::new(size, bytes.chunks_exact(3).map(level).collect()).unwrap();
    let refined = refine_photograph(&model, &start, &picture, 1.0, &Options::default()).unwrap().unwrap();
    let truth = session.photos()[0].posed();
    let error = |camera: &PosedCamera| {
        let places = (0..48).filter_map(|k| {
            let pixel = glam::DVec2::new(f64::from(k % 8) * 40.0 + 20.0, f64::from(k / 8) * 40.0 + 20.0);
            let place = session.shown_at(0, pixel)?.position;
            Some(camera.project(place)?.distance_squared(truth.project(place)?))
        });
        let all: Vec<f64> = places.collect();
        (all.iter().sum::<f64>() / all.len() as f64).sqrt()
    };
    assert!(error(&start) > 3.0 && error(&refined.camera) < 1.0, "{} {}", error(&start), error(&refined.camera));
    let overlay = Overlay::new(&picture, 1.0, &truth, &draw(&model, &truth, 1.0).unwrap());
    let borders = overlay.pixels.chunks_exact(3).filter(|p| p[0] != p[2]).count();
    assert!(borders > 300 && borders < 20_000, "{borders}");
    let mut png = Vec::new();
    overlay.write_png(&mut png).unwrap();
    assert_eq!(&png[1..4], b"PNG");
}
