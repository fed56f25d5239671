//! If a question has no meaningful value, Kilwa explains why instead of printing one.

use super::phantoms::phantom;
use crate::support::{fails, kilwa, text};

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
    assert!(say(&["section", "--z", "0.5", "-o", "/nowhere/x.svg"]).contains("there is no folder"));
    let usage = kilwa(&["measure", pack, "area", "--unit", "furlong"]);
    assert_eq!(usage.status.code(), Some(2));
    super::check_none("questions without an answer that get a number", asked.get(), 0);
}

#[test]
fn an_open_surface_has_no_volume() {
    let folder = tempfile::tempdir().unwrap();
    let (ply, pack) = (folder.path().join("wall.ply"), folder.path().join("wall.kilwa"));
    crate::support::succeeds(&["synth", "wall", "--triangles", "2000", "-o", text(&ply)]);
    crate::support::succeeds(&["build", text(&ply), "-o", text(&pack)]);
    let message = fails(&["measure", text(&pack), "volume"]);
    assert!(message.contains("not closed") && message.contains("cut and fill"), "{message}");
}
