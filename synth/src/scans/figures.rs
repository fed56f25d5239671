//! What stands before the fort when it is scanned: iron grilles in its windows, scaffolding, grass, and people who walk about.

use super::Class;
use super::props::{Prop, Shape};
use crate::fort::scene::{HALF, HALF_X, HALF_Y, Scene};
use crate::noise::{derive, hash2, hash3, normal, unit};
use glam::DVec3;

/// Which things are there besides the fort.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Extras {
    /// People who walk about: other places for each station.
    pub walkers: bool,
    /// Grass outside the walls, which the wind moves between stations.
    pub grass: bool,
    /// Scaffolding that is moved to another wall after half of the stations.
    pub scaffolding: bool,
}

impl Default for Extras {
    fn default() -> Self {
        Self { walkers: true, grass: true, scaffolding: true }
    }
}

/// Where a station is, for what depends on it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Occasion {
    /// Number of the station.
    pub(super) station: u32,
    /// Whether the scaffolding has been moved.
    pub(super) later: bool,
    /// The instrument, in the fort's frame.
    pub(super) eye: DVec3,
    /// Height of the floor below it.
    pub(super) floor: f64,
}

/// Everything that stands before the fort at a station.
pub(super) fn props(scene: &Scene, seed: u64, extras: Extras, at: &Occasion) -> Vec<Prop> {
    let mut props = grilles(scene);
    if extras.scaffolding {
        scaffolding(scene, at.later, &mut props);
    }
    if extras.grass {
        grass(scene, seed, at.station, &mut props);
    }
    if extras.walkers {
        walkers(scene, seed, at, &mut props);
    }
    // Nothing stands in the instrument.
    props.retain(|prop| match prop.shape {
        Shape::Capsule { a, b, radius } => segment_distance(at.eye, a, b) > radius + 0.35,
        Shape::Plank { middle, half, .. } => (middle - at.eye).length() > half.length() + 0.35,
    });
    props
}

fn segment_distance(p: DVec3, a: DVec3, b: DVec3) -> f64 {
    let axis = b - a;
    let share = ((p - a).dot(axis) / axis.length_squared().max(1e-12)).clamp(0.0, 1.0);
    (p - a - axis * share).length()
}

fn bar(a: impl Into<DVec3>, b: impl Into<DVec3>, radius: f64, class: Class, color: [f64; 3]) -> Prop {
    Prop { shape: Shape::Capsule { a: a.into(), b: b.into(), radius }, class, color }
}

/// Bars of 16 mm in the windows of the western and northern rooms. They belong to the fort.
pub(crate) fn grilles(scene: &Scene) -> Vec<Prop> {
    const RUST: [f64; 3] = [92.0, 68.0, 54.0];
    let mut bars = Vec::new();
    let mut window = |middle: DVec3, along: DVec3, half: f64, height: f64| {
        // Only where the wall still stands on both sides.
        let stands = |side: f64| scene.value(middle + along * side * (half + 0.15) + DVec3::Z * height * 0.6) < 0.0;
        if !stands(1.0) || !stands(-1.0) {
            return;
        }
        let count = (half * 2.0 / 0.1) as i32;
        for k in 0..count {
            let foot = middle + along * (f64::from(k) + 0.5 - f64::from(count) / 2.0) * (2.0 * half / f64::from(count));
            bars.push(bar(foot - DVec3::Z * 0.05, foot + DVec3::Z * (height + 0.03), 0.008, Class::Surface, RUST));
        }
        for share in [0.3, 0.75] {
            let level = middle + DVec3::Z * height * share;
            let reach = along * (half + 0.05);
            bars.push(bar(level - reach, level + reach, 0.006, Class::Surface, RUST));
        }
    };
    for y in [-6.6, -4.2, -1.2, 0.7, 3.7] {
        window(DVec3::new(-8.0, y, 1.35), DVec3::Y, 0.22, 0.95);
    }
    for x in [-3.4, -0.5, 1.7, 4.9, 7.0] {
        window(DVec3::new(x, 6.9, 1.3), DVec3::X, 0.27, 0.8);
    }
    bars
}

