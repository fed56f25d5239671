//! How the attributes of a vertex are predicted: from one or two parallelograms, with weights that are fitted to the
//! chunk. FORMAT section 5.6. (Touma and Gotsman, "Triangle mesh compression", 1998; several parallelograms: Isenburg and
//! Alliez, "Compressing polygon mesh geometry with parallelogram prediction", 2002.)

use super::border::{Link, NONE, Parallelogram};
use super::range::Coder;
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
fn stencil<T: Copy + Into<i64>>(values: &[[T; 3]], link: Link) -> Option<Stencil> {
    let sum = |[a, b]: [u32; 2]| each(at(values, a), at(values, b), |a, b| a + b);
    match link {
        Link::Nothing | Link::Near(_) => None,
        Link::One(Parallelogram { edge, across }) => {
            let edges = sum(edge).map(|x| 2 * x);
            let beyond = each(edges, at(values, across), |e, x| e - 4 * x);
            Some(Stencil { edges, beyond, shared: [0; 3], two: false })
        }
        Link::Two(p, q) => {
            let edges = each(sum(p.edge), sum(q.edge), |a, b| a + b);
            let beyond = each(edges, sum([p.across, q.across]), |e, x| e - 2 * x);
            let ([a, b], [c, d]) = (p.edge, q.edge);
            let both = if a == c || a == d { Some(a) } else { Some(b).filter(|_| b == c || b == d) };
            let shared = both.map_or([0; 3], |v| each(at(values, v), edges, |x, e| 8 * x - 2 * e));
            Some(Stencil { edges, beyond, shared, two: true })
        }
    }
}

impl Weights {
    /// As they are stored: a byte each.
    pub(super) fn code(self, coder: &mut impl Coder) -> Self {
        let [one, two, shared] = [self.one, self.two, self.shared].map(|x| {
            let byte = coder.raw(8, u32::from(x.cast_unsigned())) & 0xff;
            (byte as u8).cast_signed()
        });
        Self { one, two, shared }
    }

    /// Those with the smallest squared residuals.
    pub(super) fn best<T: Copy + Into<i64>>(values: &[[T; 3]], links: &[Link]) -> Self {
        let (mut one, mut two) = ([0.0f64; 2], [0.0f64; 5]);
        for (value, link) in values.iter().zip(links) {
            let Some(s) = stencil(values, *link) else { continue };
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
    pub(super) fn predict<T: Copy + Into<i64>>(self, values: &[[T; 3]], link: Link) -> [i64; 3] {
        match link {
            Link::Near(v) => at(values, v),
            _ => stencil(values, link).map_or([0; 3], |s| self.apply(&s)),
        }
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

/// The vertices beside which a vertex was found: their residuals predict how large its own will be.
pub(super) fn beside(link: Link) -> [u32; 2] {
    match link {
        Link::Nothing => [NONE; 2],
        Link::Near(v) => [v, v],
        Link::One(p) | Link::Two(p, _) => p.edge,
    }
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
