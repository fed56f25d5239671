//! Properties of simulated photographs.

use super::*;
use crate::fort::scene::Scene;
use glam::{DMat3, DQuat, DVec2, DVec3};
use kilwa_geometry::color::srgb_from_light;
use kilwa_scan_core::camera::{Camera, Distortion, PosedCamera};
use kilwa_scan_core::pose::Pose;
use std::collections::{BTreeMap, HashMap};
use std::path::Path;

const SIZE: (u32, u32) = (96, 72);

fn options(photos: u32, panoramas: u32) -> PhotoOptions {
    PhotoOptions { panoramas, ..PhotoOptions::new(photos, SIZE) }
}

/// Middles of some pixels.
fn pixels((width, height): (u32, u32), step: usize) -> impl Iterator<Item = (usize, DVec2)> {
    let all =
        (0..width * height).map(move |k| (k as usize, DVec2::new(f64::from(k % width), f64::from(k / width)) + 0.5));
    all.step_by(step)
}

#[test]
fn a_pixel_shows_reflectance_times_light_times_exposure() {
    let options = options(5, 1);
    let session = Session::new(&options).unwrap();
    let (mut good, mut all, mut kinds) = (0, 0, [false; 3]);
    for number in [0, 3, 5] {
        let photo = &session.photos()[number];
        kinds[photo.carrier as usize] = true;
        let rendered = session.view(number).render(&mut |_| {});
        let bytes = develop::develop(&rendered.light, photo.size(), &photo.exposure, 0.0, 1);
        let width = photo.size().0 as usize;
        for (index, at) in pixels(photo.size(), 7) {
            let Some(place) = session.shown_at(number, at) else { continue };
            let range = place.position.distance(photo.position);
            // Away from edges and people, where a pixel is one ray.
            let light = rendered.light[index][1];
            let is_plain = [1, width].into_iter().all(|step| {
                [index.wrapping_sub(step), index + step].into_iter().all(|other| {
                    rendered.range.get(other).is_some_and(|r| (f64::from(*r) - range).abs() < 0.02 * range)
                        && (rendered.light[other][1] - light).abs() < 0.12 * light
                        && !rendered.is_person[other]
                })
            });
            if !is_plain || rendered.is_person[index] || (f64::from(rendered.range[index]) - range).abs() > 0.01 {
                continue;
            }
            assert!(photo.project(place.position).unwrap().distance(at) < 0.05);
            let (light, factor) =
                (session.light_at(&place, photo.sun), photo.exposure.factor(at.x, at.y, photo.size()));
            let is_equal = (0..3).all(|k| {
                let expected = srgb_from_light(place.albedo[k] * light[k] * factor[k]);
                expected.abs_diff(bytes[3 * index + k]) <= 3
            });
            all += 1;
            good += u32::from(is_equal);
        }
    }
    // Others are on the edge of a shadow.
    assert!(all > 600 && good * 100 > all * 97, "{good} of {all}");
    assert_eq!(kinds, [true, true, true], "a photograph by hand, one by drone and a panorama");
}

#[test]
fn visibility_agrees_with_the_range_image() {
    let session = Session::new(&PhotoOptions { passers_by: 0.0, ..options(10, 0) }).unwrap();
    let (mut right, mut all, mut seen) = (0, 0, 0);
    for to in 0..10 {
        let photo = &session.photos()[to];
        let rendered = session.view(to).render(&mut |_| {});
        for (from, (_, at)) in (0..10).flat_map(|from| pixels(SIZE, 211).map(move |pixel| (from, pixel))) {
            let Some(place) = session.shown_at(from, at) else { continue };
            let Some(there) = photo.project(place.position) else {
                assert!(!session.sees(to, &place));
                continue;
            };
            if from == to {
                continue;
            }
            let range = f64::from(rendered.range[there.y as usize * SIZE.0 as usize + there.x as usize]);
            let is_first = place.position.distance(photo.position) < range * 1.06;
            right += u32::from(session.is_seen(to, place.position) == is_first);
            seen += u32::from(is_first);
            all += 1;
        }
    }
    for from in 0..10 {
        let mut places = pixels(SIZE, 500).filter_map(|(_, at)| session.shown_at(from, at));
        assert!(places.all(|place| !session.is_behind_people(from, place.position)));
    }
    assert!(seen > 30 && all - seen > 30 && right * 100 >= all * 95, "{right} of {all} right, {seen} seen");
}

#[test]
fn surface_points_are_found_from_nearby_points() {
    let session = Session::new(&options(1, 0)).unwrap();
    let mut near = 0;
    for (_, at) in pixels(SIZE, 11) {
        let Some(place) = session.shown_at(0, at) else { continue };
        let again = session.surface_at(place.position + place.normal * 0.01).unwrap();
        near += u32::from(again.position.distance(place.position) < 0.004);
        assert!(place.albedo.iter().all(|a| (0.005..0.95).contains(a)), "{:?}", place.albedo);
        assert!((place.normal.length() - 1.0).abs() < 1e-9);
    }
    assert!(near > 250, "{near}");
    assert_eq!(session.surface_at(DVec3::new(0.0, 0.0, 40.0)), None);
    assert_eq!(session.albedo_at(DVec3::new(f64::NAN, 0.0, 0.0)), None);
}

