//! `kilwa scans` as a person or a script meets it.

use crate::support::{Ply, fails, json, kilwa, succeeds, text};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Two stations of 60 × 40 cells in the middle of a box of 6 × 6 × 3 m; the second is turned by 90° and has colours.
pub(crate) fn box_scan(folder: &Path) -> PathBuf {
    let mut ptx = String::new();
    for (pose, has_color) in
        [("1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n", false), ("0 1 0 0\n-1 0 0 0\n0 0 1 0\n0.5 0 0 1\n", true)]
    {
        write!(ptx, "60\n40\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n{pose}").unwrap();
        for column in 0..60 {
            for row in 0..40 {
                let (azimuth, elevation) = (f64::from(column) * 0.1047, (f64::from(row) - 19.5) * 0.06);
                let ray = [elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin(), elevation.sin()];
                let walls = ray.iter().zip([3.0, 3.0, 1.5]).map(|(d, half): (&f64, f64)| half / d.abs());
                let range = walls.fold(f64::INFINITY, f64::min);
                let [x, y, z] = ray.map(|d| d * range);
                let color = if has_color { format!(" {} {} 90", row * 6, column * 4) } else { String::new() };
                writeln!(ptx, "{x:.6} {y:.6} {z:.6} {:.3}{color}", 1.0 / range).unwrap();
            }
        }
    }
    let path = folder.join("room.ptx");
    std::fs::write(&path, ptx).unwrap();
    path
}

#[test]
fn scans_are_imported_listed_drawn_and_meshed() {
    let folder = tempfile::tempdir().unwrap();
    let file = box_scan(folder.path());
    let path = |name: &str| folder.path().join(name);
    let survey = path("survey");
    let said = succeeds(&["scans", "import", text(&file), "-o", text(&survey)]);
    assert!(
        said.contains("room: 2,400 points, 60 × 40, from room.ptx (1)") || said.contains("room: 2400 points"),
        "{said}"
    );
    let list = succeeds(&["scans", "list", text(&survey)]);
    assert!(
        list.contains("room-2") && list.contains("60 × 40") && list.contains("int, rgb") && list.contains("2 stations"),
        "{list}"
    );
    let about = json(&["scans", "list", text(&survey)]);
    assert_eq!(about["stations"][1]["scan"]["with_color"], 2400);
    assert_eq!(about["stations"][1]["pose"]["translation_m"][0], 0.5);

    for show in ["range", "intensity", "colour"] {
        let picture = path(&format!("{show}.png"));
        let said = succeeds(&["scans", "view", text(&survey), "room-2", "-o", text(&picture), "--show", show]);
        assert!(said.contains("60 × 40 pixels"), "{said}");
        assert!(std::fs::read(&picture).unwrap().starts_with(b"\x89PNG"));
    }
    let refused = fails(&["scans", "view", text(&survey), "room", "-o", text(&path("none.png")), "--show", "colour"]);
    assert!(refused.contains("has no colours; use --show range"), "{refused}");

    for name in ["room.ply", "room.obj", "room.stl", "room.glb"] {
        let mesh = path(name);
        let export = ["scans", "export", text(&survey), "room-2", "--mesh", "-o", text(&mesh), "--max-edge", "1"];
        let made = json(&export);
        // A closed turn of 60 columns, but for cells that the corners of the room cut.
        assert!(made["triangles"].as_u64().unwrap() > 60 * 39 * 2 * 9 / 10, "{made}");
        assert_eq!(made["closed"], true);
        // Kilwa reads what it wrote.
        let read = json(&["info", text(&mesh)]);
        assert_eq!(read["triangles"], made["triangles"], "{name}");
    }
    let mesh = Ply::read(&path("room.ply"));
    let header = String::from_utf8_lossy(&std::fs::read(path("room.ply")).unwrap()[..600]).into_owned();
    assert!(header.contains("station room-2 of room.ptx") && !header.contains("certified"), "{header}");
    for v in 0..mesh.vertices.len() as u32 {
        let [x, y, z] = mesh.position(v);
        let on_wall = (x - 0.5).abs().max(y.abs()) / 3.0;
        assert!((on_wall.max(z.abs() / 1.5) - 1.0).abs() < 1e-5, "{x} {y} {z}");
        assert!(mesh.get(v, "confidence").unwrap() > 0.0);
    }

    // The mesh option of the survey, which a build takes.
    let toml = survey.join("survey.toml");
    let text_of = std::fs::read_to_string(&toml).unwrap();
    std::fs::write(&toml, format!("{text_of}\n[options.mesh]\nmax_edge = 1.0\n")).unwrap();
    let pack = path("room.kilwa");
    let built = json(&["build", text(&survey), "-o", text(&pack)]);
    assert!(built["input_triangles"].as_u64().is_none_or(|n| n > 8000), "{built}");
    let info = json(&["info", text(&pack)]);
    assert!(info.to_string().contains("room-2.scan") && info.to_string().contains("confidence"), "{info}");

    let again = path("again.ptx");
    succeeds(&["scans", "export", text(&survey), "room-2", "--ptx", "-o", text(&again)]);
    succeeds(&["scans", "import", text(&again), "-o", text(&path("second"))]);
    let [before, after] =
        ["survey/stations/room-2.scan", "second/stations/again.scan"].map(|name| std::fs::read(path(name)).unwrap());
    assert!(before == after);
}

