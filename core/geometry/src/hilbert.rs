//! The Hilbert curve in space: an order of lattice points in which successors are neighbours.
//!
//! In: a point with coordinates of up to 31 bits. Out: its place along the curve. J. Skilling, "Programming the Hilbert curve",
//! AIP Conference Proceedings 707 (2004).

/// Bits of a coordinate.
const BITS: u32 = 31;

/// How far along the curve a point comes, 0 to 2^93 - 1. Bits above the 31st of a coordinate are not looked at.
pub fn code(point: [u32; 3]) -> u128 {
    transposed(point, BITS)
}

/// The same in a cube of 2^bits points a side.
fn transposed(mut x: [u32; 3], bits: u32) -> u128 {
    for bit in (1..bits).rev() {
        let (q, below) = (1u32 << bit, (1u32 << bit) - 1);
        for i in 0..3 {
            if x[i] & q == 0 {
                let swapped = (x[0] ^ x[i]) & below;
                x[0] ^= swapped;
                x[i] ^= swapped;
            } else {
                x[0] ^= below;
            }
        }
    }
    x[1] ^= x[0];
    x[2] ^= x[1];
    let turns = (1..bits).filter(|bit| x[2] >> bit & 1 == 1).fold(0, |t, bit| t ^ ((1u32 << bit) - 1));
    let axes = x.map(|v| v ^ turns);
    let mut code = 0u128;
    for bit in (0..bits).rev() {
        for v in axes {
            code = code << 1 | u128::from(v >> bit & 1);
        }
    }
    code
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_visits_every_point_of_a_cube_once_moving_between_neighbours() {
        for bits in 1..5u32 {
            let side = 1u32 << bits;
            let mut at = vec![None; (side * side * side) as usize];
            for k in 0..side * side * side {
                let p = [k % side, k / side % side, k / side / side];
                let slot = &mut at[usize::try_from(transposed(p, bits)).unwrap()];
                assert_eq!(slot.replace(p), None, "two points with one place");
            }
            for pair in at.windows(2) {
                let (a, b) = (pair[0].unwrap(), pair[1].unwrap());
                let steps: u32 = (0..3).map(|i| a[i].abs_diff(b[i])).sum();
                assert_eq!(steps, 1, "{a:?} {b:?}");
            }
        }
    }

    #[test]
    fn the_curve_keeps_the_points_of_a_small_cube_together() {
        // An aligned cube of 2^k points a side is one stretch of the curve, whatever its place.
        let corner = [5u32 << 20, 1000 << 10, (1 << 31) - 1024];
        let cube = corner.map(|c| c & !1023);
        let codes: Vec<u128> =
            (0..4096u32).map(|k| code([cube[0] + k % 1024, cube[1] + k * 7 % 1024, cube[2] + k * 31 % 1024])).collect();
        assert!(codes.iter().all(|c| c >> 30 == codes[0] >> 30));
    }
}