#[test]
fn cameras_are_outside_masonry_and_show_enough_surface() {
    let options = options(24, 2);
    let session = Session::new(&options).unwrap();
    let mut groups = HashMap::new();
    let scene = Scene::new(options.seed);
    for (number, photo) in session.photos().iter().enumerate() {
        *groups.entry(photo.carrier.name()).or_insert(0) += 1;
        assert!(session.clearance(photo.position) >= place::CLEARANCE, "{}", photo.name);
        let p = Scene::from_site(photo.position);
        assert!(p.z > scene.ground(p.x, p.y) + place::ABOVE_GROUND, "{}", photo.name);
        let shown = pixels(photo.size(), 13).map(|(_, at)| session.shown_at(number, at).is_some());
        let (shown, all) = shown.fold((0, 0), |(s, n), is| (s + u32::from(is), n + 1));
        let is_enough = photo.carrier == Carrier::Tripod || shown * 10 >= all * 4;
        assert!(is_enough, "{} shows {shown} of {all}", photo.name);
        assert!(photo.exposure.ev.abs() <= options.exposure);
        assert!((photo.rotation.determinant() - 1.0).abs() < 1e-9);
    }
    assert_eq!(groups, HashMap::from([("hand", 15), ("drone", 9), ("tripod", 2)]));
    let hours = session.photos()[23].hour - session.photos()[0].hour;
    assert!((hours - options.hours).abs() < 1e-9);
}

/// All files below a folder.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut open = vec![folder.to_owned()];
    while let Some(next) = open.pop() {
        for entry in std::fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().to_str().unwrap().to_owned();
                found.insert(name, std::fs::read(path).unwrap());
            }
        }
    }
    found
}

#[test]
fn bytes_do_not_depend_on_threads_and_people_cover_their_share() {
    let options = PhotoOptions { truth_depth: true, size: (64, 48), ..options(5, 1) };
    let folder = tempfile::tempdir().unwrap();
    let run = |threads: usize| {
        let out = folder.path().join(threads.to_string());
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        let mut done = (0, 0);
        let report = pool.install(|| write(&options, &out, &mut |now, all| done = (now, all))).unwrap();
        assert_eq!(done, (report.pixels, report.pixels));
        (report, files(&out))
    };
    let ((report, one), (_, three)) = (run(1), run(3));
    assert!(one == three, "files differ");
    assert_eq!(report.by_carrier.iter().sum::<u32>() as usize, report.files.len());
    assert!(report.files.iter().all(|file| file.is_file()));
    assert_eq!(one.len(), 3 * 6 + 3 + 1, "pictures, masks and ranges; a reconstruction and the ground truth");
    let share = report.people_pixels as f64 / report.pixels as f64;
    assert!(share > 0.01 && share < 0.04, "{share}");
    let mut marked = 0;
    for (name, bytes) in &one {
        let picture = || image::load_from_memory(bytes).unwrap();
        if name.starts_with("truth/people/") {
            marked += picture().to_luma8().pixels().filter(|p| p.0[0] == 255).count() as u64;
        } else if name.starts_with("photos/images/") {
            let picture = picture().to_rgb8();
            assert_eq!(picture.dimensions(), options.size);
            let levels: Vec<u8> = picture.pixels().map(|p| p.0[1]).collect();
            let mean = levels.iter().map(|v| f64::from(*v)).sum::<f64>() / levels.len() as f64;
            let white = levels.iter().map(|v| f64::from(u8::from(*v == u8::MAX))).sum::<f64>() / levels.len() as f64;
            assert!((40.0..200.0).contains(&mean) && white < 0.05, "{name}: mean {mean}, white {white}");
        }
    }
    assert_eq!(marked, report.people_pixels);
}

/// A text model of COLMAP, read by what its documentation says.
struct Read {
    cameras: Vec<PosedCamera>,
    observations: Vec<Vec<(DVec2, usize)>>,
    points: Vec<(DVec3, Vec<(usize, usize)>)>,
}

