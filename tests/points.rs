//! Packs of points: `kilwa build --points`, and what the other verbs do with them.

use crate::scans::box_scan;
use crate::support::{Ply, fails, json, kilwa, succeeds, text};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Survey and pack of the two stations of [`box_scan`].
fn built(folder: &Path, options: &[&str]) -> (PathBuf, serde_json::Value) {
    let (survey, pack) = (folder.join("survey"), folder.join("points.kilwa"));
    if !survey.exists() {
        succeeds(&["scans", "import", text(&box_scan(folder)), "-o", text(&survey)]);
    }
    let build = [&["build", text(&survey), "--points", "--force", "-o", text(&pack)], options].concat();
    let report = json(&build);
    (pack, report)
}

/// A pack of points of several levels.
pub(crate) fn pack_of_levels(folder: &Path) -> PathBuf {
    let (scans, survey, pack) = (folder.join("scans"), folder.join("survey-2"), folder.join("levels.kilwa"));
    succeeds(&["synth", "scans", "--stations", "1", "--columns", "180", "-o", text(&scans)]);
    succeeds(&["scans", "import", text(&scans), "-o", text(&survey)]);
    let report = json(&["build", text(&survey), "--points", "-o", text(&pack)]);
    assert!(report["pack"]["levels"].as_u64().unwrap() > 4, "{report}");
    pack
}

/// A small pack of points.
pub(crate) fn pack_of_points(folder: &Path) -> PathBuf {
    built(folder, &[]).0
}

/// How far a place is from the walls, floor and ceiling of the room of [`box_scan`], of the nearer of both stations' rooms.
fn off_the_walls([x, y, z]: [f64; 3]) -> f64 {
    let of_room = |x: f64| ((x.abs() - 3.0).abs()).min((y.abs() - 3.0).abs()).min((z.abs() - 1.5).abs());
    of_room(x).min(of_room(x - 0.5))
}

#[test]
fn every_point_of_a_survey_is_in_its_pack() {
    let folder = tempfile::tempdir().unwrap();
    let (pack, report) = built(folder.path(), &[]);
    let duplicates = report["findings"]
        .as_object()
        .unwrap()
        .iter()
        .find(|(kind, _)| kind.contains("same place"))
        .map_or(0, |(_, found)| found["count"].as_u64().unwrap());
    let points = report["points"].as_u64().unwrap();
    assert_eq!(points + duplicates, 4800, "{report}");
    succeeds(&["verify", text(&pack)]);

    let out = folder.path().join("points.ply");
    let extracted = json(&["extract", text(&pack), "-o", text(&out)]);
    assert_eq!((&extracted["vertices"], &extracted["triangles"]), (&points.into(), &0.into()));
    let refused = fails(&["extract", text(&pack), "--to", "tiles", "-o", text(&folder.path().join("tiles"))]);
    assert!(refused.contains("points without a surface") && refused.contains("kilwa merge"), "{refused}");
    let ply = Ply::read(&out);
    let step = report["step"].as_f64().unwrap();
    for v in 0..ply.vertices.len() as u32 {
        assert!(off_the_walls(ply.position(v)) <= 2.0 * step, "{:?}", ply.position(v));
        let normal = ["nx", "ny", "nz"].map(|name| ply.get(v, name).unwrap().abs());
        assert!(normal.iter().any(|n| *n > 0.5), "{normal:?}");
    }
    assert!(ply.properties.contains(&"intensity".to_owned()) && ply.properties.contains(&"red".to_owned()));
    // As points they can be imported again.
    let again = folder.path().join("again");
    let imported = succeeds(&["scans", "import", text(&out), "--station", "0,0,0", "-o", text(&again)]);
    assert!(imported.contains(&points.to_string()), "{imported}");
    // Other formats get the squares.
    let squares = json(&["extract", text(&pack), "-o", text(&folder.path().join("points.glb"))]);
    assert_eq!(squares["triangles"], 2 * points);
}

#[test]
fn the_bytes_of_a_pack_of_points_do_not_depend_on_threads_and_memory() {
    let folder = tempfile::tempdir().unwrap();
    let bytes = |options: &[&str]| std::fs::read(built(folder.path(), options).0).unwrap();
    let first = bytes(&["--threads", "1"]);
    assert!(first == bytes(&["--threads", "3"]) && first == bytes(&["--memory", "100M"]));
    let cropped = built(folder.path(), &["--crop=-9,-9,0,9,9,9"]).1;
    assert!(
        cropped["points"].as_u64().unwrap() <= 2400 && cropped["bounds_min"][2].as_f64().unwrap() > -0.5,
        "{cropped}"
    );
}