#[test]
fn missing_folders_of_outputs_are_made_and_other_names_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let file = box_scan(folder.path());
    let path = |name: &str| folder.path().join(name);
    let survey = path("survey");
    succeeds(&["scans", "import", text(&file), "-o", text(&survey)]);
    succeeds(&["scans", "view", text(&survey), "room", "-o", text(&path("new/views/room.png"))]);
    assert!(std::fs::read(path("new/views/room.png")).unwrap().starts_with(b"\x89PNG"));
    succeeds(&["scans", "export", text(&survey), "room", "--ptx", "-o", text(&path("other/room.ptx"))]);
    assert!(std::fs::read(path("other/room.ptx")).unwrap().starts_with(b"60\n40\n"));
    let refused = fails(&["scans", "view", text(&survey), "room", "-o", text(&path("third/room.jpg"))]);
    assert!(refused.contains("must be .png") && !path("third").exists(), "{refused}");
    let refused = fails(&["scans", "export", text(&survey), "room", "--ptx", "-o", text(&path("room.ply"))]);
    assert!(refused.contains("must be .ptx"), "{refused}");
}

#[test]
fn scans_with_the_same_pose_are_built_with_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let file = box_scan(folder.path());
    let survey = path("survey");
    succeeds(&["scans", "import", text(&file), "-o", text(&survey)]);
    let toml = survey.join("survey.toml");
    let edited = format!("{}\n[options.mesh]\nmax_edge = 1.0\n", std::fs::read_to_string(&toml).unwrap());
    std::fs::write(&toml, &edited).unwrap();
    let build = |output: &str| {
        let built = kilwa(&["build", text(&survey), "-o", text(&path(output))]);
        assert!(built.status.success());
        String::from_utf8(built.stderr).unwrap()
    };
    let warning = "have the same pose, the identity";
    assert!(!build("registered.kilwa").contains(warning));
    // As files without a registration have it.
    let poses: Vec<String> = edited
        .lines()
        .map(|line| match line.split(" = ").next() {
            Some("rotation") => "rotation = [1.0, 0.0, 0.0, 0.0]".to_owned(),
            Some("translation") => "translation = [0.0, 0.0, 0.0]".to_owned(),
            _ => line.to_owned(),
        })
        .collect();
    std::fs::write(&toml, poses.join("\n")).unwrap();
    let said = build("piled_up.kilwa");
    assert!(said.contains(warning) && said.contains("2 stations (room, room-2)"), "{said}");
}

#[test]
fn mistakes_are_explained() {
    let folder = tempfile::tempdir().unwrap();
    let file = box_scan(folder.path());
    let path = |name: &str| folder.path().join(name);
    let survey = path("survey");
    std::fs::write(path("cloud.xyz"), "1 2 3\n").unwrap();
    let refused = fails(&["scans", "import", text(&path("cloud.xyz")), "-o", text(&survey)]);
    assert!(refused.contains("cloud.xyz") && refused.contains("--station X,Y,Z"), "{refused}");
    let refused = fails(&["scans", "import", text(&path("none.ptx")), "-o", text(&survey)]);
    assert!(refused.contains("none.ptx cannot be opened"), "{refused}");
    let refused = fails(&["scans", "list", text(&path("nowhere"))]);
    assert!(refused.contains("survey.toml"), "{refused}");
    succeeds(&["scans", "import", text(&file), "-o", text(&survey)]);
    let refused = fails(&["scans", "import", text(&file), "-o", text(&survey)]);
    assert!(refused.contains("--resume"), "{refused}");
    let said = succeeds(&["scans", "import", text(&file), "-o", text(&survey), "--resume"]);
    assert!(said.contains("2 stations are already in the survey; skipped"), "{said}");
    let refused = fails(&["scans", "export", text(&survey), "rom", "--mesh", "-o", text(&path("a.ply"))]);
    assert!(refused.contains("did you mean room?"), "{refused}");
    let toml = survey.join("survey.toml");
    let edited = std::fs::read_to_string(&toml).unwrap().replace("translation", "translatoin");
    std::fs::write(&toml, edited).unwrap();
    let refused = fails(&["scans", "list", text(&survey)]);
    assert!(refused.contains("survey.toml") && refused.contains("did you mean \"translation\"?"), "{refused}");
    let refused = fails(&["build", text(&file), "-o", text(&path("a.kilwa"))]);
    assert!(refused.contains("kilwa scans import"), "{refused}");
}

