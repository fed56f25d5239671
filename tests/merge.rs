//! `kilwa merge`: stations of a survey become one surface, as a mesh or a pack.

use crate::capture_accuracy::register;
use crate::eventually::eventually_every;
use crate::support::{Ply, fails, json, kilwa, succeeds, text};
use std::collections::HashSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// Half the size of the room along each axis, metres.
const ROOM: [f64; 3] = [3.0, 2.5, 1.5];

/// A survey of two stations in one room, at different places in it; the second has colours.
pub(crate) fn survey(folder: &Path) -> PathBuf {
    survey_at(folder, [0.0; 3])
}

/// The same with the middle of the room at `origin`.
fn survey_at(folder: &Path, origin: [f64; 3]) -> PathBuf {
    let mut ptx = String::new();
    for (at, has_color) in [([-1.0, 0.4, -0.2], false), ([0.9, -0.7, 0.3], true)] {
        let [x, y, z] = [0, 1, 2].map(|k| origin[k] + at[k]);
        write!(ptx, "120\n60\n{x} {y} {z}\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n{x} {y} {z} 1\n").unwrap();
        for (column, row) in (0..120).flat_map(|column| (0..60).map(move |row| (column, row))) {
            let (azimuth, elevation) = (f64::from(column) * 0.05236, (f64::from(row) - 29.5) * 0.05);
            let ray: [f64; 3] = [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()];
            let to_wall = |k: usize| (ROOM[k] * ray[k].signum() - at[k]) / ray[k];
            let range = (0..3).map(to_wall).fold(f64::INFINITY, f64::min);
            let [x, y, z] = ray.map(|d| d * range);
            let color = if has_color { " 200 120 60" } else { "" };
            writeln!(ptx, "{x:.6} {y:.6} {z:.6} 0.250{color}").unwrap();
        }
    }
    let (file, survey) = (folder.join("room.ptx"), folder.join("survey"));
    std::fs::write(&file, ptx).unwrap();
    succeeds(&["scans", "import", text(&file), "-o", text(&survey)]);
    survey
}

/// How far a place is from the nearest wall, floor or ceiling.
fn off_the_walls(p: [f64; 3]) -> f64 {
    (0..3).map(|k| (p[k].abs() - ROOM[k]).abs()).fold(f64::INFINITY, f64::min)
}

#[test]
fn two_stations_of_a_room_merge_into_its_walls_with_what_each_vertex_rests_on() {
    let folder = tempfile::tempdir().unwrap();
    let (survey, out) = (survey(folder.path()), folder.path().join("room.ply"));
    let report = json(&["merge", text(&survey), "--voxel", "0.08", "-o", text(&out)]);
    assert_eq!((&report["stations"], &report["voxel"]), (&2.into(), &0.08.into()));
    let ply = Ply::read(&out);
    assert_eq!(report["vertices"], ply.vertices.len());
    assert!(ply.triangles.len() > 5_000, "{report}");
    assert!(ply.edge_uses().values().all(|uses| *uses <= 2));
    let (mut near, mut both, mut colored) = (0, 0, 0);
    for v in 0..ply.vertices.len() as u32 {
        // Between the rays on both sides of an edge of the room, the triangles cut it off.
        let off = off_the_walls(ply.position(v));
        assert!(off < 0.12, "{:?}", ply.position(v));
        near += u32::from(off < 0.01);
        both += u32::from(ply.get(v, "stations") == Some(2.0));
        colored += u32::from(["red", "green", "blue"].map(|c| ply.get(v, c).unwrap()) == [200.0, 120.0, 60.0]);
        assert!(ply.get(v, "confidence").unwrap() > 0.0);
        assert!((ply.get(v, "intensity").unwrap() - 0.25).abs() < 1e-3);
    }
    assert!(f64::from(near) > 0.9 * ply.vertices.len() as f64, "{near}");
    // Both see nearly all of the room; where the second does not see, there is no colour.
    assert!(f64::from(both) > 0.9 * ply.vertices.len() as f64, "{both}");
    assert!(f64::from(colored) > 0.9 * ply.vertices.len() as f64, "{colored}");
}

