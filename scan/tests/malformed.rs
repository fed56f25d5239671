//! Files that are wrong: a sentence with the place, never a crash, and nothing under a final name.

use crate::support::{Site, ptx_header, seen_from};
use kilwa_scan::read::ReadOptions;
use kilwa_scan::survey::Survey;

const POINTS: &str = "1 2 3 0.5\n1 2 4 0.5\n1 2 5 0.5\n1 2 6 0.5\n";

fn refusal(name: &str, text: &str) -> String {
    let site = Site::new();
    let file = site.write(name, text);
    let message = site.import(&[file], ReadOptions::default()).unwrap_err().to_string();
    let stations = site.survey().join("stations");
    let left = std::fs::read_dir(stations).into_iter().flatten().count();
    assert_eq!(left, 0, "nothing is left of a scan that was refused: {message}");
    message
}

#[test]
fn a_ptx_whose_header_lies_is_refused_with_line_and_counts_or_kept_on_request() {
    let header = |c, r| ptx_header(c, r, [0.0; 3]);
    for (text, parts) in [
        (format!("{}{POINTS}", header(4, 2)), ["line 14", "4 points of scan 1", "4 × 2 = 8"]),
        (format!("{}{POINTS}", header(1000, 1_000_000)), ["line 14", "1000 × 1000000", "--keep-incomplete"]),
        (
            format!("{}{POINTS}1 2 7 0.5\n", header(2, 2)),
            ["line 15", "1 2 7 0.5", "more points than its header states"],
        ),
        (format!("{}{POINTS}{}", header(3, 2), header(1, 1)), ["line 15", "4 points of scan 1", "3 × 2"]),
        (format!("{}1 2 3\n", header(1, 1)), ["line 11", "1 2 3", "x y z intensity"]),
        (format!("{}1 2 x 0.5\n", header(1, 1)), ["line 11", "1 2 x", "point 1 of scan 1"]),
        (format!("{}500000 9000000 0 0.5\n", header(1, 1)), ["line 11", "9014 km", "--station X,Y,Z"]),
        ("0\n2\n0 0 0\n".to_owned(), ["line 2", "0 columns and 2 rows", "from 1 to"]),
        ("2\n2\n0 0 0\n1 0 0\n".to_owned(), ["a.ptx", "the end of the file", "the file is truncated"]),
        (header(2, 2).replace("1 0 0 0\n", "2 0 0 0\n"), ["a matrix that scales", "line 10", "rotation"]),
        (header(2, 2).replace("0 0 1 0\n", "0 0 -1 0\n"), ["a matrix that mirrors", "line 10", "rotation"]),
    ] {
        let message = refusal("a.ptx", &text);
        for part in parts {
            assert!(message.contains(part), "{part}: {message}");
        }
    }
    let site = Site::new();
    let file = site.write("a.ptx", format!("{}{POINTS}1 1 1 1\n{}{POINTS}", header(900, 2), header(2, 2)));
    let report = site.import(&[file], ReadOptions { keep_incomplete: true, ..ReadOptions::default() }).unwrap();
    let grids: Vec<_> = report.stations.iter().map(|s| (s.header.grid.columns, s.header.statistics.measured)).collect();
    assert_eq!(grids, [(3, 5), (2, 4)]);
    assert_eq!(report.diagnostics[0].1.count("scans with fewer points than their header announces"), 1);
}

#[test]
fn other_files_are_refused_by_name_and_before_anything_is_made() {
    for (name, text, part) in [
        ("a.fls", "xx", "a FARO scan or project"),
        ("a.obj", "v 0 0 0", "kilwa build"),
        ("a.e57", "something", "named as a scan"),
        ("a.ptx", "", "empty (0 bytes)"),
        ("a.dat", "hello world", "in an unknown format"),
    ] {
        let site = Site::new();
        let file = site.write(name, text);
        let message = site.import(&[file], ReadOptions::default()).unwrap_err().to_string();
        assert!(message.contains(part) && message.contains(name), "{message}");
        assert!(!site.survey().exists());
    }
}

#[test]
fn text_that_is_not_a_point_cloud_is_refused_with_its_line() {
    for (name, text, part) in [
        ("a.xyz", "1 2 3\n1 2\n", "line 2: found 2 numbers"),
        ("a.xyz", "1 2 3\n1 2 y\n", "line 2: found \"1 2 y\""),
        ("a.pts", "3\n1 2 3 4\n1 2 3 4\n", "line 3: found 2 points"),
        ("a.xyz", "# nothing\n1 2 3 4 5\n", "found 5 numbers"),
    ] {
        let site = Site::new();
        let file = site.write(name, text);
        let message = site.import(&[file], seen_from(0.0, 0.0, 0.0)).unwrap_err().to_string();
        assert!(message.contains(part), "{part}: {message}");
    }
}

/// Neither truncation nor damage crashes a reader or makes it hang; what is accepted is a survey that can be read.
#[test]
fn truncated_and_damaged_files_are_refused_or_read() {
    let mut rng = fastrand::Rng::with_seed(7);
    let ptx = format!("{}{POINTS}{}{POINTS}", ptx_header(2, 2, [1.0, 2.0, 3.0]), ptx_header(2, 2, [0.0; 3]));
    let mut seeds = vec![("a.ptx", ptx.into_bytes())];
    let site = Site::new();
    let path = site.path("seed.e57");
    {
        use e57::{E57Writer, Record, RecordValue};
        let mut writer = E57Writer::from_file(&path, "file").unwrap();
        let prototype = vec![Record::CARTESIAN_X_F32, Record::CARTESIAN_Y_F32, Record::CARTESIAN_Z_F32];
        let mut cloud = writer.add_pointcloud("cloud", prototype).unwrap();
        for k in 0..50_u8 {
            cloud.add_point(vec![RecordValue::Single(f32::from(k)); 3]).unwrap();
        }
        cloud.finalize().unwrap();
        writer.finalize().unwrap();
    }
    seeds.push(("a.e57", std::fs::read(&path).unwrap()));
    let folder = Site::new();
    for (name, bytes) in seeds {
        for round in 0..150 {
            let mut damaged = bytes.clone();
            if round % 2 == 0 {
                damaged.truncate(rng.usize(..bytes.len()));
            } else {
                for _ in 0..=rng.usize(..3) {
                    let at = rng.usize(..damaged.len());
                    damaged[at] ^= 1 << rng.u8(..8);
                }
            }
            let file = folder.write(name, &damaged);
            drop(std::fs::remove_dir_all(folder.survey()));
            match folder.import(&[file], seen_from(0.0, 0.0, 0.0)) {
                Ok(report) => {
                    assert_eq!(Survey::open(&folder.survey()).unwrap().stations.len(), report.stations.len());
                    for station in report.stations {
                        folder.samples(&station.station.name);
                    }
                }
                Err(e) => assert!(e.to_string().contains("a."), "{e}"),
            }
        }
    }
}
