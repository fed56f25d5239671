//! Real files, where the folders beside the project are there.

use crate::support::{Site, seen_from, shared};
use kilwa_scan::panorama::{Show, render};
use kilwa_scan::read::ReadOptions;
use kilwa_scan::spool::Reader;
use std::path::PathBuf;

fn files(folder: &std::path::Path, extension: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    let mut files: Vec<PathBuf> = entries.filter(|p| p.extension().is_some_and(|e| e == extension)).collect();
    files.sort();
    files
}

#[test]
fn the_ten_range_grids_of_the_bunny_are_imported_with_every_vertex_in_its_cell() {
    let Some(folder) = shared("scan-data") else { return };
    let site = Site::new();
    let files = files(&folder.join("bunny"), "ply");
    let report = site.import(&files, ReadOptions::default()).unwrap();
    let first = report.stations.iter().find(|s| s.station.name == "bun000").unwrap().header;
    assert_eq!((first.grid.columns, first.grid.rows, first.statistics.measured), (512, 400, 40_256));
    assert!(
        report.diagnostics.iter().all(|(_, d)| d.count("vertices that no cell of the grid refers to dropped") == 0)
    );
    let mut reader = Reader::open(&site.survey().join("stations/bun000.scan")).unwrap();
    let picture = render(&mut reader, Show::Range, 400).unwrap();
    assert_eq!((picture.width, picture.height), (256, 200));
}

#[test]
fn every_e57_is_imported_or_refused_with_its_place() {
    let Some(folder) = shared("scan-data/e57").zip(shared("data/cry-inc+e57/testdata")) else { return };
    let (mut read, mut refused) = (Vec::new(), Vec::new());
    for file in files(&folder.0, "e57").into_iter().chain(files(&folder.1, "e57")) {
        let name = file.file_name().unwrap().to_string_lossy().into_owned();
        let site = Site::new();
        match site.import(&[file], seen_from(0.0, 0.0, 0.0)) {
            Ok(report) => {
                let points: u64 = report.stations.iter().map(|s| s.header.statistics.measured).sum();
                read.push((name, points, report.photographs));
            }
            Err(e) => refused.push((name, e.to_string())),
        }
    }
    println!("{read:?}\n{refused:#?}");
    let points = |name: &str| read.iter().find(|r| r.0 == name).map(|r| (r.1, r.2));
    assert_eq!(points("bunnyInt19.e57"), Some((30_571, 0)));
    assert_eq!(points("bunnyInt21.e57"), Some((30_571, 0)));
    assert_eq!(points("ColouredCubeFloat.e57"), Some((7_680, 0)));
    let why = |name: &str| refused.iter().find(|r| r.0 == name).map_or("", |r| r.1.as_str());
    assert!(why("bad-crc.e57").contains("byte 0") && why("bad-crc.e57").contains("checksum"), "{}", why("bad-crc.e57"));
    assert!(why("corrupt_crc.e57").contains("checksum"), "{}", why("corrupt_crc.e57"));
}

#[test]
fn the_ptx_whose_header_lies_is_refused_and_kept_on_request() {
    let Some(folder) = shared("data/visgl+loaders.gl/cpp/Model3DTiler/test/resources") else { return };
    let site = Site::new();
    let ptx = [folder.join("ripple.ptx")];
    let message = site.import(&ptx, ReadOptions::default()).unwrap_err().to_string();
    assert!(message.contains("10201 points of scan 1") && message.contains("4444 × 10014"), "{message}");
    let report = site.import(&ptx, ReadOptions { keep_incomplete: true, ..ReadOptions::default() }).unwrap();
    assert_eq!(report.stations[0].header.statistics.measured, 10_201);
    let report = site.import(&[folder.join("ripple.pts")], seen_from(0.0, 0.0, 10.0)).unwrap();
    assert_eq!(report.stations[0].header.statistics.measured, 10_201);
}
