//! The uncertainty of a point in a survey whose stations have different registration uncertainties.

use super::page::Page;
use super::{check_bound, check_none};
use crate::capture_accuracy::register;
use crate::support::{Ply, json, succeeds, text};
use serde_json::json as value;

#[test]
fn the_uncertainty_of_a_coordinate_combines_lattice_instrument_and_registration() {
    const POINTS: usize = 40;
    let folder = tempfile::tempdir().unwrap();
    let survey = crate::merge::survey(folder.path());
    register(&survey, [[0.001, 0.0005], [0.006, 0.0]]);
    let (pack, mesh) = (folder.path().join("room.kilwa"), folder.path().join("room.ply"));
    succeeds(&["merge", text(&survey), "--voxel", "0.1", "-o", text(&pack)]);
    succeeds(&["extract", text(&pack), "-o", text(&mesh)]);
    let about = json(&["info", text(&pack)])["metadata"].clone();
    let [step, instrument] = ["lattice_step", "capture_instrument"].map(|name| about[name].as_f64().unwrap());
    let (ply, page) = (Ply::read(&mesh), Page::open(&pack));
    let (mut worst, mut differing, mut seen) = (0.0_f64, 0, [f64::INFINITY, 0.0_f64]);
    for k in 0..POINTS {
        let v = (k * ply.vertices.len() / POINTS) as u32;
        let registration = ply.get(v, "registration").unwrap();
        seen = [seen[0].min(registration), seen[1].max(registration)];
        let [x, y, z] = ply.position(v).map(|x| format!("{x:?}"));
        let native =
            json(&["measure", text(&pack), "coordinate", &x, &y, &z, "--save", text(&folder.path().join("all.json"))]);
        let squares = step * step / 12.0 + instrument * instrument + registration * registration;
        let found = native["readings"][0]["uncertainty"].as_f64().unwrap();
        worst = worst.max((found / squares.sqrt() - 1.0).abs());
        let saved: serde_json::Value =
            serde_json::from_slice(&std::fs::read(folder.path().join("all.json")).unwrap()).unwrap();
        let local = &saved["measurements"][k]["local"];
        let answer = page.measure(&value!({ "tool": "coordinate", "local": local }));
        let is_same = answer["readings"] == native["readings"] && answer["uncertainty"] == native["uncertainty"];
        differing += usize::from(!is_same);
    }
    // One value would prove little.
    assert!(seen[1] > 1.5 * seen[0], "{seen:?}");
    check_bound("uncertainty of a coordinate against lattice, instrument and registration at that vertex", 1e-6, worst);
    check_none("uncertainties of the page's engine that differ from the command line in a digit", POINTS, differing);
}
