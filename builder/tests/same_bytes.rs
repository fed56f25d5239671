//! The same input gives the same bytes, for any number of threads and any order of the triangles.

use crate::support::{build, non_manifold, wall, with_holes};

#[test]
fn one_two_and_eight_threads_give_the_same_bytes() {
    for (name, raw) in [("wall", wall(60_000)), ("holes", with_holes(40_000)), ("non-manifold", non_manifold(60))] {
        let one = build(raw.clone(), 1);
        assert_eq!(one, build(raw.clone(), 2), "{name}: 2 threads");
        assert_eq!(one, build(raw, 8), "{name}: 8 threads");
    }
}

#[test]
fn the_bytes_do_not_depend_on_the_order_of_triangles_and_vertices() {
    let raw = wall(40_000);
    let mut shuffled = raw.clone();
    let mut random = fastrand::Rng::with_seed(11);
    let n = raw.positions.len();
    let mut new_of_old: Vec<u32> = (0..n as u32).collect();
    for i in (1..n).rev() {
        new_of_old.swap(i, random.usize(..=i));
    }
    for (old, new) in new_of_old.iter().enumerate() {
        shuffled.positions[*new as usize] = raw.positions[old];
        shuffled.colors[*new as usize] = raw.colors[old];
    }
    for t in &mut shuffled.triangles {
        *t = t.map(|v| new_of_old[v as usize]);
    }
    for i in (1..shuffled.triangles.len()).rev() {
        shuffled.triangles.swap(i, random.usize(..=i));
    }
    assert!(build(raw, 0) == build(shuffled, 0));
}
