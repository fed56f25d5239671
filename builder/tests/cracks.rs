//! No cut of any pack has a crack: every edge used once carries the true-border bit, a closed mesh has none, and no
//! triangle occurs more often than in the input. 1,000 random valid cuts of each of four meshes.

use crate::support::{Opened, build, closed, fort, non_manifold, open, with_holes};
use kilwa_pack::cut::Cut;
use rayon::prelude::*;
use std::collections::HashMap;

const CUTS: u64 = 1000;

/// Every patch as numbers of edges (with border bits) and triangles, so that a cut is checked by counting.
struct Numbered {
    patches: Vec<Vec<Numbers>>,
    edges: Vec<([i32; 3], [i32; 3])>,
    /// How often each triangle may occur: as often as at the finest level, at least once.
    allowed: Vec<u16>,
}

#[derive(Default)]
struct Numbers {
    edges: Vec<(u32, bool)>,
    triangles: Vec<u32>,
}

/// The corners of a triangle, turned so that the smallest is first: orientation counts, the starting corner does not.
fn turned(c: [[i32; 3]; 3]) -> [[i32; 3]; 3] {
    let k = (0..3).min_by_key(|&k| c[k]).unwrap_or(0);
    [c[k], c[(k + 1) % 3], c[(k + 2) % 3]]
}

fn number(pack: &Opened) -> Numbered {
    let mut edges: HashMap<([i32; 3], [i32; 3]), u32> = HashMap::new();
    let mut triangles: HashMap<[[i32; 3]; 3], u32> = HashMap::new();
    let mut patches = Vec::new();
    for chunk in &pack.chunks {
        let mut of_chunk = Vec::new();
        for p in &chunk.patches {
            let mut n = Numbers::default();
            for t in p.first..p.first + p.count {
                let c = chunk.mesh.corners(t as usize).map(|p| p.to_array());
                for k in 0..3 {
                    let (a, b) = (c[k].min(c[(k + 1) % 3]), c[k].max(c[(k + 1) % 3]));
                    let next = edges.len() as u32;
                    let e = *edges.entry((a, b)).or_insert(next);
                    n.edges.push((e, chunk.mesh.borders[t as usize] & (1 << k) != 0));
                }
                let next = triangles.len() as u32;
                n.triangles.push(*triangles.entry(turned(c)).or_insert(next));
            }
            of_chunk.push(n);
        }
        patches.push(of_chunk);
    }
    let mut allowed = vec![0; triangles.len()];
    let finest = Cut::finest(&pack.entries);
    for i in finest.refined() {
        for (p, n) in pack.chunks[i as usize].patches.iter().zip(&patches[i as usize]) {
            if finest.draws(p) {
                n.triangles.iter().for_each(|t| allowed[*t as usize] += 1);
            }
        }
    }
    for a in &mut allowed {
        *a = (*a).max(1);
    }
    let mut names = vec![([0; 3], [0; 3]); edges.len()];
    for (e, i) in edges {
        names[i as usize] = e;
    }
    Numbered { patches, edges: names, allowed }
}

/// Check one cut; returns its triangles, the number of edges used once, and of those used an odd number of times.
fn check(pack: &Opened, numbered: &Numbered, cut: &Cut) -> Result<(usize, usize, usize), String> {
    let mut uses = vec![(0u8, false); numbered.edges.len()];
    let mut stands = vec![0u16; numbered.allowed.len()];
    let mut total = 0;
    for i in cut.refined() {
        for (p, n) in pack.chunks[i as usize].patches.iter().zip(&numbered.patches[i as usize]) {
            if !cut.draws(p) {
                continue;
            }
            total += n.triangles.len();
            for (e, border) in &n.edges {
                let u = &mut uses[*e as usize];
                *u = (u.0.saturating_add(1), u.1 | border);
            }
            for t in &n.triangles {
                stands[*t as usize] += 1;
                if stands[*t as usize] > numbered.allowed[*t as usize] {
                    return Err(format!("a triangle stands {} times", stands[*t as usize]));
                }
            }
        }
    }
    let once = uses.iter().filter(|u| u.0 == 1).count();
    let odd = uses.iter().filter(|u| u.0 % 2 == 1).count();
    match uses.iter().position(|u| u.0 == 1 && !u.1) {
        Some(e) => Err(format!("crack at edge {:?}", numbered.edges[e])),
        None => Ok((total, once, odd)),
    }
}

fn no_crack_in_any_cut(name: &str, raw: kilwa_formats::RawMesh, is_closed: bool) {
    let pack = open(&build(raw, 0));
    let numbered = number(&pack);
    let results: Vec<(usize, usize, usize)> = (0..CUTS)
        .into_par_iter()
        .map(|seed| {
            let target = 1 + (pack.entries.len() * (seed as usize % 97)) / 97;
            let cut = Cut::random(&pack.entries, seed, target);
            assert!(cut.is_valid(&pack.entries));
            let r = check(&pack, &numbered, &cut).unwrap_or_else(|e| panic!("{name}, cut {seed}: {e}"));
            assert!(
                !is_closed || r.2 == 0,
                "{name}, cut {seed}: {} edges of a closed mesh are used an odd number of times",
                r.2
            );
            r
        })
        .collect();
    let finest = check(&pack, &numbered, &Cut::finest(&pack.entries)).expect("finest cut");
    assert_eq!(finest.0 as u64, pack.triangles, "{name}: the finest cut has every triangle");
    assert_eq!(finest.1 as u64, pack.border_edges, "{name}: and every border edge");
    let coarsest = results.iter().map(|r| r.0).min().unwrap_or(0);
    println!("{name}: {CUTS} cuts of {coarsest} to {} triangles, {} chunks", finest.0, pack.entries.len());
    assert!(coarsest * 20 < finest.0, "{name}: the cuts reach coarse levels");
}

#[test]
fn a_fort_has_no_crack_in_any_cut() {
    no_crack_in_any_cut("fort", fort(300_000), false);
}

#[test]
fn a_closed_mesh_has_no_crack_in_any_cut_and_stays_closed() {
    no_crack_in_any_cut("closed", closed(150_000), true);
}

#[test]
fn a_mesh_with_holes_has_no_crack_in_any_cut() {
    no_crack_in_any_cut("holes", with_holes(150_000), false);
}

#[test]
fn a_non_manifold_mesh_with_bow_ties_has_no_crack_in_any_cut() {
    no_crack_in_any_cut("non-manifold", non_manifold(150), false);
}
