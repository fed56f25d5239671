//! Masks of whole surveys: made, applied, turned off, removed, damaged.

use crate::support::{Site, ptx_header};
use glam::DVec3;
use kilwa_scan::ScanError;
use kilwa_scan::import::Silent;
use kilwa_scan::mask::{self, MaskReader, Numbering, Recipe, Request, make};
use kilwa_scan::mesh::{MeshVertex, Options, Surface, mesh};
use kilwa_scan::read::ReadOptions;
use kilwa_scan::survey::Survey;
use kilwa_scan_core::Sample;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

const COLUMNS: u32 = 240;
const ROWS: u32 = 90;
/// Half the room.
const HALF: [f64; 3] = [4.0, 4.0, 1.5];
/// A ball that stands in the room while some stations are scanned.
const BALL: ([f64; 3], f64) = ([0.5, 0.3, 0.0], 0.4);

/// A scan of a room from this place, with or without the ball.
fn room(at: [f64; 3], has_ball: bool) -> String {
    let mut text = ptx_header(COLUMNS, ROWS, at);
    let at = DVec3::from_array(at);
    for column in 0..COLUMNS {
        for row in 0..ROWS {
            let (azimuth, elevation) =
                (f64::from(column) * std::f64::consts::TAU / f64::from(COLUMNS), (f64::from(row) - 44.5) * 0.025);
            let d = DVec3::new(elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin());
            let wall = |k: usize| (HALF[k] * d[k].signum() - at[k]) / d[k];
            let mut range = (0..3).map(wall).fold(f64::INFINITY, f64::min);
            let (middle, radius) = (DVec3::from_array(BALL.0) - at, BALL.1);
            let (along, far) = (middle.dot(d), middle.length_squared());
            let under = radius * radius - far + along * along;
            if has_ball && along > 0.0 && under > 0.0 {
                range = range.min(along - under.sqrt());
            }
            let p = d * range;
            writeln!(text, "{:.6} {:.6} {:.6} {:.3}", p.x, p.y, p.z, f64::from(row) / f64::from(ROWS)).unwrap();
        }
    }
    text
}

/// Four stations of the room; only the first saw the ball.
fn survey() -> Site {
    let site = Site::new();
    let places = [[-2.0, 0.3, 0.1], [2.5, -2.0, -0.2], [0.0, 3.0, 0.2], [-1.0, -3.0, 0.0]];
    let files: Vec<PathBuf> =
        places.iter().enumerate().map(|(k, at)| site.write(&format!("s{k}.ptx"), room(*at, k == 0))).collect();
    site.import(&files, ReadOptions::default()).unwrap();
    site
}

fn request(name: &str, recipe: Recipe, stations: &[&str]) -> Request {
    Request { name: name.to_owned(), recipe, stations: stations.iter().map(|s| (*s).to_owned()).collect() }
}

fn made(site: &Site, name: &str, recipe: Recipe, stations: &[&str]) -> Vec<u64> {
    let report = make(&site.survey(), &request(name, recipe, stations), &Silent).unwrap();
    report.stations.iter().map(|made| made.masked).collect()
}

/// What is read of a station, as bits.
fn read(site: &Site, station: &str, unmasked: bool) -> Vec<([u32; 4], u8)> {
    samples(site, station, unmasked).iter().map(bits).collect()
}

fn bits(sample: &Sample) -> ([u32; 4], u8) {
    let [x, y, z] = sample.position.to_array();
    ([x, y, z, sample.intensity].map(f32::to_bits), sample.state.to_byte())
}

fn samples(site: &Site, station: &str, unmasked: bool) -> Vec<Sample> {
    let survey = Survey::open(&site.survey()).unwrap();
    let mut reader = mask::open(&site.survey(), survey.station(station).unwrap(), unmasked).unwrap();
    let (cells, mut out) = (reader.header().grid.cells(), Vec::new());
    reader.read(0, cells as usize, &mut out).unwrap();
    out
}

fn mask_files(site: &Site) -> BTreeSet<String> {
    let entries = std::fs::read_dir(site.survey().join("stations")).unwrap();
    let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.filter(|name| Path::new(name).extension().is_some_and(|end| end == "mask")).collect()
}