#[test]
fn a_pack_holds_the_same_surface_as_the_mesh() {
    let folder = tempfile::tempdir().unwrap();
    let survey = survey(folder.path());
    let path = |name: &str| folder.path().join(name);
    let (mesh, pack, back) = (path("room.ply"), path("room.kilwa"), path("back.ply"));
    let common = ["merge", text(&survey), "--voxel", "0.1", "-o"];
    let report = json(&[&common[..], &[text(&mesh)]].concat());
    succeeds(&[&common[..], &[text(&pack), "--threads", "1"]].concat());
    succeeds(&["verify", text(&pack)]);
    let about = json(&["info", text(&pack)]);
    assert_eq!(about["metadata"]["triangles"], report["triangles"], "{about}");
    succeeds(&["extract", text(&pack), "-o", text(&back)]);
    let (mesh, back) = (Ply::read(&mesh), Ply::read(&back));
    // Positions are rounded differently, by less than half a millimetre.
    let centers = |ply: &Ply| -> Vec<[i64; 3]> {
        let center = |t: &[u32; 3], k: usize| t.iter().map(|v| ply.position(*v)[k]).sum::<f64>() / 3.0;
        ply.triangles.iter().map(|t| [0, 1, 2].map(|k| (center(t, k) * 1e3).round() as i64)).collect()
    };
    let (mesh, back) = (centers(&mesh), centers(&back));
    assert_eq!(mesh.len(), back.len());
    let there: HashSet<[i64; 3]> = back.into_iter().collect();
    let is_there =
        |[x, y, z]: [i64; 3]| (0..27).any(|k| there.contains(&[x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1]));
    assert!(mesh.into_iter().all(is_there), "a triangle of the mesh is not in the pack");
    // Built again, from what a killed build leaves or from nothing: the same bytes.
    let again = path("again.kilwa");
    succeeds(&[&common[..], &[text(&again), "--threads", "2", "--memory", "120M", "--resume"]].concat());
    assert!(std::fs::read(&pack).unwrap() == std::fs::read(&again).unwrap(), "the pack depends on threads or memory");
}

#[test]
fn holes_are_listed_with_their_place_size_and_cause() {
    let folder = tempfile::tempdir().unwrap();
    let (survey, out) = (survey(folder.path()), folder.path().join("room.ply"));
    // A piece of the wall at y = -2.5 is masked: stations measured something there.
    succeeds(&["scans", "mask", text(&survey), "--inside=-1,-2.6,-0.5,0,-2.4,0.5"]);
    let holes = folder.path().join("holes.geojson");
    let report = json(&["merge", text(&survey), "--voxel", "0.08", "-o", text(&out), "--holes", text(&holes)]);
    let list: serde_json::Value = serde_json::from_slice(&std::fs::read(&holes).unwrap()).unwrap();
    let features = list["features"].as_array().unwrap();
    assert_eq!(report["holes"]["count"], features.len());
    let largest = &features[0];
    let about = &largest["properties"];
    assert!((about["area_m2"].as_f64().unwrap() - 1.0).abs() < 0.35, "{about}");
    assert!((about["rim_m"].as_f64().unwrap() - 4.0).abs() < 1.5, "{about}");
    assert_eq!(about["cause"], "dropped", "{about}");
    let center: Vec<f64> = about["center"].as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    assert!((center[0] + 0.5).abs() < 0.1 && (center[1] + 2.5).abs() < 0.05 && center[2].abs() < 0.1, "{about}");
    let ring = largest["geometry"]["coordinates"][0].as_array().unwrap();
    assert_eq!(ring.first(), ring.last());
    // Files of the survey, the output and an earlier list are never replaced by it.
    let before = std::fs::read(survey.join("survey.toml")).unwrap();
    for other in [survey.join("survey.toml"), survey.join("stations/room.scan"), out.clone()] {
        let said = fails(&["merge", text(&survey), "-o", text(&out), "--force", "--holes", text(&other)]);
        assert!(said.contains("choose another name"), "{said}");
    }
    assert!(std::fs::read(survey.join("survey.toml")).unwrap() == before);
    fails(&["merge", text(&survey), "-o", text(&folder.path().join("other.ply")), "--holes", text(&holes)]);
}

