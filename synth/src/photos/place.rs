//! Where photographs are taken from: by hand around the walls and indoors, and by a drone around and above them.
//!
//! Candidates are many places, each with directions. Each traces a coarse grid of rays. Photographs are chosen one at a time: the
//! candidate that adds most to what three photographs see. Candidates in or close to masonry, with too much sky, or with something right
//! before the lens are dropped.

use crate::fort::scene::{HALF, HALF_X, HALF_Y, Scene};
use crate::noise::{derive, hash2, hash3, normal, unit};
use crate::scans::stations;
use glam::{DMat3, DVec3, IVec3};
use rayon::prelude::*;
use std::collections::HashMap;

/// Who holds the camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Carrier {
    /// Somebody who stands on the ground or on a floor.
    Hand,
    /// A drone.
    Drone,
    /// A tripod on the place of a scan: a panorama.
    Tripod,
}

impl Carrier {
    /// Its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Hand => "hand",
            Self::Drone => "drone",
            Self::Tripod => "tripod",
        }
    }

    /// Focal length as a share of the longer side of the picture.
    pub(super) fn focal(self) -> f64 {
        if self == Self::Drone { 0.88 } else { 0.74 }
    }
}

/// A place and a direction, in the fort's frame.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placed {
    pub(super) eye: DVec3,
    /// Takes the camera's coordinates (x right, y down, z forward) to the fort's.
    pub(super) rotation: DMat3,
    pub(super) carrier: Carrier,
}

/// Distance that cameras keep from masonry and from the ground, in metres.
pub(super) const CLEARANCE: f64 = 0.28;
pub(super) const ABOVE_GROUND: f64 = 0.6;
/// Minimum share of the picture that shows the surface: the promised 40 %, with a margin.
const SURFACE: f64 = 0.46;
/// At most this share of the picture (`NEAR_SHARE`) shows anything nearer than this, in metres.
const NEAREST: f64 = 0.8;
const NEAR_SHARE: f64 = 0.06;
/// Rays of a candidate, across and down.
const LOOKS: [u32; 2] = [14, 10];
/// Surfaces beyond this range do not count; those up to `WELL` count fully. Metres.
const MAX_RANGE: f64 = 45.0;
const WELL: f64 = 14.0;
/// Side of the cubes that are counted as seen, in metres.
const CUBE: f64 = 1.0;
/// What the first, second, third … photograph of a cube is worth.
const VALUE: [f64; 6] = [1.0, 1.0, 0.9, 0.12, 0.06, 0.03];

/// A cube and the side from which it is seen (0 to 5: along an axis).
type Patch = (IVec3, u8);

struct Candidate {
    placed: Placed,
    /// What it sees and how well, from 0 to 1; patches by their number.
    seen: Vec<(u32, f64)>,
}

/// The axes of a camera that looks in a direction (counter-clockwise from x, upwards; radians), tilted to the right.
pub(super) fn facing(yaw: f64, pitch: f64, roll: f64) -> DMat3 {
    let ((sy, cy), (sp, cp), (sr, cr)) = (libm::sincos(yaw), libm::sincos(pitch), libm::sincos(roll));
    let forward = DVec3::new(cp * cy, cp * sy, sp);
    let right = DVec3::new(sy, -cy, 0.0);
    let down = forward.cross(right);
    DMat3::from_cols(right * cr + down * sr, down * cr - right * sr, forward)
}

/// Places for photographs of a shape (`aspect`: height by width), fewer than `count` if there are not enough.
pub(super) fn places(scene: &Scene, seed: u64, count: u32, aspect: f64) -> Vec<Placed> {
    let seed = derive(seed, 0xf1);
    let rounds = 1 + count / 250;
    let views: Vec<Placed> =
        (0..rounds).flat_map(|round| views(scene, derive(seed, u64::from(round)), count)).collect();
    let looks: Vec<Option<Vec<(Patch, f64)>>> = views.par_iter().map(|view| look(scene, view, aspect)).collect();
    let mut numbers: HashMap<Patch, u32> = HashMap::new();
    let mut candidates = Vec::new();
    for (placed, seen) in views.into_iter().zip(looks) {
        let Some(seen) = seen else { continue };
        let mut number = |patch| {
            let next = numbers.len() as u32;
            *numbers.entry(patch).or_insert(next)
        };
        let seen = seen.into_iter().map(|(patch, well)| (number(patch), well)).collect();
        candidates.push(Candidate { placed, seen });
    }
    let mut chosen = choose(&candidates, numbers.len(), count);
    // In the order of a walk: outside, indoors and in the court, then by drone; each round the middle.
    let order = |p: &Placed| (p.group(), libm::atan2(p.eye.y, p.eye.x));
    chosen.sort_by(|a, b| {
        let ((one, angle), (other, angle_of_other)) = (order(a), order(b));
        one.cmp(&other).then(angle.total_cmp(&angle_of_other))
    });
    chosen
}

