//! The colours of the fort: coral rag, lime plaster, mortar, lichen, moss, damp, earth, grass and sand.

use super::field::{Distance, Field, Near};
use super::ground::Ground;
use super::masonry::face;
use super::plan::{HALF_X, HALF_Y};
use crate::noise::{self, derive, fractal2, fractal3, lerp, noise2, noise3, smooth, unit};
use glam::DVec3;

/// A place of the surface that wants a colour.
pub(super) struct Spot {
    /// In the fort's frame.
    pub(super) p: DVec3,
    /// Outward, unit.
    pub(super) normal: DVec3,
    /// What is near.
    pub(super) distance: Distance,
    /// The ground here.
    pub(super) ground: Ground,
    /// Random bits of this vertex.
    pub(super) hash: u64,
}

/// A colour, sRGB from 0 to 255.
pub(super) type Rgb = [f64; 3];

fn blend(a: Rgb, b: Rgb, t: f64) -> Rgb {
    std::array::from_fn(|k| lerp(a[k], b[k], t.clamp(0.0, 1.0)))
}

/// sRGB colour of a place.
pub(super) fn color(field: &Field, near: &Near, spot: &Spot) -> [u8; 3] {
    let seed = field.seed;
    let mut c = albedo(seed, field.step, spot);
    let light = shade(near, spot);
    // Each set-up of the scanner has its own exposure.
    let exposure = 1.0 + 0.025 * noise2(derive(seed, 0xb3), spot.p[0] / 6.0, spot.p[1] / 6.0);
    c = c.map(|x| x * light * exposure);
    std::array::from_fn(|k| {
        let grain =
            3.2 * noise::normal(noise::mix(spot.hash ^ 0xc0)) + 1.6 * noise::normal(noise::mix(spot.hash ^ (k as u64)));
        (c[k] + grain).round().clamp(0.0, 255.0) as u8
    })
}

/// Colour of the material at a place, sRGB from 0 to 255, as far as a sampling `step` metres apart can show it.
pub(super) fn albedo(seed: u64, step: f64, spot: &Spot) -> Rgb {
    let d = &spot.distance;
    if d.crumbs < d.walls.min(d.ground) {
        let leaf = noise3(derive(seed, 0xb1), spot.p * 8.0);
        blend([98.0, 112.0, 58.0], [132.0, 122.0, 84.0], 0.5 + leaf)
    } else {
        let ragged = 0.05 * noise3(derive(seed, 0xb2), spot.p * 6.0);
        let earthen = smooth(-0.03, 0.07, d.walls - d.ground + ragged);
        if earthen == 0.0 {
            masonry(seed, spot, step)
        } else if earthen == 1.0 {
            earth(seed, spot)
        } else {
            blend(masonry(seed, spot, step), earth(seed, spot), earthen)
        }
    }
}

/// How much sky a place sees, about: what hollows and rooms lose of the light.
fn shade(near: &Near, spot: &Spot) -> f64 {
    let mut light = 1.0;
    for (reach, weight) in [(0.18, 0.16), (0.6, 0.2)] {
        let q = spot.p + spot.normal * reach;
        let free = (Field::free(near, q, &spot.ground) / reach).clamp(0.0, 1.0);
        light -= weight * (1.0 - free);
    }
    light * (0.93 + 0.07 * spot.normal[2])
}

fn masonry(seed: u64, spot: &Spot, step: f64) -> Rgb {
    const STONES: [Rgb; 5] = [
        [204.0, 193.0, 170.0],
        [190.0, 179.0, 156.0],
        [176.0, 168.0, 151.0],
        [210.0, 194.0, 163.0],
        [168.0, 155.0, 133.0],
    ];
    let p = spot.p;
    let f = face(seed, p, step);
    let tone = STONES[(f.stone % 5) as usize].map(|x| x * (0.93 + 0.14 * unit(f.stone, 2)));
    let speck = fractal3(derive(seed, 0xb4), p, 0.16, 3, 0.7);
    let stone = tone.map(|x| x * (1.0 + 0.07 * speck));
    let mortar = blend([196.0, 182.0, 154.0], [122.0, 110.0, 92.0], 0.35 + 0.5 * f.worn);
    let mut c = blend(stone, mortar, 0.75 * f.joint);
    let cloud = fractal3(derive(seed, 0xb5), p, 1.9, 3, 0.6);
    let coat = blend([222.0, 213.0, 194.0], [196.0, 184.0, 160.0], 0.5 + 0.8 * cloud);
    c = blend(c, coat, f.plaster);
    if f.missing {
        c = blend(c, [118.0, 102.0, 82.0], 0.7);
    }
    // Warm and cold by the yard.
    let warm = fractal3(derive(seed, 0xb6), p, 5.5, 2, 0.5);
    c = [c[0] * (1.0 + 0.05 * warm), c[1] * (1.0 + 0.015 * warm), c[2] * (1.0 - 0.06 * warm)];
    weathered(seed, spot, c, cloud)
}