#[test]
fn a_published_list_of_holes_is_on_the_surface_of_its_pack() {
    let folder = tempfile::tempdir().unwrap();
    // At map coordinates, where single precision would move a rim by half a metre.
    let survey = survey_at(folder.path(), [565_977.25, 9_009_946.5, 31.75]);
    succeeds(&["scans", "mask", text(&survey), "--inside=565976,9009943.8,31,565977,9009944.2,32.5"]);
    let path = |name: &str| folder.path().join(name);
    let (pack, list, mesh) = (path("room.kilwa"), path("holes.geojson"), path("room.ply"));
    succeeds(&["merge", text(&survey), "--voxel", "0.08", "-o", text(&pack), "--holes", text(&list)]);
    let metadata = path("room.toml");
    std::fs::write(&metadata, "title = \"Room\"\n[rights]\nuri = \"CC0\"\n[model]\nunits = \"m\"\n").unwrap();
    crate::support::serving::page(&path("www"));
    let publish =
        ["publish", text(&pack), "--to", text(&path("site")), "--metadata", text(&metadata)].map(String::from);
    let more = ["--www", text(&path("www")), "--software", "--holes", text(&list)].map(String::from);
    let args: Vec<&str> = publish.iter().chain(&more).map(String::as_str).collect();
    succeeds(&args);
    succeeds(&["verify", text(&path("site"))]);
    succeeds(&["extract", text(&pack), "-o", text(&mesh), "--max-error", "0"]);
    let ply = Ply::read(&mesh);
    let cell = |p: [f64; 3]| p.map(|v| (v * 50.0).floor() as i64);
    let vertices: HashSet<[i64; 3]> = (0..ply.vertices.len() as u32).map(|v| cell(ply.position(v))).collect();
    let published: serde_json::Value =
        serde_json::from_slice(&std::fs::read(path("site/room/v1/holes.geojson")).unwrap()).unwrap();
    let rim = published["features"][0]["geometry"]["coordinates"][0].as_array().unwrap();
    assert!(rim.len() > 20, "{rim:?}");
    for place in rim {
        let place = [0, 1, 2].map(|k| place[k].as_f64().unwrap());
        let near = (0..27).map(|n| [n % 3, n / 3 % 3, n / 9].map(|d| f64::from(d - 1) * 0.001));
        let found = near.map(|d| [0, 1, 2].map(|k| place[k] + d[k])).any(|p| vertices.contains(&cell(p)));
        assert!(found, "{place:?} is not a vertex of the pack");
    }
}

/// A survey of one station before a wall at y = 4, which has a window to another wall at y = 8, and is hidden in part by a panel at y = 2.
fn wall_with_window_and_panel(folder: &Path) -> PathBuf {
    let mut ptx = String::from("200\n120\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n");
    for (column, row) in (0..200).flat_map(|column| (0..120).map(move |row| (column, row))) {
        // As tangents, so that the wall is sampled evenly, 2.4 cm apart.
        let (x, z) = ((f64::from(column) - 99.5) * 0.006, (f64::from(row) - 59.5) * 0.006);
        let is_panel = (-0.45..-0.2).contains(&x) && z.abs() < 0.12;
        let is_window = (0.2..0.45).contains(&x) && z.abs() < 0.15;
        let y = if is_panel {
            2.0
        } else if is_window {
            8.0
        } else {
            4.0
        };
        writeln!(ptx, "{:.6} {y:.6} {:.6} 0.5", x * y, z * y).unwrap();
    }
    let (file, survey) = (folder.join("wall.ptx"), folder.join("wall"));
    std::fs::write(&file, ptx).unwrap();
    succeeds(&["scans", "import", text(&file), "-o", text(&survey)]);
    survey
}

