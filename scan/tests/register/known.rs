//! Known poses, control points and fixed stations: they determine the position of the survey, and those that contradict the scans are refused.

use super::Surveyed;
use super::runs::{LAST, STANDS, lodge, lodge_scanned, national_grid};
use super::scene::Scanner;
use glam::{DQuat, DVec3};
use kilwa_scan::ScanError;
use kilwa_scan::import::Silent;
use kilwa_scan::register::{Options, Placement, Registration, register};
use kilwa_scan_core::Pose;
use std::fmt::Write as _;

impl Surveyed {
    /// The true pose of a station in the coordinates of a national grid.
    fn in_grid(&self, name: &str) -> Pose {
        self.truth.pose(name).then(national_grid())
    }

    /// Enter a pose with standard deviations: metres, degrees.
    fn know(&self, name: &str, pose: Pose, [metres, degrees]: [f64; 2]) {
        self.set_pose(name, Some(pose));
        self.set_sigma(name, [metres, f64::to_radians(degrees)]);
    }

    /// Enter a control point (in the coordinates of the truth) that a station observed.
    fn observe(&self, point: &str, station: &str, at: DVec3) {
        self.control(point, Some(station), self.truth.pose(station).inverse().apply(at));
    }

    fn control(&self, point: &str, station: Option<&str>, at: DVec3) {
        let file = self.folder().join("survey.toml");
        let mut text = std::fs::read_to_string(&file).unwrap();
        let station = station.map(|name| format!("station = \"{name}\"\n")).unwrap_or_default();
        writeln!(text, "\n[[control]]\nname = \"{point}\"\n{station}at = {:?}", at.to_array()).unwrap();
        std::fs::write(&file, text).unwrap();
    }

    /// The sentence with which a registration is refused.
    fn refused(&self) -> String {
        match register(&self.folder(), &self.survey(), &Options::default(), &Silent) {
            Err(ScanError::Request(sentence)) => sentence,
            other => panic!("{other:?}"),
        }
    }
}

/// Fails unless all stations are within 5 mm and 0.05° of the truth in the national grid, not only relative to each other.
fn are_in_grid(surveyed: &Surveyed, found: &Registration) {
    assert_eq!(found.unplaced, []);
    for placed in &found.stations {
        let (angle, distance) = placed.pose().difference(surveyed.in_grid(&placed.name));
        let (name, degrees) = (&placed.name, angle.to_degrees());
        assert!(
            distance < 0.005 && degrees < 0.05,
            "{name}: {distance} m, {degrees}°\n{}",
            surveyed.truth.table(found)
        );
    }
}

#[test]
fn known_headings_on_both_sides_of_north_are_not_a_whole_turn_apart() {
    let surveyed = lodge_scanned(61);
    for (name, heading) in [("entrance", 0.1), ("room", -0.1)] {
        // Turned so that the heading of this station is near zero.
        let own = surveyed.truth.pose(name);
        let turn = DQuat::from_rotation_z(heading - own.rotation.to_euler(glam::EulerRot::ZYX).0);
        let frame = Pose { rotation: turn, translation: DVec3::ZERO };
        for (name, _) in STANDS {
            surveyed.know(name, surveyed.truth.pose(name).then(frame), [0.005, 0.05]);
        }
        let found = surveyed.register();
        surveyed.truth.all_placed(&found);
        for placed in &found.stations {
            let (angle, distance) = placed.pose().difference(surveyed.truth.pose(&placed.name).then(frame));
            assert!(angle < 1e-3 && distance < 0.01, "{}: {angle} rad, {distance} m", placed.name);
        }
    }
}

#[test]
fn a_fixed_station_outweighs_a_rough_known_pose() {
    let surveyed = lodge_scanned(62);
    surveyed.set_pose("room", Some(surveyed.in_grid("room")));
    for name in ["yard", "entrance", "passage"] {
        let mut rough = surveyed.in_grid(name);
        rough.translation += DVec3::new(0.8, -0.5, 0.3);
        surveyed.know(name, rough, [1.0, 3.0]);
    }
    let found = surveyed.register_with(&Options { fixed: vec!["room".into()], ..Options::default() });
    are_in_grid(&surveyed, &found);
}

