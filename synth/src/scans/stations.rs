//! Where the instrument is put up: places indoors and out that see the whole fort and each other's surfaces.
//!
//! Candidates are rooms, doors, towers and walks of the plan, and a jittered grid on the ground. Each looks around with a few hundred rays.
//! Stations are chosen one after the other: the candidate that adds most to what is seen well, among those that share enough with the
//! stations before them to be registered. Every fourth is taken from indoor candidates, every fourth from places outside the walls.

use super::instrument::{INSTRUMENTS, Instrument};
use crate::fort::scene::{DRUM, GATE_X, HALF_X, HALF_Y, KEEP, Scene};
use crate::noise::{derive, hash2, hash3, mix, normal, unit};
use glam::{DMat3, DVec3, IVec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Standard deviation of the tilt that the instrument's level leaves, about each of two axes, in degrees.
pub const TILT_DEGREES: f64 = 0.02;
/// Rays with which a candidate looks around.
const LOOKS: u32 = 300;
/// Beyond this range a candidate sees nothing that counts, in metres.
const SIGHT: f64 = 40.0;
/// Side of the cubes that are counted as seen, in metres.
const CUBE: f64 = 1.0;
/// Range up to which a cube is seen well, in metres.
const WELL_SEEN: f64 = 4.0;
/// Share of what a station sees that must have been seen before, if there is such a candidate.
const SHARED: f64 = 0.25;
/// What tells the seed of stations from others.
const SALT: u64 = 0xe1;
/// Distance that the instrument keeps from walls, in metres.
const CLEARANCE: f64 = 0.28;

/// One station of a survey: where the instrument truly is, and what it is.
#[derive(Debug, Clone, PartialEq)]
pub struct Station {
    /// Number, from 1.
    pub number: u32,
    /// Position of the instrument, in metres, in the site's frame (without the origin of map coordinates).
    pub position: DVec3,
    /// Rotation from the scan's frame to the site's: heading and the tilt that levelling left.
    pub rotation: DMat3,
    /// Direction of the scan's x axis, in radians counter-clockwise from east.
    pub heading: f64,
    /// Height of the floor below the instrument, in metres.
    pub floor: f64,
    /// In a room, a passage or a tower.
    pub indoors: bool,
    /// Share of what it sees that stations with lower numbers see too, as estimated when it was chosen; 1 for the first.
    pub shared: f64,
    /// The instrument.
    pub instrument: &'static Instrument,
    /// Whether the scaffolding has been moved by then.
    pub later: bool,
}

/// A place where the instrument could stand, in the fort's frame.
pub(crate) struct Standpoint {
    /// The instrument.
    pub(crate) eye: DVec3,
    floor: f64,
    /// In a room, a passage or a tower.
    pub(crate) indoors: bool,
}

/// A place with what is seen from there.
struct Candidate {
    place: Standpoint,
    /// What it sees: cubes and how well, from 0 to 1.
    seen: Vec<(IVec3, f64)>,
}

/// Places of the plan, x and y, and a height from which the floor is looked for.
const PLACES: [([f64; 2], f64); 33] = [
    // Rooms and doors along the west.
    ([-10.2, -8.0], 1.8),
    ([-8.0, -8.2], 1.6),
    ([-10.2, -2.2], 1.8),
    ([-8.0, -2.6], 1.6),
    ([-10.2, -5.2], 1.5),
    ([-10.2, 2.2], 1.8),
    ([-8.0, 2.2], 1.6),
    ([-10.2, 5.8], 1.8),
    ([-8.0, 6.6], 1.6),
    ([-9.3, -3.7], 1.6),
    // Along the north.
    ([-6.2, 8.6], 1.8),
    ([-6.2, 6.9], 1.6),
    ([-1.6, 7.9], 1.8),
    ([-1.9, 6.9], 1.6),
    ([0.6, 9.2], 1.4),
    ([3.3, 8.7], 1.8),
    ([3.3, 6.9], 1.6),
    ([8.4, 8.7], 1.8),
    ([8.6, 6.9], 1.6),
    // Towers: ground floors, doors, upper floors.
    (KEEP, 2.0),
    ([KEEP[0] + 2.9, KEEP[1] - 1.4], 1.5),
    ([KEEP[0], KEEP[1]], 5.6),
    ([KEEP[0] + 3.0, KEEP[1] - 1.2], 6.2),
    (DRUM, 2.0),
    ([DRUM[0] - 3.1, DRUM[1] + 3.1], 1.6),
    (DRUM, 8.6),
    // The gate, inside it and before it.
    ([GATE_X, -HALF_Y + 0.6], 1.6),
    ([GATE_X, -HALF_Y + 2.6], 1.6),
    ([GATE_X, -HALF_Y - 3.5], 1.4),
    // Wall-walks.
    ([3.0, -HALF_Y + 0.9], 6.6),
    ([-HALF_X + 0.75, 0.0], 6.6),
    ([HALF_X - 0.8, -3.0], 6.6),
    ([0.0, HALF_Y - 0.8], 6.6),
];
/// How many of them, from the first, are indoors.
const INDOORS: usize = 27;

/// The stations of a survey.
pub(crate) fn stations(scene: &Scene, seed: u64, count: u32) -> Vec<Station> {
    let seed = derive(seed, SALT);
    let candidates = candidates(scene, seed, count);
    let chosen = choose(&candidates, count);
    let place = |(k, (index, shared)): (usize, (usize, f64))| {
        let Standpoint { eye, floor, indoors } = candidates[index].place;
        let h = hash2(seed, k as i64, 7);
        let heading = unit(h, 0) * std::f64::consts::TAU;
        let tilt = [1, 2].map(|axis| TILT_DEGREES.to_radians() * normal(hash3(seed, k as i64, 8, axis)));
        Station {
            number: k as u32 + 1,
            position: Scene::to_site(eye),
            rotation: about_z(heading) * about_x(tilt[0]) * about_y(tilt[1]),
            heading,
            floor,
            indoors,
            shared,
            instrument: &INSTRUMENTS[usize::from(k % 3 == 2)],
            later: k as u32 >= count.div_ceil(2),
        }
    };
    chosen.into_iter().enumerate().map(place).collect()
}

/// Rotation about the vertical, counter-clockwise seen from above. Made without the platform's sine.
pub(super) fn about_z(angle: f64) -> DMat3 {
    let (s, c) = libm::sincos(angle);
    DMat3::from_cols(DVec3::new(c, s, 0.0), DVec3::new(-s, c, 0.0), DVec3::Z)
}

fn about_x(angle: f64) -> DMat3 {
    let (s, c) = libm::sincos(angle);
    DMat3::from_cols(DVec3::X, DVec3::new(0.0, c, s), DVec3::new(0.0, -s, c))
}

fn about_y(angle: f64) -> DMat3 {
    let (s, c) = libm::sincos(angle);
    DMat3::from_cols(DVec3::new(c, 0.0, -s), DVec3::Y, DVec3::new(s, 0.0, c))
}

/// All places where an instrument could stand, of which [`stations`] chooses as many as it is asked for.
pub(crate) fn standpoints(scene: &Scene, seed: u64, count: u32) -> Vec<Standpoint> {
    free_places(scene, derive(seed, SALT), count)
}

fn candidates(scene: &Scene, seed: u64, count: u32) -> Vec<Candidate> {
    let with_view = |place: Standpoint| Candidate { seen: look(scene, place.eye), place };
    free_places(scene, seed, count).into_par_iter().map(with_view).collect()
}

/// All places where an instrument could stand. `seed` is that of [`stations`], derived.
fn free_places(scene: &Scene, seed: u64, count: u32) -> Vec<Standpoint> {
    let mut places: Vec<(DVec3, bool)> =
        PLACES.iter().enumerate().map(|(k, ([x, y], z))| (DVec3::new(*x, *y, *z), k < INDOORS)).collect();
    // A grid with three times as many places as are wanted.
    let (half, least) = (21.0, 2.5);
    let pitch = (4.0 * half * half / (3.0 * f64::from(count))).sqrt().min(least);
    let along = (half / pitch) as i64;
    for i in -along..=along {
        for j in -along..=along {
            let h = hash2(seed, i, j);
            let x = (i as f64 + 0.6 * (unit(h, 0) - 0.5)) * pitch;
            let y = (j as f64 + 0.6 * (unit(h, 1) - 0.5)) * pitch;
            places.push((DVec3::new(x, y, scene.ground(x, y) + 1.9), false));
        }
    }
    let stand = |(k, (above, indoors)): (usize, (DVec3, bool))| {
        let floor = above.z - scene.hit(above, -DVec3::Z, 0.0, 4.0)?.t;
        let tripod = 1.5 + 0.25 * unit(mix(seed ^ k as u64), 0);
        let eye = DVec3 { z: floor + tripod, ..above };
        let free =
            [0.4, 0.9, tripod].iter().all(|z| scene.masonry_distance(DVec3 { z: floor + z, ..above }) > CLEARANCE);
        free.then_some(Standpoint { eye, floor, indoors })
    };
    places.into_par_iter().enumerate().filter_map(stand).collect()
}

/// The cubes that are seen from a place, and how well: by the nearest ray.
fn look(scene: &Scene, eye: DVec3) -> Vec<(IVec3, f64)> {
    let mut seen: HashMap<IVec3, f64> = HashMap::new();
    for k in 0..LOOKS {
        // A spiral on the sphere without the cone below the tripod: equal areas, turned by the golden angle.
        let z = 1.0 - 1.85 * (f64::from(k) + 0.5) / f64::from(LOOKS);
        let (s, c) = libm::sincos(f64::from(k) * 2.399_963_229_728_653);
        let flat = (1.0 - z * z).sqrt();
        let d = DVec3::new(c * flat, s * flat, z);
        if let Some(hit) = scene.hit(eye, d, 0.0, SIGHT) {
            let cube = ((eye + d * hit.t) / CUBE).floor().as_ivec3();
            let well = (WELL_SEEN / hit.t).min(1.0);
            let best = seen.entry(cube).or_default();
            *best = best.max(well);
        }
    }
    let mut seen: Vec<(IVec3, f64)> = seen.into_iter().collect();
    seen.sort_unstable_by_key(|(cube, _)| cube.to_array());
    seen
}

/// A candidate: its number, the share of what it sees that is known, what it adds, and whether it fits the turn.
type Rated = (usize, f64, f64, bool);

/// Numbers of the chosen candidates, each with the share of what it sees that the ones before it see.
fn choose(candidates: &[Candidate], count: u32) -> Vec<(usize, f64)> {
    let mut known: HashMap<IVec3, f64> = HashMap::new();
    let mut chosen: Vec<(usize, f64)> = Vec::new();
    let mut free = vec![true; candidates.len()];
    while chosen.len() < count as usize {
        let turn = chosen.len() % 4;
        let outside = |c: &Candidate| c.place.eye.x.abs() > HALF_X || c.place.eye.y.abs() > HALF_Y;
        let fits = |c: &Candidate| match turn {
            1 => c.place.indoors,
            3 => !c.place.indoors && outside(c),
            _ => true,
        };
        let rate = |(k, c): (usize, &Candidate)| {
            let total: f64 = c.seen.iter().map(|(_, well)| well).sum();
            let shared: f64 = c.seen.iter().filter(|(cube, _)| known.contains_key(cube)).map(|(_, well)| well).sum();
            let gain: f64 = c
                .seen
                .iter()
                .map(|(cube, well)| {
                    let before = 1.0 + 2.0 * known.get(cube).copied().unwrap_or(0.0);
                    well / (before * before)
                })
                .sum();
            let share = if chosen.is_empty() { 1.0 } else { shared / total.max(1e-9) };
            (k, share, gain, fits(c))
        };
        let rated: Vec<Rated> = candidates.iter().enumerate().filter(|(k, _)| free[*k]).map(rate).collect();
        // What fits this turn and shares enough (a little less will do); else what shares enough; else what shares most.
        let best = |pass: &dyn Fn(&&Rated) -> bool| {
            rated.iter().filter(pass).max_by(|a, b| a.2.total_cmp(&b.2).then(b.0.cmp(&a.0))).copied()
        };
        let pick = best(&|r| r.3 && r.1 >= 0.5 * SHARED)
            .or_else(|| best(&|r| r.1 >= SHARED))
            .or_else(|| rated.iter().max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0))).copied());
        let Some((k, share, ..)) = pick else { break };
        free[k] = false;
        for (cube, well) in &candidates[k].seen {
            *known.entry(*cube).or_default() += well;
        }
        chosen.push((k, share));
    }
    chosen
}
