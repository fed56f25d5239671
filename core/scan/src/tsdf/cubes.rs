//! Marching cubes with a table that is made by rule (Lorensen and Cline, "Marching Cubes", 1987).
//!
//! On a face with two inside and two outside corners on diagonals, the inside corners are separated; both cells of a face see the same corners and cut it in the same way, so
//! there are no cracks. The loops of a cell are triangulated without diagonals in its faces, because the neighbouring cell could have the same diagonal, and then an edge
//! would have four triangles. Where a loop allows no such triangulation, a vertex is added inside the cell.

/// The twelve edges of a cell: the lower corner, as bits x, y, z, and the axis.
pub(super) const EDGES: [(u8, u8); 12] =
    [(0, 0), (2, 0), (4, 0), (6, 0), (0, 1), (1, 1), (4, 1), (5, 1), (0, 2), (1, 2), (2, 2), (3, 2)];

/// Corners of each face, counterclockwise seen from outside.
const FACES: [[u8; 4]; 6] = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];

/// Stands for the vertex inside the cell.
pub(super) const INSIDE: u8 = 12;

/// The triangles of each case; a case has a bit for each corner that is inside (negative).
#[derive(Debug, Clone)]
pub struct Cubes {
    pub(super) cases: Vec<Vec<Part>>,
}

/// One loop of a case.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Part {
    /// The edges that the loop crosses, in order.
    pub(super) edges: Vec<u8>,
    /// Triangles by edges; [`INSIDE`] is a vertex in the middle of the loop.
    pub(super) triangles: Vec<[u8; 3]>,
}

impl Default for Cubes {
    fn default() -> Self {
        Self { cases: (0..=255).map(|case| loops(case).into_iter().map(part).collect()).collect() }
    }
}

fn edge_between(a: u8, b: u8) -> u8 {
    let (low, axis) = (a.min(b), (a ^ b).trailing_zeros() as u8);
    EDGES.iter().position(|edge| *edge == (low, axis)).unwrap_or_default() as u8
}

fn faces_of(edge: u8) -> impl Iterator<Item = usize> {
    let (low, axis) = EDGES[usize::from(edge)];
    let high = low | 1 << axis;
    (0..6).filter(move |k| FACES[*k].contains(&low) && FACES[*k].contains(&high))
}

/// The closed loops of a case.
fn loops(case: u8) -> Vec<Vec<u8>> {
    let is_inside = |corner: u8| case >> corner & 1 == 1;
    // From the edge where a run of inside corners begins to the edge where it ends, round each face.
    let mut next = [None; 12];
    for face in FACES {
        for k in 0..4 {
            let (before, here) = (face[(k + 3) % 4], face[k]);
            if is_inside(before) || !is_inside(here) {
                continue;
            }
            let mut end = k;
            while is_inside(face[(end + 1) % 4]) {
                end = (end + 1) % 4;
            }
            next[usize::from(edge_between(before, here))] = Some(edge_between(face[end], face[(end + 1) % 4]));
        }
    }
    let mut out = Vec::new();
    for start in 0..12 {
        let (mut at, mut edges) = (start, Vec::new());
        while let Some(edge) = next[at].take() {
            edges.push(at as u8);
            at = usize::from(edge);
        }
        if !edges.is_empty() {
            out.push(edges);
        }
    }
    out
}

fn part(edges: Vec<u8>) -> Part {
    let triangles = triangulated(&edges)
        .unwrap_or_else(|| (0..edges.len()).map(|k| [edges[k], edges[(k + 1) % edges.len()], INSIDE]).collect());
    Part { edges, triangles }
}

/// Triangles of a polygon none of whose diagonals lies in a face.
fn triangulated(polygon: &[u8]) -> Option<Vec<[u8; 3]>> {
    if polygon.len() < 3 {
        return Some(Vec::new());
    }
    let in_face = |a: u8, b: u8| faces_of(a).any(|face| faces_of(b).any(|other| other == face));
    let (first, last) = (polygon[0], polygon[polygon.len() - 1]);
    // The triangle at the side from the last to the first.
    for k in 1..polygon.len() - 1 {
        let apex = polygon[k];
        let is_side = [k == 1, k == polygon.len() - 2];
        if (!is_side[0] && in_face(first, apex)) || (!is_side[1] && in_face(apex, last)) {
            continue;
        }
        if let (Some(left), Some(right)) = (triangulated(&polygon[..=k]), triangulated(&polygon[k..])) {
            return Some([left, right, vec![[first, apex, last]]].concat());
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    #[test]
    fn every_crossed_edge_is_in_one_loop_and_no_diagonal_lies_in_a_face() {
        let cubes = Cubes::default();
        let mut with_inner_vertex = 0;
        for case in 0..=255u8 {
            let mut used = [0; 12];
            for part in &cubes.cases[usize::from(case)] {
                assert!(part.edges.len() >= 3);
                part.edges.iter().for_each(|edge| used[usize::from(*edge)] += 1);
                with_inner_vertex += usize::from(part.triangles.iter().flatten().any(|v| *v == INSIDE));
                let mut sides: BTreeMap<[u8; 2], u32> = BTreeMap::new();
                for [a, b, c] in &part.triangles {
                    for [p, q] in [[a, b], [b, c], [c, a]] {
                        *sides.entry([*p.min(q), *p.max(q)]).or_default() += 1;
                    }
                }
                for ([p, q], count) in sides {
                    let is_diagonal = count == 2 && q != INSIDE;
                    assert!(count <= 2);
                    assert!(!is_diagonal || faces_of(p).all(|face| faces_of(q).all(|other| other != face)), "{case}");
                }
            }
            for (edge, (low, axis)) in EDGES.iter().enumerate() {
                let is_crossed = (case >> low ^ case >> (low | 1 << axis)) & 1 == 1;
                assert_eq!(used[edge], i32::from(is_crossed), "case {case}, edge {edge}");
            }
        }
        println!("{with_inner_vertex} loops have a vertex inside");
    }

    #[test]
    fn triangles_face_outside() {
        let cubes = Cubes::default();
        let middle = |edge: u8| {
            let (low, axis) = EDGES[usize::from(edge)];
            let corner = |c: u8| glam::DVec3::new(f64::from(c & 1), f64::from(c >> 1 & 1), f64::from(c >> 2));
            (corner(low) + corner(low | 1 << axis)) / 2.0
        };
        let [a, b, c] = cubes.cases[1][0].triangles[0].map(middle);
        // The corner at the origin is inside, so the triangle faces (1, 1, 1).
        assert!((b - a).cross(c - a).dot(glam::DVec3::ONE) > 0.0);
    }
}
