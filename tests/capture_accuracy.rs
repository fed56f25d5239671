//! Propagation of pose uncertainties to measured distances.

use crate::merge::survey;
use crate::support::{Ply, json, succeeds, text};
use kilwa_scan::register::{Placed, Placement, Registration};
use kilwa_scan::survey::{Station, Survey};
use serde_json::{Value, json as value};
use std::path::Path;

/// Writes a registration of the two stations of [`survey`] with these standard deviations: of the position (metres) and of the rotation (radians).
pub(crate) fn register(survey: &Path, sigmas: [[f64; 2]; 2]) {
    let stations = Survey::open(survey).unwrap().stations;
    assert_eq!(stations.len(), 2);
    let placed = |(station, [metres, radians]): (&Station, [f64; 2])| {
        let pose = station.pose.unwrap();
        let mut covariance = [[0.0; 6]; 6];
        for k in 0..3 {
            covariance[k][k] = radians * radians;
            covariance[k + 3][k + 3] = metres * metres;
        }
        Placed::new(station, Placement::Surface, pose, covariance)
    };
    let stations = stations.iter().zip(sigmas).map(placed).collect();
    Registration { stations, ..Registration::empty() }.save(survey).unwrap();
}

/// Merges a survey into a pack and returns the report.
fn merged(survey: &Path, pack: &Path, more: &[&str]) -> Value {
    json(&[&["merge", text(survey), "--voxel", "0.1", "-o", text(pack), "--force"], more].concat())
}

fn metadata(pack: &Path) -> Value {
    json(&["info", text(pack)])["metadata"].clone()
}

/// A distance across the room, in plan.
const ACROSS: [&str; 9] = ["distance", "-3", "0.5", "0", "3", "0.5", "0", "--tolerance", "0.3"];