/// What the directory certifies of every cut holds for the points themselves.
#[test]
fn every_point_is_within_the_certified_error_of_a_coarser_form() {
    let folder = tempfile::tempdir().unwrap();
    let pack = pack_of_levels(folder.path());
    let points = |options: &[&str]| {
        let out = folder.path().join("cut.ply");
        let report = json(&[&["extract", text(&pack), "--force", "-o", text(&out)], options].concat());
        let ply = Ply::read(&out);
        let points: Vec<[f64; 3]> = (0..ply.vertices.len() as u32).map(|v| ply.position(v)).collect();
        (points, report["max_error"].as_f64().unwrap())
    };
    let (finest, _) = points(&[]);
    for limit in ["0.8", "2", "4"] {
        let (coarse, error) = points(&["--max-error", limit]);
        assert!(error > 0.0 && error <= limit.parse().unwrap() && coarse.len() < finest.len(), "{limit}: {error} m");
        for p in &finest {
            let away = |q: &[f64; 3]| (0..3).map(|k| (p[k] - q[k]).powi(2)).sum::<f64>();
            let nearest = coarse.iter().map(away).fold(f64::INFINITY, f64::min).sqrt();
            assert!(nearest <= error, "{p:?} is {nearest} m from a form within {error} m");
        }
    }
}

#[test]
fn points_are_measured_as_points() {
    let folder = tempfile::tempdir().unwrap();
    let pack = pack_of_points(folder.path());
    let out = folder.path().join("points.ply");
    succeeds(&["extract", text(&pack), "-o", text(&out)]);
    let ply = Ply::read(&out);
    let points: Vec<[f64; 3]> = (0..ply.vertices.len() as u32).map(|v| ply.position(v)).collect();
    // Beside the wall, and off the middle of every square.
    let asked = [2.93, 0.41, 0.23];
    let distance = |p: &[f64; 3]| (0..3).map(|k| (p[k] - asked[k]).powi(2)).sum::<f64>();
    let nearest = points.iter().min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
    let found = json(&["measure", text(&pack), "coordinate", "2.93", "0.41", "0.23", "--tolerance", "1"]);
    let at = &found["points"][0]["world"];
    let at = at.as_array().unwrap_or_else(|| panic!("{found}"));
    for k in 0..3 {
        assert!((at[k].as_f64().unwrap() - nearest[k]).abs() < 1e-9, "{found}, {nearest:?}");
    }
    for question in [&["area"][..], &["volume"], &["section", "--z=0"]] {
        let refused = fails(&[&["measure", text(&pack)], question].concat());
        assert!(refused.contains("made of points"), "{refused}");
    }
}

