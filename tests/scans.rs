//! `kilwa scans` as a person or a script meets it.

use crate::support::{Ply, fails, json, kilwa, succeeds, text};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Two stations of 60 × 40 cells in the middle of a box of 6 × 6 × 3 m; the second is turned by 90° and has colours.
fn box_scan(folder: &Path) -> PathBuf {
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
