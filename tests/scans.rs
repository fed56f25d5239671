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
