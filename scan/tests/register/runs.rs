//! Properties of runs: bit-identical results for any number of threads and any order of files; registered stations keep their poses, and fixed stations never move.

use super::scene::{Scanner, Scene, door, window};
use super::{Surveyed, registered};
use glam::{DQuat, DVec3};
use kilwa_scan::ScanError;
use kilwa_scan::import::Silent;
use kilwa_scan::register::{Options, Placed, Placement, Registration, Residual, register, residuals};
use kilwa_scan_core::Pose;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Two rooms with a yard in front of them.
pub(super) fn lodge() -> Scene {
    let mut scene = Scene::default();
    scene.ground().block([-0.2, -0.2, 2.8], [8.2, 4.2, 3.1]);
    scene.wall([0.0, 0.0], [8.0, 0.0], 2.8, &[door(1.5, 2.7), window(5.4, 6.6)]).wall([8.0, 0.0], [8.0, 4.0], 2.8, &[]);
    scene.wall([8.0, 4.0], [0.0, 4.0], 2.8, &[window(5.0, 6.0)]).wall([0.0, 4.0], [0.0, 0.0], 2.8, &[]);
    scene.wall([4.6, 0.0], [4.6, 4.0], 2.8, &[door(1.6, 2.7)]);
    scene.furniture([0.6, 3.4], [0.8, 0.9, 1.9], 0.0).furniture([3.6, 3.5], [1.4, 0.6, 0.9], 0.0);
    scene.column([7.3, 0.7], 0.3, 1.1).furniture([6.4, 3.4], [1.7, 0.8, 0.6], 15.0);
    scene.furniture([4.5, -4.0], [2.0, 1.2, 1.1], 20.0).column([0.0, -3.0], 0.35, 3.0);
    scene
}

pub(super) const STANDS: [(&str, [f64; 3]); 4] = [
    ("yard", [2.2, -2.5, 1.7]),
    ("entrance", [2.1, 0.3, 1.6]),
    ("room", [2.4, 2.2, 1.6]),
    ("passage", [4.6, 2.15, 1.55]),
];
pub(super) const LAST: (&str, [f64; 3]) = ("back", [6.2, 1.9, 1.6]);

/// Scans of the lodge with fewer points, for tests that do not depend on precision.
pub(super) fn lodge_scanned(seed: u64) -> Surveyed {
    let mut surveyed = Surveyed::new();
    surveyed.add(&Scanner { columns: 240, rows: 100, ..Scanner::default() }, &lodge(), &STANDS, seed);
    surveyed
}

/// All numbers of the placed stations by name, as bits.
fn bits(found: &Registration) -> BTreeMap<String, Vec<u64>> {
    let numbers = |placed: &Placed| {
        let covariance = placed.covariance.iter().flatten();
        placed.rotation.iter().chain(&placed.translation).chain(covariance).map(|v| v.to_bits()).collect()
    };
    found.stations.iter().map(|placed| (placed.name.clone(), numbers(placed))).collect()
}

/// The poses alone.
fn pose_bits(found: &Registration) -> BTreeMap<String, Vec<u64>> {
    bits(found).into_iter().map(|(name, numbers)| (name, numbers[..7].to_vec())).collect()
}

/// Names and contents of all files in a folder.
fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut all = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        if entry.is_dir() {
            all.append(&mut contents(&entry));
        } else {
            let bytes = std::fs::read(&entry).unwrap();
            all.insert(entry, bytes);
        }
    }
    all
}

#[test]
fn poses_are_bit_identical_for_any_number_of_threads_and_order_of_files() {
    let scene = lodge();
    let mut surveyed = Surveyed::new();
    let files: Vec<PathBuf> =
        STANDS.iter().map(|(name, at)| surveyed.scan(&Scanner::default(), &scene, name, *at, 51)).collect();
    surveyed.import(&files);
    let first = surveyed.register_with(&Options { threads: 1, ..Options::default() });
    surveyed.truth.all_placed(&first);
    for threads in [2, 8] {
        let found = registered(&surveyed.folder(), &Options { threads, ..Options::default() });
        assert_eq!(bits(&first), bits(&found), "{threads} threads");
        assert_eq!(first, found, "{threads} threads");
    }
    for order in [[3, 1, 0, 2], [2, 3, 1, 0]] {
        let files: Vec<PathBuf> = order.iter().map(|k| files[*k].clone()).collect();
        std::fs::remove_dir_all(surveyed.folder()).unwrap();
        surveyed.import(&files);
        let found = registered(&surveyed.folder(), &Options::default());
        assert_eq!(bits(&first), bits(&found), "order {order:?}");
    }
}