/// Killed again and again, each time a little later, and resumed: the survey of an import that was left alone.
#[cfg(unix)]
#[test]
fn an_import_that_is_killed_goes_on_with_resume() {
    use std::process::{Command, Stdio};
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let scan = std::fs::read_to_string(box_scan(folder.path())).unwrap();
    let file = path("many.ptx");
    std::fs::write(&file, scan.repeat(30)).unwrap();
    let (whole, killed) = (path("whole"), path("killed"));
    succeeds(&["scans", "import", text(&file), "-o", text(&whole)]);
    let stations = |survey: &Path| {
        let text = std::fs::read_to_string(survey.join("survey.toml")).unwrap_or_default();
        text.matches("[[station]]").count()
    };
    for round in 1..=4 {
        let mut child = Command::new(env!("CARGO_BIN_EXE_kilwa"))
            .args(["scans", "import", text(&file), "-o", text(&killed), "--resume"])
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        // Until some more stations are there, or all.
        while stations(&killed) < 10 * round && child.try_wait().unwrap().is_none() {
            std::thread::yield_now();
        }
        drop(child.kill());
        child.wait().unwrap();
    }
    succeeds(&["scans", "import", text(&file), "-o", text(&killed), "--resume"]);
    let read = |survey: &Path| std::fs::read_to_string(survey.join("survey.toml")).unwrap();
    assert_eq!(read(&killed), read(&whole));
    let names = |survey: &Path| {
        let entries = std::fs::read_dir(survey.join("stations")).unwrap();
        let mut names: Vec<_> = entries.map(|e| e.unwrap().file_name()).collect();
        names.sort();
        names
    };
    assert_eq!(names(&killed), names(&whole));
    for name in names(&whole) {
        let read = |survey: &Path| std::fs::read(survey.join("stations").join(&name)).unwrap();
        assert!(read(&killed) == read(&whole), "{name:?}");
    }
}

