//! The same input gives the same bytes, for any number of threads and any order of the triangles.

use crate::support::{build, non_manifold, shuffled, wall, with_holes};

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
    let other = shuffled(&raw, 11);
    assert!(build(raw, 0) == build(other, 0));
}
