//! Provisional picks: the interval that a coarse level gives holds the final value.

use super::check_none;
use super::phantoms::phantom;
use super::rays::Open;
use crate::support::{built_once, succeeds, text};
use fastrand::Rng;
use kilwa_measure::interval::{Provisional, provisional, stretch};
use kilwa_pack::{Cut, NO_DIAMOND};
use std::path::{Path, PathBuf};

#[test]
fn a_provisional_interval_contains_the_final_value() {
    let mut random = Rng::with_seed(21);
    let (mut picks, mut outside, mut one, mut missed) = (0usize, 0usize, 0usize, 0usize);
    // Closed solids have a far side: two stretches at least. A sheet has one where the ray does not graze it.
    let solids = [("stepped-wall", "origin"), ("sphere", "utm"), ("bent-wall", "far")].map(|(s, p)| phantom(s, p).pack);
    for pack in solids.into_iter().chain([sheet()]) {
        let open = Open::of(&pack);
        let entries = open.reader.entries();
        let step = open.reader.header().lattice.step();
        let errors: Vec<f64> =
            entries.iter().map(|e| f64::from(e.error)).filter(|e| e.is_finite() && *e > 0.0).collect();
        let largest = errors.iter().copied().fold(0.0, f64::max);
        for round in 0..10 {
            // From the coarsest picture to nearly the finest one.
            let cut = Cut::for_error(entries, largest * 0.5f64.powi(round));
            let mut coarse = Vec::new();
            for i in cut.refined() {
                let chunk = &open.chunks[i as usize];
                for p in cut.drawn(&chunk.patches) {
                    let error =
                        if p.diamond == NO_DIAMOND { 0.0 } else { f64::from(entries[p.diamond as usize].error) };
                    for t in p.first..p.first + p.count {
                        coarse.push((chunk.mesh.corners(t as usize).map(glam::IVec3::as_dvec3), error / step));
                    }
                }
            }
            for _ in 0..250 {
                let ray = open.random_ray(&mut random);
                let found = provisional(coarse.iter().filter_map(|(t, e)| stretch(&ray, *t, *e)));
                picks += 1;
                let Some(last) = open.pick(ray, Vec::new()) else { continue };
                match found {
                    Provisional::Nothing => missed += 1,
                    Provisional::Between { from, to } => {
                        one += 1;
                        outside += usize::from(last.t < from || last.t > to);
                    }
                    Provisional::Several(all) => {
                        outside += usize::from(!all.iter().any(|(from, to)| (*from..=*to).contains(&last.t)));
                    }
                }
            }
        }
    }
    check_none("provisional intervals that do not contain the final value", picks, outside + missed);
    println!("trust | of these, intervals that are one stretch | any | {one}");
    assert!(one > 500, "{one}");
}

/// A wall of one sheet.
fn sheet() -> PathBuf {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("trust");
    let write = |to: &Path| drop(succeeds(&["synth", "wall", "--triangles", "6000", "-o", text(to), "--force"]));
    built_once(&folder, "sheet", write, &[])
}