#[test]
fn masks_turned_off_or_removed_give_back_exactly_the_same_samples() {
    let site = survey();
    let scan = std::fs::read(site.survey().join("stations/s0.scan")).unwrap();
    let whole = read(&site, "s0", false);
    let low = Recipe::Intensity([0.2, 2.0]);
    assert_eq!(made(&site, "low", low, &["s0", "s1"]), [18 * 240, 18 * 240]);
    let inside = Recipe::Inside([DVec3::new(-5.0, -5.0, -2.0), DVec3::new(-3.0, 5.0, 2.0)]);
    let walls = made(&site, "wall", inside, &[]);
    assert!(walls.iter().all(|masked| *masked > 100), "{walls:?}");
    let masked = read(&site, "s0", false);
    let left = samples(&site, "s0", false);
    for (before, after) in samples(&site, "s0", true).iter().zip(&left) {
        let place = before.position.as_dvec3() + DVec3::new(-2.0, 0.3, 0.1);
        let is_masked = before.intensity < 0.2 || place.x <= -3.0;
        assert_eq!(bits(after), bits(if is_masked { &Sample::EMPTY } else { before }));
    }
    // Off, on, off at one station, removed.
    let both = |name: &str, is_on| mask::switch(&site.survey(), name, &[], is_on).unwrap();
    assert_eq!(both("wall", false).len(), 4);
    both("low", false);
    assert_eq!(read(&site, "s0", false), whole);
    both("wall", true);
    assert_eq!(mask::switch(&site.survey(), "low", &["s0".to_owned()], true).unwrap(), ["s0"]);
    assert_eq!(read(&site, "s0", false), masked);
    assert_eq!(read(&site, "s0", true), whole);
    assert_eq!(mask_files(&site).len(), 6);
    assert_eq!(mask::remove(&site.survey(), "wall", &[]).unwrap().len(), 4);
    mask::remove(&site.survey(), "low", &[]).unwrap();
    assert_eq!(read(&site, "s0", false), whole);
    assert!(mask_files(&site).is_empty());
    assert!(!std::fs::read_to_string(site.survey().join("survey.toml")).unwrap().contains("mask"));
    assert!(std::fs::read(site.survey().join("stations/s0.scan")).unwrap() == scan, "a scan never changes");
}

#[test]
fn a_mask_made_again_replaces_the_one_before_and_the_same_one_is_not_made_twice() {
    let site = survey();
    made(&site, "low", Recipe::Intensity([0.2, 2.0]), &[]);
    let first = mask_files(&site);
    let about = |name: &str| std::fs::metadata(site.survey().join("stations").join(name)).unwrap().modified().unwrap();
    let times: Vec<_> = first.iter().map(|name| about(name)).collect();
    made(&site, "low", Recipe::Intensity([0.2, 2.0]), &[]);
    assert_eq!((mask_files(&site), first.iter().map(|name| about(name)).collect::<Vec<_>>()), (first.clone(), times));
    let toml = site.survey().join("survey.toml");
    let text = std::fs::read_to_string(&toml).unwrap();
    assert!(
        text.contains("[[station.mask]]\nname = \"low\"") && text.contains("made = \"--intensity=0.2,2\""),
        "{text}"
    );
    std::fs::write(&toml, text.replacen("on = true", "on = false # for the report", 1)).unwrap();
    made(&site, "low", Recipe::Intensity([0.5, 2.0]), &["s1"]);
    let second = mask_files(&site);
    assert_eq!((second.len(), second.intersection(&first).count()), (4, 3));
    let text = std::fs::read_to_string(&toml).unwrap();
    assert!(text.contains("on = false # for the report") && text.contains("--intensity=0.5,2"), "{text}");
}

/// Keeps the vertices of a mesh that triangles use.
#[derive(Default)]
struct Kept(Vec<DVec3>, usize);

impl Surface for Kept {
    fn vertex(&mut self, vertex: &MeshVertex) -> Result<u32, ScanError> {
        self.0.push(vertex.position);
        Ok(self.0.len() as u32 - 1)
    }

    fn triangle(&mut self, corners: [u32; 3]) -> Result<(), ScanError> {
        assert!(corners.iter().all(|k| (*k as usize) < self.0.len()));
        self.1 += 1;
        Ok(())
    }
}

