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

/// What is imported with `--keep-incomplete`: measured points of every station, and diagnostics.
fn kept(name: &str, text: &str) -> (Vec<u64>, Vec<(&'static str, u64)>) {
    let site = Site::new();
    let file = site.write(name, text);
    let report = site.import(&[file], ReadOptions { keep_incomplete: true, ..seen_from(0.0, 0.0, 0.0) }).unwrap();
    let points = report.stations.iter().map(|s| s.header.statistics.measured).collect();
    (points, report.diagnostics[0].1.iter().map(|(kind, count, _)| (kind, count)).collect())
}

#[test]
fn a_line_that_is_cut_by_the_end_of_the_file_is_dropped_and_counted_or_reported() {
    let points = "1 2 3 0.5 9 9 9\n".repeat(3);
    let header = ptx_header(2, 4, [0.0; 3]);
    let cut = "points in whose line the file ends dropped";
    for rest in
        ["1.234 5.6", "1", "12.345 6.789 1.2 0.5", "12.345 6.789 1.2 0.5 2", "12.345 6.789 1.2 0.5 2 3 1", "1.2."]
    {
        let ptx = format!("{header}{points}{rest}");
        let (found, diagnostics) = kept("a.ptx", &ptx);
        assert_eq!(found, [3], "{rest}");
        assert!(diagnostics.contains(&(cut, 1)), "{rest}: {diagnostics:?}");
        let message = refusal("a.ptx", &ptx);
        assert!(
            message.contains("the file ends in the middle of a line") && message.contains("2 × 4 = 8"),
            "{message}"
        );

        let pts = format!("8\n{points}{rest}");
        let (found, diagnostics) = kept("a.pts", &pts);
        assert_eq!(found, [3], "{rest}");
        assert!(diagnostics.contains(&(cut, 1)), "{rest}: {diagnostics:?}");
        let site = Site::new();
        let file = site.write("a.pts", &pts);
        let message = site.import(&[file], seen_from(0.0, 0.0, 0.0)).unwrap_err().to_string();
        assert!(message.contains("the file ends in the middle of a line") && message.contains("8, as"), "{message}");
    }
    // Without an announced number, a last line without its line feed is a point if it looks like one.
    assert_eq!(kept("a.xyz", "1 2 3\n4 5 6.").0, [2]);
    assert_eq!(kept("a.xyz", "1 2 3\n4 5 6\n7 8").0, [2]);
    // A complete file that lacks only its last line feed.
    let whole = format!("{}{}", ptx_header(1, 4, [0.0; 3]), POINTS.trim_end());
    assert_eq!(kept("a.ptx", &whole), (vec![4], Vec::new()));
    assert_eq!(kept("a.pts", "2\n1 2 3 4\n1 2 3 5"), (vec![2], Vec::new()));
}

#[test]
fn a_ptx_that_ends_in_the_header_of_a_later_scan_keeps_the_scans_before_on_request() {
    let scan = format!("{}{POINTS}", ptx_header(2, 2, [0.0; 3]));
    let next = ptx_header(900, 70, [0.0; 3]);
    for length in [1, 3, 4, 6, 20, next.len() - 3] {
        let text = format!("{scan}{}", &next[..length]);
        assert_eq!(kept("a.ptx", &text), (vec![4], vec![("scans whose header is truncated left out", 1)]), "{length}");
        let site = Site::new();
        let file = site.write("a.ptx", text);
        assert!(site.import(&[file], ReadOptions::default()).is_err());
    }
    assert_eq!(kept("a.ptx", &format!("{scan}{next}")).0, [4]);
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
        ("a.xyz", "# nothing\n1 2 3 4 5\n", "line 2: found 5 numbers"),
        ("a.xyz", "1 2 3\n1 2 3 4\n", "line 2: found 4 numbers; expected 3"),
        ("a.xyz", "x y z\n1,23 4,56 7,89\n", "line 2: found numbers with decimal commas; expected decimal points"),
        ("a.xyz", "1,234 5,678 9,012\n", "line 1: found numbers with decimal commas"),
        ("a.xyz", "1,23;4,56;7,89;255;0;0\n", "line 1: found numbers with decimal commas"),
        ("a.pts", "1\n1,23 4,56 7,89 12\n", "line 2: found numbers with decimal commas"),
        ("a.xyz", "1 2 3 0.5 1000 0.7 2\n", "line 1: found seven columns without colours"),
        ("a.pts", "2\n1 2 3 4\n1 2 3 5\n1 2 3 6\n", "line 4: found \"1 2 3 6\"; expected the number of points"),
    ] {
        let site = Site::new();
        let file = site.write(name, text);
        let message = site.import(&[file], seen_from(0.0, 0.0, 0.0)).unwrap_err().to_string();
        assert!(message.contains(part), "{part}: {message}");
    }
}

#[test]
fn a_fraction_among_colours_is_refused_far_behind_the_lines_that_decide() {
    let site = Site::new();
    let file = site.write("a.xyz", format!("{}1 2 3 0.6 0.8 0\n", "1 2 3 10 20 30\n".repeat(20_000)));
    let message = site.import(&[file], seen_from(0.0, 0.0, 0.0)).unwrap_err().to_string();
    assert!(message.contains("line 20001") && message.contains("name the columns"), "{message}");
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