#[test]
fn what_cannot_be_built_as_points_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    std::fs::write(path("a.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let refused = fails(&["build", text(&path("a.obj")), "--points", "-o", text(&path("a.kilwa"))]);
    assert!(refused.contains("is no survey") && refused.contains("kilwa scans import"), "{refused}");
    let (survey, pack) = (path("survey"), path("points.kilwa"));
    succeeds(&["scans", "import", text(&box_scan(folder.path())), "-o", text(&survey)]);
    for option in [&["--resume"][..], &["--min-confidence", "1"], &["--drop-islands-below", "3"]] {
        let all = [&["build", text(&survey), "--points", "-o", text(&pack)], option].concat();
        let refused = kilwa(&all);
        let said = String::from_utf8_lossy(&refused.stderr);
        assert!(refused.status.code() == Some(2) && said.contains("cannot be used with"), "{said}");
    }
    let nowhere = ["build", text(&survey), "--points", "-o", text(&pack), "--crop", "90,90,90,91,91,91"];
    assert!(fails(&nowhere).contains("--crop holds no points"));
    assert!(!pack.exists() && !path(".points.kilwa.scratch").exists());
    // A cloud without a grid can be shown, though not meshed.
    std::fs::write(path("cloud.xyz"), "1 0 0\n1 1 0\n1 0 1\n1 1 1\n2 0 0\n").unwrap();
    let clouds = path("clouds");
    succeeds(&["scans", "import", text(&path("cloud.xyz")), "--station", "0,0,0", "-o", text(&clouds)]);
    assert!(fails(&["build", text(&clouds), "-o", text(&pack)]).contains("--points"));
    assert_eq!(json(&["build", text(&clouds), "--points", "-o", text(&pack)])["points"], 5);
    succeeds(&["verify", text(&pack)]);
}

#[test]
fn a_published_pack_of_points_says_points_everywhere() {
    let folder = tempfile::tempdir().unwrap();
    let pack = pack_of_points(folder.path());
    let (metadata, site) = (folder.path().join("m.toml"), folder.path().join("site"));
    std::fs::write(
        &metadata,
        "title = \"Room\"\n[model]\nunits = \"m\"\n[rights]\nuri = \"CC BY 4.0\"\nholder = \"A\"\n[[creators]]\nname = \"A B\"\n",
    )
    .unwrap();
    succeeds(&["publish", text(&pack), "--metadata", text(&metadata), "--to", text(&site)]);
    let object = site.join("room");
    succeeds(&["verify", text(&object)]);
    let read = |name: &str| std::fs::read_to_string(object.join(name)).unwrap();
    for name in
        ["v1/metadata/datacite.json", "v1/metadata/dc.xml", "v1/README.txt", "v1/iiif/manifest.json", "index.html"]
    {
        let said = read(name).to_lowercase();
        assert!(said.contains("points") && !said.contains(" triangles"), "{name}: {said}");
    }
    // Only the preview, which holds squares, has polygons.
    assert_eq!(read("v1/metadata/edm.xml").matches("<edm:polygonCount>").count(), 1);
    let manifest: serde_json::Value = serde_json::from_str(&read("manifest.json")).unwrap();
    assert!(manifest["versions"][0]["figures"]["points"].as_u64().unwrap() > 4000);
}

/// A survey of one cloud of these points, and its report when it is built.
fn cloud(folder: &Path, name: &str, points: &str, options: &[&str]) -> (PathBuf, serde_json::Value) {
    let (file, survey, pack) =
        (folder.join(format!("{name}.xyz")), folder.join(name), folder.join(format!("{name}.kilwa")));
    std::fs::write(&file, points).unwrap();
    if !survey.exists() {
        succeeds(&["scans", "import", text(&file), "--station", "0,0,0", "-o", text(&survey)]);
    }
    let report = json(&[&["build", text(&survey), "--points", "--force", "-o", text(&pack)], options].concat());
    succeeds(&["verify", text(&pack)]);
    (pack, report)
}

#[test]
fn a_single_point_and_points_at_one_place_are_built() {
    let folder = tempfile::tempdir().unwrap();
    for (name, points) in
        [("one", "1 2 3\n".to_owned()), ("same", "1 2 3\n".repeat(3000)), ("far", "5000 7000 3\n".to_owned())]
    {
        let (_, report) = cloud(folder.path(), name, &points, &[]);
        assert_eq!(report["points"], 1, "{name}");
    }
    let (survey, pack) = (folder.path().join("one"), folder.path().join("x.kilwa"));
    for step in ["1e-300", "1e300", "100"] {
        let refused = fails(&["build", text(&survey), "--points", "-o", text(&pack), "--step", step]);
        assert!(refused.contains("lattice spacing is possible from"), "{step}: {refused}");
    }
}

#[test]
fn points_whose_spacing_is_unknown_get_one_from_their_neighbours_and_no_outlier_hides_the_others() {
    let folder = tempfile::tempdir().unwrap();
    let mut points = String::new();
    for i in 0..2500 {
        writeln!(points, "{} {} 3.5", f64::from(i % 50) * 0.1, f64::from(i / 50) * 0.1).unwrap();
    }
    let spacing = |report: &serde_json::Value| report["median_edge"].as_f64().unwrap();
    let (_, even) = cloud(folder.path(), "even", &points, &[]);
    assert!((0.08..0.2).contains(&spacing(&even)), "{even}");
    let (_, few) = cloud(folder.path(), "even", &points, &["--crop=0,0,0,0.15,0.25,9"]);
    // Too few for a spacing: a 256th of the extent of the inputs, which can be seen and hides nothing.
    assert!(few["points"] == 6 && (0.01..0.1).contains(&spacing(&few)), "{few}");
    points += "4000 0 3.5\n";
    let (_, outlier) = cloud(folder.path(), "outlier", &points, &[]);
    let size = |k: usize| outlier["extent"][k].as_f64().unwrap();
    assert!(size(0) < 4040.0 && size(1) < 40.0 && spacing(&outlier) < 0.2, "{outlier}");
}

#[test]
fn points_are_extracted_by_the_box_that_they_are_in() {
    let folder = tempfile::tempdir().unwrap();
    let pack = pack_of_points(folder.path());
    let points = |options: &[&str]| {
        let out = folder.path().join("part.ply");
        succeeds(&[&["extract", text(&pack), "--force", "-o", text(&out)], options].concat());
        let ply = Ply::read(&out);
        let mut points: Vec<[u64; 3]> =
            (0..ply.vertices.len() as u32).map(|v| ply.position(v).map(f64::to_bits)).collect();
        points.sort_unstable();
        points
    };
    let is_in =
        |p: &[u64; 3]| p.iter().zip([-2.0, -2.0, -1.0]).all(|(x, low)| (low..2.9).contains(&f64::from_bits(*x)));
    let wanted: Vec<[u64; 3]> = points(&[]).into_iter().filter(is_in).collect();
    assert!(wanted.len() > 100);
    assert_eq!(points(&["--box=-2,-2,-1,2.9,2.9,2.9"]), wanted);
}