/// Tubes and planks before a wall: the southern curtain first, the western one later.
fn scaffolding(scene: &Scene, later: bool, props: &mut Vec<Prop>) {
    const STEEL: [f64; 3] = [142.0, 146.0, 150.0];
    const WOOD: [f64; 3] = [176.0, 142.0, 98.0];
    const TUBE: f64 = 0.024;
    const BAY: f64 = 2.0;
    const BAYS: i32 = 4;
    const LIFTS: [f64; 3] = [1.9, 3.8, 5.7];
    // Along the wall, away from it, and up.
    let place = |along: f64, out: f64, z: f64| {
        if later { DVec3::new(-HALF_X - out, -4.5 + along, z) } else { DVec3::new(1.5 + along, -HALF_Y - out, z) }
    };
    let along = if later { [0.0, 1.0] } else { [1.0, 0.0] };
    let tube = |a, b| bar(a, b, TUBE, Class::Scaffolding, STEEL);
    let (near, far) = (0.45, 1.45);
    let end = BAY * f64::from(BAYS);
    for k in 0..=BAYS {
        let x = BAY * f64::from(k);
        for out in [near, far] {
            let foot = place(x, out, 0.0);
            props.push(tube(DVec3 { z: scene.ground(foot.x, foot.y), ..foot }, place(x, out, LIFTS[2] + 1.1)));
        }
        for z in LIFTS {
            props.push(tube(place(x, near - 0.15, z), place(x, far + 0.15, z)));
        }
    }
    for z in LIFTS {
        for (out, up) in [(near, 0.06), (far, 0.06), (far, 1.0)] {
            props.push(tube(place(-0.2, out, z + up), place(end + 0.2, out, z + up)));
        }
        for board in 0..4 {
            for k in 0..BAYS {
                let middle = place(BAY * (f64::from(k) + 0.5), near + 0.14 + 0.24 * f64::from(board), z + 0.13);
                let half = DVec3::new(BAY / 2.0 - 0.01, 0.11, 0.02);
                props.push(Prop {
                    shape: Shape::Plank { middle, half, along },
                    class: Class::Scaffolding,
                    color: WOOD,
                });
            }
        }
    }
    for (k, z) in [(0, 0.2), (2, 0.2), (1, LIFTS[0]), (3, LIFTS[0])] {
        let x = BAY * f64::from(k);
        props.push(tube(place(x, far + 0.06, z), place(x + BAY, far + 0.06, z + 1.9)));
    }
}

/// Tufts of blades outside the walls, above the shore. The wind bends each of them differently at each station.
fn grass(scene: &Scene, seed: u64, station: u32, props: &mut Vec<Prop>) {
    const PATCH: f64 = 1.3;
    let salt = derive(seed, 0xd1);
    let wind = derive(derive(seed, 0xd2), u64::from(station));
    let patches = (HALF / PATCH) as i64;
    for i in -patches..patches {
        for j in -patches..patches {
            let h = hash2(salt, i, j);
            let (x, y) = ((i as f64 + unit(h, 0)) * PATCH, (j as f64 + unit(h, 1)) * PATCH);
            let outside = (x.abs() - HALF_X).max(y.abs() - HALF_Y);
            let z = scene.ground(x, y);
            // Thicker landward, none on the beaten way to the gate.
            let chance = if (x + 2.0).abs() < 2.2 && y < 0.0 { 0.0 } else { 0.3 + 0.012 * y };
            if outside < 0.4
                || z < -1.3
                || unit(h, 2) > chance
                || scene.masonry_distance(DVec3::new(x, y, z + 0.2)) < 0.15
            {
                continue;
            }
            for k in 0..26 {
                let (b, w) = (hash3(salt, i, j, k + 1), hash3(wind, i, j, k));
                let (fx, fy) = (x + 0.09 * normal(b), y + 0.09 * normal(b.rotate_left(32)));
                let foot = DVec3::new(fx, fy, scene.ground(fx, fy) - 0.01);
                let tall = 0.12 + 0.33 * unit(b, 1) * unit(b, 2);
                let sway = DVec3::new(normal(w), normal(w.rotate_left(32)), 0.0) * 0.02;
                let lean = DVec3::new(unit(b, 0) - 0.5, unit(b, 2) - 0.5, 0.0) * tall * 0.7;
                let middle = foot + DVec3::Z * tall * 0.6 + lean * 0.35 + sway * 0.3;
                let tip = foot + DVec3::Z * tall * 0.95 + lean + sway;
                let dry = unit(b, 1);
                let color = [118.0 + 44.0 * dry, 126.0 + 20.0 * dry, 66.0 + 26.0 * dry];
                props.push(bar(foot, middle, 0.0026, Class::Grass, color));
                props.push(bar(middle, tip, 0.0016, Class::Grass, color));
            }
        }
    }
}