#[test]
fn only_apply_writes_and_it_writes_poses_with_standard_deviations() {
    let surveyed = Surveyed::of(&lodge(), &STANDS[..3], 52);
    let before = contents(&surveyed.folder());
    let found = surveyed.register();
    surveyed.truth.all_placed(&found);
    assert!(before == contents(&surveyed.folder()), "finding poses writes nothing");
    assert_eq!(Registration::open(&surveyed.folder()).unwrap(), None);
    surveyed.apply(&found);
    assert_eq!(Registration::open(&surveyed.folder()).unwrap().as_ref(), Some(&found));
    let survey = surveyed.survey();
    for station in &survey.stations {
        let placed =
            found.of(station).unwrap_or_else(|| panic!("the pose of {} is not in registration.json", station.name));
        let pose = station.pose.unwrap();
        assert_eq!(
            pose.translation.to_array().map(f64::to_bits),
            placed.translation.map(f64::to_bits),
            "{}",
            station.name
        );
        let q = pose.rotation;
        for (entered, own) in [q.w, q.x, q.y, q.z].into_iter().zip(placed.rotation) {
            assert!((entered - own).abs() < 1e-15, "{}: {q}, {:?}", station.name, placed.rotation);
        }
        if placed.placement == Placement::Surface {
            let ([metres, radians], own) = (placed.sigma(), station.sigma.unwrap());
            assert!((own[0] / metres - 1.0).abs() < 0.01, "{}: {own:?}, {metres} m", station.name);
            let degrees = radians.to_degrees();
            assert!(
                [degrees, radians].iter().any(|r| (own[1] / r - 1.0).abs() < 0.01),
                "{}: {own:?}, {degrees}°",
                station.name
            );
        }
    }
}

#[test]
fn an_added_station_is_placed_and_the_other_poses_stay() {
    let scene = lodge();
    let mut surveyed = Surveyed::of(&scene, &STANDS, 53);
    let first = surveyed.register();
    surveyed.truth.all_placed(&first);
    surveyed.apply(&first);
    surveyed.add(&Scanner::default(), &scene, &[LAST], 53);
    let mut second = surveyed.register();
    surveyed.truth.all_placed(&second);
    surveyed.apply(&second);
    let survey = surveyed.survey();
    for (name, pose) in pose_bits(&first) {
        assert_eq!(pose_bits(&second)[&name], pose, "{name} has moved");
        assert!(first.of(survey.station(&name).unwrap()).is_some(), "{name} has moved in survey.toml");
    }
    // A station that cannot be placed changes nothing either.
    let mut other = Scene::default();
    other.ground().furniture([3.0, 0.0], [1.0, 7.0, 4.0], 10.0).column([-2.0, 2.0], 0.8, 5.0);
    surveyed.add(&Scanner::default(), &other, &[("elsewhere", [0.0, 0.0, 1.6])], 53);
    let third = surveyed.register();
    assert_eq!(third.unplaced.iter().map(|u| u.name.as_str()).collect::<Vec<_>>(), ["elsewhere"]);
    assert_eq!(pose_bits(&second), pose_bits(&third));
    // A second run gives the same result.
    surveyed.apply(&third);
    second = surveyed.register();
    assert_eq!(bits(&third), bits(&second));
}

/// Where the survey's coordinates are, as seen from those of the truth.
pub(super) fn national_grid() -> Pose {
    Pose { rotation: DQuat::from_rotation_z(0.7), translation: DVec3::new(1200.0, -350.0, 42.0) }
}

#[test]
fn fixed_stations_do_not_move_and_the_others_are_placed_in_their_coordinates() {
    let mut all = STANDS.to_vec();
    all.push(LAST);
    let surveyed = Surveyed::of(&lodge(), &all, 54);
    let toml = surveyed.folder().join("survey.toml");
    for name in ["room", "back"] {
        surveyed.set_pose(name, Some(surveyed.truth.pose(name).then(national_grid())));
    }
    let plain = std::fs::read_to_string(&toml).unwrap();
    let survey = surveyed.survey();
    let check = |found: &Registration| {
        surveyed.truth.all_placed(found);
        for name in ["room", "back"] {
            let placed = found.stations.iter().find(|placed| placed.name == name).unwrap();
            let given = survey.station(name).unwrap().pose.unwrap();
            assert_eq!(placed.placement, Placement::Fixed, "{name}");
            assert_eq!(placed.translation, given.translation.to_array(), "{name} has moved");
            assert!(placed.pose().difference(given).0 < 1e-12, "{name} has turned");
        }
        assert!(found.stations.iter().all(|placed| placed.placement != Placement::Anchor), "{found:?}");
    };
    check(&surveyed.register_with(&Options { fixed: vec!["room".into(), "back".into()], ..Options::default() }));
    let fixed = plain
        .replace("name = \"room\"\n", "name = \"room\"\nfixed = true\n")
        .replace("name = \"back\"\n", "name = \"back\"\nfixed = true\n");
    std::fs::write(&toml, fixed).unwrap();
    for (again, ignore_poses) in [(false, false), (true, false), (true, true)] {
        let found = surveyed.register_with(&Options { again, ignore_poses, ..Options::default() });
        check(&found);
        surveyed.apply(&found);
        for name in ["room", "back"] {
            let now = surveyed.survey().station(name).unwrap().clone();
            assert!(now.is_fixed && now.pose == survey.station(name).unwrap().pose, "{now:?}");
        }
    }
}