#[test]
fn a_wild_intensity_changes_only_its_surroundings() {
    let folder = tempfile::tempdir().unwrap();
    survey(folder.path());
    let scan = std::fs::read_to_string(folder.path().join("room.ptx")).unwrap();
    for wild in ["65535", "3e38"] {
        let (file, other) =
            (folder.path().join(format!("wild-{wild}.ptx")), folder.path().join(format!("survey-{wild}")));
        std::fs::write(&file, scan.replacen(" 0.250", &format!(" {wild}"), 1)).unwrap();
        succeeds(&["scans", "import", text(&file), "-o", text(&other)]);
        let out = folder.path().join("wild.ply");
        succeeds(&["merge", text(&other), "--voxel", "0.08", "--force", "-o", text(&out)]);
        let ply = Ply::read(&out);
        let count = ply.vertices.len() as u32;
        let same = (0..count).filter(|v| (ply.get(*v, "intensity").unwrap() - 0.25).abs() < 1e-3).count();
        assert!(same as f64 > 0.99 * f64::from(count), "{wild}: {same} of {count}");
    }
}

#[test]
fn a_shadow_is_told_from_an_opening() {
    let folder = tempfile::tempdir().unwrap();
    let survey = wall_with_window_and_panel(folder.path());
    let (out, holes) = (folder.path().join("wall.ply"), folder.path().join("holes.geojson"));
    json(&["merge", text(&survey), "--voxel", "0.03", "-o", text(&out), "--holes", text(&holes)]);
    let list: serde_json::Value = serde_json::from_slice(&std::fs::read(&holes).unwrap()).unwrap();
    let mut found: Vec<(String, f64, f64)> = Vec::new();
    for feature in list["features"].as_array().unwrap() {
        let about = &feature["properties"];
        let number = |value: &serde_json::Value| value.as_f64().unwrap();
        found.push((
            about["cause"].as_str().unwrap().to_owned(),
            number(&about["center"][0]),
            number(&about["area_m2"]),
        ));
    }
    assert_eq!(found.len(), 2, "{found:?}");
    found.sort_by(|a, b| a.1.total_cmp(&b.1));
    let [(shadow, left, shadow_area), (window, right, window_area)] = &found[..] else { unreachable!() };
    assert_eq!((shadow.as_str(), window.as_str()), ("unseen", "free"), "{found:?}");
    // The panel hides 1 × 0.96 m, the window is 1 × 1.2 m.
    assert!((left + 1.3).abs() < 0.05 && (shadow_area - 0.96).abs() < 0.15, "{found:?}");
    assert!((right - 1.3).abs() < 0.05 && (window_area - 1.2).abs() < 0.15, "{found:?}");
}

#[test]
fn masked_samples_are_left_out_and_a_box_limits_the_surface() {
    let folder = tempfile::tempdir().unwrap();
    let (survey, out) = (survey(folder.path()), folder.path().join("room.ply"));
    let lowest = |extra: &[&str]| {
        let voxel: &[&str] = if extra.iter().any(|e| e.starts_with("--voxel")) { &[] } else { &["--voxel=0.1"] };
        succeeds(&[&["merge", text(&survey), "--force", "-o", text(&out)], voxel, extra].concat());
        let ply = Ply::read(&out);
        (0..ply.vertices.len() as u32).map(|v| ply.position(v)[2]).fold(f64::INFINITY, f64::min)
    };
    assert!(lowest(&[]) < -1.4);
    // The triangles are up to 15 cm long, and the surface ends with the box all the same.
    assert!((lowest(&["--box", "-9,-9,-1,9,9,9", "--voxel=0.02"]) + 1.0).abs() < 0.05);
    succeeds(&["scans", "mask", text(&survey), "--outside=-9,-9,0,9,9,9"]);
    assert!(lowest(&[]) > -0.3);
    assert!(lowest(&["--unmasked"]) < -1.4);
}