fn read(texts: &[(&str, String); 3]) -> Read {
    let lines = |k: usize| texts[k].1.lines().filter(|l| !l.starts_with('#')).map(|l| l.split(' ').collect::<Vec<_>>());
    let number = |text: &str| text.parse::<f64>().unwrap();
    let mut lenses = HashMap::new();
    for line in lines(0) {
        assert_eq!(line[1], "OPENCV");
        let v: Vec<f64> = line[2..].iter().map(|t| number(t)).collect();
        let distortion = Distortion::Brown { k: [v[6], v[7], 0.0, 0.0], p: [v[8], v[9]] };
        let size = [v[0] as u32, v[1] as u32];
        lenses.insert(
            line[0],
            Camera::pinhole(size, DVec2::new(v[2], v[3]), DVec2::new(v[4], v[5]), distortion).unwrap(),
        );
    }
    let mut read = Read { cameras: Vec::new(), observations: Vec::new(), points: Vec::new() };
    let images: Vec<Vec<&str>> = lines(1).collect();
    for (k, pair) in images.chunks(2).enumerate() {
        let head = &pair[0];
        assert_eq!((head[0].to_owned(), head[9].to_owned()), ((k + 1).to_string(), format!("IMG_{:04}.jpg", k + 1)));
        let v: Vec<f64> = head[1..8].iter().map(|t| number(t)).collect();
        let (rotation, translation) = (DQuat::from_xyzw(v[1], v[2], v[3], v[0]), DVec3::new(v[4], v[5], v[6]));
        read.cameras.push(PosedCamera { camera: lenses[head[8]], camera_from_world: Pose { rotation, translation } });
        let seen = pair[1].chunks(3).filter(|c| c.len() == 3);
        read.observations.push(seen.map(|c| (DVec2::new(number(c[0]), number(c[1])), c[2].parse().unwrap())).collect());
    }
    for line in lines(2) {
        let track = line[8..].chunks(2).map(|c| (c[0].parse().unwrap(), c[1].parse().unwrap())).collect();
        read.points.push((DVec3::new(number(line[1]), number(line[2]), number(line[3])), track));
    }
    read
}

#[test]
fn sparse_points_reproject_in_any_frame_with_the_requested_error() {
    let options = options(14, 1);
    let session = Session::new(&options).unwrap();
    let model = |options: &PhotoOptions| {
        let model = colmap::Model::new(&session, options);
        (read(&model.texts(&session)), model)
    };
    let distances = |read: &Read| -> Vec<f64> {
        let mut all = Vec::new();
        for (number, (position, track)) in read.points.iter().enumerate() {
            assert!(track.len() >= 2);
            for (image, index) in track {
                let (at, point) = read.observations[image - 1][*index];
                assert_eq!(point, number + 1);
                all.push(read.cameras[image - 1].project(*position).unwrap().distance(at));
            }
        }
        all
    };
    let (survey, _) = model(&options);
    assert!(survey.points.len() > 150, "{}", survey.points.len());
    assert!(distances(&survey).into_iter().all(|d| d < 1.0));
    let on_surface = survey.points.iter().filter(|(p, _)| session.surface_at(*p).is_some()).count();
    assert!(on_surface * 10 > survey.points.len() * 9);
    for (camera, photo) in survey.cameras.iter().zip(session.photos()) {
        assert!(camera.position().distance(photo.position) < 1e-9);
    }

    let (sfm, built) = model(&PhotoOptions { sfm_frame: true, ..options.clone() });
    assert!(distances(&sfm).into_iter().all(|d| d < 1.0));
    let back = built.frame.inverse();
    for (a, b) in sfm.points.iter().zip(&survey.points) {
        assert!((back.rotation * a.0 * back.scale + back.shift).distance(b.0) < 1e-9);
    }
    assert!(sfm.points[0].0.distance(survey.points[0].0) > 0.5 && (back.scale - 1.0).abs() > 0.5);
    assert!((back.rotation * back.rotation.transpose()).abs_diff_eq(DMat3::IDENTITY, 1e-12));

    let (off, built) = model(&PhotoOptions { pose_error: 6.0, ..options });
    let distances = distances(&off);
    let mean_square = distances.iter().map(|d| d * d).sum::<f64>() / distances.len() as f64;
    assert!((mean_square.sqrt() - 6.0).abs() < 0.6, "{}", mean_square.sqrt());
    assert!(built.given.iter().all(|given| (given.error - 6.0).abs() < 0.3));
}

#[test]
fn requests_that_cannot_be_met_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("photos");
    let refused = |options: PhotoOptions, text: &str| {
        let error = write(&options, &out, &mut |_, _| {}).unwrap_err().to_string();
        assert!(error.contains(text), "{error}");
    };
    refused(PhotoOptions::new(0, SIZE), "0 photographs and 0 panoramas");
    refused(PhotoOptions::new(3_000, SIZE), "at most 2000 photographs");
    refused(PhotoOptions::new(3, (10, 72)), "10 × 72 pixels");
    refused(PhotoOptions::new(3, (400, 72)), "at most 4 times");
    refused(PhotoOptions { exposure: f64::NAN, ..PhotoOptions::new(3, SIZE) }, "the exposure cannot be NaN");
    refused(PhotoOptions { hours: 7.0, ..PhotoOptions::new(3, SIZE) }, "number from 0 to 6");
    refused(PhotoOptions { passers_by: -1.0, ..PhotoOptions::new(3, SIZE) }, "the share of people");
    std::fs::write(&out, "").unwrap();
    refused(PhotoOptions::new(1, SIZE), "already exists");
}
