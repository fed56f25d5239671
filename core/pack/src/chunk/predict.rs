//! How the attributes of a vertex are predicted: from one or two parallelograms, with weights that are fitted to the
//! chunk. FORMAT section 5.6. (Touma and Gotsman, "Triangle mesh compression", 1998; several parallelograms: Isenburg and
//! Alliez, "Compressing polygon mesh geometry with parallelogram prediction", 2002.)

use super::border::{Kind, Link};
use glam::DVec3;
use kilwa_geometry::{Mesh, normal};

/// Weights are in units of 1 / 64.
const UNIT: i64 = 64;

/// How parallelograms make a prediction, in units of 1 / 64.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Weights {
    /// How far to go beyond the edge where there is one parallelogram: 64 is all the way, 0 the middle of the edge.
    one: i8,
    /// The same where there are two.
    two: i8,
    /// How much more than the others the vertex counts that both edges share.
    shared: i8,
}

/// Factors of the other vertices of the edges, of those across, of the shared one. With the first vertex they sum to 256.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coefficients {
    one: [i32; 3],
    two: [i32; 3],
    fan: [i32; 3],
}

impl Coefficients {
    #[inline]
    pub(super) fn of(&self, kind: Kind) -> [i32; 3] {
        match kind {
            Kind::Near | Kind::One => self.one,
            Kind::Two => self.two,
            Kind::Fan => self.fan,
        }
    }
}

/// Sums over the vertices that a prediction is made from.
struct Stencil {
    /// Four times the middle of the edges.
    edges: [i64; 3],
    /// Four times the way from the far vertices to the middle of the edges.
    beyond: [i64; 3],
    /// Eight times the shared vertex less twice the sum of all four; 0 if there is none.
    shared: [i64; 3],
    two: bool,
}

#[inline]
fn at<T: Copy + Into<i64>>(values: &[[T; 3]], v: u32) -> [i64; 3] {
    values.get(v as usize).map_or([0; 3], |p| p.map(Into::into))
}

#[inline]
fn each(a: [i64; 3], b: [i64; 3], f: impl Fn(i64, i64) -> i64) -> [i64; 3] {
    let ([a, b, c], [d, e, g]) = (a, b);
    [f(a, d), f(b, e), f(c, g)]
}

#[inline]
fn stencil<T: Copy + Into<i64>>(values: &[[T; 3]], link: &Link) -> Stencil {
    let sum = |[a, b]: [u32; 2]| each(at(values, a), at(values, b), |a, b| a + b);
    let edges = each(sum(link.edge), sum(link.edge2), |a, b| a + b);
    let beyond = each(edges, sum([link.across, link.across2]), |e, x| e - 2 * x);
    let is_fan = link.kind == Kind::Fan;
    let shared = if is_fan { each(at(values, link.shared), edges, |x, e| 8 * x - 2 * e) } else { [0; 3] };
    Stencil { edges, beyond, shared, two: link.is_two() }
}

impl Weights {
    /// As they are stored: a byte each, by a function that codes raw bits.
    pub(super) fn code(self, raw: &mut impl FnMut(u32, u32) -> u32) -> Self {
        let [one, two, shared] = [self.one, self.two, self.shared].map(|x| {
            let byte = raw(8, u32::from(x.cast_unsigned())) & 0xff;
            (byte as u8).cast_signed()
        });
        Self { one, two, shared }
    }

    /// What the prediction is as a sum of differences from the first vertex, in units of 1 / 256.
    pub(super) fn coefficients(self) -> Coefficients {
        let [one, two, shared] = [self.one, self.two, self.shared].map(i32::from);
        let unit = 64;
        Coefficients {
            one: [unit + one, -2 * one, 0],
            two: [unit + two, -2 * two, 0],
            fan: [unit + two - 2 * shared, -2 * two, 8 * shared],
        }
    }

    /// Those with the smallest squared residuals.
    pub(super) fn best<T: Copy + Into<i64>>(values: &[[T; 3]], links: &[Link]) -> Self {
        let (mut one, mut two) = ([0.0f64; 2], [0.0f64; 5]);
        for (value, link) in values.iter().zip(links) {
            let s = stencil(values, link);
            let wanted = each(value.map(Into::into), s.edges, |x, e| 4 * x - e);
            for ((y, f), g) in wanted.into_iter().zip(s.beyond).zip(s.shared) {
                let [y, f, g] = [y, f, g].map(|x| x as f64);
                if s.two {
                    add(&mut two, [f * f, f * g, g * g, f * y, g * y]);
                } else {
                    add(&mut one, [f * f, f * y]);
                }
            }
        }
        let ([square, product], [ff, fg, gg, fy, gy]) = (one, two);
        let determinant = ff * gg - fg * fg;
        let (beyond, shared) = if determinant > 1e-6 * ff * gg {
            ((fy * gg - gy * fg) / determinant, (gy * ff - fy * fg) / determinant)
        } else {
            (1.0, 0.0)
        };
        Self { one: weight(product / square), two: weight(beyond), shared: weight(shared) }
    }

    fn apply(self, s: &Stencil) -> [i64; 3] {
        let (beyond, shared) = if s.two { (self.two, self.shared) } else { (self.one, 0) };
        let weighted = each(s.beyond, s.shared, |b, m| i64::from(beyond) * b + i64::from(shared) * m);
        each(s.edges, weighted, |e, w| (UNIT * e + w + 2 * UNIT) >> 8)
    }

    /// The prediction for a vertex.
    pub(super) fn predict<T: Copy + Into<i64>>(self, values: &[[T; 3]], link: &Link) -> [i64; 3] {
        self.apply(&stencil(values, link))
    }
}

fn add<const N: usize>(sums: &mut [f64; N], terms: [f64; N]) {
    for (sum, term) in sums.iter_mut().zip(terms) {
        *sum += term;
    }
}

/// A weight as it is stored; what cannot be fitted is the plain parallelogram.
fn weight(x: f64) -> i8 {
    let nearest = if x.is_finite() { libm::round(x * UNIT as f64).clamp(-127.0, 127.0) } else { UNIT as f64 };
    #[expect(clippy::cast_possible_truncation, reason = "a whole number between -127 and 127")]
    let stored = nearest as i8;
    stored
}

/// Predict all normals from the chunk's own triangles: the sum of the cross products at each vertex, in the order of
/// `triangles`, in `f64`, as octahedral coordinates. Chunk borders see only their own side.
pub(super) fn normals(mesh: &Mesh) -> Vec<normal::OctNormal> {
    let mut sums = vec![DVec3::ZERO; mesh.positions.len()];
    let at = |v: u32| mesh.positions.get(v as usize).copied().unwrap_or_default().as_dvec3();
    for &[a, b, c] in &mesh.triangles {
        let (p, q, r) = (at(a), at(b), at(c));
        let n = (q - p).cross(r - p);
        for corner in [a, b, c] {
            if let Some(sum) = sums.get_mut(corner as usize) {
                *sum += n;
            }
        }
    }
    sums.into_iter().map(normal::encode).collect()
}
