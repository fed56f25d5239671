use super::edit::Edit;
use super::*;
use glam::DQuat;

fn station(name: &str) -> Station {
    Station {
        name: name.to_owned(),
        scan: format!("{STATIONS}/{name}.scan"),
        pose: None,
        sigma: None,
        is_fixed: false,
        instrument: Some("Maker \"Model\" 7".to_owned()),
        range_noise: None,
        beam: None,
        masks: Vec::new(),
        source: Source { file: "a.ptx".to_owned(), bytes: 12, blake3: "00ff".to_owned(), number: 1 },
    }
}

fn pose() -> Pose {
    Pose {
        rotation: DQuat::from_scaled_axis(DVec3::new(0.1, -2.0, 0.7)),
        translation: DVec3::new(566_000.123_456_789, -1.0, 1e-9),
    }
}

#[test]
fn what_the_program_writes_comes_back_to_the_last_bit() {
    let folder = tempfile::tempdir().unwrap();
    let mut edit = Edit::open(folder.path()).unwrap();
    edit.add_station(Station { pose: Some(pose()), ..station("north") });
    edit.add_station(station("south"));
    let cameras = [
        Camera::Pinhole { size: [4000, 3000], focal: [3000.5, 3001.0], center: [2000.0, 1500.25] },
        Camera::Spherical { size: [8000, 4000], pixel: [7.85e-4, 7.85e-4] },
        Camera::Cylindrical { size: [10, 20], radius: 1.0, center: 10.0, pixel: [0.1, 0.2] },
    ];
    for camera in cameras {
        let (file, station) = ("photographs/a.jpg".to_owned(), Some("north".to_owned()));
        edit.add_photograph(Photograph { file, station, pose: Some(pose()), camera: Some(camera) });
    }
    assert!(edit.set_crs("EPSG:32737") && !edit.set_crs("EPSG:4326"));
    edit.save().unwrap();
    let back = Survey::open(folder.path()).unwrap();
    assert_eq!(back.stations.len(), 2);
    let (written, read) = (pose(), back.stations[0].pose.unwrap());
    assert_eq!(written.translation, read.translation);
    assert!(written.difference(read).0 < 1e-7);
    assert_eq!(back.photographs.len(), 3);
    assert_eq!(&back, edit.survey());
}

#[test]
fn an_edit_keeps_comments_order_and_what_people_wrote() {
    let folder = tempfile::tempdir().unwrap();
    let mut edit = Edit::open(folder.path()).unwrap();
    edit.add_station(station("north"));
    edit.save().unwrap();
    let path = folder.path().join(FILE);
    let before = std::fs::read_to_string(&path).unwrap();
    let edited = before.replace("name = \"north\"", "# the tower by the sea\nname = \"north\" # checked");
    std::fs::write(&path, format!("{edited}\n[options.mesh]\nmax_edge = 0.1\n")).unwrap();
    let mut edit = Edit::open(folder.path()).unwrap();
    edit.set_pose("north", Some(pose())).unwrap();
    edit.add_station(station("south"));
    edit.save().unwrap();
    let after = std::fs::read_to_string(&path).unwrap();
    assert!(after.contains("# the tower by the sea\nname = \"north\" # checked"), "{after}");
    assert!(after.contains("max_edge = 0.1") && after.starts_with("# A survey"), "{after}");
    let survey = Survey::open(folder.path()).unwrap();
    assert_eq!((survey.stations.len(), survey.mesh.max_edge), (2, Some(0.1)));
    assert!(survey.stations[0].pose.is_some());
}

#[test]
fn every_mistake_is_reported_at_once_with_its_line() {
    let text = r#"version = 1
titel = "Fort"
[[station]]
name = "a b"
scan = "../outside.scan"
rotation = [1, 0, 0]
translation = [1, 2, "x"]
[station.source]
file = "a.ptx"
bytes = -1
blake3 = "00"
number = 1
[[station]]
name = "south"
scan = "stations/south.scan"
rotation = [2, 0, 0, 0]
translation = [0, 0, 0]
sorce = 1
[[control]]
name = "P1"
station = "sout"
at = [1, 2, 3]
[[photograph]]
file = "a.jpg"
camera = { kind = "fisheye", size = [10, 10] }
[options.mesh]
grazing = 95
"#;
    let problems = Survey::parse(text).unwrap_err();
    let shown = problems.to_string();
    for part in [
        "line 2: titel",
        "did you mean \"title\"?",
        "line 4: station.name",
        "line 5: station.scan",
        "line 6: station.rotation: expected a list of 4 numbers; it has 3",
        "line 7: station.translation",
        "line 10: station.source.bytes",
        "line 16: station.rotation: the length of this quaternion",
        "line 18: station.sorce",
        "line 21: control.station: there is no station sout; did you mean south?",
        "line 25: photograph.camera.kind: \"fisheye\" is unknown",
        "line 27: options.mesh.grazing",
    ] {
        assert!(shown.contains(part), "{part}\n{shown}");
    }
    assert!(Survey::parse("version = 2").unwrap_err().to_string().contains("line 1: version"));
    assert!(Survey::parse("").unwrap_err().to_string().contains("write version = 1"));
    assert!(Survey::parse("version = 1\nx = ").unwrap_err().to_string().contains("line 2"));
}

