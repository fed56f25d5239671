//! Stations that cannot be placed because their pose is not determined: they are refused with a reason, and no pose is invented.

use super::judge::is_whole;
use super::scene::{Scanner, Scene, door, window};
use super::{Surveyed, placed_by_surface, registered};
use glam::DVec3;
use kilwa_scan::ScanError;
use kilwa_scan::import::Silent;
use kilwa_scan::register::{Options, register};
use kilwa_scan_core::Pose;

/// Fails unless only the anchor or fixed stations have a pose, and every other station is listed with a reason and a remedy.
fn refused(surveyed: &Surveyed) {
    let found = surveyed.register();
    surveyed.truth.never_wrong(&found);
    assert!(placed_by_surface(&found).is_empty(), "placed: {}", placed_by_surface(&found).join(", "));
    assert!(found.stations.len() <= 1, "at most the anchor is placed");
    assert!(found.links.is_empty(), "{:?}", found.links);
}

/// A round room, three metres in radius, without a door.
fn tower() -> Scene {
    let mut scene = Scene::default();
    scene.block([-5.0, -5.0, -1.0], [5.0, 5.0, 0.0]).block([-5.0, -5.0, 3.2], [5.0, 5.0, 4.0]);
    scene.column([0.0, 0.0], 3.0, 3.5);
    scene
}

/// Blocks at equal angles along the wall of the tower.
fn niches(scene: &mut Scene, count: u32) {
    for k in 0..count {
        let degrees = 360.0 * f64::from(k) / f64::from(count);
        let (sin, cos) = degrees.to_radians().sin_cos();
        scene.furniture([2.85 * cos, 2.85 * sin], [0.6, 0.7, 1.4], degrees);
    }
}

const TOWER: [(&str, [f64; 3]); 2] = [("one", [0.9, 0.3, 1.6]), ("two", [-0.8, 1.1, 1.5])];

#[test]
fn stations_in_a_round_room_are_refused() {
    for seed in 21..23 {
        refused(&Surveyed::of(&tower(), &TOWER, seed));
    }
}

#[test]
fn stations_in_the_middle_of_a_round_room_are_refused() {
    refused(&Surveyed::of(&tower(), &[("one", [0.0, 0.0, 1.6]), ("two", [0.0, 0.0, 1.6])], 24));
}

#[test]
fn stations_in_a_tower_with_equal_niches_are_refused() {
    for (seed, count) in [(25, 4), (26, 6), (27, 2)] {
        let mut scene = tower();
        niches(&mut scene, count);
        refused(&Surveyed::of(&scene, &TOWER, seed));
    }
}

#[test]
fn a_bench_and_a_barrel_make_the_tower_unambiguous() {
    let mut scene = tower();
    niches(&mut scene, 4);
    scene.furniture([1.6, -1.9], [1.2, 0.5, 0.5], 40.0).column([-2.0, -0.9], 0.35, 0.9);
    for seed in 27..29 {
        let surveyed = Surveyed::of(&scene, &TOWER, seed);
        surveyed.truth.all_placed(&surveyed.register());
    }
}

#[test]
fn a_stair_and_a_cupboard_make_the_tower_unambiguous() {
    let mut scene = tower();
    niches(&mut scene, 4);
    for k in 0..6 {
        let step = f64::from(k);
        scene.block([-2.0 + step * 0.3, -2.3, 0.0], [-1.7 + step * 0.3, -1.4, 0.2 * (step + 1.0)]);
    }
    scene.furniture([1.9, 1.2], [1.4, 0.6, 2.0], 120.0);
    let surveyed = Surveyed::of(&scene, &TOWER, 30);
    surveyed.truth.all_placed(&surveyed.register());
}

/// A room of four equal walls with an equal window in the middle of each.
#[test]
fn stations_in_a_square_room_are_refused() {
    let mut scene = Scene::default();
    scene.ground().block([-3.0, -3.0, 2.8], [3.0, 3.0, 3.1]);
    for (from, to) in
        [([-2.5, -2.5], [2.5, -2.5]), ([2.5, -2.5], [2.5, 2.5]), ([2.5, 2.5], [-2.5, 2.5]), ([-2.5, 2.5], [-2.5, -2.5])]
    {
        scene.wall(from, to, 2.8, &[window(2.0, 3.0)]);
    }
    for seed in 29..31 {
        refused(&Surveyed::of(&scene, &[("one", [0.6, 0.3, 1.6]), ("two", [-0.9, 0.7, 1.5])], seed));
    }
}

/// A corridor, two metres wide, whose ends are beyond the range of the scanner.
fn corridor() -> Scene {
    let mut scene = Scene::default();
    scene.ground().block([-70.0, -1.2, 2.5], [70.0, 1.2, 2.8]);
    scene.wall([-70.0, -1.0], [70.0, -1.0], 2.5, &[]).wall([-70.0, 1.0], [70.0, 1.0], 2.5, &[]);
    scene
}