/// All candidate positions and directions.
fn views(scene: &Scene, seed: u64, count: u32) -> Vec<Placed> {
    let mut views = Vec::new();
    let mut add = |eye: DVec3, yaw: f64, pitch: f64, carrier: Carrier, h: u64| {
        let shaken =
            |lane| if carrier == Carrier::Hand { 1.2_f64.to_radians() * normal(h.rotate_left(lane)) } else { 0.0 };
        views.push(Placed { eye, rotation: facing(yaw, pitch + shaken(9), shaken(31)), carrier });
    };
    // Round the walls, by hand and by drone.
    for k in 0..140_i64 {
        let h = hash2(seed, k, 1);
        let g = hash2(seed, k, 2);
        let angle = (k as f64 + unit(h, 0)) * 2.399_963_229_728_653;
        let (s, c) = libm::sincos(angle);
        let wall = (HALF_X / c.abs().max(1e-9)).min(HALF_Y / s.abs().max(1e-9));
        let away = 4.0 + 9.0 * unit(h, 1);
        let at = DVec3::new(c, s, 0.0) * (wall + away);
        if at.x.abs().max(at.y.abs()) > HALF - 1.5 {
            continue;
        }
        let ground = scene.ground(at.x, at.y);
        // Straight to the nearest wall, turned a little.
        let straight = if at.x.abs() - HALF_X > at.y.abs() - HALF_Y {
            if at.x > 0.0 { std::f64::consts::PI } else { 0.0 }
        } else {
            -std::f64::consts::FRAC_PI_2 * at.y.signum()
        };
        let yaw = straight + 0.9 * (unit(g, 0) - 0.5);
        add(DVec3 { z: ground + 1.5 + 0.25 * unit(g, 1), ..at }, yaw, 0.14 * unit(g, 2), Carrier::Hand, h);
        let high = 3.5 + 10.0 * unit(h, 2);
        let aim = 1.0 + 2.5 * unit(g, 1);
        add(DVec3 { z: ground + high, ..at }, yaw, libm::atan2(aim - high, away + 2.0), Carrier::Drone, g);
    }
    // Above the court and the walls, looking down.
    for k in 0..90_i64 {
        let (h, g) = (hash2(seed, k, 3), hash2(seed, k, 4));
        let at = DVec3::new(30.0 * (unit(h, 0) - 0.5), 26.0 * (unit(h, 1) - 0.5), 7.0 + 13.0 * unit(h, 2));
        let pitch = -(40.0 + 48.0 * unit(g, 1)).to_radians();
        add(at, unit(g, 0) * std::f64::consts::TAU, pitch, Carrier::Drone, g);
    }
    // From where scanners could stand, all around.
    for (k, place) in stations::standpoints(scene, seed, count.min(60)).into_iter().enumerate() {
        let directions = if place.indoors { 7 } else { 3 };
        for n in 0..directions {
            let h = hash3(seed, k as i64, n, 5);
            let yaw = (n as f64 + unit(h, 0)) * std::f64::consts::TAU / directions as f64;
            let pitch = (-22.0 + 40.0 * unit(h, 1)).to_radians();
            add(place.eye + DVec3::Z * 0.1 * (unit(h, 2) - 0.5), yaw, pitch, Carrier::Hand, h);
        }
    }
    views
}

/// Whether a camera can be at a place: outside masonry and above the ground.
pub(super) fn is_free(scene: &Scene, eye: DVec3) -> bool {
    scene.masonry_distance(eye) >= CLEARANCE && eye.z > scene.ground(eye.x, eye.y) + ABOVE_GROUND
}

