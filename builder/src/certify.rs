//! The certified two-sided error of one simplification step, and its accumulation to a bound against the finest surface.
//!
//! The distance from a point of a triangle T to *one* triangle T' is convex over T, so the largest of the distances of
//! T's corners to T' bounds it for all of T. The smallest such bound over all T' is what a piece of T is certified with;
//! pieces are halved where that is loose (design/hierarchy.md, "The error is a promise").
//!
//! Carried per triangle of a patch, in lattice steps, both against the *finest* surface:
//! `out` – every point of this triangle is within `out` of the finest surface;
//! `back` – every point of the finest surface that is accounted to this triangle is within `back` of it.
//! Every point of the finest surface is accounted to some triangle of every level, so the largest `back` bounds the
//! other direction.

use kilwa_geometry::Mesh;
use kilwa_geometry::bvh::{Bounds, Bvh};
use kilwa_geometry::distance::{ABSOLUTE_SLACK, DISTANCE_SLACK, Vec3, cross, dot, point_triangle_squared, sub};
use rustc_hash::FxHashMap;

/// Halvings of a triangle after which a loose bound is accepted (it is a bound all the same).
const MAX_HALVINGS: u32 = 12;
/// A piece whose bound is this close to what is surely there is tight enough.
const TIGHT: f64 = 1.25;
/// Pieces bounded by this share of the largest distance found so far do not decide anything.
const UNIMPORTANT: f64 = 0.7;

/// Bounds of one triangle against the finest surface, in lattice steps.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Bound {
    /// From this triangle to the finest surface.
    pub out: f32,
    /// From the finest surface accounted to this triangle, to it.
    pub back: f32,
}

type Triangle = [Vec3; 3];

/// Bounds for every triangle of `coarse`, given those of `fine`, which `coarse` replaces.
pub fn certify(fine: &Mesh, fine_bounds: &[Bound], coarse: &Mesh) -> Vec<Bound> {
    let origin = fine.bounds().min;
    let local = |m: &Mesh| -> Vec<Triangle> {
        (0..m.triangle_count())
            .map(|t| m.corners(t).map(|p| std::array::from_fn(|i| f64::from(p[i] - origin[i]))))
            .collect()
    };
    let (f, c) = (local(fine), local(coarse));
    // Triangles that both share need no search.
    let name = |t: &Triangle| {
        let mut k = t.map(|p| p.map(|x| x as i64));
        k.sort_unstable();
        k
    };
    let mut same: FxHashMap<[[i64; 3]; 3], u32> = FxHashMap::default();
    c.iter().enumerate().for_each(|(i, t)| {
        same.entry(name(t)).or_insert(i as u32);
    });
    let twin_in_coarse: Vec<Option<u32>> = f.iter().map(|t| same.get(&name(t)).copied()).collect();
    let mut twin_in_fine: Vec<Option<u32>> = vec![None; c.len()];
    for (i, twin) in twin_in_coarse.iter().enumerate() {
        if let Some(t) = twin {
            twin_in_fine[*t as usize].get_or_insert(i as u32);
        }
    }
    let mut bounds = vec![Bound::default(); c.len()];
    // From fine to coarse: what was accounted to a fine triangle is now accounted to the nearest coarse ones.
    let tree = Bvh::new(&c);
    let sure = cover(&f, &twin_in_coarse, &tree, &c, 0.0, |from, to, d| {
        let b = &mut bounds[to as usize].back;
        *b = b.max(add_up(d, fine_bounds[from as usize].back));
    });
    // From coarse to fine. What the first direction found is there anyway, so the second need not look below it.
    let tree = Bvh::new(&f);
    cover(&c, &twin_in_fine, &tree, &f, sure, |from, to, d| {
        let b = &mut bounds[from as usize].out;
        *b = b.max(add_up(d, fine_bounds[to as usize].out));
    });
    bounds
}

/// `d + carried` rounded up to f32, with the slack of the distance computation.
fn add_up(d: f64, carried: f32) -> f32 {
    // Triangles that both share are exact.
    let slack = if d > 0.0 { ABSOLUTE_SLACK } else { 0.0 };
    let sum = d * (1.0 + DISTANCE_SLACK) + slack + f64::from(carried);
    let f = sum as f32;
    if f64::from(f) < sum { f.next_up() } else { f }
}

