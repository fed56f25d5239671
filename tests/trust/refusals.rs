//! If a question has no meaningful value, Kilwa explains why instead of printing one.

use super::phantoms::phantom;
use crate::support::{fails, json, kilwa, succeeds, text};

#[test]
fn meaningless_measurements_are_refused_with_a_message() {
    let cube = phantom("cube", "origin");
    let pack = text(&cube.pack);
    let asked = std::cell::Cell::new(0usize);
    // Exit code 1, a sentence, and nothing on standard output.
    let say = |args: &[&str]| {
        let all = [&["measure", pack], args].concat();
        asked.set(asked.get() + 1);
        assert!(kilwa(&all).stdout.is_empty(), "{args:?} prints a number");
        fails(&all)
    };
    let line = ["0", "0", "0", "0.5", "0", "0", "1", "0", "0"];
    assert!(say(&[&["circle"], &line[..]].concat()).contains("lie on one line"));
    assert!(say(&[&["area"], &line[..]].concat()).contains("lie on one line"));
    let bow = ["area", "0", "0", "0", "1", "1", "0", "1", "0", "0", "0", "1", "0", "--exact"];
    assert!(say(&bow).contains("cross each other"));
    assert!(say(&["distance", "0", "0", "0"]).contains("at least 2 points; 1 is given"));
    assert!(say(&["distance", "0", "0", "0", "1"]).contains("three numbers each"));
    assert!(say(&["section", "--z", "77"]).contains("meets no surface"));
    assert!(say(&["section"]).contains("which plane"));
    assert!(say(&["section", "--plane", "0,0,0,0,0,0"]).contains("direction"));
    assert!(say(&["contours", "--interval", "0"]).contains("not possible"));
    assert!(say(&["contours", "--interval", "1e-9"]).contains("not possible"));
    assert!(say(&["coordinate", "--rays", "9", "9", "9", "1", "0", "0"]).contains("the ray meets no surface"));
    assert!(say(&["coordinate", "NaN", "0", "0"]).contains("finite"));
    // A result that overflows is not saved, because a document cannot contain it.
    let document = tempfile::tempdir().unwrap();
    let document = document.path().join("all.json");
    for overflow in
        [&["deviation", "--z=1e308"][..], &["distance", "0", "0", "0", "1e308", "1e308", "-1e308", "--exact"]]
    {
        assert!(say(&[overflow, &["--save", text(&document)]].concat()).contains("finite"), "{overflow:?}");
        assert!(!document.exists());
    }
    let large = ["coordinate", "1e306", "0", "0", "--exact"];
    assert!(say(&[&large[..], &["--unit", "mm"]].concat()).contains("choose a larger --unit"));
    assert!(say(&["section", "--z", "0.5", "-o", "x.pdf"]).contains("the file extension must be"));
    let in_a_file = cube.pack.join("x.svg");
    assert!(say(&["section", "--z", "0.5", "-o", text(&in_a_file)]).contains("is not a folder"));
    let usage = kilwa(&["measure", pack, "area", "--unit", "furlong"]);
    assert_eq!(usage.status.code(), Some(2));
    super::check_none("questions without an answer that get a number", asked.get(), 0);
}

#[test]
fn a_position_far_from_the_surface_is_refused_and_every_distance_is_reported() {
    fn measure<'a>(pack: &'a str, args: &[&'a str]) -> Vec<&'a str> {
        [&["measure", pack, "distance"], args].concat()
    }
    let cube = phantom("cube", "utm");
    let pack = text(&cube.pack);
    // Coordinates of another system: nothing that could be taken for a value.
    let far = measure(pack, &["0", "0", "0", "1", "1", "1"]);
    assert!(kilwa(&far).stdout.is_empty());
    let message = fails(&far);
    for part in
        ["position 1, 0 0 0, is 4676", "from the surface", "500000.000 4649776.000 123.4", "--tolerance", "--exact"]
    {
        assert!(message.contains(part), "{part}: {message}");
    }
    // Half a metre in front of the cube's south face, and on its edge.
    let near = ["500000.5", "4649775.5", "123.956", "500001", "4649776", "123.956"];
    assert!(
        fails(&measure(pack, &near)).contains("position 1, 500000.5 4649775.5 123.956, is 0.5000 m from the surface")
    );
    let within = measure(pack, &[&near[..], &["--tolerance", "0.6"]].concat());
    let words = succeeds(&within);
    assert!(words.contains("the positions given were 0.5000 m and 0.000"), "{words}");
    let found = json(&within);
    let away: Vec<f64> = found["points"].as_array().unwrap().iter().map(|p| p["away"].as_f64().unwrap()).collect();
    assert!((away[0] - 0.5).abs() < 2.0 * cube.step && away[1] < 2.0 * cube.step, "{away:?}");
    assert_eq!(found["tolerance"], 0.6);
    assert_eq!(fails(&measure(pack, &[&near[..], &["--tolerance", "0.4"]].concat())).lines().count(), 1);
    // As they are: used, and the distance is reported all the same.
    let exact = measure(pack, &[&near[..], &["--exact"]].concat());
    assert!(succeeds(&exact).contains("the positions are used as given: 0.5000 m and 0.000"));
    assert!((json(&exact)["points"][0]["away"].as_f64().unwrap() - 0.5).abs() < 2.0 * cube.step);
    let words = succeeds(&["measure", pack, "coordinate", "500000.3", "4649776.3", "124.456"]);
    assert!(words.contains("the position given was 0.000"), "{words}");
    assert_eq!(kilwa(&measure(pack, &[&near[..], &["--tolerance=-1"]].concat())).status.code(), Some(2));
}

#[test]
fn an_open_surface_has_no_volume() {
    let folder = tempfile::tempdir().unwrap();
    let (ply, pack) = (folder.path().join("wall.ply"), folder.path().join("wall.kilwa"));
    succeeds(&["synth", "wall", "--triangles", "2000", "-o", text(&ply)]);
    succeeds(&["build", text(&ply), "-o", text(&pack)]);
    let message = fails(&["measure", text(&pack), "volume"]);
    assert!(message.contains("not closed") && message.contains("cut and fill"), "{message}");
}