const ALONG: [(&str, [f64; 3]); 3] = [("one", [0.0, 0.2, 1.6]), ("two", [2.6, -0.3, 1.5]), ("three", [5.5, 0.1, 1.6])];

fn short_sighted() -> Scanner {
    Scanner { max_range: 15.0, ..Scanner::default() }
}

#[test]
fn stations_in_a_corridor_without_features_are_refused() {
    for seed in 33..35 {
        let mut surveyed = Surveyed::new();
        surveyed.add(&short_sighted(), &corridor(), &ALONG, seed);
        refused(&surveyed);
    }
}

/// Identical pillars at equal distances: a pose shifted by one pillar fits equally well.
#[test]
fn stations_at_a_row_of_identical_pillars_are_refused() {
    let mut scene = corridor();
    for k in -35..=35 {
        for y in [-0.9, 0.9] {
            scene.furniture([2.0 * f64::from(k) + 0.7, y], [0.3, 0.25, 2.5], 0.0);
        }
    }
    for seed in 36..38 {
        let mut surveyed = Surveyed::new();
        surveyed.add(&short_sighted(), &scene, &ALONG, seed);
        refused(&surveyed);
    }
}

/// A hall of identical columns, larger than the range of the scanner.
#[test]
fn stations_in_a_hall_of_identical_columns_are_refused() {
    let mut scene = Scene::default();
    scene.ground().block([-40.0, -40.0, 4.0], [40.0, 40.0, 4.4]);
    for i in -10..=10 {
        for j in -10..=10 {
            scene.column([3.0 * f64::from(i), 3.0 * f64::from(j)], 0.3, 4.2);
        }
    }
    let mut surveyed = Surveyed::new();
    let stands = [("one", [1.2, 0.9, 1.6]), ("two", [4.6, 1.9, 1.5])];
    surveyed.add(&Scanner { max_range: 12.0, ..Scanner::default() }, &scene, &stands, 39);
    refused(&surveyed);
}

/// A yard with crates and posts.
fn yard() -> Scene {
    let mut scene = Scene::default();
    scene.ground().furniture([4.0, 1.0], [2.0, 1.4, 1.2], 20.0).furniture([-3.0, 3.5], [1.0, 1.0, 2.2], 50.0);
    scene.column([1.0, -4.0], 0.3, 3.0).column([-4.5, -2.0], 0.4, 2.5).furniture([0.5, 6.0], [5.0, 0.4, 2.0], -8.0);
    scene
}

/// A closed store with shelves.
fn store() -> Scene {
    let mut scene = Scene::default();
    scene.ground().block([-0.2, -0.2, 3.4], [7.2, 3.2, 3.7]);
    scene.wall([0.0, 0.0], [7.0, 0.0], 3.4, &[]).wall([7.0, 0.0], [7.0, 3.0], 3.4, &[]);
    scene.wall([7.0, 3.0], [0.0, 3.0], 3.4, &[]).wall([0.0, 3.0], [0.0, 0.0], 3.4, &[]);
    scene.furniture([2.0, 0.4], [2.6, 0.5, 2.0], 0.0).furniture([6.5, 2.4], [0.6, 0.9, 1.0], 0.0);
    scene
}

/// A tall stair hall.
fn stairs() -> Scene {
    let mut scene = Scene::default();
    scene.ground().block([-0.2, -0.2, 6.0], [4.2, 6.7, 6.3]);
    scene.wall([0.0, 0.0], [4.0, 0.0], 6.0, &[door(1.0, 2.2)]).wall([4.0, 0.0], [4.0, 6.5], 6.0, &[]);
    scene.wall([4.0, 6.5], [0.0, 6.5], 6.0, &[]).wall([0.0, 6.5], [0.0, 0.0], 6.0, &[window(1.5, 2.5)]);
    for k in 0..12 {
        let step = f64::from(k);
        scene.block([2.6, 1.5 + step * 0.3, 0.0], [3.9, 1.8 + step * 0.3, 0.18 * (step + 1.0)]);
    }
    scene
}

#[test]
fn scans_of_unrelated_places_are_refused() {
    let mut surveyed = Surveyed::new();
    surveyed.add(&Scanner::default(), &yard(), &[("yard", [0.0, 0.0, 1.6])], 40);
    surveyed.add(&Scanner::default(), &store(), &[("store", [3.9, 1.7, 1.5])], 40);
    surveyed.add(&Scanner::default(), &stairs(), &[("stairs", [1.3, 3.4, 1.6])], 40);
    let found = surveyed.register();
    is_whole(&found, &["yard", "store", "stairs"]);
    assert!(placed_by_surface(&found).is_empty(), "placed: {}", placed_by_surface(&found).join(", "));
}

