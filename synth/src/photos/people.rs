//! People in the pictures: in different positions in each photograph, and as many as cover the requested share of
//! pixels.

use super::view::Eye;
use crate::fort::scene::{Beam, Scene};
use crate::noise::{derive, hash2, unit};
use crate::scans::figures;
use crate::scans::props::{Prop, Props};
use glam::DVec3;

/// Cells across the coarse picture in which coverage is estimated.
const ACROSS: u32 = 64;
/// Distances at which people stand, in metres.
const NEAREST: f64 = 2.2;
const FARTHEST: f64 = 20.0;
/// Distance that they keep from walls, in metres.
const CLEARANCE: f64 = 0.22;
const ATTEMPTS: i64 = 120;
/// A photograph has at most this many times the share that is asked for, as far as the people can be divided.
const MAX_SHARE: f64 = 2.5;

/// Keeps the share of pixels over all photographs near what is asked for.
pub(super) struct Crowd {
    seed: u64,
    share: f64,
    /// Shares of the photographs so far, weighted by their pixels.
    covered: f64,
    pixels: f64,
    number: i64,
}

/// A ray of the coarse picture, and how far it goes.
struct Cell {
    d: DVec3,
    to: f64,
    can_stand: bool,
}

impl Crowd {
    /// A share from 0 to 1.
    pub(super) fn new(seed: u64, share: f64) -> Self {
        Self { seed: derive(seed, 0xf2), share, covered: 0.0, pixels: 0.0, number: 0 }
    }

    /// The people in the next photograph.
    pub(super) fn next(&mut self, scene: &Scene, eye: &Eye) -> Vec<Prop> {
        self.number += 1;
        let (width, height) = eye.size();
        let weight = f64::from(width) * f64::from(height);
        let wanted = (self.share * (self.pixels + weight) - self.covered) / weight;
        let salt = hash2(self.seed, self.number, 0);
        let varied = wanted * (0.6 + 0.8 * unit(salt, 0));
        let quota = varied.clamp(0.0, MAX_SHARE * self.share);
        self.pixels += weight;
        if quota <= 0.0 {
            return Vec::new();
        }
        let cells = coarse(scene, eye);
        let mut people = Vec::new();
        let mut hidden = vec![false; cells.len()];
        let share = |hidden: &[bool]| hidden.iter().filter(|h| **h).count() as f64 / hidden.len() as f64;
        let slack = 0.3 * quota + 1.0 / cells.len() as f64;
        for attempt in 1..ATTEMPTS {
            if share(&hidden) >= 0.85 * quota {
                break;
            }
            let h = hash2(salt, attempt, 1);
            let cell = &cells[(unit(h, 0) * cells.len() as f64) as usize];
            let feet = eye.position + cell.d * cell.to;
            let is_free = |z| scene.masonry_distance(feet + DVec3::Z * z) > CLEARANCE;
            if !cell.can_stand || ![0.5, 1.0, 1.6].into_iter().all(is_free) {
                continue;
            }
            let mut person = Vec::new();
            figures::person(feet, hash2(salt, attempt, 2), &mut person);
            let mut then = hidden.clone();
            cover(&person, eye.position, &cells, &mut then);
            if share(&then) <= quota + slack && share(&then) > share(&hidden) {
                hidden = then;
                people.extend(person);
            }
        }
        self.covered += share(&hidden) * weight;
        people
    }
}

fn coarse(scene: &Scene, eye: &Eye) -> Vec<Cell> {
    let (width, height) = eye.size();
    let down = (ACROSS * height / width).clamp(8, 4 * ACROSS);
    let cell = |k: u32| {
        let at = |i: u32, n: u32, pixels: u32| (f64::from(i) + 0.5) * f64::from(pixels) / f64::from(n);
        let d = eye.ray(at(k % ACROSS, ACROSS, width), at(k / ACROSS, down, height));
        let Some(d) = d else { return Cell { d: DVec3::Z, to: 0.0, can_stand: false } };
        let Some(hit) = scene.hit(eye.position, d, 0.0, super::view::FAR) else {
            return Cell { d, to: f64::MAX, can_stand: false };
        };
        let p = eye.position + d * hit.t;
        let is_flat = || scene.normal(p, hit.on_ground, 0.1).z > 0.8;
        Cell { d, to: hit.t, can_stand: (NEAREST..FARTHEST).contains(&hit.t) && is_flat() }
    };
    (0..ACROSS * down).map(cell).collect()
}

/// Mark the cells that a person hides.
fn cover(person: &[Prop], position: DVec3, cells: &[Cell], hidden: &mut [bool]) {
    let person = Props::new(person.to_vec());
    let mut near = Vec::new();
    for (cell, hidden) in cells.iter().zip(hidden) {
        near.clear();
        person.near(position, cell.d, cell.to, Beam { exit: 0.0, spread: 0.0 }, &mut near);
        let meets = |k: &u32| person.get(*k).shape.meet(position, cell.d).is_some_and(|t| t < cell.to);
        *hidden = *hidden || near.iter().any(meets);
    }
}