#[test]
fn surveys_that_cannot_be_merged_are_refused_with_advice() {
    let folder = tempfile::tempdir().unwrap();
    let survey = survey(folder.path());
    let out = folder.path().join("room.ply");
    let refused = |args: &[&str]| fails(&[&["merge", text(&survey), "-o"], args].concat());
    assert!(refused(&[text(&out), "--resume"]).contains("only for packs"));
    assert!(refused(&[text(&folder.path().join("room.dwg"))]).contains(".ply"));
    assert!(refused(&[text(&out), "--voxel", "0.0000001"]).contains("give a size from"));
    assert!(refused(&[text(&out), "--box", "50,50,50,60,60,60"]).contains("box"));
    let toml = survey.join("survey.toml");
    let text_of = std::fs::read_to_string(&toml).unwrap();
    let lines = text_of.lines().filter(|line| !line.starts_with("rotation =") && !line.starts_with("translation ="));
    let without = lines.flat_map(|line| [line, "\n"]).collect::<String>();
    std::fs::write(&toml, without).unwrap();
    let said = refused(&[text(&out)]);
    assert!(said.contains("has no pose") && said.contains("survey.toml"), "{said}");
    assert!(!out.exists());
}

#[test]
fn the_report_of_a_pack_has_the_figures_of_the_merge() {
    let folder = tempfile::tempdir().unwrap();
    let (survey, out) = (survey(folder.path()), folder.path().join("room.kilwa"));
    let common = ["merge", text(&survey), "--voxel", "0.08", "-o"];
    let report = json(&[&common[..], &[text(&out)]].concat());
    let mesh = json(&[&common[..], &[text(&folder.path().join("room.ply"))]].concat());
    for key in ["voxel", "stations", "station_triangles", "pieces", "scratch_estimated_bytes", "intensity", "holes"] {
        assert!(!mesh[key].is_null() && report["merge"][key] == mesh[key], "{key}: {report}");
    }
    assert!(report["merge"]["scratch_bytes"].as_u64() > Some(0), "{report}");

    // The report of the survey reads both.
    for (name, merged) in [("pack", &report), ("mesh", &mesh)] {
        let [input, page] = ["json", "html"].map(|end| folder.path().join(format!("{name}.{end}")));
        std::fs::write(&input, merged.to_string()).unwrap();
        succeeds(&["scans", "report", text(&survey), "--merge", text(&input), "-o", text(&page)]);
        let page = std::fs::read_to_string(&page).unwrap();
        assert!(page.contains("Merged surface") && page.contains("80.0 mm"), "{page}");
    }
}

#[test]
fn a_voxel_size_that_needs_too_much_scratch_space_is_refused_beforehand() {
    let folder = tempfile::tempdir().unwrap();
    let (survey, out) = (survey(folder.path()), folder.path().join("room.ply"));
    let said = fails(&["merge", text(&survey), "--voxel", "0.0001", "-o", text(&out)]);
    assert!(said.contains("of scratch space") && said.contains("free; use a larger --voxel"), "{said}");
    assert!(!out.exists());
}

/// Every file of a folder but those of the survey.
fn made(folder: &Path) -> Vec<String> {
    let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
    let mut names: Vec<String> = names.filter(|name| name.contains(".kilwa")).collect();
    names.sort();
    names
}