#[test]
fn a_station_that_cannot_be_fixed_is_refused() {
    let surveyed = Surveyed::of(&lodge(), &STANDS[1..3], 55);
    surveyed.set_pose("room", None);
    for name in ["room", "nowhere"] {
        let options = Options { fixed: vec![name.into()], ..Options::default() };
        match register(&surveyed.folder(), &surveyed.survey(), &options, &Silent) {
            Err(ScanError::Request(sentence)) => assert!(sentence.contains(name), "{sentence}"),
            other => panic!("{name}: {other:?}"),
        }
    }
}

#[test]
fn again_registers_all_stations_and_otherwise_registered_poses_stay() {
    let surveyed = Surveyed::of(&lodge(), &STANDS, 56);
    let first = surveyed.register();
    surveyed.truth.all_placed(&first);
    surveyed.apply(&first);
    let second = surveyed.register();
    assert_eq!(pose_bits(&first), pose_bits(&second), "there is nothing to do");
    for ignore_poses in [false, true] {
        let again = surveyed.register_with(&Options { again: true, ignore_poses, ..Options::default() });
        surveyed.truth.all_placed(&again);
    }
    // A pose that was edited by hand no longer counts as registered (see also `edited.rs`).
    let moved = surveyed.survey().station("passage").unwrap().pose.unwrap();
    surveyed.set_pose("passage", Some(Pose { translation: moved.translation + DVec3::new(0.1, 0.0, 0.0), ..moved }));
    let is_registered = |name: &str| first.of(surveyed.survey().station(name).unwrap()).is_some();
    assert!(!is_registered("passage") && is_registered("room"));
}

#[test]
fn rough_poses_may_help_but_never_harm() {
    let surveyed = Surveyed::of(&lodge(), &STANDS, 57);
    let mut random = fastrand::Rng::with_seed(57);
    for (name, pose) in &surveyed.truth.0 {
        let mut off = || random.f64() - 0.5;
        let translation = pose.translation + DVec3::new(off(), off(), off() * 0.2);
        let rotation = DQuat::from_rotation_z(off() * 0.2) * pose.rotation;
        surveyed.set_pose(name, Some(Pose { rotation, translation }.then(national_grid())));
    }
    surveyed.truth.all_placed(&surveyed.register());
}

/// Whether a sample is at the height of the ground as the lifted station saw it.
fn is_on_ground(lifted: &Registration, residual: &Residual) -> bool {
    let room = lifted.stations.iter().find(|placed| placed.name == "room").unwrap();
    (residual.position.z - (room.translation[2] - 1.6)).abs() < 0.015
}

#[test]
fn residuals_show_a_station_that_is_displaced() {
    let surveyed = lodge_scanned(58);
    let found = surveyed.register();
    surveyed.truth.all_placed(&found);
    let typical = |found: &Registration| {
        let all = residuals(&surveyed.folder(), &surveyed.survey(), found, 0, &Silent).unwrap();
        let mut sizes: Vec<f64> = all.iter().filter_map(|r| r.distance).map(f64::abs).collect();
        assert!(sizes.len() > all.len() / 2, "most surface of the lodge was seen by several stations");
        sizes.sort_unstable_by(f64::total_cmp);
        sizes[sizes.len() * 9 / 10]
    };
    let before = typical(&found);
    assert!(before < 0.008, "{before} m");
    let mut displaced = found.clone();
    let station = displaced.stations.iter_mut().find(|placed| placed.name == "passage").unwrap();
    station.translation[0] += 0.03;
    let after = typical(&displaced);
    assert!(after > 3.0 * before && after < 0.04, "{before} m, {after} m");
    // Raised ground is nearer to the scanners of the other stations, and the ground that they saw lies behind it.
    let mut lifted = found.clone();
    lifted.stations.iter_mut().find(|placed| placed.name == "room").unwrap().translation[2] += 0.03;
    let all = residuals(&surveyed.folder(), &surveyed.survey(), &lifted, 0, &Silent).unwrap();
    let ground: Vec<f64> = all.iter().filter(|r| is_on_ground(&lifted, r)).filter_map(|r| r.distance).collect();
    let above = ground.iter().filter(|distance| **distance > 0.02).count();
    assert!(above > 100, "{above} of {} samples of the ground", ground.len());
}