/// Rain, lichen, damp and moss over a wall's own colour.
fn weathered(seed: u64, spot: &Spot, mut c: Rgb, cloud: f64) -> Rgb {
    let (p, n) = (spot.p, spot.normal);
    let above = p[2] - spot.ground.height;
    // Rain draws dark tongues down from the heads of walls.
    let tongue = fractal3(derive(seed, 0xb7), DVec3::new(p.x * 1.6, p.y * 1.6, p.z * 0.22), 1.0, 3, 0.6);
    let rain = smooth(0.05, 0.7, tongue + 0.14 * (above - 3.6)) * smooth(0.5, 2.0, above);
    c = blend(c, [104.0, 99.0, 90.0], 0.5 * rain);
    // Lichen where it is light: black-grey crusts and orange spots.
    let crust = fractal3(derive(seed, 0xb8), p, 0.7, 4, 0.65);
    c = blend(c, [84.0, 83.0, 78.0], 0.5 * smooth(0.3, 0.8, crust + 0.5 * n[2].max(0.0) - 0.1));
    let spots = fractal3(derive(seed, 0xb9), p, 0.35, 2, 0.6);
    c = blend(c, [186.0, 146.0, 82.0], 0.55 * smooth(0.55, 0.8, spots + 0.15 * cloud));
    // Damp rises from the ground, and moss follows it on the shaded sides.
    let line = above + 0.5 * fractal2(derive(seed, 0xba), p[0] + p[1], p[0] - p[1], 2.2, 3, 0.5);
    let damp = smooth(1.05, 0.1, line);
    c = blend(c, c.map(|x| x * 0.62), 0.75 * damp);
    let shaded = smooth(-0.3, 0.7, n[1]);
    c = blend(c, [92.0, 104.0, 58.0], (0.25 + 0.6 * shaded) * damp * smooth(-0.1, 0.5, crust + cloud));
    blend(c, [150.0, 124.0, 92.0], 0.5 * smooth(0.28, 0.0, above))
}

fn earth(seed: u64, spot: &Spot) -> Rgb {
    let p = spot.p;
    let broad = fractal2(derive(seed, 0xbb), p[0], p[1], 6.5, 4, 0.55);
    let fine = fractal2(derive(seed, 0xbc), p[0], p[1], 0.6, 4, 0.65);
    let mut c = blend([150.0, 126.0, 95.0], [172.0, 150.0, 118.0], 0.5 + 0.7 * broad);
    let court = (p[0].abs() - HALF_X).max(p[1].abs() - HALF_Y);
    c = blend(c, [178.0, 162.0, 136.0], 0.65 * smooth(0.5, -2.0, court));
    // Grass, thin in the court, thick landward.
    let green = smooth(0.0, 0.45, broad + 0.45 * fine + 0.25 * smooth(0.0, 6.0, court) + 0.02 * p[1] - 0.18);
    let blades = blend([116.0, 122.0, 66.0], [150.0, 142.0, 84.0], 0.5 + 0.9 * fine);
    let trodden = smooth(1.6, 0.6, (p[0] + 2.0 + 0.8 * fine + 0.07 * (p[1] + 11.0)).abs()) * smooth(4.0, -9.0, p[1]);
    c = blend(c, blades, 0.85 * green * (1.0 - trodden));
    c = blend(c, [196.0, 178.0, 148.0], 0.6 * trodden);
    // Sand and wet sand towards the water.
    let sand = smooth(-1.1, -1.9, p[2] + 0.35 * broad);
    c = blend(c, [214.0, 200.0, 168.0], sand);
    c = blend(c, [146.0, 132.0, 108.0], smooth(-2.3, -2.75, p[2] + 0.15 * fine));
    if spot.ground.stone != 0 {
        let tone = 148.0 + 44.0 * unit(spot.ground.stone, 0);
        c = blend(c, [tone, tone * 0.94, tone * 0.82], 0.85);
    } else {
        c = blend(c, [158.0, 146.0, 124.0], 0.5 * spot.ground.rubble);
    }
    c.map(|x| x * (1.0 + 0.07 * fine))
}