#[test]
fn masks_are_made_shown_switched_and_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let file = box_scan(folder.path());
    let path = |name: &str| folder.path().join(name);
    let survey = path("survey");
    succeeds(&["scans", "import", text(&file), "-o", text(&survey)]);
    let survey = text(&survey);
    let made = json(&["scans", "mask", survey, "--inside", "-9,-9,-9,-2.9,9,9", "--grazing=60", "--isolated"]);
    let masked = made["masks"][1]["masked"].as_u64().unwrap();
    let names: Vec<_> = made["masks"].as_array().unwrap().iter().map(|mask| mask["name"].as_str().unwrap()).collect();
    assert!(masked > 100 && names == ["isolated", "grazing", "inside"], "{made}");
    succeeds(&["scans", "mask", survey, "--off", "grazing"]);
    succeeds(&["scans", "mask", survey, "--remove", "isolated"]);
    let inside = made["masks"][2]["stations"][0]["masked"].as_u64().unwrap();
    assert!(inside > 100, "{made}");
    let list = json(&["scans", "list", survey]);
    let room = &list["stations"][0];
    assert_eq!((room["masked"].as_u64(), room["masks"][0]["on"].as_bool()), (Some(inside), Some(false)), "{list}");
    assert_eq!((&room["masks"][1]["name"], room["masks"][1]["masked"].as_u64()), (&"inside".into(), Some(inside)));
    let said = succeeds(&["scans", "list", survey]);
    assert!(said.contains("mask grazing: ") && said.contains("off at 2") && said.contains("masked)"), "{said}");
    let said = succeeds(&["scans", "mask", survey, "--list", "--station", "room"]);
    assert!(said.contains("room: inside masks") && said.contains("--inside=-9,-9,-9,-2.9,9,9"), "{said}");

    let picture = path("mask.png");
    let said = succeeds(&["scans", "view", survey, "room", "-o", text(&picture), "--show", "mask"]);
    assert!(
        said.contains("grazing: orange (#e69f00)") && said.contains("(off)") && said.contains("inside: sky blue"),
        "{said}"
    );
    let has = |name: &str, color: [u8; 3]| {
        let decoder = png::Decoder::new(std::io::BufReader::new(std::fs::File::open(path(name)).unwrap()));
        let mut reader = decoder.read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        pixels.chunks_exact(3).filter(|pixel| **pixel == color).count() as u64
    };
    let (orange, blue) = (has("mask.png", [230, 159, 0]), has("mask.png", [86, 180, 233]));
    assert!(orange > 0 && blue > 0 && blue <= inside && orange + blue >= inside, "{orange} {blue} {inside}");
    succeeds(&["scans", "view", survey, "room", "-o", text(&path("range.png"))]);
    succeeds(&["scans", "view", survey, "room", "-o", text(&path("whole.png")), "--unmasked"]);
    assert_eq!((has("range.png", [12, 12, 16]), has("whole.png", [12, 12, 16])), (inside, 0));

    let export = |name: &str, more: &[&str]| {
        let file = path(name);
        json(&[&["scans", "export", survey, "room", "-o", text(&file)], more].concat())
    };
    let left = export("left.ptx", &["--ptx"]);
    assert_eq!((left["points"].as_u64(), left["masked"].as_u64()), (Some(2400 - inside), Some(inside)));
    assert_eq!(export("whole.ptx", &["--ptx", "--unmasked"])["points"], 2400);
    let cells = |name: &str| std::fs::read_to_string(path(name)).unwrap().matches("\n0 0 0 0.5").count() as u64;
    assert_eq!((cells("left.ptx"), cells("whole.ptx")), (inside, 0));
    let left = export("left.ply", &["--mesh", "--max-edge", "1"]);
    let whole = export("whole.ply", &["--mesh", "--max-edge", "1", "--unmasked"]);
    assert!(left["triangles"].as_u64().unwrap() + inside < whole["triangles"].as_u64().unwrap(), "{left} {whole}");
    let mesh = Ply::read(&path("left.ply"));
    assert!((0..mesh.vertices.len() as u32).all(|v| mesh.position(v)[0] > -2.9));

    let build = |name: &str, more: &[&str]| {
        let toml = path("survey/survey.toml");
        let written = std::fs::read_to_string(&toml).unwrap();
        if !written.contains("max_edge") {
            std::fs::write(&toml, format!("{written}\n[options.mesh]\nmax_edge = 1.0\n")).unwrap();
        }
        let pack = path(name);
        succeeds(&[&["build", survey, "-o", text(&pack)], more].concat());
        json(&["info", text(&pack)])["stored_triangles"].as_u64().unwrap()
    };
    assert!(build("left.kilwa", &[]) < build("whole.kilwa", &["--unmasked"]));
    let broken = std::fs::read_dir(path("survey/stations")).unwrap().map(|entry| entry.unwrap().path());
    let broken = broken.into_iter().find(|path| path.to_string_lossy().contains("room.inside.")).unwrap();
    std::fs::write(&broken, "damaged").unwrap();
    for call in [&["build", survey, "-o", "none.kilwa"][..], &["scans", "list", survey]] {
        let refused = fails(call);
        assert!(refused.contains("inside") && !path("none.kilwa").exists(), "{refused}");
    }
    let refused = fails(&["scans", "export", survey, "room", "--ptx", "-o", text(&path("none.ptx"))]);
    assert!(refused.contains("room.inside.") && refused.contains("--off inside"), "{refused}");
}

#[test]
fn mistakes_with_masks_are_explained() {
    let folder = tempfile::tempdir().unwrap();
    let file = box_scan(folder.path());
    let survey = folder.path().join("survey");
    succeeds(&["scans", "import", text(&file), "-o", text(&survey)]);
    let survey = text(&survey);
    for (call, parts) in [
        (&["--seen-through"][..], ["station room", "2 other stations"]),
        (&["--intensity", "0.1,1", "--grazing", "--name", "a"], ["--name", "one after the other"]),
        (&["--off", "grasing"], ["grasing", "--list"]),
        (&["--grazing", "--station", "rom"], ["did you mean room?", "rom"]),
        (&["--points", "nowhere.txt", "--station", "room"], ["nowhere.txt", "cannot be opened"]),
    ] {
        let refused = fails(&[&["scans", "mask", survey], call].concat());
        assert!(parts.iter().all(|part| refused.contains(part)), "{call:?}: {refused}");
    }
    // Mistakes of the command line.
    for (call, parts) in [
        (&[][..], ["--mixed", "--seen-through"]),
        (&["--grazing=95"], ["--grazing", "between 0 and 90"]),
        (&["--intensity", "2,1"], ["--intensity", "below the second"]),
        (&["--off", "a", "--grazing"], ["--off", "--grazing"]),
    ] {
        let output = kilwa(&[&["scans", "mask", survey], call].concat());
        let refused = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{call:?}: {refused}");
        assert!(parts.iter().all(|part| refused.contains(part)), "{call:?}: {refused}");
    }
}

