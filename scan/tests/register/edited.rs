//! Surveys that are edited before, between and during registrations: nothing that was entered by hand is lost or mistaken for a registration result.

use super::runs::{LAST, STANDS, lodge, lodge_scanned};
use super::scene::Scanner;
use super::{Surveyed, registered};
use glam::DVec3;
use kilwa_scan::ScanError;
use kilwa_scan::import::Silent;
use kilwa_scan::register::{FILE, Link, Options, Registration, Unplaced, apply, register};
use kilwa_scan_core::Pose;
use std::fs;

const AGAIN: Options = Options { again: true, ignore_poses: false, fixed: Vec::new(), threads: 0 };

impl Surveyed {
    /// Replace text in `survey.toml`.
    fn replace(&self, old: &str, new: &str) {
        let file = self.folder().join("survey.toml");
        let text = fs::read_to_string(&file).unwrap();
        assert!(text.contains(old), "{old:?} is not in {text}");
        fs::write(&file, text.replace(old, new)).unwrap();
    }

    fn registered_and_applied(seed: u64) -> (Self, Registration) {
        let surveyed = lodge_scanned(seed);
        let found = surveyed.register();
        surveyed.truth.all_placed(&found);
        surveyed.apply(&found);
        (surveyed, found)
    }
}

#[test]
fn a_pose_edited_after_registration_does_not_count_as_known() {
    let (surveyed, first) = Surveyed::registered_and_applied(71);
    let moved = surveyed.survey().station("passage").unwrap().pose.unwrap();
    surveyed.set_pose("passage", Some(Pose { translation: moved.translation + DVec3::new(0.1, 0.0, 0.0), ..moved }));
    let again = surveyed.register_with(&AGAIN);
    assert_eq!(again.unplaced, []);
    for placed in &again.stations {
        let before = first.stations.iter().find(|other| other.name == placed.name).unwrap();
        let (_, distance) = placed.pose().difference(before.pose());
        assert!(distance < 0.005, "{} is {distance} m from where it was registered", placed.name);
    }
}

#[test]
fn known_poses_are_remembered_when_all_stations_are_registered_again() {
    let surveyed = lodge_scanned(72);
    let offset = DVec3::new(100.0, 200.0, 5.0);
    for (name, _) in STANDS {
        let pose = surveyed.truth.pose(name).then(Pose::at(offset));
        surveyed.set_pose(name, Some(pose));
        surveyed.set_sigma(name, [0.02, 0.01]);
    }
    let mut found = surveyed.register();
    for _ in 0..2 {
        for placed in &found.stations {
            let stated = placed.stated.unwrap_or_else(|| panic!("the known pose of {} is lost", placed.name));
            let expected = surveyed.truth.pose(&placed.name).then(Pose::at(offset));
            assert!(stated.pose().difference(expected).1 < 1e-9, "{stated:?}");
            let [metres, radians] = stated.sigma.unwrap();
            assert!((metres - 0.02).abs() < 1e-9 && (radians - 0.01).abs() < 1e-9, "{stated:?}");
        }
        surveyed.apply(&found);
        found = surveyed.register_with(&AGAIN);
        surveyed.truth.all_placed(&found);
    }
}

#[test]
fn a_station_renamed_between_two_registrations_stays_registered() {
    let (surveyed, first) = Surveyed::registered_and_applied(79);
    surveyed.replace("name = \"passage\"", "name = \"door\"");
    let second = registered(&surveyed.folder(), &Options::default());
    assert_eq!(second.unplaced, []);
    let of = |found: &Registration, name: &str| {
        found.stations.iter().find(|placed| placed.name == name).map(|placed| (placed.translation, placed.covariance))
    };
    assert_eq!(of(&first, "passage"), of(&second, "door"));
    let is_former = |link: &Link| link.stations.iter().any(|name| name == "passage");
    let is_current = |link: &Link| link.stations.iter().any(|name| name == "door");
    assert!(first.links.iter().any(is_former) && second.links.iter().any(is_current));
    assert!(!second.links.iter().any(is_former), "{:?}", second.links);
}

#[test]
fn fixing_a_registered_station_neither_loses_its_known_pose_nor_makes_the_registered_one_known() {
    let surveyed = lodge_scanned(80);
    let own = surveyed.truth.pose("room");
    surveyed.set_pose("room", Some(own));
    surveyed.set_sigma("room", [0.02, 0.01]);
    surveyed.apply(&surveyed.register());
    let found = surveyed.register_with(&Options { fixed: vec!["room".into()], ..AGAIN });
    let room = found.stations.iter().find(|placed| placed.name == "room").unwrap();
    assert!(room.stated.is_some_and(|stated| stated.pose().difference(own).1 < 1e-9), "{room:?}");
    surveyed.apply(&found);
    assert_eq!(surveyed.survey().station("room").unwrap().sigma, None);
    let found = surveyed.register_with(&AGAIN);
    let room = found.stations.iter().find(|placed| placed.name == "room").unwrap();
    assert!(room.sigma()[0] > 0.01, "it is known to 2 cm only: {room:?}");
}

/// As if this station could not be placed.
fn without(found: &Registration, name: &str) -> Registration {
    let mut out = found.clone();
    out.stations.retain(|placed| placed.name != name);
    out.links.retain(|link| !link.stations.iter().any(|own| own == name));
    let [reason, remedy] = ["no reason".to_owned(), "no remedy".to_owned()];
    out.unplaced.push(Unplaced { name: name.to_owned(), scan: String::new(), reason, candidates: Vec::new(), remedy });
    out
}