/// What a camera sees, if it can be there and sees enough.
fn look(scene: &Scene, view: &Placed, aspect: f64) -> Option<Vec<(Patch, f64)>> {
    if !is_free(scene, view.eye) {
        return None;
    }
    let [across, down] = LOOKS;
    // Half the picture's sides for a focal length of 1.
    let half = 0.5 / view.carrier.focal();
    let (width, height) = if aspect > 1.0 { (half / aspect, half) } else { (half, half * aspect) };
    let mut seen: HashMap<Patch, f64> = HashMap::new();
    let (mut hits, mut near) = (0, 0);
    for k in 0..across * down {
        let at = |i: u32, n: u32| 2.0 * (f64::from(i) + 0.5) / f64::from(n) - 1.0;
        let ray = DVec3::new(width * at(k % across, across), height * at(k / across, down), 1.0);
        let d = view.rotation * ray.normalize();
        let Some(hit) = scene.hit(view.eye, d, 0.0, MAX_RANGE) else { continue };
        hits += 1;
        near += u32::from(hit.t < NEAREST);
        let p = view.eye + d * hit.t;
        let n = scene.normal(p, hit.on_ground, 0.03);
        let well = (WELL / hit.t).min(1.0) * (-n.dot(d)).clamp(0.0, 1.0).sqrt();
        let best = seen.entry(patch(p, n)).or_default();
        *best = best.max(well);
    }
    let all = f64::from(across * down);
    if f64::from(hits) < SURFACE * all || f64::from(near) > NEAR_SHARE * all {
        return None;
    }
    let mut seen: Vec<(Patch, f64)> = seen.into_iter().collect();
    seen.sort_unstable_by_key(|((cube, side), _)| (cube.to_array(), *side));
    Some(seen)
}

/// The cube of a place and the side that it faces.
fn patch(p: DVec3, n: DVec3) -> Patch {
    let a = n.abs();
    let axis = if a.x >= a.y && a.x >= a.z {
        0
    } else if a.y >= a.z {
        1
    } else {
        2
    };
    // A place on the border of a cube belongs to the same cube from everywhere.
    ((p / CUBE).floor().as_ivec3(), 2 * axis + u8::from(n[usize::from(axis)] < 0.0))
}

/// Kinds of places, of which photographs have fixed shares.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Group {
    /// By hand, outside the walls.
    Outside,
    /// By hand, in the court, in rooms and on walls.
    Inside,
    Drone,
}

/// The group of the first, second … photograph, over and over. A drone sees most, but not what is in rooms and under arches.
const TURNS: [Group; 8] = [
    Group::Outside,
    Group::Inside,
    Group::Drone,
    Group::Inside,
    Group::Drone,
    Group::Outside,
    Group::Inside,
    Group::Drone,
];

impl Placed {
    fn group(&self) -> Group {
        if self.carrier == Carrier::Drone {
            Group::Drone
        } else if self.eye.x.abs() > HALF_X || self.eye.y.abs() > HALF_Y {
            Group::Outside
        } else {
            Group::Inside
        }
    }
}

fn choose(candidates: &[Candidate], patches: usize, count: u32) -> Vec<Placed> {
    let mut known = vec![0_u8; patches];
    let mut is_taken = vec![false; candidates.len()];
    let mut chosen = Vec::new();
    while chosen.len() < count as usize {
        let gain = |(k, c): (usize, &Candidate)| {
            let worth =
                |(patch, well): &(u32, f64)| well * VALUE[usize::from(known[*patch as usize]).min(VALUE.len() - 1)];
            (c.seen.iter().map(worth).sum::<f64>(), k)
        };
        let best = |fits: &dyn Fn(&Candidate) -> bool| {
            let free = candidates.iter().enumerate().filter(|(k, c)| !is_taken[*k] && fits(c));
            free.map(gain).max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))
        };
        let turn = TURNS[chosen.len() % TURNS.len()];
        let pick = best(&|c| c.placed.group() == turn).or_else(|| best(&|_| true));
        let Some((_, k)) = pick else { break };
        is_taken[k] = true;
        for (patch, _) in &candidates[k].seen {
            let times = &mut known[*patch as usize];
            *times = times.saturating_add(1);
        }
        chosen.push(candidates[k].placed);
    }
    chosen
}