#[test]
fn a_merge_that_is_killed_resumes_to_the_same_pack() {
    let folder = tempfile::tempdir().unwrap();
    let survey = survey(folder.path());
    // The accuracy determined during the merge is needed at the end.
    register(&survey, [[0.001, 0.0001], [0.004, 0.0002]]);
    let path = |name: &str| folder.path().join(name);
    let merge = |name: &str| {
        let mut merge = Command::new(env!("CARGO_BIN_EXE_kilwa"));
        merge.args(["merge", text(&survey), "--voxel", "0.03", "--title", "room", "--resume", "-o"]).arg(path(name));
        merge.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        merge
    };
    assert!(merge("first.kilwa").status().unwrap().success());
    let wanted = std::fs::read(path("first.kilwa")).unwrap();
    let scratch = path(".room.kilwa.scratch");
    let mut kills = 0;
    // The scratch folder is there while stations are merged, the leaves when the merged surface has been taken in, a level when it is simplified.
    for state in ["", "leaves.patches", "level-01.patches"] {
        let mut child = merge("room.kilwa").spawn().unwrap();
        eventually_every(Duration::from_micros(200), state, || {
            (scratch.join(state).exists() || path("room.kilwa").exists()).then_some(())
        });
        child.kill().unwrap();
        kills += u32::from(!child.wait().unwrap().success());
        assert!(!path("room.kilwa").exists() || std::fs::read(path("room.kilwa")).unwrap() == wanted, "{state}");
    }
    assert!(kills > 0, "every merge was faster than its kill");
    assert!(merge("room.kilwa").status().unwrap().success());
    assert!(std::fs::read(path("room.kilwa")).unwrap() == wanted, "the resumed pack differs");
    assert_eq!(made(folder.path()), ["first.kilwa", "room.kilwa"]);
    let about = json(&["info", text(&path("room.kilwa"))]);
    assert!(about["metadata"]["capture_registration"].as_f64() > Some(0.001), "{about}");
    // With different pose uncertainties, the result would be a different pack.
    let mut child = merge("other.kilwa").spawn().unwrap();
    let scratch = path(".other.kilwa.scratch");
    eventually_every(Duration::from_micros(200), "leaves", || {
        (scratch.join("leaves.patches").exists() || path("other.kilwa").exists()).then_some(())
    });
    child.kill().unwrap();
    child.wait().unwrap();
    if !path("other.kilwa").exists() {
        register(&survey, [[0.001, 0.0001], [0.005, 0.0002]]);
        let refused = merge("other.kilwa").stderr(Stdio::piped()).output().unwrap();
        let refused = String::from_utf8(refused.stderr).unwrap();
        assert!(refused.contains("cannot resume"), "{refused}");
    }
}

/// A survey of two stations, 3 and 12 m before a wall, whose intensities fall off with range and incidence; both see its middle.
fn wall_from_two_ranges(folder: &Path) -> PathBuf {
    let survey = folder.join("survey");
    for (name, [x, y], gain) in [("near", [-5.0, -3.0_f64], 1.0), ("far", [5.0, -12.0], 2.0)] {
        let (columns, rows, step) = (300, 60, 12.0 / 300.0);
        let mut ptx =
            format!("{columns}\n{rows}\n{x} {y} 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n{x} {y} 0 1\n");
        for (column, row) in (0..columns).flat_map(|column| (0..rows).map(move |row| (column, row))) {
            // From x = -9 to 3, or -3 to 9; the wall is at y = 0.
            let first = if gain == 1.0 { -9.0 } else { -3.0 };
            let [dx, dy, dz] = [first + f64::from(column) * step - x, -y, (f64::from(row) - 29.5) * step];
            let range = (dx * dx + dy * dy + dz * dz).sqrt();
            let intensity = 0.3 * gain * (dy / range) / (1.0 + (range / 8.0).powi(2));
            writeln!(ptx, "{dx:.6} {dy:.6} {dz:.6} {intensity:.6}").unwrap();
        }
        let file = folder.join(format!("{name}.ptx"));
        std::fs::write(&file, ptx).unwrap();
        succeeds(&["scans", "import", text(&file), "-o", text(&survey)]);
    }
    survey
}