#[test]
fn rough_known_poses_far_from_the_origin_place_the_survey_without_deforming_it() {
    let surveyed = lodge_scanned(63);
    let national_grid = Pose { translation: DVec3::new(4.1e5, 5.3e6, 12.0), ..national_grid() };
    for (k, (name, _)) in STANDS.into_iter().enumerate() {
        let mut rough = surveyed.truth.pose(name).then(national_grid);
        rough.translation += DVec3::new(0.5, -0.3, 0.1) * if k % 2 == 0 { 1.0 } else { -1.0 };
        rough.rotation = DQuat::from_rotation_z(if k == 0 { 0.15 } else { 0.05 }) * rough.rotation;
        surveyed.know(name, rough, [0.5, 8.0]);
    }
    let found = surveyed.register();
    surveyed.truth.all_placed(&found);
    assert!(found.stations.iter().all(|placed| placed.placement == Placement::Surface), "{found:?}");
    let off = found.stations[0].pose().translation - surveyed.truth.pose("yard").then(national_grid).translation;
    assert!(off.length() < 1.0, "{off}");
}

#[test]
fn survey_points_seen_by_different_stations_place_the_survey() {
    let surveyed = lodge_scanned(64);
    let points = [
        ("corner", "yard", DVec3::new(4.5, -4.0, 0.5)),
        ("sill", "room", DVec3::new(5.6, 0.0, 1.0)),
        ("post", "passage", DVec3::new(7.3, 0.7, 2.0)),
    ];
    for (point, station, at) in points {
        surveyed.observe(point, station, at);
        surveyed.control(point, None, national_grid().apply(at));
    }
    let found = surveyed.register();
    surveyed.truth.all_placed(&found);
    assert!(found.stations.iter().all(|placed| placed.placement != Placement::Anchor), "{found:?}");
    for placed in &found.stations {
        let distance = placed.pose().translation.distance(surveyed.in_grid(&placed.name).translation);
        assert!(distance < 0.02, "{}: {distance} m", placed.name);
    }
}

#[test]
fn collinear_survey_points_do_not_place_the_survey_and_a_note_says_so() {
    let surveyed = lodge_scanned(65);
    for (point, station, x) in [("a", "yard", 0.0), ("b", "room", 2.0), ("c", "passage", 5.0)] {
        let at = DVec3::new(x, 1.0, 1.0);
        surveyed.observe(point, station, at);
        surveyed.control(point, None, national_grid().apply(at));
    }
    let found = surveyed.register();
    surveyed.truth.all_placed(&found);
    assert_eq!(found.stations.iter().filter(|placed| placed.placement == Placement::Anchor).count(), 1);
    assert!(found.notes.iter().any(|note| note.contains("control points")), "{:?}", found.notes);
}

#[test]
fn a_wrong_survey_point_is_refused_even_if_no_station_saw_three() {
    let surveyed = lodge_scanned(66);
    for (k, (point, station, at)) in [
        ("corner", "yard", DVec3::new(4.5, -4.0, 0.5)),
        ("sill", "room", DVec3::new(5.6, 0.0, 1.0)),
        ("post", "passage", DVec3::new(7.3, 0.7, 2.0)),
        ("step", "entrance", DVec3::new(1.5, 0.0, 0.0)),
    ]
    .into_iter()
    .enumerate()
    {
        surveyed.observe(point, station, at);
        let wrong = if k == 3 { DVec3::new(1.0, 0.0, 0.0) } else { DVec3::ZERO };
        surveyed.control(point, None, national_grid().apply(at + wrong));
    }
    let sentence = surveyed.refused();
    assert!(sentence.contains("control point step"), "{sentence}");
}