/// Two to five people within sight of the station.
fn walkers(scene: &Scene, seed: u64, at: &Occasion, props: &mut Vec<Prop>) {
    let salt = derive(derive(seed, 0xd3), u64::from(at.station));
    let wanted = 2 + hash2(salt, 0, 0) % 4;
    let mut found = 0;
    for attempt in 1..60 {
        let h = hash2(salt, attempt, 1);
        let (s, c) = libm::sincos(unit(h, 0) * std::f64::consts::TAU);
        let away = 1.4 + 9.0 * unit(h, 1) * unit(h, 1);
        let over = at.eye + DVec3::new(c * away, s * away, 0.0);
        let chest = DVec3 { z: at.floor + 1.3, ..over };
        let free = [0.5, 1.0, 1.6].iter().all(|z| scene.masonry_distance(DVec3 { z: at.floor + z, ..over }) > 0.22);
        let sight = chest - at.eye;
        let seen = || scene.hit(at.eye, sight.normalize(), 0.0, sight.length()).is_none();
        let floor = || scene.hit(chest, -DVec3::Z, 0.0, 3.0).map(|hit| chest.z - hit.t);
        if !free || !seen() {
            continue;
        }
        if let Some(floor) = floor().filter(|z| (z - at.floor).abs() < 0.9) {
            person(DVec3 { z: floor, ..over }, hash2(salt, attempt, 2), props);
            found += 1;
            if found == wanted {
                return;
            }
        }
    }
}

/// Somebody in mid-step, 1.5 to 1.9 m tall.
pub(crate) fn person(feet: DVec3, h: u64, props: &mut Vec<Prop>) {
    let scale = (1.5 + 0.4 * unit(h, 0)) / 1.75;
    let (s, c) = libm::sincos(unit(h, 1) * std::f64::consts::TAU);
    let stride = 0.12 + 0.25 * unit(h, 2);
    // Forward, to the left, up.
    let at = |x: f64, y: f64, z: f64| feet + DVec3::new(c * x - s * y, s * x + c * y, z) * scale;
    let g = h.rotate_left(29);
    let shirt = [60.0 + 170.0 * unit(g, 0), 60.0 + 150.0 * unit(g, 1), 60.0 + 160.0 * unit(g, 2)];
    let trousers = [50.0 + 60.0 * unit(h, 2), 55.0 + 50.0 * unit(h, 0), 60.0 + 70.0 * unit(h, 1)];
    let skin = [128.0, 92.0, 70.0];
    let mut limb = |a, b, radius: f64, color| props.push(bar(a, b, radius * scale, Class::Walker, color));
    for side in [-1.0, 1.0] {
        let step = stride * side;
        limb(at(step, 0.1 * side, 0.08), at(step * 0.3 + 0.05, 0.1 * side, 0.48), 0.06, trousers);
        limb(at(step * 0.3 + 0.05, 0.1 * side, 0.48), at(0.0, 0.09 * side, 0.9), 0.08, trousers);
        limb(at(0.0, 0.2 * side, 1.4), at(-step * 0.5, 0.27 * side, 1.1), 0.05, shirt);
        limb(at(-step * 0.5, 0.27 * side, 1.1), at(-step * 0.5 + 0.12, 0.27 * side, 0.87), 0.04, skin);
    }
    limb(at(0.0, 0.0, 0.98), at(0.02, 0.0, 1.34), 0.15, shirt);
    limb(at(0.02, 0.0, 1.45), at(0.03, 0.0, 1.66), 0.085, skin);
}