#[test]
fn exports_drop_exactly_what_is_masked_and_no_triangle_uses_it() {
    let site = survey();
    let before = samples(&site, "s0", true);
    // Scattered over the grid: every seventh cell.
    let list = (0..before.len()).step_by(7).map(|k| k.to_string()).collect::<Vec<_>>().join("\n");
    let list = site.write("edit.txt", list);
    let points = Recipe::Points { list, column: None, numbering: None };
    assert_eq!(made(&site, "edit", points, &["s0"]), [before.len().div_ceil(7) as u64]);
    let survey = Survey::open(&site.survey()).unwrap();
    let station = survey.station("s0").unwrap();
    let mut text = Vec::new();
    let mut reader = mask::open(&site.survey(), station, false).unwrap();
    assert_eq!(mask::count(&mut reader).unwrap(), before.len().div_ceil(7) as u64);
    let wrong = |source| ScanError::Write { path: PathBuf::new(), source };
    kilwa_scan::export::ptx(&mut reader, station.pose.unwrap(), None, &mut text, &wrong, &mut |_, _| Ok(())).unwrap();
    for (k, line) in String::from_utf8(text).unwrap().lines().skip(10).enumerate() {
        assert_eq!(line == "0 0 0 0.5", k % 7 == 0, "{k}: {line}");
    }
    let mut kept = Kept::default();
    let options = Options {
        tessellate: kilwa_scan_core::tessellate::Options { max_edge: 1.0, ..Default::default() },
        ..Default::default()
    };
    mesh(&mut reader, station.pose.unwrap(), &options, &mut kept).unwrap();
    let key = |p: DVec3| p.to_array().map(|v| (v * 1e6).round() as i64);
    let pose = station.pose.unwrap();
    let masked: BTreeSet<_> = before.iter().step_by(7).map(|s| key(pose.apply(s.position.as_dvec3()))).collect();
    assert!(kept.1 > 5000 && kept.0.iter().all(|p| !masked.contains(&key(*p))), "{} triangles", kept.1);
}

#[test]
fn indices_count_cells_or_points_and_a_list_that_does_not_fit_is_refused_with_its_line() {
    let site = Site::new();
    let file =
        site.write("a.ptx", format!("{}0 0 0 0.5\n1 0 0 0.5\n0 0 0 0.5\n2 0 0 0.5\n", ptx_header(2, 2, [0.0; 3])));
    site.import(&[file], ReadOptions::default()).unwrap();
    let list = site.write("edit.txt", "1\n");
    let points = |numbering| Recipe::Points { list: list.clone(), column: None, numbering };
    let masked = |numbering| {
        made(&site, "edit", points(numbering), &["a"]);
        let all = samples(&site, "a", false);
        all.iter().map(Sample::is_measured).collect::<Vec<_>>()
    };
    assert_eq!(masked(None), [false, false, false, true]);
    assert_eq!(masked(Some(Numbering::Cells)), [false, false, false, true]);
    assert_eq!(masked(Some(Numbering::Points)), [false, true, false, false]);
    let list = site.write("long.txt", "# mine\n1\n7\n");
    let points = Recipe::Points { list, column: None, numbering: None };
    let message = make(&site.survey(), &request("edit", points, &["a"]), &Silent).unwrap_err().to_string();
    for part in ["long.txt", "line 3", "index 7", "station a has 4 cells", "--numbering"] {
        assert!(message.contains(part), "{part}: {message}");
    }
    assert_eq!(samples(&site, "a", false).iter().filter(|s| s.is_measured()).count(), 1, "the mask from before stays");
}

#[test]
fn what_two_others_see_through_is_masked_and_walls_are_not() {
    let site = survey();
    let through = || Recipe::SeenThrough { witnesses: 2, margin: 0.1 };
    let masked = made(&site, "seen-through", through(), &[]);
    assert_eq!(masked[1..], [0, 0, 0]);
    let (before, after) = (samples(&site, "s0", true), samples(&site, "s0", false));
    let (mut on_ball, mut found) = (0, 0);
    for (before, after) in before.iter().zip(&after) {
        let place = before.position.as_dvec3() + DVec3::new(-2.0, 0.3, 0.1);
        let is_ball = place.distance(DVec3::from_array(BALL.0)) < BALL.1 + 0.01;
        on_ball += u32::from(is_ball);
        found += u32::from(is_ball && !after.is_measured());
        assert!(is_ball || after.is_measured(), "a wall at {place}");
    }
    assert!(on_ball > 50 && found * 10 > on_ball * 9, "{found} of {on_ball}");
    // With other poses it is out of date, and says so.
    let toml = site.survey().join("survey.toml");
    let survey = Survey::open(&site.survey()).unwrap();
    let station = survey.station("s0").unwrap();
    assert!(!mask::is_outdated(&station.masks[0], station, &survey));
    let text = std::fs::read_to_string(&toml).unwrap();
    std::fs::write(&toml, text.replacen("translation = [0.0, 3.0", "translation = [0.0, 3.1", 1)).unwrap();
    let survey = Survey::open(&site.survey()).unwrap();
    let station = survey.station("s0").unwrap();
    assert!(mask::is_outdated(&station.masks[0], station, &survey));
}

