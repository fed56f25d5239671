//! Seeded lattice noise: hashes, gradient noise, fractal sums and jittered cells.
//!
//! Everything is a pure function of a seed and a position, uses only `+ - * /`, comparisons and integer arithmetic
//! (which IEEE 754 and Rust fix), and so gives the same bits on every machine and in every order of evaluation.
//! Source of the gradient noise: Perlin, "Improving Noise", SIGGRAPH 2002.

use glam::DVec3;

const STEP_X: u64 = 0x9e37_79b9_7f4a_7c15;
const STEP_Y: u64 = 0xc2b2_ae3d_27d4_eb4f;
const STEP_Z: u64 = 0x1656_67b1_9e37_79f9;

/// Scramble all bits (the finaliser of `SplitMix64`, Steele et al. 2014).
pub(super) fn mix(mut h: u64) -> u64 {
    h = (h ^ (h >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h = (h ^ (h >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    h ^ (h >> 31)
}

/// Scramble enough to pick a slope: half the work of [`mix`].
fn stir(h: u64) -> u64 {
    (h ^ (h >> 31)).wrapping_mul(0xd6e8_feb8_6659_fd93) >> 40
}

/// A derived seed, so that each use of noise has its own.
pub(super) const fn derive(seed: u64, salt: u64) -> u64 {
    let h = (seed ^ salt.wrapping_mul(STEP_X)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    (h ^ (h >> 29)).wrapping_mul(0x94d0_49bb_1331_11eb)
}

/// Hash of a lattice point.
pub(super) fn hash3(seed: u64, x: i64, y: i64, z: i64) -> u64 {
    mix(seed
        .wrapping_add((x as u64).wrapping_mul(STEP_X))
        .wrapping_add((y as u64).wrapping_mul(STEP_Y))
        .wrapping_add((z as u64).wrapping_mul(STEP_Z)))
}

/// Hash of a lattice point of the plane.
pub(super) fn hash2(seed: u64, x: i64, y: i64) -> u64 {
    hash3(seed, x, y, 0)
}

/// The `lane`-th of three independent numbers in [0, 1) that one hash holds.
pub(super) fn unit(hash: u64, lane: u32) -> f64 {
    ((hash >> (21 * lane)) & 0x1f_ffff) as f64 / 2_097_152.0
}

/// A number with mean 0 and standard deviation 1: the sum of four uniform numbers (Irwin–Hall), so never beyond 3.5.
pub(super) fn normal(hash: u64) -> f64 {
    let sum = (0..4).map(|k| ((hash >> (16 * k)) & 0xffff) as f64).sum::<f64>() / 65_536.0;
    (sum - 2.0) * 1.732_050_807_568_877_2
}

/// Largest integer not above `x`, as both types.
fn split(x: f64) -> (i64, f64) {
    let t = x as i64;
    let i = if (t as f64) > x { t - 1 } else { t };
    (i, x - i as f64)
}

fn fade(t: f64) -> f64 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

/// Linear blend.
pub(super) fn lerp(a: f64, b: f64, t: f64) -> f64 {
    a + (b - a) * t
}

/// Smooth step from 0 at `lo` to 1 at `hi`.
pub(super) fn smooth(lo: f64, hi: f64, x: f64) -> f64 {
    let t = ((x - lo) / (hi - lo)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

fn slope2(h: u64, x: f64, y: f64) -> f64 {
    let u = if h & 1 == 0 { x } else { -x };
    let v = if h & 2 == 0 { y } else { -y };
    match (h >> 2) & 3 {
        0 => u + 0.5 * v,
        1 => v + 0.5 * u,
        2 => 0.8 * (u + v),
        _ => 0.8 * (u - v),
    }
}

/// Gradient noise in the plane, roughly in [-1, 1], lattice constant 1.
pub(super) fn noise2(seed: u64, x: f64, y: f64) -> f64 {
    let ((ix, fx), (iy, fy)) = (split(x), split(y));
    let base = seed.wrapping_add((ix as u64).wrapping_mul(STEP_X)).wrapping_add((iy as u64).wrapping_mul(STEP_Y));
    let corner = |dx: u64, dy: u64| {
        let h = stir(base.wrapping_add(dx.wrapping_mul(STEP_X)).wrapping_add(dy.wrapping_mul(STEP_Y)));
        slope2(h, fx - dx as f64, fy - dy as f64)
    };
    let (u, v) = (fade(fx), fade(fy));
    lerp(lerp(corner(0, 0), corner(1, 0), u), lerp(corner(0, 1), corner(1, 1), u), v) * 1.3
}

fn slope3(h: u64, x: f64, y: f64, z: f64) -> f64 {
    let (a, b) = match h & 3 {
        0 => (x, y),
        1 => (y, z),
        _ => (x, z),
    };
    (if h & 4 == 0 { a } else { -a }) + (if h & 8 == 0 { b } else { -b })
}

/// Gradient noise in space, roughly in [-1, 1], lattice constant 1.
pub(super) fn noise3(seed: u64, DVec3 { x, y, z }: DVec3) -> f64 {
    let ((ix, fx), (iy, fy), (iz, fz)) = (split(x), split(y), split(z));
    let base = seed
        .wrapping_add((ix as u64).wrapping_mul(STEP_X))
        .wrapping_add((iy as u64).wrapping_mul(STEP_Y))
        .wrapping_add((iz as u64).wrapping_mul(STEP_Z));
    let corner = |dx: u64, dy: u64, dz: u64| {
        let h = stir(
            base.wrapping_add(dx.wrapping_mul(STEP_X))
                .wrapping_add(dy.wrapping_mul(STEP_Y))
                .wrapping_add(dz.wrapping_mul(STEP_Z)),
        );
        slope3(h, fx - dx as f64, fy - dy as f64, fz - dz as f64)
    };
    let (u, v, w) = (fade(fx), fade(fy), fade(fz));
    let low = lerp(lerp(corner(0, 0, 0), corner(1, 0, 0), u), lerp(corner(0, 1, 0), corner(1, 1, 0), u), v);
    let high = lerp(lerp(corner(0, 0, 1), corner(1, 0, 1), u), lerp(corner(0, 1, 1), corner(1, 1, 1), u), v);
    lerp(low, high, w)
}

/// Fractal sum in the plane: `octaves` of [`noise2`], the first of wavelength `length`, each next one of half the
/// wavelength and `gain` times the amplitude. The first octave has amplitude 1.
pub(super) fn fractal2(seed: u64, x: f64, y: f64, length: f64, octaves: u32, gain: f64) -> f64 {
    let (mut frequency, mut amplitude, mut sum) = (1.0 / length, 1.0, 0.0);
    for octave in 0..octaves {
        let shift = f64::from(octave) * 17.37;
        sum += amplitude * noise2(seed.wrapping_add(u64::from(octave)), x * frequency + shift, y * frequency - shift);
        frequency *= 2.03;
        amplitude *= gain;
    }
    sum
}

/// Fractal sum in space; see [`fractal2`].
pub(super) fn fractal3(seed: u64, p: DVec3, length: f64, octaves: u32, gain: f64) -> f64 {
    let (mut frequency, mut amplitude, mut sum) = (1.0 / length, 1.0, 0.0);
    for octave in 0..octaves {
        let shift = f64::from(octave) * 17.37;
        let q = p * frequency + DVec3::new(shift, -shift, 0.5 * shift);
        sum += amplitude * noise3(seed.wrapping_add(u64::from(octave)), q);
        frequency *= 2.03;
        amplitude *= gain;
    }
    sum
}

/// Integer and fraction of a coordinate divided by a cell size.
pub(super) fn cell(x: f64, size: f64) -> (i64, f64) {
    split(x / size)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_continuous_across_lattice_planes_and_bounded() {
        for k in 0..2000 {
            let h = mix(k);
            let (y, z) = (unit(h, 0) * 40.0 - 20.0, unit(h, 1) * 40.0 - 20.0);
            let x = (k % 40) as f64 - 20.0;
            let gap = noise3(5, DVec3::new(x - 1e-9, y, z)) - noise3(5, DVec3::new(x + 1e-9, y, z));
            assert!(gap.abs() < 1e-7, "a step of {gap} at x = {x}");
            let gap = noise2(5, x - 1e-9, y) - noise2(5, x + 1e-9, y);
            assert!(gap.abs() < 1e-7, "a step of {gap} at x = {x}");
            assert!(noise3(5, DVec3::new(x + 0.3, y, z)).abs() < 1.7 && noise2(5, x + 0.3, y).abs() < 1.7);
        }
    }

    #[test]
    fn normal_numbers_have_mean_zero_and_variance_one() {
        let n = 200_000;
        let (mut sum, mut squares) = (0.0, 0.0);
        for k in 0..n {
            let v = normal(mix(k * 7 + 3));
            sum += v;
            squares += v * v;
        }
        let (mean, variance) = (sum / n as f64, squares / n as f64);
        assert!(mean.abs() < 0.01 && (variance - 1.0).abs() < 0.02, "mean {mean}, variance {variance}");
    }
}