/// Two processes at once: each makes its mask at every station or at none, and what one refuses to do, the other has done.
#[cfg(unix)]
#[test]
fn two_processes_that_mask_at_once_leave_both_or_one_and_never_half() {
    use std::process::{Command, Stdio};
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let scan = std::fs::read_to_string(box_scan(folder.path())).unwrap();
    std::fs::write(path("many.ptx"), scan.repeat(10)).unwrap();
    let survey = path("survey");
    succeeds(&["scans", "import", text(&path("many.ptx")), "-o", text(&survey)]);
    let mask = |limit: &str, name: &str| {
        Command::new(env!("CARGO_BIN_EXE_kilwa"))
            .args(["scans", "mask", text(&survey), &format!("--grazing={limit}"), "--name", name])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap()
    };
    // Stations that have the mask of this name, with this limit, and can be read.
    let holders = |name: &str, limit: &str| {
        let list = json(&["scans", "mask", text(&survey), "--list"]);
        let of = |station: &serde_json::Value| {
            let masks = station["masks"].as_array().unwrap().clone();
            masks.into_iter().find(|m| m["name"] == name && m["made"] == format!("--grazing={limit}"))
        };
        list["stations"].as_array().unwrap().iter().filter_map(of).count()
    };
    for round in 0..4 {
        let limits = [60 + round, 70 + round].map(|limit| limit.to_string());
        // The same name, then different ones.
        let names = if round < 2 { ["same", "same"] } else { ["first", "second"] };
        let running = [mask(&limits[0], names[0]), mask(&limits[1], names[1])];
        let done = running.map(|child| child.wait_with_output().unwrap());
        for output in &done {
            let said = String::from_utf8_lossy(&output.stderr);
            assert!(output.status.success() || said.contains("another command is writing to"), "{said}");
        }
        let counts = [0, 1].map(|k| holders(names[k], &limits[k]));
        assert!(counts.iter().all(|n| [0, 20].contains(n)) && counts != [0, 0], "{counts:?}");
        let may_be_replaced = names[0] == names[1] && done.iter().all(|output| output.status.success());
        for (output, count) in done.iter().zip(counts) {
            assert!(may_be_replaced || output.status.success() == (count == 20), "{counts:?}");
        }
    }
}

/// Killed in the middle, and given again: the mask from before stays until the new one is complete at all stations.
#[cfg(unix)]
#[test]
fn masking_that_is_killed_leaves_the_masks_from_before() {
    use std::process::{Command, Stdio};
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let scan = std::fs::read_to_string(box_scan(folder.path())).unwrap();
    std::fs::write(path("many.ptx"), scan.repeat(20)).unwrap();
    let survey = path("survey");
    succeeds(&["scans", "import", text(&path("many.ptx")), "-o", text(&survey)]);
    succeeds(&["scans", "mask", text(&survey), "--grazing=60"]);
    let read = || std::fs::read_to_string(survey.join("survey.toml")).unwrap();
    let before = read();
    let masks = || {
        let entries = std::fs::read_dir(survey.join("stations")).unwrap().map(|entry| entry.unwrap().file_name());
        entries.filter(|name| Path::new(name).extension().is_some_and(|end| end == "mask")).count()
    };
    let mut child = Command::new(env!("CARGO_BIN_EXE_kilwa"))
        .args(["scans", "mask", text(&survey), "--grazing=70"])
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    // Until some new files are there.
    while masks() < 45 && child.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    drop(child.kill());
    let is_done = child.wait().unwrap().success();
    assert!(is_done || read() == before);
    succeeds(&["scans", "list", text(&survey)]);
    succeeds(&["scans", "mask", text(&survey), "--grazing=70"]);
    let unfinished = std::fs::read_dir(survey.join("stations")).unwrap().map(|entry| entry.unwrap().file_name());
    assert_eq!(unfinished.filter(|name| Path::new(name).extension().is_some_and(|end| end == "part")).count(), 0);
    assert_eq!((read().matches("--grazing=70").count(), read().matches("--grazing=60").count(), masks()), (40, 0, 40));
}