/// Cover every triangle of `from` with pieces, each certified to be within `d` of one triangle of `to`, and report them.
/// `sure` is a distance that is there in any case; returns it raised by what was found here. It steers the effort, not
/// the truth of the result.
fn cover(
    from: &[Triangle],
    twins: &[Option<u32>],
    tree: &Bvh,
    to: &[Triangle],
    mut sure: f64,
    mut report: impl FnMut(u32, u32, f64),
) -> f64 {
    let mut hint = 0;
    let mut corners: Vec<[f64; 3]> = vec![[0.0; 3]; from.len()];
    for (i, t) in from.iter().enumerate() {
        if twins[i].is_none() {
            for k in 0..3 {
                let (d, h) = nearest(tree, &[t[k]], to, hint);
                hint = h;
                corners[i][k] = d;
                sure = sure.max(d);
            }
        }
    }
    for (i, t) in from.iter().enumerate() {
        if let Some(twin) = twins[i] {
            report(i as u32, twin, 0.0);
            continue;
        }
        let mut stack = vec![(*t, corners[i], 0u32)];
        while let Some((piece, at_corners, depth)) = stack.pop() {
            let (bound, near) = nearest(tree, &piece, to, hint);
            hint = near;
            let there = at_corners.iter().copied().fold(0.0, f64::max);
            if bound <= there * TIGHT || bound <= sure * UNIMPORTANT || depth >= MAX_HALVINGS {
                report(i as u32, near, bound);
                continue;
            }
            divide(&piece, &to[near as usize], &mut |corners: [Corner; 3]| {
                let mut part = [[0.0; 3]; 3];
                let mut distances = [0.0; 3];
                for (k, corner) in corners.into_iter().enumerate() {
                    (part[k], distances[k]) = match corner {
                        Corner::Old(i) => (piece[i], at_corners[i]),
                        Corner::New(p) => {
                            let (d, _) = nearest(tree, &[p], to, near);
                            sure = sure.max(d);
                            (p, d)
                        }
                    };
                }
                stack.push((part, distances, depth + 1));
            });
        }
    }
    sure
}

/// A corner of a part of a piece.
#[derive(Clone, Copy)]
enum Corner {
    /// Corner of the piece.
    Old(usize),
    /// A point on one of its edges.
    New(Vec3),
}

/// Divide a piece: along the side of `near` that it sticks out over, so that one part lies over `near` alone (there the
/// bound is exact, being the distance to a plane); where no side divides it well, across its longest edge.
fn divide(piece: &Triangle, near: &Triangle, part: &mut impl FnMut([Corner; 3])) {
    use Corner::{New, Old};
    let length = |k: usize| {
        let e = sub(piece[k], piece[(k + 1) % 3]);
        dot(e, e)
    };
    let longest = (0..3).max_by(|&a, &b| length(a).total_cmp(&length(b))).unwrap_or(0);
    let n = cross(sub(near[1], near[0]), sub(near[2], near[0]));
    let enough = length(longest).sqrt() * WORTH_CUTTING;
    let mut best: Option<([f64; 3], f64)> = None;
    for k in 0..3 {
        // Pointing out of the triangle across this side.
        let out = cross(sub(near[(k + 1) % 3], near[k]), n);
        let len = dot(out, out).sqrt();
        if len <= 0.0 {
            continue;
        }
        let s = piece.map(|p| dot(sub(p, near[k]), out) / len);
        let (low, high) = (s.iter().copied().fold(f64::MAX, f64::min), s.iter().copied().fold(f64::MIN, f64::max));
        if low < -enough && high > enough && best.is_none_or(|b| high > b.1) {
            best = Some((s, high));
        }
    }
    let between =
        |i: usize, j: usize, t: f64| -> Vec3 { std::array::from_fn(|x| piece[i][x] + (piece[j][x] - piece[i][x]) * t) };
    let Some((s, _)) = best else {
        let (i, j, k) = (longest, (longest + 1) % 3, (longest + 2) % 3);
        let m = between(i, j, 0.5);
        part([Old(i), New(m), Old(k)]);
        part([New(m), Old(j), Old(k)]);
        return;
    };
    // The corner that is alone on its side.
    let outside = s.map(|x| x > 0.0);
    let alone = (0..3).find(|&k| outside[k] != outside[(k + 1) % 3] && outside[k] != outside[(k + 2) % 3]).unwrap_or(0);
    let (q, r) = ((alone + 1) % 3, (alone + 2) % 3);
    let a = between(alone, q, s[alone] / (s[alone] - s[q]));
    let b = between(alone, r, s[alone] / (s[alone] - s[r]));
    part([Old(alone), New(a), New(b)]);
    part([New(a), Old(q), Old(r)]);
    part([New(a), Old(r), New(b)]);
}