#[test]
fn intensities_of_a_wall_seen_from_two_ranges_agree_after_normalisation() {
    let folder = tempfile::tempdir().unwrap();
    let (survey, out) = (wall_from_two_ranges(folder.path()), folder.path().join("wall.ply"));
    let extremes = |which: &str| {
        let more = ["--intensity", which, "--voxel", "0.05", "--force"];
        let report = json(&[&["merge", text(&survey), "-o", text(&out)], &more[..]].concat());
        assert_eq!(report["intensity"], which, "{report}");
        let ply = Ply::read(&out);
        let mut all: Vec<f64> = (0..ply.vertices.len() as u32).map(|v| ply.get(v, "intensity").unwrap()).collect();
        all.sort_by(f64::total_cmp);
        all[all.len() * 98 / 100] / all[all.len() * 2 / 100]
    };
    let (raw, normalised) = (extremes("raw"), extremes("normalised"));
    assert!(raw > 1.8, "{raw}");
    assert!(normalised < 1.06, "{normalised}");
    // Without an overlap nothing is known of the falloff.
    let toml = std::fs::read_to_string(survey.join("survey.toml")).unwrap();
    let moved = toml.replacen("12.0", "112.0", 1);
    assert!(moved != toml, "{toml}");
    std::fs::write(survey.join("survey.toml"), moved).unwrap();
    let report = json(&["merge", text(&survey), "--voxel", "0.05", "--force", "-o", text(&out)]);
    assert_eq!(report["intensity"], "raw", "{report}");
}

fn joined<'a>(common: &[&'a str], args: &[&'a str]) -> Vec<&'a str> {
    [common, args].concat()
}

#[test]
fn shadows_are_filled_on_request_and_openings_stay_open() {
    let folder = tempfile::tempdir().unwrap();
    let survey = wall_with_window_and_panel(folder.path());
    let (out, holes) = (folder.path().join("wall.ply"), folder.path().join("holes.geojson"));
    let common = ["merge", text(&survey), "--voxel", "0.03", "--force", "-o", text(&out)];
    let report = json(&joined(
        &common,
        &["--fill", "diffuse", "--fill", "coarser", "--fill-max-area", "1.5", "--holes", text(&holes)],
    ));
    assert_eq!((&report["filled"]["holes"], &report["filled"]["openings"]), (&1.into(), &1.into()), "{report}");
    let list: serde_json::Value = serde_json::from_slice(&std::fs::read(&holes).unwrap()).unwrap();
    for feature in list["features"].as_array().unwrap() {
        let about = &feature["properties"];
        let expected = if about["cause"] == "unseen" { "diffused".into() } else { serde_json::Value::Null };
        assert_eq!(about["filled"], expected, "{about}");
    }
    let ply = Ply::read(&out);
    let added: Vec<u32> = (0..ply.vertices.len() as u32).filter(|v| ply.get(*v, "filled") == Some(1.0)).collect();
    assert!(added.len() > 500, "{}", added.len());
    for v in added {
        let [x, y, z] = ply.position(v);
        assert!((-1.9..-0.7).contains(&x) && (y - 4.0).abs() < 0.02 && z.abs() < 0.6, "{x} {y} {z}");
        assert_eq!((ply.get(v, "source"), ply.get(v, "stations")), (Some(3.0), Some(0.0)));
    }
    let report = json(&joined(&common, &["--watertight"]));
    assert!(report["filled"]["closed"].as_u64() > Some(0), "{report}");
    let triangles = Ply::read(&out).triangles;
    let sides: HashSet<[u32; 2]> = triangles.iter().flat_map(|t| [[t[0], t[1]], [t[1], t[2]], [t[2], t[0]]]).collect();
    assert_eq!(sides.len(), 3 * triangles.len());
    assert!(sides.iter().all(|[a, b]| sides.contains(&[*b, *a])), "the surface has a border");
    // An option that would do nothing, a mesh in millimetres, and a list over the output.
    let useless = kilwa(&joined(&common, &["--fill-max-area", "1.5"]));
    assert!(useless.status.code() == Some(2) && String::from_utf8_lossy(&useless.stderr).contains("--fill <HOW>"));
    let mesh = folder.path().join("mesh.obj");
    std::fs::write(&mesh, "v 0 4000 0\nv 1000 4000 0\nv 0 4000 1000\nf 1 2 3\n").unwrap();
    assert!(fails(&joined(&common, &["--fill-mesh", text(&mesh)])).contains("does not fit the survey"));
    let same = folder.path().join("wall/../wall.ply");
    assert!(fails(&joined(&common, &["--holes", text(&same)])).contains("already the name of the output"));
}