#[test]
fn stations_are_exported_together_as_e57_and_ptx_with_masks_applied() {
    let folder = tempfile::tempdir().unwrap();
    let file = box_scan(folder.path());
    let path = |name: &str| folder.path().join(name);
    let survey = path("survey");
    succeeds(&["scans", "import", text(&file), "-o", text(&survey)]);
    let masked = json(&["scans", "mask", text(&survey), "--inside", "-9,-9,-9,-2.9,9,9", "--station", "room"]);
    let masked = masked["masks"][0]["masked"].as_u64().unwrap();
    for (kind, name) in [("--e57", "new/all.e57"), ("--ptx", "new/all.ptx")] {
        let report = json(&["scans", "export", text(&survey), kind, "-o", text(&path(name))]);
        let counts = |k: usize, what: &str| report["stations"][k][what].as_u64();
        assert_eq!((counts(0, "points"), counts(0, "masked")), (Some(2400 - masked), Some(masked)), "{report}");
        assert_eq!((counts(1, "points"), counts(1, "columns"), counts(1, "rows")), (Some(2400), Some(60), Some(40)));
        let again = path(&format!("again{kind}"));
        succeeds(&["scans", "import", text(&path(name)), "-o", text(&again)]);
        let list = json(&["scans", "list", text(&again)]);
        assert_eq!(list["stations"].as_array().unwrap().len(), 2);
        for (k, points) in [(0, 2400 - masked), (1, 2400)] {
            assert_eq!(list["stations"][k]["scan"]["points"].as_u64(), Some(points), "{list}");
        }
        assert_eq!(list["stations"][1]["pose"]["translation_m"][0], 0.5);
    }
    let said = succeeds(&["scans", "export", text(&survey), "room-2", "--e57", "-o", text(&path("one.e57"))]);
    assert!(said.contains("1 station") && said.contains("room-2: 60 × 40 cells, "), "{said}");
    for (call, part) in [
        (&["--mesh", "-o", "a.ply"][..], "name one of the 2 stations"),
        (&["room", "room", "--e57", "-o", "a.e57"], "given twice"),
        (&["--e57", "-o", "a.ptx"], "must be .e57"),
        (&["rom", "--ptx", "-o", "a.ptx"], "did you mean room?"),
    ] {
        let refused = fails(&[&["scans", "export", text(&survey)], call].concat());
        assert!(refused.contains(part), "{call:?}: {refused}");
    }
    let refused = fails(&["scans", "export", text(&survey), "--e57", "-o", text(&path("one.e57"))]);
    assert!(refused.contains("--force"), "{refused}");
}

/// Triangles by the coordinates of their corners, beginning with the smallest, sorted.
fn triangles(ply: &Ply) -> Vec<[[u64; 3]; 3]> {
    let mut all: Vec<_> = ply.triangles.iter().map(|t| turned(t.map(|v| ply.position(v).map(f64::to_bits)))).collect();
    all.sort_unstable();
    all
}

fn turned(mut corners: [[u64; 3]; 3]) -> [[u64; 3]; 3] {
    let first = (0..3).min_by_key(|k| corners[*k]).unwrap();
    corners.rotate_left(first);
    corners
}

#[test]
fn a_divided_mesh_is_the_undivided_one_when_its_files_are_joined() {
    let folder = tempfile::tempdir().unwrap();
    let file = box_scan(folder.path());
    let path = |name: &str| folder.path().join(name);
    let survey = path("survey");
    succeeds(&["scans", "import", text(&file), "-o", text(&survey)]);
    let export = |name: &str, more: &[&str]| {
        json(
            &[
                &["scans", "export", text(&survey), "room-2", "--mesh", "--max-edge", "1", "-o", text(&path(name))],
                more,
            ]
            .concat(),
        )
    };
    let whole = export("whole.ply", &[]);
    assert_eq!((&whole["closed"], whole["files"].as_array()), (&true.into(), None), "{whole}");
    let parts = export("parts.ply", &["--split", "1000"]);
    assert_eq!(whole["triangles"], parts["triangles"]);
    let files: Vec<_> =
        parts["files"].as_array().unwrap().iter().map(|f| f["file"].as_str().unwrap().to_owned()).collect();
    assert_eq!(files.len() as u64, whole["triangles"].as_u64().unwrap().div_ceil(1000), "{parts}");
    assert!(files[0].ends_with("parts-001.ply") && !path("parts.ply").exists(), "{files:?}");
    let meshes: Vec<Ply> = files.iter().map(|file| Ply::read(Path::new(file))).collect();
    let sizes: Vec<usize> = meshes.iter().map(|mesh| mesh.triangles.len()).collect();
    assert!(sizes[..sizes.len() - 1].iter().all(|n| *n == 1000), "{sizes:?}");
    let mut joined: Vec<_> = meshes.iter().flat_map(triangles).collect();
    joined.sort_unstable();
    assert!(joined == triangles(&Ply::read(&path("whole.ply"))), "the same triangles, each once");
    // Vertices that files share are the same in every value.
    let mut seen = std::collections::BTreeMap::new();
    let mut shared = 0;
    for mesh in &meshes {
        for vertex in &mesh.vertices {
            let bits: Vec<u64> = vertex.iter().map(|v| v.to_bits()).collect();
            if let Some(before) = seen.insert(bits[..3].to_vec(), bits.clone()) {
                assert_eq!(before, bits);
                shared += 1;
            }
        }
    }
    assert!(shared > 100, "{shared}");

    // Joined by a build: as many triangles, and no border where the files met.
    let built = |name: &str, files: &[&str]| {
        succeeds(&[&["build"], files, &["-o", text(&path(name))]].concat());
        let about = json(&["info", text(&path(name))]);
        [about["stored_triangles"].clone(), about["patch_triangles"].clone()]
    };
    let named: Vec<&str> = files.iter().map(String::as_str).collect();
    assert_eq!(built("parts.kilwa", &named), built("whole.kilwa", &[text(&path("whole.ply"))]));

    let refused =
        fails(&["scans", "export", text(&survey), "room", "--mesh", "--split", "9000", "-o", text(&path("parts.ply"))]);
    assert!(refused.contains("parts-001.ply already exists") && refused.contains("--force"), "{refused}");
    let output = kilwa(&[
        "scans",
        "export",
        text(&survey),
        "room",
        "--mesh",
        "--max-edge",
        "1",
        "--split",
        "9000",
        "-o",
        text(&path("parts.ply")),
        "--force",
    ]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && said.contains("parts-002.ply is left from before"), "{said}");
}