#[test]
fn stations_fixed_with_the_same_pose_are_refused_by_name() {
    let surveyed = lodge_scanned(67);
    for name in ["yard", "room"] {
        surveyed.set_pose(name, Some(Pose::IDENTITY));
    }
    let options = Options { fixed: vec!["yard".into(), "room".into()], ..Options::default() };
    match register(&surveyed.folder(), &surveyed.survey(), &options, &Silent) {
        Err(ScanError::Request(sentence)) => {
            assert!(sentence.contains("yard") && sentence.contains("room"), "{sentence}");
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_station_whose_known_pose_is_wrong_is_refused_and_the_rest_is_placed() {
    let surveyed = lodge_scanned(68);
    for (name, _) in STANDS {
        let mut pose = surveyed.in_grid(name);
        pose.translation += if name == "yard" { DVec3::new(3.0, 1.0, 0.0) } else { DVec3::ZERO };
        surveyed.know(name, pose, [0.02, 0.5]);
    }
    let found = surveyed.register();
    let reasons: Vec<(&str, &str)> = found.unplaced.iter().map(|u| (u.name.as_str(), u.reason.as_str())).collect();
    assert!(matches!(reasons[..], [("yard", reason)] if reason.contains("survey.toml")), "{reasons:?}");
    surveyed.truth.never_wrong(&found);
}

#[test]
fn an_added_station_is_as_uncertain_as_if_all_were_registered_together() {
    let scene = lodge();
    let mut surveyed = lodge_scanned(69);
    let first = surveyed.register();
    surveyed.truth.all_placed(&first);
    surveyed.apply(&first);
    surveyed.add(&Scanner::default(), &scene, &[LAST], 69);
    let sigma = |found: &Registration| {
        let placed = found.stations.iter().find(|placed| placed.name == LAST.0).unwrap();
        assert_eq!(placed.placement, Placement::Surface);
        placed.sigma()
    };
    let added = sigma(&surveyed.register());
    let anchor = first.stations.iter().find(|placed| placed.placement == Placement::Anchor).unwrap();
    // The same frame: poses are relative to the anchor of the first run.
    let fixed = vec![anchor.name.clone()];
    let together = sigma(&surveyed.register_with(&Options { again: true, fixed, ..Options::default() }));
    for (added, together) in added.into_iter().zip(together) {
        assert!((0.7..1.4).contains(&(added / together)), "{added} added, {together} together");
    }
}

#[test]
fn a_survey_located_by_rough_poses_is_as_uncertain_as_they_are() {
    let surveyed = lodge_scanned(70);
    surveyed.know("room", surveyed.in_grid("room"), [0.5, 2.0]);
    let found = surveyed.register();
    surveyed.truth.all_placed(&found);
    for placed in &found.stations {
        let [metres, radians] = placed.sigma();
        assert!(
            (0.4..1.5).contains(&metres) && (1.0..5.0).contains(&radians.to_degrees()),
            "{}: {metres} m, {radians} rad",
            placed.name
        );
    }
}

#[test]
fn an_added_station_is_no_more_certain_than_the_rough_poses_that_locate_the_survey() {
    let mut surveyed = lodge_scanned(72);
    surveyed.know("room", surveyed.in_grid("room"), [0.5, 2.0]);
    surveyed.apply(&surveyed.register());
    surveyed.add(&Scanner::default(), &lodge(), &[LAST], 72);
    let found = surveyed.register();
    let added = found.stations.iter().find(|placed| placed.name == LAST.0).unwrap();
    let [metres, radians] = added.sigma();
    assert!((0.4..1.5).contains(&metres) && (1.0..5.0).contains(&radians.to_degrees()), "{metres} m, {radians} rad");
}

#[test]
fn stations_are_not_placed_by_control_points_that_contradict_the_scans() {
    let surveyed = lodge_scanned(71);
    // The numbers of the targets were exchanged, so that the room comes to lie across its wall.
    for (k, (x, y)) in [(0.5, 0.5), (4.0, 0.5), (4.0, 3.5), (0.5, 3.5)].into_iter().enumerate() {
        surveyed.observe(&format!("p{k}"), "room", DVec3::new(x, y, 1.0));
        surveyed.observe(&format!("p{k}"), "entrance", DVec3::new(4.0 - y, x - 3.0, 1.0));
    }
    let found = surveyed.register();
    surveyed.truth.never_wrong(&found);
    assert!(found.unplaced.iter().any(|u| u.name == "room" || u.name == "entrance"), "{found:?}");
}