/// A cut must leave at least this share of the longest edge on both sides.
const WORTH_CUTTING: f64 = 0.05;

/// The triangle of `to` that makes the largest distance of `points` to it smallest, and that distance. `hint` is a
/// triangle to start from; it changes the time taken, and the answer only among equals.
fn nearest(tree: &Bvh, points: &[Vec3], to: &[Triangle], hint: u32) -> (f64, u32) {
    let largest = |t: u32, limit: f64| {
        let mut worst = 0.0f64;
        for p in points {
            worst = worst.max(point_triangle_squared(*p, to[t as usize]));
            if worst >= limit {
                break;
            }
        }
        worst
    };
    let mut best = (largest(hint, f64::INFINITY), hint);
    let start = best.0;
    let lower = |b: &Bounds| Some(points.iter().map(|p| b.distance_squared(*p)).fold(0.0, f64::max));
    tree.search(start, lower, |t, limit| {
        let d = largest(t, limit);
        if d < limit {
            best = (d, t);
        }
        best.0
    });
    (best.0.sqrt(), best.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn mesh(z: impl Fn(i32, i32) -> i32, step: usize) -> Mesh {
        let mut m = Mesh::default();
        let n = 16 / step as i32;
        for y in 0..=n {
            for x in 0..=n {
                let (x, y) = (x * step as i32, y * step as i32);
                m.positions.push([x * 10, y * 10, z(x, y)]);
            }
        }
        let w = n as u32 + 1;
        for y in 0..n as u32 {
            for x in 0..n as u32 {
                let i = y * w + x;
                m.triangles.extend([[i, i + 1, i + w], [i + 1, i + w + 1, i + w]]);
            }
        }
        m
    }

    fn sampled(from: &Mesh, to: &Mesh) -> f64 {
        let tri = |m: &Mesh, t| m.corners(t).map(|p| p.map(f64::from));
        let mut worst = 0.0f64;
        for t in 0..from.triangle_count() {
            let [a, b, c] = tri(from, t);
            for i in 0..=6 {
                for j in 0..=(6 - i) {
                    let (u, v) = (f64::from(i) / 6.0, f64::from(j) / 6.0);
                    let p: Vec3 = std::array::from_fn(|k| a[k] + (b[k] - a[k]) * u + (c[k] - a[k]) * v);
                    let d = (0..to.triangle_count())
                        .map(|s| point_triangle_squared(p, tri(to, s)))
                        .fold(f64::MAX, f64::min);
                    worst = worst.max(d.sqrt());
                }
            }
        }
        worst
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]
        #[test]
        fn the_bound_holds_in_both_directions_and_is_not_wild(seed in 0i32..1000) {
            let rough = |x: i32, y: i32| 500 + ((x * 31 + y * 17 + seed) * 7919 % 23);
            let (fine, coarse) = (mesh(rough, 1), mesh(rough, 4));
            let bounds = certify(&fine, &vec![Bound::default(); fine.triangle_count()], &coarse);
            let out = f64::from(bounds.iter().map(|b| b.out).fold(0.0, f32::max));
            let back = f64::from(bounds.iter().map(|b| b.back).fold(0.0, f32::max));
            let (so, sb) = (sampled(&coarse, &fine), sampled(&fine, &coarse));
            prop_assert!(so <= out && sb <= back, "{so} <= {out}, {sb} <= {back}");
            prop_assert!(out <= so * 1.6 + 0.1 && back <= sb * 1.6 + 0.1, "{so} ~ {out}, {sb} ~ {back}");
        }
    }

    #[test]
    fn an_unchanged_mesh_has_no_error_and_carries_its_bounds() {
        let m = mesh(|x, y| x * y, 1);
        let given = vec![Bound { out: 1.5, back: 2.5 }; m.triangle_count()];
        assert_eq!(certify(&m, &given, &m), given);
    }
}