#[test]
fn pose_uncertainty_is_propagated_to_every_vertex_and_every_measured_distance() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (survey, bare, pack, back) = (survey(folder.path()), path("bare.kilwa"), path("room.kilwa"), path("back.ply"));
    let report = merged(&survey, &bare, &[]);
    assert!(report["merge"]["capture"].is_null(), "{report}");
    let before = std::fs::read(&bare).unwrap();

    register(&survey, [[0.001, 0.0], [0.004, 0.0]]);
    let report = merged(&survey, &pack, &[]);
    let about = metadata(&pack);
    let number = |name: &str| about[name].as_f64().unwrap();
    let [accuracy, registration, instrument] =
        ["capture_accuracy", "capture_registration", "capture_instrument"].map(number);
    assert!(registration > 0.001 && registration < 0.004 && instrument > 0.001 && instrument < 0.002_1, "{about}");
    assert!((accuracy / registration.hypot(instrument) - 1.0).abs() < 0.01, "{about}");
    let capture = &report["merge"]["capture"];
    assert_eq!(*capture, value!({ "accuracy": accuracy, "registration": registration, "instrument": instrument }));
    let channel =
        about["scalars"].as_array().unwrap().iter().find(|channel| channel["name"] == "registration").unwrap();
    let [least, greatest] = ["min", "max"].map(|name| channel[name].as_f64().unwrap());
    assert!(least >= 0.000_99 && greatest <= 0.004_01 && least < greatest, "{channel}");
    // Extracted vertices have the values that were stored.
    succeeds(&["verify", text(&pack)]);
    succeeds(&["extract", text(&pack), "-o", text(&back)]);
    let ply = Ply::read(&back);
    let each: Vec<f64> = (0..ply.vertices.len() as u32).map(|v| ply.get(v, "registration").unwrap()).collect();
    // The limits of the channel are stored as the shortest decimals of 32-bit floats.
    let [least, greatest] = [least, greatest].map(|x| f64::from(x as f32));
    assert!(each.iter().all(|sigma| (least..=greatest).contains(sigma)), "{least} {greatest}");
    let words = succeeds(&["info", text(&pack)]);
    assert!(words.contains("(standard uncertainty of the capture: registration "), "{words}");

    // A measured value has the uncertainty of the registration at its points.
    let measured = |pack: &Path, more: &[&str]| json(&[&["measure", text(pack)], &ACROSS[..], more].concat());
    let of = |measured: &Value| measured["readings"][0]["uncertainty"].as_f64().unwrap();
    let narrow = measured(&pack, &[]);
    let points = narrow["points"].as_array().unwrap();
    let own: Vec<f64> = points.iter().map(|point| point["registration"].as_f64().unwrap()).collect();
    let largest = own[0].max(own[1]);
    assert_eq!(narrow["uncertainty"]["registration"], largest);
    assert_eq!(narrow["uncertainty"]["instrument"], instrument);
    let lattice = narrow["uncertainty"]["lattice"].as_f64().unwrap();
    let squares: f64 = own.iter().map(|sigma| sigma * sigma + instrument * instrument + lattice * lattice).sum();
    assert!((of(&narrow) / squares.sqrt() - 1.0).abs() < 1e-6, "{narrow}");
    let words = succeeds(&[&["measure", text(&pack)], &ACROSS[..]].concat());
    let wanted =
        format!("capture {:.1} mm (registration {:.1} mm, instrument", largest.hypot(instrument) * 1e3, largest * 1e3);
    assert!(words.contains(&wanted), "{wanted}: {words}");

    // Worse poses give a larger uncertainty; if that of the poses is unknown, a value is no better than the mesh.
    register(&survey, [[0.010, 0.0], [0.040, 0.0]]);
    merged(&survey, &path("worse.kilwa"), &[]);
    let wide = measured(&path("worse.kilwa"), &[]);
    assert!(of(&wide) > 3.0 * of(&narrow), "{wide}");
    assert_eq!(wide["readings"][0]["value"], narrow["readings"][0]["value"]);
    let unknown = measured(&bare, &[]);
    assert!(unknown["uncertainty"]["capture"].is_null() && unknown["uncertainty"]["registration"].is_null());

    // What the user states takes precedence; its parts are not known.
    merged(&survey, &path("stated.kilwa"), &["--capture-accuracy", "0.005"]);
    let about = metadata(&path("stated.kilwa"));
    assert_eq!(about["capture_accuracy"], 0.005);
    assert!(about["capture_registration"].is_null() && about["capture_instrument"].is_null(), "{about}");
    let stated = measured(&path("stated.kilwa"), &[]);
    assert!(stated["uncertainty"]["capture"] == 0.005 && stated["uncertainty"]["registration"].is_null(), "{stated}");

    // Without the registration, everything is as before.
    std::fs::remove_file(survey.join("registration.json")).unwrap();
    let again = path("again.kilwa");
    merged(&survey, &again, &["--title", "survey", "--threads", "1"]);
    assert!(std::fs::read(&again).unwrap() == before, "the registration left something behind");
}

#[test]
fn the_accuracy_of_a_pack_is_unknown_if_a_pose_was_edited() {
    let folder = tempfile::tempdir().unwrap();
    let (survey, pack) = (survey(folder.path()), folder.path().join("room.kilwa"));
    register(&survey, [[0.001, 0.0001]; 2]);
    let toml = survey.join("survey.toml");
    let text_of = std::fs::read_to_string(&toml).unwrap();
    std::fs::write(&toml, text_of.replacen("0.9", "0.901", 1)).unwrap();
    let report = merged(&survey, &pack, &[]);
    let unknown = &report["merge"]["capture"]["unknown_poses"];
    assert!(unknown.as_array().is_some_and(|all| all.len() == 1 && all[0]["reason"] == "changed"), "{report}");
    let about = metadata(&pack);
    assert!(about["capture_accuracy"].is_null() && about["capture_registration"].is_null(), "{about}");
    assert!(!about["scalars"].to_string().contains("registration"), "{about}");
    let mesh = folder.path().join("room.ply");
    let words = succeeds(&["merge", text(&survey), "--voxel", "0.2", "-o", text(&mesh)]);
    let name = unknown[0]["station"].as_str().unwrap();
    let wanted = format!("capture accuracy unknown: pose changed after registration: {name} (run `kilwa register`");
    assert!(words.contains(&wanted), "{words}");
}