/// A signal in the middle: nothing under the name of the file, and nothing left of it.
#[cfg(unix)]
#[test]
fn an_export_that_is_interrupted_leaves_nothing() {
    use std::process::{Command, Stdio};
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let scan = std::fs::read_to_string(box_scan(folder.path())).unwrap();
    std::fs::write(path("many.ptx"), scan.repeat(40)).unwrap();
    succeeds(&["scans", "import", text(&path("many.ptx")), "-o", text(&path("survey"))]);
    std::fs::create_dir(path("out")).unwrap();
    let mut child = Command::new(env!("CARGO_BIN_EXE_kilwa"))
        .args(["scans", "export", text(&path("survey")), "--e57", "-o", text(&path("out/all.e57"))])
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    let left = || std::fs::read_dir(path("out")).unwrap().map(|entry| entry.unwrap().file_name()).collect::<Vec<_>>();
    while left().is_empty() && child.try_wait().unwrap().is_none() {
        std::thread::yield_now();
    }
    Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let status = child.wait().unwrap();
    // It may have been quicker than the signal.
    assert!(
        status.code() == Some(130) && left().is_empty() || status.success() && left() == ["all.e57"],
        "{status} {:?}",
        left()
    );
}

/// What a header shows is found before the first file is imported; later errors say how to continue.
#[test]
fn wrong_files_are_found_before_the_work_and_an_import_that_fails_later_says_how_to_continue() {
    let folder = tempfile::tempdir().unwrap();
    let file = box_scan(folder.path());
    let path = |name: &str| folder.path().join(name);
    let survey = path("survey");
    std::fs::write(path("cloud.xyz"), "1 2 3\n").unwrap();
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n";
    let faces = "element face 1\nproperty list uchar int vertex_indices\n";
    std::fs::write(path("mesh.ply"), format!("{header}{faces}end_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n")).unwrap();
    for (wrong, part) in [("cloud.xyz", "--station X,Y,Z"), ("mesh.ply", "is a mesh of 1 face")] {
        let refused = fails(&["scans", "import", text(&file), text(&path(wrong)), "-o", text(&survey)]);
        assert!(refused.contains(part) && !survey.exists(), "{refused}");
        assert!(!refused.contains("--resume"), "{refused}");
    }
    let scan = std::fs::read_to_string(&file).unwrap();
    std::fs::write(
        path("later.ptx"),
        format!("{scan}{}", "2\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n1 2 3 4\n"),
    )
    .unwrap();
    let refused = fails(&["scans", "import", text(&path("later.ptx")), "-o", text(&survey)]);
    assert!(refused.contains("--resume to continue") && refused.contains("later.ptx"), "{refused}");
}