#[test]
fn names_are_made_free_and_fit_for_files() {
    let folder = tempfile::tempdir().unwrap();
    let mut edit = Edit::open(folder.path()).unwrap();
    assert_eq!(edit.free_name("  Tower / north:1 "), "Tower___north_1");
    assert_eq!(edit.free_name("../.."), "station");
    edit.add_station(station("north"));
    assert_eq!((edit.free_name("north"), edit.free_name("North")), ("north-2".to_owned(), "North-2".to_owned()));
    let message = edit.survey().station("nort").unwrap_err().to_string();
    assert!(message.contains("did you mean north?"), "{message}");
}

#[test]
fn entries_are_added_to_lists_in_every_form_that_is_read() {
    let source = "source = { file = \"a.ptx\", bytes = 12, blake3 = \"00ff\", number = 1 }";
    let one = format!("name = \"north\"\nscan = \"stations/north.scan\"\n{source}\n");
    let inline = format!("{{ name = \"north\", scan = \"stations/north.scan\", {source} }}");
    for (text, kept) in [
        ("version = 1\nstation = []\nphotograph = []\n".to_owned(), "version = 1"),
        (format!("version = 1\n# the tower\n[station]\n{one}[options.mesh]\nmax_edge = 0.1\n"), "# the tower"),
        (format!("version = 1\nstation = [\n  # the tower\n  {inline},\n]\n"), "# the tower"),
        (format!("version = 1\nstation = {inline} # the tower\n"), "north"),
        (
            "version = 1\nstation.name = \"north\"\nstation.scan = \"stations/north.scan\"\nstation.source.file = \"a.ptx\"\nstation.source.bytes = 1\nstation.source.blake3 = \"00\"\nstation.source.number = 1\n".to_owned(),
            "north",
        ),
    ] {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(FILE);
        std::fs::write(&path, &text).unwrap();
        let mut edit = Edit::open(folder.path()).unwrap();
        let before = edit.survey().stations.len();
        if before > 0 {
            edit.set_pose("north", Some(pose())).unwrap();
        }
        edit.add_station(station("south"));
        edit.add_photograph(Photograph {
            file: "photographs/a.jpg".to_owned(),
            station: Some("south".to_owned()),
            pose: None,
            camera: None,
        });
        edit.save().unwrap();
        let survey = Survey::open(folder.path()).unwrap();
        let after = std::fs::read_to_string(&path).unwrap();
        assert_eq!((survey.stations.len(), survey.photographs.len()), (before + 1, 1), "{after}");
        assert_eq!(survey.stations[before], station("south"), "{after}");
        assert!(survey.stations[..before].iter().all(|s| s.name == "north" && s.pose.is_some()), "{after}");
        assert!(after.contains(kept), "{after}");
    }
}

#[test]
fn a_survey_that_was_edited_meanwhile_is_merged_or_the_command_must_run_again() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(FILE);
    let mut edit = Edit::open(folder.path()).unwrap();
    edit.add_station(station("north"));
    edit.save().unwrap();
    let write = |more: &str| {
        let text = std::fs::read_to_string(&path).unwrap();
        std::fs::write(&path, format!("{more}\n{text}")).unwrap();
    };
    write("title = \"Fort\" # by hand");
    edit.add_station(station("south"));
    edit.save().unwrap();
    let survey = Survey::open(folder.path()).unwrap();
    assert_eq!((survey.title.as_deref(), survey.stations.len()), (Some("Fort"), 2));
    assert!(std::fs::read_to_string(&path).unwrap().contains("# by hand"));
    assert_eq!(&survey, edit.survey());
    // A pose is computed from what was there before: it is not put into a file that has changed.
    write("# again");
    edit.set_pose("north", Some(pose())).unwrap();
    let message = edit.save().unwrap_err().to_string();
    assert!(message.contains("survey.toml was edited while this command ran"), "{message}");
    assert!(std::fs::read_to_string(&path).unwrap().starts_with("# again"));
}
