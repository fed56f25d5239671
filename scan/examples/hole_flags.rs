//! `hole_flags SURVEY SEED STATIONS COLUMNS VOXEL PLACES LINES`: merges a survey that `kilwa synth scans` simulated (without walkers, grass and scaffolding) and compares the causes of its
//! holes with the simulator's ground truth. Prints a table; used by `cargo xtask bench merge --flags`.

#[path = "../tests/hole_truth.rs"]
mod hole_truth;

use hole_truth::Oracle;
use kilwa_scan::ScanError;
use kilwa_scan::import::Silent;
use kilwa_scan::merge::{Begin, Cause, Fill, MergedSurface, MergedVertex, Options, merge};
use kilwa_scan::survey::Survey;
use std::path::PathBuf;

/// Keeps where the surface is.
struct Kept {
    oracle: Oracle,
    begin: Option<Begin>,
}

impl MergedSurface for Kept {
    fn begin(&mut self, begin: &Begin) -> Result<(), ScanError> {
        self.begin = Some(*begin);
        Ok(())
    }

    fn vertex(&mut self, vertex: &MergedVertex) -> Result<(), ScanError> {
        self.oracle.merged(vertex.vertex.position);
        Ok(())
    }

    fn triangle(&mut self, _: [u64; 3]) -> Result<(), ScanError> {
        Ok(())
    }
}

fn main() {
    let mut args = std::env::args().skip(1);
    let mut next = || args.next().expect("SURVEY SEED STATIONS COLUMNS VOXEL PLACES LINES");
    let folder = PathBuf::from(next());
    let seed: u64 = next().parse().expect("a seed");
    let stations: u32 = next().parse().expect("a number of stations");
    let columns: u32 = next().parse().expect("a number of columns");
    let voxel: f64 = next().parse().expect("a voxel size");
    let places: usize = next().parse().expect("a number of places");
    let lines: u32 = next().parse().expect("a number of lines");
    let survey = Survey::open(&folder).expect("a survey");
    let options = Options {
        voxel: Some(voxel),
        memory: 1 << 30,
        threads: 2,
        scratch: std::env::temp_dir(),
        unmasked: false,
        bounds: None,
        fill: Fill::default(),
        intensity: kilwa_scan::merge::Intensity::Raw,
    };
    let mut surface = Kept { oracle: Oracle::new(seed, stations, columns, voxel), begin: None };
    let report = merge(&folder, &survey, &options, &|_| kilwa_scan::mesh::Options::default(), &mut surface, &Silent)
        .expect("a surface");
    let holes = &report.borders.holes;
    let mut compared = hole_truth::compare(holes, &surface.oracle, places);
    let bounds = surface.begin.expect("bounds").bounds;
    hole_truth::sample(&mut compared, holes, &surface.oracle, bounds, lines);
    println!("{} holes, {:.2} m²", holes.len(), holes.iter().map(|hole| hole.area).sum::<f64>());
    println!(
        "\n| flag | truly unseen m² | truly free m² | truly visible m² | between rays m² |\n|---|---:|---:|---:|---:|"
    );
    for (cause, [unseen, free, visible, between]) in Cause::ALL.iter().zip(compared.areas) {
        println!("| {} | {unseen:.2} | {free:.2} | {visible:.2} | {between:.2} |", cause.word());
    }
    let percent = |share: f64| 100.0 * share;
    println!(
        "\nunseen: precision {:.2} %, recall {:.2} %, recall by surface {:.2} % of {} samples ({} more are in no hole); free: precision {:.2} %, recall {:.2} %",
        percent(compared.precision(0)),
        percent(compared.recall(0)),
        percent(compared.surface_recall()),
        compared.hidden[0],
        compared.beyond,
        percent(compared.precision(1)),
        percent(compared.recall(1)),
    );
}
