//! Properties of the fort that rays are traced against.

use super::distance::{Masonry, Met, Until};
use super::masonry::{GENTLE_OUT, GENTLE_SLOPE, gentle};
use super::scene::Scene;
use crate::noise::{hash3, unit};
use glam::DVec3;
use std::sync::LazyLock;

/// The masonry of seed 1 (not derived: only the noise differs).
static MASONRY: LazyLock<Masonry> = LazyLock::new(|| Masonry::new(1));
/// The whole fort.
static SCENE: LazyLock<Scene> = LazyLock::new(|| Scene::new(1));

/// The k-th of a sequence of places between two corners.
fn place(salt: u64, k: i64, low: DVec3, high: DVec3) -> DVec3 {
    let h = hash3(salt, k, 0, 0);
    low + (high - low) * DVec3::new(unit(h, 0), unit(h, 1), unit(h, 2))
}

fn direction(salt: u64, k: i64) -> DVec3 {
    let p = place(salt, k, DVec3::NEG_ONE, DVec3::ONE);
    p.try_normalize().unwrap_or(DVec3::X)
}

const LOW: DVec3 = DVec3::new(-16.0, -16.0, -0.5);
const HIGH: DVec3 = DVec3::new(17.0, 15.0, 9.0);

#[test]
fn the_relief_is_no_steeper_and_stands_out_no_further_than_promised() {
    let mut steepest = 0.0_f64;
    for k in 0..120_000 {
        let p = place(1, k, LOW, HIGH);
        let relief = gentle(7, p);
        assert!((-0.3..=GENTLE_OUT).contains(&relief), "{relief} at {p}");
        let reach = [1e-4, 0.02][k as usize % 2];
        let slope = (gentle(7, p + direction(2, k) * reach) - relief).abs() / reach;
        steepest = steepest.max(slope);
    }
    assert!(steepest < GENTLE_SLOPE, "{steepest}");
}

/// The bound of a place where the surface is near, and the place.
fn near_places(count: i64) -> impl Iterator<Item = (DVec3, f64)> {
    (0..)
        .map(|k| place(3, k, LOW, HIGH))
        .map(|p| (p, MASONRY.distance(p)))
        .filter(|(_, d)| *d < 0.299)
        .take(count as usize)
}

#[test]
fn the_bound_of_the_distance_to_the_masonry_is_one_lipschitz() {
    // As far as a bound is shortened where the surface is not near: there it is compared with the shorter.
    let mut worst = 0.0_f64;
    for (k, (p, bound)) in near_places(60_000).enumerate() {
        for reach in [0.001, 0.02, 0.1] {
            let q = p + direction(4, k as i64) * reach;
            let other = MASONRY.exact_bound(q);
            let own = MASONRY.exact_bound(p);
            // Inside, where no ray goes, stairs make it jump.
            if own > 0.0 && other > 0.0 {
                worst = worst.max((own - other).abs() / reach);
            }
            assert!(bound <= own + 1e-12, "the short cut is a lower bound");
        }
    }
    assert!(worst <= 1.0 + 1e-9, "{worst}");
}

#[test]
fn a_ball_as_large_as_the_bound_holds_no_surface() {
    for (k, (p, bound)) in near_places(30_000).enumerate().filter(|(_, (_, bound))| *bound > 0.0) {
        for n in 0..6 {
            let q = p + direction(5, k as i64 * 6 + n) * bound * 0.999;
            assert!(MASONRY.value(q) > 0.0, "the field is {} at {q}, {bound} from {p}", MASONRY.value(q));
        }
    }
}

#[test]
fn a_ray_ends_on_the_surface_and_crosses_none_before() {
    let eyes = [
        DVec3::new(0.0, -3.0, 1.6),
        DVec3::new(-10.0, 2.2, 1.5),
        DVec3::new(18.0, 3.0, 2.0),
        DVec3::new(2.0, 16.0, 2.0),
    ];
    let mut hits = 0;
    for (n, o) in eyes.into_iter().enumerate() {
        for k in 0..2_000 {
            let mut d = direction(6 + n as u64, k);
            d.z *= 0.4;
            let d = d.normalize();
            let Some(hit) = SCENE.hit(o, d, 0.0, 60.0) else { continue };
            hits += 1;
            let value = |shift: f64| SCENE.value_of(o + d * (hit.t + shift), hit.on_ground);
            // Inside stairs the field jumps.
            let is_zero = value(0.0).abs() < 2e-4 || (value(-1e-4) > 0.0 && value(1e-4) < 0.0);
            assert!(is_zero, "the field is {} at the end of a ray from {o} along {d}", value(0.0));
            for share in [0.2, 0.5, 0.8, 0.95, 0.999] {
                let p = o + d * hit.t * share;
                assert!(SCENE.value(p) > -1e-4, "{} before the end of a ray from {o} along {d}", SCENE.value(p));
            }
        }
    }
    assert!(hits > 5_000, "{hits} rays met something");
}

#[test]
fn a_beam_is_free_as_far_as_it_is_clear() {
    let beam = super::scene::Beam { exit: 0.003, spread: 0.0003 };
    let o = DVec3::new(-2.0, -9.0, 1.5);
    for k in 0..3_000 {
        let d = direction(11, k);
        let clear = SCENE.clear(o, d, 50.0, beam);
        let across = d.any_orthonormal_vector();
        for side in [across, -across, d.cross(across), across.cross(d)] {
            let t = clear * 0.999;
            let p = o + d * t + side * beam.radius(t);
            assert!(SCENE.value(p) > -1e-6, "{} beside the beam along {d} at {t}", SCENE.value(p));
        }
    }
}

#[test]
fn rays_along_the_axes_and_from_outside_the_box_end_too() {
    let down = MASONRY.meet(DVec3::new(-12.2, 10.6, 12.9), DVec3::NEG_Z, 0.0, 30.0, Until::Surface);
    assert!(matches!(down, Met::Surface(t) if (8.0..12.0).contains(&t)), "{down:?}");
    for (o, d) in [(DVec3::new(30.0, 0.0, 1.0), DVec3::NEG_X), (DVec3::new(0.0, -30.0, 1.5), DVec3::Y)] {
        assert!(matches!(MASONRY.meet(o, d, 0.0, 60.0, Until::Surface), Met::Surface(_)), "from {o}");
    }
    assert_eq!(MASONRY.meet(DVec3::new(0.0, 0.0, 40.0), DVec3::X, 0.0, 60.0, Until::Surface), Met::Nothing);
}

#[test]
fn the_mesh_of_the_fort_lies_on_the_surface_that_scans_see_but_for_its_relief() {
    use crate::{SiteKind, SynthOptions, mesh};
    let mesh = mesh(SiteKind::Fort, &SynthOptions::new(30_000)).unwrap();
    let mut off: Vec<f64> = mesh.positions.iter().map(|p| SCENE.off_surface(Scene::from_site(*p))).collect();
    off.sort_by(f64::total_cmp);
    let at = |share: f64| off[(off.len() as f64 * share) as usize];
    println!("median {}, 90 % {}, 95 % {}, 99 % {}", at(0.5), at(0.9), at(0.95), at(0.99));
    assert!(at(0.5) < 0.02 && at(0.9) < 0.06 && at(0.95) < 0.1, "{} {} {}", at(0.5), at(0.9), at(0.95));
}