#[test]
fn a_station_that_is_no_longer_placed_gets_back_the_pose_that_was_replaced() {
    let surveyed = lodge_scanned(73);
    let own = surveyed.truth.pose("yard");
    surveyed.set_pose("yard", Some(own));
    surveyed.set_sigma("yard", [0.02, 0.01]);
    let found = surveyed.register();
    surveyed.apply(&found);
    surveyed.apply(&without(&without(&found, "yard"), "room"));
    let survey = surveyed.survey();
    let yard = survey.station("yard").unwrap();
    assert!(yard.pose.unwrap().difference(own).1 < 1e-9, "{yard:?}");
    assert!((yard.sigma.unwrap()[0] - 0.02).abs() < 1e-9, "{yard:?}");
    let room = survey.station("room").unwrap();
    assert!(room.pose.is_none_or(|pose| pose == Pose::IDENTITY) && room.sigma.is_none(), "{room:?}");
}

#[test]
fn an_unplaced_station_keeps_a_shared_pose_unless_it_is_the_identity() {
    let surveyed = lodge_scanned(74);
    let shared = Pose::at(DVec3::new(5e5, 4e6, 20.0));
    surveyed.set_pose("yard", Some(shared));
    surveyed.set_pose("room", Some(shared));
    let mut found = surveyed.register();
    for (name, _) in STANDS {
        found = without(&found, name);
    }
    surveyed.apply(&found);
    let survey = surveyed.survey();
    let poses = STANDS.map(|(name, _)| survey.station(name).unwrap().pose);
    assert_eq!(poses, [Some(shared), None, Some(shared), None]);
}

#[test]
fn stations_renamed_during_a_run_are_recognised_and_those_changed_or_removed_are_left_alone() {
    let surveyed = lodge_scanned(75);
    let read = surveyed.survey();
    let found = surveyed.register();
    surveyed.truth.all_placed(&found);
    surveyed.replace("name = \"yard\"", "name = \"court\"");
    let entered = Pose::at(DVec3::new(1.0, 2.0, 3.0));
    surveyed.set_pose("room", Some(entered));
    let left = apply(&surveyed.folder(), &read, &found).unwrap();
    assert!(matches!(&left[..], [one] if one.contains("room")), "{left:?}");
    let survey = surveyed.survey();
    let of = |name: &str| found.stations.iter().find(|placed| placed.name == name).unwrap().pose();
    assert!(survey.station("court").unwrap().pose.unwrap().difference(of("yard")).1 < 1e-9);
    assert_eq!(survey.station("room").unwrap().pose, Some(entered));
    let kept = Registration::open(&surveyed.folder()).unwrap().unwrap();
    let names: Vec<&str> = kept.stations.iter().map(|placed| placed.name.as_str()).collect();
    assert_eq!(names, ["court", "entrance", "passage"]);
    let is_known = |name: &String| names.contains(&name.as_str());
    assert!(kept.links.iter().all(|link| link.stations.iter().all(is_known)), "{:?}", kept.links);

    // Names that were exchanged: poses follow the scans.
    let read = surveyed.survey();
    surveyed.replace("name = \"court\"", "name = \"x\"");
    surveyed.replace("name = \"passage\"", "name = \"court\"");
    surveyed.replace("name = \"x\"", "name = \"passage\"");
    assert_eq!(apply(&surveyed.folder(), &read, &kept).unwrap(), [""; 0]);
    assert!(surveyed.survey().station("passage").unwrap().pose.unwrap().difference(of("yard")).1 < 1e-9);
}

#[test]
fn a_station_removed_after_registration_is_forgotten() {
    let (surveyed, first) = Surveyed::registered_and_applied(76);
    let file = surveyed.folder().join("survey.toml");
    let text = fs::read_to_string(&file).unwrap();
    let parts: Vec<&str> = text.split("[[station]]").collect();
    let kept: Vec<&str> = parts.into_iter().filter(|part| !part.contains("name = \"yard\"")).collect();
    fs::write(&file, kept.join("[[station]]")).unwrap();
    let second = surveyed.register();
    assert_eq!(second.stations.len(), first.stations.len() - 1);
    surveyed.apply(&second);
}

#[test]
fn a_damaged_result_is_reported_with_a_remedy_and_replaced_on_request() {
    let (surveyed, _) = Surveyed::registered_and_applied(77);
    let file = surveyed.folder().join(FILE);
    let text = fs::read_to_string(&file).unwrap();
    let wrong_pose = text.replacen("\"rotation\": [", "\"rotation\": [9.0, ", 1);
    let cut = &text[..text.len() / 2];
    for damaged in [cut.as_bytes(), wrong_pose.as_bytes(), b"\xff\xfe", b"", b"{\"version\": 9}"] {
        fs::write(&file, damaged).unwrap();
        match register(&surveyed.folder(), &surveyed.survey(), &Options::default(), &Silent) {
            Err(ScanError::Request(sentence)) => {
                assert!(sentence.contains(FILE) && sentence.contains("--again"), "{sentence}");
            }
            other => panic!("{other:?}"),
        }
    }
    let found = surveyed.register_with(&AGAIN);
    surveyed.truth.all_placed(&found);
    surveyed.apply(&found);
    assert!(Registration::open(&surveyed.folder()).unwrap().is_some());
}

#[test]
fn adding_stations_does_not_change_the_stored_original_poses_of_the_others() {
    let scene = lodge();
    let (mut surveyed, first) = Surveyed::registered_and_applied(78);
    surveyed.add(&Scanner::default(), &scene, &[LAST], 78);
    let second = surveyed.register();
    for placed in &first.stations {
        let now = second.stations.iter().find(|other| other.name == placed.name).unwrap();
        assert_eq!(now.stated, placed.stated, "{}", placed.name);
    }
}