#[test]
fn stations_that_cannot_have_a_mask_are_named_with_what_to_do() {
    let site = survey();
    let toml = site.survey().join("survey.toml");
    let text = std::fs::read_to_string(&toml).unwrap();
    let is_of_pose = |line: &&str| line.starts_with("rotation") || line.starts_with("translation");
    let without: Vec<&str> = text.lines().filter(|line| !is_of_pose(line)).collect();
    let refused = |recipe: Recipe, stations: &[&str]| {
        make(&site.survey(), &request("m", recipe, stations), &Silent).unwrap_err().to_string()
    };
    let through = || Recipe::SeenThrough { witnesses: 2, margin: 0.1 };
    std::fs::write(&toml, without.join("\n")).unwrap();
    let message = refused(through(), &[]);
    assert!(message.contains("station s0 has no pose") && message.contains("--station"), "{message}");
    let message = refused(Recipe::Inside([DVec3::ZERO, DVec3::ONE]), &["s2"]);
    assert!(message.contains("station s2 has no pose"), "{message}");
    std::fs::write(&toml, &text).unwrap();
    let message = refused(Recipe::SeenThrough { witnesses: 4, margin: 0.1 }, &[]);
    assert!(message.contains("4 other stations"), "{message}");
    let list = site.write("edit.txt", "1\n");
    let message = refused(Recipe::Points { list, column: None, numbering: None }, &[]);
    assert!(message.contains("--station"), "{message}");
    let message = make(&site.survey(), &request("a/b", through(), &[]), &Silent).unwrap_err().to_string();
    assert!(message.contains("\"a/b\""), "{message}");
    let message = mask::switch(&site.survey(), "mixde", &[], true).unwrap_err().to_string();
    assert!(message.contains("no station has a mask mixde") && message.contains("--list"), "{message}");
    let file = site.write("cloud.xyz", "1 2 3\n4 5 6\n");
    site.import(&[file], crate::support::seen_from(0.0, 0.0, 0.0)).unwrap();
    for recipe in [Recipe::Grazing { limit: 85.0 }, Recipe::Isolated { min: 10 }] {
        let message = refused(recipe, &["cloud"]);
        assert!(message.contains("station cloud is an unstructured point cloud"), "{message}");
    }
    let message = refused(Recipe::Intensity([0.0, 1.0]), &["cloud"]);
    assert!(message.contains("station cloud has no intensity"), "{message}");
    assert_eq!(made(&site, "box", Recipe::Outside([DVec3::ZERO, DVec3::splat(3.5)]), &["cloud"]), [1]);
}

#[test]
fn a_damaged_or_missing_mask_is_refused_with_its_name_and_what_to_do() {
    let site = survey();
    made(&site, "low", Recipe::Intensity([0.2, 2.0]), &["s0"]);
    let survey = Survey::open(&site.survey()).unwrap();
    let station = survey.station("s0").unwrap();
    let path = site.survey().join(&station.masks[0].file);
    let bytes = std::fs::read(&path).unwrap();
    let read = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let mut reader = mask::open(&site.survey(), station, false)?;
        reader.read(0, u64::from(COLUMNS * ROWS) as usize, &mut Vec::new())
    };
    let is_explained = |message: &str| message.contains("s0.low.") && message.contains("--off low");
    read(&bytes).unwrap();
    for at in (0..bytes.len()).step_by(37).chain(0..128).chain(bytes.len() - 8..bytes.len()) {
        let mut flipped = bytes.clone();
        flipped[at] ^= 16;
        let message = read(&flipped).unwrap_err().to_string();
        assert!(is_explained(&message), "byte {at}: {message}");
    }
    for length in [0, 100, 128, bytes.len() - 1] {
        let message = read(&bytes[..length]).unwrap_err().to_string();
        assert!(is_explained(&message), "{message}");
    }
    // The same mask made again is not taken for whole.
    assert_eq!(made(&site, "low", Recipe::Intensity([0.2, 2.0]), &["s0"]), [18 * 240]);
    assert!(std::fs::read(&path).unwrap() == bytes);
    let other = survey.station("s1").unwrap();
    let mut reader = kilwa_scan::spool::Reader::open(&site.survey().join(&other.scan)).unwrap();
    let mask = MaskReader::open(&path, "low").unwrap();
    let message = reader.set_masks(vec![mask]).unwrap_err().to_string();
    assert!(is_explained(&message) && message.contains("another scan"), "{message}");
    std::fs::remove_file(&path).unwrap();
    let message = mask::open(&site.survey(), station, false).unwrap_err().to_string();
    assert!(is_explained(&message) && message.contains("cannot be opened"), "{message}");
    mask::open(&site.survey(), station, true).unwrap();
    mask::switch(&site.survey(), "low", &[], false).unwrap();
    assert_eq!(read_all(&site), u64::from(COLUMNS * ROWS));
}

fn read_all(site: &Site) -> u64 {
    samples(site, "s0", false).iter().filter(|s| s.is_measured()).count() as u64
}