#[test]
fn photographs_are_listed_with_what_is_known_and_what_is_missing() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let write = |name: &str, text: &str| std::fs::write(path(name), text).unwrap();
    write("cameras.txt", "1 OPENCV 40 30 50 51 20 15 -0.1 0 0 0\n");
    write("images.txt", "1 1 0 0 0 0 0 5 1 a.png\n\n2 1 0 0 0 1 0 5 1 b.png\n\n");
    image::GrayImage::new(40, 30).save(path("a.png")).unwrap();
    image::GrayImage::new(8, 8).save(path("c.png")).unwrap();
    let list = succeeds(&["scans", "photos", "list", text(folder.path())]);
    for part in [
        "(COLMAP, text)",
        "40 × 30  brown, f 50.0 px",
        "0.000 0.000 -5.000",
        "3 photographs, 1 with file, camera and pose",
        "1 photograph: no file",
        "1 photograph: no calibration",
        "2 poses are in the frame of the reconstruction",
    ] {
        assert!(list.contains(part), "{part}: {list}");
    }
    let about = json(&["scans", "photos", "list", text(folder.path())]);
    let photo = &about["photographs"][0];
    assert_eq!(photo["camera"]["distortion"]["kind"], "brown");
    assert_eq!(photo["pose"]["camera_from_world"]["translation"][2], 5.0);
    assert_eq!(about["photographs"][1]["missing"][0]["kind"], "no file");
    write("bundle.out", "# Bundle file v0.3\n0 0\n");
    let refused = fails(&["scans", "photos", "list", text(folder.path())]);
    assert!(refused.contains("bundle.out (Bundler)") && refused.contains("--poses FILE"), "{refused}");
    succeeds(&["scans", "photos", "list", text(folder.path()), "--poses", text(&path("cameras.txt"))]);
    let refused = fails(&["scans", "photos", "list", text(&path("nothing"))]);
    assert!(refused.contains("nothing does not exist"), "{refused}");
}

#[test]
fn one_report_has_every_station_mask_hole_and_photograph() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let write = |name: &str, text: &str| std::fs::write(path(name), text).unwrap();
    let survey = path("survey");
    succeeds(&["scans", "import", text(&box_scan(folder.path())), "-o", text(&survey)]);
    let name = json(&["scans", "list", text(&survey)])["stations"][0]["name"].as_str().unwrap().to_owned();
    succeeds(&["scans", "mask", text(&survey), "--mixed"]);
    let holes = r#"{"count": 3, "unseen_m2": 1.25, "free_m2": 0.5, "dropped_m2": 0, "no_return_m2": 0}"#;
    let merge = format!(r#"{{"voxel": 0.02, "stations": 1, "holes": {holes}, "filled": null}}"#);
    write("mesh.json", &merge);
    write("pack.json", &format!(r#"{{"triangles": 9, "merge": {merge}}}"#));
    let photo = r#"{"name": "<b>.jpg", "position": [1, 2, 3], "mask": null, "refined": {"moved_px": 4.5, "residual_px": 0.75},
        "seen": 12345, "share": 10.2, "dropped": 7, "gain": [1.0, 1.1, 1.2]}"#;
    let left_out = r#"[{"name": "far.jpg", "why": "it is too far off"}]"#;
    let photos = format!(r#""photographs": [{photo}], "left_out": {left_out}"#);
    write("colour.json", &format!(r#"{{"vertices": 20000, "coloured_share": 0.5, {photos}}}"#));
    let report = |merge: &str, out: &str| {
        let (merge, colour, out) = (path(merge), path("colour.json"), path(out));
        let args = ["scans", "report", text(&survey), "--merge", text(&merge), "--colour", text(&colour), "-o"];
        succeeds(&[&args[..], &[text(&out)]].concat());
        std::fs::read_to_string(out).unwrap()
    };
    let page = report("mesh.json", "a.html");
    let parts =
        [&name, "mixed ", "1.25 m²", "20.0 mm", "&lt;b&gt;.jpg", "12,345", "4.50", "0.75", "1.10", "it is too far off"];
    for part in parts {
        assert!(page.contains(part), "{part}: {page}");
    }
    assert_eq!(page, report("pack.json", "b.html"), "the report for a pack contains that of the merge");
    let all: serde_json::Value = serde_json::from_str(&report("pack.json", "c.json")).unwrap();
    assert_eq!((&all["stations"][0]["name"], &all["merge"]["holes"]["count"]), (&name.into(), &3.into()));
    assert_eq!(all["stations"][0]["masks"][0]["name"], "mixed");
    assert_eq!(all["colour"]["photographs"][0]["seen"], 12345);

    let out = path("d.html");
    let refused = |extra: &[&str]| fails(&[&["scans", "report", text(&survey), "-o", text(&out)], extra].concat());
    write("not.json", "{");
    let (colour, not) = (path("colour.json"), path("not.json"));
    let other = refused(&["--merge", text(&colour)]);
    assert!(other.contains("colour.json is not the report of `kilwa merge --json`"), "{other}");
    let broken = refused(&["--colour", text(&not)]);
    assert!(broken.contains("not.json is not JSON"), "{broken}");
    assert!(!out.exists());
    let named = fails(&["scans", "report", text(&survey), "-o", text(&path("e.txt"))]);
    assert!(named.contains("must end in .html or .json"), "{named}");
    let kept = fails(&["scans", "report", text(&survey), "-o", text(&path("a.html"))]);
    assert!(kept.contains("--force"), "{kept}");
}
