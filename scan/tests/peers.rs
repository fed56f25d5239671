//! Other readers find the same points: pye57 and laspy, where Python has them (`KILWA_SCAN_PYTHON` names another Python).

use crate::support::{Site, seen_from, shared};
use kilwa_scan::read::ReadOptions;
use std::path::Path;
use std::process::Command;

pub(crate) fn python() -> Command {
    Command::new(std::env::var_os("KILWA_SCAN_PYTHON").unwrap_or_else(|| "python3".into()))
}

/// Whether Python can import a module; says by name what is skipped.
pub(crate) fn has(module: &str) -> bool {
    let is_there = python().args(["-c", &format!("import numpy, {module}")]).output().is_ok_and(|o| o.status.success());
    if !is_there {
        eprintln!("skipped: Python has no {module}");
    }
    is_there
}

fn compare(kind: &str, file: &Path, spool: &Path, scan: u64) -> String {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/peers.py");
    let output = python().arg(script).arg(kind).arg(file).arg(spool).arg(scan.to_string()).output().unwrap();
    assert!(output.status.success(), "{}: {}", file.display(), String::from_utf8_lossy(&output.stderr));
    String::from_utf8_lossy(&output.stdout).trim().to_owned()
}

#[test]
fn pye57_finds_the_same_points_in_every_e57() {
    if !has("pye57") {
        return;
    }
    let Some(folders) = shared("scan-data/e57").zip(shared("data/cry-inc+e57/testdata")) else { return };
    let mut compared = 0;
    for folder in [folders.0, folders.1] {
        for entry in std::fs::read_dir(folder).unwrap() {
            let file = entry.unwrap().path();
            let site = Site::new();
            // Damaged on purpose, or without points.
            let Ok(report) = site.import(std::slice::from_ref(&file), seen_from(0.0, 0.0, 0.0)) else { continue };
            for station in &report.stations {
                let source = &station.station.source;
                let spool = site.survey().join(&station.station.scan);
                println!("{}: {}", source.file, compare("e57", &file, &spool, source.number - 1));
                compared += 1;
            }
        }
    }
    assert!(compared >= 6, "{compared}");
}

/// What is exported is what another reader finds in the file, masks applied.
#[test]
fn pye57_finds_the_same_points_in_an_exported_e57() {
    if !has("pye57") {
        return;
    }
    let site = crate::export::survey();
    let (_, file) = crate::export::export(&site, &["nave", "porch", "yard"], false, "all.e57");
    let again = Site::new();
    let report = again.import(std::slice::from_ref(&file), ReadOptions::default()).unwrap();
    for (scan, station) in (0..).zip(&report.stations) {
        let spool = again.survey().join(&station.station.scan);
        println!("{}: {}", station.station.name, compare("e57", &file, &spool, scan));
    }
    // By its simple interface, with poses: as many points as were written.
    let script = "import pye57, sys\nf = pye57.E57(sys.argv[1])\nfor k in range(f.scan_count):\n  s = f.read_scan(k, ignore_missing_fields=True, row_column=k < 2)\n  print(len(s['cartesianX']), f.get_header(k).pretty_print() is None)";
    let output = python().args(["-c", script]).arg(&file).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let counts: Vec<u64> = String::from_utf8_lossy(&output.stdout)
        .lines()
        .map(|l| l.split(' ').next().unwrap().parse().unwrap())
        .collect();
    assert_eq!(counts, report.stations.iter().map(|s| s.header.statistics.measured).collect::<Vec<_>>());
}

#[test]
fn laspy_finds_the_same_points_in_las_and_laz() {
    if !has("laspy") {
        return;
    }
    for (name, full) in [("a.las", 1_u16), ("b.laz", 200)] {
        let site = Site::new();
        let mut builder = las::Builder::from((1, 2));
        builder.point_format = las::point::Format::new(2).unwrap();
        builder.point_format.is_compressed = name.ends_with("laz");
        let transform = las::Transform { scale: 0.0007, offset: 566_000.0 };
        builder.transforms = las::Vector { x: transform, y: transform, z: transform };
        let path = site.path(name);
        let mut writer = las::Writer::from_path(&path, builder.into_header().unwrap()).unwrap();
        let mut rng = fastrand::Rng::with_seed(4);
        for _ in 0..5000 {
            let mut number = || 566_000.0 + rng.f64() * 300.0;
            let (x, y, z) = (number(), number(), number());
            let mut color = || u16::from(rng.u8(..)) * full;
            let color = Some(las::Color { red: color(), green: color(), blue: color() });
            let (intensity, return_number) = (rng.u16(..), rng.u8(1..=5));
            let point =
                las::Point { x, y, z, intensity, return_number, number_of_returns: 5, color, ..las::Point::default() };
            writer.write_point(point).unwrap();
        }
        writer.close().unwrap();
        let report = site.import(std::slice::from_ref(&path), seen_from(566_100.5, 566_100.25, 566_001.0)).unwrap();
        let spool = site.survey().join(&report.stations[0].station.scan);
        println!("{name}: {}", compare("las", &path, &spool, 0));
    }
    for format in [6, 7, 8, 9, 10] {
        for name in ["a.las", "b.laz"] {
            let site = Site::new();
            let path = crate::las::written(&site, name, format, 60_000);
            compare_las(&site, &path, &format!("{name} {format}"));
        }
    }
}

/// LAZ of point formats 6 to 10, written by `lazrs` and by LASzip itself.
#[test]
fn laspy_reads_the_same_points_from_layered_laz_of_other_programs() {
    for (backend, module) in [("Lazrs", "lazrs"), ("Laszip", "laszip")] {
        if !has("laspy") || !has(module) {
            continue;
        }
        for format in [6, 7, 8, 9, 10] {
            let site = Site::new();
            let plain = crate::las::written(&site, "a.las", format, 120_000);
            let path = site.path("b.laz");
            let script = format!(
                "import laspy, sys\nlaspy.read(sys.argv[1]).write(sys.argv[2], laz_backend=laspy.LazBackend.{backend})"
            );
            let output = python().args(["-c", &script]).args([&plain, &path]).output().unwrap();
            assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
            compare_las(&site, &path, &format!("{backend} {format}"));
        }
    }
}

fn compare_las(site: &Site, path: &Path, name: &str) {
    let report = site.import(&[path.to_owned()], seen_from(566_040.0, 566_040.0, 566_001.5)).unwrap();
    let spool = site.survey().join(&report.stations[0].station.scan);
    println!("{name}: {}", compare("las", path, &spool, 0));
}
