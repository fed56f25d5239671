//! Unit normals as two 16-bit octahedral coordinates (Meyer et al., "On Floating-Point Normal Vectors", 2010).

use glam::DVec3;

/// Octahedral coordinates in `-32767..=32767`.
pub type OctNormal = [i16; 2];

/// Encode a direction (need not be unit length). The zero vector and non-finite input encode as +z.
pub fn encode(n: DVec3) -> OctNormal {
    let sum = n.abs().element_sum();
    if !(sum.is_finite() && sum > 0.0) {
        return [0, 0];
    }
    let (mut u, mut v) = (n.x / sum, n.y / sum);
    if n.z < 0.0 {
        let (a, b) = (u, v);
        u = (1.0 - b.abs()) * if a >= 0.0 { 1.0 } else { -1.0 };
        v = (1.0 - a.abs()) * if b >= 0.0 { 1.0 } else { -1.0 };
    }
    [u, v].map(|x| libm::round(x.clamp(-1.0, 1.0) * 32767.0) as i16)
}

/// Decode to a unit vector.
pub fn decode(o: OctNormal) -> DVec3 {
    let [mut x, mut y] = o.map(|c| f64::from(c.max(-32767)) / 32767.0);
    let z = 1.0 - x.abs() - y.abs();
    if z < 0.0 {
        let (a, b) = (x, y);
        x = (1.0 - b.abs()) * if a >= 0.0 { 1.0 } else { -1.0 };
        y = (1.0 - a.abs()) * if b >= 0.0 { 1.0 } else { -1.0 };
    }
    let n = DVec3::new(x, y, z);
    n / n.length()
}

/// Round octahedral coordinates to `bits` bits per coordinate (2..=16), kept in the 16-bit range so that decoding does
/// not change. Idempotent.
pub fn quantize(o: OctNormal, bits: u32) -> OctNormal {
    let levels = f64::from((1u32 << (bits - 1)) - 1);
    o.map(|c| {
        let q = libm::round(f64::from(c) / 32767.0 * levels);
        libm::round(q / levels * 32767.0) as i16
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_round_trip_changes_a_normal_by_less_than_a_hundredth_of_a_degree() {
        for i in 0..200 {
            for j in 0..50 {
                let (a, b) = (f64::from(i) * 0.0314, f64::from(j) * 0.0628);
                let n = DVec3::new(a.cos() * b.sin(), a.sin() * b.sin(), b.cos());
                let d = decode(encode(n));
                assert!(n.dot(d) > (0.01f64.to_radians()).cos() - 1e-12, "{n:?} {d:?}");
            }
        }
    }

    #[test]
    fn quantizing_twice_changes_nothing() {
        for c in (-32767..=32767).step_by(97) {
            let once = quantize([c, 1234], 10);
            assert_eq!(quantize(once, 10), once);
        }
    }
}
