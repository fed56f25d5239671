//! The fort as one signed distance field: plan, ruin, relief, ground and stray crumbs. Negative inside, metres.

use super::ground::{Ground, broad, ground, standing};
use super::masonry::{MAX_IN, MAX_OUT, face};
use super::plan::{HALF_X, HALF_Y, PARAPET, Plan};
use super::solid::{Form, Solid};
use crate::noise::{derive, hash2, noise3, unit};
use glam::DVec3;

/// A distance that is certainly further than anything that matters.
const FAR: f64 = 1e3;
/// Slack on the distances of the plan's solids, which are bounds and bend where earth meets wall.
const SLACK: f64 = 0.4;
/// Width over which earth silts up the foot of a wall, in metres.
const SILT: f64 = 0.16;

/// The whole fort.
pub(super) struct Field {
    /// Seed of all its noise.
    pub(super) seed: u64,
    /// Grid constant, metres: finer relief is left out.
    pub(super) step: f64,
    plan: Plan,
    crumbs: Vec<Solid>,
}

/// The part of the fort that matters near a place.
#[derive(Default)]
pub(super) struct Near {
    walls: Vec<Solid>,
    openings: Vec<Solid>,
    fittings: Vec<Solid>,
    shafts: Vec<Solid>,
    crumbs: Vec<Solid>,
}

/// Distances at a place, relief included or not.
#[derive(Debug, Clone, Copy)]
pub(super) struct Distance {
    /// To masonry.
    pub(super) walls: f64,
    /// To the ground's surface.
    pub(super) ground: f64,
    /// To the nearest crumb.
    pub(super) crumbs: f64,
    /// To all of it together.
    pub(super) all: f64,
}

impl Field {
    /// The fort of a seed for a sampling `step` metres apart.
    pub(super) fn new(seed: u64, step: f64) -> Self {
        let plan = Plan::new(&|x, y| broad(seed, x, y));
        Self { seed, step, plan, crumbs: crumbs(seed, 0.8 * step) }
    }

    /// What matters within `reach` metres of a place.
    pub(super) fn near(&self, p: DVec3, reach: f64) -> Near {
        let close = |solids: &[Solid]| -> Vec<Solid> {
            solids.iter().filter(|s| s.distance(p) < reach * 1.1 + SLACK).copied().collect()
        };
        Near {
            walls: close(&self.plan.walls),
            openings: close(&self.plan.openings),
            fittings: close(&self.plan.fittings),
            shafts: close(&self.plan.shafts),
            crumbs: close(&self.crumbs),
        }
    }

    /// Whether everything is further than `reach` from a place, or it lies that deep inside.
    pub(super) fn clear(&self, near: &Near, p: DVec3, reach: f64) -> bool {
        let d = self.rough(near, p);
        d.all > reach + MAX_OUT + SLACK || (d.all < -(reach + MAX_IN + SLACK) && d.walls.min(d.ground) == d.all)
    }

    /// Distances without relief.
    pub(super) fn rough(&self, near: &Near, p: DVec3) -> Distance {
        let walls = Self::masonry(near, p, standing(self.seed, p[0], p[1]));
        let earth = (p[2] - broad(self.seed, p[0], p[1])) * 0.85;
        combine(near, p, walls, earth, nearest(&near.crumbs, p))
    }

    /// Distance without relief, where the ground is known to be about `g`.
    pub(super) fn free(near: &Near, p: DVec3, g: &Ground) -> f64 {
        let walls = Self::masonry(near, p, g.standing);
        combine(near, p, walls, (p[2] - g.height) * 0.85, nearest(&near.crumbs, p)).all
    }

    /// Distances with relief, on ground known to be `g`.
    pub(super) fn fine(&self, near: &Near, p: DVec3, g: &Ground) -> Distance {
        let mut walls = Self::masonry(near, p, g.standing);
        if walls < MAX_OUT + 0.02 && walls > -(MAX_IN + 0.02) {
            walls -= face(self.seed, p, self.step).relief;
        }
        let earth = (p[2] - g.height) * 0.85;
        let mut crumbs = nearest(&near.crumbs, p);
        if crumbs < 0.4 {
            crumbs += 0.06 * noise3(derive(self.seed, 0x82), p * 8.0);
            crumbs += 0.11 * noise3(derive(self.seed, 0x83), p * 3.1);
        }
        combine(near, p, walls, earth, crumbs)
    }

    /// The ground at a place.
    pub(super) fn ground(&self, x: f64, y: f64) -> Ground {
        ground(self.seed, x, y, self.step)
    }

    fn masonry(near: &Near, p: DVec3, standing: f64) -> f64 {
        let walls = nearest(&near.walls, p).max((p[2] - standing.max(0.2)) * 0.6);
        walls.max(-nearest(&near.openings, p)).min(nearest(&near.fittings, p))
    }
}

/// Stray bits above the heads of the walls, where plants grow and birds sit, and a few bushes on the ground. None is
/// smaller than `smallest` in radius, so that a coarse sampling still meets them.
fn crumbs(seed: u64, smallest: f64) -> Vec<Solid> {
    let salt = derive(seed, 0x81);
    let ball = |radius: f64, at: DVec3| Solid::new(Form::Ball { radius: radius.max(smallest) }, at);
    let stray = (0..30).map(|k| {
        let (h, g) = (hash2(salt, k, 0), hash2(salt, k, 1));
        let along = 2.0 * unit(h, 0) - 1.0;
        let [x, y] = match k % 4 {
            0 => [along * HALF_X, HALF_Y - 0.6],
            1 => [along * HALF_X, 0.6 - HALF_Y],
            2 => [HALF_X - 0.6, along * HALF_Y],
            _ => [0.6 - HALF_X, along * HALF_Y],
        };
        let radius = 0.09 + 0.1 * unit(h, 1) * unit(h, 2);
        let head = standing(seed, x, y).min(PARAPET + 1.0);
        let z = head + 0.45 + 0.5 * unit(g, 0) + 1.5 * radius.max(smallest);
        ball(radius, DVec3::new(x + 0.8 * (unit(g, 1) - 0.5), y, z))
    });
    let bushes = (0..9).map(|k| {
        let h = hash2(salt, k, 2);
        let angle = (k as f64 + 0.6 * unit(h, 0)) / 9.0 * std::f64::consts::TAU;
        let reach = 18.0 + 2.5 * unit(h, 1);
        let (sin, cos) = libm::sincos(angle);
        let (x, y) = (reach * cos, reach * sin);
        let radius = 0.35 + 0.4 * unit(h, 2);
        ball(radius, DVec3::new(x, y, broad(seed, x, y) + 0.45 * radius))
    });
    stray.chain(bushes).collect()
}

fn nearest(solids: &[Solid], p: DVec3) -> f64 {
    solids.iter().fold(FAR, |d, s| d.min(s.distance(p)))
}

fn combine(near: &Near, p: DVec3, walls: f64, ground: f64, crumbs: f64) -> Distance {
    let shafts = -nearest(&near.shafts, p);
    let (walls, ground) = (walls.max(shafts), ground.max(shafts));
    let all = silted(walls, ground).min(crumbs);
    Distance { walls, ground, crumbs, all }
}

/// Smooth union (Quilez): fills the corner of wall and ground.
fn silted(a: f64, b: f64) -> f64 {
    let h = (SILT - (a - b).abs()).max(0.0) / SILT;
    a.min(b) - h * h * SILT * 0.25
}