#[test]
fn a_scan_of_another_place_is_refused_and_the_rest_is_placed() {
    let mut surveyed = Surveyed::new();
    surveyed.add(&Scanner::default(), &stairs(), &[("stairs", [1.3, 3.4, 1.6]), ("landing", [1.6, 5.2, 1.5])], 41);
    surveyed.add(&Scanner::default(), &store(), &[("store", [3.9, 1.7, 1.5])], 41);
    let found = surveyed.register();
    surveyed.truth.never_wrong(&found);
    let unplaced: Vec<&str> = found.unplaced.iter().map(|u| u.name.as_str()).collect();
    assert_eq!(unplaced, ["store"]);
}

#[test]
fn rooms_with_a_wall_between_them_are_refused() {
    let mut scene = store();
    scene = scene.and(&stairs().moved([0.0, 0.0], 0.0, [8.0, 0.0]));
    refused(&Surveyed::of(&scene, &[("store", [3.9, 1.7, 1.5]), ("stairs", [9.3, 3.4, 1.6])], 42));
}

/// The sentence with which a whole survey is refused.
fn sentence(surveyed: &Surveyed) -> String {
    match register(&surveyed.folder(), &surveyed.survey(), &Options::default(), &Silent) {
        Err(ScanError::Request(sentence)) => sentence,
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_single_station_cannot_be_registered() {
    let surveyed = Surveyed::of(&yard(), &[("alone", [0.0, 0.0, 1.6])], 43);
    assert!(sentence(&surveyed).contains("one station"), "{}", sentence(&surveyed));
}

#[test]
fn a_survey_without_stations_is_refused() {
    let surveyed = Surveyed::of(&yard(), &[("alone", [0.0, 0.0, 1.6])], 44);
    let toml = surveyed.folder().join("survey.toml");
    std::fs::write(&toml, "version = 1\n").unwrap();
    assert!(sentence(&surveyed).contains("no stations"), "{}", sentence(&surveyed));
}

#[test]
fn stations_that_see_one_plane_are_refused() {
    let mut ground = Scene::default();
    ground.ground();
    for (seed, scanner) in [
        (45, short_sighted()),
        (46, Scanner { noise: 0.0, dropouts: 0.0, max_range: 6.0, ..Scanner::default() }),
        // Large enough that only the range of the scanner limits what it sees.
        (47, Scanner::default()),
    ] {
        let mut surveyed = Surveyed::new();
        surveyed.add(&scanner, &ground, &[("one", [0.0, 0.0, 1.6]), ("two", [3.0, 1.0, 1.6])], seed);
        refused(&surveyed);
    }
}

#[test]
fn stations_that_see_one_wall_and_the_ground_are_refused() {
    let mut scene = Scene::default();
    scene.ground().wall([-70.0, 4.0], [70.0, 4.0], 30.0, &[]);
    let mut surveyed = Surveyed::new();
    surveyed.add(&short_sighted(), &scene, &[("one", [0.0, 0.0, 1.6]), ("two", [3.0, 1.0, 1.6])], 48);
    refused(&surveyed);
}

#[test]
fn a_station_of_a_few_points_is_refused_and_the_rest_is_placed() {
    let mut surveyed = Surveyed::of(&yard(), &[("one", [0.0, 0.0, 1.6]), ("two", [1.5, 2.0, 1.5])], 49);
    surveyed.add(&Scanner { dropouts: 0.9999, ..Scanner::default() }, &yard(), &[("blind", [0.0, 3.0, 1.6])], 49);
    let found = surveyed.register();
    surveyed.truth.never_wrong(&found);
    assert_eq!(found.unplaced.iter().map(|u| u.name.as_str()).collect::<Vec<_>>(), ["blind"]);
}

/// Poses stored with scans may be wrong by any amount.
#[test]
fn misleading_poses_are_never_accepted() {
    let surveyed = Surveyed::of(&yard(), &[("one", [0.0, 0.0, 1.6]), ("two", [1.5, 2.0, 1.5])], 50);
    let right = surveyed.truth.pose("two");
    surveyed.set_pose("one", Some(surveyed.truth.pose("one")));
    for by in [DVec3::new(3.0, 0.0, 0.0), DVec3::new(-1.0, 1.5, 0.4)] {
        surveyed.set_pose("two", Some(Pose { translation: right.translation + by, ..right }));
        for ignore_poses in [false, true] {
            let found = registered(&surveyed.folder(), &Options { ignore_poses, ..Options::default() });
            surveyed.truth.never_wrong(&found);
            if ignore_poses {
                surveyed.truth.all_placed(&found);
            }
        }
    }
}
